// Numbers about numbers. Lists of samples in, plain values out; nothing here knows of sockets or clocks.

/** The smallest sample that at least `fraction` of them do not exceed (nearest rank); null of none. `sorted` ascends. */
export function percentile(sorted, fraction) {
  if (!sorted.length) return null;
  return sorted[Math.min(sorted.length, Math.max(1, Math.ceil(fraction * sorted.length - 1e-9))) - 1];
}

export const ascending = (values) => Float64Array.from(values).sort();
export const sum = (values) => values.reduce((total, value) => total + value, 0);

/** {count, mean, p50, p95, p99, max} */
export function summary(values) {
  const sorted = ascending(values);
  const at = (fraction) => round(percentile(sorted, fraction));
  const mean = sorted.length ? round(sum(sorted) / sorted.length) : null;
  return { count: sorted.length, mean, p50: at(0.5), p95: at(0.95), p99: at(0.99), max: at(1) };
}

/** Jain's index of fairness: 1 when all get the same, 1/n when one gets everything; null when nobody gets anything. */
export function jain(values) {
  const squares = sum(values.map((value) => value * value));
  return squares > 0 ? round(sum(values) ** 2 / (values.length * squares), 4) : null;
}

/** The cumulative distribution as [value, fraction] at `steps` even fractions and the tail above them. */
export function distribution(values, steps = 50) {
  const sorted = ascending(values);
  if (!sorted.length) return [];
  const fractions = [...Array.from({ length: steps }, (_, i) => i / steps), 0.99, 0.995, 1];
  return fractions.map((fraction) => [round(percentile(sorted, fraction)), fraction]);
}

/** Greatest value in each of the bins of `width` from 0 to `end`; null where a bin has none. `samples`: [at, value]. */
export function greatestPerBin(samples, width, end) {
  const bins = new Array(Math.max(1, Math.ceil(end / width))).fill(null);
  for (const [at, value] of samples) {
    const bin = Math.floor(at / width);
    if (bin >= 0 && bin < bins.length) bins[bin] = Math.max(bins[bin] ?? 0, round(value));
  }
  return bins;
}

/** What a Prometheus text says: Map of "name{labels}" to its number. */
export function readMetrics(text) {
  const found = new Map();
  for (const line of text.split('\n')) {
    const parts = /^([a-zA-Z_:][\w:]*(?:\{.*\})?) (\S+)/.exec(line);
    if (parts) found.set(parts[1], parts[2] === '+Inf' ? Infinity : Number(parts[2]));
  }
  return found;
}

/** Buckets of one histogram between two scrapes: [[upper bound, count below or at it]...], cumulative. */
export function histogramBetween(before, after, name) {
  const prefix = `${name}_bucket{le="`;
  return [...after.keys()]
    .filter((key) => key.startsWith(prefix))
    .map((key) => {
      const bound = key.slice(prefix.length, -2);
      return [bound === '+Inf' ? Infinity : Number(bound), after.get(key) - (before.get(key) ?? 0)];
    })
    .sort(([a], [b]) => a - b);
}

/** The bound of the bucket that holds this fraction: the value is at most that. null where the histogram is empty. */
export function boundOf(buckets, fraction) {
  const total = buckets.at(-1)?.[1] ?? 0;
  if (!total) return null;
  return buckets.find(([, count]) => count >= fraction * total - 1e-9)[0];
}

export function round(value, digits = 3) {
  return value === null || !Number.isFinite(value) ? value : Number(value.toFixed(digits));
}
