// The I/O thread stalls for nobody: floods of patches, long documents, abandoned questions, a log that nobody reads.
// What is bounded here is processor time of one turn of the loop, which other load on the machine does not change.
import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import net from 'node:net';
import { after, before, test } from 'node:test';
import { Daemon, problem, sleep } from '../support/daemon.mjs';
import { frameBytes, Ws } from '../support/ws.mjs';

const MOST_TURN_S = 0.2; // a release build needs a few ms; sanitizers fifty times as long, the stalls were seconds

let d;
before(async () => { d = await Daemon.start(); });
after(() => d.stop());

const knots = (n, opacity = 0.001) =>
  Array.from({ length: n }, (_, i) => ({ value: (i * 255) / n, color: [0.5, 0.25, 1], opacity: i % 2 ? opacity : 0 }));

/** Runs `work` and checks the longest turn meanwhile. */
async function unstalled(work) {
  await d.metric('loop_turn_cpu_max_seconds'); // begins anew with each scrape
  const result = await work();
  const most = await d.metric('loop_turn_cpu_max_seconds');
  assert.ok(most < MOST_TURN_S, `a turn of ${most} s`);
  return result;
}

test('turns of the loop are measured', async () => {
  const text = (await d.get('/metrics')).bytes.toString();
  for (const le of ['0.001', '0.005', '0.02', '0.05', '+Inf']) assert.ok(text.includes(`tomocast_loop_lag_seconds_bucket{le="${le}"}`), le);
  const before = await d.metric('loop_lag_seconds_count');
  await d.get('/healthz');
  assert.ok((await d.metric('loop_lag_seconds_count')) > before);
  assert.ok((await d.metric('loop_lag_max_seconds')) > 0);
});

test('a flood of patches on a scene of many knots changes it a few times, and stalls nobody', async () => {
  const { id, links } = await d.session({ transferFunction: { points: knots(11000) } });
  const ws = await Ws.open(d, id);
  await ws.nextFrame();
  const [patches, changes] = [await d.metric('patches_total'), await d.metric('scene_changes_total')];
  const count = 2000;
  await unstalled(async () => {
    ws.write(Buffer.concat(Array.from({ length: count }, (_, i) =>
      frameBytes(JSON.stringify({ type: 'patch', seq: i + 1, scene: i % 2 ? {} : { camera: { fovY: 20 + i / count } } })))));
    await ws.nextFrame(({ seq }) => seq === count);
  });
  assert.equal((await d.metric('patches_total')) - patches, count);
  const changed = (await d.metric('scene_changes_total')) - changes;
  assert.ok(changed >= 1 && changed < count / 4, `${changed} changes of ${count} patches`);
  assert.equal((await d.get(links.scene)).json.camera.fovY, 20 + (count - 2) / count);
  await ws.close();
});

test('one viewer that never stops sending gets a share of the loop, not all of it', async () => {
  const { id } = await d.session();
  const ws = await Ws.open(d, id);
  await ws.nextFrame();
  const hundred = Buffer.concat(Array.from({ length: 100 }, (_, i) => frameBytes(JSON.stringify({ type: 'patch', seq: i + 1, scene: { camera: { fovY: 20 + i / 10 } } }))));
  const began = performance.now();
  const before = await d.metric('loop_lag_seconds_sum');
  while (performance.now() - began < 3000) {
    if (ws.socket.writableLength < 1 << 18) ws.write(hundred);
    await sleep(1);
  }
  const busy = ((await d.metric('loop_lag_seconds_sum')) - before) / ((performance.now() - began) / 1000);
  console.log(`the loop was busy ${(100 * busy).toFixed(0)} % of the time`);
  assert.ok(busy < 0.5, `${busy} of the time`);
  ws.cut();
});

