// Strangers: names the server is asked for by, pages that ask, what every reply says about itself.
import assert from 'node:assert/strict';
import { after, before, describe, test } from 'node:test';
import { Daemon, problem } from '../support/daemon.mjs';
import { handshake } from '../support/ws.mjs';

const status = (text) => Number(/^HTTP\/1\.1 (\d+)/.exec(text)?.[1] ?? 0);
const SHOWN = ['/', '/main.js', '/healthz', '/metrics', '/v1/about', '/v1/volumes', '/v1/sessions', '/v1/nothing'];

describe('a daemon as it comes', () => {
  let d, session;
  before(async () => {
    d = await Daemon.start();
    session = await d.session();
  });
  after(() => d.stop());
  const ask = (path, headers, method = 'GET') =>
    d.raw(`${method} ${path} HTTP/1.1\r\n${headers.map((header) => `${header}\r\n`).join('')}Connection: close\r\n\r\n`);

  const hosts = {
    'the listening address': [(port) => [`Host: 127.0.0.1:${port}`], 200],
    localhost: [(port) => [`Host: localhost:${port}`], 200],
    'LOCALHOST': [(port) => [`Host: LOCALHOST:${port}`], 200],
    'the IPv6 loopback': [(port) => [`Host: [::1]:${port}`], 200],
    'a rebound name': [() => ['Host: evil.example'], 421],
    'a rebound name with the port': [(port) => [`Host: evil.example:${port}`], 421],
    'another port': [() => ['Host: 127.0.0.1:1'], 421],
    'no port': [() => ['Host: 127.0.0.1'], 421],
    'a name that begins alike': [(port) => [`Host: 127.0.0.1.evil.example:${port}`], 421],
    'no Host': [() => [], 400],
    'two Hosts': [(port) => [`Host: 127.0.0.1:${port}`, `Host: 127.0.0.1:${port}`], 400],
    'a good Host and a bad one': [(port) => [`Host: 127.0.0.1:${port}`, 'Host: evil.example'], 400],
  };
  for (const [name, [headers, expected]] of Object.entries(hosts)) {
    test(`asked for by ${name}: ${expected} on every route`, async () => {
      for (const path of SHOWN) {
        const found = status(await ask(path, headers(d.port)));
        const wanted = expected === 200 && path === '/v1/nothing' ? 404 : expected;
        assert.equal(found, wanted, path);
      }
    });
  }

  test('a rebound name opens no WebSocket', async () => {
    for (const name of ['evil.example', `evil.example:${d.port}`]) {
      const reply = await handshake(d.port, `/v1/sessions/${session.id}/stream`, { headers: { Host: name, Origin: `http://${name}` } });
      reply.socket.destroy();
      assert.equal(reply.status, 421, name);
    }
  });

  const pages = {
    'this page': [(port) => [`Origin: http://127.0.0.1:${port}`], 200],
    'this page by its other name': [(port) => [`Origin: http://localhost:${port}`], 200],
    'another page': [() => ['Origin: http://evil.example'], 403],
    'another port of this machine': [() => ['Origin: http://127.0.0.1:1'], 403],
    'a page without an origin': [() => ['Origin: null'], 403],
    'an origin with a path': [(port) => [`Origin: http://127.0.0.1:${port}/`], 403],
    'two origins': [(port) => [`Origin: http://127.0.0.1:${port}`, 'Origin: http://evil.example'], 403],
    'a picture of another site': [() => ['Sec-Fetch-Site: cross-site', 'Sec-Fetch-Dest: image'], 403],
    'a picture of another port': [() => ['Sec-Fetch-Site: same-site', 'Sec-Fetch-Dest: image'], 403],
    'a link of another site': [() => ['Sec-Fetch-Site: cross-site', 'Sec-Fetch-Mode: navigate'], 403],
    'an address that was typed': [() => ['Sec-Fetch-Site: none', 'Sec-Fetch-Mode: navigate'], 200],
    'a picture of this page': [() => ['Sec-Fetch-Site: same-origin', 'Sec-Fetch-Dest: image'], 200],
  };
  for (const [name, [headers, expected]] of Object.entries(pages)) {
    test(`asked by ${name}: ${expected}`, async () => {
      const all = [`Host: 127.0.0.1:${d.port}`, ...headers(d.port)];
      for (const path of ['/v1/about', '/v1/volumes', '/v1/sessions', '/metrics', session.links.frame, session.links.scene]) {
        const text = await ask(path, all);
        assert.equal(status(text), expected, path);
        assert.doesNotMatch(text, /access-control/i);
      }
      for (const path of ['/', '/main.js', '/healthz']) assert.equal(status(await ask(path, all)), 200, path);
      const render = await ask('/v1/volumes/none', all, 'DELETE');
      assert.equal(status(render), expected === 200 ? 404 : 403);
      if (expected === 403) assert.equal(status(await ask(session.links.mjpeg, all)), 403);
    });
  }

  test('a page of another origin cannot ask first', async () => {
    const text = await ask('/v1/render', [`Host: 127.0.0.1:${d.port}`, 'Origin: http://evil.example', 'Access-Control-Request-Method: POST'], 'OPTIONS');
    assert.equal(status(text), 405);
    assert.doesNotMatch(text, /access-control/i);
  });

  test('every reply is shielded', async () => {
    const shield = (headers) => ['content-security-policy', 'cross-origin-opener-policy', 'cross-origin-resource-policy',
      'referrer-policy', 'x-content-type-options'].map((name) => headers.get(name));
    const paths = [...SHOWN, '/nothing', session.links.frame, session.links.stream, session.links.scene, '/v1/volumes/none'];
    for (const path of paths) {
      const { headers } = await d.get(path);
      const [policy, ...others] = shield(headers);
      assert.deepEqual(others, ['same-origin', 'same-origin', 'no-referrer', 'nosniff'], path);
      assert.match(policy, /default-src 'self'.*base-uri 'none'.*frame-ancestors 'none'/, path);
      assert.doesNotMatch(policy, /unsafe/);
      const isFile = ['/', '/main.js'].includes(path);
      assert.equal(headers.get('cache-control'), isFile ? 'no-cache' : 'no-store', path);
    }
    const gone = await d.delete(session.links.self);
    assert.deepEqual([gone.status, gone.headers.get('cache-control')], [204, 'no-store']);
    const other = await d.session();
    const head = await d.get(other.links.scene);
    const same = await d.get(other.links.scene, { headers: { 'if-none-match': head.headers.get('etag') } });
    assert.deepEqual([same.status, same.headers.get('cache-control')], [304, 'no-store']);
    const picture = await d.post('/v1/render', { volume: 'ball', scene: { image: { width: 16, height: 16 } } });
    assert.deepEqual([picture.status, picture.headers.get('cache-control')], [200, 'no-store']);
    const live = await fetch(d.base + other.links.mjpeg);
    assert.deepEqual(shield(live.headers).slice(1), ['same-origin', 'same-origin', 'no-referrer', 'nosniff']);
    assert.equal(live.headers.get('cache-control'), 'no-store');
    await live.body.cancel();
  });
});

