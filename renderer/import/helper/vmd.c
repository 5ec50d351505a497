/* Run-length voxel models (splat/VMD.md): the helper checks and decompresses them, the daemon keeps runs in memory. */
#include <string.h>

#include "renderer/import/helper/format.h"
#include "renderer/splat/vmd.h"

static bool probe_vmd(const uint8_t *head, size_t size) { return size >= 4 && memcmp(head, "TVMD", 4) == 0; }

static GByteArray *unpack(const tc_input *input, GError **error) {
  uint8_t *bytes = g_try_malloc(input->size + 1);
  tc_vmd *vmd = NULL;
  if (!bytes)
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "voxel model: no memory for %" G_GUINT64_FORMAT " bytes", input->size);
  else if (tc_input_read(input, 0, bytes, input->size, error))
    vmd = tc_vmd_decode(bytes, input->size, error);
  g_free(bytes);
  GByteArray *plain = vmd ? tc_vmd_encode(vmd, false, error) : NULL;
  tc_vmd_free(vmd);
  return plain;
}

static bool read_vmd(const tc_input *input, const tc_order *order, GError **error) {
  if (input->packing != TC_ENCODING_RAW) {
    tc_set_error(error, TC_ERROR_UNSUPPORTED, NULL,
                 "a packed .vmd: unpack it first (convert --gzip packs what is in it, which is smaller)");
    return false;
  }
  GByteArray *plain = unpack(input, error);
  if (!plain) return false;
  const bool good =
      order->begin_model(order->user, plain->len, error) && tc_order_put(order, plain->data, plain->len, error);
  g_byte_array_unref(plain);
  return good;
}

const tc_format tc_format_vmd = {"VMD", ".vmd", probe_vmd, read_vmd};
