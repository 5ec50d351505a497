/* Any bytes through the importer of the format. */
#include "import_fuzz.h"

/* libhdf5 leaks what it has of a damaged file; a helper reads one file and ends. */
int __lsan_is_turned_off(void);
int __lsan_is_turned_off(void) { return 1; }

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  return fuzz_format(&tc_format_minc, "f.mnc", bytes, size);
}
