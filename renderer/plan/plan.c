#include "renderer/plan/plan.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "renderer/classify/integrals.h"
#include "renderer/classify/labels.h"
#include "renderer/quality/meter.h"
#include "renderer/raycast/grey.h"
#include "renderer/raycast/rays.h"
#include "renderer/raycast/surface.h"
#include "renderer/skip/skip.h"

/* A ray takes at most this many samples: more is a mistake in the scene, and float positions end there. */
#define MAX_SAMPLES_PER_RAY 8e6

const char *tc_stage_name(tc_stage stage) {
  static const char *const names[TC_STAGE_COUNT] = {
      "coefficients",   "table-1d",     "table-2d", "gradient", "skipping",    "clipping",
      "rays-per-pixel", "coherence",    "jitter",   "labels",   "termination", "alpha",
      "depth-output",   "linear-light", "resolve",  "encode",   "error-meter"};
  return (unsigned)stage < TC_STAGE_COUNT ? names[stage] : "?";
}

void tc_plan_key_name(const tc_plan_key *key, char *name, size_t size) {
  bool dvr = key->mode == TC_MODE_DVR, slice = key->mode == TC_MODE_MPR;
  const char *way = !slice && !dvr ? "" : dvr ? tc_classification_names[key->classification]
                                   : key->slab ? tc_slab_projection_names[key->slab - 1] : "slice";
  snprintf(name, size, "%s%s%s%s.%s%s%s%s%s.%s", tc_mode_names[key->mode], *way ? "." : "", way,
           key->order == TC_BACK_TO_FRONT ? ".back-to-front" : "", tc_filter_names[key->filter],
           key->shading ? ".shaded" : "", key->labels ? ".labels" : "", key->rays ? ".rays" : "",
           key->jitter ? ".jitter" : "", tc_voxel_type_name((tc_voxel_type)key->voxel_type));
}

static void stage(tc_plan *plan, tc_stage which, bool included, const char *format, ...) G_GNUC_PRINTF(4, 5);
static void stage(tc_plan *plan, tc_stage which, bool included, const char *format, ...) {
  plan->stages[which].included = included;
  va_list args;
  va_start(args, format);
  vsnprintf(plan->stages[which].reason, sizeof plan->stages[which].reason, format, args);
  va_end(args);
}

/* ---- what cannot be rendered meaningfully ---- */

static bool invalid(GError **error, const char *pointer, const char *message) {
  tc_set_error(error, TC_ERROR_INVALID, pointer, "%s: %s", pointer + 1, message);
  return false;
}

static bool finite3(const double v[3]) { return isfinite(v[0]) && isfinite(v[1]) && isfinite(v[2]); }

static bool check_camera(const tc_camera *c, GError **error) {
  if (!finite3(c->position)) return invalid(error, "/camera/position", "three finite numbers wanted");
  if (!finite3(c->target)) return invalid(error, "/camera/target", "three finite numbers wanted");
  if (!finite3(c->up)) return invalid(error, "/camera/up", "three finite numbers wanted");
  double d[3], cross[3], d2 = 0, up2 = 0, cross2 = 0;
  for (int k = 0; k < 3; k++) {
    d[k] = c->target[k] - c->position[k];
    d2 += d[k] * d[k];
    up2 += c->up[k] * c->up[k];
  }
  for (int k = 0; k < 3; k++) {
    int a = (k + 1) % 3, b = (k + 2) % 3;
    cross[k] = d[a] * c->up[b] - d[b] * c->up[a];
    cross2 += cross[k] * cross[k];
  }
  if (!(d2 > 0)) return invalid(error, "/camera/target", "the target is the position: nothing to look along");
  if (!(up2 > 0)) return invalid(error, "/camera/up", "a vector that is not zero wanted");
  if (!(cross2 > 1e-18 * d2 * up2))
    return invalid(error, "/camera/up", "parallel to the view direction: choose another");
  if (c->projection == TC_PERSPECTIVE && !(c->fov_y_deg > 0 && c->fov_y_deg < 180))
    return invalid(error, "/camera/fovY", "degrees above 0 and below 180 wanted");
  if (c->projection == TC_ORTHOGRAPHIC && !(c->height_mm > 0 && isfinite(c->height_mm)))
    return invalid(error, "/camera/height", "mm above 0 wanted");
  return true;
}

/* A list that is shared with a scene that was found valid is so as well. */
static bool same_points(const tc_transfer_function *a, const tc_transfer_function *b) {
  return a->shared && a->shared == b->shared && a->points == b->points && a->count == b->count && a->kind == b->kind;
}

