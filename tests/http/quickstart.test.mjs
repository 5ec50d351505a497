// deploy/quickstart's words for `tomocast serve`: the demo volume unless the caller names one. Its tools are stand-ins.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { cpSync, mkdirSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { BINARY } from '../support/daemon.mjs';

const DEMO = ['--volume', 'head=demo:head'];
let top;

/** A copy of quickstart where nothing is to be installed or built, and whose daemon prints its words. */
before(() => {
  top = mkdtempSync(join(tmpdir(), 'tomocast-test-'));
  const script = (path, text) => writeFileSync(join(top, path), `#!/bin/sh\n${text}\n`, { mode: 0o755 });
  for (const folder of ['deploy', 'bin', 'build']) mkdirSync(join(top, folder));
  cpSync(new URL('../../deploy/quickstart', import.meta.url), join(top, 'deploy/quickstart'));
  script('deploy/install-packages', '');
  script('bin/ninja', 'echo "ninja: no work to do."');
  script('build/tomocast', 'printf "%s\\n" "$@"');
  writeFileSync(join(top, 'build/build.ninja'), '');
});
after(() => rmSync(top, { recursive: true }));

function served(...args) {
  const env = { ...process.env, PATH: `${join(top, 'bin')}:${process.env.PATH}`, TC_BUILD: join(top, 'build') };
  const { status, stdout, stderr } = spawnSync(join(top, 'deploy/quickstart'), args, { encoding: 'utf8', env });
  assert.equal(status, 0, stderr);
  return stdout.trimEnd().split('\n');
}

test('the demo volume, unless the caller names one', () => {
  for (const args of [[], ['--listen', '127.0.0.1:1'], ['--listen=127.0.0.1:1'], ['--insecure-no-auth'], ['--data', '/volumes', '--backend=cpu']])
    assert.deepEqual(served(...args), ['serve', ...DEMO, ...args]);
  for (const args of [['a.nii'], ['a b.nii', 'c.nrrd'], ['--volume', 'x=a.nii'], ['--volume=x=a.nii'], ['a.nii', '--listen', '127.0.0.1:1']])
    assert.deepEqual(served(...args), ['serve', ...args]);
});

test('a volume after any option is told from its value', () => {
  const help = spawnSync(BINARY, ['serve', '--help'], { encoding: 'utf8' }).stdout;
  const options = [...help.matchAll(/^ +(?:-h, )?(--[a-z-]+)(=\S+)?/gm)].filter(([, name]) => name !== '--help');
  assert.ok(options.length > 10, help);
  for (const [, name, value] of options) {
    const args = [value ? `${name}=x` : name, 'a.nii'];
    assert.deepEqual(served(...args), ['serve', ...args], args.join(' '));
    if (value && name !== '--volume') assert.deepEqual(served(name, 'x'), ['serve', ...DEMO, name, 'x'], name);
  }
});

test('help says what the daemon takes', () => assert.match(served('--help').join('\n'), /Arguments go to `tomocast serve`.*serve\n--help$/s));
