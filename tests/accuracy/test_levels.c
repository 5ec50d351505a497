/* Levels of detail: their stated error against the full surface, no crack between them, what is chosen at rest and while
 * moving, their memory, and how they are made beside the frames. */
#include "tests/support/test.h"

#include <pthread.h>
#include <time.h>

#include <glib.h>

#include "renderer/frame/cache.h"
#include "renderer/mesh/levels.h"
#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/ledger.h"

#define ISO 0.5

typedef struct fixture {
  tc_volume *volume;
  tc_clusters *full, *levels; /* levels: with them */
} fixture;
static fixture f;

static tc_clusters *clusters_of(const tc_volume *volume) {
  g_autoptr(tc_mesh) mesh = tc_mesh_extract(volume, ISO, &(tc_mesh_options){.normals = true}, NULL);
  tc_clusters *c = tc_clusters_make(mesh, NULL, NULL, NULL);
  assert_non_null(c);
  return c;
}

static int set_up(void **state) {
  const test_grid grid = {.dims = {64, 60, 58}, .type = TC_U8, .slope = 0.004, .spacing = {1, 1.2, 0.9}};
  f.volume = test_volume(&grid, test_waves, &(double){19});
  f.full = clusters_of(f.volume), f.levels = clusters_of(f.volume);
  tc_clusters *made = tc_levels_make(f.levels, NULL, NULL);
  return made && tc_levels_add(f.levels, made, NULL) ? 0 : -1;
}

static int tear_down(void **state) {
  tc_clusters_free(f.full), tc_clusters_free(f.levels);
  tc_volume_unref(f.volume);
  return 0;
}

/* ---- clusters ---- */

static tc_clusters *made_with(int threads, bool ordered, double *radius) {
  tc_pool *pool = tc_pool_new(threads, NULL);
  g_autoptr(tc_mesh) mesh = tc_mesh_extract(f.volume, ISO, &(tc_mesh_options){.normals = true, .pool = pool}, NULL);
  assert_true(mesh->ordered);
  mesh->ordered = ordered;
  tc_clusters *c = tc_clusters_make(mesh, pool, NULL, NULL);
  *radius = 0;
  for (size_t i = 0; i < c->n; i++) *radius += (double)c->clusters[i].radius / (double)c->n;
  tc_pool_free(pool);
  return c;
}

/* The order of an extracted mesh gives clusters as compact as those of sorted triangles, and as many; threads change nothing. */
TEST(clusters_follow_the_order_of_the_mesh) {
  double radius[2], other;
  size_t n[2];
  for (int ordered = 0; ordered < 2; ordered++) {
    tc_clusters *a = made_with(1, ordered, &radius[ordered]), *b = made_with(3, ordered, &other);
    n[ordered] = a->n;
    assert_true(a->n == b->n && a->vertex_room == b->vertex_room && a->triangle_room == b->triangle_room);
    assert_int_equal(a->n_triangles, f.full->n_triangles);
    assert_memory_equal(a->clusters, b->clusters, a->n * sizeof *a->clusters);
    assert_memory_equal(a->positions, b->positions, a->vertex_room * 12);
    assert_memory_equal(a->normals, b->normals, a->vertex_room * 4);
    assert_memory_equal(a->triangles, b->triangles, a->triangle_room * 3);
    tc_clusters_free(a), tc_clusters_free(b);
  }
  printf("  sorted: %zu clusters of mean radius %.2f mm; as extracted: %zu of %.2f mm\n", n[0], radius[0], n[1], radius[1]);
  assert_true(radius[1] < 1.05 * radius[0] && (double)n[1] < 1.05 * (double)n[0]);
}

/* ---- geometry ---- */

