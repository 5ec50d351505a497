/* Valid pictures that other readers, or this one once, called damaged: without file meta, packed or turned in their
 * bytes, of one frame, without a place. Each comes out exactly, or is refused by its name. */
#include "tests/support/test.h"

#include "renderer/import/helper.h"
#include "tests/support/dicom_files.h"
#include "tests/support/scoped.h"

enum { COLUMNS = 6, ROWS = 4, PIXELS = COLUMNS * ROWS };

static tc_volume *try_bytes(GByteArray *bytes, GError **error) {
  g_autofree char *path = g_build_filename(folder, "one.dcm", NULL);
  assert_true(g_file_set_contents(path, (const char *)bytes->data, bytes->len, NULL));
  tc_volume *v = tc_import(path, &(tc_import_options){.helpers = TC_BINARY_DIR}, error);
  g_byte_array_free(bytes, TRUE);
  return v;
}

static tc_volume *open_bytes(const char *what, GByteArray *bytes) {
  GError *error = NULL;
  tc_volume *v = try_bytes(bytes, &error);
  if (!v) fail_msg("%s: %s", what, error->message);
  return v;
}

static void refuse_bytes(GByteArray *bytes, int code, const char *text) {
  g_autoptr(GError) error = NULL;
  assert_null(try_bytes(bytes, &error));
  if (error->code != code || !strstr(error->message, text)) fail_msg("[%d] %s", error->code, error->message);
}

/* Stored values are `pixels` of so many bits. */
static void check_pixels(const char *what, GByteArray *bytes, const uint32_t *pixels, double scale) {
  g_autoptr(tc_volume) v = open_bytes(what, bytes);
  const tc_volume_desc *d = tc_volume_describe(v);
  assert_true(d->dims[0] == COLUMNS && d->dims[1] == ROWS && d->dims[2] == 1);
  for (int i = 0; i < PIXELS; i++) {
    double value;
    assert_true(tc_volume_value_at(v, (double[]){i % COLUMNS, (double)(i / COLUMNS), 0}, &value));
    if (fabs(value - pixels[i] * scale) > 1e-6 * pixels[i] * scale) fail_msg("%s: pixel %d is %g", what, i, value);
  }
}

static dicom_spec spec_of(unsigned bits, unsigned samples, const void *pixels) {
  dicom_spec s;
  const unsigned allocated = bits <= 8 ? 8 : bits <= 16 ? 16 : 32;
  dicom_spec_init(&s, COLUMNS, ROWS, pixels, pixels ? PIXELS * samples * allocated / 8 : 0);
  s.allocated = allocated;
  s.stored = bits;
  s.high = bits - 1;
  s.is_signed = 0;
  s.samples = samples;
  s.intercept = "0";
  if (samples == 3) s.photometric = "RGB";
  return s;
}

/* ---- other ways to write the same elements ---- */

static uint32_t number_at(const uint8_t *at, size_t size) {
  uint32_t n = 0;
  for (size_t i = size; i-- > 0;) n = n << 8 | at[i];
  return n;
}

static size_t header_of(const uint8_t *element, uint32_t *size) {
  const bool wide = element[4] == 'O' || !memcmp(element + 4, "SQ", 2) || !memcmp(element + 4, "UN", 2);
  *size = number_at(element + (wide ? 8 : 6), wide ? 4 : 2);
  return wide ? 12 : 8;
}

/* What follows the file's meta information, which is 128 + 4 bytes and group 2. */
static GByteArray *data_set(GByteArray *whole) {
  size_t at = 132;
  for (uint32_t size; number_at(whole->data + at, 2) == 2; at += size) at += header_of(whole->data + at, &size);
  g_byte_array_remove_range(whole, 0, (guint)at);
  return whole;
}

