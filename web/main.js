// Wires the parts of the page together. Decisions live in the parts.

import { Api } from './api.js';
import { Client } from './client.js';
import { fit, spanAtTarget, standardView, STANDARD_VIEWS, volumeBox, withProjection } from './camera.js';
import { Furniture } from './furniture.js';
import { Input } from './input.js';
import { Look } from './look.js';
import { Notices } from './notices.js';
import { bindTabs, CropPanel, Panels } from './panels.js';
import { saveFile, SceneDialog } from './scene_dialog.js';
import { SceneStore } from './state.js';
import { Status } from './status.js';
import { sliceHeight, steer, steerByKey } from './steer.js';
import { formatBytes, uploadId, VolumeDialog, Volumes } from './volumes.js';
import { pictureSize, View } from './view.js';

const DEFAULT_MAX_PIXELS = 1500000;
const RESIZE_REST_MS = 150;
const KEY_REST_MS = 150; // keys have ended after this much rest
const KEPT_SCENE = 'tomocast.scene'; // sessionStorage: survives a reload of this tab, nothing else

const get = (id) => document.getElementById(id);
const stage = get('stage');
const store = new SceneStore();
const api = new Api();
const volumes = new Volumes(api);
const notices = new Notices(
  { toasts: get('toasts'), banner: get('banner'), bannerText: get('banner-text'), bannerRetry: get('banner-retry'), line: get('mode-line') },
  () => client.retryNow(),
);
const status = new Status((name) => get(`stat-${name}`), get('badge'));
const view = new View(get('picture'), {
  onDraw: (drawn) => client.drawn(drawn),
  onAck: (frame) => client.acknowledge(frame),
  onError: (error) => notices.problem(error),
});
const client = new Client({
  api,
  store,
  view,
  on: {
    session: showSession,
    connection: showConnection,
    frame: showFrame,
    problem: refused,
    beforeFlush: applyMovement,
  },
});
const gesture = (on) => client.active(on);
const look = new Look(get, store, gesture);
const panels = new Panels(document, store, { gesture, mode: chooseMode });
const crop = new CropPanel(get('crop'), get('crop-reset'), store, gesture);
const furniture = new Furniture(
  {
    top: get('mark-top'), bottom: get('mark-bottom'), left: get('mark-left'), right: get('mark-right'),
    cube: get('cube'), bar: get('scale-bar'), barLabel: get('scale-label'),
  },
  (letter) => turnTo(letter),
);
const input = new Input(stage, {
  mode: () => store.scene?.mode,
  wake: () => store.scene && client.flushSoon(),
  active: gesture,
  click: probe,
});
const volumeDialog = new VolumeDialog(get('volume-dialog'), get('volume-list'), volumes, {
  choose: (id) => openVolume(id),
  problem: failed,
});
const sceneDialog = new SceneDialog(get, {
  scene: () => store.scene,
  load: (scene) => client.putScene(scene),
  share: () => client.share(),
  toast: (text) => notices.toast(text),
});

let volume = null; // description of the one that is shown
let box = null;
let wanted = null; // AbortController of a load under way
let lastGoodMode = 'dvr';
let maxPixels = Number(localStorage.getItem('tomocast.maxPixels')) || DEFAULT_MAX_PIXELS;

/* --- volumes ----------------------------------------------------------------------------------- */

async function openVolume(id, scene = null) {
  wanted?.abort();
  const abort = (wanted = new AbortController());
  get('empty').hidden = true;
  try {
    showLoading(`Loading ${id}`);
    const found = await volumes.bring(id, (fraction) => showLoading(`Loading ${id}`, fraction), abort.signal);
    if (abort.signal.aborted) return;
    await showVolume(found);
    await client.create(id, { ...(scene ?? {}), image: { ...(scene?.image ?? {}), ...wantedSize() } });
    if (!scene) store.patch({ camera: fit(store.scene.camera, box, stageAspect()) });
    history.replaceState(null, '', `#${encodeURIComponent(id)}`);
  } catch (error) {
    if (error.name !== 'AbortError') failed(error);
  } finally {
    if (wanted === abort) hideLoading();
  }
}

