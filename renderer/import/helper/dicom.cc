// Reads DICOM with GDCM.
//
// The one C++ file: GDCM speaks C++. Files that come in are hostile, and so is, in the worst case, this process: the
// daemon checks every byte of the answer (wire.h). Two passes: headers of all files give the list of series and
// the geometry of the chosen one (dicom_stack.h); then the pictures are decoded in order, one at a time. Tags that
// identify a patient are never asked for; messages hold counts and names of attributes, no values.
#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <new>
#include <set>
#include <streambuf>
#include <string>
#include <system_error>
#include <thread>
#include <tuple>
#include <vector>

#include <gdcmImageApplyLookupTable.h>
#include <gdcmImageReader.h>
#include <gdcmReader.h>
#include <gdcmSequenceOfFragments.h>
#include <gdcmSequenceOfItems.h>
#include <gdcmTrace.h>

#include <glib.h>
extern "C" {
#include "renderer/base/error.h"
#include "renderer/import/reader.h"
}
#include "renderer/import/helper/dicom_group.h"
#include "renderer/import/helper/dicom_sources.h"
#include "renderer/import/helper/dicom_pixels.h"
#include "renderer/import/helper/dicom_stack.h"
#include "renderer/import/helper/dicom_contours.h"
#include "renderer/import/helper/dicom_suv.h"
#include "renderer/import/helper/order.h"
#include "renderer/import/helper/stack.h"

// GDCM allocates what an element's length announces before it reads a byte of it. One allocation may therefore not be
// larger than the bytes at hand can justify; the cap is set for each file. Codecs in C use malloc and the process
// limit.
static thread_local size_t allocation_cap = SIZE_MAX;

[[gnu::noinline]] void *operator new(size_t size) {
  void *memory = size > allocation_cap ? nullptr : malloc(size ? size : 1);
  if (!memory) throw std::bad_alloc();
  return memory;
}
[[gnu::noinline]] void *operator new(size_t size, const std::nothrow_t &) noexcept { return malloc(size ? size : 1); }
[[gnu::noinline]] void operator delete(void *memory) noexcept { free(memory); }
[[gnu::noinline]] void operator delete(void *memory, size_t) noexcept { free(memory); }

#if defined(__SANITIZE_ADDRESS__)
extern "C" const char *__asan_default_options() { return "detect_leaks=0:allocator_may_return_null=1"; }
#endif

// Debian builds GDCM with its assertions on, and damaged files trip them. One bad file of a folder must not end the
// run, so an assertion jumps out of GDCM (an exception cannot pass: its callers are compiled as if the call never
// returned). What GDCM held is leaked, within the process limits.
static thread_local jmp_buf assertion_exit;
static thread_local bool assertion_armed = false;

extern "C" void __assert_fail(const char *, const char *, unsigned, const char *) noexcept {
  if (assertion_armed) longjmp(assertion_exit, 1);
  _exit(1);
}

namespace {

constexpr size_t MiB = 1024 * 1024;
constexpr uint64_t FRAMES_MAX = 200000; // pictures of one run

struct Failure {
  tc_error_code code;
  char text[256];
};

[[noreturn]] void fail(tc_error_code code, const char *format, ...) __attribute__((format(printf, 2, 3)));
[[noreturn]] void fail(tc_error_code code, const char *format, ...) {
  Failure f{code, ""};
  va_list args;
  va_start(args, format);
  vsnprintf(f.text, sizeof f.text, format, args);
  va_end(args);
  throw f;
}

[[noreturn]] void fail_with(GError *error) {
  Failure f{static_cast<tc_error_code>(error->code), ""};
  snprintf(f.text, sizeof f.text, "%s", error->message);
  g_error_free(error);
  throw f;
}

struct Disarm {
  ~Disarm() { assertion_armed = false; }
};

// Runs a piece of GDCM; false when it says so itself or an assertion of its fails. Assertions are armed in here only.
template <typename Call> bool guarded(Call call) {
  Disarm disarm;
  if (setjmp(assertion_exit) != 0) return false;
  assertion_armed = true;
  return call();
}

// A stream over bytes in memory, with seeking, as GDCM wants it. It remembers whether a read was cut by the end: GDCM
// takes what there is and says nothing.
struct MemoryBuffer : std::streambuf {
  bool cut = false;
  std::streamsize xsgetn(char *out, std::streamsize wanted) override {
    std::streamsize n = std::min<std::streamsize>(wanted, egptr() - gptr());
    if (n > 0) memcpy(out, gptr(), static_cast<size_t>(n));
    setg(eback(), gptr() + n, egptr());
    if (n < wanted && wanted >= 16) cut = true; // shorter ones are a look for one more element
    return n;
  }
  MemoryBuffer(const uint8_t *bytes, size_t size) {
    char *start = reinterpret_cast<char *>(const_cast<uint8_t *>(bytes)); // read only: no put area is set
    setg(start, start, start + size);
  }
  pos_type seekoff(off_type off, std::ios_base::seekdir dir, std::ios_base::openmode) override {
    off_type from = dir == std::ios_base::beg ? 0 : dir == std::ios_base::cur ? gptr() - eback() : egptr() - eback();
    off_type to;
    if (__builtin_add_overflow(from, off, &to) || to < 0 || to > egptr() - eback()) return pos_type(off_type(-1));
    setg(eback(), eback() + to, egptr());
    return pos_type(to);
  }
  pos_type seekpos(pos_type pos, std::ios_base::openmode mode) override {
    return seekoff(off_type(pos), std::ios_base::beg, mode);
  }
};

// ---- values of a data set ----

using gdcm::DataSet;
using gdcm::Tag;
using Items = gdcm::SmartPointer<gdcm::SequenceOfItems>;

std::string text_of(const DataSet &set, Tag tag) {
  if (!set.FindDataElement(tag)) return "";
  const gdcm::ByteValue *value = set.GetDataElement(tag).GetByteValue();
  if (!value || !value->GetPointer()) return "";
  size_t size = std::min<size_t>(value->GetLength(), 1 * MiB);
  std::string text(value->GetPointer(), size);
  text.resize(strnlen(text.c_str(), size));
  size_t end = text.find_last_not_of(" \r\n\t"), start = text.find_first_not_of(" \r\n\t");
  return end == std::string::npos ? "" : text.substr(start, end - start + 1);
}

// Numbers written as text ("1.5\-2\3"). Stops at the first thing that is none.
std::vector<double> numbers_of(const DataSet &set, Tag tag) {
  std::vector<double> out;
  std::string text = text_of(set, tag);
  for (const char *at = text.c_str(); *at;) {
    char *end;
    double value = g_ascii_strtod(at, &end);
    if (end == at || !std::isfinite(value)) break;
    out.push_back(value);
    while (*end == ' ')
      end++;
    if (*end != '\\') break;
    at = end + 1;
  }
  return out;
}

double number_of(const DataSet &set, Tag tag, double otherwise) {
  std::vector<double> n = numbers_of(set, tag);
  return n.empty() ? otherwise : n[0];
}

long integer_of(const DataSet &set, Tag tag, long otherwise) {
  double value = number_of(set, tag, otherwise);
  return std::fabs(value) < 2e9 ? static_cast<long>(value) : otherwise;
}

// Binary values; GDCM has brought them to this machine's byte order.
template <typename T> T binary_of(const DataSet &set, Tag tag, T otherwise) {
  if (!set.FindDataElement(tag)) return otherwise;
  const gdcm::ByteValue *value = set.GetDataElement(tag).GetByteValue();
  if (!value || !value->GetPointer() || value->GetLength() < sizeof(T)) return otherwise;
  memcpy(&otherwise, value->GetPointer(), sizeof(T));
  return otherwise;
}

Items items_of(const DataSet &set, Tag tag) {
  if (!set.FindDataElement(tag)) return nullptr;
  return set.GetDataElement(tag).GetValueAsSQ();
}

// The data set of one item; the sequence is kept alive beside it.
struct Nested {
  Items keep;
  const DataSet *set = nullptr;
};

Nested item_of(const DataSet &set, Tag tag, size_t number = 1) {
  Nested nested;
  nested.keep = items_of(set, tag);
  if (nested.keep && nested.keep->GetNumberOfItems() >= number)
    nested.set = &nested.keep->GetItem(number).GetNestedDataSet();
  return nested;
}

// ---- one file's header ----

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
  bool native = false;    // bytes as they are, no codec
  bool run_lengths = false;
  bool swapped = false;   // big-endian 32-bit samples, whose halves GDCM leaves in the file's order
  size_t deflated_at = 0; // a deflated data set begins here; 0 otherwise
  uint32_t tiles_across = 0; // a mosaic: its slices lie side by side in one picture, row by row; 0: none
  bool palette = false, inverted = false, cine = false, mosaic = false, lookup = false, fractional = false;
  double window_center = 0, window_width = 0;
  double suv = 0;            // PET: what values are multiplied by; 0 none
  const char *no_suv = ""; // why
  double segment_threshold = 1;       // samples at or above it belong to the segment
  bool label_map = false;             // samples are labels themselves
  uint32_t background = 0;            // of a label map
  std::vector<tc_segment> segments;   // what labels are
  std::vector<tc_dicom_contour> contours; // of a set of structures, which has no frames: their points are `corners`
  std::vector<double> corners;
  size_t open_contours = 0;           // that enclose nothing and are left out
  std::string drawn_on;               // the series that they were drawn on
  std::vector<tc_dicom_slice> slices; // [frames]
  std::vector<Scale> scales;          // [frames]
};

std::string plain(const std::string &text, size_t most) {
  std::string out;
  for (char c : text)
    if (c > 0x20 && c < 0x7f && out.size() < most) out += c;
  return out;
}

