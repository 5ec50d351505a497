/* Access to a model, and its index. */
#include "renderer/splat/vmd.h"

#include <stdlib.h>
#include <string.h>

void tc_vmd_free(tc_vmd *vmd) {
  if (!vmd) return;
  free(vmd->there);
  free(vmd->rank);
  free(vmd->offsets);
  free(vmd->beyond);
  g_free(vmd->bytes);
  free(vmd);
}

/* ---- columns, runs, voxels ---- */

const uint8_t *tc_vmd_column(const tc_vmd *vmd, int x, int y) {
  x -= vmd->first[0], y -= vmd->first[1];
  if (x < 0 || y < 0 || x >= vmd->size[0] || y >= vmd->size[1]) return NULL;
  size_t i = (size_t)y * (size_t)vmd->size[0] + (size_t)x;
  uint64_t word = vmd->there[i / 64], bit = 1ull << i % 64;
  if (!(word & bit)) return NULL;
  return vmd->bytes + tc_vmd_start(vmd, vmd->rank[i / 64] + (uint32_t)__builtin_popcountll(word & (bit - 1)));
}

bool tc_vmd_next(const tc_vmd *vmd, tc_vmd_run *run) {
  static const uint8_t zeros[4 * TC_VMD_ATTRIBUTES];
  const uint8_t *before = run->count ? run->records + (size_t)(run->count - 1) * run->step : zeros;
  const size_t size = (size_t)vmd->head.record_bytes;
  uint32_t gap, count, kind = TC_VMD_EACH;
  if (!run->at) return false;
  if (vmd->version == 1) {
    gap = tc_vmd_varint(&run->at), count = tc_vmd_varint(&run->at);
  } else {
    count = tc_vmd_varint(&run->at), kind = count & 3, count >>= 2;
    gap = count ? tc_vmd_varint(&run->at) : 0;
  }
  run->z += run->count + (int)gap;
  run->count = (int)count;
  run->records = kind == TC_VMD_AS_BEFORE ? before : run->at;
  run->step = kind == TC_VMD_EACH ? size : 0;
  run->stored = kind == TC_VMD_EACH ? run->count : kind == TC_VMD_SAME;
  run->at = count ? run->at + (size_t)run->stored * size : NULL;
  return count > 0;
}

const uint8_t *tc_vmd_voxel(const tc_vmd *vmd, int x, int y, int z) {
  tc_vmd_run run = {.at = tc_vmd_column(vmd, x, y)};
  while (tc_vmd_next(vmd, &run) && run.z <= z)
    if (z < run.z + run.count) return run.records + (size_t)(z - run.z) * run.step;
  return NULL;
}

/* ---- attributes ---- */

size_t tc_vmd_type_size(tc_vmd_type type) { return type == TC_VMD_NORMAL ? 2 : tc_voxel_size((tc_voxel_type)type); }

const tc_vmd_attribute *tc_vmd_attribute_named(const tc_vmd_head *head, const char *name) {
  for (int i = 0; i < head->n_attributes; i++)
    if (strcmp(head->attributes[i].name, name) == 0) return &head->attributes[i];
  return NULL;
}

static bool is_name(const char *name) {
  size_t length = strspn(name, "abcdefghijklmnopqrstuvwxyz0123456789_-");
  return length > 0 && !name[length] && length < sizeof((tc_vmd_attribute *)0)->name;
}

bool tc_vmd_head_add(tc_vmd_head *head, const char *name, tc_vmd_type type, GError **error) {
  if (!is_name(name) || tc_vmd_attribute_named(head, name) || head->n_attributes == TC_VMD_ATTRIBUTES) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL,
                 "attributes: %d at most, each with a name of its own of up to 15 letters a-z, digits, - and _",
                 TC_VMD_ATTRIBUTES);
    return false;
  }
  tc_vmd_attribute *a = &head->attributes[head->n_attributes++];
  *a = (tc_vmd_attribute){.type = type, .at = head->record_bytes};
  g_strlcpy(a->name, name, sizeof a->name);
  head->record_bytes += (int)tc_vmd_type_size(type);
  return true;
}

double tc_vmd_number(const tc_vmd_attribute *attribute, const uint8_t *record) {
  const uint8_t *p = record + attribute->at;
  uint16_t two = 0;
  float four = 0;
  if (tc_vmd_type_size(attribute->type) == 2) memcpy(&two, p, 2);
  switch (attribute->type) {
  case TC_VMD_U8: return *p;
  case TC_VMD_I8: return (int8_t)*p;
  case TC_VMD_U16:
  case TC_VMD_NORMAL: return two;
  case TC_VMD_I16: return (int16_t)two;
  case TC_VMD_F32: memcpy(&four, p, 4); return (double)four;
  case TC_VMD_TYPE_COUNT: break;
  }
  return 0;
}

