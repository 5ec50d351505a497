// The transfer-function editor by pointer, keys and fingers, on the page of the real daemon (TC_BINARY).
import assert from 'node:assert/strict';
import { describe, test } from 'node:test';

import { browserMissing } from './chromium.mjs';
import { daemonMissing } from './daemon.mjs';
import { scene, serve } from './scenarios.mjs';

const skip = daemonMissing() || (await browserMissing());

describe('transfer-function editor', { skip }, () => {
  let daemon;
  let page;
  serve({ head: 'demo:head' }, 'head', (made) => ({ daemon, page } = made), { hasTouch: true });

  const points = async () => (await scene(page)).transferFunction.points;
  const axis = () => page.evaluate(() => ['axis-low', 'axis-high'].map((id) => Number(document.getElementById(id).value)));
  const plot = () => page.locator('.transfer .plot').boundingBox();

  test('density up, then down again, is the same function', async () => {
    const before = await points();
    const slider = await page.locator('#density').boundingBox();
    const [cx, cy] = [slider.x + slider.width / 2, slider.y + slider.height / 2];
    const pull = async (dx) => {
      await page.mouse.move(cx, cy);
      await page.mouse.down();
      await page.mouse.move(cx + dx, cy, { steps: 4 });
      await page.mouse.up();
      return points();
    };
    const dense = await pull(40);
    assert.ok(dense.some(({ opacity }, i) => opacity > before[i].opacity + 0.05));
    const again = await pull(-40);
    again.forEach(({ opacity }, i) => assert.ok(Math.abs(opacity - before[i].opacity) < 1e-6, `knot ${i}: ${opacity}`));
  });

  test('a typed opacity leaves the value alone, a typed value the opacity', async () => {
    await page.click('#axis-knots');
    await page.fill('#knot-value', '-411.123456');
    await page.fill('#knot-amount', '0.123456');
    await page.keyboard.press('Enter');
    const index = (await points()).findIndex(({ value }) => value === -411.123456);
    assert.ok(index >= 0, 'taken as typed');
    assert.notEqual(await page.inputValue('#knot-value'), '-411.123456', 'shown shorter');
    await page.fill('#knot-amount', '0.234567');
    await page.keyboard.press('Enter');
    assert.equal((await points())[index].value, -411.123456);
    assert.equal((await points())[index].opacity, 0.234567);
    await page.fill('#knot-value', '-412');
    await page.keyboard.press('Enter');
    assert.deepEqual([(await points())[index].value, (await points())[index].opacity], [-412, 0.234567]);
  });

  test('the axis stays within reach of the data, whatever is dragged, turned or typed', async () => {
    const { range } = await (await fetch(`${daemon.url}v1/volumes/head`)).json();
    const values = [...range, ...(await points()).map(({ value }) => value)];
    const margin = (Math.max(...values) - Math.min(...values)) * 0.11;
    const within = async () => {
      const [low, high] = await axis();
      assert.ok(low >= Math.min(...values) - margin && high <= Math.max(...values) + margin, `${low} to ${high}`);
    };
    const box = await plot();
    for (let i = 0; i < 3; i++) {
      await page.mouse.move(box.x + box.width * 0.5, box.y + box.height * 0.25);
      await page.mouse.down();
      await page.mouse.move(box.x + box.width * 3, box.y + 5, { steps: 3 });
      await page.mouse.up();
    }
    await within();
    await page.mouse.move(box.x + box.width / 2, box.y + 5);
    for (let i = 0; i < 12; i++) await page.mouse.wheel(0, 120);
    await page.waitForTimeout(50);
    await within();
    await page.fill('#axis-high', '1e9');
    await page.keyboard.press('Enter');
    await within();
  });

  test('the histogram ends where the values do, with upright sides', async () => {
    await page.click('#axis-all');
    const [low, high] = await axis();
    await page.fill('#axis-low', String(low - (high - low) * 0.1));
    await page.keyboard.press('Enter');
    assert.ok((await axis())[0] < low, 'the axis begins before the values');
    const path = await page.getAttribute('.transfer .histogram', 'd');
    const [, left, first] = /^M(\S+) \S+L(\S+) /.exec(path);
    assert.equal(left, first);
  });

  test('two fingers zoom the axis and keep their values', async () => {
    await page.click('#axis-all');
    const session = await page.context().newCDPSession(page);
    const box = await plot();
    const at = (share) => ({ x: box.x + box.width * share, y: box.y + box.height * 0.12 });
    const touch = (type, ...shares) =>
      session.send('Input.dispatchTouchEvent', { type, touchPoints: shares.map((share, id) => ({ ...at(share), id })) });
    const [low, high] = await axis();
    const before = await points();
    await touch('touchStart', 0.45);
    await touch('touchStart', 0.45, 0.55);
    for (let i = 1; i <= 5; i++) await touch('touchMove', 0.45 - i * 0.02, 0.55 + i * 0.02);
    await touch('touchEnd');
    const [from, to] = await axis();
    const value = (share) => low + (high - low) * share;
    assert.ok(Math.abs((to - from) / (high - low) - 1 / 3) < 0.02, `${from} to ${to} is a third of ${low} to ${high}`);
    assert.ok(Math.abs(from + (to - from) * 0.35 - value(0.45)) < (high - low) * 0.01, 'what was under a finger is there still');
    assert.deepEqual(await points(), before, 'the function is as it was');
    assert.deepEqual(page.complaints, []);
  });
});