static bool same_colors(const tc_scene *a, const tc_scene *b) {
  return a->labels.shared_colors && a->labels.shared_colors == b->labels.shared_colors &&
         a->labels.colors == b->labels.colors && a->labels.n_colors == b->labels.n_colors;
}

static bool invalid_knot(GError **error, size_t i, const char *message) {
  char pointer[64];
  snprintf(pointer, sizeof pointer, "/transferFunction/points/%zu", i);
  return invalid(error, pointer, message);
}

static bool check_transfer_function(const tc_transfer_function *tf, const tc_scene *valid, GError **error) {
  if (tf->count < 1 || tf->count > TC_MAX_KNOTS)
    return invalid(error, "/transferFunction/points", "between 1 and 65536 knots wanted");
  if (tf->kind == TC_KNOT_OPACITY && !(tf->unit_distance_mm > 0 && isfinite(tf->unit_distance_mm)))
    return invalid(error, "/transferFunction/unitDistance", "mm above 0 wanted");
  /* Of a mode that reads no transfer function the knots were not looked at. */
  if (valid && valid->mode == TC_MODE_DVR && same_points(tf, &valid->transfer_function)) return true;
  for (size_t i = 0; i < tf->count; i++) {
    const tc_knot *k = &tf->points[i];
    if (!isfinite(k->value) || !finite3(k->color) || !isfinite(k->amount) || k->amount < 0)
      return invalid_knot(error, i, "finite value and colour, and an opacity or extinction of at least 0 wanted");
    if (tf->kind == TC_KNOT_OPACITY && k->amount > 1) return invalid_knot(error, i, "opacity from 0 to 1 wanted");
    if (i > 0 && !(k->value >= k[-1].value)) return invalid_knot(error, i, "knots in ascending order of value wanted");
  }
  return true;
}

/* What a mode does not read is not checked. */
static bool check_window(const tc_scene *scene, GError **error) {
  if (!isfinite(scene->window.center)) return invalid(error, "/window/center", "a finite number wanted");
  if (!(scene->window.width > 0) || !isfinite(scene->window.width))
    return invalid(error, "/window/width", "a finite number above 0 wanted");
  return true;
}

static bool check_look(const tc_scene *scene, const tc_scene *valid, GError **error) {
  if (tc_is_projection(scene->mode)) return check_window(scene, error);
  return check_transfer_function(&scene->transfer_function, valid, error);
}

static bool check_rays(const tc_scene *scene, GError **error) {
  if (scene->sampling.rays_per_pixel >= 1 && scene->sampling.rays_per_pixel <= TC_MAX_RAYS_PER_PIXEL) return true;
  return invalid(error, "/sampling/raysPerPixel", "1 to 64 wanted");
}

static bool check_sampling(const tc_volume *volume, const tc_scene *scene, GError **error) {
  double step = scene->sampling.step;
  if (!(step > 0) || !isfinite(step)) return invalid(error, "/sampling/step", "voxels above 0 wanted");
  if (!check_rays(scene, error)) return false;
  if (!tc_is_projection(scene->mode) && !(scene->sampling.termination >= 0 && scene->sampling.termination < 1))
    return invalid(error, "/sampling/termination", "a transparency from 0 to below 1 wanted");
  const tc_volume_desc *d = tc_volume_describe(volume);
  double least = fmin(d->spacing[0], fmin(d->spacing[1], d->spacing[2])), diagonal = 0;
  for (int k = 0; k < 3; k++) diagonal += d->dims[k] * d->spacing[k];
  if (diagonal / (step * least) > MAX_SAMPLES_PER_RAY) {
    tc_set_error(error, TC_ERROR_LIMIT, "/sampling/step",
                 "sampling/step: %g voxels of %g mm make over %.0f samples a ray: choose a larger step", step, least,
                 MAX_SAMPLES_PER_RAY);
    return false;
  }
  return true;
}

static bool check_clipping(const tc_scene *scene, GError **error) {
  for (int k = 0; k < 3 && scene->clip.has_box; k++)
    if (!isfinite(scene->clip.box[0][k]) || !isfinite(scene->clip.box[1][k]) ||
        scene->clip.box[0][k] > scene->clip.box[1][k])
      return invalid(error, "/clip/box", "two corners wanted, finite, the lower one first");
  for (int i = 0; i < scene->clip.n_planes; i++) {
    const double *p = scene->clip.planes[i];
    double n2 = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
    char pointer[32];
    snprintf(pointer, sizeof pointer, "/clip/planes/%d", i);
    if (!(n2 > 0) || !isfinite(n2) || !isfinite(p[3]))
      return invalid(error, pointer, "a normal that is not zero, and d, all finite");
  }
  return true;
}

