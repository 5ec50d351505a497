// The look of a volume: transfer function editor and its fields, presets, windows. Edits scene.transferFunction and
// scene.window.

import { presetPatch } from './display.js';
import { bindGesture } from './panels.js';
import { TransferEditor } from './transfer_editor.js';
import { amountName, amountOf, formatValue, fromHex, scaleAmounts, shiftKnots, toHex } from './transfer_model.js';

/** The daemon's presets that suit a modality, best first. */
export function presetsFor(presets, modality) {
  const own = presets.filter((preset) => preset.modality && preset.modality === modality);
  const any = presets.filter((preset) => !preset.modality);
  const other = presets.filter((preset) => preset.modality && preset.modality !== modality);
  return modality ? { first: [...own, ...any], other } : { first: presets, other: [] };
}

export class Look {
  #get;
  #store;
  #gesture;
  #editor;
  #presets = [];
  #windows = [];
  #whole = [0, 1];
  #base = null; // points when the drag began
  #modality = '';
  #display = null;
  #ownWindow = null;

  /** get(id); gesture(bool) */
  constructor(get, store, gesture) {
    this.#get = get;
    this.#store = store;
    this.#gesture = gesture;
    this.#editor = new TransferEditor(get('editor'), {
      change: (points) => this.#edit(points),
      gesture: (on) => this.#held(on),
      select: () => this.#fields(),
      range: (range) => this.#axisFields(range),
    });
    this.#bindFields();
    this.#bindSliders();
    store.subscribe(() => this.update());
  }

  setPresets({ transferFunctions = [], windows = [] }) {
    this.#presets = transferFunctions;
    this.#windows = windows;
    this.#menus();
  }

  /** @param volume its description; `display` and `window` may be absent */
  setVolume(histogram, range, { modality = '', display = null, window = null }) {
    this.#whole = range;
    this.#modality = modality;
    this.#display = display;
    this.#ownWindow = window && { name: 'from-file', title: 'From file', ...window };
    this.#menus();
    this.#editor.setVolume(histogram, range);
    if (this.#editor.points.length) this.#showRange(range);
  }

  /** Selects preset n = 0, 1... of the menu that the mode uses. */
  choose(n) {
    const menu = this.#get(this.#windowed ? 'window-preset' : 'preset');
    const options = [...menu.querySelectorAll('option')].filter((option) => option.value);
    if (!options[n]) return;
    menu.value = options[n].value;
    menu.dispatchEvent(new Event('change'));
  }

  update() {
    const { scene } = this.#store;
    if (!scene) return;
    const { points = [], preset = '' } = scene.transferFunction ?? {};
    if (points !== this.#editor.points) this.#editor.setPoints(points);
    this.#get('preset').value = preset || '';
    const found = this.#windowNamed((w) => w.center === scene.window?.center && w.width === scene.window?.width);
    this.#get('window-preset').value = found?.name ?? '';
    this.#fields();
  }

  get #windowed() {
    return ['mip', 'minip', 'average', 'mpr'].includes(this.#store.scene?.mode);
  }

  // Edited points clear the preset. A preset of null also clears its unit distance, so the patch sends that again.
  #edit(points) {
    const { unitDistance = 1 } = this.#store.scene.transferFunction;
    this.#store.patch({ transferFunction: { preset: null, points, unitDistance } });
  }

  // A drag is one step of undo, however many patches it makes.
  #held(on) {
    this.#base = on ? this.#editor.points : null;
    this.#gesture(on);
    if (!on) this.update();
  }

  #menus() {
    const { first, other } = presetsFor(this.#presets, this.#modality);
    fillMenu(this.#get('preset'), 'Custom', first, other);
    const windows = presetsFor(this.#windows, this.#modality);
    fillMenu(this.#get('window-preset'), 'Custom', [...this.#ownWindows, ...windows.first], windows.other);
    this.update();
  }

  #presetChosen(name) {
    const preset = this.#presets.find((candidate) => candidate.name === name);
    if (!preset) return;
    this.#store.patch(presetPatch(preset, this.#display, this.#whole));
    this.#showRange(this.#editor.range);
  }

  // The range must show at least one knot, or there would be nothing to drag.
  #showRange([low, high]) {
    const { points } = this.#editor;
    const inside = points.filter(({ value }) => value >= low && value <= high);
    if (points.length && inside.length < Math.min(2, points.length)) this.#editor.showKnots();
  }

  get #ownWindows() {
    return this.#ownWindow ? [this.#ownWindow] : [];
  }

  #windowNamed(fits) {
    return [...this.#ownWindows, ...this.#windows].find(fits);
  }

  #windowChosen(name) {
    const preset = this.#windowNamed((candidate) => candidate.name === name);
    if (preset) this.#store.patch({ window: { center: preset.center, width: preset.width } });
  }

  #bindFields() {
    const get = this.#get;
    const number = (id) => (get(id).value === '' ? NaN : Number(get(id).value));
    // The other field is rounded for display, so its value is not read.
    const move = (id) => {
      const typed = number(id);
      if (Number.isFinite(typed)) this.#editor.set(...(id === 'knot-value' ? [typed] : [undefined, typed]));
      this.#fields(true);
    };
    const axis = () => {
      const range = [number('axis-low'), number('axis-high')];
      if (range[1] > range[0]) this.#editor.setRange(range);
      else this.#axisFields(this.#editor.range);
    };
    get('preset').addEventListener('change', () => this.#presetChosen(get('preset').value));
    get('window-preset').addEventListener('change', () => this.#windowChosen(get('window-preset').value));
    for (const id of ['knot-value', 'knot-amount']) get(id).addEventListener('change', () => move(id));
    for (const id of ['axis-low', 'axis-high']) get(id).addEventListener('change', axis);
    get('knot-color').addEventListener('input', () => this.#editor.setColor(fromHex(get('knot-color').value)));
    get('knot-add').addEventListener('click', () => this.#editor.addNext());
    get('knot-remove').addEventListener('click', () => this.#editor.remove());
    get('axis-knots').addEventListener('click', () => this.#editor.showKnots());
    get('axis-all').addEventListener('click', () => this.#editor.showAll());
    get('log').addEventListener('click', () => {
      const log = get('log').getAttribute('aria-pressed') !== 'true';
      get('log').setAttribute('aria-pressed', log);
      this.#editor.setLog(log);
    });
  }

  // Shift and density apply to the points as they were when the slider was grabbed. The slider returns to 0 on release.
  #bindSliders() {
    const bind = (id, apply, show) => {
      const slider = this.#get(id);
      const output = this.#get(`${id}-value`);
      const rest = () => {
        if (this.#base) this.#held(false);
        slider.value = 0;
        output.textContent = show(0);
      };
      slider.addEventListener('input', () => {
        if (!this.#base) this.#held(true);
        this.#edit(apply(this.#base, Number(slider.value)));
        output.textContent = show(Number(slider.value));
      });
      for (const name of ['change', 'pointerup', 'pointercancel', 'blur']) slider.addEventListener(name, rest);
      rest();
    };
    const span = () => this.#editor.range[1] - this.#editor.range[0];
    const offset = (x) => x * span() * 0.5;
    bind(
      'shift',
      (points, x) => shiftKnots(points, offset(x)),
      (x) => `${x > 0 ? '+' : ''}${formatValue(offset(x), span())}`,
    );
    bind(
      'density',
      (points, x) => scaleAmounts(points, 10 ** x),
      (x) => `\u00d7${Number((10 ** x).toPrecision(2))}`,
    );
  }

  #fields(force = false) {
    const point = this.#editor.points[this.#editor.selected];
    if (!point) return;
    const span = this.#editor.range[1] - this.#editor.range[0];
    const write = (id, value) => {
      const field = this.#get(id);
      if (force || document.activeElement !== field) field.value = value;
    };
    write('knot-value', formatValue(point.value, span));
    write('knot-amount', String(Number(amountOf(point).toPrecision(4))));
    this.#get('knot-color').value = toHex(point.color);
    const name = amountName(this.#editor.points);
    this.#get('knot-amount-label').textContent = name === 'opacity' ? 'Opacity' : 'Extinction, 1/mm';
    this.#get('knot-remove').disabled = this.#editor.points.length < 2;
  }

  #axisFields([low, high]) {
    this.#get('axis-low').value = formatValue(low, high - low);
    this.#get('axis-high').value = formatValue(high, high - low);
  }
}

function fillMenu(menu, none, first, other) {
  const option = ({ name, title }) => new Option(title || name, name);
  menu.replaceChildren(new Option(none, ''), ...first.map(option));
  if (!other.length) return;
  const group = document.createElement('optgroup');
  group.label = 'Other modalities';
  group.append(...other.map(option));
  menu.append(group);
}
