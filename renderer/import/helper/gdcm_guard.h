// What keeps GDCM within bounds: failed assertions that end a call and not the process, allocations no larger than a
// file can justify, and bytes in memory as the stream it reads. Errors travel as exceptions of one kind, Failure.
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
  int code; // tc_error_code, or what names another helper
  char text[256];
};

[[noreturn]] void fail(tc_error_code code, const char *format, ...) __attribute__((format(printf, 2, 3)));
[[noreturn]] void fail_with(GError *error); // takes the error

// Runs a piece of GDCM; false when it says so itself or an assertion of its fails.
bool guarded(const std::function<bool()> &call);

// The largest single allocation of this thread's `new`, in bytes; SIZE_MAX: no bound.
void set_allocation_cap(size_t bytes);
size_t allocation_cap();
// As many bytes as `size` bytes of a file justify where decoding makes up to `factor` of each.
size_t justified_allocation(size_t size, uint64_t factor);

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

} // namespace dicom
#endif
