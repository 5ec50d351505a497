#include <math.h>
#include <string.h>

#include "renderer/reference/integrator.h"

static bool shows(const tc_mesh_surface *s) { return s->visible && s->opacity > 0; }

static bool is_within(const tc_scene *s) {
  return s->mesh.n_surfaces && s->mesh.with_volume && (s->mode == TC_MODE_DVR || s->mode == TC_MODE_MIP);
}

/* Whether a surface of that source is shown. */
static bool needs(const tc_scene *s, tc_surface_source source) {
  const bool mesh = s->mode == TC_MODE_MESH;
  for (size_t i = 0; i < s->mesh.n_surfaces && (mesh || is_within(s)); i++)
    if (shows(&s->mesh.surfaces[i]) && s->mesh.surfaces[i].source == source) return true;
  return mesh && source == TC_SURFACE_OF_LABEL && s->labels.volume[0] && !s->mesh.n_surfaces;
}

const char *tc_reference_missing(const tc_scene *scene) {
  bool surface = tc_ref_is_surface(scene->mode);
  if (scene->mode != TC_MODE_DVR && !surface && !tc_ref_is_projection(scene->mode)) return "/mode";
  surface = surface || is_within(scene);
  if ((unsigned)scene->filter >= TC_FILTER_COUNT || (surface && scene->filter != TC_FILTER_LINEAR)) return "/filter";
  if (needs(scene, TC_SURFACE_OF_LABEL) || needs(scene, TC_SURFACE_OF_MESH)) return "/mesh/surfaces";
  if (scene->labels.volume[0] && scene->mode == TC_MODE_DVR) return "/labels/volume";
  return NULL;
}

/* The plane of the slice that mode mpr shows in an orientation. */
static void plane_of(const tc_reference *r, const tc_scene *scene, tc_mpr_orientation orientation, double plane[4]) {
  static const double into[TC_MPR_ORIENTATION_COUNT][3] = {[TC_AXIAL] = {0, 0, 1}, [TC_CORONAL] = {0, 1, 0}, [TC_SAGITTAL] = {-1, 0, 0}};
  const tc_volume_desc *d = r->field.desc;
  double of[3];
  for (int k = 0; k < 3; k++) of[k] = orientation == TC_OBLIQUE ? -scene->mpr.normal[k] : into[orientation][k];
  double size = sqrt(of[0] * of[0] + of[1] * of[1] + of[2] * of[2]), at[3];
  plane[3] = 0;
  for (int k = 0; k < 3; k++) {
    at[k] = d->origin[k];
    for (int i = 0; i < 3; i++) at[k] += d->direction[3 * k + i] * d->spacing[i] * (d->dims[i] - 1) / 2;
    if (scene->mpr.has_center) at[k] = scene->mpr.center[k];
    plane[k] = of[k] / size, plane[3] -= plane[k] * at[k];
  }
}

static tc_ref_shading shading_of_surface(const tc_reference *r, const tc_scene *scene, const tc_mesh_surface *item) {
  tc_ref_shading shading;
  tc_scene own = *scene; /* borrows */
  if (item->own_shading & 1) own.shading.model = item->model;
  if (item->own_shading & 2) own.shading.ambient = item->ambient;
  if (item->own_shading & 4) own.shading.diffuse = item->diffuse;
  if (item->own_shading & 8) own.shading.specular = item->specular;
  if (item->own_shading & 16) own.shading.shininess = item->shininess;
  tc_ref_shading_set_up(&shading, r->volume, &own);
  if (scene->mode != TC_MODE_ISOSURFACE) tc_ref_shading_light(&shading, scene);
  return shading;
}

/* Label volume and meshes that surfaces are made of. */
typedef struct sources {
  tc_volume *labels;
  const tc_reference_mesh *meshes;
  tc_ref_extent_of_label *extents; /* of labels; NULL: not needed */
} sources;

