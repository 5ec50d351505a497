// Which measurements are made, and on which daemon: the steps of a ramp on one, every bad client on a fresh one.
import { BAD } from './bad.mjs';
import { Daemon, findBinary } from './daemon.mjs';
import { measure } from './measure.mjs';
import { readPath, recorded, synthetic } from './motion.mjs';
import { round } from './statistics.mjs';
import { Target, Trouble } from './target.mjs';

const ORDINARY = 4; // clients beside a bad one

/** @param onRun(run, all) after each measurement  @returns {{about, runs, table}} what came of it before `stopped` */
export async function campaign(options, { stopped, onStart, onTick, onRun }) {
  const steps = options.path ? readPath(options.path) : null;
  const motionOf = (scene, index) => (steps ? recorded(steps) : synthetic(scene, index, options));
  const found = { about: null, runs: [], table: [] };
  const one = async (place, run) => {
    if (stopped.aborted) return null;
    onStart?.(run);
    const made = await measure({ ...options, ...place, motionOf }, { ...run, seconds: options.seconds, stopped, onTick });
    found.runs.push(made);
    onRun?.(made, found);
    return made;
  };
  const on = (extra, what) => !stopped.aborted && withDaemon(options, extra, async (place) => {
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

/** Four alone, four beside a fifth, four beside each bad client; each on a daemon of its own. */
async function attack(options, on, one, found) {
  await on({}, (place) => one(place, { clients: ORDINARY, name: 'four alone' }));
  let beside = null;
  for (const [i, name] of options.bad.entries()) {
    if (i % options.repeat === 0)
      await on({}, async (place) => (beside = (await one(place, { clients: ORDINARY, bad: 'ordinary', name: 'four and a fifth' })) ?? beside));
    let made = null;
    const ended = await on(BAD[name], async (place) => (made = await one(place, { clients: ORDINARY, bad: name })));
    if (made) found.table.push(row(name, made, beside, ended));
  }
}

function row(name, made, beside, ended) {
  return {
    name, says: BAD[name].says, latencyMs: made.latencyMs, unanswered: made.unanswered, ordinaryP99: beside?.latencyMs.p99 ?? null,
    ratio: beside?.latencyMs.p99 ? round(made.latencyMs.p99 / beside.latencyMs.p99, 2) : null, healthMs: made.healthMs,
    loopLagMs: made.loopLagMs && { p50: made.loopLagMs.p50, p99: made.loopLagMs.p99, max: made.loopLagMs.max },
    jainRenderMs: made.jain.renderMs, peakMiB: made.peakMiB, ended: ended ?? null, errors: made.errors, bad: made.badClient,
  };
}

/** what(place) on the daemon of --url, or on one of our own. @returns how that one ended */
async function withDaemon(options, extra, what) {
  if (options.url) {
    const target = new Target(options.url.href, options.token);
    try {
      await what({ target, pid: options.pid || null, volume: await volumeOf(target, options.volume) });
    } finally {
      target.close();
    }
    return null;
  }
  const daemon = await Daemon.start({ binary: findBinary(options.binary), volume: options.volume, backend: options.backend, ...extra });
  let ended;
  try {
    await what({ target: daemon.target, pid: daemon.pid, volume: 'head' });
  } finally {
    ended = await daemon.stop();
  }
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
