/* NRRD: types, encodings, detached data, axes and spaces; refusals. */
#include "import_files.h"

enum { nx = 3, ny = 4, nz = 5, count = nx * ny * nz };

static const struct { const char *name; tc_element element; tc_voxel_type stored; double lo, step; } types[] = {
    {"signed char", TC_ELEMENT_I8, TC_I8, -100, 3},     {"uint8_t", TC_ELEMENT_U8, TC_U8, 0, 4},
    {"short", TC_ELEMENT_I16, TC_I16, -30000, 1000},    {"unsigned short int", TC_ELEMENT_U16, TC_U16, 0, 1100},
    {"int", TC_ELEMENT_I32, TC_I16, -1000, 30},         {"uint32", TC_ELEMENT_U32, TC_U16, 0, 1000},
    {"long long", TC_ELEMENT_I64, TC_I8, -100, 3},      {"uint64_t", TC_ELEMENT_U64, TC_U8, 0, 4},
    {"float", TC_ELEMENT_F32, TC_F32, -1.5, 0.25},      {"DOUBLE", TC_ELEMENT_F64, TC_F32, -1.5, 0.25},
};

static GByteArray *ramp(tc_element element, double lo, double step, int n, bool big) {
  GByteArray *data = g_byte_array_new();
  for (int i = 0; i < n; i++) put_element(data, element, lo + step * i, big);
  return data;
}

static GByteArray *bytes_ramp(int n) { return ramp(TC_ELEMENT_U8, 0, 1, n, false); }

static GByteArray *text_ramp(double lo, double step, int n) {
  GByteArray *out = g_byte_array_new();
  for (int i = 0; i < n; i++) {
    char word[40];
    g_snprintf(word, sizeof word, "%.10g%s", lo + step * i, i % 7 == 6 ? "\n" : i % 2 ? " " : ", ");
    g_byte_array_append(out, (const uint8_t *)word, (guint)strlen(word));
  }
  return out;
}

static GByteArray *hex_of(const GByteArray *data) {
  GByteArray *out = g_byte_array_new();
  for (guint i = 0; i < data->len; i++) {
    char word[4];
    g_snprintf(word, sizeof word, "%02X%s", data->data[i], i % 16 == 15 ? "\n" : "");
    g_byte_array_append(out, (const uint8_t *)word, (guint)strlen(word));
  }
  return out;
}

static void check_ramp(const char *name, tc_voxel_type stored, double lo, double step) {
  g_autoptr(tc_volume) v = open_good(name);
  check_dims(v, nx, ny, nz);
  assert_int_equal(tc_volume_describe(v)->type, stored);
  assert_string_equal(tc_volume_describe(v)->format, "nrrd");
  for (int i = 0; i < count; i++) assert_true(voxel(v, (size_t)i) == lo + step * i);
}

/* Writes a header of these lines, with or without an empty line and data. Takes over data. */
static void write_nrrd(const char *name, const char *lines, GByteArray *data) {
  g_autofree char *header = g_strconcat("NRRD0005\n# a comment\n", lines, data ? "\n" : "", NULL);
  GByteArray *file = with_header(header, data);
  write_bytes(name, file);
  g_byte_array_unref(file);
  if (data) g_byte_array_unref(data);
}

TEST(every_type_order_and_encoding) {
  static const char *const encodings[] = {"raw", "gzip", "bz2", "ascii", "hex"};
  for (size_t t = 0; t < G_N_ELEMENTS(types); t++)
    for (size_t e = 0; e < G_N_ELEMENTS(encodings); e++)
      for (int big = 0; big < 2; big++) {
        GByteArray *raw = ramp(types[t].element, types[t].lo, types[t].step, count, big), *data;
        switch (e) {
        case 1: data = deflated(raw->data, raw->len, true); break;
        case 2: data = bzipped(raw->data, raw->len); break;
        case 3: data = text_ramp(types[t].lo, types[t].step, count); break;
        case 4: data = hex_of(raw); break;
        default: data = g_byte_array_ref(raw);
        }
        g_autofree char *lines = g_strdup_printf("type: %s\ndimension: 3\nsizes: 3 4 5\nencoding: %s\nendian: %s\n",
                                      types[t].name, encodings[e], big ? "big" : "little");
        write_nrrd("a.nrrd", lines, g_byte_array_ref(data));
        check_ramp("a.nrrd", types[t].stored, types[t].lo, types[t].step);
        char *detached = g_strconcat(lines, "data file: a.data\r\n", NULL); /* no empty line, a CRLF */
        write_nrrd("a.nhdr", detached, NULL);
        write_bytes("a.data", data);
        check_ramp("a.nhdr", types[t].stored, types[t].lo, types[t].step);
        g_free(detached);
        g_byte_array_unref(data);
        g_byte_array_unref(raw);
      }
}

