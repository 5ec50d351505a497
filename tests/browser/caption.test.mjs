// What the page says of the picture belongs to the picture: edge letters, words, slices. Against the real daemon.
import assert from 'node:assert/strict';
import { after, before, describe, test } from 'node:test';

import { basis, edgeLetters, sliceBasis } from '../../web/camera.js';
import { captionLines } from '../../web/caption.js';
import { browserMissing, launch } from './chromium.mjs';
import { daemonMissing, startDaemon } from './daemon.mjs';
import { settled, stageData } from './picture.mjs';
import { open } from './scenarios.mjs';

const skip = daemonMissing() || (await browserMissing());
const VOLUMES = ['--volume', 'head=demo:head'];

/** Numbers that are the same in every run. */
function random(seed) {
  let state = seed;
  return () => (state = (state * 48271) % 2147483647) / 2147483647;
}

/** In the page, before its own code: keeps every frame's header, and what the page said when that frame was drawn. */
function watchFrames() {
  window.headers = new Map();
  window.drawn = [];
  const Native = window.WebSocket;
  window.WebSocket = class extends Native {
    constructor(...args) {
      super(...args);
      window.socket = this;
      const connection = (window.connections = (window.connections ?? 0) + 1);
      this.addEventListener('message', ({ data }) => {
        if (typeof data === 'string') return;
        const size = new DataView(data).getUint32(0, true);
        const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, size)));
        window.headers.set(`${connection}/${header.frame}`, header);
      });
    }
  };
  addEventListener('DOMContentLoaded', () => {
    const stage = document.getElementById('stage');
    const text = (id) => document.getElementById(id).textContent;
    new MutationObserver(() => {
      const header = window.headers.get(`${window.connections}/${stage.dataset.frame}`);
      const [top, bottom, left, right] = ['top', 'bottom', 'left', 'right'].map((edge) => text(`mark-${edge}`));
      const [bar, front] = [document.getElementById('scale-bar'), [...document.querySelectorAll('#cube text')].at(-1)];
      window.drawn.push({
        header,
        scene: header?.scene,
        letters: { right, left, top, bottom },
        label: text('label'),
        front: front?.textContent,
        bar: bar.hidden ? null : { px: parseFloat(bar.style.width), text: text('scale-label') },
        stage: [stage.clientWidth, stage.clientHeight],
      });
    }).observe(stage, { attributeFilter: ['data-frame', 'data-seq'] });
  });
}

async function visit(browser, url, options) {
  const page = await browser.page(options);
  await page.addInitScript(watchFrames);
  await page.goto(url);
  await settled(page);
  return page;
}

const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
const four = (value) => String(Number(value.toPrecision(4)));
const FACES = { L: [1, 0, 0], R: [-1, 0, 0], P: [0, 1, 0], A: [0, -1, 0], H: [0, 0, 1], F: [0, 0, -1] };
const SLABS = { mip: 'maximum', minip: 'minimum', average: 'average' };
const DIMS = [200, 248, 256]; // of the demo head, whose voxels are cubes along the patient's axes
// by plane: the axis across it, which way its slices count, and the axes of its picture
const PLANES = { axial: [2, 1, 0, 1], coronal: [1, 1, 0, 2], sagittal: [0, -1, 1, 2] };
const SIDES = ['LR', 'PA', 'HF'];

/** mm that the picture's height spans, by what the picture is of; 0 in perspective. */
function heightOf({ mode, camera, mpr }, { width, height }, mm) {
  if (mode !== 'mpr') return camera.projection === 'orthographic' ? camera.height : 0;
  const [, , across, down] = PLANES[mpr.orientation];
  return (Math.max(DIMS[down] - 1, ((DIMS[across] - 1) * height) / width) * mm) / mpr.zoom;
}

function sliceLinesOf({ orientation, center, thickness, projection }, { origin, spacing: [mm] }) {
  const [axis, sign] = PLANES[orientation];
  const layer = (center[axis] - origin[axis]) / mm;
  const slice = Math.round(sign > 0 ? layer : DIMS[axis] - 1 - layer) + 1;
  const side = SIDES[axis][center[axis] > 0 ? 0 : 1];
  const lines = [`Slice ${slice} / ${DIMS[axis]} \u00b7 ${side} ${Math.abs(center[axis]).toFixed(1)} mm`];
  return thickness > 0 ? [...lines, `Slab ${four(thickness)} mm \u00b7 ${SLABS[projection]}`] : lines;
}

