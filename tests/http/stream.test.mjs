// WebSocket tomocast.v1: handshake, frames, flow control, refinement, refusals, several viewers.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Daemon, imageSize, problem, sleep, until } from '../support/daemon.mjs';
import { validate } from '../support/schema.mjs';
import { frameBytes, handshake, OP, Ws } from '../support/ws.mjs';

let d, api;
before(async () => {
  d = await Daemon.start();
  api = (await d.get('/v1/openapi.json')).json;
});
after(() => d.stop());

const open = async (scene, options) => {
  const session = await d.session(scene);
  return { session, ws: await Ws.open(d, session.id, options) };
};
const settle = (ws, seq) => ws.nextFrame((header) => header.final && header.seq === seq);

test('hello, then a final frame of the scene', async () => {
  const { session, ws } = await open();
  const hello = await ws.nextText('hello');
  assert.deepEqual([hello.protocol, hello.session, hello.volume], ['tomocast.v1', session.id, 'ball']);
  assert.deepEqual(hello.scene, session.scene);
  const { header, image } = await ws.nextFrame();
  assert.deepEqual(validate(header, api.components.schemas.FrameHeader, api), []);
  assert.deepEqual([header.frame, header.seq, header.final, header.width, header.height], [1, 0, true, 96, 64]);
  assert.deepEqual(imageSize(image), { format: 'jpeg', width: 96, height: 64 });
  assert.deepEqual(await ws.close(), { code: 1000, reason: '' });
});

test('a patch changes the picture; after rest the last frame is final and shows the last patch', async () => {
  const { session, ws } = await open();
  await settle(ws, 0);
  for (let seq = 1; seq <= 20; seq++) {
    ws.patch(seq, { camera: { fovY: 20 + seq } });
    await sleep(5);
  }
  const { header, image } = await settle(ws, 20);
  assert.deepEqual([header.width, header.height], [96, 64]);
  const { json } = await d.get(session.links.scene);
  assert.equal(json.camera.fovY, 40);
  const still = await d.get(session.links.frame);
  assert.ok(still.bytes.equals(image), 'the final frame is the picture of the scene');
  await sleep(300);
  assert.deepEqual(ws.frames(), [], 'nothing more comes when nothing changes');
  await ws.close();
});

test('a frame says what it shows: the scene of its patch, and how often others changed it', async () => {
  const { session, ws } = await open();
  const other = await Ws.open(d, session.id);
  await Promise.all([settle(ws, 0), settle(other, 0)]);
  for (let seq = 1; seq <= 10; seq++) ws.patch(seq, { camera: { fovY: 20 + seq } });
  await settle(ws, 10);
  for (const { header } of ws.frames().filter(({ header }) => header.seq)) {
    assert.equal(header.scene.camera.fovY, 20 + header.seq);
    assert.equal(header.others, 0);
  }
  const told = await other.nextFrame(({ final, scene }) => final && scene.camera.fovY === 30);
  assert.ok(told.header.others >= 1);
  ws.patch(11, { mode: 'mpr', mpr: { thickness: 5 } });
  const { header } = await settle(ws, 11);
  assert.deepEqual(Object.keys(header.scene), ['mode', 'image', 'window', 'mpr']);
  assert.equal(header.scene.mpr.thickness, 5);
  assert.deepEqual(validate(header, api.components.schemas.FrameHeader, api), []);
  await ws.close();
  await other.close();
});

test('while the pointer is down frames are not final; on its end the final one comes at once', async () => {
  const { ws } = await open();
  await settle(ws, 0);
  ws.send({ type: 'pointer', phase: 'start' });
  ws.patch(1, { camera: { fovY: 33 } });
  const first = await ws.nextFrame(({ seq }) => seq === 1);
  assert.equal(first.header.final, false);
  assert.ok(first.header.quality <= 75);
  const before = Date.now();
  ws.send({ type: 'pointer', phase: 'end' });
  const last = await ws.nextFrame(({ final }) => final);
  assert.equal(last.header.seq, 1);
  assert.ok(Date.now() - before < 5000);
  await ws.close();
});

test('at most two frames are unacknowledged, and the last one shows the last patch', async () => {
  const { ws } = await open({}, { autoAck: false });
  await ws.nextText('hello');
  for (let seq = 1; seq <= 40; seq++) {
    ws.patch(seq, { camera: { fovY: 10 + seq } });
    await sleep(5);
  }
  await sleep(600);
  const sent = ws.frames();
  assert.equal(sent.length, 2, 'the window is two frames');
  assert.deepEqual(sent.map(({ header }) => header.frame), [1, 2]);
  ws.ack(2);
  const { header } = await ws.nextFrame(({ frame }) => frame === 3);
  assert.deepEqual([header.seq, header.final], [40, true], 'newer scenes replaced the older ones');
  await sleep(200);
  assert.equal(ws.frames().length, 0);
  await ws.close();
});

