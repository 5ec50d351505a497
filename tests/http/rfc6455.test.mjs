// The WebSocket by the book: what RFC 6455 wants of a server, row by row. The opening handshake, then frames: each row's
// bytes end in a close with the code that the row names, in the very frame that says so, then in the end of the connection.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Daemon } from '../support/daemon.mjs';
import { frameBytes, handshake, OP, Ws } from '../support/ws.mjs';

let d, session;
before(async () => {
  d = await Daemon.start();
  session = (await d.session()).id;
});
after(() => d.stop());

// --- section 4: the opening handshake ------------------------------------------------------------------
const handshakes = [
  ['4.2.2', 'as it should be', {}, 101],
  ['4.2.1', 'websocket in capitals', { headers: { Upgrade: 'WebSocket' } }, 101],
  ['4.2.1', 'Upgrade among others', { headers: { Connection: 'keep-alive, Upgrade', Upgrade: 'h2c, websocket' } }, 101],
  ['4.2.1', 'no Upgrade', { without: ['Upgrade'] }, 426],
  ['4.2.1', 'another Upgrade', { headers: { Upgrade: 'h2c' } }, 426],
  ['4.2.1', 'no Connection', { without: ['Connection'] }, 426],
  ['4.2.1', 'Connection without Upgrade', { headers: { Connection: 'keep-alive' } }, 426],
  ['4.2.1', 'no Host', { without: ['Host'] }, 400],
  ['4.2.1', 'no key', { without: ['Sec-WebSocket-Key'] }, 400],
  ['4.2.1', 'an empty key', { headers: { 'Sec-WebSocket-Key': '' } }, 400],
  ['4.2.1', 'a key of 15 bytes', { headers: { 'Sec-WebSocket-Key': Buffer.alloc(15).toString('base64') } }, 400],
  ['4.2.1', 'a key of 17 bytes', { headers: { 'Sec-WebSocket-Key': Buffer.alloc(17).toString('base64') } }, 400],
  ['4.2.1', 'a key that is not base64', { headers: { 'Sec-WebSocket-Key': '!!!!!!!!!!!!!!!!!!!!!!==' } }, 400],
  ['11.3.1', 'two keys', { headers: { 'Sec-WebSocket-Key': `${Buffer.alloc(16).toString('base64')}\r\nSec-WebSocket-Key: ${Buffer.alloc(16).toString('base64')}` } }, 400],
  ['4.2.2', 'no version', { without: ['Sec-WebSocket-Version'] }, 426],
  ['4.4', 'version 8', { headers: { 'Sec-WebSocket-Version': '8' } }, 426],
  ['4.4', 'version 013', { headers: { 'Sec-WebSocket-Version': '013' } }, 426],
  ['11.3.5', 'two versions', { headers: { 'Sec-WebSocket-Version': '13\r\nSec-WebSocket-Version: 8' } }, 400],
  ['4.2.2', 'no subprotocol of ours', { headers: { 'Sec-WebSocket-Protocol': 'chat' } }, 400],
  ['4.2.2', 'ours among others', { headers: { 'Sec-WebSocket-Protocol': 'chat, tomocast.v1' } }, 101],
  ['11.3.4', 'ours in the second field', { headers: { 'Sec-WebSocket-Protocol': 'chat\r\nSec-WebSocket-Protocol: tomocast.v1' } }, 101],
  ['9.1', 'extensions are declined', { headers: { 'Sec-WebSocket-Extensions': 'permessage-deflate; client_max_window_bits' } }, 101],
  ['4.2.1', 'a session that is not there', { path: '/v1/sessions/none/stream' }, 404],
];

