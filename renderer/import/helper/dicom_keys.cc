// Keys of a slice: the values that distinguish the volumes of a series.
#include <cmath>
#include <map>

#include "renderer/import/helper/dicom_picture.h"

namespace dicom {

// Hash of a text, 0 for an empty one.
static uint64_t checksum(const std::string &text) {
  uint64_t sum = 14695981039346656037u;
  for (char c : text)
    sum = (sum ^ static_cast<uint8_t>(c)) * 1099511628211u;
  return text.empty() ? 0 : sum;
}

// Text keys are numbered in order of appearance and ranked when all are known.
static std::map<std::string, double> key_texts;

static double text_key(const std::string &text, double otherwise) {
  return text.empty() ? otherwise : key_texts.emplace(text, double(key_texts.size() + 1)).first->second;
}

void order_text_keys(std::vector<tc_dicom_slice> &slices) {
  std::vector<double> rank(key_texts.size() + 1, 0);
  double next = 0;
  for (const auto &entry : key_texts)
    rank[size_t(entry.second)] = ++next;
  for (tc_dicom_slice &s : slices)
    for (int key : {TC_DICOM_KEY_STACK, TC_DICOM_KEY_IMAGE_TYPE})
      s.keys[key] = rank[size_t(s.keys[key])];
}

static double float_key(const DataSet &set, Tag tag, double otherwise) {
  double value = binary_of<double>(set, tag, otherwise);
  return std::isfinite(value) ? value : otherwise;
}

// The b-value, from the standard attribute or from those of three manufacturers.
static double read_b_value(const DataSet &set, double otherwise) {
  double value = float_key(set, Tag(0x18, 0x9087), -1);
  if (value >= 0) return value;
  if (text_of(set, Tag(0x19, 0x10)) == "SIEMENS MR HEADER") value = number_of(set, Tag(0x19, 0x100c), -1);
  if (text_of(set, Tag(0x43, 0x10)) == "GEMS_PARM_01") value = std::fmod(number_of(set, Tag(0x43, 0x1039), -1), 1e9);
  if (text_of(set, Tag(0x2001, 0x10)) == "Philips Imaging DD 001")
    value = binary_of<float>(set, Tag(0x2001, 0x1003), -1);
  return std::isfinite(value) && value >= 0 ? value : otherwise;
}

void read_keys(const DataSet &set, tc_dicom_slice &s) {
  double *keys = s.keys;
  keys[TC_DICOM_KEY_STACK] = text_key(text_of(set, Tag(0x20, 0x9056)), 0);
  keys[TC_DICOM_KEY_TIME] = static_cast<double>(integer_of(set, Tag(0x20, 0x100), 0));
  keys[TC_DICOM_KEY_ECHO] = static_cast<double>(integer_of(set, Tag(0x18, 0x86), 0));
  keys[TC_DICOM_KEY_ECHO_TIME] = number_of(set, Tag(0x18, 0x81), 0);
  keys[TC_DICOM_KEY_B_VALUE] = read_b_value(set, 0);
  keys[TC_DICOM_KEY_PHASE] = float_key(set, Tag(0x20, 0x9241), 0);
  keys[TC_DICOM_KEY_IMAGE_TYPE] = text_key(text_of(set, Tag(0x08, 0x08)), 0);
  keys[TC_DICOM_KEY_ACQUISITION] = static_cast<double>(integer_of(set, Tag(0x20, 0x12), 0));
  s.trigger = number_of(set, Tag(0x18, 0x1060), 0);
  s.uid = checksum(text_of(set, Tag(0x08, 0x18)));
}

void read_group_keys(const DataSet &item, tc_dicom_slice &s) {
  Nested content = item_of(item, Tag(0x20, 0x9111)), echo = item_of(item, Tag(0x18, 0x9114)),
         diffusion = item_of(item, Tag(0x18, 0x9117)), heart = item_of(item, Tag(0x18, 0x9118)),
         mr_type = item_of(item, Tag(0x18, 0x9226)), ct_type = item_of(item, Tag(0x18, 0x9329));
  double *keys = s.keys;
  if (content.set) {
    keys[TC_DICOM_KEY_STACK] = text_key(text_of(*content.set, Tag(0x20, 0x9056)), keys[TC_DICOM_KEY_STACK]);
    keys[TC_DICOM_KEY_TIME] = binary_of<uint32_t>(*content.set, Tag(0x20, 0x9128), 0);
  }
  if (echo.set) keys[TC_DICOM_KEY_ECHO_TIME] = float_key(*echo.set, Tag(0x18, 0x9082), 0);
  if (diffusion.set) keys[TC_DICOM_KEY_B_VALUE] = read_b_value(*diffusion.set, 0);
  if (heart.set) {
    keys[TC_DICOM_KEY_PHASE] = float_key(*heart.set, Tag(0x20, 0x9241), 0);
    s.trigger = float_key(*heart.set, Tag(0x20, 0x9153), 0);
  }
  for (const Nested *type : {&mr_type, &ct_type})
    if (type->set)
      keys[TC_DICOM_KEY_IMAGE_TYPE] =
          text_key(text_of(*type->set, Tag(0x08, 0x9007)) + text_of(*type->set, Tag(0x08, 0x9208)),
                   keys[TC_DICOM_KEY_IMAGE_TYPE]);
}

} // namespace dicom
