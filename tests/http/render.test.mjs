// POST /v1/render: one picture, no session.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Daemon, imageSize, problem } from '../support/daemon.mjs';

let d;
before(async () => { d = await Daemon.start({ config: '[limits]\nqueue=4\nrender_seconds=2\n' }); });
after(() => d.stop());

const image = { width: 64, height: 48 };
const render = (more) => d.post('/v1/render', { volume: 'ball', scene: { image }, ...more });

test('a JPEG, a PNG', async () => {
  const jpeg = await render({ format: 'jpeg', quality: 90 });
  assert.deepEqual([jpeg.status, jpeg.headers.get('content-type'), jpeg.headers.get('cache-control')], [200, 'image/jpeg', 'no-store']);
  assert.deepEqual(imageSize(jpeg.bytes), { format: 'jpeg', ...image });
  const png = await render({ format: 'png' });
  assert.deepEqual(imageSize(png.bytes), { format: 'png', ...image });
  assert.match(png.headers.get('server-timing'), /render;dur=/);
});

test('a transparent PNG, asked for by the format of the body', async () => {
  const clear = { image: { ...image, background: 'transparent' } };
  const png = await render({ scene: clear, format: 'png' });
  assert.deepEqual([png.status, png.headers.get('content-type')], [200, 'image/png']);
  assert.equal(png.bytes[25], 6, 'RGB and alpha');
  assert.equal((await render({ scene: { image: { ...clear.image, format: 'jpeg' } }, format: 'png' })).status, 200);
  problem(await render({ scene: clear, format: 'jpeg' }), 422, '/scene/image/background');
  problem(await render({ scene: clear }), 422, '/scene/image/background');
  problem(await render({ scene: [], format: 'png' }), 422, '/scene');
  problem(await render({ scene: { image: 7 }, format: 'png' }), 422, '/scene/image');
});

test('the same request gives the same picture, another scene another one', async () => {
  const one = await render({ format: 'png' }), two = await render({ format: 'png' });
  assert.ok(one.bytes.equals(two.bytes));
  const other = await d.post('/v1/render', { volume: 'ball', format: 'png', scene: { image, camera: { fovY: 10 } } });
  assert.ok(!one.bytes.equals(other.bytes));
  const { json } = await d.get('/v1/sessions');
  assert.deepEqual(json.sessions, []);
});

test('many at once are all answered, or told to come back', async () => {
  const replies = await Promise.all(Array.from({ length: 30 }, (_, i) =>
    d.post('/v1/render', { volume: 'ball', scene: { image: { width: 200 + i, height: 200 } } })));
  let good = 0;
  replies.forEach((reply, i) => {
    if (reply.status === 200) good++, assert.equal(imageSize(reply.bytes).width, 200 + i);
    else problem(reply, 503);
  });
  assert.ok(good >= 5, `${good} answered`);
});

test('bad requests name the member', async () => {
  problem(await render({ format: 'gif' }), 422);
  problem(await render({ quality: 0 }), 422);
  problem(await render({ quality: 'high' }), 422);
  problem(await render({ extra: true }), 422, '/extra');
  problem(await d.post('/v1/render', { volume: 'none' }), 404);
  problem(await d.post('/v1/render', { volume: 5 }), 422, '/volume');
  problem(await d.post('/v1/render', { volume: 'ball', scene: { image: { width: 0 } } }), 422, '/scene/image/width');
  problem(await d.post('/v1/render', { volume: 'ball', scene: { unknown: 1 } }), 422, '/scene/unknown');
  problem(await d.call('POST', '/v1/render', { body: 'no', type: 'application/json' }), 400);
});

test('a client that leaves while it waits costs nothing further', async () => {
  const body = JSON.stringify({ volume: 'ball', scene: { image: { width: 2000, height: 2000 }, sampling: { step: 0.05 } } });
  await d.raw(`POST /v1/render HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\nContent-Type: application/json\r\nContent-Length: ${body.length}\r\n\r\n${body}`, 50);
  const { status } = await render({});
  assert.equal(status, 200);
});

test('a picture that takes too long is given up, and the next one is rendered', async () => {
  const scene = { image: { width: 4000, height: 4000 }, sampling: { step: 0.002, termination: 0 },
    transferFunction: { points: [{ value: 0, color: [1, 1, 1], opacity: 0.001 }] } };
  const json = problem(await d.post('/v1/render', { volume: 'ball', scene }), 413);
  assert.match(json.detail, /longer than 2 seconds/);
  assert.equal((await render({})).status, 200);
});
