#include "renderer/plan/explain.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "renderer/classify/integrals.h"
#include "renderer/mesh/surfaces.h"
#include "renderer/raycast/rays.h"
#include "renderer/reference/reference.h"
#include "renderer/skip/boxes.h"

const char *tc_stage_name(tc_stage stage) {
  static const char *const names[TC_STAGE_COUNT] = {
      "coefficients",   "table-1d",     "table-2d", "gradient", "skipping",    "clipping",
      "rays-per-pixel", "coherence",    "jitter",   "labels",   "termination", "alpha",
      "depth-output",   "linear-light", "resolve",  "encode",   "error-meter", "mesh",
      "splats"};
  return (unsigned)stage < TC_STAGE_COUNT ? names[stage] : "?";
}

tc_stage tc_stage_of(tc_resource resource) {
  static const tc_stage stages[TC_RESOURCE_COUNT] = {
      [TC_RESOURCE_COEFFICIENTS] = TC_STAGE_COEFFICIENTS, [TC_RESOURCE_TABLE] = TC_STAGE_TABLE_2D,
      [TC_RESOURCE_INTEGRALS] = TC_STAGE_TABLE_1D,        [TC_RESOURCE_SUPPORT] = TC_STAGE_SKIPPING,
      [TC_RESOURCE_MINMAX] = TC_STAGE_SKIPPING,           [TC_RESOURCE_DISTANCE_MAP] = TC_STAGE_SKIPPING,
      [TC_RESOURCE_FINE] = TC_STAGE_SKIPPING,
      [TC_RESOURCE_BOXES] = TC_STAGE_SKIPPING,            [TC_RESOURCE_BOUNDS] = TC_STAGE_SKIPPING,
      [TC_RESOURCE_LABELS] = TC_STAGE_LABELS,             [TC_RESOURCE_MESH] = TC_STAGE_MESH,
      [TC_RESOURCE_MODEL] = TC_STAGE_SPLATS,               [TC_RESOURCE_SPLATS] = TC_STAGE_SPLATS,
      [TC_RESOURCE_CUT] = TC_STAGE_SPLATS};
  return stages[resource];
}

/* Input and output of the explanation. */
typedef struct teller {
  const tc_plan *plan;
  const tc_volume *volume;
  const tc_scene *scene;
  const tc_facts *facts; /* or NULL */
  tc_explanation *to;
} teller;

static void say(const teller *t, tc_stage which, bool included, const char *format, ...) G_GNUC_PRINTF(4, 5);
static void say(const teller *t, tc_stage which, bool included, const char *format, ...) {
  tc_explained_stage *stage = &t->to->stages[which];
  va_list args;
  va_start(args, format);
  vsnprintf(stage->reason, sizeof stage->reason, format, args);
  va_end(args);
  stage->included = included;
}

static void add(const teller *t, tc_stage which, const char *format, ...) G_GNUC_PRINTF(3, 4);
static void add(const teller *t, tc_stage which, const char *format, ...) {
  tc_explained_stage *stage = &t->to->stages[which];
  size_t used = strlen(stage->reason);
  va_list args;
  va_start(args, format);
  vsnprintf(stage->reason + used, sizeof stage->reason - used, format, args);
  va_end(args);
}

static void say_coefficients(const teller *t) {
  const tc_scene *s = t->scene;
  bool cubic = s->filter == TC_FILTER_CUBIC, prefilter = tc_plan_has(t->plan, TC_RESOURCE_COEFFICIENTS);
  say(t, TC_STAGE_COEFFICIENTS, prefilter,
      prefilter ? "sampling.prefilter: the cubic filter passes through the voxels"
      : cubic   ? "sampling.prefilter is off: the cubic filter smooths"
                : "filter is %s", tc_filter_names[s->filter]);
}

static void say_no_tables(const teller *t, const char *reason) {
  say(t, TC_STAGE_TABLE_1D, false, "%s", reason);
  say(t, TC_STAGE_TABLE_2D, false, "%s", reason);
}

