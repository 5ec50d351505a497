// The error meter of a session: figures beside a final frame, none when off, a reason where there is no reference.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Daemon, sleep, until } from '../support/daemon.mjs';
import { ballStl } from '../support/mesh.mjs';
import { validate } from '../support/schema.mjs';
import { Ws } from '../support/ws.mjs';

let d, api;
before(async () => {
  d = await Daemon.start();
  api = (await d.get('/v1/openapi.json')).json;
});
after(() => d.stop());

const open = async (scene) => {
  const session = await d.session(scene);
  return { session, ws: await Ws.open(d, session.id) };
};
/** The meter stops after some seconds: on a loaded machine its sample is smaller than asked for. */
const sampled = ({ pixels }, most) => assert.ok(pixels > 0 && pixels <= most, `${pixels} pixels of ${most}`);
const measured = (ws, seq) => ws.nextFrame((header) => header.final && header.seq === seq && header.error);
const stageOf = async (session, name) =>
  (await d.get(session.links.plan)).json.stages.find((stage) => stage.name === name);
const metric = async (name) => {
  const text = (await d.get('/metrics')).bytes.toString();
  return Number(new RegExp(`^tomocast_${name} (.*)$`, 'm').exec(text)[1]);
};

test('a final frame comes once more with its error, and the session has it', async () => {
  const { session, ws } = await open({ errorMeter: { pixels: 64 } });
  const first = await ws.nextFrame(({ final }) => final);
  const { header, image } = first.header.error ? first : await measured(ws, 0);
  assert.deepEqual(validate(header, api.components.schemas.FrameHeader, api), []);
  const { rms, low, high, max } = header.error;
  sampled(header.error, 64);
  assert.ok(low <= rms && rms <= high && rms <= max && max < 0.2, JSON.stringify(header.error));
  assert.ok(image.equals(first.image), 'the same picture');
  assert.equal(header.timing.renderMs, first.header.timing.renderMs, 'beside its own run time');
  await sleep(300);
  assert.deepEqual(ws.frames(), [], 'once');
  const { json } = await d.get(session.links.self);
  assert.deepEqual(validate(json, api.components.schemas.Session, api), []);
  assert.deepEqual(json.error, header.error);
  assert.ok((await stageOf(session, 'error-meter')).included);
  const late = await Ws.open(d, session.id);
  assert.deepEqual((await late.nextFrame()).header.error, header.error, 'a later viewer gets it at once');
  await late.close();
  await ws.close();
});

test('uploaded meshes are measured against their triangles, in light of several colours', async () => {
  const sent = await d.call('PUT', '/v1/meshes/leaf', { body: ballStl(10), type: 'application/octet-stream' });
  assert.equal(sent.status, 202);
  await d.loaded('/v1/meshes/leaf');
  const surfaces = [{ mesh: 'leaf', opacity: 0.5 }, { plane: 'axial' }];
  const lights = [{ color: [1, 0, 0] }, { direction: [0, -1, 0], intensity: 2 }];
  for (const mode of ['mesh', 'mip']) {
    const { session, ws } = await open({ mode, mesh: { surfaces, lights, withVolume: true }, errorMeter: { pixels: 200 } });
    const { header } = await measured(ws, 0);
    sampled(header.error, 200);
    assert.ok(header.error.rms < 0.01, `${mode} ${JSON.stringify(header.error)}`);
    assert.ok((await stageOf(session, 'error-meter')).included);
    await ws.close();
  }
});

