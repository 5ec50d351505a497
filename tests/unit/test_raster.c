/* The rasteriser: coverage, clusters, what it leaves out, shading, and one picture from every instruction set. */
#include "tests/support/raster.h"

/* ---- coverage ---- */

TEST(each_sample_belongs_to_one_triangle_of_a_sheet) {
  picture *p = new_picture();
  static const struct { int n; double size, snap, hills; } kinds[] = {
      {3, 2000, 1 / 256.0, 0}, {20, 300, 0.5, 3},          {150, 230, 1 / 256.0, 0}, {150, 230, 0.5, 1},
      {60, 240, 0.25, 0},      {12, 40000, 1 / 256.0, 50}, {100, 240, 1, 0},         {7, 100000, 1, 0}};
  for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
    tc_clusters *c = cluster(sheet(kinds[k].n, -kinds[k].size / 2, kinds[k].size / 2, kinds[k].snap, kinds[k].hills));
    for (int isa = 0; isa < 3; isa++)
      for (int samples = 1; samples <= 5; samples += 4) {
        if (!runs(isas[isa])) continue;
        const drawing d = {.camera = above, .width = 190, .height = 200, .isa = isas[isa], .samples = samples};
        draw(c, &d, p);
        if (p->counts.covered != (uint64_t)(190 * 200 * samples))
          fail_msg("sheet %zu, %s: %llu samples covered of %d", k, isas[isa], (unsigned long long)p->counts.covered,
                   190 * 200 * samples);
        for (int i = 0; i < 190 * 200; i++) assert_true(fabsf(p->linear[i][3] - 1) < 1e-6f);
      }
    tc_clusters_free(c);
  }
  test_free(p);
}

/* Samples of an exact sphere of 50 mm about the origin, but for those next to its edge: hit or not, and how far. */
/* Needles across the picture, a thirtieth of a pixel wide: each sample is of one of them. */
TEST(needles_leave_no_gap) {
  enum { NEEDLES = 3000 };
  picture *p = new_picture();
  tc_mesh *m = tc_mesh_new(2 * (NEEDLES + 1), 2 * NEEDLES, false, NULL);
  for (uint32_t i = 0; i <= NEEDLES; i++)
    for (uint32_t end = 0; end < 2; end++) {
      const double x = end ? 80 : -80, y = 100.0 * i / NEEDLES - 50;
      m->positions[2 * i + end][0] = (float)(cos(0.3) * x - sin(0.3) * y), m->positions[2 * i + end][1] = (float)(sin(0.3) * x + cos(0.3) * y);
      m->positions[2 * i + end][2] = 0;
    }
  for (uint32_t i = 0; i < NEEDLES; i++) {
    const uint32_t two[2][3] = {{2 * i, 2 * i + 1, 2 * i + 3}, {2 * i, 2 * i + 3, 2 * i + 2}};
    memcpy(m->triangles[2 * i], two, sizeof two);
  }
  tc_clusters *c = cluster(m);
  const drawing d = {.camera = above, .width = 200, .height = 200, .forward = true}; /* forward: nothing is left out as hidden */
  draw(c, &d, p);
  size_t seen = 0;
  for (int y = 0; y < 200; y++)
    for (int x = 0; x < 200; x++) {
      const double right = x + 0.5 - 100, up = 100 - y - 0.5, along = cos(0.3) * right + sin(0.3) * up, aside = cos(0.3) * up - sin(0.3) * right;
      const float opacity = p->linear[y * 200 + x][3];
      if (fabs(along) < 79.5 && fabs(aside) < 49.5) assert_true(opacity == 1);
      if (fabs(along) > 80.5 || fabs(aside) > 50.5) assert_true(opacity == 0);
      seen += opacity > 0;
    }
  assert_int_equal(p->counts.covered, seen);
  tc_clusters_free(c);
  test_free(p);
}