static void say_tables(const teller *t) {
  const char *name = tc_classification_names[t->scene->classification];
  const tc_table_params *p = &t->plan->table;
  if (tc_plan_has(t->plan, TC_RESOURCE_INTEGRALS)) {
    say(t, TC_STAGE_TABLE_1D, true, "classification is %s: %s at %d values, for segments of any length", name,
        t->scene->classification == TC_POST ? "extinction and colour" : "integrals of extinction and colour", p->n);
    say(t, TC_STAGE_TABLE_2D, false, "classification is %s: segments are not looked up in a 2-D table", name);
    return;
  }
  char subtables[48] = "";
  if (p->n_subtables)
    snprintf(subtables, sizeof subtables, ", %d subtable%s for close knots", p->n_subtables, p->n_subtables > 1 ? "s" : "");
  say(t, TC_STAGE_TABLE_1D, false, "classification is %s: segments are integrated beforehand", name);
  say(t, TC_STAGE_TABLE_2D, true, "classification is %s: %d values a side%s%s, segments of %.4g mm", name, p->n, subtables,
      t->plan->key.stiff ? ", depths" : "", t->plan->step_mm);
  if (t->facts && t->facts->table_builder) add(t, TC_STAGE_TABLE_2D, "; %s", t->facts->table_builder);
}

/* True, and said of the stage, if the volume has no surface at the scene's value. */
static bool say_no_surface(const teller *t, tc_stage stage) {
  const tc_scene *s = t->scene;
  const tc_volume_stats *range = tc_volume_statistics(t->volume);
  if (!tc_is_surface(s->mode) || (s->mode == TC_MODE_MESH && (s->mesh.n_surfaces || t->plan->key.labels))) return false;
  if (tc_surface_exists(t->volume, s)) return false;
  say(t, stage, false, "empty picture: isosurface.value %.6g is not between the volume's %.6g and %.6g", s->isosurface.value,
      range->min, range->max);
  return true;
}

/* How gradients are computed. */
static void say_gradient(const teller *t) {
  static const char *const ways[2][TC_GRADIENT_COUNT] = {
      {"gradients from the corners that interpolation fetches", "central differences, once a visible segment",
       "the cubic b-spline's derivative, once a visible segment"},
      {"from eight samples around the hit, once a ray", "central differences at the hit, once a ray",
       "the cubic b-spline's derivative at the hit, once a ray"}};
  const tc_scene *s = t->scene;
  const tc_plan_key *key = &t->plan->key;
  if (say_no_surface(t, TC_STAGE_GRADIENT)) return;
  if (key->shading && s->mode == TC_MODE_MESH)
    say(t, TC_STAGE_GRADIENT, true, "shading.model is %s: normals of the vertices, once a visible pixel and triangle",
        tc_shading_names[key->shading]);
  else if (key->shading)
    say(t, TC_STAGE_GRADIENT, true, "shading.model is %s: %s%s", tc_shading_names[s->shading.model],
        ways[s->mode == TC_MODE_ISOSURFACE][key->gradient], s->filter == TC_FILTER_CUBIC ? " (the filter's own)" : "");
  else
    say(t, TC_STAGE_GRADIENT, false, "shading.model is %s", tc_shading_names[s->shading.model]);
}

