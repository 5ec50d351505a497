/* NIfTI: every type, byte order and container; places in space; refusals. */
#include "import_files.h"

#include <float.h>

enum { nx = 3, ny = 4, nz = 5, count = nx * ny * nz };

static const struct { int code; tc_element element; tc_voxel_type stored; double lo, step; } types[] = {
    {2, TC_ELEMENT_U8, TC_U8, 0, 4},          {4, TC_ELEMENT_I16, TC_I16, -30000, 1000},
    {8, TC_ELEMENT_I32, TC_I16, -1000, 30},   {16, TC_ELEMENT_F32, TC_F32, -1.5, 0.25},
    {64, TC_ELEMENT_F64, TC_F32, -1.5, 0.25}, {256, TC_ELEMENT_I8, TC_I8, -100, 3},
    {512, TC_ELEMENT_U16, TC_U16, 0, 1100},   {768, TC_ELEMENT_U32, TC_U16, 0, 1000},
    {1024, TC_ELEMENT_I64, TC_I8, -100, 3},   {1280, TC_ELEMENT_U64, TC_U8, 0, 4},
};

/* A header of version 1 or 2 with identity sform, and the four bytes that say "no extensions". */
static GByteArray *header(int version, int datatype, bool big, bool paired) {
  GByteArray *h = g_byte_array_new();
  bool one = version == 1;
  size_t own = one ? 348 : 540;
  g_byte_array_set_size(h, (guint)own + (paired ? 0 : 4));
  memset(h->data, 0, h->len);
  put_at(h, 0, own, 4, big);
  memcpy(h->data + (one ? 344 : 4), one ? (paired ? "ni1" : "n+1") : (paired ? "ni2" : "n+2"), 4);
  if (!one) memcpy(h->data + 8, "\r\n\x1a\n", 4);
  const int dim[8] = {3, nx, ny, nz, 1, 1, 1, 1};
  for (int i = 0; i < 8; i++) put_at(h, one ? 40 + 2 * i : 16 + 8 * i, (uint64_t)dim[i], one ? 2 : 8, big);
  put_at(h, one ? 70 : 12, (uint64_t)datatype, 2, big);
  for (int i = 0; i < 8; i++) one ? put_f32_at(h, 76 + 4 * i, 1, big) : put_f64_at(h, 104 + 8 * i, 1, big);
  if (one)
    put_f32_at(h, 108, paired ? 0 : 352, big);
  else
    put_at(h, 168, paired ? 0 : 544, 8, big);
  one ? put_at(h, 254, 1, 2, big) : put_at(h, 348, 1, 4, big); /* sform_code */
  for (int i = 0; i < 3; i++)
    one ? put_f32_at(h, 280 + 20 * i, 1, big) : put_f64_at(h, 400 + 40 * i, 1, big);
  return h;
}

static void add_voxels(GByteArray *file, tc_element element, double lo, double step, int n, bool big) {
  for (int i = 0; i < n; i++) put_element(file, element, lo + step * i, big);
}

static void check_ramp(const char *name, tc_voxel_type stored, double lo, double step) {
  g_autoptr(tc_volume) v = open_good(name);
  check_dims(v, nx, ny, nz);
  assert_int_equal(tc_volume_describe(v)->type, stored);
  assert_string_equal(tc_volume_describe(v)->format, "nifti");
  for (int i = 0; i < count; i++) assert_true(voxel(v, (size_t)i) == lo + step * i);
}

TEST(every_type_order_and_container) {
  for (size_t t = 0; t < G_N_ELEMENTS(types); t++)
    for (int version = 1; version <= 2; version++)
      for (int big = 0; big < 2; big++) {
        GByteArray *file = header(version, types[t].code, big, false), *data = g_byte_array_new();
        add_voxels(data, types[t].element, types[t].lo, types[t].step, count, big);
        g_byte_array_append(file, data->data, data->len);
        GByteArray *zip = deflated(file->data, file->len, true), *blocks = bzipped(file->data, file->len), *head = header(version, types[t].code, big, true);
        write_bytes("a.nii", file);
        write_bytes("a.nii.gz", zip);
        write_bytes("a.nii.bz2", blocks);
        write_bytes("pair.hdr", head);
        write_bytes("pair.img", data);
        check_ramp("a.nii", types[t].stored, types[t].lo, types[t].step);
        check_ramp("a.nii.gz", types[t].stored, types[t].lo, types[t].step);
        check_ramp("a.nii.bz2", types[t].stored, types[t].lo, types[t].step);
        check_ramp("pair.hdr", types[t].stored, types[t].lo, types[t].step);
        check_ramp("pair.img", types[t].stored, types[t].lo, types[t].step);
        g_byte_array_unref(file);
        g_byte_array_unref(data);
        g_byte_array_unref(zip);
        g_byte_array_unref(blocks);
        g_byte_array_unref(head);
      }
}

