/* Space leaping: the map against brute force, and pictures with and without it, bit for bit. */
#include "tests/support/test.h"

#include "renderer/classify/transfer.h"
#include "renderer/import/import.h"
#include "renderer/raycast/rays.h"
#include "renderer/skip/boxes.h"
#include "renderer/skip/distance_map.h"
#include "renderer/skip/fine.h"
#include "renderer/tomocast.h"
#include "renderer/volume/voxel.h"
#include "tests/support/grid.h"

G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_boxes, tc_boxes_free)
G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_distance_map, tc_distance_map_free)
G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_fine, tc_fine_free)
G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_minmax, tc_minmax_free)
G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_support, tc_support_free)

typedef struct blobs {
  uint64_t seed;
  int count;
  double noise, weight[3];
} blobs;

/* A few soft balls in a noisy ground: some blocks empty, some nearly, some full. */
static double blob_field(double x, double y, double z, const void *context) {
  const blobs *b = context;
  uint64_t state = b->seed;
  double v = 0;
  for (int i = 0; i < b->count; i++) {
    double cx = 60 * test_random(&state), cy = 60 * test_random(&state), cz = 60 * test_random(&state);
    double r = 1 + 9 * test_random(&state),
           d = sqrt(b->weight[0] * (x - cx) * (x - cx) + b->weight[1] * (y - cy) * (y - cy) +
                    b->weight[2] * (z - cz) * (z - cz));
    v += 200 * fmax(0, 1 - d / r);
  }
  unsigned seed = (unsigned)b->seed;
  return fmin(v, 230) + b->noise * test_noise(x, y, z, &seed);
}

static tc_volume *random_volume(uint64_t *state) {
  blobs b = {*state, 1 + (int)(6 * test_random(state)), 12 * test_random(state), {1, 1, 1}};
  test_grid g = {.dims = {1 + (int)(60 * test_random(state)), 1 + (int)(60 * test_random(state)),
                          1 + (int)(60 * test_random(state))},
                 .type = (tc_voxel_type)(5 * test_random(state))};
  if (test_random(state) < 0.25) { /* a picture: half a voxel thick to both sides */
    int k = (int)(3 * test_random(state));
    g.dims[k] = 1;
    b.weight[k] = 0;
  }
  for (int k = 0; k < 3; k++) g.spacing[k] = 0.4 + 2 * test_random(state);
  if (g.type == TC_I8) g.slope = 2, g.intercept = 0;
  if (test_random(state) < 0.2 && g.type != TC_U8 && g.type != TC_U16) g.slope = g.type == TC_I8 ? -2 : -1;
  return test_volume(&g, blob_field, &b);
}

/* Zero stretches, thin peaks, jumps. */
static void random_knots(tc_scene *scene, uint64_t *state) {
  tc_knot knots[16];
  int n = 1 + (int)(8 * test_random(state));
  double value = -20 + 120 * test_random(state);
  for (int i = 0; i < n; i++) {
    double amount = test_random(state) < 0.5 ? 0 : test_random(state);
    knots[i] = (tc_knot){value, {test_random(state), test_random(state), test_random(state)}, amount};
    if (test_random(state) < 0.8) value += (test_random(state) < 0.4 ? 1.5 : 60) * test_random(state);
  }
  test_scene_knots(scene, TC_KNOT_OPACITY, knots, (size_t)n);
}

static void render(tc_renderer *r, tc_volume *v, const tc_scene *s, tc_frame *f) {
  GError *error = NULL;
  tc_render_request q = {.want_linear = true};
  if (!tc_render(r, v, s, &q, f, &error)) fail_msg("%s", error->message);
}

