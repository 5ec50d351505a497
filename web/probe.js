// Probes the picture: a click reports the point, a double click centres it.

import { add, basis, dot, scale, sub } from './camera.js';
import { slicePlace } from './steer.js';
import { placeText } from './units.js';

/** The camera with the same picture, shifted so that `place` is in its middle and the centre of rotation. */
export function centredOn(camera, place) {
  const { right, up } = basis(camera);
  const off = sub(place, camera.target);
  const shift = add(scale(right, dot(off, right)), scale(up, dot(off, up)));
  return { ...camera, position: add(camera.position, shift), target: place };
}

/** A number, or a normal's components. */
const attributeText = (number) =>
  Array.isArray(number) ? number.map((n) => n.toFixed(2)).join(' ') : String(Number(number.toPrecision(5)));

export class Probe {
  #api;
  #client;
  #store;
  #shown;
  #labelName;
  #on;

  /**
   * shown() -> {volume, box, caption: the picture's, pixels: {width, height} requested}; labelName(number); on:
   * text(string), problem(error)
   */
  constructor({ api, client, store, shown, labelName, on }) {
    this.#labelName = labelName;
    this.#api = api;
    this.#client = client;
    this.#store = store;
    this.#shown = shown;
    this.#on = on;
  }

  /** Reports position, value, and label or surface. x, y: CSS pixels of the stage */
  async tell(x, y) {
    const found = await this.#find(x, y);
    if (found !== undefined) this.#on.text(this.#text(found));
  }

  /** Centres the point. */
  async centre(x, y) {
    const { mode } = this.#shown().caption.scene ?? {};
    const found = mode === 'mpr' ? { position: this.#slicePlace(x, y) } : await this.#find(x, y);
    if (!found?.position || this.#store.scene?.mode !== mode) return;
    if (mode === 'mpr') this.#store.patch({ mpr: { center: found.position } });
    else this.#store.patch({ camera: centredOn(this.#store.scene.camera, found.position) });
  }

  /** @returns null if nothing was hit, undefined if unknown, since the daemon can probe its newest scene only */
  async #find(x, y) {
    const { caption } = this.#shown();
    if (!this.#client.connected || !caption.current || !caption.placeOf(x, y)) return undefined;
    try {
      return await this.#api.json('GET', this.#address(x, y));
    } catch (error) {
      if (error.status !== 404 && error.status !== 501) this.#on.problem(error);
      return null;
    }
  }

  /**
   * A slice shows one point per pixel, so its position is computed here. In 3-D the daemon picks the first visible
   * point.
   */
  #address(x, y) {
    const { caption, volume, pixels } = this.#shown();
    if (caption.scene.mode === 'mpr') {
      const at = this.#slicePlace(x, y).map((mm) => mm.toFixed(4));
      return `v1/volumes/${encodeURIComponent(volume.id)}/value?at=${at.join(',')}`;
    }
    const { width, height } = pixels;
    const [across, down] = caption.placeOf(x, y);
    const pixel = `x=${Math.floor(across * width)}&y=${Math.floor(down * height)}&width=${width}&height=${height}`;
    return `v1/sessions/${encodeURIComponent(this.#client.session)}/pick?${pixel}`;
  }

  /** In the slice on the canvas; null outside. */
  #slicePlace(x, y) {
    const { caption, box } = this.#shown();
    const place = caption.placeOf(x, y);
    if (!place) return null;
    const { width, height } = caption.size;
    return slicePlace(caption.scene, [place[0] * width, place[1] * height], caption.size, box);
  }

  #text(found) {
    const place = found?.position ?? found?.at;
    if (!place) return '';
    const { volume, box } = this.#shown();
    const side = (mm, plus, minus) => `${mm >= 0 ? plus : minus} ${placeText(Math.abs(mm), 2 * box.radius)}`;
    const unit = volume.unit ? ` ${volume.unit}` : '';
    const value = (found.value ?? null) === null ? '' : `  \u00b7  ${Number(found.value.toPrecision(5))}${unit}`;
    const own = Object.entries(found.attributes ?? {}).filter(([attribute]) => attribute !== 'value');
    const rest = own.map(([attribute, number]) => `  \u00b7  ${attribute} ${attributeText(number)}`).join('');
    const name = found.label ? this.#labelName(found.label) : found.surface >= 0 ? `Surface ${found.surface + 1}` : '';
    const [x, y, z] = place;
    const what = name && `  \u00b7  ${name}`;
    return `${side(x, 'L', 'R')}  ${side(y, 'P', 'A')}  ${side(z, 'H', 'F')} mm${value}${rest}${what}`;
  }
}
