#include "renderer/volume/body.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/volume/body_parts.h"

/* Margin around the body in voxels: the partial volume at its edges. */
#define HALO 2

typedef struct body {
  const tc_volume *volume;
  const tc_body_options *options;
  int n[3];
  double soft[2], dense[2]; /* ranges of stored voxels: from, to */
  bool padded;              /* the volume has padding to remove */
  bool parted;              /* there are parts to remove */
  tc_body_parts parts;
  uint8_t *mask;       /* [nx] */
  int low[3], high[3]; /* bounding box of the result, inclusive */
} body;

static bool goes_on(const body *b) { return !b->options->goes_on || b->options->goes_on(b->options->user); }

/* ---- thresholds ---- */

#define DENSE_OF(name, type)                                                                                           \
  static void dense_##name(const type *v, int n, type from, type to, uint8_t *mask) {                                  \
    for (int i = 0; i < n; i++) mask[i] |= v[i] >= from && v[i] <= to;                                                 \
  }
DENSE_OF(u8, uint8_t)
DENSE_OF(i8, int8_t)
DENSE_OF(u16, uint16_t)
DENSE_OF(i16, int16_t)
DENSE_OF(f32, float)

static const uint8_t *row_of(const tc_volume *v, int y, int z) {
  const tc_volume_desc *d = tc_volume_describe(v);
  const size_t row = (size_t)z * (size_t)d->dims[1] + (size_t)y;
  return (const uint8_t *)tc_volume_data(v) + row * (size_t)d->dims[0] * tc_voxel_size(d->type);
}

