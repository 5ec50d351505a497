/* The reference integrator against an independent evaluation in long double that knows nothing of cells or cubics. */
#include "tests/support/reference.h"
#include <float.h>

typedef struct oracle {
  const tc_volume_desc *desc;
  const tc_volume *volume;
  const tc_transfer_function *tf;
  bool linear_light;
  long double from[3], direction[3], inverse[9];
} oracle;

static long double determinant(const long double m[9]) {
  return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
}

/* By Cramer's rule, one column at a time. */
static void oracle_set_up(oracle *o, const tc_volume *volume, const tc_scene *scene, const double from[3],
                          const double to[3]) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  long double m[9], length = 0;
  *o =
      (oracle){.desc = d, .volume = volume, .tf = &scene->transfer_function, .linear_light = scene->image.linear_light};
  for (int i = 0; i < 9; i++) m[i] = (long double)d->direction[i] * d->spacing[i % 3];
  for (int column = 0; column < 3; column++)
    for (int k = 0; k < 3; k++) {
      long double n[9];
      memcpy(n, m, sizeof n);
      for (int r = 0; r < 3; r++) n[3 * r + k] = r == column;
      o->inverse[3 * k + column] = determinant(n) / determinant(m);
    }
  for (int k = 0; k < 3; k++) {
    o->from[k] = from[k];
    o->direction[k] = (long double)to[k] - from[k];
    length += o->direction[k] * o->direction[k];
  }
  for (int k = 0; k < 3; k++) o->direction[k] /= sqrtl(length);
}

static long double stored(const oracle *o, size_t i) {
  const void *p = tc_volume_data(o->volume);
  switch (o->desc->type) {
  case TC_U8: return ((const uint8_t *)p)[i];
  case TC_I8: return ((const int8_t *)p)[i];
  case TC_U16: return ((const uint16_t *)p)[i];
  case TC_I16: return ((const int16_t *)p)[i];
  case TC_F32: return ((const float *)p)[i];
  case TC_VOXEL_TYPE_COUNT: break;
  }
  return 0;
}

/* Field at distance t; false outside. *cell: which cell it is in. */
static bool oracle_value(const oracle *o, long double t, long double *value, long *cell) {
  long double f[3];
  size_t at[3][2];
  *cell = 0;
  for (int k = 0; k < 3; k++) {
    long double x = 0;
    for (int r = 0; r < 3; r++) x += o->inverse[3 * k + r] * (o->from[r] + t * o->direction[r] - o->desc->origin[r]);
    int n = o->desc->dims[k];
    if (n == 1 ? fabsl(x) > 0.5L : (x < 0 || x > n - 1)) return false;
    long i = n == 1 ? 0 : (long)fminl(floorl(x), n - 2);
    at[k][0] = (size_t)i;
    at[k][1] = n == 1 ? 0 : (size_t)i + 1;
    f[k] = n == 1 ? 0 : x - i;
    *cell = *cell * 4096 + i;
  }
  *value = 0;
  for (int c = 0; c < 8; c++) {
    long double w = 1;
    for (int k = 0; k < 3; k++) w *= c >> k & 1 ? f[k] : 1 - f[k];
    size_t i = (at[2][c >> 2] * (size_t)o->desc->dims[1] + at[1][c >> 1 & 1]) * (size_t)o->desc->dims[0] + at[0][c & 1];
    *value += w * stored(o, i);
  }
  *value = o->desc->slope * *value + o->desc->intercept;
  return true;
}

/* Which knots lie at or under the value: steps never straddle one. */
static size_t oracle_interval(const oracle *o, long double value) {
  size_t n = 0;
  while (n < o->tf->count && o->tf->points[n].value <= value) n++;
  return n;
}