static void corners_of(const tc_clusters *c, const tc_cluster *k, size_t t, double at[3][3]) {
  const size_t room = tc_cluster_padded(k->n_vertices), row = tc_cluster_padded(k->n_triangles);
  for (size_t i = 0; i < 3; i++)
    for (size_t d = 0; d < 3; d++)
      at[i][d] = (double)c->positions[3 * (size_t)k->vertex + d * room + c->triangles[3 * (size_t)k->triangle + i * row + t]];
}

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Distance from a triangle, by walking its plane's foot back onto the edges. */
static double from_triangle(const double p[3], double at[3][3]) {
  double best = INFINITY, u[3], v[3], w[3];
  for (int k = 0; k < 3; k++) u[k] = at[1][k] - at[0][k], v[k] = at[2][k] - at[0][k], w[k] = p[k] - at[0][k];
  const double uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), det = uu * vv - uv * uv;
  const double s = (vv * dot(w, u) - uv * dot(w, v)) / det, t = (uu * dot(w, v) - uv * dot(w, u)) / det;
  if (det > 0 && s >= 0 && t >= 0 && s + t <= 1) {
    double off[3];
    for (int k = 0; k < 3; k++) off[k] = w[k] - s * u[k] - t * v[k];
    return sqrt(dot(off, off));
  }
  for (int e = 0; e < 3; e++) {
    double along[3], off[3];
    for (int k = 0; k < 3; k++) along[k] = at[(e + 1) % 3][k] - at[e][k], off[k] = p[k] - at[e][k];
    const double length = dot(along, along), share = length > 0 ? fmin(fmax(dot(off, along) / length, 0), 1) : 0;
    for (int k = 0; k < 3; k++) off[k] -= share * along[k];
    best = fmin(best, sqrt(dot(off, off)));
  }
  return best;
}

/* From the triangles that a group has at a level. */
static double from_level(const tc_clusters *c, size_t group, uint32_t level, const double p[3]) {
  double best = INFINITY;
  for (size_t i = 0; i < c->n; i++) {
    const tc_cluster *k = &c->clusters[i];
    double apart = 0;
    for (int d = 0; d < 3; d++) apart += (p[d] - (double)k->centre[d]) * (p[d] - (double)k->centre[d]);
    if (k->group != group || k->level != level || sqrt(apart) - (double)k->radius > best) continue;
    for (size_t t = 0; t < k->n_triangles; t++) {
      double at[3][3];
      corners_of(c, k, t, at);
      best = fmin(best, from_triangle(p, at));
    }
  }
  return best;
}

/* No vertex of the full surface is farther from a level than is stated, nor what a level has between its vertices from the
 * full surface; and each level is much smaller than the one before. */
TEST(errors_are_as_stated) {
  const tc_clusters *c = f.levels;
  double share[TC_LEVELS] = {0}, most[TC_LEVELS] = {0};
  assert_true(c->n_groups >= 4);
  for (size_t g = 0; g < c->n_groups; g++)
    for (uint32_t l = 1; l < TC_LEVELS; l++) {
      const tc_group *group = &c->groups[g];
      const double error = (double)group->error[l];
      share[l] += isfinite(error) ? group->triangles[l] : group->triangles[0];
      if (!isfinite(error)) continue;
      most[l] = fmax(most[l], error);
      assert_true(error >= (double)group->error[l - 1] && error > 0);
      for (size_t i = 0, n = 0; i < c->n; i++) {
        const tc_cluster *k = &c->clusters[i];
        if (k->group != g || (k->level != 0 && k->level != l)) continue;
        for (size_t t = k->level ? 0 : 7; t < k->n_triangles; t += k->level ? 9 : 61) {
          double at[3][3], middle[3];
          corners_of(c, k, t, at);
          for (int d = 0; d < 3; d++) middle[d] = (at[0][d] + at[1][d] + at[2][d]) / 3;
          assert_true(from_level(c, g, k->level ? 0 : l, k->level ? middle : at[n++ % 3]) <= error * 1.0001 + 1e-5);
        }
      }
    }
  const double all = (double)tc_clusters_in_full(c);
  printf("  %.0f triangles; levels of %.1f and %.1f %%, off by at most %.3f and %.3f mm\n", all, 100 * share[1] / all,
         100 * share[2] / all, most[1], most[2]);
  assert_true(share[1] < 0.4 * all && share[2] < 0.2 * all);
}

