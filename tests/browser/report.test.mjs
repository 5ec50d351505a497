// The page of `tomocast report`, as a phone and as paper show it.
import assert from 'node:assert/strict';
import { execFile } from 'node:child_process';
import { mkdtemp, readFile, rm } from 'node:fs/promises';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { promisify } from 'node:util';

import { browserMissing, launch } from './chromium.mjs';
import { daemonMissing } from './daemon.mjs';

const PHONE = 390;
const PAPER = Math.floor(((210 - 2 * 14) / 25.4) * 96); // A4 between the page's margins
const skip = daemonMissing() || (await browserMissing());
let browser, folder, address;

before(async () => {
  if (skip) return;
  folder = await mkdtemp(join(tmpdir(), 'tomocast-report-page-'));
  const small = ['--quick', '--no-gl', '--size', '16', '--side', '24'];
  await promisify(execFile)(process.env.TC_BINARY, ['report', '--volume', 'demo:bucky', ...small, '--output', folder]);
  address = `file://${folder}/report.html`;
  browser = await launch();
});
after(async () => {
  await browser?.close();
  if (folder) await rm(folder, { recursive: true });
});

const overflowing = () =>
  [...document.querySelectorAll('.wide')].map((box) => ({
    over: box.scrollWidth - box.clientWidth,
    shade: getComputedStyle(box).backgroundImage,
  }));

test('the first screen draws every scene and says what follows; nothing is fetched', { skip }, async () => {
  const page = await browser.page({ viewport: { width: 1366, height: 768 } });
  const problems = [];
  page.on('pageerror', (error) => problems.push(error.message));
  page.on('request', (request) => request.url() === address || problems.push(request.url()));
  await page.goto(address);
  const cards = await page.$$eval('#overview figure', (figures) =>
    figures.map((figure) => ({
      bottom: figure.getBoundingClientRect().bottom,
      marks: figure.querySelectorAll('path > title').length,
      front: figure.querySelectorAll('.front').length,
      words: figure.querySelector('figcaption').textContent,
    })),
  );
  const { scenes, results } = JSON.parse(await readFile(join(folder, 'report.json'), 'utf8'));
  assert.equal(cards.length, scenes.length);
  for (const [i, { bottom, marks, front, words }] of cards.entries()) {
    assert.ok(bottom <= 768, `${bottom}`);
    assert.equal(
      marks,
      results.filter((row) => row.filter === 'linear' && row[row.raysPerPixel > 1 ? 'areaRms' : 'rms'] > 0).length,
    );
    assert.equal(front, 1);
    assert.match(words, /^(Fastest|No setting stays) under 1\/255/);
    assert.equal(words, scenes[i].conclusion);
  }
  // Every figure of the front, in the scene's own chart.
  const tips = await page.$$eval('#scene-1 figure:first-child path > title', (titles) =>
    titles.map((title) => title.textContent),
  );
  for (const key of scenes[0].summary.front) {
    const { timeMs } = results.find((row) => row.key === key);
    assert.ok(
      tips.some((tip) => tip.includes(` ${Number(timeMs.toPrecision(3))} ms,`)),
      key,
    );
  }
  assert.deepEqual(problems, []);
  await page.context().close();
});

test('objects: a row each, every way drawn, and where splats and rays change places', { skip }, async () => {
  const page = await browser.page({ viewport: { width: 1366, height: 768 } });
  await page.goto(address);
  const { objects } = JSON.parse(await readFile(join(folder, 'report.json'), 'utf8'));
  const section = await page.$eval('#objects', (element) => ({
    rows: [...element.querySelectorAll('tbody')].map((body) => body.rows.length),
    sized: [...element.querySelectorAll('#sizes tbody tr')].map((row) => [...row.cells].slice(1).map((cell) => cell.textContent)),
    marks: [...element.querySelectorAll('figure')].map((figure) => figure.querySelectorAll('path > title').length),
    words: [...element.querySelectorAll('li')].map((item) => item.textContent),
  }));
  assert.deepEqual(section.rows, [objects.length, objects.length]);
  const fastest = ({ ms }) => (ms.splat < ms.isosurface ? 'splats' : 'ray-cast isosurface');
  const least = (object) => [object, ...object.sizes].reduce((a, b) => (a.size < b.size ? a : b));
  const byFilled = [...objects].sort((a, b) => a.filled - b.filled);
  section.sized.forEach((cells, i) => {
    assert.equal(cells.length, 4);
    assert.ok(cells[0].startsWith(fastest(least(byFilled[i]))), cells[0]);
  });
  assert.deepEqual(section.marks, [6 * objects.length, 3 * objects.length], 'measured and expected; errors');
  const wins = objects.filter(({ ms }) => ms.splat < ms.isosurface).length;
  const line = `splats against ray-cast isosurface: faster on ${wins} of ${objects.length}; they change places `;
  assert.ok(section.words[0].startsWith(line), section.words[0]);
  const swept = await page.$$eval('#grids tbody tr', (rows) => rows.map((row) => row.cells[4].textContent));
  assert.equal(swept.length, objects[0].grids.length);
  assert.equal(new Set(swept).size, 1, 'as many splats in every grid');
  // The same page, with an object whose times cross half way (over logarithms) between two.
  const crossed = await page.evaluate(() => {
    const [left, right] = [byFilled[0], byFilled.at(-1)];
    byFilled.splice(0, byFilled.length, { ...left, filled: 0.01, ms: { ...left.ms, splat: 1, isosurface: 4 } });
    byFilled.push({ ...right, filled: 0.25, ms: { ...right.ms, splat: 4, isosurface: 1 } });
    return lineBetween('splat', 'isosurface');
  });
  assert.match(crossed, /they change places at 5 % \(splats below\)/);
  await page.context().close();
});

