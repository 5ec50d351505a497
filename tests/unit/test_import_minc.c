/* MINC 2 through its confined helper, from files that libhdf5 writes here. */
#define TC_TEST_BY_HELPER(name, options) true
#include <hdf5.h>

#include "import_files.h"
#include "tests/support/confined.h"

enum { NX = 3, NY = 4, NZ = 5, SLICE = NX * NY, VOXELS = SLICE * NZ };

/* What a file is; what is not said is as in most: u8, one scale, transverse slices of 1 mm. */
typedef struct made {
  const char *order; /* of dimensions, slowest first */
  hid_t type;
  const double *valid;      /* [2] */
  const double *low, *high; /* image-min, image-max */
  int scale_rank;           /* -1: none */
  double steps[3], starts[3];
  const double (*cosines)[3];
  bool chunked, irregular, outside_file;
} made;

static void put_numbers(hid_t object, const char *name, const double *values, hsize_t n) {
  hid_t space = H5Screate_simple(1, &n, NULL),
        a = H5Acreate2(object, name, H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT);
  assert_true(H5Awrite(a, H5T_NATIVE_DOUBLE, values) >= 0);
  H5Aclose(a);
  H5Sclose(space);
}

static void put_words(hid_t object, const char *name, const char *text) {
  hid_t type = H5Tcopy(H5T_C_S1), space = H5Screate(H5S_SCALAR);
  H5Tset_size(type, strlen(text) + 1);
  hid_t a = H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
  assert_true(H5Awrite(a, type, text) >= 0);
  H5Aclose(a);
  H5Sclose(space);
  H5Tclose(type);
}

static hsize_t side; /* of slices, in voxels, where it is not NX and NY */

static hsize_t size_of(const char *dimension) {
  const hsize_t slice = dimension[0] == 'x' ? NX : NY;
  return dimension[0] == 'z' ? NZ : dimension[0] == 't' ? 2 : side ? side : slice;
}

