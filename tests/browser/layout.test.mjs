// What fits where: the picture's share of small screens, what assistive technology is told (axe-core), numbers and words that can be read.
import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import { createRequire } from 'node:module';
import { before, describe, test } from 'node:test';

import { browserMissing } from './chromium.mjs';
import { daemonMissing } from './daemon.mjs';
import { settled, stageBox } from './picture.mjs';
import { serve } from './scenarios.mjs';

const skip = daemonMissing() || (await browserMissing());
const SIZES = [
  [1920, 1080],
  [1366, 768],
  [820, 1180],
  [390, 844],
  [844, 390],
];
const TABS = ['colour', 'render', 'labels', 'crop', 'picture', 'volume'];

/** What axe-core finds against WCAG 2.2 AA and its own best practice: "rule: element", each once. */
async function axe(page, parts = null) {
  const found = await page.evaluate(async (include) => {
    const tags = ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice'];
    const { violations } = await globalThis.axe.run(include ?? document, {
      runOnly: { type: 'tag', values: tags },
      resultTypes: ['violations'],
      preload: false, // the page's styles are its own
    });
    return violations.flatMap(({ id, nodes }) =>
      nodes.map(({ target, failureSummary }) => `${id}: ${target} ${failureSummary}`),
    );
  }, parts);
  return [...new Set(found)];
}

