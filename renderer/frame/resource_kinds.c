#include "renderer/frame/resource_kinds.h"

#include "renderer/base/building.h"
#include "renderer/classify/outline.h"
#include "renderer/frame/mesh_job.h"
#include "renderer/mesh/levels.h"
#include "renderer/skip/fine.h"
#include "renderer/splat/splatter.h"
#include "renderer/volume/coefficients.h"

static void append(GByteArray *key, const void *bytes, size_t size) { g_byte_array_append(key, bytes, (guint)size); }

static const tc_volume *field_of(const tc_frame_job *job) { return job->volume; }

/* Defines the functions free and bytes for type tc_<name>. */
#define FREES(name)                                                                                                    \
  static void free_##name(void *thing) { tc_##name##_free(thing); }
#define THING(name)                                                                                                    \
  FREES(name)                                                                                                          \
  static size_t name##_bytes(const void *thing) { return ((const tc_##name *)thing)->bytes; }
THING(table)
THING(integrals)
THING(support)
THING(minmax)
THING(distance_map)
THING(fine)
THING(boxes)
THING(bounds)
THING(labels)
static size_t clusters_bytes(const void *thing) { return ((const tc_clusters *)thing)->bytes; }
FREES(coefficients)

/* ---- coefficients ---- */

static void free_volume(void *thing) { tc_volume_unref(thing); }
static const tc_volume *coefficients_tied(const tc_frame_job *job) { return job->source; }

static void coefficients_key(const tc_frame_job *job, GByteArray *key) {
  const uint64_t serial = tc_volume_serial(job->source);
  append(key, &serial, sizeof serial);
}

static void *coefficients_begin(const tc_making *m, GError **error) {
  const uint64_t bytes = tc_coefficients_bytes(m->job->source);
  if (bytes <= m->budget) return tc_coefficients_begin(m->job->source, error);
  tc_set_error(error, TC_ERROR_LIMIT, "/sampling/prefilter",
               "sampling/prefilter: the coefficients take %.0f MiB, the renderer's cache holds %.0f: turn it off or raise "
               "the cache", (double)bytes / 0x1p20, (double)m->budget / 0x1p20);
  return NULL;
}

static bool coefficients_go_on(void *thing, const tc_making *m, GError **error) {
  return tc_coefficients_go_on(thing, m->job->source, m->pool) || tc_halt_say(tc_pool_halt(m->pool), error);
}

static void *coefficients_finish(void *thing) { return tc_coefficients_take(thing); }
static int64_t coefficients_steps(const void *thing) { return tc_coefficients_steps(thing); }
static size_t coefficients_unfinished(const void *thing) { return (size_t)tc_coefficients_held(thing); }
static size_t coefficients_bytes(const void *thing) { return (size_t)tc_volume_bytes(thing); }

/* ---- tables ---- */

/* All inputs of a table or of integrals. */
static void table_key(const tc_frame_job *job, GByteArray *key) {
  const tc_table_params *p = &job->plan->table;
  const tc_transfer_function *tf = p->tf;
  const double numbers[] = {p->voxel_lo, p->voxel_hi, p->slope, p->intercept, p->step_mm,
                            tf->kind == TC_KNOT_EXTINCTION ? 0 : tf->unit_distance_mm};
  const int32_t choices[] = {p->n, p->linear_light, p->bits, p->n_subtables, tf->kind};
  append(key, numbers, sizeof numbers);
  append(key, choices, sizeof choices);
  append(key, p->subtables, (size_t)p->n_subtables * sizeof *p->subtables);
  append(key, tf->points, tf->count * sizeof *tf->points);
}

static void *table_begin(const tc_making *m, GError **error) {
  return tc_table_outline(&m->job->plan->table, tc_pool_halt(m->pool), error);
}

static bool table_go_on(void *thing, const tc_making *m, GError **error) {
  return tc_table_fill(thing, m->like, m->pool, error);
}

static bool table_is_whole(const void *thing, const tc_frame_job *job) {
  return job->outlines_table || ((const tc_table *)thing)->entries;
}

