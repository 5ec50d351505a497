// Volumes of a file in time on the page of the real daemon (TC_BINARY): slider, keys and cine, with camera and look kept.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, describe, test } from 'node:test';

import { browserMissing } from './chromium.mjs';
import { daemonMissing } from './daemon.mjs';
import { difference, settled, stageData } from './picture.mjs';
import { scene, serve } from './scenarios.mjs';
import { Sequence } from '../../web/sequence.js';

const skip = daemonMissing() || (await browserMissing());
const [SIDE, TIMES] = [24, 6];

/** A ball that beats: NIfTI-1, i16, 24 voxels of 2 mm a side, six times. */
function beating() {
  const head = Buffer.alloc(352);
  head.writeInt32LE(348, 0);
  [4, SIDE, SIDE, SIDE, TIMES, 1, 1, 1].forEach((n, i) => head.writeInt16LE(n, 40 + 2 * i));
  [1, 2, 2, 2, 0.1].forEach((x, i) => head.writeFloatLE(x, 76 + 4 * i));
  head.writeInt16LE(4, 70);
  head.writeInt16LE(16, 72);
  head.writeFloatLE(352, 108);
  head.write('n+1\0', 344);
  const voxels = Buffer.alloc(SIDE ** 3 * TIMES * 2);
  for (let t = 0; t < TIMES; t++)
    for (let i = 0; i < SIDE ** 3; i++) {
      const middle = (SIDE - 1) / 2;
      const away = Math.hypot(
        (i % SIDE) - middle,
        (Math.floor(i / SIDE) % SIDE) - middle,
        Math.floor(i / SIDE ** 2) - middle,
      );
      voxels.writeInt16LE(away < 4 + t ? 1000 : 0, 2 * (t * SIDE ** 3 + i));
    }
  return Buffer.concat([head, voxels]);
}

/** Waits for what must come, and then sees that no more comes: turns of the event loop, not time, pass between. */
async function comesTo(list, wanted) {
  for (const end = Date.now() + 20000; list.length < wanted.length && Date.now() < end;)
    await new Promise((done) => setTimeout(done, 5));
  for (let turn = 0; turn < 20; turn++) await new Promise((done) => setTimeout(done, 0));
  assert.deepEqual(list, wanted);
}

test('a cine asks for one volume ahead of the picture, and for no more', async (t) => {
  const elements = {};
  const get = (id) => (elements[id] ??= { value: id === 'rate' ? '1000' : '1', addEventListener() {} });
  const volumes = [1, 2, 3, 4].map((volume) => ({
    id: `v.${volume}`,
    volume,
    frames: 4,
    state: 'resident',
    dims: [1, 1, 1],
  }));
  for (const volume of volumes) volume.volumes = volumes;
  const asked = [];
  const of = (id) => volumes.find((volume) => volume.id === id);
  const sequence = new Sequence(get, {
    volumes: { get: async (id) => of(id), wait: async (id) => of(id) },
    client: { show: async (id) => asked.push(id) },
    on: { shown() {}, problem: assert.fail, note: assert.fail },
  });
  t.after(() => sequence.stop());
  sequence.setVolume(volumes[0]);
  sequence.toggle();
  await comesTo(asked, ['v.2', 'v.3']); // the second waits in the daemon while the first is drawn
  await sequence.frame({ volume: 'v.1' }); // an old picture confirms nothing
  await comesTo(asked, ['v.2', 'v.3']);
  await sequence.frame({ volume: 'v.2' });
  await comesTo(asked, ['v.2', 'v.3', 'v.4']);
  await sequence.frame({ volume: 'v.4' }); // v.3 was passed over
  await comesTo(asked, ['v.2', 'v.3', 'v.4', 'v.1', 'v.2']);
});

describe('volumes in time', { skip }, () => {
  const folder = mkdtempSync(join(tmpdir(), 'tomocast-time-'));
  writeFileSync(join(folder, 'heart.nii'), beating());
  after(() => rmSync(folder, { recursive: true }));
  let page;
  serve({ heart: join(folder, 'heart.nii') }, 'heart', (made) => ({ page } = made));

  const says = (words) =>
    page.waitForFunction((text) => document.getElementById('label').textContent.includes(text), words, {
      timeout: 60000,
    });

  test('a slider chooses the volume; camera and look stay', async () => {
    const first = await settled(page);
    await says(`Volume 1 of ${TIMES}`);
    await page.keyboard.press('L');
    await page.selectOption('#mode', 'mip');
    await settled(page);
    const before = await scene(page);
    await page.locator('#time').fill('6');
    await says(`Volume 6 of ${TIMES}`);
    const last = await settled(page);
    assert.ok(difference(first, last) > 1, 'a larger ball');
    assert.deepEqual(await scene(page), before);
    assert.equal(await page.textContent('#time-text'), `6 / ${TIMES}`);
    assert.match(await page.textContent('#facts'), /6 of 6/);
    assert.match(await page.textContent('#label'), /^heart\n/);
    await page.focus('#stage');
    await page.keyboard.press('.'); // round to the first
    await says('Volume 1 of');
    await page.keyboard.press(',');
    await says('Volume 6 of');
  });

  test('a cine plays them round, the key pauses it', async () => {
    await page.selectOption('#rate', '30');
    await page.focus('#stage');
    await page.keyboard.press('t');
    const seen = new Set();
    const all = async () => {
      seen.add((await page.textContent('#label')).match(/Volume (\d) of/)?.[1]);
      return seen.size === TIMES;
    };
    for (const end = Date.now() + 60000; !(await all()) && Date.now() < end;);
    assert.equal(seen.size, TIMES, [...seen].join());
    assert.equal(await page.getAttribute('#play', 'aria-pressed'), 'true');
    await page.keyboard.press('t');
    assert.equal(await page.getAttribute('#play', 'aria-pressed'), 'false');
    await settled(page);
    const { frame } = await stageData(page);
    await page.waitForTimeout(300);
    assert.equal((await stageData(page)).frame, frame, 'nothing moves any more');
    if (process.env.TC_SCREENSHOT) await page.screenshot({ path: process.env.TC_SCREENSHOT });
  });

  test('the list names the file once', async () => {
    await page.click('#volume-open');
    const items = page.locator('.volume-item .name', { hasText: /^heart/ });
    await items.first().waitFor();
    assert.deepEqual(await items.allTextContents(), ['heart']);
    assert.equal(await page.locator('.volume-item[aria-current="true"] .name').textContent(), 'heart');
    await page.keyboard.press('Escape');
  });
});
