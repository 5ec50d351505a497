// The facade: one volume, one session, one connection. Joins the scene store, the wire and the view.

import { linked } from './access.js';
import { Problem } from './api.js';
import { PacketError, readFrame } from './packets.js';
import { joinPatches } from './state.js';
import { Wire } from './wire.js';

const REFRESH_MS = 300;

/**
 * Events, each one callback in `on`, all but size() optional:
 *   size()                   {width, height} that pictures are wanted in, pixels
 *   session({id, volume})     there is a session, new or found again
 *   connection(state)         see wire.js
 *   frame({header, bytes, roundTripMs?})  a frame is on the canvas
 *   viewOnly()               the user may not change the scene: edits are taken back
 *   pending(count)           so many patches are on their way to a picture
 *   problem(Problem|Error, patch?)        the daemon refused something; the old scene stays
 *   beforeFlush()             last chance to edit the scene before this display frame's patch
 */
export class Client {
  #api;
  #store;
  #view;
  #on;
  #wire = null;
  #volume = '';
  #session = '';
  #viewOnly = false;
  #owned = false; // we made the session and nobody was given its address
  #sequence = 0;
  #sent = new Map(); // sequence -> {at, patch}: not yet seen in a frame
  #active = 0;
  #scheduled = false;
  #others = 0; // changes by others that the last frame knew of
  #refreshTimer = 0;

  constructor({ api, store, view, on }) {
    this.#api = api;
    this.#store = store;
    this.#view = view;
    this.#on = on;
    store.subscribe((_, how) => how !== 'server' && this.flushSoon());
  }

  get session() {
    return this.#session;
  }

  get connected() {
    return this.#wire?.state === 'open';
  }

