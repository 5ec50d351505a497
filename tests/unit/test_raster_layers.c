/* The rasteriser: translucent layers, their order, memory and bounds; meshes of several parts. */
#include "tests/support/ledger.h"
#include "tests/support/raster.h"

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
  bounded_ledger ledger;
  bound_ledger(&ledger, bytes - 1);
  d.ledger = &ledger.ledger;
  assert_false(try_draw(c, &d, p, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_MEMORY));
  g_clear_error(&error);
  assert_true(atomic_load(&ledger.left) == (int64_t)bytes - 1 && atomic_load(&ledger.refused) > 0);
  bound_ledger(&ledger, bytes + bytes / 4);
  draw(c, &d, p);
  printf("  %llu layers in %zu bytes\n", (unsigned long long)p->counts.layers, bytes + bytes / 4);
  assert_int_equal(atomic_load(&ledger.left), bytes + bytes / 4); /* all given back */
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

/* Whatever the order of small and large parts, and wherever they lie: depth buffers end at the sphere. */
TEST(the_sphere_holds_all_parts) {
  for (int round = 0; round < 40; round++) {
    tc_mesh *meshes[3];
    for (int i = 0; i < 3; i++) {
      const double lo = 100 * (chance() - 0.5), size = round & 1 << i ? 5 : 100;
      meshes[i] = sheet(4, lo, lo + size, 0.01, 3);
    }
    tc_clusters *c = parts(meshes, 3);
    for (size_t i = 0; i < c->n; i++) {
      const size_t room = tc_cluster_padded(c->clusters[i].n_vertices);
      const float *at = c->positions + 3 * (size_t)c->clusters[i].vertex;
      for (size_t v = 0; v < c->clusters[i].n_vertices; v++) {
        double square = 0;
        for (size_t k = 0; k < 3; k++) square += pow((double)at[k * room + v] - (double)c->centre[k], 2);
        assert_true(sqrt(square) <= (double)c->radius);
      }
    }
    tc_clusters_free(c);
  }
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
