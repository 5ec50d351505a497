/* NIfTI-1 and NIfTI-2: .nii, .nii.gz and .hdr with .img, either byte order. Geometry: the sform if its code is set
 * and its columns are independent; else the qform; else voxel sizes along the world axes (the standard's method 1).
 * NIfTI's world is RAS: the first two rows change sign. */
#include <math.h>
#include <string.h>

#include "renderer/import/helper/convert.h"
#include "renderer/import/helper/format.h"
#include "renderer/import/reader.h"

enum {
  header1_size = 348,
  header2_size = 540,
  intent_vector = 1007,
  intent_cifti_first = 3000,
  intent_cifti_last = 3099
};

typedef struct nifti_header {
  int version;
  bool big_endian, paired; /* paired: the data are in the .img */
  bool analyze;            /* Analyze 7.5: the same header without magic and without geometry */
  int64_t dim[8];
  int datatype, intent, qform_code, sform_code, units;
  double pixdim[8], vox_offset, slope, intercept, quatern[3], qoffset[3], srow[3][4];
} nifti_header;

/* Returns version 1 or 2, or 0 if it is neither; the header's size field gives the byte order. */
static int recognise(const uint8_t *head, size_t size, bool *big_endian, bool *paired) {
  static const uint8_t magic2[] = {'\r', '\n', 0x1a, '\n'};
  for (int big = 0; big < 2; big++) {
    tc_reader r;
    tc_reader_init(&r, head, size, big);
    uint32_t own_size = tc_reader_u32(&r);
    size_t at = own_size == header1_size ? 344 : 4;
    if ((own_size != header1_size && own_size != header2_size) || size < at + (own_size == header1_size ? 4 : 8))
      continue;
    const uint8_t *magic = head + at;
    bool one_file = magic[1] == '+';
    uint8_t digit = own_size == header1_size ? '1' : '2';
    if (magic[0] != 'n' || (!one_file && magic[1] != 'i') || magic[2] != digit || magic[3] != 0) continue;
    if (own_size == header2_size && memcmp(magic + 4, magic2, sizeof magic2) != 0) continue;
    *big_endian = big;
    *paired = !one_file;
    return digit - '0';
  }
  return 0;
}

typedef struct voxel_type {
  int code, element, components, combine;
} voxel_type;

static const voxel_type voxel_types[] = {
    {2, TC_ELEMENT_U8, 1, 0},      {4, TC_ELEMENT_I16, 1, 0},    {8, TC_ELEMENT_I32, 1, 0},
    {16, TC_ELEMENT_F32, 1, 0},    {64, TC_ELEMENT_F64, 1, 0},   {256, TC_ELEMENT_I8, 1, 0},
    {512, TC_ELEMENT_U16, 1, 0},   {768, TC_ELEMENT_U32, 1, 0},  {1024, TC_ELEMENT_I64, 1, 0},
    {1280, TC_ELEMENT_U64, 1, 0},  {128, TC_ELEMENT_U8, 3, TC_COMBINE_LUMA},
    {2304, TC_ELEMENT_U8, 4, TC_COMBINE_LUMA}, {32, TC_ELEMENT_F32, 2, TC_COMBINE_MAGNITUDE},
    {1792, TC_ELEMENT_F64, 2, TC_COMBINE_MAGNITUDE},
};

static const voxel_type *type_of(int code) {
  for (size_t i = 0; i < G_N_ELEMENTS(voxel_types); i++)
    if (voxel_types[i].code == code) return &voxel_types[i];
  return NULL;
}

/* Analyze 7.5 has no magic. Requires the header's size, a plausible number of dimensions, and its "regular" mark, its
 * extents, or a datatype that agrees with bitpix: some writers leave the first two out. */
static bool is_analyze(const uint8_t *head, size_t size, bool *big_endian) {
  for (int big = 0; big < 2 && size >= header1_size; big++) {
    tc_reader r;
    tc_reader_init(&r, head, size, big);
    const uint32_t own_size = tc_reader_u32(&r);
    tc_reader_seek(&r, 32);
    const uint32_t extents = tc_reader_u32(&r);
    tc_reader_seek(&r, 40);
    const int dimensions = tc_reader_i16(&r);
    tc_reader_seek(&r, 70);
    const voxel_type *type = type_of(tc_reader_i16(&r));
    const int bits = type ? type->components * 8 * (int)tc_element_size((tc_element)type->element) : 0;
    const bool marked = head[38] == 'r' || extents == 16384 || (type && tc_reader_i16(&r) == bits);
    *big_endian = big;
    if (own_size == header1_size && marked && dimensions >= 2 && dimensions <= 7 && head[344] != 'n') return true;
  }
  return false;
}