  /**
   * Address other people can open to see the same session, and with the role "edit" to steer it. Who came by a link
   * hands that on.
   * @throws {Problem}
   */
  async share(role) {
    const url = this.#api.url('');
    const { token } = this.#api;
    this.#owned = false;
    if (linked(token).session === this.#session) {
      url.hash = `share=${token}`;
    } else if (token || role === 'view') {
      const path = `v1/sessions/${encodeURIComponent(this.#session)}/share`;
      url.hash = `share=${(await this.#api.json('POST', path, { json: { role } })).token}`;
    } else {
      url.searchParams.set('session', this.#session); // a daemon without tokens needs no link
    }
    return url.href;
  }

  /** Starts a session of our own. `scene` may be partial. @throws {Problem} */
  async create(volume, scene) {
    const made = await this.#ask(volume, scene); // first: when it is refused, the old session goes on
    this.leave();
    this.#adopt(made, volume);
    this.#start();
  }

  /** Joins a session that exists. @throws {Problem} */
  async join(session) {
    this.leave();
    const found = await this.#api.json('GET', `v1/sessions/${encodeURIComponent(session)}`);
    this.#session = session;
    this.#volume = found.volume;
    this.#owned = false;
    await this.#refresh();
    this.#on.session?.({ id: session, volume: this.#volume });
    this.#start();
  }

  /** Ends the connection, and the session where it was ours alone. Safe to call as the page closes. */
  leave() {
    this.#wire?.close();
    this.#wire = null;
    clearTimeout(this.#refreshTimer);
    if (this.#session && this.#owned) {
      const path = `v1/sessions/${encodeURIComponent(this.#session)}`;
      this.#api.fetch('DELETE', path, { keepalive: true }).catch(() => {});
    }
    this.#session = '';
    this.#sent.clear();
    this.#store.take();
    this.#view.forget();
  }

  retryNow() {
    this.#wire?.retryNow();
  }

  /** Between active(true) and active(false) the daemon may trade quality for speed. Calls nest. */
  active(on) {
    const before = this.#active;
    this.#active = Math.max(0, before + (on ? 1 : -1));
    if (before > 0 === this.#active > 0) return;
    if (!on) this.#flush(); // the last movement belongs to the gesture
    this.#wire?.send({ type: 'pointer', phase: on ? 'start' : 'end' });
  }

  /** Gives up what the next picture waits for. */
  cancel() {
    this.#wire?.send({ type: 'cancel' });
  }

  /** Sends what was edited with the next display frame: at most one patch each. */
  flushSoon() {
    if (this.#scheduled) return;
    this.#scheduled = true;
    requestAnimationFrame(() => {
      this.#scheduled = false;
      this.#flush();
    });
  }

  /** Has the session show another volume, with its scene as it is. @throws {Problem} */
  show(volume) {
    return this.#api.fetch('PATCH', `v1/sessions/${encodeURIComponent(this.#session)}`, { json: { volume } });
  }

  /** Replaces the whole scene, for "load scene". @throws {Problem} naming what is wrong with it */
  async putScene(scene) {
    await this.#api.fetch('PUT', `v1/sessions/${encodeURIComponent(this.#session)}/scene`, { json: scene });
    this.#store.take();
    await this.#refresh();
  }

  #flush() {
    this.#on.beforeFlush?.();
    if (!this.connected || !this.#store.dirty) return; // kept until there is a connection
    const patch = this.#store.take();
    if (this.#viewOnly) {
      this.#refreshSoon(0);
      return;
    }
    this.#sequence += 1;
    this.#sent.set(this.#sequence, { at: performance.now(), patch });
    this.#wire.send({ type: 'patch', seq: this.#sequence, scene: patch });
    this.#on.pending?.(this.#sent.size);
  }

  #ask(volume, scene) {
    if (scene?.labels?.volume) scene = { ...scene, labels: { ...scene.labels, force: true } }; // it was taken before
    return this.#api.json('POST', 'v1/sessions', { json: scene ? { volume, scene } : { volume } });
  }

  #adopt({ id, scene }, volume) {
    this.#session = id;
    this.#volume = volume;
    this.#owned = true;
    this.#sent.clear();
    this.#store.replace(scene);
    this.#on.session?.({ id, volume });
  }

  #start() {
    let known = true; // it was there a moment ago
    const address = () => {
      const found = known ? this.#address() : this.#locate();
      known = false;
      return found;
    };
    this.#wire = new Wire(address, {
      onOpen: () => this.#opened(),
      onText: (message) => this.#text(message),
      onBytes: (bytes) => this.#bytes(bytes),
      onState: (state) => this.#on.connection?.(state),
    });
    this.#wire.open();
  }

  // Before every attempt but the first: is the session still there? A daemon that was restarted may not know it; then the scene this
  // client holds becomes a new one, and the user goes on where they were.
  async #locate() {
    try {
      await this.#api.json('GET', `v1/sessions/${encodeURIComponent(this.#session)}`);
    } catch (error) {
      if (error.status !== 404) throw final(error);
      const made = await this.#ask(this.#volume, this.#store.scene).catch((refusal) => {
        throw final(refusal);
      });
      this.#adopt(made, this.#volume);
    }
    return this.#address();
  }

  async #address() {
    this.#viewOnly = linked(this.#api.token).role === 'view';
    return { url: await this.#api.streamUrl(this.#session) };
  }

  #opened() {
    this.#view.forget();
    this.#others = 0;
    const lost = [...this.#sent.values()].map(({ patch }) => patch).reduce((a, b) => (a ? joinPatches(a, b) : b), null);
    this.#sent.clear();
    this.#on.pending?.(0);
    if (lost) this.#store.requeue(lost);
    this.resize();
    if (this.#active) this.#wire.send({ type: 'pointer', phase: 'start' });
    this.#flush();
  }

  #text(message) {
    if (message.type === 'error') this.#refused(message);
    if (message.type === 'building') this.#on.building?.(message);
    if (message.type === 'hello' && (this.#viewOnly = message.role === 'view')) this.#on.viewOnly?.();
  }

  #refused({ seq, problem }) {
    const patch = this.#sent.get(seq)?.patch;
    this.#sent.delete(seq);
    this.#on.pending?.(this.#sent.size);
    this.#on.problem?.(new Problem(problem?.status ?? 400, problem ?? {}), patch);
    this.#refreshSoon(0); // the daemon kept its old scene: so do we
  }

  #bytes(bytes) {
    let frame;
    try {
      frame = readFrame(bytes);
      if (frame.need) throw new PacketError('frame: message ended inside its header');
    } catch (error) {
      this.#on.problem?.(error);
      return;
    }
    this.#view.receive(frame);
  }

  /** The view has drawn a frame. */
  drawn({ header, bytes }) {
    const now = performance.now();
    const own = this.#sent.get(header.seq);
    for (const sequence of this.#sent.keys()) if (sequence <= header.seq) this.#sent.delete(sequence);
    if (header.others !== this.#others) this.#refreshSoon();
    this.#others = header.others;
    this.#on.pending?.(this.#sent.size);
    this.#on.frame?.({ header, bytes, roundTripMs: own ? now - own.at : undefined });
  }

  /** Tells the size of the pictures this page wants; others of the session have theirs. */
  resize() {
    this.#wire?.send({ type: 'size', ...this.#on.size() });
  }

  acknowledge(frame) {
    this.#wire?.send({ type: 'ack', frame });
  }

  #refreshSoon(ms = REFRESH_MS) {
    clearTimeout(this.#refreshTimer);
    this.#refreshTimer = setTimeout(() => this.#refresh().catch(() => {}), ms);
  }

  // Edits still on their way stay on top, so a refresh never pulls a slider back under the user's finger.
  async #refresh() {
    const session = this.#session;
    const scene = await this.#api.json('GET', `v1/sessions/${encodeURIComponent(session)}/scene`);
    if (session !== this.#session) return;
    if (this.#active) {
      this.#refreshSoon(); // not under a moving finger
      return;
    }
    this.#store.replace(
      scene,
      [...this.#sent.values()].map(({ patch }) => patch),
    );
  }
}

/** Trying again helps nobody who is not let in. */
function final(error) {
  return Object.assign(error, { fatal: error.status === 401 || error.status === 403 });
}