TEST(content_decides_before_the_name) {
  g_autoptr(GByteArray) file = header(1, 2, false, false);
  add_voxels(file, TC_ELEMENT_U8, 0, 1, count, false);
  write_bytes("wrongly.nrrd", file);
  check_ramp("wrongly.nrrd", TC_U8, 0, 1);
}

/* ---- the storage rule ---- */

static void check_stored(int code, tc_element element, double first, double second, tc_voxel_type stored,
                         const char *note) {
  GByteArray *file = header(1, code, false, false);
  for (int i = 0; i < count; i++) put_element(file, element, i % 2 ? second : first, false);
  write_bytes("s.nii", file);
  g_byte_array_unref(file);
  g_autoptr(tc_volume) v = open_good("s.nii");
  assert_int_equal(tc_volume_describe(v)->type, stored);
  assert_true(voxel(v, 0) == (stored == TC_F32 ? (float)first : first));
  assert_true(voxel(v, 1) == (stored == TC_F32 ? (float)second : second));
  assert_non_null(strstr(tc_volume_describe(v)->note, note));
}

TEST(wide_integers_become_the_narrowest_that_fits) {
  check_stored(8, TC_ELEMENT_I32, 0, 255, TC_U8, "i32 voxels are kept as u8");
  check_stored(8, TC_ELEMENT_I32, 0, 256, TC_U16, "u16");
  check_stored(8, TC_ELEMENT_I32, 0, 65535, TC_U16, "u16");
  check_stored(8, TC_ELEMENT_I32, 0, 65536, TC_F32, "rounded to f32");
  check_stored(8, TC_ELEMENT_I32, -128, 127, TC_I8, "i8");
  check_stored(8, TC_ELEMENT_I32, -129, 127, TC_I16, "i16");
  check_stored(8, TC_ELEMENT_I32, -1, 128, TC_I16, "i16");
  check_stored(8, TC_ELEMENT_I32, -32768, 32767, TC_I16, "i16");
  check_stored(8, TC_ELEMENT_I32, -1, 32768, TC_F32, "f32");
  check_stored(8, TC_ELEMENT_I32, -32769, -5, TC_F32, "f32");
  check_stored(8, TC_ELEMENT_I32, INT32_MIN, INT32_MAX, TC_F32, "f32");
  check_stored(768, TC_ELEMENT_U32, 0, UINT32_MAX, TC_F32, "f32");
  check_stored(1024, TC_ELEMENT_I64, -9e18, 9e18, TC_F32, "f32");
  check_stored(1280, TC_ELEMENT_U64, 0, 1.8e19, TC_F32, "f32");
  check_stored(1280, TC_ELEMENT_U64, 7, 65535, TC_U16, "u64 voxels are kept as u16");
}

TEST(wide_integers_round_to_nearest) {
  /* 2^24 + 1 lies half way between two floats and goes to the even one, 2^24 + 3 goes up */
  GByteArray *file = header(1, 1024, false, false);
  const int64_t values[4] = {(1 << 24) + 1, (1 << 24) + 3, INT64_C(9007199791611905), -((1 << 24) + 3)};
  for (int i = 0; i < count; i++) put_uint(file, (uint64_t)values[i % 4], 8, false);
  write_bytes("r.nii", file);
  g_byte_array_unref(file);
  g_autoptr(tc_volume) v = open_good("r.nii");
  assert_true(voxel(v, 0) == 16777216 && voxel(v, 1) == 16777220 && voxel(v, 3) == -16777220);
  assert_true(voxel(v, 2) == (double)(float)values[2]); /* rounded once, not by way of double */
}

