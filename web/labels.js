// Labels: a second volume that colours and hides parts of the first one. Edits scene.labels.

import { fromHex, toHex } from './transfer_model.js';

const MOST = 256; // rows listed at most

/** The labels that occur: [{label, count}]. The histogram has one bin per integer of the range. */
export function labelsIn({ counts }, [low]) {
  return counts.map((count, i) => ({ label: low + i, count })).filter(({ label, count }) => count > 0 && label >= 0);
}

/** scene.labels.visible after label n was shown or hidden; null if all are visible. @param all labels that occur */
export function toggled(visible, all, n, show) {
  const now = new Set(visible ?? all);
  if (show) now.add(n);
  else now.delete(n);
  return all.every((label) => now.has(label)) ? null : [...now].sort((a, b) => a - b);
}

/**
 * The labels whose voxels belong to a label: itself and the combinations that contain it.
 * @param named of GET /v1/volumes/ID
 */
export function familyOf(named, label) {
  const together = named.filter(({ of }) => of?.includes(label)).map((item) => item.label);
  return [label, ...together];
}

export class Labels {
  #get;
  #store;
  #volumes;
  #on;
  #main = ''; // id of the volume shown
  #listed = ''; // id of the label volume whose labels are listed
  #all = [];
  #doubted = ''; // id of the label volume that was refused
  #named = []; // names of the labels, if the volume has them
  #rows = new Map(); // label -> {eye, swatch}
  #palette = [[1, 1, 1]];

