#include "renderer/import/helper/convert.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* Bytes between two calls of the progress callback; small compared with any volume that takes time. */
#define CHUNK_BYTES (256u << 10)
/* Planar components are read in parallel, one stream each. */
#define MAX_PLANES 16u

typedef struct loader {
  tc_raster *raster;
  const tc_order *order;
  uint64_t voxels;
  uint64_t frame; /* frame to read, from 0 */
  tc_source *planes[MAX_PLANES]; /* one, or one per component of planar data */
  unsigned n_planes;
  uint8_t *chunk; /* elements of chunk_voxels voxels, of all planes */
  double *sums;   /* [chunk_voxels], if components are combined */
  size_t chunk_voxels;
  bool swap;
  tc_overlaps overlaps; /* of layers of segments */
  GHashTable *labels;   /* layer << 16 | value -> label */
  uint64_t done, total; /* voxels, over both passes */
} loader;

/* ---- byte order ---- */

static void swap_bytes(void *data, size_t count, size_t size) {
  if (size == 2) {
    uint16_t *v = data;
    for (size_t i = 0; i < count; i++) v[i] = __builtin_bswap16(v[i]);
  } else if (size == 4) {
    uint32_t *v = data;
    for (size_t i = 0; i < count; i++) v[i] = __builtin_bswap32(v[i]);
  } else if (size == 8) {
    uint64_t *v = data;
    for (size_t i = 0; i < count; i++) v[i] = __builtin_bswap64(v[i]);
  }
}

/* ---- element arithmetic ---- */

/* A finite double beyond float's range becomes the largest float: infinity would mean "no value" here and be
 * replaced. */
static float narrow_f64(double value) {
  if (value > FLT_MAX && value < INFINITY) return FLT_MAX;
  if (value < -FLT_MAX && value > -INFINITY) return -FLT_MAX;
  return (float)value;
}

#define NARROW_AS(type, to)                                                                                            \
  do {                                                                                                                 \
    type *out = (to);                                                                                                  \
    for (size_t i = 0; i < n; i++) out[i] = (type)in[i];                                                               \
  } while (0)

#define NARROW_FROM(type)                                                                                              \
  do {                                                                                                                 \
    const type *in = from;                                                                                             \
    switch (stored) {                                                                                                  \
    case TC_U8: NARROW_AS(uint8_t, to); break;                                                                         \
    case TC_I8: NARROW_AS(int8_t, to); break;                                                                          \
    case TC_U16: NARROW_AS(uint16_t, to); break;                                                                       \
    case TC_I16: NARROW_AS(int16_t, to); break;                                                                        \
    case TC_F32: NARROW_AS(float, to); break;                                                                          \
    case TC_VOXEL_TYPE_COUNT: break;                                                                                   \
    }                                                                                                                  \
  } while (0)

/* Converts elements in native byte order to stored voxels. Integers are known to fit; conversion to f32 rounds to
 * nearest. */
static void narrow(tc_element element, const void *from, tc_voxel_type stored, void *to, size_t n) {
  switch (element) {
  case TC_ELEMENT_I32: NARROW_FROM(int32_t); break;
  case TC_ELEMENT_U32: NARROW_FROM(uint32_t); break;
  case TC_ELEMENT_I64: NARROW_FROM(int64_t); break;
  case TC_ELEMENT_U64: NARROW_FROM(uint64_t); break;
  case TC_ELEMENT_F64: {
    const double *in = from;
    float *out = to;
    for (size_t i = 0; i < n; i++) out[i] = narrow_f64(in[i]);
    break;
  }
  default: memcpy(to, from, n * tc_element_size(element));
  }
}

typedef struct range {
  int64_t lo;  /* smallest negative element, or INT64_MAX */
  uint64_t hi; /* largest element, or 0 if all are negative */
} range;

#define WIDEN_SIGNED(type)                                                                                             \
  for (size_t i = 0; i < n; i++) {                                                                                     \
    int64_t v = ((const type *)from)[i];                                                                               \
    if (v < r->lo) r->lo = v;                                                                                          \
    if (v > 0 && (uint64_t)v > r->hi) r->hi = (uint64_t)v;                                                             \
  }
