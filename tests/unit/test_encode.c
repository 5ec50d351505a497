/* Frames to JPEG and PNG: decoded again by the libraries and compared. */
#include "tests/support/test.h"

#include <spng.h>
#include <turbojpeg.h>

#include "server/encode/encode.h"

enum { WIDTH = 67, HEIGHT = 45 }; /* no multiple of a block */

typedef struct fixture {
  tc_scene scene;
  tc_frame frame;
  tcs_encoder *encoder;
  GByteArray *out;
} fixture;

/* A smooth picture: JPEG must keep it well. Alpha follows x. */
static void fill(tc_frame *frame, bool grey) {
  for (int y = 0; y < HEIGHT; y++)
    for (int x = 0; x < WIDTH; x++) {
      uint8_t *p = frame->rgba + 4 * (y * WIDTH + x);
      p[0] = (uint8_t)(255 * x / (WIDTH - 1));
      p[1] = grey ? p[0] : (uint8_t)(255 * y / (HEIGHT - 1));
      p[2] = grey ? p[0] : (uint8_t)(255 - p[0] / 2);
      p[3] = (uint8_t)(x * 3);
    }
}

static int set_up(void **state) {
  fixture *f = g_new0(fixture, 1);
  tc_scene_init(&f->scene);
  f->frame.width = WIDTH;
  f->frame.height = HEIGHT;
  f->frame.rgba = malloc(WIDTH * HEIGHT * 4); /* exact: an over-read is seen by the sanitiser */
  fill(&f->frame, false);
  f->encoder = tcs_encoder_new(NULL);
  f->out = g_byte_array_new();
  *state = f;
  return f->encoder && f->frame.rgba ? 0 : 1;
}

static int tear_down(void **state) {
  fixture *f = *state;
  tc_scene_clear(&f->scene);
  free(f->frame.rgba);
  tcs_encoder_free(f->encoder);
  g_byte_array_free(f->out, TRUE);
  g_free(f);
  return 0;
}

static void encode(fixture *f, int quality) {
  GError *error = NULL;
  if (!tcs_encode(f->encoder, &f->frame, &f->scene, quality, f->out, &error)) fail_msg("%s", error->message);
}

typedef struct jpeg {
  int width, height, subsampling, colorspace, worst;
} jpeg;

static jpeg decode_jpeg(fixture *f) {
  static uint8_t pixels[WIDTH * HEIGHT * 4];
  jpeg j = {0};
  tjhandle turbo = tjInitDecompress();
  assert_int_equal(
      tjDecompressHeader3(turbo, f->out->data, f->out->len, &j.width, &j.height, &j.subsampling, &j.colorspace), 0);
  assert_int_equal(j.width, WIDTH);
  assert_int_equal(j.height, HEIGHT);
  assert_int_equal(
      tjDecompress2(turbo, f->out->data, f->out->len, pixels, WIDTH, 0, HEIGHT, TJPF_RGBX, TJFLAG_ACCURATEDCT), 0);
  for (int i = 0; i < WIDTH * HEIGHT * 4; i++)
    if (i % 4 != 3) j.worst = MAX(j.worst, abs(pixels[i] - f->frame.rgba[i]));
  tjDestroy(turbo);
  return j;
}

TEST_WITH(jpeg_keeps_the_picture, set_up, tear_down) {
  fixture *f = *state;
  f->scene.image.subsampling = TC_SUBSAMPLING_444;
  encode(f, 95);
  jpeg j = decode_jpeg(f);
  assert_int_equal(j.subsampling, TJSAMP_444);
  if (j.worst > 10) fail_msg("a pixel is %d levels off", j.worst);
}

TEST_WITH(subsampling_follows_quality, set_up, tear_down) {
  fixture *f = *state;
  static const struct {
    tc_subsampling asked;
    int quality, got;
  } cases[] = {{TC_SUBSAMPLING_AUTO, 80, TJSAMP_444}, {TC_SUBSAMPLING_AUTO, 79, TJSAMP_420},
               {TC_SUBSAMPLING_AUTO, 0, TJSAMP_444},  {TC_SUBSAMPLING_422, 95, TJSAMP_422},
               {TC_SUBSAMPLING_420, 95, TJSAMP_420},  {TC_SUBSAMPLING_444, 20, TJSAMP_444}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    f->scene.image.subsampling = cases[i].asked;
    encode(f, cases[i].quality);
    assert_int_equal(decode_jpeg(f).subsampling, cases[i].got);
  }
}

TEST_WITH(quality_override_counts, set_up, tear_down) {
  fixture *f = *state;
  encode(f, 95);
  guint large = f->out->len;
  encode(f, 30);
  guint small = f->out->len;
  f->scene.image.quality = 30;
  encode(f, 0);
  assert_true(small < large);
  assert_int_equal(f->out->len, small);
}

