#include "renderer/import/helper/dicom_picture.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <map>
#include <set>

#include <gdcmReader.h>

#include "renderer/import/helper/dicom_suv.h"

namespace dicom {

// JPEG 2000 decoders convert their Y Cb Cr to RGB.
tc_dicom_colour colour_of(const std::string &photometric) {
  if (photometric.compare(0, 11, "YBR_PARTIAL") == 0)
    fail(TC_ERROR_UNSUPPORTED, "colours of partial range (YBR_PARTIAL) are not read; export the pictures as RGB");
  return photometric.compare(0, 8, "YBR_FULL") == 0 ? TC_DICOM_YBR : TC_DICOM_RGB;
}

static void read_samples(const DataSet &set, Picture &p) {
  tc_dicom_samples &s = p.samples;
  s.rows = binary_of<uint16_t>(set, Tag(0x28, 0x10), 0);
  s.columns = binary_of<uint16_t>(set, Tag(0x28, 0x11), 0);
  s.allocated = binary_of<uint16_t>(set, Tag(0x28, 0x100), 0);
  s.stored = binary_of<uint16_t>(set, Tag(0x28, 0x101), static_cast<uint16_t>(s.allocated));
  s.high = binary_of<uint16_t>(set, Tag(0x28, 0x102), static_cast<uint16_t>(s.stored - 1));
  s.is_signed = binary_of<uint16_t>(set, Tag(0x28, 0x103), 0) == 1;
  s.per_pixel = binary_of<uint16_t>(set, Tag(0x28, 0x02), 1);
  s.planar = binary_of<uint16_t>(set, Tag(0x28, 0x06), 0) == 1;
  std::string photometric = text_of(set, Tag(0x28, 0x04));
  p.palette = photometric == "PALETTE COLOR";
  p.inverted = photometric == "MONOCHROME1";
  if (s.per_pixel >= 3) s.colour = colour_of(photometric);
}

// NumberOfFrames, limited by the file's bytes, so that no list is made for frames that cannot exist.
static void read_frames(const DataSet &set, const gdcm::TransferSyntax &syntax, size_t bytes, Picture &p) {
  std::string text = text_of(set, Tag(0x28, 0x08));
  char *end = nullptr;
  long long frames = text.empty() ? 1 : strtoll(text.c_str(), &end, 10);
  if (end && *end && *end != '\\') fail(TC_ERROR_FORMAT, "NumberOfFrames is not a number");
  if (frames < 1) frames = 1; // some writers put 0 into single pictures
  uint64_t room = syntax == gdcm::TransferSyntax::DeflatedExplicitVRLittleEndian ? uint64_t{bytes} * 1032 : bytes;
  uint64_t least = syntax.IsEncapsulated() ? 8 : std::max<uint64_t>(tc_dicom_frame_bytes(&p.samples), 1);
  if (p.samples.allocated == 1) least = std::max<uint64_t>(least - 1, 1);
  if (p.samples.allocated == 12) least = 1; // packed by ancient writers; GDCM unpacks
  if (static_cast<uint64_t>(frames) > room / least)
    fail(TC_ERROR_FORMAT, "the header announces more pixels than the file holds; it is cut or damaged");
  if (static_cast<uint64_t>(frames) > FRAMES_MAX)
    fail(TC_ERROR_LIMIT, "more than %llu frames", (unsigned long long)FRAMES_MAX);
  p.frames = static_cast<uint32_t>(frames);
}

// Weight and dose stay in this function: only their quotient leaves it.
static void read_suv(const DataSet &set, Picture &p) {
  Nested drug = item_of(set, Tag(0x54, 0x16));
  if (p.modality != "PT") return;
  std::map<uint32_t, std::string> text;
  auto get = [&](const DataSet *from, Tag tag) {
    return (text[tag.GetElementTag()] = from ? text_of(*from, tag) : "").c_str();
  };
  tc_dicom_suv suv{};
  suv.units = get(&set, Tag(0x54, 0x1001));
  suv.corrected = get(&set, Tag(0x28, 0x51));
  suv.decay = get(&set, Tag(0x54, 0x1102));
  suv.series_date = get(&set, Tag(0x08, 0x21));
  suv.series_time = get(&set, Tag(0x08, 0x31));
  suv.acquisition_date = get(&set, Tag(0x08, 0x22));
  suv.acquisition_time = get(&set, Tag(0x08, 0x32));
  suv.scan = get(text_of(set, Tag(0x09, 0x10)) == "GEMS_PETD_01" ? &set : nullptr, Tag(0x09, 0x100d));
  suv.start = get(drug.set, Tag(0x18, 0x1078));
  suv.start_time = get(drug.set, Tag(0x18, 0x1072));
  suv.weight_kg = number_of(set, Tag(0x10, 0x1030), 0);
  suv.dose_bq = drug.set ? number_of(*drug.set, Tag(0x18, 0x1074), 0) : 0;
  suv.half_life_s = drug.set ? number_of(*drug.set, Tag(0x18, 0x1075), 0) : 0;
  if (text_of(set, Tag(0x7053, 0x10)) == "Philips PET Private Group")
    suv.philips = number_of(set, Tag(0x7053, 0x1000), 0);
  p.suv = tc_dicom_suv_factor(&suv, &p.no_suv);
}

// "142233.5" -> "14:22:33".
static std::string clock_of(const std::string &text) {
  if (text.size() < 4 || text.substr(0, 4).find_first_not_of("0123456789") != std::string::npos) return "";
  const bool seconds = text.size() >= 6 && text.substr(4, 2).find_first_not_of("0123456789") == std::string::npos;
  return text.substr(0, 2) + ":" + text.substr(2, 2) + (seconds ? ":" + text.substr(4, 2) : "");
}

// "20260131" -> "2026-01-31".
static std::string day_of(const std::string &text) {
  if (text.size() != 8 || text.find_first_not_of("0123456789") != std::string::npos) return "";
  return text.substr(0, 4) + "-" + text.substr(4, 2) + "-" + text.substr(6);
}

// Reads description and time of the series. Patient and date leave the helper only on request.
static void read_description(const DataSet &set, Picture &p, bool patient) {
  p.description = words_of(set, set, Tag(0x08, 0x103e));
  for (uint16_t element : {0x31, 0x32, 0x33, 0x30}) // of series, acquisition, content, study
    if (p.time.empty()) p.time = clock_of(text_of(set, Tag(0x08, element)));
  if (!patient) return;
  for (uint16_t element : {0x21, 0x22, 0x23, 0x20})
    if (p.day.empty()) p.day = day_of(text_of(set, Tag(0x08, element)));
  p.patient = words_of(set, set, Tag(0x10, 0x10));
  const std::string number = words_of(set, set, Tag(0x10, 0x20));
  if (!number.empty()) p.patient += (p.patient.empty() ? "" : " ") + ("(" + number + ")");
}

// Reads a modality look-up table, which replaces slope and intercept: PS3.3, C.11.1.
static void read_lookup(const DataSet &set, Picture &p) {
  Nested lookup = item_of(set, Tag(0x28, 0x3000));
  if (!lookup.set || p.samples.per_pixel != 1) return;
  const uint32_t shape = binary_of<uint32_t>(*lookup.set, Tag(0x28, 0x3002), 0);
  const size_t count = (shape & 0xffff) ? shape & 0xffff : 65536;
  const gdcm::ByteValue *data = lookup.set->FindDataElement(Tag(0x28, 0x3006))
                                    ? lookup.set->GetDataElement(Tag(0x28, 0x3006)).GetByteValue()
                                    : nullptr;
  if (!data || !data->GetPointer() || data->GetLength() < count)
    fail(TC_ERROR_FORMAT, "the modality lookup table is cut");
  const auto *bytes = reinterpret_cast<const uint8_t *>(data->GetPointer());
  const bool wide = data->GetLength() >= 2 * count;
  p.lookup.resize(count);
  for (size_t i = 0; i < count; i++)
    p.lookup[i] = static_cast<uint16_t>(wide ? bytes[2 * i] | bytes[2 * i + 1] << 8 : bytes[i]);
  p.lookup_first = p.samples.is_signed ? static_cast<int16_t>(shape >> 16) : static_cast<int32_t>(shape >> 16);
  p.scale_type = plain(text_of(*lookup.set, Tag(0x28, 0x3004)), 15);
}

static void read_labels(const DataSet &set, Picture &p) {
  p.modality = plain(text_of(set, Tag(0x08, 0x60)), 15);
  p.series = plain(text_of(set, Tag(0x20, 0x0e)), 64);
  p.series_number = static_cast<int>(integer_of(set, Tag(0x20, 0x11), 0));
  p.unit = plain(text_of(set, Tag(0x54, 0x1001)), 15);
  p.mosaic = text_of(set, Tag(0x08, 0x08)).find("MOSAIC") != std::string::npos;
}

// Tag of the pixel element. The header pass stops before it, so the sample size decides among the three tags.
static Tag pixel_tag(const DataSet &set, const Picture &p) {
  bool has_stored = set.FindDataElement(Tag(0x28, 0x101));
  if (p.samples.allocated == 64 && !has_stored) return Tag(0x7fe0, 0x0009);
  if (p.samples.allocated == 32 && !has_stored) return Tag(0x7fe0, 0x0008);
  return Tag(0x7fe0, 0x0010);
}

[[noreturn]] static void fail_header(const gdcm::FileMetaInformation &header) {
  std::string syntax = plain(text_of(header, Tag(0x0002, 0x0010)), 64);
  bool standard =
      syntax.compare(0, 14, "1.2.840.10008.") == 0 && syntax.find_first_not_of("0123456789.") == std::string::npos;
  if (!syntax.empty() && gdcm::TransferSyntax::GetTSType(syntax.c_str()) == gdcm::TransferSyntax::TS_END)
    fail(TC_ERROR_UNSUPPORTED, "transfer syntax %s is not read", standard ? syntax.c_str() : "of its own kind");
  fail(TC_ERROR_FORMAT, "the DICOM header is damaged or cut");
}

// Whether the fragments of encapsulated pixels end with the delimiter or, without one, consist of an offset table and
// one fragment for each frame. GDCM accepts a file that ends between two fragments, and repeats the last for missing
// ones.
static bool items_are_there(const uint8_t *bytes, size_t at, size_t size, Picture &p) {
  size_t count = 0;
  while (size - at >= 8) {
    uint32_t head[2];
    memcpy(head, bytes + at, sizeof head);
    if (head[0] == 0xe0ddfffe) return true;
    at += 8;
    if (head[0] != 0xe000fffe || head[1] > size - at) return false;
    at += head[1];
    count++;
  }
  p.ends_at = at;
  return count == size_t{1} + p.frames;
}

// Whether all pixels from `at` on are in the file: a truncated file of a series is then skipped like an unreadable
// one, not discovered half-way.
static bool pixels_are_there(Picture &p, bool packed, std::streamoff at, const tc_dicom_blob &blob) {
  const size_t size = blob.size;
  if (packed) return at < 0 || items_are_there(blob.bytes, std::min<uint64_t>(at, size), size, p);
  const tc_dicom_samples &s = p.samples;
  uint64_t bytes =
      s.allocated == 1 ? (uint64_t(s.rows) * s.columns * p.frames + 7) / 8 : tc_dicom_frame_bytes(&s) * p.frames;
  return !p.native || p.deflated_at || at < 0 || bytes <= size - std::min<uint64_t>(at, size);
}

bool read_picture(const tc_dicom_blob &blob, size_t source, bool patient, Picture &p) {
  MemoryBuffer buffer(blob.bytes, blob.size);
  std::istream stream(&buffer);
  gdcm::Reader reader;
  std::set<Tag> skip = {Tag(0x7fe0, 0x0008), Tag(0x7fe0, 0x0009), Tag(0x7fe0, 0x0010)};
  reader.SetStream(stream);
  set_allocation_cap(justified_allocation(
      blob.size, 64)); // deflated headers shrink well; the process limit stops larger ones
  bool ok = guarded([&] { return reader.ReadUpToTag(Tag(0x7fe0, 0x0010), skip); });
  if (!ok) fail_header(reader.GetFile().GetHeader());
  const DataSet &set = reader.GetFile().GetDataSet();
  const gdcm::TransferSyntax &syntax = reader.GetFile().GetHeader().GetDataSetTransferSyntax();
  p.source = source;
  read_labels(set, p);
  read_description(set, p, patient);
  if (p.modality == "RTSTRUCT") return read_contours(set, p), true;
  read_samples(set, p);
  if (p.modality == "SEG") p.palette = false; // samples of a segmentation are labels
  if (p.samples.rows == 0 || p.samples.columns == 0 || p.samples.allocated == 0) return false;
  read_lookup(set, p);
  p.pixels = pixel_tag(set, p);
  p.samples.is_float = p.pixels != Tag(0x7fe0, 0x0010);
  p.swapped = syntax == gdcm::TransferSyntax::ExplicitVRBigEndian && p.samples.allocated == 32 && !p.samples.is_float;
  p.native = (syntax == gdcm::TransferSyntax::ImplicitVRLittleEndian ||
              syntax == gdcm::TransferSyntax::ExplicitVRLittleEndian ||
              syntax == gdcm::TransferSyntax::DeflatedExplicitVRLittleEndian || p.swapped) &&
             p.samples.allocated != 12 && !p.palette;
  p.samples.halved = p.native && text_of(set, Tag(0x28, 0x04)) == "YBR_FULL_422";
  p.run_lengths = syntax == gdcm::TransferSyntax::RLELossless;
  if (p.samples.allocated != 12 && !tc_dicom_samples_valid(&p.samples) && !p.palette)
    fail(TC_ERROR_UNSUPPORTED, "samples of %d bits allocated, %d stored, %d a pixel are not read", p.samples.allocated,
         p.samples.stored, p.samples.per_pixel);
  if (p.samples.is_float && !p.native)
    fail(TC_ERROR_UNSUPPORTED, "float pixels in a packed or big-endian file are not read");
  if (syntax == gdcm::TransferSyntax::DeflatedExplicitVRLittleEndian) {
    uint64_t at = uint64_t{144} + binary_of<uint32_t>(reader.GetFile().GetHeader(), Tag(0x0002, 0x0000), 0);
    if (at >= blob.size) fail(TC_ERROR_FORMAT, "the DICOM header is damaged or cut");
    p.deflated_at = at; // preamble and mark, the 12 bytes of the group length, the group
  }
  if (binary_of<uint32_t>(set, Tag(0x48, 0x06), 0) > static_cast<uint32_t>(p.samples.columns))
    fail(TC_ERROR_UNSUPPORTED, "tiles of a whole-slide picture are no volume");
  read_frames(set, syntax, blob.size, p);
  if (!pixels_are_there(p, syntax.IsEncapsulated(), stream.tellg(), blob))
    fail(TC_ERROR_FORMAT, "pixel data is cut: the file ends before it does");
  read_slices(set, p);
  read_suv(set, p);
  return true;
}

} // namespace dicom
