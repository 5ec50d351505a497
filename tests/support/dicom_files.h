/* Tiny DICOM files written by the tests: explicit little-endian, one picture each, nothing identifying. */
#ifndef TC_TESTS_DICOM_FILES_H
#define TC_TESTS_DICOM_FILES_H

#include <glib.h>
#include <glib/gstdio.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <zlib.h>

#include "tests/support/folder.h"

/* Contents of a file. Zero-initialise, then call dicom_spec_init(). NULL texts are omitted. */
typedef struct dicom_spec {
  const char *series, *modality, *frames, *photometric, *slope, *intercept, *between, *pixel_spacing, *orientation;
  const char *offsets; /* GridFrameOffsetVector */
  const char *uid, *image_type, *echo_time, *stack;
  const char *syntax, *dose; /* as in dicom_start_in(); DoseGridScaling */
  int echo, time;            /* 0: omitted */
  uint32_t whole_columns;    /* of the picture whose tiles the frames are; 0: omitted */
  double b_value;            /* below 0: omitted */
  bool has_position;
  double position[3];
  int instance, acquisition, series_number;
  unsigned rows, columns, allocated, stored, high, is_signed, samples;
  const GByteArray *lookup; /* the value of ModalityLUTSequence */
  const void *pixels, *csa; /* [pixel_bytes], [csa_bytes]: Siemens' private header */
  size_t pixel_bytes, csa_bytes;
} dicom_spec;

static inline void dicom_spec_init(dicom_spec *s, unsigned columns, unsigned rows, const void *pixels, size_t bytes) {
  *s = (dicom_spec){.series = "1.2.3.1",
                    .modality = "CT",
                    .photometric = "MONOCHROME2",
                    .slope = "1",
                    .b_value = -1,
                    .intercept = "-1024",
                    .pixel_spacing = "0.5\\0.75",
                    .orientation = "1\\0\\0\\0\\1\\0",
                    .has_position = true,
                    .instance = 1,
                    .acquisition = 1,
                    .series_number = 1,
                    .rows = rows,
                    .columns = columns,
                    .allocated = 16,
                    .stored = 16,
                    .high = 15,
                    .is_signed = 1,
                    .samples = 1,
                    .pixels = pixels,
                    .pixel_bytes = bytes};
}

static inline void dicom_u16(GByteArray *b, unsigned v) {
  uint8_t bytes[2] = {(uint8_t)v, (uint8_t)(v >> 8)};
  g_byte_array_append(b, bytes, 2);
}

static inline void dicom_u32(GByteArray *b, uint32_t v) {
  dicom_u16(b, v & 0xffff);
  dicom_u16(b, v >> 16);
}

/* Appends an element with any bytes as its value; odd lengths are padded. */
static inline void dicom_element(GByteArray *b, unsigned group, unsigned element, const char *vr, const void *value,
                                 size_t size) {
  bool wide = !strcmp(vr, "OB") || !strcmp(vr, "OW") || !strcmp(vr, "OF") || !strcmp(vr, "SQ") || !strcmp(vr, "UN");
  uint8_t pad = !strcmp(vr, "UI") || !strcmp(vr, "OB") ? 0 : ' ';
  size_t padded = size + (size & 1);
  dicom_u16(b, group);
  dicom_u16(b, element);
  g_byte_array_append(b, (const uint8_t *)vr, 2);
  if (wide) dicom_u16(b, 0);
  if (wide)
    dicom_u32(b, (uint32_t)padded);
  else
    dicom_u16(b, (unsigned)padded);
  if (size) g_byte_array_append(b, value, (guint)size);
  if (size & 1) g_byte_array_append(b, &pad, 1);
}

static inline void dicom_text(GByteArray *b, unsigned group, unsigned element, const char *vr, const char *text) {
  if (text) dicom_element(b, group, element, vr, text, strlen(text));
}

