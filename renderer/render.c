/* The renderer: plan, shared resources, dispatch to a back end. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "renderer/backend.h"

#define DEFAULT_CACHE_BYTES (256u << 20)
#define MAX_TABLES 32

/* A table and what it was built from. */
typedef struct cached_table {
  tc_table *table;
  tc_table_params params; /* .tf points to tf below */
  tc_transfer_function tf;
  uint64_t last_use;
} cached_table;

struct tc_renderer {
  const tc_backend_ops *ops;
  void *instance;
  tc_pool *pool;
  tc_renderer_info info;
  char why[200];
  uint64_t cache_bytes, clock;
  cached_table tables[MAX_TABLES];
  int n_tables;
};

static double now_ms(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

/* ---- life ---- */

static const tc_backend_ops *choose_backend(tc_backend wanted, char *why, size_t size) {
  bool hardware = false;
  switch (wanted) {
  case TC_BACKEND_CPU: snprintf(why, size, "asked for"); return &tc_cpu_backend;
  case TC_BACKEND_GL: snprintf(why, size, "asked for"); return &tc_gl_backend;
  case TC_BACKEND_AUTO:
  case TC_BACKEND_COUNT: break;
  }
  return tc_gl_probe(&hardware, why, size) && hardware ? &tc_gl_backend : &tc_cpu_backend;
}

tc_renderer *tc_renderer_new(const tc_renderer_options *options, GError **error) {
  tc_renderer_options defaults = {0};
  if (!options) options = &defaults;
  tc_renderer *r = calloc(1, sizeof *r);
  if (!r) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "renderer: out of memory");
    return NULL;
  }
  r->cache_bytes = options->cache_bytes ? options->cache_bytes : DEFAULT_CACHE_BYTES;
  r->pool = tc_pool_new(options->threads, error);
  if (r->pool) {
    r->ops = choose_backend(options->backend, r->why, sizeof r->why);
    r->instance = r->ops->create(options, r->pool, error);
  }
  if (!r->instance) {
    tc_renderer_free(r);
    return NULL;
  }
  r->info = (tc_renderer_info){.backend = r->ops->name,
                               .why = r->why,
                               .device = r->ops->device(r->instance),
                               .isa = r->ops->isa(r->instance),
                               .threads = tc_pool_threads(r->pool)};
  return r;
}

static void drop_table(tc_renderer *r, int i) {
  tc_table_free(r->tables[i].table);
  free(r->tables[i].tf.points);
  r->tables[i] = r->tables[--r->n_tables];
}

void tc_renderer_free(tc_renderer *renderer) {
  if (!renderer) return;
  while (renderer->n_tables) drop_table(renderer, 0);
  if (renderer->instance) renderer->ops->destroy(renderer->instance);
  tc_pool_free(renderer->pool);
  free(renderer);
}

const tc_renderer_info *tc_renderer_about(const tc_renderer *renderer) { return &renderer->info; }

/* ---- tables: built on first need, shared by everyone who needs the same ---- */

static bool same_transfer_function(const tc_transfer_function *a, const tc_transfer_function *b) {
  return a->count == b->count && a->kind == b->kind &&
         (a->kind == TC_KNOT_EXTINCTION || a->unit_distance_mm == b->unit_distance_mm) &&
         !memcmp(a->points, b->points, a->count * sizeof *a->points);
}

static bool same_table(const tc_table_params *a, const tc_table_params *b) {
  return a->n == b->n && a->voxel_lo == b->voxel_lo && a->voxel_hi == b->voxel_hi && a->slope == b->slope &&
         a->intercept == b->intercept && a->step_mm == b->step_mm && a->linear_light == b->linear_light &&
         same_transfer_function(a->tf, b->tf);
}

static cached_table *find_table(tc_renderer *r, const tc_table_params *params) {
  for (int i = 0; i < r->n_tables; i++)
    if (same_table(&r->tables[i].params, params)) return &r->tables[i];
  return NULL;
}

static void make_room(tc_renderer *r, size_t bytes) {
  for (;;) {
    uint64_t held = bytes;
    int oldest = -1;
    for (int i = 0; i < r->n_tables; i++) {
      held += r->tables[i].table->bytes;
      if (oldest < 0 || r->tables[i].last_use < r->tables[oldest].last_use) oldest = i;
    }
    if (oldest < 0 || (held <= r->cache_bytes && r->n_tables < MAX_TABLES)) return;
    drop_table(r, oldest);
  }
}

