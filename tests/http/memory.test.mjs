// The memory of the daemon stays within what it was given, and what goes first when it runs out.
import assert from 'node:assert/strict';
import { mkdirSync, readdirSync, readFileSync, rmdirSync, writeFileSync } from 'node:fs';
import net from 'node:net';
import { test } from 'node:test';
import { ballNrrd, BINARY, Daemon, problem, sleep, until } from '../support/daemon.mjs';
import { dicomSlice } from '../support/dicom.mjs';
import { handshake, Ws } from '../support/ws.mjs';

const MB = 1e6;
const SANITIZED = /asan|tsan/.test(BINARY); // they keep what is freed, and shadows beside it
const upload = (d, id, body) => d.call('PUT', `/v1/volumes/${id}`, { body, type: 'application/octet-stream' });
const peak = (d) => Number(/VmHWM:\s+(\d+) kB/.exec(readFileSync(`/proc/${d.process.pid}/status`, 'utf8'))[1]) * 1024;
async function used(d) {
  const lines = (await d.get('/metrics')).bytes.toString().matchAll(/^tomocast_memory_bytes\{kind="(\w+)"\} (\d+)$/gm);
  return Object.fromEntries([...lines].map(([, kind, bytes]) => [kind, Number(bytes)]));
}

const settled = (d, id) => d.loaded(`/v1/volumes/${id}`);

const shells = Array.from({ length: 12 }, (_, i) => ({ value: 20 + 16 * i, opacity: 0.01 }));

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

test('the mask of voxels that are NaN is counted, and refused where there is no room for it', async () => {
  const voxels = Buffer.alloc(4 * MB);
  for (let i = 0; i < MB; i++) voxels.writeFloatLE(i % 7 ? i % 100 : NaN, 4 * i);
  const file = Buffer.concat([Buffer.from('NRRD0004\ntype: float\ndimension: 3\nsizes: 100 100 100\nendian: little\nencoding: raw\n\n'), voxels]);
  const volumes = {};
  for (const bytes of [8 * MB, 4.5 * MB]) {
    const d = await Daemon.start({ ball: false, files: { 'map.nrrd': file }, config: `[limits]\nvolume_bytes=${bytes}\n` });
    await d.post('/v1/volumes', { id: 'map', path: 'map.nrrd' });
    volumes[bytes] = await settled(d, 'map');
    if (bytes > 5 * MB) assert.ok((await used(d)).volumes >= 5 * MB, JSON.stringify(await used(d)));
    await d.stop();
  }
  assert.equal(volumes[8 * MB].state, 'resident');
  assert.deepEqual([volumes[4.5 * MB].state, /memory/.test(volumes[4.5 * MB].reason)], ['failed', true], volumes[4.5 * MB].reason);
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
  await until(async () => (await used(d)).volumes + (await used(d)).pinned === 0);
  const after = await used(d);
  assert.deepEqual([after.volumes, after.pinned, after.loads], [0, 0, 0]);
  await d.stop();
});

