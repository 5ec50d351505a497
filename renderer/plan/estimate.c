/* Upper bound on the samples of a frame. The volume is cut into CUT^3 equal bricks, and the length of all rays within
 * each brick is bounded in two ways: by the brick's volume times the density of rays at its nearest corner (exact for
 * parallel rays), and by the pixels of its bounding rectangle times its longest chord. The smaller bound counts; the
 * second one also holds if the eye is inside the brick, or if the picture shows only a part of it. */
#include "renderer/plan/estimate.h"

#include <math.h>

#include "renderer/base/vector.h"
#include "renderer/mesh/coverage.h"
#include "renderer/mesh/surfaces.h"
#include "renderer/raycast/projection.h"
#include "renderer/raycast/rays.h"
#include "renderer/raycast/mpr.h"

#define CUT 8
#define NODES (CUT + 1)
#define ENDS 4
#define LAYER 16     /* samples per pixel and layer of a translucent mesh: layers are drawn, stored and sorted */
#define HIDDEN 0.25  /* samples per pixel and layer of an opaque mesh, most of which are occluded */
#define RAY 256.0    /* samples that count as one pixel in tc_estimate_pixels() */
#define LOOKS 1000   /* triangles of all meshes that are probed for coverage */
#define SURFACES 12 /* samples per (voxels)^(2/3): bones and vessels have 1 to 4 splats in this unit, each costs 3
                       pixels */

/* A point on the picture in pixels, and its depth: mm from the eye along the view direction. */
typedef struct spot {
  double x, y, depth;
  unsigned outside; /* bit i: clip plane i hides the point */
} spot;

typedef struct view {
  const tc_rays *rays;
  int width, height;
  double forward[3]; /* LPS */
  double origin[3], along[3][3]; /* along the camera's axes (right, up, forward), mm: from the eye to voxel 0; per voxel
                                    step of each index axis */
  double pixel; /* side of a pixel in mm; in perspective, at 1 mm from the eye */
  double chord_mm; /* longest ray through a brick if rays are parallel; else infinite */
  double brick_mm3, diagonal_mm, most_tilt; /* of a brick; largest |view| / depth of a ray */
} view;

typedef struct total {
  double stay_mm; /* length of all rays within the volume */
  double box[4];  /* bounding rectangle of the visible bricks in pixels: x0, y0, x1, y1 */
  double lo[3], hi[3]; /* bounding box of the visible bricks, index positions */
} total;

/* One instruction each, unlike fmin() and fmax(); `a` if b is NaN. */
static inline double lesser(double a, double b) { return b < a ? b : a; }
static inline double greater(double a, double b) { return b > a ? b : a; }

static void look(view *v, const tc_volume *volume, const tc_scene *scene) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_camera *c = &scene->camera;
  double axes[3][3], corner[3];
  for (int k = 0; k < 3; k++) v->forward[k] = c->target[k] - c->position[k], corner[k] = d->origin[k] - c->position[k];
  normalise3(v->forward);
  cross3(v->forward, c->up, axes[0]);
  normalise3(axes[0]);
  cross3(axes[0], v->forward, axes[1]);
  for (int r = 0; r < 3; r++) axes[2][r] = v->forward[r];
  for (int r = 0; r < 3; r++) {
    v->origin[r] = dot3(corner, axes[r]);
    for (int k = 0; k < 3; k++) {
      const double voxel[3] = {d->direction[k] * d->spacing[k], d->direction[3 + k] * d->spacing[k],
                               d->direction[6 + k] * d->spacing[k]};
      v->along[r][k] = dot3(voxel, axes[r]);
    }
  }
  bool perspective = c->projection == TC_PERSPECTIVE;
  v->pixel = (perspective ? 2 * tan(c->fov_y_deg * (M_PI / 360)) : c->height_mm) / v->height;
  v->most_tilt = perspective ? hypot(1, v->pixel * 0.5 * hypot(v->width, v->height)) : 1;
}

static spot place(const view *v, const double index[3]) {
  spot s = {.depth = v->origin[2] + dot3(v->along[2], index)};
  double scale = 1 / (v->rays->perspective ? v->pixel * s.depth : v->pixel);
  s.x = 0.5 * v->width + (v->origin[0] + dot3(v->along[0], index)) * scale;
  s.y = 0.5 * v->height - (v->origin[1] + dot3(v->along[1], index)) * scale;
  for (int i = 0; i < v->rays->n_planes; i++)
    if (dot3(v->rays->planes[i], index) + v->rays->planes[i][3] < 0) s.outside |= 1u << i;
  return s;
}

/* Bounding rectangle of a brick on the picture, and its smallest depth. False if the brick is behind the eye or clipped
 * away. */
