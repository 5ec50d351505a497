// HTTP/1.1 by the book: what RFC 9112 (and of RFC 9110 what concerns messages) wants of a server, row by row.
// Every row's bytes are followed by a sound request that ends the connection. A row that is good is answered with its own
// status and then that request's; of a bad one only the refusal comes back, a problem document, and then the end: nothing
// after an error may be read as a request.
import assert from 'node:assert/strict';
import net from 'node:net';
import { after, before, test } from 'node:test';
import { Daemon } from '../support/daemon.mjs';
import { exchange, replies } from '../support/http.mjs';
import { validate } from '../support/schema.mjs';

let d, api;
before(async () => {
  d = await Daemon.start({ config: '[server]\nhosts=127.0.0.1\n' });
  api = (await d.get('/v1/openapi.json')).json;
});
after(() => d.stop());

const END = 202; // stands for the sound request's status in the rows
const H = 'Host: 127.0.0.1\r\n';
const get = (target = '/healthz', fields = H, version = 'HTTP/1.1') => `GET ${target} ${version}\r\n${fields}\r\n`;
const last = `GET /v1/about HTTP/1.1\r\n${H}Connection: close\r\n\r\n`;
const JSON_TYPE = 'Content-Type: application/json\r\n';
const post = (fields, body = '') => `POST /v1/render HTTP/1.1\r\n${H}${JSON_TYPE}${fields}\r\n${body}`;
const chunked = (body) => post('Transfer-Encoding: chunked\r\n', body);
const put = (text) => `PUT /v1/volumes/rfc HTTP/1.1\r\n${H}${text}`;

