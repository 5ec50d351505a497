/* Surface of one label (mesh.h): the smoothed signed distance to the label's boundary is computed as a small volume, whose
 * isosurface at 0 is the label's surface.
 *
 * Distances are Euclidean, by a minimum along each axis in turn. Where slices lie far apart they are taken within the
 * slice alone, so that a boundary that moves from slice to slice becomes a ramp, not a step (shape-based
 * interpolation: Raya and Udupa, IEEE TMI 1990).
 *
 * Smoothing leaves each voxel on its side, except where slices lie far apart: the outlines of neighbouring slices were drawn one
 * by one and differ by a pixel or two, which would show as ridges. There the surface may leave the outlines by a quarter of the
 * distance of slices and two pixels, less where the part is thin, so that it survives.
 *
 * The filter is 2 g - g * g of a binomial g with a standard deviation of 1.22 voxels, and of 0.71 slices where those lie far
 * apart (with 1.22, slanting vessels lost a tenth of their volume). Its second moment is zero, so that round parts do not shrink
 * as they do under g alone, by variance / radius (Taubin, SIGGRAPH 1995, does this to meshes). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/mesh/mesh.h"
#include "renderer/volume/voxel.h"

#define RADIUS 6 /* of the filter, voxels */
#define REACH 15 /* largest distance, in voxels of the finest spacing; larger ones are clamped */
#define UNIT 8   /* squared distances are stored in (finest spacing / UNIT)^2 */
#define FAR (REACH * UNIT * REACH * UNIT)
#define SCALE 32   /* a distance is stored in finest spacing / (UNIT * SCALE) */
#define COARSE 2.0 /* slices further apart than this many times the finest spacing count as far apart */
#define SLACK 0.25 /* of the distance of slices that lie far apart: most by which the surface leaves an outline */
#define AROUND 2   /* voxels within which a part is thick enough for that, and the most that the surface moves */
#define STRIP 128  /* voxels processed together */
#define RIM 2      /* empty voxels around the surface, so that it is closed and has gradients */

/* Weights / 4096: of a binomial over 7 voxels, and over 3 slices that lie far apart. */
static const int32_t weights[2][2 * RADIUS + 1] = {{-1, -12, -66, -92, 273, 1128, 1636, 1128, 273, -92, -66, -12, -1},
                                                   {0, 0, 0, 0, -256, 1024, 2560, 1024, -256, 0, 0, 0, 0}};

typedef struct smoothing {
  const tc_volume *labels;
  int voxel;          /* the label as the volume stores it */
  int lo[3], dims[3]; /* first voxel of the field in the label volume, which may be negative; size of the field */
  int cost[3][2 * REACH + 1]; /* squared distance along an axis; unused above FAR */
  int slack;          /* most change of a distance by smoothing, as stored; 0: each voxel keeps its side */
  int16_t *field;
  int16_t *outlines;  /* the distances before smoothing; NULL if slack is 0 */
  int16_t **lines; /* [worker] buffer for the longest filtered slab */
} smoothing;

static int stored(const tc_volume *v, size_t i) {
  return (int)tc_voxel_at(tc_volume_describe(v)->type, tc_volume_data(v), i);
}

/* ---- where labels are ---- */

/* reach[] of the voxels that a worker has read; all are maxima, initially 0. */
typedef struct search {
  const tc_volume *labels;
  int n_values;
  int (*reach)[6]; /* [workers][n_values] */
} search;

static int bits_of(const tc_volume_desc *d, const void *data, size_t i) {
  return tc_voxel_size(d->type) == 1 ? ((const uint8_t *)data)[i] : ((const uint16_t *)data)[i];
}

static void reach_run(int reach[6], const int dims[3], int x, int end, int y, int z) {
  reach[0] = MAX(reach[0], dims[0] - x), reach[3] = MAX(reach[3], end);
  reach[1] = MAX(reach[1], dims[1] - y), reach[4] = MAX(reach[4], y + 1);
  reach[2] = MAX(reach[2], dims[2] - z), reach[5] = MAX(reach[5], z + 1);
}