static bool check_shading(const tc_scene *scene, GError **error) {
  if (tc_is_projection(scene->mode) || scene->shading.model == TC_SHADING_NONE) return true;
  if ((unsigned)scene->shading.model >= TC_SHADING_COUNT) return invalid(error, "/shading/model", "unknown");
  if ((unsigned)scene->shading.gradient >= TC_GRADIENT_COUNT) return invalid(error, "/shading/gradient", "unknown");
  const struct { const char *pointer; double value; } shares[] = {{"/shading/ambient", scene->shading.ambient},
                                                                  {"/shading/diffuse", scene->shading.diffuse},
                                                                  {"/shading/specular", scene->shading.specular}};
  for (int i = 0; i < 3; i++)
    if (!(shares[i].value >= 0 && shares[i].value <= 1))
      return invalid(error, shares[i].pointer, "a share from 0 to 1 wanted");
  if (!(scene->shading.shininess >= 0 && scene->shading.shininess <= 1024))
    return invalid(error, "/shading/shininess", "0 to 1024 wanted");
  const double *l = scene->shading.light;
  if (!scene->shading.light_at_camera && (!finite3(l) || !(l[0] != 0 || l[1] != 0 || l[2] != 0)))
    return invalid(error, "/shading/light", "a direction wanted: three finite numbers that are not all zero");
  return true;
}

/* The label volume itself is tc_labels_check()'s. */
static bool check_labels(const tc_scene *scene, const tc_scene *valid, GError **error) {
  if (!scene->labels.volume[0] || !tc_mode_has_labels(scene->mode)) return true;
  if (!(scene->labels.opacity >= 0 && scene->labels.opacity <= 1))
    return invalid(error, "/labels/opacity", "a share from 0 to 1 wanted");
  if (valid && valid->labels.volume[0] && tc_mode_has_labels(valid->mode) && same_colors(scene, valid)) return true;
  for (size_t i = 0; i < scene->labels.n_colors; i++) {
    const tc_label_color *color = &scene->labels.colors[i];
    for (int c = 0; c < 4; c++)
      if (!(color->rgba[c] >= 0 && color->rgba[c] <= 1))
        return invalid(error, "/labels/colors", "numbers from 0 to 1 wanted");
    if (i > 0 && color->label <= color[-1].label)
      return invalid(error, "/labels/colors", "labels in ascending order wanted");
  }
  return true;
}

static bool check_image(int width, int height, GError **error) {
  if (width < 1 || height < 1)
    return invalid(error, width < 1 ? "/image/width" : "/image/height", "at least 1 pixel wanted");
  if (width > TC_MAX_IMAGE_SIDE || height > TC_MAX_IMAGE_SIDE || (int64_t)width * height > TC_MAX_IMAGE_AREA) {
    tc_set_error(error, TC_ERROR_LIMIT, width > TC_MAX_IMAGE_SIDE ? "/image/width" : "/image/height",
                 "image: %dx%d is over the limit of %d a side and %d pixels", width, height, TC_MAX_IMAGE_SIDE,
                 TC_MAX_IMAGE_AREA);
    return false;
  }
  return true;
}

static bool check_oblique(const double n[3], const double up[3], GError **error) {
  double n2 = 0, up2 = 0, cross2 = 0;
  for (int k = 0; k < 3; k++) {
    int a = (k + 1) % 3, b = (k + 2) % 3;
    double cross = n[a] * up[b] - n[b] * up[a];
    n2 += n[k] * n[k], up2 += up[k] * up[k], cross2 += cross * cross;
  }
  if (!(n2 > 0) || !isfinite(n2)) return invalid(error, "/mpr/normal", "a vector that is not zero wanted");
  if (!(up2 > 0) || !isfinite(up2)) return invalid(error, "/mpr/up", "a vector that is not zero wanted");
  if (!(cross2 > 1e-18 * n2 * up2)) return invalid(error, "/mpr/up", "parallel to mpr.normal: choose another");
  return true;
}