/* Sets the label's field; a label without voxels has none. */
static bool smooth_label(tc_ref_surface *s, const sources *of, const tc_scene *scene) {
  const tc_ref_extent_of_label *where = NULL;
  for (int i = 0; i < TC_REF_LABELS && !where; i++)
    if (of->extents[i].found && of->extents[i].label == s->label) where = &of->extents[i];
  if (!where) return true;
  tc_ref_smooth *smooth = tc_ref_smooth_new(of->labels, where);
  if (!smooth) return false;
  s->field = (tc_ref_field){.desc = tc_ref_smooth_desc(smooth), .smooth = smooth};
  s->field.filter = TC_FILTER_LINEAR;
  tc_ref_shading dual;
  tc_ref_shading_set_up(&dual, of->labels, scene);
  memcpy(s->shading.dual, dual.dual, sizeof dual.dual);
  s->shading.gradient = TC_GRADIENT_CENTRAL;
  return true;
}

static bool add_surface(tc_reference *r, const tc_scene *scene, const tc_mesh_surface *item, const sources *of, GError **error) {
  const double *srgb = item->has_color ? item->color : scene->isosurface.color;
  const tc_mesh_surface *first = scene->mesh.surfaces;
  const bool listed = first && item >= first && item < first + scene->mesh.n_surfaces;
  tc_ref_surface *s = &r->surfaces[r->n_surfaces++];
  *s = (tc_ref_surface){.kind = item->source, .iso = item->value, .opacity = item->opacity, .one_sided = !item->two_sided};
  for (int c = 0; c < 3; c++) s->color[c] = scene->image.linear_light ? tc_ref_to_linear(srgb[c]) : srgb[c];
  s->number = listed ? (int)(item - first) : 0;
  if (item->source == TC_SURFACE_OF_LABEL) s->label = (uint32_t)item->label;
  if (item->source == TC_SURFACE_OF_LABEL && !item->has_color) tc_ref_label_color(of->labels, scene, item->label, s->color);
  if (item->source == TC_SURFACE_OF_PLANE) plane_of(r, scene, item->plane, s->plane);
  s->shading = shading_of_surface(r, scene, item);
  const tc_reference_mesh *mesh = item->source == TC_SURFACE_OF_MESH ? &of->meshes[s->number] : NULL;
  s->colored = mesh && mesh->colors && !item->has_color;
  if ((mesh && !(s->triangles = tc_ref_triangles_new(mesh, scene->image.linear_light, r->cancel))) ||
      (item->source == TC_SURFACE_OF_LABEL && !smooth_label(s, of, scene))) {
    if (tc_ref_stopped(r)) {
      tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
      return false;
    }
    tc_set_error(error, TC_ERROR_MEMORY, "/mesh/surfaces", "reference: no memory for the surfaces");
    return false;
  }
  if (isfinite(s->iso)) return true;
  tc_set_error(error, TC_ERROR_INVALID, "/isosurface/value", "reference: isosurface: a finite value expected");
  return false;
}

/* Mode mesh without a list shows all visible labels: their list, [*n], g_free() it. */
static tc_mesh_surface *list_labels(const tc_scene *scene, const tc_ref_extent_of_label *extents, size_t *n) {
  tc_mesh_surface *list = g_new0(tc_mesh_surface, TC_REF_LABELS);
  *n = 0;
  for (int i = 0; i < TC_REF_LABELS; i++) {
    const double label = extents[i].label;
    bool shown = !scene->labels.visible;
    for (size_t k = 0; k < scene->labels.n_visible && !shown; k++) shown = scene->labels.visible[k] == label;
    if (extents[i].found && shown && label >= 1 && label <= INT32_MAX && label == floor(label))
      list[(*n)++] = (tc_mesh_surface){
          .source = TC_SURFACE_OF_LABEL, .label = (int)label, .opacity = 1, .visible = true, .two_sided = true};
  }
  return list;
}

static bool find_labels(tc_reference *r, sources *of, GError **error) {
  if (tc_volume_describe(of->labels)->type == TC_F32) {
    tc_set_error(error, TC_ERROR_INVALID, "/labels/volume", "reference: labels are whole numbers");
    return false;
  }
  r->labelled = tc_volume_ref(of->labels);
  of->extents = tc_ref_labels_find(of->labels, r->cancel);
  if (!of->extents)
    tc_set_error(error, TC_ERROR_MEMORY, "/labels/volume", "reference: no memory for the labels");
  else if (tc_ref_stopped(r))
    tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
  return of->extents && !tc_ref_stopped(r);
}

