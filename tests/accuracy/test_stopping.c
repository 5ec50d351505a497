/* Stopping a frame is soon on every renderer: counted in looks at the halt, and by the clock. */
#include "tests/support/subject.h"
#include <inttypes.h>
#include <limits.h>
#include <pthread.h>
#include <time.h>

#include "renderer/base/halt.h"
#include "renderer/frame/frame.h"

/* Of processor time, since others may have the processor meanwhile, on a machine that takes FIXED_WORK_US for
 * fixed_work(); a slower machine may take longer in proportion. */
enum { MOST_DEAF_US = SANITIZED ? 200000 : 20000 };
enum { FIXED_WORK_US = 5000 };

/* All threads': what they do after the wish is no less than what the answer waits for, whoever else has the processor. */
static double process_ms(void) {
  struct timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

static double fixed_work_us(void) {
  const double start = process_ms();
  volatile double from = 0.3;
  double x = from;
  for (int i = 0; i < 200000; i++) x = exp(-x) + log1p(x);
  from = x;
  return (process_ms() - start) * 1000;
}

static long long most_deaf_us(void) {
  static double fastest_us = INFINITY;
  if (isinf(fastest_us))
    for (int i = 0; i < 9; i++) fastest_us = fmin(fastest_us, fixed_work_us());
  return (long long)(MOST_DEAF_US * fmax(1, fastest_us / FIXED_WORK_US));
}

enum { LOOKS_TO_LEAVE = 24 }; /* of two workers and who waits for them */
/* A machine that is itself a guest charges a thread for what it did not get: what is truly long is long each time. */
enum { TRIES = 5 };

/* Looks that an uncut render takes; its longest time without one. */
static long long count_looks(int which, subject *s, long long *longest_us) {
  tc_interrupt interrupt;
  tc_interrupt_init(&interrupt);
  tc_render_request request = s->request;
  request.interrupt = &interrupt;
  tc_halt_probe_begin(LLONG_MAX);
  tc_halt_begin(&interrupt, 0); /* a look: what is planned counts too */
  bool drawn =
      tc_render(test_renderers[which], s->volume, &s->drawn.scene, &request, &test_frames[which], NULL);
  tc_halt_begin(&interrupt, 0); /* and the end */
  tc_halt_probed.on = false;
  *longest_us = atomic_load(&tc_halt_probed.longest_us);
  return drawn ? atomic_load(&tc_halt_probed.looks) : 0;
}

/* The wish comes at look number `at`; how many more there were. */
static long long looks_after(int which, subject *s, long long at) {
  tc_interrupt interrupt;
  GError *error = NULL;
  tc_interrupt_init(&interrupt);
  tc_render_request request = s->request;
  request.interrupt = &interrupt;
  tc_halt_probe_begin(at);
  tc_halt_begin(&interrupt, 0);
  bool drawn =
      tc_render(test_renderers[which], s->volume, &s->drawn.scene, &request, &test_frames[which], &error);
  tc_halt_probed.on = false;
  if (drawn) return 0; /* it was the last one, or other workers took fewer */
  atomic_bool *cancel = &interrupt.cancel; /* the words follow it, not the probe */
  assert_false(atomic_load(cancel));
  g_clear_error(&error);
  return atomic_load(&tc_halt_probed.looks) - at;
}

/* Wherever the wish meets a render, first frames with all that they build included, it is left after a few more looks;
 * and looks are never far apart. */
TEST(stopping_is_soon) {
  long long most_after[RENDERERS] = {0}, most_us[RENDERERS] = {0};
  uint64_t where = 5;
  for (uint64_t seed = 1; seed <= CASES; seed++) {
    subject s;
    if (!subject_open(&s, seed * 11)) continue;
    EACH_RENDERER(i) {
      long long longest_us, looks;
      if (i == GL && seed % 10) continue;
      looks = count_looks(i, &s, &longest_us);
      for (int try = 1; try < TRIES && longest_us > most_deaf_us(); try++) {
        tc_renderer_forget(test_renderers[i], s.volume);
        count_looks(i, &s, &longest_us);
      }
      most_us[i] = MAX(most_us[i], longest_us);
      tc_renderer_forget(test_renderers[i], s.volume); /* another first frame */
      if (!looks) continue;
      long long after = looks_after(i, &s, 1 + (long long)(test_random(&where) * (double)looks));
      most_after[i] = MAX(most_after[i], after);
      if (longest_us > most_deaf_us() || after > LOOKS_TO_LEAVE) {
        test_case_print(&s.drawn);
        fail_msg("%s: %lld us without a look, %lld looks after the wish", test_names[i], longest_us, after);
      }
    }
    subject_close(&s);
  }
  EACH_RENDERER(i)
    printf("  %-6s at most %lld looks after the wish, %.2f ms of processor time without one\n", test_names[i],
           most_after[i], (double)most_us[i] / 1000);
}

/* One pixel of it takes seconds: 128^3 voxels, cubic, lit by cubic gradients, 64 rays a pixel in steps of 1e-4. */
static void monster_open(subject *s) {
  static const tc_knot knots[] = {{0, {1, 0.5, 0.2}, 1e-3}, {1000, {0.2, 0.6, 1}, 2e-3}};
  const unsigned seed = 3;
  test_grid grid = {.dims = {128, 128, 128}, .type = TC_F32};
  memset(s, 0, sizeof *s);
  s->volume = test_volume(&grid, test_noise, &seed);
  tc_scene *scene = &s->drawn.scene;
  test_scene(scene, 32, 32);
  test_scene_knots(scene, TC_KNOT_EXTINCTION, knots, G_N_ELEMENTS(knots));
  test_scene_frame(scene, s->volume, TC_PERSPECTIVE, (const double[3]){0.3, -1, 0.2});
  scene->filter = TC_FILTER_CUBIC;
  scene->shading.model = TC_SHADING_LAMBERT;
  scene->shading.gradient = TC_GRADIENT_CUBIC;
  scene->sampling.step = 1e-4;
  scene->sampling.rays_per_pixel = 64;
}

TEST(monster_stops) {
  enum { LOOKS = 60 };
  subject s;
  monster_open(&s);
  double longest, all = tc_estimate_samples(s.volume, &s.drawn.scene, NULL, 32, 32, &longest);
  printf("  %.3g samples, %.3g of a ray\n", all, longest);
  EACH_RENDERER(i) {
    tc_explanation plan;
    long long after = looks_after(i, &s, LOOKS);
    double ms = (double)atomic_load(&tc_halt_probed.longest_us) / 1000;
    printf("  %-6s %lld looks after the wish, %.2f ms of processor time without one\n", test_names[i], after, ms);
    assert_true(after <= LOOKS_TO_LEAVE && ms * 1000 <= most_deaf_us());
    assert_true(tc_renderer_explain(test_renderers[i], s.volume, &s.drawn.scene, NULL, &plan, NULL));
    if (i == GL) /* which could not stop */
      assert_non_null(strstr(plan.stages[TC_STAGE_RESOLVE].reason, "drawn by the cpu"));
  }
  tc_scene_clear(&s.drawn.scene);
  subject_close(&s);
}

/* ---- what is built of long lists ---- */

typedef struct long_list {
  const char *name;
  size_t knots;
  tc_classification classification;
  int places;     /* where they stand, as close as subtables resolve; 0: all over the range */
  bool alternate; /* between clear black and dense white: many pieces each */
} long_list;

/* Another list, and so another table, with each try. */
static void list_knots(tc_knot *knots, const long_list *list, const tc_volume *volume, int try) {
  const tc_volume_stats *range = tc_volume_statistics(volume);
  uint64_t state = 3;
  for (size_t i = 0; i < list->knots; i++) {
    double at = (double)i / (double)(list->knots - 1), shade = list->alternate ? i % 2 : test_random(&state);
    shade *= 1 - 1e-6 * try;
    double place = floor(at * list->places);
    if (list->places) at = (place + 0.5 + 0.001 * (at * list->places - place)) / list->places;
    knots[i] = (tc_knot){range->min + at * (range->max - range->min), {shade, shade, 1 - shade}, shade};
  }
}

/* Cut where the table is in the making: what is chosen, outlined and begun is heard. */
TEST(long_lists_are_heard) {
  enum { LOOKS = 1200 };
  static const long_list lists[] = {
      {"even", 65536, TC_PREINTEGRATED, 0, false},         {"in eight places", 65536, TC_PREINTEGRATED, 8, false},
      {"in one place", 65536, TC_PREINTEGRATED, 1, false}, {"alternating", 16384, TC_PREINTEGRATED, 0, true},
      {"few alternating", 2048, TC_PREINTEGRATED, 0, true}, {"integrals", 65536, TC_POST, 0, false},
      {"integrals, in one place", 65536, TC_POST, 1, false}};
  g_autofree tc_knot *knots = g_new(tc_knot, TC_MAX_KNOTS);
  subject s = {.volume = ramp_of(TC_U16, 32)};
  for (size_t l = 0; l < 2 * G_N_ELEMENTS(lists); l += STRIDE(3)) {
    const long_list *list = &lists[l / 2];
    tc_scene *scene = &s.drawn.scene;
    double ms = INFINITY;
    for (int try = 0; try < TRIES && ms * 1000 > most_deaf_us(); try++) {
      list_knots(knots, list, s.volume, try);
      test_scene(scene, 16, 16);
      test_scene_knots(scene, l % 2 ? TC_KNOT_OPACITY : TC_KNOT_EXTINCTION, knots, list->knots);
      test_scene_frame(scene, s.volume, TC_PERSPECTIVE, (const double[3]){0.3, -1, 0.2});
      scene->image.linear_light = true;
      scene->classification = list->classification;
      assert_true(looks_after(test_widest(), &s, LOOKS) <= LOOKS_TO_LEAVE);
      ms = (double)atomic_load(&tc_halt_probed.longest_us) / 1000;
      printf("  %s, %s: %.2f ms of processor time without a look\n", list->name, l % 2 ? "opacity" : "extinction", ms);
      tc_scene_clear(scene);
    }
    assert_true(ms * 1000 <= most_deaf_us());
  }
  subject_close(&s);
}

TEST(many_labels_are_heard) {
  const double rgba[4] = {1, 0.5, 0.25, 1};
  subject s = {.volume = ramp_of(TC_U16, 41), .labels = ramp_of(TC_U16, 41)};
  tc_scene *scene = &s.drawn.scene;
  test_scene(scene, 16, 16);
  test_scene_frame(scene, s.volume, TC_PERSPECTIVE, (const double[3]){0.3, -1, 0.2});
  strcpy(scene->labels.volume, "labels");
  scene->image.linear_light = true;
  scene->labels.n_colors = scene->labels.n_visible = 65535;
  scene->labels.colors = g_new(tc_label_color, 65535);
  scene->labels.visible = g_new(uint32_t, 65535);
  for (uint32_t i = 0; i < 65535; i++) {
    scene->labels.colors[i].label = scene->labels.visible[i] = i + 1;
    memcpy(scene->labels.colors[i].rgba, rgba, sizeof rgba);
  }
  s.request.labels = s.labels;
  long long us, built = 0, found;
  count_looks(test_widest(), &s, &us);
  us = LLONG_MAX;
  for (int try = 0; try < TRIES && us > most_deaf_us(); try++) {
    tc_renderer_forget(test_renderers[test_widest()], s.labels);
    built = count_looks(test_widest(), &s, &us); /* the labels alone */
    printf("  %lld looks, %.2f ms of processor time without one\n", built, (double)us / 1000);
  }
  assert_true(us <= most_deaf_us());
  found = count_looks(test_widest(), &s, &us);
  assert_true(built - found >= 12); /* of sixteen: workers take a few more or less */
  tc_renderer_forget(test_renderers[test_widest()], s.labels);
  assert_true(looks_after(test_widest(), &s, 4) <= LOOKS_TO_LEAVE); /* cut in their midst */
  tc_scene_clear(scene);
  subject_close(&s);
}

/* The longest time without a look of a frame that nobody has drawn before, after one of `before`, if not NULL. */
static long long first_frame_us(subject *before, subject *s) {
  const tc_renderer_options options = {.backend = TC_BACKEND_GL, .threads = 2};
  tc_renderer *const kept = test_renderers[GL];
  long long us;
  test_renderers[GL] = tc_renderer_new(&options, NULL);
  assert_non_null(test_renderers[GL]);
  if (before) count_looks(GL, before, &us);
  assert_true(count_looks(GL, s, &us) > 0);
  tc_renderer_free(test_renderers[GL]);
  test_renderers[GL] = kept;
  return us;
}

/* A driver in software compiles at a first dispatch, for the textures that are bound: beside, not while nobody hears. */
TEST(first_dispatches_are_heard) {
  if (!test_renderers[GL]) skip();
  static const tc_mode modes[] = {TC_MODE_MESH, TC_MODE_SPLAT, TC_MODE_MIP};
  subject before = {.volume = ramp_of(TC_U16, 41)}, s = {.volume = ramp_of(TC_U16, 32)};
  for (size_t m = 0; m < G_N_ELEMENTS(modes); m++) {
    subject *both[] = {&before, &s};
    for (int i = 0; i < 2; i++) {
      tc_scene *scene = &both[i]->drawn.scene;
      test_scene(scene, 16, 16);
      test_scene_frame(scene, both[i]->volume, TC_PERSPECTIVE, (const double[3]){0.3, -1, 0.2});
      scene->mode = modes[m];
      scene->isosurface.value = scene->splat.threshold[0] = 30000;
      scene->splat.threshold[1] = 70000, scene->splat.opaque = true;
    }
    long long us = LLONG_MAX;
    for (int try = 0; try < TRIES && us > most_deaf_us(); try++)
      us = first_frame_us(modes[m] == TC_MODE_MIP ? &before : NULL, &s);
    printf("  mode %s: %.2f ms of processor time without a look\n", tc_mode_names[modes[m]], (double)us / 1000);
    assert_true(us <= most_deaf_us());
    for (int i = 0; i < 2; i++) tc_scene_clear(&both[i]->drawn.scene);
  }
  subject_close(&before);
  subject_close(&s);
}

/* A table of 75 MB: the buffer that it goes into is not zeroed in one go. */
TEST(large_tables_are_heard) {
  if (!test_renderers[GL]) skip();
  subject s = {.volume = ramp_of(TC_U16, 32), .request.table_size = 1536};
  tc_scene *scene = &s.drawn.scene;
  test_scene(scene, 16, 16);
  test_scene_frame(scene, s.volume, TC_PERSPECTIVE, (const double[3]){0.3, -1, 0.2});
  scene->classification = TC_PREINTEGRATED;
  long long us = LLONG_MAX;
  for (int try = 0; try < TRIES && us > most_deaf_us(); try++) us = first_frame_us(NULL, &s);
  printf("  %.2f ms of processor time without a look\n", (double)us / 1000);
  assert_true(us <= most_deaf_us());
  tc_scene_clear(scene);
  subject_close(&s);
}

/* Hundreds of translucent layers in every sample of a tile: they are sorted and shaded between looks, too. */
TEST(deep_layers_are_heard) {
  subject s = {.volume = ramp_of(TC_U16, 24)};
  deep_scene(&s, 250, 8);
  long long us = LLONG_MAX, looks;
  assert_true(count_looks(test_widest(), &s, &us) > 0); /* extracts them */
  for (int try = 0; try < TRIES && (try == 0 || us > most_deaf_us()); try++) looks = count_looks(test_widest(), &s, &us);
  printf("  %lld looks, %.2f ms of processor time without one\n", looks, (double)us / 1000);
  assert_true(looks > 0 && us <= most_deaf_us());
  tc_scene_clear(&s.drawn.scene);
  subject_close(&s);
}

/* ---- by the clock ---- */

typedef struct canceller {
  tc_interrupt interrupt;
  double after_ms, wished_ms; /* of the process' own time */
  int64_t at_us;
  atomic_bool over;
} canceller;

static void *cancel_later(void *context) {
  canceller *c = context;
  const double start = process_ms();
  while (process_ms() - start < c->after_ms && !atomic_load(&c->over)) g_usleep(200);
  c->at_us = g_get_monotonic_time();
  c->wished_ms = process_ms();
  atomic_store(&c->interrupt.cancel, true);
  return NULL;
}

/* Milliseconds from the wish to the answer, by the processor and by the clock; false: there was a picture or a refusal
 * before. */
static bool stop_ms(int which, subject *s, double after_ms, double *processor, double *clock) {
  canceller c = {.after_ms = after_ms};
  GError *error = NULL;
  pthread_t thread;
  tc_interrupt_init(&c.interrupt);
  atomic_init(&c.over, false);
  tc_render_request request = s->request;
  request.interrupt = &c.interrupt;
  assert_int_equal(pthread_create(&thread, NULL, cancel_later, &c), 0);
  tc_render(test_renderers[which], s->volume, &s->drawn.scene, &request, &test_frames[which], &error);
  *clock = (double)g_get_monotonic_time();
  *processor = process_ms();
  atomic_store(&c.over, true);
  pthread_join(thread, NULL);
  *clock = (*clock - (double)c.at_us) / 1000;
  *processor -= c.wished_ms;
  const bool stopped = g_error_matches(error, TC_ERROR, TC_ERROR_CANCELLED);
  g_clear_error(&error);
  return stopped;
}

static double draw_decades(uint64_t *state, double lo, double hi) { return pow(10, lo + (hi - lo) * test_random(state)); }

/* Larger pictures of larger volumes, long lists of knots, short steps and many rays, so that there is time to stop. */
static bool slow_subject_open(subject *s, uint64_t seed) {
  static const int table_sizes[] = {0, 0, 0, 512, 1024};
  char *refusal = NULL;
  uint64_t state = seed;
  s->drawn = test_case_random(seed);
  tc_scene *scene = &s->drawn.scene;
  choose_mode(scene, seed);
  scene->image.width = (int)draw_decades(&state, 2, 3.3);
  scene->image.height = (int)draw_decades(&state, 2, 3.3);
  s->drawn.fine = true;
  scene->sampling.step = draw_decades(&state, -3, 0.3);
  if (scene->sampling.rays_per_pixel > 1) scene->sampling.rays_per_pixel = (int)draw_decades(&state, 0.31, 1.8);
  if (test_random(&state) < 0.3) s->drawn.n_knots = (size_t)draw_decades(&state, 1.1, 4.8);
  const int most = test_random(&state) < 0.1 ? 256 : 96;
  for (int k = 0; k < 3; k++) s->drawn.dims[k] = MIN(12 * s->drawn.dims[k], most);
  bool fits = test_case_fit(&s->drawn, &refusal);
  g_free(refusal);
  if (!fits) return false;
  s->volume = test_case_volume(&s->drawn);
  s->labels = test_case_labels(&s->drawn, s->volume);
  s->request = (tc_render_request){.labels = s->labels, .table_size = table_sizes[seed % G_N_ELEMENTS(table_sizes)]};
  return true;
}

static int by_size(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

enum { MOST_STOPPED = 1000 };

typedef struct stops {
  double processor[MOST_STOPPED], clock[MOST_STOPPED];
  int count;
} stops;

static double print_stops(const char *name, const char *what, double *ms, int count) {
  qsort(ms, (size_t)count, sizeof *ms, by_size);
  printf("  %-6s %d stopped, by the %s: p50 %.2f, p99 %.2f, at most %.2f ms\n", name, count, what, ms[count / 2],
         ms[count * 99 / 100], ms[count - 1]);
  return ms[count * 99 / 100];
}

/* First frames stopped at any time; TC_LONG=1 takes a thousand, and holds them to 50 ms (99 %) and 200; TC_SEEDS=200-400
 * takes a part of those. */
TEST(stopping_by_the_clock) {
  const bool many = getenv("TC_LONG") != NULL;
  const int wanted = many ? MOST_STOPPED : SANITIZED ? 15 : 40, gl_share = many ? 1 : 5; /* it compiles */
  uint64_t first = 1, end = 20 * (uint64_t)wanted;
  if (getenv("TC_SEEDS")) assert_int_equal(sscanf(getenv("TC_SEEDS"), "%" SCNu64 "-%" SCNu64, &first, &end), 2);
  g_autofree stops *all = g_new0(stops, RENDERERS);
  uint64_t where = 9;
  for (uint64_t seed = first; all[SCALAR].count < wanted && seed < end; seed++) {
    subject s;
    if (!slow_subject_open(&s, seed * 13)) continue;
    EACH_RENDERER(i) {
      double processor, clock, after = draw_decades(&where, -0.5, 2.5);
      if (all[i].count == wanted || (i == GL && seed % gl_share) || !stop_ms(i, &s, after, &processor, &clock)) continue;
      if (many && processor > 50) printf("  %s, seed %d: %.1f ms after %.1f\n", test_names[i], (int)seed, processor, after);
      all[i].processor[all[i].count] = processor;
      all[i].clock[all[i].count++] = clock;
    }
    subject_close(&s);
  }
  EACH_RENDERER(i) {
    assert_true(all[i].count > 0);
    print_stops(test_names[i], "clock", all[i].clock, all[i].count);
    double most = print_stops(test_names[i], "processor", all[i].processor, all[i].count);
    if (many) assert_true(most <= 50 && all[i].processor[all[i].count - 1] <= 200);
  }
}

int main(void) {
  setenv("MESA_SHADER_CACHE_DISABLE", "true", 1); /* what others compiled takes no time */
  return run_all_tests(test_renderers_open, test_renderers_close);
}
