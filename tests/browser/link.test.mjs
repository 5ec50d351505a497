// The link between page and server: frames, patches, lost connections and bytes that are none of these.
import assert from 'node:assert/strict';
import { describe, test } from 'node:test';

import { browserMissing } from './chromium.mjs';
import { drag, settled, spread, stageBox, stageData } from './picture.mjs';
import { open, scene, serveFake } from './scenarios.mjs';

const skip = await browserMissing();

describe('link to the server', { skip }, () => {
  let browser;
  let server;
  let url;
  serveFake((made) => ({ browser, server, url } = made));

  for (const manner of ['bytes', 'fragments']) {
    test(`frames that arrive as ${manner} are drawn`, async () => {
      server.manner = manner;
      const { page } = await open(browser, url, { viewport: { width: 700, height: 520 } });
      await page.keyboard.press('p');
      await settled(page);
      assert.deepEqual(page.complaints, []);
      await page.close();
    });
  }

  test('every frame is confirmed, and not before it is drawn', async () => {
    const { page } = await open(browser, url);
    const { cx, cy } = await stageBox(page);
    await drag(page, [cx, cy], [cx + 200, cy], { steps: 40 });
    await settled(page);
    const frames = [...server.acknowledged].sort((a, b) => a - b);
    assert.deepEqual(
      frames,
      frames.map((_, i) => i + 1),
      'each number once, none missing',
    );
    assert.equal(Number((await stageData(page)).frame), frames.at(-1));
    assert.ok(server.mostUnacknowledged <= 2);
    await page.close();
  });

  test('a burst of moves becomes at most one patch per display frame, between pointer start and end', async () => {
    const { page } = await open(browser, url);
    server.patches.length = 0;
    server.phases.length = 0;
    const beats = await page.evaluate(async () => {
      const stage = document.getElementById('stage');
      const at = (type, x) =>
        stage.dispatchEvent(
          new PointerEvent(type, {
            pointerId: 1,
            pointerType: 'pen',
            clientX: 300 + x,
            clientY: 300,
            button: 0,
            bubbles: true,
          }),
        );
      stage.setPointerCapture = () => {};
      at('pointerdown', 0);
      let count = 0;
      for (let x = 0; count < 10; count++) {
        for (let i = 0; i < 50; i++) at('pointermove', (x += 0.2));
        await new Promise(requestAnimationFrame);
      }
      at('pointerup', 0);
      return count;
    });
    await settled(page);
    const moves = server.patches.filter(({ scene: patch }) => patch.camera).length;
    assert.ok(moves > 3 && moves <= beats + 1, `${moves} patches in ${beats} display frames of 50 moves each`);
    assert.deepEqual(server.phases, ['start', 'end']);
    await page.close();
  });

  test('a slow server gets the newest scene in the end', async () => {
    const { page } = await open(browser, url);
    server.delayMs = 300;
    const { cx, cy } = await stageBox(page);
    await drag(page, [cx, cy], [cx + 150, cy + 30], { steps: 60 });
    await page.waitForFunction(
      (seq) => Number(document.getElementById('stage').dataset.seq) >= seq,
      server.patches.at(-1).seq,
    );
    await settled(page);
    const { session } = await stageData(page);
    assert.deepEqual((await scene(page)).camera, server.scene(session).camera);
    await page.keyboard.press('p');
    await settled(page);
    assert.ok(Number(await page.textContent('#stat-rtt')) > 100, 'the round trip of a single edit says how slow it is');
    await page.close();
  });

  test('reconnects to the same session after a lost connection; edits made meanwhile arrive', async () => {
    const { page } = await open(browser, url);
    const { session } = await stageData(page);
    server.dropConnections();
    await page.keyboard.press('p');
    await page.waitForSelector('#stat-link[data-state="waiting"]');
    assert.match(await page.textContent('#banner-text'), /Reconnecting in \d+ s/);
    await page.waitForSelector('#stat-link[data-state="open"]');
    await settled(page);
    assert.ok(await page.isHidden('#banner'));
    assert.equal((await stageData(page)).session, session);
    assert.ok(server.scene(session).camera.position[1] > 0, 'the edit arrived');
    await page.close();
  });

  test('patches that were lost with the connection are sent again', async () => {
    const { page } = await open(browser, url);
    server.deaf = true;
    const arrived = server.patches.length;
    await page.keyboard.press('p');
    while (server.patches.length === arrived) await page.waitForTimeout(20);
    server.deaf = false;
    server.dropConnections();
    await page.waitForSelector('#stat-link[data-state="waiting"]');
    await page.waitForSelector('#stat-link[data-state="open"]');
    await settled(page);
    assert.ok(server.scene((await stageData(page)).session).camera.position[1] > 0);
    await page.close();
  });

  test('a server that was restarted gets the scene back as a new session', async () => {
    const { page } = await open(browser, url);
    const first = (await stageData(page)).session;
    await page.keyboard.press('l');
    await settled(page);
    const { port } = server;
    await server.stop(true);
    await page.waitForSelector('#banner:not([hidden])');
    await page.keyboard.press('+'); // an edit while nobody listens
    await server.start(port);
    await page.click('#banner-retry').catch(() => {}); // it may come back by itself first
    await page.waitForSelector('#stat-link[data-state="open"]');
    const again = await settled(page);
    const second = (await stageData(page)).session;
    assert.notEqual(second, first);
    assert.deepEqual(server.scene(second).camera, (await scene(page)).camera);
    assert.equal(await page.textContent('#mark-right'), 'P');
    assert.ok(spread(again) > 40, 'and there is a picture');
    await page.close();
  });

  test("a refused patch is shown quietly and the daemon's scene comes back", async () => {
    const { page } = await open(browser, url);
    server.refuse = (patch) => patch.sampling && { title: 'Refused', status: 422, detail: 'step: too coarse today' };
    await page.evaluate(() => {
      const slider = document.querySelector('input[data-path="sampling.step"]');
      slider.value = 2;
      slider.dispatchEvent(new Event('input'));
    });
    await page.waitForSelector('.toast.bad');
    assert.match(await page.textContent('.toast.bad'), /too coarse today/);
    await page.waitForFunction(() => document.querySelector('output[data-show="sampling.step"]').textContent === '0.5');
    await page.keyboard.press('p');
    await settled(page);
    await page.close();
  });

  test('a mode the server does not offer: one quiet line, back to the old mode, not offered again', async () => {
    const { page } = await open(browser, url);
    server.refuse = (patch) =>
      patch.mode === 'mesh' && { title: 'Not built in', status: 501, detail: 'mesh is not built in' };
    await page.selectOption('#mode', 'mesh');
    await page.waitForSelector('#mode-line:not([hidden])');
    assert.equal(await page.textContent('#mode-line'), 'mesh is not built in');
    await page.waitForFunction(() => document.getElementById('mode').value === 'dvr');
    assert.ok(await page.evaluate(() => document.querySelector('#mode option[value="mesh"]').disabled));
    assert.equal(await page.locator('.toast').count(), 0);
    await page.selectOption('#mode', 'mip');
    assert.ok(await page.isHidden('#mode-line'));
    assert.ok(await page.isVisible('#window-preset'));
    await page.close();
  });

  test('garbage on the wire costs nothing but a message', async () => {
    const { page } = await open(browser, url);
    server.sendGarbage();
    await page.waitForSelector('.toast.bad');
    await page.keyboard.press('p');
    await settled(page);
    assert.equal(await page.getAttribute('#stat-link', 'data-state'), 'open');
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test("somebody else's edit reaches the controls", async () => {
    const { page } = await open(browser, url);
    await page.waitForTimeout(1100);
    server.editFromOutside((await stageData(page)).session, { image: { background: [1, 1, 1] } });
    await page.waitForFunction(() => document.getElementById('background').value === '1,1,1');
    await page.close();
  });

  test('PNG frames are drawn and called lossless, JPEG frames lossy', async () => {
    const { page } = await open(browser, url);
    assert.match(await page.textContent('#badge'), /LOSSY q85 \u00b7 \d+:1/);
    await page.selectOption('select[data-path="image.format"]', 'png');
    await settled(page);
    assert.equal(await page.textContent('#badge'), 'LOSSLESS');
    assert.match(await page.textContent('.disclaimer'), /not for diagnostic use/i);
    await page.close();
  });

  test('everything comes from the one server', async () => {
    const page = await browser.page();
    const hosts = new Set();
    page.on('request', (request) => request.url().startsWith('http') && hosts.add(new URL(request.url()).host));
    await page.goto(url);
    await settled(page);
    assert.deepEqual([...hosts], [new URL(url).host]);
    await page.close();
  });
});
