#include "renderer/import/helper/dicom_volume.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace dicom {

void make_stack(const Series &series, const Choice &choice, bool bridge_nothing, Job &job) {
  GError *error = nullptr;
  tc_volume_desc &d = job.desc;
  std::vector<tc_dicom_slice> slices = slices_of(series);
  for (const Picture *p : series.pictures)
    for (uint32_t f = 0; f < p->frames; f++) job.members.push_back(Member{p, f, p->scales[f]});
  Volumes volumes(slices);
  int chosen = tc_dicom_groups_choose(&volumes, choice.volume, &error);
  if (chosen < 0) fail_with(error);
  const tc_dicom_group &group = volumes.list[chosen];
  job.fraction = group.segment;
  if (group.tangled)
    fail(TC_ERROR_FORMAT, "%zu pictures share %zu positions and nothing in their headers tells them apart; sort them",
         group.count, group.places);
  if (!tc_dicom_stack_make(slices.data(), group.slices, group.count, &job.stack, &error)) fail_with(error);
  if (job.stack.bridged && bridge_nothing)
    fail(TC_ERROR_FORMAT, "slice %d of %d is missing, and none is made up here; send the whole series",
         job.stack.bridged, job.stack.dims[2]);
  d.frames = static_cast<int>(volumes.count);
  job.from.volume = chosen + 1;
  job.from.slices_used = static_cast<int>(group.places);
  job.from.slices_found = static_cast<int>(volumes.places);
  if (volumes.count > 1)
    tc_dicom_note(d.note, "volume %d of %zu%s%s, choose by #volume=N", chosen + 1, volumes.count,
                  group.what[0] ? ": " : "", group.what);
  if (group.places < volumes.places) tc_dicom_note(d.note, "%zu of %zu slices", group.places, volumes.places);
  if (volumes.copies) tc_dicom_note(d.note, "%zu copies of pictures left out", volumes.copies);
}

void apply_suv(Job &job) {
  const Picture &first = job.first();
  const char *missing = first.no_suv;
  bool all = true;
  for (size_t i = 0; i < job.stack.count; i++) {
    const Picture &p = *job.at(i).picture;
    if (!(p.suv > 0)) missing = p.no_suv;
    all = all && p.suv > 0;
  }
  if (!all) {
    if (*missing) tc_dicom_note(job.desc.note, "no SUV: %s", missing);
    return;
  }
  for (Member &m : job.members) {
    m.scale.slope *= m.picture->suv;
    m.scale.intercept *= m.picture->suv;
  }
  job.suv = first.suv;
  tc_dicom_note(job.desc.note, "SUV by body weight");
}

// Storage type of 32-bit and wider integers by their range (the storage rule of import.h).
static tc_voxel_type narrow_type(const Job &job, const Run &run) {
  Decoder decoder(run.sources);
  double lo = INFINITY, hi = -INFINITY;
  for (size_t i = 0; i < job.stack.count; i++) {
    Frame f = decoder.frame(*job.at(i).picture, job.at(i).frame);
    if (!tc_dicom_range(&f, &lo, &hi)) fail(TC_ERROR_FORMAT, "pixel data is cut");
  }
  if (lo >= 0 && hi <= 255) return TC_U8;
  if (lo >= -128 && hi <= 127) return TC_I8;
  if (lo >= 0 && hi <= 65535) return TC_U16;
  if (lo >= -32768 && hi <= 32767) return TC_I16;
  return TC_F32;
}

// The smallest type that holds the samples of all pictures of the volume (a series may mix depths and signs).
static tc_voxel_type common_type(const Job &job) {
  bool narrow_signed = false, wide_signed = false, wide = false;
  for (size_t i = 0; i < job.stack.count; i++) {
    const bool looked_up = !job.at(i).picture->lookup.empty();
    tc_voxel_type type = looked_up                    ? TC_U16
                         : job.at(i).picture->palette ? TC_U8
                                                      : tc_dicom_natural_type(&job.at(i).picture->samples);
    if (type == TC_F32) return TC_F32;
    wide |= type == TC_U16 && (looked_up || job.at(i).picture->samples.stored == 16);
    wide_signed |= type == TC_U16 || type == TC_I16;
    narrow_signed |= type == TC_I8 || type == TC_I16;
  }
  if (!narrow_signed) return wide_signed ? TC_U16 : TC_U8;
  return wide ? TC_F32 : wide_signed ? TC_I16 : TC_I8;
}

// Whether a picture is in colour and all samples have at most 16 bits.
static bool in_color(const Job &job) {
  bool any = false, narrow = true;
  for (size_t i = 0; i < job.stack.count; i++) {
    const Picture &p = *job.at(i).picture;
    any |= p.palette || p.samples.colour != TC_DICOM_GREY;
    narrow &=
        p.palette || (p.samples.stored <= p.samples.allocated && p.samples.allocated <= 16 && !p.samples.is_signed);
  }
  return any && narrow;
}

