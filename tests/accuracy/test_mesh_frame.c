/* Mode mesh against the surface itself (reference/): where it is seen, how far, how it is lit; and what must not matter. */
#include "renderer/base/halt.h"
#include "renderer/frame/mesh_job.h"
#include "renderer/reference/reference.h"
#include "tests/support/mesh.h"

typedef struct truth {
  float depth[PIXELS]; /* INFINITY: nothing */
  float rgba[PIXELS][4];
} truth;

static void find_truth(tc_volume *volume, const tc_scene *scene, truth *t) {
  GError *error = NULL;
  g_autoptr(tc_reference) r = tc_reference_new(volume, scene, SIDE, SIDE, 0, &error);
  if (!r) fail_msg("%s", error->message);
  for (int i = 0; i < PIXELS; i++) {
    tc_reference_hit hit;
    double rgba[4];
    bool met = tc_reference_surface(r, i % SIDE + 0.5, i / SIDE + 0.5, &hit);
    t->depth[i] = met ? (float)hit.distance_mm : INFINITY;
    tc_reference_pixel(r, i % SIDE + 0.5, i / SIDE + 0.5, rgba);
    for (int c = 0; c < 4; c++) t->rgba[i][c] = (float)rgba[c];
  }
}

/* The surface there is smooth, as far as pixels around it tell: nothing ends within two of it. */
static bool is_smooth(const truth *t, int i) {
  int x = i % SIDE, y = i / SIDE;
  if (x < 2 || y < 2 || x > SIDE - 3 || y > SIDE - 3) return false;
  for (int v = -2; v <= 2; v++)
    for (int u = -2; u <= 2; u++) {
      float other = t->depth[i + v * SIDE + u];
      if (isfinite(other) != isfinite(t->depth[i]) || fabsf(other - t->depth[i]) > 2) return false;
    }
  return true;
}

