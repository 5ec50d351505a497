// A daemon for one test file: started on an ephemeral port, used only from outside.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import net from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after } from 'node:test';

export const BINARY = process.env.TC_BINARY;
const PATIENCE_MS = 60000; // sanitizers are slow

export const sleep = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

/** What `what()` gives once that is true. */
export async function until(what) {
  for (const end = Date.now() + PATIENCE_MS; Date.now() < end; await sleep(20)) {
    const found = await what();
    if (found) return found;
  }
  throw new Error(`still not after ${PATIENCE_MS / 1000} s: ${what}`);
}

/** A small volume: a bright ball in the dark, as an attached raw NRRD. */
export function ballNrrd(n = 32, header = '') {
  const text = `NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: ${n} ${n} ${n}\n` +
    `space directions: (2,0,0) (0,2,0) (0,0,2)\nspace origin: (10,20,30)\nencoding: raw\n${header}\n`;
  const voxels = Buffer.alloc(n * n * n);
  const middle = (n - 1) / 2;
  for (let z = 0; z < n; z++)
    for (let y = 0; y < n; y++)
      for (let x = 0; x < n; x++) {
        const distance = Math.hypot(x - middle, y - middle, z - middle) / middle;
        voxels[(z * n + y) * n + x] = distance < 0.8 ? Math.round(255 * (1 - distance / 2)) : 0;
      }
  return Buffer.concat([Buffer.from(text), voxels]);
}

/**
 * A daemon left by a failed test keeps the test file running. The hook runs before the file's own hooks, which stop
 * daemons normally; stop() removes them from the set.
 */
const running = new Set();
const endLeftovers = () => running.forEach((child) => child.kill('SIGKILL'));
if (process.env.NODE_TEST_CONTEXT) after(() => setTimeout(endLeftovers, PATIENCE_MS).unref());

export class Daemon {
  stderr = '';
  stdout = '';
  exit = null;

  /**
   * @param {object} options args: more arguments; config: text of a configuration file; ball: false for no volume;
   *   files: {name: bytes} for the data folder; n: side of the ball; token: sent with every call();
   *   group: folder of a control group to run in
   */
  static async start({ args = [], config = '', ball = true, files = {}, n = 32, env = {}, token = '', group } = {}) {
    assert.ok(BINARY, 'set TC_BINARY to the program to test');
    const daemon = new Daemon();
    daemon.token = token;
    daemon.folder = mkdtempSync(join(tmpdir(), 'tomocast-test-'));
    for (const [name, bytes] of Object.entries({ 'ball.nrrd': ballNrrd(n), ...files })) {
      writeFileSync(join(daemon.folder, name), bytes);
    }
    const all = ['serve', '--listen', '127.0.0.1:0', '--data', daemon.folder, ...args];
    if (ball) all.push('--volume', `ball=${join(daemon.folder, 'ball.nrrd')}`);
    if (config) {
      daemon.config = join(daemon.folder, '.config');
      writeFileSync(daemon.config, config);
      all.push('--config', daemon.config);
    }
    const [program, ...rest] = group ? ['sh', '-c', 'echo $$ >"$0/cgroup.procs" && exec "$@"', group, BINARY, ...all] : [BINARY, ...all];
    daemon.process = spawn(program, rest, { stdio: ['ignore', 'pipe', 'pipe'], env: { ...process.env, ...env } });
    running.add(daemon.process);
    daemon.process.stderr.on('data', (bytes) => (daemon.stderr += bytes));
    daemon.ended = new Promise((resolve) => {
      daemon.process.on('exit', (code, signal) => {
        running.delete(daemon.process);
        resolve((daemon.exit = { code, signal }));
      });
      daemon.process.on('error', (error) => resolve((daemon.exit = { code: String(error), signal: null })));
    });
    try {
      await daemon.#listening();
      if (ball) await daemon.resident('ball');
    } catch (error) {
      daemon.process.kill('SIGKILL');
      throw error;
    }
    return daemon;
  }

