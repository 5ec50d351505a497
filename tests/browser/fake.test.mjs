// The panels of the page in a real browser against the fake server. The scenarios of EVERYWHERE run here only if there is no
// daemon; daemon.test.mjs runs them against the real one.
import assert from 'node:assert/strict';
import { describe, test } from 'node:test';

import { browserMissing } from './chromium.mjs';
import { daemonMissing } from './daemon.mjs';
import { drag, settled, stageBox, stageData } from './picture.mjs';
import { EVERYWHERE, open, scene, serveFake } from './scenarios.mjs';

const skip = await browserMissing();

describe('page and fake server', { skip }, () => {
  let browser;
  let server;
  let url;
  serveFake((made) => ({ browser, server, url } = made));

  if (daemonMissing()) for (const [name, scenario] of Object.entries(EVERYWHERE)) test(name, () => scenario(browser, url));

  test('labels are chosen, shown, hidden and coloured from their panel, by keyboard too', async () => {
    const { page } = await open(browser, url);
    const labels = () => scene(page).then((now) => now.labels ?? {});
    const tab = page.locator('[role="tab"][data-tab="labels"]');
    if (await tab.isVisible()) await tab.click();
    await page.selectOption('#labels-volume', 'parts');
    await page.locator('#labels-list li').nth(2).waitFor();
    assert.deepEqual(await page.locator('#labels-list li > span:nth-child(2)').allTextContents(), [
      'No label',
      'Label 1',
      'Label 3',
    ]);
    assert.equal((await labels()).volume, 'parts');
    const eye = page.getByRole('button', { name: 'Show label 3' });
    await eye.focus();
    await page.keyboard.press('Enter');
    assert.equal(await eye.getAttribute('aria-pressed'), 'false');
    assert.deepEqual((await labels()).visible, [0, 1]);
    await eye.click();
    assert.equal((await labels()).visible ?? null, null, 'all shown is no list');
    await page.getByLabel('Colour of label 1').fill('#ff0000');
    assert.deepEqual((await labels()).colors, { 1: [1, 0, 0, 1] });
    await page.click('#labels-none');
    assert.deepEqual((await labels()).visible, []);
    await page.selectOption('#labels-volume', '');
    assert.equal(await page.locator('#labels-body').isVisible(), false);
    assert.equal((await labels()).volume ?? '', '');
    await settled(page);
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test("the status line shows the picture's error beside its time, or why there is none", async () => {
    const { page } = await open(browser, url);
    assert.ok(await page.isHidden('#stat-error'));
    await page.evaluate(() => document.getElementById('meter').click());
    await page.waitForSelector('#stat-error:not([hidden])');
    assert.equal(await page.textContent('#stat-error'), 'error 0.41/255 \u00b1 0.10, max 2.8 (64 px)');
    assert.deepEqual((await scene(page)).errorMeter, { pixels: 64 });
    await page.selectOption('#mode', 'mip');
    await page.waitForFunction(() => /not measured: no ref/.test(document.getElementById('stat-error').textContent));
    await page.evaluate(() => document.getElementById('meter').click());
    await page.waitForSelector('#stat-error', { state: 'hidden' });
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test('what the meter says of a surface stands below it', async () => {
    const { page } = await open(browser, url);
    await page.selectOption('#mode', 'mesh');
    await page.click('#surfaces-add');
    await page.waitForSelector('#surfaces-list li:nth-child(2)');
    assert.ok(await page.isHidden('#surfaces-list li:nth-child(2) small'));
    await page.evaluate(() => document.getElementById('meter').click());
    await page.waitForFunction(() => document.querySelector('#surfaces-list li:nth-child(2) small').textContent);
    const said = await page.$$eval('#surfaces-list small', (all) => all.map(({ textContent }) => textContent));
    assert.deepEqual(said, ['no measured pixel shows it', 'depth 0.030 mm rms, 99 % within 0.12 mm, outline wrong in 1.0 % of pixels']);
    assert.match(await page.textContent('#stat-error'), /; depth 0.030 mm, 99 % 0.12, outline 1.0 %$/);
    await page.evaluate(() => document.getElementById('meter').click());
    await page.waitForSelector('#surfaces-list li:nth-child(2) small', { state: 'hidden' });
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test('quality: a step, a bound on the error or a budget of time, and why', async () => {
    const { page } = await open(browser, url);
    const asked = async () => (await scene(page)).quality ?? {};
    const seen = (id) => page.evaluate((name) => !document.getElementById(name).hidden, id);
    const choose = async (kind) => {
      await page.evaluate((value) => {
        const menu = document.getElementById('quality');
        menu.value = value;
        menu.dispatchEvent(new Event('change'));
      }, kind);
      await settled(page);
    };
    assert.ok((await seen('quality-step-field')) && !(await seen('quality-why')));
    await choose('error');
    assert.deepEqual(await asked(), { maxError: 1 / 255 });
    assert.ok((await seen('quality-error-field')) && !(await seen('quality-step-field')));
    assert.equal(await page.textContent('#quality-error-shown'), '1/255');
    await page.waitForFunction(() => /for the test/.test(document.getElementById('quality-why').textContent));
    await page.evaluate(() => {
      const slider = document.getElementById('quality-error');
      slider.value = -1;
      slider.dispatchEvent(new Event('input'));
    });
    await settled(page);
    assert.deepEqual(await asked(), { maxError: 0.5 / 255 });
    await choose('time');
    assert.deepEqual(await asked(), { maxMilliseconds: 32 });
    assert.ok((await seen('quality-time-field')) && !(await seen('quality-error-field')));
    await choose('step');
    assert.deepEqual(await asked(), {});
    assert.ok((await seen('quality-step-field')) && !(await seen('quality-why')));
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test('a surface that another mode draws much faster says so, and goes there', async () => {
    const { page } = await open(browser, url);
    const hidden = () => page.evaluate(() => document.getElementById('suggestion').hidden);
    assert.ok(await hidden());
    await page.selectOption('#mode', 'isosurface');
    await page.waitForFunction(() => !document.getElementById('suggestion').hidden);
    assert.match(
      await page.textContent('#suggestion-text'),
      /as a surface mesh, a frame would take about 5 ms instead of 30 ms/,
    );
    await page.click('#suggestion-take');
    await page.waitForFunction(() => document.getElementById('suggestion').hidden);
    await settled(page);
    assert.equal((await scene(page)).mode, 'mesh');
    assert.ok(await hidden());
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test('a suggestion that was dismissed does not come again', async () => {
    const { page } = await open(browser, url);
    await page.selectOption('#mode', 'isosurface');
    await page.waitForFunction(() => !document.getElementById('suggestion').hidden);
    await page.click('#suggestion-close');
    assert.ok(await page.isHidden('#suggestion'));
    const asked = page.waitForResponse(/\/plan$/);
    await page.fill('input[type="number"][data-path="isosurface.value"]', '90');
    await page.press('input[type="number"][data-path="isosurface.value"]', 'Enter');
    await asked;
    await page.waitForTimeout(300);
    assert.ok(await page.isHidden('#suggestion'));
    await page.close();
  });

  test('what is suggested for one surface is taken back where labels have surfaces of their own', async () => {
    const { page } = await open(browser, url);
    await page.selectOption('#mode', 'isosurface');
    await page.waitForFunction(() => !document.getElementById('suggestion').hidden);
    await page.waitForTimeout(1100); // until then the page's own edit counts
    server.editFromOutside((await stageData(page)).session, { labels: { volume: 'organs' } });
    await page.waitForFunction(() => document.getElementById('suggestion').hidden, null, { timeout: 5000 });
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test('what the picture waits for is shown, and given up with the edit that asked for it', async () => {
    const { page } = await open(browser, url);
    await page.selectOption('#mode', 'mesh');
    await settled(page); // a picture that comes later hides what is waited for
    server.mute = true;
    await page.selectOption('#mode', 'mip');
    server.tell({ type: 'building', stage: 'mesh', share: 0.4 });
    await page.waitForSelector('#building', { state: 'visible' });
    assert.match(await page.textContent('#building-text'), /^Extracting surfaces/);
    assert.equal(await page.evaluate(() => document.getElementById('building-bar').value), 0.4);
    await page.click('#building-cancel');
    assert.ok(await page.isHidden('#building'));
    const back = () => server.patches.at(-1).scene.mode !== 'mip';
    for (let i = 0; i < 200 && !back(); i++) await new Promise((resolve) => setTimeout(resolve, 20));
    assert.ok(back(), 'the scene before');
    assert.equal(server.cancels.length, 1);
    assert.ok(server.cancels[0] < server.patches.length, 'given up before the scene goes back');
    server.tell({ type: 'building', stage: 'table-2d', share: 0 });
    await page.waitForSelector('#building', { state: 'visible' });
    server.mute = false;
    await page.selectOption('#mode', 'mip');
    await page.waitForSelector('#building', { state: 'hidden' });
    await page.close();
  });

  test('a number in focus follows the scene, and what is being typed is not overwritten', async () => {
    const { page } = await open(browser, url);
    await page.selectOption('#mode', 'isosurface');
    const number = 'input[type="number"][data-path="isosurface.value"]';
    const slide = (value) =>
      page.$eval('input[type="range"][data-path="isosurface.value"]', (slider, to) => {
        slider.value = to;
        slider.dispatchEvent(new Event('input', { bubbles: true }));
        return Number(Number(slider.value).toPrecision(7));
      }, value);
    await page.focus(number);
    const first = await slide(120);
    assert.equal(Number(await page.inputValue(number)), first);
    await page.fill(number, '77');
    await slide(200);
    assert.equal(await page.inputValue(number), '77');
    await page.keyboard.press('Enter');
    assert.equal((await scene(page)).isosurface.value, 77);
    const last = await slide(150);
    assert.equal(Number(await page.inputValue(number)), last, 'still in focus');
    await page.close();
  });

  test('surfaces are added to a list, changed and removed one by one', async () => {
    const { page } = await open(browser, url);
    const list = async () => (await scene(page)).mesh?.surfaces ?? [];
    await page.click('#surfaces-add');
    await page.waitForSelector('#surfaces-list li:nth-child(2)');
    await page.click('#surfaces-slice');
    await page.waitForSelector('#surfaces-list li:nth-child(3)');
    assert.ok((await scene(page)).mesh.withVolume, 'beside a volume: in it');
    assert.equal((await list())[2].plane, 'axial');
    await page.evaluate(() => {
      const slider = document.querySelector('#surfaces-list li:nth-child(2) input[aria-label="Opacity of surface 2"]');
      slider.value = 0.5;
      slider.dispatchEvent(new Event('input'));
    });
    assert.equal((await list())[1].opacity, 0.5);
    await page.selectOption('[aria-label="Look of surface 2"]', 'gooch');
    assert.equal((await list())[1].model, 'gooch');
    await page.selectOption('[aria-label="Look of surface 2"]', '');
    assert.ok(!('model' in (await list())[1]), "the scene's again");
    await page.click('#surfaces-list li:first-child button[aria-label="Remove surface 1"]');
    await page.waitForSelector('#surfaces-list li:nth-child(3)', { state: 'detached' });
    assert.deepEqual(
      (await list()).map(({ plane, opacity }) => plane ?? opacity),
      [0.5, 'axial'],
    );
    const organs = { ...(await scene(page)), mesh: { surfaces: [{ mesh: 'organs', opacity: 1, visible: true }] } };
    await page.click('#scene-open');
    await page.fill('#scene-text', JSON.stringify(organs));
    await page.click('#scene-load');
    const own = '[aria-label="Own colour of surface 1"]';
    await page.waitForSelector(`${own}:disabled`, { state: 'attached' });
    await page.fill('[aria-label="Colour of surface 1"]', '#ff0000');
    assert.deepEqual((await list())[0].color, [1, 0, 0]);
    await page.click(own);
    assert.ok(!('color' in (await list())[0]), "the mesh's own again");
    await page.waitForSelector('#surfaces-list .unset');
    await page.close();
  });

  test('lights are added, coloured, turned, fixed to the eye and removed', async () => {
    const { page } = await open(browser, url);
    const lights = async () => (await scene(page)).mesh?.lights ?? [];
    const set = (label, value) =>
      page.evaluate(
        ([name, to]) => {
          const control = document.querySelector(`#lights-list [aria-label="${name}"]`);
          control.value = to;
          control.dispatchEvent(new Event('input'));
        },
        [label, value],
      );
    await page.click('#lights-add');
    await page.waitForSelector('#lights-list li');
    await page.click('#lights-add');
    await page.waitForSelector('#lights-list li:nth-child(2)');
    assert.deepEqual(
      (await lights()).map(({ direction }) => Boolean(direction)),
      [false, true],
      'the first is at the eye',
    );
    await set('Colour of light 2', '#ff0000');
    await set('Intensity of light 2', '2');
    await set('Side of light 2', '90');
    await set('Height of light 2', '0');
    const [, { color, intensity, direction }] = await lights();
    assert.deepEqual([color, intensity], [[1, 0, 0], 2]);
    direction.forEach((x, k) => assert.ok(Math.abs(x - [1, 0, 0][k]) < 1e-9, `to the left: ${direction}`));
    await page.click('#lights-list [aria-label="Fixed: light 2"]');
    await page.waitForSelector('#lights-list [aria-label="At the eye: light 2"]');
    assert.equal((await lights())[1].direction, undefined);
    await page.click('#lights-list [aria-label="Remove light 1"]');
    await page.waitForSelector('#lights-list li:nth-child(2)', { state: 'detached' });
    assert.deepEqual(
      (await lights()).map(({ intensity }) => intensity),
      [2],
    );
    await page.close();
  });

  test('a face of the cube turns to its view', async () => {
    const { page } = await open(browser, url);
    for (let i = 0; i < 7; i++) await page.keyboard.press('ArrowLeft');
    await settled(page);
    await page.locator('#cube .face', { hasText: /^LLeft/ }).click();
    await page.waitForFunction(() => document.getElementById('mark-right').textContent === 'P');
    await page.close();
  });

  test('a click tells position and value', async () => {
    const { page } = await open(browser, url);
    const { cx, cy } = await stageBox(page);
    await page.mouse.click(cx, cy);
    await page.waitForFunction(() => document.getElementById('probe').textContent.includes('321 HU'));
    assert.match(await page.textContent('#probe'), /L 1\.3\s+A 20\.0\s+H 3\.0 mm.*321 HU.*Label 3$/);
    await page.close();
  });

  test('slices: wheel, drags, keys, plane buttons and clicks', async () => {
    const { page } = await open(browser, url);
    await page.selectOption('#mode', 'mpr');
    await settled(page);
    const letters = async () => [await page.textContent('#mark-left'), await page.textContent('#mark-top')];
    assert.deepEqual(await letters(), ['R', 'A'], "axial: the patient's right on the left, the front on top");
    const { cx, cy } = await stageBox(page);
    await page.mouse.move(cx, cy);
    await page.mouse.wheel(0, 150);
    await settled(page);
    const [x, y, z] = (await scene(page)).mpr.center;
    assert.ok(Math.abs(z - (0.25 + 1.5)) < 1e-6, `one layer of voxels towards the head, not ${z}`);
    const { camera } = await scene(page);
    await drag(page, [cx, cy], [cx + 60, cy + 30]);
    await settled(page);
    const after = await scene(page);
    assert.ok(after.window.width > 400 && after.window.center > 40, 'a drag sets the window');
    assert.deepEqual(after.camera, camera, 'and turns nothing');
    await drag(page, [cx, cy], [cx + 60, cy], { button: 'middle' });
    await settled(page);
    const { center } = (await scene(page)).mpr;
    assert.ok(
      center[0] < x - 1 && Math.abs(center[1] - y) < 1e-6 && center[2] === z,
      'the middle drag pans in the plane',
    );
    await drag(page, [cx, cy], [cx, cy - 80], { button: 'right' });
    await settled(page);
    assert.ok((await scene(page)).mpr.zoom > 1.2, 'the right drag zooms');
    await page.mouse.click(cx, cy);
    await page.waitForFunction(() => document.getElementById('probe').textContent.includes('17 HU'));
    await page.click('button[data-view="A"]');
    await settled(page);
    assert.deepEqual(await letters(), ['R', 'H'], 'coronal');
    await page.click('button[data-view="L"]');
    await settled(page);
    assert.deepEqual(await letters(), ['A', 'H'], 'sagittal');
    assert.equal((await scene(page)).mpr.orientation, 'sagittal');
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test('every control has a name, and nothing sticks out of any window', async () => {
    const { page } = await open(browser, url);
    const nameless = await page.evaluate(() =>
      [...document.querySelectorAll('button, input, select, textarea, [role="slider"]')]
        .filter(
          (e) => !(e.getAttribute('aria-label') || e.labels?.length || e.textContent.trim() || e.ariaHidden === 'true'),
        )
        .map((e) => e.outerHTML),
    );
    assert.deepEqual(nameless, []);
    for (const [width, height] of [
      [1920, 1080],
      [1366, 768],
      [1180, 820],
      [1024, 768],
      [820, 1180],
      [768, 1024],
      [390, 844],
    ]) {
      await page.setViewportSize({ width, height });
      await page.waitForTimeout(50);
      const out = await page.evaluate(() =>
        [...document.querySelectorAll('.bar *, #panel *:not(option, svg *), #stage, #stage .corner')]
          .filter((e) => e.getClientRects().length && !e.classList.contains('unseen'))
          .filter((e) => e.getBoundingClientRect().right > innerWidth + 1 || e.getBoundingClientRect().left < -1)
          .map((e) => e.id || e.className || e.tagName),
      );
      assert.deepEqual(out, [], `${width}x${height}`);
      const stage = await stageBox(page);
      assert.ok(stage.width * stage.height > 0.33 * width * height, `the picture has its share of ${width}x${height}`);
    }
    await page.close();
  });

  test('crop sliders cut the box, never to nothing', async () => {
    const { page } = await open(browser, url);
    const set = (index, value) =>
      page.evaluate(
        ([i, v]) => {
          const slider = document.querySelectorAll('#crop input')[i];
          slider.value = v;
          slider.dispatchEvent(new Event('input'));
        },
        [index, value],
      );
    await set(0, 0.9);
    await set(1, 0.1);
    await settled(page);
    const { clip } = await scene(page);
    assert.ok(clip.box[0].every((low, k) => low < clip.box[1][k]));
    await page.click('#crop-reset');
    assert.equal((await scene(page)).clip.box, undefined);
    await page.close();
  });
});