TEST_WITH(grey_pictures_of_grey_modes_are_grey, set_up, tear_down) {
  fixture *f = *state;
  fill(&f->frame, true);
  static const struct {
    tc_mode mode;
    bool grey;
  } cases[] = {
      {TC_MODE_MIP, true}, {TC_MODE_MINIP, true}, {TC_MODE_AVERAGE, true}, {TC_MODE_MPR, true}, {TC_MODE_DVR, false}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    f->scene.mode = cases[i].mode;
    encode(f, 95);
    jpeg j = decode_jpeg(f);
    assert_int_equal(j.colorspace == TJCS_GRAY, cases[i].grey);
    if (j.worst > 4) fail_msg("mode %d: a pixel is %d levels off", cases[i].mode, j.worst);
  }
  f->scene.mode = TC_MODE_MIP;
  f->frame.rgba[4 * (WIDTH * HEIGHT - 1)] ^= 1; /* one coloured pixel, the last */
  encode(f, 95);
  assert_int_equal(decode_jpeg(f).colorspace, TJCS_YCbCr);
}

/* [count][channels], freed by the caller */
static uint8_t *decode_png(fixture *f, int color_type) {
  spng_ctx *png = spng_ctx_new(0);
  struct spng_ihdr header;
  size_t size;
  int format = color_type == SPNG_COLOR_TYPE_TRUECOLOR_ALPHA ? SPNG_FMT_RGBA8 : SPNG_FMT_RGB8;
  assert_int_equal(spng_set_png_buffer(png, f->out->data, f->out->len), 0);
  assert_int_equal(spng_get_ihdr(png, &header), 0);
  assert_int_equal(header.width, WIDTH);
  assert_int_equal(header.height, HEIGHT);
  assert_int_equal(header.bit_depth, 8);
  assert_int_equal(header.color_type, color_type);
  assert_int_equal(spng_decoded_image_size(png, format, &size), 0);
  uint8_t *pixels = g_malloc(size);
  assert_int_equal(spng_decode_image(png, pixels, size, format, 0), 0);
  spng_ctx_free(png);
  return pixels;
}

TEST_WITH(png_is_exact, set_up, tear_down) {
  fixture *f = *state;
  f->scene.image.format = TC_FORMAT_PNG;
  encode(f, 0);
  g_autofree uint8_t *pixels = decode_png(f, SPNG_COLOR_TYPE_TRUECOLOR);
  for (int i = 0; i < WIDTH * HEIGHT; i++)
    assert_memory_equal(pixels + 3 * i, f->frame.rgba + 4 * i, 3);
}

TEST_WITH(transparent_png_is_exact, set_up, tear_down) {
  fixture *f = *state;
  f->scene.image.format = TC_FORMAT_PNG;
  f->scene.image.transparent = true;
  encode(f, 0);
  g_autofree uint8_t *pixels = decode_png(f, SPNG_COLOR_TYPE_TRUECOLOR_ALPHA);
  assert_memory_equal(pixels, f->frame.rgba, WIDTH * HEIGHT * 4);
}

TEST_WITH(refuses_transparent_jpeg, set_up, tear_down) {
  fixture *f = *state;
  g_autoptr(GError) error = NULL;
  f->scene.image.transparent = true;
  g_byte_array_append(f->out, (const guint8 *)"old", 3);
  assert_false(tcs_encode(f->encoder, &f->frame, &f->scene, 0, f->out, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_INVALID));
  assert_string_equal(tc_error_pointer(error), "/image/background");
  assert_int_equal(f->out->len, 0);
}

/* One encoder, pictures of growing and shrinking size: the scratch buffer must follow. */
TEST_WITH(sizes_change, set_up, tear_down) {
  fixture *f = *state;
  for (int i = 0; i < 6; i++) {
    static const int sizes[6][2] = {{1, 1}, {WIDTH, HEIGHT}, {1, HEIGHT}, {WIDTH, 1}, {2, 2}, {WIDTH, HEIGHT}};
    f->frame.width = sizes[i][0];
    f->frame.height = sizes[i][1];
    f->scene.image.format = TC_FORMAT_JPEG;
    encode(f, 85);
    assert_memory_equal(f->out->data, "\xff\xd8", 2);
    f->scene.image.format = TC_FORMAT_PNG;
    encode(f, 0);
    assert_memory_equal(f->out->data, "\x89PNG", 4);
  }
  f->frame.width = 0;
  assert_false(tcs_encode(f->encoder, &f->frame, &f->scene, 0, f->out, NULL));
}

/* TJ_PROGRESSIVE and its kin would change what is written behind our back. */
TEST(environment_is_cleaned) {
  setenv("TJ_RESTART", "1", 1);
  setenv("TJ_PROGRESSIVE", "1", 1);
  setenv("TJX", "stays", 1);
  tcs_encode_prepare_process();
  assert_null(getenv("TJ_RESTART"));
  assert_null(getenv("TJ_PROGRESSIVE"));
  assert_string_equal(getenv("TJX"), "stays");
}

TESTS(NULL, NULL)