enum { OTHER_WAY = 1000 }; /* a use one way counts 1 */

typedef struct edge {
  float ends[2][3]; /* in order of their bytes */
  uint32_t group;   /* UINT32_MAX: any */
} edge;

/* A group of several colours has no other level: a level's error is of places. */
TEST(colours_are_not_simplified_away) {
  g_autoptr(tc_mesh) m = tc_mesh_extract(f.volume, 0.5, &(tc_mesh_options){.normals = true}, NULL);
  size_t n[2], one = 0;
  assert_true(tc_mesh_add_colors(m, NULL));
  for (int several = 0; several < 2; several++) {
    for (size_t v = 0; v < m->n_vertices; v++) m->colors[v] = several && m->positions[v][0] > 0 ? 0xff : 0xff00;
    tc_clusters *c = tc_clusters_make(m, NULL, NULL, NULL), *made = tc_levels_make(c, NULL, NULL);
    assert_true(made && tc_levels_add(c, made, NULL));
    n[several] = 0;
    for (size_t g = 0; g < c->n_groups; g++) {
      uint32_t first = 0;
      bool same = true;
      for (size_t i = c->groups[g].first; i < c->groups[g].first + c->groups[g].n; i++)
        for (size_t v = 0; v < c->clusters[i].n_vertices; v++) {
          const uint32_t color = c->colors[c->clusters[i].vertex + v];
          same = same && (!first || color == first), first = color;
        }
      one += several && same, n[several] += isfinite(c->groups[g].error[1]);
      assert_true(same || !isfinite(c->groups[g].error[1]));
    }
    for (size_t i = 0; i < c->n; i++) assert_true(c->colors[c->clusters[i].vertex] == 0xff || c->colors[c->clusters[i].vertex] == 0xff00);
    tc_clusters_free(c);
  }
  print_message("  %zu groups have levels; %zu where there are two colours, of %zu with one\n", n[0], n[1], one);
  assert_true(n[0] > n[1] && n[1] > 0 && n[1] <= one);
}

/* Every edge within the volume goes as often one way as the other, whatever levels neighbours have, and within a group no
 * more than once. (Two groups may both have gained an edge between the same two vertices of their border.) */