/* Implicit VR: a tag, a length, a value. */
static GByteArray *implicit(GByteArray *set) {
  GByteArray *out = g_byte_array_new();
  for (size_t at = 0; at < set->len;) {
    uint32_t size;
    const size_t head = header_of(set->data + at, &size);
    g_byte_array_append(out, set->data + at, 4);
    dicom_u32(out, size);
    g_byte_array_append(out, set->data + at + head, size);
    at += head + size;
  }
  g_byte_array_free(set, TRUE);
  return out;
}

static void turn(uint8_t *at, size_t size) {
  for (size_t i = 0; i < size / 2; i++) {
    const uint8_t byte = at[i];
    at[i] = at[size - 1 - i];
    at[size - 1 - i] = byte;
  }
}

/* Big-endian: tags, lengths and numbers, of pixels as wide as they are. */
static GByteArray *turned(GByteArray *whole, size_t pixel) {
  uint32_t size;
  for (size_t at = 132; at < whole->len; at += size) {
    uint8_t *element = whole->data + at;
    const size_t head = header_of(element, &size), step = !memcmp(element + 4, "OW", 2) ? pixel : 2;
    const bool numbers = !memcmp(element + 4, "US", 2) || !memcmp(element + 4, "OW", 2);
    at += head;
    if (number_at(element, 2) == 2) continue;
    for (uint32_t i = 0; numbers && i + step <= size; i += (uint32_t)step) turn(element + head + i, step);
    turn(element, 2);
    turn(element + 2, 2);
    turn(element + (head == 12 ? 8 : 6), head == 12 ? 4 : 2);
  }
  return whole;
}

/* ---- pixels that are packed ---- */

/* Pixel data of one fragment, behind a header without any. */
static GByteArray *with_fragment(GByteArray *whole, GByteArray *fragment) {
  const uint16_t tags[] = {0x7fe0, 0x10};
  if (fragment->len % 2) g_byte_array_append(fragment, (const uint8_t *)"", 1);
  g_byte_array_append(whole, (const uint8_t *)tags, 4);
  g_byte_array_append(whole, (const uint8_t *)"OB\0\0\xff\xff\xff\xff\xfe\xff\0\xe0\0\0\0\0\xfe\xff\0\xe0", 20);
  dicom_u32(whole, fragment->len);
  g_byte_array_append(whole, fragment->data, fragment->len);
  g_byte_array_append(whole, (const uint8_t *)"\xfe\xff\xdd\xe0\0\0\0\0", 8);
  g_byte_array_free(fragment, TRUE);
  return whole;
}

/* Run lengths, all of them literal: a segment for each byte of a pixel, the highest first, colour by colour. */
static GByteArray *run_lengths(const uint32_t *pixels, unsigned bytes, unsigned samples) {
  GByteArray *out = g_byte_array_new();
  uint32_t head[16] = {bytes * samples};
  for (unsigned s = 0; s < bytes * samples; s++) head[s + 1] = 64 + s * (PIXELS + 2);
  g_byte_array_append(out, (const uint8_t *)head, sizeof head);
  for (unsigned s = 0; s < bytes * samples; s++) {
    g_byte_array_append(out, &(uint8_t){PIXELS - 1}, 1);
    for (int i = 0; i < PIXELS; i++)
      g_byte_array_append(
          out, &(uint8_t){(uint8_t)(pixels[i * (int)samples + (int)(s / bytes)] >> 8 * (bytes - 1 - s % bytes))}, 1);
    g_byte_array_append(out, (const uint8_t *)"\x80", 1); /* says nothing, and makes the segment even */
  }
  return out;
}

typedef struct bit_writer {
  GByteArray *out;
  uint32_t held;
  int count;
} bit_writer;

static void put_bits(bit_writer *w, uint32_t bits, int n) {
  for (; n > 0; n--) {
    w->held = w->held << 1 | (bits >> (n - 1) & 1);
    if (++w->count < 8) continue;
    g_byte_array_append(w->out, &(uint8_t){(uint8_t)w->held}, 1);
    if ((uint8_t)w->held == 0xff) g_byte_array_append(w->out, (const uint8_t *)"", 1);
    w->count = 0;
  }
}

