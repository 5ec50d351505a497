// The chart: points and lines over logarithmic axes, as inline SVG. Colours are the page's classes c0..c5.
'use strict';

const SVG = 'http://www.w3.org/2000/svg';

function element(namespace, name, attributes, children) {
  const made = namespace ? document.createElementNS(namespace, name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes ?? {})) made.setAttribute(key, value);
  made.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return made;
}
const html = (name, attributes, ...children) => element(null, name, attributes, children);
const svg = (name, attributes, ...children) => element(SVG, name, attributes, children);

// Significant digits without trailing zeros; '-' for missing values.
function digits(value, count = 3) {
  if (!Number.isFinite(value)) return '-';
  const rounded = Number(value.toPrecision(count));
  return rounded !== 0 && Math.abs(rounded) < 1e-3 ? rounded.toExponential() : String(rounded);
}

// 12 units of text stay legible at a phone's width.
const SIZES = {
  full: { width: 420, height: 290, left: 58, right: 408, top: 10, bottom: 246 },
  small: { width: 240, height: 142, left: 36, right: 236, top: 6, bottom: 110 },
};
const drawable = ({ x, y }) => x > 0 && y > 0 && Number.isFinite(x) && Number.isFinite(y);

// The range of log10(value), with margins at both ends, at least half a decade.
function range(values) {
  const logs = values.map(Math.log10);
  const lo = logs.reduce((a, b) => Math.min(a, b), Infinity);
  const hi = logs.reduce((a, b) => Math.max(a, b), -Infinity);
  const half = Math.max(((hi - lo) / 2) * 1.08, 0.25);
  return { lo: (lo + hi) / 2 - half, hi: (lo + hi) / 2 + half };
}

// Powers of two for octaves; else 1, 2 and 5 of each decade over few decades, whole decades over many.
function ticks({ lo, hi }, octaves) {
  const decades = hi - lo;
  const found = [];
  if (octaves && decades < 3) {
    for (let e = Math.ceil(lo / Math.log10(2)); e * Math.log10(2) <= hi; e++) found.push(2 ** e);
    return found;
  }
  const every = Math.ceil(decades / 8);
  for (let d = Math.floor(lo); d <= Math.ceil(hi); d++) {
    if (d % every) continue;
    for (const part of decades < 2.2 ? [1, 2, 5] : [1]) {
      const log = Math.log10(part) + d;
      if (log >= lo && log <= hi) found.push(part * 10 ** d);
    }
  }
  return found;
}

function tickText(value) {
  if (value >= 1e-2 && value < 1e5) return digits(value, 4);
  const exponent = Math.floor(Math.log10(value) + 1e-9);
  return `${Math.round(value / 10 ** exponent)}e${exponent}`;
}

const SHAPES = [
  (x, y, r) => `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0z`,
  (x, y, r) => `M${x - r} ${y - r}h${2 * r}v${2 * r}h${-2 * r}z`,
  (x, y, r) => `M${x} ${y - 1.2 * r}L${x + 1.1 * r} ${y + r}H${x - 1.1 * r}z`,
  (x, y, r) => `M${x} ${y - 1.3 * r}L${x + 1.3 * r} ${y}L${x} ${y + 1.3 * r}L${x - 1.3 * r} ${y}z`,
  (x, y, r) => `M${x - r} ${y - r}L${x + r} ${y + r}M${x - r} ${y + r}L${x + r} ${y - r}`,
];
const rounded = (path) => path.replace(/-?\d+\.\d+/g, (number) => Number(number).toFixed(1));

function marker(series, x, y, tip) {
  const { color = 0, hollow = false, small = false } = series;
  const radius = small ? 2.6 : hollow ? 5.2 : 3.6; // a ring around the dot of the other back end
  const shape = series.shape ?? color % SHAPES.length;
  const path = { class: `c${color}${hollow || shape === 4 ? ' hollow' : ''}`, d: rounded(SHAPES[shape](x, y, radius)) };
  return svg('path', path, tip ? svg('title', {}, tip) : null);
}

class Canvas {
  constructor(size, x, y) {
    Object.assign(this, size, { xRange: x, yRange: y });
  }
  x(value) {
    const { lo, hi } = this.xRange;
    return this.left + ((this.right - this.left) * (Math.log10(value) - lo)) / (hi - lo);
  }
  y(value) {
    const { lo, hi } = this.yRange;
    const part = Math.min(Math.max((Math.log10(value) - lo) / (hi - lo), 0), 1);
    return this.bottom - (this.bottom - this.top) * part;
  }
}

