// What is seen from beside: how soon /healthz is answered, what the process uses, how late this tool itself runs.
import { readFileSync } from 'node:fs';
import { cpus } from 'node:os';
import { monitorEventLoopDelay } from 'node:perf_hooks';

import { forgetPeak, processState, sleep, TICKS_PER_S } from './daemon.mjs';

const HEALTH_MS = 50;
const HEALTH_PATIENCE_MS = 5000;
const MOST_OPEN = 64; // probes in the air; more would be an attack of our own
const PROCESS_MS = 100;

/** GET /healthz twenty times a second, each on a connection of its own, whatever became of the one before. */
export class HealthProbe {
  samples = []; // [asked, ms]; a probe without an answer counts with its age
  failed = 0;
  #open = new Map();
  #number = 0;

  constructor(target, began) {
    this.target = target;
    this.began = began;
    this.timer = setInterval(() => this.#ask(), HEALTH_MS);
  }

  #ask() {
    const asked = performance.now();
    if (this.#open.size >= MOST_OPEN) {
      this.failed++;
      return;
    }
    const number = this.#number++;
    this.#open.set(number, asked);
    const done = (good) => {
      if (!this.#open.delete(number)) return;
      this.samples.push([asked - this.began, performance.now() - asked]);
      if (!good) this.failed++;
    };
    this.target.request('GET', '/healthz', { fresh: true, patienceMs: HEALTH_PATIENCE_MS })
      .then(({ status }) => done(status === 200), () => done(false));
  }

  /** The probes still in the air get a second more. */
  async stop() {
    clearInterval(this.timer);
    for (let i = 0; i < 50 && this.#open.size; i++) await sleep(20);
    const now = performance.now();
    for (const asked of this.#open.values()) this.samples.push([asked - this.began, now - asked]);
    this.failed += this.#open.size;
    this.#open.clear();
  }
}

/** What the hypervisor gave to others of this machine's processors so far, which no program here can help. */
function stolen() {
  try {
    return Number(readFileSync('/proc/stat', 'latin1').split(/\s+/, 9)[8]) * 1000 / TICKS_PER_S;
  } catch {
    return null;
  }
}

/** Processor time of this machine so far without this tool's own. */
function spent() {
  const { user, system } = process.cpuUsage();
  const all = cpus().flatMap(({ times }) => [times.user, times.nice, times.sys, times.irq]);
  return { at: performance.now(), stolenMs: stolen(), elsewhereMs: all.reduce((a, b) => a + b, 0) - (user + system) / 1000 };
}

/** CPU and memory of a process on this machine over time, with this tool's own lateness. */
export class ProcessWatch {
  samples = []; // {at, cpuSeconds, residentMiB}
  peakMiB = null;

  constructor(pid, began) {
    this.pid = pid;
    this.began = began;
    this.delay = monitorEventLoopDelay({ resolution: 5 });
    this.delay.enable();
    if (pid) forgetPeak(pid);
    this.spent = spent();
    this.#look();
    this.timer = setInterval(() => this.#look(), PROCESS_MS);
  }

  #look() {
    const state = this.pid && processState(this.pid);
    if (!state) return;
    this.samples.push({ at: performance.now() - this.began, cpuSeconds: state.cpuSeconds, residentMiB: state.residentMiB });
    this.peakMiB = state.peakMiB;
  }

  /** besideMs: processor time of what this tool ran beside. */
  stop(besideMs = 0) {
    this.#look();
    clearInterval(this.timer);
    this.delay.disable();
    const then = spent();
    this.elsewhereMs = then.elsewhereMs - this.spent.elsewhereMs - besideMs;
    this.stolenMs = then.stolenMs === null ? null : then.stolenMs - this.spent.stolenMs;
    this.forMs = then.at - this.spent.at;
  }

  /** Cores in use on average. */
  cores() {
    if (this.samples.length < 2) return null;
    const [first, last] = [this.samples[0], this.samples.at(-1)];
    return ((last.cpuSeconds - first.cpuSeconds) * 1000) / (last.at - first.at);
  }

  /** Cores that processes other than the daemon and this tool used on average; null for a daemon elsewhere. */
  otherCores() {
    const daemon = this.cores();
    return daemon === null ? null : Math.max(0, this.elsewhereMs / this.forMs - daemon);
  }

  toolLagMs() { return Math.max(0, this.delay.percentile(99) / 1e6 - 5); }
  toolLagMaxMs() { return Math.max(0, this.delay.max / 1e6 - 5); }
}