test('surfaces are measured in depth and outline, each by itself', async () => {
  const scene = { mode: 'mesh', errorMeter: { pixels: 2000 } };
  const measure = async (rest) => {
    const { ws } = await open({ ...scene, ...rest });
    const { header } = await measured(ws, 0);
    assert.deepEqual(validate(header, api.components.schemas.FrameHeader, api), []);
    await ws.close();
    return header.error;
  };
  const most = [[{ mesh: 'leaf' }, 1e-4], [{ value: 150 }, 2]]; // mm: its triangles are the truth; a ball of steps within its voxels
  for (const [surface, bound] of most) {
    const error = await measure({ mesh: { surfaces: [surface] } });
    assert.ok(error.depthRms > 0 && error.depthRms <= error.depthMax && error.depthRms < bound, JSON.stringify(error));
    assert.ok(error.depthP99 <= error.depthMax && error.outline <= 0.01, JSON.stringify(error));
  }
  const error = await measure({ mesh: { surfaces: [{ mesh: 'leaf' }] }, sampling: { raysPerPixel: 4 } });
  assert.ok(error.depthMax < 0.02, JSON.stringify(error)); // between the depths of the pixel's rays, but for perspective
  const both = await measure({ mesh: { surfaces: [{ value: 150, opacity: 0.5 }, { plane: 'coronal' }] } });
  const each = both.surfaces.toSorted((a, b) => a.surface - b.surface);
  assert.deepEqual(each.map(({ surface }) => surface), [0, 1], JSON.stringify(both));
  assert.ok(each[0].depthP99 > 1 && each[1].depthP99 < 1e-3, JSON.stringify(both)); // a plane is exact
  assert.ok(both.layers.length > 1 && both.layers[0].depthRms === both.depthRms && !('surface' in both.layers[1]), JSON.stringify(both));
  assert.ok(both.layers.every(({ pixels }, i) => i === 0 || pixels <= both.layers[i - 1].pixels), JSON.stringify(both));
  assert.equal(error.layers, undefined); // nothing is seen through an opaque surface
  const labels = (await measure({ labels: { volume: 'ball', force: true } })).surfaces;
  assert.ok(labels.length > 0 && labels.every(({ label, surface }) => label > 0 && surface === undefined), JSON.stringify(labels));
});

test('a frame that is asked for by itself is measured where nobody looks on', async () => {
  const session = await d.session({ errorMeter: { pixels: 64 }, image: { width: 64, height: 64 } });
  const frame = (query = '') => d.get(`${session.links.frame}${query}`);
  const known = (most = 64) => until(async () => {
    const { json } = await d.get(session.links.self);
    return (json.unmeasured || json.error?.pixels <= most) && json;
  });
  assert.equal((await d.get(session.links.self)).json.error, undefined);
  assert.equal((await frame()).status, 200);
  const first = await known();
  assert.deepEqual(validate(first, api.components.schemas.Session, api), []);
  assert.ok(first.error.rms > 0 && first.error.rms <= first.error.max, JSON.stringify(first));
  const pixels = await metric('meter_pixels_total');
  assert.equal((await frame('?format=png')).status, 200);
  await sleep(200);
  assert.equal(await metric('meter_pixels_total'), pixels, 'the same picture again is known');
  assert.equal((await frame('?width=8&height=5')).status, 200);
  await known(8 * 5); // another size is another picture
  // A change makes what was found history; what has no reference says so.
  await d.patch(session.links.scene, { sampling: { step: 0.1 } });
  assert.equal((await d.get(session.links.self)).json.error, undefined);
  await frame();
  assert.ok((await known()).error.rms < first.error.rms);
  await d.patch(session.links.scene, { mode: 'mpr' });
  await frame();
  const without = await known();
  assert.deepEqual(validate(without, api.components.schemas.Session, api), []);
  assert.match(without.unmeasured, /mode/);
  // A viewer's picture has the meter.
  await d.patch(session.links.scene, { mode: 'dvr' });
  const ws = await Ws.open(d, session.id);
  const { header } = await measured(ws, 0);
  await frame('?width=8&height=5');
  await sleep(200);
  assert.deepEqual((await d.get(session.links.self)).json.error, header.error);
  await ws.close();
});

test('a session that ends, or changes, while a frame of its own is measured', async () => {
  for (let i = 0; i < 6; i++) {
    const session = await d.session({ errorMeter: { pixels: 65536 } });
    const pending = d.get(session.links.frame);
    if (i % 2) await pending;
    if (i % 3) await d.patch(session.links.scene, { sampling: { step: 2 } });
    assert.equal((await d.delete(session.links.self)).status, 204);
    await pending;
  }
  assert.equal((await d.get('/healthz')).status, 200);
});