TEST(leaping_changes_no_bit) {
  enum { TRIALS = SANITIZED ? 40 : 120 };
  static const char *const isas[] = {"scalar", "avx2", "avx512"};
  for (int isa = 0; isa < 3; isa++) {
    tc_renderer_options o = {.backend = TC_BACKEND_CPU, .isa = isas[isa]};
    g_autoptr(tc_renderer) r = tc_renderer_new(&o, NULL);
    if (!r) {
      printf("skipped: no %s here\n", isas[isa]);
      continue;
    }
    uint64_t with = 0, without = 0, state = 99;
    int shown = 0, leapt = 0;
    for (int trial = 0; trial < TRIALS; trial++) {
      uint64_t seed = state;
      g_autoptr(tc_volume) v = random_volume(&state);
      g_auto(tc_scene) s;
      test_scene(&s, 41, 37);
      random_knots(&s, &state);
      double side[3] = {test_random(&state) - 0.5, test_random(&state) - 0.5, test_random(&state) - 0.5};
      if (trial % 5 == 0) side[1] = 0;
      if (trial % 10 == 0) side[2] = 0; /* along an axis */
      test_scene_frame(&s, v, trial % 2 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, side);
      s.sampling.step = 0.3 + 2 * test_random(&state);
      s.sampling.termination = trial % 3 ? 0 : 0.01;
      s.skipping.block = 2 + (int)(10 * test_random(&state));
      g_auto(tc_frame) on = {0}, off = {0};
      render(r, v, &s, &on);
      s.skipping.mode = TC_SKIPPING_OFF;
      render(r, v, &s, &off);
      size_t pixels = (size_t)on.width * (size_t)on.height;
      bool same = !memcmp(on.linear, off.linear, pixels * 16) && !memcmp(on.rgba, off.rgba, pixels * 4);
      if (!same)
        fail_msg("%s: trial %d (state %llu, block %d) differs", isas[isa], trial, (unsigned long long)seed,
                 s.skipping.block);
      assert_int_equal(off.stats.leaps, 0);
      with += on.stats.samples, without += off.stats.samples;
      leapt += on.stats.leaps > 0;
      for (size_t i = 0; i < pixels; i++)
        if (off.linear[4 * i + 3] > 0) {
          shown++;
          break;
        }
    }
    printf("%s: %d scenes, %d with something in them, %d leapt in, %.2f of the samples taken\n", isas[isa], TRIALS, shown,
           leapt, (double)with / (double)without);
    assert_true(shown > TRIALS / 3 && leapt > TRIALS / 3 && with < without); /* the trial is worth something */
  }
}

static tc_table_params params_of(const tc_volume *v, const tc_transfer_function *tf) {
  const tc_volume_desc *d = tc_volume_describe(v);
  tc_table_params p = {.tf = tf, .slope = d->slope, .intercept = d->intercept, .step_mm = 1};
  tc_table_choose(v, &p, NULL);
  return p;
}

static tc_support *support_of(const tc_volume *v, const tc_transfer_function *tf) {
  const tc_table_params p = params_of(v, tf);
  return tc_support_build(&p, NULL);
}

/* What is left out without a look at the table: nothing visible lies in a zone or in reach of it, and next to nothing
 * beyond it is empty. */
TEST(zones_are_empty) {
  uint64_t state = 23;
  int reach = 0;
  for (int trial = 0; trial < 150; trial++) {
    g_autoptr(tc_volume) v = random_volume(&state);
    g_auto(tc_scene) s;
    test_scene(&s, 8, 8);
    random_knots(&s, &state);
    const tc_table_params p = params_of(v, &s.transfer_function);
    g_autoptr(tc_support) support = tc_support_build(&p, NULL);
    double below, above;
    tc_support_zones(&p, &below, &above);
    const uint32_t *used = support->used, most = used[p.n + 2];
    for (int j = 0; j <= p.n; j++) { /* a look-up from a node below j to another one spans nodes up to j + 2 */
      if (j <= below) assert_true(used[j + 2] == 0);
      if (j >= above) assert_true(used[j] == most);
      if (j > below + 6 && j < p.n && j < above - 6) reach += used[j] == 0 || used[j] == most;
    }
  }
  assert_int_equal(reach, 0);
}

static double pair_of(const tc_minmax *m, size_t block, int which) { return tc_voxel_at(m->type, m->pairs, 2 * block + (size_t)which); }

/* Rows so long that a task of the build has fewer rows of blocks than usual. */
static tc_volume *long_volume(uint64_t *state) {
  const blobs b = {*state, 6, 12 * test_random(state), {1, 1, 1}};
  const test_grid g = {.dims = {4001, 60, 9}, .type = (tc_voxel_type)(5 * test_random(state))};
  return test_volume(&g, blob_field, &b);
}

