// Wires the parts of the page together; the logic is in the parts.

import { linked, linkIn, TokenDialog } from './access.js';
import { Actions } from './actions.js';
import { Address } from './address.js';
import { Api } from './api.js';
import { Bindings } from './bindings.js';
import { BindingsPanel } from './bindings_panel.js';
import { Building } from './building.js';
import { Client } from './client.js';
import { withProjection } from './camera.js';
import { Caption } from './caption.js';
import { Furniture } from './furniture.js';
import { History } from './history.js';
import { Input, NO_MOVEMENT } from './input.js';
import { Keys } from './keys.js';
import { Labels } from './labels.js';
import { Suggestion } from './suggestion.js';
import { Lights } from './lights.js';
import { Surfaces } from './surfaces.js';
import { Look } from './look.js';
import { Modes } from './modes.js';
import { Notices } from './notices.js';
import { LocalNames } from './local_names.js';
import { Opening } from './opening.js';
import { bindTabs, CropPanel, Panels } from './panels.js';
import { Probe } from './probe.js';
import { QualityPanel } from './quality.js';
import { saveFile, SceneDialog } from './scene_dialog.js';
import { Sequence } from './sequence.js';
import { SliceSlider } from './slices.js';
import { SceneStore } from './state.js';
import { Status } from './status.js';
import { slicePixels, steer } from './steer.js';
import { lengthsText } from './units.js';
import { formatBytes, VolumeDialog, Volumes } from './volumes.js';
import { pictureSize, View } from './view.js';

const DEFAULT_MAX_PIXELS = 1500000;
const RESIZE_REST_MS = 150;

const get = (id) => document.getElementById(id);
const stage = get('stage');
const store = new SceneStore();
const api = new Api();
const tokenDialog = new TokenDialog(get);
api.ask = (wrong) => tokenDialog.ask(wrong);
const volumes = new Volumes(api);
const names = new LocalNames();
const notices = new Notices(
  {
    toasts: get('toasts'),
    banner: get('banner'),
    bannerText: get('banner-text'),
    bannerRetry: get('banner-retry'),
    line: get('mode-line'),
  },
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
    size: wantedSize,
    session: showSession,
    connection: showConnection,
    viewOnly() {
      notices.line('For looking only: what you change here is not kept.');
      sequence.forbid();
    },
    frame: showFrame,
    pending: showPending,
    building: (message) => building.show(message),
    problem: refused,
    beforeFlush: applyMovement,
  },
});
const edits = new History(store, {
  changed() {
    get('undo').disabled = !edits.canUndo;
    get('redo').disabled = !edits.canRedo;
  },
});
const building = new Building(get, () => {
  client.cancel();
  edits.undo();
});
const modes = new Modes();
const gesture = (on) => {
  if (on) edits.hold(true);
  client.active(on); // ends after the gesture's last movement
  if (!on) edits.hold(false);
};
const look = new Look(get, store, gesture);
const panels = new Panels(document, store, { gesture, mode: chooseMode });
const sessionPlan = () => api.json('GET', `v1/sessions/${encodeURIComponent(client.session)}/plan`).catch(() => ({}));
const quality = new QualityPanel(get, store, { gesture, plan: sessionPlan });
const suggestion = new Suggestion(get, store, { plan: sessionPlan, take: chooseMode });
const crop = new CropPanel(get('crop'), get('crop-reset'), store, gesture);
const labels = new Labels(get, store, volumes, { failed });
const surfaces = new Surfaces(get, store, gesture);
new Lights(get, store, gesture);
const furniture = new Furniture(
  {
    top: get('mark-top'),
    bottom: get('mark-bottom'),
    left: get('mark-left'),
    right: get('mark-right'),
    cube: get('cube'),
    bar: get('scale-bar'),
    barLabel: get('scale-label'),
  },
  (letter) => actions.do('view', letter),
);
const caption = new Caption(get, furniture, {
  mode: (mode) => titleIn(get('mode'), mode),
  preset: (name) => titleIn(get('preset'), name ?? ''),
  plane: (plane) => titleIn(document.querySelector('[data-path="mpr.orientation"]'), plane),
});
const bindings = new Bindings();
const input = new Input(stage, bindings, {
  mode: () => store.scene?.mode,
  wake: () => store.scene && client.flushSoon(),
  active: gesture,
  click: (x, y) => probe.tell(x, y),
  doubleClick: (x, y) => probe.centre(x, y),
  slicePixels: () => slicePixels(store.scene, stageSize(), opening.volume, opening.box),
});
const volumeDialog = new VolumeDialog(
  { dialog: get('volume-dialog'), list: get('volume-list'), filter: get('volume-filter') },
  volumes,
  {
    choose: (id) => opening.open(id),
    problem: failed,
    nameOf: (volume) => names.of(volume),
  },
);
const address = new Address(store, { open: (id, asked) => opening.open(id, { view: asked }) });
const opening = new Opening({
  get,
  api,
  client,
  store,
  volumes,
  names,
  on: {
    shown: showVolume,
    opened: (id, how) => address.opened(id, how),
    failed,
    toast: (text, options) => notices.toast(text, options),
    size: wantedSize,
    aspect: () => stage.clientWidth / Math.max(1, stage.clientHeight),
  },
});
const sequence = new Sequence(get, {
  volumes,
  client,
  on: { shown: showAnother, problem: (error) => notices.problem(error), note: (text) => notices.toast(text) },
});
const probe = new Probe({
  api,
  client,
  store,
  shown: () => ({ volume: opening.volume, box: opening.box, caption, pixels: wantedSize() }),
  labelName: (label) => labels.nameOf(label),
  on: { text: (text) => (get('probe').textContent = text), problem: (error) => notices.problem(error) },
});
const actions = new Actions({
  store,
  stage,
  buttons: { cine: get('cine'), invert: get('invert'), fullscreen: get('fullscreen') },
  gesture,
  look,
  history: edits,
  move,
  shown: () => opening,
  sequence,
  help: () => get('help-dialog').showModal(),
});
const slices = new SliceSlider(get('slice'), store, { shown: () => opening, gesture });
new Keys(bindings, { mode: () => store.scene?.mode, gesture, do: (name, argument) => actions.do(name, argument) });
new BindingsPanel(get('bindings'), get('bindings-reset'), bindings);
const sceneDialog = new SceneDialog(get, {
  scene: () => store.scene,
  load: loadScene,
  share: async (role) => address.attach(await client.share(role)),
  toast: (text) => notices.toast(text),
});