#define WIDEN_UNSIGNED(type)                                                                                           \
  for (size_t i = 0; i < n; i++) {                                                                                     \
    uint64_t v = ((const type *)from)[i];                                                                              \
    if (v < (uint64_t)r->lo) r->lo = (int64_t)v;                                                                       \
    if (v > r->hi) r->hi = v;                                                                                          \
  }

static void widen(range *r, tc_element element, const void *from, size_t n) {
  if (element == TC_ELEMENT_I32) WIDEN_SIGNED(int32_t)
  if (element == TC_ELEMENT_I64) WIDEN_SIGNED(int64_t)
  if (element == TC_ELEMENT_U32) WIDEN_UNSIGNED(uint32_t)
  if (element == TC_ELEMENT_U64) WIDEN_UNSIGNED(uint64_t)
}

static tc_voxel_type narrowest(const range *r) {
  if (r->lo >= 0) return r->hi <= UINT8_MAX ? TC_U8 : r->hi <= UINT16_MAX ? TC_U16 : TC_F32;
  if (r->lo >= INT8_MIN && r->hi <= INT8_MAX) return TC_I8;
  return r->lo >= INT16_MIN && r->hi <= INT16_MAX ? TC_I16 : TC_F32;
}

#define ADD_FROM(type)                                                                                                 \
  for (size_t i = 0; i < n; i++) {                                                                                     \
    double v = (double)*(const type *)(from + i * stride);                                                             \
    sums[i] = weight ? sums[i] + *weight * v : hypot_add(sums[i], v);                                                   \
  }

/* A sum of squares overflows only for huge doubles. */
static double hypot_add(double sum, double v) {
  return fabs(v) > 1e150 || sum > 1e150 ? hypot(sum, v) : sqrt(sum * sum + v * v);
}

/* sums[i] += *weight * v; with weight NULL the root of the sum of squares. `from` holds one component every `stride`
 * bytes. */
static void add_component(tc_element element, const uint8_t *from, size_t stride, size_t n, const double *weight,
                          double *sums) {
  switch (element) {
  case TC_ELEMENT_I8: ADD_FROM(int8_t); break;
  case TC_ELEMENT_U8: ADD_FROM(uint8_t); break;
  case TC_ELEMENT_I16: ADD_FROM(int16_t); break;
  case TC_ELEMENT_U16: ADD_FROM(uint16_t); break;
  case TC_ELEMENT_I32: ADD_FROM(int32_t); break;
  case TC_ELEMENT_U32: ADD_FROM(uint32_t); break;
  case TC_ELEMENT_I64: ADD_FROM(int64_t); break;
  case TC_ELEMENT_U64: ADD_FROM(uint64_t); break;
  case TC_ELEMENT_F32: ADD_FROM(float); break;
  case TC_ELEMENT_F64: ADD_FROM(double); break;
  case TC_ELEMENT_COUNT: break;
  }
}

/* ---- reading ---- */

/* tc_watch_fn */
static bool watch(void *user, GError **error) {
  const loader *l = user;
  return l->order->goes_on(l->order->user, l->total ? (double)l->done / (double)l->total : 0, error);
}

static bool tick(loader *l, size_t voxels, GError **error) {
  l->done += voxels;
  return watch(l, error);
}

static bool planar(const tc_raster *r) { return r->components > 1 && r->inner > 1; }

/* Starts a pass: opens one stream, or for planar data one per component, each at its first plane. */
static bool rewind_planes(loader *l, GError **error) {
  const tc_raster *r = l->raster;
  const size_t size = tc_element_size(r->element);
  const uint64_t before = l->frame * l->voxels * r->components * size; /* measure() has checked this product */
  l->n_planes = planar(r) && r->combine != TC_COMBINE_FIRST ? r->components : 1;
  if (planar(r) && r->combine == TC_COMBINE_LUMA) l->n_planes = 3;
  for (unsigned p = 0; p < l->n_planes; p++) {
    tc_source_free(l->planes[p]);
    l->planes[p] = tc_source_new(&r->data);
    const uint64_t skip = before + p * r->inner * size;
    if (skip > 0 && !tc_source_skip(l->planes[p], skip, error)) return false;
  }
  return true;
}

/* Reads n voxels from voxel `at` into `to`, plane after plane, in native byte order. The caller asks for at most
 * run_length() voxels, so planar runs never cross a change of component. */
