// The volume to be sent, made of one series in steps: which frames on which grid, how samples become voxels, layers.
#ifndef TC_DICOM_VOLUME_H
#define TC_DICOM_VOLUME_H

#include "renderer/import/helper/dicom_decoder.h"
#include "renderer/import/helper/dicom_series.h"
#include "renderer/import/helper/overlaps.h"

namespace dicom {

// One frame of the series, and its scale.
struct Member {
  const Picture *picture;
  uint32_t frame;
  Scale scale;
};

// The volume to be sent: which frames, and how samples become voxels.
struct Job {
  std::vector<Member> members; // of the series
  tc_dicom_stack stack{};      // its items count in members
  tc_volume_desc desc{};
  tc_provenance from{};
  bool rescale = false; // scales differ: applied to every voxel
  bool labels = false;  // of segments
  uint32_t fraction = 0; // the segment whose fractions are the values; 0: none
  bool colors = false;  // voxels are sent as r, g, b
  tc_overlaps overlaps{};
  double suv = 0; // what values were multiplied by; 0: they are the file's
  Job() = default;
  Job(const Job &) = delete;
  ~Job() {
    tc_dicom_stack_finish(&stack);
    tc_overlaps_finish(&overlaps);
  }
  const Member &at(size_t item) const { return members[stack.items[item].slice]; }
  const Picture &first() const { return *at(0).picture; }
};

// Chooses the volume, places it, and says what of the series it is.
void make_stack(const Series &series, const Choice &choice, bool bridge_nothing, Job &job);
// PET in SUV, where every picture of the volume can be.
void apply_suv(Job &job);
void choose_type(Job &job, const Run &run);
void describe(Job &job, const Run &run);
size_t layer_bytes(const Job &job);
void check_size(const Job &job, uint64_t most);

// dicom_labels.cc
// False where the frames are of no segment. Where frames of several lie at one position, all are read once to learn
// which combinations there are: how many labels says how wide voxels are.
bool find_overlaps(Job &job, const Run &run);
tc_voxel_type type_of_labels(Job &job);
// The labels of a layer, from the items [from, to) of the stack.
void stamp_layer(Job &job, Decoder &decoder, size_t from, size_t to, std::vector<uint16_t> &labels);
void put_labels(const Job &job, const std::vector<uint16_t> &labels, uint8_t *layer); // as voxels
void clear_background(const Job &job, uint32_t background, uint8_t *layer); // of a label map, where it is not 0
void send_segments(const Run &run, const Job &job, const Picture &p);       // what labels are

// dicom_layers.cc: voxels leave layer by layer, in order, after begin().
void begin(const Run &run, const Job &job);
void put_layer(const Run &run, const std::vector<uint8_t> &layer);
void send_layers(const Run &run, Job &job);

// dicom_structures.cc: fills the contours of `p` and sends the labels.
void load_structures(const Run &run, const std::vector<Series> &all, const Picture &p, Job &job);

} // namespace dicom
#endif
