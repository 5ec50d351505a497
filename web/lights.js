// The lights of surfaces: edits scene.mesh.lights, which is sent as a whole.

import { bindGesture } from './panels.js';
import { fromHex, toHex } from './transfer_model.js';

const MOST = 8;
const MOST_INTENSITY = 4;
const DEGREE = Math.PI / 180;

const element = (name, properties) => Object.assign(document.createElement(name), properties);

/** Direction to a light in LPS, from degrees to the patient's left of the front and degrees up. */
export function directionOf(aside, up) {
  const [a, e] = [aside * DEGREE, up * DEGREE];
  return [Math.sin(a) * Math.cos(e), -Math.cos(a) * Math.cos(e), Math.sin(e)];
}

/** The inverse: [aside, up] of a direction of any length. */
export const anglesOf = ([x, y, z]) => [Math.atan2(x, -y) / DEGREE, Math.atan2(z, Math.hypot(x, y)) / DEGREE];

export class Lights {
  #get;
  #store;
  #gesture;
  #rows = [];

  constructor(get, store, gesture) {
    this.#get = get;
    this.#store = store;
    this.#gesture = gesture;
    get('lights-add').addEventListener('click', () => this.#send([...this.#list(), this.#another()]));
    store.subscribe(() => this.update());
  }

  update() {
    const list = this.#list();
    const fixed = ({ direction }) => Boolean(direction);
    if (list.map(fixed).join() !== this.#rows.map(fixed).join()) {
      this.#rows = list.map((light, i) => this.#row(light, i));
      this.#get('lights-list').replaceChildren(...this.#rows.map(({ row }) => row));
    }
    list.forEach((light, i) => {
      const { color, intensity, angles } = this.#rows[i];
      const values = [...(light.direction ? anglesOf(light.direction) : []), light.intensity];
      [...angles, intensity].forEach((slider, k) => {
        if (document.activeElement !== slider) slider.value = values[k];
      });
      if (document.activeElement !== color) color.value = toHex(light.color);
    });
    this.#get('lights-add').disabled = list.length >= MOST;
  }

  #list() {
    return this.#store.scene?.mesh?.lights ?? [];
  }

  /** The first entry replaces the single default light; further lights come from a side. */
  #another() {
    return { color: [1, 1, 1], intensity: 1, ...(this.#list().length && { direction: directionOf(60, 30) }) };
  }

  #send(lights) {
    this.#store.patch({ mesh: { lights } });
  }

  #change(i, members) {
    this.#send(this.#list().map((light, k) => (k === i ? { ...light, ...members } : light)));
  }

  #slider(label, min, max, changed) {
    const slider = element('input', { type: 'range', min, max, step: (max - min) / 360, ariaLabel: label, title: label });
    slider.addEventListener('input', () => changed());
    bindGesture(slider, this.#gesture);
    return slider;
  }

  #row({ direction }, i) {
    const name = `light ${i + 1}`;
    const row = element('li', {});
    const color = element('input', { type: 'color', ariaLabel: `Colour of ${name}` });
    color.addEventListener('input', () => this.#change(i, { color: fromHex(color.value) }));
    const intensity = this.#slider(`Intensity of ${name}`, 0, MOST_INTENSITY, () =>
      this.#change(i, { intensity: Number(intensity.value) }),
    );
    const turn = () => this.#change(i, { direction: directionOf(...angles.map(({ value }) => Number(value))) });
    const angles = direction
      ? [this.#slider(`Side of ${name}`, -180, 180, turn), this.#slider(`Height of ${name}`, -90, 90, turn)]
      : [];
    const camera = element('button', { textContent: direction ? 'Fixed' : 'At the eye' });
    camera.ariaLabel = `${camera.textContent}: ${name}`;
    camera.addEventListener('click', () => {
      const { direction: _, ...at } = this.#list()[i];
      this.#send(
        this.#list().map((light, k) => (k !== i ? light : direction ? at : { ...at, direction: directionOf(60, 30) })),
      );
    });
    const drop = element('button', { textContent: 'Remove', ariaLabel: `Remove ${name}` });
    drop.addEventListener('click', () => this.#send(this.#list().filter((_, k) => k !== i)));
    row.append(color, intensity, camera, drop, ...angles);
    return { direction, row, color, intensity, angles };
  }
}