async function joinSession(id) {
  try {
    const { volume: name } = await api.json('GET', `v1/sessions/${encodeURIComponent(id)}`);
    await showVolume(await volumes.wait(name, (fraction) => showLoading(`Loading ${name}`, fraction)));
    await client.join(id);
  } catch (error) {
    failed(error);
  } finally {
    hideLoading();
  }
}

async function showVolume(found) {
  volume = found;
  box = volumeBox(found);
  const range = found.range ?? [0, 1];
  const histogram = await volumes.histogram(found.id).catch(() => null);
  look.setVolume(histogram && histogramOf(histogram), range, found.modality ?? '');
  panels.setVolume(range);
  crop.setBox(box);
  get('volume-name').textContent = found.title ?? found.id;
  get('volume-meta').textContent = found.dims ? found.dims.join(' \u00d7 ') : '';
  get('probe').textContent = '';
  document.title = `${found.id} \u2013 Tomocast`;
  showFacts();
}

/** Counts and edges, whether the edges come one by one or as a range. */
function histogramOf({ counts, edges, range }) {
  if (edges?.length === counts.length + 1) return { counts, edges };
  const [low, high] = range ?? volume.range;
  return { counts, edges: Array.from({ length: counts.length + 1 }, (_, i) => low + ((high - low) * i) / counts.length) };
}

function showFacts() {
  const unit = volume.modality === 'CT' ? ' HU' : '';
  const rows = {
    Name: volume.id,
    Modality: volume.modality,
    Voxels: volume.dims?.join(' \u00d7 '),
    Spacing: volume.spacing && `${volume.spacing.map((mm) => Number(mm.toPrecision(4))).join(' \u00d7 ')} mm`,
    Extent: `${box.high.map((end, k) => (end - box.low[k]).toFixed(0)).join(' \u00d7 ')} mm`,
    Values: volume.range && `${volume.range.map((v) => Number(v.toPrecision(6))).join(' to ')}${unit}`,
    Type: volume.type,
    Memory: formatBytes(volume.bytes),
  };
  const entries = Object.entries(rows).filter(([, text]) => text);
  const element = (name, text) => Object.assign(document.createElement(name), { textContent: text });
  get('facts').replaceChildren(...entries.flatMap(([name, text]) => [element('dt', name), element('dd', text)]));
}

async function upload(file) {
  const taken = new Set((await volumes.list().catch(() => [])).map(({ id }) => id));
  const id = uploadId(taken);
  const transfer = volumes.upload(id, file, (fraction) => showLoading(`Uploading ${formatBytes(file.size)}`, fraction));
  get('loading-cancel').hidden = false;
  get('loading-cancel').onclick = () => transfer.cancel();
  showLoading(`Uploading ${formatBytes(file.size)}`, 0);
  try {
    await transfer.done;
    get('loading-cancel').hidden = true;
    await openVolume(id);
  } catch (error) {
    if (error.name === 'AbortError') notices.toast('Upload cancelled.');
    else failed(error);
  } finally {
    hideLoading();
  }
}

function showLoading(text, fraction) {
  get('loading').hidden = false;
  get('loading-text').textContent = text;
  if (fraction === undefined || fraction === null) get('loading-bar').removeAttribute('value');
  else get('loading-bar').value = fraction;
}

function hideLoading() {
  get('loading').hidden = true;
  get('loading-cancel').hidden = true;
}

/* --- session, frames, refusals ------------------------------------------------------------------ */

function showSession({ id }) {
  stage.dataset.session = id; // for tests and for people who look
}

function showConnection(state) {
  notices.connection(state);
  status.connection(state);
}

function showFrame(drawn) {
  status.frame(drawn);
  stage.dataset.frame = drawn.header.frame;
  stage.dataset.seq = drawn.header.seq;
  stage.dataset.final = drawn.header.final;
  hideEmpty();
  if (drawn.header.final && store.scene) lastGoodMode = store.scene.mode;
}

function hideEmpty() {
  get('empty').hidden = true;
}

