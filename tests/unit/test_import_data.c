/* Real volumes, where the folder named by TC_DATA has them: sizes, types and places as its index gives them, one field
 * from many containers and axis orders, and files that are odd or broken. */
#include "import_files.h"

static const char *data_folder;

static bool have_data(void) {
  data_folder = g_getenv("TC_DATA");
  if (data_folder && g_file_test(data_folder, G_FILE_TEST_IS_DIR)) return true;
  print_message("TC_DATA names no folder of volumes: nothing to test\n");
  return false;
}

static tc_volume *open_path(const char *folder, const char *name, GError **error) {
  g_autofree char *path = g_build_filename(folder, name, NULL);
  tc_volume *volume = tc_import(path, NULL, error);
  return volume;
}

static tc_volume *open_real(const char *name) {
  GError *error = NULL;
  tc_volume *volume = open_path(data_folder, name, &error);
  if (!volume) print_error("%s\n", error->message);
  assert_non_null(volume);
  return volume;
}

#define STRAIGHT {1, 0, 0, 0, 1, 0, 0, 0, 1}
#define FROM_RAS {-1, 0, 0, 0, -1, 0, 0, 0, 1}
#define FROM_LAS {1, 0, 0, 0, -1, 0, 0, 0, 1}
#define OBLIQUE {-0.993592, -0.016005, -0.111887, 0.049705, -0.950937, -0.305367, -0.101510, -0.308971, 0.945639}

