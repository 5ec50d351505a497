/* The OpenAPI document: written by hand, completed with the version and the scene schema. */
#include "protocol/internal.h"
#include "renderer/base/embedded.h"

cJSON *tcp_openapi(const char *version) {
  const struct tc_embedded_file *file = tcp_protocol_files; /* the only file */
  cJSON *document = tcp_json_parse((const char *)file->bytes, file->size, NULL);
  cJSON *info = cJSON_GetObjectItemCaseSensitive(document, "info");
  cJSON *components = cJSON_GetObjectItemCaseSensitive(document, "components");
  cJSON *schemas = cJSON_GetObjectItemCaseSensitive(components, "schemas");
  cJSON *scene = tcp_scene_schema();
  cJSON_DeleteItemFromObjectCaseSensitive(scene, "$schema"); /* OpenAPI 3.1 implies this dialect */
  cJSON_DeleteItemFromObjectCaseSensitive(scene, "$id");
  if (info) cJSON_ReplaceItemInObjectCaseSensitive(info, "version", cJSON_CreateString(version));
  if (schemas)
    cJSON_ReplaceItemInObjectCaseSensitive(schemas, "Scene", scene);
  else
    cJSON_Delete(scene);
  return document;
}