TEST(doubles_beyond_float_stay_finite) {
  GByteArray *file = header(1, 64, false, false);
  const double values[4] = {1e300, -1e300, INFINITY, 1};
  for (int i = 0; i < count; i++) put_element(file, TC_ELEMENT_F64, values[i % 4], false);
  write_bytes("f.nii", file);
  g_byte_array_unref(file);
  g_autoptr(tc_volume) v = open_good("f.nii");
  double slope = tc_volume_describe(v)->slope; /* sealing scales extreme fields */
  assert_true(slope * voxel(v, 0) == FLT_MAX && slope * voxel(v, 1) == -FLT_MAX);
  assert_int_equal(tc_volume_statistics(v)->non_finite, count / 4);
}

TEST(colours_and_complex_numbers) {
  GByteArray *file = header(1, 128, false, false); /* RGB24 */
  for (int i = 0; i < count; i++) {
    const uint8_t rgb[3] = {(uint8_t)(4 * i), (uint8_t)(255 - 4 * i), (uint8_t)i};
    g_byte_array_append(file, rgb, 3);
  }
  write_bytes("rgb.nii", file);
  g_byte_array_unref(file);
  tc_volume *v = open_good("rgb.nii");
  assert_int_equal(tc_volume_describe(v)->type, TC_U8);
  for (int i = 0; i < count; i++)
    assert_true(voxel(v, (size_t)i) == floor(0.2126 * 4 * i + 0.7152 * (255 - 4 * i) + 0.0722 * i + 0.5));
  assert_true(tc_volume_provenance(v)->colors);
  double label;
  assert_true(tc_volume_voxel(tc_volume_colors(v), (const int[3]){1, 0, 0}, &label));
  const tc_segment *second = tc_volume_segment(tc_volume_colors(v), (uint32_t)label);
  assert_true(fabsf(second->color[0] * 255 - 4) < 1e-3f && fabsf(second->color[1] * 255 - 251) < 1e-3f && fabsf(second->color[2] * 255 - 1) < 1e-3f);
  tc_volume_unref(v);

  file = header(1, 32, true, false); /* complex64, big-endian, scaled */
  put_f32_at(file, 112, -2, true);
  put_f32_at(file, 116, 7, true);
  for (int i = 0; i < count; i++) {
    put_element(file, TC_ELEMENT_F32, 3 * i, true);
    put_element(file, TC_ELEMENT_F32, -4 * i, true);
  }
  write_bytes("c.nii", file);
  g_byte_array_unref(file);
  v = open_good("c.nii");
  for (int i = 0; i < count; i++) assert_true(voxel(v, (size_t)i) == 5 * i);
  assert_true(tc_volume_describe(v)->slope == 2 && tc_volume_describe(v)->intercept == 0);
  tc_volume_unref(v);
}

TEST(vectors_are_planes) {
  g_autoptr(GByteArray) file = header(1, 4, false, false);
  put_at(file, 40, 5, 2, false);
  put_at(file, 40 + 2 * 5, 3, 2, false); /* dim[5] = 3 components */
  put_at(file, 68, 1007, 2, false);      /* NIFTI_INTENT_VECTOR */
  const int scale[3] = {2, -3, 6};       /* magnitude 7 */
  for (int c = 0; c < 3; c++) add_voxels(file, TC_ELEMENT_I16, 0, scale[c], count, false);
  write_bytes("v.nii", file);
  tc_volume *v = open_good("v.nii");
  assert_int_equal(tc_volume_describe(v)->type, TC_F32);
  assert_int_equal(tc_volume_describe(v)->frames, 1);
  for (int i = 0; i < count; i++) assert_true(voxel(v, (size_t)i) == 7 * i);
  tc_volume_unref(v);
  g_autoptr(GByteArray) zip = deflated(file->data, file->len, true);
  write_bytes("v.nii.gz", zip);
  v = open_good("v.nii.gz");
  assert_true(voxel(v, 8) == 56);
  tc_volume_unref(v);
}