/* JPEG, process 14, first-order prediction: each pixel is its difference to the one before it, or above. All 17 codes
 * have five bits. */
static GByteArray *lossless_jpeg(const uint32_t *pixels, int bits) {
  const uint8_t frame[] = {0xff, 0xd8, 0xff, 0xc3,    0,  11, (uint8_t)bits,
                           0,    ROWS, 0,    COLUMNS, 1,  1,  0x11,
                           0,    0xff, 0xc4, 0,       36, 0,  0,
                           0,    0,    0,    17,      0,  0,  0,
                           0,    0,    0,    0,       0,  0,  0,
                           0};
  const uint8_t scan[] = {0xff, 0xda, 0, 8, 1, 1, 0, 1, 0, 0};
  bit_writer w = {.out = g_byte_array_new()};
  g_byte_array_append(w.out, frame, sizeof frame);
  for (uint8_t i = 0; i < 17; i++) g_byte_array_append(w.out, &i, 1);
  g_byte_array_append(w.out, scan, sizeof scan);
  for (int i = 0; i < PIXELS; i++) {
    const uint32_t before = i == 0 ? 1u << (bits - 1) : i % COLUMNS ? pixels[i - 1] : pixels[i - COLUMNS];
    const int difference = (int16_t)(uint16_t)(pixels[i] - before);
    int category = 0;
    while (abs(difference) >> category) category++;
    put_bits(&w, (uint32_t)category, 5);
    if (category < 16)
      put_bits(&w, (uint32_t)(difference < 0 ? difference + (1 << category) - 1 : difference), category);
  }
  put_bits(&w, 0x7f, 7); /* the last byte is filled with ones */
  g_byte_array_append(w.out, (const uint8_t *)"\xff\xd9", 2);
  return w.out;
}

/* ---- tests ---- */

static void ramp(uint32_t *pixels, int n, unsigned bits) {
  for (int i = 0; i < n; i++)
    pixels[i] = (uint32_t)((uint64_t)i * 2654435761u >> 5) & (uint32_t)((UINT64_C(1) << bits) - 1);
}

TEST(without_file_meta) {
  uint32_t values[PIXELS];
  uint16_t pixels[PIXELS];
  ramp(values, PIXELS, 12);
  for (int i = 0; i < PIXELS; i++) pixels[i] = (uint16_t)values[i];
  const dicom_spec s = spec_of(12, 1, pixels);
  check_pixels("explicit", data_set(dicom_bytes(&s)), values, 1);
  check_pixels("implicit", implicit(data_set(dicom_bytes(&s))), values, 1);
}

/* Doses are of 32 bits; of one frame they are no other pictures than of several. */
TEST(doses_of_one_frame) {
  uint32_t values[PIXELS];
  ramp(values, PIXELS, 31);
  dicom_spec s = spec_of(32, 1, values);
  s.modality = "RTDOSE";
  s.dose = "1e-6";
  s.frames = "1";
  s.offsets = "0";
  check_pixels("plain", dicom_bytes(&s), values, 1e-6);
  s.syntax = ".2";
  check_pixels("big-endian", turned(dicom_bytes(&s), 4), values, 1e-6);
  s.syntax = ".5";
  s.pixels = NULL;
  check_pixels("run lengths", with_fragment(dicom_bytes(&s), run_lengths(values, 4, 1)), values, 1e-6);
}