test(`${handshakes.length} handshakes`, async (t) => {
  for (const [section, what, { path, ...options }, status] of handshakes) {
    await t.test(`6455 ${section}: ${what}`, async () => {
      const reply = await handshake(d.port, path ?? `/v1/sessions/${session}/stream`, options);
      assert.equal(reply.status, status, JSON.stringify(reply.headers));
      const { headers } = reply;
      if (status === 101) {
        assert.equal(headers.upgrade.toLowerCase(), 'websocket');
        assert.equal(headers.connection.toLowerCase(), 'upgrade');
        assert.equal(headers['sec-websocket-protocol'], 'tomocast.v1');
        assert.equal(headers['sec-websocket-extensions'], undefined);
        reply.socket.destroy();
        return;
      }
      if (status === 426) assert.equal(headers.upgrade, 'websocket');
      if (what.startsWith('version')) assert.equal(headers['sec-websocket-version'], '13');
      assert.match(headers['content-type'], /^application\/problem\+json/);
      reply.socket.destroy();
    });
  }
  await t.test('6455 4.1: only GET', async () => {
    const text = await d.raw(`POST /v1/sessions/${session}/stream HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\nUpgrade: websocket\r\nConnection: Upgrade, close\r\n\r\n`);
    assert.match(text, /^HTTP\/1\.1 405 /);
  });
  await t.test('9110 7.8: an upgrade with a body, or of HTTP/1.0, is no upgrade', async () => {
    const fields = `Host: 127.0.0.1:${d.port}\r\nUpgrade: websocket\r\nConnection: Upgrade, close\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: tomocast.v1\r\n`;
    assert.match(await d.raw(`GET /v1/sessions/${session}/stream HTTP/1.1\r\n${fields}Content-Length: 2\r\n\r\n{}`), /^HTTP\/1\.1 426 /);
    assert.match(await d.raw(`GET /v1/sessions/${session}/stream HTTP/1.0\r\n${fields}\r\n`), /^HTTP\/1\.1 426 /);
  });
  await t.test('after a handshake that failed its frames are no request', async () => {
    const text = await d.raw(`GET /v1/sessions/none/stream HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\nGET /healthz HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\n\r\n`);
    assert.equal(text.match(/HTTP\/1\.1/g).length, 1, text);
  });
});

// --- sections 5 to 8: frames ---------------------------------------------------------------------------
const closing = (code, reason = '') => {
  const body = Buffer.concat([Buffer.alloc(2), Buffer.from(reason)]);
  body.writeUInt16BE(code);
  return frameBytes(body, { opcode: OP.close });
};
const control = (opcode, payload = '', options) => frameBytes(payload, { opcode, ...options });
const ping = frameBytes(JSON.stringify({ type: 'ping', t: 1 }));
const join = (...parts) => Buffer.concat(parts);
// A length in a wider form than it needs, or any 64 bits.
const wide = (length) => { const head = Buffer.alloc(14); head[0] = 0x81; head[1] = 0xff; head.writeBigUInt64BE(length, 2); return head; };
const middle = (length) => join(Buffer.of(0x81, 0xfe, length >> 8, length & 255, 0, 0, 0, 0), Buffer.alloc(length, 32));
const euro = Buffer.from('"\u20ac"');

