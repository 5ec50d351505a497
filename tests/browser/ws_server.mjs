// The server side of RFC 6455, as little as the fake server needs, with ways to be awkward on purpose.
import { createHash } from 'node:crypto';

const GUID = '258EAFA5-E914-47DA-95CA-C5AB0DC85B11';
export const TEXT = 1;
export const BINARY = 2;

/** Answers the upgrade request. @returns {Connection} */
export function accept(request, socket, protocol) {
  const key = createHash('sha1')
    .update(request.headers['sec-websocket-key'] + GUID)
    .digest('base64');
  socket.write(
    'HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n' +
      `Sec-WebSocket-Accept: ${key}\r\nSec-WebSocket-Protocol: ${protocol}\r\n\r\n`,
  );
  return new Connection(socket);
}

export class Connection {
  onText = () => {};
  onClose = () => {};
  /** "whole", "bytes" (one byte per write) or "fragments" (continuation frames) */
  manner = 'whole';
  #socket;
  #bytes = Buffer.alloc(0);

  constructor(socket) {
    this.#socket = socket;
    socket.setNoDelay(true);
    socket.on('data', (data) => this.#data(data));
    socket.on('close', () => this.onClose());
    socket.on('error', () => {});
  }

  send(payload, opcode = typeof payload === 'string' ? TEXT : BINARY) {
    const body = Buffer.from(payload);
    if (this.manner !== 'fragments' || body.length < 3) {
      this.#write(frame(opcode, true, body));
      return;
    }
    const cut = Math.ceil(body.length / 3);
    this.#write(frame(opcode, false, body.subarray(0, cut)));
    this.#write(frame(0, false, body.subarray(cut, 2 * cut)));
    this.#write(frame(0, true, body.subarray(2 * cut)));
  }

  /** Ends it as a network does: without a word. */
  drop() {
    this.#socket.destroy();
  }

  #write(bytes) {
    if (this.#socket.destroyed) return;
    if (this.manner === 'bytes') for (const byte of bytes) this.#socket.write(Buffer.from([byte]));
    else this.#socket.write(bytes);
  }

  #data(data) {
    this.#bytes = Buffer.concat([this.#bytes, data]);
    for (let read = readFrame(this.#bytes); read; read = readFrame(this.#bytes)) {
      this.#bytes = this.#bytes.subarray(read.size);
      if (read.opcode === TEXT) this.onText(read.body.toString('utf8'));
      if (read.opcode === 9) this.#write(frame(10, true, read.body));
      if (read.opcode === 8) {
        this.#write(frame(8, true, read.body));
        this.#socket.end();
      }
    }
  }
}

function frame(opcode, last, body) {
  const head = [(last ? 0x80 : 0) | opcode];
  if (body.length < 126) head.push(body.length);
  else if (body.length < 65536) head.push(126, body.length >> 8, body.length & 255);
  else head.push(127, 0, 0, 0, 0, ...[24, 16, 8, 0].map((shift) => (body.length >>> shift) & 255));
  return Buffer.concat([Buffer.from(head), body]);
}

/** One masked frame from a client, or null while more is needed. Messages of clients are never fragmented here. */
function readFrame(bytes) {
  if (bytes.length < 6) return null;
  let size = bytes[1] & 127;
  let at = 2;
  if (size === 126) {
    size = bytes.readUInt16BE(2);
    at = 4;
  } else if (size === 127) {
    if (bytes.length < 14) return null;
    size = Number(bytes.readBigUInt64BE(2));
    at = 10;
  }
  if (bytes.length < at + 4 + size) return null;
  const mask = bytes.subarray(at, at + 4);
  const body = Buffer.from(bytes.subarray(at + 4, at + 4 + size)).map((byte, i) => byte ^ mask[i & 3]);
  return { opcode: bytes[0] & 15, body, size: at + 4 + size };
}