test('one picture serves all who watch it, be they as slow as they like', { skip: SANITIZED && 'what it counts is not to be counted' }, async () => {
  const noise = Buffer.concat([Buffer.from('NRRD0004\ntype: uint8\ndimension: 3\nsizes: 512 512 2\nencoding: raw\n\n'),
    Buffer.from(Uint8Array.from({ length: 512 * 512 * 2 }, (_, i) => Math.imul(i + 1, 0x9e3779b1) >>> 13))]);
  const d = await Daemon.start({ ball: false, files: { 'noise.nrrd': noise }, config: '[server]\nhosts=127.0.0.1\n' });
  await d.post('/v1/volumes', { id: 'noise', path: 'noise.nrrd' });
  await settled(d, 'noise');
  const image = { width: 3000, height: 3000, format: 'png' }; // more than kernels keep for a connection
  const { json: session } = await d.post('/v1/sessions', { volume: 'noise', scene: { mode: 'mpr', mpr: { orientation: 'axial' }, image } });
  const size = (await d.get(session.links.frame)).bytes.length;
  const resident = () => Number(/VmRSS:\s+(\d+) kB/.exec(readFileSync(`/proc/${d.process.pid}/status`, 'utf8'))[1]) * 1024;
  const before = resident(), viewers = 10, sockets = [];
  for (let i = 0; i < viewers; i++) {
    sockets.push((await handshake(d.port, `/v1/sessions/${session.id}/stream`)).socket.pause());
    sockets.push(net.connect(d.port, '127.0.0.1').pause());
    sockets.at(-1).write(`GET ${session.links.mjpeg} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n`);
  }
  await until(async () => (await d.metric('ws_clients')) + (await d.metric('mjpeg_clients')) >= 2 * viewers);
  let sent = 0; // some take no more than the small picture that comes first
  for (let i = 0; i < 1000 && sent < 5 * size; i++, await sleep(20)) sent = await d.metric('ws_sent_bytes_total');
  const grown = resident() - before;
  console.log(`${2 * viewers} viewers of a PNG of ${size / MB} MB take ${grown / MB} MB`);
  assert.ok(sent >= 5 * size && grown < 4 * size, `${sent / MB} MB were sent, ${grown / MB} MB taken`);
  sockets.forEach((socket) => socket.destroy());
  await d.stop();
});

/** What a daemon has before it does anything. */
async function programBytes() {
  const bare = await Daemon.start({ ball: false });
  const { program } = await used(bare);
  await bare.stop();
  return program;
}
const big = (side) => ({ volume: 'ball', scene: { image: { width: side, height: side }, sampling: { step: 4 } } });

test('a picture that cannot fit is refused; what nobody uses goes first', async () => {
  const program = await programBytes();
  const decoder = SANITIZED ? 30 : 0; // what a decoder has beside its voxels: next to nothing, but for shadows
  const d = await Daemon.start({ files: { 'idle.nrrd': slab(30) }, config: `[limits]\nmemory_bytes=${program + (60 + decoder) * MB | 0}\n` });
  const side = (mb) => Math.round(Math.sqrt((mb + decoder) * MB / 8)); // 8 bytes a pixel while it is encoded
  const refused = await d.post('/v1/render', big(side(82)));
  assert.match(problem(refused, 503).detail, /memory is used up/);
  assert.ok(Number(refused.headers.get('retry-after')) >= 1);
  assert.equal((await d.post('/v1/render', big(1000))).status, 200);
  await d.post('/v1/volumes', { id: 'idle', path: 'idle.nrrd' });
  assert.equal((await settled(d, 'idle')).state, 'resident');
  assert.equal((await d.post('/v1/render', big(side(39)))).status, 200, 'beside the volume there are less than 30');
  assert.match((await d.get('/v1/volumes/idle')).json.reason, /dropped to make room/);

  const session = await d.session();
  const ws = await Ws.open(d, session.id);
  ws.patch(1, { image: { width: side(82), height: side(82) } });
  assert.equal((await ws.nextText('error')).problem.status, 503);
  ws.patch(2, { image: { width: 64, height: 64 } });
  await ws.nextFrame(({ seq }) => seq === 2);
  await ws.close();
  if (!SANITIZED) assert.ok(peak(d) < 1.1 * (program + 60 * MB), `${peak(d)}`);
  await d.stop();
});

