// Plots as inline SVG: lines, steps and bars over labelled axes. Values in, text out; colours come from the page's style.

const WIDTH = 460;
const HEIGHT = 220;
const LEFT = 52, RIGHT = 12, TOP = 12, BOTTOM = 36;

export const escape = (text) => String(text).replace(/[&<>"]/g, (c) => ({ '&': '&amp;', '<': '&lt;', '>': '&gt;', '"': '&quot;' })[c]);

/** About `wanted` round numbers from low to high. */
export function ticks(low, high, wanted = 5) {
  const rough = (high - low || 1) / wanted;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((lead) => lead * power).find((size) => size >= rough * 0.999);
  const found = [];
  for (let at = Math.ceil(low / step - 1e-9) * step; at <= high + step * 1e-6; at += step) found.push(Number(at.toPrecision(12)));
  return found;
}

const decades = (low, high) => {
  const found = [];
  for (let power = Math.floor(Math.log10(low)); 10 ** power <= high * 1.0001; power++) if (10 ** power >= low * 0.9999) found.push(10 ** power);
  return found;
};

/** A linear or logarithmic axis: at(value) in pixels, and its marks. */
function axis([low, high], [from, to], log) {
  const bend = log ? Math.log10 : (x) => x;
  const [a, b] = [bend(low), bend(high)];
  return { at: (x) => from + ((bend(Math.min(high, Math.max(low, x))) - a) / (b - a || 1)) * (to - from), marks: log ? decades(low, high) : ticks(low, high) };
}

const label = (value) => (Math.abs(value) >= 1000 ? `${Number((value / 1000).toPrecision(3))}k` : String(Number(value.toPrecision(3))));

function frame(x, y, { xLabel, yLabel }) {
  const [bottom, right] = [HEIGHT - BOTTOM, WIDTH - RIGHT];
  const rows = y.marks.map((mark) => `<path class="grid" d="M${LEFT} ${y.at(mark).toFixed(1)}H${right}"/>` +
    `<text class="tick" x="${LEFT - 6}" y="${(y.at(mark) + 3.5).toFixed(1)}" text-anchor="end">${label(mark)}</text>`);
  const columns = x.marks.map((mark) => `<text class="tick" x="${x.at(mark).toFixed(1)}" y="${bottom + 15}" text-anchor="middle">${label(mark)}</text>`);
  return `${rows.join('')}${columns.join('')}<path class="axis" d="M${LEFT} ${bottom}H${right}"/>` +
    `<text class="name" x="${(LEFT + right) / 2}" y="${HEIGHT - 4}" text-anchor="middle">${escape(xLabel)}</text>` +
    `<text class="name" transform="translate(11 ${(TOP + bottom) / 2}) rotate(-90)" text-anchor="middle">${escape(yLabel)}</text>`;
}

const svg = (title, inside) => `<svg viewBox="0 0 ${WIDTH} ${HEIGHT}" role="img" aria-label="${escape(title)}">${inside}</svg>`;

/**
 * @param {{name, points: [x, y][], className?}[]} series  y null makes a gap
 * @param {{title, xLabel, yLabel, log?, xLog?, yFrom?, yTo?}} how
 */
export function linePlot(series, how) {
  const all = series.flatMap(({ points }) => points).filter(([, y]) => y !== null);
  if (!all.length) return `<p class="none">${escape(how.title)}: nothing was measured</p>`;
  const x = axis(rangeOf(all.map(([value]) => value), how.xLog), [LEFT, WIDTH - RIGHT], how.xLog);
  const [low, high] = rangeOf(all.map(([, value]) => value), how.log);
  const y = axis([how.yFrom ?? (how.log ? low : Math.min(0, low)), how.yTo ?? high], [HEIGHT - BOTTOM, TOP], how.log);
  const lines = series.map(({ name, points, className }, i) => {
    let pen = 'M';
    const path = points.map(([px, py]) => {
      if (py === null) { pen = 'M'; return ''; }
      const step = `${pen}${x.at(px).toFixed(1)} ${y.at(py).toFixed(1)}`;
      pen = 'L';
      return step;
    }).join('');
    return `<path class="line ${className ?? `c${i % 8}`}" d="${path}"><title>${escape(name)}</title></path>`;
  });
  return svg(how.title, frame(x, y, how) + lines.join(''));
}

function rangeOf(values, log) {
  let low = Infinity, high = -Infinity;
  for (const value of values) { if (!log || value > 0) { low = Math.min(low, value); high = Math.max(high, value); } }
  if (!Number.isFinite(low)) return log ? [0.1, 1] : [0, 1];
  return log ? [low / 1.1, Math.max(high, low * 1.5) * 1.1] : [low, high === low ? low + 1 : high + (high - low) * 0.04];
}

/** Groups of bars beside each other. @param {{name, values: number[]}[]} groups  @param names of the bars of a group */
export function barPlot(groups, names, how) {
  const high = Math.max(1e-3, ...groups.flatMap(({ values }) => values.map((value) => value ?? 0)));
  const y = axis([0, high * 1.06], [HEIGHT - BOTTOM, TOP], false);
  const wide = (WIDTH - LEFT - RIGHT) / groups.length;
  const bar = (wide * 0.7) / names.length;
  const bars = groups.map(({ name, values }, g) => values.map((value, i) => {
    const top = y.at(value ?? 0);
    return `<rect class="f${i}" x="${(LEFT + wide * (g + 0.15) + bar * i).toFixed(1)}" y="${top.toFixed(1)}" width="${(bar - 1.5).toFixed(1)}" ` +
      `height="${(HEIGHT - BOTTOM - top).toFixed(1)}"><title>${escape(name)}, ${escape(names[i])}: ${value} ms</title></rect>`;
  }).join('') + `<text class="tick" x="${(LEFT + wide * (g + 0.5)).toFixed(1)}" y="${HEIGHT - BOTTOM + 15}" text-anchor="middle">${escape(name)}</text>`);
  return svg(how.title, frame({ at: () => 0, marks: [] }, y, { ...how, xLabel: '' }) + bars.join(''));
}
