/* Applies documents to scenes: walks the table of members and reads those in the patch. */
#include <math.h>
#include <string.h>

#include "protocol/internal.h"

static bool in_group(const tcp_member *member, const char *group) { return strcmp(member->group, group) == 0; }

static void reset_member(tcp_reader *reader, const tcp_member *member) {
  if (member->special)
    member->special->reset(reader, member);
  else
    tcp_leaf_copy(member, reader->scene, reader->defaults);
}

static bool read_member(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  if (cJSON_IsNull(value)) {
    reset_member(reader, member);
    return true;
  }
  size_t mark = tcp_enter(reader, member->name);
  bool good = member->special ? member->special->read(reader, member, value)
                              : tcp_leaf_read(reader, member, reader->scene, value);
  if (good) tcp_leave(reader, mark);
  return good;
}

/* Names allowed at one level: members of `group`, and at the top level the groups too. */
static GPtrArray *known_names(const char *group) {
  GPtrArray *names = g_ptr_array_new();
  for (size_t i = 0; i < tcp_member_count; i++)
    if (in_group(&tcp_members[i], group)) g_ptr_array_add(names, (gpointer)tcp_members[i].name);
  for (size_t i = 0; !*group && i < tcp_group_count; i++) g_ptr_array_add(names, (gpointer)tcp_groups[i].name);
  g_ptr_array_add(names, NULL);
  return names;
}

static bool is_known(GPtrArray *names, const char *name) {
  for (guint i = 0; i + 1 < names->len; i++)
    if (strcmp(names->pdata[i], name) == 0) return true;
  return false;
}

/* Suggests "image.width" for "width" at the top level. NULL: no group has such a member. */
static char *hint_of_group(const char *name) {
  for (size_t i = 0; i < tcp_member_count; i++)
    if (*tcp_members[i].group && strcmp(tcp_members[i].name, name) == 0)
      return g_strdup_printf("; did you mean \"%s.%s\"?", tcp_members[i].group, name);
  return NULL;
}

static bool check_names(tcp_reader *reader, const cJSON *object, const char *group) {
  GPtrArray *names = known_names(group);
  const cJSON *item = object->child;
  while (item && is_known(names, item->string)) item = item->next;
  if (item) {
    char *hint = *group ? NULL : hint_of_group(item->string);
    if (!hint) hint = tcp_hint(item->string, (const char *const *)names->pdata);
    tcp_enter(reader, item->string);
    tcp_fail(reader, TC_ERROR_INVALID, "unknown member%s", hint);
    g_free(hint);
  }
  g_ptr_array_free(names, TRUE);
  return item == NULL;
}

/* Reads members in the order of the table, not of the document: a preset before the points that replace its own. */
static bool read_members(tcp_reader *reader, const cJSON *object, const char *group) {
  for (size_t i = 0; i < tcp_member_count; i++) {
    if (!in_group(&tcp_members[i], group)) continue;
    const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, tcp_members[i].name);
    if (value && !read_member(reader, &tcp_members[i], value)) return false;
  }
  return true;
}

static void reset_group(tcp_reader *reader, const char *group) {
  for (size_t i = 0; i < tcp_member_count; i++)
    if (in_group(&tcp_members[i], group)) reset_member(reader, &tcp_members[i]);
}

static bool read_group(tcp_reader *reader, const cJSON *value, const char *group) {
  if (cJSON_IsNull(value)) {
    reset_group(reader, group);
    return true;
  }
  size_t mark = tcp_enter(reader, group);
  if (!cJSON_IsObject(value)) return tcp_fail_type(reader, "an object", value);
  if (!check_names(reader, value, group) || !read_members(reader, value, group)) return false;
  tcp_leave(reader, mark);
  return true;
}

static bool read_scene(tcp_reader *reader, const cJSON *patch) {
  if (!cJSON_IsObject(patch)) return tcp_fail_at(reader->error, TC_ERROR_INVALID, "", "a scene must be a JSON object");
  if (!check_names(reader, patch, "") || !read_members(reader, patch, "")) return false;
  for (size_t i = 0; i < tcp_group_count; i++) {
    const cJSON *value = cJSON_GetObjectItemCaseSensitive(patch, tcp_groups[i].name);
    if (value && !read_group(reader, value, tcp_groups[i].name)) return false;
  }
  return true;
}

bool tcp_scene_patch(tc_scene *scene, const cJSON *patch, const tc_scene *defaults, const tcp_scene_context *context,
                     GError **error) {
  tc_scene next;
  tc_scene_copy(&next, scene);
  tcp_reader reader = {.scene = &next,
                       .defaults = defaults,
                       .lists = context ? context->lists : NULL,
                       .value_min = context ? context->value_min : 0,
                       .value_max = context ? context->value_max : 1,
                       .stretch = context ? context->stretch : NULL,
                       .pointer = g_string_new(NULL),
                       .error = error};
  bool good = read_scene(&reader, patch) && tcp_scene_check(&next, patch, error);
  if (good) {
    tc_scene_share(&next); /* it will be copied often */
    tc_scene_clear(scene);
    *scene = next;
  } else {
    tc_scene_clear(&next);
  }
  g_string_free(reader.pointer, TRUE);
  return good;
}

