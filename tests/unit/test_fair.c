/* Fair turns over simulated render time: no threads, no clock. */
#include "tests/support/test.h"

#include "server/schedule/fair.h"

#define MOST 64

/* A client that has one job after another of a length, `gap` milliseconds after the last one. */
typedef struct client {
  tcs_fair_client *fair;
  tcs_class class;
  double late_of; /* the share of its slices' time that nobody thought of */
  double job_ms, gap_ms, left_ms, ready_ms, longest_wait_ms, served_ms;
  double waited_since_ms;
} client;

typedef struct world {
  tcs_fair *fair;
  client of[MOST];
  int n;
  double now_ms;
} world;

static client *add(world *w, const char *peer, tcs_class class, double job_ms, double gap_ms) {
  client *c = &w->of[w->n++];
  *c = (client){.class = class, .job_ms = job_ms, .gap_ms = gap_ms, .ready_ms = w->now_ms};
  c->fair = tcs_fair_join(w->fair, peer, c);
  return c;
}

static void arrive(world *w) {
  for (int i = 0; i < w->n; i++) {
    client *c = &w->of[i];
    if (c->left_ms > 0 || c->ready_ms > w->now_ms) continue;
    c->left_ms = c->job_ms;
    c->waited_since_ms = c->ready_ms;
    tcs_fair_wait(c->fair, c->class, true);
  }
}

static double next_arrival(const world *w) {
  double next = 1e300;
  for (int i = 0; i < w->n; i++)
    if (w->of[i].left_ms <= 0 && w->of[i].ready_ms < next) next = w->of[i].ready_ms;
  return next;
}

/* One slice as the scheduler gives it, in steps of half a millisecond, at whose ends it may be cut. */
static void serve(world *w) {
  tcs_class class;
  tcs_fair_client *picked = tcs_fair_pick(w->fair, NULL, NULL, &class);
  if (!picked) {
    w->now_ms = next_arrival(w);
    return;
  }
  client *c = tcs_fair_user(picked);
  bool share = false;
  for (int i = 0; i < (int)class; i++) share |= tcs_fair_waiting(w->fair, (tcs_class)i) > 0;
  if (c->left_ms == c->job_ms && w->now_ms - c->waited_since_ms > c->longest_wait_ms)
    c->longest_wait_ms = w->now_ms - c->waited_since_ms;
  tcs_fair_wait(picked, class, false);
  double ms = 0;
  while (c->left_ms > 0) {
    c->left_ms -= 0.5, w->now_ms += 0.5, ms += 0.5;
    if (c->left_ms <= 0) c->ready_ms = w->now_ms + c->gap_ms;
    arrive(w);
    const tcs_pressure pressure = tcs_fair_pressure(w->fair, picked, class);
    if (pressure == TCS_PRESSURE_NOW && !share) break;
    if (pressure != TCS_PRESSURE_NONE && ms >= tcs_class_slice_ms(class)) break;
  }
  c->served_ms += ms;
  tcs_fair_charge(picked, class, ms, c->late_of * ms);
  if (c->left_ms > 0) tcs_fair_wait(picked, class, true);
}

static void run(world *w, double until_ms) {
  arrive(w);
  while (w->now_ms < until_ms) {
    serve(w);
    arrive(w);
  }
}

static void finish(world *w) {
  for (int i = 0; i < w->n; i++) tcs_fair_leave(w->of[i].fair);
  tcs_fair_free(w->fair);
}

static double jain(const world *w) {
  double sum = 0, squares = 0;
  for (int i = 0; i < w->n; i++) sum += w->of[i].served_ms, squares += w->of[i].served_ms * w->of[i].served_ms;
  return sum * sum / (w->n * squares);
}

TEST(test_equal_jobs_share_equally) {
  world w = {.fair = tcs_fair_new()};
  for (int i = 0; i < MOST; i++) add(&w, "a", TCS_CLASS_INTERACTIVE, 8, 0);
  run(&w, 60000);
  printf("Jain index, 64 clients of 8 ms: %.4f\n", jain(&w));
  assert_true(jain(&w) >= 0.98);
  finish(&w);
}

TEST(test_unequal_jobs_share_time_not_turns) {
  static const double lengths[] = {1, 3, 8, 15, 33, 120, 700, 5000};
  world w = {.fair = tcs_fair_new()};
  for (int i = 0; i < 16; i++) add(&w, "a", TCS_CLASS_INTERACTIVE, lengths[i % 8], 0);
  run(&w, 60000);
  printf("Jain index, jobs of 1 to 5000 ms: %.4f\n", jain(&w));
  assert_true(jain(&w) >= 0.98);
  finish(&w);
}

TEST(test_a_pause_between_pictures_pays_no_debt) {
  world w = {.fair = tcs_fair_new()};
  client *heavy = add(&w, "a", TCS_CLASS_INTERACTIVE, 12, 0.5);
  for (int i = 0; i < 4; i++) add(&w, "a", TCS_CLASS_INTERACTIVE, 4, 0.5);
  run(&w, 20000);
  printf("share of the one with jobs three times as long: %.3f\n", heavy->served_ms / w.now_ms);
  assert_true(heavy->served_ms < 0.24 * w.now_ms);
  finish(&w);
}

TEST(test_peers_share_before_their_clients) {
  world w = {.fair = tcs_fair_new()};
  client *alone = add(&w, "alone", TCS_CLASS_INTERACTIVE, 10, 0);
  for (int i = 0; i < 20; i++) add(&w, "many", TCS_CLASS_INTERACTIVE, 10, 0);
  run(&w, 20000);
  printf("share of one session beside a peer with twenty: %.3f\n", alone->served_ms / w.now_ms);
  assert_true(alone->served_ms > 0.48 * w.now_ms && alone->served_ms < 0.52 * w.now_ms);
  finish(&w);
}

