/* Secrets: random bytes, hashes, signatures, and a comparison in constant time. Any thread. */
#ifndef TCS_ACCESS_SECRET_H
#define TCS_ACCESS_SECRET_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define TCS_HASH_SIZE 32

/* False: the system has no random numbers. */
bool tcs_random(void *bytes, size_t size);
/* SHA-256 of a text. */
void tcs_hash(const char *text, uint8_t hash[TCS_HASH_SIZE]);
/* HMAC-SHA256 (RFC 2104). */
void tcs_sign(const void *key, size_t key_size, const char *text, uint8_t mac[TCS_HASH_SIZE]);
/* Constant time: reads every byte, wherever the first difference is. */
bool tcs_hash_equal(const uint8_t a[TCS_HASH_SIZE], const uint8_t b[TCS_HASH_SIZE]);

/* `text` holds 2 * size + 1 bytes. */
void tcs_hex(const uint8_t *bytes, size_t size, char *text);
/* False: text is not 2 * size hexadecimal digits. */
bool tcs_unhex(const char *text, uint8_t *bytes, size_t size);

#endif
