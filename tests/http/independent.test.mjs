// Clients that are not ours: python3-websocket for the stream, curl for HTTP.
import assert from 'node:assert/strict';
import { execFile, spawnSync } from 'node:child_process';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { promisify } from 'node:util';
import { Daemon } from '../support/daemon.mjs';

const PYTHON = '/usr/bin/python3'; // Debian's, whose packages it sees
const call = promisify(execFile);
const has = (program, ...args) => spawnSync(program, args).status === 0;

let d;
before(async () => { d = await Daemon.start(); });
after(() => d.stop());

test('python3-websocket connects, patches, acknowledges, pings and closes', async (t) => {
  if (!has(PYTHON, '-c', 'import websocket')) return t.skip('python3-websocket is not installed');
  const { id } = await d.session();
  const script = join(import.meta.dirname, '../support/independent.py');
  const { stdout } = await call(PYTHON, [script, `ws://127.0.0.1:${d.port}/v1/sessions/${id}/stream`, '20'], { timeout: 60000 });
  const { last, frames, version, ...rest } = JSON.parse(stdout);
  assert.deepEqual(rest, { subprotocol: 'tomocast.v1', hello: 'hello', pong: 'are you there', close: 1000 });
  assert.deepEqual([last.seq, last.final], [20, true]);
  assert.ok(frames >= 1 && frames <= 22, `${frames} frames`);
});

test('curl: keep-alive, HEAD, chunks, 100-continue, HTTP/1.0', async (t) => {
  if (!has('curl', '--version')) return t.skip('curl is not installed');
  const url = (path) => `${d.base}${path}`;
  const curl = async (...args) => (await call('curl', ['-sS', '-o', '/dev/null', '-w', '%{http_code} %{num_connects}\n', ...args], { timeout: 60000 })).stdout.trim().split('\n');
  assert.deepEqual(await curl(url('/healthz'), '-o', '/dev/null', url('/v1/about')), ['200 1', '200 0'], 'one connection');
  assert.deepEqual(await curl('-I', url('/healthz')), ['200 1']);
  assert.deepEqual(await curl('-0', url('/healthz')), ['200 1']);
  assert.deepEqual(await curl('--http2', url('/healthz')), ['200 1'], 'its offer to upgrade is ignored');
  const body = ['-H', 'Content-Type: application/json', '-d', '{"volume":"ball","scene":{"image":{"width":16,"height":16}}}'];
  assert.deepEqual(await curl('-H', 'Transfer-Encoding: chunked', ...body, url('/v1/render')), ['200 1']);
  assert.deepEqual(await curl('-H', 'Expect: 100-continue', ...body, url('/v1/render')), ['200 1']);
  assert.deepEqual(await curl('-T', join(d.folder, 'ball.nrrd'), url('/v1/volumes/again')), ['202 1']);
  assert.deepEqual(await curl('-H', 'Content-Length: 3', '-H', 'Transfer-Encoding: chunked', ...body, url('/v1/render')), ['400 1']);
});
