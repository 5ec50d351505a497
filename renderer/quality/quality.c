#include "renderer/quality/quality.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/quality/cost.h"
#include "renderer/quality/meter.h"
#include "renderer/reference/reference.h"

#define RUNGS_PER_OCTAVE 8
#define LEAST_RUNG (-4 * RUNGS_PER_OCTAVE)
#define MOST_RUNG (3 * RUNGS_PER_OCTAVE)

/* Views nearer than this share their curves. */
#define NEAR 0.5
/* What the error may be above a measured one: sampling of rays and the turn of the view; then, views from elsewhere. */
#define NEAR_MARGIN 1.13
#define FAR_MARGIN 1.4
/* Spacing before anything is measured, for a single ray and for as many as like. */
#define CAREFUL 0.25
#define CAREFUL_OF_MANY 1.0
/* What a segment of preintegrated2 costs beside one of preintegrated: the time of its two samples and three look-ups,
 * as tomocast report has them on the cpu. A constant, not a clock: one scene has one picture. */
#define SECOND_COST 2.7
/* Where preintegrated does with such a spacing, preintegrated2 would need segments over several cells to pay, along
 * which no field is quadratic: it is not measured there. */
#define SECOND_BELOW 1.0
/* The share of the bound that termination may use of an opaque pixel; it is part of what is measured. */
#define TERMINATION_SHARE (1.0 / 16)
/* Powers by which the error is taken to grow or fall beyond the measured steps: each the careful one. */
#define ORDER_UP 3.5
#define ORDER_DOWN 1.0
/* Rays of a measured picture, and its pixels at least. */
#define RAYS 4000
#define LEAST_PIXELS 2500
/* Trials of a measurement: at most so many on the way to the goal, so many about it, and how far off one still
 * counts. */
#define LOCATING 5
#define AROUND 7
#define REACH 7

static double rung_step(int rung) { return exp2((double)rung / RUNGS_PER_OCTAVE); }
static int rung_below(double step) { return (int)floor(log2(step) * RUNGS_PER_OCTAVE + 1e-6); }
static int clamp_rung(int rung) { return rung < LEAST_RUNG ? LEAST_RUNG : rung > MOST_RUNG ? MOST_RUNG : rung; }

bool tc_quality_refuses(const tc_scene *scene, char *reason, size_t size) {
  if (scene->mode != TC_MODE_ISOSURFACE) return tc_meter_refuses(scene, reason, size);
  snprintf(reason, size, "an isosurface has no steps to choose");
  return true;
}

/* ---- cameras ---- */

static void view_of(const tc_camera *c, double direction[3], double *half_height) {
  double length = 0;
  for (int k = 0; k < 3; k++) {
    direction[k] = c->target[k] - c->position[k];
    length += direction[k] * direction[k];
  }
  length = sqrt(length);
  for (int k = 0; k < 3; k++) direction[k] /= length;
  *half_height = c->projection == TC_PERSPECTIVE ? length * tan(c->fov_y_deg * M_PI / 360) : c->height_mm / 2;
}

double tc_quality_distance(const tc_camera *a, const tc_camera *b) {
  double da[3], db[3], ha, hb, dot = 0, along = 0, shift = 0;
  view_of(a, da, &ha);
  view_of(b, db, &hb);
  for (int k = 0; k < 3; k++) {
    dot += da[k] * db[k];
    along += (a->target[k] - b->target[k]) * da[k];
  }
  for (int k = 0; k < 3; k++) {
    double d = a->target[k] - b->target[k] - along * da[k];
    shift += d * d;
  }
  double lens = a->projection != b->projection    ? 1
                : a->projection == TC_PERSPECTIVE ? fabs(a->fov_y_deg - b->fov_y_deg) / 60
                                                  : 0;
  return acos(fmin(fmax(dot, -1), 1)) + fabs(log(ha / hb)) + sqrt(shift) / fmin(ha, hb) + lens;
}

static bool any_near(const tc_quality_model *m, const tc_camera *camera) {
  for (int i = 0; i < m->n; i++)
    if (tc_quality_distance(&m->views[i].camera, camera) < NEAR) return true;
  return false;
}

