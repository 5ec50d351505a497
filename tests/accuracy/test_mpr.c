/* Planar reformats against the field itself: which voxel lands on which pixel, what a slice and a slab show, and what a
 * scene may ask. Every instruction set of the cpu back end, and gl where there is one. The planes' axes and the mm of a
 * pixel are worked out here a second time, from what scene.h promises. */
#include "tests/support/test.h"

#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/renderers.h"

#define WIDTH 61
#define HEIGHT 47
#define SLACK 1e-3 /* voxels around the field that count to it (raycast/mpr.h) */

/* How far a grey may be off. */
static double allowed(int which) { return which == GL ? 1.0 / 255 : 1e-4; }

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

static test_grid grid_of(const placing *p, int nx, int ny, int nz, tc_voxel_type type) {
  test_grid grid = {.dims = {nx, ny, nz}, .type = type};
  memcpy(grid.direction, p->direction, sizeof grid.direction);
  memcpy(grid.spacing, p->spacing, sizeof grid.spacing);
  memcpy(grid.origin, p->origin, sizeof grid.origin);
  return grid;
}

static double one_voxel(double x, double y, double z, const void *context) {
  const double *v = context;
  return x == v[0] && y == v[1] && z == v[2] ? 200 : 0;
}

typedef struct noise {
  unsigned seed;
  double lo, hi;
} noise;

static double noise_between(double x, double y, double z, const void *context) {
  const noise *n = context;
  return n->lo + (n->hi - n->lo) * test_noise(x, y, z, &n->seed);
}

