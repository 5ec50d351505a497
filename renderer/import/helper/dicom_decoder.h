// Pixels: decodes frames with GDCM, one file at a time.
#ifndef TC_DICOM_DECODER_H
#define TC_DICOM_DECODER_H

#include <memory>

#include <gdcmImageReader.h>
#include <gdcmSequenceOfFragments.h>

#include "renderer/import/helper/dicom_picture.h"

namespace dicom {

using Frame = tc_dicom_frame;

// The last file stays open, so the frames of a multi-frame file cost one read. For one thread.
class Decoder {
public:
  explicit Decoder(const tc_dicom_sources &sources) : sources_(sources) {}
  ~Decoder() { close(); }
  Frame frame(const Picture &p, uint32_t number); // valid until the next call

private:
  void close();
  void open(const Picture &p);
  void add_end_mark(size_t at);
  void open_native(const Picture &p);
  static uint32_t stored_frames(const Picture &p);
  Frame tile_of(const Frame &whole, uint32_t across, uint32_t number);
  Frame looked_up(const Frame &stored, const Picture &p);
  void swap_halves();
  static uint64_t frame_bits(const tc_dicom_samples &s);
  void open_coded(const Picture &p);
  void open_run_lengths(const Picture &p);
  Frame run_length_frame(const Picture &p, uint32_t number);
  const gdcm::DataElement &read_pixels(const Picture &p);
  const gdcm::Bitmap &picture() const;
  void split_fragments(const Picture &p);
  Frame native_frame(const Picture &p, uint32_t number);
  static tc_dicom_samples decoded_samples(const gdcm::Bitmap &image, const Picture &p);
  void decode_into(const gdcm::Bitmap &image);
  Frame coded_frame(const Picture &p, uint32_t number);
  gdcm::Image single_frame(const gdcm::Bitmap &image, uint32_t number) const;

  const tc_dicom_sources &sources_;
  const Picture *open_ = nullptr;
  tc_dicom_blob blob_{};
  size_t cap_ = SIZE_MAX; // limit on single allocations while this file is open
  std::unique_ptr<gdcm::PixmapReader> reader_;
  std::unique_ptr<gdcm::Reader> plain_reader_;
  const uint8_t *bytes_ = nullptr;
  size_t size_ = 0;
  bool cut_ = false; // the file ends before its last element
  std::vector<const gdcm::ByteValue *> runs_; // [frames], from gdcm::Reader
  std::vector<gdcm::SmartPointer<gdcm::SequenceOfFragments>> pieces_;
  std::vector<uint8_t> whole_, tile_;
  std::vector<uint16_t> values_;
  tc_dicom_samples samples_{};
};

} // namespace dicom
#endif
