/* The reference integrator against closed forms, and against itself at other tolerances. Errors are printed as numbers. */
#include "tests/support/reference.h"

/* A slab along x: 11 voxels of 1 mm, so a chord of 10 mm; the field is a + b x. */
static tc_volume *slab(double a, double b) {
  return test_volume(&(test_grid){.dims = {11, 3, 3}, .type = TC_F32}, test_linear, (double[4]){b, 0, 0, a});
}
static const double slab_from[3] = {-5, 1.2, 0.7}, slab_to[3] = {20, 1.2, 0.7};

/* ---- closed forms ---- */

TEST(homogeneous_slab) {
  double worst = 0, worst_relative = 0;
  g_autoptr(tc_volume) volume = slab(0.5, 0);
  for (int e = -13; e <= 12; e++) {
    double tau = pow(10, e), rgba[4];
    tc_knot knot = {.value = 0, .color = {1, 0.25, 0.5}, .amount = tau};
    g_auto(tc_scene) scene = knots_scene(TC_KNOT_EXTINCTION, &knot, 1);
    one_ray(volume, &scene, slab_from, slab_to, 0, rgba);
    double alpha = -expm1(-10 * tau);
    worst = fmax(worst, fmax(bad(rgba[3], alpha), bad(rgba[1], 0.25 * alpha)));
    worst_relative = fmax(worst_relative, fmax(bad(rgba[3], alpha), bad(rgba[0], alpha)) / alpha);
    assert_true(rgba[3] <= 1 && rgba[0] <= rgba[3] * (1 + 1e-15));
  }
  report("homogeneous slab, tau*d 1e-12 .. 1e13", worst, 1e-14);
  report("homogeneous slab, relative", worst_relative, 1e-13);

  for (int i = 0; i < 2; i++) {
    double opacity = i ? 1 : 0.3, rgba[4];
    tc_knot knot = {.value = 0, .color = {1, 1, 1}, .amount = opacity};
    g_auto(tc_scene) scene = knots_scene(TC_KNOT_OPACITY, &knot, 1);
    scene.transfer_function.unit_distance_mm = i ? 20 : 4;
    one_ray(volume, &scene, slab_from, slab_to, 0, rgba);
    report(i ? "opacity 1 per 20 mm over 10 mm" : "opacity 0.3 per 4 mm over 10 mm",
           bad(rgba[3], i ? 1 - pow(0x1p-24, 0.5) : 1 - pow(0.7, 2.5)), 1e-13);
  }
}

/* tau = k s with s from 0 to 10 along x; colour constant, or proportional to s. */
TEST(linear_ramp) {
  tc_volume *volume = slab(0, 1);
  double worst = 0, worst_color = 0, worst_inner = 0;
  for (double k = 1e-6; k < 1e9; k *= 10) {
    double rgba[4], depth = 50 * k;
    tc_knot knots[] = {{.value = 0, .color = {1, 0, 0.5}, .amount = 0},
                       {.value = 10, .color = {1, 1, 0.5}, .amount = 10 * k}};
    g_auto(tc_scene) scene = knots_scene(TC_KNOT_EXTINCTION, knots, 2);
    one_ray(volume, &scene, slab_from, slab_to, 0, rgba);
    worst = fmax(worst, fmax(bad(rgba[3], -expm1(-depth)), bad(rgba[2], -0.5 * expm1(-depth))));
    /* int s/10 k s exp(-k s^2/2) ds */
    double q = sqrt(depth);
    worst_color = fmax(worst_color, bad(rgba[1], sqrt(2 / k) / 10 * (0.5 * sqrt(M_PI) * erf(q) - q * exp(-depth))));
    tc_scene_clear(&scene);

    /* the same ramp between knots inside: tau 0 up to 3.3, k (s - 3.3) up to 7.1, constant beyond */
    tc_knot inner[] = {{.value = 3.3, .color = {1, 0, 0}, .amount = 0},
                       {.value = 7.1, .color = {1, 0, 0}, .amount = 3.8 * k}};
    scene = knots_scene(TC_KNOT_EXTINCTION, inner, 2);
    one_ray(volume, &scene, slab_from, slab_to, 0, rgba);
    worst_inner = fmax(worst_inner, bad(rgba[0], -expm1(-k * (0.5 * 3.8 * 3.8 + 3.8 * 2.9))));
  }
  tc_volume_unref(volume);
  report("ramp of tau, one colour, slope 1e-6 .. 1e8", worst, 1e-13);
  report("ramp of tau, ramp of colour (erf)", worst_color, 1e-12);
  report("ramp of tau between knots inside the slab", worst_inner, 1e-13);
}

