/* Formats and packings that come through the same readers: whole files in gzip and bzip2, MGH, Analyze; and what is
 * refused by its name. */
#include "import_files.h"
#include "renderer/import/helper/decode.h"

enum { side = 4, count = side * side * side };

static void append(GByteArray *out, const char *text) {
  g_byte_array_append(out, (const uint8_t *)text, (guint)strlen(text));
}

static GByteArray *ramp(void) {
  GByteArray *out = g_byte_array_new();
  for (int i = 0; i < count; i++)
    put_element(out, TC_ELEMENT_I16, 3 * i - 50, false);
  return out;
}

static void check_ramp(const char *name) {
  g_autoptr(tc_volume) v = open_good(name);
  check_dims(v, side, side, side);
  for (int i = 0; i < count; i++)
    assert_true(voxel(v, (size_t)i) == 3 * i - 50);
}

/* The file, and the file packed both ways; every prefix of the packed ones is refused. */
static void check_packed(const char *stem, const GByteArray *whole) {
  GByteArray *packed[] = {deflated(whole->data, whole->len, true), bzipped(whole->data, whole->len)};
  g_autofree char *plain = g_strdup(stem);
  write_bytes(plain, whole);
  check_ramp(plain);
  for (int i = 0; i < 2; i++) {
    g_autofree char *name = g_strconcat(stem, i ? ".bz2" : ".gz", NULL);
    write_bytes(name, packed[i]);
    check_ramp(name);
    check_prefixes(name, packed[i]);
    g_byte_array_unref(packed[i]);
  }
}

TEST(whole_files_are_unpacked) {
  GByteArray *voxels = ramp();
  GByteArray *nrrd =
      with_header("NRRD0004\ntype: short\ndimension: 3\nsizes: 4 4 4\nendian: little\nencoding: raw\n\n", voxels);
  check_packed("f.nrrd", nrrd);
  GByteArray *last = with_header("NRRD0004\ntype: short\ndimension: 3\nsizes: 4 4 4\nendian: little\nencoding: raw\n"
                                 "byte skip: -1\n\nwhatever",
                                 voxels);
  check_packed("l.nrrd", last);
  GByteArray *mha = with_header("ObjectType = Image\nNDims = 3\nDimSize = 4 4 4\nElementType = MET_SHORT\n"
                                "ElementDataFile = LOCAL\n",
                                voxels);
  check_packed("f.mha", mha);
  GByteArray *twice = g_byte_array_new(), *inner = deflated(voxels->data, voxels->len, true);
  append(twice, "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 4 4\nendian: little\nencoding: gzip\n\n");
  g_byte_array_append(twice, inner->data, inner->len);
  GByteArray *outer = deflated(twice->data, twice->len, true);
  write_bytes("twice.nrrd.gz", outer);
  open_bad("twice.nrrd.gz", TC_ERROR_UNSUPPORTED, "unpack the file first");
  for (GByteArray **a = (GByteArray *[]){voxels, nrrd, last, mha, twice, inner, outer, NULL}; *a; a++)
    g_byte_array_unref(*a);
}

/* Axes of 2, 3 and 4 mm: x to the right, y down, z to the front, about a centre. */
static GByteArray *mgh(bool placed) {
  static const double numbers[] = {2, 3, 4, 1, 0, 0, 0, 0, -1, 0, 1, 0, 10, 20, 30};
  GByteArray *out = g_byte_array_new();
  for (const int *n = (int[]){1, side, side, side, 1, 4, 0, -1}; *n >= 0; n++)
    put_uint(out, (uint64_t)*n, 4, true);
  put_uint(out, placed, 2, true);
  for (size_t i = 0; i < G_N_ELEMENTS(numbers); i++)
    put_element(out, TC_ELEMENT_F32, numbers[i], true);
  g_byte_array_set_size(out, 284);
  memset(out->data + 90, 0, 284 - 90);
  for (int i = 0; i < count; i++)
    put_element(out, TC_ELEMENT_I16, 3 * i - 50, true);
  return out;
}

