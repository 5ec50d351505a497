#include "renderer/skip/empty_ranges.h"

#include <stdlib.h>

static const int least_value[] = {[TC_U8] = 0, [TC_I8] = -128, [TC_U16] = 0, [TC_I16] = -32768};

static int node_of(const tc_empty_ranges *r, double voxel) {
  double node = (voxel - r->lo) * r->scale;
  return node > 0 ? node < r->last_node ? (int)node : r->last_node : 0;
}

uint8_t tc_empty_ranges_set(const tc_empty_ranges *ranges, double voxel) {
  if (!ranges->nodes) return (uint8_t)((voxel < ranges->lo) | (voxel > ranges->hi) << 1);
  return ranges->nodes[node_of(ranges, voxel)];
}

/* A look-up reads entries that span nodes floor(min) to floor(max) + 2; one more node on each side covers the kernels'
 * single-precision rounding. */
static void find_ranges(tc_empty_ranges *r, const tc_support *s) {
  int range = -1, end = s->n + 2;
  bool inside = false;
  for (int j = 0; j <= s->n; j++) {
    int first = j > 0 ? j - 1 : 0, last = j + 3 < end ? j + 3 : end;
    bool zero = s->used[first] == s->used[last];
    if (zero && !inside) range++;
    inside = zero;
    r->nodes[j] = zero && range < 8 ? (uint8_t)(1 << range) : 0;
  }
}

bool tc_empty_ranges_init(tc_empty_ranges *ranges, const tc_support *s, tc_voxel_type type, GError **error) {
  bool surface = !s->used;
  size_t nodes = (size_t)s->n + 1, values = type == TC_F32 ? 0 : tc_voxel_size(type) == 1 ? 256 : 65536;
  *ranges = (tc_empty_ranges){.type = type, .last_node = s->n, .lo = s->lo, .hi = s->hi, .scale = (s->n - 1) / (s->hi - s->lo)};
  ranges->nodes = surface ? NULL : malloc(nodes);
  ranges->voxels = values ? malloc(values) : NULL;
  if ((!surface && !ranges->nodes) || (values && !ranges->voxels)) {
    tc_empty_ranges_finish(ranges);
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "empty ranges of values: out of memory");
    return false;
  }
  if (!surface) find_ranges(ranges, s);
  for (size_t i = 0; i < values; i++) ranges->voxels[i] = tc_empty_ranges_set(ranges, (double)i + least_value[type]);
  return true;
}

void tc_empty_ranges_finish(tc_empty_ranges *ranges) {
  free(ranges->voxels);
  free(ranges->nodes);
  *ranges = (tc_empty_ranges){0};
}

#define READ(type, bias)                                                                                             \
  {                                                                                                                  \
    const type *v = (const type *)voxels + first;                                                                    \
    for (int i = 0; i < count; i++) sets[i] = ranges->voxels[v[i] + (bias)];                                           \
    return;                                                                                                          \
  }
void tc_empty_ranges_read(const tc_empty_ranges *ranges, const void *voxels, size_t first, int count, uint8_t *sets) {
  switch (ranges->type) {
  case TC_U8: READ(uint8_t, 0)
  case TC_I8: READ(int8_t, 128)
  case TC_U16: READ(uint16_t, 0)
  case TC_I16: READ(int16_t, 32768)
  case TC_F32:
    for (int i = 0; i < count; i++) sets[i] = tc_empty_ranges_set(ranges, (double)((const float *)voxels)[first + (size_t)i]);
    return;
  case TC_VOXEL_TYPE_COUNT: break;
  }
}
