// Cine: turns the picture, or scrolls the slices, until the user takes over.

const TURN_DEGREES_S = 36;
const SLICES_S = 10;
const LONGEST_S = 0.1; // longest time step, so that a hidden tab does not jump

export class Cine {
  #on;
  #timer = 0;
  #last = 0;
  #rest = 0; // fraction of a slice

  /** on: mode(), undefined without a scene; gesture(bool); move({orbit} or {slices}); atEnd() of the slices */
  constructor(on) {
    this.#on = on;
  }

  get running() {
    return this.#timer !== 0;
  }

  toggle() {
    if (this.running) {
      this.stop();
      return;
    }
    this.#on.gesture(true);
    this.#last = performance.now();
    this.#next();
  }

  stop() {
    if (!this.running) return;
    cancelAnimationFrame(this.#timer);
    this.#timer = 0;
    this.#on.gesture(false);
  }

  #next() {
    this.#timer = requestAnimationFrame((now) => {
      const seconds = Math.min(LONGEST_S, Math.max(0, (now - this.#last) / 1000));
      this.#last = now;
      if (this.#on.mode() === 'mpr') this.#slices(seconds);
      else this.#on.move({ orbit: [-seconds * TURN_DEGREES_S, 0] });
      this.#next();
    });
  }

  #slices(seconds) {
    this.#rest += seconds * SLICES_S;
    const whole = Math.trunc(this.#rest);
    this.#rest -= whole;
    if (whole) this.#on.move({ slices: this.#on.atEnd() ? -Infinity : whole });
  }
}
