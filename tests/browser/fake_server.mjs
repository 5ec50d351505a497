// A stand-in for the daemon: the same calls and messages, pictures of a chequered ball in place of volumes.
// Tests reach into it to be slow, to fail, to drop connections, to deliver one byte at a time.
//
//   node fake_server.mjs [PORT]     runs it alone, for work on the client
import { createServer } from 'node:http';
import { readFile } from 'node:fs/promises';
import { extname, join } from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';

import { basis, dot, spanAtTarget } from '../../web/camera.js';
import { mergePatch } from '../../web/state.js';
import { sample } from '../../web/transfer_model.js';
import { jpeg, png } from './pictures.mjs';
import { accept } from './ws_server.mjs';

const WEB = fileURLToPath(new URL('../../web/', import.meta.url));
const TYPES = { '.html': 'text/html', '.js': 'text/javascript', '.css': 'text/css', '.svg': 'image/svg+xml' };
const CSP =
  "default-src 'self'; img-src 'self' blob: data:; object-src 'none'; base-uri 'none'; form-action 'none'; " +
  "frame-ancestors 'none'"; // as the daemon
const REST_MS = 150;
const WINDOW = 2;
const RADIUS_MM = 40;

const VOLUME = {
  state: 'resident',
  dims: [64, 64, 48],
  spacing: [1, 1, 1.5],
  origin: [-31.5, -31.5, -35],
  type: 'int16',
  direction: [1, 0, 0, 0, 1, 0, 0, 0, 1],
  range: [-1000, 2000],
  bytes: 393216,
  modality: 'CT',
  unit: 'HU',
};
const RAMP = [
  { value: -200, color: [0, 0, 0], opacity: 0 },
  { value: 100, color: [0.8, 0.4, 0.3], opacity: 0.3 },
  { value: 600, color: [1, 0.95, 0.85], opacity: 0.9 },
];
const PRESETS = {
  transferFunctions: [
    { name: 'fake-ramp', title: 'Ramp', modality: 'CT', unitDistance: 1, points: RAMP },
    {
      name: 'fake-bone',
      title: 'Bone',
      modality: 'CT',
      unitDistance: 1,
      points: [
        { value: 150, color: [0.7, 0.3, 0.3], opacity: 0 },
        { value: 640, color: [0.9, 0.8, 0.55], opacity: 0.7 },
      ],
    },
  ],
  windows: [{ name: 'soft', title: 'Soft tissue', modality: 'CT', center: 40, width: 400 }],
};

function defaultScene() {
  return {
    mode: 'dvr',
    image: { width: 320, height: 240, background: [0, 0, 0], format: 'jpeg', quality: 85, subsampling: 'auto' },
    camera: {
      projection: 'perspective',
      position: [0, -160, 0],
      target: [0, 0, 0],
      up: [0, 0, 1],
      fovY: 30,
      height: 90,
    },
    transferFunction: { points: RAMP, unitDistance: 1, preset: 'fake-ramp' },
    window: { center: 40, width: 400 },
    classification: 'preintegrated',
    filter: 'linear',
    sampling: { step: 0.5, raysPerPixel: 1 },
    shading: { model: 'none', ambient: 0.2, diffuse: 0.8, specular: 0.2, shininess: 20 },
    isosurface: { value: 300, color: [0.9, 0.85, 0.7] },
    mpr: { orientation: 'axial', thickness: 0, projection: 'mip', zoom: 1 },
  };
}

/** A ball with a chequer fixed to the patient: any change of the camera or of the colours shows. */
function ball(scene, width, height) {
  const { right, up, direction } = basis(scene.camera);
  const { points } = scene.transferFunction;
  const light = sample(points, 100);
  const dark = sample(points, 600);
  const paint = ({ color, amount }, shade) => color.map((c) => Math.round(255 * c * (0.3 + 0.7 * amount) * shade));
  const scale = height / spanAtTarget(scene.camera);
  const radius = RADIUS_MM * scale;
  const middle = [
    width / 2 - dot(scene.camera.target, right) * scale,
    height / 2 + dot(scene.camera.target, up) * scale,
  ];
  const ground = (scene.image.background ?? [0, 0, 0]).map((c) => c * 255);
  return (x, y) => {
    const a = (x - middle[0]) / radius;
    const b = (middle[1] - y) / radius;
    const rest = 1 - a * a - b * b;
    if (rest < 0) return ground;
    const c = Math.sqrt(rest);
    const p = [0, 1, 2].map((k) => a * right[k] + b * up[k] - c * direction[k]);
    const cell = Math.floor(p[0] * 3 + 9) + Math.floor(p[1] * 3 + 9) + Math.floor(p[2] * 3 + 9);
    return paint(cell & 1 ? light : dark, 0.35 + 0.65 * c);
  };
}

