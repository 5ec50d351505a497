// A run-length model in the page: shown as splats, coloured by its attributes, and no mode is offered that wants a grid.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, describe, test } from 'node:test';

import { browserMissing } from './chromium.mjs';
import { daemonMissing } from './daemon.mjs';
import { difference, settled } from './picture.mjs';
import { serve } from './scenarios.mjs';

const MISSING = (await browserMissing()) || daemonMissing();

describe('a run-length model', { skip: MISSING }, () => {
  const folder = mkdtempSync(join(tmpdir(), 'tomocast-model-'));
  const path = join(folder, 'bucky.vmd');
  const attributes = ['--threshold', '80,255', '--attributes', 'value,normal,user'];
  if (!MISSING) execFileSync(process.env.TC_BINARY, ['convert', 'demo:bucky', path, ...attributes]);
  let page;
  serve({ bucky: path }, 'bucky', (made) => ({ page } = made));
  after(() => rmSync(folder, { recursive: true }));

  test('is shown, and its values choose colours', async () => {
    const offered = (path) =>
      page.$$eval(`[data-path="${path}"] option`, (options) => options.filter((o) => !o.hidden).map((o) => o.value));
    assert.deepEqual(await offered('mode'), ['splat']);
    assert.deepEqual(await offered('splat.attribute'), ['color', 'value', 'normal', 'user']);
    const plain = await settled(page);
    await page.selectOption('[data-path="splat.attribute"]', 'value');
    assert.ok(difference(plain, await settled(page)) > 1.5, 'colours are those of the transfer function');
    await page.click('#undo');
    await page.waitForFunction(() => document.querySelector('[data-path="splat.attribute"]').value === 'color');
  });
});
