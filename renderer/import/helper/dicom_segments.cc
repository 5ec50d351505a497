// Segments of segmentations and regions of structure sets: names, colours, contours.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <set>

#include "renderer/import/helper/dicom_picture.h"

namespace dicom {

// Converts CIE L*a*b* of the profile connection space (D50), as 16-bit numbers, to sRGB (PS3.3, C.10.7.1.1; ICC.1,
// sRGB's matrix adapted to D50).
static void rgb_of_lab(const uint16_t lab[3], float rgb[3]) {
  static const double white[3] = {0.9642, 1.0, 0.8249}, matrix[3][3] = {{3.1338561, -1.6168667, -0.4906146},
                                                                        {-0.9787684, 1.9161415, 0.0334540},
                                                                        {0.0719453, -0.2289914, 1.4052427}};
  const double l = lab[0] * 100 / 65535.0, a = lab[1] * 255 / 65535.0 - 128, b = lab[2] * 255 / 65535.0 - 128;
  const double f[3] = {(l + 16) / 116 + a / 500, (l + 16) / 116, (l + 16) / 116 - b / 200};
  double xyz[3];
  for (int i = 0; i < 3; i++)
    xyz[i] = white[i] * (f[i] > 6.0 / 29 ? f[i] * f[i] * f[i] : (f[i] - 4.0 / 29) * 108 / 841);
  for (int i = 0; i < 3; i++) {
    const double linear = matrix[i][0] * xyz[0] + matrix[i][1] * xyz[1] + matrix[i][2] * xyz[2];
    const double value = linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
    rgb[i] = static_cast<float>(std::min(std::max(value, 0.0), 1.0));
  }
}

void read_segments(const DataSet &set, Picture &p) {
  Items items = items_of(set, Tag(0x62, 0x02));
  const size_t count = items ? items->GetNumberOfItems() : 0;
  std::set<uint32_t> known;
  for (size_t i = 1; i <= count; i++) {
    const DataSet &item = items->GetItem(i).GetNestedDataSet();
    tc_segment s{};
    s.label = binary_of<uint16_t>(item, Tag(0x62, 0x04), 0);
    put_words(s.name, words_of(set, item, Tag(0x62, 0x05)));
    const gdcm::ByteValue *lab =
        item.FindDataElement(Tag(0x62, 0x0d)) ? item.GetDataElement(Tag(0x62, 0x0d)).GetByteValue() : nullptr;
    s.has_color = lab && lab->GetPointer() && lab->GetLength() >= 6;
    if (s.has_color) {
      uint16_t numbers[3];
      memcpy(numbers, lab->GetPointer(), sizeof numbers);
      rgb_of_lab(numbers, s.color);
    }
    if (s.label && known.insert(s.label).second) p.segments.push_back(s);
  }
}

// Reads regions of interest, each with closed planar contours: PS3.3, C.8.8.5 and C.8.8.6.
void read_contours(const DataSet &set, Picture &p) {
  Items regions = items_of(set, Tag(0x3006, 0x20)), drawn = items_of(set, Tag(0x3006, 0x39));
  std::map<long, uint32_t> labels; // by the region's number
  for (size_t i = 1; regions && i <= regions->GetNumberOfItems(); i++) {
    const DataSet &item = regions->GetItem(i).GetNestedDataSet();
    tc_segment s{};
    s.label = static_cast<uint32_t>(p.segments.size() + 1);
    put_words(s.name, words_of(set, item, Tag(0x3006, 0x26)));
    if (s.label <= TC_SEGMENTS_MAX && labels.emplace(integer_of(item, Tag(0x3006, 0x22), -1), s.label).second)
      p.segments.push_back(s);
  }
  for (size_t i = 1; drawn && i <= drawn->GetNumberOfItems(); i++) {
    const DataSet &item = drawn->GetItem(i).GetNestedDataSet();
    auto found = labels.find(integer_of(item, Tag(0x3006, 0x84), -2));
    if (found == labels.end()) continue;
    const std::vector<double> color = numbers_of(item, Tag(0x3006, 0x2a));
    tc_segment &s = p.segments[found->second - 1];
    s.has_color = color.size() >= 3;
    for (size_t c = 0; c < 3 && s.has_color; c++)
      s.color[c] = static_cast<float>(std::min(std::max(color[c] / 255, 0.0), 1.0));
    Items contours = items_of(item, Tag(0x3006, 0x40));
    for (size_t k = 1; contours && k <= contours->GetNumberOfItems(); k++) {
      const DataSet &contour = contours->GetItem(k).GetNestedDataSet();
      const std::string type = text_of(contour, Tag(0x3006, 0x42));
      if (type != "CLOSED_PLANAR" && type != "CLOSEDPLANAR_XOR") {
        p.open_contours++;
        continue;
      }
      const size_t at = p.corners.size();
      std::vector<double> numbers = numbers_of(contour, Tag(0x3006, 0x50));
      if (numbers.size() < 9 || numbers.size() % 3 ||
          long(numbers.size() / 3) != integer_of(contour, Tag(0x3006, 0x46), long(numbers.size() / 3)))
        fail(TC_ERROR_FORMAT, "contour %zu of region %zu is cut or no polygon", k, i);
      for (const double mm : numbers)
        if (std::fabs(mm) > 1e6) fail(TC_ERROR_FORMAT, "contour %zu of region %zu lies over a kilometre away", k, i);
      p.corners.insert(p.corners.end(), numbers.begin(), numbers.end());
      p.contours.push_back({found->second, at / 3, numbers.size() / 3, 0});
    }
  }
  if (p.contours.empty()) fail(TC_ERROR_FORMAT, "the set of structures holds no closed contour in a plane");
  Nested frame = item_of(set, Tag(0x3006, 0x10));
  Nested study = frame.set ? item_of(*frame.set, Tag(0x3006, 0x12)) : Nested{};
  Nested series = study.set ? item_of(*study.set, Tag(0x3006, 0x14)) : Nested{};
  if (series.set) p.drawn_on = plain(text_of(*series.set, Tag(0x20, 0x0e)), 64);
  p.frames = 0;
}

} // namespace dicom