TEST(the_first_frame_is_taken) {
  g_autoptr(GByteArray) file = header(1, 512, false, false);
  put_at(file, 40, 4, 2, false);
  put_at(file, 40 + 2 * 4, 6, 2, false);
  add_voxels(file, TC_ELEMENT_U16, 100, 1, 6 * count, false);
  write_bytes("t.nii", file);
  tc_volume *v = open_good("t.nii");
  assert_int_equal(tc_volume_describe(v)->frames, 6);
  assert_non_null(strstr(tc_volume_describe(v)->note, "volume 1 of 6"));
  assert_true(voxel(v, 0) == 100 && voxel(v, count - 1) == 99 + count);
  tc_volume_unref(v);
  for (int n = 1; n <= 6; n++) { /* "#volume=N" chooses */
    char name[32];
    snprintf(name, sizeof name, "t.nii#volume=%d", n);
    v = open_good(name);
    assert_int_equal(tc_volume_provenance(v)->volume, n);
    assert_true(voxel(v, 0) == 100 + (n - 1) * count && voxel(v, count - 1) == 99 + n * count);
    tc_volume_unref(v);
  }
  open_bad("t.nii#volume=7", TC_ERROR_NOT_FOUND, "no volume 7: the file holds 6");
  open_bad("t.nii#volume=0", TC_ERROR_INVALID, "volume=N");
  write_file("t.nii", file->data, file->len - 1); /* cut in the last frame */
  open_bad("t.nii", TC_ERROR_FORMAT, "cut short");
  g_autoptr(GByteArray) zip = deflated(file->data, file->len, true);
  check_prefixes("t.nii.gz", zip);
  g_byte_array_append(zip, (const uint8_t *)"padding", 7); /* hides the size at the end; the frames are all there */
  write_bytes("t.nii.gz", zip);
  tc_volume_unref(open_good("t.nii.gz"));
}

/* ---- place ---- */

static tc_volume *open_header(GByteArray *file) {
  add_voxels(file, TC_ELEMENT_U8, 0, 1, count, false);
  write_bytes("p.nii", file);
  g_byte_array_unref(file);
  return open_good("p.nii");
}

static void set_sform(GByteArray *h, const double rows[3][4]) {
  for (int i = 0; i < 12; i++) put_f32_at(h, 280 + 4 * i, (float)rows[i / 4][i % 4], false);
}

TEST(sform_is_preferred_and_turned_to_lps) {
  GByteArray *h = header(1, 2, false, false);
  const double rows[3][4] = {{-2, 0, 0, 10}, {0, 1.5, 0.6, -20}, {0, -2, 0.8, 30}};
  set_sform(h, rows);
  put_at(h, 252, 1, 2, false); /* a qform that says something else */
  put_f32_at(h, 268, 99, false);
  g_autoptr(tc_volume) v = open_header(h);
  const tc_volume_desc *d = tc_volume_describe(v);
  check_near(d->spacing, (double[]){2, 2.5, 1}, 3, 1e-6);
  check_near(d->origin, (double[]){-10, 20, 30}, 3, 1e-6);
  check_near(d->direction, (double[]){1, 0, 0, 0, -0.6, -0.6, 0, -0.8, 0.8}, 9, 1e-6);
  assert_false(signbit(d->direction[1])); /* no negative zeros */
}

TEST(a_sheared_sform_keeps_its_axes) {
  GByteArray *h = header(1, 2, false, false);
  const double rows[3][4] = {{0.5, 0, 0, 0}, {0, 0.5, 0.3, 0}, {0, 0, 0.4, 0}};
  set_sform(h, rows);
  g_autoptr(tc_volume) v = open_header(h);
  const tc_volume_desc *d = tc_volume_describe(v);
  check_near(d->spacing, (double[]){0.5, 0.5, 0.5}, 3, 1e-7);
  check_near(d->direction, (double[]){-1, 0, 0, 0, -1, -0.6, 0, 0, 0.8}, 9, 1e-6);
}