/* clang-format off: a row is a volume */
static const struct {
  const char *name;
  int dims[3];
  tc_voxel_type type;
  double spacing[3], direction[9], origin[3], slope, intercept;
  int frames;
} volumes[] = {
    {"nrrd/bonsai.nrrd", {256, 256, 256}, TC_U8, {1, 1, 1}, STRAIGHT, {0, 0, 0}, 1, 0, 1},
    {"nrrd/engine.nrrd", {256, 256, 128}, TC_U8, {1, 1, 1}, STRAIGHT, {0, 0, 0}, 1, 0, 1},
    {"nrrd/aneurism.nrrd", {256, 256, 256}, TC_U8, {1, 1, 1}, STRAIGHT, {0, 0, 0}, 1, 0, 1},
    {"nrrd/cthead_256x256x113_u8.nrrd", {256, 256, 113}, TC_U8, {1, 1, 2}, STRAIGHT, {0, 0, 0}, 1, 0, 1},
    {"nrrd/stanford_bunny_half_256x256x180_i16.nrrd", {256, 256, 180}, TC_I16, {0.675782, 0.675782, 1}, STRAIGHT,
      {0, 0, 0}, 1, 0, 1},
    {"nrrd/vh_head_512x512x234_u8.nrrd", {512, 512, 234}, TC_U8, {1, 1, 1}, STRAIGHT, {0, 0, 0}, 1, 0, 1},
    {"nrrd/ct_abdomen_half_256x256x137_i16.nrrd", {256, 256, 137}, TC_I16, {1.5625, 1.5625, 2}, STRAIGHT,
      {-200.609375, -58.609375, -679.300049}, 1, 0, 1},
    {"nrrd/tooth_103x94x161_u16be.nrrd", {103, 94, 161}, TC_U16, {1, 1, 1}, STRAIGHT, {0, 0, 0}, 1, 0, 1},
    {"nrrd/tooth_u8_raw.nrrd", {103, 94, 161}, TC_U8, {1, 1, 1}, STRAIGHT, {0, 0, 0}, 1, 0, 1},
    {"nrrd/nucleon_41x41x41_u8.nrrd", {41, 41, 41}, TC_U8, {1, 1, 1}, STRAIGHT, {0, 0, 0}, 1, 0, 1},
    {"nrrd/marschner_lobb_126_u16.nrrd", {126, 126, 126}, TC_U16, {1, 1, 1}, STRAIGHT, {0, 0, 0}, 1, 0, 1},
    {"nrrd/neghip_66x66x66_u8.nrrd", {66, 66, 66}, TC_U8, {1, 1, 1}, STRAIGHT, {0, 0, 0}, 1, 0, 1},
    {"nrrd/headsq_64x64x93_u16.nrrd", {64, 64, 93}, TC_U16, {3.2, 3.2, 1.5}, STRAIGHT, {0, 0, 0}, 1, 0, 1},
    {"nrrd/FLAIR.nrrd", {124, 160, 140}, TC_U8, {1, 1, 1}, OBLIQUE, {64.898239, 110.431145, -27.925539}, 1, 0, 1},
    {"nifti/FLAIR.nii.gz", {124, 160, 140}, TC_U8, {1, 1, 1}, OBLIQUE, {64.898239, 110.431145, -27.925539}, 1, 0, 1},
    {"nifti/heptane.nii.gz", {302, 302, 302}, TC_U8, {1, 1, 1}, FROM_RAS, {150, 150, -151}, 1, 0, 1},
    {"nifti/AVM.nii.gz", {337, 319, 154}, TC_U8, {0.5469, 0.5469, 1}, FROM_RAS, {73.3977, 69.6942, -64.11},
      2.208627, 0, 1},
    {"nifti/spm152.nii.gz", {207, 256, 215}, TC_U8, {0.737463, 0.737463, 0.737463}, FROM_RAS, {75.7625, 110.7625,
      -71.7625}, 0.362956, 0, 1},
    {"nifti/shear.nii.gz", {306, 422, 54}, TC_U8, {0.482422, 0.482422, 2.370815}, {-1, 0, 0, 0, -0.948324, 0, 0,
      0.317305, 1}, {94.3794, 117.106, -102.2036}, 7.109804, -1024, 1},
    {"nifti/CT_pitch.nii.gz", {175, 248, 58}, TC_U8, {0.8125, 0.8125, 2.39705}, {-1, 0, 0, 0, -0.958820, -0.284015,
      0, -0.284015, 0.958820}, {69.0208, 134.3856, -13.5688}, 1, 0, 1},
    {"nifti/fuel.nii.gz", {64, 33, 32}, TC_U8, {1, 1, 1}, FROM_RAS, {31, 16, -16}, 1, 0, 1},
    {"nifti/mpld_asl.nii.gz", {64, 64, 24}, TC_F32, {3.4375, 3.4375, 4.95}, FROM_LAS, {-106.9734, 85.376,
      -41.1865}, 1, 0, 25},
    {"nifti/ct_perfusion.nii.gz", {256, 286, 15}, TC_U8, {0.78125, 0.78125, 10}, FROM_LAS, {-99.8047, -90.1484,
      153}, 1, 0, 1},
    {"nifti/complex.nii.gz", {64, 64, 44}, TC_F32, {3.296875, 3.296875, 3.3}, FROM_RAS, {105.6989, 96.8811,
      -12.3925}, 1, 0, 1},
    {"nifti/narps-4965_9U7M-hypo1_unthresh.nii.gz", {91, 109, 91}, TC_F32, {2, 2, 2}, FROM_LAS, {-90, 126, -72}, 1,
      0, 1},
    {"nifti/strokez.nii.gz", {157, 189, 156}, TC_I16, {1, 1, 1}, FROM_LAS, {-78, 112, -70}, 0.0005, 0, 1},
    {"metaimage/LIDC2.mha", {256, 256, 133}, TC_U8, {1.40625, 1.40625, 2.5}, {1, 0, 0, 0, -1, 0, 0, 0, -1}, {0,
      360, 332.5}, 1, 0, 1},
    {"metaimage/frogtissue.mhd", {500, 470, 136}, TC_U8, {1, 1, 1.5}, STRAIGHT, {0, 0, 0}, 1, 0, 1},
    {"metaimage/mha.mha", {64, 64, 37}, TC_I16, {3.4375, 3.4375, 3.8}, {1, 0, 0, 0, -1, 0, 0, 0, 1}, {-108.281,
      82.3795, -47.8356}, 1, 0, 1},
    {"metaimage/HeadMRVolume.mhd", {48, 62, 42}, TC_U8, {4, 4, 4}, STRAIGHT, {0, 0, 0}, 1, 0, 1},
    {"labels/MR.nii.gz", {160, 232, 160}, TC_U8, {1, 0.898437, 0.898437}, FROM_RAS, {388.26, 81.12, 405.421},
      2.007843, 0, 1},
    {"labels/Brain.nrrd", {160, 232, 160}, TC_U8, {1, 0.898437, 0.898437}, STRAIGHT, {229.26, -126.419, 405.421},
      1, 0, 1},
    {"labels/BrainSkull.nrrd", {160, 232, 160}, TC_U8, {1, 0.898437, 0.898437}, STRAIGHT, {229.26, -126.419,
      403.624}, 1, 0, 1},
    {"labels/Skull.nrrd", {160, 232, 160}, TC_U8, {1, 0.898437, 0.898437}, STRAIGHT, {229.26, -126.419, 405.421},
      1, 0, 1},
    {"labels/aal.nii.gz", {181, 217, 181}, TC_U8, {1, 1, 1}, FROM_RAS, {90, 125, -71}, 1, 0, 1},
    {"labels/torsoLabel.nii.gz", {384, 320, 89}, TC_U8, {0.782, 0.782, 5}, FROM_RAS, {134.1247, 146.0268, 1184}, 1,
      0, 1},
    {"labels/inia19-NeuroMaps.nii.gz", {168, 206, 128}, TC_I16, {0.5, 0.5, 0.5}, FROM_RAS, {42, 57.5, -30}, 1, 0, 1},
    {"labels/inia19-t1-brain.nii.gz", {168, 206, 128}, TC_U8, {0.5, 0.5, 0.5}, FROM_RAS, {42, 57.5, -30}, 1, 0, 1},
    {"labels/totalseg/example_ct.nii.gz", {122, 101, 112}, TC_I16, {3, 3, 3}, FROM_RAS, {177.9563, -11.319,
      94.3018}, 1, 0, 1},
    {"labels/totalseg/example_ct_sm.nii.gz", {122, 101, 30}, TC_I16, {3, 3, 3}, FROM_RAS, {177.9563, -11.319,
      94.3018}, 1, 0, 1},
    {"labels/totalseg/example_seg_dicom.nii.gz", {512, 512, 20}, TC_U8, {0.976562, 0.976562, 2}, FROM_LAS,
      {-249.5117, 61.5117, -804.5}, 1, 0, 1},
    {"labels/totalseg/example_mr_sm.nii.gz", {117, 91, 20}, TC_I16, {3, 3, 3}, STRAIGHT, {-168.5996, -166.3594,
      28.9896}, 1, 0, 1},
};
/* clang-format on */

