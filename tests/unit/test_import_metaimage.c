/* MetaImage: types, containers, orientation, channels; refusals. */
#include "import_files.h"

enum { nx = 3, ny = 4, nz = 5, count = nx * ny * nz };

static const struct { const char *name; tc_element element; tc_voxel_type stored; double lo, step; } types[] = {
    {"MET_CHAR", TC_ELEMENT_I8, TC_I8, -100, 3},         {"MET_UCHAR", TC_ELEMENT_U8, TC_U8, 0, 4},
    {"MET_SHORT", TC_ELEMENT_I16, TC_I16, -30000, 1000}, {"MET_USHORT", TC_ELEMENT_U16, TC_U16, 0, 1100},
    {"MET_INT", TC_ELEMENT_I32, TC_I16, -1000, 30},      {"MET_UINT", TC_ELEMENT_U32, TC_U16, 0, 1000},
    {"MET_LONG", TC_ELEMENT_I32, TC_I16, -1000, 30},     {"MET_ULONG", TC_ELEMENT_U32, TC_U16, 0, 1000},
    {"MET_LONG_LONG", TC_ELEMENT_I64, TC_I8, -100, 3},   {"MET_ULONG_LONG", TC_ELEMENT_U64, TC_U8, 0, 4},
    {"MET_FLOAT", TC_ELEMENT_F32, TC_F32, -1.5, 0.25},   {"MET_DOUBLE", TC_ELEMENT_F64, TC_F32, -1.5, 0.25},
};

#define SIZES "ObjectType = Image\nNDims = 3\nDimSize = 3 4 5\n"

static GByteArray *ramp(tc_element element, double lo, double step, int n, bool big) {
  GByteArray *data = g_byte_array_new();
  for (int i = 0; i < n; i++) put_element(data, element, lo + step * i, big);
  return data;
}

/* Takes over data, which may be NULL. */
static void write_meta(const char *name, const char *header, GByteArray *data) {
  GByteArray *file = with_header(header, data);
  write_bytes(name, file);
  g_byte_array_unref(file);
  if (data) g_byte_array_unref(data);
}

static void check_ramp(const char *name, tc_voxel_type stored, double lo, double step) {
  g_autoptr(tc_volume) v = open_good(name);
  check_dims(v, nx, ny, nz);
  assert_int_equal(tc_volume_describe(v)->type, stored);
  assert_string_equal(tc_volume_describe(v)->format, "metaimage");
  for (int i = 0; i < count; i++) assert_true(voxel(v, (size_t)i) == lo + step * i);
}

TEST(every_type_order_and_container) {
  for (size_t t = 0; t < G_N_ELEMENTS(types); t++)
    for (int big = 0; big < 2; big++)
      for (int zip = 0; zip < 2; zip++) {
        g_autoptr(GByteArray) raw = ramp(types[t].element, types[t].lo, types[t].step, count, big);
        g_autoptr(GByteArray) data = zip ? deflated(raw->data, raw->len, false) : g_byte_array_ref(raw);
        g_autofree char *common = g_strdup_printf(SIZES "BinaryDataByteOrderMSB = %s\nCompressedData = %s\nElementType = %s\n",
                                       big ? "True" : "False", zip ? "True" : "False", types[t].name);
        g_autofree char *local = g_strconcat(common, "ElementDataFile = LOCAL\n", NULL);
        g_autofree char *beside = g_strconcat(common, "ElementDataFile = a.data\n", NULL);
        write_meta("a.mha", local, g_byte_array_ref(data));
        check_ramp("a.mha", types[t].stored, types[t].lo, types[t].step);
        write_meta("a.mhd", beside, NULL);
        write_bytes("a.data", data);
        check_ramp("a.mhd", types[t].stored, types[t].lo, types[t].step);
      }
}

TEST(text_data) {
  GByteArray *text = g_byte_array_new();
  for (int i = 0; i < count; i++) {
    char word[16];
    g_snprintf(word, sizeof word, "%d ", 5 * i - 100);
    g_byte_array_append(text, (const uint8_t *)word, (guint)strlen(word));
  }
  write_meta("t.mha", SIZES "BinaryData = False\nElementType = MET_SHORT\nElementDataFile = LOCAL\n", text);
  check_ramp("t.mha", TC_I16, -100, 5);
}