/* tau constant, colour linear in depth: closed form; the field rises along x as seen from both sides. */
TEST(linear_color) {
  tc_volume *volume = slab(0, 1);
  double worst = 0;
  for (double tau = 1e-6; tau < 1e13; tau *= 10) {
    double rgba[4], d = 10 * tau, loss = -expm1(-d);
    double first_moment = d < 1e-3 ? tau * 50 * (1 - d * (2.0 / 3 - d / 4)) : (loss - d * exp(-d)) / tau;
    tc_knot knots[] = {{.value = 0, .color = {0, 1, 0}, .amount = tau},
                       {.value = 10, .color = {1, 0, 0}, .amount = tau}};
    g_auto(tc_scene) scene = knots_scene(TC_KNOT_EXTINCTION, knots, 2);
    one_ray(volume, &scene, slab_from, slab_to, 0, rgba);
    worst = fmax(worst, fmax(bad(rgba[0], first_moment / 10), bad(rgba[1], loss - first_moment / 10)));
    one_ray(volume, &scene, slab_to, slab_from, 0, rgba);
    worst = fmax(worst, fmax(bad(rgba[1], first_moment / 10), bad(rgba[0], loss - first_moment / 10)));
  }
  tc_volume_unref(volume);
  report("constant tau 1e-6 .. 1e12, ramp of colour, both ways", worst, 1e-12);
}

/* Opacity (not extinction) linear from 0 to 1 over the slab: D = int -ln(1-u) du * 10/unit = 10/unit, but for the
 * clamp. */
TEST(opacity_ramp) {
  tc_volume *volume = slab(0, 1);
  double worst = 0;
  for (double unit = 0.1; unit < 1e4; unit *= 10) {
    double rgba[4], q1 = 0x1p-24;
    tc_knot knots[] = {{.value = 0, .color = {1, 1, 1}, .amount = 0}, {.value = 10, .color = {1, 1, 1}, .amount = 1}};
    g_auto(tc_scene) scene = knots_scene(TC_KNOT_OPACITY, knots, 2);
    scene.transfer_function.unit_distance_mm = unit;
    one_ray(volume, &scene, slab_from, slab_to, 0, rgba);
    double mean = 1 + q1 * log(q1) / (1 - q1); /* of -ln q for q uniform in [q1, 1] */
    worst = fmax(worst, bad(rgba[3], -expm1(-10 / unit * mean)));
  }
  tc_volume_unref(volume);
  report("opacity from 0 to 1 over a slab, unit distance 0.1 .. 1000", worst, 1e-10);
}

