import assert from 'node:assert/strict';
import { test } from 'node:test';

import { volumeBox } from '../../web/camera.js';
import { Bindings, contextOf, dragChord, keyChord, TABLE } from '../../web/bindings.js';
import { compose, Input, NO_MOVEMENT, notches, pinch, wheelFactor } from '../../web/input.js';
import { patchFor, valueAt } from '../../web/panels.js';
import { compressionRatio, errorText, fidelity, frameRate, surfaceLines } from '../../web/status.js';
import { sliceHeight, slicePlace, slicePixels, sliceStep, steer } from '../../web/steer.js';
import { pictureSize } from '../../web/view.js';
import { describe, formatBytes, idsFor, uploadId, volumeList } from '../../web/volumes.js';
import { sleep } from '../support/daemon.mjs';

const STAGE = { width: 800, height: 600 };
const VOLUME = { dims: [101, 101, 51], spacing: [1, 1, 2], origin: [-50, -50, -50], range: [-1000, 2000] };
const BOX = volumeBox(VOLUME);
const still = { orbit: [0, 0], pan: [0, 0], window: [0, 0], roll: 0, factor: 1, slices: 0 };
const SCENE = {
  mode: 'dvr',
  camera: {
    projection: 'perspective',
    position: [0, -300, 0],
    target: [0, 0, 0],
    up: [0, 0, 1],
    fovY: 30,
    height: 200,
  },
  window: { center: 40, width: 400 },
  mpr: { orientation: 'axial', zoom: 1 },
};

const storage = (text) => ({ text, getItem: () => text, setItem: (_, now) => (text = now), removeItem: () => (text = null) });

test('drags mean what they mean in 3-D viewers and in slice viewers', () => {
  const bindings = new Bindings(storage(null));
  const dragAction = (event, mode) => bindings.find(dragChord({ pointerType: 'mouse', ...event }), mode).does;
  assert.equal(dragAction({ button: 0 }, 'dvr'), 'orbit');
  assert.equal(dragAction({ button: 0, shiftKey: true }, 'dvr'), 'pan');
  assert.equal(dragAction({ button: 1 }, 'dvr'), 'pan');
  assert.equal(dragAction({ button: 1, altKey: true }, 'dvr'), 'pan', 'whatever else is held');
  assert.equal(dragAction({ button: 2 }, 'dvr'), 'zoom');
  assert.equal(dragAction({ button: 0, ctrlKey: true }, 'dvr'), 'roll');
  assert.equal(dragAction({ button: 0, ctrlKey: true }, 'mip'), 'window');
  assert.equal(dragAction({ button: 0 }, 'mip'), 'orbit');
  assert.equal(dragAction({ button: 0 }, 'mpr'), 'window');
  assert.equal(dragAction({ button: 1 }, 'mpr'), 'pan');
  assert.equal(dragAction({ button: 0, pointerType: 'touch' }, 'mpr'), 'scroll');
});

test('how far surfaces are off, together and one by one', () => {
  const depths = { depthRms: 0.5, depthP99: 1.25, depthMax: 3, outline: 0.02 };
  const color = { rms: 0.01, low: 0.01, high: 0.01, max: 0.02, pixels: 64 };
  const surfaces = [{ surface: 1, pixels: 40, ...depths, depthRms: 0.25 }, { label: 7, pixels: 4, ...depths }];
  const said = errorText({ error: { ...color, ...depths, surfaces } });
  assert.match(said, /; depth 0.50 mm, 99 % 1.3, outline 2.0 %$/);
  assert.doesNotMatch(errorText({ error: color }), /depth/);
  const all = 'depth 0.50 mm rms, 99 % within 1.3 mm, outline wrong in 2.0 % of pixels';
  const lines = [all, `surface 2: ${all.replace('0.50', '0.25')} (40 px)`, `label 7: ${all} (4 px)`];
  assert.deepEqual(surfaceLines({ ...depths, surfaces }), lines);
  assert.deepEqual(surfaceLines({ ...depths, surfaces: surfaces.slice(1) }), [all]);
  const layers = [{ pixels: 50, ...depths }, { pixels: 30, ...depths }];
  assert.deepEqual(surfaceLines({ ...depths, surfaces, layers }), [...lines, `layer 2: ${all} (30 px)`]);
  assert.deepEqual(surfaceLines(color), []);
});

