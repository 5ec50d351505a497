/* Secrets: made, hashed, signed, and compared in a time that says nothing of where they differ. Any thread. */
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
/* Looks at every byte, whatever it finds. */
bool tcs_hash_equal(const uint8_t a[TCS_HASH_SIZE], const uint8_t b[TCS_HASH_SIZE]);

/* `text` takes 2 * size + 1 bytes. */
void tcs_hex(const uint8_t *bytes, size_t size, char *text);
/* False: not 2 * size digits. */
bool tcs_unhex(const char *text, uint8_t *bytes, size_t size);

#endif
