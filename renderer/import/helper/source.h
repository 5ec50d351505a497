/* Input bytes: an input is an open file or memory; a source is the stream of decoded voxel bytes of an image,
 * whatever files and encodings they are spread over.
 *
 * Memory stays small: a source holds one buffer of encoded bytes and decodes straight into the caller's memory. The
 * daemon opens data files that a header names, only in that header's folder. */
#ifndef TC_IMPORT_SOURCE_H
#define TC_IMPORT_SOURCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/base/error.h"

/* Element types of files. */
typedef enum tc_element {
  TC_ELEMENT_I8, TC_ELEMENT_U8, TC_ELEMENT_I16, TC_ELEMENT_U16, TC_ELEMENT_I32, TC_ELEMENT_U32, TC_ELEMENT_I64,
  TC_ELEMENT_U64, TC_ELEMENT_F32, TC_ELEMENT_F64, TC_ELEMENT_COUNT
} tc_element;

size_t tc_element_size(tc_element element);      /* bytes */
const char *tc_element_name(tc_element element); /* "i8" "u8" ... "f64" */

typedef enum tc_encoding {
  TC_ENCODING_RAW,
  TC_ENCODING_DEFLATE, /* gzip (any number of members) or zlib, told apart by content */
  TC_ENCODING_BZIP2,
  TC_ENCODING_TEXT,    /* decimal numbers, converted to elements in this machine's byte order */
  TC_ENCODING_HEX,
  TC_ENCODING_COUNT
} tc_encoding;

/* ---- inputs: random access ---- */

/* Opens a file next to the input: tc_order's open. */
typedef int (*tc_open_fn)(void *user, const char *name, bool optional, GError **error);

struct tc_input;
/* Opens a file next to an input in memory: false if there is none of that name. */
typedef bool (*tc_member_fn)(void *user, const char *name, struct tc_input *member, GError **error);

typedef struct tc_input {
  int fd;               /* an open regular file, or -1: the input is `bytes` */
  const uint8_t *bytes; /* [size], not owned */
  uint64_t size;
  tc_encoding packing; /* of the file as a whole: raw, deflate (gzip) or bzip2 */
  tc_open_fn open; /* both NULL: the input may name no other file */
  tc_member_fn member;
  void *open_user;
  void *owned; /* bytes that tc_input_close() frees */
  char *name; /* base name */
} tc_input;

/* Takes ownership of an open regular file. TC_ERROR_FORMAT for anything else; *input is closed then. */
bool tc_input_adopt(tc_input *input, int fd, const char *name, GError **error);

/* Uses bytes in memory, which the caller keeps, for example a fuzzer's. */
void tc_input_memory(tc_input *input, const void *bytes, size_t size, const char *name);

/* False (TC_ERROR_FORMAT) if the input may name no other file. Parsers call it when a header contains a file name. */
bool tc_input_may_name(const tc_input *input, GError **error);

/* Opens a file next to the input. False without an error if an optional file is missing. */
bool tc_input_open_sibling(const tc_input *input, const char *name, bool optional, tc_input *sibling, GError **error);

void tc_input_close(tc_input *input); /* accepts a zeroed or closed input */

/* Reads exactly n bytes from an offset. */
bool tc_input_read(const tc_input *input, uint64_t offset, void *to, size_t n, GError **error);

/* Reads up to n bytes from the start, unpacked; *got receives the number. Fails only if reading fails: damaged
 * compressed bytes just end the head. */
bool tc_input_head(const tc_input *input, void *to, size_t n, size_t *got, GError **error);

/* First bytes of a file with a text header: up to 4 MiB, or 256 KiB of a packed file. Caller frees. */
uint8_t *tc_input_header(const tc_input *input, size_t *size, GError **error);

/* ---- sources: one stream of decoded bytes ---- */

/* Text is for small files, since it is read whole. */
#define TC_TEXT_LIMIT (16u << 20)

/* Called every few hundred KiB of decoded data: false, with an error, ends the decoding. */
typedef bool (*tc_watch_fn)(void *user, GError **error);

/* Describes the data of an image. Parts follow each other in the stream. */
typedef struct tc_data {
  const tc_input *input; /* the header's file */
  GPtrArray *names;      /* char *: one data file per part beside the input; NULL: one part, in the input itself */
  uint64_t part_bytes;   /* expected decoded bytes of each part */
  uint64_t offset;       /* where the encoded bytes start in each file */
  uint64_t line_skip;    /* text lines to skip after that */
  int64_t byte_skip;     /* decoded bytes to skip after that; -1: the data are the last part_bytes of the stream */
  tc_encoding encoding;
  tc_element element;    /* for TC_ENCODING_TEXT */
  tc_watch_fn watch;     /* NULL: none */
  void *watch_user;
} tc_data;

/* Sets the data to follow the header in the input, from byte `at` of its unpacked content. Set the encoding and skips
 * first. TC_ERROR_UNSUPPORTED for encoded data in a packed file. */
bool tc_data_attach(tc_data *data, uint64_t at, GError **error);

void tc_data_clear(tc_data *data);
uint64_t tc_data_parts(const tc_data *data);

/* Checks that all parts exist and can hold part_bytes each. Raw: by size. Deflate: by its largest ratio (1032:1), so
 * that a small file cannot ask for much memory. Bzip2 has no such bound: missing data is found during reading, and
 * voxels take no memory before they are written. Call it before allocating memory for voxels. */
bool tc_data_check(const tc_data *data, GError **error);

typedef struct tc_source tc_source;

/* The data must outlive the source. One thread at a time. */
tc_source *tc_source_new(const tc_data *data);
void tc_source_free(tc_source *source); /* NULL is fine */

/* Reads exactly n decoded bytes, or sets an error that says where the data ended. */
bool tc_source_read(tc_source *source, void *to, size_t n, GError **error);
bool tc_source_skip(tc_source *source, uint64_t n, GError **error);

/* Call it after the last needed byte: checks that the part read last is complete, by the trailer of compressed data.
 * Unread frames are decoded only if the file's own record of its size does not vouch for them, and at most 64 MiB of
 * them. */
bool tc_source_finish(tc_source *source, GError **error);

#endif