static bool check_mpr(const tc_volume *volume, const tc_scene *scene, GError **error) {
  if ((unsigned)scene->mpr.orientation >= TC_MPR_ORIENTATION_COUNT)
    return invalid(error, "/mpr/orientation", "unknown");
  if ((unsigned)scene->mpr.projection >= TC_SLAB_PROJECTION_COUNT) return invalid(error, "/mpr/projection", "unknown");
  if (scene->mpr.has_center && !finite3(scene->mpr.center))
    return invalid(error, "/mpr/center", "three finite numbers wanted");
  if (scene->mpr.orientation == TC_OBLIQUE && !check_oblique(scene->mpr.normal, scene->mpr.up, error)) return false;
  double thickness = scene->mpr.thickness_mm, zoom = scene->mpr.zoom, step = scene->sampling.step;
  if (!(thickness >= 0) || !isfinite(thickness)) return invalid(error, "/mpr/thickness", "mm of at least 0 wanted");
  if (!(zoom > 0) || !isfinite(zoom)) return invalid(error, "/mpr/zoom", "a factor above 0 wanted");
  if (!(step > 0) || !isfinite(step)) return invalid(error, "/sampling/step", "voxels above 0 wanted");
  const double *spacing = tc_volume_describe(volume)->spacing;
  if (thickness / (step * fmin(spacing[0], fmin(spacing[1], spacing[2]))) > MAX_SAMPLES_PER_RAY) {
    tc_set_error(error, TC_ERROR_LIMIT, "/mpr/thickness",
                 "mpr/thickness: %g mm make over %.0f samples a pixel: choose a thinner slab or a larger sampling.step",
                 thickness, MAX_SAMPLES_PER_RAY);
    return false;
  }
  return true;
}

/* ---- what is not built: refused, so that no picture is ever quietly another one ---- */

static bool unsupported(GError **error, const char *pointer, const char *what) {
  tc_set_error(error, TC_ERROR_UNSUPPORTED, pointer, "%s: %s is not available in this version", pointer + 1, what);
  return false;
}

static bool check_built(const tc_scene *s, GError **error) {
  if ((unsigned)s->mode >= TC_MODE_COUNT) return invalid(error, "/mode", "unknown");
  bool projection = tc_is_projection(s->mode), slice = s->mode == TC_MODE_MPR, surface = s->mode == TC_MODE_ISOSURFACE;
  if (s->mode != TC_MODE_DVR && !projection && !slice && !surface)
    return unsupported(error, "/mode", tc_mode_names[s->mode]);
  if (s->mode == TC_MODE_DVR && (unsigned)s->classification >= TC_CLASSIFICATION_COUNT)
    return invalid(error, "/classification", "unknown");
  if (s->mode == TC_MODE_DVR && (unsigned)s->order >= TC_ORDER_COUNT) return invalid(error, "/order", "unknown");
  if ((unsigned)s->filter >= TC_FILTER_COUNT) return invalid(error, "/filter", "unknown");
  if (surface && s->filter != TC_FILTER_LINEAR)
    return unsupported(error, "/filter", "any filter of isosurfaces but linear");
  if (slice && s->sampling.rays_per_pixel != 1)
    return unsupported(error, "/sampling/raysPerPixel", "more than one ray for a pixel of a slice");
  return true;
}

/* The stages that a projection has in another way than dvr: everything about transfer functions is out. */
static void plan_projection_stages(tc_plan *plan, const tc_scene *s) {
  const char *mode = tc_mode_names[s->mode];
  stage(plan, TC_STAGE_TABLE_1D, false, "mode %s reads the window, not the transfer function", mode);
  stage(plan, TC_STAGE_TABLE_2D, false, "mode %s reads the window, not the transfer function", mode);
  stage(plan, TC_STAGE_GRADIENT, false, "mode %s is not shaded", mode);
  stage(plan, TC_STAGE_SKIPPING, plan->key.skipping,
        s->skipping.mode == TC_SKIPPING_OFF ? "skipping.mode is off"
        : s->mode == TC_MODE_AVERAGE        ? "mode average counts every sample"
        : s->mode == TC_MODE_MIP            ? "blocks whose maximum cannot raise a ray's are left out"
                                            : "blocks whose minimum cannot lower a ray's are left out");
  stage(plan, TC_STAGE_TERMINATION, false, "mode %s ends rays where no other grey can follow", mode);
  stage(plan, TC_STAGE_RESOLVE, true, "window %.6g / %.6g to grey, background, 8 bits of %dx%d pixels",
        s->window.center, s->window.width, plan->width, plan->height);
}

