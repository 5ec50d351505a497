/* Labels that tint and hide, on every instruction set and on OpenGL: against closed forms and against the trilinear
 * mean written out in double precision. */
#include "tests/support/test.h"

#include "renderer/reference/reference.h"
#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/image.h"
#include "tests/support/renderers.h"

enum { SIDE = 48, PIXELS = SIDE * SIDE };

static const float *render(int which, tc_volume *volume, const tc_volume *labels, const tc_scene *scene,
                           tc_explanation *plan) {
  const tc_render_request request = {.want_linear = true, .labels = labels};
  return test_draw(which, volume, scene, &request, plan)->linear;
}

/* ---- scenes ---- */

static const tc_knot soft[] = {{.value = 0, .color = {0.1, 0.2, 1}, .amount = 0},
                               {.value = 0.4, .color = {0.3, 0.9, 0.4}, .amount = 0},
                               {.value = 1, .color = {1, 0.6, 0.2}, .amount = 0.5}};

/* colors: for labels 1 .. count. */
static void with_labels(tc_scene *scene, double opacity, const double (*colors)[4], size_t count) {
  strcpy(scene->labels.volume, "labels");
  scene->labels.opacity = opacity;
  g_free(scene->labels.colors);
  scene->labels.colors = g_new0(tc_label_color, count + 1);
  scene->labels.n_colors = count;
  for (size_t i = 0; i < count; i++) {
    scene->labels.colors[i].label = (uint32_t)i + 1;
    memcpy(scene->labels.colors[i].rgba, colors[i], sizeof *colors);
  }
}

static void show_only(tc_scene *scene, const uint32_t *visible, size_t count) {
  g_free(scene->labels.visible);
  scene->labels.visible = g_new0(uint32_t, count + 1);
  scene->labels.n_visible = count;
  for (size_t i = 0; i < count; i++) scene->labels.visible[i] = visible[i];
}

static const double some_colors[4][4] = {{1, 0, 0, 1}, {0, 1, 0, 0.5}, {0, 0.2, 1, 1}, {1, 1, 0, 0.8}};

/* A slice across z at mm z, pixels of extent / SIDE mm; everything it meets is grey 0.5. */
static void slice_scene(tc_scene *scene, double z) {
  test_scene(scene, SIDE, SIDE);
  scene->mode = TC_MODE_MPR;
  scene->mpr.has_center = true;
  scene->mpr.center[0] = scene->mpr.center[1] = 12;
  scene->mpr.center[2] = z;
  scene->window.center = 7;
  scene->window.width = 10;
}

static tc_volume *seven(void) {
  return test_volume(&(test_grid){.dims = {25, 25, 25}, .type = TC_I16}, test_constant, &(double){7});
}

static double halves(double x, double y, double z, const void *context) { return x < *(const double *)context ? 1 : 2; }

static double specks(double x, double y, double z, const void *seed) { return floor(5 * test_noise(x, y, z, seed)); }

/* A grid of its own: turned about a slanted axis, other spacings, not all of the volume inside. */
static tc_volume *slanted_labels(tc_voxel_type type, const int dims[3], unsigned seed) {
  double axis[3] = {0.48, 0.6, 0.64}, angle = 0.7, c = cos(angle), s = sin(angle);
  test_grid grid = {
      .dims = {dims[0], dims[1], dims[2]}, .type = type, .spacing = {1.7, 2.3, 1.1}, .origin = {4, 3, 5.5}};
  for (int r = 0; r < 3; r++)
    for (int k = 0; k < 3; k++) {
      double cross = r == k ? 0 : (k - r + 3) % 3 == 1 ? -axis[3 - r - k] : axis[3 - r - k];
      grid.direction[3 * r + k] = (r == k ? c : 0) + (1 - c) * axis[r] * axis[k] + s * cross;
    }
  return test_volume(&grid, specks, &seed);
}

