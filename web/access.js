// Who the user is to the daemon: a token, asked for once, or a link to one session. Both stay in this tab and out of
// addresses: what stands after a # is sent to nobody, and leaves the address bar at once.

const LINK = /^([0-9a-f]{32})\.(view|edit)\.\d+\.[0-9a-f]+$/;

/** "#share=TOKEN&volume&view" @returns {{token: string, rest: string}} of a share link; both "" of another address */
export function linkIn(hash) {
  const [first, ...rest] = hash.split('&');
  const token = first.startsWith('#share=') ? first.slice('#share='.length) : '';
  return LINK.test(token) ? { token, rest: rest.join('&') } : { token: '', rest: '' };
}

/** @returns {{session: string, role: string}} what a token says of itself; both "" when it is no link's */
export function linked(token) {
  const [, session = '', role = ''] = LINK.exec(token) ?? [];
  return { session, role };
}

/** Asks for the token. */
export class TokenDialog {
  #get;

  constructor(get) {
    this.#get = get;
  }

  /** @param wrong the last one was refused. @returns {Promise<string>} "" when the user turns away */
  ask(wrong) {
    const dialog = this.#get('token-dialog');
    const input = this.#get('token');
    this.#get('token-problem').hidden = !wrong;
    input.setAttribute('aria-invalid', String(wrong));
    dialog.returnValue = '';
    dialog.showModal();
    return new Promise((resolve) => {
      const done = () => {
        const token = dialog.returnValue === 'use' ? input.value.trim() : '';
        input.value = '';
        resolve(token);
      };
      dialog.addEventListener('close', done, { once: true });
    });
  }
}
