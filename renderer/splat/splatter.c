#include "renderer/splat/splatter.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/base/vector.h"
#include "renderer/classify/transfer.h"
#include "renderer/frame/backend.h"
#include "renderer/frame/frame.h"
#include "renderer/raycast/clip.h"
#include "renderer/raycast/rays.h"
#include "renderer/raycast/shading.h"

#define LEAST_RADIUS2 0.51 /* a circle of this radius (squared, pixels) holds a pixel's centre wherever it is */
#define KERNEL_FALL 3.0    /* exponent at the kernel's rim */
#define FEW_AREA 1e-3      /* pixels a voxel: below this area weights shrink with it, so that sums do not overflow */
/* Where a voxel is up to ROUND pixels wide, kernels are balls at the depths of their voxels; from ROUND to SHAPED pixels they are
 * blended into shapes of their own (shape_tmpl.h). Normals differ from voxel to voxel, which shows where voxels are larger than
 * pixels: from SMALL to LARGE pixels the kernel's radius grows to SMOOTH voxels, or to MOST_PIXELS. The covered area does not
 * grow: at pixels without a core footprints keep their size. */
#define ROUND 1
#define SHAPED 1.5
#define SMALL 2
#define LARGE 6
#define SMOOTH 2
#define MOST_PIXELS 100
#define WINDOW 2.25 /* kernel radii: with less, slanted surfaces show the steps between their cores */

typedef struct drawing {
  const tc_splat_job *job;
  tc_splat_args args;
  const tc_splat_kernels *kernels;
  double to_view[3][4]; /* view space from index coordinates */
  double eye[3];        /* index coordinates */
  double planes[TC_SPLAT_MOST_PLANES][4];
  tc_splat_entry *entries; /* nearest first; translucent: sorted by layers of bricks along the sheets' axis */
  int n_entries, *layers;  /* translucent: first entry of each layer */
  int *tile_entries;       /* opaque: the entries whose boxes meet a tile, tile after tile */
  int *tile_first;         /* [tiles + 1] each tile's first of tile_entries */
  tc_splat_tile *tiles;    /* [threads] */
  float *out;              /* [threads][TC_TILE][TC_TILE][4] */
  tc_resolve resolve;
  tc_progress *progress;
} drawing;

/* ---- the view ---- */

_Static_assert(TC_SPLAT_MOST_PLANES == TC_MAX_CLIP_PLANES + 6, "clip planes, and the sides of the grid");

int tc_splat_planes(const tc_volume *volume, const tc_scene *scene, unsigned sides, double planes[TC_SPLAT_MOST_PLANES][4]) {
  const tc_volume_desc *grid = tc_volume_describe(volume);
  tc_rays rays = {0};
  int n;
  tc_rays_add_clipping(&rays, volume, scene);
  memcpy(planes, rays.planes, sizeof rays.planes), n = rays.n_planes;
  for (int f = 0; f < 6; f++) {
    const int k = f / 2;
    double *const p = planes[n];
    if (!(sides >> f & 1)) continue;
    memset(p, 0, sizeof planes[n]);
    p[k] = (f & 1 ? -1 : 1) * grid->spacing[k], p[3] = grid->spacing[k] * (f & 1 ? grid->dims[k] - 0.5 : 0.5);
    n++;
  }
  return n;
}

/* Rows: right, down, forward. The same camera as in raycast/rays.c. */
static void view_axes(const tc_camera *camera, double rows[3][3]) {
  for (int k = 0; k < 3; k++) rows[2][k] = camera->target[k] - camera->position[k];
  normalise3(rows[2]);
  cross3(rows[2], camera->up, rows[0]);
  normalise3(rows[0]);
  cross3(rows[2], rows[0], rows[1]);
}

