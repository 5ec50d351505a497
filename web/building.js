// What the next picture waits for, where building it takes long (BuildingMessage): shown over the picture that stays
// meanwhile, and given up on demand, which takes the last edit back.

const WORDS = { mesh: 'Extracting surfaces', splats: 'Collecting voxels', coefficients: 'Preparing the filter' };

export class Building {
  #get;

  /** cancel(): gives it up */
  constructor(get, cancel) {
    this.#get = get;
    get('building-cancel').addEventListener('click', () => {
      this.done();
      cancel();
    });
  }

  show({ stage, share }) {
    this.#get('building-text').textContent = `${WORDS[stage] ?? 'Preparing the picture'} \u2026`;
    const bar = this.#get('building-bar');
    if (share > 0) bar.value = share;
    else bar.removeAttribute('value');
    this.#get('building').hidden = false;
  }

  done() {
    this.#get('building').hidden = true;
  }
}
