/* Volumes of the catalogue: import and description. */
#include "server/catalogue/own.h"

#include <math.h>
#include <string.h>

#include "server/observe/log.h"

/* --- loading --------------------------------------------------------------------------------------- */

static bool import(tcs_load *load, const tc_import_options *options) {
  load->volume = tc_import(load->source.path, options, &load->error);
  return load->volume != NULL;
}

/* Reserves memory for the body (the volume without the table). If refused, the table stays visible. */
static bool reserve_body(void *user, uint64_t bytes) {
  tcs_load *load = user;
  const uint64_t both = load->reserved + tcs_room_of(bytes);
  if (!tcs_budget_resize(load->catalogue->server->budget, TCS_MEMORY_LOADS, load->reserved, both)) return false;
  load->reserved = both;
  return true;
}

/* Reserves memory for the mask of missing values, whose need is known only after the whole volume was read. */
static bool reserve_gaps(tcs_load *load) {
  const tc_volume *gaps = tc_volume_gaps(load->volume);
  const uint64_t bytes = gaps ? tc_volume_bytes(gaps) : 0;
  if (!bytes || reserve_body(load, bytes)) return true;
  load->refused = true;
  load->wanted = load->reserved + tcs_room_of(bytes);
  tcs_budget_refuse(load->catalogue->server->budget, TCS_MEMORY_LOADS, tcs_room_of(bytes), &load->error);
  g_clear_pointer(&load->volume, tc_volume_unref);
  return false;
}

static bool dress(tcs_load *load) {
  if (!reserve_gaps(load)) return false;
  tc_fit_find(&load->fit, load->volume);
  load->body = tc_fit_body(&load->fit, load->volume, tcs_load_goes_on, reserve_body, load);
  tc_fit_windows(&load->fit, load->volume, load->body);
  tc_scene_init(&load->defaults);
  tc_scene_dress(&load->defaults, load->volume, &load->fit, load->body != NULL);
  tc_scene_share(&load->defaults);
  return true;
}

static void *hold(tcs_load *load, tc_volume *volume) {
  void *held = volume ? tcs_hold(load, tcs_volume_bytes(volume)) : NULL;
  if (volume) tc_volume_when_freed(volume, tcs_hold_freed, held);
  return held;
}

bool tcs_load_is_of_series(const tcs_load *load) {
  return load->volume && tc_volume_describe(load->volume)->frames > 1;
}

/* The first volume loaded from a series creates the series, which takes over the uploaded file. */
static void keep_series(tcs_load *load, tcs_entry *entry) {
  tcs_spooled *upload = load->source.upload;
  if (entry->series || !tcs_load_is_of_series(load) || (upload && !tcs_spooled_keep(upload))) return;
  const char *part = g_strrstr(load->source.path, "#volume=");
  entry->series = g_new0(tcs_series, 1);
  entry->series->references = 1;
  entry->series->frames = tc_volume_describe(load->volume)->frames;
  entry->series->path =
      part ? g_strndup(load->source.path, (gsize)(part - load->source.path)) : g_strdup(load->source.path);
  entry->series->upload = g_steal_pointer(&load->source.upload);
  entry->part = MAX(tc_volume_provenance(load->volume)->volume, 1);
}

void tcs_series_unref(tcs_series *series) {
  if (!series || --series->references > 0) return;
  tcs_spooled_free(series->upload);
  g_free(series->path);
  g_free(series);
}

static void keep(tcs_load *load, tcs_entry *entry) {
  keep_series(load, entry);
  entry->held = hold(load, load->volume);
  entry->held_body = hold(load, load->body);
  entry->defaults = load->defaults;
  memset(&load->defaults, 0, sizeof load->defaults);
  entry->fit = load->fit;
  entry->volume = g_steal_pointer(&load->volume);
  entry->body = g_steal_pointer(&load->body);
  load->catalogue->server->metrics->volume_loads++;
  const tc_volume_desc *desc = tc_volume_describe(entry->volume);
  tcs_log(TCS_LOG_INFO, "volume.loaded", "dims=%dx%dx%d type=%s format=%s bytes=%" G_GUINT64_FORMAT " ms=%.0f",
          desc->dims[0], desc->dims[1], desc->dims[2], tc_voxel_type_name(desc->type), desc->format,
          tcs_entry_bytes(entry), (double)(g_get_monotonic_time() - load->began_us) / 1000);
}