static tc_volume *noise_volume(const placing *p, tc_voxel_type type, double slope) {
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

static void scene_of(tc_scene *scene, tc_mpr_orientation orientation, double lo, double hi) {
  test_scene(scene, WIDTH, HEIGHT);
  scene->mode = TC_MODE_MPR;
  scene->window.center = 0.5 * (lo + hi);
  scene->window.width = hi - lo;
  scene->mpr.orientation = orientation;
  memcpy(scene->mpr.normal, (double[3]){0.3, -0.7, 0.4}, sizeof scene->mpr.normal);
  memcpy(scene->mpr.up, (double[3]){0.1, 0.2, 0.9}, sizeof scene->mpr.up);
}

static void whole_window(tc_scene *scene, const tc_volume *volume) {
  const tc_volume_stats *s = tc_volume_statistics(volume);
  scene->window.center = 0.5 * (s->min + s->max);
  scene->window.width = s->max - s->min;
}

typedef struct plane {
  double right[3], up[3], towards[3]; /* the viewer */
  double center[3], pixel;
} plane;

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Gram-Schmidt, where the product takes cross products. */
static void oblique_axes(const tc_scene *scene, plane *p) {
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

static plane plane_of(const tc_scene *scene, const tc_volume *volume) {
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
static void pixel_lps(const plane *p, const tc_scene *scene, double x, double y, double away, double lps[3]) {
  double a = (x + 0.5 - 0.5 * scene->image.width) * p->pixel, b = (0.5 * scene->image.height - y - 0.5) * p->pixel;
  for (int k = 0; k < 3; k++) lps[k] = p->center[k] + a * p->right[k] + b * p->up[k] - away * p->towards[k];
}

/* 1 well inside the field, 0 well outside, -1 in its faces, where rounding decides. */
static int inside(const tc_volume *volume, const double index[3]) {
  double lo[3], hi[3];
  int where = 1;
  tc_volume_index_box(volume, lo, hi);
  for (int k = 0; k < 3; k++) {
    if (index[k] < lo[k] - 2e-3 || index[k] > hi[k] + 2e-3) return 0;
    if (index[k] < lo[k] + 2e-3 || index[k] > hi[k] - 2e-3) where = -1;
  }
  return where;
}

static double grey_of(const tc_scene *scene, double value) {
  double g = (value - (scene->window.center - 0.5 * scene->window.width)) / scene->window.width;
  return fmin(fmax(g, 0), 1);
}

static double value_at(const tc_volume *volume, const double index[3]) {
  double lo[3], hi[3], held[3], value = NAN;
  tc_volume_index_box(volume, lo, hi);
  for (int k = 0; k < 3; k++) held[k] = fmin(fmax(index[k], lo[k]), hi[k]);
  assert_true(tc_volume_value_at(volume, held, &value));
  return value;
}

/* ---- a known voxel lands on the known pixel ---- */

static size_t brightest(const float *picture, size_t pixels) {
  size_t best = 0;
  for (size_t i = 1; i < pixels; i++)
    if (picture[4 * i] > picture[4 * best]) best = i;
  return best;
}

TEST(known_voxel_on_known_pixel) {
  static const int voxels[][3] = {{4, 9, 3}, {0, 0, 0}, {16, 12, 8}, {16, 0, 5}};
  static const int pixels[][2] = {{30, 23}, {11, 37}, {52, 4}};
  for (int at = 0; at < N_PLACINGS; at++)
    for (size_t v = 0; v < G_N_ELEMENTS(voxels); v++) {
      const double index[3] = {voxels[v][0], voxels[v][1], voxels[v][2]};
      test_grid grid = grid_of(&placings[at], 17, 13, 9, TC_U8);
      g_autoptr(tc_volume) volume = test_volume(&grid, one_voxel, index);
      for (int o = 0; o < TC_MPR_ORIENTATION_COUNT; o++)
        for (size_t p = 0; p < G_N_ELEMENTS(pixels); p++) {
          g_auto(tc_scene) scene;
          scene_of(&scene, (tc_mpr_orientation)o, 0, 400);
          scene.filter = (p + v) % 2 ? TC_FILTER_LINEAR : TC_FILTER_NEAREST;
          scene.mpr.zoom = 2.5;
          /* The plane goes through the voxel; the picture's middle is where the voxel comes to lie on the pixel. */
          plane wanted = plane_of(&scene, volume);
          double lps[3];
          tc_volume_index_to_lps(volume, index, wanted.center);
          scene.mpr.has_center = true;
          pixel_lps(&wanted, &scene, WIDTH - 1 - pixels[p][0], HEIGHT - 1 - pixels[p][1], 0, lps);
          memcpy(scene.mpr.center, lps, sizeof lps);
          size_t pixel = (size_t)pixels[p][1] * WIDTH + (size_t)pixels[p][0];
          EACH_RENDERER(m) {
            const float *got = render(m, volume, &scene);
            if (fabs(got[4 * pixel] - 0.5) > allowed(m) || got[4 * pixel + 3] != 1)
              fail_msg("%s, voxel %zu, plane %d, %s: pixel %d,%d shows %g, opacity %g", placings[at].name, v, o,
                       test_names[m], pixels[p][0], pixels[p][1], got[4 * pixel], got[4 * pixel + 3]);
            size_t best = brightest(got, WIDTH * HEIGHT);
            if (scene.filter == TC_FILTER_LINEAR && best != pixel)
              fail_msg("%s, voxel %zu, plane %d, %s: brightest at %zu,%zu and not %d,%d", placings[at].name, v, o,
                       test_names[m], best % WIDTH, best / WIDTH, pixels[p][0], pixels[p][1]);
          }
        }
    }
}

/* Without a centre the volume's own is in the middle, and zoom 1 just fits: corners of the field lie in the edges. */
TEST(whole_volume_fits) {
  const double index[3] = {8, 6, 4};
  for (int at = 0; at < N_PLACINGS; at++) {
    test_grid grid = grid_of(&placings[at], 17, 13, 9, TC_U16);
    g_autoptr(tc_volume) volume = test_volume(&grid, one_voxel, index);
    for (int o = 0; o < TC_MPR_ORIENTATION_COUNT; o++) {
      g_auto(tc_scene) scene;
      scene_of(&scene, (tc_mpr_orientation)o, 0, 400);
      scene.mpr.thickness_mm = 1000;
      scene.mpr.projection = TC_SLAB_MIP;
      EACH_RENDERER(m) {
        const float *got = render(m, volume, &scene);
        size_t middle = HEIGHT / 2 * WIDTH + WIDTH / 2;
        assert_int_equal(brightest(got, WIDTH * HEIGHT), middle);
        bool left = false, right = false, top = false, bottom = false;
        for (int i = 0; i < WIDTH * HEIGHT; i++) {
          if (got[4 * i + 3] == 0) continue;
          left |= i % WIDTH <= 1, right |= i % WIDTH >= WIDTH - 2;
          top |= i / WIDTH <= 1, bottom |= i / WIDTH >= HEIGHT - 2;
        }
        if (!(left && right) && !(top && bottom))
          fail_msg("%s, plane %d: does not fill the picture", placings[at].name, o);
      }
    }
  }
}

/* ---- one slice ---- */

/* Is the nearest voxel in doubt? */
static bool at_tie(const double index[3]) {
  for (int k = 0; k < 3; k++)
    if (fabs(index[k] - floor(index[k]) - 0.5) < 2e-3) return true;
  return false;
}

typedef struct tally {
  size_t seen, empty, skipped;
  double worst;
} tally;

static void check_slice(int m, tc_volume *volume, const tc_scene *scene, tally *t) {
  const float *got = render(m, volume, scene);
  plane p = plane_of(scene, volume);
  for (int i = 0; i < WIDTH * HEIGHT; i++) {
    double lps[3], index[3];
    pixel_lps(&p, scene, i % WIDTH, i / WIDTH, 0, lps);
    tc_volume_lps_to_index(volume, lps, index);
    int where = inside(volume, index);
    bool nearest = scene->filter == TC_FILTER_NEAREST;
    if (where < 0 || (where && nearest && at_tie(index))) {
      t->skipped++;
      continue;
    }
    if (nearest && where)
      for (int k = 0; k < 3; k++) index[k] = floor(index[k] + 0.5);
    double want = where ? grey_of(scene, value_at(volume, index)) : 0, off = 0;
    for (int c = 0; c < 3; c++) off = fmax(off, fabs(got[4 * i + c] - want));
    if (off > allowed(m) || got[4 * i + 3] != where)
      fail_msg("%s: pixel %d,%d: %g (opacity %g), expected %g (%d)", test_names[m], i % WIDTH, i / WIDTH, got[4 * i],
               got[4 * i + 3], want, where);
    t->worst = fmax(t->worst, off);
    t->seen += where == 1, t->empty += where == 0;
  }
}

TEST(slice_is_the_field) {
  for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++)
    EACH_RENDERER(m) {
      tally t = {0};
      uint64_t random = 5;
      for (int at = 0; at < N_PLACINGS; at++) {
        g_autoptr(tc_volume) volume = noise_volume(&placings[at], (tc_voxel_type)type, at % 2 ? -0.25 : 1);
        for (int o = 0; o < TC_MPR_ORIENTATION_COUNT; o++)
          for (int filter = 0; filter < 2; filter++) {
            g_auto(tc_scene) scene;
            scene_of(&scene, (tc_mpr_orientation)o, 0, 1);
            whole_window(&scene, volume);
            scene.filter = filter ? TC_FILTER_NEAREST : TC_FILTER_LINEAR;
            scene.mpr.zoom = filter ? 0.7 : 1 + test_random(&random);
            scene.mpr.has_center = true;
            double index[3] = {18 * test_random(&random), 14 * test_random(&random), 10 * test_random(&random)};
            tc_volume_index_to_lps(volume, index, scene.mpr.center);
            check_slice(m, volume, &scene, &t);
          }
      }
      printf("  %s %-6s: %zu pixels of the field, %zu beside it, %zu in faces and ties, worst %.1e\n",
             tc_voxel_type_name((tc_voxel_type)type), test_names[m], t.seen, t.empty, t.skipped, t.worst);
      assert_true(t.seen > 20000 && t.empty > 5000);
    }
}

/* A plane through the very first or last voxels is theirs, whatever rounding says. */
TEST(outermost_slices_show) {
  for (int at = 0; at < N_PLACINGS; at++) {
    g_autoptr(tc_volume) volume = noise_volume(&placings[at], TC_I16, 1);
    for (int axis = 0; axis < 3; axis++)
      for (int end = 0; end < 2; end++) {
        g_auto(tc_scene) scene;
        scene_of(&scene, TC_OBLIQUE, 0, 1);
        whole_window(&scene, volume);
        double index[3] = {9, 7, 5}, matrix[9];
        index[axis] = end ? (double[]){18, 14, 10}[axis] : 0;
        tc_volume_lps_to_index_matrix(volume, matrix);
        /* across the voxels' layers, even sheared */
        memcpy(scene.mpr.normal, matrix + 3 * axis, sizeof scene.mpr.normal);
        memcpy(scene.mpr.up, matrix + 3 * ((axis + 1) % 3), sizeof scene.mpr.up);
        scene.mpr.has_center = true;
        scene.mpr.zoom = 6;
        tc_volume_index_to_lps(volume, index, scene.mpr.center);
        EACH_RENDERER(m) {
          const float *got = render(m, volume, &scene);
          for (int i = 0; i < WIDTH * HEIGHT; i++)
            if (got[4 * i + 3] != 1)
              fail_msg("%s, axis %d, %s: pixel %d is empty", placings[at].name, axis, test_names[m], i);
        }
      }
  }
}

/* ---- slabs ---- */

/* mm along the view, from the plane, that lie in the slab and in the field and `slack` voxels around it; false where
 * none surely do. */
static bool slab_span(const tc_volume *volume, const tc_scene *scene, const plane *p, const double lps[3], double slack,
                      double span[2]) {
  double at[3], away[3], ahead[3], lo[3], hi[3];
  span[0] = -0.5 * scene->mpr.thickness_mm, span[1] = -span[0];
  for (int k = 0; k < 3; k++) ahead[k] = lps[k] - p->towards[k];
  tc_volume_lps_to_index(volume, lps, at);
  tc_volume_lps_to_index(volume, ahead, away);
  tc_volume_index_box(volume, lo, hi);
  for (int k = 0; k < 3; k++) {
    double d = away[k] - at[k];
    lo[k] -= slack, hi[k] += slack;
    if (fabs(d) < 1e-12) {
      if (at[k] < lo[k] || at[k] > hi[k]) return false;
      continue;
    }
    double a = (lo[k] - at[k]) / d, b = (hi[k] - at[k]) / d;
    span[0] = fmax(span[0], fmin(a, b)), span[1] = fmin(span[1], fmax(a, b));
  }
  return span[1] > span[0];
}

/* The slab's value from samples at the ends and at multiples of `step` mm from the plane. */
static double slab_value(const tc_volume *volume, const tc_scene *scene, const plane *p, const double lps[3],
                         const double span[2], double step) {
  double most = -INFINITY, least = INFINITY, sum = 0, before = 0, front = 0;
  double t = span[0];
  for (bool first = true;; first = false) {
    double at[3], index[3];
    for (int k = 0; k < 3; k++) at[k] = lps[k] - t * p->towards[k];
    tc_volume_lps_to_index(volume, at, index);
    double value = value_at(volume, index);
    most = fmax(most, value), least = fmin(least, value);
    if (!first) sum += 0.5 * (t - before) * (front + value);
    if (t >= span[1]) break;
    before = t, front = value;
    t = (floor(t / step + 1e-9) + 1) * step;
    if (t > span[1]) t = span[1];
  }
  switch (scene->mpr.projection) {
  case TC_SLAB_MIP: return most;
  case TC_SLAB_MINIP: return least;
  case TC_SLAB_AVERAGE: return sum / (span[1] - span[0]);
  case TC_SLAB_PROJECTION_COUNT: break;
  }
  return NAN;
}

/* `step_mm`: of the expected samples; `slack`: of the expected ends, voxels; `allowed`: greys. Returns the worst. */
static double check_slab(int m, tc_volume *volume, const tc_scene *scene, double step_mm, double slack,
                         double allowed) {
  const float *got = render(m, volume, scene);
  plane p = plane_of(scene, volume);
  double worst = 0;
  size_t seen = 0;
  for (int i = 0; i < WIDTH * HEIGHT; i++) {
    double lps[3], span[2];
    pixel_lps(&p, scene, i % WIDTH, i / WIDTH, 0, lps);
    if (!slab_span(volume, scene, &p, lps, slack, span) || span[1] - span[0] < 0.1) continue; /* grazes an edge */
    double want = grey_of(scene, slab_value(volume, scene, &p, lps, span, step_mm)), off = fabs(got[4 * i] - want);
    worst = fmax(worst, off);
    seen++;
    if (off > allowed || got[4 * i + 3] != 1)
      fail_msg("%s: pixel %d,%d: %g (opacity %g), expected %g over %g..%g mm", test_names[m], i % WIDTH, i / WIDTH,
               got[4 * i], got[4 * i + 3], want, span[0], span[1]);
  }
  if (seen < 20) fail_msg("only %zu pixels of the slab seen", seen);
  return worst;
}

TEST(slabs_take_their_samples) {
  static const double thick[] = {0.6, 4, 7.3, 500};
  EACH_RENDERER(m) {
    double worst = 0;
    for (int at = 0; at < N_PLACINGS; at++) {
      g_autoptr(tc_volume) volume = noise_volume(&placings[at], at % 2 ? TC_U16 : TC_F32, at % 3 ? -0.5 : 2);
      const double *s = placings[at].spacing;
      double least = fmin(s[0], fmin(s[1], s[2]));
      for (int o = 0; o < TC_MPR_ORIENTATION_COUNT; o++)
        for (int projection = 0; projection < TC_SLAB_PROJECTION_COUNT; projection++) {
          g_auto(tc_scene) scene;
          scene_of(&scene, (tc_mpr_orientation)o, 0, 1);
          whole_window(&scene, volume);
          scene.mpr.projection = (tc_slab_projection)projection;
          scene.mpr.thickness_mm = thick[(at + o) % 4];
          worst = fmax(worst, check_slab(m, volume, &scene, least, SLACK, allowed(m)));
        }
    }
    printf("  %-6s: worst %.1e of the range\n", test_names[m], worst);
  }
}

/* Fine steps come to the slab's true extremes and mean. */
TEST(slabs_come_to_the_truth) {
  const double wavelength = 9;
  EACH_RENDERER(m)
    for (int at = 0; at < N_PLACINGS; at++) {
      test_grid grid = grid_of(&placings[at], 19, 15, 11, TC_F32);
      g_autoptr(tc_volume) volume = test_volume(&grid, test_waves, &wavelength);
      for (int projection = 0; projection < TC_SLAB_PROJECTION_COUNT; projection++) {
        g_auto(tc_scene) scene;
        scene_of(&scene, TC_OBLIQUE, 0, 1);
        scene.sampling.step = 0.03;
        scene.mpr.projection = (tc_slab_projection)projection;
        scene.mpr.thickness_mm = 6;
        check_slab(m, volume, &scene, 0.01, SLACK, fmax(allowed(m), 2e-3));
      }
    }
}

/* A slab of the whole volume along an axis is that of its voxels: exact, with no doubt about faces. */
TEST(columns_of_voxels) {
  g_autoptr(tc_volume) volume = noise_volume(&placings[0], TC_U8, 1);
  const uint8_t *voxels = tc_volume_data(volume);
  EACH_RENDERER(m)
    for (int projection = 0; projection < TC_SLAB_PROJECTION_COUNT; projection++) {
      g_auto(tc_scene) scene;
      scene_of(&scene, TC_AXIAL, 0, 255);
      scene.image.width = 19, scene.image.height = 15;
      scene.mpr.zoom = 18.0 / 19; /* a voxel a pixel; the rest is a row of pixels beside the field */
      scene.mpr.thickness_mm = 400;
      scene.mpr.projection = (tc_slab_projection)projection;
      const float *got = render(m, volume, &scene);
      for (int y = 0; y < 15; y++)
        for (int x = 0; x < 19; x++) {
          double most = 0, least = 255, sum = 0;
          for (int z = 0; z < 11; z++) {
            double v = voxels[(z * 15 + y) * 19 + x];
            most = fmax(most, v), least = fmin(least, v), sum += z % 10 ? v : 0.5 * v;
          }
          double want = projection == TC_SLAB_MIP ? most : projection == TC_SLAB_MINIP ? least : sum / 10;
          double grey = got[4 * (y * 19 + x)];
          if (fabs(grey - want / 255) > fmax(allowed(m), 1e-3))
            fail_msg("%s: column %d,%d shows %g, expected %g", test_names[m], x, y, grey * 255, want);
        }
    }
}

/* ---- the window, odd volumes, the rest of the scene ---- */

TEST(window_maps_to_grey) {
  static const double windows[][2] = {{50, 100}, {30, 10}, {30, 1e-12}, {1e6, 1}, {-1e6, 1}, {50, 1e9}, {0, 1e-300}};
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {101, 3, 3}, .type = TC_I16, .slope = 0.5, .intercept = -7},
                                  test_linear, (double[4]){1, 0, 0, 0});
  EACH_RENDERER(m)
    for (size_t w = 0; w < G_N_ELEMENTS(windows); w++) {
      g_auto(tc_scene) scene;
      scene_of(&scene, TC_AXIAL, 0, 1);
      scene.image.width = 101, scene.image.height = 3;
      scene.mpr.zoom = 100.0 / 101; /* pixel x is voxel x */
      scene.window.center = windows[w][0], scene.window.width = windows[w][1];
      const float *got = render(m, volume, &scene);
      for (int x = 0; x < 101; x++) {
        double off = fabs(got[4 * (101 + x)] - grey_of(&scene, x));
        bool in_doubt = windows[w][1] < 1e-6 && x == windows[w][0]; /* between black and white in one value */
        if (off > 1e-3 && !in_doubt)
          fail_msg("%s: window %g, %g: value %d shows %g", test_names[m], windows[w][0], windows[w][1], x,
                   got[4 * (101 + x)]);
      }
    }
}