static int label_of(const tc_volume *labels, const int at[3]) {
  const tc_volume_desc *d = tc_volume_describe(labels);
  for (int k = 0; k < 3; k++)
    if (at[k] < 0 || at[k] >= d->dims[k]) return 0;
  size_t i = ((size_t)at[2] * (size_t)d->dims[1] + (size_t)at[1]) * (size_t)d->dims[0] + (size_t)at[0];
  const void *voxels = tc_volume_data(labels);
  switch (d->type) {
  case TC_U8: return ((const uint8_t *)voxels)[i];
  case TC_I8: return ((const int8_t *)voxels)[i];
  case TC_U16: return ((const uint16_t *)voxels)[i];
  default: return ((const int16_t *)voxels)[i];
  }
}

/* What lies over grey 0.5 at a place: each of the eight voxels around it with its weight; with filter nearest the nearest alone, of
 * two equally near ones the upper. */
static void overlay_at(const tc_volume *labels, const tc_scene *scene, const double lps[3], double rgb[3]) {
  const tc_volume_desc *d = tc_volume_describe(labels);
  double index[3], sum[4] = {0};
  tc_volume_lps_to_index(labels, lps, index);
  for (int k = 0; k < 3 && scene->filter == TC_FILTER_NEAREST; k++) index[k] = floor(index[k] + 0.5 + 1e-6);
  for (int corner = 0; corner < 8; corner++) {
    int at[3];
    double weight = 1;
    for (int k = 0; k < 3; k++) {
      at[k] = (int)floor(index[k]) + (corner >> k & 1);
      double share = 1 - fabs(index[k] - at[k]);
      if (d->dims[k] == 1) { /* constant over its thickness */
        at[k] = 0;
        share = !(corner >> k & 1) && fabs(index[k]) <= 0.5;
      }
      weight *= share;
    }
    int label = label_of(labels, at);
    if (label < 1) continue;
    const double *color = scene->labels.colors[label - 1].rgba;
    for (int c = 0; c < 3; c++) sum[c] += weight * scene->labels.opacity * color[3] * color[c];
    sum[3] += weight * scene->labels.opacity * color[3];
  }
  for (int c = 0; c < 3; c++) rgb[c] = 0.5 * (1 - sum[3]) + sum[c];
}

/* ---- what labels do ---- */

TEST(every_place_has_the_mean_of_its_eight_labels) {
  static const int shapes[][3] = {{9, 8, 14}, {1, 9, 12}, {10, 1, 9}, {9, 7, 1}, {1, 1, 1}, {2, 2, 2}};
  g_autoptr(tc_volume) volume = seven();
  double worst[RENDERERS] = {0}, tinted = 0;
  for (size_t shape = 0; shape < sizeof shapes / sizeof *shapes; shape++)
    for (int type = TC_U8; type < TC_F32; type++) {
      g_autoptr(tc_volume) labels = slanted_labels((tc_voxel_type)type, shapes[shape], (unsigned)(10 * type));
      g_auto(tc_scene) scene;
      slice_scene(&scene, 6.3);
      with_labels(&scene, 0.7, some_colors, 4);
      scene.filter = shape == 0 && type == TC_I16 ? TC_FILTER_NEAREST : TC_FILTER_LINEAR;
      EACH_RENDERER(i) {
        const float *image = render(i, volume, labels, &scene, NULL);
        size_t off = 0;
        for (int p = 0; p < PIXELS; p++) {
          double lps[3] = {(p % SIDE + 0.5) * 0.5, (p / SIDE + 0.5) * 0.5, 6.3}, want[3], error = 0;
          overlay_at(labels, &scene, lps, want);
          for (int c = 0; c < 3; c++) error = fmax(error, fabs(want[c] - (double)image[4 * p + c]));
          tinted += error < 1e-4 && fabs(want[0] - 0.5) > 0.01;
          off += error > 2e-5; /* a tie between voxels */
          if (error <= 2e-5) worst[i] = fmax(worst[i], error);
          assert_true(image[4 * p + 3] == 1);
        }
        if (off > 4) fail_msg("%s: %zu pixels are off", test_names[i], off);
      }
    }
  EACH_RENDERER(i) printf("  %-7s overlay of slanted labels: max %.1e\n", test_names[i], worst[i]);
  assert_true(tinted > PIXELS);
}

