/* Pre-integration tables that OpenGL builds against those of the cpu: every entry, and pictures that read them. Skips
 * where EGL gives no OpenGL 4.5. */
#include "tests/support/test.h"

#include <epoxy/gl.h>

#include "renderer/classify/outline.h"
#include "renderer/base/clock.h"
#include "renderer/raycast/gl/builder.h"
#include "renderer/tomocast.h"
#include "tests/support/grid.h"

#define BOUND 1e-6 /* of colours and opacities in 0..1 */

static GError *error;
static tc_gl_context *context; /* NULL: none here */
static tc_gl_builder builder;
static tc_pool *pool;

static int set_up(void **state) {
  context = tc_gl_context_new(&error);
  if (!context) {
    printf("skipped: %s\n", error->message);
    g_clear_error(&error);
    return 0;
  }
  const tc_gl_report *report = tc_gl_context_about(context);
  const char *why;
  tc_gl_builder_make(&builder, TC_TABLES_AUTO, report);
  assert_int_equal(tc_gl_builder_serves(&builder, 256, 0, 0, &why), report->hardware);
  printf("%s: %s\n", report->renderer, why);
  tc_gl_builder_clear(&builder);
  tc_gl_builder_make(&builder, TC_TABLES_GL, report);
  assert_true(tc_gl_builder_serves(&builder, 256, 7, 0, &why));
  assert_false(tc_gl_builder_serves(&builder, 256, 0, 8, &why));
  assert_non_null(strstr(why, "cpu"));
  assert_false(tc_gl_builder_serves(&builder, 1 << 20, 0, 0, &why));
  assert_non_null(strstr(why, "buffer textures"));
  pool = tc_pool_new(2, NULL);
  return pool ? 0 : -1;
}

static int tear_down(void **state) {
  if (context) {
    tc_gl_context_use(context, NULL);
    tc_gl_builder_clear(&builder);
  }
  tc_gl_context_free(context);
  tc_pool_free(pool);
  return 0;
}

/* ---- entries ---- */

/* What OpenGL makes of an outline, [bytes]; g_free it. */
static float *build_here(const tc_table *table, double *ms) {
  unsigned buffer, texture;
  assert_made(tc_gl_context_use(context, &error));
  glCreateBuffers(1, &buffer);
  glNamedBufferStorage(buffer, (GLsizeiptr)table->bytes, NULL, GL_DYNAMIC_STORAGE_BIT);
  glCreateTextures(GL_TEXTURE_BUFFER, 1, &texture);
  glTextureBuffer(texture, GL_RGBA32F, buffer);
  double start = tc_now_ms();
  assert_made(tc_gl_builder_run(&builder, table, buffer, texture, &error));
  *ms = tc_now_ms() - start;
  float *entries = g_malloc(table->bytes);
  glGetNamedBufferSubData(buffer, 0, (GLsizeiptr)table->bytes, entries);
  glDeleteTextures(1, &texture);
  glDeleteBuffers(1, &buffer);
  return entries;
}

/* Every entry a number, opacity in 0..1, no colour over it times the brightest; nothing where no segment is. */
static void check_entries(const char *what, const tc_table *t, const float *entries) {
  for (int w = 0; w <= t->n_subtables; w++) {
    const tc_table_window window = tc_table_window_of(t, w);
    const size_t reach = (size_t)(window.intervals + 1) * (size_t)window.columns;
    for (size_t i = window.start - reach; i < window.start + reach + (size_t)window.columns; i++) {
      const float *e = entries + 4 * i;
      bool fine = e[3] >= 0 && e[3] <= 1;
      for (int c = 0; c < 3; c++) fine = fine && e[c] >= 0 && e[c] <= e[3] * window.peak[c];
      if (!fine) fail_msg("%s: entry %zu is %g %g %g %g", what, i, e[0], e[1], e[2], e[3]);
    }
  }
}

typedef struct outcome {
  double worst, cpu_ms, gl_ms;
} outcome;

