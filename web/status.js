// The status line and the quality badge: properties of the picture and of its transport.

const FPS_WINDOW_MS = 2000;
const IDLE_MS = 2500; // after this long without a frame no rate is shown

/** Frames per second from the times of the last frames, ms. */
export function frameRate(times) {
  if (times.length < 2) return 0;
  return ((times.length - 1) * 1000) / (times.at(-1) - times[0] || 1);
}

/** "28:1": compression ratio of the frame against 24-bit pixels. */
export function compressionRatio(header, bytes) {
  return `${Math.max(1, Math.round((header.width * header.height * 3) / Math.max(1, bytes)))}:1`;
}

/** @returns {{text: string, lossy: boolean}} what a reader must know about the picture's fidelity */
export function fidelity(header, bytes) {
  if (header.format === 'png') return { text: 'LOSSLESS', lossy: false };
  return { text: `LOSSY q${header.quality} \u00b7 ${compressionRatio(header, bytes)}`, lossy: true };
}

const number = (value) => (value === undefined ? '\u2013' : value >= 100 ? value.toFixed(0) : value.toFixed(1));

const in255 = (value) => (value * 255).toPrecision(2).replace(/e.*/, (power) => power.replace('+', ''));

/**
 * The error meter's result with half of its 95 % interval: "error 0.40/255 \u00b1 0.10, max 3.1 (64 px)", and for
 * surfaces their distance.
 */
export function errorText({ error, unmeasured }) {
  if (unmeasured) return `error not measured: ${unmeasured}`;
  if (!error) return '';
  const spread = (error.high - error.low) / 2;
  return `error ${in255(error.rms)}/255 \u00b1 ${in255(spread)}, max ${in255(error.max)} (${error.pixels} px)${surfaceText(error)}`;
}

/** How far a surface is off, in full: "depth 0.031 mm rms, 99 % within 0.12 mm, outline wrong in 0.10 % of pixels". */
export const depthText = ({ depthRms, depthP99, outline }) =>
  `depth ${depthRms.toPrecision(2)} mm rms, 99 % within ${depthP99.toPrecision(2)} mm, ` +
  `outline wrong in ${(100 * outline).toPrecision(2)} % of pixels`;

const surfaceText = ({ depthRms, depthP99, outline }) =>
  depthP99 === undefined
    ? ''
    : `; depth ${depthRms.toPrecision(2)} mm, 99 % ${depthP99.toPrecision(2)}, outline ${(100 * outline).toPrecision(2)} %`;

/**
 * A line for all surfaces together and, where there are several, one for each: "surface 2: depth 0.031 mm rms, ...", and one for
 * each that is seen through others: "layer 2: depth ..."
 */
export function surfaceLines(error) {
  const { surfaces = [], layers = [] } = error;
  const named = ({ label, surface }) => (label ? `label ${label}` : `surface ${surface + 1}`);
  const each = surfaces.length < 2 ? [] : surfaces.map((one) => `${named(one)}: ${depthText(one)} (${one.pixels} px)`);
  const behind = layers.slice(1).map((one, i) => `layer ${i + 2}: ${depthText(one)} (${one.pixels} px)`);
  return error.depthP99 === undefined ? [] : [depthText(error), ...each, ...behind];
}

export class Status {
  #get;
  #times = [];
  #idle = 0;

  /** get(name): the element with id "stat-" + name; badge: the badge over the picture */
  constructor(get, badge) {
    this.#get = get;
    this.badge = badge;
  }

  connection({ state }) {
    const words = { open: 'connected', connecting: 'connecting', waiting: 'reconnecting', closed: 'offline' };
    this.#get('link').dataset.state = state;
    this.#get('link').textContent = words[state];
  }

  frame({ header, bytes, roundTripMs }) {
    const now = performance.now();
    if (!header.error) this.#times.push(now); // the same picture sent again with its error is not a new one
    while (now - this.#times[0] > FPS_WINDOW_MS) this.#times.shift();
    const { timing = {} } = header;
    this.#set('fps', number(frameRate(this.#times) || undefined));
    if (roundTripMs !== undefined) this.#set('rtt', number(roundTripMs));
    this.#set('render', number(timing.renderMs));
    this.#set('encode', number(timing.encodeMs));
    this.#set('size', `${header.width} \u00d7 ${header.height}`);
    this.#set('phase', header.final ? 'final' : 'interactive');
    this.#set('quality', header.format === 'png' ? 'PNG' : `JPEG q${header.quality}`);
    this.#meter(header);
    const { text, lossy } = fidelity(header, bytes);
    this.badge.hidden = false;
    this.badge.textContent = header.final ? text : `${text} \u00b7 refining`;
    this.badge.className = `badge ${lossy ? 'lossy' : 'lossless'}`;
    clearTimeout(this.#idle);
    this.#idle = setTimeout(() => this.#rest(), IDLE_MS);
  }

  server(text) {
    this.#set('server', text);
  }

  #meter(header) {
    const element = this.#get('error');
    element.textContent = errorText(header);
    element.hidden = !element.textContent;
    const { error } = header;
    const of = error && `largest of ${error.pixels} random pixels: ${in255(error.max)}/255, before rounding to 8 bits`;
    element.title = error ? [of, ...surfaceLines(error)].join('\n') : '';
  }

  #rest() {
    this.#times.length = 0;
    this.#set('fps', '0');
  }

  #set(name, text) {
    this.#get(name).textContent = text;
  }
}
