/* The pre-integration table against the reference integrator, transfer functions smooth, jumping and stiff. */
#include "tests/support/test.h"

#include "renderer/classify/outline.h"
#include "renderer/reference/reference.h"
#include "renderer/classify/transfer.h"
#include "renderer/frame/resources.h"
#include "tests/support/scoped.h"

typedef struct { double c[3], t; } light;

/* One segment of length d from value a to b: the reference integrator's ray through a volume that changes so. */
static light integral(const tc_transfer_function *tf, double a, double b, double d, bool linear_light) {
  tc_volume_desc desc = {.dims = {2, 2, 2}, .type = TC_F32, .spacing = {d, 1, 1}, .slope = a == b ? 1 : b - a,
                         .intercept = a, .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .frames = 1};
  tc_volume *volume = tc_volume_new(&desc, NULL);
  for (int i = 0; i < 8; i++) ((float *)tc_volume_voxels(volume))[i] = a == b ? 0 : (float)(i & 1);
  tc_volume_seal(volume);
  tc_scene scene;
  tc_scene_init(&scene);
  g_free(scene.transfer_function.points);
  scene.transfer_function = *tf;
  scene.transfer_function.points = g_memdup2(tf->points, tf->count * sizeof *tf->points);
  scene.image.width = scene.image.height = 1;
  scene.image.linear_light = linear_light;
  scene.shading.model = TC_SHADING_NONE;
  scene.camera = (tc_camera){.projection = TC_ORTHOGRAPHIC, .position = {-1, 0.5, 0.5}, .target = {1, 0.5, 0.5},
                             .up = {0, 0, 1}, .height_mm = 0.1};
  GError *error = NULL;
  tc_reference *reference = tc_reference_new(volume, &scene, 1, 1, 1e-12, &error);
  if (!reference) fail_msg("%s", error->message);
  double rgba[4];
  tc_reference_pixel(reference, 0.5, 0.5, rgba);
  tc_reference_free(reference);
  tc_scene_clear(&scene);
  tc_volume_unref(volume);
  return (light){{rgba[0], rgba[1], rgba[2]}, 1 - rgba[3]};
}

static const float *entry(const tc_table *t, int front, int back) {
  int k = back - front, i = front < back ? front : back;
  return t->zero_row + ((ptrdiff_t)k * t->columns + i) * 4;
}

static double worst(const tc_table_params *p, tc_pool *pool, int samples, const char *name) {
  GError *error = NULL;
  g_autoptr(tc_table) t = tc_table_build(p, pool, &error);
  assert_non_null(t);
  double most = 0;
  uint32_t state = 7;
  for (int s = 0; s < samples; s++) {
    state = state * 1664525u + 1013904223u;
    /* a third of the pairs about where most cases are steepest */
    int f = s % 3 ? (int)(state >> 8) % t->n : (int)((95 + (state >> 8) % 12) * (unsigned)(t->n - 1) / 255);
    state = state * 1664525u + 1013904223u;
    /* half of the pairs near the diagonal, where lookups are */
    int b = s % 2 ? (int)(state >> 8) % t->n : f + (int)(state >> 8) % 9 - 4;
    if (b < 0 || b >= t->n) b = f;
    double vf = p->slope * (t->lo + (t->hi - t->lo) * f / (t->n - 1)) + p->intercept;
    double vb = p->slope * (t->lo + (t->hi - t->lo) * b / (t->n - 1)) + p->intercept;
    light l = integral(p->tf, vf, vb, p->step_mm, p->linear_light);
    const float *e = entry(t, f, b);
    for (int c = 0; c < 3; c++) most = fmax(most, fabs((double)e[c] - l.c[c]));
    most = fmax(most, fabs((double)e[3] - (1 - l.t)));
    assert_true(e[3] >= 0 && e[3] <= 1);
  }
  printf("%-28s n=%4d %7.2f ms  max error %.2e\n", name, t->n, t->build_ms, most);
  return most;
}

