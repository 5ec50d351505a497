// Sessions and their scenes: life, ETags, merge patches, refusals.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Daemon, imageSize, problem, until } from '../support/daemon.mjs';

let d;
before(async () => { d = await Daemon.start({ config: '[limits]\nsessions=16\nsession_idle_seconds=2\nimage_side=2000\n' }); });
after(() => d.stop());

test('a session: created, found, listed, ended', async () => {
  const reply = await d.post('/v1/sessions', { volume: 'ball' });
  assert.equal(reply.status, 201);
  const { json } = reply;
  assert.match(json.id, /^[0-9a-f]{32}$/);
  assert.equal(reply.headers.get('location'), `/v1/sessions/${json.id}`);
  assert.equal(json.volume, 'ball');
  assert.equal(json.scene.mode, 'dvr');
  assert.deepEqual((await d.get(json.links.self)).json.scene, json.scene);
  assert.ok((await d.get('/v1/sessions')).json.sessions.some(({ id }) => id === json.id));
  assert.equal((await d.delete(json.links.self)).status, 204);
  problem(await d.get(json.links.self), 404);
  problem(await d.delete(json.links.self), 404);
});

test('a scene given at the start is kept, the rest takes defaults', async () => {
  const { scene } = await d.session({ image: { width: 50, height: 40 }, camera: { fovY: 20 } });
  assert.deepEqual([scene.image.width, scene.image.height, scene.camera.fovY], [50, 40, 20]);
  assert.ok(scene.transferFunction.points.length >= 1);
  const [x, y, z] = scene.camera.target; // the ball's middle in LPS
  assert.ok(Math.hypot(x - 41, y - 51, z - 61) < 1, JSON.stringify(scene.camera));
});

test('bad session requests', async () => {
  problem(await d.post('/v1/sessions', { volume: 'none' }), 404);
  problem(await d.post('/v1/sessions', {}), 422, '/volume');
  problem(await d.post('/v1/sessions', { volume: 'ball', nonsense: 1 }), 422, '/nonsense');
  problem(await d.post('/v1/sessions', { volume: 'ball', scene: { camera: { fovY: 500 } } }), 422, '/scene/camera/fovY');
  problem(await d.post('/v1/sessions', { volume: 'ball', scene: 7 }), 422);
  problem(await d.call('POST', '/v1/sessions', { body: '', type: 'application/json' }), 400);
});

test('merge patch: members change, null gives the default, the rest stays', async () => {
  const { links, scene } = await d.session();
  const changed = await d.patch(links.scene, { camera: { fovY: 12 }, sampling: { step: 0.5 } });
  assert.equal(changed.status, 200);
  assert.deepEqual([changed.json.camera.fovY, changed.json.sampling.step], [12, 0.5]);
  assert.deepEqual(changed.json.camera.position, scene.camera.position);
  const back = await d.patch(links.scene, { camera: { fovY: null } });
  assert.equal(back.json.camera.fovY, scene.camera.fovY);
  assert.equal(back.json.sampling.step, 0.5);
  assert.deepEqual((await d.get(links.scene)).json, back.json);
  const json = await d.patch(links.scene, { sampling: { step: 1 } }, { type: 'application/json' });
  assert.equal(json.status, 200);
});

test('PUT replaces the whole scene', async () => {
  const { links } = await d.session({ camera: { fovY: 12 } });
  const { json } = await d.put(links.scene, { image: { width: 70, height: 60 } });
  assert.equal(json.image.width, 70);
  assert.notEqual(json.camera.fovY, 12);
  const { json: same } = await d.put(links.scene, json);
  assert.deepEqual(same, json, 'a scene that was read can be written');
});

