/* MGH and MGZ of FreeSurfer: a header of 284 bytes, big-endian, then voxels; MGZ is gzipped MGH. The header gives the
 * directions of the axes and the position of the centre in RAS; if its flag marks them as invalid, the format's
 * defaults hold (coronal slices). */
#include <math.h>

#include "renderer/import/helper/convert.h"
#include "renderer/import/helper/format.h"
#include "renderer/import/reader.h"

enum { header_bytes = 284, numbers_at = 30 };

typedef struct mgh_header {
  int32_t version, dims[3], frames, type;
  bool placed;
  double spacing[3], axes[3][3], centre[3]; /* RAS; axes[k]: direction of index axis k */
} mgh_header;

static bool parse(mgh_header *h, const uint8_t *head, size_t size) {
  static const mgh_header unplaced = {.spacing = {1, 1, 1}, .axes = {{-1, 0, 0}, {0, 0, -1}, {0, 1, 0}}};
  tc_reader r;
  tc_reader_init(&r, head, size, true);
  *h = unplaced;
  h->version = tc_reader_i32(&r);
  for (int k = 0; k < 3; k++) h->dims[k] = tc_reader_i32(&r);
  h->frames = tc_reader_i32(&r);
  h->type = tc_reader_i32(&r);
  tc_reader_seek(&r, numbers_at - 2);
  h->placed = tc_reader_i16(&r) > 0;
  for (int k = 0; h->placed && k < 3; k++) h->spacing[k] = tc_reader_f32(&r);
  for (int i = 0; h->placed && i < 9; i++) h->axes[i / 3][i % 3] = tc_reader_f32(&r);
  for (int i = 0; h->placed && i < 3; i++) h->centre[i] = tc_reader_f32(&r);
  return !r.failed;
}

static int element_of(int32_t type) {
  switch (type) {
  case 0: return TC_ELEMENT_U8;
  case 1: return TC_ELEMENT_I32;
  case 3: return TC_ELEMENT_F32;
  case 4: return TC_ELEMENT_I16;
  default: return -1;
  }
}

/* The magic bytes are weak, so all header fields must be plausible, too. */
static bool probe(const uint8_t *head, size_t size) {
  mgh_header h;
  return parse(&h, head, size) && h.version == 1 && h.dims[0] > 0 && h.dims[1] > 0 && h.dims[2] > 0 && h.frames > 0 &&
         h.type >= 0 && h.type <= 6;
}

static bool set_space(tc_raster *raster, const mgh_header *h, GError **error) {
  double columns[3][3];
  for (int i = 0; i < 3; i++) {
    const double sign = i < 2 ? -1 : 1; /* RAS to LPS */
    double corner = h->centre[i];
    for (int k = 0; k < 3; k++) {
      columns[k][i] = sign * h->spacing[k] * h->axes[k][i];
      corner -= h->spacing[k] * h->axes[k][i] * h->dims[k] / 2.0;
    }
    raster->desc.origin[i] = sign * corner;
  }
  if (!h->placed) tc_raster_note(raster, "the file gives no place: coronal slices of 1 mm assumed");
  if (isfinite(raster->desc.origin[0] + raster->desc.origin[1] + raster->desc.origin[2]) &&
      tc_raster_set_axes(raster, columns))
    return true;
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "MGH header: the axes are not independent vectors of finite length");
  return false;
}

static bool read_mgh(const tc_input *input, const tc_order *order, GError **error) {
  uint8_t head[header_bytes];
  size_t size;
  mgh_header h;
  tc_raster raster;
  bool ok = false;
  tc_raster_init(&raster, "mgh", input);
  if (!tc_input_head(input, head, sizeof head, &size, error)) goto out;
  const int element = parse(&h, head, size) ? element_of(h.type) : -1;
  if (size < header_bytes || h.version != 1 || h.frames < 1 || element < 0) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "no MGH header of version 1 with uchar, short, int or float voxels");
    goto out;
  }
  for (int k = 0; k < 3; k++) raster.desc.dims[k] = h.dims[k];
  raster.frames = (uint64_t)h.frames;
  raster.element = (tc_element)element;
  raster.big_endian = true;
  ok = set_space(&raster, &h, error) && tc_data_attach(&raster.data, header_bytes, error) &&
       tc_raster_load(&raster, order, error);
out:
  tc_raster_clear(&raster);
  return ok;
}

const tc_format tc_format_mgh = {"MGH", ".mgh|.mgz|.mgh.gz", probe, read_mgh};
