// Segmentations: converts frames of segments to layers of labels.
#include <algorithm>
#include <cstring>

#include "renderer/import/helper/dicom_volume.h"

namespace dicom {

static uint32_t segment_of(const Job &job, size_t item) {
  return job.at(item).picture->slices[job.at(item).frame].segment;
}

void stamp_layer(Job &job, Decoder &decoder, size_t from, size_t to, std::vector<uint16_t> &labels) {
  labels.assign(size_t(job.desc.dims[0]) * size_t(job.desc.dims[1]), 0);
  for (size_t item = from; item < to; item++) {
    const Member &m = job.at(item);
    Frame f = decoder.frame(*m.picture, m.frame);
    if (!tc_dicom_stamp(&f, m.picture->segment_threshold, segment_of(job, item),
                        &job.overlaps, labels.data()))
      fail(TC_ERROR_FORMAT, "pixel data of slice %u of %d is cut", job.stack.items[item].layer + 1, job.desc.dims[2]);
  }
}

static size_t end_of_layer(const Job &job, size_t item) {
  const uint32_t layer = job.stack.items[item].layer;
  while (item < job.stack.count && job.stack.items[item].layer == layer)
    item++;
  return item;
}

bool find_overlaps(Job &job, const Run &run) {
  uint32_t most = 0;
  for (size_t i = 0; i < job.stack.count; i++)
    most = std::max(most, segment_of(job, i));
  if (most == 0 || job.fraction) return false;
  for (const tc_segment &s : job.first().segments) // a segment without frames keeps its number
    most = std::max(most, s.label);
  job.labels = true;
  std::copy(job.stack.dims, job.stack.dims + 3, job.desc.dims);
  tc_overlaps_init(&job.overlaps, most);
  Decoder decoder(run.sources);
  std::vector<uint16_t> labels;
  for (size_t item = 0; item < job.stack.count;) {
    const size_t end = end_of_layer(job, item);
    if (end > item + 1) stamp_layer(job, decoder, item, end, labels);
    item = end;
    progress(run, 0.2);
  }
  return true;
}

tc_voxel_type type_of_labels(Job &job) {
  const uint32_t most = tc_overlaps_most(&job.overlaps);
  if (most > job.overlaps.last)
    tc_dicom_note(job.desc.note, "where segments overlap, combinations of them have labels of their own (%u)",
                  most - job.overlaps.last);
  if (job.overlaps.full) tc_dicom_note(job.desc.note, "too many combinations: the later segment is kept");
  return most > 255 ? TC_U16 : TC_U8;
}

void put_labels(const Job &job, const std::vector<uint16_t> &labels, uint8_t *layer) {
  if (job.desc.type == TC_U8)
    std::copy(labels.begin(), labels.end(), layer);
  else
    memcpy(layer, labels.data(), labels.size() * sizeof labels[0]);
}

void clear_background(const Job &job, uint32_t background, uint8_t *layer) {
  const size_t count = size_t(job.desc.dims[0]) * size_t(job.desc.dims[1]);
  uint16_t *wide = reinterpret_cast<uint16_t *>(layer);
  if (job.desc.type == TC_U8) std::replace(layer, layer + count, static_cast<uint8_t>(background), uint8_t{0});
  if (job.desc.type == TC_U16) std::replace(wide, wide + count, static_cast<uint16_t>(background), uint16_t{0});
}

void send_segments(const Run &run, const Job &job, const Picture &p) {
  GError *error = nullptr;
  if ((job.labels || p.label_map) &&
      !tc_overlaps_send(&job.overlaps, p.segments.data(), p.segments.size(), &run.order, &error))
    fail_with(error);
}

} // namespace dicom
