import assert from 'node:assert/strict';
import { afterEach, beforeEach, test } from 'node:test';

import { View } from '../../web/view.js';

let decodes; // createImageBitmap calls: {resolve, reject, closed}
let beats; // requestAnimationFrame callbacks
let log; // what happened, in order
let canvas;
let view;

const frame = (number, extra = {}) => ({
  header: { frame: number, width: 64, height: 48, final: true, ...extra },
  image: new Uint8Array([number]),
  type: 'image/jpeg',
});
const settle = async () => {
  for (let i = 0; i < 5; i++) await null;
};
const decoded = async (index) => {
  decodes[index].resolve({ name: index, close: () => (decodes[index].closed = true) });
  await settle();
};
const beat = () => beats.splice(0).forEach((fn) => fn());

beforeEach(() => {
  decodes = [];
  beats = [];
  log = [];
  globalThis.createImageBitmap = () =>
    new Promise((resolve, reject) => decodes.push({ resolve, reject, closed: false }));
  globalThis.requestAnimationFrame = (fn) => beats.push(fn);
  const context = { fillRect() {}, drawImage: (bitmap) => log.push(`draw ${bitmap.name}`) };
  canvas = { width: 16, height: 16, getContext: () => context };
  view = new View(canvas, {
    onDraw: ({ header }) => log.push(`drawn ${header.frame}`),
    onAck: (number) => log.push(`ack ${number}`),
    onError: () => log.push('error'),
  });
});
afterEach(() => {
  delete globalThis.createImageBitmap;
  delete globalThis.requestAnimationFrame;
});

test("a frame is confirmed after it is drawn, on the display's beat, and its bitmap is closed", async () => {
  view.receive(frame(1));
  await decoded(0);
  assert.deepEqual(log, []);
  beat();
  assert.deepEqual(log, ['draw 0', 'ack 1', 'drawn 1']);
  assert.equal(decodes[0].closed, true);
  assert.deepEqual([canvas.width, canvas.height], [64, 48]);
});

test('of frames that come during a decode only the newest is decoded; all are confirmed when it is drawn', async () => {
  for (const number of [1, 2, 3, 4]) view.receive(frame(number));
  assert.equal(decodes.length, 1);
  await decoded(0);
  beat();
  assert.deepEqual(log, ['draw 0', 'ack 1', 'drawn 1']);
  assert.equal(decodes.length, 2);
  await decoded(1);
  beat();
  assert.deepEqual(log.slice(3), ['draw 1', 'ack 2', 'ack 3', 'ack 4', 'drawn 4']);
});

test('a frame decoded before the last one reached the screen replaces it', async () => {
  view.receive(frame(1));
  await decoded(0);
  view.receive(frame(2));
  await decoded(1);
  assert.equal(beats.length, 1);
  beat();
  assert.deepEqual(log, ['draw 1', 'ack 1', 'ack 2', 'drawn 2']);
  assert.deepEqual(
    decodes.map(({ closed }) => closed),
    [true, true],
  );
});

test('a frame that cannot be decoded is confirmed and told, and the next one is drawn', async () => {
  view.receive(frame(1));
  decodes[0].reject(new Error('broken'));
  await settle();
  assert.deepEqual(log, ['ack 1', 'error']);
  view.receive(frame(2));
  await decoded(1);
  beat();
  assert.deepEqual(log.slice(2), ['draw 1', 'ack 2', 'drawn 2']);
});

test('what was forgotten is neither drawn nor confirmed', async () => {
  view.receive(frame(1));
  await decoded(0);
  view.forget();
  beat();
  assert.deepEqual(log, []);
  assert.equal(decodes[0].closed, true);
});

test('a frame still being decoded when its connection ended is not drawn', async () => {
  view.receive(frame(1));
  view.forget();
  await decoded(0);
  beat();
  assert.deepEqual(log, []);
  assert.equal(decodes[0].closed, true);
});

test('a coarse frame is stretched over the same canvas; a final one sets its size', async () => {
  view.receive(frame(1, { width: 640, height: 480 }));
  await decoded(0);
  beat();
  view.receive(frame(2, { width: 160, height: 120, final: false }));
  await decoded(1);
  beat();
  assert.equal(canvas.width, 640);
  view.receive(frame(3, { width: 320, height: 240 }));
  await decoded(2);
  beat();
  assert.equal(canvas.width, 320);
});