/* Closing a session and opening another after every picture. */
TEST(test_coming_and_going_gains_nothing) {
  world w = {.fair = tcs_fair_new()};
  for (int i = 0; i < 4; i++) add(&w, "a", TCS_CLASS_INTERACTIVE, 10, 0);
  client *churn = add(&w, "a", TCS_CLASS_INTERACTIVE, 10, 0);
  arrive(&w);
  while (w.now_ms < 20000) {
    serve(&w);
    if (churn->left_ms <= 0) {
      tcs_fair_leave(churn->fair);
      churn->fair = tcs_fair_join(w.fair, "a", churn);
    }
    arrive(&w);
  }
  printf("share of one that comes and goes beside four: %.3f\n", churn->served_ms / w.now_ms);
  assert_true(churn->served_ms < 0.22 * w.now_ms);
  finish(&w);
}

TEST(test_what_is_dragged_waits_for_no_single_picture) {
  world w = {.fair = tcs_fair_new()};
  for (int i = 0; i < 20; i++) add(&w, "batch", TCS_CLASS_SINGLE, 900, 0);
  client *drag = add(&w, "viewer", TCS_CLASS_INTERACTIVE, 6, 16);
  run(&w, 30000);
  printf("longest wait beside twenty renders: %.1f ms\n", drag->longest_wait_ms);
  assert_true(drag->longest_wait_ms <= TCS_FAIR_SLICE_MS + 0.5);
  assert_true(drag->served_ms > 0.2 * w.now_ms); /* 6 of 22, less the slices it waits */
  finish(&w);
}

/* What a hypervisor takes from one frame costs its client one wait, not as many as there are rivals. */
TEST(test_a_stall_is_let_off) {
  world w = {.fair = tcs_fair_new()};
  for (int i = 0; i < 4; i++) add(&w, "a", TCS_CLASS_INTERACTIVE, 7, 1);
  run(&w, 2000);
  client *stalled = &w.of[0];
  while (stalled->left_ms <= 0) {
    serve(&w);
    arrive(&w);
  }
  tcs_fair_charge(stalled->fair, TCS_CLASS_INTERACTIVE, 35, 35); /* a slice that drew nothing */
  const double began_ms = w.now_ms += 35;
  while (stalled->left_ms > 0) {
    arrive(&w);
    serve(&w);
  }
  printf("until a frame is done that was stalled for 35 ms, beside three of 7 ms: %.1f ms\n", w.now_ms - began_ms);
  assert_true(w.now_ms - began_ms <= 50);
  finish(&w);
}

TEST(test_who_is_always_late_gains_little) {
  world w = {.fair = tcs_fair_new()};
  client *late = add(&w, "a", TCS_CLASS_INTERACTIVE, 12, 0);
  for (int i = 0; i < 3; i++) add(&w, "a", TCS_CLASS_INTERACTIVE, 12, 0);
  late->late_of = 1;
  run(&w, 20000);
  printf("share of one that is always late beside three: %.3f; Jain %.4f\n", late->served_ms / w.now_ms, jain(&w));
  assert_true(late->served_ms < 0.265 * w.now_ms && jain(&w) >= 0.98);
  finish(&w);
}

TEST(test_no_class_starves) {
  world w = {.fair = tcs_fair_new()};
  for (int i = 0; i < 8; i++) add(&w, "a", TCS_CLASS_INTERACTIVE, 9, 0);
  client *single = add(&w, "b", TCS_CLASS_SINGLE, 400, 0), *refine = add(&w, "a", TCS_CLASS_REFINE, 200, 0);
  run(&w, 30000);
  printf("beside more frames than fit: single %.3f, refinement %.3f of the time\n", single->served_ms / w.now_ms,
         refine->served_ms / w.now_ms);
  assert_true(single->served_ms > 0.06 * w.now_ms && single->served_ms < 0.13 * w.now_ms);
  assert_true(refine->served_ms > 0.06 * w.now_ms && refine->served_ms < 0.13 * w.now_ms);
  for (int i = 0; i < 8; i++) assert_true(w.of[i].served_ms > 0.08 * w.now_ms);
  finish(&w);
}

static bool accept_singles(void *client_user, tcs_class class, void *user) { return class == TCS_CLASS_SINGLE; }

TEST(test_who_may_not_begin_is_passed_over) {
  world w = {.fair = tcs_fair_new()};
  add(&w, "a", TCS_CLASS_INTERACTIVE, 5, 0);
  client *single = add(&w, "a", TCS_CLASS_SINGLE, 5, 0);
  arrive(&w);
  tcs_class class;
  assert_ptr_equal(tcs_fair_pick(w.fair, accept_singles, NULL, &class), single->fair);
  assert_int_equal(class, TCS_CLASS_SINGLE);
  tcs_fair_wait(single->fair, TCS_CLASS_SINGLE, false);
  assert_null(tcs_fair_pick(w.fair, accept_singles, NULL, &class));
  assert_int_equal(tcs_fair_pressure(w.fair, single->fair, TCS_CLASS_SINGLE), TCS_PRESSURE_NOW);
  finish(&w);
}

TEST(test_who_owes_is_remembered) {
  tcs_fair *fair = tcs_fair_new();
  tcs_fair_client *a = tcs_fair_join(fair, "x", NULL), *b = tcs_fair_join(fair, "x", NULL);
  tcs_fair_charge(a, TCS_CLASS_SINGLE, 100, 0);
  assert_false(tcs_fair_even(a));
  assert_true(tcs_fair_used_ms(a) == 100);
  tcs_fair_leave(b);
  assert_true(tcs_fair_even(a)); /* to nobody */
  tcs_fair_leave(a);
  tcs_fair_free(fair);
}

TESTS(NULL, NULL)
