/* Models of volumes: which voxels a threshold or labels fill, and the records of these voxels. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/base/vector.h"
#include "renderer/classify/labels.h"
#include "renderer/scene/scene.h"
#include "renderer/splat/normal.h"
#include "renderer/splat/vmd.h"
#include "renderer/volume/provenance.h"
#include "renderer/volume/voxel.h"

/* An attribute whose numbers come from another volume. */
typedef struct attribute_source {
  const tc_volume *of;
  double matrix[3][4];     /* to its index coordinates */
  double slope, intercept; /* from its stored voxels to numbers */
  double outside;          /* number outside of it, and the least */
  int at;                  /* byte offset in a record */
  tc_voxel_type type;
} attribute_source;

struct tc_vmd_object {
  const tc_volume *volume;
  const tc_volume_desc *d;
  const void *data;    /* NULL: of a model */
  const uint8_t *gaps; /* as tc_volume_gaps(); NULL: none */
  const tc_vmd *model; /* NULL: there is a grid */
  double low, high;    /* stored voxels in this range are filled */
  bool (*shows)(const void *user, double voxel);
  const void *shows_user;
  double to_index[9];
  int own, normal; /* byte offsets in a record of the volume's voxel and of the normal; -1: not there */
  attribute_source sources[TC_VMD_ATTRIBUTES];
  int n_sources;
  bool labels; /* the volume is a label map */
  bool steps;  /* values tell filled from free alone: labels, masks */
};
typedef struct tc_vmd_object object;

/* ---- which voxels ---- */

static size_t voxel_index(const object *s, int x, int y, int z) {
  return ((size_t)z * (size_t)s->d->dims[1] + (size_t)y) * (size_t)s->d->dims[0] + (size_t)x;
}

#define FILL_ROWS(name, type)                                                                                          \
  static void fill_##name(const object *s, int y, uint64_t *bits) {                                                   \
    const size_t nx = (size_t)s->d->dims[0], ny = (size_t)s->d->dims[1];                                               \
    const type low = (type)s->low, high = (type)s->high;                                                               \
    for (int z = 0; z < s->d->dims[2]; z++) {                                                                          \
      const type *from = (const type *)s->data + ((size_t)z * ny + (size_t)y) * nx;                                    \
      uint64_t *to = bits + (size_t)(z / 64) * nx;                                                                     \
      for (size_t x = 0; x < nx; x++) to[x] |= (uint64_t)(from[x] >= low && from[x] <= high) << z % 64;                \
    }                                                                                                                  \
  }
FILL_ROWS(u8, uint8_t)
FILL_ROWS(i8, int8_t)
FILL_ROWS(u16, uint16_t)
FILL_ROWS(i16, int16_t)
FILL_ROWS(f32, float)

static bool is_filled(const object *s, double voxel) {
  return s->shows ? s->shows(s->shows_user, voxel) : voxel >= s->low && voxel <= s->high;
}

static void fill_one_by_one(const object *s, int y, uint64_t *bits) {
  const size_t nx = (size_t)s->d->dims[0];
  for (int z = 0; z < s->d->dims[2]; z++)
    for (int x = 0; x < s->d->dims[0]; x++)
      bits[(size_t)(z / 64) * nx + (size_t)x] |=
          (uint64_t)is_filled(s, tc_voxel_at(s->d->type, s->data, voxel_index(s, x, y, z))) << z % 64;
}

/* NaN voxels are free. */
static void clear_gaps(const object *s, int y, uint64_t *bits) {
  const size_t nx = (size_t)s->d->dims[0];
  for (int z = 0; z < s->d->dims[2]; z++)
    for (int x = 0; x < s->d->dims[0]; x++)
      if (s->gaps[voxel_index(s, x, y, z)]) bits[(size_t)(z / 64) * nx + (size_t)x] &= ~(1ull << z % 64);
}

