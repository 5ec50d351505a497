/* The rasteriser: coverage, clusters, what it leaves out, shading, and one picture from every instruction set. */
#include "tests/support/test.h"

#include "renderer/base/halt.h"
#include "renderer/mesh/coverage.h"
#include "renderer/mesh/raster.h"

#define MOST 320 /* pixels a side */

typedef struct picture {
  int width, height;
  float linear[MOST * MOST][4], depth[MOST * MOST];
  tc_raster_counts counts;
} picture;

typedef struct drawing {
  tc_camera camera;
  int width, height, samples;
  const char *isa;
  bool one_sided, shaded, forward;
  double clip[2][4];
  int n_clip;
  tc_pool *pool;
  const tc_raster_surface *surfaces; /* NULL: one, opaque */
  const float *channels;             /* of colored surfaces */
  const tc_raster_look *looks;       /* two of them; NULL: one, with its light at the camera */
  size_t spare_bytes; /* 0: no bound */
} drawing;

static bool runs(const char *isa) {
  __builtin_cpu_init();
  if (!strcmp(isa, "avx512")) return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl");
  return strcmp(isa, "avx2") || (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"));
}
static const char *const isas[] = {"scalar", "avx2", "avx512"};

static bool keep(void *user, const tc_raster_picture *p) {
  picture *to = user;
  for (int y = p->y0; y < p->y1; y++) {
    size_t from = (size_t)(y - p->y0) * TC_RASTER_SIDE, at = (size_t)(y * to->width + p->x0), n = (size_t)(p->x1 - p->x0);
    memcpy(to->linear[at], p->linear[from], n * sizeof *to->linear);
    memcpy(to->depth + at, p->depth + from, n * sizeof *to->depth);
  }
  return true;
}

static bool try_draw(const tc_clusters *mesh, const drawing *d, picture *p, GError **error) {
  static const double one[1][2] = {{0, 0}},
                      several[5][2] = {{-0.4, 0}, {-0.2, 0.381}, {0, -0.236}, {0.2, 0.145}, {0.4, -0.472}};
  const tc_raster_surface one_surface = {{1, 0.5f, 0.25f}, 1, d->one_sided};
  tc_mesh_view view;
  tc_mesh_view_set_up(&view, mesh, &d->camera, d->width, d->height, d->clip, d->n_clip);
  const tc_raster_look look = {.shaded = d->shaded, .n_lights = 1, .lights = {{.at_camera = true, .color = {1, 1, 1}}},
                               .factor = {0.2f, 0.7f}, .specular = d->samples > 1 ? 0.3f : 0, .shininess = 30};
  const tc_raster_job job = {.mesh = mesh, .view = &view, .kernels = tc_raster_kernels_named(d->isa ? d->isa : "scalar"),
                             .looks = d->looks ? d->looks : &look, .n_looks = d->looks ? 2 : 1,
                             .surfaces = d->surfaces ? d->surfaces : &one_surface, .channels = d->channels,
                             .n_samples = d->samples > 1 ? 5 : 1, .samples = d->samples > 1 ? several : one,
                             .forward = d->forward, .spare_bytes = d->spare_bytes ? d->spare_bytes : SIZE_MAX, .emit = keep, .user = p, .pool = d->pool};
  p->width = d->width, p->height = d->height;
  p->counts = (tc_raster_counts){0};
  return tc_raster_draw(&job, &p->counts, error);
}

static void draw(const tc_clusters *mesh, const drawing *d, picture *p) {
  GError *error = NULL;
  if (!try_draw(mesh, d, p, &error)) fail_msg("%s", error->message);
}

static tc_clusters *cluster(tc_mesh *mesh) {
  GError *error = NULL;
  tc_clusters *c = tc_clusters_make(mesh, NULL, NULL, &error);
  if (!c) fail_msg("%s", error->message);
  tc_mesh_free(mesh);
  return c;
}

static picture *new_picture(void) { return test_calloc(1, sizeof(picture)); }

/* ---- meshes ---- */

static uint32_t state = 1;
static double chance(void) {
  state = state * 1664525u + 1013904223u;
  return (state >> 8) / 16777216.0;
}

/* A sheet of n x n crooked cells from (lo, lo) to (hi, hi); its inner vertices are multiples of `snap`. */
static tc_mesh *sheet(int n, double lo, double hi, double snap, double hills) {
  tc_mesh *m = tc_mesh_new((size_t)(n + 1) * (size_t)(n + 1), 2 * (size_t)n * (size_t)n, false, NULL);
  for (int j = 0, v = 0; j <= n; j++)
    for (int i = 0; i <= n; i++, v++) {
      double step = (hi - lo) / n;
      m->positions[v][0] = (float)(snap * rint((lo + step * (i + 0.45 * (chance() - 0.5))) / snap));
      m->positions[v][1] = (float)(snap * rint((lo + step * (j + 0.45 * (chance() - 0.5))) / snap));
      m->positions[v][2] = (float)(hills * chance());
    }
  for (int j = 0, t = 0; j < n; j++)
    for (int i = 0; i < n; i++, t += 2) {
      uint32_t a = (uint32_t)(j * (n + 1) + i), b = a + 1, c = a + (uint32_t)n + 1, d = c + 1;
      const uint32_t corners[2][2][3] = {{{a, b, d}, {a, d, c}}, {{a, b, c}, {b, d, c}}};
      memcpy(m->triangles[t], corners[chance() < 0.5], sizeof *corners);
    }
  return m;
}

/* A sphere of radius 50 about (cx, 0, 0), normals outwards. */
static void put_sphere(tc_mesh *m, int rings, size_t v, size_t t, double radius, double cx) {
  const uint32_t first = (uint32_t)v, around = 2 * (uint32_t)rings;
  for (int j = 0; j <= rings; j++)
    for (uint32_t i = 0; i < around; i++, v++) {
      double a = M_PI * j / rings, b = 2 * M_PI * i / around;
      const double n[3] = {sin(a) * cos(b), sin(a) * sin(b), cos(a)};
      for (int k = 0; k < 3; k++) {
        m->normals[v][k] = (float)n[k];
        m->positions[v][k] = (float)(radius * n[k] + (k == 0 ? cx : 0));
      }
    }
  for (uint32_t j = 0; j < (uint32_t)rings; j++)
    for (uint32_t i = 0; i < around; i++, t += 2) {
      const uint32_t next = (i + 1) % around, last = (uint32_t)rings - 1; /* a pole is one vertex */
      uint32_t a = first + j * around + (j ? i : 0), b = first + j * around + (j ? next : 0);
      uint32_t c = first + (j + 1) * around + (j < last ? i : 0), d = first + (j + 1) * around + (j < last ? next : 0);
      const uint32_t two[2][3] = {{a, c, d}, {a, d, b}};
      memcpy(m->triangles[t], two, sizeof two);
    }
}

static tc_mesh *spheres(int rings, int n, double radius, double apart) {
  const size_t vertices = 2 * (size_t)rings * ((size_t)rings + 1), triangles = 4 * (size_t)rings * (size_t)rings;
  tc_mesh *m = tc_mesh_new((size_t)n * vertices, (size_t)n * triangles, true, NULL);
  for (int i = 0; i < n; i++)
    put_sphere(m, rings, (size_t)i * vertices, (size_t)i * triangles, radius - (apart > 0 ? 0 : 5 * i), apart * i);
  return m;
}

static const tc_camera above = {.projection = TC_ORTHOGRAPHIC, .position = {0, 0, 100}, .up = {0, 1, 0}, .height_mm = 200};

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

/* ---- translucent layers ---- */

static const tc_raster_surface six[6] = {{{1, 0, 0}, 0.3f, false}, {{0, 1, 0}, 0.5f, false}, {{0, 0, 1}, 0.7f, false},
                                         {{1, 1, 0}, 0.1f, false}, {{0, 1, 1}, 0.9f, true},  {{1, 0, 1}, 1, false}};

/* Parts of several meshes, which are freed. */
static tc_clusters *parts(tc_mesh *const *meshes, int n) {
  tc_clusters *all = NULL;
  for (int i = 0; i < n; i++) {
    const tc_mesh_source of = {.kind = TC_SURFACE_OF_MESH, .serial = (uint64_t)i};
    assert_true(tc_clusters_add(&all, cluster(meshes[i]), &of, NULL));
  }
  assert_int_equal(all->n_parts, n);
  return all;
}

/* What is behind everything so far. */
static void composite(double sum[4], const tc_raster_surface *s) {
  const double share = (1 - sum[3]) * s->opacity;
  for (int c = 0; c < 3; c++) sum[c] += share * s->color[c];
  sum[3] += share;
}

TEST(nested_spheres_have_their_analytic_colours) {
  picture *p = new_picture();
  tc_mesh *meshes[4];
  for (int i = 0; i < 4; i++) meshes[i] = spheres(120, 1, 20 + 20 * i, 0); /* the innermost first */
  tc_clusters *c = parts(meshes, 4);
  const tc_raster_surface *const orders[2] = {six, six + 2}; /* the second: the outermost is opaque */
  for (int order = 0; order < 2; order++) {
    const drawing d = {.camera = above, .width = 200, .height = 200, .isa = runs("avx2") ? "avx2" : "scalar",
                       .surfaces = orders[order], .samples = 1 + 4 * order};
    draw(c, &d, p);
    for (int i = 0; i < 200 * 200; i++) {
      const double x = i % 200 - 99.5, y = i / 200 - 99.5, from = sqrt(x * x + y * y), beside = fmod(from, 20);
      double sum[4] = {0};
      if (beside < 1 || beside > 19) continue; /* at an outline */
      for (int k = 3; k >= 0; k--) if (from < 20 + 20 * k) composite(sum, &d.surfaces[k]);
      for (int k = 0; k < 4; k++) if (from < 20 + 20 * k && !d.surfaces[k].one_sided) composite(sum, &d.surfaces[k]);
      for (int k = 0; k < 4; k++) assert_true(fabs(sum[k] - (double)p->linear[i][k]) < 4e-4);
      if (from < 60) assert_true(fabs(p->depth[i] - (100 - sqrt(6400 - from * from))) < 1);
    }
  }
  tc_clusters_free(c);
  test_free(p);
}

/* Lights of two colours add up, and a surface of another look has its own. */
TEST(lights_add_up_and_surfaces_have_their_own) {
  picture *p = new_picture();
  tc_mesh *meshes[2] = {spheres(90, 1, 40, 0), spheres(90, 1, 80, 0)};
  tc_clusters *c = parts(meshes, 2);
  const tc_raster_look looks[2] = {
      {.shaded = true, .n_lights = 2, .factor = {0.25f, 0.5f}, .lights = {{.to = {1, 0, 0}, .color = {1, 0, 0}}, {.to = {0, 1, 0}, .color = {0, 0, 1.5f}}}},
      {.shaded = false}};
  const tc_raster_surface surfaces[2] = {{{1, 1, 1}, 1, true, .look = 0}, {{0, 1, 0}, 0.5f, true, .look = 1}};
  for (int i = 0; i < 3; i++) {
    const drawing d = {.camera = above, .width = 200, .height = 200, .isa = isas[i], .shaded = true, .surfaces = surfaces, .looks = looks};
    if (!runs(isas[i])) continue;
    draw(c, &d, p);
    for (int y = 0; y < 200; y++)
      for (int x = 0; x < 200; x++) {
        const double right = (x + 0.5 - 100) / 40, down = (y + 0.5 - 100) / 40, r = hypot(right, down);
        const float *got = p->linear[y * 200 + x];
        if (r > 0.97 && (r < 1.03 || r > 1.95)) continue;
        const double red = r < 1 ? 0.25 + 0.5 * fmax(right, 0) : 0, blue = r < 1 ? 0.25 + 0.75 * fmax(down, 0) : 0, green = r < 1 ? 0.25 : 0;
        assert_true(fabs(got[0] - red / 2) < 4e-3 && fabs(got[2] - blue / 2) < 4e-3 && fabs(got[1] - green / 2 - 0.5) < 4e-3);
      }
  }
  tc_clusters_free(c);
  test_free(p);
}

enum { SOUP = 90 };

static tc_mesh *soup_part(int part) {
  tc_mesh *m = tc_mesh_new(3 * SOUP / 6, SOUP / 6, false, NULL);
  const double size = part == 5 ? 20 : 220;
  for (size_t t = 0; t < SOUP / 6; t++) {
    const double at[2] = {100 * (chance() - 0.5), 100 * (chance() - 0.5)};
    for (uint32_t v = 0; v < 3; v++) {
      float *to = m->positions[3 * t + v];
      for (int k = 0; k < 2; k++) to[k] = (float)(rint(256 * (at[k] + size * (chance() - 0.5))) / 256);
      to[2] = (float)(80 * (chance() - 0.5));
      m->triangles[t][v] = (uint32_t)(3 * t) + v;
    }
  }
  return m;
}

typedef struct crossing { double z; const tc_raster_surface *of; } crossing;

static int nearest_first(const void *a, const void *b) {
  const double x = ((const crossing *)a)->z, y = ((const crossing *)b)->z;
  return (x < y) - (x > y);
}

/* Every triangle of the soup there, sorted. False: too near an edge, or two too near each other, to be certain. */
static bool brute_force(tc_mesh *const meshes[6], double x, double y, double sum[4]) {
  crossing all[SOUP];
  int n = 0;
  for (size_t t = 0; t < SOUP; t++) {
    const tc_mesh *m = meshes[t / (SOUP / 6)];
    const uint32_t *v = m->triangles[t % (SOUP / 6)];
    const float *a = m->positions[v[0]], *b = m->positions[v[1]], *c = m->positions[v[2]];
    const double area = ((double)b[0] - a[0]) * ((double)c[1] - a[1]) - ((double)b[1] - a[1]) * ((double)c[0] - a[0]);
    const double u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area;
    const double w = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area, least = fmin(fmin(u, w), 1 - u - w);
    if (fabs(least) < 1e-3) return false;
    const tc_raster_surface *of = &six[t / (SOUP / 6)];
    if (least > 0 && !(of->one_sided && area < 0)) all[n++] = (crossing){u * a[2] + w * b[2] + (1 - u - w) * c[2], of};
  }
  qsort(all, (size_t)n, sizeof *all, nearest_first);
  for (int i = 0; i < n; i++) {
    if (i && all[i - 1].z - all[i].z < 1e-3) return false;
    composite(sum, all[i].of);
  }
  return true;
}

TEST(layers_are_in_the_order_of_brute_force) {
  picture *p = new_picture(), *q = new_picture();
  tc_mesh *meshes[6], *kept[6];
  for (int round = 0; round < 2; round++) {
    for (int i = 0; i < 6; i++) {
      state = (uint32_t)(7 * round + i), kept[i] = soup_part(i);
      state = (uint32_t)(7 * round + i), meshes[i] = soup_part(i);
    }
    tc_clusters *c = parts(meshes, 6);
    drawing d = {.camera = above, .width = 200, .height = 200, .isa = "scalar", .surfaces = six};
    int compared = 0, deep = 0;
    draw(c, &d, p);
    for (int i = 0; i < 200 * 200; i++) {
      double sum[4] = {0};
      if (!brute_force(kept, i % 200 - 99.5, 99.5 - i / 200, sum)) continue;
      compared++, deep += sum[3] > 0.9;
      for (int k = 0; k < 4; k++) assert_true(fabs(sum[k] - (double)p->linear[i][k]) < 4e-4);
    }
    assert_true(compared > 30000 && deep > 15000 && p->counts.layers > 150000);
    d.pool = tc_pool_new(3, NULL);
    for (int isa = 0; isa < 3; isa++) {
      if (!runs(isas[isa])) continue;
      d.isa = isas[isa];
      draw(c, &d, q);
      assert_memory_equal(p->linear, q->linear, sizeof p->linear);
      assert_memory_equal(p->depth, q->depth, 200 * 200 * sizeof *p->depth);
    }
    tc_pool_free(d.pool);
    tc_clusters_free(c);
    for (int i = 0; i < 6; i++) tc_mesh_free(kept[i]);
  }
  test_free(p), test_free(q);
}

/* n squares one behind the other, the first in front. */
static tc_mesh *stack(int n, double nearest) {
  tc_mesh *m = tc_mesh_new(4 * (size_t)n, 2 * (size_t)n, false, NULL);
  for (uint32_t i = 0, v = 0; i < (uint32_t)n; i++, v += 4) {
    const float corners[4][2] = {{-200, -200}, {200, -200}, {200, 200}, {-200, 200}};
    const uint32_t two[2][3] = {{v, v + 1, v + 2}, {v, v + 2, v + 3}};
    for (int k = 0; k < 4; k++) {
      memcpy(m->positions[v + (uint32_t)k], corners[k], sizeof *corners);
      m->positions[v + (uint32_t)k][2] = (float)(nearest - 0.125 * i);
    }
    memcpy(m->triangles[2 * i], two, sizeof two);
  }
  return m;
}

/* More than are sorted at once; and of many only those that light comes through are shaded, before what is opaque. */
TEST(many_layers_cost_what_is_seen_of_them) {
  picture *p = new_picture();
  tc_clusters *c = cluster(stack(300, 50));
  drawing d = {.camera = above, .width = 64, .height = 64, .surfaces = &(tc_raster_surface){{1, 1, 1}, 0.001f, false}};
  draw(c, &d, p);
  assert_int_equal(p->counts.layers, 300 * 64 * 64);
  for (int i = 0; i < 64 * 64; i++) assert_true(fabs(p->linear[i][3] - (1 - pow(0.999, 300))) < 1e-4);
  d.surfaces = &(tc_raster_surface){{1, 1, 1}, 0.5f, false};
  draw(c, &d, p);
  assert_int_equal(p->counts.shaded, 13 * 64 * 64);
  tc_clusters_free(c);
  c = parts((tc_mesh *[]){stack(20, 40), stack(1, 50)}, 2);
  d.surfaces = (const tc_raster_surface[]){{{1, 1, 1}, 0.5f, false}, {{1, 0, 0}, 1, false}};
  draw(c, &d, p);
  assert_true(p->counts.layers == 0 && p->counts.shaded == 64 * 64);
  tc_clusters_free(c);
  test_free(p);
}

/* What a row of a tile takes of memory and time is bounded: of 5 samples a pixel, 6553 layers. */
TEST(too_many_layers_are_refused) {
  GError *error = NULL;
  picture *p = new_picture();
  tc_clusters *c = cluster(stack(6600, 50));
  const drawing d = {.camera = above, .width = 64, .height = 64, .samples = 5,
                     .surfaces = &(tc_raster_surface){{1, 1, 1}, 0.001f, false}};
  assert_false(try_draw(c, &d, p, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_MEMORY) && strstr(error->message, "show fewer"));
  g_clear_error(&error);
  tc_clusters_free(c);
  test_free(p);
}

/* 50 layers in each pixel of one tile, 24 bytes each, and room for a quarter more. */
TEST(layers_take_no_more_memory_than_there_is) {
  GError *error = NULL;
  picture *p = new_picture();
  tc_clusters *c = cluster(stack(50, 50));
  drawing d = {.camera = above, .width = 64, .height = 64, .surfaces = &(tc_raster_surface){{1, 1, 1}, 0.001f, false}};
  const size_t bytes = 50 * 64 * 64 * 24;
  d.spare_bytes = bytes - 1;
  assert_false(try_draw(c, &d, p, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_MEMORY));
  g_clear_error(&error);
  d.spare_bytes = bytes + bytes / 4;
  draw(c, &d, p);
  printf("  %llu layers in %zu bytes\n", (unsigned long long)p->counts.layers, d.spare_bytes);
  assert_int_equal(p->counts.layers, 50 * 64 * 64);
  tc_clusters_free(c);
  test_free(p);
}

/* How often triangles cover pixels, against what is drawn: all of few, some of many, around the eye and beside the picture. */
TEST(what_is_covered_is_known_before) {
  static const tc_camera inside = {.projection = TC_PERSPECTIVE, .position = {1, 2, 0}, .target = {30, 5, 9}, .up = {0, 0, 1},
                                   .fov_y_deg = 60};
  static const tc_camera beside = {.projection = TC_ORTHOGRAPHIC, .position = {60, 60, 100}, .target = {60, 60, 0},
                                   .up = {0, 1, 0}, .height_mm = 90};
  static const tc_camera *const cameras[3] = {&above, &inside, &beside};
  picture *p = new_picture();
  for (int i = 0; i < 9; i++) {
    state = (uint32_t)i + 1;
    tc_mesh *m = i < 3 ? soup_part(0) : i < 6 ? stack(40, 30) : spheres(120, 2, 60, 0.5);
    const double thought = tc_mesh_coverage(m, cameras[i % 3], 200, 180, 1000);
    tc_clusters *c = cluster(m);
    draw(c, &(drawing){.camera = *cameras[i % 3], .width = 200, .height = 180,
                       .surfaces = &(tc_raster_surface){{1, 1, 1}, 0.001f, false}}, p);
    printf("  %llu pixels covered, %.0f thought\n", (unsigned long long)p->counts.layers, thought);
    const double true_one = (double)p->counts.layers;
    assert_true(thought > (i < 6 ? 0.97 : 0.8) * true_one && thought < (i < 6 ? 1.03 : 1.2) * true_one + 400);
    tc_clusters_free(c);
  }
  test_free(p);
}

/* A part that is copied out of several and put together again is what it was. */
TEST(parts_are_copied_whole) {
  tc_clusters *all = parts((tc_mesh *[]){spheres(30, 1, 20, 0), spheres(50, 1, 30, 0), spheres(10, 1, 40, 0)}, 3), *again = NULL;
  for (size_t i = 0; i < 3; i++)
    assert_true(tc_clusters_add(&again, tc_clusters_copy_part(all, i, NULL), &all->parts[i].of, NULL));
  assert_true(again->n == all->n && again->n_triangles == all->n_triangles && again->bytes == all->bytes);
  assert_true(again->vertex_room == all->vertex_room && again->triangle_room == all->triangle_room);
  assert_memory_equal(again->clusters, all->clusters, all->n * sizeof *all->clusters);
  assert_memory_equal(again->positions, all->positions, all->vertex_room * 12);
  assert_memory_equal(again->normals, all->normals, all->vertex_room * 4);
  assert_memory_equal(again->triangles, all->triangles, all->triangle_room * 3);
  for (size_t i = 0; i < 3; i++) assert_true(again->parts[i].closed && again->parts[i].first == all->parts[i].first);
  tc_clusters_free(all), tc_clusters_free(again);
}

TESTS(NULL, NULL)
