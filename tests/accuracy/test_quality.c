/* Quality control: does the bound hold, and at what cost beside the best fixed step there is? Built-in volumes, a path
 * around each of them that also rises, dips and comes nearer. What every pixel of every frame is compared with is the
 * reference; cost is counted in field samples, which no other load of the machine disturbs. TC_LONG=1 takes all scenes and
 * frames, else a few of each. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "renderer/quality/meter.h"
#include "renderer/quality/quality.h"
#include "renderer/reference/reference.h"

enum { WIDTH = 96, HEIGHT = 72, PIXELS = WIDTH * HEIGHT, FRAMES = 18 };

typedef struct look {
  const char *volume;
  tc_mode mode;
  tc_shading_model shading;
} look;

static const look looks[] = {{"demo:head", TC_MODE_DVR, TC_SHADING_NONE},
                             {"demo:bucky", TC_MODE_DVR, TC_SHADING_BLINN_PHONG},
                             {"demo:vessels", TC_MODE_DVR, TC_SHADING_NONE},
                             {"demo:marschner-lobb", TC_MODE_DVR, TC_SHADING_NONE},
                             {"demo:bucky", TC_MODE_DVR, TC_SHADING_NONE},
                             {"demo:head", TC_MODE_DVR, TC_SHADING_LAMBERT},
                             {"demo:vessels", TC_MODE_MIP, TC_SHADING_NONE},
                             {"demo:head", TC_MODE_AVERAGE, TC_SHADING_NONE}};
enum { LOOKS = sizeof looks / sizeof *looks, SHORT_LOOKS = 1, SHORT_FRAMES = 3 };

static tc_renderer *renderer;
static tc_frame frame;

typedef struct path {
  tc_volume *volume;
  tc_scene scene;
  tc_camera cameras[FRAMES];
  float *wanted[FRAMES]; /* [PIXELS][4] */
  int n;
} path;

static int set_up(void **state) {
  renderer = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU, .threads = 0}, NULL);
  return !renderer;
}

static int tear_down(void **state) {
  tc_frame_finish(&frame);
  tc_renderer_free(renderer);
  return 0;
}

static void place(path *p, const tc_camera *from, int i) {
  double t = 2 * M_PI * i / p->n, rise = 0.6 * sin(2 * t), near = 1 - 0.35 * (0.5 - 0.5 * cos(t)), distance = 0;
  for (int k = 0; k < 3; k++) distance += pow(from->position[k] - from->target[k], 2);
  distance = sqrt(distance) * near;
  const double way[3] = {sin(t) * cos(rise), -cos(t) * cos(rise), sin(rise)};
  p->cameras[i] = *from;
  for (int k = 0; k < 3; k++) {
    p->cameras[i].position[k] = from->target[k] + distance * way[k];
    p->cameras[i].up[k] = k == 2;
  }
}

static void open_path(path *p, const look *l, int n) {
  GError *error = NULL;
  *p = (path){.volume = tc_import(l->volume, NULL, &error), .n = n};
  if (!p->volume) fail_msg("%s", error->message);
  tc_scene_init(&p->scene);
  tc_scene_fit(&p->scene, p->volume);
  p->scene.image.width = WIDTH, p->scene.image.height = HEIGHT;
  p->scene.mode = l->mode;
  p->scene.shading.model = l->shading;
  tc_camera from = p->scene.camera;
  for (int i = 0; i < n; i++) {
    place(p, &from, i);
    p->scene.camera = p->cameras[i];
    p->wanted[i] = malloc(PIXELS * 4 * sizeof(float));
    tc_reference *reference = tc_reference_new(p->volume, &p->scene, WIDTH, HEIGHT, 1e-7, &error);
    if (!reference) fail_msg("%s", error->message);
    assert_true(tc_reference_image(reference, 0, p->wanted[i], &error));
    tc_reference_free(reference);
  }
}

static void close_path(path *p) {
  for (int i = 0; i < p->n; i++) free(p->wanted[i]);
  tc_scene_clear(&p->scene);
  tc_volume_unref(p->volume);
}

/* A sample of preintegrated2 and what is looked up for it beside one of preintegrated, in time. */
#define SECOND_SAMPLE 1.35

/* Error of frame i in a setting; its cost is added. */
static double render(path *p, int i, tc_classification method, double step, double termination, double *cost) {
  GError *error = NULL;
  tc_scene s = p->scene; /* borrows */
  s.camera = p->cameras[i];
  s.classification = method;
  s.sampling.step = step, s.sampling.termination = termination;
  s.quality.max_error = 0;
  if (!tc_render(renderer, p->volume, &s, &(tc_render_request){.want_linear = true}, &frame, NULL, &error))
    fail_msg("%s", error->message);
  double sum = 0, max = 0;
  for (int k = 0; k < PIXELS; k++) {
    double got[4], wanted[4];
    for (int c = 0; c < 4; c++) got[c] = (double)frame.linear[4 * k + c], wanted[c] = (double)p->wanted[i][4 * k + c];
    sum += tc_meter_square(&s, got, wanted, &max);
  }
  *cost += (double)frame.stats.samples * (method == TC_PREINTEGRATED2 ? SECOND_SAMPLE : 1);
  return sqrt(sum / PIXELS);
}

