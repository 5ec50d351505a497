// Bodies over the limit, malformed requests on bare sockets, slow senders.
import assert from 'node:assert/strict';
import net from 'node:net';
import { after, before, test } from 'node:test';
import { Daemon, problem, sleep } from '../support/daemon.mjs';
import { ballStl, panesStl } from '../support/mesh.mjs';

let d;
before(async () => { d = await Daemon.start({ config: '[limits]\nbody_bytes=2000\n[server]\nhosts=127.0.0.1, good.example\n' }); });
after(async () => {
  assert.equal((await d.raw('GET /healthz HTTP/1.1\r\nHost: good.example\r\nConnection: close\r\n\r\n')).slice(0, 12), 'HTTP/1.1 200');
  await d.stop();
});
const status = (text) => Number(/^HTTP\/1\.1 (\d+)/.exec(text)?.[1] ?? 0);
const host = 'Host: good.example\r\n';

test('a body over the limit is refused before it is read', async () => {
  const text = await d.raw(`POST /v1/render HTTP/1.1\r\n${host}Content-Type: application/json\r\nContent-Length: 900000000\r\n\r\n`);
  assert.equal(status(text), 413);
  assert.match(text, /problem:limit/);
  const asked = await d.raw(`POST /v1/render HTTP/1.1\r\n${host}Content-Type: application/json\r\nContent-Length: 3000\r\nExpect: 100-continue\r\n\r\n`);
  assert.equal(status(asked), 413);
});

test('a body of unknown length is cut at the limit', async () => {
  const chunk = `${(1000).toString(16)}\r\n${'x'.repeat(1000)}\r\n`;
  const text = await d.raw(`POST /v1/render HTTP/1.1\r\n${host}Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n${chunk.repeat(4)}0\r\n\r\n`);
  assert.equal(status(text), 413);
});

test('malformed requests get an error or a closed connection, never a hang or a crash', async () => {
  const requests = ['\r\n\r\n\r\n', 'GET\r\n\r\n', 'GET / HTTP/9.9\r\n\r\n', 'GET /healthz HTTP/1.1\r\n\r\n', '\x16\x03\x01\x02\x00\x01\x00',
    `GET /${'a'.repeat(100000)} HTTP/1.1\r\n${host}\r\n`, `GET / HTTP/1.1\r\n${host}X: ${'b'.repeat(200000)}\r\n\r\n`,
    `POST /v1/render HTTP/1.1\r\n${host}Content-Length: -5\r\nContent-Type: application/json\r\n\r\n`,
    `POST /v1/render HTTP/1.1\r\n${host}Content-Length: 99999999999999999999\r\nContent-Type: application/json\r\n\r\n`,
    `POST /v1/render HTTP/1.1\r\n${host}Transfer-Encoding: chunked\r\nContent-Type: application/json\r\n\r\nzz\r\n`,
    Buffer.alloc(3000, 0), `BREW /v1/about HTTP/1.1\r\n${host}\r\n`];
  for (const request of requests) {
    const text = await d.raw(Buffer.from(request, 'latin1'), 1000);
    const code = status(text);
    assert.ok(code === 0 || (code >= 400 && code < 600), `${String(request).slice(0, 40)}: ${text.slice(0, 60)}`);
  }
});

test('only the configured hosts are answered', async () => {
  assert.equal(status(await d.raw('GET /healthz HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n')), 421);
  assert.equal(status(await d.raw('GET /healthz HTTP/1.1\r\nHost: GOOD.example\r\nConnection: close\r\n\r\n')), 200);
});

test('many idle connections do not keep others out', async () => {
  const sockets = Array.from({ length: 200 }, () => net.connect(d.port, '127.0.0.1'));
  await sleep(200);
  assert.equal(status(await d.raw(`GET /healthz HTTP/1.1\r\n${host}Connection: close\r\n\r\n`)), 200);
  sockets.forEach((socket) => socket.destroy());
});

test('pipelined requests are answered in order', async () => {
  const one = `GET /healthz HTTP/1.1\r\n${host}\r\n`, two = `GET /v1/nothing HTTP/1.1\r\n${host}Connection: close\r\n\r\n`;
  const text = await d.raw(one + one + two);
  assert.deepEqual([...text.matchAll(/HTTP\/1\.1 (\d+)/g)].map(([, code]) => code), ['200', '200', '404']);
});

test('names in braces of a route are not paths', async () => {
  const text = await d.raw(`GET /v1/volumes/${'v'.repeat(300)} HTTP/1.1\r\n${host}Connection: close\r\n\r\n`);
  assert.equal(status(text), 404);
});

