/* Files beside an input: what a header may name, and who opens it. */
#ifndef TC_IMPORT_BESIDE_H
#define TC_IMPORT_BESIDE_H

#include <stdbool.h>

#include "renderer/base/error.h"

/* Opens a regular file in the folder, for reading: a relative name without "..", never outside the folder but by
 * a link to a link root (links.h). -1 with an error that quotes the name. */
int tc_beside_open(int folder_fd, const char *name, GError **error);

#endif
