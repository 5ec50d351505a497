// The volumes of the daemon: list, load, upload; and the dialog that shows them.

import { Problem } from './api.js';

const POLL_MS = 400;
const SUFFIXES = ['.nii.gz', '.nii', '.nrrd', '.mha', '.zip', '.dcm', '.vmd'];

/** One list out of the reply of GET /v1/volumes, resident first. */
export function volumeList(reply) {
  const named = (state) => (item) => (typeof item === 'string' ? { id: item, path: item, state } : { state, ...item });
  const resident = (reply.volumes ?? reply.resident ?? []).map(named('resident'));
  const known = new Set(resident.map(({ id }) => id));
  const available = (reply.available ?? [])
    .map(named('available'))
    .map((item) => ({ ...item, id: item.id ?? idFor(item.path) }))
    .filter(({ id }) => !known.has(id));
  return [...resident, ...available];
}

/** An id for a path of the data folder: its last part without suffix, in the characters an id may have. */
export function idFor(path) {
  const name = path.replace(/^demo:/, '').split('/').filter(Boolean).at(-1) ?? 'volume';
  const suffix = SUFFIXES.find((end) => name.toLowerCase().endsWith(end)) ?? '';
  const id = name.slice(0, name.length - suffix.length).replace(/[^A-Za-z0-9_-]+/g, '-').replace(/^-+|-+$/g, '');
  return id.slice(0, 60) || 'volume';
}

/** The next free upload id. Never the file's name: that often is the patient's, and ids go into addresses and logs. */
export function uploadId(taken) {
  let n = 1;
  while (taken.has(`upload-${n}`)) n += 1;
  return `upload-${n}`;
}

export function formatBytes(bytes) {
  if (bytes === undefined) return '';
  const units = ['B', 'kB', 'MB', 'GB'];
  const power = Math.min(3, Math.floor(Math.log10(Math.max(1, bytes)) / 3));
  return `${Number((bytes / 1000 ** power).toPrecision(3))} ${units[power]}`;
}

/** "256 × 256 × 225 · 0.9 × 0.9 × 1 mm · int16 · 29.5 MB" as far as it is known. */
export function describe({ dims, spacing, type, bytes }) {
  const parts = [];
  if (dims) parts.push(dims.join(' \u00d7 '));
  if (spacing) parts.push(`${spacing.map((mm) => Number(mm.toPrecision(3))).join(' \u00d7 ')} mm`);
  if (type) parts.push(type);
  if (bytes) parts.push(formatBytes(bytes));
  return parts.join(' \u00b7 ');
}

export class Volumes {
  #api;

  constructor(api) {
    this.#api = api;
  }

  async list() {
    return volumeList(await this.#api.json('GET', 'v1/volumes'));
  }

  get(id) {
    return this.#api.json('GET', `v1/volumes/${encodeURIComponent(id)}`);
  }

  histogram(id, bins = 512) {
    return this.#api.json('GET', `v1/volumes/${encodeURIComponent(id)}/histogram?bins=${bins}`);
  }

  /** Has a volume loaded, whatever its state is now. @param onProgress fraction or undefined @returns its description */
  async bring(id, onProgress, signal) {
    let volume;
    try {
      volume = await this.get(id);
    } catch (error) {
      if (error.status !== 404) throw error;
    }
    if (!volume || volume.state === 'failed') volume = await this.#load(id, volume);
    return this.wait(id, onProgress, signal, volume);
  }

  async wait(id, onProgress, signal, volume = null) {
    for (;;) {
      volume ??= await this.get(id);
      if (!volume.state || volume.state === 'resident') return volume.dims ? volume : this.get(id);
      if (volume.state === 'failed') throw new Problem(422, { detail: `${id}: ${volume.reason ?? 'loading failed'}` });
      onProgress(volume.fraction);
      await new Promise((resolve) => setTimeout(resolve, POLL_MS));
      if (signal?.aborted) throw new DOMException('cancelled', 'AbortError');
      volume = null;
    }
  }

  upload(id, file, onProgress) {
    return this.#api.upload(`v1/volumes/${encodeURIComponent(id)}`, file, onProgress);
  }

  async #load(id, failed) {
    const found = (await this.list()).find((item) => item.id === id && item.path);
    if (found) return this.#api.json('POST', 'v1/volumes', { json: { id, path: found.path } });
    if (failed) return failed;
    throw new Problem(404, { detail: `there is no volume "${id}" here` });
  }
}

/** Shows the list; onChoose(id). */
export class VolumeDialog {
  #dialog;
  #list;
  #volumes;
  #onChoose;
  #onProblem;
  #timer = 0;

  constructor(dialog, list, volumes, { choose, problem }) {
    this.#dialog = dialog;
    this.#list = list;
    this.#volumes = volumes;
    this.#onChoose = choose;
    this.#onProblem = problem;
    dialog.addEventListener('close', () => clearTimeout(this.#timer));
  }

  async open(current) {
    if (!this.#dialog.open) this.#dialog.showModal();
    await this.#refresh(current);
  }

  close() {
    this.#dialog.close();
  }

  async #refresh(current) {
    let items;
    try {
      items = await this.#volumes.list();
    } catch (error) {
      this.#onProblem(error);
      return;
    }
    const focused = document.activeElement?.dataset?.id;
    this.#list.replaceChildren(...items.map((item) => this.#item(item, current)));
    if (!items.length) this.#list.append('No volume yet. Upload one, or start the server with a data folder.');
    [...this.#list.children].find((element) => focused && element.dataset?.id === focused)?.focus();
    if (this.#dialog.open && items.some(({ state }) => state === 'loading')) {
      this.#timer = setTimeout(() => this.#refresh(current), POLL_MS);
    }
  }

  #item(item, current) {
    const button = document.createElement('button');
    button.className = 'volume-item';
    button.dataset.id = item.id;
    if (item.id === current) button.setAttribute('aria-current', 'true');
    const part = (name, text) => Object.assign(document.createElement('span'), { className: name, textContent: text });
    const state = item.state === 'failed' ? 'failed' : item.state;
    const line = item.state === 'failed' ? item.reason ?? '' : describe(item) || (item.path !== item.id && item.path) || '';
    button.append(part('name', item.title ?? item.id), part('state', [item.modality, state].filter(Boolean).join(' \u00b7 ')));
    button.append(part('facts-line', line));
    if (item.state === 'loading') {
      const bar = document.createElement('progress');
      bar.max = 1;
      if (item.fraction !== undefined) bar.value = item.fraction;
      button.append(bar);
    }
    button.addEventListener('click', () => {
      this.close();
      this.#onChoose(item.id);
    });
    return button;
  }
}
