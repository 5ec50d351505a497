/* DICOM of the real world: the sets of the data folder (TC_DATA), what each odd file must do, and geometry against
 * dcm2niix where it is installed. Everything here is skipped, with a line, without the data. */
#include "tests/support/test.h"
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "renderer/import/helper.h"
#include "tests/support/dicom_files.h"
#include "tests/support/scoped.h"

static const tc_import_options with_helper = {.helpers = TC_BINARY_DIR};
static char *unpacked; /* where the archives are; NULL: no data */

/* Runs a program quietly; true when it ends with 0. */
static bool run(const char *const argv[]) {
  int status = -1;
  return g_spawn_sync(NULL, (char **)(uintptr_t)argv, NULL,
                      G_SPAWN_SEARCH_PATH | G_SPAWN_STDOUT_TO_DEV_NULL | G_SPAWN_STDERR_TO_DEV_NULL, NULL, NULL, NULL,
                      NULL, &status, NULL) &&
         status == 0;
}

static bool unpack(const char *data, const char *archive) {
  g_autofree char *path = g_build_filename(data, archive, NULL);
  const char *argv[] = {"tar", "xzf", path, "-C", unpacked, NULL};
  bool ok = g_file_test(path, G_FILE_TEST_EXISTS) && run(argv);
  return ok;
}

static int set_up(void **state) {
  static const char *const archives[] = {"dicom/ct_abdomen_dicom_24.tar.gz",
                                         "dicom/ct_head_dicom93.tar.gz",
                                         "dicom/ct_head_ge_tilt_irregular.tar.gz",
                                         "dicom/dcmqi_data.tar.gz",
                                         "dicom/fnndsc_rsna2_pet_seg.tar.gz",
                                         "dicom/mr_datalad_t1_dicom384.tar.gz",
                                         "dicom/mr_decubitus_dicom4x35.tar.gz",
                                         "odd/odd.tar.gz"};
  const char *data = getenv("TC_DATA");
  if (!data || !g_file_test(data, G_FILE_TEST_IS_DIR)) {
    print_message("TC_DATA names no folder: skipped\n");
    return 0;
  }
  unpacked = temp_folder();
  for (size_t i = 0; i < G_N_ELEMENTS(archives); i++)
    if (!unpack(data, archives[i])) print_message("%s is not there\n", archives[i]);
  return 0;
}

static int tear_down(void **state) {
  if (unpacked) remove_tree(unpacked);
  g_free(unpacked);
  return 0;
}

/* A path in the unpacked archives, or beneath TC_DATA when it begins with '/'. Caller frees. */
static char *find(const char *name) {
  return name[0] == '/' ? g_strconcat(getenv("TC_DATA"), name, NULL) : g_build_filename(unpacked, name, NULL);
}

typedef struct expectation {
  const char *path, *series;
  int dims[3], frames;
  tc_voxel_type type;
  double spacing[3];
  const char *modality;
  double slope, intercept;
} expectation;