static void compare_with_sphere(const picture *p, const tc_camera *camera, double depth_error) {
  double right[3] = {1, 0, 0}, down[3] = {0, -1, 0}, scale = camera->height_mm / p->height, far = camera->position[2];
  int wrong = 0;
  if (camera->projection == TC_PERSPECTIVE) scale = 2 * tan(camera->fov_y_deg * M_PI / 360) / p->height;
  for (int j = 0; j < p->height; j++)
    for (int i = 0; i < p->width; i++) {
      double u = scale * (i + 0.5 - 0.5 * p->width), v = scale * (j + 0.5 - 0.5 * p->height), ray[3], from[3], b = 0, c = 0;
      bool perspective = camera->projection == TC_PERSPECTIVE;
      for (int k = 0; k < 3; k++) {
        double across = u * right[k] + v * down[k];
        ray[k] = (perspective ? across : 0) - (k == 2), from[k] = camera->position[k] + (perspective ? 0 : across);
      }
      double norm = sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2]);
      for (int k = 0; k < 3; k++) b += from[k] * ray[k] / norm, c += from[k] * from[k];
      double passes = sqrt(fmax(c - b * b, 0)), pixel = scale * (perspective ? far : 1);
      if (fabs(passes - 50) < 0.05 * pixel + 0.02) continue;
      int at = j * p->width + i;
      bool hit = p->linear[at][3] > 0.5f;
      wrong += hit != (passes < 50);
      if (hit && passes < 49) wrong += !(fabs(p->depth[at] - (-b - sqrt(2500 - passes * passes))) < depth_error);
    }
  assert_int_equal(wrong, 0);
}

TEST(silhouettes_and_depths_are_those_of_a_sphere) {
  picture *p = new_picture();
  tc_clusters *c = cluster(spheres(180, 1, 50, 0));
  assert_true(c->parts[0].closed && c->bytes < 20 * c->n_triangles);
  drawing d = {.camera = above, .width = 300, .height = 310, .isa = runs("avx2") ? "avx2" : "scalar"};
  for (int view = 0; view < 4; view++) {
    if (view == 1) d.camera = (tc_camera){.projection = TC_PERSPECTIVE, .position = {0, 0, 80}, .up = {0, 1, 0}, .fov_y_deg = 90};
    if (view == 2) d.camera.position[2] = 1e7, d.camera.fov_y_deg = 2 * 180 / M_PI * 60e-7;
    if (view == 3) d.camera.position[2] = 50.5, d.camera.fov_y_deg = 170;
    d.one_sided = false;
    draw(c, &d, p);
    compare_with_sphere(p, &d.camera, view == 2 ? 2 : 0.05);
    const uint64_t drawn = p->counts.drawn;
    d.one_sided = true; /* closed and seen from outside: the same picture without backs */
    draw(c, &d, p);
    compare_with_sphere(p, &d.camera, view == 2 ? 2 : 0.05);
    assert_true(p->counts.facing_away > 0 && p->counts.drawn < drawn);
  }
  tc_clusters_free(c);
  test_free(p);
}

TEST(a_camera_inside_sees_surface_all_around) {
  picture *p = new_picture();
  tc_clusters *c = cluster(spheres(60, 1, 50, 0));
  static const double angles[] = {20, 100, 178};
  for (int i = 0; i < 3; i++) {
    const drawing d = {.camera = {.projection = TC_PERSPECTIVE, .position = {0, 0, i * 24.0}, .target = {40, 3, 1}, .up = {0, 1, 0},
                                  .fov_y_deg = angles[i]}, .width = 200, .height = 180};
    draw(c, &d, p);
    for (int k = 0; k < 200 * 180; k++) assert_true(p->linear[k][3] == 1 && p->depth[k] > 1.5f && p->depth[k] < 99);
  }
  tc_clusters_free(c);
  test_free(p);
}

/* A floor that begins behind the eye and ends far away, of few triangles and of many: below the horizon it is seen
 * everywhere, at the right depth. */
TEST(a_floor_through_the_eye_plane_ends_at_the_horizon) {
  picture *p = new_picture();
  for (int n = 1; n <= 101; n += 50) {
    tc_clusters *c = cluster(sheet(n, -1e5, 1e5, 1, 0));
    const drawing d = {.camera = {.projection = TC_PERSPECTIVE, .position = {0, 0, 10}, .target = {0, 1, 10}, .up = {0, 0, 1},
                                  .fov_y_deg = 90}, .width = 200, .height = 200};
    draw(c, &d, p);
    for (int y = 0; y < 200; y++)
      for (int x = 0; x < 200; x++) {
        double v = (y + 0.5 - 100) / 100, u = (x + 0.5 - 100) / 100, depth = 10 * sqrt(1 + u * u + v * v) / v;
        assert_true(p->linear[y * 200 + x][3] == (v > 0));
        if (v > 0) assert_true(fabs(p->depth[y * 200 + x] / depth - 1) < 5e-3); /* single precision, 1e5 mm wide, 10 high */
      }
    tc_clusters_free(c);
  }
  test_free(p);
}