static outcome compare(const char *what, const tc_table_params *p) {
  g_autoptr(tc_table) t = tc_table_outline(p, NULL, &error);
  assert_made(t);
  outcome o = {0};
  g_autofree float *here = build_here(t, &o.gl_ms);
  check_entries(what, t, here);
  double outline_ms = t->build_ms;
  assert_made(tc_table_fill(t, NULL, pool, &error));
  o.cpu_ms = t->build_ms - outline_ms;
  size_t at = 0;
  for (size_t i = 0; i < t->bytes / sizeof(float); i++) {
    double off = fabs((double)here[i] - t->entries[i]);
    if (off > o.worst) o.worst = off, at = i;
    if (i % 4 == 3 && (here[i] > 0) != (t->entries[i] > 0)) /* leaping relies on what is empty */
      fail_msg("%s: entry %zu has an opacity of %g, not %g", what, i / 4, here[i], t->entries[i]);
  }
  if (!(o.worst <= BOUND))
    fail_msg("%s: entry %zu (n = %d), channel %zu is %.9g, not %.9g", what, at / 4, t->n, at % 4, (double)here[at],
             (double)t->entries[at]);
  return o;
}

static tc_knot smooth[] = {
    {0, {0.1, 0.2, 0.9}, 0}, {80, {0.9, 0.4, 0.1}, 0.02}, {170, {0.2, 0.9, 0.3}, 0.3}, {255, {1, 1, 0.5}, 0.6}};
static tc_knot jumping[] = {{0, {0, 0, 1}, 0}, {90, {0, 0, 1}, 0}, {90, {1, 0.5, 0}, 1}, {92.5, {0.2, 0.5, 1}, 1},
                            {92.5, {0, 1, 0}, 0}, {200, {1, 0, 0}, 0.01}, {200, {0, 1, 1}, 100}, {255, {1, 1, 0}, 100}};
static tc_knot ramp[] = {{0, {1, 0, 0}, 0}, {255, {0, 1, 1}, 1}};
static tc_knot fall[] = {{0, {1, 0.2, 0}, 1}, {255, {0, 1, 0.7}, 1e-3}};
static tc_knot constant[] = {{100, {0.7, 0.2, 0.4}, 0.3}};
static tc_knot opaque[] = {
    {0, {0, 0, 0}, 0}, {100.3, {0.2, 0.4, 0.8}, 0.2}, {101.9, {1, 1, 0.2}, 1}, {255, {0.5, 0.1, 1}, 0.9}};

static tc_table_params params(tc_transfer_function *tf, tc_knot *points, size_t count, tc_knot_kind kind, int n,
                              double step) {
  *tf = (tc_transfer_function){.points = points, .count = count, .kind = kind, .unit_distance_mm = 1};
  return (tc_table_params){.tf = tf, .slope = 1, .voxel_lo = 0, .voxel_hi = 255, .n = n, .step_mm = step};
}

/* Any number of nodes, and how long both builders take over the usual ones. */
TEST(every_size) {
  needs(context);
  static const int sizes[] = {2, 3, 5, 17, 63, 100, 256, 512, 1024, 2048};
  for (size_t i = 0; i < G_N_ELEMENTS(sizes); i++) {
    tc_transfer_function tf;
    tc_table_params p = params(&tf, smooth, 4, TC_KNOT_OPACITY, sizes[i], 0.8);
    outcome o = compare("smooth", &p);
    printf("  %4d nodes: off by %.1e; cpu %.2f ms, opengl %.2f ms, %.1f times that\n", p.n, o.worst, o.cpu_ms, o.gl_ms,
           o.gl_ms / o.cpu_ms);
  }
}

TEST(any_stiffness) {
  needs(context);
  static const struct { const char *what; tc_knot *knots; size_t count; } functions[] = {
      {"smooth", smooth, 4}, {"jumping", jumping, 8}, {"ramp", ramp, 2}, {"fall", fall, 2}, {"constant", constant, 1}};
  for (size_t f = 0; f < G_N_ELEMENTS(functions); f++) {
    double worst = 0;
    for (double scale = 1e-6; scale < 2e6; scale *= 10)
      for (double step = 1e-2; step < 200; step *= 100) {
        tc_knot knots[8];
        memcpy(knots, functions[f].knots, functions[f].count * sizeof *knots);
        for (size_t i = 0; i < functions[f].count; i++) knots[i].amount *= scale;
        tc_transfer_function tf;
        tc_table_params p = params(&tf, knots, functions[f].count, TC_KNOT_EXTINCTION, 96, step);
        worst = fmax(worst, compare(functions[f].what, &p).worst);
      }
    printf("  %s, 1e-6 to 1e6 per mm, steps of 0.01 to 100 mm: off by %.1e\n", functions[f].what, worst);
  }
}

