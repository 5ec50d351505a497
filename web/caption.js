// Annotations of the picture on the canvas: edge letters, cube, scale bar, words. All come from the drawn frame and the
// part of the scene in its header, never from the scene being edited. So a picture that is late, or the last one before
// the connection broke, keeps its own annotations and says that it is not current.

import { dot, letters, sliceBasis, spanAtTarget, volumeBox } from './camera.js';
import { sliceEnds, sliceHeight, sliceStep } from './steer.js';
import { placeText } from './units.js';

const MOST_NAMES = 4; // surfaces named in a line
const LATE_MS = 1500; // an edit without a picture after this time is announced

const number = (value) => String(Number(value.toPrecision(4)));

/**
 * mm per CSS pixel, 0 in perspective.
 * @param size {width, height} of the picture
 * @param stage of its element, CSS px
 */
export function pictureScale(scene, size, stage, box) {
  const shownHeight = Math.min(stage.height, (stage.width * size.height) / size.width); // the whole picture is visible
  if (scene.mode === 'mpr') return sliceHeight(scene, size, box) / shownHeight;
  return scene.camera.projection === 'orthographic' ? spanAtTarget(scene.camera) / shownHeight : 0;
}

/**
 * Position of a slice in the stack of its direction.
 * @returns {{index: number, count: number, step: number, axis: number[]}} index from 0, may be a fraction; step in mm
 *   along the unit vector `axis`
 */
export function slicePosition(mpr, volume) {
  const box = volumeBox(volume);
  const { direction } = sliceBasis(mpr);
  const step = sliceStep(volume, direction);
  const [low, high] = sliceEnds(box, direction);
  const at = dot(mpr.center ?? box.center, direction);
  return { index: (at - low) / step, count: Math.round((high - low) / step) + 1, step, axis: direction };
}

/** "H 12.5 mm": distance and side of a plane through `point` from the origin; "LH" for an oblique plane. */
function planePlace(point, axis, extent) {
  const along = dot(point, axis);
  return `${letters(along < 0 ? axis.map((x) => -x) : axis)} ${placeText(Math.abs(along), extent)} mm`;
}

/** "Slab 12.5 mm" if two planes face each other, as for a projection through a slab. */
function slabLine(planes) {
  if (planes?.length !== 2 || dot(planes[0], planes[1]) > -0.999) return '';
  return `Slab ${number(planes[0][3] + planes[1][3])} mm`;
}

/** What the surfaces show: a list, all labels, or one value. */
function surfaceLine({ isosurface, labels, mesh }, unit) {
  const list = (mesh?.surfaces ?? []).filter(({ visible }) => visible !== false);
  const names = list.map(({ value, label, mesh: id, plane }) => {
    if (value !== undefined) return number(value) + unit;
    return id ?? (plane ? `${plane} slice` : `label ${label}`);
  });
  const rest = names.length > MOST_NAMES ? `, ${names.length - MOST_NAMES} more` : '';
  if (mesh?.surfaces.length) return `Surfaces: ${names.slice(0, MOST_NAMES).join(', ') || 'none'}${rest}`;
  if (labels?.volume) return `Surfaces of ${labels.volume}`;
  return isosurface && `Surface at ${number(isosurface.value)}${unit}`;
}

const SLABS = { mip: 'maximum', minip: 'minimum', average: 'average' };

function sliceLines(mpr, volume) {
  const { index, count, axis } = slicePosition(mpr, volume);
  const box = volumeBox(volume);
  const shown = Math.min(count, Math.max(1, Math.round(index) + 1));
  const slab = mpr.thickness > 0 && `Slab ${number(mpr.thickness)} mm \u00b7 ${SLABS[mpr.projection]}`;
  return [`Slice ${shown} / ${count} \u00b7 ${planePlace(mpr.center ?? box.center, axis, 2 * box.radius)}`, slab];
}