static void fill_by_range(const object *s, int y, uint64_t *bits) {
  switch (s->d->type) {
  case TC_U8: fill_u8(s, y, bits); break;
  case TC_I8: fill_i8(s, y, bits); break;
  case TC_U16: fill_u16(s, y, bits); break;
  case TC_I16: fill_i16(s, y, bits); break;
  case TC_F32: fill_f32(s, y, bits); break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
}

static void fill(void *user, int y, uint64_t *bits) {
  const object *s = user;
  if (s->low > s->high && !s->shows) return;
  if (s->shows)
    fill_one_by_one(s, y, bits);
  else
    fill_by_range(s, y, bits);
  if (s->gaps) clear_gaps(s, y, bits);
}

/* Range of stored voxels whose values are in the range. Integers: the first and last such voxel, so that comparing stored
 * voxels equals comparing values. Floats: the range itself, clamped to the volume's. low > high: no voxel. */
static void stored_range(object *s, double low, double high) {
  const tc_volume_stats *stats = tc_volume_statistics(s->volume);
  double a = (low - s->d->intercept) / s->d->slope, b = (high - s->d->intercept) / s->d->slope;
  s->low = fmax(fmin(a, b), stats->voxel_min), s->high = fmin(fmax(a, b), stats->voxel_max);
  if (s->d->type == TC_F32 || s->low > s->high) return;
  s->low = floor(s->low), s->high = ceil(s->high); /* the loops below undo rounding of the division */
  while (s->low <= s->high &&
         !(s->d->slope * s->low + s->d->intercept >= low && s->d->slope * s->low + s->d->intercept <= high))
    s->low++;
  while (s->low <= s->high &&
         !(s->d->slope * s->high + s->d->intercept >= low && s->d->slope * s->high + s->d->intercept <= high))
    s->high--;
}

/* ---- records ---- */

/* Distance of a voxel's value from the nearer end of the object's range, positive inside; an end that no voxel is beyond
 * does not count; with neither, from the least value. Label maps: 1 inside, -1 outside. */
static double inside_by_value(const object *s, size_t i) {
  const tc_volume_stats *stats = tc_volume_statistics(s->volume);
  double v = tc_voxel_at(s->d->type, s->data, i), above = v - s->low, below = s->high - v;
  if (s->labels) return above >= 0 && below >= 0 ? 1 : -1;
  if (s->low <= stats->voxel_min && s->high >= stats->voxel_max) return v - stats->voxel_min;
  if (s->low <= stats->voxel_min) return below;
  return s->high >= stats->voxel_max ? above : fmin(above, below);
}

/* A gap is as far outside as its surroundings are inside: the surface lies half way to a gap. */
static double inside_at(const object *s, size_t i) {
  const double inside = inside_by_value(s, i);
  return s->gaps && s->gaps[i] ? fmin(-fabs(inside), -FLT_MIN) : inside;
}

typedef struct spot {
  int at[3];
} spot;

static double inside_of(const object *s, spot p, int axis, int step) {
  p.at[axis] = MIN(MAX(p.at[axis] + step, 0), s->d->dims[axis] - 1);
  return inside_at(s, voxel_index(s, p.at[0], p.at[1], p.at[2]));
}

/* The slope towards the outside half way between a voxel and its neighbour beyond a face, a mm: along the face's axis
 * their difference, along others the mean of their central differences. */
static void slope_at_face(const object *s, spot p, int axis, int step, double slope[3]) {
  spot q = p;
  q.at[axis] += step;
  for (int k = 0; k < 3; k++) {
    if (k == axis)
      slope[k] = step * (inside_of(s, p, k, 0) - inside_of(s, q, k, 0));
    else
      slope[k] =
          0.25 * (inside_of(s, p, k, -1) - inside_of(s, p, k, 1) + inside_of(s, q, k, -1) - inside_of(s, q, k, 1));
    slope[k] /= s->d->spacing[k];
  }
}

/* Faces at which only the grid ends the object, half a voxel beyond its last voxels. */
static void add_ends(const object *s, spot p, double sum[3], double crossing[6]) {
  for (int f = 0; f < 6; f++) {
    const int step = f & 1 ? 1 : -1, beyond = p.at[f / 2] + step;
    if (beyond >= 0 && beyond < s->d->dims[f / 2]) continue;
    sum[f / 2] += step;
    crossing[f] = 0.5;
  }
}

/* Sums the slopes at the voxel's free faces; sets the distance to the surface through each face in voxels (negative: the face is not
 * free). Opposite faces of an object one voxel thick are added with the same sign; that sign is arbitrary. */
static void normal_of_faces(const object *s, spot p, double sum[3], double crossing[6]) {
  const double here = inside_of(s, p, 0, 0);
  bool any = false;
  for (int k = 0; k < 3; k++) sum[k] = 0;
  for (int f = 0; f < 6; f++) {
    const int axis = f / 2, step = f & 1 ? 1 : -1, beyond = p.at[axis] + step;
    double slope[3];
    crossing[f] = -1;
    if (beyond < 0 || beyond >= s->d->dims[axis]) continue;
    const double there = inside_of(s, p, axis, step);
    if (there >= 0) continue;
    any = true;
    if (here >= 0) crossing[f] = here / (here - there);
    slope_at_face(s, p, axis, step, slope);
    const double side = dot3(sum, slope) < 0 ? -1 : 1;
    for (int k = 0; k < 3; k++) sum[k] += side * slope[k];
  }
  if (!any) add_ends(s, p, sum, crossing);
}

/* Distance of the surface along the normal, in voxels: the mean over the crossings, each as if the surface were a plane. */
static double distance_of(const object *s, const double normal[3], const double crossing[6]) {
  double along[3], sum = 0, faces = 0;
  for (int k = 0; k < 3; k++) along[k] = normal[k] * s->d->spacing[k];
  const double length = length3(along);
  for (int f = 0; f < 6; f++)
    if (crossing[f] >= 0) sum += crossing[f] * fabs(along[f / 2]), faces++;
  return length > 0 && faces > 0 ? sum / (length * faces) : -1;
}

/* Central differences, for voxels without a free face. */
static void slope_within(const object *s, spot p, double slope[3]) {
  for (int k = 0; k < 3; k++) slope[k] = (inside_of(s, p, k, -1) - inside_of(s, p, k, 1)) / s->d->spacing[k];
}

#define AROUND 2 /* voxels */

/* Direction to the free side of the voxels around one: minus the sum of the filled voxels' offsets. */
static void slope_around(const object *s, spot p, double slope[3]) {
  int sum[3] = {0};
  for (int i = 0; i < 125; i++) {
    const int step[3] = {i % 5 - AROUND, i / 5 % 5 - AROUND, i / 25 - AROUND};
    bool filled = true;
    spot q;
    for (int k = 0; k < 3; k++) {
      q.at[k] = p.at[k] + step[k];
      filled = filled && q.at[k] >= 0 && q.at[k] < s->d->dims[k];
    }
    if (!filled || inside_at(s, voxel_index(s, q.at[0], q.at[1], q.at[2])) < 0) continue;
    for (int k = 0; k < 3; k++) sum[k] -= step[k];
  }
  for (int k = 0; k < 3; k++) slope[k] = sum[k] / s->d->spacing[k];
}

/* The voxels around a position and their trilinear weights, at[] and weights[] of 8. */
static void corners_of(const object *s, const double at[3], spot corners[8], double weights[8]) {
  for (int corner = 0; corner < 8; corner++) {
    weights[corner] = 1;
    for (int k = 0; k < 3; k++) {
      const int low = (int)floor(at[k]), up = corner >> k & 1;
      weights[corner] *= up ? at[k] - low : 1 - (at[k] - low);
      corners[corner].at[k] = MIN(MAX(low + up, 0), s->d->dims[k] - 1);
    }
  }
}

/* Replaces the normal by the slope at the surface, `distance` voxels along the normal: interpolated central differences, as in the
 * ray caster. The normal stays if the object ends at the grid, or if that slope points into the object. */
static void move_to_surface(const object *s, spot p, double distance, const double crossing[6], double normal[3]) {
  double along[3], at[3], slope[3] = {0}, weights[8];
  spot corners[8];
  for (int k = 0; k < 3; k++) {
    if (p.at[k] == 0 || p.at[k] == s->d->dims[k] - 1) return;
    along[k] = normal[k] * s->d->spacing[k];
  }
  normalise3(along);
  for (int k = 0; k < 3; k++) at[k] = p.at[k] + fmin(distance, 1) * along[k];
  corners_of(s, at, corners, weights);
  for (int i = 0; i < 8; i++) {
    double own[3];
    slope_within(s, corners[i], own);
    for (int k = 0; k < 3; k++) slope[k] += weights[i] * own[k];
  }
  if (dot3(slope, normal) > 0) memcpy(normal, slope, sizeof slope);
}

double tc_vmd_normal_at(const void *user, int x, int y, int z, double n[3]) {
  const object *s = user;
  const spot p = {{x, y, z}};
  double g[3], around[3] = {0}, crossing[6];
  normal_of_faces(s, p, g, crossing);
  const double distance = distance_of(s, g, crossing);
  bool seen = false;
  for (int f = 0; f < 6; f++) seen = seen || crossing[f] >= 0;
  if (s->steps && seen) slope_around(s, p, around);
  if (dot3(around, around) > 0)
    memcpy(g, around, sizeof g);
  else if (dot3(g, g) == 0)
    slope_within(s, p, g);
  else if (distance >= 0 && !s->steps)
    move_to_surface(s, p, distance, crossing, g);
  /* A covector, for any axes. */
  for (int r = 0; r < 3; r++) {
    n[r] = 0;
    for (int k = 0; k < 3; k++) n[r] += g[k] * s->d->spacing[k] * s->to_index[3 * k + r];
  }
  return distance;
}

/* Between voxels: trilinear. */
static double inside_between(const object *s, const double at[3]) {
  double sum = 0, weights[8];
  spot corners[8];
  corners_of(s, at, corners, weights);
  for (int i = 0; i < 8; i++)
    if (weights[i] > 0) sum += weights[i] * inside_at(s, voxel_index(s, corners[i].at[0], corners[i].at[1], corners[i].at[2]));
  return sum;
}

#define END_STEPS 8

double tc_vmd_end_at(const void *user, const int at[3], const double direction[3], double most) {
  const object *s = user;
  double before = 0;
  for (int i = 0; i <= END_STEPS; i++) {
    const double way = most * i / END_STEPS;
    const double to[3] = {at[0] + way * direction[0], at[1] + way * direction[1], at[2] + way * direction[2]};
    const double here = inside_between(s, to);
    if (here < 0) return i ? way - most / END_STEPS * here / (here - before) : 0;
    before = here;
  }
  return most;
}

/* Number of the nearest voxel. */
static double number_from(const attribute_source *f, const double at[3]) {
  double voxel;
  int nearest[3];
  for (int r = 0; r < 3; r++) {
    const double place = dot3(f->matrix[r], at) + f->matrix[r][3];
    nearest[r] = (int)floor(fmin(fmax(place, -1), tc_volume_describe(f->of)->dims[r]) + 0.5);
  }
  return tc_volume_voxel(f->of, nearest, &voxel) ? fmax(f->slope * voxel + f->intercept, f->outside) : f->outside;
}

static void record(void *user, int x, int y, int z, uint8_t *to) {
  const object *s = user;
  const size_t i = voxel_index(s, x, y, z), size = tc_voxel_size(s->d->type);
  if (s->own >= 0) memcpy(to + s->own, (const uint8_t *)s->data + i * size, size);
  for (int k = 0; k < s->n_sources; k++)
    tc_vmd_store(s->sources[k].type, number_from(&s->sources[k], (double[]){x, y, z}), to + s->sources[k].at);
  if (s->normal >= 0) {
    double n[3];
    tc_vmd_normal_at(s, x, y, z, n);
    uint16_t packed = tc_normal_pack(n);
    memcpy(to + s->normal, &packed, 2);
  }
}

static object object_of(const tc_volume *volume, double low, double high) {
  object s = {.volume = volume,
               .d = tc_volume_describe(volume),
               .data = tc_volume_data(volume),
               .gaps = tc_volume_gaps(volume) ? tc_volume_data(tc_volume_gaps(volume)) : NULL,
               .model = tc_volume_model(volume),
               .own = -1,
               .normal = -1};
  const tc_volume_stats *range = tc_volume_statistics(volume);
  s.steps = s.d->type != TC_F32 && range->voxel_max - range->voxel_min <= 1;
  stored_range(&s, low, high);
  tc_volume_lps_to_index_matrix(volume, s.to_index);
  return s;
}

tc_vmd_object *tc_vmd_object_new(const tc_volume *volume, double low, double high) {
  object *s = malloc(sizeof *s);
  if (s) *s = object_of(volume, low, high);
  return s;
}

void tc_vmd_object_free(tc_vmd_object *object) { free(object); }

/* ---- options ---- */

/* Attributes "label" and "user" hold numbers, "value" stored voxels, whose scale the model has. */
static void add_source(object *s, tc_vmd_head *head, const tc_volume *of, bool value) {
  const tc_volume_desc *d = tc_volume_describe(of);
  const tc_volume_stats *range = tc_volume_statistics(of);
  attribute_source *f = &s->sources[s->n_sources++];
  *f = (attribute_source){.of = of, .slope = d->slope, .intercept = d->intercept, .at = head->record_bytes};
  f->type = range->max <= UINT8_MAX ? TC_U8 : TC_U16;
  tc_labels_matrix(s->volume, of, f->matrix);
  if (!value) return;
  f->type = d->type, f->slope = 1, f->intercept = 0, f->outside = range->voxel_min;
  head->grid.slope = d->slope, head->grid.intercept = d->intercept;
  memcpy(head->grid.unit, d->unit, sizeof d->unit), memcpy(head->grid.modality, d->modality, sizeof d->modality);
}

static bool add_attribute(tc_vmd_head *head, object *s, const char *name, const tc_vmd_options *options, GError **error) {
  const bool value = strcmp(name, "value") == 0, label = strcmp(name, "label") == 0, user = strcmp(name, "user") == 0;
  const bool own = options->labels ? label : value;
  const tc_volume *of = value ? options->value_of : label ? options->label_of : user ? options->user_of : NULL;
  tc_vmd_type type = TC_VMD_U8;
  if (own) {
    s->own = head->record_bytes, type = (tc_vmd_type)s->d->type;
  } else if (of) {
    add_source(s, head, of, value);
    type = (tc_vmd_type)s->sources[s->n_sources - 1].type;
  } else if (strcmp(name, "normal") == 0) {
    s->normal = head->record_bytes, type = TC_VMD_NORMAL;
  } else if (!user) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "attributes: %s expected, separated by commas",
                 options->labels ? "label, normal or user (a label map has no values)"
                              : "value, normal or user (labels are those of a label map)");
    return false;
  }
  return tc_vmd_head_add(head, name, type, error);
}