/* Opacities (whose extinction bends between knots), linear light, values falling along the nodes, an opaque peak. */
TEST(other_conventions) {
  needs(context);
  tc_transfer_function tf;
  for (int i = 0; i < 8; i++) {
    tc_table_params p = params(&tf, i & 1 ? opaque : smooth, 4, TC_KNOT_OPACITY, i & 2 ? 200 : 256, 0.7);
    p.linear_light = i & 4;
    if (i & 2) p.slope = -0.5, p.intercept = 200;
    printf("  %s%s%s: off by %.1e\n", i & 1 ? "opaque" : "smooth", i & 2 ? ", falling" : "",
           i & 4 ? ", linear light" : "", compare("conventions", &p).worst);
  }
}

/* Thousands of knots in a node interval, and knots drawn by chance over many orders of magnitude. */
TEST(many_knots) {
  needs(context);
  enum { MANY = 20000 };
  g_autofree tc_knot *knots = g_new(tc_knot, MANY);
  uint32_t dice = 5;
  double worst = 0;
  for (int round = 0; round < 40; round++) {
    size_t count = round ? 2 + (size_t)round % 11 : MANY;
    for (size_t i = 0; i < count; i++) {
      double chance[5];
      for (int k = 0; k < 5; k++) chance[k] = ((dice = dice * 1664525u + 1013904223u) >> 8) / 16777216.0;
      knots[i] = (tc_knot){255.0 * (double)i / (double)(count - 1), {chance[0], chance[1], chance[2]},
                           chance[3] < 0.2 ? 0 : pow(10, 12 * chance[4] - 6)};
    }
    tc_transfer_function tf;
    tc_table_params p = params(&tf, knots, count, TC_KNOT_EXTINCTION, 64, 1);
    worst = fmax(worst, compare("chance", &p).worst);
  }
  printf("  40 functions by chance: off by %.1e\n", worst);
}

/* ---- pictures ---- */

static tc_volume *waves(tc_voxel_type type) {
  double wavelength = 23;
  static const double slopes[TC_VOXEL_TYPE_COUNT] = {1.0 / 255, 1.0 / 127, 1.0 / 65535, 1.0 / 32767, 1};
  test_grid grid = {.dims = {40, 40, 40}, .type = type, .slope = slopes[type]};
  return test_volume(&grid, test_waves, &wavelength);
}

/* A value one of 65535 wide shows only through subtables. */
TEST(one_value_wide) {
  needs(context);
  tc_knot peak[] = {{0.499994, {1, 0.5, 0}, 0}, {0.5, {1, 1, 0}, 40}, {0.500006, {0, 0.5, 1}, 0}};
  g_autoptr(tc_volume) volume = waves(TC_U16);
  tc_transfer_function tf;
  tc_table_params p = params(&tf, peak, 3, TC_KNOT_EXTINCTION, 0, 0.5);
  p.slope = tc_volume_describe(volume)->slope;
  tc_table_choose(volume, &p, NULL);
  assert_true(p.n_subtables > 0);
  printf("  %d nodes and %d subtables: off by %.1e\n", p.n, p.n_subtables, compare("peak", &p).worst);
}

static tc_renderer *renderer_with(tc_table_builder tables) {
  tc_renderer *r =
      tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_GL, .tables = tables}, &error);
  assert_made(r);
  return r;
}

