// Pictures for the fake server, made of nothing but zlib: PNG in colour, JPEG in grey blocks of 8x8 (DC terms only).
import { deflateSync } from 'node:zlib';

const CRC = new Uint32Array(256).map((_, n) => {
  let c = n;
  for (let k = 0; k < 8; k++) c = c & 1 ? 0xedb88320 ^ (c >>> 1) : c >>> 1;
  return c;
});

function crc32(bytes) {
  let c = 0xffffffff;
  for (const byte of bytes) c = CRC[(c ^ byte) & 255] ^ (c >>> 8);
  return (c ^ 0xffffffff) >>> 0;
}

function chunk(name, data) {
  const body = Buffer.concat([Buffer.from(name, 'latin1'), data]);
  const out = Buffer.alloc(body.length + 8);
  out.writeUInt32BE(data.length, 0);
  body.copy(out, 4);
  out.writeUInt32BE(crc32(body), body.length + 4);
  return out;
}

/** @param {(x: number, y: number) => [number, number, number]} pixel 0..255 */
export function png(width, height, pixel) {
  const rows = Buffer.alloc(height * (1 + 3 * width));
  for (let y = 0, at = 0; y < height; y++) {
    rows[at++] = 0;
    for (let x = 0; x < width; x++) for (const channel of pixel(x, y)) rows[at++] = channel;
  }
  const head = Buffer.alloc(13);
  head.writeUInt32BE(width, 0);
  head.writeUInt32BE(height, 4);
  head.set([8, 2, 0, 0, 0], 8);
  const signature = Buffer.from([137, 80, 78, 71, 13, 10, 26, 10]);
  const data = deflateSync(rows, { level: 1 });
  return Buffer.concat([signature, chunk('IHDR', head), chunk('IDAT', data), chunk('IEND', Buffer.alloc(0))]);
}

class BitWriter {
  bytes = [];
  #held = 0;
  #count = 0;

  put(value, bits) {
    for (let i = bits - 1; i >= 0; i--) {
      this.#held = (this.#held << 1) | ((value >> i) & 1);
      if (++this.#count === 8) this.#flush();
    }
  }

  finish() {
    while (this.#count) this.put(1, 1);
    return Buffer.from(this.bytes);
  }

  #flush() {
    this.bytes.push(this.#held);
    if (this.#held === 255) this.bytes.push(0);
    this.#held = 0;
    this.#count = 0;
  }
}

// Twelve DC categories with 4-bit codes 0..11; one AC symbol (end of block) with the 1-bit code 0.
const segment = (marker, ...bytes) =>
  Buffer.from([255, marker, (bytes.length + 2) >> 8, (bytes.length + 2) & 255, ...bytes]);
const DC_TABLE = segment(0xc4, 0x00, 0, 0, 0, 12, ...Array(12).fill(0), 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11);
const AC_TABLE = segment(0xc4, 0x10, 1, ...Array(15).fill(0), 0);

/** @param {(x: number, y: number) => [number, number, number]} pixel sampled once per block, its green is shown */
export function jpeg(width, height, pixel) {
  const bits = new BitWriter();
  let before = 0;
  for (let y = 0; y < height; y += 8) {
    for (let x = 0; x < width; x += 8) {
      const dc = Math.round(pixel(Math.min(width - 1, x + 4), Math.min(height - 1, y + 4))[1] - 128);
      writeDifference(bits, dc - before);
      bits.put(0, 1);
      before = dc;
    }
  }
  const frame = segment(0xc0, 8, height >> 8, height & 255, width >> 8, width & 255, 1, 1, 0x11, 0);
  const quantiser = segment(0xdb, 0, ...Array(64).fill(8)); // a step of 8 is one grey level of DC
  const scan = segment(0xda, 1, 1, 0, 0, 63, 0);
  const head = Buffer.concat([Buffer.from([255, 0xd8]), quantiser, frame, DC_TABLE, AC_TABLE, scan]);
  return Buffer.concat([head, bits.finish(), Buffer.from([255, 0xd9])]);
}

function writeDifference(bits, difference) {
  const size = difference === 0 ? 0 : Math.floor(Math.log2(Math.abs(difference))) + 1;
  bits.put(size, 4);
  if (size) bits.put(difference > 0 ? difference : difference + (1 << size) - 1, size);
}
