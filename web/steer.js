// Converts movements of pointers and keys into scene edits.

import * as camera from './camera.js';

const LEAST_SLICE_PX = 3;
const MOST_SLICE_PX = 24;

/** Distance of one wheel step along `normal` (a unit vector), mm: to the next layer of voxels. */
export function sliceStep(volume, normal) {
  if (!volume?.spacing) return 1;
  const along = camera.columns(volume).map((column) => Math.abs(camera.dot(column, normal)));
  return Math.min(...volume.spacing.map((mm, k) => mm / Math.max(along[k], 1e-6)));
}

/**
 * The patch for one display frame's movement (Input.drain), or null.
 * @param stage {width, height} CSS px
 * @param volume description with range and spacing
 * @param box of the volume
 */
export function steer(scene, moved, stage, volume, box) {
  const patch = scene.mode === 'mpr' ? steerSlice(scene, moved, stage, volume, box) : steerCamera(scene, moved, stage);
  if (moved.window[0] || moved.window[1]) patch.window = steerWindow(scene, moved.window, stage, volume);
  return Object.keys(patch).length ? patch : null;
}

function steerCamera(scene, moved, stage) {
  let view = scene.camera;
  if (moved.orbit[0] || moved.orbit[1]) view = camera.orbit(view, -moved.orbit[0], -moved.orbit[1]);
  if (moved.roll) view = camera.roll(view, -moved.roll);
  const before = camera.spanAtTarget(view);
  if (moved.factor !== 1) view = camera.zoom(view, moved.factor);
  const [dx, dy] = shiftWithin(moved, before / camera.spanAtTarget(view));
  if (dx || dy) view = camera.pan(view, dx, dy, stage.height);
  return view === scene.camera ? {} : { camera: view };
}

/** The shift for a zoom that stopped at its limit: keeps the point under the pointer. */
function shiftWithin({ pan, factor }, reached) {
  return factor === 1 || Math.abs(reached - factor) < 1e-9 ? pan : pan.map((x) => (x * (1 - reached)) / (1 - factor));
}

function steerSlice(scene, moved, stage, volume, box) {
  const mpr = scene.mpr ?? {};
  const patch = moved.orbit[0] || moved.orbit[1] || moved.roll ? tilted(mpr, moved, box) : {};
  const { right, up, direction } = camera.sliceBasis({ ...mpr, ...patch });
  const before = mpr.zoom ?? 1;
  const zoom = Math.min(100, Math.max(0.1, before * moved.factor));
  if (zoom !== before) patch.zoom = zoom;
  const [dx, dy] = shiftWithin(moved, zoom / before);
  if (dx || dy || moved.slices) {
    const mm = sliceHeight({ mpr: { ...mpr, ...patch, zoom } }, stage, box) / stage.height;
    const inPlane = camera.add(camera.scale(right, -dx * mm), camera.scale(up, dy * mm));
    const center = camera.add(mpr.center ?? box?.center ?? [0, 0, 0], inPlane);
    patch.center = moved.slices ? scrolled(center, direction, moved.slices, volume, box) : center;
  }
  return Object.keys(patch).length ? { mpr: patch } : {};
}

/** The plane rotated about its centre, like a picture in space. */
function tilted(mpr, { orbit, roll }, box) {
  const center = mpr.center ?? box?.center ?? [0, 0, 0];
  const { direction, up } = camera.sliceBasis(mpr);
  const view = { position: camera.sub(center, direction), target: center, up };
  const turned = camera.basis(camera.roll(camera.orbit(view, -orbit[0], -orbit[1]), -roll));
  return { orientation: 'oblique', center, normal: camera.scale(turned.direction, -1), up: turned.up };
}

/** The first and last layer of a volume along a unit vector, mm from the origin. */
export function sliceEnds(box, direction) {
  const middle = camera.dot(box.center, direction);
  const half = box.edges.reduce((sum, edge) => sum + Math.abs(camera.dot(edge, direction)), 0) / 2;
  return [middle - half, middle + half];
}

/** Distance a finger moves per slice, CSS px: the stage's height is about the whole volume. */
export function slicePixels(scene, stage, volume, box) {
  if (!box) return MOST_SLICE_PX;
  const { direction } = camera.sliceBasis(scene.mpr);
  const [low, high] = sliceEnds(box, direction);
  const layers = Math.max(1, (high - low) / sliceStep(volume, direction));
  return Math.min(MOST_SLICE_PX, Math.max(LEAST_SLICE_PX, stage.height / layers));
}

/** Whether the last slice is shown. */
export function atLastSlice(scene, box) {
  const { direction } = camera.sliceBasis(scene.mpr);
  return camera.dot(scene.mpr?.center ?? box.center, direction) > sliceEnds(box, direction)[1] - 1e-6;
}

// Stops at the volume's ends.
function scrolled(center, direction, slices, volume, box) {
  const at = camera.dot(center, direction);
  const [low, high] = box ? sliceEnds(box, direction) : [-Infinity, Infinity];
  const next = Math.min(high, Math.max(low, at + slices * sliceStep(volume, direction)));
  return camera.add(center, camera.scale(direction, next - at));
}

/** Height of a slice picture, mm: at zoom 1 the whole plane is visible. */
export function sliceHeight(scene, stage, box) {
  if (!box) return stage.height;
  const { right, up } = camera.sliceBasis(scene.mpr);
  const extent = (v) => box.edges.reduce((sum, edge) => sum + Math.abs(camera.dot(edge, v)), 0);
  return Math.max(extent(up), (extent(right) * stage.height) / stage.width) / (scene.mpr?.zoom ?? 1);
}

/** The patient position (LPS mm) of a point in a slice picture of size {width, height}; y down. */
export function slicePlace(scene, [x, y], size, box) {
  const { right, up } = camera.sliceBasis(scene.mpr);
  const mm = sliceHeight(scene, size, box) / size.height;
  const across = camera.scale(right, (x - size.width / 2) * mm);
  return camera.add(scene.mpr.center ?? box.center, camera.add(across, camera.scale(up, (size.height / 2 - y) * mm)));
}

// The stage's width is about the whole range of values, less for narrow windows.
function steerWindow(scene, [dx, dy], stage, volume) {
  const { center = 0, width = 1 } = scene.window ?? {};
  const [low, high] = volume?.range ?? [0, 1];
  const perPixel = Math.max(width, (high - low) / 50) / stage.width;
  return { center: center + dy * perPixel, width: Math.max((high - low) / 1e4, width + dx * 2 * perPixel) };
}
