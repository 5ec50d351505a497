// stream.mjpeg: multipart/x-mixed-replace.
import assert from 'node:assert/strict';
import net from 'node:net';
import { after, before, test } from 'node:test';
import { Daemon, imageSize, problem, sleep, until } from '../support/daemon.mjs';

let d;
before(async () => { d = await Daemon.start({ config: '[limits]\nclients=3\nblocked_seconds=2\n' }); });
after(() => d.stop());

/** Reads parts off a fetch body: {type, bytes, headOfNext}. */
async function* parts(reply) {
  let text = Buffer.alloc(0);
  const head = /^\r\n--tomocast\r\nContent-Type: image\/(\w+)\r\n\r\n/;
  let open = null;
  for await (const piece of reply.body) {
    text = Buffer.concat([text, piece]);
    for (;;) {
      const latin = text.toString('latin1');
      const found = head.exec(latin);
      if (!open && found) { open = found[1]; text = text.subarray(found[0].length); continue; }
      const next = latin.indexOf('\r\n--tomocast\r\nContent-Type: ');
      if (!open || next < 0 || !head.test(latin.slice(next))) break;
      yield { type: open, bytes: text.subarray(0, next) };
      text = text.subarray(next);
      open = null;
    }
  }
}

const gone = () => until(async () => (await d.metric('mjpeg_clients')) === 0);

test('pictures come as parts, each closed at once by the head of the next', async () => {
  const { links } = await d.session();
  const stop = new AbortController();
  const reply = await fetch(d.base + links.mjpeg, { signal: stop.signal });
  assert.match(reply.headers.get('content-type'), /^multipart\/x-mixed-replace; boundary=tomocast$/);
  const stream = parts(reply);
  const first = (await stream.next()).value;
  assert.equal(first.type, 'jpeg');
  assert.deepEqual(imageSize(first.bytes), { format: 'jpeg', width: 96, height: 64 });
  await d.patch(links.scene, { image: { width: 80 } });
  let last;
  do last = (await stream.next()).value; while (imageSize(last.bytes).width !== 80);
  await d.patch(links.scene, { image: { format: 'png' } });
  do last = (await stream.next()).value; while (last.type !== 'png');
  assert.equal(imageSize(last.bytes).format, 'png');
  stop.abort();
  await gone();
});

test('the end of the session ends the stream', async () => {
  const { links } = await d.session();
  const reply = await fetch(d.base + links.mjpeg);
  const stream = parts(reply);
  await stream.next();
  await d.delete(links.self);
  assert.equal((await stream.next()).done, true);
  await gone();
});

test('a viewer that never reads holds up nobody, and is forgotten when it goes', async () => {
  const { links } = await d.session({ image: { width: 500, height: 500 } });
  const socket = net.connect(d.port, '127.0.0.1', () => socket.write(`GET ${links.mjpeg} HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\n\r\n`));
  socket.pause();
  for (let i = 0; i < 10; i++) assert.equal((await d.patch(links.scene, { camera: { fovY: 20 + i } })).status, 200);
  assert.equal((await d.get(`${links.frame}?width=32&height=32`)).status, 200);
  socket.destroy();
  await gone();
});

test('a viewer that reads nothing while pictures flow is ended', async () => {
  const { links } = await d.session({ image: { width: 700, height: 700, format: 'png' } });
  const socket = net.connect(d.port, '127.0.0.1', () => socket.write(`GET ${links.mjpeg} HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\n\r\n`));
  socket.on('error', () => {});
  socket.pause(); // its end is open: the peer's kernel goes on answering
  await until(() => d.metric('mjpeg_clients'));
  const end = Date.now() + 15000; // the library alone would take 30 s
  for (let i = 0; Date.now() < end && (await d.metric('mjpeg_clients')); i++) {
    await d.patch(links.scene, { camera: { fovY: 20 + (i % 40) } });
    await sleep(50);
  }
  assert.equal(await d.metric('mjpeg_clients'), 0);
  socket.destroy();
});

test('viewers are limited', async () => {
  const { links } = await d.session();
  const stops = [0, 1, 2].map(() => new AbortController());
  for (const { signal } of stops) assert.equal((await fetch(d.base + links.mjpeg, { signal })).status, 200);
  const reply = await d.get(links.mjpeg);
  problem(reply, 503);
  assert.ok(reply.headers.get('retry-after'));
  const other = (await d.session()).links.mjpeg; // who has none yet is let in, once
  stops.push(new AbortController());
  assert.equal((await fetch(d.base + other, { signal: stops.at(-1).signal })).status, 200);
  problem(await d.get(other), 503);
  stops.forEach((stop) => stop.abort());
  await gone();
});

test('HEAD and a session that is not there', async () => {
  const { links } = await d.session();
  assert.equal((await d.call('HEAD', links.mjpeg)).status, 200);
  problem(await d.get('/v1/sessions/none/stream.mjpeg'), 404);
});
