// The table of bindings in the help dialog; every chord is a button that records a new one.

import { dragChord, isFixed, keyChord, kindOf, TABLE, wheelChord } from './bindings.js';

const NAMES = { ArrowLeft: '\u2190', ArrowRight: '\u2192', ArrowUp: '\u2191', ArrowDown: '\u2193', '-': '\u2212' };
const HINTS = {
  keys: 'Press a key; Delete for none, Escape to leave it',
  pointer: 'Drag or turn the wheel here; Delete for none, Escape to leave it',
};

const element = (name, properties, ...children) => {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
};

/** "Shift + \u2190" */
export const chordText = (chord) =>
  chord
    .split(/\+(?=.)/)
    .map((part) => NAMES[part] ?? part.replace(/([a-z])([A-Z])/, '$1 $2'))
    .join(' + ');

export class BindingsPanel {
  #host;
  #reset;
  #bindings;
  #taking = null; // {entry, chord} being recorded

  constructor(host, reset, bindings) {
    this.#host = host;
    this.#reset = reset;
    this.#bindings = bindings;
    reset.addEventListener('click', () => {
      bindings.reset();
      this.#show();
    });
    host.closest('dialog').addEventListener('close', () => this.#take(null));
    host.addEventListener('keydown', (event) => this.#key(event));
    host.addEventListener('pointerdown', (event) => this.#pointer(event, dragChord(event)));
    host.addEventListener('wheel', (event) => this.#pointer(event, wheelChord(event)), { passive: false });
    host.addEventListener('contextmenu', (event) => this.#taking && event.preventDefault());
    this.#show();
  }

  #show() {
    this.#host.replaceChildren(...TABLE.map(({ group, rows }) => this.#table(group, rows)));
    this.#reset.disabled = !this.#bindings.changed;
  }

  #table(group, rows) {
    return element('table', {}, element('caption', { textContent: group }), ...rows.map((entry) => this.#row(entry)));
  }

  #row(entry) {
    const chords = this.#bindings.chords(entry);
    const shown = chords.map((chord) => this.#chord(entry, chord));
    if (!chords.some((chord) => !isFixed(entry, chord)) && !entry.fixed) shown.push(this.#chord(entry, ''));
    const clash = chords.flatMap((chord) => this.#bindings.conflicts(entry, chord));
    const cell = element('td', {}, ...shown);
    if (clash.length) cell.append(element('span', { className: 'problem', textContent: ` also: ${clash.join(', ')}` }));
    const row = element('tr', {}, element('th', { scope: 'row', textContent: entry.title }), cell);
    row.dataset.action = entry.id;
    return row;
  }

  #chord(entry, chord) {
    if (chord && isFixed(entry, chord)) return element('kbd', { textContent: chordText(chord) });
    const text = chord ? chordText(chord) : 'none';
    const button = element('button', { className: 'chord', textContent: text });
    button.setAttribute('aria-label', `${entry.title}: ${text}. Change`);
    button.addEventListener('click', () => !this.#taking && this.#take({ entry, chord, button }));
    return button;
  }

  #take(taking) {
    const before = this.#taking;
    this.#taking = taking;
    if (before) this.#show();
    if (!taking) return;
    taking.button.textContent = HINTS[kindOf(taking.entry)];
    taking.button.classList.add('taking');
  }

  #key(event) {
    if (!this.#taking) return;
    const chord = keyChord(event);
    if (!chord || event.key === 'Tab') return;
    event.preventDefault();
    event.stopPropagation();
    if (event.key === 'Escape') this.#leave();
    else if (event.key === 'Delete') this.#bind('');
    else if (kindOf(this.#taking.entry) === 'keys') this.#bind(chord);
  }

  #pointer(event, chord) {
    if (!this.#taking) return;
    if (kindOf(this.#taking.entry) !== 'pointer') {
      if (event.target !== this.#taking.button) this.#leave();
      return;
    }
    event.preventDefault();
    if (event.target.closest('button') === this.#taking.button && event.pointerType !== 'touch') this.#bind(chord);
    else this.#leave();
  }

  #bind(chord) {
    const { entry, chord: old } = this.#taking;
    this.#bindings.rebind(entry, old, chord);
    this.#leave();
  }

  // The table is rebuilt; keeps the focus in the row.
  #leave() {
    const { id } = this.#taking.entry;
    this.#take(null);
    setTimeout(() => this.#host.querySelector(`[data-action="${id}"] button`)?.focus()); // after the pointer event
  }
}
