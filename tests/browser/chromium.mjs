// One headless Chromium per test file, a fresh context per page. TC_CHROMIUM names another binary. Debian's headless shell is
// the same engine without the browser's own windows; the tests take half the processor time in it (AMD EPYC, Zen 5).
import { existsSync } from 'node:fs';

const INSTALLED = ['/usr/bin/chromium-headless-shell', '/usr/bin/chromium'];
const BINARY = process.env.TC_CHROMIUM ?? INSTALLED.find((path) => existsSync(path)) ?? INSTALLED[0];
const FLAGS = [
  '--no-sandbox',
  '--disable-gpu',
  '--disable-quic',
  '--no-first-run',
  '--disable-background-networking',
  '--disable-component-update',
  '--disable-sync',
];

/** Why browser tests cannot run here, or false. */
export async function browserMissing() {
  if (!existsSync(BINARY)) return `no browser at ${BINARY}`;
  return import('playwright-core').then(
    () => false,
    () => 'playwright-core is not installed: run npm ci in tests/',
  );
}

/** @returns {{page(options): Promise<Page>, close(): Promise<void>}} */
export async function launch() {
  const { chromium } = await import('playwright-core');
  // Each launch makes a temporary profile of its own.
  const browser = await chromium.launch({ executablePath: BINARY, headless: true, args: FLAGS });
  return {
    async page(options = {}) {
      const context = await browser.newContext({ viewport: { width: 1000, height: 640 }, ...options });
      const page = await context.newPage();
      page.complaints = [];
      page.on('pageerror', (error) => page.complaints.push(String(error)));
      page.on('console', (message) => {
        if (message.type() === 'error' && /Content Security Policy|SyntaxError|TypeError/.test(message.text())) {
          page.complaints.push(message.text());
        }
      });
      return page;
    },
    close: () => browser.close(),
  };
}
