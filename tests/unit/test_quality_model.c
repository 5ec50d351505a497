/* Quality control without pictures: what is chosen from views that are given, and from frames whose time is known. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "renderer/quality/cost.h"
#include "renderer/quality/quality.h"

static tc_scene scene;
static tc_quality_choice choice;

static int set_up(void **state) {
  tc_scene_init(&scene);
  scene.camera = (tc_camera){TC_PERSPECTIVE, {0, -100, 0}, {0, 0, 0}, {0, 0, 1}, 30, 50};
  scene.quality.max_error = 0.01;
  return 0;
}

static int tear_down(void **state) {
  tc_scene_clear(&scene);
  return 0;
}

/* error = level * step^2 */
static tc_quality_view second_order(double level) {
  return (tc_quality_view){scene.camera, 1, level, 2, 0, 0.25, 2};
}

static void look_from(double azimuth, double distance) {
  scene.camera.position[0] = distance * sin(azimuth);
  scene.camera.position[1] = -distance * cos(azimuth);
}

static void careful_before_anything_is_measured(void **state) {
  tc_quality_model model = {0};
  tc_camera wanted;
  tc_quality_choose(&model, &scene, &choice);
  assert_true(choice.step <= 0.25 && !choice.holds && choice.rms == 0);
  assert_non_null(strstr(choice.reason, "nothing is measured"));
  assert_true(tc_quality_wants(&model, &scene, &wanted));
  assert_memory_equal(wanted.position, scene.camera.position, sizeof wanted.position); /* its own first */
}

static void the_step_follows_bound_and_order(void **state) {
  tc_quality_model model = {0};
  tc_quality_view view = second_order(0.01);
  tc_quality_add(&model, &view);
  tc_quality_choose(&model, &scene, &choice);
  double near = choice.step;
  assert_true(choice.holds && choice.near && near < 1 && near > 0.85); /* a margin, and no more */
  assert_true(choice.rms <= 0.01 && choice.rms > 0.008);
  scene.quality.max_error = 0.0025;
  tc_quality_choose(&model, &scene, &choice);
  assert_float_equal(choice.step, near / 2, 1e-9); /* second order */
  assert_float_equal(choice.termination, 0.0025 / 16, 1e-12);
  scene.quality.max_error = 0.01;
  view.spread = 0.2; /* trials that scatter: more margin */
  model.views[0] = view;
  tc_quality_choose(&model, &scene, &choice);
  assert_true(choice.step < near);
}

static void far_views_are_taken_at_their_worst(void **state) {
  tc_quality_model model = {0};
  tc_quality_view easy = second_order(0.005), hard;
  tc_camera wanted;
  tc_quality_add(&model, &easy);
  look_from(M_PI / 2, 100);
  hard = second_order(0.02);
  tc_quality_add(&model, &hard);
  look_from(0.1, 100);
  tc_quality_choose(&model, &scene, &choice);
  double by_easy = choice.step;
  assert_true(choice.near && choice.holds);
  look_from(M_PI, 100);
  tc_quality_choose(&model, &scene, &choice);
  assert_true(!choice.near && choice.holds && choice.step < by_easy / 2);
  assert_true(tc_quality_wants(&model, &scene, &wanted));
  look_from(0, 100);
  int more = 0;
  while (tc_quality_wants(&model, &scene, &wanted) && more++ < 10) {
    hard.camera = wanted;
    tc_quality_add(&model, &hard);
  }
  assert_int_equal(more, 4); /* six sides, two of them known */
}

static void a_floor_is_said(void **state) {
  tc_quality_model model = {0};
  tc_quality_view view = {scene.camera, 0.0625, 0.02, 0, 0, 0.0625, 0.1};
  tc_quality_add(&model, &view);
  tc_quality_choose(&model, &scene, &choice);
  assert_false(choice.holds);
  assert_non_null(strstr(choice.reason, "no step holds"));
}

