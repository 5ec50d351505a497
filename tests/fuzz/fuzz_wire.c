/* What a hostile helper could say instead of a run-length model. The input: u16 bytes that lie in the ring, those bytes
 * (a .vmd whose checksum is made right), then messages. A model that is taken is read as a frame reads it. */
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "renderer/import/wire.h"
#include "renderer/splat/splats.h"
#include "tests/fuzz/memory.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

enum { MOST_BYTES = 1 << 20, MOST_VOXELS = 1 << 16 };

static int no_file(void *user, const char *name, bool optional, GError **error) { return -1; }

static void count_voxel(void *user, double voxel) { ++*(uint64_t *)user; }

static void use(const tc_volume *volume) {
  const tc_vmd *vmd = tc_volume_model(volume);
  uint64_t counted = 0;
  if (!vmd || vmd->voxels > MOST_VOXELS) return;
  tc_volume_sparse(volume)->each(vmd, count_voxel, &counted);
  if (counted != vmd->voxels) abort();
  const int *dims = vmd->head.grid.dims;
  if ((int64_t)dims[0] * dims[1] * dims[2] <= MOST_VOXELS)
    tc_splats_free(tc_splats_build(vmd, (tc_splat_normals){0}, true, NULL, NULL));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  static uint8_t ring[TC_WIRE_RING_BYTES];
  const size_t model = size < 2 ? 0 : (size_t)data[0] | (size_t)data[1] << 8;
  if (size < 2 || model > size - 2) return 0;
  memset(ring, 0, 1 << 16);
  memcpy(ring, data + 2, model);
  const uint32_t sum = model < 4 ? 0 : (uint32_t)crc32_z(0, ring, model - 4);
  if (model >= 4) memcpy(ring + model - 4, &sum, 4);
  memory m = {data + 2 + model, size - 2 - model};
  const tc_wire_reader reader = {
      .read = read_memory, .user = &m, .reply = no_reply, .open = no_file, .ring = ring, .max_voxel_bytes = MOST_BYTES};
  GError *error = NULL;
  tc_volume *volume = tc_wire_load(&reader, &error);
  if (!volume == !error || (error && strpbrk(error->message, "\r\n"))) abort();
  if (volume) use(volume);
  g_clear_error(&error);
  tc_volume_unref(volume);
  return 0;
}