let opened = null; // the menu opened by pointer
let maxPixels = Number(localStorage.getItem('tomocast.maxPixels')) || DEFAULT_MAX_PIXELS;

/* --- volumes ----------------------------------------------------------------------------------- */

function showVolume(volume, box, histogram) {
  edits.clear();
  view.clear(); // never show the old picture under the new volume's name
  get('badge').hidden = true;
  const range = volume.range ?? [0, 1];
  look.setVolume(histogram, range, volume);
  modes.setVolume(volume.display, box);
  get('hide-table').hidden = !volume.display?.table;
  panels.setVolume(range, Math.min(...box.high.map((end, k) => end - box.low[k])));
  panels.setModel(volume.model);
  crop.setBox(box);
  labels.setVolume(volume.id);
  surfaces.setVolume(range);
  get('volume-name').textContent = volume.id;
  get('volume-file').textContent = names.of(volume);
  get('volume-meta').textContent = volume.dims.join(' \u00d7 ');
  get('probe').textContent = '';
  get('empty').hidden = true;
  document.title = `${volume.id} \u2013 Tomocast`;
  showFacts(volume, box);
  caption.clear(volume);
  slices.update();
  showControls();
  sequence.setVolume(volume);
  if (linkIn(location.hash).token || linked(api.token).session) sequence.forbid();
}

/** Another volume of the same file: keeps the settings. */
function showAnother(volume) {
  opening.another(volume);
  get('probe').textContent = '';
  showFacts(volume, opening.box);
  caption.volume = volume;
}

const titleIn = (menu, value) => [...menu.options].find((option) => option.value === value)?.text ?? value;

const unitOf = (volume) => (volume?.unit ? ` ${volume.unit}` : '');

