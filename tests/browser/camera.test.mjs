import assert from 'node:assert/strict';
import { test } from 'node:test';

import * as camera from '../../web/camera.js';
import { cubeFaces } from '../../web/furniture.js';

const FRONT = {
  projection: 'perspective',
  position: [10, -200, 30],
  target: [10, 0, 30],
  up: [0, 0, 1],
  fovY: 30,
  height: 120,
};

function near(a, b, eps = 1e-9) {
  assert.equal(a.length, b.length);
  a.forEach((x, i) => assert.ok(Math.abs(x - b[i]) <= eps, `[${a}] is not [${b}]`));
}

/** Picture position of a point at unit scale: right and up components from the target, perspective ignored. */
function project(view, point) {
  const { right, up } = camera.basis(view);
  const offset = camera.sub(point, view.target);
  return [camera.dot(offset, right), camera.dot(offset, up)];
}

test("basis is orthonormal and right-handed; from the front the patient's left is on the right", () => {
  const { direction, right, up } = camera.basis(FRONT);
  near(direction, [0, 1, 0]);
  near(right, [1, 0, 0]);
  near(up, [0, 0, 1]);
  near(camera.cross(right, direction), camera.scale(camera.cross(direction, right), -1));
});

test('basis of a camera that looks along its up vector, or at itself, is finite and orthonormal', () => {
  for (const position of [
    [0, 0, 100],
    [0, 0, -100],
    [0, 0, 0],
  ]) {
    const { direction, right, up } = camera.basis({ ...FRONT, position, target: [0, 0, 0] });
    for (const v of [direction, right, up]) assert.ok(Math.abs(camera.length(v) - 1) < 1e-12);
    assert.ok(Math.abs(camera.dot(direction, right)) < 1e-12 && Math.abs(camera.dot(up, right)) < 1e-12);
  }
});

test('orbit keeps the target and the distance; a full turn comes back', () => {
  let view = FRONT;
  for (let i = 0; i < 360; i++) view = camera.orbit(view, 1, 0);
  near(view.position, FRONT.position, 1e-9);
  const turned = camera.orbit(FRONT, 33, -71);
  near(turned.target, FRONT.target);
  assert.ok(Math.abs(camera.distance(turned) - 200) < 1e-9);
  near(camera.orbit(camera.orbit(FRONT, 25, 0), -25, 0).position, FRONT.position);
});

test('orbit goes over the poles without flipping', () => {
  let view = FRONT;
  let before = camera.basis(view);
  for (let i = 0; i < 180; i++) {
    view = camera.orbit(view, 0, 2);
    const now = camera.basis(view);
    assert.ok(camera.dot(before.right, now.right) > 0.999 && camera.dot(before.up, now.up) > 0.99);
    before = now;
  }
  near(view.position, FRONT.position, 1e-9);
});

test('pan moves what lies at the target by as many pixels', () => {
  const moved = camera.pan(FRONT, 50, -20, 600);
  const mm = camera.spanAtTarget(FRONT) / 600;
  near(project(moved, FRONT.target), [50 * mm, 20 * mm], 1e-9);
  near(camera.sub(moved.target, moved.position), camera.sub(FRONT.target, FRONT.position));
});

test('zoom scales the span at the target in both projections, within limits', () => {
  for (const projection of ['perspective', 'orthographic']) {
    const view = { ...FRONT, projection };
    assert.ok(Math.abs(camera.spanAtTarget(camera.zoom(view, 2)) * 2 - camera.spanAtTarget(view)) < 1e-9);
    for (const factor of [1e9, 1e-9]) assert.ok(Number.isFinite(camera.spanAtTarget(camera.zoom(view, factor))));
    assert.ok(camera.spanAtTarget(camera.zoom(view, 1e9)) > 0);
  }
});

test('changing the projection keeps the size at the target', () => {
  const parallel = camera.withProjection(FRONT, 'orthographic');
  assert.ok(Math.abs(parallel.height - camera.spanAtTarget(FRONT)) < 1e-9);
  const back = camera.withProjection(camera.zoom(parallel, 2), 'perspective');
  assert.ok(Math.abs(camera.spanAtTarget(back) - parallel.height / 2) < 1e-9);
});

