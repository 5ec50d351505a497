/* A connection's bytes through the strict reader, in pieces: what comes out does not depend on the pieces, and is by
 * the book itself, so that reading it again changes nothing. No socket, no library. */
#include <string.h>

#include "server/http/strict.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

typedef struct result {
  GByteArray *out;
  unsigned heads;
  int status;
} result;

static result run(const uint8_t *bytes, size_t size, size_t piece) {
  result r = {.out = g_byte_array_new()};
  tcs_strict *strict = tcs_strict_new();
  uint8_t room[61];
  for (size_t at = 0; at < size && tcs_strict_hungry(strict); at += piece) {
    tcs_strict_give(strict, bytes + at, MIN(piece, size - at));
    for (size_t got; (got = tcs_strict_take(strict, room, sizeof room)) > 0;)
      g_byte_array_append(r.out, room, (guint)got);
  }
  r.heads = tcs_strict_heads(strict);
  r.status = tcs_strict_refusal(strict) ? tcs_strict_refusal(strict)->status : 0;
  if (r.status && (r.status < 400 || r.status > 599)) __builtin_trap();
  tcs_strict_free(strict);
  return r;
}

static bool same(const result *a, const result *b) {
  return a->heads == b->heads && a->out->len == b->out->len &&
         (a->out->len == 0 || memcmp(a->out->data, b->out->data, a->out->len) == 0);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  if (size < 1) return 0;
  const result whole = run(bytes + 1, size - 1, size);
  const result pieces = run(bytes + 1, size - 1, (bytes[0] & 15u) + 1);
  const result again = run(whole.out->data, whole.out->len, size);
  if (!same(&whole, &pieces) || whole.status != pieces.status) __builtin_trap();
  if (!same(&whole, &again) || again.status) __builtin_trap();
  g_byte_array_unref(whole.out);
  g_byte_array_unref(pieces.out);
  g_byte_array_unref(again.out);
  return 0;
}
