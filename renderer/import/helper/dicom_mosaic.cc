// Siemens mosaics: slices side by side in one picture; a private header gives their number and geometry.
#include <cmath>
#include <cstring>

extern "C" {
#include "renderer/import/reader.h"
}
#include "renderer/import/helper/dicom_picture.h"

namespace dicom {

// Number and normal of the slices of a Siemens mosaic, from its CSA header ("SV10", since software VB).
struct Mosaic {
  double images = 0, normal[3] = {0, 0, 0};
  int parts = 0; // components of the normal read so far
};

// Reads the values of one element, texts with their lengths in front; up to `most` become numbers.
static int read_csa_values(tc_reader &r, double *out, int most) {
  tc_reader_seek(&r, r.at + 4 + 4 + 4); // multiplicity, type, type again
  const uint32_t items = tc_reader_u32(&r);
  int found = 0;
  tc_reader_u32(&r);
  for (uint32_t i = 0; i < items && !r.failed; i++) {
    tc_reader_u32(&r);
    const uint32_t length = tc_reader_u32(&r);
    tc_reader_seek(&r, r.at + 8);
    const size_t at = r.at;
    tc_reader_seek(&r, at + (uint64_t{length} + 3) / 4 * 4);
    if (r.failed || length == 0 || found == most) continue;
    out[found++] = g_ascii_strtod(std::string(reinterpret_cast<const char *>(r.bytes) + at, length).c_str(), nullptr);
  }
  return found;
}

static Mosaic read_csa(const DataSet &set) {
  Mosaic m;
  tc_reader r;
  if (text_of(set, Tag(0x29, 0x10)) != "SIEMENS CSA HEADER" || !set.FindDataElement(Tag(0x29, 0x1010))) return m;
  const gdcm::ByteValue *value = set.GetDataElement(Tag(0x29, 0x1010)).GetByteValue();
  if (!value || value->GetLength() < 16 || memcmp(value->GetPointer(), "SV10", 4) != 0) return m;
  tc_reader_init(&r, value->GetPointer(), value->GetLength(), false);
  tc_reader_seek(&r, 8);
  const uint32_t elements = tc_reader_u32(&r);
  tc_reader_u32(&r);
  for (uint32_t i = 0; i < elements && !r.failed; i++) {
    double unused;
    const char *name = reinterpret_cast<const char *>(r.bytes) + r.at;
    tc_reader_seek(&r, r.at + 64);
    if (r.failed) break;
    if (strncmp(name, "NumberOfImagesInMosaic", 64) == 0)
      read_csa_values(r, &m.images, 1);
    else if (strncmp(name, "SliceNormalVector", 64) == 0)
      m.parts = read_csa_values(r, m.normal, 3);
    else
      read_csa_values(r, &unused, 0);
  }
  return m;
}

// Divides a mosaic into its slices. Its position is that of a picture of the mosaic's size around the first slice's
// centre (dcm2niix and nibabel agree).
void unfold_mosaic(const DataSet &set, Picture &p) {
  const Mosaic m = read_csa(set);
  const tc_dicom_slice whole = p.slices[0];
  const bool counted = m.images >= 1 && m.images <= 4096;
  const int across = counted ? static_cast<int>(std::ceil(std::sqrt(m.images))) : 1;
  const double *o = whole.orientation, *n = m.normal;
  const double normal[3] = {o[1] * o[5] - o[2] * o[4], o[2] * o[3] - o[0] * o[5], o[0] * o[4] - o[1] * o[3]};
  if (!counted || m.parts != 3 || p.frames != 1 || p.samples.columns % across || p.samples.rows % across ||
      p.samples.per_pixel != 1 || (p.samples.allocated != 16 && p.samples.allocated != 8) || !whole.has_position ||
      !whole.has_orientation || !whole.has_spacing || !(whole.between > 0))
    fail(TC_ERROR_UNSUPPORTED, "a mosaic whose header does not place its slices; convert it with dcm2niix");
  const double along = n[0] * normal[0] + n[1] * normal[1] + n[2] * normal[2];
  if (!(std::fabs(std::fabs(along) - 1) < 0.01))
    fail(TC_ERROR_UNSUPPORTED, "a mosaic whose slices are not stacked along their normal; convert it with dcm2niix");
  p.tiles_across = static_cast<uint32_t>(across);
  p.frames = static_cast<uint32_t>(m.images);
  p.slices.assign(p.frames, whole);
  p.scales.assign(p.frames, p.scales[0]);
  for (uint32_t f = 0; f < p.frames; f++) {
    tc_dicom_slice &s = p.slices[f];
    s.frame = f;
    s.columns = p.samples.columns / across;
    s.rows = p.samples.rows / across;
    for (int k = 0; k < 3; k++)
      s.position[k] += 0.5 * (p.samples.columns - s.columns) * s.spacing[0] * o[k] +
                       0.5 * (p.samples.rows - s.rows) * s.spacing[1] * o[3 + k] +
                       f * s.between * std::copysign(1, along) * normal[k];
  }
}

} // namespace dicom
