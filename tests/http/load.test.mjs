// The load tool: its arithmetic on known inputs, and short runs of it against the daemon.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, describe, test } from 'node:test';
import { fileURLToPath } from 'node:url';

import { withCapacity } from '../loading/capacity.mjs';
import { row } from '../loading/campaign.mjs';
import { Unanswered } from '../loading/client.mjs';
import { recorded, synthetic } from '../loading/motion.mjs';
import { readMix } from '../loading/rest.mjs';
import { Target } from '../loading/target.mjs';
import {
  boundOf, distribution, greatestPerBin, histogramBetween, jain, percentile, readMetrics, summary,
} from '../loading/statistics.mjs';
import { BINARY, sleep } from '../support/daemon.mjs';

const TOOL = fileURLToPath(new URL('../load', import.meta.url));
const folder = mkdtempSync(join(tmpdir(), 'tomocast-load-test-'));
after(() => rmSync(folder, { recursive: true, force: true }));

/** Runs the tool. `after(process)` may disturb it. */
function load(args, disturb = () => {}) {
  return new Promise((resolve) => {
    const child = spawn(TOOL, args, { stdio: ['ignore', 'pipe', 'pipe'] });
    let out = '', err = '';
    child.stdout.on('data', (bytes) => (out += bytes));
    child.stderr.on('data', (bytes) => (err += bytes));
    child.on('close', (code) => resolve({ code, out, err }));
    disturb(child);
  });
}

const SMALL = ['--binary', BINARY, '--backend', 'cpu', '--volume', 'demo:bucky', '--image', '96x64', '--rate', '20'];
const result = (name) => JSON.parse(readFileSync(join(folder, name, 'load.json'), 'utf8'));

test('percentiles are by nearest rank', () => {
  const hundred = Float64Array.from({ length: 100 }, (_, i) => i + 1);
  assert.deepEqual([0.5, 0.95, 0.99, 1, 0].map((f) => percentile(hundred, f)), [50, 95, 99, 100, 1]);
  assert.equal(percentile([7], 0.99), 7);
  assert.equal(percentile([], 0.5), null);
  assert.deepEqual(summary([3, 1, 2]), { count: 3, mean: 2, p50: 2, p95: 3, p99: 3, max: 3 });
  assert.equal(summary([]).p99, null);
  assert.deepEqual(distribution([5, 5]).at(-1), [5, 1]);
});

test("Jain's index is 1 of equal shares and 1/n where one has all", () => {
  assert.equal(jain([4, 4, 4]), 1);
  assert.equal(jain([9, 0, 0]), 0.3333);
  assert.equal(jain([1, 2, 3]), 0.8571); // 36 / (3 * 14)
  assert.equal(jain([0, 0]), null);
});

test('a frame answers its patch and all before it, each once', () => {
  const sent = new Unanswered();
  for (const seq of [1, 2, 3, 4]) sent.add(seq, seq * 10);
  assert.deepEqual(sent.answer(0, 15), []); // a frame older than all of them
  assert.deepEqual(sent.answer(2, 50), [[10, 40], [20, 30]]);
  assert.deepEqual(sent.answer(2, 60), []);
  sent.drop(3); // refused: nothing will show it
  assert.deepEqual(sent.rest(100), [[40, 60]]);
});

test('bins, and histograms between two scrapes', () => {
  assert.deepEqual(greatestPerBin([[0, 1], [9, 3], [25, 2], [99, 9]], 10, 30), [3, null, 2]);
  const before = readMetrics('# TYPE x histogram\nx_bucket{le="0.1"} 1\nx_bucket{le="1"} 1\nx_bucket{le="+Inf"} 1\nx_sum 0.1');
  const now = readMetrics('x_bucket{le="0.1"} 91\nx_bucket{le="1"} 101\nx_bucket{le="+Inf"} 101\nx_sum 9');
  const buckets = histogramBetween(before, now, 'x');
  assert.deepEqual(buckets, [[0.1, 90], [1, 100], [Infinity, 100]]);
  assert.deepEqual([0.5, 0.99, 1].map((f) => boundOf(buckets, f)), [0.1, 1, 1]);
  assert.equal(boundOf([], 0.5), null);
});

test('paths: recorded ones repeat, made-up ones rest between gestures', () => {
  const path = recorded([{ t: 0, patch: { a: 1 } }, { t: 50, patch: null }]);
  assert.deepEqual([0, 49, 50, 149, 150].map((t) => path(t)?.a), [1, 1, undefined, undefined, 1]);
  const scene = {
    camera: { projection: 'perspective', position: [0, -100, 0], target: [0, 0, 0], up: [0, 0, 1], fovY: 30, height: 50 },
    transferFunction: { points: [{ value: 0, color: [1, 1, 1], opacity: 0 }, { value: 10, color: [1, 1, 1], opacity: 1 }] },
  };
  const hand = synthetic(scene, 0, { dragMs: 100, thinkMs: 50 });
  const kinds = [10, 120, 160, 310].map((ms) => Object.keys(hand(ms) ?? {})[0]);
  assert.deepEqual(kinds, ['camera', undefined, 'camera', 'transferFunction']);
  assert.deepEqual(readMix('frame=2,value=1').sort(), ['frame', 'frame', 'value']);
});

