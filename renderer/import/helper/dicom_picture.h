// One file with pictures, as its header describes it; each part of the header is read in its own source file. Tags
// that identify a patient are read only if the request asks for them; messages contain counts and attribute names, no
// values.
#ifndef TC_DICOM_PICTURE_H
#define TC_DICOM_PICTURE_H

#include "renderer/import/helper/dicom_contours.h"
#include "renderer/import/helper/dicom_pixels.h"
#include "renderer/import/helper/dicom_sources.h"
#include "renderer/import/helper/dicom_stack.h"
#include "renderer/import/helper/dicom_values.h"

namespace dicom {

constexpr uint64_t FRAMES_MAX = 200000; // limit on pictures per run

struct Scale {
  double slope = 1, intercept = 0;
  bool operator!=(const Scale &o) const { return slope != o.slope || intercept != o.intercept; }
};

// Facts that the first pass keeps about a file with pictures.
struct Picture {
  size_t source;
  std::string series, modality, unit, scale_type;
  std::string description, time, day, patient;
  int series_number = 0;
  tc_dicom_samples samples{};
  uint32_t frames = 1;
  Tag pixels{0x7fe0, 0x0010};
  bool native = false; // uncompressed pixels
  bool run_lengths = false;
  bool swapped = false;      // big-endian 32-bit samples, whose halves GDCM leaves in the file's order
  size_t ends_at = 0;        // offset of the end of the last fragment, for encapsulated pixels without a delimiter; 0: they have one
  size_t deflated_at = 0;    // offset of a deflated data set; 0: not deflated
  uint32_t tiles_across = 0; // a mosaic: slices per row of the picture; 0: not a mosaic
  bool palette = false, inverted = false, cine = false, mosaic = false, fractional = false;
  std::vector<uint16_t> lookup; // values of samples from `lookup_first` on; empty: no look-up table
  int32_t lookup_first = 0;
  double window_center = 0, window_width = 0;
  double suv = 0;                         // PET: factor from values to SUV; 0 none
  const char *no_suv = "";                // the reason
  double segment_threshold = 1;           // samples at or above it belong to the segment
  double most_fraction = 1;               // sample of a fractional segment that means 1
  std::string fraction_of;                // "probability", "occupancy", "fraction"
  bool label_map = false;                 // samples are labels
  uint32_t background = 0;                // background label of a label map
  std::vector<tc_segment> segments;       // descriptions of the labels
  std::vector<tc_dicom_contour> contours; // of a structure set, which has no frames; the points are in `corners`
  std::vector<double> corners;
  size_t open_contours = 0;           // contours that enclose nothing, ignored
  std::string drawn_on;               // UID of the series that they were drawn on
  std::vector<tc_dicom_slice> slices; // [frames]
  std::vector<Scale> scales;          // [frames]
};

// Reads one header. False: it has no picture (a report, a plan, a directory).
bool read_picture(const tc_dicom_blob &blob, size_t source, bool patient, Picture &p);
// Colour coding; fails for unsupported ones.
tc_dicom_colour colour_of(const std::string &photometric);

// dicom_slices.cc: position and scale of every frame, from the file's header and its functional groups.
void read_slices(const DataSet &set, Picture &p);

// dicom_keys.cc: reads the keys that distinguish volumes of a series, from a file's header or from an item of the
// functional groups. Text keys are numbered in order of appearance; order_text_keys() ranks them.
void read_keys(const DataSet &set, tc_dicom_slice &s);
void read_group_keys(const DataSet &item, tc_dicom_slice &s);
void order_text_keys(std::vector<tc_dicom_slice> &slices);

// dicom_mosaic.cc: divides a mosaic into its slices.
void unfold_mosaic(const DataSet &set, Picture &p);

// dicom_segments.cc: descriptions of labels, and the closed contours of a structure set.
void read_segments(const DataSet &set, Picture &p);
void read_contours(const DataSet &set, Picture &p);

} // namespace dicom
#endif
