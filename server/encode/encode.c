#include "server/encode/encode.h"

#include <limits.h>
#include <spng.h>
#include <stdlib.h>
#include <string.h>
#include <turbojpeg.h>

extern char **environ;

/* From this quality on, 4:2:0 chroma subsampling is more visible than the quantisation. */
#define FULL_CHROMA_QUALITY 80

/* Largest scratch buffer kept between pictures. */
#define MOST_SCRATCH ((size_t)16 << 20)

struct tcs_encoder {
  tjhandle turbo;
  unsigned char *scratch; /* JPEG destination, or one PNG row */
  size_t scratch_size;
};

void tcs_encode_prepare_process(void) {
  char name[64];
  for (char **variable = environ; variable && *variable;) {
    size_t length = strcspn(*variable, "=");
    if (strncmp(*variable, "TJ_", 3) == 0 && length < sizeof name) {
      memcpy(name, *variable, length);
      name[length] = 0;
      unsetenv(name);
      variable = environ; /* unsetenv() shifted the array: start again */
    } else {
      variable++;
    }
  }
}

tcs_encoder *tcs_encoder_new(GError **error) {
  tcs_encoder *encoder = g_new0(tcs_encoder, 1);
  encoder->turbo = tjInitCompress();
  if (encoder->turbo) return encoder;
  tc_set_error(error, TC_ERROR_INTERNAL, NULL, "JPEG encoder: %s", tjGetErrorStr2(NULL));
  g_free(encoder);
  return NULL;
}

void tcs_encoder_free(tcs_encoder *encoder) {
  if (!encoder) return;
  tjDestroy(encoder->turbo);
  free(encoder->scratch);
  g_free(encoder);
}

const char *tcs_encode_content_type(tc_image_format format) {
  return format == TC_FORMAT_PNG ? "image/png" : "image/jpeg";
}

const char *tcs_encode_format_name(tc_image_format format) { return format == TC_FORMAT_PNG ? "png" : "jpeg"; }

static bool reserve(tcs_encoder *encoder, size_t size, GError **error) {
  if (size <= encoder->scratch_size) return true;
  free(encoder->scratch);
  encoder->scratch = malloc(size);
  encoder->scratch_size = encoder->scratch ? size : 0;
  if (!encoder->scratch) tc_set_error(error, TC_ERROR_MEMORY, NULL, "encode: no memory for %zu bytes", size);
  return encoder->scratch != NULL;
}

static bool is_grey_mode(tc_mode mode) {
  return mode == TC_MODE_MIP || mode == TC_MODE_MINIP || mode == TC_MODE_AVERAGE || mode == TC_MODE_MPR;
}

/* A coloured background or coloured labels over a grey projection keep the picture in colour, so test every pixel. */
static bool all_grey(const tc_frame *frame) {
  size_t count = (size_t)frame->width * (size_t)frame->height;
  const uint8_t *p = frame->rgba;
  for (size_t i = 0; i < count; i++, p += 4)
    if (p[0] != p[1] || p[1] != p[2]) return false;
  return true;
}

static int choose_subsampling(const tc_frame *frame, const tc_scene *scene, int quality) {
  if (is_grey_mode(scene->mode) && all_grey(frame)) return TJSAMP_GRAY;
  switch (scene->image.subsampling) {
  case TC_SUBSAMPLING_444: return TJSAMP_444;
  case TC_SUBSAMPLING_422: return TJSAMP_422;
  case TC_SUBSAMPLING_420: return TJSAMP_420;
  case TC_SUBSAMPLING_AUTO:
  case TC_SUBSAMPLING_COUNT: break;
  }
  return quality >= FULL_CHROMA_QUALITY ? TJSAMP_444 : TJSAMP_420;
}

static bool encode_jpeg(tcs_encoder *encoder, const tc_frame *frame, const tc_scene *scene, int quality,
                        GByteArray *out, GError **error) {
  if (scene->image.transparent) {
    tc_set_error(error, TC_ERROR_INVALID, "/image/background",
                 "image.background: JPEG has no transparency; use \"format\": \"png\" or a colour [r,g,b]");
    return false;
  }
  int subsampling = choose_subsampling(frame, scene, quality);
  unsigned long bound = tjBufSize(frame->width, frame->height, subsampling);
  if (bound == (unsigned long)-1) {
    tc_set_error(error, TC_ERROR_LIMIT, "/image", "image: %dx%d is too large for JPEG", frame->width, frame->height);
    return false;
  }
  if (!reserve(encoder, bound, error)) return false;
  unsigned char *bytes = encoder->scratch;
  unsigned long size = bound;
  if (tjCompress2(encoder->turbo, frame->rgba, frame->width, frame->width * 4, frame->height, TJPF_RGBX, &bytes, &size,
                  subsampling, quality, TJFLAG_ACCURATEDCT | TJFLAG_NOREALLOC) != 0) {
    tc_set_error(error, TC_ERROR_INTERNAL, NULL, "JPEG encoder: %s", tjGetErrorStr2(encoder->turbo));
    return false;
  }
  g_byte_array_append(out, bytes, (guint)size);
  return true;
}

