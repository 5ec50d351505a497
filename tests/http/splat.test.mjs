// Mode splat: the voxels of a ball of radius 24.8 mm about (41, 51, 61), as a solid and as a cloud; run-length models.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { ballNrrd, Daemon, problem, sleep } from '../support/daemon.mjs';
import { readPng } from '../support/png.mjs';

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
  const expected = Object.entries(plan.object.expectedMs).sort(([, a], [, b]) => a - b);
  assert.deepEqual([expected.length, expected[0][0]], [3, plan.object.cheapest]);
  assert.match(stages.splats.reason, /cheapest: about .* splatted, .* ray-cast, .* as a mesh/);
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
    { clip: { planes: [[0, 1, 0, -51]] } }, { filter: 'cubic' }, { splat: { opaque: false } },
    { shading: { model: 'none' } }];
  for (const [i, patch] of patches.entries()) {
    assert.equal((await d.patch(links.scene, patch)).status, 200, JSON.stringify(patch));
    seen.add(await png(links));
    assert.equal(seen.size, i + 2, JSON.stringify(patch));
  }
  const gradient = (await d.get(links.plan)).json.stages.find((stage) => stage.name === 'gradient');
  assert.match(gradient.reason, /shading.model is none/);
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

// --- run-length models ---------------------------------------------------------------------------------------------

const RADIUS = 12, MIDDLE = 3500, SIDE = 4096; // a ball in a grid that would take 64 GiB

const varint = (value) => (value < 128 ? [value] : [(value & 127) | 128, ...varint(value >>> 7)]);
const text = (name) => Buffer.concat([Buffer.from(name), Buffer.alloc(16 - name.length)]);
const u16 = (...values) => Buffer.from(new Uint16Array(values).buffer);
const u32 = (...values) => Buffer.from(new Uint32Array(values).buffer);
const u64 = (...values) => Buffer.from(new BigUint64Array(values.map(BigInt)).buffer);
const f64 = (...values) => Buffer.from(new Float64Array(values).buffer);

function crc32(bytes) {
  let sum = ~0;
  for (const byte of bytes) {
    sum ^= byte;
    for (let i = 0; i < 8; i++) sum = (sum >>> 1) ^ (sum & 1 ? 0xedb88320 : 0);
  }
  return ~sum;
}

/** A ball written by the page of the format (renderer/splat/VMD.md): value 200, label 1 below its middle and 2 above. */
function ballModel() {
  const lengths = [], columns = [], first = MIDDLE - RADIUS, size = 2 * RADIUS + 1;
  let filled = 0, voxels = 0;
  for (let y = first; y < first + size; y++)
    for (let x = first; x < first + size; x++) {
      const half = Math.floor(Math.sqrt(RADIUS ** 2 - (x - MIDDLE) ** 2 - (y - MIDDLE) ** 2));
      const count = half >= 0 ? 2 * half + 1 : 0; // NaN: none
      const column = count ? [...varint(MIDDLE - half), ...varint(count)] : [];
      for (let i = 0; i < count; i++) column.push(200, x < MIDDLE ? 1 : 2, 7);
      if (count) column.push(0, 0);
      lengths.push(...varint(column.length));
      columns.push(...column);
      filled += count > 0;
      voxels += count;
    }
  const body = Buffer.from([...lengths, ...columns]);
  const file = Buffer.concat([Buffer.from('TVMD'), u16(1, 0), u32(SIDE, SIDE, SIDE, first, first, size, size, filled),
    u64(voxels, body.length, body.length), f64(1, 1, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 0), text('CT'), text('HU'),
    u16(3, 3, 3, 0), text('value'), u16(0, 1), text('label'), u16(0, 1), text('user'), u16(0, 1),
    Buffer.from([0, 0, 0, 0, 255, 0, 0, 255, 0, 0, 255, 255]), body]);
  return { file: Buffer.concat([file, u32(crc32(file))]), voxels };
}

const peakBytes = () => 1024 * Number(/VmHWM:\s*(\d+)/.exec(readFileSync(`/proc/${d.process.pid}/status`, 'utf8'))[1]);
const closeUp = { image: { width: 41, height: 41, background: [0, 0, 0], format: 'png' },
  camera: { position: [MIDDLE, MIDDLE - 200, MIDDLE], target: [MIDDLE, MIDDLE, MIDDLE], up: [0, 0, 1], fovY: 10 } };

