// The report on scenes and their settings. The data is embedded in the page; nothing is fetched.
'use strict';

const report = JSON.parse(document.getElementById('data').textContent);
const { about, scenes, objects, results, leftOut } = report;
const BOUNDS = [
  { value: 1 / 255, name: '1/255' },
  { value: 1e-3, name: '1/1000' },
  { value: 1e-4, name: '1e-4' },
];
const CLASSIFICATIONS = ['preintegrated', 'preintegrated2', 'approximate', 'post', 'linearized'].filter((name) =>
  results.some(({ classification }) => classification === name),
);
const byKey = new Map(results.map((row) => [`${row.scene}\n${row.key}`, row]));
const rowOf = (scene, key) => byKey.get(`${scene.name}\n${key}`);
const rowsOf = (scene) => results.filter((row) => row.scene === scene.name);

// Rows with one ray per pixel are compared with pixel centres, others with the mean over the pixel's area.
const judged = (row, measure) =>
  row[row.raysPerPixel > 1 ? `area${measure[0].toUpperCase()}${measure.slice(1)}` : measure];
const errorOf = (row) => judged(row, 'rms');

function titleOf(row) {
  const parts = [row.classification, `step ${digits(row.step, 6)}`];
  if (row.filter !== 'linear') parts.push(row.filter);
  if (row.raysPerPixel > 1) parts.push(`${row.raysPerPixel} rays${row.coherence ? ' coherent' : ''}`);
  if (row.jitter) parts.push('jitter');
  if (row.termination > 0) parts.push(`early termination at ${digits(row.termination)}`);
  if (row.tableSize) parts.push(`table of ${row.tableSize}`);
  if (row.tableBits) parts.push(`${row.tableBits}-bit table`);
  if (row.order !== 'front-to-back') parts.push(row.order);
  return [...parts, row.backend].join(', ');
}

// The members that are varied one at a time, with the name of a row that differs in one, and the column of its table.
const CHOICES = [
  {
    name: 'termination',
    title: 'Early ray termination',
    words:
      'A ray ends once less than this share of what lies behind it would be seen; usual: never. Errors are differences ' +
      "from the same setting without early ray termination; no pixel's may be above the threshold.",
    differs: (row) => row.termination > 0,
    label: (row) => digits(row.termination, 2),
    measures: ['endedRms', 'endedMax'],
  },
  {
    name: 'table',
    title: 'Size and precision of the table',
    words:
      'Entries a side of the pre-integration table, and entries rounded to half floats and to 8 bits; usual: the size ' +
      'the plan chooses, single precision.',
    differs: (row) => row.tableSize > 0 || row.tableBits > 0,
    label: (row) => (row.tableBits ? (row.tableBits === 8 ? '8 bit' : 'half') : String(row.tableSize)),
  },
  {
    name: 'rays',
    title: 'Rays per pixel',
    words:
      "Against the mean over the pixel's area, which more rays approach; edges weigh most. The compared picture has " +
      'fewer, larger pixels than the timed one: the more there is to gain.',
    differs: (row) => row.raysPerPixel > 1 || row.coherence,
    label: (row) => `${row.raysPerPixel} rays${row.coherence ? ', coherent' : ''}`,
    measures: ['areaRms', 'areaMax'],
  },
  {
    name: 'filter',
    title: 'Filter',
    words: 'Each against the reference of its own field: the error of the method, not the choice of the field.',
    differs: (row) => row.filter !== 'linear',
    label: (row) => row.filter,
  },
  {
    name: 'order',
    title: 'Order of compositing',
    words: 'No early ray termination: both orders must agree.',
    differs: (row) => row.order !== 'front-to-back',
    label: (row) => row.order,
  },
  {
    name: 'jitter',
    title: 'Jitter',
    words: 'Rays start a random fraction of a step apart: rings become noise of the same size.',
    differs: (row) => row.jitter,
    label: () => 'jitter',
  },
];
const choicesOf = (row) => CHOICES.filter(({ differs }) => differs(row));
const plain = (row) => choicesOf(row).length === 0;
const variedIn = (row, name) => {
  const [choice, second] = choicesOf(row);
  return choice?.name === name && !second;
};