static void set_view(drawing *d) {
  const tc_scene *scene = d->job->scene;
  const tc_camera *camera = &scene->camera;
  const tc_volume_desc *grid = tc_volume_describe(d->job->volume);
  const double height = d->job->frame->height, width = d->job->frame->width;
  tc_splat_args *g = &d->args;
  double rows[3][3];
  view_axes(camera, rows);
  for (int r = 0; r < 3; r++) {
    d->to_view[r][3] = dot3(rows[r], grid->origin) - dot3(rows[r], camera->position);
    for (int k = 0; k < 3; k++) {
      d->to_view[r][k] = 0;
      for (int c = 0; c < 3; c++) d->to_view[r][k] += rows[r][c] * grid->direction[3 * c + k] * grid->spacing[k];
      g->axis[r][k] = (float)d->to_view[r][k];
      g->covariant[k][r] = (float)(grid->direction[3 * r + k] * grid->spacing[k]);
    }
  }
  g->perspective = camera->projection == TC_PERSPECTIVE;
  const double scale =
      g->perspective ? 0.5 * height / tan(camera->fov_y_deg * (M_PI / 360)) : height / camera->height_mm;
  g->scale = (float)scale;
  double eye[3];
  for (int k = 0; k < 3; k++) eye[k] = camera->position[k] - (g->perspective ? 0 : 1e7 * rows[2][k]);
  tc_volume_lps_to_index(d->job->volume, eye, d->eye);
  /* Directions from the eye through pixels, LPS, for light. */
  for (int k = 0; k < 3; k++) {
    g->right[k] = (float)rows[0][k], g->down[k] = (float)rows[1][k];
    g->direction_du[k] = g->perspective ? (float)rows[0][k] : 0;
    g->direction_dv[k] = g->perspective ? (float)rows[1][k] : 0;
    g->direction0[k] =
        (float)(g->perspective ? scale * rows[2][k] - 0.5 * width * rows[0][k] - 0.5 * height * rows[1][k]
                               : rows[2][k]);
  }
  g->width = (float)width, g->height = (float)height;
}

/* ---- the kernel ---- */

/* Translucent: Gaussian and support, in kernel radii. The sum over a lattice of Gaussians of s spacings is constant
 * within 6 exp(-2 (pi s)^2): 0.5 % at 0.6. */
#define BLUR 0.6
#define SUPPORT 1.8

/* Table and mass of a translucent object's splats: the integral of a Gaussian along a line at distance b of its centre
 * is exp(-b^2 / 2 s^2) / (2 pi s^2) per voxel of the ray's way. */
static void set_blur(drawing *d) {
  tc_splat_args *g = &d->args;
  const double radius = d->job->scene->splat.kernel_radius, s = BLUR * radius, cut = SUPPORT / BLUR;
  double to_index[9], rows[3][3];
  g->radius2 = (float)(SUPPORT * SUPPORT * radius * radius);
  g->pixel_radius2 = 2.25f; /* half a pixel of deviation */
  for (int i = 0; i < TC_WEIGHT_STEPS; i++)
    g->weights[i] = (uint8_t)lround(255 * exp(-0.5 * cut * cut * (i + 0.5) / TC_WEIGHT_STEPS));
  g->mass = (float)(1 / (255 * 2 * M_PI * s * s * (1 - exp(-0.5 * cut * cut))));
  tc_volume_lps_to_index_matrix(d->job->volume, to_index);
  view_axes(&d->job->scene->camera, rows);
  for (int k = 0; k < 3; k++)
    for (int r = 0; r < 3; r++) g->to_index[k][r] = (float)dot3(to_index + 3 * k, rows[r]);
}

static double footprint(tc_filter filter, double q) {
  if (filter != TC_FILTER_CUBIC) return exp(-KERNEL_FALL * q);
  const double r = sqrt(q); /* cubic, 1 with slope 0 in the middle, 0 with slope 0 at the rim */
  return 1 - r * r * (3 - 2 * r);
}

/* Whether the eye is within the grid, where splats may be as large as the picture. */
static bool is_within(const drawing *d) {
  const int *dims = tc_volume_describe(d->job->volume)->dims;
  bool within = d->args.perspective;
  for (int k = 0; k < 3; k++) within = within && d->eye[k] > -1 && d->eye[k] < dims[k];
  return within;
}

static double grown_radius(double radius, double pixels, double share) {
  return fmax(radius, fmin(radius + (SMOOTH - radius) * share, MOST_PIXELS / pixels));
}