/* Turns v about the unit vector `axis` (Rodrigues). */
static void turn(const double axis[3], double angle, double v[3]) {
  double c = cos(angle), s = sin(angle), dot = 0, w[3];
  for (int k = 0; k < 3; k++) dot += axis[k] * v[k];
  for (int k = 0; k < 3; k++) {
    int i = (k + 1) % 3, j = (k + 2) % 3;
    w[k] = v[k] * c + (axis[i] * v[j] - axis[j] * v[i]) * s + axis[k] * dot * (1 - c);
  }
  memcpy(v, w, sizeof w);
}

/* The camera on its sphere around the target: `azimuth` about up, `elevation` about right. */
static tc_camera around(const tc_camera *from, double azimuth, double elevation) {
  tc_camera c = *from;
  double forward[3], right[3], up[3], half, n = 0, away[3];
  view_of(from, forward, &half);
  for (int k = 0; k < 3; k++) {
    int i = (k + 1) % 3, j = (k + 2) % 3;
    right[k] = forward[i] * from->up[j] - forward[j] * from->up[i];
    n += right[k] * right[k];
  }
  for (int k = 0; k < 3; k++) right[k] /= sqrt(n);
  for (int k = 0; k < 3; k++) {
    int i = (k + 1) % 3, j = (k + 2) % 3;
    up[k] = right[i] * forward[j] - right[j] * forward[i];
    away[k] = from->position[k] - from->target[k];
  }
  memcpy(c.up, up, sizeof up);
  turn(right, elevation, away);
  turn(right, elevation, c.up);
  turn(up, azimuth, away);
  turn(up, azimuth, c.up);
  for (int k = 0; k < 3; k++) c.position[k] = c.target[k] + away[k];
  return c;
}

bool tc_quality_wants(const tc_quality_model *m, const tc_scene *scene, tc_camera *camera) {
  static const double turns[][2] = {{0, 0}, {M_PI / 2, 0}, {-M_PI / 2, 0}, {M_PI, 0}, {0, M_PI / 3}, {0, -M_PI / 3}};
  for (size_t i = 0; i < sizeof turns / sizeof *turns; i++) {
    *camera = around(&scene->camera, turns[i][0], turns[i][1]);
    if (!any_near(m, camera)) return true;
  }
  return false;
}

void tc_quality_add(tc_quality_model *m, const tc_quality_view *view) {
  if (m->n < TC_QUALITY_VIEWS) {
    m->views[m->n++] = *view;
    return;
  }
  m->views[m->next] = *view;
  m->next = (m->next + 1) % TC_QUALITY_VIEWS;
}

/* ---- the curves ---- */

static bool has_methods(const tc_scene *s) {
  return s->mode == TC_MODE_DVR && (s->classification == TC_PREINTEGRATED || s->classification == TC_PREINTEGRATED2);
}

static double curve(const tc_quality_curve *v, double spacing) {
  if (!(v->rms > 0)) return INFINITY;
  double inside = fmin(fmax(spacing, v->finest), v->coarsest);
  double order = spacing < inside ? fmin(v->order, ORDER_DOWN) : fmax(v->order, ORDER_UP);
  return v->rms * pow(inside / v->spacing, v->order) * pow(spacing / inside, order) * exp(v->spread);
}

/* Of the views that count for this camera, the worst. */
static double expected(const tc_quality_model *m, const tc_camera *camera, bool near, tc_quality_method method,
                       double spacing) {
  double worst = 0;
  for (int i = 0; i < m->n; i++)
    if (!near || tc_quality_distance(&m->views[i].camera, camera) < NEAR)
      worst = fmax(worst, curve(&m->views[i].of[method], spacing));
  return worst * (near ? NEAR_MARGIN : FAR_MARGIN);
}

double tc_quality_expects(const tc_quality_model *m, const tc_scene *scene, tc_classification classification,
                          double step) {
  tc_quality_method method =
      has_methods(scene) && classification == TC_PREINTEGRATED2 ? TC_QUALITY_SECOND : TC_QUALITY_FIRST;
  if (m->n == 0) return INFINITY;
  return expected(m, &scene->camera, any_near(m, &scene->camera), method, step * tc_quality_stretch(scene));
}

