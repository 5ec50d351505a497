#include "tests/support/judge.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "renderer/classify/preintegration.h"
#include "renderer/classify/transfer.h"
#include "renderer/reference/reference.h"
#include "tests/support/grid.h"

test_tally test_judged;
char test_judged_why[600];

static tc_renderer *one_thread;
static tc_frame plain, other, whole, scalar, moved;

int test_judge_open(void **state) {
  const tc_renderer_options one = {.backend = TC_BACKEND_CPU, .threads = 1};
  one_thread = tc_renderer_new(&one, NULL);
  return test_renderers_open(state) || !one_thread;
}

int test_judge_close(void **state) {
  tc_renderer_free(one_thread);
  tc_frame_finish(&plain);
  tc_frame_finish(&other);
  tc_frame_finish(&whole);
  tc_frame_finish(&scalar);
  tc_frame_finish(&moved);
  return test_renderers_close(state);
}

static bool broken(const char *format, ...) G_GNUC_PRINTF(1, 2);
static bool broken(const char *format, ...) {
  va_list args;
  va_start(args, format);
  vsnprintf(test_judged_why, sizeof test_judged_why, format, args);
  va_end(args);
  return false;
}

/* ---- one picture ---- */

/* A case ready to draw. */
typedef struct subject {
  tc_volume *volume, *labels;
  const tc_scene *scene;
  int table_size;
} subject;

typedef enum outcome { DRAWN, REFUSED, FAILED } outcome;

static outcome draw(const char *name, tc_renderer *renderer, const subject *s, const tc_scene *scene, tc_frame *frame) {
  GError *error = NULL;
  const tc_render_request request = {.want_linear = true, .labels = s->labels, .table_size = s->table_size};
  if (tc_render(renderer, s->volume, scene, &request, frame, &error)) return DRAWN;
  broken("%s: %d %s: %s", name, error->code, tc_error_pointer(error), error->message);
  bool refused = error->code == TC_ERROR_UNSUPPORTED; /* a back end may support less than the plan, but must say so */
  g_clear_error(&error);
  return refused ? REFUSED : FAILED;
}

static size_t count_pixels(const tc_frame *f) { return (size_t)f->width * (size_t)f->height; }

/* Colour and opacity are separate sums in single precision: over up to 1024 segments in a table entry, over n samples
 * along the ray. */
static double samples_a_ray(const tc_frame *f) { return (double)f->stats.samples / fmax(1, (double)f->stats.rays); }
static double slack_of(const tc_frame *f) { return 4e-6 + 2e-9 * samples_a_ray(f); }

/* Tolerance between the compositing orders: 2e-6 for some ten segments; each further segment is rounded once per sum,
 * by 6e-8 at most. */
static double order_slack_of(const tc_frame *f) { return 2e-6 + 1e-8 * samples_a_ray(f); }

/* Brightest colour that can be composited: a label's tint may be any colour, a highlight is white. */
static void find_brightest(const tc_scene *scene, double brightest[3]) {
  bool knots_alone = scene->mode == TC_MODE_DVR && scene->shading.model == TC_SHADING_NONE && !scene->labels.volume[0];
  for (int c = 0; c < 3; c++) {
    brightest[c] = !knots_alone;
    for (size_t i = 0; knots_alone && i < scene->transfer_function.count; i++) {
      double color = scene->transfer_function.points[i].color[c];
      brightest[c] = fmax(brightest[c], scene->image.linear_light ? tc_srgb_to_linear(color) : color);
    }
  }
}

bool test_judge_picture(int which, const tc_scene *scene, const tc_frame *f) {
  double brightest[3], slack = slack_of(f);
  find_brightest(scene, brightest);
  for (size_t i = 0; i < count_pixels(f); i++) {
    const float *p = f->linear + 4 * i;
    bool sane = p[3] >= 0 && p[3] <= 1;
    for (int c = 0; c < 3; c++) sane = sane && p[c] >= 0 && p[c] <= p[3] * brightest[c] + slack;
    test_judged.pixels++;
    test_judged.shown += p[3] > 0;
    if (!sane)
      return broken("%s: pixel %zu is %.9g %.9g %.9g, opacity %.9g", test_names[which], i, p[0], p[1], p[2], p[3]);
  }
  return true;
}