static bool probe(const uint8_t *head, size_t size) {
  bool big_endian, paired;
  return recognise(head, size, &big_endian, &paired) != 0 || is_analyze(head, size, &big_endian);
}

static void parse1(nifti_header *h, tc_reader *r) {
  tc_reader_seek(r, 40);
  for (int i = 0; i < 8; i++) h->dim[i] = tc_reader_i16(r);
  tc_reader_seek(r, 68);
  h->intent = tc_reader_i16(r);
  h->datatype = tc_reader_i16(r);
  tc_reader_seek(r, 76);
  for (int i = 0; i < 8; i++) h->pixdim[i] = tc_reader_f32(r);
  h->vox_offset = tc_reader_f32(r);
  h->slope = tc_reader_f32(r);
  h->intercept = tc_reader_f32(r);
  tc_reader_seek(r, 123);
  h->units = tc_reader_u8(r);
  tc_reader_seek(r, 252);
  h->qform_code = tc_reader_i16(r);
  h->sform_code = tc_reader_i16(r);
  for (int i = 0; i < 3; i++) h->quatern[i] = tc_reader_f32(r);
  for (int i = 0; i < 3; i++) h->qoffset[i] = tc_reader_f32(r);
  for (int i = 0; i < 12; i++) h->srow[i / 4][i % 4] = tc_reader_f32(r);
}

static void parse2(nifti_header *h, tc_reader *r) {
  tc_reader_seek(r, 12);
  h->datatype = tc_reader_i16(r);
  tc_reader_seek(r, 16);
  for (int i = 0; i < 8; i++) h->dim[i] = tc_reader_i64(r);
  tc_reader_seek(r, 104);
  for (int i = 0; i < 8; i++) h->pixdim[i] = tc_reader_f64(r);
  h->vox_offset = (double)tc_reader_i64(r);
  h->slope = tc_reader_f64(r);
  h->intercept = tc_reader_f64(r);
  tc_reader_seek(r, 344);
  h->qform_code = tc_reader_i32(r);
  h->sform_code = tc_reader_i32(r);
  for (int i = 0; i < 3; i++) h->quatern[i] = tc_reader_f64(r);
  for (int i = 0; i < 3; i++) h->qoffset[i] = tc_reader_f64(r);
  for (int i = 0; i < 12; i++) h->srow[i / 4][i % 4] = tc_reader_f64(r);
  tc_reader_seek(r, 500);
  h->units = tc_reader_i32(r);
  h->intent = tc_reader_i32(r);
}

static bool parse(nifti_header *h, const uint8_t *head, size_t size, GError **error) {
  *h = (nifti_header){0};
  h->version = recognise(head, size, &h->big_endian, &h->paired);
  h->analyze = h->version == 0 && is_analyze(head, size, &h->big_endian);
  if (h->analyze) h->version = 1, h->paired = true;
  if (h->version == 0) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "no NIfTI header (magic n+1, ni1 or n+2 expected)");
    return false;
  }
  tc_reader r;
  tc_reader_init(&r, head, size, h->big_endian);
  if (h->version == 1)
    parse1(h, &r);
  else
    parse2(h, &r);
  if (h->analyze) { /* Analyze uses these fields differently; SPM's scale is where NIfTI keeps its own */
    h->qform_code = h->sform_code = h->units = h->intent = 0;
    h->intercept = 0;
    if (!(fabs(h->slope) > 1e-30 && fabs(h->slope) < 1e30)) h->slope = 0;
  }
  if (r.failed) tc_set_error(error, TC_ERROR_FORMAT, NULL, "NIfTI header is cut short: %zu bytes", size);
  return !r.failed;
}

/* dim[]: up to three spatial dimensions, then time, then components if the intent says so. */
static bool set_dims(tc_raster *raster, const nifti_header *h, GError **error) {
  int64_t n = h->dim[0];
  if (h->intent >= intent_cifti_first && h->intent <= intent_cifti_last) {
    tc_set_error(error, TC_ERROR_UNSUPPORTED, NULL, "CIFTI-2: a matrix over surface points, no volume");
    return false;
  }
  if (n < 2 || n > 7) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "dim[0] is %" G_GINT64_FORMAT ": 2 to 7 dimensions expected", n);
    return false;
  }
  for (int i = 1; i <= n; i++) {
    int64_t size = i > 3 && h->dim[i] == 0 ? 1 : h->dim[i];
    if (size < 1 || size > INT32_MAX) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "dim[%d] is %" G_GINT64_FORMAT ": a size of 1 or more expected", i,
                   size);
      return false;
    }
    if (i <= 3) {
      raster->desc.dims[i - 1] = (int)size;
    } else if (i == 5 && h->intent == intent_vector && size > 1) {
      /* vectors are stored in planes: all times of one component, then the next component */
      raster->components = (uint32_t)size;
      raster->combine = TC_COMBINE_MAGNITUDE;
      raster->inner = raster->frames; /* set_type() multiplies it by the voxels once the sizes are checked */
    } else if (__builtin_mul_overflow(raster->frames, (uint64_t)size, &raster->frames)) {
      tc_set_error(error, TC_ERROR_LIMIT, NULL, "dim: more frames than any file holds");
      return false;
    }
  }
  const int *d = raster->desc.dims;
  if (n >= 5 && d[0] == 1 && d[1] == 1 && d[2] == 1 && raster->frames > 1) {
    tc_set_error(error, TC_ERROR_UNSUPPORTED, NULL, "one voxel with %" G_GUINT64_FORMAT " values: a matrix, no volume",
                 raster->frames);
    return false;
  }
  return true;
}

