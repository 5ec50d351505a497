// Geometry and scale of each frame of a file: from its header, from functional groups, or spaced along the normal.
#include <algorithm>
#include <cmath>

#include "renderer/import/helper/dicom_picture.h"

namespace dicom {

// A usable orientation has two orthogonal unit vectors; rounding is corrected, anything worse counts as missing.
static bool read_orientation(const DataSet &set, double *o) {
  double v[6];
  if (!read_vector(set, Tag(0x20, 0x37), v, 6)) return false;
  double row = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  if (!(std::fabs(row - 1) < 0.05)) return false;
  double dot = 0, column = 0;
  for (int i = 0; i < 3; i++)
    v[i] /= row;
  for (int i = 0; i < 3; i++)
    dot += v[i] * v[3 + i];
  if (!(std::fabs(dot) < 0.05)) return false;
  for (int i = 0; i < 3; i++)
    v[3 + i] -= dot * v[i];
  for (int i = 3; i < 6; i++)
    column += v[i] * v[i];
  column = std::sqrt(column);
  if (!(std::fabs(column - 1) < 0.05)) return false;
  for (int i = 3; i < 6; i++)
    v[i] /= column;
  std::copy(v, v + 6, o);
  return true;
}

static bool read_spacing(const DataSet &set, Tag tag, double *spacing) {
  double v[2];
  if (!read_vector(set, tag, v, 2) || !(v[0] > 1e-6 && v[0] < 1e6 && v[1] > 1e-6 && v[1] < 1e6)) return false;
  spacing[0] = v[1]; // DICOM gives the distance between rows (y) first
  spacing[1] = v[0];
  return true;
}

static void read_geometry(const DataSet &set, tc_dicom_slice &s) {
  if (read_vector(set, Tag(0x20, 0x32), s.position, 3)) s.has_position = true;
  if (read_orientation(set, s.orientation)) s.has_orientation = true;
  if (read_spacing(set, Tag(0x28, 0x30), s.spacing)) s.has_spacing = true;
  double between = number_of(set, Tag(0x18, 0x88), 0), thickness = number_of(set, Tag(0x18, 0x50), 0);
  if (std::fabs(between) > 1e-6 && std::fabs(between) < 1e6) s.between = between;
  if (thickness > 1e-6 && thickness < 1e6) s.thickness = thickness;
}

static void read_scale(const DataSet &set, Picture &p, Scale &scale) {
  scale.slope = number_of(set, Tag(0x28, 0x1053), scale.slope);
  scale.intercept = number_of(set, Tag(0x28, 0x1052), scale.intercept);
  if (set.FindDataElement(Tag(0x28, 0x1054))) p.scale_type = plain(text_of(set, Tag(0x28, 0x1054)), 15);
  if (!std::isfinite(scale.slope) || scale.slope == 0 || std::fabs(scale.slope) > 1e30) scale.slope = 1;
  if (!std::isfinite(scale.intercept) || std::fabs(scale.intercept) > 1e30) scale.intercept = 0;
}

static void read_window(const DataSet &set, Picture &p) {
  double center = number_of(set, Tag(0x28, 0x1050), 0), width = number_of(set, Tag(0x28, 0x1051), 0);
  if (p.window_width > 0 || !(width > 0 && width < 1e30) || std::fabs(center) > 1e30) return;
  p.window_center = center;
  p.window_width = width;
}

// Applies one item of the functional groups (shared or per frame) to a slice.
static void read_groups(const DataSet &item, Picture &p, tc_dicom_slice &s, Scale &scale) {
  Nested position = item_of(item, Tag(0x20, 0x9113)), plane = item_of(item, Tag(0x20, 0x9116)),
         measures = item_of(item, Tag(0x28, 0x9110)), values = item_of(item, Tag(0x28, 0x9145)),
         world = item_of(item, Tag(0x40, 0x9096)), window = item_of(item, Tag(0x28, 0x9132)),
         segment = item_of(item, Tag(0x62, 0x0a));
  for (const Nested *n : {&position, &plane, &measures})
    if (n->set) read_geometry(*n->set, s);
  if (values.set) {
    read_scale(*values.set, p, scale);
  } else if (world.set && world.set->FindDataElement(Tag(0x40, 0x9225))) {
    scale.slope = binary_of<double>(*world.set, Tag(0x40, 0x9225), 1);
    scale.intercept = binary_of<double>(*world.set, Tag(0x40, 0x9224), 0);
    if (!std::isfinite(scale.slope) || scale.slope == 0 || !std::isfinite(scale.intercept)) scale = Scale();
  }
  if (window.set) read_window(*window.set, p);
  read_group_keys(item, s);
  if (segment.set) s.segment = binary_of<uint16_t>(*segment.set, Tag(0x62, 0x0b), 0);
}

// Multi-frame files without functional groups: frames advance along the normal by the offsets or spacing in the
// header.
static void spread_frames(const DataSet &set, Picture &p) {
  std::vector<double> offsets = numbers_of(set, Tag(0x3004, 0x0c));
  tc_dicom_slice first = p.slices[0];
  static const double straight[6] = {1, 0, 0, 0, 1, 0};
  if (!first.has_orientation) std::copy(straight, straight + 6, first.orientation);
  const double *o = first.orientation;
  double normal[3] = {o[1] * o[5] - o[2] * o[4], o[2] * o[3] - o[0] * o[5], o[0] * o[4] - o[1] * o[3]};
  bool known = offsets.size() == p.frames;
  p.cine = !known && first.between == 0 && set.FindDataElement(Tag(0x18, 0x1063));
  if (!first.has_position && !p.cine) return; // a stack without positions, sorted by turn
  double step = p.cine ? 0 : first.between != 0 ? first.between : first.thickness;
  for (uint32_t f = 0; f < p.frames; f++) {
    double along = known ? offsets[f] - offsets[0] : f * step;
    for (int k = 0; k < 3; k++)
      p.slices[f].position[k] = first.position[k] + along * normal[k];
    p.slices[f].has_position = true;
  }
}

// Attributes of the header that apply to all frames.
static tc_dicom_slice common_slice(const DataSet &set, const Picture &p) {
  tc_dicom_slice s{};
  s.source = static_cast<uint32_t>(p.source);
  s.rows = p.samples.rows;
  s.columns = p.samples.columns;
  s.instance = static_cast<int32_t>(integer_of(set, Tag(0x20, 0x13), 0));
  s.sparse = p.modality == "SEG";
  s.fractional = p.fractional;
  read_keys(set, s);
  read_geometry(set, s);
  Nested detector = item_of(set, Tag(0x54, 0x22)); // nuclear medicine stores position and orientation here
  if (detector.set && !s.has_position) read_geometry(*detector.set, s);
  if (!s.has_spacing) s.has_spacing = read_spacing(set, Tag(0x18, 0x1164), s.spacing);
  return s;
}

static void read_fractions(const DataSet &set, Picture &p) {
  p.fractional = p.modality == "SEG" && text_of(set, Tag(0x62, 0x01)) == "FRACTIONAL";
  if (!p.fractional) return;
  p.most_fraction = std::max<uint16_t>(1, binary_of<uint16_t>(set, Tag(0x62, 0x0e), 255));
  p.segment_threshold = std::ceil(p.most_fraction / 2);
  const std::string type = text_of(set, Tag(0x62, 0x10));
  p.fraction_of = type == "PROBABILITY" ? "probability" : type == "OCCUPANCY" ? "occupancy" : "fraction";
}

void read_slices(const DataSet &set, Picture &p) {
  Scale scale;
  read_fractions(set, p);
  tc_dicom_slice common = common_slice(set, p);
  read_scale(set, p, scale);
  read_window(set, p);
  double dose = number_of(set, Tag(0x3004, 0x0e), 0);
  if (dose > 0 && dose < 1e30) scale.slope = dose;
  if (p.fractional) scale.slope = 1 / p.most_fraction;
  Nested shared = item_of(set, Tag(0x5200, 0x9229));
  if (shared.set) read_groups(*shared.set, p, common, scale);
  Items frames = items_of(set, Tag(0x5200, 0x9230));
  if (frames && frames->GetNumberOfItems() < p.frames)
    fail(TC_ERROR_FORMAT, "the header describes fewer frames than it announces");
  p.slices.assign(p.frames, common);
  p.scales.assign(p.frames, scale);
  for (uint32_t f = 0; f < p.frames; f++) {
    p.slices[f].frame = f;
    if (frames) read_groups(frames->GetItem(f + 1).GetNestedDataSet(), p, p.slices[f], p.scales[f]);
  }
  if (!frames && p.frames > 1) spread_frames(set, p);
  if (p.mosaic) unfold_mosaic(set, p);
  read_segments(set, p);
  p.label_map = p.modality == "SEG" && text_of(set, Tag(0x62, 0x01)) == "LABELMAP";
  p.background = binary_of<uint16_t>(set, Tag(0x28, 0x120), 0);
}

} // namespace dicom