// [section, what, bytes, code of the close that comes]
const rows = [
  ['5.1', 'an unmasked frame', frameBytes('{}', { mask: false }), 1002],
  ['5.1', 'an unmasked close', control(OP.close, '', { mask: false }), 1002],
  ['5.2', 'the first reserved bit', frameBytes('{}', { rsv: 4 }), 1002],
  ['5.2', 'the second reserved bit', frameBytes('{}', { rsv: 2 }), 1002],
  ['5.2', 'the third reserved bit', frameBytes('{}', { rsv: 1 }), 1002],
  ['5.2', 'a reserved bit in a ping', control(OP.ping, '', { rsv: 4 }), 1002],
  ...[3, 4, 5, 6, 7, 11, 12, 13, 14, 15].map((opcode) => ['5.2', `opcode ${opcode}`, frameBytes('', { opcode }), 1002]),
  ['5.2', 'a length of 64 bits whose top bit is set', wide(1n << 63n), 1002],
  ['5.2', 'a length of 64 bits, all set', wide((1n << 64n) - 1n), 1002],
  ['5.2', 'a short length in 16 bits', middle(5), 1002],
  ['5.2', 'a short length in 64 bits', wide(5n), 1002],
  ['10.4', 'a message over the limit', join(wide(70000n), Buffer.of(1)), 1009],
  ['10.4', 'a message of 2^40 bytes', join(wide(1n << 40n), Buffer.of(1)), 1009],
  ['10.4', 'fragments over the limit', join(frameBytes('x'.repeat(60000), { fin: false }), frameBytes('x'.repeat(60000), { opcode: OP.more, fin: false })), 1009],
  ['10.4', 'fragments without end', join(frameBytes('', { fin: false }), ...Array.from({ length: 3000 }, () => frameBytes(' ', { opcode: OP.more, fin: false }))), 1009],
  ['5.4', 'a thousand fragments', join(frameBytes('{', { fin: false }), ...Array.from({ length: 1000 }, () => frameBytes(' ', { opcode: OP.more, fin: false })), frameBytes('}', { opcode: OP.more }), closing(1000)), 1000],
  ['5.4', 'a continuation of nothing', frameBytes('x', { opcode: OP.more }), 1002],
  ['5.4', 'a continuation after an end', join(ping, frameBytes('x', { opcode: OP.more })), 1002],
  ['5.4', 'a new message inside another', join(frameBytes('a', { fin: false }), frameBytes('b')), 1002],
  ['5.4', 'a binary one inside a text', join(frameBytes('a', { fin: false }), frameBytes('b', { opcode: OP.binary })), 1002],
  ['5.5', 'a fragmented ping', control(OP.ping, '', { fin: false }), 1002],
  ['5.5', 'a fragmented pong', control(OP.pong, '', { fin: false }), 1002],
  ['5.5', 'a fragmented close', control(OP.close, '', { fin: false }), 1002],
  ['5.5', 'a ping of 126 bytes', control(OP.ping, 'x'.repeat(126)), 1002],
  ['5.5', 'a close of 126 bytes', control(OP.close, `\x03\xe8${'x'.repeat(124)}`), 1002],
  ['5.5.1', 'a close without a body', control(OP.close), 1005],
  ['5.5.1', 'a close of one byte', control(OP.close, Buffer.of(3)), 1002],
  ['5.5.1', 'a close with a reason', closing(1000, 'done'), 1000],
  ['5.5.1', 'a close inside a message', join(frameBytes('{', { fin: false }), closing(1001)), 1001],
  ['5.5.1', 'what follows a close is not looked at', join(closing(1000), frameBytes('{}', { mask: false })), 1000],
  ['5.5.1', 'a second close is not looked at', join(closing(1000), closing(999)), 1000],
  ['7.4', 'a reason that is not UTF-8', control(OP.close, Buffer.of(3, 232, 0xff, 0xfe)), 1007],
  ['7.4', 'a reason that breaks off in a character', control(OP.close, Buffer.of(3, 232, 0x41, 0xe2, 0x82)), 1007],
  ...[1000, 1001, 1002, 1003, 1007, 1008, 1009, 1010, 1011, 3000, 3999, 4000, 4999].map((code) => ['7.4', `close with ${code}`, closing(code), code]),
  ...[0, 1, 999, 1004, 1005, 1006, 1015, 1016, 1100, 2000, 2999, 5000, 65535].map((code) => ['7.4', `close with ${code}`, closing(code), 1002]),
  ['5.6', 'a binary message', frameBytes('x', { opcode: OP.binary }), 1003],
  ['8.1', 'no UTF-8', frameBytes(Buffer.of(0xff)), 1007],
  ['8.1', 'a surrogate', frameBytes(Buffer.of(0xed, 0xa0, 0x80)), 1007],
  ['8.1', 'an overlong slash', frameBytes(Buffer.of(0xc0, 0xaf)), 1007],
  ['8.1', 'a character over the last', frameBytes(Buffer.of(0xf4, 0x90, 0x80, 0x80)), 1007],
  ['8.1', 'a character cut by the end', frameBytes(Buffer.of(0x22, 0xe2, 0x82)), 1007],
  ['8.1', 'a character cut by the end of the last fragment', join(frameBytes(Buffer.of(0xe2), { fin: false }), frameBytes(Buffer.of(0x82), { opcode: OP.more })), 1007],
  ['8.1', 'no UTF-8 in the first of fragments, at once', frameBytes(Buffer.of(0x41, 0xff, 0x41), { fin: false }), 1007],
  ['8.1', 'no UTF-8 in a frame that is not complete, at once', frameBytes(Buffer.of(0xff, 0xff, 0xff), { size: 500 }), 1007],
];

