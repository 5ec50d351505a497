/* Where bytes come from: an input (an open file or memory), and a source, which is the one stream
 * of decoded voxel bytes that an image's data make, whatever files and encodings they are spread over.
 *
 * Memory stays small: a source holds one buffer of encoded bytes and decodes straight into the caller's memory.
 * Data files named by a header are asked of the daemon, which looks beside that header and nowhere else. */
#ifndef TC_IMPORT_SOURCE_H
#define TC_IMPORT_SOURCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/base/error.h"

/* A file's own element types. */
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
  TC_ENCODING_TEXT,    /* decimal numbers, decoded to elements in this machine's byte order */
  TC_ENCODING_HEX,
  TC_ENCODING_COUNT
} tc_encoding;

/* ---- inputs: random access ---- */

/* Opens a file beside the input: tc_order's open. */
typedef int (*tc_open_fn)(void *user, const char *name, bool optional, GError **error);

struct tc_input;
/* The same of an input in memory: false where there is none of that name. */
typedef bool (*tc_member_fn)(void *user, const char *name, struct tc_input *member, GError **error);

typedef struct tc_input {
  int fd;               /* an open regular file, or -1: bytes */
  const uint8_t *bytes; /* [size], not owned */
  uint64_t size;
  tc_encoding packing; /* of the file as a whole: raw, deflate (gzip) or bzip2 */
  tc_open_fn open; /* both NULL: it can name no other file */
  tc_member_fn member;
  void *open_user;
  void *owned; /* bytes that closing frees */
  char *name; /* base name */
} tc_input;

/* Takes over an open regular file. TC_ERROR_FORMAT for what is none: then *input is closed already. */
bool tc_input_adopt(tc_input *input, int fd, const char *name, GError **error);

/* Bytes in memory, which stay the caller's, as a fuzzer has them. */
void tc_input_memory(tc_input *input, const void *bytes, size_t size, const char *name);

/* False (TC_ERROR_FORMAT) where the input may name no other file: asked by whoever finds a name in a header. */
bool tc_input_may_name(const tc_input *input, GError **error);

/* Opens a file beside the input. False without an error where an optional one is missing. */
bool tc_input_open_sibling(const tc_input *input, const char *name, bool optional, tc_input *sibling, GError **error);

void tc_input_close(tc_input *input); /* a zeroed or closed input is fine */

/* Exactly n bytes from offset. */
bool tc_input_read(const tc_input *input, uint64_t offset, void *to, size_t n, GError **error);

/* Up to n bytes from the start, unpacked; *got tells how many. Fails only when reading fails: damaged compressed bytes
 * just end the head. */
bool tc_input_head(const tc_input *input, void *to, size_t n, size_t *got, GError **error);

/* The first bytes of a file that begins with a header of text: up to 4 MiB, 256 KiB of a packed one. Caller frees. */
uint8_t *tc_input_header(const tc_input *input, size_t *size, GError **error);

/* ---- sources: one stream of decoded bytes ---- */

/* Text is for small files: it is read whole. */
#define TC_TEXT_LIMIT (16u << 20)

/* Looked at every few hundred KiB that are decoded: false, with an error, ends it. */
typedef bool (*tc_watch_fn)(void *user, GError **error);

/* What the data of an image are. Parts follow each other in the stream. */
typedef struct tc_data {
  const tc_input *input; /* the header's file */
  GPtrArray *names;      /* char *: one data file per part beside the input; NULL: one part, in the input itself */
  uint64_t part_bytes;   /* decoded bytes wanted of each part */
  uint64_t offset;       /* where the encoded bytes start in each file */
  uint64_t line_skip;    /* text lines to leave out after that */
  int64_t byte_skip;     /* decoded bytes to leave out after that; -1: the data are the last part_bytes there are */
  tc_encoding encoding;
  tc_element element;    /* for TC_ENCODING_TEXT */
  tc_watch_fn watch;     /* NULL: none */
  void *watch_user;
} tc_data;

/* The data follow the header in the input, from byte `at` of what it unpacks to. Set the encoding and skips first.
 * TC_ERROR_UNSUPPORTED for encoded data in a packed file. */
bool tc_data_attach(tc_data *data, uint64_t at, GError **error);

void tc_data_clear(tc_data *data);
uint64_t tc_data_parts(const tc_data *data);

/* Do all parts exist and can they hold part_bytes each? Raw: by size. Deflate: by its greatest ratio (1032:1), so
 * that a small file cannot ask for much memory. Bzip2 knows no such bound: what is missing is found as it is read, and
 * voxels cost nothing before they are. Call it before anything is allocated for voxels. */
bool tc_data_check(const tc_data *data, GError **error);

typedef struct tc_source tc_source;

/* The data must outlive the source. One thread at a time. */
tc_source *tc_source_new(const tc_data *data);
void tc_source_free(tc_source *source); /* NULL is fine */

/* Exactly n decoded bytes, or an error that tells where the data ended. */
bool tc_source_read(tc_source *source, void *to, size_t n, GError **error);
bool tc_source_skip(tc_source *source, uint64_t n, GError **error);

/* After the last byte of use was read: is the part that was read last complete? Checks the trailer of compressed data;
 * frames that nobody read are decoded only where the file's own note of its size does not speak for them, and no more
 * than 64 MiB of them. */
bool tc_source_finish(tc_source *source, GError **error);

#endif
