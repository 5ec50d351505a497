// Parser for binary messages of tomocast.v1. No socket, no canvas.
//
// A message is: 4-byte little-endian length H, H bytes of UTF-8 JSON, then the image to the end of the message.

/** Limit in bytes; a longer header means a broken stream. */
export const MAX_HEADER_BYTES = 65536;

const IMAGE_TYPES = { jpeg: 'image/jpeg', png: 'image/png' };

export class PacketError extends Error {}

/**
 * Parses the frame at the start of a message.
 * @param {Uint8Array} bytes as much of the message as was received
 * @returns {{need: number}|{header: object, image: Uint8Array, type: string}} `need`: bytes required before the header
 *   is complete. Otherwise the frame; `image` is a view into `bytes`, not a copy.
 * @throws {PacketError} if no further byte can complete a frame
 */
export function readFrame(bytes) {
  if (bytes.length < 4) return { need: 4 };
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const size = view.getUint32(0, true);
  if (size < 2 || size > MAX_HEADER_BYTES) throw new PacketError(`frame: header of ${size} bytes`);
  if (bytes.length < 4 + size) return { need: 4 + size };
  const header = readHeader(bytes.subarray(4, 4 + size));
  return { header, image: bytes.subarray(4 + size), type: IMAGE_TYPES[header.format] };
}

function readHeader(bytes) {
  let header;
  try {
    header = JSON.parse(new TextDecoder('utf-8', { fatal: true }).decode(bytes));
  } catch (cause) {
    throw new PacketError('frame: the header is not JSON', { cause });
  }
  if (header === null || typeof header !== 'object') throw new PacketError('frame: the header is not an object');
  for (const name of ['frame', 'seq', 'width', 'height']) {
    if (!Number.isInteger(header[name]) || header[name] < 0) throw new PacketError(`frame: bad "${name}"`);
  }
  if (header.width === 0 || header.height === 0) throw new PacketError('frame: empty picture');
  if (!Object.hasOwn(IMAGE_TYPES, header.format)) throw new PacketError(`frame: unknown format "${header.format}"`);
  return header;
}
