// Tokens as time goes by: a file that is read again, tokens that are guessed; and who may read the metrics.
import assert from 'node:assert/strict';
import { mkdtempSync, writeFileSync } from 'node:fs';
import http from 'node:http';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';
import { Daemon, problem, sleep, until } from '../support/daemon.mjs';
import { handshake, Ws } from '../support/ws.mjs';

const token = (name) => `${name}-0123456789abcdef`;
const line = (name, role) => `${name} ${role} ${token(name)}\n`;
const as = (name) => ({ headers: { authorization: `Bearer ${token(name)}` } });

async function withTokens(text, options = {}) {
  const file = join(mkdtempSync(join(tmpdir(), 'tomocast-secret-')), 'tokens');
  writeFileSync(file, text, { mode: 0o600 });
  const d = await Daemon.start({ args: ['--token-file', file, ...(options.args ?? [])], token: token('root'), ...(options.rest ?? {}) });
  return { d, file };
}

/** A stream by a ticket of its own. */
async function stream(d, session, name) {
  const { json } = await d.post('/v1/tickets', {}, as(name));
  const { status, socket, rest } = await handshake(d.port, `${session.links.stream}?ticket=${json.ticket}`);
  assert.equal(status, 101);
  const ws = new Ws(socket, rest);
  await ws.nextText('hello');
  return ws;
}

test('SIGHUP reads the tokens again: who is no more in the file is out, the others notice nothing', async () => {
  const { d, file } = await withTokens(line('root', 'admin') + line('ann', 'edit') + line('bob', 'edit'));
  const make = async (name) => (await d.post('/v1/sessions', { volume: 'ball', scene: { image: { width: 32, height: 32 } } }, as(name))).json;
  const anns = await make('ann'), bobs = await make('bob');
  const ofAnn = await stream(d, anns, 'ann'), ofBob = await stream(d, bobs, 'bob'), rootAtAnns = await stream(d, bobs, 'root');
  const live = await fetch(d.base + bobs.links.mjpeg, as('root'));
  const { ticket } = (await d.post('/v1/tickets', {}, as('ann'))).json;
  const link = (await d.post(`${anns.links.self}/share`, { role: 'view' }, as('ann'))).json.token;

  writeFileSync(file, line('root', 'view') + line('bob', 'edit') + line('carl', 'edit'));
  d.process.kill('SIGHUP');
  await d.logged(/tokens\.renewed count=3/);
  problem(await d.get('/v1/volumes', as('ann')), 401);
  problem(await d.get(`${bobs.links.frame}?ticket=${ticket}`, { headers: { authorization: '' } }), 401);
  assert.equal((await d.get('/v1/volumes', as('carl'))).status, 200);
  assert.notEqual((await ofAnn.ended).code, 1000);
  problem(await d.get(anns.links.self, { headers: { authorization: `Bearer ${link}` } }), 404);
  assert.equal((await rootAtAnns.ended).code, 1008, 'another role is another token');
  for await (const piece of live.body) assert.ok(piece); // ends
  ofBob.patch(1, { camera: { fovY: 31 } });
  await ofBob.nextFrame(({ seq }) => seq === 1);
  await ofBob.close();

  for (const wrong of ['', 'bob edit short\n', line('bob', 'king')]) {
    const before = d.stderr.split('tokens.kept').length;
    writeFileSync(file, wrong);
    d.process.kill('SIGHUP');
    await until(() => d.stderr.split('tokens.kept').length > before);
    assert.equal(d.stderr.split('tokens.kept').length, before + 1, 'one line');
    assert.equal((await d.get('/v1/volumes', as('bob'))).status, 200);
  }
  assert.doesNotMatch(d.stderr, /0123456789abcdef/);
  await d.stop();
});

