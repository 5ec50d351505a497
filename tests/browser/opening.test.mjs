// What the page costs before its first picture, and what that picture is, with the real daemon.
import assert from 'node:assert/strict';
import { after, before, describe, test } from 'node:test';

import { browserMissing, launch } from './chromium.mjs';
import { daemonMissing, startDaemon } from './daemon.mjs';

const LINK = { offline: false, latency: 200, downloadThroughput: 125000, uploadThroughput: 125000 };
const KIB = 1024;

/** Counts what comes until a picture of this document is drawn. @returns {{bytes, requests, ms}} */
async function cost(page, go) {
  const network = await page.context().newCDPSession(page);
  const spent = { bytes: 0, requests: 0, names: [] };
  await network.send('Network.enable');
  await network.send('Network.emulateNetworkConditions', LINK);
  network.on('Network.requestWillBeSent', ({ request }) => {
    spent.requests += 1;
    spent.names.push(new URL(request.url).pathname);
  });
  network.on('Network.webSocketCreated', () => (spent.requests += 1));
  network.on('Network.loadingFinished', ({ encodedDataLength }) => (spent.bytes += encodedDataLength));
  network.on('Network.webSocketFrameReceived', ({ response }) => (spent.bytes += 0.75 * response.payloadData.length));
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
  before(async () => {
    browser = await launch();
    daemon = await startDaemon(['--volume', 'head=demo:head']);
  });
  after(async () => {
    await browser?.close();
    await daemon?.stop();
  });

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
});
