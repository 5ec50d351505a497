/* The gl back end as a citizen: contexts, caches, limits, cancelling, compiling beside. Skips where EGL gives no OpenGL
 * 4.5. */
#include "tests/support/test.h"

#include <pthread.h>
#include <time.h>

#include "renderer/frame/backend.h"
#include "renderer/gl/device.h"
#include "renderer/gl/program.h"
#include "renderer/raycast/gl/backend.h"
#include "renderer/raycast/gl/textures.h"
#include "tests/support/grid.h"

G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_gl_context, tc_gl_context_free)

static GError *error;
static bool have_gl;

/* The call failed with this code and the message names the mend. */
static void expect_error(tc_error_code code, const char *part) {
  assert_non_null(error);
  printf("  %s\n", error->message);
  assert_true(g_error_matches(error, TC_ERROR, (gint)code));
  assert_non_null(strstr(error->message, part));
  assert_null(strchr(error->message, '\n'));
  g_clear_error(&error);
}

static double now_ms(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

static const double oblique[3] = {0.4, -1, 0.3};

static tc_renderer *new_gl(uint64_t cache_bytes) {
  tc_renderer *r =
      tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_GL, .cache_bytes = cache_bytes}, &error);
  assert_made(r);
  return r;
}

static tc_volume *waves(tc_voxel_type type, int side, double wavelength) {
  static const double slopes[TC_VOXEL_TYPE_COUNT] = {1.0 / 255, 1.0 / 127, 1.0 / 65535, 1.0 / 32767, 1};
  test_grid grid = {.dims = {side, side, side}, .type = type, .slope = slopes[type]};
  return test_volume(&grid, test_waves, &wavelength);
}

static void set_scene(tc_scene *scene, const tc_volume *volume, int side) {
  const tc_knot knots[] = {
      {0.1, {0.1, 0.1, 0.6}, 0}, {0.4, {0.2, 0.8, 0.3}, 0.02}, {0.6, {0.9, 0.7, 0.2}, 0.1}, {0.9, {1, 1, 0.9}, 0.4}};
  test_scene(scene, side, side);
  test_scene_frame(scene, volume, TC_PERSPECTIVE, oblique);
  test_scene_knots(scene, TC_KNOT_OPACITY, knots, G_N_ELEMENTS(knots));
  scene->skipping.mode = TC_SKIPPING_OFF;
}

/* Renders and compares with what was seen before. */
static void expect_same(tc_renderer *r, tc_volume *volume, const tc_frame *wanted) {
  g_auto(tc_scene) scene;
  g_auto(tc_frame) frame = {0};
  set_scene(&scene, volume, wanted->width);
  assert_made(tc_render(r, volume, &scene, NULL, &frame, &error));
  assert_memory_equal(frame.rgba, wanted->rgba, (size_t)frame.width * frame.height * 4);
}

static void render_first(tc_renderer *r, tc_volume *volume, int side, tc_frame *frame) {
  g_auto(tc_scene) scene;
  memset(frame, 0, sizeof *frame);
  set_scene(&scene, volume, side);
  assert_made(tc_render(r, volume, &scene, NULL, frame, &error));
}

/* ---- contexts ---- */

static int set_up(void **state) {
  tc_gl_report report;
  have_gl = tc_gl_report_read(&report, &error);
  if (!have_gl) printf("skipped: %s\n", error->message);
  g_clear_error(&error);
  return 0;
}

TEST(test_report) {
  needs(have_gl);
  tc_gl_report report;
  bool hardware = true;
  char why[200] = "";
  assert_made(tc_gl_report_read(&report, &error));
  printf("  %s | %s | %s | %s | 3-D side %d | buffer %lld | clock %d bits\n", report.platform, report.vendor,
         report.renderer, report.version, report.max_3d_side, (long long)report.max_ssbo_bytes, report.timestamp_bits);
  assert_true(report.max_3d_side >= 2048 && report.max_ssbo_bytes >= 1 << 24);
  assert_int_equal(tc_gl_probe(&hardware, why, sizeof why) && hardware, report.hardware);
  assert_true(strlen(why) > 0);
  if (strstr(report.renderer, "llvmpipe")) assert_false(report.hardware);
  if (tc_gl_count_hardware() == 0) assert_false(report.hardware);
  /* auto takes the GPU if it is one, and says why in any case */
  g_autoptr(tc_renderer) r = tc_renderer_new(NULL, &error);
  assert_made(r);
  assert_string_equal(tc_renderer_about(r)->backend, report.hardware ? "gl" : "cpu");
  printf("  auto: %s, %s\n", tc_renderer_about(r)->backend, tc_renderer_about(r)->why);
}