// Words that people wrote, as UTF-8: what is neither that nor Latin 1, where the file says so, becomes question marks.
std::string words_of(const DataSet &root, const DataSet &set, Tag tag) {
  const std::string text = text_of(set, tag), charset = text_of(root, Tag(0x08, 0x05));
  if (g_utf8_validate(text.data(), static_cast<gssize>(text.size()), nullptr)) return text;
  const bool latin = charset == "ISO_IR 100" || charset == "ISO 2022 IR 100";
  std::string out;
  for (char c : text) {
    const uint8_t byte = static_cast<uint8_t>(c);
    if (byte < 0x80)
      out += c;
    else if (latin && byte >= 0xa0)
      out += {static_cast<char>(0xc0 | byte >> 6), static_cast<char>(0x80 | (byte & 0x3f))};
    else
      out += '?';
  }
  return out;
}

// Cut to fit between two characters.
template <size_t N> void put_words(char (&out)[N], const std::string &text) {
  size_t at = 0;
  for (const char *c = text.c_str(); *c; c = g_utf8_next_char(c)) {
    const size_t bytes = static_cast<size_t>(g_utf8_next_char(c) - c);
    if (at + bytes >= N) break;
    memcpy(out + at, c, bytes);
    at += bytes;
  }
  out[at] = 0;
}

// Y Cb Cr that JPEG 2000 made of RGB comes out of its decoder as RGB.
tc_dicom_colour colour_of(const std::string &photometric) {
  if (photometric.compare(0, 11, "YBR_PARTIAL") == 0)
    fail(TC_ERROR_UNSUPPORTED, "colours of partial range (YBR_PARTIAL) are not read; export the pictures as RGB");
  return photometric.compare(0, 8, "YBR_FULL") == 0 ? TC_DICOM_YBR : TC_DICOM_RGB;
}

