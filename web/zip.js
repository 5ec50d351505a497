// A zip of uncompressed files (method "stored"), so that a folder of DICOM files can be sent as one body. The bytes
// stay on disk: the archive is a Blob that refers to the files. Entries are named by numbers, since file names often
// contain patients' names.

const LOCAL = 0x04034b50;
const CENTRAL = 0x02014b50;
const END = 0x06054b50;
const MOST_BYTES = 0xffffffff; // limit without the zip64 extension
const MOST_FILES = 65535;

const TABLE = new Uint32Array(256).map((_, n) => {
  let c = n;
  for (let k = 0; k < 8; k++) c = c & 1 ? 0xedb88320 ^ (c >>> 1) : c >>> 1;
  return c;
});

/** CRC-32 of bytes, continued from an earlier value. */
export function crc32(bytes, before = 0) {
  let c = ~before;
  for (let i = 0; i < bytes.length; i++) c = TABLE[(c ^ bytes[i]) & 255] ^ (c >>> 8);
  return ~c >>> 0;
}

/** Little-endian fields: pairs of value and size in bytes. */
function fields(...pairs) {
  const bytes = new Uint8Array(pairs.reduce((sum, [, size]) => sum + size, 0));
  let at = 0;
  for (const [value, size] of pairs)
    for (let k = 0; k < size; k++) bytes[at++] = Math.floor(value / 2 ** (8 * k)) & 255;
  return bytes;
}

const byName = new Intl.Collator('en', { numeric: true });

/**
 * Builds the archive. Names are left out, since they may be a patient's. The order is kept, which is the order of the
 * slices if nothing else gives it.
 * @param {Blob[]} files
 * @param {(fraction: number) => void} onProgress while the files are read for their checksums
 * @returns {Promise<Blob>}
 */
export async function zip(files, onProgress = () => {}) {
  files = [...files].sort((a, b) => byName.compare(a.name ?? '', b.name ?? ''));
  const total = files.reduce((sum, { size }) => sum + size, 0);
  if (files.length > MOST_FILES || total + files.length * 200 > MOST_BYTES)
    throw new Error('too much for one zip: at most 4 GB');
  const parts = [];
  const directory = [];
  let offset = 0;
  let read = 0;
  for (const [i, file] of files.entries()) {
    const name = new TextEncoder().encode(`${String(i + 1).padStart(6, '0')}.dcm`);
    const crc = crc32(new Uint8Array(await file.arrayBuffer()));
    // version 2.0, no flags, stored, 1980-01-01 00:00
    const shared = fields(
      [20, 2],
      [0, 2],
      [0, 2],
      [0, 2],
      [33, 2],
      [crc, 4],
      [file.size, 4],
      [file.size, 4],
      [name.length, 2],
      [0, 2],
    );
    parts.push(fields([LOCAL, 4]), shared, name, file);
    directory.push(fields([CENTRAL, 4], [20, 2]), shared, fields([0, 2], [0, 2], [0, 2], [0, 4], [offset, 4]), name);
    offset += 4 + shared.length + name.length + file.size;
    onProgress((read += file.size) / (total || 1));
  }
  const size = directory.reduce((sum, { length }) => sum + length, 0);
  const count = files.length;
  const end = fields([END, 4], [0, 2], [0, 2], [count, 2], [count, 2], [size, 4], [offset, 4], [0, 2]);
  return new Blob([...parts, ...directory, end], { type: 'application/zip' });
}

/** All files of a drop, including those in folders. Call within the event: the list is empty afterwards. */
export async function droppedFiles(transfer) {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (!entries.length) return [...transfer.files];
  const lists = await Promise.all(entries.map(walk));
  return lists.flat();
}

async function walk(entry) {
  if (entry.isFile) return [await new Promise((resolve, reject) => entry.file(resolve, reject))];
  const reader = entry.createReader();
  const found = [];
  for (;;) {
    // returns at most a hundred per call
    const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (!some.length) break;
    found.push(...some);
  }
  return (await Promise.all(found.map(walk))).flat();
}