// ---- tables ----

const sceneHead = (scene) =>
  html('th', { scope: 'row' }, html('a', { href: `#scene-${scenes.indexOf(scene) + 1}` }, scene.title));

// cell(scene, column) -> nodes. On a phone a "stack" table is stacked cell by cell, a "grid" table scrolls sideways.
function table(kind, columns, cell) {
  const head = html(
    'tr',
    {},
    ['scene', ...columns.map(({ name }) => name)].map((name) => html('th', {}, name)),
  );
  const rows = scenes.map((scene) =>
    html(
      'tr',
      {},
      sceneHead(scene),
      columns.map((column) => html('td', { 'data-label': column.name }, cell(scene, column))),
    ),
  );
  return html(
    'div',
    { class: 'wide' },
    html('table', { class: kind }, html('thead', {}, head), html('tbody', {}, rows)),
  );
}

function cheapestTable(measure) {
  return table('stack', BOUNDS, (scene, { name }) => {
    const { key: best } = scene.summary.cheapest.find((entry) => entry.measure === measure && entry.bound === name);
    if (best === null) return ['none'];
    const row = rowOf(scene, best);
    const errors =
      `rms ${digits(errorOf(row), 2)}, 99.9 % under ${digits(judged(row, 'p999'), 2)}, ` +
      `max ${digits(judged(row, 'max'), 2)}, \u0394E ${digits(row.ciede2000, 2)}, SSIM ${digits(row.ssim, 4)}`;
    return [html('b', {}, `${digits(row.timeMs)} ms`), ` ${titleOf(row)}`, html('small', {}, errors)];
  });
}

function orders() {
  const expected = (name) =>
    scenes.flatMap(({ summary }) => summary.orders).find(({ classification }) => classification === name)?.expected ??
    '';
  const columns = CLASSIFICATIONS.map((name) => ({
    name: `${name}, expected ${expected(name)}`,
    classification: name,
  }));
  return table('stack', columns, (scene, { classification }) => {
    const found = scene.summary.orders.find(
      (entry) => entry.backend === 'cpu' && entry.classification === classification,
    );
    if (!found || found.observed === null) return ['-'];
    const text = found.observed.toFixed(2);
    return scene.smooth && found.observed < found.expected - 0.15
      ? [html('b', { class: 'worse' }, `${text} short`)]
      : [text];
  });
}

// Varies one member over all scenes, with a column per value.
function choiceTable(choice) {
  const base = (row) => row.backend === 'cpu' && row.classification === CLASSIFICATIONS[0] && row.step === 1;
  const varied = results.filter((row) => base(row) && variedIn(row, choice.name));
  const columns = ['usual', ...new Set(varied.map(choice.label))].map((name) => ({ name }));
  if (columns.length < 2) return [];
  const [rms, max] = choice.measures ?? ['rms', 'max'];
  const cells = table('grid', columns, (scene, { name }) => {
    const usual = rowsOf(scene).find((row) => base(row) && plain(row));
    const row =
      name === 'usual' ? usual : varied.find((each) => each.scene === scene.name && choice.label(each) === name);
    if (!row || !usual) return ['-'];
    const time = digits(row.timeMs / usual.timeMs, 2);
    return [digits(row[rms], 2), html('small', {}, `max ${digits(row[max], 2)}`), html('small', {}, `time ${time}`)];
  });
  return [html('h3', {}, choice.title), html('p', {}, choice.words), cells];
}

// ---- charts ----

const colorOf = ({ classification }) => CLASSIFICATIONS.indexOf(classification);

// Groups rows into named series, in order of first appearance.
function inSeries(rows, nameOf, styleOf, pointOf) {
  const all = new Map();
  for (const row of rows) {
    const name = nameOf(row);
    if (!all.has(name)) all.set(name, { name, ...styleOf(row), points: [] });
    all.get(name).points.push(pointOf(row));
  }
  return [...all.values()];
}