/* What is sampled, and by which filter. */
static void plan_field(tc_plan *plan, const tc_volume *volume, const tc_scene *s) {
  bool cubic = s->filter == TC_FILTER_CUBIC, prefilter = cubic && s->sampling.prefilter;
  plan->key.filter = (uint8_t)s->filter;
  plan->key.voxel_type = (uint8_t)(prefilter ? TC_F32 : tc_volume_describe(volume)->type);
  stage(plan, TC_STAGE_COEFFICIENTS, prefilter,
        prefilter ? "sampling.prefilter: the cubic filter passes through the voxels"
        : cubic   ? "sampling.prefilter is off: the cubic filter smooths"
                  : "filter is %s", tc_filter_names[s->filter]);
}

static void plan_clipping(tc_plan *plan, const tc_scene *s) {
  if (plan->key.clipping)
    stage(plan, TC_STAGE_CLIPPING, true, "%s%d clip planes; each ray is cut once, before its first sample",
          s->clip.has_box ? "a clip box and " : "", s->clip.n_planes);
  else
    stage(plan, TC_STAGE_CLIPPING, false, "no clip box or plane");
}

static void plan_meter(tc_plan *plan, const tc_scene *s) {
  char reason[96];
  if (!s->error_meter.pixels)
    stage(plan, TC_STAGE_ERROR_METER, false, "errorMeter is off");
  else if (tc_meter_refuses(s, reason, sizeof reason))
    stage(plan, TC_STAGE_ERROR_METER, false, "%s", reason);
  else
    stage(plan, TC_STAGE_ERROR_METER, true, "%d pixels of each final frame against the reference, beside the rendering",
          s->error_meter.pixels);
}

static void plan_labels(tc_plan *plan, const tc_scene *s) {
  char shown[48] = "all show";
  if (s->labels.visible) snprintf(shown, sizeof shown, "%zu show", s->labels.n_visible);
  if (plan->key.labels)
    stage(plan, TC_STAGE_LABELS, true, "labels of volume %.40s: %s, tint %.3g", s->labels.volume, shown,
          s->labels.opacity);
  else if (s->labels.volume[0])
    stage(plan, TC_STAGE_LABELS, false, "mode %s shows values: labels colour dvr and mpr only", tc_mode_names[s->mode]);
  else
    stage(plan, TC_STAGE_LABELS, false, "no label volume");
}

static void plan_rays(tc_plan *plan, const tc_scene *s) {
  int count = s->sampling.rays_per_pixel;
  bool dvr = s->mode == TC_MODE_DVR;
  if (count == 1)
    stage(plan, TC_STAGE_RAYS, false, "one ray a pixel");
  else if (dvr)
    stage(plan, TC_STAGE_RAYS, true, "%d rays a pixel share its samples: segments of %.4g mm", count, plan->step_mm);
  else if (s->mode == TC_MODE_ISOSURFACE)
    stage(plan, TC_STAGE_RAYS, true, "%d rays a pixel, each with a hit of its own: the mean smooths edges", count);
  else
    stage(plan, TC_STAGE_RAYS, true, "%d rays a pixel, each with all samples: mode %s sees nothing between them", count,
          tc_mode_names[s->mode]);
  stage(plan, TC_STAGE_JITTER, plan->key.jitter,
        !s->sampling.jitter ? "sampling.jitter is off"
        : dvr               ? "the first segment's length follows interleaved gradient noise over the pixels"
                            : "mode %s has no segments to shift",
        tc_mode_names[s->mode]);
}

/* Rays can start where another ray was when all that lies between the two is known to be empty as well. */
static void plan_coherence(tc_plan *plan, const tc_volume *volume, const tc_scene *s) {
  tc_rays rays;
  double block = tc_skip_block(s->skipping.block);
  if (!s->sampling.coherence) {
    stage(plan, TC_STAGE_COHERENCE, false, "sampling.coherence is off");
  } else if (s->sampling.rays_per_pixel == 1) {
    stage(plan, TC_STAGE_COHERENCE, false, "one ray a pixel: there is none to share with");
  } else if (tc_is_projection(s->mode)) {
    stage(plan, TC_STAGE_COHERENCE, false, "mode %s has no empty space", tc_mode_names[s->mode]);
  } else if (s->mode == TC_MODE_ISOSURFACE) {
    stage(plan, TC_STAGE_COHERENCE, false, "each ray leaps from cells of its own");
  } else if (!plan->key.skipping) {
    stage(plan, TC_STAGE_COHERENCE, false, "nothing is known to be empty: stage skipping is out");
  } else {
    tc_rays_set_up(&rays, volume, s, plan->width, plan->height);
    plan->key.coherence = rays.footprint < block;
    stage(plan, TC_STAGE_COHERENCE, plan->key.coherence,
          plan->key.coherence
              ? "rays begin where their pixel's middle is clear for %.3g voxels around, blocks are %.0f wide"
              : "rays of a pixel may be %.3g voxels apart, more than the %.0f of a block",
          rays.footprint, block);
  }
}