/* Why empty space is skipped or not, according to the plan. */
static void say_skipping(const teller *t) {
  const tc_scene *s = t->scene;
  const bool in = t->plan->key.skipping;
  const char *reason = "";
  switch (s->mode) {
  case TC_MODE_DVR:
    reason = in ? "the transfer function is zero over part of the range"
             : !tc_boxes_serve(t->volume) ? "an axis is too long for boxes"
                                          : "the transfer function is nowhere zero in the volume's range";
    break;
  case TC_MODE_MIP: reason = "blocks that cannot raise a ray's maximum are skipped"; break;
  case TC_MODE_MINIP: reason = "blocks that cannot lower a ray's minimum are skipped"; break;
  case TC_MODE_AVERAGE: reason = "mode average counts every sample"; break;
  case TC_MODE_ISOSURFACE:
  case TC_MODE_MESH:
  case TC_MODE_SPLAT:
  case TC_MODE_MPR:
  case TC_MODE_COUNT: break;
  }
  if (s->skipping.mode == TC_SKIPPING_OFF)
    say(t, TC_STAGE_SKIPPING, false, "skipping.mode is off");
  else if (s->mode == TC_MODE_MESH && tc_plan_has(t->plan, TC_RESOURCE_MINMAX))
    say(t, TC_STAGE_SKIPPING, true, "extraction reads no block whose values are all on one side of the surface");
  else if (s->mode == TC_MODE_MESH)
    say(t, TC_STAGE_SKIPPING, false, "clusters of triangles outside the view, facing away or hidden are left out instead");
  else if (s->mode == TC_MODE_ISOSURFACE)
    say(t, TC_STAGE_SKIPPING, in, "blocks whose values are all on one side of %.6g are left out", s->isosurface.value);
  else
    say(t, TC_STAGE_SKIPPING, in, "%s", reason);
}

/* How skipping went in the frame. */
static void say_skipped(const teller *t) {
  const tc_facts *f = t->facts;
  if (!f || !t->plan->key.skipping) return;
  if (f->fills_in)
    say(t, TC_STAGE_SKIPPING, false, "the cpu draws without skipping until OpenGL is ready");
  else if (!f->key.skipping)
    say(t, TC_STAGE_SKIPPING, false, "only %.1f %% of the blocks are empty", 100 * f->empty_share);
  else if (f->empty_share >= 0 && tc_plan_has(t->plan, TC_RESOURCE_BOXES))
    say(t, TC_STAGE_SKIPPING, true, "%.1f %% of the blocks that hold fine boxes are empty", 100 * f->empty_share);
  else if (f->empty_share >= 0)
    say(t, TC_STAGE_SKIPPING, true, "%.1f %% of the blocks of %d voxels are empty", 100 * f->empty_share,
        t->plan->block);
}

static void say_clipping(const teller *t) {
  const tc_scene *s = t->scene;
  if (t->plan->key.clipping)
    say(t, TC_STAGE_CLIPPING, true, "%s%d clip planes; each ray is cut once, before its first sample",
        s->clip.has_box ? "a clip box and " : "", s->clip.n_planes);
  else
    say(t, TC_STAGE_CLIPPING, false, "no clip box or plane");
}

bool tc_meter_refuses(const tc_scene *scene, char *reason, size_t size) {
  const char *member = tc_reference_missing(scene);
  if (!member || !strcmp(member, "/labels/volume") || !strcmp(member, "/mesh/surfaces")) return false; /* the meter
                                                                                                          supplies them
                                                                                                          to the
                                                                                                          reference */
  snprintf(reason, size, "the reference does not support this %s", member + 1);
  return true;
}

static void say_meter(const teller *t) {
  char reason[96];
  if (!t->scene->error_meter.pixels)
    say(t, TC_STAGE_ERROR_METER, false, "errorMeter is off");
  else if (tc_meter_refuses(t->scene, reason, sizeof reason))
    say(t, TC_STAGE_ERROR_METER, false, "%s", reason);
  else
    say(t, TC_STAGE_ERROR_METER, true, "%d pixels of each final frame against the reference, in the background",
        t->scene->error_meter.pixels);
}

static void say_labels(const teller *t) {
  const tc_scene *s = t->scene;
  char shown[48] = "all show";
  if (s->labels.visible) snprintf(shown, sizeof shown, "%zu show", s->labels.n_visible);
  if (t->plan->key.labels == TC_PLAN_GAPS)
    say(t, TC_STAGE_LABELS, true, "voxels without a value (NaN) are hidden");
  else if (t->plan->key.labels && !s->labels.volume[0])
    say(t, TC_STAGE_LABELS, true, "the volume's own colours");
  else if (t->plan->key.labels)
    say(t, TC_STAGE_LABELS, true, "labels of volume %.40s: %s, tint %.3g", s->labels.volume, shown, s->labels.opacity);
  else if (s->labels.volume[0])
    say(t, TC_STAGE_LABELS, false, "mode %s shows values: labels colour dvr, mpr, meshes and splats only", tc_mode_names[s->mode]);
  else
    say(t, TC_STAGE_LABELS, false, "no label volume");
}

