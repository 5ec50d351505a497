/* What a hostile DICOM helper could say to its parent, and the zip reader. The first byte chooses: 0 a load, 1 a
 * listing, anything else a zip. */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/import/wire.h"
#include "renderer/import/helper/dicom_zip.h"
#include "tests/fuzz/memory.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

enum { MOST_VOXEL_BYTES = 1 << 20, MOST_MEMBER_BYTES = 1 << 16 };

static void check_error(GError *error) {
  if (!error || strchr(error->message, '\n')) abort();
  g_error_free(error);
}

static int no_file(void *user, const char *name, bool optional, GError **error) {
  if (strlen(name) >= TC_WIRE_NAME) abort();
  return -1;
}

static void fuzz_load(memory *m) {
  static const uint8_t ring[TC_WIRE_RING_BYTES];
  tc_wire_reader reader = {.read = read_memory, .user = m, .reply = no_reply, .open = no_file, .ring = ring,
                           .max_voxel_bytes = MOST_VOXEL_BYTES};
  GError *error = NULL;
  tc_volume *v = tc_wire_load(&reader, &error);
  if (!v)
    check_error(error);
  else if (tc_volume_bytes(v) > MOST_VOXEL_BYTES || error)
    abort();
  if (v) tc_volume_seal(v);
  tc_volume_unref(v);
}

static void fuzz_list(memory *m) {
  tc_wire_reader reader = {.read = read_memory, .user = m};
  GError *error = NULL;
  tc_series *series = NULL;
  size_t count = 0;
  if (!tc_wire_list(&reader, &series, &count, &error)) check_error(error);
  for (size_t i = 0; i < count; i++)
    if (strlen(series[i].uid) >= sizeof series[i].uid || series[i].files < 0) abort();
  g_free(series);
}

static void fuzz_zip(memory *m) {
  tc_dicom_zip zip;
  GError *error = NULL;
  uint8_t *out = malloc(MOST_MEMBER_BYTES);
  if (!tc_dicom_zip_open(&zip, m->bytes, m->size, &error)) {
    check_error(error);
    free(out);
    return;
  }
  for (size_t i = 0; i < zip.count && i < 16; i++) {
    size_t got;
    error = NULL;
    if (!tc_dicom_zip_read(&zip, i, out, MOST_MEMBER_BYTES, &got, &error))
      check_error(error);
    else if (got > MOST_MEMBER_BYTES)
      abort();
  }
  tc_dicom_zip_finish(&zip);
  free(out);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  if (size < 1) return 0;
  memory m = {data + 1, size - 1};
  if (data[0] == 0)
    fuzz_load(&m);
  else if (data[0] == 1)
    fuzz_list(&m);
  else
    fuzz_zip(&m);
  return 0;
}