/* A floor far below the eye, which each of a pixel's samples meets elsewhere: opaque, then translucent. */
TEST(of_several_samples_the_nearest_has_the_depth) {
  picture *p = new_picture();
  tc_clusters *c = cluster(sheet(31, -500, 500, 1, 0));
  const tc_raster_surface looks[2] = {{{1, 1, 1}, 1}, {{1, 1, 1}, 0.5f}};
  for (int round = 0; round < 4; round++) {
    const bool perspective = round < 2;
    const drawing d = {.camera = {.projection = perspective ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, .position = {0, 0, 10},
                                  .target = {0, 10, perspective ? 10 : 9}, .up = {0, 0, 1}, .fov_y_deg = 90, .height_mm = 40},
                       .width = 200, .height = 200, .samples = 5, .surfaces = &looks[round % 2]};
    double worst = 0;
    draw(c, &d, p);
    for (int y = 110; y < 145; y++)
      for (int x = 0; x < 200; x++) {
        double nearest = INFINITY;
        for (int s = 0; s < 5; s++) {
          const double u = x + 0.5 + five_samples[s][0] - 100, v = y + 0.5 + five_samples[s][1] - 100;
          /* Orthographic: pixels are 0.2 mm, the middle one's ray begins 10 mm high and falls 1 mm in 10. */
          const double depth = perspective ? 10 * sqrt(1e4 + u * u + v * v) / v : 10 * sqrt(101) - 2 * v;
          nearest = fmin(nearest, depth);
        }
        worst = fmax(worst, fabs((double)p->depth[y * 200 + x] / nearest - 1));
      }
    printf("  round %d: %.1e of the depth at most\n", round, worst);
    assert_true(worst < 1.0 / 512 / 10 + 1e-3); /* a sample is rounded by half of a 256th, corners too */
  }
  tc_clusters_free(c);
  test_free(p);
}

TEST(what_is_far_from_the_patients_origin_looks_the_same) {
  picture *p = new_picture(), *q = new_picture();
  tc_clusters *c = cluster(spheres(40, 2, 30, 45));
  drawing d = {.camera = {.projection = TC_PERSPECTIVE, .position = {60, -200, 90}, .target = {20, 0, 0}, .up = {0, 0, 1},
                          .fov_y_deg = 30}, .width = 256, .height = 256, .shaded = true};
  draw(c, &d, p);
  for (int k = 0; k < 3; k++) c->origin[k] += 1e7, d.camera.position[k] += 1e7, d.camera.target[k] += 1e7;
  draw(c, &d, q);
  assert_memory_equal(p->linear, q->linear, 256 * 256 * sizeof *p->linear);
  tc_clusters_free(c);
  test_free(p), test_free(q);
}

TEST(planes_cut_exactly) {
  picture *p = new_picture();
  tc_clusters *c = cluster(spheres(90, 1, 50, 0));
  const drawing d = {.camera = above, .width = 200, .height = 200, .clip = {{1, 0, 0, -10.25}, {0, 0, -2, 60}}, .n_clip = 2};
  draw(c, &d, p);
  for (int y = 0; y < 200; y++)
    for (int x = 0; x < 200; x++) {
      double u = x + 0.5 - 100, v = y + 0.5 - 100, r = hypot(u, v);
      bool shell = p->depth[y * 200 + x] < INFINITY;
      if (fabs(r - 50) > 0.1) assert_int_equal(shell, r < 50 && u > 10.25);
      if (!shell || fabs(r - 40) < 1 || r > 49) continue;
      double z = sqrt(2500 - r * r); /* what is above 30 is cut: the back shows in its place */
      assert_true(fabs(p->depth[y * 200 + x] - (100 - (z > 30 ? -z : z))) < 0.1);
    }
  tc_clusters_free(c);
  test_free(p);
}