/* ---- choosing ---- */

typedef struct option {
  double spacing, rms;
  bool holds;
} option;

/* The coarsest spacing that holds the bound; else the one of the least error. */
static option coarsest(const tc_quality_model *m, const tc_scene *scene, bool near, tc_quality_method method) {
  option best = {rung_step(LEAST_RUNG), INFINITY, false};
  for (int rung = MOST_RUNG; rung >= LEAST_RUNG && !best.holds; rung--) {
    double rms = expected(m, &scene->camera, near, method, rung_step(rung));
    if (rms < best.rms) best = (option){rung_step(rung), rms, rms <= scene->quality.max_error};
  }
  return best;
}

static bool second_is_better(const option *first, const option *second) {
  if (first->holds != second->holds) return second->holds;
  return first->holds ? second->spacing > first->spacing * SECOND_COST : second->rms < 0.9 * first->rms;
}

static double termination_for(double bound) { return fmin(bound * TERMINATION_SHARE, 0.05); }

static void explain(const tc_quality_model *m, const tc_scene *scene, const option *other, tc_quality_choice *choice) {
  bool named = has_methods(scene), second = named && choice->classification == TC_PREINTEGRATED2;
  const char *method = !named ? "" : second ? "preintegrated2, " : "preintegrated, ";
  int n = snprintf(choice->reason, sizeof choice->reason,
                   choice->holds
                       ? "%sstep %.3g: an rms error up to %.2g is expected, %s of %d measured views; the next "
                         "coarser is over %.2g"
                       : "%sstep %.3g: the least error to be had is %.2g, %s of %d measured views; no step holds %.2g",
                   method, choice->step, choice->rms, choice->near ? "by those near" : "by the worst", m->n,
                   scene->quality.max_error);
  if (choice->holds && isfinite(other->rms) && other->holds)
    snprintf(choice->reason + n, sizeof choice->reason - (size_t)n, "; %s would need %.3g",
             second ? "preintegrated" : "preintegrated2", other->spacing / tc_quality_stretch(scene));
}

void tc_quality_choose(const tc_quality_model *m, const tc_scene *scene, tc_quality_choice *choice) {
  double stretch = tc_quality_stretch(scene), careful = fmin(CAREFUL * stretch, CAREFUL_OF_MANY) / stretch;
  *choice = (tc_quality_choice){.classification = scene->classification,
                                .step = careful,
                                .termination = termination_for(scene->quality.max_error)};
  if (m->n == 0) {
    snprintf(choice->reason, sizeof choice->reason, "nothing is measured of this look yet: a careful step of %g voxels",
             choice->step);
    return;
  }
  choice->near = any_near(m, &scene->camera);
  option first = coarsest(m, scene, choice->near, TC_QUALITY_FIRST), second = {.rms = INFINITY};
  if (has_methods(scene) && !m->first_only) second = coarsest(m, scene, choice->near, TC_QUALITY_SECOND);
  bool better = second_is_better(&first, &second);
  const option *best = better ? &second : &first;
  if (has_methods(scene)) choice->classification = better ? TC_PREINTEGRATED2 : TC_PREINTEGRATED;
  choice->step = best->spacing / stretch;
  choice->rms = best->rms;
  choice->holds = best->holds;
  explain(m, scene, better ? &first : &second, choice);
}

void tc_quality_apply(const tc_quality_choice *choice, tc_scene *scene) {
  scene->classification = choice->classification;
  scene->sampling.step = choice->step;
  scene->sampling.termination = choice->termination;
  scene->quality.max_error = scene->quality.max_ms = 0;
}

/* ---- measuring ---- */

typedef struct bench {
  tc_renderer *renderer;
  tc_volume *volume, *labels;
  tc_scene scene; /* borrows heap members */
  int width, height;
  double share; /* of its pixels' width: the frame's */
  const atomic_bool *cancel;
  double *wanted;  /* [height][width][4] */
  double *squares; /* [height][width] */
  tc_frame frame;
} bench;

