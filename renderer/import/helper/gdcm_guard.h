// Keeps GDCM within bounds: failed assertions end a call instead of the process, allocations are limited by the
// file's size, and memory is read through a stream. Errors are exceptions of one type, Failure.
#ifndef TC_GDCM_GUARD_H
#define TC_GDCM_GUARD_H

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <functional>
#include <streambuf>

#include <glib.h>

#include "renderer/base/error.h"

namespace dicom {

constexpr size_t MiB = 1024 * 1024;

struct Failure {
  int code; // a tc_error_code, or TC_WIRE_ELSEWHERE plus a tc_helper
  char text[256];
};

[[noreturn]] void fail(tc_error_code code, const char *format, ...) __attribute__((format(printf, 2, 3)));
[[noreturn]] void fail_with(GError *error); // takes ownership of the error

// Runs a call into GDCM; false if it fails or one of its assertions does.
bool guarded(const std::function<bool()> &call);

// Limits single allocations by this thread's `new`, in bytes; SIZE_MAX: no limit.
void set_allocation_cap(size_t bytes);
size_t allocation_cap();
// Largest allocation that `size` bytes of a file justify if decoding expands each up to `factor` times.
size_t justified_allocation(size_t size, uint64_t factor);

// A seekable stream over bytes in memory for GDCM. It records whether a read was cut by the end, which GDCM ignores.
struct MemoryBuffer : std::streambuf {
  bool cut = false;
  std::streamsize xsgetn(char *out, std::streamsize wanted) override {
    std::streamsize n = std::min<std::streamsize>(wanted, egptr() - gptr());
    if (n > 0) memcpy(out, gptr(), static_cast<size_t>(n));
    setg(eback(), gptr() + n, egptr());
    if (n < wanted && wanted >= 16) cut = true; // shorter reads probe for another element
    return n;
  }
  MemoryBuffer(const uint8_t *bytes, size_t size) {
    char *start = reinterpret_cast<char *>(const_cast<uint8_t *>(bytes)); // read-only: there is no put area
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

} // namespace dicom
#endif
