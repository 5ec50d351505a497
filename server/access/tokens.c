#include "server/access/tokens.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "server/config/config.h"

#define MAX_FILE (1 << 20)

struct tcs_tokens {
  GArray *list; /* tcs_token */
};

/* The characters a bearer token may have (RFC 6750, section 2.1). */
static bool token_spelled(const char *token) {
  const size_t length = strlen(token);
  if (length < TCS_TOKEN_LEAST || length > TCS_TOKEN_MOST) return false;
  for (const char *c = token; *c; c++)
    if (!g_ascii_isalnum(*c) && !strchr("-._~+/=", *c)) return false;
  return true;
}

static const char *read_secret(const char *text, tcs_token *token, bool *clear) {
  if (g_str_has_prefix(text, "sha256:")) {
    if (tcs_unhex(text + strlen("sha256:"), token->hash, TCS_HASH_SIZE)) return NULL;
    return "after sha256: give 64 hexadecimal digits";
  }
  if (!token_spelled(text))
    return "a token is 16 to 512 of letters, digits and -._~+/= (openssl rand -hex 32 makes one)";
  tcs_hash(text, token->hash);
  *clear = true;
  return NULL;
}

/* NULL, or an error text. */
static const char *read_line(char **fields, tcs_token *token, bool *clear) {
  if (g_strv_length(fields) != 3) return "give NAME ROLE TOKEN";
  if (!tcs_id_valid(fields[0])) return "a name is 1 to 64 of letters, digits, '.', '_', '-'";
  g_strlcpy(token->name, fields[0], sizeof token->name);
  if (!tcs_role_parse(fields[1], &token->role)) return "a role is view, edit or admin";
  return read_secret(fields[2], token, clear);
}

static bool take_line(tcs_tokens *tokens, const char *line, bool *clear, const char **fault) {
  char **fields = g_strsplit_set(line, " \t\r", -1), **end = fields;
  for (char **field = fields; *field; field++) { /* several blanks make empty fields */
    if (**field)
      *end++ = *field;
    else
      g_free(*field);
  }
  *end = NULL;
  tcs_token token = {0};
  *fault = NULL;
  if (fields[0] && fields[0][0] != '#') {
    *fault = read_line(fields, &token, clear);
    for (guint i = 0; !*fault && i < tokens->list->len; i++)
      if (tcs_hash_equal(g_array_index(tokens->list, tcs_token, i).hash, token.hash))
        *fault = "this token stands in an earlier line";
    if (!*fault && tokens->list->len == TCS_TOKENS_MOST) *fault = "there are 4096 tokens before it, which is the most";
    if (!*fault) g_array_append_val(tokens->list, token);
  }
  g_strfreev(fields);
  return *fault == NULL;
}

tcs_tokens *tcs_tokens_parse(const char *text, bool *clear, GError **error) {
  tcs_tokens *tokens = g_new0(tcs_tokens, 1);
  tokens->list = g_array_new(FALSE, FALSE, sizeof(tcs_token));
  char **lines = g_strsplit(text, "\n", -1);
  const char *fault = NULL;
  guint at = 0;
  *clear = false;
  while (lines[at] && take_line(tokens, lines[at], clear, &fault)) at++;
  g_strfreev(lines);
  if (fault)
    tc_set_error(error, TC_ERROR_INVALID, NULL, "line %u: %s", at + 1, fault);
  else if (tokens->list->len == 0)
    tc_set_error(error, TC_ERROR_INVALID, NULL, "there is no token in it; give lines of NAME ROLE TOKEN");
  else
    return tokens;
  tcs_tokens_free(tokens);
  return NULL;
}

/* Reads an open file as text, NUL-terminated. NULL: see errno. */
static char *read_all(int fd, size_t size) {
  char *text = g_malloc(size + 1);
  size_t done = 0;
  ssize_t got = 1;
  while (done < size && (got = read(fd, text + done, size - done)) > 0) done += (size_t)got;
  text[done] = 0;
  if (got >= 0) return text;
  g_free(text);
  return NULL;
}

static tcs_tokens *read_open(int fd, GError **error) {
  struct stat info;
  bool clear;
  if (fd < 0 || fstat(fd, &info) != 0) {
    tc_set_error(error, TC_ERROR_IO, NULL, "%s", g_strerror(errno));
    return NULL;
  }
  if (!S_ISREG(info.st_mode) || info.st_size > MAX_FILE) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "give a file of at most 1 MiB");
    return NULL;
  }
  char *text = read_all(fd, (size_t)info.st_size);
  if (!text) {
    tc_set_error(error, TC_ERROR_IO, NULL, "%s", g_strerror(errno));
    return NULL;
  }
  tcs_tokens *tokens = tcs_tokens_parse(text, &clear, error);
  memset(text, 0, strlen(text));
  g_free(text);
  if (!tokens || !(info.st_mode & (clear ? S_IRWXG | S_IRWXO : S_IWGRP | S_IWOTH))) return tokens;
  tc_set_error(error, TC_ERROR_INVALID, NULL, "others may %s it; chmod 600 it%s", clear ? "read" : "write",
               clear ? ", or give the tokens as sha256:HEX" : "");
  tcs_tokens_free(tokens);
  return NULL;
}

tcs_tokens *tcs_tokens_read(const char *path, GError **error) {
  const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  tcs_tokens *tokens = read_open(fd, error);
  if (fd >= 0) close(fd);
  if (!tokens) g_prefix_error(error, "--token-file %s: ", path);
  return tokens;
}

void tcs_tokens_free(tcs_tokens *tokens) {
  if (!tokens) return;
  g_array_unref(tokens->list);
  g_free(tokens);
}

static const tcs_token *find_hash(const tcs_tokens *tokens, const uint8_t hash[TCS_HASH_SIZE], size_t *compared) {
  const guint count = tokens->list->len;
  guint found = count, i;
  for (i = 0; i < count; i++) {
    const guint mask = 0u - (guint)tcs_hash_equal(g_array_index(tokens->list, tcs_token, i).hash, hash);
    found = (i & mask) | (found & ~mask);
  }
  if (compared) *compared = i;
  return found < count ? &g_array_index(tokens->list, tcs_token, found) : NULL;
}

const tcs_token *tcs_tokens_find(const tcs_tokens *tokens, const char *presented, size_t *compared) {
  uint8_t hash[TCS_HASH_SIZE];
  tcs_hash(presented, hash);
  return find_hash(tokens, hash, compared);
}

bool tcs_tokens_have(const tcs_tokens *tokens, const tcs_caller *caller) {
  const tcs_token *token = find_hash(tokens, caller->token, NULL);
  return token && token->role == caller->role && strcmp(token->name, caller->name) == 0;
}

bool tcs_tokens_name(const tcs_tokens *tokens, const char *name, tcs_role role) {
  for (guint i = 0; i < tokens->list->len; i++) {
    const tcs_token *token = &g_array_index(tokens->list, tcs_token, i);
    if (token->role >= role && strcmp(token->name, name) == 0) return true;
  }
  return false;
}

unsigned tcs_tokens_count(const tcs_tokens *tokens) { return tokens->list->len; }
