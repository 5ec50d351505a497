/* Data files named by a header: a printf-like pattern with a range, shared by NRRD and MetaImage. */
#ifndef TC_IMPORT_NAMES_H
#define TC_IMPORT_NAMES_H

#include <stdbool.h>
#include <stdint.h>

#include "renderer/base/error.h"

/* Largest number of data files that a header may name. */
#define TC_MAX_DATA_FILES 65536

/* "slice%03d.raw 1 20 1": fills `names` (of g_free'd strings) with slice001.raw ... slice020.raw. The pattern holds
 * one %d, optionally with a width of at most 99 and a leading 0, and no other directive (%% is a percent sign).
 * *rest, if not NULL, receives the number after the range, or -1. TC_ERROR_FORMAT describes the fault. */
bool tc_names_from_pattern(const char *text, GPtrArray *names, int64_t *rest, GError **error);

#endif
