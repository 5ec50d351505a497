// Sorts pictures into series: headers of all files are read, series are listed, and one is chosen.
#ifndef TC_DICOM_SERIES_H
#define TC_DICOM_SERIES_H

#include "renderer/import/helper/dicom_group.h"
#include "renderer/import/helper/dicom_picture.h"
#include "renderer/import/helper/order.h"

namespace dicom {

struct Series {
  std::vector<const Picture *> pictures;
  uint64_t frames = 0;
};

struct Run {
  const tc_order &order;
  const tc_helper_request &request;
  tc_dicom_sources sources{};
  std::vector<Picture *> pictures; // owned; pointers, so that a growing list does not move the pictures
  size_t unreadable = 0;
  Run(const tc_order &out, const tc_helper_request &wanted) : order(out), request(wanted) {}
  ~Run() {
    for (Picture *p : pictures)
      delete p;
    tc_dicom_sources_finish(&sources);
  }
};

void progress(const Run &run, double fraction);
void scan(Run &run, int input); // reads the headers of all files
// Series sorted by series number, then by UID.
std::vector<Series> series_of(const Run &run);
void list(const Run &run); // sends a message for every volume of every series

// The text after the '#' of a path: "2", "UID", "volume=3", or "2#volume=3".
struct Choice {
  std::string series;
  unsigned volume = 0;
};

Choice read_choice(const std::string &text);
const Series &choose_series(const std::vector<Series> &all, const std::string &wanted);
std::vector<tc_dicom_slice> slices_of(const Series &series);

// The volumes of a series.
struct Volumes : tc_dicom_groups {
  explicit Volumes(const std::vector<tc_dicom_slice> &slices) {
    tc_dicom_groups_make(slices.data(), slices.size(), this);
  }
  ~Volumes() { tc_dicom_groups_finish(this); }
  Volumes(const Volumes &) = delete;
};

} // namespace dicom
#endif
