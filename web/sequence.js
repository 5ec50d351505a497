// Series of several volumes (times, echoes): a slider selects one, a cine plays those resident in the daemon. Camera,
// look and slices are kept. Nothing plays automatically, which respects prefers-reduced-motion.

const PICTURE_MS = 2000; // longest wait for a picture

export class Sequence {
  #get;
  #volumes;
  #client;
  #on;
  #shown = null; // description of the volume in the picture
  #known = new Map(); // number -> description of the volumes known to be resident
  #wanted = 0; // number
  #choosing = null; // promise of the switch in progress
  #run = null; // identity of the running cine
  #awaited = []; // {id, done}: volumes of the cine whose pictures are due
  #allowed = true;

  /** on: shown(volume), problem(error), note(text) */
  constructor(get, { volumes, client, on }) {
    this.#get = get;
    this.#volumes = volumes;
    this.#client = client;
    this.#on = on;
    get('time').addEventListener('input', () => this.choose(Number(get('time').value)));
    get('play').addEventListener('click', () => this.toggle());
  }

  /** A volume was opened; its picture follows. */
  setVolume(volume) {
    this.stop();
    this.#shown = volume;
    this.#wanted = volume.volume ?? 1;
    this.#known = new Map([[this.#wanted, volume]]);
    this.#update();
  }

  /** The session is view-only. */
  forbid() {
    this.#allowed = false;
    this.#update();
  }

  /** A picture was drawn; another viewer may have switched the volume. */
  async frame({ volume }) {
    const at = this.#awaited.findIndex(({ id }) => id === volume);
    for (const { done } of this.#awaited.splice(0, at + 1)) done();
    if (!volume || !this.#shown || volume === this.#shown.id) return;
    const known = [...this.#known.values()].find(({ id }) => id === volume);
    const found = known ?? (await this.#volumes.get(volume).catch(() => null));
    if (!found?.dims) return;
    this.#shown = found;
    this.#known.set(found.volume, found);
    if (!this.#choosing && at < 0) this.#wanted = found.volume; // the cine's pictures lag behind its choice
    this.#on.shown(found);
    this.#update();
  }

  /** Keyboard steps wrap around. */
  step(by) {
    const { frames = 1 } = this.#shown ?? {};
    if (frames > 1 && this.#allowed) this.choose(((this.#wanted - 1 + by + frames) % frames) + 1);
  }

  /** The newest choice wins. @returns a promise resolved when the session shows it */
  choose(number) {
    this.#wanted = number;
    this.#update();
    this.#choosing ??= this.#follow().finally(() => {
      this.#choosing = null;
      this.#update();
    });
    return this.#choosing;
  }

  get running() {
    return this.#run !== null;
  }

  toggle() {
    if (this.running) this.stop();
    else if (this.#shown?.frames > 1 && this.#allowed) this.#play();
  }

  stop() {
    this.#run = null;
    this.#update();
  }

  async #follow() {
    try {
      for (let number = 0; number !== this.#wanted;) {
        number = this.#wanted;
        await this.#show(number);
      }
    } catch (error) {
      this.stop();
      this.#wanted = this.#shown.volume;
      this.#on.problem(error);
    }
  }

  async #show(number) {
    try {
      await this.#client.show((await this.#bring(number)).id);
    } catch (error) {
      if (![404, 409].includes(error.status)) throw error;
      this.#known.delete(number); // it was evicted meanwhile
      await this.#client.show((await this.#bring(number)).id);
    }
  }

  async #bring(number) {
    if (!this.#known.has(number)) {
      const { id: of, volumes = [] } = await this.#volumes.get(this.#shown.id);
      const found = volumes.find(({ volume, state }) => volume === number && state !== 'failed');
      const id = found?.id ?? `${(this.#shown.of ?? of).slice(0, 56)}.${number}`;
      if (!found) await this.#volumes.another(id, of, number);
      this.#known.set(number, await this.#volumes.wait(id, () => {}));
    }
    return this.#known.get(number);
  }

  async #play() {
    const run = (this.#run = {});
    this.#fill(run);
    this.#update();
    for (let due = performance.now(), before; this.#run === run;) {
      const next = this.#next();
      if (next !== this.#wanted) {
        const drawn = this.#picture(this.#known.get(next).id);
        await this.choose(next);
        await before; // pipelined: one picture is drawn while the next is rendered
        before = drawn;
      }
      const period = 1000 / Number(this.#get('rate').value);
      due = Math.max(due + period, performance.now() - period); // a longer delay is skipped, not caught up
      await new Promise((done) => setTimeout(done, due - performance.now()));
    }
  }

  /** @returns a promise resolved when the volume was drawn or skipped, or after PICTURE_MS */
  #picture(id) {
    return new Promise((done) => {
      this.#awaited.push({ id, done });
      setTimeout(done, PICTURE_MS);
    });
  }

  #next() {
    const numbers = [...this.#known.keys()].sort((a, b) => a - b);
    return numbers.find((number) => number > this.#wanted) ?? numbers[0];
  }

  /** Loads the other volumes while the cine plays, until all are resident or one evicts another. */
  async #fill(run) {
    const { frames } = this.#shown;
    try {
      for (let number = 1; number <= frames && this.#run === run; number++) {
        const count = this.#known.size + !this.#known.has(number);
        await this.#bring(number);
        const { volumes = [] } = await this.#volumes.get(this.#shown.id);
        const there = new Set(volumes.filter(({ state }) => state === 'resident').map(({ volume }) => volume));
        for (const known of this.#known.keys()) if (!there.has(known)) this.#known.delete(known);
        this.#update();
        if (this.#known.size < count) throw new Error('one was dropped');
      }
    } catch {
      if (this.#run === run) this.#on.note(`Only ${this.#known.size} of ${frames} volumes fit in memory; the cine plays those.`);
    }
  }

  #update() {
    const { frames = 1 } = this.#shown ?? {};
    const [bar, slider, play] = ['sequence', 'time', 'play'].map((id) => this.#get(id));
    bar.hidden = frames < 2 || !this.#allowed || !this.#shown.volumes;
    if (bar.hidden) return;
    slider.max = frames;
    slider.value = this.#wanted;
    slider.ariaValueText = `${this.#wanted} of ${frames}`;
    const loading = this.running && this.#known.size < frames ? ` \u00b7 ${this.#known.size} loaded` : '';
    this.#get('time-text').textContent = `${this.#wanted} / ${frames}${loading}`;
    play.ariaPressed = this.running;
    play.textContent = this.running ? '\u23f8\ufe0e' : '\u25b6\ufe0e';
  }
}
