/* Planar reformats against the field itself: which voxel lands on which pixel, and what a slice and a slab show. Every
 * instruction set of the cpu back end, and gl where there is one. */
#include "tests/support/mpr.h"

/* ---- a known voxel lands on the known pixel ---- */

static double one_voxel(double x, double y, double z, const void *context) {
  const double *v = context;
  return x == v[0] && y == v[1] && z == v[2] ? 200 : 0;
}

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

#define TIE 1e-6 /* voxels from halfway between two voxels: the upper one is the nearest */

/* Is the nearest voxel in doubt? */
static bool in_doubt(const double index[3]) {
  for (int k = 0; k < 3; k++) {
    const double away = fabs(index[k] - floor(index[k]) - 0.5);
    if (away > TIE && away < 2e-3) return true;
  }
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
    if (where < 0 || (where && nearest && in_doubt(index))) {
      t->skipped++;
      continue;
    }
    if (nearest && where)
      for (int k = 0; k < 3; k++) index[k] = floor(index[k] + 0.5 + TIE);
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

/* Three pixels a voxel: every third column and row of pixels lies halfway between two voxels, and so does the plane. The upper
 * voxel shows on all of them, whatever rounding says. */
TEST(voxels_have_three_pixels) {
  uint64_t random = 3;
  EACH_RENDERER(m) {
    tally t = {0};
    for (int at = 0; at < N_PLACINGS; at++)
      for (int axis = 0; axis < 3; axis++) {
        placing placed = placings[at];
        for (int k = 0; k < 3; k++) placed.spacing[k] = placed.spacing[0], placed.origin[k] += 300 * test_random(&random);
        const test_grid grid = grid_of(&placed, 20, 16, 12, TC_U8);
        const noise n = {7, 0, 255};
        g_autoptr(tc_volume) volume = test_volume(&grid, noise_between, &n);
        g_auto(tc_scene) scene;
        scene_of(&scene, TC_OBLIQUE, 0, 255);
        for (int k = 0; k < 3; k++) {
          scene.mpr.normal[k] = placed.direction[3 * k + axis];
          scene.mpr.up[k] = placed.direction[3 * k + (axis + 1) % 3];
        }
        scene.filter = TC_FILTER_NEAREST;
        scene.mpr.zoom = plane_of(&scene, volume).pixel / (placed.spacing[0] / 3);
        check_slice(m, volume, &scene, &t);
      }
    printf("  %-6s: %zu pixels of the field, %zu in doubt\n", test_names[m], t.seen, t.skipped);
    assert_true(t.seen > 20000);
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
    for (int at = 0; at < N_PLACINGS; at += STRIDE(2)) {
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

TESTS(test_renderers_open, test_renderers_close)
