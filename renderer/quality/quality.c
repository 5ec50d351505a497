#include "renderer/quality/quality.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/quality/meter.h"
#include "renderer/raycast/isosurface.h"
#include "renderer/reference/reference.h"

#define RUNGS_PER_OCTAVE 8
#define LEAST_RUNG (-4 * RUNGS_PER_OCTAVE)
#define MOST_RUNG (3 * RUNGS_PER_OCTAVE)

/* Views nearer than this share their curves. */
#define NEAR 0.5
/* Factor by which a frame's error may exceed the measured one: for nearby views (other sample positions, small turns),
 * and for views measured from elsewhere. */
#define NEAR_MARGIN 1.13
#define FAR_MARGIN 1.4
/* Spacing of samples before any measurement: with one ray per pixel, and the upper limit with many. */
#define CAREFUL 0.25
#define CAREFUL_OF_MANY 1.0
/* preintegrated2 is not measured if, at the cost of preintegrated, the samples of all rays of a pixel together would lie this
 * many cells or more apart: across several cells the field is not quadratic. */
#define SECOND_CELLS 2.7
/* Another method replaces the one in use if its error is at most this share of the current error. A picture is made
 * again within its time if its error falls to the second share; one rung of the step alone gains less than that. */
#define CLEARLY 0.9
#define WORTH_IT 0.75
/* Share of the error that early ray termination may cause in an opaque pixel: of maxError (measured errors include
 * termination), or of the expected error under maxMilliseconds. */
#define TERMINATION_SHARE (1.0 / 16)
/* Orders of convergence assumed outside the measured steps: at least ORDER_UP towards coarser steps, at most ORDER_DOWN
 * towards finer ones, both conservative. */
#define ORDER_UP 3.5
#define ORDER_DOWN 1.0
/* Number of rays of a measured picture, and its least number of pixels. */
#define RAYS 4000
#define LEAST_PIXELS 2500
/* Trials of a measurement: at most LOCATING to find the rung with the wanted error, then AROUND on neighbouring rungs.
 * Trials up to REACH rungs away enter the fit. */
#define LOCATING 5
#define AROUND 7
#define REACH 7

static double rung_step(int rung) { return exp2((double)rung / RUNGS_PER_OCTAVE); }
static int rung_below(double step) { return (int)floor(log2(step) * RUNGS_PER_OCTAVE + 1e-6); }
static int clamp_rung(int rung) { return rung < LEAST_RUNG ? LEAST_RUNG : rung > MOST_RUNG ? MOST_RUNG : rung; }

static bool has_methods(const tc_scene *s) {
  return s->mode == TC_MODE_DVR && (s->classification == TC_PREINTEGRATED || s->classification == TC_PREINTEGRATED2);
}

static tc_quality_method method_of(const tc_scene *s, tc_classification classification) {
  return has_methods(s) && classification == TC_PREINTEGRATED2 ? TC_QUALITY_SECOND : TC_QUALITY_FIRST;
}

static bool is_timed(const tc_scene *s) { return s->quality.max_ms > 0; }

/* Measurements have no reference for surfaces of labels and meshes. */
static bool lacks_truth(const tc_scene *scene, char *reason, size_t size) {
  const char *missing = tc_reference_missing(scene);
  if (!missing || strcmp(missing, "/mesh/surfaces") != 0) return tc_meter_refuses(scene, reason, size);
  snprintf(reason, size, "surfaces of labels and meshes in a volume have no bound on the error; set sampling.step");
  return true;
}

bool tc_quality_refuses(const tc_scene *scene, char *reason, size_t size) {
  if (!tc_is_surface(scene->mode) && scene->mode != TC_MODE_SPLAT)
    return !is_timed(scene) && lacks_truth(scene, reason, size);
  snprintf(reason, size, "mode %s has no steps to choose%s", tc_mode_names[scene->mode],
           is_timed(scene) ? "; in motion its pictures have fewer pixels and rays, so that the time is kept" : "");
  return true;
}

