/* Scenes as plain values: defaults, copies and presets. */
#include "tests/support/test.h"
#include <float.h>
#include <pthread.h>

#include <glib.h>

#include "renderer/scene/scene.h"
#include "tests/support/scoped.h"

TEST(defaults) {
  tc_scene s;
  memset(&s, 0xa5, sizeof s);
  tc_scene_init(&s);
  assert_int_equal(s.image.width, 512);
  assert_int_equal(s.image.height, 512);
  assert_int_equal(s.image.quality, 85);
  assert_int_equal(s.image.format, TC_FORMAT_JPEG);
  assert_float_equal(s.camera.fov_y_deg, 30, 0);
  assert_int_equal(s.classification, TC_PREINTEGRATED);
  assert_float_equal(s.sampling.step, 1, 0);
  assert_float_equal(s.sampling.termination, 0.001, 0);
  assert_true(s.shading.light_at_camera);
  assert_true(s.transfer_function.count >= 1);
  assert_float_equal(s.quality.max_error + s.quality.max_ms, 0, 0);
  tc_scene_clear(&s);
  assert_null(s.transfer_function.points);
  tc_scene_clear(&s); /* twice is fine */
}

TEST(copies_own_their_lists) {
  tc_scene from, to;
  tc_scene_init(&from);
  from.labels.colors = g_new0(tc_label_color, 2);
  from.labels.n_colors = 2;
  from.labels.colors[1].label = 9;
  from.labels.visible = g_new0(uint32_t, 1);
  from.labels.n_visible = 1;
  tc_scene_copy(&to, &from);
  assert_ptr_not_equal(to.transfer_function.points, from.transfer_function.points);
  from.transfer_function.points[0].value = 77;
  from.labels.colors[1].label = 8;
  assert_true(to.transfer_function.points[0].value != 77);
  assert_int_equal(to.labels.colors[1].label, 9);
  tc_scene_clear(&from);
  assert_int_equal(to.labels.visible[0], 0);
  tc_scene_clear(&to);
}

/* Copies of a scene that shares its lists hold the same ones; replacing one in a copy leaves the others as they are. */
TEST(shared_lists_are_held_by_reference) {
  enum { KNOTS = 60000 };
  tc_scene first, second, third;
  tc_scene_init(&first);
  tc_scene_set_points(&first, g_new0(tc_knot, KNOTS), KNOTS);
  tc_scene_set_visible(&first, g_new0(uint32_t, 1), 0); /* none visible */
  first.transfer_function.points[KNOTS - 1].value = 5;
  tc_scene_share(&first);
  tc_scene_copy(&second, &first);
  tc_scene_copy(&third, &second);
  assert_ptr_equal(second.transfer_function.points, first.transfer_function.points);
  assert_ptr_equal(third.transfer_function.points, first.transfer_function.points);
  assert_non_null(third.labels.visible);
  tc_scene_clear(&first); /* the others go on */
  assert_float_equal(third.transfer_function.points[KNOTS - 1].value, 5, 0);
  tc_scene_set_points(&third, g_new0(tc_knot, 3), 3);
  assert_int_equal(second.transfer_function.count, KNOTS);
  assert_float_equal(second.transfer_function.points[KNOTS - 1].value, 5, 0);
  tc_scene_take_points(&third, &second);
  assert_ptr_equal(third.transfer_function.points, second.transfer_function.points);
  assert_true(tc_transfer_function_set_preset(&second.transfer_function, "ct-bone", 0, 1));
  assert_float_equal(third.transfer_function.points[KNOTS - 1].value, 5, 0);
  tc_scene_clear(&second);
  tc_scene_clear(&third);
}

TEST(digests_tell_lists_apart) {
  tc_scene a, b;
  tc_scene_init(&a);
  tc_scene_copy(&b, &a); /* a copy: a shares nothing */
  tc_scene_share(&a);
  assert_ptr_not_equal(a.transfer_function.shared, b.transfer_function.shared);
  const uint64_t digest = tc_shared_digest(a.transfer_function.shared);
  assert_true(digest != 0 && digest == tc_shared_digest(b.transfer_function.shared));
  tc_scene_clear(&b);
  tc_scene_init(&b);
  b.transfer_function.points[0].color[2] += 1e-9;
  tc_scene_share(&b);
  assert_true(digest != tc_shared_digest(b.transfer_function.shared));
  assert_int_equal(tc_shared_digest(NULL), 0);
  tc_scene_clear(&a);
  tc_scene_clear(&b);
}