static bool read_run(loader *l, uint64_t at, size_t n, uint8_t *to, GError **error) {
  const tc_raster *r = l->raster;
  size_t size = tc_element_size(r->element), per_voxel = planar(r) ? 1 : r->components;
  bool plane_starts = planar(r) && at > 0 && at % r->inner == 0;
  for (unsigned p = 0; p < l->n_planes; p++) {
    uint64_t others = (uint64_t)(r->components - 1) * r->inner * size;
    if (plane_starts && !tc_source_skip(l->planes[p], others, error)) return false;
    uint8_t *plane = to + p * l->chunk_voxels * size;
    if (!tc_source_read(l->planes[p], plane, n * per_voxel * size, error)) return false;
    if (l->swap) swap_bytes(plane, n * per_voxel, size);
  }
  return true;
}

static size_t run_length(const loader *l, uint64_t at) {
  uint64_t n = MIN(l->voxels - at, (uint64_t)l->chunk_voxels);
  if (planar(l->raster)) n = MIN(n, l->raster->inner - at % l->raster->inner);
  return (size_t)n;
}

/* Packs the first component of each voxel. */
static void keep_first(const tc_raster *r, uint8_t *chunk, size_t n) {
  size_t size = tc_element_size(r->element), stride = size * r->components;
  if (r->components == 1 || planar(r)) return;
  for (size_t i = 1; i < n; i++) memmove(chunk + i * size, chunk + i * stride, size);
}

static void combine(const loader *l, size_t n) {
  static const double rec709[3] = {0.2126, 0.7152, 0.0722};
  const tc_raster *r = l->raster;
  bool square = r->combine == TC_COMBINE_MAGNITUDE;
  size_t size = tc_element_size(r->element);
  size_t stride = planar(r) ? size : size * r->components;
  size_t step = planar(r) ? l->chunk_voxels * size : size;
  unsigned used = square ? r->components : 3;
  memset(l->sums, 0, n * sizeof *l->sums);
  for (unsigned c = 0; c < used; c++)
    add_component(r->element, l->chunk + c * step, stride, n, square ? NULL : &rec709[c], l->sums);
}

static void store_sums(const loader *l, float *to, size_t n) {
  for (size_t i = 0; i < n; i++)
    to[i] = narrow_f64(l->sums[i]);
}

/* ---- layers of segments ---- */

static uint32_t layered_key(uint32_t layer, uint32_t value) { return layer << 16 | value; }

/* Numbers labels in the order of the file's segments. The voxel type has room for every possible combination. */
static tc_voxel_type number_segments(loader *l) {
  GArray *segments = l->raster->segments;
  uint64_t most = 1;
  l->labels = g_hash_table_new(NULL, NULL);
  for (guint i = 0; i < segments->len; i++) {
    tc_layered *s = &g_array_index(segments, tc_layered, i);
    s->segment.label = i + 1;
    g_hash_table_insert(l->labels, GUINT_TO_POINTER(layered_key(s->layer, s->value)), GUINT_TO_POINTER(i + 1));
  }
  for (uint32_t layer = 0; layer < l->raster->components; layer++) {
    uint64_t choices = 1;
    for (guint i = 0; i < segments->len; i++) choices += g_array_index(segments, tc_layered, i).layer == layer;
    most = MIN(most * choices, TC_SEGMENTS_MAX + 1);
  }
  tc_overlaps_init(&l->overlaps, segments->len);
  return most <= 256 ? TC_U8 : TC_U16;
}

static uint32_t value_of(tc_element element, const uint8_t *at) {
  uint16_t value = *at;
  if (tc_element_size(element) == 2) memcpy(&value, at, sizeof value);
  return value;
}

static bool merge_layers(loader *l, tc_voxel_type stored, void *to, size_t n, GError **error) {
  const tc_raster *r = l->raster;
  const size_t size = tc_element_size(r->element);
  const size_t stride = planar(r) ? size : size * r->components, step = planar(r) ? l->chunk_voxels * size : size;
  for (size_t i = 0; i < n; i++) {
    uint32_t label = 0;
    for (uint32_t layer = 0; layer < r->components; layer++) {
      const uint32_t value = value_of(r->element, l->chunk + i * stride + layer * step);
      if (!value) continue;
      const uint32_t segment = GPOINTER_TO_UINT(g_hash_table_lookup(l->labels, GUINT_TO_POINTER(layered_key(layer, value))));
      if (!segment) {
        tc_set_error(error, TC_ERROR_FORMAT, NULL, "layer %u holds the value %u, which is no segment's; save the segmentation again",
                     layer, value);
        return false;
      }
      label = tc_overlaps_label(&l->overlaps, label, segment);
    }
    if (stored == TC_U8)
      ((uint8_t *)to)[i] = (uint8_t)label;
    else
      ((uint16_t *)to)[i] = (uint16_t)label;
  }
  if (!l->overlaps.full) return true;
  tc_set_error(error, TC_ERROR_LIMIT, NULL, "segments overlap in more than %d combinations; save fewer of them", TC_SEGMENTS_MAX);
  return false;
}