/** Random patches, some of them wrong: by themselves, in what they make of the scene, or over a limit. */
function randomPatch(random) {
  const pick = (...list) => list[Math.floor(random() * list.length)];
  const parts = [
    () => ({ camera: { fovY: pick(10, 20, 30, null, -5, 'x') } }), () => ({ image: { width: pick(64, 80, 96, 1e9, null) } }),
    () => ({ transferFunction: { preset: pick('ct-bone', 'surface', 'nonsense') } }), () => ({ transferFunction: null }),
    () => ({ transferFunction: { points: knots(pick(2, 3, 7), pick(0.5, 2)) } }), () => ({ image: { format: pick('png', 'jpeg') } }),
    () => ({ image: { background: pick('transparent', [0, 0, 1]) } }), () => ({ shading: { model: pick('lambert', 'none', 'x'), ambient: pick(0.1, 2, null) } }),
    () => ({ quality: pick({ maxError: 0.01 }, { maxMilliseconds: 50 }, null) }), () => ({ clip: { planes: pick([], [[1, 0, 0, 5]], [[0, 0, 0, 1]]) } }),
    () => ({ camera: { up: pick([0, 0, 1], [0, 1, 0], [1, 0, 0]) } }), () => ({ mode: pick('mip', 'dvr', 'mesh') }), () => ({ nonsense: 1 }),
  ];
  return Object.assign({}, pick(...parts)(), random() < 0.4 ? pick(...parts)() : {});
}

test('patches that come together do what they do one by one', async () => {
  let state = 12345;
  const random = () => (state = (state * 1103515245 + 12345) % 2147483648) / 2147483648;
  const together = await d.session(), alone = await d.session();
  const ws = await Ws.open(d, together.id, { autoAck: false });
  await ws.nextText('hello');
  for (let round = 0; round < 8; round++) {
    const patches = Array.from({ length: 40 }, () => randomPatch(random));
    const refused = [];
    for (const [i, patch] of patches.entries()) {
      const { status } = await d.patch(alone.links.scene, patch);
      if (status !== 200) refused.push(i);
    }
    const first = round * 100;
    ws.write(Buffer.concat([...patches.map((scene, i) => frameBytes(JSON.stringify({ type: 'patch', seq: first + i + 1, scene }))),
      frameBytes(JSON.stringify({ type: 'ping', t: round }))]));
    const errors = [];
    for (;;) {
      const message = await ws.next((m) => (m.type === 'error' && m.seq > first) || (m.type === 'pong' && m.t === round));
      if (message.type === 'pong') break;
      errors.push(message.seq - first - 1);
    }
    assert.deepEqual(errors, refused, `round ${round}`);
    assert.ok(refused.length > 3 && refused.length < 37, `${refused.length} of 40 are wrong`);
    assert.deepEqual((await d.get(together.links.scene)).json, (await d.get(alone.links.scene)).json, `round ${round}`);
  }
  await ws.close();
});

test('long scenes are read and written beside the loop', async () => {
  const { links } = await d.session();
  const points = knots(9000), body = { transferFunction: { points } };
  const made = await unstalled(async () => {
    const changed = await d.patch(links.scene, body);
    assert.equal(changed.status, 200);
    const { json, headers } = await d.get(links.scene);
    assert.equal(json.transferFunction.points.length, 9000);
    assert.equal(headers.get('etag'), changed.headers.get('etag'));
    assert.deepEqual(changed.json, json);
    assert.equal((await d.put(links.scene, { ...json, ...body }, { headers: { 'if-match': headers.get('etag') } })).status, 200);
    const created = await d.post('/v1/sessions', { volume: 'ball', scene: { image: { width: 64, height: 64 }, ...body } });
    assert.equal(created.status, 201);
    assert.equal(created.headers.get('location'), created.json.links.self);
    assert.deepEqual(created.json.scene.transferFunction.points, json.transferFunction.points);
    assert.equal((await d.post('/v1/render', { volume: 'ball', scene: { image: { width: 64, height: 64 }, ...body } })).status, 200);
    const ws = await Ws.open(d, created.json.id);
    assert.equal((await ws.nextText('hello')).scene.transferFunction.points.length, 9000);
    await ws.nextFrame(({ final }) => final);
    await ws.close();
    return json;
  });
  problem(await d.put(links.scene, body, { headers: { 'if-match': '"1"' } }), 412);
  const wrong = structuredClone(body);
  wrong.transferFunction.points[8000].color = 7;
  problem(await d.patch(links.scene, wrong), 422, '/transferFunction/points/8000/color');
  problem(await d.post('/v1/sessions', { volume: 'ball', scene: wrong }), 422, '/scene/transferFunction/points/8000/color');
  problem(await d.call('PATCH', links.scene, { body: `${JSON.stringify(body).slice(0, -1)},}`, type: 'application/json' }), 400);
  problem(await d.patch(links.scene, { ...body, nonsense: 1 }), 422, '/nonsense');
  assert.deepEqual((await d.get(links.scene)).json.transferFunction, made.transferFunction, 'refused patches leave the scene');
});