/* Jobs carry scenes to other threads. */
static void *copy_and_clear(void *user) {
  for (int i = 0; i < 20000; i++) {
    g_auto(tc_scene) copy;
    tc_scene_copy(&copy, user);
  }
  tc_scene_clear(user);
  return NULL;
}

TEST(threads_share_lists) {
  enum { THREADS = 4 };
  tc_scene scene, copies[THREADS];
  pthread_t threads[THREADS];
  tc_scene_init(&scene);
  tc_scene_share(&scene);
  for (int i = 0; i < THREADS; i++) {
    tc_scene_copy(&copies[i], &scene);
    assert_int_equal(pthread_create(&threads[i], NULL, copy_and_clear, &copies[i]), 0);
  }
  tc_scene_clear(&scene);
  for (int i = 0; i < THREADS; i++) pthread_join(threads[i], NULL);
}

/* A preset is a valid transfer function: knots ascend, colours and opacities are 0..1, the name fits. */
TEST(presets_are_valid) {
  size_t count;
  const tc_preset *p = tc_presets(&count);
  assert_true(count >= 9);
  for (size_t i = 0; i < count; i++, p++) {
    assert_true(p->count >= 1 && p->unit_distance_mm > 0);
    assert_true(strlen(p->name) < sizeof((tc_scene *)0)->transfer_function.preset);
    for (size_t k = 0; k < p->count; k++) {
      if (k && p->points[k].value < p->points[k - 1].value) fail_msg("%s: knot %zu descends", p->name, k);
      if (p->relative) assert_true(p->points[k].value >= 0 && p->points[k].value <= 1);
      assert_true(p->points[k].amount >= 0 && p->points[k].amount <= 1);
      for (int c = 0; c < 3; c++)
        assert_true(p->points[k].color[c] >= 0 && p->points[k].color[c] <= 1);
    }
    /* something is seen, and something is not */
    double least = 1, most = 0;
    for (size_t k = 0; k < p->count; k++)
      least = MIN(least, p->points[k].amount), most = MAX(most, p->points[k].amount);
    if (least != 0 || most == 0) fail_msg("%s shows everything or nothing", p->name);
  }
}

TEST(names_are_unique) {
  size_t count, windows;
  const tc_preset *p = tc_presets(&count);
  const tc_window_preset *w = tc_window_presets(&windows);
  for (size_t i = 0; i < count; i++)
    for (size_t k = 0; k < i; k++)
      assert_string_not_equal(p[i].name, p[k].name);
  for (size_t i = 0; i < windows; i++) {
    assert_true(w[i].width > 0);
    for (size_t k = 0; k < i; k++)
      assert_string_not_equal(w[i].name, w[k].name);
  }
}

TEST(relative_presets_scale) {
  tc_transfer_function tf = {0};
  assert_true(tc_transfer_function_set_preset(&tf, "surface", -1000, 3000));
  assert_string_equal(tf.preset, "surface");
  assert_float_equal(tf.points[0].value, -1000, 0);
  assert_float_equal(tf.points[tf.count - 1].value, 3000, 0);
  assert_true(tc_transfer_function_set_preset(&tf, "grey-ramp", -DBL_MAX, DBL_MAX));
  for (size_t i = 0; i < tf.count; i++)
    assert_true(tf.points[i].value >= -DBL_MAX && tf.points[i].value <= DBL_MAX);
  assert_true(tc_transfer_function_set_preset(&tf, "ct-bone", 5, 6)); /* absolute: the range is of no matter */
  assert_float_equal(tf.points[tf.count - 1].value, 3071, 0);
  const tc_knot *before = tf.points;
  assert_false(tc_transfer_function_set_preset(&tf, "no-such", 0, 1));
  assert_ptr_equal(tf.points, before);
  assert_string_equal(tf.preset, "ct-bone");
  g_free(tf.points);
}

TESTS(NULL, NULL)