void choose_type(Job &job, const Run &run) {
  tc_volume_desc &d = job.desc;
  const Scale &scale = job.at(0).scale;
  for (size_t i = 0; i < job.stack.count; i++) job.rescale |= job.at(i).scale != scale;
  d.slope = 1;
  if (find_overlaps(job, run)) {
    d.type = type_of_labels(job);
    return;
  }
  d.type = common_type(job);
  job.colors = job.from.colors = in_color(job);
  if (job.colors) job.rescale = false;
  if (job.rescale) {
    d.type = TC_F32;
    tc_dicom_note(d.note, "slices differ in rescale slope, values stored as f32");
    return;
  }
  d.slope = scale.slope;
  d.intercept = scale.intercept;
  const tc_dicom_samples &s = job.first().samples;
  if (d.type != TC_F32) return;
  if (!s.is_float && s.stored > 16) d.type = narrow_type(job, run);
  if (!s.is_float || s.allocated == 64)
    tc_dicom_note(d.note, "%d-bit %s stored as %s", s.stored, s.is_float ? "floats" : "integers",
                  d.type == TC_F32 ? "f32" : "narrower integers");
}

static void describe_fractions(Job &job, const Picture &p) {
  tc_volume_desc &d = job.desc;
  if (job.labels)
    tc_dicom_note(d.note, "fractions are cut at half (%g of %g) for labels; each segment's own are a volume",
                  p.segment_threshold, p.most_fraction);
  for (const tc_segment &s : p.segments)
    if (job.fraction && s.label == job.fraction) tc_dicom_note(d.note, "fractions of %s", s.name);
  if (job.fraction) snprintf(d.unit, sizeof d.unit, "%s", p.fraction_of.c_str());
}

void describe(Job &job, const Run &run) {
  tc_volume_desc &d = job.desc;
  const Picture &p = job.first();
  size_t unended = 0;
  for (size_t i = 0; i < job.stack.count; i++) unended += job.at(i).picture->ends_at != 0;
  snprintf(d.format, sizeof d.format, "dicom");
  put_words(job.from.description, p.description);
  snprintf(job.from.time, sizeof job.from.time, "%s", p.time.c_str());
  std::copy(job.stack.dims, job.stack.dims + 3, d.dims);
  std::copy(job.stack.spacing, job.stack.spacing + 3, d.spacing);
  std::copy(job.stack.origin, job.stack.origin + 3, d.origin);
  std::copy(job.stack.direction, job.stack.direction + 9, d.direction);
  job.from.bridged = job.stack.bridged;
  job.from.resampled = job.stack.mix && !job.stack.bridged;
  d.window_center = p.window_center * (job.suv > 0 ? job.suv : 1);
  d.window_width = p.window_width * (job.suv > 0 ? job.suv : 1);
  snprintf(d.modality, sizeof d.modality, "%s", p.modality.c_str());
  std::string unit = !p.unit.empty() ? p.unit : p.scale_type == "US" ? "" : p.scale_type;
  if (unit.empty() && p.modality == "CT" && p.scale_type.empty()) unit = "HU";
  if (job.suv > 0) unit = "SUVbw";
  snprintf(d.unit, sizeof d.unit, "%s", unit.c_str());
  if (job.stack.note[0]) tc_dicom_note(d.note, "%s", job.stack.note);
  if (p.samples.colour != TC_DICOM_GREY || p.palette)
    tc_dicom_note(d.note, "colour became luma%s", job.colors ? ", but in slices" : "");
  if (p.inverted) tc_dicom_note(d.note, "MONOCHROME1, values kept as they are");
  if (p.cine) tc_dicom_note(d.note, "a film over time, its first picture was taken");
  if (p.mosaic) tc_dicom_note(d.note, "a mosaic, cut into its slices");
  if (p.fractional) describe_fractions(job, p);
  if (!p.lookup.empty()) tc_dicom_note(d.note, "values are those of the modality lookup table");
  if (unended) tc_dicom_note(d.note, "%zu slices lack the mark at the end of their pixels, which are all there", unended);
  if (run.unreadable) tc_dicom_note(d.note, "%zu unreadable files left out", run.unreadable);
}

size_t layer_bytes(const Job &job) {
  const tc_volume_desc &d = job.desc;
  size_t width = job.colors ? 3 : d.type == TC_F32 ? 4 : d.type == TC_U16 || d.type == TC_I16 ? 2 : 1;
  return size_t(d.dims[0]) * size_t(d.dims[1]) * width;
}

void check_size(const Job &job, uint64_t most) {
  uint64_t bytes = uint64_t{layer_bytes(job)} * static_cast<uint64_t>(job.desc.dims[2]); // below 2^34 * 2^18
  if (most && bytes > most)
    fail(TC_ERROR_LIMIT, "the series holds %llu bytes of voxels, more than the limit of %llu",
         (unsigned long long)bytes, (unsigned long long)most);
}

} // namespace dicom
