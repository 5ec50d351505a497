// The page's address: a volume and a view of it after the #, "#head&mode=mpr&mpr.center=0,0,12". Browsers do not send
// the part after the # to servers. Tokens are removed from it as soon as they are read.

import { contextOf } from './bindings.js';
import { patchFor, valueAt } from './panels.js';
import { joinPatches } from './state.js';
import { fromHex, toHex } from './transfer_model.js';

const REST_MS = 300; // browsers limit how often a page may change its address
const CAMERA = ['projection', 'position', 'target', 'up', 'fovY', 'height'].map((name) => `camera.${name}`);
const PLANE = ['orientation', 'center', 'normal', 'up', 'zoom', 'thickness', 'projection'].map((name) => `mpr.${name}`);
const WINDOW = ['window.center', 'window.width'];
const SHADING = ['model', 'gradient', 'ambient', 'diffuse', 'specular', 'shininess'].map((name) => `shading.${name}`);
const LABELS = ['volume', 'opacity', 'visible', 'colors'].map((name) => `labels.${name}`);
const SURFACES = ['surfaces', 'lights'].map((name) => `mesh.${name}`);
const SPLATS = ['threshold', 'attribute', 'kernelRadius', 'opaque'].map((name) => `splat.${name}`);
const CLIP = ['clip.box', 'clip.planes'];
const VIEW = {
  volume: [...CAMERA, 'transferFunction.preset', 'hideTable', ...SHADING],
  own: [...CAMERA, 'transferFunction.points', 'transferFunction.unitDistance', 'hideTable', ...SHADING], // no preset
  surface: [...CAMERA, 'isosurface.value', 'isosurface.color', ...SHADING],
  splat: [...CAMERA, ...SPLATS, 'isosurface.color', ...SHADING],
  projection: [...CAMERA, ...WINDOW],
  slices: [...PLANE, ...WINDOW],
};
const WITHIN = 'mesh.withVolume';
const EVERY = new Set(['mode', ...Object.values(VIEW).flat(), ...LABELS, ...CLIP, WITHIN, ...SURFACES]);
const MOST_KNOTS = 64; // a longer list is left out of the address
const MOST_TEXT = 4000; // characters of a list of objects

const short = (number) => Number(Number(number.toPrecision(7)).toFixed(6)); // to a nanometre
const written = (value) =>
  [value].flat().map((part) => (typeof part === 'number' ? short(part) : encodeURIComponent(part)));

/** Lists of objects or lists are JSON; '' if the text is too long. */
const isDeep = (value) => Array.isArray(value) && typeof value[0] === 'object';
function deepText(value) {
  const text = encodeURIComponent(JSON.stringify(value, (_, part) => (typeof part === 'number' ? short(part) : part)));
  return text.length > MOST_TEXT ? '' : text;
}
function readDeep(text) {
  try {
    const value = JSON.parse(text);
    return isDeep(value) ? value : undefined;
  } catch {
    return undefined;
  }
}

/** Lists of more than plain numbers: "-400:ff8000:o0.2" is a knot, "3:ff0000:1" a label's colour and alpha. */
const LISTS = {
  'transferFunction.points': {
    write: (points) =>
      points.map(({ value, color, opacity, extinction }) =>
        [short(value), toHex(color).slice(1), opacity === undefined ? `e${short(extinction)}` : `o${short(opacity)}`].join(':'),
      ),
    read: (items) =>
      items.map(([value, color, amount]) => ({
        value: Number(value),
        color: fromHex(`#${color}`),
        [amount[0] === 'e' ? 'extinction' : 'opacity']: Number(amount.slice(1)),
      })),
  },
  'labels.colors': {
    write: (colors) =>
      Object.entries(colors).map(([label, color]) => [label, toHex(color.slice(0, 3)).slice(1), short(color[3] ?? 1)].join(':')),
    read: (items) => Object.fromEntries(items.map(([label, color, alpha]) => [label, [...fromHex(`#${color}`), Number(alpha)]])),
  },
};

const viewOf = ({ mode, transferFunction }) => {
  if (mode === 'isosurface' || mode === 'mesh') return 'surface';
  if (mode === 'splat') return mode;
  const { preset, points = [] } = transferFunction ?? {};
  const own = contextOf(mode) === 'volume' && !preset && points.length > 0 && points.length <= MOST_KNOTS;
  return own ? 'own' : contextOf(mode);
};