TEST(surface_is_where_the_field_has_it) {
  static truth t;
  const int which = test_widest();
  for (int round = 0; round < 6; round++) {
    g_autoptr(tc_volume) volume = waves(round % 3 ? TC_U8 : TC_F32);
    g_auto(tc_scene) scene;
    mesh_scene(&scene, volume, round & 1 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    if (round > 3) scene.clip.planes[0][1] = 1, scene.clip.planes[0][3] = -24, scene.clip.n_planes = 1;
    find_truth(volume, &scene, &t);
    const tc_render_request request = {.want_linear = true, .want_depth = true};
    tc_explanation plan;
    tc_frame *frame = test_draw(which, volume, &scene, &request, &plan);
    int smooth = 0, wrong = 0;
    double apart = 0, colour = 0;
    for (int i = 0; i < PIXELS; i++) {
      if (!is_smooth(&t, i)) continue;
      smooth++;
      wrong += isfinite(t.depth[i]) != (frame->linear[4 * i + 3] == 1) || isfinite(t.depth[i]) != isfinite(frame->depth[i]);
      if (!isfinite(t.depth[i]) || !isfinite(frame->depth[i])) continue;
      apart = fmax(apart, fabs(t.depth[i] - frame->depth[i]));
      for (int c = 0; c < 3; c++) colour += fabs(t.rgba[i][c] - frame->linear[4 * i + c]) / 3;
    }
    printf("  %d smooth pixels, %d wrong; at most %.3f mm apart; mean difference of colours %.4f\n", smooth, wrong, apart,
           colour / smooth);
    assert_true(smooth > PIXELS / 5 && wrong == 0 && apart < 0.1 && colour / smooth < 0.005);
    assert_true(plan.stages[TC_STAGE_MESH].included && plan.stages[TC_STAGE_MESH].bytes > 1000);
    assert_false(plan.stages[TC_STAGE_TABLE_2D].included);
    assert_true(plan.stages[TC_STAGE_SKIPPING].included && plan.stages[TC_STAGE_SKIPPING].bytes > 0);
  }
}

TEST(every_renderer_draws_the_same_bytes) {
  g_autoptr(tc_volume) volume = waves(TC_U8);
  g_auto(tc_scene) scene;
  mesh_scene(&scene, volume, TC_PERSPECTIVE);
  scene.sampling.rays_per_pixel = 4;
  const uint8_t *first = NULL;
  EACH_RENDERER(i) {
    const tc_frame *frame = test_draw(i, volume, &scene, NULL, NULL);
    if (!first) first = frame->rgba;
    assert_memory_equal(frame->rgba, first, 4 * PIXELS);
  }
}

/* Balls of radius 8 mm about (12, 20, 20), label 3, and (28, 20, 20), label 7. */
static tc_volume *balls(void) {
  const tc_volume_desc d = {.type = TC_U8, .slope = 1, .frames = 1, .dims = {40, 40, 40}, .spacing = {1, 1, 1},
                            .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
  tc_volume *v = tc_volume_new(&d, NULL);
  uint8_t *to = tc_volume_voxels(v);
  for (int i = 0; i < 40 * 40 * 40; i++) {
    double x = i % 40, y = i / 40 % 40 - 20, z = i / 1600 - 20, r = 64 - y * y - z * z;
    to[i] = (x - 12) * (x - 12) <= r ? 3 : (x - 28) * (x - 28) <= r ? 7 : 0;
  }
  tc_volume_seal(v);
  return v;
}

static const float *pixel_of(const tc_frame *frame, double x) { /* of the point (x, 20, 20) */
  return frame->linear + 4 * (SIDE / 2 * SIDE + (int)((x - 20) * SIDE / 50 + SIDE / 2.0));
}

TEST(labels_have_surfaces_of_their_colours) {
  const int which = test_widest();
  g_autoptr(tc_volume) labels = balls();
  g_auto(tc_scene) scene;
  tc_explanation plan;
  mesh_scene(&scene, labels, TC_PERSPECTIVE);
  test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){20, -50, 20}, (double[3]){20, 20, 20}, 50);
  scene.shading.model = TC_SHADING_NONE;
  scene.isosurface.value = 1e9; /* has no meaning then */
  strcpy(scene.labels.volume, "balls");
  scene.labels.opacity = 0; /* is of tints alone */
  const tc_render_request request = {.want_linear = true, .want_depth = true, .labels = labels};
  size_t n;
  const double(*palette)[3] = tc_label_palette(&n);
  const tc_frame *frame = test_draw(which, labels, &scene, &request, &plan);
  int covered = 0;
  for (int c = 0; c < 3; c++) {
    assert_true(fabs(pixel_of(frame, 12)[c] - palette[2][c]) < 0.01);
    assert_true(fabs(pixel_of(frame, 28)[c] - palette[6][c]) < 0.01);
  }
  for (int i = 0; i < PIXELS; i++) covered += frame->linear[4 * i + 3] == 1;
  assert_true(fabs(covered * 50.0 * 50 / PIXELS - 2 * M_PI * 64) < 0.08 * 2 * M_PI * 64);
  assert_true(fabs(frame->depth[SIDE / 2 * SIDE + (int)(pixel_of(frame, 12) - frame->linear) / 4 % SIDE] - 62) < 1);
  assert_true(plan.stages[TC_STAGE_MESH].included && plan.stages[TC_STAGE_LABELS].included);
  const tc_label_color red = {7, {1, 0, 0, 1}};
  tc_scene_set_colors(&scene, g_memdup2(&red, sizeof red), 1);
  frame = test_draw(which, labels, &scene, &request, &plan);
  assert_true(plan.stages[TC_STAGE_MESH].ms == 0); /* colours alone: nothing is extracted */
  assert_true(pixel_of(frame, 28)[0] > 0.99 && pixel_of(frame, 28)[1] < 0.01);
  const uint32_t seven = 7;
  tc_scene_set_visible(&scene, g_memdup2(&seven, sizeof seven), 1);
  frame = test_draw(which, labels, &scene, &request, NULL);
  assert_true(pixel_of(frame, 12)[3] == 0 && pixel_of(frame, 28)[3] == 1);
}

