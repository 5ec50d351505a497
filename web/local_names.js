// Names of the uploaded files. They often contain patients' names, so they stay in this tab and are never sent.

const STORED = 'tomocast.names';

/** Distinguishes a volume from a later one with the same id. */
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

  /** The file name of a volume described by the daemon, or "" */
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

  /** Replaces upload ids in a text by their file names. */
  inText(text) {
    return Object.entries(this.#known).reduce((words, [id, { name }]) => words.split(new RegExp(`\\b${id}\\b`)).join(name), text);
  }

  #keep() {
    this.#storage?.setItem(STORED, JSON.stringify(this.#known));
  }
}

/** A name for some files: the first one's, and the number of others. */
export const nameOf = (files) => (files.length > 1 ? `${files[0].name} and ${files.length - 1} more` : files[0].name);