static long double oracle_classify(const oracle *o, long double value, long double rgb[3]) {
  size_t n = oracle_interval(o, value), count = o->tf->count;
  const tc_knot *a = &o->tf->points[n ? n - 1 : 0], *b = &o->tf->points[n < count ? n : count - 1];
  long double u = a == b ? 0 : (value - a->value) / ((long double)b->value - a->value);
  for (int c = 0; c < 3; c++) {
    rgb[c] = a->color[c] + u * ((long double)b->color[c] - a->color[c]);
    if (o->linear_light) rgb[c] = rgb[c] <= 0.04045L ? rgb[c] / 12.92L : powl((rgb[c] + 0.055L) / 1.055L, 2.4L);
  }
  if (o->tf->kind == TC_KNOT_EXTINCTION) return a->amount + u * ((long double)b->amount - a->amount);
  long double from = fminl(a->amount, 1 - 0x1p-24L), to = fminl(b->amount, 1 - 0x1p-24L);
  return -log1pl(-(from + u * (to - from))) / o->tf->unit_distance_mm;
}

/* One step's optical depth: midpoint. Halves *h until the step is short enough for the depth and for the way between
 * two knots and crosses no cell face and no knot, or cannot be told from nothing. Returns 0 outside. */
static long double oracle_step(const oracle *o, long double t, long double *h, long double longest,
                               long double rgb[3]) {
  long double v0, v1, vm, depth;
  long c0, c1, cm;
  bool in0 = oracle_value(o, t, &v0, &c0);
  for (;; *h /= 2) {
    long double next = t + *h;
    bool in1 = oracle_value(o, next, &v1, &c1), in = oracle_value(o, t + *h / 2, &vm, &cm);
    if (t + *h / 4 == t) return 0;
    if (in0 != in1 || in != in0) continue;
    if (!in) return 0;
    size_t k = oracle_interval(o, vm);
    if (c0 != c1 || oracle_interval(o, v0) != k || oracle_interval(o, v1) != k) continue;
    const tc_knot *p = o->tf->points;
    if (k > 0 && k < o->tf->count && fabsl(v1 - v0) > 1e-3L * (p[k].value - p[k - 1].value)) continue;
    depth = oracle_classify(o, vm, rgb) * (next - t); /* what t really advances by */
    if (depth < 5 * longest) return depth;
  }
}

/* Small midpoint steps, each with its exact exponential; longest: mm, and a fifth of the optical depth. */
static void oracle_integrate(const oracle *o, long double longest, long double rgba[4], unsigned long *steps) {
  long double t = 0, h = 0.1L, light = 1, rgb[3];
  for (int c = 0; c < 4; c++) rgba[c] = 0;
  bool inside = false, was_inside = false;
  for (*steps = 0; t < 80 && light > 1e-12L && (inside || !was_inside); ++*steps) {
    long double value;
    long cell;
    inside = oracle_value(o, t, &value, &cell);
    was_inside |= inside;
    h = inside ? fminl(2 * h, longest) : 1e-3L; /* nothing to see outside, but the box may be 0.02 mm thin */
    long double depth = oracle_step(o, t, &h, longest, rgb), alpha = -expm1l(-depth);
    t += h;
    if (depth == 0) continue;
    for (int c = 0; c < 3; c++) rgba[c] += light * alpha * rgb[c];
    rgba[3] += light * alpha;
    light *= 1 - alpha;
  }
}

static void against_oracle(const char *what, tc_volume *volume, tc_scene *scene, const double from[3],
                           const double to[3], double bound) {
  oracle o;
  double rgba[4], worst = 0;
  long double want[4];
  unsigned long steps;
  one_ray(volume, scene, from, to, 0, rgba);
  oracle_set_up(&o, volume, scene, from, to);
  oracle_integrate(&o, 4e-5L, want, &steps);
  for (int c = 0; c < 4; c++) worst = fmax(worst, bad(rgba[c], (double)want[c]));
  char line[128];
  snprintf(line, sizeof line, "%s: alpha %.6f, %lu steps", what, rgba[3], steps);
  report(line, worst, bound);
}

