// Labels over HTTP: a second volume tints and hides, is held while it is used, and is refused by name where it cannot be.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Daemon, problem } from '../support/daemon.mjs';
import { readPng } from '../support/png.mjs';
import { Ws } from '../support/ws.mjs';

const N = 16;

function nrrd(type, voxel, origin = 0, n = N) {
  const head = `NRRD0004\ntype: ${type}\ndimension: 3\nspace: left-posterior-superior\nsizes: ${n} ${n} ${n}\n` +
    `space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,${origin})\nendian: little\nencoding: raw\n\n`;
  const size = type === 'float' ? 4 : 1, voxels = Buffer.alloc(n ** 3 * size);
  for (let i = 0; i < n ** 3; i++) {
    const x = i % n;
    if (type === 'float') voxels.writeFloatLE(x / 7, 4 * i);
    else voxels[i] = voxel(x, i);
  }
  return Buffer.concat([Buffer.from(head), voxels]);
}

const noise = (x, i) => (i * 7919) % 251; // a scan: many values, no two neighbours alike
const parts = (x) => (x < N / 2 ? 1 : 2);
const files = { 'grey.nrrd': nrrd('uint8', (x) => 100 + x), 'parts.nrrd': nrrd('uint8', parts),
  'floats.nrrd': nrrd('float'), 'far.nrrd': nrrd('uint8', parts, 900),
  'scan.nrrd': nrrd('uint8', noise), 'shifted.nrrd': nrrd('uint8', parts, 3.5), 'cropped.nrrd': nrrd('uint8', parts, 4),
  'grains.nrrd': nrrd('uint8', noise, 0, 80) };

// Two layers of segments that overlap from x = 4 to x = 7, as 3D Slicer writes them.
function layered() {
  const head = `NRRD0004\ntype: unsigned char\ndimension: 4\nspace: left-posterior-superior\nsizes: 2 ${N} ${N} ${N}\n` +
    'kinds: list domain domain domain\nspace directions: none (1,0,0) (0,1,0) (0,0,1)\nencoding: raw\n' +
    'Segment0_Name:=liver\nSegment0_Color:=1 0 0\nSegment0_LabelValue:=1\nSegment0_Layer:=0\n' +
    'Segment1_Name:=L\u00e4sion\nSegment1_Color:=0 1 0\nSegment1_LabelValue:=1\nSegment1_Layer:=1\n\n';
  const voxels = Buffer.alloc(2 * N ** 3);
  for (let i = 0; i < N ** 3; i++) {
    voxels[2 * i] = i % N < 8;
    voxels[2 * i + 1] = i % N >= 4 && i % N < 12;
  }
  return Buffer.concat([Buffer.from(head), voxels]);
}
files['layers.nrrd'] = layered();

let d;
before(async () => {
  d = await Daemon.start({ files });
  for (const name of Object.keys(files)) await bring(name.split('.')[0]);
});
after(() => d.stop());

async function bring(id) {
  assert.ok([201, 202].includes((await d.post('/v1/volumes', { id, path: `${id}.nrrd` })).status));
  await d.resident(id);
}

const scene = (labels) => ({
  mode: 'mpr', window: { center: 100, width: 200 }, image: { width: N, height: N, format: 'png' },
  labels: { volume: 'parts', opacity: 1, colors: { 1: [1, 0, 0, 1], 2: [0, 0, 1, 0.5] }, ...labels },
});

async function open(labels) {
  const reply = await d.post('/v1/sessions', { volume: 'grey', scene: scene(labels) });
  assert.equal(reply.status, 201, JSON.stringify(reply.json));
  return reply.json;
}

async function pixels({ links }) {
  const reply = await d.get(`${links.frame}?format=png`);
  assert.equal(reply.status, 200, String(reply.bytes));
  const picture = readPng(reply.bytes);
  return [picture.at(1, N / 2), picture.at(N - 2, N / 2)].map((rgb) => [...rgb].slice(0, 3));
}

