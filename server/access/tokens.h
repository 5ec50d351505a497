/* The tokens of --token-file. A line is `NAME ROLE TOKEN`, TOKEN either in clear or as "sha256:" and 64 hexadecimal
 * digits; `#` begins a comment line. Only hashes are kept. Reading: any thread; everything else: I/O thread. */
#ifndef TCS_ACCESS_TOKENS_H
#define TCS_ACCESS_TOKENS_H

#include <stddef.h>

#include "renderer/base/error.h"
#include "server/access/role.h"
#include "server/access/secret.h"

#define TCS_TOKEN_LEAST 16 /* characters of a token in clear */
#define TCS_TOKEN_MOST 512
#define TCS_TOKENS_MOST 4096 /* bounds the time of a request, which is compared with every token */

typedef struct tcs_token {
  char name[TCS_NAME_SIZE]; /* for the log; tokens with the same name are the same owner */
  tcs_role role;
  uint8_t hash[TCS_HASH_SIZE];
} tcs_token;

typedef struct tcs_tokens tcs_tokens;

/* NULL on an error, which names the line, never the token. *clear: at least one token is in clear. */
tcs_tokens *tcs_tokens_parse(const char *text, bool *clear, GError **error);
/* Reads a file. Refuses a file that others may write, and a file with tokens in clear that others may read. */
tcs_tokens *tcs_tokens_read(const char *path, GError **error);
void tcs_tokens_free(tcs_tokens *tokens); /* NULL is fine */

/* The token a caller presents; NULL: unknown. Compares with every token, so that the time does not tell which one
 * matched; *compared (may be NULL) counts the comparisons. */
const tcs_token *tcs_tokens_find(const tcs_tokens *tokens, const char *presented, size_t *compared);
/* Whether the caller's token is still in the file, with the same name and role. */
bool tcs_tokens_have(const tcs_tokens *tokens, const tcs_caller *caller);
/* Whether some token has this name, and that role or a higher one. */
bool tcs_tokens_name(const tcs_tokens *tokens, const char *name, tcs_role role);
unsigned tcs_tokens_count(const tcs_tokens *tokens);

#endif
