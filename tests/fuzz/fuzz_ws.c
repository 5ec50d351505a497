/* WebSocket bytes as a peer might send them: framing, messages, patches onto a scene, answers. No socket, no renderer.
 */
#include <errno.h>
#include <string.h>

#include "protocol/protocol.h"
#include "server/session/credit.h"
#include "server/ws/channel.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

typedef struct peer {
  const uint8_t *bytes; /* what is left to read */
  size_t size;
  size_t piece; /* the pipe gives at most this many bytes a time, 1..16 */
  size_t sent;
  tcs_channel *channel;
  tcs_credit window;
  tc_scene scene, defaults;
} peer;

static ssize_t on_receive(void *user, uint8_t *bytes, size_t size) {
  peer *p = user;
  size_t count = size < p->piece ? size : p->piece;
  if (count > p->size) count = p->size;
  memcpy(bytes, p->bytes, count);
  p->bytes += count;
  p->size -= count;
  return (ssize_t)count; /* 0 at the end: closed */
}

static ssize_t on_send(void *user, const uint8_t *bytes, size_t size, bool more) {
  peer *p = user;
  if (p->sent++ % 3 == 2) { /* now and then the pipe is full */
    errno = EAGAIN;
    return -1;
  }
  return (ssize_t)(size > 100 ? 100 : size);
}

static void answer(peer *p, const GError *error) {
  cJSON *problem = tcp_problem(error);
  char *text = cJSON_PrintUnformatted(problem);
  if (tcp_problem_status(error) < 400) __builtin_trap();
  tcs_channel_send_text(p->channel, text);
  cJSON_free(text);
  cJSON_Delete(problem);
}

static bool handle(peer *p, const tcp_message *message, GError **error) {
  static const tcp_scene_context context = {-1000, 3000};
  switch (message->type) {
  case TCP_PATCH: return tcp_scene_patch(&p->scene, message->scene, &p->defaults, &context, error);
  case TCP_ACK:
    if (tcs_credit_open(&p->window, 0)) tcs_credit_send(&p->window, 0);
    tcs_credit_ack(&p->window, message->frame, 0);
    if (tcs_credit_pending(&p->window) > 2) __builtin_trap();
    return true;
  case TCP_POINTER:
  case TCP_CANCEL:
  case TCP_PING:
  case TCP_SIZE: return tcs_channel_send_text(p->channel, "{}") || true;
  case TCP_MESSAGE_TYPE_COUNT: break;
  }
  __builtin_trap();
}

static void on_text(void *user, const char *bytes, size_t size) {
  peer *p = user;
  GError *error = NULL;
  tcp_message message = {0};
  if (!tcp_message_parse(bytes, size, &message, &error) || !handle(p, &message, &error)) answer(p, error);
  g_clear_error(&error);
  tcp_message_clear(&message);
}

/* The scene must be one that can be written and read back, whatever was patched onto it. */
static void check_scene(const peer *p) {
  cJSON *document = tcp_scene_write(&p->scene);
  if (!cJSON_IsObject(document)) __builtin_trap();
  cJSON_Delete(document);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  static const tcs_channel_callbacks callbacks = {on_receive, on_send, on_text};
  if (size < 1) return 0;
  peer p = {.bytes = bytes + 1, .size = size - 1, .piece = (bytes[0] & 15u) + 1};
  tc_scene_init(&p.scene);
  tc_scene_init(&p.defaults);
  tcs_credit_init(&p.window, 2);
  p.channel = tcs_channel_new(&callbacks, &p);
  /* Each turn takes a byte at least, or ends; the bound is against a channel that does neither. */
  for (size_t turn = 0; !tcs_channel_done(p.channel); turn++) {
    const bool alive = tcs_channel_read(p.channel);
    for (int i = 0; i < 4 && tcs_channel_wants_write(p.channel); i++) tcs_channel_write(p.channel);
    if (!alive) break;
    if (turn > 4 * size + 100) __builtin_trap();
  }
  check_scene(&p);
  tcs_channel_free(p.channel);
  tc_scene_clear(&p.scene);
  tc_scene_clear(&p.defaults);
  return 0;
}
