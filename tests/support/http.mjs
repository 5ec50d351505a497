// HTTP over a bare socket: sends requests byte for byte and parses the replies.
import assert from 'node:assert/strict';
import net from 'node:net';

/**
 * Parses the replies in `bytes`: each {status, headers, body}. `methods`: of the requests, since replies to HEAD have
 * no body.
 */
export function replies(bytes, methods = []) {
  const found = [];
  for (let at = 0; at < bytes.length;) {
    const end = bytes.indexOf('\r\n\r\n', at);
    assert.ok(end >= 0, `no reply: ${bytes.subarray(at, at + 80)}`);
    const [line, ...rows] = bytes.subarray(at, end).toString('latin1').split('\r\n');
    assert.match(line, /^HTTP\/1\.1 \d{3} /);
    const headers = Object.fromEntries(rows.map((row) => [row.slice(0, row.indexOf(':')).toLowerCase(), row.slice(row.indexOf(':') + 1).trim()]));
    const status = Number(line.slice(9, 12));
    const none = status < 200 || status === 204 || status === 304 || methods[found.filter((r) => r.status >= 200).length] === 'HEAD';
    at = end + 4;
    const size = none ? 0 : Number(headers['content-length'] ?? bytes.length - at);
    found.push({ status, headers, body: bytes.subarray(at, at + size) });
    at += size;
  }
  return found;
}

/** Sends `bytes`, in pieces of `piece` if given, and reads until the server closes. @returns {{bytes, closed}} */
export function exchange(port, bytes, { piece = 0, patienceMs = 20000 } = {}) {
  return new Promise((resolve) => {
    const socket = net.connect(port, '127.0.0.1');
    const pieces = [];
    const done = (closed) => { clearTimeout(timer); socket.destroy(); resolve({ bytes: Buffer.concat(pieces), closed }); };
    const timer = setTimeout(() => done(false), patienceMs);
    socket.setNoDelay(true);
    socket.on('data', (data) => pieces.push(data));
    socket.on('error', () => done(true));
    socket.on('close', () => done(true));
    const all = Buffer.isBuffer(bytes) ? bytes : Buffer.from(bytes, 'latin1');
    if (!piece) return void socket.write(all);
    let at = 0;
    const next = () => {
      if (at >= all.length || socket.destroyed) return;
      socket.write(all.subarray(at, at += piece));
      setImmediate(next);
    };
    next();
  });
}
