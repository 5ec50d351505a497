// Quality control: a bound on error or time chooses the sampling; the plan says what and why, the error meter agrees.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Daemon, sleep, until } from '../support/daemon.mjs';
import { validate } from '../support/schema.mjs';
import { Ws } from '../support/ws.mjs';

let d, api;
before(async () => {
  d = await Daemon.start();
  api = (await d.get('/v1/openapi.json')).json;
});
after(() => d.stop());

// Unlit, and with knots many values apart: light has errors of its own, and so have the knots that a preset is fitted
// with, two of them within the first of the ball's whole values, which is one cell of its table. No step mends those.
const KNOTS = [[0, 0], [37, 0], [74, 0.12], [124, 0.6], [136, 0.63], [248, 0.9]];
const UNLIT = {
  shading: { model: 'none' },
  transferFunction: { unitDistance: 1, points: KNOTS.map(([value, opacity]) => ({ value, opacity, color: [0.4 + opacity / 2, 0.2 + opacity / 2, opacity] })) },
};
const AMPLE_MS = 1e5; // more than any frame here takes, on a machine under full load too
const open = async (scene) => {
  const session = await d.session({ ...UNLIT, ...scene });
  return { session, ws: await Ws.open(d, session.id) };
};
const planOf = async (session, of = d) => (await of.get(session.links.plan)).json;
const measurements = async (of = d) =>
  Number(/^tomocast_quality_measurements_total (.*)$/m.exec((await of.get('/metrics')).bytes.toString())[1]);

/** The plan once no more views are measured for this session, and its quality is what `enough` wants: on a loaded machine
 *  there may be a pause between two measurements. */
async function known(session, { of = d, enough = () => true } = {}) {
  let last = -1;
  return until(async () => {
    await sleep(400);
    const [before, plan] = [last, await planOf(session, of)];
    last = await measurements(of);
    return plan.quality.views > 0 && last === before && enough(plan.quality) && plan;
  });
}

for (const maxError of [0.01, 0.001]) {
  test(`an error of ${maxError} is held, the plan says how`, async () => {
    const { session, ws } = await open({ quality: { maxError }, errorMeter: { pixels: 4096 } });
    await ws.nextFrame(({ final }) => final);
    const plan = await known(session, { enough: ({ holds }) => holds });
    assert.deepEqual(validate(plan, api.components.schemas.Plan, api), []);
    const { quality } = plan;
    assert.equal(quality.classification, 'preintegrated');
    assert.deepEqual([quality.maxError, quality.holds], [maxError, true]);
    assert.ok(quality.expected > maxError / 10 && quality.expected <= maxError, JSON.stringify(quality));
    assert.match(quality.reason, /step .* measured views/);
    assert.ok(Math.abs(plan.stepMm - 2 * quality.step) < 1e-9, 'the plan is of what was chosen');
    ws.patch(1, { camera: { fovY: 31 } }); // the frame below is made with what is known now
    const { header } = await ws.nextFrame((h) => h.seq === 1 && h.final && h.error);
    assert.ok(header.error.rms <= maxError, JSON.stringify(header.error));
    await ws.close();
  });
}

test('several rays a pixel stay, share the steps and hold the bound; so do labels', async () => {
  const asked = { quality: { maxError: 0.004 }, errorMeter: { pixels: 2000 }, image: { width: 128, height: 128 } };
  for (const scene of [{ sampling: { raysPerPixel: 4 } }, { labels: { volume: 'ball', force: true, opacity: 0.5 } }]) {
    const { session, ws } = await open({ ...asked, ...scene });
    await ws.nextFrame(({ final }) => final);
    const { quality } = await known(session, { enough: ({ holds }) => holds });
    assert.ok(quality.expected > 0.0004, JSON.stringify(quality));
    ws.patch(1, { camera: { fovY: 31 } });
    const { header } = await ws.nextFrame((h) => h.seq === 1 && h.final && h.error);
    assert.ok(header.error.rms <= 0.004, JSON.stringify([scene, header.error]));
    const { json } = await d.get(session.links.scene);
    assert.equal(json.sampling.raysPerPixel, scene.sampling?.raysPerPixel ?? 1);
    await ws.close();
  }
});

test('a tighter bound has a smaller step, and the scene keeps what was asked', async () => {
  const loose = await open({ quality: { maxError: 0.01 } }), tight = await open({ quality: { maxError: 0.0005 } });
  const [a, b] = [(await known(loose.session)).quality, (await known(tight.session)).quality];
  assert.ok(b.step < a.step && b.termination < a.termination, JSON.stringify([a, b]));
  const { json } = await d.get(tight.session.links.scene);
  assert.deepEqual([json.quality.maxError, json.sampling.step], [0.0005, tight.session.scene.sampling.step]);
  await loose.ws.close();
  await tight.ws.close();
});

test('single pictures are measured before they are made', async () => {
  const before = await measurements();
  const scene = { image: { width: 64, height: 64 }, quality: { maxError: 0.004 }, sampling: { step: 5 } };
  const asked = { volume: 'ball', format: 'png', scene };
  const first = await d.post('/v1/render', asked);
  assert.equal(first.status, 200);
  assert.equal(await measurements(), before + 1);
  const coarse = await d.post('/v1/render', { ...asked, scene: { ...scene, quality: {} } });
  assert.ok(!coarse.bytes.equals(first.bytes), 'its own step is another');
  const again = await d.post('/v1/render', asked);
  assert.ok(again.bytes.equals(first.bytes));
  assert.equal(await measurements(), before + 1, 'once');
});