/** The lines that belong to a scene, worked out anew. */
function linesOf({ mode, mpr, window, transferFunction, isosurface, clip }, titles, volume) {
  const lines = [titles[mode]];
  if (window) lines.push(`C ${four(window.center)}  W ${four(window.width)}`);
  if (mode === 'dvr') lines.push(titles[transferFunction.preset]);
  if (isosurface) lines.push(`Surface at ${four(isosurface.value)}`);
  if (clip?.planes.length) lines.push(`Slab ${four(clip.planes[0][3] + clip.planes[1][3])} mm`);
  return mpr ? [...lines, ...sliceLinesOf(mpr, volume)] : lines;
}

/** Whatever the page said of every frame it drew is that frame's own. @returns how many there were */
async function assertOwnWords(page, volume) {
  const drawn = await page.evaluate(() => window.drawn);
  const titles = await page.evaluate(() =>
    Object.fromEntries([...document.querySelectorAll('#mode option, #preset option')].map((o) => [o.value, o.text])),
  );
  for (const { header, scene, letters, label, front, bar, stage } of drawn) {
    const axes = scene.mode === 'mpr' ? sliceBasis(scene.mpr) : basis(scene.camera);
    assert.deepEqual(letters, edgeLetters(axes), JSON.stringify(scene));
    const facing = Object.values(FACES).map((from) => -dot(from, axes.direction));
    assert.ok(
      -dot(FACES[front], axes.direction) > Math.max(...facing) - 1e-6,
      `cube: ${front}, ${JSON.stringify(scene)}`,
    );
    for (const line of linesOf(scene, titles, volume)) assert.ok(label.includes(line), `"${line}" in "${label}"`);
    if (scene.mode !== 'mpr') assert.ok(!label.includes('Slice'), label);
    if (!scene.window) assert.ok(!/\bW \d/.test(label), label);
    const mm = heightOf(scene, header, volume.spacing[0]);
    assert.equal(bar !== null, mm > 0, JSON.stringify(scene));
    if (!bar) continue;
    const [number, unit] = bar.text.split(' ');
    const shown = Math.min(stage[1], (stage[0] * header.height) / header.width);
    const said = Number(number) * { cm: 10, mm: 1, '\u00b5m': 1e-3 }[unit];
    assert.ok(
      Math.abs((bar.px * mm) / shown / said - 1) < 1e-3,
      `${bar.px} px are ${bar.text}: ${JSON.stringify(scene)}`,
    );
  }
  return drawn.length;
}

test('a mesh is named by what it is of, a slab of a projection by its thickness', () => {
  const titles = { mode: () => 'A mode', preset: () => '', plane: () => '' };
  const lines = (scene) => captionLines(scene, { id: 'head', unit: 'HU' }, titles);
  const isosurface = { value: 300 };
  assert.deepEqual(lines({ mode: 'mesh', isosurface }), ['head', 'A mode', 'Surface at 300 HU']);
  assert.deepEqual(lines({ mode: 'mesh', isosurface, labels: { volume: 'parts' } }), [
    'head',
    'A mode',
    'Surfaces of parts',
  ]);
  const surfaces = [{ value: 300 }, { label: 6 }, { value: 9, visible: false }, { mesh: 'stent' }];
  assert.deepEqual(lines({ mode: 'mesh', isosurface, mesh: { surfaces } })[2], 'Surfaces: 300 HU, label 6, stent');
  const slices = [{ value: 300 }, { plane: 'axial', opacity: 1 }];
  assert.equal(lines({ mode: 'mesh', isosurface, mesh: { surfaces: slices } })[2], 'Surfaces: 300 HU, axial slice');
  const many = { surfaces: Array(6).fill({ label: 1 }) };
  assert.match(lines({ mode: 'mesh', mesh: many })[2], /label 1, 2 more$/);
  const facing = [
    [0, 0, 1, 4],
    [0, 0, -1, 8.5],
  ];
  assert.deepEqual(lines({ mode: 'minip', clip: { planes: facing } }), ['head', 'A mode', 'Slab 12.5 mm']);
  assert.deepEqual(lines({ mode: 'minip', clip: { planes: [[0, 0, 1, 4]] } }), ['head', 'A mode']);
});