test('ETag and If-Match', async () => {
  const { links } = await d.session();
  const first = (await d.get(links.scene)).headers.get('etag');
  assert.match(first, /^"[^"]+"$/);
  const patched = await d.patch(links.scene, { sampling: { step: 2 } }, { headers: { 'if-match': first } });
  assert.equal(patched.status, 200);
  const second = patched.headers.get('etag');
  assert.notEqual(second, first);
  problem(await d.patch(links.scene, { sampling: { step: 3 } }, { headers: { 'if-match': first } }), 412);
  problem(await d.put(links.scene, {}, { headers: { 'if-match': '"x", "y"' } }), 412);
  assert.equal((await d.get(links.scene)).json.sampling.step, 2);
  assert.equal((await d.patch(links.scene, {}, { headers: { 'if-match': `"x", ${second}` } })).status, 200);
  assert.equal((await d.patch(links.scene, {}, { headers: { 'if-match': '*' } })).status, 200);
  const now = (await d.get(links.scene)).headers.get('etag');
  assert.equal((await d.get(links.scene, { headers: { 'if-none-match': now } })).status, 304);
});

test('refused changes leave scene and ETag alone', async () => {
  const { links } = await d.session();
  const before = await d.get(links.scene);
  problem(await d.patch(links.scene, { camera: { fov: 3 } }), 422, '/camera/fov');
  problem(await d.patch(links.scene, { camera: { fovY: -1 } }), 422, '/camera/fovY');
  problem(await d.patch(links.scene, { image: { width: 2001 } }), 413, '/image/width');
  problem(await d.patch(links.scene, { labels: { volume: 'none' } }), 422, '/labels/volume');
  problem(await d.call('PATCH', links.scene, { body: '{"a":1,}', type: 'application/json' }), 400);
  problem(await d.call('PATCH', links.scene, { body: '['.repeat(5000), type: 'application/json' }), 400);
  const wrong = await d.call('PATCH', links.scene, { body: '{}', type: 'text/plain' });
  problem(wrong, 415);
  assert.match(wrong.headers.get('accept-patch'), /merge-patch/);
  const after = await d.get(links.scene);
  assert.deepEqual([after.json, after.headers.get('etag')], [before.json, before.headers.get('etag')]);
});

test('what is not built is refused as such and the scene stays', async () => {
  const { links } = await d.session();
  let refused = 0;
  for (const mode of ['dvr', 'mip', 'minip', 'average', 'isosurface', 'mesh', 'splat', 'mpr']) {
    const reply = await d.patch(links.scene, { mode });
    if (reply.status === 501) refused++, problem(reply, 501, '/mode');
    else assert.equal(reply.status, 200);
    assert.ok(!['dvr', 'mip', 'minip', 'average'].includes(mode) || reply.status === 200, mode);
    const picture = await d.get(`${links.frame}?width=16&height=16`);
    assert.equal(picture.status, 200, `${mode}: ${picture.bytes}`);
    await d.patch(links.scene, { mode: 'dvr' });
  }
});

test('a session goes from mode to mode and back', async () => {
  const { links } = await d.session({ transferFunction: { points: [{ value: 0, color: [0, 0, 0], opacity: 0 },
    { value: 255, color: [1, 0.5, 0.2], opacity: 0.5 }] }, window: { center: 150, width: 300 } });
  const frame = async (mode) => {
    assert.equal((await d.patch(links.scene, { mode })).status, 200);
    const { status, bytes } = await d.get(`${links.frame}?format=png`);
    assert.equal(status, 200);
    return bytes.toString('base64');
  };
  const dvr = await frame('dvr'), mip = await frame('mip');
  const { json } = await d.get(links.plan);
  assert.match(json.kernel, /^mip\.linear\.u8\./);
  const stages = Object.fromEntries(json.stages.map((stage) => [stage.name, stage]));
  assert.equal(stages['table-2d'].included, false);
  assert.match(stages['table-2d'].reason, /window/);
  assert.match(stages.resolve.reason, /window 150 \/ 300/);
  const average = await frame('average'), minip = await frame('minip');
  assert.equal(new Set([dvr, mip, average, minip]).size, 4);
  assert.equal(await frame('dvr'), dvr);
  assert.equal(await frame('mip'), mip);
  await d.patch(links.scene, { window: { center: 50, width: 20 } });
  assert.notEqual(await frame('mip'), mip);
  const wrong = await d.patch(links.scene, { window: { width: 0 } });
  assert.ok(wrong.status >= 400, `${wrong.status}`);
  problem(wrong, wrong.status, '/window/width');
});