TEST(thin_volumes) {
  static const int dims[][3] = {{1, 1, 1}, {1, 9, 7}, {9, 1, 1}, {5, 7, 1}, {2, 2, 2}, {1, 40, 1}};
  const unsigned seed = 3;
  for (size_t i = 0; i < G_N_ELEMENTS(dims); i++) {
    test_grid grid = {.dims = {dims[i][0], dims[i][1], dims[i][2]}, .type = TC_F32, .spacing = {1, 2, 5}};
    g_autoptr(tc_volume) volume = test_volume(&grid, test_noise, &seed);
    EACH_RENDERER(m)
      for (int o = 0; o < TC_MPR_ORIENTATION_COUNT; o++)
        for (int slab = 0; slab <= TC_SLAB_PROJECTION_COUNT; slab++) {
          g_auto(tc_scene) scene;
          scene_of(&scene, (tc_mpr_orientation)o, 0, 1);
          if (slab) scene.mpr.thickness_mm = 3, scene.mpr.projection = (tc_slab_projection)(slab - 1);
          tally t = {0};
          if (slab)
            check_slab(m, volume, &scene, 1, SLACK, allowed(m));
          else
            check_slice(m, volume, &scene, &t);
          size_t middle = HEIGHT / 2 * WIDTH + WIDTH / 2;
          assert_true(test_frames[m].linear[4 * middle + 3] == 1);
        }
  }
}