test('a viewer that stops acknowledging renders nothing; one acknowledgement wakes it', async () => {
  const { ws } = await open({}, { autoAck: false });
  await ws.nextFrame();
  ws.patch(1, { camera: { fovY: 11 } });
  await ws.nextFrame();
  await sleep(300);
  const before = await d.metric('render_seconds_count');
  for (let seq = 2; seq < 30; seq++) ws.patch(seq, { camera: { fovY: 11 + seq } });
  await sleep(500);
  assert.equal(await d.metric('render_seconds_count'), before, 'a closed window renders nothing');
  ws.ack(1);
  await ws.nextFrame(({ seq }) => seq === 29);
  await ws.close();
});

test('a slow viewer does not slow another of the same session', async () => {
  const { session, ws: quick } = await open();
  const slow = await Ws.open(d, session.id, { autoAck: false });
  await slow.nextFrame();
  for (let seq = 1; seq <= 10; seq++) {
    quick.patch(seq, { camera: { fovY: 20 + seq } });
    await quick.nextFrame((header) => header.seq === seq);
  }
  await settle(quick, 10);
  assert.ok(slow.frames().length <= 1);
  slow.ack(2);
  const { header } = await slow.nextFrame(({ final }) => final);
  assert.equal(header.seq, 0, 'its own patches are what seq counts');
  await quick.close();
  await slow.close();
});

test('viewers of one session share frames; REST changes reach them', async () => {
  const { session, ws: a } = await open();
  const b = await Ws.open(d, session.id);
  await settle(a, 0);
  await settle(b, 0);
  const before = await d.metric('encode_seconds_count');
  const changed = await d.patch(session.links.scene, { camera: { fovY: 44 } });
  assert.equal(changed.status, 200);
  const [x, y] = await Promise.all([settle(a, 0), settle(b, 0)]);
  assert.ok(x.image.equals(y.image));
  const encoded = (await d.metric('encode_seconds_count')) - before;
  assert.ok(encoded <= 2, `one interactive and one final frame, encoded once each, not ${encoded}`);
  await a.close();
  await b.close();
});

test('a wrong patch is answered with a problem; connection and scene stay', async () => {
  const { session, ws } = await open();
  await settle(ws, 0);
  const faults = [
    [{ camera: { fovY: -5 } }, 422, '/camera/fovY'], [{ nonsense: 1 }, 422, '/nonsense'], [{ image: { width: 1e9 } }, 413, '/image/width'],
  ];
  for (const [i, [scene, status, pointer]] of faults.entries()) {
    ws.patch(100 + i, scene);
    const { seq, problem: fault } = await ws.nextText('error');
    assert.deepEqual([seq, fault.status, fault.pointer], [100 + i, status, pointer]);
    assert.deepEqual(validate(fault, api.components.schemas.Problem, api), []);
  }
  assert.deepEqual((await d.get(session.links.scene)).json, session.scene);
  ws.patch(200, { camera: { fovY: 25 } });
  await settle(ws, 200);
  await ws.close();
});

test('messages that cannot be understood are errors, not the end', async () => {
  const { ws } = await open();
  await ws.nextText('hello');
  for (const text of ['', '{', 'null', '[]', '{"type":"dance"}', '{"type":"patch"}', '{"type":"patch","seq":-1,"scene":{}}', '{"type":"ack","frame":"1"}',
    '{"type":"ack","frame":4000}', '{"type":"pointer","phase":"up"}', '['.repeat(1000), '{"type":"ping","t":1e999}']) {
    ws.frame(text);
    const { problem: fault } = await ws.nextText('error');
    assert.ok(fault.status >= 400, text);
  }
  ws.send({ type: 'ping', t: 12.5 });
  assert.equal((await ws.nextText('pong')).t, 12.5);
  await ws.close();
});

test('fragments, control frames between them, many small pieces', async () => {
  const { ws } = await open();
  await settle(ws, 0);
  const text = JSON.stringify({ type: 'patch', seq: 5, scene: { camera: { fovY: 27 } } });
  ws.frame(text.slice(0, 9), { fin: false });
  ws.frame('between', { opcode: OP.ping });
  ws.frame(text.slice(9, 20), { opcode: OP.more, fin: false });
  ws.frame(text.slice(20), { opcode: OP.more });
  await settle(ws, 5);
  assert.equal(ws.pongs, 1);
  for (const byte of frameBytes(JSON.stringify({ type: 'ping', t: 3 }))) {
    ws.write(Buffer.of(byte));
    await sleep(1);
  }
  assert.equal((await ws.nextText('pong')).t, 3);
  await ws.close();
});

test('what comes with the handshake is not lost', async () => {
  const session = await d.session();
  const ws = await Ws.open(d, session.id, { extra: frameBytes(JSON.stringify({ type: 'ping', t: 8 })) });
  assert.equal((await ws.nextText('pong')).t, 8);
  await ws.close();
});