static bool bound(const view *v, const spot *const corners[8], double box[4], double *near) {
  unsigned outside = ~0u;
  double far = -INFINITY;
  *near = INFINITY;
  box[0] = box[1] = INFINITY, box[2] = box[3] = -INFINITY;
  for (int c = 0; c < 8; c++) {
    const spot *s = corners[c];
    outside &= s->outside;
    *near = lesser(*near, s->depth);
    far = greater(far, s->depth);
    box[0] = lesser(box[0], s->x), box[1] = lesser(box[1], s->y);
    box[2] = greater(box[2], s->x), box[3] = greater(box[3], s->y);
  }
  if (outside || far <= 0) return false;
  bool all = v->rays->perspective && *near <= 0; /* the brick may contain the eye and cover the whole picture */
  /* Rays pass at most half a pixel from the pixel's centre. */
  box[0] = all ? 0 : greater(floor(box[0] - 0.5), 0), box[2] = all ? v->width : lesser(ceil(box[2] + 0.5), v->width);
  box[1] = all ? 0 : greater(floor(box[1] - 0.5), 0), box[3] = all ? v->height : lesser(ceil(box[3] + 0.5), v->height);
  return box[2] > box[0] && box[3] > box[1];
}

static void add_brick(const view *v, const spot *const corners[8], const double lo[3], const double hi[3], total *t) {
  double box[4], near, dense = 1 / (v->pixel * v->pixel);
  if (!bound(v, corners, box, &near)) return;
  if (v->rays->perspective) dense = near > 0 ? dense * v->most_tilt / (near * near) : INFINITY;
  double pixels = (box[2] - box[0]) * (box[3] - box[1]);
  t->stay_mm += lesser(pixels * lesser(v->chord_mm, v->diagonal_mm), v->brick_mm3 * dense);
  for (int k = 0; k < 2; k++) t->box[k] = lesser(t->box[k], box[k]), t->box[2 + k] = greater(t->box[2 + k], box[2 + k]);
  for (int k = 0; k < 3; k++) t->lo[k] = lesser(t->lo[k], lo[k]), t->hi[k] = greater(t->hi[k], hi[k]);
}

/* Longest diagonal of an index box in mm. */
static double diagonal_mm(const tc_volume *volume, const double lo[3], const double hi[3]) {
  double longest = 0;
  for (int c = 0; c < 4; c++) { /* its four diagonals */
    double a[3], b[3], p[3], q[3];
    for (int k = 0; k < 3; k++) a[k] = c >> k & 1 ? hi[k] : lo[k], b[k] = c >> k & 1 ? lo[k] : hi[k];
    tc_volume_index_to_lps(volume, a, p);
    tc_volume_index_to_lps(volume, b, q);
    for (int k = 0; k < 3; k++) p[k] -= q[k];
    longest = fmax(longest, length3(p));
  }
  return longest;
}

/* Longest parallel ray through an index box in mm. */
static double chord_mm(const view *v, const double lo[3], const double hi[3]) {
  double least = INFINITY;
  if (v->rays->perspective) return least;
  for (int k = 0; k < 3; k++) least = fmin(least, (hi[k] - lo[k]) / fabs(dot3(v->rays->to_index + 3 * k, v->forward)));
  return least;
}

static void measure_bricks(view *v, const tc_volume *volume) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  double lo[3], hi[3], side[3][3], normal[3];
  for (int k = 0; k < 3; k++) {
    lo[k] = 0, hi[k] = (v->rays->hi[k] - v->rays->lo[k]) / CUT;
    for (int r = 0; r < 3; r++) side[k][r] = d->direction[3 * r + k] * d->spacing[k] * hi[k];
  }
  cross3(side[0], side[1], normal);
  v->brick_mm3 = fabs(dot3(normal, side[2]));
  v->diagonal_mm = diagonal_mm(volume, lo, hi);
  v->chord_mm = chord_mm(v, lo, hi);
}

static void add_bricks(const view *v, total *t) {
  static const int step[3] = {1, NODES, NODES * NODES};
  spot spots[NODES * NODES * NODES];
  double at[3][NODES];
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < NODES; i++) at[k][i] = v->rays->lo[k] + (v->rays->hi[k] - v->rays->lo[k]) * i / CUT;
  for (int i = 0; i < NODES * NODES * NODES; i++) {
    const double index[3] = {at[0][i % NODES], at[1][i / NODES % NODES], at[2][i / (NODES * NODES)]};
    spots[i] = place(v, index);
  }
  for (int i = 0; i < CUT * CUT * CUT; i++) {
    const int n[3] = {i % CUT, i / CUT % CUT, i / (CUT * CUT)};
    const spot *corners[8];
    double lo[3], hi[3];
    for (int k = 0; k < 3; k++) lo[k] = at[k][n[k]], hi[k] = at[k][n[k] + 1];
    for (int c = 0; c < 8; c++) {
      int node = 0;
      for (int k = 0; k < 3; k++) node += (n[k] + (c >> k & 1)) * step[k];
      corners[c] = &spots[node];
    }
    add_brick(v, corners, lo, hi, t);
  }
}