/* Renderers share a thread and a display; ending one, or probing, leaves the others working. */
TEST(test_several_contexts) {
  needs(have_gl);
  g_autoptr(tc_volume) volume = waves(TC_U8, 24, 11);
  tc_renderer *a = new_gl(0), *b = new_gl(0);
  g_auto(tc_frame) frame = {0};
  tc_gl_report report;
  render_first(a, volume, 80, &frame);
  expect_same(b, volume, &frame);
  assert_made(tc_gl_report_read(&report, &error));
  expect_same(a, volume, &frame);
  tc_renderer_free(b);
  expect_same(a, volume, &frame);
  b = new_gl(0);
  tc_renderer_free(a);
  expect_same(b, volume, &frame);
  tc_renderer_free(b);
}

static void *render_elsewhere(void *context) {
  tc_volume *volume = context;
  g_autoptr(GError) failure = NULL;
  tc_frame *frame = g_new0(tc_frame, 1);
  tc_renderer *r = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_GL}, &failure);
  tc_scene scene;
  set_scene(&scene, volume, 80);
  bool good = r && tc_render(r, volume, &scene, NULL, frame, &failure);
  tc_scene_clear(&scene);
  tc_renderer_free(r);
  if (good) return frame;
  fprintf(stderr, "other thread: %s\n", failure->message);
  g_free(frame);
  return NULL;
}

TEST(test_other_thread) {
  needs(have_gl);
  g_autoptr(tc_volume) volume = waves(TC_U8, 24, 11);
  g_autoptr(tc_renderer) here = new_gl(0);
  g_auto(tc_frame) frame = {0};
  render_first(here, volume, 80, &frame);
  pthread_t thread;
  void *result = NULL;
  assert_int_equal(pthread_create(&thread, NULL, render_elsewhere, volume), 0);
  pthread_join(thread, &result);
  tc_frame *theirs = result;
  assert_non_null(theirs);
  assert_memory_equal(theirs->rgba, frame.rgba, 80 * 80 * 4);
  tc_frame_finish(theirs);
  g_free(theirs);
  expect_same(here, volume, &frame);
}

/* ---- programs ---- */

TEST(test_program_cache) {
  needs(have_gl);
  g_autoptr(tc_gl_context) context = tc_gl_context_new(&error);
  assert_made(context);
  const char *const good[] = {"#version 450 core\n", "layout(local_size_x = 1) in;\nvoid main() {}\n"};
  const char *const bad[] = {"#version 450 core\n", "layout(local_size_x = 1) in;\nvoid main() { nothing = 1; }\n"};
  tc_gl_program_cache cache = {0};
  for (int key = 0; key < TC_GL_PROGRAMS + 8; key++) {
    unsigned program = tc_gl_program_compile(good, 2, "empty", &error);
    assert_made(program);
    tc_gl_program_put(&cache, &key, sizeof key, program);
    int first = 0;
    assert_int_not_equal(tc_gl_program_find(&cache, &first, sizeof first), 0); /* asked for each time: stays */
  }
  int held = 0;
  for (int key = 0; key < TC_GL_PROGRAMS + 8; key++)
    held += tc_gl_program_find(&cache, &key, sizeof key) != 0;
  assert_int_equal(held, TC_GL_PROGRAMS);
  int second = 1;
  assert_int_equal(tc_gl_program_find(&cache, &second, sizeof second), 0);
  tc_gl_program_clear(&cache);
  assert_int_equal(tc_gl_program_compile(bad, 2, "broken", &error), 0);
  expect_error(TC_ERROR_INTERNAL, "shader broken does not compile");
}

