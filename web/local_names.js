// Names of the files a user uploaded. They often are patients': they stay in this tab and are sent to nobody.

const STORED = 'tomocast.names';

/** What tells one volume from another that came by the same id later. */
const signOf = ({ dims, spacing, bytes, range }) => (dims ? JSON.stringify([dims, spacing, bytes, range]) : '');

export class LocalNames {
  #storage;
  #known; // id -> {name, sign}

  constructor(storage = globalThis.sessionStorage) {
    this.#storage = storage;
    this.#known = JSON.parse(storage?.getItem(STORED) ?? '{}');
  }

  set(id, name) {
    this.#known[id] = { name, sign: '' };
    this.#keep();
  }

  /** The file's name of a volume as the daemon describes it, or "" */
  of(volume) {
    const entry = this.#known[volume.id];
    if (!entry) return '';
    const sign = signOf(volume);
    if (sign && !entry.sign) {
      entry.sign = sign;
      this.#keep();
    }
    return !sign || entry.sign === sign ? entry.name : '';
  }

  /** A text about uploads in the user's words: their file's name in place of its id. */
  inText(text) {
    return Object.entries(this.#known).reduce((words, [id, { name }]) => words.split(new RegExp(`\\b${id}\\b`)).join(name), text);
  }

  #keep() {
    this.#storage?.setItem(STORED, JSON.stringify(this.#known));
  }
}

/** What to call some files: the only one's name, or the first one's and how many more. */
export const nameOf = (files) => (files.length > 1 ? `${files[0].name} and ${files.length - 1} more` : files[0].name);