TEST(sizes_types_and_places) {
  if (!have_data()) skip();
  for (size_t i = 0; i < G_N_ELEMENTS(volumes); i++) {
    gint64 start = g_get_monotonic_time();
    g_autoptr(tc_volume) v = open_real(volumes[i].name);
    const tc_volume_desc *d = tc_volume_describe(v);
    double ms = (double)(g_get_monotonic_time() - start) / 1000;
    if (memcmp(d->dims, volumes[i].dims, sizeof d->dims) != 0 || d->type != volumes[i].type)
      print_error("%s: %dx%dx%d %s\n", volumes[i].name, d->dims[0], d->dims[1], d->dims[2],
                  tc_voxel_type_name(d->type));
    assert_memory_equal(d->dims, volumes[i].dims, sizeof d->dims);
    assert_int_equal(d->type, volumes[i].type);
    assert_int_equal(d->frames, volumes[i].frames);
    check_near(d->spacing, volumes[i].spacing, 3, 1e-4);
    check_near(d->direction, volumes[i].direction, 9, 1e-5);
    check_near(d->origin, volumes[i].origin, 3, 1e-3);
    check_near(&d->slope, &volumes[i].slope, 1, 1e-5);
    check_near(&d->intercept, &volumes[i].intercept, 1, 1e-5);
    assert_string_equal(d->modality, "");
    assert_true(ms < 20000);
  }
}

TEST(one_head_in_two_containers) {
  if (!have_data()) skip();
  tc_volume *a = open_real("nrrd/FLAIR.nrrd"), *b = open_real("nifti/FLAIR.nii.gz");
  assert_int_equal(tc_volume_bytes(a), tc_volume_bytes(b));
  assert_memory_equal(tc_volume_data(a), tc_volume_data(b), tc_volume_bytes(a));
  for (int corner = 0; corner < 8; corner++) {
    double index[3] = {corner & 1 ? 123 : 0, corner & 2 ? 159 : 0, corner & 4 ? 139 : 0}, at_a[3], at_b[3];
    tc_volume_index_to_lps(a, index, at_a);
    tc_volume_index_to_lps(b, index, at_b);
    check_near(at_a, at_b, 3, 1e-3);
  }
  tc_volume_unref(a);
  tc_volume_unref(b);
}

/* Unpacks an archive of the data folder into a fresh folder of the test's. */
static char *unpack(const char *archive) {
  char *from = g_build_filename(data_folder, archive, NULL), *to = g_dir_make_tmp("tc-import-odd-XXXXXX", NULL);
  char *argv[] = {"tar", "-xzf", from, "-C", to, NULL};
  int status = -1;
  assert_true(g_spawn_sync(NULL, argv, NULL, G_SPAWN_SEARCH_PATH, NULL, NULL, NULL, NULL, &status, NULL));
  assert_int_equal(status, 0);
  g_free(from);
  return to;
}