test('a run-length model is a volume like any other, and never a dense grid', async () => {
  const { file, voxels } = ballModel(), before = peakBytes();
  assert.equal((await d.call('PUT', '/v1/volumes/model', { body: file, type: 'application/octet-stream' })).status, 202);
  await d.resident('model');
  const { json: volume } = await d.get('/v1/volumes/model');
  assert.deepEqual([volume.format, volume.dims, volume.range, volume.model.voxels], ['vmd', [SIDE, SIDE, SIDE], [200, 200], voxels]);
  assert.deepEqual(volume.model.attributes, { value: 'u8', label: 'u8', user: 'u8' });
  assert.deepEqual(volume.model.ranges, { value: [200, 200], label: [1, 2], user: [7, 7] });
  assert.ok(volume.bytes < 8 * voxels);
  const { json: session, status } = await d.post('/v1/sessions', { volume: 'model', scene: closeUp });
  assert.equal(status, 201, JSON.stringify(session));
  assert.deepEqual([session.scene.mode, session.scene.splat.attribute, session.scene.splat.threshold], ['splat', 'label', [200, 200]]);
  const picture = readPng(Buffer.from(await png(session.links), 'base64'));
  const [left, right] = [picture.at(10, 20), picture.at(30, 20)];
  assert.ok(left[0] > 50 && left[2] < 20 && right[2] > 50 && right[0] < 20, `the palette's colours: ${left} ${right}`);
  const { json: hit } = await d.get(`${session.links.self}/pick?x=20&y=20`);
  assert.deepEqual([hit.voxel, hit.attributes], [[MIDDLE, MIDDLE - RADIUS, MIDDLE], { value: 200, label: 2, user: 7 }]);
  const peak = peakBytes() - before;
  console.log(`peak of a model of ${volume.bytes} bytes: ${peak >> 20} MiB more, its grid would take ${SIDE ** 3 / 2 ** 20}`);
  assert.ok(peak < 64 << 20);
  // The rest of the API: values are those of voxels, what needs a grid is refused, and the session stays.
  assert.equal((await d.get(`/v1/volumes/model/value?at=${MIDDLE},${MIDDLE},${MIDDLE + 0.4}`)).json.value, 200);
  assert.equal((await d.get('/v1/volumes/model/value?at=0,0,0')).json.value, null);
  const { json: histogram } = await d.get('/v1/volumes/model/histogram?bins=4');
  assert.equal(histogram.counts.reduce((a, b) => a + b), voxels);
  for (const mode of ['dvr', 'mip', 'isosurface', 'mesh', 'mpr'])
    problem(await d.patch(session.links.scene, { mode }), 422, '/mode');
  problem(await d.patch(session.links.scene, { splat: { attribute: 'density' } }), 422, '/splat/attribute');
  for (const patch of [{ splat: { attribute: 'user' } }, { splat: { opaque: false } }, { clip: { planes: [[0, 1, 0, -MIDDLE]] } }]) {
    assert.equal((await d.patch(session.links.scene, patch)).status, 200, JSON.stringify(patch));
    assert.ok(await png(session.links));
  }
  problem(await d.post('/v1/sessions', { volume: 'ball', scene: { labels: { volume: 'model' } } }), 422, '/scene/labels/volume');
});