/* ---- detached data ---- */

#define U8_HEADER "type: uchar\ndimension: 3\nsizes: 3 4 5\nencoding: raw\n"

static void write_slices(const char *format, int files, int each, int skip) {
  for (int f = 0; f < files; f++) {
    g_autoptr(GByteArray) part = g_byte_array_new();
    for (int i = 0; i < skip; i++) put_uint(part, 0xee, 1, false);
    for (int i = 0; i < each; i++) put_uint(part, (uint64_t)(f * each + i), 1, false);
    g_autofree char *name = g_strdup_printf(format, f + 1);
    write_bytes(name, part);
  }
}

TEST(data_spread_over_files) {
  write_slices("s%03d.raw", nz, nx * ny, 0);
  write_nrrd("p.nhdr", U8_HEADER "data file: s%03d.raw 1 5 1\n", NULL);
  check_ramp("p.nhdr", TC_U8, 0, 1);
  write_nrrd("p.nhdr", U8_HEADER "data file: s%03d.raw 1 5 1 2\n", NULL);
  check_ramp("p.nhdr", TC_U8, 0, 1);
  write_nrrd("p.nhdr", U8_HEADER "datafile: LIST\ns001.raw\ns002.raw\ns003.raw\ns004.raw\ns005.raw\n", NULL);
  check_ramp("p.nhdr", TC_U8, 0, 1);
  write_slices("row%d", ny * nz, nx, 2); /* a file per row, each with a lead of two bytes */
  write_nrrd("p.nhdr", U8_HEADER "byte skip: 2\ndata file: row%d 1 20 1 1\n", NULL);
  check_ramp("p.nhdr", TC_U8, 0, 1);
  write_slices("slab%d", 1, count, 0); /* a slab along the slowest axis */
  write_nrrd("p.nhdr", U8_HEADER "data file: LIST 3\nslab1\n", NULL);
  check_ramp("p.nhdr", TC_U8, 0, 1);
  write_nrrd("p.nhdr", U8_HEADER "data file: s%03d.raw 5 1 -1\n", NULL);
  tc_volume *v = open_good("p.nhdr");
  assert_true(voxel(v, 0) == 4 * nx * ny && voxel(v, count - 1) == nx * ny - 1);
  tc_volume_unref(v);
  write_nrrd("p.nhdr", U8_HEADER "data file: s%03d.raw 1 4 1\n", NULL);
  open_bad("p.nhdr", TC_ERROR_FORMAT, "5 files expected for these sizes, got 4");
  write_nrrd("p.nhdr", U8_HEADER "data file: s%03d.raw 2 6 1\n", NULL);
  open_bad("p.nhdr", TC_ERROR_FORMAT, "'s006.raw': missing");
  write_nrrd("p.nhdr", U8_HEADER "data file: s%s.raw 1 5 1\n", NULL);
  open_bad("p.nhdr", TC_ERROR_FORMAT, "pattern");
  write_nrrd("p.nhdr", U8_HEADER "data file: s%d.raw 1 2000000000 1\n", NULL);
  open_bad("p.nhdr", TC_ERROR_LIMIT, "65536 files");
  write_nrrd("p.nhdr", U8_HEADER "data file: LIST\n", NULL);
  open_bad("p.nhdr", TC_ERROR_FORMAT, "line 7: data file: LIST without");
}

