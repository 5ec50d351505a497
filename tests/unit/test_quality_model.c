/* Quality control without pictures: what is chosen from views that are given, and from frames whose time is known. */
#include "tests/support/test.h"

#include "renderer/quality/cost.h"
#include "renderer/quality/quality.h"

static tc_scene scene;
#define PIXELS ((double)scene.image.width * scene.image.height)
static tc_quality_choice choice;
static tc_quality_cost cpu, gl;

static int set_up(void **state) {
  tc_scene_init(&scene);
  scene.camera = (tc_camera){TC_PERSPECTIVE, {0, -100, 0}, {0, 0, 0}, {0, 0, 1}, 30, 50};
  scene.quality.max_error = 0.01;
  cpu = tc_quality_cost_of("cpu"), gl = tc_quality_cost_of("gl");
  cpu.spread = gl.spread = 0; /* as after many frames that were foretold well */
  return 0;
}

static int tear_down(void **state) {
  tc_scene_clear(&scene);
  return 0;
}

/* error = level * step^2 */
static tc_quality_view second_order(double level) {
  return (tc_quality_view){scene.camera, {{1, level, 2, 0, 0.25, 2}}};
}

static void look_from(double azimuth, double distance) {
  scene.camera.position[0] = distance * sin(azimuth);
  scene.camera.position[1] = -distance * cos(azimuth);
}

TEST_WITH(careful_before_anything_is_measured, set_up, tear_down) {
  tc_quality_model model = {0};
  tc_camera wanted;
  tc_quality_choose(&model, &cpu, &scene, PIXELS, &choice);
  assert_true(choice.step <= 0.25 && !choice.holds && choice.rms == 0);
  assert_non_null(strstr(choice.reason, "no measurement"));
  assert_true(tc_quality_wants(&model, &scene, &wanted));
  assert_memory_equal(wanted.position, scene.camera.position, sizeof wanted.position); /* its own first */
}

TEST_WITH(the_step_follows_bound_and_order, set_up, tear_down) {
  tc_quality_model model = {0};
  tc_quality_view view = second_order(0.01);
  tc_quality_add(&model, &view);
  tc_quality_choose(&model, &cpu, &scene, PIXELS, &choice);
  double near = choice.step;
  assert_true(choice.holds && choice.near && near < 1 && near > 0.85); /* a margin, and no more */
  assert_true(choice.rms <= 0.01 && choice.rms > 0.008);
  scene.quality.max_error = 0.0025;
  tc_quality_choose(&model, &cpu, &scene, PIXELS, &choice);
  assert_float_equal(choice.step, near / 2, 1e-9); /* second order */
  assert_float_equal(choice.termination, 0.0025 / 16, 1e-12);
  scene.quality.max_error = 0.01;
  view.of[0].spread = 0.2; /* trials that scatter: more margin */
  model.views[0] = view;
  tc_quality_choose(&model, &cpu, &scene, PIXELS, &choice);
  assert_true(choice.step < near);
}

