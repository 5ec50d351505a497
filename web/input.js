// Pointers, wheel and touch on the picture. Movements are summed here and fetched once per display frame by drain().

import { dragChord, wheelChord } from './bindings.js';

const WHEEL_REST_MS = 150; // a wheel has no "up" event: its gesture ends after this long
const LATE_MS = 50; // a timer that fires later than this shows that the page was busy
const CLICK_SLOP_PX = 4;
const TWICE_MS = 400; // between the clicks of a double click
const TWICE_SLOP_PX = 24; // a finger does not hit the same pixel twice
const ORBIT_DEGREES = 0.45; // per CSS pixel
const ROLL_DEGREES = 0.4;
const NOTCH_ZOOM = Math.log(1.22);
const MOST_NOTCH_ZOOM = Math.log(1.25); // per wheel event with Ctrl; pinching a track pad sends many small ones
const RADIANS = Math.PI / 180;

/**
 * Notches of a wheel: whole ones; the smaller steps of a track pad are fractions. Reads deltaMode first, since Firefox
 * reports lines only then.
 */
export function notches({ deltaMode, deltaY }) {
  const size = Math.abs(deltaY);
  if (deltaMode === 0 && size < 40) return deltaY / 50;
  const whole = Math.round(deltaMode === 0 ? size / 110 : deltaMode === 1 ? size / 3 : size * 3);
  return size ? Math.sign(deltaY) * Math.max(1, whole) : 0;
}

/** Zoom factor of one wheel event; `fine`: with Ctrl. */
export function wheelFactor(event, fine) {
  const turned = notches(event);
  if (!fine) return Math.exp(-turned * NOTCH_ZOOM);
  const most = MOST_NOTCH_ZOOM * Math.max(1, Math.abs(turned));
  return Math.exp(Math.min(most, Math.max(-most, -event.deltaY * (event.deltaMode ? 0.4 : 0.01))));
}

/**
 * Movement of two fingers between two moments, each a pair of [x, y]: shift of their middle, zoom, degrees (clockwise).
 */