TEST(mgh_files) {
  GByteArray *file = mgh(true), *unplaced = mgh(false);
  check_packed("f.mgh", file);
  write_bytes("f.mgh", file);
  tc_volume *v = open_good("f.mgh");
  const tc_volume_desc *d = tc_volume_describe(v);
  /* RAS corner = centre - half the extent along each axis; LPS turns x and y round */
  check_near(d->spacing, (double[]){2, 3, 4}, 3, 1e-6);
  check_near(d->origin, (double[]){-(10 - 4), -(20 - 8), 30 + 6}, 3, 1e-6);
  check_near(d->direction, (double[]){-1, 0, 0, 0, 0, -1, 0, -1, 0}, 9, 1e-6);
  assert_string_equal(d->format, "mgh");
  tc_volume_unref(v);
  write_bytes("u.mgh", unplaced);
  v = open_good("u.mgh");
  check_near(tc_volume_describe(v)->direction, (double[]){1, 0, 0, 0, 0, -1, 0, -1, 0}, 9, 1e-6);
  assert_non_null(strstr(tc_volume_describe(v)->note, "coronal"));
  tc_volume_unref(v);
  g_byte_array_unref(unplaced);
  g_byte_array_unref(file);
}

TEST(analyze_pairs) {
  GByteArray *voxels = ramp(), *head = g_byte_array_new();
  for (int big = 0; big < 2; big++) {
    g_byte_array_set_size(head, 348);
    memset(head->data, 0, 348);
    put_at(head, 0, 348, 4, big);
    put_at(head, 32, 16384, 4, big);
    head->data[38] = 'r';
    for (int i = 0; i < 5; i++)
      put_at(head, (size_t)(40 + 2 * i), (uint64_t)(i == 0 ? 4 : i < 4 ? side : 1), 2, big);
    put_at(head, 70, 4, 2, big);
    for (int i = 1; i < 4; i++)
      put_f32_at(head, (size_t)(76 + 4 * i), 1.5f * (float)i, big);
    put_at(head, 252, 0x0101, 2, big); /* patient's text where NIfTI has its codes */
    write_bytes("a.hdr", head);
    for (guint i = 0; big && i < voxels->len; i += 2) {
      const uint8_t low = voxels->data[i];
      voxels->data[i] = voxels->data[i + 1];
      voxels->data[i + 1] = low;
    }
    write_bytes("a.img", voxels);
    check_ramp("a.hdr");
    check_ramp("a.img");
    g_autoptr(tc_volume) v = open_good("a.hdr");
    assert_string_equal(tc_volume_describe(v)->format, "analyze");
    head->data[38] = 0; /* without marks, as nibabel writes it: the type and its bits agree */
    put_at(head, 32, 0, 4, big);
    put_at(head, 72, 16, 2, big);
    write_bytes("a.hdr", head);
    check_ramp("a.hdr");
    put_at(head, 72, 8, 2, big);
    write_bytes("a.hdr", head);
    open_bad("a.hdr", TC_ERROR_FORMAT, "NIfTI");
    check_near(tc_volume_describe(v)->spacing, (double[]){1.5, 3, 4.5}, 3, 1e-6);
    check_near(tc_volume_describe(v)->direction, (double[]){1, 0, 0, 0, -1, 0, 0, 0, 1}, 9, 1e-6);
    assert_non_null(strstr(tc_volume_describe(v)->note, "no orientation"));
  }
  g_byte_array_unref(voxels);
  g_byte_array_unref(head);
}

static void put_row(GString *text, int slice, int time, int index, const char *slope) {
  g_string_append_printf(text,
                         "  %d   1    %d  1 0 2    %d  16    98    4    2     5.0   %s 8.8e-004  1070  1860   10.0  20.0"
                         "  -30.0   5.0  -6.0   7.0  3.000  0.500 0 3 0 3  1.500  2.000   1.42    0.0     0.0    0.0   1"
                         "    8.0     0    0    0   225   0.0  1   1    3    0   0.0    0.0    0.0  1\n",
                         slice, time, index, slope);
}

static GString *par_header(void) {
  return g_string_new("# === DATA DESCRIPTION FILE ===\n# Research image export tool     V4.2\n"
                      ".    Angulation midslice(ap,fh,rl)[degr]:   10.000  20.000  -30.000\n"
                      ".    Off Centre midslice(ap,fh,rl) [mm] :   5.000  -6.000  7.000\n#\n");
}

/* Voxel i of the REC is i; voxel 3 of a slice. The wanted numbers are nibabel's of the same file. */
static void check_par(const char *name, const double values[3]) {
  g_autoptr(tc_volume) v = open_good(name);
  const tc_volume_desc *d = tc_volume_describe(v);
  check_dims(v, 4, 2, 3);
  for (int z = 0; z < 3; z++) assert_true(voxel(v, (size_t)(8 * z + 5)) * d->slope + d->intercept == values[z]);
  check_near(d->spacing, (double[]){1.5, 2, 3.5}, 3, 1e-6);
  check_near(d->origin, (double[]){6.27034519, 2.05730454, -2.97995906}, 3, 1e-6);
  check_near(d->direction,
             (double[]){0.92541658, -0.17364818, -0.33682409, 0.21461018, -0.49240388, 0.84349327, -0.31232456,
                        -0.85286853, -0.41841204},
             9, 1e-6);
}

