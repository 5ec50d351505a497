// Pointers, wheel and touch on the picture. Movement is summed here and taken once per display frame by drain().

const WHEEL_LINE_PX = 16;
const WHEEL_PAGE_PX = 400;
const WHEEL_REST_MS = 150; // a wheel has no "up": it has ended after this much rest
const CLICK_SLOP_PX = 4;

/** What a drag does. Slices (MPR) keep the habits of slice viewers, everything else those of 3-D viewers. */
export function dragAction({ button, shiftKey, ctrlKey, metaKey, altKey }, mode) {
  const flat = mode === 'mpr';
  const windowed = flat || mode === 'mip' || mode === 'minip' || mode === 'average';
  if (button === 1 || (button === 0 && shiftKey)) return 'pan';
  if (button === 2) return 'zoom';
  if (button === 0 && (ctrlKey || metaKey)) return windowed ? 'window' : 'roll';
  if (button === 0 && altKey) return 'roll';
  return flat ? 'window' : 'orbit';
}

/** Wheel movement in pixels, whatever the device reports in. */
export function wheelPixels({ deltaY, deltaMode }) {
  return deltaY * (deltaMode === 1 ? WHEEL_LINE_PX : deltaMode === 2 ? WHEEL_PAGE_PX : 1);
}

/** Pan and zoom of two fingers between two moments: each a pair of [x, y]. */
export function pinch(before, after) {
  const middle = ([a, b]) => [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
  const gap = ([a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]);
  const [m0, m1] = [middle(before), middle(after)];
  const factor = gap(before) > 1 && gap(after) > 1 ? gap(after) / gap(before) : 1;
  return { pan: [m1[0] - m0[0], m1[1] - m0[1]], factor };
}

/** What drain() gives, all at rest. Never changed: sums replace its members. */
export const NO_MOVEMENT = Object.freeze({ orbit: [0, 0], pan: [0, 0], window: [0, 0], roll: 0, factor: 1, slices: 0 });
const nothing = () => ({ ...NO_MOVEMENT });

export class Input {
  #element;
  #on;
  #pointers = new Map(); // id -> {x, y} of every finger or button that is down
  #action = null;
  #travel = 0;
  #sum = nothing();
  #moved = false;
  #wheelTimer = 0;
  #sliceRest = 0;

  /** on: mode(); wake() when drain() has something; active(bool) around a gesture; click(x, y) in CSS px */
  constructor(element, on) {
    this.#element = element;
    this.#on = on;
    element.addEventListener('pointerdown', (event) => this.#down(event));
    element.addEventListener('pointermove', (event) => this.#move(event));
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture']) {
      element.addEventListener(name, (event) => this.#up(event));
    }
    element.addEventListener('wheel', (event) => this.#wheel(event), { passive: false });
    element.addEventListener('contextmenu', (event) => event.preventDefault());
    element.addEventListener('auxclick', (event) => event.preventDefault());
  }

  /** @returns the movement since the last call, or null; lengths in CSS pixels, y down */
  drain() {
    if (!this.#moved) return null;
    const sum = this.#sum;
    this.#sum = nothing();
    this.#moved = false;
    return sum;
  }

  #down(event) {
    if (event.pointerType === 'mouse' && this.#pointers.size) return; // a second button changes nothing
    if (event.target.closest('[data-own-pointer]')) return; // buttons and messages over the picture
    this.#element.setPointerCapture(event.pointerId);
    this.#element.focus({ preventScroll: true });
    event.preventDefault();
    if (!this.#pointers.size) {
      this.#action = dragAction(event, this.#on.mode());
      this.#travel = 0;
      this.#on.active(true);
    }
    this.#pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (this.#pointers.size > 1) this.#travel = Infinity;
  }

  #move(event) {
    const pointer = this.#pointers.get(event.pointerId);
    if (!pointer) return;
    if (this.#pointers.size === 2) this.#moveTwo(event, pointer);
    else if (this.#pointers.size === 1) this.#moveOne(event.clientX - pointer.x, event.clientY - pointer.y);
    pointer.x = event.clientX;
    pointer.y = event.clientY;
  }

  #moveOne(dx, dy) {
    this.#travel += Math.hypot(dx, dy);
    const sum = this.#sum;
    if (this.#action === 'zoom') sum.factor *= Math.exp(-dy * 0.006);
    else if (this.#action === 'roll') sum.roll += dx * 0.4;
    else sum[this.#action] = [sum[this.#action][0] + dx, sum[this.#action][1] + dy];
    this.#wake();
  }

  #moveTwo(event, pointer) {
    const points = () => [...this.#pointers.values()].map(({ x, y }) => [x, y]);
    const before = points();
    pointer.x = event.clientX;
    pointer.y = event.clientY;
    const { pan, factor } = pinch(before, points());
    this.#sum.pan = [this.#sum.pan[0] + pan[0], this.#sum.pan[1] + pan[1]];
    this.#sum.factor *= factor;
    this.#wake();
  }

  #up(event) {
    if (!this.#pointers.delete(event.pointerId)) return;
    if (this.#pointers.size) {
      this.#action = dragAction({ button: 0 }, this.#on.mode());
      return;
    }
    this.#on.active(false);
    if (event.type === 'pointerup' && event.button === 0 && this.#travel < CLICK_SLOP_PX) this.#click(event);
  }

  #click(event) {
    const box = this.#element.getBoundingClientRect();
    this.#on.click(event.clientX - box.left, event.clientY - box.top);
  }

  #wheel(event) {
    event.preventDefault();
    const pixels = wheelPixels(event);
    if (this.#on.mode() === 'mpr' && !event.ctrlKey && !event.metaKey) {
      this.#sliceRest += pixels / 50;
      const whole = Math.trunc(this.#sliceRest);
      this.#sliceRest -= whole;
      this.#sum.slices += whole;
    } else {
      this.#sum.factor *= Math.exp(-pixels * (event.ctrlKey ? 0.01 : 0.0015)); // ctrl: a pinch on a track pad
    }
    if (!this.#wheelTimer) this.#on.active(true);
    clearTimeout(this.#wheelTimer);
    this.#wheelTimer = setTimeout(() => {
      this.#wheelTimer = 0;
      this.#on.active(false);
    }, WHEEL_REST_MS);
    this.#wake();
  }

  #wake() {
    this.#moved = true;
    this.#on.wake();
  }
}