static void say_rays(const teller *t) {
  const tc_scene *s = t->scene;
  int count = s->sampling.rays_per_pixel;
  if (count == 1)
    say(t, TC_STAGE_RAYS, false, "one ray a pixel");
  else if (s->mode == TC_MODE_DVR)
    say(t, TC_STAGE_RAYS, true, "%d rays a pixel share its samples: segments of %.4g mm", count, t->plan->step_mm);
  else if (s->mode == TC_MODE_MESH)
    say(t, TC_STAGE_RAYS, true, "coverage by %d samples a pixel, shaded once per visible triangle", count);
  else if (s->mode == TC_MODE_ISOSURFACE)
    say(t, TC_STAGE_RAYS, true, "%d rays a pixel, each with its own hit; the mean antialiases edges", count);
  else
    say(t, TC_STAGE_RAYS, true, "%d rays a pixel, each with all samples: mode %s would miss extrema between them", count,
        tc_mode_names[s->mode]);
  say(t, TC_STAGE_JITTER, t->plan->key.jitter,
      !s->sampling.jitter        ? "sampling.jitter is off"
      : s->mode == TC_MODE_DVR ? "the first segment's length follows interleaved gradient noise over the pixels"
                               : "mode %s has no segments to shift",
      tc_mode_names[s->mode]);
}

static void say_coherence(const teller *t) {
  const tc_scene *s = t->scene;
  const bool skipping = t->facts ? t->facts->key.skipping : t->plan->key.skipping;
  tc_rays rays;
  if (!s->sampling.coherence) {
    say(t, TC_STAGE_COHERENCE, false, "sampling.coherence is off");
  } else if (s->sampling.rays_per_pixel == 1) {
    say(t, TC_STAGE_COHERENCE, false, "one ray per pixel: nothing to share");
  } else if (tc_is_projection(s->mode)) {
    say(t, TC_STAGE_COHERENCE, false, "mode %s has no empty space", tc_mode_names[s->mode]);
  } else if (s->mode == TC_MODE_MESH) {
    say(t, TC_STAGE_COHERENCE, false, "a mesh is drawn without rays");
  } else if (s->mode == TC_MODE_ISOSURFACE) {
    say(t, TC_STAGE_COHERENCE, false, "each ray skips empty space separately");
  } else if (!t->plan->key.skipping || (t->plan->key.coherence && !skipping)) {
    say(t, TC_STAGE_COHERENCE, false, "empty-space skipping is off");
  } else if (t->plan->key.coherence && t->facts && tc_plan_has(t->plan, TC_RESOURCE_BOXES) &&
             t->facts->empty_share >= 0) {
    say(t, TC_STAGE_COHERENCE, true, "all rays of a pixel share the occupied runs");
  } else {
    tc_rays_set_up(&rays, t->volume, s, t->plan->width, t->plan->height);
    say(t, TC_STAGE_COHERENCE, t->plan->key.coherence,
        t->plan->key.coherence
            ? "rays begin where their pixel's middle is clear for %.3g voxels around, blocks are %.0f wide"
            : "rays of a pixel may be %.3g voxels apart, more than the %.0f of a block",
        rays.footprint, (double)t->plan->block);
  }
}

static void say_termination(const teller *t) {
  const tc_scene *s = t->scene;
  if (t->plan->key.termination)
    say(t, TC_STAGE_TERMINATION, true, "rays end below a transparency of %.3g", s->sampling.termination);
  else if (s->sampling.termination > 0)
    say(t, TC_STAGE_TERMINATION, false, "order is back-to-front: the nearest segment comes last");
  else
    say(t, TC_STAGE_TERMINATION, false, "sampling.termination is 0");
}

