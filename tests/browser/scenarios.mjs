// What must work against any server: run with the daemon, or with the fake server if there is no daemon.
import assert from 'node:assert/strict';
import { after, afterEach, before, beforeEach } from 'node:test';

import { launch } from './chromium.mjs';
import { startDaemon } from './daemon.mjs';
import { FakeServer } from './fake_server.mjs';
import { difference, drag, settled, spread, stageBox, stageData } from './picture.mjs';

const CHANGED = 1.5; // mean difference of a thumbnail that nobody would call the same picture
const SAME = 0.8; // and of one that differs by encoding only

/** Opens a page and waits for its first finished picture. */
export async function open(browser, url, options) {
  const page = await browser.page(options);
  await page.goto(url);
  const picture = await settled(page);
  assert.ok(spread(picture) > 40, 'the picture shows something');
  return { page, picture };
}

/**
 * Before the tests of a suite a browser and a daemon with demo volumes, and a page of one of them where an id is given;
 * after them they go. take({browser, daemon, page})
 */
export function serve(volumes, id, take, options) {
  const made = {};
  before(async () => {
    made.browser = await launch();
    made.daemon = await startDaemon(Object.entries(volumes).flatMap(([name, path]) => ['--volume', `${name}=${path}`]));
    if (id) made.page = (await open(made.browser, `${made.daemon.url}#${id}`, options)).page;
    take(made);
  });
  after(async () => {
    await made.browser?.close();
    await made.daemon?.stop();
    assert.deepEqual(made.page?.complaints ?? [], []);
  });
}

/** A browser for the tests of a suite, and for each of them a fake server. take({browser, server, url}) */
export function serveFake(take) {
  let browser;
  let server;
  before(async () => (browser = await launch()));
  after(() => browser?.close());
  beforeEach(async () => {
    server = new FakeServer();
    take({ browser, server, url: `${await server.start()}#ball` });
  });
  afterEach(() => server.stop());
}

export async function orbitChangesThePicture(browser, url) {
  const { page, picture } = await open(browser, url);
  const { cx, cy } = await stageBox(page);
  await drag(page, [cx, cy], [cx + 160, cy - 60]);
  const turned = await settled(page);
  assert.ok(difference(picture, turned) > CHANGED, `orbit changed by ${difference(picture, turned)}`);
  assert.notEqual(await page.textContent('#mark-right'), 'L', 'the edge letters follow');
  await page.keyboard.press('Space');
  const reset = await settled(page);
  assert.ok(difference(picture, reset) < SAME, `reset is off by ${difference(picture, reset)}`);
  assert.deepEqual(page.complaints, []);
  await page.close();
}

export async function panAndZoomDoWhatTheySay(browser, url) {
  const { page, picture } = await open(browser, url);
  const { cx, cy } = await stageBox(page);
  const weight = (thumb) => {
    let [sum, x] = [0, 0];
    for (let i = 0; i < thumb.length; i += 3) {
      sum += thumb[i + 1];
      x += thumb[i + 1] * ((i / 3) % 32);
    }
    return { sum, x: x / (sum || 1) };
  };
  await drag(page, [cx, cy], [cx + 120, cy], { button: 'middle' });
  const moved = await settled(page);
  assert.ok(weight(moved).x > weight(picture).x + 1, 'the middle drag moves to the right');
  await page.mouse.wheel(0, 400);
  const { camera: far } = await scene(page);
  await page.mouse.wheel(0, -800);
  await settled(page);
  const { camera: near } = await scene(page);
  const away = ({ position, target }) => Math.hypot(...position.map((p, k) => p - target[k]));
  assert.ok(away(near) < away(far), 'the wheel comes closer');
  await drag(page, [cx, cy], [cx, cy - 80], { button: 'right' });
  await settled(page);
  assert.ok(away((await scene(page)).camera) < away(near), 'so does the right drag');
  await page.close();
}

export async function keysWork(browser, url) {
  const { page, picture } = await open(browser, url);
  await page.focus('#stage');
  for (let i = 0; i < 4; i++) await page.keyboard.press('ArrowLeft');
  assert.ok(difference(picture, await settled(page)) > CHANGED / 2, 'arrows turn');
  for (const [key, right, top] of [
    ['p', 'R', 'H'],
    ['l', 'P', 'H'],
    ['f', 'L', 'A'],
    ['a', 'L', 'H'],
  ]) {
    await page.keyboard.press(key);
    await settled(page); // the letters are the picture's
    assert.equal(await page.textContent('#mark-right'), right, key);
    assert.equal(await page.textContent('#mark-top'), top, key);
  }
  const before = (await scene(page)).camera;
  await page.keyboard.press('+');
  assert.notDeepEqual((await scene(page)).camera.position, before.position);
  await page.keyboard.press('2');
  const second = await page.evaluate(() => document.querySelectorAll('#preset option')[2].value);
  assert.equal(await page.inputValue('#preset'), second, 'digits choose presets');
  await settled(page);
  await page.keyboard.press('?');
  assert.ok(await page.isVisible('#help-dialog'));
  await page.keyboard.press('Escape');
  assert.ok(!(await page.isVisible('#help-dialog')));
  assert.deepEqual(page.complaints, []);
  await page.close();
}

