// Starting and stopping: the command line, the drain, what happens to work under way.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, renameSync, rmSync, writeFileSync } from 'node:fs';
import net from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';
import { gzipSync } from 'node:zlib';
import { BINARY, Daemon, problem, sleep } from '../support/daemon.mjs';
import { Ws } from '../support/ws.mjs';

const run = (...args) => spawnSync(BINARY, ['serve', ...args], { encoding: 'utf8', timeout: 20000 });

test('bad usage exits 2 with one line', () => {
  const folder = mkdtempSync(join(tmpdir(), 'tomocast-test-'));
  const config = join(folder, 'config');
  const wrong = (text) => { writeFileSync(config, text); return ['--config', config]; };
  for (const args of [['--listen', 'nonsense'], ['--listen', '127.0.0.1:99999'], ['--volume', 'noequals'], ['--volume', 'a b=x'], ['--backend', 'quantum'],
    ['--data', '/does/not/exist'], ['--no-such-option'], ['stray'], ['--volume', 'a=demo:head', '--volume', 'a=demo:head'], ['--config', '/does/not/exist'],
    wrong('[limits]\nsessions=0\n'), wrong('[limits]\nnonsense=1\n'), wrong('[other]\n'), wrong('[server]\nlisten=x\n'), wrong('sessions')]) {
    const { status, stderr, stdout } = run(...args);
    assert.equal(status, 2, `${args}: ${stderr}`);
    assert.match(stderr, /^tomocast serve: [^\n]+\n$/, `${args}`);
    assert.equal(stdout, '');
  }
  rmSync(folder, { recursive: true });
});

test('an address that is taken exits 1', async () => {
  const d = await Daemon.start({ ball: false });
  const { status, stderr } = run('--listen', `127.0.0.1:${d.port}`);
  assert.equal(status, 1);
  assert.match(stderr, /tomocast serve: listen on [^\n]*in use/);
  await d.stop();
});

test('a volume without an ID gets one that says nothing of its file', async () => {
  const folder = mkdtempSync(join(tmpdir(), 'tomocast-test-'));
  const path = join(folder, 'DOE_JANE.nrrd');
  writeFileSync(path, `NRRD0004\ntype: uint8\ndimension: 3\nsizes: 8 8 8\nencoding: raw\n\n${'x'.repeat(512)}`);
  const d = await Daemon.start({ ball: false, args: [path, 'demo:bucky'] });
  await d.resident('volume-1');
  await d.resident('bucky');
  assert.doesNotMatch(JSON.stringify((await d.get('/v1/volumes')).json), /JANE/);
  await d.stop();
  assert.doesNotMatch(d.stderr, /JANE/);
  rmSync(folder, { recursive: true });
});

test('a volume of the command line that does not load is told why, in one line', async () => {
  const d = await Daemon.start({ ball: false, args: ['--volume', 'ct=/does/not/doe.nii', '--volume', 'sound=demo:bucky'] });
  await d.resident('sound');
  assert.equal((await d.get('/v1/volumes/ct')).json.reason, 'open ct: no such file or folder');
  await d.stop();
  const lines = d.stderr.split('\n').filter((line) => line.includes('volume.failed'));
  assert.equal(lines.length, 1);
  assert.match(lines[0], /warn volume\.failed code=\d+ reason=open ct: no such file or folder$/);
});

test('it serves with no volume at all', async () => {
  const d = await Daemon.start({ ball: false });
  assert.deepEqual((await d.get('/v1/volumes')).json.volumes, []);
  assert.equal((await d.get('/readyz')).status, 200);
  await d.stop('SIGINT');
});

test('a volume of the command line that fails is shown as failed, without its path', async () => {
  const d = await Daemon.start({ ball: false, args: ['--volume', 'lost=/does/not/exist.nrrd'] });
  const json = await d.loaded('/v1/volumes/lost');
  assert.equal(json.state, 'failed');
  assert.doesNotMatch(json.reason, /does\/not/);
  await d.stop();
});

test('the drain: not ready, no new sessions, streams closed with 1001, renders finished, exit 0', async () => {
  const d = await Daemon.start({ config: '[server]\ndrain_seconds=2\n' });
  const session = await d.session();
  const ws = await Ws.open(d, session.id);
  await ws.nextFrame();
  const mjpeg = await fetch(d.base + session.links.mjpeg);
  const render = d.post('/v1/render', { volume: 'ball', scene: { image: { width: 800, height: 800 }, sampling: { step: 0.1 } } });
  await sleep(100);
  d.process.kill('SIGTERM');
  assert.equal((await ws.ended).code, 1001);
  problem(await d.get('/readyz'), 503);
  assert.equal((await d.get('/healthz')).status, 200);
  problem(await d.post('/v1/sessions', { volume: 'ball' }), 503);
  assert.equal((await render).status, 200);
  await mjpeg.arrayBuffer().catch(() => {});
  await d.stop();
});

