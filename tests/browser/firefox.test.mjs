// The main path in Firefox: a volume opens, the mouse turns it, the wheel zooms and scrolls, keys work, the address follows.
import assert from 'node:assert/strict';
import { after, before, describe, test } from 'node:test';

import { daemonMissing, startDaemon } from './daemon.mjs';
import { firefoxMissing, launchFirefox } from './firefox.mjs';

const skip = daemonMissing() || firefoxMissing();

describe('page in Firefox', { skip }, () => {
  let firefox;
  let daemon;
  before(async () => {
    daemon = await startDaemon(['--volume', 'head=demo:head']);
    firefox = await launchFirefox();
  });
  after(async () => {
    await firefox?.close();
    await daemon?.stop();
  });

  const until = async (fn, ...args) => {
    for (let i = 0; i < 300; i++) {
      const found = await firefox.script(fn, ...args);
      if (found) return found;
      await new Promise((resolve) => setTimeout(resolve, 100));
    }
    return assert.fail(`never: ${fn}`);
  };
  const settled = () =>
    until(() => {
      const { final, pending } = document.getElementById('stage').dataset;
      return final === 'true' && pending === '0';
    });
  const scene = () =>
    firefox.script(() => {
      document.getElementById('scene-open').click();
      const text = document.getElementById('scene-text').value;
      document.getElementById('scene-dialog').close();
      return JSON.parse(text);
    });
  const actions = (...list) => firefox.send('WebDriver:PerformActions', { actions: list });
  const mouse = (...list) => actions({ type: 'pointer', id: 'mouse', parameters: { pointerType: 'mouse' }, actions: list });
  const wheel = (x, y, deltaY) =>
    actions({ type: 'wheel', id: 'wheel', actions: [{ type: 'scroll', x, y, deltaX: 0, deltaY, duration: 0 }] });
  const key = (value) =>
    actions({ type: 'key', id: 'keys', actions: [{ type: 'keyDown', value }, { type: 'keyUp', value }] });
  const move = (x, y, duration = 100) => ({ type: 'pointerMove', x, y, duration, origin: 'viewport' });

  /** What `ask` says once it differs from `before` and the picture is there; `before` after five seconds. */
  const changed = async (ask, before) => {
    for (let i = 0; i < 100 && (await ask()) === before; i++) await new Promise((done) => setTimeout(done, 50));
    await settled();
    return ask();
  };

  test('opens, turns, zooms, scrolls slices and keeps its address', async () => {
    await firefox.send('WebDriver:Navigate', { url: `${daemon.url}#head` });
    await settled();
    const colours = await firefox.script(() => {
      const canvas = document.getElementById('picture');
      const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
      let most = 0;
      for (let i = 0; i < data.length; i += 400) most = Math.max(most, data[i]);
      return most;
    });
    assert.ok(colours > 60, 'there is a picture');
    const { x, y } = await firefox.script(() => {
      const box = document.getElementById('stage').getBoundingClientRect();
      return { x: Math.round(box.x + box.width / 2), y: Math.round(box.y + box.height / 2) };
    });
    const first = (await scene()).camera;
    await mouse(move(x, y, 0), { type: 'pointerDown', button: 0 }, move(x + 120, y + 20), { type: 'pointerUp', button: 0 });
    await settled();
    const turned = (await scene()).camera;
    assert.ok(turned.position[0] < first.position[0] - 50, 'the drag turns');
    await wheel(x, y, -120);
    const away = ({ position, target }) => Math.hypot(...position.map((p, k) => p - target[k]));
    const factor = await changed(async () => away(turned) / away((await scene()).camera), 1); // a wheel may arrive after the answer to it
    assert.ok(factor > 1.1 && factor <= 1.25, `one notch zooms by ${factor}`);
    await key('l');
    await until(() => document.getElementById('mark-right').textContent === 'P');
    await until(() => location.hash.startsWith('#head&mode=dvr&camera'));
    await firefox.script(() => {
      const menu = document.getElementById('mode');
      menu.value = 'mpr';
      menu.dispatchEvent(new Event('input', { bubbles: true }));
      document.getElementById('stage').focus();
    });
    await settled();
    await key('\uE011'); // Home
    await until(() => location.hash.includes('mpr.center'));
    const z = async () => (await scene()).mpr.center[2];
    const bottom = await z();
    await wheel(x, y, 120);
    assert.ok(Math.abs((await changed(z, bottom)) - bottom - 0.95) < 1e-6, 'one notch is one slice');
    await key('?');
    assert.ok(await firefox.script(() => document.getElementById('help-dialog').open));
  });
});
