/* The pure part of the WebSocket opening handshake (RFC 6455, section 4). */
#ifndef TCS_WS_HANDSHAKE_H
#define TCS_WS_HANDSHAKE_H

#include <stdbool.h>

#define TCS_SUBPROTOCOL "tomocast.v1"

/* True if the comma-separated header value holds `token`, case ignored when `fold`. `list` may be NULL. */
bool tcs_token_in(const char *list, const char *token, bool fold);

/* A Sec-WebSocket-Key is 16 bytes in base64. */
bool tcs_websocket_key_valid(const char *key);
/* Sec-WebSocket-Accept for a key; g_malloc'ed. */
char *tcs_websocket_accept(const char *key);

#endif
