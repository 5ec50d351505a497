// The page in a real browser against the real daemon (TC_BINARY).
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { existsSync, mkdtempSync, readdirSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, describe, test } from 'node:test';

import { browserMissing, launch } from './chromium.mjs';
import { daemonMissing, smallNrrd, startDaemon } from './daemon.mjs';
import { ballStl } from '../support/mesh.mjs';
import { difference, settled, spread, stageData } from './picture.mjs';
import { EVERYWHERE, open, scene } from './scenarios.mjs';

const skip = daemonMissing() || (await browserMissing());
const DATA = process.env.TC_DATA;
const VOLUMES = ['--volume', 'head=demo:head', '--volume', 'bucky=demo:bucky'];

describe('page and daemon', { skip }, () => {
  let browser;
  let daemon;
  let url;
  before(async () => {
    browser = await launch();
    daemon = await startDaemon(VOLUMES);
    url = `${daemon.url}#head`;
  });
  after(async () => {
    await browser?.close();
    await daemon?.stop();
  });

  for (const [name, scenario] of Object.entries(EVERYWHERE)) test(name, () => scenario(browser, url));

  test('every mode either shows a picture or is not offered', async () => {
    const { page } = await open(browser, url);
    const { unavailable } = await (await fetch(`${daemon.url}v1/about`)).json();
    const options = await page.evaluate(() =>
      [...document.getElementById('mode').options].map(({ value, disabled, text }) => ({ value, disabled, text })),
    );
    for (const { value, disabled, text } of options) {
      assert.equal(disabled, (unavailable.mode ?? []).includes(value), value);
      if (disabled) assert.match(text, /not in this version/);
    }
    const modes = options.filter(({ disabled }) => !disabled).map(({ value }) => value);
    for (const mode of modes.filter((mode) => mode !== 'dvr')) {
      await page.selectOption('#mode', mode);
      const picture = await settled(page);
      await page.waitForTimeout(200);
      assert.ok(await page.isHidden('#mode-line'), mode);
      assert.equal(await page.inputValue('#mode'), mode);
      // The least value along every ray is the air around the head: minip is rightly black.
      if (mode !== 'minip') assert.ok(spread(picture) > 40, `${mode} shows something`);
      assert.equal(await page.locator('.toast').count(), 0, mode);
    }
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test('what the daemon does not offer cannot be chosen, all else can', async () => {
    const { page } = await open(browser, url);
    const { unavailable } = await (await fetch(`${daemon.url}v1/about`)).json();
    for (const path of ['classification', 'filter', 'shading.model', 'sampling.raysPerPixel']) {
      const options = await page.evaluate(
        (name) =>
          [...document.querySelector(`select[data-path="${name}"]`).options].map(({ value, disabled }) => [value, disabled]),
        path,
      );
      const refused = (unavailable[path] ?? []).map(String);
      for (const [value, disabled] of options) assert.equal(disabled, refused.includes(value), `${path} ${value}`);
    }
    assert.equal(await page.isDisabled('#meter'), 'errorMeter.pixels' in unavailable);
    await page.close();
  });

  test('presets of the daemon change the picture and their points reach the editor', async () => {
    const { page, picture } = await open(browser, url);
    const names = await page.evaluate(() =>
      [...document.querySelectorAll('#preset option')].map((o) => o.value).filter(Boolean),
    );
    const now = await page.inputValue('#preset');
    await page.selectOption(
      '#preset',
      names.find((name) => name !== now),
    );
    assert.ok(difference(picture, await settled(page)) > 1);
    const { session } = await stageData(page);
    const served = await (await fetch(`${daemon.url}v1/sessions/${session}/scene`)).json();
    const held = await scene(page);
    assert.equal(held.transferFunction.preset, served.transferFunction.preset);
    held.transferFunction.points.forEach((point, i) => {
      assert.ok(Math.abs(point.value - served.transferFunction.points[i].value) < 1e-3);
    });
    await page.close();
  });

  test('volume switch, also to one that is not loaded yet', async () => {
    const { page, picture } = await open(browser, url);
    for (const id of ['bucky', 'vessels']) {
      await page.click('#volume-open');
      await page.click(`.volume-item[data-id="${id}"]`);
      await page.waitForFunction((name) => location.hash === `#${name}`, id, { timeout: 60000 });
      const shown = await settled(page);
      assert.ok(difference(picture, shown) > 1 && spread(shown) > 40, id);
      assert.equal(await page.textContent('#volume-name'), id);
    }
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test('a mesh that is chosen is uploaded and shown as a surface of the volume in view', async () => {
    const { page } = await open(browser, url);
    await page.setInputFiles('#upload', { name: 'ball.stl', mimeType: '', buffer: ballStl(12, 40, [0, 0, 0]) });
    await page.waitForFunction(() => document.getElementById('mode').value === 'mesh', null, { timeout: 60000 });
    // The page's menu changes before its patch has reached the daemon.
    const listed = async () => {
      const { meshes } = await (await fetch(`${daemon.url}v1/meshes`)).json();
      return meshes.map(({ id, sessions }) => [id, sessions]);
    };
    for (let i = 0; i < 500 && !(await listed())[0]?.[1]; i++) await new Promise((wake) => setTimeout(wake, 20));
    assert.deepEqual(await listed(), [['upload-1', 1]]);
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test('upload, and a refused upload', async () => {
    const { page } = await open(browser, url);
    await page.setInputFiles('#upload', { name: 'ball.nrrd', mimeType: '', buffer: smallNrrd() });
    await page.waitForFunction(() => location.hash === '#upload-1', null, { timeout: 60000 });
    await settled(page);
    assert.match(await page.textContent('#facts'), /32 × 32 × 32/);
    await page.setInputFiles('#upload', {
      name: 'x.nrrd',
      mimeType: '',
      buffer: Buffer.from('NRRD0004\nnonsense\n\n'),
    });
    await page.waitForSelector('.toast.bad', { timeout: 60000 });
    assert.equal(await page.textContent('#volume-name'), 'upload-1');
    await page.close();
  });

  test('a click gives position and value from the daemon', async (t) => {
    const { page } = await open(browser, url);
    const { session } = await stageData(page);
    const { status } = await fetch(`${daemon.url}v1/sessions/${session}/pick?x=10&y=10`);
    if (status === 501) return t.skip('this daemon does not answer pick');
    const box = await page.locator('#stage').boundingBox();
    await page.mouse.click(box.x + box.width / 2, box.y + box.height / 2);
    await page.waitForFunction(() =>
      /[LR] \d.*[AP] \d.*[HF] \d.* mm.*\d/.test(document.getElementById('probe').textContent),
    );
    return page.close();
  });

  test('slices are drawn, and the wheel goes through them', async () => {
    const { page, picture } = await open(browser, url);
    await page.selectOption('#mode', 'mpr');
    const slice = await settled(page);
    assert.ok(await page.isHidden('#mode-line'), 'the daemon has slices');
    assert.ok(difference(picture, slice) > 1 && spread(slice) > 40);
    const grey = slice.every((v, i) => Math.abs(v - slice[i - (i % 3)]) <= 4);
    assert.ok(grey, 'a slice is grey');
    const box = await page.locator('#stage').boundingBox();
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await page.mouse.wheel(0, 1500);
    assert.ok(difference(slice, await settled(page)) > 1, 'another slice');
    await page.mouse.wheel(0, -1500);
    assert.ok(difference(slice, await settled(page)) < 1, 'and back');
    const { session } = await stageData(page);
    const { mpr } = await (await fetch(`${daemon.url}v1/sessions/${session}/scene`)).json();
    await page.mouse.click(box.x + box.width / 2, box.y + box.height / 2);
    await page.waitForFunction(() => document.getElementById('probe').textContent.includes(' mm'));
    const text = await page.textContent('#probe');
    assert.ok(text.includes(`${Math.abs(mpr.center[2]).toFixed(1)} mm`), `${text} lies in the plane ${mpr.center}`);
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test('the daemon is killed and restarted: the page comes back with its own scene', async () => {
    const { page } = await open(browser, url);
    await page.keyboard.press('l');
    await settled(page);
    await daemon.kill();
    await page.waitForSelector('#banner:not([hidden])');
    await page.keyboard.press('ArrowUp'); // an edit while nobody listens
    const held = (await scene(page)).camera;
    daemon = await startDaemon(VOLUMES, daemon.port);
    await page.waitForSelector('#stat-link[data-state="open"]', { timeout: 60000 });
    assert.ok(spread(await settled(page)) > 40);
    const { session } = await stageData(page);
    const { camera } = await (await fetch(`${daemon.url}v1/sessions/${session}/scene`)).json();
    camera.position.forEach((x, k) => assert.ok(Math.abs(x - held.position[k]) < 1e-6));
    assert.equal(await page.textContent('#mark-right'), 'P');
    assert.ok(await page.isHidden('#banner'));
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test('a closed page leaves no session behind', async () => {
    const list = async () => (await (await fetch(`${daemon.url}v1/sessions`)).json()).sessions.map(({ id }) => id);
    const { page } = await open(browser, url);
    const { session } = await stageData(page);
    assert.ok((await list()).includes(session));
    await page.goto('about:blank');
    for (let i = 0; i < 50 && (await list()).includes(session); i++)
      await new Promise((resolve) => setTimeout(resolve, 100));
    assert.equal((await list()).includes(session), false);
    await page.close();
  });
});

describe(
  'page, daemon and real data',
  { skip: skip || (DATA && existsSync(DATA) ? false : 'TC_DATA is not set') },
  () => {
    let browser;
    let daemon;
    before(async () => {
      browser = await launch();
      daemon = await startDaemon(['--volume', 'head=demo:head', '--data', DATA]);
    });
    after(async () => {
      await browser?.close();
      await daemon?.stop();
    });

    test('a file of the data folder is searched for, loaded and shown', async () => {
      const { page, picture } = await open(browser, `${daemon.url}#head`);
      await page.click('#volume-open');
      await page.fill('#volume-filter', 'abdomen_half');
      await page.waitForFunction(() => document.querySelectorAll('.volume-item').length === 1);
      await page.press('#volume-filter', 'Enter');
      await page.waitForFunction(() => location.hash.includes('abdomen_half'), null, { timeout: 60000 });
      const shown = await settled(page);
      assert.ok(difference(picture, shown) > 1 && spread(shown) > 40);
      assert.match(await page.textContent('#facts'), /256 × 256 × 137/);
      await page.close();
    });

    test('a folder of DICOM files is packed, uploaded and shown', async (t) => {
      const archive = join(DATA, 'dicom', 'ct_head_dicom93.tar.gz');
      if (!existsSync(archive)) return t.skip('no DICOM series in TC_DATA');
      const folder = mkdtempSync(join(tmpdir(), 'tomocast-dicom-'));
      t.after(() => rmSync(folder, { recursive: true }));
      execFileSync('tar', ['-xzf', archive, '-C', folder]);
      const files = readdirSync(folder, { recursive: true, withFileTypes: true })
        .filter((entry) => entry.isFile())
        .map((entry) => join(entry.path, entry.name));
      const { page } = await open(browser, `${daemon.url}#head`);
      await page.setInputFiles('#upload', files);
      await page.waitForFunction(() => location.hash === '#upload-1', null, { timeout: 60000 });
      assert.ok(spread(await settled(page)) > 40);
      assert.match(await page.textContent('#facts'), /64 × 64 × 93/);
      assert.deepEqual(page.complaints, []);
      return page.close();
    });
  },
);
