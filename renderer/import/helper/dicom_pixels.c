/* Converts decoded DICOM samples to voxels. */
#include "renderer/import/helper/dicom_pixels.h"

#include <math.h>
#include <string.h>

#include "renderer/volume/voxel.h"

bool tc_dicom_samples_valid(const tc_dicom_samples *s) {
  bool grey = s->colour == TC_DICOM_GREY;
  if (s->rows < 1 || s->columns < 1 || s->rows > 65535 || s->columns > 65535) return false;
  if (s->is_float) return grey && s->per_pixel == 1 && (s->allocated == 32 || s->allocated == 64);
  if (s->allocated == 1) return grey && s->per_pixel == 1;
  if (s->allocated != 8 && s->allocated != 16 && s->allocated != 32 && s->allocated != 64) return false;
  if (s->halved && (s->allocated != 8 || s->per_pixel != 3 || s->columns % 2 || s->colour != TC_DICOM_YBR))
    return false;
  if (s->stored < 1 || s->stored > s->allocated || s->high < s->stored - 1 || s->high >= s->allocated) return false;
  return grey ? s->per_pixel == 1 : (s->per_pixel == 3 || s->per_pixel == 4) && s->allocated <= 16;
}

uint64_t tc_dicom_frame_bytes(const tc_dicom_samples *s) {
  uint64_t bits = (uint64_t)s->rows * (uint64_t)s->columns * (uint64_t)s->per_pixel; /* below 2^35 */
  if (s->halved) bits -= bits / 3;
  return (bits * (uint64_t)s->allocated + 7) / 8;
}

tc_voxel_type tc_dicom_natural_type(const tc_dicom_samples *s) {
  if (s->is_float || (s->colour == TC_DICOM_GREY && s->stored > 16)) return TC_F32;
  if (s->colour != TC_DICOM_GREY || s->allocated == 1) return TC_U8;
  if (s->stored <= 8) return s->is_signed ? TC_I8 : TC_U8;
  return s->is_signed ? TC_I16 : TC_U16;
}

static uint64_t load(const uint8_t *at, int bytes) {
  uint64_t value = 0;
  for (int i = 0; i < bytes; i++) value |= (uint64_t)at[i] << (8 * i);
  return value;
}

/* Decodes one segment of run lengths: one byte of each pixel [count], written every `stride` bytes of `out`. */
static bool unpack_segment(const uint8_t *at, const uint8_t *end, uint8_t *out, size_t count, size_t stride) {
  while (count > 0) {
    if (end - at < 2) return false;
    const int code = (int8_t)*at++;
    if (code == -128) continue;
    const bool alike = code < 0;
    const size_t n = MIN(count, (size_t)(alike ? 1 - code : 1 + code)), stored = alike ? 1 : n;
    if ((size_t)(end - at) < stored) return false;
    for (size_t i = 0; i < n; i++) out[i * stride] = at[alike ? 0 : i];
    at += stored;
    out += n * stride;
    count -= n;
  }
  return true;
}

bool tc_dicom_run_lengths_fit(const tc_dicom_samples *s, const uint8_t *bytes, size_t size) {
  return size >= 64 && load(bytes, 4) == (uint64_t)(s->per_pixel * (s->allocated / 8));
}

bool tc_dicom_unpack(const tc_dicom_samples *s, const uint8_t *bytes, size_t size, uint8_t *out) {
  const size_t width = (size_t)s->allocated / 8, pixel = width * (size_t)s->per_pixel;
  if (s->allocated % 8 != 0 || pixel > 15 || !tc_dicom_run_lengths_fit(s, bytes, size)) return false;
  for (size_t i = 0; i < pixel; i++) { /* sample by sample, most significant byte first */
    const size_t from = load(bytes + 4 + 4 * i, 4), to = i / width * width + width - 1 - i % width;
    if (from < 64 || from > size) return false;
    if (!unpack_segment(bytes + from, bytes + size, out + to, (size_t)s->rows * (size_t)s->columns, pixel))
      return false;
  }
  return true;
}

/* Extracts the used bits of a sample and extends the sign. */
static int64_t integer_sample(const tc_dicom_samples *s, const uint8_t *at) {
  uint64_t value = load(at, s->allocated / 8) >> (s->high + 1 - s->stored);
  if (s->stored == 64) return (int64_t)value;
  value &= (UINT64_C(1) << s->stored) - 1;
  uint64_t sign = s->is_signed ? UINT64_C(1) << (s->stored - 1) : 0;
  return (int64_t)((value ^ sign) - sign);
}

