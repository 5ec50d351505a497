// Undo and redo of every edit of the scene. One step is one gesture, or one edit without any; it holds two merge patches,
// there and back, so that what others changed meanwhile stays.

import { mergePatch } from './state.js';

const MOST_STEPS = 200;
const ONE_EDIT_MS = 800; // the same member again within this time goes on with the step: a slider moved by keys, a colour

const isObject = (value) => value !== null && typeof value === 'object' && !Array.isArray(value);
const same = (a, b) => a === b || JSON.stringify(a ?? null) === JSON.stringify(b ?? null);
const compare = (a, b) => (a < b ? -1 : 1);

/** The merge patch that makes `to` of `from`; {} where they are the same. */
export function difference(from, to) {
  const patch = {};
  for (const name of new Set([...Object.keys(from), ...Object.keys(to)])) {
    const [a, b] = [from[name], to[name]];
    if (same(a, b)) continue;
    // Points without a preset take its name and unit away, so that a transfer function travels whole.
    if (name === 'transferFunction') patch[name] = { ...b, preset: b?.preset ?? null };
    else if (isObject(a) || isObject(b)) patch[name] = difference(a ?? {}, b ?? {});
    else patch[name] = b ?? null;
  }
  return patch;
}

/** Names of the members a patch sets. */
const members = (patch, path = '') =>
  Object.entries(patch).flatMap(([name, value]) =>
    isObject(value) && name !== 'transferFunction' ? members(value, `${path}${name}.`) : `${path}${name}`,
  );

export class History {
  #store;
  #on;
  #scene; // before the next edit
  #before = null; // the gesture that is under way
  #held = 0;
  #past = []; // {before, after, back, forth, what, at}
  #future = [];

  /** on: changed() when there is more or less to undo or redo */
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

  /** One more step, of an edit that went another way. */
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

  // what: the members that an edit without a gesture set, "" of a gesture.
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

  // A step that would change nothing, for it was refused or others did the same, is passed over.
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