static inline void dicom_short(GByteArray *b, unsigned group, unsigned element, unsigned value) {
  uint8_t bytes[2] = {(uint8_t)value, (uint8_t)(value >> 8)};
  dicom_element(b, group, element, "US", bytes, 2);
}

static inline void dicom_count(GByteArray *b, unsigned group, unsigned element, int value) {
  char text[16];
  snprintf(text, sizeof text, "%d", value);
  dicom_text(b, group, element, "IS", text);
}

/* `syntax`: end of the transfer syntax UID, after "1.2.840.10008.1.2". */
static inline GByteArray *dicom_start_in(const char *syntax) {
  GByteArray *b = g_byte_array_new();
  char uid[32];
  const int size = snprintf(uid, sizeof uid, "1.2.840.10008.1.2%s", syntax);
  uint8_t preamble[128] = {0}, version[2] = {0, 1}, length[4] = {(uint8_t)(14 + 8 + size + (size & 1)), 0, 0, 0};
  g_byte_array_append(b, preamble, sizeof preamble);
  g_byte_array_append(b, (const uint8_t *)"DICM", 4);
  dicom_element(b, 2, 0, "UL", length, 4);
  dicom_element(b, 2, 1, "OB", version, 2);
  dicom_text(b, 2, 0x10, "UI", uid);
  return b;
}

static inline GByteArray *dicom_start(void) { return dicom_start_in(".1"); }

static inline GByteArray *dicom_bytes(const dicom_spec *s) {
  GByteArray *b = dicom_start_in(s->syntax ? s->syntax : ".1");
  char position[96];
  dicom_text(b, 0x08, 0x08, "CS", s->image_type);
  dicom_text(b, 0x08, 0x18, "UI", s->uid);
  dicom_text(b, 0x08, 0x60, "CS", s->modality);
  dicom_text(b, 0x10, 0x10, "PN", "SECRET^NAME"); /* must never leave the helper */
  dicom_text(b, 0x18, 0x81, "DS", s->echo_time);
  if (s->echo) dicom_count(b, 0x18, 0x86, s->echo);
  if (s->between) dicom_text(b, 0x18, 0x88, "DS", s->between);
  if (s->b_value >= 0) dicom_element(b, 0x18, 0x9087, "FD", &s->b_value, 8);
  dicom_text(b, 0x20, 0x0e, "UI", s->series);
  dicom_count(b, 0x20, 0x11, s->series_number);
  dicom_count(b, 0x20, 0x12, s->acquisition);
  dicom_count(b, 0x20, 0x13, s->instance);
  snprintf(position, sizeof position, "%.6g\\%.6g\\%.6g", s->position[0], s->position[1], s->position[2]);
  if (s->has_position) dicom_text(b, 0x20, 0x32, "DS", position);
  dicom_text(b, 0x20, 0x37, "DS", s->orientation);
  if (s->time) dicom_count(b, 0x20, 0x100, s->time);
  dicom_text(b, 0x20, 0x9056, "SH", s->stack);
  dicom_short(b, 0x28, 0x02, s->samples);
  dicom_text(b, 0x28, 0x04, "CS", s->photometric);
  if (s->samples > 1) dicom_short(b, 0x28, 0x06, 0);
  dicom_text(b, 0x28, 0x08, "IS", s->frames);
  dicom_short(b, 0x28, 0x10, s->rows);
  dicom_short(b, 0x28, 0x11, s->columns);
  dicom_text(b, 0x28, 0x30, "DS", s->pixel_spacing);
  dicom_short(b, 0x28, 0x100, s->allocated);
  dicom_short(b, 0x28, 0x101, s->stored);
  dicom_short(b, 0x28, 0x102, s->high);
  dicom_short(b, 0x28, 0x103, s->is_signed);
  dicom_text(b, 0x28, 0x1052, "DS", s->intercept);
  dicom_text(b, 0x28, 0x1053, "DS", s->slope);
  if (s->lookup) dicom_element(b, 0x28, 0x3000, "SQ", s->lookup->data, s->lookup->len);
  if (s->csa) dicom_text(b, 0x29, 0x10, "LO", "SIEMENS CSA HEADER");
  if (s->csa) dicom_element(b, 0x29, 0x1010, "OB", s->csa, s->csa_bytes);
  if (s->whole_columns) dicom_element(b, 0x48, 0x06, "UL", &s->whole_columns, 4);
  dicom_text(b, 0x3004, 0x0c, "DS", s->offsets);
  dicom_text(b, 0x3004, 0x0e, "DS", s->dose);
  if (s->pixels) dicom_element(b, 0x7fe0, 0x10, s->allocated > 8 ? "OW" : "OB", s->pixels, s->pixel_bytes);
  return b;
}

