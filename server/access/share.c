#include "server/access/share.h"

#include <glib.h>
#include <string.h>

#include "server/access/secret.h"

#define MAC_TEXT (2 * TCS_HASH_SIZE + 1)

void tcs_share_sign(const uint8_t key[TCS_SHARE_KEY_SIZE], const char *session, tcs_role role, int64_t until_s,
                    char token[TCS_SHARE_SIZE]) {
  uint8_t mac[TCS_HASH_SIZE];
  char text[MAC_TEXT];
  g_snprintf(token, TCS_SHARE_SIZE, "%s.%s.%" G_GINT64_FORMAT, session, tcs_role_name(role), (gint64)until_s);
  tcs_sign(key, TCS_SHARE_KEY_SIZE, token, mac);
  tcs_hex(mac, sizeof mac, text);
  g_strlcat(token, ".", TCS_SHARE_SIZE);
  g_strlcat(token, text, TCS_SHARE_SIZE);
}

/* Verifies the signature before any field of the token is parsed. */
static bool signed_by(const uint8_t key[TCS_SHARE_KEY_SIZE], const char *token, const char *dot) {
  uint8_t given[TCS_HASH_SIZE], right[TCS_HASH_SIZE];
  char *before = g_strndup(token, (size_t)(dot - token));
  tcs_sign(key, TCS_SHARE_KEY_SIZE, before, right);
  g_free(before);
  return tcs_unhex(dot + 1, given, sizeof given) && tcs_hash_equal(given, right);
}

bool tcs_share_check(const uint8_t key[TCS_SHARE_KEY_SIZE], const char *token, int64_t now_s, tcs_caller *caller) {
  const char *dot = strrchr(token, '.');
  if (!dot || strlen(token) >= TCS_SHARE_SIZE || !signed_by(key, token, dot)) return false;
  char **parts = g_strsplit(token, ".", 4);
  tcs_caller found = {0};
  bool good = g_strv_length(parts) == 4 && tcs_role_parse(parts[1], &found.role);
  if (good) {
    g_strlcpy(found.session, parts[0], sizeof found.session);
    /* All links to one session count as one client. */
    g_snprintf(found.name, sizeof found.name, "share-%.8s", found.session);
    found.until_s = g_ascii_strtoll(parts[2], NULL, 10);
    good = found.until_s > now_s;
  }
  if (good) *caller = found;
  g_strfreev(parts);
  return good;
}