/* Every fifth voxel of b lies on a voxel of a and has its value. */
static void check_same_field(const tc_volume *a, const tc_volume *b) {
  const int *da = tc_volume_describe(a)->dims, *db = tc_volume_describe(b)->dims;
  const uint8_t *va = tc_volume_data(a), *vb = tc_volume_data(b);
  assert_int_equal(tc_volume_bytes(a), tc_volume_bytes(b));
  for (int z = 0; z < db[2]; z += 5)
    for (int y = 0; y < db[1]; y += 5)
      for (int x = 0; x < db[0]; x += 5) {
        double at[3], index[3];
        int i[3];
        tc_volume_index_to_lps(b, (double[]){x, y, z}, at);
        tc_volume_lps_to_index(a, at, index);
        for (int k = 0; k < 3; k++) {
          i[k] = (int)lround(index[k]);
          assert_true(fabs(index[k] - i[k]) < 1e-2 && i[k] >= 0 && i[k] < da[k]);
        }
        assert_int_equal(va[((size_t)i[2] * da[1] + i[1]) * da[0] + i[0]], vb[((size_t)z * db[1] + y) * db[0] + x]);
      }
}

TEST(one_head_in_48_axis_orders) {
  if (!have_data()) skip();
  char *folder = unpack("nifti/nifti_orient48.tar.gz"), *inner = g_build_filename(folder, "nifti_orient", NULL);
  GDir *dir = g_dir_open(inner, 0, NULL);
  assert_non_null(dir);
  tc_volume *first = NULL;
  const char *name;
  int seen = 0;
  while ((name = g_dir_read_name(dir))) {
    if (!g_str_has_suffix(name, ".nii.gz")) continue;
    tc_volume *v = open_path(inner, name, NULL);
    assert_non_null(v);
    if (first)
      check_same_field(first, v);
    else
      first = tc_volume_ref(v);
    tc_volume_unref(v);
    seen++;
  }
  assert_int_equal(seen, 48);
  tc_volume_unref(first);
  g_dir_close(dir);
  remove_tree(folder);
  g_free(inner);
  g_free(folder);
}

/* ---- odd and broken files ---- */

typedef enum outcome { LOAD, REFUSE, EITHER } outcome;

static const struct { const char *name; outcome wanted; int dims[3]; const char *text; } odd[] = {
    {"nifti/anatomical.nii", LOAD, {33, 41, 25}, ""},
    {"nifti/reoriented_anat_moved.nii", LOAD, {21, 26, 22}, ""},
    {"nifti/resampled_anat_moved.nii", LOAD, {17, 21, 3}, ""},
    {"nifti/avg152T1_RL_nifti.nii.gz", LOAD, {91, 109, 91}, ""},
    {"nifti/minimal.nii.gz", LOAD, {64, 64, 10}, ""},
    {"nifti/example_nifti2.nii.gz", LOAD, {32, 20, 12}, ""},
    {"nifti/row_major.dconn.nii", REFUSE, {0}, "CIFTI"},
    {"nifti/fs_LR.32k.LR.curvature.dscalar.nii", REFUSE, {0}, "CIFTI"},
    {"nifti/functional.nii", LOAD, {17, 21, 3}, ""},
    {"nifti/example4d.nii.gz", LOAD, {128, 96, 24}, ""},
    {"nifti/complex_image.nii.gz", LOAD, {10, 10, 10}, ""},
    {"nifti/sub-01_ses-01_dwi_desc-b0_dwi.nii.gz", LOAD, {81, 106, 76}, ""},
    {"nifti/stats.nv_demo_mskd.nii.gz", LOAD, {77, 92, 77}, ""},
    {"nifti/pval.LH.nii.gz", LOAD, {27307, 1, 6}, ""},
    {"nifti/low_res.nii.gz", LOAD, {7, 5, 3}, ""},
    {"nifti/standard.nii.gz", LOAD, {4, 5, 7}, ""},
    {"nifti/hippo.nii.gz", LOAD, {91, 109, 91}, ""},
    {"nifti/LAS_drawing_incorrect.nii.gz", LOAD, {64, 79, 67}, ""},
    {"nifti/nifti1.hdr", REFUSE, {0}, "nifti1.img"},
    {"nifti/nifti2.hdr", REFUSE, {0}, "nifti2.img"},
    {"nifti/analyze.hdr", REFUSE, {0}, "analyze.img"},
    {"nrrd/BallBinary30x30x30_nifti.nhdr", LOAD, {30, 30, 30}, ""},
    {"nrrd/BallBinary30x30x30_byteskip_minus_five.nhdr", REFUSE, {0}, "byte skip"},
    {"nrrd/test1d_ascii.nrrd", REFUSE, {0}, "a volume has 3"},
    {"nrrd/test_customFields.nrrd", REFUSE, {0}, "a volume has 3"},
    {"nrrd/trandhisto.nrrd", REFUSE, {0}, "a volume has 3"},
    {"nrrd/test2d_ascii.nrrd", LOAD, {3, 9, 1}, ""},
    {"nrrd/test_simple4d_raw.nrrd", LOAD, {1, 1, 1}, ""},
    {"nrrd/beach.nrrd", REFUSE, {0}, "colour picture"},
    {"nrrd/tenGlyphBqdAbcUv.nrrd", LOAD, {3, 100, 200}, ""},
    {"nrrd/fmob-c4h.nrrd", LOAD, {32, 40, 16}, ""},
    {"meta/FullHead.mhd", REFUSE, {0}, "FullHead.raw"},
    {"meta/frog.mhd", REFUSE, {0}, "frog.zraw"},
    {"meta/labels.mhd", REFUSE, {0}, "labels.raw"},
    {"meta/pine_root.mhd", REFUSE, {0}, "pine_root.1"},
    {"meta/foot.mha", LOAD, {256, 256, 1}, ""},
    {"meta/Gourds.mha", LOAD, {640, 480, 1}, ""},
    {"other/bad_attribute+orig.HEAD", REFUSE, {0}, "unknown kind"},
    {"other/bad_datatype+orig.HEAD", REFUSE, {0}, "unknown kind"},
    {"other/minc2_baddim.mnc", LOAD, {10, 10, 10}, "xspace: unknown kind of spacing, taken as regular"},
    {"other/phantom_truncated.PAR", LOAD, {64, 64, 9}, "3 of 4 dynamics"},
    {"other/phantom_truncated.REC", EITHER, {0}, ""},
    {"other/test.mgz", LOAD, {3, 4, 5}, ""},
};

