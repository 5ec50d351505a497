/* The smooth surface of one label (tc_mesh_extract_label(), mesh/mesh.h), by its definition, in double precision and where a
 * ray asks for it: where the trilinear field of voxels F is 0.
 *
 * s: the signed distance from a voxel's centre to the nearest one of the other side, above 0 in the label, at most 15 times the
 * finest spacing. Only axes count along which voxels are at most 2 finest spacings apart. F is s filtered by 2 g - g * g, g
 * binomial over 7 voxels along axes that count and over 3 along others. If all count, F takes the sign of s: each voxel keeps its
 * side. Otherwise F is limited to o - m .. o + m, with o the distance from the outline, half a finest spacing less than s, and m the
 * least of a quarter of the largest spacing, two finest spacings, and half of the largest |o| on the voxel's side within two voxels
 * along the axes that count.
 *
 * A voxel more than two voxels from the other side keeps its side, so that F is needed near outlines alone: it is computed in
 * blocks of 8 x 8 x 8 voxels, each when it is first asked for, in about 2 ms. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/reference/internal.h"

enum { BLOCK = 8, RADIUS = 6, FAR_RADIUS = 2, REACH = 15, MARGIN = 4, AROUND = 2, TAPS = 2 * RADIUS + 1 };
#define COARSE 2.0
#define SLACK 0.25
#define LEAST 1e-9 /* of the finest spacing: what is outside is below 0 */

typedef double *values; /* [BLOCK][BLOCK][BLOCK] */

struct tc_ref_smooth {
  const tc_volume_desc *of;
  const void *voxels;
  tc_volume_desc desc; /* the label's box and MARGIN voxels around */
  int first[3];        /* the label volume's voxel that is its first */
  double label, finest, ratio[3]; /* mm; spacing in finest ones, 0 along axes that do not count */
  double weight[2][TAPS]; /* of the filter, and of that across slices that lie far apart */
  double slack;        /* mm; 0: each voxel keeps its side */
  int blocks[3];
  _Atomic(values) *block; /* [blocks[2]][blocks[1]][blocks[0]] */
};

/* ---- which labels there are, and where ---- */

static int bits_of(const tc_volume_desc *d, const void *voxels, size_t i) {
  const bool byte = d->type == TC_U8 || d->type == TC_I8;
  return byte ? ((const uint8_t *)voxels)[i] : ((const uint16_t *)voxels)[i];
}

static void reach_run(tc_ref_extent_of_label *e, int x, int end, int y, int z) {
  const int low[3] = {x, y, z}, high[3] = {end - 1, y, z};
  for (int k = 0; k < 3; k++) {
    e->low[k] = e->found ? (low[k] < e->low[k] ? low[k] : e->low[k]) : low[k];
    e->high[k] = e->found ? (high[k] > e->high[k] ? high[k] : e->high[k]) : high[k];
  }
  e->found = true;
}

tc_ref_extent_of_label *tc_ref_labels_find(const tc_volume *labels, const atomic_bool *cancel) {
  const tc_volume_desc *d = tc_volume_describe(labels);
  const void *voxels = tc_volume_data(labels);
  tc_ref_extent_of_label *all = calloc(TC_REF_LABELS, sizeof *all);
  for (int z = 0; z < d->dims[2] && all; z++) {
    for (int y = 0; y < d->dims[1]; y++) {
      const size_t row = ((size_t)z * (size_t)d->dims[1] + (size_t)y) * (size_t)d->dims[0];
      for (int x = 0, end; x < d->dims[0]; x = end) {
        const int bits = bits_of(d, voxels, row + (size_t)x);
        for (end = x + 1; end < d->dims[0] && bits_of(d, voxels, row + (size_t)end) == bits;) end++;
        if (!all[bits].found) all[bits].label = tc_ref_label_at(d, voxels, (int[3]){x, y, z});
        reach_run(&all[bits], x, end, y, z);
      }
    }
    if (cancel && atomic_load_explicit(cancel, memory_order_relaxed)) break;
  }
  return all;
}