TEST(data_stay_beside_the_header) {
  g_autofree char *outside = g_build_filename(g_get_tmp_dir(), "tc-import-outside.raw", NULL);
  char *link = path_of("link.raw"), *inner = path_of("inner"), *absolute;
  uint8_t zeros[count] = {0};
  assert_true(g_file_set_contents(outside, (const char *)zeros, count, NULL));
  absolute = g_strconcat(U8_HEADER "data file: ", outside, "\n", NULL);
  write_nrrd("d.nhdr", absolute, NULL);
  GError *error = NULL;
  assert_null(open_with("d.nhdr", NULL, &error));
  assert_non_null(strstr(error->message, "beside"));
  g_clear_error(&error);
  write_nrrd("d.nhdr", U8_HEADER "data file: ../tc-import-outside.raw\n", NULL);
  open_bad("d.nhdr", TC_ERROR_FORMAT, "beside");
  assert_int_equal(symlink(outside, link), 0);
  write_nrrd("d.nhdr", U8_HEADER "data file: link.raw\n", NULL);
  assert_null(open_with("d.nhdr", NULL, NULL)); /* a link that leads out */
  assert_int_equal(g_mkdir(inner, 0700), 0);
  write_nrrd("d.nhdr", U8_HEADER "data file: inner\n", NULL);
  open_bad("d.nhdr", TC_ERROR_FORMAT, "not a regular file");
  g_unlink(outside);
  g_free(link);
  g_free(inner);
  g_free(absolute);
}

TEST(skips) {
  GByteArray *data = bytes_ramp(count), *lead = g_byte_array_new(), *zip;
  g_byte_array_append(lead, (const uint8_t *)"one\ntwo\nxy", 10);
  g_byte_array_append(lead, data->data, data->len);
  write_bytes("lead.raw", lead);
  write_nrrd("k.nhdr", U8_HEADER "line skip: 2\nbyte skip: 2\ndata file: lead.raw\n", NULL);
  check_ramp("k.nhdr", TC_U8, 0, 1);
  write_nrrd("k.nhdr", U8_HEADER "byteskip: -1\ndata file: lead.raw\n", NULL);
  check_ramp("k.nhdr", TC_U8, 0, 1);
  zip = deflated(lead->data, lead->len, true);
  g_autoptr(GByteArray) lines = with_header("a\nb\nc\n", zip);
  write_bytes("lead.gz", lines);
  /* lines are skipped before decompression, bytes after */
#define GZ_HEADER "type: uchar\ndimension: 3\nsizes: 3 4 5\nencoding: gzip\nline skip: 3\ndata file: lead.gz\n"
  write_nrrd("k.nhdr", GZ_HEADER "byte skip: 10\n", NULL);
  check_ramp("k.nhdr", TC_U8, 0, 1);
  write_nrrd("k.nhdr", GZ_HEADER "byte skip: -1\n", NULL);
  check_ramp("k.nhdr", TC_U8, 0, 1);
  write_nrrd("k.nhdr", GZ_HEADER "byte skip: 11\n", NULL);
  open_bad("k.nhdr", TC_ERROR_FORMAT, "cut short: 59 of 60");
  write_nrrd("k.nhdr", U8_HEADER "byte skip: -5\ndata file: lead.raw\n", NULL);
  open_bad("k.nhdr", TC_ERROR_FORMAT, "byte skip");
  write_nrrd("k.nhdr", U8_HEADER "line skip: 9\ndata file: lead.raw\n", NULL);
  open_bad("k.nhdr", TC_ERROR_FORMAT, "line skip");
  write_nrrd("k.nhdr", U8_HEADER "byte skip: 9223372036854775807\ndata file: lead.raw\n", NULL);
  open_bad("k.nhdr", TC_ERROR_FORMAT, "cut short: 0 of 60");
  g_byte_array_unref(data);
  g_byte_array_unref(lead);
  g_byte_array_unref(zip);
}

TEST(compressed_data_in_several_members) {
  g_autoptr(GByteArray) data = bytes_ramp(count);
  for (int bz = 0; bz < 2; bz++) {
    GByteArray *all = g_byte_array_new();
    for (int i = 0; i < 3; i++) {
      g_autoptr(GByteArray) part = bz ? bzipped(data->data + 20 * i, 20) : deflated(data->data + 20 * i, 20, true);
      g_byte_array_append(all, part->data, part->len);
    }
    g_byte_array_append(all, (const uint8_t *)"\0\0\0\0", 4); /* padding is no harm */
    write_nrrd("m.nrrd", bz ? "type: uchar\ndimension: 3\nsizes: 3 4 5\nencoding: bzip2\n"
                            : "type: uchar\ndimension: 3\nsizes: 3 4 5\nencoding: gz\n", all);
    check_ramp("m.nrrd", TC_U8, 0, 1);
  }
}