/** Lines that describe the picture. titles: mode(name), preset(name), plane(name) */
export function captionLines(scene, volume, titles) {
  const { id = '', modality = '', unit = '', frames = 1 } = volume;
  const part = frames > 1 && `Volume ${volume.volume} of ${frames}`;
  const window = scene.window && `C ${number(scene.window.center)}  W ${number(scene.window.width)}`;
  const surface = surfaceLine(scene, unit && ` ${unit}`);
  const voxels = scene.splat && `Voxels ${scene.splat.threshold.map(number).join(' to ')}${unit && ` ${unit}`}`;
  const preset = scene.mode === 'dvr' && titles.preset(scene.transferFunction?.preset);
  const plane = scene.mpr && titles.plane(scene.mpr.orientation);
  const kind = [modality, titles.mode(scene.mode), plane].filter(Boolean).join(' \u00b7 ');
  const slab = slabLine(scene.clip?.planes);
  return [volume.of ?? id, part, kind, preset, window, surface, voxels, slab, ...(scene.mpr ? sliceLines(scene.mpr, volume) : [])].filter(
    Boolean,
  );
}

export class Caption {
  #get;
  #furniture;
  #titles;
  #header = null; // of the frame on the canvas
  #drawnAt = null;
  #volume = null;
  #open = false;
  #pending = 0;
  #timer = 0;

  constructor(get, furniture, titles) {
    this.#get = get;
    this.#furniture = furniture;
    this.#titles = titles;
  }

  /** The scene members and the size of the picture on the canvas; null before the first one. */
  get scene() {
    return this.#header?.scene ?? null;
  }

  /** Whether the picture shows every edit. */
  get current() {
    return this.#header !== null && this.#pending === 0;
  }

  get size() {
    return this.#header;
  }

  /**
   * Position of a point of the stage (CSS px) in the picture, as fractions of its sides from the top left; null
   * outside.
   */
  placeOf(x, y) {
    const { clientWidth, clientHeight } = this.#get('stage');
    const { width, height } = this.size;
    const scale = Math.min(clientWidth / width, clientHeight / height);
    const place = [0.5 + (x - clientWidth / 2) / (width * scale), 0.5 + (y - clientHeight / 2) / (height * scale)];
    return place.every((share) => share >= 0 && share < 1) ? place : null;
  }

  /** Another volume of the same file, which the next picture shows. */
  set volume(volume) {
    this.#volume = volume;
    this.update();
  }

  /** Another volume, without a picture yet. */
  clear(volume) {
    this.#volume = volume;
    this.#header = null;
    this.update();
  }

  drawn(header) {
    this.#header = header;
    this.#drawnAt = new Date();
    this.#wait();
    this.update();
  }

  connection({ state }) {
    this.#open = state === 'open';
    this.#state();
  }

  /** Number of edits without a picture so far. */
  pending(count) {
    const began = count > 0 && this.#pending === 0;
    this.#pending = count;
    if (began || !count) this.#wait();
  }

  /** Call after the stage changed its size. */
  update() {
    const stage = this.#get('stage');
    stage.classList.toggle('bare', !this.#header);
    this.#state();
    if (!this.#header) return;
    const { scene } = this;
    const size = { width: stage.clientWidth, height: Math.max(1, stage.clientHeight) };
    this.#furniture.update(scene, pictureScale(scene, this.#header, size, volumeBox(this.#volume)));
    this.#get('label').textContent = captionLines(scene, this.#volume, this.#titles).join('\n');
    const { background } = scene.image;
    const light = Array.isArray(background) && background[0] + background[1] + background[2] > 1.8;
    stage.classList.toggle('light', light); // dark annotations on a light background
  }

  #wait() {
    clearTimeout(this.#timer);
    this.#timer = this.#pending ? setTimeout(() => this.#state(true), LATE_MS) : 0;
    this.#state();
  }

  #state(late = false) {
    const time = this.#drawnAt?.toLocaleTimeString();
    const words = this.#open
      ? late && 'NOT CURRENT \u00b7 a newer picture is on its way'
      : `NOT LIVE \u00b7 picture of ${time}`;
    const shown = this.#header && words;
    this.#get('stale').hidden = !shown;
    this.#get('stale').textContent = shown || '';
    this.#get('stage').classList.toggle('stale', Boolean(shown));
  }
}
