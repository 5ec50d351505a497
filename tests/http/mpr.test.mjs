// Slices over HTTP and WebSocket: a session in mode mpr answers frames, its centre moves through the volume, and what
// cannot be a slice is refused by name.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Daemon, problem } from '../support/daemon.mjs';
import { readPng } from '../support/png.mjs';
import { Ws } from '../support/ws.mjs';

const N = 21; // voxels a side, 2 mm apart; voxel (0,0,0) at (10, 20, 30)
const MARK = [15, 4, 8]; // left of the middle, in front of it, below it
const lps = (index) => index.map((i, k) => [10, 20, 30][k] + 2 * i);

/** Dark but for one voxel. */
function markNrrd() {
  const head = 'NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\n' +
    `sizes: ${N} ${N} ${N}\nspace directions: (2,0,0) (0,2,0) (0,0,2)\nspace origin: (10,20,30)\nencoding: raw\n\n`;
  const voxels = Buffer.alloc(N ** 3);
  voxels[(MARK[2] * N + MARK[1]) * N + MARK[0]] = 200;
  return Buffer.concat([Buffer.from(head), voxels]);
}

let d;
before(async () => {
  d = await Daemon.start({ files: { 'mark.nrrd': markNrrd() } });
  assert.ok([201, 202].includes((await d.post('/v1/volumes', { id: 'mark', path: 'mark.nrrd' })).status));
  await d.resident('mark');
});
after(() => d.stop());

// One voxel a pixel: the field is N - 1 voxels wide.
const scene = (mpr = {}) => ({
  mode: 'mpr', filter: 'nearest', window: { center: 100, width: 200 }, image: { width: N, height: N, format: 'png' },
  mpr: { zoom: (N - 1) / N, ...mpr },
});

async function open(mpr) {
  const reply = await d.post('/v1/sessions', { volume: 'mark', scene: scene(mpr) });
  assert.equal(reply.status, 201, JSON.stringify(reply.json));
  return reply.json;
}

async function bright({ links }) {
  const reply = await d.get(`${links.frame}?format=png`);
  assert.equal(reply.status, 200, String(reply.bytes));
  const picture = readPng(reply.bytes), found = [];
  for (let y = 0; y < N; y++) for (let x = 0; x < N; x++) if (picture.at(x, y)[0] > 0) found.push([x, y]);
  return found;
}

test('a known voxel is on the known pixel: right on the left, front on top, head on top', async () => {
  const [x, y, z] = MARK, center = [lps([10, 10, 10])[0], lps([10, 10, 10])[1], lps(MARK)[2]];
  assert.deepEqual(await bright(await open({ center })), [[x, y]]);
  const coronal = { orientation: 'coronal', center: [center[0], lps(MARK)[1], lps([10, 10, 10])[2]] };
  assert.deepEqual(await bright(await open(coronal)), [[x, N - 1 - z]]);
  const sagittal = { orientation: 'sagittal', center: [lps(MARK)[0], ...lps([10, 10, 10]).slice(1)] };
  assert.deepEqual(await bright(await open(sagittal)), [[y, N - 1 - z]]);
  const oblique = { orientation: 'oblique', normal: [0, 0, 5], up: [0, -1, 0], center }; // from the head: mirrored
  assert.deepEqual(await bright(await open(oblique)), [[N - 1 - x, y]]);
});

test('the centre moves through the slices, and a slab sees through them', async () => {
  const session = await open(), seen = [];
  for (let z = 0; z < N; z++) {
    const reply = await d.patch(session.links.scene, { mpr: { center: lps([10, 10, z]) } });
    assert.equal(reply.status, 200, JSON.stringify(reply.json));
    if ((await bright(session)).length) seen.push(z);
  }
  assert.deepEqual(seen, [MARK[2]]);
  await d.patch(session.links.scene, { mpr: { center: null, thickness: 12, projection: 'mip' } });
  assert.deepEqual(await bright(session), [[MARK[0], MARK[1]]]);
  await d.patch(session.links.scene, { mpr: { projection: 'minip' } });
  assert.deepEqual(await bright(session), []);
});

test('a viewer gets frames of slices and of moves through them', async () => {
  const session = await open();
  const ws = await Ws.open(d, session.id);
  const dark = await ws.nextFrame(({ final, seq }) => final && seq === 0);
  ws.patch(1, { mpr: { center: lps([10, 10, MARK[2]]) } });
  const lit = await ws.nextFrame(({ final, seq }) => final && seq === 1);
  assert.deepEqual(readPng(dark.image).at(MARK[0], MARK[1])[0], 0);
  assert.deepEqual(readPng(lit.image).at(MARK[0], MARK[1])[0], 255);
  await ws.close();
});

test('the plan builds no table; what cannot be a slice is refused by name and the scene stays', async () => {
  const session = await open({ thickness: 4, projection: 'average' });
  const { json: plan } = await d.get(session.links.plan);
  assert.match(plan.kernel, /^mpr\.average\.nearest\.u8\./);
  const table = plan.stages.find(({ name }) => name === 'table-2d');
  assert.deepEqual([table.included, table.bytes], [false, 0]);
  assert.ok(table.reason);
  const before = await d.get(session.links.scene);
  for (const [patch, status, pointer] of [
    [{ mpr: { thickness: -1 } }, 422, '/mpr/thickness'],
    [{ mpr: { zoom: 0 } }, 422, '/mpr/zoom'],
    [{ mpr: { orientation: 'oblique', normal: [0, 0, 0] } }, 422, '/mpr/normal'],
    [{ mpr: { orientation: 'oblique', normal: [0, 1, 0], up: [0, 3, 0] } }, 422, '/mpr/up'],
    [{ window: { width: 0 } }, 422, '/window/width'],
  ]) problem(await d.patch(session.links.scene, patch), status, pointer);
  assert.deepEqual((await d.get(session.links.scene)).json, before.json);
  const ignored = { classification: 'post', shading: { model: 'gooch' } };
  assert.equal((await d.patch(session.links.scene, ignored)).status, 200);
});