/* Reads one list (or object), if present, by its member's reader. */
static bool read_list(tcp_reader *reader, const cJSON *document, const char *group, const char *name,
                      const tcp_special *special, const cJSON **node) {
  const cJSON *value = cJSON_GetObjectItemCaseSensitive(cJSON_GetObjectItemCaseSensitive(document, group), name);
  if (!cJSON_IsArray(value) && !cJSON_IsObject(value)) return true;
  for (size_t i = 0; i < tcp_member_count; i++) {
    if (tcp_members[i].special != special) continue;
    const size_t mark = tcp_enter(reader, group);
    tcp_enter(reader, name);
    if (!special->read(reader, &tcp_members[i], value)) return false;
    tcp_leave(reader, mark);
  }
  *node = value;
  return true;
}

bool tcp_lists_read(const cJSON *document, tcp_lists *lists, GError **error) {
  *lists = (tcp_lists){0};
  tcp_reader reader = {.scene = &lists->scene, .pointer = g_string_new(NULL), .error = error};
  const bool good = read_list(&reader, document, "transferFunction", "points", &tcp_special_points, &lists->points) &&
                    read_list(&reader, document, "labels", "colors", &tcp_special_label_colors, &lists->colors) &&
                    read_list(&reader, document, "labels", "visible", &tcp_special_visible, &lists->visible);
  g_string_free(reader.pointer, TRUE);
  tc_scene_share(&lists->scene);
  if (!good) tcp_lists_clear(lists);
  return good;
}

void tcp_lists_clear(tcp_lists *lists) {
  tc_scene_clear(&lists->scene);
  *lists = (tcp_lists){0};
}

void tcp_scene_light(tc_scene *scene, const cJSON *document) {
  const cJSON *look = cJSON_GetObjectItemCaseSensitive(document, "transferFunction");
  const char *mode = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(document, "mode"));
  const char *name = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(look, "preset"));
  const tc_preset *preset = name ? tc_preset_named(name) : NULL;
  const bool own_points = !name && cJSON_IsArray(cJSON_GetObjectItemCaseSensitive(look, "points"));
  if (preset || own_points) tc_scene_light(scene, preset && preset->lit);
  if (own_points) scene->transfer_function.unit_distance_mm = 1;
  if (own_points || (mode && strcmp(mode, "dvr"))) scene->hide_table = false;
  const bool lit = mode && (!strcmp(mode, "isosurface") || !strcmp(mode, "mesh") || !strcmp(mode, "splat"));
  if (lit && scene->shading.model == TC_SHADING_NONE) scene->shading.model = TC_SHADING_BLINN_PHONG;
}

/* --- "--set key=value" -------------------------------------------------------------------------- */

#define MAX_KEY_SEGMENTS 8

/* The value as JSON if it is JSON, else as text, so that mode=mip needs no quotes. */
static cJSON *parse_value(const char *key, const char *text, GError **error) {
  char *end;
  const char *digits = text + (*text == '-');
  if (g_ascii_isdigit(*digits) && isinf(g_ascii_strtod(text, &end)) && !*end) {
    tc_set_error(error, TC_ERROR_SYNTAX, NULL, "%s: %s is too large for a double", key, text);
    return NULL;
  }
  cJSON *value = tcp_json_parse(text, strlen(text), NULL);
  if (value) return value;
  /* text that starts like JSON is meant as JSON: report its error instead of taking "[1,2" as a word */
  if (strchr("[{\"", *text) && *text) return tcp_json_parse(text, strlen(text), error);
  if (!g_utf8_validate(text, -1, NULL)) {
    tc_set_error(error, TC_ERROR_SYNTAX, NULL, "the value is not valid UTF-8");
    return NULL;
  }
  return cJSON_CreateString(text);
}

static bool check_key(char **segments, GError **error) {
  guint count = g_strv_length(segments);
  for (guint i = 0; i < count; i++)
    if (!*segments[i] || !g_utf8_validate(segments[i], -1, NULL)) count = 0;
  if (count > 0 && count <= MAX_KEY_SEGMENTS) return true;
  tc_set_error(error, TC_ERROR_SYNTAX, NULL, "the key must be a dotted path such as camera.fovY");
  return false;
}

cJSON *tcp_scene_set_expression(const char *expression, GError **error) {
  const char *equals = strchr(expression, '=');
  if (!equals) {
    char *quoted = g_utf8_validate(expression, -1, NULL) ? tcp_quote(expression) : g_strdup("the text");
    tc_set_error(error, TC_ERROR_SYNTAX, NULL, "%s has no '='; write key=value, as camera.fovY=40", quoted);
    g_free(quoted);
    return NULL;
  }
  char *key = g_strndup(expression, (gsize)(equals - expression));
  char **segments = g_strsplit(key, ".", -1);
  cJSON *value = check_key(segments, error) ? parse_value(key, equals + 1, error) : NULL;
  for (guint i = g_strv_length(segments); value && i > 0; i--) {
    cJSON *outer = cJSON_CreateObject();
    cJSON_AddItemToObject(outer, segments[i - 1], value);
    value = outer;
  }
  g_strfreev(segments);
  g_free(key);
  return value;
}
