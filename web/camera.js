// Camera mathematics: plain values in, new plain values out. No screen pixels except for a height.
//
// A camera is a scene's `camera` member: projection, position, target, up (mm, patient LPS: x to the patient's left, y
// to the back, z to the head), fovY (degrees), height (mm, orthographic).

const RADIANS = Math.PI / 180;
const MIN_DISTANCE_MM = 0.01; // microscopy volumes are a few mm wide
const MAX_DISTANCE_MM = 1e5;

export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const length = (a) => Math.hypot(a[0], a[1], a[2]);
export const normalize = (a) => scale(a, 1 / (length(a) || 1));

const clamp = (x, low, high) => Math.min(high, Math.max(low, x));

/** Rotation of v about the unit axis by an angle in radians (Rodrigues). */
export function rotate(v, axis, angle) {
  const c = Math.cos(angle);
  const s = Math.sin(angle);
  return add(add(scale(v, c), scale(cross(axis, v), s)), scale(axis, dot(axis, v) * (1 - c)));
}

/** Unit vectors of the picture: into it, right, up. Replaces a degenerate `up`. */
export function basis(camera) {
  let direction = normalize(sub(camera.target, camera.position));
  if (length(direction) < 0.5) direction = [0, 1, 0];
  let right = cross(direction, camera.up);
  if (length(right) < 1e-6) right = cross(direction, Math.abs(direction[2]) < 0.9 ? [0, 0, 1] : [0, -1, 0]);
  right = normalize(right);
  return { direction, right, up: cross(right, direction) };
}

export const distance = (camera) => length(sub(camera.target, camera.position));

/** Height of the picture at the target, mm. */
export function spanAtTarget(camera) {
  if (camera.projection === 'orthographic') return camera.height;
  return 2 * distance(camera) * Math.tan((camera.fovY * RADIANS) / 2);
}

/** Orbits the camera about its target: yaw about the picture's vertical, pitch about its horizontal. Degrees. */
export function orbit(camera, yaw, pitch) {
  const { right, up } = basis(camera);
  const offset = sub(camera.position, camera.target);
  const turn = (v) => rotate(rotate(v, up, yaw * RADIANS), right, pitch * RADIANS);
  return { ...camera, position: add(camera.target, turn(offset)), up: normalize(turn(up)) };
}

/** Rolls the picture in its plane, degrees, positive is counter-clockwise. */
export function roll(camera, degrees) {
  const { direction, up } = basis(camera);
  return { ...camera, up: normalize(rotate(up, direction, degrees * RADIANS)) };
}

/** Pans by (dx, dy) pixels, y down, in a picture `heightPx` high: the point at the target follows the pointer. */
export function pan(camera, dx, dy, heightPx) {
  const { right, up } = basis(camera);
  const mm = spanAtTarget(camera) / heightPx;
  const move = add(scale(right, -dx * mm), scale(up, dy * mm));
  return { ...camera, position: add(camera.position, move), target: add(camera.target, move) };
}

/** factor > 1 enlarges. A perspective camera moves, an orthographic one changes its height. */
export function zoom(camera, factor) {
  if (camera.projection === 'orthographic') {
    return { ...camera, height: clamp(camera.height / factor, MIN_DISTANCE_MM, MAX_DISTANCE_MM) };
  }
  const offset = sub(camera.position, camera.target);
  const now = length(offset) || MIN_DISTANCE_MM;
  const next = clamp(now / factor, MIN_DISTANCE_MM, MAX_DISTANCE_MM);
  return { ...camera, position: add(camera.target, scale(offset, next / now)) };
}

/** Switches the projection and keeps the size at the target. */
export function withProjection(camera, projection) {
  const span = spanAtTarget(camera);
  const { direction } = basis(camera);
  if (projection === 'orthographic') return { ...camera, projection, height: span };
  const away = span / 2 / Math.tan((camera.fovY * RADIANS) / 2);
  return { ...camera, projection, position: sub(camera.target, scale(direction, away)) };
}

/**
 * Standard views: the side of the patient facing the viewer, and the up direction. H and F have the front on top, so
 * that F looks as radiologists expect axial slices: the patient's right on the left of the picture.
 */
export const STANDARD_VIEWS = {
  A: { from: [0, -1, 0], up: [0, 0, 1], title: 'Anterior' },
  P: { from: [0, 1, 0], up: [0, 0, 1], title: 'Posterior' },
  L: { from: [1, 0, 0], up: [0, 0, 1], title: 'Left' },
  R: { from: [-1, 0, 0], up: [0, 0, 1], title: 'Right' },
  H: { from: [0, 0, 1], up: [0, -1, 0], title: 'Head' },
  F: { from: [0, 0, -1], up: [0, -1, 0], title: 'Feet' },
};