static int append_png(spng_ctx *ctx, void *user, void *bytes, size_t size) {
  GByteArray *out = user;
  if (size > UINT_MAX - out->len) return SPNG_IO_ERROR;
  g_byte_array_append(out, bytes, (guint)size);
  return 0;
}

/* Compression level 1 with the "up" filter: rendered pictures are smooth, and costlier settings save few bytes. */
static int start_png(spng_ctx *png, const tc_frame *frame, bool alpha, GByteArray *out) {
  struct spng_ihdr header = {.width = (uint32_t)frame->width,
                             .height = (uint32_t)frame->height,
                             .bit_depth = 8,
                             .color_type = alpha ? SPNG_COLOR_TYPE_TRUECOLOR_ALPHA : SPNG_COLOR_TYPE_TRUECOLOR};
  int rc = spng_set_png_stream(png, append_png, out);
  if (!rc) rc = spng_set_option(png, SPNG_IMG_COMPRESSION_LEVEL, 1);
  if (!rc) rc = spng_set_option(png, SPNG_FILTER_CHOICE, SPNG_FILTER_CHOICE_UP);
  if (!rc) rc = spng_set_ihdr(png, &header);
  if (!rc) rc = spng_set_srgb(png, 0);
  if (!rc) rc = spng_encode_image(png, NULL, 0, SPNG_FMT_PNG, SPNG_ENCODE_PROGRESSIVE | SPNG_ENCODE_FINALIZE);
  return rc;
}

static int write_png_rows(spng_ctx *png, const tc_frame *frame, bool alpha, unsigned char *row) {
  size_t width = (size_t)frame->width, channels = alpha ? 4 : 3;
  int rc = 0;
  for (size_t y = 0; y < (size_t)frame->height && !rc; y++) {
    const uint8_t *pixel = frame->rgba + y * width * 4;
    if (alpha)
      memcpy(row, pixel, width * 4);
    else
      for (size_t x = 0; x < width; x++) memcpy(row + 3 * x, pixel + 4 * x, 3);
    rc = spng_encode_row(png, row, width * channels);
  }
  return rc == SPNG_EOI ? 0 : rc; /* SPNG_EOI after the last row */
}

static bool encode_png(tcs_encoder *encoder, const tc_frame *frame, const tc_scene *scene, GByteArray *out,
                       GError **error) {
  bool alpha = scene->image.transparent;
  if (!reserve(encoder, (size_t)frame->width * 4, error)) return false;
  spng_ctx *png = spng_ctx_new(SPNG_CTX_ENCODER);
  int rc = png ? start_png(png, frame, alpha, out) : SPNG_EMEM;
  if (!rc) rc = write_png_rows(png, frame, alpha, encoder->scratch);
  spng_ctx_free(png);
  if (!rc) return true;
  tc_set_error(error, rc == SPNG_EMEM ? TC_ERROR_MEMORY : TC_ERROR_INTERNAL, NULL, "PNG encoder: %s",
               spng_strerror(rc));
  return false;
}

bool tcs_encode(tcs_encoder *encoder, const tc_frame *frame, const tc_scene *scene, int quality_override,
                GByteArray *out, GError **error) {
  g_byte_array_set_size(out, 0);
  if (frame->width < 1 || frame->height < 1 || !frame->rgba) {
    tc_set_error(error, TC_ERROR_INTERNAL, NULL, "encode: the frame is empty");
    return false;
  }
  int quality = quality_override > 0 ? quality_override : scene->image.quality;
  quality = quality < 1 ? 1 : quality > 100 ? 100 : quality;
  bool done = scene->image.format == TC_FORMAT_PNG ? encode_png(encoder, frame, scene, out, error)
                                                   : encode_jpeg(encoder, frame, scene, quality, out, error);
  if (!done) g_byte_array_set_size(out, 0);
  if (encoder->scratch_size > MOST_SCRATCH) {
    g_clear_pointer(&encoder->scratch, free);
    encoder->scratch_size = 0;
  }
  return done;
}
