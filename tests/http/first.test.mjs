// What a volume opens with: light, opacity that no size changes, windows by mode, no table, a thumbnail.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { Daemon, imageSize, problem } from '../support/daemon.mjs';
import { patient } from '../support/patient.mjs';
import { readPng } from '../support/png.mjs';
import { validate } from '../support/schema.mjs';

let d, api;
before(async () => {
  const sizes = { mm: 2, km: 2000, um: 0.002 };
  const files = Object.fromEntries(Object.entries(sizes).map(([name, mm]) => [`${name}.nrrd`, patient(mm)]));
  d = await Daemon.start({ files });
  for (const id of Object.keys(sizes)) {
    await d.post('/v1/volumes', { id, path: `${id}.nrrd` });
    await d.resident(id);
  }
  api = (await d.get('/v1/openapi.json')).json;
});
after(() => d.stop());

const made = async (volume, scene = {}) => (await d.post('/v1/sessions', { volume, scene })).json.scene;
async function picture(volume, scene = {}) {
  const image = { width: 64, height: 64 };
  const { status, bytes } = await d.post('/v1/render', { volume, format: 'png', scene: { ...scene, image } });
  assert.equal(status, 200, bytes.toString());
  const png = readPng(bytes);
  return Array.from({ length: 64 * 64 }, (_, i) => png.at(i % 64, Math.floor(i / 64)));
}
const differing = (a, b, by) => a.filter((pixel, i) => pixel.some((v, c) => Math.abs(v - b[i][c]) > by)).length;

test('a picture does not depend on how large the volume is said to be', async () => {
  const usual = await picture('mm');
  assert.ok(usual.filter((pixel) => pixel[0] > 60).length > 100, 'something is seen');
  for (const id of ['km', 'um']) {
    assert.equal(differing(usual, await picture(id), 2), 0, id);
    const named = { transferFunction: { preset: 'ct-vessels' } };
    assert.equal(differing(await picture('mm', named), await picture(id, named), 2), 0, `${id}, a preset by name`);
  }
});

test('a first picture is lit as its preset is; points of one’s own are not, and are per mm', async () => {
  const first = await made('mm');
  assert.equal(first.transferFunction.preset, 'ct-chest-contrast');
  const { model, ambient, diffuse, specular, shininess, gradient } = first.shading;
  assert.deepEqual([model, ambient, diffuse, specular, shininess, gradient], ['blinn-phong', 0.1, 0.9, 0.2, 10, 'central']);
  assert.equal((await made('mm', { transferFunction: { preset: 'mr-default' } })).shading.model, 'none');
  assert.equal((await made('mm', { shading: { model: 'none' } })).shading.model, 'none');
  const points = [{ value: 0, color: [0, 0, 0], opacity: 0 }, { value: 100, color: [1, 1, 1], opacity: 0.5 }];
  const own = await made('mm', { transferFunction: { points } });
  assert.deepEqual([own.shading.model, own.transferFunction.unitDistance, own.hideTable], ['none', 1, false]);
  const { json } = await d.get('/v1/presets');
  assert.deepEqual(validate(json, api.components.schemas.Presets, api), []);
  for (const { name, modality, shading } of json.transferFunctions) {
    if (modality === 'MR') assert.equal(shading.model, 'none', name);
  }
  assert.equal(json.transferFunctions.find(({ name }) => name === 'ct-bone').shading.model, 'blinn-phong');
});

test('the table is hidden where there is one, and shown for the asking', async () => {
  const { json } = await d.get('/v1/volumes/mm');
  assert.deepEqual(validate(json, api.components.schemas.Volume, api), []);
  assert.equal(json.display.table, true);
  assert.equal((await d.get('/v1/volumes/ball')).json.display.table, false);
  assert.equal((await made('mm')).hideTable, true);
  assert.equal((await made('ball')).hideTable, false);
  const camera = { position: [47, 500, 47], target: [47, 47, 47] }; // from behind
  const lit = (pixels) => pixels.filter((pixel) => pixel[0] + pixel[1] + pixel[2] > 30).length;
  const [hidden, shown] = [await picture('mm', { camera }), await picture('mm', { camera, hideTable: false })];
  assert.ok(lit(shown) > 1.5 * lit(hidden), `${lit(shown)} pixels with the table, ${lit(hidden)} without`);
  const slice = { mode: 'mpr', hideTable: true };
  assert.equal(differing(await picture('mm', slice), await picture('mm', { ...slice, hideTable: false }), 0), 0);
  const session = (await d.post('/v1/sessions', { volume: 'mm', scene: { camera, image: { width: 64, height: 64 } } })).json;
  const behind = (await d.get(`${session.links.self}/pick?x=32&y=32`)).json;
  assert.ok(behind.position[1] < 80, `a click meets the back, not the table: ${behind.position}`);
});

test('windows follow the mode that is asked for', async () => {
  const { display } = (await d.get('/v1/volumes/mm')).json;
  for (const mode of ['mip', 'minip', 'average']) assert.deepEqual((await made('mm', { mode })).window, display.windows[mode], mode);
  assert.deepEqual((await made('mm', { mode: 'mip', window: { center: 7 } })).window.center, 7);
  const seen = (await picture('mm', { mode: 'mip' })).filter(([grey]) => grey > 0);
  const white = seen.filter(([grey]) => grey === 255).length;
  assert.ok(white <= 0.3 * seen.length, `${white} of ${seen.length} white`);
  assert.ok(Math.max(...seen.map(([grey]) => grey)) - Math.min(...seen.map(([grey]) => grey)) > 60, 'not flat');
});

test('the command line opens as the service does, in every mode', async () => {
  for (const mode of [undefined, 'mip', 'minip', 'average', 'mpr', 'isosurface', 'splat']) {
    const out = join(d.folder, 'own.png'), set = mode ? ['--set', `mode=${mode}`] : [];
    const size = ['--width', '64', '--height', '64'];
    execFileSync(process.env.TC_BINARY, ['render', join(d.folder, 'mm.nrrd'), ...set, ...size, '-o', out]);
    const png = readPng(readFileSync(out));
    const own = Array.from({ length: 64 * 64 }, (_, i) => png.at(i % 64, Math.floor(i / 64)));
    assert.equal(differing(own, await picture('mm', mode ? { mode } : {}), 2), 0, mode);
  }
});

test('a thumbnail is made once, small, and for nobody to keep', async () => {
  const before = await d.metric('memory_bytes{kind="pictures"}').catch(() => null);
  const one = await d.get('/v1/volumes/mm/thumbnail'), two = await d.get('/v1/volumes/mm/thumbnail');
  assert.deepEqual([one.status, one.headers.get('content-type'), one.headers.get('cache-control')], [200, 'image/jpeg', 'no-store']);
  assert.deepEqual(imageSize(one.bytes), { format: 'jpeg', width: 128, height: 128 });
  assert.ok(one.bytes.length < 12000 && one.bytes.length > 1000, `${one.bytes.length} bytes`);
  assert.deepEqual(two.bytes, one.bytes);
  if (before !== null) assert.equal(await d.metric('memory_bytes{kind="pictures"}'), before + one.bytes.length);
  problem(await d.get('/v1/volumes/none/thumbnail'), 404);
});
