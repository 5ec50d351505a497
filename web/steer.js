// Movement of pointers and keys into scene edits.

import * as camera from './camera.js';

const ORBIT_DEGREES = 0.45; // per CSS pixel
const KEY_DEGREES = 5;
const KEY_ZOOM = 1.15;

/** How much a slice moves along `normal` (a unit vector) for one step of the wheel, mm: to the next layer of voxels. */
export function sliceStep(volume, normal) {
  if (!volume?.spacing) return 1;
  const along = camera.columns(volume).map((column) => Math.abs(camera.dot(column, normal)));
  return Math.min(...volume.spacing.map((mm, k) => mm / Math.max(along[k], 1e-6)));
}

/**
 * The patch for one display frame's movement (Input.drain), or null.
 * @param stage {width, height} CSS px  @param volume description with range and spacing  @param box of the volume
 */
export function steer(scene, moved, stage, volume, box) {
  const patch = scene.mode === 'mpr' ? steerSlice(scene, moved, stage, volume, box) : steerCamera(scene, moved, stage);
  if (moved.window[0] || moved.window[1]) patch.window = steerWindow(scene, moved.window, stage, volume);
  return Object.keys(patch).length ? patch : null;
}

function steerCamera(scene, moved, stage) {
  let view = scene.camera;
  if (moved.orbit[0] || moved.orbit[1])
    view = camera.orbit(view, -moved.orbit[0] * ORBIT_DEGREES, -moved.orbit[1] * ORBIT_DEGREES);
  if (moved.roll) view = camera.roll(view, -moved.roll);
  if (moved.pan[0] || moved.pan[1]) view = camera.pan(view, moved.pan[0], moved.pan[1], stage.height);
  if (moved.factor !== 1) view = camera.zoom(view, moved.factor);
  return view === scene.camera ? {} : { camera: view };
}

function steerSlice(scene, moved, stage, volume, box) {
  const mpr = scene.mpr ?? {};
  const patch = {};
  const axes = camera.sliceBasis(mpr);
  let center = mpr.center ?? box?.center ?? [0, 0, 0];
  const layers = moved.slices * sliceStep(volume, axes.direction);
  if (moved.slices) center = camera.add(center, camera.scale(axes.direction, layers));
  if (moved.pan[0] || moved.pan[1]) {
    const mm = sliceHeight(scene, stage, box) / stage.height;
    center = camera.add(
      center,
      camera.add(camera.scale(axes.right, -moved.pan[0] * mm), camera.scale(axes.up, moved.pan[1] * mm)),
    );
  }
  if (center !== mpr.center && (moved.slices || moved.pan[0] || moved.pan[1])) patch.center = center;
  if (moved.factor !== 1) patch.zoom = Math.min(100, Math.max(0.1, (mpr.zoom ?? 1) * moved.factor));
  return Object.keys(patch).length ? { mpr: patch } : {};
}

/** What a slice picture's height spans, mm: at zoom 1 the whole plane shows. */
export function sliceHeight(scene, stage, box) {
  if (!box) return stage.height;
  const { right, up } = camera.sliceBasis(scene.mpr);
  const extent = (v) => box.edges.reduce((sum, edge) => sum + Math.abs(camera.dot(edge, v)), 0);
  return Math.max(extent(up), (extent(right) * stage.height) / stage.width) / (scene.mpr?.zoom ?? 1);
}

/** Where in the patient a point of a slice picture of size {width, height} lies, LPS mm; y down. */
export function slicePlace(scene, [x, y], size, box) {
  const { right, up } = camera.sliceBasis(scene.mpr);
  const mm = sliceHeight(scene, size, box) / size.height;
  const across = camera.scale(right, (x - size.width / 2) * mm);
  return camera.add(scene.mpr.center ?? box.center, camera.add(across, camera.scale(up, (size.height / 2 - y) * mm)));
}

// The whole width of the stage is about the whole range of values, finer for narrow windows.
function steerWindow(scene, [dx, dy], stage, volume) {
  const { center = 0, width = 1 } = scene.window ?? {};
  const [low, high] = volume?.range ?? [0, 1];
  const perPixel = Math.max(width, (high - low) / 50) / stage.width;
  return { center: center + dy * perPixel, width: Math.max((high - low) / 1e4, width + dx * 2 * perPixel) };
}

/** What a key does to the camera: a new camera, or null when it is no key of ours. */
export function steerByKey(view, key, shiftKey) {
  const turn = shiftKey ? 1 : KEY_DEGREES;
  switch (key) {
    case 'ArrowLeft':
      return camera.orbit(view, turn, 0);
    case 'ArrowRight':
      return camera.orbit(view, -turn, 0);
    case 'ArrowUp':
      return camera.orbit(view, 0, turn);
    case 'ArrowDown':
      return camera.orbit(view, 0, -turn);
    case '+':
    case '=':
      return camera.zoom(view, KEY_ZOOM);
    case '-':
    case '_':
      return camera.zoom(view, 1 / KEY_ZOOM);
    default:
      return null;
  }
}
