// Form controls bound to the scene by their data attributes:
//   data-path="a.b.0"    value of a control <-> that member of the scene (a number at the end indexes an array)
//   data-show="a.b"      an <output> that shows it
//   data-number          a <select> whose values are numbers
//   data-modes="dvr mip" shown in these modes only
//   data-unless="a.b=x"  shown unless that member is x
//   data-span="range"    a slider that spans the volume's values ("width": 0 to their extent; "slab": what a slab may be)
// Members of an array are sent as the whole array: merge patches replace arrays.

import { fromHex, toHex } from './transfer_model.js';
import { lengthText } from './units.js';

const MOST_SLAB_MM = 50;

/** The value at a dotted path, or undefined. */
export function valueAt(scene, path) {
  return path
    .split('.')
    .reduce((value, name) => (value === undefined || value === null ? undefined : value[name]), scene);
}

/** The merge patch that sets a dotted path. @param scene supplies the other elements of an array */
export function patchFor(scene, path, value) {
  const names = path.split('.');
  const last = names.at(-1);
  if (/^\d+$/.test(last)) {
    const parent = names.slice(0, -1);
    const array = [...(valueAt(scene, parent.join('.')) ?? [])];
    array[Number(last)] = value;
    return patchFor(scene, parent.join('.'), array);
  }
  return names.reduceRight((inner, name) => ({ [name]: inner }), value);
}

function readControl(control) {
  if (control.type === 'checkbox') return control.checked;
  if (control.type === 'color') return fromHex(control.value);
  if (control.type === 'range' || control.type === 'number' || 'number' in control.dataset) {
    return control.value === '' ? undefined : Number(control.value);
  }
  return control.value;
}

function writeControl(control, value) {
  if (value === undefined || value === null) {
    if (control.options) control.selectedIndex = 0; // an absent member means the first choice
    return;
  }
  if (control.type === 'checkbox') control.checked = value;
  else if (control.type === 'color') control.value = toHex(value);
  else if (control.type === 'number') control.value = Number(Number(value).toPrecision(7));
  else control.value = String(value);
}

export class Panels {
  #root;
  #store;
  #on;
  #editing = null;

  /** gesture(bool) around a slider's drag; mode(value) when the mode is selected, instead of a patch */
  constructor(root, store, on) {
    this.#root = root;
    this.#store = store;
    this.#on = on;
    for (const control of root.querySelectorAll('[data-path]')) this.#bind(control);
    store.subscribe(() => this.update());
  }

  /** Sets the sliders' ends to the volume's values, and for a slab to its least width in mm. */
  setVolume([low, high], width) {
    const extent = high - low || 1;
    for (const slider of this.#root.querySelectorAll('[data-span="slab"]')) {
      slider.max = Math.min(MOST_SLAB_MM, width);
      slider.step = slider.max / 100;
    }
    for (const slider of this.#root.querySelectorAll('[data-span]:not([data-span="slab"])')) {
      [slider.min, slider.max] = slider.dataset.span === 'range' ? [low, high] : [extent / 1000, extent];
      slider.step = extent / 1000;
    }
    this.update();
  }

  /** A run-length model has no voxel grid, so that only mode splat can show it, and attributes of its own. */
  setModel(model) {
    for (const option of this.#root.querySelectorAll('[data-path="mode"] option'))
      option.hidden = Boolean(model) && option.value !== 'splat';
    const menu = this.#root.querySelector('[data-path="splat.attribute"]');
    for (const option of menu.querySelectorAll('[data-own]')) option.remove();
    for (const name of Object.keys(model?.attributes ?? {})) {
      if (name === 'value') continue;
      const option = new Option(`Attribute ${name}`, name);
      option.dataset.own = '';
      menu.append(option);
    }
    this.update();
  }

  /** Removes choices that the daemon does not offer, learned from a refused patch. */
  withdraw(patch) {
    for (const menu of this.#root.querySelectorAll('select[data-path]')) {
      const value = valueAt(patch, menu.dataset.path);
      this.#withhold(menu, value);
    }
  }

  /** Removes choices that the daemon lists as unavailable. @param unavailable {dotted path: [values]} */
  withhold(unavailable = {}) {
    for (const [path, values] of Object.entries(unavailable)) {
      for (const control of this.#root.querySelectorAll(`[data-path="${path}"]`)) {
        if (control.type === 'checkbox') control.disabled = values.includes(true);
        else if (control.options) for (const value of values) this.#withhold(control, value);
      }
    }
  }

  #withhold(menu, value) {
    const option = [...menu.options].find((candidate) => value !== undefined && candidate.value === String(value));
    if (!option || option.disabled) return;
    option.disabled = true;
    option.value = String(value); // without a value attribute the text would be used
    option.title = 'Not in this version of the daemon';
    option.text += ' (not in this version)';
  }