/* What an upload of several files is: a header finds its voxels in the zip, and nothing outside it. */
static void pairs_in_a_zip(void) {
  static const char *const pair[] = {"p.REC", "p.PAR"}, *const two[] = {"p.PAR", "n.nhdr", "p.REC", "n.raw"};
  const tc_import_options upload = {.self_contained = true};
  GError *error = NULL;
  zip_files("pair.zip", pair, 2);
  tc_volume *v = open_with("pair.zip", &upload, &error);
  assert_null(error);
  assert_string_equal(tc_volume_describe(v)->format, "parrec");
  tc_volume_unref(v);
  check_par("pair.zip#volume=2", (double[]){31, 63, 95});
  write_text("n.nhdr", "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 4 4\nendian: little\nencoding: raw\ndata file: n.raw\n");
  GByteArray *voxels = ramp();
  write_bytes("n.raw", voxels);
  g_byte_array_unref(voxels);
  zip_files("nhdr.zip", two + 1, 3);
  check_ramp("nhdr.zip#volume=1");
  zip_files("two.zip", two, 4);
  open_bad("two.zip#volume=1", TC_ERROR_UNSUPPORTED, "holds 2 volumes");
  zip_files("alone.zip", two + 1, 1); /* its voxels lie beside the zip */
  open_bad("alone.zip#volume=1", TC_ERROR_FORMAT, "n.raw is not in the zip");
}

/* Two times, slice by slice among each other, and a third that was broken off. */
TEST(philips_pairs) {
  g_autoptr(GByteArray) rec = g_byte_array_new();
  for (int i = 0; i < 7 * 8; i++) put_uint(rec, (uint64_t)i, 2, false);
  GString *text = par_header();
  for (int i = 0; i < 7; i++) put_row(text, i / 2 % 3 + 1, i < 6 ? i % 2 + 1 : 3, i, "2.0");
  write_text("p.PAR", text->str);
  open_bad("p.PAR", TC_ERROR_FORMAT, "p.REC");
  write_bytes("p.REC", rec);
  check_par("p.PAR", (double[]){15, 47, 79});
  check_par("p.REC", (double[]){15, 47, 79});
  check_par("p.PAR#volume=2", (double[]){31, 63, 95});
  pairs_in_a_zip();
  tc_volume *v = open_good("p.PAR");
  assert_int_equal(tc_volume_describe(v)->frames, 2);
  assert_non_null(strstr(tc_volume_describe(v)->note, "1 of 3 volumes lack slices"));
  tc_volume_unref(v);
  open_bad("p.PAR#volume=3", TC_ERROR_NOT_FOUND, "holds 2");
  g_byte_array_set_size(rec, 64);
  write_bytes("p.REC", rec);
  open_bad("p.PAR", TC_ERROR_FORMAT, "ends");
  g_string_free(text, TRUE);
  text = par_header();
  for (int i = 0; i < 3; i++) put_row(text, i + 1, 1, i, i ? "2.0" : "4.0"); /* a scale of its own */
  write_text("p.PAR", text->str);
  check_par("p.PAR", (double[]){25, 31, 47});
  g_string_free(text, TRUE);
}

TEST(a_refusal_names_the_format) {
  static const struct {
    const char *bytes, *text;
  } others[] = {
      {"CDF\1", "MINC 1"},
      {"%PDF-1.4", "PDF"},
      {"MATLAB 5.0 MAT-file", "niftiwrite"},
      {"# vtk DataFile Version 3.0", "MetaImage"},
  };
  char bytes[512] = "";
  for (size_t i = 0; i < G_N_ELEMENTS(others); i++) {
    memset(bytes, 0, sizeof bytes);
    strcpy(bytes, others[i].bytes);
    write_file("other", bytes, sizeof bytes);
    open_bad("other", TC_ERROR_UNSUPPORTED, others[i].text);
  }
  write_text("other", "hello");
  open_bad("other", TC_ERROR_FORMAT, "unknown kind of file");
}

/* ---- ISA-L against zlib: no sanitizer sees into its assembler ---- */

