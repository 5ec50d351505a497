#include "renderer/import/helper/gdcm_guard.h"

#include <unistd.h>

#include <algorithm>
#include <csetjmp>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>

// GDCM allocates the length that an element announces before it reads a byte of it. A single allocation is therefore
// limited by the bytes of the file; the cap is set for each file. Codecs in C use malloc and the process limit.
static thread_local size_t cap = SIZE_MAX;

[[gnu::noinline]] void *operator new(size_t size) {
  void *memory = size > cap ? nullptr : malloc(size ? size : 1);
  if (!memory) throw std::bad_alloc();
  return memory;
}
[[gnu::noinline]] void *operator new(size_t size, const std::nothrow_t &) noexcept { return malloc(size ? size : 1); }
[[gnu::noinline]] void operator delete(void *memory) noexcept { free(memory); }
[[gnu::noinline]] void operator delete(void *memory, size_t) noexcept { free(memory); }

#if defined(__SANITIZE_ADDRESS__)
extern "C" const char *__asan_default_options() { return "detect_leaks=0:allocator_may_return_null=1"; }
#endif

// Debian builds GDCM with assertions, and damaged files trigger them. One bad file of a folder must not end the run,
// so an assertion jumps out of GDCM by longjmp (an exception cannot pass, because its callers are compiled as if the
// call never returned). GDCM's memory is leaked, within the process limits. Assertions are handled only inside
// guarded().
static thread_local jmp_buf assertion_exit;
static thread_local bool assertion_armed = false;

extern "C" void __assert_fail(const char *, const char *, unsigned, const char *) noexcept {
  if (assertion_armed) longjmp(assertion_exit, 1);
  _exit(1);
}

namespace dicom {

[[noreturn]] void fail(tc_error_code code, const char *format, ...) {
  Failure f{code, ""};
  va_list args;
  va_start(args, format);
  vsnprintf(f.text, sizeof f.text, format, args);
  va_end(args);
  throw f;
}

[[noreturn]] void fail_with(GError *error) {
  Failure f{error->code, ""};
  snprintf(f.text, sizeof f.text, "%s", error->message);
  g_error_free(error);
  throw f;
}

namespace {
struct Disarm {
  ~Disarm() { assertion_armed = false; }
};
} // namespace

bool guarded(const std::function<bool()> &call) {
  Disarm disarm;
  if (setjmp(assertion_exit) != 0) return false;
  assertion_armed = true;
  return call();
}

void set_allocation_cap(size_t bytes) { cap = bytes; }
size_t allocation_cap() { return cap; }

size_t justified_allocation(size_t size, uint64_t factor) {
  return std::max<uint64_t>(MiB, size > SIZE_MAX / (2 * factor) ? SIZE_MAX : 2 * factor * size + MiB);
}

} // namespace dicom