/* ---- the field of a block ---- */

/* A box of numbers, x fastest. */
typedef struct box {
  int n[3];
  double *at;
} box;

static size_t stride_of(const box *b, int axis) {
  return axis == 0 ? 1 : axis == 1 ? (size_t)b->n[0] : (size_t)b->n[0] * (size_t)b->n[1];
}

/* Calls `line` for each line along the axis, of a box that is `shrink` numbers shorter there when that is done, in place. */
static void along(box *b, int axis, int shrink, const void *how,
                  void (*line)(const void *how, const double *in, double *out, int n)) {
  const box from = *b;
  double in[BLOCK + 2 * RADIUS + 2 * REACH], out[BLOCK + 2 * RADIUS + 2 * REACH];
  const int a = (axis + 1) % 3, c = (axis + 2) % 3, n = from.n[axis] - shrink;
  double *to = malloc((size_t)n * (size_t)from.n[a] * (size_t)from.n[c] * sizeof *to);
  b->n[axis] = n;
  for (int i = 0; i < from.n[c] && to; i++)
    for (int j = 0; j < from.n[a]; j++) {
      const double *first = from.at + (size_t)i * stride_of(&from, c) + (size_t)j * stride_of(&from, a);
      for (int k = 0; k < from.n[axis]; k++) in[k] = first[(size_t)k * stride_of(&from, axis)];
      line(how, in, out, n);
      double *last = to + (size_t)i * stride_of(b, c) + (size_t)j * stride_of(b, a);
      for (int k = 0; k < n; k++) last[(size_t)k * stride_of(b, axis)] = out[k];
    }
  free(from.at);
  b->at = to;
}

/* Squared distances: from those without this axis to those with it. */
static void nearest_line(const void *how, const double *in, double *out, int n) {
  const double ratio = *(const double *)how;
  for (int i = 0; i < n; i++) {
    double best = in[i + REACH];
    for (int k = 1; k <= REACH && (ratio * k) * (ratio * k) < best; k++) {
      const double a = in[i + REACH - k], b = in[i + REACH + k], here = (a < b ? a : b) + (ratio * k) * (ratio * k);
      best = here < best ? here : best;
    }
    out[i] = best;
  }
}

static void filter_line(const void *how, const double *in, double *out, int n) {
  const double *weight = how;
  for (int i = 0; i < n; i++) {
    out[i] = 0;
    for (int k = 0; k < TAPS; k++) out[i] += weight[k] * in[i + k];
  }
}

static bool is_member(const tc_ref_smooth *s, int x, int y, int z) {
  const int at[3] = {s->first[0] + x, s->first[1] + y, s->first[2] + z}, *dims = s->of->dims;
  for (int k = 0; k < 3; k++)
    if (at[k] < 0 || at[k] >= dims[k]) return false;
  return tc_ref_label_at(s->of, s->voxels, at) == s->label;
}

/* Which voxels are of the label: of a block that begins at `from`, and as far around as it reaches. */
static bool find_members(const tc_ref_smooth *s, const int from[3], box *members) {
  int before[3];
  for (int k = 0; k < 3; k++) {
    before[k] = RADIUS + (s->ratio[k] > 0 ? REACH : 0);
    members->n[k] = BLOCK + 2 * before[k];
  }
  members->at = malloc((size_t)members->n[0] * (size_t)members->n[1] * (size_t)members->n[2] * sizeof *members->at);
  size_t i = 0;
  for (int z = 0; z < members->n[2] && members->at; z++)
    for (int y = 0; y < members->n[1]; y++)
      for (int x = 0; x < members->n[0]; x++)
        members->at[i++] = is_member(s, from[0] + x - before[0], from[1] + y - before[1], from[2] + z - before[2]);
  return members->at != NULL;
}