static bool table_is_like(const void *thing, const void *job) {
  const tc_table *t = thing;
  const tc_table_params *p = &((const tc_frame_job *)job)->plan->table;
  return t->entries && t->n == p->n && t->step_mm == p->step_mm && t->lo == p->voxel_lo && t->hi == p->voxel_hi;
}

static int64_t table_steps(const void *thing) { return tc_table_steps(thing); }
static size_t table_held(const void *thing) { return tc_table_held(thing); }

static void *integrals_begin(const tc_making *m, GError **error) {
  return tc_integrals_build(&m->job->plan->table, tc_pool_halt(m->pool), error);
}

/* ---- empty-space skipping ---- */

/* Only zero or not zero matters for each amount; colours, step and compositing space do not matter. */
static void support_key(const tc_frame_job *job, GByteArray *key) {
  if (job->plan->key.mode == TC_MODE_ISOSURFACE) {
    append(key, &job->plan->surface.below, sizeof(double));
    append(key, &job->plan->surface.above, sizeof(double));
    return;
  }
  const tc_table_params *p = &job->plan->table;
  const double numbers[] = {p->n, p->voxel_lo, p->voxel_hi, p->slope, p->intercept};
  append(key, numbers, sizeof numbers);
  for (size_t i = 0; i < p->tf->count; i++) {
    const guint8 shows = p->tf->points[i].amount > 0;
    append(key, &p->tf->points[i].value, sizeof p->tf->points[i].value);
    append(key, &shows, 1);
  }
}

static void *support_begin(const tc_making *m, GError **error) {
  const tc_plan *plan = m->job->plan;
  if (plan->key.mode == TC_MODE_ISOSURFACE) return tc_support_surface(plan->surface.below, plan->surface.above, error);
  return tc_support_build(&plan->table, error);
}

/* Inputs of the acceleration grid, shared by all structures made from it. */
static void blocks_key(const tc_frame_job *job, GByteArray *key) {
  const uint64_t serial = tc_volume_serial(job->volume);
  append(key, &serial, sizeof serial);
  append(key, &job->plan->block, sizeof job->plan->block);
  append(key, &job->plan->reach, sizeof job->plan->reach);
}

static void supported_key(const tc_frame_job *job, GByteArray *key) {
  blocks_key(job, key);
  append(key, &job->have.support->serial, sizeof job->have.support->serial);
}

static void *minmax_begin(const tc_making *m, GError **error) {
  return tc_minmax_begin(m->job->volume, m->job->plan->block, m->job->plan->reach, error);
}

static bool minmax_go_on(void *thing, const tc_making *m, GError **error) {
  return tc_minmax_go_on(thing, m->job->volume, m->pool, error);
}

static int64_t minmax_steps(const void *thing) { return ((const tc_minmax *)thing)->done; }

/* A transfer function is usually a small change of the previous one, so a build reuses layers of the latest map. */
static bool distance_map_is_like(const void *thing, const void *user) {
  const tc_distance_map *map = thing;
  const tc_frame_job *job = user;
  return map->block == job->plan->block && map->reach == job->plan->reach &&
         map->volume == tc_volume_serial(job->volume);
}

static void *distance_map_begin(const tc_making *m, GError **error) {
  tc_distance_map *map = tc_distance_map_build(m->job->have.minmax, m->job->have.support, m->like, m->pool, error);
  if (map) map->volume = tc_volume_serial(m->job->volume);
  return map;
}

static double distance_map_empty_share(const void *thing) { return ((const tc_distance_map *)thing)->empty_share; }

#define FINE_SHARE 3 /* fine boxes take at most budget / FINE_SHARE */

static void *fine_begin(const tc_making *m, GError **error) {
  return tc_fine_begin(m->job->volume, m->job->plan->block, m->job->plan->reach, (size_t)(m->budget / FINE_SHARE), error);
}

static bool fine_go_on(void *thing, const tc_making *m, GError **error) {
  return tc_fine_go_on(thing, m->job->volume, m->pool, error);
}

static int64_t fine_steps(const void *thing) { return ((const tc_fine *)thing)->grid.done; }

static void *boxes_begin(const tc_making *m, GError **error) {
  return tc_boxes_begin(m->job->have.fine, m->job->have.support, m->pool, error);
}