/* A wavy ball, label 3, within a shell, label 7. */
static tc_volume *ball_in_shell(void) {
  const tc_volume_desc d = {.type = TC_U8, .slope = 1, .frames = 1, .dims = {40, 40, 40}, .spacing = {1, 1, 1},
                            .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
  tc_volume *v = tc_volume_new(&d, NULL);
  uint8_t *to = tc_volume_voxels(v);
  for (int i = 0; i < 40 * 40 * 40; i++) {
    const double x = i % 40 - 19.7, y = i / 40 % 40 - 20.2, z = i / 1600 - 19.6, r = sqrt(x * x + y * y + z * z);
    to[i] = r < 9 + sin(1.2 * x) + cos(1.1 * z) ? 3 : r < 15 ? 7 : 0;
  }
  tc_volume_seal(v);
  return v;
}

/* Where two labels meet, both have a surface. Cut open, the one that faces the eye shows, and not a patchwork of both. */
TEST(of_labels_that_meet_the_front_shows) {
  g_autoptr(tc_volume) labels = ball_in_shell();
  g_auto(tc_scene) scene;
  mesh_scene(&scene, labels, TC_PERSPECTIVE);
  scene.shading.model = TC_SHADING_NONE;
  strcpy(scene.labels.volume, "labels");
  scene.clip.n_planes = 1;
  memcpy(scene.clip.planes[0], (double[]){0.2, 1, 0.1, -24}, sizeof scene.clip.planes[0]);
  const tc_label_color colors[] = {{3, {1, 0, 0, 1}}, {7, {0, 1, 0, 1}}};
  tc_scene_set_colors(&scene, g_memdup2(colors, sizeof colors), 2);
  const tc_render_request request = {.want_linear = true, .labels = labels};
  for (int round = 0; round < 4; round++) {
    const double size = round & 1 ? 3 : 44; /* near, too */
    test_scene_look(&scene, round < 2 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE, (double[3]){10, -150, 12}, (double[3]){20, 20, 20}, size);
    EACH_RENDERER(i) {
      const tc_frame *frame = test_draw(i, labels, &scene, &request, NULL);
      int of[2] = {0};
      for (int p = 0; p < PIXELS; p++)
        for (int c = 0; c < 2; c++) of[c] += frame->linear[4 * p + c] > 0.5f;
      printf("  %s, view %d: %d pixels of the shell, %d of the ball's inside\n", test_names[i], round, of[1], of[0]);
      assert_true(of[1] > 200 && of[0] < 0.035 * of[1]); /* without a preference 14 % in view 0 */
    }
    tc_pick pick = {.at = {SIDE / 2, SIDE / 2}};
    g_autoptr(GError) error = NULL;
    assert_true(tc_renderer_pick(test_renderers[SCALAR], labels, &scene, &request, &pick, &error));
    assert_true(pick.found && pick.label == 7);
  }
}

/* In a volume that shows nothing, surfaces are those of mode mesh, also where two meet and the farther one counts as the nearer. */
TEST(in_a_clear_volume_surfaces_are_those_of_mode_mesh) {
  const int which = test_widest();
  g_autoptr(tc_volume) labels = ball_in_shell();
  const tc_render_request request = {.want_linear = true, .labels = labels};
  for (int round = 0; round < 4; round++) {
    g_auto(tc_scene) scene;
    mesh_scene(&scene, labels, round & 1 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    strcpy(scene.labels.volume, "labels");
    tc_mesh_surface *list = g_new0(tc_mesh_surface, 2);
    for (int i = 0; i < 2; i++)
      list[i] = (tc_mesh_surface){.source = TC_SURFACE_OF_LABEL, .label = i ? 7 : 3, .color = {i, 1 - i, 0.5}, .has_color = true,
                                  .opacity = i ? 0.4 : 0.7, .visible = true, .two_sided = true};
    tc_scene_set_surfaces(&scene, list, 2);
    if (round > 1) scene.clip.n_planes = 1, memcpy(scene.clip.planes[0], (double[]){0.2, 1, 0.1, -24}, sizeof scene.clip.planes[0]);
    const tc_frame *frame = test_draw(which, labels, &scene, &request, NULL);
    g_autofree float *alone = g_memdup2(frame->linear, 16 * PIXELS);
    const tc_knot clear = {0, {1, 1, 1}, 0};
    test_scene_knots(&scene, TC_KNOT_EXTINCTION, &clear, 1);
    scene.mode = TC_MODE_DVR, scene.mesh.with_volume = true;
    frame = test_draw(which, labels, &scene, &request, NULL);
    double apart = 0;
    int shown = 0;
    for (int i = 0; i < 4 * PIXELS; i++) apart = fmax(apart, fabs((double)frame->linear[i] - alone[i])), shown += alone[i] > 0;
    printf("  round %d: at most %.6f apart, %d values shown\n", round, apart, shown);
    assert_true(apart < 1e-3 && shown > PIXELS / 4);
  }
}

TEST(frames_stop_and_go_on_to_the_same_picture) {
  const int which = test_widest();
  tc_scene scene;
  g_auto(tc_frame) frame = {0};
  for (int cancel = 0; cancel < 2; cancel++) {
    g_autoptr(tc_volume) volume = waves(TC_F32); /* new: extracted while it is stopped */
    mesh_scene(&scene, volume, TC_PERSPECTIVE);
    scene.image.width = scene.image.height = 200;
    tc_interrupt interrupt;
    tc_interrupt_init(&interrupt);
    tc_render_request request = {.interrupt = &interrupt, .resume = true};
    GError *error = NULL;
    int stops = 0;
    if (cancel)
      atomic_store(&interrupt.cancel, true);
    else
      atomic_store(&interrupt.pause_us, 1); /* long past */
    while (!tc_render(test_renderers[which], volume, &scene, &request, &frame, &error) && stops < 2000) {
      assert_true(g_error_matches(error, TC_ERROR, cancel ? TC_ERROR_CANCELLED : TC_ERROR_PAUSED));
      g_clear_error(&error);
      if (++stops == 3 && cancel) atomic_store(&interrupt.cancel, false);
    }
    assert_true(stops >= (cancel ? 3 : 1) && stops < 2000); /* a pause: after building, however many threads there are */
    const tc_frame *whole = test_draw(which, volume, &scene, NULL, NULL);
    assert_memory_equal(frame.rgba, whole->rgba, 4 * 200 * 200);
    tc_scene_clear(&scene);
  }
}

/* The scene's list: values, labels and their colours together, each made once, whatever is done to the others. */
TEST(several_surfaces_are_one_picture) {
  const int which = test_widest();
  g_autoptr(tc_volume) labels = balls(); /* 0, 3 and 7: at 1.5 the surface of both, at 5 that of the second alone */
  g_auto(tc_scene) scene;
  tc_explanation plan;
  mesh_scene(&scene, labels, TC_PERSPECTIVE);
  test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){20, -50, 20}, (double[3]){20, 20, 20}, 50);
  scene.shading.model = TC_SHADING_NONE;
  strcpy(scene.labels.volume, "balls");
  const tc_mesh_surface list[4] = {
      {.source = TC_SURFACE_OF_VALUE, .value = 1.5, .color = {1, 0, 0}, .opacity = 0.25, .has_color = true, .visible = true},
      {.source = TC_SURFACE_OF_VALUE, .value = 5, .color = {0, 1, 0}, .opacity = 1, .has_color = true, .visible = true},
      {.source = TC_SURFACE_OF_LABEL, .label = 3, .opacity = 1, .visible = true},
      {.source = TC_SURFACE_OF_LABEL, .label = 7, .opacity = 1, .visible = false}};
  const tc_render_request request = {.want_linear = true, .labels = labels};
  size_t n;
  const double(*palette)[3] = tc_label_palette(&n);
  tc_scene_set_surfaces(&scene, g_memdup2(list, sizeof list), 4);
  const tc_frame *frame = test_draw(which, labels, &scene, &request, &plan);
  for (int c = 0; c < 3; c++) {
    assert_true(fabs(pixel_of(frame, 12)[c] - (0.25 * (c == 0) + 0.75 * palette[2][c])) < 0.01);
    assert_true(fabs(pixel_of(frame, 28)[c] - (0.25 * (c == 0) + 0.75 * (c == 1))) < 0.01);
  }
  assert_true(pixel_of(frame, 1)[3] == 0 && plan.stages[TC_STAGE_MESH].included);
  assert_non_null(strstr(plan.stages[TC_STAGE_MESH].reason, "3 of 4 surfaces"));
  const double all_ms = plan.stages[TC_STAGE_MESH].ms;
  assert_true(all_ms > 0);
  scene.mesh.surfaces[0].opacity = 0.5, scene.mesh.surfaces[1].color[2] = 1;
  frame = test_draw(which, labels, &scene, &request, &plan); /* colours and opacities: nothing is made */
  assert_true(plan.stages[TC_STAGE_MESH].ms == 0 && fabs(pixel_of(frame, 28)[2] - 0.5) < 0.01);
  scene.shading.model = TC_SHADING_LAMBERT, scene.mesh.surfaces[1].own_shading = 3; /* model none; ambient is its own too */
  frame = test_draw(which, labels, &scene, &request, NULL);
  assert_true(fabs(pixel_of(frame, 28)[2] - 0.5) < 0.01 && pixel_of(frame, 12)[2] < 0.6 * palette[2][2]);
  scene.mesh.surfaces[1].model = TC_SHADING_LAMBERT; /* facing the eye: ambient 0 and diffuse 0.7 */
  frame = test_draw(which, labels, &scene, &request, NULL);
  assert_true(fabs(pixel_of(frame, 28)[2] - 0.5 * scene.shading.diffuse) < 0.02);
  scene.mesh.lights[0] = (tc_mesh_light){.direction = {0, -1, 0}, .color = {0, 0, 1}, .intensity = 0.5}, scene.mesh.n_lights = 1;
  frame = test_draw(which, labels, &scene, &request, NULL);
  assert_true(fabs(pixel_of(frame, 28)[2] - 0.25 * scene.shading.diffuse) < 0.02 && pixel_of(frame, 28)[1] < 0.01);
  scene.shading.model = scene.mesh.surfaces[1].model = TC_SHADING_NONE, scene.mesh.n_lights = 0;
  scene.mesh.surfaces[1].visible = false, scene.mesh.surfaces[0].two_sided = true;
  frame = test_draw(which, labels, &scene, &request, &plan);
  assert_true(plan.stages[TC_STAGE_MESH].ms > 0 && fabs(pixel_of(frame, 28)[3] - 0.75) < 0.01); /* front and back of one */
  scene.mesh.surfaces[1].visible = true;
  scene.mesh.surfaces[0].value = 9; /* nowhere */
  frame = test_draw(which, labels, &scene, &request, &plan);
  assert_true(pixel_of(frame, 28)[1] == 1 && pixel_of(frame, 28)[0] == 0 && pixel_of(frame, 12)[3] == 1);
  for (size_t i = 0; i < 4; i++) scene.mesh.surfaces[i].visible = false;
  frame = test_draw(which, labels, &scene, &request, &plan);
  for (int i = 0; i < PIXELS; i++) assert_true(frame->linear[4 * i + 3] == 0);
}

