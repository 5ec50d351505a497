// The scene as JSON: copy, load, save to a file, share.

export class SceneDialog {
  #get;
  #on;

  /** get(id); on: scene(), load(scene) async, share(role) -> URL async, toast(text) */
  constructor(get, on) {
    this.#get = get;
    this.#on = on;
    get('scene-copy').addEventListener('click', () => this.#copy(get('scene-text').value, 'Scene copied.'));
    get('scene-share').addEventListener('click', () => this.#share());
    get('scene-save').addEventListener('click', () => {
      saveFile(new Blob([get('scene-text').value], { type: 'application/json' }), 'scene.json');
    });
    get('scene-load').addEventListener('click', () => this.#load());
    get('scene-file').addEventListener('change', () => this.#read(get('scene-file')));
  }

  open() {
    this.#get('scene-text').value = JSON.stringify(this.#on.scene(), null, 2);
    this.#problem('');
    this.#get('scene-dialog').showModal();
  }

  async #share() {
    try {
      await this.#copy(await this.#on.share(this.#get('scene-share-role').value), 'Session link copied.');
    } catch (error) {
      this.#problem(error.message);
    }
  }

  async #load() {
    let scene;
    try {
      scene = JSON.parse(this.#get('scene-text').value);
    } catch (error) {
      this.#problem(`This is not JSON: ${error.message}`);
      return;
    }
    try {
      await this.#on.load(scene);
      this.#get('scene-dialog').close();
    } catch (error) {
      this.#problem(error.message);
    }
  }

  async #read(input) {
    const [file] = input.files;
    input.value = '';
    if (!file) return;
    this.#get('scene-text').value = await file.text();
    await this.#load();
  }

  // Pages over plain http from another machine may not use the clipboard: then selects the text instead.
  async #copy(text, done) {
    try {
      await navigator.clipboard.writeText(text);
      this.#on.toast(done);
      this.#get('scene-dialog').close();
    } catch {
      this.#get('scene-text').value = text;
      this.#get('scene-text').select();
      this.#problem('The browser does not allow copying here. The text is selected: press Ctrl+C.');
    }
  }

  #problem(text) {
    this.#get('scene-problem').textContent = text;
    this.#get('scene-problem').hidden = !text;
  }
}

/** Offers a blob as a download. */
export function saveFile(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