function axes(c, chart) {
  const columns = ticks(c.xRange, chart.octaves).map((value) => [
    svg('path', { class: 'grid', d: rounded(`M${c.x(value)} ${c.top}V${c.bottom}`) }),
    svg('text', { x: c.x(value).toFixed(1), y: c.bottom + 15, 'text-anchor': 'middle' }, tickText(value)),
  ]);
  const rows = ticks(c.yRange, false).map((value) => [
    svg('path', { class: 'grid', d: rounded(`M${c.left} ${c.y(value)}H${c.right}`) }),
    svg('text', { x: c.left - 5, y: (c.y(value) + 4).toFixed(1), 'text-anchor': 'end' }, tickText(value)),
  ]);
  const middle = (c.top + c.bottom) / 2;
  const turned = { transform: `translate(11 ${middle}) rotate(-90)`, 'text-anchor': 'middle' };
  return [
    ...columns.flat(),
    ...rows.flat(),
    svg('path', { class: 'frame', d: `M${c.left} ${c.top}V${c.bottom}H${c.right}` }),
    svg('text', { x: (c.left + c.right) / 2, y: c.height - 4, 'text-anchor': 'middle' }, chart.xLabel),
    chart.small ? null : svg('text', turned, chart.yLabel),
  ];
}

function guides(c, chart) {
  return (chart.guides ?? []).flatMap(({ value, name }) => {
    const log = Math.log10(value);
    if (log < c.yRange.lo || log > c.yRange.hi) return [];
    const y = c.y(value);
    const at = { class: 'halo', x: c.left + 4, y: (y < c.top + 14 ? y + 13 : y - 4).toFixed(1) };
    return [svg('path', { class: 'guide', d: rounded(`M${c.left} ${y}H${c.right}`) }), svg('text', at, name)];
  });
}

function stairs(c, front) {
  if (!front?.length) return null;
  const steps = front.map(({ x, y }, i) => (i === 0 ? `M${c.x(x)} ${c.top}V${c.y(y)}` : `H${c.x(x)}V${c.y(y)}`));
  return svg('path', { class: 'front', d: rounded(`${steps.join('')}H${c.right}`) });
}

function drawSeries(c, series) {
  const points = series.points.filter(drawable);
  const line = points.map(({ x, y }, i) => `${i ? 'L' : 'M'}${c.x(x)} ${c.y(y)}`).join('');
  const color = `c${series.color}`;
  return [
    series.line && points.length > 1
      ? svg('path', { class: `${color} path${series.dashed ? ' dashed' : ''}`, d: rounded(line) })
      : null,
    ...points.map(({ x, low, high }) =>
      low > 0 && high > low
        ? svg('path', { class: `${color} whisker`, d: rounded(`M${c.x(x)} ${c.y(low)}V${c.y(high)}`) })
        : null,
    ),
    ...points.map(({ x, y, tip }) => marker(series, c.x(x), c.y(y), tip)),
  ];
}

// The legend: a sample of each mark with its name.
function key(series) {
  const line = { class: `c${series.color} path${series.dashed ? ' dashed' : ''}`, d: 'M0 6H22' };
  const drawing = { class: 'key', viewBox: '0 0 22 12', 'aria-hidden': 'true' };
  return html(
    'span',
    {},
    svg('svg', drawing, series.line ? svg('path', line) : null, marker(series, 11, 6)),
    ` ${series.name} `,
  );
}

// chart: {title, xLabel, yLabel, octaves, small, guides: [{value, name}], front: [{x, y}] ascending in x, caption,
// xRange, yRange (from range(); by default that of the points), series: [{name, color, shape, line, dashed, hollow,
// small, points: [{x, y, low, high, tip}]}]}. Points without a logarithm are left out; null if none is left.
function drawChart(chart) {
  const points = chart.series.flatMap((series) => series.points.filter(drawable));
  if (points.length === 0) return null;
  const c = new Canvas(
    chart.small ? SIZES.small : SIZES.full,
    chart.xRange ?? range(points.map(({ x }) => x)),
    chart.yRange ?? range(points.map(({ y }) => y)),
  );
  return svg(
    'svg',
    { viewBox: `0 0 ${c.width} ${c.height}`, role: 'img', 'aria-label': chart.title },
    axes(c, chart),
    ...chart.series.filter((series) => series.small).map((series) => drawSeries(c, series)),
    stairs(c, chart.front),
    guides(c, chart),
    ...chart.series.filter((series) => !series.small).map((series) => drawSeries(c, series)),
  );
}

function figure(chart) {
  const drawing = drawChart(chart);
  if (!drawing) return null;
  const keys = chart.series.filter(({ points }) => points.some(drawable)).map(key);
  const caption = chart.caption ? [html('br'), chart.caption] : [];
  return html('figure', {}, html('h4', {}, chart.title), drawing, html('figcaption', {}, keys, caption));
}