/* Every block's pair against its voxels, one voxel more to all sides under a cubic filter: odd sizes, several strips of rows. */
TEST(pairs_are_exact) {
  uint64_t state = 29;
  size_t blocks = 0;
  for (int trial = 0; trial < 60; trial++) {
    g_autoptr(tc_volume) v = trial % 10 ? random_volume(&state) : long_volume(&state);
    const tc_volume_desc *d = tc_volume_describe(v);
    g_autoptr(tc_minmax) m = tc_minmax_build(v, 2 + trial % 7, trial / 7 % 2, NULL, NULL);
    const int nx = m->blocks[0], ny = m->blocks[1], n = nx * ny * m->blocks[2];
    for (int i = 0; i < n; i++) {
      const int block[3] = {i % nx, i / nx % ny, i / nx / ny};
      int from[3], to[3];
      for (int k = 0; k < 3; k++) {
        from[k] = MAX(block[k] * m->block - m->reach, 0);
        to[k] = MIN((block[k] + 1) * m->block + m->reach, d->dims[k] - 1);
      }
      double least = INFINITY, most = -INFINITY;
      for (int z = from[2]; z <= to[2]; z++)
        for (int y = from[1]; y <= to[1]; y++)
          for (int x = from[0]; x <= to[0]; x++) {
            const double voxel = tc_voxel_at(d->type, tc_volume_data(v), ((size_t)z * (size_t)d->dims[1] + (size_t)y) * (size_t)d->dims[0] + (size_t)x);
            least = fmin(least, voxel), most = fmax(most, voxel);
          }
      assert_true(pair_of(m, (size_t)i, 0) == least && pair_of(m, (size_t)i, 1) == most);
    }
    blocks += (size_t)n;
  }
  assert_true(blocks > 20000);
}

/* Every distance against all blocks. */
TEST(map_is_right) {
  uint64_t state = 5;
  for (int trial = 0; trial < 30; trial++) {
    g_autoptr(tc_volume) v = random_volume(&state);
    g_auto(tc_scene) s;
    test_scene(&s, 8, 8);
    random_knots(&s, &state);
    const tc_volume_desc *d = tc_volume_describe(v);
    g_autoptr(tc_support) support = support_of(v, &s.transfer_function);
    g_autoptr(tc_minmax) m = tc_minmax_build(v, 2 + trial % 7, 0, NULL, NULL);
    g_autoptr(tc_distance_map) leap = tc_distance_map_build(m, support, NULL, NULL, NULL);
    for (int k = 0; k < 3; k++) {
      int cells = d->dims[k] > 1 ? d->dims[k] - 1 : 1;
      assert_true(m->blocks[k] * m->block >= cells && (m->blocks[k] - 1) * m->block < cells);
    }
    int nx = m->blocks[0], ny = m->blocks[1], nz = m->blocks[2];
    for (int i = 0; i < nx * ny * nz; i++) {
      int x = i % nx, y = i / nx % ny, z = i / nx / ny, least = 254;
      for (int j = 0; j < nx * ny * nz; j++) {
        if (leap->distance[j]) continue;
        int far = abs(j % nx - x), fy = abs(j / nx % ny - y), fz = abs(j / nx / ny - z);
        far = fy > far ? fy : far, far = fz > far ? fz : far;
        least = far < least ? far : least;
      }
      assert_int_equal(leap->distance[i], least);
      /* An empty block shows nothing anywhere in it, not even between voxels: tau is zero over its whole range. */
      if (leap->distance[i] == 0) continue;
      for (int c = 0; c <= 20; c++) {
        double at[3];
        for (int k = 0; k < 3; k++) {
          int block = k == 0 ? x : k == 1 ? y : z;
          at[k] = fmin(block * m->block + m->block * test_random(&state), d->dims[k] - 1);
        }
        double value;
        assert_true(tc_volume_value_at(v, at, &value));
        assert_true(tc_extinction(&s.transfer_function, value) == 0);
      }
    }
  }
}

#define WIDE 60

static double wide_field(double x, double y, double z, const void *context) {
  return WIDE * blob_field(fmod(x, 1789), y, z, context); /* again where a row's seventeenth group and later ones are */
}

/* Of far more values than there are bins; every fourth one so long that its rows have more than sixteen groups of fine boxes. */
static tc_volume *wide_volume(uint64_t *state) {
  static const tc_voxel_type types[] = {TC_U16, TC_I16, TC_F32};
  const blobs b = {*state, 1 + (int)(6 * test_random(state)), 12 * test_random(state), {1, 1, 1}};
  test_grid g = {.dims = {30 + (int)(180 * test_random(state)), 40, 50}, .type = types[(int)(3 * test_random(state))]};
  if (test_random(state) < 0.25) g.dims[0] += 4 * 16 * TC_FINE_GROUP, g.dims[1] = 9;
  return test_volume(&g, wide_field, &b);
}

