// Wheel, double click, keys and fingers on the page of the real daemon (TC_BINARY): what was under them stays there.
import assert from 'node:assert/strict';
import { before, describe, test } from 'node:test';

import { basis, distance, dot, sub } from '../../web/camera.js';
import { browserMissing } from './chromium.mjs';
import { daemonMissing } from './daemon.mjs';
import { difference, settled, stageBox, stageData } from './picture.mjs';
import { open, scene, serve } from './scenarios.mjs';

const skip = daemonMissing() || (await browserMissing());
const RADIANS = Math.PI / 180;
const SPACING = 0.95; // of demo:head, along z

/** CSS pixel of the stage where a place of the patient is seen. */
function seenAt(camera, place, stage) {
  const { direction, right, up } = basis(camera);
  const off = sub(place, camera.position);
  const perspective = camera.projection === 'perspective';
  const span = perspective ? 2 * dot(off, direction) * Math.tan((camera.fovY * RADIANS) / 2) : camera.height;
  const pixels = stage.height / span;
  return [stage.width / 2 + dot(off, right) * pixels, stage.height / 2 - dot(off, up) * pixels];
}

/** Waits until every edit has reached the daemon: quicker than a finished picture. */
async function told(page) {
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  await page.waitForFunction(() => document.getElementById('stage').dataset.pending === '0', null, { timeout: 60000 });
}

/** Asks until it holds, a minute at the longest. */
async function until(what, holds) {
  const end = Date.now() + 60000;
  while (!(await holds())) {
    assert.ok(Date.now() < end, what);
    await new Promise((done) => setTimeout(done, 20));
  }
}

const apart = (a, b) => Math.hypot(...a.map((x, k) => x - b[k]));