test('who may only look from now on keeps no session, and no link that edits', async () => {
  const { d, file } = await withTokens(line('root', 'admin') + line('ann', 'edit') + line('bob', 'admin'));
  const make = async (name) => (await d.post('/v1/sessions', { volume: 'ball', scene: { image: { width: 32, height: 32 } } }, as(name))).json;
  const anns = await make('ann'), bobs = await make('bob');
  const share = async (session, name) => (await d.post(`${session.links.self}/share`, { role: 'edit' }, as(name))).json.token;
  const change = (session, link) => d.patch(session.links.scene, { mode: 'mip' }, { headers: { authorization: `Bearer ${link}` } });
  const links = [await share(anns, 'ann'), await share(bobs, 'bob')];
  const ofRoot = await stream(d, bobs, 'root');
  assert.deepEqual([(await change(anns, links[0])).status, (await change(bobs, links[1])).status], [200, 200]);
  writeFileSync(file, line('root', 'edit') + line('ann', 'view') + line('bob', 'edit'));
  d.process.kill('SIGHUP');
  await d.logged(/tokens\.renewed count=3/);
  ofRoot.patch(1, { mode: 'mpr' });
  problem(await change(anns, links[0]), 404);
  assert.equal((await change(bobs, links[1])).status, 200, 'he may still edit');
  assert.equal((await ofRoot.ended).code, 1008);
  assert.equal((await d.get(bobs.links.scene, as('bob'))).json.mode, 'mip', 'a role that has gone changes nothing any more');
  await d.stop();
});

test('the metrics are for admins, and for everybody where they have a place of their own', async () => {
  const { d } = await withTokens(line('root', 'admin') + line('ann', 'edit'), { args: ['--metrics-listen', '127.0.0.1:0'] });
  problem(await d.get('/metrics', as('ann')), 403);
  assert.equal((await d.get('/metrics')).status, 200);
  const base = `http://${/serve\.metrics address=(\S+)/.exec(await d.logged(/serve\.metrics address=\S+/))[1]}`;
  const open = await fetch(`${base}/metrics`);
  assert.equal(open.status, 200);
  assert.match(await open.text(), /tomocast_memory_bytes\{kind="program"\} \d/);
  for (const [path, headers] of [['/v1/volumes', {}], ['/', {}], ['/healthz', {}], ['/v1/volumes', as('root').headers]])
    assert.equal((await fetch(base + path, { headers })).status, 404, path);
  assert.equal((await fetch(`${base}/metrics`, { method: 'POST' })).status, 405);
  assert.equal((await fetch(`${base}/metrics`, { headers: { origin: 'http://evil.example' } })).status, 403);
  await d.stop();
  await assert.rejects(Daemon.start({ args: ['--metrics-listen', 'x'] }), /ended with 2.*--metrics-listen x: give ADDR:PORT/s);
});

/** GET /v1/about from another address of this machine. */
const from = (d, localAddress, name) => new Promise((resolve, reject) => {
  http.get({ port: d.port, host: '127.0.0.1', localAddress, path: '/v1/about', agent: false, headers: { host: `127.0.0.1:${d.port}`, ...as(name).headers } },
    (reply) => resolve({ status: reply.statusCode, after: Number(reply.headers['retry-after'] ?? 0) }, reply.resume())).on('error', reject);
});

test('who guesses tokens waits, longer each time, and nobody else does', async () => {
  const { d } = await withTokens(line('root', 'admin') + line('ann', 'edit') + line('new', 'edit'), { rest: { ball: false } });
  const here = (name) => from(d, '127.0.0.1', name), there = (name) => from(d, '127.0.0.2', name);
  assert.equal((await here('ann')).status, 200);
  for (let i = 0; i < 30; i++) assert.equal((await here('stale')).status, 401, 'the same wrong one again is no guess');
  let tries = 0, reply;
  while ((reply = await here(`guess${tries}`)).status === 401) assert.ok(++tries < 25);
  assert.equal(reply.status, 429);
  assert.ok(reply.after >= 1);
  assert.equal((await here('new')).status, 429, 'a right one that was never used from here is not looked at');
  assert.equal((await here('ann')).status, 200, 'one that was is');
  assert.equal((await there('new')).status, 200, 'nor does another peer wait');
  assert.equal((await fetch(`${d.base}/healthz`)).status, 200);
  await sleep(1000 * reply.after + 50);
  assert.equal((await here('late')).status, 401, 'then one is looked at');
  assert.equal((await here('later')).status, 429, 'and the next waits again');
  await d.logged(/audit\.refused who=- role=none why=tries/);
  await d.stop();
});