// Other filters have other references, so their rows do not compete.
const competing = (scene) => rowsOf(scene).filter(({ filter }) => filter === 'linear');
const frontOf = (scene) =>
  scene.summary.front
    .map((each) => rowOf(scene, each))
    .map((row) => ({ x: row.timeMs, y: Math.max(errorOf(row), 1e-9) }));
const timePoint = (row) => ({
  x: row.timeMs,
  y: errorOf(row),
  tip: `${titleOf(row)}: ${digits(row.timeMs)} ms, rms ${digits(errorOf(row), 2)}`,
});
const timeStyle = (row) => ({ color: colorOf(row), hollow: row.backend === 'gl', small: !plain(row) });

function cloud(scene) {
  return figure({
    title: 'Error against run time',
    xLabel: 'ms a frame',
    yLabel: 'rms error',
    guides: BOUNDS,
    caption: 'Stairs: the Pareto front. Varied: one choice away from the usual.',
    front: frontOf(scene),
    series: inSeries(
      competing(scene),
      (row) => `${row.classification}, ${row.backend}${plain(row) ? '' : ', varied'}`,
      timeStyle,
      timePoint,
    ),
  });
}

function convergence(scene) {
  const orderOf = (row) =>
    scene.summary.orders.find((entry) => entry.backend === row.backend && entry.classification === row.classification);
  const nameOf = (row) => {
    const { observed, expected } = orderOf(row);
    return `${row.classification}, ${row.backend}: ${observed === null ? '-' : observed.toFixed(2)} (${expected})`;
  };
  const gl = (row) => row.backend === 'gl';
  return figure({
    title: 'Convergence',
    xLabel: 'step, voxels',
    yLabel: 'rms error',
    octaves: true,
    caption: 'Slope: observed (expected).',
    series: inSeries(
      rowsOf(scene).filter(plain),
      nameOf,
      (row) => ({ color: colorOf(row), line: true, hollow: gl(row), dashed: gl(row) }),
      (row) => ({
        x: row.step,
        y: row.rms,
        low: row.rmsLow,
        high: row.rmsHigh,
        tip: `${row.classification}, ${row.backend}, step ${row.step}: rms ${digits(row.rms)}`,
      }),
    ),
  });
}

const stepColor = (step) => (step === 1 ? 0 : step < 1 ? 2 : 1);
const variedRows = (scene, name) =>
  rowsOf(scene).filter(
    (row) => row.backend === 'cpu' && row.classification === CLASSIFICATIONS[0] && variedIn(row, name),
  );

// Compared with the same setting without early ray termination: the largest difference and the share of its time.
function terminationChart(scene) {
  const rows = variedRows(scene, 'termination');
  const whole = (row) =>
    rowsOf(scene).find(
      (other) =>
        plain(other) &&
        other.backend === row.backend &&
        other.classification === row.classification &&
        other.step === row.step,
    );
  const share = (row) => row.timeMs / (whole(row)?.timeMs ?? NaN);
  const series = (name, extra, y) =>
    inSeries(
      rows,
      (row) => `${name}, step ${row.step}`,
      (row) => ({ color: stepColor(row.step), line: true, ...extra }),
      (row) => ({
        x: row.termination,
        y: y(row),
        tip:
          `step ${row.step}, threshold ${digits(row.termination, 2)}: ${digits(row.endedMax, 2)} at most, ` +
          `rms ${digits(row.endedRms, 2)}, time ${digits(share(row), 2)}`,
      }),
    );
  return figure({
    title: 'Early ray termination: cost and gain',
    xLabel: 'threshold of transparency',
    yLabel: 'largest difference; share of time',
    caption: 'Beside the same setting without early ray termination.',
    series: [
      ...series('difference', {}, (row) => row.endedMax),
      ...series('time', { dashed: true, hollow: true }, share),
    ],
  });
}