/* Describes the labels; in a file of one layer they are the file's values. */
static bool send_segments(const loader *l, GError **error) {
  const GArray *segments = l->raster->segments;
  const bool layers = l->raster->combine == TC_COMBINE_LAYERS;
  for (guint i = 0; segments && i < segments->len; i++) {
    const tc_layered *s = &g_array_index(segments, tc_layered, i);
    tc_segment told = s->segment;
    if (!layers) told.label = s->value;
    for (guint k = 0; k < i && told.label; k++) /* two layers of a raster of which one is read */
      if (!layers && g_array_index(segments, tc_layered, k).value == s->value) told.label = 0;
    if (told.label && !l->order->segment(l->order->user, &told, error)) return false;
  }
  return !layers || tc_overlaps_send(&l->overlaps, NULL, 0, l->order, error);
}

/* Integer colours are sent as r, g, b; 16-bit colours are rounded to eight bits. */
static bool has_colors(const tc_raster *r) {
  return r->combine == TC_COMBINE_LUMA && r->components > 1 &&
         (r->element == TC_ELEMENT_U8 || r->element == TC_ELEMENT_U16);
}

static void put_colors(const loader *l, uint8_t *to, size_t n) {
  const tc_raster *r = l->raster;
  const size_t size = tc_element_size(r->element);
  const size_t stride = planar(r) ? size : size * r->components, step = planar(r) ? l->chunk_voxels * size : size;
  for (size_t i = 0; i < n; i++)
    for (size_t c = 0; c < 3; c++) {
      const uint32_t value = value_of(r->element, l->chunk + i * stride + c * step);
      to[3 * i + c] = (uint8_t)(size == 1 ? value : (value + 128) / 257);
    }
}

static bool same_storage(tc_element element, tc_voxel_type *stored) {
  switch (element) {
  case TC_ELEMENT_I8: *stored = TC_I8; return true;
  case TC_ELEMENT_U8: *stored = TC_U8; return true;
  case TC_ELEMENT_I16: *stored = TC_I16; return true;
  case TC_ELEMENT_U16: *stored = TC_U16; return true;
  case TC_ELEMENT_F32: *stored = TC_F32; return true;
  default: return false;
  }
}

/* The last pass: converts elements to voxels. */
static bool fill(loader *l, GError **error) {
  const tc_raster *r = l->raster;
  const tc_order *order = l->order;
  tc_voxel_type stored = r->desc.type, same;
  bool direct = r->components == 1 && same_storage(r->element, &same);
  size_t size = has_colors(r) ? 3 : tc_voxel_size(stored);
  if (!rewind_planes(l, error)) return false;
  for (uint64_t at = 0; at < l->voxels;) {
    size_t n = run_length(l, at);
    uint8_t *to = order->room(order->user, error);
    if (!to || !read_run(l, at, n, direct ? to : l->chunk, error)) return false;
    if (!direct && r->combine == TC_COMBINE_FIRST) {
      keep_first(r, l->chunk, n);
      narrow(r->element, l->chunk, stored, to, n);
    } else if (r->combine == TC_COMBINE_LAYERS) {
      if (!merge_layers(l, stored, to, n, error)) return false;
    } else if (has_colors(r)) {
      put_colors(l, to, n);
    } else if (!direct) {
      combine(l, n);
      store_sums(l, (float *)(void *)to, n);
    }
    at += n;
    if (!order->filled(order->user, n * size, error) || !tick(l, n, error)) return false;
  }
  return tc_source_finish(l->planes[l->n_planes - 1], error) && send_segments(l, error);
}