/* To the nearest voxel of one side, in squared finest spacings. */
static bool measure(const tc_ref_smooth *s, const box *members, bool side, box *out) {
  const size_t n = (size_t)members->n[0] * (size_t)members->n[1] * (size_t)members->n[2];
  *out = (box){{members->n[0], members->n[1], members->n[2]}, malloc(n * sizeof *out->at)};
  for (size_t i = 0; i < n && out->at; i++) out->at[i] = (members->at[i] != 0) == side ? 0 : REACH * REACH;
  for (int k = 0; k < 3 && out->at; k++)
    if (s->ratio[k] > 0) along(out, k, 2 * REACH, &s->ratio[k], nearest_line);
  return out->at != NULL;
}

/* The signed distance of the voxels that are filtered, mm. */
static bool sign_distances(const tc_ref_smooth *s, const box *members, box *out) {
  box to[2] = {0};
  const bool good = measure(s, members, false, &to[0]) && measure(s, members, true, &to[1]);
  *out = to[0];
  const size_t n = good ? (size_t)out->n[0] * (size_t)out->n[1] * (size_t)out->n[2] : 0;
  for (size_t i = 0; i < n; i++) out->at[i] = s->finest * (sqrt(out->at[i]) - sqrt(to[1].at[i])); /* one of them is 0 */
  free(to[1].at);
  return good;
}

/* F of a voxel of the block where slices are far apart; outline: s of the block and RADIUS voxels around. */
static double keep_near(const tc_ref_smooth *s, const box *outline, const int at[3], double smooth) {
  double depth = 0;
  const double half = 0.5 * s->finest;
  int around[3];
  for (int k = 0; k < 3; k++) around[k] = s->ratio[k] > 0 ? AROUND : 0;
  const size_t row = stride_of(outline, 1), plane = stride_of(outline, 2);
  const double *centre = outline->at + (size_t)(at[0] + RADIUS) + (size_t)(at[1] + RADIUS) * row + (size_t)(at[2] + RADIUS) * plane;
  const double own = *centre;
  for (int z = -around[2]; z <= around[2]; z++)
    for (int y = -around[1]; y <= around[1]; y++)
      for (int x = -around[0]; x <= around[0]; x++) {
        const double there = centre[x + y * (ptrdiff_t)row + z * (ptrdiff_t)plane];
        if ((there > 0) == (own > 0)) depth = fmax(depth, fabs(there));
      }
  const double from = own > 0 ? own - half : own + half, most = fmin(s->slack, (depth - half) / 2);
  return fmin(fmax(smooth, from - most), from + most);
}

static values make_block(const tc_ref_smooth *s, const int from[3]) {
  box members = {0}, field = {0}, outline = {0};
  bool good = find_members(s, from, &members) && sign_distances(s, &members, &field);
  free(members.at);
  if (good && s->slack > 0) {
    const size_t bytes = stride_of(&field, 2) * (size_t)field.n[2] * sizeof *field.at;
    outline = field;
    good = (outline.at = malloc(bytes)) != NULL;
    if (good) memcpy(outline.at, field.at, bytes);
  }
  for (int k = 0; k < 3 && good; k++) {
    along(&field, k, 2 * RADIUS, s->weight[!(s->ratio[k] > 0)], filter_line);
    good = field.at != NULL;
  }
  for (int i = 0; i < BLOCK * BLOCK * BLOCK && good; i++) {
    const int at[3] = {i % BLOCK, i / BLOCK % BLOCK, i / BLOCK / BLOCK};
    if (s->slack > 0) {
      field.at[i] = keep_near(s, &outline, at, field.at[i]);
    } else {
      const bool inside = is_member(s, from[0] + at[0], from[1] + at[1], from[2] + at[2]);
      field.at[i] = inside ? fabs(field.at[i]) : -fmax(fabs(field.at[i]), LEAST * s->finest);
    }
  }
  free(outline.at);
  if (!good) g_clear_pointer(&field.at, free);
  return field.at;
}

/* ---- the whole ---- */

