// The volumes of the daemon: list, load, upload; and the dialog that lists them.

import { Problem } from './api.js';
import { lengthsText } from './units.js';

const POLL_MS = 400;
const KINDS = ['.nii', '.hdr', '.nrrd', '.nhdr', '.mha', '.mhd', '.mgh', '.mgz', '.par', '.mnc', '.png', '.tif', '.tiff', '.zip', '.dcm', '.vmd'];
const SUFFIXES = KINDS.flatMap((end) => [`${end}.gz`, `${end}.bz2`, end]);

// A folder or a zip may hold series; any other file is one volume.
const mayHoldSeries = (path) =>
  !path.startsWith('demo:') && (/\.zip$/i.test(path) || !SUFFIXES.some((end) => path.toLowerCase().endsWith(end)));

const MESH = /\.(obj|ply|stl)(\.gz|\.bz2)?$/i;
export const isMesh = ({ name }) => MESH.test(name);

/**
 * One list from the reply of GET /v1/volumes, resident ones first. Available files have a path and the id to load as.
 */
export function volumeList({ volumes = [], available = [] }) {
  const known = new Set(volumes.map(({ id }) => id));
  const ids = idsFor(available.map(({ path }) => path));
  const rest = available.map((item, i) => ({ ...item, id: ids[i], state: 'available' }));
  return [...volumes, ...rest.filter(({ id }) => !known.has(id))];
}

/**
 * Ids for paths of the data folder, in the characters an id may have: the file's name without suffix; if two files
 * share it, with suffix; if they share that too, with their folders.
 */
export function idsFor(paths) {
  const names = paths.map((path) =>
    path
      .replace(/^demo:/, '')
      .split('/')
      .filter(Boolean),
  );
  const choices = [
    names.map((parts) => slug(withoutSuffix(parts.at(-1) ?? ''))),
    names.map((parts) => slug(parts.at(-1) ?? '')),
    names.map((parts) => slug(parts.join('-'))),
  ];
  const unique = (list, id) => list.indexOf(id) === list.lastIndexOf(id);
  return paths.map((_, i) => (choices.find((list) => unique(list, list[i])) ?? choices[2])[i]);
}

function withoutSuffix(name) {
  const suffix = SUFFIXES.find((end) => name.toLowerCase().endsWith(end) && name.length > end.length) ?? '';
  return name.slice(0, name.length - suffix.length);
}

const slug = (text) =>
  text
    .replace(/[^A-Za-z0-9_-]+/g, '-')
    .replace(/^-+|-+$/g, '')
    .slice(-60) || 'volume';

/** The next free upload id. Not the file's name, which often is the patient's: ids appear in addresses and logs. */
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

/** "256 × 256 × 225 · 0.9 × 0.9 × 1 mm · int16 · 29.5 MB", as far as known. */
export function describe({ dims, spacing, type, bytes }) {
  const parts = [];
  if (dims) parts.push(dims.join(' \u00d7 '));
  if (spacing) parts.push(lengthsText(spacing));
  if (type) parts.push(type);
  if (bytes) parts.push(formatBytes(bytes));
  return parts.join(' \u00b7 ');
}

/** "Thorax 1.0 · CT · 131 images · 14:03:22": a series in a radiologist's terms. */
export function seriesText({ description, label, modality, frames, time, patient }) {
  const images = frames ? `${frames} image${frames === 1 ? '' : 's'}` : '';
  return [description || label, modality, images, time, patient].filter(Boolean).join(' \u00b7 ');
}

/** The choices for a path: {id, path, text} of each volume of each series. */
export function choicesOf({ id, path }, series) {
  return series.flatMap((one) =>
    one.volumes.map(({ number, slices, what }) => ({
      id: `${id}-${one.number}${one.volumes.length > 1 ? `-${number}` : ''}`,
      path: `${path}#${one.number}${one.volumes.length > 1 ? `#volume=${number}` : ''}`,
      text: [seriesText(one), one.volumes.length > 1 && `${slices} slices`, what].filter(Boolean).join(' \u00b7 '),
    })),
  );
}

export class Volumes {
  #api;
  #thumbnails = new Map(); // key of a volume -> promise of its picture's URL

  constructor(api) {
    this.#api = api;
  }