/* Compares bits if most is 0, else absolute differences. */
static bool check_same(const char *what, int which, const tc_frame *a, const tc_frame *b, double most) {
  for (size_t i = 0; i < 4 * count_pixels(a); i++)
    if (most > 0 ? !(fabs((double)a->linear[i] - (double)b->linear[i]) <= most)
                 : memcmp(&a->linear[i], &b->linear[i], 4) != 0)
      return broken("%s: %s: channel %zu of pixel %zu is %.9g, not %.9g", test_names[which], what, i % 4, i / 4,
                    a->linear[i], b->linear[i]);
  if (most == 0 && memcmp(a->rgba, b->rgba, 4 * count_pixels(a)) != 0)
    return broken("%s: %s: bytes differ though floats do not", test_names[which], what);
  return true;
}

/* Whether the picture shows rounding errors: interpolated values are exact to the last bits of the largest voxel, and
 * differ by up to four of these where additions have another order. A picture that spreads less than a thousand such
 * steps over 255 greys shows them, by the voxels' span or by the window. */
static bool shows_last_bits(const test_case *c) {
  enum { LAST_BITS = 1024 };
  bool windowed = c->scene.mode != TC_MODE_DVR && c->scene.mode != TC_MODE_ISOSURFACE;
  bool odd = c->pattern == TEST_ODD && c->type == TC_F32 && windowed; /* includes 1e30, the largest value of a voxel */
  float largest = odd ? 1e30f : (float)fmax(fabs(c->lo), fabs(c->hi));
  double span = (c->hi - c->lo) * (windowed ? fmin(c->scene.window.width, 1) : 1);
  return span < LAST_BITS * (double)(nextafterf(largest, INFINITY) - largest);
}

/* Moves the scene by a few last bits of single precision: the view, and the values of knots and surface. */
static void move_by_a_hair(const test_case *c, int n, const subject *s, tc_scene *to, tc_knot *knots) {
  const tc_scene *from = s->scene;
  uint64_t state = 0x9e6c63d0876a9a47u * (uint64_t)(n + 1);
  double middle[3], extent = 0;
  for (int i = 0; i < 4; i++) test_random(&state);
  for (int k = 0; k < 3; k++) {
    middle[k] = 0.5 * (c->dims[k] - 1);
    extent = fmax(extent, c->dims[k] * c->spacing[k]); /* extent of a slice's picture, for both sides */
  }
  *to = *from;
  if (!from->mpr.has_center) tc_volume_index_to_lps(s->volume, middle, to->mpr.center);
  to->mpr.has_center = true;
  for (int k = 0; k < 3; k++) {
    double way = 2 * test_random(&state) - 1, shift = way * c->spacing[k] * (1e-5 + 4e-7 * c->dims[k]);
    to->camera.position[k] += shift;
    to->camera.target[k] += shift;
    to->mpr.center[k] += way * 4e-7 * extent;
  }
  double largest = fabs(c->slope) * fmax(fabs(c->lo), fabs(c->hi)) + fabs(c->intercept);
  double value = (2 * test_random(&state) - 1) * 1e-6 * fmin(largest, 1e30);
  to->sampling.step *= 1 + 1e-6 * (2 * test_random(&state) - 1);
  to->isosurface.value += value;
  to->window.center += value;
  to->transfer_function.points = knots;
  for (size_t i = 0; i < from->transfer_function.count; i++) {
    knots[i] = from->transfer_function.points[i];
    knots[i].value += value;
  }
}

/* Number of pixels that differ from everything the scalar renderer may show. A ray that meets a cell's edge, a knot or
 * a surface within the last bits depends on rounding. Moving the scene slightly changes the scalar renderer's picture
 * there too, which distinguishes ties from faults. */
