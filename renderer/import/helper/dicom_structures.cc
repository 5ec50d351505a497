// Structure sets (RTSTRUCT): fills contours on the grid of the series that they were drawn on.
#include <algorithm>
#include <cstdio>

#include "renderer/import/helper/dicom_volume.h"

namespace dicom {

// Uses the grid of the series that the contours were drawn on if it is among the input, else a grid from the
// contours' planes.
static void grid_for(const std::vector<Series> &all, const Picture &p, const tc_dicom_contours &contours,
                     tc_volume_desc &d) {
  GError *error = nullptr;
  for (const Series &s : all) {
    if (s.frames == 0 || p.drawn_on.empty() || s.pictures[0]->series != p.drawn_on) continue;
    Job beside;
    try {
      make_stack(s, Choice{}, false, beside);
    } catch (const Failure &) {
      continue;
    }
    const tc_dicom_stack &stack = beside.stack;
    std::copy(stack.dims, stack.dims + 3, d.dims);
    std::copy(stack.spacing, stack.spacing + 3, d.spacing);
    std::copy(stack.origin, stack.origin + 3, d.origin);
    std::copy(stack.direction, stack.direction + 9, d.direction);
    tc_dicom_note(d.note, "contours filled on the grid of series %d", s.pictures[0]->series_number);
    return;
  }
  if (!tc_dicom_contours_grid(&contours, &d, &error)) fail_with(error);
  tc_dicom_note(d.note, "contours filled on a grid of their planes, pixels of %.3g mm", d.spacing[0]);
}

static void describe_structures(Job &job, const Picture &p, size_t outside) {
  tc_volume_desc &d = job.desc;
  if (p.open_contours) tc_dicom_note(d.note, "%zu contours that enclose nothing left out", p.open_contours);
  if (outside) tc_dicom_note(d.note, "%zu of %zu contours lie off the grid", outside, p.contours.size());
  d.slope = 1;
  d.type = type_of_labels(job);
  snprintf(d.format, sizeof d.format, "dicom");
  snprintf(d.modality, sizeof d.modality, "%s", p.modality.c_str());
  put_words(job.from.description, p.description);
  snprintf(job.from.time, sizeof job.from.time, "%s", p.time.c_str());
}

void load_structures(const Run &run, const std::vector<Series> &all, const Picture &p, Job &job) {
  std::vector<tc_dicom_contour> list = p.contours;
  std::vector<double> corners = p.corners;
  tc_dicom_contours contours{list.data(), list.size(), corners.data(), 0};
  GError *error = nullptr;
  tc_volume_desc &d = job.desc;
  d.frames = 1;
  d.slope = 1;
  grid_for(all, p, contours, d);
  check_size(job, run.order.max_voxel_bytes);
  if (!tc_dicom_contours_place(&contours, &d, &error)) fail_with(error);
  if (contours.outside == contours.count) fail(TC_ERROR_FORMAT, "the contours lie outside the series that they name");
  std::vector<uint16_t> labels(size_t(d.dims[0]) * size_t(d.dims[1]));
  job.labels = true;
  tc_overlaps_init(&job.overlaps, static_cast<uint32_t>(p.segments.size()));
  for (int z = 0; z < d.dims[2]; z++) { // the combinations that occur determine the voxel type
    tc_dicom_contours_fill(&contours, &d, z, &job.overlaps, labels.data());
    progress(run, 0.2 + 0.4 * double(z) / d.dims[2]);
  }
  describe_structures(job, p, contours.outside);
  begin(run, job);
  send_segments(run, job, p);
  std::vector<uint8_t> layer(layer_bytes(job));
  for (int z = 0; z < d.dims[2]; z++) {
    tc_dicom_contours_fill(&contours, &d, z, &job.overlaps, labels.data());
    put_labels(job, labels, layer.data());
    put_layer(run, layer);
    progress(run, 0.6 + 0.4 * double(z) / d.dims[2]);
  }
}

} // namespace dicom