static size_t volume_of(const int n[3]) { return (size_t)n[0] * (size_t)n[1] * (size_t)n[2]; }

/* Which fine boxes the records name. */
static void mark_records(const tc_boxes *b, const int n[3], bool *named) {
  for (size_t r = 0; r < b->count; r++) {
    const tc_box *box = &b->items[r];
    const int wide = box->fine ? TC_BOX_FINES : box->size / b->block;
    for (int i = 0; i < wide * wide * wide; i++) {
      int at[3] = {box->at[0] / b->block + i % wide, box->at[1] / b->block + i / wide % wide,
                   box->at[2] / b->block + i / wide / wide};
      if (box->fine && !(box->fine >> i & 1)) continue;
      assert_true(!box->fine || (at[0] < n[0] && at[1] < n[1] && at[2] < n[2])); /* whole boxes may reach beyond */
      if (at[0] < n[0] && at[1] < n[1] && at[2] < n[2]) named[(at[2] * n[1] + at[1]) * n[0] + at[0]] = true;
    }
  }
}

/* The least and the most of each group of fine boxes. */
static void check_groups(const tc_fine *f) {
  const int n = f->grid.blocks[0], rows = f->grid.blocks[1] * f->grid.blocks[2];
  assert_int_equal(f->groups, (n + TC_FINE_GROUP - 1) / TC_FINE_GROUP);
  for (int i = 0; i < rows * f->groups; i++) {
    const int row = i / f->groups, first = i % f->groups * TC_FINE_GROUP;
    int least = 255, most = 0;
    for (int x = first; x < MIN(first + TC_FINE_GROUP, n); x++) least = MIN(least, f->least[row * n + x]), most = MAX(most, f->most[row * n + x]);
    assert_true(f->group_least[i] == least && f->group_most[i] == most);
  }
}

/* Boxes name every fine box that an exact map says shows something, and hardly another: bins cost next to nothing. */
TEST(boxes_hold_what_shows) {
  uint64_t state = 17;
  size_t exact = 0, more = 0, all = 0;
  for (int trial = 0; trial < 60; trial++) {
    g_autoptr(tc_volume) v = trial % 2 ? wide_volume(&state) : random_volume(&state);
    g_auto(tc_scene) s;
    test_scene(&s, 8, 8);
    random_knots(&s, &state);
    for (size_t k = 0; k < s.transfer_function.count && trial % 2; k++) s.transfer_function.points[k].value *= WIDE;
    const int reach = trial % 3 == 0;
    g_autoptr(tc_support) support = support_of(v, &s.transfer_function);
    const size_t most = trial % 4 ? SIZE_MAX : 3000; /* bytes, but for the bins of levels */
    g_autoptr(tc_fine) fine = tc_fine_begin(v, 5, reach, most, NULL);
    assert_true(fine->bytes - (size_t)fine->levels <= most);
    assert_true(tc_fine_go_on(fine, v, NULL, NULL));
    check_groups(fine);
    g_autoptr(tc_boxes) boxes = tc_boxes_begin(fine, support, NULL, NULL);
    assert_true(tc_boxes_go_on(boxes, fine, NULL, NULL));
    g_autoptr(tc_minmax) m = tc_minmax_build(v, boxes->block, reach, NULL, NULL);
    g_autoptr(tc_distance_map) leap = tc_distance_map_build(m, support, NULL, NULL, NULL);
    const size_t count = volume_of(m->blocks);
    assert_int_equal(count, volume_of(fine->grid.blocks));
    g_autofree bool *named = calloc(count, sizeof *named);
    mark_records(boxes, m->blocks, named);
    for (size_t i = 0; i < count; i++) {
      assert_true(named[i] || leap->distance[i] > 0);
      exact += leap->distance[i] == 0, more += named[i] && leap->distance[i] > 0;
    }
    all += count;
  }
  printf("of %zu fine boxes %zu show something, %zu more are named\n", all, exact, more);
  assert_true(exact > all / 20 && exact < all / 2 + all / 3 && more < exact / 10);
}