/* Projections have no place, and often no spacing. */
TEST(lossless_jpeg_of_every_depth) {
  static const unsigned depths[] = {8, 10, 12, 14, 16};
  for (size_t i = 0; i < G_N_ELEMENTS(depths); i++) {
    uint32_t values[PIXELS];
    char what[32];
    ramp(values, PIXELS, depths[i]);
    dicom_spec s = spec_of(depths[i], 1, NULL);
    s.syntax = ".4.70";
    s.modality = i % 2 ? "MG" : "CR";
    s.has_position = false;
    s.orientation = s.pixel_spacing = NULL;
    snprintf(what, sizeof what, "%s of %u bits", s.modality, depths[i]);
    check_pixels(what, with_fragment(dicom_bytes(&s), lossless_jpeg(values, (int)depths[i])), values, 1);
  }
}

/* Some writers leave out the mark behind the last fragment, or lose a part of it. A fragment that is cut is none. */
TEST(packed_pixels_without_their_end) {
  uint32_t values[PIXELS];
  ramp(values, PIXELS, 8);
  for (int jpeg = 0; jpeg < 2; jpeg++)
    for (unsigned missing = 5; missing < 12; missing += 3) {
      dicom_spec s = spec_of(8, 1, NULL);
      s.syntax = jpeg ? ".4.70" : ".5";
      for (int again = 0; again < 2; again++) {
        GByteArray *bytes = with_fragment(dicom_bytes(&s), jpeg ? lossless_jpeg(values, 8) : run_lengths(values, 1, 1));
        g_byte_array_set_size(bytes, bytes->len - missing);
        if (missing > 8) {
          refuse_bytes(bytes, TC_ERROR_FORMAT, "cut");
        } else if (again) {
          check_pixels(s.syntax, bytes, values, 1);
        } else {
          tc_volume *v = open_bytes(s.syntax, bytes);
          assert_non_null(strstr(tc_volume_describe(v)->note, "1 slices lack the mark at the end"));
          tc_volume_unref(v);
        }
      }
    }
  dicom_spec s = spec_of(8, 1, NULL); /* the file ends between two frames */
  s.syntax = ".5";
  s.frames = "2";
  GByteArray *bytes = with_fragment(dicom_bytes(&s), run_lengths(values, 1, 1));
  g_byte_array_set_size(bytes, bytes->len - 8);
  refuse_bytes(bytes, TC_ERROR_FORMAT, "cut");
}

TEST(colours_in_run_lengths) {
  for (unsigned bits = 8; bits <= 16; bits += 8) {
    uint32_t values[3 * PIXELS];
    ramp(values, 3 * PIXELS, bits);
    dicom_spec s = spec_of(bits, 3, NULL);
    s.syntax = ".5";
    tc_volume *v = open_bytes("RGB", with_fragment(dicom_bytes(&s), run_lengths(values, bits / 8, 3)));
    for (int i = 0; i < PIXELS; i++) {
      const double luma = 0.2126 * values[3 * i] + 0.7152 * values[3 * i + 1] + 0.0722 * values[3 * i + 2];
      const double wanted = luma * 255 / ((1 << bits) - 1);
      assert_true(fabs(((const uint8_t *)tc_volume_data(v))[i] - wanted) <=
                  (bits == 8 ? 0.51 : 1.01)); /* wide ones are rounded twice */
    }
    tc_volume_unref(v);
    GByteArray *cut = run_lengths(values, bits / 8, 3), *outside = run_lengths(values, bits / 8, 3);
    g_byte_array_set_size(cut, cut->len - 4);
    outside->data[4 + 3] = 1; /* the first segment begins behind the file */
    refuse_bytes(with_fragment(dicom_bytes(&s), cut), TC_ERROR_FORMAT, "run lengths of frame 1");
    refuse_bytes(with_fragment(dicom_bytes(&s), outside), TC_ERROR_FORMAT, "run lengths of frame 1");
  }
}

