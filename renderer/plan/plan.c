#include "renderer/plan/plan.h"

#include <math.h>
#include <string.h>

#include "renderer/classify/integrals.h"
#include "renderer/classify/labels.h"
#include "renderer/mesh/surfaces.h"
#include "renderer/raycast/rays.h"
#include "renderer/skip/boxes.h"
#include "renderer/classify/transfer.h"
#include "renderer/skip/skip.h"

/* Largest error of a level of detail, in pixels: half a pixel is invisible; motion and a reduced picture size hide
 * more. */
#define PIXELS_AT_REST 0.5
#define PIXELS_MOVING 1
/* Most nodes a side of a moving scene's table. While a transfer function is dragged every frame builds a table: one of 256 nodes
 * takes .6 to 5 ms, one of 1024 nodes 10, and up to 48 in memory that is not mapped yet (AMD EPYC, Zen 4, two threads). Subtables
 * still resolve steep rises of opacity. */
#define NODES_MOVING 256

static void need(tc_plan *plan, tc_resource resource) { plan->resources |= 1u << resource; }

static void need_mesh(tc_plan *plan, const tc_plan_request *request) {
  need(plan, TC_RESOURCE_MESH);
  plan->mesh_pixels = request->moving ? PIXELS_MOVING * fmax(request->coarser_levels, 1) : PIXELS_AT_REST;
}

/* ---- parts shared by several modes ---- */

/* The sampled field and its filter. */
static void plan_field(tc_plan *plan, const tc_volume *volume, const tc_scene *s) {
  bool prefilter = s->filter == TC_FILTER_CUBIC && s->sampling.prefilter;
  plan->key.filter = (uint8_t)s->filter;
  plan->key.voxel_type = (uint8_t)(prefilter ? TC_F32 : tc_volume_describe(volume)->type);
  if (prefilter) need(plan, TC_RESOURCE_COEFFICIENTS);
}

/* Rays of the scene's camera. */
static void plan_view(tc_plan *plan, const tc_volume *volume, const tc_scene *s) {
  plan->key.projection = (uint8_t)s->camera.projection;
  plan->key.rays = s->sampling.rays_per_pixel > 1;
  plan->step_mm = tc_rays_step_mm(volume, s);
}

/* Modes mesh and splat cast no rays: neither coefficients nor a filter are needed. */
static void plan_object(tc_plan *plan, const tc_volume *volume) {
  plan->resources = 0;
  plan->key.filter = TC_FILTER_LINEAR;
  plan->key.voxel_type = (uint8_t)tc_volume_describe(volume)->type;
}

static void plan_shading(tc_plan *plan, const tc_scene *s) {
  plan->key.shading = (uint8_t)s->shading.model;
  if (plan->key.shading)
    plan->key.gradient = (uint8_t)(s->filter == TC_FILTER_CUBIC ? TC_GRADIENT_CUBIC : s->shading.gradient);
}

/* Empty-space skipping; `how` is the structure that rays read. */
static void plan_skipping(tc_plan *plan, const tc_scene *s, tc_resource how) {
  plan->key.skipping = 1;
  plan->block = tc_skip_block(s->skipping.block);
  plan->reach = tc_skip_reach(s->filter);
  need(plan, how == TC_RESOURCE_BOXES ? TC_RESOURCE_FINE : TC_RESOURCE_MINMAX);
  need(plan, how);
}

static void plan_labels(tc_plan *plan, const tc_scene *s) {
  plan->key.labels = s->labels.volume[0] ? TC_PLAN_LABELS : TC_PLAN_NO_LABELS;
  if (plan->key.labels) need(plan, TC_RESOURCE_LABELS);
}

/* The volume's own gaps are hidden as labels, unless the scene has labels. */
static void plan_gaps(tc_plan *plan, const tc_volume *volume) {
  if (plan->key.labels || !tc_volume_gaps(volume)) return;
  plan->key.labels = TC_PLAN_GAPS;
  need(plan, TC_RESOURCE_LABELS);
}

/* ---- the modes ---- */