static bool boxes_go_on(void *thing, const tc_making *m, GError **error) {
  return tc_boxes_go_on(thing, m->job->have.fine, m->pool, error);
}

static int64_t boxes_steps(const void *thing) { return tc_boxes_steps(thing); }
static size_t boxes_held(const void *thing) { return ((const tc_boxes *)thing)->begun ? 0 : boxes_bytes(thing); }
static double boxes_empty_share(const void *thing) { return ((const tc_boxes *)thing)->empty_share; }

static void bounds_key(const tc_frame_job *job, GByteArray *key) {
  const tc_grey *g = &job->plan->grey;
  const float grey[] = {g->sign, g->floor, g->stop};
  blocks_key(job, key);
  append(key, grey, sizeof grey);
}

static void *bounds_begin(const tc_making *m, GError **error) {
  return tc_bounds_build(m->job->have.minmax, &m->job->plan->grey, m->pool, error);
}

/* ---- labels ---- */

static const tc_volume *labels_tied(const tc_frame_job *job) { return job->label_volume; }

static const tc_scene *labels_scene(const tc_frame_job *job) {
  if (tc_labels_in_color(job->source, job->scene)) return tc_labels_of_colors();
  return job->plan->key.labels == TC_PLAN_GAPS ? tc_labels_of_gaps() : job->scene;
}

static void labels_key(const tc_frame_job *job, GByteArray *key) {
  GBytes *bytes = tc_labels_key(job->label_volume, labels_scene(job));
  append(key, g_bytes_get_data(bytes, NULL), g_bytes_get_size(bytes));
  g_bytes_unref(bytes);
}

static void *labels_begin(const tc_making *m, GError **error) {
  const tc_frame_job *job = m->job;
  GBytes *key = tc_labels_key(job->label_volume, labels_scene(job));
  return tc_labels_build(job->label_volume, labels_scene(job), key, tc_pool_halt(m->pool), error);
}

/* ---- mesh ---- */

/* Share of the budget for a mesh: while clusters are built, the mesh, buffers and clusters exist together. */
#define MESH_SHARE 0.4

static void free_surfaces(void *thing) { tc_surfaces_free(thing); }

/* True if the mesh is the surfaces of all visible labels: the scene has labels and no list of surfaces. */
static bool of_labels(const tc_frame_job *job) {
  return !job->scene->mesh.n_surfaces && tc_plan_has(job->plan, TC_RESOURCE_LABELS) && job->mesh_in_view;
}

static const tc_volume *mesh_tied(const tc_frame_job *job) { return of_labels(job) ? job->label_volume : job->source; }

static void visible_key(const tc_scene *s, GByteArray *key) {
  const guint8 all = !s->labels.visible;
  append(key, &all, 1);
  append(key, s->labels.visible, all ? 0 : s->labels.n_visible * sizeof *s->labels.visible);
}

/* Sources of a mesh that is not of labels: the scene's list, or the one isosurface; none if nothing is in the view. */
static size_t sources_of(const tc_frame_job *job, tc_mesh_source of[TC_MAX_SURFACES]) {
  if (!job->mesh_in_view) return 0;
  if (job->scene->mesh.n_surfaces) return tc_mesh_sources(job, of);
  of[0] = (tc_mesh_source){.kind = TC_SURFACE_OF_VALUE, .iso = job->scene->isosurface.value,
                           .serial = tc_volume_serial(job->source)};
  return 1;
}

/* The geometry of the surfaces, without their colours. */
static void mesh_key(const tc_frame_job *job, GByteArray *key) {
  const uint64_t serial = tc_volume_serial(mesh_tied(job));
  const tc_scene *s = job->scene;
  tc_mesh_source of[TC_MAX_SURFACES];
  append(key, &serial, sizeof serial);
  if (of_labels(job)) {
    visible_key(s, key);
    return;
  }
  for (size_t i = 0, n = sources_of(job, of); i < n; i++) {
    const uint64_t whole[] = {of[i].kind, of[i].label, of[i].serial};
    append(key, whole, sizeof whole);
    append(key, &of[i].iso, sizeof of[i].iso);
    append(key, of[i].plane, sizeof of[i].plane);
  }
}

