// How connections end: who goes on writing after a refusal reads it; who does not come to an end is told so.
import assert from 'node:assert/strict';
import { execFile, spawnSync } from 'node:child_process';
import { mkdtempSync, readdirSync, rmSync, writeFileSync } from 'node:fs';
import net from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { promisify } from 'node:util';
import { BINARY, Daemon, until } from '../support/daemon.mjs';
import { replies } from '../support/http.mjs';

let d;
before(async () => { d = await Daemon.start({ ball: false, config: '[server]\nhosts=127.0.0.1\n[limits]\nupload_bytes=1000000\nbody_bytes=100000\n' }); begin(); });
after(() => d.stop());

const host = 'Host: 127.0.0.1\r\n', json = 'Content-Type: application/json\r\n';
const MB = 1 << 20;

/** Writes all of `head` and then `count` times `piece`, and reads only then. */
const stubborn = (head, piece, count) => new Promise((resolve) => {
  const socket = net.connect({ port: d.port, host: '127.0.0.1', allowHalfOpen: true });
  const pieces = [];
  let failure = null, written = 0;
  socket.pause();
  socket.on('error', ({ code }) => (failure = code));
  socket.on('data', (bytes) => pieces.push(bytes));
  socket.on('end', () => socket.end());
  socket.on('close', () => resolve({ failure, written, bytes: Buffer.concat(pieces) }));
  const next = (error) => {
    if (error) return;
    if (written++ < count) socket.write(piece, next);
    else socket.resume();
  };
  socket.write(head, 'latin1', next);
});

// Two wait for ten seconds: they begin before all others, and are asked about last.
let dripped, vanished;
function begin() {
  dripped = drip();
  vanished = vanish();
  for (const promise of [dripped, vanished]) promise.catch(() => {});
}

/** Sends headers without an end. @returns seconds until the connection was closed */
const drip = () => new Promise((resolve, reject) => {
  const began = performance.now();
  const socket = net.connect(d.port, '127.0.0.1', () => socket.write(`GET / HTTP/1.1\r\n${host}`));
  const more = setInterval(() => socket.write('X-More: 1\r\n'), 500);
  const late = setTimeout(() => socket.destroy(new Error('still open')), 25000);
  let failure;
  socket.on('error', (error) => (failure = error));
  socket.on('close', () => {
    clearInterval(more);
    clearTimeout(late);
    if (failure?.message === 'still open') reject(failure);
    else resolve((performance.now() - began) / 1000);
  });
  socket.resume();
});

/** In a network of its own that goes away for some seconds: no FIN, no reset, nothing that answers. @returns viewers left */
async function vanish() {
  const alone = (...command) => ['unshare', ['-n', ...command]];
  if (spawnSync(...alone('sh', '-c', 'ip link set lo up && curl --version')).status !== 0) return null;
  const script = `
    ip link set lo up
    "$0" serve --listen 127.0.0.1:8080 --config "$1/config" --volume v=demo:marschner-lobb >&2 & daemon=$!
    at=http://127.0.0.1:8080
    session() { curl -s $at/v1/sessions -H 'content-type: application/json' -d '{"volume":"v","scene":{"image":{"width":64,"height":64}}}' | sed -n 's/.*"id":"\\([0-9a-f]*\\)".*/\\1/p'; }
    viewers() { curl -s $at/metrics | sed -n 's/^tomocast_mjpeg_clients //p'; }
    until id=$(session); [ -n "$id" ]; do sleep 0.1; done
    curl -sN $at/v1/sessions/$id/stream.mjpeg >/dev/null & viewer=$!
    until [ "$(viewers)" = 1 ]; do sleep 0.1; done
    sleep 1
    ip link set lo down; sleep 9; ip link set lo up
    viewers
    kill $viewer $daemon; wait $daemon`;
  const folder = mkdtempSync(join(tmpdir(), 'tomocast-test-'));
  writeFileSync(join(folder, 'config'), '[limits]\nblocked_seconds=2\n');
  try {
    return (await promisify(execFile)(...alone('sh', '-c', script, BINARY, folder), { timeout: 60000 })).stdout;
  } finally {
    rmSync(folder, { recursive: true });
  }
}

