// Bad clients by name, each bounded in count; measure.mjs bounds them in time.
//
// A row: says (one line for people), run(bad) and, for a daemon the tool starts itself, limits and server of its
// configuration, files that it may open and readLog. `bad` is {target, volume, image, rate, stopped: AbortSignal, count(kind)}.
import { gzipSync } from 'node:zlib';

import { Client } from './client.mjs';
import { synthetic } from './motion.mjs';

const HANDS = { dragMs: 2000, thinkMs: 500 };
const CUBIC_LIT = { filter: 'cubic', shading: { model: 'blinn-phong', gradient: 'cubic' } };

export const BAD = {
  ordinary: {
    says: 'one more ordinary client: what the others are compared with',
    run: (bad) => drag(bad, {}),
  },
  'huge-drag': {
    says: 'drags 8192x2000 pixels with 16 cubic rays each',
    run: (bad) => drag(bad, { image: { width: 8192, height: 2000 }, look: { filter: 'cubic', sampling: { raysPerPixel: 16 } } }),
  },
  'monster-tile': {
    says: 'renders of one tile, 32x32, cubic and lit, a step of 1e-4 voxel, 64 rays a pixel',
    run: (bad) => loops(bad, 2, 100, () => render(bad, { ...CUBIC_LIT, sampling: { step: 1e-4, raysPerPixel: 64 }, image: { width: 32, height: 32 } })),
  },
  'render-flood': {
    says: '20 parallel renders of 1024x1024, over and over',
    run: (bad) => loops(bad, 20, 500, (n) => render(bad, { image: { width: 1024, height: 1024 }, camera: { fovY: 25 + (n % 97) / 10 } })),
  },
  'patch-flood': {
    says: 'patches as fast as the connection takes them, 100,000 at most',
    run: patchFlood,
  },
  'empty-patches': {
    says: 'empty patches on a session of 11,000 knots, 20,000 at most',
    run: emptyPatches,
  },
  'ray-abandon': {
    says: '750 calls of /ray, left before the answer',
    run: rayAbandon,
  },
  'ray-large': {
    says: '/ray answers of 10 MB, one after the other',
    run: async (bad) => {
      const session = await begin(bad, manyKnots(12000));
      await loops(bad, 1, 200, () => call(bad, 'GET', `/v1/sessions/${session}/ray?x=64&y=64`));
    },
  },
  'histogram-large': {
    says: 'histograms of 65,536 bins, one after the other',
    run: (bad) => loops(bad, 1, 2000, () => call(bad, 'GET', `/v1/volumes/${bad.volume}/histogram?bins=65536`)),
  },
  'slow-reader': {
    says: '8 viewers that drag 1024x1024 and read 1 byte a second',
    run: (bad) => viewers(bad, 8, { image: { width: 1024, height: 1024 } }, readSlowly),
  },
  'never-ack': {
    says: '8 viewers that drag and never acknowledge',
    run: (bad) => viewers(bad, 8, {}, () => {}),
  },
  'slow-upload': {
    says: '513 uploads at 1 byte in 20 s, to a daemon of 1024 open files',
    files: 1024,
    run: slowUpload,
  },
  'bzip2-bomb': {
    says: 'two uploads of 7 KB that decode to 6.4 GB each',
    run: (bad) => uploads(bad, 2, bzip2Bomb(140)),
  },
  'failed-entries': {
    says: '2000 loads of files that are not there',
    run: (bad) => loops(bad, 16, 125, (n) => call(bad, 'POST', '/v1/volumes', { json: { id: `failed-${n}`, path: `demo:absent-${n}` } })),
  },
  'load-over-budget': {
    says: 'four volumes of 52 MB at once where 70 MB are allowed',
    limits: { volume_bytes: 70e6 },
    run: (bad) => uploads(bad, 4, emptyVolume(373)),
  },
  'non-reading-viewers': {
    says: '60 viewers of a 1024x1024 PNG that read nothing',
    run: nonReadingViewers,
  },
  'half-open-mjpeg': {
    says: '60 viewers of MJPEG that read nothing, half of them with their sending side closed',
    run: halfOpenMjpeg,
  },
  'full-stderr': {
    says: 'failed loads that fill a log nobody reads',
    readLog: false, server: { log_level: 'debug' },
    run: (bad) => loops(bad, 4, 1000, (n) => call(bad, 'POST', '/v1/volumes', { json: { id: `unread-${n}`, path: `demo:absent-${n}` } })),
  },
};

/* --- what they are made of ---------------------------------------------------------------------------- */

const rest = (bad, ms) => new Promise((resolve) => {
  const timer = setTimeout(done, bad.stopped.aborted ? 0 : ms);
  function done() { clearTimeout(timer); bad.stopped.removeEventListener('abort', done); resolve(); }
  bad.stopped.addEventListener('abort', done);
});

