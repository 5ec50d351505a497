// One person at the page: a session of their own, patches at the display's rate while the hand moves, every frame
// confirmed on the display beat after it came, as web/view.js does.

const BEAT_MS = 1000 / 60;
const DECODE_MS = 3; // what the page spends between a frame's arrival and its being ready to draw
const AGAIN_MS = 500;
const PING_MS = 1000;
const MOST_SAMPLES = 200000;

/** Which patches a frame answers: a frame whose header says `seq` shows that patch and every one before it. */
export class Unanswered {
  #sent = new Map(); // seq -> ms, ascending

  add(seq, at) { this.#sent.set(seq, at); }
  get size() { return this.#sent.size; }

  /** @returns [[sent, waited]...] of the patches that this frame is the first to show */
  answer(seq, at) {
    const found = [];
    for (const [number, sent] of this.#sent) {
      if (number > seq) break;
      this.#sent.delete(number);
      found.push([sent, at - sent]);
    }
    return found;
  }

  drop(seq) { this.#sent.delete(seq); }

  /** All that no frame showed, with their age at `at`. */
  rest(at) { return [...this.#sent.values()].map((sent) => [sent, at - sent]); }
  clear() { this.#sent.clear(); }
}

export class Client {
  latencies = []; // [patch sent, ms until a frame showed it]
  frames = []; // {at, bytes, final, queueMs, tablesMs, renderMs, encodeMs}
  pings = []; // ms there and back over the stream
  errors = new Map();
  record = null; // [{t, patch}] of what is sent, where wanted
  #unanswered = new Unanswered();
  #confirm = [];
  #timers = new Set();
  #seq = 0;
  #active = false;
  #ended = false;

  /** motionOf(scene) gives the motion (motion.mjs); rate: patches a second while the hand moves; look: of the scene */
  constructor({ target, volume, image, look = {}, motionOf, rate }) {
    Object.assign(this, { target, volume, scene: { ...look, image }, motionOf, rate });
  }

  /** Makes the session and the stream. @throws {Trouble} */
  async open() {
    const made = await this.target.json('POST', '/v1/sessions', { volume: this.volume, scene: this.scene });
    this.session = made.id;
    this.motion = this.motionOf(made.scene);
    await this.#connect();
  }

  /** Begins to move. Patches are due at fixed times, so that a slow reply does not slow the asking. */
  start() {
    const began = performance.now();
    let step = 0;
    const next = () => {
      if (this.#ended) return;
      this.#move(performance.now() - began);
      step = Math.max(step + 1, Math.floor(((performance.now() - began) * this.rate) / 1000)); // a missed beat is missed
      this.#later((step * 1000) / this.rate - (performance.now() - began), next);
    };
    next();
    const ping = () => {
      this.#send({ type: 'ping', t: performance.now() });
      this.#later(PING_MS, ping);
    };
    ping();
  }

  /** The hand rests; frames are still taken. */
  rest() {
    this.motion = () => null;
    this.#move(0);
  }

  get waiting() { return this.#unanswered.size; }

  /** Patches no frame has shown by now count with their age, or a daemon that stalls would look good. */
  giveUp() {
    const rest = this.#unanswered.rest(performance.now());
    this.latencies.push(...rest);
    this.#unanswered.clear();
    return rest.length;
  }

  async close() {
    this.#ended = true;
    for (const timer of this.#timers) clearTimeout(timer);
    this.ws?.cut();
    await this.target.request('DELETE', `/v1/sessions/${this.session}`, { patienceMs: 2000 }).catch(() => {});
  }

  fail(kind) { this.errors.set(kind, (this.errors.get(kind) ?? 0) + 1); }

  async #connect() {
    this.ws = await this.target.stream(this.session, { onMessage: (message) => this.#take(message) });
    this.ws.ended.then(({ code }) => {
      if (this.#ended) return;
      this.fail(`stream closed (${code})`);
      this.#unanswered.clear();
      this.#later(AGAIN_MS, () => this.#connect().catch(() => this.fail('stream refused')));
    });
  }

  #move(ms) {
    const patch = this.motion(ms);
    if (!!patch !== this.#active) {
      this.#active = !!patch;
      this.#send({ type: 'pointer', phase: patch ? 'start' : 'end' });
      if (!patch) this.record?.push({ t: Math.round(ms), patch: null });
    }
    if (!patch || this.ws.closed) return;
    this.record?.push({ t: Math.round(ms), patch });
    this.#unanswered.add(++this.#seq, performance.now());
    this.ws.patch(this.#seq, patch);
  }

  #send(message) {
    if (!this.ws.closed) this.ws.send(message);
  }

  #take(message) {
    const at = performance.now();
    if (message.header) this.#frame(message, at);
    else if (message.type === 'pong') this.pings.push(at - message.t);
    else if (message.type === 'error') {
      this.fail(`patch refused (${message.problem?.status ?? 'no status'})`);
      this.#unanswered.drop(message.seq);
    }
  }

  #frame({ header, image }, at) {
    if (this.frames.length < MOST_SAMPLES) {
      this.frames.push({ at, bytes: image.length, final: header.final, width: header.width, ...header.timing });
      this.latencies.push(...this.#unanswered.answer(header.seq, at));
    }
    this.#confirm.push(header.frame);
    if (this.#confirm.length > 1) return;
    const beat = BEAT_MS - ((at + DECODE_MS) % BEAT_MS);
    this.#later(DECODE_MS + beat, () => {
      for (const frame of this.#confirm.splice(0)) this.#send({ type: 'ack', frame });
    });
  }

  #later(ms, what) {
    const timer = setTimeout(() => {
      this.#timers.delete(timer);
      if (!this.#ended) what();
    }, Math.max(0, ms));
    this.#timers.add(timer);
  }
}
