/* The renderer: plan, shared resources, dispatch to a back end. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/backend.h"
#include "renderer/cache.h"
#include "renderer/clock.h"
#include "renderer/frame.h"
#include "renderer/resources.h"

#define DEFAULT_CACHE_BYTES (256u << 20)

struct tc_renderer {
  const tc_backend_ops *ops;
  void *instance, *stand_in; /* stand_in: the cpu back end, for frames that cannot wait; NULL until there was one */
  tc_pool *pool;
  tc_renderer_info info;
  char why[200];
  tc_resources *resources;
  uint64_t cache_bytes; /* as asked for */
};

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
  r->pool = tc_pool_new(options->threads, error);
  r->cache_bytes = options->cache_bytes ? options->cache_bytes : DEFAULT_CACHE_BYTES;
  if (r->pool) r->resources = tc_resources_new(r->pool, r->cache_bytes, error);
  if (r->resources) {
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

void tc_renderer_free(tc_renderer *renderer) {
  if (!renderer) return;
  tc_resources_free(renderer->resources);
  if (renderer->instance) renderer->ops->destroy(renderer->instance);
  if (renderer->stand_in) tc_cpu_backend.destroy(renderer->stand_in);
  tc_pool_free(renderer->pool);
  free(renderer);
}

const tc_renderer_info *tc_renderer_about(const tc_renderer *renderer) { return &renderer->info; }

/* ---- frames ---- */

/* What a frame reads beside the volume, and who draws it. */
typedef struct frame_resources {
  const tc_backend_ops *ops; /* the renderer's, or the cpu's in its place ... */
  void *instance;
  double deaf_ms;       /* ... because of that */
  double pixel_samples; /* of a pixel's rays, from above */
  const tc_volume *field; /* what is sampled: the volume, or its B-spline coefficients */
  double field_ms;
  const tc_table *table;
  const char *builder; /* who makes the table's entries and why, where that is a choice; else NULL */
  const tc_integrals *integrals;
  const tc_support *support;
  const tc_minmax *minmax;
  const tc_leap *leap;
  const tc_boxes *boxes;
  const tc_bounds *bounds;
  const tc_labels *labels;
  double labels_ms; /* what building them took in this frame */
  tc_grey grey; /* of a projection */
  tc_surface surface; /* of an isosurface */
} frame_resources;

/* Under this share of empty blocks the leaping loop costs more than it saves. */
#define LEAST_EMPTY 0.02

/* Leaping pays: either structure says how much of the volume is empty. */
static bool leaping_pays(frame_resources *have, tc_plan *plan) {
  if (!have->leap && !have->boxes) return true; /* not there yet */
  double empty_share = have->leap ? have->leap->empty_share : have->boxes->empty_share;
  if (empty_share >= LEAST_EMPTY) return true;
  char reason[64];
  snprintf(reason, sizeof reason, "only %.1f %% of the blocks are empty", 100 * empty_share);
  tc_plan_drop_skipping(plan, reason);
  have->leap = NULL;
  have->boxes = NULL;
  return false;
}

/* What follows collects what a frame reads. stats NULL: only what is there already, for a plan that somebody looks at;
 * nothing is built then, and nothing that is missing is a failure. */
typedef struct collection {
  tc_renderer *r;
  const tc_volume *field; /* what is sampled */
  const tc_scene *scene;
  const tc_render_request *request;
  tc_plan *plan;
  frame_resources *have;
  tc_frame_stats *stats;
  int block, reach; /* of empty-space skipping */
} collection;

static double *skip_ms_of(const collection *c) { return c->stats ? &c->stats->skip_ms : NULL; }
static double *tables_ms_of(const collection *c) { return c->stats ? &c->stats->tables_ms : NULL; }

static bool collect_minmax(const collection *c, GError **error) {
  c->have->minmax = tc_resources_minmax(c->r->resources, c->field, c->block, c->reach, skip_ms_of(c), error);
  return c->have->minmax || !c->stats;
}

static bool collect_projection(const collection *c, GError **error) {
  frame_resources *have = c->have;
  have->grey = tc_grey_make(c->field, c->scene);
  if (!c->plan->key.skipping) return true;
  if (!collect_minmax(c, error)) return false;
  have->bounds = tc_resources_bounds(c->r->resources, c->field, c->block, c->reach, have->minmax, &have->grey, skip_ms_of(c), error);
  return have->bounds || !c->stats;
}

/* The structure that the back end leaps by, for what shows as `support` says. */
static bool collect_leap(const collection *c, bool boxes, GError **error) {
  frame_resources *have = c->have;
  tc_resources *resources = c->r->resources;
  if (have->support && boxes)
    have->boxes = tc_resources_boxes(resources, c->field, c->block, c->reach, have->minmax, have->support, skip_ms_of(c), error);
  else if (have->support)
    have->leap = tc_resources_leap(resources, c->field, c->block, c->reach, have->minmax, have->support, skip_ms_of(c), error);
  if (c->stats && !have->leap && !have->boxes) return false;
  leaping_pays(have, c->plan);
  return true;
}

static bool collect_surface(const collection *c, GError **error) {
  frame_resources *have = c->have;
  have->surface = tc_surface_make(c->field, c->scene);
  if (!c->plan->key.skipping) return true;
  have->support = tc_resources_surface(c->r->resources, have->surface.below, have->surface.above, skip_ms_of(c), error);
  if (c->stats && !have->support) return false;
  return collect_minmax(c, error) && collect_leap(c, false, error);
}

/* True: the back end makes the table's entries itself. */
static bool builds_table(const tc_table_params *params, frame_resources *have) {
  return have->ops->builds_table && have->ops->builds_table(have->instance, params, &have->builder);
}

static bool collect_table(const collection *c, const tc_table_params *params, GError **error) {
  frame_resources *have = c->have;
  have->table = tc_resources_table(c->r->resources, params, tables_ms_of(c), error);
  if (c->stats && !have->table) return false;
  return builds_table(params, have) || !c->stats || tc_resources_fill(c->r->resources, have->table, tables_ms_of(c), error);
}

/* Coefficients reach further than the voxels that the plan was made for. */
static tc_table_params table_params(const tc_volume *field, const tc_scene *scene, const tc_render_request *request,
                                    tc_plan *plan) {
  if (plan->stages[TC_STAGE_COEFFICIENTS].included || request->table_size)
    tc_plan_table(plan, field, scene, request->table_size);
  tc_table_params params = plan->table;
  params.tf = &scene->transfer_function;
  if (plan->stages[TC_STAGE_TABLE_2D].included) params.bits = request->table_bits;
  return params;
}

static bool collect_dvr(const collection *c, GError **error) {
  frame_resources *have = c->have;
  const tc_table_params params = table_params(c->field, c->scene, c->request, c->plan);
  if (c->plan->stages[TC_STAGE_TABLE_2D].included) {
    if (!collect_table(c, &params, error)) return false;
  } else {
    have->integrals = tc_resources_integrals(c->r->resources, &params, tables_ms_of(c), error);
    if (c->stats && !have->integrals) return false;
  }
  if (!c->plan->key.skipping) return true;
  const int *dims = tc_volume_describe(c->field)->dims;
  bool boxes = have->ops->leaps_over_boxes;
  if (boxes && (dims[0] > TC_BOX_REACH || dims[1] > TC_BOX_REACH || dims[2] > TC_BOX_REACH)) {
    tc_plan_drop_skipping(c->plan, "an axis is longer than boxes can name");
    return true;
  }
  if (!collect_minmax(c, error)) return false;
  have->support = tc_resources_support(c->r->resources, &params, skip_ms_of(c), error);
  return (have->support || !c->stats) && collect_leap(c, boxes, error);
}

static bool collect(tc_renderer *r, const tc_scene *scene, const tc_render_request *request, tc_plan *plan,
                    frame_resources *have, tc_frame_stats *stats, GError **error) {
  const collection c = {r, have->field, scene, request, plan, have, stats,
                        .block = tc_skip_block(scene->skipping.block), .reach = tc_skip_reach(scene->filter)};
  if (tc_is_projection(scene->mode)) return collect_projection(&c, error);
  if (scene->mode == TC_MODE_ISOSURFACE) return collect_surface(&c, error);
  return scene->mode == TC_MODE_MPR || collect_dvr(&c, error);
}

#define MOST_DEAF_MS 20 /* of a back end that looks at no halt meanwhile */

static void finish_plan(tc_renderer *r, tc_plan *plan, const frame_resources *have, const tc_frame_stats *stats) {
  bool hurried = stats && stats->stand_in && have->ops == r->ops;
  (hurried ? &tc_cpu_backend : have->ops)->name_kernel(hurried ? r->stand_in : have->instance, plan);
  if (have->deaf_ms > MOST_DEAF_MS) {
    tc_plan_stage *resolve = &plan->stages[TC_STAGE_RESOLVE];
    size_t used = strlen(resolve->reason);
    snprintf(resolve->reason + used, sizeof resolve->reason - used,
             "; drawn by the cpu: a pixel has up to %.3g samples, and %s would be busy with the least it can draw for %.3g "
             "ms", have->pixel_samples, r->ops->name, have->deaf_ms);
  }
  tc_plan_stage *labels = &plan->stages[TC_STAGE_LABELS];
  if (have->labels) labels->bytes = have->labels->bytes;
  if (have->labels) labels->ms = stats ? have->labels_ms : have->labels->build_ms;
  tc_plan_stage *skipping = &plan->stages[TC_STAGE_SKIPPING];
  tc_plan_stage *table =
      &plan->stages[plan->stages[TC_STAGE_TABLE_1D].included ? TC_STAGE_TABLE_1D : TC_STAGE_TABLE_2D];
  tc_plan_stage *coefficients = &plan->stages[TC_STAGE_COEFFICIENTS];
  coefficients->ms = have->field_ms;
  if (coefficients->included && have->field) coefficients->bytes = tc_volume_bytes(have->field);
  if (have->table) table->bytes = have->table->bytes;
  if (have->builder) {
    size_t used = strlen(table->reason);
    snprintf(table->reason + used, sizeof table->reason - used, "; %s", have->builder);
  }
  if (have->integrals) table->bytes = have->integrals->bytes;
  if (have->minmax) skipping->bytes += have->minmax->bytes;
  if (have->support) skipping->bytes += have->support->bytes;
  if (have->bounds) skipping->bytes += have->bounds->bytes;
  if (have->leap || have->boxes) {
    skipping->bytes += have->leap ? have->leap->bytes : have->boxes->bytes;
    snprintf(skipping->reason, sizeof skipping->reason, "%.1f %% of the blocks of %d voxels are empty",
             100 * (have->leap ? have->leap->empty_share : have->boxes->empty_share), have->minmax->block);
  }
  if (have->boxes && plan->key.coherence)
    snprintf(plan->stages[TC_STAGE_COHERENCE].reason, sizeof plan->stages[TC_STAGE_COHERENCE].reason,
             "all rays of a pixel share the runs of what shows");
  if (stats) {
    table->ms = stats->tables_ms - have->labels_ms;
    skipping->ms = stats->skip_ms;
    return;
  }
  table->ms = have->table ? have->table->build_ms : have->integrals ? have->integrals->build_ms : 0;
  skipping->ms = (have->minmax ? have->minmax->build_ms : 0) +
                 (have->support ? have->support->build_ms : 0) + (have->leap ? have->leap->build_ms : 0) +
                 (have->boxes ? have->boxes->build_ms : 0) +
                 (have->bounds ? have->bounds->build_ms : 0);
}

/* The cpu back end beside another one; NULL with *error set. */
static void *stand_in(tc_renderer *r, GError **error) {
  if (!r->stand_in) r->stand_in = tc_cpu_backend.create(&(tc_renderer_options){0}, r->pool, error);
  return r->stand_in;
}

/* Who draws: the cpu what others could not be interrupted at, if anybody may want to (heard) and they have not begun. */
static bool choose_drawer(tc_renderer *r, const tc_volume *volume, const tc_scene *scene, int width, int height,
                          bool heard, frame_resources *have, GError **error) {
  tc_estimate_samples(volume, scene, width, height, &have->pixel_samples);
  if (scene->mode != TC_MODE_MPR) have->pixel_samples *= scene->sampling.rays_per_pixel;
  have->ops = r->ops;
  have->instance = r->instance;
  if (!r->ops->deaf_ms || !heard) return true;
  have->deaf_ms = r->ops->deaf_ms(r->instance, have->pixel_samples);
  if (have->deaf_ms <= MOST_DEAF_MS) return true;
  have->ops = &tc_cpu_backend;
  have->instance = stand_in(r, error);
  return have->instance != NULL;
}

bool tc_renderer_plan(tc_renderer *renderer, const tc_volume *volume, const tc_volume *labels, const tc_scene *scene,
                      tc_plan *plan, GError **error) {
  if (!tc_plan_make(volume, scene, scene->image.width, scene->image.height, plan, error) ||
      !tc_labels_check(volume, labels, scene, error))
    return false;
  frame_resources have = {.field = volume};
  if (!choose_drawer(renderer, volume, scene, scene->image.width, scene->image.height, true, &have, error))
    return false;
  if (plan->key.labels) have.labels = tc_resources_labels(renderer->resources, labels, scene, NULL, NULL);
  if (plan->stages[TC_STAGE_COEFFICIENTS].included)
    have.field = tc_resources_coefficients(renderer->resources, volume, NULL, NULL);
  if (have.field && !collect(renderer, scene, &(tc_render_request){0}, plan, &have, NULL, error)) return false;
  finish_plan(renderer, plan, &have, NULL);
  return true;
}

/* What is to be sampled; true when it is there. */
static bool collect_field(tc_renderer *r, const tc_volume *volume, const tc_plan *plan, frame_resources *have,
                         GError **error) {
  have->field = volume;
  if (plan->stages[TC_STAGE_COEFFICIENTS].included)
    have->field = tc_resources_coefficients(r->resources, volume, &have->field_ms, error);
  return have->field != NULL;
}

static bool check_table(const tc_render_request *q, GError **error) {
  if ((q->table_size == 0 || (q->table_size >= 2 && q->table_size <= TC_MAX_TABLE_SIZE)) &&
      (q->table_bits == 0 || q->table_bits == 8 || q->table_bits == 16))
    return true;
  tc_set_error(error, TC_ERROR_INVALID, NULL,
               "table of %d entries a side and %d bits: 2 to %d and 8 or 16 wanted, or 0", q->table_size, q->table_bits,
               TC_MAX_TABLE_SIZE);
  return false;
}

/* Draws by the cpu back end, every sample: what leaps is not the same there, and the picture is. */
static bool draw_by_stand_in(tc_renderer *r, tc_job *job, tc_plan *plan, frame_resources *have, GError **error) {
  if (!stand_in(r, error)) return false;
  if (job->table) {
    if (!tc_resources_fill(r->resources, job->table, &job->frame->stats.tables_ms, error)) return false;
    if (have->builder) have->builder = "built by the cpu, which draws while opengl gets ready";
  }
  if (plan->key.skipping) tc_plan_drop_skipping(plan, "the cpu draws every sample while opengl gets ready");
  job->leap = have->leap = NULL;
  job->bounds = have->bounds = NULL;
  job->frame->stats.stand_in = true;
  return tc_cpu_backend.render(r->stand_in, job, error);
}

/* False: the back end is not ready, and whoever asked does not want to wait. A frame that may be interrupted waits here,
 * while what it waits for is done beside: the back end itself would not hear. */
static bool is_ready(frame_resources *have, const tc_job *job, bool hurry) {
  if (!have->ops->ready || (!hurry && !job->halt->interrupt)) return true;
  while (!have->ops->ready(have->instance, job)) {
    if (hurry || tc_halt_within(job->halt)) return false;
    nanosleep(&(struct timespec){.tv_nsec = 500000}, NULL);
  }
  return true;
}

static bool draw(tc_renderer *r, tc_job *job, tc_plan *plan, bool hurry, frame_resources *have, GError **error) {
  const double *tables_ms = &job->frame->stats.tables_ms, before = *tables_ms;
  /* A frame that was paused goes on with who began it: the two are not the same to the last bit. */
  bool begun = tc_frame_position(job->frame) > 0, hurried = begun && job->frame->stats.stand_in;
  if (have->ops != r->ops) {
    job->frame->stats.stand_in = true;
    return have->ops->render(have->instance, job, error);
  }
  if (hurried) return draw_by_stand_in(r, job, plan, have, error);
  if (!is_ready(have, job, hurry && !begun))
    return hurry && !begun ? draw_by_stand_in(r, job, plan, have, error) : tc_halt_say(job->halt, error);
  bool drawn = r->ops->render(r->instance, job, error);
  if (*tables_ms > before) tc_resources_table_took(r->resources, job->table, *tables_ms - before);
  return drawn;
}

/* Everything but the frame's buffers: what the picture needs is collected, then drawn. */
static bool render_frame(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene,
                         const tc_render_request *request, const tc_halt *halt, tc_frame *frame, tc_plan *plan,
                         GError **error) {
  frame_resources have = {0};
  const int64_t steps = tc_resources_steps(renderer->resources);
  const bool begun = tc_frame_position(frame) > 0 && !frame->stats.stand_in;
  if (!choose_drawer(renderer, volume, scene, frame->width, frame->height, halt->interrupt && !begun, &have, error))
    return false;
  if (!collect_field(renderer, volume, plan, &have, error) ||
      !collect(renderer, scene, request, plan, &have, &frame->stats, error))
    return false;
  if (plan->key.labels) {
    have.labels = tc_resources_labels(renderer->resources, request->labels, scene, &have.labels_ms, error);
    if (!have.labels) return false;
    frame->stats.tables_ms += have.labels_ms;
  }
  tc_scene windowed; /* greys are display values already: nothing is converted */
  if (scene->mode == TC_MODE_MPR && scene->image.linear_light) {
    windowed = *scene;
    windowed.image.linear_light = false;
    scene = &windowed;
  }
  tc_rays rays;
  tc_rays_set_up(&rays, volume, scene, frame->width, frame->height);
  for (int i = 0; request->pixel_share > 0 && i < rays.count; i++)
    rays.of_pixel[i].x *= request->pixel_share, rays.of_pixel[i].y *= request->pixel_share;
  tc_job job = {.plan = plan, .scene = scene, .volume = have.field, .source = volume, .rays = &rays,
                .table = have.table, .integrals = have.integrals, .leap = have.leap, .boxes = have.boxes,
                .grey = tc_is_projection(scene->mode) ? &have.grey : NULL, .bounds = have.bounds,
                .label_volume = have.labels ? request->labels : NULL, .labels = have.labels,
                .surface = scene->mode == TC_MODE_ISOSURFACE ? &have.surface : NULL, .want_depth = request->want_depth,
                .halt = halt, .want_linear = request->want_linear, .frame = frame};
  if (job.surface && job.want_depth) {
    plan->stages[TC_STAGE_DEPTH].included = true;
    snprintf(plan->stages[TC_STAGE_DEPTH].reason, sizeof plan->stages->reason, "asked for with the frame");
  }
  if (tc_resources_steps(renderer->resources) != steps && tc_halt_between(halt)) /* its time went into building */
    return tc_halt_say(halt, error);
  job.pixel_samples = have.pixel_samples;
  double start = tc_now_ms(), tables_ms = frame->stats.tables_ms;
  bool drawn = draw(renderer, &job, plan, request->hurry, &have, error);
  tables_ms = frame->stats.tables_ms - tables_ms; /* what the back end built */
  frame->stats.render_ms += tc_now_ms() - start - tables_ms;
  frame->stats.coefficients_ms += have.field_ms;
  if (drawn) finish_plan(renderer, plan, &have, &frame->stats);
  return drawn;
}

bool tc_render(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, const tc_render_request *request,
               tc_frame *frame, tc_plan *plan, GError **error) {
  const tc_render_request none = {0};
  if (!request) request = &none;
  int width = request->width ? request->width : scene->image.width;
  int height = request->height ? request->height : scene->image.height;
  tc_plan local;
  GError *failure = NULL;
  if (!plan) plan = &local;
  if (scene->quality.max_error > 0 || scene->quality.max_ms > 0) {
    tc_set_error(error, TC_ERROR_INVALID, "/quality", "quality: a frame has one sampling; choose it first (quality.h)");
    return false;
  }
  if (!check_table(request, error) || !tc_plan_make(volume, scene, width, height, plan, error) ||
      !tc_labels_check(volume, request->labels, scene, error) ||
      !tc_frame_begin(frame, width, height, request, error))
    return false;
  tc_progress *progress = frame->progress;
  const tc_halt halt = tc_halt_begin(request->interrupt, progress->fruitless);
  int64_t position = tc_frame_position(frame), steps = tc_resources_steps(renderer->resources);
  tc_pool_watch(renderer->pool, &halt);
  bool done = render_frame(renderer, volume, scene, request, &halt, frame, plan, &failure);
  tc_pool_watch(renderer->pool, NULL);
  progress->paused = g_error_matches(failure, TC_ERROR, TC_ERROR_PAUSED);
  bool further = tc_frame_position(frame) != position || tc_resources_steps(renderer->resources) != steps;
  progress->fruitless = progress->paused && !further ? progress->fruitless + 1 : 0;
  if (failure) g_propagate_error(error, failure);
  return done;
}

void tc_renderer_forget(tc_renderer *renderer, const tc_volume *volume) {
  const uint64_t coefficients = tc_resources_forget(renderer->resources, tc_volume_serial(volume));
  if (coefficients) renderer->ops->forget(renderer->instance, coefficients);
  renderer->ops->forget(renderer->instance, tc_volume_serial(volume));
}

uint64_t tc_renderer_cached(const tc_renderer *renderer) { return tc_resources_held(renderer->resources); }

void tc_renderer_limit_cache(tc_renderer *renderer, uint64_t most_bytes) {
  tc_resources_limit(renderer->resources, most_bytes);
}

uint64_t tc_renderer_wanted(tc_renderer *renderer) { return tc_resources_wanted(renderer->resources); }