/* ---- the same from all ---- */

static tc_mesh *soup(int n) {
  tc_mesh *m = tc_mesh_new(3 * (size_t)n, (size_t)n, true, NULL);
  for (int t = 0; t < n; t++) {
    double middle[3], size = 0.3 * exp(6 * chance() * chance()), thin = chance() < 0.3 ? 0.01 : 1;
    for (int k = 0; k < 3; k++) middle[k] = 160 * (chance() - 0.5);
    for (uint32_t v = 0; v < 3; v++) {
      m->triangles[t][v] = 3 * (uint32_t)t + v;
      for (int k = 0; k < 3; k++) {
        m->positions[3 * (uint32_t)t + v][k] = (float)(middle[k] + size * (k ? thin : 1) * (chance() - 0.5));
        m->normals[3 * (uint32_t)t + v][k] = (float)(chance() - 0.5);
      }
    }
  }
  return m;
}

/* A quadrilateral in perspective, whose colour along x is linear in space, not on the picture; and what is looked up. */
TEST(colours_of_vertices_are_looked_up_where_they_are_seen) {
  picture *p = new_picture(), *q = new_picture();
  float channels[256];
  for (int i = 0; i < 256; i++) channels[i] = (float)i / 255;
  for (int part = 0; part < 3; part++) { /* colours; a colour of its own; none */
    tc_mesh *m = tc_mesh_new(4, 2, false, NULL);
    static const float at[4][3] = {{-20, 0, 0}, {20, 0, 60}, {20, 30, 60}, {-20, 30, 0}};
    static const uint32_t colors[4] = {0x0000ff, 0xff0000, 0xff00, 0xff};
    memcpy(m->positions, at, sizeof at);
    memcpy(m->triangles, (const uint32_t[2][3]){{0, 1, 2}, {0, 2, 3}}, 24);
    if (part < 2) assert_true(tc_mesh_add_colors(m, NULL));
    if (part < 2) memcpy(m->colors, colors, sizeof colors);
    tc_clusters *c = cluster(m);
    assert_true(c->parts[0].colored == (part < 2) && (c->colors != NULL) == (part < 2));
    const tc_raster_surface surface = {.color = {1, 0.5f, 0.25f}, .opacity = 1, .colored = part == 0};
    const drawing d = {.camera = {.projection = TC_PERSPECTIVE, .position = {0, 15, -60}, .target = {0, 15, 0}, .up = {0, -1, 0}, .fov_y_deg = 60},
                       .width = 200, .height = 150, .isa = "scalar", .surfaces = &surface, .channels = part ? NULL : channels};
    draw(c, &d, p);
    assert_true(p->counts.shaded > 3000 && p->counts.colored == (part ? 0 : p->counts.shaded));
    double worst = 0;
    int seen = 0;
    for (int i = 0; i < 200 * 150 && part == 0; i++) {
      if (p->linear[i][3] < 1) continue;
      const double scale = 75 / tan(M_PI / 6), u = (i % 200 - 99.5) / scale, v = (i / 200 - 74.5) / scale;
      /* x = u (60 + z) on the plane z = 1.5 (x + 20); y below the axis of the view. */
      const double x = 90 * u / (1 - 1.5 * u), y = 15 + v * (60 + 1.5 * (x + 20)), s = (x + 20) / 40, t = y / 30;
      const double wanted[3] = {1 - s, s > t ? t : s, s > t ? s - t : 0};
      for (int k = 0; k < 3; k++) worst = fmax(worst, fabs(wanted[k] - (double)p->linear[i][k]));
      seen++;
    }
    printf("%d pixels, off by at most %.2e\n", seen, worst);
    assert_true(part || (seen > 3000 && worst < 1e-5)); /* weights are of single precision, not of rounded corners */
    for (int isa = 1; isa < 3; isa++) {
      drawing same = d;
      if (!runs(same.isa = isas[isa])) continue;
      draw(c, &same, q);
      assert_memory_equal(p->linear, q->linear, 200 * 150 * sizeof *p->linear);
      assert_memory_equal(&p->counts, &q->counts, sizeof p->counts);
    }
    tc_clusters_free(c);
  }
  test_free(p), test_free(q);
}