  /** get(id); on: failed(error) */
  constructor(get, store, volumes, on) {
    this.#get = get;
    this.#store = store;
    this.#volumes = volumes;
    this.#on = on;
    const menu = get('labels-volume');
    menu.addEventListener('change', () => this.#choose(menu.value));
    menu.addEventListener('focus', () => this.#refresh());
    get('labels-insist').addEventListener('click', () => this.#choose(this.#doubted, true));
    get('labels-all').addEventListener('click', () => this.#store.patch({ labels: { visible: null } }));
    get('labels-none').addEventListener('click', () => this.#store.patch({ labels: { visible: [] } }));
    store.subscribe(() => this.update());
  }

  /** Colours the daemon gives to labels without one. */
  setPalette(palette) {
    if (palette?.length) this.#palette = palette;
  }

  setVolume(id) {
    this.#main = id;
    this.#get('labels-doubt').hidden = true;
    this.#refresh();
  }

  update() {
    const chosen = this.#store.scene?.labels?.volume ?? '';
    if (chosen !== this.#listed) this.#list(chosen);
    const menu = this.#get('labels-volume');
    if (chosen && ![...menu.options].some(({ value }) => value === chosen)) menu.add(new Option(chosen));
    menu.value = chosen;
    this.#get('labels-body').hidden = !chosen;
    for (const [label, { eye, swatch }] of this.#rows) {
      const shown = this.#shown(label);
      eye.setAttribute('aria-pressed', shown);
      eye.textContent = shown ? 'Shown' : 'Hidden';
      if (swatch && document.activeElement !== swatch) swatch.value = toHex(this.#color(label));
    }
  }

  nameOf(label) {
    return this.#named.find((item) => item.label === label)?.name || (label ? `Label ${label}` : 'No label');
  }

  #shown(label) {
    const visible = this.#store.scene?.labels?.visible;
    return !visible || visible.includes(label);
  }

  #color(label) {
    const own = this.#named.find((item) => item.label === label)?.color;
    return this.#store.scene?.labels?.colors?.[label] ?? own ?? this.#palette[(label - 1) % this.#palette.length];
  }

  async #refresh() {
    try {
      const list = await this.#volumes.list();
      const fit = list.filter(({ id, type, state }) => id !== this.#main && type !== 'f32' && state !== 'failed');
      this.#get('labels-volume').replaceChildren(new Option('None', ''), ...fit.map(({ id }) => new Option(id)));
      this.update();
    } catch (error) {
      this.#on.failed(error);
    }
  }

  /** The daemon refused a volume as labels, with a reason. @returns whether the patch was ours */
  refused(error, patch) {
    if (error.status !== 409 || !patch?.labels?.volume) return false;
    this.#doubted = patch.labels.volume;
    this.#get('labels-doubt').hidden = false;
    const why = error.message.replace(/^labels\/volume: (.*?)(: choose.*)?$/, '$1'); // the rest is for API clients
    this.#get('labels-why').textContent = `${this.#doubted} does not look like labels of this volume: ${why}.`;
    return true;
  }

  async #choose(id, force = null) {
    this.#get('labels-doubt').hidden = true;
    try {
      if (id) await this.#volumes.bring(id, () => {});
      this.#store.patch({ labels: { volume: id || null, visible: null, force } });
    } catch (error) {
      this.#on.failed(error);
      this.update();
    }
  }

  async #list(id) {
    this.#listed = id;
    this.#rows.clear();
    this.#get('labels-list').replaceChildren();
    if (!id) return;
    try {
      const volume = await this.#volumes.get(id);
      const [low, high] = volume.range;
      const found = labelsIn(await this.#volumes.histogram(id, high - low + 1), volume.range);
      if (this.#listed !== id) return;
      const voxel = volume.spacing.reduce((a, b) => a * b, 0.001); // ml
      this.#all = found.map(({ label }) => label);
      this.#named = volume.labels ?? [];
      this.#get('labels-list').replaceChildren(
        ...this.#segments(found)
          .slice(0, MOST)
          .map((item) => this.#row(item, voxel)),
      );
      this.update();
    } catch (error) {
      this.#on.failed(error);
    }
  }

  // One row per segment: voxels of a combination count for each of its segments.
  #segments(found) {
    const counts = new Map(found.map(({ label, count }) => [label, count]));
    const combined = new Set(this.#named.filter(({ of }) => of).map(({ label }) => label));
    const single = [...new Set([...counts.keys(), ...this.#named.map(({ label }) => label)])].filter(
      (label) => !combined.has(label),
    );
    const sum = (label) => familyOf(this.#named, label).reduce((all, one) => all + (counts.get(one) ?? 0), 0);
    return single
      .sort((a, b) => a - b)
      .map((label) => ({ label, count: sum(label) }))
      .filter(({ count }) => count > 0);
  }

  // Shows or hides a segment: a combination is visible while one of its segments is.
  #toggle(label, show) {
    let visible = toggled(this.#store.scene.labels?.visible, this.#all, label, show);
    const shown = (one) => !visible || visible.includes(one);
    for (const { label: together, of } of this.#named.filter((item) => item.of?.includes(label))) {
      visible = toggled(visible, this.#all, together, of.some(shown));
    }
    this.#store.patch({ labels: { visible } });
  }

  #row({ label, count }, voxel) {
    const element = (name, properties) => Object.assign(document.createElement(name), properties);
    const name = this.nameOf(label);
    const eye = element('button', { ariaLabel: `Show ${name.toLowerCase()}` });
    eye.addEventListener('click', () => this.#toggle(label, !this.#shown(label)));
    const swatch = label ? element('input', { type: 'color', ariaLabel: `Colour of ${name.toLowerCase()}` }) : null;
    swatch?.addEventListener('input', () => {
      const alpha = this.#color(label)[3] ?? 1;
      this.#store.patch({ labels: { colors: { [label]: [...fromHex(swatch.value), alpha] } } });
    });
    const ml = count * voxel;
    const size = element('output', { textContent: `${ml >= 100 ? ml.toFixed(0) : Number(ml.toPrecision(2))} ml` });
    const row = element('li', {});
    row.append(swatch ?? element('span', {}), element('span', { textContent: name }), size, eye);
    this.#rows.set(label, { eye, swatch });
    return row;
  }
}