const tcs_kind_row tcs_kind_volume = {TCS_MEMORY_VOLUMES, import, dress, keep};

/* --- describing ------------------------------------------------------------------------------------ */

static void add_vector(cJSON *object, const char *name, const double *values, int count) {
  cJSON_AddItemToObject(object, name, cJSON_CreateDoubleArray(values, count));
}

void tcs_describe_model(cJSON *json, const tc_vmd *model) {
  static const char *const types[TC_VMD_TYPE_COUNT] = {"u8", "i8", "u16", "i16", "f32", "normal"};
  const tc_vmd_head *h = &model->head;
  cJSON *attributes = cJSON_AddObjectToObject(json, "attributes"), *ranges = cJSON_AddObjectToObject(json, "ranges");
  for (int i = 0; i < h->n_attributes; i++) {
    cJSON_AddStringToObject(attributes, h->attributes[i].name, types[h->attributes[i].type]);
    if (h->attributes[i].type != TC_VMD_NORMAL)
      cJSON_AddItemToObject(ranges, h->attributes[i].name, cJSON_CreateDoubleArray(model->range[i], 2));
  }
  cJSON_AddNumberToObject(json, "voxels", (double)model->voxels);
  cJSON_AddNumberToObject(json, "runs", (double)model->runs);
  cJSON_AddNumberToObject(json, "colors", h->n_palette);
}

void tcs_describe_provenance(cJSON *json, const tc_volume *volume) {
  const tc_volume_desc *desc = tc_volume_describe(volume);
  const tc_provenance *from = tc_volume_provenance(volume);
  cJSON_AddNumberToObject(json, "frames", desc->frames);
  cJSON_AddNumberToObject(json, "volume", MAX(from->volume, 1));
  if (from->slices_found) {
    cJSON *slices = cJSON_AddObjectToObject(json, "slices");
    cJSON_AddNumberToObject(slices, "used", from->slices_used);
    cJSON_AddNumberToObject(slices, "found", from->slices_found);
  }
  if (from->description[0]) cJSON_AddStringToObject(json, "description", from->description);
  if (from->time[0]) cJSON_AddStringToObject(json, "time", from->time);
  if (from->colors) cJSON_AddTrueToObject(json, "colors");
  if (from->resampled) cJSON_AddTrueToObject(json, "resampled");
  if (from->bridged) cJSON_AddNumberToObject(json, "bridged", from->bridged);
  cJSON_AddStringToObject(json, "note", desc->note);
}

/* Adds the single segments that make up a combined segment, smallest first. */
static void add_members(cJSON *list, const tc_volume *volume, const tc_segment *segment) {
  const tc_segment *first = segment->of[0] ? tc_volume_segment(volume, segment->of[0]) : NULL;
  for (int i = 0; i < 2 && segment->of[i]; i++)
    if (i == 0 && first && first->of[0])
      add_members(list, volume, first);
    else
      cJSON_AddItemToArray(list, cJSON_CreateNumber(segment->of[i]));
}

void tcs_describe_labels(cJSON *json, const tc_volume *volume) {
  size_t count;
  const tc_segment *segments = tc_volume_segments(volume, &count);
  cJSON *list = count ? cJSON_AddArrayToObject(json, "labels") : NULL;
  for (size_t i = 0; i < count; i++) {
    cJSON *label = cJSON_CreateObject();
    cJSON_AddNumberToObject(label, "label", segments[i].label);
    if (segments[i].name[0]) cJSON_AddStringToObject(label, "name", segments[i].name);
    if (segments[i].of[0]) add_members(cJSON_AddArrayToObject(label, "of"), volume, &segments[i]);
    double rgb[3];
    for (int c = 0; c < 3; c++) rgb[c] = rint((double)segments[i].color[c] * 1000) / 1000;
    if (segments[i].has_color) add_vector(label, "color", rgb, 3);
    cJSON_AddItemToArray(list, label);
  }
}

static void add_window(cJSON *json, const char *name, double center, double width) {
  cJSON *window = cJSON_AddObjectToObject(json, name);
  cJSON_AddNumberToObject(window, "center", center);
  cJSON_AddNumberToObject(window, "width", width);
}

