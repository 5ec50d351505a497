// Undo and redo of all edits of the scene. A step is one gesture, or one edit outside a gesture. It stores two merge
// patches, forward and back, so that concurrent changes by others are kept.

import { mergePatch } from './state.js';

const MOST_STEPS = 200;
const ONE_EDIT_MS = 800; // edits of the same member within this time extend the step: a slider moved by keys, a colour

const isObject = (value) => value !== null && typeof value === 'object' && !Array.isArray(value);
const same = (a, b) => a === b || JSON.stringify(a ?? null) === JSON.stringify(b ?? null);
const compare = (a, b) => (a < b ? -1 : 1);

/** The merge patch from `from` to `to`; {} if equal. */
export function difference(from, to) {
  const patch = {};
  for (const name of new Set([...Object.keys(from), ...Object.keys(to)])) {
    const [a, b] = [from[name], to[name]];
    if (same(a, b)) continue;
    // Sets preset to null with the points if there is none, so that a transfer function is replaced as a whole.
    if (name === 'transferFunction') patch[name] = { ...b, preset: b?.preset ?? null };
    else if (isObject(a) || isObject(b)) patch[name] = difference(a ?? {}, b ?? {});
    else patch[name] = b ?? null;
  }
  return patch;
}

/** Names of the members that a patch sets; a list with its length, since each item added or removed is an edit of its own. */
const members = (patch, path = '') =>
  Object.entries(patch).flatMap(([name, value]) => {
    if (isObject(value) && name !== 'transferFunction') return members(value, `${path}${name}.`);
    return Array.isArray(value) ? `${path}${name}[${value.length}]` : `${path}${name}`;
  });

export class History {
  #store;
  #on;
  #scene; // before the next edit
  #before = null; // scene before the current gesture
  #held = 0;
  #past = []; // {before, after, back, forth, what, at}
  #future = [];

  /** on: changed() when undo or redo become available or unavailable */
  constructor(store, on = {}) {
    this.#store = store;
    this.#on = on;
    this.#scene = store.scene;
    store.subscribe((scene, how) => this.#follow(scene, how));
  }

  /** Everything between hold(true) and hold(false) is one step. Calls nest. */
  hold(on) {
    this.#held = Math.max(0, this.#held + (on ? 1 : -1));
    if (this.#held || !this.#before) return;
    this.#push(this.#before, this.#store.scene, '');
    this.#before = null;
  }

  /** Adds a step for an edit that did not go through the store. */
  add(before, after) {
    this.#push(before, after, '');
  }

  undo() {
    this.#step(this.#past, this.#future, 'back');
  }

  redo() {
    this.#step(this.#future, this.#past, 'forth');
  }

  get canUndo() {
    return this.#past.length > 0;
  }

  get canRedo() {
    return this.#future.length > 0;
  }

  clear() {
    this.#past.length = this.#future.length = 0;
    this.#before = null;
    this.#on.changed?.();
  }

  #follow(scene, how) {
    const before = this.#scene;
    this.#scene = scene;
    if (how !== 'edit' || !before) return;
    if (this.#held) this.#before ??= before;
    else this.#push(before, scene, members(difference(before, scene)).sort(compare).join());
  }

  // what: the members set by an edit outside a gesture, "" for a gesture.
  #push(before, after, what) {
    const last = this.#past.at(-1);
    const at = performance.now();
    if (what && last?.what === what && at - last.at < ONE_EDIT_MS) {
      this.#past.pop();
      before = last.before;
    }
    const [back, forth] = [difference(after, before), difference(before, after)];
    if (!Object.keys(forth).length) return;
    this.#past.push({ before, back, forth, what, at });
    if (this.#past.length > MOST_STEPS) this.#past.shift();
    this.#future.length = 0;
    this.#on.changed?.();
  }

  // Skips steps without effect, since their edit was refused or others made the same change.
  #step(from, to, way) {
    while (from.length) {
      const step = from.pop();
      to.push(step);
      if (same(mergePatch(this.#store.scene, step[way]), this.#store.scene)) continue;
      this.#store.patch(step[way], 'history');
      break;
    }
    this.#on.changed?.();
  }
}
