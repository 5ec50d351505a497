/* PNG through libspng. */
#include <spng.h>

#include "renderer/import/helper/picture.h"

static bool fail(int code, GError **error) {
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "PNG: %s", spng_strerror(code));
  return false;
}

/* Returns NULL with an error for a damaged header. */
static spng_ctx *begin(const tc_picture *p, struct spng_ihdr *head, GError **error) {
  spng_ctx *png = spng_ctx_new(0);
  int code = png ? spng_set_png_buffer(png, p->bytes, p->size) : SPNG_EMEM;
  if (!code) code = spng_get_ihdr(png, head);
  if (!code) return png;
  spng_ctx_free(png);
  fail(code, error);
  return NULL;
}

bool tc_png_page(const tc_picture *p, tc_page *page, GError **error) {
  struct spng_ihdr head;
  spng_ctx *png = begin(p, &head, error);
  if (!png) return false;
  spng_ctx_free(png);
  const bool grey = head.color_type == SPNG_COLOR_TYPE_GRAYSCALE;
  *page = (tc_page){(int)head.width, (int)head.height, grey && head.bit_depth == 16 ? TC_U16 : TC_U8, !grey};
  return true;
}

/* Deflate's largest ratio is 1032:1, so a file cannot ask for more memory than that. */
static bool is_held(const tc_picture *p, size_t bytes, GError **error) {
  if (bytes / 8 / 1032 <= p->size) return true;
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "PNG: the file is too short for its picture");
  return false;
}

bool tc_png_read(const tc_picture *p, const tc_page *page, void *to, GError **error) {
  struct spng_ihdr head;
  const size_t n = (size_t)page->width * (size_t)page->height,
               bytes = page->colour ? 4 * n : n * tc_voxel_size(page->type);
  if (!is_held(p, bytes, error)) return false;
  spng_ctx *png = begin(p, &head, error);
  uint8_t *rgba = png && page->colour ? g_try_malloc(bytes) : NULL;
  const int format = page->colour ? SPNG_FMT_RGBA8 : page->type == TC_U16 ? SPNG_FMT_PNG : SPNG_FMT_G8;
  if (!png) return false;
  const int code = page->colour && !rgba ? SPNG_EMEM : spng_decode_image(png, rgba ? rgba : to, bytes, format, 0);
  if (!code && rgba) tc_picture_rgb(rgba, n, to);
  g_free(rgba);
  spng_ctx_free(png);
  return !code || fail(code, error);
}