/* True if the mesh shares a surface with the job's: if only one surface of several moved, only that one is built. */
static bool mesh_is_like(const void *thing, const void *user) {
  const tc_clusters *mesh = thing;
  const tc_frame_job *job = user;
  tc_mesh_source of[TC_MAX_SURFACES];
  const bool labels = of_labels(job);
  const size_t n = labels ? 0 : sources_of(job, of);
  for (size_t i = 0; i < mesh->n_parts; i++) {
    if (labels && mesh->parts[i].of.kind == TC_SURFACE_OF_LABEL &&
        mesh->parts[i].of.serial == tc_volume_serial(job->label_volume))
      return true;
    for (size_t k = 0; k < n; k++)
      if (tc_mesh_source_equal(&mesh->parts[i].of, &of[k])) return true;
  }
  return false;
}

static bool shows_label(const void *user, uint32_t label) { return tc_labels_show(user, label); }

static void *mesh_begin(const tc_making *m, GError **error) { return tc_surfaces_begin(); }

static bool mesh_go_on(void *thing, const tc_making *m, GError **error) {
  tc_mesh_source of[TC_MAX_SURFACES];
  const bool labels = of_labels(m->job);
  const size_t n = labels ? 0 : sources_of(m->job, of);
  const tc_surfaces_wish wish = {.volume = m->job->source,
                                 .blocks = m->job->volume == m->job->source ? m->job->have.minmax : NULL,
                                 .labels = m->job->label_volume,
                                 .sources = labels ? NULL : of,
                                 .n_sources = n,
                                 .shows = shows_label,
                                 .user = m->job->scene,
                                 .like = m->like,
                                 .max_bytes = (uint64_t)(MESH_SHARE * (double)m->budget),
                                 .permille = m->job->building ? &m->job->building->permille : NULL,
                                 .pool = m->pool};
  return tc_surfaces_go_on(thing, &wish, error);
}

static void *mesh_finish(void *thing) { return tc_surfaces_take(thing); }
static int64_t mesh_steps(const void *thing) { return tc_surfaces_steps(thing); }
static size_t mesh_unfinished(const void *thing) { return tc_surfaces_held(thing); }

static void free_clusters(void *thing) {
  tc_clusters *c = thing;
  if (c) tc_clusters_free(tc_refining_end(c->refining));
  tc_clusters_free(c);
}

static size_t mesh_refines(const void *thing) {
  const tc_clusters *c = thing;
  return c->refined || c->refining || c->n_triangles < TC_LEVELS_LEAST ? 0 : tc_levels_bytes(c);
}

static bool mesh_refine(void *thing) {
  tc_clusters *c = thing;
  if (!c->refining) {
    if (mesh_refines(c)) c->refining = tc_refining_begin(c);
    return false;
  }
  if (!tc_refining_is_over(c->refining)) return false;
  tc_clusters *levels = tc_refining_end(c->refining);
  c->refining = NULL;
  if (!levels || !tc_levels_add(c, levels, NULL)) c->refined++; /* failed: no second attempt */
  return true;
}

/* ---- splats ---- */

static void free_model(void *thing) { tc_vmd_free(thing); }
static size_t model_bytes(const void *thing) { return ((const tc_vmd *)thing)->total_bytes; }
THING(splats)

static bool splats_labels(const tc_frame_job *job) { return tc_plan_has(job->plan, TC_RESOURCE_LABELS); }

/* The volume of the object: the label volume if labels are splatted, else the scene's. */
static const tc_volume *object_of(const tc_frame_job *job) { return splats_labels(job) ? job->label_volume : job->source; }

/* The set of filled voxels, without their colours. */
static void model_key(const tc_frame_job *job, GByteArray *key) {
  const uint64_t serial = tc_volume_serial(object_of(job));
  const tc_scene *s = job->scene;
  append(key, &serial, sizeof serial);
  if (splats_labels(job))
    visible_key(s, key);
  else
    append(key, s->splat.threshold, sizeof s->splat.threshold);
}

