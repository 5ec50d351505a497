import assert from 'node:assert/strict';
import { test } from 'node:test';

import * as tf from '../../web/transfer_model.js';

const POINTS = [
  { value: 0, color: [0, 0, 0], opacity: 0 },
  { value: 100, color: [1, 0, 0], opacity: 0.5 },
  { value: 200, color: [1, 1, 1], opacity: 1 },
];

test('sample interpolates, is constant beyond the ends, and takes the right side of a jump', () => {
  assert.deepEqual(tf.sample(POINTS, 50), { color: [0.5, 0, 0], amount: 0.25 });
  assert.deepEqual(tf.sample(POINTS, -1e9), { color: [0, 0, 0], amount: 0 });
  assert.deepEqual(tf.sample(POINTS, 1e9), { color: [1, 1, 1], amount: 1 });
  const jump = [
    { value: 0, color: [0, 0, 0], opacity: 0 },
    { value: 0, color: [1, 1, 1], opacity: 1 },
  ];
  assert.equal(tf.sample(jump, -1e-9).amount, 0);
  assert.equal(tf.sample(jump, 0).amount, 1);
});

test('an added knot takes its place and the colour that was there', () => {
  const { points, index } = tf.addKnot(POINTS, 150, 0.2);
  assert.equal(index, 2);
  assert.deepEqual(points[2], { value: 150, color: [1, 0.5, 0.5], opacity: 0.2 });
  assert.equal(tf.addKnot(POINTS, -5, 7).index, 0);
  assert.equal(tf.addKnot(POINTS, -5, 7).points[0].opacity, 1, 'opacity stops at 1');
  assert.equal(tf.addKnot(POINTS, 500, -1).index, 3);
  assert.equal(POINTS.length, 3);
});

test('a moved knot stops at its neighbours', () => {
  assert.equal(tf.moveKnot(POINTS, 1, -50, 0.5)[1].value, 0);
  assert.equal(tf.moveKnot(POINTS, 1, 950, 0.5)[1].value, 200);
  assert.equal(tf.moveKnot(POINTS, 2, 950, 5)[2].value, 950);
  assert.equal(tf.moveKnot(POINTS, 2, 950, 5)[2].opacity, 1);
  for (let i = 0; i < 500; i++) {
    const index = i % 3;
    const values = tf.moveKnot(POINTS, index, Math.sin(i) * 400, 0.5).map(({ value }) => value);
    assert.deepEqual(
      values,
      [...values].sort((a, b) => a - b),
    );
  }
});

test('knots by extinction stay so, without a ceiling', () => {
  const points = [
    { value: 0, color: [0, 0, 0], extinction: 0 },
    { value: 10, color: [1, 1, 1], extinction: 4 },
  ];
  assert.equal(tf.amountName(points), 'extinction');
  assert.equal(tf.amountLimit(points), 10);
  const moved = tf.moveKnot(points, 1, 12, 25);
  assert.equal(moved[1].extinction, 25);
  assert.equal('opacity' in moved[1], false);
  assert.equal('opacity' in tf.addKnot(points, 5, 1).points[1], false);
});

test('the last knot cannot be removed', () => {
  let points = POINTS;
  for (let i = 0; i < 5; i++) points = tf.removeKnot(points, 0);
  assert.deepEqual(points, [POINTS[2]]);
});

test('shift moves all', () => {
  assert.deepEqual(
    tf.shiftKnots(POINTS, -30).map(({ value }) => value),
    [-30, 70, 170],
  );
});

test('density scales the extinction: nothing clips, and up and down again is as before', () => {
  const [, half, full] = tf.scaleAmounts(POINTS, 2).map(({ opacity }) => opacity);
  assert.ok(Math.abs(half - 0.75) < 1e-12 && full < 1, 'twice the way through half-opaque matter');
  assert.ok(tf.scaleAmounts(POINTS, 0.01)[2].opacity < 0.1, 'what was opaque becomes thinner too');
  for (const factor of [100, 3, 0.5, 0.01]) {
    const there = tf.scaleAmounts(POINTS, factor);
    const back = tf.scaleAmounts(there, 1 / factor);
    back.forEach(({ opacity }, i) => assert.ok(Math.abs(opacity - POINTS[i].opacity) < 1e-9, `${factor}`));
    const anew = tf.scaleAmounts(structuredClone(tf.scaleAmounts(POINTS.slice(0, 2), Math.min(factor, 3))), 1 / Math.min(factor, 3));
    anew.forEach(({ opacity }, i) => assert.ok(Math.abs(opacity - POINTS[i].opacity) < 1e-9, 'a copy too'));
  }
  const points = [{ value: 0, color: [0, 0, 0], extinction: 4 }];
  assert.equal(tf.scaleAmounts(points, 0.5)[0].extinction, 2);
});

test('the value axis stays where data or knots are', () => {
  const reach = tf.axisReach(POINTS, [50, 150]);
  assert.deepEqual(reach, [-20, 220]);
  assert.deepEqual(tf.rangeWithin([900, 1000], reach, 1), [120, 220]);
  assert.deepEqual(tf.rangeWithin([-1e6, 1e6], reach, 1), reach);
  const [low, high] = tf.rangeWithin([5, 5], reach, 2);
  assert.deepEqual([low, high], [5, 7]);
  assert.deepEqual(tf.rangeThrough([{ value: 10, place: 0.25 }, { value: 20, place: 0.75 }]), [5, 25]);
  assert.equal(tf.rangeThrough([{ value: 10, place: 0.25 }, { value: 20, place: 0.25 }]), null);
});

test('colours survive the trip through a colour field', () => {
  for (const hex of ['#000000', '#ffffff', '#12ab9f']) assert.equal(tf.toHex(tf.fromHex(hex)), hex);
  assert.equal(tf.toHex([-1, 0.5, 7]), '#0080ff');
});

test('numbers for people', () => {
  assert.equal(tf.formatValue(123.4567, 3000), '123');
  assert.equal(tf.formatValue(0.123456, 1), '0.123');
  assert.equal(tf.formatValue(-0.00001, 10), '0');
});

test('knot range shows every knot with a margin, also of a single one', () => {
  const [low, high] = tf.knotRange(POINTS, [-1000, 2000]);
  assert.ok(low < 0 && high > 200);
  const single = tf.knotRange([POINTS[1]], [-1000, 2000]);
  assert.ok(single[0] < 100 && single[1] > 100);
});
