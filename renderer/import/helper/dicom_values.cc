#include "renderer/import/helper/dicom_values.h"

#include <algorithm>
#include <cmath>

namespace dicom {

constexpr size_t TEXT_BYTES_MAX = 1024 * 1024;

std::string text_of(const DataSet &set, Tag tag) {
  if (!set.FindDataElement(tag)) return "";
  const gdcm::ByteValue *value = set.GetDataElement(tag).GetByteValue();
  if (!value || !value->GetPointer()) return "";
  size_t size = std::min<size_t>(value->GetLength(), TEXT_BYTES_MAX);
  std::string text(value->GetPointer(), size);
  text.resize(strnlen(text.c_str(), size));
  size_t end = text.find_last_not_of(" \r\n\t"), start = text.find_first_not_of(" \r\n\t");
  return end == std::string::npos ? "" : text.substr(start, end - start + 1);
}

std::vector<double> numbers_of(const DataSet &set, Tag tag) {
  std::vector<double> out;
  std::string text = text_of(set, tag);
  for (const char *at = text.c_str(); *at;) {
    char *end;
    double value = g_ascii_strtod(at, &end);
    if (end == at || !std::isfinite(value)) break;
    out.push_back(value);
    while (*end == ' ')
      end++;
    if (*end != '\\') break;
    at = end + 1;
  }
  return out;
}

double number_of(const DataSet &set, Tag tag, double otherwise) {
  std::vector<double> n = numbers_of(set, tag);
  return n.empty() ? otherwise : n[0];
}

long integer_of(const DataSet &set, Tag tag, long otherwise) {
  double value = number_of(set, tag, otherwise);
  return std::fabs(value) < 2e9 ? static_cast<long>(value) : otherwise;
}

bool read_vector(const DataSet &set, Tag tag, double *out, size_t count) {
  std::vector<double> n = numbers_of(set, tag);
  if (n.size() < count) return false;
  std::copy(n.begin(), n.begin() + count, out);
  return true;
}

Items items_of(const DataSet &set, Tag tag) {
  if (!set.FindDataElement(tag)) return nullptr;
  return set.GetDataElement(tag).GetValueAsSQ();
}

Nested item_of(const DataSet &set, Tag tag, size_t number) {
  Nested nested;
  nested.keep = items_of(set, tag);
  if (nested.keep && nested.keep->GetNumberOfItems() >= number)
    nested.set = &nested.keep->GetItem(number).GetNestedDataSet();
  return nested;
}

std::string plain(const std::string &text, size_t most) {
  std::string out;
  for (char c : text)
    if (c > 0x20 && c < 0x7f && out.size() < most) out += c;
  return out;
}

std::string words_of(const DataSet &root, const DataSet &set, Tag tag) {
  const std::string text = text_of(set, tag), charset = text_of(root, Tag(0x08, 0x05));
  if (g_utf8_validate(text.data(), static_cast<gssize>(text.size()), nullptr)) return text;
  const bool latin = charset == "ISO_IR 100" || charset == "ISO 2022 IR 100";
  std::string out;
  for (char c : text) {
    const uint8_t byte = static_cast<uint8_t>(c);
    if (byte < 0x80)
      out += c;
    else if (latin && byte >= 0xa0)
      out += {static_cast<char>(0xc0 | byte >> 6), static_cast<char>(0x80 | (byte & 0x3f))};
    else
      out += '?';
  }
  return out;
}

} // namespace dicom
