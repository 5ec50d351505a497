// What tests look at on the page: the picture's pixels and what the stage says of itself.

/** A 32x24 thumbnail of the canvas, as numbers 0..255: robust against sizes and JPEG noise. */
export function thumbnail(page) {
  return page.evaluate(() => {
    const small = new OffscreenCanvas(32, 24);
    const context = small.getContext('2d');
    context.drawImage(document.getElementById('picture'), 0, 0, 32, 24);
    const { data } = context.getImageData(0, 0, 32, 24);
    return Array.from(data).filter((_, i) => i % 4 !== 3);
  });
}

/** Mean absolute difference of two thumbnails, 0..255. */
export const difference = (a, b) => a.reduce((sum, x, i) => sum + Math.abs(x - b[i]), 0) / a.length;

export const spread = (a) => Math.max(...a) - Math.min(...a);

export const stageData = (page) => page.evaluate(() => ({ ...document.getElementById('stage').dataset }));

/** Waits for a finished picture that shows every edit made so far, then gives its thumbnail. */
export async function settled(page) {
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))); // the edit's own display frame
  await page.waitForFunction(
    () => {
      const { final, pending, frame } = document.getElementById('stage').dataset;
      const now = performance.now();
      const done = final === 'true' && pending === '0';
      if (!done || window.lastFrameSeen !== frame) Object.assign(window, { lastFrameSeen: frame, lastFrameAt: now });
      return done && now - window.lastFrameAt > 120;
    },
    null,
    { timeout: 60000 },
  );
  return thumbnail(page);
}

export async function stageBox(page) {
  const box = await page.locator('#stage').boundingBox();
  return { ...box, cx: box.x + box.width / 2, cy: box.y + box.height / 2 };
}

export async function drag(page, from, to, { button = 'left', steps = 8 } = {}) {
  await page.mouse.move(...from);
  await page.mouse.down({ button });
  await page.mouse.move(...to, { steps });
  await page.mouse.up({ button });
}
