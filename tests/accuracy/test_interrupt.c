/* Frames that are cut: resumed ones are the uncut ones to the last bit. The estimate of a frame's samples holds from above. */
#include "tests/support/subject.h"
#include <limits.h>

#include "renderer/frame/frame.h"

static void same_pictures(const tc_frame *a, const tc_frame *b, const subject *s, const char *where) {
  size_t pixels = (size_t)a->width * (size_t)a->height;
  bool same = memcmp(a->rgba, b->rgba, pixels * 4) == 0;
  if (s->request.want_linear) same = same && memcmp(a->linear, b->linear, pixels * 4 * sizeof(float)) == 0;
  if (s->request.want_depth && s->drawn.scene.mode == TC_MODE_ISOSURFACE)
    same = same && memcmp(a->depth, b->depth, pixels * sizeof(float)) == 0;
  if (!same) fail_msg("%s, case %llu: not the same picture", where, (unsigned long long)s->drawn.seed);
}

/* Every call comes when its pause is over already: it does the least that a call does. Returns how many calls. */
static int draw_in_parts(int which, subject *s, tc_frame *frame) {
  tc_interrupt interrupt;
  tc_interrupt_init(&interrupt);
  atomic_store(&interrupt.pause_us, 0);
  tc_render_request request = s->request;
  request.interrupt = &interrupt;
  for (int calls = 1;; calls++) {
    GError *error = NULL;
    double before = tc_frame_done(frame);
    if (tc_render(test_renderers[which], s->volume, &s->drawn.scene, &request, frame, &error)) return calls;
    if (!g_error_matches(error, TC_ERROR, TC_ERROR_PAUSED))
      fail_msg("%s, case %llu: %s", test_names[which], (unsigned long long)s->drawn.seed, error->message);
    assert_true(calls < 100000 && tc_frame_done(frame) >= (request.resume ? before : 0));
    g_clear_error(&error);
    request.resume = true;
  }
}

TEST(resumed_is_uncut) {
  int cut[RENDERERS] = {0}, calls[RENDERERS] = {0};
  g_auto(tc_frame) parts = {0};
  for (uint64_t seed = 1; seed <= CASES; seed++) {
    subject s;
    if (!subject_open(&s, seed * 7)) continue;
    EACH_RENDERER(i) {
      GError *error = NULL;
      if (i == GL && seed % 10) continue; /* it compiles */
      if (!tc_render(test_renderers[i], s.volume, &s.drawn.scene, &s.request, &test_frames[i], &error)) {
        g_clear_error(&error);
        continue;
      }
      int n = draw_in_parts(i, &s, &parts);
      calls[i] += n;
      cut[i] += n > 1;
      /* On a busy machine gl may have measured itself too slow to be stopped in time; the cpu drew the parts then. */
      if (parts.stats.stand_in != test_frames[i].stats.stand_in) continue;
      same_pictures(&test_frames[i], &parts, &s, test_names[i]);
      assert_true(parts.stats.rays >= test_frames[i].stats.rays); /* a ray that was left counts again */
      assert_true(parts.stats.samples >= test_frames[i].stats.samples);
    }
    subject_close(&s);
  }
  EACH_RENDERER(i) {
    printf("  %-6s %d pictures were cut, drawn by %d calls in all\n", test_names[i], cut[i], calls[i]);
    if (i != GL) assert_true(cut[i] > CASES / 2);
  }
}