static bool label_shows(const void *user, double voxel) {
  const tc_frame_job *job = user;
  const tc_volume_desc *d = tc_volume_describe(job->label_volume);
  const tc_labels *labels = job->have.labels;
  return d->slope * voxel + d->intercept > 0 && labels->entries[(int)voxel - labels->base][4] > 0;
}

static void *model_begin(const tc_making *m, GError **error) {
  const double *range = m->job->scene->splat.threshold;
  const tc_vmd_options options = {
      .low = range[0], .high = range[1], .shows = splats_labels(m->job) ? label_shows : NULL, .user = m->job};
  return tc_vmd_of_volume(object_of(m->job), &options, m->pool, error);
}

/* Inner voxels are needed if the object is translucent or not culled. */
static bool has_inside(const tc_scene *scene) { return !scene->splat.opaque || !scene->splat.culling; }

static void splats_key(const tc_frame_job *job, GByteArray *key) {
  const guint8 inside = has_inside(job->scene);
  model_key(job, key);
  append(key, &inside, 1);
}

static void *splats_begin(const tc_making *m, GError **error) {
  const tc_scene *scene = m->job->scene;
  const tc_vmd *model = tc_volume_model(m->job->source), *built = m->job->have.model;
  if (splats_labels(m->job)) return tc_splats_build(built, (tc_splat_normals){0}, has_inside(scene), m->pool, error);
  if (model) {
    const bool own = tc_vmd_attribute_named(&model->head, "normal") != NULL;
    return tc_splats_build(built, (tc_splat_normals){own ? tc_vmd_own_normal : NULL, model}, has_inside(scene), m->pool,
                           error);
  }
  tc_vmd_object *object = tc_vmd_object_new(m->job->source, scene->splat.threshold[0], scene->splat.threshold[1]);
  if (!object) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
    return NULL;
  }
  tc_splats *splats = tc_splats_build(built, (tc_splat_normals){tc_vmd_normal_at, object, tc_vmd_end_at}, has_inside(scene),
                                      m->pool, error);
  tc_vmd_object_free(object);
  return splats;
}

static void cut_key(const tc_frame_job *job, GByteArray *key) {
  double planes[TC_SPLAT_MOST_PLANES][4];
  const int n = tc_splat_planes(object_of(job), job->scene, 0, planes); /* the model says which sides it reaches */
  model_key(job, key);
  append(key, planes, (size_t)n * sizeof *planes);
}

static void *cut_begin(const tc_making *m, GError **error) {
  double planes[TC_SPLAT_MOST_PLANES][4];
  const int n = tc_splat_planes(object_of(m->job), m->job->scene, m->job->have.splats->sides, planes);
  return tc_splats_cut(m->job->have.model, m->job->have.splats, (const double(*)[4])planes, n, tc_pool_halt(m->pool), error);
}

/* ---- all kinds ---- */

#define MOST_ONCE 4 /* kept of each kind that a drag of the transfer function or window builds anew for each frame */

#define BIT(resource) (1u << TC_RESOURCE_##resource)
#define FIELD BIT(COEFFICIENTS) /* the sampled field, if the plan has coefficients */

