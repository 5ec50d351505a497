import assert from 'node:assert/strict';
import { test } from 'node:test';

import { History, joinPatches, mergePatch, SceneStore } from '../../web/state.js';

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

test('history: undo, redo, and a new edit forgets the undone', () => {
  const history = new History();
  let value = { v: 0 };
  for (const v of [1, 2, 3]) {
    history.push(value);
    value = { v };
  }
  value = history.undo(value);
  value = history.undo(value);
  assert.deepEqual(value, { v: 1 });
  value = history.redo(value);
  assert.deepEqual(value, { v: 2 });
  history.push(value);
  value = { v: 9 };
  assert.equal(history.canRedo, false);
  assert.deepEqual(history.undo(value), { v: 2 });
});

test('history: an edit that changed nothing is no step, and the past is bounded', () => {
  const history = new History(3);
  history.push({ v: 1 });
  history.push({ v: 1 });
  assert.equal(history.undo({ v: 1 }), undefined);
  for (let v = 0; v < 10; v++) history.push({ v });
  let steps = 0;
  for (let now = { v: 10 }; now; steps++) now = history.undo(now);
  assert.equal(steps - 1, 3);
});
