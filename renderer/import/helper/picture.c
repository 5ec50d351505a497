#include "renderer/import/helper/picture.h"

#include <string.h>

#include "renderer/import/helper.h"

bool tc_picture_open(tc_picture *p, const uint8_t *bytes, size_t size, GError **error) {
  *p = (tc_picture){.bytes = bytes, .size = size, .pages = 1, .note = {.slices = 1, .channels = 1, .frames = 1}};
  return size < 4 || memcmp(bytes, "\x89PNG", 4) == 0 || tc_tiff_open(p, error);
}

void tc_picture_close(tc_picture *p) {
  if (p->tiff) tc_tiff_close(p);
  *p = (tc_picture){0};
}

bool tc_picture_page(tc_picture *p, tc_page *page, GError **error) {
  *page = (tc_page){0};
  if (!(p->tiff ? tc_tiff_page(p, page, error) : tc_png_page(p, page, error))) return false;
  if (page->width >= 1 && page->height >= 1 && (uint64_t)page->width * (uint64_t)page->height <= INT32_MAX) return true;
  tc_set_error(error, TC_ERROR_LIMIT, NULL, "a picture of %d x %d pixels is no slice of a volume", page->width,
               page->height);
  return false;
}

bool tc_picture_read(tc_picture *p, const tc_page *wanted, void *to, GError **error) {
  tc_page page;
  if (!tc_picture_page(p, &page, error)) return false;
  if (page.width != wanted->width || page.height != wanted->height || page.type != wanted->type ||
      page.colour != wanted->colour) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL,
                 "a picture is %d x %d %s%s, the first %d x %d %s%s: a stack has pictures of one kind and size",
                 page.width, page.height, page.colour ? "colour " : "", tc_voxel_type_name(page.type), wanted->width,
                 wanted->height, wanted->colour ? "colour " : "", tc_voxel_type_name(wanted->type));
    return false;
  }
  if (!(p->tiff ? tc_tiff_read(p, &page, to, error) : tc_png_read(p, &page, to, error))) return false;
  p->next++;
  return !p->tiff || p->next >= p->pages || tc_tiff_forward(p, error);
}

size_t tc_page_bytes(const tc_page *page) {
  return (size_t)page->width * (size_t)page->height * (page->colour ? 3 : tc_voxel_size(page->type));
}

void tc_picture_rgb(const uint8_t *rgba, size_t n, uint8_t *to) {
  for (size_t i = 0; i < n; i++)
    memcpy(to + 3 * i, rgba + 4 * i, 3);
}
