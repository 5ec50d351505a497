/* Any JSON as a scene patch. A refused patch changes nothing and says why; an accepted scene, written, is accepted
 * again and is then the same. */
#include <stdint.h>
#include <stdlib.h>

#include "protocol/protocol.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static void check_refusal(const GError *error, const tc_scene *scene, const cJSON *before) {
  cJSON *after = tcp_scene_write(scene);
  if (!error || !tc_error_pointer(error) || !g_utf8_validate(error->message, -1, NULL)) abort();
  if (!cJSON_Compare(before, after, true)) abort();
  cJSON *problem = tcp_problem(error);
  cJSON_Delete(problem);
  cJSON_Delete(after);
}

static void check_round_trip(const tc_scene *scene, const tc_scene *defaults, const tcp_scene_context *context) {
  tc_scene copy;
  cJSON *written = tcp_scene_write(scene);
  tc_scene_copy(&copy, defaults);
  if (!tcp_scene_patch(&copy, written, defaults, context, NULL)) abort();
  cJSON *again = tcp_scene_write(&copy);
  if (!cJSON_Compare(written, again, true)) abort();
  cJSON_Delete(again);
  cJSON_Delete(written);
  tc_scene_clear(&copy);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  const tcp_scene_context context = {-1024, 3071};
  cJSON *patch = tcp_json_parse((const char *)bytes, size, NULL);
  if (!patch) return 0;
  tc_scene scene, defaults;
  GError *error = NULL;
  tc_scene_init(&scene);
  tc_scene_init(&defaults);
  cJSON *before = tcp_scene_write(&scene);
  if (!tcp_scene_patch(&scene, patch, &defaults, &context, &error))
    check_refusal(error, &scene, before);
  else
    check_round_trip(&scene, &defaults, &context);
  g_clear_error(&error);
  cJSON_Delete(before);
  cJSON_Delete(patch);
  tc_scene_clear(&scene);
  tc_scene_clear(&defaults);
  return 0;
}
