// Uploads and loads that would take more than their share: slow, many, large when decoded, abandoned, left by a crash.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdirSync, mkdtempSync, readdirSync, rmSync, writeFileSync } from 'node:fs';
import http from 'node:http';
import net from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';
import { ballNrrd, Daemon, problem, sleep, until } from '../support/daemon.mjs';

const folder = () => mkdtempSync(join(tmpdir(), 'tomocast-spool-'));
const uploads = (spool) => readdirSync(spool).filter((name) => name.startsWith('tomocast-upload-'));
const upload = (d, id, body) => d.call('PUT', `/v1/volumes/${id}`, { body, type: 'application/octet-stream' });

const settled = (d, id) => d.loaded(`/v1/volumes/${id}`);

/** A socket that has begun an upload and sent a byte. */
function dripping(d, id, length = 100000, headers = '') {
  const socket = net.connect(d.port, '127.0.0.1');
  socket.text = '';
  socket.on('data', (bytes) => (socket.text += bytes));
  socket.on('error', () => {});
  socket.gone = new Promise((resolve) => socket.on('close', resolve));
  socket.write(`PUT /v1/volumes/${id} HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\nContent-Length: ${length}\r\n${headers}\r\nN`);
  return socket;
}

let stream; // of 45 MB of zeros, in 50 bytes or so
function bomb(sizes, streams = 280, lines = '') {
  stream ??= execFileSync('python3', ['-c', 'import bz2,sys; sys.stdout.buffer.write(bz2.compress(bytes(45000000)))']);
  const header = `NRRD0004\ntype: uint8\ndimension: 3\nsizes: ${sizes}\nencoding: bzip2\n${lines}\n`;
  return Buffer.concat([Buffer.from(header), ...Array(streams).fill(stream)]);
}