/* Jumps: two knots at one value; a peak as narrow as the field allows. */
TEST(jumps_and_peaks) {
  tc_volume *volume = slab(0, 1);
  double rgba[4], worst = 0;
  for (double tau = 1e-3; tau < 1e13; tau *= 10) {
    tc_knot jump[] = {{.value = 4.25, .color = {0, 0, 1}, .amount = 0},
                      {.value = 4.25, .color = {1, 0, 0}, .amount = tau},
                      {.value = 4.25 + 1 / tau, .color = {1, 0, 0}, .amount = tau},
                      {.value = 4.25 + 1 / tau, .color = {0, 1, 0}, .amount = 0}};
    if (tau < 0.2) jump[2].value = jump[3].value = 9;
    g_auto(tc_scene) scene = knots_scene(TC_KNOT_EXTINCTION, jump, 4);
    one_ray(volume, &scene, slab_from, slab_to, 0, rgba);
    double width = jump[2].value - jump[1].value; /* as doubles have it: a peak of 1e-12 has 10 % of rounding */
    worst = fmax(worst, fmax(bad(rgba[0], -expm1(-tau * width)), rgba[1] + rgba[2]));
  }
  tc_volume_unref(volume);
  report("rectangular peak of depth 1, width down to 1e-12", worst, 1e-13);
}

/* A Gaussian of tau over a linear field through n knots; D tends to a difference of erf. */
TEST(gaussian) {
  g_autoptr(tc_volume) volume = slab(0, 1);
  double sigma = 0.7, height = 2.5, error[2],
         exact = height * sigma * sqrt(2 * M_PI) * 0.5 * (erf(5 / (sigma * M_SQRT2)) - erf(-5 / (sigma * M_SQRT2)));
  for (int round = 0; round < 2; round++) {
    size_t n = round ? 8001 : 4001;
    g_autofree tc_knot *knots = calloc(n, sizeof *knots);
    double sum = 0, rgba[4];
    for (size_t i = 0; i < n; i++) {
      knots[i].value = 10.0 * (double)i / (double)(n - 1);
      double z = (knots[i].value - 5) / sigma;
      knots[i].amount = height * exp(-0.5 * z * z);
      knots[i].color[0] = 1;
      if (i) sum += 0.5 * (knots[i].amount + knots[i - 1].amount) * (knots[i].value - knots[i - 1].value);
    }
    g_auto(tc_scene) scene = knots_scene(TC_KNOT_EXTINCTION, knots, n);
    one_ray(volume, &scene, slab_from, slab_to, 0, rgba);
    report(round ? "Gaussian in 8001 knots against its trapezoids" : "Gaussian in 4001 knots against its trapezoids",
           bad(rgba[3], -expm1(-sum)), 1e-12);
    error[round] = bad(rgba[3], -expm1(-exact));
  }
  printf("  Gaussian against erf: %.2e with 4001 knots, %.2e with 8001\n", error[0], error[1]);
  assert_true(error[1] < 1e-9);
}

/* A ball, as a step in squared distance. Trilinear interpolation of r^2 is too large by at most 3/4 voxel^2, so the
 * chord comes out short by O(voxel^2) and better by 4 per halving of the voxels. */
TEST(ball_chord) {
  double error[3], radius = 10, tau = 0.05;
  for (int level = 0; level < 3; level++) {
    int cells = 24 << level;
    double h = 24.0 / cells, sum = 0;
    test_grid grid = {
        .dims = {cells + 1, cells + 1, cells + 1}, .type = TC_F32, .spacing = {h, h, h}, .origin = {-12, -12, -12}};
    g_autoptr(tc_volume) volume = test_volume(&grid, test_radius2, (double[3]){0.5 * cells, 0.5 * cells, 0.5 * cells});
    double edge = radius * radius / (h * h);
    tc_knot knots[] = {{.value = edge, .color = {1, 1, 1}, .amount = tau},
                       {.value = edge, .color = {1, 1, 1}, .amount = 0}};
    g_auto(tc_scene) scene = knots_scene(TC_KNOT_EXTINCTION, knots, 2);
    uint64_t seed = 5;
    for (int i = 0; i < 32; i++) {
      double a[3], b[3], d[3], along = 0, length2 = 0, a2 = 0, rgba[4];
      for (int k = 0; k < 3; k++) {
        a[k] = (test_random(&seed) - 0.5) * 8 - (k == 0) * 40;
        b[k] = (test_random(&seed) - 0.5) * 8;
        d[k] = b[k] - a[k];
        along += a[k] * d[k];
        length2 += d[k] * d[k];
        a2 += a[k] * a[k];
      }
      one_ray(volume, &scene, a, b, 0, rgba);
      double chord = 2 * sqrt(radius * radius - (a2 - along * along / length2));
      sum += bad(rgba[3], -expm1(-tau * chord));
    }
    error[level] = sum / 32;
  }
  double slope = log2(error[0] / error[2]) / 2;
  printf("  ball of step opacity: mean error %.2e %.2e %.2e on voxels of 1, 1/2, 1/4 mm, order %.2f\n", error[0],
         error[1], error[2], slope);
  assert_true(fabs(slope - 2) < 0.2);
}