static size_t count_faults(const test_case *c, const subject *s, const tc_frame *f) {
  enum { HAIRS = 40 };
  size_t floats = 4 * count_pixels(f), faults = 0;
  float *least = g_memdup2(scalar.linear, floats * sizeof *least), *most = g_memdup2(least, floats * sizeof *most);
  tc_knot *knots = g_new(tc_knot, s->scene->transfer_function.count);
  for (int n = 0; n < HAIRS; n++) {
    tc_scene hair;
    move_by_a_hair(c, n, s, &hair, knots);
    if (draw("scalar", test_renderers[SCALAR], s, &hair, &moved) != DRAWN) continue;
    for (size_t k = 0; k < floats; k++) {
      least[k] = fminf(least[k], moved.linear[k]);
      most[k] = fmaxf(most[k], moved.linear[k]);
    }
  }
  for (size_t i = 0; i < floats; i += 4) {
    bool fault = false;
    for (size_t k = i; k < i + 4; k++)
      fault = fault || !(f->linear[k] >= least[k] - 1 / 255.0f && f->linear[k] <= most[k] + 1 / 255.0f);
    faults += fault;
  }
  g_free(knots);
  g_free(most);
  g_free(least);
  return faults;
}

static bool check_ties(int which, const test_case *c, const subject *s, const tc_frame *a) {
  size_t ties = 0, pixels = count_pixels(a);
  for (size_t i = 0; i < pixels; i++) {
    double off = 0;
    for (size_t k = 4 * i; k < 4 * i + 4; k++) off = fmax(off, fabs((double)a->linear[k] - (double)scalar.linear[k]));
    ties += off > 1.0 / 255;
  }
  bool last = shows_last_bits(c);
  *(last ? &test_judged.last_ties[which] : &test_judged.ties[which]) += ties;
  *(last ? &test_judged.last_compared[which] : &test_judged.compared[which]) += pixels;
  if (last || ties == 0) return true;
  double share = (double)ties / (double)pixels;
  if (pixels >= 12 && share > test_judged.most_ties[which]) {
    test_judged.most_ties[which] = share;
    test_judged.worst[which] = c->seed;
  }
  size_t faults = count_faults(c, s, a);
  test_judged.faults[which] += faults;
  return faults == 0 || broken("%s: %zu of %zu pixels differ from scalar by over 1/255, %zu of them no ties",
                               test_names[which], ties, pixels, faults);
}

/* ---- one case on one renderer ---- */

/* Draws a variant of the scene that must give the same picture within `most`. */
static bool check_variant(const char *what, int which, tc_renderer *on, const subject *s, const tc_scene *varied,
                          const tc_frame *usual, double most) {
  outcome drawn = draw(test_names[which], on, s, varied, &other);
  if (drawn != DRAWN) return drawn == REFUSED;
  return test_judge_picture(which, varied, &other) && check_same(what, which, usual, &other, most);
}

static bool check_renderer(int which, const subject *s, const tc_frame *usual) {
  const tc_scene *scene = s->scene;
  tc_renderer *own = test_renderers[which];
  tc_scene varied = *scene;
  bool composites = scene->mode == TC_MODE_DVR, terminates = composites && scene->sampling.termination > 0;
  if (!test_judge_picture(which, scene, usual)) return false;
  varied.skipping.mode = TC_SKIPPING_OFF;
  if (!check_variant("without leaps", which, own, s, &varied, usual, 0)) return false;
  varied = *scene;
  varied.sampling.termination = 0;
  double slack = slack_of(usual);
  if (terminates) {
    if (!check_variant("not terminated", which, own, s, &varied, usual, scene->sampling.termination + slack))
      return false;
    tc_frame swapped = whole;
    whole = other, other = swapped;
  }
  varied.order = scene->order == TC_FRONT_TO_BACK ? TC_BACK_TO_FRONT : TC_FRONT_TO_BACK;
  const tc_frame *first = terminates ? &whole : usual;
  if (composites && !check_variant("the other order", which, own, s, &varied, first, order_slack_of(first)))
    return false;
  return which != test_widest() || check_variant("on one thread", which, one_thread, s, scene, usual, 0);
}

