/* The renderer: plan, shared resources, dispatch to a back end. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/frame/backend.h"
#include "renderer/frame/cache.h"
#include "renderer/base/clock.h"
#include "renderer/frame/frame.h"
#include "renderer/frame/mesh_job.h"
#include "renderer/frame/object_speed.h"
#include "renderer/mesh/surfaces.h"
#include "renderer/frame/resource_kinds.h"
#include "renderer/frame/resources.h"

#define DEFAULT_CACHE_BYTES (256u << 20)

struct tc_renderer {
  const tc_backend_ops *ops;
  void *instance, *stand_in; /* stand_in: the cpu back end, for frames that cannot wait; NULL until there was one */
  tc_pool *pool;
  tc_renderer_info info;
  char why[200];
  tc_resources *resources;
  uint64_t cache_bytes; /* of the options */
  tc_object_speed *object_speed; /* created on first use */
  bool levels;          /* of the options */
};

/* ---- construction ---- */

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
  r->levels = options->levels;
  if (r->pool) r->resources = tc_resources_new(r->pool, r->cache_bytes, options->ledger, error);
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
                               .isa = r->ops->variants(r->instance),
                               .threads = tc_pool_threads(r->pool)};
  return r;
}

void tc_renderer_free(tc_renderer *renderer) {
  if (!renderer) return;
  tc_object_speed_free(renderer->object_speed);
  tc_resources_free(renderer->resources);
  if (renderer->instance) renderer->ops->destroy(renderer->instance);
  if (renderer->stand_in) tc_cpu_backend.destroy(renderer->stand_in);
  tc_pool_free(renderer->pool);
  free(renderer);
}

const tc_renderer_info *tc_renderer_about(const tc_renderer *renderer) { return &renderer->info; }

/* ---- frames ---- */

/* Below this share of empty blocks, empty-space skipping costs more than it saves. */
#define LEAST_EMPTY 0.02
#define MOST_DEAF_MS 20 /* longest accepted time between a back end's checks of the halt */

/* A frame that is drawn, explained or picked. */
typedef struct drawing {
  tc_renderer *r;
  const tc_backend_ops *ops; /* the back end that draws: the renderer's, or the cpu back end instead */
  void *instance;
  tc_plan_request wanted;
  tc_plan plan;
  tc_frame_job job;
  tc_facts facts;
  tc_frame_stats *stats; /* NULL: nothing is built, and missing resources are no failure */
} drawing;

/* The cpu back end of a gl renderer, created on first use; NULL with *error set. */
static void *stand_in(tc_renderer *r, GError **error) {
  if (!r->stand_in) r->stand_in = tc_cpu_backend.create(&(tc_renderer_options){0}, r->pool, error);
  return r->stand_in;
}

/* Chooses the back end that draws. The cpu draws what the renderer's back end refuses, and, if the frame may be
 * interrupted (heard), what that back end could not interrupt in time. */
static bool choose_drawer(drawing *d, bool heard, GError **error) {
  tc_renderer *r = d->r;
  const tc_scene *scene = d->job.scene;
  double deaf_ms = 0;
  tc_estimate_samples(d->job.source, scene, NULL, d->wanted.width, d->wanted.height, &d->job.pixel_samples);
  d->job.pixel_samples *= scene->sampling.rays_per_pixel;
  d->ops = r->ops;
  d->instance = r->instance;
  const bool rays = !tc_drawers[scene->mode];
  if (!rays) d->facts.refused = r->ops->refuses ? r->ops->refuses(r->instance, scene) : NULL;
  if (heard && d->ops->deaf_ms && rays) deaf_ms = d->ops->deaf_ms(d->instance, d->job.pixel_samples);
  if (deaf_ms > MOST_DEAF_MS) {
    d->facts.deaf = r->ops->name;
    d->facts.deaf_ms = deaf_ms;
    d->facts.pixel_samples = d->job.pixel_samples;
  }
  if (d->facts.deaf || d->facts.refused) {
    d->ops = &tc_cpu_backend;
    d->instance = r->ops == d->ops ? r->instance : stand_in(r, error);
  }
  return d->instance != NULL;
}