TEST_WITH(far_views_are_taken_at_their_worst, set_up, tear_down) {
  tc_quality_model model = {0};
  tc_quality_view easy = second_order(0.005), hard;
  tc_camera wanted;
  tc_quality_add(&model, &easy);
  look_from(M_PI / 2, 100);
  hard = second_order(0.02);
  tc_quality_add(&model, &hard);
  look_from(0.1, 100);
  tc_quality_choose(&model, &cpu, &scene, PIXELS, &choice);
  double by_easy = choice.step;
  assert_true(choice.near && choice.holds);
  look_from(M_PI, 100);
  tc_quality_choose(&model, &cpu, &scene, PIXELS, &choice);
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

TEST_WITH(a_floor_is_said, set_up, tear_down) {
  tc_quality_model model = {0};
  tc_quality_view view = {scene.camera, {{0.0625, 0.02, 0, 0, 0.0625, 0.1}}};
  tc_quality_add(&model, &view);
  tc_quality_choose(&model, &cpu, &scene, PIXELS, &choice);
  assert_false(choice.holds);
  assert_non_null(strstr(choice.reason, "no step holds"));
}

TEST_WITH(cameras_differ_by_turn_scale_and_shift, set_up, tear_down) {
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

TEST_WITH(the_oldest_view_makes_room, set_up, tear_down) {
  tc_quality_model model = {0};
  tc_quality_view view = second_order(0.01);
  for (int i = 0; i <= TC_QUALITY_VIEWS + 2; i++) {
    view.of[0].rms = i;
    tc_quality_add(&model, &view);
  }
  assert_int_equal(model.n, TC_QUALITY_VIEWS);
  assert_true(model.views[2].of[0].rms == TC_QUALITY_VIEWS + 2 && model.views[3].of[0].rms == 3);
}

/* What each method's curve says of a look: first order 2, level 0.01 at a step of 1; second order 3, finer by
 * `gain`. */
static tc_quality_model both_methods(double gain) {
  tc_quality_model model = {0};
  tc_quality_view view = second_order(0.01);
  view.of[TC_QUALITY_SECOND] = (tc_quality_curve){gain, 0.01, 3, 0, gain / 8, gain * 2};
  tc_quality_add(&model, &view);
  return model;
}

static tc_quality_choice choose_method(double gain, const tc_quality_cost *cost) {
  tc_quality_model model = both_methods(gain);
  tc_quality_choose(&model, cost, &scene, PIXELS, &choice);
  return choice;
}

TEST_WITH(the_method_is_the_cheaper_one, set_up, tear_down) {
  scene.quality.max_error = 1e-3;
  assert_int_equal(choose_method(3, &cpu).classification, TC_PREINTEGRATED2); /* 1.39 beside 0.32 voxels */
  assert_true(choice.holds && choice.step > 1.2 && strstr(choice.reason, "preintegrated would need 0.2"));
  assert_int_equal(choose_method(1.2, &cpu).classification, TC_PREINTEGRATED); /* 0.56 beside 0.32: dearer */
  assert_non_null(strstr(choice.reason, "; preintegrated2 would need 0.5"));
  assert_int_equal(choose_method(1.2, &gl).classification, TC_PREINTEGRATED2); /* where a segment costs less: not */
  assert_true(choice.step > 0.49);
  assert_int_equal(choose_method(0.9, &gl).classification, TC_PREINTEGRATED); /* 0.42 */
  scene.classification = TC_PREINTEGRATED2; /* either name leaves the choice between the two */
  assert_int_equal(choose_method(1.2, &cpu).classification, TC_PREINTEGRATED);
  scene.classification = TC_POST;
  assert_int_equal(choose_method(3, &cpu).classification, TC_POST);
  tc_quality_apply(&choice, &scene);
  assert_true(scene.classification == TC_POST && scene.sampling.step == choice.step && scene.quality.max_error == 0);
}

/* Rays of a pixel share its samples, so one curve over a ray's own spacing serves every number of them. */
TEST_WITH(many_rays_share_the_steps, set_up, tear_down) {
  tc_quality_model model = {0};
  tc_quality_view view = second_order(0.01);
  tc_quality_add(&model, &view);
  tc_quality_choose(&model, &cpu, &scene, PIXELS, &choice);
  double one = choice.step;
  scene.sampling.rays_per_pixel = 4;
  tc_quality_choose(&model, &cpu, &scene, PIXELS, &choice);
  assert_float_equal(choice.step, one / 4, 1e-12);
  assert_float_equal(tc_quality_expects(&model, &scene, TC_PREINTEGRATED, choice.step), choice.rms, 1e-9);
  scene.mode = TC_MODE_MIP; /* here each takes all */
  tc_quality_choose(&model, &cpu, &scene, PIXELS, &choice);
  assert_float_equal(choice.step, one, 1e-12);
}

/* Frames of the scene at its step, of a machine whose rays and samples cost this. */
static double truth(double pixels) {
  double rays = pixels * scene.sampling.rays_per_pixel;
  double segment = scene.classification == TC_PREINTEGRATED2 ? 6e-5 * cpu.second : 6e-5;
  return rays * (2e-5 + segment / (scene.sampling.step * tc_quality_stretch(&scene)));
}

static double at(double step, double pixels) {
  scene.sampling.step = step;
  return truth(pixels);
}

static void add(tc_quality_cost *cost, double pixels, double step, double times) {
  double ms = at(step, pixels);
  tc_quality_cost_add(cost, &scene, pixels, times * ms);
}

static double said(const tc_quality_cost *cost, double pixels, double step) {
  scene.sampling.step = step;
  return tc_quality_cost_ms(cost, &scene, pixels);
}

TEST_WITH(cost_is_learnt, set_up, tear_down) {
  tc_quality_cost cost = cpu;
  assert_true(said(&cost, 1e5, 1) == 0 && tc_quality_cost_step(&cost, &scene, 1e5, 10) == 1);
  add(&cost, 1e5, 1, 1);
  assert_float_equal(said(&cost, 2e5, 1), at(1, 2e5), 1e-9); /* one frame is believed where it was */
  add(&cost, 2e5, 0.5, 1);
  for (int i = 0; i < 20; i++) add(&cost, 1e5, i % 2 ? 0.5 : 2, 1);
  assert_float_equal(said(&cost, 3e5, 1), at(1, 3e5), 0.05 * at(1, 3e5));
  assert_float_equal(said(&cost, 3e5, 0.25), 2 * said(&cost, 3e5, 0.5), 1e-9); /* finer than any: no later than this */
  for (int i = 0; i < 2; i++) add(&cost, 1e5, 0.25, 1);
  assert_float_equal(said(&cost, 3e5, 0.25), at(0.25, 3e5), 0.05 * at(0.25, 3e5));
  double step = tc_quality_cost_step(&cost, &scene, 1e5, 10);
  assert_true(at(step, 1e5) <= 10.3 && at(step / 1.2, 1e5) > 10); /* the finest in time */
  assert_true(tc_quality_cost_step(&cost, &scene, 1e5, 1e-3) == 4);
  assert_true(tc_quality_cost_step(&cost, &scene, 1e5, 1e6) == 0.125);
  scene.sampling.rays_per_pixel = 4; /* four rays at a step of 1/4 each: a spacing of 1 */
  assert_float_equal(said(&cost, 1e5, 0.25), 4e5 * 8e-5, 0.05 * 4e5 * 8e-5);
  assert_true(tc_quality_cost_step(&cost, &scene, 1e5, 1e-3) == 1);
  scene.sampling.rays_per_pixel = 1;
  scene.classification = TC_PREINTEGRATED2; /* from frames of the other method */
  assert_float_equal(said(&cost, 1e5, 1), at(1, 1e5), 0.05 * at(1, 1e5));
  double second = tc_quality_cost_step(&cost, &scene, 1e5, 10);
  assert_true(second > step * cpu.second / 1.1 && second < step * cpu.second * 1.1);
  for (int i = 0; i < 20; i++) add(&cost, 1e5, i % 2 ? 0.5 : 2, 1);
  scene.classification = TC_PREINTEGRATED; /* and these tell of it in turn */
  assert_float_equal(said(&cost, 1e5, 0.5), at(0.5, 1e5), 0.05 * at(0.5, 1e5));
  for (int i = 0; i < 2; i++) add(&cost, 1e5, 1, 5); /* the machine is busy now */
  assert_true(said(&cost, 1e5, 1) > 4 * at(1, 1e5));
  add(&cost, 1e5, 1, 1); /* and no more */
  assert_true(said(&cost, 1e5, 1) < 1.1 * at(1, 1e5));
  tc_quality_cost before = cost;
  tc_quality_cost_add(&cost, &scene, 0, 5);
  tc_quality_cost_add(&cost, &scene, 100, NAN);
  scene.mode = TC_MODE_ISOSURFACE;
  tc_quality_cost_add(&cost, &scene, 100, 5);
  assert_memory_equal(&before, &cost, sizeof cost);
}

/* Final frames, some into a direction that takes nearly twice as long, each after one in motion, which costs half as
 * much. */
TEST_WITH(a_frame_in_motion_foretells_the_final_one, set_up, tear_down) {
  tc_quality_cost cost = cpu;
  tc_quality_pace pace = {0};
  for (int i = 0; i < 24; i++) {
    const double times = i % 3 ? 1 : 1.8, final = at(0.5, 1e5) * times, moving = at(1, 3e4) * times / 2;
    scene.sampling.step = 1;
    tc_quality_pace_add(&pace, moving / tc_quality_cost_ms(&cost, &scene, 3e4), true, (uint64_t)i);
    tc_quality_pace_follow(&pace, &cost, (uint64_t)i + 1); /* of another scene: nothing */
    tc_quality_pace_follow(&pace, &cost, (uint64_t)i);
    const double foretold = said(&cost, 1e5, 0.5);
    if (i > 15) assert_float_equal(foretold, final, 0.02 * final);
    tc_quality_pace_add(&pace, final / tc_quality_cost_ms(&cost, &scene, 1e5), false, (uint64_t)i);
    tc_quality_cost_add(&cost, &scene, 1e5, final);
  }
}

/* What the machine above makes of a scene that may take `ms`. */
static void choose_in(const tc_quality_model *model, tc_quality_cost cost, double ms) {
  scene.image.width = scene.image.height = 300;
  scene.classification = TC_PREINTEGRATED;
  for (int i = 0; i < 2; i++) add(&cost, 9e4, i ? 0.5 : 2, 1);
  scene.quality.max_error = 0, scene.quality.max_ms = ms;
  tc_quality_choose(model, &cost, &scene, PIXELS, &choice);
}

TEST_WITH(a_time_gets_the_least_error, set_up, tear_down) {
  tc_quality_model sharp = both_methods(3), level = both_methods(1.2), none = {0};
  tc_quality_cost gl_known = gl;
  add(&gl_known, 9e4, 1, 1);
  double ms = at(0.5, 9e4); /* in nine tenths of it: preintegrated at 0.59, preintegrated2 at 1.14 on cpu, 0.84 on gl */
  choose_in(&sharp, cpu, ms);
  assert_int_equal(choice.classification, TC_PREINTEGRATED2);
  assert_true(choice.holds && choice.ms <= 0.9 * ms && choice.step > 1 && choice.step < 1.3);
  assert_true(strstr(choice.reason, "preintegrated2, step 1.") && strstr(choice.reason, "; preintegrated with 0.5"));
  assert_float_equal(choice.termination, choice.rms / 16, 1e-12);
  double rms = choice.rms;
  assert_float_equal(tc_quality_expects(&sharp, &scene, TC_PREINTEGRATED2, choice.step), rms, 1e-12);
  assert_true(tc_quality_betters(&sharp, &scene, &choice, TC_PREINTEGRATED, 0.59));
  assert_false(tc_quality_betters(&sharp, &scene, &choice, TC_PREINTEGRATED2, choice.step));
  choose_in(&level, cpu, ms);
  assert_true(choice.holds && choice.classification == TC_PREINTEGRATED && choice.step < 0.7);
  choose_in(&level, gl, 1.07 * ms);
  assert_true(choice.holds && choice.classification == TC_PREINTEGRATED); /* no clear gain */
  choose_in(&sharp, gl, ms);
  assert_true(choice.holds && choice.classification == TC_PREINTEGRATED2 && choice.step < 1);
  choose_in(&sharp, cpu, 0.1); /* for neither: the quicker */
  assert_true(!choice.holds && choice.classification == TC_PREINTEGRATED && choice.step == 4);
  assert_non_null(strstr(choice.reason, "coarsest"));
  choose_in(&none, cpu, ms); /* the step alone, before anything is measured */
  assert_true(choice.holds && choice.classification == TC_PREINTEGRATED && choice.step < 0.7 && choice.rms == 0);
  assert_float_equal(choice.termination, scene.sampling.termination, 0);
  assert_true(tc_quality_measures(&gl_known, &scene));
  assert_false(tc_quality_measures(&gl, &scene)); /* nothing timed: no step to measure about */
  scene.classification = TC_POST; /* by name */
  assert_false(tc_quality_measures(&gl_known, &scene));
  tc_quality_choose(&sharp, &cpu, &scene, PIXELS, &choice);
  assert_true(choice.classification == TC_POST && choice.ms == 0 && strstr(choice.reason, "no frame was timed"));
}

/* Where the curves cross, the method in use stays to either side. */
TEST_WITH(methods_do_not_swing, set_up, tear_down) {
  tc_quality_model model = both_methods(1.5); /* they cross at 0.41 and 1.1 */
  tc_quality_cost cost = cpu;
  int changes = 0, either[2] = {0};
  scene.image.width = scene.image.height = 300;
  scene.quality.max_error = 0;
  for (int i = 0; i < 2; i++) add(&cost, 9e4, i ? 0.5 : 2, 1);
  for (int i = 0; i < 64; i++) { /* of a spacing of 1 to one of 1/8 and back, rocking by a rung */
    double spacing = exp2(-fabs(i - 32.0) / 32 * 2.8 + (i % 2 ? 0.06 : -0.06));
    tc_classification before = scene.classification;
    scene.classification = TC_PREINTEGRATED;
    scene.quality.max_ms = at(spacing, 9e4);
    scene.classification = before;
    tc_quality_choose(&model, &cost, &scene, PIXELS, &choice);
    changes += choice.classification != before;
    either[choice.classification == TC_PREINTEGRATED2]++;
    scene.classification = choice.classification;
  }
  printf("  %d changes, %d and %d frames\n", changes, either[0], either[1]);
  assert_true(either[0] > 8 && either[1] > 8 && changes <= 3);
  model = both_methods(20); /* preintegrated2, where it comes in time: about there it does not swing either */
  changes = 0;
  for (int i = 0; i < 64; i++) {
    tc_classification before = scene.classification;
    scene.classification = TC_PREINTEGRATED2;
    scene.quality.max_ms = at(4, 9e4) * (i % 2 ? 0.97 : 1.03) * (1.2 - 0.4 * i / 64);
    scene.classification = before;
    tc_quality_choose(&model, &cost, &scene, PIXELS, &choice);
    changes += choice.classification != before;
    scene.classification = choice.classification;
  }
  assert_true(changes <= 2 && scene.classification == TC_PREINTEGRATED);
}

/* A session under a budget, on machines and looks of all kinds whose frames' times scatter: after a few frames each
 * takes no more than the budget and not much less, unless steps end there. */
TEST_WITH(a_budget_is_met_within_a_few_frames, set_up, tear_down) {
  enum { FEW = 4, FRAMES = 16, LOOKS = 300 };
  uint64_t noise = 1;
  int settled = 0, over = 0, under = 0;
  for (int look = 0; look < LOOKS; look++) {
    tc_quality_cost cost = cpu;
    double ray = 2e-6 * exp2(look % 7), sample = 1e-5 * exp2(look % 11 - 3), pixels = 1e5;
    scene.sampling.rays_per_pixel = look % 3 ? 1 : 4;
    double stretch = tc_quality_stretch(&scene), rays = pixels * scene.sampling.rays_per_pixel;
    double budget = rays * (ray + sample / exp2((look % 13) / 4.0 - 1.5));
    for (int i = 0; i < FRAMES; i++) {
      noise = noise * 6364136223846793005u + 1442695040888963407u;
      double scatter = 1 + 0.06 * ((double)(noise >> 33) * 0x1p-30 - 1); /* 6 % to either side */
      scene.sampling.step = tc_quality_cost_step(&cost, &scene, pixels, 0.9 * budget);
      double ms = rays * (ray + sample / (scene.sampling.step * stretch));
      tc_quality_cost_add(&cost, &scene, pixels, ms * scatter);
      if (i < FEW) continue;
      settled++;
      over += ms > budget;
      under += ms < 0.75 * budget && scene.sampling.step * stretch > 0.125;
    }
  }
  printf("  of %d frames %d took over the budget, %d under three quarters of it\n", settled, over, under);
  assert_true(over <= settled / 100 && under <= settled / 100);
}

TESTS(NULL, NULL)