test('broken framing closes the connection with the right code', async () => {
  const cases = [
    ['an unmasked frame', frameBytes('{}', { mask: false }), 1002], ['a reserved bit', frameBytes('{}', { rsv: 4 }), 1002],
    ['an unknown opcode', frameBytes('{}', { opcode: 3 }), 1002], ['a fragmented ping', frameBytes('', { opcode: OP.ping, fin: false }), 1002],
    ['a long ping', frameBytes('x'.repeat(126), { opcode: OP.ping }), 1002], ['a continuation of nothing', frameBytes('x', { opcode: OP.more }), 1002],
    ['not UTF-8', frameBytes(Buffer.of(0xff, 0xfe, 0xfd)), 1007], ['a binary message', frameBytes('x', { opcode: OP.binary }), 1003],
    ['a message over the limit', frameBytes('', { size: 70000 }), 1009], ['a message of 2^40 bytes', frameBytes('', { size: 2 ** 40 }), 1009],
    ['two beginnings', Buffer.concat([frameBytes('a', { fin: false }), frameBytes('b')]), 1002],
  ];
  for (const [name, bytes, code] of cases) {
    const { ws } = await open();
    await ws.nextText('hello');
    ws.write(bytes);
    assert.equal((await ws.ended).code, code, name);
  }
  assert.equal((await d.get('/healthz')).status, 200);
});

test('the handshake is checked', async () => {
  const { id } = await d.session();
  const path = `/v1/sessions/${id}/stream`;
  const status = async (options, where = path) => {
    const reply = await handshake(d.port, where, options);
    reply.socket.destroy();
    return reply.status;
  };
  assert.equal(await status({ without: ['Upgrade'] }), 426);
  assert.equal(await status({ without: ['Connection'] }), 426);
  assert.equal(await status({ headers: { 'Sec-WebSocket-Version': '8' } }), 426);
  assert.equal(await status({ without: ['Sec-WebSocket-Key'] }), 400);
  assert.equal(await status({ headers: { 'Sec-WebSocket-Key': 'short' } }), 400);
  assert.equal(await status({ without: ['Sec-WebSocket-Protocol'] }), 400);
  assert.equal(await status({ headers: { 'Sec-WebSocket-Protocol': 'chat' } }), 400);
  assert.equal(await status({ headers: { Origin: 'https://evil.example' } }), 403);
  assert.equal(await status({ headers: { Origin: 'null' } }), 403);
  assert.equal(await status({}, '/v1/sessions/none/stream'), 404);
  assert.equal(await status({ headers: { Origin: `http://127.0.0.1:${d.port}`, 'Sec-WebSocket-Protocol': 'x, tomocast.v1' } }), 101);
  problem(await d.get(path), 426);
});

test('ending the session ends the stream', async () => {
  const { session, ws } = await open();
  await ws.nextText('hello');
  await d.delete(session.links.self);
  assert.equal((await ws.ended).code, 1001);
});

test('viewers that vanish leave nothing behind', async () => {
  const { session } = await open();
  const many = await Promise.all(Array.from({ length: 20 }, () => Ws.open(d, session.id)));
  many.forEach((ws, i) => (i % 2 ? ws.cut() : ws.patch(1, { camera: { fovY: 20 + i } })));
  await sleep(50);
  many.forEach((ws) => ws.cut());
  await until(async () => (await d.metric('ws_clients')) <= 2);
  const { json } = await d.get(session.links.self);
  assert.ok(json.viewers <= 1, `${json.viewers} viewers`);
});

test('a peer that asks and never reads is not read from either', async () => {
  const { ws } = await open({}, { autoAck: false });
  await ws.nextFrame();
  ws.pause();
  const ping = frameBytes(JSON.stringify({ type: 'ping', t: 1 }));
  const burst = Buffer.concat(Array.from({ length: 2000 }, () => ping));
  for (let i = 0; i < 50; i++) ws.write(burst);
  let read = -1;
  for (let last = -2; read !== last; await sleep(500)) [last, read] = [read, await d.metric('ws_messages_total')];
  assert.ok(read < 90000, `${read} of 100000 messages were read`);
  assert.equal((await d.get('/healthz')).status, 200);
  ws.cut();
});

test('sessions render in turn', async () => {
  const pairs = await Promise.all([0, 1, 2].map(() => open({ image: { width: 256, height: 256 } })));
  await Promise.all(pairs.map(({ ws }) => settle(ws, 0)));
  const counts = await Promise.all(pairs.map(async ({ ws }) => {
    let frames = 0;
    for (const end = Date.now() + 1500; Date.now() < end; frames++) {
      ws.patch(frames + 1, { camera: { fovY: 20 + (frames % 20) } });
      await ws.nextFrame(({ seq }) => seq === frames + 1);
    }
    return frames;
  }));
  assert.ok(Math.min(...counts) * 3 > Math.max(...counts), `frames of each: ${counts}`);
  await Promise.all(pairs.map(({ ws }) => ws.close()));
});

test('loading volumes are announced', async () => {
  const { ws } = await open();
  await ws.nextText('hello');
  await d.post('/v1/volumes', { id: 'slow', path: 'demo:head' });
  const message = await ws.nextText('volume');
  assert.deepEqual([message.id, message.state], ['slow', 'loading']);
  assert.ok(message.fraction >= 0 && message.fraction <= 1);
  await ws.next((m) => m.type === 'volume' && m.id === 'slow' && m.state === 'resident');
  assert.equal((await d.get('/v1/volumes/slow')).json.state, 'resident');
  await ws.close();
});
