/* Stacks of pictures through the confined helper: TIFF as libtiff writes it in its many ways, PNG by libspng, the order
 * of names, spacings; and DICOMDIR. */
#include <spng.h>
#include <tiffio.h>

#define TC_TEST_BY_HELPER(name, options) true
#include "import_files.h"

enum { WIDTH = 21, HEIGHT = 18, PAGES = 3, COUNT = WIDTH * HEIGHT };

static unsigned value(int page, int i) { return (unsigned)(page * 5000 + 131 * i) & 0xffff; }

typedef struct kind {
  uint16_t bits, format, photometric, compression;
  bool tiled, big_endian;
} kind;

static void fill(const kind *k, int page, int x0, int y0, int width, int height, uint8_t *to) {
  for (int y = 0; y < height; y++)
    for (int x = 0; x < width; x++) {
      const int at = y * width + x, i = MIN(y0 + y, HEIGHT - 1) * WIDTH + MIN(x0 + x, WIDTH - 1);
      const unsigned v = value(page, i);
      const float real = (float)v / 7;
      if (k->bits == 8) to[at] = (uint8_t)v;
      if (k->bits == 16) memcpy(to + 2 * at, &(uint16_t){(uint16_t)v}, 2);
      if (k->bits == 32) memcpy(to + 4 * at, &real, 4);
    }
}

static void write_page(TIFF *tiff, const kind *k, int page) {
  uint8_t bytes[32 * 32 * 4];
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, WIDTH);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, HEIGHT);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, k->bits);
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, k->format);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, k->photometric);
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, k->compression);
  if (k->tiled) {
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, 16);
    TIFFSetField(tiff, TIFFTAG_TILELENGTH, 16);
  } else {
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 5);
  }
  for (int y = 0; y < HEIGHT; y += k->tiled ? 16 : 5)
    for (int x = 0; x < WIDTH; x += k->tiled ? 16 : WIDTH) {
      const int rows = MIN(5, HEIGHT - y);
      fill(k, page, x, y, k->tiled ? 16 : WIDTH, k->tiled ? 16 : rows, bytes);
      if (k->tiled)
        assert_true(TIFFWriteTile(tiff, bytes, (uint32_t)x, (uint32_t)y, 0, 0) > 0);
      else
        assert_true(TIFFWriteEncodedStrip(tiff, (uint32_t)y / 5, bytes, (tmsize_t)(rows * WIDTH * k->bits / 8)) > 0);
    }
  assert_true(TIFFWriteDirectory(tiff));
}

static void write_tiff(const char *name, const kind *k) {
  g_autofree char *path = path_of(name);
  TIFF *tiff = TIFFOpen(path, k->big_endian ? "wb" : "wl");
  assert_non_null(tiff);
  for (int page = 0; page < PAGES; page++) write_page(tiff, k, page);
  TIFFClose(tiff);
}

TEST(tiff_of_every_kind) {
  static const kind kinds[] = {
      {8, SAMPLEFORMAT_UINT, PHOTOMETRIC_MINISBLACK, COMPRESSION_LZW, false, false},
      {16, SAMPLEFORMAT_UINT, PHOTOMETRIC_MINISBLACK, COMPRESSION_ADOBE_DEFLATE, true, true},
      {16, SAMPLEFORMAT_INT, PHOTOMETRIC_MINISBLACK, COMPRESSION_NONE, false, true},
      {16, SAMPLEFORMAT_UINT, PHOTOMETRIC_MINISWHITE, COMPRESSION_PACKBITS, true, false},
      {32, SAMPLEFORMAT_IEEEFP, PHOTOMETRIC_MINISBLACK, COMPRESSION_NONE, false, true},
  };
  for (const kind *k = kinds; k < kinds + G_N_ELEMENTS(kinds); k++) {
    write_tiff("s.tif", k);
    g_autoptr(tc_volume) v = open_good("s.tif#spacing=0.5,0.25,2");
    check_dims(v, WIDTH, HEIGHT, PAGES);
    check_near(tc_volume_describe(v)->spacing, (double[]){0.5, 0.25, 2}, 3, 0);
    for (int i = 0; i < COUNT * PAGES; i++) {
      const unsigned n = value(i / COUNT, i % COUNT);
      double wanted = k->bits == 8 ? (uint8_t)n : k->bits == 32 ? (double)((float)n / 7) : n;
      if (k->format == SAMPLEFORMAT_INT) wanted = (int16_t)n;
      if (k->photometric == PHOTOMETRIC_MINISWHITE) wanted = 65535 - n;
      assert_true(voxel(v, (size_t)i) == wanted);
    }
  }
  char *path = path_of("s.tif"), *bytes;
  gsize size;
  assert_true(g_file_get_contents(path, &bytes, &size, NULL));
  for (gsize n = 4; n < size; n += size / 9) { /* never fewer slices in silence */
    write_file("cut.tif", bytes, n);
    open_bad("cut.tif", TC_ERROR_FORMAT, "TIFF");
  }
  g_free(bytes);
  g_free(path);
}

