/* Folders outside the data folder that its symbolic links may point into, since git-annex and DataLad keep files elsewhere.
 * Links in uploads are never followed. */
#ifndef TC_IMPORT_LINKS_H
#define TC_IMPORT_LINKS_H

#include "renderer/import/import.h"

enum { TC_LINK_ROOTS = 8 };

/* Sets the folders, at most TC_LINK_ROOTS. Called once, before the first import; the default is none. TC_ERROR_INVALID names a
 * path that is not a folder. */
bool tc_links_set(const char *const *folders, size_t n, GError **error);
size_t tc_links_count(void);
const char *tc_links_root(size_t i); /* its real path */

#endif
