/* Segmentations: names, colours and overlaps of SEG, label maps, structure sets and layered NRRD. */
#include "tests/support/test.h"

#include "renderer/import/helper/dicom_contours.h"
#include "renderer/import/import.h"
#include "tests/support/dicom_files.h"
#include "tests/support/scoped.h"

/* ---- making files ---- */

/* One item of a sequence, or a sequence of items, as the value of an element. */
static void put_sequence(GByteArray *to, unsigned group, unsigned element, GByteArray *const *items, size_t count) {
  GByteArray *value = g_byte_array_new();
  for (size_t i = 0; i < count; i++) {
    dicom_u16(value, 0xfffe);
    dicom_u16(value, 0xe000);
    dicom_u32(value, items[i]->len);
    g_byte_array_append(value, items[i]->data, items[i]->len);
    g_byte_array_free(items[i], TRUE);
  }
  dicom_element(to, group, element, "SQ", value->data, value->len);
  g_byte_array_free(value, TRUE);
}

static void put_item(GByteArray *to, unsigned group, unsigned element, GByteArray *item) {
  put_sequence(to, group, element, &item, 1);
}

static GByteArray *item_with(unsigned group, unsigned element, const char *vr, const void *value, size_t size) {
  GByteArray *item = g_byte_array_new();
  dicom_element(item, group, element, vr, value, size);
  return item;
}

/* sRGB red and blue in the CIELab of D50, as 16-bit numbers. */
static const uint16_t lab_red[3] = {35578, 53663, 50857}, lab_blue[3] = {19377, 50455, 4096};

static GByteArray *segment_item(unsigned number, const char *name, const uint16_t lab[3]) {
  GByteArray *item = g_byte_array_new();
  dicom_short(item, 0x62, 0x04, number);
  dicom_text(item, 0x62, 0x05, "LO", name);
  if (lab) dicom_element(item, 0x62, 0x0d, "US", lab, 6);
  return item;
}

static GByteArray *frame_item(double z, unsigned segment) {
  char position[32];
  GByteArray *item = g_byte_array_new();
  snprintf(position, sizeof position, "0\\0\\%g", z);
  put_item(item, 0x20, 0x9113, item_with(0x20, 0x32, "DS", position, strlen(position)));
  if (segment) {
    GByteArray *which = g_byte_array_new();
    dicom_short(which, 0x62, 0x0b, segment);
    put_item(item, 0x62, 0x0a, which);
  }
  return item;
}

typedef struct seg {
  const char *type, *charset;
  unsigned side, bits, frames;
  const double *z;
  const unsigned *segments; /* [frames]; 0: label map */
  const void *pixels;
  size_t bytes;
} seg;

static GByteArray *seg_bytes(const seg *s) {
  GByteArray *b = dicom_start(), *named[3] = {segment_item(1, "Leber", lab_red), segment_item(2, "L\xe4sion", lab_blue), segment_item(3, "no colour", NULL)};
  GByteArray *shared = g_byte_array_new(), *measures = g_byte_array_new(), **frames = g_new(GByteArray *, s->frames);
  char count[16];
  snprintf(count, sizeof count, "%u", s->frames);
  dicom_text(b, 0x08, 0x05, "CS", "ISO_IR 100");
  dicom_text(b, 0x08, 0x31, "TM", "140322.5");
  dicom_text(b, 0x08, 0x60, "CS", "SEG");
  dicom_text(b, 0x08, 0x103e, "LO", "Segmentation");
  dicom_text(b, 0x10, 0x10, "PN", "SECRET^NAME");
  dicom_text(b, 0x20, 0x0e, "UI", "1.2.3.77");
  dicom_short(b, 0x28, 0x02, 1);
  dicom_text(b, 0x28, 0x04, "CS", "MONOCHROME2");
  dicom_text(b, 0x28, 0x08, "IS", count);
  dicom_short(b, 0x28, 0x10, s->side);
  dicom_short(b, 0x28, 0x11, s->side);
  dicom_short(b, 0x28, 0x100, s->bits);
  dicom_short(b, 0x28, 0x101, s->bits);
  dicom_short(b, 0x28, 0x102, s->bits - 1);
  dicom_short(b, 0x28, 0x103, 0);
  dicom_text(b, 0x62, 0x01, "CS", s->type);
  put_sequence(b, 0x62, 0x02, named, 3);
  dicom_text(measures, 0x28, 0x30, "DS", "1\\1");
  put_item(shared, 0x28, 0x9110, measures);
  put_item(shared, 0x20, 0x9116, item_with(0x20, 0x37, "DS", "1\\0\\0\\0\\1\\0", 11));
  put_item(b, 0x5200, 0x9229, shared);
  for (unsigned f = 0; f < s->frames; f++) frames[f] = frame_item(s->z[f], s->segments[f]);
  put_sequence(b, 0x5200, 0x9230, frames, s->frames);
  dicom_element(b, 0x7fe0, 0x10, "OB", s->pixels, s->bytes);
  g_free(frames);
  return b;
}

