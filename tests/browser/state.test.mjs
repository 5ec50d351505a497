import assert from 'node:assert/strict';
import { test } from 'node:test';

import { difference, History } from '../../web/history.js';
import { joinPatches, mergePatch, SceneStore } from '../../web/state.js';

test('merge patch follows the examples of RFC 7396, appendix A', () => {
  const cases = [
    [{ a: 'b' }, { a: 'c' }, { a: 'c' }],
    [{ a: 'b' }, { b: 'c' }, { a: 'b', b: 'c' }],
    [{ a: 'b' }, { a: null }, {}],
    [{ a: 'b', b: 'c' }, { a: null }, { b: 'c' }],
    [{ a: ['b'] }, { a: 'c' }, { a: 'c' }],
    [{ a: 'c' }, { a: ['b'] }, { a: ['b'] }],
    [{ a: { b: 'c' } }, { a: { b: 'd', c: null } }, { a: { b: 'd' } }],
    [{ a: [{ b: 'c' }] }, { a: [1] }, { a: [1] }],
    [
      ['a', 'b'],
      ['c', 'd'],
      ['c', 'd'],
    ],
    [{ a: 'b' }, ['c'], ['c']],
    [{ a: 'foo' }, null, null],
    [{ a: 'foo' }, 'bar', 'bar'],
    [{ e: null }, { a: 1 }, { e: null, a: 1 }],
    [[1, 2], { a: 'b', c: null }, { a: 'b' }],
    [{}, { a: { bb: { ccc: null } } }, { a: { bb: {} } }],
  ];
  for (const [target, patch, result] of cases)
    assert.deepEqual(mergePatch(target, patch), result, JSON.stringify(patch));
});

test('merge patch leaves its arguments alone', () => {
  const target = Object.freeze({ a: Object.freeze({ b: 1 }) });
  assert.deepEqual(mergePatch(target, { a: { c: 2 } }), { a: { b: 1, c: 2 } });
});

test('a joined patch does what its parts do in turn, and keeps the nulls', () => {
  const first = { camera: { up: [1, 0, 0] }, clip: { box: null }, image: { width: 5 } };
  const second = { camera: { fovY: 20 }, image: null, mode: 'mip' };
  const scene = { camera: { up: [0, 0, 1], height: 3 }, clip: { box: 1 }, image: { width: 1, height: 2 } };
  const joined = joinPatches(first, second);
  assert.deepEqual(mergePatch(scene, joined), mergePatch(mergePatch(scene, first), second));
  assert.equal(joined.clip.box, null);
});

test('the store applies edits at once and hands them over once', () => {
  const store = new SceneStore();
  const heard = [];
  store.subscribe((_, how) => heard.push(how));
  store.patch({ mode: 'mpr' }); // nothing to edit yet
  assert.deepEqual([store.scene, store.take(), heard], [null, null, []]);
  store.replace({ mode: 'dvr', image: { width: 1 } });
  store.patch({ mode: 'mip' });
  store.patch({ image: { width: 7 } });
  assert.deepEqual(store.scene, { mode: 'mip', image: { width: 7 } });
  assert.deepEqual(store.take(), { mode: 'mip', image: { width: 7 } });
  assert.equal(store.take(), null);
  assert.equal(store.dirty, false);
  assert.deepEqual(heard, ['server', 'edit', 'edit']);
});

test("the daemon's scene goes under what is still on its way", () => {
  const store = new SceneStore();
  store.replace({ a: 1, b: 1, c: 1 });
  store.patch({ c: 3 });
  store.replace({ a: 10, b: 10, c: 10 }, [{ b: 2 }, { b: 3 }]);
  assert.deepEqual(store.scene, { a: 10, b: 3, c: 3 });
});

test('a patch that was put back yields to later edits', () => {
  const store = new SceneStore();
  store.replace({});
  store.patch({ a: 1, b: 1 });
  const lost = store.take();
  store.patch({ b: 2 });
  store.requeue(lost);
  assert.deepEqual(store.take(), { a: 1, b: 2 });
});

test('history: a gesture is one step, an edit alone another; a new one forgets the undone', () => {
  const store = new SceneStore();
  store.replace({ a: 0, b: { c: 0, d: 0 } });
  const history = new History(store);
  history.hold(true);
  for (const a of [1, 2, 3]) store.patch({ a });
  history.hold(false);
  store.patch({ b: { c: 1 } });
  store.patch({ b: { c: 2 } }); // at once the same member again: one step
  store.patch({ b: { d: 1 } });
  store.patch({ a: 9 }, 'fit');
  store.replace({ ...store.scene, e: 1 }); // somebody else's
  const seen = [];
  while (history.canUndo) {
    history.undo();
    seen.push(structuredClone(store.scene));
  }
  assert.deepEqual(seen, [
    { a: 9, b: { c: 2, d: 0 }, e: 1 },
    { a: 9, b: { c: 0, d: 0 }, e: 1 },
    { a: 0, b: { c: 0, d: 0 }, e: 1 },
  ]);
  history.redo();
  assert.equal(store.scene.a, 3);
  store.patch({ a: 4 });
  assert.equal(history.canRedo, false);
});

test('history: each item added to a list is a step, however soon after the one before', () => {
  const store = new SceneStore();
  store.replace({ list: [1] });
  const history = new History(store);
  store.patch({ list: [1, 2] });
  store.patch({ list: [1, 2, 3] });
  store.patch({ list: [1, 2, 4] }); // a value of the same item: extends the step
  history.undo();
  assert.deepEqual(store.scene.list, [1, 2]);
  history.undo();
  assert.deepEqual(store.scene.list, [1]);
});

test('history: what was refused, and an empty gesture, are no steps; the past is bounded', () => {
  const store = new SceneStore();
  store.replace({ a: 0, list: [1] });
  const history = new History(store);
  history.hold(true);
  history.hold(false);
  assert.equal(history.canUndo, false);
  store.patch({ list: [1, 2] });
  store.patch({ a: 7 });
  store.take();
  store.replace({ a: 0, list: [1, 2] }); // the daemon said no to a
  history.undo();
  assert.deepEqual(store.scene, { a: 0, list: [1] });
  for (let a = 0; a < 300; a++) {
    history.hold(true);
    store.patch({ a: a + 1 });
    history.hold(false);
  }
  let steps = 0;
  for (; history.canUndo; steps++) history.undo();
  assert.equal(steps, 200);
});

test('a difference makes one scene of another, functions whole', () => {
  const from = { a: 1, q: { x: 1 }, transferFunction: { preset: 'p', points: [1], unitDistance: 2 } };
  const to = { a: 1, q: { y: 2 }, transferFunction: { points: [2], unitDistance: 2 }, n: { m: 1 } };
  const patch = difference(from, to);
  assert.deepEqual(patch, {
    q: { x: null, y: 2 },
    transferFunction: { preset: null, points: [2], unitDistance: 2 },
    n: { m: 1 },
  });
  assert.deepEqual(mergePatch(from, patch), to);
  assert.deepEqual(difference(to, from).transferFunction, from.transferFunction);
});