bool tc_quality_measures(const tc_quality_cost *cost, const tc_scene *scene) {
  char reason[96];
  if (is_timed(scene)) return cost->w > 0 && has_methods(scene) && !lacks_truth(scene, reason, sizeof reason);
  return scene->quality.max_error > 0 && !tc_quality_refuses(scene, reason, sizeof reason);
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

/* Rotates v about the unit vector `axis` (Rodrigues). */
static void turn(const double axis[3], double angle, double v[3]) {
  double c = cos(angle), s = sin(angle), dot = 0, w[3];
  for (int k = 0; k < 3; k++) dot += axis[k] * v[k];
  for (int k = 0; k < 3; k++) {
    int i = (k + 1) % 3, j = (k + 2) % 3;
    w[k] = v[k] * c + (axis[i] * v[j] - axis[j] * v[i]) * s + axis[k] * dot * (1 - c);
  }
  memcpy(v, w, sizeof w);
}

/* The camera moved on its sphere around the target: `azimuth` about up, `elevation` about right. */
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

static double curve(const tc_quality_curve *v, double spacing) {
  if (!(v->rms > 0)) return INFINITY;
  double inside = fmin(fmax(spacing, v->finest), v->coarsest);
  double order = spacing < inside ? fmin(v->order, ORDER_DOWN) : fmax(v->order, ORDER_UP);
  return v->rms * pow(inside / v->spacing, v->order) * pow(spacing / inside, order) * exp(v->spread);
}

/* The largest error among the views that count for this camera. */
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
  if (m->n == 0) return INFINITY;
  return expected(m, &scene->camera, any_near(m, &scene->camera), method_of(scene, classification),
                  step * tc_quality_stretch(scene));
}

/* ---- choosing ---- */

typedef struct option {
  double spacing, rms;
  bool holds;
} option;

/* A copy of the scene with another method; lists still belong to `scene`. */
static tc_scene with_method(const tc_scene *scene, tc_quality_method method) {
  tc_scene s = *scene;
  if (has_methods(scene)) s.classification = method == TC_QUALITY_SECOND ? TC_PREINTEGRATED2 : TC_PREINTEGRATED;
  return s;
}

/* The finest spacing within maxMilliseconds, since errors never grow towards finer spacings; the coarsest if none is
 * fast enough. The method in use may take all of the time, the other method only tc_quality_cost_share() of it. */
static option finest(const tc_quality_model *m, const tc_quality_cost *cost, const tc_scene *scene, double pixels,
                     bool near, tc_quality_method method) {
  tc_scene s = with_method(scene, method);
  const double planned = tc_quality_cost_share(cost);
  s.sampling.step = tc_quality_cost_step(cost, &s, pixels, planned * scene->quality.max_ms);
  double spacing = s.sampling.step * tc_quality_stretch(&s), ms = tc_quality_cost_ms(cost, &s, pixels);
  double share = s.classification == scene->classification ? 1 : planned * (1 + 1e-9);
  return (option){spacing, m->n ? expected(m, &scene->camera, near, method, spacing) : 0,
                  ms > 0 && ms <= share * scene->quality.max_ms};
}

/* The coarsest spacing whose error is at most maxError; the spacing of least error if there is none. */
static option coarsest(const tc_quality_model *m, const tc_scene *scene, bool near, tc_quality_method method) {
  option best = {rung_step(LEAST_RUNG), INFINITY, false};
  for (int rung = MOST_RUNG; rung >= LEAST_RUNG && !best.holds; rung--) {
    double rms = expected(m, &scene->camera, near, method, rung_step(rung));
    if (rms < best.rms) best = (option){rung_step(rung), rms, rms <= scene->quality.max_error};
  }
  return best;
}

static option best_of(const tc_quality_model *m, const tc_quality_cost *cost, const tc_scene *scene, double pixels,
                      bool near, tc_quality_method method) {
  return is_timed(scene) ? finest(m, cost, scene, pixels, near, method) : coarsest(m, scene, near, method);
}

