// Shows the progress of the resource that the next picture waits for (BuildingMessage), over the current picture. On
// cancel the last edit is undone.

const WORDS = { mesh: 'Extracting surfaces', splats: 'Collecting voxels', coefficients: 'Preparing the filter' };

export class Building {
  #get;

  /** cancel(): cancels the build */
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