function showFacts(volume, box) {
  const unit = unitOf(volume);
  const rows = {
    Name: volume.id,
    File: names.of(volume),
    Series: [volume.description, volume.time].filter(Boolean).join(' \u00b7 '),
    Modality: volume.modality,
    Colour: volume.colors && 'in slices; elsewhere its brightness',
    Voxels: volume.dims.join(' \u00d7 '),
    Spacing: lengthsText(volume.spacing, { digits: 4 }),
    Extent: lengthsText(
      box.high.map((end, k) => end - box.low[k]),
      { least: 1 },
    ),
    Values: volume.range && `${volume.range.map((v) => Number(v.toPrecision(6))).join(' to ')}${unit}`,
    Type: volume.type,
    Memory: formatBytes(volume.bytes),
    Volume: volume.frames > 1 && `${volume.volume} of ${volume.frames}`,
    Slices: volume.slices && `${volume.slices.used} of ${volume.slices.found}`,
    Note: volume.note,
  };
  const entries = Object.entries(rows).filter(([, text]) => text);
  const element = (name, text) => Object.assign(document.createElement(name), { textContent: text });
  get('facts').replaceChildren(...entries.flatMap(([name, text]) => [element('dt', name), element('dd', text)]));
}

/* --- session, frames, refusals ------------------------------------------------------------------ */

function showSession({ id }) {
  stage.dataset.session = id;
  stage.dataset.final = false;
}

function showConnection(state) {
  notices.connection(state);
  if (state.state === 'closed' && state.reason) notices.toast(state.reason, { title: 'Disconnected', bad: true });
  status.connection(state);
  caption.connection(state);
}

function showPending(count) {
  stage.dataset.pending = count;
  caption.pending(count);
}

function showFrame(drawn) {
  sequence.frame(drawn.header);
  building.done();
  caption.drawn(drawn.header);
  status.frame(drawn);
  surfaces.measured(drawn.header.error);
  quality.frame(drawn.header);
  suggestion.frame(drawn.header);
  stage.dataset.frame = drawn.header.frame;
  stage.dataset.seq = drawn.header.seq;
  stage.dataset.final = drawn.header.final;
  get('empty').hidden = true;
  if (drawn.header.final) volumes.thumbnail(opening.volume); // rendered now, after the picture, for later lists
}

function withholdMeter() {
  get('meter').disabled = true;
  get('meter').labels[0].title = 'Not in this version of the daemon';
}

/** The daemon refused a patch. Choices that it does not offer are reported once and removed from the controls. */
function refused(error, patch) {
  building.done();
  if (labels.refused(error, patch)) return;
  if (error.status !== 501 || !patch) {
    notices.problem(error);
    return;
  }
  panels.withdraw(patch);
  if (patch.errorMeter) withholdMeter();
  notices.line(error.message);
}

/** file: the name of the file concerned, as the user knows it */
function failed(error, file = '') {
  const words = names.inText(error.message);
  error.message = words.includes(file) ? words : `${file}: ${words}`;
  notices.problem(error);
  if (!client.session) {
    showEmpty(error.message);
  }
}

/** Shows instructions on the stage while there is no volume. */
function showEmpty(text) {
  get('empty-text').textContent = text;
  get('empty').hidden = false;
}

function chooseMode(mode) {
  notices.line('');
  store.patch(modes.choose(store.scene, mode));
}

async function loadScene(scene) {
  const before = store.scene;
  await client.putScene(scene);
  edits.add(before, store.scene);
}

/* --- view --------------------------------------------------------------------------------------- */

function wantedSize() {
  return pictureSize(stage.clientWidth, stage.clientHeight, window.devicePixelRatio || 1, maxPixels);
}

function resize() {
  client.resize();
  caption.update();
}

const stageSize = () => ({ width: stage.clientWidth, height: Math.max(1, stage.clientHeight) });

/** Called once per display frame, before the patch is sent. */
function applyMovement() {
  const moved = input.drain();
  if (moved) move(moved);
}

function move(moved) {
  if (!store.scene || !opening.box) return;
  const patch = steer(store.scene, { ...NO_MOVEMENT, ...moved }, stageSize(), opening.volume, opening.box);
  if (patch) store.patch(patch);
}

/** Updates the controls outside the panels from the edited scene. */
function showControls() {
  const { scene } = store;
  const ready = Boolean(scene?.camera && opening.box);
  for (const part of document.querySelectorAll('[data-needs-scene]')) part.inert = !ready;
  if (!ready) return;
  get('projection').value = scene.camera.projection;
  get('fov-field').hidden = scene.camera.projection !== 'perspective';
  const background = Array.isArray(scene.image?.background) ? scene.image.background : [0, 0, 0];
  get('background').value = background.map((c) => Number(c.toFixed(2))).join(',');
  get('meter').checked = (scene.errorMeter?.pixels ?? 0) > 0;
}