/* Stages after the back end, the same in every mode. */
static void say_picture(const teller *t) {
  const tc_scene *s = t->scene;
  const tc_facts *f = t->facts;
  say(t, TC_STAGE_ALPHA, s->image.transparent,
      s->image.transparent ? "background is transparent" : "background is a colour");
  say(t, TC_STAGE_DEPTH, t->plan->depth, t->plan->depth ? "asked for with the frame" : "nothing asks for depth");
  say(t, TC_STAGE_LINEAR_LIGHT, s->image.linear_light,
      s->image.linear_light ? "colours composite in linear light" : "colours composite in display space");
  if (tc_is_projection(s->mode))
    say(t, TC_STAGE_RESOLVE, true, "window %.6g / %.6g to grey, background, 8 bits of %dx%d pixels", s->window.center,
        s->window.width, t->plan->width, t->plan->height);
  else
    say(t, TC_STAGE_RESOLVE, true, "background and 8-bit conversion of %dx%d pixels", t->plan->width, t->plan->height);
  if (f && f->deaf)
    add(t, TC_STAGE_RESOLVE,
        "; drawn by the cpu: a pixel has up to %.3g samples, and %s could not be interrupted for %.3g ms",
        f->pixel_samples, f->deaf, f->deaf_ms);
  say(t, TC_STAGE_ENCODE, true, s->image.format == TC_FORMAT_PNG ? "png, lossless" : "jpeg, quality %d",
      s->image.quality);
  say_meter(t);
}

static void say_mpr(const teller *t) {
  static const struct { tc_stage stage; const char *reason; } out[] = {
      {TC_STAGE_GRADIENT, "a slice has no shading"},
      {TC_STAGE_SKIPPING, "a slice has no empty space"},
      {TC_STAGE_RAYS, "one ray a pixel"},
      {TC_STAGE_COHERENCE, "one ray per pixel: nothing to share"},
      {TC_STAGE_JITTER, "a slice has no jitter"},
      {TC_STAGE_SPLATS, "mode is mpr"},
      {TC_STAGE_TERMINATION, "a slab counts all of its samples"},
      {TC_STAGE_LINEAR_LIGHT, "the window gives display values: nothing composites"}};
  for (size_t i = 0; i < sizeof out / sizeof *out; i++) say(t, out[i].stage, false, "%s", out[i].reason);
  say_no_tables(t, "a slice shows values through the window, not a transfer function");
}

static void say_splats(const teller *t) {
  static const struct { tc_stage stage; const char *reason; } out[] = {
      {TC_STAGE_SKIPPING, "empty voxels are not stored"},
      {TC_STAGE_RAYS, "splats cast no rays"},
      {TC_STAGE_COHERENCE, "splats cast no rays"},
      {TC_STAGE_JITTER, "splats cast no rays"},
      {TC_STAGE_TERMINATION, "splats cast no rays"}};
  const tc_scene *s = t->scene;
  const bool colors = strcmp(s->splat.attribute, "value") == 0;
  for (size_t i = 0; i < sizeof out / sizeof *out; i++) say(t, out[i].stage, false, "%s", out[i].reason);
  say_no_tables(t, (colors && !t->plan->key.labels) || !s->splat.opaque ? "the transfer function is read at voxels" : "the object has one colour");
  say(t, TC_STAGE_GRADIENT, t->plan->key.shading != 0,
      t->plan->key.shading ? "shading.model is %s: normals kept with the splats" : "shading.model is %s",
      tc_shading_names[s->shading.model]);
  char which[64] = "voxels of the visible labels";
  if (!t->plan->key.labels)
    snprintf(which, sizeof which, "voxels of %.6g to %.6g", s->splat.threshold[0], s->splat.threshold[1]);
  const tc_volume_stats *range = tc_volume_statistics(t->volume);
  if (!t->plan->key.labels && (s->splat.threshold[0] > range->max || s->splat.threshold[1] < range->min)) {
    say(t, TC_STAGE_SPLATS, false, "empty picture: no voxel is within splat.threshold, %.6g to %.6g; the volume's values are %.6g to %.6g",
        s->splat.threshold[0], s->splat.threshold[1], range->min, range->max);
    return;
  }
  say(t, TC_STAGE_SPLATS, true, "%s as runs; %s, kernel of %.3g voxels; %s", which, s->splat.opaque ? "surface as splats" : "all as splats, in sheets", s->splat.kernel_radius,
      !s->splat.opaque ? "nothing hides" : s->splat.culling ? "what is hidden is left out first" : "culling is off");
}

