/* Paths that clients name: confined to the data folder. */
#ifndef TCS_CATALOGUE_BENEATH_H
#define TCS_CATALOGUE_BENEATH_H

#include <cjson/cJSON.h>
#include <stdbool.h>

#include "renderer/base/error.h"

/* The canonical path of `relative` inside `folder` (g_malloc'ed), without leaving it by "..", an absolute path or a
 * link but to a link root (import/links.h). A "#..." that chooses a DICOM series is kept. TC_ERROR_NOT_FOUND or
 * TC_ERROR_INVALID (pointer "/path"). */
char *tcs_beneath(const char *folder, const char *relative, GError **error);

/* Volume files (or mesh files) beneath `folder`, at most `limit`: [{"path","bytes"}], sorted; a folder of DICOM files
 * is one entry. Reads directories: not for the I/O thread. `folder` may be NULL: an empty list. */
cJSON *tcs_available(const char *folder, bool meshes, int limit);

#endif