// [section, what, bytes, statuses that come back]; 422 is a body that was read whole ("{}" misses its volume)
const rows = [
  ['9112 2.2', 'a plain request', get(), [200, END]],
  ['9112 2.2', 'an empty line before the request line', `\r\n${get()}`, [200, END]],
  ['9112 2.2', 'empty lines without end', `${'\r\n'.repeat(40)}${get()}`, [400]],
  ['9112 2.2', 'a CR alone in a value', get('/healthz', `${H}X: a\rContent-Length: 5\r\n`), [400]],
  ['9112 2.2', 'a CR alone in the request line', `GET /\rhealthz HTTP/1.1\r\n${H}\r\n`, [400]],
  ['9112 2.2', 'lines ended by LF alone', 'GET /healthz HTTP/1.1\nHost: 127.0.0.1\n\n', [400]],
  ['9112 2.2', 'one line ended by LF alone', get('/healthz', `X: a\n${H}`), [400]],
  ['9112 2.2', 'CR CR LF', get('/healthz', `X: a\r\r\n${H}`), [400]],
  ['9112 2.2', 'a blank line of blanks before the first field', `GET /healthz HTTP/1.1\r\n \r\n${H}\r\n`, [400]],
  ['9112 2.2', 'a field indented after the request line', `GET /healthz HTTP/1.1\r\n X: y\r\n${H}\r\n`, [400]],
  ['9112 2.2', 'a tab before the first field', `GET /healthz HTTP/1.1\r\n\tX: y\r\n${H}\r\n`, [400]],
  ['9112 2.3', 'HTTP/1.0', get('/healthz', H, 'HTTP/1.0'), [200]],
  ['9112 2.3', 'a higher minor version', get('/healthz', H, 'HTTP/1.7'), [200, END]],
  ['9110 15.6.6', 'HTTP/2.0', get('/healthz', H, 'HTTP/2.0'), [505]],
  ['9110 15.6.6', 'the preface of HTTP/2', 'PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n', [505]],
  ['9110 15.6.6', 'HTTP/0.9 by number', get('/healthz', H, 'HTTP/0.9'), [505]],
  ['9112 2.3', 'HTTP in small letters', get('/healthz', H, 'http/1.1'), [400]],
  ['9112 2.3', 'two digits of a version', get('/healthz', H, 'HTTP/1.10'), [400]],
  ['9112 2.3', 'a version without a point', get('/healthz', H, 'HTTP/11'), [400]],
  ['9112 3', 'no version', `GET /healthz\r\n${H}\r\n`, [400]],
  ['9112 3', 'a method alone', `GET\r\n${H}\r\n`, [400]],
  ['9112 3', 'two blanks before the target', `GET  /healthz HTTP/1.1\r\n${H}\r\n`, [400]],
  ['9112 3', 'two blanks before the version', `GET /healthz  HTTP/1.1\r\n${H}\r\n`, [400]],
  ['9112 3', 'a blank in the target', get('/health z'), [400]],
  ['9112 3', 'a tab for a blank', `GET\t/healthz\tHTTP/1.1\r\n${H}\r\n`, [400]],
  ['9112 3', 'a blank after the version', `GET /healthz HTTP/1.1 \r\n${H}\r\n`, [400]],
  ['9112 3', 'a blank before the method', ` GET /healthz HTTP/1.1\r\n${H}\r\n`, [400]],
  ['9112 3', 'a request line of 8000 bytes', get(`/healthz?${'a'.repeat(7975)}`), [200, END]],
  ['9112 3', 'a target over the limit', get(`/${'a'.repeat(9000)}`), [414]],
  ['9112 3', 'a request line that does not end', `GET /${'a'.repeat(40000)}`, [414]],
  ['9112 3', 'a query over the limit', get(`/healthz?${'a=b&'.repeat(2500)}`), [414]],
  ['9112 3', 'a query of too many parts', get(`/healthz?${'a&'.repeat(200)}`), [414]],
  ['9110 9.1', 'an unknown method', `BREW /healthz HTTP/1.1\r\n${H}\r\n`, [501]],
  ['9110 9.1', 'methods know capitals', `get /healthz HTTP/1.1\r\n${H}\r\n`, [501]],
  ['9110 9.1', 'a method that is no word', `GE(T /healthz HTTP/1.1\r\n${H}\r\n`, [400]],
  ['9110 9.1', 'a method of 10000 letters', `${'G'.repeat(10000)} /healthz HTTP/1.1\r\n${H}\r\n`, [414]],
  ['9110 15.5.6', 'a known method that this path has not', `DELETE /healthz HTTP/1.1\r\n${H}\r\n`, [405, END]],
  ['9110 9.3.7', 'OPTIONS of a path', `OPTIONS /healthz HTTP/1.1\r\n${H}\r\n`, [405, END]],
  ['9110 9.3.7', 'OPTIONS of the server', `OPTIONS * HTTP/1.1\r\n${H}\r\n`, [405, END]],
  ['9110 9.3.8', 'TRACE sends nothing back', `TRACE /healthz HTTP/1.1\r\n${H}X-Secret: 1\r\n\r\n`, [405, END]],
  ['9110 9.3.6', 'CONNECT: no proxy', `CONNECT 127.0.0.1:80 HTTP/1.1\r\n${H}\r\n`, [501]],
  ['9110 9.3.2', 'HEAD', `HEAD /healthz HTTP/1.1\r\n${H}\r\n`, [200, END]],
  ['9110 9.3.2', 'HEAD of nothing', `HEAD /nothing HTTP/1.1\r\n${H}\r\n`, [404, END]],
  ['9112 3.2.2', 'a whole address', get('http://127.0.0.1/healthz'), [200, END]],
  ['9112 3.2.2', 'a whole address without a path', get('http://127.0.0.1'), [200, END]],
  ['9112 3.2.2', 'a whole address with a query alone', get('HTTP://127.0.0.1?x=1'), [200, END]],
  ['9112 3.2.2', 'a whole address without a host', get('http:///healthz'), [400]],
  ['9110 4.2.4', 'a whole address with a user', get('http://a@127.0.0.1/healthz'), [400]],
  ['9112 3.2', 'another scheme', get('ftp://127.0.0.1/healthz'), [400]],
  ['9112 3.2.3', 'authority form without CONNECT', get('127.0.0.1:80'), [400]],
  ['9112 3.2.4', '* without OPTIONS', get('*'), [400]],
  ['9112 3.2', 'a target that is no path', get('healthz'), [400]],
  ['9112 3.2', 'a fragment', get('/healthz#x'), [400]],
  ['9112 3.2', 'a byte over 127', get('/health\xe9'), [400]],
  ['9112 3.2', 'a NUL', get('/healthz\0x'), [400]],
  ['9112 3.2', 'quotation marks', get('/healthz?"x"'), [400]],
  ['3986 2.1', 'a percent sign and nothing', get('/healthz%'), [400]],
  ['3986 2.1', 'a percent sign and one digit', get('/healthz%4'), [400]],
  ['3986 2.1', 'a percent sign and no digits', get('/%zz'), [400]],
  ['3986 2.1', 'a letter in percent form', get('/%68ealthz'), [200, END]],
  ['3986 7.3', 'NUL in percent form', get('/healthz%00x'), [400]],
  ['3986 7.3', 'NUL in percent form in the query', get('/healthz?a=%00'), [400]],
  ['3986 7.3', 'a line end in percent form', get('/healthz%0d%0aX:'), [400]],
  ['3986 7.3', 'a slash in percent form', get('/v1%2fabout'), [400]],
  ['3986 7.3', 'a slash in percent form in the query', get('/healthz?a=%2F'), [200, END]],
  ['3986 7.3', 'no UTF-8', get('/v1/volumes/%ff'), [400]],
  ['9112 3.2', 'no Host', get('/healthz', ''), [400]],
  // Not refused: HTTP/1.0 had none, browsers (whose pages the check of Host is there for) always send it, others may send any.
  ['9112 3.2', 'no Host in HTTP/1.0', get('/healthz', '', 'HTTP/1.0'), [200]],
  ['9112 3.3', 'no Host in HTTP/1.0, kept alive', get('/healthz', 'Connection: keep-alive\r\n', 'HTTP/1.0'), [200, END]],
  ['9112 3.2', 'an empty Host in HTTP/1.0', get('/healthz', 'Host:\r\n', 'HTTP/1.0'), [421]],
  ['9112 3.2', 'two Hosts', get('/healthz', `${H}${H}`), [400]],
  ['9112 3.2', 'two Hosts, one in small letters', get('/healthz', `${H}host: b\r\n`), [400]],
  ['9112 3.2', 'two Hosts in HTTP/1.0', get('/healthz', `${H}${H}`, 'HTTP/1.0'), [400]],
  ['9112 3.2', 'a Host with a blank', get('/healthz', 'Host: a b\r\n'), [400]],
  ['9112 3.2', 'a Host with a path', get('/healthz', 'Host: a/b\r\n'), [400]],
  ['9112 3.2', 'a list of Hosts', get('/healthz', 'Host: a, b\r\n'), [400]],
  ['9112 3.2', 'a Host whose port is no number', get('/healthz', 'Host: 127.0.0.1:x\r\n'), [400]],
  ['9112 3.2', 'a Host with a user', get('/healthz', 'Host: a@127.0.0.1\r\n'), [400]],
  ['9112 5', 'a line without a colon', get('/healthz', `${H}Nothing\r\n`), [400]],
  ['9112 5', 'a line without a name', get('/healthz', `${H}: x\r\n`), [400]],
  ['9112 5.1', 'a blank before the colon', post('Content-Length : 2\r\n', '{}'), [400]],
  ['9112 5.1', 'a tab before the colon', get('/healthz', `${H}X\t: y\r\n`), [400]],
  ['9112 5.1', 'a blank in a name', get('/healthz', `${H}X Y: z\r\n`), [400]],
  ['9110 5.1', 'a name that is no word', get('/healthz', `${H}X(Y): z\r\n`), [400]],
  ['9110 5.1', 'a byte over 127 in a name', get('/healthz', `${H}X\xe9: z\r\n`), [400]],
  ['9110 5.5', 'NUL in a value', get('/healthz', `${H}X: a\0b\r\n`), [400]],
  ['9110 5.5', 'a control character in a value', get('/healthz', `${H}X: a\x01b\r\n`), [400]],
  ['9110 5.5', 'DEL in a value', get('/healthz', `${H}X: a\x7fb\r\n`), [400]],
  ['9110 5.5', 'a tab and bytes over 127 in a value', get('/healthz', `${H}X: a\tb\xe9\r\n`), [200, END]],
  ['9110 5.5', 'an empty value', get('/healthz', `${H}X:\r\n`), [200, END]],
  ['9112 5.1', 'blanks around a value', get('/healthz', 'Host: \t 127.0.0.1 \t \r\n'), [200, END]],
  ['9112 5.2', 'a folded line', get('/healthz', `${H}X: a\r\n b\r\n`), [400]],
  ['9112 5.2', 'a folded length', post('Content-Length:\r\n 2\r\n', '{}'), [400]],
  ['9110 5.4', 'a head over the limit', get('/healthz', `${H}${`X: ${'b'.repeat(1000)}\r\n`.repeat(30)}`), [431]],
  ['9110 5.4', 'one field over the limit', get('/healthz', `${H}X: ${'b'.repeat(100000)}\r\n`), [431]],
  ['9110 5.4', 'too many fields', get('/healthz', `${H}${'X: y\r\n'.repeat(200)}`), [431]],
  ['9110 8.3', 'two types', `POST /v1/render HTTP/1.1\r\n${H}${JSON_TYPE}${JSON_TYPE}Content-Length: 2\r\n\r\n{}`, [400]],
  ['9112 6.2', 'a length', post('Content-Length: 2\r\n', '{}'), [422, END]],
  ['9112 6.2', 'a length with zeros before it', post('Content-Length: 0002\r\n', '{}'), [422, END]],
  ['9112 6.3', 'no length is no body', post(''), [400, END]],
  ['9112 6.3', 'two different lengths', post('Content-Length: 2\r\nContent-Length: 3\r\n', '{}'), [400]],
  ['9112 6.3', 'two equal lengths', post('Content-Length: 2\r\nContent-Length: 2\r\n', '{}'), [400]],
  ['9112 6.3', 'a list of equal lengths', post('Content-Length: 2, 2\r\n', '{}'), [400]],
  ['9112 6.3', 'a list of different lengths', post('Content-Length: 2, 3\r\n', '{}'), [400]],
  ['9110 8.6', 'a negative length', post('Content-Length: -2\r\n', '{}'), [400]],
  ['9110 8.6', 'a length with a sign', post('Content-Length: +2\r\n', '{}'), [400]],
  ['9110 8.6', 'a hexadecimal length', post('Content-Length: 0x2\r\n', '{}'), [400]],
  ['9110 8.6', 'a length and more', post('Content-Length: 2 a\r\n', '{}'), [400]],
  ['9110 8.6', 'an empty length', post('Content-Length:\r\n', '{}'), [400]],
  ['9110 8.6', 'a length that overflows', post('Content-Length: 18446744073709551618\r\n', '{}'), [413]],
  ['9112 6.1', 'a length and chunks', post('Content-Length: 2\r\nTransfer-Encoding: chunked\r\n', '0\r\n\r\n'), [400]],
  ['9112 6.1', 'chunks and a length', post('Transfer-Encoding: chunked\r\nContent-Length: 5\r\n', '0\r\n\r\n'), [400]],
  ['9112 6.1', 'chunks in HTTP/1.0', `POST /v1/render HTTP/1.0\r\n${H}${JSON_TYPE}Transfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n`, [400]],
  ['9112 6.1', 'an unknown coding', post('Transfer-Encoding: gzip, chunked\r\n', '0\r\n\r\n'), [501]],
  ['9112 6.3', 'chunked not last', post('Transfer-Encoding: chunked, gzip\r\n', '0\r\n\r\n'), [400]],
  ['9112 6.1', 'chunked twice', post('Transfer-Encoding: chunked, chunked\r\n', '0\r\n\r\n'), [501]],
  ['9112 6.1', 'chunked in two fields', post('Transfer-Encoding: chunked\r\nTransfer-Encoding: chunked\r\n', '0\r\n\r\n'), [400]],
  ['9112 6.1', 'no chunked', post('Transfer-Encoding: identity\r\n', '{}'), [400]],
  ['9112 6.1', 'an almost chunked', post('Transfer-Encoding: xchunked\r\n', '0\r\n\r\n'), [501]],
  ['9112 6.1', 'a vertical tab before chunked', post('Transfer-Encoding: \x0bchunked\r\n', '0\r\n\r\n'), [400]],
  ['9112 6.1', 'a blank before the colon of the coding', post('Transfer-Encoding : chunked\r\n', '0\r\n\r\n'), [400]],
  ['9112 7', 'chunks', chunked('1\r\n{\r\n1\r\n}\r\n0\r\n\r\n'), [422, END]],
  ['9112 7', 'chunked in capitals', post('Transfer-Encoding: CHUNKED\r\n', '2\r\n{}\r\n0\r\n\r\n'), [422, END]],
  ['9112 7.1', 'zeros before a size', chunked('0000002\r\n{}\r\n000\r\n\r\n'), [422, END]],
  ['9112 7.1.1', 'extensions', chunked('2;a=b;c="d"\r\n{}\r\n0 ;e\r\n\r\n'), [422, END]],
  ['9112 7.1.1', 'extensions without end', chunked(`2;${'a'.repeat(3000)}\r\n{}\r\n0\r\n\r\n`), [400]],
  ['9112 7.1.1', 'many extensions', chunked(`${`1;${'a'.repeat(900)}\r\n \r\n`.repeat(30)}0\r\n\r\n`), [400]],
  ['9112 7.1.2', 'trailers', chunked('2\r\n{}\r\n0\r\nX: y\r\nContent-Length: 7\r\n\r\n'), [422, END]],
  ['9112 7.1.2', 'a trailer that is no field', chunked('2\r\n{}\r\n0\r\nnothing\r\n\r\n'), [400]],
  ['9112 7.1.2', 'trailers without end', chunked(`2\r\n{}\r\n0\r\n${`X: ${'y'.repeat(900)}\r\n`.repeat(30)}\r\n`), [400]],
  ['9112 7.1', 'a size that is no number', chunked('x\r\n{}\r\n0\r\n\r\n'), [400]],
  ['9112 7.1', 'no size', chunked('\r\n{}\r\n0\r\n\r\n'), [400]],
  ['9112 7.1', 'a size with 0x', chunked('0x2\r\n{}\r\n0\r\n\r\n'), [400]],
  ['9112 7.1', 'a negative size', chunked('-2\r\n{}\r\n0\r\n\r\n'), [400]],
  ['9112 7.1', 'a size with a sign', chunked('+2\r\n{}\r\n0\r\n\r\n'), [400]],
  ['9112 7.1', 'a blank before a size', chunked(' 2\r\n{}\r\n0\r\n\r\n'), [400]],
  ['9112 7.1', 'a blank after a size', chunked('2 \r\n{}\r\n0\r\n\r\n'), [400]],
  ['9112 7.1', 'a size ended by LF alone', chunked('2\n{}\r\n0\r\n\r\n'), [400]],
  ['9112 7.1', 'a size that overflows', chunked('10000000000000002\r\n{}\r\n0\r\n\r\n'), [400]],
  ['9112 7.1', 'a chunk longer than its size', chunked('1\r\n{}\r\n0\r\n\r\n'), [400]],
  ['9112 7.1', 'a chunk shorter than its size', chunked('3\r\n{}\r\n0\r\n\r\n'), [400]],
  ['9112 7.1', 'data ended by LF alone', chunked('2\r\n{}\n0\r\n\r\n'), [400]],
  ['9112 6.3', 'a body where none is wanted', `GET /healthz HTTP/1.1\r\n${H}Content-Length: 30\r\n\r\nGET /nothing HTTP/1.1\r\n\r\n12345`, [200, END]],
  ['9112 6.3', 'chunks where none are wanted', `GET /healthz HTTP/1.1\r\n${H}Transfer-Encoding: chunked\r\n\r\n3\r\nabc\r\n0\r\n\r\n`, [200, END]],
  ['9112 6.3', 'a refused body does not become a request', put('Content-Length: 40\r\nContent-Length: 0\r\n\r\n') + last, [400]],
  ['9110 10.1.1', '100-continue', post('Content-Length: 2\r\nExpect: 100-continue\r\n', '{}'), [422, END]],
  ['9110 10.1.1', '100-continue without a body', post('Content-Length: 0\r\nExpect: 100-continue\r\n'), [400, END]],
  ['9110 10.1.1', '100-continue of a GET', get('/healthz', `${H}Expect: 100-continue\r\n`), [200, END]],
  ['9110 10.1.1', 'another expectation', post('Content-Length: 2\r\nExpect: coffee\r\n', '{}'), [417]],
  ['9110 10.1.1', 'an expectation in HTTP/1.0 is ignored', `POST /v1/render HTTP/1.0\r\n${H}${JSON_TYPE}Content-Length: 2\r\nExpect: 100-continue\r\n\r\n{}`, [422]],
  ['9110 7.8', 'an upgrade to something else is ignored', get('/healthz', `${H}Connection: Upgrade\r\nUpgrade: h2c\r\n`), [200, END]],
  ['9112 9.3', 'Connection: close', get('/healthz', `${H}Connection: close\r\n`), [200]],
  ['9112 9.3', 'close in a list', get('/healthz', `${H}Connection: keep-alive, close\r\n`), [200]],
  ['9112 9.3', 'close in the second field', get('/healthz', `${H}Connection: x\r\nConnection: close\r\n`), [200]],
  ['9112 9.3', 'keep-alive in HTTP/1.0', get('/healthz', `${H}Connection: keep-alive\r\n`, 'HTTP/1.0'), [200, END]],
  ['9112 9.3.2', 'a pipeline is answered in order', get() + get('/nothing') + get('/readyz'), [200, 404, 200, END]],
  ['9112 9.3.2', 'a pipeline ends at its first error', get() + get('/healthz', '') + get('/readyz'), [200, 400]],
  ['9112 9.3.2', 'bodies in a pipeline', post('Content-Length: 2\r\n', '{}') + chunked('2\r\n{}\r\n0\r\n\r\n') + get(), [422, 422, 200, END]],
  ['9112 11.2', 'a request in the body of one with two lengths', post('Content-Length: 0\r\nContent-Length: 45\r\n', get()), [400]],
  ['9112 11.2', 'a request behind a last chunk that is none', chunked(`0\r\nX\r\n\r\n${get()}`), [400]],
  ['9112 11.1', 'a line end in a value', get('/healthz', `${H}X: a\r\n\r\nGET /nothing HTTP/1.1\r\n`), [200, 400]],
];

