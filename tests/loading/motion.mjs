// What a hand does: camera paths and drags of the transfer function, made up or recorded.
//
// A motion is a function of milliseconds since its start. It gives the patch of that moment, or null while the hand rests.
import { readFileSync } from 'node:fs';

import * as camera from '../../web/camera.js';
import { shiftKnots } from '../../web/transfer_model.js';
import { Trouble } from './target.mjs';

const GESTURES = ['orbit', 'orbit', 'transfer', 'zoom'];
const TURN_DEGREES_PER_S = 60;
const MOST_STEPS = 100000;

/** Gestures of `dragMs`, a rest of `thinkMs` after each. `index` puts clients out of step with each other. */
export function synthetic(scene, index, { dragMs, thinkMs }) {
  const period = dragMs + thinkMs;
  const offset = ((index * 0.618) % 1) * period;
  const span = knotSpan(scene);
  let view = scene.camera;
  let before = 0;
  return (ms) => {
    const gesture = Math.floor((ms + offset) / period);
    const within = ms + offset - gesture * period;
    const passed = Math.min(100, ms - before);
    before = ms;
    if (within >= dragMs) return null;
    const swing = Math.sin((within / dragMs) * 2 * Math.PI);
    switch (GESTURES[(gesture + index) % GESTURES.length]) {
      case 'transfer':
        return { transferFunction: { preset: null, points: shiftKnots(scene.transferFunction.points, 0.02 * span * swing) } };
      case 'zoom':
        return { camera: camera.zoom(view, Math.exp(0.15 * swing)) };
      default:
        view = camera.orbit(view, (TURN_DEGREES_PER_S * passed) / 1000, 0.2 * TURN_DEGREES_PER_S * (passed / 1000) * swing);
        return { camera: view };
    }
  };
}

function knotSpan({ transferFunction: { points } }) {
  return points.length > 1 ? points.at(-1).value - points[0].value : 1;
}

/** A recorded path over and over: [{t: ms, patch: {...} or null for a rest}], t ascending. */
export function recorded(steps) {
  const length = steps.at(-1).t + 100;
  return (ms) => {
    const at = ms % length;
    let low = 0, high = steps.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (steps[middle].t <= at) low = middle;
      else high = middle - 1;
    }
    return steps[low].patch;
  };
}

/** @throws {Trouble} naming the step at fault */
export function readPath(file) {
  let steps;
  try {
    steps = JSON.parse(readFileSync(file, 'utf8'));
  } catch (error) {
    throw new Trouble(`--path ${file}: ${error.message}: give a file that --record wrote`);
  }
  if (!Array.isArray(steps) || !steps.length || steps.length > MOST_STEPS)
    throw new Trouble(`--path ${file}: give a list of 1 to ${MOST_STEPS} steps {"t": milliseconds, "patch": {...}}`);
  steps.forEach(({ t, patch } = {}, i) => {
    const after = i ? steps[i - 1].t : 0;
    if (!(t >= after) || typeof patch !== 'object')
      throw new Trouble(`--path ${file}: step ${i}: give "t" of at least ${after} and "patch", an object, or null for a rest`);
  });
  return steps;
}