async function call(bad, method, path, options = {}) {
  try {
    const { status } = await bad.target.request(method, path, { patienceMs: 60000, ...options });
    bad.count(String(status));
  } catch (error) {
    bad.count(error.code ?? error.message);
    await rest(bad, 100); // a daemon that refuses connections is not asked a thousand times a second
  }
}

const render = (bad, scene) => call(bad, 'POST', '/v1/render', { json: { volume: bad.volume, format: 'jpeg', scene } });

/** `parallel` loops of at most `most` calls each. */
async function loops(bad, parallel, most, what) {
  await Promise.all(Array.from({ length: parallel }, async (_, lane) => {
    for (let i = 0; i < most && !bad.stopped.aborted; i++) await what(i * parallel + lane);
  }));
}

async function begin(bad, look) {
  const image = { width: 128, height: 128, ...look.image };
  return (await bad.target.json('POST', '/v1/sessions', { volume: bad.volume, scene: { ...look, image } }, { patienceMs: 30000 })).id;
}

const hands = (index) => (scene) => synthetic(scene, index, HANDS);

/** A client that behaves but for what it asks for. */
async function drag(bad, { image = bad.image, look }) {
  const client = new Client({ ...bad, image, look, motionOf: hands(0) });
  await client.open();
  bad.count('session');
  client.start();
  await rest(bad, 1e9);
  for (let i = client.frames.length; i > 0; i--) bad.count('frames');
  await client.close();
}

/** Sessions dragged by streams that are read as `how` says and that acknowledge nothing. */
async function viewers(bad, many, { image = bad.image }, how) {
  const open = [];
  for (let i = 0; i < many && !bad.stopped.aborted; i++) {
    const { id, scene } = await bad.target.json('POST', '/v1/sessions', { volume: bad.volume, scene: { image } });
    const ws = await bad.target.stream(id, { onMessage: (message) => bad.count(message.header ? 'frames' : message.type) });
    open.push({ ws, motion: hands(i)(scene), timer: how(ws) });
    ws.ended.then(() => bad.count('closed'));
  }
  const began = performance.now();
  for (let seq = 1; !bad.stopped.aborted; seq++) {
    for (const { ws, motion } of open) {
      const patch = motion(performance.now() - began);
      if (patch && !ws.closed && ws.socket.writableLength < 1 << 20) ws.patch(seq, patch);
    }
    await rest(bad, 1000 / bad.rate);
  }
  for (const { ws, timer } of open) { clearInterval(timer); ws.cut(); }
}

function readSlowly(ws) {
  ws.socket.removeAllListeners('data');
  ws.socket.pause();
  return setInterval(() => ws.socket.read(1), 1000);
}

async function patchFlood(bad) {
  const { id, scene } = await bad.target.json('POST', '/v1/sessions', { volume: bad.volume, scene: { image: bad.image } });
  const ws = await bad.target.stream(id, { onMessage: ({ header }) => header && (ws.ack(header.frame), bad.count('frames')) });
  const motion = hands(0)(scene);
  for (let seq = 1; seq <= 1e5 && !bad.stopped.aborted && !ws.closed;) {
    for (let i = 0; i < 100; i++, seq++) ws.patch(seq, motion(seq % HANDS.dragMs) ?? {});
    while (ws.socket.writableLength > 1 << 18 && !bad.stopped.aborted && !ws.closed) await rest(bad, 1);
    bad.count('hundreds of patches');
    await new Promise(setImmediate);
  }
  await rest(bad, 1e9);
  ws.cut();
}

async function emptyPatches(bad) {
  const session = await begin(bad, manyKnots(11000));
  const ws = await bad.target.stream(session, { onMessage: ({ header }) => header && ws.ack(header.frame) });
  for (let seq = 1; seq <= 20000 && !bad.stopped.aborted && !ws.closed;) {
    for (let i = 0; i < 100; i++, seq++) ws.patch(seq, {});
    bad.count('hundreds of patches');
    while (ws.socket.writableLength > 1 << 16 && !bad.stopped.aborted && !ws.closed) await rest(bad, 5);
    await rest(bad, 50);
  }
  await rest(bad, 1e9);
  ws.cut();
}

async function rayAbandon(bad) {
  const session = await begin(bad, manyKnots(11000));
  for (let n = 0; n < 750 && !bad.stopped.aborted;) {
    const sockets = Array.from({ length: 25 }, () => ask(bad, `/v1/sessions/${session}/ray?x=${n++ % 128}&y=64`));
    await rest(bad, 50);
    for (const socket of sockets) { socket.destroy(); bad.count('abandoned'); }
  }
}