  async list() {
    return volumeList(await this.#api.json('GET', 'v1/volumes'));
  }

  /**
   * Ids in use. kind: 'volumes', or 'meshes', whose ids must differ from those of volumes too, since LocalNames keeps
   * both in one list.
   */
  async taken(kind) {
    const { meshes } = kind === 'meshes' ? await this.#api.json('GET', 'v1/meshes') : { meshes: [] };
    return new Set([...(await this.list()), ...meshes].map(({ id }) => id));
  }

  get(id, kind = 'volumes') {
    return this.#api.json('GET', `v1/${kind}/${encodeURIComponent(id)}`);
  }

  /** The series of a folder or zip of DICOM. */
  async series(path) {
    return (await this.#api.json('GET', `v1/series?path=${encodeURIComponent(path)}`)).series;
  }

  load(id, path) {
    return this.#api.json('POST', 'v1/volumes', { json: { id, path } });
  }

  histogram(id, bins = 192) {
    return this.#api.json('GET', `v1/volumes/${encodeURIComponent(id)}/histogram?bins=${bins}`);
  }

  /** The thumbnail of a volume, fetched once per page; empty if there is none. */
  thumbnail({ id, bytes, range }) {
    const key = `${id} ${bytes} ${range}`; // an id may be reused for another volume
    const picture = Object.assign(new Image(96, 96), { className: 'thumbnail', alt: '' });
    if (!this.#thumbnails.has(key)) {
      const path = `v1/volumes/${encodeURIComponent(id)}/thumbnail`;
      const made = this.#api.fetch('GET', path).then(async (reply) => URL.createObjectURL(await reply.blob()));
      made.catch(() => this.#thumbnails.delete(key));
      this.#thumbnails.set(key, made);
    }
    this.#thumbnails.get(key).then(
      (url) => (picture.src = url),
      () => (picture.hidden = true),
    );
    return picture;
  }

  /** Loads a volume, whatever its state. onProgress(fraction or undefined). @returns its description */
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

  async wait(id, onProgress, signal, volume = null, kind = 'volumes') {
    for (;;) {
      volume ??= await this.get(id, kind);
      if (!volume.state || volume.state === 'resident') return volume.dims ? volume : this.get(id, kind);
      if (volume.state === 'failed') throw new Problem(422, { detail: `${id}: ${volume.reason ?? 'loading failed'}` });
      onProgress(volume.fraction);
      await new Promise((resolve) => setTimeout(resolve, POLL_MS));
      if (signal?.aborted) throw new DOMException('cancelled', 'AbortError');
      volume = null;
    }
  }

  /** Loads another volume from the file of the resident volume `of`. */
  another(id, of, volume) {
    return this.#api.json('POST', 'v1/volumes', { json: { id, of, volume } });
  }

  upload(id, file, onProgress, kind = 'volumes') {
    return this.#api.upload(`v1/${kind}/${encodeURIComponent(id)}`, file, onProgress);
  }

  remove(id) {
    return this.#api.fetch('DELETE', `v1/volumes/${encodeURIComponent(id)}`);
  }

  async #load(id, failed) {
    const found = (await this.list()).find((item) => item.id === id && item.path);
    if (found) return this.load(id, found.path);
    if (failed) return failed;
    throw new Problem(404, { detail: `there is no volume "${id}" here` });
  }
}

/** The dialog with the list and a search field. on: choose(id), problem(error), nameOf(volume) in this tab */
export class VolumeDialog {
  #dialog;
  #list;
  #filter;
  #volumes;
  #on;
  #items = [];
  #current = '';
  #timer = 0;

