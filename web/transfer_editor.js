// The transfer function over the histogram: knots are dragged, added by double click, removed by right click, Delete or
// dragging them out. Every knot is a focusable slider, so that everything works from the keyboard too.

import {
  addKnot,
  amountLimit,
  amountName,
  amountOf,
  axisReach,
  colorKnot,
  formatValue,
  knotRange,
  moveKnot,
  rangeThrough,
  rangeWithin,
  removeKnot,
  sample,
  toHex,
} from './transfer_model.js';
import { svg } from './furniture.js';

const PAD = { left: 8, right: 8, top: 10, bottom: 30 };
const RAMP_HEIGHT = 8; // colour ramp below the curve, px
const DRAG_OUT_PX = 40; // dragged this far outside, a knot is removed
const KEY_STEP = 1 / 200; // of the shown range

export class TransferEditor {
  #host;
  #on;
  #root;
  #parts = {};
  #points = [];
  #range = [0, 1]; // shown part of the value axis
  #whole = [0, 1]; // range of the volume
  #histogram = null;
  #log = true;
  #selected = 0;
  #drag = null; // {kind: 'knot' | 'axis' | 'pinch', ...}
  #fingers = new Map(); // pointer id -> clientX of pointers that are down
  #size = { width: 320, height: 220 };

