/* tomocast report: error against run time, over scenes and settings (NUMERICS section 6).
 *
 * Results are appended to DIR/results.jsonl as they are measured, each with a key of everything it depends on: volume,
 * scene, sizes, threads, program, setting. Known results are not measured again, so that an interrupted run can
 * continue. */
#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "protocol/protocol.h"
#include "renderer/export/export.h"
#include "server/bench/bench.h"
#include "server/bench/report.h"
#include "server/bench/timing.h"

enum { BATCH = 8 };
#define MAX_RESULTS_BYTES (256u << 20)

typedef struct report {
  char *volume, *document, *output, **rest;
  char *program; /* identifies the build: results of other builds are measured again */
  gboolean quick, no_gl;
  tcs_report_options options;
  tcs_report_bench *bench;
  GHashTable *known; /* key -> tcs_report_row (owned), from earlier runs in this folder */
  GHashTable *sides; /* key of a scene -> side of its compared pictures */
  GHashTable *found; /* key of an object -> its entry (owned) */
  FILE *log;
  GArray *rows; /* of this report */
  cJSON *scenes, *objects, *left_out;
  int scene, n_scenes, measured, exit_code;
  double start_ms;
} report;

static tc_interrupt stop = {.pause_us = LLONG_MAX};
static void on_signal(int signal) { atomic_store(&stop.cancel, true); }

static bool io_error(GError **error, const char *what, const char *path) {
  tc_set_error(error, TC_ERROR_IO, NULL, "%s %s: %s", what, path, g_strerror(errno));
  return false;
}

/* ---- progress ---- */

static void show_progress(const report *r, const char *scene, double part) {
  enum { WIDTH = 24 };
  if (!isatty(2)) { /* a log: one line a scene */
    if (part == 0) fprintf(stderr, "%d of %d: %s\n", r->scene + 1, r->n_scenes + 1, scene);
    return;
  }
  double share = (r->scene + part) / r->n_scenes, seconds = (tcs_now_ms() - r->start_ms) / 1e3;
  int full = (int)(share * WIDTH), left = share > 0 ? (int)(seconds * (1 - share) / share + 0.5) : 0;
  fprintf(stderr, "\r\033[K[%.*s%.*s] %3.0f %%  %s  %.1f settings/s  %d:%02d left ", full, "########################",
          WIDTH - full, "........................", 100 * share, scene, r->measured / fmax(seconds, 1e-3), left / 60,
          left % 60);
}

static void end_progress(void) {
  if (isatty(2)) fprintf(stderr, "\r\033[K");
}

/* ---- results.jsonl ---- */

static void remember(report *r, const char *line, size_t size) {
  tcs_report_row row;
  cJSON *json = tcp_json_parse(line, size, NULL); /* a line cut off by a kill does not parse */
  const cJSON *key = cJSON_GetObjectItemCaseSensitive(json, "side of"),
              *side = cJSON_GetObjectItemCaseSensitive(json, "side"),
              *object = cJSON_GetObjectItemCaseSensitive(json, "object");
  if (tcs_report_row_read(json, &row))
    g_hash_table_replace(r->known, g_strdup(row.key), g_memdup2(&row, sizeof row));
  else if (cJSON_IsString(key) && cJSON_IsNumber(side) && side->valueint >= 1 && side->valueint <= 4096)
    g_hash_table_replace(r->sides, g_strdup(key->valuestring), GINT_TO_POINTER(side->valueint));
  else if (cJSON_IsString(object))
    g_hash_table_replace(r->found, g_strdup(object->valuestring), cJSON_DetachItemFromObjectCaseSensitive(json, "is"));
  cJSON_Delete(json);
}