const SHIELD = {
  'cache-control': /^no-store$/, 'content-security-policy': /^default-src 'self'/, 'cross-origin-opener-policy': /^same-origin$/,
  'cross-origin-resource-policy': /^same-origin$/, 'referrer-policy': /^no-referrer$/, 'x-content-type-options': /^nosniff$/,
};
const statusesOf = (found) => found.map(({ status }) => status).filter((status) => status !== 100);

function check([section, what, bytes, wanted], found) {
  const refused = !wanted.includes(END) && wanted.at(-1) >= 400 && wanted.at(-1) !== 422;
  assert.deepEqual(statusesOf(found), wanted.map((status) => (status === END ? 200 : status)), `${section}: ${what}`);
  const end = found[wanted.length - 1 + found.filter(({ status }) => status === 100).length];
  if (refused) {
    assert.match(end.headers['content-type'], /^application\/problem\+json/, what);
    const problem = JSON.parse(end.body);
    assert.equal(problem.status, end.status, what);
    assert.deepEqual(validate(problem, api.components.responses.Problem.content['application/problem+json'].schema, api), [], what);
    for (const [name, value] of Object.entries(SHIELD)) assert.match(end.headers[name] ?? '', value, `${what}: ${name}`);
    assert.equal(end.headers.connection?.toLowerCase(), 'close', what);
  }
}

