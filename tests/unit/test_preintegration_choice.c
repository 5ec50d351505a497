/* What the choice of a table's size and subtables promises (classify/preintegration.h), over the built-in scenes and over random
 * transfer functions. Rays through linear fields stand for all: along those the table is all that is wrong. */
#include "tests/support/test.h"

#include "renderer/classify/preintegration.h"
#include "renderer/classify/transfer.h"
#include "server/bench/report.h"
#include "tests/support/scoped.h"

/* ---- a ray of segments looked up, and the same integrated ---- */

/* The table or one of its subtables (0: the table), and values in its nodes. */
typedef struct window {
  const float *zero;
  int columns;
  double lo, hi, scale, rim;
} window;

static window window_of(const tc_table *t, int z) {
  window w = {t->zero_row, t->columns, t->lo, t->hi, (t->n - 1) / (t->hi - t->lo), 0};
  if (z == 0) return w;
  const tc_subtable *subtable = &t->subtables[z - 1];
  return (window){t->subtable_rows[z - 1], TC_SUBTABLE_NODES + 2, subtable->lo, subtable->hi,
                  (TC_SUBTABLE_NODES - 1) / (subtable->hi - subtable->lo), subtable->rim};
}

static bool holds(const window *w, double value) { return value >= w->lo && value <= w->hi; }
static bool holds_close(const window *w, double value) {
  double node = (value - w->lo) * w->scale;
  return node >= w->rim && node <= TC_SUBTABLE_NODES - 1 - w->rim;
}

/* As kernels do (subtable_tmpl.h), in double precision. */
static double depth_in(const window *w, double a, double b) {
  double low = (fmin(a, b) - w->lo) * w->scale, high = (fmax(a, b) - w->lo) * w->scale;
  bool table = w->columns != TC_SUBTABLE_NODES + 2;
  const float *row = w->zero + 4 * (ptrdiff_t)(table ? w->columns + 1 : w->columns) * w->columns;
  int i = (int)low, j = (int)high;
  const float *p = row + 4 * i, *q = row + 4 * j;
  double x = low - i, y = high - j, p0 = (double)p[2], p1 = (double)p[3], q0 = (double)q[2], q1 = (double)q[3];
  if (i == j) return p0 + 0.5 * (x + y) * (p1 - p0);
  double sum = 0.5 * (1 - x) * (p0 + x * (p1 - p0) + p1) + 0.5 * y * (q0 + y * (q1 - q0) + q0);
  return (sum + ((double)q[0] - (double)p[4]) + ((double)q[1] - (double)p[5])) / (high - low);
}

static double depth_between(const tc_table *t, double a, double b) {
  double span = fabs(b - a), sum = 0;
  window finest = window_of(t, 0);
  for (int z = t->n_subtables; z > 0; z--) {
    window w = window_of(t, z);
    bool begins = holds(&w, a), ends = holds(&w, b);
    if (begins == ends) continue;
    double front = fmin(fmax(a, w.lo), w.hi), back = fmin(fmax(b, w.lo), w.hi);
    sum += fabs(back - front) / span * depth_in(&w, front, back);
    if (begins) a = back;
    else b = front;
  }
  for (int z = 1; z <= t->n_subtables; z++) {
    window w = window_of(t, z);
    if (holds(&w, a) && holds(&w, b)) finest = w;
  }
  return sum + fabs(b - a) / span * depth_in(&finest, a, b);
}

static void look_up(const tc_table *t, double front, double back, double out[4]) {
  window w = window_of(t, 0);
  bool cut = false;
  for (int z = 1; z <= t->n_subtables; z++) {
    window fine = window_of(t, z);
    bool begins = holds(&fine, front), ends = holds(&fine, back);
    cut = cut || (begins != ends && (holds_close(&fine, front) || holds_close(&fine, back)));
    if (begins && ends) w = fine;
  }
  double f = (front - w.lo) * w.scale, b = (back - w.lo) * w.scale;
  double low = fmin(f, b), k = fabs(b - f), x = low - floor(low), y = k - floor(k);
  ptrdiff_t stride = 4 * (b < f ? -w.columns : w.columns);
  const float *p = w.zero + (ptrdiff_t)k * stride + 4 * (ptrdiff_t)low, *q = p + stride;
  for (int c = 0; c < 4; c++)
    out[c] = (1 - y) * ((1 - x) * (double)p[c] + x * (double)p[c + 4]) +
             y * ((1 - x) * (double)q[c] + x * (double)q[c + 4]);
  if (!cut || !(out[3] > 0)) return;
  double scale = -expm1(-depth_between(t, front, back)) / out[3];
  for (int c = 0; c < 4; c++) out[c] *= scale;
}