/* Pixels that are alike are stored once; a code of -128 says nothing. */
TEST(runs_are_repeated) {
  uint32_t values[PIXELS] = {0};
  const uint8_t runs[] = {0x80, (uint8_t)(1 - PIXELS / 2), 7, PIXELS - PIXELS / 2 - 1};
  GByteArray *packed = run_lengths(values, 0, 0);
  ((uint32_t *)packed->data)[0] = 1, ((uint32_t *)packed->data)[1] = 64;
  g_byte_array_append(packed, runs, sizeof runs);
  for (int i = 0; i < PIXELS; i++) {
    values[i] = i < PIXELS / 2 ? 7 : (uint32_t)i;
    if (i >= PIXELS / 2) g_byte_array_append(packed, &(uint8_t){(uint8_t)i}, 1);
  }
  if (packed->len % 2) g_byte_array_append(packed, (const uint8_t *)"", 1);
  dicom_spec s = spec_of(8, 1, NULL);
  s.syntax = ".5";
  check_pixels("runs", with_fragment(dicom_bytes(&s), packed), values, 1);
}

/* Samples of 12 bits from -8 on stand for optical densities: those beyond the table's ends have its ends. */
TEST(lookup_tables_are_applied) {
  enum { ENTRIES = 20 };
  const uint16_t shape[3] = {ENTRIES, (uint16_t)-8, 16};
  uint16_t table[ENTRIES];
  int16_t pixels[PIXELS];
  uint32_t values[PIXELS];
  for (int i = 0; i < ENTRIES; i++) table[i] = (uint16_t)(60000 - i * i * 100);
  for (int i = 0; i < PIXELS; i++) {
    pixels[i] = (int16_t)(i - 10);
    values[i] = table[i < 2 ? 0 : i > ENTRIES + 1 ? ENTRIES - 1 : i - 2];
  }
  GByteArray *item = g_byte_array_new(), *sequence = g_byte_array_new();
  dicom_element(item, 0x28, 0x3002, "US", shape, sizeof shape);
  dicom_text(item, 0x28, 0x3004, "LO", "OD");
  dicom_element(item, 0x28, 0x3006, "OW", table, sizeof table);
  dicom_u32(sequence, 0xe000fffe);
  dicom_u32(sequence, item->len);
  g_byte_array_append(sequence, item->data, item->len);
  dicom_spec s = spec_of(12, 1, pixels);
  s.is_signed = 1;
  s.lookup = sequence;
  check_pixels("lookup table", dicom_bytes(&s), values, 1);
  tc_volume *v = open_bytes("lookup table", dicom_bytes(&s));
  assert_string_equal(tc_volume_describe(v)->unit, "OD");
  assert_non_null(strstr(tc_volume_describe(v)->note, "modality lookup table"));
  tc_volume_unref(v);
  g_byte_array_free(item, TRUE);
  g_byte_array_free(sequence, TRUE);
}

/* Of 16 bits a slice shows the nearest of eight. */
TEST(wide_colours_are_colours) {
  uint16_t pixels[3 * PIXELS];
  for (int i = 0; i < PIXELS; i++) pixels[3 * i] = 51 * 257, pixels[3 * i + 1] = 65535, pixels[3 * i + 2] = 300;
  dicom_spec s = spec_of(16, 3, pixels);
  g_autoptr(tc_volume) v = open_bytes("RGB", dicom_bytes(&s));
  size_t count;
  const tc_segment *color = tc_volume_segments(tc_volume_colors(v), &count);
  assert_int_equal(count, 1);
  assert_true(lroundf(color->color[0] * 255) == 51 && lroundf(color->color[1] * 255) == 255 &&
              lroundf(color->color[2] * 255) == 1);
  assert_int_equal(((const uint8_t *)tc_volume_data(v))[0], 193); /* .2126 * 51 + .7152 * 255 + .0722 */
}

TEST(an_absurd_place) {
  const uint16_t pixels[PIXELS] = {0, 1};
  dicom_spec s = spec_of(16, 1, pixels);
  s.position[1] = 1e12;
  refuse_bytes(dicom_bytes(&s), TC_ERROR_FORMAT, "absurd");
}

TESTS(make_folder, remove_folder)