void tc_plan_drop_skipping(tc_plan *plan, const char *reason) {
  plan->key.skipping = 0;
  stage(plan, TC_STAGE_SKIPPING, false, "%s", reason);
  if (!plan->key.coherence) return;
  plan->key.coherence = 0;
  stage(plan, TC_STAGE_COHERENCE, false, "nothing is known to be empty: stage skipping is out");
}

static void plan_tables(tc_plan *plan, const tc_scene *s) {
  const char *name = tc_classification_names[s->classification];
  bool integrals = tc_integrals_serve(s->classification);
  if (integrals) {
    stage(plan, TC_STAGE_TABLE_1D, true, "classification is %s: %s at %d values, for segments of any length", name,
          s->classification == TC_POST ? "extinction and colour" : "integrals of extinction and colour",
          plan->table_size);
    stage(plan, TC_STAGE_TABLE_2D, false, "classification is %s: no segment is looked up as a whole", name);
  } else {
    stage(plan, TC_STAGE_TABLE_1D, false, "classification is %s: segments are integrated beforehand", name);
    char zooms[48] = "";
    if (plan->table_zooms)
      snprintf(zooms, sizeof zooms, ", %d zoom%s for close knots", plan->table_zooms, plan->table_zooms > 1 ? "s" : "");
    stage(plan, TC_STAGE_TABLE_2D, true, "classification is %s: %d values a side%s%s, segments of %.4g mm", name,
          plan->table_size, zooms, plan->key.stiff ? ", depths" : "", plan->step_mm);
  }
}

static void plan_termination(tc_plan *plan, const tc_scene *s) {
  if (plan->key.termination)
    stage(plan, TC_STAGE_TERMINATION, true, "rays end under a transparency of %.3g", s->sampling.termination);
  else if (s->sampling.termination > 0)
    stage(plan, TC_STAGE_TERMINATION, false, "order is back-to-front: what is in front comes last");
  else
    stage(plan, TC_STAGE_TERMINATION, false, "sampling.termination is 0");
}

/* Where gradients come from. */
static void plan_gradient(tc_plan *plan, const tc_scene *s) {
  static const char *const ways[2][TC_GRADIENT_COUNT] = {
      {"gradients from the corners that interpolation fetches", "central differences, once a visible segment",
       "the cubic b-spline's derivative, once a visible segment"},
      {"from eight samples around the hit, once a ray", "central differences at the hit, once a ray",
       "the cubic b-spline's derivative at the hit, once a ray"}};
  const char *model = tc_shading_names[s->shading.model];
  if (plan->key.shading) {
    bool own = s->filter == TC_FILTER_CUBIC;
    plan->key.gradient = (uint8_t)(own ? TC_GRADIENT_CUBIC : s->shading.gradient);
    stage(plan, TC_STAGE_GRADIENT, true, "shading.model is %s: %s%s", model,
          ways[s->mode == TC_MODE_ISOSURFACE][plan->key.gradient], own ? " (the filter's own)" : "");
  } else {
    stage(plan, TC_STAGE_GRADIENT, false, "shading.model is %s", model);
  }
}

static void plan_stages(tc_plan *plan, const tc_scene *s) {
  plan_tables(plan, s);
  plan_gradient(plan, s);
  stage(plan, TC_STAGE_SKIPPING, plan->key.skipping,
        s->skipping.mode == TC_SKIPPING_OFF ? "skipping.mode is off"
        : plan->key.skipping                ? "the transfer function is zero over part of the range"
                                            : "the transfer function is nowhere zero in the volume's range");
  plan_clipping(plan, s);
  plan_rays(plan, s);
  plan_labels(plan, s);
  plan_termination(plan, s);
  stage(plan, TC_STAGE_ALPHA, s->image.transparent,
        s->image.transparent ? "background is transparent" : "background is a colour");
  stage(plan, TC_STAGE_DEPTH, false, "nothing asks for depth");
  stage(plan, TC_STAGE_LINEAR_LIGHT, s->image.linear_light,
        s->image.linear_light ? "colours composite in linear light" : "colours composite in display space");
  stage(plan, TC_STAGE_RESOLVE, true, "background and 8-bit conversion of %dx%d pixels", plan->width, plan->height);
  stage(plan, TC_STAGE_ENCODE, true, s->image.format == TC_FORMAT_PNG ? "png, lossless" : "jpeg, quality %d",
        s->image.quality);
  plan_meter(plan, s);
  if (tc_is_projection(s->mode)) plan_projection_stages(plan, s);
}