static bool add_surfaces(tc_reference *r, const tc_scene *scene, const sources *of, GError **error) {
  const tc_mesh_surface one = {.value = scene->isosurface.value, .opacity = 1, .visible = true, .two_sided = true};
  const bool listed = scene->mode != TC_MODE_ISOSURFACE && scene->mesh.n_surfaces;
  size_t n = listed ? scene->mesh.n_surfaces : 1;
  tc_mesh_surface *labels = !listed && of->extents ? list_labels(scene, of->extents, &n) : NULL;
  const tc_mesh_surface *list = listed ? scene->mesh.surfaces : labels ? labels : &one;
  bool good = true;
  r->surfaces = g_new0(tc_ref_surface, n + 1);
  for (size_t i = 0; i < n && good; i++) {
    if (tc_ref_stopped(r)) tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
    good = !tc_ref_stopped(r) && (!shows(&list[i]) || add_surface(r, scene, &list[i], of, error));
  }
  g_free(labels);
  return good;
}

static bool set_up_surfaces(tc_reference *r, const tc_scene *scene, const tc_reference_request *given, GError **error) {
  sources of = {.labels = given->labels, .meshes = given->meshes};
  const bool good = (!needs(scene, TC_SURFACE_OF_LABEL) || find_labels(r, &of, error)) && add_surfaces(r, scene, &of, error);
  free(of.extents);
  return good;
}

/* Sets up the members that the mode reads: transfer function, window or surfaces; slices read the window, too. */
static bool set_up_appearance(tc_reference *r, const tc_reference_request *of, GError **error) {
  const tc_scene *scene = of->scene;
  r->mode = scene->mode;
  r->within = is_within(scene);
  r->window = (tc_ref_window){scene->window.center, scene->window.width, scene->image.linear_light};
  if ((tc_ref_is_surface(scene->mode) || r->within) && !set_up_surfaces(r, scene, of, error)) return false;
  if (tc_ref_is_surface(scene->mode)) return true;
  if (!tc_ref_is_projection(scene->mode)) {
    if (tc_ref_transfer_set_up(&r->transfer, &scene->transfer_function, scene->image.linear_light)) return true;
    tc_set_error(error, TC_ERROR_INVALID, "/transferFunction",
                 "reference: transfer function: at least one knot expected, all "
                 "finite, values ascending");
    return false;
  }
  if (isfinite(r->window.center) && isfinite(r->window.width) && r->window.width > 0) return true;
  tc_set_error(error, TC_ERROR_INVALID, "/window", "reference: window: a finite center and a width above 0 expected");
  return false;
}

/* False with the error set: a member has no reference, or a value is meaningless. */
static bool check(const tc_reference_request *of, GError **error) {
  const char *member = tc_reference_missing(of->scene);
  const bool meshes = of->meshes || !needs(of->scene, TC_SURFACE_OF_MESH);
  const bool labels = of->labels || !needs(of->scene, TC_SURFACE_OF_LABEL);
  if (member && !(of->labels && !strcmp(member, "/labels/volume")) &&
      !(meshes && labels && !strcmp(member, "/mesh/surfaces"))) {
    tc_set_error(
        error, TC_ERROR_UNSUPPORTED, member,
        "reference: %s: only dvr, mip, minip and average of any field and surfaces of the linear one are "
        "integrated",
        member);
    return false;
  }
  if (of->width >= 1 && of->height >= 1 && (of->tolerance == 0 || (of->tolerance >= 1e-14 && of->tolerance <= 0.1)))
    return true;
  tc_set_error(error, TC_ERROR_INVALID, NULL, "reference: %dx%d pixels to %g: at least 1x1 and 1e-14 .. 0.1 expected",
               of->width, of->height, of->tolerance);
  return false;
}