static void set_kernel(drawing *d) {
  const tc_scene *scene = d->job->scene;
  tc_splat_args *g = &d->args;
  const double radius = scene->splat.kernel_radius;
  double depth = 0, width = 0, distance = 1, size = 1;
  for (int k = 0; k < 3; k++) {
    depth += d->to_view[2][k] * d->to_view[2][k];
    width = fmax(width, hypot(d->to_view[0][k], d->to_view[1][k]));
    size *= tc_volume_describe(d->job->volume)->spacing[k];
  }
  g->window_mm = (float)(WINDOW * radius * sqrt(depth));
  g->near_mm = g->perspective ? (float)(2 * radius * sqrt(depth)) : 0;
  if (g->perspective) {
    const int *dims = tc_volume_describe(d->job->volume)->dims;
    distance = d->to_view[2][3];
    for (int k = 0; k < 3; k++) distance += d->to_view[2][k] * 0.5 * dims[k];
    distance = fmax(distance, (double)g->near_mm);
  }
  const double pixels = width * (double)g->scale / distance, most = fmax(1, 255 * fmin(1, pixels * pixels / FEW_AREA));
  const double mean = cbrt(size) * (double)g->scale / distance,
               share = fmin(fmax((mean - SMALL) / (LARGE - SMALL), 0), 1);
  const double wide = is_within(d) ? radius : grown_radius(radius, pixels, share);
  const double covered = fmax(TC_SPLAT_CORE, fmin(1, TC_SPLAT_CORE / radius)), core = covered * radius / wide;
  g->radius2 = (float)(wide * wide);
  g->core_share = (float)core;
  g->core2 = (float)(core * core);
  g->pixel_radius2 = (float)(LEAST_RADIUS2 / (core * core));
  g->coreless_scale = (float)(wide * wide / (radius * radius));
  g->shape_blend = (float)fmin(fmax((mean - ROUND) / (SHAPED - ROUND), 0), 1);
  g->core_radius = (float)(covered * radius);
  for (int i = 0; i < TC_WEIGHT_STEPS; i++)
    g->weights[i] = (uint8_t)fmax(1, lround(most * footprint(scene->filter, (i + 0.5) / TC_WEIGHT_STEPS)));
  g->weights[TC_WEIGHT_STEPS] = 0;
  g->full_weight = g->weights[(int)(covered * covered * (TC_WEIGHT_STEPS - 1))];
}

static void set_light(drawing *d) {
  const tc_scene *scene = d->job->scene;
  tc_splat_args *g = &d->args;
  g->shaded = scene->shading.model != TC_SHADING_NONE;
  if (!g->shaded) return;
  tc_shade_set_up(&g->shade, d->job->volume, d->job->volume, scene);
  memset(g->shade.gradient, 0, sizeof g->shade.gradient);
  for (int k = 0; k < 3; k++) g->shade.gradient[k][k] = 0.5f; /* of twice the normal */
  g->shade.flat = 0;
  g->shade.inverse_steep = 1;
}

/* ---- bricks ---- */

/* The faces of the brick's voxels that face the eye (mixed: not the same ones for every voxel), and aslant faces. */
static void set_seen(const drawing *d, tc_splat_entry *e) {
  uint8_t all = 0, some = 0;
  for (int k = 0; k < 3; k++) {
    const double to_eye = (double)e->eye[k], last = TC_SPLAT_BRICK - 1;
    all |= (uint8_t)((to_eye < -0.5) << 2 * k | (to_eye - last > 0.5) << (2 * k + 1));
    some |= (uint8_t)((to_eye - last < -0.5) << 2 * k | (to_eye > 0.5) << (2 * k + 1));
  }
  e->seen = some;
  e->mixed = all != some;
  if (d->args.opaque && d->args.shape_blend > 0) e->aslant = tc_splat_aslant(d->eye, e->brick.at);
}

/* True if a brick of cut faces has kernels that end at the object's surface, or lines and single voxels, which every plane
 * clips. */
static bool has_rims(const tc_splats *of, const tc_splat_brick *b) {
  bool any = false;
  for (uint32_t i = b->first; i < b->first + b->count && !any; i++) any = of->rims[i] != 0;
  return any;
}

