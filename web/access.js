// Credentials of the user: a token, asked for once, or a share link to one session. Both stay in this tab. A link
// carries its token after the #, which browsers do not send to servers, and the token is removed from the address at
// once.

const LINK = /^([0-9a-f]{32})\.(view|edit)\.\d+\.[0-9a-f]+$/;

/**
 * Parses "#share=TOKEN&volume&view".
 * @returns {{token: string, rest: string}} both "" if the address is not a share link
 */
export function linkIn(hash) {
  const [first, ...rest] = hash.split('&');
  const token = first.startsWith('#share=') ? first.slice('#share='.length) : '';
  return LINK.test(token) ? { token, rest: rest.join('&') } : { token: '', rest: '' };
}

/** @returns {{session: string, role: string}} the contents of a share token; both "" for another token */
export function linked(token) {
  const [, session = '', role = ''] = LINK.exec(token) ?? [];
  return { session, role };
}

/** The dialog that asks for the token. */
export class TokenDialog {
  #get;

  constructor(get) {
    this.#get = get;
  }

  /** @param wrong the last token was refused. @returns {Promise<string>} "" when the user cancels */
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