TEST(levels_are_manifolds_that_meet_without_a_crack) {
  const tc_clusters *c = f.levels;
  uint64_t seed = 5;
  for (int round = 0; round < 3; round++) {
    g_autoptr(GHashTable) edges =
        g_hash_table_new_full(g_bytes_hash, g_bytes_equal, (GDestroyNotify)g_bytes_unref, NULL);
    g_autofree uint8_t *level = g_malloc(c->n_groups);
    for (size_t g = 0; g < c->n_groups; g++) {
      level[g] = (uint8_t)(test_random(&seed) * TC_LEVELS);
      while (!isfinite(c->groups[g].error[level[g]])) level[g]--;
    }
    for (size_t i = 0; i < c->n; i++) {
      const tc_cluster *k = &c->clusters[i];
      for (size_t t = 0; t < k->n_triangles && k->level == level[k->group]; t++) {
        double at[3][3];
        corners_of(c, k, t, at);
        for (int e = 0; e < 3; e++) {
          edge key = {0};
          for (int d = 0; d < 3; d++) key.ends[0][d] = (float)at[e][d], key.ends[1][d] = (float)at[(e + 1) % 3][d];
          const bool turn = memcmp(key.ends[0], key.ends[1], 12) > 0;
          if (turn) key = (edge){{{key.ends[1][0], key.ends[1][1], key.ends[1][2]}, {key.ends[0][0], key.ends[0][1], key.ends[0][2]}}, 0};
          for (int of = 0; of < 2; of++) {
            key.group = of ? k->group : UINT32_MAX;
            GBytes *b = g_bytes_new(&key, sizeof key);
            const int uses = GPOINTER_TO_INT(g_hash_table_lookup(edges, b)) + (turn ? OTHER_WAY : 1);
            g_hash_table_replace(edges, b, GINT_TO_POINTER(uses));
          }
        }
      }
    }
    GHashTableIter iter;
    gpointer key, uses;
    const tc_volume_desc *d = tc_volume_describe(f.volume);
    g_hash_table_iter_init(&iter, edges);
    while (g_hash_table_iter_next(&iter, &key, &uses)) {
      const edge *e = g_bytes_get_data(key, NULL);
      bool outside = false; /* in a face of the volume the surface ends */
      for (int k = 0; k < 3; k++) {
        const float half = (float)(0.5 * (d->dims[k] - 1) * d->spacing[k]) * 0.9999f;
        outside |= fabsf(e->ends[0][k]) > half && fabsf(e->ends[1][k]) > half;
      }
      const int one = GPOINTER_TO_INT(uses) % OTHER_WAY, other = GPOINTER_TO_INT(uses) / OTHER_WAY;
      assert_true(e->group == UINT32_MAX ? outside || one == other : one <= 1 && other <= 1);
    }
  }
}

/* ---- the choice ---- */

static void look(tc_camera *camera, tc_projection projection, double apart, double size) {
  *camera = (tc_camera){.projection = projection, .up = {0, 0, 1}, .fov_y_deg = size, .height_mm = size};
  for (int k = 0; k < 3; k++) camera->target[k] = f.levels->origin[k], camera->position[k] = f.levels->origin[k];
  camera->position[1] -= apart;
}

static void place(const tc_mesh_view *v, const double p[3], double at[2]) {
  const double depth = tc_mesh_view_row(v->depth, p) + v->reference, by = v->perspective ? v->scale / depth : v->scale;
  at[0] = v->centre[0] + by * tc_mesh_view_row(v->right, p), at[1] = v->centre[1] + by * tc_mesh_view_row(v->down, p);
}

/* However a point of the surface is displaced by what its level may be off, its place in the picture moves by less than the
 * limit; and where there is room, coarser levels are taken. */
TEST(choices_are_bounded_in_pixels) {
  const tc_clusters *c = f.levels;
  g_autofree uint8_t *level = g_malloc(c->n_groups);
  for (int i = 0; i < 12; i++) {
    const double pixels = i & 1 ? 1 : 0.5, apart = (double[]){70, 200, 900}[i / 4];
    tc_camera camera;
    tc_mesh_view view;
    look(&camera, i & 2 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE, apart, i & 2 ? apart : 40);
    tc_mesh_view_set_up(&view, c, &camera, 300, 200);
    const size_t n = tc_levels_choose(c, &view, pixels, level);
    double most = 0;
    for (size_t k = 0; k < c->n; k++) {
      const tc_cluster *cluster = &c->clusters[k];
      const double by = (double)c->groups[cluster->group].error[level[cluster->group]];
      double at[3][3], from[2], to[2];
      if (cluster->level || by == 0) continue;
      corners_of(c, cluster, 0, at);
      place(&view, at[0], from);
      for (int way = 0; way < 26; way++) {
        const int w = way < 13 ? way : way + 1;
        const double to_side[3] = {w % 3 - 1, w / 3 % 3 - 1, w / 9 - 1}, norm = sqrt(dot(to_side, to_side));
        double p[3];
        for (int d = 0; d < 3; d++) p[d] = at[0][d] + by * to_side[d] / norm;
        place(&view, p, to);
        if (from[0] < 0 || from[1] < 0 || from[0] > 300 || from[1] > 200) continue;
        most = fmax(most, hypot(to[0] - from[0], to[1] - from[1]));
      }
    }
    printf("  %s, %g mm away, %g pixels: %zu of %zu triangles, off by at most %.3f\n", i & 2 ? "parallel" : "perspective",
           apart, pixels, n, tc_clusters_in_full(c), most);
    assert_true(most <= pixels * 1.02); /* a ball is not quite a disc in the picture */
    if (apart > 800) assert_true(n < tc_clusters_in_full(c) / 3);
  }
}

