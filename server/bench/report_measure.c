/* Errors of frames against the reference, and their times, in one run.
 *
 * Errors are measured on a small whole picture: its rays sample the picture plane regularly, and structural similarity
 * needs a whole picture. Times are measured on a larger picture. The settings of a batch take turns, frame by frame, so
 * that drift of the machine's speed affects all alike. The first setting of every batch is the same, the anchor, which
 * shows the drift between batches. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/reference/reference.h"
#include "server/bench/difference.h"
#include "server/bench/parallel.h"
#include "server/bench/report.h"
#include "server/bench/timing.h"

enum { AREA_SIDE = 4, MOST_RUNS = 5, LEAST_SIDE = 24 };
static const int sides[] = {LEAST_SIDE, 32, 48, 64, 96, 128, 192, 256};

/* The reference pictures of one filter. */
typedef struct truth {
  bool asked;
  int side, n_area;
  int *area_pixels; /* [n_area] */
  float *centres;   /* [side][side][4]; NULL: the reference does not support this filter */
  float *areas;     /* [n_area][4], mean over the pixel's area */
} truth;

struct tcs_report_bench {
  tcs_report_options options;
  const tc_interrupt *stop;
  cJSON *left_out;
  tc_renderer *renderers[TC_BACKEND_COUNT];
  tcs_report_scene *scene; /* the caller's */
  tc_volume *volume;       /* the scene's volume, referenced until the next scene */
  int side;                /* of the linear filter's compared pictures; slower references use smaller ones */
  truth truths[TC_FILTER_COUNT];
  tc_frame small, large;
};

static bool stopped(const tcs_report_bench *b, GError **error) {
  if (!atomic_load(&b->stop->cancel)) return false;
  tc_set_error(error, TC_ERROR_CANCELLED, NULL, "interrupted");
  return true;
}

/* ---- life cycle ---- */

tcs_report_bench *tcs_report_bench_new(const tcs_report_options *options, const tc_interrupt *stop, cJSON *left_out,
                                       GError **error) {
  tcs_report_bench *b = g_new0(tcs_report_bench, 1);
  *b = (tcs_report_bench){.options = *options, .stop = stop, .left_out = left_out};
  for (int i = TC_BACKEND_CPU; i <= TC_BACKEND_GL; i++) {
    const tc_renderer_options wanted = {.backend = (tc_backend)i, .threads = options->threads};
    GError *own = NULL;
    if (i == TC_BACKEND_GL && !options->gl) continue;
    b->renderers[i] = tc_renderer_new(&wanted, &own);
    if (b->renderers[i]) continue;
    if (i == TC_BACKEND_CPU) {
      g_propagate_error(error, own);
      tcs_report_bench_free(b);
      return NULL;
    }
    tcs_report_leave_out(left_out, "gl back end", own->message);
    g_error_free(own);
  }
  return b;
}

static void forget(tcs_report_bench *b) {
  for (int i = 0; i < TC_BACKEND_COUNT && b->volume; i++)
    if (b->renderers[i]) tc_renderer_forget(b->renderers[i], b->volume);
  tc_volume_unref(b->volume);
  for (int f = 0; f < TC_FILTER_COUNT; f++) {
    g_free(b->truths[f].centres);
    g_free(b->truths[f].areas);
    g_free(b->truths[f].area_pixels);
  }
  memset(b->truths, 0, sizeof b->truths);
  b->volume = NULL;
}

void tcs_report_bench_free(tcs_report_bench *b) {
  if (!b) return;
  forget(b);
  for (int i = 0; i < TC_BACKEND_COUNT; i++) tc_renderer_free(b->renderers[i]);
  tc_frame_finish(&b->small);
  tc_frame_finish(&b->large);
  g_free(b);
}

bool tcs_report_bench_has_gl(const tcs_report_bench *b) { return b->renderers[TC_BACKEND_GL] != NULL; }
tc_renderer *tcs_report_bench_cpu(const tcs_report_bench *b) { return b->renderers[TC_BACKEND_CPU]; }

cJSON *tcs_report_bench_about(const tcs_report_bench *b) {
  cJSON *json = cJSON_CreateObject();
  for (int i = TC_BACKEND_CPU; i <= TC_BACKEND_GL; i++) {
    if (!b->renderers[i]) continue;
    const tc_renderer_info *info = tc_renderer_about(b->renderers[i]);
    cJSON_AddStringToObject(json, info->backend, info->device);
    if (i != TC_BACKEND_CPU) continue;
    cJSON_AddStringToObject(json, "isa", info->isa);
    cJSON_AddNumberToObject(json, "threads", info->threads);
  }
  return json;
}

/* ---- reference pictures ---- */

static uint64_t next_random(uint64_t *state) {
  *state = *state * 6364136223846793005u + 1442695040888963407u;
  return *state >> 33;
}

