/* The tokens of --token-file. A line is `NAME ROLE TOKEN`, TOKEN either in clear or as "sha256:" and 64 hexadecimal
 * digits; `#` begins a comment line. Only hashes are kept. Reading is any thread's, all else the I/O thread's. */
#ifndef TCS_ACCESS_TOKENS_H
#define TCS_ACCESS_TOKENS_H

#include <stddef.h>

#include "renderer/base/error.h"
#include "server/access/role.h"
#include "server/access/secret.h"

#define TCS_TOKEN_LEAST 16 /* characters of a token in clear */
#define TCS_TOKEN_MOST 512
#define TCS_TOKENS_MOST 4096 /* each request is compared with all of them */

typedef struct tcs_token {
  char name[TCS_NAME_SIZE]; /* for the log; two tokens of one name are one owner */
  tcs_role role;
  uint8_t hash[TCS_HASH_SIZE];
} tcs_token;

typedef struct tcs_tokens tcs_tokens;

/* NULL: the error names the line, never the token. *clear: some token stands there in clear. */
tcs_tokens *tcs_tokens_parse(const char *text, bool *clear, GError **error);
/* Reads a file. One that others may write, or that holds tokens in clear and others may read, is refused. */
tcs_tokens *tcs_tokens_read(const char *path, GError **error);
void tcs_tokens_free(tcs_tokens *tokens); /* NULL is fine */

/* The token a caller presents; NULL: none of these. Compares with all of them, whichever it is; *compared (may be
 * NULL) counts them. */
const tcs_token *tcs_tokens_find(const tcs_tokens *tokens, const char *presented, size_t *compared);
/* Whether the token a caller came by is still there, with the name and the role it had. */
bool tcs_tokens_have(const tcs_tokens *tokens, const tcs_caller *caller);
/* Whether some token has this name. */
bool tcs_tokens_name(const tcs_tokens *tokens, const char *name);
unsigned tcs_tokens_count(const tcs_tokens *tokens);

#endif