/* What means nothing to a slice changes nothing, and is not looked at. */
TEST(other_members_are_ignored) {
  g_autoptr(tc_volume) volume = noise_volume(&placings[4], TC_U16, 1);
  EACH_RENDERER(m) {
    g_auto(tc_scene) scene;
    scene_of(&scene, TC_CORONAL, 20000, 50000);
    scene.image.background[2] = 0.4;
    render(m, volume, &scene);
    g_autofree uint8_t *plain = g_memdup2(test_frames[m].rgba, WIDTH * HEIGHT * 4);
    scene.classification = TC_POST, scene.order = TC_BACK_TO_FRONT, scene.shading.model = TC_SHADING_GOOCH;
    scene.image.linear_light = scene.sampling.coherence = scene.sampling.jitter = true;
    scene.sampling.termination = 0.5;
    scene.transfer_function.points[0].value = NAN;
    scene.camera.fov_y_deg = 0;
    memcpy(scene.camera.target, scene.camera.position, sizeof scene.camera.target);
    render(m, volume, &scene);
    assert_memory_equal(test_frames[m].rgba, plain, WIDTH * HEIGHT * 4);
    assert_int_equal(test_frames[m].rgba[2], 102); /* the background, in a corner beside the field */
    scene.image.transparent = true;
    render(m, volume, &scene);
    assert_int_equal(test_frames[m].rgba[3], 0);
    assert_int_equal(test_frames[m].rgba[4 * (HEIGHT / 2 * WIDTH + WIDTH / 2) + 3], 255);
  }
}

