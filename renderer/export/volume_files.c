/* NRRD, MetaImage and NIfTI-1, in this machine's byte order, little endian. */
#include <math.h>
#include <string.h>

#include "renderer/export/export.h"
#include "renderer/export/output.h"
#include "renderer/volume/voxel.h"

/* Voxels as the file stores them: as the volume has them, or as values in a type that can represent them. */
typedef struct stored {
  const tc_volume *volume;
  const tc_volume_desc *d;
  tc_voxel_type type;
  bool values; /* true: slope and intercept are applied */
} stored;

/* Integers with integer slope and intercept stay integers: the smallest type that holds their range. */
static stored choose(const tc_volume *volume, bool keeps_rescale) {
  static const struct {
    tc_voxel_type type;
    double lo, hi;
  } types[] = {{TC_U8, 0, 255}, {TC_I8, -128, 127}, {TC_I16, -32768, 32767}, {TC_U16, 0, 65535}};
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *range = tc_volume_statistics(volume);
  stored s = {volume, d, d->type, !keeps_rescale && (d->slope != 1 || d->intercept != 0)};
  if (!s.values) return s;
  s.type = TC_F32;
  if (d->type == TC_F32 || d->slope != floor(d->slope) || d->intercept != floor(d->intercept)) return s;
  for (size_t i = G_N_ELEMENTS(types); i-- > 0;)
    if (range->min >= types[i].lo && range->max <= types[i].hi) s.type = types[i].type;
  return s;
}

static void put_value(const stored *s, double value, void *to) {
  switch (s->type) {
  case TC_U8: *(uint8_t *)to = (uint8_t)value; return;
  case TC_I8: *(int8_t *)to = (int8_t)value; return;
  case TC_U16: *(uint16_t *)to = (uint16_t)value; return;
  case TC_I16: *(int16_t *)to = (int16_t)value; return;
  case TC_F32:
  case TC_VOXEL_TYPE_COUNT: break;
  }
  *(float *)to = (float)value;
}

/* Writes gaps, which a volume keeps apart from its voxels, as NaN. */
static void write_voxels(tc_output *o, const stored *s) {
  size_t row = (size_t)s->d->dims[0], rows = (size_t)s->d->dims[1] * (size_t)s->d->dims[2],
         size = tc_voxel_size(s->type);
  const tc_volume *gaps = tc_volume_gaps(s->volume);
  const uint8_t *gap = gaps ? tc_volume_data(gaps) : NULL;
  if (!s->values && !gap) {
    tc_output_write(o, tc_volume_data(s->volume), tc_volume_bytes(s->volume));
    return;
  }
  const void *voxels = tc_volume_data(s->volume);
  const double slope = s->values ? s->d->slope : 1, intercept = s->values ? s->d->intercept : 0;
  char *values = g_malloc(row * size);
  for (size_t r = 0; r < rows && o->good; r++) {
    for (size_t x = 0, at = r * row; x < row; x++, at++)
      put_value(s, gap && gap[at] ? (double)NAN : slope * tc_voxel_at(s->d->type, voxels, at) + intercept,
                values + x * size);
    tc_output_write(o, values, row * size);
  }
  g_free(values);
}

/* Displacement of one voxel along index axis k: component i in LPS mm. */
static double axis_mm(const tc_volume_desc *d, int i, int k) { return d->direction[3 * i + k] * d->spacing[k]; }

/* ---- NRRD ---- */

static void nrrd_head(tc_output *o, const stored *s, bool gzip) {
  static const char *const types[] = {"uint8", "int8", "uint16", "int16", "float"};
  const tc_volume_desc *d = s->d;
  tc_output_print(
      o, "NRRD0004\ntype: %s\ndimension: 3\nspace: left-posterior-superior\nsizes: %d %d %d\nspace directions:",
      types[s->type], d->dims[0], d->dims[1], d->dims[2]);
  for (int k = 0; k < 3; k++)
    tc_output_print(o, " (%.17g,%.17g,%.17g)", axis_mm(d, 0, k), axis_mm(d, 1, k), axis_mm(d, 2, k));
  tc_output_print(
      o, "\nspace origin: (%.17g,%.17g,%.17g)\nspace units: \"mm\" \"mm\" \"mm\"\nkinds: domain domain domain\n",
      d->origin[0], d->origin[1], d->origin[2]);
  if (*d->modality) tc_output_print(o, "modality:=%s\n", d->modality);
  tc_output_print(o, "endian: little\nencoding: %s\n\n", gzip ? "gzip" : "raw");
}

/* ---- MetaImage ---- */

