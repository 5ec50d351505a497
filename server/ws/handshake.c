#include "server/ws/handshake.h"

#include <glib.h>
#include <string.h>

bool tcs_token_in(const char *list, const char *token, bool fold) {
  const size_t length = strlen(token);
  while (list && *list) {
    list += strspn(list, " \t,");
    size_t size = strcspn(list, ",");
    const char *next = list + size;
    while (size > 0 && (list[size - 1] == ' ' || list[size - 1] == '\t')) size--;
    if (size == length && (fold ? g_ascii_strncasecmp(list, token, size) : strncmp(list, token, size)) == 0)
      return true;
    list = next;
  }
  return false;
}

bool tcs_websocket_key_valid(const char *key) {
  /* 16 bytes are 22 base64 characters plus two of padding. The last character carries 2 bits only; the other 4 are not
   * checked. */
  if (strlen(key) != 24 || strcmp(key + 22, "==") != 0) return false;
  for (int i = 0; i < 22; i++)
    if (!g_ascii_isalnum(key[i]) && key[i] != '+' && key[i] != '/') return false;
  return true;
}

char *tcs_websocket_accept(const char *key) {
  GChecksum *sha1 = g_checksum_new(G_CHECKSUM_SHA1);
  g_checksum_update(sha1, (const guchar *)key, -1);
  g_checksum_update(sha1, (const guchar *)"258EAFA5-E914-47DA-95CA-C5AB0DC85B11", -1);
  guint8 digest[20];
  gsize size = sizeof digest;
  g_checksum_get_digest(sha1, digest, &size);
  g_checksum_free(sha1);
  return g_base64_encode(digest, size);
}
