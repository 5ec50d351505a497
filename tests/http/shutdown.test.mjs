// Starting and stopping: the command line, the drain, what happens to work under way.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';
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
  let json;
  do json = (await d.get('/v1/volumes/lost')).json; while (json.state === 'loading');
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
