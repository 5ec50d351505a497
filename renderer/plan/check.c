/* The one validator of scenes. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "renderer/base/vector.h"
#include "renderer/classify/labels.h"
#include "renderer/mesh/surfaces.h"
#include "renderer/plan/plan.h"
#include "renderer/raycast/projection.h"
#include "renderer/scene/scene_check.h"
#include "renderer/splat/vmd.h"

/* Limit on the samples of a ray: more is a mistake in the scene, and exceeds the precision of float positions. */
#define MAX_SAMPLES_PER_RAY 8e6

/* ---- invalid values ---- */

static bool invalid(GError **error, const char *pointer, const char *message) {
  tc_set_error(error, TC_ERROR_INVALID, pointer, "%s: %s", pointer + 1, message);
  return false;
}

static bool check_camera(const tc_camera *camera, GError **error) {
  const char *pointer, *fault = tc_camera_fault(camera, &pointer);
  return !fault || invalid(error, pointer, fault);
}

/* A list shared with a valid scene (by reference, so unchanged) needs no check. */
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
    return invalid(error, "/transferFunction/points", "between 1 and 65536 knots expected");
  if (tf->kind == TC_KNOT_OPACITY && !(tf->unit_distance_mm > 0 && isfinite(tf->unit_distance_mm)))
    return invalid(error, "/transferFunction/unitDistance", "mm above 0 expected");
  /* In other modes the valid scene's knots were not checked. */
  if (valid && valid->mode == TC_MODE_DVR && same_points(tf, &valid->transfer_function)) return true;
  for (size_t i = 0; i < tf->count; i++) {
    const tc_knot *k = &tf->points[i];
    if (!isfinite(k->value) || !finite3(k->color) || !isfinite(k->amount) || k->amount < 0)
      return invalid_knot(error, i, "finite value and colour, and an opacity or extinction of at least 0 expected");
    if (tf->kind == TC_KNOT_OPACITY && k->amount > 1) return invalid_knot(error, i, "opacity from 0 to 1 expected");
    if (i > 0 && !(k->value >= k[-1].value)) return invalid_knot(error, i, "knots in ascending order of value expected");
  }
  return true;
}

/* Checks the window in the modes that read it. */
static bool check_window(const tc_scene *scene, GError **error) {
  if (!isfinite(scene->window.center)) return invalid(error, "/window/center", "a finite number expected");
  if (!(scene->window.width > 0) || !isfinite(scene->window.width))
    return invalid(error, "/window/width", "a finite number above 0 expected");
  return true;
}

static bool check_look(const tc_scene *scene, const tc_scene *valid, GError **error) {
  if (tc_is_projection(scene->mode)) return check_window(scene, error);
  return check_transfer_function(&scene->transfer_function, valid, error);
}

static bool check_rays(const tc_scene *scene, GError **error) {
  if (scene->sampling.rays_per_pixel >= 1 && scene->sampling.rays_per_pixel <= TC_MAX_RAYS_PER_PIXEL) return true;
  return invalid(error, "/sampling/raysPerPixel", "1 to 64 expected");
}

