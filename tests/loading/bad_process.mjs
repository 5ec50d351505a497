// The process of one bad client: waits to be told which, runs it until told to stop, says ever again what it counted.
import { once } from 'node:events';

import { BAD } from './bad.mjs';
import { Target } from './target.mjs';

const TELL_MS = 250;
const counts = {};
const stopped = new AbortController();
let trouble = '';
let before = process.cpuUsage();
const tell = () => new Promise((resolve) => {
  const { user, system } = process.cpuUsage(before);
  process.send({ counts, cpuMs: (user + system) / 1000, trouble }, resolve);
});

process.on('SIGINT', () => {}); // Ctrl-C is for whoever started us
process.on('disconnect', () => process.exit());
tell();
const [first] = await once(process, 'message');
if (first === 'stop') process.exit();
before = process.cpuUsage();
process.once('message', () => stopped.abort());
const { name, base, token, address, ...setting } = first;
const bad = {
  ...setting, target: new Target(base, token).from(address), stopped: stopped.signal,
  count: (kind) => (counts[kind] = (counts[kind] ?? 0) + 1),
};
const timer = setInterval(tell, TELL_MS);
await BAD[name].run(bad).catch((error) => (trouble = error.message));
clearInterval(timer);
if (!stopped.signal.aborted) await once(stopped.signal, 'abort');
await tell();
process.exit();
