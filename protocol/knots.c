/* transferFunction.points and transferFunction.preset. */
#include <string.h>

#include "protocol/internal.h"

enum { VALUE, COLOR, OPACITY, EXTINCTION, KNOT_MEMBERS };
G_STATIC_ASSERT(G_N_ELEMENTS(tcp_knot_members) == KNOT_MEMBERS);

/* A knot has a value, a colour and either opacity or extinction; all knots must have the same of the two. */
static bool read_knot(tcp_reader *reader, const cJSON *object, tc_knot *knot, tc_knot_kind *kind, bool first) {
  unsigned seen = 0;
  if (!tcp_row_read(reader, tcp_knot_members, KNOT_MEMBERS, object, knot, &seen)) return false;
  bool opacity = seen & 1u << OPACITY, extinction = seen & 1u << EXTINCTION;
  if (!(seen & 1u << VALUE)) return tcp_fail(reader, TC_ERROR_INVALID, "\"value\" is missing");
  if (!(seen & 1u << COLOR)) return tcp_fail(reader, TC_ERROR_INVALID, "\"color\" [r,g,b] is missing");
  if (opacity == extinction)
    return tcp_fail(reader, TC_ERROR_INVALID, "one of \"opacity\" and \"extinction\" expected, got %s",
                    opacity ? "both" : "none");
  tc_knot_kind own = opacity ? TC_KNOT_OPACITY : TC_KNOT_EXTINCTION;
  if (!first && own != *kind)
    return tcp_fail(reader, TC_ERROR_INVALID, "\"%s\" differs from the points before; use one of the two in all points",
                    opacity ? "opacity" : "extinction");
  *kind = own;
  return true;
}

static int by_value(gconstpointer a, gconstpointer b, gpointer user) {
  double x = ((const tc_knot *)a)->value, y = ((const tc_knot *)b)->value;
  return (x > y) - (x < y);
}

static bool read_knots(tcp_reader *reader, const cJSON *list, tc_knot *knots, tc_knot_kind *kind) {
  int i = 0;
  for (const cJSON *item = list->child; item; item = item->next, i++) {
    size_t mark = tcp_enter_index(reader, i);
    if (!read_knot(reader, item, &knots[i], kind, i == 0)) return false;
    tcp_leave(reader, mark);
  }
  return true;
}

static bool read_points(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  tc_transfer_function *tf = &reader->scene->transfer_function;
  if (reader->lists && reader->lists->points == value) {
    tc_scene_take_points(reader->scene, &reader->lists->scene);
    tf->kind = reader->lists->scene.transfer_function.kind;
    if (!reader->preset_given) memset(tf->preset, 0, sizeof tf->preset);
    return true;
  }
  if (!cJSON_IsArray(value)) return tcp_fail_type(reader, "an array of points", value);
  int count = cJSON_GetArraySize(value);
  if (count < 1) return tcp_fail(reader, TC_ERROR_INVALID, "at least one point expected");
  if (count > TC_MAX_KNOTS)
    return tcp_fail(reader, TC_ERROR_LIMIT, "at most %d points are allowed, got %d", TC_MAX_KNOTS, count);
  tc_knot *knots = g_new0(tc_knot, count);
  tc_knot_kind kind = TC_KNOT_OPACITY;
  if (!read_knots(reader, value, knots, &kind)) {
    g_free(knots);
    return false;
  }
  g_qsort_with_data(knots, count, sizeof *knots, by_value, NULL); /* stable: equal values keep their order, for jumps */
  tc_scene_set_points(reader->scene, knots, (size_t)count);
  tf->kind = kind;
  if (!reader->preset_given) memset(tf->preset, 0, sizeof tf->preset);
  return true;
}