static tc_volume *try_bytes(GByteArray *bytes, const char *name, GError **error) {
  g_autofree char *path = g_build_filename(folder, name, NULL);
  assert_true(g_file_set_contents(path, (const char *)bytes->data, bytes->len, NULL));
  tc_volume *v = tc_import(path, &(tc_import_options){.helpers = TC_BINARY_DIR}, error);
  g_byte_array_free(bytes, TRUE);
  return v;
}

static tc_volume *open_bytes(GByteArray *bytes, const char *name) {
  GError *error = NULL;
  tc_volume *v = try_bytes(bytes, name, &error);
  if (!v) fail_msg("%s", error->message);
  return v;
}

static double voxel(const tc_volume *v, int x, int y, int z) {
  double value = -1;
  assert_true(tc_volume_voxel(v, (const int[3]){x, y, z}, &value));
  return value;
}

static void assert_color(const tc_segment *s, double r, double g, double b) {
  assert_non_null(s);
  assert_true(s->has_color);
  const double want[3] = {r, g, b};
  for (int c = 0; c < 3; c++)
    if (fabs((double)s->color[c] - want[c]) > 0.02) fail_msg("%s: colour %d is %g", s->name, c, (double)s->color[c]);
}

/* ---- DICOM SEG ---- */

TEST(overlapping_segments_are_kept) {
  /* 4 x 4 bits a frame; at z = 0 segments 2 and 1 share a pixel, at z = 2 segments 1, 2 and 3 do. */
  static const uint8_t bits[] = {0x03, 0x00, 0x06, 0x00, 0x01, 0x00, 0x01, 0x00, 0x01, 0x80};
  static const double z[] = {0, 0, 2, 2, 2};
  static const unsigned segments[] = {2, 1, 3, 1, 2};
  g_autoptr(tc_volume) v = open_bytes(seg_bytes(&(seg){"BINARY", NULL, 4, 1, 5, z, segments, bits, sizeof bits}), "overlap.dcm");
  size_t count;
  const tc_segment *s = tc_volume_segments(v, &count);
  assert_int_equal(tc_volume_describe(v)->type, TC_U8);
  assert_true(voxel(v, 0, 0, 0) == 2 && voxel(v, 2, 0, 0) == 1);
  const tc_segment *both = tc_volume_segment(v, (uint32_t)voxel(v, 1, 0, 0)), *three = tc_volume_segment(v, (uint32_t)voxel(v, 0, 0, 1));
  assert_true(both->label > 3 && both->of[0] == 1 && both->of[1] == 2);
  assert_true(three->of[0] == both->label && three->of[1] == 3); /* however they come, one label for one set */
  assert_true(voxel(v, 3, 3, 1) == 2);
  assert_true(count >= 5);
  assert_string_equal(s[0].name, "Leber");
  assert_string_equal(s[1].name, "L\xc3\xa4sion");
  assert_color(&s[0], 1, 0, 0);
  assert_color(&s[1], 0, 0, 1);
  assert_false(s[2].has_color);
  const tc_provenance *from = tc_volume_provenance(v);
  assert_string_equal(from->description, "Segmentation");
  assert_string_equal(from->time, "14:03:22");
}

TEST(label_maps) {
  static const uint8_t labels[] = {0, 1, 2, 0, 3, 0, 0, 0, 0};
  static const double z[] = {5};
  static const unsigned none[] = {0};
  g_autoptr(tc_volume) v = open_bytes(seg_bytes(&(seg){"LABELMAP", NULL, 3, 8, 1, z, none, labels, 9}), "map.dcm");
  assert_true(voxel(v, 1, 0, 0) == 1 && voxel(v, 2, 0, 0) == 2 && voxel(v, 1, 1, 0) == 3);
  assert_string_equal(tc_volume_segment(v, 1)->name, "Leber");
}