static bool open_log(report *r, GError **error) {
  char *path = g_build_filename(r->output, "results.jsonl", NULL), *text = NULL;
  size_t size = 0;
  bool good = true;
  if (g_mkdir_with_parents(r->output, 0777)) {
    g_free(path);
    return io_error(error, "make", r->output);
  }
  if (g_file_test(path, G_FILE_TEST_EXISTS)) good = tcs_cli_read_text(path, MAX_RESULTS_BYTES, &text, &size, error);
  for (const char *at = text, *end; good && text && at < text + size; at = end + 1) {
    end = memchr(at, '\n', (size_t)(text + size - at));
    if (!end) end = text + size;
    remember(r, at, (size_t)(end - at));
  }
  if (good) {
    r->log = fopen(path, "a");
    if (!r->log)
      good = io_error(error, "open", path);
    else if (size && text[size - 1] != '\n')
      fputc('\n', r->log);
  }
  g_free(text);
  g_free(path);
  return good;
}

/* Takes ownership of json. */
static bool append(report *r, cJSON *json, GError **error) {
  char *line = cJSON_PrintUnformatted(json);
  bool good = fprintf(r->log, "%s\n", line) > 0 && fflush(r->log) == 0;
  cJSON_free(line);
  cJSON_Delete(json);
  return good || io_error(error, "write", "results.jsonl");
}

/* ---- keys ---- */

static char *identify_program(void) {
  char *bytes = NULL, *sum = NULL;
  gsize size;
  if (g_file_get_contents("/proc/self/exe", &bytes, &size, NULL))
    sum = g_compute_checksum_for_data(G_CHECKSUM_SHA256, (const guchar *)bytes, size);
  g_free(bytes);
  return sum ? sum : g_strdup(TC_VERSION);
}

static char *scene_key(const report *r, const tcs_report_scene *scene, char **fingerprint) {
  const tc_volume_desc *d = tc_volume_describe(scene->volume);
  cJSON *json = tcp_scene_write(&scene->scene);
  char *text = cJSON_PrintUnformatted(json);
  char *conditions = g_strdup_printf("%s %d %d %d %d %d %s", r->program, r->options.size, r->options.side,
                                     r->options.threads, r->options.quick, d->type, text);
  GChecksum *sum = g_checksum_new(G_CHECKSUM_SHA256), *all = g_checksum_new(G_CHECKSUM_SHA256);
  g_checksum_update(sum, (const guchar *)d->dims, sizeof d->dims);
  g_checksum_update(sum, (const guchar *)d->spacing, sizeof d->spacing);
  g_checksum_update(sum, (const guchar *)d->origin, sizeof d->origin);
  g_checksum_update(sum, (const guchar *)d->direction, sizeof d->direction);
  g_checksum_update(sum, (const guchar *)&d->slope, sizeof d->slope);
  g_checksum_update(sum, (const guchar *)&d->intercept, sizeof d->intercept);
  g_checksum_update(sum, tc_volume_data(scene->volume), (gssize)tc_volume_bytes(scene->volume));
  *fingerprint = g_strndup(g_checksum_get_string(sum), 16);
  g_checksum_update(all, (const guchar *)*fingerprint, 16);
  g_checksum_update(all, (const guchar *)conditions, (gssize)strlen(conditions));
  char *key = g_strndup(g_checksum_get_string(all), 16);
  g_checksum_free(all);
  g_checksum_free(sum);
  g_free(conditions);
  cJSON_free(text);
  cJSON_Delete(json);
  return key;
}

static void copy_name(const cJSON *scene, const char *name, char *to, size_t size) {
  g_strlcpy(to, cJSON_GetObjectItemCaseSensitive(scene, name)->valuestring, size);
}

/* The row of a setting before its measurement, with the names of the scene document. */
static tcs_report_row blank_row(const tcs_report_scene *scene, const tcs_setting *s, const char *key) {
  tcs_report_row row = {.step = s->step,
                        .rays = s->rays,
                        .coherence = s->coherence,
                        .jitter = s->jitter,
                        .termination = s->termination,
                        .table_size = s->table_size,
                        .table_bits = s->table_bits};
  tc_scene named;
  tc_scene_init(&named);
  tcs_setting_apply(s, &named);
  cJSON *json = tcp_scene_write(&named);
  copy_name(json, "classification", row.classification, sizeof row.classification);
  copy_name(json, "order", row.order, sizeof row.order);
  copy_name(json, "filter", row.filter, sizeof row.filter);
  cJSON_Delete(json);
  tc_scene_clear(&named);
  g_strlcpy(row.scene, scene->name, sizeof row.scene);
  g_strlcpy(row.backend, s->backend == TC_BACKEND_GL ? "gl" : "cpu", sizeof row.backend);
  g_snprintf(row.key, sizeof row.key, "%s/%s/%s/%s/%s/%.6g/%d%s%s/%.6g/%d/%d", key, row.backend, row.classification,
             row.order, row.filter, s->step, s->rays, s->coherence ? "c" : "", s->jitter ? "j" : "", s->termination,
             s->table_size, s->table_bits);
  return row;
}

