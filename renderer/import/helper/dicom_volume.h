// Builds the volume from one series: chooses frames and grid, the storage type of voxels, and fills layers.
#ifndef TC_DICOM_VOLUME_H
#define TC_DICOM_VOLUME_H

#include "renderer/import/helper/dicom_decoder.h"
#include "renderer/import/helper/dicom_series.h"
#include "renderer/import/helper/overlaps.h"

namespace dicom {

// One frame of the series and its scale.
struct Member {
  const Picture *picture;
  uint32_t frame;
  Scale scale;
};

// The volume to send: its frames, and the conversion of samples to voxels.
struct Job {
  std::vector<Member> members; // frames of the series
  tc_dicom_stack stack{};      // items index `members`
  tc_volume_desc desc{};
  tc_provenance from{};
  bool rescale = false; // scales differ, so they are applied to every voxel
  bool labels = false;  // voxels are labels of segments
  uint32_t fraction = 0; // segment whose fractions are the values; 0: none
  bool colors = false;  // voxels are sent as r, g, b
  tc_overlaps overlaps{};
  double suv = 0; // factor to SUV that values were multiplied by; 0: values are the file's
  Job() = default;
  Job(const Job &) = delete;
  ~Job() {
    tc_dicom_stack_finish(&stack);
    tc_overlaps_finish(&overlaps);
  }
  const Member &at(size_t item) const { return members[stack.items[item].slice]; }
  const Picture &first() const { return *at(0).picture; }
};

// Chooses the volume, places its frames on a grid, and describes how it differs from others of the series.
void make_stack(const Series &series, const Choice &choice, bool bridge_nothing, Job &job);
// Converts PET to SUV if every picture of the volume allows it.
void apply_suv(Job &job);
void choose_type(Job &job, const Run &run);
void describe(Job &job, const Run &run);
size_t layer_bytes(const Job &job);
void check_size(const Job &job, uint64_t most);

// dicom_labels.cc: false if the frames do not belong to segments. If frames of several segments share a position, all
// are read once to find the combinations, whose number determines the voxel type.
bool find_overlaps(Job &job, const Run &run);
tc_voxel_type type_of_labels(Job &job);
// Fills the labels of a layer from the items [from, to) of the stack.
void stamp_layer(Job &job, Decoder &decoder, size_t from, size_t to, std::vector<uint16_t> &labels);
void put_labels(const Job &job, const std::vector<uint16_t> &labels, uint8_t *layer); // converts labels to voxels
void clear_background(const Job &job, uint32_t background, uint8_t *layer); // replaces a label map's background, if it is not 0, by 0
void send_segments(const Run &run, const Job &job, const Picture &p);       // sends descriptions of the labels

// dicom_layers.cc: sends voxels layer by layer, in order, after begin().
void begin(const Run &run, const Job &job);
void put_layer(const Run &run, const std::vector<uint8_t> &layer);
void send_layers(const Run &run, Job &job);

// dicom_structures.cc: fills the contours of `p` and sends the labels.
void load_structures(const Run &run, const std::vector<Series> &all, const Picture &p, Job &job);

} // namespace dicom
#endif
