// Strangers: names the server is asked for by, pages that ask, what every reply says about itself; tokens,
// roles, tickets, links.
import assert from 'node:assert/strict';
import { createHash } from 'node:crypto';
import { chmodSync, existsSync, mkdtempSync, readFileSync, renameSync, statSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, describe, test } from 'node:test';
import { Daemon, problem, until } from '../support/daemon.mjs';
import { handshake, Ws } from '../support/ws.mjs';

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

  test('two origins, or two tokens, are none', async () => {
    const host = `Host: 127.0.0.1:${d.port}`;
    assert.equal(status(await ask('/v1/about', [host, `Origin: http://127.0.0.1:${d.port}`, 'Origin: http://evil.example'])), 400);
    assert.equal(status(await ask('/v1/about', [host, 'Authorization: Bearer x', 'Authorization: Bearer y'])), 400);
  });

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

  test('what is refused before it is a request is shielded too', async () => {
    const host = `Host: 127.0.0.1:${d.port}\r\n`;
    const json = `${host}Content-Type: application/json\r\n`;
    const rows = ['garbage\r\n\r\n', 'GET / HTTP/1.1\r\n\r\n', `GET / HTTP/2.0\r\n${host}\r\n`, `GET /${'a'.repeat(9000)} HTTP/1.1\r\n${host}\r\n`,
      `GET / HTTP/1.1\r\n${host}X: ${'a'.repeat(20000)}\r\n\r\n`, `GET /%00 HTTP/1.1\r\n${host}\r\n`, `CONNECT a:1 HTTP/1.1\r\nHost: a:1\r\n\r\n`,
      `GET /v1/about HTTP/1.1\r\n${host}Connection: close\r\nCookie: ${'a=b; '.repeat(1000)}\r\n\r\n`, `OPTIONS * HTTP/1.1\r\n${host}Connection: close\r\n\r\n`,
      `POST /v1/render HTTP/1.1\r\n${json}Content-Length: 5\r\nExpect: nonsense\r\n\r\nabcde`,
      `POST /v1/render HTTP/1.1\r\n${json}Transfer-Encoding: chunked\r\n\r\nzz\r\nabc\r\n`, `POST /v1/render HTTP/1.1\r\n${json}Content-Length: 99999999999\r\n\r\n`];
    for (const row of rows) {
      const text = await d.raw(row);
      for (const header of [/^content-security-policy: default-src 'self'/im, /^referrer-policy: no-referrer/im, /^x-content-type-options: nosniff/im, /^cache-control: no-store/im])
        assert.match(text, header, row.slice(0, 60));
    }
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

const TOKENS = { ann: 'ann-may-edit-0123456789', bob: 'bob-may-edit-0123456789', eve: 'eve-may-look-0123456789', root: 'root-may-all-0123456789' };
const sha256 = (text) => createHash('sha256').update(text).digest('hex');
const TOKEN_FILE = `# who may do what\nann edit ${TOKENS.ann}\nbob edit sha256:${sha256(TOKENS.bob)}\n\neve view ${TOKENS.eve}\nroot admin ${TOKENS.root}\n`;

/** A file only its owner reads, outside of the data folder. */
function secretFile(text, mode = 0o600) {
  const path = join(mkdtempSync(join(tmpdir(), 'tomocast-secret-')), 'tokens');
  writeFileSync(path, text, { mode });
  chmodSync(path, mode);
  return path;
}

describe('a daemon with tokens', () => {
  let d, session, path;
  const as = (name) => ({ headers: { authorization: name ? `Bearer ${TOKENS[name] ?? name}` : '' } });
  const nobody = { headers: { authorization: '' } };
  before(async () => {
    path = secretFile(TOKEN_FILE);
    d = await Daemon.start({ args: ['--token-file', path], token: TOKENS.root });
    d.token = TOKENS.ann;
    session = await d.session({ image: { width: 32, height: 32 } });
  });
  after(async () => {
    await d.stop();
    assert.doesNotMatch(d.stderr, /may-(edit|look|all)/, 'no token in the log');
  });

  test('the page and its health are for everybody', async () => {
    for (const where of ['/', '/main.js', '/healthz', '/readyz']) assert.equal((await fetch(d.base + where)).status, 200, where);
  });

  test('who has no token learns how to send one', async () => {
    const lists = await d.get('/v1/openapi.json');
    for (const [pattern, item] of Object.entries(lists.json.paths)) {
      if (['/', '/healthz', '/readyz'].includes(pattern)) continue;
      for (const method of Object.keys(item).filter((name) => /^(get|put|post|patch|delete)$/.test(name))) {
        const headers = { 'content-type': 'application/json' };
        const reply = await fetch(d.base + pattern.replace('{id}', session.id), { method: method.toUpperCase(), headers, body: method === 'get' ? undefined : '{}' });
        assert.equal(reply.status, 401, `${method} ${pattern}`);
        assert.equal(reply.headers.get('www-authenticate'), 'Bearer realm="tomocast"');
        assert.equal((await reply.json()).type, 'urn:tomocast:problem:token');
      }
    }
  });

  const wrong = { 'a wrong token': 'Bearer ann-may-edit-0123456780', 'half a token': 'Bearer ann-may-edit', 'another scheme': `Basic ${TOKENS.ann}`,
    'no token': 'Bearer ', 'its hash': `Bearer ${sha256(TOKENS.bob)}`, 'the name': 'Bearer ann', 'what looks like a link': `Bearer ${'0'.repeat(32)}.edit.99999999999.${'0'.repeat(64)}` };
  for (const [name, authorization] of Object.entries(wrong)) {
    test(`${name} opens nothing`, async () => {
      const reply = await d.get('/v1/volumes', { headers: { authorization } });
      problem(reply, 401);
      assert.match(reply.headers.get('www-authenticate'), /invalid_token/);
    });
  }
  test('the scheme is spelled as one likes', async () => {
    assert.equal((await d.get('/v1/about', { headers: { authorization: `bEARER ${TOKENS.bob}` } })).status, 200);
  });

  const roles = [
    ['eve', 'GET', '/v1/volumes', undefined, 200], ['eve', 'GET', '/v1/volumes/ball/histogram', undefined, 200], ['eve', 'GET', '/metrics', undefined, 403],
    ['eve', 'POST', '/v1/sessions', { volume: 'ball' }, 403], ['eve', 'POST', '/v1/render', { volume: 'ball' }, 403],
    ['eve', 'POST', '/v1/volumes', { id: 'x', path: 'ball.nrrd' }, 403], ['eve', 'PUT', '/v1/volumes/x', {}, 403], ['eve', 'DELETE', '/v1/volumes/ball', undefined, 403],
    ['ann', 'POST', '/v1/render', { volume: 'ball', scene: { image: { width: 8, height: 8 } } }, 200],
    ['ann', 'DELETE', '/v1/volumes/ball', undefined, 403], ['ann', 'DELETE', '/v1/volumes/ball?force=true', undefined, 403],
  ];
  for (const [name, method, where, json, expected] of roles) {
    test(`${name}: ${method} ${where} is ${expected}`, async () => {
      const reply = await d.call(method, where, { json, ...as(name) });
      assert.equal(reply.status, expected, reply.bytes.toString().slice(0, 200));
      if (name === 'eve' && expected === 403) assert.match(problem(reply, 403).detail, /needs the role (edit|admin); yours is view/);
    });
  }

  test('a session is there for its owner and an admin only', async () => {
    const ids = async (name) => (await d.get('/v1/sessions', as(name))).json.sessions.map(({ id }) => id);
    assert.deepEqual([await ids('ann'), await ids('bob'), await ids('eve'), await ids('root')], [[session.id], [], [], [session.id]]);
    const calls = [['GET', session.links.self], ['GET', session.links.scene], ['PATCH', session.links.scene, {}], ['PUT', session.links.scene, {}],
      ['GET', session.links.frame], ['GET', session.links.plan], ['GET', `${session.links.self}/ray?x=1&y=1`], ['GET', `${session.links.self}/pick?x=1&y=1`],
      ['GET', session.links.stream], ['GET', session.links.mjpeg], ['DELETE', session.links.self], ['POST', `${session.links.self}/share`, { role: 'view' }],
      ['POST', '/v1/tickets', { session: session.id }]];
    for (const [method, where, json] of calls) problem(await d.call(method, where, { json, ...as('bob') }), 404);
    for (const name of ['ann', 'root']) assert.equal((await d.get(session.links.self, as(name))).status, 200, name);
  });

  test('volumes are deleted by who brought them, by force and for others by an admin', async () => {
    const load = async (id) => {
      assert.equal((await d.post('/v1/volumes', { id, path: 'ball.nrrd' })).status, 202);
      await d.resident(id);
    };
    await load('mine');
    problem(await d.call('DELETE', '/v1/volumes/mine', as('bob')), 403);
    assert.equal((await d.delete('/v1/volumes/mine')).status, 204);
    await load('mine');
    const made = await d.post('/v1/sessions', { volume: 'mine' });
    problem(await d.delete('/v1/volumes/mine'), 409);
    problem(await d.delete('/v1/volumes/mine?force=true'), 403);
    assert.equal((await d.call('DELETE', '/v1/volumes/mine?force=true', as('root'))).status, 204);
    problem(await d.get(made.json.links.self), 404);
  });

  const ticket = async (body = {}, options = {}) => {
    const reply = await d.post('/v1/tickets', body, options);
    assert.deepEqual([reply.status, reply.json?.expiresIn], [200, 30], reply.bytes.toString());
    assert.match(reply.json.ticket, /^[0-9a-f]{32}$/);
    return reply.json.ticket;
  };
  const plain = (where) => fetch(d.base + where).then(async (reply) => (await reply.body?.cancel(), reply.status));
  const upgrade = async (where, id = session.id) => {
    const reply = await handshake(d.port, `/v1/sessions/${id}/stream${where}`);
    if (reply.status !== 101) reply.socket.destroy();
    return reply;
  };

  test('a ticket opens one stream, once', async () => {
    const one = await ticket({ session: session.id });
    const reply = await upgrade(`?ticket=${one}`);
    assert.equal(reply.status, 101);
    const ws = new Ws(reply.socket, reply.rest);
    assert.equal((await ws.nextText('hello')).role, 'edit');
    ws.patch(1, { camera: { fovY: 31 } });
    await ws.nextFrame(({ seq }) => seq === 1);
    await ws.close();
    assert.equal((await upgrade(`?ticket=${one}`)).status, 401);
    assert.equal((await upgrade('')).status, 401);
    assert.equal((await upgrade(`?ticket=${'0'.repeat(32)}`)).status, 401);
  });

  test('a ticket shows pictures and frames, nothing else', async () => {
    assert.equal(await plain(`${session.links.frame}?ticket=${await ticket()}`), 200);
    assert.equal(await plain(`${session.links.mjpeg}?ticket=${await ticket()}`), 200);
    assert.equal(await plain(`/v1/volumes?ticket=${await ticket()}`), 401);
    assert.equal(await plain(`${session.links.frame}?ticket=${await ticket({}, as('bob'))}`), 404);
    const other = await d.session();
    assert.equal(await plain(`${other.links.frame}?ticket=${await ticket({ session: session.id })}`), 404);
    const patched = await fetch(`${d.base}${session.links.scene}?ticket=${await ticket()}`, { method: 'PATCH', headers: { 'content-type': 'application/json' }, body: '{}' });
    assert.equal(patched.status, 401);
    problem(await d.post('/v1/tickets', { sesion: 'x' }), 422);
  });

  test('tickets are bounded for each token', async () => {
    let reply;
    for (let i = 0; i < 70 && (reply = await d.post('/v1/tickets', {}, as('eve'))).status === 200; i++);
    problem(reply, 503);
    assert.ok(Number(reply.headers.get('retry-after')) > 0);
    await ticket({}, as('bob'));
  });

  const share = async (body, links = session.links) => {
    const reply = await d.post(`${links.self}/share`, body);
    assert.equal(reply.status, 200, reply.bytes.toString());
    assert.equal(reply.json.link, `/#share=${reply.json.token}`);
    return reply.json;
  };

  test('a link opens one session with its role, and nothing beside it', async () => {
    const { token, expires } = await share({ role: 'view', seconds: 100 });
    assert.ok(Math.abs(new Date(expires) - Date.now() - 100000) < 30000);
    const guest = as(token);
    const other = await d.session();
    const rows = [['GET', session.links.self, 200], ['GET', session.links.frame, 200], ['GET', '/v1/volumes/ball', 200], ['GET', '/v1/about', 200],
      ['GET', other.links.self, 404], ['PATCH', session.links.scene, 403, {}], ['DELETE', session.links.self, 403], ['POST', '/v1/sessions', 403, { volume: 'ball' }],
      ['POST', `${session.links.self}/share`, 403, { role: 'view' }], ['GET', '/v1/volumes/none', 404]];
    for (const [method, where, expected, json] of rows) assert.equal((await d.call(method, where, { json, ...guest })).status, expected, `${method} ${where}`);
    assert.deepEqual((await d.get('/v1/sessions', guest)).json.sessions.map(({ id }) => id), [session.id]);
    const volumes = await d.get('/v1/volumes', guest);
    assert.deepEqual([volumes.json.volumes.map(({ id }) => id), volumes.json.available], [['ball'], []]);
    const reply = await upgrade(`?ticket=${await ticket({}, guest)}`);
    assert.equal(reply.status, 101);
    const ws = new Ws(reply.socket, reply.rest);
    assert.equal((await ws.nextText('hello')).role, 'view');
    ws.patch(7, { camera: { fovY: 11 } });
    const refused = await ws.nextText('error');
    assert.deepEqual([refused.seq, refused.problem.status], [7, 403]);
    ws.send({ type: 'ping', t: 1 });
    await ws.nextText('pong');
    assert.notEqual((await d.get(session.links.scene)).json.camera.fovY, 11);
    await ws.close();
  });

  test('a link to edit changes the scene, and brings nothing into it', async () => {
    const guest = as((await share({ role: 'edit' })).token);
    assert.equal((await d.patch(session.links.scene, { camera: { fovY: 12 } }, guest)).status, 200);
    problem(await d.patch(session.links.scene, { labels: { volume: 'other' } }, guest), 403);
    for (const [method, where, json] of [['POST', '/v1/sessions', { volume: 'ball' }], ['POST', '/v1/render', { volume: 'ball' }], ['PUT', '/v1/volumes/x', {}],
      ['DELETE', session.links.self], ['POST', `${session.links.self}/share`, { role: 'view' }]]) problem(await d.call(method, where, { json, ...guest }), 403);
  });

  test('of a file of several volumes a link shows the one of its session, and steps within that file alone', async () => {
    const head = 'NRRD0004\ntype: uint8\ndimension: 4\nsizes: 4 4 4 2\nkinds: domain domain domain time\nencoding: raw\n\n';
    const body = Buffer.concat([Buffer.from(head), Buffer.alloc(64, 1), Buffer.alloc(64, 2)]);
    await d.call('PUT', '/v1/volumes/time', { body, type: 'application/octet-stream' });
    await d.resident('time');
    assert.equal((await d.post('/v1/volumes', { id: 'time.2', of: 'time', volume: 2 })).status, 202);
    await d.resident('time.2');
    const { id, links } = (await d.post('/v1/sessions', { volume: 'time' })).json;
    const guest = as((await share({ role: 'edit' }, links)).token), looker = as((await share({ role: 'view' }, links)).token);
    const known = async (who) => (await d.get('/v1/volumes/time', who)).json.volumes.map((volume) => volume.id).sort();
    assert.deepEqual([await known(guest), await known()], [['time'], ['time', 'time.2']]);
    const show = (volume, who) => d.call('PATCH', links.self, { json: { volume }, ...who });
    problem(await show('time.2', looker), 403);
    problem(await show('ball', guest), 403);
    problem(await show('nothing', guest), 403);
    assert.equal((await show('time.2', guest)).json.volume, 'time.2');
    problem(await d.post('/v1/volumes', { id: 'x', of: 'time.2', volume: 1 }, guest), 403);
    assert.equal((await d.get('/v1/volumes/time.2', looker)).status, 200);
    await d.call('DELETE', `/v1/sessions/${id}`);
    for (const volume of ['time', 'time.2']) assert.equal((await d.call('DELETE', `/v1/volumes/${volume}`)).status, 204);
  });

  test('a link ends: in time, with the session, when anything in it is changed', async () => {
    const own = await d.session();
    const short = await share({ role: 'view', seconds: 2 }, own.links), long = await share({ role: 'view' }, own.links);
    const opened = await handshake(d.port, `/v1/sessions/${own.id}/stream?ticket=${await ticket({}, as(short.token))}`);
    const ws = new Ws(opened.socket, opened.rest);
    assert.equal((await d.get(own.links.self, as(short.token))).status, 200);
    assert.equal((await ws.ended).code, 1008, 'a stream does not outlive its link');
    problem(await d.get(own.links.self, as(short.token)), 401);
    problem(await d.get(own.links.self, as(long.token.replace('.view.', '.edit.'))), 401);
    problem(await d.get(own.links.self, as(long.token.replace(own.id, session.id))), 401);
    assert.equal((await d.get(own.links.self, as(long.token))).status, 200);
    await d.delete(own.links.self);
    problem(await d.get(own.links.self, as(long.token)), 404);
    for (const [body, expected] of [[{}, 422], [{ role: 'admin' }, 422], [{ role: 'view', seconds: 0 }, 422], [{ role: 'view', seconds: 1.5 }, 422], [{ role: 'view', more: 1 }, 422]])
      problem(await d.post(`${session.links.self}/share`, body), expected);
  });

  test('the log says who opened what, and names no patient', async () => {
    await d.post('/v1/volumes', { id: 'Mustermann.Erika', path: 'ball.nrrd' });
    await d.resident('Mustermann.Erika');
    const { json } = await d.post('/v1/sessions', { volume: 'Mustermann.Erika' });
    await d.delete(json.links.self);
    await d.call('DELETE', '/v1/volumes/Mustermann.Erika');
    await d.get('/v1/volumes', nobody);
    const lines = await d.logged(new RegExp(`audit.session.end session=${json.id.slice(0, 8)}[^]*audit.refused who=- role=none why=token`));
    const [, volume] = [...lines.matchAll(/audit\.volume\.load who=ann role=edit volume=([0-9a-f]{8})\n/g)].at(-1);
    assert.ok(lines.includes(`audit.session.create who=ann role=edit session=${json.id.slice(0, 8)} volume=${volume}\n`));
    assert.ok(lines.includes(`audit.session.delete who=ann role=edit session=${json.id.slice(0, 8)}\n`));
    assert.ok(lines.includes(`audit.session.end session=${json.id.slice(0, 8)}\n`));
    assert.ok(lines.includes(`audit.volume.delete who=ann role=edit volume=${volume}\n`));
    assert.match(lines, /audit\.share\.view who=ann role=edit session=/);
    assert.match(lines, /audit\.session\.join who=share-[0-9a-f]{8} role=view session=/);
    assert.match(lines, /audit\.refused who=- role=none why=token/);
    assert.doesNotMatch(lines, /Mustermann|ball/);
    assert.ok(!lines.includes(json.id), 'not the whole id, which opens the session');
  });
});

test('the audit file holds what the log may leave out, for its owner only', async () => {
  const file = join(mkdtempSync(join(tmpdir(), 'tomocast-audit-')), 'audit');
  const d = await Daemon.start({ args: ['--audit-file', file], config: '[server]\nlog_level=error\n' });
  const { id, links } = await d.session();
  const lines = async (wanted) => {
    await until(() => existsSync(file) && wanted.test(readFileSync(file, 'utf8')));
    return readFileSync(file, 'utf8').trim().split('\n');
  };
  const [created] = await lines(/session\.create/);
  assert.match(created, new RegExp(`^\\S+Z info audit\\.session\\.create who=- role=admin session=${id.slice(0, 8)} volume=[0-9a-f]{8}$`));
  assert.equal(statSync(file).mode & 0o777, 0o600);
  renameSync(file, `${file}.1`);
  d.process.kill('SIGHUP');
  await lines(/^/);
  await d.delete(links.self);
  const rest = await lines(/session\.end/);
  assert.ok(rest.every((line) => / audit\.session\.(delete|end) /.test(line)), rest.join());
  await d.stop();
  assert.equal(d.stderr, '');
  await assert.rejects(Daemon.start({ args: ['--audit-file', '/nothing/here'] }), /ended with 2.*--audit-file \/nothing\/here: No such file/s);
});

describe('nobody is let in by oversight', () => {
  const start = (args) => Daemon.start({ args, ball: false });
  const rows = {
    'a wider address without tokens': [['--listen', '0.0.0.0:0'], /ended with 2.*--token-file FILE.*--insecure-no-auth/s],
    'every IPv6 address without tokens': [['--listen', '[::]:0'], /ended with 2.*--token-file FILE/s],
    'tokens and none': [() => ['--token-file', secretFile(TOKEN_FILE), '--insecure-no-auth'], /ended with 2.*give one of them/s],
    'tokens that others may read': [() => ['--token-file', secretFile(TOKEN_FILE, 0o644)], /ended with 2.*chmod 600/s],
    'a token too short': [() => ['--token-file', secretFile('ann edit short\n')], /ended with 2.*line 1: a token is 16/s],
    'no token file': [['--token-file', '/nothing/here'], /ended with 2.*\/nothing\/here: No such file/s],
  };
  for (const [name, [args, message]] of Object.entries(rows)) {
    test(name, () => assert.rejects(start(typeof args === 'function' ? args() : args), (error) => {
      assert.match(error.message, message);
      assert.equal(error.message.trim().split('\n').length, 1, 'one line');
      return true;
    }));
  }

  test('everybody is let in where that is said aloud', async () => {
    const d = await start(['--insecure-no-auth']);
    assert.equal((await d.get('/v1/volumes')).status, 200);
    await d.logged(/serve\.open/);
    await d.stop();
  });
});