static bool set_type(tc_raster *raster, const nifti_header *h, GError **error) {
  const voxel_type *type = type_of(h->datatype);
  if (!type) {
    tc_set_error(error, TC_ERROR_UNSUPPORTED, NULL, "datatype %d is not read: save it as an integer, float or RGB type",
                 h->datatype);
    return false;
  }
  raster->element = (tc_element)type->element;
  raster->big_endian = h->big_endian;
  bool vector = raster->components > 1;
  if (vector && type->components > 1) {
    tc_set_error(error, TC_ERROR_UNSUPPORTED, NULL, "vectors of colour or complex numbers are not read");
    return false;
  }
  if (!vector) {
    raster->components = (uint32_t)type->components;
    raster->combine = (tc_combine)type->combine;
    raster->inner = 1;
    return true;
  }
  for (int k = 0; k < 3; k++)
    if (__builtin_mul_overflow(raster->inner, (uint64_t)raster->desc.dims[k], &raster->inner)) {
      tc_set_error(error, TC_ERROR_LIMIT, NULL, "dim: more voxels than any file holds");
      return false;
    }
  return true;
}

static void set_scale(tc_raster *raster, const nifti_header *h) {
  if (raster->combine == TC_COMBINE_LUMA && raster->components > 1) return; /* the standard excludes colours */
  if (h->slope == 0) return;
  if (!tc_scale_is_usable(h->slope, h->intercept)) {
    tc_raster_note(raster, "scl_slope %g or scl_inter %g is no usable number: both were left out", h->slope, h->intercept);
    return;
  }
  bool magnitude = raster->components > 1;
  raster->desc.slope = magnitude ? fabs(h->slope) : h->slope;
  raster->desc.intercept = magnitude ? 0 : h->intercept;
}

static double unit_mm(const nifti_header *h) {
  switch (h->units & 7) {
  case 1: return 1000;
  case 3: return 0.001;
  default: return 1;
  }
}

static bool finite3(const double *v) { return isfinite(v[0]) && isfinite(v[1]) && isfinite(v[2]); }

/* Axes of the grid in RAS and position of the first voxel; false if the sform does not define them. */
static bool use_sform(tc_raster *raster, const nifti_header *h, double mm) {
  double columns[3][3];
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < 3; i++) columns[k][i] = (i < 2 ? -mm : mm) * h->srow[i][k];
  double place[3] = {h->srow[0][3], h->srow[1][3], h->srow[2][3]};
  if (!finite3(place) || !tc_raster_set_axes(raster, columns)) return false;
  for (int i = 0; i < 3; i++) raster->desc.origin[i] = (i < 2 ? -mm : mm) * place[i];
  return true;
}

/* Voxel sizes: a negative size loses its sign; 0 becomes 1. */
static bool voxel_sizes(tc_raster *raster, const nifti_header *h, double sizes[3]) {
  for (int k = 0; k < 3; k++) {
    sizes[k] = fabs(h->pixdim[k + 1]);
    if (!isfinite(sizes[k])) return false;
    if (sizes[k] > 0) continue;
    sizes[k] = 1;
    if (raster->desc.dims[k] > 1) tc_raster_note(raster, "voxel size of axis %d is 0 and was taken as 1", k);
  }
  return true;
}