static void search_plane(void *context, int z, int worker) {
  const search *s = context;
  const tc_volume_desc *d = tc_volume_describe(s->labels);
  const void *data = tc_volume_data(s->labels);
  int(*reach)[6] = s->reach + (size_t)worker * (size_t)s->n_values;
  for (int y = 0; y < d->dims[1]; y++) {
    const size_t row = ((size_t)z * (size_t)d->dims[1] + (size_t)y) * (size_t)d->dims[0];
    for (int x = 0, end; x < d->dims[0]; x = end) {
      const int bits = bits_of(d, data, row + (size_t)x);
      for (end = x + 1; end < d->dims[0] && bits_of(d, data, row + (size_t)end) == bits;) end++;
      reach_run(reach[bits], d->dims, x, end, y, z);
    }
  }
}

static bool is_whole(const tc_volume *labels, GError **error) {
  if (tc_volume_describe(labels)->type != TC_F32) return true;
  tc_set_error(error, TC_ERROR_INVALID, NULL, "surface of a label: the volume's voxels are not whole numbers");
  return false;
}

tc_label_boxes *tc_label_boxes_find(const tc_volume *labels, tc_pool *pool, GError **error) {
  if (!is_whole(labels, error)) return NULL;
  const tc_volume_desc *d = tc_volume_describe(labels);
  const int workers = pool ? tc_pool_threads(pool) : 1;
  search s = {.labels = labels, .n_values = tc_voxel_size(d->type) == 1 ? 256 : 65536};
  s.reach = g_try_malloc0((size_t)workers * (size_t)s.n_values * sizeof *s.reach);
  tc_label_boxes *boxes = g_try_malloc0(sizeof *boxes + (size_t)s.n_values * sizeof *boxes->reach);
  bool good = s.reach && boxes;
  if (!good) tc_set_error(error, TC_ERROR_MEMORY, NULL, "surfaces of labels: out of memory");
  good = good && (tc_pool_run(pool, d->dims[2], search_plane, &s) || tc_halt_say(tc_pool_halt(pool), error));
  for (int i = 0; i < workers * s.n_values && good; i++)
    for (int k = 0; k < 6; k++) boxes->reach[i % s.n_values][k] = MAX(boxes->reach[i % s.n_values][k], s.reach[i][k]);
  g_free(s.reach);
  if (good) boxes->n_values = s.n_values;
  if (!good) g_clear_pointer(&boxes, g_free);
  return boxes;
}

/* Returns false if the label does not occur. */
static bool place_field(smoothing *s, const tc_label_boxes *boxes) {
  const int *dims = tc_volume_describe(s->labels)->dims, *reach = boxes->reach[s->voxel & (boxes->n_values - 1)];
  for (int k = 0; k < 3; k++) {
    const int lo = dims[k] - reach[k], rim = s->slack ? RIM + AROUND : RIM;
    s->lo[k] = lo - rim;
    s->dims[k] = reach[3 + k] - lo + 2 * rim;
  }
  return reach[3] > 0;
}

/* ---- the field ---- */

static bool is_label(const smoothing *s, int x, int y, int z) {
  const int at[3] = {s->lo[0] + x, s->lo[1] + y, s->lo[2] + z}, *dims = tc_volume_describe(s->labels)->dims;
  for (int k = 0; k < 3; k++)
    if (at[k] < 0 || at[k] >= dims[k]) return false;
  return stored(s->labels, ((size_t)at[2] * (size_t)dims[1] + (size_t)at[1]) * (size_t)dims[0] + (size_t)at[0]) ==
         s->voxel;
}

static int16_t *row_of(const smoothing *s, int y, int z) {
  return s->field + ((size_t)z * (size_t)s->dims[1] + (size_t)y) * (size_t)s->dims[0];
}

typedef struct lines {
  int16_t *first; /* n rows of `width` voxels, `step` apart */
  size_t step;
  int n, width;
  int tap;       /* voxels between what a filter reads of a copy: 1 goes along a row, `width` across the rows */
  int16_t *copy; /* room for the rows end to end and a margin on either side */
} lines;

