// Opens a volume from a name, a file or an address: loading, uploading, joining, with progress and cancel.

import { linked } from './access.js';
import { readHash } from './address.js';
import { fit, volumeBox } from './camera.js';
import { nameOf } from './local_names.js';
import { formatBytes, isMesh, uploadId } from './volumes.js';
import { droppedFiles, zip } from './zip.js';

const KEPT_SCENE = 'tomocast.scene'; // in sessionStorage, which lasts for a reload of this tab only

export class Opening {
  volume = null; // description of the volume shown
  box = null;
  #get;
  #api;
  #client;
  #store;
  #volumes;
  #names;
  #on;
  #abort = null; // of the current load

  /** on: shown(volume, box, histogram), opened(id, {joined}), failed(error, name of the file), toast(text, options), size() -> {width, height} px, aspect() */
  constructor({ get, api, client, store, volumes, names, on }) {
    this.#get = get;
    this.#api = api;
    this.#client = client;
    this.#store = store;
    this.#volumes = volumes;
    this.#names = names;
    this.#on = on;
  }

  /**
   * Opens the session of a share link, or what the address names: ?session=ID, #volume, or the only volume.
   * @returns false if the user has to choose
   */
  async fromAddress({ search, hash }) {
    const session = linked(this.#api.token).session || new URLSearchParams(search).get('session');
    const { volume, view } = readHash(hash);
    if (session) await this.join(session, volume, view);
    else if (volume) await this.open(volume, { scene: this.#kept(volume), view });
    else return this.#only();
    return true;
  }

  /** scene: from this tab before a reload; view: the scene members in the address */
  async open(id, { scene = null, view = null } = {}) {
    this.#abort?.abort();
    const abort = (this.#abort = new AbortController());
    try {
      this.#progress(`Loading ${id}`);
      const early = this.#volumes.histogram(id).catch(() => null); // in parallel with the description
      const found = await this.#volumes.bring(
        id,
        (fraction) => this.#progress(`Loading ${id}`, fraction),
        abort.signal,
      );
      const histogram = (await early) ?? (await this.#volumes.histogram(id).catch(() => null));
      if (abort.signal.aborted) return;
      const { labels } = scene ?? view ?? {};
      if (labels?.volume) await this.#volumes.bring(labels.volume, () => {}).catch(() => {}); // reported below
      const asked = await this.#create(id, scene ?? view);
      this.#show(found, histogram);
      if (!asked?.camera)
        this.#store.patch({ camera: fit(this.#store.scene.camera, this.box, this.#on.aspect()) }, 'fit');
      this.#on.opened(id, { joined: false });
    } catch (error) {
      if (error.name !== 'AbortError') this.#on.failed(error);
    } finally {
      if (this.#abort === abort) this.#done();
    }
  }

  /** Creates a session with a partial scene. @returns that scene, null if the daemon refused the one of an address */
  async #create(id, asked) {
    const image = { ...(asked?.image ?? {}), ...this.#on.size() };
    try {
      await this.#client.create(id, { ...(asked ?? {}), image });
      return asked;
    } catch (error) {
      if (!asked || (error.status !== 400 && error.status !== 422)) throw error;
      this.#on.toast(`The view in the address cannot be opened: ${error.message}`);
      return this.#create(id, null);
    }
  }

  /** Joins a session; `volume` and `view` come from its link, for the case that the session has ended. */
  async join(session, volume = '', view = null) {
    try {
      const { volume: id } = await this.#api.json('GET', `v1/sessions/${encodeURIComponent(session)}`);
      const found = await this.#volumes.wait(id, (fraction) => this.#progress(`Loading ${id}`, fraction));
      const histogram = await this.#volumes.histogram(id).catch(() => null);
      await this.#client.join(session);
      this.#show(found, histogram);
      this.#on.opened(id, { joined: true });
    } catch (error) {
      if (error.status !== 404 || !volume) return this.#on.failed(error);
      if (linked(this.#api.token).session) this.#api.token = ''; // the token was for that session only
      this.#on.toast('The session of this link has ended. Here is the same view, in a session of your own.');
      await this.open(volume, { scene: this.#kept(volume), view });
    } finally {
      this.#done();
    }
  }

  /**
   * Uploads a single file as it is, several (DICOM, pictures, a header with its voxels) as a zip; then meshes, one by one, which
   * are added to the volume shown. Of what fails the user is told, and the rest goes on.
   */
  async upload(files) {
    if (!files.length) return;
    const meshes = files.filter(isMesh);
    const rest = files.filter((file) => !isMesh(file));
    if (!rest.length && !this.#store.scene) return this.#on.toast('Open a volume first: a mesh is shown in its space.');
    const stop = new AbortController();
    const attempt = async (name, act) => {
      if (stop.signal.aborted) return false;
      this.#get('loading-cancel').hidden = false;
      this.#get('loading-cancel').onclick = () => stop.abort();
      try {
        return await act();
      } catch (error) {
        if (error.name === 'AbortError') this.#on.toast('Upload cancelled.');
        else this.#on.failed(error, name);
        return false;
      } finally {
        this.#done();
      }
    };
    if (rest.length && !(await attempt(nameOf(rest), () => this.#openFiles(rest, stop.signal)))) return; // meshes are in its space
    for (const mesh of meshes) await attempt(mesh.name, () => this.#addMesh(mesh, stop.signal));
  }

  /** @returns whether the volume is shown */
  async #openFiles(files, signal) {
    const body =
      files.length === 1
        ? files[0]
        : await zip(files, (part) => {
            signal.throwIfAborted();
            this.#progress(`Packing ${files.length} files`, part);
          });
    const id = await this.#send(body, nameOf(files), signal);
    this.#get('loading-cancel').hidden = true;
    await this.open(id);
    return this.id === id;
  }

  /** Files dropped anywhere on the page. */
  bindDrops() {
    let depth = 0; // dragenter and dragleave also fire for children
    const show = (on) => (this.#get('drop').hidden = !on);
    const carriesFiles = (event) => event.dataTransfer?.types.includes('Files');
    addEventListener('dragenter', (event) => carriesFiles(event) && show((depth += 1) > 0));
    addEventListener('dragleave', (event) => carriesFiles(event) && show((depth = Math.max(0, depth - 1)) > 0));
    addEventListener('dragover', (event) => carriesFiles(event) && event.preventDefault());
    addEventListener('drop', async (event) => {
      if (!carriesFiles(event)) return;
      event.preventDefault();
      depth = 0;
      show(false);
      this.upload(await droppedFiles(event.dataTransfer));
    });
  }

  /** Call when another volume of the same file is shown. */
  another(volume) {
    this.volume = volume;
    this.box = volumeBox(volume);
  }

  /** The name of the shown volume in the address. */
  get id() {
    return this.volume?.of ?? this.volume?.id;
  }

  /** Keeps the scene for a reload of this tab at the same address. */
  keep() {
    if (!this.#store.scene || !this.volume) return;
    sessionStorage.setItem(KEPT_SCENE, JSON.stringify({ volume: this.id, hash: location.hash, scene: this.#store.scene }));
  }

  #kept(id) {
    const kept = JSON.parse(sessionStorage.getItem(KEPT_SCENE) ?? 'null');
    sessionStorage.removeItem(KEPT_SCENE);
    return kept?.volume === id && kept.hash === location.hash ? kept.scene : null;
  }

  async #only() {
    const ready = (await this.#volumes.list()).filter(({ state }) => state === 'resident' || state === 'loading');
    if (ready.length !== 1) return false;
    await this.open(ready[0].id, { scene: this.#kept(ready[0].id) });
    return true;
  }

  async #addMesh(file, signal) {
    const id = await this.#send(file, file.name, signal, 'meshes');
    await this.#volumes.wait(id, (fraction) => this.#progress('Reading the mesh', fraction), signal, null, 'meshes');
    this.#store.patch({
      mode: 'mesh',
      mesh: { surfaces: [...(this.#store.scene.mesh?.surfaces ?? []), { mesh: id, opacity: 1, visible: true }] },
    });
  }

  async #send(body, name, signal, kind = 'volumes') {
    const id = uploadId(await this.#volumes.taken(kind));
    this.#names.set(id, name);
    const words = `Uploading ${formatBytes(body.size)}`;
    this.#progress(words, 0);
    const transfer = this.#volumes.upload(id, body, (fraction) => this.#progress(words, fraction), kind);
    signal.addEventListener('abort', transfer.cancel);
    await transfer.done;
    return id;
  }

  #show(volume, histogram) {
    this.volume = volume;
    this.box = volumeBox(volume);
    this.#on.shown(volume, this.box, histogram);
  }

  #progress(text, fraction) {
    this.#get('loading').hidden = false;
    this.#get('loading-text').textContent = text;
    if ((fraction ?? null) === null) this.#get('loading-bar').removeAttribute('value');
    else this.#get('loading-bar').value = fraction;
  }

  #done() {
    this.#get('loading').hidden = true;
    this.#get('loading-cancel').hidden = true;
  }
}