/** "&mode=mip&camera.position=0,-400,0...": the view of a scene */
export function viewText(scene) {
  const surfaces = scene.mode === 'mesh' ? SURFACES : scene.mesh?.withVolume ? [WITHIN, ...SURFACES] : [];
  const paths = ['mode', ...VIEW[viewOf(scene)], ...(scene.labels?.volume ? LABELS : []), ...surfaces, ...CLIP];
  return paths.map((path) => memberText(path, valueAt(scene, path))).join('');
}

function memberText(path, value) {
  if ((value ?? '') === '') return '';
  if (LISTS[path]) return `&${path}=${LISTS[path].write(value).join(',') || 'none'}`;
  const text = isDeep(value) ? deepText(value) : written(value).join(',');
  if (text === '' && path !== 'labels.visible') return ''; // an empty list
  return `&${path}=${text || 'none'}`;
}

const decoded = (text) => {
  try {
    return decodeURIComponent(text);
  } catch {
    return ''; // an invalid % sequence
  }
};

const WORDS = { true: true, false: false };

/** @returns the value of a member, undefined if invalid */
function read(path, text) {
  if (path === 'labels.visible' && text === 'none') return [];
  if (decoded(text)[0] === '[') return readDeep(decoded(text));
  const parts = text.split(',').map(decoded);
  if (LISTS[path]) {
    const items = parts.map((part) => part.split(':'));
    return items.every((item) => item.length === 3 && /^[0-9a-f]{6}$/.test(item[1])) ? LISTS[path].read(items) : undefined;
  }
  const values = parts.map((part) => WORDS[part] ?? (/^[-+.\d][-+.\de]*$/i.test(part) ? Number(part) : part));
  return values.length > 1 || path === 'labels.visible' ? values : values[0];
}

/**
 * Parses an address's hash.
 * @returns {{volume: string, view: object|null}} the volume, and the members of the scene in the hash
 */
export function readHash(hash) {
  const [first, ...rest] = hash.slice(1).split('&');
  let view = null;
  for (const member of rest) {
    const [path, text] = member.split('=');
    const value = EVERY.has(path) && text ? read(path, text) : undefined;
    if (value !== undefined) view = joinPatches(view ?? {}, patchFor({}, path, value));
  }
  return { volume: first.includes('=') ? '' : decoded(first), view }; // "share=..." is not a volume
}

export class Address {
  #store;
  #on;
  #volume = ''; // the volume shown
  #fresh = ''; // the view as the volume opened, which the short address represents
  #timer = 0;

  /** on: open(volume, view) when the address names another volume */
  constructor(store, on) {
    this.#store = store;
    this.#on = on;
    store.subscribe(() => this.#soon());
    addEventListener('hashchange', () => this.#went());
  }

  /** A volume is shown, with its default view or that of the address. joined: in another user's session */
  opened(volume, { joined }) {
    const { volume: before, view } = readHash(location.hash);
    const push = before && before !== volume && !joined;
    this.#volume = volume;
    this.#fresh = view && before === volume ? '' : viewText(this.#store.scene);
    const search = joined ? location.search : '';
    const hash = joined && !before ? '' : this.#hash();
    history[push ? 'pushState' : 'replaceState'](null, '', location.pathname + search + hash);
  }

  /** Writes a pending change of the address now. */
  flush() {
    clearTimeout(this.#timer);
    this.#timer = 0;
    if (!this.#volume || !this.#store.scene) return;
    const named = readHash(location.hash).volume;
    const hash = this.#hash();
    if ((named && named !== this.#volume) || hash === location.hash) return; // another volume is being opened
    if (!named && viewText(this.#store.scene) === this.#fresh) return;
    history.replaceState(null, '', location.pathname + location.search + hash);
  }

  /** Adds the view to a link to a session, so that the link still opens that view after the session has ended. */
  attach(link) {
    const url = new URL(link);
    const view = encodeURIComponent(this.#volume) + viewText(this.#store.scene);
    url.hash = url.hash ? `${url.hash}&${view}` : view;
    return url.href;
  }

  #hash() {
    const view = viewText(this.#store.scene);
    return `#${encodeURIComponent(this.#volume)}${view === this.#fresh ? '' : view}`;
  }

  #soon() {
    if (!this.#timer && this.#volume) this.#timer = setTimeout(() => this.flush(), REST_MS);
  }

  // Back, forward, or an edited address.
  #went() {
    clearTimeout(this.#timer);
    this.#timer = 0;
    const { volume, view } = readHash(location.hash);
    if (volume && volume !== this.#volume) this.#on.open(volume, view);
    else if (volume && view) this.#store.patch(view);
  }
}
