// A WebSocket client over a bare socket: RFC 6455, and every way to violate it.
import assert from 'node:assert/strict';
import { createHash, randomBytes } from 'node:crypto';
import net from 'node:net';

const GUID = '258EAFA5-E914-47DA-95CA-C5AB0DC85B11';
const PATIENCE_MS = 30000;

export const OP = { more: 0, text: 1, binary: 2, close: 8, ping: 9, pong: 10 };

/** One frame as bytes. Clients mask; `mask: false` violates that. `size` overrides the length field. */
export function frameBytes(payload, { opcode = OP.text, fin = true, rsv = 0, mask = true, size } = {}) {
  const body = Buffer.from(payload);
  const length = size ?? body.length;
  const head = [(fin ? 0x80 : 0) | (rsv << 4) | opcode];
  const bit = mask ? 0x80 : 0;
  if (length < 126) head.push(bit | length);
  else if (length < 65536) head.push(bit | 126, length >> 8, length & 255);
  else {
    const wide = Buffer.alloc(8);
    wide.writeBigUInt64BE(BigInt(length));
    head.push(bit | 127, ...wide);
  }
  if (!mask) return Buffer.concat([Buffer.from(head), body]);
  const key = randomBytes(4);
  for (let i = 0; i < body.length; i++) body[i] ^= key[i & 3];
  return Buffer.concat([Buffer.from(head), key, body]);
}

/** The opening handshake alone, over a socket from connect(). @returns {{status, headers, socket, rest}} */
export function handshake(port, path, { headers = {}, without = [], extra = Buffer.alloc(0), connect } = {}) {
  const key = randomBytes(16).toString('base64');
  const all = {
    Host: `127.0.0.1:${port}`, Upgrade: 'websocket', Connection: 'Upgrade', 'Sec-WebSocket-Key': key,
    'Sec-WebSocket-Version': '13', 'Sec-WebSocket-Protocol': 'tomocast.v1', ...headers,
  };
  for (const name of without) delete all[name];
  const lines = Object.entries(all).map(([name, value]) => `${name}: ${value}\r\n`).join('');
  return new Promise((resolve, reject) => {
    const socket = connect ? connect() : net.connect(port, '127.0.0.1');
    let bytes = Buffer.alloc(0);
    const listen = (piece) => {
      bytes = Buffer.concat([bytes, piece]);
      const end = bytes.indexOf('\r\n\r\n');
      if (end < 0) return;
      socket.off('data', listen);
      socket.pause();
      const [first, ...rows] = bytes.subarray(0, end).toString().split('\r\n');
      const found = Object.fromEntries(rows.map((row) => [row.slice(0, row.indexOf(':')).toLowerCase(), row.slice(row.indexOf(':') + 1).trim()]));
      resolve({ status: Number(first.split(' ')[1]), headers: found, socket, rest: bytes.subarray(end + 4), key });
    };
    socket.on('data', listen);
    socket.on('error', reject);
    socket.on('close', () => reject(Object.assign(new Error('closed without an answer'), { code: 'ECONNRESET' })));
    socket.setNoDelay(true);
    socket.write(Buffer.concat([Buffer.from(`GET ${path} HTTP/1.1\r\n${lines}\r\n`), extra]));
  });
}

export class Ws {
  messages = []; // not yet taken: {type: 'hello'...} or {header, image}
  closed = null; // {code, reason} or {code: 1006}
  #bytes = Buffer.alloc(0);
  #waiting = [];
  #pieces = [];
  #pieceOpcode = 0;

  /** Options of handshake(), and autoAck: acknowledges every frame immediately. */
  static async open(daemon, session, options = {}) {
    const reply = await handshake(daemon.port, `/v1/sessions/${session}/stream`, options);
    assert.equal(reply.status, 101, JSON.stringify(reply.headers));
    assert.equal(reply.headers['sec-websocket-accept'], createHash('sha1').update(reply.key + GUID).digest('base64'));
    assert.equal(reply.headers['sec-websocket-protocol'], 'tomocast.v1');
    return new Ws(reply.socket, reply.rest, options);
  }