/* The first pass over wide integers: finds their range, for the narrowest storage type. */
static bool find_range(loader *l, range *found, GError **error) {
  *found = (range){INT64_MAX, 0};
  if (!rewind_planes(l, error)) return false;
  for (uint64_t at = 0; at < l->voxels;) {
    size_t n = run_length(l, at);
    if (!read_run(l, at, n, l->chunk, error)) return false;
    keep_first(l->raster, l->chunk, n);
    widen(found, l->raster->element, l->chunk, n);
    at += n;
    if (!tick(l, n, error)) return false;
  }
  return true;
}

/* ---- choosing ---- */

static bool choose_type(loader *l, GError **error) {
  tc_raster *r = l->raster;
  tc_voxel_type *type = &r->desc.type;
  bool small = r->element == TC_ELEMENT_U8 || r->element == TC_ELEMENT_U16;
  const char *name = tc_element_name(r->element);
  *type = TC_F32;
  l->total = l->voxels;
  switch (r->combine) {
  case TC_COMBINE_LUMA:
    if (small) *type = TC_U8;
    tc_raster_note(r, "colours became Rec. 709 luma (%s)%s", tc_voxel_type_name(*type), has_colors(r) ? ", but in slices" : "");
    return true;
  case TC_COMBINE_MAGNITUDE:
    tc_raster_note(r, "%u components of %s became their magnitude (f32)", r->components, name);
    return true;
  case TC_COMBINE_LAYERS:
    *type = number_segments(l);
    tc_raster_note(r, "%u layers of segments in one, combinations where they overlap", r->components);
    return true;
  default: break;
  }
  if (same_storage(r->element, type)) return true;
  if (r->element == TC_ELEMENT_F64) {
    tc_raster_note(r, "f64 voxels were rounded to f32");
    return true;
  }
  range found;
  l->total = 2 * l->voxels;
  if (!find_range(l, &found, error)) return false;
  *type = narrowest(&found);
  tc_raster_note(r, *type == TC_F32 ? "%s voxels were rounded to %s" : "%s voxels are kept as %s", name,
                 tc_voxel_type_name(*type));
  return true;
}

static bool within_limit(const loader *l, size_t voxel_bytes, GError **error) {
  uint64_t most = l->order->max_voxel_bytes;
  if (most == 0 || l->voxels <= most / voxel_bytes) return true;
  tc_set_error(error, TC_ERROR_LIMIT, NULL,
               "%" G_GUINT64_FORMAT " voxels of %zu bytes are over the limit of %" G_GUINT64_FORMAT " bytes", l->voxels,
               voxel_bytes, most);
  return false;
}

/* Bytes of the narrowest type that the storage rule may choose; for wide integers the first pass decides. */
static size_t least_voxel_bytes(const tc_raster *r) {
  tc_voxel_type same;
  if (r->components > 1 && r->combine == TC_COMBINE_MAGNITUDE) return sizeof(float);
  if (r->components > 1 && r->combine == TC_COMBINE_LUMA)
    return r->element == TC_ELEMENT_U8 || r->element == TC_ELEMENT_U16 ? 1 : sizeof(float);
  if (r->components > 1 && r->combine == TC_COMBINE_LAYERS) return 1;
  if (same_storage(r->element, &same)) return tc_voxel_size(same);
  return r->element == TC_ELEMENT_F64 ? sizeof(float) : 1;
}

/* Computes sizes with overflow checks; sets voxels and data.part_bytes. */
static bool measure(loader *l, GError **error) {
  tc_raster *r = l->raster;
  const int *dims = r->desc.dims;
  uint64_t voxels = 1, elements, bytes;
  bool over = false;
  for (int i = 0; i < 3; i++) {
    if (dims[i] < 1) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "sizes %d x %d x %d are no volume", dims[0], dims[1], dims[2]);
      return false;
    }
    if (__builtin_mul_overflow(voxels, (uint64_t)dims[i], &voxels)) over = true;
  }
  uint64_t parts = tc_data_parts(&r->data);
  over = over || __builtin_mul_overflow(voxels, (uint64_t)r->components, &elements) ||
              __builtin_mul_overflow(elements, r->frames, &elements) ||
              __builtin_mul_overflow(elements, (uint64_t)tc_element_size(r->element), &bytes) || bytes > INT64_MAX;
  if (over || voxels > INT32_MAX) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "sizes %d x %d x %d with %u components in %" G_GUINT64_FORMAT
                 " frames are beyond 2147483647 voxels", dims[0], dims[1], dims[2], r->components, r->frames);
    return false;
  }
  if (parts == 0 || elements % parts != 0) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "%" G_GUINT64_FORMAT " data files do not divide the voxels evenly",
                 parts);
    return false;
  }
  l->voxels = voxels;
  r->data.part_bytes = bytes / parts;
  r->data.element = r->element;
  return true;
}