static bool check_reference(const subject *s) {
  int width = s->scene->image.width, height = s->scene->image.height;
  GError *error = NULL;
  const tc_reference_request of = {
      .volume = s->volume, .labels = s->labels, .scene = s->scene, .width = width, .height = height, .tolerance = 1e-6};
  tc_reference *r = tc_reference_make(&of, &error);
  bool ok = r || error->code == TC_ERROR_UNSUPPORTED || broken("reference: %s", error->message);
  g_clear_error(&error);
  if (!r) return ok;
  test_judged.referenced++;
  for (int i = 0; ok && i < 2; i++) {
    double p[4], brightest[3];
    find_brightest(s->scene, brightest);
    tc_reference_pixel(r, (0.35 + 0.3 * i) * width, (0.6 - 0.2 * i) * height, p);
    for (int k = 0; ok && k < 3; k++)
      ok = (p[3] >= 0 && p[3] <= 1 && p[k] >= 0 && p[k] <= p[3] * brightest[k] + 1e-6) ||
           broken("reference: pixel %d is %.9g %.9g %.9g, opacity %.9g", i, p[0], p[1], p[2], p[3]);
  }
  tc_reference_sample *samples;
  size_t count;
  tc_reference_ray(r, 0.5 * width, 0.5 * height, &samples, &count);
  for (size_t i = 0; ok && i < count; i++)
    ok = (samples[i].transparency >= 0 && samples[i].transparency <= (i ? samples[i - 1].transparency : 1)) ||
         broken("reference: transparency %.17g at piece %zu of %zu", samples[i].transparency, i, count);
  g_free(samples);
  tc_reference_free(r);
  return ok;
}

bool test_judge(const test_case *c, unsigned on) {
  test_case completed = *c;
  tc_volume *volume = test_case_volume(&completed), *labels = test_case_labels(&completed, volume);
  const subject s = {volume, labels, &completed.scene, c->table_size};
  bool ok = !(on & TEST_ON_REFERENCE) || check_reference(&s);
  EACH_RENDERER(i) {
    /* the scalar picture is always drawn, for comparison */
    if (!ok || (!(on >> i & 1) && i != SCALAR)) continue;
    tc_frame *frame = i == SCALAR ? &scalar : &plain;
    outcome drawn = draw(test_names[i], test_renderers[i], &s, s.scene, frame);
    test_judged.cases[i] += drawn == DRAWN;
    test_judged.refused[i] += drawn == REFUSED;
    ok = drawn != FAILED;
    if (drawn != DRAWN) continue;
    ok = (i == SCALAR || check_ties(i, c, &s, frame)) && (!(on >> i & 1) || check_renderer(i, &s, frame));
  }
  for (int i = 0; i <= RENDERERS; i++) {
    tc_renderer *renderer = i < RENDERERS ? test_renderers[i] : one_thread;
    if (renderer) tc_renderer_forget(renderer, volume);
    if (renderer && labels) tc_renderer_forget(renderer, labels);
  }
  tc_volume_unref(labels);
  tc_volume_unref(volume);
  return ok;
}

void test_judge_print(void) {
  const test_tally *t = &test_judged;
  EACH_RENDERER(i) {
    printf("  %-6s %zu cases", test_names[i], t->cases[i]);
    if (t->refused[i]) printf(", %zu more refused as unsupported", t->refused[i]);
    if (t->compared[i])
      printf(
          "; %zu of %zu pixels differ from scalar by over 1/255 (%.3f %%), %zu of them no ties, at most %.0f %% of one "
          "picture (seed %llu)",
          t->ties[i], t->compared[i], 100.0 * (double)t->ties[i] / (double)t->compared[i], t->faults[i],
          100 * t->most_ties[i], (unsigned long long)t->worst[i]);
    if (t->last_compared[i]) printf("; of the last bits of voxels %zu of %zu", t->last_ties[i], t->last_compared[i]);
    printf("\n");
  }
  printf("  reference %zu cases; %zu of %zu pixels show something\n", t->referenced, t->shown, t->pixels);
}
