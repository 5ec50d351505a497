/* Siemens mosaics: the slices of one time point side by side in one picture. They open as volumes at their true places, or
 * are refused. */
#include "tests/support/test.h"

#include "renderer/import/helper.h"
#include "tests/support/dicom_files.h"
#include "tests/support/scoped.h"

enum { TILE = 4, ACROSS = 3, SIDE = TILE * ACROSS, SLICES = 7, TIMES = 2 };

static const tc_import_options with_helper = {.helpers = TC_BINARY_DIR};

static double field(const double p[3], int time) { return 7 * p[0] + 5 * p[1] + 9 * p[2] + 1000 * time; }

static void csa_element(GByteArray *b, const char *name, const char *const *values, int count) {
  char text[64] = "";
  g_strlcpy(text, name, sizeof text);
  g_byte_array_append(b, (const uint8_t *)text, sizeof text);
  dicom_u32(b, 1);
  g_byte_array_append(b, (const uint8_t *)"FD\0\0", 4);
  dicom_u32(b, 4);
  dicom_u32(b, 6); /* values, most of them empty */
  dicom_u32(b, 77);
  for (int i = 0; i < 6; i++) {
    const uint32_t length = i < count ? (uint32_t)strlen(values[i]) + 1 : 0;
    for (int k = 0; k < 4; k++) dicom_u32(b, k == 2 ? 77 : length);
    char padded[16] = "";
    if (length) memcpy(padded, values[i], length);
    g_byte_array_append(b, (const uint8_t *)padded, (length + 3) / 4 * 4);
  }
}

static GByteArray *csa(const char *images, double normal) {
  GByteArray *b = g_byte_array_new();
  char z[16];
  snprintf(z, sizeof z, "%.8f", normal);
  g_byte_array_append(b, (const uint8_t *)"SV10\4\3\2\1", 8);
  dicom_u32(b, 3);
  dicom_u32(b, 77);
  csa_element(b, "EchoLinePosition", (const char *const[]){"64"}, 1);
  csa_element(b, "NumberOfImagesInMosaic", &images, 1);
  csa_element(b, "SliceNormalVector", (const char *const[]){"0.0", "0.0", z}, 3);
  return b;
}

/* Slices of 0.75 x 0.5 mm pixels, 2.5 mm apart, the first one's corner at (-20, 10, 5). */
static void write_time(const char *folder, int time, const char *images, double normal) {
  static int16_t pixels[SIDE * SIDE];
  char name[16];
  GByteArray *header = csa(images, normal);
  dicom_spec s;
  dicom_spec_init(&s, SIDE, SIDE, pixels, sizeof pixels);
  memset(pixels, 0, sizeof pixels);
  for (int n = 0; n < SLICES; n++)
    for (int i = 0; i < TILE * TILE; i++) {
      const double p[3] = {-20 + 0.75 * (i % TILE), 10 + 0.5 * (double)(i / TILE), 5 + normal * 2.5 * n};
      pixels[(n / ACROSS * TILE + i / TILE) * SIDE + n % ACROSS * TILE + i % TILE] = (int16_t)lround(field(p, time));
    }
  s.pixel_spacing = "0.5\\0.75";
  s.image_type = "ORIGINAL\\PRIMARY\\M\\ND\\MOSAIC";
  s.modality = "MR";
  s.intercept = "0";
  s.between = "2.5";
  s.instance = s.acquisition = time;
  s.position[0] = -20 - 0.75 * (SIDE - TILE) / 2;
  s.position[1] = 10 - 0.5 * (SIDE - TILE) / 2;
  s.position[2] = 5;
  s.csa = header->data;
  s.csa_bytes = header->len;
  snprintf(name, sizeof name, "%d", time);
  assert_true(dicom_write(folder, name, &s));
  g_byte_array_free(header, TRUE);
}

static void check_volume(const char *folder, int time) {
  char choice[16];
  GError *error = NULL;
  snprintf(choice, sizeof choice, "volume=%d", time);
  g_autoptr(tc_volume) v = tc_helper_load(TC_HELPER_DICOM, folder, choice, &with_helper, &error);
  if (!v) fail_msg("%s", error->message);
  const tc_volume_desc *d = tc_volume_describe(v);
  assert_int_equal(d->frames, TIMES);
  assert_true(d->dims[0] == TILE && d->dims[1] == TILE && d->dims[2] == SLICES);
  for (int i = 0; i < TILE * TILE * SLICES; i++) {
    double p[3], index[3] = {i % TILE, (double)(i / TILE % TILE), (double)(i / TILE / TILE)};
    tc_volume_index_to_lps(v, index, p);
    if (fabs(((const int16_t *)tc_volume_data(v))[i] - field(p, time)) > 0.51) fail_msg("time %d: voxel %d", time, i);
  }
}

TEST(slices_come_apart) {
  for (int up = 1; up >= -1; up -= 2) {
    g_autofree char *folder = temp_folder();
    for (int time = 1; time <= TIMES; time++) write_time(folder, time, "7", up);
    for (int time = 1; time <= TIMES; time++) check_volume(folder, time);
    remove_tree(folder);
  }
}

TEST(others_are_refused) {
  static const struct {
    const char *images;
    double normal;
  } cases[] = {{"17", 1}, {"0", 1}, {"x", 1}, {"7", 0.5}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    char *folder = temp_folder(), *path = g_build_filename(folder, "1", NULL);
    GError *error = NULL;
    write_time(folder, 1, cases[i].images, cases[i].normal);
    assert_null(tc_helper_load(TC_HELPER_DICOM, path, NULL, &with_helper, &error));
    assert_non_null(strstr(error->message, "convert it with dcm2niix"));
    g_clear_error(&error);
    remove_tree(folder);
    g_free(path);
    g_free(folder);
  }
}

TESTS(NULL, NULL)