static tc_knot smooth[] = {
    {0, {0.1, 0.2, 0.9}, 0}, {80, {0.9, 0.4, 0.1}, 0.02}, {170, {0.2, 0.9, 0.3}, 0.3}, {255, {1, 1, 1}, 0.6}};
static tc_knot jumping[] = {{0, {0, 0, 1}, 0}, {90, {0, 0, 1}, 0}, {90, {1, 0.5, 0}, 1e4}, {92.5, {0.2, 0.5, 1}, 1e4},
                            {92.5, {0, 1, 0}, 0}, {200, {1, 0, 0}, 0.01}, {200, {0, 1, 1}, 1e6}, {255, {1, 1, 0}, 1e6}};
static tc_knot ramp[] = {{0, {1, 0, 0}, 0}, {255, {0, 1, 1}, 1e6}};
static tc_knot opaque[] = {
    {0, {0, 0, 0}, 0}, {100.3, {0.2, 0.4, 0.8}, 0.2}, {101.9, {1, 1, 0.2}, 1}, {255, {0.5, 0.1, 1}, 0.9}};

static tc_table_params params(tc_transfer_function *tf, tc_knot *points, size_t count, tc_knot_kind kind, int n,
                              double step) {
  *tf = (tc_transfer_function){.points = points, .count = count, .kind = kind, .unit_distance_mm = 1};
  return (tc_table_params){.tf = tf, .slope = 1, .voxel_lo = 0, .voxel_hi = 255, .n = n, .step_mm = step};
}

/* Opacity and colour of any segment, a node interval long or longer, to 1e-6: smooth; within nodes from clear to
 * opaque, up or down or both, so that extinction is a logarithm with a pole; with jumps to 1e4 and 1e6; in linear light,
 * where colour is a curve. */
TEST(against_the_reference) {
  static tc_knot rise[] = {{0, {0, 0, 1}, 0}, {100, {1, 0, 0}, 0}, {101, {0, 1, 0}, 1}, {255, {0, 0, 1}, 1}};
  static tc_knot peak[] = {
      {0, {1, 0, 0}, 0}, {100.2, {1, 0, 0}, 0}, {100.5, {0, 1, 0}, 1}, {100.8, {0, 0, 1}, 0}, {255, {0, 0, 1}, 0}};
  static tc_knot inside[] = {{0, {0, 0, 1}, 0}, {100.25, {1, 0, 0}, 0}, {100.75, {0, 1, 0}, 0.9}, {255, {0, 0, 1}, 1}};
  static const struct { const char *name; tc_knot *knots; size_t count; tc_knot_kind kind; double unit, step;
  } cases[] = {{"smooth opacity", smooth, 4, TC_KNOT_OPACITY, 1, 1},
               {"smooth extinction", smooth, 4, TC_KNOT_EXTINCTION, 1, 1},
               {"smooth, 1000 mm", smooth, 4, TC_KNOT_EXTINCTION, 1, 1000},
               {"jumps to 1e4 and 1e6", jumping, 8, TC_KNOT_EXTINCTION, 1, 1},
               {"ramp to 1e6", ramp, 2, TC_KNOT_EXTINCTION, 1, 1},
               {"clear to opaque", opaque, 4, TC_KNOT_OPACITY, 1, 0.7},
               {"in one interval", rise, 4, TC_KNOT_OPACITY, 1, 1},
               {"a thousand times denser", rise, 4, TC_KNOT_OPACITY, 1e-3, 1},
               {"a tenth as long", rise, 4, TC_KNOT_OPACITY, 1, 0.1},
               {"inside of an interval", inside, 4, TC_KNOT_OPACITY, 1, 1},
               {"a peak inside of it", peak, 5, TC_KNOT_OPACITY, 1, 1},
               {"a hundred times denser", peak, 5, TC_KNOT_OPACITY, 1e-2, 1}};
  g_autoptr(tc_pool) pool = tc_pool_new(2, NULL);
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++)
    for (int way = 0; way < 4; way++) { /* linear light or not; 1024 nodes; down the axis */
      tc_transfer_function tf;
      tc_table_params p =
          params(&tf, cases[i].knots, cases[i].count, cases[i].kind, way == 2 ? 1024 : 256, cases[i].step);
      tf.unit_distance_mm = cases[i].unit;
      p.linear_light = way % 2;
      if (way == 3) p.slope = -0.5, p.intercept = 170;
      double most = worst(&p, pool, way < 2 ? 400 : 100, cases[i].name);
      if (!(most < 1e-6)) fail_msg("%s, way %d: off by %g", cases[i].name, way, most);
    }
}