test('surfaces: when triangles are the better choice, by the figures; error, outline and time over triangles', { skip }, async () => {
  const page = await browser.page({ viewport: { width: 1366, height: 768 } });
  await page.goto(address);
  const section = await page.$eval('#surface', (element) => ({
    words: [...element.querySelectorAll('li')].map((item) => item.textContent),
    figures: [...element.querySelectorAll('figure h4')].map((title) => title.textContent),
  }));
  assert.deepEqual(section.figures, ['Error over triangles', 'Outline over triangles', 'Time over triangles']);
  assert.equal(section.words.length, 4);
  assert.match(section.words[0], /^(Triangles are the better choice from \d+ frames|The ray-cast isosurface is the better choice here)/);
  // Made-up figures: rays are faster in small pictures; 90 ms more of building are paid for by 10 ms a frame.
  const speeds = [{ size: 64, n: 3, wins: 1, ratios: [0.5, 0.8, 2] }, { size: 128, n: 3, wins: 2, ratios: [0.9, 2, 4] }];
  const advise = (...given) => page.evaluate((all) => surfaceAdvice(...all), given);
  const frames = await page.evaluate(() => paysAfter({ ms: { isosurface: 12, mesh: 2 }, buildMs: { isosurface: 5, mesh: 95 } }));
  assert.equal(frames, 9);
  assert.equal(await page.evaluate(() => paysAfter({ ms: { isosurface: 2, mesh: 2 }, buildMs: { isosurface: 0, mesh: 1 } })), null);
  assert.match(await advise(speeds, 9), /from 9 frames of one surface on, in pictures of 128 pixels .*\(0.9 to 4 x at 128\).*pictures are smaller or/);
  assert.doesNotMatch(await advise(speeds.slice(1), 9), /smaller/);
  assert.match(await advise(speeds.slice(0, 1), 9), /^The ray-cast isosurface is the better choice here/);
  await page.context().close();
});

for (const colorScheme of ['light', 'dark']) {
  test(`no wider than a phone; a table that is, is shaded where it goes on (${colorScheme})`, { skip }, async () => {
    const page = await browser.page({ viewport: { width: PHONE, height: 844 }, colorScheme });
    await page.goto(address);
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), PHONE);
    const wide = (await page.evaluate(overflowing)).filter(({ over }) => over > 0);
    assert.ok(wide.length > 0, 'the tables of single choices scroll');
    for (const { shade } of wide) assert.equal(shade.match(/linear-gradient/g)?.length, 2, shade);
    // The shade is seen before the table is scrolled to its end, and gone there: pixels at the right edge.
    const box = (await page.$$('.wide'))[(await page.evaluate(overflowing)).findIndex(({ over }) => over > 0)];
    const edge = async () => {
      const { x, y, width } = await box.boundingBox();
      const clip = { x: x + width - 3, y: y + 2, width: 2, height: 4 };
      return (await page.screenshot({ clip, fullPage: true })).toString('base64');
    };
    const before = await edge();
    await box.evaluate((element) => (element.scrollLeft = element.scrollWidth));
    assert.notEqual(await edge(), before);
    await page.context().close();
  });
}

test('all of every table is on the paper', { skip }, async () => {
  const page = await browser.page({ viewport: { width: PAPER, height: 1000 } });
  await page.goto(address);
  await page.emulateMedia({ media: 'print' });
  assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), PAPER);
  const right = await page.$$eval('table', (tables) => tables.map((table) => table.getBoundingClientRect().right));
  assert.ok(right.length > 5 && Math.max(...right) <= PAPER, `${right}`);
  const text = await page.innerText('body');
  for (const words of ['preintegrated2, expected 3', 'approximate, expected 2', '99.9 % under']) {
    assert.ok(text.includes(words), words);
  }
  await page.context().close();
});
