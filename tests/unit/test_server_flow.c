/* The pure decisions of streaming: credit window, quality ladder, what a viewer still needs. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "server/schedule/ladder.h"
#include "server/session/watcher.h"
#include "server/session/window.h"

static void test_window_counts(void **state) {
  tcs_window window;
  tcs_window_init(&window, 2);
  assert_true(tcs_window_open(&window, 0));
  assert_int_equal(tcs_window_send(&window, 10), 1);
  assert_true(tcs_window_open(&window, 20));
  assert_int_equal(tcs_window_send(&window, 20), 2);
  assert_false(tcs_window_open(&window, 30));
  assert_true(tcs_window_ack(&window, 1, 40));
  assert_int_equal(tcs_window_pending(&window), 1);
  assert_true(tcs_window_open(&window, 50));
  assert_true(tcs_window_ack(&window, 2, 60));
  assert_int_equal(tcs_window_pending(&window), 0);
}

static void test_window_acks_are_cumulative_and_never_go_back(void **state) {
  tcs_window window;
  tcs_window_init(&window, 3);
  for (int i = 0; i < 3; i++)
    tcs_window_send(&window, i);
  assert_true(tcs_window_ack(&window, 3, 9));
  assert_true(tcs_window_ack(&window, 1, 9)); /* late */
  assert_true(tcs_window_ack(&window, 0, 9));
  assert_int_equal(tcs_window_pending(&window), 0);
  assert_false(tcs_window_ack(&window, 4, 9)); /* never sent */
  assert_false(tcs_window_ack(&window, UINT64_MAX, 9));
  assert_int_equal(tcs_window_pending(&window), 0);
}

static void test_window_stalls_and_wakes(void **state) {
  tcs_window window;
  tcs_window_init(&window, 2);
  tcs_window_send(&window, 1000);
  assert_true(tcs_window_open(&window, 1000 + TCS_WINDOW_STALL_US - 1));
  assert_false(tcs_window_open(&window, 1000 + TCS_WINDOW_STALL_US));
  tcs_window_ack(&window, 1, 9000000);
  assert_true(tcs_window_open(&window, 99000000)); /* nothing under way: nobody owes an answer */
}

static void test_window_of_zero_is_one(void **state) {
  tcs_window window;
  tcs_window_init(&window, 0);
  assert_true(tcs_window_open(&window, 0));
  tcs_window_send(&window, 0);
  assert_false(tcs_window_open(&window, 0));
}

static void test_ladder_keeps_full_size_when_it_fits(void **state) {
  tcs_ladder ladder = {0};
  assert_true(tcs_ladder_scale(&ladder, 1e6, TCS_LADDER_TARGET_MS) == 1.0); /* nothing measured yet */
  tcs_ladder_measure(&ladder, 1e6, 20);
  assert_true(tcs_ladder_scale(&ladder, 1e6, TCS_LADDER_TARGET_MS) == 1.0);
}

static void test_ladder_steps_down_at_once_and_has_a_floor(void **state) {
  tcs_ladder ladder = {0};
  tcs_ladder_measure(&ladder, 1e6, 100); /* at half the sides: 25 ms */
  assert_true(tcs_ladder_scale(&ladder, 1e6, TCS_LADDER_TARGET_MS) == 0.5);
  tcs_ladder_measure(&ladder, 2.5e5, 60000);
  assert_true(tcs_ladder_scale(&ladder, 1e6, TCS_LADDER_TARGET_MS) == 0.25);
}

static void test_ladder_does_not_swing(void **state) {
  tcs_ladder ladder = {0};
  tcs_ladder_measure(&ladder, 1e6, 34); /* just too slow */
  assert_true(tcs_ladder_scale(&ladder, 1e6, TCS_LADDER_TARGET_MS) == 0.75);
  for (int i = 0; i < 50; i++) { /* just fast enough: not with a margin */
    tcs_ladder_measure(&ladder, 1e6, 32);
    assert_true(tcs_ladder_scale(&ladder, 1e6, TCS_LADDER_TARGET_MS) == 0.75);
  }
  for (int i = 0; i < 50; i++)
    tcs_ladder_measure(&ladder, 1e6, 10);
  assert_true(tcs_ladder_scale(&ladder, 1e6, TCS_LADDER_TARGET_MS) == 1.0);
}