/* ---- consistency with itself ---- */

TEST(tolerance_sweep) {
  unsigned noise_seed = 3;
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {9, 9, 9}, .type = TC_F32}, test_noise, &noise_seed);
  tc_knot knots[] = {{.value = 0, .color = {0, 0, 0}, .amount = 0},
                     {.value = 0.7, .color = {1, 0, 1}, .amount = 0.999},
                     {.value = 1, .color = {0, 1, 1}, .amount = 0}};
  g_auto(tc_scene) scene = knots_scene(TC_KNOT_OPACITY, knots, 3);
  scene.image.linear_light = true;
  uint64_t seed = 1;
  double worst[13] = {0};
  for (int i = 0; i < 40; i++) {
    double from[3], to[3], best[4], rgba[4];
    for (int k = 0; k < 3; k++) {
      from[k] = 4 + 40 * (test_random(&seed) - 0.5);
      to[k] = 4 + 3 * (test_random(&seed) - 0.5);
    }
    one_ray(volume, &scene, from, to, 1e-14, best);
    for (int e = 1; e <= 12; e++) {
      one_ray(volume, &scene, from, to, pow(10, -e), rgba);
      for (int c = 0; c < 4; c++) worst[e] = fmax(worst[e], bad(rgba[c], best[c]));
    }
  }
  for (int e = 1; e <= 12; e++) {
    printf("  tolerance 1e-%02d: largest difference %.2e\n", e, worst[e]);
    assert_true(worst[e] <= fmax(pow(10, -e), 1e-13));
  }
}

/* The same of what else there is along a ray: each a field, a light or an end of its own. */
TEST(tolerance_sweep_of_kinds) {
  static const char *const kinds[] = {"cubic", "prefiltered", "shaded", "clipped"};
  enum { RAYS = 8, EXPONENTS = 8 };
  unsigned noise_seed = 3;
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {9, 9, 9}, .type = TC_F32}, test_noise, &noise_seed);
  tc_knot knots[] = {{.value = 0, .color = {0, 0, 0}, .amount = 0},
                     {.value = 0.7, .color = {1, 0, 1}, .amount = 0.999},
                     {.value = 1, .color = {0, 1, 1}, .amount = 0}};
  for (size_t kind = 0; kind < G_N_ELEMENTS(kinds); kind++) {
    g_auto(tc_scene) scene = knots_scene(TC_KNOT_OPACITY, knots, 3);
    scene.image.linear_light = true;
    uint64_t seed = 2;
    double worst[EXPONENTS + 1] = {0}, seen = 0;
    scene.filter = kind < 2 ? TC_FILTER_CUBIC : TC_FILTER_LINEAR;
    scene.sampling.prefilter = kind == 1;
    if (kind == 2) scene.shading.model = TC_SHADING_BLINN_PHONG;
    scene.clip.n_planes = kind == 3;
    memcpy(scene.clip.planes[0], (double[4]){0.6, -0.3, 0.2, -1.7}, sizeof scene.clip.planes[0]);
    for (int i = 0; i < RAYS; i++) {
      double from[3], to[3], best[4], rgba[4];
      for (int k = 0; k < 3; k++) {
        from[k] = 4 + 40 * (test_random(&seed) - 0.5);
        to[k] = 4 + 3 * (test_random(&seed) - 0.5);
      }
      one_ray(volume, &scene, from, to, 1e-11, best);
      seen += best[3] > 0.1;
      for (int e = 1; e <= EXPONENTS; e++) {
        one_ray(volume, &scene, from, to, pow(10, -e), rgba);
        for (int c = 0; c < 4; c++) worst[e] = fmax(worst[e], bad(rgba[c], best[c]));
      }
    }
    printf("  %-11s 1e-2: %.1e, 1e-5: %.1e, 1e-8: %.1e\n", kinds[kind], worst[2], worst[5], worst[8]);
    assert_true(seen > RAYS / 2);
    for (int e = 1; e <= EXPONENTS; e++) assert_true(worst[e] <= pow(10, -e));
  }
}

