// Addresses that hold a view, back and forward, links to sessions that are over; uploads under the user's own names.
import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import { describe, test } from 'node:test';

import { readHash, viewText } from '../../web/address.js';
import { LocalNames, nameOf } from '../../web/local_names.js';
import { lengthsText, lengthText, placeText } from '../../web/units.js';
import { browserMissing } from './chromium.mjs';
import { daemonMissing, smallNrrd } from './daemon.mjs';
import { settled, stageData } from './picture.mjs';
import { linkOf, open, scene, serve } from './scenarios.mjs';

const skip = daemonMissing() || (await browserMissing());

test('the view of a scene survives the way through an address, and only a view is read', () => {
  const camera = { projection: 'perspective', position: [1 / 3, -400, 0], target: [0, 0, 1e-9], up: [0, 0, 1], fovY: 30 };
  const text = viewText({ mode: 'mip', camera, window: { center: 40, width: 400 }, quality: { maxError: 1 } });
  const { volume, view } = readHash(`#a%20b${text}`);
  assert.equal(volume, 'a b');
  assert.deepEqual(view, {
    mode: 'mip',
    camera: { ...camera, position: [0.333333, -400, 0], target: [0, 0, 0] },
    window: { center: 40, width: 400 },
  });
  assert.equal(viewText({ mode: 'dvr', camera, transferFunction: { preset: null } }).includes('preset'), false);
  assert.deepEqual(readHash('#x&image.width=9&mode=&%=1&camera.fovY=5'), { volume: 'x', view: { camera: { fovY: 5 } } });
  assert.deepEqual(readHash('#share=0123.view.1.ab'), { volume: '', view: null }, 'a token is no volume');
  assert.deepEqual(readHash('#100%'), { volume: '', view: null });
});

test('knots without a preset, their light and labels survive too; broken lists are left out', () => {
  const points = [{ value: -400.5, color: [1, 0, 0.2], opacity: 0 }, { value: 300, color: [0, 1, 1], opacity: 0.25 }];
  const scene = {
    mode: 'dvr',
    camera: { projection: 'orthographic', height: 300 },
    transferFunction: { points, unitDistance: 0.5 },
    shading: { model: 'blinn-phong', ambient: 0.1 },
    hideTable: false,
    labels: { volume: 'parts', opacity: 0.5, visible: [3], colors: { 3: [1, 0, 0, 0.4] } },
  };
  assert.deepEqual(readHash(`#head${viewText(scene)}`), { volume: 'head', view: scene });
  const hidden = { ...scene, labels: { ...scene.labels, visible: [] } };
  assert.deepEqual(readHash(`#head${viewText(hidden)}`).view, hidden, 'hidden labels stay hidden');
  assert.ok(!viewText({ ...scene, transferFunction: { preset: 'ct-bone', points } }).includes('points'));
  assert.equal(readHash('#head&transferFunction.points=1:zz:o1,2').view, null);
});

