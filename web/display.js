// Defaults for displaying a volume, from `display` in its description: presets fitted to its values and size, and
// windows by mode.

const MIDDLE = 0.35; // value of a relative preset that maps to the middle of display.range
const SLAB = 0.05; // part of the volume's extent shown in mode minip, since the minimum through all of it is air

/** The patch that selects a preset. @param range of the volume, used without a display */
export function presetPatch(preset, display, [low, high]) {
  const [from, middle, to] = display?.range ?? [low, low + MIDDLE * (high - low), high];
  const between = (a, b, at) => a * (1 - at) + b * at;
  const fitted = (value) =>
    value < MIDDLE ? between(from, middle, value / MIDDLE) : between(middle, to, (value - MIDDLE) / (1 - MIDDLE));
  const points = (preset.points ?? []).map((point) =>
    preset.relative ? { ...point, value: fitted(point.value) } : point,
  );
  const transferFunction = { preset: preset.name };
  if (points.length) transferFunction.points = points;
  if (preset.unitDistance) transferFunction.unitDistance = preset.unitDistance * (display?.unitDistance ?? 1);
  return { transferFunction, ...(preset.shading && { shading: preset.shading }) };
}

/** Two planes around the centre of a box, facing the view. */
function slabAcross({ position, target }, { low, high, center }) {
  const away = target.map((t, k) => t - position[k]);
  const length = Math.hypot(...away);
  const normal = away.map((x) => x / length);
  const half = (SLAB / 2) * Math.max(...high.map((end, k) => end - low[k]));
  const middle = normal.reduce((sum, n, k) => sum + n * center[k], 0);
  return [
    [...normal, half - middle],
    [...normal.map((n) => -n), half + middle],
  ];
}

/** The window that suits a projection, and for minip a slab. @returns a patch */
export function projectionLook(mode, scene, display, box) {
  const window = display?.windows?.[mode];
  const slab = mode === 'minip' && box && scene.camera && slabAcross(scene.camera, box);
  return { ...(window && { window }), ...(slab && { clip: { planes: slab } }) };
}
