import assert from 'node:assert/strict';
import { test } from 'node:test';

import { MAX_HEADER_BYTES, PacketError, readFrame } from '../../web/packets.js';

const HEADER = { frame: 7, seq: 3, width: 640, height: 480, format: 'jpeg', quality: 85, final: true, note: 'café' };

function message(header = HEADER, image = [255, 216, 1, 2, 3]) {
  const json = typeof header === 'string' ? Buffer.from(header) : Buffer.from(JSON.stringify(header));
  const size = Buffer.alloc(4);
  size.writeUInt32LE(json.length);
  return new Uint8Array(Buffer.concat([size, json, Buffer.from(image)]));
}

test('a whole message gives header, image and type', () => {
  const { header, image, type } = readFrame(message());
  assert.deepEqual(header, HEADER);
  assert.deepEqual([...image], [255, 216, 1, 2, 3]);
  assert.equal(type, 'image/jpeg');
});

test('the image is a view, not a copy, and the message may lie anywhere in a buffer', () => {
  const whole = new Uint8Array(200);
  whole.set(message(), 11);
  const piece = whole.subarray(11, 11 + message().length);
  const { image } = readFrame(piece);
  assert.equal(image.buffer, whole.buffer);
  assert.deepEqual([...image], [255, 216, 1, 2, 3]);
});

test('every truncated header says how much is needed, and never less than there is', () => {
  const bytes = message();
  const end = bytes.length - 5;
  for (let n = 0; n < end; n++) {
    const { need } = readFrame(bytes.subarray(0, n));
    assert.equal(need, n < 4 ? 4 : end, `after ${n} bytes`);
  }
  assert.ok(readFrame(bytes.subarray(0, end)).header, 'the header alone is enough to read it');
});

test('one byte at a time: the header is known with its last byte, the image grows behind it', () => {
  const bytes = message();
  const end = bytes.length - 5;
  const arrived = [];
  for (const byte of bytes) {
    arrived.push(byte);
    const { need, header, image } = readFrame(new Uint8Array(arrived));
    assert.equal(need === undefined, arrived.length >= end, `after ${arrived.length} bytes`);
    if (header) assert.deepEqual([header, image.length], [HEADER, arrived.length - end]);
    else assert.ok(need > arrived.length);
  }
});

test('what no further byte can mend is an error at once', () => {
  const withSize = (n) => {
    const bytes = new Uint8Array(4);
    new DataView(bytes.buffer).setUint32(0, n, true);
    return bytes;
  };
  for (const size of [0, 1, MAX_HEADER_BYTES + 1, 0xffffffff])
    assert.throws(() => readFrame(withSize(size)), PacketError);
  assert.deepEqual(readFrame(withSize(MAX_HEADER_BYTES)), { need: 4 + MAX_HEADER_BYTES });
  for (const text of ['{"frame":', '[]x', 'null', '7', '"x"'])
    assert.throws(() => readFrame(message(text)), PacketError, text);
  assert.throws(() => readFrame(message(Buffer.from([123, 34, 255, 34, 125]).toString('latin1'))), PacketError);
});

test('a header without what drawing needs is an error that names it', () => {
  for (const name of ['frame', 'seq', 'width', 'height']) {
    for (const value of [undefined, -1, 1.5, '3', null]) {
      assert.throws(() => readFrame(message({ ...HEADER, [name]: value })), new RegExp(name), `${name}=${value}`);
    }
  }
  assert.throws(() => readFrame(message({ ...HEADER, width: 0 })), /empty/);
  for (const format of ['gif', 'toString', undefined]) {
    assert.throws(() => readFrame(message({ ...HEADER, format })), /format/);
  }
});
