// A WebSocket that reconnects: detects silence, waits longer after each failure, reports a countdown.

const PROTOCOL = 'tomocast.v1';
const PING_MS = 15000; // interval of pings on a quiet connection
const SILENCE_MS = 30000; // without a sign of life for this long the connection is closed
const OPEN_MS = 8000; // time limit of an attempt
const WAITS_MS = [500, 1000, 2000, 4000, 8000]; // before attempt 1, 2, ...; the last value repeats

/** Wait before attempt n = 0, 1, 2... */
export const waitBefore = (attempt) => WAITS_MS[Math.min(attempt, WAITS_MS.length - 1)];

/**
 * Callbacks, all optional: onText(object), onBytes(Uint8Array), onOpen(), onState({state, inMs, reason}). state is
 * "connecting", "open", "waiting" (inMs until the next attempt) or "closed". `locate` is async and returns the address
 * for the next attempt; if it throws, the attempt has failed, and an error with `fatal` set ends the attempts.
 */
export class Wire {
  #locate;
  #on;
  #Socket;
  #socket = null;
  #attempt = 0;
  #timers = new Set();
  #generation = 0; // callbacks of older sockets and timers are ignored
  state = 'closed';

  constructor(locate, callbacks, Socket = globalThis.WebSocket) {
    this.#locate = locate;
    this.#on = callbacks;
    this.#Socket = Socket;
  }

  async open() {
    const generation = this.#reset();
    this.#setState('connecting');
    let address;
    try {
      address = await this.#locate();
    } catch (error) {
      if (generation === this.#generation) this.#failed(error);
      return;
    }
    if (generation === this.#generation) this.#connect(address, generation);
  }

  /** Tries immediately instead of waiting for the countdown. */
  retryNow() {
    if (this.state === 'waiting') this.open();
  }

  /** @returns {boolean} false without an open connection; nothing is queued then */
  send(message) {
    if (this.state !== 'open') return false;
    this.#socket.send(JSON.stringify(message));
    return true;
  }

  close() {
    this.#reset();
    this.#setState('closed');
  }

  #connect({ url, protocols = [] }, generation) {
    const socket = new this.#Socket(url, [PROTOCOL, ...protocols]);
    socket.binaryType = 'arraybuffer';
    this.#socket = socket;
    const current = () => generation === this.#generation;
    const late = this.#later(OPEN_MS, () => this.#failed(new Error('no answer')));
    let heard = 0;
    socket.onopen = () => {
      if (!current()) return;
      this.#cancel(late);
      this.#attempt = 0;
      heard = Date.now();
      this.#setState('open');
      this.#watch(() => heard);
      this.#on.onOpen?.();
    };
    socket.onmessage = ({ data }) => {
      if (!current()) return;
      heard = Date.now();
      if (typeof data === 'string') this.#text(data);
      else this.#on.onBytes?.(new Uint8Array(data));
    };
    socket.onclose = ({ code, reason }) => {
      if (current()) this.#failed(new Error(reason || (code === 1006 ? 'connection lost' : `closed (${code})`)));
    };
  }

  #text(data) {
    let message;
    try {
      message = JSON.parse(data);
    } catch {
      return; // an unreadable message is no reason to drop the picture
    }
    if (message && typeof message === 'object') this.#on.onText?.(message);
  }

  #watch(heard) {
    this.#later(PING_MS, () => {
      if (Date.now() - heard() >= SILENCE_MS) {
        this.#failed(new Error('the server is silent'));
        return;
      }
      this.send({ type: 'ping', t: Date.now() });
      this.#watch(heard);
    });
  }

  #failed(error) {
    this.#reset();
    if (error.fatal) {
      this.#setState('closed', { reason: error.message });
      return;
    }
    const inMs = waitBefore(this.#attempt++);
    this.#setState('waiting', { inMs, reason: error.message });
    this.#later(inMs, () => this.open());
  }

  #setState(state, extra = {}) {
    this.state = state;
    this.#on.onState?.({ state, ...extra });
  }

  #later(ms, fn) {
    const timer = setTimeout(() => {
      this.#timers.delete(timer);
      fn();
    }, ms);
    this.#timers.add(timer);
    return timer;
  }

  #cancel(timer) {
    clearTimeout(timer);
    this.#timers.delete(timer);
  }

  #reset() {
    for (const timer of this.#timers) clearTimeout(timer);
    this.#timers.clear();
    const socket = this.#socket;
    this.#socket = null;
    this.#generation += 1;
    if (socket) {
      socket.onopen = socket.onmessage = socket.onclose = null;
      socket.close();
    }
    return this.#generation;
  }
}