TEST(qform_quaternions) {
  /* turns about x, y, z by a right angle; then a half turn whose float length is a little above 1; then qfac -1 */
  const float h = (float)sqrt(0.5);
  const struct { float b, c, d, qfac; double ras[9]; } cases[] = {
      {0, 0, 0, 1, {1, 0, 0, 0, 1, 0, 0, 0, 1}},       {h, 0, 0, 1, {1, 0, 0, 0, 0, -1, 0, 1, 0}},
      {0, h, 0, 1, {0, 0, 1, 0, 1, 0, -1, 0, 0}},      {0, 0, h, 1, {0, -1, 0, 1, 0, 0, 0, 0, 1}},
      {0, 1.0000001f, 0, 1, {-1, 0, 0, 0, 1, 0, 0, 0, -1}}, {0, 1, 0, -1, {-1, 0, 0, 0, 1, 0, 0, 0, 1}},
  };
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    GByteArray *file = header(1, 2, false, false);
    put_at(file, 254, 0, 2, false);
    put_at(file, 252, 1, 2, false);
    put_f32_at(file, 76, cases[i].qfac, false);
    for (int k = 0; k < 3; k++) put_f32_at(file, 80 + 4 * k, (float)(k + 2), false);
    put_f32_at(file, 256, cases[i].b, false);
    put_f32_at(file, 260, cases[i].c, false);
    put_f32_at(file, 264, cases[i].d, false);
    for (int k = 0; k < 3; k++) put_f32_at(file, 268 + 4 * k, (float)(10 * k + 10), false);
    g_autoptr(tc_volume) v = open_header(file);
    const tc_volume_desc *d = tc_volume_describe(v);
    double lps[9];
    for (int k = 0; k < 9; k++) lps[k] = k < 6 ? -cases[i].ras[k] : cases[i].ras[k];
    check_near(d->spacing, (double[]){2, 3, 4}, 3, 1e-6);
    check_near(d->direction, lps, 9, 1e-6);
    check_near(d->origin, (double[]){-10, -20, 30}, 3, 1e-6);
  }
}

TEST(without_any_form_voxel_sizes_are_used) {
  GByteArray *h = header(1, 2, false, false);
  put_at(h, 254, 0, 2, false);
  for (int k = 0; k < 3; k++) put_f32_at(h, 80 + 4 * k, k == 1 ? -3.f : 2.f, false);
  h->data[123] = 3; /* micrometres */
  g_autoptr(tc_volume) v = open_header(h);
  const tc_volume_desc *d = tc_volume_describe(v);
  check_near(d->spacing, (double[]){0.002, 0.003, 0.002}, 3, 1e-9);
  check_near(d->direction, (double[]){-1, 0, 0, 0, -1, 0, 0, 0, 1}, 9, 0);
  assert_non_null(strstr(d->note, "no orientation"));
}

TEST(a_flat_sform_gives_way_to_the_qform) {
  GByteArray *h = header(1, 2, false, false);
  const double rows[3][4] = {{1, 1, 0, 0}, {0, 0, 0, 0}, {0, 0, 1, 0}};
  set_sform(h, rows);
  put_at(h, 252, 1, 2, false);
  put_f32_at(h, 268, 5, false);
  g_autoptr(tc_volume) v = open_header(h);
  assert_true(tc_volume_describe(v)->origin[0] == -5);
  assert_non_null(strstr(tc_volume_describe(v)->note, "sform"));
}

TEST(slopes) {
  const struct { float slope, inter; double wanted_slope, wanted_inter; } cases[] = {
      {0, 55, 1, 0}, {2.5f, -1024, 2.5, -1024}, {-0.5f, 1, -0.5, 1}, {NAN, 3, 1, 0}, {1, INFINITY, 1, 0}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    GByteArray *h = header(1, 2, false, false);
    put_f32_at(h, 112, cases[i].slope, false);
    put_f32_at(h, 116, cases[i].inter, false);
    g_autoptr(tc_volume) v = open_header(h);
    assert_true(tc_volume_describe(v)->slope == cases[i].wanted_slope);
    assert_true(tc_volume_describe(v)->intercept == cases[i].wanted_inter);
  }
}

TEST(extensions_are_skipped) {
  GByteArray *h = header(1, 2, false, false);
  h->data[348] = 1;
  put_f32_at(h, 108, 352 + 32, false);
  for (int i = 0; i < 32; i++) g_byte_array_append(h, (const uint8_t *)"\xee", 1);
  g_autoptr(tc_volume) v = open_header(h);
  assert_true(voxel(v, 0) == 0 && voxel(v, 7) == 7);
}

/* ---- refusals ---- */