static bool second_is_better(const tc_quality_cost *cost, const tc_scene *scene, const option *first,
                             const option *second) {
  bool timed = is_timed(scene);
  if (first->holds != second->holds) return second->holds;
  if (first->holds && !timed) return second->spacing > first->spacing * cost->second;
  if (timed && !first->holds) return false; /* both take too long: the faster one */
  bool in_use = timed && scene->classification == TC_PREINTEGRATED2;
  return in_use ? first->rms >= CLEARLY * second->rms : second->rms < CLEARLY * first->rms;
}

static double termination_for(double error) { return fmin(error * TERMINATION_SHARE, 0.05); }

/* ---- the reason ---- */

G_GNUC_PRINTF(2, 3) static void say(tc_quality_choice *choice, const char *form, ...) {
  size_t said = strlen(choice->reason);
  va_list values;
  va_start(values, form);
  vsnprintf(choice->reason + said, sizeof choice->reason - said, form, values);
  va_end(values);
}

static const char *name_of(bool second) { return second ? "preintegrated2" : "preintegrated"; }

static void explain_error(const tc_quality_model *m, const tc_scene *scene, const option *other,
                          tc_quality_choice *choice) {
  say(choice,
      choice->holds ? "step %.3g: an rms error up to %.2g is expected, %s of %d measured views; the next coarser is "
                      "over %.2g"
                    : "step %.3g: the smallest achievable error is %.2g, %s of %d measured views; no step holds %.2g",
      choice->step, choice->rms, choice->near ? "by those near" : "by the worst", m->n, scene->quality.max_error);
  if (choice->holds && other->holds)
    say(choice, "; %s would need %.3g", name_of(choice->classification != TC_PREINTEGRATED2),
        other->spacing / tc_quality_stretch(scene));
}

/* other: NULL before anything is measured. */
static void explain_time(const tc_quality_model *m, const tc_scene *scene, const option *other,
                         tc_quality_choice *choice) {
  say(choice,
      choice->ms <= 0 ? "no frame was timed yet: a step of %.3g voxel"
      : choice->holds ? "step %.3g is the finest that is expected in time: %.3g of %.3g ms"
                      : "step %.3g is the coarsest there is: %.3g ms are expected, not %.3g",
      choice->step, choice->ms, scene->quality.max_ms);
  if (!other) return;
  say(choice, "; an rms error up to %.2g, %s of %d measured views", choice->rms,
      choice->near ? "by those near" : "by the worst", m->n);
  if (isfinite(other->rms))
    say(choice, "; %s with %.3g would have %.2g", name_of(choice->classification != TC_PREINTEGRATED2),
        other->spacing / tc_quality_stretch(scene), other->rms);
}

/* The choice without measured views. */
static void choose_blindly(const tc_quality_model *m, const tc_quality_cost *cost, const tc_scene *scene, double pixels,
                           tc_quality_choice *choice) {
  double stretch = tc_quality_stretch(scene);
  if (is_timed(scene)) {
    choice->step = finest(m, cost, scene, pixels, false, method_of(scene, scene->classification)).spacing / stretch;
    return;
  }
  choice->step = fmin(CAREFUL * stretch, CAREFUL_OF_MANY) / stretch;
  choice->termination = termination_for(scene->quality.max_error);
  snprintf(choice->reason, sizeof choice->reason, "no measurement of this look yet: a conservative step of %g voxels",
           choice->step);
}