static void say_mode(const teller *t) {
  const char *mode = tc_mode_names[t->scene->mode];
  say(t, TC_STAGE_SPLATS, false, "mode is %s", mode);
  say_rays(t);
  say_coherence(t);
  say_skipping(t);
  say_skipped(t);
  if (tc_is_projection(t->scene->mode)) {
    char reason[96];
    snprintf(reason, sizeof reason, "mode %s reads the window, not the transfer function", mode);
    say_no_tables(t, reason);
    say(t, TC_STAGE_GRADIENT, false, "mode %s is not shaded", mode);
    say(t, TC_STAGE_TERMINATION, false, "mode %s ends rays when their grey is final", mode);
    return;
  }
  say_gradient(t);
  if (t->scene->mode == TC_MODE_MESH) {
    say_no_tables(t, "a mesh reads isosurface.value, not a transfer function");
    say(t, TC_STAGE_TERMINATION, false, "a mesh is drawn without rays");
    return;
  }
  if (t->scene->mode == TC_MODE_ISOSURFACE) {
    say_no_tables(t, "an isosurface reads its value, not a transfer function");
    say(t, TC_STAGE_TERMINATION, false, "rays end where they hit");
    return;
  }
  say_tables(t);
  say_termination(t);
}

static void say_mesh(const teller *t) {
  const bool in = tc_plan_has(t->plan, TC_RESOURCE_MESH);
  int drawn = 0, translucent = 0;
  for (size_t i = 0; i < t->scene->mesh.n_surfaces; i++) {
    const tc_mesh_surface *s = &t->scene->mesh.surfaces[i];
    drawn += tc_mesh_surface_shows(s), translucent += tc_mesh_surface_shows(s) && s->opacity < 1;
  }
  if (in && t->scene->mesh.n_surfaces)
    say(t, TC_STAGE_MESH, true, "%d of %zu surfaces as triangles in clusters, %d of them translucent: layers sorted for each pixel%s",
        drawn, t->scene->mesh.n_surfaces, translucent,
        tc_mesh_is_within(t->scene) ? "; rays are cast in parts between them" : "");
  else if (in && t->plan->key.labels)
    say(t, TC_STAGE_MESH, true, "a smooth surface of each label as triangles in clusters");
  else if (in)
    say(t, TC_STAGE_MESH, true, "the surface at %.6g as triangles in clusters",
        t->scene->isosurface.value);
  else if (t->scene->mode != TC_MODE_MESH || !say_no_surface(t, TC_STAGE_MESH))
    say(t, TC_STAGE_MESH, false, "mode %s draws no triangles", tc_mode_names[t->scene->mode]);
  if (in && t->facts && t->facts->triangles_in_full)
    add(t, TC_STAGE_MESH, "; levels of detail within %.3g pixels: %zu of %zu triangles", t->plan->mesh_pixels,
        t->facts->triangles, t->facts->triangles_in_full);
  if (in && t->facts && t->facts->nothing_in_view)
    add(t, TC_STAGE_MESH, "; all of it is outside the view or clipped: nothing is extracted, and no mesh is cut into clusters");
  if (in && t->facts && t->facts->clusters)
    add(t, TC_STAGE_MESH, "; of %zu clusters %zu outside the view, %zu facing away", t->facts->clusters, t->facts->outside,
        t->facts->facing_away);
  if (in && t->facts && t->facts->shaded && t->facts->culls_pixels)
    add(t, TC_STAGE_MESH, "; %" PRIu64 " pixels shaded; what is hidden fails OpenGL's depth test, which counts no clusters", t->facts->shaded);
  else if (in && t->facts && t->facts->shaded)
    add(t, TC_STAGE_MESH, "; %" PRIu64 " hidden (once a tile), %" PRIu64 " pixels shaded", t->facts->hidden, t->facts->shaded);
}

