/* Any bytes through a reader of meshes, which the first byte chooses: a sound mesh or one clear error. */
#include <stdlib.h>

#include "tests/support/read_mesh_here.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  static const tc_format *const readers[] = {&tc_format_obj, &tc_format_ply, &tc_format_stl};
  GError *error = NULL;
  if (!size) return 0;
  const tc_format *format = readers[bytes[0] % 3];
  format->probe(bytes + 1, size - 1);
  tc_mesh *m = read_mesh_here(bytes + 1, size - 1, "f", format->read, 8 << 20, 0, NULL, &error);
  if (!m == !error || (error && (error->domain != TC_ERROR || strpbrk(error->message, "\r\n")))) abort();
  g_clear_error(&error);
  tc_mesh_free(m);
  return 0;
}