test('a stop in the midst of everything is clean', async () => {
  const d = await Daemon.start();
  const session = await d.session({ image: { width: 1500, height: 1500 }, sampling: { step: 0.05 } });
  const streams = await Promise.all([0, 1, 2].map(() => Ws.open(d, session.id, { autoAck: false })));
  streams[0].patch(1, { camera: { fovY: 15 } });
  const lost = [d.get(session.links.frame), d.post('/v1/volumes', { id: 'head', path: 'demo:head' }), d.get('/v1/volumes/ball/histogram')]
    .map((promise) => promise.catch(() => {}));
  streams[1].cut();
  await sleep(50);
  d.process.kill('SIGTERM');
  d.process.kill('SIGTERM');
  await d.stop();
  await Promise.all(lost);
});

/** Renders that take minutes, a line of others, an upload that stands still, an import: all at once. */
async function busy() {
  const zeros = gzipSync(Buffer.alloc(256 ** 3 * 2));
  const head = 'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 256 256 512\nencoding: gzip\n\n';
  const d = await Daemon.start({ args: ['--volume', 'head=demo:head'], files: { 'zeros.nrrd': Buffer.concat([Buffer.from(head), zeros]) } });
  await d.resident('head');
  const monster = { image: { width: 8192, height: 2000 }, filter: 'cubic', sampling: { step: 0.1, raysPerPixel: 16 }, shading: { model: 'blinn-phong', gradient: 'cubic' } };
  const { json } = await d.post('/v1/sessions', { volume: 'head', scene: monster });
  const lost = [d.get(json.links.frame), d.post('/v1/volumes', { id: 'zeros', path: 'zeros.nrrd' })];
  for (let i = 0; i < 20; i++) lost.push(d.post('/v1/render', { volume: 'head', scene: { image: { width: 1024, height: 1024 }, sampling: { step: 0.1 } } }));
  const ws = await Ws.open(d, json.id);
  ws.patch(1, { camera: { fovY: 15 } });
  const upload = net.connect(d.port, '127.0.0.1', () => upload.write(`PUT /v1/volumes/half HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\nContent-Type: application/octet-stream\r\nContent-Length: 100000\r\n\r\n${'x'.repeat(50000)}`));
  upload.on('error', () => {});
  for (const promise of lost) promise.catch(() => {});
  await sleep(300);
  return d;
}

test('uploads under way are answered with 503, and hold up no end', async () => {
  const d = await Daemon.start({ ball: false });
  const put = (id, everyMs) => new Promise((resolve) => {
    let text = '';
    const socket = net.connect(d.port, '127.0.0.1', () =>
      socket.write(`PUT /v1/volumes/${id} HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\nContent-Type: application/octet-stream\r\nContent-Length: 1000000000\r\n\r\n${'x'.repeat(50000)}`));
    const timer = setInterval(() => socket.write('x'.repeat(10000)), everyMs);
    socket.on('data', (piece) => (text += piece));
    socket.on('error', () => {});
    socket.on('close', () => { clearInterval(timer); resolve(text); });
  });
  const uploads = [put('stands', 1e9), put('flows', 20)];
  while ((await d.metric('upload_bytes_total')) < 120000) await sleep(20);
  const began = performance.now();
  d.process.kill('SIGTERM');
  for (const text of await Promise.all(uploads)) assert.match(text, /^HTTP\/1\.1 503 [^]*retry-after: \d[^]*problem:draining/i);
  await d.stop();
  assert.ok(performance.now() - began < 10000);
});

test('it ends within 10 s whatever is under way', async () => {
  const d = await busy();
  const began = performance.now();
  await d.stop();
  console.log(`ended after ${((performance.now() - began) / 1000).toFixed(1)} s`);
  assert.ok(performance.now() - began < 10000);
});

test('a second signal ends it at once', async () => {
  const d = await busy();
  const began = performance.now();
  d.process.kill('SIGTERM');
  await sleep(100);
  await d.stop();
  console.log(`ended after ${((performance.now() - began) / 1000).toFixed(1)} s`);
  assert.ok(performance.now() - began < 3000);
});

test('SIGHUP opens the log anew, and ends nothing', async () => {
  const folder = mkdtempSync(join(tmpdir(), 'tomocast-test-')), log = join(folder, 'log');
  const d = await Daemon.start({ ball: false, args: ['--log', log] });
  while (!existsSync(log) || !readFileSync(log, 'utf8').includes('serve.start')) await sleep(20);
  renameSync(log, `${log}.1`);
  d.process.kill('SIGHUP');
  while (!existsSync(log)) await sleep(20);
  assert.equal((await d.get('/healthz')).status, 200);
  await d.stop();
  assert.match(readFileSync(log, 'utf8'), /serve\.stop/);
  assert.doesNotMatch(readFileSync(`${log}.1`, 'utf8'), /serve\.stop/);
  rmSync(folder, { recursive: true });
});