test('long answers are written beside the loop', async () => {
  const { links } = await d.session({ image: { width: 41, height: 41 }, transferFunction: { points: knots(11000) } });
  await unstalled(async () => {
    const ray = await d.get(`${links.self}/ray?x=20&y=20`);
    assert.ok(ray.json.samples.length > 3000, `${ray.json.samples.length} samples`);
    const { json } = await d.get('/v1/volumes/ball/histogram?bins=65536');
    assert.equal(json.edges.length, 65537);
    assert.equal(json.counts.reduce((sum, n) => sum + n), 32 ** 3);
    for (const path of ['/v1/about', '/v1/openapi.json', '/v1/scene.schema.json', '/v1/presets', '/v1/volumes']) assert.equal((await d.get(path)).status, 200);
  });
});

/** The daemon's threads as {name: {nice, wakeUps}}. */
function threads() {
  const task = `/proc/${d.process.pid}/task`;
  return Object.fromEntries(readdirSync(task).map((id) => {
    const stat = readFileSync(`${task}/${id}/stat`, 'latin1');
    const wakeUps = /^voluntary_ctxt_switches:\s+(\d+)$/m.exec(readFileSync(`${task}/${id}/status`, 'latin1'))[1];
    const name = Number(id) === d.process.pid ? 'main' : stat.slice(stat.indexOf('(') + 1, stat.lastIndexOf(')'));
    return [name, { nice: Number(stat.slice(stat.lastIndexOf(')') + 2).split(' ')[16]), wakeUps: Number(wakeUps) }];
  }));
}

test('the I/O thread comes before pictures, these before questions and loads', () => {
  const all = threads();
  const steps = { 'tc-render': 5, 'tc-encode': 5, 'tc-load': 15, 'tc-text': 15, 'tc-probe': 15, 'tc-meter': 19 };
  const main = all.main.nice;
  for (const [name, step] of Object.entries(steps)) assert.equal(all[name].nice, Math.min(19, main + step), name);
  for (const [name, { nice }] of Object.entries(all)) if (/^render-\d/.test(name)) assert.equal(nice, all['tc-render'].nice, name);
});

test('a list of many sessions is written by a worker, one of few at once', async () => {
  const asked = async (patienceMs) => {
    const { wakeUps } = threads()['tc-text'];
    const { json: { sessions } } = await d.get('/v1/sessions');
    for (const end = Date.now() + patienceMs; Date.now() < end && threads()['tc-text'].wakeUps === wakeUps;) await sleep(10);
    return { sessions, worker: threads()['tc-text'].wakeUps > wakeUps };
  };
  for (const { links } of (await d.get('/v1/sessions')).json.sessions) await d.delete(links.self);
  const made = await d.session();
  assert.equal((await asked(100)).worker, false);
  const ids = [made.id];
  while (ids.length < 17) ids.push((await d.session()).id);
  const { sessions, worker } = await asked(10000);
  assert.equal(worker, true);
  assert.deepEqual(sessions.map(({ id }) => id), ids);
  assert.deepEqual(Object.keys(sessions[0]).sort(), ['etag', 'id', 'idleSeconds', 'links', 'renderMs', 'viewers', 'volume']);
  for (const { links } of sessions) await d.delete(links.self);
});

test('viewers are told of every volume of a flood, some at a time', async () => {
  const ws = await Ws.open(d, (await d.session()).id);
  const names = Array.from({ length: 80 }, (_, i) => `absent-${i}`);
  let at = 0;
  const post = async () => { while (at < names.length) await again(names[at++]); };
  const again = async (id) => { while ((await d.post('/v1/volumes', { id, path: 'ball.nrrd#7' })).status === 503) await sleep(10); };
  await Promise.all([post(), post(), post()]);
  const failed = new Set();
  while (failed.size < names.length) failed.add((await ws.next(({ type, state }) => type === 'volume' && state === 'failed')).id);
  assert.deepEqual([...failed].sort(), [...names].sort());
  await ws.close();
});

const resident = () => Number(/VmRSS:\s+(\d+)/.exec(readFileSync(`/proc/${d.process.pid}/status`))[1]) / 1024;
const sanitized = () => /lib[at]san|__[at]san/.test(readFileSync(`/proc/${d.process.pid}/maps`, 'latin1'));
const waiting = async () => {
  const text = (await d.get('/metrics')).bytes.toString();
  return Number(/^tomocast_work_queue_length\{worker="probe"\} (\d+)$/m.exec(text)[1]);
};