static void choose_measured(const tc_quality_model *m, const tc_quality_cost *cost, const tc_scene *scene, double pixels,
                            tc_quality_choice *choice, option *other) {
  option of[TC_QUALITY_METHODS] = {{0}, {.rms = INFINITY}};
  choice->near = any_near(m, &scene->camera);
  for (int k = 0; k < (has_methods(scene) ? TC_QUALITY_METHODS : 1); k++)
    of[k] = best_of(m, cost, scene, pixels, choice->near, (tc_quality_method)k);
  bool second = second_is_better(cost, scene, &of[TC_QUALITY_FIRST], &of[TC_QUALITY_SECOND]);
  const option *best = &of[second];
  *other = of[!second];
  choice->classification = with_method(scene, (tc_quality_method)second).classification;
  choice->step = best->spacing / tc_quality_stretch(scene);
  choice->rms = best->rms;
  choice->holds = best->holds;
  choice->termination = termination_for(is_timed(scene) ? best->rms : scene->quality.max_error);
}

void tc_quality_choose(const tc_quality_model *m, const tc_quality_cost *cost, const tc_scene *scene, double pixels,
                       tc_quality_choice *choice) {
  bool measured = m->n > 0 && tc_quality_measures(cost, scene);
  option other;
  *choice = (tc_quality_choice){.classification = scene->classification, .termination = scene->sampling.termination};
  if (measured)
    choose_measured(m, cost, scene, pixels, choice, &other);
  else
    choose_blindly(m, cost, scene, pixels, choice);
  tc_scene chosen = *scene; /* borrows */
  chosen.classification = choice->classification;
  chosen.sampling.step = choice->step;
  if (measured && has_methods(scene)) say(choice, "%s, ", name_of(choice->classification == TC_PREINTEGRATED2));
  choice->ms = tc_quality_cost_ms(cost, &chosen, pixels);
  if (is_timed(scene)) choice->holds = choice->ms > 0 && choice->ms <= scene->quality.max_ms;
  if (is_timed(scene))
    explain_time(m, scene, measured ? &other : NULL, choice);
  else if (measured)
    explain_error(m, scene, &other, choice);
}

bool tc_quality_betters(const tc_quality_model *m, const tc_scene *scene, const tc_quality_choice *choice,
                        tc_classification classification, double step) {
  double now = tc_quality_expects(m, scene, classification, step);
  if (is_timed(scene)) return choice->holds && choice->rms < WORTH_IT * now;
  return now > scene->quality.max_error && choice->rms < 0.99 * now;
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
  double share; /* pixel width of the frame relative to that of the measured picture (pixel_share) */
  const tc_interrupt *interrupt;
  double *wanted;  /* [height][width][4] */
  double *squares; /* [height][width] */
  tc_frame frame;
} bench;

static bool cancelled(const bench *b, GError **error) {
  if (!b->interrupt || !atomic_load_explicit(&b->interrupt->cancel, memory_order_relaxed)) return false;
  tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
  return true;
}

