/* Rasters: the description of an image before its voxels are read. */
#include <math.h>
#include <stdarg.h>
#include <string.h>

#include "renderer/base/vector.h"
#include "renderer/import/helper/convert.h"

void tc_raster_init(tc_raster *raster, const char *format, const tc_input *input) {
  *raster = (tc_raster){.components = 1, .inner = 1, .frames = 1, .data.input = input};
  g_strlcpy(raster->desc.format, format, sizeof raster->desc.format);
  raster->desc.slope = 1;
  raster->desc.frames = 1;
  for (int i = 0; i < 3; i++) {
    raster->desc.dims[i] = 1;
    raster->desc.spacing[i] = 1;
    raster->desc.direction[i * 4] = 1;
  }
}

void tc_raster_clear(tc_raster *raster) { tc_data_clear(&raster->data); }

void tc_raster_note(tc_raster *raster, const char *format, ...) {
  char *note = raster->desc.note;
  size_t used = strlen(note), room = sizeof raster->desc.note - used;
  if (used > 0) used += g_strlcpy(note + used, "; ", room);
  if (used >= sizeof raster->desc.note) return;
  va_list args;
  va_start(args, format);
  g_vsnprintf(note + used, sizeof raster->desc.note - used, format, args);
  va_end(args);
}

static double normalise(double v[3]) {
  double length = length3(v);
  if (length > 0)
    for (int i = 0; i < 3; i++) v[i] /= length;
  return length;
}

bool tc_raster_set_axes(tc_raster *raster, const double columns[3][3]) {
  tc_volume_desc *desc = &raster->desc;
  double unit[3][3], spacing[3];
  int missing = -1;
  memcpy(unit, columns, sizeof unit);
  for (int k = 0; k < 3; k++) {
    spacing[k] = normalise(unit[k]);
    if (!isfinite(spacing[k])) return false;
    if (spacing[k] > 0) continue;
    if (desc->dims[k] > 1 || missing >= 0) return false;
    missing = k;
  }
  if (missing >= 0) {
    cross3(unit[(missing + 1) % 3], unit[(missing + 2) % 3], unit[missing]);
    if (normalise(unit[missing]) < 1e-6) return false;
    spacing[missing] = 1;
  }
  double normal[3];
  cross3(unit[0], unit[1], normal);
  if (fabs(dot3(normal, unit[2])) < 1e-6) return false;
  for (int k = 0; k < 3; k++) {
    desc->spacing[k] = spacing[k];
    for (int i = 0; i < 3; i++) desc->direction[i * 3 + k] = unit[k][i];
  }
  return true;
}

bool tc_raster_begin(tc_raster *raster, uint64_t most, const tc_provenance *from, const tc_order *order, GError **error) {
  tc_volume_desc *d = &raster->desc;
  const uint64_t slice = (uint64_t)d->dims[0] * (uint64_t)d->dims[1], limit = order->max_voxel_bytes;
  uint64_t voxels;
  const bool over = __builtin_mul_overflow(slice, (uint64_t)d->dims[2], &voxels) || voxels > INT32_MAX;
  const uint64_t bytes = over ? 0 : voxels * tc_voxel_size(d->type);
  if (over || (limit && bytes > limit)) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "%d x %d x %d voxels are over the limit", d->dims[0], d->dims[1], d->dims[2]);
    return false;
  }
  if (voxels > most) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "the file is cut short: it cannot hold %" G_GUINT64_FORMAT " voxels", voxels);
    return false;
  }
  for (int i = 0; i < 3; i++) d->origin[i] += 0.0; /* turns -0 into 0 */
  for (int i = 0; i < 9; i++) d->direction[i] += 0.0;
  return order->want(order->user, bytes, error) && order->begin(order->user, d, from, error);
}
