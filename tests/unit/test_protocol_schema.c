/* The machine-readable contract: scene.schema.json, openapi.json and the presets agree with the program. */
#include "tests/support/test.h"

#include "protocol/protocol.h"
#include "tests/support/scoped.h"

#define SCHEMA_FILE TC_SOURCE_DIR "/protocol/scene.schema.json"

/* With TC_WRITE_SCHEMA set the file is written anew first. */
TEST(file_agrees_with_table) {
  g_autoptr(cJSON) schema = tcp_scene_schema();
  char *text = cJSON_Print(schema), *file = NULL;
  gsize size;
  char *wanted = g_strconcat(text, "\n", NULL);
  if (getenv("TC_WRITE_SCHEMA")) assert_true(g_file_set_contents(SCHEMA_FILE, wanted, -1, NULL));
  assert_true(g_file_get_contents(SCHEMA_FILE, &file, &size, NULL));
  if (strcmp(file, wanted) != 0)
    fail_msg("protocol/scene.schema.json is out of date; run this test with TC_WRITE_SCHEMA=1");
  g_free(file);
  g_free(wanted);
  cJSON_free(text);
}

static cJSON *at(cJSON *json, const char *path) {
  g_auto(GStrv) names = g_strsplit(path, "/", -1);
  for (char **name = names; *name && json; name++)
    json = cJSON_GetObjectItemCaseSensitive(json, *name);
  return json;
}

/* Each member a written scene has is described, and nothing is both written and unknown. */
static void check_described(cJSON *value, cJSON *schema, const char *where) {
  for (cJSON *item = value->child; item; item = item->next) {
    cJSON *property = cJSON_GetObjectItemCaseSensitive(cJSON_GetObjectItem(schema, "properties"), item->string);
    if (!property) fail_msg("%s.%s is written but not in the schema", where, item->string);
    assert_non_null(cJSON_GetObjectItem(property, "description"));
    if (cJSON_IsObject(item) && cJSON_GetObjectItem(property, "properties"))
      check_described(item, property, item->string);
  }
}

TEST(schema_describes_what_is_written) {
  g_auto(tc_scene) scene;
  tc_scene_init(&scene);
  cJSON *schema = tcp_scene_schema(), *written = tcp_scene_write(&scene);
  check_described(written, schema, "scene");
  assert_float_equal(at(schema, "properties/camera/properties/fovY/exclusiveMaximum")->valuedouble, 180, 0);
  assert_float_equal(at(schema, "properties/image/properties/width/maximum")->valuedouble, TC_MAX_IMAGE_SIDE, 0);
  assert_float_equal(at(schema, "properties/image/properties/width/default")->valuedouble, scene.image.width, 0);
  assert_null(at(schema, "properties/camera/properties/position/default"));
  assert_int_equal(cJSON_GetArraySize(at(schema, "properties/mode/enum")), TC_MODE_COUNT);
  cJSON_Delete(schema);
  cJSON_Delete(written);
}

TEST(defaults_are_a_valid_patch) {
  tc_scene scene, defaults;
  tc_scene_init(&scene);
  tc_scene_init(&defaults);
  g_autoptr(cJSON) written = tcp_scene_write(&defaults);
  GError *error = NULL;
  if (!tcp_scene_patch(&scene, written, &defaults, NULL, &error)) fail_msg("%s", error->message);
  tc_scene_clear(&scene);
  tc_scene_clear(&defaults);
}

/* Every "$ref" of the document leads somewhere. */
static void check_references(cJSON *document, cJSON *json) {
  for (cJSON *item = json->child; item; item = item->next) {
    if (item->string && strcmp(item->string, "$ref") == 0) {
      assert_true(g_str_has_prefix(item->valuestring, "#/"));
      if (!at(document, item->valuestring + 2)) fail_msg("dangling %s", item->valuestring);
    }
    check_references(document, item);
  }
}

TEST(openapi_is_complete) {
  static const char *const calls[][2] = {{"/healthz", "get"},
                                         {"/readyz", "get"},
                                         {"/metrics", "get"},
                                         {"/v1/about", "get"},
                                         {"/v1/openapi.json", "get"},
                                         {"/v1/scene.schema.json", "get"},
                                         {"/v1/presets", "get"},
                                         {"/v1/volumes", "get"},
                                         {"/v1/volumes", "post"},
                                         {"/v1/volumes/{id}", "put"},
                                         {"/v1/volumes/{id}", "get"},
                                         {"/v1/volumes/{id}/histogram", "get"},
                                         {"/v1/volumes/{id}/value", "get"},
                                         {"/v1/volumes/{id}", "delete"},
                                         {"/v1/render", "post"},
                                         {"/v1/sessions", "post"},
                                         {"/v1/sessions", "get"},
                                         {"/v1/sessions/{id}", "get"},
                                         {"/v1/sessions/{id}", "delete"},
                                         {"/v1/sessions/{id}/scene", "get"},
                                         {"/v1/sessions/{id}/scene", "put"},
                                         {"/v1/sessions/{id}/scene", "patch"},
                                         {"/v1/sessions/{id}/frame", "get"},
                                         {"/v1/sessions/{id}/plan", "get"},
                                         {"/v1/sessions/{id}/ray", "get"},
                                         {"/v1/sessions/{id}/pick", "get"},
                                         {"/v1/sessions/{id}/stream", "get"},
                                         {"/v1/sessions/{id}/stream.mjpeg", "get"},
                                         {"/", "get"}};
  g_autoptr(cJSON) document = tcp_openapi("1.2.3");
  assert_non_null(document);
  assert_string_equal(at(document, "openapi")->valuestring, "3.1.0");
  assert_string_equal(at(document, "info/version")->valuestring, "1.2.3");
  assert_non_null(at(document, "components/schemas/Scene/properties/camera"));
  for (size_t i = 0; i < G_N_ELEMENTS(calls); i++) {
    cJSON *path = cJSON_GetObjectItemCaseSensitive(at(document, "paths"), calls[i][0]);
    cJSON *call = cJSON_GetObjectItemCaseSensitive(path, calls[i][1]);
    if (!call) fail_msg("%s %s is missing", calls[i][1], calls[i][0]);
    assert_non_null(at(call, "operationId"));
    assert_non_null(at(call, "responses/default"));
  }
  check_references(document, document);
}

/* What the presets' document lists can be sent back: by name and by points. */
TEST(presets_can_be_used) {
  tc_scene scene, defaults;
  tc_scene_init(&scene);
  tc_scene_init(&defaults);
  cJSON *document = tcp_presets(), *preset;
  assert_true(cJSON_GetArraySize(at(document, "windows")) >= 6);
  cJSON_ArrayForEach(preset, at(document, "transferFunctions")) {
    for (int by_name = 0; by_name < 2; by_name++) {
      const char *member = by_name ? "name" : "points";
      cJSON *patch = cJSON_CreateObject(), *tf = cJSON_AddObjectToObject(patch, "transferFunction");
      cJSON_AddItemToObject(tf, by_name ? "preset" : "points", cJSON_Duplicate(at(preset, member), true));
      GError *error = NULL;
      if (!tcp_scene_patch(&scene, patch, &defaults, NULL, &error))
        fail_msg("%s: %s", at(preset, "name")->valuestring, error->message);
      cJSON_Delete(patch);
    }
  }
  cJSON_Delete(document);
  tc_scene_clear(&scene);
  tc_scene_clear(&defaults);
}

TESTS(NULL, NULL)
