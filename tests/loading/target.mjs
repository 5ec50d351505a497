// The daemon under load: HTTP and the stream, over bare sockets so that every second is ours to measure.
import http from 'node:http';
import https from 'node:https';
import net from 'node:net';
import tls from 'node:tls';

import { handshake, Ws } from '../support/ws.mjs';

const PATIENCE_MS = 15000;

/** What a person can mend: printed as one line without a trace. */
export class Trouble extends Error {}

export class Target {
  /** @param base address of the daemon, with the path of a proxy if there is one  @param token for `Authorization` */
  constructor(base, token = '') {
    this.base = new URL(base.endsWith('/') ? base : `${base}/`);
    this.token = token;
    this.secure = this.base.protocol === 'https:';
    this.host = this.base.hostname.replace(/^\[|\]$/g, '');
    this.port = Number(this.base.port || (this.secure ? 443 : 80));
    this.agent = new (this.secure ? https : http).Agent({ keepAlive: true, maxSockets: 64 });
  }

  path(path) { return this.base.pathname.replace(/\/$/, '') + path; }

  /** A bare connection. */
  connect() {
    const where = { host: this.host, port: this.port };
    return this.secure ? tls.connect({ ...where, servername: this.host }) : net.connect(where);
  }

  /** The same as a proxy passes it on from this address. */
  from(address) { return Object.assign(Object.create(Target.prototype), this, { address }); }

  headers() {
    return { ...(this.token && { Authorization: `Bearer ${this.token}` }), ...(this.address && { 'X-Forwarded-For': this.address }) };
  }

  /** One exchange. `fresh`: on a connection of its own. @returns {{status, headers, bytes, ms}} */
  request(method, path, { json, body, type, headers = {}, fresh = false, patienceMs = PATIENCE_MS } = {}) {
    const payload = json === undefined ? body : JSON.stringify(json);
    const all = { ...this.headers(), ...headers };
    if (payload !== undefined) {
      all['Content-Type'] = type ?? 'application/json';
      all['Content-Length'] = Buffer.byteLength(payload);
    }
    const options = {
      host: this.host, port: this.port, method, path: this.path(path), headers: { ...all, Host: this.base.host },
      agent: fresh ? false : this.agent,
    };
    return new Promise((resolve, reject) => {
      const began = performance.now();
      const request = (this.secure ? https : http).request(options, (reply) => {
        const pieces = [];
        reply.on('data', (piece) => pieces.push(piece));
        reply.on('error', fail);
        reply.on('end', () => {
          clearTimeout(late);
          resolve({ status: reply.statusCode, headers: reply.headers, bytes: Buffer.concat(pieces), ms: performance.now() - began });
        });
      });
      const fail = (error) => { clearTimeout(late); reject(error); };
      const late = setTimeout(() => request.destroy(Object.assign(new Error('no answer'), { code: 'ETIMEDOUT' })), patienceMs);
      request.on('error', fail);
      request.end(payload);
    });
  }

  /** A reply's JSON. @throws {Trouble} when there is none or it is a problem */
  async json(method, path, json, options = {}) {
    let reply;
    try {
      reply = await this.request(method, path, { json, ...options });
    } catch (error) {
      throw new Trouble(explain(error, this.base));
    }
    if (reply.status >= 400) throw new Trouble(refusal(method, path, reply));
    return reply.bytes.length ? JSON.parse(reply.bytes) : null;
  }

  /** The stream of a session, as the page opens it. `onMessage` takes every {header, image} and every text. */
  async stream(session, { onMessage, patienceMs = PATIENCE_MS } = {}) {
    let socket;
    const opening = handshake(this.port, this.path(`/v1/sessions/${session}/stream`), {
      headers: { Host: this.base.host, Origin: this.base.origin, ...this.headers() },
      connect: () => (socket = this.connect()),
    });
    const late = setTimeout(() => socket.destroy(Object.assign(new Error('no answer'), { code: 'ETIMEDOUT' })), patienceMs);
    try {
      const reply = await opening;
      if (reply.status === 101) return new Ws(reply.socket, reply.rest, { autoAck: false, onMessage });
      reply.socket.destroy();
      throw new Trouble(refusal('GET', '/v1/sessions/ID/stream', { ...reply, bytes: reply.rest }));
    } catch (error) {
      throw error instanceof Trouble ? error : new Trouble(explain(error, this.base));
    } finally {
      clearTimeout(late);
    }
  }

  close() { this.agent.destroy(); }
}

/** Is this host the machine we run on? Then /proc can be read. */
export const isLoopback = (base) => /^(localhost|127\.|\[?::1)/.test(base.hostname);

function explain(error, base) {
  const where = base.origin;
  switch (error.code) {
    case 'ECONNREFUSED': return `nothing listens on ${where}: start the daemon there, or leave --url out to have one started`;
    case 'ENOTFOUND': case 'EAI_AGAIN': return `no host of the name ${base.hostname}: correct --url`;
    case 'ETIMEDOUT': return `${where} does not answer: is it a Tomocast, and is it alive? Try ${where}/healthz`;
    case 'ECONNRESET': return `${where} closed the connection: does --url say https where it wants it?`;
    default: return `${where}: ${error.message || error.code}`;
  }
}

function refusal(method, path, { status, bytes }) {
  let detail = '';
  try {
    const problem = JSON.parse(bytes);
    detail = ` (${problem.detail ?? problem.title})`;
  } catch { /* not a problem of ours: the status says what there is to say */ }
  const mends = { 401: ': give --token', 403: ': give the token of a role that may', 404: ': is it a Tomocast of this version?',
    421: ': name the host as the daemon knows it, or add it to its `hosts`', 503: ': it is full, or still starting' };
  return `${method} ${path} is answered ${status}${detail}${mends[status] ?? ''}`;
}
