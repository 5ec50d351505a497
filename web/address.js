// The address: a volume and a view of it after the #, "#head&mode=mpr&mpr.center=0,0,12". What stands after a # is sent to
// nobody; tokens never stand there for longer than it takes to read them.

import { contextOf } from './bindings.js';
import { patchFor, valueAt } from './panels.js';
import { joinPatches } from './state.js';

const REST_MS = 300; // browsers count how often a page writes its address
const CAMERA = ['projection', 'position', 'target', 'up', 'fovY', 'height'].map((name) => `camera.${name}`);
const PLANE = ['orientation', 'center', 'normal', 'up', 'zoom', 'thickness', 'projection'].map((name) => `mpr.${name}`);
const WINDOW = ['window.center', 'window.width'];
const VIEW = {
  volume: [...CAMERA, 'transferFunction.preset'],
  surface: [...CAMERA, 'isosurface.value'],
  projection: [...CAMERA, ...WINDOW],
  slices: [...PLANE, ...WINDOW],
};
const EVERY = new Set(['mode', ...Object.values(VIEW).flat()]);

const short = (number) => Number(Number(number.toPrecision(7)).toFixed(6)); // to a nanometre
const written = (value) =>
  [value].flat().map((part) => (typeof part === 'number' ? short(part) : encodeURIComponent(part)));

/** "&mode=mip&camera.position=0,-400,0..." of what a scene is looked at with */
export function viewText(scene) {
  const surface = scene.mode === 'isosurface' || scene.mode === 'mesh';
  const paths = ['mode', ...VIEW[surface ? 'surface' : contextOf(scene.mode)]];
  const known = paths.map((path) => [path, valueAt(scene, path)]).filter(([, value]) => (value ?? '') !== '');
  return known.map(([path, value]) => `&${path}=${written(value).join(',')}`).join('');
}

const decoded = (text) => {
  try {
    return decodeURIComponent(text);
  } catch {
    return ''; // a % that encodes nothing
  }
};

function read(text) {
  const parts = text.split(',').map(decoded);
  const values = parts.map((part) => (/^[-+.\d][-+.\de]*$/i.test(part) ? Number(part) : part));
  return values.length > 1 ? values : values[0];
}

/** @returns {{volume: string, view: object|null}} what an address's hash names, and the scene's members it gives */
export function readHash(hash) {
  const [first, ...rest] = hash.slice(1).split('&');
  let view = null;
  for (const member of rest) {
    const [path, text] = member.split('=');
    if (EVERY.has(path) && text) view = joinPatches(view ?? {}, patchFor({}, path, read(text)));
  }
  return { volume: first.includes('=') ? '' : decoded(first), view }; // "share=..." is no volume
}

export class Address {
  #store;
  #on;
  #volume = ''; // what is shown
  #fresh = ''; // text of the view as the volume opened: the short address stands for it
  #timer = 0;

  /** on: open(volume, view) where the address has come to name another volume */
  constructor(store, on) {
    this.#store = store;
    this.#on = on;
    store.subscribe(() => this.#soon());
    addEventListener('hashchange', () => this.#went());
  }

  /** A volume is shown, with the view that it opens with or that the address gave. joined: in somebody's session */
  opened(volume, { joined }) {
    const { volume: before, view } = readHash(location.hash);
    const push = before && before !== volume && !joined;
    this.#volume = volume;
    this.#fresh = view && before === volume ? '' : viewText(this.#store.scene);
    const search = joined ? location.search : '';
    const hash = joined && !before ? '' : this.#hash();
    history[push ? 'pushState' : 'replaceState'](null, '', location.pathname + search + hash);
  }

  /** Writes what is still to be written. */
  flush() {
    clearTimeout(this.#timer);
    this.#timer = 0;
    if (!this.#volume || !this.#store.scene) return;
    const named = readHash(location.hash).volume;
    const hash = this.#hash();
    if ((named && named !== this.#volume) || hash === location.hash) return; // on the way to another one
    if (!named && viewText(this.#store.scene) === this.#fresh) return;
    history.replaceState(null, '', location.pathname + location.search + hash);
  }

  /** A link to a session, that opens the same view anew once the session is gone. */
  attach(link) {
    const url = new URL(link);
    if (!url.hash) url.hash = `#${encodeURIComponent(this.#volume)}${viewText(this.#store.scene)}`;
    return url.href;
  }

  #hash() {
    const view = viewText(this.#store.scene);
    return `#${encodeURIComponent(this.#volume)}${view === this.#fresh ? '' : view}`;
  }

  #soon() {
    if (!this.#timer && this.#volume) this.#timer = setTimeout(() => this.flush(), REST_MS);
  }

  // Back, forward, or another address typed.
  #went() {
    clearTimeout(this.#timer);
    this.#timer = 0;
    const { volume, view } = readHash(location.hash);
    if (volume && volume !== this.#volume) this.#on.open(volume, view);
    else if (volume && view) this.#store.patch(view);
  }
}