/* What the decoder makes of `from`, read `step` bytes at a time; NULL: damaged or cut. */
static GByteArray *inflated(const GByteArray *from, size_t step) {
  tc_input input;
  uint8_t bytes[1 << 16];
  size_t got = 1;
  bool ok = true;
  tc_input_memory(&input, from->data, from->len, "");
  tc_decoder *d = tc_decoder_new(&input, 0, TC_ENCODING_DEFLATE, TC_ELEMENT_U8, 0, NULL);
  GByteArray *out = g_byte_array_new();
  while (got > 0 && (ok = tc_decoder_read(d, bytes, step, &got, NULL))) g_byte_array_append(out, bytes, (guint)got);
  if (!ok || tc_decoder_cut(d)) g_clear_pointer(&out, g_byte_array_unref);
  tc_decoder_free(d);
  tc_input_close(&input);
  return out;
}

static bool zlib_takes(const GByteArray *from) {
  uint8_t bytes[4096];
  z_stream z = {.next_in = from->data, .avail_in = from->len, .next_out = bytes, .avail_out = sizeof bytes};
  assert_int_equal(inflateInit2(&z, MAX_WBITS + 32), Z_OK);
  const int rc = inflate(&z, Z_FINISH);
  inflateEnd(&z);
  return rc == Z_STREAM_END;
}

/* Whether it is `times` of `wanted` behind each other. */
static void check_inflated(const GByteArray *from, size_t step, const GByteArray *wanted, guint times) {
  GByteArray *out = inflated(from, step);
  assert_non_null(out);
  assert_int_equal(out->len, times * wanted->len);
  for (guint i = 0; i < times; i++) assert_memory_equal(out->data + i * wanted->len, wanted->data, wanted->len);
  g_byte_array_unref(out);
}

/* Every cut, every changed bit, padding, and every size of what is asked for. What is taken is right to the byte. */
TEST(inflating_is_zlibs) {
  GByteArray *voxels = ramp();
  for (int gzip = 0; gzip < 2; gzip++) {
    GByteArray *packed = deflated(voxels->data, voxels->len, gzip);
    const guint size = packed->len;
    for (size_t step = 1; step <= voxels->len + 1; step++) check_inflated(packed, step, voxels, 1);
    for (guint bit = 0; bit < 8 * size; bit++) {
      packed->data[bit / 8] ^= (uint8_t)(1 << bit % 8);
      GByteArray *out = inflated(packed, 100);
      if (zlib_takes(packed)) assert_non_null(out);
      if (out) check_inflated(packed, 100, voxels, 1), g_byte_array_unref(out);
      packed->data[bit / 8] ^= (uint8_t)(1 << bit % 8);
    }
    append(packed, "padding");
    check_inflated(packed, 100, voxels, 1);
    for (guint cut = 1; cut < size; cut++) {
      g_byte_array_set_size(packed, size - cut);
      assert_null(inflated(packed, 100));
    }
    g_byte_array_unref(packed);
  }
  g_byte_array_unref(voxels);
}

/* The decoder fetches 128 KiB at a time: the end of the first of these falls on every byte of a stream. */
TEST(streams_across_what_is_fetched) {
  enum { fetched = 128 << 10 };
  GByteArray *voxels = ramp(), *packed = deflated(voxels->data, voxels->len, true), *first = g_byte_array_new();
  static uint8_t noise[fetched];
  uint32_t state = 1;
  for (size_t i = 0; i < sizeof noise; i++) noise[i] = (uint8_t)((state = state * 1664525 + 1013904223) >> 24);
  GByteArray *lead = deflated(noise, fetched - 1024, true);
  for (guint part = 0; part <= packed->len; part++) {
    const guint padding = fetched - part - lead->len - 20; /* 20: an empty stream's */
    g_byte_array_set_size(first, 0);
    g_byte_array_append(first, lead->data, lead->len);
    g_byte_array_append(first, (const uint8_t *)"\x1f\x8b\x08\x10\0\0\0\0\0\xff", 10); /* a comment as long as it takes */
    for (guint i = 1; i < padding; i++) append(first, "c");
    g_byte_array_append(first, (const uint8_t *)"\0\x03\0\0\0\0\0\0\0\0\0", 11);
    assert_int_equal(first->len, fetched - part);
    g_byte_array_append(first, packed->data, packed->len);
    GByteArray *out = inflated(first, 1 << 16);
    assert_non_null(out);
    assert_int_equal(out->len, fetched - 1024 + voxels->len);
    assert_memory_equal(out->data, noise, fetched - 1024);
    assert_memory_equal(out->data + fetched - 1024, voxels->data, voxels->len);
    g_byte_array_unref(out);
  }
  g_byte_array_unref(lead);
  g_byte_array_unref(first);
  g_byte_array_unref(packed);
  g_byte_array_unref(voxels);
}

TESTS(make_folder, remove_folder)