/* The same picture from either table, the plan says which it was, and what does not change is not built again. */
TEST(pictures) {
  needs(context);
  static const tc_voxel_type types[] = {TC_U8, TC_I16, TC_F32};
  static const double oblique[3] = {0.4, -1, 0.3};
  tc_knot soft[] = {{0.1, {0.1, 0.1, 0.6}, 0}, {0.4, {0.2, 0.8, 0.3}, 0.02}, {0.6, {0.9, 0.7, 0.2}, 0.1},
                    {0.9, {1, 1, 0.9}, 0.4}};
  tc_knot peak[] = {{0.49999, {1, 0.5, 0}, 0}, {0.5, {1, 1, 0}, 1}, {0.50001, {0, 0.5, 1}, 0}};
  tc_renderer *r[] = {renderer_with(TC_TABLES_CPU), renderer_with(TC_TABLES_GL)};
  static const char *const says[] = {"built by the cpu: asked for", "built by opengl: asked for"};
  for (size_t i = 0; i < 2 * G_N_ELEMENTS(types); i += STRIDE(3)) {
    g_autoptr(tc_volume) volume = waves(types[i / 2]);
    g_auto(tc_scene) scene;
    tc_frame frames[2] = {{0}, {0}};
    tc_explanation plan;
    test_scene(&scene, 96, 96);
    test_scene_frame(&scene, volume, TC_PERSPECTIVE, oblique);
    test_scene_knots(&scene, TC_KNOT_OPACITY, i % 2 ? peak : soft, i % 2 ? 3 : 4);
    for (int k = 0; k < 2; k++) {
      const tc_render_request request = {.want_linear = true, .explanation = &plan};
      assert_made(tc_render(r[k], volume, &scene, &request, &frames[k], &error));
      const tc_explained_stage *table = &plan.stages[TC_STAGE_TABLE_2D];
      assert_non_null(strstr(table->reason, says[k]));
      assert_true(table->ms > 0 && table->ms == frames[k].stats.tables_ms && table->bytes > 256 * 256 * 16);
      assert_true(tc_renderer_explain(r[k], volume, &scene, NULL, &plan, NULL));
      assert_true(strstr(table->reason, says[k]) && fabs(table->ms - frames[k].stats.tables_ms) < 1e-9);
      scene.camera.position[0] += 3; /* a camera's move builds nothing */
      assert_made(tc_render(r[k], volume, &scene, &request, &frames[k], &error));
      assert_true(frames[k].stats.tables_ms == 0 && table->ms == 0);
      scene.camera.position[0] -= 3;
      assert_made(tc_render(r[k], volume, &scene, &request, &frames[k], &error));
    }
    double worst = 0, most = 0;
    for (int p = 0; p < 4 * 96 * 96; p++) {
      worst = fmax(worst, fabs((double)frames[0].linear[p] - frames[1].linear[p]));
      most = fmax(most, frames[0].linear[p]);
    }
    printf("  %s, %s: off by %.1e, up to %.2f shows\n", tc_voxel_type_name(types[i / 2]), i % 2 ? "peak" : "soft",
           worst, most);
    assert_true(worst < 1e-5 && most > 0.01);
    for (int k = 0; k < 2; k++) tc_frame_finish(&frames[k]);
  }
  for (int k = 0; k < 2; k++) tc_renderer_free(r[k]);
}

/* The cpu has a table of its own where it stands in for a program that is being compiled; rounded tables are its. */
TEST(tables_of_the_cpu) {
  needs(context);
  static const double front[3] = {0, -1, 0};
  g_autoptr(tc_renderer) r = renderer_with(TC_TABLES_GL);
  g_autoptr(tc_volume) volume = waves(TC_U8);
  g_auto(tc_scene) scene;
  g_auto(tc_frame) frame = {0};
  tc_explanation plan;
  test_scene(&scene, 32, 32);
  test_scene_frame(&scene, volume, TC_PERSPECTIVE, front);
  tc_knot soft[] = {{0.1, {0.1, 0.1, 0.6}, 0}, {0.9, {1, 1, 0.9}, 0.4}};
  test_scene_knots(&scene, TC_KNOT_OPACITY, soft, 2);
  const char *reason = plan.stages[TC_STAGE_TABLE_2D].reason;
  tc_render_request request = {.hurry = true, .explanation = &plan};
  assert_made(tc_render(r, volume, &scene, &request, &frame, &error));
  assert_true(frame.stats.stand_in && strstr(reason, "built by the cpu, which draws"));
  request = (tc_render_request){.table_bits = 8, .explanation = &plan};
  assert_made(tc_render(r, volume, &scene, &request, &frame, &error));
  assert_true(!frame.stats.stand_in && strstr(reason, "which also rounds"));
  assert_made(tc_render(r, volume, &scene, &(tc_render_request){.explanation = &plan}, &frame, &error));
  assert_true(!frame.stats.stand_in && strstr(reason, "built by opengl"));
}

int main(void) {
  setenv("MESA_SHADER_CACHE_DISABLE", "true", 1); /* its key misses some of Mesa's own settings */
  return run_all_tests(set_up, tear_down);
}
