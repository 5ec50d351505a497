// The bindings of keys, drags, wheel and fingers in one table. keys.js and input.js look actions up in it; the help
// dialog shows and edits it. Changes are stored in this browser.
//
// A chord is readable text: "A", "Shift+F", "Ctrl+Z", "ArrowLeft", "Left drag", "Ctrl+Wheel".

const STORED = 'tomocast.bindings';
const EVERY = ['volume', 'projection', 'slices'];
const SOLID = ['volume', 'projection'];
const GREY = ['projection', 'slices'];
const SLICES = ['slices'];

/** The context of the table that a mode uses. */
export function contextOf(mode) {
  if (mode === 'mpr') return 'slices';
  return ['mip', 'minip', 'average'].includes(mode) ? 'projection' : 'volume';
}

const row = (id, title, chords, options = {}) => ({ id, title, chords, does: id, in: EVERY, ...options });

const turn = (name, x, y, key) => [
  row(`turn-${name}`, `Turn ${name} 5\u00b0`, [key], { does: 'turn', with: [5 * x, 5 * y], in: SOLID }),
  row(`nudge-${name}`, `Turn ${name} 1\u00b0`, [`Shift+${key}`], { does: 'turn', with: [x, y], in: SOLID }),
];

const tilt = (name, x, y, key) =>
  row(`tilt-${name}`, `Turn the plane ${name} 5\u00b0`, [`Shift+${key}`], { does: 'turn', with: [5 * x, 5 * y], in: SLICES });

const view = (letter, name) => row(`view-${letter}`, `${name} view`, [letter], { does: 'view', with: letter });

/** id: key of the stored bindings. does, with: the action and its argument. in: contexts; fixed: cannot be changed. */
export const TABLE = [
  {
    group: 'Pointer on the 3-D picture',
    rows: [
      row('orbit', 'Turn', ['Left drag', 'One finger'], { in: SOLID }),
      row('roll', 'Roll', ['Alt+Left drag', 'Twist'], { in: SOLID }),
      row('roll-volume', 'Roll, except in projections', ['Ctrl+Left drag'], { does: 'roll', in: ['volume'] }),
      row('window', 'Window centre and width, in projections', ['Ctrl+Left drag'], { in: GREY }),
      row('wheel-zoom', 'Zoom', ['Wheel'], { does: 'zoom', in: SOLID }),
    ],
  },
  {
    group: 'Pointer on slices',
    rows: [
      row('window-slices', 'Window centre and width', ['Left drag'], { does: 'window', in: SLICES }),
      row('tilt', 'Turn the plane', ['Alt+Left drag', 'Drag the cube'], { does: 'orbit', in: SLICES }),
      row('scroll', 'Next slice', ['Wheel', 'One finger', 'Three fingers'], { in: SLICES }),
    ],
  },
  {
    group: 'Pointer on any picture',
    rows: [
      row('pan', 'Move', ['Middle drag', 'Shift+Left drag', 'Two fingers']),
      row('zoom', 'Zoom', ['Right drag', 'Ctrl+Wheel', 'Pinch']),
      row('centre', 'Centre what lies there', ['Double click'], { fixed: true }),
      row('probe', 'Position and value', ['Click'], { fixed: true }),
    ],
  },
  {
    group: 'Views',
    rows: [
      view('A', 'Anterior'),
      view('P', 'Posterior'),
      view('L', 'Left'),
      view('R', 'Right'),
      view('H', 'Head'),
      view('F', 'Feet'),
      row('reset', 'Reset the view', ['Space']),
      row('larger', 'Larger', ['+', '='], { does: 'magnify', with: 1.15 }),
      row('smaller', 'Smaller', ['-', '_'], { does: 'magnify', with: 1 / 1.15 }),
      row('fullscreen', 'Full screen', ['Shift+F']),
      row('cine', 'Turn or run through the slices by itself', ['C']),
      row('play', 'Play the volumes of a file', ['T']),
      row('next-volume', 'Next volume of a file', ['.'], { does: 'volume', with: 1 }),
      row('previous-volume', 'Previous volume of a file', [','], { does: 'volume', with: -1 }),
    ],
  },
  {
    group: 'Turning',
    rows: [
      ...turn('left', -1, 0, 'ArrowLeft'),
      ...turn('right', 1, 0, 'ArrowRight'),
      ...turn('up', 0, -1, 'ArrowUp'),
      ...turn('down', 0, 1, 'ArrowDown'),
    ],
  },
  {
    group: 'Slices',
    rows: [
      row('next', 'Next slice', ['ArrowDown', 'ArrowRight'], { does: 'slices', with: 1, in: SLICES }),
      row('previous', 'Previous slice', ['ArrowUp', 'ArrowLeft'], { does: 'slices', with: -1, in: SLICES }),
      row('next-ten', 'Ten slices on', ['PageDown'], { does: 'slices', with: 10, in: SLICES }),
      row('previous-ten', 'Ten slices back', ['PageUp'], { does: 'slices', with: -10, in: SLICES }),
      row('first', 'First slice', ['Home'], { does: 'slices', with: -Infinity, in: SLICES }),
      row('last', 'Last slice', ['End'], { does: 'slices', with: Infinity, in: SLICES }),
      tilt('left', -1, 0, 'ArrowLeft'),
      tilt('right', 1, 0, 'ArrowRight'),
      tilt('up', 0, -1, 'ArrowUp'),
      tilt('down', 0, 1, 'ArrowDown'),
      row('invert', 'Black for white, in projections too', ['I'], { in: GREY }),
    ],
  },
  {
    group: 'Look',
    rows: [
      ...[1, 2, 3, 4, 5, 6, 7, 8, 9].map((n) =>
        row(`preset-${n}`, `Preset ${n}`, [String(n)], { does: 'preset', with: n - 1 }),
      ),
      row('undo', 'Undo', ['Ctrl+Z']),
      row('redo', 'Redo', ['Ctrl+Shift+Z', 'Ctrl+Y']),
      row('help', 'This page', ['?']),
    ],
  },
  {
    group: 'Transfer function',
    rows: [
      row('knot-move', 'Value and opacity of a knot', ['Drag', 'Arrow keys'], { fixed: true, in: [] }),
      row('knot-add', 'Add a knot', ['Double click', 'Enter'], { fixed: true, in: [] }),
      row('knot-remove', 'Remove a knot', ['Right click', 'Drag out', 'Delete'], { fixed: true, in: [] }),
      row('knot-next', 'Next knot', ['PageUp', 'PageDown'], { fixed: true, in: [] }),
      row('axis', 'Zoom and move the value axis', ['Wheel', 'Drag the plot', 'Two fingers'], { fixed: true, in: [] }),
    ],
  },
];