double tc_ref_smooth_at(const tc_ref_smooth *s, const size_t at[3]) {
  const size_t b[3] = {at[0] / BLOCK, at[1] / BLOCK, at[2] / BLOCK};
  _Atomic(values) *slot = &s->block[(b[2] * (size_t)s->blocks[1] + b[1]) * (size_t)s->blocks[0] + b[0]];
  values block = atomic_load(slot), none = NULL;
  if (!block) {
    block = make_block(s, (int[3]){(int)b[0] * BLOCK, (int)b[1] * BLOCK, (int)b[2] * BLOCK});
    if (!block) return is_member(s, (int)at[0], (int)at[1], (int)at[2]) ? s->finest : -s->finest; /* no memory: its side */
    if (!atomic_compare_exchange_strong(slot, &none, block)) { /* somebody else was sooner */
      free(block);
      block = none;
    }
  }
  return block[(at[2] % BLOCK * BLOCK + at[1] % BLOCK) * BLOCK + at[0] % BLOCK];
}

int tc_ref_smooth_side(const tc_ref_smooth *s, const size_t low[3]) {
  int inside = 0, all = 0, around[3];
  for (int k = 0; k < 3; k++) around[k] = s->slack > 0 && s->ratio[k] > 0 ? AROUND : 0;
  for (int z = -around[2]; z <= 1 + around[2]; z++)
    for (int y = -around[1]; y <= 1 + around[1]; y++)
      for (int x = -around[0]; x <= 1 + around[0]; x++, all++) {
        inside += is_member(s, (int)low[0] + x, (int)low[1] + y, (int)low[2] + z);
        if (inside && inside <= all) return 0;
      }
  return inside == all ? 1 : inside == 0 ? -1 : 0;
}

const tc_volume_desc *tc_ref_smooth_desc(const tc_ref_smooth *s) { return &s->desc; }

static void place(tc_ref_smooth *s, const tc_ref_extent_of_label *where) {
  const tc_volume_desc *d = s->of;
  s->desc = *d;
  for (int k = 0; k < 3; k++) {
    s->first[k] = where->low[k] - MARGIN;
    s->desc.dims[k] = where->high[k] - where->low[k] + 1 + 2 * MARGIN;
    s->blocks[k] = (s->desc.dims[k] + BLOCK - 1) / BLOCK;
    s->ratio[k] = d->spacing[k] <= COARSE * s->finest ? d->spacing[k] / s->finest : 0;
  }
  const double widest = fmax(fmax(d->spacing[0], d->spacing[1]), d->spacing[2]);
  if (widest > COARSE * s->finest) s->slack = fmin(SLACK * widest, AROUND * s->finest);
  for (int r = 0; r < 3; r++)
    for (int k = 0; k < 3; k++) s->desc.origin[r] += d->direction[3 * r + k] * d->spacing[k] * s->first[k];
}

static double binomial(int n, int k) { return k < 0 || k > n ? 0 : exp2(-n) * round(exp(lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1))); }

tc_ref_smooth *tc_ref_smooth_new(const tc_volume *labels, const tc_ref_extent_of_label *where) {
  tc_ref_smooth *s = calloc(1, sizeof *s);
  if (!s) return NULL;
  s->of = tc_volume_describe(labels), s->voxels = tc_volume_data(labels);
  s->label = where->label;
  s->finest = fmin(fmin(s->of->spacing[0], s->of->spacing[1]), s->of->spacing[2]);
  for (int far = 0; far < 2; far++)
    for (int k = 0, of = far ? FAR_RADIUS : RADIUS; k < TAPS; k++)
      s->weight[far][k] = 2 * binomial(of, k - RADIUS + of / 2) - binomial(2 * of, k - RADIUS + of);
  place(s, where);
  s->block = calloc((size_t)s->blocks[0] * (size_t)s->blocks[1] * (size_t)s->blocks[2], sizeof *s->block);
  if (!s->block) g_clear_pointer(&s, tc_ref_smooth_free);
  return s;
}

void tc_ref_smooth_free(tc_ref_smooth *s) {
  if (!s) return;
  const size_t n = (size_t)s->blocks[0] * (size_t)s->blocks[1] * (size_t)s->blocks[2];
  for (size_t i = 0; i < n && s->block; i++) free(atomic_load(&s->block[i]));
  free((void *)s->block);
  free(s);
}