/* The mean over a pixel's area, from a 4 x 4 grid of rays. */
static void area_mean(const tc_reference *r, int x, int y, float mean[4]) {
  double sum[4] = {0}, rgba[4];
  for (int i = 0; i < AREA_SIDE * AREA_SIDE; i++) {
    tc_reference_pixel(r, x + (i % AREA_SIDE + 0.5) / AREA_SIDE, y + (i / AREA_SIDE + 0.5) / AREA_SIDE, rgba);
    for (int c = 0; c < 4; c++) sum[c] += rgba[c] / (AREA_SIDE * AREA_SIDE);
  }
  for (int c = 0; c < 4; c++) mean[c] = (float)sum[c];
}

typedef struct truth_job {
  const tcs_report_bench *bench;
  const tc_reference *reference;
  truth *truth;
} truth_job;

/* Task i: a row of the picture, or beyond those a pixel whose area is integrated. */
static void find_truth(void *data, int i) {
  truth_job *job = data;
  truth *t = job->truth;
  if (atomic_load(&job->bench->stop->cancel)) return;
  if (i >= t->side) {
    int pixel = t->area_pixels[i - t->side];
    area_mean(job->reference, pixel % t->side, pixel / t->side, t->areas + 4 * (i - t->side));
    return;
  }
  for (int x = 0; x < t->side; x++) {
    double rgba[4];
    tc_reference_pixel(job->reference, x + 0.5, i + 0.5, rgba);
    for (int c = 0; c < 4; c++) t->centres[4 * (i * t->side + x) + c] = (float)rgba[c];
  }
}

static tc_reference *reference_of(tcs_report_bench *b, tc_filter filter, int side, GError **error) {
  tc_scene scene;
  tc_scene_copy(&scene, &b->scene->scene);
  scene.filter = filter;
  tc_reference *r = tc_reference_new(b->scene->volume, &scene, side, side, 0, error);
  tc_scene_clear(&scene);
  return r;
}

/* The largest picture that the reference can integrate in its time, extrapolated from a few rays. Half of the time is
 * for pixel areas. */
static bool choose_side(tcs_report_bench *b, tc_filter filter, int most, int *side, GError **error) {
  enum { PROBES = 128 };
  double budget_ms = (b->options.quick ? 250 : 10000) * tc_renderer_about(b->renderers[TC_BACKEND_CPU])->threads;
  tc_reference *r = reference_of(b, filter, 256, error);
  if (!r) return false;
  double rgba[4], start = tcs_now_ms();
  uint64_t state = 1;
  for (int i = 0; i < PROBES; i++)
    tc_reference_pixel(r, (double)(next_random(&state) % 256) + 0.5, (double)(next_random(&state) % 256) + 0.5, rgba);
  double ray_ms = (tcs_now_ms() - start) / PROBES;
  tc_reference_free(r);
  *side = most < LEAST_SIDE ? most : LEAST_SIDE;
  for (size_t i = 0; i < G_N_ELEMENTS(sides); i++)
    if (2 * ray_ms * sides[i] * sides[i] <= budget_ms && sides[i] <= most) *side = sides[i];
  return true;
}

static void lay_out(truth *t, int side) {
  int pixels = side * side;
  uint64_t state = 1;
  t->side = side;
  t->n_area = (pixels + AREA_SIDE * AREA_SIDE - 1) / (AREA_SIDE * AREA_SIDE);
  t->centres = g_new(float, 4 * (size_t)pixels);
  t->areas = g_new(float, 4 * (size_t)t->n_area);
  t->area_pixels = g_new(int, (size_t)t->n_area);
  for (int i = 0; i < t->n_area; i++) t->area_pixels[i] = (int)(next_random(&state) % (uint64_t)pixels);
}

/* centres are NULL if the reference does not support the filter, which is reported once. */
static const truth *truth_of(tcs_report_bench *b, tc_filter filter) {
  truth *t = &b->truths[filter];
  if (t->asked) return t;
  t->asked = true;
  GError *error = NULL;
  truth_job job = {.bench = b, .truth = t};
  int side = b->side;
  if (filter == TC_FILTER_LINEAR || b->options.side || choose_side(b, filter, b->side, &side, &error))
    job.reference = reference_of(b, filter, side, &error);
  if (!job.reference) {
    tcs_report_leave_out(b->left_out, "reference", error->message);
    g_error_free(error);
    return t;
  }
  lay_out(t, side);
  tcs_parallel(tc_renderer_about(b->renderers[TC_BACKEND_CPU])->threads, t->side + t->n_area, find_truth, &job);
  tc_reference_free((tc_reference *)job.reference);
  return t;
}

bool tcs_report_bench_scene(tcs_report_bench *b, tcs_report_scene *scene, int *side, GError **error) {
  forget(b);
  b->scene = scene;
  b->volume = tc_volume_ref(scene->volume);
  if (*side == 0 && !choose_side(b, TC_FILTER_LINEAR, b->options.size, side, error)) return false;
  b->side = *side;
  return true;
}

/* ---- one batch ---- */

static bool render(tcs_report_bench *b, const tcs_setting *s, int side, bool compare, tc_explanation *plan,
                   GError **error) {
  const tc_render_request request = {.width = side,
                                     .height = side,
                                     .want_linear = compare,
                                     .interrupt = b->stop,
                                     .explanation = plan,
                                     .table_size = s->table_size,
                                     .table_bits = s->table_bits};
  tcs_setting_apply(s, &b->scene->scene);
  return tc_render(b->renderers[s->backend], b->scene->volume, &b->scene->scene, &request,
                   compare ? &b->small : &b->large, error);
}