static void make_plan(drawing *d) {
  tc_plan_make(d->job.source, d->job.scene, &d->wanted, &d->plan);
  d->job.plan = &d->plan;
  d->job.key = d->plan.key;
  if (d->plan.key.labels == TC_PLAN_GAPS) d->job.label_volume = tc_volume_gaps(d->job.source);
  if (tc_labels_in_color(d->job.source, d->job.scene)) d->job.label_volume = tc_volume_colors(d->job.source);
  d->job.outlines_table = tc_plan_has(&d->plan, TC_RESOURCE_TABLE) && d->ops->builds_table &&
                          d->ops->builds_table(d->instance, &d->plan.table, &d->facts.table_builder);
}

/* Turns empty-space skipping off for the job. */
static void skip_nothing(tc_frame_job *job) {
  job->key = tc_plan_unskipped(job->key);
  job->have.distance_map = NULL;
  job->have.boxes = NULL;
  job->have.bounds = NULL;
}

/* Updates the job after a resource was found or built. */
static void take_in(drawing *d, tc_resource which) {
  const tc_resource_kind *kind = &tc_resource_kinds[which];
  const void *thing = d->job.have.of[which];
  if (thing && kind->empty_share) {
    d->facts.empty_share = kind->empty_share(thing);
    if (d->facts.empty_share < LEAST_EMPTY) skip_nothing(&d->job);
  }
  if (which != TC_RESOURCE_COEFFICIENTS) return;
  d->job.volume = d->wanted.field = thing;
  if (thing) make_plan(d); /* the table's range is that of the sampled field */
}

static double *stats_ms(tc_frame_stats *stats, tc_resource which) {
  const tc_stage stage = tc_stage_of(which);
  return stage == TC_STAGE_COEFFICIENTS ? &stats->coefficients_ms
         : stage == TC_STAGE_SKIPPING   ? &stats->skip_ms
                                        : &stats->tables_ms;
}

/* Finds a resource of the plan, or builds it if the frame is drawn. */
static bool collect_one(drawing *d, tc_resource which, GError **error) {
  double ms = 0;
  const void *thing = tc_resources_get(d->r->resources, which, &d->job, d->stats ? &ms : NULL, error);
  d->job.have.of[which] = thing;
  if (d->stats) *stats_ms(d->stats, which) += ms;
  d->facts.ms[which] += d->stats || !thing ? ms : tc_resources_ms(d->r->resources, which, thing);
  return thing != NULL;
}

static bool collect(drawing *d, GError **error) {
  make_plan(d);
  d->job.mesh_in_view = tc_plan_has(&d->plan, TC_RESOURCE_MESH) && tc_mesh_in_view(&d->job);
  if (d->job.scene->mode == TC_MODE_MESH && !d->job.mesh_in_view) tc_plan_drop(&d->plan, TC_RESOURCE_MINMAX); /* nothing is extracted */
  d->facts.empty_share = -1;
  for (int i = 0; i < TC_RESOURCE_COUNT; i++) {
    if (!tc_plan_has(&d->plan, (tc_resource)i)) continue;
    if (!collect_one(d, (tc_resource)i, error) && d->stats) return false;
    take_in(d, (tc_resource)i);
  }
  return true;
}

static void explain(drawing *d, bool by_stand_in, tc_explanation *to) {
  d->facts.key = d->job.key;
  const tc_clusters *mesh = d->job.have.mesh;
  d->facts.nothing_in_view = tc_plan_has(&d->plan, TC_RESOURCE_MESH) && !d->job.mesh_in_view;
  if (mesh) tc_mesh_count(mesh, &d->plan, d->job.scene, &d->facts);
  d->facts.culls_pixels = d->job.scene->mode == TC_MODE_MESH && !by_stand_in && d->ops != &tc_cpu_backend;
  if (d->stats) d->facts.hidden = d->stats->hidden, d->facts.shaded = d->stats->shaded;
  for (int i = 0; i < TC_RESOURCE_COUNT; i++)
    if (d->job.have.of[i]) d->facts.bytes[i] = tc_resource_kinds[i].bytes(d->job.have.of[i]);
  tc_plan_explain(&d->plan, d->job.source, d->job.scene, &d->facts, to);
  g_strlcat(to->kernel, ".", sizeof to->kernel);
  tc_rays rays;
  tc_rays_set_up(&rays, d->job.source, d->job.scene, d->plan.width, d->plan.height);
  const tc_backend_ops *ops = by_stand_in ? &tc_cpu_backend : d->ops;
  g_strlcat(to->kernel, ops->kernel_suffix(by_stand_in ? d->r->stand_in : d->instance, &d->job.key, &rays), sizeof to->kernel);
}