/* A clip box and plane cut slices where they lie, and a slab's column to what is left: its ends are sampled there. */
TEST(clipping_cuts_slices) {
  g_autoptr(tc_volume) volume = noise_volume(&placings[0], TC_U8, 1); /* 19x15x11 mm from the origin */
  EACH_RENDERER(m) {
    g_auto(tc_scene) scene;
    scene_of(&scene, TC_AXIAL, 0, 255);
    scene.clip.has_box = true;
    /* z = 5: the plane itself */
    memcpy(scene.clip.box, (double[2][3]){{3, 2, 5}, {12, 40, 40}}, sizeof scene.clip.box);
    scene.clip.n_planes = 1;
    memcpy(scene.clip.planes[0], (double[4]){0, -1, 0, 9.5}, sizeof scene.clip.planes[0]); /* y <= 9.5 */
    for (int slab = 0; slab < 2; slab++) {
      scene.mpr.thickness_mm = slab ? 4 : 0; /* z from 3 to 7, of which 5 to 7 is left */
      const float *got = render(m, volume, &scene);
      plane p = plane_of(&scene, volume);
      size_t seen = 0;
      for (int i = 0; i < WIDTH * HEIGHT; i++) {
        double lps[3], sum = 0;
        pixel_lps(&p, &scene, i % WIDTH, i / WIDTH, 0, lps);
        double rim = fmin(fmin(lps[0] - 3, 12 - lps[0]), fmin(lps[1] - 2, 9.5 - lps[1]));
        if (fabs(rim) < 2e-3) continue;
        for (int z = 0; z < 3 && rim > 0; z++) /* straight volume: LPS is index */
          sum += (z == 1 ? 0.5 : 0.25) * value_at(volume, (double[3]){lps[0], lps[1], slab ? 5 + z : 5});
        if (got[4 * i + 3] != (rim > 0) || fabs(got[4 * i] - sum / 255) > fmax(allowed(m), 1e-3))
          fail_msg("%s, slab %d: pixel %d,%d: %g (opacity %g), expected %g", test_names[m], slab, i % WIDTH, i / WIDTH,
                   got[4 * i], got[4 * i + 3], sum / 255);
        seen += rim > 0;
      }
      assert_true(seen > 500);
    }
  }
}