/* Labels where a fraction is at least half, said; the fractions themselves as a volume for each segment. */
TEST(fractions_are_kept) {
  static const uint8_t parts[] = {0, 127, 128, 255, 0, 0, 0, 0, 0, /* at z = 5 of segment 1, then of 2, then 1 at z = 7 */
                                  51, 0, 0, 128, 0, 0, 0, 0, 0, 102, 0, 0, 0, 0, 0, 0, 0, 0};
  static const double z[] = {5, 5, 7};
  static const unsigned segments[] = {1, 2, 1};
  tc_volume *v = open_bytes(seg_bytes(&(seg){"FRACTIONAL", NULL, 3, 8, 3, z, segments, parts, 27}), "part.dcm");
  assert_true(voxel(v, 1, 0, 0) == 0 && voxel(v, 2, 0, 0) == 1 && voxel(v, 0, 1, 0) == 4 && voxel(v, 0, 0, 1) == 0);
  assert_non_null(strstr(tc_volume_describe(v)->note, "cut at half (128 of 255)"));
  assert_non_null(strstr(tc_volume_describe(v)->note, "volume 1 of 3: labels"));
  assert_int_equal(tc_volume_describe(v)->frames, 3);
  tc_volume_unref(v);
  g_autofree char *path = g_strdup_printf("%s/part.dcm#volume=2", folder);
  v = tc_import(path, &(tc_import_options){.helpers = TC_BINARY_DIR}, NULL);
  assert_non_null(v);
  const tc_volume_desc *d = tc_volume_describe(v);
  size_t count;
  tc_volume_segments(v, &count);
  assert_true(count == 0 && d->type == TC_U8 && d->dims[2] == 2);
  assert_string_equal(d->unit, "fraction");
  assert_non_null(strstr(d->note, "fractions of Leber"));
  const double scale = d->slope;
  assert_float_equal(voxel(v, 1, 0, 0) * scale, 127 / 255.0, 1e-9);
  assert_float_equal(voxel(v, 0, 1, 0) * scale, 1, 1e-9);
  assert_float_equal(voxel(v, 0, 0, 1) * scale, 102 / 255.0, 1e-9);
  assert_true(d->intercept == 0);
  tc_volume_unref(v);
  path[strlen(path) - 1] = '3';
  v = tc_import(path, &(tc_import_options){.helpers = TC_BINARY_DIR}, NULL);
  assert_non_null(v);
  assert_int_equal(tc_volume_describe(v)->dims[2], 1);
  assert_float_equal(voxel(v, 0, 1, 0) * tc_volume_describe(v)->slope, 128 / 255.0, 1e-9);
  tc_volume_unref(v);
}

/* ---- structure sets ---- */

typedef struct ring {
  unsigned roi;
  double x, y, radius, z;
} ring;

enum { CORNERS = 720 };

static GByteArray *contour_item(const ring *r) {
  GString *points = g_string_new(NULL);
  char count[16];
  for (int i = 0; i < CORNERS; i++)
    g_string_append_printf(points, "%s%.6f\\%.6f\\%g", i ? "\\" : "", r->x + r->radius * cos(2 * G_PI * i / CORNERS),
                           r->y + r->radius * sin(2 * G_PI * i / CORNERS), r->z);
  GByteArray *item = g_byte_array_new();
  snprintf(count, sizeof count, "%d", CORNERS);
  dicom_text(item, 0x3006, 0x42, "CS", "CLOSED_PLANAR");
  dicom_text(item, 0x3006, 0x46, "IS", count);
  dicom_text(item, 0x3006, 0x50, "DS", points->str);
  g_string_free(points, TRUE);
  return item;
}

static GByteArray *structures(const ring *rings, size_t count, const char *series) {
  static const char *const names[] = {"PTV", "ring"}, *const colors[] = {"255\\0\\0", "0\\128\\255"};
  GByteArray *b = dicom_start(), *regions[2], *drawn[2];
  dicom_text(b, 0x08, 0x60, "CS", "RTSTRUCT");
  dicom_text(b, 0x20, 0x0e, "UI", "1.2.3.88");
  GByteArray *named = item_with(0x20, 0x0e, "UI", series, strlen(series)), *study = g_byte_array_new(), *frame = g_byte_array_new();
  put_item(study, 0x3006, 0x14, named);
  put_item(frame, 0x3006, 0x12, study);
  put_item(b, 0x3006, 0x10, frame);
  for (unsigned i = 0; i < 2; i++) {
    GByteArray **contours = g_new(GByteArray *, count);
    size_t n = 0;
    for (size_t k = 0; k < count; k++)
      if (rings[k].roi == i + 1) contours[n++] = contour_item(&rings[k]);
    regions[i] = g_byte_array_new();
    dicom_count(regions[i], 0x3006, 0x22, (int)i + 1);
    dicom_text(regions[i], 0x3006, 0x26, "LO", names[i]);
    drawn[i] = g_byte_array_new();
    dicom_text(drawn[i], 0x3006, 0x2a, "IS", colors[i]);
    put_sequence(drawn[i], 0x3006, 0x40, contours, n);
    dicom_count(drawn[i], 0x3006, 0x84, (int)i + 1);
    g_free(contours);
  }
  put_sequence(b, 0x3006, 0x20, regions, 2);
  put_sequence(b, 0x3006, 0x39, drawn, 2);
  return b;
}

