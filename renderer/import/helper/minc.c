/* MINC 2: HDF5 whose /minc-2.0/image/0/image holds the voxels and names its dimensions, slowest first; each spatial
 * dimension has a start, a step and a direction in RAS. Integers encode values from image-min to image-max, one pair
 * for all slices or one for each, mapped to the ends of the valid range; integers outside that range have no value. */
#include <math.h>
#include <string.h>

#include "renderer/import/helper.h"
#include "renderer/import/helper/convert.h"
#include "renderer/import/helper/format.h"
#include "renderer/import/helper/hdf5.h"

enum { MOST_DIMS = 4, MOST_SCALES = 1 << 20, SLAB_BYTES = 32 << 20 };

typedef struct scales {
  int rank; /* number of their dimensions, which are the image's slowest; -1: not present */
  hsize_t dims[H5S_MAX_RANK];
  double *ends[2]; /* image-min, image-max */
} scales;

typedef struct minc {
  hid_t file, image;
  int rank, space[3], time; /* dimensions of index axes x, y, z, and of time or -1 */
  hsize_t dims[H5S_MAX_RANK];
  tc_element element;
  double valid[2];
  scales scales;
  hsize_t frame, slab; /* number of the volume, and number of slices read at a time */
  double *values;      /* [slab] */
} minc;

static bool fail(tc_error_code code, GError **error, const char *what) {
  tc_set_error(error, code, NULL, "MINC: %s", what);
  return false;
}

/* ---- dimensions ---- */

/* parses "time,zspace,yspace,xspace" */
static bool name_dimensions(minc *m, char names[MOST_DIMS][32], GError **error) {
  char order[256];
  tc_hdf5_text(m->image, "dimorder", order, sizeof order);
  char **list = g_strsplit(order, ",", -1);
  bool ok = m->rank >= 3 && m->rank <= MOST_DIMS && (int)g_strv_length(list) >= m->rank;
  m->time = -1;
  for (int d = 0, k = 2; ok && d < m->rank; d++) {
    g_strlcpy(names[d], g_strstrip(list[d]), sizeof names[d]);
    for (int before = 0; before < d; before++) ok = ok && strcmp(names[d], names[before]) != 0;
    if (strcmp(names[d], "xspace") == 0 || strcmp(names[d], "yspace") == 0 || strcmp(names[d], "zspace") == 0)
      m->space[k--] = d;
    else if ((ok = ok && strcmp(names[d], "time") == 0 && m->time < 0))
      m->time = d;
    ok = ok && (k >= -1);
  }
  g_strfreev(list);
  return ok || fail(TC_ERROR_UNSUPPORTED, error,
                    "its dimensions are not xspace, yspace, zspace and at most time: convert it to NIfTI (mnc2nii)");
}

/* Reads an axis in LPS mm and adds its start to the position of the first voxel. */
static bool take_axis(tc_raster *raster, const minc *m, const char *name, double column[3], GError **error) {
  char path[64], spacing[32];
  double start = 0, step = 1, direction[3] = {name[0] == 'x', name[0] == 'y', name[0] == 'z'};
  g_snprintf(path, sizeof path, "/minc-2.0/dimensions/%s", name);
  TC_HDF5_ID dimension = H5Dopen2(m->file, path, H5P_DEFAULT);
  if (dimension < 0) return fail(TC_ERROR_FORMAT, error, "a dimension is named and not there");
  tc_hdf5_text(dimension, "spacing", spacing, sizeof spacing);
  if (g_str_has_prefix(spacing, "irregular"))
    return fail(TC_ERROR_UNSUPPORTED, error, "irregular distances: make them regular first (mincresample)");
  if (*spacing && !g_str_has_prefix(spacing, "regular"))
    tc_raster_note(raster, "%s: unknown kind of spacing, taken as regular", name);
  tc_hdf5_numbers(dimension, "start", &start, 1);
  tc_hdf5_numbers(dimension, "step", &step, 1);
  tc_hdf5_numbers(dimension, "direction_cosines", direction, 3);
  for (int i = 0; i < 3; i++) {
    const double lps = i < 2 ? -direction[i] : direction[i];
    column[i] = step * lps;
    raster->desc.origin[i] += start * lps;
  }
  return true;
}

static bool set_space(tc_raster *raster, minc *m, GError **error) {
  char names[MOST_DIMS][32];
  double columns[3][3], *origin = raster->desc.origin;
  if (!name_dimensions(m, names, error)) return false;
  for (int k = 0; k < 3; k++) {
    const hsize_t size = m->dims[m->space[k]];
    if (size < 1 || size > 65536) return fail(TC_ERROR_FORMAT, error, "no size");
    raster->desc.dims[k] = (int)size;
    if (!take_axis(raster, m, names[m->space[k]], columns[k], error)) return false;
  }
  return (isfinite(origin[0] + origin[1] + origin[2]) && tc_raster_set_axes(raster, columns)) ||
         fail(TC_ERROR_FORMAT, error, "the axes are not independent vectors of finite length");
}