/* A map made from the one before is the map made from nothing, and a small change goes over a part of it. */
TEST(map_is_mended) {
  uint64_t state = 11;
  int swept = 0, layers = 0, untouched = 0;
  for (int trial = 0; trial < 40; trial++) {
    g_autoptr(tc_volume) v = random_volume(&state);
    g_autoptr(tc_minmax) m = tc_minmax_build(v, 2 + trial % 3, 0, NULL, NULL);
    g_auto(tc_scene) s;
    test_scene(&s, 8, 8);
    random_knots(&s, &state);
    g_autoptr(tc_distance_map) before = NULL;
    for (int edit = 0; edit < 6; edit++) {
      tc_support *support = edit == 5 ? tc_support_surface(80, 81, NULL) : support_of(v, &s.transfer_function);
      tc_distance_map *leap = tc_distance_map_build(m, support, before, NULL, NULL),
                      *alone = tc_distance_map_build(m, support, NULL, NULL, NULL);
      size_t blocks = (size_t)m->blocks[0] * (size_t)m->blocks[1] * (size_t)m->blocks[2];
      assert_memory_equal(leap->distance, alone->distance, blocks);
      assert_memory_equal(leap->farthest, alone->farthest, (size_t)m->blocks[2]);
      if (before) swept += leap->swept, layers += m->blocks[2], untouched += !leap->swept && alone->swept;
      tc_distance_map_free(before);
      tc_distance_map_free(alone);
      before = leap;
      tc_support_free(support);
      size_t k = (size_t)(s.transfer_function.count * test_random(&state));
      double *value = &s.transfer_function.points[k].value, next = *value + 9;
      if (k + 1 < s.transfer_function.count) next = s.transfer_function.points[k + 1].value;
      *value += 0.3 * test_random(&state) * (next - *value);
    }
  }
  printf("%d of %d layers gone over again, %d maps copied\n", swept, layers, untouched);
  assert_true(swept < 0.9 * layers && swept > 0.05 * layers && untouched > 10);
}

/* The plan leaves the structure out where nothing can be empty, and it costs little where it is in. */
TEST(built_only_when_it_can_help) {
  tc_renderer_options o = {.backend = TC_BACKEND_CPU};
  g_autoptr(tc_renderer) r = tc_renderer_new(&o, NULL);
  g_autoptr(tc_volume) v = tc_volume_demo("vessels", NULL);
  g_auto(tc_scene) s;
  test_scene(&s, 32, 32);
  test_scene_frame(&s, v, TC_PERSPECTIVE, (double[3]){0, -1, 0});
  const tc_knot full[] = {{0, {1, 1, 1}, 0.001}, {255, {1, 1, 1}, 0.1}},
                part[] = {{80, {1, 1, 1}, 0}, {255, {1, 1, 1}, 0.5}};
  tc_explanation plan;
  g_auto(tc_frame) f = {0};
  test_scene_knots(&s, TC_KNOT_OPACITY, full, 2);
  assert_true(tc_render(r, v, &s, &(tc_render_request){.explanation = &plan}, &f, NULL));
  assert_false(plan.stages[TC_STAGE_SKIPPING].included);
  assert_int_equal(plan.stages[TC_STAGE_SKIPPING].bytes, 0);
  assert_int_equal(plan.key.skipping, 0);
  test_scene_knots(&s, TC_KNOT_OPACITY, part, 2);
  assert_true(tc_render(r, v, &s, &(tc_render_request){.explanation = &plan}, &f, NULL));
  assert_true(plan.stages[TC_STAGE_SKIPPING].included && f.stats.leaps > 0);
  double share = (double)plan.stages[TC_STAGE_SKIPPING].bytes / (double)tc_volume_bytes(v);
  printf("vessels: %s; %.2f %% of the voxel bytes\n", plan.stages[TC_STAGE_SKIPPING].reason, 100 * share);
  assert_true(share < 0.26); /* bytes: a minimum and a maximum for eight voxels, of 16 bits half as much */
  assert_true(tc_render(r, v, &s, &(tc_render_request){.explanation = &plan}, &f, NULL));
  assert_true(f.stats.tables_ms == 0 && f.stats.skip_ms == 0); /* a second frame builds nothing */
}

static double ramp(double x, double y, double z, const void *context) { return x > 69000 ? 200 : 0; }