/** Centre of a knot on the page. */
async function knotAt(page, index) {
  const box = await page.locator('.knot .dot').nth(index).boundingBox();
  return [box.x + box.width / 2, box.y + box.height / 2];
}

/** A knot whose opacity shows: the first one at least half as opaque as the most opaque. */
async function strongKnot(page) {
  const { points } = (await scene(page)).transferFunction;
  const most = Math.max(...points.map(({ opacity }) => opacity));
  return points.findIndex(({ opacity }) => opacity >= most / 2);
}

export async function transferFunctionDragChangesThePicture(browser, url) {
  const { page, picture } = await open(browser, url);
  await page.click('#axis-knots');
  const index = await strongKnot(page);
  const from = await knotAt(page, index);
  const before = (await scene(page)).transferFunction.points;
  await drag(page, from, [from[0] - 30, from[1] + 90]);
  const dragged = await settled(page);
  const after = (await scene(page)).transferFunction.points;
  assert.equal(after.length, before.length);
  assert.ok(after[index].opacity < before[index].opacity - 0.05, 'the knot went down');
  assert.ok(difference(picture, dragged) > CHANGED / 2, `the picture changed by ${difference(picture, dragged)}`);
  assert.equal(await page.inputValue('#preset'), '', 'an edited preset is no preset');
  await page.mouse.click(...(await knotAt(page, index))); // a click alone is no step of undo
  await page.keyboard.press('Control+z');
  assert.ok(difference(picture, await settled(page)) < SAME, 'undo brings the picture back');
  assert.deepEqual((await scene(page)).transferFunction.points, before);
  await page.mouse.click(...(await knotAt(page, index))); // and loses no redo
  await page.keyboard.press('Control+Shift+z');
  assert.ok(difference(dragged, await settled(page)) < SAME, 'and redo the edit');
  assert.deepEqual(page.complaints, []);
  await page.close();
}

export async function knotsAreAddedAndRemoved(browser, url) {
  const { page } = await open(browser, url);
  await page.click('#axis-knots');
  const count = () => page.locator('.knot').count();
  const before = await count();
  const plot = await page.locator('.transfer .plot').boundingBox();
  await page.mouse.dblclick(plot.x + plot.width * 0.03, plot.y + plot.height * 0.2);
  assert.equal(await count(), before + 1, 'double-click adds');
  await page.locator('.knot.selected').click({ button: 'right' });
  assert.equal(await count(), before, 'right-click removes');
  await page.locator('.knot.selected').focus();
  await page.keyboard.press('Enter');
  assert.equal(await count(), before + 1, 'Enter adds beside the selected knot');
  const value = Number(await page.inputValue('#knot-value'));
  await page.keyboard.press('ArrowUp');
  await page.keyboard.press('Delete');
  assert.equal(await count(), before, 'Delete removes');
  await page.fill('#knot-value', String(value));
  await page.fill('#knot-amount', '0.42');
  await page.keyboard.press('Enter');
  const { points } = (await scene(page)).transferFunction;
  assert.ok(
    points.some(({ opacity }) => opacity === 0.42),
    'numbers are taken as typed',
  );
  const [x, y] = await knotAt(page, await strongKnot(page));
  await drag(page, [x, y], [x, plot.y - 80]);
  assert.equal(await count(), before - 1, 'dragged out is removed');
  assert.deepEqual(page.complaints, []);
  await page.close();
}

export async function touchTurnsAndPinches(browser, url) {
  const { page, picture } = await open(browser, url, {
    viewport: { width: 820, height: 1180 },
    hasTouch: true,
    isMobile: true,
  });
  const { cx, cy } = await stageBox(page);
  const session = await page.context().newCDPSession(page);
  const touch = (type, points) =>
    session.send('Input.dispatchTouchEvent', { type, touchPoints: points.map(([x, y], id) => ({ x, y, id })) });
  await touch('touchStart', [[cx, cy]]);
  for (let i = 1; i <= 6; i++) await touch('touchMove', [[cx + i * 20, cy]]);
  await touch('touchEnd', []);
  assert.ok(difference(picture, await settled(page)) > CHANGED, 'one finger turns');
  const before = (await scene(page)).camera;
  await touch('touchStart', [
    [cx - 40, cy],
    [cx + 40, cy],
  ]);
  for (let i = 1; i <= 6; i++)
    await touch('touchMove', [
      [cx - 40 - i * 10, cy + i * 10],
      [cx + 40 + i * 10, cy + i * 10],
    ]);
  await touch('touchEnd', []);
  await settled(page);
  const after = (await scene(page)).camera;
  const away = ({ position, target }) => Math.hypot(...position.map((p, k) => p - target[k]));
  assert.ok(away(after) < away(before) * 0.6, 'two fingers zoom');
  assert.notDeepEqual(after.target, before.target, 'and move');
  assert.equal(await page.evaluate(() => window.scrollY), 0);
  for (const tab of ['Rendering', 'Crop', 'Picture', 'Volume']) {
    await page.getByRole('tab', { name: tab }).tap();
    assert.equal(await page.locator('section:visible').count(), 1, tab);
  }
  assert.deepEqual(page.complaints, []);
  await page.close();
}