test('labels tint a slice, one by one', async () => {
  const session = await open();
  const [[r, g], [r2, , b2]] = await pixels(session);
  assert.ok(r === 255 && g === 0, `label 1 is red: ${r} ${g}`);
  assert.ok(b2 > r2 + 80, `label 2 is bluish: ${r2} ${b2}`);
  assert.equal((await d.patch(session.links.scene, { labels: { visible: [2] } })).status, 200);
  const [[hr, hg, hb]] = await pixels(session);
  assert.ok(hr === hg && hg === hb && hr > 100, 'a label that is not visible has no tint; the slice stays');
  const { json } = await d.get(session.links.plan);
  const stage = json.stages.find(({ name }) => name === 'labels');
  assert.ok(stage.included && stage.bytes > 0, JSON.stringify(stage));
  assert.match(stage.reason, /parts: 1 show/);
  await d.patch(session.links.scene, { mode: 'mip' });
  const other = (await d.get(session.links.plan)).json.stages.find(({ name }) => name === 'labels');
  assert.ok(!other.included && /mode mip/.test(other.reason));
  await d.delete(session.links.self);
});

test('a segmentation says what its labels are, and colours them', async () => {
  const { json } = await d.get('/v1/volumes/layers');
  assert.deepEqual(json.labels, [{ label: 1, name: 'liver', color: [1, 0, 0] }, { label: 2, name: 'L\u00e4sion', color: [0, 1, 0] },
    { label: 3, of: [1, 2] }]);
  assert.equal((await d.get('/v1/volumes')).json.volumes.find(({ id }) => id === 'layers').labels, undefined);
  const session = await open({ volume: 'layers', colors: undefined });
  const frame = readPng((await d.get(`${session.links.frame}?format=png`)).bytes);
  const at = (x) => [...frame.at(x, N / 2)].slice(0, 3);
  assert.deepEqual([at(1), at(10)], [[255, 0, 0], [0, 255, 0]]);
  await d.delete(session.links.self);
});

test('labels hide in a rendering', async () => {
  const body = { volume: 'grey', format: 'png', scene: { ...scene({ visible: [] }), mode: 'dvr' } };
  const dark = readPng((await d.post('/v1/render', body)).bytes), shown = { ...body, scene: { ...body.scene, labels: {} } };
  const bright = readPng((await d.post('/v1/render', shown)).bytes);
  assert.deepEqual([...dark.at(N / 2, N / 2)].slice(0, 3), [0, 0, 0]);
  assert.ok(Math.max(...[...bright.at(N / 2, N / 2)].slice(0, 3)) > 0);
});

test('a pick looks through what is hidden', async () => {
  const session = await open();
  const fog = { points: [{ value: 100, color: [1, 1, 1], opacity: 0.5 }] };
  const camera = { position: [-100, 7, 7], target: [7, 7, 7], up: [0, 0, 1] };
  assert.equal((await d.patch(session.links.scene, { mode: 'dvr', transferFunction: fog, camera })).status, 200);
  const pick = async () => (await d.get(`${session.links.self}/pick?x=${N / 2}&y=${N / 2}`)).json.position[0];
  const whole = await pick();
  await d.patch(session.links.scene, { labels: { visible: [2] } });
  const half = await pick();
  assert.ok(whole < 1 && half >= N / 2 - 1 && half <= N / 2, `${whole} ${half}`);
  await d.delete(session.links.self);
});

test('what is no label volume is refused by name', async () => {
  for (const volume of ['floats', 'far', 'nobody'])
    problem(await d.post('/v1/sessions', { volume: 'grey', scene: scene({ volume }) }), 422, '/scene/labels/volume');
  const session = await open();
  problem(await d.patch(session.links.scene, { labels: { volume: 'floats' } }), 422, '/labels/volume');
  assert.equal((await d.get(session.links.scene)).json.labels.volume, 'parts', 'the old scene stays');
  await d.delete(session.links.self);
});