TEST(data_spread_over_files) {
  for (int f = 0; f < nz; f++) {
    char name[32];
    g_snprintf(name, sizeof name, "s%02d.raw", f + 1);
    g_autoptr(GByteArray) part = ramp(TC_ELEMENT_U8, f * nx * ny, 1, nx * ny, false);
    write_bytes(name, part);
  }
#define U8_HEADER SIZES "ElementType = MET_UCHAR\n"
  write_meta("p.mhd", U8_HEADER "ElementDataFile = s%02d.raw 1 5 1\n", NULL);
  check_ramp("p.mhd", TC_U8, 0, 1);
  write_meta("p.mhd", U8_HEADER "ElementDataFile = LIST\ns01.raw\ns02.raw\r\ns03.raw\ns04.raw\ns05.raw\n\n\n", NULL);
  check_ramp("p.mhd", TC_U8, 0, 1);
  write_meta("p.mhd", U8_HEADER "ElementDataFile = LIST\ns01.raw\ns02.raw\ns03.raw\ns04.raw\n", NULL);
  open_bad("p.mhd", TC_ERROR_FORMAT, "'s01.raw': voxels are cut short: 12 of 15");
  write_meta("p.mhd", U8_HEADER "ElementDataFile = s%02d.raw 1 7 1\n", NULL);
  open_bad("p.mhd", TC_ERROR_FORMAT, "evenly");
  write_meta("p.mhd", U8_HEADER "ElementDataFile = s%02d.raw 2 6 1\n", NULL);
  open_bad("p.mhd", TC_ERROR_FORMAT, "'s06.raw': missing");
  write_meta("p.mhd", U8_HEADER "ElementDataFile = ../s01.raw\n", NULL);
  open_bad("p.mhd", TC_ERROR_FORMAT, "beside");
  write_meta("p.mhd", U8_HEADER "ElementDataFile = LIST\n", NULL);
  open_bad("p.mhd", TC_ERROR_FORMAT, "no file names");
}

TEST(header_size) {
  GByteArray *data = with_header("0123456789", NULL), *voxels = ramp(TC_ELEMENT_U8, 0, 1, count, false);
  g_byte_array_append(data, voxels->data, voxels->len);
  write_bytes("lead.raw", data);
  write_meta("h.mhd", U8_HEADER "HeaderSize = 10\nElementDataFile = lead.raw\n", NULL);
  check_ramp("h.mhd", TC_U8, 0, 1);
  write_meta("h.mhd", U8_HEADER "HeaderSize = -1\nElementDataFile = lead.raw\n", NULL);
  check_ramp("h.mhd", TC_U8, 0, 1);
  write_meta("h.mhd", U8_HEADER "HeaderSize = 11\nElementDataFile = lead.raw\n", NULL);
  open_bad("h.mhd", TC_ERROR_FORMAT, "59 of 60");
  g_byte_array_unref(data);
  g_byte_array_unref(voxels);
}

static void check_place(const char *lines, const double *spacing, const double *origin, const double *direction) {
  char *header = g_strconcat(U8_HEADER, lines, "ElementDataFile = LOCAL\n", NULL);
  write_meta("g.mha", header, ramp(TC_ELEMENT_U8, 0, 1, count, false));
  g_free(header);
  g_autoptr(tc_volume) v = open_good("g.mha");
  check_near(tc_volume_describe(v)->spacing, spacing, 3, 1e-12);
  check_near(tc_volume_describe(v)->origin, origin, 3, 1e-12);
  check_near(tc_volume_describe(v)->direction, direction, 9, 1e-12);
}