/* ---- within a volume ---- */

/* The scene of balls(), seen along y from y = -50; its volume fills y from 0 to 39. */
static void scene_within(tc_scene *scene, const tc_volume *volume, tc_mode mode, double opacity) {
  mesh_scene(scene, volume, TC_ORTHOGRAPHIC);
  test_scene_look(scene, TC_ORTHOGRAPHIC, (double[3]){20, -50, 20}, (double[3]){20, 20, 20}, 50);
  scene->mode = mode;
  scene->shading.model = TC_SHADING_NONE;
  scene->window.center = 20, scene->window.width = 40;
  const tc_knot fog[2] = {{-1000, {0.2, 0.4, 0.6}, 0.03}, {1000, {0.2, 0.4, 0.6}, 0.03}};
  test_scene_knots(scene, TC_KNOT_EXTINCTION, fog, 2);
  const tc_mesh_surface ball = {.source = TC_SURFACE_OF_VALUE, .value = 64, .color = {1, 0.5, 0}, .opacity = opacity,
                                .has_color = true, .visible = true, .two_sided = true};
  tc_scene_set_surfaces(scene, g_memdup2(&ball, sizeof ball), 1);
  scene->mesh.with_volume = true;
}

typedef struct mixing {
  double clear, sum[4];
} mixing;