static inline bool dicom_write(const char *folder, const char *name, const dicom_spec *s) {
  GByteArray *b = dicom_bytes(s);
  char *path = g_build_filename(folder, name, NULL);
  bool ok = g_file_set_contents(path, (const char *)b->data, b->len, NULL);
  g_free(path);
  g_byte_array_free(b, TRUE);
  return ok;
}

/* ---- zips ---- */

typedef struct zip_writer {
  GByteArray *bytes, *directory;
  unsigned count;
} zip_writer;

static inline zip_writer zip_start(void) { return (zip_writer){g_byte_array_new(), g_byte_array_new(), 0}; }

/* `method` 0 stored, 8 deflated. */
static inline void zip_add(zip_writer *z, const char *name, const void *data, size_t size, unsigned method) {
  uint8_t *packed = g_malloc(compressBound(size) + 16);
  size_t packed_size = size;
  uint32_t crc = (uint32_t)crc32(0, data, (uInt)size), at = z->bytes->len;
  if (method == 8) {
    z_stream s = {.next_in = (Bytef *)(uintptr_t)data,
                  .avail_in = (uInt)size,
                  .next_out = packed,
                  .avail_out = (uInt)compressBound(size) + 16};
    deflateInit2(&s, 6, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY);
    deflate(&s, Z_FINISH);
    packed_size = s.total_out;
    deflateEnd(&s);
  } else {
    memcpy(packed, data, size);
  }
  for (int central = 0; central < 2; central++) {
    GByteArray *b = central ? z->directory : z->bytes;
    dicom_u32(b, central ? 0x02014b50 : 0x04034b50);
    if (central) dicom_u16(b, 20);
    dicom_u16(b, 20);
    dicom_u16(b, 0);
    dicom_u16(b, method);
    dicom_u32(b, 0);
    dicom_u32(b, crc);
    dicom_u32(b, (uint32_t)packed_size);
    dicom_u32(b, (uint32_t)size);
    dicom_u16(b, (unsigned)strlen(name));
    dicom_u16(b, 0);
    if (central) {
      dicom_u16(b, 0);
      dicom_u16(b, 0);
      dicom_u16(b, 0);
      dicom_u32(b, 0);
      dicom_u32(b, at);
    }
    g_byte_array_append(b, (const uint8_t *)name, (guint)strlen(name));
    if (!central) g_byte_array_append(b, packed, (guint)packed_size);
  }
  z->count++;
  g_free(packed);
}

/* Finishes the zip; the writer cannot be used afterwards. Caller frees. */
static inline GByteArray *zip_end(zip_writer *z) {
  uint32_t at = z->bytes->len, size = z->directory->len;
  g_byte_array_append(z->bytes, z->directory->data, size);
  g_byte_array_free(z->directory, TRUE);
  dicom_u32(z->bytes, 0x06054b50);
  dicom_u32(z->bytes, 0);
  dicom_u16(z->bytes, z->count);
  dicom_u16(z->bytes, z->count);
  dicom_u32(z->bytes, size);
  dicom_u32(z->bytes, at);
  dicom_u16(z->bytes, 0);
  return z->bytes;
}

#endif