TEST(a_triangle_takes_at_most_40_bytes) {
  const double n = (double)tc_clusters_in_full(f.levels);
  printf("  %.1f bytes a triangle, %.1f with levels\n", (double)f.full->bytes / n, (double)f.levels->bytes / n);
  assert_true((double)f.levels->bytes <= 40 * n);
  assert_true(f.levels->bytes - f.full->bytes <= tc_levels_bytes(f.full));
}

typedef struct making {
  atomic_bool stop, begun;
  struct timespec over; /* of its thread's own clock */
} making;

static void *make_until_stopped(void *context) {
  making *m = context;
  atomic_store(&m->begun, true);
  while (!atomic_load(&m->stop)) tc_clusters_free(tc_levels_make(f.full, &m->stop, NULL));
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &m->over);
  return NULL;
}

/* Wherever it is, a stop ends it within 50 ms of its thread's own time. */
TEST(making_ends_soon) {
  double longest = 0;
  for (int i = 0; i < 8; i++) {
    making m = {0};
    pthread_t thread;
    clockid_t clock;
    struct timespec stopped;
    assert_int_equal(pthread_create(&thread, NULL, make_until_stopped, &m), 0);
    while (!atomic_load(&m.begun)) nanosleep(&(struct timespec){.tv_nsec = 100000}, NULL);
    nanosleep(&(struct timespec){.tv_nsec = 3000000 + 12000000 * i}, NULL);
    assert_int_equal(pthread_getcpuclockid(thread, &clock), 0);
    clock_gettime(clock, &stopped);
    atomic_store(&m.stop, true);
    pthread_join(thread, NULL);
    longest = fmax(longest, 1e3 * (double)(m.over.tv_sec - stopped.tv_sec) + 1e-6 * (double)(m.over.tv_nsec - stopped.tv_nsec));
  }
  print_message("  %.1f ms at most\n", longest);
  assert_true(longest < 50);
}

TEST(making_is_cancelled) {
  GError *error = NULL;
  atomic_bool stop = true;
  assert_null(tc_levels_make(f.full, &stop, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_CANCELLED));
  g_clear_error(&error);
  tc_clusters_free(tc_refining_end(tc_refining_begin(f.full)));
  tc_refining_end(NULL);
}

TEST(one_thread_makes_them) {
  tc_refining *one = tc_refining_begin(f.full);
  assert_non_null(one);
  tc_refining *two = tc_refining_begin(f.full);
  assert_true(!two || tc_refining_is_over(one));
  tc_clusters_free(tc_refining_end(two)), tc_clusters_free(tc_refining_end(one));
}

/* ---- frames ---- */

/* moving: 0: at rest; otherwise the factor of coarser levels. */
static void draw(tc_renderer *r, const tc_scene *scene, int moving, tc_frame *frame, tc_explanation *plan) {
  GError *error = NULL;
  const tc_render_request request = {.want_depth = true, .moving = moving > 0, .coarser_levels = moving, .explanation = plan};
  if (!tc_render(r, f.volume, scene, &request, frame, &error))
    fail_msg("%s", error->message);
}

static bool has_levels(const tc_explanation *plan) { return strstr(plan->stages[TC_STAGE_MESH].reason, "levels of detail"); }

/* The first frame shows all of it; levels come beside, are in the plan and in the memory that is counted, and at rest the
 * surface is where it was within what half a pixel is there. */
