/* Voxels written as text: decimal numbers or hex digits. */
#include "renderer/import/helper/decode.h"

#include <errno.h>
#include <string.h>

static bool is_gap(char c) { return g_ascii_isspace(c) || c == ','; }

/* Parses one number of the element's type; false if it is malformed or out of range. */
static bool number(const char *text, char **end, tc_element element, void *to) {
  static const int64_t lowest[] = {INT8_MIN, 0, INT16_MIN, 0, INT32_MIN, 0, INT64_MIN, 0};
  static const uint64_t highest[] = {INT8_MAX,  UINT8_MAX,  INT16_MAX, UINT16_MAX,
                                     INT32_MAX, UINT32_MAX, INT64_MAX, UINT64_MAX};
  errno = 0;
  if (element == TC_ELEMENT_F32 || element == TC_ELEMENT_F64) {
    double value = g_ascii_strtod(text, end);
    if (*end == text) return false;
    float narrow = (float)value;
    if (element == TC_ELEMENT_F32)
      memcpy(to, &narrow, sizeof narrow);
    else
      memcpy(to, &value, sizeof value);
    return true;
  }
  uint64_t bits;
  if (*text == '-') {
    int64_t value = g_ascii_strtoll(text, end, 10);
    if (value < lowest[element]) return false;
    bits = (uint64_t)value;
  } else {
    bits = g_ascii_strtoull(text, end, 10);
    if (bits > highest[element]) return false;
  }
  if (*end == text || errno == ERANGE) return false;
  /* the low bytes of the two's complement are the narrow number */
  uint8_t n8 = (uint8_t)bits;
  uint16_t n16 = (uint16_t)bits;
  uint32_t n32 = (uint32_t)bits;
  switch (tc_element_size(element)) {
  case 1: memcpy(to, &n8, 1); break;
  case 2: memcpy(to, &n16, 2); break;
  case 4: memcpy(to, &n32, 4); break;
  default: memcpy(to, &bits, 8); break;
  }
  return true;
}

GByteArray *tc_decode_text(const char *text, size_t length, tc_element element, uint64_t wanted, GError **error) {
  GByteArray *out = g_byte_array_sized_new((guint)MIN(wanted, 8 * (uint64_t)length));
  size_t size = tc_element_size(element);
  const char *at = text, *end = text + length; /* text[length] is 0, so number scanning stops there */
  while (out->len + size <= wanted) {
    while (at < end && is_gap(*at)) at++;
    if (at >= end) break;
    uint8_t bytes[8];
    char *after;
    if (!number(at, &after, element, bytes) || (*after != '\0' && !is_gap(*after))) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "text data: number %u is none of type %s",
                   out->len / (unsigned)size + 1, tc_element_name(element));
      g_byte_array_unref(out);
      return NULL;
    }
    g_byte_array_append(out, bytes, (guint)size);
    at = after;
  }
  return out;
}

GByteArray *tc_decode_hex(const char *text, size_t length, uint64_t wanted, GError **error) {
  GByteArray *out = g_byte_array_sized_new((guint)MIN(wanted, 8 * (uint64_t)length));
  int high = -1;
  for (size_t i = 0; i < length && out->len < wanted; i++) {
    if (g_ascii_isspace(text[i])) continue;
    int digit = g_ascii_xdigit_value(text[i]);
    if (digit < 0) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "hex data: byte %zu is no hex digit", i);
      g_byte_array_unref(out);
      return NULL;
    }
    if (high < 0) {
      high = digit;
    } else {
      uint8_t byte = (uint8_t)(high << 4 | digit);
      g_byte_array_append(out, &byte, 1);
      high = -1;
    }
  }
  return out;
}