async function savePicture() {
  if (!client.session) return;
  get('save').disabled = true;
  const { width, height } = wantedSize();
  try {
    const frame = `v1/sessions/${encodeURIComponent(client.session)}/frame`;
    const reply = await api.fetch('GET', `${frame}?format=png&width=${width}&height=${height}`);
    saveFile(await actions.shown(await reply.blob()), `${opening.volume?.id ?? 'picture'}.png`);
  } catch (error) {
    notices.problem(error);
  } finally {
    get('save').disabled = false;
  }
}

/* --- wiring ------------------------------------------------------------------------------------- */

function bindControls() {
  bindTabs(get('panel'));
  store.subscribe(showControls);
  for (const id of ['volume-open', 'empty-open'])
    get(id).addEventListener('click', () => volumeDialog.open(opening.id));
  get('help-open').addEventListener('click', () => get('help-dialog').showModal());
  get('scene-open').addEventListener('click', () => store.scene && sceneDialog.open());
  get('save').addEventListener('click', savePicture);
  for (const name of ['reset', 'undo', 'redo']) get(name).addEventListener('click', () => actions.do(name));
  document.addEventListener('pointerdown', ({ target }) => (opened = target.closest('select')));
  document.addEventListener('change', ({ target }) => {
    if (target === opened) stage.focus({ preventScroll: true }); // keys act on the picture again
    opened = null;
  });
  for (const button of document.querySelectorAll('button[data-view]')) {
    button.addEventListener('click', () => actions.do('view', button.dataset.view));
  }
  for (const button of document.querySelectorAll('[data-close]')) {
    button.addEventListener('click', () => button.closest('dialog').close());
  }
  get('upload').addEventListener('change', () => {
    const files = [...get('upload').files];
    get('upload').value = '';
    get('volume-dialog').close();
    opening.upload(files);
  });
  for (const button of document.querySelectorAll('[data-opens]')) {
    button.addEventListener('click', () => get(button.dataset.opens).click());
  }
  get('projection').addEventListener('change', () =>
    store.patch({ camera: withProjection(store.scene.camera, get('projection').value) }),
  );
  get('background').addEventListener('change', () =>
    store.patch({ image: { background: get('background').value.split(',').map(Number) } }),
  );
  get('meter').addEventListener('change', () => store.patch({ errorMeter: { pixels: get('meter').checked ? 64 : 0 } }));
  get('max-pixels').value = String(maxPixels);
  get('max-pixels').addEventListener('change', () => {
    maxPixels = Number(get('max-pixels').value);
    localStorage.setItem('tomocast.maxPixels', maxPixels);
    resize();
  });
}

function bindWindow() {
  let timer = 0;
  new ResizeObserver(() => {
    clearTimeout(timer);
    timer = setTimeout(resize, RESIZE_REST_MS);
    caption.update();
  }).observe(stage);
  window.addEventListener('online', () => client.retryNow());
  window.addEventListener('hashchange', () => {
    if (linkIn(location.hash).token) {
      client.leave();
      takeLink();
      location.reload();
    }
  });
  window.addEventListener('pagehide', (event) => {
    if (event.persisted) return;
    address.flush();
    opening.keep();
    client.leave();
  });
}

/** Moves a share link's token from the address to the tab; keeps the view in the address. */
function takeLink() {
  const { token, rest } = linkIn(location.hash);
  if (!token) return;
  api.token = token;
  history.replaceState(null, '', location.pathname + (rest && `#${rest}`));
}

async function askAbout() {
  const [about, presets] = await Promise.all([api.json('GET', 'v1/about'), api.json('GET', 'v1/presets')]);
  status.server([about.name, about.version, about.backend, about.device].filter(Boolean).join(' \u00b7 '));
  look.setPresets(presets);
  labels.setPalette(presets.labelColors);
  panels.withhold(about.unavailable);
  if (about.unavailable?.['errorMeter.pixels']) withholdMeter();
}

async function start() {
  takeLink();
  try {
    const [found] = await Promise.all([opening.fromAddress(location), askAbout()]); // menus must not delay the picture
    if (!found) {
      showEmpty('No volume is open.');
      volumeDialog.open();
    }
  } catch (error) {
    failed(error);
  }
}

bindControls();
bindWindow();
opening.bindDrops();
start();