/* The cheapest fixed setting that holds the bound on all of the path; INFINITY where none does. */
static double best_fixed(path *p, double bound, double *best_step) {
  static const double shares[] = {0, 1.0 / 64, 1.0 / 16, 1.0 / 4, 1};
  double best = INFINITY;
  for (int t = 0; t < 5; t++)
    for (int rung = 24; rung >= -32; rung--) {
      double cost = 0, step = exp2(rung / 8.0);
      int i = 0;
      while (i < p->n && cost < best && render(p, i, p->scene.classification, step, fmin(shares[t] * bound, 0.5), &cost) <= bound) i++;
      if (i < p->n && cost < best) continue;
      if (cost < best) best = cost, *best_step = step;
      break; /* finer steps only cost more */
    }
  return best;
}

static void measure(path *p, tc_quality_model *m, const tc_camera *camera) {
  GError *error = NULL;
  tc_quality_view view;
  if (!tc_quality_measure(renderer, p->volume, NULL, &p->scene, camera, m, NULL, &view, &error)) fail_msg("%s", error->message);
  tc_quality_add(m, &view);
}

typedef struct tally {
  int frames, held, at_once, at_once_held;
  double worst_cost;
} tally;

/* Along the path as a session goes: a frame at once with what is known, one measurement if it helps, the settled frame. */
static void follow(path *p, double bound, tally *t) {
  tc_quality_model m = {0};
  tc_quality_choice choice;
  double cost = 0, worst = 0, unused = 0, step = 0, finest = 100, coarsest = 0;
  int held = 0, promised = 0;
  p->scene.quality.max_error = bound;
  for (int i = 0; i < p->n; i++) {
    tc_camera wanted;
    p->scene.camera = p->cameras[i];
    tc_quality_choose(&m, &p->scene, &choice);
    if (choice.holds) {
      t->at_once++;
      t->at_once_held += render(p, i, choice.classification, choice.step, choice.termination, &unused) <= bound;
    }
    if (tc_quality_wants(&m, &p->scene, &wanted)) measure(p, &m, &wanted);
    tc_quality_choose(&m, &p->scene, &choice);
    double rms = render(p, i, choice.classification, choice.step, choice.termination, &cost);
    finest = fmin(finest, choice.step), coarsest = fmax(coarsest, choice.step);
    worst = fmax(worst, rms);
    promised += choice.holds;
    held += choice.holds && rms <= bound;
  }
  double best = best_fixed(p, bound, &step);
  printf("  bound %.2g: promised %d of %d, held %d, worst %.2e; steps %.3g to %.3g, %d views; ", bound, promised, p->n,
         held, worst, finest, coarsest, m.n);
  if (isfinite(best))
    printf("%.2f of the cost of the best fixed step %.3g\n", cost / best, step);
  else
    printf("no fixed step holds it\n");
  fflush(stdout);
  if (promised == p->n && isfinite(best)) t->worst_cost = fmax(t->worst_cost, cost / best);
  t->frames += promised;
  t->held += held;
  if (isfinite(best)) assert_true(promised == p->n || step < 0.1); /* what can be held is promised */
}

static void bounds_hold_at_little_cost(void **state) {
  static const double bounds[] = {1.0 / 255, 1e-3};
  bool all = getenv("TC_LONG") != NULL;
  tally t = {0};
  for (int l = 0; l < (all ? LOOKS : SHORT_LOOKS); l++) {
    path p;
    open_path(&p, &looks[l], all ? FRAMES : SHORT_FRAMES);
    printf("  %s, mode %d, shading %d\n", looks[l].volume, looks[l].mode, looks[l].shading);
    for (int b = 0; b < (all ? 2 : 1); b++) follow(&p, bounds[b], &t);
    close_path(&p);
  }
  printf("  held on %d of %d frames (%.1f %%); at once, before a view was measured, on %d of %d; cost at most %.2f of the "
         "best fixed step's\n", t.held, t.frames, 100.0 * t.held / t.frames, t.at_once_held, t.at_once, t.worst_cost);
  assert_true(t.frames > 0 && t.held >= 0.99 * t.frames);
  assert_true(t.at_once_held >= 0.9 * t.at_once);
  assert_true(t.worst_cost <= 1.25);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(bounds_hold_at_little_cost)};
  return cmocka_run_group_tests(tests, set_up, tear_down);
}