static const expectation sets[] = {
    {"ct_abdomen_dicom_24", NULL, {512, 512, 24}, 1, TC_U16, {0.78125, 0.78125, 1}, "CT", 1, -1000},
    {"GE", NULL, {512, 512, 135}, 1, TC_I16, {0.48828, 0.48828, 1.13388}, "CT", 1, 0}, /* 28 slices, tilted */
    {"ct_head_dicom93", NULL, {64, 64, 93}, 1, TC_I16, {3.2, 3.2, 1.5}, "CT", 1, 0},
    {"mr_datalad_t1", NULL, {274, 384, 384}, 1, TC_I16, {0.69999, 0.666667, 0.666667}, "MR", 1, 0},
    {"mr_decubitus", "1", {256, 256, 35}, 1, TC_U16, {1.015625, 1.015625, 4.8}, "MR", 1, 0},
    {"mr_decubitus", "2", {256, 256, 35}, 1, TC_U16, {1.015625, 1.015625, 4.8}, "MR", 1, 0},
    {"mr_decubitus", "3", {256, 256, 35}, 1, TC_U16, {1.015625, 1.015625, 4.8}, "MR", 1, 0},
    {"mr_decubitus", "4", {256, 256, 35}, 1, TC_U16, {1.015625, 1.015625, 4.8}, "MR", 1, 0},
    {"fnndsc_rsna2", NULL, {128, 128, 299}, 1, TC_I16, {3.5378, 3.5378, 3.375}, "PT", 5.95498274e-4, 0}, /* 2.0222 Bq/ml of 66.2 kg and 381.47 MBq, 5024.678 s before */
    {"fnndsc_rsna2", "2", {128, 128, 9}, 1, TC_U8, {3.5378, 3.5378, 3.375}, "SEG", 1, 0},
    {"dcmqi/segmentations/ct-3slice", NULL, {512, 512, 3}, 1, TC_I16, {0.8105, 0.8105, 1}, "CT", 1, -1024},
    {"dcmqi/segmentations/liver.dcm", NULL, {512, 512, 3}, 1, TC_U8, {0.8105, 0.8105, 1}, "SEG", 1, 0},
    {"dcmqi/segmentations/partial_overlaps.dcm", NULL, {512, 512, 3}, 1, TC_U8, {0.8105, 0.8105, 1}, "SEG", 1, 0},
    {"dcmqi/segmentations/24x38x3/multiframe/mf.dcm", NULL, {24, 38, 3}, 1, TC_U16, {0.7, 0.7, 2.5}, "CT", 1, 0},
    {"dcmqi/segmentations/sparse-labelmap-ppv5.dcm", NULL, {24, 38, 3}, 1, TC_U8, {0.7, 0.7, 2.5}, "SEG", 1, 0},
    {"dcmqi/paramaps/pm-example-dcm.zip", NULL, {256, 256, 20}, 1, TC_I16, {0.703, 0.703, 3}, "MR", 1, 0},
    {"/dicom/enh_multiframe/eCT_Supplemental.dcm",
     NULL,
     {512, 512, 2},
     1,
     TC_U16,
     {0.3887, 0.3887, 10},
     "CT",
     1,
     -1024},
    {"/dicom/enh_multiframe/emri_small.dcm", NULL, {64, 64, 10}, 1, TC_U16, {1, 1, 1.2}, "MR", 1, 0},
    {"/dicom/enh_multiframe/MOVEKNEE.dcm", NULL, {256, 256, 1}, 19, TC_U16, {0.625, 0.625, 6}, "MR", 1, 0},
    {"/dicom/enh_multiframe/mr_brucker.dcm", NULL, {256, 128, 4}, 1, TC_I16, {0.1, 0.2, 1}, "MR", 1, 0},
    {"/dicom/enh_multiframe/Philips", NULL, {64, 64, 32}, 2, TC_U16, {4, 4, 4}, "MR", 1.2799, 0},
    {"/dicom/enh_multiframe/Siemens", NULL, {64, 64, 6}, 4, TC_U16, {3.375, 3.375, 2.4}, "MR", 1, 0},
    {"/dicom/enh_multiframe/Siemens/XA10/6_1.dcm", NULL, {64, 64, 6}, 1, TC_U16, {3.375, 3.375, 2.4}, "MR", 1, 0},
    {"/dicom/enh_multiframe/liver_nonbyte_aligned.dcm",
     NULL,
     {510, 510, 3},
     1,
     TC_U8,
     {0.8105, 0.8105, 1},
     "SEG",
     1,
     0},
    {"/dicom/enh_multiframe/parametric_map_float.dcm", NULL, {128, 128, 1}, 1, TC_F32, {0.6615, 0.6615, 5}, "OT", 1, 0},
};

