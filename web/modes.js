// Adapts the look when the mode changes, and restores it when the mode is left.

import { projectionLook } from './display.js';
import { difference } from './history.js';
import { joinPatches, mergePatch } from './state.js';

const projection =
  (mode) =>
  (scene, { display, box }) =>
    projectionLook(mode, scene, display, box);

const surface = ({ shading, filter }) => ({
  ...(shading?.model === 'none' && { shading: { model: 'blinn-phong' } }),
  ...(filter !== 'linear' && { filter: 'linear' }),
});

/**
 * Patches that come with a mode. A surface without shading is a mere outline, and the exact root needs the linear
 * filter.
 */
const BRINGS = {
  mip: projection('mip'),
  minip: projection('minip'),
  average: projection('average'),
  isosurface: surface,
  mesh: surface,
  splat: surface,
};

export class Modes {
  #lent = new Map(); // mode -> {brought, had}: merge patches
  #volume = {};

  /** @param display of the volume's description, or undefined */
  setVolume(display, box) {
    this.#volume = { display, box };
    this.#lent.clear();
  }

  /** The patch that switches to `mode`. Restores what the previous mode's patch changed, unless it was edited since. */
  choose(scene, mode) {
    const { brought, had } = this.#lent.get(scene.mode) ?? {};
    const untouched = brought && !Object.keys(difference(scene, mergePatch(scene, brought))).length;
    const back = untouched && mode !== scene.mode ? had : {};
    const plain = mergePatch(scene, back);
    const brings = BRINGS[mode]?.(plain, this.#volume) ?? {};
    if (mode !== scene.mode)
      this.#lent.set(mode, { brought: brings, had: difference(mergePatch(plain, brings), plain) });
    return joinPatches({ mode, ...back }, brings);
  }
}
