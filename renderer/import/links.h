/* Where links of the operator's folders may lead outside of them: git-annex and DataLad keep files elsewhere. Links of
 * uploads lead nowhere. */
#ifndef TC_IMPORT_LINKS_H
#define TC_IMPORT_LINKS_H

#include "renderer/import/import.h"

enum { TC_LINK_ROOTS = 8 };

/* Sets these folders, at most TC_LINK_ROOTS of them. Once, before anything is imported; there are none until then.
 * TC_ERROR_INVALID names one that is no folder. */
bool tc_links_set(const char *const *folders, size_t n, GError **error);
size_t tc_links_count(void);
const char *tc_links_root(size_t i); /* its real path */

#endif
