// One measurement: so many clients for so many seconds, beside a bad one or none. Gives plain values for JSON.
import { Client } from './client.mjs';
import { sleep } from './daemon.mjs';
import { HealthProbe, ProcessWatch } from './probe.mjs';
import { RestMix } from './rest.mjs';
import {
  boundOf, distribution, greatestPerBin, histogramBetween, jain, readMetrics, round, sum, summary,
} from './statistics.mjs';
import { startBad } from './bad_host.mjs';

const WARM_MS = 1000;
const GRACE_MS = 5000; // for what is still on its way when the hands rest
const BIN_MS = 250;
const LAG = 'tomocast_loop_lag_seconds';
const TURN_CPU = 'tomocast_loop_turn_cpu_seconds';

/**
 * @param setup {target, pid?, volume, image, motionOf(scene, index), rate, rest?: {perSecond, mix}}
 * @param {{clients, seconds, bad?: string, name?, stopped: AbortSignal, onTick?}} run
 */
export async function measure(setup, run) {
  const { target } = setup;
  const from = (i) => (setup.apart ? target.from(`10.0.${i >> 8}.${i & 255}`) : target);
  const clients = Array.from({ length: run.clients }, (_, i) => new Client({ ...setup, target: from(i), motionOf: (scene) => setup.motionOf(scene, i) }));
  if (run.record && clients[0]) clients[0].record = [];
  const rest = setup.rest && new RestMix({ target, volume: setup.volume, ...setup.rest });
  let bad, health, watch;
  try {
    for (const client of clients) await client.open();
    await rest?.open();
    if (run.bad) bad = await startBad(run.bad, { ...setup, target: from(run.clients) });
    for (const client of clients) client.start();
    await pause(WARM_MS, run);
    const before = await scrape(target);
    const charged = await renderTimes(target);
    const began = performance.now();
    health = new HealthProbe(target, began);
    watch = new ProcessWatch(setup.pid, began);
    rest?.start();
    bad?.begin();
    await pause(run.seconds * 1000, run, () => run.onTick?.(clients, performance.now() - began));
    const ended = performance.now();
    const chargedThen = await renderTimes(target);
    await settle(clients, run);
    const badSays = await bad?.stop();
    await health.stop();
    watch.stop(badSays?.cpuMs);
    const after = await scrape(target);
    const renderMs = clients.map(({ session }) => (chargedThen.get(session) ?? NaN) - (charged.get(session) ?? NaN));
    return report({ setup, run, clients, rest, health, watch, before, after, renderMs, began, ended, badSays });
  } finally {
    await bad?.stop();
    await health?.stop();
    watch?.stop();
    await Promise.all([...clients, ...(rest ? [rest] : [])].map((one) => one.close()));
  }
}

async function pause(ms, { stopped }, onTick) {
  for (const end = performance.now() + ms; performance.now() < end && !stopped.aborted;) {
    await sleep(Math.min(100, Math.max(1, end - performance.now())));
    onTick?.();
  }
}

/** The hands rest; what was asked may still be answered. */
async function settle(clients, { stopped }) {
  for (const client of clients) client.rest();
  const waits = () => clients.some((client) => client.waiting && !client.ws.closed);
  for (const end = performance.now() + GRACE_MS; waits() && performance.now() < end && !stopped.aborted;) await sleep(10);
}

async function scrape(target) {
  try {
    const { status, bytes } = await target.request('GET', '/metrics', { fresh: true, patienceMs: 5000 });
    return status === 200 ? readMetrics(bytes.toString()) : new Map();
  } catch {
    return new Map();
  }
}

/** Milliseconds of the renderer that each session was charged so far. */
async function renderTimes(target) {
  const { status, bytes } = await target.request('GET', '/v1/sessions', { patienceMs: 5000 }).catch(() => ({}));
  return new Map(status === 200 ? JSON.parse(bytes).sessions.map(({ id, renderMs }) => [id, renderMs]) : []);
}