void tc_plan_table(tc_plan *plan, const tc_volume *field, const tc_scene *scene, int nodes) {
  const tc_volume_desc *d = tc_volume_describe(field);
  tc_table_params p = {.tf = &scene->transfer_function, .slope = d->slope, .intercept = d->intercept,
                       .linear_light = scene->image.linear_light};
  if (tc_integrals_serve(scene->classification)) {
    tc_integrals_choose(field, &p); /* they serve every length: step_mm stays 0 */
  } else {
    tc_table_choose(field, &p, NULL);
    p.step_mm = plan->step_mm;
  }
  if (nodes) p.n = nodes, p.n_zooms = 0;
  p.tf = NULL;
  plan->table = p;
  plan->table_size = p.n;
  plan->table_zooms = p.n_zooms;
  plan->key.zoomed = p.n_zooms > 0;
  plan->table_lo = p.slope * p.voxel_lo + p.intercept;
  plan->table_hi = p.slope * p.voxel_hi + p.intercept;
}

static void plan_compositing(tc_plan *plan, const tc_volume *volume, const tc_scene *scene) {
  const tc_volume_stats *range = tc_volume_statistics(volume);
  plan->key.classification = (uint8_t)scene->classification;
  plan->key.order = (uint8_t)scene->order;
  plan->key.shading = (uint8_t)scene->shading.model;
  plan->key.termination = scene->sampling.termination > 0 && scene->order == TC_FRONT_TO_BACK;
  plan->key.skipping = scene->skipping.mode == TC_SKIPPING_AUTO &&
                       tc_skip_possible(&scene->transfer_function, range->min, range->max);
  plan->key.stiff = !tc_integrals_serve(scene->classification) &&
                    tc_extinction_most(&scene->transfer_function) * plan->step_mm > TC_STIFF_DEPTH;
  tc_plan_table(plan, volume, scene, 0);
}

static void plan_slice_stages(tc_plan *plan, const tc_scene *s) {
  static const struct { tc_stage stage; const char *reason; } out[] = {
      {TC_STAGE_TABLE_1D, "a slice shows values through the window, not a transfer function"},
      {TC_STAGE_TABLE_2D, "a slice shows values through the window, not a transfer function"},
      {TC_STAGE_GRADIENT, "a slice has no shading"},
      {TC_STAGE_SKIPPING, "a slice shows every voxel it meets"},
      {TC_STAGE_RAYS, "one ray a pixel"},
      {TC_STAGE_COHERENCE, "one ray a pixel: there is none to share with"},
      {TC_STAGE_JITTER, "a slice has no jitter"},
      {TC_STAGE_TERMINATION, "a slab counts all of its samples"},
      {TC_STAGE_DEPTH, "nothing asks for depth"},
      {TC_STAGE_LINEAR_LIGHT, "the window gives display values: nothing composites"}};
  for (size_t i = 0; i < sizeof out / sizeof *out; i++) stage(plan, out[i].stage, false, "%s", out[i].reason);
  plan_clipping(plan, s);
  plan_meter(plan, s);
  plan_labels(plan, s);
  stage(plan, TC_STAGE_ALPHA, s->image.transparent,
        s->image.transparent ? "background is transparent" : "background is a colour");
  stage(plan, TC_STAGE_RESOLVE, true, "background and 8-bit conversion of %dx%d pixels", plan->width, plan->height);
  stage(plan, TC_STAGE_ENCODE, true, s->image.format == TC_FORMAT_PNG ? "png, lossless" : "jpeg, quality %d",
        s->image.quality);
}

static bool check_surface(const tc_scene *s, GError **error) {
  if (!isfinite(s->isosurface.value)) return invalid(error, "/isosurface/value", "a finite number wanted");
  for (int c = 0; c < 3; c++)
    if (!(s->isosurface.color[c] >= 0 && s->isosurface.color[c] <= 1))
      return invalid(error, "/isosurface/color", "three numbers from 0 to 1 wanted");
  return true;
}

