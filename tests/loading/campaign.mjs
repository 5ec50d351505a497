// Which measurements are made, and on which daemon: the steps of a ramp on one, every bad client on a fresh one.
import { BAD } from './bad.mjs';
import { Daemon, findBinary } from './daemon.mjs';
import { measure, quantiles } from './measure.mjs';
import { readPath, recorded, synthetic } from './motion.mjs';
import { round, sum, summary } from './statistics.mjs';
import { Target, Trouble } from './target.mjs';

const ORDINARY = 4; // clients beside a bad one
const LAST_WORDS = 60; // lines of a dead daemon's log

/** @param onRun(run, all) after each measurement  @returns {{about, runs, table}} what came of it before `stopped` */
export async function campaign(options, { stopped, onStart, onTick, onRun, onDeath }) {
  const steps = options.path ? readPath(options.path) : null;
  const motionOf = (scene, index) => (steps ? recorded(steps) : synthetic(scene, index, options));
  const found = { about: null, runs: [], table: [] };
  const one = async (place, run) => {
    const over = AbortSignal.any([stopped, place.ended]);
    if (over.aborted) return null;
    onStart?.(run);
    const made = await measure({ ...options, ...place, motionOf }, { ...run, seconds: options.seconds, stopped: over, onTick });
    found.runs.push(made);
    onRun?.(made, found);
    return made;
  };
  const on = (extra, what) => !stopped.aborted && withDaemon(options, extra, onDeath, async (place) => {
    found.about ??= await aboutOf(place);
    await what(place);
  });
  if (options.bad.length) await attack(options, on, one, found);
  else await on({}, (place) => ramp(options, place, one));
  return found;
}

async function ramp(options, place, one) {
  for (const [i, clients] of options.clients.entries()) await one(place, { clients, record: i === 0 && !!options.record });
}

/**
 * Four alone, four beside a fifth, four beside each bad client; each on a daemon of its own. All of it as often as
 * --rounds says, in turns: a row is made of all its runs, so that one hiccup of the machine, which is 1 % of a run, does not
 * decide it.
 */
async function attack(options, on, one, found) {
  await on({}, (place) => one(place, { clients: ORDINARY, name: 'four alone' }));
  const beside = [];
  const rows = new Map(options.bad.map((name) => [name, []]));
  for (let i = 0; i < options.rounds * options.bad.length; i++) {
    const name = options.bad[i % options.bad.length];
    if (i % options.repeat === 0)
      await on({}, async (place) => beside.push(await one(place, { clients: ORDINARY, bad: 'ordinary', name: 'four and a fifth' })));
    let made = null;
    const ended = await on(BAD[name], async (place) => (made = await one(place, { clients: ORDINARY, bad: name })));
    if (made) rows.get(name).push({ ...made, ended });
  }
  for (const [name, runs] of rows) if (runs.length) found.table.push(row(name, runs, beside.filter(Boolean)));
}

/** All runs of a row together: the waits of all, else the worst of them. */
export function row(name, runs, beside) {
  const latencyMs = summary(runs.flatMap(({ waits }) => waits)), ordinary = summary(beside.flatMap(({ waits }) => waits));
  const most = (of) => runs.map(of).reduce((a, b) => (b > a || a === null ? b : a), null);
  const p99 = ({ waits }) => summary(waits).p99;
  const last = runs.at(-1);
  return {
    name, says: BAD[name].says, runs: runs.length, latencyMs, unanswered: sum(runs.map(({ unanswered }) => unanswered)), ordinaryP99: ordinary.p99,
    eachP99: { row: runs.map(p99), ordinary: beside.map(p99) },
    ratio: ordinary.p99 ? round(latencyMs.p99 / ordinary.p99, 2) : null,
    healthMs: { p99: most(({ healthMs }) => healthMs.p99), max: most(({ healthMs }) => healthMs.max) },
    loopLagMs: together(runs.map(({ loopLagMs }) => loopLagMs)), loopCpuMs: together(runs.map(({ loopCpuMs }) => loopCpuMs)),
    jainRenderMs: runs.map(({ jain }) => jain.renderMs).reduce((a, b) => (a === null || b < a ? b : a)), peakMiB: most(({ peakMiB }) => peakMiB),
    ended: runs.some(({ ended }) => ended?.died) ? runs.find(({ ended }) => ended?.died).ended : last.ended ?? null, errors: last.errors, bad: last.badClient,
  };
}

/** Histograms of the same bounds as one; null where a daemon keeps none. */
function together(many) {
  if (!many.every(Boolean)) return null;
  const [first, ...rest] = many.map(({ buckets }) => buckets);
  return quantiles(first.map(([bound, count], i) => [bound, sum([count, ...rest.map((other) => other[i][1])])]));
}

/** what(place) on the daemon of --url, or on one of our own: onDeath(code, lines of its log) where that ended by itself. @returns how it ended */
async function withDaemon(options, extra, onDeath, what) {
  if (options.url) {
    const target = new Target(options.url.href, options.token);
    try {
      await what({ target, ended: new AbortController().signal, pid: options.pid || null, volume: await volumeOf(target, options.volume) });
    } finally {
      target.close();
    }
    return null;
  }
  const daemon = await Daemon.start({ binary: findBinary(options.binary), volume: options.volume, backend: options.backend, apart: options.apart, ...extra });
  const gone = new AbortController(); // nothing is measured of a dead daemon
  daemon.ended.then(() => gone.abort());
  let trouble = null;
  await what({ target: daemon.target, ended: gone.signal, pid: daemon.pid, volume: 'head' }).catch((error) => (trouble = error));
  const ended = await daemon.stop();
  if (ended.died) onDeath?.(ended.code, daemon.log.trim().split('\n').slice(-LAST_WORDS));
  if (trouble && !(ended.died && trouble instanceof Trouble)) throw trouble; // what a dead daemon did not answer is no news
  return ended;
}

/** The volume that was named, or the first there is. @throws {Trouble} */
async function volumeOf(target, named) {
  const { volumes } = await target.json('GET', '/v1/volumes');
  const resident = volumes.filter(({ state }) => state === 'resident').map(({ id }) => id);
  if (named && !resident.includes(named)) throw new Trouble(`--volume ${named}: not resident there; there are ${resident.join(', ') || 'none'}`);
  if (!resident.length) throw new Trouble('the daemon has no volume: start it with --volume head=demo:head');
  return named ?? resident[0];
}

async function aboutOf({ target, volume }) {
  const { name, version, backend, device, simd } = await target.json('GET', '/v1/about');
  return { name, version, backend, device, simd, volume };
}