/** Labels 0, 1 and 3 occur. */
const PARTS = { edges: [0, 0.75, 1.5, 2.25, 3], counts: [9000, 500, 0, 70] };

export class FakeServer {
  /** Test knobs. */
  manner = 'whole'; // how frames are written, see ws_server.mjs
  delayMs = 0; // before each frame
  deaf = false; // patches are lost
  mute = false; // no frames
  refuse = null; // (patch) => problem or null
  acknowledged = []; // frame numbers
  patches = []; // every patch that arrived, with its time
  phases = []; // pointer phases
  cancels = []; // how many patches there were before each
  mostUnacknowledged = 0;
  uploads = []; // bodies

  #server;
  #sessions = new Map();
  #viewers = new Set();
  #volumes = new Map([
    ['ball', { id: 'ball', ...VOLUME }],
    ['parts', { ...VOLUME, id: 'parts', type: 'u8', range: [0, 3] }],
  ]);
  #next = 1;

  async start(port = 0) {
    this.#server = createServer((request, response) => {
      this.#answer(request, response).catch((error) => problem(response, 500, String(error)));
    });
    this.#server.on('upgrade', (request, socket) => this.#upgrade(request, socket));
    await new Promise((resolve) => this.#server.listen(port, '127.0.0.1', resolve));
    return this.url;
  }

  get url() {
    return `http://127.0.0.1:${this.#server.address().port}/`;
  }

  get port() {
    return this.#server.address().port;
  }

  /** @param forget the sessions too, as a daemon that keeps no journal */
  async stop(forget = true) {
    for (const viewer of this.#viewers) viewer.connection.drop();
    if (forget) this.#sessions.clear();
    this.#server.closeAllConnections();
    await new Promise((resolve) => this.#server.close(resolve));
  }

  dropConnections() {
    for (const viewer of this.#viewers) viewer.connection.drop();
  }

  scene(session) {
    return this.#sessions.get(session)?.scene;
  }

  get sessions() {
    return [...this.#sessions.keys()];
  }

  /** Somebody else's edit. */
  editFromOutside(session, patch) {
    this.edit(this.#sessions.get(session), patch);
  }

  /** Changes a scene; everybody who watches it gets a picture. */
  edit(session, patch, author = null) {
    session.scene = mergePatch(session.scene, patch);
    for (const viewer of this.#viewers) if (viewer.session === session) viewer.changed(viewer === author);
  }

  /** Sends a text message to every viewer. */
  tell(message) {
    for (const viewer of this.#viewers) viewer.connection.send(JSON.stringify(message));
  }

  /** Sends bytes that are no frame to every viewer. */
  sendGarbage() {
    for (const viewer of this.#viewers) {
      viewer.connection.send(Buffer.from([9, 0, 0]));
      viewer.connection.send('this is not JSON');
    }
  }

  async #answer(request, response) {
    const { pathname } = new URL(request.url, 'http://x');
    const parts = pathname.split('/').filter(Boolean).map(decodeURIComponent);
    if (parts[0] !== 'v1') return file(response, parts[0] ?? 'index.html');
    const handler = { about: this.#about, presets: this.#presets, volumes: this.#volume, sessions: this.#session }[
      parts[1]
    ];
    if (!handler) return problem(response, 404, 'no such call');
    return handler.call(this, request, response, parts.slice(2));
  }

  #about(_, response) {
    json(response, 200, { name: 'Fake', version: '0', backend: 'none' });
  }

  #presets(_, response) {
    json(response, 200, PRESETS);
  }

  async #volume(request, response, [id, part]) {
    if (!id && request.method === 'POST') {
      const asked = JSON.parse(await body(request));
      const loading = { id: asked.id, state: 'loading', fraction: 0.3 };
      this.#volumes.set(asked.id, loading);
      setTimeout(() => this.#volumes.set(asked.id, { ...VOLUME, id: asked.id }), 500);
      return json(response, 202, loading);
    }
    if (!id) {
      const available = [{ path: 'demo:second' }].filter(() => !this.#volumes.has('second'));
      return json(response, 200, { volumes: [...this.#volumes.values()], available });
    }
    if (request.method === 'PUT') {
      const bytes = await body(request);
      this.uploads.push(bytes);
      if (!/^(NRRD|PK)/.test(bytes.toString('latin1', 0, 4)))
        return problem(response, 415, 'this is no volume file', '');
      this.#volumes.set(id, { ...VOLUME, id, modality: 'MR' });
      return json(response, 201, this.#volumes.get(id));
    }
    if (!this.#volumes.has(id)) return problem(response, 404, `no volume "${id}"`);
    if (part === 'histogram') return json(response, 200, id === 'parts' ? PARTS : histogram());
    if (part === 'value') {
      const at = new URL(request.url, 'http://x').searchParams.get('at').split(',').map(Number);
      return json(response, 200, { at, value: 17 });
    }
    return json(response, 200, this.#volumes.get(id));
  }

  async #session(request, response, [id, part]) {
    if (!id) {
      const { volume, scene = {} } = JSON.parse(await body(request));
      if (!this.#volumes.has(volume)) return problem(response, 404, `no volume "${volume}"`);
      const made = { id: `s${process.pid}-${this.#next++}`, volume, scene: mergePatch(defaultScene(), scene) };
      this.#sessions.set(made.id, made);
      return json(response, 201, { ...made, links: {} });
    }
    const session = this.#sessions.get(id);
    if (!session) return problem(response, 404, `no session "${id}"`);
    if (request.method === 'DELETE') {
      this.#sessions.delete(id);
      return json(response, 204);
    }
    if (part === 'scene' && request.method === 'PUT') return this.#putScene(request, response, session);
    if (part === 'scene') return json(response, 200, session.scene);
    if (part === 'pick') return json(response, 200, { position: [1.25, -20, 3], value: 321, depth: 100, label: 3 });
    if (part === 'plan')
      return json(response, 200, { stages: [], quality: this.#quality(session), object: this.#object(session) });
    if (part === 'frame') return picture(response, session.scene);
    return json(response, 200, session);
  }

  /** The first answer is as of a daemon that has not measured the look yet. */
  #quality(session) {
    session.asked = (session.asked ?? 0) + 1;
    return session.asked > 1 ? { views: 3, reason: 'step 1.3: for the test' } : { views: 0, reason: 'careful' };
  }

  /** Rays are slow here: a mesh is expected to take a sixth of their time. Several surfaces are no object. */
  #object({ scene: { mode, labels, mesh } }) {
    if (labels?.volume || (mode === 'mesh' && mesh?.surfaces?.length)) return undefined;
    return mode === 'isosurface' || mode === 'mesh'
      ? { cheapest: 'mesh', expectedMs: { splat: 9, isosurface: 30, mesh: 5 } }
      : undefined;
  }

  async #putScene(request, response, session) {
    const scene = JSON.parse(await body(request));
    if ('nonsense' in scene) return problem(response, 422, 'nonsense: unknown member', '/nonsense');
    this.edit(session, mergePatch(defaultScene(), scene));
    return json(response, 200, session.scene);
  }

  #upgrade(request, socket) {
    const id = decodeURIComponent(request.url.split('/')[3] ?? '');
    const session = this.#sessions.get(id);
    if (!session) {
      socket.end('HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n');
      return;
    }
    const viewer = new Viewer(this, session, accept(request, socket, 'tomocast.v1'));
    this.#viewers.add(viewer);
    viewer.connection.onClose = () => {
      viewer.gone = true;
      this.#viewers.delete(viewer);
    };
  }
}

/** One stream: latest wins, at most WINDOW frames on their way. */
class Viewer {
  gone = false;
  #server;
  #sequence = 0;
  #frame = 0;
  #flying = new Set();
  #others = 0;
  #size = {};
  #dirty = true;
  #held = false;
  #busy = false;
  #restTimer = 0;

  constructor(server, session, connection) {
    this.#server = server;
    this.session = session;
    this.connection = connection;
    connection.manner = server.manner;
    connection.onText = (text) => this.#message(JSON.parse(text));
    connection.send(JSON.stringify({ type: 'hello', session: session.id }));
    this.changed(true);
  }

  changed(own = false) {
    this.#others += own ? 0 : 1;
    this.#dirty = true;
    this.#pump();
    this.#restSoon();
  }

  #message(message) {
    if (message.type === 'ack') this.#acknowledged(message.frame);
    else if (message.type === 'patch') this.#patch(message);
    else if (message.type === 'ping') this.connection.send(JSON.stringify({ type: 'pong', t: message.t }));
    else if (message.type === 'size') this.#resize(message);
    else if (message.type === 'pointer') this.#pointer(message.phase);
    else if (message.type === 'cancel') this.#server.cancels.push(this.#server.patches.length);
  }

  #resize({ width, height }) {
    const { image } = this.session.scene;
    const same = image.width === width && image.height === height;
    this.#size = { width, height };
    if (!same) this.changed(true);
  }

  #acknowledged(frame) {
    this.#server.acknowledged.push(frame);
    this.#flying.delete(frame);
    this.#pump();
  }

  #pointer(phase) {
    this.#server.phases.push(phase);
    this.#held = phase === 'start';
    this.#restSoon();
  }

  #patch({ seq, scene }) {
    this.#server.patches.push({ seq, scene, at: performance.now() });
    if (this.#server.deaf) return;
    const refused = this.#server.refuse?.(scene);
    if (refused) {
      this.connection.send(JSON.stringify({ type: 'error', seq, problem: refused }));
      return;
    }
    this.#sequence = seq;
    this.#server.edit(this.session, scene, this);
  }

  #restSoon() {
    clearTimeout(this.#restTimer);
    if (!this.#held) this.#restTimer = setTimeout(() => this.#send(true), REST_MS);
  }

  #pump() {
    if (this.gone || this.#server.mute || !this.#dirty || this.#busy || this.#flying.size >= WINDOW) return;
    this.#busy = true;
    setTimeout(() => {
      this.#busy = false;
      if (this.#dirty) this.#send(false);
      this.#pump();
    }, this.#server.delayMs);
  }

  #send(final) {
    if (this.gone || this.#server.mute) return;
    if (this.#flying.size >= WINDOW) {
      if (final) this.#restSoon();
      return;
    }
    this.#dirty = false;
    const image = { ...this.session.scene.image, ...this.#size };
    const shrink = final ? 1 : 0.5;
    const [width, height] = [image.width, image.height].map((n) => Math.max(8, Math.round(n * shrink)));
    const pixel = ball(this.session.scene, width, height);
    const bytes = image.format === 'png' ? png(width, height, pixel) : jpeg(width, height, pixel);
    this.#picture(width, height, bytes, final, {});
    if (final) this.#measured(this.session.scene, width, height, bytes);
  }

  /** The picture once more, with its error, as soon as the page has room for it. */
  #measured(scene, width, height, bytes) {
    const { mode, errorMeter: { pixels = 0 } = {} } = scene;
    if (!pixels || this.gone || scene !== this.session.scene) return;
    if (this.#flying.size >= WINDOW) {
      setTimeout(() => this.#measured(scene, width, height, bytes), 20);
      return;
    }
    const found = { error: { rms: 0.0016, low: 0.0012, high: 0.002, max: 0.011, pixels } };
    const depths = { depthRms: 0.03, depthP99: 0.12, depthMax: 0.4, outline: 0.01 };
    if (mode === 'mesh') Object.assign(found.error, depths, { surfaces: [{ surface: 1, pixels: 40, ...depths }] });
    const known = ['dvr', 'mesh'].includes(mode);
    this.#picture(width, height, bytes, true, known ? found : { unmeasured: 'no reference for this mode' });
  }

  #picture(width, height, bytes, final, measured) {
    const { image } = this.session.scene;
    const header = Buffer.from(
      JSON.stringify({
        frame: ++this.#frame,
        seq: this.#sequence,
        width,
        height,
        format: image.format,
        quality: image.quality,
        final,
        timing: { queueMs: 0.1, tablesMs: 0, renderMs: 4.2, encodeMs: 0.8 },
        ...measured,
        scene: this.session.scene, // the daemon sends less of it
        others: this.#others,
      }),
    );
    const size = Buffer.alloc(4);
    size.writeUInt32LE(header.length);
    this.#flying.add(this.#frame);
    this.#server.mostUnacknowledged = Math.max(this.#server.mostUnacknowledged, this.#flying.size);
    this.connection.send(Buffer.concat([size, header, bytes]));
  }
}

function histogram() {
  const edges = Array.from({ length: 65 }, (_, i) => -1000 + (i * 3000) / 64);
  const counts = edges
    .slice(1)
    .map((v) => Math.round(4e5 * Math.exp(-(((v + 950) / 60) ** 2)) + 9e3 * Math.exp(-(((v - 60) / 120) ** 2)) + 300));
  return { counts, edges };
}

function picture(response, scene) {
  const { width, height } = scene.image;
  response.writeHead(200, { 'Content-Type': 'image/png' });
  response.end(png(width, height, ball(scene, width, height)));
}

async function body(request) {
  const pieces = [];
  for await (const piece of request) pieces.push(piece);
  return Buffer.concat(pieces);
}

function json(response, status, value) {
  response.writeHead(status, { 'Content-Type': 'application/json' });
  response.end(value === undefined ? '' : JSON.stringify(value));
}

function problem(response, status, detail, pointer) {
  response.writeHead(status, { 'Content-Type': 'application/problem+json' });
  response.end(JSON.stringify({ type: 'about:blank', title: 'Refused', status, detail, pointer }));
}

async function file(response, name) {
  const bytes = /^[\w.-]+$/.test(name) && (await readFile(join(WEB, name)).catch(() => null));
  if (!bytes) return problem(response, 404, 'no such file');
  response.writeHead(200, { 'Content-Type': TYPES[extname(name)] ?? 'text/plain', 'Content-Security-Policy': CSP });
  return response.end(bytes);
}

if (import.meta.url === pathToFileURL(process.argv[1] ?? '').href) {
  const server = new FakeServer();
  console.log(await server.start(Number(process.argv[2] ?? 8090)));
}