TEST(plan_names_what_runs) {
  g_autoptr(tc_volume) volume = noise_volume(&placings[0], TC_U16, 1);
  static const char *const names[] = {"mpr.slice.linear.u16.", "mpr.mip.nearest.u16.", "mpr.minip.linear.u16.",
                                      "mpr.average.nearest.u16."};
  EACH_RENDERER(m)
    for (int slab = 0; slab < 4; slab++) {
      g_auto(tc_scene) scene;
      tc_explanation plan;
      GError *error = NULL;
      scene_of(&scene, TC_AXIAL, 0, 1);
      scene.filter = slab % 2 ? TC_FILTER_NEAREST : TC_FILTER_LINEAR;
      if (slab) scene.mpr.thickness_mm = 5, scene.mpr.projection = (tc_slab_projection)(slab - 1);
      const tc_frame *frame = test_draw(m, volume, &scene, NULL, &plan);
      assert_int_equal(strncmp(plan.kernel, names[slab], strlen(names[slab])), 0);
      static const tc_stage out[] = {TC_STAGE_TABLE_1D, TC_STAGE_TABLE_2D, TC_STAGE_GRADIENT, TC_STAGE_SKIPPING};
      for (size_t i = 0; i < G_N_ELEMENTS(out); i++) {
        assert_false(plan.stages[out[i]].included);
        assert_true(plan.stages[out[i]].reason[0] && plan.stages[out[i]].bytes == 0);
      }
      assert_true(frame->stats.tables_ms == 0 && frame->stats.skip_ms == 0);
      if (!slab) assert_int_equal(frame->stats.samples, frame->stats.rays); /* one sample a pixel */
      assert_true(tc_renderer_explain(test_renderers[m], volume, &scene, NULL, &plan, &error));
    }
}