/* Adds what a client needs to fit presets and windows as the default scene does. */
static void describe_fit(cJSON *json, const tc_fit *fit, bool has_body) {
  cJSON *display = cJSON_AddObjectToObject(json, "display"), *windows = cJSON_AddObjectToObject(display, "windows");
  add_vector(display, "range", (const double[3]){fit->stretch.low, fit->stretch.middle, fit->stretch.high}, 3);
  cJSON_AddNumberToObject(display, "unitDistance", fit->stretch.unit);
  cJSON_AddBoolToObject(display, "table", has_body);
  for (int i = 0; i < TC_MODE_COUNT; i++)
    if (fit->windows[i].width > 0) add_window(windows, tc_mode_names[i], fit->windows[i].center, fit->windows[i].width);
}

void tcs_volume_describe(cJSON *json, const tc_volume *volume, const tc_fit *fit, bool has_body) {
  const tc_volume_desc *desc = tc_volume_describe(volume);
  const tc_volume_stats *stats = tc_volume_statistics(volume);
  cJSON_AddItemToObject(json, "dims", cJSON_CreateIntArray(desc->dims, 3));
  add_vector(json, "spacing", desc->spacing, 3);
  add_vector(json, "origin", desc->origin, 3);
  cJSON *direction = cJSON_AddArrayToObject(json, "direction");
  for (int row = 0; row < 3; row++)
    cJSON_AddItemToArray(direction, cJSON_CreateDoubleArray(desc->direction + 3 * row, 3));
  cJSON_AddStringToObject(json, "type", tc_voxel_type_name(desc->type));
  add_vector(json, "range", (const double[2]){stats->min, stats->max}, 2);
  cJSON_AddNumberToObject(json, "bytes", (double)tc_volume_bytes(volume));
  cJSON_AddStringToObject(json, "modality", desc->modality);
  cJSON_AddStringToObject(json, "format", desc->format);
  cJSON_AddStringToObject(json, "unit", desc->unit);
  cJSON_AddNumberToObject(json, "slope", desc->slope);
  cJSON_AddNumberToObject(json, "intercept", desc->intercept);
  tcs_describe_provenance(json, volume);
  if (tc_volume_sparse(volume)) tcs_describe_model(cJSON_AddObjectToObject(json, "model"), tc_volume_model(volume));
  cJSON_AddNumberToObject(json, "nonFinite", (double)stats->non_finite);
  if (desc->window_width > 0) add_window(json, "window", desc->window_center, desc->window_width);
  describe_fit(json, fit, has_body);
}

static void add_volume(cJSON *volumes, const tc_series *s) {
  cJSON *object = cJSON_CreateObject();
  cJSON_AddNumberToObject(object, "number", s->volume);
  cJSON_AddNumberToObject(object, "slices", s->slices);
  cJSON_AddStringToObject(object, "what", s->what);
  cJSON_AddItemToArray(volumes, object);
}

static cJSON *series_json(const tc_series *s) {
  cJSON *object = cJSON_CreateObject();
  cJSON_AddNumberToObject(object, "number", s->number);
  cJSON_AddStringToObject(object, "uid", s->uid);
  cJSON_AddStringToObject(object, "modality", s->modality);
  cJSON_AddStringToObject(object, "label", s->label);
  if (*s->description) cJSON_AddStringToObject(object, "description", s->description);
  if (*s->time) cJSON_AddStringToObject(object, "time", s->time);
  if (*s->patient) cJSON_AddStringToObject(object, "patient", s->patient);
  cJSON_AddNumberToObject(object, "files", s->files);
  cJSON_AddNumberToObject(object, "frames", s->frames);
  cJSON_AddNumberToObject(object, "rows", s->rows);
  cJSON_AddNumberToObject(object, "columns", s->columns);
  return object;
}

/* One row for each volume of a series. */
cJSON *tcs_describe_series(const tc_series *series, size_t count) {
  cJSON *list = cJSON_CreateArray(), *volumes = NULL;
  for (size_t i = 0; i < count; i++) {
    if (series[i].volume == 1 || !volumes) {
      cJSON *object = series_json(&series[i]);
      volumes = cJSON_AddArrayToObject(object, "volumes");
      cJSON_AddItemToArray(list, object);
    }
    add_volume(volumes, &series[i]);
  }
  return list;
}