/* A pixel's ray by the camera's definition, written out: the same pixel as a picture of its own. */
TEST(camera_rays) {
  unsigned noise_seed = 4;
  test_grid grid = {.dims = {9, 8, 7}, .type = TC_I16, .slope = 1e-3, .spacing = {1, 2, 1.3}, .origin = {10, 20, -30}};
  memcpy(grid.direction, sheared, sizeof sheared);
  g_autoptr(tc_volume) volume = test_volume(&grid, test_noise, &noise_seed);
  tc_knot knots[] = {{.value = 0.1, .color = {1, 0, 0}, .amount = 0}, {.value = 0.9, .color = {0, 1, 1}, .amount = 1}};
  g_auto(tc_scene) scene = knots_scene(TC_KNOT_EXTINCTION, knots, 2),
                   single = knots_scene(TC_KNOT_EXTINCTION, knots, 2);
  double worst = 0, seen = 0;
  const int width = 7, height = 4;
  for (int projection = 0; projection < 2; projection++) {
    /* Looking along +y from the front with the head up: right is patient's left, +x. */
    double eye[3], ahead[3], half = projection == TC_PERSPECTIVE ? tan(M_PI / 30) : 7;
    tc_volume_index_to_lps(volume, (double[3]){4, 3.5, 3}, ahead);
    memcpy(eye, ahead, sizeof eye);
    eye[1] -= 70;
    test_scene_look(&scene, (tc_projection)projection, eye, ahead, projection == TC_PERSPECTIVE ? 12 : 14);
    g_autoptr(tc_reference) reference = tc_reference_new(volume, &scene, width, height, 0, NULL);
    for (int j = 0; j < height; j++)
      for (int i = 0; i < width; i++) {
        double x = (i + 0.5 - width / 2.0) * 2 * half / height, z = (height / 2.0 - j - 0.5) * 2 * half / height;
        double from[3] = {eye[0], eye[1], eye[2]}, to[3] = {eye[0] + 64 * x, eye[1] + 64, eye[2] + 64 * z}, a[4], b[4];
        if (projection == TC_ORTHOGRAPHIC) from[0] = to[0] = eye[0] + x, from[2] = to[2] = eye[2] + z;
        tc_reference_pixel(reference, i + 0.5, j + 0.5, a);
        one_ray(volume, &single, from, to, 0, b);
        for (int c = 0; c < 4; c++) worst = fmax(worst, bad(a[c], b[c]));
        seen += b[3] > 0;
      }
  }
  printf("  %.0f of %d rays meet the volume\n", seen, 2 * width * height);
  assert_true(seen > 15);
  report("pixels of both projections against rays written out", worst, 1e-10);
}