/* False: the brick is clipped away. */
static bool set_clipped(const drawing *d, tc_splat_entry *e) {
  bool away = false;
  for (int i = 0; i < d->args.n_planes; i++) {
    const double *p = d->planes[i];
    double middle = p[3], half = 0;
    for (int k = 0; k < 3; k++) {
      middle += p[k] * (e->brick.at[k] * TC_SPLAT_BRICK + 7.5);
      half += fabs(p[k]) * 7.5;
    }
    const double beyond = (double)d->args.clip_reach * length3(p);
    e->planes |= (uint32_t)(middle - half < beyond + 1e-3) << i;
    away |= middle + half < -beyond;
  }
  /* one of a cut face's planes is its own */
  e->clipped = e->of->cut ? d->args.shape_blend > 0 && (e->planes & (e->planes - 1) || has_rims(e->of, &e->brick)) : e->planes != 0;
  return e->of->cut || !away;
}

/* The box of pixels that holds all footprints; false: outside the picture. */
static bool set_box(const drawing *d, tc_splat_entry *e, const double middle[3], const double half[3], double size_mm) {
  const tc_splat_args *g = &d->args;
  const double size[2] = {d->job->frame->width, d->job->frame->height},
               radius = sqrt((double)g->radius2) * tc_splat_longest_kernel(g) * size_mm;
  double near = middle[2] - half[2], far = middle[2] + half[2];
  e->near_mm = (float)(near - 1e-4 * (fabs(near) + half[2]));
  for (int k = 0; k < 2; k++) e->box[k] = 0, e->box[2 + k] = (float)size[k];
  e->reach = INFINITY;
  if (far <= (double)g->near_mm) return false;
  if (g->perspective && near <= (double)g->near_mm) return true;
  e->reach = 0;
  for (int k = 0; k < 2; k++) {
    double lo = middle[k] - half[k], hi = middle[k] + half[k], stretch = 1;
    if (g->perspective) {
      lo = fmin(lo / near, lo / far), hi = fmax(hi / near, hi / far);
      stretch = (1 + fmax(fabs(lo), fabs(hi))) / near;
    }
    const double reach = radius * (double)g->scale * stretch + sqrt((double)g->pixel_radius2) + 0.5;
    const double moved = (double)g->shape_blend * size_mm * (double)g->scale * stretch;
    e->reach = fmaxf(e->reach, (float)(reach + moved));
    e->box[k] = (float)(0.5 * size[k] + lo * (double)g->scale - reach);
    e->box[2 + k] = (float)(0.5 * size[k] + hi * (double)g->scale + reach);
    if (e->box[2 + k] < 0 || (double)e->box[k] > size[k]) return false;
  }
  return true;
}

static bool set_entry(const drawing *d, const tc_splats *of, const tc_splat_brick *b, double size_mm, tc_splat_entry *e) {
  const double reach = 7.5 + (double)d->args.shape_blend; /* voxels from its middle: splats are moved by at most one */
  double middle[3], half[3];
  *e = (tc_splat_entry){.of = of, .brick = *b};
  for (int r = 0; r < 3; r++) {
    double at = d->to_view[r][3];
    half[r] = 0;
    for (int k = 0; k < 3; k++) {
      at += d->to_view[r][k] * b->at[k] * TC_SPLAT_BRICK;
      half[r] += fabs(d->to_view[r][k]) * reach;
    }
    e->at[r] = (float)at;
    middle[r] = at + 7.5 * (d->to_view[r][0] + d->to_view[r][1] + d->to_view[r][2]);
    e->eye[r] = (float)(d->eye[r] - b->at[r] * TC_SPLAT_BRICK);
  }
  set_seen(d, e);
  if (!set_clipped(d, e) && d->args.culling) return false;
  if (!set_box(d, e, middle, half, size_mm) && d->args.culling) return false;
  return (b->faces & (e->seen | e->aslant)) || !d->args.culling || !d->args.opaque;
}

/* An upper bound, in mm, of the length of a unit vector of index space (Gershgorin's circle theorem for A'A). */
static double longest_voxel(const drawing *d) {
  double most = 0;
  for (int i = 0; i < 3; i++) {
    double sum = 0;
    for (int j = 0; j < 3; j++) {
      double product = 0;
      for (int r = 0; r < 3; r++) product += d->to_view[r][i] * d->to_view[r][j];
      sum += fabs(product);
    }
    most = fmax(most, sum);
  }
  return sqrt(most);
}