test('a frame is the finished picture, in the size and format asked for', async () => {
  const { links } = await d.session();
  const plain = await d.get(links.frame);
  assert.equal(plain.headers.get('content-type'), 'image/jpeg');
  assert.deepEqual(imageSize(plain.bytes), { format: 'jpeg', width: 96, height: 64 });
  const other = await d.get(`${links.frame}?format=png&width=30&height=20`);
  assert.equal(other.headers.get('content-type'), 'image/png');
  assert.deepEqual(imageSize(other.bytes), { format: 'png', width: 30, height: 20 });
  assert.match(other.headers.get('server-timing'), /^queue;dur=[\d.]+, tables;dur=[\d.]+, skip;dur=[\d.]+, render;dur=[\d.]+, encode;dur=[\d.]+$/);
  const poor = await d.get(`${links.frame}?quality=5`), good = await d.get(`${links.frame}?quality=98`);
  assert.ok(poor.bytes.length < good.bytes.length);
  for (const query of ['width=0', 'height=high', 'quality=101', 'format=gif']) problem(await d.get(`${links.frame}?${query}`), 422);
  problem(await d.get(`${links.frame}?width=2001`), 413);
  problem(await d.get(`${links.frame}?width=100000`), 413, '/image/width');
  const { json } = await d.get(links.scene);
  assert.deepEqual([json.image.width, json.image.format], [96, 'jpeg'], 'the scene is not changed by it');
});

test('the plan lists its stages with reasons', async () => {
  const { links } = await d.session();
  await d.get(links.frame);
  const { json } = await d.get(links.plan);
  assert.ok(json.stages.length > 5);
  for (const stage of json.stages) assert.ok(stage.reason.length > 0, stage.name);
  const table = async () => (await d.get(links.plan)).json.stages.find(({ name }) => name === 'table-2d');
  const first = await table();
  assert.ok(first.ms > 0 && first.bytes > 0, JSON.stringify(first));
  await d.patch(links.scene, { camera: { fovY: 20 } });
  await d.get(links.frame);
  assert.deepEqual(await table(), first, 'a camera builds nothing');
  await d.patch(links.scene, { transferFunction: { preset: 'ct-bone' } });
  assert.deepEqual([(await table()).ms, (await table()).bytes], [0, 0], 'not built before it is needed');
  await d.get(links.frame);
  assert.notEqual((await table()).ms, first.ms, 'colours build a table');
  assert.ok(json.stages.some(({ included }) => included) && json.stages.some(({ included }) => !included));
});

test('one who opens sessions without end does not keep others from their first', async () => {
  const full = await Daemon.start({ args: ['--trusted-proxy', '127.0.0.1'], config: '[limits]\nsessions=2\n' });
  const from = async (n) => (await full.call('POST', '/v1/sessions', { json: { volume: 'ball' }, headers: { 'X-Forwarded-For': `203.0.113.${n}` } })).status;
  const statuses = [];
  for (const n of [1, 1, 1, 2, 2, 3, 4]) statuses.push(await from(n));
  assert.deepEqual(statuses, [201, 201, 503, 201, 503, 201, 503]);
  await full.stop();
});

test('the number of sessions is limited, and idle ones end', async () => {
  const replies = [];
  for (let i = 0; i < 20; i++) replies.push(await d.post('/v1/sessions', { volume: 'ball' }));
  const busy = replies.find(({ status }) => status !== 201);
  problem(busy, 503);
  assert.ok(Number(busy.headers.get('retry-after')) > 0);
  await until(async () => (await d.get('/v1/sessions')).json.sessions.length === 0);
});