/* An axis longer than boxes can name: nothing is leapt, and all is drawn. */
TEST(long_axes_are_drawn) {
  tc_renderer_options o = {.backend = TC_BACKEND_CPU};
  g_autoptr(tc_renderer) r = tc_renderer_new(&o, NULL);
  test_grid g = {.dims = {70000, 2, 2}, .type = TC_U8, .spacing = {0.01, 300, 300}};
  g_autoptr(tc_volume) v = test_volume(&g, ramp, NULL);
  const tc_knot part[] = {{80, {1, 1, 1}, 0}, {255, {1, 1, 1}, 0.5}};
  g_auto(tc_scene) s;
  tc_explanation plan;
  g_auto(tc_frame) f = {0};
  test_scene(&s, 32, 32);
  test_scene_frame(&s, v, TC_PERSPECTIVE, (double[3]){0, -1, 0});
  test_scene_knots(&s, TC_KNOT_OPACITY, part, 2);
  s.sampling.step = 50;
  assert_true(tc_render(r, v, &s, &(tc_render_request){.explanation = &plan}, &f, NULL));
  assert_false(plan.stages[TC_STAGE_SKIPPING].included);
  assert_true(f.stats.samples > 0 && f.stats.leaps == 0);
}

/* ---- the oracle: every ray by itself, with the exact distance of every fine box ---- */

#define FINE 2 /* cells: the width of a fine box */

typedef struct oracle {
  const tc_volume *volume;
  const tc_scene *scene;
  const tc_distance_map *map;
  tc_rays rays;
  double samples;
} oracle;

/* Where a ray enters and leaves a box; false: nowhere. */
static bool cross(const double from[3], const double dir[3], const double lo[3], const double hi[3], double *near,
                  double *far) {
  for (int k = 0; k < 3; k++) {
    const double d = fabs(dir[k]) < 1e-12 ? 1e-12 : dir[k], a = (lo[k] - from[k]) / d, b = (hi[k] - from[k]) / d;
    *near = fmax(*near, fmin(a, b)), *far = fmin(*far, fmax(a, b));
  }
  return *near < *far;
}

/* How far from s on a ray goes through boxes that the map knows to be empty. */
static double leap(const oracle *o, const double from[3], const double dir[3], double s) {
  int box[3];
  for (int k = 0; k < 3; k++) {
    box[k] = (int)floor((from[k] + s * dir[k]) / o->map->block);
    box[k] = box[k] < 0 ? 0 : box[k] >= o->map->blocks[k] ? o->map->blocks[k] - 1 : box[k];
  }
  const int d = o->map->distance[(box[2] * o->map->blocks[1] + box[1]) * o->map->blocks[0] + box[0]];
  double lo[3], hi[3], near = -1e30, far = 1e30;
  for (int k = 0; k < 3; k++) {
    lo[k] = (double)(box[k] - d + 1) * o->map->block, hi[k] = (double)(box[k] + d) * o->map->block;
    if (box[k] + d >= o->map->blocks[k]) hi[k] = 1e9;
    if (box[k] - d < 0) lo[k] = -1e9;
  }
  return d > 0 && cross(from, dir, lo, hi, &near, &far) ? far : s;
}

static double value_on(const oracle *o, const double from[3], const double dir[3], double s) {
  double at[3], value = 0;
  for (int k = 0; k < 3; k++)
    at[k] = fmin(fmax(from[k] + s * dir[k], fmax(o->rays.lo[k], 0)), tc_volume_describe(o->volume)->dims[k] - 1);
  tc_volume_value_at(o->volume, at, &value);
  return value;
}

static void count_ray(oracle *o, double x, double y) {
  const tc_rays *r = &o->rays;
  double from[3], view[3], dir[3], norm = 0;
  for (int k = 0; k < 3; k++) {
    from[k] = r->anchor0[k] + x * r->anchor_du[k] + y * r->anchor_dv[k];
    view[k] = r->view0[k] + x * r->view_du[k] + y * r->view_dv[k];
    norm += view[k] * view[k];
  }
  norm = sqrt(norm);
  for (int k = 0; k < 3; k++)
    dir[k] =
        (r->to_index[3 * k] * view[0] + r->to_index[3 * k + 1] * view[1] + r->to_index[3 * k + 2] * view[2]) / norm;
  double near = r->perspective ? -norm : -r->eye_mm, far = r->far_mm, clear = 1;
  if (!cross(from, dir, r->lo, r->hi, &near, &far)) return;
  bool fresh = true;
  const int count = (int)ceil((far - near) / r->step_mm);
  double front = value_on(o, from, dir, near);
  int wanted = 0; /* the first segment that is not known to be empty */
  for (int i = 0; i < count; i++) {
    const double s = near + i * r->step_mm, end = fmin(s + r->step_mm, far), back = value_on(o, from, dir, end);
    if (i >= wanted) wanted = (int)floor((leap(o, from, dir, s) - near) / r->step_mm);
    if (i < wanted) {
      fresh = true;
    } else {
      o->samples += 1 + fresh;
      fresh = false;
    }
    clear *= exp(-tc_extinction_mean(&o->scene->transfer_function, front, back) * (end - s));
    front = back;
    if (clear < o->scene->sampling.termination) break;
  }
}