test(`${rows.length} rows of RFC 9110, 9112 and 3986`, async (t) => {
  for (const row of rows) {
    await t.test(`${row[0]}: ${row[1]}`, async () => {
      const methods = [/^(?:\r\n)*(\S*)/.exec(row[2])[1]];
      const { bytes, closed } = await exchange(d.port, row[2] + last);
      assert.ok(closed, 'the server ends the connection');
      check(row, replies(bytes, methods));
    });
  }
});

// Of the good ones: bytes sent after a refusal would destroy it on its way.
test('every status of a refusal that is here is described, once', () => {
  const described = api.components.schemas.Refusal.properties.status.oneOf.map((entry) => entry.const);
  for (const status of new Set(rows.flatMap(([, , , wanted]) => wanted).filter((one) => one >= 400 && one !== 422)))
    assert.equal(described.filter((one) => one === status).length, 1, `${status}`);
  for (const item of Object.values(api.paths))
    for (const { responses } of Object.values(item).filter((part) => part.responses)) assert.equal(responses.default.$ref, '#/components/responses/Problem');
});

test('one byte at a time the same comes back', async () => {
  const small = rows.filter(([, , bytes, wanted]) => bytes.length < 300 && wanted.includes(END));
  const work = small.values(); // several at once: it is the waiting that takes time
  await Promise.all(Array.from({ length: 8 }, async () => {
    for (const row of work) {
      const { bytes, closed } = await exchange(d.port, row[2] + last, { piece: 1 });
      assert.ok(closed, row[1]);
      check(row, replies(bytes, [/^(?:\r\n)*(\S*)/.exec(row[2])[1]]));
    }
  }));
});