static void check_set(const expectation *want) {
  GError *error = NULL;
  char *path = find(want->path);
  if (!g_file_test(path, G_FILE_TEST_EXISTS)) {
    print_message("%s is not there: skipped\n", want->path);
    g_free(path);
    return;
  }
  assert_true(g_file_test(path, G_FILE_TEST_IS_DIR) || tc_helper_for(path) == TC_HELPER_DICOM);
  g_autoptr(tc_volume) v = tc_helper_load(TC_HELPER_DICOM, path, want->series, &with_helper, &error);
  if (!v) fail_msg("%s: %s", want->path, error->message);
  const tc_volume_desc *d = tc_volume_describe(v);
  for (int k = 0; k < 3; k++)
    if (d->dims[k] != want->dims[k] || fabs(d->spacing[k] - want->spacing[k]) > 1e-4)
      fail_msg("%s: axis %d is %d x %g mm", want->path, k, d->dims[k], d->spacing[k]);
  if (d->frames != want->frames || d->type != want->type || strcmp(d->modality, want->modality) != 0 ||
      fabs(d->slope - want->slope) > 1e-4 * want->slope || d->intercept != want->intercept)
    fail_msg("%s: %d frames, %s, %s, slope %g %g", want->path, d->frames, tc_voxel_type_name(d->type), d->modality,
             d->slope, d->intercept);
  assert_true(tc_volume_statistics(v)->max > tc_volume_statistics(v)->min);
  g_free(path);
}

TEST(sets_open_as_described) {
  if (!unpacked) skip();
  for (size_t i = 0; i < G_N_ELEMENTS(sets); i++)
    check_set(&sets[i]);
  struct rusage usage; /* the largest set is 77 MiB of voxels: 1.3 times that and 64 MiB */
  getrusage(RUSAGE_SELF, &usage);
  assert_true(SANITIZED || usage.ru_maxrss < (77 * 13 / 10 + 64) * 1024);
}

/* ---- transfer syntaxes ---- */

typedef struct packing {
  const char *name; /* what the file name holds */
  double most;      /* largest difference to the uncompressed file, in HU; the lossy ones scale to 12 or 8 bits */
} packing;

static tc_volume *open_or_fail(const char *path) {
  GError *error = NULL;
  tc_volume *v = tc_helper_load(TC_HELPER_DICOM, path, NULL, &with_helper, &error);
  if (!v) fail_msg("%s", error->message);
  return v;
}

static double largest_difference(const tc_volume *a, const tc_volume *b) {
  double most = 0;
  const tc_volume_desc *d = tc_volume_describe(a);
  assert_memory_equal(d->dims, tc_volume_describe(b)->dims, sizeof d->dims);
  for (int y = 0; y < d->dims[1]; y++)
    for (int x = 0; x < d->dims[0]; x++) {
      double va, vb, at[3] = {x, y, 0};
      assert_true(tc_volume_value_at(a, at, &va) && tc_volume_value_at(b, at, &vb));
      most = fmax(most, fabs(va - vb));
    }
  return most;
}

TEST(transfer_syntaxes) {
  static const packing packings[] = {{"BigEndian", 0},
                                     {"Deflated", 0},
                                     {"JPEG2000Lossless", 0},
                                     {"JPEG2000Transfer", 5},
                                     {"JPEGLSLossless", 0},
                                     {"JPEGLSLossy", 1},
                                     {"JPEGProcess14SV1", 0},
                                     {"JPEGProcess14T", 0},
                                     {"LittleEndianExplicit", 0},
                                     {"LittleEndianImplicit", 0},
                                     {"RLE", 0},
                                     {"JPEGProcess10_12", 40},
                                     {"JPEGProcess2_4", 40},
                                     {"JPEGProcess6_8", 40},
                                     {"JPEGProcess1T", 70}};
  if (!unpacked) skip();
  char *folder = find("/dicom/dicom_syntaxes"), *plain = g_build_filename(folder, "CTImage.dcm", NULL);
  g_autoptr(tc_volume) reference = open_or_fail(plain);
  size_t seen = 0;
  GDir *dir = g_dir_open(folder, 0, NULL);
  assert_non_null(dir);
  for (const char *name; (name = g_dir_read_name(dir));)
    for (size_t i = 0; i < G_N_ELEMENTS(packings); i++) {
      if (!strstr(name, packings[i].name)) continue;
      char *path = g_build_filename(folder, name, NULL);
      tc_volume *v = open_or_fail(path);
      double off = largest_difference(reference, v);
      if (off > packings[i].most) fail_msg("%s differs by %g", packings[i].name, off);
      tc_volume_unref(v);
      g_free(path);
      seen++;
    }
  g_dir_close(dir);
  assert_int_equal(seen, G_N_ELEMENTS(packings));
  g_free(folder);
  g_free(plain);
}