/* ---- space ---- */

static void check_place(const char *lines, const double *spacing, const double *origin, const double *direction) {
  char *all = g_strconcat(U8_HEADER, lines, NULL);
  write_nrrd("g.nrrd", all, bytes_ramp(count));
  g_free(all);
  g_autoptr(tc_volume) v = open_good("g.nrrd");
  const tc_volume_desc *d = tc_volume_describe(v);
  check_near(d->spacing, spacing, 3, 1e-12);
  check_near(d->origin, origin, 3, 1e-12);
  check_near(d->direction, direction, 9, 1e-12);
}

TEST(spaces) {
  static const double s[3] = {2, 5, 1};
#define DIRECTIONS "space directions: (0,2,0) (-3,0,4) (0,0,1)\nspace origin: (1,2,3)\n"
  check_place("space: left-posterior-superior\n" DIRECTIONS, s, (double[]){1, 2, 3},
              (double[]){0, -0.6, 0, 1, 0, 0, 0, 0.8, 1});
  check_place("space: LPS\n" DIRECTIONS, s, (double[]){1, 2, 3}, (double[]){0, -0.6, 0, 1, 0, 0, 0, 0.8, 1});
  check_place("space: RAS\n" DIRECTIONS, s, (double[]){-1, -2, 3}, (double[]){0, 0.6, 0, -1, 0, 0, 0, 0.8, 1});
  check_place("space: right-anterior-superior\n" DIRECTIONS, s, (double[]){-1, -2, 3},
              (double[]){0, 0.6, 0, -1, 0, 0, 0, 0.8, 1});
  check_place("space: left-anterior-superior\n" DIRECTIONS, s, (double[]){1, -2, 3},
              (double[]){0, -0.6, 0, -1, 0, 0, 0, 0.8, 1});
  check_place("space dimension: 3\n" DIRECTIONS, s, (double[]){1, 2, 3}, (double[]){0, -0.6, 0, 1, 0, 0, 0, 0.8, 1});
  check_place("space: LPS\nspace units: \"m\" \"m\" \"m\"\n" DIRECTIONS, (double[]){2000, 5000, 1000},
              (double[]){1000, 2000, 3000}, (double[]){0, -0.6, 0, 1, 0, 0, 0, 0.8, 1});
}