describe('what fits where', { skip }, () => {
  let browser;
  let daemon;
  let page;
  serve({ head: 'demo:head', parts: 'demo:head-labels' }, 'head', (made) => ({ browser, daemon, page } = made));
  before(async () =>
    page.evaluate(await readFile(createRequire(import.meta.url).resolve('axe-core/axe.min.js'), 'utf8')),
  );

  const resize = async ([width, height]) => {
    await page.setViewportSize({ width, height });
    await page.waitForTimeout(60);
  };
  const modes = () =>
    page.evaluate(() =>
      [...document.getElementById('mode').options].filter((o) => !o.disabled).map(({ value }) => value),
    );

  test('the picture has its share, upright and sideways, and every tab shows its section', async () => {
    for (const size of SIZES) {
      await resize(size);
      const stage = await stageBox(page);
      const share = (stage.width * stage.height) / (size[0] * size[1]);
      assert.ok(share >= 0.55, `${size}: ${share.toFixed(2)} of the window`);
      if (!(await page.isVisible('[role="tab"]'))) continue;
      for (const tab of TABS) {
        await page.click(`[role="tab"][data-tab="${tab}"]`);
        const shown = await page.locator('section:visible').all();
        assert.equal(shown.length, 1, tab);
        assert.ok((await shown[0].innerText()).trim().length > 10, `${size}: ${tab} is empty`);
        const box = await shown[0].boundingBox();
        assert.ok(box.x >= 0 && box.x + box.width <= size[0] + 1, `${size}: ${tab} fits`);
      }
      await page.click('[role="tab"][data-tab="colour"]');
    }
  });

  test('no words cover an orientation letter, and the header of a phone is two rows', async () => {
    for (const mode of ['dvr', 'mpr']) {
      await page.selectOption('#mode', mode);
      await settled(page);
      for (const size of [...SIZES, [360, 740]]) {
        await resize(size);
        const covered = await page.evaluate(() => {
          const boxes = (names) =>
            [...document.querySelectorAll(names)].filter((e) => e.getClientRects().length && e.textContent.trim());
          const cross = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
          const stale = document.getElementById('stale');
          Object.assign(stale, { hidden: false, textContent: 'NOT CURRENT \u00b7 a newer picture is on its way' });
          const words = boxes('#label, .badge, #probe, #scale-label, .disclaimer, #slice-field');
          const marked = [...boxes('.mark'), document.getElementById('tools')].flatMap((mark) =>
            words
              .filter((word) => cross(mark.getBoundingClientRect(), word.getBoundingClientRect()))
              .map((word) => `${word.id} over ${mark.id}`),
          );
          const banner = document.getElementById('banner');
          banner.hidden = false;
          const box = banner.getBoundingClientRect();
          const over = boxes('.badge').filter((badge) => cross(badge.getBoundingClientRect(), box));
          stale.hidden = banner.hidden = true;
          return [...marked, ...over.map(({ id }) => `banner over ${id}`)];
        });
        assert.deepEqual(covered, [], `${size} ${mode}`);
        if (size[0] < 400) assert.ok((await page.locator('.bar').boundingBox()).height < 110, `${size}`);
      }
    }
    await page.selectOption('#mode', 'dvr');
  });

  test('axe finds nothing, in any window, mode, tab or dialog', async () => {
    for (const size of SIZES) {
      await resize(size);
      assert.deepEqual(await axe(page), [], `${size}`);
      for (const mode of size[1] < 500 ? [] : (await modes()).slice(1)) {
        await page.selectOption('#mode', mode);
        for (const tab of size[0] < 500 ? ['render', 'colour'] : ['']) {
          if (tab) await page.click(`[role="tab"][data-tab="${tab}"]`);
          const parts = ['#stage', '#section-colour', '#section-render'].slice(tab === 'colour' ? 1 : 0);
          assert.deepEqual(await axe(page, parts), [], `${size} ${mode} ${tab}`);
        }
      }
      await page.selectOption('#mode', 'dvr');
    }
    for (const tab of TABS.slice(1)) {
      await page.click(`[role="tab"][data-tab="${tab}"]`);
      assert.deepEqual(await axe(page), [], tab);
    }
    for (const button of ['#volume-open', '#scene-open', '#help-open']) {
      await page.click(button);
      await page.waitForTimeout(100);
      assert.deepEqual(await axe(page), [], button);
      await page.keyboard.press('Escape');
    }
    await page.click('[role="tab"][data-tab="colour"]');
  });

  test('number fields show their whole number', async () => {
    for (const size of SIZES) {
      await resize(size);
      for (const mode of ['dvr', 'mpr', 'isosurface']) {
        await page.selectOption('#mode', mode);
        const cut = await page.evaluate(() =>
          [...document.querySelectorAll('input[type="number"]')]
            .filter((field) => field.getClientRects().length)
            .filter((field) => {
              field.value = -1234.567; // seven digits is what the page writes
              return field.scrollWidth > field.clientWidth;
            })
            .map(
              ({ id, dataset, clientWidth, scrollWidth }) => `${id || dataset.path}: ${clientWidth} of ${scrollWidth}`,
            ),
        );
        assert.deepEqual(cut, [], `${size} ${mode}`);
      }
    }
    await page.selectOption('#mode', 'dvr');
  });

  test('words on the picture lie on plates that part them from any ground', async () => {
    await resize(SIZES[1]);
    const light = (c) => (c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
    const luminance = (rgb) => rgb.reduce((sum, c, k) => sum + light(c / 255) * [0.2126, 0.7152, 0.0722][k], 0);
    for (const background of ['0,0,0', '1,1,1']) {
      await page.selectOption('#background', background);
      const words = await page.evaluate(() => {
        document.getElementById('probe').textContent = 'L 1.0';
        const numbers = (text) => text.match(/[\d.]+/g).map(Number);
        return ['#mark-left', '#label', '#probe', '.disclaimer', '#badge'].map((name) => {
          const { color, backgroundColor } = getComputedStyle(document.querySelector(name));
          return { name, ink: numbers(color), plate: numbers(backgroundColor) };
        });
      });
      for (const { name, ink, plate } of words) {
        for (const ground of [0, 120, 255]) {
          const under = plate.slice(0, 3).map((c) => c * (plate[3] ?? 1) + ground * (1 - (plate[3] ?? 1)));
          const [low, high] = [luminance(ink), luminance(under)].sort((a, b) => a - b);
          const contrast = (high + 0.05) / (low + 0.05);
          assert.ok(contrast >= 4.5, `${name} over grey ${ground}, background ${background}: ${contrast.toFixed(1)}:1`);
        }
      }
    }
    await page.selectOption('#background', '0,0,0');
  });

  test('the first dialog is ready to search; after Escape the stage says what to do', async () => {
    const first = await browser.page();
    await first.goto(daemon.url);
    await first.waitForSelector('.volume-item');
    await first.keyboard.type('par');
    await first.waitForFunction(() => document.querySelectorAll('.volume-item').length === 1);
    await first.keyboard.press('ArrowDown');
    assert.equal(await first.evaluate(() => document.activeElement.dataset.id), 'parts');
    await first.keyboard.press('Escape');
    assert.match(await first.innerText('#stage'), /Open a volume[^]*drop/);
    const waiting = () => first.$$eval('[data-needs-scene]', (parts) => parts.map((part) => part.inert));
    assert.deepEqual([...new Set(await waiting())], [true], 'there is no scene to edit');
    await first.keyboard.press('ArrowRight'); // of a camera that is not there
    await first.click('#empty-open');
    assert.ok(await first.isVisible('#volume-dialog'));
    await first.click('.volume-item[data-id="head"]');
    await settled(first);
    assert.ok(await first.isHidden('#empty'));
    assert.deepEqual([...new Set(await waiting())], [false]);
    assert.deepEqual(first.complaints, []);
    await first.close();
  });
});
