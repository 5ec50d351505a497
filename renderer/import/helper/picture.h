/* One picture file, PNG or TIFF: its pages one after another, as grey voxels. */
#ifndef TC_IMPORT_PICTURE_H
#define TC_IMPORT_PICTURE_H

#include "renderer/volume/volume.h"

enum { TC_PICTURE_PAGES = 65536 }; /* largest number of pages */

typedef struct tc_page {
  int width, height;
  tc_voxel_type type;
  bool colour; /* read as r, g, b */
} tc_page;

size_t tc_page_bytes(const tc_page *page);

/* Geometry that ImageJ writes into a TIFF; zeros and ones if it is missing. */
typedef struct tc_picture_note {
  double spacing[3];            /* mm */
  int slices, channels, frames; /* pages go channel by channel, then slice by slice */
} tc_picture_note;

typedef struct tc_picture {
  const uint8_t *bytes; /* [size] */
  size_t size;
  struct tiff *tiff; /* NULL: PNG */
  uint64_t at;       /* read position of libtiff in the bytes */
  int pages, next;   /* next: index of the page that the following tc_picture_read() reads */
  tc_picture_note note;
} tc_picture;

/* Opens a file at its first page; the caller keeps the bytes. TC_ERROR_FORMAT, _UNSUPPORTED, _LIMIT. */
bool tc_picture_open(tc_picture *picture, const uint8_t *bytes, size_t size, GError **error);
void tc_picture_close(tc_picture *picture); /* accepts a zeroed picture */

/* Describes the next page. */
bool tc_picture_page(tc_picture *picture, tc_page *page, GError **error);
/* Reads the next page's voxels into to[] and advances. TC_ERROR_FORMAT if the page differs in size or kind from
 * `wanted`. */
bool tc_picture_read(tc_picture *picture, const tc_page *wanted, void *to, GError **error);

/* Of both formats. */
void tc_picture_rgb(const uint8_t *rgba, size_t n, uint8_t *to);
bool tc_png_page(const tc_picture *picture, tc_page *page, GError **error);
bool tc_png_read(const tc_picture *picture, const tc_page *page, void *to, GError **error);
bool tc_tiff_open(tc_picture *picture, GError **error);
bool tc_tiff_page(tc_picture *picture, tc_page *page, GError **error);
bool tc_tiff_read(tc_picture *picture, const tc_page *page, void *to, GError **error);
bool tc_tiff_forward(tc_picture *picture, GError **error); /* to the next page */
void tc_tiff_close(tc_picture *picture);

#endif