/* Adds the voxels of a row within from..to to the mask. Compares in the voxel type, which vectorises. */
static void mark(const body *b, int y, int z, double from, double to) {
  const void *v = row_of(b->volume, y, z);
  const tc_voxel_type type = tc_volume_describe(b->volume)->type;
  const tc_volume_stats *s = tc_volume_statistics(b->volume);
  if (type != TC_F32) from = fmax(ceil(from), s->voxel_min), to = fmin(floor(to), s->voxel_max);
  if (from > to) return;
  switch (type) {
  case TC_U8: dense_u8(v, b->n[0], (uint8_t)from, (uint8_t)to, b->mask); break;
  case TC_I8: dense_i8(v, b->n[0], (int8_t)from, (int8_t)to, b->mask); break;
  case TC_U16: dense_u16(v, b->n[0], (uint16_t)from, (uint16_t)to, b->mask); break;
  case TC_I16: dense_i16(v, b->n[0], (int16_t)from, (int16_t)to, b->mask); break;
  case TC_F32: dense_f32(v, b->n[0], (float)from, (float)to, b->mask); break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
}

static int least(int a, int b) { return a < b ? a : b; }

/* ---- parts ---- */

/* Sets the class of each cell in a row of cells that has a voxel in the range. */
static void fill_cells(body *b, int cy, int cz, const double range[2], uint8_t place) {
  const int *size = b->parts.voxels;
  memset(b->mask, 0, (size_t)b->n[0]);
  for (int z = cz * size[2]; z < least((cz + 1) * size[2], b->n[2]); z++)
    for (int y = cy * size[1]; y < least((cy + 1) * size[1], b->n[1]); y++) mark(b, y, z, range[0], range[1]);
  uint8_t *cells = tc_body_parts_row(&b->parts, cy, cz);
  for (int c = 0; c < b->parts.n[0]; c++) {
    const int x = c * size[0];
    if (memchr(b->mask + x, 1, (size_t)(least(x + size[0], b->n[0]) - x))) cells[c] = place;
  }
}

static bool find_parts(body *b) {
  if (!tc_body_parts_init(&b->parts, b->volume)) return false;
  b->parts.strict = b->options->strict;
  for (int z = 0; z < b->parts.n[2]; z++) {
    if (!goes_on(b)) return false;
    for (int y = 0; y < b->parts.n[1]; y++) {
      if (b->options->soft < b->options->dense) fill_cells(b, y, z, b->soft, TC_CELL_SOFT);
      fill_cells(b, y, z, b->dense, TC_CELL_DENSE);
    }
  }
  return tc_body_parts_find(&b->parts, b->options->goes_on, b->options->user);
}

/* ---- the cropped volume ---- */

static void whole_box(body *b) {
  for (int k = 0; k < 3; k++) b->low[k] = 0, b->high[k] = b->n[k] - 1;
}

static void hold_cell(body *b, const int at[3]) {
  for (int k = 0; k < 3; k++) {
    const int from = at[k] * b->parts.voxels[k] - HALO, to = (at[k] + 1) * b->parts.voxels[k] - 1 + HALO;
    if (from < b->low[k]) b->low[k] = from > 0 ? from : 0;
    if (to > b->high[k]) b->high[k] = least(to, b->n[k] - 1);
  }
}

/* Bounding box of the kept cells, with the margin. */
static void find_box(body *b) {
  const int *n = b->parts.n;
  for (int k = 0; k < 3; k++) b->low[k] = b->n[k], b->high[k] = -1;
  for (int z = 0; z < n[2]; z++)
    for (int y = 0; y < n[1]; y++) {
      const uint8_t *cells = tc_body_parts_row(&b->parts, y, z);
      for (int x = 0; x < n[0]; x++)
        if ((cells[x] & TC_CELL_PLACE) == TC_CELL_KEPT) hold_cell(b, (const int[]){x, y, z});
    }
}

/* Marks the voxels of a row in cells with TC_CELL_NEAR, except those of kept cells that are dense or soft. False: the
 * row has no such cell. */
static bool mark_hidden(body *b, int y, int z) {
  const int *size = b->parts.voxels;
  const uint8_t *cells = tc_body_parts_row(&b->parts, y / size[1], z / size[2]);
  const uint8_t beside = TC_CELL_NEAR | TC_CELL_KEPT;
  bool near = false, both = memchr(cells, beside, (size_t)b->parts.n[0]) != NULL;
  if (both) mark(b, y, z, b->soft[0], b->soft[1]);
  for (int c = 0; c < b->parts.n[0]; c++) {
    const int from = c * size[0], end = least(from + size[0], b->n[0]);
    near |= cells[c] & TC_CELL_NEAR;
    if (cells[c] == beside)
      for (int x = from; x < end; x++) b->mask[x] = !b->mask[x];
    else
      memset(b->mask + from, cells[c] & TC_CELL_NEAR ? 1 : 0, (size_t)(end - from));
  }
  return near;
}

/* Marks the voxels of a row that are removed: hidden parts and padding. False: none. */
static bool mark_row(body *b, int y, int z) {
  const tc_volume_desc *d = tc_volume_describe(b->volume);
  const double past = (b->options->most - d->intercept) / d->slope;
  memset(b->mask, 0, (size_t)b->n[0]);
  const bool hidden = b->parted && mark_hidden(b, y, z);
  if (!b->padded) return hidden;
  if (d->slope > 0)
    mark(b, y, z, nextafterf((float)past, INFINITY), INFINITY);
  else
    mark(b, y, z, -INFINITY, nextafterf((float)past, -INFINITY));
  return true;
}

static tc_volume *new_volume(const body *b) {
  tc_volume_desc d = *tc_volume_describe(b->volume);
  const double low[3] = {b->low[0], b->low[1], b->low[2]};
  uint64_t bytes = tc_voxel_size(d.type);
  tc_volume_index_to_lps(b->volume, low, d.origin);
  for (int k = 0; k < 3; k++) {
    d.dims[k] = b->high[k] - b->low[k] + 1;
    bytes *= (uint64_t)d.dims[k];
  }
  if (b->options->reserve && !b->options->reserve(b->options->user, bytes)) return NULL;
  return tc_volume_new(&d, NULL);
}

/* The stored voxel of air, clamped to the volume's range. */
static double air_voxel(const body *b) {
  const tc_volume_desc *d = tc_volume_describe(b->volume);
  const tc_volume_stats *s = tc_volume_statistics(b->volume);
  return fmin(fmax((b->options->air - d->intercept) / d->slope, s->voxel_min), s->voxel_max);
}

/* Writes `count` equal voxels. */
static void put(void *to, tc_voxel_type type, size_t count, double voxel) {
  size_t size = tc_voxel_size(type), done = size;
  switch (type) {
  case TC_U8: *(uint8_t *)to = (uint8_t)voxel; break;
  case TC_I8: *(int8_t *)to = (int8_t)voxel; break;
  case TC_U16: *(uint16_t *)to = (uint16_t)voxel; break;
  case TC_I16: *(int16_t *)to = (int16_t)voxel; break;
  case TC_F32: *(float *)to = (float)voxel; break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
  for (; done < count * size; done *= 2)
    memcpy((uint8_t *)to + done, to, done < count * size - done ? done : count * size - done);
}

static bool fill(body *b, tc_volume *made) {
  const tc_volume_desc *d = tc_volume_describe(made);
  const size_t size = tc_voxel_size(d->type), width = (size_t)d->dims[0] * size;
  const double air = air_voxel(b);
  uint8_t *to = tc_volume_voxels(made);
  for (int z = b->low[2]; z <= b->high[2]; z++) {
    if (!goes_on(b)) return false;
    for (int y = b->low[1]; y <= b->high[1]; y++, to += width) {
      memcpy(to, row_of(b->volume, y, z) + (size_t)b->low[0] * size, width);
      if (!mark_row(b, y, z)) continue;
      const uint8_t *mask = b->mask + b->low[0], *end = mask + d->dims[0];
      for (const uint8_t *at = mask, *after; at < end && (at = memchr(at, 1, (size_t)(end - at))); at = after) {
        if (!(after = memchr(at, 0, (size_t)(end - at)))) after = end;
        put(to + (size_t)(at - mask) * size, d->type, (size_t)(after - at), air);
      }
    }
  }
  return true;
}

static void as_stored(const tc_volume_desc *d, double from, double to, double range[2]) {
  const double a = (from - d->intercept) / d->slope, b = (to - d->intercept) / d->slope;
  range[0] = fmin(a, b), range[1] = fmax(a, b);
}

tc_volume *tc_body_of(const tc_volume *volume, const tc_body_options *options) {
  if (tc_volume_sparse(volume)) return NULL;
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *s = tc_volume_statistics(volume);
  body b = {.volume = volume,
            .options = options,
            .n = {d->dims[0], d->dims[1], d->dims[2]},
            .padded = s->max > options->most,
            .mask = malloc((size_t)d->dims[0])};
  tc_volume *made = NULL;
  as_stored(d, options->soft, options->most, b.soft);
  as_stored(d, options->dense, options->most, b.dense);
  b.parted = b.mask && options->parts && find_parts(&b);
  if (b.parted)
    find_box(&b);
  else
    whole_box(&b);
  if (b.mask && (b.parted || b.padded)) made = new_volume(&b);
  if (made && fill(&b, made)) {
    tc_volume_seal_within(made, s->voxel_min, s->voxel_max);
  } else {
    tc_volume_unref(made);
    made = NULL;
  }
  tc_body_parts_finish(&b.parts);
  free(b.mask);
  return made;
}
