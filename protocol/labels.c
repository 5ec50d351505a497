/* labels.colors (an object keyed by label number, merged member by member) and labels.visible (a list). */
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

static const double *find_color(const tc_scene *scene, uint32_t label) {
  for (size_t i = 0; i < scene->labels.n_colors; i++)
    if (scene->labels.colors[i].label == label) return scene->labels.colors[i].rgba;
  return NULL;
}

static int by_label(gconstpointer a, gconstpointer b, gpointer user) {
  uint32_t x = ((const tc_label_color *)a)->label, y = ((const tc_label_color *)b)->label;
  return (x > y) - (x < y);
}

/* One member of the patch becomes an entry behind those there are; a red below 0 says "none". */
static bool read_entry(tcp_reader *reader, const tcp_member *member, const cJSON *item, GArray *entries) {
  tc_label_color entry;
  size_t mark = tcp_enter(reader, item->string);
  if (!parse_label(item->string, &entry.label))
    return tcp_fail(reader, TC_ERROR_INVALID, "a label number 0..4294967295 is wanted as the name");
  if (cJSON_IsNull(item)) {
    const double *rgba = find_color(reader->defaults, entry.label);
    entry.rgba[0] = -1;
    if (rgba) memcpy(entry.rgba, rgba, sizeof entry.rgba);
  } else if (!tcp_vector_read(reader, member, item, 4, entry.rgba)) {
    return false;
  }
  g_array_append_val(entries, entry);
  tcp_leave(reader, mark);
  return true;
}

/* Sorted by label with the newest of equals kept; removed ones dropped. */
static void tidy(GArray *entries) {
  tc_label_color *e = (tc_label_color *)(void *)entries->data;
  guint kept = 0;
  if (entries->len) g_qsort_with_data(e, (int)entries->len, sizeof *e, by_label, NULL); /* stable */
  for (guint i = 0; i < entries->len; i++) {
    bool newest = i + 1 == entries->len || e[i + 1].label != e[i].label;
    if (newest && e[i].rgba[0] >= 0) e[kept++] = e[i];
  }
  g_array_set_size(entries, kept);
}

static bool read_colors(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  tc_scene *scene = reader->scene;
  if (!cJSON_IsObject(value)) return tcp_fail_type(reader, "an object of label numbers", value);
  GArray *entries = g_array_new(FALSE, FALSE, sizeof(tc_label_color));
  if (scene->labels.n_colors) g_array_append_vals(entries, scene->labels.colors, (guint)scene->labels.n_colors);
  bool good = true;
  for (const cJSON *item = value->child; item && good; item = item->next)
    good = read_entry(reader, member, item, entries);
  if (good) tidy(entries);
  if (good && entries->len > TCP_MAX_LABELS)
    good = tcp_fail(reader, TC_ERROR_LIMIT, "at most %d colours are wanted, got %u", TCP_MAX_LABELS, entries->len);
  if (good) {
    void *colors = entries->len ? g_memdup2(entries->data, entries->len * sizeof(tc_label_color)) : NULL;
    tc_scene_set_colors(scene, colors, entries->len);
  }
  g_array_free(entries, TRUE);
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
    return tcp_fail(reader, TC_ERROR_LIMIT, "at most %d labels are wanted, got %d", TCP_MAX_LABELS, count);
  uint32_t *visible = g_new0(uint32_t, count ? count : 1); /* an empty list shows none; NULL would show all */
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