static void test_ladder_keeps_the_time_it_is_given(void **state) {
  tcs_ladder ladder = {0};
  tcs_ladder_measure(&ladder, 1e6, 20);
  assert_true(tcs_ladder_scale(&ladder, 1e6, TCS_LADDER_TARGET_MS) == 1.0);
  assert_true(tcs_ladder_scale(&ladder, 1e6, 12) == 0.75); /* 11.25 ms */
  assert_true(tcs_ladder_scale(&ladder, 1e6, 2) == 0.25);
}

static void test_ladder_ignores_nonsense(void **state) {
  tcs_ladder ladder = {0};
  tcs_ladder_measure(&ladder, 0, 5);
  tcs_ladder_measure(&ladder, -3, 5);
  tcs_ladder_measure(&ladder, 100, -1);
  assert_true(ladder.ms_per_pixel == 0);
}

static void test_watcher_wants_what_is_new(void **state) {
  tcs_watcher watcher = {.shown_revision = 0};
  assert_true(tcs_watcher_wants(&watcher, 1, false));
  watcher.shown_revision = 5;
  assert_false(tcs_watcher_wants(&watcher, 4, true)); /* older */
  assert_false(tcs_watcher_wants(&watcher, 5, false));
  assert_true(tcs_watcher_wants(&watcher, 5, true)); /* the same, refined */
  watcher.shown_final = true;
  assert_false(tcs_watcher_wants(&watcher, 5, true));
  assert_true(tcs_watcher_wants(&watcher, 6, false));
}

static void test_watcher_seq_is_what_the_picture_shows(void **state) {
  const tcs_mark marks[] = {{7, 3}, {9, 40}};
  tcs_picture picture = {.revision = 10, .marks = g_array_new(FALSE, FALSE, sizeof(tcs_mark))};
  g_array_append_vals(picture.marks, marks, 2);
  const tcs_watcher early = {.id = 7, .seq = 5}, late = {.id = 11, .seq = 2};
  assert_int_equal(tcs_watcher_seq_in(&early, &picture, 12), 3); /* its patches 4 and 5 came after */
  assert_int_equal(tcs_watcher_seq_in(&early, &picture, 10), 5); /* nothing came after */
  assert_int_equal(tcs_watcher_seq_in(&late, &picture, 12), 0);  /* joined after the picture was begun */
  g_array_unref(picture.marks);
}

static void test_watcher_wants_an_error_once(void **state) {
  const tcs_watcher_ops stream = {.headers = true}, mjpeg = {.headers = false};
  tcs_watcher watcher = {.ops = &stream, .shown_revision = 5, .shown_final = true};
  tcs_picture picture = {.revision = 5, .final = true};
  assert_false(tcs_watcher_wants_error(&watcher, &picture)); /* not known */
  picture.header.has_error = true;
  assert_true(tcs_watcher_wants_error(&watcher, &picture));
  watcher.ops = &mjpeg;
  assert_false(tcs_watcher_wants_error(&watcher, &picture)); /* nobody would read it */
  watcher.ops = &stream;
  watcher.shown_error = true;
  assert_false(tcs_watcher_wants_error(&watcher, &picture));
  watcher.shown_error = false;
  watcher.shown_revision = 4;
  assert_false(tcs_watcher_wants_error(&watcher, &picture)); /* wants the picture first */
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_window_counts),
      cmocka_unit_test(test_window_acks_are_cumulative_and_never_go_back),
      cmocka_unit_test(test_window_stalls_and_wakes),
      cmocka_unit_test(test_window_of_zero_is_one),
      cmocka_unit_test(test_ladder_keeps_full_size_when_it_fits),
      cmocka_unit_test(test_ladder_steps_down_at_once_and_has_a_floor),
      cmocka_unit_test(test_ladder_does_not_swing),
      cmocka_unit_test(test_ladder_keeps_the_time_it_is_given),
      cmocka_unit_test(test_ladder_ignores_nonsense),
      cmocka_unit_test(test_watcher_wants_what_is_new),
      cmocka_unit_test(test_watcher_wants_an_error_once),
      cmocka_unit_test(test_watcher_seq_is_what_the_picture_shows),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