/** Rotates to a standard view; keeps target, distance and zoom. */
export function standardView(camera, letter) {
  const view = STANDARD_VIEWS[letter];
  const away = distance(camera) || MIN_DISTANCE_MM;
  return { ...camera, position: add(camera.target, scale(view.from, away)), up: [...view.up] };
}

/** Unit vectors of a volume's index axes in LPS. */
export function columns({ direction = [1, 0, 0, 0, 1, 0, 0, 0, 1] }) {
  const m = direction.flat();
  return [0, 1, 2].map((k) => [m[k], m[3 + k], m[6 + k]]);
}

/**
 * Bounding box of a volume in LPS, from the daemon's description. Voxel centres span [0, n-1]; an axis with one voxel
 * is one spacing thick. `edges` are the volume's own three edges; low and high bound the axis-aligned box.
 * @returns {{center: number[], radius: number, low: number[], high: number[], edges: number[][]}} mm
 */
export function volumeBox(volume) {
  const { dims, spacing, origin = [0, 0, 0] } = volume;
  const axes = columns(volume);
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let corner = 0; corner < 8; corner++) {
    let p = [...origin];
    for (let k = 0; k < 3; k++) {
      const span = dims[k] > 1 ? [0, dims[k] - 1] : [-0.5, 0.5];
      p = add(p, scale(axes[k], span[(corner >> k) & 1] * spacing[k]));
    }
    for (let k = 0; k < 3; k++) {
      low[k] = Math.min(low[k], p[k]);
      high[k] = Math.max(high[k], p[k]);
    }
  }
  const edges = axes.map((axis, k) => scale(axis, Math.max(1, dims[k] - 1) * spacing[k]));
  return { low, high, edges, center: scale(add(low, high), 0.5), radius: length(sub(high, low)) / 2 };
}

/** Moves the camera along its direction until the whole box fits a picture of aspect width/height. */
export function fit(camera, box, aspect) {
  const { direction, right, up } = basis(camera);
  const half = scale(sub(box.high, box.low), 0.5);
  const reach = (v) => Math.abs(v[0]) * half[0] + Math.abs(v[1]) * half[1] + Math.abs(v[2]) * half[2];
  const span = 2 * Math.max(reach(up), reach(right) / aspect) * 1.08;
  const tangent = Math.tan((camera.fovY * RADIANS) / 2);
  const away = camera.projection === 'orthographic' ? 2 * box.radius : span / 2 / tangent + reach(direction);
  const position = sub(box.center, scale(direction, Math.max(away, MIN_DISTANCE_MM)));
  return { ...camera, target: [...box.center], position, height: Math.max(span, MIN_DISTANCE_MM) };
}

const LETTERS = [
  ['L', 'R'],
  ['P', 'A'],
  ['H', 'F'],
];

/** Letters of a patient direction, strongest first: "A", "AL", "HAR". Components below `threshold` are dropped. */
export function letters(vector, threshold = 0.26) {
  return normalize(vector)
    .map((value, axis) => ({ size: Math.abs(value), letter: LETTERS[axis][value > 0 ? 0 : 1] }))
    .filter(({ size }) => size > threshold)
    .sort((a, b) => b.size - a.size)
    .map(({ letter }) => letter)
    .join('');
}

/** The letters of the picture's four edges. */
export function edgeLetters({ right, up }) {
  const minus = (v) => scale(v, -1);
  return { right: letters(right), left: letters(minus(right)), top: letters(up), bottom: letters(minus(up)) };
}

/** Axes of a slice: right, up, and into it. Axial is seen from the feet, sagittal from the left. */
export function sliceBasis(mpr) {
  switch (mpr?.orientation) {
    case 'coronal':
      return { right: [1, 0, 0], up: [0, 0, 1], direction: [0, 1, 0] };
    case 'sagittal':
      return { right: [0, 1, 0], up: [0, 0, 1], direction: [-1, 0, 0] };
    case 'oblique':
      return basis({ position: [0, 0, 0], target: scale(mpr.normal, -1), up: mpr.up });
    default:
      return { right: [1, 0, 0], up: [0, -1, 0], direction: [0, 0, 1] };
  }
}

/** Length of a scale bar: 1, 2 or 5 times a power of ten, at most `most`. */
export function roundLength(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  const lead = most / power;
  return power * (lead >= 5 ? 5 : lead >= 2 ? 2 : 1);
}
