#include "tests/support/test.h"
#include "tests/support/renderers.h"

#include "renderer/gl/device.h"
#include "renderer/reference/reference.h"

const char *const test_names[RENDERERS] = {"scalar", "avx2", "avx512", "gl"};
tc_renderer *test_renderers[RENDERERS];
tc_frame test_frames[RENDERERS];

int test_renderers_open(void **state) {
  (void)state;
  tc_gl_report report;
  for (int i = 0; i < RENDERERS; i++) {
    GError *error = NULL;
    tc_renderer_options options = {.backend = i == GL ? TC_BACKEND_GL : TC_BACKEND_CPU, .threads = 2};
    if (i != GL) options.isa = test_names[i];
    if (i != GL || tc_gl_report_read(&report, &error)) test_renderers[i] = tc_renderer_new(&options, &error);
    if (!test_renderers[i]) printf("  %s: not checked: %s\n", test_names[i], error->message);
    g_clear_error(&error);
  }
  return !test_renderers[SCALAR];
}

int test_renderers_close(void **state) {
  (void)state;
  for (int i = 0; i < RENDERERS; i++) {
    tc_frame_finish(&test_frames[i]);
    tc_renderer_free(test_renderers[i]);
    test_renderers[i] = NULL;
  }
  return 0;
}

int test_widest(void) {
  int i = GL - 1;
  while (i > SCALAR && !test_renderers[i]) i--;
  return i;
}

tc_frame *test_draw(int which, tc_volume *volume, const tc_scene *scene, const tc_render_request *request,
                    tc_explanation *plan) {
  tc_render_request asked = request ? *request : (tc_render_request){.want_linear = true};
  GError *error = NULL;
  asked.explanation = plan;
  if (!tc_render(test_renderers[which], volume, scene, &asked, &test_frames[which], &error))
    fail_msg("%s: %s", test_names[which], error->message);
  return &test_frames[which];
}

int test_resumes(int which, tc_volume *volume, const tc_scene *scene) {
  tc_frame frame = {0};
  tc_interrupt interrupt;
  GError *error = NULL;
  int pauses = 0;
  tc_interrupt_init(&interrupt);
  atomic_store(&interrupt.pause_us, 1); /* in the past */
  const tc_render_request request = {.interrupt = &interrupt, .resume = true};
  while (!tc_render(test_renderers[which], volume, scene, &request, &frame, &error) && pauses++ < 2000) {
    assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_PAUSED));
    g_clear_error(&error);
  }
  assert_true(pauses < 2000 && !frame.stats.stand_in);
  const tc_frame *whole = test_draw(which, volume, scene, NULL, NULL);
  assert_memory_equal(frame.rgba, whole->rgba, 4 * (size_t)frame.width * (size_t)frame.height);
  tc_frame_finish(&frame);
  return pauses;
}

float *test_reference(tc_volume *volume, const tc_scene *scene, double tolerance) {
  GError *error = NULL;
  int width = scene->image.width, height = scene->image.height;
  tc_reference *reference = tc_reference_new(volume, scene, width, height, tolerance, &error);
  float *rgba = g_new(float, 4 * (size_t)width * (size_t)height);
  if (!reference || !tc_reference_image(reference, 2, rgba, &error)) fail_msg("reference: %s", error->message);
  tc_reference_free(reference);
  return rgba;
}