/* field: the sampled field, or the voxels while coefficients are not built. */
static void plan_table(tc_plan *plan, const tc_volume *field, const tc_scene *scene, const tc_plan_request *request) {
  const tc_volume_desc *d = tc_volume_describe(field);
  const bool integrals = tc_integrals_serve(scene->classification);
  tc_table_params p = {.tf = &scene->transfer_function, .slope = d->slope, .intercept = d->intercept,
                       .linear_light = scene->image.linear_light};
  need(plan, integrals ? TC_RESOURCE_INTEGRALS : TC_RESOURCE_TABLE);
  if (integrals) {
    tc_integrals_choose(field, &p); /* integrals serve segments of any length: step_mm stays 0 */
  } else {
    tc_table_choose(field, &p, NULL);
    if (request->moving && p.n > NODES_MOVING) {
      bool complete;
      p.n = NODES_MOVING;
      tc_table_subtables(field, &p, &complete);
    }
    p.step_mm = plan->step_mm;
    p.bits = request->table_bits;
    plan->key.stiff = tc_extinction_most(&scene->transfer_function) * plan->step_mm > TC_STIFF_DEPTH;
  }
  if (request->table_size) p.n = request->table_size, p.n_subtables = 0;
  plan->table = p;
  plan->key.subtables = p.n_subtables > 0;
}

/* Coherence: a pixel's rays may start where its centre ray ended its first leap, if the space between them is known to
 * be empty. */
static bool is_coherent(const tc_plan *plan, const tc_volume *volume, const tc_scene *s) {
  if (!s->sampling.coherence || !plan->key.rays || !plan->key.skipping) return false;
  tc_rays rays;
  tc_rays_set_up(&rays, volume, s, plan->width, plan->height);
  return rays.footprint < plan->block;
}

static void plan_dvr(tc_plan *plan, const tc_volume *volume, const tc_scene *s, const tc_plan_request *request) {
  const tc_volume_stats *range = tc_volume_statistics(volume);
  plan_view(plan, volume, s);
  plan->key.jitter = s->sampling.jitter;
  plan->key.classification = (uint8_t)s->classification;
  plan->key.order = (uint8_t)s->order;
  plan->key.termination = s->sampling.termination > 0 && s->order == TC_FRONT_TO_BACK;
  plan_shading(plan, s);
  plan_labels(plan, s);
  plan_gaps(plan, volume);
  plan_table(plan, request->field ? request->field : volume, s, request);
  if (s->skipping.mode == TC_SKIPPING_AUTO && tc_skip_possible(&s->transfer_function, range->min, range->max) &&
      (request->maps_distance || tc_boxes_serve(volume))) {
    need(plan, TC_RESOURCE_SUPPORT);
    plan_skipping(plan, s, request->maps_distance ? TC_RESOURCE_DISTANCE_MAP : TC_RESOURCE_BOXES);
  }
  plan->key.coherence = is_coherent(plan, volume, s);
}

static void plan_projection(tc_plan *plan, const tc_volume *volume, const tc_scene *s, const tc_plan_request *request) {
  plan_view(plan, volume, s);
  plan->grey = tc_grey_make(request->field ? request->field : volume, s);
  plan_gaps(plan, volume);
  if (plan->key.labels) return; /* gaps: a block without a greater value may hold a ray's first visible sample */
  if (s->skipping.mode != TC_SKIPPING_AUTO || s->mode == TC_MODE_AVERAGE) return;
  plan_skipping(plan, s, TC_RESOURCE_BOUNDS);
  if (!s->skipping.block && !request->maps_distance) plan->block = TC_SKIP_BLOCK_BOUNDS;
}

static void plan_isosurface(tc_plan *plan, const tc_volume *volume, const tc_scene *s, const tc_plan_request *request) {
  plan_view(plan, volume, s);
  plan->surface = tc_surface_make(volume, s);
  plan->depth = request->want_depth;
  plan_gaps(plan, volume);
  if (tc_surface_exists(volume, s)) plan_shading(plan, s);
  if (s->skipping.mode != TC_SKIPPING_AUTO) return;
  need(plan, TC_RESOURCE_SUPPORT);
  plan_skipping(plan, s, TC_RESOURCE_DISTANCE_MAP);
}

/* True if a surface of the list is a label's. */
static bool lists_labels(const tc_scene *s) {
  for (size_t i = 0; i < s->mesh.n_surfaces; i++)
    if (s->mesh.surfaces[i].source == TC_SURFACE_OF_LABEL && tc_mesh_surface_shows(&s->mesh.surfaces[i])) return true;
  return false;
}

/* The shading model of the scene, or of a surface that overrides it. */
static tc_shading_model model_of(const tc_scene *s) {
  tc_shading_model model = s->shading.model;
  for (size_t i = 0; i < s->mesh.n_surfaces && model == TC_SHADING_NONE; i++)
    if (s->mesh.surfaces[i].own_shading & 1) model = s->mesh.surfaces[i].model;
  return model;
}