static void expect_refused(tc_volume *volume, const tc_scene *scene, int code, const char *pointer) {
  tc_explanation plan;
  g_autoptr(GError) error = NULL;
  if (tc_explain(volume, scene, WIDTH, HEIGHT, &plan, &error)) fail_msg("%s was not refused", pointer);
  assert_int_equal(error->code, code);
  assert_string_equal(tc_error_pointer(error), pointer);
}

TEST(refusals_point_at_members) {
  g_autoptr(tc_volume) volume = noise_volume(&placings[0], TC_U8, 1);
  tc_scene s, good;
  scene_of(&good, TC_OBLIQUE, 0, 255);
#define REFUSED(edit, code, pointer) (s = good, edit, expect_refused(volume, &s, code, pointer))
  REFUSED(s.mpr.thickness_mm = -1, TC_ERROR_INVALID, "/mpr/thickness");
  REFUSED(s.mpr.thickness_mm = NAN, TC_ERROR_INVALID, "/mpr/thickness");
  REFUSED(s.mpr.thickness_mm = 1e9, TC_ERROR_LIMIT, "/mpr/thickness");
  REFUSED(s.mpr.zoom = 0, TC_ERROR_INVALID, "/mpr/zoom");
  REFUSED(s.mpr.zoom = INFINITY, TC_ERROR_INVALID, "/mpr/zoom");
  REFUSED(memset(s.mpr.normal, 0, sizeof s.mpr.normal), TC_ERROR_INVALID, "/mpr/normal");
  REFUSED(memset(s.mpr.up, 0, sizeof s.mpr.up), TC_ERROR_INVALID, "/mpr/up");
  REFUSED(memcpy(s.mpr.up, s.mpr.normal, sizeof s.mpr.up), TC_ERROR_INVALID, "/mpr/up");
  REFUSED((s.mpr.has_center = true, s.mpr.center[1] = NAN), TC_ERROR_INVALID, "/mpr/center");
  REFUSED(s.window.width = 0, TC_ERROR_INVALID, "/window/width");
  REFUSED(s.window.center = NAN, TC_ERROR_INVALID, "/window/center");
  REFUSED(s.sampling.step = 0, TC_ERROR_INVALID, "/sampling/step");
  REFUSED(s.filter = TC_FILTER_COUNT, TC_ERROR_INVALID, "/filter");
  REFUSED(s.sampling.rays_per_pixel = 4, TC_ERROR_UNSUPPORTED, "/sampling/raysPerPixel");
  REFUSED((s.clip.has_box = true, s.clip.box[0][1] = 1), TC_ERROR_INVALID, "/clip/box");
  REFUSED((strcpy(s.labels.volume, "x"), s.labels.opacity = 2), TC_ERROR_INVALID, "/labels/opacity");
  tc_explanation plan;
  s = good, s.mpr.orientation = TC_AXIAL; /* only oblique planes have a normal of their own */
  memset(s.mpr.normal, 0, sizeof s.mpr.normal);
  assert_true(tc_explain(volume, &s, WIDTH, HEIGHT, &plan, NULL));
  tc_scene_clear(&good);
}

