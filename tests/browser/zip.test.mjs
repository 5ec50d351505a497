import assert from 'node:assert/strict';
import { test } from 'node:test';

import { crc32, zip } from '../../web/zip.js';

const text = (bytes) => Buffer.from(bytes).toString('latin1');

test('CRC-32 has its check value, whole and in pieces', () => {
  const bytes = Buffer.from('123456789');
  assert.equal(crc32(bytes), 0xcbf43926);
  assert.equal(crc32(bytes.subarray(4), crc32(bytes.subarray(0, 4))), 0xcbf43926);
});

/** The entries as a reader finds them: from the end record to the directory to the data. */
function entries(bytes) {
  const view = new DataView(bytes.buffer);
  const end = bytes.length - 22;
  assert.equal(view.getUint32(end, true), 0x06054b50);
  const found = [];
  let at = view.getUint32(end + 16, true);
  assert.equal(at + view.getUint32(end + 12, true), end, 'the directory ends where the end record begins');
  for (let i = 0; i < view.getUint16(end + 10, true); i++) {
    assert.equal(view.getUint32(at, true), 0x02014b50);
    const [crc, size, nameLength, offset] = [
      view.getUint32(at + 16, true),
      view.getUint32(at + 24, true),
      view.getUint16(at + 28, true),
      view.getUint32(at + 42, true),
    ];
    assert.equal(view.getUint32(offset, true), 0x04034b50);
    assert.equal(
      text(bytes.subarray(offset + 4, offset + 30)),
      text(bytes.subarray(at + 6, at + 32)),
      'both headers agree',
    );
    const data = bytes.subarray(offset + 30 + nameLength, offset + 30 + nameLength + size);
    assert.equal(crc32(data), crc);
    found.push({ name: text(bytes.subarray(at + 46, at + 46 + nameLength)), data: text(data) });
    at += 46 + nameLength;
  }
  return found;
}

test('a zip holds the files under numbers', async () => {
  const parts = [];
  const blob = await zip([new Blob(['first']), new Blob([]), new Blob(['x'.repeat(70000)])], (part) =>
    parts.push(part),
  );
  const found = entries(new Uint8Array(await blob.arrayBuffer()));
  assert.deepEqual(
    found.map(({ name }) => name),
    ['000001.dcm', '000002.dcm', '000003.dcm'],
  );
  assert.deepEqual(
    found.map(({ data }) => data),
    ['first', '', 'x'.repeat(70000)],
  );
  assert.equal(parts.at(-1), 1);
});

test('no files make an empty zip', async () => {
  assert.deepEqual(entries(new Uint8Array(await (await zip([])).arrayBuffer())), []);
});