/* ---- values ---- */

static bool is_integer(tc_element e) { return e != TC_ELEMENT_F32 && e != TC_ELEMENT_F64; }

static bool find_element(minc *m, GError **error) {
  static const tc_element integers[] = {TC_ELEMENT_U8, TC_ELEMENT_U16, TC_ELEMENT_U32};
  TC_HDF5_ID type = H5Dget_type(m->image);
  const H5T_class_t kind = H5Tget_class(type);
  const size_t size = H5Tget_size(type), log2 = size == 1 ? 0 : size == 2 ? 1 : size == 4 ? 2 : 3;
  if (kind == H5T_FLOAT && (size == 4 || size == 8)) {
    m->element = size == 4 ? TC_ELEMENT_F32 : TC_ELEMENT_F64;
    return true;
  }
  if (kind != H5T_INTEGER || log2 > 2)
    return fail(TC_ERROR_UNSUPPORTED, error,
                "voxels that are no numbers of at most 32 bits: convert it (mincreshape -float)");
  const bool is_signed = H5Tget_sign(type) == H5T_SGN_2;
  m->element = integers[log2];
  if (is_signed) m->element--; /* unsigned types follow their signed types in the enum */
  m->valid[0] = is_signed ? -ldexp(1, (int)size * 8 - 1) : 0;
  m->valid[1] = m->valid[0] + ldexp(1, (int)size * 8) - 1;
  double valid[2];
  if (tc_hdf5_numbers(m->image, "valid_range", valid, 2) && valid[0] != valid[1] && isfinite(valid[0] + valid[1])) {
    m->valid[0] = MAX(m->valid[0], MIN(valid[0], valid[1]));
    m->valid[1] = MIN(m->valid[1], MAX(valid[0], valid[1]));
  }
  return m->valid[0] < m->valid[1] || fail(TC_ERROR_FORMAT, error, "the valid range is none of its voxels'");
}

/* Scales may vary with the volume and the slowest spatial dimension, but not within a slice. */
static bool fits(const minc *m, const scales *s) {
  hsize_t count = 1;
  for (int d = 0; d < s->rank; d++) {
    if (d >= m->rank || s->dims[d] != m->dims[d]) return false;
    if (d != m->time && d != m->space[2] && s->dims[d] > 1) return false;
    count *= s->dims[d];
    if (count > MOST_SCALES) return false;
  }
  return count > 0;
}

static bool read_scales(minc *m, GError **error) {
  static const char *const paths[] = {"/minc-2.0/image/0/image-min", "/minc-2.0/image/0/image-max"};
  m->scales.rank = -1;
  for (int end = 0; end < 2 && is_integer(m->element); end++) {
    scales s = m->scales;
    TC_HDF5_ID data = tc_hdf5_data(m->file, paths[end], &s.rank, s.dims);
    if (data < 0 && end == 0) return true; /* labels: voxels are values */
    if (data < 0 || !fits(m, &s) || (end && s.rank != m->scales.rank))
      return fail(TC_ERROR_FORMAT, error, "image-min and image-max do not fit the image");
    hsize_t count = 1;
    for (int d = 0; d < s.rank; d++) count *= s.dims[d];
    s.ends[end] = g_new0(double, count);
    m->scales = s;
    if (H5Dread(data, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, s.ends[end]) < 0)
      return fail(TC_ERROR_FORMAT, error, "image-min and image-max are damaged");
    for (hsize_t i = 0; i < count; i++)
      if (!isfinite(s.ends[end][i])) return fail(TC_ERROR_FORMAT, error, "image-min and image-max are no numbers");
  }
  return true;
}

static void scale_of(const minc *m, hsize_t slice, double *slope, double *intercept) {
  const scales *s = &m->scales;
  hsize_t at = 0;
  *slope = 1;
  *intercept = 0;
  if (s->rank < 0) return;
  for (int d = 0; d < s->rank; d++) at = at * s->dims[d] + (d == m->time ? m->frame : d == m->space[2] ? slice : 0);
  *slope = (s->ends[1][at] - s->ends[0][at]) / (m->valid[1] - m->valid[0]);
  *intercept = s->ends[0][at] - m->valid[0] * *slope;
}

static bool has_one_scale(const minc *m, double *slope, double *intercept) {
  scale_of(m, 0, slope, intercept);
  for (hsize_t z = 1; z < m->dims[m->space[2]]; z++) {
    double other, offset;
    scale_of(m, z, &other, &offset);
    if (other != *slope || offset != *intercept) return false;
  }
  return *slope != 0;
}