  constructor({ dialog, list, filter }, volumes, on) {
    this.#dialog = dialog;
    this.#list = list;
    this.#filter = filter;
    this.#volumes = volumes;
    this.#on = on;
    dialog.addEventListener('close', () => clearTimeout(this.#timer));
    filter.addEventListener('input', () => this.#show());
    filter.addEventListener('keydown', ({ key }) => key === 'Enter' && list.querySelector('button')?.click());
    dialog.addEventListener('keydown', (event) => this.#walk(event));
  }

  async open(current = '') {
    this.#current = current;
    this.#filter.value = '';
    if (!this.#dialog.open) this.#dialog.showModal();
    this.#filter.focus();
    await this.#refresh();
  }

  close() {
    this.#dialog.close();
  }

  // Arrow keys move between the search field and the list.
  #walk(event) {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!step) return;
    const stops = [this.#filter, ...this.#list.querySelectorAll('.volume-item')];
    const next = stops[stops.indexOf(document.activeElement) + step];
    if (!next || !stops.includes(document.activeElement)) return;
    next.focus();
    event.preventDefault();
  }

  async #refresh() {
    try {
      this.#items = await this.#volumes.list();
    } catch (error) {
      this.#on.problem(error);
      return;
    }
    this.#show();
    const loading = this.#items.some(({ state }) => state === 'loading');
    if (this.#dialog.open && loading) this.#timer = setTimeout(() => this.#refresh(), POLL_MS);
  }

  #show() {
    const wanted = this.#filter.value.toLowerCase();
    const text = (item) => [item.id, item.path, item.modality, this.#on.nameOf(item)].join(' ');
    const fits = (item) => text(item).toLowerCase().includes(wanted);
    const focused = document.activeElement?.dataset?.id;
    const ids = new Set(this.#items.map(({ id }) => id));
    const first = ({ of }) => !ids.has(of); // the other volumes of its file are chosen with the slider
    this.#list.replaceChildren(...this.#items.filter((item) => first(item) && fits(item)).map((item) => this.#item(item)));
    if (!this.#items.length) this.#list.append('No volume yet. Upload one, or start the server with a data folder.');
    [...this.#list.querySelectorAll('.volume-item')].find(({ dataset }) => dataset.id === focused)?.focus();
  }

  #item(item) {
    const button = document.createElement('button');
    button.className = 'volume-item';
    button.dataset.id = item.id;
    if (item.id === this.#current) button.setAttribute('aria-current', 'true');
    const part = (name, text) => Object.assign(document.createElement('span'), { className: name, textContent: text });
    const known = item.state === 'failed' ? [item.reason] : [item.path, item.description, item.time, describe(item)];
    const line = [this.#on.nameOf(item), ...known].filter(Boolean).join(' \u00b7 ');
    button.append(part('name', item.id), part('state', [item.modality, item.state].filter(Boolean).join(' \u00b7 ')));
    button.append(part('facts-line', line));
    if (item.state === 'loading') button.append(progressBar(item.fraction));
    if (item.state === 'resident') button.prepend(this.#volumes.thumbnail(item));
    button.addEventListener('click', () => this.#choose(item));
    return item.state === 'failed' ? this.#removable(item, button) : button;
  }

  async #choose(item) {
    const several = item.state === 'available' && mayHoldSeries(item.path) ? await this.#choicesOf(item) : [];
    if (several.length > 1) {
      this.#list.replaceChildren(...several.map((choice) => this.#choice(choice)));
      this.#list.querySelector('button').focus();
      return;
    }
    this.close();
    this.#on.choose(item.id);
  }

  // A folder without a list is loaded, which reports its error.
  async #choicesOf(item) {
    try {
      return choicesOf(item, await this.#volumes.series(item.path));
    } catch {
      return [];
    }
  }

  #choice({ id, path, text }) {
    const part = (name, words) =>
      Object.assign(document.createElement('span'), { className: name, textContent: words });
    const button = Object.assign(document.createElement('button'), { className: 'volume-item' });
    button.append(part('name', text), part('facts-line', path));
    button.addEventListener('click', async () => {
      try {
        if (!this.#items.some((item) => item.id === id && item.state !== 'available'))
          await this.#volumes.load(id, path);
        this.close();
        this.#on.choose(id);
      } catch (error) {
        this.#on.problem(error);
      }
    });
    return button;
  }

  #removable({ id }, button) {
    const row = Object.assign(document.createElement('div'), { className: 'volume-row' });
    const remove = Object.assign(document.createElement('button'), {
      textContent: 'Remove',
      ariaLabel: `Remove ${id}`,
    });
    remove.addEventListener('click', async () => {
      await this.#volumes.remove(id).catch(this.#on.problem);
      this.#filter.focus();
      await this.#refresh();
    });
    row.append(button, remove);
    return row;
  }
}

function progressBar(fraction) {
  const bar = document.createElement('progress');
  bar.max = 1;
  if (fraction !== undefined) bar.value = fraction;
  return bar;
}
