// The page of a report: what report.json says, for people. The JSON stands in the page; nothing is fetched.
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

// One ray a pixel is judged against pixel centres, more rays against the mean over the pixel's area.
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

// The members of a setting that are varied one at a time, what a row that differs there is called, and the column of
// the tables it is compared by.
const CHOICES = [
  {
    name: 'termination',
    title: 'Early ray termination',
    words:
      'A ray ends once less than this share of what lies behind it would be seen; usual: never. Errors are differences ' +
      "from the same setting that ends no ray; no pixel's may be above the threshold.",
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

// cell(scene, column) -> nodes. On a phone a table of kind "stack" is stacked cell by cell, a "grid" scrolls sideways.
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

// One choice varied, all scenes: a column a value.
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

// Rows in named series, in the order in which the names come.
function inSeries(rows, nameOf, styleOf, pointOf) {
  const all = new Map();
  for (const row of rows) {
    const name = nameOf(row);
    if (!all.has(name)) all.set(name, { name, ...styleOf(row), points: [] });
    all.get(name).points.push(pointOf(row));
  }
  return [...all.values()];
}

// Another filter is another field with another reference: those rows do not compete.
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

// Beside the same setting that ends no ray: how far a pixel is from it, and the share of its time.
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
    caption: 'Beside the same setting that ends no ray.',
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

// All scenes over the same axes, so that one can be compared with another.
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

// ---- objects ----

const WAYS = { splat: 'splats', isosurface: 'ray-cast isosurface', mesh: 'triangles' };
const ways = Object.keys(objects[0]?.ms ?? {});
const percent = (share) => `${digits(100 * share, 2)} %`;
const fastestOf = (times) => ways.reduce((best, way) => (times[way] < times[best] ? way : best));
const byFilled = [...objects].sort((a, b) => a.filled - b.filled);

// Where two ways change places as an object fills more of its grid: between two measured objects, on a straight line over
// logarithms; for the times that were measured, and for those that the plan expects.
function crossings(first, second, member) {
  const ratio = (object) => Math.log(object[member][first] / object[member][second]);
  return byFilled.slice(1).flatMap((right, i) => {
    const left = byFilled[i];
    const [a, b] = [ratio(left), ratio(right)];
    if (a < 0 === b < 0) return [];
    const at = left.filled * (right.filled / left.filled) ** (a / (a - b));
    return [`at ${percent(at)} (${WAYS[a < 0 ? first : second]} below)`];
  });
}

function lineBetween(first, second) {
  const wins = byFilled.filter(({ ms }) => ms[first] < ms[second]).length;
  const said = (member) => crossings(first, second, member).join(' and ') || 'nowhere here';
  return (
    `${WAYS[first]} against ${WAYS[second]}: faster on ${wins} of ${objects.length}; they change places ` +
    `${said('ms')}; by the plan ${said('expectedMs')}.`
  );
}

const waySeries = (member, pointOf, more) =>
  ways.map((way, i) => ({
    name: `${WAYS[way]}${more?.name ?? ''}`,
    color: i,
    ...more?.style,
    points: byFilled.map((object) => ({ x: 100 * object.filled, ...pointOf(object[member][way], object, way) })),
  }));

function objectTimes() {
  const point = (ms, { title }, way) => ({ y: ms, tip: `${title}, ${WAYS[way]}: ${digits(ms)} ms` });
  return figure({
    title: 'Time over how much of the grid is filled',
    xLabel: '% of voxels filled',
    yLabel: 'ms a frame',
    caption:
      'Rings: what the plan expects, by rates fitted to another machine; their ratio is what it names the cheaper by.',
    series: [
      ...waySeries('ms', point, { style: { line: true } }),
      ...waySeries('expectedMs', point, { name: ', plan', style: { hollow: true } }),
    ],
  });
}

function objectErrors() {
  return figure({
    title: 'Error against the reference',
    xLabel: '% of voxels filled',
    yLabel: 'rms error',
    guides: BOUNDS,
    caption:
      "Reference: the exact surface of the threshold. Splats show voxels, whose outline is the grid's; they differ most " +
      'where most outline is.',
    series: waySeries(
      'errors',
      ({ rms, rmsLow, rmsHigh }, { title }, way) => ({
        y: rms,
        low: rmsLow,
        high: rmsHigh,
        tip: `${title}, ${WAYS[way]}: rms ${digits(rms, 2)}`,
      }),
      { style: { line: true } },
    ),
  });
}

// The surface of the object in the middle, by ever fewer triangles.
const simplified = byFilled.filter(({ surface }) => surface);
const subject = simplified[simplified.length >> 1];
const meshes = subject?.surface.filter(({ triangles }) => triangles) ?? [];
const count = new Intl.NumberFormat('en').format;

function surfaceFigure(title, yLabel, caption, series) {
  return figure({
    title,
    xLabel: 'triangles kept',
    yLabel,
    caption,
    series: series.map(([name, member], i) => ({
      name,
      color: i,
      line: true,
      points: meshes.map((mesh) => ({
        x: mesh.triangles,
        y: mesh[member],
        tip: `${count(mesh.triangles)} triangles: ${digits(mesh[member])} ${yLabel}`,
      })),
    })),
  });
}

function surfaceTable() {
  const names = [
    'triangles',
    'simplified to',
    'time',
    'outline off by',
    'pixels missed',
    'depth, median',
    '99 %',
    'most',
  ];
  const cells = (row) => [
    row.triangles ? count(row.triangles) : 'ray-cast isosurface',
    row.triangles ? `${digits(row.errorMm)} mm` : '-',
    `${digits(row.ms)} ms`,
    `${digits(row.outlinePixels, 2)} pixels`,
    String(row.missed),
    ...[row.depthP50Mm, row.depthP99Mm, row.depthMaxMm].map((mm) => `${digits(mm, 2)} mm`),
  ];
  return stackedTable(
    names,
    subject.surface.map((row) => cells(row).map((cell) => [cell])),
  );
}

function surfaceSection() {
  if (!meshes.length) return null;
  return html(
    'section',
    { id: 'surface' },
    html('h2', {}, 'Surfaces: triangles, error and time'),
    html(
      'p',
      {},
      `${subject.title}, its surface as triangles, simplified ever further, against the exact trilinear isosurface (the ` +
        "reference's roots): how many pixels the outline is off on average, and how far depths are where both have a " +
        'surface.',
    ),
    html(
      'div',
      { class: 'charts' },
      surfaceFigure('Error over triangles', 'mm or pixels', 'Depth along the rays; an outline of 1 is a pixel off.', [
        ['depth, median mm', 'depthP50Mm'],
        ['depth, 99 % mm', 'depthP99Mm'],
        ['outline, pixels', 'outlinePixels'],
      ]),
      surfaceFigure('Time over triangles', 'ms a frame', 'A frame of the whole surface, cpu.', [['mesh', 'ms']]),
    ),
    surfaceTable(),
  );
}

// Rows of cells, each a list of children; on a narrow screen a cell stands under its column's name.
function stackedTable(names, rows, attributes) {
  const head = names.map((name) => html('th', {}, name));
  const row = (cells) =>
    html(
      'tr',
      {},
      cells.map((cell, i) => html('td', { 'data-label': names[i] }, cell.filter(Boolean))),
    );
  return html(
    'div',
    { class: 'wide' },
    html(
      'table',
      { class: 'stack', ...attributes },
      html('thead', {}, html('tr', {}, head)),
      html('tbody', {}, rows.map(row)),
    ),
  );
}

function objectTable() {
  const names = ['object', 'filled', ...ways.map((way) => WAYS[way]), 'fastest', 'by the plan'];
  const cells = ({ title, filled, ms, expectedMs, errors }) => [
    [title],
    [percent(filled)],
    ...ways.map((way) => [
      `${digits(ms[way])} ms`,
      html('small', {}, `rms ${digits(errors[way].rms, 2)}, \u0394E ${digits(errors[way].ciede2000, 2)}`),
    ]),
    [WAYS[fastestOf(ms)]],
    [WAYS[fastestOf(expectedMs)]],
  ];
  return stackedTable(names, byFilled.map(cells));
}

// Over how much is filled and the picture's size: the faster of splats and rays, by how much, and where the plan names the
// other.
function sizesTable() {
  const sized = byFilled.map((object) => [...(object.sizes ?? []), object].sort((a, b) => a.size - b.size));
  const cell = ({ ms, expectedMs }) => {
    const [fast, slow] = ms.splat < ms.isosurface ? ['splat', 'isosurface'] : ['isosurface', 'splat'];
    const text = `${WAYS[fast]}, ${digits(ms[slow] / ms[fast], 2)} x`;
    return [text, expectedMs[fast] < expectedMs[slow] ? null : html('small', {}, `plan: ${WAYS[slow]}`)];
  };
  const names = ['filled', ...sized[0].map(({ size }) => `${size} pixels`)];
  const rows = sized.map((sizes, i) => [[percent(byFilled[i].filled)], ...sizes.map(cell)]);
  return stackedTable(names, rows, { id: 'sizes' });
}

function objectsSection() {
  if (!objects.length) return null;
  const [first, ...others] = ways;
  return html(
    'section',
    { id: 'objects' },
    html('h2', {}, 'Objects: splats, rays or triangles'),
    html(
      'p',
      {},
      'The opaque object of a threshold, lit, drawn in each mode that can, cpu: voxels as splats, the isosurface by ray ' +
        'casting, its triangles. Rays pay for what is empty before them, splats and triangles for what is filled.',
    ),
    html(
      'ul',
      {},
      others.map((way) => html('li', {}, lineBetween(first, way))),
    ),
    html('div', { class: 'charts' }, objectTimes(), objectErrors()),
    objectTable(),
    html('h3', {}, 'Splats or rays: the faster, and how many times'),
    sizesTable(),
  );
}

const SWEPT_QUICK =
  'Swept: every classification at steps of 2 to 0.25 voxels on the cpu, preintegrated2 from 4, and pre-integrated on gl; ' +
  'at a step of 1, pre-integrated on the cpu, one other choice at a time; at 0.25, tables of 1024 entries a side. ' +
  'Without --quick much more is.';
const SWEPT =
  'Swept, on both back ends: every classification at steps of 4 to 0.125 voxels with 1 to 16 rays a pixel, all combined; ' +
  'and of the pre-integrated ones, at steps of 2, 1 and 0.5, one other choice at a time: order, filter, jitter, coherence ' +
  'of four rays, early ray termination, size and precision of the table; at 0.125, the largest table. Not combined: ' +
  'several of these.';

function foot() {
  return [
    html('h2', {}, 'How it was measured'),
    html(
      'p',
      {},
      'rms, 99.9th percentile and maximum are of premultiplied colour and opacity, 0 to 1, before the background and the ' +
        '8 bits of a picture; CIEDE2000 and SSIM of the picture as shown. Settings of one ray a pixel are compared with ' +
        "the ray through the pixel's centre, settings of more with the mean over the pixel's area (4 x 4 reference rays " +
        'for a random 16th of the pixels). Every batch of eight settings holds one anchor; times are scaled by it, so ' +
        'that a machine that slows down does not bend the front. report.json holds every figure, report.csv those of settings.',
    ),
    html('p', {}, about.quick ? SWEPT_QUICK : SWEPT),
    leftOut.length
      ? [
          html('h3', {}, 'Left out'),
          html(
            'ul',
            {},
            leftOut.map(({ why }) => html('li', {}, why)),
          ),
        ]
      : null,
  ];
}

document.body.append(
  ...[
    head(),
    overview(),
    html('h2', {}, 'Cheapest setting under a bound'),
    html(
      'p',
      {},
      'The fastest of all measured settings whose error against the reference stays under the bound; colours and opacity ' +
        'count from 0 to 1. \u0394E is the mean CIEDE2000 of the picture as shown.',
    ),
    html('h3', {}, 'Root mean square under the bound'),
    cheapestTable('rms'),
    html('h3', {}, 'Every compared pixel under the bound'),
    cheapestTable('max'),
    html('h2', {}, 'Observed orders of convergence'),
    html(
      'p',
      {},
      'Slope of the error over the step, finest three octaves above single precision, cpu back end. The expected order ' +
        'holds where field and transfer function are smooth along a ray; what each scene does to it stands with the scene.',
    ),
    orders(),
    html('h2', {}, 'What single choices cost'),
    html(
      'p',
      {},
      'Pre-integrated, step of one voxel, cpu; one choice away from the usual. Each cell: rms, largest error, and time as ' +
        "a multiple of the usual's.",
    ),
    CHOICES.map(choiceTable),
    objectsSection(),
    surfaceSection(),
    scenes.map(sceneSection),
    foot(),
  ]
    .flat(3)
    .filter(Boolean),
);
