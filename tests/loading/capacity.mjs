// The table in README.md of what so many clients get, put between its two marks.
import { readFileSync, writeFileSync } from 'node:fs';

import { busy } from './page.mjs';
import { rampTable } from './tables.mjs';
import { Trouble } from './target.mjs';

const MARKS = ['<!-- capacity: written by tests/load --capacity -->', '<!-- /capacity -->'];

/** `text` with what lies between the marks replaced. @throws {Trouble} where they are not there */
export function withCapacity(text, { runs, machine, about, began }) {
  const [from, to] = MARKS.map((mark) => text.indexOf(mark));
  if (from < 0 || to < from) throw new Trouble(`README.md: the marks ${MARKS.join(' and ')} are not there: put them back around the table`);
  const { seconds, setting: { image, rate } } = runs[0];
  const how = `${machine.cpu}, ${machine.cores} cores, ${about.backend} back end, which the load tool shares; ${began.slice(0, 10)}, ` +
    `${Math.round(seconds)} s a row, ${image.width}x${image.height}, ${rate} patches a second from each hand` +
    `${busy(runs) && `; ${busy(runs)}, so a quiet machine gives more`}.`;
  return `${text.slice(0, from + MARKS[0].length)}\n${rampTable(runs)}\n\n${how}\n${text.slice(to)}`;
}

/** Writes the table into the README. Nothing is written of a run that was cut short. */
export function writeCapacity(file, report) {
  writeFileSync(file, withCapacity(readFileSync(file, 'utf8'), report));
}
