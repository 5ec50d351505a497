/* Any bytes as a picture file, PNG or TIFF, through the reader of stacks. */
#include "import_fuzz.h"

#include "renderer/import/helper/stack.h"

static bool read_stack(const tc_input *input, const tc_order *order, GError **error) {
  const tc_dicom_sources sources = {.map = (void *)(uintptr_t)input->bytes, .map_size = input->size, .count = 1};
  if (input->size > 0 && tc_stack_is(&sources)) return tc_stack_read(&sources, "", order, error);
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "no picture");
  return false;
}

static bool probe(const uint8_t *head, size_t size) { return tc_picture_looks(head, size); }

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  static const tc_format stack = {"pictures", "", probe, read_stack};
  return fuzz_format(&stack, "f.tif", bytes, size);
}