/* ---- voxels ---- */

static bool read_slices(const minc *m, hsize_t from, hsize_t n, hid_t type, void *to, GError **error) {
  TC_HDF5_ID space = H5Dget_space(m->image);
  hsize_t start[MOST_DIMS] = {0}, count[MOST_DIMS], voxels = 1;
  for (int d = 0; d < m->rank; d++) count[d] = d == m->time ? 1 : m->dims[d];
  if (m->time >= 0) start[m->time] = m->frame;
  start[m->space[2]] = from;
  count[m->space[2]] = n;
  for (int d = 0; d < m->rank; d++) voxels *= count[d];
  TC_HDF5_ID memory = H5Screate_simple(1, &voxels, NULL);
  return (H5Sselect_hyperslab(space, H5S_SELECT_SET, start, NULL, count, NULL) >= 0 &&
          H5Dread(m->image, type, memory, space, H5P_DEFAULT, to) >= 0) ||
         fail(TC_ERROR_FORMAT, error, "the voxels are damaged or cut short");
}

/* Visits all slices; `take` gets n of them from `from` in m->values, as numbers of `type`. */
static bool each_slab(const minc *m, hid_t type, const tc_order *order,
                      bool (*take)(const minc *m, hsize_t from, hsize_t n, void *user, GError **error), void *user,
                      GError **error) {
  const hsize_t slices = m->dims[m->space[2]];
  for (hsize_t from = 0; from < slices; from += m->slab) {
    const hsize_t n = MIN(m->slab, slices - from);
    if (!read_slices(m, from, n, type, m->values, error) || !take(m, from, n, user, error) ||
        !order->goes_on(order->user, (double)from / (double)slices, error))
      return false;
  }
  return true;
}

static size_t slice_voxels(const minc *m) { return (size_t)(m->dims[m->space[0]] * m->dims[m->space[1]]); }

typedef struct extent {
  double least, most;
  uint64_t outside; /* voxels outside the valid range */
} extent;

static bool widen(const minc *m, hsize_t from, hsize_t n, void *user, GError **error) {
  extent *e = user;
  for (size_t i = 0; i < n * slice_voxels(m); i++) {
    const double v = m->values[i];
    e->outside += !(v >= m->valid[0] && v <= m->valid[1]);
    e->least = MIN(e->least, v);
    e->most = MAX(e->most, v);
  }
  return true;
}

static bool put_as_they_are(const minc *m, hsize_t from, hsize_t n, void *user, GError **error) {
  const tc_order *order = user;
  const size_t bytes = is_integer(m->element) ? tc_element_size(m->element) : sizeof(float);
  return tc_order_put(order, m->values, n * slice_voxels(m) * bytes, error);
}

/* Converts in place: a float is never longer than its source number. */
static bool put_values(const minc *m, hsize_t from, hsize_t n, void *user, GError **error) {
  const size_t voxels = slice_voxels(m);
  float *to = (float *)(void *)m->values;
  for (hsize_t z = 0; z < n; z++) {
    double slope, intercept;
    scale_of(m, from + z, &slope, &intercept);
    for (size_t i = z * voxels; i < (z + 1) * voxels; i++) {
      const double v = m->values[i];
      const float value = v >= m->valid[0] && v <= m->valid[1] ? (float)(v * slope + intercept) : NAN;
      memcpy(to + i, &value, sizeof value);
    }
  }
  return tc_order_put((const tc_order *)user, to, n * voxels * sizeof *to, error);
}

/* Keeps integers of up to 16 bits if one scale serves all slices and every voxel has a value; converts everything
 * else to values. */