/* Nothing is drawn for a key that has no pieces. */
TEST(test_unbuilt_keys) {
  needs(have_gl);
  g_autoptr(tc_gl_context) context = tc_gl_context_new(&error);
  assert_made(context);
  const size_t first = offsetof(tc_gl_variant, plan);
  const struct { size_t offset; uint8_t value;
  } members[] = {{offsetof(tc_plan_key, mode), TC_MODE_COUNT},
                 {offsetof(tc_plan_key, classification), TC_CLASSIFICATION_COUNT},
                 {offsetof(tc_plan_key, order), TC_ORDER_COUNT},
                 {offsetof(tc_plan_key, filter), TC_FILTER_COUNT},
                 {offsetof(tc_plan_key, shading), TC_SHADING_COUNT},
                 {offsetof(tc_plan_key, coherence), 1}};
  for (size_t i = 0; i < G_N_ELEMENTS(members); i++) {
    tc_gl_variant variant;
    memset(&variant, 0, sizeof variant);
    ((uint8_t *)&variant)[first + members[i].offset] = members[i].value;
    assert_int_equal(tc_gl_compose(&variant, &error), 0);
    assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_UNSUPPORTED));
    g_clear_error(&error);
  }
  /* Every variant that exists compiles; the compiler is Mesa's, which no sanitizer watches. */
  int compiled = 0;
  for (int bits = 0; bits < 64; bits += STRIDE(9))
    for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++) {
      tc_gl_variant v;
      memset(&v, 0, sizeof v);
      v.plan.voxel_type = (uint8_t)type;
      v.plan.classification = (uint8_t)((type + bits) % TC_CLASSIFICATION_COUNT);
      v.plan.order = (type ^ bits >> 4) & 1;
      v.plan.projection = (uint8_t)(type & 1);
      v.plan.termination = bits >> 4 & !v.plan.order;
      v.plan.clipping = bits >> 5 & 1;
      v.plan.skipping = (type ^ bits >> 1) & 1;
      v.plan.shading = (type ^ bits >> 2) & 1;
      v.plan.gradient = v.plan.shading ? (uint8_t)((type + bits) % TC_GRADIENT_COUNT) : 0;
      v.atlas = bits & 1;
      v.linear_light = bits >> 1 & 1;
      v.transparent = bits >> 2 & 1;
      v.want_linear = bits >> 3 & 1;
      assert_made(tc_gl_compose(&v, &error));
      compiled++;
    }
  printf("  %d variants compile\n", compiled);
}

/* ---- one back end instance, driven directly ---- */

typedef struct bench {
  void *instance;
  tc_volume *volume;
  tc_scene scene;
  tc_table *table;
  tc_frame frame;
} bench;

static void bench_open(bench *b, tc_volume *volume, int side) {
  memset(b, 0, sizeof *b);
  b->volume = volume;
  b->instance = tc_gl_backend.create(&(tc_renderer_options){0}, NULL, &error);
  assert_made(b->instance);
  set_scene(&b->scene, volume, side);
  b->frame.width = b->frame.height = side;
  b->frame.rgba = malloc((size_t)side * side * 4);
  b->frame.linear = malloc((size_t)side * side * 16);
}

static void bench_close(bench *b) {
  tc_table_free(b->table);
  tc_frame_finish(&b->frame);
  tc_scene_clear(&b->scene);
  tc_gl_backend.destroy(b->instance);
}

