/* Splat objects and draw calls for their tests. */
#ifndef TC_TEST_SPLATS_H
#define TC_TEST_SPLATS_H

#include "tests/support/test.h"

#include "renderer/frame/frame.h"
#include "renderer/splat/pick.h"
#include "renderer/splat/splatter.h"
#include "tests/support/grid.h"
#include "tests/support/image.h"

G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_splats, tc_splats_free)
G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_vmd_object, tc_vmd_object_free)

enum { SIDE = 96 };

/* An object ready to draw: a volume's values from 0 on. */
typedef struct object {
  tc_volume *volume;
  tc_vmd *model;
  tc_splats *splats, *everything;
} object;

static inline object object_of(const test_grid *grid, test_field field, const void *context) {
  object o = {.volume = test_volume(grid, field, context)};
  o.model = tc_vmd_of_volume(o.volume, &(tc_vmd_options){.low = 0, .high = INFINITY}, NULL, NULL);
  g_autoptr(tc_vmd_object) subject = tc_vmd_object_new(o.volume, 0, INFINITY);
  const tc_splat_normals normals = {tc_vmd_normal_at, subject, tc_vmd_end_at};
  o.splats = tc_splats_build(o.model, normals, false, NULL, NULL);
  o.everything = tc_splats_build(o.model, normals, true, NULL, NULL);
  assert_true(o.splats && o.everything && (o.splats->n > 0 || o.splats->sides == 63));
  assert_int_equal(o.everything->n, o.model->voxels);
  return o;
}

static inline void object_free(object *o) {
  tc_splats_free(o->splats);
  tc_splats_free(o->everything);
  tc_vmd_free(o->model);
  tc_volume_unref(o->volume);
}
G_DEFINE_AUTO_CLEANUP_CLEAR_FUNC(object, object_free)

typedef struct drawing {
  tc_frame frame;
  tc_splat_counts counts;
} drawing;

static inline void drawing_finish(drawing *d) { tc_frame_finish(&d->frame); }
G_DEFINE_AUTO_CLEANUP_CLEAR_FUNC(drawing, drawing_finish)

typedef struct wish {
  const char *isa;
  tc_pool *pool;
  const tc_interrupt *interrupt;
  bool resume;
  tc_splat_material material;
} wish;

static inline bool draw(const object *o, const tc_scene *scene, wish w, drawing *d, GError **error) {
  const tc_render_request request = {.want_linear = true, .want_depth = true, .resume = w.resume};
  double planes[TC_SPLAT_MOST_PLANES][4];
  const int n = tc_splat_planes(o->volume, scene, o->splats->sides, planes);
  g_autoptr(tc_splats) cut =
      n && scene->splat.opaque ? tc_splats_cut(o->model, o->splats, (const double(*)[4])planes, n, NULL, NULL) : NULL;
  assert_true(tc_frame_begin(&d->frame, scene->image.width, scene->image.height, &request, NULL));
  const tc_halt halt = tc_halt_begin(w.interrupt, d->frame.progress->fruitless);
  const int done = d->frame.progress->done;
  if (w.pool) tc_pool_watch(w.pool, &halt);
  const tc_splat_job job = {.volume = o->volume,
                            .splats = scene->splat.culling && scene->splat.opaque ? o->splats : o->everything,
                            .material = w.material,
                            .cut = cut,
                            .scene = scene,
                            .isa = w.isa,
                            .pool = w.pool,
                            .halt = &halt,
                            .frame = &d->frame,
                            .want_linear = true,
                            .want_depth = true,
                            .counts = &d->counts};
  bool drawn = tc_splat_draw(&job, error);
  if (w.pool) tc_pool_watch(w.pool, NULL);
  d->frame.progress->paused = !drawn;
  d->frame.progress->fruitless = d->frame.progress->done > done ? 0 : d->frame.progress->fruitless + 1;
  return drawn;
}

static inline void draw_now(const object *o, const tc_scene *scene, wish w, drawing *d) {
  GError *error = NULL;
  if (!draw(o, scene, w, d, &error)) fail_msg("%s", error->message);
}

/* A ball of radius context[0], deformed by waves, in the middle of 40 voxels a side. */
static inline double blob(double x, double y, double z, const void *context) {
  const double *c = context, dx = x - 19.5, dy = y - 19.5, dz = z - 19.5;
  return c[0] - sqrt(dx * dx + dy * dy + dz * dz) - c[1] * (sin(dx * 0.9) + cos(dy * 0.7) + sin(dz * 0.8));
}

static const double ball[2] = {15, 0}, rough[2] = {14, 1.2};
static const test_grid cube = {.dims = {40, 40, 40}, .type = TC_F32};
static const test_grid flat_grid = {.dims = {40, 40, 40},
                                    .type = TC_F32,
                                    .spacing = {0.5, 1, 1.7},
                                    .origin = {100, -50, 7},
                                    .direction = {0, 0.96, 0.28, -1, 0, 0, 0, -0.28, 0.96}};

/* Tubes of context[0] voxels' radius along no axis, of which voxels touch by corners and edges alone; 40 voxels a side. */
static const double tube_ends[3][2][3] = {
    {{4, 5, 6}, {35, 33, 30}}, {{6, 33, 8}, {34, 8, 20}}, {{7, 8, 34}, {33, 24, 9}}};

static inline double tubes(double x, double y, double z, const void *context) {
  double nearest = 1e9;
  for (int i = 0; i < 3; i++) {
    const double *from = tube_ends[i][0], p[3] = {x - from[0], y - from[1], z - from[2]};
    double d[3], along = 0, length = 0, away = 0;
    for (int k = 0; k < 3; k++) d[k] = tube_ends[i][1][k] - from[k], along += p[k] * d[k], length += d[k] * d[k];
    const double t = fmin(fmax(along / length, 0), 1);
    for (int k = 0; k < 3; k++) away += (p[k] - t * d[k]) * (p[k] - t * d[k]);
    nearest = fmin(nearest, sqrt(away));
  }
  return *(const double *)context - nearest;
}

/* The i-th viewing direction. */
static inline void direction(int i, double side[3]) {
  const double golden = i * 2.39996323, z = 1 - 2 * (i + 0.5) / 24, r = sqrt(1 - z * z);
  side[0] = r * cos(golden), side[1] = r * sin(golden), side[2] = z;
  if (i < 6) side[0] = side[1] = side[2] = 0, side[i / 2] = i & 1 ? 1 : -1;
}

static inline void look(tc_scene *scene, const object *o, int i, double zoom) {
  double side[3];
  direction(i, side);
  test_scene(scene, SIDE, SIDE);
  scene->splat.opaque = scene->splat.culling = true;
  test_scene_frame(scene, o->volume, i % 2 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, side);
  tc_camera *c = &scene->camera;
  c->height_mm /= zoom;
  c->fov_y_deg = atan(tan(c->fov_y_deg * M_PI / 360) / zoom) * 360 / M_PI;
  scene->image.linear_light = false;
}

#endif