/** The daemon refused a patch. What it does not offer is said once and quietly, and no longer offered. */
function refused(error, patch) {
  if (error.status === 501 && patch?.mode) {
    const option = get('mode').querySelector(`option[value="${patch.mode}"]`);
    if (option) option.disabled = true;
    notices.line(error.message);
    if (store.scene.mode === patch.mode) store.patch({ mode: lastGoodMode });
    return;
  }
  notices.problem(error);
}

function failed(error) {
  if (error.status === 401) {
    askToken();
    return;
  }
  notices.problem(error);
  if (!client.session) {
    get('empty').textContent = error.message;
    get('empty').hidden = false;
  }
}

function askToken() {
  const dialog = get('token-dialog');
  dialog.addEventListener('close', () => {
    api.token = get('token').value;
    start();
  }, { once: true });
  if (!dialog.open) dialog.showModal();
}

function chooseMode(mode) {
  notices.line('');
  store.patch({ mode });
}

/* --- view --------------------------------------------------------------------------------------- */

const stageAspect = () => stage.clientWidth / Math.max(1, stage.clientHeight);

function wantedSize() {
  return pictureSize(stage.clientWidth, stage.clientHeight, window.devicePixelRatio || 1, maxPixels);
}

function resize() {
  if (!store.scene) return;
  const { width, height } = wantedSize();
  if (store.scene.image?.width !== width || store.scene.image?.height !== height) store.patch({ image: { width, height } });
  showFurniture();
}

/** Called once per display frame, before the patch is sent. */
function applyMovement() {
  const moved = input.drain();
  if (!moved || !store.scene) return;
  const size = { width: stage.clientWidth, height: stage.clientHeight };
  const patch = steer(store.scene, moved, size, volume, box);
  if (patch) store.patch(patch);
}

function turnTo(letter) {
  if (!store.scene) return;
  if (store.scene.mode === 'mpr') {
    const orientation = { A: 'coronal', P: 'coronal', L: 'sagittal', R: 'sagittal', H: 'axial', F: 'axial' }[letter];
    store.patch({ mpr: { orientation } });
  } else {
    store.patch({ camera: standardView(store.scene.camera, letter) });
  }
}

function resetView() {
  if (!store.scene || !box) return;
  if (store.scene.mode === 'mpr') store.patch({ mpr: { center: box.center, zoom: 1 } });
  else store.patch({ camera: fit(standardView(store.scene.camera, 'A'), box, stageAspect()) });
}

/** mm of a CSS pixel, 0 in perspective. The picture's height is the stage's height: both have one aspect. */
function scaleOfPicture() {
  const { scene } = store;
  if (scene.mode === 'mpr') return sliceHeight(scene, { width: stage.clientWidth, height: stage.clientHeight }, box) / stage.clientHeight;
  return scene.camera.projection === 'orthographic' ? spanAtTarget(scene.camera) / stage.clientHeight : 0;
}

function showFurniture() {
  const { scene } = store;
  if (!scene?.camera) return;
  furniture.update(scene, scaleOfPicture());
  const mode = get('mode').selectedOptions[0]?.textContent ?? scene.mode;
  const detail = scene.mode === 'dvr' ? presetTitle() : scene.window && windowText(scene.window);
  get('label').textContent = [volume?.id, [volume?.modality, mode].filter(Boolean).join(' \u00b7 '), detail].filter(Boolean).join('\n');
  get('projection').value = scene.camera.projection;
  get('fov-field').hidden = scene.camera.projection !== 'perspective';
  get('background').value = [].concat(scene.image?.background ?? [0, 0, 0]).map((c) => Number(Number(c).toFixed(2))).join(',');
  get('meter').checked = (scene.errorMeter?.pixels ?? 0) > 0;
}

const presetTitle = () => get('preset').selectedOptions[0]?.textContent ?? '';
const windowText = ({ center, width }) => `C ${Number(center.toPrecision(4))}  W ${Number(width.toPrecision(4))}`;

/** A click asks the daemon what is there: position in the patient, and the value. */
async function probe(x, y) {
  if (!client.session || !store.scene) return;
  const { width, height } = store.scene.image;
  const px = Math.min(width - 1, Math.max(0, Math.floor((x / stage.clientWidth) * width)));
  const py = Math.min(height - 1, Math.max(0, Math.floor((y / stage.clientHeight) * height)));
  try {
    const found = await api.json('GET', `v1/sessions/${encodeURIComponent(client.session)}/pick?x=${px}&y=${py}`);
    get('probe').textContent = probeText(found);
  } catch (error) {
    get('probe').textContent = '';
    if (error.status !== 404 && error.status !== 501) notices.problem(error);
  }
}