// Surfaces in a volume: 76 bytes a pixel from the start, and the layers as they are found.
test('what a picture keeps while others have their turn is counted until it is dropped', async () => {
  const d = await Daemon.start();
  const side = 384;
  const scene = { image: { width: side, height: side }, sampling: { step: 0.02, raysPerPixel: 64 }, mesh: { withVolume: true, surfaces: shells } };
  const body = JSON.stringify({ volume: 'ball', scene });
  const left = net.connect(d.port, '127.0.0.1', () => left.write(`POST /v1/render HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\nContent-Type: application/json\r\nContent-Length: ${body.length}\r\n\r\n${body}`));
  left.on('error', () => {});
  const ws = await Ws.open(d, (await d.session({ image: { width: 32, height: 32 } })).id);
  let seq = 0;
  const frames = async (enough) => {
    for (const end = Date.now() + 60000; Date.now() < end; ) {
      ws.patch(++seq, { camera: { fovY: 20 + (seq % 40) / 4 } });
      await ws.nextFrame((h) => h.seq >= seq, 60000);
      const now = (await used(d)).frames;
      if (enough(now)) return now;
    }
    throw new Error(`${(await used(d)).frames} bytes`);
  };
  const kept = await frames((bytes) => bytes > (84 + 28) * side ** 2);
  left.destroy();
  console.log(`${(kept / side ** 2) | 0} bytes a pixel`);
  await frames((bytes) => bytes < 76 * side ** 2);
  await ws.close();
  await d.stop();
});

// What only building or drawing tells: 67 MB of coefficients; layers of translucent surfaces in a volume. Beside both volumes
// either budget has at least 36 MB left, which is more than a sanitizer's decoder takes (28 MB).
for (const [what, kind, n, budget, image, scene] of [
  ['coefficients', 'caches', 256, 100, { width: 64, height: 64 }, { filter: 'cubic', sampling: { prefilter: true } }],
  ['layers', 'frames', 64, 62, { width: 350, height: 350 }, { mesh: { withVolume: true, surfaces: shells } }],
])
  test(`${what} that find no room are refused until they do`, async () => {
    const program = await programBytes();
    const d = await Daemon.start({ n, files: { 'shown.nrrd': slab(25) }, config: `[limits]\nmemory_bytes=${program + budget * MB | 0}\ncache_bytes=${90 * MB}\n` });
    const picture = { volume: 'ball', scene: { image, ...scene } };
    await d.post('/v1/volumes', { id: 'shown', path: 'shown.nrrd' });
    await settled(d, 'shown');
    const { json } = await d.post('/v1/sessions', { volume: 'shown' });
    const refused = await d.post('/v1/render', picture);
    assert.match(problem(refused, 503).detail, new RegExp(`memory is used up: ${kind} need .*volumes [23]`));
    assert.ok(Number(refused.headers.get('retry-after')) >= 1);
    await d.delete(json.links.self);
    const drawn = await d.post('/v1/render', picture);
    assert.equal(drawn.status, 200, drawn.json?.detail);
    assert.match((await d.get('/v1/volumes/shown')).json.reason, /dropped to make room/);
    console.log(`${what}: peak ${peak(d) / MB | 0} MB, program ${program / MB | 0}; ${JSON.stringify(await used(d))}`);
    if (!SANITIZED) assert.ok(peak(d) < 1.1 * (program + budget * MB), `${peak(d)}`);
    await d.stop();
  });

test('encoded pictures are counted as long as anybody has them', async () => {
  const d = await Daemon.start();
  const session = await d.session({ image: { width: 512, height: 512, format: 'png' } });
  const ws = await Ws.open(d, session.id);
  const { image } = await ws.nextFrame(({ final }) => final);
  assert.ok((await used(d)).pictures >= image.length);
  await d.delete(session.links.self);
  await until(async () => (await used(d)).pictures === 0);
  await d.stop();
});

test('what decodes DICOM beside the daemon is counted, and ended where it takes more than there is', async () => {
  const program = await programBytes();
  // The volume takes 32 MB, its decoder about twice as much, and what checks memory a multiple of that.
  for (const [more, state] of [[60, 'failed'], [SANITIZED ? 1000 : 400, 'resident']]) {
    const d = await Daemon.start({ ball: false, files: { 's.dcm': dicomSlice(4000) }, config: `[limits]\nmemory_bytes=${program + more * MB | 0}\n` });
    try {
      await d.post('/v1/volumes', { id: 's', path: 's.dcm' });
      const found = await settled(d, 's');
      assert.equal(found.state, state, found.reason);
      if (state === 'failed') assert.match(found.reason, /memory is used up: .*decoders (need )?\d/);
      assert.equal((await used(d)).decoders, 0);
    } finally {
      await d.stop();
    }
  }
});