static double sample(const tc_dicom_samples *s, const uint8_t *at) {
  if (s->is_float && s->allocated == 32) {
    uint32_t bits = (uint32_t)load(at, 4);
    float value;
    memcpy(&value, &bits, 4);
    return value;
  }
  if (s->is_float) {
    uint64_t bits = load(at, 8);
    double value;
    memcpy(&value, &bits, 8);
    return value;
  }
  int64_t value = integer_sample(s, at);
  return s->stored == 64 && !s->is_signed ? (double)(uint64_t)value : (double)value;
}

static double clamp(double value, double lo, double hi) { return value < lo ? lo : value > hi ? hi : value; }

static double luma(double r, double g, double b) { return 0.2126 * r + 0.7152 * g + 0.0722 * b; }

/* Converts Y Cb Cr with range 0..most to RGB (PS3.3, C.7.6.3.1.2). */
static void rgb_of_ybr(double c[3], double most) {
  const double half = floor(most / 2) + 1, y = c[0], cb = c[1] - half, cr = c[2] - half;
  c[0] = clamp(y + 1.402 * cr, 0, most);
  c[1] = clamp(y - 0.344136 * cb - 0.714136 * cr, 0, most);
  c[2] = clamp(y + 1.772 * cb, 0, most);
}

/* Red, green and blue of pixel i of a frame, in the range of its bits; grey in all three for a grey frame. */
static void color(const tc_dicom_frame *f, size_t pixels, size_t i, double c[3]) {
  const tc_dicom_samples *s = &f->samples;
  const uint8_t *bytes = f->bytes;
  size_t width = (size_t)s->allocated / 8;
  size_t step = s->planar ? pixels * width : width;
  const uint8_t *at = bytes + (s->planar ? i * width : i * width * (size_t)s->per_pixel);
  const uint8_t *second = at + step, *third = second + step;
  if (s->halved) at = bytes + i / 2 * 4 + i % 2, second = bytes + i / 2 * 4 + 2, third = second + 1;
  c[0] = c[1] = c[2] = sample(s, at);
  if (s->colour == TC_DICOM_GREY) return;
  c[1] = sample(s, second);
  c[2] = sample(s, third);
  if (s->colour == TC_DICOM_YBR) rgb_of_ybr(c, (double)(UINT64_C(1) << s->stored) - 1);
}

/* Grey value of pixel i of a frame. */
static double pixel(const tc_dicom_frame *f, size_t pixels, size_t i) {
  const tc_dicom_samples *s = &f->samples;
  double c[3];
  if (s->allocated == 1) {
    size_t bit = f->first_bit + i;
    return (f->bytes[bit / 8] >> (bit % 8)) & 1;
  }
  color(f, pixels, i, c);
  return s->colour == TC_DICOM_GREY ? c[0]
                                    : round(luma(c[0], c[1], c[2]) * 255 / ((double)(UINT64_C(1) << s->stored) - 1));
}

bool tc_dicom_colors(const tc_dicom_frame *f, uint8_t *rgb) {
  const tc_dicom_samples *s = &f->samples;
  const size_t pixels = (size_t)s->rows * (size_t)s->columns;
  const double most = (double)(UINT64_C(1) << s->stored) - 1;
  double c[3];
  if (f->size < tc_dicom_frame_bytes(s)) return false;
  for (size_t i = 0; i < pixels; i++) {
    color(f, pixels, i, c);
    for (int k = 0; k < 3; k++) rgb[3 * i + (size_t)k] = (uint8_t)clamp(round(c[k] * 255 / most), 0, 255);
  }
  return true;
}