/* margin: voxels of `beyond` before and after. */
static void copy_lines(const lines *l, size_t margin, int16_t beyond) {
  const size_t n = (size_t)l->n * (size_t)l->width;
  for (size_t i = 0; i < margin; i++) l->copy[i] = l->copy[margin + n + i] = beyond;
  for (int i = 0; i < l->n; i++)
    memcpy(l->copy + margin + (size_t)i * (size_t)l->width, l->first + (size_t)i * l->step,
           (size_t)l->width * sizeof *l->copy);
}

/* Beyond the ends distances go on as they come there: nothing else is near. */
static void continue_lines(const lines *l) {
  const size_t tap = (size_t)l->tap, n = (size_t)l->n * (size_t)l->width;
  int16_t *first = l->copy + RADIUS * tap, *last = first + n - tap;
  for (size_t i = 0; i < tap && n > tap; i++) {
    const int before = first[i] - first[tap + i], after = last[i] - last[i - tap];
    for (int k = 1; k <= RADIUS; k++) {
      *(first + i - (size_t)k * tap) = (int16_t)(first[i] + k * before);
      last[(size_t)k * tap + i] = (int16_t)(last[i] + k * after);
    }
  }
}

/* Applies the filter to rows. */
static void filter(const lines *l, bool far) {
  const size_t tap = (size_t)l->tap;
  const int32_t *weight = weights[far];
  copy_lines(l, RADIUS * tap, 0);
  continue_lines(l);
  for (int i = 0; i < l->n; i++) {
    const int16_t *in = l->copy + (size_t)i * (size_t)l->width;
    int16_t *out = l->first + (size_t)i * l->step;
    for (int x = 0; x < l->width; x++) {
      int32_t sum = 2048;
      for (int k = 0; k <= 2 * RADIUS; k++) sum += weight[k] * in[(size_t)x + (size_t)k * tap];
      out[x] = (int16_t)(sum >> 12);
    }
  }
}

/* Adds one tap at a time for all voxels of a strip, in 16-bit vectors; the sum of two distances fits in 16 bits. */
static void measure_strip(const int16_t *in, int tap, const int cost[], int16_t *out, int n) {
  int16_t to_outside[STRIP], to_inside[STRIP];
  for (int x = 0; x < STRIP; x++) to_outside[x] = to_inside[x] = FAR;
  for (int k = 0; k <= 2 * REACH; k++) {
    if (cost[k] >= FAR) continue;
    const int16_t *there = in + (size_t)k * (size_t)tap, more = (int16_t)cost[k];
    for (int x = 0; x < n; x++) {
      const int16_t outside = (int16_t)(MAX(there[x], 0) + more), inside = (int16_t)(MAX(-there[x], 0) + more);
      to_outside[x] = MIN(to_outside[x], outside);
      to_inside[x] = MIN(to_inside[x], inside);
    }
  }
  for (int x = 0; x < n; x++) out[x] = (int16_t)(out[x] > 0 ? to_outside[x] : -to_inside[x]);
}

/* Signed squared distance to the nearest voxel on the other side: extends the distances of the previous axes by one axis.
 * Outside the field nothing belongs to the label. */
static void measure(const lines *l, const int cost[]) {
  copy_lines(l, REACH * (size_t)l->tap, -FAR);
  for (int i = 0; i < l->n; i++)
    for (int x = 0; x < l->width; x += STRIP)
      measure_strip(l->copy + (size_t)i * (size_t)l->width + (size_t)x, l->tap, cost,
                    l->first + (size_t)i * l->step + x, MIN(STRIP, l->width - x));
}

/* Distances along x at (y, z), across y at z, and across z at y. */
static lines along_x(const smoothing *s, int y, int z, int16_t *copy) {
  return (lines){row_of(s, y, z), 0, 1, s->dims[0], 1, copy};
}
static lines across_y(const smoothing *s, int z, int16_t *copy) {
  return (lines){row_of(s, 0, z), (size_t)s->dims[0], s->dims[1], s->dims[0], s->dims[0], copy};
}
static lines across_z(const smoothing *s, int y, int16_t *copy) {
  const size_t plane = (size_t)s->dims[0] * (size_t)s->dims[1];
  return (lines){row_of(s, y, 0), plane, s->dims[2], s->dims[0], s->dims[0], copy};
}

