/* DICOM end to end: files made here, through the real helper process. */
#include "tests/support/dicom_series.h"
#include <unistd.h>

#include "renderer/import/links.h"
#include "tests/support/scoped.h"

static tc_volume *load(const char *path, const char *series) {
  GError *error = NULL;
  tc_volume *v = tc_helper_load(TC_HELPER_DICOM, path, series, &with_helper, &error);
  if (!v) fail_msg("%s", error->message);
  return v;
}

static void check_series(const tc_volume *v, int slices) {
  const tc_volume_desc *d = tc_volume_describe(v);
  assert_int_equal(d->dims[0], COLUMNS);
  assert_int_equal(d->dims[1], ROWS);
  assert_int_equal(d->dims[2], slices);
  assert_int_equal(d->type, TC_I16);
  assert_true(d->spacing[0] == 0.75 && d->spacing[1] == 0.5 && fabs(d->spacing[2] - 1.25) < 1e-9);
  assert_true(d->origin[0] == -10 && d->origin[1] == 20 && d->origin[2] == 30);
  assert_true(d->slope == 1 && d->intercept == -1024);
  assert_string_equal(d->modality, "CT");
  assert_string_equal(d->unit, "HU");
  assert_string_equal(d->format, "dicom");
  const int16_t *voxels = tc_volume_data(v);
  for (int z = 0; z < slices; z++)
    for (int i = 0; i < PIXELS; i++)
      assert_int_equal(voxels[z * PIXELS + i], value_of(z, i));
}

TEST(a_shuffled_folder) {
  char *folder = temp_folder(), *below = g_build_filename(folder, "a", "b", NULL);
  g_mkdir_with_parents(below, 0700);
  write_series(below, "1.2.3.1", 1, SLICES);
  char *junk = g_build_filename(folder, "notes.txt", NULL), *link = g_build_filename(folder, "link", NULL);
  g_file_set_contents(junk, "not DICOM at all", -1, NULL);
  assert_int_equal(symlink(below, link), 0); /* links are not followed: slices would come twice */
  assert_true(tc_helper_for(junk) == TC_HELPER_FORMATS);
  tc_volume *v = load(folder, NULL);
  check_series(v, SLICES);
  assert_int_equal(tc_volume_describe(v)->frames, 1);
  tc_volume_unref(v);
  remove_tree(folder);
  g_free(junk);
  g_free(link);
  g_free(below);
  g_free(folder);
}

/* Links to files, as git-annex and DataLad lay a folder out; what leads out of the folder and its annex is not read. */
TEST(a_folder_of_links) {
  char *repository = temp_folder(), *outside = temp_folder(), *objects, *folder;
  objects = g_build_filename(repository, ".git", "annex", "objects", "x1", NULL);
  folder = g_build_filename(repository, "sub", "series", NULL);
  g_mkdir_with_parents(objects, 0700);
  g_mkdir_with_parents(folder, 0700);
  write_series(objects, "1.2.3.1", 1, SLICES);
  write_series(outside, "1.2.3.1", 1, SLICES + 1);
  for (int k = 0; k < SLICES; k++) {
    char name[64], target[96];
    snprintf(name, sizeof name, "%s/1_%02d", folder, k);
    snprintf(target, sizeof target, "../../.git/annex/objects/x1/1_%02d", k);
    assert_int_equal(symlink(target, name), 0);
  }
  char *foreign = g_build_filename(outside, "1_09", NULL), *link = g_build_filename(folder, "foreign", NULL);
  assert_int_equal(symlink(foreign, link), 0);
  tc_volume *v = load(folder, NULL);
  check_series(v, SLICES);
  assert_non_null(strstr(tc_volume_describe(v)->note, "1 unreadable files left out"));
  tc_volume_unref(v);
  const char *roots[] = {outside};
  assert_true(tc_links_set(roots, 1, NULL));
  assert_int_equal(refused(folder, NULL), TC_ERROR_FORMAT); /* it is read now: a slice too many at its place */
  assert_true(tc_links_set(NULL, 0, NULL));
  char *git = g_build_filename(repository, ".git", NULL), *moved = g_build_filename(repository, "git", NULL);
  assert_int_equal(g_unlink(link), 0);
  assert_int_equal(g_rename(git, moved), 0); /* links that lead nowhere */
  assert_int_equal(refused(folder, NULL), TC_ERROR_FORMAT);
  remove_tree(repository);
  remove_tree(outside);
  g_free(git);
  g_free(moved);
  g_free(foreign);
  g_free(link);
  g_free(objects);
  g_free(folder);
  g_free(repository);
  g_free(outside);
}