/* Between two knots: opacity is exact, colour needs small steps where it changes. */
static void march(double sum[4], const tc_transfer_function *tf, double a, double b, double mm) {
  double from[3], to[3], inside = 1e-9 * (b - a), clear = 1 - sum[3];
  tc_color(tf, a + inside, from);
  tc_color(tf, b - inside, to);
  int n = memcmp(from, to, sizeof from) ? 60 : 1;
  for (int i = 0; i < n && clear > 1e-7; i++) {
    double v0 = a + (b - a) * i / n, v1 = a + (b - a) * (i + 1) / n;
    double w = clear * -expm1(-tc_extinction_mean(tf, v0, v1) * mm / n);
    for (int c = 0; c < 3; c++) sum[c] += w * (from[c] + (to[c] - from[c]) * (i + 0.5) / n);
    clear -= w;
  }
  sum[3] = 1 - clear;
}

static void integrate(double sum[4], const tc_transfer_function *tf, double a, double b, double mm) {
  double from = a;
  memset(sum, 0, 4 * sizeof *sum);
  for (size_t i = 0; i <= tf->count; i++) {
    size_t k = b > a ? i : tf->count - 1 - i;
    double to = i == tf->count ? b : tf->points[k].value;
    if (i < tf->count && (b > a ? to <= from || to >= b : to >= from || to <= b)) continue;
    march(sum, tf, from, to, mm * fabs((to - from) / (b - a)));
    from = to;
  }
}

/* A volume's range, transfer function and step; values and voxels are the same. */
typedef struct medium {
  const tc_transfer_function *tf;
  tc_table *table;
  double lo, hi, step_mm;
  double blur;  /* how far from its place the choice may show an edge */
  double *most; /* grows to the error of the worst ray */
} medium;

/* Segments of `delta` each from `at` on, either way; what the looked-up ray has too much or too little. With the edges
 * anywhere within `blur`: of what integrals from as far before and behind leave. */
static double ray_error(const medium *m, double at, double delta, int count, bool blurred) {
  double sum[4] = {0}, most[4] = {0}, least[4] = {1, 1, 1, 1}, worst = 0, far = m->hi - m->lo;
  for (int i = 0; i < count; i++) {
    double c[4], clear = 1 - sum[3];
    look_up(m->table, fmin(fmax(at + i * delta, m->lo), m->hi), fmin(fmax(at + (i + 1) * delta, m->lo), m->hi), c);
    for (int k = 0; k < 4; k++) sum[k] += clear * c[k];
  }
  for (int shift = blurred ? -4 : 0; shift <= (blurred ? 4 : 0); shift++) {
    double exact[4], start = at + shift * m->blur / 4;
    integrate(exact, m->tf, start, start + count * delta, count * m->step_mm);
    for (int k = 0; k < 4; k++) most[k] = fmax(most[k], exact[k]), least[k] = fmin(least[k], exact[k]);
  }
  for (int k = 0; k < 4; k++) worst = fmax(worst, fmax(sum[k] - most[k], least[k] - sum[k]));
  return !blurred && worst > 1e-3 && m->blur > 0 && far > 0 ? ray_error(m, at, delta, count, true) : worst;
}

/* The mean over phases of rays about a value. */
static double mean_error(const medium *m, double value, double delta, int phases, uint64_t *seed) {
  double sum = 0;
  for (int i = 0; i < phases; i++) {
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    int count = 2 + (int)((*seed >> 33) % 6);
    double place = (i + 0.5) / phases * count, first = value - delta * place;
    while (count > 0 && (fmax(first, first + count * delta) > m->hi)) delta > 0 ? count-- : (first += delta, count--);
    while (count > 0 && (fmin(first, first + count * delta) < m->lo)) delta < 0 ? count-- : (first += delta, count--);
    double error = count > 0 ? ray_error(m, first, delta, count, false) : 0;
    *m->most = fmax(*m->most, error);
    sum += error;
  }
  return sum / phases;
}

/* ---- random transfer functions ---- */

static double draw(uint64_t *s) {
  *s = *s * 6364136223846793005u + 1442695040888963407u;
  return (double)(*s >> 11) * 0x1p-53;
}

typedef enum family { WIDE, NARROW, PEAKS, STEPS, RISE, JUMPS, FAMILIES } family;
static const char *const families[] = {"wide", "a narrow window", "peaks of one value", "steep steps", "a stiff rise",
                                       "jumps"};

static void put(tc_knot *knots, size_t *n, double value, double amount, uint64_t *s) {
  knots[(*n)++] = (tc_knot){.value = value, .color = {draw(s), draw(s), draw(s)}, .amount = amount};
}