/* In parts as well, a preparation draws nothing, and the frame after it builds nothing; the picture is the same. */
TEST(a_prepared_frame_builds_nothing) {
  int prepared = 0;
  for (uint64_t seed = 1; seed <= 60; seed += STRIDE(5)) {
    subject s;
    if (!subject_open(&s, seed * 7)) continue;
    g_auto(tc_frame) unprepared = {0}, frame = {0};
    if (tc_render(test_renderers[SCALAR], s.volume, &s.drawn.scene, &s.request, &unprepared, NULL)) {
      const bool built = unprepared.stats.tables_ms + unprepared.stats.skip_ms > 0;
      tc_renderer_forget(test_renderers[SCALAR], s.volume);
      s.request.prepare = true;
      draw_in_parts(SCALAR, &s, &frame);
      assert_true(frame.stats.rays == 0 && frame.stats.samples == 0);
      s.request.prepare = false;
      assert_true(tc_render(test_renderers[SCALAR], s.volume, &s.drawn.scene, &s.request, &frame, NULL));
      assert_true(frame.stats.tables_ms + frame.stats.skip_ms + frame.stats.coefficients_ms == 0);
      same_pictures(&unprepared, &frame, &s, "prepared");
      prepared += built;
    }
    subject_close(&s);
  }
  assert_true(prepared > 3);
}

/* A frame of another size, or one that was not paused, is begun anew. */
TEST(only_what_was_paused_is_resumed) {
  subject s;
  tc_frame frame = {0};
  assert_true(subject_open(&s, 3));
  s.request.resume = true;
  assert_true(tc_render(test_renderers[SCALAR], s.volume, &s.drawn.scene, &s.request, &frame, NULL));
  uint64_t rays = frame.stats.rays;
  assert_true(tc_render(test_renderers[SCALAR], s.volume, &s.drawn.scene, &s.request, &frame, NULL));
  assert_true(frame.stats.rays == rays);
  tc_interrupt interrupt;
  tc_interrupt_init(&interrupt);
  atomic_store(&interrupt.pause_us, 0);
  s.request.interrupt = &interrupt;
  assert_false(tc_render(test_renderers[SCALAR], s.volume, &s.drawn.scene, &s.request, &frame, NULL));
  assert_true(tc_frame_done(&frame) > 0 && tc_frame_done(&frame) < 1);
  s.request.interrupt = NULL;
  s.request.width = 16, s.request.height = 16;
  assert_true(tc_render(test_renderers[SCALAR], s.volume, &s.drawn.scene, &s.request, &frame, NULL));
  assert_int_equal(frame.width, 16);
  assert_true(tc_frame_done(&frame) == 0);
  tc_frame_finish(&frame);
  subject_close(&s);
}

/* From above, and not far: with nothing skipped and no ray ended early. */
TEST(estimate_holds) {
  double least = INFINITY, log_sum = 0;
  int n = 0;
  for (uint64_t seed = 1; seed <= 10 * CASES; seed++) {
    subject s;
    if (!subject_open(&s, seed)) continue;
    if (s.drawn.scene.mode == TC_MODE_MESH || s.drawn.scene.mode == TC_MODE_SPLAT) { /* not estimated from above */
      subject_close(&s);
      continue;
    }
    s.drawn.scene.skipping.mode = TC_SKIPPING_OFF;
    s.drawn.scene.sampling.termination = 0;
    int width = s.drawn.scene.image.width, height = s.drawn.scene.image.height, which = test_widest();
    double longest, estimate = tc_estimate_samples(s.volume, &s.drawn.scene, NULL, width, height, &longest);
    if (tc_render(test_renderers[which], s.volume, &s.drawn.scene, &s.request, &test_frames[which], NULL)) {
      double taken = (double)test_frames[which].stats.samples;
      if (!(estimate >= taken)) test_case_print(&s.drawn);
      if (!(estimate >= taken)) fail_msg("case %llu: %g samples, %g expected", (unsigned long long)seed, taken, estimate);
      assert_true(longest <= estimate && longest * width * height * s.drawn.scene.sampling.rays_per_pixel >= taken);
      bool plain = s.drawn.scene.filter != TC_FILTER_CUBIC && !s.drawn.labels.on && !s.drawn.scene.shading.model;
      if (taken > 10000 && plain && s.drawn.scene.mode != TC_MODE_ISOSURFACE) { /* where it counts what samples are */
        least = fmin(least, taken / estimate);
        log_sum += log(taken / estimate);
        n++;
      }
    }
    subject_close(&s);
  }
  printf("  taken / expected: least %.3f, mean %.3f, of %d pictures\n", least, exp(log_sum / n), n);
  assert_true(n > CASES / 2 && exp(log_sum / n) > 0.3);
}