/* Three pixels a label voxel: every third column and row of pixels, the slice, and the faces of the grid lie halfway between two
 * voxels. All pixels there show the upper voxel. */
TEST(halfway_between_labels_the_upper_shows) {
  g_autoptr(tc_volume) volume = seven();
  g_auto(tc_scene) scene;
  slice_scene(&scene, 6.25);
  with_labels(&scene, 0.7, some_colors, 4);
  scene.filter = TC_FILTER_NEAREST;
  for (unsigned seed = 0; seed < 6; seed++) {
    const double place = 3.3 + 0.5 * seed; /* moves the grid by whole pixels */
    const test_grid grid = {.dims = {9, 8, 7}, .type = TC_U8, .spacing = {1.5, 1.5, 1.5}, .origin = {place + 0.7, place + 0.2, 4 + 1.5 * (seed % 2)}};
    g_autoptr(tc_volume) labels = test_volume(&grid, specks, &seed);
    EACH_RENDERER(i) {
      const float *image = render(i, volume, labels, &scene, NULL);
      for (int p = 0; p < PIXELS; p++) {
        const double lps[3] = {(p % SIDE + 0.5) * 0.5, (p / SIDE + 0.5) * 0.5, 6.25};
        double want[3];
        overlay_at(labels, &scene, lps, want);
        for (int c = 0; c < 3; c++)
          if (fabs(want[c] - (double)image[4 * p + c]) > 2e-5)
            fail_msg("%u, %s: pixel %d,%d is %g, expected %g", seed, test_names[i], p % SIDE, p / SIDE, (double)image[4 * p + c], want[c]);
      }
    }
  }
}

/* Along a face the overlay rises linearly from one voxel centre to the next: no step is larger than a pixel's share. */
TEST(faces_are_smooth) {
  g_autoptr(tc_volume) volume = seven();
  g_autoptr(tc_volume) labels =
      test_volume(&(test_grid){.dims = {7, 7, 7}, .type = TC_U8, .spacing = {4, 4, 4}}, halves, &(double){3});
  g_auto(tc_scene) scene;
  slice_scene(&scene, 12);
  with_labels(&scene, 1, (const double[2][4]){{0, 0, 0, 1}, {1, 1, 1, 1}}, 2);
  EACH_RENDERER(i) {
    const float *row = render(i, volume, labels, &scene, NULL) + SIDE / 2 * SIDE * 4;
    double largest = 0;
    for (int x = 0; x < SIDE; x++) {
      double want = fmin(fmax(((x + 0.5) * 0.5 - 8) / 4, 0), 1); /* voxel centres at 8 and 12 mm */
      if (fabs((double)row[4 * x] - want) > 1e-6)
        fail_msg("%s: %g at %d, not %g", test_names[i], (double)row[4 * x], x, want);
      if (x > 0) largest = fmax(largest, (double)row[4 * x] - (double)row[4 * x - 4]);
    }
    if (fabs(largest - 0.125) > 1e-5) fail_msg("%s: a step of %g", test_names[i], largest);
  }
}

/* A medium of one extinction through which rays run along z, 24 mm long; labels change along x between 8 and 12 mm. */
static void medium_scene(tc_scene *scene, double extinction) {
  test_scene(scene, SIDE, SIDE);
  test_scene_knots(scene, TC_KNOT_EXTINCTION, &(tc_knot){.value = 7, .color = {0.2, 0.4, 0.6}, .amount = extinction},
                   1);
  test_scene_look(scene, TC_ORTHOGRAPHIC, (double[3]){12, 12, -50}, (double[3]){12, 12, 12}, 20);
  scene->camera.up[0] = scene->camera.up[2] = 0;
  scene->camera.up[1] = -1;
}

static double stripes(double x, double y, double z, const void *context) { return 1 + fmod(x, 2); }