static double oracle_of(const tc_volume *v, const tc_scene *s) {
  g_autoptr(tc_support) support = support_of(v, &s->transfer_function);
  g_autoptr(tc_minmax) m = tc_minmax_build(v, FINE, 0, NULL, NULL);
  g_autoptr(tc_distance_map) map = tc_distance_map_build(m, support, NULL, NULL, NULL);
  oracle o = {.volume = v, .scene = s, .map = map};
  tc_rays_set_up(&o.rays, v, s, s->image.width, s->image.height);
  for (int y = 0; y < s->image.height; y++)
    for (int x = 0; x < s->image.width; x++) count_ray(&o, x + 0.5, y + 0.5);
  return o.samples;
}

/* Samples taken over the oracle's, of a picture whose pixels are so many voxels wide. */
static double beside_oracle(tc_renderer *r, tc_volume *v, const char *name, double pixel) {
  g_auto(tc_scene) s;
  tc_fit fit;
  g_auto(tc_frame) f = {0};
  tc_scene_init(&s);
  tc_fit_find(&fit, v);
  tc_scene_dress(&s, v, &fit, false);
  s.shading.model = TC_SHADING_NONE;
  s.image.width = s.image.height = 140;
  const double *spacing = tc_volume_describe(v)->spacing;
  const double height_mm = pixel * s.image.height * fmin(spacing[0], fmin(spacing[1], spacing[2]));
  double away = 0;
  for (int k = 0; k < 3; k++) away = hypot(away, s.camera.target[k] - s.camera.position[k]);
  s.camera.fov_y_deg = 360 / M_PI * atan(0.5 * height_mm / away);
  render(r, v, &s, &f);
  const double took = (double)f.stats.samples, exact = oracle_of(v, &s);
  s.skipping.mode = TC_SKIPPING_OFF;
  render(r, v, &s, &f);
  printf("  %s, pixels of %g voxels: %.0f samples, %.2f of the oracle's, %.2f of all\n", name, pixel, took, took / exact,
         took / (double)f.stats.samples);
  return took / exact;
}

/* Built-in volumes with pixels of half a voxel and of one voxel; with TC_LONG those of TC_DATA too, with pixels of half a voxel. With
 * wider pixels the rays of a packet lie further apart, and each takes samples for its neighbours. For pixels of one voxel the ratio
 * is only printed: up to 1.27 where a volume has few voxels across. */
TEST(samples_are_near_the_oracle) {
  static const char *const demos[] = {"head", "vessels", "bucky", "marschner-lobb"};
  g_autoptr(tc_renderer) r = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU}, NULL);
  double worst = 0;
  for (size_t i = 0; i < G_N_ELEMENTS(demos); i += STRIDE(2)) {
    g_autoptr(tc_volume) v = tc_volume_demo(demos[i], NULL);
    worst = fmax(worst, fmax(beside_oracle(r, v, demos[i], 0.5), beside_oracle(r, v, demos[i], 1)));
  }
  g_autofree char *folder =
      g_build_filename(getenv("TC_LONG") && getenv("TC_DATA") ? getenv("TC_DATA") : "", "nrrd", NULL);
  GDir *dir = g_dir_open(folder, 0, NULL);
  for (const char *name; dir && (name = g_dir_read_name(dir));) {
    g_autofree char *path = g_build_filename(folder, name, NULL);
    g_autoptr(tc_volume) v = tc_import(path, NULL, NULL);
    if (!v) continue;
    worst = fmax(worst, beside_oracle(r, v, name, 0.5));
    beside_oracle(r, v, name, 1);
  }
  if (dir) g_dir_close(dir);
  assert_true(worst > 0.9 && worst <= 1.1);
}

TESTS(NULL, NULL)
