/* One file of pictures, PNG or TIFF: its pages one after the other, as grey voxels. */
#ifndef TC_IMPORT_PICTURE_H
#define TC_IMPORT_PICTURE_H

#include "renderer/volume/volume.h"

enum { TC_PICTURE_PAGES = 65536 }; /* of a file, at most */

typedef struct tc_page {
  int width, height;
  tc_voxel_type type;
  bool colour; /* read as r, g, b */
} tc_page;

size_t tc_page_bytes(const tc_page *page);

/* What ImageJ notes in a TIFF; zeros and ones where there is nothing. */
typedef struct tc_picture_note {
  double spacing[3];            /* mm */
  int slices, channels, frames; /* pages go channel by channel, then slice by slice */
} tc_picture_note;

typedef struct tc_picture {
  const uint8_t *bytes; /* [size] */
  size_t size;
  struct tiff *tiff; /* NULL: PNG */
  uint64_t at;       /* where its mapping is read by libtiff */
  int pages, next;   /* next: the page that the following tc_picture_read() reads */
  tc_picture_note note;
} tc_picture;

/* Opens a file, whose bytes stay the caller's, at its first page. TC_ERROR_FORMAT, _UNSUPPORTED, _LIMIT. */
bool tc_picture_open(tc_picture *picture, const uint8_t *bytes, size_t size, GError **error);
void tc_picture_close(tc_picture *picture); /* a zeroed one is fine */

/* What the next page is. */
bool tc_picture_page(tc_picture *picture, tc_page *page, GError **error);
/* Its voxels into to[], and on to the one after it. TC_ERROR_FORMAT where it is of another size or kind than wanted. */
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
