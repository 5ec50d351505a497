// The calls that need no stream, asked for at fixed times by weight.
import { Trouble } from './target.mjs';

const MOST_OPEN = 64;

const SCENE = { image: { width: 256, height: 256 } };
const CALLS = {
  render: ({ volume }) => ['POST', '/v1/render', { volume, format: 'jpeg', scene: SCENE }],
  frame: ({ session }) => ['GET', `/v1/sessions/${session}/frame?width=128&height=128`],
  volumes: () => ['GET', '/v1/volumes'],
  histogram: ({ volume }) => ['GET', `/v1/volumes/${volume}/histogram?bins=256`],
  value: ({ volume }, n) => ['GET', `/v1/volumes/${volume}/value?at=${n % 40},${n % 30},${n % 20}`],
  pick: ({ session }, n) => ['GET', `/v1/sessions/${session}/pick?x=${n % 128}&y=${(n * 7) % 128}`],
  metrics: () => ['GET', '/metrics'],
};
export const REST_CALLS = Object.keys(CALLS);
export const REST_MIX = 'render=1,frame=2,volumes=4,histogram=2,value=4,pick=2,metrics=1';

/** "render=1,frame=2" -> the calls, each as often as it weighs, spread evenly. @throws {Trouble} */
export function readMix(text) {
  const shares = text.split(',').map((part) => {
    const [name, weight = '1'] = part.trim().split('=');
    const whole = Number(weight);
    if (!CALLS[name]) throw new Trouble(`--mix ${name}: no such call; there are ${REST_CALLS.join(', ')}`);
    if (!Number.isInteger(whole) || whole < 0 || whole > 100) throw new Trouble(`--mix ${part}: a weight is a whole number from 0 to 100`);
    return [name, whole];
  });
  const total = shares.reduce((sum, [, weight]) => sum + weight, 0);
  if (!total) throw new Trouble('--mix: all weights are 0; leave --rest out instead');
  const credit = shares.map(() => 0);
  return Array.from({ length: total }, () => {
    shares.forEach(([, weight], i) => (credit[i] += weight));
    const most = credit.indexOf(Math.max(...credit));
    credit[most] -= total;
    return shares[most][0];
  });
}

export class RestMix {
  samples = new Map(REST_CALLS.map((name) => [name, []])); // ms each
  errors = new Map();
  #open = 0;
  #number = 0;

  constructor({ target, volume, perSecond, mix }) {
    Object.assign(this, { target, volume, perSecond, mix });
  }

  async open() {
    const { id } = await this.target.json('POST', '/v1/sessions', { volume: this.volume, scene: { image: { width: 128, height: 128 } } });
    this.session = id;
  }

  start() { this.timer = setInterval(() => this.#ask(), 1000 / this.perSecond); }

  async close() {
    clearInterval(this.timer);
    await this.target.request('DELETE', `/v1/sessions/${this.session}`, { patienceMs: 2000 }).catch(() => {});
  }

  async #ask() {
    const name = this.mix[this.#number % this.mix.length];
    if (this.#open >= MOST_OPEN) return this.#fail(`rest ${name}: not asked, ${MOST_OPEN} are open`);
    this.#open++;
    const [method, path, json] = CALLS[name](this, this.#number++);
    try {
      const { status, ms } = await this.target.request(method, path, { json });
      if (status >= 400) this.#fail(`rest ${name}: ${status}`);
      else this.samples.get(name).push(ms);
    } catch (error) {
      this.#fail(`rest ${name}: ${error.code ?? error.message}`);
    } finally {
      this.#open--;
    }
  }

  #fail(kind) { this.errors.set(kind, (this.errors.get(kind) ?? 0) + 1); }
}
