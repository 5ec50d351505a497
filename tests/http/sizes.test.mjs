// Every viewer of a session has pictures of its own size, whatever the scene's image says.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Daemon, imageSize } from '../support/daemon.mjs';
import { Ws } from '../support/ws.mjs';

let d;
before(async () => (d = await Daemon.start({ config: '[limits]\nimage_area = 40000\n' })));
after(() => d.stop());

const still = (header) => header.final;
const of = (header) => [header.width, header.height];

test('two viewers of two sizes both get final pictures of theirs, at rest and while one drags', async () => {
  const session = await d.session();
  const [desktop, phone] = [await Ws.open(d, session.id), await Ws.open(d, session.id)];
  desktop.send({ type: 'size', width: 160, height: 100 });
  phone.send({ type: 'size', width: 40, height: 80 });
  const both = (seq) => [
    desktop.nextFrame((header) => still(header) && header.width === 160 && header.seq === seq),
    phone.nextFrame((header) => still(header) && header.width === 40 && (!seq || header.scene.camera.fovY === 20 + seq)),
  ];
  const [large, small] = await Promise.all(both(0));
  assert.deepEqual(imageSize(large.image), { format: 'jpeg', width: 160, height: 100 });
  assert.deepEqual(imageSize(small.image), { format: 'jpeg', width: 40, height: 80 });
  desktop.send({ type: 'pointer', phase: 'start' });
  const frames = [];
  const moved = [(header) => header.scene.camera.fovY > 20, (header) => header.scene.camera.fovY > 20];
  for (let seq = 1; seq <= 6; seq++) {
    desktop.patch(seq, { camera: { fovY: 20 + seq } });
    frames.push(await desktop.nextFrame((header) => header.seq === seq)); // the phone holds nobody up
    if (seq === 3) frames.push(await phone.nextFrame(moved[1]));
  }
  desktop.send({ type: 'pointer', phase: 'end' });
  await Promise.all(both(6));
  for (const { header } of frames) assert.ok(header.width <= 160);
  const { json } = await d.get(session.links.scene);
  assert.deepEqual([json.image.width, json.image.height], [96, 64], 'the scene keeps its size');
  const { bytes } = await d.get(session.links.frame);
  assert.deepEqual(imageSize(bytes), { format: 'jpeg', width: 96, height: 64 });
  desktop.patch(7, { image: { width: 50, height: 50 } });
  const { header } = await desktop.nextFrame((later) => still(later) && later.seq === 7);
  assert.deepEqual(of(header), [160, 100], 'which is nothing to a viewer with its own');
  for (const ws of [desktop, phone]) await ws.close();
});

test('a viewer who changes its size is shown the same scene anew; one without a size has the scene\'s', async () => {
  const session = await d.session();
  const ws = await Ws.open(d, session.id);
  assert.deepEqual(of((await ws.nextFrame(still)).header), [96, 64]);
  for (const [width, height] of [[30, 30], [60, 30], [96, 64], [31, 32]]) {
    ws.send({ type: 'size', width, height });
    const { header } = await ws.nextFrame((frame) => still(frame) && frame.width === width && frame.height === height);
    assert.equal(header.seq, 0);
  }
  await ws.close();
});

test('too large a size is refused, and one of too many is the scene\'s', async () => {
  const session = await d.session();
  const viewers = [];
  for (let i = 0; i < 8; i++) {
    const ws = await Ws.open(d, session.id);
    ws.send({ type: 'size', width: 100 + i, height: 40 });
    viewers.push(ws);
  }
  const sizes = await Promise.all(
    viewers.map(async (ws, i) => (await ws.nextFrame((header) => still(header) && (i > 5 || header.height === 40))).header.width),
  );
  assert.deepEqual(sizes, [100, 101, 102, 103, 104, 105, 96, 96]);
  viewers[0].send({ type: 'size', width: 8000, height: 8000 });
  const { problem } = await viewers[0].nextText('error');
  assert.deepEqual([problem.status, problem.pointer], [413, '/width']);
  viewers[0].send({ type: 'size', width: 0, height: 40 });
  assert.equal((await viewers[0].nextText('error')).problem.status, 422);
  for (const ws of viewers) await ws.close();
  assert.deepEqual((await d.get(session.links.self)).json.viewers, 0);
  assert.equal((await d.call('DELETE', session.links.self)).status, 204);
});
