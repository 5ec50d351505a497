/* Planes worked out a second time from what scene.h promises: their axes, the mm of a pixel, and what a picture of them
 * should show. */
#ifndef TC_TESTS_MPR_H
#define TC_TESTS_MPR_H

#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/renderers.h"
#include "tests/support/test.h"

#define WIDTH 61
#define HEIGHT 47
#define SLACK 1e-3 /* voxels around the field that count to it (raycast/mpr.h) */

/* How far a grey may be off. */
static inline double allowed(int which) { return which == GL ? 1.0 / 255 : 1e-4; }

static const float *render(int which, tc_volume *volume, const tc_scene *scene) {
  const tc_frame *f = test_draw(which, volume, scene, NULL, NULL);
  for (size_t i = 0; i < (size_t)f->width * (size_t)f->height * 4; i++)
    if (!(f->linear[i] >= 0 && f->linear[i] <= 1)) fail_msg("%s: %g at float %zu", test_names[which], f->linear[i], i);
  return f->linear;
}

/* ---- volumes ---- */

/* Ways a scan may lie in the patient: columns are the index axes. */
typedef struct placing {
  const char *name;
  double direction[9], spacing[3], origin[3];
} placing;

static const placing placings[] = {
    {"straight", {1, 0, 0, 0, 1, 0, 0, 0, 1}, {1, 1, 1}, {0, 0, 0}},
    {"flipped to RAS", {-1, 0, 0, 0, -1, 0, 0, 0, 1}, {1, 1, 1}, {30, 40, -20}},
    {"head first turned over", {-1, 0, 0, 0, 1, 0, 0, 0, -1}, {1.5, 0.75, 1}, {5, 6, 7}},
    {"sagittal scan", {0, 0, 1, 1, 0, 0, 0, -1, 0}, {0.9, 0.9, 1.2}, {-12, 3, 55}},
    {"oblique", {0.36, 0.48, -0.8, -0.8, 0.6, 0, 0.48, 0.64, 0.6}, {1, 1.1, 0.9}, {100, -50, 10}},
    {"sheared", {1, 0, 0, 0, 1, 0.28, 0, 0, 0.96}, {1, 1, 2}, {0, 0, 0}},
    {"thick slices", {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0.5, 0.5, 3}, {-7, 8, 9}},
};
enum { N_PLACINGS = sizeof placings / sizeof *placings };

static inline test_grid grid_of(const placing *p, int nx, int ny, int nz, tc_voxel_type type) {
  test_grid grid = {.dims = {nx, ny, nz}, .type = type};
  memcpy(grid.direction, p->direction, sizeof grid.direction);
  memcpy(grid.spacing, p->spacing, sizeof grid.spacing);
  memcpy(grid.origin, p->origin, sizeof grid.origin);
  return grid;
}

typedef struct noise {
  unsigned seed;
  double lo, hi;
} noise;

static inline double noise_between(double x, double y, double z, const void *context) {
  const noise *n = context;
  return n->lo + (n->hi - n->lo) * test_noise(x, y, z, &n->seed);
}

static inline tc_volume *noise_volume(const placing *p, tc_voxel_type type, double slope) {
  static const double ranges[TC_VOXEL_TYPE_COUNT][2] = {[TC_U8] = {0, 255},
                                                        [TC_I8] = {-128, 127},
                                                        [TC_U16] = {0, 65535},
                                                        [TC_I16] = {-32768, 32767},
                                                        [TC_F32] = {-3, 12}};
  test_grid grid = grid_of(p, 19, 15, 11, type);
  grid.slope = slope;
  noise n = {7, ranges[type][0] * slope, ranges[type][1] * slope};
  return test_volume(&grid, noise_between, &n);
}

/* ---- what a picture should be ---- */

static inline void scene_of(tc_scene *scene, tc_mpr_orientation orientation, double lo, double hi) {
  test_scene(scene, WIDTH, HEIGHT);
  scene->mode = TC_MODE_MPR;
  scene->window.center = 0.5 * (lo + hi);
  scene->window.width = hi - lo;
  scene->mpr.orientation = orientation;
  memcpy(scene->mpr.normal, (double[3]){0.3, -0.7, 0.4}, sizeof scene->mpr.normal);
  memcpy(scene->mpr.up, (double[3]){0.1, 0.2, 0.9}, sizeof scene->mpr.up);
}

static inline void whole_window(tc_scene *scene, const tc_volume *volume) {
  const tc_volume_stats *s = tc_volume_statistics(volume);
  scene->window.center = 0.5 * (s->min + s->max);
  scene->window.width = s->max - s->min;
}

typedef struct plane {
  double right[3], up[3], towards[3]; /* the viewer */
  double center[3], pixel;
} plane;