describe('caption', { skip }, () => {
  let browser;
  let daemon;
  before(async () => {
    browser = await launch();
    daemon = await startDaemon(VOLUMES);
  });
  after(async () => {
    await browser?.close();
    await daemon?.stop();
  });

  test('random edits by two viewers and a script, with drops: every frame drawn has its own words', async () => {
    const one = await visit(browser, `${daemon.url}#head`);
    const { session } = await stageData(one);
    const two = await visit(browser, `${daemon.url}?session=${session}`, { viewport: { width: 920, height: 560 } });
    const volume = await (await fetch(`${daemon.url}v1/volumes/head`)).json();
    const next = random(7);
    const any = (list) => list[Math.floor(next() * list.length)];
    const keys = [
      'a',
      'p',
      'l',
      'r',
      'h',
      'f',
      'ArrowLeft',
      'ArrowUp',
      '+',
      '-',
      '1',
      '2',
      '3',
      'PageDown',
      'Home',
      'End',
    ];
    const patches = [
      () => ({ window: { center: 500 * next(), width: 1 + 900 * next() } }),
      () => ({ camera: { projection: any(['orthographic', 'perspective']), height: 100 + 300 * next() } }),
      () => ({ mpr: { thickness: any([0, 7.5, 20 * next()]), projection: any(['mip', 'minip', 'average']) } }),
      () => ({ mpr: { orientation: any(['axial', 'coronal', 'sagittal']), zoom: 1 + next() } }),
      () => ({ mpr: { center: volume.origin.map((x, k) => x + next() * (DIMS[k] - 1) * volume.spacing[k]) } }),
      () => ({ transferFunction: { preset: any(['ct-bone', 'ct-lung', 'ct-muscle']) } }),
      () => ({ isosurface: { value: 100 + 400 * next() } }),
    ];
    const scene = { method: 'PATCH', headers: { 'content-type': 'application/json' } };
    const edit = async (patch) => {
      const reply = await fetch(`${daemon.url}v1/sessions/${session}/scene`, { ...scene, body: JSON.stringify(patch) });
      assert.equal(reply.status, 200, JSON.stringify(patch));
    };
    await edit({ mpr: { center: volume.origin.map((x) => x + 100.2 * volume.spacing[0]) } }); // on no edge of a layer
    for (let i = 0; i < 60; i++) {
      const page = any([one, two]);
      const what = next();
      if (what < 0.06) await page.evaluate(() => window.socket.close());
      else if (what < 0.25) await page.selectOption('#mode', any(['dvr', 'mip', 'minip', 'mpr', 'mpr', 'isosurface']));
      else if (what < 0.55) await edit(any(patches)());
      else await page.locator('#stage').press(any(keys));
      if (next() < 0.3) await page.waitForTimeout(next() * 120);
    }
    for (const page of [one, two]) await page.waitForSelector('#stat-link[data-state="open"]');
    await Promise.all([settled(one), settled(two)]);
    const counts = [await assertOwnWords(one, volume), await assertOwnWords(two, volume)];
    assert.ok(Math.min(...counts) > 15, `${counts} frames`);
    const [a, b] = [await one.evaluate(() => window.drawn.at(-1)), await two.evaluate(() => window.drawn.at(-1))];
    assert.deepEqual(a.scene, b.scene, 'at rest both show the same scene');
    assert.deepEqual(a.letters, b.letters);
    for (const page of [one, two]) {
      const { width, height } = await page.locator('#stage').boundingBox();
      assert.equal(await page.textContent('#stat-size'), `${width} \u00d7 ${height}`, 'as sharp as its window');
      await page.waitForTimeout(500); // the controls follow a moment later
      assert.equal(await page.inputValue('#mode'), a.scene.mode);
      assert.deepEqual(page.complaints, []);
      await page.close();
    }
  });

  test('the daemon is gone: the picture keeps its letters and says that it is not live', async () => {
    const { page } = await open(browser, `${daemon.url}#head`);
    const letters = () => page.textContent('#mark-right');
    assert.equal(await letters(), 'L');
    assert.ok(await page.isHidden('#stale'));
    await daemon.kill();
    await page.waitForSelector('#stale:not([hidden])');
    assert.match(await page.textContent('#stale'), /NOT LIVE/);
    await page.locator('#stage').press('l');
    await page.selectOption('#mode', 'mip');
    await page.waitForTimeout(300);
    assert.equal(await letters(), 'L', 'the frontal picture is still the frontal picture');
    assert.match(await page.textContent('#label'), /Volume rendering/);
    daemon = await startDaemon(VOLUMES, daemon.port);
    await page.waitForSelector('#stat-link[data-state="open"]', { timeout: 60000 });
    await settled(page);
    assert.equal(await letters(), 'P', 'the edit is kept, and shown with its picture');
    assert.match(await page.textContent('#label'), /Maximum intensity/);
    assert.ok(await page.isHidden('#stale'));
    await page.close();
  });
});