  /** onMessage receives every message; without it messages wait for next(). */
  constructor(socket, rest, { autoAck = true, onMessage } = {}) {
    this.socket = socket;
    this.onMessage = onMessage;
    this.autoAck = autoAck;
    this.pongs = 0;
    this.ended = new Promise((resolve) => (this.finish = resolve));
    socket.on('data', (piece) => this.#take(piece));
    socket.on('error', () => {});
    socket.on('close', () => this.#over({ code: 1006, reason: 'cut' }));
    if (rest.length) this.#take(rest);
    socket.resume();
  }

  write(bytes) { this.socket.write(bytes); }
  frame(payload, options) { this.write(frameBytes(payload, options)); }
  send(message) { this.frame(JSON.stringify(message)); }
  patch(seq, scene) { this.send({ type: 'patch', seq, scene }); }
  ack(frame) { this.send({ type: 'ack', frame }); }
  pause() { this.socket.pause(); }
  resume() { this.socket.resume(); }

  /** The next message that `wanted` accepts; drops the ones before. */
  next(wanted = () => true, patienceMs = PATIENCE_MS) {
    const at = this.messages.findIndex(wanted);
    if (at >= 0) return Promise.resolve(this.messages.splice(0, at + 1)[at]);
    this.messages = [];
    return new Promise((resolve, reject) => {
      const waiter = { wanted, reject, resolve: (message) => { clearTimeout(timer); resolve(message); } };
      const timer = setTimeout(() => {
        this.#waiting.splice(this.#waiting.indexOf(waiter), 1);
        reject(new Error('no such message came'));
      }, patienceMs);
      this.#waiting.push(waiter);
    });
  }

  nextFrame(wanted = () => true, patienceMs) { return this.next((m) => m.header && wanted(m.header), patienceMs); }
  nextText(type, patienceMs) { return this.next((m) => m.type === type, patienceMs); }
  frames() { return this.messages.filter((m) => m.header); }

  async close(code = 1000) {
    const body = Buffer.alloc(2);
    body.writeUInt16BE(code);
    this.frame(body, { opcode: OP.close });
    return this.ended;
  }

  cut() { this.socket.destroy(); }

  #over(how) {
    if (this.closed) return;
    this.closed = how;
    for (const { reject } of this.#waiting) reject(new Error(`closed: ${JSON.stringify(how)}`));
    this.#waiting = [];
    this.finish(how);
  }

  #take(piece) {
    this.#bytes = Buffer.concat([this.#bytes, piece]);
    for (;;) {
      const bytes = this.#bytes;
      if (bytes.length < 2) return;
      let size = bytes[1] & 127, at = 2;
      assert.equal(bytes[1] & 128, 0, 'a server does not mask');
      if (size === 126) { if (bytes.length < 4) return; size = bytes.readUInt16BE(2); at = 4; }
      else if (size === 127) { if (bytes.length < 10) return; size = Number(bytes.readBigUInt64BE(2)); at = 10; }
      if (bytes.length < at + size) return;
      this.#bytes = bytes.subarray(at + size);
      this.#frame(bytes[0], Buffer.from(bytes.subarray(at, at + size)));
    }
  }

  #frame(first, payload) {
    const opcode = first & 15;
    if (opcode === OP.ping) this.frame(payload, { opcode: OP.pong });
    else if (opcode === OP.pong) { this.pongs++; this.onPong?.(payload); }
    else if (opcode === OP.close) {
      const code = payload.length >= 2 ? payload.readUInt16BE(0) : 1005;
      this.#over({ code, reason: payload.subarray(2).toString() });
      this.frame(payload.subarray(0, 2), { opcode: OP.close });
      this.socket.end();
    } else {
      if (opcode !== OP.more) this.#pieceOpcode = opcode;
      this.#pieces.push(payload);
      if (!(first & 128)) return;
      const whole = Buffer.concat(this.#pieces);
      this.#pieces = [];
      this.#message(this.#pieceOpcode === OP.text ? JSON.parse(whole) : this.#picture(whole));
    }
  }

  #picture(bytes) {
    const size = bytes.readUInt32LE(0);
    const header = JSON.parse(bytes.subarray(4, 4 + size));
    if (this.autoAck) this.ack(header.frame);
    return { header, image: bytes.subarray(4 + size) };
  }

  #message(message) {
    if (this.onMessage) {
      this.onMessage(message);
      return;
    }
    const at = this.#waiting.findIndex(({ wanted }) => wanted(message));
    if (at < 0) return void this.messages.push(message);
    this.messages = []; // earlier messages are dropped
    this.#waiting.splice(at, 1)[0].resolve(message);
  }
}