/* Fog of extinction 0.03 between two distances from the eye, mm. */
static void mix_volume(mixing *m, double from, double until) {
  static const double fog[3] = {0.2, 0.4, 0.6};
  from = fmax(from, 50), until = fmin(until, 89);
  const double share = m->clear * -expm1(-0.03 * (until - from));
  for (int c = 0; c < 3; c++) m->sum[c] += share * fog[c];
  m->sum[3] += share, m->clear -= share;
}

static void mix_surface(mixing *m, double opacity) {
  static const double color[3] = {1, 0.5, 0};
  for (int c = 0; c < 3; c++) m->sum[c] += m->clear * opacity * color[c];
  m->sum[3] += m->clear * opacity, m->clear *= 1 - opacity;
}

/* Squared distances from (20, 20, 20): fog is as thick everywhere, and at 64 there is a ball. */
static tc_volume *around_a_ball(void) {
  return test_volume(&(test_grid){.dims = {40, 40, 40}, .type = TC_F32}, test_radius2, (double[3]){20, 20, 20});
}

TEST(surfaces_are_between_what_is_before_and_behind_them) {
  const int which = test_widest();
  g_autoptr(tc_volume) volume = around_a_ball();
  for (int round = 0; round < 4; round++) {
    const double opacity = round & 1 ? 1 : 0.4;
    g_auto(tc_scene) scene;
    tc_explanation plan;
    scene_within(&scene, volume, TC_MODE_DVR, opacity);
    scene.sampling.rays_per_pixel = round > 1 ? 3 : 1;
    scene.sampling.termination = 0;
    const tc_frame *frame = test_draw(which, volume, &scene, NULL, &plan);
    int met = 0;
    for (int i = 0; i < PIXELS; i++) {
      const double x = (i % SIDE + 0.5) * 50 / SIDE - 25, z = (i / SIDE + 0.5) * 50 / SIDE - 25, r2 = x * x + z * z;
      if ((r2 > 49 && r2 < 81) || fabs(x) > 18 || fabs(z) > 18) continue; /* outlines */
      mixing m = {.clear = 1};
      if (r2 < 49) {
        const double deep = sqrt(64 - r2); /* values are lower inside: the surface faces inwards, and is seen from behind */
        mix_volume(&m, 0, 70 - deep), mix_surface(&m, opacity);
        mix_volume(&m, 70 - deep, 70 + deep), mix_surface(&m, opacity);
        mix_volume(&m, 70 + deep, 1000);
        met++;
      } else {
        mix_volume(&m, 0, 1000);
      }
      for (int c = 0; c < 4; c++) assert_true(fabs(m.sum[c] - frame->linear[4 * i + c]) < 0.004);
    }
    assert_true(met > 400 && plan.stages[TC_STAGE_MESH].included && plan.stages[TC_STAGE_TABLE_2D].included);
  }
}