static bool judge(tcs_report_bench *b, const truth *t, tcs_report_row *row) {
  tcs_difference d;
  tcs_look look = {.linear_light = b->scene->scene.image.linear_light};
  memcpy(look.background, b->scene->scene.image.background, sizeof look.background);
  if (!tcs_compare(b->small.linear, t->centres, t->side, t->side, &look, &d)) return false;
  row->pixels = (double)d.pixels;
  row->rms = d.rms, row->rms_lo = d.rms_lo, row->rms_hi = d.rms_hi, row->p999 = d.p999, row->max = d.max;
  row->ciede = d.ciede, row->ciede_max = d.ciede_max, row->ssim = d.ssim;
  float *taken = g_new(float, 4 * (size_t)t->n_area);
  for (int i = 0; i < t->n_area; i++) memcpy(taken + 4 * i, b->small.linear + 4 * t->area_pixels[i], 4 * sizeof *taken);
  bool good = tcs_compare_pixels(taken, t->areas, (size_t)t->n_area, &d);
  row->area_pixels = (double)d.pixels;
  row->area_rms = d.rms, row->area_rms_lo = d.rms_lo, row->area_rms_hi = d.rms_hi;
  row->area_p999 = d.p999, row->area_max = d.max;
  g_free(taken);
  return good;
}

/* The effect of early ray termination alone: the same setting without it has the same method error. */
static bool judge_ending(tcs_report_bench *b, const tcs_setting *s, int side, tcs_report_row *row, GError **error) {
  if (s->termination == 0) return true;
  size_t pixels = (size_t)side * (size_t)side;
  float *ended = g_memdup2(b->small.linear, 4 * pixels * sizeof *ended);
  tcs_setting whole = *s;
  tcs_difference d;
  whole.termination = 0;
  bool good = render(b, &whole, side, true, NULL, error);
  if (good && tcs_compare_pixels(ended, b->small.linear, pixels, &d)) row->ended_rms = d.rms, row->ended_max = d.max;
  g_free(ended);
  return good;
}

/* Renders the compared picture, which also builds the resources for the timed frames. */
static bool compare_one(tcs_report_bench *b, const tcs_setting *s, tcs_report_row *row, GError **error) {
  tc_explanation plan;
  const truth *t = truth_of(b, s->filter);
  if (stopped(b, error)) return false;
  if (!t->centres) return true;
  if (!render(b, s, t->side, true, &plan, error)) return false;
  row->tables_ms = b->small.stats.tables_ms;
  row->skip_ms = b->small.stats.skip_ms;
  row->table_nodes = plan.table_size;
  g_strlcpy(row->kernel, plan.kernel, sizeof row->kernel);
  if (!judge(b, t, row)) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "comparing pictures: out of memory");
    return false;
  }
  row->runs = 1; /* to be timed */
  return judge_ending(b, s, t->side, row, error);
}

static bool time_batch(tcs_report_bench *b, const tcs_setting *settings, int count, tcs_report_row *rows,
                       GError **error) {
  int runs = b->options.quick ? 3 : MOST_RUNS;
  double(*ms)[MOST_RUNS] = g_malloc0((size_t)count * sizeof *ms);
  bool good = true;
  /* Round 0 warms up caches and programs and is not counted. */
  for (int run = 0; run <= runs && good; run++)
    for (int i = 0; i < count && good; i++) {
      if (rows[i].runs == 0) continue;
      good = render(b, &settings[i], b->options.size, false, NULL, error);
      if (run > 0) ms[i][run - 1] = b->large.stats.render_ms;
      rows[i].samples = (double)b->large.stats.samples;
    }
  for (int i = 0; i < count && good; i++) {
    if (rows[i].runs == 0) continue;
    tcs_sort(ms[i], (size_t)runs);
    rows[i].runs = runs;
    rows[i].render_ms = ms[i][runs / 2];
    rows[i].render_ms_least = ms[i][0];
    rows[i].anchor_ms = rows[0].render_ms_least; /* the shortest, since a burst of another program is not drift */
  }
  g_free(ms);
  return good;
}

bool tcs_report_measure(tcs_report_bench *b, const tcs_setting *settings, int count, tcs_report_row *rows,
                        GError **error) {
  for (int i = 0; i < count; i++) {
    GError *own = NULL;
    if (compare_one(b, &settings[i], &rows[i], &own)) continue;
    if (!g_error_matches(own, TC_ERROR, TC_ERROR_UNSUPPORTED) && !g_error_matches(own, TC_ERROR, TC_ERROR_MEMORY)) {
      g_propagate_error(error, own);
      return false;
    }
    char *what = g_strconcat(tc_renderer_about(b->renderers[settings[i].backend])->backend, " back end", NULL);
    tcs_report_leave_out(b->left_out, what, own->message);
    g_free(what);
    g_error_free(own);
  }
  return time_batch(b, settings, count, rows, error);
}
