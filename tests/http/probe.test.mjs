// The verbose ray and the pick of one pixel, on a ball of radius 24.8 mm about (41, 51, 61).
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Daemon, problem } from '../support/daemon.mjs';
import { readPng } from '../support/png.mjs';

let d;
before(async () => { d = await Daemon.start(); });
after(() => d.stop());

const scene = {
  image: { width: 41, height: 41 },
  camera: { position: [41, -149, 61], target: [41, 51, 61], up: [0, 0, 1], fovY: 25 },
  transferFunction: {
    points: [{ value: 100, color: [1, 0.5, 0.25], extinction: 0 }, { value: 110, color: [1, 0.5, 0.25], extinction: 2 }],
  },
};

test('a ray lists every sample from the eye to the far side', async () => {
  const { links } = await d.session(scene);
  const { status, json } = await d.get(`${links.self}/ray?x=20&y=20`);
  assert.equal(status, 200);
  assert.ok(json.opacity > 0.999 && Math.abs(json.color[1] - 0.5 * json.opacity) < 1e-9, JSON.stringify(json.color));
  assert.ok(json.samples.length > 31); // the cells between 32 voxels
  let clear = 1;
  let depth = 169; // the box's front face
  for (const sample of json.samples) {
    assert.ok(Math.abs(sample.depth - depth) < 1e-6, `${sample.depth} after ${depth}`);
    assert.ok(Math.abs(sample.position[1] - (sample.depth - 149)) < 1e-6);
    assert.ok(sample.transparency <= clear && sample.transparency >= 0 && sample.extinction >= 0);
    assert.equal(sample.extinction > 0, sample.value > 100 + 1e-9);
    depth += sample.length;
    clear = sample.transparency;
  }
  assert.ok(Math.abs(depth - 169 - 62) < 1e-6);
});

test('a pick is where the ball begins', async () => {
  const { links } = await d.session(scene);
  const { json } = await d.get(`${links.self}/pick?x=20&y=20`);
  assert.ok(Math.hypot(json.position[0] - 41, json.position[2] - 61) < 0.01, JSON.stringify(json));
  assert.ok(Math.abs(json.position[1] - (51 - 24.8)) < 2, JSON.stringify(json)); // a voxel
  assert.ok(Math.abs(json.depth - (json.position[1] + 149)) < 1e-6 && json.value >= 100);
  assert.deepEqual((await d.get(`${links.self}/pick?x=0&y=0`)).json, { position: null, value: null, depth: null });
  assert.deepEqual((await d.get(`${links.self}/ray?x=0&y=0`)).json, { color: [0, 0, 0], opacity: 0, samples: [] });
});

test('a pick in a projection is where its value is', async () => {
  const { links } = await d.session({ ...scene, window: { center: 127, width: 255 } });
  const pick = async (mode) => {
    await d.patch(links.scene, { mode });
    return (await d.get(`${links.self}/pick?x=20&y=20`)).json;
  };
  const mip = await pick('mip'), minip = await pick('minip'), average = await pick('average');
  assert.ok(Math.abs(mip.position[1] - 51) < 2.1 && mip.value > 245, JSON.stringify(mip)); // the ball's middle
  assert.ok(Math.abs(mip.depth - (mip.position[1] + 149)) < 1e-6);
  assert.equal(minip.value, 0);
  assert.ok(Math.abs(average.depth - 169) < 1e-6);
  const { json } = await d.get(`${links.self}/ray?x=20&y=20`);
  assert.equal(json.opacity, 1);
  assert.ok(json.color[0] > 0.3 && json.color[0] < 0.9 && json.color[0] === json.color[2], JSON.stringify(json.color));
});

