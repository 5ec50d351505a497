/* WebSocket framing over any byte pipe: no sockets, no time. Wraps wslay with the limits a hostile peer needs.
 * One thread. */
#ifndef TCS_WS_CHANNEL_H
#define TCS_WS_CHANNEL_H

#include <glib.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#define TCS_MAX_MESSAGE 65536
/* With more answers than this waiting to go out, nothing more is read: a peer that asks and never reads makes no queue.
 */
#define TCS_MAX_QUEUED 16

typedef struct tcs_channel tcs_channel;

typedef struct tcs_channel_callbacks {
  /* Like recv() and send(): bytes moved, 0 = end of input, -1 with errno EAGAIN = not now, -1 otherwise = broken. */
  ssize_t (*receive)(void *user, uint8_t *bytes, size_t size);
  ssize_t (*send)(void *user, const uint8_t *bytes, size_t size, bool more);
  /* A whole text message, not zero-terminated. */
  void (*text)(void *user, const char *bytes, size_t size);
} tcs_channel_callbacks;

/* NULL: out of memory. */
tcs_channel *tcs_channel_new(const tcs_channel_callbacks *callbacks, void *user);
void tcs_channel_free(tcs_channel *channel); /* NULL is fine */

/* Reads until the pipe has nothing more or enough was read for one turn. False: the pipe is broken. */
bool tcs_channel_read(tcs_channel *channel);
/* Sends what waits until the pipe is full. False: the pipe is broken. */
bool tcs_channel_write(tcs_channel *channel);

/* Queue a message; copies it. False: the channel is closing, or out of memory. */
bool tcs_channel_send_text(tcs_channel *channel, const char *text);
/* One message of two parts, of which the body is not copied: it is held by reference until the last byte has gone, so
 * that one picture serves all its viewers. One such message at a time: false while another waits, too. */
bool tcs_channel_send_shared(tcs_channel *channel, bool binary, const void *head, size_t head_size, GBytes *body);
bool tcs_channel_ping(tcs_channel *channel);
void tcs_channel_close(tcs_channel *channel, uint16_t code, const char *reason);

bool tcs_channel_wants_read(tcs_channel *channel);
bool tcs_channel_wants_write(tcs_channel *channel);
size_t tcs_channel_queued(tcs_channel *channel); /* messages not sent completely */
bool tcs_channel_closing(tcs_channel *channel);  /* a close frame was queued or received */
bool tcs_channel_done(tcs_channel *channel);     /* the closing handshake is complete */

#endif
