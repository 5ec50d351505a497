/* tomocast info: the contents of a file, for people or (--json) for programs. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include <cjson/cJSON.h>

#include "renderer/tomocast.h"
#include "server/catalogue/catalogue.h"
#include "server/cli/cli.h"

typedef struct report {
  const tc_volume *volume;
  const tc_volume_desc *desc;
  const tc_volume_stats *stats;
  char orientation[4]; /* patient direction of +x, +y, +z index: "LPS" = left, posterior, superior */
  tc_series *series;
  size_t n_series;
} report;

/* The patient direction nearest to each index axis; S (superior) is towards the head. */
static void name_orientation(const double direction[9], char letters[4]) {
  for (int k = 0; k < 3; k++) {
    int best = 0;
    for (int i = 1; i < 3; i++)
      if (fabs(direction[3 * i + k]) > fabs(direction[3 * best + k])) best = i;
    letters[k] = direction[3 * best + k] < 0 ? "RAI"[best] : "LPS"[best];
  }
  letters[3] = 0;
}

/* --- --json ------------------------------------------------------------------------------------- */

static cJSON *direction_json(const tc_volume_desc *d) {
  cJSON *rows = cJSON_CreateArray();
  for (int i = 0; i < 3; i++) cJSON_AddItemToArray(rows, cJSON_CreateDoubleArray(d->direction + 3 * i, 3));
  return rows;
}

static cJSON *window_json(const tc_volume_desc *d) {
  cJSON *window = cJSON_CreateObject();
  cJSON_AddNumberToObject(window, "center", d->window_center);
  cJSON_AddNumberToObject(window, "width", d->window_width);
  return window;
}

static void print_json(const report *r) {
  const tc_volume_desc *d = r->desc;
  const double range[2] = {r->stats->min, r->stats->max};
  cJSON *o = cJSON_CreateObject();
  cJSON_AddStringToObject(o, "kind", d->format);
  cJSON_AddItemToObject(o, "dims", cJSON_CreateIntArray(d->dims, 3));
  cJSON_AddItemToObject(o, "spacing", cJSON_CreateDoubleArray(d->spacing, 3));
  cJSON_AddItemToObject(o, "origin", cJSON_CreateDoubleArray(d->origin, 3));
  cJSON_AddItemToObject(o, "direction", direction_json(d));
  cJSON_AddStringToObject(o, "orientation", r->orientation);
  cJSON_AddStringToObject(o, "type", tc_voxel_type_name(d->type));
  cJSON_AddItemToObject(o, "range", cJSON_CreateDoubleArray(range, 2));
  cJSON_AddStringToObject(o, "unit", d->unit);
  cJSON_AddNumberToObject(o, "bytes", (double)tc_volume_bytes(r->volume));
  cJSON_AddStringToObject(o, "modality", d->modality);
  tcs_describe_provenance(o, r->volume);
  tcs_describe_labels(o, r->volume);
  if (tc_volume_sparse(r->volume)) tcs_describe_model(o, tc_volume_model(r->volume));
  cJSON_AddNumberToObject(o, "nonFinite", (double)r->stats->non_finite);
  if (d->window_width > 0) cJSON_AddItemToObject(o, "window", window_json(d));
  if (r->n_series) cJSON_AddItemToObject(o, "series", tcs_describe_series(r->series, r->n_series));
  char *text = cJSON_Print(o);
  puts(text);
  cJSON_free(text);
  cJSON_Delete(o);
}

/* --- for people --------------------------------------------------------------------------------- */

static void print_series(const report *r) {
  for (size_t i = 0; i < r->n_series; i++) {
    const tc_series *s = &r->series[i];
    if (s->volume == 1) {
      printf("series #%d    %s, %s, %d files, %d frames of %d x %d, %s\n", s->number, s->label,
             *s->modality ? s->modality : "no modality", s->files, s->frames, s->columns, s->rows, s->uid);
      const char *words[] = {s->description, s->time, s->patient};
      for (int k = 0, n = 0; k < 3; k++)
        if (*words[k]) printf("%s%s", n++ ? ", " : "             ", words[k]);
      if (*s->description || *s->time || *s->patient) printf("\n");
    }
    if (s->volume > 1 || (i + 1 < r->n_series && s[1].volume > 1))
      printf("  #%d#volume=%d  %d slices%s%s\n", s->number, s->volume, s->slices, *s->what ? ", " : "", s->what);
  }
}

static void print_labels(const tc_volume *volume) {
  size_t count;
  const tc_segment *s = tc_volume_segments(volume, &count);
  for (size_t i = 0; i < count; i++)
    if (!s[i].of[0]) printf("label %-6u %s\n", s[i].label, *s[i].name ? s[i].name : "without a name");
}