function report({ setup, run, clients, rest, health, watch, before, after, renderMs, began, ended, badSays }) {
  const seconds = (ended - began) / 1000;
  const each = clients.map((client) => clientReport(client, began, ended));
  const waits = each.flatMap(({ waits }) => waits);
  const frames = each.flatMap(({ frames }) => frames);
  const errors = new Map();
  for (const one of [...clients, ...(rest ? [rest] : [])])
    for (const [kind, count] of one.errors) errors.set(kind, (errors.get(kind) ?? 0) + count);
  const stage = (name) => summary(frames.map((frame) => frame[name] ?? 0));
  return {
    name: run.name ?? run.bad ?? `${run.clients} client${run.clients > 1 ? 's' : ''}`, clients: run.clients, bad: run.bad ?? null, seconds: round(seconds, 2),
    complete: !run.stopped.aborted,
    framesPerSecond: round(frames.length / seconds, 1),
    framesPerSecondPerClient: run.clients ? round(frames.length / seconds / run.clients, 1) : null,
    bytesPerSecond: Math.round(sum(frames.map(({ bytes }) => bytes)) / seconds),
    latencyMs: summary(waits), latencyCdf: distribution(waits),
    unanswered: sum(each.map(({ unanswered }) => unanswered)),
    stagesMs: { queue: stage('queueMs'), tables: stage('tablesMs'), render: stage('renderMs'), encode: stage('encodeMs') },
    streamPingMs: summary(clients.flatMap(({ pings }) => pings)),
    healthMs: { ...summary(health.samples.map(([, ms]) => ms)), failed: health.failed },
    loopLagMs: turns(before, after, LAG), loopCpuMs: turns(before, after, TURN_CPU),
    jain: { frames: jain(each.map(({ frames }) => frames.length)), renderMs: jain(renderMs) },
    cpuCores: round(watch.cores(), 2), otherCores: round(watch.otherCores(), 2), peakMiB: round(watch.peakMiB, 1), toolLagMs: round(watch.toolLagMs(), 1),
    toolLagMaxMs: round(watch.toolLagMaxMs(), 1), stolenMs: watch.stolenMs,
    errors: Object.fromEntries(errors),
    rest: rest ? Object.fromEntries([...rest.samples].filter(([, ms]) => ms.length).map(([name, ms]) => [name, summary(ms)])) : null,
    badClient: badSays ?? null,
    waits, // taken away before it is written
    perClient: each.map(({ waits, frames, line, unanswered }, i) => ({
      frames: frames.length, bytes: sum(frames.map(({ bytes }) => bytes)), renderMs: round(renderMs[i], 1),
      latencyMs: summary(waits), latencyCdf: distribution(waits), line, unanswered,
    })),
    record: clients[0]?.record ?? undefined,
    timeline: {
      binMs: BIN_MS, health: greatestPerBin(health.samples, BIN_MS, seconds * 1000),
      process: watch.samples.map(({ at, cpuSeconds, residentMiB }) => [Math.round(at), round(cpuSeconds, 2), round(residentMiB, 1)]),
    },
    setting: { image: setup.image, rate: setup.rate, volume: setup.volume },
  };
}

/** What one client saw of the patches it sent, and the frames it got, between the two moments. */
function clientReport(client, began, ended) {
  const unanswered = client.giveUp();
  const during = client.latencies.filter(([sent]) => sent >= began && sent < ended);
  return {
    unanswered,
    waits: during.map(([, waited]) => waited),
    frames: client.frames.filter(({ at }) => at >= began && at < ended),
    line: greatestPerBin(during.map(([sent, waited]) => [sent - began, waited]), BIN_MS, ended - began),
  };
}

/** One of the daemon's own histograms of its loop's turns, where it keeps one. Bounds of buckets: "at most". */
function turns(before, after, name) {
  return quantiles(histogramBetween(before, after, name));
}

export function quantiles(buckets) {
  const ms = (fraction) => {
    const bound = boundOf(buckets, fraction);
    return bound === null ? null : bound === Infinity ? 'more' : round(bound * 1000);
  };
  return buckets.length ? { p50: ms(0.5), p99: ms(0.99), max: ms(1), buckets } : null;
}
