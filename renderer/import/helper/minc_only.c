/* The helper program for MINC alone, also compressed or zipped: libhdf5 and its libraries take longer to load than
 * most files to read. */
#include "renderer/import/helper/dicom_sources.h"
#include "renderer/import/helper/format.h"

/* Finds the HDF5 file; a single input file counts without a check. */
static bool find_file(const tc_dicom_sources *sources, tc_dicom_blob *blob, GError **error) {
  size_t found = 0;
  for (size_t i = 0; i < sources->count; i++)
    if (tc_dicom_sources_kind(sources, i) == TC_SOURCE_HDF5 && found++ == 0 &&
        !tc_dicom_sources_get_kind(sources, i, TC_SOURCE_HDF5, blob, error))
      return false;
  if (found == 1) return true;
  tc_set_error(error, TC_ERROR_UNSUPPORTED, NULL, "%zu files of HDF5 are in it: open them one by one", found);
  return false;
}

bool tc_helper_decode(int fd, const tc_helper_request *request, const tc_order *order, GError **error) {
  tc_dicom_sources sources;
  tc_dicom_blob blob = {0};
  tc_input input = {.fd = -1};
  tc_order own = *order;
  bool ok = tc_choice_volume(request->choice, tc_format_minc.name, &own.volume, error) &&
            tc_dicom_sources_open(&sources, fd, error) && find_file(&sources, &blob, error);
  if (ok) tc_input_memory(&input, blob.bytes, blob.size, request->name);
  ok = ok && tc_format_minc.read(&input, &own, error);
  tc_input_close(&input);
  return ok;
}
