// What the page says of the picture belongs to the picture: edge letters, words, slices. Against the real daemon.
import assert from 'node:assert/strict';
import { after, before, describe, test } from 'node:test';

import { basis, edgeLetters, sliceBasis } from '../../web/camera.js';
import { browserMissing, launch } from './chromium.mjs';
import { daemonMissing, startDaemon } from './daemon.mjs';
import { settled, stageData } from './picture.mjs';
import { open } from './scenarios.mjs';

const skip = daemonMissing() || (await browserMissing());
const VOLUMES = ['--volume', 'head=demo:head'];

/** Numbers that are the same in every run. */
function random(seed) {
  let state = seed;
  return () => (state = (state * 48271) % 2147483647) / 2147483647;
}

/** In the page, before its own code: keeps every frame's header, and what the page said when that frame was drawn. */
function watchFrames() {
  window.headers = new Map();
  window.drawn = [];
  const Native = window.WebSocket;
  window.WebSocket = class extends Native {
    constructor(...args) {
      super(...args);
      window.socket = this;
      const connection = (window.connections = (window.connections ?? 0) + 1);
      this.addEventListener('message', ({ data }) => {
        if (typeof data === 'string') return;
        const size = new DataView(data).getUint32(0, true);
        const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, size)));
        window.headers.set(`${connection}/${header.frame}`, header);
      });
    }
  };
  addEventListener('DOMContentLoaded', () => {
    const stage = document.getElementById('stage');
    const text = (id) => document.getElementById(id).textContent;
    new MutationObserver(() => {
      const header = window.headers.get(`${window.connections}/${stage.dataset.frame}`);
      const [top, bottom, left, right] = ['top', 'bottom', 'left', 'right'].map((edge) => text(`mark-${edge}`));
      window.drawn.push({ scene: header?.scene, letters: { right, left, top, bottom }, label: text('label') });
    }).observe(stage, { attributeFilter: ['data-frame', 'data-seq'] });
  });
}

async function visit(browser, url, options) {
  const page = await browser.page(options);
  await page.addInitScript(watchFrames);
  await page.goto(url);
  await settled(page);
  return page;
}

/** Every frame that the page drew has its own letters, and its mode's name. @returns how many there were */
async function assertOwnLetters(page) {
  const drawn = await page.evaluate(() => window.drawn);
  const titles = await page.evaluate(() =>
    Object.fromEntries([...document.getElementById('mode').options].map(({ value, text }) => [value, text])),
  );
  for (const { scene, letters, label } of drawn) {
    const axes = scene.mode === 'mpr' ? sliceBasis(scene.mpr) : basis(scene.camera);
    assert.deepEqual(letters, edgeLetters(axes), JSON.stringify(scene));
    assert.ok(label.includes(titles[scene.mode]), `${label} is ${scene.mode}`);
  }
  return drawn.length;
}

describe('caption', { skip }, () => {
  let browser;
  let daemon;
  before(async () => {
    browser = await launch();
    daemon = await startDaemon(VOLUMES);
  });
  after(async () => {
    await browser?.close();
    await daemon?.stop();
  });

  test('random edits by two viewers, with drops: every frame drawn has its own letters', async () => {
    const one = await visit(browser, `${daemon.url}#head`);
    const { session } = await stageData(one);
    const two = await visit(browser, `${daemon.url}?session=${session}`, { viewport: { width: 920, height: 560 } });
    const next = random(7);
    const keys = ['a', 'p', 'l', 'r', 'h', 'f', 'ArrowLeft', 'ArrowUp', '+', '-'];
    for (let i = 0; i < 40; i++) {
      const page = next() < 0.5 ? one : two;
      const what = next();
      if (what < 0.1) await page.evaluate(() => window.socket.close());
      else if (what < 0.2) await page.selectOption('#mode', ['dvr', 'mip', 'mpr'][Math.floor(next() * 3)]);
      else await page.locator('#stage').press(keys[Math.floor(next() * keys.length)]);
      if (next() < 0.3) await page.waitForTimeout(next() * 120);
    }
    for (const page of [one, two]) await page.waitForSelector('#stat-link[data-state="open"]');
    await Promise.all([settled(one), settled(two)]);
    const counts = [await assertOwnLetters(one), await assertOwnLetters(two)];
    assert.ok(Math.min(...counts) > 15, `${counts} frames`);
    const [a, b] = [await one.evaluate(() => window.drawn.at(-1)), await two.evaluate(() => window.drawn.at(-1))];
    assert.deepEqual(a.scene, b.scene, 'at rest both show the same scene');
    assert.deepEqual(a.letters, b.letters);
    for (const page of [one, two]) {
      const { width, height } = await page.locator('#stage').boundingBox();
      assert.equal(await page.textContent('#stat-size'), `${width} \u00d7 ${height}`, 'as sharp as its window');
      await page.waitForTimeout(500); // the controls follow a moment later
      assert.equal(await page.inputValue('#mode'), a.scene.mode);
      assert.deepEqual(page.complaints, []);
      await page.close();
    }
  });

  test('the daemon is gone: the picture keeps its letters and says that it is not live', async () => {
    const { page } = await open(browser, `${daemon.url}#head`);
    const letters = () => page.textContent('#mark-right');
    assert.equal(await letters(), 'L');
    assert.ok(await page.isHidden('#stale'));
    await daemon.kill();
    await page.waitForSelector('#stale:not([hidden])');
    assert.match(await page.textContent('#stale'), /NOT LIVE/);
    await page.locator('#stage').press('l');
    await page.selectOption('#mode', 'mip');
    await page.waitForTimeout(300);
    assert.equal(await letters(), 'L', 'the frontal picture is still the frontal picture');
    assert.match(await page.textContent('#label'), /Volume rendering/);
    daemon = await startDaemon(VOLUMES, daemon.port);
    await page.waitForSelector('#stat-link[data-state="open"]', { timeout: 60000 });
    await settled(page);
    assert.equal(await letters(), 'P', 'the edit is kept, and shown with its picture');
    assert.match(await page.textContent('#label'), /Maximum intensity/);
    assert.ok(await page.isHidden('#stale'));
    await page.close();
  });
});
