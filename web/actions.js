// The actions on the view that keys and buttons trigger, by their names in the table of bindings.

import { contextOf } from './bindings.js';
import { fit, standardView } from './camera.js';
import { Cine } from './cine.js';
import { atLastSlice } from './steer.js';

const PLANES = { A: 'coronal', P: 'coronal', L: 'sagittal', R: 'sagittal', H: 'axial', F: 'axial' };

export class Actions {
  #with;
  #cine;
  #inverted = false;

  /**
   * store, stage, buttons {cine, invert, fullscreen}; gesture(bool); look; history; move(moved) as steer() takes it;
   * shown() -> {box} of the volume; sequence; help()
   */
  constructor(parts) {
    this.#with = parts;
    const { store, stage, gesture, move, shown } = parts;
    this.#cine = new Cine({
      mode: () => store.scene?.mode,
      gesture,
      move,
      atEnd: () => atLastSlice(store.scene, shown().box),
    });
    const stop = ({ target }) => {
      if (target.closest('[data-own-pointer]')) return;
      this.#cine.stop();
      this.#show();
    };
    stage.addEventListener('pointerdown', stop);
    stage.addEventListener('wheel', stop, { passive: true });
    store.subscribe(() => this.#show());
    for (const [name, button] of Object.entries(parts.buttons)) button.addEventListener('click', () => this.do(name));
    document.addEventListener('fullscreenchange', () => this.#show());
    parts.buttons.fullscreen.hidden = !document.fullscreenEnabled;
  }

  do(name, argument) {
    const { look, history, move, help, sequence, stage } = this.#with;
    if (!['cine', 'play', 'volume'].includes(name)) this.#cine.stop();
    const known = {
      view: () => this.#view(argument),
      reset: () => this.#reset(),
      turn: () => move({ orbit: argument }),
      magnify: () => move({ factor: argument }),
      slices: () => move({ slices: argument }),
      cine: () => this.#cine.toggle(),
      play: () => sequence.toggle(),
      volume: () => sequence.step(argument),
      invert: () => this.#invert(),
      fullscreen: () => (document.fullscreenElement ? document.exitFullscreen() : stage.requestFullscreen()),
      preset: () => look.choose(argument),
      undo: () => history.undo(),
      redo: () => history.redo(),
      help,
    };
    known[name]?.();
    this.#show();
  }

  /** The picture as shown on the screen: inverted if the stage is. @returns {Promise<Blob>} */
  async shown(blob) {
    if (!this.#applies) return blob;
    const bitmap = await createImageBitmap(blob);
    const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
    const context = canvas.getContext('2d');
    context.filter = 'invert(1)';
    context.drawImage(bitmap, 0, 0);
    return canvas.convertToBlob({ type: blob.type });
  }

  #view(letter) {
    const { store } = this.#with;
    if (!store.scene) return;
    if (store.scene.mode === 'mpr') store.patch({ mpr: { orientation: PLANES[letter] } });
    else store.patch({ camera: standardView(store.scene.camera, letter) });
  }

  #reset() {
    const { store, stage, shown } = this.#with;
    const { box } = shown();
    if (!store.scene || !box) return;
    if (store.scene.mode === 'mpr') store.patch({ mpr: { center: box.center, zoom: 1 } });
    else {
      const aspect = stage.clientWidth / Math.max(1, stage.clientHeight);
      store.patch({ camera: fit(standardView(store.scene.camera, 'A'), box, aspect) });
    }
  }

  #invert() {
    this.#inverted = !this.#inverted;
  }

  /** Inverting black and white suits grey pictures only: colours would be wrong. */
  get #grey() {
    const { scene } = this.#with.store;
    return scene !== null && contextOf(scene.mode) !== 'volume';
  }

  get #applies() {
    return this.#inverted && this.#grey;
  }

  #show() {
    const { stage, buttons } = this.#with;
    stage.classList.toggle('inverted', this.#applies);
    buttons.invert.hidden = !this.#grey;
    buttons.invert.ariaPressed = this.#applies;
    buttons.cine.ariaPressed = this.#cine.running;
    buttons.fullscreen.ariaPressed = document.fullscreenElement !== null;
  }
}
