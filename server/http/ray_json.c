#include "server/http/ray_json.h"

#include "renderer/reference/reference.h"

static cJSON *sample_json(const tc_reference_sample *s) {
  cJSON *json = cJSON_CreateObject();
  cJSON_AddItemToObject(json, "position", cJSON_CreateDoubleArray(s->position, 3));
  cJSON_AddNumberToObject(json, "depth", s->distance_mm);
  cJSON_AddNumberToObject(json, "length", s->length_mm);
  cJSON_AddNumberToObject(json, "value", s->value);
  cJSON_AddItemToObject(json, "color", cJSON_CreateDoubleArray(s->color, 3));
  cJSON_AddNumberToObject(json, "extinction", s->extinction);
  cJSON_AddNumberToObject(json, "transparency", s->transparency);
  return json;
}

/* Takes the document. Written piece by piece: a ray may have 60,000, and as one tree they take ten times their text. */
static void append(GString *text, cJSON *json) {
  char *piece = cJSON_PrintUnformatted(json);
  g_string_append(text, piece ? piece : "null");
  cJSON_free(piece);
  cJSON_Delete(json);
}

static char *write_ray(const double rgba[4], const tc_reference_sample *samples, size_t count,
                       const atomic_bool *cancel) {
  GString *text = g_string_new("{\"color\":");
  append(text, cJSON_CreateDoubleArray(rgba, 3));
  g_string_append(text, ",\"opacity\":");
  append(text, cJSON_CreateNumber(rgba[3]));
  g_string_append(text, ",\"samples\":[");
  for (size_t i = 0; i < count && !(cancel && atomic_load(cancel)); i++) {
    if (i) g_string_append_c(text, ',');
    append(text, sample_json(&samples[i]));
  }
  g_string_append(text, "]}");
  return g_string_free(text, FALSE);
}

char *tcs_ray_json(tc_volume *volume, tc_volume *labels, const tc_scene *scene, const int pixel[2],
                   const atomic_bool *cancel, GError **error) {
  const double x = pixel[0] + 0.5, y = pixel[1] + 0.5;
  const tc_reference_request of = {.volume = volume,
                                   .labels = labels,
                                   .scene = scene,
                                   .width = scene->image.width,
                                   .height = scene->image.height,
                                   .cancel = cancel};
  tc_reference *r = tc_reference_make(&of, error);
  if (!r) return NULL;
  tc_reference_sample *samples = NULL;
  size_t count = 0;
  double rgba[4];
  tc_reference_ray(r, x, y, &samples, &count);
  tc_reference_pixel(r, x, y, rgba);
  char *text = write_ray(rgba, samples, count, cancel);
  g_free(samples);
  tc_reference_free(r);
  if (!cancel || !atomic_load(cancel)) return text;
  g_free(text);
  tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
  return NULL;
}