/* Extinction linear in the value and colour linear too: the segment's colour has a closed form with erf. */
TEST(closed_form) {
  tc_transfer_function tf;
  for (double top = 1e-3; top < 1e7; top *= 10) {
    tc_knot knots[] = {{0, {0, 0, 0}, 0}, {256, {1, 1, 1}, top}};
    tc_table_params p = params(&tf, knots, 2, TC_KNOT_EXTINCTION, 257, 1);
    p.voxel_hi = 256;
    GError *error = NULL;
    g_autoptr(tc_table) t = tc_table_build(&p, NULL, &error);
    assert_non_null(t);
    /* tau(u) = top*u, L = u: C = integral u * top*u * exp(-top u^2/2) = sqrt(pi/(2 top)) erf(sqrt(top/2)) -
     * exp(-top/2) */
    double exact = sqrt(M_PI / (2 * top)) * erf(sqrt(top / 2)) - exp(-top / 2);
    if (top < 0.05) exact = top / 3 - top * top / 10; /* the difference cancels */
    double error_c = fabs((double)entry(t, 0, 256)[0] - exact),
           error_a = fabs((double)entry(t, 0, 256)[3] + expm1(-top / 2));
    printf("ramp to %8.0e: colour error %.1e, opacity error %.1e\n", top, error_c, error_a);
    assert_true(error_c < 3e-6 && error_a < 3e-6);
  }
}

/* Of one colour and extinction every segment is known, and all roundings could fall the same way: thousands of them add
 * up to nothing at any size. */
TEST(one_colour) {
  static const int sizes[] = {64, 300, 1024, 2048};
  for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
    double most = 0;
    for (double depth = 1.3e-3; depth < 2000; depth *= 6) {
      tc_knot knot = {100, {0.7, 0.2, 1}, depth};
      tc_transfer_function tf;
      tc_table_params p = params(&tf, &knot, 1, TC_KNOT_EXTINCTION, sizes[s], 1);
      g_autoptr(tc_table) t = tc_table_build(&p, NULL, NULL);
      double w = -expm1(-depth), want[4] = {0.7 * w, 0.2 * w, w, w};
      for (int k = 1; k < p.n; k += 1 + p.n / 200)
        for (int i = 0; i + k < p.n; i += 1 + p.n / 100)
          for (int c = 0; c < 8; c++)
            most = fmax(most, fabs((double)(c < 4 ? entry(t, i, i + k) : entry(t, i + k, i))[c % 4] - want[c % 4]));
    }
    printf("one colour, n=%4d: max error %.1e\n", sizes[s], most);
    assert_true(most < 5e-7);
  }
}

/* As many knots as a scene may have: built in bounded time (a node interval is cut into few pieces whatever is in it),
 * still the right mean extinction. */
