// Health, metrics, the contract, static files.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Daemon, problem } from '../support/daemon.mjs';
import { validate } from '../support/schema.mjs';

let d;
before(async () => { d = await Daemon.start(); });
after(() => d.stop());

test('health and readiness', async () => {
  assert.deepEqual([(await d.get('/healthz')).status, (await d.get('/readyz')).status], [200, 200]);
});

test('about names back end, reason and limits', async () => {
  const { json } = await d.get('/v1/about');
  assert.equal(json.name, 'tomocast');
  assert.ok(['cpu', 'gl'].includes(json.backend));
  assert.ok(json.why.length > 0 && json.device.length > 0);
  assert.deepEqual([json.limits.imageSide, json.limits.sessions, json.limits.clients, json.limits.bodyBytes, json.limits.window],
    [8192, 256, 1024, 1048576, 2]);
  assert.ok(!JSON.stringify(json.unavailable).includes('"dvr"'));
  const { links } = await d.session();
  for (const [path, values] of Object.entries(json.unavailable)) {
    for (const value of values) {
      const patch = path.split('.').reduceRight((inner, name) => ({ [name]: inner }), value);
      problem(await d.patch(links.scene, patch), 501);
    }
  }
});

test('replies fit the OpenAPI document', async () => {
  const { json: api } = await d.get('/v1/openapi.json');
  assert.match(api.openapi, /^3\.1/);
  const session = await d.session();
  const paths = {
    '/v1/about': '/v1/about', '/v1/presets': '/v1/presets', '/v1/volumes': '/v1/volumes', '/v1/volumes/{id}': '/v1/volumes/ball',
    '/v1/volumes/{id}/histogram': '/v1/volumes/ball/histogram?bins=16', '/v1/volumes/{id}/value': '/v1/volumes/ball/value?at=12,22,32',
    '/v1/sessions': '/v1/sessions', '/v1/sessions/{id}': session.links.self, '/v1/sessions/{id}/scene': session.links.scene,
    '/v1/sessions/{id}/plan': session.links.plan,
  };
  for (const [pattern, path] of Object.entries(paths)) {
    const { status, json } = await d.get(path);
    assert.equal(status, 200, path);
    assert.ok(api.paths[pattern]?.get, pattern);
    const { schema } = api.paths[pattern].get.responses['200'].content['application/json'];
    assert.deepEqual(validate(json, schema, api), [], pattern);
  }
  const missing = await d.get('/v1/volumes/none');
  assert.deepEqual(validate(missing.json, api.components.schemas.Problem, api), []);
});

test('every call of the OpenAPI document has a route', async () => {
  const { json: api } = await d.get('/v1/openapi.json');
  for (const [pattern, item] of Object.entries(api.paths)) {
    const reply = await d.call('OPTIONS', pattern.replace('{id}', 'x'));
    problem(reply, 405);
    const allowed = reply.headers.get('allow').split(', ');
    for (const method of Object.keys(item).filter((name) => /^(get|put|post|patch|delete)$/.test(name))) {
      assert.ok(allowed.includes(method.toUpperCase()), `${method} ${pattern}`);
    }
  }
});

test('the default scene fits the schema of a scene', async () => {
  const { json: schema } = await d.get('/v1/scene.schema.json');
  const { scene } = await d.session();
  assert.deepEqual(validate(scene, schema), []);
  assert.notDeepEqual(validate({ ...scene, nonsense: 1 }, schema), []);
});

