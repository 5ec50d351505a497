// From a name, a file or an address to a volume on the stage: loading, uploading, joining, with progress and cancel.

import { linked } from './access.js';
import { fit, volumeBox } from './camera.js';
import { formatBytes, uploadId } from './volumes.js';
import { droppedFiles, zip } from './zip.js';

const KEPT_SCENE = 'tomocast.scene'; // sessionStorage: survives a reload of this tab, nothing else

/** The volume an address names after its #, or "". */
export function volumeInHash(hash) {
  try {
    return decodeURIComponent(hash.slice(1));
  } catch {
    return ''; // a % that encodes nothing
  }
}

export class Opening {
  volume = null; // description of the one that is shown
  box = null;
  #get;
  #api;
  #client;
  #store;
  #volumes;
  #on;
  #abort = null; // of the load under way

  /** on: shown(volume, box, histogram), failed(error), toast(text, options), size() -> {width, height} px, aspect() */
  constructor({ get, api, client, store, volumes, on }) {
    this.#get = get;
    this.#api = api;
    this.#client = client;
    this.#store = store;
    this.#volumes = volumes;
    this.#on = on;
  }

  /** Opens the session of a link the user came by, or what the address names: ?session=ID, #volume, or the only volume. @returns false: let the user choose */
  async fromAddress({ search, hash }) {
    const session = linked(this.#api.token).session || new URLSearchParams(search).get('session');
    const id = volumeInHash(hash);
    if (session) await this.join(session);
    else if (id) await this.open(id, this.#kept(id));
    else return this.#only();
    return true;
  }

  async open(id, scene = null) {
    this.#abort?.abort();
    const abort = (this.#abort = new AbortController());
    try {
      this.#progress(`Loading ${id}`);
      const early = this.#volumes.histogram(id).catch(() => null); // of a volume that is there, beside its description
      const found = await this.#volumes.bring(
        id,
        (fraction) => this.#progress(`Loading ${id}`, fraction),
        abort.signal,
      );
      const histogram = (await early) ?? (await this.#volumes.histogram(id).catch(() => null));
      if (abort.signal.aborted) return;
      const image = { ...(scene?.image ?? {}), ...this.#on.size() };
      await this.#client.create(id, { ...(scene ?? {}), image });
      this.#show(found, histogram);
      if (!scene) this.#store.patch({ camera: fit(this.#store.scene.camera, this.box, this.#on.aspect()) }, 'fit');
      history.replaceState(null, '', `${location.pathname}#${encodeURIComponent(id)}`);
    } catch (error) {
      if (error.name !== 'AbortError') this.#on.failed(error);
    } finally {
      if (this.#abort === abort) this.#done();
    }
  }

  async join(session) {
    try {
      const { volume } = await this.#api.json('GET', `v1/sessions/${encodeURIComponent(session)}`);
      const found = await this.#volumes.wait(volume, (fraction) => this.#progress(`Loading ${volume}`, fraction));
      const histogram = await this.#volumes.histogram(volume).catch(() => null);
      await this.#client.join(session);
      this.#show(found, histogram);
    } catch (error) {
      this.#on.failed(error);
    } finally {
      this.#done();
    }
  }

  /** One file as it is; several as a zip of DICOM files. */
  async upload(files) {
    if (!files.length) return;
    const stop = new AbortController();
    this.#get('loading-cancel').hidden = false;
    this.#get('loading-cancel').onclick = () => stop.abort();
    try {
      const body =
        files.length === 1
          ? files[0]
          : await zip(files, (part) => {
              stop.signal.throwIfAborted();
              this.#progress(`Packing ${files.length} files`, part);
            });
      const id = await this.#send(body, stop.signal);
      this.#get('loading-cancel').hidden = true;
      await this.open(id);
    } catch (error) {
      if (error.name === 'AbortError') this.#on.toast('Upload cancelled.');
      else this.#on.failed(error);
    } finally {
      this.#done();
    }
  }

  /** Files dropped anywhere on the page. */
  bindDrops() {
    let depth = 0; // dragenter and dragleave also come for every child
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

  /** Keeps the scene for a reload of this tab. */
  keep() {
    if (!this.#store.scene || !this.volume) return;
    sessionStorage.setItem(KEPT_SCENE, JSON.stringify({ volume: this.volume.id, scene: this.#store.scene }));
  }

  #kept(id) {
    const kept = JSON.parse(sessionStorage.getItem(KEPT_SCENE) ?? 'null');
    sessionStorage.removeItem(KEPT_SCENE);
    return kept?.volume === id ? kept.scene : null;
  }

  async #only() {
    const ready = (await this.#volumes.list()).filter(({ state }) => state === 'resident' || state === 'loading');
    if (ready.length !== 1) return false;
    await this.open(ready[0].id, this.#kept(ready[0].id));
    return true;
  }

  async #send(body, signal) {
    const taken = new Set((await this.#volumes.list()).map(({ id }) => id));
    const id = uploadId(taken);
    const words = `Uploading ${formatBytes(body.size)}`;
    this.#progress(words, 0);
    const transfer = this.#volumes.upload(id, body, (fraction) => this.#progress(words, fraction));
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
