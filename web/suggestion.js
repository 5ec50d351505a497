// Suggests the mode that the plan expects to draw an opaque surface fastest, if the current mode is much slower.

const NAMES = { isosurface: 'an isosurface', mesh: 'a surface mesh', splat: 'splats (coarser outlines)' };
const WORTH = 1.5; // least speed-up worth a suggestion
const short = (ms) => Number(ms.toPrecision(2));

/** Identifies the surfaces asked about, independent of the camera. */
const subject = ({ mode, isosurface, splat, mesh, labels }) =>
  mode in NAMES ? JSON.stringify([mode, isosurface?.value, splat?.threshold, mesh?.surfaces, labels?.volume]) : '';

/** @returns {{mode: string, text: string}|null} of a plan's `object` */
export function suggestionOf(mode, object) {
  const { cheapest, expectedMs } = object ?? {};
  if (!expectedMs || cheapest === mode || !(expectedMs[mode] > WORTH * expectedMs[cheapest])) return null;
  const [best, now] = [short(expectedMs[cheapest]), short(expectedMs[mode])];
  const text = `Drawn as ${NAMES[cheapest]}, a frame would take about ${best} ms instead of ${now} ms.`;
  return { mode: cheapest, text };
}

export class Suggestion {
  #get;
  #store;
  #plan;
  #asked = '';
  #offered = null;
  #declined = new Set(); // modes, on this page

  /** get(id): an element; plan(): promise of the session's plan; take(mode): switches to it */
  constructor(get, store, { plan, take }) {
    this.#get = get;
    this.#store = store;
    this.#plan = plan;
    get('suggestion-take').addEventListener('click', () => take(this.#offered.mode));
    get('suggestion-close').addEventListener('click', () => {
      this.#declined.add(this.#offered.mode);
      this.#offer(null);
    });
    store.subscribe(() => this.#update());
  }

  /** After a picture: asks once for each surface with a final picture. */
  async frame({ final }) {
    const { scene } = this.#store;
    const about = subject(scene);
    if (!final || about === this.#asked) return;
    this.#asked = about;
    this.#offer(null);
    if (!about) return;
    const { object } = await this.#plan();
    const found = suggestionOf(scene.mode, object);
    const wanted = found && !this.#declined.has(found.mode);
    if (wanted && this.#asked === about && subject(this.#store.scene) === about) this.#offer(found);
  }

  #update() {
    if (this.#offered && subject(this.#store.scene ?? {}) !== this.#asked) this.#offer(null);
  }

  #offer(offered) {
    this.#offered = offered;
    this.#get('suggestion').hidden = !offered;
    this.#get('suggestion-text').textContent = offered?.text ?? '';
  }
}