describe('hands on the picture', { skip }, () => {
  let browser;
  let daemon;
  let page;
  let stage;
  serve({ head: 'demo:head' }, 'head', (made) => ({ browser, daemon, page } = made));
  before(async () => (stage = await stageBox(page)));

  const camera = async (of = page) => (await scene(of)).camera;
  const middle = async () => (await scene(page)).mpr.center;
  const press = async (...keys) => {
    for (const key of keys) await page.keyboard.press(key);
    await told(page);
  };
  const pick = async (x, y, of = page, box = stage) => {
    const { session } = await stageData(of);
    const { image } = await scene(of);
    const px = Math.floor((x / box.width) * image.width);
    const py = Math.floor((y / box.height) * image.height);
    return (await fetch(`${daemon.url}v1/sessions/${session}/pick?x=${px}&y=${py}`)).json();
  };
  const at = (x, y) => page.mouse.move(stage.x + x, stage.y + y);
  const toMode = async (mode) => {
    await page.selectOption('#mode', mode);
    await page.focus('#stage');
    await told(page);
  };

  for (const projection of ['perspective', 'orthographic']) {
    test(`the wheel zooms about the pointer, ${projection}, at most 1.25 times a notch with Ctrl`, async () => {
      await press('Space');
      await page.selectOption('#projection', projection);
      await told(page);
      const [x, y] = [stage.width * 0.62, stage.height * 0.36];
      const { position } = await pick(x, y);
      const first = await camera();
      const off = apart(seenAt(first, position, stage), [x, y]);
      assert.ok(off < 1.5, `the projection of this test is the page's: ${off}`);
      await at(x, y);
      for (const notch of [-120, -120, -120, 120]) await page.mouse.wheel(0, notch);
      await told(page);
      const then = await camera();
      const moved = apart(seenAt(then, position, stage), seenAt(first, position, stage));
      assert.ok(moved < 0.5, `what was under the pointer moved ${moved} pixels`);
      const size = (view) => (projection === 'perspective' ? distance(view) : view.height);
      assert.ok(size(first) / size(then) > 1.3 && size(first) / size(then) < 1.25 ** 2, 'two notches in all');
      await page.keyboard.down('Control');
      await page.mouse.wheel(0, -120);
      await page.keyboard.up('Control');
      await told(page);
      const factor = size(then) / size(await camera());
      assert.ok(factor > 1.1 && factor < 1.2501, `Ctrl and one notch: ${factor}`);
    });
  }

  test('the right drag zooms about where it began', async () => {
    await press('Space');
    const [x, y] = [stage.width * 0.6, stage.height * 0.4];
    const { position } = await pick(x, y);
    const before = seenAt(await camera(), position, stage);
    await at(x, y);
    await page.mouse.down({ button: 'right' });
    await at(x, y - 90);
    await page.mouse.up({ button: 'right' });
    await told(page);
    assert.ok(apart(seenAt(await camera(), position, stage), before) < 0.5);
  });

  test('a double click brings the surface under it to the middle, and turns nothing', async () => {
    await press('Space');
    const [x, y] = [stage.width * 0.58, stage.height * 0.3];
    const { position } = await pick(x, y);
    const first = await camera();
    await page.mouse.dblclick(stage.x + x, stage.y + y);
    for (let i = 0; i < 100 && apart((await camera()).target, first.target) === 0; i++) await page.waitForTimeout(50);
    await told(page);
    const then = await camera();
    assert.ok(apart(then.target, position) < 1, `${then.target} is ${position}`);
    assert.ok(apart(seenAt(then, position, stage), [stage.width / 2, stage.height / 2]) < 2);
    assert.ok(apart(basis(then).direction, basis(first).direction) < 1e-9);
  });

  test('c turns until it is pressed again, and a hand on the picture stops it', async () => {
    await press('Space');
    const first = await camera();
    await page.keyboard.press('c');
    let turned;
    await until('c turns', async () => apart(first.position, (turned = await camera()).position) > 1);
    assert.ok(Math.abs(distance(first) - distance(turned)) < 1e-6);
    await press('c');
    const still = await camera();
    await page.waitForTimeout(200);
    assert.deepEqual(await camera(), still, 'c stops the turning');
    await page.keyboard.press('c');
    await until('c turns again', async () => apart(still.position, (await camera()).position) > 1);
    await page.mouse.click(stage.x + 20, stage.y + stage.height / 2);
    await told(page);
    const stopped = await camera();
    await page.waitForTimeout(200);
    assert.deepEqual(await camera(), stopped, 'so does a click');
  });

  test('one notch is one slice, and the volume is the end', async () => {
    await toMode('mpr');
    await press('Home');
    await at(stage.width / 2, stage.height / 2);
    const first = await middle();
    for (const [delta, slices] of [
      [100, 1],
      [120, 2],
      [-120, 1],
    ]) {
      await page.mouse.wheel(0, delta);
      await told(page);
      const z = (await middle())[2] - first[2];
      assert.ok(Math.abs(z - slices * SPACING) < 1e-6, `${delta}: slice ${slices}, not ${z / SPACING}`);
    }
    await page.mouse.wheel(0, -4000);
    await told(page);
    assert.deepEqual(await middle(), first, 'no further than the first');
    await press('End');
    const last = await middle();
    const volume = await (await fetch(`${daemon.url}v1/volumes/head`)).json();
    assert.ok(Math.abs(last[2] - first[2] - (volume.dims[2] - 1) * volume.spacing[2]) < 1e-6);
    await press('ArrowRight', 'PageDown');
    assert.deepEqual(await middle(), last, 'nor than the last');
    await press('ArrowLeft', 'ArrowUp');
    assert.ok(Math.abs(last[2] - (await middle())[2] - 2 * SPACING) < 1e-6, 'left and up go back');
  });

  test('slices zoom about the pointer too, and a double click centres', async () => {
    await press('Space');
    const place = async (x, y) => {
      await page.mouse.click(stage.x + x, stage.y + y);
      await page.waitForTimeout(450); // longer than a double click takes
      return (await page.textContent('#probe')).match(/[\d.]+/g).slice(0, 3).map(Number);
    };
    const [x, y] = [stage.width * 0.6, stage.height * 0.4];
    const before = await place(x, y);
    await page.keyboard.down('Control');
    for (let i = 0; i < 3; i++) await page.mouse.wheel(0, -120);
    await page.keyboard.up('Control');
    await told(page);
    assert.ok((await scene(page)).mpr.zoom > 1.5);
    assert.ok(apart(await place(x, y), before) < 0.5, 'mm');
    await page.mouse.dblclick(stage.x + x, stage.y + y);
    await told(page);
    assert.ok(apart(await place(stage.width / 2, stage.height / 2), before) < 0.5, 'mm');
  });

  test('i gives black for white, says so, and F is still Feet', async () => {
    await press('Space');
    const plain = await settled(page);
    const inverted = () => page.evaluate(() => getComputedStyle(document.getElementById('picture')).filter);
    assert.equal(await inverted(), 'none');
    await page.keyboard.press('i');
    assert.equal(await inverted(), 'invert(1)');
    assert.ok(await page.isVisible('.inverted-mark'));
    const [download] = await Promise.all([page.waitForEvent('download'), page.click('#save')]);
    const file = Buffer.concat(await (await download.createReadStream()).toArray());
    const saved = await page.evaluate(async (bytes) => {
      const bitmap = await createImageBitmap(new Blob([new Uint8Array(bytes)]));
      const context = new OffscreenCanvas(32, 24).getContext('2d');
      context.drawImage(bitmap, 0, 0, 32, 24);
      return [...context.getImageData(0, 0, 32, 24).data].filter((_, i) => i % 4 !== 3);
    }, [...file]);
    const negative = plain.map((v) => 255 - v);
    assert.ok(difference(saved, negative) < 4, `the saved picture is the one shown: ${difference(saved, negative)}`);
    await toMode('dvr');
    assert.equal(await inverted(), 'none', 'colours are never turned round');
    await press('f');
    assert.equal(await page.textContent('#mark-top'), 'A');
    assert.equal(await page.evaluate(() => document.fullscreenElement), null);
    await page.keyboard.press('Shift+F');
    await page.waitForFunction(() => document.fullscreenElement?.id === 'stage');
    await page.keyboard.press('Shift+F');
    await page.waitForFunction(() => !document.fullscreenElement);
  });

  test('the bindings are shown, changed, kept, clash and come back', async () => {
    await press('Space');
    const chord = (action, n = 0) => page.locator(`[data-action="${action}"] button`).nth(n);
    await page.keyboard.press('?');
    await chord('cine').click();
    await page.keyboard.press('Escape');
    assert.equal(await chord('cine').textContent(), 'C', 'left as it was, and the page still open');
    await chord('view-L').click();
    await page.keyboard.press('x');
    assert.equal(await chord('view-L').textContent(), 'X');
    await chord('cine').focus();
    await page.keyboard.press('Enter');
    await page.keyboard.press('p');
    assert.match(await page.textContent('[data-action="cine"]'), /also: Posterior view/);
    await chord('pan').click();
    await page.mouse.down({ button: 'right' });
    await page.mouse.up({ button: 'right' });
    assert.match(await page.textContent('[data-action="pan"]'), /Right drag/);
    await page.reload();
    await settled(page);
    await page.focus('#stage');
    await press('l');
    assert.equal(await page.textContent('#mark-right'), 'L', 'l is free');
    await press('x');
    assert.equal(await page.textContent('#mark-right'), 'P', 'x shows the left, after a reload too');
    await page.keyboard.press('?');
    await page.click('#bindings-reset');
    assert.equal(await page.locator('#bindings .problem').count(), 0);
    await page.keyboard.press('Escape');
    await press('r');
    assert.equal(await page.textContent('#mark-right'), 'A');
    await press('x');
    assert.equal(await page.textContent('#mark-right'), 'A', 'x is nothing again');
    assert.deepEqual(page.complaints, []);
  });

  test('fingers: zoom and twist where they are, one or three of them scroll slices', async () => {
    const phone = { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true };
    const { page: hand } = await open(browser, `${daemon.url}#head`, phone);
    const box = await stageBox(hand);
    const session = await hand.context().newCDPSession(hand);
    const touch = (type, points) =>
      session.send('Input.dispatchTouchEvent', {
        type,
        touchPoints: points.map(([x, y], id) => ({ x: box.x + x, y: box.y + y, id })),
      });
    const slide = async (from, to, steps = 8) => {
      await touch('touchStart', from);
      for (let i = 1; i <= steps; i++) {
        await touch('touchMove', from.map((p, k) => p.map((x, axis) => x + ((to[k][axis] - x) * i) / steps)));
        await hand.waitForTimeout(10);
      }
      await touch('touchEnd', []);
      await told(hand);
    };
    const [cx, cy] = [box.width * 0.5, box.height * 0.45];
    const fingers = [
      [cx - 40, cy - 20],
      [cx + 30, cy + 25],
    ];
    const under = [await pick(...fingers[0], hand, box), await pick(...fingers[1], hand, box)];
    const first = await camera(hand);
    const seen = (view) => under.map(({ position }) => seenAt(view, position, box));
    const start = seen(first);
    // apart by 1.5 and turned by 40 degrees about a point between them, then moved
    const [c, s] = [1.5 * Math.cos(40 * RADIANS), 1.5 * Math.sin(40 * RADIANS)];
    const map = ([x, y]) => [cx + c * (x - cx) - s * (y - cy) + 12, cy + s * (x - cx) + c * (y - cy) - 8];
    await slide(fingers, fingers.map(map));
    const then = await camera(hand);
    const off = start.map((p, k) => apart(seen(then)[k], map(p)));
    // A surface nearer than the target grows more: what it does is measured at its own depth.
    const depth = under.map(({ position }) => dot(sub(position, first.position), basis(first).direction) / distance(first));
    off.forEach((pixels, k) => assert.ok(pixels < 60 * Math.abs(1 - depth[k]) + 2, `finger ${k} is off by ${pixels} pixels`));
    const turned = Math.acos(dot(basis(first).up, basis(then).up)) / RADIANS;
    assert.ok(Math.abs(turned - 40) < 1, `the twist rolled by ${turned} degrees`);
    assert.ok(Math.abs(distance(first) / distance(then) - 1.5) < 0.02);

    await hand.selectOption('#mode', 'mpr');
    await told(hand);
    const z = async () => (await scene(hand)).mpr.center?.[2] ?? 0;
    const before = await z();
    await slide([[cx, cy]], [[cx, cy + 60]]);
    const one = await z();
    assert.ok(one > before + 5 && Math.abs((one - before) / SPACING - Math.round((one - before) / SPACING)) < 1e-4, `${one - before} mm: whole slices`);
    const three = (dy) => [-50, 0, 50].map((dx) => [cx + dx, cy + dy]);
    await slide(three(0), three(-60));
    assert.ok(Math.abs((await z()) - before) < 2 * SPACING, 'three fingers bring them back');

    const rest = await z();
    await hand.waitForTimeout(400); // longer than a double tap takes: until then Chromium may take the tap for its second
    await hand.tap('#cine');
    await until('a button runs through the slices', async () => (await z()) > rest + 1.5 * SPACING);
    await hand.tap('#cine');
    await told(hand);
    const run = await z();
    await hand.waitForTimeout(200);
    assert.equal(await z(), run, 'and stops');
    await hand.tap('#invert');
    assert.ok(await hand.isVisible('.inverted-mark'));
    await hand.tap('#fullscreen');
    await hand.waitForFunction(() => document.fullscreenElement?.id === 'stage');
    await hand.waitForFunction(() => document.getElementById('fullscreen').ariaPressed === 'true'); // told by an event of its own
    await hand.tap('#fullscreen');
    await hand.waitForFunction(() => !document.fullscreenElement);
    await hand.selectOption('#mode', 'dvr');
    assert.ok(await hand.isHidden('#invert'), 'colours are never turned round');
    assert.deepEqual(hand.complaints, []);
    await hand.close();
  });
});
