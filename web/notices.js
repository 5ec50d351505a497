// Messages: toasts that disappear, the reconnect banner, one line under the mode selector.

const TOAST_MS = 7000;
const MOST_TOASTS = 3;

export class Notices {
  #toasts;
  #banner;
  #bannerText;
  #line;
  #countdown = 0;

  constructor({ toasts, banner, bannerText, bannerRetry, line }, onRetry) {
    this.#toasts = toasts;
    this.#banner = banner;
    this.#bannerText = bannerText;
    this.#line = line;
    bannerRetry.addEventListener('click', onRetry);
  }

  /** Repeating a text extends its toast. */
  toast(text, { title = '', bad = false } = {}) {
    const key = `${title}\n${text}`;
    for (const old of this.#toasts.children) if (old.dataset.key === key) old.remove();
    const toast = document.createElement('div');
    toast.className = bad ? 'toast bad' : 'toast';
    toast.dataset.key = key;
    const body = document.createElement('span');
    if (title) body.append(Object.assign(document.createElement('strong'), { textContent: title }));
    body.append(text);
    const close = Object.assign(document.createElement('button'), { textContent: '\u00d7' });
    close.setAttribute('aria-label', 'Dismiss');
    close.addEventListener('click', () => toast.remove());
    toast.append(body, close);
    this.#toasts.append(toast);
    while (this.#toasts.children.length > MOST_TOASTS) this.#toasts.firstChild.remove();
    setTimeout(() => toast.remove(), TOAST_MS);
  }

  /** A refusal by the daemon, or a network error. */
  problem(error) {
    this.toast(error.message, { title: error.title && error.title !== error.message ? error.title : '', bad: true });
  }

  line(text) {
    this.#line.textContent = text;
    this.#line.hidden = !text;
  }

  /** Follows the states of the wire: nothing while open, a countdown while waiting. */
  connection({ state, inMs = 0, reason = '' }) {
    clearInterval(this.#countdown);
    if (state === 'open') this.#banner.hidden = true;
    if (state !== 'waiting') return;
    const due = performance.now() + inMs;
    const tell = () => {
      const seconds = Math.max(0, Math.ceil((due - performance.now()) / 1000));
      this.#bannerText.textContent = `Reconnecting in ${seconds} s: ${reason}. Your scene is kept.`;
    };
    tell();
    this.#banner.hidden = false;
    this.#countdown = setInterval(tell, 250);
  }
}
