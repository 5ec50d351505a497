/* TIFF in memory, through libtiff. */
#include <math.h>
#include <string.h>
#include <tiffio.h>

#include "renderer/import/helper/picture.h"

static bool fail(tc_error_code code, const char *what, GError **error) {
  tc_set_error(error, code, NULL, "TIFF: %s", what);
  return false;
}

/* ---- memory as a file ---- */

static tmsize_t read_some(thandle_t user, void *to, tmsize_t n) {
  tc_picture *p = user;
  const uint64_t left = p->size > p->at ? p->size - p->at : 0, got = MIN((uint64_t)MAX(n, 0), left);
  memcpy(to, p->bytes + p->at, got);
  p->at += got;
  return (tmsize_t)got;
}

static tmsize_t write_nothing(thandle_t user, void *from, tmsize_t n) { return -1; }

static toff_t seek(thandle_t user, toff_t offset, int whence) {
  tc_picture *p = user;
  p->at = whence == SEEK_SET ? offset : whence == SEEK_CUR ? p->at + offset : p->size + offset;
  if (p->at > p->size) p->at = p->size;
  return p->at;
}

static int close_nothing(thandle_t user) { return 0; }

static toff_t size_of(thandle_t user) { return ((tc_picture *)user)->size; }

/* ---- pages ---- */

static uint32_t number(TIFF *tiff, uint32_t tag, uint32_t otherwise) {
  uint16_t small = 0;
  uint32_t wide = 0;
  const bool is_wide = tag == TIFFTAG_IMAGEWIDTH || tag == TIFFTAG_IMAGELENGTH || tag == TIFFTAG_SUBFILETYPE ||
                       tag == TIFFTAG_ROWSPERSTRIP;
  if (is_wide) return TIFFGetFieldDefaulted(tiff, tag, &wide) ? wide : otherwise;
  return TIFFGetFieldDefaulted(tiff, tag, &small) ? small : otherwise;
}

/* Reduced copies of a page do not belong to the stack. */
static bool is_reduced(TIFF *tiff) { return number(tiff, TIFFTAG_SUBFILETYPE, 0) & FILETYPE_REDUCEDIMAGE; }

/* False at the end of the list, or with *cut if the list is damaged. */
static bool next_page(TIFF *tiff, bool *cut) {
  while (!TIFFLastDirectory(tiff)) {
    if ((*cut = !TIFFReadDirectory(tiff))) return false;
    if (!is_reduced(tiff)) return true;
  }
  return false;
}

static double unit_mm(const char *unit) {
  static const struct {
    const char *name;
    double mm;
  } units[] = {{"mm", 1},           {"millimeter", 1},  {"cm", 10},   {"micron", 1e-3}, {"um", 1e-3},
               {"\xc2\xb5m", 1e-3}, {"\\u00B5m", 1e-3}, {"nm", 1e-6}, {"inch", 25.4}};
  for (size_t i = 0; i < G_N_ELEMENTS(units); i++)
    if (g_ascii_strcasecmp(unit, units[i].name) == 0) return units[i].mm;
  return 0;
}

static int count_of(const char *value) { return (int)CLAMP(g_ascii_strtoll(value, NULL, 10), 1, TC_PICTURE_PAGES); }

/* "ImageJ=1.53t\nimages=93\nslices=93\nunit=mm\nspacing=1.5\n" */
static void read_note(TIFF *tiff, tc_picture_note *note) {
  const char *text = NULL;
  float x = 0, y = 0;
  double mm = 0, step = 0;
  if (!TIFFGetField(tiff, TIFFTAG_IMAGEDESCRIPTION, &text) || !text || !g_str_has_prefix(text, "ImageJ=")) return;
  char **lines = g_strsplit(text, "\n", 64);
  for (char **line = lines; *line; line++) {
    char *value = strchr(*line, '=');
    if (!value) continue;
    *value++ = 0;
    if (strcmp(*line, "slices") == 0) note->slices = count_of(value);
    if (strcmp(*line, "channels") == 0) note->channels = count_of(value);
    if (strcmp(*line, "frames") == 0) note->frames = count_of(value);
    if (strcmp(*line, "unit") == 0) mm = unit_mm(value);
    if (strcmp(*line, "spacing") == 0) step = g_ascii_strtod(value, NULL);
  }
  g_strfreev(lines);
  TIFFGetField(tiff, TIFFTAG_XRESOLUTION, &x);
  TIFFGetField(tiff, TIFFTAG_YRESOLUTION, &y);
  if (!(mm > 0 && x > 0 && y > 0 && fabs(step) > 0 && isfinite(1 / x + 1 / y + step))) return;
  note->spacing[0] = mm / x;
  note->spacing[1] = mm / y;
  note->spacing[2] = mm * fabs(step);
}

