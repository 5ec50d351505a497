/* tomocast bench: frame times on this machine, stage by stage, and errors against the reference.
 *
 * All rows of a volume render the same scene, each with one kernel variant; their frames take turns, so that drift of
 * the machine's speed affects all alike. The error is over a random sample of the picture's rays, which the reference
 * integrates once per volume. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <x86intrin.h>

#include "protocol/protocol.h"
#include "renderer/export/export.h"
#include "renderer/quality/meter.h"
#include "renderer/reference/reference.h"
#include "renderer/tomocast.h"
#include "server/bench/bench.h"
#include "server/bench/edits.h"
#include "server/bench/objects.h"
#include "server/bench/paper_mesh.h"
#include "server/bench/paper_splat.h"
#include "server/bench/papers.h"
#include "server/bench/stages.h"
#include "server/bench/timing.h"
#include "server/cli/cli.h"
#include "server/encode/encode.h"

#define MAX_RUNS 1000

typedef struct arguments {
  char *scene, *json, *paper, *isa, **set, **rest;
  int size, runs, threads, pixels, cache;
  double azimuth, elevation, zoom;
  gboolean gl, objects;
} arguments;

typedef struct variant {
  const char *isa; /* NULL: the gl back end */
  bool skipping;
} variant;

/* What is measured unless --isa names one. */
static const variant usual[] = {{"scalar", true}, {"avx2", true}, {"avx512", true}, {"avx512", false}, {"scalar", false}};
enum { N_ROWS = G_N_ELEMENTS(usual) + 1 };

typedef struct row {
  variant variant;
  tc_renderer *renderer; /* NULL: no row, or not available on this machine */
  tc_frame frame;
  tc_explanation plan;
  double tables_ms, skip_ms, encode_ms; /* first frame with a new transfer function; median over several */
  double ms[MAX_RUNS];
  double rms, max; /* against the reference, 0..1 */
} row;

typedef struct bench {
  arguments args;
  tc_volume *volume;
  tc_scene scene;
  const char *name;
  double load_ms;
  int *pixels;       /* [args.pixels] indices into the picture */
  double *reference; /* [args.pixels][4] */
  double reference_ms;
  row rows[N_ROWS];
  double cycles_per_ms; /* of the time stamp counter */
  tcs_edit edits[TCS_EDITS];
  tcs_stages stages;
  row *edited; /* the last cpu row with skipping, for which edits and stages are measured; NULL: none */
  tcs_encoder *encoder;
  GByteArray *image;
} bench;

/* ---- scene ---- */

static bool make_scene(bench *b, GError **error) {
  const tcs_cli_scene from = {.file = b->args.scene, .set = b->args.set, .width = b->args.size, .height = b->args.size};
  int exit_code;
  tc_fit fit;
  tc_fit_find(&fit, b->volume);
  tc_scene_init(&b->scene);
  tc_scene_fit(&b->scene, b->volume);
  tcs_cli_place_camera(b->volume, b->args.azimuth, b->args.elevation, b->args.zoom, &b->scene.camera);
  return tcs_cli_lay_scene(&from, &fit, &b->scene, &exit_code, error);
}

/* ---- measuring ---- */

static bool render(bench *b, row *r, bool want_linear, GError **error) {
  const tc_render_request request = {.want_linear = want_linear, .explanation = &r->plan};
  b->scene.skipping.mode = r->variant.skipping ? TC_SKIPPING_AUTO : TC_SKIPPING_OFF;
  return tc_render(r->renderer, b->volume, &b->scene, &request, &r->frame, error);
}

/* A slightly different transfer function each time (its last knot moves), to measure tables, skipping and encoding
 * separately. */
static bool measure_changes(bench *b, row *r, GError **error) {
  enum { CHANGES = 5 };
  double tables[CHANGES], skips[CHANGES], encodes[CHANGES];
  for (int i = 0; i < CHANGES; i++) {
    b->scene.transfer_function.points[b->scene.transfer_function.count - 1].amount *= 1 - 1e-9;
    if (!render(b, r, false, error)) return false;
    tables[i] = r->frame.stats.tables_ms;
    skips[i] = r->frame.stats.skip_ms;
    double start = tcs_now_ms();
    if (!tcs_encode(b->encoder, &r->frame, &b->scene, 0, b->image, error)) return false;
    encodes[i] = tcs_now_ms() - start;
  }
  r->tables_ms = tcs_median(tables, CHANGES);
  r->skip_ms = tcs_median(skips, CHANGES);
  r->encode_ms = tcs_median(encodes, CHANGES);
  return true;
}

