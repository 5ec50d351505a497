// Tokens and links in a real browser against the real daemon (TC_BINARY).
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, describe, test } from 'node:test';

import { browserMissing, launch } from './chromium.mjs';
import { daemonMissing, startDaemon } from './daemon.mjs';
import { settled, spread, stageData } from './picture.mjs';
import { linkOf, scene } from './scenarios.mjs';

const skip = daemonMissing() || (await browserMissing());
const TOKEN = 'ann-in-a-browser-0123456789';
const PICTURE = process.env.TC_PICTURES; // a folder for screenshots, to look at

describe('page and a daemon with tokens', { skip }, () => {
  let browser;
  let daemon;
  let folder;
  before(async () => {
    folder = mkdtempSync(join(tmpdir(), 'tomocast-tokens-'));
    writeFileSync(join(folder, 'tokens'), `ann edit ${TOKEN}\n`, { mode: 0o600 });
    browser = await launch();
    daemon = await startDaemon(['--volume', 'head=demo:head', '--token-file', join(folder, 'tokens')]);
  });
  after(async () => {
    await browser?.close();
    await daemon?.stop();
    rmSync(folder, { recursive: true, force: true });
  });

  /** A page and every address it asks for. */
  async function visit(url, options) {
    const page = await browser.page(options);
    page.asked = [];
    page.on('request', (request) => page.asked.push(request.url()));
    page.on('websocket', (socket) => page.asked.push(socket.url()));
    await page.goto(url);
    return page;
  }

  async function enter(page) {
    await page.waitForSelector('#token-dialog[open]');
    await page.fill('#token', TOKEN);
    await page.keyboard.press('Enter');
    assert.ok(spread(await settled(page)) > 40);
  }

  test('the page asks for the token once, says when it is wrong, and keeps it out of addresses', async () => {
    const page = await visit(`${daemon.url}#head`);
    await page.waitForSelector('#token-dialog[open]');
    assert.equal(await page.evaluate(() => document.activeElement.id), 'token');
    assert.equal(await page.getByRole('dialog', { name: 'Access token' }).count(), 1);
    assert.equal(await page.getByLabel('Token', { exact: true }).getAttribute('type'), 'password');
    assert.ok(await page.isHidden('#token-problem'));
    await page.fill('#token', 'not-the-token-0123456789');
    await page.click('#token-use');
    await page.waitForSelector('#token-problem:not([hidden])');
    if (PICTURE) await page.screenshot({ path: join(PICTURE, 'token.png') });
    assert.equal(await page.inputValue('#token'), '', 'the wrong one is not kept');
    await enter(page);
    assert.ok(await page.isHidden('#token-dialog'));
    await page.reload();
    assert.ok(spread(await settled(page)) > 40);
    assert.ok(await page.isHidden('#token-dialog'), 'not asked again in this tab');
    assert.equal(new URL(page.url()).hash, '#head');
    for (const url of page.asked) assert.ok(!url.includes(TOKEN), url);
    const streams = page.asked.filter((url) => url.startsWith('ws'));
    assert.ok(streams.length >= 2 && streams.every((url) => /\/stream\?ticket=[0-9a-f]{32}$/.test(url)), streams.join());
    assert.equal(new Set(streams).size, streams.length, 'a ticket for each');
    assert.deepEqual(page.complaints, []);
    await page.close();
  });

  test('who turns away is told, and asked again', async () => {
    const page = await visit(`${daemon.url}#head`);
    await page.waitForSelector('#token-dialog[open]');
    await page.keyboard.press('Escape');
    await page.waitForSelector('#empty:not([hidden])');
    assert.match(await page.textContent('#empty'), /token/);
    await page.reload();
    await enter(page);
    await page.close();
  });

  for (const role of ['edit', 'view']) {
    test(`a link to ${role} opens the session in a browser without a token`, async () => {
      const owner = await visit(`${daemon.url}#head`);
      await enter(owner);
      const { session } = await stageData(owner);
      const link = await linkOf(owner, role);
      assert.match(link, new RegExp(`/#share=${session}\\.${role}\\.\\d+\\.[0-9a-f]{64}&head&mode=dvr&camera`));
      const guest = await visit(link);
      assert.ok(spread(await settled(guest)) > 40);
      assert.equal((await stageData(guest)).session, session);
      assert.ok(await guest.isHidden('#token-dialog'));
      const secret = link.split('=')[1].split('&')[0];
      assert.ok(!guest.url().includes('share') && !guest.url().includes(secret), 'the link leaves the address bar');
      for (const url of guest.asked.slice(1)) assert.ok(!url.split('#')[0].includes(secret), url);
      const { camera } = await scene(owner);
      await guest.focus('#stage');
      await guest.keyboard.press('p');
      if (role === 'edit') {
        await owner.waitForFunction(() => document.getElementById('mark-right').textContent === 'R', null, { timeout: 20000 });
      } else {
        await guest.waitForFunction(() => document.getElementById('mark-right').textContent === 'L', null, { timeout: 20000 });
        assert.match(await guest.textContent('#mode-line'), /looking only/);
        assert.deepEqual((await scene(owner)).camera, camera);
        assert.equal(await guest.locator('.toast').count(), 0);
      }
      await guest.reload();
      assert.ok(spread(await settled(guest)) > 40, 'and after a reload');
      assert.equal((await stageData(guest)).session, session);
      assert.deepEqual([owner.complaints, guest.complaints], [[], []]);
      await guest.close();
      await owner.close();
    });
  }

  test('a link that is over asks for a token', async () => {
    const page = await visit(`${daemon.url}#share=${'0'.repeat(32)}.view.1.${'0'.repeat(64)}`);
    await page.waitForSelector('#token-problem:not([hidden])');
    assert.match(await page.textContent('#token-problem'), /expired/);
    await page.close();
  });
});