TEST(very_many_knots) {
  tc_transfer_function tf;
  size_t count = TC_MAX_KNOTS;
  tc_knot *knots = malloc(count * sizeof *knots);
  for (size_t i = 0; i < count; i++) {
    double v = 255.0 * (double)i / (double)(count - 1);
    knots[i] = (tc_knot){v, {0.5, i % 2, 0.25}, (0.4 + 0.3 * sin(v / 20)) * (i % 3 ? 1 : 0.2)};
  }
  tc_table_params p = params(&tf, knots, count, TC_KNOT_OPACITY, 1024, 1);
  g_autoptr(tc_pool) pool = tc_pool_new(2, NULL);
  GError *error = NULL;
  g_autoptr(tc_table) t = tc_table_build(&p, pool, &error);
  assert_non_null(t);
  double most = 0, most_c = 0;
  for (int i = 0; i < 1000; i++) {
    double a = 255.0 * i / 1023, b = 255.0 * (i + 1) / 1023;
    most = fmax(most, fabs((double)entry(t, i, i + 1)[3] + expm1(-tc_extinction_mean(&tf, a, b))));
    most_c = fmax(most_c, fabs((double)entry(t, i, i + 1)[0] - 0.5 * (double)entry(t, i, i + 1)[3]));
  }
  printf("%zu knots: %.0f ms, opacity error %.1e, colour error %.1e\n", count, t->build_ms, most, most_c);
  assert_true(most < 1e-6 && most_c < 1e-6);
  free(knots);
}

/* Elementary segments are series where thin and closed forms where not: depths on both sides of every bound, tilted or
 * not. */
TEST(elementary_segments) {
  for (double depth = 1e-5; depth < 20; depth *= 1.4)
    for (double tilt = 0; tilt <= 1; tilt += 0.25) {
      tc_knot knots[] = {{0, {0.2, 0.9, 1}, depth * (1 - tilt)}, {63, {1, 0.4, 0}, depth * (1 + tilt)}};
      tc_transfer_function tf = {.points = knots, .count = 2, .kind = TC_KNOT_EXTINCTION, .unit_distance_mm = 1};
      tc_table_params p = {.tf = &tf, .slope = 1, .voxel_lo = 0, .voxel_hi = 63, .n = 64, .step_mm = 1};
      g_autoptr(tc_table) t = tc_table_build(&p, NULL, NULL);
      static const int pairs[][2] = {{0, 1}, {1, 0}, {30, 31}, {0, 63}, {63, 0}, {17, 21}, {40, 33}};
      for (size_t i = 0; i < sizeof pairs / sizeof *pairs; i++) {
        light l = integral(&tf, pairs[i][0], pairs[i][1], 1, false);
        const float *e = entry(t, pairs[i][0], pairs[i][1]);
        for (int c = 0; c < 4; c++) {
          double want = c < 3 ? l.c[c] : 1 - l.t, bound = 2e-7 + 4e-7 * want;
          if (abs(pairs[i][0] - pairs[i][1]) > 1) bound += 8e-7; /* rounding of compositions */
          if (!(fabs((double)e[c] - want) <= bound))
            fail_msg("depth %g, tilt %g, %d to %d, channel %d: %.9g, not %.9g", depth, tilt, pairs[i][0], pairs[i][1],
                     c, (double)e[c], want);
        }
      }
    }
}

/* Invariants of every entry: bounds, energy, and no difference between one thread and three. */
TEST(invariants) {
  tc_transfer_function tf;
  for (double step = 1e-6; step < 1e7; step *= 1000) {
    tc_table_params p = params(&tf, jumping, 8, TC_KNOT_EXTINCTION, 64, step);
    GError *error = NULL;
    g_autoptr(tc_pool) pool = tc_pool_new(3, NULL);
    tc_table *a = tc_table_build(&p, NULL, &error), *b = tc_table_build(&p, pool, &error);
    assert_memory_equal(a->entries, b->entries, a->bytes);
    for (int f = 0; f < 64; f++)
      for (int k = 0; k < 64; k++) {
        const float *e = entry(a, f, k);
        assert_true(e[3] >= 0 && e[3] <= 1);
        for (int c = 0; c < 3; c++) assert_true(e[c] >= 0 && e[c] <= e[3]); /* the brightest is 1 */
        assert_true(fabsf(e[3] - entry(a, k, f)[3]) < 2e-6f); /* opacity is symmetric */
      }
    tc_table_free(a);
    tc_table_free(b);
  }
}