  #listening() {
    return new Promise((resolve, reject) => {
      this.process.stdout.on('data', (bytes) => {
        this.stdout += bytes;
        const found = /^listening on (http:\/\/127\.0\.0\.1:(\d+))\n/.exec(this.stdout);
        if (!found) return;
        [, this.base, this.port] = found;
        this.port = Number(this.port);
        resolve();
      });
      this.ended.then(({ code }) => reject(new Error(`the daemon ended with ${code}: ${this.stderr}`)));
    });
  }

  /** What is on stderr once it matches: a line may come after the reply that it is about. */
  async logged(wanted) {
    await until(() => wanted.test(this.stderr)).catch(() => assert.match(this.stderr, wanted));
    return this.stderr;
  }

  async resident(id) {
    const json = await this.loaded(`/v1/volumes/${id}`);
    assert.equal(json.state, 'resident', JSON.stringify(json));
    return json;
  }

  /** The volume or mesh of a path once it is resident or has failed. */
  loaded(path) {
    return until(async () => {
      const { json } = await this.get(path);
      if (json.state !== 'loading') return json;
      assert.ok(json.fraction >= 0 && json.fraction <= 1, JSON.stringify(json));
      return null;
    });
  }

  /** @returns {{status, headers, json, bytes}} */
  async call(method, path, { json, body, headers = {}, type } = {}) {
    const all = { ...(this.token && { authorization: `Bearer ${this.token}` }), ...headers };
    if (json !== undefined) all['content-type'] = type ?? 'application/json';
    else if (type) all['content-type'] = type;
    const reply = await fetch(this.base + path, {
      method, headers: all, body: json === undefined ? body : JSON.stringify(json), signal: AbortSignal.timeout(PATIENCE_MS),
    });
    const bytes = Buffer.from(await reply.arrayBuffer());
    const isJson = /json/.test(reply.headers.get('content-type') ?? '') && bytes.length > 0;
    return { status: reply.status, headers: reply.headers, bytes, json: isJson ? JSON.parse(bytes) : undefined };
  }

  get(path, options) { return this.call('GET', path, options); }
  post(path, json, options) { return this.call('POST', path, { json, ...options }); }
  put(path, json, options) { return this.call('PUT', path, { json, ...options }); }
  patch(path, json, options) { return this.call('PATCH', path, { json, type: 'application/merge-patch+json', ...options }); }
  delete(path) { return this.call('DELETE', path); }

  /** A session on the ball, quick to render. */
  async session(scene = {}) {
    const image = { width: 96, height: 64, ...scene.image };
    const { status, json } = await this.post('/v1/sessions', { volume: 'ball', scene: { ...scene, image } });
    assert.equal(status, 201, JSON.stringify(json));
    return json;
  }

  /** Sends bytes and returns the bytes received until the server closes or is silent for `quietMs`. */
  raw(bytes, quietMs = 3000) {
    return new Promise((resolve) => {
      const socket = net.connect(this.port, '127.0.0.1', () => socket.write(bytes));
      let text = '';
      const done = () => { socket.destroy(); resolve(text); };
      socket.setTimeout(quietMs, done);
      socket.on('data', (piece) => (text += piece.toString('latin1')));
      socket.on('error', done);
      socket.on('close', done);
    });
  }

  /** The value of a metric. */
  async metric(name) {
    const { bytes } = await this.get('/metrics');
    const line = bytes.toString().split('\n').find((text) => text.startsWith(`tomocast_${name} `));
    assert.ok(line, `metric ${name}`);
    return Number(line.split(' ')[1]);
  }

  /** Stops the daemon and checks for a clean exit. Sanitizer reports make the exit code nonzero. */
  async stop(signal = 'SIGTERM') {
    running.delete(this.process);
    if (!this.exit) this.process.kill(signal);
    const late = setTimeout(() => this.process.kill('SIGKILL'), 30000);
    const { code, signal: by } = await this.ended;
    clearTimeout(late);
    rmSync(this.folder, { recursive: true, force: true });
    assert.deepEqual({ code, by }, { code: 0, by: null }, this.stderr);
    assert.doesNotMatch(this.stderr, /Sanitizer|runtime error/);
    assert.equal(this.stdout.split('\n').length, 2, 'exactly one line on stdout');
  }
}

/** Checks an RFC 9457 problem and returns it. */
export function problem(reply, status, pointer) {
  assert.equal(reply.status, status, reply.bytes.toString());
  assert.match(reply.headers.get('content-type'), /^application\/problem\+json/);
  const { json } = reply;
  assert.match(json.type, /^urn:tomocast:problem:[a-z-]+$/);
  assert.equal(json.status, status);
  assert.ok(json.title.length > 0 && json.detail.length > 0);
  if (pointer !== undefined) assert.equal(json.pointer, pointer);
  return json;
}

/** Width and height of a JPEG or PNG, from its bytes. */
export function imageSize(bytes) {
  if (bytes.readUInt32BE(0) === 0x89504e47) return { format: 'png', width: bytes.readUInt32BE(16), height: bytes.readUInt32BE(20) };
  assert.equal(bytes.readUInt16BE(0), 0xffd8, 'neither PNG nor JPEG');
  assert.equal(bytes.readUInt16BE(bytes.length - 2), 0xffd9, 'the JPEG is cut');
  for (let at = 2; at < bytes.length;) {
    const marker = bytes[at + 1];
    if (marker >= 0xc0 && marker <= 0xc3) return { format: 'jpeg', height: bytes.readUInt16BE(at + 5), width: bytes.readUInt16BE(at + 7) };
    at += 2 + bytes.readUInt16BE(at + 2);
  }
  throw new Error('no size in the JPEG');
}