/* Surfaces in a volume are drawn in passes over the whole picture. Each call goes on where the one before was left: none is
 * fruitless, after which the next might keep others waiting for longer, but by chance. */
TEST(surfaces_within_are_resumed) {
  const tc_mesh_surface pane = {.source = TC_SURFACE_OF_VALUE, .opacity = 0.4, .visible = true, .two_sided = true};
  enum { PANES = 6 };
  subject s = {.volume = ramp_of(TC_U16, 40), .request.want_linear = true};
  tc_scene *scene = &s.drawn.scene;
  tc_frame whole = {0}, parts = {0};
  tc_interrupt interrupt;
  test_scene(scene, 120, 120);
  test_scene_frame(scene, s.volume, TC_PERSPECTIVE, (const double[3]){0.3, -1, 0.2});
  tc_mesh_surface *panes = g_new(tc_mesh_surface, PANES);
  for (int i = 0; i < PANES; i++) panes[i] = pane, panes[i].value = 65535 * (i + 1) / (PANES + 1);
  tc_scene_set_surfaces(scene, panes, PANES);
  scene->mesh.with_volume = true;
  scene->sampling.step = 0.02, scene->sampling.rays_per_pixel = 2, scene->sampling.termination = 0;
  assert_true(tc_render(test_renderers[SCALAR], s.volume, scene, &s.request, &whole, NULL));
  tc_interrupt_init(&interrupt);
  atomic_store(&interrupt.pause_us, 0);
  tc_render_request request = s.request;
  request.interrupt = &interrupt;
  int calls = 1, fruitless = 0;
  for (; !tc_render(test_renderers[SCALAR], s.volume, scene, &request, &parts, NULL); calls++) {
    assert_true(parts.progress->paused && calls < 10000);
    fruitless += parts.progress->fruitless;
    request.resume = true;
  }
  printf("  %d calls, %d of them fruitless\n", calls, fruitless);
  assert_true(calls > 10 && fruitless < calls / 10); /* a machine that does other things may take a call its time */
  same_pictures(&whole, &parts, &s, "surfaces in a volume");
  tc_frame_finish(&whole);
  tc_frame_finish(&parts);
  tc_scene_clear(scene);
  subject_close(&s);
}

/* A tile of millions of translucent layers: each call goes on below the rows that were drawn before. */
TEST(deep_tiles_are_resumed) {
  enum { PANES = SANITIZED ? 120 : 250 };
  subject s = {.volume = ramp_of(TC_U16, 24), .request.want_linear = true};
  tc_scene *scene = &s.drawn.scene;
  tc_frame whole = {0}, parts = {0};
  tc_interrupt interrupt;
  deep_scene(&s, PANES, 16);
  assert_true(tc_render(test_renderers[SCALAR], s.volume, scene, &s.request, &whole, NULL));
  tc_interrupt_init(&interrupt);
  atomic_store(&interrupt.pause_us, 0);
  tc_render_request request = s.request;
  request.interrupt = &interrupt;
  int calls = 1, further = 0;
  for (double done = 0; !tc_render(test_renderers[SCALAR], s.volume, scene, &request, &parts, NULL); calls++) {
    assert_true(parts.progress->paused && calls < 10000 && tc_frame_done(&parts) >= done);
    further += tc_frame_done(&parts) > done;
    done = tc_frame_done(&parts);
    request.resume = true;
  }
  printf("  %d calls, %d of them came further in the one tile\n", calls, further);
  assert_true(further > 5);
  same_pictures(&whole, &parts, &s, "a deep tile");
  tc_frame_finish(&whole);
  tc_frame_finish(&parts);
  tc_scene_clear(scene);
  subject_close(&s);
}

int main(void) {
  setenv("MESA_SHADER_CACHE_DISABLE", "true", 1); /* what others compiled takes no time */
  return run_all_tests(test_renderers_open, test_renderers_close);
}