/* ---- scenes ---- */

/* Measures missing settings in batches, each headed by the anchor: the scene's first plain setting. */
static bool measure_missing(report *r, const tcs_report_scene *scene, const GArray *settings, const GArray *blanks,
                            GError **error) {
  tcs_setting batch[BATCH + 1] = {
      {.backend = TC_BACKEND_CPU, .classification = TC_PREINTEGRATED, .step = 1, .rays = 1}};
  tcs_report_row rows[BATCH + 1];
  int count = 0;
  for (guint i = 0; i <= settings->len; i++) {
    bool last = i == settings->len;
    const tcs_report_row *blank = last ? NULL : &g_array_index(blanks, tcs_report_row, i);
    if (!last && !g_hash_table_contains(r->known, blank->key)) {
      batch[++count] = g_array_index(settings, tcs_setting, i);
      rows[count] = *blank;
    }
    if (count < BATCH && !(last && count)) continue;
    rows[0] = (tcs_report_row){0};
    show_progress(r, scene->name, (double)i / settings->len);
    if (!tcs_report_measure(r->bench, batch, count + 1, rows, error)) return false;
    for (int k = 1; k <= count; k++) {
      if (rows[k].runs == 0)
        continue; /* refused by the back end: retried next time, so that the reason is reported again */
      g_hash_table_replace(r->known, g_strdup(rows[k].key), g_memdup2(&rows[k], sizeof rows[k]));
      if (!append(r, tcs_report_row_write(&rows[k]), error)) return false;
    }
    r->measured += count;
    count = 0;
  }
  return true;
}

static cJSON *scene_json(const tcs_report_scene *scene, const char *fingerprint, int side) {
  const tc_volume_desc *d = tc_volume_describe(scene->volume);
  cJSON *json = cJSON_CreateObject(), *volume = cJSON_AddObjectToObject(json, "volume");
  cJSON_AddStringToObject(json, "name", scene->name);
  cJSON_AddStringToObject(json, "title", scene->title);
  cJSON_AddStringToObject(json, "why", scene->why);
  cJSON_AddBoolToObject(json, "smooth", scene->smooth);
  cJSON_AddNumberToObject(json, "side", side);
  cJSON_AddItemToObject(volume, "dims", cJSON_CreateIntArray(d->dims, 3));
  cJSON_AddStringToObject(volume, "type", tc_voxel_type_name(d->type));
  cJSON_AddStringToObject(volume, "fingerprint", fingerprint);
  cJSON_AddItemToObject(json, "roughness", tcs_report_roughness(scene));
  cJSON_AddItemToObject(json, "scene", tcp_scene_write(&scene->scene));
  return json;
}

/* Adds the scene's results, known or new, to r->rows, even if some could not be measured. */
static void take_rows(report *r, const GArray *blanks, cJSON *json) {
  guint before = r->rows->len;
  for (guint i = 0; i < blanks->len; i++) {
    const tcs_report_row *row = g_hash_table_lookup(r->known, g_array_index(blanks, tcs_report_row, i).key);
    if (!row) continue;
    tcs_report_row mine = *row; /* the measurement may be known under another scene's name */
    g_strlcpy(mine.scene, g_array_index(blanks, tcs_report_row, i).scene, sizeof mine.scene);
    g_array_append_val(r->rows, mine);
  }
  tcs_report_steady(r->rows, before);
  if (r->rows->len > before)
    cJSON_AddItemToArray(r->scenes, json);
  else
    cJSON_Delete(json);
}