static bool bench_render(bench *b, const tc_interrupt *interrupt) {
  tc_plan plan;
  tc_rays rays;
  const tc_volume_desc *d = tc_volume_describe(b->volume);
  if (!tc_plan_check(b->volume, &b->scene, b->frame.width, b->frame.height, NULL, &error)) return false;
  tc_plan_make(b->volume, &b->scene, &(tc_plan_request){.width = b->frame.width, .height = b->frame.height}, &plan);
  if (!b->table) {
    tc_table_params params = {
        .tf = &b->scene.transfer_function, .slope = d->slope, .intercept = d->intercept, .step_mm = plan.step_mm};
    tc_table_choose(b->volume, &params, NULL);
    b->table = tc_table_build(&params, NULL, &error);
    assert_made(b->table);
  }
  tc_rays_set_up(&rays, b->volume, &b->scene, b->frame.width, b->frame.height);
  tc_halt halt = tc_halt_begin(interrupt, 0);
  b->frame.stats = (tc_frame_stats){0};
  tc_frame_job job = {.plan = &plan,
                .key = plan.key,
                .scene = &b->scene,
                .volume = b->volume,
                .rays = &rays,
                .have.table = b->table,
                .halt = &halt,
                .want_linear = true,
                .frame = &b->frame};
  return tc_gl_backend.render(b->instance, &job, &error);
}

TEST(test_nothing_is_rebuilt) {
  needs(have_gl);
  g_autoptr(tc_volume) volume = waves(TC_U16, 24, 11);
  bench b;
  bench_open(&b, volume, 64);
  assert_made(bench_render(&b, NULL));
  assert_int_equal(tc_gl_backend_compiled(b.instance), 1);
  if (tc_gl_backend_report(b.instance)->timestamp_bits > 0) assert_true(tc_gl_backend_gpu_ms(b.instance) > 0);
  b.scene.camera.position[0] += 5;
  b.scene.image.background[0] = 0.5;
  assert_made(bench_render(&b, NULL));
  assert_int_equal(tc_gl_backend_compiled(b.instance), 1);
  b.scene.camera.projection = TC_ORTHOGRAPHIC;
  assert_made(bench_render(&b, NULL));
  b.scene.camera.projection = TC_PERSPECTIVE;
  assert_made(bench_render(&b, NULL));
  assert_int_equal(tc_gl_backend_compiled(b.instance), 2);
  bench_close(&b);
}

typedef struct canceller {
  tc_interrupt interrupt;
  double at_ms;
} canceller;

static void *cancel_soon(void *context) {
  canceller *c = context;
  nanosleep(&(struct timespec){.tv_nsec = 50000000}, NULL);
  c->at_ms = now_ms();
  atomic_store(&c->interrupt.cancel, true);
  return NULL;
}

/* A frame of some seconds ends soon after it is cancelled, and the next one is whole. */
TEST(test_cancel) {
  needs(have_gl);
  g_autoptr(tc_volume) volume = waves(TC_U8, 48, 17);
  bench b;
  bench_open(&b, volume, 1500);
  b.scene.sampling.step = 0.25;
  tc_interrupt cancelled;
  tc_interrupt_init(&cancelled);
  atomic_store(&cancelled.cancel, true);
  assert_false(bench_render(&b, &cancelled));
  expect_error(TC_ERROR_CANCELLED, "cancelled");
  canceller c;
  tc_interrupt_init(&c.interrupt);
  pthread_t thread;
  double start = now_ms();
  assert_int_equal(pthread_create(&thread, NULL, cancel_soon, &c), 0);
  bool finished = bench_render(&b, &c.interrupt);
  double end = now_ms();
  pthread_join(thread, NULL);
  if (finished) {
    printf("  the whole frame took only %.1f ms\n", end - start);
  } else {
    printf("  stopped %.1f ms after the wish\n", end - c.at_ms);
    expect_error(TC_ERROR_CANCELLED, "cancelled");
    assert_true(end - c.at_ms < 2000);
  }
  b.scene.sampling.step = 1;
  tc_table_free(b.table);
  b.table = NULL;
  assert_made(bench_render(&b, NULL));
  const float *center = b.frame.linear + (750 * 1500 + 750) * 4;
  assert_true(center[3] > 0);
  bench_close(&b);
}

/* ---- frames that do not wait ---- */

static bool draws_itself(tc_renderer *r, tc_volume *volume, const tc_scene *scene, bool hurry, tc_frame *frame) {
  tc_explanation plan;
  const tc_render_request request = {.want_linear = true, .hurry = hurry, .explanation = &plan};
  assert_made(tc_render(r, volume, scene, &request, frame, &error));
  bool itself = g_str_has_suffix(plan.kernel, ".gl");
  assert_int_equal(itself, !frame->stats.stand_in);
  assert_true(itself || !plan.key.skipping);
  return itself;
}