/* Parallel rays, three a label voxel: every third runs halfway between two. The reference, too, is judged. */
TEST(rays_between_labels_meet_the_upper) {
  static const double colors[2][4] = {{1, 0, 0, 1}, {0, 1, 0, 1}};
  g_autoptr(tc_volume) volume = seven();
  g_autoptr(tc_volume) labels = test_volume(
      &(test_grid){.dims = {20, 25, 25}, .type = TC_U8, .spacing = {1.25, 1, 1}, .origin = {0.75 + 1e-10, 0, 0}}, stripes, NULL); /* plus a rounding error */
  g_auto(tc_scene) scene;
  medium_scene(&scene, 0.1);
  with_labels(&scene, 1, colors, 2);
  scene.filter = TC_FILTER_NEAREST;
  const tc_reference_request of = {.volume = volume, .labels = labels, .scene = &scene, .width = SIDE, .height = SIDE};
  g_autofree float *wanted = g_new(float, PIXELS * 4);
  tc_reference *reference = tc_reference_make(&of, NULL);
  assert_true(tc_reference_image(reference, 2, wanted, NULL));
  tc_reference_free(reference);
  for (int i = 0; i <= RENDERERS; i++) { /* the last: the reference */
    if (i < RENDERERS && !test_renderers[i]) continue;
    const float *image = i < RENDERERS ? render(i, volume, labels, &scene, NULL) : wanted;
    for (int p = 0; p < PIXELS; p++) {
      const double voxel = floor((p % SIDE + 0.5) / 3 + 1 + 0.5 + 1e-6), *color = colors[(int)fmod(voxel, 2)];
      for (int c = 0; c < 3; c++)
        if (fabs((double)image[4 * p + c] - -expm1(-2.4) * color[c]) > 1e-4)
          fail_msg("%s: pixel %d,%d is %g", i < RENDERERS ? test_names[i] : "reference", p % SIDE, p / SIDE, (double)image[4 * p + c]);
    }
  }
}

TEST(hiding_thins_the_medium_and_tint_colours_it) {
  g_autoptr(tc_volume) volume = seven();
  g_autoptr(tc_volume) labels =
      test_volume(&(test_grid){.dims = {7, 7, 7}, .type = TC_I8, .spacing = {4, 4, 4}}, halves, &(double){3});
  g_auto(tc_scene) scene;
  medium_scene(&scene, 0.1);
  with_labels(&scene, 0.5, (const double[2][4]){{1, 0, 0, 0.5}, {0, 1, 0, 1}}, 2);
  for (int hidden = 0; hidden < 2; hidden++) {
    if (hidden) show_only(&scene, (const uint32_t[]){2}, 1);
    for (int step = 0; step < 2; step++) {
      scene.sampling.step = step ? 0.77 : 1; /* a last segment that is short */
      EACH_RENDERER(i) {
        const float *row = render(i, volume, labels, &scene, NULL) + SIDE / 2 * SIDE * 4;
        for (int x = 0; x < SIDE; x++) {
          double mm = 2 + (x + 0.5) * 20 / SIDE, second = fmin(fmax((mm - 8) / 4, 0), 1), seen = hidden ? second : 1;
          double alpha = -expm1(-2.4 * seen), red = hidden ? 0 : 0.25 * (1 - second),
                 green = hidden ? 0.5 : 0.5 * second;
          const double base[3] = {0.2, 0.4, 0.6}, tint[3] = {red, green, 0};
          for (int c = 0; c < 4; c++) {
            double want = c == 3 ? alpha : alpha * (base[c] * (1 - red - green) + tint[c]);
            if (fabs((double)row[4 * x + c] - want) > 1e-5)
              fail_msg("%s, hidden %d: channel %d at %g mm is %g, not %g", test_names[i], hidden, c, mm,
                       (double)row[4 * x + c], want);
          }
          if (hidden && second == 0) assert_true(row[4 * x + 3] == 0); /* nothing at all is left */
        }
      }
    }
  }
}

