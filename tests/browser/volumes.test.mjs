// Volumes on the page: chosen, uploaded, dropped, and kept by a reload.
import assert from 'node:assert/strict';
import { describe, test } from 'node:test';

import { browserMissing } from './chromium.mjs';
import { difference, settled, spread, thumbnail } from './picture.mjs';
import { open, serveFake } from './scenarios.mjs';

const skip = await browserMissing();

describe('volumes of the page', { skip }, () => {
  let browser;
  let server;
  let url;
  serveFake((made) => ({ browser, server, url } = made));

  test("the old volume is never seen under the new one's name", async () => {
    const { page } = await open(browser, url);
    server.mute = true;
    await page.click('#volume-open');
    await page.click('.volume-item[data-id="second"]');
    await page.waitForFunction(() => document.getElementById('volume-name').textContent === 'second');
    assert.equal(spread(await thumbnail(page)), 0, 'nothing is shown before the first frame');
    assert.ok(await page.isHidden('#badge'));
    await page.close();
  });

  test('the volume picker shows what there is, loads what is not resident, and the address keeps it', async () => {
    const { page } = await open(browser, url);
    await page.click('#volume-open');
    await page.click('.volume-item[data-id="second"]');
    await page.waitForSelector('#loading:not([hidden])');
    await page.waitForFunction(() => location.hash === '#second');
    await settled(page);
    assert.equal(await page.textContent('#volume-name'), 'second');
    assert.ok(await page.isHidden('#loading'));
    await page.reload();
    await settled(page);
    assert.equal(await page.textContent('#volume-name'), 'second');
    assert.equal(server.sessions.length, 1, 'the old sessions were ended');
    await page.close();
  });

  test('a reload keeps the scene', async () => {
    const { page } = await open(browser, url);
    await page.keyboard.press('l');
    const picture = await settled(page);
    await page.reload();
    assert.ok(difference(picture, await settled(page)) < 1);
    assert.equal(await page.textContent('#mark-right'), 'P');
    await page.close();
  });

  test('uploads a file under a neutral name; a refused one is explained', async () => {
    const { page } = await open(browser, url);
    const file = (text) => ({ name: 'DOE^JANE.nrrd', mimeType: 'application/octet-stream', buffer: Buffer.from(text) });
    await page.setInputFiles('#upload', file('NRRD0004 and so on'));
    await page.waitForFunction(() => location.hash === '#upload-1');
    await settled(page);
    await page.setInputFiles('#upload', file('not a volume'));
    await page.waitForSelector('.toast.bad');
    assert.match(await page.textContent('.toast.bad'), /no volume file/);
    assert.equal(await page.textContent('#volume-name'), 'upload-1', 'the old volume stays');
    await page.close();
  });

  test('several files go as one zip without their names', async () => {
    const { page } = await open(browser, url);
    const files = ['JANE_DOE_1.dcm', 'JANE_DOE_2.dcm'].map((name, i) => ({
      name,
      mimeType: '',
      buffer: Buffer.alloc(5000, i + 65),
    }));
    await page.setInputFiles('#upload', files);
    await page.waitForFunction(() => location.hash === '#upload-1');
    const [body] = server.uploads;
    assert.equal(body.includes('JANE'), false);
    assert.ok(body.includes('A'.repeat(5000)) && body.includes('B'.repeat(5000)));
    await page.close();
  });

  test('a dropped file is uploaded', async () => {
    const { page } = await open(browser, url);
    await page.evaluate(() => {
      const data = new DataTransfer();
      data.items.add(new File(['NRRD0004 and so on'], 'x.nrrd'));
      const event = (type) => new DragEvent(type, { dataTransfer: data, bubbles: true, cancelable: true });
      const stage = document.getElementById('stage');
      stage.dispatchEvent(event('dragenter'));
      window.hinted = !document.getElementById('drop').hidden;
      window.allowed = !stage.dispatchEvent(event('dragover'));
      stage.dispatchEvent(event('drop'));
    });
    await page.waitForFunction(() => location.hash === '#upload-1');
    assert.deepEqual(await page.evaluate(() => [window.hinted, window.allowed]), [true, true]);
    assert.ok(await page.isHidden('#drop'));
    await page.close();
  });

  test('an upload can be cancelled', async () => {
    const { page } = await open(browser, url);
    await page.route('**/v1/volumes/upload-1', () => {}); // never answered
    await page.setInputFiles('#upload', { name: 'x.nrrd', mimeType: '', buffer: Buffer.alloc(1000) });
    await page.click('#loading-cancel');
    await page.waitForSelector('.toast');
    assert.match(await page.textContent('.toast'), /cancelled/);
    assert.ok(await page.isHidden('#loading'));
    await page.close();
  });
});