async function closeOf(bytes, piece) {
  const ws = await Ws.open(d, session, { autoAck: false }); // nothing is sent but the row
  const gone = new Promise((resolve) => ws.socket.once('close', resolve));
  const late = setTimeout(() => ws.cut(), 20000);
  await ws.nextText('hello');
  if (!piece) ws.write(bytes);
  for (let at = 0; piece && at < bytes.length; at += piece) {
    ws.write(bytes.subarray(at, at + piece));
    await new Promise(setImmediate);
  }
  const { code } = await ws.ended;
  await gone; // the server ends the connection
  clearTimeout(late);
  return code;
}

test(`${rows.length} rows of frames`, async (t) => {
  for (const [section, what, bytes, code] of rows) {
    await t.test(`6455 ${section}: ${what}`, async () => assert.equal(await closeOf(bytes), code));
  }
});

// Of those whose fault shows with the last byte: bytes sent after the server has closed would destroy its last word.
test('one byte at a time the same comes back', async () => {
  const work = rows.filter(([section, what]) => ['5.5.1', '7.4'].includes(section) && !what.includes('looked at')).values();
  await Promise.all(Array.from({ length: 6 }, async () => {
    for (const [, what, bytes, code] of work) assert.equal(await closeOf(bytes, 1), code, what);
  }));
});

test('6455 5.5.2, 5.5.3, 5.4, 8.1: pings are echoed, between fragments too; text may be cut inside a character', async () => {
  const ws = await Ws.open(d, session);
  const echoed = [];
  ws.onPong = (payload) => echoed.push(payload.toString('latin1'));
  await ws.nextText('hello');
  const text = Buffer.from(JSON.stringify({ type: 'ping', t: 7, })), long = 'x'.repeat(125);
  ws.write(join(control(OP.ping), control(OP.ping, long), control(OP.pong, 'unasked'), frameBytes(text.subarray(0, 5), { fin: false }),
    control(OP.ping, 'inside'), frameBytes('', { opcode: OP.more, fin: false }), frameBytes(text.subarray(5), { opcode: OP.more })));
  assert.equal((await ws.nextText('pong')).t, 7);
  assert.deepEqual(echoed, ['', long, 'inside']);
  ws.write(join(frameBytes(euro.subarray(0, 2), { fin: false }), frameBytes(euro.subarray(2), { opcode: OP.more })));
  assert.equal((await ws.nextText('error')).problem.status, 422);
  ws.write(frameBytes(''));
  assert.equal((await ws.nextText('error')).problem.status, 400);
  assert.deepEqual(await ws.close(), { code: 1000, reason: '' });
});

test('frames that come with the handshake are read', async () => {
  const many = Buffer.concat(Array.from({ length: 300 }, (_, t) => frameBytes(JSON.stringify({ type: 'ping', t }))));
  const ws = await Ws.open(d, session, { extra: many });
  assert.equal((await ws.next((m) => m.type === 'pong' && m.t === 299)).t, 299);
  await ws.close();
});
