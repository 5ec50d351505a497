// Slices on the page of the real daemon (TC_BINARY): number, place and slab on the picture, slider, planes turned by hand.
import assert from 'node:assert/strict';
import { before, describe, test } from 'node:test';

import { edgeLetters, sliceBasis } from '../../web/camera.js';
import { browserMissing } from './chromium.mjs';
import { daemonMissing } from './daemon.mjs';
import { difference, drag, settled, stageBox } from './picture.mjs';
import { scene, serve } from './scenarios.mjs';

const skip = daemonMissing() || (await browserMissing());
const SLICES = 256; // of demo:head

describe('slices', { skip }, () => {
  let page;
  serve({ head: 'demo:head', vessels: 'demo:vessels' }, 'head', (made) => ({ page } = made));
  before(async () => {
    await page.selectOption('#mode', 'mpr');
    await settled(page);
  });

  const label = () => page.textContent('#label');
  const place = async () => {
    const [, number, count, side, mm] = /Slice (\d+) \/ (\d+) \u00b7 ([A-Z]+) ([\d.]+) mm/.exec(await label());
    return { number: Number(number), count: Number(count), side, mm: Number(mm) };
  };
  /** Waits until the picture says so. */
  const says = (words) =>
    page.waitForFunction((text) => document.getElementById('label').textContent.includes(text), words, { timeout: 60000 });
  let picture;
  const turned = async (turn) => {
    await turn();
    const before = picture;
    picture = await settled(page);
    assert.ok(difference(before, picture) > 1, 'another picture');
    const { mpr } = await scene(page);
    assert.equal(mpr.orientation, 'oblique');
    const letters = edgeLetters(sliceBasis(mpr));
    for (const [edge, text] of Object.entries(letters)) assert.equal(await page.textContent(`#mark-${edge}`), text);
    assert.match(await label(), /Oblique/);
    return mpr.normal;
  };

  test('number and place are shown, and a slider goes to any slice', async () => {
    const first = await place();
    assert.equal(first.count, SLICES);
    assert.match(await label(), /Axial/);
    const slider = await page.locator('#slice').boundingBox();
    const x = slider.x + slider.width / 2;
    const at = (share) => [x, slider.y + slider.height * share];
    await drag(page, at(0.5), at(0.25));
    await settled(page);
    const then = await place();
    assert.ok(Math.abs(then.number - SLICES * 0.25) < SLICES * 0.06, `${then.number} of ${SLICES}`);
    const { mpr } = await scene(page);
    assert.ok(Math.abs(Math.abs(mpr.center[2]) - then.mm) < 0.06, `${mpr.center} is ${then.side} ${then.mm}`);
    assert.equal(then.side, mpr.center[2] < 0 ? 'F' : 'H');
    await page.focus('#stage');
    await page.keyboard.press('ArrowDown');
    await says(`Slice ${then.number + 1} /`);
    assert.equal(await page.inputValue('#slice'), String(then.number + 1));
  });

  test('a slab names itself', async () => {
    assert.doesNotMatch(await label(), /Slab/);
    await page.locator('[data-path="mpr.thickness"]').first().fill('12');
    for (const [kind, title] of Object.entries({ mip: 'maximum', average: 'average' })) {
      await page.selectOption('[data-path="mpr.projection"]', kind);
      await says(`Slab 12 mm \u00b7 ${title}`);
    }
    await page.locator('[data-path="mpr.thickness"]').first().fill('0');
  });

  test('the plane is turned by the cube, by Alt and a drag, and by keys; a view and undo bring it back', async () => {
    const { cx, cy } = await stageBox(page);
    const cube = await page.locator('#cube').boundingBox();
    const [x, y] = [cube.x + cube.width / 2, cube.y + cube.height / 2];
    picture = await settled(page);
    const first = await turned(() => drag(page, [x, y], [x + 40, y + 25]));
    const second = await turned(async () => {
      await page.keyboard.down('Alt');
      await drag(page, [cx, cy], [cx - 70, cy + 40]);
      await page.keyboard.up('Alt');
    });
    const third = await turned(async () => {
      for (let i = 0; i < 4; i++) await page.keyboard.press('Shift+ArrowUp');
    });
    const angle = (a, b) => Math.acos(Math.min(1, a.reduce((sum, v, k) => sum + v * b[k], 0))) * (180 / Math.PI);
    assert.ok(angle(first, second) > 10 && Math.abs(angle(second, third) - 20) < 0.1, 'by so many degrees');
    await page.keyboard.press('Control+z');
    assert.ok(angle((await scene(page)).mpr.normal, second) < 1e-3);
    await page.keyboard.press('l');
    await says('Sagittal');
    await page.locator('#cube .face:not([hidden])').last().click();
    assert.equal((await scene(page)).mpr.orientation, 'sagittal', 'a click on a face is its view');
  });

  test('another volume is no label volume, unless one insists', async () => {
    await page.selectOption('#labels-volume', 'vessels');
    await page.waitForSelector('#labels-doubt:not([hidden])');
    assert.match(await page.textContent('#labels-why'), /not on the volume's grid|values/);
    assert.equal(await page.inputValue('#labels-volume'), '');
    await page.click('#labels-insist');
    await page.waitForSelector('#labels-list button');
    assert.equal((await scene(page)).labels.volume, 'vessels');
    assert.ok(await page.isHidden('#labels-doubt'));
  });
});