static void add_entries(drawing *d, const tc_splats *of, tc_splat_entry *entries, int *count) {
  const double size_mm = longest_voxel(d);
  tc_splat_brick brick = {0};
  size_t from = 0;
  for (uint32_t i = 0; of && i < of->n_bricks; i++) {
    tc_splats_next(of, &from, &brick);
    *count += set_entry(d, of, &brick, size_mm, &entries[*count]);
  }
}

/* Nearest first, by a 4096th of the range. The order changes no bit, only how much is occluded early. */
static void sort_entries(const tc_splat_entry *from, int count, tc_splat_entry *to) {
  enum { buckets = 4096 };
  int starts[buckets + 1] = {0};
  float lo = INFINITY, hi = -INFINITY;
  for (int i = 0; i < count; i++) lo = fminf(lo, from[i].near_mm), hi = fmaxf(hi, from[i].near_mm);
  const float scale = hi > lo ? (buckets - 1) / (hi - lo) : 0;
  for (int i = 0; i < count; i++) starts[1 + (int)((from[i].near_mm - lo) * scale)]++;
  for (int i = 0; i < buckets; i++) starts[i + 1] += starts[i];
  for (int i = 0; i < count; i++) to[starts[(int)((from[i].near_mm - lo) * scale)]++] = from[i];
}

static bool collect_entries(drawing *d, GError **error) {
  const tc_splats *cut = d->job->cut;
  const size_t most = (size_t)d->job->splats->n_bricks + (cut ? cut->n_bricks : 0) + 1;
  tc_splat_entry *entries = malloc(most * sizeof *entries);
  d->entries = malloc(most * sizeof *entries);
  bool good = entries && d->entries;
  if (good) {
    add_entries(d, d->job->splats, entries, &d->n_entries);
    add_entries(d, cut, entries, &d->n_entries);
    sort_entries(entries, d->n_entries, d->entries);
  } else {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
  }
  free(entries);
  return good;
}

/* ---- tiles ---- */

/* The entry's box within the tile; false: empty. */
static bool box_in_tile(const tc_splat_entry *e, const tc_splat_tile *t, int box[4]) {
  const float last[2] = {(float)(t->width - 1), (float)(t->height - 1)}, at[2] = {(float)t->x0, (float)t->y0};
  for (int k = 0; k < 2; k++) {
    const float lo = e->box[k] - at[k], hi = e->box[2 + k] - at[k];
    if (lo > last[k] || hi < 0) return false;
    box[k] = lo > 0 ? (int)lo : 0;
    box[2 + k] = (int)fminf(hi, last[k]);
  }
  return true;
}

/* Translucent: draws the sheets on one side of the eye, nearest first. False: halted. */
static bool pass_sheets(const drawing *d, tc_splat_tile *t, int axis, int side) {
  const int n = tc_volume_describe(d->job->volume)->dims[axis], last = (n - 1) / TC_SPLAT_BRICK;
  const int eye = (int)fmin(fmax(ceil(d->eye[axis]), 0), n); /* the first sheet not below the eye */
  int sheet = side > 0 ? eye : eye - 1;
  for (; sheet >= 0 && sheet / TC_SPLAT_BRICK <= last && sheet < n; sheet += side) {
    for (int i = d->layers[sheet / TC_SPLAT_BRICK]; i < d->layers[sheet / TC_SPLAT_BRICK + 1]; i++) {
      int box[4];
      if (!box_in_tile(&d->entries[i], t, box)) continue;
      d->kernels->sheet(&d->args, &d->entries[i], axis, sheet % TC_SPLAT_BRICK, t);
      if (t->halted) return false;
    }
    if (t->touched[2] >= t->touched[0]) d->kernels->compose(t);
  }
  return true;
}

int tc_splat_sheet_axis(const tc_splat_args *g) {
  int axis = 0;
  for (int k = 1; k < 3; k++)
    if (fabsf(g->to_index[k][2]) > fabsf(g->to_index[axis][2])) axis = k;
  return axis;
}