const ROWS = TABLE.flatMap(({ rows }) => rows);
const TOUCH = /finger|Pinch|Twist/;

/** Touch chords cannot be changed. */
export const isFixed = (entry, chord) => Boolean(entry.fixed) || TOUCH.test(chord);

/** "keys" or "pointer": the kind of chords a row can have. */
export const kindOf = (entry) => (/drag|Wheel|finger|click/i.test(entry.chords[0]) ? 'pointer' : 'keys');

const modifiers = ({ ctrlKey, metaKey, altKey }) => `${ctrlKey || metaKey ? 'Ctrl+' : ''}${altKey ? 'Alt+' : ''}`;

/**
 * The chord of a keydown, "" for a modifier alone. Shift counts with letters and named keys; with others it selects the
 * character.
 */
export function keyChord(event) {
  const { key } = event;
  if (['Shift', 'Control', 'Alt', 'AltGraph', 'Meta', 'Dead', 'Unidentified'].includes(key)) return '';
  const name = key === ' ' ? 'Space' : key.length === 1 ? key.toUpperCase() : key;
  const shift = event.shiftKey && (key.length > 1 || /\p{L}/u.test(key)) ? 'Shift+' : '';
  return modifiers(event) + shift + name;
}

/** The chord of a pointerdown. */
export function dragChord(event) {
  if (event.pointerType === 'touch') return 'One finger';
  const button = ['Left', 'Middle', 'Right'][event.button] ?? 'Left';
  return `${modifiers(event)}${event.shiftKey ? 'Shift+' : ''}${button} drag`;
}

export const wheelChord = (event) => `${modifiers(event)}Wheel`;

export class Bindings {
  #storage;
  #own = {}; // id -> chords, where they differ from the table

  constructor(storage = globalThis.localStorage) {
    this.#storage = storage;
    this.#own = stored(storage);
  }

  chords({ id, chords }) {
    return this.#own[id] ?? chords;
  }

  /** @returns the row of a chord in a mode, or null; unknown modifiers of a drag are ignored */
  find(chord, mode) {
    const context = contextOf(mode);
    const exact = (text) =>
      ROWS.find((entry) => entry.in.includes(context) && this.chords(entry).includes(text));
    return exact(chord) ?? (/drag|Wheel/.test(chord) ? exact(chord.split('+').at(-1)) : null) ?? null;
  }

  /** Replaces the chord `old` by `chord`; "" removes it. */
  rebind(entry, old, chord) {
    const next = this.chords(entry).flatMap((text) => (text === old ? [] : [text]));
    if (chord && !next.includes(chord)) next.push(chord);
    this.#own = { ...this.#own, [entry.id]: next };
    this.#storage?.setItem(STORED, JSON.stringify(this.#own));
  }

  reset() {
    this.#own = {};
    this.#storage?.removeItem(STORED);
  }

  get changed() {
    return Object.keys(this.#own).length > 0;
  }

  /** Titles of the other rows with the same chord in a common context. */
  conflicts(entry, chord) {
    const rival = (other) => other !== entry && other.in.some((context) => entry.in.includes(context));
    return ROWS.filter((other) => rival(other) && this.chords(other).includes(chord)).map(({ title }) => title);
  }
}

// Reads the storage defensively, since other pages may have written it: known rows with texts only.
function stored(storage) {
  try {
    const found = Object.entries(JSON.parse(storage?.getItem(STORED) ?? '{}'));
    const known = ([id, chords]) =>
      ROWS.some((entry) => entry.id === id) && Array.isArray(chords) && chords.every((text) => typeof text === 'string');
    return Object.fromEntries(found.filter(known));
  } catch {
    return {};
  }
}
