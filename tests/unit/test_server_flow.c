/* The pure decisions of streaming: credit window, quality ladder, what a viewer still needs. */
#include "tests/support/test.h"

#include "server/schedule/ladder.h"
#include "server/session/credit.h"
#include "server/session/watcher.h"
#include "server/ws/allowance.h"

TEST(test_window_counts) {
  tcs_credit window;
  tcs_credit_init(&window, 2);
  assert_true(tcs_credit_open(&window, 0));
  assert_int_equal(tcs_credit_send(&window, 10), 1);
  assert_true(tcs_credit_open(&window, 20));
  assert_int_equal(tcs_credit_send(&window, 20), 2);
  assert_false(tcs_credit_open(&window, 30));
  assert_true(tcs_credit_ack(&window, 1, 40));
  assert_int_equal(tcs_credit_pending(&window), 1);
  assert_true(tcs_credit_open(&window, 50));
  assert_true(tcs_credit_ack(&window, 2, 60));
  assert_int_equal(tcs_credit_pending(&window), 0);
}

TEST(test_window_acks_are_cumulative_and_never_go_back) {
  tcs_credit window;
  tcs_credit_init(&window, 3);
  for (int i = 0; i < 3; i++)
    tcs_credit_send(&window, i);
  assert_true(tcs_credit_ack(&window, 3, 9));
  assert_true(tcs_credit_ack(&window, 1, 9)); /* late */
  assert_true(tcs_credit_ack(&window, 0, 9));
  assert_int_equal(tcs_credit_pending(&window), 0);
  assert_false(tcs_credit_ack(&window, 4, 9)); /* never sent */
  assert_false(tcs_credit_ack(&window, UINT64_MAX, 9));
  assert_int_equal(tcs_credit_pending(&window), 0);
}

TEST(test_window_stalls_and_wakes) {
  tcs_credit window;
  tcs_credit_init(&window, 2);
  tcs_credit_send(&window, 1000);
  assert_true(tcs_credit_open(&window, 1000 + TCS_CREDIT_STALL_US - 1));
  assert_false(tcs_credit_open(&window, 1000 + TCS_CREDIT_STALL_US));
  tcs_credit_ack(&window, 1, 9000000);
  assert_true(tcs_credit_open(&window, 99000000)); /* nothing under way: nobody owes an answer */
}

TEST(test_window_of_zero_is_one) {
  tcs_credit window;
  tcs_credit_init(&window, 0);
  assert_true(tcs_credit_open(&window, 0));
  tcs_credit_send(&window, 0);
  assert_false(tcs_credit_open(&window, 0));
}

/* Of a picture of a million pixels, a sample each. */
static double scale(tcs_ladder *ladder, double target_ms) { return tcs_ladder_pick(ladder, 1e6, 1e6, target_ms).scale; }

TEST(test_ladder_keeps_full_size_when_it_fits) {
  tcs_ladder ladder = {0};
  assert_true(scale(&ladder, TCS_LADDER_TARGET_MS) == 1.0); /* nothing measured yet */
  tcs_ladder_measure(&ladder, 1e6, 20);
  assert_true(scale(&ladder, TCS_LADDER_TARGET_MS) == 1.0);
}

TEST(test_ladder_steps_down_at_once) {
  tcs_ladder ladder = {0};
  tcs_ladder_measure(&ladder, 1e6, 100); /* at half the sides: 25 ms */
  assert_true(scale(&ladder, TCS_LADDER_TARGET_MS) == 0.5);
  tcs_ladder_measure(&ladder, 2.5e5, 100);
  assert_true(scale(&ladder, TCS_LADDER_TARGET_MS) == 0.25); /* 25 ms */
}

static double expected_ms(const tcs_ladder *ladder, tcs_rung rung) {
  return ladder->ms_per_sample * 1e6 * rung.scale * rung.scale / rung.coarser;
}

TEST(test_ladder_goes_on_below_the_smallest_picture) {
  tcs_ladder ladder = {0};
  for (double ms = 1000; ms < 400000; ms *= 1.5) {
    tcs_ladder_measure(&ladder, 1e6, ms);
    const tcs_rung rung = tcs_ladder_pick(&ladder, 1e6, 1e6, TCS_LADDER_TARGET_MS);
    assert_true(rung.scale <= 0.25 && expected_ms(&ladder, rung) <= TCS_LADDER_TARGET_MS);
  }
  tcs_ladder_measure(&ladder, 1e6, 1e9); /* the last rung is the last one */
  assert_true(tcs_ladder_pick(&ladder, 1e6, 1e6, TCS_LADDER_TARGET_MS).scale > 0);
}

