// tests/load: reads the options, runs the campaign, says how it goes, writes what came of it.
import { mkdirSync, writeFileSync } from 'node:fs';
import { cpus, totalmem } from 'node:os';
import { join } from 'node:path';

import { campaign } from './campaign.mjs';
import { writeCapacity } from './capacity.mjs';
import { TOP } from './daemon.mjs';
import { HELP, HELP_BAD, readOptions } from './options.mjs';
import { page } from './page.mjs';
import { badTable, rampTable, runLine } from './tables.mjs';
import { Trouble } from './target.mjs';

const stopped = new AbortController();

async function main(args) {
  const options = readOptions(args);
  if (options.help || options.helpBad) return console.log(options.help ? HELP : HELP_BAD);
  process.on('SIGINT', () => interrupted());
  process.on('SIGTERM', () => interrupted());
  const began = new Date();
  const found = await campaign(options, { stopped: stopped.signal, onStart: progress.start, onTick: progress.tick, onRun: progress.done, onDeath: mourn });
  const taken = found.runs[0]?.record;
  for (const run of found.runs) {
    delete run.record;
    delete run.waits;
  }
  const machine = { cpu: cpus()[0]?.model.trim(), cores: cpus().length, memoryGiB: Math.round(totalmem() / 2 ** 30) };
  const report = { tool: 'tests/load', began: began.toISOString(), complete: !stopped.signal.aborted && !process.exitCode, machine, ...found };
  console.log(`\n${found.table.length ? badTable(found.table) : rampTable(found.runs)}`);
  if (options.record) writeFileSync(options.record, JSON.stringify(taken ?? []));
  if (options.output) write(options.output, report);
  if (options.capacity && report.complete) writeCapacity(join(TOP, 'README.md'), report);
  if (stopped.signal.aborted) process.exitCode = 130;
}

function mourn(code, lastWords) {
  console.error(`tests/load: the daemon died (${code}); the end of its log:\n${lastWords.join('\n')}`);
  process.exitCode = 1;
}

function interrupted() {
  if (stopped.signal.aborted) process.exit(130); // twice: at once
  stopped.abort();
}

function write(folder, report) {
  mkdirSync(folder, { recursive: true });
  writeFileSync(join(folder, 'load.json'), JSON.stringify(report, null, 1));
  writeFileSync(join(folder, 'load.html'), page(report));
  console.log(`\nwritten: ${join(folder, 'load.json')} and load.html`);
}

/** One line that is written over while a measurement runs, and one that stays. */
const progress = {
  name: '',
  start: ({ name, bad, clients }) => (progress.name = name ?? bad ?? `${clients} clients`),
  tick: (clients, ms) => {
    if (!process.stderr.isTTY) return;
    const frames = clients.reduce((sum, client) => sum + client.frames.length, 0);
    process.stderr.write(`\r\x1b[K${progress.name}: ${(ms / 1000).toFixed(1)} s, ${frames} frames`);
  },
  done: (run) => {
    if (process.stderr.isTTY) process.stderr.write('\r\x1b[K');
    console.log(runLine(run));
  },
};

main(process.argv.slice(2)).catch((error) => {
  console.error(error instanceof Trouble ? `tests/load: ${error.message}` : error);
  process.exit(process.exitCode || (error instanceof Trouble ? 2 : 1));
});