export async function resizeAsksForAnotherPicture(browser, url) {
  const { page } = await open(browser, url);
  const { image } = await scene(page);
  await page.setViewportSize({ width: 1000, height: 700 });
  await page.waitForTimeout(300);
  await settled(page);
  const box = await stageBox(page);
  const [width, height] = (await page.textContent('#stat-size')).split(' \u00d7 ').map(Number);
  assert.ok(Math.abs(width - box.width) < 2 && Math.abs(height - box.height) < 2);
  assert.deepEqual((await scene(page)).image, image, "the size is the viewer's, not the scene's");
  await page.close();
}

export async function sceneTravelsAsJson(browser, url) {
  const { page } = await open(browser, url);
  await page.click('#scene-open');
  const kept = JSON.parse(await page.inputValue('#scene-text'));
  assert.equal(kept.mode, 'dvr');
  await page.fill('#scene-text', '{"mode": "dvr", "nonsense": 1}');
  await page.click('#scene-load');
  await page.waitForSelector('#scene-problem:not([hidden])');
  assert.match(await page.textContent('#scene-problem'), /nonsense/);
  kept.camera.position = kept.camera.target.map((x, k) => x + [0, 400, 0][k]);
  await page.fill('#scene-text', JSON.stringify(kept));
  await page.click('#scene-load');
  await page.waitForSelector('#scene-dialog:not([open])', { state: 'attached' });
  await page.waitForFunction(() => document.getElementById('mark-right').textContent === 'R');
  await page.close();
}

export async function pictureIsSavedAsPng(browser, url) {
  const { page } = await open(browser, url);
  const [download] = await Promise.all([page.waitForEvent('download'), page.click('#save')]);
  assert.match(download.suggestedFilename(), /\.png$/);
  // To its end: what is still being read when the page goes would fail after the test.
  const file = Buffer.concat(await (await download.createReadStream()).toArray());
  assert.deepEqual([...file.subarray(0, 4)], [137, 80, 78, 71]);
  await page.close();
}

export async function joinedSessionsShareOneScene(browser, url) {
  const { page } = await open(browser, url);
  const { session } = await stageData(page);
  const other = await open(browser, `${url.split('#')[0]}?session=${session}`);
  assert.equal((await stageData(other.page)).session, session);
  await page.keyboard.press('p');
  await settled(page);
  await other.page.waitForFunction(() => document.getElementById('mark-right').textContent === 'R', null, {
    timeout: 20000,
  });
  await other.page.close();
  await page.close();
}

/** The scene the page holds, by way of its own dialog. */
export async function scene(page) {
  await page.evaluate(() => document.getElementById('scene-open').click());
  const text = await page.inputValue('#scene-text');
  await page.evaluate(() => document.getElementById('scene-dialog').close());
  return JSON.parse(text);
}

/** The link that the page's own dialog copies. */
export async function linkOf(page, role) {
  await page.evaluate(() => {
    window.copied = new Promise((resolve) => {
      Object.defineProperty(navigator, 'clipboard', {
        configurable: true,
        value: { writeText: async (text) => resolve(text) },
      });
    });
  });
  await page.click('#scene-open');
  await page.selectOption('#scene-share-role', role);
  await page.click('#scene-share');
  return page.evaluate(() => window.copied);
}

export const EVERYWHERE = {
  'orbit drag changes the picture, space brings it back': orbitChangesThePicture,
  'pan and zoom': panAndZoomDoWhatTheySay,
  keyboard: keysWork,
  'transfer-function drag changes the picture; undo and redo': transferFunctionDragChangesThePicture,
  'knots are added and removed by pointer and keyboard': knotsAreAddedAndRemoved,
  'touch: one finger, two fingers, tabs': touchTurnsAndPinches,
  'a resized window asks for a picture of its size': resizeAsksForAnotherPicture,
  'the scene travels as JSON, refusals are shown': sceneTravelsAsJson,
  'the picture is saved as PNG': pictureIsSavedAsPng,
  'a joined session shows the same scene': joinedSessionsShareOneScene,
};