static bool holds(const char *name, const tc_volume *of, double most, GError **error) {
  const tc_volume_stats *range = tc_volume_statistics(of);
  if (range->max <= most && (range->min >= 0 || most > UINT8_MAX)) return true;
  tc_set_error(error, TC_ERROR_INVALID, NULL, "%s: whole numbers from 0 to %g expected, the volume holds %g to %g", name,
               most, range->min, range->max);
  return false;
}

/* Negative numbers mean no label. */
static bool check_sources(const tc_volume *volume, const tc_vmd_options *options, GError **error) {
  if (options->value_of && !tc_labels_fit(options->value_of, volume, "labels", error)) return false;
  if (options->label_of && !(tc_labels_fit(volume, options->label_of, "labels", error) &&
                          holds("labels", options->label_of, UINT16_MAX, error)))
    return false;
  return !options->user_of ||
         (tc_labels_fit(volume, options->user_of, "user", error) && holds("user", options->user_of, UINT8_MAX, error));
}

static bool keeps(const void *user, const uint8_t *record) {
  const object *s = user;
  const tc_vmd_attribute *a = tc_vmd_value_attribute(&s->model->head);
  return is_filled(s, a ? tc_vmd_number(a, record) : 1);
}

static tc_vmd *part_of(const object *s, const tc_vmd_options *options, tc_pool *pool, GError **error) {
  if (!options->shell && (!options->attributes || !*options->attributes))
    return tc_vmd_make_part(&(tc_vmd_part){s->model, keeps, s}, pool, error);
  tc_set_error(error, TC_ERROR_INVALID, NULL, "attributes: the volume is a run-length model, which has its own");
  return NULL;
}