export function pinch(before, after) {
  const middle = ([a, b]) => [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
  const gap = ([a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]);
  const angle = ([a, b]) => Math.atan2(b[1] - a[1], b[0] - a[0]) / RADIANS;
  const [m0, m1] = [middle(before), middle(after)];
  const apart = gap(before) > 1 && gap(after) > 1;
  const turned = angle(after) - angle(before);
  return {
    at: m0,
    pan: [m1[0] - m0[0], m1[1] - m0[1]],
    factor: apart ? gap(after) / gap(before) : 1,
    roll: apart ? turned - 360 * Math.round(turned / 360) : 0,
  };
}

/**
 * The result of drain() without movement. Immutable: sums replace its members. orbit and roll in degrees, pan and
 * window in CSS pixels. factor, roll and pan are one map of the picture: scaled and rotated about its middle, then
 * shifted.
 */
export const NO_MOVEMENT = Object.freeze({ orbit: [0, 0], pan: [0, 0], window: [0, 0], roll: 0, factor: 1, slices: 0 });

/**
 * The map `sum`, followed by a map that scales and rotates about `at` (from the picture's middle) and shifts by `pan`.
 */
export function compose(sum, { factor = 1, roll = 0, at = [0, 0], pan = [0, 0] }) {
  const [c, s] = [factor * Math.cos(roll * RADIANS), factor * Math.sin(roll * RADIANS)];
  const [x, y] = [sum.pan[0] - at[0], sum.pan[1] - at[1]];
  return {
    ...sum,
    factor: sum.factor * factor,
    roll: sum.roll + roll,
    pan: [c * x - s * y + at[0] + pan[0], s * x + c * y + at[1] + pan[1]],
  };
}

export class Input {
  #element;
  #bindings;
  #on;
  #pointers = new Map(); // id -> {x, y} from the picture's middle, of every finger or button that is down
  #action = null;
  #start = [0, 0];
  #handle = null; // the element of the cube under the pointerdown
  #travel = 0;
  #sum = NO_MOVEMENT;
  #wheelTimer = 0;
  #rest = 0; // fraction of a slice
  #last = { at: -Infinity, x: 0, y: 0 }; // of the last click

  /**
   * on: mode(); wake() when drain() has movement; active(bool) around a gesture; click(x, y) and doubleClick(x, y) in
   * CSS px; slicePixels(): distance a finger moves per slice
   */
  constructor(element, bindings, on) {
    this.#element = element;
    this.#bindings = bindings;
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

  /** @returns the movement since the last call, or null; y down */
  drain() {
    const sum = this.#sum;
    this.#sum = NO_MOVEMENT;
    return sum === NO_MOVEMENT ? null : sum;
  }

  #place({ clientX, clientY }) {
    const { left, top, width, height } = this.#element.getBoundingClientRect();
    return { x: clientX - left - width / 2, y: clientY - top - height / 2 };
  }

  #down(event) {
    if (event.pointerType === 'mouse' && this.#pointers.size) return; // a second button has no effect
    if (event.target.closest('[data-own-pointer]')) return; // buttons and messages over the picture
    this.#handle = event.target.closest('[data-turns]') ? event.target : null;
    this.#element.setPointerCapture(event.pointerId);
    this.#element.focus({ preventScroll: true });
    event.preventDefault();
    const place = this.#place(event);
    if (!this.#pointers.size) {
      this.#start = [place.x, place.y];
      this.#action = this.#handle ? 'orbit' : this.#does(dragChord(event));
      this.#travel = 0;
      this.#on.active(true);
    }
    this.#pointers.set(event.pointerId, place);
    if (this.#pointers.size > 1) this.#travel = Infinity;
  }

  #does(chord) {
    return this.#bindings.find(chord, this.#on.mode())?.does;
  }

  #move(event) {
    const pointer = this.#pointers.get(event.pointerId);
    if (!pointer) return;
    const place = this.#place(event);
    const fingers = this.#pointers.size;
    const [dx, dy] = [(place.x - pointer.x) / fingers, (place.y - pointer.y) / fingers]; // of the fingers' middle
    if (fingers === 2) this.#two(event.pointerId, place);
    else this.#drag(fingers === 1 ? this.#action : (this.#does('Three fingers') ?? 'pan'), dx, dy);
    this.#pointers.set(event.pointerId, place);
  }

  #two(id, place) {
    const pair = (points) => [...points].map(([, { x, y }]) => [x, y]);
    const before = pair(this.#pointers);
    const moved = pinch(before, pair(new Map(this.#pointers).set(id, place)));
    if (this.#on.mode() === 'mpr') moved.roll = 0; // the plane determines a slice's up direction
    this.#add(compose(this.#sum, moved));
  }

  #drag(action, dx, dy) {
    this.#travel += Math.hypot(dx, dy);
    const { orbit, window } = this.#sum;
    if (action === 'pan') this.#add(compose(this.#sum, { pan: [dx, dy] }));
    else if (action === 'zoom') this.#add(compose(this.#sum, { factor: Math.exp(-dy * 0.006), at: this.#start }));
    else if (action === 'roll') this.#add(compose(this.#sum, { roll: dx * ROLL_DEGREES }));
    else if (action === 'scroll') this.#scroll(dy / this.#on.slicePixels());
    else if (action === 'window') this.#add({ ...this.#sum, window: [window[0] + dx, window[1] + dy] });
    else if (action === 'orbit')
      this.#add({ ...this.#sum, orbit: [orbit[0] + dx * ORBIT_DEGREES, orbit[1] + dy * ORBIT_DEGREES] });
  }

  #scroll(slices) {
    this.#rest += slices;
    const whole = Math.trunc(this.#rest);
    this.#rest -= whole;
    this.#add({ ...this.#sum, slices: this.#sum.slices + whole });
  }

  #up(event) {
    const place = this.#pointers.get(event.pointerId);
    if (!this.#pointers.delete(event.pointerId)) return;
    if (this.#pointers.size) {
      this.#action = this.#does(dragChord(event));
      return;
    }
    this.#rest = 0;
    this.#on.active(false);
    if (event.type === 'pointerup' && event.button === 0 && this.#travel < CLICK_SLOP_PX) this.#click(event, place);
  }

  #click({ timeStamp }, place) {
    if (this.#handle) {
      this.#handle.dispatchEvent(new MouseEvent('click', { bubbles: true })); // the stage had captured the pointer
      return;
    }
    const { width, height } = this.#element.getBoundingClientRect();
    const [x, y] = [place.x + width / 2, place.y + height / 2];
    const { at, x: x0, y: y0 } = this.#last;
    const twice = timeStamp - at < TWICE_MS && Math.hypot(x - x0, y - y0) < TWICE_SLOP_PX;
    this.#last = { at: twice ? -Infinity : timeStamp, x, y };
    if (twice) this.#on.doubleClick(x, y);
    else this.#on.click(x, y);
  }

  #wheel(event) {
    if (event.target.closest('[data-own-pointer]')) return;
    event.preventDefault();
    const action = this.#does(wheelChord(event));
    const { x, y } = this.#place(event);
    const factor = wheelFactor(event, event.ctrlKey);
    if (action === 'scroll') this.#scroll(notches(event));
    else if (action === 'zoom') this.#add(compose(this.#sum, { factor, at: [x, y] }));
    if (!this.#wheelTimer) this.#on.active(true);
    this.#restWheel(true);
  }

  /** Ends the wheel's gesture after a rest. `again`: waits once more if the page was busy, since wheel events may still be queued. */
  #restWheel(again) {
    const due = performance.now() + WHEEL_REST_MS;
    clearTimeout(this.#wheelTimer);
    this.#wheelTimer = setTimeout(() => {
      if (again && performance.now() > due + LATE_MS) {
        this.#restWheel(false);
        return;
      }
      this.#wheelTimer = 0;
      this.#on.active(false);
    }, WHEEL_REST_MS);
  }

  #add(sum) {
    this.#sum = sum;
    this.#on.wake();
  }
}