test('standard views show the side they are named after', () => {
  const edges = {
    A: { right: 'L', left: 'R', top: 'H', bottom: 'F' },
    P: { right: 'R', left: 'L', top: 'H', bottom: 'F' },
    L: { right: 'P', left: 'A', top: 'H', bottom: 'F' },
    R: { right: 'A', left: 'P', top: 'H', bottom: 'F' },
    H: { right: 'R', left: 'L', top: 'A', bottom: 'P' },
    F: { right: 'L', left: 'R', top: 'A', bottom: 'P' },
  };
  for (const [letter, expected] of Object.entries(edges)) {
    const view = camera.standardView(FRONT, letter);
    const axes = camera.basis(view);
    assert.deepEqual(camera.edgeLetters(axes), expected, letter);
    assert.equal(camera.letters(camera.scale(axes.direction, -1)), letter);
    assert.ok(Math.abs(camera.distance(view) - 200) < 1e-9);
  }
});

test('letters of oblique directions are compound, strongest first', () => {
  assert.equal(camera.letters([1, 0, 0]), 'L');
  assert.equal(camera.letters([0.5, -0.86, 0]), 'AL');
  assert.equal(camera.letters([-0.7, 0.1, -0.71]), 'FR');
  assert.equal(camera.letters([1, 1.01, 1.02]), 'HPL');
  assert.equal(camera.letters([0.99, 0.1, 0.1]), 'L');
});

test('slices have radiological axes', () => {
  assert.deepEqual(camera.edgeLetters(camera.sliceBasis({ orientation: 'axial' })), {
    right: 'L',
    left: 'R',
    top: 'A',
    bottom: 'P',
  });
  assert.deepEqual(camera.edgeLetters(camera.sliceBasis({ orientation: 'coronal' })), {
    right: 'L',
    left: 'R',
    top: 'H',
    bottom: 'F',
  });
  assert.deepEqual(camera.edgeLetters(camera.sliceBasis({ orientation: 'sagittal' })), {
    right: 'P',
    left: 'A',
    top: 'H',
    bottom: 'F',
  });
});

test('volume box: between voxel centres, whatever the direction; a single slice is one spacing thick', () => {
  const plain = camera.volumeBox({ dims: [11, 21, 1], spacing: [1, 2, 3], origin: [5, 0, 0] });
  near(plain.low, [5, 0, -1.5]);
  near(plain.high, [15, 40, 1.5]);
  // index x runs to the patient's right, y to the front: flat and nested rows say the same
  for (const direction of [
    [-1, 0, 0, 0, -1, 0, 0, 0, 1],
    [
      [-1, 0, 0],
      [0, -1, 0],
      [0, 0, 1],
    ],
  ]) {
    const turned = camera.volumeBox({ dims: [11, 11, 11], spacing: [1, 1, 1], origin: [0, 0, 0], direction });
    near(turned.low, [-10, -10, 0]);
    near(turned.high, [0, 0, 10]);
  }
});

test('fit shows the whole box in wide and in tall pictures', () => {
  const box = { low: [-50, -80, -100], high: [50, 80, 100], center: [0, 0, 0], radius: 137 };
  for (const aspect of [2.4, 1, 0.45]) {
    for (const projection of ['perspective', 'orthographic']) {
      const view = camera.fit({ ...FRONT, projection }, box, aspect);
      const { direction, right, up } = camera.basis(view);
      for (let corner = 0; corner < 8; corner++) {
        const point = [0, 1, 2].map((k) => ((corner >> k) & 1 ? box.high[k] : box.low[k]));
        const offset = camera.sub(point, view.position);
        const depth = camera.dot(offset, direction);
        const half = projection === 'orthographic' ? view.height / 2 : depth * Math.tan((view.fovY * Math.PI) / 360);
        assert.ok(depth > 0 && Math.abs(camera.dot(offset, up)) < half, `${projection} ${aspect}: height`);
        assert.ok(Math.abs(camera.dot(offset, right)) < half * aspect, `${projection} ${aspect}: width`);
      }
    }
  }
});

test('scale bar lengths are round and fit', () => {
  for (const most of [0.37, 1, 19.99, 20, 49, 50, 734]) {
    const mm = camera.roundLength(most);
    assert.ok(mm <= most && mm > most / 2.6, `${mm} for ${most}`);
    assert.match(mm.toExponential(), /^[125]e/);
  }
});

test('the cube shows the face that looks at the viewer, upright and not mirrored', () => {
  for (const letter of Object.keys(camera.STANDARD_VIEWS)) {
    const front = cubeFaces(camera.basis(camera.standardView(FRONT, letter))).at(-1);
    assert.equal(front.letter, letter);
    const [a, b, c, d] = front.matrix;
    assert.ok(a > 0 && d > 0 && Math.abs(b) < 1e-9 && Math.abs(c) < 1e-9, `${letter}: ${front.matrix}`);
  }
});