static void compare(const bench *b, row *r) {
  double sum = 0;
  r->max = 0;
  for (int i = 0; i < b->args.pixels; i++)
    for (int c = 0; c < 4; c++) {
      double d = fabs((double)r->frame.linear[4 * (size_t)b->pixels[i] + (size_t)c] - b->reference[4 * i + c]);
      sum += d * d;
      r->max = fmax(r->max, d);
    }
  r->rms = b->args.pixels ? sqrt(sum / (4.0 * b->args.pixels)) : 0;
}

static bool integrate_reference(bench *b, GError **error) {
  int size = b->args.size;
  tc_reference *reference = tc_reference_new(b->volume, &b->scene, size, size, 0, error);
  if (!reference) return false;
  double start = tcs_now_ms();
  uint64_t state = 1;
  for (int i = 0; i < b->args.pixels; i++) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    b->pixels[i] = (int)((state >> 33) % (uint64_t)(size * size));
    tc_meter_truth(reference, &b->scene, b->pixels[i] % size, b->pixels[i] / size, 1, b->reference + 4 * i);
    if (i % 64 == 0 && isatty(2)) fprintf(stderr, "\r%s: reference %d/%d ", b->name, i, b->args.pixels);
  }
  if (isatty(2)) fprintf(stderr, "\r\033[K");
  b->reference_ms = tcs_now_ms() - start;
  tc_reference_free(reference);
  return true;
}

static bool is_editable(const bench *b) { return b->scene.mode == TC_MODE_DVR && b->scene.transfer_function.count > 1; }

static bool measure_edits(bench *b, GError **error) {
  b->edited = NULL;
  for (int i = 0; i < N_ROWS && is_editable(b); i++)
    if (b->rows[i].renderer && b->rows[i].variant.isa && b->rows[i].variant.skipping) b->edited = &b->rows[i];
  b->scene.skipping.mode = TC_SKIPPING_AUTO;
  const row *r = b->edited;
  if (!r) return true;
  b->stages.ms[TCS_STAGE_TABLES] = r->tables_ms;
  b->stages.ms[TCS_STAGE_SKIP] = r->skip_ms;
  b->stages.ms[TCS_STAGE_ENCODE] = r->encode_ms;
  return tcs_edits_measure(r->renderer, b->volume, &b->scene, b->edits, error) &&
         tcs_stages_measure(r->renderer, b->volume, &b->scene, &b->stages, error);
}

static bool open_row(bench *b, row *r, variant v, GError **error) {
  const tc_renderer_options options = {.backend = v.isa ? TC_BACKEND_CPU : TC_BACKEND_GL,
                                       .isa = v.isa,
                                       .threads = b->args.threads,
                                       .cache_bytes = (uint64_t)b->args.cache << 20};
  r->variant = v;
  r->renderer = tc_renderer_new(&options, error);
  return r->renderer != NULL;
}

/* Opens the rows wanted; of the usual ones and gl, those that this machine has. */
static bool open_rows(bench *b, GError **error) {
  if (b->args.isa) {
    for (int i = 0; i < 2; i++)
      if (!open_row(b, &b->rows[i], (variant){b->args.isa, !i}, error)) return false;
  } else {
    for (int i = 0; i < N_ROWS - 1; i++) open_row(b, &b->rows[i], usual[i], NULL);
  }
  if (b->args.gl) open_row(b, &b->rows[N_ROWS - 1], (variant){NULL, true}, NULL);
  return true;
}

static bool measure(bench *b, GError **error) {
  const double start = tcs_now_ms();
  const uint64_t cycles = __rdtsc();
  if (b->args.pixels && !integrate_reference(b, error)) return false;
  if (!open_rows(b, error)) return false;
  for (int i = 0; i < N_ROWS; i++) {
    row *r = &b->rows[i];
    if (!r->renderer) continue;
    if (!measure_changes(b, r, error) || !render(b, r, true, error)) return false;
    if (b->args.pixels) compare(b, r);
  }
  for (int run = 0; run < b->args.runs; run++)
    for (int i = 0; i < N_ROWS; i++) {
      if (!b->rows[i].renderer) continue;
      if (!render(b, &b->rows[i], false, error)) return false;
      b->rows[i].ms[run] = b->rows[i].frame.stats.render_ms;
    }
  b->cycles_per_ms = (double)(__rdtsc() - cycles) / (tcs_now_ms() - start);
  return measure_edits(b, error);
}

/* ---- reporting ---- */

/* Clock cycles per sample, summed over the threads, of the shortest frame. */
static double cycles_per_sample(const bench *b, const row *r) {
  const double samples = (double)r->frame.stats.samples;
  return samples > 0 ? r->ms[0] * b->cycles_per_ms * tc_renderer_about(r->renderer)->threads / samples : 0;
}

