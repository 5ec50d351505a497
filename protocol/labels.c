/* labels.colors (an object keyed by label number, merged member by member) and labels.visible (a list). */
#include <stdlib.h>
#include <string.h>

#include "protocol/internal.h"

/* Decimal digits without sign or leading zero, as JSON would write the number. */
static bool parse_label(const char *text, uint32_t *label) {
  guint64 number;
  if (*text == '0' && text[1]) return false;
  if (!g_ascii_isdigit(*text) || !g_ascii_string_to_unsigned(text, 10, 0, UINT32_MAX, &number, NULL)) return false;
  *label = (uint32_t)number;
  return true;
}

static int by_label(const void *a, const void *b) {
  const uint32_t x = ((const tc_label_color *)a)->label, y = ((const tc_label_color *)b)->label;
  return (x > y) - (x < y);
}

static const tc_label_color *find_color(const tc_scene *scene, uint32_t label) {
  const tc_label_color key = {.label = label};
  if (!scene->labels.n_colors) return NULL;
  return bsearch(&key, scene->labels.colors, scene->labels.n_colors, sizeof key, by_label);
}

/* A negative red marks "reset to default". */
static bool is_reset(const tc_label_color *edit) { return edit->rgba[0] < 0; }

static bool read_edit(tcp_reader *reader, const tcp_member *member, const cJSON *item, tc_label_color *edit) {
  const size_t mark = tcp_enter(reader, item->string);
  if (!parse_label(item->string, &edit->label))
    return tcp_fail(reader, TC_ERROR_INVALID, "a label number 0..4294967295 expected as the name");
  if (cJSON_IsNull(item))
    edit->rgba[0] = -1;
  else if (!tcp_vector_read(reader, member, item, 4, edit->rgba))
    return false;
  tcp_leave(reader, mark);
  return true;
}

/* Parses the patch's members, sorted by label; names are unique. NULL: an error is set. */
static GArray *read_edits(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  GArray *edits = g_array_new(FALSE, FALSE, sizeof(tc_label_color));
  bool good = true;
  for (const cJSON *item = value->child; item && good; item = item->next) {
    tc_label_color edit;
    good = read_edit(reader, member, item, &edit);
    g_array_append_val(edits, edit);
  }
  g_array_sort(edits, by_label);
  if (!good) g_clear_pointer(&edits, g_array_unref);
  return edits;
}

/* Merges the edits into the scene's colours; both are sorted. */
static bool lay_on(tcp_reader *reader, const tc_label_color *edits, size_t count) {
  tc_scene *scene = reader->scene;
  const tc_label_color *old = scene->labels.colors;
  size_t next = 0, n_old = scene->labels.n_colors;
  GArray *all = g_array_sized_new(FALSE, FALSE, sizeof *old, (guint)(n_old + count));
  for (size_t i = 0; i < count; i++) {
    const tc_label_color *edit = &edits[i];
    const tc_label_color *color = is_reset(edit) ? find_color(reader->defaults, edit->label) : edit;
    for (; next < n_old && old[next].label < edit->label; next++) g_array_append_val(all, old[next]);
    if (next < n_old && old[next].label == edit->label) next++;
    if (color) g_array_append_vals(all, color, 1);
  }
  if (next < n_old) g_array_append_vals(all, &old[next], (guint)(n_old - next));
  const guint kept = all->len;
  const bool good = kept <= TCP_MAX_LABELS;
  tc_label_color *colors = (tc_label_color *)(void *)g_array_free(all, !good || !kept);
  if (good) tc_scene_set_colors(scene, colors, kept);
  return good || tcp_fail(reader, TC_ERROR_LIMIT, "at most %d colours are allowed, got %u", TCP_MAX_LABELS, kept);
}

