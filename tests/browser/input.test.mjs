import assert from 'node:assert/strict';
import { test } from 'node:test';

import { volumeBox } from '../../web/camera.js';
import { dragAction, pinch, wheelPixels } from '../../web/input.js';
import { patchFor, valueAt } from '../../web/panels.js';
import { compressionRatio, fidelity, frameRate } from '../../web/status.js';
import { sliceHeight, slicePlace, sliceStep, steer, steerByKey } from '../../web/steer.js';
import { pictureSize } from '../../web/view.js';
import { describe, formatBytes, idsFor, uploadId, volumeList } from '../../web/volumes.js';

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

test('drags mean what they mean in 3-D viewers and in slice viewers', () => {
  assert.equal(dragAction({ button: 0 }, 'dvr'), 'orbit');
  assert.equal(dragAction({ button: 0, shiftKey: true }, 'dvr'), 'pan');
  assert.equal(dragAction({ button: 1 }, 'dvr'), 'pan');
  assert.equal(dragAction({ button: 2 }, 'dvr'), 'zoom');
  assert.equal(dragAction({ button: 0, ctrlKey: true }, 'dvr'), 'roll');
  assert.equal(dragAction({ button: 0, ctrlKey: true }, 'mip'), 'window');
  assert.equal(dragAction({ button: 0 }, 'mip'), 'orbit');
  assert.equal(dragAction({ button: 0 }, 'mpr'), 'window');
  assert.equal(dragAction({ button: 1 }, 'mpr'), 'pan');
});

test('wheel units and pinches', () => {
  assert.equal(wheelPixels({ deltaY: 3, deltaMode: 1 }), 48);
  assert.equal(wheelPixels({ deltaY: -120, deltaMode: 0 }), -120);
  assert.deepEqual(
    pinch(
      [
        [0, 0],
        [10, 0],
      ],
      [
        [0, 4],
        [20, 4],
      ],
    ),
    { pan: [5, 4], factor: 2 },
  );
  assert.equal(
    pinch(
      [
        [5, 5],
        [5, 5],
      ],
      [
        [0, 0],
        [90, 0],
      ],
    ).factor,
    1,
    'two fingers on one spot have no gap to scale',
  );
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

test('keys turn and zoom; other keys are not ours', () => {
  for (const key of ['ArrowLeft', 'ArrowRight', 'ArrowUp', 'ArrowDown', '+', '-', '=']) {
    assert.notDeepEqual(steerByKey(SCENE.camera, key, false), SCENE.camera, key);
  }
  assert.equal(steerByKey(SCENE.camera, 'x', false), null);
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
