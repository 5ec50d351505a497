import assert from 'node:assert/strict';
import { mock, test } from 'node:test';

import { Wire, waitBefore } from '../../web/wire.js';

class FakeSocket {
  static made = [];
  sent = [];
  closed = false;

  constructor(url, protocols) {
    Object.assign(this, { url, protocols });
    FakeSocket.made.push(this);
  }

  send(text) {
    this.sent.push(JSON.parse(text));
  }

  close() {
    this.closed = true;
  }
}

/** Fake time: `tick` and `reset`. Node 18 mocks timers, not yet Date. */
function fakeTime() {
  try {
    mock.timers.enable({ apis: ['setTimeout', 'Date'] });
    return { tick: (ms) => mock.timers.tick(ms), reset: () => mock.timers.reset() };
  } catch {
    const { now } = Date;
    let time = now();
    mock.timers.enable(['setTimeout']);
    Date.now = () => time;
    return {
      tick(ms) {
        for (let left = ms; left > 0; left -= 10) {
          const step = Math.min(10, left);
          time += step;
          mock.timers.tick(step);
        }
      },
      reset() {
        Date.now = now;
        mock.timers.reset();
      },
    };
  }
}

/** A wire on fake sockets and fake time. @param body receives {wire, states, next} */
async function withWire(locate, body) {
  const time = fakeTime();
  FakeSocket.made = [];
  const states = [];
  const texts = [];
  const bytes = [];
  const wire = new Wire(
    locate,
    {
      onState: (state) => states.push(state),
      onText: (text) => texts.push(text),
      onBytes: (piece) => bytes.push(piece),
    },
    FakeSocket,
  );
  try {
    await body({
      wire,
      states,
      texts,
      bytes,
      socket: () => FakeSocket.made.at(-1),
      settle,
      tick: time.tick,
    });
  } finally {
    wire.close();
    time.reset();
  }
}

const settle = async () => {
  for (let i = 0; i < 5; i++) await null;
};
const here = async () => ({ url: 'ws://here/stream' });

test('opens with the subprotocol and delivers both kinds of message', () =>
  withWire(here, async ({ wire, states, texts, bytes, socket }) => {
    await wire.open();
    assert.deepEqual([socket().url, socket().protocols], ['ws://here/stream', ['tomocast.v1']]);
    assert.equal(wire.send({ a: 1 }), false, 'nothing is sent before it is open');
    socket().onopen();
    assert.equal(wire.send({ a: 1 }), true);
    socket().onmessage({ data: '{"type":"hello"}' });
    socket().onmessage({ data: 'not JSON' });
    socket().onmessage({ data: 'null' });
    socket().onmessage({ data: new Uint8Array([1, 2]).buffer });
    assert.deepEqual(texts, [{ type: 'hello' }]);
    assert.deepEqual([...bytes[0]], [1, 2]);
    assert.deepEqual(
      states.map(({ state }) => state),
      ['connecting', 'open'],
    );
  }));

test('comes back after a loss, waiting longer each time, and at once after a success', () =>
  withWire(here, async ({ wire, states, socket, tick }) => {
    await wire.open();
    const waits = [];
    for (let attempt = 0; attempt < 6; attempt++) {
      socket().onclose({ code: 1006 });
      waits.push(states.at(-1).inMs);
      const made = FakeSocket.made.length;
      tick(states.at(-1).inMs - 1);
      await settle();
      assert.equal(FakeSocket.made.length, made, 'not early');
      tick(1);
      await settle();
      assert.equal(FakeSocket.made.length, made + 1);
    }
    assert.deepEqual(waits, [500, 1000, 2000, 4000, 8000, 8000]);
    socket().onopen();
    socket().onclose({ code: 1012, reason: 'restart' });
    assert.deepEqual(states.at(-1), { state: 'waiting', inMs: waitBefore(0), reason: 'restart' });
  }));

test('an address that cannot be found is a failed attempt; a fatal one ends them', async () => {
  let error = new Error('down');
  await withWire(
    async () => {
      throw error;
    },
    async ({ wire, states, tick }) => {
      await wire.open();
      assert.equal(states.at(-1).state, 'waiting');
      error = Object.assign(new Error('gone'), { fatal: true });
      tick(500);
      await settle();
      assert.deepEqual(states.at(-1), { state: 'closed', reason: 'gone' });
    },
  );
});

test('retryNow does not wait for the countdown, and leaves no second attempt behind', () =>
  withWire(here, async ({ wire, socket, tick }) => {
    await wire.open();
    socket().onclose({ code: 1006 });
    wire.retryNow();
    await settle();
    assert.equal(FakeSocket.made.length, 2);
    socket().onopen();
    tick(5000);
    await settle();
    assert.equal(FakeSocket.made.length, 2);
  }));

test('silence: pings, then gives the connection up', () =>
  withWire(here, async ({ wire, states, socket, tick }) => {
    await wire.open();
    socket().onopen();
    tick(15000);
    assert.equal(socket().sent.at(-1).type, 'ping');
    socket().onmessage({ data: '{"type":"pong"}' });
    tick(15000);
    tick(15000);
    assert.equal(wire.state, 'waiting');
    assert.match(states.at(-1).reason, /silent/);
    assert.equal(FakeSocket.made[0].closed, true);
  }));

test('an attempt that hangs is given up', () =>
  withWire(here, async ({ wire, tick }) => {
    await wire.open();
    tick(8000);
    assert.equal(wire.state, 'waiting');
  }));

test('after close nothing comes back, and late events of old sockets are dropped', () =>
  withWire(here, async ({ wire, states, socket, tick }) => {
    await wire.open();
    const old = socket();
    const { onclose, onmessage } = old;
    wire.close();
    onclose({ code: 1006 });
    onmessage({ data: '{"type":"hello"}' });
    tick(60000);
    await settle();
    assert.equal(states.at(-1).state, 'closed');
    assert.equal(FakeSocket.made.length, 1);
  }));