describe('names of the operator', () => {
  let d;
  before(async () => {
    d = await Daemon.start({ args: ['--host', 'one.example', '--host', 'two.example:9'], config: '[server]\norigins=https://front.example\n' });
  });
  after(() => d.stop());
  const ask = (host, origin) =>
    d.raw(`GET /v1/volumes HTTP/1.1\r\nHost: ${host}\r\n${origin ? `Origin: ${origin}\r\n` : ''}Connection: close\r\n\r\n`).then(status);

  for (const [host, origin, expected] of [
    ['one.example', '', 200], ['one.example:77', '', 200], ['two.example:9', '', 200], ['two.example', '', 421],
    ['one.example', 'https://one.example', 200], ['one.example', 'http://one.example:3000', 403],
    ['one.example', 'https://front.example', 200], ['one.example', 'http://front.example', 403],
    ['front.example', 'https://front.example', 421],
  ]) test(`Host ${host}, Origin ${origin || 'none'}: ${expected}`, async () => assert.equal(await ask(host, origin), expected));

  test('the error of a wrong one says how to mend it', async () => {
    await assert.rejects(Daemon.start({ args: ['--host', 'http://x'] }), /ended with 2.*host http:\/\/x: give NAME/s);
    await assert.rejects(Daemon.start({ config: '[server]\norigins=front.example\n' }), /ended with 2.*origin front\.example: give SCHEME/s);
  });
});