/* Random voxels, random oblique rays, stiff transfer functions; all voxel types, anisotropic and sheared. */
TEST(stiff_random_rays) {
  uint64_t seed = 77;
  for (int i = SANITIZED ? 7 : 0; i < 12; i += STRIDE(2)) { /* the stiffest */
    unsigned noise_seed = (unsigned)i;
    test_grid grid = {.dims = {5, 6, 7},
                      .type = (tc_voxel_type)(i % TC_VOXEL_TYPE_COUNT),
                      .spacing = {1.5, 0.7, 2.2},
                      .origin = {-3, 2, -5}};
    if (grid.type != TC_F32) grid.slope = 1.0 / 100;
    if (i & 1) memcpy(grid.direction, sheared, sizeof sheared);
    g_autoptr(tc_volume) volume = test_volume(&grid, test_noise, &noise_seed);
    bool opacity = i % 3 == 0;
    double stiff = pow(10, i), width = 0.1 / fmin(stiff, 1e6);
    tc_knot knots[] = {{.value = 0.2, .color = {1, 0, 0.1}, .amount = 0},
                       {.value = 0.4, .color = {0, 1, 0}, .amount = opacity ? 0.9 : 0.1},
                       {.value = 0.4, .color = {0.3, 0, 1}, .amount = opacity ? 0.2 : 0},
                       {.value = 0.6, .color = {1, 1, 0}, .amount = opacity ? 0 : 0.5},
                       {.value = 0.6 + width, .color = {0, 0.02, 1}, .amount = opacity ? 1 : stiff},
                       {.value = 0.6 + 2 * width, .color = {1, 1, 1}, .amount = 0.01}};
    g_auto(tc_scene) scene = knots_scene(opacity ? TC_KNOT_OPACITY : TC_KNOT_EXTINCTION, knots, 6);
    if (opacity) scene.transfer_function.unit_distance_mm = 1 / stiff;
    scene.image.linear_light = i % 4 == 1;
    double center[3], from[3], to[3];
    tc_volume_index_to_lps(volume, (double[3]){2, 2.5, 3}, center);
    for (int k = 0; k < 3; k++) {
      from[k] = center[k] + 40 * (test_random(&seed) - 0.5);
      to[k] = center[k] + 3 * (test_random(&seed) - 0.5);
    }
    char what[64];
    snprintf(what, sizeof what, "%s%s tau to 1e%d%s", tc_voxel_type_name(grid.type), i & 1 ? " sheared" : "", i,
             scene.image.linear_light ? " linear light" : "");
    against_oracle(what, volume, &scene, from, to, 1e-7);
  }
}

/* Degenerate grids, and an eye inside. */
TEST(thin_volumes) {
  const int shapes[][3] = {{1, 1, 1}, {1, 7, 1}, {9, 1, 4}, {2, 2, 2}, {2048, 1, 1}};
  for (size_t i = 0; i < G_N_ELEMENTS(shapes); i++) {
    unsigned noise_seed = 9;
    test_grid grid = {
        .dims = {shapes[i][0], shapes[i][1], shapes[i][2]}, .type = TC_U16, .slope = 1e-4, .spacing = {0.02, 1, 3}};
    g_autoptr(tc_volume) volume = test_volume(&grid, test_noise, &noise_seed);
    tc_knot knots[] = {{.value = 0, .color = {1, 0, 0}, .amount = 0.1}, {.value = 1, .color = {0, 1, 1}, .amount = 5}};
    g_auto(tc_scene) scene = knots_scene(TC_KNOT_EXTINCTION, knots, 2);
    double center[3], from[3], to[3];
    tc_volume_index_to_lps(
        volume, (double[3]){0.5 * (shapes[i][0] - 1), 0.5 * (shapes[i][1] - 1), 0.5 * (shapes[i][2] - 1)}, center);
    for (int k = 0; k < 3; k++) {
      from[k] = center[k] - (double[3]){25, 0.3, 0.2}[k];
      to[k] = center[k] + (double[3]){0.001, 0.01, 0.02}[k];
    }
    char what[64];
    snprintf(what, sizeof what, "%dx%dx%d", shapes[i][0], shapes[i][1], shapes[i][2]);
    against_oracle(what, volume, &scene, from, to, 1e-7);
    snprintf(what, sizeof what, "%dx%dx%d from inside", shapes[i][0], shapes[i][1], shapes[i][2]);
    against_oracle(what, volume, &scene, center, from, 1e-7);
  }
}

TESTS(NULL, NULL)