static void name_variant(const variant *v, char name[64]) {
  g_snprintf(name, 64, "%s%s", v->isa ? v->isa : "gl", v->skipping ? "" : ", no leaping");
}

static void print_rows(bench *b) {
  const tc_volume_desc *d = tc_volume_describe(b->volume);
  printf("%s  %dx%dx%d %s, %dx%d pixels, step %g, loaded in %.0f ms\n", b->name, d->dims[0], d->dims[1], d->dims[2],
         tc_voxel_type_name(d->type), b->args.size, b->args.size, b->scene.sampling.step, b->load_ms);
  printf("  %-25s %9s %9s %9s %9s %9s %10s %9s %9s %9s\n", "variant", "table ms", "skip ms", "render ms", "(least)",
         "encode ms", "Msamples", "cycles", "rms/255", "max/255");
  for (int i = 0; i < N_ROWS; i++) {
    row *r = &b->rows[i];
    if (!r->renderer) continue;
    char name[64];
    name_variant(&r->variant, name);
    double middle = tcs_median(r->ms, (size_t)b->args.runs);
    printf("  %-25s %9.2f %9.2f %9.2f %9.2f %9.2f %10.2f %9.1f", name, r->tables_ms, r->skip_ms, middle,
           r->ms[0], r->encode_ms, (double)r->frame.stats.samples * 1e-6, cycles_per_sample(b, r));
    if (b->args.pixels)
      printf(" %9.3f %9.3f\n", 255 * r->rms, 255 * r->max);
    else
      printf(" %9s %9s\n", "-", "-");
  }
  if (!b->edited) return;
  tcs_edits_print(b->edits);
  tcs_stages_print(&b->stages, b->cycles_per_ms * tc_renderer_about(b->edited->renderer)->threads);
}

static cJSON *rows_as_json(bench *b) {
  const tc_volume_desc *d = tc_volume_describe(b->volume);
  cJSON *o = cJSON_CreateObject(), *rows = cJSON_CreateArray();
  cJSON_AddStringToObject(o, "volume", b->name);
  cJSON_AddItemToObject(o, "dims", cJSON_CreateIntArray(d->dims, 3));
  cJSON_AddStringToObject(o, "type", tc_voxel_type_name(d->type));
  cJSON_AddNumberToObject(o, "size", b->args.size);
  cJSON_AddNumberToObject(o, "step", b->scene.sampling.step);
  cJSON_AddNumberToObject(o, "loadMs", b->load_ms);
  cJSON_AddNumberToObject(o, "referencePixels", b->args.pixels);
  cJSON_AddItemToObject(o, "scene", tcp_scene_write(&b->scene));
  cJSON_AddItemToObject(o, "variants", rows);
  if (b->edited) cJSON_AddItemToObject(o, "edits", tcs_edits_as_json(b->edits));
  if (b->edited) cJSON_AddItemToObject(o, "stagesMs", tcs_stages_as_json(&b->stages));
  for (int i = 0; i < N_ROWS; i++) {
    row *r = &b->rows[i];
    if (!r->renderer) continue;
    char name[64];
    name_variant(&r->variant, name);
    cJSON *v = cJSON_CreateObject();
    cJSON_AddStringToObject(v, "variant", name);
    cJSON_AddStringToObject(v, "backend", tc_renderer_about(r->renderer)->backend);
    cJSON_AddStringToObject(v, "device", tc_renderer_about(r->renderer)->device);
    cJSON_AddStringToObject(v, "kernel", r->plan.kernel);
    cJSON_AddNumberToObject(v, "threads", tc_renderer_about(r->renderer)->threads);
    cJSON_AddNumberToObject(v, "tablesMs", r->tables_ms);
    cJSON_AddNumberToObject(v, "skipMs", r->skip_ms);
    cJSON_AddNumberToObject(v, "renderMs", tcs_median(r->ms, (size_t)b->args.runs));
    cJSON_AddItemToObject(v, "renderMsRuns", cJSON_CreateDoubleArray(r->ms, b->args.runs));
    cJSON_AddNumberToObject(v, "encodeMs", r->encode_ms);
    cJSON_AddNumberToObject(v, "cyclesPerSample", cycles_per_sample(b, r));
    cJSON_AddNumberToObject(v, "samples", (double)r->frame.stats.samples);
    cJSON_AddNumberToObject(v, "gradients", (double)r->frame.stats.gradients);
    cJSON_AddNumberToObject(v, "rays", (double)r->frame.stats.rays);
    cJSON_AddNumberToObject(v, "leaps", (double)r->frame.stats.leaps);
    if (b->args.pixels) {
      cJSON_AddNumberToObject(v, "errorRms", r->rms);
      cJSON_AddNumberToObject(v, "errorMax", r->max);
    }
    cJSON_AddItemToArray(rows, v);
  }
  return o;
}