/* The first frame of a session has nothing of its own to go by. */
TEST(test_ladder_starts_from_what_others_took) {
  tcs_ladder ladder = {0};
  tcs_ladder_expect(&ladder, 0); /* nobody rendered yet */
  assert_true(scale(&ladder, TCS_LADDER_TARGET_MS) == 1.0);
  tcs_ladder_expect(&ladder, 1e-4);
  assert_true(scale(&ladder, TCS_LADDER_TARGET_MS) == 0.5);
  tcs_ladder_measure(&ladder, 1e6, 20); /* its own frames are quicker, and count alone */
  tcs_ladder_expect(&ladder, 1e-3);
  assert_true(scale(&ladder, TCS_LADDER_TARGET_MS) == 1.0);
}

TEST(test_ladder_spares_the_encoder) {
  tcs_ladder ladder = {0};
  const tcs_rung rung = tcs_ladder_pick(&ladder, 1, 8192.0 * 2000, TCS_LADDER_TARGET_MS);
  assert_true(8192.0 * 2000 * rung.scale * rung.scale <= 4e6 && rung.coarser == 1);
}

TEST(test_coarser_is_fewer_rays_then_longer_steps) {
  tc_scene scene = {.mode = TC_MODE_DVR, .sampling = {.step = 0.5, .rays_per_pixel = 16}};
  tcs_rung_coarsen(4, &scene);
  assert_int_equal(scene.sampling.rays_per_pixel, 4);
  assert_true(scene.sampling.step ==
              2); /* rays of a pixel have their samples in turn: each ray's are as far apart as before */
  scene = (tc_scene){.mode = TC_MODE_MIP, .sampling = {.step = 0.5, .rays_per_pixel = 2}};
  tcs_rung_coarsen(8, &scene);
  assert_int_equal(scene.sampling.rays_per_pixel, 1);
  assert_true(scene.sampling.step == 2);
  scene = (tc_scene){.mode = TC_MODE_ISOSURFACE, .sampling = {.step = 0.5, .rays_per_pixel = 4}};
  tcs_rung_coarsen(16, &scene);
  assert_int_equal(scene.sampling.rays_per_pixel, 1);
  assert_true(scene.sampling.step == 0.5);
  tcs_rung_coarsen(1, &scene);
  assert_int_equal(scene.sampling.rays_per_pixel, 1);
}

TEST(test_ladder_does_not_swing) {
  tcs_ladder ladder = {0};
  tcs_ladder_measure(&ladder, 1e6, 34); /* just too slow */
  assert_true(scale(&ladder, TCS_LADDER_TARGET_MS) == 0.75);
  for (int i = 0; i < 50; i++) { /* just fast enough: not with a margin */
    tcs_ladder_measure(&ladder, 1e6, 32);
    assert_true(scale(&ladder, TCS_LADDER_TARGET_MS) == 0.75);
  }
  for (int i = 0; i < 50; i++)
    tcs_ladder_measure(&ladder, 1e6, 10);
  assert_true(scale(&ladder, TCS_LADDER_TARGET_MS) == 1.0);
}

/* A mesh has coarser levels of detail before it has fewer pixels, where they gain what is needed. */
TEST(test_ladder_takes_coarser_levels_first) {
  for (int pixels_take_it = 0; pixels_take_it < 2; pixels_take_it++) {
    tcs_ladder ladder = {.has_levels = true};
    int smaller = 0, coarser = 0;
    for (int i = 0; i < 60; i++) { /* 50 ms in full; 25 at the coarser levels, or no less */
      const tcs_rung rung = tcs_ladder_pick(&ladder, 1e6, 1e6, TCS_LADDER_TARGET_MS);
      const double area = rung.scale * rung.scale, ms = pixels_take_it ? 50 * area : rung.detail > 1 ? 25 * area : 50 * area;
      smaller += rung.scale < 1, coarser += rung.detail > 1 && rung.scale == 1;
      tcs_ladder_measure(&ladder, 1e6 * area, ms);
    }
    print_message("  %d frames with fewer pixels, %d with coarser levels alone\n", smaller, coarser);
    assert_true(pixels_take_it ? smaller >= 55 : smaller == 0 && coarser == 59);
  }
  tcs_ladder other = {0};
  tcs_ladder_measure(&other, 1e6, 40);
  assert_true(scale(&other, TCS_LADDER_TARGET_MS) == 0.75);
}

