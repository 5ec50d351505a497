/* Any bytes through the JSON reader. What it accepts must survive printing and reading again, and a merge with itself.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/protocol.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  GError *error = NULL;
  cJSON *value = tcp_json_parse((const char *)bytes, size, &error);
  if (!value) {
    if (!error || !error->message || error->code != TC_ERROR_SYNTAX) abort();
    g_error_free(error);
    return 0;
  }
  char *text = cJSON_PrintUnformatted(value);
  cJSON *again = text ? tcp_json_parse(text, strlen(text), NULL) : NULL;
  if (!again || !cJSON_Compare(value, again, true)) abort();
  tcp_merge_patch(&again, value);
  cJSON_Delete(again);
  cJSON_free(text);
  cJSON_Delete(value);
  return 0;
}