test('every member of a view that the page can change survives, in the modes that read it', async () => {
  const list = [{ value: 300, color: [1, 0.5, 0.25], opacity: 0.5, visible: true }, { plane: 'axial', opacity: 1, visible: false }];
  const scene = {
    camera: { projection: 'perspective', fovY: 25 },
    transferFunction: { preset: 'ct-bone' },
    hideTable: true,
    shading: { model: 'gooch', gradient: 'cell', ambient: 0.2, diffuse: 0.5, specular: 0.1, shininess: 20 },
    window: { center: 40, width: 400 },
    isosurface: { value: 250, color: [0.5, 0.25, 1] },
    mesh: { surfaces: list, lights: [{ color: [1, 1, 1], intensity: 2, direction: [0, -0.5, 0.25] }], withVolume: true },
    splat: { threshold: [300, 2000], attribute: 'label', kernelRadius: 1.5, opaque: false },
    mpr: { orientation: 'coronal', thickness: 3, projection: 'mip' },
    labels: { volume: 'parts', opacity: 0.4 },
    clip: { box: [[-10, -20, -30], [10.5, 20, 30]], planes: [[0, 0, 1, -4]] },
  };
  const modes = ['dvr', 'mip', 'isosurface', 'mesh', 'splat', 'mpr'];
  const at = (view, path) => path.split('.').reduce((value, name) => value?.[name], view);
  const page = await readFile(new URL('../../web/index.html', import.meta.url), 'utf8');
  const how = /^(mode$|image\.|sampling\.|classification$|filter$)/; // how it is computed and sent, not what is seen
  const paths = new Set([...page.matchAll(/data-path="([^"]+)"/g)].map((found) => found[1]).filter((path) => !how.test(path)));
  for (const path of ['mesh.surfaces', 'mesh.lights', 'clip.box', 'clip.planes']) paths.add(path);
  for (const path of paths) {
    const kept = modes.filter((mode) => at(readHash(`#head${viewText({ ...scene, mode })}`).view, path) !== undefined);
    assert.ok(kept.length > 0, path);
    const { view } = readHash(`#head${viewText({ ...scene, mode: kept[0] })}`);
    assert.deepEqual(at(view, path), at(scene, path), path);
  }
  assert.ok(!viewText({ ...scene, mode: 'mesh', mesh: { surfaces: [], lights: [] } }).includes('mesh.'), 'nothing of empty lists');
  const many = Array.from({ length: 200 }, (_, i) => ({ ...list[0], value: i }));
  assert.ok(!viewText({ ...scene, mode: 'mesh', mesh: { surfaces: many } }).includes('mesh.'), 'a long list is left out');
  assert.deepEqual(readHash('#head&mesh.surfaces=%5B1&clip.box=%5B1,2%5D').view, null);
});

test('local names stay with the volume they came with', () => {
  let kept = null;
  const storage = { getItem: () => kept, setItem: (_, text) => (kept = text) };
  const names = new LocalNames(storage);
  names.set('upload-1', 'knee.nrrd');
  assert.equal(names.of({ id: 'upload-1', state: 'loading' }), 'knee.nrrd');
  assert.equal(names.of({ id: 'upload-1', dims: [1, 2, 3], bytes: 6 }), 'knee.nrrd');
  assert.equal(new LocalNames(storage).of({ id: 'upload-1', dims: [1, 2, 3], bytes: 6 }), 'knee.nrrd', 'after a reload');
  assert.equal(names.of({ id: 'upload-1', dims: [1, 2, 4], bytes: 8 }), '', "somebody else's by that id");
  assert.equal(names.of({ id: 'head' }), '');
  assert.equal(names.inText('open upload-1: no header; upload-11 is another'), 'open knee.nrrd: no header; upload-11 is another');
  assert.equal(nameOf([{ name: 'a.dcm' }, { name: 'b.dcm' }, { name: 'c.dcm' }]), 'a.dcm and 2 more');
});

test('lengths: millimetres, micrometres for what is small, three digits of the whole', () => {
  assert.deepEqual([lengthText(12.34, 230), lengthText(1.234, 6.5), lengthText(0.1, 0.4)], ['12 mm', '1.23 mm', '100 \u00b5m']);
  assert.equal(lengthText(0, 230), '0 mm');
  assert.equal(lengthsText([0.0128, 0.0128, 0.0128]), '12.8 \u00d7 12.8 \u00d7 12.8 \u00b5m');
  assert.equal(lengthsText([0.9, 0.9, 1.25]), '0.9 \u00d7 0.9 \u00d7 1.25 mm');
  assert.deepEqual([placeText(1.2345, 400), placeText(1.2345, 6)], ['1.2', '1.23']);
});

describe('addresses and names', { skip }, () => {
  let browser;
  let daemon;
  let page;
  serve({ head: 'demo:head', bucky: 'demo:bucky', parts: 'demo:head-labels' }, 'head', (made) => ({ browser, daemon, page } = made));

  const hash = (of = page) => of.evaluate(() => location.hash);
  const shown = (id, of = page) => of.waitForFunction((name) => document.getElementById('volume-name').textContent === name, id);
  const choose = async (id) => {
    await page.click('#volume-open');
    await page.click(`.volume-item[data-id="${id}"]`);
    await shown(id);
  };
  const near = (a, b) => a.forEach((x, k) => assert.ok(Math.abs(x - b[k]) < 1e-3, `${a} is ${b}`));

  test('the address is short until something is turned, then opens the same view elsewhere', async () => {
    await page.reload();
    await settled(page);
    assert.equal(await hash(), '#head');
    await page.selectOption('#mode', 'mip');
    await page.focus('#stage');
    await page.keyboard.press('l');
    await page.keyboard.press('ArrowUp');
    await page.waitForFunction(() => location.hash.includes('mode=mip&camera'));
    await settled(page);
    await page.waitForTimeout(400);
    const there = await open(browser, page.url());
    assert.equal(await there.page.inputValue('#mode'), 'mip');
    const [mine, theirs] = [await scene(page), await scene(there.page)];
    near(theirs.camera.position, mine.camera.position);
    near(theirs.camera.up, mine.camera.up);
    near([theirs.window.center, theirs.window.width], [mine.window.center, mine.window.width]);
    await there.page.close();
    const broken = await browser.page();
    await broken.goto(`${daemon.url}#head&mode=nonsense&camera.fovY=900`);
    await settled(broken);
    assert.match(await broken.textContent('.toast'), /view in the address/);
    await broken.close();
  });

  test('edited knots and labels are in the address', async () => {
    const { page: mine } = await open(browser, `${daemon.url}#head`);
    await mine.fill('#knot-amount', '0.123');
    await mine.keyboard.press('Enter');
    await mine.selectOption('#labels-volume', 'parts');
    await mine.locator('#labels-list li').nth(2).waitFor();
    await mine.getByRole('button', { name: 'Show label 2' }).click();
    await mine.waitForFunction(() => location.hash.includes('points') && location.hash.includes('labels.visible'));
    await settled(mine);
    await mine.waitForTimeout(400);
    const { page: theirs } = await open(browser, mine.url());
    const [a, b] = [await scene(mine), await scene(theirs)];
    assert.ok(b.transferFunction.points.some(({ opacity }) => opacity === 0.123));
    assert.deepEqual([b.shading.model, b.hideTable, b.labels.visible], [a.shading.model, a.hideTable, a.labels.visible]);
    await mine.close();
    await theirs.close();
  });

  test('back and forward move between volumes and their views', async () => {
    const turned = await hash();
    await choose('bucky');
    assert.equal(await hash(), '#bucky');
    await page.goBack();
    await shown('head');
    assert.equal(await hash(), turned);
    assert.equal(await page.inputValue('#mode'), 'mip');
    await page.goForward();
    await shown('bucky');
    await settled(page);
    assert.equal(await page.inputValue('#mode'), 'dvr');
    assert.deepEqual(page.complaints, []);
  });

  for (const role of ['edit', 'view']) {
    test(`a link to ${role}, whose session is gone, opens the same view anew`, async () => {
      await choose('head');
      await page.focus('#stage');
      await page.keyboard.press('p');
      await settled(page);
      const link = await linkOf(page, role);
      const { session } = await stageData(page);
      assert.ok(link.includes(role === 'edit' ? `session=${session}` : `#share=${session}.view`), link);
      const { camera } = await scene(page);
      await fetch(`${daemon.url}v1/sessions/${session}`, { method: 'DELETE' });
      const guest = await open(browser, link);
      assert.notEqual((await stageData(guest.page)).session, session);
      near((await scene(guest.page)).camera.position, camera.position);
      assert.match(await guest.page.textContent('.toast'), /session of this link has ended/);
      assert.equal(new URL(guest.page.url()).search, '');
      await guest.page.close();
    });
  }

  test('uploads go by their own name here and by none elsewhere; what failed can be removed', async () => {
    const sent = [];
    page.on('request', (request) => sent.push(request.url() + (request.postData() ?? '')));
    const upload = (name, buffer) => page.setInputFiles('#upload', { name, mimeType: '', buffer });
    await upload('DOE^JANE knee.nrrd', smallNrrd());
    await shown('upload-1');
    assert.equal(await page.textContent('#volume-file'), 'DOE^JANE knee.nrrd');
    await upload('DOE^JANE broken.nrrd', Buffer.from('NRRD0004\nnonsense\n\n'));
    await page.waitForSelector('.toast.bad');
    assert.match(await page.textContent('.toast.bad'), /DOE\^JANE broken\.nrrd/);
    assert.equal((await page.textContent('.toast.bad')).includes('upload-2'), false);
    await page.reload();
    await settled(page);
    assert.equal(await page.textContent('#volume-file'), 'DOE^JANE knee.nrrd', 'after a reload');
    await page.click('#volume-open');
    const failed = page.locator('.volume-item[data-id="upload-2"]');
    assert.match(await failed.textContent(), /DOE\^JANE broken\.nrrd.*header/);
    await page.click('[aria-label="Remove upload-2"]');
    await failed.waitFor({ state: 'detached' });
    await page.keyboard.press('Escape');
    assert.equal((await fetch(`${daemon.url}v1/volumes/upload-2`)).status, 404);
    for (const text of sent) assert.equal(/DOE|JANE/.test(decodeURIComponent(text)), false, text);
  });

  test('a volume of 0.0128 mm voxels is measured in micrometres', async () => {
    const micro = Buffer.from(smallNrrd().toString('latin1').replace('(2,0,0) (0,2,0) (0,0,2)', '(0.0128,0,0) (0,0.0128,0) (0,0,0.0128)').replace('(-31,-31,-31)', '(-0.1984,-0.1984,-0.1984)'), 'latin1');
    await page.setInputFiles('#upload', { name: 'micro.nrrd', mimeType: '', buffer: micro });
    await page.waitForFunction(() => /12\.8 × 12\.8 × 12\.8 µm/.test(document.getElementById('facts').textContent));
    assert.match(await page.textContent('#facts'), /397 × 397 × 397 µm/);
    await page.locator('#crop input').first().focus();
    for (let i = 0; i < 40; i++) await page.keyboard.press('ArrowRight');
    assert.match(await page.locator('#crop output').first().textContent(), /^39\.\d µm$|^40 µm$|^39 µm$/);
    await page.selectOption('#mode', 'mpr');
    await settled(page);
    assert.match(await page.textContent('#scale-label'), /^\d+ µm$/);
    assert.ok((await page.evaluate(() => Number(document.querySelector('[data-span="slab"]').max))) < 0.4, 'mm of a slab');
    assert.deepEqual(page.complaints, []);
  });
});
