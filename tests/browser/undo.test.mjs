// Undo and redo, modes and menus on the page of the real daemon (TC_BINARY): everything that changes the scene is a step.
import assert from 'node:assert/strict';
import { describe, test } from 'node:test';

import { browserMissing } from './chromium.mjs';
import { daemonMissing } from './daemon.mjs';
import { drag, settled, stageBox, stageData } from './picture.mjs';
import { scene, serve } from './scenarios.mjs';

const skip = daemonMissing() || (await browserMissing());

describe('undo', { skip }, () => {
  let daemon;
  let page;
  serve({ head: 'demo:head', parts: 'demo:head-labels' }, 'head', (made) => ({ daemon, page } = made));

  /** What the daemon holds, once it has every edit. */
  const served = async () => {
    await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
    await page.waitForFunction(() => document.getElementById('stage').dataset.pending === '0', null, {
      timeout: 60000,
    });
    const { session } = await stageData(page);
    return (await fetch(`${daemon.url}v1/sessions/${session}/scene`)).json();
  };
  const slide = async (slider, share) => {
    await slider.scrollIntoViewIfNeeded();
    const box = await slider.boundingBox();
    const y = box.y + box.height / 2;
    await drag(page, [box.x + box.width * 0.5, y], [box.x + box.width * share, y], { steps: 5 });
  };

  test('each gesture is one step: camera, crop, look, labels, mode, window, slices', async () => {
    const { cx, cy } = await stageBox(page);
    assert.ok(await page.isDisabled('#undo'), 'opening a volume is no step');
    const edits = {
      orbit: () => drag(page, [cx, cy], [cx + 90, cy - 40]),
      wheel: async () => {
        await page.mouse.move(cx + 50, cy);
        await Promise.all([1, 2, 3].map(() => page.mouse.wheel(0, -120))); // together: with pauses between them they are several gestures
        await page.waitForTimeout(600); // the wheel rests
      },
      view: () => page.locator('#stage').press('l'),
      crop: () => slide(page.locator('#crop input').nth(3), 0.4),
      preset: async () => {
        const names = await page.evaluate(() =>
          [...document.getElementById('preset').options].map(({ value }) => value),
        );
        const now = await page.inputValue('#preset');
        await page.selectOption(
          '#preset',
          names.find((name) => name && name !== now),
        );
      },
      density: () => slide(page.locator('#density'), 0.65),
      shading: () => page.selectOption('[data-path="shading.model"]', 'gooch'),
      labels: async () => {
        await page.selectOption('#labels-volume', 'parts');
        await page.waitForSelector('#labels-list button');
      },
      mode: () => page.selectOption('#mode', 'mip'),
      window: () => slide(page.locator('input[type="range"][data-path="window.center"]'), 0.7),
      typed: async () => {
        await page.fill('input[type="number"][data-path="window.width"]', '321');
        await page.keyboard.press('Tab');
      },
      slices: () => page.selectOption('#mode', 'mpr'),
      scroll: async () => {
        await page.locator('#stage').press('PageDown');
        await page.waitForTimeout(250);
      },
    };
    const scenes = [await served()];
    for (const [name, edit] of Object.entries(edits)) {
      await edit();
      scenes.push(await served());
      assert.notDeepEqual(scenes.at(-1), scenes.at(-2), `${name} changes the scene`);
    }
    await page.focus('#stage');
    const names = Object.keys(edits);
    for (let i = names.length; i-- > 0;) {
      if (i % 2) await page.keyboard.press('Control+z');
      else await page.click('#undo');
      assert.deepEqual(await served(), scenes[i], `${names[i]} is taken back whole`);
    }
    assert.ok(await page.isDisabled('#undo'));
    for (let i = 0; i < names.length; i++) {
      await page.keyboard.press(i % 2 ? 'Control+Shift+z' : 'Control+y');
      assert.deepEqual(await served(), scenes[i + 1], `${names[i]} is done again`);
    }
    assert.ok(await page.isDisabled('#redo'));
  });

  for (const kind of ['isosurface', 'mesh'])
    test(`a surface as ${kind} is lit and exact, follows its slider, and leaves the look as it was`, async () => {
      await page.selectOption('#mode', 'dvr');
      await page.selectOption('[data-path="shading.model"]', 'none');
      await page.selectOption('[data-path="filter"]', 'cubic');
      await page.selectOption('#labels-volume', '');
      const { mode, ...before } = await served();
      await page.selectOption('#mode', kind);
      const surface = await served();
      assert.deepEqual([surface.shading.model, surface.filter], ['blinn-phong', 'linear']);
      await settled(page);
      const normals = page.locator('[data-path="shading.gradient"]');
      assert.equal(await normals.isVisible(), kind === 'isosurface', 'a mesh has normals of its own');
      const label = await page.textContent('#label');
      assert.match(label, /Surface at /);
      assert.doesNotMatch(label, /C -?\d.* W /);
      await slide(page.locator('input[type=range][data-path="isosurface.value"]'), 0.7);
      assert.ok((await served()).isosurface.value > surface.isosurface.value);
      await settled(page);
      assert.notEqual(await page.textContent('#label'), label);
      await page.keyboard.press('Control+z');
      await page.selectOption('#mode', 'dvr');
      const { mode: again, ...after } = await served();
      assert.deepEqual(after, before);
      assert.equal(again, mode);
    });

  test('view keys work with a menu in focus, and all keys after a choice by hand', async () => {
    await page.selectOption('#mode', 'dvr');
    await page.focus('#mode');
    await page.keyboard.press('p');
    assert.ok((await served()).camera.position[1] > 100, 'posterior');
    await page.keyboard.press('a');
    const view = await served();
    assert.equal(view.mode, 'dvr', 'A is no option');
    assert.ok(view.camera.position[1] < -100, 'anterior');
    await page.click('#mode');
    await page.keyboard.press('ArrowDown');
    await page.keyboard.press('Enter');
    assert.equal((await served()).mode, 'mip');
    assert.equal(await page.evaluate(() => document.activeElement.id), 'stage');
    await page.keyboard.press('ArrowLeft');
    const turned = await served();
    assert.equal(turned.mode, 'mip', 'arrows are the picture again');
    assert.notDeepEqual(turned.camera, view.camera);
  });
});