/* An opaque body takes exactly the label's colour; labels without a tint change no bit. */
TEST(full_and_empty_tints_are_exact) {
  g_autoptr(tc_volume) volume = seven();
  g_autoptr(tc_volume) labels = test_volume(&(test_grid){.dims = {25, 25, 25}, .type = TC_U16}, test_constant, &(double){40000});
  g_auto(tc_scene) scene;
  medium_scene(&scene, 5);
  static float plain[PIXELS * 4];
  with_labels(&scene, 1, NULL, 0);
  size_t count;
  const double *color = tc_label_palette(&count)[39999 % TC_LABEL_PALETTE];
  EACH_RENDERER(i) {
    scene.labels.opacity = 1;
    const float *p = render(i, volume, labels, &scene, NULL) + (SIDE / 2 * SIDE + SIDE / 2) * 4;
    for (int c = 0; c < 3; c++) assert_true(fabs((double)p[c] - color[c]) < 1e-6);
    scene.labels.volume[0] = 0;
    memcpy(plain, render(i, volume, NULL, &scene, NULL), sizeof plain);
    strcpy(scene.labels.volume, "labels");
    scene.labels.opacity = 0;
    p = render(i, volume, labels, &scene, NULL);
    for (int k = 0; k < PIXELS * 4; k++)
      if (fabsf(p[k] - plain[k]) > (i == GL ? 1e-6f : 0))
        fail_msg("%s: %g became %g", test_names[i], (double)plain[k], (double)p[k]);
  }
  assert_int_equal(count, TC_LABEL_PALETTE);
}

/* ---- agreement ---- */

static tc_volume *waves(tc_voxel_type type) {
  return test_volume(&(test_grid){.dims = {24, 20, 22}, .type = type, .slope = type == TC_F32 ? 1 : 0.01}, test_waves,
                     &(double){14});
}

static void busy_scene(tc_scene *scene, const tc_volume *volume, unsigned bits) {
  test_scene(scene, SIDE, SIDE);
  test_scene_knots(scene, TC_KNOT_EXTINCTION, soft, 3);
  test_scene_frame(scene, volume, bits & 1 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, (double[3]){1, -0.6, 0.4});
  with_labels(scene, 0.6, some_colors, 4);
  if (bits & 2) show_only(scene, (const uint32_t[]){3, 0, 1}, 3);
  if (bits & 4) scene->shading.model = TC_SHADING_BLINN_PHONG;
  if (bits & 8) scene->sampling.termination = 0.01;
  if (bits & 16) scene->skipping.mode = TC_SKIPPING_OFF;
  scene->image.linear_light = bits % 3 == 1;
  if (bits & 32) { /* with the rest of what a ray may have */
    scene->clip.n_planes = 1;
    scene->clip.planes[0][0] = 1;
    scene->sampling.rays_per_pixel = 2;
    scene->sampling.jitter = scene->sampling.coherence = true;
  }
  if (bits % 4 != 3) return;
  scene->mode = TC_MODE_MPR;
  scene->mpr.orientation = TC_OBLIQUE;
  scene->mpr.normal[0] = 0.3;
  scene->mpr.thickness_mm = bits & 8 ? 5 : 0;
  scene->mpr.projection = TC_SLAB_AVERAGE;
  scene->filter = bits & 16 ? TC_FILTER_NEAREST : TC_FILTER_LINEAR;
}

TEST(everyone_agrees) {
  double worst[RENDERERS] = {0};
  size_t ties = 0, compared = 0;
  for (unsigned number = 0; number < 33; number++) {
    unsigned bits = number < 32 ? number : 32 + 8 + 4;
    g_autoptr(tc_volume) volume = waves((tc_voxel_type)(bits * 7 / 3 % TC_VOXEL_TYPE_COUNT));
    g_autoptr(tc_volume) labels = slanted_labels((tc_voxel_type)(bits % TC_F32), (const int[3]){9, 8, 14}, bits);
    g_auto(tc_scene) scene;
    busy_scene(&scene, volume, bits);
    render(SCALAR, volume, labels, &scene, NULL);
    EACH_RENDERER(i) {
      if (i == SCALAR) continue;
      const float *a = render(i, volume, labels, &scene, NULL), *b = test_frames[SCALAR].linear;
      assert_true(test_compare(a, b, PIXELS).finite);
      for (int p = 0; p < PIXELS; p++) {
        const double d = test_pixel_off(a, b, (size_t)p);
        for (int c = 4 * p; c < 4 * p + 4; c++) assert_true(a[c] >= 0 && a[c] <= (c % 4 == 3 ? 1 : a[4 * p + 3]));
        compared++;
        ties += d > 1.0 / 255;
        if (d <= 1.0 / 255) worst[i] = fmax(worst[i], d);
      }
    }
  }
  EACH_RENDERER(i) printf("  %-7s against scalar: max %.1e\n", test_names[i], worst[i]);
  printf("  %zu of %zu pixels are ties\n", ties, compared);
  assert_true((double)ties < 1e-4 * (double)compared);
}

