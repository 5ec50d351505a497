// A headless Firefox driven over Marionette, its own remote protocol: "LENGTH:[0, id, command, parameters]" over TCP.
import { spawn } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { connect } from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

const BINARY = process.env.TC_FIREFOX ?? '/usr/bin/firefox-esr';
const START_MS = 60000;

/** Why Firefox cannot be driven here, or false. */
export const firefoxMissing = () => (existsSync(BINARY) ? false : `no browser at ${BINARY}`);

const sleep = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

/** @returns {Promise<{send(command, parameters): Promise, script(function, ...args): Promise, close(): Promise}>} */
export async function launchFirefox() {
  const profile = mkdtempSync(join(tmpdir(), 'tomocast-firefox-'));
  writeFileSync(join(profile, 'user.js'), 'user_pref("marionette.port", 0);\nuser_pref("browser.shell.checkDefaultBrowser", false);\n');
  const child = spawn(BINARY, ['--headless', '--marionette', '--no-remote', '--profile', profile, '--width', '1000', '--height', '700'], {
    stdio: 'ignore',
    env: { ...process.env, HOME: profile, MOZ_HEADLESS_WIDTH: '1000', MOZ_HEADLESS_HEIGHT: '700' },
  });
  const ended = new Promise((resolve) => child.on('exit', resolve));
  const end = async () => {
    child.kill('SIGTERM');
    await Promise.race([ended, sleep(5000).then(() => child.kill('SIGKILL'))]);
    await ended;
    rmSync(profile, { recursive: true, force: true, maxRetries: 5, retryDelay: 200 });
  };
  try {
    const wire = await marionette(await portOf(profile));
    await wire.send('WebDriver:NewSession', {});
    return { ...wire, close: () => wire.close().then(end) };
  } catch (error) {
    await end();
    throw error;
  }
}

// The port is Firefox's choice: it writes it into its profile.
async function portOf(profile) {
  const file = join(profile, 'MarionetteActivePort');
  for (const until = Date.now() + START_MS; Date.now() < until; await sleep(100)) {
    const port = existsSync(file) ? Number(readFileSync(file, 'utf8')) : 0;
    if (port) return port;
  }
  throw new Error('Firefox did not start');
}

async function marionette(port) {
  const socket = connect(port, '127.0.0.1');
  const waiting = new Map();
  let rest = Buffer.alloc(0);
  let next = 1;
  const take = () => {
    const colon = rest.indexOf(':');
    const size = colon < 0 ? NaN : Number(rest.subarray(0, colon));
    if (!(rest.length >= colon + 1 + size)) return false;
    const message = JSON.parse(rest.subarray(colon + 1, colon + 1 + size));
    rest = rest.subarray(colon + 1 + size);
    const [, id, error, result] = Array.isArray(message) ? message : [];
    if (error) waiting.get(id)?.reject(new Error(`${error.error}: ${error.message}`));
    else waiting.get(id)?.resolve(result);
    return true;
  };
  socket.on('data', (data) => {
    rest = Buffer.concat([rest, data]);
    while (take());
  });
  socket.on('close', () => waiting.forEach(({ reject }) => reject(new Error('Firefox is gone'))));
  await new Promise((resolve, reject) => socket.once('connect', resolve).once('error', reject));
  const send = (command, parameters) =>
    new Promise((resolve, reject) => {
      const id = next++;
      const text = JSON.stringify([0, id, command, parameters]);
      waiting.set(id, { resolve, reject });
      socket.write(`${Buffer.byteLength(text)}:${text}`);
    });
  const script = async (fn, ...args) =>
    (await send('WebDriver:ExecuteScript', { script: `return (${fn})(...arguments)`, args, sandbox: null })).value;
  const close = async () => {
    waiting.clear();
    socket.destroy();
  };
  return { send, script, close };
}
