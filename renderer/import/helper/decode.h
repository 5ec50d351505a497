/* Decoders: encoded bytes of one input, from an offset on, become plain bytes. Used by source.c only. */
#ifndef TC_IMPORT_DECODE_H
#define TC_IMPORT_DECODE_H

#include "renderer/import/helper/source.h"

typedef struct tc_decoder tc_decoder;

/* Starts at `offset` of the input, which must outlive the decoder. `element` matters for text only. Text and hex are
 * decoded at once, at most `wanted` bytes. */
tc_decoder *tc_decoder_new(const tc_input *input, uint64_t offset, tc_encoding encoding, tc_element element,
                           uint64_t wanted, GError **error);
void tc_decoder_free(tc_decoder *decoder); /* NULL is fine */
/* `watch` is called while compressed bytes are fetched and while bytes are skipped. */
void tc_decoder_watch(tc_decoder *decoder, tc_watch_fn watch, void *user);

/* Reads up to n bytes; fewer only at the end of the data. False on damaged data. */
bool tc_decoder_read(tc_decoder *decoder, void *to, size_t n, size_t *got, GError **error);

/* Skips up to n bytes; *skipped receives how many were skipped. */
bool tc_decoder_skip(tc_decoder *decoder, uint64_t n, uint64_t *skipped, GError **error);

/* True if the file ended in the middle of compressed data. */
bool tc_decoder_cut(const tc_decoder *decoder);

/* Converts text to numbers of type `element`, or hex digits to bytes; at most `wanted` bytes. Caller frees
 * (g_byte_array_unref). */
GByteArray *tc_decode_text(const char *text, size_t length, tc_element element, uint64_t wanted, GError **error);
GByteArray *tc_decode_hex(const char *text, size_t length, uint64_t wanted, GError **error);

#endif