static void release(bench *b) {
  for (int i = 0; i < N_ROWS; i++) {
    tc_renderer_free(b->rows[i].renderer);
    tc_frame_finish(&b->rows[i].frame);
  }
  memset(b->rows, 0, sizeof b->rows);
  tc_scene_clear(&b->scene);
  tc_volume_unref(b->volume);
  b->volume = NULL;
}

/* With the JSON on stdout nothing else is printed there. */
static bool prints(const bench *b) { return !b->args.json || strcmp(b->args.json, "-") != 0; }

static tcs_paper_run paper_run(const bench *b) {
  return (tcs_paper_run){b->args.paper, b->args.size, b->args.runs, b->args.threads, b->args.gl, prints(b)};
}

static bool is_paper(const bench *b, const char *paper) { return strcmp(b->args.paper, paper) == 0; }

static tcs_objects_run objects_run(const bench *b) {
  return (tcs_objects_run){b->args.runs, b->args.threads, prints(b), b->args.isa};
}

static bool bench_volume(bench *b, const char *path, cJSON *report, GError **error) {
  const char *slash = strrchr(path, '/');
  b->name = slash ? slash + 1 : path;
  double start = tcs_now_ms();
  b->volume = tc_import(path, NULL, error);
  b->load_ms = tcs_now_ms() - start;
  bool good = b->volume && make_scene(b, error);
  if (good && b->args.paper) {
    const tcs_paper_run run = paper_run(b);
    good = (is_paper(b, "003")   ? tcs_paper_mesh
            : is_paper(b, "004") ? tcs_paper_splat
                                 : tcs_paper_volume)(&run, b->volume, b->name, &b->scene, report, error);
  } else if (good && b->args.objects) {
    const tcs_objects_run run = objects_run(b);
    good = tcs_objects_volume(&run, b->volume, b->name, report, error);
  } else if (good && (good = measure(b, error))) {
    if (prints(b)) print_rows(b);
    cJSON_AddItemToArray(report, rows_as_json(b));
  }
  if (!good) {
    g_prefix_error(error, "%s: ", b->name);
  }
  release(b);
  return good;
}

static bool write_report(const char *path, const cJSON *report, GError **error) {
  char *text = cJSON_Print(report), *lines = g_strconcat(text, "\n", NULL);
  bool good = true;
  if (strcmp(path, "-"))
    good = tc_export_bytes(lines, strlen(lines), path, error);
  else if (fputs(lines, stdout) < 0 || fflush(stdout))
    good = false, tc_set_error(error, TC_ERROR_IO, NULL, "write to stdout: %s", g_strerror(errno));
  g_free(lines);
  cJSON_free(text);
  return good;
}

/* Before minutes of measuring, not after them. */
static bool check_folder(const char *path, GError **error) {
  char *folder = g_path_get_dirname(path);
  const bool good = access(folder, F_OK) == 0;
  if (!good) tc_set_error(error, TC_ERROR_IO, NULL, "--json %s: %s: %s", path, folder, g_strerror(errno));
  g_free(folder);
  return good;
}

/* A wrong name is said at once, not after volumes were loaded and references integrated. */
static bool check_isa(const char *isa, GError **error) {
  const tc_renderer_options options = {.backend = TC_BACKEND_CPU, .isa = isa, .threads = 1};
  tc_renderer *renderer = tc_renderer_new(&options, error);
  tc_renderer_free(renderer);
  return renderer != NULL;
}