const zeros = Buffer.alloc(MB), chunk = Buffer.concat([Buffer.from(`${MB.toString(16)}\r\n`), zeros, Buffer.from('\r\n')]);
const cases = [
  ['a length over the limit', `PUT /v1/volumes/a HTTP/1.1\r\n${host}Content-Length: ${50 * MB}\r\n\r\n`, zeros, 413],
  ['two lengths', `PUT /v1/volumes/a HTTP/1.1\r\n${host}Content-Length: 1\r\nContent-Length: ${50 * MB}\r\n\r\n`, zeros, 400],
  ['no request at all', '', zeros, 400],
  ['another type', `POST /v1/render HTTP/1.1\r\n${host}Content-Length: ${50 * MB}\r\n\r\n`, zeros, 415],
  ['a path that is not there', `PUT /v1/nothing HTTP/1.1\r\n${host}Transfer-Encoding: chunked\r\n\r\n`, chunk, 404],
  ['an upload in chunks over the limit', `PUT /v1/volumes/a HTTP/1.1\r\n${host}Transfer-Encoding: chunked\r\n\r\n`, chunk, 413],
  ['a body in chunks over the limit', `POST /v1/render HTTP/1.1\r\n${host}${json}Transfer-Encoding: chunked\r\n\r\n`, chunk, 413],
  ['chunks that are none', `PUT /v1/volumes/a HTTP/1.1\r\n${host}Transfer-Encoding: chunked\r\n\r\n`, zeros, 400],
  ['a body that nobody asked for', `GET /healthz HTTP/1.1\r\n${host}Content-Length: ${50 * MB}\r\n\r\n`, zeros, 413],
];

for (const [what, head, piece, status] of cases) {
  test(`9112 9.6: who writes 50 MB to the end reads the refusal: ${what}`, async () => {
    const { failure, written, bytes } = await stubborn(head, piece, 50);
    assert.equal(failure, null, `after ${written} of 50 pieces`);
    const [reply, ...more] = replies(bytes);
    assert.deepEqual([reply.status, more.length], [status, 0]);
    assert.equal(reply.headers.connection, 'close');
    assert.match(reply.headers['content-type'], /^application\/problem\+json/);
    assert.equal(JSON.parse(reply.body).status, status);
    assert.equal(reply.headers['x-content-type-options'], 'nosniff');
    assert.ok(reply.headers.date);
  });
}

test('9110 9.3.2: a refusal in the middle of what comes with a HEAD has no body', async () => {
  const { bytes } = await stubborn(`HEAD /healthz HTTP/1.1\r\n${host}Content-Length: ${50 * MB}\r\n\r\n`, zeros, 50);
  const [reply, ...more] = replies(bytes, ['HEAD']);
  assert.deepEqual([reply.status, more.length], [413, 0]);
  assert.ok(Number(reply.headers['content-length']) > 0);
});

test('nobody lingers for ever: many who never close, and one who never stops writing', async () => {
  const open = () => readdirSync(`/proc/${d.process.pid}/fd`).length;
  const before = open();
  const refused = `GET / HTTP/1.1\r\n${host}${host}\r\n`;
  const sockets = Array.from({ length: 100 }, () => net.connect({ port: d.port, host: '127.0.0.1', allowHalfOpen: true }));
  let ended = 0;
  for (const socket of sockets) {
    socket.on('error', () => {});
    socket.on('end', () => ended++);
    socket.resume();
    socket.write(refused);
  }
  const endless = net.connect({ port: d.port, host: '127.0.0.1', allowHalfOpen: true });
  const cut = new Promise((resolve) => endless.on('error', resolve));
  const next = (error) => { if (!error) endless.write(zeros, next); };
  endless.resume();
  endless.write(refused, next);
  assert.match((await cut).code, /ECONNRESET|EPIPE/);
  await until(() => ended === 100); // each is told that nothing more comes
  assert.ok(open() < before + 80, `${open()} descriptors, ${before} before`);
  sockets.forEach((socket) => socket.destroy());
  assert.equal((await d.get('/healthz')).status, 200);
});

/** Sends `bytes` and the end of all that is sent in one go. */
const farewell = (bytes) => new Promise((resolve) => {
  const began = Date.now(), pieces = [];
  const socket = net.connect({ port: d.port, host: '127.0.0.1', allowHalfOpen: true }, () => socket.end(bytes, 'latin1'));
  socket.on('error', () => {});
  socket.on('data', (piece) => pieces.push(piece));
  socket.on('close', () => resolve({ seconds: (Date.now() - began) / 1000, bytes: Buffer.concat(pieces) }));
});

test('9112 9.6: who sends nothing more after a request is answered', async () => {
  assert.equal(replies((await farewell(`GET /healthz HTTP/1.1\r\n${host}\r\n`)).bytes)[0].status, 200);
});

test('9112 8: who leaves within a body is not waited for', async () => {
  for (const head of [`POST /v1/render HTTP/1.1\r\n${host}${json}`, `PUT /v1/volumes/left HTTP/1.1\r\n${host}`]) {
    const { seconds } = await farewell(`${head}Content-Length: 10\r\n\r\n{}`);
    assert.ok(seconds < 15, `${seconds} s`); // an idle connection has 30
  }
});

test('a sender whose headers drip is cut off', async () => {
  const seconds = await dripped;
  assert.ok(seconds > 5 && seconds < 20, `${seconds} s`);
});

test('an MJPEG viewer that vanishes without a word, while no pictures flow, is ended', async (t) => {
  const left = await vanished;
  if (left === null) return t.skip('no network of its own may be made');
  assert.equal(left, '0\n');
});