/* Without defaults (tcp_lists_read()) the result is the list of edits. */
static bool read_colors(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  const tc_scene *read = reader->lists && reader->lists->colors == value ? &reader->lists->scene : NULL;
  if (read) return lay_on(reader, read->labels.colors, read->labels.n_colors);
  if (!cJSON_IsObject(value)) return tcp_fail_type(reader, "an object of label numbers", value);
  GArray *edits = read_edits(reader, member, value);
  if (!edits) return false;
  const guint count = edits->len;
  tc_label_color *list = (tc_label_color *)(void *)g_array_free(edits, FALSE);
  if (!reader->defaults) {
    tc_scene_set_colors(reader->scene, list, count);
    return true;
  }
  const bool good = lay_on(reader, list, count);
  g_free(list);
  return good;
}

static cJSON *write_colors(const tcp_member *member, const tc_scene *scene) {
  cJSON *object = cJSON_CreateObject();
  for (size_t i = 0; i < scene->labels.n_colors; i++) {
    char name[16];
    g_snprintf(name, sizeof name, "%u", scene->labels.colors[i].label);
    cJSON_AddItemToObject(object, name, tcp_vector_write(scene->labels.colors[i].rgba, 4));
  }
  return object;
}

static void reset_colors(tcp_reader *reader, const tcp_member *member) {
  tc_scene_take_colors(reader->scene, reader->defaults);
}

static cJSON *colors_schema(const tcp_member *member) {
  cJSON *schema = cJSON_CreateObject(), *names = cJSON_CreateObject();
  tcp_add(schema, "type", cJSON_CreateStringReference("object"));
  tcp_add(names, "pattern", cJSON_CreateStringReference("^(0|[1-9][0-9]{0,9})$"));
  tcp_add(schema, "propertyNames", names);
  tcp_add(schema, "additionalProperties", tcp_array_schema(tcp_range_schema(member, "number"), 4, 4));
  tcp_add(schema, "maxProperties", cJSON_CreateNumber(TCP_MAX_LABELS));
  tcp_add(schema, "description", cJSON_CreateStringReference(member->doc));
  return schema;
}

const tcp_special tcp_special_label_colors = {read_colors, write_colors, reset_colors, colors_schema};

/* --- labels.visible ----------------------------------------------------------------------------- */

static bool read_visible(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  if (reader->lists && reader->lists->visible == value) {
    tc_scene_take_visible(reader->scene, &reader->lists->scene);
    return true;
  }
  if (!cJSON_IsArray(value)) return tcp_fail_type(reader, "an array of label numbers", value);
  int count = cJSON_GetArraySize(value), i = 0;
  if (count > TCP_MAX_LABELS)
    return tcp_fail(reader, TC_ERROR_LIMIT, "at most %d labels are allowed, got %d", TCP_MAX_LABELS, count);
  uint32_t *visible = g_new0(uint32_t, count ? count : 1); /* an empty list shows no label; NULL would show all */
  tc_scene_set_visible(reader->scene, visible, (size_t)count);
  for (const cJSON *item = value->child; item; item = item->next, i++) {
    double number;
    size_t mark = tcp_enter_index(reader, i);
    if (!tcp_number_read(reader, member, item, &number)) return false;
    if (number != (uint32_t)number) return tcp_fail(reader, TC_ERROR_INVALID, "%.9g is not a whole number", number);
    visible[i] = (uint32_t)number;
    tcp_leave(reader, mark);
  }
  return true;
}

static cJSON *write_visible(const tcp_member *member, const tc_scene *scene) {
  if (!scene->labels.visible) return NULL;
  cJSON *list = cJSON_CreateArray();
  for (size_t i = 0; i < scene->labels.n_visible; i++)
    cJSON_AddItemToArray(list, cJSON_CreateNumber(scene->labels.visible[i]));
  return list;
}

static void reset_visible(tcp_reader *reader, const tcp_member *member) {
  tc_scene_take_visible(reader->scene, reader->defaults);
}

static cJSON *visible_schema(const tcp_member *member) {
  cJSON *schema = tcp_array_schema(tcp_range_schema(member, "integer"), 0, TCP_MAX_LABELS);
  tcp_add(schema, "description", cJSON_CreateStringReference(member->doc));
  return schema;
}

const tcp_special tcp_special_visible = {read_visible, write_visible, reset_visible, visible_schema};