void tc_vmd_store(tc_voxel_type type, double number, uint8_t *to) {
  switch (type) {
  case TC_U8: *to = (uint8_t)number; break;
  case TC_I8: memcpy(to, &(int8_t){(int8_t)number}, 1); break;
  case TC_U16: memcpy(to, &(uint16_t){(uint16_t)number}, 2); break;
  case TC_I16: memcpy(to, &(int16_t){(int16_t)number}, 2); break;
  case TC_F32: memcpy(to, &(float){(float)number}, 4); break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
}

/* ---- the index ---- */

void tc_vmd_put_varint(GByteArray *to, uint32_t value) {
  for (; value >= 128; value >>= 7) {
    guint8 byte = (guint8)(value | 128);
    g_byte_array_append(to, &byte, 1);
  }
  guint8 last = (guint8)value;
  g_byte_array_append(to, &last, 1);
}

/* Whether the offsets of all groups fit 16 bits. */
static bool groups_are_short(const uint32_t *lengths, size_t cells) {
  uint32_t sum = 0, column = 0;
  for (size_t i = 0; i < cells; i++) {
    if (!lengths[i]) continue;
    if (column++ % TC_VMD_GROUP == 0) sum = 0;
    sum += MIN(lengths[i], 1u << 16);
    if (sum > UINT16_MAX) return false;
  }
  return true;
}

static bool allocate(tc_vmd *v, const uint32_t *lengths, size_t cells) {
  const bool groups = groups_are_short(lengths, cells);
  const size_t words = (cells + 63) / 64, n = (size_t)v->columns + 1,
               offsets = groups ? (size_t)v->columns / TC_VMD_GROUP + 1 : n;
  v->there = calloc(words + 1, sizeof *v->there);
  v->rank = calloc(words + 1, sizeof *v->rank);
  v->offsets = calloc(offsets, sizeof *v->offsets);
  v->beyond = groups ? calloc(n, sizeof *v->beyond) : NULL;
  v->total_bytes = sizeof *v + words * 12 + offsets * 4 + (groups ? n * 2 : 0);
  return v->there && v->rank && v->offsets && (!groups || v->beyond);
}

static void set_start(tc_vmd *v, uint32_t column, uint32_t offset) {
  if (!v->beyond) {
    v->offsets[column] = offset;
  } else {
    uint32_t *group = &v->offsets[column / TC_VMD_GROUP];
    if (column % TC_VMD_GROUP == 0) *group = offset;
    v->beyond[column] = (uint16_t)(offset - *group);
  }
}

static void set_index(tc_vmd *v, const uint32_t *lengths, size_t cells) {
  uint32_t column = 0, offset = 0;
  for (size_t i = 0; i < cells; i++) {
    if (i % 64 == 0) v->rank[i / 64] = column;
    if (!lengths[i]) continue;
    v->there[i / 64] |= 1ull << i % 64;
    set_start(v, column++, offset);
    offset += lengths[i];
  }
  set_start(v, column, offset);
  v->total_bytes += offset;
}

static void count_runs(tc_vmd *v) {
  for (uint32_t c = 0; c < v->columns; c++)
    for (tc_vmd_run run = {.at = v->bytes + tc_vmd_start(v, c)}; tc_vmd_next(v, &run); v->runs++)
      v->voxels += (uint64_t)run.count;
}

tc_vmd *tc_vmd_new(int version, const tc_vmd_head *head, const tc_vmd_columns *of, GError **error) {
  const size_t cells = (size_t)of->size[0] * (size_t)of->size[1];
  tc_vmd *v = calloc(1, sizeof *v);
  if (v) {
    v->head = *head, v->version = version;
    for (int k = 0; k < 2; k++) v->first[k] = of->first[k], v->size[k] = of->size[k];
    for (size_t i = 0; i < cells; i++) v->columns += of->lengths[i] != 0;
  }
  if (!v || !allocate(v, of->lengths, cells)) {
    tc_vmd_free(v);
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "voxel model: no memory for %zu columns", cells);
    return NULL;
  }
  set_index(v, of->lengths, cells);
  v->bytes = of->bytes;
  count_runs(v);
  return v;
}
