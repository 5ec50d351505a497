// One file with pictures, as its header describes it; each part of the header is read in a file of its own. Tags that
// identify a patient are asked for only where the request wants them; messages hold counts and names of attributes, no
// values.
#ifndef TC_DICOM_PICTURE_H
#define TC_DICOM_PICTURE_H

#include "renderer/import/helper/dicom_contours.h"
#include "renderer/import/helper/dicom_pixels.h"
#include "renderer/import/helper/dicom_sources.h"
#include "renderer/import/helper/dicom_stack.h"
#include "renderer/import/helper/dicom_values.h"

namespace dicom {

constexpr uint64_t FRAMES_MAX = 200000; // pictures of one run

struct Scale {
  double slope = 1, intercept = 0;
  bool operator!=(const Scale &o) const { return slope != o.slope || intercept != o.intercept; }
};

// What the first pass keeps of a file with pictures.
struct Picture {
  size_t source;
  std::string series, modality, unit, scale_type;
  std::string description, time, day, patient;
  int series_number = 0;
  tc_dicom_samples samples{};
  uint32_t frames = 1;
  Tag pixels{0x7fe0, 0x0010};
  bool native = false; // bytes as they are, no codec
  bool run_lengths = false;
  bool swapped = false;      // big-endian 32-bit samples, whose halves GDCM leaves in the file's order
  size_t ends_at = 0;        // packed pixels without the mark at their end: their last item ends here; 0: they have it
  size_t deflated_at = 0;    // a deflated data set begins here; 0 otherwise
  uint32_t tiles_across = 0; // a mosaic: its slices lie side by side in one picture, row by row; 0: none
  bool palette = false, inverted = false, cine = false, mosaic = false, fractional = false;
  std::vector<uint16_t> lookup; // what samples from `lookup_first` on stand for; empty: for themselves
  int32_t lookup_first = 0;
  double window_center = 0, window_width = 0;
  double suv = 0;                         // PET: what values are multiplied by; 0 none
  const char *no_suv = "";                // why
  double segment_threshold = 1;           // samples at or above it belong to the segment
  double most_fraction = 1;               // the sample that means all of a fractional segment
  std::string fraction_of;                // "probability", "occupancy", "fraction"
  bool label_map = false;                 // samples are labels themselves
  uint32_t background = 0;                // of a label map
  std::vector<tc_segment> segments;       // what labels are
  std::vector<tc_dicom_contour> contours; // of a set of structures, which has no frames: their points are `corners`
  std::vector<double> corners;
  size_t open_contours = 0;           // that enclose nothing and are left out
  std::string drawn_on;               // the series that they were drawn on
  std::vector<tc_dicom_slice> slices; // [frames]
  std::vector<Scale> scales;          // [frames]
};

// Reads one header. False: no picture in it (a report, a plan, a directory).
bool read_picture(const tc_dicom_blob &blob, size_t source, bool patient, Picture &p);
// How colours are coded; fails for codings that are not read.
tc_dicom_colour colour_of(const std::string &photometric);

// dicom_slices.cc: where every frame lies and what its samples mean, from the file's header and its functional groups.
void read_slices(const DataSet &set, Picture &p);

// dicom_keys.cc: what tells the volumes of a series apart, in the header of a file of its own, or in an item of the
// functional groups. Keys that are texts are numbered as they come; order_text_keys() makes ranks of them.
void read_keys(const DataSet &set, tc_dicom_slice &s);
void read_group_keys(const DataSet &item, tc_dicom_slice &s);
void order_text_keys(std::vector<tc_dicom_slice> &slices);

// dicom_mosaic.cc: a mosaic becomes its slices.
void unfold_mosaic(const DataSet &set, Picture &p);

// dicom_segments.cc: what labels are, and the closed contours of a set of structures.
void read_segments(const DataSet &set, Picture &p);
void read_contours(const DataSet &set, Picture &p);

} // namespace dicom
#endif