static size_t draw_knots(family of, tc_knot *knots, double lo, double hi, double unit, uint64_t *s) {
  double range = hi - lo, top = pow(10, draw(s) * (of == RISE ? 5 : 3) - 1), at = lo + 0.1 * range;
  size_t n = 0, groups = 1 + (size_t)(3 * draw(s)), many = 2 + (size_t)(8 * draw(s));
  double width = of == NARROW ? unit * (20 + 300 * draw(s)) : range;
  double start = of == NARROW ? lo + draw(s) * (range - width) : lo;
  if (of == WIDE || of == NARROW)
    for (size_t i = 0; i < many; i++)
      put(knots, &n, start + width * ((double)i + 0.8 * draw(s)) / (double)many, draw(s) < 0.3 ? 0 : top * draw(s), s);
  if (of == RISE) put(knots, &n, lo + range * (0.1 + 0.5 * draw(s)), 0, s), put(knots, &n, hi, top, s);
  for (size_t i = 0; i < groups && of != WIDE && of != NARROW && of != RISE; i++) {
    at += range * (0.03 + 0.2 * draw(s));
    double w = of == JUMPS ? 0 : unit * (0.5 + draw(s)), before = n ? knots[n - 1].amount : 0;
    put(knots, &n, at - w, of == PEAKS ? 0 : before, s);
    put(knots, &n, at, of == PEAKS ? top * pow(10, 3 * draw(s)) : draw(s) < 0.3 ? 0 : top * draw(s), s);
    if (of == PEAKS) put(knots, &n, at + w, 0, s);
    /* a step's clear end has no colour of its own: within an edge that is widened it would be seen */
    tc_knot *low = &knots[n - 2], *high = &knots[n - 1];
    if (of == STEPS && low->amount <= 0) memcpy(low->color, high->color, sizeof low->color);
    if (of == STEPS && high->amount <= 0) memcpy(high->color, low->color, sizeof low->color);
  }
  return n;
}

static tc_volume *range_of(tc_voxel_type type, double lo, double hi) {
  tc_volume_desc desc = {
      .dims = {2, 1, 1}, .type = type, .spacing = {1, 1, 1}, .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .slope = 1};
  tc_volume *volume = tc_volume_new(&desc, NULL);
  for (int i = 0; i < 2; i++) {
    double v = i ? hi : lo;
    if (type == TC_I16) ((int16_t *)tc_volume_voxels(volume))[i] = (int16_t)v;
    else if (type == TC_U16) ((uint16_t *)tc_volume_voxels(volume))[i] = (uint16_t)v;
    else ((float *)tc_volume_voxels(volume))[i] = (float)v;
  }
  tc_volume_seal(volume);
  return volume;
}

/* The worst of a few rates of change of the mean over phases; *most grows to that of a single ray. *complete: as the
 * choice says. */
static double judge(family of, uint64_t seed, bool *complete, double *most) {
  uint64_t s = seed * 0x9e6c63d0876a9a47u;
  for (int i = 0; i < 4; i++) draw(&s);
  tc_voxel_type type = (const tc_voxel_type[]){TC_I16, TC_U16, TC_F32}[seed % 3];
  double lo = type == TC_I16 ? -1024 - floor(31000 * draw(&s)) : 0, worst = 0;
  double hi = type == TC_F32 ? 1 : type == TC_U16 ? 65535 : 3000 + floor(29000 * draw(&s));
  double unit = type == TC_F32 ? 1.0 / 65535 : 1;
  tc_knot knots[16];
  tc_transfer_function tf = {.points = knots, .kind = TC_KNOT_EXTINCTION, .unit_distance_mm = 1};
  tf.count = draw_knots(of, knots, lo, hi, unit, &s);
  g_autoptr(tc_volume) volume = range_of(type, lo, hi);
  tc_table_params p = {.tf = &tf, .slope = 1, .step_mm = 0.5};
  tc_table_choose(volume, &p, complete);
  medium m = {&tf, tc_table_build(&p, NULL, NULL), p.voxel_lo, p.voxel_hi, p.step_mm, TC_EDGE_UNITS * unit, most};
  if (type == TC_F32) m.blur = TC_EDGE_SHARE;
  for (int i = 0; i < 4; i++) {
    double delta = (draw(&s) < 0.5 ? -1 : 1) * (hi - lo) * pow(10, -4.5 * draw(&s) - 0.3);
    double about = knots[(size_t)(draw(&s) * (double)tf.count)].value;
    worst = fmax(worst, mean_error(&m, about, delta, 24, &s));
  }
  tc_table_free(m.table);
  return worst;
}