static tc_table *rebuild(const tc_table_params *p, const tc_table *like, tc_pool *pool) {
  tc_table *t = tc_table_outline(p, NULL, NULL);
  assert_true(t && !t->entries && tc_table_held(t) < t->bytes && tc_table_fill(t, like, pool, NULL));
  assert_true(tc_table_held(t) > t->bytes);
  return t;
}

/* Built after a like table, whatever moved: to the last bit what is built from nothing. */
TEST(after_an_edit) {
  enum { LOW, HIGH, NONE }; /* which end of the axis no edit touches: entries there are copied, not made anew */
  static const struct { const char *what; int knot; double value, amount, red; int kept;
  } edits[] = {{"nothing", 1, 0, 0, 0, LOW},           {"a knot's amount", 2, 0, 0.04, 0, LOW},
               {"a knot's place", 1, 3.3, 0, 0, HIGH}, {"the first knot", 0, -2, 0.1, 0, HIGH},
               {"a colour", 2, 0, 0, 0.05, LOW},       {"the brightest colour", 3, 0, 0, -0.5, NONE}};
  g_autoptr(tc_pool) pool = tc_pool_new(2, NULL);
  for (size_t i = 0; i < sizeof edits / sizeof *edits; i++)
    for (int n = 61; n <= 256; n += 195) {
      tc_knot before[4], after[4];
      memcpy(before, smooth, sizeof before);
      before[3].color[0] = 1;
      memcpy(after, before, sizeof after);
      after[edits[i].knot].value += edits[i].value;
      after[edits[i].knot].amount += edits[i].amount;
      after[edits[i].knot].color[0] += edits[i].red;
      tc_transfer_function tf, edited;
      tc_table_params p = params(&tf, before, 4, TC_KNOT_OPACITY, n, 0.7);
      params(&edited, after, 4, TC_KNOT_OPACITY, n, 0.7);
      p.n_subtables = 1, p.subtables[0] = (tc_subtable){.lo = 60, .hi = 100};
      tc_table *like = tc_table_build(&p, pool, NULL), *other;
      p.tf = &edited;
      tc_table *a = rebuild(&p, like, pool), *b = tc_table_build(&p, NULL, NULL);
      if (memcmp(a->entries, b->entries, a->bytes))
        fail_msg("%s moved, n = %d: entries differ", edits[i].what, n);
      assert_true(i == 0 || memcmp(a->entries, like->entries, a->bytes));
      for (int end = LOW; end <= HIGH; end++) { /* found by a mark that only a copy can have */
        float *mark = like->zero_row + 4 * (2 * like->columns + (end == LOW ? 3 : n - 9)), was = *mark;
        *mark = 0.123f;
        g_autoptr(tc_table) copy = rebuild(&p, like, pool);
        bool copied = copy->zero_row[mark - like->zero_row] == 0.123f;
        if (copied != (i == 0 || edits[i].kept == end))
          fail_msg("%s moved, n = %d, end %d: copied %d", edits[i].what, n, end, copied);
        *mark = was;
      }
      p.step_mm = 0.8, p.n_subtables = 0; /* a like table of no use */
      other = rebuild(&p, like, pool);
      tc_table_free(b);
      b = tc_table_build(&p, NULL, NULL);
      assert_memory_equal(other->entries, b->entries, b->bytes);
      tc_table_free(like), tc_table_free(a), tc_table_free(b), tc_table_free(other);
    }
}

