// What the page costs before its first picture, and what that picture is, with the real daemon.
import assert from 'node:assert/strict';
import { describe, test } from 'node:test';

import { patient } from '../support/patient.mjs';
import { browserMissing } from './chromium.mjs';
import { daemonMissing } from './daemon.mjs';
import { difference, settled } from './picture.mjs';
import { open, scene, serve } from './scenarios.mjs';

const LINK = { offline: false, latency: 200, downloadThroughput: 125000, uploadThroughput: 125000 };
const KIB = 1024;

/** Counts what comes until a picture of this document is drawn. @returns {{bytes, requests, ms}} */
async function cost(page, go) {
  const network = await page.context().newCDPSession(page);
  const spent = { bytes: 0, requests: 0, pictures: 0, names: [] };
  await network.send('Network.enable');
  await network.send('Network.emulateNetworkConditions', LINK);
  network.on('Network.requestWillBeSent', ({ request }) => {
    spent.requests += 1;
    spent.names.push(new URL(request.url).pathname);
  });
  network.on('Network.webSocketCreated', () => (spent.requests += 1));
  network.on('Network.loadingFinished', ({ encodedDataLength }) => (spent.bytes += encodedDataLength));
  network.on('Network.webSocketFrameReceived', ({ response: { opcode, payloadData } }) => {
    const first = opcode === 2 && !spent.pictures++; // a slow page may be sent another before it has drawn one
    if (opcode !== 2 || first) spent.bytes += (opcode === 2 ? 0.75 : 1) * payloadData.length;
  });
  const from = Date.now();
  await go();
  await page.waitForFunction(() => document.getElementById('stage').dataset.frame, null, { polling: 20, timeout: 60000 });
  const shown = { ...spent, ms: Date.now() - from };
  await network.detach();
  return shown;
}

describe('before the first picture', { skip: (await browserMissing()) || daemonMissing() }, () => {
  let browser;
  let daemon;
  serve({ head: 'demo:head' }, '', (made) => ({ browser, daemon } = made));

  test('little is sent, in few requests, and less the second time', async (t) => {
    const page = await browser.page();
    for (const end = Date.now() + 60000; Date.now() < end; ) {
      if ((await (await fetch(`${daemon.url}v1/volumes/head`)).json()).state === 'resident') break;
    }
    const first = await cost(page, () => page.goto(`${daemon.url}#head`, { waitUntil: 'commit' }));
    const second = await cost(page, () => page.reload({ waitUntil: 'commit' }));
    for (const [name, { bytes, requests, ms }] of Object.entries({ first, second })) {
      t.diagnostic(`${name}: ${(bytes / KIB).toFixed(0)} KiB, ${requests} requests, ${ms} ms on 1 Mbit/s and 200 ms`);
    }
    assert.ok(first.bytes <= 120 * KIB, `${first.bytes} bytes`);
    assert.ok(first.requests <= 12, first.names.join(' '));
    assert.ok(second.bytes < first.bytes - 30 * KIB, 'what was loaded is kept');
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test('a volume has its thumbnail once it is drawn, before anybody lists it', async () => {
    const page = await browser.page();
    const asked = page.waitForResponse(/v1\/volumes\/head\/thumbnail$/);
    await page.goto(`${daemon.url}#head`);
    assert.equal((await asked).status(), 200);
    assert.ok(await page.isHidden('#volume-dialog'));
    await page.close();
  });

  test('a projection opens with a window of its own, the minimum as a slab, and both go again', async () => {
    const { page } = await open(browser, `${daemon.url}#head`);
    const before = await scene(page);
    const { display } = await (await fetch(`${daemon.url}v1/volumes/head`)).json();
    for (const mode of ['mip', 'minip', 'average']) {
      await page.selectOption('#mode', mode);
      const { window, clip } = await scene(page);
      assert.deepEqual(window, display.windows[mode], mode);
      assert.equal(clip?.planes?.length ?? 0, mode === 'minip' ? 2 : 0, mode);
    }
    await page.selectOption('#mode', 'dvr');
    const after = await scene(page);
    assert.deepEqual([after.window, after.clip?.planes ?? []], [before.window, before.clip?.planes ?? []]);
    await page.close();
  });

  test('a preset brings its light, fitted to the volume', async () => {
    const { page } = await open(browser, `${daemon.url}#head`);
    const { display } = await (await fetch(`${daemon.url}v1/volumes/head`)).json();
    assert.equal((await scene(page)).shading.model, 'blinn-phong');
    await page.selectOption('#preset', 'mr-default');
    assert.equal((await scene(page)).shading.model, 'none');
    await page.selectOption('#preset', 'ct-bone');
    const { shading, transferFunction } = await scene(page);
    assert.deepEqual([shading.model, shading.gradient], ['blinn-phong', 'central']);
    assert.equal(transferFunction.unitDistance, display.unitDistance);
    await page.close();
  });

  test('the table is one click away, and volumes are listed with their pictures', async () => {
    const page = await browser.page();
    await page.goto(`${daemon.url}#head`);
    await page.setInputFiles('#upload', { name: 'patient.nrrd', mimeType: '', buffer: patient(2) });
    await page.waitForFunction(() => document.getElementById('volume-name').textContent === 'upload-1', null, { timeout: 60000 });
    await settled(page);
    assert.equal((await scene(page)).hideTable, true);
    await page.click('button[data-view="P"]');
    const hidden = await settled(page);
    await page.click('#hide-table');
    assert.equal((await scene(page)).hideTable, false);
    assert.ok(difference(hidden, await settled(page)) > 1, 'the table is seen from behind');
    await page.click('#volume-open');
    await page.waitForFunction(() => {
      const pictures = [...document.querySelectorAll('.volume-item .thumbnail')];
      return pictures.length >= 2 && pictures.every((picture) => picture.naturalWidth === 128);
    });
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test('a volume and meshes chosen together are opened one by one, and of what fails the user is told', async () => {
    const page = await browser.page();
    await page.goto(`${daemon.url}#head`);
    const file = (name, buffer) => ({ name, mimeType: '', buffer: Buffer.from(buffer) });
    const corners = 'v 0 0 0\nv 20 0 0\nv 0 20 0\nv 0 0 20\n';
    const mesh = `${corners}f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n`;
    const files = [file('stent.obj', mesh), file('broken.ply', 'ply\n'), file('a.nrrd', patient(3)), file('pin.obj', mesh)];
    await page.setInputFiles('#upload', files);
    await page.waitForFunction(() => document.querySelectorAll('#surfaces-list li').length === 2, null, { timeout: 60000 });
    const shown = await scene(page);
    assert.deepEqual([shown.mode, shown.mesh.surfaces.length], ['mesh', 2]);
    assert.equal(await page.textContent('#surfaces-list li button'), 'Shown');
    assert.match(await page.textContent('#toasts'), /broken\.ply/);
    await page.close();
  });
});
