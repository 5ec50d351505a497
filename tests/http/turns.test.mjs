// Whose turn it is on the renderer: ordinary viewers beside those who ask for much.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Daemon, sleep } from '../support/daemon.mjs';
import { Ws } from '../support/ws.mjs';

const HEAVY = { image: { width: 8192, height: 2000 }, filter: 'cubic', sampling: { step: 0.25, raysPerPixel: 16 }, shading: { model: 'blinn-phong' } };

let d;
before(async () => { d = await Daemon.start({ args: ['--volume', 'head=demo:head'] }); await d.resident('head'); });
after(() => d.stop());

const median = (numbers) => numbers.toSorted((a, b) => a - b)[numbers.length >> 1];

async function viewer(scene) {
  const { json } = await d.post('/v1/sessions', { volume: 'head', scene });
  const ws = await Ws.open(d, json.id);
  return { id: json.id, links: json.links, ws, seq: 0 };
}

/** One patch and the frame that shows it. */
async function turn(v) {
  const began = performance.now(), seq = ++v.seq;
  v.ws.patch(seq, { camera: { fovY: 20 + (seq % 40) / 4 } });
  const { header } = await v.ws.nextFrame((h) => h.seq >= seq, 60000);
  return { ms: performance.now() - began, header };
}

/** Drags until `stop.now`, one patch after the other; times in milliseconds. */
async function drag(v, stop) {
  const times = [];
  v.ws.send({ type: 'pointer', phase: 'start' });
  for (let i = 0; !stop.now; i++) {
    if (i % 4 === 0) v.ws.send({ type: 'pointer', phase: 'start' });
    times.push((await turn(v)).ms);
  }
  return times;
}

/** Two ordinary viewers that drag for a while, beside something: the median of what they wait. */
async function ordinary(ms, beside = async () => {}) {
  const stop = { now: false };
  const other = beside(stop);
  const viewers = await Promise.all([0, 1].map(() => viewer({ image: { width: 256, height: 256 } })));
  const drags = viewers.map((v) => drag(v, stop));
  await sleep(ms);
  const used = await Promise.all([...viewers, ...(stop.others ?? [])].map(async (v) => (await d.get(v.links.self)).json.renderMs));
  stop.now = true;
  const times = (await Promise.all(drags)).flat();
  await other;
  for (const v of viewers) { v.ws.cut(); await d.delete(v.links.self); }
  return { median: median(times), used };
}

test('the first frames, before and in a drag, are already sized to come in time', async () => {
  const v = await viewer(HEAVY);
  const first = await v.ws.nextFrame();
  assert.ok(!first.header.final && first.header.width < 8192, `${first.header.width} pixels`);
  v.ws.send({ type: 'pointer', phase: 'start' });
  const { header } = await turn(v);
  assert.equal(header.final, false);
  assert.ok(header.width < 8192 && header.height < 2000, `${header.width}x${header.height}`);
  v.ws.cut();
  await d.delete(v.links.self);
});

test('a drag of huge pictures gets the render time of one, not more', async () => {
  const alone = await ordinary(2000);
  const beside = await ordinary(4000, async (stop) => {
    const v = await viewer(HEAVY);
    stop.others = [v];
    await drag(v, stop);
    v.ws.cut();
    await d.delete(v.links.self);
  });
  console.log(`wait: alone ${alone.median.toFixed(0)} ms, beside ${beside.median.toFixed(0)} ms; render time: ${beside.used.map(Math.round)} ms, the last one's the other's`);
  assert.ok(beside.median < 4 * alone.median + 100, `${beside.median} ms beside it, ${alone.median} ms alone`);
  assert.ok(beside.used[2] < 2.5 * Math.max(beside.used[0], beside.used[1]) + 200);
});

test('twenty renders of one peer hold up nobody who drags, and get done', async () => {
  const alone = await ordinary(1000);
  const renders = [];
  const beside = await ordinary(3000, async () => {
    for (let i = 0; i < 20; i++)
      renders.push(d.post('/v1/render', { volume: 'head', scene: { image: { width: 1024, height: 1024 }, sampling: { step: 0.5 }, camera: { fovY: 20 + i } } }));
  });
  console.log(`wait: alone ${alone.median.toFixed(0)} ms, beside ${beside.median.toFixed(0)} ms`);
  assert.ok(beside.median < 3 * alone.median + 60, `${beside.median} ms beside them, ${alone.median} ms alone`);
  for (const reply of await Promise.all(renders)) assert.equal(reply.status, 200);
  const metrics = (await d.get('/metrics')).bytes.toString();
  assert.match(metrics, /tomocast_preemptions_total\{class="single"\} [1-9]/);
  assert.match(metrics, /tomocast_class_queue_seconds_count\{class="interactive"\} [1-9]/);
});