static bool report_scene(report *r, tcs_report_scene *scene, GError **error) {
  char *fingerprint, *key = scene_key(r, scene, &fingerprint);
  int known = GPOINTER_TO_INT(g_hash_table_lookup(r->sides, key)), side = known ? known : r->options.side;
  show_progress(r, scene->name, 0);
  cJSON *json = scene_json(scene, fingerprint, 0);
  GArray *settings = tcs_report_settings(scene, r->options.quick, tcs_report_bench_has_gl(r->bench), r->left_out);
  GArray *blanks = g_array_new(FALSE, FALSE, sizeof(tcs_report_row));
  for (guint i = 0; i < settings->len; i++) {
    tcs_report_row row = blank_row(scene, &g_array_index(settings, tcs_setting, i), key);
    g_array_append_val(blanks, row);
  }
  bool good = tcs_report_bench_scene(r->bench, scene, &side, error);
  if (good && !known) {
    cJSON *line = cJSON_CreateObject();
    cJSON_AddStringToObject(line, "side of", key);
    cJSON_AddNumberToObject(line, "side", side);
    good = append(r, line, error);
  }
  cJSON_SetNumberValue(cJSON_GetObjectItem(json, "side"), side);
  good = good && measure_missing(r, scene, settings, blanks, error);
  take_rows(r, blanks, json);
  g_array_free(blanks, TRUE);
  g_array_free(settings, TRUE);
  g_free(fingerprint);
  g_free(key);
  return good;
}

/* ---- objects ---- */

/* An object's entry, known or new; NULL if the renderer refuses it, which is reported. */
static const cJSON *object_entry(report *r, const tcs_report_scene *object, GError **error) {
  char *fingerprint, *key = scene_key(r, object, &fingerprint);
  const cJSON *known = g_hash_table_lookup(r->found, key);
  const int side = r->options.side ? r->options.side : r->options.quick ? 128 : 256;
  GError *own = NULL;
  cJSON *json =
      known ? NULL
            : tcs_report_object_measure(tcs_report_bench_cpu(r->bench), object, r->options.quick ? 2 : 5, side, &own);
  if (json) {
    cJSON *line = cJSON_CreateObject();
    cJSON_AddStringToObject(line, "object", key);
    cJSON_AddItemToObject(line, "is", cJSON_Duplicate(json, true));
    g_hash_table_replace(r->found, g_strdup(key), json);
    r->measured++;
    if (append(r, line, error)) known = json;
  } else if (own) {
    tcs_report_leave_out(r->left_out, "objects", own->message);
    g_error_free(own);
  }
  g_free(fingerprint);
  g_free(key);
  return known;
}

static bool report_objects(report *r, GError **error) {
  tc_volume *own = r->volume ? tc_import(r->volume, NULL, error) : NULL;
  GError *failed = NULL;
  if (r->volume && !own) return false;
  for (int i = 0; i < tcs_report_object_count(own != NULL) && !failed && !atomic_load(&stop.cancel); i++) {
    tcs_report_scene object;
    const cJSON *entry =
        tcs_report_object_make(i, own, r->options.size, &object, &failed) ? object_entry(r, &object, &failed) : NULL;
    if (entry) cJSON_AddItemToArray(r->objects, cJSON_Duplicate(entry, true));
    tcs_report_scene_clear(&object);
  }
  tc_volume_unref(own);
  if (failed) {
    g_propagate_error(error, failed);
  } else if (atomic_load(&stop.cancel)) {
    tc_set_error(error, TC_ERROR_CANCELLED, NULL, "interrupted");
  }
  return !failed && !atomic_load(&stop.cancel);
}

static bool report_scenes(report *r, GError **error) {
  r->n_scenes = r->volume ? 1 : tcs_report_scene_count();
  bool good = true;
  for (r->scene = 0; good && r->scene < r->n_scenes; r->scene++) {
    tcs_report_scene scene;
    good = (r->volume ? tcs_report_scene_load(r->volume, r->document, &scene, error)
                      : tcs_report_scene_make(r->scene, &scene, error)) &&
           report_scene(r, &scene, error);
    tcs_report_scene_clear(&scene);
  }
  if (good) show_progress(r, "objects", 0);
  good = good && report_objects(r, error);
  end_progress();
  return good;
}

