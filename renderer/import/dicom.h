/* DICOM by way of the confined helper process: files, zips and folders of files. */
#ifndef TC_IMPORT_DICOM_H
#define TC_IMPORT_DICOM_H

#include "renderer/import/import.h"

/* True when `path` looks like DICOM at little cost: a folder that holds some DICOM file, a file with the DICM mark or a
 * plausible bare data set, a zip (no other format here is one). Reads a few kilobytes at most. Any thread. */
bool tc_dicom_probe(const char *path);

/* Loads one series found under `path` (a file, a zip or a folder). `series` is the text after '#': a 1-based
 * number as listed, or a UID; NULL takes the series with most slices. `options` may be NULL. Caller owns the
 * reference. Any thread. */
tc_volume *tc_import_dicom(const char *path, const char *series, const tc_import_options *options, GError **error);

/* Lists the series under `path`; *series is g_malloc'ed (g_free), [*count]. */
bool tc_import_dicom_list(const char *path, const tc_import_options *options, tc_series **series, size_t *count,
                          GError **error);

#endif