/* Sorts entries by layers of bricks along the sheets' axis. */
static bool sort_layers(drawing *d, GError **error) {
  const int axis = tc_splat_sheet_axis(&d->args),
            n = tc_volume_describe(d->job->volume)->dims[axis] / TC_SPLAT_BRICK + 1;
  tc_splat_entry *sorted = malloc(((size_t)d->n_entries + 1) * sizeof *sorted);
  d->layers = calloc((size_t)n + 2, sizeof *d->layers);
  if (!sorted || !d->layers) {
    free(sorted);
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
    return false;
  }
  int *next = d->layers + 1; /* becomes the layers' ends */
  for (int i = 0; i < d->n_entries; i++) next[1 + d->entries[i].brick.at[axis]]++;
  for (int l = 0; l < n; l++) next[l + 1] += next[l];
  for (int i = 0; i < d->n_entries; i++) sorted[next[d->entries[i].brick.at[axis]]++] = d->entries[i];
  free(d->entries);
  d->entries = sorted;
  return true;
}

/* Range of tiles along x (k = 0) or y that an entry's box meets. */
static void tiles_of(const tc_splat_entry *e, int k, int n, int *first, int *last) {
  *first = (int)fminf(fmaxf(e->box[k], 0) / TC_TILE, (float)n);
  *last = (int)fminf(fmaxf(e->box[2 + k] / TC_TILE, -1), (float)(n - 1));
}

/* Lists the entries whose boxes meet each tile, in the order of the entries. */
static bool sort_into_tiles(drawing *d, GError **error) {
  const int across = (d->job->frame->width + TC_TILE - 1) / TC_TILE,
            down = (d->job->frame->height + TC_TILE - 1) / TC_TILE;
  d->tile_first = calloc((size_t)(across * down) + 2, sizeof *d->tile_first);
  for (int pass = 0; pass < 2 && d->tile_first; pass++) {
    int *next = d->tile_first + 1; /* counts, then firsts, which become ends */
    for (int i = 0; i < d->n_entries; i++) {
      int x0, x1, y0, y1;
      tiles_of(&d->entries[i], 0, across, &x0, &x1), tiles_of(&d->entries[i], 1, down, &y0, &y1);
      for (int y = y0; y <= y1; y++)
        for (int x = x0; x <= x1; x++)
          if (pass)
            d->tile_entries[next[y * across + x]++] = i;
          else
            next[y * across + x + 1]++;
    }
    for (int t = 0; t < across * down && !pass; t++) next[t + 1] += next[t];
    if (!pass && !(d->tile_entries = malloc(((size_t)next[across * down] + 1) * sizeof *d->tile_entries))) break;
  }
  if (!d->tile_entries) tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
  return d->tile_entries != NULL;
}

/* False if the entry does not meet the tile or the depths occlude it there. */
static bool shows(const drawing *d, const tc_splat_entry *e, tc_splat_tile *t) {
  int box[4];
  if (!box_in_tile(e, t, box)) return false;
  if (!d->args.culling) return true;
  tc_tile_refresh(t, box);
  return !tc_tile_hides(t, box[0], box[1], box[2], box[3], e->near_mm - d->args.window_mm);
}

static bool has_room(const drawing *d, const tc_splat_entry *e, const tc_splat_tile *t) {
  const size_t batches = (e->brick.count + d->kernels->lanes - 1) / d->kernels->lanes;
  return ((size_t)t->n_kept + batches) * d->kernels->batch <= TC_TILE_KEPT;
}

/* The depth pass draws the depths of the tile's entries, nearest first, and keeps the projected splats that are not occluded,
 * while there is room. The colour pass then draws the kept splats and the remaining entries. False: halted. */
static bool pass(const drawing *d, tc_splat_tile *t, int tile) {
  const int *entries = d->tile_entries + d->tile_first[tile], n = d->tile_first[tile + 1] - d->tile_first[tile];
  int kept = 0;
  t->n_kept = 0, t->keeps = d->args.culling;
  for (int i = 0; i < n && !t->halted; i++) {
    const tc_splat_entry *e = &d->entries[entries[i]];
    const bool wanted = shows(d, e, t);
    t->keeps = t->keeps && (!wanted || has_room(d, e, t));
    kept += t->keeps;
    if (wanted) d->kernels->depths(&d->args, e, t);
  }
  if (t->halted) return false;
  if (d->args.culling) tc_tile_refresh(t, (int[]){0, 0, TC_TILE - 1, TC_TILE - 1});
  d->kernels->kept(&d->args, t);
  for (int i = kept; i < n && !t->halted; i++)
    if (shows(d, &d->entries[entries[i]], t)) d->kernels->colors(&d->args, &d->entries[entries[i]], t);
  return !t->halted;
}