static inline double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Gram-Schmidt, where the product takes cross products. */
static inline void oblique_axes(const tc_scene *scene, plane *p) {
  double n2 = dot(scene->mpr.normal, scene->mpr.normal);
  for (int k = 0; k < 3; k++) p->towards[k] = scene->mpr.normal[k] / sqrt(n2);
  double along = dot(scene->mpr.up, p->towards), length = 0;
  for (int k = 0; k < 3; k++) p->up[k] = scene->mpr.up[k] - along * p->towards[k];
  length = sqrt(dot(p->up, p->up));
  for (int k = 0; k < 3; k++) p->up[k] /= length;
  for (int k = 0; k < 3; k++) { /* right, up, towards the viewer: a right-handed system */
    int a = (k + 1) % 3, b = (k + 2) % 3;
    p->right[k] = p->up[a] * p->towards[b] - p->up[b] * p->towards[a];
  }
}

static inline plane plane_of(const tc_scene *scene, const tc_volume *volume) {
  /* L is +x, P is +y, H is +z: right of the picture, top of the picture, towards the viewer */
  static const double axes[][3][3] = {[TC_AXIAL] = {{1, 0, 0}, {0, -1, 0}, {0, 0, -1}},
                                      [TC_CORONAL] = {{1, 0, 0}, {0, 0, 1}, {0, -1, 0}},
                                      [TC_SAGITTAL] = {{0, 1, 0}, {0, 0, 1}, {1, 0, 0}}};
  plane p;
  if (scene->mpr.orientation == TC_OBLIQUE) {
    oblique_axes(scene, &p);
  } else {
    memcpy(p.right, axes[scene->mpr.orientation][0], sizeof p.right);
    memcpy(p.up, axes[scene->mpr.orientation][1], sizeof p.up);
    memcpy(p.towards, axes[scene->mpr.orientation][2], sizeof p.towards);
  }
  double lo[3], hi[3], corner[3], at[3], across[2] = {1e30, -1e30}, upward[2] = {1e30, -1e30};
  tc_volume_index_box(volume, lo, hi);
  for (int k = 0; k < 3; k++) p.center[k] = 0;
  for (int c = 0; c < 8; c++) {
    for (int k = 0; k < 3; k++) corner[k] = c >> k & 1 ? hi[k] : lo[k];
    tc_volume_index_to_lps(volume, corner, at);
    across[0] = fmin(across[0], dot(at, p.right)), across[1] = fmax(across[1], dot(at, p.right));
    upward[0] = fmin(upward[0], dot(at, p.up)), upward[1] = fmax(upward[1], dot(at, p.up));
    for (int k = 0; k < 3; k++) p.center[k] += at[k] / 8;
  }
  if (scene->mpr.has_center) memcpy(p.center, scene->mpr.center, sizeof p.center);
  p.pixel = fmax((across[1] - across[0]) / scene->image.width, (upward[1] - upward[0]) / scene->image.height);
  p.pixel /= scene->mpr.zoom;
  return p;
}

/* LPS of the middle of a pixel, `away` mm behind the plane. */
static inline void pixel_lps(const plane *p, const tc_scene *scene, double x, double y, double away, double lps[3]) {
  double a = (x + 0.5 - 0.5 * scene->image.width) * p->pixel, b = (0.5 * scene->image.height - y - 0.5) * p->pixel;
  for (int k = 0; k < 3; k++) lps[k] = p->center[k] + a * p->right[k] + b * p->up[k] - away * p->towards[k];
}

/* 1 well inside the field, 0 well outside, -1 in its faces, where rounding decides. */
static inline int inside(const tc_volume *volume, const double index[3]) {
  double lo[3], hi[3];
  int where = 1;
  tc_volume_index_box(volume, lo, hi);
  for (int k = 0; k < 3; k++) {
    if (index[k] < lo[k] - 2e-3 || index[k] > hi[k] + 2e-3) return 0;
    if (index[k] < lo[k] + 2e-3 || index[k] > hi[k] - 2e-3) where = -1;
  }
  return where;
}

static inline double grey_of(const tc_scene *scene, double value) {
  double g = (value - (scene->window.center - 0.5 * scene->window.width)) / scene->window.width;
  return fmin(fmax(g, 0), 1);
}

static inline double value_at(const tc_volume *volume, const double index[3]) {
  double lo[3], hi[3], held[3], value = NAN;
  tc_volume_index_box(volume, lo, hi);
  for (int k = 0; k < 3; k++) held[k] = fmin(fmax(index[k], lo[k]), hi[k]);
  assert_true(tc_volume_value_at(volume, held, &value));
  return value;
}

#endif