/* Greys of fewer than 8 bits, which libtiff widens. */
TEST(tiff_of_few_bits) {
  for (uint16_t bits = 1; bits <= 4; bits *= 4) {
    uint8_t row[16] = {0xf0, 0x01, 0x84}; /* the second row is 0 */
    g_autofree char *path = path_of("few.tif");
    TIFF *tiff = TIFFOpen(path, "w");
    assert_non_null(tiff);
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, 16);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, 2);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, bits);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 2);
    assert_true(TIFFWriteEncodedStrip(tiff, 0, row, 4 * bits) > 0);
    TIFFClose(tiff);
    g_autoptr(tc_volume) v = open_good("few.tif");
    check_dims(v, 16, 2, 1);
    for (int i = 0; i < 16; i++) {
      const int shift = 8 - bits - i * bits % 8;
      assert_true(voxel(v, (size_t)i) == (row[i * bits / 8] >> shift & ((1 << bits) - 1)) * 255 / ((1 << bits) - 1));
    }
    assert_true(!tc_volume_colors(v));
  }
}

static void write_png(const char *name, int width, int depth, int colour, const void *pixels, size_t size) {
  spng_ctx *png = spng_ctx_new(SPNG_CTX_ENCODER);
  struct spng_ihdr head = {
      .width = (uint32_t)width, .height = 2, .bit_depth = (uint8_t)depth, .color_type = (uint8_t)colour};
  int code;
  size_t length;
  spng_set_option(png, SPNG_ENCODE_TO_BUFFER, 1);
  spng_set_ihdr(png, &head);
  assert_int_equal(spng_encode_image(png, pixels, size, SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE), 0);
  void *bytes = spng_get_png_buffer(png, &length, &code);
  write_file(name, bytes, length);
  free(bytes);
  spng_ctx_free(png);
}

TEST(png_in_a_folder) {
  g_autofree char *folder = path_of("f/deep");
  assert_int_equal(g_mkdir_with_parents(folder, 0700), 0);
  for (int n = 8; n < 12; n++) {
    char name[40];
    g_snprintf(name, sizeof name, "f/deep/im%d.png", n);
    write_png(name, 3, 16, SPNG_COLOR_TYPE_GRAYSCALE, (uint16_t[]){(uint16_t)(n * 1000), 1, 2, 3, 4, 5}, 12);
  }
  write_text("f/readme.txt", "pictures");
  tc_volume *v = open_good("f");
  check_dims(v, 3, 2, 4);
  for (int z = 0; z < 4; z++)
    assert_true(voxel(v, (size_t)z * 6) == (8 + z) * 1000 && voxel(v, (size_t)z * 6 + 5) == 5);
  assert_non_null(strstr(tc_volume_describe(v)->note, "1 mm assumed"));
  tc_volume_unref(v);
  open_bad("f#spacing=1,2", TC_ERROR_INVALID, "spacing=X,Y,Z");
  open_bad("f#volume=2", TC_ERROR_NOT_FOUND, "holds 1");
  write_png("f/deep/im9.png", 2, 16, SPNG_COLOR_TYPE_GRAYSCALE, (uint16_t[]){1, 2, 3, 4}, 8);
  open_bad("f", TC_ERROR_FORMAT, "slice 2 of 4");
  write_png("c.png", 1, 8, SPNG_COLOR_TYPE_TRUECOLOR, (uint8_t[]){200, 100, 50, 7, 7, 7}, 6);
  v = open_good("c.png");
  assert_true(voxel(v, 0) == 118 && voxel(v, 1) == 7); /* 0.2126 * 200 + 0.7152 * 100 + 0.0722 * 50 */
  double label;
  assert_true(tc_volume_voxel(tc_volume_colors(v), (const int[3]){0, 0, 0}, &label));
  const float *color = tc_volume_segment(tc_volume_colors(v), (uint32_t)label)->color;
  assert_true(lroundf(color[0] * 255) == 200 && lroundf(color[1] * 255) == 100 && lroundf(color[2] * 255) == 50);
  tc_volume_unref(v);
}

/* A DICOMDIR names the folder it lies in, whatever is in it. */
TEST(dicomdir) {
  write_text("f/DICOMDIR", "any");
  write_png("f/deep/im9.png", 3, 16, SPNG_COLOR_TYPE_GRAYSCALE, (uint16_t[]){9000, 1, 2, 3, 4, 5}, 12);
  g_autoptr(tc_volume) v = open_good("f/DICOMDIR");
  check_dims(v, 3, 2, 4);
}

TESTS(make_folder, remove_folder)
