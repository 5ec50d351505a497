// A bad client in a thread of its own, so that its work does not delay what is measured here, and can be ended.
import { Worker } from 'node:worker_threads';

const END_MS = 3000;

/** @returns {{stop(): Promise<{counts, trouble?}>}} */
export function startBad(name, { target, volume, image, rate }) {
  const worker = new Worker(new URL('./bad_thread.mjs', import.meta.url), {
    workerData: { name, base: target.base.href, token: target.token, address: target.address, volume, image, rate },
  });
  let says = { counts: {}, trouble: '' };
  worker.on('message', (message) => (says = message));
  worker.on('error', (error) => (says = { ...says, trouble: error.message }));
  const ended = new Promise((resolve) => worker.on('exit', resolve));
  let stopping;
  const stop = async () => {
    worker.postMessage('stop');
    const late = setTimeout(() => worker.terminate(), END_MS);
    await ended;
    clearTimeout(late);
    return says;
  };
  return { stop: () => (stopping ??= stop()) };
}
