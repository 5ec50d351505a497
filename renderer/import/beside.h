/* Data files that a header names: which names are allowed, and their opening by the daemon. */
#ifndef TC_IMPORT_BESIDE_H
#define TC_IMPORT_BESIDE_H

#include <stdbool.h>

#include "renderer/base/error.h"

/* Opens a regular file in the folder for reading. The name is relative and without ".."; only a symbolic link into a link root
 * (links.h) may lead outside the folder. Returns -1 with an error that quotes the name. */
int tc_beside_open(int folder_fd, const char *name, GError **error);

#endif
