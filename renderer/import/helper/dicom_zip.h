/* A zip's members in memory, through libzip: stored and deflated ones, nothing on disk.
 *
 * Members are reached by their number; a name is never used as a path. Encrypted members, folders, other methods and
 * sizes that deflate cannot reach are marked and cannot be read. The bytes must outlive the reader. */
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
  uint64_t size; /* bytes when read; at most 1032 times the packed bytes plus a little, which is what deflate can do */
  bool usable;   /* a plain, unencrypted file of a known method */
} tc_dicom_zip_member;

typedef struct tc_dicom_zip {
  struct zip *archive;
  tc_dicom_zip_member *members; /* [count], owned */
  size_t count;
} tc_dicom_zip;

/* Reads the directory. TC_ERROR_FORMAT when there is none or it contradicts the file, TC_ERROR_LIMIT for too many. */
bool tc_dicom_zip_open(tc_dicom_zip *zip, const void *bytes, size_t size, GError **error);
void tc_dicom_zip_finish(tc_dicom_zip *zip); /* a zeroed one is fine */

/* As it is in the zip, or "". */
const char *tc_dicom_zip_name(const tc_dicom_zip *zip, size_t member);

/* Reads the first `want` bytes of a member (all: want >= member size, then the checksum is checked too) into out
 * [want]. *got tells how many came. */
bool tc_dicom_zip_read(const tc_dicom_zip *zip, size_t member, uint8_t *out, size_t want, size_t *got, GError **error);

/* True when bytes [size] are one whole raw deflate stream: a deflated DICOM file that was cut is not. */
bool tc_dicom_deflate_is_whole(const uint8_t *bytes, size_t size);

#ifdef __cplusplus
}
#endif
#endif