/* With smaller steps pictures go to the integral of what is visible; errors fall with the step's square, or nearly. */
TEST(small_steps_converge_to_the_reference) {
  tc_volume *volume = waves(TC_F32), *labels = slanted_labels(TC_U8, (const int[3]){9, 8, 14}, 3);
  g_autofree float *wanted = g_new(float, PIXELS * 4);
  for (unsigned bits = 1; bits < 7; bits += 5) { /* plain; shaded, some hidden, parallel */
    g_auto(tc_scene) scene;
    busy_scene(&scene, volume, bits);
    scene.image.width = scene.image.height = SIDE / 2;
    const tc_reference_request of = {
        .volume = volume, .labels = labels, .scene = &scene, .width = SIDE / 2, .height = SIDE / 2, .tolerance = 1e-7};
    tc_reference *reference = tc_reference_make(&of, NULL);
    assert_null(tc_reference_new(volume, &scene, SIDE / 2, SIDE / 2, 1e-7, NULL));
    assert_true(tc_reference_image(reference, 2, wanted, NULL));
    tc_reference_free(reference);
    EACH_RENDERER(i) {
      double rms[2];
      for (int fine = 0; fine < 2; fine++) {
        scene.sampling.step = fine ? 0.05 : 0.2;
        rms[fine] = test_compare(render(i, volume, labels, &scene, NULL), wanted, PIXELS / 4).rms;
      }
      printf("  %-7s %s: rms %.1e at a step of 0.2, %.1e at 0.05\n", test_names[i],
             bits > 1 ? "shaded, hidden" : "plain", rms[0], rms[1]);
      if (!(rms[1] < 5e-4 && rms[1] < 0.5 * rms[0])) fail_msg("%s does not converge", test_names[i]);
    }
  }
  tc_volume_unref(labels);
  tc_volume_unref(volume);
}

TEST(leaping_changes_no_bit_and_threads_none) {
  static float before[PIXELS * 4];
  g_autoptr(tc_renderer) one =
      tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU, .threads = 1, .isa = "scalar"}, NULL);
  uint64_t leaps = 0;
  for (unsigned bits = 0; bits < 16; bits++) {
    if (bits % 4 == 3) continue;
    g_autoptr(tc_volume) volume = waves(TC_U16);
    g_autoptr(tc_volume) labels = slanted_labels(TC_U8, (const int[3]){9, 8, 14}, bits);
    g_auto(tc_scene) scene;
    busy_scene(&scene, volume, bits);
    scene.skipping.block = 4;
    EACH_RENDERER(i) {
      scene.skipping.mode = TC_SKIPPING_OFF;
      memcpy(before, render(i, volume, labels, &scene, NULL), sizeof before);
      scene.skipping.mode = TC_SKIPPING_AUTO;
      assert_memory_equal(before, render(i, volume, labels, &scene, NULL), sizeof before);
      leaps += test_frames[i].stats.leaps;
    }
    g_auto(tc_frame) frame = {0};
    assert_true(tc_render(one, volume, &scene, &(tc_render_request){.labels = labels}, &frame, NULL));
    assert_memory_equal(frame.rgba, test_frames[SCALAR].rgba, PIXELS * 4);
  }
  assert_true(leaps > 0);
}

/* ---- the plan ---- */