static void come_beside(tc_renderer *r) {
  g_auto(tc_frame) full = {0}, frame = {0};
  tc_explanation plan;
  g_auto(tc_scene) scene;
  test_scene(&scene, 160, 120);
  test_scene_frame(&scene, f.volume, TC_PERSPECTIVE, (double[3]){0.5, -1, 0.3});
  scene.mode = TC_MODE_MESH, scene.isosurface.value = ISO, scene.skipping.mode = TC_SKIPPING_OFF;
  draw(r, &scene, 0, &full, &plan);
  assert_false(has_levels(&plan));
  const uint64_t before = plan.stages[TC_STAGE_MESH].bytes;
  for (int i = 0; i < 6000 && !has_levels(&plan); i++) {
    g_usleep(10000);
    draw(r, &scene, 0, &frame, &plan);
  }
  assert_true(has_levels(&plan));
  printf("  %s\n", plan.stages[TC_STAGE_MESH].reason);
  assert_true(plan.stages[TC_STAGE_MESH].bytes == f.levels->bytes && before < f.levels->bytes);
  for (int i = 0; i < 40; i++) { /* once: nothing is made anew beside later frames */
    assert_true(tc_renderer_cached(r) == f.levels->bytes && plan.stages[TC_STAGE_MESH].bytes == f.levels->bytes);
    g_usleep(10000);
    draw(r, &scene, 0, &frame, &plan);
  }
  int ends = 0;
  for (int i = 0; i < 160 * 120; i++) ends += isfinite(full.depth[i]) != isfinite(frame.depth[i]);
  assert_true(ends < 160 * 120 / 100);
  size_t triangles[2];
  for (int coarser = 1; coarser <= 2; coarser++) {
    draw(r, &scene, coarser, &frame, &plan);
    const char *said = strstr(plan.stages[TC_STAGE_MESH].reason, coarser == 1 ? "within 1 pixels: " : "within 2 pixels: ");
    assert_non_null(said);
    assert_int_equal(sscanf(said + 17, "%zu", &triangles[coarser - 1]), 1);
  }
  printf("  moving: %zu triangles, at coarser levels %zu\n", triangles[0], triangles[1]);
  assert_true(triangles[1] < triangles[0]);
}

TEST(levels_come_beside) {
  for (int i = 0; i < 2; i++) {
    const tc_backend backend = i ? TC_BACKEND_GL : TC_BACKEND_CPU;
    g_autoptr(tc_renderer) r = tc_renderer_new(&(tc_renderer_options){.backend = backend, .threads = 2, .levels = true}, NULL);
    assert_true(r || i); /* not every machine has OpenGL */
    if (r) come_beside(r);
  }
}

/* Where the cache has no room for them there are none, and the surface is drawn in full; a frame that moves begins none. */
TEST(levels_need_memory_and_rest) {
  for (int i = 0; i < 2; i++) {
    bounded_ledger ledger;
    bound_ledger(&ledger, i ? INT64_MAX : f.full->bytes * 5 / 4);
    const tc_renderer_options options = {.backend = TC_BACKEND_CPU, .threads = 1, .ledger = &ledger.ledger, .levels = true};
    g_autoptr(tc_renderer) r = tc_renderer_new(&options, NULL);
    g_auto(tc_frame) frame = {0};
    tc_explanation plan;
    g_auto(tc_scene) scene;
    test_scene(&scene, 60, 60);
    test_scene_frame(&scene, f.volume, TC_PERSPECTIVE, (double[3]){0.5, -1, 0.3});
    scene.mode = TC_MODE_MESH, scene.isosurface.value = ISO, scene.skipping.mode = TC_SKIPPING_OFF;
    for (int n = 0; n < 5; n++) draw(r, &scene, i, &frame, &plan);
    assert_true(tc_renderer_cached(r) == f.full->bytes && !has_levels(&plan));
  }
}

TESTS(set_up, tear_down)
