/* Lists what this version does not support, by asking the planner: each choice in the scene's schema is planned, and
 * those refused as unsupported are listed. So the list cannot contradict the planner. */
#include <string.h>

#include "server/http/http.h"

typedef struct asker {
  tc_volume *volume; /* any volume */
  tc_scene defaults;
  cJSON *found; /* {"shading.model": ["lambert", ...]} */
} asker;

static tc_volume *smallest_volume(void) {
  tc_volume_desc desc = {.dims = {2, 2, 2}, .spacing = {1, 1, 1}, .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .slope = 1};
  desc.frames = 1;
  tc_volume *volume = tc_volume_new(&desc, NULL);
  if (!volume) return NULL;
  ((uint8_t *)tc_volume_voxels(volume))[0] = 1;
  tc_volume_seal(volume);
  return volume;
}

static bool refused(const asker *a, const cJSON *patch) {
  const tcp_scene_context context = {0, 1};
  GError *error = NULL;
  tc_scene scene;
  tc_scene_copy(&scene, &a->defaults);
  if (tcp_scene_patch(&scene, patch, &a->defaults, &context, &error))
    tc_plan_check(a->volume, &scene, scene.image.width, scene.image.height, NULL, &error);
  const bool not_built = g_error_matches(error, TC_ERROR, TC_ERROR_UNSUPPORTED);
  g_clear_error(&error);
  tc_scene_clear(&scene);
  return not_built;
}

/* Plans a scene with this member. Takes `value`. part NULL: a member of the scene itself. */
static void ask(asker *a, const char *part, const char *name, cJSON *value) {
  cJSON *patch = cJSON_CreateObject();
  cJSON *holder = part ? cJSON_AddObjectToObject(patch, part) : patch;
  cJSON_AddItemToObject(holder, name, value);
  if (refused(a, patch)) {
    char *path = part ? g_strconcat(part, ".", name, NULL) : g_strdup(name);
    cJSON *list = cJSON_GetObjectItemCaseSensitive(a->found, path);
    if (!list) list = cJSON_AddArrayToObject(a->found, path);
    cJSON_AddItemToArray(list, cJSON_Duplicate(value, true));
    g_free(path);
  }
  cJSON_Delete(patch);
}

/* Asks for every name of every enum, and for true of every boolean. */
static void ask_members(asker *a, const char *part, const cJSON *properties) {
  const cJSON *member, *name;
  cJSON_ArrayForEach(member, properties) {
    const cJSON *names = cJSON_GetObjectItemCaseSensitive(member, "enum");
    const cJSON *type = cJSON_GetObjectItemCaseSensitive(member, "type");
    const cJSON *inner = cJSON_GetObjectItemCaseSensitive(member, "properties");
    cJSON_ArrayForEach(name, names) ask(a, part, member->string, cJSON_Duplicate(name, true));
    if (cJSON_IsString(type) && strcmp(type->valuestring, "boolean") == 0)
      ask(a, part, member->string, cJSON_CreateTrue());
    if (inner && !part) ask_members(a, member->string, inner);
  }
}

cJSON *tcs_unavailable(void) {
  asker a = {.volume = smallest_volume(), .found = cJSON_CreateObject()};
  if (!a.volume) return a.found;
  tc_scene_init(&a.defaults);
  tc_scene_fit(&a.defaults, a.volume);
  cJSON *schema = tcp_scene_schema();
  ask_members(&a, NULL, cJSON_GetObjectItemCaseSensitive(schema, "properties"));
  for (int rays = 2; rays <= 64; rays *= 2) ask(&a, "sampling", "raysPerPixel", cJSON_CreateNumber(rays));
  ask(&a, "errorMeter", "pixels", cJSON_CreateNumber(64));
  ask(&a, "quality", "maxError", cJSON_CreateNumber(0.01));
  ask(&a, "quality", "maxMilliseconds", cJSON_CreateNumber(100));
  cJSON_Delete(schema);
  tc_scene_clear(&a.defaults);
  tc_volume_unref(a.volume);
  return a.found;
}