/* ---- files ---- */

static bool write_file(const report *r, const char *name, char *text, GError **error) {
  char *path = g_build_filename(r->output, name, NULL);
  bool good = tc_export_bytes(text, strlen(text), path, error);
  g_free(path);
  g_free(text);
  return good;
}

static bool write_reports(report *r, bool complete, GError **error) {
  cJSON *json = cJSON_CreateObject(), *about = cJSON_AddObjectToObject(json, "about"), *scene;
  cJSON_AddStringToObject(about, "version", TC_VERSION);
  cJSON_AddBoolToObject(about, "complete", complete);
  cJSON_AddBoolToObject(about, "quick", r->options.quick);
  cJSON_AddNumberToObject(about, "size", r->options.size);
  cJSON_AddItemToObject(about, "machine", tcs_report_bench_about(r->bench));
  cJSON_AddItemToObject(json, "leftOut", r->left_out);
  cJSON_AddItemToObject(json, "scenes", r->scenes);
  cJSON_AddItemToObject(json, "objects", r->objects);
  cJSON_ArrayForEach(scene, r->scenes) {
    char *loss = tcs_report_loss(r->rows, scene);
    cJSON_AddStringToObject(scene, "loss", loss);
    g_free(loss);
    const char *name = cJSON_GetObjectItem(scene, "name")->valuestring;
    char *conclusion = tcs_report_conclusion(r->rows, name);
    cJSON_AddStringToObject(scene, "conclusion", conclusion);
    g_free(conclusion);
    cJSON_AddItemToObject(scene, "summary", tcs_report_summary(r->rows, name));
  }
  cJSON *results = cJSON_AddArrayToObject(json, "results");
  for (guint i = 0; i < r->rows->len; i++)
    cJSON_AddItemToArray(results, tcs_report_row_write(&g_array_index(r->rows, tcs_report_row, i)));
  char *text = cJSON_Print(json), *compact = cJSON_PrintUnformatted(json);
  r->scenes = r->objects = r->left_out = NULL; /* owned by json now */
  bool good = write_file(r, "report.json", g_strdup(text), error);
  good = write_file(r, "report.csv", tcs_report_csv(r->rows), good ? error : NULL) && good;
  good = write_file(r, "report.html", tcs_report_page(compact), good ? error : NULL) && good;
  cJSON_free(compact);
  cJSON_free(text);
  cJSON_Delete(json);
  return good;
}

static void print_summary(const report *r) {
  const cJSON *scene;
  for (int b = 0; b < TCS_REPORT_BOUNDS; b++) {
    printf("fastest with an rms under %s:\n", tcs_report_bound_names[b]);
    cJSON_ArrayForEach(scene, r->scenes) {
      const char *name = cJSON_GetObjectItem(scene, "name")->valuestring;
      int row = tcs_report_cheapest(r->rows, name, tcs_report_bounds[b], false);
      if (row < 0) {
        printf("  %-18s none\n", name);
        continue;
      }
      const tcs_report_row *best = &g_array_index(r->rows, tcs_report_row, row);
      char *title = tcs_report_row_title(best);
      printf("  %-18s %8.2f ms  %s (rms %.2g)\n", name, best->time_ms, title, tcs_report_error(best));
      g_free(title);
    }
  }
  printf("%u settings and %d objects, %d of them measured now, in %.0f s; see %s/report.html\n", r->rows->len,
         cJSON_GetArraySize(r->objects), r->measured, (tcs_now_ms() - r->start_ms) / 1e3, r->output);
}

/* ---- command line ---- */