/* Entries that an outline gets later count in the cache like any, and what is older goes for them. */
TEST(entries_count) {
  enum { TABLES = 20 };
  tc_transfer_function tf;
  double ms = 0;
  tc_plan plan = {0};
  const tc_frame_job outlines = {.plan = &plan, .outlines_table = true}, fills = {.plan = &plan};
  tc_resources *r = tc_resources_new(NULL, 6 << 20, NULL, NULL); /* a table of 256 takes 2.1 MB */
#define GET(job, ms) ((const tc_table *)tc_resources_get(r, TC_RESOURCE_TABLE, job, ms, NULL))
  const tc_table *tables[TABLES];
  for (int i = 0; i < TABLES; i++, ms = 0) {
    plan.table = params(&tf, smooth, 4, TC_KNOT_OPACITY, 256, 1 + i);
    tables[i] = GET(&outlines, &ms);
    assert_true(tables[i] && !tables[i]->entries && ms > 0 && ms == tc_resources_ms(r, TC_RESOURCE_TABLE, tables[i]));
    assert_ptr_equal(GET(&outlines, &ms), tables[i]);
  }
  for (int i = 0; i < 3; i++, ms = 0) {
    plan.table = params(&tf, smooth, 4, TC_KNOT_OPACITY, 256, 1 + i);
    const tc_table *t = GET(&outlines, &ms);
    assert_true(GET(&fills, &ms) == t && t->entries && ms > 0);
    const double took = ms;
    assert_true(GET(&fills, &ms) == t && ms == took); /* they are there */
    assert_ptr_equal(GET(&fills, NULL), t);
  }
  int left = 0, filled = 0;
  for (int i = 0; i < TABLES; i++) {
    plan.table = params(&tf, smooth, 4, TC_KNOT_OPACITY, 256, 1 + i);
    const tc_table *t = GET(&outlines, NULL);
    left += t != NULL;
    filled += t && t->entries;
  }
#undef GET
  printf("of %d outlines %d are left beside the entries of %d\n", TABLES - 3, left - filled, filled);
  assert_true(filled == 2 && left < TABLES);
  tc_resources_free(r);
}

/* While a transfer function is dragged, the tables of its frames go, and the next take their memory; what more than one frame
 * drew with stays. */
TEST(edits_go) {
  enum { EDITS = 20, KEPT = 6 };
  tc_transfer_function tf;
  tc_plan plan = {0};
  const tc_frame_job job = {.plan = &plan};
  const float *places[EDITS];
  int left = 0, distinct = 0;
  double ms = 0;
  tc_resources *r = tc_resources_new(NULL, 256 << 20, NULL, NULL);
#define GET(i, ms)                                                                                                     \
  (plan.table = params(&tf, smooth, 4, TC_KNOT_OPACITY, 256, 1 + (i)),                                                 \
   (const tc_table *)tc_resources_get(r, TC_RESOURCE_TABLE, &job, ms, NULL))
  const tc_table *often = GET(EDITS, &ms);
  assert_ptr_equal(GET(EDITS, &ms), often);
  for (int i = 0; i < EDITS; i++) {
    places[i] = GET(i, &ms)->entries;
    int k = 0;
    while (places[k] != places[i]) k++;
    distinct += k == i;
  }
  const tc_table *last = GET(EDITS - 1, NULL);
  tc_table *alone = tc_table_build(&plan.table, NULL, NULL);
  assert_memory_equal(last->entries, alone->entries, alone->bytes);
  for (int i = 0; i < EDITS; i++) left += GET(i, NULL) != NULL;
  assert_ptr_equal(GET(EDITS, NULL), often);
#undef GET
  assert_true(left <= KEPT && distinct <= KEPT);
  tc_table_free(alone);
  tc_resources_free(r);
}

/* Half floats of IEEE 754 and fixed point of 8 bits, at values whose neighbours are known. */
TEST(narrower_formats) {
  assert_true(tc_table_round(1.0f / 3, 16) == 0.333251953125f);
  assert_true(tc_table_round(0.99999f, 16) == 1);
  assert_true(tc_table_round(6.1e-5f, 16) == 1023 * 0x1p-24f); /* the largest subnormal half */
  assert_true(tc_table_round(1e-7f, 16) == 0x1p-23f && tc_table_round(2e-8f, 16) == 0);
  assert_true(tc_table_round(0.5f, 16) == 0.5f && tc_table_round(0.1f, 0) == 0.1f);
  assert_true(tc_table_round(0.1f, 8) == 26.0f / 255 && tc_table_round(1, 8) == 1);
}