test('a converted model has value, label, normal and user: listed, coloured by and picked', async () => {
  const n = 32, header = ballNrrd(n).subarray(0, -(n ** 3)), files = [ballNrrd(n), header, header].map((bytes, i) => {
    const path = join(d.folder, `attribute${i}.nrrd`); // values; labels 1 and 2 left and right; user: from low to high
    const own = Buffer.from(Array.from({ length: n ** 3 }, (_, at) => (i === 1 ? (at % n < n / 2 ? 1 : 2) : 4 * Math.floor(at / n ** 2))));
    writeFileSync(path, i ? Buffer.concat([bytes, own]) : bytes);
    return path;
  });
  const path = join(d.folder, 'four.vmd'), all = ['--attributes', 'value,label,normal,user'];
  execFileSync(process.env.TC_BINARY, ['convert', files[0], path, '--threshold', '100,255', '--labels', files[1], '--user', files[2], ...all]);
  await d.call('PUT', '/v1/volumes/four', { body: readFileSync(path), type: 'application/octet-stream' });
  await d.resident('four');
  const { json: volume } = await d.get('/v1/volumes/four');
  assert.deepEqual(volume.model.attributes, { value: 'u8', label: 'u8', normal: 'normal', user: 'u8' });
  assert.deepEqual(Object.keys(volume.model.ranges), ['value', 'label', 'user']);
  assert.deepEqual(volume.model.ranges.label, [1, 2]);
  const { links } = (await d.post('/v1/sessions', { volume: 'four', scene: { ...scene, shading: { model: 'none' } } })).json;
  const { json: hit } = await d.get(`${links.self}/pick?x=26&y=20`);
  const { value, label, normal, user } = hit.attributes, voxels = readFileSync(files[0]).subarray(-(n ** 3));
  const [x, y, z] = hit.voxel;
  assert.deepEqual([value, label, user], [voxels[(z * n + y) * n + x], 2, 4 * z]);
  // The ball ends in a step from 153 to 0.
  const out = [x, y, z].map((at) => at - (n - 1) / 2), length = Math.hypot(...out);
  assert.ok(normal.every((number, k) => Math.abs(number - out[k] / length) < 0.3), `${normal} of ${out}`);
  const seen = async (attribute) => {
    assert.equal((await d.patch(links.scene, { splat: { attribute } })).status, 200);
    const picture = readPng(Buffer.from(await png(links), 'base64'));
    return (x, y) => picture.at(x, y).slice(0, 3);
  };
  // Normals: components as red, green, blue; towards the eye, at -y.
  const normals = await seen('normal');
  assert.ok(normals(20, 20)[1] < 20 && Math.abs(normals(20, 20)[0] - 128) < 20, `${normals(20, 20)}`);
  assert.ok(normals(30, 20)[0] > 170 && normals(10, 20)[0] < 90 && normals(20, 10)[2] > 170, `${normals(30, 20)} ${normals(20, 10)}`);
  // User: from the colour of the least value, 153, at the bottom, to that of the greatest.
  const users = await seen('user');
  assert.ok(users(20, 9)[0] < 40 && users(20, 31)[0] > 140, `${users(20, 9)} ${users(20, 31)}`);
  const labels = await seen('label');
  assert.notDeepEqual(labels(12, 20), labels(28, 20));
});

test('a damaged model fails with its reason, packed or not', async () => {
  const { file } = ballModel();
  file[file.length - 100] ^= 1;
  for (const [id, bytes] of [['flipped', file], ['cut', file.subarray(0, 300)]]) {
    await d.call('PUT', `/v1/volumes/${id}`, { body: bytes, type: 'application/octet-stream' });
    for (let state = 'loading'; state !== 'failed'; await sleep(20)) ({ state } = (await d.get(`/v1/volumes/${id}`)).json);
    assert.match((await d.get(`/v1/volumes/${id}`)).json.reason, /the file is damaged/);
  }
});

test('segments are splats in their own colours, and those that are hidden are not there', async () => {
  const labels = Buffer.from(ballNrrd(32));
  const at = labels.length - 32 ** 3;
  for (let i = 0; i < 32 ** 3; i++) labels[at + i] = labels[at + i] && (i % 32 < 16 ? 1 : 2);
  await d.call('PUT', '/v1/volumes/parts', { body: labels, type: 'application/octet-stream' });
  await d.resident('parts');
  const colors = { 1: [1, 0, 0, 1], 2: [0, 0, 1, 1] };
  const { links } = await d.session({ ...scene, labels: { volume: 'parts', opacity: 1, colors } });
  const colorsAt = async () => { const picture = readPng(Buffer.from(await png(links), 'base64')); return [picture.at(12, 20), picture.at(29, 20)]; };
  const [left, right] = await colorsAt();
  assert.ok(left[0] > 50 && left[2] < 20 && right[2] > 50 && right[0] < 20, `${left} ${right}`);
  assert.equal((await d.get(`${links.self}/pick?x=12&y=20`)).json.label, 1);
  assert.match((await d.get(links.plan)).json.stages.find(({ name }) => name === 'splats').reason, /voxels of the visible labels/);
  await d.patch(links.scene, { labels: { visible: [2] } });
  const [gone, there] = await colorsAt();
  assert.ok(Math.max(...gone.slice(0, 3)) === 0 && there[2] > 50, `${gone} ${there}`);
});
