// The memory of the daemon stays within what it was given, and what goes first when it runs out.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import net from 'node:net';
import { test } from 'node:test';
import { ballNrrd, BINARY, Daemon, problem, sleep } from '../support/daemon.mjs';
import { handshake } from '../support/ws.mjs';

const MB = 1e6;
const SANITIZED = /asan|tsan/.test(BINARY); // they keep what is freed, and shadows beside it
const upload = (d, id, body) => d.call('PUT', `/v1/volumes/${id}`, { body, type: 'application/octet-stream' });
const peak = (d) => Number(/VmHWM:\s+(\d+) kB/.exec(readFileSync(`/proc/${d.process.pid}/status`, 'utf8'))[1]) * 1024;
async function used(d) {
  const lines = (await d.get('/metrics')).bytes.toString().matchAll(/^tomocast_memory_bytes\{kind="(\w+)"\} (\d+)$/gm);
  return Object.fromEntries([...lines].map(([, kind, bytes]) => [kind, Number(bytes)]));
}

async function settled(d, id) {
  for (const end = Date.now() + 60000; Date.now() < end; await sleep(20)) {
    const { json } = await d.get(`/v1/volumes/${id}`);
    if (json.state !== 'loading') return json;
  }
  throw new Error(`${id} loads for ever`);
}

/** n x 1000 x 1000 voxels of a byte: n MB */
const slab = (n) => Buffer.concat([Buffer.from(`NRRD0004\ntype: uint8\ndimension: 3\nsizes: 1000 1000 ${n}\nencoding: raw\n\n`), Buffer.alloc(n * MB, 7)]);

test('four loads of 64 MB at once keep within a budget of 200 MB', async () => {
  const bare = await Daemon.start({ ball: false });
  const program = (await used(bare)).program;
  assert.ok(program > 1 * MB);
  await bare.stop();
  const budget = SANITIZED ? program + 200 * MB : 200 * MB;
  const files = Object.fromEntries([0, 1, 2, 3].map((i) => [`s${i}.nrrd`, slab(64)]));
  const d = await Daemon.start({ ball: false, files, config: `[limits]\nmemory_bytes=${budget}\n` });
  assert.equal((await d.get('/v1/about')).json.limits.memoryBytes, budget);
  const loads = [0, 1, 2, 3].map((i) => d.post('/v1/volumes', { id: `s${i}`, path: `s${i}.nrrd` }));
  for (const reply of await Promise.all(loads)) assert.equal(reply.status, 202);
  const volumes = [];
  for (const i of [0, 1, 2, 3]) volumes.push(await settled(d, `s${i}`));
  const resident = volumes.filter(({ state }) => state === 'resident').length;
  assert.ok(resident >= 1);
  for (const { state, reason } of volumes) if (state !== 'resident') assert.match(reason, /memory is used up|dropped to make room/);
  // Pictures of what is there, and what is brought up meanwhile.
  const { volumes: now } = (await d.get('/v1/volumes')).json;
  const shown = now.find(({ state }) => state === 'resident').id;
  for (const width of [64, 512, 1024])
    assert.equal((await d.post('/v1/render', { volume: shown, scene: { image: { width, height: width } } })).status, 200);
  for (let i = 0; i < 4; i++) await upload(d, `u${i}`, slab(50));
  for (let i = 0; i < 4; i++) await settled(d, `u${i}`);
  console.log(`program ${program / MB | 0} MB, peak ${peak(d) / MB | 0} MB of ${budget / MB | 0}; ${JSON.stringify(await used(d))}`);
  if (!SANITIZED) assert.ok(peak(d) < 1.1 * budget, `${peak(d)}`);
  await d.stop();
});

test('volumes that nobody shows go first, the oldest first, the operator\'s last; then it is 503', async () => {
  const d = await Daemon.start({ n: 64, config: '[limits]\nvolume_bytes=1000000\n' });
  const three = [];
  for (const id of ['a', 'b', 'c']) {
    assert.equal((await upload(d, id, ballNrrd(60))).status, 202); // 216 kB beside the ball's 262
    three.push((await settled(d, id)).state);
  }
  assert.deepEqual(three, ['resident', 'resident', 'resident']);
  await d.get('/v1/volumes/a/histogram'); // a was used last but one
  await d.post('/v1/sessions', { volume: 'c' });
  assert.equal((await upload(d, 'e', ballNrrd(60))).status, 202);
  assert.equal((await settled(d, 'e')).state, 'resident');
  const b = (await d.get('/v1/volumes/b')).json;
  assert.deepEqual([b.state, (await d.get('/v1/volumes/a')).json.state], ['failed', 'resident']);
  assert.match(b.reason, /dropped to make room/);
  for (const id of ['a', 'e']) await d.post('/v1/sessions', { volume: id });
  assert.equal((await d.get('/v1/volumes/ball')).json.state, 'resident');
  assert.equal((await upload(d, 'f', ballNrrd(60))).status, 202);
  assert.equal((await settled(d, 'f')).state, 'resident');
  assert.equal((await d.get('/v1/volumes/ball')).json.state, 'failed');
  assert.equal(await d.metric('volume_drops_total'), 2);
  await d.post('/v1/sessions', { volume: 'f' });
  assert.equal((await upload(d, 'g', ballNrrd(40))).status, 202); // 64 kB are left
  assert.equal((await settled(d, 'g')).state, 'resident');
  await d.post('/v1/sessions', { volume: 'g' });
  const refused = await upload(d, 'i', ballNrrd(40));
  if (refused.status === 202) {
    assert.match((await settled(d, 'i')).reason, /memory is used up: .*volumes \d/);
  } else {
    assert.match(problem(refused, 503).detail, /volumes \d/);
    assert.ok(Number(refused.headers.get('retry-after')) >= 1);
  }
  await d.stop();
});