function probeText(found) {
  if (!found?.position) return '';
  const [x, y, z] = found.position;
  const side = (value, plus, minus) => `${value >= 0 ? plus : minus} ${Math.abs(value).toFixed(1)}`;
  const unit = volume?.modality === 'CT' ? ' HU' : '';
  const value = found.value === undefined ? '' : `  \u00b7  ${Number(found.value.toPrecision(5))}${unit}`;
  return `${side(x, 'L', 'R')}  ${side(y, 'P', 'A')}  ${side(z, 'H', 'F')} mm${value}`;
}

async function savePicture() {
  if (!client.session) return;
  get('save').disabled = true;
  try {
    const reply = await api.fetch('GET', `v1/sessions/${encodeURIComponent(client.session)}/frame?format=png`);
    saveFile(await reply.blob(), `${volume?.id ?? 'picture'}.png`);
  } catch (error) {
    notices.problem(error);
  } finally {
    get('save').disabled = false;
  }
}

/* --- keys --------------------------------------------------------------------------------------- */

let keyTimer = 0;

/** Keys come in bursts: the daemon may be coarse until they rest. */
function keyGesture() {
  if (!keyTimer) gesture(true);
  clearTimeout(keyTimer);
  keyTimer = setTimeout(() => {
    keyTimer = 0;
    gesture(false);
  }, KEY_REST_MS);
}

function onKey(event) {
  if (document.querySelector('dialog[open]')) return;
  if ((event.ctrlKey || event.metaKey) && !event.altKey) {
    undoKey(event);
    return;
  }
  if (event.altKey || !store.scene || event.target.matches('input, select, textarea, [role="tab"]')) return;
  if (pictureKey(event)) event.preventDefault();
}

function undoKey(event) {
  const key = event.key.toLowerCase();
  if (event.target.matches('textarea, input[type="number"]') || (key !== 'z' && key !== 'y')) return;
  if (key === 'y' || event.shiftKey) look.redo();
  else look.undo();
  event.preventDefault();
}

function pictureKey(event) {
  const letter = event.key.toUpperCase();
  if (event.key === '?') get('help-dialog').showModal();
  else if (event.key === ' ') return event.target.matches('button, [role="button"]') ? false : (resetView(), true);
  else if (/^[1-9]$/.test(event.key)) look.choose(Number(event.key) - 1);
  else if (STANDARD_VIEWS[letter] && event.key.length === 1) turnTo(letter);
  else return turnByKey(event);
  return true;
}

function turnByKey(event) {
  const { scene } = store;
  if (scene.mode === 'mpr') return sliceByKey(event.key);
  const turned = steerByKey(scene.camera, event.key, event.shiftKey);
  if (!turned) return false;
  keyGesture();
  store.patch({ camera: turned });
  return true;
}

function sliceByKey(key) {
  const step = { ArrowUp: -1, ArrowDown: 1, PageUp: -10, PageDown: 10 }[key];
  const factor = { '+': 1.15, '=': 1.15, '-': 1 / 1.15 }[key];
  if (!step && !factor) return false;
  keyGesture();
  const moved = { orbit: [0, 0], pan: [0, 0], window: [0, 0], roll: 0, factor: factor ?? 1, slices: step ?? 0 };
  store.patch(steer(store.scene, moved, { width: stage.clientWidth, height: stage.clientHeight }, volume, box));
  return true;
}

/* --- wiring ------------------------------------------------------------------------------------- */

