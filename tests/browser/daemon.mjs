// The real daemon as a child process. TC_BINARY names the program; without it, tests that need it are skipped.
import { spawn } from 'node:child_process';
import { existsSync } from 'node:fs';

/** Why the daemon cannot be run here, or false. */
export function daemonMissing() {
  const binary = process.env.TC_BINARY;
  if (!binary) return 'TC_BINARY is not set: the real daemon is not tested';
  return existsSync(binary) ? false : `TC_BINARY: there is no ${binary}`;
}

/** @returns {Promise<{url: string, port: number, kill(): Promise, stop(): Promise<number>}>} when it listens */
export async function startDaemon(args, port = 0) {
  const child = spawn(process.env.TC_BINARY, ['serve', '--listen', `127.0.0.1:${port}`, ...args], {
    stdio: ['ignore', 'pipe', 'pipe'],
  });
  const ended = new Promise((resolve) => child.on('exit', (code) => resolve(code)));
  const url = await listening(child);
  const end = (signal) => {
    child.kill(signal);
    return ended;
  };
  return { url, port: Number(new URL(url).port), kill: () => end('SIGKILL'), stop: () => end('SIGTERM') };
}

function listening(child) {
  return new Promise((resolve, reject) => {
    let text = '';
    const hear = (data) => {
      text += data;
      const found = /listening on (http:\/\/\S+)/.exec(text);
      if (found) resolve(`${found[1].replace(/\/$/, '')}/`);
    };
    child.stdout.on('data', hear);
    child.stderr.on('data', hear);
    child.on('exit', (code) => reject(new Error(`the daemon ended with ${code}: ${text}`)));
  });
}

/** A small NRRD: a bright ball in air, 32 voxels a side. */
export function smallNrrd() {
  const n = 32;
  const header =
    `NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: ${n} ${n} ${n}\n` +
    'space directions: (2,0,0) (0,2,0) (0,0,2)\nkinds: domain domain domain\nendian: little\nencoding: raw\n' +
    'space origin: (-31,-31,-31)\n\n';
  const voxels = Buffer.alloc(n ** 3 * 2);
  for (let i = 0; i < n ** 3; i++) {
    const away = Math.hypot((i % n) - 15.5, (Math.floor(i / n) % n) - 15.5, Math.floor(i / n / n) - 15.5);
    voxels.writeInt16LE(Math.round(away < 12 ? 1000 : -1000 + 10 * Math.max(0, 20 - away)), 2 * i);
  }
  return Buffer.concat([Buffer.from(header), voxels]);
}
