// A daemon of our own to load, and what the system says of its process.
import { spawn } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';

import { Target, Trouble } from './target.mjs';

export const TOP = join(dirname(fileURLToPath(import.meta.url)), '../..');
const PLACES = ['build/tomocast', 'build-tests/release/tomocast', 'build/release/tomocast'];
const PATIENCE_MS = 60000;
const MERCY_MS = 12000; // after SIGTERM
export const TICKS_PER_S = 100; // USER_HZ, fixed for user space on Linux
const MOST_LOG = 1 << 16;

export const sleep = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

/** The program to load. @throws {Trouble} */
export function findBinary(given) {
  const found = [given, process.env.TC_BINARY, ...PLACES.map((place) => join(TOP, place))].find((path) => path && existsSync(path));
  if (given && found !== given) throw new Trouble(`--binary ${given}: there is no such file`);
  if (!found) throw new Trouble('no tomocast is built here: run deploy/quickstart, or give --binary FILE, or --url of a running one');
  return found;
}

export class Daemon {
  log = '';

  /**
   * limits, server: rows of the configuration; files: how many it may open, 0 for what we may; readLog: false
   * leaves its stderr a pipe that nobody reads; apart: it believes us who asks
   */
  static async start({ binary, volume = 'demo:head', id = 'head', backend = 'auto', limits = {}, server = {}, files = 0, readLog = true, apart = false }) {
    const daemon = new Daemon();
    daemon.folder = mkdtempSync(join(tmpdir(), 'tomocast-load-'));
    const config = join(daemon.folder, 'config');
    const rows = (group) => Object.entries(group).map(([name, value]) => `${name}=${value}\n`).join('');
    writeFileSync(config, `[server]\n${rows({ spool: daemon.folder, ...server })}[limits]\n${rows(limits)}`);
    const all = ['serve', '--listen', '127.0.0.1:0', '--backend', backend, '--config', config, '--data', daemon.folder,
      '--volume', `${id}=${volume}`, ...(apart ? ['--trusted-proxy', '127.0.0.1'] : [])];
    const shell = files ? ['sh', '-c', `ulimit -Sn ${files} && exec "$@"`, 'sh'] : [];
    const [program, ...rest] = [...shell, binary, ...all];
    const child = spawn(program, rest, { stdio: ['ignore', 'pipe', 'pipe'], detached: true }); // Ctrl-C is for us
    daemon.process = child;
    daemon.pid = child.pid;
    const orphan = () => child.kill('SIGKILL');
    process.on('exit', orphan);
    if (readLog) child.stderr.on('data', (bytes) => (daemon.log = (daemon.log + bytes).slice(-MOST_LOG)));
    daemon.ended = new Promise((resolve) => {
      child.on('exit', (code, signal) => {
        process.off('exit', orphan);
        resolve((daemon.exit = { code, signal }));
      });
      child.on('error', (error) => resolve((daemon.exit = { code: error.message, signal: null })));
    });
    try {
      daemon.target = new Target(await daemon.#address());
      await daemon.#resident(id);
    } catch (error) {
      const { died, code } = await daemon.stop();
      throw died ? new Trouble(`the daemon ended before its volume was there (${code}): ${daemon.log.trim().split('\n').at(-1)}`) : error;
    }
    return daemon;
  }

  #address() {
    return new Promise((resolve, reject) => {
      let said = '';
      this.process.stdout.on('data', (bytes) => {
        const found = /^listening on (http:\/\/\S+)\n/.exec((said += bytes));
        if (found) resolve(found[1]);
      });
      this.ended.then(reject);
    });
  }

  async #resident(id) {
    for (const end = Date.now() + PATIENCE_MS; Date.now() < end; await sleep(50)) {
      const { state, reason } = await this.target.json('GET', `/v1/volumes/${id}`);
      if (state === 'resident') return;
      if (state === 'failed') throw new Trouble(`--volume: ${reason ?? 'the volume cannot be loaded'}`);
    }
    throw new Trouble('--volume: the volume is not loaded within a minute');
  }

  /**
   * SIGTERM, then SIGKILL. @returns {{seconds, killed, died, code}} how long it took to go; died: of something else,
   * which is known for certain only now: connections of a dying process close before the system says that it has gone
   */
  async stop() {
    const began = performance.now();
    const gone = !!this.exit;
    let killed = false;
    const late = setTimeout(() => {
      killed = true;
      this.process.kill('SIGKILL');
    }, MERCY_MS);
    if (!this.exit) this.process.kill('SIGTERM');
    const { code, signal } = await this.ended;
    clearTimeout(late);
    this.target?.close();
    rmSync(this.folder, { recursive: true, force: true });
    const died = gone || !(killed || code === 0 || signal === 'SIGTERM');
    return { seconds: Math.round(performance.now() - began) / 1000, killed, died, code: code ?? signal };
  }
}

/** {cpuSeconds, residentMiB, peakMiB, threads} of a process on this machine; null where it is gone or not ours to see. */
export function processState(pid) {
  try {
    const stat = readFileSync(`/proc/${pid}/stat`, 'latin1');
    const fields = stat.slice(stat.lastIndexOf(')') + 2).split(' ');
    const status = readFileSync(`/proc/${pid}/status`, 'latin1');
    const kibibytes = (name) => Number(new RegExp(`^${name}:\\s+(\\d+)`, 'm').exec(status)?.[1] ?? 0);
    return {
      cpuSeconds: (Number(fields[11]) + Number(fields[12])) / TICKS_PER_S, threads: Number(fields[17]),
      residentMiB: kibibytes('VmRSS') / 1024, peakMiB: kibibytes('VmHWM') / 1024,
    };
  } catch {
    return null;
  }
}

/** Begins a new peak. Without the right to, peakMiB stays the one since the process began. */
export function forgetPeak(pid) {
  try {
    writeFileSync(`/proc/${pid}/clear_refs`, '5');
  } catch { /* another user's process */ }
}
