// The slice slider beside the picture in mode mpr.

import { add, scale } from './camera.js';
import { slicePosition } from './caption.js';
import { bindGesture } from './panels.js';

export class SliceSlider {
  #slider;
  #store;
  #shown;

  /** shown() -> {volume, box}; gesture(bool) around a drag */
  constructor(slider, store, { shown, gesture }) {
    this.#slider = slider;
    this.#store = store;
    this.#shown = shown;
    slider.addEventListener('input', () => this.#edited());
    bindGesture(slider, gesture);
    store.subscribe(() => this.update());
  }

  update() {
    const { scene } = this.#store;
    const { volume } = this.#shown();
    const sliced = scene?.mode === 'mpr' && volume !== null;
    this.#slider.hidden = !sliced;
    if (!sliced) return;
    const { index, count } = slicePosition(scene.mpr ?? {}, volume);
    this.#slider.max = count;
    this.#slider.value = Math.round(index) + 1;
    this.#slider.ariaValueText = `${this.#slider.value} of ${count}`;
  }

  #edited() {
    const { volume, box } = this.#shown();
    const { mpr } = this.#store.scene;
    const { index, step, axis } = slicePosition(mpr, volume);
    const way = (Number(this.#slider.value) - 1 - index) * step;
    this.#store.patch({ mpr: { center: add(mpr.center ?? box.center, scale(axis, way)) } });
  }
}