/* Parts with and without: colours go with theirs, in whatever order they come, and when one is copied. */
TEST(parts_keep_their_colours) {
  for (int order = 0; order < 2; order++) {
    tc_clusters *all = NULL;
    for (int i = 0; i < 3; i++) {
      tc_mesh *m = soup(500);
      const tc_mesh_source of = {.kind = TC_SURFACE_OF_MESH, .serial = (uint64_t)i};
      const bool colored = i % 2 == order;
      if (colored) assert_true(tc_mesh_add_colors(m, NULL));
      for (size_t v = 0; colored && v < m->n_vertices; v++) m->colors[v] = 0xabcd00 + (uint32_t)i;
      assert_true(tc_clusters_add(&all, cluster(m), &of, NULL));
    }
    for (int i = 0; i < 3; i++) {
      tc_clusters *one = tc_clusters_copy_part(all, (size_t)i, NULL);
      assert_true(one->parts[0].colored == (i % 2 == order) && (one->colors != NULL) == (i % 2 == order));
      for (size_t v = 0; one->colors && v < one->vertex_room; v++) assert_int_equal(one->colors[v], 0xabcd00 + i);
      tc_clusters_free(one);
    }
    const size_t n = all->n * sizeof *all->clusters + all->vertex_room * 20 + 3 * all->triangle_room;
    assert_int_equal(all->bytes, n);
    tc_clusters_free(all);
  }
}

TEST(every_instruction_set_and_any_threads_draw_the_same_bits) {
  picture *p = new_picture(), *q = new_picture();
  tc_clusters *c = cluster(soup(4000));
  tc_pool *pool = tc_pool_new(3, NULL);
  for (int view = 0; view < 4; view++) {
    drawing d = {.camera = above, .width = 301, .height = 223, .isa = "scalar", .samples = view & 1 ? 5 : 1, .shaded = true,
                 .clip = {{1, 2, 1, 40}}, .n_clip = view > 1};
    if (view > 1)
      d.camera = (tc_camera){.projection = TC_PERSPECTIVE, .position = {10, 20, 30}, .target = {-30, 0, 0}, .up = {0, 0, 1},
                             .fov_y_deg = 120};
    draw(c, &d, p);
    assert_true(p->counts.shaded > 10000);
    for (int isa = 0; isa < 3; isa++) {
      if (!runs(isas[isa])) continue;
      d.isa = isas[isa], d.pool = pool;
      draw(c, &d, q);
      assert_memory_equal(p->linear, q->linear, 301 * 223 * sizeof *p->linear);
      assert_memory_equal(p->depth, q->depth, 301 * 223 * sizeof *p->depth);
      assert_memory_equal(&p->counts, &q->counts, sizeof p->counts);
    }
  }
  tc_pool_free(pool);
  tc_clusters_free(c);
  test_free(p), test_free(q);
}

/* ---- what is left out ---- */

TEST(nothing_is_shaded_that_nobody_sees) {
  picture *p = new_picture();
  tc_clusters *c = cluster(spheres(60, 6, 50, 0)); /* six spheres one in another */
  drawing d = {.camera = above, .width = 256, .height = 256};
  draw(c, &d, p);
  uint64_t seen = 0;
  for (int i = 0; i < 256 * 256; i++) seen += p->linear[i][3] > 0;
  assert_int_equal(p->counts.shaded, seen);
  assert_true(p->counts.hidden > c->n / 2);
  d.camera.target[2] = 200; /* looking away */
  draw(c, &d, p);
  assert_int_equal(p->counts.outside, c->n);
  assert_int_equal(p->counts.drawn + p->counts.triangles + p->counts.shaded, 0);
  tc_clusters_free(c);
  test_free(p);
}

