// The quality control: a fixed step, a bound on the error or a time budget; and the daemon's choice.

import { bindGesture } from './panels.js';

/** The scene's kind of control: 'step', 'error' or 'time'. */
export function qualityKind(scene) {
  if (scene?.quality?.maxError > 0) return 'error';
  return scene?.quality?.maxMilliseconds > 0 ? 'time' : 'step';
}

/** The merge patch for a kind; the bounds exclude each other. @param value error 0..1, or ms */
export function qualityPatch(kind, value) {
  return {
    quality: { maxError: kind === 'error' ? value : null, maxMilliseconds: kind === 'time' ? value : null },
  };
}

const ASK_AGAIN_MS = 1500;

const short = (value) => String(Number(value.toPrecision(2)));

/** Sliders of bounds are logarithmic: each unit doubles the bound. */
const BOUNDS = {
  error: { member: 'maxError', first: 1 / 255, value: (x) => 2 ** x / 255, at: (v) => Math.log2(v * 255) },
  time: { member: 'maxMilliseconds', first: 32, value: (x) => 2 ** x, at: (v) => Math.log2(v) },
};
const SHOWN = { error: (v) => `${short(v * 255)}/255`, time: (v) => `${short(v)} ms` };

export class QualityPanel {
  #get;
  #store;
  #plan;
  #asked = 0; // request counter: only the newest reply is shown

  /** get(id): an element; plan(): promise of the session's plan */
  constructor(get, store, { gesture, plan }) {
    this.#get = get;
    this.#store = store;
    this.#plan = plan;
    get('quality').addEventListener('change', () => this.#choose(get('quality').value));
    for (const [kind, { value }] of Object.entries(BOUNDS)) {
      const slider = get(`quality-${kind}`);
      slider.addEventListener('input', () => store.patch(qualityPatch(kind, value(Number(slider.value)))));
      bindGesture(slider, gesture);
    }
    store.subscribe(() => this.update());
  }

  /** After a picture: the plan of a final one has its sampling. */
  async frame({ final }) {
    if (!final || qualityKind(this.#store.scene) === 'step') return;
    const question = ++this.#asked;
    const { quality } = await this.#plan();
    if (question !== this.#asked) return;
    this.#get('quality-why').textContent = quality?.reason ?? '';
    /* The first measurement of a look finishes later, without a new picture. */
    if (quality?.views === 0) setTimeout(() => question === this.#asked && this.frame({ final }), ASK_AGAIN_MS);
  }

  update() {
    const { scene } = this.#store;
    if (!scene) return;
    const chosen = qualityKind(scene);
    this.#get('quality').value = chosen;
    this.#get('quality-step-field').hidden = chosen !== 'step';
    this.#get('quality-why').hidden = chosen === 'step';
    for (const [kind, { member, at }] of Object.entries(BOUNDS)) {
      this.#get(`quality-${kind}-field`).hidden = chosen !== kind;
      if (chosen !== kind) continue;
      const slider = this.#get(`quality-${kind}`);
      if (document.activeElement !== slider) slider.value = at(scene.quality[member]);
      this.#get(`quality-${kind}-shown`).textContent = SHOWN[kind](scene.quality[member]);
    }
  }

  #choose(kind) {
    this.#asked++;
    this.#get('quality-why').textContent = '';
    this.#store.patch(qualityPatch(kind, BOUNDS[kind]?.first));
  }
}
