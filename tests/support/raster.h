/* Meshes and draw calls for tests of the rasteriser. */
#ifndef TC_TEST_RASTER_H
#define TC_TEST_RASTER_H

#include "tests/support/test.h"

#include "renderer/base/halt.h"
#include "renderer/mesh/coverage.h"
#include "renderer/mesh/raster.h"

#define MOST 320 /* largest side in pixels */

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
  const float *channels;             /* for coloured surfaces */
  const tc_raster_look *looks;       /* two looks; NULL: one, with a headlight */
  const tc_ledger *ledger;
} drawing;

static inline bool runs(const char *isa) {
  __builtin_cpu_init();
  if (!strcmp(isa, "avx512")) return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl");
  return strcmp(isa, "avx2") || (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"));
}
static const char *const isas[] = {"scalar", "avx2", "avx512"};

static inline bool keep(void *user, const tc_raster_picture *p) {
  picture *to = user;
  for (int y = p->y0; y < p->y1; y++) {
    size_t from = (size_t)(y - p->y0) * TC_RASTER_SIDE, at = (size_t)(y * to->width + p->x0), n = (size_t)(p->x1 - p->x0);
    memcpy(to->linear[at], p->linear[from], n * sizeof *to->linear);
    memcpy(to->depth + at, p->depth + from, n * sizeof *to->depth);
  }
  return true;
}

static const double five_samples[5][2] = {{-0.4, 0}, {-0.2, 0.381}, {0, -0.236}, {0.2, 0.145}, {0.4, -0.472}};

static inline bool try_draw(const tc_clusters *mesh, const drawing *d, picture *p, GError **error) {
  static const double one[1][2] = {{0, 0}};
  const tc_raster_surface one_surface = {{1, 0.5f, 0.25f}, 1, d->one_sided};
  tc_mesh_view view;
  tc_mesh_view_set_up(&view, mesh, &d->camera, d->width, d->height);
  tc_mesh_view_clip(&view, mesh, d->clip, d->n_clip);
  const tc_raster_look look = {.shaded = d->shaded, .n_lights = 1, .lights = {{.at_camera = true, .color = {1, 1, 1}}},
                               .factor = {0.2f, 0.7f}, .specular = d->samples > 1 ? 0.3f : 0, .shininess = 30};
  const tc_raster_job job = {.mesh = mesh, .view = &view, .kernels = tc_raster_kernels_named(d->isa ? d->isa : "scalar"),
                             .looks = d->looks ? d->looks : &look, .n_looks = d->looks ? 2 : 1,
                             .surfaces = d->surfaces ? d->surfaces : &one_surface, .channels = d->channels,
                             .n_samples = d->samples > 1 ? 5 : 1, .samples = d->samples > 1 ? five_samples : one,
                             .want_depth = true,
                             .forward = d->forward, .ledger = d->ledger, .emit = keep, .user = p, .pool = d->pool};
  p->width = d->width, p->height = d->height;
  p->counts = (tc_raster_counts){0};
  return tc_raster_draw(&job, &p->counts, error);
}

static inline void draw(const tc_clusters *mesh, const drawing *d, picture *p) {
  GError *error = NULL;
  if (!try_draw(mesh, d, p, &error)) fail_msg("%s", error->message);
}

static inline tc_clusters *cluster(tc_mesh *mesh) {
  GError *error = NULL;
  tc_clusters *c = tc_clusters_make(mesh, NULL, NULL, &error);
  if (!c) fail_msg("%s", error->message);
  tc_mesh_free(mesh);
  return c;
}

static inline picture *new_picture(void) { return test_calloc(1, sizeof(picture)); }

/* ---- meshes ---- */

static uint32_t state = 1;
static inline double chance(void) {
  state = state * 1664525u + 1013904223u;
  return (state >> 8) / 16777216.0;
}

/* A sheet of n x n irregular cells from (lo, lo) to (hi, hi); inner vertices are multiples of `snap`. */
static inline tc_mesh *sheet(int n, double lo, double hi, double snap, double hills) {
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
static inline void put_sphere(tc_mesh *m, int rings, size_t v, size_t t, double radius, double cx) {
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
      const uint32_t next = (i + 1) % around, last = (uint32_t)rings - 1; /* a pole is a single vertex */
      uint32_t a = first + j * around + (j ? i : 0), b = first + j * around + (j ? next : 0);
      uint32_t c = first + (j + 1) * around + (j < last ? i : 0), d = first + (j + 1) * around + (j < last ? next : 0);
      const uint32_t two[2][3] = {{a, c, d}, {a, d, b}};
      memcpy(m->triangles[t], two, sizeof two);
    }
}

static inline tc_mesh *spheres(int rings, int n, double radius, double apart) {
  const size_t vertices = 2 * (size_t)rings * ((size_t)rings + 1), triangles = 4 * (size_t)rings * (size_t)rings;
  tc_mesh *m = tc_mesh_new((size_t)n * vertices, (size_t)n * triangles, true, NULL);
  for (int i = 0; i < n; i++)
    put_sphere(m, rings, (size_t)i * vertices, (size_t)i * triangles, radius - (apart > 0 ? 0 : 5 * i), apart * i);
  return m;
}

static const tc_camera above = {.projection = TC_ORTHOGRAPHIC, .position = {0, 0, 100}, .up = {0, 1, 0}, .height_mm = 200};

#endif
