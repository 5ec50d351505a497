/* The confined helper programs: every format is decoded by one of them and never in the daemon. */
#ifndef TC_IMPORT_HELPER_H
#define TC_IMPORT_HELPER_H

#include "renderer/import/import.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum tc_helper { TC_HELPER_FORMATS, TC_HELPER_DICOM, TC_HELPER_MINC, TC_HELPER_COUNT } tc_helper;

/* Loads `path` (a file, for DICOM also a zip or a folder). `choice` is the text after '#', or NULL: for DICOM a 1-based number
 * as listed, or a UID; without one the series with most slices is taken. `options` may be NULL. Caller owns the
 * reference. Any thread. */
tc_volume *tc_helper_load(tc_helper helper, const char *path, const char *choice, const tc_import_options *options,
                          GError **error);

/* Loads the mesh `path`; the caller frees it. `choice` as a volume's: a mesh has none. */
tc_mesh *tc_helper_load_mesh(const char *path, const char *choice, const tc_import_options *options,
                             tc_mesh_file *source, GError **error);

/* Lists the DICOM series under `path`; *series is g_malloc'ed (g_free), [*count]. */
bool tc_helper_list(const char *path, const tc_import_options *options, tc_series **series, size_t *count,
                    GError **error);

/* True when the first bytes of a file could be DICOM: the mark at 128, or a bare data set that begins plausibly. 132
 * bytes are enough to decide. */
enum { TC_DICOM_HEAD_BYTES_NEEDED = 132 };
bool tc_dicom_looks(const uint8_t *head, size_t size);

/* PNG or TIFF. */
bool tc_picture_looks(const uint8_t *head, size_t size);

bool tc_hdf5_looks(const uint8_t *head, size_t size);

/* By content: DICOM, pictures and any zip are for the helper with GDCM, HDF5 for its own. */
tc_helper tc_helper_of(const uint8_t *head, size_t size); /* its first bytes */
tc_helper tc_helper_for(const char *path);

#ifdef __cplusplus
}
#endif
#endif