test('a scene of too many samples is refused with a setting that passes', async () => {
  const strict = await Daemon.start({ config: '[limits]\nrender_samples=2000000\nray_samples=400\n' });
  const numbers = (json) => {
    const found = /([\d.e+]+) samples estimated for the (picture|ray), the limit is ([\d.e+]+); (?:a step of ([\d.e-]+))?( with 1 ray per pixel)?(?: and )?(?:(\d+) x (\d+) pixels)? would pass$/.exec(json.detail);
    assert.ok(found, json.detail);
    assert.ok(Number(found[1]) > Number(found[3]), json.detail);
    return { of: found[2], step: Number(found[4]), rays: found[5], width: Number(found[6]), height: Number(found[7]) };
  };
  const refused = async (scene, of, pointer) => {
    const reply = await strict.post('/v1/render', { volume: 'ball', scene });
    const found = numbers(problem(reply, 413, `/scene${pointer}`));
    assert.equal(found.of, of);
    const better = structuredClone(scene);
    if (found.step) better.sampling.step = found.step;
    if (found.rays) better.sampling.raysPerPixel = 1;
    if (found.width) Object.assign(better.image, { width: found.width, height: found.height });
    assert.equal((await strict.post('/v1/render', { volume: 'ball', scene: better })).status, 200, JSON.stringify(found));
    const worse = structuredClone(better);
    if (found.step) worse.sampling.step *= 0.97;
    else worse.image = { width: Math.ceil(1.03 * found.width), height: Math.ceil(1.03 * found.height) };
    assert.equal((await strict.post('/v1/render', { volume: 'ball', scene: worse })).status, 413, `${pointer}: the largest setting that passes is named`);
  };
  const small = { width: 96, height: 64 };
  await refused({ image: { width: 400, height: 300 }, sampling: { step: 0.2 } }, 'picture', '/sampling/step');
  await refused({ image: small, sampling: { step: 0.01 } }, 'ray', '/sampling/step');
  await refused({ image: small, sampling: { step: 0.0001, raysPerPixel: 64 }, filter: 'cubic', shading: { model: 'blinn-phong', gradient: 'cubic' } }, 'picture', '/sampling/step');
  await refused({ image: { width: 2000, height: 2000 }, mode: 'isosurface', isosurface: { value: 128 } }, 'picture', '/image/width');
  const session = await strict.session();
  problem(await strict.patch(session.links.scene, { sampling: { step: 0.001 } }), 413, '/sampling/step');
  problem(await strict.get(`${session.links.frame}?width=8000&height=2000`), 413);
  assert.equal((await strict.get(session.links.frame)).status, 200);
  const { limits } = (await strict.get('/v1/about')).json;
  assert.deepEqual([limits.renderSamples, limits.raySamples], [2000000, 400]);
  await strict.stop();
});

// A client's own mesh counts too: each translucent layer, as drawn alone and within the volume; opaque ones hide each other.
test('a mesh of many large translucent triangles is refused with a size that passes', async () => {
  const strict = await Daemon.start({ config: '[limits]\nrender_samples=4000000\n' });
  const send = (id, body) => strict.call('PUT', `/v1/meshes/${id}`, { body, type: 'application/octet-stream' });
  for (const [id, body] of [['panes', panesStl(200)], ['ball', ballStl(80)]]) {
    assert.equal((await send(id, body)).status, 202);
    await strict.loaded(`/v1/meshes/${id}`);
  }
  const ask = (mesh, opacity, of, size = 96) => strict.post('/v1/render', { volume: 'ball',
    scene: { image: { width: size, height: size }, ...of, mesh: { withVolume: of.mode === 'dvr', surfaces: [{ mesh, opacity }] } } });
  for (const of of [{ mode: 'mesh' }, { mode: 'dvr', sampling: { step: 1 } }]) {
    const { detail } = problem(await ask('panes', 0.1, of), 413, '/scene/image/width');
    const [, count, limit, side] = /^image: ([\d.e+]+) samples estimated for the picture, the limit is ([\d.e+]+); (\d+) x \3 pixels would pass$/.exec(detail);
    assert.ok(Number(count) > 2e7 && Number(limit) === 4e6 && side < 48, detail);
    assert.equal((await ask('panes', 0.1, of, Number(side))).status, 200);
    problem(await ask('panes', 0.1, of, Math.ceil(1.04 * side)), 413);
    for (const [mesh, opacity] of [['panes', 1], ['ball', 0.1]]) assert.equal((await ask(mesh, opacity, of)).status, 200);
  }
  const session = await strict.session();
  problem(await strict.patch(session.links.scene, { mode: 'mesh', mesh: { surfaces: [{ mesh: 'panes', opacity: 0.1 }] } }), 413, '/image/width');
  await strict.stop();
});

test('the default limits let large pictures pass and monsters not', async () => {
  const scene = { image: { width: 4096, height: 4096 }, sampling: { step: 0.5, raysPerPixel: 4 } };
  const monster = { filter: 'cubic', shading: { model: 'blinn-phong', gradient: 'cubic' }, sampling: { step: 0.0001, raysPerPixel: 64 } };
  assert.equal((await d.post('/v1/sessions', { volume: 'ball', scene })).status, 201);
  for (const [width, height] of [[8192, 2000], [4096, 4096]])
    problem(await d.post('/v1/sessions', { volume: 'ball', scene: { ...monster, image: { width, height } } }), 413, '/scene/sampling/step');
});