static void add_resources(const teller *t) {
  for (int i = 0; t->facts && i < TC_RESOURCE_COUNT; i++) {
    tc_explained_stage *stage = &t->to->stages[tc_stage_of((tc_resource)i)];
    stage->ms += t->facts->ms[i];
    stage->bytes += t->facts->bytes[i];
  }
}

void tc_plan_explain(const tc_plan *plan, const tc_volume *volume, const tc_scene *scene, const tc_facts *facts,
                     tc_explanation *to) {
  const teller t = {plan, volume, scene, facts, to};
  const tc_table_params *p = &plan->table;
  memset(to, 0, sizeof *to);
  to->key = facts ? facts->key : plan->key;
  to->width = plan->width, to->height = plan->height;
  to->step_mm = plan->step_mm;
  to->table_size = p->n, to->subtables = p->n_subtables;
  to->table_lo = p->slope * p->voxel_lo + p->intercept, to->table_hi = p->slope * p->voxel_hi + p->intercept;
  tc_plan_key_name(&plan->key, to->kernel, sizeof to->kernel);
  say_coefficients(&t);
  say_clipping(&t);
  say_labels(&t);
  say_mesh(&t);
  say_picture(&t);
  (scene->mode == TC_MODE_MPR ? say_mpr : scene->mode == TC_MODE_SPLAT ? say_splats : say_mode)(&t);
  if (facts && facts->refused)
    add(&t, scene->mode == TC_MODE_SPLAT ? TC_STAGE_SPLATS : TC_STAGE_MESH, "; drawn by the cpu: %s", facts->refused);
  add_resources(&t);
}

void tc_explain_object(const tc_volume *volume, const tc_scene *scene, const double speed[TC_OBJECT_MODES],
                       const atomic_bool *cancel, tc_explanation *to) {
  static const char *const ways[TC_OBJECT_MODES] = {"splats are", "a ray-cast isosurface is", "a mesh is"};
  const teller t = {.volume = volume, .scene = scene, .to = to};
  const tc_object_cost *c = &to->object;
  const tc_mode mode = scene->mode;
  to->has_object = tc_object_cost_of(volume, scene, to->width, to->height, cancel, &to->object);
  if (!to->has_object) return;
  if (speed) tc_object_cost_scale(&to->object, speed);
  add(&t, mode == TC_MODE_SPLAT ? TC_STAGE_SPLATS : mode == TC_MODE_MESH ? TC_STAGE_MESH : TC_STAGE_SKIPPING,
      "; %s cheapest: about %.2g ms splatted, %.2g ray-cast, %.2g as a mesh", ways[c->cheapest], c->ms[TC_OBJECT_SPLAT],
      c->ms[TC_OBJECT_ISOSURFACE], c->ms[TC_OBJECT_MESH]);
}

bool tc_explain(const tc_volume *volume, const tc_scene *scene, int width, int height, tc_explanation *explanation,
                GError **error) {
  tc_plan plan;
  if (!tc_plan_check(volume, scene, width, height, NULL, error)) return false;
  tc_plan_make(volume, scene, &(tc_plan_request){.width = width, .height = height}, &plan);
  tc_plan_explain(&plan, volume, scene, NULL, explanation);
  tc_explain_object(volume, scene, NULL, NULL, explanation);
  return true;
}