static void refused(tc_volume *volume, const tc_volume *labels, const tc_scene *scene, const char *word) {
  EACH_RENDERER(i) {
    GError *error = NULL;
    tc_explanation plan;
    tc_render_request request = {.labels = labels};
    assert_false(tc_render(test_renderers[i], volume, scene, &request, &test_frames[i], &error));
    assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_INVALID));
    assert_string_equal(tc_error_pointer(error), "/labels/volume");
    if (!strstr(error->message, word)) fail_msg("\"%s\" does not say \"%s\"", error->message, word);
    g_clear_error(&error);
    assert_false(tc_renderer_explain(test_renderers[i], volume, scene, &(tc_render_request){.labels = labels}, &plan, NULL));
  }
}

TEST(what_is_no_label_volume_is_refused) {
  tc_volume *volume = waves(TC_U8);
  tc_volume *floats = waves(TC_F32);
  tc_volume *far =
      test_volume(&(test_grid){.dims = {9, 9, 9}, .type = TC_U8, .origin = {0, 0, 500}}, test_constant, &(double){1});
  tc_volume *halved =
      test_volume(&(test_grid){.dims = {9, 9, 9}, .type = TC_U8, .slope = 0.5}, test_constant, &(double){1});
  tc_scene scene;
  busy_scene(&scene, volume, 0);
  refused(volume, NULL, &scene, "no such volume");
  refused(volume, floats, &scene, "f32");
  refused(volume, halved, &scene, "fractions");
  refused(volume, far, &scene, "outside");
  tc_scene_clear(&scene);
  tc_volume *all[] = {volume, floats, far, halved};
  for (int i = 0; i < 4; i++) tc_volume_unref(all[i]);
}

TEST(the_plan_names_labels_where_they_are_read) {
  tc_volume *volume = waves(TC_U8), *labels = slanted_labels(TC_U8, (const int[3]){9, 8, 14}, 1);
  g_auto(tc_scene) scene;
  tc_explanation plan;
  busy_scene(&scene, volume, 2);
  EACH_RENDERER(i) {
    scene.mode = TC_MODE_DVR;
    scene.labels.opacity = 0.3 + 0.1 * i;
    render(i, volume, labels, &scene, &plan);
    assert_true(plan.stages[TC_STAGE_LABELS].included && plan.stages[TC_STAGE_LABELS].bytes > 0);
    assert_true(plan.stages[TC_STAGE_LABELS].ms > 0 && strstr(plan.stages[TC_STAGE_LABELS].reason, "3 show"));
    assert_non_null(strstr(plan.kernel, ".labels"));
    scene.camera.fov_y_deg -= 1; /* a camera builds nothing */
    render(i, volume, labels, &scene, &plan);
    assert_true(plan.stages[TC_STAGE_LABELS].ms == 0 && test_frames[i].stats.tables_ms == 0);
    scene.mode = TC_MODE_MIP; /* needs neither the labels nor their volume */
    render(i, volume, NULL, &scene, &plan);
    assert_false(plan.stages[TC_STAGE_LABELS].included || plan.key.labels);
    assert_non_null(strstr(plan.stages[TC_STAGE_LABELS].reason, "mode mip"));
    tc_renderer_forget(test_renderers[i], labels);
  }
  tc_volume_unref(labels);
  tc_volume_unref(volume);
}

/* A volume may be its own labels, and GL keeps both in one frame. */
TEST(a_volume_may_be_its_own_labels) {
  g_autoptr(tc_volume) volume = slanted_labels(TC_U16, (const int[3]){14, 12, 13}, 5);
  g_auto(tc_scene) scene;
  test_scene(&scene, SIDE, SIDE);
  scene.mode = TC_MODE_MPR;
  scene.window.center = 2, scene.window.width = 4;
  with_labels(&scene, 0.8, some_colors, 4);
  render(SCALAR, volume, volume, &scene, NULL);
  EACH_RENDERER(i) {
    test_difference d;
    for (int twice = 0; twice < 2; twice++)
      d = test_compare(render(i, volume, volume, &scene, NULL), test_frames[SCALAR].linear, PIXELS);
    assert_true(d.finite && d.p999 < 1.0 / 255);
  }
}

TESTS(test_renderers_open, test_renderers_close)