/* Colours of the segments, or the usual ones of their numbers. */
static void set_palette(tc_vmd_head *head, const tc_volume *labels) {
  size_t count;
  const double(*colors)[3] = tc_label_palette(&count);
  head->n_palette = TC_VMD_PALETTE;
  for (size_t label = 1; label < TC_VMD_PALETTE; label++) {
    const tc_segment *own = tc_volume_segment(labels, (uint32_t)label);
    for (int c = 0; c < 3; c++) {
      const double color = own && own->has_color ? (double)own->color[c] : colors[(label - 1) % count][c];
      head->palette[label][c] = (uint8_t)lround(fmin(fmax(color, 0), 1) * 255);
    }
    head->palette[label][3] = 255;
  }
}

tc_vmd *tc_vmd_of_volume(const tc_volume *volume, const tc_vmd_options *options, tc_pool *pool, GError **error) {
  object s = object_of(volume, options->low, options->high);
  s.shows = options->shows, s.shows_user = options->user;
  if (s.model) return part_of(&s, options, pool, error);
  if (!check_sources(volume, options, error)) return NULL;
  s.labels = options->labels, s.steps = s.steps || s.labels;
  tc_vmd_source source = {.head = {.grid = *s.d}, .shell = options->shell, .user = &s, .fill = fill, .record = record};
  char **names = g_strsplit(options->attributes ? options->attributes : "", ",", -1);
  bool good = true;
  for (char **name = names; *name && good; name++)
    good = add_attribute(&source.head, &s, g_strstrip(*name), options, error);
  g_strfreev(names);
  if (!good) return NULL;
  if (tc_vmd_attribute_named(&source.head, "label")) set_palette(&source.head, options->labels ? volume : options->label_of);
  return tc_vmd_make(&source, pool, error);
}
