// Segments by name, on and off with what they share; series of a folder as a radiologist knows them.
import assert from 'node:assert/strict';
import { mkdirSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, describe, test } from 'node:test';

import { familyOf } from '../../web/labels.js';
import { choicesOf, seriesText } from '../../web/volumes.js';
import { dicomSlice } from '../support/dicom.mjs';
import { browserMissing, launch } from './chromium.mjs';
import { daemonMissing, startDaemon } from './daemon.mjs';
import { open, scene } from './scenarios.mjs';

const skip = daemonMissing() || (await browserMissing());
const N = 12;

const nrrd = (head, voxel, layers = 1) =>
  Buffer.concat([
    Buffer.from(`NRRD0004\ntype: uint8\nspace: left-posterior-superior\nencoding: raw\n${head}\n`),
    Buffer.from(Array.from({ length: layers * N ** 3 }, (_, i) => voxel(Math.floor(i / layers) % N, i % layers))),
  ]);
const grey = nrrd(`dimension: 3\nsizes: ${N} ${N} ${N}\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n`, (x) => 100 + x);
const layered = nrrd(
  `dimension: 4\nsizes: 2 ${N} ${N} ${N}\nkinds: list domain domain domain\nspace directions: none (1,0,0) (0,1,0) (0,0,1)\n` +
    'Segment0_Name:=liver\nSegment0_Color:=1 0 0\nSegment0_LabelValue:=1\nSegment0_Layer:=0\n' +
    'Segment1_Name:=tumour\nSegment1_Color:=0 1 0\nSegment1_LabelValue:=1\nSegment1_Layer:=1\n',
  (x, layer) => Number(layer ? x >= 4 && x < 10 : x < 6),
  2,
);

test('a series reads as a radiologist knows it; each of its volumes can be had', () => {
  const one = {
    number: 2,
    label: 'series 4',
    description: 'Thorax 1.0',
    modality: 'CT',
    frames: 131,
    time: '14:03:22',
  };
  assert.equal(seriesText(one), 'Thorax 1.0 \u00b7 CT \u00b7 131 images \u00b7 14:03:22');
  assert.equal(
    seriesText({ ...one, description: undefined, time: undefined, frames: 1 }),
    'series 4 \u00b7 CT \u00b7 1 image',
  );
  const volumes = [1, 2].map((number) => ({ number, slices: 20, what: `echo time ${10 * number} ms` }));
  const found = choicesOf({ id: 'study', path: 'a/study' }, [
    { ...one, volumes },
    { ...one, number: 3, volumes: [volumes[0]] },
  ]);
  assert.deepEqual(
    found.map(({ id }) => id),
    ['study-2-1', 'study-2-2', 'study-3'],
  );
  assert.deepEqual(
    found.map(({ path }) => path),
    ['a/study#2#volume=1', 'a/study#2#volume=2', 'a/study#3'],
  );
  assert.match(found[1].text, /20 slices \u00b7 echo time 20 ms$/);
  assert.deepEqual(familyOf([{ label: 1 }, { label: 4, of: [1, 2] }, { label: 5, of: [2, 3] }], 1), [1, 4]);
});

describe('segments and series on the page', { skip }, () => {
  let browser, daemon, page;
  const folder = skip ? '' : mkdtempSync(join(tmpdir(), 'tomocast-test-'));

  before(async () => {
    writeFileSync(join(folder, 'grey.nrrd'), grey);
    writeFileSync(join(folder, 'parts.nrrd'), layered);
    mkdirSync(join(folder, 'study'));
    for (const [number, description] of [
      [1, 'Thorax'],
      [2, 'Abdomen'],
    ])
      for (const z of [0, 1, 2])
        writeFileSync(
          join(folder, 'study', `IM${number}${z}`),
          dicomSlice(8, z, { series: `1.2.3.${number}`, number, description, time: '140322' }),
        );
    browser = await launch();
    daemon = await startDaemon([
      '--data',
      folder,
      '--volume',
      `grey=${join(folder, 'grey.nrrd')}`,
      '--volume',
      `parts=${join(folder, 'parts.nrrd')}`,
    ]);
    ({ page } = await open(browser, `${daemon.url}#grey`));
  });
  after(async () => {
    await browser?.close();
    await daemon?.stop();
    rmSync(folder, { recursive: true, force: true });
    assert.deepEqual(page?.complaints ?? [], []);
  });

  test("rows have the segments' names and colours; what two share shows while one of them does", async () => {
    await page.selectOption('#labels-volume', 'parts');
    await page.locator('#labels-list li').nth(2).waitFor();
    assert.deepEqual(await page.locator('#labels-list li > span:nth-child(2)').allTextContents(), [
      'No label',
      'liver',
      'tumour',
    ]);
    assert.equal(await page.getByLabel('Colour of liver').inputValue(), '#ff0000');
    const visible = async () => (await scene(page)).labels.visible ?? null;
    await page.getByRole('button', { name: 'Show liver' }).click();
    assert.deepEqual(await visible(), [0, 2, 3]);
    await page.getByRole('button', { name: 'Show tumour' }).click();
    assert.deepEqual(await visible(), [0]);
    await page.getByRole('button', { name: 'Show liver' }).click();
    assert.deepEqual(await visible(), [0, 1, 3]);
  });

  test('a folder of several series lets one choose', async () => {
    await page.click('#volume-open');
    await page.click('.volume-item[data-id="study"]');
    await page.getByText('Abdomen \u00b7 CT \u00b7 3 images \u00b7 14:03:22').waitFor();
    assert.equal(await page.locator('.volume-item').count(), 2);
    await page.getByText('Abdomen').click();
    await page.waitForFunction(() => document.getElementById('volume-name').textContent === 'study-2');
    assert.match(await page.textContent('#facts'), /Abdomen/);
  });
});
