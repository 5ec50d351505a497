/* Any bytes as a WebSocket message, and as a "--set" expression. */
#include <stdint.h>
#include <stdlib.h>

#include "protocol/protocol.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static void expression(const uint8_t *bytes, size_t size) {
  GError *error = NULL;
  char *text = g_strndup((const char *)bytes, size);
  cJSON *patch = tcp_scene_set_expression(text, &error);
  if (!patch == !error) abort();
  g_clear_error(&error);
  cJSON_Delete(patch);
  g_free(text);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  tcp_message message;
  GError *error = NULL;
  bool good = tcp_message_parse((const char *)bytes, size, &message, &error);
  if (good != !error || (!good && message.scene)) abort();
  if (good && (message.type == TCP_PATCH) != (message.scene != NULL)) abort();
  g_clear_error(&error);
  tcp_message_clear(&message);
  expression(bytes, size);
  return 0;
}