/* One file packed by gzip, known by its name; cut, it is refused. */
TEST(a_packed_file) {
  int16_t pixels[PIXELS];
  dicom_spec s;
  char *folder = temp_folder(), *path = g_build_filename(folder, "a.dcm.gz", NULL);
  GError *error = NULL;
  init(&s, pixels);
  fill(pixels, 0);
  GByteArray *plain = dicom_bytes(&s);
  uint8_t packed[4096];
  z_stream z = {.next_in = plain->data, .avail_in = plain->len, .next_out = packed, .avail_out = sizeof packed};
  assert_true(deflateInit2(&z, 9, Z_DEFLATED, MAX_WBITS + 16, 8, 0) == Z_OK && deflate(&z, Z_FINISH) == Z_STREAM_END);
  assert_true(g_file_set_contents(path, (const char *)packed, (gssize)z.total_out, NULL));
  tc_volume *v = tc_import(path, &with_helper, &error);
  if (!v) fail_msg("%s", error->message);
  for (int i = 0; i < PIXELS; i++) assert_int_equal(((const int16_t *)tc_volume_data(v))[i], value_of(0, i));
  tc_volume_unref(v);
  for (unsigned cut = 1; cut < 40; cut += 6) {
    assert_true(g_file_set_contents(path, (const char *)packed, (gssize)(z.total_out - cut), NULL));
    assert_null(tc_import(path, &with_helper, &error));
    g_clear_error(&error);
  }
  deflateEnd(&z);
  g_byte_array_free(plain, TRUE);
  drop(folder, path);
}

TEST(two_series) {
  g_autofree char *folder = temp_folder();
  write_series(folder, "1.2.3.20", 2, SLICES);
  write_series(folder, "1.2.3.10", 1, 4);
  tc_series *series;
  size_t count;
  assert_true(tc_helper_list(folder, &with_helper, &series, &count, NULL));
  assert_int_equal(count, 2);
  assert_string_equal(series[0].uid, "1.2.3.10");
  assert_string_equal(series[1].uid, "1.2.3.20");
  assert_string_equal(series[0].label, "series 1");
  assert_string_equal(series[0].modality, "CT");
  assert_int_equal(series[0].files, 4);
  assert_int_equal(series[1].frames, SLICES);
  assert_int_equal(series[1].rows, ROWS);
  assert_int_equal(series[1].columns, COLUMNS);
  g_free(series);
  static const struct {
    const char *suffix;
    int slices;
  } picks[] = {{NULL, SLICES}, {"1", 4}, {"2", SLICES}, {"1.2.3.10", 4}};
  for (size_t i = 0; i < G_N_ELEMENTS(picks); i++) {
    g_autoptr(tc_volume) v = load(folder, picks[i].suffix);
    check_series(v, picks[i].slices);
    if (i == 0) assert_non_null(strstr(tc_volume_describe(v)->note, "2 series"));
  }
  assert_int_equal(refused(folder, "3"), TC_ERROR_NOT_FOUND);
  assert_int_equal(refused(folder, "9.9.9"), TC_ERROR_NOT_FOUND);
  remove_tree(folder);
}

TEST(a_zip) {
  char *folder = temp_folder(), *path = g_build_filename(folder, "study.zip", NULL),
       *series = g_build_filename(folder, "s", NULL);
  g_mkdir_with_parents(series, 0700);
  write_series(series, "1.2.3.1", 1, SLICES);
  zip_writer z = zip_start();
  GDir *dir = g_dir_open(series, 0, NULL);
  unsigned method = 0;
  for (const char *name; (name = g_dir_read_name(dir)); method = 8 - method) {
    char *bytes, *file = g_build_filename(series, name, NULL), *inside = g_strconcat("../../", name, NULL);
    gsize size;
    assert_true(g_file_get_contents(file, &bytes, &size, NULL));
    zip_add(&z, inside, bytes, size, method);
    g_free(bytes);
    g_free(file);
    g_free(inside);
  }
  g_dir_close(dir);
  zip_add(&z, "readme.txt", "hello", 5, 0);
  GByteArray *b = zip_end(&z);
  g_file_set_contents(path, (const char *)b->data, b->len, NULL);
  assert_true(tc_helper_for(path) == TC_HELPER_DICOM);
  tc_volume *v = load(path, NULL);
  check_series(v, SLICES);
  tc_volume_unref(v);
  g_file_set_contents(path, (const char *)b->data, b->len / 2, NULL);
  assert_int_equal(refused(path, NULL), TC_ERROR_FORMAT);
  g_byte_array_free(b, TRUE);
  remove_tree(folder);
  g_free(path);
  g_free(series);
  g_free(folder);
}