static tc_volume *range_of(tc_voxel_type type, double lo, double hi) {
  tc_volume_desc desc = {
      .dims = {2, 1, 1}, .type = type, .spacing = {1, 1, 1}, .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .slope = 1};
  tc_volume *volume = tc_volume_new(&desc, NULL);
  for (int i = 0; i < 2; i++) {
    double v = i ? hi : lo;
    if (type == TC_U8) ((uint8_t *)tc_volume_voxels(volume))[i] = (uint8_t)v;
    else if (type == TC_I16) ((int16_t *)tc_volume_voxels(volume))[i] = (int16_t)v;
    else ((float *)tc_volume_voxels(volume))[i] = (float)v;
  }
  tc_volume_seal(volume);
  return volume;
}

/* Subtables only where knots want them, each narrower than the one before, around the knots and as fine as they want. */
TEST(subtables_where_knots_are_close) {
  static tc_knot peaks[] = {{-20000.5, {1, 1, 1}, 0}, {-20000, {1, 1, 1}, 1}, {-19999.5, {1, 1, 1}, 0},
                            {11999.5, {1, 1, 1}, 0},  {12000, {1, 1, 1}, 1},  {12000.5, {1, 1, 1}, 0}};
  static tc_knot step[] = {{300, {1, 1, 1}, 0}, {300, {1, 1, 1}, 0.5}};
  static tc_knot many[60];
  static tc_knot far[] = {{40000, {1, 1, 1}, 0}, {40000.5, {1, 1, 1}, 0.5}};
  static const struct {
    const char *what;
    tc_knot *knots;
    size_t count;
    tc_voxel_type type;
    double lo, hi;
    int n, subtables;
  } cases[] = {{"two peaks, 16 bits", peaks, 6, TC_I16, -32768, 32767, 256, 6},
               {"one of them", peaks, 3, TC_I16, -32768, 32767, 256, 5},
               {"peaks as floats", peaks, 6, TC_F32, -32768, 32767, 256, 6},
               {"a step in 12 bits", step, 2, TC_I16, -1024, 3071, 1024, 0},
               {"a step in 16 bits", step, 2, TC_I16, -32768, 32767, 256, 3},
               {"bytes", smooth, 4, TC_U8, 0, 255, 256, 0},
               {"out of range", far, 2, TC_I16, -1024, 3071, 1024, 0},
               {"twenty peaks", many, 60, TC_I16, -1024, 1000, 2048, 0}};
  for (int i = 0; i < 60; i++) many[i] = (tc_knot){-900 + 60 * (i / 3) + 4 * (i % 3), {1, 1, 1}, i % 3 == 1};
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    tc_transfer_function tf = {
        .points = cases[i].knots, .count = cases[i].count, .kind = TC_KNOT_OPACITY, .unit_distance_mm = 1};
    g_autoptr(tc_volume) volume = range_of(cases[i].type, cases[i].lo, cases[i].hi);
    tc_table_params p = {.tf = &tf, .slope = 1, .step_mm = 1};
    bool complete;
    tc_table_choose(volume, &p, &complete);
    g_autoptr(tc_table) t = tc_table_build(&p, NULL, NULL);
    printf("%-20s n=%4d, %d subtables, %.2f ms on one thread\n", cases[i].what, p.n, p.n_subtables, t->build_ms);
    assert_int_equal(p.n, cases[i].n);
    assert_int_equal(p.n_subtables, cases[i].subtables);
    assert_true(complete);
    for (int z = 0; z < p.n_subtables; z++) {
      double node = (p.subtables[z].hi - p.subtables[z].lo) / (TC_SUBTABLE_NODES - 1);
      /* an entry of the subtable is what the reference gives, at the peak in its middle */
      const float *e = t->subtable_rows[z] + (51 * (TC_SUBTABLE_NODES + 2) + 107) * 4;
      light near = integral(&tf, p.subtables[z].lo + 107 * node, p.subtables[z].lo + 158 * node, 1, false);
      assert_true(fabs((double)e[3] - (1 - near.t)) < 3e-6 && fabs((double)e[0] - near.c[0]) < 3e-6);
    }
  }
}

TESTS(NULL, NULL)