function bindControls() {
  bindTabs(get('panel'));
  store.subscribe(showFurniture);
  get('volume-open').addEventListener('click', () => volumeDialog.open(volume?.id));
  get('help-open').addEventListener('click', () => get('help-dialog').showModal());
  get('scene-open').addEventListener('click', () => store.scene && sceneDialog.open());
  get('save').addEventListener('click', savePicture);
  get('reset').addEventListener('click', resetView);
  for (const button of document.querySelectorAll('button[data-view]')) {
    button.addEventListener('click', () => turnTo(button.dataset.view));
  }
  for (const button of document.querySelectorAll('[data-close]')) {
    button.addEventListener('click', () => button.closest('dialog').close());
  }
  for (const label of document.querySelectorAll('label.button')) {
    label.addEventListener('keydown', ({ key }) => (key === 'Enter' || key === ' ') && label.click());
  }
  get('projection').addEventListener('change', () =>
    store.patch({ camera: withProjection(store.scene.camera, get('projection').value) }));
  get('background').addEventListener('change', () =>
    store.patch({ image: { background: get('background').value.split(',').map(Number) } }));
  get('meter').addEventListener('change', () => store.patch({ errorMeter: { pixels: get('meter').checked ? 64 : 0 } }));
  get('max-pixels').value = String(maxPixels);
  get('max-pixels').addEventListener('change', () => {
    maxPixels = Number(get('max-pixels').value);
    localStorage.setItem('tomocast.maxPixels', maxPixels);
    resize();
  });
}

function bindWindow() {
  window.addEventListener('keydown', onKey);
  let timer = 0;
  new ResizeObserver(() => {
    clearTimeout(timer);
    timer = setTimeout(resize, RESIZE_REST_MS);
    showFurniture();
  }).observe(stage);
  window.addEventListener('hashchange', () => {
    const id = decodeURIComponent(location.hash.slice(1));
    if (id && id !== volume?.id) openVolume(id);
  });
  window.addEventListener('pagehide', (event) => {
    if (event.persisted) return;
    if (store.scene && volume) sessionStorage.setItem(KEPT_SCENE, JSON.stringify({ volume: volume.id, scene: store.scene }));
    client.leave();
  });
}

function bindDrops() {
  let depth = 0; // dragenter and dragleave also come for every child
  const show = (on) => (get('drop').hidden = !on);
  const files = (event) => event.dataTransfer?.types.includes('Files');
  window.addEventListener('dragenter', (event) => files(event) && show((depth += 1) > 0));
  window.addEventListener('dragleave', (event) => files(event) && show((depth = Math.max(0, depth - 1)) > 0));
  window.addEventListener('dragover', (event) => files(event) && event.preventDefault());
  window.addEventListener('drop', (event) => {
    if (!files(event)) return;
    event.preventDefault();
    depth = 0;
    show(false);
    if (event.dataTransfer.files.length > 1) notices.toast('One file at a time. Put DICOM files into one zip.', { bad: true });
    else if (event.dataTransfer.files.length) upload(event.dataTransfer.files[0]);
  });
  get('upload').addEventListener('change', () => {
    const [file] = get('upload').files;
    get('upload').value = '';
    volumeDialog.close();
    if (file) upload(file);
  });
}

/** The scene this tab showed before a reload, for that volume. */
function keptScene(id) {
  const kept = JSON.parse(sessionStorage.getItem(KEPT_SCENE) ?? 'null');
  sessionStorage.removeItem(KEPT_SCENE);
  return kept?.volume === id ? kept.scene : null;
}

async function start() {
  try {
    const [about, presets] = await Promise.all([api.json('GET', 'v1/about'), api.json('GET', 'v1/presets')]);
    status.server([about.name, about.version, about.backend, about.device].filter(Boolean).join(' \u00b7 '));
    look.setPresets(presets);
  } catch (error) {
    failed(error);
    return;
  }
  const session = new URLSearchParams(location.search).get('session');
  if (session) {
    joinSession(session);
    return;
  }
  const id = decodeURIComponent(location.hash.slice(1));
  if (id) openVolume(id, keptScene(id));
  else openFirst();
}

/** Without a volume in the address: the only resident one, or the list. */
async function openFirst() {
  try {
    const resident = (await volumes.list()).filter(({ state }) => state === 'resident' || state === 'loading');
    if (resident.length === 1) openVolume(resident[0].id, keptScene(resident[0].id));
    else volumeDialog.open();
  } catch (error) {
    failed(error);
  }
}

bindControls();
bindWindow();
bindDrops();
start();