/* Extraction reads the blocks through which the surface passes; labels have a field of their own. */
static void plan_extraction(tc_plan *plan, const tc_volume *volume, const tc_scene *s) {
  bool extracts = !s->mesh.n_surfaces && !plan->key.labels && tc_surface_exists(volume, s);
  for (size_t i = 0; i < s->mesh.n_surfaces; i++)
    extracts |= s->mesh.surfaces[i].source == TC_SURFACE_OF_VALUE && tc_mesh_surface_shows(&s->mesh.surfaces[i]);
  if (!extracts || s->skipping.mode != TC_SKIPPING_AUTO) return;
  plan->block = tc_skip_block(s->skipping.block);
  need(plan, TC_RESOURCE_MINMAX);
}

static void plan_mesh(tc_plan *plan, const tc_volume *volume, const tc_scene *s, const tc_plan_request *request) {
  plan_object(plan, volume);
  plan_view(plan, volume, s);
  plan->surface = tc_surface_make(volume, s);
  plan->depth = request->want_depth;
  if (!s->mesh.n_surfaces || lists_labels(s)) plan_labels(plan, s);
  if (plan->key.labels || s->mesh.n_surfaces || tc_surface_exists(volume, s))
    plan->key.shading = (uint8_t)model_of(s);
  plan_extraction(plan, volume, s);
  need_mesh(plan, request);
}

static void plan_mpr(tc_plan *plan, const tc_volume *volume, const tc_scene *s) {
  const double *spacing = tc_volume_describe(volume)->spacing;
  plan->key.projection = TC_ORTHOGRAPHIC;
  if (s->mpr.thickness_mm > 0) plan->key.slab = (uint8_t)(1 + s->mpr.projection);
  plan->step_mm = s->sampling.step * fmin(spacing[0], fmin(spacing[1], spacing[2]));
  plan_labels(plan, s);
  plan_gaps(plan, volume);
  if (!tc_labels_in_color(volume, s)) return;
  plan->key.labels = TC_PLAN_LABELS;
  need(plan, TC_RESOURCE_LABELS);
}

static void plan_splat(tc_plan *plan, const tc_volume *volume, const tc_scene *s, const tc_plan_request *request) {
  plan_object(plan, volume);
  plan->key.projection = (uint8_t)s->camera.projection;
  plan->key.shading = (uint8_t)s->shading.model;
  plan->depth = request->want_depth;
  plan_labels(plan, s);
  need(plan, TC_RESOURCE_MODEL);
  need(plan, TC_RESOURCE_SPLATS);
  if (s->splat.opaque) need(plan, TC_RESOURCE_CUT);
}

/* Surfaces within a volume. */
static void plan_within(tc_plan *plan, const tc_volume *volume, const tc_scene *s, const tc_plan_request *request) {
  plan->surface = tc_surface_make(volume, s);
  if (lists_labels(s)) need(plan, TC_RESOURCE_LABELS);
  need_mesh(plan, request);
}

void tc_plan_make(const tc_volume *volume, const tc_scene *scene, const tc_plan_request *request, tc_plan *plan) {
  static const tc_plan_request none = {0};
  if (!request) request = &none;
  memset(plan, 0, sizeof *plan);
  plan->key.mode = (uint8_t)scene->mode;
  plan->key.clipping = scene->clip.has_box || scene->clip.n_planes > 0;
  plan->width = request->width ? request->width : scene->image.width;
  plan->height = request->height ? request->height : scene->image.height;
  plan_field(plan, volume, scene);
  switch (scene->mode) {
  case TC_MODE_DVR: plan_dvr(plan, volume, scene, request); break;
  case TC_MODE_MIP:
  case TC_MODE_MINIP:
  case TC_MODE_AVERAGE: plan_projection(plan, volume, scene, request); break;
  case TC_MODE_ISOSURFACE: plan_isosurface(plan, volume, scene, request); break;
  case TC_MODE_MPR: plan_mpr(plan, volume, scene); break;
  case TC_MODE_MESH: plan_mesh(plan, volume, scene, request); break;
  case TC_MODE_SPLAT: plan_splat(plan, volume, scene, request); break;
  case TC_MODE_COUNT: break;
  }
  if (tc_mesh_is_within(scene)) plan_within(plan, volume, scene, request);
}