/* An eye further and further away must not change an orthographic picture. */
TEST(far_eye) {
  unsigned noise_seed = 4;
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {9, 9, 9}, .type = TC_F32}, test_noise, &noise_seed);
  tc_knot knots[] = {{.value = 0.1, .color = {1, 0, 0}, .amount = 0}, {.value = 0.9, .color = {0, 1, 1}, .amount = 3}};
  g_auto(tc_scene) scene = knots_scene(TC_KNOT_EXTINCTION, knots, 2);
  double near_rgba[4], rgba[4], worst = 0;
  for (double away = 1e2; away < 2e7;
       away *= 10) { /* powers of ten times (3, 4, 12): the line stays the same in double */
    one_ray(volume, &scene, (double[3]){4.25 - 3 * away, 4.5 - 4 * away, 4 - 12 * away}, (double[3]){4.25, 4.5, 4}, 0,
            rgba);
    if (away == 1e2) memcpy(near_rgba, rgba, sizeof rgba);
    for (int c = 0; c < 4; c++) worst = fmax(worst, bad(rgba[c], near_rgba[c]));
  }
  report("eye at 1e3 .. 1e8 mm against 1e3 mm", worst, 1e-10);
}

TEST(verbose_pixel) {
  unsigned noise_seed = 8;
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {6, 6, 6}, .type = TC_F32}, test_noise, &noise_seed);
  tc_knot knots[] = {{.value = 0.3, .color = {1, 0, 0}, .amount = 0},
                     {.value = 0.5, .color = {1, 0.5, 0}, .amount = 0.4},
                     {.value = 0.5, .color = {0, 1, 1}, .amount = 0.9}};
  g_auto(tc_scene) scene = knots_scene(TC_KNOT_EXTINCTION, knots, 3);
  test_scene_look(&scene, TC_PERSPECTIVE, (double[3]){-4, 1, 2}, (double[3]){8, 4, 3.5}, 20);
  g_autoptr(tc_reference) reference = tc_reference_new(volume, &scene, 16, 16, 0, NULL);
  tc_reference_sample *samples;
  size_t count;
  double rgba[4], length = 0, transparency = 1;
  tc_reference_ray(reference, 8.5, 7.5, &samples, &count);
  tc_reference_pixel(reference, 8.5, 7.5, rgba);
  assert_true(count > 5);
  for (size_t i = 0; i < count; i++) {
    const tc_reference_sample *s = &samples[i];
    double value, nearby[3];
    assert_true(s->transparency <= transparency && s->length_mm > 0);
    transparency = s->transparency;
    assert_true(bad(s->distance_mm, samples[0].distance_mm + length) < 1e-12);
    length += s->length_mm;
    for (int k = 0; k < 3; k++) nearby[k] = fmin(fmax(s->position[k], 0), 5); /* rounding at the faces */
    assert_true(tc_volume_value_at(volume, nearby, &value));
    assert_true(bad(value, s->value) < 1e-12);
    if (i) assert_true(bad(s->value, samples[i - 1].value_back) < 1e-12);
    double inside = 0.5 * (s->value + s->value_back);
    assert_true(inside < 0.3 ? s->extinction == 0 : inside < 0.5 ? s->extinction <= 0.4 + 1e-12 : s->extinction == 0.9);
  }
  assert_true(transparency > 1 - rgba[3] || samples[count - 1].extinction == 0);
  assert_true(bad(samples[0].position[0], 0) < 1e-12); /* the ray enters by the face x = 0 */
  printf("  %zu pieces over %.3f mm, alpha %.6f\n", count, length, rgba[3]);
  g_free(samples);
  tc_reference_ray(reference, 1e5, 0.5, &samples, &count);
  assert_true(count == 0 && samples == NULL);
}