static void mha_head(tc_output *o, const stored *s) {
  static const char *const types[] = {"MET_UCHAR", "MET_CHAR", "MET_USHORT", "MET_SHORT", "MET_FLOAT"};
  const tc_volume_desc *d = s->d;
  tc_output_print(
      o, "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n"
         "TransformMatrix =");
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < 3; i++) tc_output_print(o, " %.17g", d->direction[3 * i + k]);
  tc_output_print(
      o, "\nOffset = %.17g %.17g %.17g\nElementSpacing = %.17g %.17g %.17g\nDimSize = %d %d %d\nElementType = %s\n",
      d->origin[0], d->origin[1], d->origin[2], d->spacing[0], d->spacing[1], d->spacing[2], d->dims[0], d->dims[1],
      d->dims[2], types[s->type]);
  tc_output_print(o, "ElementDataFile = LOCAL\n");
}

/* ---- NIfTI-1 ---- */

static void put_f32(uint8_t *header, size_t at, double value) {
  float f = (float)value;
  memcpy(header + at, &f, sizeof f);
}

static void put_i16(uint8_t *header, size_t at, int value) {
  int16_t i = (int16_t)value;
  memcpy(header + at, &i, sizeof i);
}

/* The sform holds position and orientation, since it can express shears too. NIfTI's world is RAS. */
static void nifti_head(tc_output *o, const stored *s) {
  enum { SIZE = 352 }; /* includes the four bytes that say that no extension follows */
  static const int datatypes[] = {2, 256, 512, 4, 16};
  const tc_volume_desc *d = s->d;
  uint8_t h[SIZE] = {348 & 255, 348 >> 8};
  put_i16(h, 40, 3);
  for (int k = 0; k < 7; k++) put_i16(h, 42 + 2 * (size_t)k, k < 3 ? d->dims[k] : 1);
  put_i16(h, 70, datatypes[s->type]);
  put_i16(h, 72, 8 * (int)tc_voxel_size(s->type));
  put_f32(h, 76, 1);
  for (size_t k = 0; k < 3; k++) put_f32(h, 80 + 4 * k, d->spacing[k]);
  put_f32(h, 108, SIZE);
  put_f32(h, 112, d->slope);
  put_f32(h, 116, d->intercept);
  h[123] = 2;         /* mm */
  put_i16(h, 254, 1); /* sform: scanner coordinates */
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 4; k++)
      put_f32(h, 280 + 4 * (size_t)(4 * i + k), (k < 3 ? axis_mm(d, i, k) : d->origin[i]) * (i < 2 ? -1 : 1));
  memcpy(h + 344, "n+1", 4);
  tc_output_write(o, h, sizeof h);
}

static bool check_nifti(const tc_volume *volume, GError **error) {
  const int *dims = tc_volume_describe(volume)->dims;
  for (int k = 0; k < 3; k++)
    if (dims[k] > INT16_MAX) {
      tc_set_error(error, TC_ERROR_LIMIT, NULL, "NIfTI-1 holds up to 32767 voxels along an axis, not %d: write .nrrd",
                   dims[k]);
      return false;
    }
  return true;
}

/* ---- all ---- */

tc_export_kind tc_export_kind_of(const char *path) {
  static const char *const volumes[] = {".nrrd", ".mha", ".nii", ".nii.gz"}, *const meshes[] = {".ply", ".stl", ".obj"};
  for (size_t i = 0; i < G_N_ELEMENTS(volumes); i++)
    if (tc_path_ends(path, volumes[i])) return TC_EXPORT_VOLUME;
  for (size_t i = 0; i < G_N_ELEMENTS(meshes); i++)
    if (tc_path_ends(path, meshes[i])) return TC_EXPORT_MESH;
  return tc_path_ends(path, ".vmd") ? TC_EXPORT_MODEL : TC_EXPORT_UNKNOWN;
}

bool tc_export_volume(const tc_volume *volume, const char *path, bool gzip, GError **error) {
  bool zipped = tc_path_ends(path, ".nii.gz"), nifti = zipped || tc_path_ends(path, ".nii"),
       mha = tc_path_ends(path, ".mha");
  const stored s = choose(volume, nifti);
  tc_output o;
  if (gzip && (mha || (nifti && !zipped))) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "compressed volumes are written as .nrrd or .nii.gz");
    return false;
  }
  if ((nifti && !check_nifti(volume, error)) || !tc_output_begin(&o, path, zipped, error)) return false;
  if (nifti)
    nifti_head(&o, &s);
  else if (mha)
    mha_head(&o, &s);
  else
    nrrd_head(&o, &s, gzip);
  if (gzip && !nifti) tc_output_compress(&o); /* a NRRD's header stays uncompressed */
  write_voxels(&o, &s);
  return tc_output_end(&o, error);
}