bool tc_renderer_explain(tc_renderer *renderer, const tc_volume *volume, const tc_scene *scene,
                         const tc_render_request *request, tc_explanation *explanation, GError **error) {
  const tc_volume *labels = request ? request->labels : NULL;
  drawing d = {.r = renderer,
               .wanted = {.width = scene->image.width, .height = scene->image.height},
               .job = {.scene = scene, .source = volume, .volume = volume, .label_volume = labels}};
  if (!tc_plan_check(volume, scene, d.wanted.width, d.wanted.height, NULL, error) ||
      !tc_labels_check(volume, labels, scene, error) || !choose_drawer(&d, true, error))
    return false;
  d.wanted.maps_distance = d.ops->maps_distance;
  collect(&d, NULL);
  explain(&d, false, explanation);
  if (d.ops != &tc_cpu_backend || !tc_is_object(volume, scene)) return true;
  const double *speed = NULL;
  if (renderer->ops == &tc_cpu_backend) { /* the gl back end would compile programs for the measurement */
    if (!renderer->object_speed) renderer->object_speed = tc_object_speed_new();
    speed = tc_object_speed_go_on(renderer->object_speed, renderer);
  }
  const tc_interrupt *interrupt = request ? request->interrupt : NULL;
  tc_explain_object(volume, scene, speed, interrupt ? &interrupt->cancel : NULL, explanation);
  explanation->object_measured = speed != NULL;
  return true;
}

bool tc_renderer_pick(tc_renderer *renderer, const tc_volume *volume, const tc_scene *scene,
                      const tc_render_request *request, tc_pick *pick, GError **error) {
  const int width = request->width ? request->width : scene->image.width;
  const int height = request->height ? request->height : scene->image.height;
  const tc_rays none = {0};
  tc_frame frame = {.width = width, .height = height};
  drawing d = {.r = renderer,
               .wanted = {.width = width, .height = height},
               .job = {.scene = scene, .source = volume, .volume = volume, .label_volume = request->labels,
                       .meshes = request->meshes, .rays = &none, .frame = &frame}};
  if (!tc_plan_check(volume, scene, width, height, NULL, error) ||
      !tc_labels_check(volume, request->labels, scene, error) || !choose_drawer(&d, true, error))
    return false;
  collect(&d, NULL);
  if (d.job.have.mesh && (!tc_plan_has(&d.plan, TC_RESOURCE_LABELS) || d.job.have.labels))
    return tc_mesh_job_pick(&d.job, pick, error);
  tc_set_error(error, TC_ERROR_BUSY, NULL, "the surfaces are not built yet: retry after the session's next frame");
  return false;
}

static bool check_table(const tc_render_request *q, GError **error) {
  if ((q->table_size == 0 || (q->table_size >= 2 && q->table_size <= TC_MAX_TABLE_SIZE)) &&
      (q->table_bits == 0 || q->table_bits == 8 || q->table_bits == 16))
    return true;
  tc_set_error(error, TC_ERROR_INVALID, NULL,
               "table of %d entries a side and %d bits: 2 to %d and 8 or 16 expected, or 0", q->table_size, q->table_bits,
               TC_MAX_TABLE_SIZE);
  return false;
}

/* Draws by the cpu back end; instance is the cpu back end's. */
static bool draw_by_cpu(drawing *d, void *instance, GError **error) {
  const tc_drawer drawer = tc_drawers[d->plan.key.mode];
  d->job.isa = tc_cpu_backend.isa(instance);
  if (tc_mesh_is_within(d->job.scene)) return tc_mesh_within_draw(d->r->pool, &tc_cpu_backend, instance, &d->job, error);
  return drawer ? drawer(d->r->pool, &d->job, error) : tc_cpu_backend.render(instance, &d->job, error);
}

/* Draws by the cpu back end without empty-space skipping: its skipping reads other structures, which would have to be
 * built; the picture is the same. */