static size_t count_of(const tc_volume *v, uint32_t segment, int z) {
  const tc_volume_desc *d = tc_volume_describe(v);
  size_t n = 0;
  for (int y = 0; y < d->dims[1]; y++)
    for (int x = 0; x < d->dims[0]; x++)
      for (uint32_t label = (uint32_t)voxel(v, x, y, z); label;) {
        const tc_segment *s = tc_volume_segment(v, label);
        n += label == segment || s->of[1] == segment;
        label = s->of[0];
      }
  return n;
}

TEST(contours_far_away_are_refused) {
  static const ring far = {1, 2e9, 20, 40, 0};
  g_autoptr(GError) error = NULL;
  assert_null(try_bytes(structures(&far, 1, "1.2.3.1"), "far.dcm", &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_FORMAT) && strstr(error->message, "over a kilometre away"));
}

/* Areas of discs and of a disc with a hole, on a grid of their planes, against pi r^2. */
TEST(contours_fill_their_area) {
  static const ring rings[] = {{1, 10, 20, 40, 0}, {1, 10, 20, 40, 3}, {1, 10, 20, 40, 6}, {2, 10, 20, 30, 3}, {2, 10, 20, 20, 3}};
  g_autoptr(tc_volume) v = open_bytes(structures(rings, 5, "1.2.3.1"), "rt.dcm");
  const tc_volume_desc *d = tc_volume_describe(v);
  const double pixel = d->spacing[0] * d->spacing[1];
  assert_int_equal(d->dims[2], 3);
  assert_true(fabs(d->spacing[2] - 3) < 1e-9);
  for (int z = 0; z < 3; z++) assert_true(fabs((double)count_of(v, 1, z) * pixel / (G_PI * 40 * 40) - 1) < 2e-3);
  assert_true(fabs((double)count_of(v, 2, 1) * pixel / (G_PI * (30 * 30 - 20 * 20)) - 1) < 4e-3);
  assert_true(count_of(v, 2, 0) == 0 && count_of(v, 2, 2) == 0);
  assert_string_equal(tc_volume_segment(v, 1)->name, "PTV");
  assert_color(tc_volume_segment(v, 2), 0, 0.5, 1);
}

/* On the grid of the series they were drawn on: which voxels, one by one, against the distance from the centre. */
TEST(contours_lie_on_the_series_beside) {
  enum { SIDE = 40, SLICES = 5 };
  static const ring rings[] = {{1, 12.3, 9.1, 6.2, 4}, {1, 12.3, 9.1, 6.2, 8}, {2, 12.3, 9.1, 3, 8}};
  int16_t pixels[SIDE * SIDE] = {0};
  char *beside = g_build_filename(folder, "rt", NULL), *path = g_build_filename(beside, "rt.dcm", NULL), *choice;
  GError *error = NULL;
  g_mkdir(beside, 0700);
  for (int z = 0; z < SLICES; z++) {
    dicom_spec s;
    char name[16];
    dicom_spec_init(&s, SIDE, SIDE, pixels, sizeof pixels);
    s.position[2] = 2 * z;
    s.instance = z + 1;
    snprintf(name, sizeof name, "%d.dcm", z);
    assert_true(dicom_write(beside, name, &s));
  }
  GByteArray *b = structures(rings, 3, "1.2.3.1");
  assert_true(g_file_set_contents(path, (const char *)b->data, b->len, NULL));
  choice = g_strconcat(beside, "#1.2.3.88", NULL);
  tc_volume *v = tc_import(choice, &(tc_import_options){.helpers = TC_BINARY_DIR}, &error);
  if (!v) fail_msg("%s", error->message);
  const tc_volume_desc *d = tc_volume_describe(v);
  assert_true(d->dims[0] == SIDE && d->dims[2] == SLICES && d->spacing[0] == 0.75 && d->spacing[1] == 0.5);
  size_t wrong = 0, inside = 0;
  for (int z = 0; z < SLICES; z++)
    for (int y = 0; y < SIDE; y++)
      for (int x = 0; x < SIDE; x++) {
        const double r = hypot(0.75 * x - 12.3, 0.5 * y - 9.1);
        if (fabs(r - 6.2) < 1e-3 || fabs(r - 3) < 1e-3) continue;
        const bool first = r < 6.2 && z >= 2, second = r < 3 && z == 4; /* planes 4 mm apart reach the slice between */
        const uint32_t label = (uint32_t)voxel(v, x, y, z);
        const uint32_t want = first && second ? 3 : first ? 1 : 0;
        wrong += label != want;
        inside += first;
      }
  assert_true(inside > 100);
  if (wrong) fail_msg("%zu voxels of %zu are wrong", wrong, inside);
  tc_volume_unref(v);
  g_byte_array_free(b, TRUE);
  g_free(choice);
  g_free(path);
  g_free(beside);
}