/** A control group for `bytes` of memory, or undefined where this user may not make one: version 2 or 1. */
function controlGroup(bytes) {
  for (const [root, file] of [['/sys/fs/cgroup', 'memory.max'], ['/sys/fs/cgroup/memory', 'memory.limit_in_bytes']]) {
    const folder = `${root}/tomocast-test-${process.pid}`;
    try {
      mkdirSync(folder);
      writeFileSync(`${folder}/${file}`, String(bytes), { flag: 'r+' });
      readFileSync(`${folder}/cgroup.procs`);
      return folder;
    } catch {
      try { rmdirSync(folder); } catch { /* there is none */ }
    }
  }
  return undefined;
}

/** Bytes that no file stands behind, of a process and of its decoders: [of all, how many decoders]. (A child that is about
 * to become one shares its parent's.) */
function anonymous(pid) {
  const read = (path) => { try { return readFileSync(`/proc/${path}`, 'utf8'); } catch { return ''; } };
  const children = readdirSync(`/proc/${pid}/task`).flatMap((task) => read(`${pid}/task/${task}/children`).split(' ').filter(Boolean));
  const all = [read(`${pid}/status`), ...children.map((child) => read(`${child}/status`)).filter((text) => /^Name:\ttomocast-(dicom|import)/.test(text))];
  return [all.reduce((sum, text) => sum + Number(/RssAnon:\s+(\d+)/.exec(text)?.[1] ?? 0) * 1024, 0), all.length - 1];
}

test('in a control group several attacks at once stay within the budget and 10 %', { skip: SANITIZED && 'sanitizers keep what is freed' }, async (t) => {
  const LIMIT = 256 * 2 ** 20, group = controlGroup(LIMIT), budget = LIMIT / 4 * 3;
  if (!group) t.diagnostic('no control group may be made here: the budget is configured');
  const files = { 'a.nrrd': slab(64), 'b.nrrd': slab(64), 's.dcm': dicomSlice(4000) };
  const d = await Daemon.start({ files, group, config: group ? '' : `[limits]\nmemory_bytes=${budget}\n` });
  assert.equal((await d.get('/v1/about')).json.limits.memoryBytes, budget, 'three quarters of the group\'s');
  let most = 0, decoders = 0, refused = 0;
  const watch = setInterval(() => {
    const [bytes, children] = anonymous(d.process.pid);
    most = Math.max(most, bytes);
    decoders = Math.max(decoders, children);
  }, 5);
  const quietly = (promise) => promise.then((reply) => (refused += reply.status === 503), () => {});
  const work = [];
  for (const id of ['a', 'b']) work.push(quietly(d.post('/v1/volumes', { id, path: `${id}.nrrd` })));
  for (const id of ['s', 's2']) work.push(quietly(d.post('/v1/volumes', { id, path: 's.dcm' })));
  for (let i = 0; i < 2; i++) work.push(quietly(upload(d, `u${i}`, slab(50))));
  const session = await d.session({ image: { width: 1400, height: 1400, format: 'png' } });
  const deaf = [];
  for (let i = 0; i < 8; i++) deaf.push(await Ws.open(d, session.id, { autoAck: false }));
  for (const ws of deaf) ws.socket.pause();
  for (let i = 0; i < 12; i++) work.push(quietly(d.post('/v1/render', { volume: 'ball', scene: { image: { width: 2000 + 100 * i, height: 2000, format: 'png' }, sampling: { step: 4 } } })));
  for (let i = 0; i < 30; i++) {
    const socket = net.connect(d.port, '127.0.0.1', () => socket.end(`GET ${session.links.self}/ray?x=${i}&y=700 HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\n\r\n`));
    socket.on('error', () => {});
    socket.resume();
    deaf[0].patch(i + 1, { camera: { fovY: 10 + i / 10 } });
  }
  await Promise.all(work);
  for (const id of ['a', 'b', 's', 's2', 'u0', 'u1']) if ((await d.get(`/v1/volumes/${id}`)).status === 200) await settled(d, id);
  clearInterval(watch);
  t.diagnostic(`peak ${most / MB | 0} MB of ${budget / MB | 0}, VmHWM ${peak(d) / MB | 0} MB; ${decoders} decoders at once, ${refused} refused; ${JSON.stringify(await used(d))}`);
  assert.ok(decoders > 0);
  assert.ok(Math.max(most, peak(d)) < 1.1 * budget, `${most}`);
  assert.equal((await d.post('/v1/render', { volume: 'ball', scene: { image: { width: 64, height: 64 } } })).status, 200);
  for (const ws of deaf) ws.cut();
  await d.stop();
  if (group) rmdirSync(group);
});

