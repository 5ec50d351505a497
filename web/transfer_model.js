// Transfer functions as lists of knots: pure edits, each returns a new list. Values are in the volume's unit.
//
// A knot is {value, color: [r, g, b] 0..1, opacity} or {value, color, extinction}; a list uses one of the two. Knots
// are in ascending order; two at one value make a jump. The function is constant beyond its ends.

/** "opacity" (0..1 per unit distance) or "extinction" (1/mm). */
export const amountName = (points) => (points.length && points[0].extinction !== undefined ? 'extinction' : 'opacity');

export const amountOf = (point) => point.extinction ?? point.opacity ?? 0;

/** Top of the amount axis: 1 for opacity, a round number above the largest extinction. */
export function amountLimit(points) {
  if (amountName(points) === 'opacity') return 1;
  const most = Math.max(1e-3, ...points.map(amountOf));
  return 10 ** Math.ceil(Math.log10(most) - 1e-9);
}

const mix = (a, b, t) => a + (b - a) * t;

/** Colour and amount at a value. */
export function sample(points, value) {
  const after = points.findIndex((point) => point.value > value);
  if (after === 0) return { color: [...points[0].color], amount: amountOf(points[0]) };
  if (after < 0) return { color: [...points.at(-1).color], amount: amountOf(points.at(-1)) };
  const [low, high] = [points[after - 1], points[after]];
  const t = (value - low.value) / (high.value - low.value);
  return {
    color: low.color.map((channel, i) => mix(channel, high.color[i], t)),
    amount: mix(amountOf(low), amountOf(high), t),
  };
}

/** Inserts a knot with the function's colour at its value. @returns {{points, index}} */
export function addKnot(points, value, amount) {
  const name = amountName(points);
  const { color } = points.length ? sample(points, value) : { color: [1, 1, 1] };
  const after = points.findIndex((point) => point.value > value);
  const index = after < 0 ? points.length : after;
  const knot = { value, color, [name]: clampAmount(name, amount) };
  return { points: [...points.slice(0, index), knot, ...points.slice(index)], index };
}

/** Moves one knot, at most up to its neighbours, so that the order is kept. */
export function moveKnot(points, index, value, amount) {
  const low = index > 0 ? points[index - 1].value : -Infinity;
  const high = index < points.length - 1 ? points[index + 1].value : Infinity;
  const next = {
    value: Math.min(high, Math.max(low, value)),
    [amountName(points)]: clampAmount(amountName(points), amount),
  };
  return points.map((point, i) => (i === index ? { ...point, ...next } : point));
}

export const colorKnot = (points, index, color) =>
  points.map((point, i) => (i === index ? { ...point, color } : point));

/** Keeps the last knot, since a function needs one. */
export const removeKnot = (points, index) => (points.length > 1 ? points.filter((_, i) => i !== index) : points);

/** Shifts the whole curve along the value axis. */
export const shiftKnots = (points, delta) => points.map((point) => ({ ...point, value: point.value + delta }));

const OPAQUE = 0.999; // full opacity is scaled as this value, since infinite extinction could not become thinner
const MADE_FROM = new WeakMap(); // scaled list -> {points, factor}: further scaling starts from the original

/** Multiplies the extinction of all knots. Scaling by a factor and its inverse restores the function. */
export function scaleAmounts(points, factor) {
  const origin = MADE_FROM.get(points) ?? { points, factor: 1 };
  const total = origin.factor * factor;
  if (Math.abs(total - 1) < 1e-9) return origin.points;
  const scaled = origin.points.map((point) =>
    point.extinction === undefined
      ? { ...point, opacity: 1 - (1 - Math.min(OPAQUE, amountOf(point))) ** total }
      : { ...point, extinction: point.extinction * total },
  );
  MADE_FROM.set(scaled, { points: origin.points, factor: total });
  return scaled;
}

/** A range of the value axis that shows all knots. */
export function knotRange(points, whole) {
  if (!points.length) return [...whole];
  const low = points[0].value;
  const high = points.at(-1).value;
  const margin = (high - low || (whole[1] - whole[0]) / 10 || 1) * 0.08;
  return [low - margin, high + margin];
}

/** The limits of the value axis: all values and all knots, with a margin. */
export function axisReach(points, [low, high]) {
  const values = points.map(({ value }) => value);
  const [first, last] = [Math.min(low, ...values), Math.max(high, ...values)];
  const margin = (last - first) * 0.1;
  return [first - margin, last + margin];
}

/** The nearest range inside `reach` that is at least `least` wide. */
export function rangeWithin([low, high], reach, least) {
  const span = Math.min(reach[1] - reach[0], Math.max(least, high - low));
  const start = Math.min(reach[1] - span, Math.max(reach[0], low));
  return [start, start + span];
}

/** The range that puts each of two values at its place, 0..1 of the axis; null if they are too close. */
export function rangeThrough([a, b]) {
  if (Math.abs(b.place - a.place) < 0.02) return null;
  const span = (b.value - a.value) / (b.place - a.place);
  return span > 0 ? [a.value - a.place * span, a.value + (1 - a.place) * span] : null;
}

export const toHex = (color) =>
  '#' +
  color
    .map((c) =>
      Math.round(Math.min(1, Math.max(0, c)) * 255)
        .toString(16)
        .padStart(2, '0'),
    )
    .join('');

export const fromHex = (text) => [1, 3, 5].map((at) => Number.parseInt(text.slice(at, at + 2), 16) / 255);

function clampAmount(name, amount) {
  return name === 'opacity' ? Math.min(1, Math.max(0, amount)) : Math.max(0, amount);
}

/** A number for display: enough digits for the range it is read in, without trailing zeros. */
export function formatValue(value, span = 1000) {
  const digits = Math.max(0, Math.min(6, 3 - Math.floor(Math.log10(Math.abs(span) || 1))));
  return String(Number(value.toFixed(digits)));
}