static int ascending(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

TEST(random_transfer_functions) {
  enum { EACH = SANITIZED ? 15 : 50 };
  double all[FAMILIES * EACH];
  size_t n = 0, incomplete = 0;
  for (int of = 0; of < FAMILIES; of++) {
    size_t first = n;
    double most = 0;
    for (uint64_t seed = 1; seed <= EACH; seed++) {
      bool complete;
      double error = judge((family)of, seed, &complete, &most);
      incomplete += !complete;
      if (complete) all[n++] = error;
      if (complete && !(error <= 1.0 / 30)) fail_msg("%s, seed %d: %g", families[of], (int)seed, error);
    }
    qsort(all + first, n - first, sizeof *all, ascending);
    printf("  %-18s median %.1e, 90 %% %.1e, worst %.1e; of a single ray %.1e\n", families[of],
           all[first + (n - first) / 2], all[first + (n - first) * 9 / 10], all[n - 1], most);
    if (!(most <= 1.0 / 15)) fail_msg("%s: a ray is off by %g", families[of], most);
  }
  qsort(all, n, sizeof *all, ascending);
  printf("  all: median %.1e, 95 %% %.1e, worst %.1e; %zu not complete\n", all[n / 2], all[n * 19 / 20], all[n - 1],
         incomplete);
  assert_true(all[n / 2] <= 1.0 / 2500 && all[n * 19 / 20] <= 1.0 / 100 && incomplete <= n / 20);
}

/* ---- the built-in scenes ---- */

/* At every rate of change, of which one size may suit one better: the rms of all. */
static double scene_error(const tcs_report_scene *s, int n, double lo, double hi, int *subtables,
                          bool *complete) {
  const tc_volume_desc *d = tc_volume_describe(s->volume);
  tc_transfer_function tf = s->scene.transfer_function;
  tc_table_params p = {.tf = &tf, .slope = d->slope, .intercept = d->intercept, .voxel_lo = lo, .voxel_hi = hi, .n = n};
  p.step_mm = s->scene.sampling.step * fmin(d->spacing[0], fmin(d->spacing[1], d->spacing[2]));
  tc_table_subtables(s->volume, &p, complete);
  *subtables = p.n_subtables;
  assert_true(d->slope == 1 && d->intercept == 0);
  double sum = 0, most = 0;
  medium m = {&tf, tc_table_build(&p, NULL, NULL), lo, hi, p.step_mm, TC_EDGE_UNITS, &most};
  if (d->type == TC_F32) m.blur = TC_EDGE_SHARE * (hi - lo);
  int count = 0;
  uint64_t seed = 5;
  for (size_t i = 0; i < tf.count + 4; i += i < tf.count ? 1 + tf.count / 8 : 1)
    for (double delta = (hi - lo) / 1000; delta < (hi - lo) / 4; delta *= 1.9) {
      double about = i < tf.count ? tf.points[i].value : lo + (hi - lo) * (double)(i - tf.count + 1) / 5;
      if (about < lo || about > hi) continue;
      sum += pow(mean_error(&m, about, count % 2 ? delta : -delta, 24, &seed), 2);
      count++;
    }
  tc_table_free(m.table);
  return sqrt(sum / count);
}

TEST(more_nodes_are_not_worse) {
  for (int i = 0; i < tcs_report_scene_count(); i += STRIDE(3)) {
    tcs_report_scene s;
    GError *error = NULL;
    int subtables;
    double before = INFINITY, own = 0;
    if (!tcs_report_scene_make(i, &s, &error)) fail_msg("%s", error->message);
    const tc_volume_desc *d = tc_volume_describe(s.volume);
    tc_table_params p = {.tf = &s.scene.transfer_function, .slope = d->slope, .intercept = d->intercept};
    tc_table_choose(s.volume, &p, NULL);
    printf("  %-16s %4d:", s.name, p.n);
    for (int n = 256; n <= 2048; n *= 2) {
      bool complete;
      double e = scene_error(&s, n, p.voxel_lo, p.voxel_hi, &subtables, &complete);
      printf(" %.1e (%d)", e, subtables);
      if (n == p.n) own = e;
      if (!(e <= 1.3 * before + 2e-3)) fail_msg("%d nodes: %g, half as many: %g", n, e, before);
      if (complete && !(e <= 1.0 / 400)) fail_msg("%d nodes: %g", n, e);
      before = e;
    }
    printf("\n");
    if (!(own <= 1.0 / 400)) fail_msg("off by %g", own);
    tcs_report_scene_clear(&s);
  }
}

TESTS(NULL, NULL)