TEST(image_by_threads) {
  g_autoptr(GError) error = NULL;
  g_autoptr(tc_volume) volume = tc_volume_demo("marschner-lobb", &error);
  if (!volume) fail_msg("%s", error->message);
  const tc_volume_stats *stats = tc_volume_statistics(volume);
  tc_knot knots[] = {{.value = stats->min, .color = {0, 0, 1}, .amount = 0},
                     {.value = stats->max, .color = {1, 1, 0}, .amount = 0.3}};
  g_auto(tc_scene) scene = knots_scene(TC_KNOT_EXTINCTION, knots, 2);
  test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){1, -2, 0.7});
  g_autoptr(tc_reference) reference = tc_reference_new(volume, &scene, 24, 17, 0, NULL);
  enum { FLOATS = 24 * 17 * 4 };
  static float one[FLOATS], many[FLOATS];
  double rgba[4];
  assert_true(tc_reference_image(reference, 1, one, NULL));
  for (int threads = 2; threads <= 5; threads++) {
    memset(many, 0xff, sizeof many);
    assert_true(tc_reference_image(reference, threads, many, NULL));
    assert_memory_equal(one, many, sizeof one);
  }
  tc_reference_pixel(reference, 12.5, 8.5, rgba);
  assert_true(rgba[3] > 0.1);
  assert_float_equal(one[(8 * 24 + 12) * 4 + 3], rgba[3], 1e-7);
  assert_false(tc_reference_image(reference, -1, many, &error));
}

static void expect_refused(tc_volume *volume, const tc_scene *scene, int code, const char *pointer) {
  g_autoptr(GError) error = NULL;
  assert_null(tc_reference_new(volume, scene, 4, 4, 0, &error));
  assert_int_equal(error->code, code);
  assert_string_equal(tc_error_pointer(error), pointer);
}

TEST(refusals) {
  g_autoptr(tc_volume) volume = slab(0, 1);
  tc_knot knot = {.value = 0, .amount = 1};
  g_auto(tc_scene) scene = knots_scene(TC_KNOT_EXTINCTION, &knot, 1);
  scene.mode = TC_MODE_SPLAT;
  expect_refused(volume, &scene, TC_ERROR_UNSUPPORTED, "/mode");
  scene.mode = TC_MODE_MIP;
  scene.window.width = 0;
  expect_refused(volume, &scene, TC_ERROR_INVALID, "/window");
  scene.mode = TC_MODE_DVR;
  scene.filter = TC_FILTER_COUNT;
  expect_refused(volume, &scene, TC_ERROR_UNSUPPORTED, "/filter");
  scene.filter = TC_FILTER_LINEAR;
  scene.camera.up[0] = scene.camera.target[0] - scene.camera.position[0];
  scene.camera.up[1] = scene.camera.target[1] - scene.camera.position[1];
  scene.camera.up[2] = scene.camera.target[2] - scene.camera.position[2];
  expect_refused(volume, &scene, TC_ERROR_INVALID, "/camera/up");
  const double bad[] = {NAN, INFINITY, -INFINITY};
  for (size_t i = 0; i < G_N_ELEMENTS(bad); i++) {
    test_scene_look(&scene, TC_PERSPECTIVE, slab_from, slab_to, bad[i]);
    expect_refused(volume, &scene, TC_ERROR_INVALID, "/camera/fovY");
    test_scene_look(&scene, TC_ORTHOGRAPHIC, slab_from, slab_to, bad[i]);
    expect_refused(volume, &scene, TC_ERROR_INVALID, "/camera/height");
    test_scene_look(&scene, TC_PERSPECTIVE, slab_from, slab_to, 30);
    const tc_camera good = scene.camera;
    scene.camera.position[i] = bad[i];
    expect_refused(volume, &scene, TC_ERROR_INVALID, "/camera/position");
    scene.camera = good, scene.camera.target[i] = bad[i];
    expect_refused(volume, &scene, TC_ERROR_INVALID, "/camera/target");
    scene.camera = good, scene.camera.up[i] = bad[i];
    expect_refused(volume, &scene, TC_ERROR_INVALID, "/camera/up");
  }
  test_scene_look(&scene, TC_PERSPECTIVE, slab_from, slab_to, 30);
  scene.transfer_function.points[0].amount = NAN;
  expect_refused(volume, &scene, TC_ERROR_INVALID, "/transferFunction");
}

TESTS(NULL, NULL)
