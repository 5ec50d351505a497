// The keyboard: which key does what on the page. Fields, dialogs and the transfer function keep their own keys.

import { STANDARD_VIEWS } from './camera.js';
import { steerByKey } from './steer.js';

const REST_MS = 150; // keys have ended after this much rest
const SLICES = { ArrowUp: -1, ArrowDown: 1, PageUp: -10, PageDown: 10 };
const ZOOMS = { '+': 1.15, '=': 1.15, '-': 1 / 1.15, _: 1 / 1.15 };

export class Keys {
  #store;
  #on;
  #timer = 0;

  /** on: gesture(bool), view(letter), reset(), preset(n), help(), undo(), redo(), slice({slices, factor}) */
  constructor(store, on) {
    this.#store = store;
    this.#on = on;
    addEventListener('keydown', (event) => this.#key(event));
  }

  #key(event) {
    if (document.querySelector('dialog[open]')) return;
    let ours = false;
    if (event.ctrlKey || event.metaKey) ours = !event.altKey && this.#undo(event);
    else if (!event.altKey && !event.target.matches('input, select, textarea, [role="tab"]')) ours = this.#plain(event);
    if (ours) event.preventDefault();
  }

  #undo({ key, shiftKey, target }) {
    const letter = key.toLowerCase();
    if (target.matches('textarea, input[type="number"]') || (letter !== 'z' && letter !== 'y')) return false;
    if (letter === 'y' || shiftKey) this.#on.redo();
    else this.#on.undo();
    return true;
  }

  #plain({ key, shiftKey, target }) {
    if (key === '?') this.#on.help();
    else if (!this.#store.scene) return false;
    else if (key === ' ' && !target.matches('button, [role="button"]')) this.#on.reset();
    else if (/^[1-9]$/.test(key)) this.#on.preset(Number(key) - 1);
    else if (Object.hasOwn(STANDARD_VIEWS, key.toUpperCase())) this.#on.view(key.toUpperCase());
    else if (this.#store.scene.mode === 'mpr') return this.#slice(key);
    else return this.#turn(key, shiftKey);
    return true;
  }

  #turn(key, shiftKey) {
    const camera = steerByKey(this.#store.scene.camera, key, shiftKey);
    if (!camera) return false;
    this.#gesture();
    this.#store.patch({ camera });
    return true;
  }

  #slice(key) {
    const moved = { slices: SLICES[key] ?? 0, factor: ZOOMS[key] ?? 1 };
    if (!moved.slices && moved.factor === 1) return false;
    this.#gesture();
    this.#on.slice(moved);
    return true;
  }

  // Keys come in bursts: the daemon may be coarse until they rest.
  #gesture() {
    if (!this.#timer) this.#on.gesture(true);
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => {
      this.#timer = 0;
      this.#on.gesture(false);
    }, REST_MS);
  }
}