/* ---- layered NRRD ---- */

TEST(layers_of_slicer) {
  static const char head[] =
      "NRRD0004\ntype: unsigned char\ndimension: 4\nspace: left-posterior-superior\nsizes: 2 3 2 1\nkinds: list domain domain domain\n"
      "space directions: none (1,0,0) (0,1,0) (0,0,1)\nencoding: raw\n"
      "Segment0_ID:=Segment_1\nSegment0_Name:=liver\nSegment0_Color:=0.8 0.4 0.2\nSegment0_LabelValue:=1\nSegment0_Layer:=0\n"
      "Segment1_Name:=tumour\nSegment1_Color:=1 0 0\nSegment1_LabelValue:=1\nSegment1_Layer:=1\n"
      "Segment2_Name:=vessel\nSegment2_LabelValue:=2\nSegment2_Layer:=0\n\n";
  static const uint8_t voxels[12] = {0, 0, 1, 0, 1, 1, 2, 0, 2, 1, 0, 1};
  GByteArray *b = g_byte_array_new();
  g_byte_array_append(b, (const guint8 *)head, sizeof head - 1);
  g_byte_array_append(b, voxels, sizeof voxels);
  g_autoptr(tc_volume) v = open_bytes(b, "layers.seg.nrrd");
  static const uint32_t of[6][2] = {{0, 0}, {1, 0}, {1, 2}, {3, 0}, {2, 3}, {2, 0}};
  for (int i = 0; i < 6; i++) {
    const uint32_t label = (uint32_t)voxel(v, i % 3, i / 3, 0);
    const tc_segment *s = label ? tc_volume_segment(v, label) : NULL;
    const uint32_t got[2] = {s && s->of[0] ? s->of[0] : label, s ? s->of[1] : 0};
    if (got[0] != of[i][0] || got[1] != of[i][1]) fail_msg("voxel %d is of %u and %u", i, got[0], got[1]);
  }
  assert_string_equal(tc_volume_segment(v, 2)->name, "tumour");
  assert_color(tc_volume_segment(v, 1), 0.8, 0.4, 0.2);
  assert_int_equal(tc_volume_describe(v)->frames, 1);
}

/* ---- combinations ---- */

/* Labels of random stamps name exactly the segments that were stamped, one label a set. */
TEST(combinations_are_exact) {
  enum { SEGMENTS = 9, VOXELS = 400 };
  tc_overlaps o;
  uint32_t labels[VOXELS] = {0}, sets[VOXELS] = {0};
  GRand *random = g_rand_new_with_seed(7);
  tc_overlaps_init(&o, SEGMENTS);
  for (int i = 0; i < 4000; i++) {
    const int v = g_rand_int_range(random, 0, VOXELS);
    const uint32_t s = (uint32_t)g_rand_int_range(random, 1, SEGMENTS + 1);
    labels[v] = tc_overlaps_label(&o, labels[v], s);
    sets[v] |= 1u << s;
  }
  GHashTable *label_of = g_hash_table_new(NULL, NULL);
  for (int v = 0; v < VOXELS; v++) {
    uint32_t set = 0, label = labels[v];
    for (; label > SEGMENTS; label = g_array_index(o.made, tc_segment, label - SEGMENTS - 1).of[0])
      set |= 1u << g_array_index(o.made, tc_segment, label - SEGMENTS - 1).of[1];
    if (label) set |= 1u << label;
    assert_int_equal(set, sets[v]);
    const gpointer known = g_hash_table_lookup(label_of, GUINT_TO_POINTER(set));
    if (known) assert_true(GPOINTER_TO_UINT(known) == labels[v]);
    g_hash_table_insert(label_of, GUINT_TO_POINTER(set), GUINT_TO_POINTER(labels[v]));
  }
  g_hash_table_unref(label_of);
  g_rand_free(random);
  tc_overlaps_finish(&o);
}

TESTS(make_folder, remove_folder)