  /** change(points, {index}) on every edit; gesture(bool) around a drag; select(index); range([low, high]) */
  constructor(host, on) {
    this.#host = host;
    this.#on = on;
    this.#build();
    new ResizeObserver(() => this.#measure()).observe(host);
    this.#measure();
  }

  get selected() {
    return Math.min(this.#selected, this.#points.length - 1);
  }

  get points() {
    return this.#points;
  }

  get range() {
    return this.#range;
  }

  /** Sets the scene's function; a knot being dragged keeps its index. */
  setPoints(points) {
    this.#points = points;
    this.#drawCurve();
  }

  /** @param {{counts: number[], edges: number[]}|null} histogram @param {[number, number]} whole value range */
  setVolume(histogram, whole) {
    this.#histogram = histogram;
    this.#whole = whole[1] > whole[0] ? [...whole] : [whole[0] - 0.5, whole[0] + 0.5];
    this.setRange(this.#whole);
  }

  setLog(log) {
    this.#log = log;
    this.#drawHistogram();
  }

  /** Zooms the value axis, limited to the data. */
  setRange(range) {
    const least = (this.#whole[1] - this.#whole[0]) * 1e-5;
    this.#range = rangeWithin(range, axisReach(this.#points, this.#whole), least);
    this.#drawHistogram();
    this.#drawCurve();
    this.#on.range(this.#range);
  }

  showAll() {
    this.setRange(this.#whole);
  }

  showKnots() {
    this.setRange(knotRange(this.#points, this.#whole));
  }

  select(index, focus = false) {
    this.#selected = index;
    this.#drawCurve();
    this.#on.select(this.selected);
    if (focus) this.#parts.knots.children[index]?.focus();
  }

  /** Edits from the fields beside the plot; undefined values are kept. */
  set(value, amount) {
    const now = this.#points[this.selected];
    this.#change(moveKnot(this.#points, this.selected, value ?? now.value, amount ?? amountOf(now)));
  }

  setColor(color) {
    this.#change(colorKnot(this.#points, this.selected, color));
  }

  remove(index = this.selected) {
    if (this.#points.length < 2) return;
    const next = removeKnot(this.#points, index);
    this.#selected = Math.min(index, next.length - 1);
    this.#change(next);
    this.#on.select(this.selected);
  }

  /** Adds a knot beside the selected one, for keyboard users. */
  addNext() {
    const here = this.#points[this.selected];
    const next = this.#points[this.selected + 1];
    const value = next ? (here.value + next.value) / 2 : here.value + (this.#range[1] - this.#range[0]) / 20;
    this.#add(value, sample(this.#points, value).amount, true);
  }

  #build() {
    this.#root = svg('svg', { class: 'transfer', role: 'group', 'aria-label': 'Transfer function' });
    const defs = svg('defs', {}, this.#root);
    const gradient = { x1: 0, x2: 1, y1: 0, y2: 0 };
    this.#parts.gradient = svg('linearGradient', { id: 'ramp-colors', ...gradient }, defs);
    this.#parts.clip = svg('rect', {}, svg('clipPath', { id: 'plot-clip' }, defs));
    this.#parts.back = svg('rect', { class: 'plot' }, this.#root);
    this.#parts.grid = svg('g', { class: 'grid' }, this.#root);
    const inside = svg('g', { 'clip-path': 'url(#plot-clip)' }, this.#root);
    this.#parts.histogram = svg('path', { class: 'histogram' }, inside);
    this.#parts.area = svg('path', { class: 'area', fill: 'url(#ramp-colors)' }, inside);
    this.#parts.curve = svg('path', { class: 'curve' }, inside);
    this.#parts.ramp = svg('rect', { class: 'ramp', fill: 'url(#ramp-colors)' }, this.#root);
    this.#parts.axis = svg('g', { class: 'axis' }, this.#root);
    this.#parts.knots = svg('g', { class: 'knots' }, this.#root);
    this.#host.append(this.#root);
    this.#root.addEventListener('dblclick', (event) => this.#doubleClick(event));
    this.#root.addEventListener('pointerdown', (event) => this.#down(event));
    this.#root.addEventListener('pointermove', (event) => this.#move(event));
    this.#root.addEventListener('pointerup', (event) => this.#up(event));
    this.#root.addEventListener('pointercancel', (event) => this.#up(event));
    this.#root.addEventListener('wheel', (event) => this.#wheel(event), { passive: false });
    this.#root.addEventListener('contextmenu', (event) => this.#contextMenu(event));
    this.#root.addEventListener('keydown', (event) => this.#key(event));
    this.#root.addEventListener('focusin', (event) => this.#focused(event));
  }

  #measure() {
    const box = this.#host.getBoundingClientRect();
    if (box.width < 40 || box.height < 40) return; // hidden tab
    this.#size = { width: box.width, height: box.height };
    this.#root.setAttribute('viewBox', `0 0 ${box.width} ${box.height}`);
    const { x, y, width, height } = this.#plot;
    for (const part of [this.#parts.back, this.#parts.clip]) setBox(part, x, y, width, height);
    setBox(this.#parts.ramp, x, y + height + 3, width, RAMP_HEIGHT);
    this.#drawHistogram();
    this.#drawCurve();
  }

  get #plot() {
    const { width, height } = this.#size;
    return { x: PAD.left, y: PAD.top, width: width - PAD.left - PAD.right, height: height - PAD.top - PAD.bottom };
  }

  #x(value) {
    const { x, width } = this.#plot;
    return x + ((value - this.#range[0]) / (this.#range[1] - this.#range[0])) * width;
  }

  #y(amount) {
    const { y, height } = this.#plot;
    return y + height * (1 - amount / amountLimit(this.#points));
  }

  /** Value and amount under a pointer. */
  #at({ clientX, clientY }) {
    const box = this.#root.getBoundingClientRect();
    const { x, y, width, height } = this.#plot;
    const px = ((clientX - box.left) / box.width) * this.#size.width;
    const py = ((clientY - box.top) / box.height) * this.#size.height;
    const outside = Math.max(y - py, py - (y + height), x - px, px - (x + width));
    const value = this.#range[0] + ((px - x) / width) * (this.#range[1] - this.#range[0]);
    return { value, amount: (1 - (py - y) / height) * amountLimit(this.#points), outside };
  }

  #drawHistogram() {
    const { x, y, width, height } = this.#plot;
    if (!this.#histogram) {
      this.#parts.histogram.setAttribute('d', '');
      return;
    }
    const { counts, edges } = this.#histogram;
    const size = this.#log ? (count) => Math.log1p(count) : (count) => count;
    // The largest bins often are air; scaling to the third largest shows tissue in the linear view.
    const shown = counts
      .filter((_, i) => edges[i + 1] > this.#range[0] && edges[i] < this.#range[1])
      .sort((a, b) => b - a);
    const most = size(this.#log ? shown[0] || 1 : shown[Math.min(2, shown.length - 1)] || 1);
    let path = '';
    counts.forEach((count, i) => {
      if (edges[i + 1] < this.#range[0] || edges[i] > this.#range[1]) return;
      const top = y + height * (1 - Math.min(1, size(count) / most) * 0.96);
      const left = this.#x(edges[i]).toFixed(1);
      if (!path) path = `M${left} ${y + height}`; // the axis may begin before the values do
      path += `L${left} ${top.toFixed(1)}H${this.#x(edges[i + 1]).toFixed(1)}`;
    });
    this.#parts.histogram.setAttribute('d', path && `${path}V${y + height}Z`);
    this.#drawAxis();
  }

  #drawAxis() {
    const { x, y, width, height } = this.#plot;
    const span = this.#range[1] - this.#range[0];
    this.#parts.axis.replaceChildren();
    this.#parts.grid.replaceChildren();
    const step = niceStep(span / Math.max(2, width / 70));
    for (let tick = Math.ceil(this.#range[0] / step) * step; tick <= this.#range[1]; tick += step) {
      const at = this.#x(tick);
      svg('line', { x1: at, x2: at, y1: y, y2: y + height }, this.#parts.grid);
      const label = svg('text', { x: at, y: y + height + RAMP_HEIGHT + 16, 'text-anchor': 'middle' }, this.#parts.axis);
      label.textContent = formatValue(Math.abs(tick) < step / 1e6 ? 0 : tick, span);
      if (at < x + 14) label.setAttribute('text-anchor', 'start');
      if (at > x + width - 14) label.setAttribute('text-anchor', 'end');
    }
    for (const share of [0.25, 0.5, 0.75]) {
      const at = y + height * share;
      svg('line', { x1: x, x2: x + width, y1: at, y2: at }, this.#parts.grid);
    }
  }

  #drawCurve() {
    if (!this.#points.length) return;
    const { x, y, width, height } = this.#plot;
    const first = this.#points[0];
    const last = this.#points.at(-1);
    let path = `M${x - 2} ${this.#y(amountOf(first)).toFixed(1)}`;
    for (const point of this.#points) path += `L${this.#clampX(point.value)} ${this.#y(amountOf(point)).toFixed(1)}`;
    path += `L${x + width + 2} ${this.#y(amountOf(last)).toFixed(1)}`;
    this.#parts.curve.setAttribute('d', path);
    this.#parts.area.setAttribute('d', `${path}V${y + height}H${x - 2}Z`);
    this.#drawRamp();
    this.#drawKnots();
  }

  // Clamps far-away knots (a preset that ends at 3071), whose coordinates drawing libraries round badly.
  #clampX(value) {
    return Math.min(1e5, Math.max(-1e5, this.#x(value))).toFixed(1);
  }

  #drawRamp() {
    const { x, width } = this.#plot;
    const { gradient, ramp } = this.#parts;
    const stop = (offset, color) => svg('stop', { offset: offset.toFixed(4), 'stop-color': toHex(color) }, gradient);
    gradient.setAttribute('gradientUnits', 'userSpaceOnUse');
    gradient.setAttribute('x1', x);
    gradient.setAttribute('x2', x + width);
    gradient.replaceChildren();
    const [low, high] = this.#range;
    stop(0, sample(this.#points, low).color);
    for (const { value, color } of this.#points) {
      if (value > low && value < high) stop((value - low) / (high - low), color);
    }
    stop(1, sample(this.#points, high).color);
    ramp.setAttribute('fill', 'url(#ramp-colors)');
  }

  #drawKnots() {
    const { knots } = this.#parts;
    while (knots.children.length > this.#points.length) knots.lastChild.remove();
    while (knots.children.length < this.#points.length) knots.append(newKnot());
    const span = this.#range[1] - this.#range[0];
    this.#points.forEach((point, i) => {
      const knot = knots.children[i];
      const at = this.#x(point.value);
      const { x, width } = this.#plot;
      knot.toggleAttribute('hidden', at < x - 7 || at > x + width + 7);
      knot.setAttribute('transform', `translate(${this.#clampX(point.value)} ${this.#y(amountOf(point)).toFixed(1)})`);
      knot.querySelector('.dot').setAttribute('fill', toHex(point.color));
      knot.setAttribute('class', `knot${i === this.selected ? ' selected' : ''}`);
      knot.setAttribute('tabindex', i === this.selected ? 0 : -1);
      const amount = `${amountName(this.#points)} ${amountOf(point).toPrecision(3)}`;
      knot.setAttribute('aria-label', `Knot ${i + 1} of ${this.#points.length}`);
      knot.setAttribute('aria-valuetext', `value ${formatValue(point.value, span)}, ${amount}`);
      knot.setAttribute('aria-valuenow', point.value);
    });
  }

  #change(points) {
    this.#points = points;
    this.#drawCurve();
    this.#on.change(points, { index: this.selected });
  }

  #add(value, amount, focus) {
    const { points, index } = addKnot(this.#points, value, amount);
    this.#selected = index;
    this.#change(points);
    this.select(index, focus);
  }

  #indexOf(target) {
    const knot = target.closest?.('.knot');
    return knot ? [...this.#parts.knots.children].indexOf(knot) : -1;
  }

  #doubleClick(event) {
    if (this.#indexOf(event.target) >= 0) return;
    const { value, amount, outside } = this.#at(event);
    if (outside <= 0) this.#add(value, amount, false);
    else this.showAll();
  }

  #down(event) {
    if (event.button !== 0) return;
    const index = this.#indexOf(event.target);
    this.#root.setPointerCapture(event.pointerId);
    this.#fingers.set(event.pointerId, event);
    if (this.#fingers.size > 1) {
      this.#pinch();
    } else if (index >= 0) {
      this.select(index, true);
      const { value, amount } = this.#at(event);
      const point = this.#points[index];
      const hold = [point.value - value, amountOf(point) - amount]; // keeps the knot's offset to the pointer
      this.#drag = { kind: 'knot', index, hold, origin: this.#points, removed: false };
      this.#on.gesture(true);
    } else {
      this.#drag = { kind: 'axis', x: event.clientX, range: this.#range };
    }
    event.preventDefault();
  }

  #move(event) {
    if (this.#fingers.has(event.pointerId)) this.#fingers.set(event.pointerId, event);
    if (!this.#drag) return;
    if (this.#drag.kind === 'axis') this.#dragAxis(event);
    else if (this.#drag.kind === 'pinch') this.#dragPinch();
    else this.#dragKnot(event);
  }

  // Each finger holds a value. Ends the drag of a single finger.
  #pinch() {
    if (this.#drag?.kind === 'knot') this.#on.gesture(false);
    const values = [...this.#fingers].slice(0, 2).map(([id, event]) => ({ id, value: this.#at(event).value }));
    this.#drag = { kind: 'pinch', values };
  }

  #dragPinch() {
    const box = this.#root.getBoundingClientRect();
    const { x, width } = this.#plot;
    const place = (id) => (((this.#fingers.get(id).clientX - box.left) / box.width) * this.#size.width - x) / width;
    const range = rangeThrough(this.#drag.values.map(({ id, value }) => ({ value, place: place(id) })));
    if (range) this.setRange(range);
  }

  #dragAxis({ clientX }) {
    const { x, range } = this.#drag;
    const shift = ((clientX - x) / this.#plot.width) * (range[1] - range[0]);
    this.setRange([range[0] - shift, range[1] - shift]);
  }

  #dragKnot(event) {
    const drag = this.#drag;
    const { value, amount, outside } = this.#at(event);
    if (outside > DRAG_OUT_PX && drag.origin.length > 1) {
      if (!drag.removed) this.#change(removeKnot(drag.origin, drag.index));
      drag.removed = true;
      return;
    }
    drag.removed = false;
    this.#selected = drag.index;
    this.#change(moveKnot(drag.origin, drag.index, value + drag.hold[0], amount + drag.hold[1]));
  }

  #up(event) {
    this.#fingers.delete(event.pointerId);
    const drag = this.#drag;
    this.#drag = null;
    if (drag?.kind !== 'knot') return;
    if (drag.removed) this.select(this.selected);
    this.#on.gesture(false);
    event.preventDefault();
  }

  #wheel(event) {
    event.preventDefault();
    const { value } = this.#at(event);
    const factor = Math.exp(Math.sign(event.deltaY) * 0.2);
    const [low, high] = this.#range;
    this.setRange([value - (value - low) * factor, value + (high - value) * factor]);
  }

  #contextMenu(event) {
    event.preventDefault();
    const index = this.#indexOf(event.target);
    if (index >= 0) this.remove(index);
  }

  #focused(event) {
    const index = this.#indexOf(event.target);
    if (index >= 0 && index !== this.#selected) this.select(index);
  }

  #key(event) {
    const index = this.#indexOf(event.target);
    if (index < 0 || event.ctrlKey || event.metaKey || event.altKey) return;
    const step = event.shiftKey ? 10 : 1;
    const value = (this.#range[1] - this.#range[0]) * KEY_STEP * step;
    const amount = amountLimit(this.#points) * 0.01 * step;
    const moves = { ArrowLeft: [-value, 0], ArrowRight: [value, 0], ArrowUp: [0, amount], ArrowDown: [0, -amount] };
    const point = this.#points[index];
    if (moves[event.key]) this.set(point.value + moves[event.key][0], amountOf(point) + moves[event.key][1]);
    else if (event.key === 'Delete' || event.key === 'Backspace') this.#removeByKey(index);
    else if (event.key === 'PageUp' && index > 0) this.select(index - 1, true);
    else if (event.key === 'PageDown' && index < this.#points.length - 1) this.select(index + 1, true);
    else if (event.key === 'Insert' || event.key === 'Enter') this.addNext();
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  #removeByKey(index) {
    this.remove(index);
    this.select(this.selected, true);
  }
}

function newKnot() {
  const knot = svg('g', { role: 'slider', class: 'knot' });
  svg('circle', { class: 'reach', r: 14 }, knot); // touch target
  svg('circle', { class: 'ring', r: 8 }, knot);
  svg('circle', { class: 'dot', r: 5.5 }, knot);
  return knot;
}

function setBox(element, x, y, width, height) {
  for (const [name, value] of Object.entries({ x, y, width, height })) element.setAttribute(name, Math.max(0, value));
}

function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  const lead = least / power;
  return power * (lead > 5 ? 10 : lead > 2 ? 5 : lead > 1 ? 2 : 1);
}