static const tc_table *table_for(tc_renderer *r, const tc_table_params *params, double *build_ms, GError **error) {
  cached_table *c = find_table(r, params);
  *build_ms = 0;
  if (!c) {
    tc_table *table = tc_table_build(params, r->pool, error);
    if (!table) return NULL;
    tc_knot *points = malloc(params->tf->count * sizeof *points);
    if (!points) {
      tc_table_free(table);
      tc_set_error(error, TC_ERROR_MEMORY, NULL, "transfer function: out of memory");
      return NULL;
    }
    make_room(r, table->bytes);
    c = &r->tables[r->n_tables++];
    *c = (cached_table){.table = table, .params = *params, .tf = *params->tf};
    c->tf.points = memcpy(points, params->tf->points, params->tf->count * sizeof *points);
    *build_ms = table->build_ms;
  }
  for (int i = 0; i < r->n_tables; i++) r->tables[i].params.tf = &r->tables[i].tf; /* entries move */
  c->last_use = ++r->clock;
  return c->table;
}

static tc_table_params table_params(const tc_volume *volume, const tc_scene *scene, const tc_plan *plan) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  tc_table_params p = {.tf = &scene->transfer_function,
                       .slope = d->slope,
                       .intercept = d->intercept,
                       .step_mm = plan->step_mm,
                       .linear_light = scene->image.linear_light};
  tc_table_choose(volume, p.tf, &p.n, &p.voxel_lo, &p.voxel_hi);
  return p;
}

/* ---- frames ---- */

void tc_frame_finish(tc_frame *frame) {
  free(frame->rgba);
  free(frame->linear);
  *frame = (tc_frame){0};
}

static bool reserve(tc_frame *f, int width, int height, bool want_linear, GError **error) {
  size_t pixels = (size_t)width * (size_t)height;
  if (f->capacity < pixels) {
    free(f->rgba);
    f->rgba = malloc(pixels * 4);
    f->capacity = f->rgba ? pixels : 0;
  }
  if (want_linear && f->linear_capacity < pixels) {
    free(f->linear);
    f->linear = malloc(pixels * 4 * sizeof(float));
    f->linear_capacity = f->linear ? pixels : 0;
  }
  if (!f->rgba || (want_linear && !f->linear)) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "frame of %dx%d pixels: out of memory", width, height);
    return false;
  }
  f->width = width;
  f->height = height;
  f->stats = (tc_frame_stats){0};
  return true;
}

static void finish_plan(tc_renderer *r, tc_plan *plan, const tc_table *table, const tc_frame_stats *stats) {
  r->ops->name_kernel(r->instance, plan);
  if (table) plan->stages[TC_STAGE_TABLE_2D].bytes = table->bytes;
  if (stats) {
    plan->stages[TC_STAGE_TABLE_2D].ms = stats->tables_ms;
    plan->stages[TC_STAGE_SKIPPING].ms = stats->skip_ms;
  }
}

bool tc_renderer_plan(tc_renderer *renderer, const tc_volume *volume, const tc_scene *scene, tc_plan *plan, GError **error) {
  if (!tc_plan_make(volume, scene, scene->image.width, scene->image.height, plan, error)) return false;
  tc_table_params params = table_params(volume, scene, plan);
  cached_table *c = find_table(renderer, &params);
  finish_plan(renderer, plan, c ? c->table : NULL, NULL);
  return true;
}

bool tc_render(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, const tc_render_request *request,
               tc_frame *frame, tc_plan *plan, GError **error) {
  tc_render_request none = {0};
  if (!request) request = &none;
  int width = request->width ? request->width : scene->image.width;
  int height = request->height ? request->height : scene->image.height;
  tc_plan local;
  if (!plan) plan = &local;
  if (!tc_plan_make(volume, scene, width, height, plan, error) ||
      !reserve(frame, width, height, request->want_linear, error))
    return false;
  tc_table_params params = table_params(volume, scene, plan);
  const tc_table *table = table_for(renderer, &params, &frame->stats.tables_ms, error);
  if (!table) return false;
  tc_rays rays;
  tc_rays_set_up(&rays, volume, scene, width, height);
  tc_job job = {.plan = plan, .scene = scene, .volume = volume, .rays = &rays, .table = table,
                .cancel = request->cancel, .want_linear = request->want_linear, .frame = frame};
  double start = now_ms();
  if (!renderer->ops->render(renderer->instance, &job, error)) return false;
  frame->stats.render_ms = now_ms() - start;
  finish_plan(renderer, plan, table, &frame->stats);
  return true;
}

void tc_renderer_forget(tc_renderer *renderer, const tc_volume *volume) {
  renderer->ops->forget(renderer->instance, tc_volume_serial(volume));
}
