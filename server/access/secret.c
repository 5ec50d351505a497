#include "server/access/secret.h"

#include <glib.h>
#include <string.h>
#include <sys/random.h>

bool tcs_random(void *bytes, size_t size) { return getrandom(bytes, size, 0) == (ssize_t)size; }

void tcs_hash(const char *text, uint8_t hash[TCS_HASH_SIZE]) {
  GChecksum *sum = g_checksum_new(G_CHECKSUM_SHA256);
  gsize size = TCS_HASH_SIZE;
  g_checksum_update(sum, (const guchar *)text, -1);
  g_checksum_get_digest(sum, hash, &size);
  g_checksum_free(sum);
}

void tcs_sign(const void *key, size_t key_size, const char *text, uint8_t mac[TCS_HASH_SIZE]) {
  GHmac *hmac = g_hmac_new(G_CHECKSUM_SHA256, key, key_size);
  gsize size = TCS_HASH_SIZE;
  g_hmac_update(hmac, (const guchar *)text, -1);
  g_hmac_get_digest(hmac, mac, &size);
  g_hmac_unref(hmac);
}

bool tcs_hash_equal(const uint8_t a[TCS_HASH_SIZE], const uint8_t b[TCS_HASH_SIZE]) {
  volatile uint8_t difference = 0; /* volatile: the compiler must not leave the loop early */
  for (size_t i = 0; i < TCS_HASH_SIZE; i++) difference |= a[i] ^ b[i];
  return difference == 0;
}

void tcs_hex(const uint8_t *bytes, size_t size, char *text) {
  static const char digits[] = "0123456789abcdef";
  for (size_t i = 0; i < size; i++) {
    text[2 * i] = digits[bytes[i] >> 4];
    text[2 * i + 1] = digits[bytes[i] & 15];
  }
  text[2 * size] = 0;
}

bool tcs_unhex(const char *text, uint8_t *bytes, size_t size) {
  if (strlen(text) != 2 * size) return false;
  for (size_t i = 0; i < size; i++) {
    const int high = g_ascii_xdigit_value(text[2 * i]), low = g_ascii_xdigit_value(text[2 * i + 1]);
    if (high < 0 || low < 0) return false;
    bytes[i] = (uint8_t)(high << 4 | low);
  }
  return true;
}