const tc_resource_kind tc_resource_kinds[TC_RESOURCE_COUNT] = {
    /* Coefficients are large and the first resource of a frame: they may evict every other resource. */
    [TC_RESOURCE_COEFFICIENTS] = {.store = {"coefficients", free_volume, free_coefficients, true},
                                  .key = coefficients_key,
                                  .tied = coefficients_tied,
                                  .begin = coefficients_begin,
                                  .go_on = coefficients_go_on,
                                  .finish = coefficients_finish,
                                  .steps = coefficients_steps,
                                  .unfinished_held = coefficients_unfinished,
                                  .bytes = coefficients_bytes},
    [TC_RESOURCE_TABLE] = {.store = {"transfer function", free_table, NULL, false, MOST_ONCE},
                           .needs = FIELD,
                           .key = table_key,
                           .begin = table_begin,
                           .go_on = table_go_on,
                           .is_whole = table_is_whole,
                           .steps = table_steps,
                           .grows = table_bytes,
                           .is_like = table_is_like,
                           .held = table_held,
                           .bytes = table_bytes},
    [TC_RESOURCE_INTEGRALS] = {.store = {"transfer function", free_integrals, NULL, false},
                               .needs = FIELD,
                               .key = table_key,
                               .begin = integrals_begin,
                               .bytes = integrals_bytes},
    [TC_RESOURCE_SUPPORT] = {.store = {"transfer function", free_support, NULL, false},
                             .needs = FIELD,
                             .key = support_key,
                             .begin = support_begin,
                             .bytes = support_bytes},
    [TC_RESOURCE_MINMAX] = {.store = {"min-max blocks", free_minmax, NULL, false},
                            .needs = FIELD,
                            .key = blocks_key,
                            .tied = field_of,
                            .begin = minmax_begin,
                            .go_on = minmax_go_on,
                            .steps = minmax_steps,
                            .bytes = minmax_bytes},
    [TC_RESOURCE_DISTANCE_MAP] = {.store = {"distance map", free_distance_map, NULL, false},
                          .needs = FIELD | BIT(SUPPORT) | BIT(MINMAX),
                          .key = supported_key,
                          .tied = field_of,
                          .begin = distance_map_begin,
                          .is_like = distance_map_is_like,
                          .bytes = distance_map_bytes,
                          .empty_share = distance_map_empty_share},
    [TC_RESOURCE_FINE] = {.store = {"minima and maxima of fine boxes", free_fine, NULL, false},
                          .needs = FIELD,
                          .key = blocks_key,
                          .tied = field_of,
                          .begin = fine_begin,
                          .go_on = fine_go_on,
                          .steps = fine_steps,
                          .bytes = fine_bytes},
    [TC_RESOURCE_BOXES] = {.store = {"occupied boxes", free_boxes, NULL, false, MOST_ONCE},
                           .needs = FIELD | BIT(SUPPORT) | BIT(FINE),
                           .key = supported_key,
                           .tied = field_of,
                           .begin = boxes_begin,
                           .go_on = boxes_go_on,
                           .steps = boxes_steps,
                           .held = boxes_held,
                           .bytes = boxes_bytes,
                           .empty_share = boxes_empty_share},
    [TC_RESOURCE_BOUNDS] = {.store = {"bounds of the blocks", free_bounds, NULL, false, MOST_ONCE},
                            .needs = FIELD | BIT(MINMAX),
                            .key = bounds_key,
                            .tied = field_of,
                            .begin = bounds_begin,
                            .bytes = bounds_bytes},
    [TC_RESOURCE_LABELS] = {.store = {"labels", free_labels, NULL, false},
                            .key = labels_key,
                            .tied = labels_tied,
                            .begin = labels_begin,
                            .bytes = labels_bytes},
    [TC_RESOURCE_MESH] = {.store = {"surface mesh", free_clusters, free_surfaces, false},
                          .needs = BIT(MINMAX),
                          .key = mesh_key,
                          .tied = mesh_tied,
                          .begin = mesh_begin,
                          .go_on = mesh_go_on,
                          .finish = mesh_finish,
                          .steps = mesh_steps,
                          .unfinished_held = mesh_unfinished,
                          .is_like = mesh_is_like,
                          .refines = mesh_refines,
                          .refine = mesh_refine,
                          .bytes = clusters_bytes},
    [TC_RESOURCE_MODEL] = {.store = {"voxel model", free_model, NULL, false},
                          .needs = BIT(LABELS),
                          .key = model_key,
                          .tied = object_of,
                          .begin = model_begin,
                          .bytes = model_bytes},
    [TC_RESOURCE_SPLATS] = {.store = {"splats", free_splats, NULL, false},
                            .needs = BIT(MODEL),
                            .key = splats_key,
                            .tied = object_of,
                            .begin = splats_begin,
                            .bytes = splats_bytes},
    [TC_RESOURCE_CUT] = {.store = {"splats of a cut", free_splats, NULL, false},
                         .needs = BIT(MODEL) | BIT(SPLATS),
                         .key = cut_key,
                         .tied = object_of,
                         .begin = cut_begin,
                         .bytes = splats_bytes},
};