static bool set_up_field(tc_reference *r, tc_volume *volume, const tc_scene *scene, GError **error) {
  r->field =
      (tc_ref_field){.filter = scene->filter, .desc = tc_volume_describe(volume), .voxels = tc_volume_data(volume)};
  if (tc_volume_gaps(volume) && tc_ref_is_surface(scene->mode)) r->field.gaps = tc_volume_data(tc_volume_gaps(volume));
  if (scene->filter != TC_FILTER_CUBIC || !scene->sampling.prefilter) return true;
  r->field.coefficients = tc_ref_coefficients(&r->field, r->cancel);
  if (tc_ref_stopped(r)) {
    tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
    return false;
  }
  if (!r->field.coefficients)
    tc_set_error(error, TC_ERROR_MEMORY, "/sampling/prefilter", "reference: no memory for the coefficients");
  return r->field.coefficients != NULL;
}

/* The labels of the scene, or the volume's gaps. */
static void set_up_labels(tc_reference *r, tc_volume *labels, const tc_scene *scene) {
  tc_volume *gaps = tc_volume_gaps(r->volume);
  if (labels && scene->labels.volume[0] && scene->mode == TC_MODE_DVR) {
    r->label_volume = tc_volume_ref(labels);
    tc_scene_copy(&r->scene, scene);
    tc_ref_labels_set_up(&r->labels, labels, &r->scene);
  } else if (gaps && !tc_ref_is_surface(scene->mode)) {
    r->label_volume = tc_volume_ref(gaps);
    r->scene.filter = scene->filter;
    tc_ref_labels_of_gaps(&r->labels, gaps, &r->scene);
  }
}

static bool set_up(tc_reference *r, const tc_reference_request *of, GError **error) {
  const tc_scene *scene = of->scene;
  r->cancel = of->cancel;
  r->volume = tc_volume_ref(of->volume);
  set_up_labels(r, of->labels, scene);
  if (!set_up_field(r, of->volume, scene, error)) return false;
  tc_ref_clip_set_up(&r->clip, scene);
  /* The errors of pieces add up, but each piece's estimate is pessimistic by orders of magnitude. */
  r->tolerance = (of->tolerance == 0 ? 1e-10 : of->tolerance) / 16;
  if (scene->mode == TC_MODE_DVR && scene->shading.model != TC_SHADING_NONE)
    tc_ref_shading_set_up(&r->shading, of->volume, scene);
  const char *member = tc_ref_camera_set_up(&r->camera, &scene->camera, of->width, of->height);
  if (!member) return set_up_appearance(r, of, error);
  tc_set_error(error, TC_ERROR_INVALID, member,
               "reference: camera: position, target and up must span a plane and the "
               "view be wider than 0 and narrower than 180 degrees");
  return false;
}

tc_reference *tc_reference_make(const tc_reference_request *request, GError **error) {
  if (!check(request, error)) return NULL;
  tc_reference *r = g_new0(tc_reference, 1);
  if (set_up(r, request, error)) return r;
  tc_reference_free(r);
  return NULL;
}

tc_reference *tc_reference_new(tc_volume *volume, const tc_scene *scene, int width, int height, double tolerance,
                               GError **error) {
  const tc_reference_request of = {
      .volume = volume, .scene = scene, .width = width, .height = height, .tolerance = tolerance};
  return tc_reference_make(&of, error);
}

void tc_reference_free(tc_reference *reference) {
  if (!reference) return;
  tc_ref_transfer_clear(&reference->transfer);
  tc_volume_unref(reference->volume);
  tc_volume_unref(reference->label_volume);
  tc_volume_unref(reference->labelled);
  tc_scene_clear(&reference->scene);
  g_free(reference->field.coefficients);
  for (size_t i = 0; i < reference->n_surfaces; i++) {
    tc_ref_triangles_free(reference->surfaces[i].triangles);
    tc_ref_smooth_free((tc_ref_smooth *)reference->surfaces[i].field.smooth);
  }
  g_free(reference->surfaces);
  g_free(reference);
}