/* Forward shading gives the same picture; of deep scenes it shades what is covered later too. */
TEST(forward_shading_draws_the_same) {
  picture *p = new_picture(), *q = new_picture();
  tc_mesh *m = spheres(40, 12, 60, 2);
  tc_clusters *c = cluster(m);
  drawing d = {.camera = above, .width = 300, .height = 300, .shaded = true};
  for (size_t i = 0; i < G_N_ELEMENTS(isas); i++) {
    d.isa = isas[i];
    if (!runs(d.isa)) continue;
    d.forward = false, draw(c, &d, p);
    d.forward = true, draw(c, &d, q);
    int other = 0; /* of two triangles that are as near as each other, the one that was drawn first */
    for (int at = 0; at < 300 * 300; at++) other += memcmp(p->linear[at], q->linear[at], sizeof *p->linear) != 0;
    assert_true(other < 20);
    assert_true(q->counts.shaded >= p->counts.shaded && p->counts.shaded > 1000);
  }
  tc_clusters_free(c);
  test_free(p);
  test_free(q);
}

TEST(light_follows_the_normals) {
  picture *p = new_picture();
  tc_clusters *c = cluster(spheres(90, 1, 50, 0));
  const drawing d = {.camera = above, .width = 200, .height = 200, .shaded = true};
  draw(c, &d, p);
  for (int y = 0; y < 200; y++)
    for (int x = 0; x < 200; x++) {
      double r = hypot(x + 0.5 - 100, y + 0.5 - 100);
      if (r > 49) continue;
      double lit = 0.2 + 0.7 * sqrt(1 - r * r / 2500);
      assert_true(fabs(p->linear[y * 200 + x][0] - lit) < 3e-3 && fabs(p->linear[y * 200 + x][1] - 0.5 * lit) < 3e-3);
    }
  tc_clusters_free(c);
  test_free(p);
}

TEST(what_nobody_can_see_is_in_no_cluster) {
  tc_mesh *m = sheet(40, -10, 10, 1 / 256.0, 1);
  m->positions[5][1] = NAN, m->positions[700][2] = INFINITY; /* six triangles each, or so */
  m->triangles[900][1] = m->triangles[900][0];
  size_t bad = 0;
  for (size_t t = 0; t < m->n_triangles; t++) {
    bool wrong = t == 900;
    for (int k = 0; k < 3; k++) wrong |= m->triangles[t][k] == 5 || m->triangles[t][k] == 700;
    bad += wrong;
  }
  const size_t left = m->n_triangles - bad;
  tc_clusters *c = cluster(m);
  size_t n = 0;
  for (size_t i = 0; i < c->n; i++) n += c->clusters[i].n_triangles;
  assert_int_equal(n, left);
  assert_int_equal(c->n_triangles, left);
  assert_false(c->parts[0].closed);
  tc_clusters_free(c);
  c = cluster(tc_mesh_new(0, 0, false, NULL));
  picture *p = new_picture();
  const drawing d = {.camera = above, .width = 70, .height = 70};
  draw(c, &d, p); /* of nothing: nothing */
  for (int i = 0; i < 70 * 70; i++) assert_true(p->linear[i][3] == 0 && p->depth[i] == INFINITY);
  tc_clusters_free(c);
  test_free(p);
}

/* ---- stopping ---- */

TEST(drawing_and_clustering_stop_at_any_look) {
  picture *p = new_picture();
  tc_mesh *m = spheres(150, 1, 50, 0);
  tc_clusters *c = tc_clusters_make(m, NULL, NULL, NULL);
  drawing d = {.camera = above, .width = 300, .height = 300, .pool = tc_pool_new(2, NULL)};
  tc_interrupt interrupt;
  tc_interrupt_init(&interrupt);
  const tc_halt halt = tc_halt_begin(&interrupt, 0);
  tc_pool_watch(d.pool, &halt);
  tc_halt_probe_begin(LLONG_MAX);
  draw(c, &d, p);
  const long long looks = atomic_load(&tc_halt_probed.looks);
  assert_true(looks > 40);
  for (long long at = 1; at < looks - 8; at += 7) { /* the last ones find nothing left to stop */
    GError *error = NULL;
    tc_halt_probe_begin(at);
    assert_false(try_draw(c, &d, p, &error));
    assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_CANCELLED));
    g_clear_error(&error);
    if (at > 20) continue;
    tc_halt_probe_begin(at);
    assert_null(tc_clusters_make(m, d.pool, NULL, &error));
    assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_CANCELLED));
    g_clear_error(&error);
  }
  tc_halt_probed.on = false;
  tc_pool_free(d.pool);
  tc_clusters_free(c);
  tc_mesh_free(m);
  test_free(p);
}

TESTS(NULL, NULL)