TEST(frames_in_five_syntaxes) {
  static const char *const same[] = {"emri_small_big_endian", "emri_small_RLE", "emri_small_jpeg_2k_lossless",
                                     "emri_small_jpeg_ls_lossless"};
  if (!unpacked) skip();
  g_autofree char *plain = find("/dicom/enh_multiframe/emri_small.dcm");
  g_autoptr(tc_volume) reference = open_or_fail(plain);
  for (size_t i = 0; i < G_N_ELEMENTS(same); i++) {
    char *name = g_strdup_printf("/dicom/enh_multiframe/%s.dcm", same[i]), *path = find(name);
    g_autoptr(tc_volume) v = open_or_fail(path);
    assert_int_equal(tc_volume_bytes(v), tc_volume_bytes(reference));
    assert_memory_equal(tc_volume_data(v), tc_volume_data(reference), tc_volume_bytes(v));
    g_free(name);
    g_free(path);
  }
}

/* ---- odd files ---- */

TEST(odd_files) {
  static const char *const must_load[] = {
      "MR_small_padded.dcm", "fodicom_CT-MONO2-16-ankle", "decimal_rescale.dcm",
      "MR_small.dcm",        "MR_small_implicit.dcm",     "MR_small_bigendian.dcm",
      "MR_small_RLE.dcm",    "MR_small_jp2klossless.dcm", "MR_small_jpeg_ls_lossless.dcm",
      "CT_small.dcm",        "emri_small_jpeg_2k_lossless_too_short.dcm"}; /* of the last, the end mark alone */
  static const char *const must_not[] = {"MR_truncated.dcm",
                                         "rtplan_truncated.dcm",
                                         "ExplVR_LitEndNoMeta.dcm",
                                         "ExplVR_BigEndNoMeta.dcm",
                                         "meta_missing_tsyntax.dcm",
                                         "no_meta_group_length.dcm",
                                         "empty_charset_LEI.dcm",
                                         "UN_sequence.dcm",
                                         "badVR.dcm",
                                         "fodicom_GH1146.dcm",
                                         "fodicom_GH220.dcm",
                                         "fodicom_GH223.dcm",
                                         "fodicom_GH487.dcm",
                                         "fodicom_Issue1097_FailToOpenDeflatedFileWithSQ.dcm",
                                         "no-pixel-data.dcm",
                                         "DICOMDIR-empty.dcm",
                                         "DICOMDIR-nooffset"};
  if (!unpacked) skip();
  g_autofree char *folder = find("odd/dicom");
  size_t seen = 0, wanted = 0;
  GDir *dir = g_dir_open(folder, 0, NULL);
  assert_non_null(dir);
  for (const char *name; (name = g_dir_read_name(dir));) {
    char *path = g_build_filename(folder, name, NULL);
    GError *error = NULL;
    tc_volume *v = tc_helper_load(TC_HELPER_DICOM, path, NULL, &with_helper, &error);
    for (size_t i = 0; i < G_N_ELEMENTS(must_load); i++, wanted += !strcmp(name, must_load[i - 1]))
      if (!v && !strcmp(name, must_load[i])) fail_msg("%s: %s", name, error->message);
    for (size_t i = 0; i < G_N_ELEMENTS(must_not); i++, wanted += !strcmp(name, must_not[i - 1]))
      if (v && !strcmp(name, must_not[i])) fail_msg("%s was loaded", name);
    if (!v) {
      assert_true(error->message[0] && !strchr(error->message, '\n') && strlen(error->message) < 300);
      if (strstr(error->message, "crashed") || strstr(error->message, "hung")) fail_msg("%s: %s", name, error->message);
      g_error_free(error);
    }
    tc_volume_unref(v);
    g_free(path);
    seen++;
  }
  g_dir_close(dir);
  assert_true(seen > 40 && wanted == G_N_ELEMENTS(must_load) + G_N_ELEMENTS(must_not));
}