/* Opaque: depths beyond the picture occlude everything. */
static void clear_tile(tc_splat_tile *t, const tc_splat_args *g) {
  for (int y = 0; y < TC_TILE; y++)
    for (int x = 0; x < TC_TILE_STRIDE; x++)
      t->depth[y * TC_TILE_STRIDE + x] = !g->opaque ? 1 : x < t->width && y < t->height ? INFINITY : -INFINITY;
  t->touched[0] = t->touched[1] = TC_TILE, t->touched[2] = t->touched[3] = -1;
  memset(t->sums, 0, (g->opaque && !g->material.color ? TC_SUM_COLOR : TC_SUMS) * sizeof *t->sums);
  t->halted = false;
  memset(t->stale, 0, sizeof t->stale);
  for (size_t i = 0; i < G_N_ELEMENTS(t->farthest); i++) t->farthest[i] = i < TC_TILE_BLOCKS * TC_TILE_BLOCKS ? INFINITY : -INFINITY;
  for (size_t i = 0; i < G_N_ELEMENTS(t->farthest_of_four); i++) t->farthest_of_four[i] = INFINITY;
}

/* Converts depths to mm from the eye along each pixel's ray. */
static void store_depths(const drawing *d, const tc_splat_tile *t, int y, float *to) {
  const tc_frame *f = d->job->frame;
  const double scale = (double)d->args.scale;
  for (int x = 0; x < t->width; x++) {
    const double dx = t->x0 + x + 0.5 - 0.5 * f->width, dy = t->y0 + y + 0.5 - 0.5 * f->height;
    const double stretch = d->args.perspective ? sqrt(1 + (dx * dx + dy * dy) / (scale * scale)) : 1;
    to[x] = d->args.opaque ? t->depth[y * TC_TILE_STRIDE + x] * (float)stretch : INFINITY;
  }
}

static void store_tile(const drawing *d, const tc_splat_tile *t, const float *out) {
  tc_frame *f = d->job->frame;
  for (int y = 0; y < t->height; y++) {
    const size_t at = (size_t)(t->y0 + y) * (size_t)f->width + (size_t)t->x0;
    const float *row = out + (size_t)y * (size_t)t->width * 4;
    tc_resolve_row(&d->resolve, row, f->rgba + 4 * at, t->width);
    if (d->job->want_linear) memcpy(f->linear + 4 * at, row, (size_t)t->width * 4 * sizeof *row);
    if (d->job->want_depth) store_depths(d, t, y, f->depth + at);
  }
}

static bool is_empty(const drawing *d, const tc_splat_tile *t, int tile) {
  int box[4];
  if (d->tile_entries) return d->tile_first[tile] == d->tile_first[tile + 1];
  for (int i = 0; i < d->n_entries; i++)
    if (box_in_tile(&d->entries[i], t, box)) return false;
  return true;
}

/* False: halted. */
static bool fill_tile(const drawing *d, tc_splat_tile *t, int tile, float *out) {
  const int axis = tc_splat_sheet_axis(&d->args);
  if (d->args.opaque) {
    if (!pass(d, t, tile)) return false;
    d->kernels->shade(&d->args, t, out);
  } else {
    if (!pass_sheets(d, t, axis, 1) || !pass_sheets(d, t, axis, -1)) return false;
    d->kernels->emit(t, out);
  }
  return true;
}

static void draw_tile(void *context, int index, int worker) {
  drawing *d = context;
  const tc_frame *f = d->job->frame;
  const int across = (f->width + TC_TILE - 1) / TC_TILE;
  if (d->progress->finished[index]) return;
  tc_splat_tile *t = &d->tiles[worker];
  t->x0 = index % across * TC_TILE, t->y0 = index / across * TC_TILE;
  t->width = MIN(TC_TILE, f->width - t->x0), t->height = MIN(TC_TILE, f->height - t->y0);
  clear_tile(t, &d->args);
  float *out = d->out + (size_t)worker * TC_TILE * TC_TILE * 4;
  if (is_empty(d, t, index))
    memset(out, 0, TC_TILE * TC_TILE * 4 * sizeof *out);
  else if (!fill_tile(d, t, index, out))
    return;
  store_tile(d, t, out);
  d->progress->finished[index] = true;
}

