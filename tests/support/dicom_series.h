/* A small series of DICOM files in a temporary folder, read through the helper program. */
#ifndef TC_TESTS_DICOM_SERIES_H
#define TC_TESTS_DICOM_SERIES_H

#include "renderer/import/helper.h"
#include "tests/support/dicom_files.h"
#include "tests/support/test.h"

enum { COLUMNS = 6, ROWS = 4, PIXELS = COLUMNS * ROWS, SLICES = 9 };

static const tc_import_options with_helper = {.helpers = TC_BINARY_DIR};

/* Pixel i of slice z. */
static inline int16_t value_of(int z, int i) { return (int16_t)(100 * z + i - 300); }

static inline void fill(int16_t *pixels, int z) {
  for (int i = 0; i < PIXELS; i++)
    pixels[i] = value_of(z, i);
}

static inline void init(dicom_spec *s, int16_t *pixels) { dicom_spec_init(s, COLUMNS, ROWS, pixels, PIXELS * sizeof *pixels); }

/* Writes SLICES slices under names that say nothing about their order. */
static inline void write_series(const char *folder, const char *series, int series_number, int slices) {
  for (int k = 0; k < slices; k++) {
    int z = (k * 5 + 3) % slices; /* 5 and `slices` share no factor */
    int16_t pixels[PIXELS];
    char name[64];
    dicom_spec s;
    init(&s, pixels);
    fill(pixels, z);
    s.series = series;
    s.series_number = series_number;
    s.position[0] = -10;
    s.position[1] = 20;
    s.position[2] = 30 + 1.25 * z;
    s.instance = k + 1;
    snprintf(name, sizeof name, "%d_%02d", series_number, k);
    assert_true(dicom_write(folder, name, &s));
  }
}

/* Loads what must be refused; returns the code, and checks that the message is one clean line. */
static inline int refused(const char *path, const char *series) {
  g_autoptr(GError) error = NULL;
  tc_volume *v = tc_helper_load(TC_HELPER_DICOM, path, series, &with_helper, &error);
  if (v) fail_msg("loaded though it must not");
  assert_int_equal(error->domain, TC_ERROR);
  assert_null(strchr(error->message, '\n'));
  assert_null(strstr(error->message, "SECRET"));
  assert_null(strstr(error->message, path));
  int code = error->code;
  return code;
}

/* One file under a folder of its own; the caller removes the folder. */
static inline char *one_file(char **folder, const dicom_spec *s) {
  *folder = temp_folder();
  assert_true(dicom_write(*folder, "one", s));
  return g_build_filename(*folder, "one", NULL);
}

static inline void drop(char *folder, char *path) {
  remove_tree(folder);
  g_free(folder);
  g_free(path);
}

#endif