TEST(places) {
  static const double straight[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, one[3] = {1, 1, 1}, zero[3] = {0, 0, 0};
  /* rows of the file are columns here */
  static const double turned[9] = {0, 0, 1, 1, 0, 0, 0, 1, 0};
  static const char *const matrix[] = {"TransformMatrix", "Orientation", "Rotation"};
  static const char *const offset[] = {"Offset", "Position", "Origin"};
  check_place("", one, zero, straight);
  for (int i = 0; i < 3; i++) {
    char *lines =
        g_strdup_printf("%s = 0 1 0 0 0 1 1 0 0\n%s = -1.5 2 3e1\nElementSpacing = 2 3 0.5\nElementSize = 9 9 9\n",
                        matrix[i], offset[i]);
    check_place(lines, (double[]){2, 3, 0.5}, (double[]){-1.5, 2, 30}, turned);
    g_free(lines);
  }
  check_place("ElementSize = 2 3 4\n", (double[]){2, 3, 4}, zero, straight);
}

TEST(channels_frames_and_flat_images) {
  write_meta("c.mha", U8_HEADER "ElementNumberOfChannels = 3\nElementDataFile = LOCAL\n",
             ramp(TC_ELEMENT_U8, 0, 1, 3 * count, false));
  tc_volume *v = open_good("c.mha");
  assert_int_equal(tc_volume_describe(v)->type, TC_U8);
  assert_true(voxel(v, 10) == floor(0.2126 * 30 + 0.7152 * 31 + 0.0722 * 32 + 0.5));
  tc_volume_unref(v);
  GByteArray *pairs = g_byte_array_new();
  for (int i = 0; i < count; i++) {
    put_element(pairs, TC_ELEMENT_F32, 3 * i, false);
    put_element(pairs, TC_ELEMENT_F32, 4 * i, false);
  }
  write_meta("c.mha", SIZES "ElementType = MET_FLOAT_ARRAY\nElementNumberOfChannels = 2\nElementDataFile = LOCAL\n",
             pairs);
  v = open_good("c.mha");
  assert_true(voxel(v, 59) == 5 * 59);
  tc_volume_unref(v);
  write_meta("c.mha", "NDims = 4\nDimSize = 3 4 5 2\nElementSpacing = 1 1 2 7\nModality = MET_MOD_CT\n"
             "TransformMatrix = 0 1 0 0 1 0 0 0 0 0 1 0 0 0 0 1\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n",
             ramp(TC_ELEMENT_U8, 0, 1, 2 * count, false));
  v = open_good("c.mha");
  assert_int_equal(tc_volume_describe(v)->frames, 2);
  assert_string_equal(tc_volume_describe(v)->modality, "CT");
  check_near(tc_volume_describe(v)->direction, (double[]){0, 1, 0, 1, 0, 0, 0, 0, 1}, 9, 0);
  tc_volume_unref(v);
  write_meta("c.mha",
             "NDims = 2\nDimSize = 6 10\nElementSpacing = 1 2 3\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n",
             ramp(TC_ELEMENT_U8, 0, 1, count, false));
  v = open_good("c.mha");
  check_dims(v, 6, 10, 1);
  tc_volume_unref(v);
}

TEST(bad_headers) {
#define TYPE "ElementType = MET_UCHAR\n"
#define DATA "ElementDataFile = LOCAL\n"
  const struct { const char *header; int code; const char *text; } cases[] = {
      {SIZES DATA, TC_ERROR_FORMAT, "ElementType is missing"},
      {"NDims = 3\n" TYPE DATA, TC_ERROR_FORMAT, "0 sizes in DimSize"},
      {"NDims = 3\nDimSize = 3 4\n" TYPE DATA, TC_ERROR_FORMAT, "2 sizes in DimSize"},
      {"NDims = 1\nDimSize = 60\n" TYPE DATA, TC_ERROR_FORMAT, "NDims is 1"},
      {"NDims = 99\nDimSize = 60\n" TYPE DATA, TC_ERROR_FORMAT, "NDims is 99"},
      {"NDims = x\nDimSize = 60\n" TYPE DATA, TC_ERROR_FORMAT, "header line 1: NDims = 'x'"},
      {"NDims = 3\nDimSize = 3 4 z\n" TYPE DATA, TC_ERROR_FORMAT, "header line 2: DimSize"},
      {"NDims = 3\nDimSize = 3 4 -5\n" TYPE DATA, TC_ERROR_FORMAT, "size 3 is -5"},
      {"NDims = 3\nDimSize = 3 4 nan\n" TYPE DATA, TC_ERROR_FORMAT, "size 3"},
      {"NDims = 3\nDimSize = 3 4 6\n" TYPE DATA, TC_ERROR_FORMAT, "60 of 72 bytes"},
      {"NDims = 3\nDimSize = 99999 99999 99999\n" TYPE DATA, TC_ERROR_LIMIT, "2147483647"},
      {"NDims = 6\nDimSize = 2e9 2e9 2e9 2e9 2e9 2e9\n" TYPE DATA, TC_ERROR_LIMIT, "DimSize"},
      {SIZES "ElementType = MET_STRING\n" DATA, TC_ERROR_FORMAT, "ElementType = 'MET_STRING'"},
      {SIZES TYPE "ElementNumberOfChannels = 0\n" DATA, TC_ERROR_FORMAT, "Channels is 0"},
      {SIZES TYPE "ElementNumberOfChannels = 99999\n" DATA, TC_ERROR_FORMAT, "Channels"},
      {SIZES TYPE "ElementSpacing = 1 1\n" DATA, TC_ERROR_FORMAT, "ElementSpacing"},
      {SIZES TYPE "ElementSpacing = 1 0 1\n" DATA, TC_ERROR_FORMAT, "spacing 2 is 0"},
      {SIZES TYPE "Offset = 1 inf 1\n" DATA, TC_ERROR_FORMAT, "Offset: coordinate 2"},
      {SIZES TYPE "TransformMatrix = 1 0 0 1\n" DATA, TC_ERROR_FORMAT, "TransformMatrix"},
      {SIZES TYPE "TransformMatrix = 1 0 0 1 0 0 0 0 1\n" DATA, TC_ERROR_FORMAT, "not independent"},
      {SIZES TYPE "CompressedData = True\n" DATA, TC_ERROR_FORMAT, "damaged"},
      {SIZES TYPE "BinaryData = False\n" DATA, TC_ERROR_FORMAT, "cut short"},
      {SIZES "what is this\n" TYPE DATA, TC_ERROR_FORMAT, "header line 4: KEY = VALUE expected"},
      {SIZES TYPE "ElementDataFile = gone.raw\n", TC_ERROR_FORMAT, "'gone.raw': missing"},
      {SIZES TYPE "ElementDataFile = \n", TC_ERROR_FORMAT, "beside"},
  };
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    write_meta("bad.mha", cases[i].header, ramp(TC_ELEMENT_U8, 0, 1, count, false));
    open_bad("bad.mha", cases[i].code, cases[i].text);
  }
  write_text("bad.mha", SIZES TYPE);
  open_bad("bad.mha", TC_ERROR_FORMAT, "header ends at line 5 without ElementDataFile");
}

TEST(endless_empty_lines_cost_nothing) {
  GByteArray *lines = g_byte_array_new();
  g_byte_array_set_size(lines, 3 << 20);
  memset(lines->data, '\n', lines->len);
  gint64 start = g_get_monotonic_time();
  write_meta("e.mhd", U8_HEADER "ElementDataFile = root.%d 1 256 1\n", lines);
  open_bad("e.mhd", TC_ERROR_FORMAT, "evenly");
  assert_true(g_get_monotonic_time() - start < 2000000);
}

TEST(every_prefix_is_refused) {
  for (int zip = 0; zip < 2; zip++) {
    g_autoptr(GByteArray) raw = ramp(TC_ELEMENT_U16, 0, 3, count, false);
    g_autoptr(GByteArray) data = zip ? deflated(raw->data, raw->len, false) : g_byte_array_ref(raw);
    GByteArray *file =
        with_header(zip ? SIZES "CompressedData = True\nElementType = MET_USHORT\nElementDataFile = LOCAL\n"
                        : SIZES "ElementType = MET_USHORT\nElementDataFile = LOCAL\n",
                    data);
    check_prefixes("prefix.mha", file);
    g_byte_array_unref(file);
  }
}

TESTS(make_folder, remove_folder)