static bool parse(report *r, int argc, char **argv, GError **error) {
  tcs_report_options *o = &r->options;
  const GOptionEntry entries[] = {
      {"output", 0, 0, G_OPTION_ARG_FILENAME, &r->output, "folder for the report; goes on where an earlier run ended",
       "DIR"},
      {"quick", 0, 0, G_OPTION_ARG_NONE, &r->quick, "fewer settings and smaller pictures: some minutes on two cores", NULL},
      {"volume", 0, 0, G_OPTION_ARG_FILENAME, &r->volume, "this volume instead of the built-in scenes", "V"},
      {"scene", 0, 0, G_OPTION_ARG_FILENAME, &r->document, "scene document for --volume", "S"},
      {"size", 0, 0, G_OPTION_ARG_INT, &o->size, "width and height of timed pictures (512; quick 192)", "PIXELS"},
      {"side", 0, 0, G_OPTION_ARG_INT, &o->side, "width and height of compared pictures (by the reference's speed)",
       "PIXELS"},
      {"threads", 0, 0, G_OPTION_ARG_INT, &o->threads, "CPU workers (one per core)", "N"},
      {"no-gl", 0, 0, G_OPTION_ARG_NONE, &r->no_gl, "leave the gl back end out", NULL},
      {0}};
  const tcs_cli_usage usage = {
      "report", "--output DIR", "Measures error against run time over scenes and settings: JSON, CSV and a page.", entries};
  r->exit_code = TCS_EXIT_USAGE;
  if (!tcs_cli_parse(&usage, argc, argv, &r->rest, error)) return false;
  o->quick = r->quick, o->gl = !r->no_gl;
  if (o->size == 0) o->size = o->quick ? 192 : 512;
  const char *bad = r->rest                          ? "takes options only; the volume is --volume V"
                    : !r->output                     ? "--output DIR expected"
                    : r->document && !r->volume      ? "--scene S goes with --volume V"
                    : o->size < 16 || o->size > 4096 ? "--size: 16 to 4096 pixels expected"
                    : o->side < 0 || o->side > 1024  ? "--side: up to 1024 pixels expected"
                    : o->threads < 0 || o->threads > 1024 ? "--threads: must be 0 to 1024"
                                                          : NULL;
  if (bad) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "%s", bad);
    return false;
  }
  r->exit_code = TCS_EXIT_FAILED;
  return true;
}

static bool run(report *r, GError **error) {
  const struct sigaction act = {.sa_handler = on_signal, .sa_flags = (int)SA_RESETHAND}; /* a second signal kills */
  sigaction(SIGINT, &act, NULL);
  sigaction(SIGTERM, &act, NULL);
  r->start_ms = tcs_now_ms();
  r->program = identify_program();
  if (!open_log(r, error)) return false;
  r->bench = tcs_report_bench_new(&r->options, &stop, r->left_out, error);
  if (!r->bench) return false;
  GError *own = NULL;
  bool complete = report_scenes(r, &own), interrupted = g_error_matches(own, TC_ERROR, TC_ERROR_CANCELLED);
  if (!complete && !interrupted) {
    g_propagate_error(error, own);
    return false;
  }
  if (complete) print_summary(r);
  bool written = write_reports(r, complete, error);
  if (interrupted && written)
    tc_set_error(error, TC_ERROR_CANCELLED, NULL,
                 "interrupted: the report holds %u settings; the same command goes on from here", r->rows->len);
  g_clear_error(&own);
  return complete && written;
}

int tcs_report(int argc, char **argv) {
  report r = {.known = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, g_free),
              .sides = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL),
              .found = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, (GDestroyNotify)cJSON_Delete),
              .rows = g_array_new(FALSE, FALSE, sizeof(tcs_report_row)),
              .scenes = cJSON_CreateArray(),
              .objects = cJSON_CreateArray(),
              .left_out = cJSON_CreateArray()};
  GError *error = NULL;
  int code = TCS_EXIT_DONE;
  if (!parse(&r, argc, argv, &error) || !run(&r, &error)) code = tcs_cli_fail("report", r.exit_code, error);
  tcs_report_bench_free(r.bench);
  if (r.log) fclose(r.log);
  g_hash_table_destroy(r.known);
  g_hash_table_destroy(r.sides);
  g_hash_table_destroy(r.found);
  g_array_free(r.rows, TRUE);
  cJSON_Delete(r.scenes);
  cJSON_Delete(r.objects);
  cJSON_Delete(r.left_out);
  g_free(r.volume);
  g_free(r.program);
  g_free(r.document);
  g_free(r.output);
  g_strfreev(r.rest);
  return code;
}
