/* Any bytes as a voxel model: a sound one, whose every voxel can be read and which is written as it was, or one error.
 */
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "renderer/splat/vmd.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static void walk(const tc_vmd *m) {
  uint64_t voxels = 0;
  for (int y = 0; y < m->size[1]; y++)
    for (int x = 0; x < m->size[0]; x++) {
      tc_vmd_run run = {.at = tc_vmd_column(m, m->first[0] + x, m->first[1] + y)};
      while (tc_vmd_next(m, &run)) {
        if (run.z < 0 || run.count < 1 || run.z + run.count > m->head.grid.dims[2]) abort();
        for (int i = 0; i < m->head.n_attributes; i++)
          tc_vmd_number(&m->head.attributes[i], run.records + (size_t)(run.count - 1) * run.step);
        voxels += (uint64_t)run.count;
      }
    }
  if (voxels != m->voxels) abort();
}

static void write_again(const tc_vmd *m, bool compressed) {
  GByteArray *file = tc_vmd_encode(m, compressed, NULL);
  tc_vmd *back = file ? tc_vmd_decode(file->data, file->len, NULL) : NULL;
  if (!back || memcmp(back->bytes, m->bytes, tc_vmd_start(m, m->columns)) != 0) abort();
  tc_vmd_free(back);
  g_byte_array_unref(file);
}

/* The checksum would keep a fuzzer out: it is made right. */
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  GError *error = NULL;
  uint8_t *signed_bytes = malloc(size + 1);
  memcpy(signed_bytes, bytes, size);
  if (size > 4) {
    uint32_t sum = (uint32_t)crc32_z(0, bytes, size - 4);
    memcpy(signed_bytes + size - 4, &sum, 4);
  }
  tc_vmd *m = tc_vmd_decode(signed_bytes, size, &error);
  if (m) {
    walk(m);
    write_again(m, false);
    write_again(m, true);
  } else if (!error || error->domain != TC_ERROR || strpbrk(error->message, "\r\n")) {
    abort();
  }
  g_clear_error(&error);
  tc_vmd_free(m);
  free(signed_bytes);
  return 0;
}
