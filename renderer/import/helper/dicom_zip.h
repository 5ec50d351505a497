/* Members of a zip in memory, through libzip: stored and deflated ones; nothing is written to disk. Members are read
 * by number; a name is never used as a path. Encrypted members, folders, other compression methods and sizes that
 * deflate cannot reach are marked and cannot be read. The bytes must outlive the reader. */
#ifndef TC_IMPORT_DICOM_ZIP_H
#define TC_IMPORT_DICOM_ZIP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/base/error.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { TC_DICOM_ZIP_MEMBERS_MAX = 200000 };

typedef struct tc_dicom_zip_member {
  uint64_t size; /* uncompressed bytes; checked against deflate's largest ratio, 1032 times the packed bytes */
  bool usable;   /* a plain, unencrypted file of a known method */
} tc_dicom_zip_member;

typedef struct tc_dicom_zip {
  struct zip *archive;
  tc_dicom_zip_member *members; /* [count], owned */
  size_t count;
} tc_dicom_zip;

/* Reads the directory. TC_ERROR_FORMAT if it is missing or contradicts the file, TC_ERROR_LIMIT if there are too many
 * members. */
bool tc_dicom_zip_open(tc_dicom_zip *zip, const void *bytes, size_t size, GError **error);
void tc_dicom_zip_finish(tc_dicom_zip *zip); /* accepts a zeroed zip */

/* The name as stored in the zip, or "". */
const char *tc_dicom_zip_name(const tc_dicom_zip *zip, size_t member);

/* Reads the first `want` bytes of a member into out [want]; want >= member size reads all and checks the checksum.
 * *got receives the number of bytes read. */
bool tc_dicom_zip_read(const tc_dicom_zip *zip, size_t member, uint8_t *out, size_t want, size_t *got, GError **error);

/* True if bytes [size] are one complete raw deflate stream; false for a truncated deflated DICOM file. */
bool tc_dicom_deflate_is_whole(const uint8_t *bytes, size_t size);

#ifdef __cplusplus
}
#endif
#endif