test('a smaller step has a smaller error', async () => {
  const { ws } = await open({ errorMeter: { pixels: 512 }, sampling: { step: 4, termination: 0 } });
  const coarse = (await measured(ws, 0)).header.error;
  ws.patch(1, { sampling: { step: 0.25 } });
  const fine = (await measured(ws, 1)).header.error;
  assert.ok(fine.high < coarse.low / 4, `${JSON.stringify(coarse)} ${JSON.stringify(fine)}`);
  await ws.close();
});

test('several rays a pixel and labels are measured', async () => {
  const meter = { errorMeter: { pixels: 200 }, image: { width: 64, height: 64 } };
  const scenes = [{ sampling: { raysPerPixel: 4, step: 0.05 } },
    { labels: { volume: 'ball', force: true, opacity: 0.5 }, sampling: { step: 0.2 } }, { mode: 'isosurface', isosurface: { value: 150 } },
    { mode: 'isosurface', isosurface: { value: 150 }, sampling: { raysPerPixel: 8 } }];
  for (const scene of scenes) {
    const { session, ws } = await open({ ...meter, ...scene });
    const { header } = await measured(ws, 0);
    assert.equal(header.unmeasured, undefined);
    sampled(header.error, 200);
    assert.ok(header.error.rms < 4e-3, JSON.stringify([scene, header.error])); // fine steps: of any other truth it were not
    assert.equal(header.error.depthRms !== undefined, scene.mode === 'isosurface'); // a root is exact: microns
    if (scene.mode) assert.ok(header.error.depthMax < 0.01 && header.error.outline <= 0.01, JSON.stringify(header.error));
    assert.ok((await stageOf(session, 'error-meter')).included);
    await ws.close();
  }
});

test('no figures when off, and nothing is measured', async () => {
  const before = await metric('meter_pixels_total');
  const { session, ws } = await open();
  const { header } = await ws.nextFrame(({ final }) => final);
  await sleep(300);
  assert.equal(header.error, undefined);
  assert.deepEqual(ws.frames(), []);
  const stage = await stageOf(session, 'error-meter');
  assert.deepEqual([stage.included, stage.reason, stage.bytes], [false, 'errorMeter is off', 0]);
  assert.equal(await metric('meter_pixels_total'), before);
  await ws.close();
});

test('a scene without a reference is rendered, and says why it has no figures', async () => {
  const { session, ws } = await open({ errorMeter: { pixels: 64 }, mode: 'mpr' });
  const { header } = await ws.nextFrame(({ final }) => final);
  assert.deepEqual(validate(header, api.components.schemas.FrameHeader, api), []);
  assert.equal(header.error, undefined);
  assert.match(header.unmeasured, /mode/);
  const stage = await stageOf(session, 'error-meter');
  assert.deepEqual([stage.included, stage.reason], [false, header.unmeasured]);
  await ws.close();
});

test('scenes that change at once are not held up; the last one is measured', async () => {
  const { ws } = await open({ errorMeter: { pixels: 400 }, image: { width: 16, height: 16 } });
  for (let seq = 1; seq <= 15; seq++) {
    ws.patch(seq, { camera: { fovY: 20 + seq } });
    await sleep(10);
  }
  const { header } = await measured(ws, 15);
  sampled(header.error, 16 * 16); // every pixel, once
  await ws.close();
});

test('a session that ends, or a viewer that goes, while its frame is measured', async () => {
  for (let i = 0; i < 4; i++) {
    const { session, ws } = await open({ errorMeter: { pixels: 65536 } });
    await ws.nextFrame(({ final }) => final);
    if (i % 2) ws.cut();
    assert.equal((await d.delete(session.links.self)).status, 204);
  }
  assert.equal((await d.get('/healthz')).status, 200);
});