/** A transfer function of `count` knots, thin enough that rays go on to the end: /ray lists 10 MB of pieces. */
function manyKnots(count) {
  const knot = (_, i) => ({ value: -1000 + (i * 3000) / count, color: [1, 1, 1], opacity: (i % 9) / 9e5 });
  return { transferFunction: { points: Array.from({ length: count }, knot) } };
}

/** A request on a socket of its own whose answer is not read. */
function ask(bad, path, head = '', method = 'GET') {
  const socket = bad.target.connect();
  const headers = Object.entries({ Host: bad.target.base.host, ...bad.target.headers() }).map(([name, value]) => `${name}: ${value}\r\n`);
  socket.on('error', (error) => bad.count(error.code));
  socket.on('close', () => bad.count('closed'));
  socket.pause();
  socket.write(`${method} ${bad.target.path(path)} HTTP/1.1\r\n${headers.join('')}${head}\r\n`);
  return socket;
}

async function slowUpload(bad) {
  const sockets = [];
  for (let n = 0; n < 513 && !bad.stopped.aborted; n++) {
    const head = 'Content-Type: application/octet-stream\r\nContent-Length: 1000000\r\n';
    sockets.push(ask(bad, `/v1/volumes/slow-${n}`, head, 'PUT'));
    sockets[n].resume();
    if (n % 50 === 49) await rest(bad, 50);
  }
  bad.count('all asked');
  while (!bad.stopped.aborted) {
    for (const socket of sockets) if (socket.writable) socket.write('N');
    await rest(bad, 20000);
  }
  for (const socket of sockets) socket.destroy();
}

const uploads = (bad, many, bytes) =>
  loops(bad, many, 1, (n) => call(bad, 'PUT', `/v1/volumes/load-${n}`, { body: bytes, type: 'application/octet-stream' }));

const nrrd = (side, type, encoding) =>
  `NRRD0004\ntype: ${type}\nendian: little\ndimension: 3\nsizes: ${side} ${side} ${side}\nspacings: 1 1 1\nencoding: ${encoding}\n\n`;

const emptyVolume = (side) => Buffer.concat([Buffer.from(nrrd(side, 'uint8', 'gzip')), gzipSync(Buffer.alloc(side ** 3))]);

// One bzip2 block of 45,899,235 zeros is exactly 32 bytes, so that blocks can be put one after the other.
const BLOCK = Buffer.from('3141592653590e09e2df015f8e4000c0000008200030804d4642a025a90a8097', 'hex');
const BLOCK_CRC = 0x0e09e2df;
const BLOCK_ZEROS = 45899235;

/** An NRRD of `blocks` bzip2 blocks: 32 bytes each, 46 MB of zeros each. */
export function bzip2Bomb(blocks) {
  let crc = 0;
  for (let i = 0; i < blocks; i++) crc = (((crc << 1) | (crc >>> 31)) ^ BLOCK_CRC) >>> 0;
  const end = Buffer.from('177245385090', 'hex');
  const sum = Buffer.alloc(4);
  sum.writeUInt32BE(crc);
  const side = Math.floor(Math.cbrt((blocks * BLOCK_ZEROS) / 8));
  return Buffer.concat([Buffer.from(nrrd(side, 'double', 'bzip2')), Buffer.from('BZh9'), ...new Array(blocks).fill(BLOCK), end, sum]);
}

async function nonReadingViewers(bad) {
  const image = { width: 1024, height: 1024, format: 'png' };
  const session = await begin(bad, { image });
  const open = [];
  for (let i = 0; i < 60 && !bad.stopped.aborted; i++) {
    const ws = await bad.target.stream(session, { onMessage: () => {} });
    ws.pause();
    ws.ended.then(() => bad.count('closed'));
    open.push(ws);
    bad.count('viewers');
  }
  await steer(bad, session);
  for (const ws of open) ws.cut();
}

async function halfOpenMjpeg(bad) {
  const session = await begin(bad, { image: { width: 512, height: 512 } });
  const sockets = [];
  for (let i = 0; i < 60 && !bad.stopped.aborted; i++) {
    const socket = ask(bad, `/v1/sessions/${session}/stream.mjpeg`);
    if (i % 2) socket.end();
    sockets.push(socket);
    bad.count('viewers');
  }
  await steer(bad, session);
  for (const socket of sockets) socket.destroy();
}

/** Somebody who reads and turns the picture ten times a second, so that there is something not to read. */
async function steer(bad, session) {
  const ws = await bad.target.stream(session, { onMessage: ({ header }) => header && (ws.ack(header.frame), bad.count('frames')) });
  for (let seq = 1; !bad.stopped.aborted && !ws.closed; seq++) {
    ws.patch(seq, { camera: { fovY: 28 + (seq % 40) / 10 } });
    await rest(bad, 100);
  }
  ws.cut();
}