static void cameras_differ_by_turn_scale_and_shift(void **state) {
  tc_camera a = scene.camera;
  assert_float_equal(tc_quality_distance(&a, &scene.camera), 0, 1e-7);
  look_from(0.3, 100);
  assert_float_equal(tc_quality_distance(&a, &scene.camera), 0.3, 1e-9);
  look_from(0, 150);
  assert_float_equal(tc_quality_distance(&a, &scene.camera), log(1.5), 1e-9);
  look_from(0, 100);
  scene.camera.target[2] += 10, scene.camera.position[2] += 10;
  assert_float_equal(tc_quality_distance(&a, &scene.camera), 10 / (100 * tan(15 * M_PI / 180)), 1e-9);
}

static void the_oldest_view_makes_room(void **state) {
  tc_quality_model model = {0};
  tc_quality_view view = second_order(0.01);
  for (int i = 0; i <= TC_QUALITY_VIEWS + 2; i++) {
    view.rms = i;
    tc_quality_add(&model, &view);
  }
  assert_int_equal(model.n, TC_QUALITY_VIEWS);
  assert_true(model.views[2].rms == TC_QUALITY_VIEWS + 2 && model.views[3].rms == 3);
}

static double truth(double pixels, double step) { return pixels * (2e-5 + 6e-5 / step); }

static void cost_is_learnt(void **state) {
  tc_quality_cost cost = {0};
  assert_true(tc_quality_cost_ms(&cost, 1e5, 1) == 0 && tc_quality_cost_step(&cost, 1e5, 10) == 1);
  tc_quality_cost_add(&cost, 1e5, 1, truth(1e5, 1));
  assert_float_equal(tc_quality_cost_ms(&cost, 2e5, 1), truth(2e5, 1), 1e-9); /* one frame is believed where it was */
  tc_quality_cost_add(&cost, 2e5, 0.5, truth(2e5, 0.5));
  for (int i = 0; i < 20; i++) tc_quality_cost_add(&cost, 1e5, i % 2 ? 0.5 : 2, truth(1e5, i % 2 ? 0.5 : 2));
  assert_float_equal(tc_quality_cost_ms(&cost, 3e5, 0.25), truth(3e5, 0.25), 0.05 * truth(3e5, 0.25));
  double step = tc_quality_cost_step(&cost, 1e5, 10);
  assert_true(truth(1e5, step) <= 10.3 && truth(1e5, step / 1.2) > 10); /* the finest in time */
  assert_true(tc_quality_cost_step(&cost, 1e5, 1e-3) == 4);
  assert_true(tc_quality_cost_step(&cost, 1e5, 1e6) == 0.125);
  for (int i = 0; i < 2; i++) tc_quality_cost_add(&cost, 1e5, 1, 5 * truth(1e5, 1)); /* the machine is busy now */
  assert_true(tc_quality_cost_ms(&cost, 1e5, 1) > 4 * truth(1e5, 1));
  tc_quality_cost before = cost;
  tc_quality_cost_add(&cost, 0, 1, 5);
  tc_quality_cost_add(&cost, 100, 0, 5);
  tc_quality_cost_add(&cost, 100, 1, NAN);
  assert_memory_equal(&before, &cost, sizeof cost);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup_teardown(careful_before_anything_is_measured, set_up, tear_down),
      cmocka_unit_test_setup_teardown(the_step_follows_bound_and_order, set_up, tear_down),
      cmocka_unit_test_setup_teardown(far_views_are_taken_at_their_worst, set_up, tear_down),
      cmocka_unit_test_setup_teardown(a_floor_is_said, set_up, tear_down),
      cmocka_unit_test_setup_teardown(cameras_differ_by_turn_scale_and_shift, set_up, tear_down),
      cmocka_unit_test_setup_teardown(the_oldest_view_makes_room, set_up, tear_down),
      cmocka_unit_test_setup_teardown(cost_is_learnt, set_up, tear_down)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
