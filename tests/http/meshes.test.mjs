// Meshes: listing, loading by path, upload, limits and memory shared with volumes, deleting.
import assert from 'node:assert/strict';
import { writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { ballNrrd, Daemon, problem, sleep, until } from '../support/daemon.mjs';
import { ballStl } from '../support/mesh.mjs';
import { readPng } from '../support/png.mjs';
import { validate } from '../support/schema.mjs';

let d;
before(async () => {
  d = await Daemon.start({ n: 32, config: '[limits]\nupload_bytes=400000\nvolume_bytes=150000\n' });
  writeFileSync(join(d.folder, 'ball.stl'), ballStl(10));
  writeFileSync(join(d.folder, 'bad.obj'), 'v 0 0 0\nf 1 2 3\n');
});
after(() => d.stop());

const upload = (id, body, kind = 'meshes') => d.call('PUT', `/v1/${kind}/${id}`, { body, type: 'application/octet-stream' });

const settled = (id, kind = 'meshes') => d.loaded(`/v1/${kind}/${id}`);

test('a mesh of the data folder is loaded, described, listed and deleted', async () => {
  const listed = (await d.get('/v1/meshes')).json;
  assert.deepEqual(listed.meshes, []);
  assert.deepEqual(listed.available.map(({ path }) => path), ['bad.obj', 'ball.stl']);
  const reply = await d.post('/v1/meshes', { id: 'ball', path: 'ball.stl' }); // a volume of this id is there already
  assert.deepEqual([reply.status, reply.headers.get('location')], [202, '/v1/meshes/ball']);
  const mesh = await settled('ball');
  assert.deepEqual([mesh.state, mesh.triangles, mesh.degenerate, mesh.vertices, mesh.closed, mesh.colors, mesh.format, mesh.sessions],
    ['resident', 360, 40, 182, true, false, 'stl', 0]); // at the poles two corners of a triangle are one
  assert.deepEqual([mesh.low[2], mesh.high[2], mesh.bytes], [41, 81, 182 * 24 + 360 * 12]);
  const [api, list] = [(await d.get('/v1/openapi.json')).json, (await d.get('/v1/meshes')).json];
  assert.deepEqual(list.meshes.map(({ id }) => id), ['ball']);
  assert.deepEqual(validate(list, api.components.schemas.MeshList, api), []);
  assert.equal((await d.get('/v1/volumes/ball')).json.format, 'nrrd');
  assert.equal((await d.get('/v1/volumes')).json.available.some(({ path }) => /stl|obj/.test(path)), false);
  problem(await d.post('/v1/meshes', { id: 'ball', path: 'ball.stl' }), 409, '/id');
  assert.equal(await d.metric('meshes_resident'), 1);
  assert.equal((await d.delete('/v1/meshes/ball')).status, 204);
  problem(await d.get('/v1/meshes/ball'), 404);
  assert.equal((await d.get('/v1/volumes/ball')).json.state, 'resident');
});

test('what is no mesh fails with one line that holds no path; requests that are wrong say what', async () => {
  await d.post('/v1/meshes', { id: 'bad', path: 'bad.obj' });
  const failed = await settled('bad');
  assert.deepEqual([failed.state, failed.reason], ['failed', 'open bad.obj: line 2: a face names a vertex that is not there']);
  assert.equal((await upload('bad', ballNrrd(8))).status, 202); // a failed one's id may be used again
  assert.equal((await settled('bad')).reason, 'open the upload: the file is NRRD, a volume: open it as a volume');
  assert.equal((await upload('stl', ballStl(4), 'volumes')).status, 202);
  assert.equal((await settled('stl', 'volumes')).reason, 'open the upload: the file is STL, a mesh: open it as a mesh');
  problem(await d.post('/v1/meshes', { id: 'x', path: '../x.stl' }), 404, '/path');
  problem(await d.post('/v1/meshes', { id: 'x', path: 'demo:head' }), 404, '/path');
  problem(await d.post('/v1/meshes', { id: '', path: 'ball.stl' }), 422, '/id');
  problem(await d.delete('/v1/meshes/none'), 404);
});

test('uploads are bounded as volumes are, in bytes of the file and of the mesh', async () => {
  problem(await upload('large', Buffer.alloc(500000)), 413);
  assert.equal((await upload('large', ballStl(44))).status, 202); // 387 kB of file
  assert.match((await settled('large')).reason, /limit/); // 93 kB of triangles, 91 of vertices with their normals
});

test('meshes and volumes share one budget: what nobody shows goes, the oldest first, whichever it is', async () => {
  const small = await Daemon.start({ n: 32, config: '[limits]\nvolume_bytes=150000\n' });
  const put = async (kind, id, body) => {
    assert.equal((await small.call('PUT', `/v1/${kind}/${id}`, { body, type: 'application/octet-stream' })).status, 202);
    for (;;) {
      const { json } = await small.get(`/v1/${kind}/${id}`);
      if (json.state !== 'loading') return json.state;
      await sleep(10);
    }
  };
  await small.post('/v1/sessions', { volume: 'ball' }); // 33 kB stay
  assert.equal(await put('meshes', 'a', ballStl(26)), 'resident'); // 65 kB
  assert.equal(await put('volumes', 'b', ballNrrd(40)), 'resident'); // 64 kB: a goes
  const a = (await small.get('/v1/meshes/a')).json;
  assert.deepEqual(a.state, 'failed');
  assert.match(a.reason, /dropped to make room/);
  assert.equal(await put('meshes', 'c', ballStl(26)), 'resident'); // b goes
  assert.equal((await small.get('/v1/volumes/b')).json.state, 'failed');
  assert.equal((await small.get('/v1/volumes/ball')).json.state, 'resident');
  await small.stop();
});

const pixels = (bytes) => {
  const { width, height, at } = readPng(bytes);
  return Array.from({ length: width * height }, (_, i) => at(i % width, Math.floor(i / width)));
};
const surfaces = (...list) => ({ mode: 'mesh', mesh: { surfaces: list }, image: { width: 64, height: 64, format: 'png', background: [0, 0, 0] } });

test('a session shows a mesh in its volume\'s space; what it shows is neither dropped nor deleted', async () => {
  await upload('shown', ballStl(10));
  assert.equal((await settled('shown')).state, 'resident');
  const session = (await d.post('/v1/sessions', { volume: 'ball' })).json;
  const patch = (scene) => d.call('PATCH', `/v1/sessions/${session.id}/scene`, { body: JSON.stringify(scene), type: 'application/merge-patch+json' });
  problem(await patch(surfaces({ mesh: 'nobody' })), 422, '/mesh/surfaces/0/mesh');
  assert.equal((await patch(surfaces({ mesh: 'shown', color: [1, 0, 0] }))).status, 200);
  const red = pixels((await d.get(`/v1/sessions/${session.id}/frame`)).bytes);
  const lit = red.filter(([r, g, b]) => r > 40 && r > 2 * g && r > 2 * b).length;
  assert.ok(lit > 64 * 64 * 0.03 && lit < 64 * 64 * 0.5, `${lit} red pixels`);
  assert.equal(red.filter(([r, g, b]) => r <= 40 && (g > 40 || b > 40)).length, 0);
  const once = await d.post('/v1/render', { volume: 'ball', format: 'png', scene: surfaces({ mesh: 'shown', color: [1, 0, 0] }) });
  assert.ok(pixels(once.bytes).filter(([r]) => r > 40).length > 0);
  assert.equal((await d.get('/v1/meshes/shown')).json.sessions, 1);
  problem(await d.delete('/v1/meshes/shown'), 409);
  assert.equal((await patch({ mesh: { surfaces: null } })).status, 200);
  assert.equal((await d.get('/v1/meshes/shown')).json.sessions, 0);
  await patch(surfaces({ mesh: 'shown' }));
  assert.equal((await d.get(`/v1/sessions/${session.id}/frame`)).status, 200);
  const caches = async () => Number((await d.get('/metrics')).bytes.toString().match(/memory_bytes\{kind="caches"\} (\d+)/)[1]);
  const shown = await caches();
  assert.equal((await d.delete('/v1/meshes/shown?force=true')).status, 204);
  await until(async () => (await caches()) <= shown - 5000); // the clusters of its 400 triangles go too
  problem(await d.get(`/v1/sessions/${session.id}`), 404); // it ended with its mesh
});

test('a pick says which surface of a list it met, through those too thin to see', async () => {
  await d.post('/v1/meshes', { id: 'inner', path: 'ball.stl' }); // 20 mm about the volume's ball's middle, which has 24.8
  await settled('inner');
  const scene = (opacity) => ({ mode: 'mesh', image: { width: 40, height: 40 }, mesh: {
    surfaces: [{ value: 5, visible: false }, { value: 100, opacity }, { mesh: 'inner' }, { plane: 'axial', visible: false }] } });
  const { links } = (await d.post('/v1/sessions', { volume: 'ball', scene: scene(0.3) })).json;
  const pick = async (x, y) => (await d.get(`${links.self}/pick?x=${x}&y=${y}`)).json;
  problem(await d.get(`${links.self}/pick?x=20&y=20`), 503); // nothing is extracted for it
  assert.equal((await d.get(links.frame)).status, 200);
  const outer = await pick(20, 20);
  assert.deepEqual([outer.surface, outer.value], [1, 100]);
  const out = ({ position: [x, y, z] }) => Math.hypot(x - 41, y - 51, z - 61);
  assert.ok(Math.abs(out(outer) - 24.8) < 2, JSON.stringify(outer));
  assert.deepEqual(await pick(0, 0), { position: null, value: null, depth: null });
  assert.equal((await d.patch(links.scene, scene(0.04))).status, 200);
  await d.get(links.frame);
  const inner = await pick(20, 20);
  assert.deepEqual([inner.surface, inner.value], [2, null]);
  assert.ok(Math.abs(out(inner) - 20) < 1 && inner.depth > outer.depth + 2, JSON.stringify(inner));
  // In the volume itself, whichever is nearer: the surface of 100 in 24.8 mm, or what dvr shows from 150 on, further in.
  const tf = { points: [{ value: 149, color: [1, 1, 1], opacity: 0 }, { value: 150, color: [1, 1, 1], opacity: 0.9 }] };
  const both = (surfaces) => ({ mode: 'dvr', transferFunction: tf, mesh: { withVolume: true, surfaces } });
  await d.patch(links.scene, both([{ value: 100 }]));
  await d.get(links.frame);
  const front = await pick(20, 20);
  assert.deepEqual([front.surface, Math.abs(front.depth - outer.depth) < 0.5], [0, true], JSON.stringify(front));
  await d.patch(links.scene, both([{ value: 250 }]));
  await d.get(links.frame);
  const behind = await pick(20, 20);
  assert.ok(behind.surface === undefined && behind.value >= 140 && behind.depth > front.depth, JSON.stringify(behind));
  await d.patch(links.scene, { mode: 'mesh', mesh: scene(0.04).mesh });
  await d.patch(links.scene, { clip: { box: [[0, 45, 0], [100, 100, 100]] } });
  await d.get(links.frame);
  assert.ok((await pick(20, 20)).position[1] > 45, 'what is cut off is not met');
  await d.delete(links.self);
});
