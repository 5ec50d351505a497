/* The presets as a document for menus. */
#include "protocol/internal.h"

/* Uses the scene writer, so that a client can send the points back. */
static cJSON *write_points(const tc_preset *preset) {
  tc_scene scene = {
      .transfer_function = {.points = (tc_knot *)preset->points, .count = preset->count, .kind = preset->kind}};
  return tcp_special_points.write(NULL, &scene);
}

/* The member "shading" that selecting the preset sets. */
static cJSON *write_shading(const tc_preset *preset) {
  if (!preset->lit) return cJSON_Parse("{\"model\":\"none\"}");
  tc_scene scene;
  tc_scene_init(&scene);
  tc_scene_light(&scene, true);
  cJSON *document = tcp_scene_write(&scene), *shading = cJSON_DetachItemFromObjectCaseSensitive(document, "shading");
  cJSON_Delete(document);
  tc_scene_clear(&scene);
  return shading;
}

static cJSON *write_preset(const tc_preset *preset) {
  cJSON *object = cJSON_CreateObject();
  tcp_add(object, "name", cJSON_CreateStringReference(preset->name));
  tcp_add(object, "title", cJSON_CreateStringReference(preset->title));
  tcp_add(object, "modality", cJSON_CreateStringReference(preset->modality));
  tcp_add(object, "relative", cJSON_CreateBool(preset->relative));
  tcp_add(object, "unitDistance", cJSON_CreateNumber(preset->unit_distance_mm));
  tcp_add(object, "points", write_points(preset));
  tcp_add(object, "shading", write_shading(preset));
  return object;
}

static cJSON *write_window(const tc_window_preset *preset) {
  cJSON *object = cJSON_CreateObject();
  tcp_add(object, "name", cJSON_CreateStringReference(preset->name));
  tcp_add(object, "title", cJSON_CreateStringReference(preset->title));
  tcp_add(object, "modality", cJSON_CreateStringReference(preset->modality));
  tcp_add(object, "center", cJSON_CreateNumber(preset->center));
  tcp_add(object, "width", cJSON_CreateNumber(preset->width));
  return object;
}

cJSON *tcp_presets(void) {
  cJSON *document = cJSON_CreateObject(), *functions = cJSON_CreateArray(), *windows = cJSON_CreateArray();
  size_t count;
  const tc_preset *presets = tc_presets(&count);
  for (size_t i = 0; i < count; i++) cJSON_AddItemToArray(functions, write_preset(&presets[i]));
  const tc_window_preset *window_presets = tc_window_presets(&count);
  for (size_t i = 0; i < count; i++) cJSON_AddItemToArray(windows, write_window(&window_presets[i]));
  tcp_add(document, "transferFunctions", functions);
  tcp_add(document, "windows", windows);
  cJSON *colors = cJSON_CreateArray();
  const double(*palette)[3] = tc_label_palette(&count);
  for (size_t i = 0; i < count; i++) cJSON_AddItemToArray(colors, tcp_vector_write(palette[i], 3));
  tcp_add(document, "labelColors", colors);
  return document;
}
