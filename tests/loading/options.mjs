// The command line of tests/load.
import { parseArgs } from 'node:util';

import { BAD } from './bad.mjs';
import { readMix, REST_MIX } from './rest.mjs';
import { Trouble } from './target.mjs';

export const HELP = `Usage: tests/load [OPTION]...
Clients that behave as the page does, a mix of REST calls and bad clients; measures what each gets.

What is loaded
  --url URL             a running daemon; without it one is started here
  --token TOKEN         bearer token for it
  --pid PID             its process, for CPU and memory, where it runs on this machine
  --binary FILE         the program to start (default: what is built here)
  --backend NAME        auto, cpu or gl, of the one that is started
  --volume NAME         id of one of its volumes; of the one that is started, what to load (default demo:head)

How
  --clients N[,N...]    so many, one step of the ramp after the other (default 4)
  --seconds S           of each step (default 10, at most 3600). Four gestures are a round (10 s as --drag and --think
                        have it): steps of whole rounds compare, for tables are built in one gesture of the four
  --image WxH           picture size (default 512x512)
  --rate R              patches a second while a hand moves (default 60)
  --drag MS, --think MS a gesture and the rest after it (default 2000 and 500)
  --path FILE           a recorded path instead of made-up ones: [{"t": ms, "patch": {...} or null}]
  --record FILE         write what the first client sends, as such a path
  --rest R              REST calls a second beside them (default 0)
  --mix NAME=W,...      their weights (default ${REST_MIX})
  --bad NAME[,NAME...]  four clients beside each of these, or all; --help-bad names them.
                        Measured against the four alone and the four beside one more ordinary client.
  --apart               each client comes from an address of its own, as X-Forwarded-For says it, which one of
                        our own believes; else all are one peer, whose clients share equally
  --repeat N            the ordinary comparison anew before every Nth bad client (default 4)
  --rounds N            all of it N times; a row is made of all its runs (default 3)
  --capacity            1, 4, 16 and 64 clients on demo:head, the table in README.md made anew

What comes out
  --output DIR          load.json and load.html there
  --help, --help-bad

Ctrl-C ends it; what was measured is written.`;

export const HELP_BAD = Object.entries(BAD).map(([name, { says }]) => `  ${name.padEnd(20)} ${says}`).join('\n');

const text = { type: 'string' };
const flag = { type: 'boolean' };
const SHAPE = {
  url: text, token: text, pid: text, binary: text, backend: text, volume: text, clients: text, seconds: text, image: text,
  rate: text, drag: text, think: text, path: text, record: text, rest: text, mix: text, bad: text, repeat: text, rounds: text, output: text,
  apart: flag, capacity: flag, help: flag, 'help-bad': flag,
};
const MOST_CLIENTS = 1024;
const MOST_SECONDS = 3600;

/** @throws {Trouble} naming the option */
export function readOptions(args) {
  let values;
  try {
    ({ values } = parseArgs({ args, options: SHAPE, allowPositionals: false }));
  } catch (error) {
    throw new Trouble(`${error.message.split('. ')[0].split('\n')[0]}; tests/load --help lists the options`);
  }
  const number = (name, fallback, least, most) => {
    const value = values[name] === undefined ? fallback : Number(values[name]);
    if (!(value >= least && value <= most)) throw new Trouble(`--${name} ${values[name]}: give a number from ${least} to ${most}`);
    return value;
  };
  const size = /^(\d{1,4})x(\d{1,4})$/.exec(values.image ?? '512x512');
  if (!size) throw new Trouble(`--image ${values.image}: give WIDTHxHEIGHT, as in 512x512`);
  const options = {
    help: values.help, helpBad: values['help-bad'], url: readUrl(values.url), token: values.token ?? '', pid: number('pid', 0, 0, 2 ** 22),
    binary: values.binary, backend: values.backend ?? 'auto', volume: values.volume, clients: readClients(values.clients ?? '4'),
    seconds: number('seconds', 10, 0.5, MOST_SECONDS), image: { width: Number(size[1]), height: Number(size[2]) },
    rate: number('rate', 60, 0.1, 240), dragMs: number('drag', 2000, 1, 1e6), thinkMs: number('think', 500, 0, 1e6),
    path: values.path, record: values.record, bad: readBad(values.bad), repeat: number('repeat', 4, 1, 100), rounds: Math.round(number('rounds', 3, 1, 100)),
    rest: values.rest ? { perSecond: number('rest', 0, 0.1, 500), mix: readMix(values.mix ?? REST_MIX) } : null,
    apart: values.apart ?? false, capacity: values.capacity ?? false, output: values.output,
  };
  if (options.url && (options.binary || options.capacity))
    throw new Trouble('--url and a daemon of our own exclude each other: leave --url out for --binary and --capacity');
  if (options.capacity) Object.assign(options, { clients: [1, 4, 16, 64], volume: 'demo:head', bad: [], rest: null, path: undefined });
  return options;
}

function readUrl(given) {
  if (!given) return undefined;
  let url = null;
  try { url = new URL(given); } catch { /* said below */ }
  if (!url || !/^https?:$/.test(url.protocol)) throw new Trouble(`--url ${given}: give http://HOST:PORT`);
  return url;
}

function readClients(list) {
  const found = list.split(',').map(Number);
  for (const n of found)
    if (!Number.isInteger(n) || n < 1 || n > MOST_CLIENTS) throw new Trouble(`--clients ${list}: give whole numbers from 1 to ${MOST_CLIENTS}, as in 1,4,16`);
  return found;
}

function readBad(list) {
  if (!list) return [];
  const all = Object.keys(BAD).filter((name) => name !== 'ordinary');
  const found = list === 'all' ? all : list.split(',');
  for (const name of found) if (!BAD[name]) throw new Trouble(`--bad ${name}: no such client; there are all, ${all.join(', ')}`);
  return found;
}
