/* Any bytes through the importer of the format. */
#include "import_fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  return fuzz_format(&tc_format_minc, "f.mnc", bytes, size);
}