static bool cancelled(const bench *b, GError **error) {
  if (!b->cancel || !atomic_load_explicit(b->cancel, memory_order_relaxed)) return false;
  tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
  return true;
}

static bool integrate(bench *b, GError **error) {
  tc_reference *reference =
      tc_reference_new_labelled(b->volume, b->labels, &b->scene, b->width, b->height, 1e-7, error);
  if (!reference) return false;
  bool good = true;
  for (int y = 0; y < b->height && good; y++) {
    for (int x = 0; x < b->width; x++)
      tc_meter_truth(reference, &b->scene, x, y, b->share, b->wanted + 4 * (y * b->width + x));
    good = !cancelled(b, error);
  }
  tc_reference_free(reference);
  return good;
}

static bool error_at(bench *b, double spacing, double *rms, GError **error) {
  b->scene.sampling.step = spacing / tc_quality_stretch(&b->scene);
  tc_render_request request = {.width = b->width, .height = b->height, .want_linear = true, .cancel = b->cancel,
                               .labels = b->labels, .pixel_share = b->share};
  if (!tc_render(b->renderer, b->volume, &b->scene, &request, &b->frame, NULL, error)) return false;
  double max = 0;
  int pixels = b->width * b->height;
  for (int i = 0; i < pixels; i++) {
    double got[4];
    for (int c = 0; c < 4; c++) got[c] = (double)b->frame.linear[4 * i + c];
    b->squares[i] = tc_meter_square(&b->scene, got, b->wanted + 4 * i, &max);
  }
  /* Where a few rays have most of the error, others may have more: half of the way to the interval's upper end. */
  tc_meter_result estimate;
  tc_meter_estimate(b->squares, pixels, &estimate);
  *rms = sqrt(estimate.rms * estimate.high);
  return true;
}

/* Spacings measured so far. */
typedef struct trials {
  int n;
  struct { int rung; double rms; } at[LOCATING + AROUND];
} trials;

static bool try_rung(bench *b, int rung, trials *t, GError **error) {
  double rms;
  for (int i = 0; i < t->n; i++)
    if (t->at[i].rung == rung) return true;
  if (!error_at(b, rung_step(rung), &rms, error)) return false;
  t->at[t->n].rung = rung;
  t->at[t->n++].rms = fmax(rms, 1e-9);
  return true;
}

/* From rung to rung by second order until the error is about the goal. Returns the rung; MOST_RUNG + 1 after a
 * failure. */
static int locate(bench *b, double goal, int rung, trials *t, GError **error) {
  for (int i = 0; i < LOCATING; i++) {
    if (!try_rung(b, rung, t, error)) return MOST_RUNG + 1;
    double octaves = 0.5 * log2(goal / t->at[t->n - 1].rms);
    int next = clamp_rung(rung + (int)lround(RUNGS_PER_OCTAVE * fmin(fmax(octaves, -2.5), 2.5)));
    if (abs(next - rung) <= 1) return next;
    rung = next;
  }
  return rung;
}

/* The power of the spacing that fits the trials within REACH of `rung` best, in logarithms. */
static void fit(const trials *t, int rung, tc_quality_curve *view) {
  double n = 0, x1 = 0, x2 = 0, y1 = 0, xy = 0, left = 0;
  int finest = rung, coarsest = rung;
  for (int i = 0; i < t->n; i++) {
    if (abs(t->at[i].rung - rung) > REACH) continue;
    double x = (t->at[i].rung - rung) * M_LN2 / RUNGS_PER_OCTAVE, y = log(t->at[i].rms);
    n++, x1 += x, x2 += x * x, y1 += y, xy += x * y;
    if (t->at[i].rung < finest) finest = t->at[i].rung;
    if (t->at[i].rung > coarsest) coarsest = t->at[i].rung;
  }
  double wide = n * x2 - x1 * x1;
  view->order = wide > 0 ? fmin(fmax((n * xy - x1 * y1) / wide, 0), ORDER_UP) : ORDER_DOWN;
  double level = (y1 - view->order * x1) / n;
  for (int i = 0; i < t->n; i++) {
    if (abs(t->at[i].rung - rung) > REACH) continue;
    double x = (t->at[i].rung - rung) * M_LN2 / RUNGS_PER_OCTAVE, d = log(t->at[i].rms) - level - view->order * x;
    left += d * d;
  }
  view->spacing = rung_step(rung);
  view->finest = rung_step(finest);
  view->coarsest = rung_step(coarsest);
  view->rms = exp(level);
  view->spread = sqrt(left / fmax(n - 2, 1));
}

