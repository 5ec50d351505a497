// The list of surfaces drawn in modes mesh, dvr and mip: edits scene.mesh.surfaces, which is sent as a whole.

import { bindGesture } from './panels.js';
import { depthText } from './status.js';
import { fromHex, toHex } from './transfer_model.js';

const MOST = 256;
const SKIN = [0.95, 0.75, 0.65];
const LOOKS = { '': "The scene's look", none: 'Unlit', lambert: 'Matt', 'blinn-phong': 'Glossy', gooch: 'Gooch' };
const PLANES = ['axial', 'coronal', 'sagittal'];

const element = (name, properties) => Object.assign(document.createElement(name), properties);

/** The list plus one translucent surface around the existing one. @param range of the volume's values */
export function withSurface({ isosurface, mesh }, [low]) {
  const first = { value: isosurface.value, color: isosurface.color, opacity: 1, visible: true };
  const list = mesh?.surfaces?.length ? mesh.surfaces : [first];
  const least = Math.min(...list.map(({ value }) => value ?? Infinity), isosurface.value);
  return [...list, { value: Math.round((low + 2 * least) / 3), color: SKIN, opacity: 0.3, visible: true }];
}

/** Name of a surface's source. */
export const nameOf = ({ label, mesh, plane }) =>
  label ? `Label ${label}` : mesh ? mesh : plane ? `Slice, ${plane}` : 'Value';

export class Surfaces {
  #get;
  #store;
  #gesture;
  #range = [0, 1];
  #rows = []; // {kind, controls} in list order

  constructor(get, store, gesture) {
    this.#get = get;
    this.#store = store;
    this.#gesture = gesture;
    get('surfaces-add').addEventListener('click', () => this.#send(withSurface(store.scene, this.#range)));
    get('surfaces-slice').addEventListener('click', () =>
      this.#send([...this.#list(), { plane: this.#nextPlane(), opacity: 1, visible: true }]),
    );
    store.subscribe(() => this.update());
  }

  setVolume(range) {
    this.#range = range;
    this.#rows = []; // rebuilt, since the sliders span other values
    this.update();
  }

  update() {
    const list = this.#list();
    const kinds = list.map(nameOf);
    if (kinds.join() !== this.#rows.map(({ kind }) => kind).join() || list.length !== this.#rows.length) {
      this.#rows = list.map((surface, i) => this.#row(surface, i));
      this.#get('surfaces-list').replaceChildren(...this.#rows.map(({ row }) => row));
    }
    list.forEach((surface, i) => {
      const { value, color, own, opacity, eye, look } = this.#rows[i];
      if (own) own.disabled = !surface.color;
      if (own) color.classList.toggle('unset', !surface.color); // the mesh's own colours are in use
      if (look) look.value = surface.model ?? '';
      const shown = { value: surface.value, opacity: surface.opacity ?? 1 };
      for (const [name, { slider, output }] of Object.entries({ ...(value && { value }), opacity })) {
        if (document.activeElement !== slider) slider.value = shown[name];
        output.textContent = Number(shown[name].toPrecision(4));
      }
      if (color && document.activeElement !== color && surface.color) color.value = toHex(surface.color);
      const visible = surface.visible ?? true;
      eye.setAttribute('aria-pressed', visible);
      eye.textContent = visible ? 'Shown' : 'Hidden';
      eye.ariaLabel = `${eye.textContent}: surface ${i + 1}`;
    });
    if (list.length && this.#store.scene.mode === 'mesh') this.#get('single-surface').hidden = true; // not read then
    this.#get('surfaces-add').disabled = this.#get('surfaces-slice').disabled = list.length >= MOST;
  }

  /** What the error meter found of the picture on screen, below the surface that it is of. While it is on there is room for
   *  that, so that no control moves under a hand. */
  measured(error) {
    const on = this.#store.scene?.mode === 'mesh' && this.#store.scene.errorMeter?.pixels > 0;
    this.#rows.forEach(({ off }, i) => {
      const found = error?.surfaces?.find(({ surface }) => surface === i);
      off.textContent = found ? depthText(found) : error ? 'no measured pixel shows it' : '';
      off.hidden = !on;
    });
  }

  #list() {
    return this.#store.scene?.mesh?.surfaces ?? [];
  }

  #nextPlane() {
    const taken = this.#list().map(({ plane }) => plane);
    return PLANES.find((plane) => !taken.includes(plane)) ?? PLANES[0];
  }

  #send(surfaces) {
    const within = this.#store.scene.mode !== 'mesh' && { withVolume: true };
    this.#store.patch({ mesh: { surfaces, ...within } });
  }

  #change(i, members) {
    this.#send(this.#list().map((surface, k) => (k === i ? { ...surface, ...members } : surface)));
  }

  #slider(i, member, [min, max], text) {
    const slider = element('input', { type: 'range', min, max, step: (max - min) / 1000, ariaLabel: `${text} of surface ${i + 1}` });
    slider.addEventListener('input', () => this.#change(i, { [member]: Number(slider.value) }));
    bindGesture(slider, this.#gesture);
    const output = element('output', {});
    const line = element('label', { className: 'slider' });
    line.append(element('span', { textContent: text }), slider, output);
    return { line, slider, output };
  }

  #row(surface, i) {
    const kind = nameOf(surface);
    const name = `surface ${i + 1}`;
    const row = element('li', {});
    const value = 'value' in surface ? this.#slider(i, 'value', this.#range, 'Value') : null;
    const color = surface.plane ? null : element('input', { type: 'color', ariaLabel: `Colour of ${name}` });
    color?.addEventListener('input', () => this.#change(i, { color: fromHex(color.value) }));
    const own =
      surface.label || surface.mesh
        ? element('button', { textContent: 'Own colour', ariaLabel: `Own colour of ${name}` })
        : null;
    own?.addEventListener('click', () => {
      const { color: _, ...rest } = this.#list()[i];
      this.#send(this.#list().map((s, k) => (k === i ? rest : s)));
    });
    const opacity = this.#slider(i, 'opacity', [0, 1], 'Opacity');
    const eye = element('button', {});
    eye.addEventListener('click', () => this.#change(i, { visible: !(this.#list()[i].visible ?? true) }));
    const drop = element('button', { textContent: 'Remove', ariaLabel: `Remove ${name}` });
    drop.addEventListener('click', () => this.#send(this.#list().filter((_, k) => k !== i)));
    const look = surface.plane ? null : element('select', { ariaLabel: `Look of ${name}` });
    for (const [model, text] of Object.entries(LOOKS)) look?.append(new Option(text, model));
    look?.addEventListener('change', () => {
      const { model: _, ...rest } = this.#list()[i];
      this.#send(this.#list().map((s, k) => (k !== i ? s : look.value ? { ...rest, model: look.value } : rest)));
    });
    row.append(color ?? element('span', {}), element('span', { textContent: value ? 'Isosurface' : kind }), eye, drop);
    if (value) row.append(value.line);
    row.append(opacity.line);
    if (look) {
      const line = element('label', {});
      line.append(element('span', { textContent: 'Look' }), look);
      row.append(line);
    }
    if (own) row.append(own);
    const off = element('small', { hidden: true });
    row.append(off);
    return { kind, row, value, color, own, opacity, eye, look, off };
  }
}