test('a resident volume is prepared, unless half of the cache is in use', async () => {
  const d = await Daemon.start({ ball: false, config: `[limits]\ncache_bytes=${4 << 20}\n` });
  const load = async (id, path, preparations) => {
    await d.post('/v1/volumes', { id, path });
    await d.resident(id);
    const over = async (name) => d.metric(`${name}_total{class="refine"}`);
    await until(async () => (await over('slices')) - (await over('pauses')) === preparations);
    return (await used(d)).caches;
  };
  const took = async (volume) => {
    const { status, headers } = await d.post('/v1/render', { volume });
    assert.equal(status, 200);
    const [, tables, skip] = /tables;dur=([\d.]+), skip;dur=([\d.]+)/.exec(headers.get('server-timing'));
    return Number(tables) + Number(skip);
  };
  const filled = await load('head', 'demo:head', 1);
  assert.ok(filled > 2 << 20, `${filled} bytes`);
  assert.equal(await load('bucky', 'demo:bucky', 2), filled, 'the second one finds the cache full');
  assert.equal(await d.metric('class_queue_seconds_count{class="refine"}'), 0, 'no picture waited');
  assert.equal(await took('head'), 0);
  assert.ok((await took('bucky')) > 0);
  await d.call('DELETE', '/v1/volumes/head');
  await until(async () => (await used(d)).caches < filled);
  assert.equal(await d.metric('render_failures_total'), 0);
  await d.stop();
});

test('a volume removed while it is prepared leaves nothing behind', async () => {
  const d = await Daemon.start({ ball: false });
  for (let i = 0; i < (SANITIZED ? 3 : 8); i++) {
    await d.post('/v1/volumes', { id: 'head', path: 'demo:head' });
    await d.resident('head');
    await d.call('DELETE', '/v1/volumes/head');
  }
  await until(async () => {
    const { volumes, pinned, caches } = await used(d);
    return volumes === 0 && pinned === 0 && caches < 4 << 20; /* tables of the removed volumes remain */
  });
  await d.stop();
});

test('a preparation that lacks memory gives up: no volume is dropped for it, and it is no failure', async () => {
  const bare = await Daemon.start({ ball: false });
  const { program } = await used(bare);
  await bare.stop();
  const d = await Daemon.start({ ball: false, config: `[limits]\nmemory_bytes=${program + 54 * MB}\nvolume_bytes=${52 * MB}\n` });
  for (const id of ['one', 'other']) {
    const slices = await d.metric('slices_total{class="refine"}');
    await d.post('/v1/volumes', { id, path: 'demo:head' });
    await d.resident(id);
    await until(async () => (await d.metric('slices_total{class="refine"}')) > slices);
  }
  await sleep(100);
  for (const id of ['one', 'other']) await d.resident(id);
  assert.equal(await d.metric('render_failures_total'), 0);
  await d.stop();
});