TEST(odd_and_broken_files) {
  if (!have_data()) skip();
  char *folder = unpack("odd/odd.tar.gz"), *inner = g_build_filename(folder, "odd", NULL);
  for (size_t i = 0; i < G_N_ELEMENTS(odd); i++) {
    g_autoptr(GError) error = NULL;
    gint64 start = g_get_monotonic_time();
    g_autoptr(tc_volume) v = open_path(inner, odd[i].name, &error);
    assert_true(g_get_monotonic_time() - start < 5000000);
    bool right = odd[i].wanted == EITHER || (v != NULL) == (odd[i].wanted == LOAD);
    if (odd[i].wanted == REFUSE && error) right = right && strstr(error->message, odd[i].text);
    if (odd[i].wanted == LOAD && v)
      right = right && memcmp(tc_volume_describe(v)->dims, odd[i].dims, sizeof odd[i].dims) == 0 &&
              strstr(tc_volume_describe(v)->note, odd[i].text);
    if (!right)
      print_error("%s: %s\n", odd[i].name, error ? error->message : "opened, with other sizes or against its index");
    assert_true(right);
  }
  remove_tree(folder);
  g_free(inner);
  g_free(folder);
}

TEST(one_ball_in_many_encodings) {
  static const char *const names[] = {
      "nrrd/BallBinary30x30x30.nrrd", "nrrd/BallBinary30x30x30.nhdr", "nrrd/BallBinary30x30x30.nii.gz",
      "nrrd/BallBinary30x30x30_gz.nrrd", "nrrd/BallBinary30x30x30_bz2.nrrd",
      "nrrd/BallBinary30x30x30_gz_lineskip.nrrd", "nrrd/BallBinary30x30x30_gz_byteskip_minus_one.nrrd",
      "nrrd/BallBinary30x30x30_byteskip_minus_one.nhdr", "nrrd/BallBinary30x30x30_byteskip_minus_one_nifti.nhdr"};
  if (!have_data()) skip();
  char *folder = unpack("odd/odd.tar.gz"), *inner = g_build_filename(folder, "odd", NULL);
  char *raw = g_build_filename(inner, "nrrd/BallBinary30x30x30.raw", NULL), *bytes;
  gsize size;
  assert_true(g_file_get_contents(raw, &bytes, &size, NULL));
  assert_int_equal(size, 54000);
  for (size_t i = 0; i < G_N_ELEMENTS(names); i++) {
    g_autoptr(tc_volume) v = open_path(inner, names[i], NULL);
    assert_non_null(v);
    assert_int_equal(tc_volume_describe(v)->type, TC_I16);
    assert_int_equal(tc_volume_bytes(v), size);
    assert_memory_equal(tc_volume_data(v), bytes, size);
  }
  g_free(bytes);
  remove_tree(folder);
  g_free(raw);
  g_free(inner);
  g_free(folder);
}

TESTS(NULL, NULL)
