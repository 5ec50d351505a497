#include "renderer/import/helper/zipped.h"

#include <string.h>

#include "renderer/import/helper/format.h"

typedef struct zipped {
  const tc_dicom_sources *sources;
  size_t header;
} zipped;

/* Opens a member without a check of its content: the data file of a pair may begin with any bytes. */
static bool get(const tc_dicom_sources *sources, size_t index, tc_input *input, GError **error) {
  static const tc_dicom_source_kind kinds[] = {TC_SOURCE_OTHER, TC_SOURCE_DICOM, TC_SOURCE_PICTURE, TC_SOURCE_HDF5};
  tc_dicom_blob blob = {0};
  GError *trouble = NULL;
  bool ok = false;
  for (size_t k = 0; !ok && !trouble && k < G_N_ELEMENTS(kinds); k++)
    ok = tc_dicom_sources_get_kind(sources, index, kinds[k], &blob, &trouble);
  if (trouble) g_propagate_error(error, trouble);
  if (!ok) return false;
  const char *name = tc_dicom_sources_name(sources, index), *slash = strrchr(name, '/');
  tc_input_memory(input, blob.bytes, blob.size, slash ? slash + 1 : name);
  input->owned = blob.heap;
  return true;
}

/* Finds a member by its name in the header's folder. Of two members the other one matches any name, since the page
 * does not send file names. */
static bool get_member(void *user, const char *name, tc_input *member, GError **error) {
  const zipped *z = user;
  const char *header = tc_dicom_sources_name(z->sources, z->header), *slash = strrchr(header, '/');
  const size_t folder = slash ? (size_t)(slash + 1 - header) : 0;
  for (size_t i = 0; i < z->sources->count; i++) {
    const char *other = tc_dicom_sources_name(z->sources, i);
    if (strncmp(other, header, folder) == 0 && strcmp(other + folder, name) == 0)
      return get(z->sources, i, member, error);
  }
  return z->sources->count == 2 && get(z->sources, 1 - z->header, member, error);
}

/* Number of members that are volumes, and the first of them. */
static size_t count_volumes(const tc_dicom_sources *sources, size_t *first) {
  uint8_t head[TC_PROBE_BYTES];
  size_t count = 0;
  for (size_t i = 0; sources->is_zip && i < sources->count; i++) {
    tc_input input;
    size_t size;
    if (!sources->zip.members[i].usable) continue;
    if (!tc_dicom_zip_read(&sources->zip, i, head, sizeof head, &size, NULL)) continue;
    tc_input_memory(&input, head, size, "");
    if (tc_formats_know(&input) && count++ == 0) *first = i;
    tc_input_close(&input);
  }
  return count;
}

static bool has_hdf5(const tc_dicom_sources *sources) {
  for (size_t i = 0; sources->is_zip && i < sources->count; i++)
    if (tc_dicom_sources_kind(sources, i) == TC_SOURCE_HDF5) return true;
  return false;
}

bool tc_zipped_is(const tc_dicom_sources *sources) {
  size_t first;
  return count_volumes(sources, &first) > 0 || has_hdf5(sources);
}

bool tc_zipped_read(const tc_dicom_sources *sources, const char *choice, const tc_order *order, GError **error) {
  size_t first = 0;
  const size_t count = count_volumes(sources, &first);
  if (count == 0 && has_hdf5(sources)) return tc_order_elsewhere(TC_HELPER_MINC, error);
  if (count != 1) {
    tc_set_error(error, TC_ERROR_UNSUPPORTED, NULL, "the zip holds %zu volumes: open them one by one", count);
    return false;
  }
  tc_input input;
  zipped z = {sources, first};
  if (!get(sources, first, &input, error)) return false;
  input.member = get_member;
  input.open_user = &z;
  const bool ok = tc_formats_read(&input, choice, order, error);
  tc_input_close(&input);
  return ok;
}
