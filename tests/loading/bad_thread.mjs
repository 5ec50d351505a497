// The thread of one bad client: runs it until told to stop, says ever again what it counted.
import os from 'node:os';
import { parentPort, workerData } from 'node:worker_threads';

import { BAD } from './bad.mjs';
import { Target } from './target.mjs';

const TELL_MS = 250;
// A stranger brings a machine of its own: here its own work must not take the processor from the daemon, whose drawing
// runs at a lower priority than usual. On Linux this is the priority of the calling thread alone.
os.setPriority(os.constants.priority.PRIORITY_LOW);
const { name, base, token, address, ...setting } = workerData;
const counts = {};
const stopped = new AbortController();
const bad = {
  ...setting, target: new Target(base, token).from(address), stopped: stopped.signal,
  count: (kind) => (counts[kind] = (counts[kind] ?? 0) + 1),
};
const tell = (trouble = '') => parentPort.postMessage({ counts, trouble });
const timer = setInterval(tell, TELL_MS);

parentPort.once('message', () => stopped.abort());
try {
  await BAD[name].run(bad);
  tell();
} catch (error) {
  tell(error.message);
}
clearInterval(timer);
if (!stopped.signal.aborted) await new Promise((resolve) => stopped.signal.addEventListener('abort', resolve));
process.exit(0);