TEST(every_prefix_is_refused) {
  for (int version = 1; version <= 2; version++) {
    g_autoptr(GByteArray) file = header(version, 4, version == 2, false);
    add_voxels(file, TC_ELEMENT_I16, 0, 1, count, version == 2);
    g_autoptr(GByteArray) zip = deflated(file->data, file->len, true);
    check_prefixes("prefix.nii", file);
    check_prefixes("prefix.nii.gz", zip);
  }
}

TEST(bad_headers) {
  const struct { size_t at, size; uint64_t value; int code; const char *text; } cases[] = {
      {70, 2, 1536, TC_ERROR_UNSUPPORTED, "datatype 1536"},
      {70, 2, 0, TC_ERROR_UNSUPPORTED, "datatype 0"},
      {40, 2, 1, TC_ERROR_FORMAT, "dim[0] is 1"},
      {40, 2, 8, TC_ERROR_FORMAT, "dim[0] is 8"},
      {42, 2, 0, TC_ERROR_FORMAT, "dim[1] is 0"},
      {44, 2, 0x8000, TC_ERROR_FORMAT, "dim[2] is -32768"},
      {44, 2, 32767, TC_ERROR_FORMAT, "cut short"},
      {108, 4, 0x7fc00000, TC_ERROR_FORMAT, "vox_offset"},
      {108, 4, 0x41200000, TC_ERROR_FORMAT, "vox_offset 10"},
      {108, 4, 0x43b00001, TC_ERROR_FORMAT, "vox_offset 352"},
      {344, 1, 'x', TC_ERROR_FORMAT, "no NIfTI header"},
  };
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    g_autoptr(GByteArray) file = header(1, 2, false, false);
    put_at(file, cases[i].at, cases[i].value, cases[i].size, false);
    add_voxels(file, TC_ELEMENT_U8, 0, 1, count, false);
    write_bytes("bad.nii", file);
    open_bad("bad.nii", cases[i].code, cases[i].text);
  }
}

TEST(huge_sizes_are_refused_before_memory_is_taken) {
  g_autoptr(GByteArray) file = header(2, 64, false, false);
  put_at(file, 16, 7, 8, false);
  for (int i = 1; i < 8; i++) put_at(file, 16 + 8 * (size_t)i, INT32_MAX, 8, false);
  write_bytes("huge.nii", file);
  open_bad("huge.nii", TC_ERROR_LIMIT, "dim");
  for (int i = 4; i < 8; i++) put_at(file, 16 + 8 * (size_t)i, 1, 8, false);
  write_bytes("huge.nii", file);
  open_bad("huge.nii", TC_ERROR_LIMIT, "2147483647 voxels");
  put_at(file, 24, INT64_MAX, 8, false);
  write_bytes("huge.nii", file);
  open_bad("huge.nii", TC_ERROR_FORMAT, "dim[1]");
  for (int i = 1; i < 4; i++) put_at(file, 16 + 8 * (size_t)i, 1000, 8, false); /* 8 GB announced in a few bytes */
  g_autoptr(GByteArray) zip = deflated(file->data, file->len, true);
  write_bytes("huge.nii.gz", zip);
  open_bad("huge.nii.gz", TC_ERROR_FORMAT, "cannot hold");
}

TEST(pairs_need_their_image) {
  g_autoptr(GByteArray) head = header(1, 2, false, true);
  write_bytes("lonely.hdr", head);
  open_bad("lonely.hdr", TC_ERROR_FORMAT, "'lonely.img': missing");
}

TEST(matrices_are_no_volumes) {
  g_autoptr(GByteArray) file = header(2, 16, false, false);
  const int dim[8] = {6, 1, 1, 1, 1, 10, 10, 1};
  for (int i = 0; i < 8; i++) put_at(file, 16 + 8 * (size_t)i, (uint64_t)dim[i], 8, false);
  add_voxels(file, TC_ELEMENT_F32, 0, 1, 100, false);
  write_bytes("m.nii", file);
  open_bad("m.nii", TC_ERROR_UNSUPPORTED, "matrix");
  put_at(file, 504, 3001, 4, false);
  write_bytes("m.nii", file);
  open_bad("m.nii", TC_ERROR_UNSUPPORTED, "CIFTI");
}

TESTS(make_folder, remove_folder)