static void put_dimension(hid_t file, const made *m, const char *name) {
  g_autofree char *path = g_strconcat("/minc-2.0/dimensions/", name, NULL);
  hid_t space = H5Screate(H5S_SCALAR),
        d = H5Dcreate2(file, path, H5T_STD_I32LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
  const int k = name[0] - 'x';
  if (k >= 0 && m->steps[k] != 0) put_numbers(d, "step", &m->steps[k], 1);
  if (k >= 0 && m->starts[k] != 0) put_numbers(d, "start", &m->starts[k], 1);
  if (k >= 0 && m->cosines) put_numbers(d, "direction_cosines", m->cosines[k], 3);
  put_words(d, "spacing", m->irregular && k == 2 ? "irregular" : "regular__");
  H5Dclose(d);
  H5Sclose(space);
}

static void put_scale(hid_t file, const made *m, const char *path, const hsize_t *dims, const double *values) {
  hid_t space = m->scale_rank ? H5Screate_simple(m->scale_rank, dims, NULL) : H5Screate(H5S_SCALAR);
  hid_t d = H5Dcreate2(file, path, H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
  assert_true(H5Dwrite(d, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) >= 0);
  H5Dclose(d);
  H5Sclose(space);
}

static void write_minc(const char *name, const made *m, const int32_t *voxels) {
  static const char *const groups[] = {"/minc-2.0", "/minc-2.0/dimensions", "/minc-2.0/image", "/minc-2.0/image/0"};
  char *path = path_of(name), **names = g_strsplit(m->order ? m->order : "zspace,yspace,xspace", ",", -1);
  const int rank = (int)g_strv_length(names);
  hsize_t dims[5], chunk[5];
  hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), list = H5Pcreate(H5P_DATASET_CREATE);
  for (int i = 0; i < 4; i++) H5Gclose(H5Gcreate2(file, groups[i], H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  for (int i = 0; i < rank; i++) {
    put_dimension(file, m, names[i]);
    dims[i] = size_of(names[i]);
    chunk[i] = MAX(dims[i] / 2, 1);
  }
  if (m->chunked) assert_true(H5Pset_chunk(list, rank, chunk) >= 0 && H5Pset_deflate(list, 6) >= 0);
  if (m->outside_file) assert_true(H5Pset_external(list, "secret.raw", 0, H5F_UNLIMITED) >= 0);
  hid_t space = H5Screate_simple(rank, dims, NULL);
  hid_t d = H5Dcreate2(file, "/minc-2.0/image/0/image", m->type ? m->type : H5T_STD_U8LE, space, H5P_DEFAULT, list,
                       H5P_DEFAULT);
  assert_true(d >= 0);
  if (!m->outside_file) assert_true(H5Dwrite(d, H5T_NATIVE_INT32, H5S_ALL, H5S_ALL, H5P_DEFAULT, voxels) >= 0);
  put_words(d, "dimorder", m->order ? m->order : "zspace,yspace,xspace");
  if (m->valid) put_numbers(d, "valid_range", m->valid, 2);
  if (m->scale_rank >= 0 && m->low) {
    put_scale(file, m, "/minc-2.0/image/0/image-min", dims, m->low);
    put_scale(file, m, "/minc-2.0/image/0/image-max", dims, m->high);
  }
  H5Dclose(d);
  H5Sclose(space);
  H5Pclose(list);
  assert_true(H5Fclose(file) >= 0);
  g_strfreev(names);
  g_free(path);
}

static void ramp(int32_t *voxels, int n, int step) {
  for (int i = 0; i < n; i++) voxels[i] = i * step;
}

/* Packed as a whole or in a zip it is known only once it is unpacked; its voxels are the same. */
TEST(packed_and_zipped) {
  static const char *const two[] = {"p.mnc", "p.mnc"};
  int32_t voxels[VOXELS];
  gsize size;
  char *path = path_of("p.mnc"), *bytes;
  ramp(voxels, VOXELS, 2);
  write_minc("p.mnc", &(made){0}, voxels);
  assert_true(g_file_get_contents(path, &bytes, &size, NULL));
  GByteArray *packed[] = {deflated((uint8_t *)bytes, size, true), bzipped((uint8_t *)bytes, size)};
  g_autoptr(GByteArray) twice = deflated(packed[0]->data, packed[0]->len, true);
  write_bytes("p.mnc.gz", packed[0]);
  write_bytes("p.bz2", packed[1]);
  write_bytes("twice.mnc.gz", twice);
  zip_files("p.zip", two, 1);
  static const char *const names[] = {"p.mnc.gz", "p.bz2", "p.zip", "p.zip#volume=1"};
  for (size_t n = 0; n < G_N_ELEMENTS(names); n++) {
    g_autoptr(tc_volume) v = open_good(names[n]);
    check_dims(v, NX, NY, NZ);
    assert_string_equal(tc_volume_describe(v)->format, "minc");
    for (int i = 0; i < VOXELS; i++) assert_true(voxel(v, (size_t)i) == (uint8_t)voxels[i]);
  }
  open_bad("twice.mnc.gz", TC_ERROR_FORMAT, "unknown kind of file");
  g_byte_array_set_size(packed[0], packed[0]->len - 9);
  write_bytes("p.mnc.gz", packed[0]);
  open_bad("p.mnc.gz", TC_ERROR_FORMAT, "compressed data end");
  for (int i = 0; i < 2; i++) g_byte_array_unref(packed[i]);
  g_free(bytes);
  g_free(path);
}

/* Oblique axes, a step backwards and a scale for each slice: place and values are those of the file's own rule. */
TEST(place_and_scales) {
  static const double cosines[3][3] = {{0.8, 0.6, 0}, {-0.6, 0.8, 0}, {0, 0, 1}}, valid[2] = {-1000, 1000};
  static const double low[NZ] = {0, -1, -2, -3, -4}, high[NZ] = {10, 11, 12, 13, 14};
  int32_t voxels[VOXELS];
  for (int i = 0; i < VOXELS; i++) voxels[i] = i * 30 - 900;
  write_minc("place.mnc",
             &(made){.type = H5T_STD_I16BE,
                     .valid = valid,
                     .low = low,
                     .high = high,
                     .scale_rank = 1,
                     .cosines = cosines,
                     .steps = {2, -3, 4},
                     .starts = {10, 20, 30},
                     .chunked = true},
             voxels);
  g_autoptr(tc_volume) v = open_good("place.mnc");
  const tc_volume_desc *d = tc_volume_describe(v);
  check_dims(v, NX, NY, NZ);
  assert_string_equal(d->format, "minc");
  assert_int_equal(d->type, TC_F32);
  assert_non_null(strstr(d->note, "each slice has its own scale"));
  check_near(d->spacing, (double[]){2, 3, 4}, 3, 1e-12);
  check_near(d->origin, (double[]){-(8 - 12), -(6 + 16), 30}, 3, 1e-12); /* 10 x + 20 y + 30 z, in LPS */
  check_near(d->direction, (double[]){-0.8, -0.6, 0, -0.6, 0.8, 0, 0, 0, 1}, 9, 1e-12);
  for (int i = 0; i < VOXELS; i++) {
    const int z = i / SLICE;
    const double wanted = low[z] + (voxels[i] + 1000) / 2000.0 * (high[z] - low[z]);
    check_near(&(double){voxel(v, (size_t)i)}, &wanted, 1, 1e-5);
  }
}

/* One scale keeps the stored integers; no scale, as labels have none, the narrowest that hold them. */
TEST(integers_stay) {
  int32_t voxels[VOXELS];
  ramp(voxels, VOXELS, 3);
  write_minc("scaled.mnc", &(made){.low = (double[]){-1}, .high = (double[]){1.55}}, voxels);
  tc_volume *v = open_good("scaled.mnc");
  const tc_volume_desc *d = tc_volume_describe(v);
  assert_int_equal(d->type, TC_U8);
  check_near(&d->slope, &(double){0.01}, 1, 1e-12);
  check_near(&d->intercept, &(double){-1}, 1, 1e-12);
  assert_int_equal((int)voxel(v, 7), 21);
  tc_volume_unref(v);
  write_minc("labels.mnc", &(made){.type = H5T_STD_I32BE, .scale_rank = -1}, voxels);
  v = open_good("labels.mnc");
  assert_int_equal(tc_volume_describe(v)->type, TC_U8);
  assert_int_equal((int)voxel(v, 59), 177);
  tc_volume_unref(v);
}

/* Outside the valid range is nothing: neither a value nor in the histogram. */
TEST(outside_is_nothing) {
  int32_t voxels[VOXELS];
  ramp(voxels, VOXELS, 3);
  write_minc("valid.mnc", &(made){.valid = (double[]){3, 174}, .low = (double[]){0}, .high = (double[]){171}}, voxels);
  g_autoptr(tc_volume) v = open_good("valid.mnc");
  assert_int_equal(tc_volume_describe(v)->type, TC_F32);
  assert_non_null(strstr(tc_volume_describe(v)->note, "2 voxels outside the valid range are nothing"));
  const uint8_t *gaps = tc_volume_data(tc_volume_gaps(v));
  assert_true(gaps[0] && !gaps[1] && gaps[59]);
  check_near(&(double){voxel(v, 58)}, &(double){171}, 1, 1e-4);
}

/* Dimensions in any order, and time among them. */
TEST(order_and_time) {
  int32_t voxels[2 * VOXELS];
  ramp(voxels, 2 * VOXELS, 1);
  write_minc("t.mnc", &(made){.order = "xspace,zspace,time,yspace", .scale_rank = -1, .steps = {5, 6, 7}}, voxels);
  tc_volume *v = open_good("t.mnc#volume=2");
  const tc_volume_desc *d = tc_volume_describe(v);
  check_dims(v, NY, NZ, NX);
  assert_int_equal(d->frames, 2);
  check_near(d->spacing, (double[]){6, 7, 5}, 3, 1e-12);
  check_near(d->direction, (double[]){0, 0, -1, -1, 0, 0, 0, 1, 0}, 9, 1e-12);
  assert_int_equal((int)voxel(v, 0), NY);                                                  /* x 0, z 0, time 1, y 0 */
  assert_int_equal((int)voxel(v, 1 + NY * (2 + NZ * 1)), ((1 * NZ + 2) * 2 + 1) * NY + 1); /* x 1, z 2, time 1, y 1 */
  tc_volume_unref(v);
  open_bad("t.mnc#volume=3", TC_ERROR_NOT_FOUND, "no volume 3: the file holds 2");
  open_bad("t.mnc#2", TC_ERROR_INVALID, "volume=N");
}

TEST(refusals) {
  int32_t voxels[4 * VOXELS] = {0};
  write_minc("i.mnc", &(made){.irregular = true, .scale_rank = -1}, voxels);
  open_bad("i.mnc", TC_ERROR_UNSUPPORTED, "mincresample");
  write_minc("v.mnc", &(made){.order = "zspace,yspace,xspace,vector_dimension", .scale_rank = -1}, voxels);
  open_bad("v.mnc", TC_ERROR_UNSUPPORTED, "mnc2nii");
  write_minc("f.mnc", &(made){.scale_rank = -1, .steps = {INFINITY, 1, 1}}, voxels);
  open_bad("f.mnc", TC_ERROR_FORMAT, "axes");
  char secret[VOXELS] = "another's voxels";
  write_file("secret.raw", secret, sizeof secret); /* beside it, in its folder, and where this runs */
  write_minc("e.mnc", &(made){.scale_rank = -1, .outside_file = true}, voxels);
  open_bad("e.mnc", TC_ERROR_UNSUPPORTED, "without an image of MINC 2");
  g_autofree char *path = path_of("other.h5");
  H5Fclose(H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
  open_bad("other.h5", TC_ERROR_UNSUPPORTED, "HDF5 without an image of MINC 2");
}

/* What is cut short is refused, wherever it ends. */
TEST(cut_short) {
  int32_t voxels[VOXELS];
  ramp(voxels, VOXELS, 1);
  write_minc("whole.mnc", &(made){.scale_rank = -1, .chunked = true}, voxels);
  char *path = path_of("whole.mnc"), *bytes;
  gsize size;
  assert_true(g_file_get_contents(path, &bytes, &size, NULL));
  for (gsize n = 8; n < size; n += size / 12) {
    write_file("cut.mnc", bytes, n);
    open_bad("cut.mnc", TC_ERROR_FORMAT, "");
  }
  g_free(bytes);
  g_free(path);
}

TEST(the_helper_is_confined) {
  enum { SIDE = 1200 }; /* more than the ring holds */
  g_autofree int32_t *voxels = g_new0(int32_t, SIDE * SIDE * NZ);
  g_autofree char *path = path_of("large.mnc");
  side = SIDE;
  write_minc("large.mnc", &(made){.type = H5T_STD_I16LE, .scale_rank = -1}, voxels);
  side = 0;
  is_confined("tomocast-minc", path);
}

TESTS(make_folder, remove_folder)
