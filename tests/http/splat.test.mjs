// Mode splat: the voxels of a ball of radius 24.8 mm about (41, 51, 61), as a solid and as a cloud.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Daemon, problem } from '../support/daemon.mjs';

let d;
before(async () => { d = await Daemon.start(); });
after(() => d.stop());

const scene = {
  mode: 'splat',
  image: { width: 41, height: 41, background: [0, 0, 0] },
  camera: { position: [41, -149, 61], target: [41, 51, 61], up: [0, 0, 1], fovY: 25 },
  splat: { threshold: [100, 255] },
  transferFunction: { points: [{ value: 100, color: [1, 0, 0], extinction: 0.01 }, { value: 255, color: [0, 0, 1], extinction: 0.01 }] },
};
const png = async (links) => {
  const { status, bytes } = await d.get(`${links.frame}?format=png`);
  assert.equal(status, 200, bytes.toString());
  return bytes.toString('base64');
};

test('a solid is drawn, lit, the same with and without culling, and picked by voxels', async () => {
  const { links } = await d.session(scene);
  const { json: made } = await d.get(links.scene);
  assert.equal(made.shading.model, 'blinn-phong');
  assert.deepEqual([made.splat.opaque, made.splat.culling], [true, true]);
  const culled = await png(links);
  const { json: plan } = await d.get(links.plan);
  assert.match(plan.kernel, /^splat\.shaded\.u8\./);
  const stages = Object.fromEntries(plan.stages.map((stage) => [stage.name, stage]));
  assert.ok(stages.splats.included && stages.splats.bytes > 1000, JSON.stringify(stages.splats));
  assert.match(stages.splats.reason, /voxels of 100 to 255 .* hidden is left out/);
  assert.ok(!stages['table-2d'].included && stages.gradient.included && !stages.skipping.included);
  await d.patch(links.scene, { splat: { culling: false } });
  assert.equal(await png(links), culled);
  const { json: hit } = await d.get(`${links.self}/pick?x=20&y=20`);
  assert.ok(Math.abs(hit.position[1] - (51 - 24.8)) < 2 && hit.value >= 100, JSON.stringify(hit));
  assert.ok(Math.abs(hit.depth - 200 + 24.8) < 2 && hit.voxel.length === 3);
  assert.deepEqual((await d.get(`${links.self}/pick?x=0&y=0`)).json, { position: null, value: null, depth: null });
});

test('threshold, radius, colour by value and clipping each change the picture', async () => {
  const { links } = await d.session(scene);
  const seen = new Set([await png(links)]);
  const patches = [{ splat: { threshold: [180, 255] } }, { splat: { kernelRadius: 2.5 } }, { splat: { attribute: 'value' } },
    { clip: { planes: [[0, 1, 0, -51]] } }, { filter: 'cubic' }, { splat: { opaque: false } }];
  for (const [i, patch] of patches.entries()) {
    assert.equal((await d.patch(links.scene, patch)).status, 200, JSON.stringify(patch));
    seen.add(await png(links));
    assert.equal(seen.size, i + 2, JSON.stringify(patch));
  }
  const gradient = (await d.get(links.plan)).json.stages.find((stage) => stage.name === 'gradient');
  assert.match(gradient.reason, /translucent/);
  // Nothing in the range: an empty picture, not an error.
  await d.patch(links.scene, { splat: { threshold: [254.5, 254.6], opaque: true }, clip: null });
  assert.ok(await png(links));
});

test('what splats cannot do is refused and named', async () => {
  const { links } = await d.session(scene);
  problem(await d.patch(links.scene, { splat: { attribute: 'density' } }), 422, '/splat/attribute');
  problem(await d.patch(links.scene, { splat: { kernelRadius: 17 } }), 422, '/splat/kernelRadius');
  problem(await d.patch(links.scene, { splat: { threshold: [2, 1] } }), 422, '/splat/threshold');
  problem(await d.patch(links.scene, { filter: 'nearest' }), 501, '/filter');
  assert.ok(await png(links));
});