static bool make_tiles(drawing *d, GError **error) {
  const size_t threads = (size_t)tc_pool_threads(d->job->pool);
  bool good = (d->tiles = malloc(threads * sizeof *d->tiles)) != NULL;
  for (size_t i = 0; i < threads && good; i++) memset(&d->tiles[i], 0, offsetof(tc_splat_tile, kept));
  good = good && (d->out = malloc(threads * TC_TILE * TC_TILE * 4 * sizeof *d->out)) != NULL;
  if (!good) tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
  return good;
}

static void count(const drawing *d) {
  tc_splat_counts *c = d->job->counts;
  *c = (tc_splat_counts){
      .bricks = d->job->splats->n_bricks, .splats = d->job->splats->n, .entries = (uint64_t)d->n_entries};
  for (int i = 0; i < tc_pool_threads(d->job->pool); i++)
    c->visited += d->tiles[i].visited, c->depths += d->tiles[i].depths, c->drawn += d->tiles[i].drawn;
}

static void set_up(drawing *d) {
  d->args.opaque = d->job->scene->splat.opaque;
  d->args.culling = d->job->scene->splat.culling;
  d->args.material = d->job->material;
  d->args.halt = d->job->halt;
  for (int k = 0; k < 3; k++) {
    const double c = d->job->scene->isosurface.color[k];
    d->args.color[k] = (float)(d->job->scene->image.linear_light ? tc_srgb_to_linear(c) : c);
  }
  set_view(d);
  set_kernel(d);
  /* Kernels that are balls extend less than a pixel beyond the grid. */
  const unsigned sides = d->args.opaque && d->args.shape_blend > 0 ? d->job->splats->sides : 0;
  d->args.n_planes = tc_splat_planes(d->job->volume, d->job->scene, sides, d->planes);
  d->args.planes = (const double(*)[4])d->planes;
  if (d->args.opaque) d->args.clip_reach = (float)(sqrt((double)d->args.radius2) * tc_splat_longest_kernel(&d->args)) + d->args.shape_blend;
  if (!d->args.opaque) set_blur(d);
  set_light(d);
}

bool tc_splat_frame_begin(tc_splat_frame *f, const tc_splat_job *job, GError **error) {
  drawing d = {.job = job};
  set_up(&d);
  if (!collect_entries(&d, error)) {
    free(d.entries);
    return false;
  }
  *f = (tc_splat_frame){.args = d.args, .of = job->splats, .entries = d.entries, .n_entries = d.n_entries};
  memcpy(f->planes, d.planes, sizeof f->planes), memcpy(f->eye, d.eye, sizeof f->eye);
  f->args.planes = (const double(*)[4])f->planes;
  return true;
}

void tc_splat_frame_end(tc_splat_frame *f) { free(f->entries); }

bool tc_splat_draw(const tc_splat_job *job, GError **error) {
  drawing *d = calloc(1, sizeof *d);
  bool good = d != NULL;
  if (!d) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
    return false;
  }
  d->job = job;
  /* No AVX-512: footprints are a few pixels wide, and with 16 lanes frames took up to 10 % longer. */
  d->kernels = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && g_strcmp0(job->isa, "scalar") != 0
                   ? &tc_splat_avx2
                   : &tc_splat_scalar;
  set_up(d);
  tc_resolve_init(&d->resolve, job->scene);
  d->progress = tc_frame_cut(job->frame, TC_TILE, error);
  good = d->progress && make_tiles(d, error) && collect_entries(d, error) && (d->args.opaque ? sort_into_tiles : sort_layers)(d, error);
  if (good) tc_pool_run(job->pool, d->progress->units, draw_tile, d);
  if (good) {
    d->progress->done = 0;
    for (int i = 0; i < d->progress->units; i++) d->progress->done += d->progress->finished[i];
    good = d->progress->done == d->progress->units || tc_halt_say(job->halt, error);
  }
  if (good && job->counts) count(d);
  free(d->tiles);
  free(d->out);
  free(d->entries);
  free(d->layers);
  free(d->tile_entries);
  free(d->tile_first);
  free(d);
  return good;
}