/* Cost of a sample, or of a segment with its gradients and labels, in linear samples. */
static double weight(const tc_scene *s) {
  double sample = s->filter == TC_FILTER_CUBIC ? 8 : 1;
  if (s->mode != TC_MODE_DVR) return s->mode == TC_MODE_ISOSURFACE ? 1 : sample;
  double segment = s->classification == TC_PREINTEGRATED2 ? 2 * sample : sample;
  if (s->labels.volume[0]) segment += 1;
  if (s->shading.model == TC_SHADING_NONE) return segment;
  tc_gradient gradient = s->filter == TC_FILTER_CUBIC ? TC_GRADIENT_CUBIC : s->shading.gradient;
  return segment + (gradient == TC_GRADIENT_CUBIC ? 8 : gradient == TC_GRADIENT_CENTRAL ? 4 : 0);
}

/* Steps per mm of a ray; in mode isosurface, a bound on the cells that the ray crosses per mm. */
static double steps_per_mm(const tc_rays *rays, const tc_scene *scene) {
  double cells = 0;
  if (scene->mode != TC_MODE_ISOSURFACE) return 1 / rays->step_mm;
  for (int k = 0; k < 3; k++) cells += sqrt(dot3(rays->to_index + 3 * k, rays->to_index + 3 * k));
  return cells;
}

/* Samples of a ray in addition to its full steps: at its ends, and for peak refinement. */
static int ends(const tc_scene *s) {
  bool climbs = s->mode == TC_MODE_MIP || s->mode == TC_MODE_MINIP;
  return ENDS + (climbs ? 2 * TC_PEAK_ROUNDS : 0);
}

/* Cost of the layers of a scene's own meshes. */
static double layers_of(const tc_scene *scene, tc_mesh *const *meshes, int width, int height) {
  double layers = 0;
  size_t n = 0;
  for (size_t i = 0; meshes && i < scene->mesh.n_surfaces; i++) n += meshes[i] != NULL;
  for (size_t i = 0; n && i < scene->mesh.n_surfaces; i++) {
    const tc_mesh_surface *s = &scene->mesh.surfaces[i];
    if (meshes[i] && tc_mesh_surface_shows(s))
      layers += (s->opacity < 1 ? LAYER : HIDDEN) *
                tc_mesh_coverage(meshes[i], &scene->camera, width, height, LOOKS / n + 1);
  }
  return layers * scene->sampling.rays_per_pixel;
}

double tc_estimate_samples(const tc_volume *volume, const tc_scene *scene, tc_mesh *const *meshes, int width, int height,
                           double *longest_ray) {
  tc_rays rays;
  double unused, *longest = longest_ray ? longest_ray : &unused, each = weight(scene);
  tc_rays_set_up(&rays, volume, scene, width, height);
  *longest = 0;
  if (scene->mode == TC_MODE_MPR) {
    *longest = each * (scene->mpr.thickness_mm / rays.step_mm + ends(scene)) + (scene->labels.volume[0] ? 1 : 0);
    return *longest * width * height;
  }
  if (scene->mode == TC_MODE_SPLAT) { /* an estimate, no bound: a surface of typical size, and the picture's pixels */
    const int *n = tc_volume_describe(volume)->dims;
    const double voxels = (double)n[0] * n[1] * n[2];
    *longest = 1;
    return 2.0 * width * height + SURFACES * pow(voxels, 2.0 / 3);
  }
  view v = {.rays = &rays, .width = width, .height = height};
  total t = {.box = {INFINITY, INFINITY, -INFINITY, -INFINITY},
             .lo = {INFINITY, INFINITY, INFINITY}, .hi = {-INFINITY, -INFINITY, -INFINITY}};
  look(&v, volume, scene);
  measure_bricks(&v, volume);
  add_bricks(&v, &t);
  const bool drawn = scene->mode == TC_MODE_MESH || tc_mesh_is_within(scene);
  const double layers = drawn ? layers_of(scene, meshes, width, height) : 0;
  if (!(t.box[2] > t.box[0])) return layers;
  double pixels = (t.box[2] - t.box[0]) * (t.box[3] - t.box[1]);
  if (scene->mode == TC_MODE_MESH) {
    *longest = 1;
    return pixels * rays.count + layers;
  }
  double dense = steps_per_mm(&rays, scene);
  double stay = fmin(diagonal_mm(volume, t.lo, t.hi), chord_mm(&v, t.lo, t.hi));
  /* A sum over rays exceeds the integral by at most one row and one column of longest rays. */
  double edge = t.box[2] - t.box[0] + t.box[3] - t.box[1] + 1;
  *longest = each * (stay * dense + ends(scene));
  return fmin(each * ((t.stay_mm + edge * stay) * dense + ends(scene) * pixels), *longest * pixels) * rays.count + layers;
}

double tc_estimate_pixels(const tc_volume *volume, const tc_scene *scene, int width, int height) {
  tc_scene plain = *scene; /* borrows */
  plain.sampling.step = plain.sampling.rays_per_pixel = 1;
  plain.classification = TC_PREINTEGRATED;
  plain.shading.model = TC_SHADING_NONE;
  plain.mesh.n_surfaces = 0;
  return sqrt(tc_estimate_samples(volume, &plain, NULL, width, height, NULL) / RAY * width * height);
}