static void store(tc_voxel_type type, void *voxels, size_t i, double value) {
  switch (type) {
  case TC_U8: ((uint8_t *)voxels)[i] = (uint8_t)clamp(value, 0, 255); break;
  case TC_I8: ((int8_t *)voxels)[i] = (int8_t)clamp(value, -128, 127); break;
  case TC_U16: ((uint16_t *)voxels)[i] = (uint16_t)clamp(value, 0, 65535); break;
  case TC_I16: ((int16_t *)voxels)[i] = (int16_t)clamp(value, -32768, 32767); break;
  case TC_F32: ((float *)voxels)[i] = (float)value; break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
}

/* Fast path for the usual 8- or 16-bit frame into its natural type. Returns false for other frames. */
static bool convert_plain(const tc_dicom_frame *f, size_t pixels, const tc_dicom_target *target, void *voxels) {
  const tc_dicom_samples *s = &f->samples;
  if (s->is_float || s->colour != TC_DICOM_GREY || target->type != tc_dicom_natural_type(s)) return false;
  if (s->allocated != 8 && s->allocated != 16) return false;
  if (s->stored == s->allocated) { /* all bits are used */
    memcpy(voxels, f->bytes, pixels * (size_t)s->allocated / 8);
    return true;
  }
  bool narrow = target->type == TC_U8 || target->type == TC_I8;
  for (size_t i = 0; i < pixels; i++) {
    int64_t value = integer_sample(s, f->bytes + i * (size_t)s->allocated / 8);
    if (narrow)
      ((uint8_t *)voxels)[i] = (uint8_t)value;
    else
      ((uint16_t *)voxels)[i] = (uint16_t)value;
  }
  return true;
}

/* Bytes of the frame, counted from its first bit. */
static uint64_t bytes_of(const tc_dicom_frame *f, size_t pixels) {
  return f->samples.allocated == 1 ? ((uint64_t)f->first_bit + pixels + 7) / 8 : tc_dicom_frame_bytes(&f->samples);
}

bool tc_dicom_convert(const tc_dicom_frame *f, const tc_dicom_target *target, void *voxels) {
  const tc_dicom_samples *s = &f->samples;
  size_t pixels = (size_t)s->rows * (size_t)s->columns;
  if (f->size < bytes_of(f, pixels)) return false;
  if (convert_plain(f, pixels, target, voxels)) return true;
  for (size_t i = 0; i < pixels; i++) {
    double value = pixel(f, pixels, i);
    store(target->type, voxels, i, target->rescale ? target->slope * value + target->intercept : value);
  }
  return true;
}

bool tc_dicom_look_up(const tc_dicom_frame *f, const uint16_t *table, size_t count, int32_t first, uint16_t *values) {
  const tc_dicom_samples *s = &f->samples;
  const size_t pixels = (size_t)s->rows * (size_t)s->columns, width = (size_t)s->allocated / 8;
  if (s->is_float || s->colour != TC_DICOM_GREY || (width != 1 && width != 2) || f->size < tc_dicom_frame_bytes(s))
    return false;
  for (size_t i = 0; i < pixels; i++) {
    const int64_t at = integer_sample(s, f->bytes + i * width) - first;
    values[i] = table[CLAMP(at, 0, (int64_t)count - 1)];
  }
  return true;
}

/* Stamps the set bits, 64 at a time, since most of a segmentation is empty. */
static void stamp_bits(const uint8_t *bytes, size_t pixels, unsigned first_bit, uint32_t segment, tc_overlaps *overlaps,
                       uint16_t *labels) {
  const size_t end = first_bit + pixels, size = (end + 7) / 8;
  for (size_t at = 0; at < size; at += 8) {
    uint64_t word = 0;
    memcpy(&word, bytes + at, size - at < 8 ? size - at : 8);
    word = GUINT64_FROM_LE(word);
    if (at == 0) word &= ~UINT64_C(0) << first_bit;
    for (; word; word &= word - 1) {
      const size_t bit = 8 * at + (size_t)__builtin_ctzll(word);
      if (bit >= end) break;
      uint16_t *label = &labels[bit - first_bit];
      *label = (uint16_t)tc_overlaps_label(overlaps, *label, segment);
    }
  }
}

bool tc_dicom_stamp(const tc_dicom_frame *f, double threshold, uint32_t segment, tc_overlaps *overlaps,
                    uint16_t *labels) {
  const tc_dicom_samples *s = &f->samples;
  const size_t pixels = (size_t)s->rows * (size_t)s->columns;
  if (f->size < bytes_of(f, pixels)) return false;
  if (s->allocated == 1) {
    stamp_bits(f->bytes, pixels, f->first_bit, segment, overlaps, labels);
    return true;
  }
  for (size_t i = 0; i < pixels; i++)
    if (pixel(f, pixels, i) >= threshold)
      labels[i] = (uint16_t)tc_overlaps_label(overlaps, labels[i], segment);
  return true;
}

bool tc_dicom_range(const tc_dicom_frame *f, double *lo, double *hi) {
  const tc_dicom_samples *s = &f->samples;
  if (f->size < tc_dicom_frame_bytes(s)) return false;
  const size_t pixels = (size_t)s->rows * (size_t)s->columns;
  for (size_t i = 0; i < pixels; i++) {
    double value = pixel(f, pixels, i);
    if (value < *lo) *lo = value;
    if (value > *hi) *hi = value;
  }
  return true;
}

void tc_dicom_mix_layers(tc_voxel_type type, const void *below, const void *above, double part, size_t count,
                         void *out) {
  for (size_t i = 0; i < count; i++) {
    double value = tc_voxel_at(type, below, i);
    if (part > 0)
      value = part < 1 ? (1 - part) * value + part * tc_voxel_at(type, above, i) : tc_voxel_at(type, above, i);
    store(type, out, i, type == TC_F32 ? value : floor(value + 0.5));
  }
}