void read_samples(const DataSet &set, Picture &p) {
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

// NumberOfFrames, checked against what the bytes can hold, so that no list is made for frames that cannot be there.
void read_frames(const DataSet &set, const gdcm::TransferSyntax &syntax, size_t bytes, Picture &p) {
  std::string text = text_of(set, Tag(0x28, 0x08));
  char *end = nullptr;
  long long frames = text.empty() ? 1 : strtoll(text.c_str(), &end, 10);
  if (end && *end && *end != '\\') fail(TC_ERROR_FORMAT, "NumberOfFrames is not a number");
  if (frames < 1) frames = 1; // written by some for a single picture
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

bool read_vector(const DataSet &set, Tag tag, double *out, size_t count) {
  std::vector<double> n = numbers_of(set, tag);
  if (n.size() < count) return false;
  std::copy(n.begin(), n.begin() + count, out);
  return true;
}

// A usable orientation has two unit vectors at right angles; rounding is taken out, anything worse is as none.
bool read_orientation(const DataSet &set, double *o) {
  double v[6];
  if (!read_vector(set, Tag(0x20, 0x37), v, 6)) return false;
  double row = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  if (!(std::fabs(row - 1) < 0.05)) return false;
  double dot = 0, column = 0;
  for (int i = 0; i < 3; i++)
    v[i] /= row;
  for (int i = 0; i < 3; i++)
    dot += v[i] * v[3 + i];
  if (!(std::fabs(dot) < 0.05)) return false;
  for (int i = 0; i < 3; i++)
    v[3 + i] -= dot * v[i];
  for (int i = 3; i < 6; i++)
    column += v[i] * v[i];
  column = std::sqrt(column);
  if (!(std::fabs(column - 1) < 0.05)) return false;
  for (int i = 3; i < 6; i++)
    v[i] /= column;
  std::copy(v, v + 6, o);
  return true;
}

bool read_spacing(const DataSet &set, Tag tag, double *spacing) {
  double v[2];
  if (!read_vector(set, tag, v, 2) || !(v[0] > 1e-6 && v[0] < 1e6 && v[1] > 1e-6 && v[1] < 1e6)) return false;
  spacing[0] = v[1]; // the file gives the distance between rows (y) first
  spacing[1] = v[0];
  return true;
}

void read_geometry(const DataSet &set, tc_dicom_slice &s) {
  if (read_vector(set, Tag(0x20, 0x32), s.position, 3)) s.has_position = true;
  if (read_orientation(set, s.orientation)) s.has_orientation = true;
  if (read_spacing(set, Tag(0x28, 0x30), s.spacing)) s.has_spacing = true;
  double between = number_of(set, Tag(0x18, 0x88), 0), thickness = number_of(set, Tag(0x18, 0x50), 0);
  if (std::fabs(between) > 1e-6 && std::fabs(between) < 1e6) s.between = between;
  if (thickness > 1e-6 && thickness < 1e6) s.thickness = thickness;
}

void read_scale(const DataSet &set, Picture &p, Scale &scale) {
  scale.slope = number_of(set, Tag(0x28, 0x1053), scale.slope);
  scale.intercept = number_of(set, Tag(0x28, 0x1052), scale.intercept);
  if (set.FindDataElement(Tag(0x28, 0x1054))) p.scale_type = plain(text_of(set, Tag(0x28, 0x1054)), 15);
  if (!std::isfinite(scale.slope) || scale.slope == 0 || std::fabs(scale.slope) > 1e30) scale.slope = 1;
  if (!std::isfinite(scale.intercept) || std::fabs(scale.intercept) > 1e30) scale.intercept = 0;
}

void read_window(const DataSet &set, Picture &p) {
  double center = number_of(set, Tag(0x28, 0x1050), 0), width = number_of(set, Tag(0x28, 0x1051), 0);
  if (p.window_width > 0 || !(width > 0 && width < 1e30) || std::fabs(center) > 1e30) return;
  p.window_center = center;
  p.window_width = width;
}

// A checksum of a text, 0 for none.
uint64_t checksum(const std::string &text) {
  uint64_t sum = 14695981039346656037u;
  for (char c : text)
    sum = (sum ^ static_cast<uint8_t>(c)) * 1099511628211u;
  return text.empty() ? 0 : sum;
}

// Keys that are texts are numbered as they come, and put in the texts' order when all are known.
std::map<std::string, double> key_texts;

double text_key(const std::string &text, double otherwise) {
  return text.empty() ? otherwise : key_texts.emplace(text, double(key_texts.size() + 1)).first->second;
}

void order_text_keys(std::vector<tc_dicom_slice> &slices) {
  std::vector<double> rank(key_texts.size() + 1, 0);
  double next = 0;
  for (const auto &entry : key_texts)
    rank[size_t(entry.second)] = ++next;
  for (tc_dicom_slice &s : slices)
    for (int key : {TC_DICOM_KEY_STACK, TC_DICOM_KEY_IMAGE_TYPE})
      s.keys[key] = rank[size_t(s.keys[key])];
}

double float_key(const DataSet &set, Tag tag, double otherwise) {
  double value = binary_of<double>(set, tag, otherwise);
  return std::isfinite(value) ? value : otherwise;
}

// The b-value, where the standard or one of three makers keeps it.
double read_b_value(const DataSet &set, double otherwise) {
  double value = float_key(set, Tag(0x18, 0x9087), -1);
  if (value >= 0) return value;
  if (text_of(set, Tag(0x19, 0x10)) == "SIEMENS MR HEADER") value = number_of(set, Tag(0x19, 0x100c), -1);
  if (text_of(set, Tag(0x43, 0x10)) == "GEMS_PARM_01") value = std::fmod(number_of(set, Tag(0x43, 0x1039), -1), 1e9);
  if (text_of(set, Tag(0x2001, 0x10)) == "Philips Imaging DD 001") value = binary_of<float>(set, Tag(0x2001, 0x1003), -1);
  return std::isfinite(value) && value >= 0 ? value : otherwise;
}

// What tells volumes apart in the header of a file of its own.
void read_keys(const DataSet &set, tc_dicom_slice &s) {
  double *keys = s.keys;
  keys[TC_DICOM_KEY_STACK] = text_key(text_of(set, Tag(0x20, 0x9056)), 0);
  keys[TC_DICOM_KEY_TIME] = static_cast<double>(integer_of(set, Tag(0x20, 0x100), 0));
  keys[TC_DICOM_KEY_ECHO] = static_cast<double>(integer_of(set, Tag(0x18, 0x86), 0));
  keys[TC_DICOM_KEY_ECHO_TIME] = number_of(set, Tag(0x18, 0x81), 0);
  keys[TC_DICOM_KEY_B_VALUE] = read_b_value(set, 0);
  keys[TC_DICOM_KEY_PHASE] = float_key(set, Tag(0x20, 0x9241), 0);
  keys[TC_DICOM_KEY_IMAGE_TYPE] = text_key(text_of(set, Tag(0x08, 0x08)), 0);
  keys[TC_DICOM_KEY_ACQUISITION] = static_cast<double>(integer_of(set, Tag(0x20, 0x12), 0));
  s.trigger = number_of(set, Tag(0x18, 0x1060), 0);
  s.uid = checksum(text_of(set, Tag(0x08, 0x18)));
}

// The same in an item of the functional groups.
void read_group_keys(const DataSet &item, tc_dicom_slice &s) {
  Nested content = item_of(item, Tag(0x20, 0x9111)), echo = item_of(item, Tag(0x18, 0x9114)),
         diffusion = item_of(item, Tag(0x18, 0x9117)), heart = item_of(item, Tag(0x18, 0x9118)),
         mr_type = item_of(item, Tag(0x18, 0x9226)), ct_type = item_of(item, Tag(0x18, 0x9329));
  double *keys = s.keys;
  if (content.set) {
    keys[TC_DICOM_KEY_STACK] = text_key(text_of(*content.set, Tag(0x20, 0x9056)), keys[TC_DICOM_KEY_STACK]);
    keys[TC_DICOM_KEY_TIME] = binary_of<uint32_t>(*content.set, Tag(0x20, 0x9128), 0);
  }
  if (echo.set) keys[TC_DICOM_KEY_ECHO_TIME] = float_key(*echo.set, Tag(0x18, 0x9082), 0);
  if (diffusion.set) keys[TC_DICOM_KEY_B_VALUE] = read_b_value(*diffusion.set, 0);
  if (heart.set) {
    keys[TC_DICOM_KEY_PHASE] = float_key(*heart.set, Tag(0x20, 0x9241), 0);
    s.trigger = float_key(*heart.set, Tag(0x20, 0x9153), 0);
  }
  for (const Nested *type : {&mr_type, &ct_type})
    if (type->set)
      keys[TC_DICOM_KEY_IMAGE_TYPE] =
          text_key(text_of(*type->set, Tag(0x08, 0x9007)) + text_of(*type->set, Tag(0x08, 0x9208)), keys[TC_DICOM_KEY_IMAGE_TYPE]);
}

// One item of the functional groups (shared or of a frame) laid over a slice.
void read_groups(const DataSet &item, Picture &p, tc_dicom_slice &s, Scale &scale) {
  Nested position = item_of(item, Tag(0x20, 0x9113)), plane = item_of(item, Tag(0x20, 0x9116)),
         measures = item_of(item, Tag(0x28, 0x9110)), values = item_of(item, Tag(0x28, 0x9145)),
         world = item_of(item, Tag(0x40, 0x9096)), window = item_of(item, Tag(0x28, 0x9132)),
         segment = item_of(item, Tag(0x62, 0x0a));
  for (const Nested *n : {&position, &plane, &measures})
    if (n->set) read_geometry(*n->set, s);
  if (values.set) {
    read_scale(*values.set, p, scale);
  } else if (world.set && world.set->FindDataElement(Tag(0x40, 0x9225))) {
    scale.slope = binary_of<double>(*world.set, Tag(0x40, 0x9225), 1);
    scale.intercept = binary_of<double>(*world.set, Tag(0x40, 0x9224), 0);
    if (!std::isfinite(scale.slope) || scale.slope == 0 || !std::isfinite(scale.intercept)) scale = Scale();
  }
  if (window.set) read_window(*window.set, p);
  read_group_keys(item, s);
  if (segment.set) s.segment = binary_of<uint16_t>(*segment.set, Tag(0x62, 0x0b), 0);
}

// Files with several frames but no functional groups: frames advance along the normal by the offsets or spacing given.
void spread_frames(const DataSet &set, Picture &p) {
  std::vector<double> offsets = numbers_of(set, Tag(0x3004, 0x0c));
  tc_dicom_slice first = p.slices[0];
  static const double straight[6] = {1, 0, 0, 0, 1, 0};
  if (!first.has_orientation) std::copy(straight, straight + 6, first.orientation);
  const double *o = first.orientation;
  double normal[3] = {o[1] * o[5] - o[2] * o[4], o[2] * o[3] - o[0] * o[5], o[0] * o[4] - o[1] * o[3]};
  bool known = offsets.size() == p.frames;
  p.cine = !known && first.between == 0 && set.FindDataElement(Tag(0x18, 0x1063));
  if (!first.has_position && !p.cine) return; // a plain stack, in its turn
  double step = p.cine ? 0 : first.between != 0 ? first.between : first.thickness;
  for (uint32_t f = 0; f < p.frames; f++) {
    double along = known ? offsets[f] - offsets[0] : f * step;
    for (int k = 0; k < 3; k++)
      p.slices[f].position[k] = first.position[k] + along * normal[k];
    p.slices[f].has_position = true;
  }
}

// Everything of the header a slice can have, shared by all frames.
tc_dicom_slice common_slice(const DataSet &set, const Picture &p) {
  tc_dicom_slice s{};
  s.source = static_cast<uint32_t>(p.source);
  s.rows = p.samples.rows;
  s.columns = p.samples.columns;
  s.instance = static_cast<int32_t>(integer_of(set, Tag(0x20, 0x13), 0));
  s.sparse = p.modality == "SEG";
  read_keys(set, s);
  read_geometry(set, s);
  Nested detector = item_of(set, Tag(0x54, 0x22)); // nuclear medicine keeps position and orientation here
  if (detector.set && !s.has_position) read_geometry(*detector.set, s);
  if (!s.has_spacing) s.has_spacing = read_spacing(set, Tag(0x18, 0x1164), s.spacing);
  return s;
}

// What a Siemens mosaic says of itself in its CSA header ("SV10", as of software VB): number and normal of its slices.
struct Mosaic {
  double images = 0, normal[3] = {0, 0, 0};
  int parts = 0; // of the normal
};

// One element's values, texts of the lengths that stand before them; those up to `most` become numbers.
int read_csa_values(tc_reader &r, double *out, int most) {
  tc_reader_seek(&r, r.at + 4 + 4 + 4); // number of values as it may be, type, type again
  const uint32_t items = tc_reader_u32(&r);
  int found = 0;
  tc_reader_u32(&r);
  for (uint32_t i = 0; i < items && !r.failed; i++) {
    tc_reader_u32(&r);
    const uint32_t length = tc_reader_u32(&r);
    tc_reader_seek(&r, r.at + 8);
    const size_t at = r.at;
    tc_reader_seek(&r, at + (uint64_t{length} + 3) / 4 * 4);
    if (r.failed || length == 0 || found == most) continue;
    out[found++] = g_ascii_strtod(std::string(reinterpret_cast<const char *>(r.bytes) + at, length).c_str(), nullptr);
  }
  return found;
}

Mosaic read_csa(const DataSet &set) {
  Mosaic m;
  tc_reader r;
  if (text_of(set, Tag(0x29, 0x10)) != "SIEMENS CSA HEADER" || !set.FindDataElement(Tag(0x29, 0x1010))) return m;
  const gdcm::ByteValue *value = set.GetDataElement(Tag(0x29, 0x1010)).GetByteValue();
  if (!value || value->GetLength() < 16 || memcmp(value->GetPointer(), "SV10", 4) != 0) return m;
  tc_reader_init(&r, value->GetPointer(), value->GetLength(), false);
  tc_reader_seek(&r, 8);
  const uint32_t elements = tc_reader_u32(&r);
  tc_reader_u32(&r);
  for (uint32_t i = 0; i < elements && !r.failed; i++) {
    double unused;
    const char *name = reinterpret_cast<const char *>(r.bytes) + r.at;
    tc_reader_seek(&r, r.at + 64);
    if (r.failed) break;
    if (strncmp(name, "NumberOfImagesInMosaic", 64) == 0)
      read_csa_values(r, &m.images, 1);
    else if (strncmp(name, "SliceNormalVector", 64) == 0)
      m.parts = read_csa_values(r, m.normal, 3);
    else
      read_csa_values(r, &unused, 0);
  }
  return m;
}

// A mosaic becomes its slices. Its position is that of a picture of the mosaic's size around the first slice's centre
// (as dcm2niix and nibabel read it too).
void unfold_mosaic(const DataSet &set, Picture &p) {
  const Mosaic m = read_csa(set);
  const tc_dicom_slice whole = p.slices[0];
  const bool counted = m.images >= 1 && m.images <= 4096;
  const int across = counted ? static_cast<int>(std::ceil(std::sqrt(m.images))) : 1;
  const double *o = whole.orientation, *n = m.normal;
  const double normal[3] = {o[1] * o[5] - o[2] * o[4], o[2] * o[3] - o[0] * o[5], o[0] * o[4] - o[1] * o[3]};
  if (!counted || m.parts != 3 || p.frames != 1 || p.samples.columns % across ||
      p.samples.rows % across || p.samples.per_pixel != 1 || (p.samples.allocated != 16 && p.samples.allocated != 8) ||
      !whole.has_position || !whole.has_orientation || !whole.has_spacing || !(whole.between > 0))
    fail(TC_ERROR_UNSUPPORTED, "a mosaic whose header does not place its slices; convert it with dcm2niix");
  const double along = n[0] * normal[0] + n[1] * normal[1] + n[2] * normal[2];
  if (!(std::fabs(std::fabs(along) - 1) < 0.01))
    fail(TC_ERROR_UNSUPPORTED, "a mosaic whose slices are not stacked along their normal; convert it with dcm2niix");
  p.tiles_across = static_cast<uint32_t>(across);
  p.frames = static_cast<uint32_t>(m.images);
  p.slices.assign(p.frames, whole);
  p.scales.assign(p.frames, p.scales[0]);
  for (uint32_t f = 0; f < p.frames; f++) {
    tc_dicom_slice &s = p.slices[f];
    s.frame = f;
    s.columns = p.samples.columns / across;
    s.rows = p.samples.rows / across;
    for (int k = 0; k < 3; k++)
      s.position[k] += 0.5 * (p.samples.columns - s.columns) * s.spacing[0] * o[k] +
                       0.5 * (p.samples.rows - s.rows) * s.spacing[1] * o[3 + k] +
                       f * s.between * std::copysign(1, along) * normal[k];
  }
}

// ---- segments ----

// CIE L*a*b* of the profile connection space (D50), as 16-bit numbers, to sRGB (PS3.3, C.10.7.1.1; ICC.1, sRGB's matrix
// adapted to D50).
void rgb_of_lab(const uint16_t lab[3], float rgb[3]) {
  static const double white[3] = {0.9642, 1.0, 0.8249}, matrix[3][3] = {{3.1338561, -1.6168667, -0.4906146},
                                                                      {-0.9787684, 1.9161415, 0.0334540},
                                                                      {0.0719453, -0.2289914, 1.4052427}};
  const double l = lab[0] * 100 / 65535.0, a = lab[1] * 255 / 65535.0 - 128, b = lab[2] * 255 / 65535.0 - 128;
  const double f[3] = {(l + 16) / 116 + a / 500, (l + 16) / 116, (l + 16) / 116 - b / 200};
  double xyz[3];
  for (int i = 0; i < 3; i++)
    xyz[i] = white[i] * (f[i] > 6.0 / 29 ? f[i] * f[i] * f[i] : (f[i] - 4.0 / 29) * 108 / 841);
  for (int i = 0; i < 3; i++) {
    const double linear = matrix[i][0] * xyz[0] + matrix[i][1] * xyz[1] + matrix[i][2] * xyz[2];
    const double value = linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
    rgb[i] = static_cast<float>(std::min(std::max(value, 0.0), 1.0));
  }
}

void read_segments(const DataSet &set, Picture &p) {
  Items items = items_of(set, Tag(0x62, 0x02));
  const size_t count = items ? items->GetNumberOfItems() : 0;
  std::set<uint32_t> known;
  for (size_t i = 1; i <= count; i++) {
    const DataSet &item = items->GetItem(i).GetNestedDataSet();
    tc_segment s{};
    s.label = binary_of<uint16_t>(item, Tag(0x62, 0x04), 0);
    put_words(s.name, words_of(set, item, Tag(0x62, 0x05)));
    const gdcm::ByteValue *lab = item.FindDataElement(Tag(0x62, 0x0d)) ? item.GetDataElement(Tag(0x62, 0x0d)).GetByteValue() : nullptr;
    s.has_color = lab && lab->GetPointer() && lab->GetLength() >= 6;
    if (s.has_color) {
      uint16_t numbers[3];
      memcpy(numbers, lab->GetPointer(), sizeof numbers);
      rgb_of_lab(numbers, s.color);
    }
    if (s.label && known.insert(s.label).second) p.segments.push_back(s);
  }
}

// Regions of interest, each of closed contours in planes: PS3.3, C.8.8.5 and C.8.8.6.
void read_contours(const DataSet &set, Picture &p) {
  Items regions = items_of(set, Tag(0x3006, 0x20)), drawn = items_of(set, Tag(0x3006, 0x39));
  std::map<long, uint32_t> labels; // by number of the region
  for (size_t i = 1; regions && i <= regions->GetNumberOfItems(); i++) {
    const DataSet &item = regions->GetItem(i).GetNestedDataSet();
    tc_segment s{};
    s.label = static_cast<uint32_t>(p.segments.size() + 1);
    put_words(s.name, words_of(set, item, Tag(0x3006, 0x26)));
    if (s.label <= TC_SEGMENTS_MAX && labels.emplace(integer_of(item, Tag(0x3006, 0x22), -1), s.label).second) p.segments.push_back(s);
  }
  for (size_t i = 1; drawn && i <= drawn->GetNumberOfItems(); i++) {
    const DataSet &item = drawn->GetItem(i).GetNestedDataSet();
    auto found = labels.find(integer_of(item, Tag(0x3006, 0x84), -2));
    if (found == labels.end()) continue;
    const std::vector<double> color = numbers_of(item, Tag(0x3006, 0x2a));
    tc_segment &s = p.segments[found->second - 1];
    s.has_color = color.size() >= 3;
    for (size_t c = 0; c < 3 && s.has_color; c++)
      s.color[c] = static_cast<float>(std::min(std::max(color[c] / 255, 0.0), 1.0));
    Items contours = items_of(item, Tag(0x3006, 0x40));
    for (size_t k = 1; contours && k <= contours->GetNumberOfItems(); k++) {
      const DataSet &contour = contours->GetItem(k).GetNestedDataSet();
      const std::string type = text_of(contour, Tag(0x3006, 0x42));
      if (type != "CLOSED_PLANAR" && type != "CLOSEDPLANAR_XOR") {
        p.open_contours++;
        continue;
      }
      const size_t at = p.corners.size();
      std::vector<double> numbers = numbers_of(contour, Tag(0x3006, 0x50));
      if (numbers.size() < 9 || numbers.size() % 3 || long(numbers.size() / 3) != integer_of(contour, Tag(0x3006, 0x46), long(numbers.size() / 3)))
        fail(TC_ERROR_FORMAT, "contour %zu of region %zu is cut or no polygon", k, i);
      for (const double mm : numbers)
        if (std::fabs(mm) > 1e6) fail(TC_ERROR_FORMAT, "contour %zu of region %zu lies over a kilometre away", k, i);
      p.corners.insert(p.corners.end(), numbers.begin(), numbers.end());
      p.contours.push_back({found->second, at / 3, numbers.size() / 3, 0});
    }
  }
  if (p.contours.empty()) fail(TC_ERROR_FORMAT, "the set of structures holds no closed contour in a plane");
  Nested frame = item_of(set, Tag(0x3006, 0x10));
  Nested study = frame.set ? item_of(*frame.set, Tag(0x3006, 0x12)) : Nested{};
  Nested series = study.set ? item_of(*study.set, Tag(0x3006, 0x14)) : Nested{};
  if (series.set) p.drawn_on = plain(text_of(*series.set, Tag(0x20, 0x0e)), 64);
  p.frames = 0;
}

void read_slices(const DataSet &set, Picture &p) {
  Scale scale;
  tc_dicom_slice common = common_slice(set, p);
  read_scale(set, p, scale);
  read_window(set, p);
  double dose = number_of(set, Tag(0x3004, 0x0e), 0);
  if (dose > 0 && dose < 1e30) scale.slope = dose;
  Nested shared = item_of(set, Tag(0x5200, 0x9229));
  if (shared.set) read_groups(*shared.set, p, common, scale);
  Items frames = items_of(set, Tag(0x5200, 0x9230));
  if (frames && frames->GetNumberOfItems() < p.frames)
    fail(TC_ERROR_FORMAT, "the header describes fewer frames than it announces");
  p.slices.assign(p.frames, common);
  p.scales.assign(p.frames, scale);
  for (uint32_t f = 0; f < p.frames; f++) {
    p.slices[f].frame = f;
    if (frames) read_groups(frames->GetItem(f + 1).GetNestedDataSet(), p, p.slices[f], p.scales[f]);
  }
  if (!frames && p.frames > 1) spread_frames(set, p);
  if (p.mosaic) unfold_mosaic(set, p);
  read_segments(set, p);
  p.label_map = p.modality == "SEG" && text_of(set, Tag(0x62, 0x01)) == "LABELMAP";
  p.background = binary_of<uint16_t>(set, Tag(0x28, 0x120), 0);
  p.fractional = text_of(set, Tag(0x62, 0x01)) == "FRACTIONAL";
  if (p.fractional)
    p.segment_threshold = std::max(1.0, std::ceil(binary_of<uint16_t>(set, Tag(0x62, 0x0e), 255) / 2.0));
}

// Weight and dose stay in here: only their quotient leaves.
void read_suv(const DataSet &set, Picture &p) {
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
  if (text_of(set, Tag(0x7053, 0x10)) == "Philips PET Private Group") suv.philips = number_of(set, Tag(0x7053, 0x1000), 0);
  p.suv = tc_dicom_suv_factor(&suv, &p.no_suv);
}

// "142233.5" -> "14:22:33".
std::string clock_of(const std::string &text) {
  if (text.size() < 4 || text.substr(0, 4).find_first_not_of("0123456789") != std::string::npos) return "";
  const bool seconds = text.size() >= 6 && text.substr(4, 2).find_first_not_of("0123456789") == std::string::npos;
  return text.substr(0, 2) + ":" + text.substr(2, 2) + (seconds ? ":" + text.substr(4, 2) : "");
}

// "20260131" -> "2026-01-31".
std::string day_of(const std::string &text) {
  if (text.size() != 8 || text.find_first_not_of("0123456789") != std::string::npos) return "";
  return text.substr(0, 4) + "-" + text.substr(4, 2) + "-" + text.substr(6);
}

// What a radiologist knows a series by. Whose it is, and the day, leave only where they were asked for.
void read_description(const DataSet &set, Picture &p, bool patient) {
  p.description = words_of(set, set, Tag(0x08, 0x103e));
  for (uint16_t element : {0x31, 0x32, 0x33, 0x30}) // of the series, acquisition, content, study
    if (p.time.empty()) p.time = clock_of(text_of(set, Tag(0x08, element)));
  if (!patient) return;
  for (uint16_t element : {0x21, 0x22, 0x23, 0x20})
    if (p.day.empty()) p.day = day_of(text_of(set, Tag(0x08, element)));
  p.patient = words_of(set, set, Tag(0x10, 0x10));
  const std::string number = words_of(set, set, Tag(0x10, 0x20));
  if (!number.empty()) p.patient += (p.patient.empty() ? "" : " ") + ("(" + number + ")");
}

void read_labels(const DataSet &set, Picture &p) {
  p.modality = plain(text_of(set, Tag(0x08, 0x60)), 15);
  p.series = plain(text_of(set, Tag(0x20, 0x0e)), 64);
  p.series_number = static_cast<int>(integer_of(set, Tag(0x20, 0x11), 0));
  p.unit = plain(text_of(set, Tag(0x54, 0x1001)), 15);
  p.mosaic = text_of(set, Tag(0x08, 0x08)).find("MOSAIC") != std::string::npos;
  p.lookup = items_of(set, Tag(0x28, 0x3000)) != nullptr;
}

// Which of the three pixel elements there is; the header pass stops before it and sees none, so the sample size tells.
Tag pixel_tag(const DataSet &set, const Picture &p) {
  bool has_stored = set.FindDataElement(Tag(0x28, 0x101));
  if (p.samples.allocated == 64 && !has_stored) return Tag(0x7fe0, 0x0009);
  if (p.samples.allocated == 32 && !has_stored) return Tag(0x7fe0, 0x0008);
  return Tag(0x7fe0, 0x0010);
}

void cap_allocations(const tc_dicom_blob &blob, uint64_t factor) {
  allocation_cap =
      std::max<uint64_t>(MiB, blob.size > SIZE_MAX / (2 * factor) ? SIZE_MAX : 2 * factor * blob.size + MiB);
}

[[noreturn]] void fail_header(const gdcm::FileMetaInformation &header) {
  std::string syntax = plain(text_of(header, Tag(0x0002, 0x0010)), 64);
  bool standard =
      syntax.compare(0, 14, "1.2.840.10008.") == 0 && syntax.find_first_not_of("0123456789.") == std::string::npos;
  if (!syntax.empty() && gdcm::TransferSyntax::GetTSType(syntax.c_str()) == gdcm::TransferSyntax::TS_END)
    fail(TC_ERROR_UNSUPPORTED, "transfer syntax %s is not read", standard ? syntax.c_str() : "of its own kind");
  fail(TC_ERROR_FORMAT, "the DICOM header is damaged or cut");
}

// Whether uncompressed pixels that begin at `at` are all there: one cut file of a series is then left out like one that
// cannot be read at all, and not found out half-way.
bool pixels_are_there(const Picture &p, std::streamoff at, size_t size) {
  const tc_dicom_samples &s = p.samples;
  uint64_t bytes = s.allocated == 1 ? (uint64_t(s.rows) * s.columns * p.frames + 7) / 8 : tc_dicom_frame_bytes(&s) * p.frames;
  return !p.native || p.deflated_at || at < 0 || bytes <= size - std::min<uint64_t>(at, size);
}

// Reads one header. False: no picture in it (a report, a plan, a directory).
bool read_picture(const tc_dicom_blob &blob, size_t source, bool patient, Picture &p) {
  MemoryBuffer buffer(blob.bytes, blob.size);
  std::istream stream(&buffer);
  gdcm::Reader reader;
  std::set<Tag> skip = {Tag(0x7fe0, 0x0008), Tag(0x7fe0, 0x0009), Tag(0x7fe0, 0x0010)};
  reader.SetStream(stream);
  cap_allocations(blob, 64); // deflated headers shrink well; what is left over is the process limit's to stop
  bool ok = guarded([&] { return reader.ReadUpToTag(Tag(0x7fe0, 0x0010), skip); });
  if (!ok) fail_header(reader.GetFile().GetHeader());
  const DataSet &set = reader.GetFile().GetDataSet();
  const gdcm::TransferSyntax &syntax = reader.GetFile().GetHeader().GetDataSetTransferSyntax();
  p.source = source;
  read_labels(set, p);
  read_description(set, p, patient);
  if (p.modality == "RTSTRUCT") return read_contours(set, p), true;
  read_samples(set, p);
  if (p.modality == "SEG") p.palette = false; // its samples are labels
  if (p.samples.rows == 0 || p.samples.columns == 0 || p.samples.allocated == 0) return false;
  p.pixels = pixel_tag(set, p);
  p.samples.is_float = p.pixels != Tag(0x7fe0, 0x0010);
  p.swapped = syntax == gdcm::TransferSyntax::ExplicitVRBigEndian && p.samples.allocated == 32 && !p.samples.is_float;
  p.native = (syntax == gdcm::TransferSyntax::ImplicitVRLittleEndian ||
              syntax == gdcm::TransferSyntax::ExplicitVRLittleEndian ||
              syntax == gdcm::TransferSyntax::DeflatedExplicitVRLittleEndian || p.swapped) &&
             p.samples.allocated != 12 && !p.palette;
  p.samples.halved = p.native && text_of(set, Tag(0x28, 0x04)) == "YBR_FULL_422";
  p.run_lengths = syntax == gdcm::TransferSyntax::RLELossless;
  if (p.run_lengths && p.samples.per_pixel > 1 && p.samples.allocated > 8)
    fail(TC_ERROR_UNSUPPORTED, "colours of 16 bits packed by RLE are not read; export the pictures uncompressed");
  if (p.samples.allocated != 12 && !tc_dicom_samples_valid(&p.samples) && !p.palette)
    fail(TC_ERROR_UNSUPPORTED, "samples of %d bits allocated, %d stored, %d a pixel are not read", p.samples.allocated,
         p.samples.stored, p.samples.per_pixel);
  if (p.samples.is_float && !p.native)
    fail(TC_ERROR_UNSUPPORTED, "float pixels in a packed or big-endian file are not read");
  if (syntax == gdcm::TransferSyntax::DeflatedExplicitVRLittleEndian) {
    uint64_t at = uint64_t{144} + binary_of<uint32_t>(reader.GetFile().GetHeader(), Tag(0x0002, 0x0000), 0);
    if (at >= blob.size) fail(TC_ERROR_FORMAT, "the DICOM header is damaged or cut");
    p.deflated_at = at; // preamble and mark, the group length's own 12 bytes, the group
  }
  if (binary_of<uint32_t>(set, Tag(0x48, 0x06), 0) > static_cast<uint32_t>(p.samples.columns))
    fail(TC_ERROR_UNSUPPORTED, "tiles of a whole-slide picture are no volume");
  read_frames(set, syntax, blob.size, p);
  if (!pixels_are_there(p, stream.tellg(), blob.size)) fail(TC_ERROR_FORMAT, "pixel data is cut: the file ends before it does");
  read_slices(set, p);
  read_suv(set, p);
  return true;
}

// ---- pixels ----

struct Frame {
  tc_dicom_samples samples;
  const uint8_t *bytes;
  size_t size;
  unsigned first_bit;
};

struct Uncap {
  ~Uncap() { allocation_cap = SIZE_MAX; }
};

// Decodes frames of one file at a time; the last file stays open, so frames of a multi-frame file cost one read.
class Decoder {
public:
  explicit Decoder(const tc_dicom_sources &sources) : sources_(sources) {}
  ~Decoder() { close(); }
  Frame frame(const Picture &p, uint32_t number) {
    Uncap uncap;
    if (open_ != &p) open(p);
    allocation_cap = cap_;
    const uint32_t stored = p.tiles_across ? 0 : number;
    const Frame f = p.native ? native_frame(p, stored) : coded_frame(p, stored);
    return p.tiles_across ? tile_of(f, p.tiles_across, number) : f;
  }

private:
  void close() {
    reader_.reset();
    plain_reader_.reset();
    tc_dicom_blob_finish(&blob_);
    whole_.clear();
    pieces_.clear();
    open_ = nullptr;
    bytes_ = nullptr;
  }

  void open(const Picture &p) {
    close();
    GError *error = nullptr;
    if (!tc_dicom_sources_get(&sources_, p.source, &blob_, &error)) {
      if (error) fail_with(error);
      fail(TC_ERROR_IO, "a file changed while it was read");
    }
    uint64_t decoded = tc_dicom_frame_bytes(&p.samples) * stored_frames(p);
    cap_allocations(blob_, 1);
    cap_ = allocation_cap =
        std::max<uint64_t>(allocation_cap, std::min<uint64_t>(decoded, 4096 * uint64_t{blob_.size}) + MiB);
    if (p.native)
      open_native(p);
    else
      open_coded(p);
    open_ = &p;
  }

  void open_native(const Picture &p) {
    MemoryBuffer buffer(blob_.bytes, blob_.size);
    std::istream stream(&buffer);
    plain_reader_.reset(new gdcm::Reader);
    plain_reader_->SetStream(stream);
    if (!guarded([&] { return plain_reader_->Read(); })) fail(TC_ERROR_FORMAT, "a DICOM file is damaged or cut");
    const DataSet &set = plain_reader_->GetFile().GetDataSet();
    const gdcm::ByteValue *value =
        set.FindDataElement(p.pixels) ? set.GetDataElement(p.pixels).GetByteValue() : nullptr;
    if (!value || !value->GetPointer()) fail(TC_ERROR_FORMAT, "a DICOM file has no pixel data");
    bool whole = p.deflated_at ? tc_dicom_deflate_is_whole(blob_.bytes + p.deflated_at, blob_.size - p.deflated_at)
                               : !buffer.cut;
    if (!whole) fail(TC_ERROR_FORMAT, "pixel data is cut: the file ends before it does");
    bytes_ = reinterpret_cast<const uint8_t *>(value->GetPointer());
    size_ = value->GetLength();
    if (p.swapped) swap_halves();
    if ((frame_bits(p.samples) * stored_frames(p) + 7) / 8 > size_)
      fail(TC_ERROR_FORMAT, "the header announces more pixels than there are");
  }

  static uint32_t stored_frames(const Picture &p) { return p.tiles_across ? 1 : p.frames; }

  // One slice of a mosaic.
  Frame tile_of(const Frame &whole, uint32_t across, uint32_t number) {
    Frame f = whole;
    const size_t pixel = size_t(whole.samples.allocated) / 8, row = size_t(whole.samples.columns) * pixel;
    f.samples.columns /= static_cast<int>(across);
    f.samples.rows /= static_cast<int>(across);
    const size_t width = size_t(f.samples.columns) * pixel, height = size_t(f.samples.rows);
    if (whole.size < row * size_t(whole.samples.rows)) fail(TC_ERROR_FORMAT, "pixel data of a mosaic is cut");
    tile_.resize(width * height);
    const uint8_t *from = whole.bytes + number / across * height * row + number % across * width;
    for (size_t y = 0; y < height; y++)
      memcpy(tile_.data() + y * width, from + y * row, width);
    f.bytes = tile_.data();
    f.size = tile_.size();
    return f;
  }

  void swap_halves() {
    whole_.assign(bytes_, bytes_ + size_);
    for (size_t i = 0; i + 4 <= size_; i += 4)
      std::swap_ranges(whole_.begin() + i, whole_.begin() + i + 2, whole_.begin() + i + 2);
    bytes_ = whole_.data();
  }

  static uint64_t frame_bits(const tc_dicom_samples &s) {
    return s.allocated == 1 ? uint64_t(s.rows) * s.columns : 8 * tc_dicom_frame_bytes(&s);
  }

  void open_coded(const Picture &p) {
    if (p.run_lengths) check_run_lengths(p);
    MemoryBuffer buffer(blob_.bytes, blob_.size);
    std::istream stream(&buffer);
    // The reader of images wants geometry too, and gives up on files of one frame that it expects several in.
    reader_.reset(p.palette ? new gdcm::ImageReader : new gdcm::PixmapReader);
    reader_->SetStream(stream);
    if (!guarded([&] { return reader_->Read(); }))
      fail(TC_ERROR_FORMAT, "a DICOM file is damaged, cut, or packed in a way not known");
    if (buffer.cut) fail(TC_ERROR_FORMAT, "pixel data is cut: the file ends before it does");
    if (stored_frames(p) > 1 && !p.palette) split_fragments(p);
  }

  // A run-length frame begins with the number of its segments (PS3.5, annex G.5). GDCM walks a table of 15 offsets by that
  // number as soon as a picture is opened, so it is checked before.
  void check_run_lengths(const Picture &p) {
    MemoryBuffer buffer(blob_.bytes, blob_.size);
    std::istream stream(&buffer);
    gdcm::Reader reader;
    reader.SetStream(stream);
    if (!guarded([&] { return reader.Read(); })) fail(TC_ERROR_FORMAT, "a DICOM file is damaged or cut");
    const DataSet &set = reader.GetFile().GetDataSet();
    if (!set.FindDataElement(p.pixels)) fail(TC_ERROR_FORMAT, "a DICOM file has no pixel data");
    const gdcm::SequenceOfFragments *all = set.GetDataElement(p.pixels).GetSequenceOfFragments();
    const size_t frames = all ? std::min<size_t>(all->GetNumberOfFragments(), stored_frames(p)) : 0;
    const uint32_t wanted = static_cast<uint32_t>(p.samples.per_pixel * (p.samples.allocated / 8));
    for (size_t f = 0; f < frames; f++) {
      const gdcm::ByteValue *bytes = all->GetFragment(f).GetByteValue();
      const auto *head = bytes ? reinterpret_cast<const uint8_t *>(bytes->GetPointer()) : nullptr;
      if (!head || bytes->GetLength() < 64 ||
          (head[0] | head[1] << 8 | head[2] << 16 | static_cast<uint32_t>(head[3]) << 24) != wanted)
        fail(TC_ERROR_FORMAT, "the run lengths of frame %zu are damaged", f + 1);
    }
  }

  const gdcm::Bitmap &picture() const {
    if (const auto *images = dynamic_cast<const gdcm::ImageReader *>(reader_.get())) return images->GetImage();
    return reader_->GetPixmap();
  }

  // Compressed frames come one at a time where the fragments say which belong to which frame: less memory, and of a
  // time series only the frames that are shown get decoded.
  void split_fragments(const Picture &p) {
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

  Frame native_frame(const Picture &p, uint32_t number) {
    uint64_t bits = frame_bits(p.samples) * number;
    if (bits / 8 > size_) fail(TC_ERROR_FORMAT, "pixel data ends before frame %u", number + 1);
    return Frame{p.samples, bytes_ + bits / 8, size_ - bits / 8, static_cast<unsigned>(bits % 8)};
  }

  // What the decoder made of it, which may differ from the header (a JPEG says itself how deep it is).
  static tc_dicom_samples decoded_samples(const gdcm::Bitmap &image, const Picture &p) {
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

  void decode_into(const gdcm::Bitmap &image) {
    size_t length = image.GetBufferLength();
    if (length > allocation_cap) fail(TC_ERROR_FORMAT, "the header announces more pixels than the file can hold");
    whole_.resize(length);
    char *out = reinterpret_cast<char *>(whole_.data());
    if (length == 0 || !guarded([&] { return image.GetBuffer(out); }))
      fail(TC_ERROR_FORMAT, "pixel data cannot be decoded; the file is damaged or its compression is not known");
  }

  Frame coded_frame(const Picture &p, uint32_t number) {
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

  gdcm::Image single_frame(const gdcm::Bitmap &image, uint32_t number) const {
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

  const tc_dicom_sources &sources_;
  const Picture *open_ = nullptr;
  tc_dicom_blob blob_{};
  size_t cap_ = SIZE_MAX; // allocations while this file is open
  std::unique_ptr<gdcm::PixmapReader> reader_;
  std::unique_ptr<gdcm::Reader> plain_reader_;
  const uint8_t *bytes_ = nullptr;
  size_t size_ = 0;
  std::vector<gdcm::SmartPointer<gdcm::SequenceOfFragments>> pieces_;
  std::vector<uint8_t> whole_, tile_;
  tc_dicom_samples samples_{};
};

// ---- the run ----

struct Series {
  std::vector<const Picture *> pictures;
  uint64_t frames = 0;
};

struct Run {
  const tc_order &order;
  const tc_helper_request &request;
  tc_dicom_sources sources{};
  std::vector<Picture *> pictures; // owned; pointers, so that a large folder is not moved about
  size_t unreadable = 0;
  Run(const tc_order &out, const tc_helper_request &wanted) : order(out), request(wanted) {}
  ~Run() {
    for (Picture *p : pictures)
      delete p;
    tc_dicom_sources_finish(&sources);
  }
};

void progress(const Run &run, double fraction) {
  GError *error = nullptr;
  if (!run.order.goes_on(run.order.user, std::min(fraction, 1.0), &error)) fail_with(error);
}

// One source's header into the run; a bad file among many is counted, a bad only file is the error.
void scan_one(Run &run, size_t i) {
  tc_dicom_blob blob{};
  GError *error = nullptr;
  Picture *p = new Picture();
  try {
    if (!tc_dicom_sources_get(&run.sources, i, &blob, &error)) {
      if (error) fail_with(error);
    } else if (read_picture(blob, i, run.request.patient, *p)) {
      run.pictures.push_back(p);
      p = nullptr;
    }
  } catch (const Failure &) {
    run.unreadable++;
    if (run.sources.count == 1) throw;
  } catch (const std::exception &) {
    run.unreadable++;
    if (run.sources.count == 1) fail(TC_ERROR_FORMAT, "the DICOM header is damaged");
  }
  allocation_cap = SIZE_MAX;
  tc_dicom_blob_finish(&blob);
  delete p;
}

void scan(Run &run, int input) {
  GError *error = nullptr;
  uint64_t frames = 0;
  if (!tc_dicom_sources_open(&run.sources, input, &error)) fail_with(error);
  for (size_t i = 0; i < run.sources.count; i++) {
    size_t before = run.pictures.size();
    scan_one(run, i);
    if (run.pictures.size() > before) frames += run.pictures.back()->frames;
    if (frames > FRAMES_MAX) fail(TC_ERROR_LIMIT, "more than %llu pictures", (unsigned long long)FRAMES_MAX);
    progress(run, 0.2 * double(i + 1) / double(run.sources.count));
  }
  if (!run.pictures.empty() || tc_stack_is(&run.sources)) return;
  if (run.sources.count == 1) fail(TC_ERROR_FORMAT, "no picture in this DICOM file; of a plan open the folder of the pictures");
  fail(TC_ERROR_FORMAT, "no DICOM pictures among %zu files (%zu unreadable)", run.sources.count, run.unreadable);
}

// Series in the order they are listed: by series number, then by UID.
std::vector<Series> series_of(const Run &run) {
  std::map<std::tuple<int, std::string, size_t>, Series> sorted; // every set of structures is one of its own
  std::map<std::string, int> numbers; // the number of a series is its first picture's
  for (const Picture *p : run.pictures) {
    int number = numbers.emplace(p->series, p->series_number).first->second;
    Series &s = sorted[std::make_tuple(number, p->series, p->contours.empty() ? 0 : p->source + 1)];
    s.pictures.push_back(p);
    s.frames += p->frames;
  }
  std::vector<Series> out;
  for (auto &entry : sorted)
    out.push_back(entry.second);
  return out;
}

const Series &choose_series(const std::vector<Series> &all, const std::string &wanted) {
  if (wanted.empty()) {
    size_t best = 0;
    for (size_t i = 1; i < all.size(); i++)
      if (all[i].frames > all[best].frames) best = i;
    return all[best];
  }
  if (wanted.size() <= 6 && wanted.find_first_not_of("0123456789") == std::string::npos) {
    size_t number = strtoul(wanted.c_str(), nullptr, 10);
    if (number >= 1 && number <= all.size()) return all[number - 1];
  }
  for (const Series &s : all)
    if (s.pictures[0]->series == wanted) return s;
  fail(TC_ERROR_NOT_FOUND, "no such series; there %s %zu, choose by number (#1 ...) or UID",
       all.size() == 1 ? "is" : "are", all.size());
}

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
  bool colors = false;  // voxels are sent as r, g, b
  tc_overlaps overlaps{};
  double suv = 0;       // what values were multiplied by; 0: they are the file's
  Job() = default;
  Job(const Job &) = delete;
  ~Job() {
    tc_dicom_stack_finish(&stack);
    tc_overlaps_finish(&overlaps);
  }
  const Member &at(size_t item) const { return members[stack.items[item].slice]; }
  const Picture &first() const { return *at(0).picture; }
};

std::vector<tc_dicom_slice> slices_of(const Series &series) {
  std::vector<tc_dicom_slice> slices;
  for (const Picture *p : series.pictures)
    slices.insert(slices.end(), p->slices.begin(), p->slices.end());
  order_text_keys(slices);
  return slices;
}

// The volumes of a series.
struct Volumes : tc_dicom_groups {
  explicit Volumes(const std::vector<tc_dicom_slice> &slices) { tc_dicom_groups_make(slices.data(), slices.size(), this); }
  ~Volumes() { tc_dicom_groups_finish(this); }
  Volumes(const Volumes &) = delete;
};

void list(const Run &run) {
  size_t sent = 0;
  int number = 0;
  for (const Series &s : series_of(run)) {
    tc_series line{};
    const Picture &p = *s.pictures[0];
    snprintf(line.uid, sizeof line.uid, "%s", p.series.c_str());
    snprintf(line.modality, sizeof line.modality, "%s", p.modality.c_str());
    snprintf(line.label, sizeof line.label, "series %d", p.series_number);
    put_words(line.description, p.description);
    snprintf(line.time, sizeof line.time, "%s%s%s", p.day.c_str(), p.day.empty() ? "" : " ", p.time.c_str());
    put_words(line.patient, p.patient);
    line.number = ++number;
    line.files = static_cast<int>(s.pictures.size());
    line.frames = static_cast<int>(s.frames);
    line.rows = p.samples.rows;
    line.columns = p.samples.columns;
    line.volume = 1;
    if (s.frames == 0) { // structures
      snprintf(line.what, sizeof line.what, "%zu regions", p.segments.size());
      if (sent++ < TC_WIRE_SERIES_MAX && !tc_wire_send_series(TC_HELPER_SOCKET_FD, &line)) _exit(1);
      continue;
    }
    Volumes volumes(slices_of(s));
    for (size_t v = 0; v < volumes.count && sent < TC_WIRE_SERIES_MAX; v++, sent++) {
      line.volume = static_cast<int>(v + 1);
      line.slices = static_cast<int>(volumes.list[v].places);
      memcpy(line.what, volumes.list[v].what, sizeof line.what);
      if (!tc_wire_send_series(TC_HELPER_SOCKET_FD, &line)) _exit(1);
    }
  }
}

// What follows the '#' of a path: "2", "UID", "volume=3", or "2#volume=3".
struct Choice {
  std::string series;
  unsigned volume = 0;
};

Choice read_choice(const std::string &text) {
  static const char mark[] = "volume=";
  Choice choice;
  size_t at = text.rfind(mark);
  if (at == std::string::npos || (at > 0 && text[at - 1] != '#')) {
    choice.series = text;
    return choice;
  }
  std::string number = text.substr(at + sizeof mark - 1);
  if (number.empty() || number.size() > 6 || number.find_first_not_of("0123456789") != std::string::npos || number == "0")
    fail(TC_ERROR_INVALID, "#volume= wants the number of a volume, from 1");
  choice.volume = static_cast<unsigned>(strtoul(number.c_str(), nullptr, 10));
  choice.series = at > 0 ? text.substr(0, at - 1) : "";
  return choice;
}

// Chooses the volume, places it, and says what of the series it is.
void make_stack(const Series &series, const Choice &choice, bool bridge_nothing, Job &job) {
  GError *error = nullptr;
  tc_volume_desc &d = job.desc;
  std::vector<tc_dicom_slice> slices = slices_of(series);
  for (const Picture *p : series.pictures)
    for (uint32_t f = 0; f < p->frames; f++)
      job.members.push_back(Member{p, f, p->scales[f]});
  Volumes volumes(slices);
  int chosen = tc_dicom_groups_choose(&volumes, choice.volume, &error);
  if (chosen < 0) fail_with(error);
  const tc_dicom_group &group = volumes.list[chosen];
  if (group.tangled)
    fail(TC_ERROR_FORMAT, "%zu pictures share %zu positions and nothing in their headers tells them apart; sort them",
         group.count, group.places);
  if (!tc_dicom_stack_make(slices.data(), group.slices, group.count, &job.stack, &error)) fail_with(error);
  if (job.stack.bridged && bridge_nothing)
    fail(TC_ERROR_FORMAT, "slice %d of %d is missing, and none is made up here; send the whole series", job.stack.bridged,
         job.stack.dims[2]);
  d.frames = static_cast<int>(volumes.count);
  job.from.volume = chosen + 1;
  job.from.slices_used = static_cast<int>(group.places);
  job.from.slices_found = static_cast<int>(volumes.places);
  if (volumes.count > 1)
    tc_dicom_note(d.note, "volume %d of %zu%s%s, choose by #volume=N", chosen + 1, volumes.count, group.what[0] ? ": " : "",
                  group.what);
  if (group.places < volumes.places)
    tc_dicom_note(d.note, "%zu of %zu slices", group.places, volumes.places);
  if (volumes.copies) tc_dicom_note(d.note, "%zu copies of pictures left out", volumes.copies);
}

// PET in SUV, where every picture of the volume can be.
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

// 32-bit and wider integers: what they hold decides how they are kept (the storage rule of import.h).
tc_voxel_type narrow_type(const Job &job, const Run &run) {
  Decoder decoder(run.sources);
  double lo = INFINITY, hi = -INFINITY;
  for (size_t i = 0; i < job.stack.count; i++) {
    Frame f = decoder.frame(*job.at(i).picture, job.at(i).frame);
    if (!tc_dicom_range(&f.samples, f.bytes, f.size, &lo, &hi)) fail(TC_ERROR_FORMAT, "pixel data is cut");
  }
  if (lo >= 0 && hi <= 255) return TC_U8;
  if (lo >= -128 && hi <= 127) return TC_I8;
  if (lo >= 0 && hi <= 65535) return TC_U16;
  if (lo >= -32768 && hi <= 32767) return TC_I16;
  return TC_F32;
}

// The smallest type that holds the samples of every picture taken (a series may mix depths and signs).
tc_voxel_type common_type(const Job &job) {
  bool narrow_signed = false, wide_signed = false, wide = false;
  for (size_t i = 0; i < job.stack.count; i++) {
    tc_voxel_type type = job.at(i).picture->palette ? TC_U8 : tc_dicom_natural_type(&job.at(i).picture->samples);
    if (type == TC_F32) return TC_F32;
    wide |= type == TC_U16 && job.at(i).picture->samples.stored == 16;
    wide_signed |= type == TC_U16 || type == TC_I16;
    narrow_signed |= type == TC_I8 || type == TC_I16;
  }
  if (!narrow_signed) return wide_signed ? TC_U16 : TC_U8;
  return wide ? TC_F32 : wide_signed ? TC_I16 : TC_I8;
}

uint32_t segment_of(const Job &job, size_t item) { return job.at(item).picture->slices[job.at(item).frame].segment; }

// The labels of a layer, from the items [from, to) of the stack.
void stamp_layer(Job &job, Decoder &decoder, size_t from, size_t to, std::vector<uint16_t> &labels) {
  labels.assign(size_t(job.desc.dims[0]) * size_t(job.desc.dims[1]), 0);
  for (size_t item = from; item < to; item++) {
    const Member &m = job.at(item);
    Frame f = decoder.frame(*m.picture, m.frame);
    if (!tc_dicom_stamp(&f.samples, f.bytes, f.size, f.first_bit, m.picture->segment_threshold, segment_of(job, item),
                        &job.overlaps, labels.data()))
      fail(TC_ERROR_FORMAT, "pixel data of slice %u of %d is cut", job.stack.items[item].layer + 1, job.desc.dims[2]);
  }
}

size_t end_of_layer(const Job &job, size_t item) {
  const uint32_t layer = job.stack.items[item].layer;
  while (item < job.stack.count && job.stack.items[item].layer == layer)
    item++;
  return item;
}

// False where the frames are of no segment. Where frames of several lie at one position, all are read once to learn which
// combinations there are: how many labels says how wide voxels are.
bool find_overlaps(Job &job, const Run &run) {
  uint32_t most = 0;
  for (size_t i = 0; i < job.stack.count; i++)
    most = std::max(most, segment_of(job, i));
  if (most == 0) return false;
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
    tc_dicom_note(job.desc.note, "where segments overlap, combinations of them have labels of their own (%u)", most - job.overlaps.last);
  if (job.overlaps.full) tc_dicom_note(job.desc.note, "too many combinations: the later segment is kept");
  return most > 255 ? TC_U16 : TC_U8;
}

// Some picture is in colour, and all have samples of at most 8 bits.
bool in_color(const Job &job) {
  bool any = false, narrow = true;
  for (size_t i = 0; i < job.stack.count; i++) {
    const Picture &p = *job.at(i).picture;
    any |= p.palette || p.samples.colour != TC_DICOM_GREY;
    narrow &= p.palette || (p.samples.stored <= 8 && p.samples.allocated == 8 && !p.samples.is_signed);
  }
  return any && narrow;
}

void choose_type(Job &job, const Run &run) {
  tc_volume_desc &d = job.desc;
  const Scale &scale = job.at(0).scale;
  for (size_t i = 0; i < job.stack.count; i++)
    job.rescale |= job.at(i).scale != scale;
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

void describe(Job &job, const Run &run) {
  tc_volume_desc &d = job.desc;
  const Picture &p = job.first();
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
  if (p.samples.colour != TC_DICOM_GREY || p.palette) tc_dicom_note(d.note, "colour became luma%s", job.colors ? ", but in slices" : "");
  if (p.inverted) tc_dicom_note(d.note, "MONOCHROME1, values kept as they are");
  if (p.cine) tc_dicom_note(d.note, "a film over time, its first picture was taken");
  if (p.mosaic) tc_dicom_note(d.note, "a mosaic, cut into its slices");
  if (p.fractional) tc_dicom_note(d.note, "fractional segments are cut at half");
  if (p.lookup) tc_dicom_note(d.note, "modality lookup table not applied");
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

void put_labels(const Job &job, const std::vector<uint16_t> &labels, uint8_t *layer) {
  if (job.desc.type == TC_U8)
    std::copy(labels.begin(), labels.end(), layer);
  else
    memcpy(layer, labels.data(), labels.size() * sizeof labels[0]);
}

// A label map whose background is not 0.
void clear_background(const Job &job, uint32_t background, uint8_t *layer) {
  const size_t count = size_t(job.desc.dims[0]) * size_t(job.desc.dims[1]);
  uint16_t *wide = reinterpret_cast<uint16_t *>(layer);
  if (job.desc.type == TC_U8) std::replace(layer, layer + count, static_cast<uint8_t>(background), uint8_t{0});
  if (job.desc.type == TC_U16) std::replace(wide, wide + count, static_cast<uint16_t>(background), uint16_t{0});
}

// Fills one layer from the items [from, to) of the stack; what no frame writes is empty (segmentations only).
void make_layer(Job &job, Decoder &decoder, size_t from, size_t to, uint8_t *layer) {
  if (job.labels) {
    std::vector<uint16_t> labels;
    stamp_layer(job, decoder, from, to, labels);
    put_labels(job, labels, layer);
    return;
  }
  memset(layer, 0, layer_bytes(job));
  for (size_t item = from; item < to; item++) {
    const Member &m = job.at(item);
    tc_dicom_target target{};
    target.type = job.desc.type;
    target.rescale = job.rescale;
    target.slope = m.scale.slope;
    target.intercept = m.scale.intercept;
    Frame f = decoder.frame(*m.picture, m.frame);
    if (job.colors) {
      if (!tc_dicom_colors(&f.samples, f.bytes, f.size, layer)) fail(TC_ERROR_FORMAT, "pixel data of a picture is cut");
      continue;
    }
    if (!tc_dicom_convert(&f.samples, f.bytes, f.size, f.first_bit, &target, layer))
      fail(TC_ERROR_FORMAT, "pixel data of slice %u of %d is cut", job.stack.items[item].layer + 1, job.desc.dims[2]);
    if (m.picture->label_map && m.picture->background) clear_background(job, m.picture->background, layer);
  }
}

// One thread's share: a decoder of its own, a layer, and what went wrong.
struct Worker {
  explicit Worker(const Run &run, size_t bytes) : decoder(run.sources), layer(bytes) {}
  Decoder decoder;
  std::vector<uint8_t> layer;
  std::exception_ptr trouble;
  void run(Job &job, size_t from, size_t to) {
    trouble = nullptr;
    try {
      make_layer(job, decoder, from, to, layer.data());
    } catch (...) {
      trouble = std::current_exception();
    }
  }
};

// Compressed slices in files of their own are worth several threads; bytes as they are come faster than they are sent.
size_t count_workers(const Job &job) {
  cpu_set_t cpus;
  if (job.labels || job.first().native || job.first().frames > 1 || sched_getaffinity(0, sizeof cpus, &cpus) != 0) return 1;
  return std::min({size_t(CPU_COUNT(&cpus)), size_t(8), size_t(job.desc.dims[2])});
}

// False where the system gives no thread: the work is done without.
bool start(std::vector<std::thread> &threads, Worker &worker, Job &job, size_t from, size_t to) {
  try {
    threads.emplace_back(&Worker::run, &worker, std::ref(job), from, to);
    return true;
  } catch (const std::system_error &) {
    return false;
  }
}

void put_layer(const Run &run, const std::vector<uint8_t> &layer) {
  GError *error = nullptr;
  if (!tc_order_put(&run.order, layer.data(), layer.size(), &error)) fail_with(error);
}

// Decodes and sends layer after layer, as many at a time as there are workers, in order.
void send_voxels(const Run &run, Job &job) {
  std::vector<std::unique_ptr<Worker>> workers;
  size_t layers = size_t(job.desc.dims[2]), count = count_workers(job), item = 0;
  for (size_t i = 0; i < count; i++)
    workers.emplace_back(new Worker(run, layer_bytes(job)));
  for (size_t z = 0; z < layers; z += count) {
    std::vector<std::thread> threads;
    size_t batch = std::min(count, layers - z);
    for (size_t i = 0; i < batch; i++) {
      size_t from = item;
      while (item < job.stack.count && job.stack.items[item].layer == z + i)
        item++;
      if (count == 1 || !start(threads, *workers[i], job, from, item)) workers[i]->run(job, from, item);
    }
    for (std::thread &t : threads)
      t.join();
    for (size_t i = 0; i < batch; i++) {
      if (workers[i]->trouble) std::rethrow_exception(workers[i]->trouble);
      put_layer(run, workers[i]->layer);
      progress(run, 0.2 + 0.8 * double(z + i + 1) / double(layers));
    }
  }
}

// Layers mixed from the two slices around them: slices come once each, in order.
void send_mixed(const Run &run, Job &job) {
  const size_t bytes = layer_bytes(job), count = size_t(job.desc.dims[0]) * size_t(job.desc.dims[1]) * (job.colors ? 3 : 1);
  Decoder decoder(run.sources);
  std::vector<uint8_t> below(bytes), above(bytes), out(bytes);
  size_t held = 0; // the slice in `below`; the next is in `above`
  make_layer(job, decoder, 0, 1, below.data());
  make_layer(job, decoder, 1, 2, above.data());
  for (int z = 0; z < job.desc.dims[2]; z++) {
    for (; held < job.stack.mix[z].item; held++) {
      below.swap(above);
      make_layer(job, decoder, held + 2, held + 3, above.data());
    }
    tc_dicom_mix_layers(job.desc.type, below.data(), above.data(), job.stack.mix[z].part, count, out.data());
    put_layer(run, out);
    progress(run, 0.2 + 0.8 * double(z + 1) / double(job.desc.dims[2]));
  }
}

void begin(const Run &run, const Job &job) {
  GError *error = nullptr;
  check_size(job, run.order.max_voxel_bytes);
  if (!run.order.begin(run.order.user, &job.desc, &job.from, &error)) fail_with(error);
}

// What labels are.
void send_segments(const Run &run, const Job &job, const Picture &p) {
  GError *error = nullptr;
  if ((job.labels || p.label_map) && !tc_overlaps_send(&job.overlaps, p.segments.data(), p.segments.size(), &run.order, &error))
    fail_with(error);
}

// The grid of the series that contours were drawn on, where it lies beside them; else one of their own planes.
void grid_for(const std::vector<Series> &all, const Picture &p, const tc_dicom_contours &contours, tc_volume_desc &d) {
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

void describe_structures(Job &job, const Picture &p, size_t outside) {
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
  for (int z = 0; z < d.dims[2]; z++) { // which combinations there are says how wide voxels are
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

void load(const Run &run, const std::string &wanted, bool bridge_nothing) {
  std::vector<Series> all = series_of(run);
  const Choice choice = read_choice(wanted);
  const Series &series = choose_series(all, choice.series);
  Job job;
  if (series.frames == 0) return load_structures(run, all, *series.pictures[0], job);
  make_stack(series, choice, bridge_nothing, job);
  if (all.size() > 1 && choice.series.empty()) tc_dicom_note(job.desc.note, "the largest of %zu series", all.size());
  apply_suv(job);
  choose_type(job, run);
  describe(job, run);
  begin(run, job);
  send_segments(run, job, job.first());
  job.stack.mix ? send_mixed(run, job) : send_voxels(run, job);
}

Failure decode(int input, const tc_helper_request &request, const tc_order &order) {
  try {
    Run run(order, request);
    GError *error = nullptr;
    scan(run, input);
    if (run.pictures.empty()) { // PNG or TIFF
      if (!request.list && !tc_stack_read(&run.sources, request.choice, &order, &error)) fail_with(error);
    } else if (request.list)
      list(run);
    else
      load(run, request.choice, request.bridge_nothing);
    return Failure{TC_ERROR_CODE_COUNT, ""};
  } catch (const Failure &f) {
    return f;
  } catch (const std::bad_alloc &) {
    return Failure{TC_ERROR_FORMAT, "the DICOM file announces more data than it can hold, or is too large to decode"};
  } catch (...) { // GDCM's own; its text may quote the file
    return Failure{TC_ERROR_FORMAT, "the DICOM file is damaged"};
  }
}

} // namespace

bool tc_helper_decode(int input, const tc_helper_request *request, const tc_order *order, GError **error) {
  gdcm::Trace::DebugOff();
  gdcm::Trace::WarningOff();
  gdcm::Trace::ErrorOff();
  const Failure failure = decode(input, *request, *order);
  if (!failure.text[0]) return true;
  tc_set_error(error, failure.code, nullptr, "%s", failure.text);
  return false;
}