TEST(axes_without_directions) {
  static const double straight[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  check_place("", (double[]){1, 1, 1}, (double[]){0, 0, 0}, straight);
  check_place("spacings: 0.5 2 nan\n", (double[]){0.5, 2, 1}, (double[]){0, 0, 0}, straight);
  check_place("axis mins: 1 2 3\naxis maxs: 5 5 11\n", (double[]){2, 1, 2}, (double[]){1, 2, 3}, straight);
  check_place("axis mins: 0 0 0\naxis maxs: 3 8 5\ncenters: cell cell cell\n", (double[]){1, 2, 1},
              (double[]){0.5, 1, 0.5}, straight);
  check_place("spacings: 1 -2 1\nunits: \"mm\" \"cm\" \"mm\"\n", (double[]){1, 20, 1}, (double[]){0, 0, 0},
              (double[]){1, 0, 0, 0, -1, 0, 0, 0, 1});
}

TEST(words) {
  write_nrrd("w.nrrd", U8_HEADER "modality:=CT\nDICOM.PatientName:=Doe\ncontent: Doe\nsample units: \"HU\"\n",
             bytes_ramp(count));
  g_autoptr(tc_volume) v = open_good("w.nrrd");
  assert_string_equal(tc_volume_describe(v)->modality, "CT");
  assert_string_equal(tc_volume_describe(v)->unit, "HU");
  assert_string_equal(tc_volume_describe(v)->note, "");
}

/* ---- axes that are not space ---- */

static tc_volume *open_axes(const char *lines, GByteArray *data) {
  write_nrrd("x.nrrd", lines, data);
  return open_good("x.nrrd");
}

TEST(colours_vectors_and_frames) {
  tc_volume *v =
      open_axes("type: uchar\ndimension: 4\nsizes: 3 3 4 5\nkinds: RGB-color domain domain domain\nencoding: raw\n",
                bytes_ramp(3 * count));
  check_dims(v, nx, ny, nz);
  assert_int_equal(tc_volume_describe(v)->type, TC_U8);
  assert_true(voxel(v, 10) == floor(0.2126 * 30 + 0.7152 * 31 + 0.0722 * 32 + 0.5));
  tc_volume_unref(v);
  v = open_axes("type: ushort\ndimension: 4\nsizes: 3 3 4 5\nkinds: RGB-color domain domain domain\nencoding: raw\nendian: big\n",
                ramp(TC_ELEMENT_U16, 0, 257, 3 * count, true));
  assert_int_equal(tc_volume_describe(v)->type, TC_U8);
  assert_true(voxel(v, 10) == floor(0.2126 * 30 + 0.7152 * 31 + 0.0722 * 32 + 0.5));
  assert_true(tc_volume_provenance(v)->colors && tc_volume_colors(v));
  tc_volume_unref(v);
  /* the same colours, plane after plane, and row after row */
  v = open_axes("type: uchar\ndimension: 4\nsizes: 3 4 5 3\nkinds: domain domain domain RGB-color\nencoding: raw\n",
                bytes_ramp(3 * count));
  assert_true(voxel(v, 10) == floor(0.2126 * 10 + 0.7152 * 70 + 0.0722 * 130 + 0.5));
  tc_volume_unref(v);
  v = open_axes("type: uchar\ndimension: 4\nsizes: 3 4 3 5\nkinds: domain domain RGB-color domain\nencoding: raw\n",
                bytes_ramp(3 * count));
  assert_true(voxel(v, 25) == floor(0.2126 * (72 + 1) + 0.7152 * (84 + 1) + 0.0722 * (96 + 1) + 0.5));
  tc_volume_unref(v);
  GByteArray *pairs = g_byte_array_new();
  for (int i = 0; i < count; i++) {
    put_element(pairs, TC_ELEMENT_I32, 3 * i, true);
    put_element(pairs, TC_ELEMENT_I32, -4 * i, true);
  }
  v = open_axes(
      "type: int\ndimension: 4\nsizes: 2 3 4 5\nkinds: complex domain domain domain\nencoding: raw\nendian: big\n",
      pairs);
  assert_int_equal(tc_volume_describe(v)->type, TC_F32);
  assert_true(voxel(v, 59) == 5 * 59);
  tc_volume_unref(v);
  v = open_axes("type: uchar\ndimension: 4\nspace: LPS\nsizes: 3 4 5 2\nencoding: raw\n"
                "space directions: (1,0,0) (0,1,0) (0,0,1) none\n", bytes_ramp(2 * count));
  assert_int_equal(tc_volume_describe(v)->frames, 2);
  assert_true(voxel(v, 59) == 59);
  tc_volume_unref(v);
  v = open_axes("type: short\ndimension: 4\nspace: LPS\nsizes: 7 3 4 5\nencoding: raw\nendian: little\n"
                "kinds: list domain domain domain\nspace directions: none (1,0,0) (0,1,0) (0,0,1)\n",
                ramp(TC_ELEMENT_I16, 0, 1, 7 * count, false));
  assert_int_equal(tc_volume_describe(v)->frames, 7);
  assert_true(voxel(v, 59) == 7 * 59);
  tc_volume_unref(v);
  v = open_axes("type: uchar\ndimension: 4\nspace: left-posterior-superior-time\nsizes: 3 4 5 2\nencoding: raw\n"
                "space directions: (1,0,0,0) (0,1,0,0) (0,0,2,0) (0,0,0,3)\nspace origin: (1,2,3,4)\n",
                bytes_ramp(2 * count));
  assert_int_equal(tc_volume_describe(v)->frames, 2);
  check_near(tc_volume_describe(v)->spacing, (double[]){1, 1, 2}, 3, 0);
  tc_volume_unref(v);
}

TEST(a_flat_image_is_one_slice) {
  g_autoptr(tc_volume) v = open_axes("type: uchar\ndimension: 2\nsizes: 6 10\nspacings: 2 3\nencoding: raw\n", bytes_ramp(60));
  check_dims(v, 6, 10, 1);
  check_near(tc_volume_describe(v)->spacing, (double[]){2, 3, 1}, 3, 0);
}

/* ---- refusals ---- */

TEST(bad_headers) {
#define TYPE "type: uchar\n"
#define DIMS "dimension: 3\nsizes: 3 4 5\n"
#define RAW "encoding: raw\n"
  const struct { const char *lines; int code; const char *text;
  } cases[] = {
      {DIMS RAW, TC_ERROR_FORMAT, "type: missing"},
      {TYPE DIMS, TC_ERROR_FORMAT, "encoding: missing"},
      {TYPE RAW, TC_ERROR_FORMAT, "dimension: missing"},
      {TYPE RAW "dimension: 3\n", TC_ERROR_FORMAT, "sizes: missing"},
      {TYPE RAW "dimension: 0\nsizes: 3\n", TC_ERROR_FORMAT, "header line 5: dimension: a number from 1 to 16"},
      {TYPE RAW "dimension: 99999999999999999999\nsizes: 3\n", TC_ERROR_FORMAT, "dimension"},
      {TYPE RAW "dimension: 3\nsizes: 3 4\n", TC_ERROR_FORMAT, "header line 6: sizes: 3 values expected, got 2"},
      {TYPE RAW "dimension: 3\nsizes: 3 4 5 6\n", TC_ERROR_FORMAT, "sizes: 3 values expected, got 4"},
      {TYPE RAW "dimension: 3\nsizes: 3 x 5\n", TC_ERROR_FORMAT, "sizes"},
      {TYPE RAW "dimension: 3\nsizes: 3 -4 5\n", TC_ERROR_FORMAT, "value 2 is -4"},
      {TYPE RAW "dimension: 3\nsizes: 3 4.5 5\n", TC_ERROR_FORMAT, "value 2 is 4.5"},
      {TYPE RAW "dimension: 3\nsizes: 3 4 99999999999\n", TC_ERROR_FORMAT, "value 3"},
      {TYPE RAW "dimension: 3\nsizes: 2000000000 2000000000 2000000000\n", TC_ERROR_LIMIT, "2147483647 voxels"},
      {TYPE RAW "dimension: 1\nsizes: 60\n", TC_ERROR_UNSUPPORTED, "a volume has 3"},
      {TYPE RAW "dimension: 3\nsizes: 30 40 50\n", TC_ERROR_FORMAT, "60 of 60000 bytes"},
      {"type: block\n" RAW DIMS, TC_ERROR_UNSUPPORTED, "'block' is not read"},
      {"type: short\n" RAW DIMS, TC_ERROR_FORMAT, "endian: little or big expected"},
      {TYPE DIMS "encoding: zstd\n", TC_ERROR_UNSUPPORTED, "encoding: not read"},
      {TYPE DIMS "encoding: gzip\n", TC_ERROR_FORMAT, "damaged"},
      {TYPE DIMS "encoding: bzip2\n", TC_ERROR_FORMAT, "damaged"},
      {TYPE DIMS "encoding: ascii\n", TC_ERROR_FORMAT, "cut short"},
      {TYPE DIMS "encoding: hex\n", TC_ERROR_FORMAT, "cut short"},
      {TYPE TYPE DIMS RAW, TC_ERROR_FORMAT, "line 4: type: given twice, first on line 3"},
      {TYPE DIMS RAW "what is this\n", TC_ERROR_FORMAT, "line 7: FIELD: VALUE expected"},
      {TYPE DIMS RAW "space: somewhere\n", TC_ERROR_UNSUPPORTED, "space"},
      {TYPE DIMS RAW "space directions: (1,0,0) (0,1,0) (0,0,1)\n", TC_ERROR_FORMAT, "without a space"},
      {TYPE DIMS RAW "space: LPS\nspace directions: (1,0,0) (0,1,0)\n", TC_ERROR_FORMAT, "value 3: a vector of 3"},
      {TYPE DIMS RAW "space: LPS\nspace directions: (1,0) (0,1,0) (0,0,1)\n", TC_ERROR_FORMAT, "value 1"},
      {TYPE DIMS RAW "space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,1) (1,1,1)\n", TC_ERROR_FORMAT, "more than 3"},
      {TYPE DIMS RAW "space: LPS\nspace directions: (1,0,0) (2,0,0) (0,0,1)\n", TC_ERROR_FORMAT, "independent"},
      {TYPE DIMS RAW "space: LPS\nspace directions: (nan,0,0) (0,1,0) (0,0,1)\n", TC_ERROR_FORMAT, "independent"},
      {TYPE DIMS RAW "space: LPS\nspace origin: (1,2,inf)\n", TC_ERROR_FORMAT, "space origin"},
      {TYPE DIMS RAW "space: LPS\nspace origin: 1 2 3\n", TC_ERROR_FORMAT, "space origin"},
      {TYPE DIMS RAW "spacings: 1 0 1\n", TC_ERROR_FORMAT, "spacings"},
      {TYPE DIMS RAW "kinds: domain domain\n", TC_ERROR_FORMAT, "kinds: 3 values expected, got 2"},
      {TYPE DIMS RAW "kinds: HSV-color domain domain\n", TC_ERROR_UNSUPPORTED, "kind of colour"},
      {TYPE RAW "dimension: 4\nsizes: 5 3 4 1\nkinds: RGB-color domain domain domain\n", TC_ERROR_FORMAT,
       "colour axis"},
      {TYPE RAW "dimension: 3\nsizes: 3 32 32\n", TC_ERROR_UNSUPPORTED, "colour picture"},
  };
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    write_nrrd("bad.nrrd", cases[i].lines, bytes_ramp(count));
    open_bad("bad.nrrd", cases[i].code, cases[i].text);
  }
  write_text("bad.nrrd", "NRRD0006\n" TYPE DIMS RAW "\n");
  open_bad("bad.nrrd", TC_ERROR_UNSUPPORTED, "NRRD0006");
  write_text("bad.nrrd", "NRRD0004\n" TYPE DIMS RAW);
  open_bad("bad.nrrd", TC_ERROR_FORMAT, "header ends at line 6");
}