  update() {
    const { scene } = this.#store;
    if (!scene) return;
    for (const control of this.#root.querySelectorAll('[data-path]')) {
      if (control !== this.#editing) writeControl(control, valueAt(scene, control.dataset.path));
    }
    for (const output of this.#root.querySelectorAll('[data-show]')) {
      const value = valueAt(scene, output.dataset.show);
      output.textContent = typeof value === 'number' ? String(Number(value.toPrecision(4))) : (value ?? '');
    }
    for (const element of this.#root.querySelectorAll('[data-modes]')) {
      element.hidden = !element.dataset.modes.split(' ').includes(scene.mode);
    }
    for (const element of this.#root.querySelectorAll('[data-unless]')) {
      const [path, value] = element.dataset.unless.split('=');
      element.hidden = String(valueAt(scene, path)) === value;
    }
  }

  #bind(control) {
    const typed = control.type === 'number';
    control.addEventListener(typed ? 'change' : 'input', () => this.#edited(control));
    if (typed) control.addEventListener('input', () => (this.#editing = control)); // what is being typed is not overwritten
    for (const name of ['change', 'blur'])
      control.addEventListener(name, () => {
        this.#editing = null;
        this.update();
      });
    if (control.type === 'range') bindGesture(control, this.#on.gesture);
  }

  #edited(control) {
    const value = readControl(control);
    if (value === undefined || Number.isNaN(value)) {
      this.update();
      return;
    }
    if (control.dataset.path === 'mode') this.#on.mode(value);
    else this.#store.patch(patchFor(this.#store.scene, control.dataset.path, value));
  }
}

/** While a slider is held, the picture may be coarser. */
export function bindGesture(slider, gesture) {
  let held = false;
  const set = (on) => {
    if (held === on) return;
    held = on;
    gesture(on);
  };
  slider.addEventListener('pointerdown', () => set(true));
  for (const name of ['pointerup', 'pointercancel', 'blur', 'change']) slider.addEventListener(name, () => set(false));
}

/** Shows one section at a time in a narrow window, with the usual keys of a tab list. */
export function bindTabs(panel) {
  const tabs = [...panel.querySelectorAll('[role="tab"]')];
  const choose = (tab) => {
    for (const section of panel.querySelectorAll('section')) section.classList.toggle('current', section.id === tab.getAttribute('aria-controls'));
    for (const other of tabs) {
      other.setAttribute('aria-selected', other === tab);
      other.tabIndex = other === tab ? 0 : -1;
    }
  };
  tabs.forEach((tab, i) => {
    tab.addEventListener('click', () => choose(tab));
    tab.addEventListener('keydown', ({ key }) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[key];
      if (!step) return;
      const next = tabs[(i + step + tabs.length) % tabs.length];
      choose(next);
      next.focus();
    });
  });
  choose(tabs[0]);
}

const CROP_SIDES = [
  ['Right', 0, 0],
  ['Left', 1, 0],
  ['Anterior', 0, 1],
  ['Posterior', 1, 1],
  ['Feet', 0, 2],
  ['Head', 1, 2],
];
const LEAST_LEFT = 0.005; // part of the extent that must remain, since crossed sliders would show nothing

/** Six sliders, each cropping mm from its side. */
export class CropPanel {
  #store;
  #sides = [];
  #box = null;

  constructor(host, resetButton, store, gesture) {
    this.#store = store;
    for (const [name, end, axis] of CROP_SIDES) {
      const label = Object.assign(document.createElement('label'), { className: 'slider' });
      const slider = Object.assign(document.createElement('input'), { type: 'range', min: 0, max: 1, value: 0 });
      const output = document.createElement('output');
      label.append(Object.assign(document.createElement('span'), { textContent: name }), slider, output);
      host.append(label);
      slider.addEventListener('input', () => this.#edited());
      bindGesture(slider, gesture);
      this.#sides.push({ slider, output, end, axis });
    }
    resetButton.addEventListener('click', () => store.patch({ clip: { box: null } }));
    store.subscribe(() => this.update());
  }

  setBox(box) {
    this.#box = box;
    for (const { slider, axis } of this.#sides) {
      const extent = box.high[axis] - box.low[axis];
      slider.max = extent * (1 - LEAST_LEFT);
      slider.step = extent / 400;
    }
    this.update();
  }

  update() {
    if (!this.#box) return;
    const clip = this.#store.scene?.clip?.box ?? [this.#box.low, this.#box.high];
    for (const { slider, output, end, axis } of this.#sides) {
      const cut = Math.max(0, end ? this.#box.high[axis] - clip[1][axis] : clip[0][axis] - this.#box.low[axis]);
      if (document.activeElement !== slider) slider.value = cut;
      output.textContent = lengthText(cut, this.#box.high[axis] - this.#box.low[axis]);
    }
  }

  #edited() {
    const corners = [[...this.#box.low], [...this.#box.high]];
    for (const { slider, end, axis } of this.#sides) corners[end][axis] += (end ? -1 : 1) * Number(slider.value);
    for (let axis = 0; axis < 3; axis++) {
      const least = (this.#box.high[axis] - this.#box.low[axis]) * LEAST_LEFT;
      if (corners[1][axis] - corners[0][axis] < least) corners[1][axis] = corners[0][axis] + least;
    }
    this.#store.patch({ clip: { box: corners } });
  }
}