test('the table of bindings: ids are unique, nothing clashes, keys have one name', () => {
  const rows = TABLE.flatMap((part) => part.rows);
  assert.equal(new Set(rows.map(({ id }) => id)).size, rows.length);
  const bindings = new Bindings(storage(null));
  for (const row of rows) for (const chord of row.chords) assert.deepEqual(bindings.conflicts(row, chord), [], row.id);
  const chord = (key, more = {}) => keyChord({ key, ...more });
  assert.deepEqual([chord('a'), chord('A'), chord('A', { shiftKey: true })], ['A', 'A', 'Shift+A'], 'caps lock is no Shift');
  assert.deepEqual([chord('?', { shiftKey: true }), chord(' '), chord('Shift')], ['?', 'Space', '']);
  assert.equal(chord('Z', { metaKey: true, shiftKey: true }), 'Ctrl+Shift+Z');
  assert.equal(bindings.find('ArrowUp', 'dvr').does, 'turn');
  assert.equal(bindings.find('ArrowUp', 'mpr').does, 'slices');
  assert.equal(contextOf('minip'), 'projection');
});

test('changed bindings are kept, clash where they are used together, and are read with care', () => {
  const kept = storage(null);
  const [cine, first] = ['cine', 'first'].map((id) => TABLE.flatMap(({ rows }) => rows).find((row) => row.id === id));
  new Bindings(kept).rebind(cine, 'C', 'ArrowUp');
  const again = new Bindings(kept);
  assert.deepEqual([again.chords(cine), again.chords(first)], [['ArrowUp'], ['Home']]);
  assert.deepEqual(again.conflicts(cine, 'ArrowUp'), ['Turn up 5\u00b0', 'Previous slice']);
  assert.deepEqual(again.conflicts(first, 'ArrowLeft'), ['Previous slice'], 'turning is for other pictures');
  again.rebind(cine, 'ArrowUp', '');
  assert.deepEqual(again.chords(cine), []);
  again.reset();
  assert.deepEqual(new Bindings(kept).chords(cine), ['C']);
  for (const text of ['{', '7', 'null', '{"cine": "C"}', '{"nothing": ["C"]}', '{"cine": [1]}']) {
    assert.deepEqual(new Bindings(storage(text)).chords(cine), ['C'], text);
  }
});

test('a notch of a wheel is one, in whatever unit it comes; Ctrl never zooms by more than a quarter', () => {
  const turned = (deltaY, deltaMode = 0) => notches({ deltaY, deltaMode });
  assert.deepEqual([100, 120, 53, -100, 240, 360].map((px) => turned(px)), [1, 1, 1, -1, 2, 3]);
  assert.deepEqual([turned(3, 1), turned(-1, 1), turned(6, 1), turned(0)], [1, -1, 2, 0]);
  assert.equal(turned(10), 0.2, 'a track pad');
  for (const deltaY of [-240, -120, -100, -3, 3, 100, 120]) {
    const factor = wheelFactor({ deltaY, deltaMode: 0 }, true);
    assert.ok(Math.abs(Math.log(factor)) <= Math.log(1.25) * Math.max(1, Math.abs(turned(deltaY))) + 1e-9);
    assert.equal(factor > 1, deltaY < 0);
  }
  assert.ok(wheelFactor({ deltaY: 120, deltaMode: 0 }, false) < 1 / 1.2);
});

test('turns of the wheel that a busy page gets late are one gesture', async () => {
  const gestures = [];
  const element = Object.assign(new EventTarget(), {
    closest: () => null,
    getBoundingClientRect: () => ({ left: 0, top: 0, width: 800, height: 600 }),
  });
  new Input(element, new Bindings(), { mode: () => 'dvr', wake() {}, active: (on) => gestures.push(on) });
  const turn = () => element.dispatchEvent(Object.assign(new Event('wheel'), { deltaY: -120, deltaMode: 0, clientX: 5, clientY: 5 }));
  const busyUntil = (ms) => {
    while (performance.now() < ms);
  };
  turn();
  setTimeout(turn, 160); // runs right after the rest timer of the first turn: both are overdue by then
  busyUntil(performance.now() + 300);
  await sleep(600);
  assert.deepEqual(gestures, [true, false]);
  turn();
  await sleep(600);
  turn();
  await sleep(600);
  assert.deepEqual(gestures.slice(2), [true, false, true, false], 'a rest ends it');
});