test('an upload slower than the rate is closed with 408, a fast one is not', async () => {
  const spool = folder();
  const d = await Daemon.start({ ball: false, config: `[limits]\nupload_grace_seconds=2\nupload_rate=1000\n[server]\nspool=${spool}\n` });
  const slow = dripping(d, 'slow'), began = Date.now();
  const drip = setInterval(() => slow.write('.'), 500);
  const fast = dripping(d, 'fast', 1000000);
  const flow = setInterval(() => fast.write(Buffer.alloc(1500)), 250);
  await slow.gone;
  clearInterval(drip);
  assert.match(slow.text, /^HTTP\/1\.1 408 [^]*Content-Security-Policy: default-src[^]*problem:slow.*minimum rate, which \/v1\/about shows"\}$/);
  assert.ok(Date.now() - began < 15000);
  await sleep(1000);
  assert.equal(fast.text, '');
  clearInterval(flow);
  fast.destroy();
  await until(() => uploads(spool).length === 0);
  await d.stop();
  rmSync(spool, { recursive: true });
});

test('uploads are bounded for a client and for all; with as many connections as there may be lookups are answered', async () => {
  const spool = folder();
  const d = await Daemon.start({ config: `[limits]\nclients=1\nuploads_per_client=5\n[server]\nspool=${spool}\n` });
  const sockets = [];
  for (let i = 0; i < 513; i++) sockets.push(dripping(d, `u${i}`));
  await until(() => sockets.filter((s) => /^HTTP\/1\.1 503 /.test(s.text)).length > 40);
  const began = Date.now();
  assert.equal((await d.get('/healthz')).status, 200);
  assert.ok(Date.now() - began < 10000, `${Date.now() - began} ms`);
  assert.equal(uploads(spool).length, 5);
  const refused = sockets.find((s) => /^HTTP\/1\.1 503 /.test(s.text));
  assert.match(refused.text, /retry-after: \d/i);
  sockets.forEach((socket) => socket.destroy());
  await until(() => uploads(spool).length === 0);
  await d.stop();
  rmSync(spool, { recursive: true });
});

test('who holds connections open keeps nobody else out', async () => {
  const d = await Daemon.start({ config: '[limits]\nclients=1\n' });
  const { port } = d;
  const held = [], times = [];
  for (const localAddress of ['127.0.0.1', '127.0.0.3', '127.0.0.3']) { // two of them together, again and again
    const began = Date.now();
    let refused = 0;
    held.push(...Array.from({ length: 600 }, () => net.connect({ port, host: '127.0.0.1', localAddress }).on('error', () => {}).on('close', () => refused++)));
    await until(() => refused > 40);
    times.push(Date.now() - began);
  }
  const ask = (path) => new Promise((resolve, reject) => {
    http.get({ port, path, host: '127.0.0.1', localAddress: '127.0.0.2', agent: false }, (reply) => resolve(reply.resume().statusCode))
      .on('error', reject).setTimeout(5000, () => reject(new Error('no answer')));
  });
  assert.deepEqual([await ask('/v1/volumes'), await ask('/healthz')], [200, 200]);
  assert.ok(Math.max(...times) < 5000 + 4 * times[0], `${times} ms: accepted or refused at once, not when idle ones end after 10 s`);
  held.forEach((socket) => socket.destroy());
  await d.stop();
});

test('behind a trusted proxy it is what the proxy says that counts, elsewhere it is not', async () => {
  const spool = folder();
  const rows = (names) => ['Expect: 100-continue', ...names].map((name) => (name ? `${name}\r\n` : '')).join('');
  const from = async (d, ...names) => {
    const socket = dripping(d, `v${from.count = (from.count ?? 0) + 1}`, 100000, rows(names));
    await until(() => socket.text);
    return { 100: 'its own', 503: 'full' }[/^HTTP\/1\.1 (\d+) /.exec(socket.text)[1]];
  };
  const config = `[limits]\nuploads_per_client=1\nupload_grace_seconds=600\n[server]\nspool=${spool}\n`;
  const behind = await Daemon.start({ ball: false, args: ['--trusted-proxy', '127.0.0.0/8', '--trusted-proxy', '192.0.2.9'], config });
  assert.equal(await from(behind, 'X-Forwarded-For: 203.0.113.1'), 'its own');
  assert.equal(await from(behind, 'X-Forwarded-For: 203.0.113.1'), 'full');
  assert.equal(await from(behind, 'X-Forwarded-For: 203.0.113.2, 192.0.2.9'), 'its own');
  assert.equal(await from(behind, 'X-Forwarded-For: 203.0.113.99', 'X-Forwarded-For: 203.0.113.2'), 'full', 'the line that the proxy added');
  assert.equal(await from(behind, 'Forwarded: for=203.0.113.99, For="[2001:db8::7]:80";proto=https'), 'its own');
  assert.equal(await from(behind, 'Forwarded: for="[2001:db8::8]"'), 'full', 'the same network');
  assert.equal(await from(behind, 'X-Forwarded-For: unknown'), 'its own', "the proxy's");
  for (const none of ['X-Forwarded-For: \x80]', 'Forwarded: ;;=,', `X-Forwarded-For: ${','.repeat(5000)}`, 'X-Forwarded-For:', ''])
    assert.equal(await from(behind, none), 'full', "the proxy's");
  assert.equal(await from(behind, 'X-Forwarded-For: 203.0.113.3', 'Forwarded: for=203.0.113.4'), 'full', 'one of them is not by the proxy');
  await behind.stop();
  const alone = await Daemon.start({ ball: false, config });
  assert.equal(await from(alone, 'X-Forwarded-For: 203.0.113.1'), 'its own');
  assert.equal(await from(alone, 'X-Forwarded-For: 203.0.113.2'), 'full');
  await alone.stop();
  await assert.rejects(Daemon.start({ args: ['--trusted-proxy', '10.0.0.0/33'] }), /ended with 2.*trusted proxy 10\.0\.0\.0\/33: give ADDR/s);
  rmSync(spool, { recursive: true });
});

test('the spool is bounded in bytes', async () => {
  const spool = folder();
  const d = await Daemon.start({ ball: false, config: `[limits]\nspool_bytes=100000\n[server]\nspool=${spool}\n` });
  const held = dripping(d, 'held', 80000);
  held.write(Buffer.alloc(70000));
  await until(async () => (await d.metric('upload_bytes_total')) > 60000);
  problem(await upload(d, 'other', ballNrrd(40)), 503);
  held.destroy();
  await until(() => uploads(spool).length === 0);
  assert.equal((await until(async () => { const r = await upload(d, 'other', ballNrrd(40)); return r.status === 202 && r; })).status, 202);
  await settled(d, 'other');
  await d.stop();
  rmSync(spool, { recursive: true });
});

test('a spool folder that is not there is warned of at start, and named when an upload fails', async () => {
  const d = await Daemon.start({ ball: false, config: `[server]\nspool=/nowhere/spool\n` });
  await d.logged(/spool\.unusable text="uploads fail until the spool folder can be written" folder=\/nowhere\/spool reason="No such file/);
  const { detail } = problem(await upload(d, 'a', ballNrrd(8)), 500);
  assert.match(detail, /the spool folder takes no file: No such file/);
  assert.doesNotMatch(detail, /nowhere/);
  await d.stop();
});

test('a full disk under the spool is a 503 that says so', async (t) => {
  const spool = folder();
  try {
    execFileSync('mount', ['-t', 'tmpfs', '-o', 'size=64k', 'tmpfs', spool], { stdio: 'ignore' });
  } catch {
    rmSync(spool, { recursive: true });
    return t.skip('a small file system cannot be mounted here');
  }
  try {
    const d = await Daemon.start({ ball: false, config: `[server]\nspool=${spool}\n` });
    const { detail } = problem(await upload(d, 'large', ballNrrd(64)), 503);
    assert.match(detail, /the disk of the server's spool folder is full/);
    await until(() => uploads(spool).length === 0);
    assert.equal((await upload(d, 'small', ballNrrd(16))).status, 202);
    await d.resident('small');
    await d.stop();
  } finally {
    execFileSync('umount', ['-l', spool]);
    rmSync(spool, { recursive: true });
  }
});

test('what a crash left in the spool is swept; what another daemon uses is not', async () => {
  const spool = folder(), config = `[server]\nspool=${spool}\n`;
  const first = await Daemon.start({ ball: false, config });
  const open = dripping(first, 'open');
  await until(() => uploads(spool).length === 1);
  const [living] = uploads(spool);
  const second = await Daemon.start({ ball: false, config });
  const lost = dripping(second, 'lost');
  await until(() => uploads(spool).length === 2);
  second.process.kill('SIGKILL');
  await second.ended;
  lost.destroy();
  rmSync(second.folder, { recursive: true, force: true });
  writeFileSync(join(spool, 'tomocast-upload-older'), 'a file of an earlier version');
  writeFileSync(join(spool, 'something-else'), 'not ours');
  mkdirSync(join(spool, 'tomocast-other'));
  assert.equal(uploads(spool).length, 3);
  const third = await Daemon.start({ ball: false, config });
  assert.deepEqual(uploads(spool), [living]);
  assert.deepEqual(readdirSync(spool).filter((name) => !name.startsWith('tomocast-upload-')), ['something-else', 'tomocast-other']);
  open.destroy();
  await third.stop();
  await first.stop();
  rmSync(spool, { recursive: true });
});

test('an upload that names a file reads no other one, wherever the name stands', async () => {
  const d = await Daemon.start({ ball: false });
  const names = 'type: uint8\ndimension: 3\nsizes: 1 1 4\nencoding: raw\ndata file: ';
  for (const text of [`NRRD0004\n#\0\n${names}upload\n\n`, `NRRD0004\n${'# padding of a header\n'.repeat(20000)}${names}upload\n\n`,
    `NRRD0004\n${names}./upload\n\n`, `NRRD0004\n#\0\n${names}LIST\nupload\n`,
    `ObjectType = Image\nComment = \0\nNDims = 3\nDimSize = 1 1 4\nElementType = MET_UCHAR\nElementDataFile = upload\n`]) {
    assert.equal((await upload(d, 'spy', Buffer.from(text, 'latin1'))).status, 202);
    const volume = await settled(d, 'spy');
    assert.equal(volume.state, 'failed');
    assert.match(volume.reason, /names another file/);
  }
  await d.stop();
});

test('files that decode to far more than they say, or to more than there may be, keep nobody waiting', async () => {
  const d = await Daemon.start({ ball: false, files: { 'ball.nrrd': ballNrrd(16) }, config: '[limits]\nvolume_bytes=600000000\n' });
  await upload(d, 'large', bomb('1200 1200 1000'));
  assert.match((await settled(d, 'large')).reason, /limit of|all volumes together/);
  await upload(d, 'lead', bomb('4 4 4', 280, 'byte skip: 12000000000\n'));
  assert.match((await settled(d, 'lead')).reason, /256 MiB/);
  for (const id of ['a', 'b', 'c', 'd']) assert.equal((await upload(d, id, bomb('800 800 400'))).status, 202);
  const began = Date.now();
  await d.post('/v1/volumes', { id: 'ball', path: 'ball.nrrd' });
  const seen = await settled(d, 'ball');
  assert.notEqual(seen.state, 'loading');
  const waited = Date.now() - began;
  for (const id of ['a', 'b', 'c', 'd']) assert.equal((await d.delete(`/v1/volumes/${id}`)).status, 204);
  await until(async () => (await d.metric('memory_bytes{kind="loads"}')) === 0, 10);
  console.log(`waited ${waited} ms`);
  await d.stop();
});

test('a long import ends with its DELETE, with its deadline and with the daemon', async () => {
  const d = await Daemon.start({ ball: false, config: '[limits]\nimport_seconds=2\nvolume_bytes=1500000000\nmemory_bytes=2000000000\n' });
  // An int that is read twice: 1.2 GB and again.
  const wide = Buffer.concat([Buffer.from('NRRD0004\ntype: int32\nendian: little\ndimension: 3\nsizes: 1000 1000 300\nencoding: bzip2\n\n'), bomb('1 1 1').subarray(bomb('1 1 1', 0).length)]);
  await upload(d, 'long', wide);
  const long = await settled(d, 'long');
  assert.equal(long.state, 'failed');
  assert.match(long.reason, /longer than 2 seconds/);
  await upload(d, 'gone', wide);
  await until(async () => (await d.metric('memory_bytes{kind="loads"}')) > 0, 10);
  const began = Date.now();
  assert.equal((await d.delete('/v1/volumes/gone')).status, 204);
  await until(async () => (await d.metric('memory_bytes{kind="loads"}')) === 0, 10);
  console.log(`deleted in ${Date.now() - began} ms`);
  await upload(d, 'last', wide);
  await sleep(100);
  const term = Date.now();
  await d.stop();
  console.log(`stopped in ${Date.now() - term} ms`);
  assert.ok(Date.now() - term < 8000);
});

test('failed volumes age and are bounded; loads that wait are too, and go with their DELETE', async () => {
  const d = await Daemon.start({ ball: false, files: { 'broken.nrrd': 'NRRD0004\n' }, config: '[limits]\nfailed_entries=20\nfailed_seconds=2\nloads_per_client=8\nvolume_bytes=1000000000\nmemory_bytes=1500000000\n' });
  for (let i = 0; i < 60; i++)
    await until(async () => (await d.post('/v1/volumes', { id: `f${i}`, path: 'broken.nrrd' })).status === 202);
  // What fails at once is bounded by the limit and the loads of one client, not by what fits between two looks at its age.
  for (let i = 0; i < 300; i++) {
    await d.post('/v1/volumes', { id: `g${i}`, path: 'demo:nothing' });
    if (i % 50 === 49) {
      const { volumes } = (await d.get('/v1/volumes')).json;
      assert.ok(volumes.length > 0 && volumes.length <= 28, `${volumes.length} of ${i}`);
    }
  }
  await until(async () => { const { volumes } = (await d.get('/v1/volumes')).json; return volumes.length > 0 && volumes.length <= 20; });
  await until(async () => (await d.get('/v1/volumes')).json.volumes.length === 0, 15);
  const statuses = [];
  for (let i = 0; i < 10; i++) statuses.push((await upload(d, `w${i}`, bomb('1000 1000 300'))).status);
  assert.deepEqual(statuses.slice(0, 8), Array(8).fill(202));
  assert.deepEqual(statuses.slice(8), [503, 503]);
  for (let i = 7; i >= 0; i--) assert.equal((await d.delete(`/v1/volumes/w${i}`)).status, 204);
  await until(async () => (await d.get('/v1/volumes')).json.volumes.length === 0);
  await until(async () => (await upload(d, 'again', ballNrrd(8))).status === 202);
  assert.equal((await settled(d, 'again')).state, 'resident');
  await d.stop();
});