test('a pick in a slice or slab is what the pixel shows', async () => {
  const { links } = await d.session({ ...scene, mode: 'mpr', window: { center: 127, width: 255 } });
  for (const mpr of [
    { orientation: 'axial', thickness: 0 },
    { orientation: 'oblique', normal: [1, 2, 0.5], up: [0, 0, 1], thickness: 0 },
    { orientation: 'coronal', thickness: 20, projection: 'mip' },
    { orientation: 'sagittal', thickness: 20, projection: 'minip' },
    { orientation: 'oblique', normal: [1, 2, 0.5], up: [0, 0, 1], thickness: 15, projection: 'average' },
  ]) {
    await d.patch(links.scene, { mpr });
    const picture = readPng((await d.get(`${links.self}/frame?format=png`)).bytes);
    for (const [x, y] of [[20, 20], [15, 22], [24, 11]]) {
      const { json } = await d.get(`${links.self}/pick?x=${x}&y=${y}`);
      const grey = Math.min(Math.max(json.value / 255 + 0.5 - 127 / 255, 0), 1) * 255;
      assert.ok(Math.abs(grey - picture.at(x, y)[0]) <= 1.5, `${JSON.stringify([mpr, x, y, json])}: ${grey} for ${picture.at(x, y)[0]}`);
      const at = (await d.get(`/v1/volumes/ball/value?at=${json.position.join(',')}`)).json.value;
      if (mpr.projection !== 'average') assert.ok(Math.abs(at - json.value) < 1e-6, JSON.stringify([mpr, json, at]));
      assert.ok(json.depth >= 0 && json.depth <= mpr.thickness);
    }
  }
  await d.patch(links.scene, { clip: { planes: [[0, 0, 1, -1000]] } });
  assert.deepEqual((await d.get(`${links.self}/pick?x=20&y=20`)).json, { position: null, value: null, depth: null });
});

test('pixels outside the picture and missing ones are refused', async () => {
  const { links } = await d.session(scene);
  for (const what of ['ray', 'pick']) {
    for (const query of ['', '?x=1', '?x=41&y=0', '?x=-1&y=0', '?x=1.5&y=0', '?x=a&y=0']) {
      problem(await d.get(`${links.self}/${what}${query}`), 422);
    }
    problem(await d.get(`/v1/sessions/00000000000000000000000000000000/${what}?x=1&y=1`), 404);
  }
});

for (const mode of ['isosurface', 'mesh']) test(`a session in mode ${mode} shows the surface, lit, and picks it`, async () => {
  const { links } = await d.session({ ...scene, mode, isosurface: { value: 100, color: [0.2, 0.9, 0.4] } });
  const { json: made } = await d.get(links.scene);
  assert.equal(made.shading.model, 'blinn-phong'); // none only where it is asked for
  const { json: pick } = await d.get(`${links.self}/pick?x=20&y=20`);
  assert.ok(Math.abs(pick.position[1] - (51 - 24.8)) < 2 && pick.value === 100, JSON.stringify(pick));
  const { json: ray } = await d.get(`${links.self}/ray?x=20&y=20`);
  const hit = ray.samples.at(-1);
  assert.ok(hit.length === 0 && Math.abs(hit.depth - pick.depth) < 1e-9 && ray.opacity === 1, JSON.stringify(hit));
  assert.deepEqual(hit.color, ray.color);
  assert.deepEqual((await d.get(`${links.self}/pick?x=0&y=0`)).json, { position: null, value: null, depth: null });
  const { json: plan } = await d.get(links.plan);
  assert.match(plan.kernel, new RegExp(`^${mode}\\.linear\\.shaded\\.u8\\.`));
  const lit = await d.get(`${links.frame}?format=png`);
  assert.equal((await d.patch(links.scene, { shading: { model: 'none' } })).status, 200);
  const flat = await d.get(`${links.frame}?format=png`);
  assert.ok(lit.status === 200 && flat.status === 200 && !lit.bytes.equals(flat.bytes));
  await d.patch(links.scene, { isosurface: { value: 1000 } }); // nowhere
  const gradient = (await d.get(links.plan)).json.stages.find((stage) => stage.name === 'gradient');
  assert.match(gradient.reason, /empty picture: isosurface.value 1000/);
});
