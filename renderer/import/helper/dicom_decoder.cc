#include "renderer/import/helper/dicom_decoder.h"

#include <algorithm>
#include <cstring>

#include <gdcmImageApplyLookupTable.h>

namespace dicom {

namespace {
struct Uncap {
  ~Uncap() { set_allocation_cap(SIZE_MAX); }
};
} // namespace

Frame Decoder::frame(const Picture &p, uint32_t number) {
  Uncap uncap;
  if (open_ != &p) open(p);
  set_allocation_cap(cap_);
  const uint32_t stored = p.tiles_across ? 0 : number;
  const Frame f = p.native                      ? native_frame(p, stored)
                  : p.run_lengths && !p.palette ? run_length_frame(p, stored)
                                                : coded_frame(p, stored);
  const Frame own = p.tiles_across ? tile_of(f, p.tiles_across, number) : f;
  return p.lookup.empty() ? own : looked_up(own, p);
}

Frame Decoder::looked_up(const Frame &stored, const Picture &p) {
  Frame f = stored;
  values_.resize(size_t(f.samples.rows) * size_t(f.samples.columns));
  if (!tc_dicom_look_up(&f, p.lookup.data(), p.lookup.size(), p.lookup_first, values_.data()))
    fail(TC_ERROR_FORMAT, "pixel data is cut, or no lookup table is for it");
  f.samples.allocated = f.samples.stored = 16;
  f.samples.high = 15;
  f.samples.is_signed = false;
  f.bytes = reinterpret_cast<const uint8_t *>(values_.data());
  f.size = values_.size() * sizeof values_[0];
  return f;
}

void Decoder::close() {
  reader_.reset();
  plain_reader_.reset();
  tc_dicom_blob_finish(&blob_);
  whole_.clear();
  pieces_.clear();
  runs_.clear();
  open_ = nullptr;
  bytes_ = nullptr;
}

void Decoder::open(const Picture &p) {
  close();
  GError *error = nullptr;
  if (!tc_dicom_sources_get(&sources_, p.source, &blob_, &error)) {
    if (error) fail_with(error);
    fail(TC_ERROR_IO, "a file changed while it was read");
  }
  if (p.ends_at) add_end_mark(p.ends_at);
  uint64_t decoded = tc_dicom_frame_bytes(&p.samples) * stored_frames(p);
  cap_ = std::max<uint64_t>(justified_allocation(blob_.size, 1),
                            std::min<uint64_t>(decoded, 4096 * uint64_t{blob_.size}) + MiB);
  set_allocation_cap(cap_);
  if (p.run_lengths) open_run_lengths(p);
  if (p.native)
    open_native(p);
  else if (!p.run_lengths || p.palette)
    open_coded(p);
  open_ = &p;
}

// Appends the end mark of encapsulated pixels that the file lacks.
void Decoder::add_end_mark(size_t at) {
  static const uint8_t mark[8] = {0xfe, 0xff, 0xdd, 0xe0};
  if (at > blob_.size) fail(TC_ERROR_IO, "a file changed while it was read");
  auto *whole = static_cast<uint8_t *>(g_try_malloc(at + sizeof mark));
  if (!whole) fail(TC_ERROR_MEMORY, "no memory for a file of the series");
  memcpy(whole, blob_.bytes, at);
  memcpy(whole + at, mark, sizeof mark);
  tc_dicom_blob_finish(&blob_);
  blob_ = {whole, at + sizeof mark, nullptr, whole};
}

const gdcm::DataElement &Decoder::read_pixels(const Picture &p) {
  MemoryBuffer buffer(blob_.bytes, blob_.size);
  std::istream stream(&buffer);
  plain_reader_.reset(new gdcm::Reader);
  plain_reader_->SetStream(stream);
  if (!guarded([&] { return plain_reader_->Read(); })) fail(TC_ERROR_FORMAT, "a DICOM file is damaged or cut");
  const DataSet &set = plain_reader_->GetFile().GetDataSet();
  if (!set.FindDataElement(p.pixels)) fail(TC_ERROR_FORMAT, "a DICOM file has no pixel data");
  cut_ = buffer.cut;
  return set.GetDataElement(p.pixels);
}

void Decoder::open_native(const Picture &p) {
  const gdcm::ByteValue *value = read_pixels(p).GetByteValue();
  if (!value || !value->GetPointer()) fail(TC_ERROR_FORMAT, "a DICOM file has no pixel data");
  bool whole =
      p.deflated_at ? tc_dicom_deflate_is_whole(blob_.bytes + p.deflated_at, blob_.size - p.deflated_at) : !cut_;
  if (!whole) fail(TC_ERROR_FORMAT, "pixel data is cut: the file ends before it does");
  bytes_ = reinterpret_cast<const uint8_t *>(value->GetPointer());
  size_ = value->GetLength();
  if (p.swapped) swap_halves();
  if ((frame_bits(p.samples) * stored_frames(p) + 7) / 8 > size_)
    fail(TC_ERROR_FORMAT, "the header announces more pixels than there are");
}

uint32_t Decoder::stored_frames(const Picture &p) { return p.tiles_across ? 1 : p.frames; }

// Extracts one slice of a mosaic.
Frame Decoder::tile_of(const Frame &whole, uint32_t across, uint32_t number) {
  Frame f = whole;
  const size_t pixel = size_t(whole.samples.allocated) / 8, row = size_t(whole.samples.columns) * pixel;
  f.samples.columns /= static_cast<int>(across);
  f.samples.rows /= static_cast<int>(across);
  const size_t width = size_t(f.samples.columns) * pixel, height = size_t(f.samples.rows);
  if (whole.size < row * size_t(whole.samples.rows)) fail(TC_ERROR_FORMAT, "pixel data of a mosaic is cut");
  tile_.resize(width * height);
  const uint8_t *from = whole.bytes + number / across * height * row + number % across * width;
  for (size_t y = 0; y < height; y++) memcpy(tile_.data() + y * width, from + y * row, width);
  f.bytes = tile_.data();
  f.size = tile_.size();
  return f;
}

void Decoder::swap_halves() {
  whole_.assign(bytes_, bytes_ + size_);
  for (size_t i = 0; i + 4 <= size_; i += 4)
    std::swap_ranges(whole_.begin() + i, whole_.begin() + i + 2, whole_.begin() + i + 2);
  bytes_ = whole_.data();
}

uint64_t Decoder::frame_bits(const tc_dicom_samples &s) {
  return s.allocated == 1 ? uint64_t(s.rows) * s.columns : 8 * tc_dicom_frame_bytes(&s);
}

void Decoder::open_coded(const Picture &p) {
  MemoryBuffer buffer(blob_.bytes, blob_.size);
  std::istream stream(&buffer);
  // ImageReader requires geometry, and rejects single-frame files of classes that it expects to be multi-frame
  reader_.reset(p.palette ? new gdcm::ImageReader : new gdcm::PixmapReader);
  reader_->SetStream(stream);
  if (!guarded([&] { return reader_->Read(); }))
    fail(TC_ERROR_FORMAT, "a DICOM file is damaged, cut, or packed in a way not known");
  if (buffer.cut) fail(TC_ERROR_FORMAT, "pixel data is cut: the file ends before it does");
  if (stored_frames(p) > 1 && !p.palette) split_fragments(p);
}

// Decodes run lengths here: GDCM confuses those of deep colours, and indexes a table of 15 offsets by a number of the
// file when it opens a picture. Only palette colours are left to GDCM.
void Decoder::open_run_lengths(const Picture &p) {
  const gdcm::SequenceOfFragments *all = read_pixels(p).GetSequenceOfFragments();
  if (!all || all->GetNumberOfFragments() < stored_frames(p))
    fail(TC_ERROR_FORMAT, "the file holds fewer compressed frames than it announces");
  for (uint32_t f = 0; f < stored_frames(p); f++) {
    const gdcm::ByteValue *bytes = all->GetFragment(f).GetByteValue();
    const auto *head = bytes ? reinterpret_cast<const uint8_t *>(bytes->GetPointer()) : nullptr;
    if (!head || !tc_dicom_run_lengths_fit(&p.samples, head, bytes->GetLength()))
      fail(TC_ERROR_FORMAT, "the run lengths of frame %u are damaged", f + 1);
    runs_.push_back(bytes);
  }
}

Frame Decoder::run_length_frame(const Picture &p, uint32_t number) {
  const gdcm::ByteValue &bytes = *runs_[number];
  const uint64_t size = tc_dicom_frame_bytes(&p.samples);
  if (size > allocation_cap()) fail(TC_ERROR_FORMAT, "the header announces more pixels than the file can hold");
  whole_.resize(size);
  if (!tc_dicom_unpack(&p.samples, reinterpret_cast<const uint8_t *>(bytes.GetPointer()), bytes.GetLength(),
                       whole_.data()))
    fail(TC_ERROR_FORMAT, "the run lengths of frame %u are damaged", number + 1);
  Frame f{p.samples, whole_.data(), whole_.size(), 0};
  f.samples.planar = false;
  return f;
}

const gdcm::Bitmap &Decoder::picture() const {
  if (const auto *images = dynamic_cast<const gdcm::ImageReader *>(reader_.get())) return images->GetImage();
  return reader_->GetPixmap();
}

// Decodes compressed frames one at a time if the fragments can be assigned to frames: this saves memory, and of a
// time series only the chosen frames are decoded.
void Decoder::split_fragments(const Picture &p) {
  const gdcm::DataElement &element = picture().GetDataElement();
  const gdcm::SequenceOfFragments *all = element.GetSequenceOfFragments();
  if (!all) return;
  if (all->GetNumberOfFragments() < p.frames)
    fail(TC_ERROR_FORMAT, "the file holds fewer compressed frames than it announces");
  if (all->GetNumberOfFragments() != p.frames) return;
  for (uint32_t f = 0; f < p.frames; f++) {
    gdcm::SmartPointer<gdcm::SequenceOfFragments> one = gdcm::SequenceOfFragments::New();
    one->AddFragment(all->GetFragment(f));
    pieces_.push_back(one);
  }
}

Frame Decoder::native_frame(const Picture &p, uint32_t number) {
  uint64_t bits = frame_bits(p.samples) * number;
  if (bits / 8 > size_) fail(TC_ERROR_FORMAT, "pixel data ends before frame %u", number + 1);
  return Frame{p.samples, bytes_ + bits / 8, size_ - bits / 8, static_cast<unsigned>(bits % 8)};
}

// The format after decoding, which may differ from the header (a JPEG has its own bit depth).
tc_dicom_samples Decoder::decoded_samples(const gdcm::Bitmap &image, const Picture &p) {
  const gdcm::PixelFormat &format = image.GetPixelFormat();
  tc_dicom_samples s = p.samples;
  s.allocated = format.GetBitsAllocated() == 12 ? 16 : format.GetBitsAllocated();
  s.stored = format.GetBitsStored();
  s.high = format.GetHighBit();
  s.is_signed = format.GetPixelRepresentation() == 1;
  s.per_pixel = format.GetSamplesPerPixel();
  s.planar = image.GetPlanarConfiguration() == 1;
  s.columns = static_cast<int>(image.GetDimension(0));
  s.rows = static_cast<int>(image.GetDimension(1));
  std::string photometric = image.GetPhotometricInterpretation().GetString();
  s.colour = s.per_pixel < 3 ? TC_DICOM_GREY : colour_of(photometric);
  if (!tc_dicom_samples_valid(&s) || s.rows != p.samples.rows || s.columns != p.samples.columns)
    fail(TC_ERROR_FORMAT, "decoded pixels contradict the header");
  return s;
}

void Decoder::decode_into(const gdcm::Bitmap &image) {
  size_t length = image.GetBufferLength();
  if (length > allocation_cap()) fail(TC_ERROR_FORMAT, "the header announces more pixels than the file can hold");
  whole_.resize(length);
  char *out = reinterpret_cast<char *>(whole_.data());
  if (length == 0 || !guarded([&] { return image.GetBuffer(out); }))
    fail(TC_ERROR_FORMAT, "pixel data cannot be decoded; the file is damaged or its compression is not known");
}

Frame Decoder::coded_frame(const Picture &p, uint32_t number) {
  const gdcm::Bitmap &image = picture();
  if (!pieces_.empty()) {
    gdcm::Image one = single_frame(image, number);
    decode_into(one);
    samples_ = decoded_samples(one, p);
    number = 0;
  } else if (whole_.empty() && p.palette) {
    gdcm::ImageApplyLookupTable colours;
    colours.SetInput(static_cast<const gdcm::Image &>(image));
    if (!guarded([&] { return colours.Apply(); })) fail(TC_ERROR_UNSUPPORTED, "this palette is not read");
    decode_into(colours.GetOutput());
    samples_ = decoded_samples(colours.GetOutput(), p);
  } else if (whole_.empty()) {
    decode_into(image);
    samples_ = decoded_samples(image, p);
  }
  uint64_t bits = frame_bits(samples_) * number;
  if (bits / 8 > whole_.size()) fail(TC_ERROR_FORMAT, "pixel data ends before frame %u", number + 1);
  return Frame{samples_, whole_.data() + bits / 8, whole_.size() - bits / 8, static_cast<unsigned>(bits % 8)};
}

gdcm::Image Decoder::single_frame(const gdcm::Bitmap &image, uint32_t number) const {
  gdcm::Image one;
  one.SetNumberOfDimensions(2);
  one.SetDimension(0, image.GetDimension(0));
  one.SetDimension(1, image.GetDimension(1));
  one.SetTransferSyntax(image.GetTransferSyntax());
  one.SetPixelFormat(image.GetPixelFormat());
  one.SetPlanarConfiguration(image.GetPlanarConfiguration());
  one.SetPhotometricInterpretation(image.GetPhotometricInterpretation());
  gdcm::DataElement element(Tag(0x7fe0, 0x0010));
  element.SetVR(gdcm::VR::OB);
  element.SetValue(*pieces_[number]);
  one.SetDataElement(element);
  return one;
}

} // namespace dicom