/* Everything at once: one bad file must not spoil the rest. */
TEST(a_folder_of_odd_files) {
  if (!unpacked) skip();
  g_autofree char *folder = find("odd");
  tc_series *series;
  size_t count;
  GError *error = NULL;
  if (!tc_helper_list(folder, &with_helper, &series, &count, &error)) fail_msg("%s", error->message);
  assert_true(count > 15);
  g_free(series);
}

/* ---- against dcm2niix ---- */

/* Reads the sform of the only .nii in a folder; false when there is none or several. */
static bool read_sform(const char *folder, double m[12], int dims[3]) {
  GDir *dir = g_dir_open(folder, 0, NULL);
  char *bytes = NULL, *path = NULL;
  gsize size = 0;
  int found = 0;
  for (const char *name; dir && (name = g_dir_read_name(dir));) {
    if (!g_str_has_suffix(name, ".nii")) continue;
    g_free(path);
    path = g_build_filename(folder, name, NULL);
    found++;
  }
  if (dir) g_dir_close(dir);
  bool ok = found == 1 && g_file_get_contents(path, &bytes, &size, NULL) && size >= 348;
  for (int i = 0; ok && i < 12; i++) {
    float f;
    memcpy(&f, bytes + 280 + 4 * i, 4);
    m[i] = f;
  }
  for (int i = 0; ok && i < 3; i++) {
    int16_t n;
    memcpy(&n, bytes + 42 + 2 * i, 2);
    dims[i] = n;
  }
  g_free(bytes);
  g_free(path);
  return ok;
}

/* Their voxel of our corner must be a corner of theirs, the same on the x axis, mirrored or not on the others. */
static void compare_corners(const tc_volume *v, const double m[12], const int dims[3]) {
  const tc_volume_desc *d = tc_volume_describe(v);
  for (int k = 0; k < 3; k++)
    assert_int_equal(d->dims[k], dims[k]);
  for (int corner = 0; corner < 8; corner++) {
    double at[3], lps[3], least = INFINITY;
    for (int k = 0; k < 3; k++)
      at[k] = corner >> k & 1 ? dims[k] - 1 : 0;
    tc_volume_index_to_lps(v, at, lps);
    for (int theirs = 0; theirs < 8; theirs++) { /* the nearest of their corners */
      double off = 0;
      if ((theirs & 1) != (corner & 1)) continue;
      for (int r = 0; r < 3; r++) {
        double world = m[4 * r + 3];
        for (int k = 0; k < 3; k++)
          world += m[4 * r + k] * (theirs >> k & 1 ? dims[k] - 1 : 0);
        off += pow(world - (r < 2 ? -lps[r] : lps[r]), 2);
      }
      least = fmin(least, sqrt(off));
    }
    if (!(least < 0.05)) fail_msg("a corner is %g mm from dcm2niix's", least);
  }
}

TEST(geometry_of_dcm2niix) {
  static const char *const folders[] = {
      "ct_abdomen_dicom_24", "mr_datalad_t1",    "mr_decubitus/HFDR", "mr_decubitus/HFDL",
      "mr_decubitus/HFP",    "mr_decubitus/HFS", "fnndsc_rsna2/PET",  "dcmqi/segmentations/ct-3slice"};
  char *program = g_find_program_in_path("dcm2niix");
  if (!unpacked || !program) {
    print_message("no data or no dcm2niix: skipped\n");
    g_free(program);
    skip();
  }
  for (size_t i = 0; i < G_N_ELEMENTS(folders); i++) {
    char *path = find(folders[i]), *out = temp_folder();
    const char *argv[] = {program, "-z", "n", "-b", "n", "-m", "y", "-f", "out", "-o", out, path, NULL};
    double m[12];
    int dims[3];
    if (run(argv) && read_sform(out, m, dims)) {
      tc_volume *v = open_or_fail(path);
      compare_corners(v, m, dims);
      tc_volume_unref(v);
    } else {
      print_message("dcm2niix made no single volume of %s\n", folders[i]);
    }
    remove_tree(out);
    g_free(out);
    g_free(path);
  }
  g_free(program);
}

TESTS(set_up, tear_down)