bool tc_tiff_open(tc_picture *p, GError **error) {
  TIFFSetErrorHandler(NULL);
  TIFFSetWarningHandler(NULL);
  TIFF *tiff = p->tiff =
      TIFFClientOpen("", "rm", p, read_some, write_nothing, seek, close_nothing, size_of, NULL, NULL);
  if (!tiff) return fail(TC_ERROR_FORMAT, "its header is damaged", error);
  read_note(tiff, &p->note);
  bool cut = false;
  while (p->pages <= TC_PICTURE_PAGES && next_page(tiff, &cut)) p->pages++;
  if (cut) return fail(TC_ERROR_FORMAT, "the file is cut short: fetch it again", error);
  if (p->pages > TC_PICTURE_PAGES) return fail(TC_ERROR_LIMIT, "more than 65536 pages", error);
  if (!TIFFSetDirectory(tiff, 0)) return fail(TC_ERROR_FORMAT, "its first page is damaged", error);
  return true;
}

void tc_tiff_close(tc_picture *p) { TIFFClose(p->tiff); }

bool tc_tiff_forward(tc_picture *p, GError **error) {
  bool cut;
  return next_page(p->tiff, &cut) || fail(TC_ERROR_FORMAT, "a page is damaged", error);
}

/* Bits of a grey voxel that is stored unchanged; 0: libtiff converts the page to RGBA. */
static uint32_t grey_bits(TIFF *tiff) {
  const uint32_t bits = number(tiff, TIFFTAG_BITSPERSAMPLE, 1),
                 photometric = number(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
  const bool grey = photometric == PHOTOMETRIC_MINISBLACK || photometric == PHOTOMETRIC_MINISWHITE;
  const bool plain = number(tiff, TIFFTAG_SAMPLESPERPIXEL, 1) == 1 && bits >= 8 && bits % 8 == 0;
  return grey && plain ? bits : 0;
}

/* For pages that libtiff converts to RGBA: without a photometric tag, three samples are RGB. */
static bool is_grey(TIFF *tiff) {
  return number(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK) <= PHOTOMETRIC_MINISBLACK &&
         number(tiff, TIFFTAG_SAMPLESPERPIXEL, 1) <= 2;
}

bool tc_tiff_page(tc_picture *p, tc_page *page, GError **error) {
  const uint32_t bits = grey_bits(p->tiff), format = number(p->tiff, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT);
  page->width = (int)MIN(number(p->tiff, TIFFTAG_IMAGEWIDTH, 0), (uint32_t)INT32_MAX);
  page->height = (int)MIN(number(p->tiff, TIFFTAG_IMAGELENGTH, 0), (uint32_t)INT32_MAX);
  page->colour = !bits && !is_grey(p->tiff);
  page->type = TC_U8;
  char why[1024];
  if (!bits)
    return TIFFRGBAImageOK(p->tiff, why) ||
           fail(TC_ERROR_UNSUPPORTED, "its kind of pixels is not read: save it as grey of 8 or 16 bits", error);
  const bool is_signed = format == SAMPLEFORMAT_INT, real = format == SAMPLEFORMAT_IEEEFP;
  if (real && bits == 32)
    page->type = TC_F32;
  else if (!real && bits == 8)
    page->type = is_signed ? TC_I8 : TC_U8;
  else if (!real && bits == 16)
    page->type = is_signed ? TC_I16 : TC_U16;
  else
    return fail(TC_ERROR_UNSUPPORTED, "grey of 8, 16 or float of 32 bits is read: save it as one of these", error);
  return true;
}

/* Whether the file can hold a page of so many bytes: no TIFF compression exceeds a few thousand to one. */
static bool is_held(const tc_picture *p, uint64_t bytes, GError **error) {
  return bytes / 8192 <= p->size || fail(TC_ERROR_FORMAT, "the file is too short for its page", error);
}

static bool read_strips(TIFF *tiff, const tc_page *page, uint8_t *to, size_t row) {
  const uint32_t height = (uint32_t)page->height, rows = MIN(number(tiff, TIFFTAG_ROWSPERSTRIP, height), height);
  if (rows < 1 || (uint64_t)TIFFScanlineSize64(tiff) != row) return false;
  for (uint32_t y = 0; y < height; y += rows) {
    const tmsize_t bytes = (tmsize_t)(MIN(rows, height - y) * row);
    if (TIFFReadEncodedStrip(tiff, TIFFComputeStrip(tiff, y, 0), to + y * row, bytes) != bytes) return false;
  }
  return true;
}

static bool read_tiles(TIFF *tiff, const tc_page *page, uint8_t *to, size_t row, size_t voxel) {
  uint32_t width = 0, height = 0;
  TIFFGetField(tiff, TIFFTAG_TILEWIDTH, &width);
  TIFFGetField(tiff, TIFFTAG_TILELENGTH, &height);
  const tmsize_t bytes = TIFFTileSize(tiff);
  if (width < 1 || height < 1 || bytes < 1 || (uint64_t)bytes < (uint64_t)width * height * voxel) return false;
  uint8_t *tile = g_try_malloc((gsize)bytes);
  bool ok = tile != NULL;
  for (uint32_t y = 0; ok && y < (uint32_t)page->height; y += height)
    for (uint32_t x = 0; ok && x < (uint32_t)page->width; x += width) {
      ok = TIFFReadTile(tiff, tile, x, y, 0, 0) == bytes;
      const size_t n = MIN(width, (uint32_t)page->width - x) * voxel;
      for (uint32_t k = 0; ok && k < MIN(height, (uint32_t)page->height - y); k++)
        memcpy(to + (y + k) * row + x * voxel, tile + k * width * voxel, n);
    }
  g_free(tile);
  return ok;
}

static bool read_rgba(TIFF *tiff, const tc_page *page, uint8_t *to) {
  const size_t n = (size_t)page->width * (size_t)page->height;
  uint32_t *rgba = g_try_new(uint32_t, n);
  const bool ok = rgba && TIFFReadRGBAImageOriented(tiff, (uint32_t)page->width, (uint32_t)page->height, rgba,
                                                    ORIENTATION_TOPLEFT, 1);
  for (size_t i = 0; ok && i < n; i++) rgba[i] = GUINT32_TO_LE(rgba[i]);
  if (ok && page->colour) tc_picture_rgb((const uint8_t *)rgba, n, to);
  for (size_t i = 0; ok && !page->colour && i < n; i++) to[i] = (uint8_t)rgba[i];
  g_free(rgba);
  return ok;
}

/* Inverts pages where white is 0. */
static void invert(void *voxels, size_t n, tc_voxel_type type) {
  for (size_t i = 0; i < n; i++) {
    if (type == TC_U8) ((uint8_t *)voxels)[i] = (uint8_t) ~((uint8_t *)voxels)[i];
    if (type == TC_U16) ((uint16_t *)voxels)[i] = (uint16_t) ~((uint16_t *)voxels)[i];
  }
}

bool tc_tiff_read(tc_picture *p, const tc_page *page, void *to, GError **error) {
  TIFF *tiff = p->tiff;
  const size_t voxel = tc_voxel_size(page->type), row = (size_t)page->width * voxel,
               n = (size_t)page->width * (size_t)page->height;
  if (!is_held(p, n, error)) return false;
  const bool raw = grey_bits(tiff) > 0;
  const bool ok = !raw                ? read_rgba(tiff, page, to)
                  : TIFFIsTiled(tiff) ? read_tiles(tiff, page, to, row, voxel)
                                      : read_strips(tiff, page, to, row);
  if (raw && ok && number(tiff, TIFFTAG_PHOTOMETRIC, 1) == PHOTOMETRIC_MINISWHITE) invert(to, n, page->type);
  return ok || fail(TC_ERROR_FORMAT, "a page is damaged: fetch the file again", error);
}
