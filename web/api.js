// HTTP to the daemon: JSON in and out, RFC 9457 problems as exceptions. URLs are relative to the page's folder, so that
// the client also works behind a proxy that adds a path.

const TOKEN_KEY = 'tomocast.token';

/** A reply other than success. `status` 0: no reply. */
export class Problem extends Error {
  constructor(status, { title, detail, type, pointer } = {}) {
    super(detail || title || `status ${status}`);
    this.status = status;
    this.title = title || '';
    this.type = type || '';
    this.pointer = pointer || '';
  }
}

export class Api {
  #base;
  #asking = null;
  /**
   * (wrong) => Promise of a token, "" = none. Called when the daemon requires a token; wrong: it refused the last one.
   */
  ask = null;

  constructor(base = document.baseURI) {
    this.#base = new URL('./', base);
  }

  get token() {
    return sessionStorage.getItem(TOKEN_KEY) || '';
  }

  set token(token) {
    sessionStorage.setItem(TOKEN_KEY, token);
  }

  url(path) {
    return new URL(path, this.#base);
  }

  /** URL of a WebSocket on the same host. */
  socketUrl(path) {
    const url = this.url(path);
    url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
    return url.href;
  }

  headers() {
    return this.token ? { Authorization: `Bearer ${this.token}` } : {};
  }

  /**
   * Fetches, and asks the user for a token if the daemon requires one.
   * @returns {Promise<Response>} a success
   * @throws {Problem}
   */
  async fetch(method, path, options = {}) {
    for (;;) {
      const { token } = this;
      const reply = await this.#send(method, path, options);
      if (reply.ok) return reply;
      const problem = await problemOf(reply);
      if (reply.status !== 401 || !this.ask || options.keepalive) throw problem;
      if (this.token === token && !(await this.#asked(token !== ''))) throw problem;
    }
  }

  // All calls that need a token wait for the same dialog.
  #asked(wrong) {
    const take = (token) => {
      if (token) this.token = token;
      return token !== '';
    };
    this.#asking ??= this.ask(wrong)
      .then(take)
      .finally(() => (this.#asking = null));
    return this.#asking;
  }

  async #send(method, path, { json, type = 'application/json', ...options }) {
    const headers = this.headers();
    if (json !== undefined) {
      headers['Content-Type'] = type;
      options.body = JSON.stringify(json);
    }
    try {
      return await fetch(this.url(path), { method, headers, cache: 'no-store', ...options });
    } catch (error) {
      if (error.name === 'AbortError') throw error;
      throw new Problem(0, { detail: 'the server does not answer' });
    }
  }

  /** URL of a WebSocket with a one-time ticket instead of the token. */
  async streamUrl(session) {
    const url = new URL(this.socketUrl(`v1/sessions/${encodeURIComponent(session)}/stream`));
    if (!this.token) return url.href;
    const { ticket } = await this.json('POST', 'v1/tickets', { json: { session } });
    url.searchParams.set('ticket', ticket);
    return url.href;
  }

  /** @returns {Promise<object|null>} the reply's JSON, null if it has none */
  async json(method, path, options) {
    const reply = await this.fetch(method, path, options);
    const text = await reply.text();
    return text ? JSON.parse(text) : null;
  }

  /**
   * Uploads a file with progress.
   * @param {(fraction: number) => void} onProgress
   * @returns {{done: Promise<object|null>, cancel: () => void}}
   */
  upload(path, file, onProgress) {
    const request = new XMLHttpRequest();
    const done = new Promise((resolve, reject) => {
      request.open('PUT', this.url(path));
      for (const [name, value] of Object.entries(this.headers())) request.setRequestHeader(name, value);
      request.setRequestHeader('Content-Type', 'application/octet-stream');
      request.upload.onprogress = (event) => event.lengthComputable && onProgress(event.loaded / event.total);
      request.onload = () => {
        if (request.status >= 200 && request.status < 300) resolve(parsed(request.responseText));
        else reject(new Problem(request.status, parsed(request.responseText) ?? {}));
      };
      request.onerror = () => reject(new Problem(0, { detail: 'the connection broke during the upload' }));
      request.onabort = () => reject(new DOMException('cancelled', 'AbortError'));
      request.send(file);
    });
    return { done, cancel: () => request.abort() };
  }
}

function parsed(text) {
  try {
    return JSON.parse(text);
  } catch {
    return null;
  }
}

async function problemOf(reply) {
  const body = parsed(await reply.text().catch(() => ''));
  return new Problem(reply.status, body ?? { title: reply.statusText });
}
