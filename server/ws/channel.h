/* WebSocket framing over any byte pipe, without sockets or time. Wraps wslay and adds limits against hostile peers. One
 * thread. */
#ifndef TCS_WS_CHANNEL_H
#define TCS_WS_CHANNEL_H

#include <glib.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#define TCS_MAX_MESSAGE 65536
/* Backpressure: above this many unsent messages nothing more is read, so that a peer that never reads builds no queue.
 */
#define TCS_MAX_QUEUED 16

typedef struct tcs_channel tcs_channel;

typedef struct tcs_channel_callbacks {
  /* Like recv() and send(): bytes moved, 0 = end of input, -1 with errno EAGAIN = would block, -1 otherwise = broken.
   */
  ssize_t (*receive)(void *user, uint8_t *bytes, size_t size);
  ssize_t (*send)(void *user, const uint8_t *bytes, size_t size, bool more);
  /* A whole text message, not zero-terminated. */
  void (*text)(void *user, const char *bytes, size_t size);
} tcs_channel_callbacks;

/* NULL: out of memory. */
tcs_channel *tcs_channel_new(const tcs_channel_callbacks *callbacks, void *user);
void tcs_channel_free(tcs_channel *channel); /* NULL is fine */

/* Reads until the pipe is empty or the turn's budget is used. False: the pipe is broken. */
bool tcs_channel_read(tcs_channel *channel);
/* Sends queued messages until the pipe is full. False: the pipe is broken. */
bool tcs_channel_write(tcs_channel *channel);

/* Queues a copy of the message. False: the channel is closing, or out of memory. */
bool tcs_channel_send_text(tcs_channel *channel, const char *text);
/* Queues one message of head and body. The body is not copied but referenced until its last byte is sent, so that all
 * viewers share one picture. One such message at a time: false while another is pending, or the channel is closing. */
bool tcs_channel_send_shared(tcs_channel *channel, bool binary, const void *head, size_t head_size, GBytes *body);
bool tcs_channel_ping(tcs_channel *channel);
void tcs_channel_close(tcs_channel *channel, uint16_t code, const char *reason);

bool tcs_channel_wants_read(tcs_channel *channel);
bool tcs_channel_wants_write(tcs_channel *channel);
size_t tcs_channel_queued(tcs_channel *channel); /* messages not sent completely */
bool tcs_channel_closing(tcs_channel *channel);  /* a close frame was queued or received */
bool tcs_channel_done(tcs_channel *channel);     /* the closing handshake is complete */

#endif