TEST(an_oblique_slice) {
  int16_t pixels[PIXELS];
  dicom_spec s;
  init(&s, pixels);
  fill(pixels, 0);
  s.orientation = "0.6\\0.8\\0\\-0.48\\0.36\\0.8";
  char *folder, *path = one_file(&folder, &s);
  tc_volume *v = load(path, NULL);
  static const double want[9] = {0.6, -0.48, 0.64, 0.8, 0.36, -0.48, 0, 0.8, 0.6};
  for (int i = 0; i < 9; i++)
    assert_true(fabs(tc_volume_describe(v)->direction[i] - want[i]) < 1e-12);
  tc_volume_unref(v);
  drop(folder, path);
}

TEST(frames_of_one_file) {
  int16_t pixels[3 * PIXELS];
  dicom_spec s;
  init(&s, pixels);
  for (int z = 0; z < 3; z++)
    fill(pixels + z * PIXELS, z);
  s.pixel_bytes = sizeof pixels;
  s.frames = "3";
  s.position[2] = 5;
  s.offsets = "0\\2.5\\5";
  char *folder, *path = one_file(&folder, &s);
  tc_volume *v = load(path, NULL);
  const tc_volume_desc *d = tc_volume_describe(v);
  assert_int_equal(d->dims[2], 3);
  assert_true(d->spacing[2] == 2.5 && d->origin[2] == 5);
  assert_memory_equal(tc_volume_data(v), pixels, sizeof pixels);
  tc_volume_unref(v);
  s.offsets = NULL;
  s.between = "4";
  assert_true(dicom_write(folder, "one", &s));
  v = load(path, NULL);
  assert_true(tc_volume_describe(v)->spacing[2] == 4);
  tc_volume_unref(v);
  drop(folder, path);
}

TEST(tiles_are_no_volume) {
  int16_t pixels[3 * PIXELS] = {0};
  dicom_spec s;
  init(&s, pixels);
  s.pixel_bytes = sizeof pixels;
  s.frames = "3";
  s.whole_columns = 3 * COLUMNS;
  char *folder, *path = one_file(&folder, &s);
  assert_int_equal(refused(path, NULL), TC_ERROR_UNSUPPORTED);
  s.whole_columns = COLUMNS;
  assert_true(dicom_write(folder, "one", &s));
  tc_volume_unref(load(path, NULL));
  drop(folder, path);
}

TEST(different_slopes_become_float) {
  g_autofree char *folder = temp_folder();
  int16_t pixels[PIXELS];
  static const char *const slopes[2] = {"0.5", "2"};
  for (int z = 0; z < 2; z++) {
    dicom_spec s;
    init(&s, pixels);
    fill(pixels, z);
    s.modality = "PT";
    s.slope = slopes[z];
    s.intercept = "1";
    s.position[2] = 3 * z;
    assert_true(dicom_write(folder, slopes[z], &s));
  }
  tc_volume *v = load(folder, NULL);
  const tc_volume_desc *d = tc_volume_describe(v);
  assert_int_equal(d->type, TC_F32);
  assert_true(d->slope == 1 && d->intercept == 0);
  assert_non_null(strstr(d->note, "rescale"));
  const float *f = tc_volume_data(v);
  for (int z = 0; z < 2; z++)
    for (int i = 0; i < PIXELS; i++)
      assert_true(f[z * PIXELS + i] == (float)(value_of(z, i) * (z ? 2.0 : 0.5) + 1));
  tc_volume_unref(v);
  remove_tree(folder);
}

TEST(what_is_missing_is_said) {
  int16_t pixels[PIXELS];
  dicom_spec s;
  init(&s, pixels);
  fill(pixels, 0);
  s.pixel_spacing = s.orientation = NULL;
  s.has_position = false;
  s.photometric = "MONOCHROME1";
  char *folder, *path = one_file(&folder, &s);
  tc_volume *v = load(path, NULL);
  const tc_volume_desc *d = tc_volume_describe(v);
  for (int k = 0; k < 3; k++)
    assert_true(d->spacing[k] == 1);
  assert_non_null(strstr(d->note, "pixel spacing unknown"));
  assert_non_null(strstr(d->note, "MONOCHROME1"));
  assert_int_equal(((const int16_t *)tc_volume_data(v))[0], value_of(0, 0)); /* not inverted */
  tc_volume_unref(v);
  drop(folder, path);
}