static bool draw_by_stand_in(drawing *d, GError **error) {
  if (!stand_in(d->r, error)) return false;
  d->job.outlines_table = false;
  if (d->job.have.table && !collect_one(d, TC_RESOURCE_TABLE, error)) return false;
  if (d->facts.table_builder) d->facts.table_builder = "built by the cpu, which draws until OpenGL is ready";
  d->facts.fills_in = d->job.key.skipping;
  skip_nothing(&d->job);
  d->stats->stand_in = true;
  return draw_by_cpu(d, d->r->stand_in, error);
}

/* False: the back end is not ready, and the frame must not wait (hurry) or was halted. An interruptible frame waits
 * here for work on another thread, because the back end would not check the halt while waiting. */
static bool is_ready(const drawing *d, bool hurry) {
  if (!d->ops->ready || (!hurry && !d->job.halt->interrupt)) return true;
  while (!d->ops->ready(d->instance, &d->job)) {
    if (hurry || tc_halt_within(d->job.halt)) return false;
    nanosleep(&(struct timespec){.tv_nsec = 500000}, NULL);
  }
  return hurry || !tc_halt_within(d->job.halt); /* a halt may have cut an upload short */
}

static bool draw(drawing *d, bool hurry, GError **error) {
  const tc_renderer *r = d->r;
  const double before = d->stats->tables_ms;
  /* The back end that began a paused frame also resumes it: the back ends do not agree to the last bit. */
  const bool begun = tc_frame_position(d->job.frame) > 0, hurried = begun && d->stats->stand_in;
  if (d->ops == &tc_cpu_backend) {
    d->stats->stand_in = d->ops != r->ops;
    return draw_by_cpu(d, d->instance, error);
  }
  if (hurried) return draw_by_stand_in(d, error);
  if (!is_ready(d, hurry && !begun))
    return hurry && !begun ? draw_by_stand_in(d, error) : tc_halt_say(d->job.halt, error);
  const bool within = tc_mesh_is_within(d->job.scene);
  if (within && !stand_in(d->r, error)) return false;
  if (within) d->job.isa = tc_cpu_backend.isa(d->r->stand_in); /* for the rasteriser */
  const bool drawn = within ? tc_mesh_within_draw(d->r->pool, d->ops, d->instance, &d->job, error)
                            : d->ops->render(d->instance, &d->job, error);
  const double took = d->stats->tables_ms - before; /* time of tables that the back end built */
  if (took > 0) tc_resources_took(r->resources, TC_RESOURCE_TABLE, d->job.have.table, took);
  d->facts.ms[TC_RESOURCE_TABLE] += took;
  return drawn;
}

/* Collects the resources, then draws into the frame's buffers. */
static bool render_frame(drawing *d, const tc_render_request *request, GError **error) {
  const tc_resources *resources = d->r->resources;
  const int64_t steps = tc_resources_steps(resources);
  const bool begun = tc_frame_position(d->job.frame) > 0 && !d->stats->stand_in;
  if (!choose_drawer(d, d->job.halt->interrupt && !begun, error)) return false;
  d->wanted.maps_distance = d->ops->maps_distance;
  if (!collect(d, error)) return false;
  if (request->prepare) return true;
  if (d->job.have.mesh) tc_frame_of_mesh(d->job.frame, d->job.have.mesh->refined);
  tc_rays rays;
  tc_rays_set_up(&rays, d->job.source, d->job.scene, d->plan.width, d->plan.height);
  for (int i = 0; request->pixel_share > 0 && i < rays.count; i++)
    rays.of_pixel[i].x *= request->pixel_share, rays.of_pixel[i].y *= request->pixel_share;
  d->job.rays = &rays;
  d->job.ledger = request->ledger;
  if (tc_resources_steps(resources) != steps && tc_halt_between(d->job.halt)) /* the time went into building */
    return tc_halt_say(d->job.halt, error);
  const double start = tc_now_ms(), tables_ms = d->stats->tables_ms;
  const bool drawn = draw(d, request->hurry, error);
  d->stats->render_ms += tc_now_ms() - start - (d->stats->tables_ms - tables_ms);
  return drawn;
}