static void measure_plane(void *context, int z, int worker) {
  const smoothing *s = context;
  const lines across = across_y(s, z, s->lines[worker]);
  for (int y = 0; y < s->dims[1]; y++) {
    const lines along = along_x(s, y, z, s->lines[worker]);
    for (int x = 0; x < s->dims[0]; x++) along.first[x] = is_label(s, x, y, z) ? FAR : -FAR;
    if (s->cost[0][0]) measure(&along, s->cost[0]);
  }
  if (s->cost[1][0]) measure(&across, s->cost[1]);
}

/* Distances along z, no longer squared, and smoothed along z. */
static void finish_slab(void *context, int y, int worker) {
  const smoothing *s = context;
  const lines across = across_z(s, y, s->lines[worker]);
  if (s->cost[2][0]) measure(&across, s->cost[2]);
  for (int z = 0; z < s->dims[2]; z++) {
    int16_t *row = row_of(s, y, z);
    for (int x = 0; x < s->dims[0]; x++) {
      const float distance = sqrtf((float)abs(row[x])) * SCALE;
      row[x] = (int16_t)(row[x] > 0 ? distance : -distance);
    }
    if (s->outlines) memcpy(s->outlines + (row - s->field), row, (size_t)s->dims[0] * sizeof *row);
  }
  filter(&across, !s->cost[2][0]);
}

/* Restores the sign of each voxel that smoothing moved to the other side, so that thin parts survive and gaps stay open. */
static void keep_sides(const smoothing *s, int y, int z) {
  int16_t *row = row_of(s, y, z);
  for (int x = 0; x < s->dims[0]; x++) {
    const bool inside = is_label(s, x, y, z);
    if (inside != (row[x] >= 0)) row[x] = (int16_t)(-!inside - row[x]);
  }
}

/* The largest distance to the outline near a voxel and on its side: half the width of the part, or of the gap, that it is in. */
static int depth_near(const smoothing *s, const int at[3]) {
  int lo[3], hi[3], depth = 0;
  for (int k = 0; k < 3; k++) {
    const int around = s->cost[k][0] ? AROUND : 0;
    lo[k] = MAX(at[k] - around, 0), hi[k] = MIN(at[k] + around, s->dims[k] - 1);
  }
  const size_t plane = (size_t)s->dims[0] * (size_t)s->dims[1];
  const int16_t *first = s->outlines + (size_t)at[1] * (size_t)s->dims[0] + (size_t)at[2] * plane;
  const bool inside = first[at[0]] > 0;
  for (int z = lo[2]; z <= hi[2]; z++)
    for (int y = lo[1]; y <= hi[1]; y++) {
      const int16_t *row = s->outlines + (size_t)y * (size_t)s->dims[0] + (size_t)z * plane;
      for (int x = lo[0]; x <= hi[0]; x++) depth = MAX(depth, inside ? row[x] : -row[x]);
    }
  return depth;
}

/* Bounds how far smoothing moves the surface from the outlines, which pass half a voxel from the centres at either side. */
static void keep_near(const smoothing *s, int y, int z) {
  int16_t *row = row_of(s, y, z);
  const int16_t *outline = s->outlines + (row - s->field);
  for (int x = 0; x < s->dims[0]; x++) {
    const int half = UNIT * SCALE / 2, from = outline[x] > 0 ? outline[x] - half : outline[x] + half;
    if (abs(row[x] - from) <= MIN(s->slack, abs(from) / 2)) continue;
    const int most = MIN(s->slack, (depth_near(s, (int[3]){x, y, z}) - half) / 2);
    row[x] = (int16_t)CLAMP(row[x], from - most, from + most);
  }
}

static void smooth_plane(void *context, int z, int worker) {
  const smoothing *s = context;
  const lines across = across_y(s, z, s->lines[worker]);
  for (int y = 0; y < s->dims[1]; y++) {
    const lines along = along_x(s, y, z, s->lines[worker]);
    filter(&along, !s->cost[0][0]);
  }
  filter(&across, !s->cost[1][0]);
  for (int y = 0; y < s->dims[1]; y++) s->slack ? keep_near(s, y, z) : keep_sides(s, y, z);
}