static bool check_sampling(const tc_volume *volume, const tc_scene *scene, GError **error) {
  double step = scene->sampling.step;
  if (!(step > 0) || !isfinite(step)) return invalid(error, "/sampling/step", "voxels above 0 expected");
  if (!check_rays(scene, error)) return false;
  if (!tc_is_projection(scene->mode) && !(scene->sampling.termination >= 0 && scene->sampling.termination < 1))
    return invalid(error, "/sampling/termination", "a transparency from 0 to below 1 expected");
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
      return invalid(error, "/clip/box", "two corners expected, finite, the lower one first");
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

static bool check_lights(const tc_scene *s, GError **error) {
  for (int i = 0; i < s->mesh.n_lights; i++) {
    const tc_mesh_light *l = &s->mesh.lights[i];
    const double *d = l->direction;
    bool good = (l->at_camera || (finite3(d) && (d[0] != 0 || d[1] != 0 || d[2] != 0))) && l->intensity >= 0 && l->intensity <= 16;
    for (int c = 0; c < 3; c++) good = good && l->color[c] >= 0 && l->color[c] <= 1;
    if (!good) return invalid(error, "/mesh/lights", "directions that are not zero, colors from 0 to 1 and intensities from 0 to 16 expected");
  }
  return true;
}

static bool check_shading(const tc_scene *scene, GError **error) {
  if ((tc_is_projection(scene->mode) && !tc_mesh_is_within(scene)) || scene->shading.model == TC_SHADING_NONE) return true;
  if ((unsigned)scene->shading.model >= TC_SHADING_COUNT) return invalid(error, "/shading/model", "unknown");
  if ((unsigned)scene->shading.gradient >= TC_GRADIENT_COUNT) return invalid(error, "/shading/gradient", "unknown");
  const struct { const char *pointer; double value; } shares[] = {{"/shading/ambient", scene->shading.ambient},
                                                                  {"/shading/diffuse", scene->shading.diffuse},
                                                                  {"/shading/specular", scene->shading.specular}};
  for (int i = 0; i < 3; i++)
    if (!(shares[i].value >= 0 && shares[i].value <= 1))
      return invalid(error, shares[i].pointer, "a share from 0 to 1 expected");
  if (!(scene->shading.shininess >= 0 && scene->shading.shininess <= 1024))
    return invalid(error, "/shading/shininess", "0 to 1024 expected");
  const double *l = scene->shading.light;
  if (!scene->shading.light_at_camera && (!finite3(l) || !(l[0] != 0 || l[1] != 0 || l[2] != 0)))
    return invalid(error, "/shading/light", "a direction expected: three finite numbers that are not all zero");
  return true;
}

/* tc_labels_check() checks the label volume itself. */
static bool check_labels(const tc_scene *scene, const tc_scene *valid, GError **error) {
  if (!scene->labels.volume[0] || !tc_mode_has_labels(scene->mode)) return true;
  if (!(scene->labels.opacity >= 0 && scene->labels.opacity <= 1))
    return invalid(error, "/labels/opacity", "a share from 0 to 1 expected");
  if (valid && valid->labels.volume[0] && tc_mode_has_labels(valid->mode) && same_colors(scene, valid)) return true;
  for (size_t i = 0; i < scene->labels.n_colors; i++) {
    const tc_label_color *color = &scene->labels.colors[i];
    for (int c = 0; c < 4; c++)
      if (!(color->rgba[c] >= 0 && color->rgba[c] <= 1))
        return invalid(error, "/labels/colors", "numbers from 0 to 1 expected");
    if (i > 0 && color->label <= color[-1].label)
      return invalid(error, "/labels/colors", "labels in ascending order expected");
  }
  return true;
}

static bool check_image(int width, int height, GError **error) {
  if (width < 1 || height < 1)
    return invalid(error, width < 1 ? "/image/width" : "/image/height", "at least 1 pixel expected");
  if (!tc_image_fits(width, height)) {
    tc_set_error(error, TC_ERROR_LIMIT, width > TC_MAX_IMAGE_SIDE ? "/image/width" : "/image/height",
                 "image: %dx%d is over the limit of %d a side and %d pixels", width, height, TC_MAX_IMAGE_SIDE,
                 TC_MAX_IMAGE_AREA);
    return false;
  }
  return true;
}

static bool check_center(const tc_scene *scene, GError **error) {
  return !scene->mpr.has_center || finite3(scene->mpr.center) ||
         invalid(error, "/mpr/center", "three finite numbers expected");
}

static bool check_plane(const tc_scene *scene, GError **error) {
  const char *pointer, *fault = tc_slice_fault(scene, &pointer);
  return !fault || invalid(error, pointer, fault);
}

static bool check_mpr(const tc_volume *volume, const tc_scene *scene, GError **error) {
  if ((unsigned)scene->mpr.orientation >= TC_MPR_ORIENTATION_COUNT)
    return invalid(error, "/mpr/orientation", "unknown");
  if ((unsigned)scene->mpr.projection >= TC_SLAB_PROJECTION_COUNT) return invalid(error, "/mpr/projection", "unknown");
  if (!check_center(scene, error)) return false;
  if (!check_plane(scene, error)) return false;
  double thickness = scene->mpr.thickness_mm, zoom = scene->mpr.zoom, step = scene->sampling.step;
  if (!(thickness >= 0) || !isfinite(thickness)) return invalid(error, "/mpr/thickness", "mm of at least 0 expected");
  if (!(zoom > 0) || !isfinite(zoom)) return invalid(error, "/mpr/zoom", "a factor above 0 expected");
  if (!(step > 0) || !isfinite(step)) return invalid(error, "/sampling/step", "voxels above 0 expected");
  const double *spacing = tc_volume_describe(volume)->spacing;
  if (thickness / (step * fmin(spacing[0], fmin(spacing[1], spacing[2]))) > MAX_SAMPLES_PER_RAY) {
    tc_set_error(error, TC_ERROR_LIMIT, "/mpr/thickness",
                 "mpr/thickness: %g mm make over %.0f samples a pixel: choose a thinner slab or a larger sampling.step",
                 thickness, MAX_SAMPLES_PER_RAY);
    return false;
  }
  return true;
}

/* ---- unsupported combinations: refused, because silently drawing another picture would mislead ---- */

static bool unsupported(GError **error, const char *pointer, const char *what) {
  tc_set_error(error, TC_ERROR_UNSUPPORTED, pointer, "%s: %s is not available in this version", pointer + 1, what);
  return false;
}

static bool check_built(const tc_scene *s, GError **error) {
  if ((unsigned)s->mode >= TC_MODE_COUNT) return invalid(error, "/mode", "unknown");
  bool slice = s->mode == TC_MODE_MPR, surface = tc_is_surface(s->mode);
  if (s->mode == TC_MODE_DVR && (unsigned)s->classification >= TC_CLASSIFICATION_COUNT)
    return invalid(error, "/classification", "unknown");
  if (s->mode == TC_MODE_DVR && (unsigned)s->order >= TC_ORDER_COUNT) return invalid(error, "/order", "unknown");
  if ((unsigned)s->filter >= TC_FILTER_COUNT) return invalid(error, "/filter", "unknown");
  if (surface && s->filter != TC_FILTER_LINEAR)
    return unsupported(error, "/filter", "a filter other than linear for isosurfaces");
  if (slice && s->sampling.rays_per_pixel != 1)
    return unsupported(error, "/sampling/raysPerPixel", "several rays per pixel in slices");
  return true;
}

static bool check_color(const tc_scene *s, GError **error) {
  for (int c = 0; c < 3; c++)
    if (!(s->isosurface.color[c] >= 0 && s->isosurface.color[c] <= 1))
      return invalid(error, "/isosurface/color", "three numbers from 0 to 1 expected");
  return true;
}

static bool check_surface(const tc_scene *s, GError **error) {
  if (!isfinite(s->isosurface.value)) return invalid(error, "/isosurface/value", "a finite number expected");
  return check_color(s, error);
}

/* A slice in the list of surfaces. */
static bool check_plane_of(const tc_scene *s, tc_mpr_orientation orientation, GError **error) {
  tc_scene slice = *s; /* borrows */
  slice.mpr.orientation = orientation;
  return check_center(s, error) && check_plane(&slice, error);
}

/* A list mesh.surfaces replaces the surface of isosurface.value. */
static bool check_surfaces(const tc_scene *s, GError **error) {
  char pointer[40];
  for (size_t i = 0; i < s->mesh.n_surfaces; i++) {
    const tc_mesh_surface *of = &s->mesh.surfaces[i];
    snprintf(pointer, sizeof pointer, "/mesh/surfaces/%zu", i);
    if (of->source == TC_SURFACE_OF_VALUE && !isfinite(of->value)) return invalid(error, pointer, "a finite value expected");
    if (!(of->opacity >= 0 && of->opacity <= 1)) return invalid(error, pointer, "opacity from 0 to 1 expected");
    for (int c = 0; c < 3; c++)
      if (!(of->color[c] >= 0 && of->color[c] <= 1)) return invalid(error, pointer, "color of numbers from 0 to 1 expected");
    const double shares[] = {of->ambient, of->diffuse, of->specular, of->shininess / 1024};
    for (int k = 0; k < 4; k++)
      if (of->own_shading >> k & 2 && !(shares[k] >= 0 && shares[k] <= 1))
        return invalid(error, pointer, "ambient, diffuse and specular from 0 to 1 and shininess from 0 to 1024 expected");
    if ((unsigned)of->model >= TC_SHADING_COUNT) return invalid(error, pointer, "unknown model");
    if (of->source == TC_SURFACE_OF_LABEL && !s->labels.volume[0])
      return invalid(error, pointer, "a label needs labels.volume, which is not set");
    if (of->source == TC_SURFACE_OF_LABEL && !tc_mode_has_labels(s->mode))
      return unsupported(error, pointer, "the surface of a label within this mode");
    if (of->source == TC_SURFACE_OF_PLANE && (!check_plane_of(s, of->plane, error) || !check_window(s, error))) return false;
  }
  return check_color(s, error) && check_lights(s, error);
}

/* Splats read the transfer function for colours by value, and for extinction if they are translucent. */
static bool check_splat(const tc_volume *volume, const tc_scene *s, const tc_scene *valid, GError **error) {
  const bool values = strcmp(s->splat.attribute, "value") == 0;
  if (!isfinite(s->splat.threshold[0]) || !isfinite(s->splat.threshold[1]) || s->splat.threshold[0] > s->splat.threshold[1])
    return invalid(error, "/splat/threshold", "two finite values expected, the lower one first");
  if (!(s->splat.kernel_radius > 0 && s->splat.kernel_radius <= 16))
    return invalid(error, "/splat/kernelRadius", "voxels above 0 and up to 16 expected");
  const tc_vmd *model = tc_volume_model(volume);
  if (s->splat.attribute[0] && !values && strcmp(s->splat.attribute, "color") != 0 &&
      !(model && tc_vmd_attribute_named(&model->head, s->splat.attribute)))
    return invalid(error, "/splat/attribute",
                   "value (colours of the transfer function), color (isosurface.color) or an attribute of a .vmd expected");
  if (s->filter == TC_FILTER_NEAREST)
    return unsupported(error, "/filter", "a footprint other than linear (Gaussian) and cubic");
  return check_color(s, error) && ((s->splat.opaque && (!s->splat.attribute[0] || strcmp(s->splat.attribute, "color") == 0)) || check_transfer_function(&s->transfer_function, valid, error));
}

/* All modes but splat read voxels on a grid, which a run-length model does not have. */
static bool check_grid(const tc_volume *volume, const tc_scene *scene, GError **error) {
  if (!tc_volume_sparse(volume) || scene->mode == TC_MODE_SPLAT) return true;
  tc_set_error(error, TC_ERROR_INVALID, "/mode",
               "mode: %s needs a volume with a grid, and this one is a run-length model (.vmd): choose splat",
               tc_mode_names[scene->mode]);
  return false;
}

bool tc_plan_check(const tc_volume *volume, const tc_scene *scene, int width, int height, const tc_scene *valid,
                   GError **error) {
  if (!check_built(scene, error) || !check_grid(volume, scene, error) || !check_image(width, height, error) || !check_labels(scene, valid, error))
    return false;
  if (scene->mode == TC_MODE_MPR)
    return check_mpr(volume, scene, error) && check_window(scene, error) && check_clipping(scene, error);
  if (!check_camera(&scene->camera, error)) return false;
  if (tc_is_surface(scene->mode))
    return (scene->mode == TC_MODE_MESH && scene->mesh.n_surfaces ? check_surfaces(scene, error) : check_surface(scene, error)) &&
           check_rays(scene, error) && check_clipping(scene, error) && check_shading(scene, error);
  if (scene->mode == TC_MODE_SPLAT)
    return check_splat(volume, scene, valid, error) && check_clipping(scene, error) && check_shading(scene, error);
  if (tc_mesh_is_within(scene) && !check_surfaces(scene, error)) return false;
  return check_look(scene, valid, error) && check_sampling(volume, scene, error) && check_clipping(scene, error) &&
         check_shading(scene, error);
}