TEST(wide_integers_are_narrowed) {
  int32_t pixels[PIXELS];
  dicom_spec s;
  dicom_spec_init(&s, COLUMNS, ROWS, pixels, sizeof pixels);
  for (int i = 0; i < PIXELS; i++)
    pixels[i] = i * 1000 - 5;
  s.allocated = s.stored = 32;
  s.high = 31;
  char *folder, *path = one_file(&folder, &s);
  tc_volume *v = load(path, NULL);
  assert_int_equal(tc_volume_describe(v)->type, TC_I16);
  for (int i = 0; i < PIXELS; i++)
    assert_int_equal(((const int16_t *)tc_volume_data(v))[i], pixels[i]);
  tc_volume_unref(v);
  pixels[3] = 70000;
  assert_true(dicom_write(folder, "one", &s));
  v = load(path, NULL);
  assert_int_equal(tc_volume_describe(v)->type, TC_F32);
  assert_true(((const float *)tc_volume_data(v))[3] == 70000);
  tc_volume_unref(v);
  drop(folder, path);
}

TEST(colour_becomes_luma) {
  uint8_t pixels[PIXELS * 3];
  dicom_spec s;
  dicom_spec_init(&s, COLUMNS, ROWS, pixels, sizeof pixels);
  for (int i = 0; i < PIXELS * 3; i++)
    pixels[i] = i % 3 == 1 ? 200 : 0;
  s.allocated = s.stored = 8;
  s.high = 7;
  s.is_signed = 0;
  s.samples = 3;
  s.photometric = "RGB";
  char *folder, *path = one_file(&folder, &s);
  tc_volume *v = load(path, NULL);
  assert_int_equal(tc_volume_describe(v)->type, TC_U8);
  for (int i = 0; i < PIXELS; i++)
    assert_int_equal(((const uint8_t *)tc_volume_data(v))[i], 143); /* 0.7152 * 200 */
  size_t count;
  const tc_segment *color = tc_volume_segments(tc_volume_colors(v), &count);
  assert_true(count == 1 && color->color[0] == 0 && fabsf(color->color[1] * 255 - 200) < 1e-3f && color->color[2] == 0);
  tc_volume_unref(v);
  drop(folder, path);
}

/* One picture in both ways of writing colours: one grey, to the rounding of the eight bits. */
TEST(ybr_has_the_greys_of_rgb) {
  uint8_t rgb[PIXELS * 3], ybr[PIXELS * 3];
  for (int i = 0; i < PIXELS; i++) {
    const double c[3] = {(i * 97) % 256, (i * 41 + 30) % 256, (i * 13 + 200) % 256};
    const double y = 0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2];
    for (int k = 0; k < 3; k++) rgb[3 * i + k] = (uint8_t)c[k];
    ybr[3 * i] = (uint8_t)(y + 0.5);
    ybr[3 * i + 1] = (uint8_t)fmin((c[2] - y) / 1.772 + 128.5, 255);
    ybr[3 * i + 2] = (uint8_t)fmin((c[0] - y) / 1.402 + 128.5, 255);
  }
  uint8_t greys[2][PIXELS];
  for (int way = 0; way < 2; way++) {
    dicom_spec s;
    dicom_spec_init(&s, COLUMNS, ROWS, way ? ybr : rgb, sizeof rgb);
    s.allocated = s.stored = 8;
    s.high = 7;
    s.is_signed = 0;
    s.samples = 3;
    s.photometric = way ? "YBR_FULL" : "RGB";
    char *folder, *path = one_file(&folder, &s);
    tc_volume *v = load(path, NULL);
    memcpy(greys[way], tc_volume_data(v), PIXELS);
    tc_volume_unref(v);
    drop(folder, path);
  }
  for (int i = 0; i < PIXELS; i++) assert_true(abs(greys[0][i] - greys[1][i]) <= 2);
}

/* Two pixels share their colour: 2 bytes a pixel, of which the luma is taken. */
TEST(halved_colour_becomes_luma) {
  uint8_t pixels[PIXELS * 2];
  dicom_spec s;
  dicom_spec_init(&s, COLUMNS, ROWS, pixels, sizeof pixels);
  for (int i = 0; i < PIXELS * 2; i++)
    pixels[i] = (uint8_t)(i % 4 < 2 ? 100 + i / 4 * 2 + i % 4 : 128); /* no colour */
  s.allocated = s.stored = 8;
  s.high = 7;
  s.is_signed = 0;
  s.samples = 3;
  s.photometric = "YBR_FULL_422";
  char *folder, *path = one_file(&folder, &s);
  tc_volume *v = load(path, NULL);
  for (int i = 0; i < PIXELS; i++)
    assert_int_equal(((const uint8_t *)tc_volume_data(v))[i], 100 + i);
  tc_volume_unref(v);
  drop(folder, path);
}

/* Headers that promise what the file does not hold: refused at once, nothing large is allocated. */
TESTS(NULL, NULL)
