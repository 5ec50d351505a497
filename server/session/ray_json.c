#include "server/session/ray_json.h"

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

cJSON *tcs_ray_json(tc_volume *volume, tc_volume *labels, const tc_scene *scene, int x, int y, GError **error) {
  tc_reference *r = tc_reference_new_labelled(volume, labels, scene, scene->image.width, scene->image.height, 0, error);
  if (!r) return NULL;
  tc_reference_sample *samples = NULL;
  size_t count = 0;
  double rgba[4];
  tc_reference_ray(r, x + 0.5, y + 0.5, &samples, &count);
  tc_reference_pixel(r, x + 0.5, y + 0.5, rgba);
  cJSON *json = cJSON_CreateObject();
  cJSON_AddItemToObject(json, "color", cJSON_CreateDoubleArray(rgba, 3));
  cJSON_AddNumberToObject(json, "opacity", rgba[3]);
  cJSON *list = cJSON_AddArrayToObject(json, "samples");
  for (size_t i = 0; i < count; i++) cJSON_AddItemToArray(list, sample_json(&samples[i]));
  g_free(samples);
  tc_reference_free(r);
  return json;
}