/* Checks that the caller resolved the id of every mesh. */
static bool check_meshes(const tc_scene *scene, const tc_render_request *request, GError **error) {
  for (size_t i = 0; i < scene->mesh.n_surfaces; i++) {
    if (scene->mesh.surfaces[i].source != TC_SURFACE_OF_MESH || (request->meshes && request->meshes[i])) continue;
    char pointer[40];
    g_snprintf(pointer, sizeof pointer, "/mesh/surfaces/%zu", i);
    tc_set_error(error, TC_ERROR_INVALID, pointer, "mesh/surfaces/%zu: there is no such mesh here", i);
    return false;
  }
  return true;
}

static bool check_request(tc_volume *volume, const tc_scene *scene, const tc_render_request *request, int width, int height,
                          GError **error) {
  if (scene->quality.max_error > 0 || scene->quality.max_ms > 0) {
    tc_set_error(error, TC_ERROR_INVALID, "/quality", "quality: a frame has one sampling; choose it first (quality.h)");
    return false;
  }
  return check_table(request, error) && tc_plan_check(volume, scene, width, height, NULL, error) &&
         tc_labels_check(volume, request->labels, scene, error) && check_meshes(scene, request, error);
}

bool tc_render(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, const tc_render_request *request,
               tc_frame *frame, GError **error) {
  static const tc_render_request none = {0};
  if (!request) request = &none;
  const int width = request->width ? request->width : scene->image.width;
  const int height = request->height ? request->height : scene->image.height;
  GError *failure = NULL;
  if (!check_request(volume, scene, request, width, height, error) ||
      !tc_frame_begin(frame, width, height, request, error))
    return false;
  tc_progress *progress = frame->progress;
  const tc_halt halt = tc_halt_begin(request->interrupt, progress->fruitless);
  drawing d = {.r = renderer,
               .wanted = {.width = width, .height = height, .want_depth = request->want_depth, .moving = request->moving, .coarser_levels = request->coarser_levels,
                          .table_size = request->table_size, .table_bits = request->table_bits},
               .job = {.scene = scene, .source = volume, .volume = volume, .label_volume = request->labels, .meshes = request->meshes,
                       .building = request->building,
                       .halt = &halt,
                       .want_linear = request->want_linear,
                       .forward = request->forward, .frame = frame},
               .stats = &frame->stats};
  int64_t position = tc_frame_position(frame), steps = tc_resources_steps(renderer->resources);
  tc_pool_watch(renderer->pool, &halt);
  bool done = render_frame(&d, request, &failure);
  tc_pool_watch(renderer->pool, NULL);
  if (done && request->explanation)
    explain(&d, frame->stats.stand_in && d.ops == renderer->ops, request->explanation);
  if (done && d.job.have.mesh && renderer->levels)
    tc_resources_refine(renderer->resources, TC_RESOURCE_MESH, d.job.have.mesh, !request->moving);
  progress->paused = g_error_matches(failure, TC_ERROR, TC_ERROR_PAUSED);
  bool further = tc_frame_position(frame) != position || tc_resources_steps(renderer->resources) != steps;
  progress->fruitless = progress->paused && !further ? progress->fruitless + 1 : 0;
  if (failure) g_propagate_error(error, failure);
  return done;
}

void tc_renderer_forget(tc_renderer *renderer, const tc_volume *volume) {
  if (tc_volume_gaps(volume)) tc_renderer_forget(renderer, tc_volume_gaps(volume));
  if (tc_volume_colors(volume)) tc_renderer_forget(renderer, tc_volume_colors(volume));
  const uint64_t coefficients = tc_resources_forget(renderer->resources, tc_volume_serial(volume));
  if (coefficients) renderer->ops->forget(renderer->instance, coefficients);
  renderer->ops->forget(renderer->instance, tc_volume_serial(volume));
}

void tc_renderer_forget_mesh(tc_renderer *renderer, uint64_t mesh_serial) {
  tc_resources_forget_mesh(renderer->resources, mesh_serial);
}

uint64_t tc_renderer_cached(const tc_renderer *renderer) { return tc_resources_held(renderer->resources); }

void tc_renderer_trim_cache(tc_renderer *renderer, uint64_t most_bytes) {
  tc_resources_trim(renderer->resources, most_bytes);
}