/* The oblique plane that a new scene holds is the axial one. */
TEST(default_oblique_is_axial) {
  g_autoptr(tc_volume) volume = noise_volume(&placings[6], TC_U16, 1);
  g_auto(tc_scene) scene;
  test_scene(&scene, WIDTH, HEIGHT);
  scene.mode = TC_MODE_MPR;
  whole_window(&scene, volume);
  render(SCALAR, volume, &scene);
  g_autofree uint8_t *axial = g_memdup2(test_frames[SCALAR].rgba, WIDTH * HEIGHT * 4);
  scene.mpr.orientation = TC_OBLIQUE;
  render(SCALAR, volume, &scene);
  assert_memory_equal(test_frames[SCALAR].rgba, axial, WIDTH * HEIGHT * 4);
}

TEST(threads_change_nothing) {
  g_autoptr(tc_volume) volume = noise_volume(&placings[4], TC_U16, 1);
  g_autoptr(tc_renderer) one = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU, .threads = 1}, NULL);
  g_autoptr(tc_renderer) three = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU, .threads = 3}, NULL);
  g_auto(tc_scene) scene;
  scene_of(&scene, TC_OBLIQUE, 0, 65535);
  scene.mpr.thickness_mm = 5;
  g_auto(tc_frame) a = {0}, b = {0};
  assert_true(tc_render(one, volume, &scene, NULL, &a, NULL));
  assert_true(tc_render(three, volume, &scene, NULL, &b, NULL));
  assert_memory_equal(a.rgba, b.rgba, WIDTH * HEIGHT * 4);
}

TESTS(test_renderers_open, test_renderers_close)