static void plan_surface_stages(tc_plan *plan, const tc_volume *volume, const tc_scene *s) {
  static const struct { tc_stage stage; const char *reason; } out[] = {
      {TC_STAGE_TABLE_1D, "an isosurface reads its value, not a transfer function"},
      {TC_STAGE_TABLE_2D, "an isosurface reads its value, not a transfer function"},
      {TC_STAGE_TERMINATION, "rays end where they hit"}};
  for (size_t i = 0; i < sizeof out / sizeof *out; i++) stage(plan, out[i].stage, false, "%s", out[i].reason);
  const tc_volume_stats *range = tc_volume_statistics(volume);
  if (!tc_surface_exists(volume, s))
    stage(plan, TC_STAGE_GRADIENT, false,
          "empty picture: isosurface.value %.6g is not between the volume's %.6g and %.6g", s->isosurface.value,
          range->min, range->max);
  stage(plan, TC_STAGE_SKIPPING, plan->key.skipping,
        plan->key.skipping ? "blocks whose values are all on one side of %.6g are left out" : "skipping.mode is off",
        s->isosurface.value);
}

static void plan_surface(const tc_volume *volume, const tc_scene *scene, tc_plan *plan) {
  plan->key.shading = tc_surface_exists(volume, scene) ? (uint8_t)scene->shading.model : TC_SHADING_NONE;
  plan->key.skipping = scene->skipping.mode == TC_SKIPPING_AUTO;
  plan_stages(plan, scene);
  plan_surface_stages(plan, volume, scene);
  tc_plan_key_name(&plan->key, plan->kernel, sizeof plan->kernel);
}

static void plan_slice(const tc_volume *volume, const tc_scene *scene, int width, int height, tc_plan *plan) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  plan->key.mode = TC_MODE_MPR;
  plan->key.projection = TC_ORTHOGRAPHIC;
  plan->key.clipping = scene->clip.has_box || scene->clip.n_planes > 0;
  plan->key.labels = scene->labels.volume[0] != 0;
  if (scene->mpr.thickness_mm > 0) plan->key.slab = (uint8_t)(1 + scene->mpr.projection);
  plan->width = width;
  plan->height = height;
  plan->step_mm = scene->sampling.step * fmin(d->spacing[0], fmin(d->spacing[1], d->spacing[2]));
  plan_field(plan, volume, scene);
  plan_slice_stages(plan, scene);
  tc_plan_key_name(&plan->key, plan->kernel, sizeof plan->kernel);
}

bool tc_plan_check(const tc_volume *volume, const tc_scene *scene, int width, int height, const tc_scene *valid,
                   GError **error) {
  if (!check_built(scene, error) || !check_image(width, height, error) || !check_labels(scene, valid, error))
    return false;
  if (scene->mode == TC_MODE_MPR)
    return check_mpr(volume, scene, error) && check_window(scene, error) && check_clipping(scene, error);
  if (!check_camera(&scene->camera, error)) return false;
  if (scene->mode == TC_MODE_ISOSURFACE)
    return check_surface(scene, error) && check_rays(scene, error) && check_clipping(scene, error) &&
           check_shading(scene, error);
  return check_look(scene, valid, error) && check_sampling(volume, scene, error) && check_clipping(scene, error) &&
         check_shading(scene, error);
}

bool tc_plan_make(const tc_volume *volume, const tc_scene *scene, int width, int height, tc_plan *plan,
                  GError **error) {
  memset(plan, 0, sizeof *plan);
  if (!tc_plan_check(volume, scene, width, height, NULL, error)) return false;
  if (scene->mode == TC_MODE_MPR) {
    plan_slice(volume, scene, width, height, plan);
    return true;
  }
  bool surface = scene->mode == TC_MODE_ISOSURFACE;
  plan->key = (tc_plan_key){.mode = (uint8_t)scene->mode,
                            .projection = (uint8_t)scene->camera.projection,
                            .rays = scene->sampling.rays_per_pixel > 1,
                            .jitter = scene->sampling.jitter && scene->mode == TC_MODE_DVR,
                            .clipping = scene->clip.has_box || scene->clip.n_planes > 0,
                            .labels = scene->labels.volume[0] && tc_mode_has_labels(scene->mode)};
  plan->width = width;
  plan->height = height;
  plan->step_mm = tc_rays_step_mm(volume, scene);
  if (scene->mode == TC_MODE_DVR)
    plan_compositing(plan, volume, scene);
  else if (!surface)
    plan->key.skipping = scene->skipping.mode == TC_SKIPPING_AUTO && scene->mode != TC_MODE_AVERAGE;
  plan_field(plan, volume, scene);
  plan_coherence(plan, volume, scene);
  if (surface) {
    plan_surface(volume, scene, plan);
    return true;
  }
  plan_stages(plan, scene);
  tc_plan_key_name(&plan->key, plan->kernel, sizeof plan->kernel);
  return true;
}
