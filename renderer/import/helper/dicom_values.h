// Values of a data set: text, numbers written as text, binary numbers, items of sequences. Missing or damaged values
// are empty.
#ifndef TC_DICOM_VALUES_H
#define TC_DICOM_VALUES_H

#include <cstring>
#include <string>
#include <vector>

#include <gdcmDataSet.h>
#include <gdcmSequenceOfItems.h>
#include <glib.h>

#include "renderer/import/helper/gdcm_guard.h"

namespace dicom {

using gdcm::DataSet;
using gdcm::Tag;
using Items = gdcm::SmartPointer<gdcm::SequenceOfItems>;

std::string text_of(const DataSet &set, Tag tag);
// Parses numbers written as text ("1.5\-2\3"), up to the first malformed one.
std::vector<double> numbers_of(const DataSet &set, Tag tag);
double number_of(const DataSet &set, Tag tag, double otherwise);
long integer_of(const DataSet &set, Tag tag, long otherwise);
bool read_vector(const DataSet &set, Tag tag, double *out, size_t count); // false, with out unchanged, if there are fewer than count

// Binary values; GDCM has converted their byte order.
template <typename T> T binary_of(const DataSet &set, Tag tag, T otherwise) {
  if (!set.FindDataElement(tag)) return otherwise;
  const gdcm::ByteValue *value = set.GetDataElement(tag).GetByteValue();
  if (!value || !value->GetPointer() || value->GetLength() < sizeof(T)) return otherwise;
  memcpy(&otherwise, value->GetPointer(), sizeof(T));
  return otherwise;
}

Items items_of(const DataSet &set, Tag tag);

// The data set of one item, with a reference that keeps its sequence alive.
struct Nested {
  Items keep;
  const DataSet *set = nullptr;
};

Nested item_of(const DataSet &set, Tag tag, size_t number = 1);

// Keeps printable ASCII without spaces, at most `most` characters, for codes and UIDs.
std::string plain(const std::string &text, size_t most);

// Free text as UTF-8. Bytes that are not UTF-8, or Latin 1 if the file declares it, become question marks.
std::string words_of(const DataSet &root, const DataSet &set, Tag tag);

// Copies text, cut between two characters.
template <size_t N> void put_words(char (&out)[N], const std::string &text) {
  size_t at = 0;
  for (const char *c = text.c_str(); *c; c = g_utf8_next_char(c)) {
    const size_t bytes = static_cast<size_t>(g_utf8_next_char(c) - c);
    if (at + bytes >= N) break;
    memcpy(out + at, c, bytes);
    at += bytes;
  }
  out[at] = 0;
}

} // namespace dicom
#endif