static void print_attributes(const tc_vmd *model) {
  const tc_vmd_head *head = &model->head;
  printf("attributes   %s", head->n_attributes ? "" : "none");
  for (int i = 0; i < head->n_attributes; i++) {
    printf("%s%s", i ? ", " : "", head->attributes[i].name);
    if (head->attributes[i].type != TC_VMD_NORMAL) printf(" %g .. %g", model->range[i][0], model->range[i][1]);
  }
  printf("\n");
}

static void print_text(const report *r) {
  const tc_volume_desc *d = r->desc;
  const tc_provenance *from = tc_volume_provenance(r->volume);
  const char *gap = *d->unit ? " " : "";
  printf("kind         %s\n", d->format);
  printf("dims         %d x %d x %d\n", d->dims[0], d->dims[1], d->dims[2]);
  printf("spacing      %g x %g x %g mm\n", d->spacing[0], d->spacing[1], d->spacing[2]);
  printf("origin       %g, %g, %g mm LPS\n", d->origin[0], d->origin[1], d->origin[2]);
  for (int i = 0; i < 3; i++)
    printf("%-12s [% .6f % .6f % .6f]\n", i ? "" : "direction", d->direction[3 * i], d->direction[3 * i + 1],
           d->direction[3 * i + 2]);
  printf("orientation  %s\n", r->orientation);
  printf("type         %s\n", tc_voxel_type_name(d->type));
  printf("range        %g .. %g%s%s\n", r->stats->min, r->stats->max, gap, d->unit);
  printf("bytes        %zu\n", tc_volume_bytes(r->volume));
  printf("modality     %s\n", *d->modality ? d->modality : "unknown");
  printf("frames       %d\n", d->frames);
  if (tc_volume_sparse(r->volume)) print_attributes(tc_volume_model(r->volume));
  if (from->slices_found) printf("slices       %d of %d\n", from->slices_used, from->slices_found);
  if (d->window_width > 0) printf("window       center %g, width %g\n", d->window_center, d->window_width);
  if (r->stats->non_finite)
    printf("replaced     %llu voxels that were not finite\n", (unsigned long long)r->stats->non_finite);
  if (*d->note) printf("note         %s\n", d->note);
  print_labels(r->volume);
  print_series(r);
}

/* --- the command -------------------------------------------------------------------------------- */

/* A path "folder#2#volume=3" selects a series and volume; the list covers the whole folder. */
static bool list_series(report *r, const char *path, bool patient, GError **error) {
  const tc_import_options options = {.patient = patient};
  char *plain = g_strdup(path);
  for (char *mark; !g_file_test(plain, G_FILE_TEST_EXISTS) && (mark = strrchr(plain, '#'));) *mark = 0;
  bool good = strcmp(r->desc->format, "dicom") != 0 || tc_import_list(plain, &options, &r->series, &r->n_series, error);
  g_free(plain);
  return good;
}

static bool show(const char *path, bool json, bool patient, GError **error) {
  if (tc_import_names_mesh(path)) return tcs_cli_info_mesh(path, json, error);
  tc_volume *volume = tc_import(path, NULL, error);
  if (!volume) return false;
  report r = {.volume = volume, .desc = tc_volume_describe(volume), .stats = tc_volume_statistics(volume)};
  name_orientation(r.desc->direction, r.orientation);
  bool good = list_series(&r, path, patient, error);
  if (good) (json ? print_json : print_text)(&r);
  g_free(r.series);
  tc_volume_unref(volume);
  return good;
}

int tcs_cli_info(int argc, char **argv) {
  gboolean json = FALSE, patient = FALSE;
  char **rest = NULL;
  GError *error = NULL;
  const GOptionEntry entries[] = {
      {"json", 0, 0, G_OPTION_ARG_NONE, &json, "as JSON", NULL},
      {"patient", 0, 0, G_OPTION_ARG_NONE, &patient, "also whose series each is, and of which day", NULL},
      {0}};
  const tcs_cli_usage usage = {
      "info", "VOLUME", "Says what a volume file, folder or demo:NAME, a mesh (.ply, .stl, .obj) or a .vmd holds.",
      entries};
  int code = TCS_EXIT_DONE;
  bool good = tcs_cli_parse(&usage, argc, argv, &rest, &error);
  if (good && (!rest || g_strv_length(rest) != 1)) {
    tc_set_error(&error, TC_ERROR_INVALID, NULL, "give one VOLUME; see tomocast info --help");
    good = false;
  }
  if (!good)
    code = tcs_cli_fail("info", TCS_EXIT_USAGE, error);
  else if (!show(rest[0], json, patient, &error))
    code = tcs_cli_fail("info", TCS_EXIT_FAILED, error);
  g_strfreev(rest);
  return code;
}
