// The report on solid objects: splats, rays and triangles, and the error of simplified surfaces.
'use strict';

const WAYS = { splat: 'splats', isosurface: 'ray-cast isosurface', mesh: 'triangles' };
const ways = Object.keys(objects[0]?.ms ?? {});
const percent = (share) => `${digits(100 * share, 2)} %`;
const fastestOf = (times) => ways.reduce((best, way) => (times[way] < times[best] ? way : best));
const byFilled = [...objects].sort((a, b) => a.filled - b.filled);

// The share of the grid filled at which two ways are equally fast, interpolated log-linearly between measured objects:
// for the measured times, and for the plan's estimates.
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

// The surface of the middle object at decreasing numbers of triangles.
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
    series: series.map(([name, member, times = 1], i) => ({
      name,
      color: i,
      line: true,
      points: meshes.map((mesh) => ({
        x: mesh.triangles,
        y: times * mesh[member],
        tip: `${count(mesh.triangles)} triangles: ${digits(times * mesh[member])} ${yLabel}`,
      })),
    })),
  });
}

function surfaceTable() {
  const names = ['triangles', 'simplified to', 'time', 'outline wrong in', 'depth, median', '99 %', 'most'];
  const cells = (row) => [
    row.triangles ? count(row.triangles) : 'ray-cast isosurface',
    row.triangles ? `${digits(row.errorMm)} mm` : '-',
    `${digits(row.ms)} ms`,
    `${percent(row.outline)} of pixels`,
    ...[row.depthP50Mm, row.depthP99Mm, row.depthMaxMm].map((mm) => `${digits(mm, 2)} mm`),
  ];
  return stackedTable(
    names,
    subject.surface.map((row) => cells(row).map((cell) => [cell])),
  );
}

// For every size of picture, the smallest first: how many times as fast as rays triangles are, object by object.
function meshSpeeds() {
  const pictures = objects.flatMap((object) => [...(object.sizes ?? []), object]);
  const sizes = [...new Set(pictures.map(({ size }) => size))].sort((a, b) => a - b);
  return sizes.map((size) => {
    const ratios = pictures.filter((one) => one.size === size).map(({ ms }) => ms.isosurface / ms.mesh);
    return { size, n: ratios.length, wins: ratios.filter((ratio) => ratio > 1).length, ratios };
  });
}

const spread = (ratios) => `${digits(Math.min(...ratios), 2)} to ${digits(Math.max(...ratios), 2)} x`;

// After how many frames extracting the triangles has paid; null: never.
function paysAfter({ ms, buildMs }) {
  const saved = ms.isosurface - ms.mesh;
  return saved > 0 ? Math.ceil((buildMs.mesh - buildMs.isosurface) / saved) : null;
}

// The fewest triangles whose depths are, at 99 %, about as near to the exact ones as those of all of them.
function fewestAsGood() {
  const least = Math.max(1.5 * meshes[0].depthP99Mm, 0.01);
  return meshes.filter(({ depthP99Mm }) => depthP99Mm <= least).at(-1);
}

// When triangles are the better choice, and when rays.
function surfaceAdvice(speeds, frames) {
  const slow = speeds.findLastIndex(({ wins, n }) => 2 * wins < n); // there and in smaller pictures
  const from = speeds[slow + 1];
  if (!from || frames === null)
    return 'The ray-cast isosurface is the better choice here: exact, and triangles are not faster on most objects.';
  const pictures = slow < 0 ? '' : `, in pictures of ${from.size} pixels to a side or more`;
  return (
    `Triangles are the better choice from ${frames} frames of one surface on${pictures}, where they are faster on most objects ` +
    `(${spread(from.ratios)} at ${from.size}); the ray-cast isosurface is where the value changes sooner` +
    `${slow < 0 ? '' : ', pictures are smaller'} or depths have to be exact.`
  );
}

function surfaceConclusion() {
  const rays = subject.surface.at(-1);
  const [full] = meshes;
  const coarsest = meshes.at(-1);
  const fewest = fewestAsGood();
  const speeds = meshSpeeds();
  const frames = paysAfter(subject);
  const mm = (value) => `${digits(value, 2)} mm`;
  const each = speeds.map(({ size, n, wins, ratios }) => `${wins} of ${n} at ${size} pixels (${spread(ratios)})`);
  const paid = frames === null ? 'never paid for' : `paid for after ${frames} frames`;
  return [
    surfaceAdvice(speeds, frames),
    `Frames of triangles are the shorter on ${each.join(', ')}; extraction takes ${digits(subject.buildMs.mesh)} ms and is ${paid}.`,
    `Depth, 99 % of pixels: triangles within ${mm(full.depthP99Mm)} of the exact surface, rays within ${mm(rays.depthP99Mm)}; ` +
      `outline wrong in ${percent(full.outline)} and ${percent(rays.outline)} of pixels.`,
    `Of ${count(full.triangles)} triangles ${count(fewest.triangles)} (${percent(fewest.triangles / full.triangles)}) are about as ` +
      `near (${mm(fewest.depthP99Mm)}), in ${digits(fewest.ms)} ms a frame for ${digits(full.ms)}; the coarsest, ` +
      `${count(coarsest.triangles)}, are within ${mm(coarsest.depthP99Mm)}, in ${digits(coarsest.ms)} ms.`,
  ];
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
      `Of ${subject.title}: the surface as triangles, simplified ever further, against the exact trilinear isosurface (the ` +
        "reference's roots): the share of pixels that only one of the two covers, and how far depths are where both have a " +
        'surface.',
    ),
    html(
      'ul',
      {},
      surfaceConclusion().map((line) => html('li', {}, line)),
    ),
    html(
      'div',
      { class: 'charts' },
      surfaceFigure('Error over triangles', 'mm', 'Depth along the rays, where both have a surface.', [
        ['depth, median mm', 'depthP50Mm'],
        ['depth, 99 % mm', 'depthP99Mm'],
      ]),
      surfaceFigure('Outline over triangles', '% of pixels', 'Pixels that only one of the two covers.', [
        ['outline', 'outline', 100],
      ]),
      surfaceFigure(
        'Time over triangles',
        'ms a frame',
        `The ray-cast isosurface takes ${digits(subject.surface.at(-1).ms)} ms.`,
        [['mesh', 'ms']],
      ),
    ),
    surfaceTable(),
  );
}

// Rows of cells, each a list of children; on a narrow screen each cell stands below its column's name.
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

// By share filled and picture size: the faster of splats and rays, its factor, and where the plan names the other.
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

// The same object in ever larger grids: splats pay for what is seen, rays for the way there.
function gridsSection() {
  const grids = objects.find((object) => object.grids)?.grids;
  if (!grids) return null;
  const put = new Set(grids.map(({ samples }) => samples.splat));
  const names = ['grid', ...ways.map((way) => WAYS[way]), 'splats put down', 'samples of rays'];
  const rows = grids.map(({ grid, ms, samples }) => [
    [`${grid}\u00b3`],
    ...ways.map((way) => [`${digits(ms[way])} ms`]),
    ...['splat', 'isosurface'].map((way) => [count(samples[way])]),
  ]);
  return html(
    'section',
    { id: 'grids' },
    html('h3', {}, 'One object in ever larger grids'),
    html(
      'p',
      {},
      `The same view of the same voxels: ${put.size === 1 ? 'as many splats in each grid' : 'splats differ'}.`,
    ),
    stackedTable(names, rows),
  );
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