test('metrics are Prometheus text and count', async () => {
  await d.get('/v1/volumes/ball');
  const { bytes, headers } = await d.get('/metrics');
  const text = bytes.toString();
  assert.match(headers.get('content-type'), /^text\/plain; version=0\.0\.4/);
  for (const line of text.trim().split('\n')) assert.match(line, /^(# (HELP|TYPE) tomocast_|tomocast_[a-z_]+(\{.*\})? [-+.e\d]+$)/, line);
  assert.match(text, /tomocast_http_requests_total\{method="GET",route="\/v1\/volumes\/\{id\}",code="200"\} [1-9]/);
  assert.match(text, /tomocast_volumes_resident 1\n/);
  assert.ok((await d.metric('process_resident_memory_bytes')) > 1e6);
  assert.ok(!text.includes('ball'), 'no ids in labels');
});

test('the browser client comes with type, policy and ETag', async () => {
  const page = await d.get('/');
  assert.equal(page.status, 200);
  assert.match(page.headers.get('content-type'), /^text\/html/);
  assert.match(page.headers.get('content-security-policy'), /default-src 'self'/);
  assert.equal(page.headers.get('x-content-type-options'), 'nosniff');
  const etag = page.headers.get('etag');
  const again = await d.get('/', { headers: { 'if-none-match': etag } });
  assert.deepEqual([again.status, again.bytes.length, again.headers.get('etag')], [304, 0, etag]);
  assert.equal(page.headers.get('cache-control'), 'no-cache');
  const script = /src="(main\.[0-9a-f]+\.js)"/.exec(page.bytes.toString())[1];
  const reply = await d.get(`/${script}`);
  assert.match(reply.headers.get('content-type'), /^text\/javascript/);
  assert.match(reply.headers.get('cache-control'), /immutable/);
  const plain = await d.get('/main.js');
  assert.equal(plain.headers.get('cache-control'), 'no-cache', 'a plain name may be another file tomorrow');
  assert.deepEqual(plain.bytes, reply.bytes);
  problem(await d.get(`/${script.replace(/\.[0-9a-f]+\./, '.0123456789ab.')}`), 404);
});

test('static files are packed for who takes that, and for nobody else', async () => {
  const size = async (coding) => {
    const reply = await d.get('/main.js', { headers: { 'accept-encoding': coding } });
    assert.equal(reply.headers.get('vary'), 'Accept-Encoding');
    return { length: Number(reply.headers.get('content-length')), coding: reply.headers.get('content-encoding'),
             etag: reply.headers.get('etag'), text: reply.bytes.toString() };
  };
  const [packed, plain, refused] = [await size('gzip, deflate, br'), await size('identity'), await size('gzip;q=0')];
  assert.deepEqual([packed.coding, plain.coding, refused.coding], ['gzip', null, null]);
  assert.ok(packed.length < plain.length / 3, `${packed.length} of ${plain.length} bytes`);
  assert.equal(packed.text, plain.text);
  assert.notEqual(packed.etag, plain.etag);
});

test('no file of the machine is served', async () => {
  for (const path of ['/../etc/passwd', '/%2e%2e/etc/passwd', '/..%2fetc%2fpasswd', '//etc/passwd', '/v1/../healthz']) {
    const text = await d.raw(`GET ${path} HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\nConnection: close\r\n\r\n`);
    assert.doesNotMatch(text, /root:/, path);
    assert.match(text, /^HTTP\/1\.1 4\d\d/, path);
  }
});

test('unknown paths, wrong methods, HEAD', async () => {
  problem(await d.get('/nothing'), 404);
  problem(await d.get('/v1/nothing/at/all'), 404);
  const wrong = await d.call('DELETE', '/v1/about');
  problem(wrong, 405);
  assert.equal(wrong.headers.get('allow'), 'GET, HEAD');
  assert.equal((await d.call('POST', '/v1/volumes/ball', { json: {} })).headers.get('allow'), 'GET, HEAD, PUT, DELETE');
  const head = await d.call('HEAD', '/v1/about');
  assert.deepEqual([head.status, head.bytes.length], [200, 0]);
  assert.ok(Number(head.headers.get('content-length')) > 100);
});

test('logs hold no ids, paths or queries', async () => {
  await d.get('/v1/volumes/secret-patient?name=doe');
  await d.logged(/^\d{4}-\d\d-\d\dT[\d:.]+Z info serve\.start /);
  assert.doesNotMatch(d.stderr, /secret|doe|ball/);
});