TEST(layers_are_bounded) {
  const unsigned most = tc_mesh_most_layers;
  g_autoptr(tc_volume) volume = around_a_ball();
  g_auto(tc_scene) scene;
  g_auto(tc_frame) frame = {0};
  GError *error = NULL;
  scene_within(&scene, volume, TC_MODE_DVR, 0.4);
  tc_mesh_most_layers = 500;
  assert_false(tc_render(test_renderers[test_widest()], volume, &scene, NULL, &frame, &error));
  tc_mesh_most_layers = most;
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_LIMIT) && strstr(error->message, "more than 500 layers"));
  assert_string_equal(tc_error_pointer(error), "/mesh/surfaces");
  g_clear_error(&error);
  assert_true(tc_render(test_renderers[test_widest()], volume, &scene, NULL, &frame, NULL));
}

/* Brightness y / 40 grows along the rays: what is in front of a surface is darker than what is behind it. */
TEST(surfaces_end_and_divide_maxima) {
  const int which = test_widest();
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {40, 40, 40}, .type = TC_F32}, test_linear, (double[4]){0, 1, 0, 0});
  for (int round = 0; round < 3; round++) {
    const double opacity = round ? 1 : 0.4;
    g_auto(tc_scene) scene;
    scene_within(&scene, volume, TC_MODE_MIP, opacity);
    scene.mesh.surfaces[0].value = 15; /* the plane y = 15 */
    if (round == 2) scene.clip.planes[0][0] = 1, scene.clip.planes[0][3] = -20, scene.clip.n_planes = 1;
    const tc_frame *frame = test_draw(which, volume, &scene, NULL, NULL);
    for (int i = 0; i < PIXELS; i++) {
      static const double color[3] = {1, 0.5, 0};
      const double x = (i % SIDE + 0.5) * 50 / SIDE - 25, z = (i / SIDE + 0.5) * 50 / SIDE - 25;
      if (fabs(x) > 18 || fabs(z) > 18 || (round == 2 && x < 1)) continue;
      for (int c = 0; c < 3; c++) {
        const double before = 15 / 40.0, behind = (1 - opacity) * (39 - 15) / 40.0;
        assert_true(fabs(before + (1 - before) * opacity * color[c] + behind - frame->linear[4 * i + c]) < 0.004);
      }
      assert_true(fabs(frame->linear[4 * i + 3] - 1) < 1e-5);
    }
    scene.mesh.surfaces[0].visible = false; /* parts of one: the maximum itself */
    frame = test_draw(which, volume, &scene, NULL, NULL);
    assert_true(fabs(frame->linear[4 * (SIDE / 2 * SIDE + SIDE / 2 + 5)] - 39 / 40.0) < 0.001);
  }
}