static bool choose_type(tc_raster *raster, minc *m, const tc_order *order, hid_t *stored, GError **error) {
  static const struct {
    tc_voxel_type type;
    tc_element element;
    double least, most;
  } narrow[] = {{TC_U8, TC_ELEMENT_U8, 0, UINT8_MAX},
                {TC_I8, TC_ELEMENT_I8, INT8_MIN, INT8_MAX},
                {TC_U16, TC_ELEMENT_U16, 0, UINT16_MAX},
                {TC_I16, TC_ELEMENT_I16, INT16_MIN, INT16_MAX}};
  const hid_t natives[] = {H5T_NATIVE_UINT8, H5T_NATIVE_INT8, H5T_NATIVE_UINT16, H5T_NATIVE_INT16};
  extent e = {INFINITY, -INFINITY, 0};
  raster->desc.type = TC_F32;
  *stored = is_integer(m->element) ? -1 : H5T_NATIVE_FLOAT;
  if (m->element == TC_ELEMENT_F64) tc_raster_note(raster, "f64 voxels were rounded to f32");
  if (!is_integer(m->element)) return true;
  if (!each_slab(m, H5T_NATIVE_DOUBLE, order, widen, &e, error)) return false;
  if (e.outside) tc_raster_note(raster, "%" G_GUINT64_FORMAT " voxels outside the valid range are nothing", e.outside);
  if (!has_one_scale(m, &raster->desc.slope, &raster->desc.intercept)) {
    raster->desc.slope = 1;
    raster->desc.intercept = 0;
    tc_raster_note(raster, "each slice has its own scale: kept as values (f32)");
    return true;
  }
  for (size_t i = 0; i < G_N_ELEMENTS(narrow) && !e.outside; i++) {
    const bool same = narrow[i].element == m->element, wide = tc_element_size(m->element) > 2;
    if (!same && !(wide && e.least >= narrow[i].least && e.most <= narrow[i].most)) continue;
    raster->desc.type = narrow[i].type;
    m->element = narrow[i].element;
    *stored = natives[i];
    return true;
  }
  raster->desc.slope = 1;
  raster->desc.intercept = 0;
  if (!e.outside) tc_raster_note(raster, "%s voxels were rounded to f32", tc_element_name(m->element));
  return true;
}

/* Reads as many slices as a chunk holds, so that each chunk is decompressed once. */
static bool make_slab(minc *m, GError **error) {
  const uint64_t slice = (uint64_t)slice_voxels(m) * sizeof(double);
  m->slab = CLAMP(tc_hdf5_chunk(m->image, m->space[2]), 1, MAX(1, SLAB_BYTES / slice));
  m->values = g_try_malloc(slice * m->slab);
  return m->values || fail(TC_ERROR_MEMORY, error, "no memory for a slice");
}

static bool choose_frame(tc_raster *raster, minc *m, const tc_order *order, GError **error) {
  const hsize_t frames = m->time < 0 ? 1 : m->dims[m->time], wanted = MAX(order->volume, 1);
  if (frames < 1 || frames > INT32_MAX) return fail(TC_ERROR_FORMAT, error, "no volume");
  raster->desc.frames = (int)frames;
  m->frame = wanted - 1;
  if (wanted > frames) {
    tc_set_error(error, TC_ERROR_NOT_FOUND, NULL, "no volume %u: the file holds %d", (unsigned)wanted, (int)frames);
    return false;
  }
  if (frames > 1) tc_raster_note(raster, "volume %u of %d, choose by #volume=N", (unsigned)wanted, (int)frames);
  return true;
}

/* Limits the voxels by deflate's largest ratio, before any are read. */
static bool can_hold(const minc *m, const tc_raster *raster, uint64_t most, GError **error) {
  const int *dims = raster->desc.dims; /* each at most 2^16 */
  if ((uint64_t)dims[0] * (uint64_t)dims[1] * (uint64_t)dims[2] <= most) return true;
  return fail(TC_ERROR_FORMAT, error, "the file is cut short: it cannot hold its voxels");
}

static bool load(minc *m, const tc_input *input, const tc_order *order, GError **error) {
  tc_raster raster;
  hid_t stored;
  tc_raster_init(&raster, "minc", input);
  if (!set_space(&raster, m, error) || !find_element(m, error) || !choose_frame(&raster, m, order, error)) return false;
  const uint64_t most = MIN(input->size, H5Dget_storage_size(m->image)) * 1032 / tc_element_size(m->element);
  const tc_provenance from = {.volume = (int)m->frame + 1};
  return can_hold(m, &raster, most, error) && read_scales(m, error) && make_slab(m, error) &&
         choose_type(&raster, m, order, &stored, error) && tc_raster_begin(&raster, most, &from, order, error) &&
         each_slab(m, stored >= 0 ? stored : H5T_NATIVE_DOUBLE, order, stored >= 0 ? put_as_they_are : put_values,
                   (void *)order, error);
}

static bool read_minc(const tc_input *input, const tc_order *order, GError **error) {
  minc m = {.image = -1};
  TC_HDF5_ID file = m.file = tc_hdf5_open(input, error);
  if (file < 0) return false;
  TC_HDF5_ID image = m.image = tc_hdf5_data(file, "/minc-2.0/image/0/image", &m.rank, m.dims);
  const bool ok = image < 0 ? fail(TC_ERROR_UNSUPPORTED, error,
                                   "HDF5 without an image of MINC 2 in it: save it as NIfTI, NRRD or MINC")
                            : load(&m, input, order, error);
  g_free(m.values);
  g_free(m.scales.ends[0]);
  g_free(m.scales.ends[1]);
  return ok;
}

static bool probe(const uint8_t *head, size_t size) { return tc_hdf5_looks(head, size); }

const tc_format tc_format_minc = {"MINC", ".mnc", probe, read_minc};