test('the table of capacity goes between its marks', () => {
  const run = { clients: 4, framesPerSecondPerClient: 9.5, latencyMs: { p50: 60, p99: 150 }, cpuCores: 1.5, peakMiB: 80, jain: { renderMs: 0.999 }, seconds: 10,
    setting: { image: { width: 512, height: 512 }, rate: 60 } };
  const report = { runs: [run], machine: { cpu: 'C', cores: 2 }, about: { backend: 'cpu' }, began: '2026-01-02T03' };
  const text = 'before\n<!-- capacity: written by tests/load --capacity -->\nold\n<!-- /capacity -->\nafter';
  const made = withCapacity(text, report);
  assert.match(made, /^before\n<!--[^\n]*-->\n\| clients .*\n\| --- .*\n\| 4 \| 9.5 \| 60 \| 150 \| 1.50 \| 80 \| 0.999 \|\n\nC, 2 cores.*\n<!-- \/capacity -->\nafter$/);
  assert.equal(withCapacity(made, report), made, 'again gives the same');
  assert.match(withCapacity(text, { ...report, runs: [{ ...run, otherCores: 0.7 }] }), /hand; other processes took up to 0.7 cores, so/);
  assert.throws(() => withCapacity('no marks', report), /README.md: the marks/);
});

test('clients apart say so as a proxy does', () => {
  const target = new Target('http://127.0.0.1:1', 'secret'), other = target.from('10.0.0.1');
  assert.deepEqual(target.headers(), { Authorization: 'Bearer secret' });
  assert.deepEqual(other.headers(), { Authorization: 'Bearer secret', 'X-Forwarded-For': '10.0.0.1' });
  assert.equal(other.agent, target.agent);
});

test('a row is made of all its runs', () => {
  const buckets = (...counts) => ({ buckets: [[1, counts[0]], [20, counts[1]], [Infinity, counts[1]]] });
  const run = (waits, worst) => ({ waits, unanswered: 1, healthMs: { p99: worst, max: worst }, loopLagMs: buckets(99, 100), loopCpuMs: buckets(worst, 100),
    jain: { renderMs: 1 - worst / 100 }, peakMiB: worst, ended: { seconds: 0, died: worst === 2 }, errors: {}, badClient: null });
  const made = row('ray-large', [run([10, 20], 2), run([30, 40], 1)], [run([20], 1), run([10], 1)]);
  assert.deepEqual([made.runs, made.latencyMs.count, made.latencyMs.p99, made.ordinaryP99, made.ratio], [2, 4, 40, 20, 2]);
  assert.deepEqual(made.eachP99, { row: [20, 40], ordinary: [20, 10] });
  assert.deepEqual([made.unanswered, made.healthMs.max, made.peakMiB, made.jainRenderMs, made.ended.died], [2, 2, 2, 0.98, true]);
  assert.deepEqual([made.loopLagMs.p99, made.loopLagMs.max, made.loopCpuMs.p50], [1000, 20000, 20000]);
});