/* Three slices through (10, 12, 14), seen in perspective: each shows the field where it is met, in front of the others. */
TEST(slices_show_the_field_where_they_are) {
  static const double at[3] = {10, 12, 14}, ramp[4] = {0.01, 0.005, 0.008, 0};
  const int which = test_widest();
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {40, 40, 40}, .type = TC_F32}, test_linear, ramp);
  g_auto(tc_scene) scene;
  mesh_scene(&scene, volume, TC_PERSPECTIVE);
  scene.window.center = 0.4, scene.window.width = 1;
  scene.mpr.has_center = true;
  memcpy(scene.mpr.center, at, sizeof at);
  tc_mesh_surface planes[3] = {{.plane = TC_SAGITTAL}, {.plane = TC_CORONAL}, {.plane = TC_AXIAL}};
  for (int i = 0; i < 3; i++) planes[i].source = TC_SURFACE_OF_PLANE, planes[i].opacity = planes[i].visible = planes[i].two_sided = 1;
  tc_scene_set_surfaces(&scene, g_memdup2(planes, sizeof planes), 3);
  const tc_render_request request = {.want_linear = true, .want_depth = true};
  const tc_frame *frame = test_draw(which, volume, &scene, &request, NULL);
  const tc_camera *c = &scene.camera;
  double forward[3], right[3], down[3], length = 0, across = 0;
  for (int k = 0; k < 3; k++) forward[k] = c->target[k] - c->position[k], length += forward[k] * forward[k];
  for (int k = 0; k < 3; k++) forward[k] /= sqrt(length);
  for (int k = 0; k < 3; k++) right[k] = forward[(k + 1) % 3] * c->up[(k + 2) % 3] - forward[(k + 2) % 3] * c->up[(k + 1) % 3];
  for (int k = 0; k < 3; k++) across += right[k] * right[k];
  for (int k = 0; k < 3; k++) right[k] /= sqrt(across);
  for (int k = 0; k < 3; k++) down[k] = forward[(k + 1) % 3] * right[(k + 2) % 3] - forward[(k + 2) % 3] * right[(k + 1) % 3];
  int compared = 0;
  for (int i = 0; i < PIXELS; i++) {
    const double scale = tan(c->fov_y_deg * M_PI / 360) * 2 / SIDE, x = (i % SIDE + 0.5 - SIDE / 2.0) * scale,
                 y = (i / SIDE + 0.5 - SIDE / 2.0) * scale, norm = sqrt(1 + x * x + y * y);
    double ray[3], nearest = INFINITY, value = 0;
    bool certain = true;
    for (int k = 0; k < 3; k++) ray[k] = (forward[k] + x * right[k] + y * down[k]) / norm;
    for (int plane = 0; plane < 3; plane++) {
      const double t = (at[plane] - c->position[plane]) / ray[plane];
      double inside = INFINITY, here = 0;
      for (int k = 0; k < 3; k++) {
        const double p = c->position[k] + t * ray[k];
        if (k != plane) inside = fmin(inside, fmin(p, 39 - p));
        here += ramp[k] * p;
      }
      if (fabs(inside) < 0.1 || fabs(t - nearest) < 0.1) certain = false;
      if (inside > 0 && t < nearest) nearest = t, value = here;
    }
    if (!certain) continue;
    compared++;
    assert_true(isfinite(nearest) == (frame->linear[4 * i + 3] == 1));
    if (!isfinite(nearest)) continue;
    assert_true(fabs(frame->depth[i] - nearest) < 0.02);
    assert_true(fabs((double)frame->linear[4 * i] - fmin(fmax(value - 0.4 + 0.5, 0), 1)) < 0.002);
  }
  assert_true(compared > PIXELS * 3 / 4);
}