test('what does not look like labels of this volume is refused with the reason, unless one insists', async () => {
  for (const [volume, why] of [['scan', /values/], ['shifted', /not on the volume's grid/]]) {
    const { detail } = problem(await d.post('/v1/sessions', { volume: 'grey', scene: scene({ volume }) }), 409, '/scene/labels/volume');
    assert.match(detail, why);
    assert.match(detail, /labels\.force/);
    const session = await open();
    problem(await d.patch(session.links.scene, { labels: { volume } }), 409, '/labels/volume');
    const insisted = await d.patch(session.links.scene, { labels: { volume, force: true } });
    assert.equal(insisted.status, 200);
    assert.equal(insisted.json.labels.volume, volume);
    assert.equal((await d.patch(session.links.scene, { labels: { opacity: 0.5 } })).status, 200);
    await d.delete(session.links.self);
  }
  const part = await open({ volume: 'cropped' }); // of the same grid
  await d.delete(part.links.self);
});

test('a label volume in use is held like any other', async () => {
  const session = await open();
  problem(await d.delete('/v1/volumes/parts'), 409);
  await d.patch(session.links.scene, { labels: { volume: null } });
  assert.equal((await d.delete('/v1/volumes/parts')).status, 204);
  await bring('parts');
  await d.patch(session.links.scene, { labels: { volume: 'parts' } });
  assert.equal((await d.get('/v1/volumes/parts')).json.sessions, 1);
  assert.equal((await d.delete('/v1/volumes/parts?force=true')).status, 204);
  problem(await d.get(session.links.self), 404);
  await bring('parts');
  const other = await open();
  await d.delete(other.links.self);
  assert.equal((await d.get('/v1/volumes/parts')).json.sessions, 0);
});

test('the daemon offers labels, and colours for those without', async () => {
  assert.ok(!Object.keys((await d.get('/v1/about')).json.unavailable).some((name) => name.startsWith('labels')));
  const { labelColors } = (await d.get('/v1/presets')).json;
  assert.equal(new Set(labelColors.map(String)).size, labelColors.length);
});

test('a pick of the surfaces of labels says which label', async () => {
  const { links } = await open({});
  await d.patch(links.scene, { mode: 'mesh' });
  await d.get(links.frame);
  const label = async (x) => (await d.get(`${links.self}/pick?x=${x}&y=${N / 2}`)).json;
  const [left, right] = [await label(N / 2 - 3), await label(N / 2 + 2)];
  assert.deepEqual([left.label, right.label].sort(), [1, 2], JSON.stringify([left, right]));
  assert.ok(Math.abs(left.position[0] - right.position[0]) > 2 && left.surface === undefined);
  await d.delete(links.self);
});

/* 250 surfaces, each through all of the volume: seconds on any machine. */
test('surfaces that take long are told of, and given up: the picture stays until the next change', async () => {
  const reply = await d.post('/v1/sessions', { volume: 'grains', scene: { mode: 'mip', image: { width: 32, height: 32 } } });
  const session = reply.json, viewer = await Ws.open(d, session.id);
  await viewer.next((m) => m.header?.final);
  viewer.send({ type: 'cancel' }); // of nothing
  viewer.patch(1, { mode: 'mesh', labels: { volume: 'grains', force: true } });
  const first = await viewer.next((m) => m.type === 'building');
  assert.equal(first.stage, 'mesh');
  const later = await viewer.next((m) => m.type === 'building' && m.share > first.share);
  assert.ok(first.share >= 0 && later.share <= 1, JSON.stringify([first, later]));
  assert.equal((await d.get(session.links.self)).json.building.stage, 'mesh');
  viewer.send({ type: 'cancel' });
  viewer.send({ type: 'ping', t: 1 });
  await viewer.next((m) => m.type === 'pong');
  assert.equal((await d.get(session.links.self)).json.building, undefined);
  assert.ok(!viewer.frames().some(({ header }) => header.seq === 1), 'no picture of what was given up');
  viewer.patch(2, { mode: 'mip' });
  await viewer.next((m) => m.header?.final && m.header.seq === 2);
  assert.ok(!viewer.messages.some((m) => m.type === 'error'));
  await viewer.close();
  await d.delete(session.links.self);
});
