// Facade of the client: one volume, one session, one connection. Connects the scene store, the wire and the view.

import { linked } from './access.js';
import { Problem } from './api.js';
import { PacketError, readFrame } from './packets.js';
import { joinPatches } from './state.js';
import { Wire } from './wire.js';

const REFRESH_MS = 300;

/**
 * Events: one callback each in `on`, all but size() optional:
 *   size()                   {width, height} of the pictures wanted, pixels
 *   session({id, volume})     a session was created or joined
 *   connection(state)         see wire.js
 *   frame({header, bytes, roundTripMs?})  a frame is on the canvas
 *   viewOnly()               the user may not change the scene: edits are undone
 *   pending(count)           number of patches without a picture so far
 *   problem(Problem|Error, patch?)        the daemon refused a patch; the old scene stays
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
  #owned = false; // created here and not shared
  #sequence = 0;
  #sent = new Map(); // sequence -> {at, patch} without a frame so far
  #active = 0;
  #scheduled = false;
  #others = 0; // changes by others up to the last frame
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
   * URL that opens the same session for others, with the role "edit" to edit it. For a user who came by a link, that
   * link.
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
      url.searchParams.set('session', this.#session); // without tokens the id is enough
    }
    return url.href;
  }

  /** Creates a session. `scene` may be partial. @throws {Problem} */
  async create(volume, scene) {
    const made = await this.#ask(volume, scene); // before leaving, so that a refusal keeps the old session
    this.leave();
    this.#adopt(made, volume);
    this.#start();
  }

  /** Joins an existing session. @throws {Problem} */
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

  /** Closes the connection, and ends the session if it was created here and not shared. Works while the page closes. */
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

  /** Cancels the build that the next picture waits for. */
  cancel() {
    this.#wire?.send({ type: 'cancel' });
  }

  /** Sends the edits with the next display frame: at most one patch per frame. */
  flushSoon() {
    if (this.#scheduled) return;
    this.#scheduled = true;
    requestAnimationFrame(() => {
      this.#scheduled = false;
      this.#flush();
    });
  }

  /** Switches the session to another volume, keeping its scene. @throws {Problem} */
  show(volume) {
    return this.#api.fetch('PATCH', `v1/sessions/${encodeURIComponent(this.#session)}`, { json: { volume } });
  }

  /** Replaces the whole scene, for "load scene". @throws {Problem} for an invalid scene */
  async putScene(scene) {
    await this.#api.fetch('PUT', `v1/sessions/${encodeURIComponent(this.#session)}/scene`, { json: scene });
    this.#store.take();
    await this.#refresh();
  }

  #flush() {
    this.#on.beforeFlush?.();
    if (!this.connected || !this.#store.dirty) return; // kept until connected
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
    if (scene?.labels?.volume) scene = { ...scene, labels: { ...scene.labels, force: true } }; // accepted before
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
    let known = true; // the session existed a moment ago
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

  // Before every attempt but the first: checks that the session exists. If the daemon was restarted, creates a new
  // session with this client's scene, so that the user can continue.
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
    this.#refreshSoon(0); // the daemon kept its scene, so fetch it
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

  /** A frame is on the canvas. */
  drawn({ header, bytes }) {
    const now = performance.now();
    const own = this.#sent.get(header.seq);
    for (const sequence of this.#sent.keys()) if (sequence <= header.seq) this.#sent.delete(sequence);
    if (header.others !== this.#others) this.#refreshSoon();
    this.#others = header.others;
    this.#on.pending?.(this.#sent.size);
    this.#on.frame?.({ header, bytes, roundTripMs: own ? now - own.at : undefined });
  }

  /** Sends the size of the pictures wanted; other viewers of the session have their own. */
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

  // Edits not yet in a picture stay on top, so that a refresh never moves a slider under the user's finger.
  async #refresh() {
    const session = this.#session;
    const scene = await this.#api.json('GET', `v1/sessions/${encodeURIComponent(session)}/scene`);
    if (session !== this.#session) return;
    if (this.#active) {
      this.#refreshSoon(); // not during a gesture
      return;
    }
    this.#store.replace(
      scene,
      [...this.#sent.values()].map(({ patch }) => patch),
    );
  }
}

/** Without permission a retry is useless. */
function final(error) {
  return Object.assign(error, { fatal: error.status === 401 || error.status === 403 });
}