static cJSON *write_points(const tcp_member *member, const tc_scene *scene) {
  const tc_transfer_function *tf = &scene->transfer_function;
  const tcp_member *amount = &tcp_knot_members[tf->kind == TC_KNOT_OPACITY ? OPACITY : EXTINCTION];
  cJSON *list = cJSON_CreateArray();
  for (size_t i = 0; i < tf->count; i++) {
    cJSON *knot = cJSON_CreateObject();
    tcp_add(knot, "value", tcp_leaf_write(&tcp_knot_members[VALUE], &tf->points[i]));
    tcp_add(knot, "color", tcp_leaf_write(&tcp_knot_members[COLOR], &tf->points[i]));
    tcp_add(knot, amount->name, tcp_leaf_write(amount, &tf->points[i]));
    cJSON_AddItemToArray(list, knot);
  }
  return list;
}

/* Restores the default points with their preset's name, unless this patch names another preset. */
static void reset_points(tcp_reader *reader, const tcp_member *member) {
  tc_transfer_function *tf = &reader->scene->transfer_function;
  const tc_transfer_function *from = &reader->defaults->transfer_function;
  if (reader->preset_given) return;
  tc_scene_take_points(reader->scene, reader->defaults);
  tf->kind = from->kind;
  memcpy(tf->preset, from->preset, sizeof tf->preset);
}

static cJSON *knot_schema(int amount) {
  const unsigned members = 1u << VALUE | 1u << COLOR | 1u << amount;
  return tcp_row_schema(tcp_knot_members, KNOT_MEMBERS, members, members);
}

static cJSON *points_schema(const tcp_member *member) {
  cJSON *schema = cJSON_CreateObject(), *kinds = cJSON_CreateArray();
  cJSON_AddItemToArray(kinds, tcp_array_schema(knot_schema(OPACITY), 1, TC_MAX_KNOTS));
  cJSON_AddItemToArray(kinds, tcp_array_schema(knot_schema(EXTINCTION), 1, TC_MAX_KNOTS));
  tcp_add(schema, "oneOf", kinds);
  tcp_add(schema, "description", cJSON_CreateStringReference(member->doc));
  return schema;
}

const tcp_special tcp_special_points = {read_points, write_points, reset_points, points_schema};

/* --- preset ------------------------------------------------------------------------------------- */

static const char **preset_names(void) {
  size_t count;
  const tc_preset *presets = tc_presets(&count);
  const char **names = g_new0(const char *, count + 1);
  for (size_t i = 0; i < count; i++) names[i] = presets[i].name;
  return names;
}

static bool read_preset(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  if (!cJSON_IsString(value)) return tcp_fail_type(reader, "a string", value);
  tc_transfer_function *tf = &reader->scene->transfer_function;
  reader->preset_given =
      reader->stretch ? tc_transfer_function_fit_preset(tf, value->valuestring, reader->stretch)
                      : tc_transfer_function_set_preset(tf, value->valuestring, reader->value_min, reader->value_max);
  if (reader->preset_given) return true;
  const char **names = preset_names();
  char *quoted = tcp_quote(value->valuestring), *hint = tcp_hint(value->valuestring, names);
  tcp_fail(reader, TC_ERROR_INVALID, "%s is no preset%s", quoted, hint);
  g_free(quoted);
  g_free(hint);
  g_free(names);
  return false;
}

static cJSON *write_preset(const tcp_member *member, const tc_scene *scene) {
  const char *name = scene->transfer_function.preset;
  return *name ? cJSON_CreateString(name) : NULL;
}

static void reset_preset(tcp_reader *reader, const tcp_member *member) {
  reset_points(reader, member);
  reader->scene->transfer_function.unit_distance_mm = reader->defaults->transfer_function.unit_distance_mm;
}

static cJSON *preset_schema(const tcp_member *member) {
  const char **names = preset_names();
  cJSON *schema = cJSON_CreateObject(), *list = cJSON_CreateArray();
  for (const char **name = names; *name; name++) cJSON_AddItemToArray(list, cJSON_CreateStringReference(*name));
  g_free(names);
  tcp_add(schema, "enum", list);
  tcp_add(schema, "description", cJSON_CreateStringReference(member->doc));
  return schema;
}

const tcp_special tcp_special_preset = {read_preset, write_preset, reset_preset, preset_schema};