/* A program that is not there costs a frame that hurries no time: the cpu draws it, and opengl the next ones. */
TEST(test_hurry) {
  needs(have_gl);
  enum { SIDE = 64 };
  static const tc_mode modes[] = {TC_MODE_DVR, TC_MODE_MIP, TC_MODE_ISOSURFACE, TC_MODE_MPR};
  g_autoptr(tc_volume) volume = waves(TC_U16, 32, 17);
  tc_renderer *r = new_gl(0), *patient = new_gl(0);
  g_auto(tc_scene) scene;
  set_scene(&scene, volume, SIDE);
  scene.skipping.mode = TC_SKIPPING_AUTO;
  scene.shading.model = TC_SHADING_LAMBERT;
  scene.isosurface.value = scene.window.center = 0.5;
  scene.window.width = 1;
  for (size_t m = 0; m < G_N_ELEMENTS(modes); m++) {
    g_auto(tc_frame) wanted = {0}, frame = {0};
    double worst = 0, start = now_ms();
    scene.mode = modes[m];
    assert_true(draws_itself(patient, volume, &scene, false, &wanted));
    double waited = now_ms();
    assert_false(draws_itself(r, volume, &scene, true, &frame));
    double hurried = now_ms();
    for (int i = 0; i < SIDE * SIDE * 4; i++) worst = fmax(worst, fabs((double)frame.linear[i] - wanted.linear[i]));
    assert_true(worst <= 1.0 / 255);
    while (!draws_itself(r, volume, &scene, true, &frame) && now_ms() < hurried + 60000)
      nanosleep(&(struct timespec){.tv_nsec = 2000000}, NULL);
    assert_false(frame.stats.stand_in);
    printf("  %s: waits %.0f ms, stands in %.0f ms, off by %.1e; then %.0f ms\n", tc_mode_names[modes[m]],
           waited - start, hurried - waited, worst, frame.stats.render_ms);
    assert_memory_equal(frame.linear, wanted.linear, SIDE * SIDE * 16);
    scene.camera.position[0] += 1;
    assert_true(draws_itself(r, volume, &scene, true, &frame));
  }
  /* One that waits takes what is being compiled; a renderer may end, and a volume go, in the middle of it. */
  g_auto(tc_frame) frame = {0};
  scene.mode = TC_MODE_AVERAGE;
  assert_false(draws_itself(r, volume, &scene, true, &frame));
  assert_true(draws_itself(r, volume, &scene, false, &frame));
  scene.mode = TC_MODE_MINIP;
  assert_false(draws_itself(r, volume, &scene, true, &frame));
  tc_renderer_forget(r, volume);
  assert_true(draws_itself(r, volume, &scene, true, &frame));
  scene.filter = TC_FILTER_NEAREST;
  assert_false(draws_itself(r, volume, &scene, true, &frame));
  tc_renderer_free(r);
  assert_true(draws_itself(patient, volume, &scene, false, &frame));
  tc_renderer_free(patient);
}