static bool parse(bench *b, int argc, char **argv, GError **error) {
  arguments *a = &b->args;
  const GOptionEntry entries[] = {
      {"size", 0, 0, G_OPTION_ARG_INT, &a->size, "width and height of the picture (512)", "PIXELS"},
      {"runs", 0, 0, G_OPTION_ARG_INT, &a->runs, "timed frames per variant (9)", "N"},
      {"threads", 0, 0, G_OPTION_ARG_INT, &a->threads, "CPU workers (one per core)", "N"},
      {"isa", 0, 0, G_OPTION_ARG_STRING, &a->isa, "one kind of kernels alone: scalar, avx2, avx512 ...", "NAME"},
      {"error", 0, 0, G_OPTION_ARG_INT, &a->pixels, "pixels compared with the reference (1000; 0 = none)", "N"},
      {"azimuth", 0, 0, G_OPTION_ARG_DOUBLE, &a->azimuth, "camera, degrees about the body axis (30)", "DEG"},
      {"elevation", 0, 0, G_OPTION_ARG_DOUBLE, &a->elevation, "camera, degrees upwards (20)", "DEG"},
      {"zoom", 0, 0, G_OPTION_ARG_DOUBLE, &a->zoom, "1 fits the bounding sphere (1.3)", "FACTOR"},
      {"cache", 0, 0, G_OPTION_ARG_INT, &a->cache, "memory for tables and meshes (256); large meshes need more", "MIB"},
      {"gl", 0, 0, G_OPTION_ARG_NONE, &a->gl, "measure the gl back end too", NULL},
      {"scene", 0, 0, G_OPTION_ARG_FILENAME, &a->scene, "scene document applied to the fitted defaults", "FILE"},
      {"set", 0, 0, G_OPTION_ARG_FILENAME_ARRAY, &a->set, "change one member of the scene; may be repeated",
       "KEY=VALUE"},
      {"paper", 0, 0, G_OPTION_ARG_FILENAME, &a->paper,
       "the tables of paper 000, 001, 003 or 004 instead, beside the published", "ID"},
      {"objects", 0, 0, G_OPTION_ARG_NONE, &a->objects,
       "compare splats, ray-cast isosurface and mesh of the same objects, and what the plan suggests",
       NULL},
      {"json", 0, 0, G_OPTION_ARG_FILENAME, &a->json, "write all figures as JSON; - is stdout", "FILE"},
      {0}};
  const tcs_cli_usage usage = {"bench", "[VOLUME...]",
                               "Times frames of each kernel variant and their error against the reference.", entries};
  if (!tcs_cli_parse(&usage, argc, argv, &a->rest, error)) return false;
  if (a->size < 1 || a->size > 4096 || a->runs < 1 || a->runs > MAX_RUNS || a->pixels < 0 || a->pixels > 1000000 ||
      a->cache < 0 || !(a->zoom > 0)) {
    tc_set_error(error, TC_ERROR_INVALID, NULL,
                 "--size 1..4096, --runs 1..1000, --error 0..1000000, --cache from 0 and --zoom above 0 expected");
    return false;
  }
  if (a->json && strcmp(a->json, "-") && !check_folder(a->json, error)) return false;
  if (a->isa && !check_isa(a->isa, error)) return false;
  if (a->paper && strcmp(a->paper, "003") && strcmp(a->paper, "004") && !tcs_paper_known(a->paper)) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "--paper %s: 000 or 001 expected, or 003 or 004", a->paper);
    return false;
  }
  return true;
}

int tcs_bench(int argc, char **argv) {
  bench *b = g_new0(bench, 1);
  b->args = (arguments){.size = 512, .runs = 9, .pixels = 1000, .azimuth = 30, .elevation = 20, .zoom = 1.3};
  GError *error = NULL;
  int code = TCS_EXIT_USAGE;
  cJSON *report = cJSON_CreateArray();
  b->image = g_byte_array_new();
  if (parse(b, argc, argv, &error)) {
    code = TCS_EXIT_FAILED;
    b->pixels = g_new0(int, (size_t)b->args.pixels + 1);
    b->reference = g_new0(double, 4 * (size_t)b->args.pixels + 1);
    b->encoder = tcs_encoder_new(&error);
    static char *demos[] = {"demo:head", "demo:vessels", "demo:bucky", "demo:marschner-lobb", NULL};
    bool good = b->encoder != NULL;
    const tcs_paper_run run = paper_run(b);
    if (b->args.paper && is_paper(b, "004")) tcs_paper_splat_begin(&run);
    if (b->args.paper && tcs_paper_known(b->args.paper)) tcs_paper_begin(&run, report);
    for (char **path = b->args.rest ? b->args.rest : demos; good && *path; path++)
      good = bench_volume(b, *path, report, &error);
    if (good && b->args.objects) {
      const tcs_objects_run objects = objects_run(b);
      tcs_objects_end(&objects, report);
    }
    if (good && b->args.json) good = write_report(b->args.json, report, &error);
    if (good) code = TCS_EXIT_DONE;
  }
  if (error) tcs_cli_fail("bench", code, error);
  tcs_encoder_free(b->encoder);
  g_byte_array_free(b->image, TRUE);
  cJSON_Delete(report);
  g_free(b->pixels);
  g_free(b->reference);
  g_free(b->args.scene);
  g_free(b->args.json);
  g_free(b->args.paper);
  g_free(b->args.isa);
  g_strfreev(b->args.set);
  g_strfreev(b->args.rest);
  g_free(b);
  return code;
}