/* Squared distances along each axis; 0 along an axis whose slices are far apart. */
static void set_costs(smoothing *s) {
  const double *spacing = tc_volume_describe(s->labels)->spacing;
  const double finest = fmin(fmin(spacing[0], spacing[1]), spacing[2]), widest = fmax(fmax(spacing[0], spacing[1]), spacing[2]);
  if (widest > COARSE * finest) s->slack = (int)(fmin(SLACK * widest / finest, AROUND) * UNIT * SCALE);
  for (int axis = 0; axis < 3; axis++)
    for (int k = -REACH; k <= REACH && spacing[axis] <= COARSE * finest; k++) {
      const double d = UNIT * k * spacing[axis] / finest;
      s->cost[axis][k + REACH] = (int)(d * d + 0.5);
    }
}

static tc_volume *make_field(smoothing *s, GError **error) {
  const tc_volume_desc *from = tc_volume_describe(s->labels);
  tc_volume_desc d = {.type = TC_I16, .slope = 1, .frames = 1};
  double first[3];
  for (int k = 0; k < 3; k++) {
    first[k] = s->lo[k];
    d.dims[k] = s->dims[k];
    d.spacing[k] = from->spacing[k];
  }
  memcpy(d.direction, from->direction, sizeof d.direction);
  tc_volume_index_to_lps(s->labels, first, d.origin);
  return tc_volume_new(&d, error);
}

static bool make_distances(smoothing *s, tc_pool *pool, GError **error) {
  const size_t n = (size_t)s->dims[0] * (size_t)s->dims[1] * (size_t)s->dims[2];
  const int threads = pool ? tc_pool_threads(pool) : 1;
  const size_t line = (size_t)s->dims[0] * (size_t)(MAX(s->dims[1], s->dims[2]) + 2 * REACH) * sizeof(int16_t);
  bool room = (s->lines = calloc((size_t)threads, sizeof *s->lines)) != NULL;
  for (int i = 0; room && i < threads; i++) room = (s->lines[i] = malloc(line)) != NULL;
  if (s->slack) room = room && (s->outlines = malloc(n * sizeof *s->outlines)) != NULL;
  if (!room) tc_set_error(error, TC_ERROR_MEMORY, NULL, "surface of a label: out of memory");
  const bool done =
      room && ((tc_pool_run(pool, s->dims[2], measure_plane, s) && tc_pool_run(pool, s->dims[1], finish_slab, s) &&
                tc_pool_run(pool, s->dims[2], smooth_plane, s)) ||
               tc_halt_say(tc_pool_halt(pool), error));
  for (int i = 0; s->lines && i < threads; i++) free(s->lines[i]);
  free(s->lines);
  free(s->outlines);
  return done;
}

/* ---- all ---- */

/* The label's stored value; returns false if no voxel can have it. */
static bool store_label(const tc_volume *labels, uint32_t label, int *voxel) {
  const tc_volume_desc *d = tc_volume_describe(labels);
  const double v = (label - d->intercept) / d->slope;
  *voxel = fabs(v) < 1e6 ? (int)v : 0;
  return fabs(v) < 1e6 && v == *voxel;
}

static tc_mesh *extract(smoothing *s, const tc_mesh_options *options, GError **error) {
  tc_volume *field = make_field(s, error);
  if (!field) return NULL;
  s->field = tc_volume_voxels(field);
  tc_mesh *mesh = NULL;
  if (make_distances(s, options->pool, error)) {
    tc_volume_seal_within(field, INT16_MIN, INT16_MAX);
    mesh = tc_mesh_extract(field, 0, options, error);
  }
  tc_volume_unref(field);
  return mesh;
}

tc_mesh *tc_mesh_extract_label(const tc_volume *labels, uint32_t label, const tc_label_boxes *boxes,
                               const tc_mesh_options *options, GError **error) {
  smoothing s = {.labels = labels};
  if (!is_whole(labels, error)) return NULL;
  tc_label_boxes *own = boxes ? NULL : tc_label_boxes_find(labels, options->pool, error);
  if (!boxes && !own) return NULL;
  set_costs(&s);
  const bool found = store_label(labels, label, &s.voxel) && place_field(&s, boxes ? boxes : own);
  g_free(own);
  return found ? extract(&s, options, error) : tc_mesh_new(0, 0, options->normals, error);
}