test('9110 9.3.2: HEAD is GET without the body', async () => {
  for (const target of ['/healthz', '/v1/about', '/', '/nothing']) {
    const [head, whole] = replies((await exchange(d.port, `HEAD ${target} HTTP/1.1\r\n${H}\r\n` + get(target, `${H}Connection: close\r\n`))).bytes, ['HEAD', 'GET']);
    assert.equal(head.status, whole.status);
    for (const name of ['content-length', 'content-type', 'etag', 'cache-control']) assert.equal(head.headers[name], whole.headers[name], name);
  }
});

test('9110 10.1.1: who waits for 100 gets it before the body is sent, unless the head is refused', async () => {
  const socket = net.connect(d.port, '127.0.0.1');
  const next = () => new Promise((resolve) => socket.once('data', (bytes) => resolve(bytes.toString('latin1'))));
  socket.write(post('Content-Length: 2\r\nExpect: 100-continue\r\nConnection: close\r\n'));
  assert.match(await next(), /^HTTP\/1\.1 100 Continue\r\n\r\n$/);
  socket.write('{}');
  assert.match(await next(), /^HTTP\/1\.1 422 /);
  socket.destroy();
  const [refused] = replies((await exchange(d.port, put('Content-Length: 900000000000\r\nExpect: 100-continue\r\n\r\n'))).bytes);
  assert.equal(refused.status, 413);
});

test('9110 6.6.1, 10.2.1, 15.5.6: Date, Allow', async () => {
  const [reply] = replies((await exchange(d.port, `DELETE /healthz HTTP/1.1\r\n${H}Connection: close\r\n\r\n`)).bytes);
  assert.equal(reply.headers.allow, 'GET, HEAD');
  assert.ok(Math.abs(Date.parse(reply.headers.date) - Date.now()) < 60000, reply.headers.date);
  assert.match(reply.headers.date, /^\w{3}, \d\d \w{3} \d{4} \d\d:\d\d:\d\d GMT$/);
});

test('9112 3.2.2: the host of a whole address counts, not the Host field', async () => {
  const strict = await Daemon.start({ ball: false, config: '[server]\nhosts=good.example\n' });
  const ask = async (target, host) => replies((await exchange(strict.port, get(target, `Host: ${host}\r\nConnection: close\r\n`))).bytes)[0].status;
  assert.equal(await ask('http://good.example/healthz', 'evil.example'), 200);
  assert.equal(await ask('http://evil.example/healthz', 'good.example'), 421);
  await strict.stop();
});
