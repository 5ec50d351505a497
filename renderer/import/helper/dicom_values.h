// Values of a data set: text, numbers written as text, binary numbers, items of sequences. What is absent or damaged is
// empty.
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
// Numbers written as text ("1.5\-2\3"), up to the first thing that is none.
std::vector<double> numbers_of(const DataSet &set, Tag tag);
double number_of(const DataSet &set, Tag tag, double otherwise);
long integer_of(const DataSet &set, Tag tag, long otherwise);
bool read_vector(const DataSet &set, Tag tag, double *out, size_t count); // false, nothing read: fewer than count

// Binary values; GDCM has brought them to this machine's byte order.
template <typename T> T binary_of(const DataSet &set, Tag tag, T otherwise) {
  if (!set.FindDataElement(tag)) return otherwise;
  const gdcm::ByteValue *value = set.GetDataElement(tag).GetByteValue();
  if (!value || !value->GetPointer() || value->GetLength() < sizeof(T)) return otherwise;
  memcpy(&otherwise, value->GetPointer(), sizeof(T));
  return otherwise;
}

Items items_of(const DataSet &set, Tag tag);

// The data set of one item; the sequence is kept alive beside it.
struct Nested {
  Items keep;
  const DataSet *set = nullptr;
};

Nested item_of(const DataSet &set, Tag tag, size_t number = 1);

// Printable ASCII without spaces, at most so many characters: codes and UIDs.
std::string plain(const std::string &text, size_t most);

// Words that people wrote, as UTF-8: what is neither that nor Latin 1, where the file says so, becomes question marks.
std::string words_of(const DataSet &root, const DataSet &set, Tag tag);

// Cut to fit between two characters.
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