test('abandoned rays are dropped, and nobody waits behind them', async () => {
  const sessions = await Promise.all(Array.from({ length: 10 }, () => d.session({ image: { width: 64, height: 64 }, transferFunction: { points: knots(11000) } })));
  const before = resident(), dropped = await d.metric('work_dropped_total');
  const replies = [];
  const sockets = Array.from({ length: 300 }, (_, i) => {
    const socket = net.connect(d.port, '127.0.0.1');
    socket.on('error', () => {});
    socket.on('data', (piece) => { if (/^HTTP/.test(piece)) replies.push(Number(piece.toString('latin1', 9, 12))); });
    socket.write(`GET ${sessions[i % 10].links.self}/ray?x=${i % 64}&y=32 HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\n\r\n`);
    return socket;
  });
  let most = 0;
  for (let i = 0; i < 5 || (i < 500 && !replies.includes(503)); i++) most = Math.max(most, await waiting());
  assert.ok(replies.includes(503), `${replies}`);
  assert.ok(most <= 64, `${most} wait`);
  assert.equal((await d.get('/v1/volumes')).status, 200);
  assert.equal((await d.get('/v1/volumes/ball/histogram')).status, 200);
  sockets.forEach((socket) => socket.destroy());
  const end = Date.now() + 20000;
  while (Date.now() < end && (await waiting())) await sleep(50);
  assert.equal(await waiting(), 0);
  assert.ok((await d.metric('work_dropped_total')) > dropped);
  assert.ok(sanitized() || resident() - before < 100, `${before} MB before, ${resident()} MB after`);
});

test('one session may not fill the line of rays', async () => {
  const [greedy, other] = [await d.session({ image: { width: 64, height: 64 }, transferFunction: { points: knots(2000) } }), await d.session()];
  const asked = Array.from({ length: 40 }, (_, i) => d.get(`${greedy.links.self}/ray?x=${i}&y=32`));
  assert.equal((await d.get(`${other.links.self}/pick?x=5&y=5`)).status, 200);
  const statuses = (await Promise.all(asked)).map(({ status, headers }) => {
    if (status === 503) assert.ok(headers.get('retry-after'));
    return status;
  });
  assert.deepEqual([...new Set(statuses)].sort(), [200, 503]);
});

test('a log that nobody reads stops nothing', async () => {
  const quiet = await Daemon.start({ ball: false, config: '[server]\nlog_level=debug\n' });
  quiet.process.stderr.pause();
  const one = `GET /healthz HTTP/1.1\r\nHost: 127.0.0.1:${quiet.port}\r\n\r\n`;
  const socket = net.connect(quiet.port, '127.0.0.1');
  let answered = 0, rest = '';
  socket.on('data', (piece) => {
    const lines = (rest + piece.toString('latin1')).split('\r\n');
    rest = lines.pop(); // a piece may end within a line
    answered += lines.filter((line) => line.endsWith('HTTP/1.1 200 OK')).length;
  });
  const asked = 8000; // some 90 bytes of log each: far more than the pipes and the ring hold
  for (let i = 0; i < asked; i += 500) socket.write(one.repeat(500));
  for (const end = Date.now() + 60000; answered < asked && Date.now() < end;) await sleep(50);
  assert.equal(answered, asked);
  const dropped = await quiet.metric('log_dropped_total');
  assert.ok(dropped > 0, 'lines were dropped');
  socket.destroy();
  quiet.process.stderr.resume();
  for (let i = 0; i < 200 && !/warn log\.lost text="\d+ lines lost"/.test(quiet.stderr); i++) {
    await quiet.get('/healthz');
    await sleep(20);
  }
  assert.match(quiet.stderr, /warn log\.lost text="\d+ lines lost"/);
  await quiet.stop();
});

test('a log file is appended to', async () => {
  const first = await Daemon.start({ ball: false });
  const file = `${first.folder}/log`;
  const second = await Daemon.start({ ball: false, args: ['--log', file] });
  await second.stop();
  assert.equal(second.stderr, '');
  assert.match(readFileSync(file, 'utf8'), /^\S+Z info serve\.start [\s\S]* info serve\.stop\n$/);
  await first.stop();
});