test('a time budget chooses the method too, and says so', async () => {
  const { session, ws } = await open({ quality: { maxMilliseconds: AMPLE_MS } });
  await ws.nextFrame(({ final }) => final);
  const { quality } = await known(session, { enough: ({ reason }) => /would have/.test(reason) });
  assert.match(quality.reason, /^preintegrated2?, step .*finest.*in time.* rms error .* measured views/);
  assert.equal(quality.classification, quality.reason.split(',')[0]);
  assert.match(quality.reason, /; preintegrated2? with \S+ would have/);
  assert.ok(quality.holds && quality.expected <= AMPLE_MS && quality.termination < 1e-3, JSON.stringify(quality));
  ws.patch(1, { classification: 'post' }); // asked for by name
  await ws.nextFrame((h) => h.seq === 1 && h.final);
  const { quality: post } = await planOf(session);
  assert.deepEqual([post.classification, post.views], ['post', undefined]);
  assert.match(post.reason, /^step .*finest/);
  await ws.close();
});

test('on gl both methods are weighed', async () => {
  const gl = await Daemon.start({ args: ['--backend', 'gl'] });
  const of = { maxError: /; preintegrated2? would need/, maxMilliseconds: /; preintegrated2? with \S+ would have/ };
  for (const [bound, other] of Object.entries(of)) {
    const quality = { [bound]: bound === 'maxError' ? 5e-4 : AMPLE_MS };
    const session = await gl.session({ ...UNLIT, quality, image: { width: 160, height: 120 } });
    const ws = await Ws.open(gl, session.id);
    await ws.nextFrame(({ final }) => final);
    const { quality: chosen } = await known(session, { of: gl, enough: ({ reason }) => other.test(reason) });
    assert.match(chosen.classification, /^preintegrated2?$/);
    await ws.close();
  }
  await gl.stop();
});

test('a time budget: the step follows, said in the plan', async () => {
  const { session, ws } = await open({ quality: { maxMilliseconds: AMPLE_MS } });
  await ws.nextFrame(({ final }) => final);
  const { quality: rich } = await planOf(session);
  assert.deepEqual([rich.maxMilliseconds, rich.holds], [AMPLE_MS, true]);
  assert.ok(rich.step < 1 && rich.expected <= AMPLE_MS, JSON.stringify(rich));
  ws.patch(1, { quality: { maxMilliseconds: 0.001 } });
  await ws.nextFrame((h) => h.seq === 1 && h.final);
  const { quality: poor } = await planOf(session);
  assert.deepEqual([poor.holds, poor.step], [false, 4]);
  assert.match(poor.reason, /coarsest/);
  ws.patch(2, { quality: { maxMilliseconds: null } });
  await ws.nextFrame((h) => h.seq === 2 && h.final);
  assert.equal((await planOf(session)).quality, undefined);
  await ws.close();
});

test('modes without steps keep a time budget in motion by fewer pixels, and are full at rest', async () => {
  const median = (list) => list.sort((a, b) => a - b)[list.length >> 1];
  for (const mode of ['mesh', 'isosurface', 'splat']) {
    const scene = { mode, sampling: { raysPerPixel: mode === 'mesh' ? 4 : 1 }, isosurface: { value: 100 } };
    const { session, ws } = await open(scene);
    await ws.nextFrame(({ final }) => final);
    let seq = 0;
    const turn = async (patch) => {
      ws.patch(++seq, { camera: { fovY: 30 + seq / 20 }, ...patch });
      return (await ws.nextFrame((h) => h.seq === seq)).header;
    };
    const inMotion = async (patch) => {
      const moving = [];
      for (let i = 0; i < 25; i++) moving.push(await turn(patch));
      return median(moving.slice(10).map(({ width }) => width)); // the ladder has found its size by then
    };
    const atRest = async () => (await ws.nextFrame((h) => h.seq === seq && h.final)).header;
    let side = 1600, free = 0; // the largest picture that this machine moves in full size without a budget
    for (let tries = 8; free < side && tries > 0; tries--) { // the smallest several times: others may be at work
      side = Math.max(100, side / 2);
      await turn({ image: { width: side, height: side } });
      await atRest();
      free = await inMotion({});
    }
    const rest = [];
    for (let i = 0; i < 3; i++) {
      await turn({});
      rest.push((await atRest()).timing.renderMs);
    }
    const budget = median(rest) / 16; // far below what the free ladder would choose by itself
    const bound = await inMotion({ quality: { maxMilliseconds: budget } });
    assert.equal((await atRest()).width, side);
    assert.ok(bound <= 0.8 * free, `${mode}: ${bound} of ${side} pixels wide within ${budget.toFixed(2)} ms, ${free} without a budget`);
    assert.match((await planOf(session)).quality.reason, /no steps to choose; in motion/);
    await ws.close();
  }
});

test('a scene without a reference keeps its own sampling, and the plan says so', async () => {
  const { session, ws } = await open({ quality: { maxError: 0.01 }, mode: 'mpr' });
  await ws.nextFrame(({ final }) => final);
  const { quality } = await planOf(session);
  assert.deepEqual([quality.holds, quality.step], [false, session.scene.sampling.step]);
  assert.match(quality.reason, /mode/);
  await ws.close();
});

test('looks that change while they are measured, and sessions that end then', async () => {
  for (let i = 0; i < 5; i++) {
    const { session, ws } = await open({ quality: { maxError: 0.002 + i * 1e-4 } });
    await ws.nextFrame(({ final }) => final);
    ws.patch(1, { transferFunction: { unitDistance: 1 + i / 10 } });
    await ws.nextFrame((h) => h.seq === 1 && h.final);
    if (i % 2) ws.cut();
    assert.equal((await d.delete(session.links.self)).status, 204);
  }
  assert.equal((await d.get('/healthz')).status, 200);
});