test('with nothing left at all a load is 503 with Retry-After and says what has the memory', async () => {
  const d = await Daemon.start({ n: 64, config: '[limits]\nvolume_bytes=280000\n' });
  await d.session();
  for (const reply of [await upload(d, 'x', ballNrrd(8)), await d.post('/v1/volumes', { id: 'y', path: 'ball.nrrd' })]) {
    assert.match(problem(reply, 503).detail, /memory is used up: .*volumes 0\.\d/);
    assert.ok(Number(reply.headers.get('retry-after')) >= 1);
  }
  await d.stop();
});

test('derived data is counted, and goes before volumes do', async () => {
  const d = await Daemon.start({ ball: false, files: { 'big.nrrd': ballNrrd(128) } });
  await d.post('/v1/volumes', { id: 'big', path: 'big.nrrd' });
  await settled(d, 'big');
  assert.equal((await d.post('/v1/render', { volume: 'big', scene: { image: { width: 256, height: 256 }, filter: 'cubic', sampling: { prefilter: true } } })).status, 200);
  const memory = await used(d);
  assert.ok(memory.caches > 1e5, JSON.stringify(memory));
  assert.ok(memory.frames >= 256 * 256 * 4, JSON.stringify(memory));
  assert.ok(memory.volumes >= 128 ** 3);
  assert.ok((await d.metric('memory_budget_bytes')) > 1e6);
  await d.delete('/v1/volumes/big');
  for (let i = 0; (await used(d)).volumes + (await used(d)).pinned > 0 && i < 100; i++) await sleep(20);
  const after = await used(d);
  assert.deepEqual([after.volumes, after.pinned, after.loads], [0, 0, 0]);
  await d.stop();
});

test('one picture serves all who watch it, be they as slow as they like', async () => {
  const noise = Buffer.concat([Buffer.from('NRRD0004\ntype: uint8\ndimension: 3\nsizes: 512 512 2\nencoding: raw\n\n'),
    Buffer.from(Uint8Array.from({ length: 512 * 512 * 2 }, (_, i) => Math.imul(i + 1, 0x9e3779b1) >>> 13))]);
  const d = await Daemon.start({ ball: false, files: { 'noise.nrrd': noise }, config: '[server]\nhosts=127.0.0.1\n' });
  await d.post('/v1/volumes', { id: 'noise', path: 'noise.nrrd' });
  await settled(d, 'noise');
  const image = { width: 1024, height: 1024, format: 'png' };
  const { json: session } = await d.post('/v1/sessions', { volume: 'noise', scene: { mode: 'mpr', mpr: { orientation: 'axial' }, image } });
  const size = (await d.get(session.links.frame)).bytes.length;
  const resident = () => Number(/VmRSS:\s+(\d+) kB/.exec(readFileSync(`/proc/${d.process.pid}/status`, 'utf8'))[1]) * 1024;
  const before = resident(), viewers = 30, sockets = [];
  for (let i = 0; i < viewers; i++) {
    sockets.push((await handshake(d.port, `/v1/sessions/${session.id}/stream`)).socket.pause());
    sockets.push(net.connect(d.port, '127.0.0.1').pause());
    sockets.at(-1).write(`GET ${session.links.mjpeg} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n`);
  }
  for (let i = 0; i < 500 && (await d.metric('ws_clients')) + (await d.metric('mjpeg_clients')) < 2 * viewers; i++) await sleep(20);
  for (let i = 0; i < 4; i++) { // pictures that none of them has read
    await d.patch(session.links.scene, { camera: { fovY: 30 + i } });
    await sleep(250);
  }
  const grown = resident() - before;
  console.log(`${2 * viewers} viewers of a PNG of ${size / MB} MB take ${grown / MB} MB`);
  assert.ok(size > MB);
  if (!SANITIZED) assert.ok(grown < 0.5 * 2 * viewers * size, `${grown / MB} MB`);
  sockets.forEach((socket) => socket.destroy());
  await d.stop();
});