TEST(test_ladder_keeps_the_time_it_is_given) {
  tcs_ladder ladder = {0};
  tcs_ladder_measure(&ladder, 1e6, 20);
  assert_true(scale(&ladder, TCS_LADDER_TARGET_MS) == 1.0);
  assert_true(scale(&ladder, 12) == 0.75); /* 11.25 ms */
  assert_true(scale(&ladder, 2) == 0.25);
}

TEST(test_ladder_ignores_nonsense) {
  tcs_ladder ladder = {0};
  tcs_ladder_measure(&ladder, 0, 5);
  tcs_ladder_measure(&ladder, -3, 5);
  tcs_ladder_measure(&ladder, 100, -1);
  assert_true(ladder.ms_per_sample == 0);
}

TEST(test_watcher_wants_what_is_new) {
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

TEST(test_watcher_seq_is_what_the_picture_shows) {
  const tcs_mark marks[] = {{7, 3}, {9, 40}};
  tcs_picture picture = {.revision = 10, .marks = g_array_new(FALSE, FALSE, sizeof(tcs_mark))};
  g_array_append_vals(picture.marks, marks, 2);
  const tcs_watcher early = {.id = 7, .seq = 5}, late = {.id = 11, .seq = 2};
  assert_int_equal(tcs_watcher_seq_in(&early, &picture, 12), 3); /* its patches 4 and 5 came after */
  assert_int_equal(tcs_watcher_seq_in(&early, &picture, 10), 5); /* nothing came after */
  assert_int_equal(tcs_watcher_seq_in(&late, &picture, 12), 0);  /* joined after the picture was begun */
  g_array_unref(picture.marks);
}

TEST(test_watcher_wants_an_error_once) {
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

/* Dragged rays that came late, small and smaller, do not make the slices after them small. */
TEST(test_slices_begin_in_full_size) {
  tcs_view view = {0};
  tcs_ladder *rays = tcs_view_ladder(&view, TC_MODE_DVR, 1e-6);
  tcs_ladder_measure(rays, 1e3, 100);
  assert_true(tcs_ladder_pick(rays, 1e6, 1e6, 33).scale < 0.1);
  assert_true(tcs_ladder_pick(tcs_view_ladder(&view, TC_MODE_MPR, 1e-3), 1e6, 1e6, 33).scale == 1);
  assert_true(tcs_ladder_pick(tcs_view_ladder(&view, TC_MODE_MIP, 1e-3), 1e6, 1e6, 33).scale <
              1); /* as it is elsewhere */
  assert_true(tcs_view_ladder(&view, TC_MODE_DVR, 1e-6)->ms_per_sample == 0.1);
}

/* Reads of `cpu_us` whenever one may begin, `gap_us` apart at least, for ten seconds. Returns the processor time taken.
 */
static int64_t read_for_long(int64_t cpu_us, int64_t gap_us, int64_t *longest_rest_us) {
  tcs_allowance share;
  int64_t taken_us = 0, now_us = 5000;
  tcs_allowance_init(&share, now_us);
  for (*longest_rest_us = 0; now_us < 10000000; taken_us += cpu_us) {
    const int64_t resume_us = tcs_allowance_spend(&share, now_us, cpu_us);
    *longest_rest_us = MAX(*longest_rest_us, resume_us - now_us);
    now_us = MAX(now_us + gap_us, resume_us);
  }
  return taken_us;
}

TEST(test_a_flood_of_messages_gets_its_share) {
  int64_t rest_us;
  assert_in_range(read_for_long(500, 500, &rest_us), 10000000 / TCS_ALLOWANCE,
                  10000000 / TCS_ALLOWANCE + TCS_ALLOWANCE_CREDIT_US + 500);
  assert_in_range(rest_us, 1, 500 * TCS_ALLOWANCE); /* many short rests, not a long one */
}

TEST(test_a_hand_never_rests) {
  int64_t rest_us;
  read_for_long(100, 1000000 / 144, &rest_us);
  assert_int_equal(rest_us, 0);
}

/* A burst is taken at once, and its credit comes back. */
TEST(test_a_burst_is_taken_from_credit) {
  tcs_allowance share;
  tcs_allowance_init(&share, 0);
  assert_int_equal(tcs_allowance_spend(&share, 0, TCS_ALLOWANCE_CREDIT_US), 0);
  assert_int_equal(tcs_allowance_spend(&share, 0, 100), 100 * TCS_ALLOWANCE);
  assert_int_equal(tcs_allowance_spend(&share, 100 * TCS_ALLOWANCE, 0), 0);
  assert_int_equal(tcs_allowance_spend(&share, 100000000, TCS_ALLOWANCE_CREDIT_US), 0);
}

TESTS(NULL, NULL)