TEST(what_cannot_be_is_refused) {
  const tc_renderer_options small = {.threads = 1, .backend = TC_BACKEND_CPU, .cache_bytes = 100000};
  g_autoptr(tc_renderer) renderer = tc_renderer_new(&small, NULL);
  g_autoptr(tc_volume) volume = waves(TC_U8);
  g_auto(tc_scene) scene;
  g_auto(tc_frame) frame = {0};
  GError *error = NULL;
  mesh_scene(&scene, volume, TC_PERSPECTIVE);
  assert_false(tc_render(renderer, volume, &scene, NULL, &frame, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_LIMIT));
  g_clear_error(&error);
  scene.isosurface.value = NAN;
  assert_false(tc_render(renderer, volume, &scene, NULL, &frame, &error));
  assert_string_equal(tc_error_pointer(error), "/isosurface/value");
  g_clear_error(&error);
  tc_mesh_surface one = {.source = TC_SURFACE_OF_LABEL, .label = 3, .opacity = 1, .visible = true};
  tc_scene_set_surfaces(&scene, g_memdup2(&one, sizeof one), 1);
  assert_false(tc_render(renderer, volume, &scene, NULL, &frame, &error));
  assert_string_equal(tc_error_pointer(error), "/mesh/surfaces/0"); /* no volume of labels */
  g_clear_error(&error);
}

TESTS(test_renderers_open, test_renderers_close)