function tableChart(scene) {
  const nameOf = ({ tableBits, step }) =>
    tableBits ? `${tableBits === 8 ? '8 bit' : 'half floats'}, step ${step}` : `step ${step}`;
  return figure({
    title: 'Table: size and precision',
    xLabel: 'entries a side',
    yLabel: 'rms error',
    octaves: true,
    series: inSeries(
      variedRows(scene, 'table'),
      nameOf,
      ({ tableBits, step }) => ({
        color: tableBits === 8 ? 4 : tableBits === 16 ? 3 : stepColor(step),
        line: !tableBits,
      }),
      (row) => ({
        x: row.tableNodes,
        y: row.rms,
        tip: `${nameOf(row)}: rms ${digits(row.rms)}, max ${digits(row.max)}, ${digits(row.timeMs)} ms`,
      }),
    ),
  });
}

// ---- sections ----

// All scenes over the same axes, for comparison.
function overview() {
  const points = scenes.flatMap(competing).map(timePoint).filter(drawable);
  if (points.length === 0) return null;
  const axes = { xRange: range(points.map(({ x }) => x)), yRange: range(points.map(({ y }) => Math.max(y, 1e-7))) };
  const styles = inSeries(
    scenes.flatMap(competing),
    (row) => `${row.classification}, ${row.backend}`,
    (row) => ({ ...timeStyle(row), small: false }),
    timePoint,
  );
  const cards = scenes.map((scene, i) =>
    html(
      'figure',
      {},
      html('h4', {}, html('a', { href: `#scene-${i + 1}` }, scene.title)),
      drawChart({
        ...axes,
        title: `${scene.title}: error against run time`,
        xLabel: 'ms',
        small: true,
        guides: BOUNDS.slice(0, 1),
        front: frontOf(scene),
        series: inSeries(
          competing(scene),
          ({ classification, backend }) => `${classification}, ${backend}`,
          (row) => ({ ...timeStyle(row), hollow: false, small: true }),
          timePoint,
        ),
      }),
      html('figcaption', {}, scene.conclusion),
    ),
  );
  return html(
    'section',
    { id: 'overview' },
    html('p', { class: 'soft keys' }, 'Up: rms error; right: ms a frame. Stairs: the Pareto front. ', styles.map(key)),
    html('div', { class: 'cards' }, cards),
  );
}

function head() {
  const { machine } = about;
  const facts =
    `Tomocast ${about.version}. cpu: ${machine.cpu}, ${machine.isa}, ${machine.threads} threads. ` +
    `gl: ${machine.gl ?? 'none'}. ${results.length} settings; timed at ${about.size} x ${about.size} pixels` +
    `${about.quick ? ', quick selection' : ''}.`;
  return html(
    'header',
    {},
    html('h1', {}, 'Error against run time'),
    html(
      'p',
      {},
      'How far each way of rendering is from the exact rendering integral, and what it costs. Pictures are compared with ' +
        'a double-precision reference that takes no steps; times are medians of frames taken in turn, in the same run.',
    ),
    html(
      'p',
      { class: 'soft' },
      facts,
      about.complete ? null : html('b', {}, ' Interrupted: not all settings were measured.'),
    ),
  );
}

function sceneSection(scene, i) {
  const { dims, type } = scene.volume;
  const facts =
    `${scene.name}, ${dims.join(' x ')} ${type} voxels. Compared: ${scene.side} x ${scene.side} pixels ` +
    `(n = ${scene.side ** 2} rays), whiskers: 95 % interval of the rms.`;
  const losses = scene.loss.split('\n').filter(Boolean);
  const why = [
    html('h3', {}, 'Orders short of the expected, and why'),
    html(
      'ul',
      {},
      losses.map((line) => html('li', {}, line)),
    ),
  ];
  return html(
    'section',
    { class: 'scene', id: `scene-${i + 1}` },
    html('h2', {}, scene.title),
    html('p', {}, scene.why),
    html('p', { class: 'soft' }, facts),
    html('div', { class: 'charts' }, cloud(scene), convergence(scene), terminationChart(scene), tableChart(scene)),
    losses.length ? why : null,
  );
}