static bool prepare(loader *l, GError **error) {
  tc_raster *r = l->raster;
  bool text = r->data.encoding == TC_ENCODING_TEXT;
  size_t size = tc_element_size(r->element);
  if (r->components == 1) r->combine = TC_COMBINE_FIRST;
  if (r->components > 32768 || (planar(r) && (r->combine == TC_COMBINE_MAGNITUDE || r->combine == TC_COMBINE_LAYERS) && r->components > MAX_PLANES)) {
    tc_set_error(error, TC_ERROR_UNSUPPORTED, NULL, "%u components per voxel are more than this reads", r->components);
    return false;
  }
  size_t planes = planar(r) ? MIN(r->components, MAX_PLANES) : 1, per_voxel = planar(r) ? 1 : r->components;
  l->chunk_voxels = MAX(CHUNK_BYTES / (size * planes * per_voxel), 1); /* leaves room for two elements of at most four stored bytes */
  l->chunk = g_malloc(l->chunk_voxels * size * planes * per_voxel);
  if (r->combine != TC_COMBINE_FIRST) l->sums = g_new(double, l->chunk_voxels);
  l->swap = !text && r->big_endian != (G_BYTE_ORDER == G_BIG_ENDIAN);
  return true;
}

/* Replaces the negative zeros of flipped axes. */
static void drop_negative_zeros(tc_volume_desc *desc) {
  for (int i = 0; i < 3; i++) desc->origin[i] += 0.0;
  for (int i = 0; i < 9; i++) desc->direction[i] += 0.0;
}

/* Chooses the frame. Frames that vary fastest are components here, so only the first can be chosen. */
static bool choose_frame(loader *l, GError **error) {
  const tc_raster *r = l->raster;
  const uint32_t wanted = l->order->volume ? l->order->volume : 1;
  l->frame = wanted - 1;
  if (wanted > (uint32_t)r->desc.frames)
    tc_set_error(error, TC_ERROR_NOT_FOUND, NULL, "no volume %u: the file holds %d", wanted, r->desc.frames);
  else if (wanted > r->frames)
    tc_set_error(error, TC_ERROR_UNSUPPORTED, NULL, "of volumes that lie voxel by voxel among each other the first is read");
  else
    return true;
  return false;
}

bool tc_raster_load(tc_raster *raster, const tc_order *order, GError **error) {
  loader l = {.raster = raster, .order = order};
  bool ok = false;
  raster->data.watch = watch;
  raster->data.watch_user = &l;
  raster->desc.frames = (int)MIN(raster->frames * (raster->combine == TC_COMBINE_FIRST ? raster->components : 1),
                                 (uint64_t)INT32_MAX);
  drop_negative_zeros(&raster->desc);
  if (!measure(&l, error) || !choose_frame(&l, error)) goto out;
  const size_t least = least_voxel_bytes(raster);
  if (!within_limit(&l, least, error) || !order->want(order->user, l.voxels * least, error)) goto out;
  if (!tc_data_check(&raster->data, error) || !prepare(&l, error) || !choose_type(&l, error)) goto out;
  if (raster->desc.frames > 1) tc_raster_note(raster, "volume %u of %d, choose by #volume=N", (unsigned)l.frame + 1, raster->desc.frames);
  const tc_provenance from = {.volume = (int)l.frame + 1, .colors = has_colors(raster)};
  ok = within_limit(&l, tc_voxel_size(raster->desc.type), error) &&
       order->begin(order->user, &raster->desc, &from, error) && fill(&l, error);
out:
  for (unsigned p = 0; p < MAX_PLANES; p++) tc_source_free(l.planes[p]);
  g_free(l.chunk);
  g_free(l.sums);
  tc_overlaps_finish(&l.overlaps);
  if (l.labels) g_hash_table_unref(l.labels);
  return ok;
}