/* Neither does the first upload of a large volume; one that cannot be uploaded is refused at once. */
TEST(test_hurried_upload) {
  needs(have_gl);
  enum { SIDE = 64 };
  tc_volume *small = waves(TC_U16, 32, 17), *large = waves(TC_U16, 170, 50), *other = waves(TC_U16, 170, 40);
  const test_grid too_long = {.dims = {70000, 70, 2}, .type = TC_U16, .slope = 1};
  const double zero = 0;
  g_autoptr(tc_volume) impossible = test_volume(&too_long, test_constant, &zero);
  tc_renderer *r = new_gl(0), *patient = new_gl(0);
  g_auto(tc_frame) wanted = {0}, frame = {0};
  g_auto(tc_scene) scene;
  set_scene(&scene, small, SIDE);
  assert_true(draws_itself(r, small, &scene, false, &frame)); /* the program is there from now on */
  test_scene_frame(&scene, large, TC_PERSPECTIVE, oblique);
  assert_true(draws_itself(patient, large, &scene, false, &wanted));
  double worst = 0, start = now_ms();
  assert_false(draws_itself(r, large, &scene, true, &frame));
  double hurried = now_ms();
  for (int i = 0; i < SIDE * SIDE * 4; i++) worst = fmax(worst, fabs((double)frame.linear[i] - wanted.linear[i]));
  while (!draws_itself(r, large, &scene, true, &frame) && now_ms() < hurried + 60000)
    nanosleep(&(struct timespec){.tv_nsec = 2000000}, NULL);
  printf("  stands in %.0f ms, off by %.1e; the volume is there after %.0f ms\n", hurried - start, worst,
         now_ms() - hurried - frame.stats.render_ms);
  assert_true(worst <= 1.0 / 255 && !frame.stats.stand_in);
  assert_memory_equal(frame.linear, wanted.linear, SIDE * SIDE * 16);
  assert_true(draws_itself(r, large, &scene, true, &frame));
  const tc_render_request request = {.hurry = true};
  assert_false(tc_render(r, impossible, &scene, &request, &frame, &error));
  expect_error(TC_ERROR_LIMIT, "--backend cpu");
  /* A volume may go, and a renderer end, in the middle of it. */
  assert_false(draws_itself(r, other, &scene, true, &frame));
  tc_renderer_forget(r, other);
  assert_false(draws_itself(r, other, &scene, true, &frame));
  tc_volume_unref(other);
  tc_renderer_free(r);
  tc_renderer_free(patient);
  tc_volume_unref(small), tc_volume_unref(large);
}

/* ---- memory ---- */

TEST(test_limits) {
  needs(have_gl);
  const int sizes[][3] = {
      {70000, 2, 1}, {1, 70000, 3}, {1, 16000, 4097}}; /* sides, and an atlas beyond any texture's */
  const double zero = 0;
  g_autoptr(tc_renderer) r = new_gl(0);
  for (size_t i = 0; i < G_N_ELEMENTS(sizes); i++) {
    test_grid grid = {.type = TC_U8};
    memcpy(grid.dims, sizes[i], sizeof grid.dims);
    g_autoptr(tc_volume) volume = test_volume(&grid, test_constant, &zero);
    g_auto(tc_scene) scene;
    g_auto(tc_frame) frame = {0};
    set_scene(&scene, volume, 16);
    assert_false(tc_render(r, volume, &scene, NULL, &frame, &error));
    expect_error(TC_ERROR_LIMIT, "--backend cpu");
  }
  /* The renderer still works. */
  g_autoptr(tc_volume) small = waves(TC_U8, 24, 11);
  g_auto(tc_frame) frame = {0};
  render_first(r, small, 40, &frame);
}

/* More volumes than are kept, with a budget for all and for one; each always shows itself. */
TEST(test_eviction) {
  needs(have_gl);
  enum { COUNT = 11 };
  for (int tight = 0; tight < 2; tight++) {
    g_autoptr(tc_renderer) r = new_gl(tight ? 1 : 0);
    tc_volume *volumes[COUNT];
    tc_frame frames[COUNT];
    for (int i = 0; i < COUNT; i++) {
      volumes[i] = waves(TC_U8, 16, 5 + i);
      render_first(r, volumes[i], 48, &frames[i]);
      if (i > 0) assert_memory_not_equal(frames[i].rgba, frames[i - 1].rgba, 48 * 48 * 4);
    }
    for (int round = 0; round < 3; round++)
      for (int i = 0; i < COUNT; i++) {
        int pick = (i * 7 + round) % COUNT;
        expect_same(r, volumes[pick], &frames[pick]);
        if (i == round) tc_renderer_forget(r, volumes[pick]);
      }
    for (int i = 0; i < COUNT; i++) {
      tc_frame_finish(&frames[i]);
      tc_volume_unref(volumes[i]);
    }
  }
}

int main(void) {
  setenv("MESA_SHADER_CACHE_DISABLE", "true", 1); /* its key misses some of Mesa's own settings */
  return run_all_tests(set_up, NULL);
}