test('two fingers: shift, zoom and twist; movements put together are one map of the picture', () => {
  const moved = pinch([[0, 0], [10, 0]], [[0, 4], [20, 4]]);
  assert.deepEqual(moved, { at: [5, 0], pan: [5, 4], factor: 2, roll: 0 });
  const spot = pinch([[5, 5], [5, 5]], [[0, 0], [90, 0]]);
  assert.deepEqual([spot.factor, spot.roll], [1, 0], 'two fingers on one spot have no gap to scale');
  assert.ok(Math.abs(pinch([[0, 0], [-9, 1]], [[0, 0], [-9, -1]]).roll - 12.68) < 0.01, 'the short way round');
  const apply = ({ factor, roll, pan }, [x, y]) => {
    const [c, s] = [Math.cos((roll * Math.PI) / 180) * factor, Math.sin((roll * Math.PI) / 180) * factor];
    return [c * x - s * y + pan[0], s * x + c * y + pan[1]];
  };
  let [sum, a, b] = [NO_MOVEMENT, [30, -20], [-70, 45]];
  for (let i = 0; i < 5; i++) {
    const next = [[a[0] + 7, a[1] - 3 * i], [b[0] - 4 * i, b[1] + 11]];
    sum = compose(sum, pinch([a, b], next));
    [a, b] = next;
  }
  [[30, -20], [-70, 45]].forEach((start, k) => apply(sum, start).forEach((x, axis) => assert.ok(Math.abs(x - [a, b][k][axis]) < 1e-9)));
});

test("dragging to the right brings the patient's right side to the front", () => {
  const patch = steer(SCENE, { ...still, orbit: [100, 0] }, STAGE, VOLUME, BOX);
  assert.ok(patch.camera.position[0] < -1, "the camera went to the patient's right");
  const down = steer(SCENE, { ...still, orbit: [0, 100] }, STAGE, VOLUME, BOX);
  assert.ok(down.camera.position[2] > 1, 'dragging down shows the top');
});

test('no movement is no patch', () => assert.equal(steer(SCENE, still, STAGE, VOLUME, BOX), null));

test('slices: the wheel moves along the normal, the drag sets the window, pan and zoom stay in the plane', () => {
  const scene = { ...SCENE, mode: 'mpr' };
  const next = steer(scene, { ...still, slices: 3 }, STAGE, VOLUME, BOX).mpr.center;
  assert.deepEqual(next, [0, 0, 6], 'layers of voxels are 2 mm apart');
  const moved = steer(scene, { ...still, pan: [10, 0] }, STAGE, VOLUME, BOX).mpr.center;
  assert.ok(moved[0] < 0 && Math.abs(moved[2]) < 1e-9);
  assert.equal(steer(scene, { ...still, factor: 2 }, STAGE, VOLUME, BOX).mpr.zoom, 2);
  const { window } = steer(scene, { ...still, window: [100, 50] }, STAGE, VOLUME, BOX);
  assert.ok(window.width > 400 && window.center > 40);
  assert.ok(steer(scene, { ...still, window: [-1e6, 0] }, STAGE, VOLUME, BOX).window.width > 0);
  assert.ok(Math.abs(sliceHeight({ ...scene, mpr: { orientation: 'axial', zoom: 2 } }, STAGE, BOX) - 50) < 1e-9);
});

test('slices of a volume that lies across the patient: its own edges fit, its own voxels are steps and places', () => {
  const c = Math.SQRT1_2;
  const direction = [c, -c, 0, c, c, 0, 0, 0, 1];
  const volume = { dims: [101, 101, 11], spacing: [1, 1, 4], direction, origin: [0, 0, 0] };
  const box = volumeBox(volume);
  const mpr = { orientation: 'oblique', normal: [c, c, 0], up: [0, 0, 1], zoom: 1 };
  const square = { width: 200, height: 200 };
  assert.ok(Math.abs(sliceHeight({ mpr }, square, box) - 100) < 1e-9, 'one edge, not the diagonal of its box');
  assert.ok(Math.abs(sliceStep(volume, [0, 0, 1]) - 4) < 1e-9);
  assert.ok(Math.abs(sliceStep(volume, [c, c, 0]) - 1) < 1e-9);
  const axial = { mpr: { orientation: 'axial', center: [5, 6, 7], zoom: 1 } };
  const [x, y, z] = slicePlace(axial, [0, 100], square, box);
  assert.ok(x < 5 - 50 && Math.abs(y - 6) < 1e-9 && z === 7, "the patient's right is on the left");
  assert.ok(slicePlace(axial, [100, 0], square, box)[1] < 6 - 50, 'the front is on top');
});

