// A bad client in a process of its own, which can be ended.
//
// A stranger brings a machine of its own: here its work must not take the processors from the daemon, whose drawing runs
// at a lower priority than usual. So the whole process is of the lowest: its start, compilers and collectors of garbage too.
import { fork } from 'node:child_process';
import { fileURLToPath } from 'node:url';

const END_MS = 3000;
const LOWEST = { execPath: 'nice', execArgv: ['-n', '19', process.execPath] };

/** Starts the process, which waits. @returns {{begin(), stop(): Promise<{counts, cpuMs, trouble}>}} */
export async function startBad(name, { target, volume, image, rate }) {
  const child = fork(fileURLToPath(new URL('./bad_process.mjs', import.meta.url)), [], LOWEST);
  let says = { counts: {}, cpuMs: 0, trouble: '' };
  const ended = new Promise((resolve) => child.on('exit', resolve).on('error', resolve));
  child.on('message', (message) => (says = message));
  child.on('error', (error) => (says = { ...says, trouble: error.message }));
  await Promise.race([new Promise((resolve) => child.once('message', resolve)), ended]);
  const send = (what) => child.connected && child.send(what, () => {});
  let stopping;
  const stop = async () => {
    send('stop');
    const late = setTimeout(() => child.kill('SIGKILL'), END_MS);
    await ended;
    clearTimeout(late);
    return says;
  };
  return {
    begin: () => send({ name, base: target.base.href, token: target.token, address: target.address, volume, image, rate }),
    stop: () => (stopping ??= stop()),
  };
}