static bool use_qform(tc_raster *raster, const nifti_header *h, double mm, const double sizes[3]) {
  double b = h->quatern[0], c = h->quatern[1], d = h->quatern[2];
  if (!finite3(h->quatern) || !finite3(h->qoffset)) return false;
  double a = 1 - (b * b + c * c + d * d);
  if (a < 1e-7) { /* a half turn: rounding may have made b, c, d slightly too long */
    double length = sqrt(b * b + c * c + d * d);
    b /= length;
    c /= length;
    d /= length;
    a = 0;
  } else {
    a = sqrt(a);
  }
  double qfac = h->pixdim[0] < 0 ? -1 : 1;
  double rotation[3][3] = {
      {a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)},
      {2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)},
      {2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - b * b - c * c},
  };
  double columns[3][3];
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < 3; i++)
      columns[k][i] = (i < 2 ? -mm : mm) * sizes[k] * (k == 2 ? qfac : 1) * rotation[i][k];
  if (!tc_raster_set_axes(raster, columns)) return false;
  for (int i = 0; i < 3; i++) raster->desc.origin[i] = (i < 2 ? -mm : mm) * h->qoffset[i];
  return true;
}

static bool set_space(tc_raster *raster, const nifti_header *h, GError **error) {
  double mm = unit_mm(h), sizes[3];
  if (h->sform_code > 0) {
    if (use_sform(raster, h, mm)) return true;
    tc_raster_note(raster, "the sform has no independent axes and was left out");
  }
  if (!voxel_sizes(raster, h, sizes)) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "pixdim: voxel sizes are not numbers");
    return false;
  }
  if (h->qform_code > 0) {
    if (use_qform(raster, h, mm, sizes)) return true;
    tc_raster_note(raster, "the qform is not a rotation and was left out");
  }
  const double x = h->analyze ? 1 : -1; /* Analyze's usual order is radiological */
  const double columns[3][3] = {{x * mm * sizes[0], 0, 0}, {0, -mm * sizes[1], 0}, {0, 0, mm * sizes[2]}};
  tc_raster_note(raster, "the file gives no orientation: axes taken as %s, anterior, superior", h->analyze ? "left" : "right");
  if (tc_raster_set_axes(raster, columns)) return true;
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "pixdim: voxel sizes are out of any range");
  return false;
}

static bool set_offset(tc_raster *raster, const nifti_header *h, tc_encoding packing, GError **error) {
  double least = h->paired ? 0 : h->version == 1 ? header1_size + 4 : header2_size + 4, offset = h->vox_offset;
  if (offset == 0 && !h->paired) offset = least; /* common in careless writers */
  if (!(offset >= least) || offset > 1e15 || offset != floor(offset)) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "vox_offset %g: a whole number from %g on expected", h->vox_offset, least);
    return false;
  }
  raster->data.encoding = packing;
  raster->data.byte_skip = (int64_t)offset;
  return true;
}

/* Finds the .img of a .hdr; it may be compressed separately. */
static bool find_image(tc_raster *raster, const tc_input *input, tc_encoding *packing, GError **error) {
  static const char *const suffixes[] = {".img", ".img.gz", ".IMG"};
  char *stem = g_strdup(input->name);
  char *dot = strrchr(stem, '.');
  if (dot && g_ascii_strcasecmp(dot, ".gz") == 0) {
    *dot = '\0';
    dot = strrchr(stem, '.');
  }
  if (dot) *dot = '\0';
  bool found = false;
  for (size_t i = 0; i <= G_N_ELEMENTS(suffixes) && !found && (i == 0 || !*error); i++) {
    const bool again = i == G_N_ELEMENTS(suffixes); /* reports the missing file */
    char *name = g_strconcat(stem, suffixes[again ? 0 : i], NULL);
    tc_input image;
    found = tc_input_open_sibling(input, name, !again, &image, error);
    if (found) {
      *packing = image.packing;
      raster->data.names = g_ptr_array_new_with_free_func(g_free);
      g_ptr_array_add(raster->data.names, g_strdup(name));
    }
    tc_input_close(&image);
    g_free(name);
  }
  g_free(stem);
  return found;
}

static bool read_nifti(const tc_input *input, const tc_order *order, GError **error) {
  uint8_t head[header2_size + 4];
  size_t size;
  tc_encoding packing = input->packing;
  nifti_header h;
  tc_raster raster;
  bool ok = false;
  tc_raster_init(&raster, "nifti", input);
  if (!tc_input_head(input, head, sizeof head, &size, error) || !parse(&h, head, size, error)) goto out;
  if (h.analyze) g_strlcpy(raster.desc.format, "analyze", sizeof raster.desc.format);
  if (!set_dims(&raster, &h, error) || !set_type(&raster, &h, error)) goto out;
  set_scale(&raster, &h);
  if (!set_space(&raster, &h, error)) goto out;
  if (h.paired && !find_image(&raster, input, &packing, error)) goto out;
  if (!set_offset(&raster, &h, packing, error)) goto out;
  ok = tc_raster_load(&raster, order, error);
out:
  tc_raster_clear(&raster);
  return ok;
}

const tc_format tc_format_nifti = {"NIfTI", ".nii|.nii.gz|.hdr|.img", probe, read_nifti};