TEST(announced_sizes_must_be_possible) {
  g_autoptr(GByteArray) small = bytes_ramp(count);
  GByteArray *zip = deflated(small->data, small->len, true);
  write_nrrd("b.nrrd", "type: uchar\ndimension: 3\nsizes: 1000 1000 1000\nencoding: gzip\n", zip);
  open_bad("b.nrrd", TC_ERROR_FORMAT, "cannot hold the 1000000000 bytes announced");
  write_nrrd("b.nrrd", "type: uchar\ndimension: 3\nsizes: 1000 1000 1000\nencoding: bzip2\n",
             bzipped(small->data, count));
  open_bad("b.nrrd", TC_ERROR_FORMAT, "60 of 1000000000 bytes");
  write_nrrd("b.nrrd", "type: uchar\ndimension: 3\nsizes: 1000 1000 1000\nencoding: ascii\n", text_ramp(0, 1, count));
  open_bad("b.nrrd", TC_ERROR_FORMAT, "cut short");
  write_nrrd("b.nrrd", "type: uchar\ndimension: 3\nsizes: 3 4 5\nencoding: ascii\n", text_ramp(240, 1, count));
  open_bad("b.nrrd", TC_ERROR_FORMAT, "number 17 is none of type u8");
}

/* Text is left out: a prefix of its last number is a number too. */
TEST(every_prefix_is_refused) {
  static const char *const encodings[] = {"raw", "gzip", "bzip2"};
  for (size_t e = 0; e < G_N_ELEMENTS(encodings); e++) {
    g_autoptr(GByteArray) raw = ramp(TC_ELEMENT_I16, 100, 1, count, false);
    g_autoptr(GByteArray) data = e == 1   ? deflated(raw->data, raw->len, true)
                       : e == 2 ? bzipped(raw->data, raw->len)
                                : g_byte_array_ref(raw);
    g_autofree char *header = g_strdup_printf(
        "NRRD0004\ntype: short\ndimension: 3\nsizes: 3 4 5\nendian: little\nencoding: %s\n\n", encodings[e]);
    g_autoptr(GByteArray) file = with_header(header, data);
    check_prefixes("prefix.nrrd", file);
  }
}

TESTS(make_folder, remove_folder)