test('slices end where the volume does, for the wheel, for Home and End', () => {
  const scene = { ...SCENE, mode: 'mpr', mpr: { orientation: 'axial', zoom: 1, center: [1, 2, 40] } };
  const after = (slices) => steer(scene, { ...still, slices }, STAGE, VOLUME, BOX).mpr.center;
  assert.deepEqual([after(4), after(5), after(99), after(Infinity)].map(([, , z]) => z), [48, 50, 50, 50]);
  assert.deepEqual(after(-Infinity), [1, 2, -50]);
  assert.equal(slicePixels(scene, STAGE, VOLUME, BOX), 12, '600 pixels for 50 layers');
});

test('a zoom keeps its place in slices and in 3-D, at the limits too', () => {
  const scene = { ...SCENE, mode: 'mpr', mpr: { orientation: 'axial', zoom: 1, center: [0, 0, 0] } };
  const at = [120, -80];
  const under = (mpr) => slicePlace({ mpr }, [400 + at[0], 300 + at[1]], STAGE, BOX);
  for (const [zoom, factor] of [[1, 2], [60, 2], [90, 8], [0.12, 0.1]]) {
    const before = { ...scene.mpr, zoom };
    const { mpr } = steer({ ...scene, mpr: before }, compose(NO_MOVEMENT, { factor, at }), STAGE, VOLUME, BOX);
    const after = { ...before, ...mpr };
    under(after).forEach((mm, k) => assert.ok(Math.abs(mm - under(before)[k]) < 1e-6, `zoom ${zoom} by ${factor}`));
  }
});

test('picture size follows the device, keeps the aspect and the cap', () => {
  assert.deepEqual(pictureSize(800, 600, 1, 1.5e6), { width: 800, height: 600 });
  const { width, height } = pictureSize(1600, 1000, 2, 1.5e6);
  assert.ok(width * height <= 1.5e6 && width * height > 1.48e6);
  assert.ok(Math.abs(width / height - 1.6) < 0.01);
  assert.ok(pictureSize(0, 0, 1, 1e6).width >= 1);
});

test('paths into the scene, arrays replaced whole', () => {
  const scene = { splat: { threshold: [1, 2] } };
  assert.equal(valueAt(scene, 'splat.threshold.1'), 2);
  assert.equal(valueAt(scene, 'nothing.at.all'), undefined);
  assert.deepEqual(patchFor(scene, 'splat.threshold.1', 9), { splat: { threshold: [1, 9] } });
  assert.deepEqual(patchFor(scene, 'mode', 'mip'), { mode: 'mip' });
  assert.deepEqual(scene, { splat: { threshold: [1, 2] } });
});

test('status words', () => {
  assert.equal(frameRate([0, 100, 200]), 10);
  assert.equal(frameRate([5]), 0);
  assert.equal(compressionRatio({ width: 100, height: 100 }, 1000), '30:1');
  assert.deepEqual(fidelity({ format: 'jpeg', quality: 75, width: 100, height: 100 }, 1000), {
    text: 'LOSSY q75 \u00b7 30:1',
    lossy: true,
  });
  assert.equal(fidelity({ format: 'png' }, 1).lossy, false);
});

test('volumes: one list, ids without file suffixes, uploads without file names', () => {
  const list = volumeList({
    volumes: [{ id: 'head', state: 'loading' }],
    available: [{ path: 'ct/Knee.nii.gz' }, { path: 'demo:head' }, { path: 'x/head2.nrrd' }],
  });
  assert.deepEqual(
    list.map(({ id, state }) => [id, state]),
    [
      ['head', 'loading'],
      ['Knee', 'available'],
      ['head2', 'available'],
    ],
  );
  assert.deepEqual(idsFor(['a/b c/My scan (1).nii.gz', 'demo:vessels', '///', '.nii']), [
    'My-scan-1',
    'vessels',
    'volume',
    'nii',
  ]);
  assert.deepEqual(idsFor(['n/FLAIR.nii.gz', 'n/FLAIR.nrrd']), ['FLAIR-nii-gz', 'FLAIR-nrrd'], 'told apart by suffix');
  assert.deepEqual(idsFor(['a/ct/1.dcm', 'b/ct/1.dcm', 'c']), ['a-ct-1-dcm', 'b-ct-1-dcm', 'c'], 'or by folder');
  assert.equal(uploadId(new Set(['upload-1', 'upload-2'])), 'upload-3');
  assert.equal(formatBytes(29491200), '29.5 MB');
  assert.equal(
    describe({ dims: [2, 3, 4], spacing: [0.5, 0.5, 1.25], type: 'int16' }),
    '2 \u00d7 3 \u00d7 4 \u00b7 0.5 \u00d7 0.5 \u00d7 1.25 mm \u00b7 int16',
  );
});