static bool close_in(bench *b, double goal, int rung, tc_quality_curve *found, GError **error) {
  static const int around[AROUND] = {-6, -4, -2, 0, 2, 4, 6};
  trials t = {0};
  rung = locate(b, goal, rung, &t, error);
  for (int i = 0; i < AROUND; i++)
    if (rung > MOST_RUNG || !try_rung(b, clamp_rung(rung + around[i]), &t, error)) return false;
  fit(&t, rung, found);
  return true;
}

static bool find_curves(bench *b, const tc_scene *scene, const tc_quality_model *model, tc_quality_view *view,
                        GError **error) {
  double goal = scene->quality.max_error / NEAR_MARGIN;
  tc_quality_model own = {.n = 1};
  tc_quality_choice start = {.step = 1 / tc_quality_stretch(scene)};
  if (model->n) tc_quality_choose(model, scene, &start);
  int rung = clamp_rung(rung_below(start.step * tc_quality_stretch(scene)));
  if (has_methods(scene)) b->scene.classification = TC_PREINTEGRATED;
  if (!close_in(b, goal, rung, &view->of[TC_QUALITY_FIRST], error)) return false;
  if (!has_methods(scene) || model->first_only) return true;
  own.views[0] = *view;
  option first = coarsest(&own, scene, false, TC_QUALITY_FIRST);
  if (first.holds && first.spacing >= SECOND_BELOW) return true;
  b->scene.classification = TC_PREINTEGRATED2;
  return close_in(b, goal, clamp_rung(rung_below(first.spacing * SECOND_COST)), &view->of[TC_QUALITY_SECOND], error);
}

/* A picture as the scene's, of as many pixels as its rays allow. Rays of a pixel keep as close as in a frame: what
 * their errors have in common does not average out. */
static void size_bench(bench *b, const tc_scene *scene) {
  double pixels = fmax(RAYS / scene->sampling.rays_per_pixel, LEAST_PIXELS);
  double aspect = fmin(fmax((double)scene->image.width / scene->image.height, 1 / pixels), pixels);
  b->width = (int)fmax(1, sqrt(pixels * aspect));
  b->height = (int)fmax(1, b->width / aspect);
  b->share = fmin(1, (double)b->height / scene->image.height);
}

bool tc_quality_measure(tc_renderer *renderer, tc_volume *volume, tc_volume *labels, const tc_scene *scene,
                        const tc_camera *camera, const tc_quality_model *model, const atomic_bool *cancel,
                        tc_quality_view *view, GError **error) {
  bench b = {.renderer = renderer, .volume = volume, .labels = labels, .scene = *scene, .cancel = cancel};
  size_bench(&b, scene);
  b.scene.camera = *camera;
  b.scene.sampling.termination = termination_for(scene->quality.max_error);
  b.scene.quality.max_error = b.scene.quality.max_ms = 0;
  b.scene.error_meter.pixels = 0;
  *view = (tc_quality_view){.camera = *camera};
  size_t pixels = (size_t)b.width * (size_t)b.height;
  b.wanted = malloc(pixels * 4 * sizeof *b.wanted);
  b.squares = malloc(pixels * sizeof *b.squares);
  bool good = b.wanted && b.squares;
  if (!good) tc_set_error(error, TC_ERROR_MEMORY, NULL, "quality: out of memory");
  good = good && integrate(&b, error) && find_curves(&b, scene, model, view, error);
  free(b.wanted);
  free(b.squares);
  tc_frame_finish(&b.frame);
  return good;
}