// Each waits for most of its time: several at once.
describe('the tool', { concurrency: 3 }, () => {
  test('three clients and REST calls: what is measured makes sense', async () => {
    const args = [...SMALL, '--clients', '3', '--seconds', '4', '--rest', '10', '--output', join(folder, 'three'), '--record', join(folder, 'path.json')];
    const { code, out, err } = await load(args);
    assert.equal(code, 0, err);
    assert.match(out, /^\| 3 \| /m);
    const html = readFileSync(join(folder, 'three', 'load.html'), 'utf8');
    assert.ok((html.match(/<svg /g) ?? []).length >= 6 && !/NaN|undefined|<script|src=|href=/.test(html), 'a page of plots by itself');
    const { runs: [run], complete } = result('three');
    assert.ok(complete);
    assert.ok(run.framesPerSecond > 0 && run.bytesPerSecond > 1000, JSON.stringify(run));
    const { p50, p95, p99, max, count } = run.latencyMs;
    assert.ok(0 < p50 && p50 <= p95 && p95 <= p99 && p99 <= max && max < 30000 && count > 20, JSON.stringify(run.latencyMs));
    assert.deepEqual(run.errors, {});
    assert.ok(run.jain.frames > 0.3 && run.jain.frames <= 1);
    assert.equal(run.perClient.length, 3);
    for (const client of run.perClient) assert.ok(client.frames > 0 && client.renderMs > 0 && client.line.length >= 6);
    assert.ok(run.stagesMs.render.p50 > 0 && run.stagesMs.encode.max >= run.stagesMs.encode.p50);
    assert.ok(run.cpuCores > 0 && run.peakMiB > 5, 'the process was seen');
    assert.ok(run.healthMs.count > 10 && run.rest.volumes.count > 0);
    const path = JSON.parse(readFileSync(join(folder, 'path.json')));
    assert.ok(path.length > 10 && path.some(({ patch }) => patch?.camera));
  });

  test('a bad client is set against an ordinary one', async () => {
    const { code, err, out } = await load([...SMALL, '--seconds', '1', '--bad', 'failed-entries', '--rounds', '1', '--apart', '--output', join(folder, 'bad')]);
    assert.equal(code, 0, err);
    const { runs, table: [row] } = result('bad');
    assert.deepEqual(runs.map(({ name }) => name), ['four alone', 'four and a fifth', 'failed-entries']);
    assert.equal(runs[1].badClient.counts.session, 1, 'the fifth was there');
    assert.ok(Object.values(row.bad.counts)[0] > 0 && row.ratio > 0 && row.ordinaryP99 === runs[1].latencyMs.p99, JSON.stringify(row));
    assert.match(out, /^\| failed-entries \| /m);
  });

  test('a daemon that dies is said, and not measured on', async () => {
    const flag = join(folder, 'die'), mortal = join(folder, 'mortal');
    writeFileSync(mortal, `#!/bin/sh\n(while [ ! -e ${flag} ]; do sleep 0.1; done; kill -KILL $$) >/dev/null 2>&1 </dev/null &\nexec "${BINARY}" "$@"\n`, { mode: 0o755 });
    const args = ['--binary', mortal, ...SMALL.slice(2), '--clients', '1,1,1,1', '--seconds', '1', '--output', join(folder, 'dead')];
    const { code, err, out } = await load(args, (child) => child.stdout.once('data', () => writeFileSync(flag, ''))); // the first step is done
    assert.equal(code, 1, err);
    assert.match(err, /^tests\/load: the daemon died \(SIGKILL\); the end of its log:\n/m, out);
    assert.equal(out.match(/frames\/s a client/g).length <= 3, true, 'no step is measured of a dead daemon');
  });

  test('whichever call a dying daemon leaves without an answer, its death is what is said', async () => {
    // The connection closes first, and only then does the system say that the process has gone.
    const mortal = join(folder, 'actor');
    const actor = (moment, how) => `#!${process.execPath}
      const replies = { '/v1/volumes/head': { state: 'resident' }, '/v1/about': { name: 'Tomocast' }, '/v1/sessions': { id: 's', scene: { transferFunction: { points: [] } } } };
      process.on('SIGTERM', () => {}); // who is dying does not listen
      const die = (socket) => { socket.${how}(); setTimeout(() => process.kill(process.pid, 'SIGKILL'), 300); };
      const server = require('node:http').createServer((request, reply) =>
        request.method + ' ' + request.url === '${moment}' ? die(request.socket) : reply.end(JSON.stringify(replies[request.url])));
      server.on('upgrade', (request, socket) => die(socket));
      server.listen(0, '127.0.0.1', () => console.log('listening on http://127.0.0.1:' + server.address().port));`;
    const died = /^tests\/load: the daemon died \(SIGKILL\); the end of its log:\n/;
    const moments = [['GET /v1/about', 'destroy', 1, died], ['POST /v1/sessions', 'end', 1, died], ['stream', 'resetAndDestroy', 1, died], ['stream', 'end', 1, died],
      ['GET /v1/volumes/head', 'destroy', 2, /^tests\/load: the daemon ended before its volume was there \(SIGKILL\)/]];
    for (const [moment, how, status, said] of moments) {
      writeFileSync(mortal, actor(moment, how), { mode: 0o755 });
      const { code, err } = await load(['--binary', mortal, ...SMALL.slice(2), '--clients', '1', '--seconds', '1']);
      assert.equal(code, status, `${moment}: ${err}`);
      assert.match(err, said, moment);
      assert.doesNotMatch(err, /closed the connection/, moment);
    }
  });

  test('Ctrl-C ends it with what was measured so far', async () => {
    const interrupt = async (child) => { await sleep(2500); child.kill('SIGINT'); };
    const began = Date.now();
    const { code, err } = await load([...SMALL, '--clients', '1,2', '--seconds', '600', '--output', join(folder, 'cut')], interrupt);
    assert.equal(code, 130, err);
    assert.ok(Date.now() - began < 60000);
    const { runs, complete } = result('cut');
    assert.equal(complete, false);
    assert.equal(runs.length <= 1, true, 'the second step was not begun');
  });

  test('what cannot be is said in one line', async () => {
    const broken = join(folder, 'broken.json');
    writeFileSync(broken, '[{"t": 0, "patch": {}}, {"t": -1}]');
    const wrong = {
      'nothing listens on http://127.0.0.1:9: start': ['--url', 'http://127.0.0.1:9'],
      "--bad nobody: no such client; there are all, huge-drag": ['--bad', 'nobody'],
      '--clients 0: give whole numbers from 1': ['--clients', '0'],
      '--url ftp://x: give http://HOST:PORT': ['--url', 'ftp://x'],
      'step 1: give "t" of at least 0': [...SMALL, '--path', broken],
    };
    for (const [said, args] of Object.entries(wrong)) {
      const { code, err } = await load(args);
      assert.equal(code, 2, err);
      assert.ok(err.startsWith('tests/load: ') && err.includes(said) && err.trim().split('\n').length === 1, err);
    }
  });
});
