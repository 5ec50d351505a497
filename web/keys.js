// The keyboard: finds the binding of a key and runs its action. Fields, dialogs and the transfer function editor handle
// their own keys.

import { keyChord } from './bindings.js';

const REST_MS = 150; // a burst of keys ends after this long
const HELD = ['turn', 'magnify', 'slices']; // repeated in bursts: the daemon may lower the quality until they end
const ALWAYS = ['help', 'fullscreen']; // also without a volume

export class Keys {
  #bindings;
  #on;
  #timer = 0;

  /** on: mode(), undefined without a scene; gesture(bool); do(action, argument) */
  constructor(bindings, on) {
    this.#bindings = bindings;
    this.#on = on;
    addEventListener('keydown', (event) => this.#key(event));
  }

  #key(event) {
    if (event.defaultPrevented || document.querySelector('dialog[open]')) return;
    const chord = keyChord(event);
    const mode = this.#on.mode();
    const { does, with: argument } = this.#bindings.find(chord, mode) ?? {};
    if (!does || kept(event.target, chord) || (!mode && !ALWAYS.includes(does))) return;
    if (HELD.includes(does)) this.#gesture();
    this.#on.do(does, argument);
    event.preventDefault();
  }

  #gesture() {
    if (!this.#timer) this.#on.gesture(true);
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => {
      this.#timer = 0;
      this.#on.gesture(false);
    }, REST_MS);
  }
}

/** Whether the focused element handles the chord itself. */
function kept(target, chord) {
  if (/^(Ctrl|Alt)\+/.test(chord)) return target.matches('textarea, input[type="number"], input[type="search"]');
  if (chord === 'Space' && target.matches('button, [role="button"]')) return true;
  if (target.matches('select, [type="range"], [type="checkbox"]')) return !/^(Shift\+)?[A-Z?]$/.test(chord); // a letter is a view's
  return target.matches('input, textarea, [role="tab"]');
}