static bool integrate(bench *b, GError **error) {
  const tc_reference_request of = {.volume = b->volume,
                                   .labels = b->labels,
                                   .scene = &b->scene,
                                   .width = b->width,
                                   .height = b->height,
                                   .tolerance = 1e-7};
  tc_reference *reference = tc_reference_make(&of, error);
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
  tc_render_request request = {.width = b->width, .height = b->height, .want_linear = true, .interrupt = b->interrupt,
                               .labels = b->labels, .pixel_share = b->share};
  GError *failure = NULL;
  while (!tc_render(b->renderer, b->volume, &b->scene, &request, &b->frame, &failure)) {
    if (!g_error_matches(failure, TC_ERROR, TC_ERROR_PAUSED)) {
      g_propagate_error(error, failure);
      return false;
    }
    g_clear_error(&failure); /* paused: resume at once, because no other work waits for this renderer */
    request.resume = true;
  }
  double max = 0;
  int pixels = b->width * b->height;
  for (int i = 0; i < pixels; i++) {
    double got[4];
    for (int c = 0; c < 4; c++) got[c] = (double)b->frame.linear[4 * i + c];
    b->squares[i] = tc_meter_square(&b->scene, got, b->wanted + 4 * i, &max);
  }
  /* If a few rays have most of the error, unmeasured rays may have more; therefore the geometric mean of the estimate
   * and the upper end of its confidence interval. */
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

/* Finds the rung whose error is about the goal, assuming second-order convergence at each trial. Returns the rung, or
 * MOST_RUNG + 1 on failure. */
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

/* Fits error = c * spacing^order to the trials within REACH of `rung`: least squares of the logarithms. */
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

/* Measures the curve around the rung with error `goal`, or, if goal is 0, around `rung`. */
static bool close_in(bench *b, double goal, int rung, tc_quality_curve *found, GError **error) {
  static const int around[AROUND] = {-6, -4, -2, 0, 2, 4, 6};
  trials t = {0};
  if (goal > 0) rung = locate(b, goal, rung, &t, error);
  for (int i = 0; i < AROUND; i++)
    if (rung > MOST_RUNG || !try_rung(b, clamp_rung(rung + around[i]), &t, error)) return false;
  fit(&t, rung, found);
  return true;
}

static bool find_curves(bench *b, const tc_quality_subject *of, tc_quality_view *view, GError **error) {
  const tc_scene *scene = of->scene;
  bool timed = is_timed(scene);
  double goal = timed ? 0 : scene->quality.max_error / NEAR_MARGIN, spacing = 1;
  tc_quality_model own = {.n = 1};
  bool near = any_near(of->model, &scene->camera);
  const double pixels = tc_estimate_pixels(b->volume, scene, scene->image.width, scene->image.height);
  if (of->model->n || timed) spacing = best_of(of->model, of->cost, scene, pixels, near, TC_QUALITY_FIRST).spacing;
  b->scene.classification = with_method(scene, TC_QUALITY_FIRST).classification;
  if (!close_in(b, goal, clamp_rung(rung_below(spacing)), &view->of[TC_QUALITY_FIRST], error)) return false;
  if (!has_methods(scene)) return true;
  own.views[0] = *view;
  option first = best_of(&own, of->cost, scene, pixels, false, TC_QUALITY_FIRST);
  if (first.holds && first.spacing / tc_quality_stretch(scene) * of->cost->second >= SECOND_CELLS) return true;
  b->scene.classification = TC_PREINTEGRATED2;
  return close_in(b, goal, clamp_rung(rung_below(first.spacing * of->cost->second)), &view->of[TC_QUALITY_SECOND], error);
}

/* The measured picture has the scene's aspect and about RAYS rays. The rays of a pixel lie as close together as in a
 * frame, because their errors are correlated and do not average out. */
static void size_bench(bench *b, const tc_scene *scene) {
  double pixels = fmax(RAYS / scene->sampling.rays_per_pixel, LEAST_PIXELS);
  double aspect = fmin(fmax((double)scene->image.width / scene->image.height, 1 / pixels), pixels);
  b->width = (int)fmax(1, sqrt(pixels * aspect));
  b->height = (int)fmax(1, b->width / aspect);
  b->share = fmin(1, (double)b->height / scene->image.height);
}

bool tc_quality_measure(tc_renderer *renderer, const tc_quality_subject *of, tc_quality_view *view, GError **error) {
  bench b = {renderer, of->volume, of->labels, .scene = *of->scene, .interrupt = of->interrupt};
  size_bench(&b, of->scene);
  b.scene.camera = *of->camera;
  b.scene.sampling.termination = termination_for(of->scene->quality.max_error);
  b.scene.quality.max_error = b.scene.quality.max_ms = 0;
  b.scene.error_meter.pixels = 0;
  *view = (tc_quality_view){.camera = *of->camera};
  size_t pixels = (size_t)b.width * (size_t)b.height;
  b.wanted = malloc(pixels * 4 * sizeof *b.wanted);
  b.squares = malloc(pixels * sizeof *b.squares);
  bool good = b.wanted && b.squares;
  if (!good) tc_set_error(error, TC_ERROR_MEMORY, NULL, "quality: out of memory");
  good = good && integrate(&b, error) && find_curves(&b, of, view, error);
  free(b.wanted);
  free(b.squares);
  tc_frame_finish(&b.frame);
  return good;
}
