/* Paths from clients, confined to the data folder. */
#ifndef TCS_CATALOGUE_BENEATH_H
#define TCS_CATALOGUE_BENEATH_H

#include <cjson/cJSON.h>
#include <stdbool.h>

#include "renderer/base/error.h"

/* The canonical path of `relative` inside `folder` (g_malloc'ed). Refuses ".." out of the folder, absolute paths, and
 * links out of it unless they lead to a link root (import/links.h). Keeps a "#..." that selects a DICOM series.
 * TC_ERROR_NOT_FOUND or TC_ERROR_INVALID (pointer "/path"). */
char *tcs_beneath(const char *folder, const char *relative, GError **error);

/* Lists the volume files (or mesh files) beneath `folder`, at most `limit`: [{"path","bytes"}], sorted; a folder of
 * DICOM files is one entry. Reads directories, so not for the I/O thread. folder NULL: an empty list. */
cJSON *tcs_available(const char *folder, bool meshes, int limit);

#endif
