/* Series of the nasty kinds, written here and opened by the real helper: each comes out right at every voxel, or is
 * refused with its reason.
 *
 * Pixels hold a field that is linear in patient space, plus a thousand for each volume of the series. Linear
 * interpolation along the stack must give it back on any grid, and a slice of another volume is off by a thousand. */
#include "tests/support/test.h"

#include "renderer/import/helper.h"
#include "tests/support/dicom_files.h"

enum { COLUMNS = 5, ROWS = 4, PIXELS = COLUMNS * ROWS, LAYERS = 12 };

static const tc_import_options with_helper = {.helpers = TC_BINARY_DIR};

/* One picture. z: mm along the stack. */
typedef struct shot {
  double z;
  int volume, instance, acquisition, echo, time, plane, uid;
  double b_value;
  bool cut; /* the file ends within its pixels */
  const char *type, *echo_time, *stack;
} shot;

typedef struct nasty {
  GArray *shots;
  int plane;           /* of planes[] */
  double tilt;         /* degrees between the normal and the stack */
  int volumes;         /* that it must make */
  bool by_choice;      /* a volume must be chosen */
  const char *refusal; /* part of the reason, where it must be refused; NULL: it opens */
  const char *note;    /* part of the note of the first volume */
} nasty;

static const double planes[4][6] = {
    {1, 0, 0, 0, 1, 0}, {0, 1, 0, 0, 0, -1}, {-1, 0, 0, 0, 0, 1}, {0.6, 0.8, 0, -0.48, 0.36, 0.8}};

static double field(const double p[3], int volume) { return 7 * p[0] + 5 * p[1] + 9 * p[2] + 1000 * volume; }

/* ---- writing ---- */

/* Row, column, and the direction of the stack. */
static void axes_of(const nasty *c, int plane, double axes[3][3]) {
  const double *o = planes[plane], t = c->tilt * G_PI / 180;
  for (int k = 0; k < 3; k++) {
    int a = (k + 1) % 3, b = (k + 2) % 3;
    axes[0][k] = o[k];
    axes[1][k] = o[3 + k];
    axes[2][k] = cos(t) * (o[a] * o[3 + b] - o[b] * o[3 + a]) + sin(t) * o[3 + k];
  }
}

static void write_shot(const char *folder, const nasty *c, const shot *shot, guint number) {
  int16_t pixels[PIXELS];
  double axes[3][3];
  char name[32], orientation[160], uid[32];
  dicom_spec s;
  dicom_spec_init(&s, COLUMNS, ROWS, pixels, sizeof pixels);
  axes_of(c, shot->plane ? shot->plane : c->plane, axes);
  for (int k = 0; k < 3; k++) s.position[k] = -3 + k + axes[2][k] * shot->z;
  for (int i = 0; i < PIXELS; i++) {
    double p[3];
    for (int k = 0; k < 3; k++)
      p[k] = s.position[k] + 0.75 * (i % COLUMNS) * axes[0][k] + 0.5 * (double)(i / COLUMNS) * axes[1][k];
    pixels[i] = (int16_t)lround(field(p, shot->volume));
  }
  const double *o = planes[shot->plane ? shot->plane : c->plane];
  snprintf(orientation, sizeof orientation, "%.9g\\%.9g\\%.9g\\%.9g\\%.9g\\%.9g", o[0], o[1], o[2], o[3], o[4], o[5]);
  snprintf(uid, sizeof uid, "1.2.9.%d", shot->uid);
  s.orientation = orientation;
  s.uid = uid;
  s.intercept = "0";
  s.instance = shot->instance;
  s.acquisition = shot->acquisition;
  s.echo = shot->echo;
  s.echo_time = shot->echo_time;
  s.time = shot->time;
  s.stack = shot->stack;
  s.b_value = shot->b_value;
  s.image_type = shot->type;
  snprintf(name, sizeof name, "%03u_%u", number * 37 % 101, number); /* names say nothing about the order */
  if (shot->cut) s.pixel_bytes /= 2;
  assert_true(dicom_write(folder, name, &s));
}

/* ---- checking ---- */

static void check_voxels(const char *what, const tc_volume *v, int volume) {
  const tc_volume_desc *d = tc_volume_describe(v);
  const int16_t *voxels = tc_volume_data(v);
  for (int z = 0; z < d->dims[2]; z++)
    for (int i = 0; i < PIXELS; i++) {
      double p[3], index[3] = {i % COLUMNS, (double)(i / COLUMNS), z};
      tc_volume_index_to_lps(v, index, p);
      double off = voxels[z * PIXELS + i] - field(p, volume); /* half a unit of the pixel, half of the mixture */
      if (!(fabs(off) <= 1.01)) fail_msg("%s, volume %d, layer %d: off by %g (%s)", what, volume, z, off, d->note);
    }
}

static void check_case(const char *what, const nasty *c) {
  g_autofree char *folder = temp_folder();
  GError *error = NULL;
  for (guint i = 0; i < c->shots->len; i++) write_shot(folder, c, &g_array_index(c->shots, shot, i), i);
  tc_volume *v = tc_helper_load(TC_HELPER_DICOM, folder, NULL, &with_helper, &error);
  if (c->refusal || c->by_choice) {
    if (v) fail_msg("%s was opened: %s", what, tc_volume_describe(v)->note);
    const char *wanted = c->refusal ? c->refusal : "choose one by #volume=1";
    if (!strstr(error->message, wanted)) fail_msg("%s: %s", what, error->message);
    g_clear_error(&error);
  } else {
    if (!v) fail_msg("%s: %s", what, error->message);
    const tc_volume_desc *d = tc_volume_describe(v);
    assert_int_equal(d->type, TC_I16);
    if (d->frames != c->volumes) fail_msg("%s: %d volumes (%s)", what, d->frames, d->note);
    if (c->note && !strstr(d->note, c->note)) fail_msg("%s: %s", what, d->note);
    const tc_provenance *from = tc_volume_provenance(v);
    if (c->volumes == 1) assert_true(from->slices_used == from->slices_found);
    check_voxels(what, v, from->volume);
    tc_volume_unref(v);
  }
  for (int volume = 1; volume <= c->volumes && !c->refusal && c->volumes > 1; volume++) {
    char choice[24];
    snprintf(choice, sizeof choice, "1#volume=%d", volume);
    v = tc_helper_load(TC_HELPER_DICOM, folder, choice, &with_helper, &error);
    if (!v) fail_msg("%s, volume %d: %s", what, volume, error->message);
    assert_int_equal(tc_volume_provenance(v)->volume, volume);
    check_voxels(what, v, volume);
    tc_volume_unref(v);
  }
  remove_tree(folder);
}

/* ---- making ---- */

static nasty start(int variant) {
  return (nasty){.shots = g_array_new(FALSE, TRUE, sizeof(shot)), .plane = variant % 4, .volumes = 1};
}

static shot *add(nasty *c, double z, int volume) {
  const int number = (int)c->shots->len + 1;
  const shot one = {.z = z, .volume = volume, .instance = number, .acquisition = 1, .uid = number, .b_value = -1};
  g_array_append_val(c->shots, one);
  return &g_array_index(c->shots, shot, number - 1);
}

/* A stack of equal steps; one of the shots left out, -1: none. */
static void add_stack(nasty *c, double from, double step, int left_out, int volume) {
  for (int z = 0; z < LAYERS; z++)
    if (z != left_out) add(c, from + step * z, volume);
}

/* Up or down the patient, with positions that are rounded as some writers do. */
static void regular(nasty *c, int variant) {
  const double step = variant % 2 ? -2 : 3;
  for (int z = 0; z < LAYERS; z++) add(c, step * z + 0.01 * variant * (z % 2), 1);
}

static void one_cut(nasty *c, int variant) {
  c->note = "1 unreadable files left out";
  add_stack(c, 0, 2.5, -1, 1);
  g_array_index(c->shots, shot, 1 + 2 * variant).cut = true;
}

static void tilted(nasty *c, int variant) {
  c->tilt = 4 + 6 * variant;
  c->note = "gantry tilt";
  add_stack(c, 0, 3, -1, 1);
}

static void varying(nasty *c, int variant) {
  static const double later[5] = {7.38, 2.1, 4, 5, 3.3};
  c->tilt = variant % 2 ? 18.5 : 0;
  c->note = "12 slices resampled";
  for (int z = 0; z < LAYERS; z++) add(c, z < 6 ? 2.5 * z : 12.5 + later[variant] * (z - 5), 1);
  if (variant == 2) g_array_index(c->shots, shot, 9).z += 1.1;
}

static void a_gap(nasty *c, int variant) {
  c->note = "1 missing slice bridged";
  add_stack(c, 5, 1.25 + variant, 1 + 2 * variant, 1);
}

static void two_gaps(nasty *c, int variant) {
  c->refusal = "2 slices are missing";
  add_stack(c, 5, 2, 3, 1);
  g_array_remove_index(c->shots, (guint)(5 + variant));
}

static void copied(nasty *c, int variant) {
  c->note = variant ? "3 copies" : "1 copies";
  add_stack(c, 5, 2, -1, 1);
  for (int i = 0; i <= 2 * variant; i++) {
    const shot again = g_array_index(c->shots, shot, 3);
    g_array_append_val(c->shots, again);
  }
}

/* Two to three volumes on one another, told apart by one attribute; the first lacks a slice; instances start again. */
static void by_key(nasty *c, int variant) {
  static const char *const times[4] = {"", "10", "90.5", "120"};
  static const char *const types[4] = {"", "ORIGINAL\\PRIMARY\\M", "ORIGINAL\\PRIMARY\\P", "ORIGINAL\\PRIMARY\\R"};
  static const char *const stacks[4] = {"", "A", "B", "C"};
  c->volumes = 2 + variant % 2;
  for (int v = 1; v <= c->volumes; v++) {
    guint from = c->shots->len;
    add_stack(c, 0, 3, v == 1 ? 0 : -1, v);
    for (guint i = from; i < c->shots->len; i++) {
      shot *s = &g_array_index(c->shots, shot, i);
      s->instance = (int)(i - from) + 1;
      if (variant == 0 || variant == 2) s->echo = v;
      if (variant == 1 || variant == 2) s->echo_time = times[v];
      if (variant == 3) s->time = v;
      if (variant == 4) s->b_value = 500 * (v - 1);
      if (variant == 5) s->type = types[v];
      if (variant == 6) s->acquisition = v;
      if (variant == 7) s->stack = stacks[v];
    }
  }
}

/* Nothing but the instances tells the time points apart; in the second kind one of them lacks a slice. */
static void by_turn(nasty *c, int variant) {
  c->volumes = 3;
  for (int v = 1; v <= 3; v++) add_stack(c, 0, 3, variant && v == 2 ? 4 * variant : -1, v);
}

static void offset_acquisitions(nasty *c, int variant) {
  c->volumes = 2;
  c->note = variant ? "12 of 24 slices" : "volume 1 of 2: acquisition 1";
  add_stack(c, 0, 3, -1, 1);
  add_stack(c, 1.5 - 0.4 * variant, 3, -1, 2);
  for (guint i = LAYERS; i < c->shots->len; i++) g_array_index(c->shots, shot, i).acquisition = 2;
}

/* A scan made of one acquisition after the other, of two image types. */
static void pieces(nasty *c, int variant) {
  c->tilt = 18.5 * (variant % 2);
  add_stack(c, 0, 4, -1, 1);
  for (guint i = 0; i < c->shots->len; i++) {
    shot *s = &g_array_index(c->shots, shot, i);
    s->acquisition = 1 + (int)i / (1 + variant);
    s->type = i < 6 ? "ORIGINAL\\PRIMARY\\AXIAL\\ADD" : "ORIGINAL\\PRIMARY\\AXIAL";
  }
}

static void three_planes(nasty *c, int variant) {
  c->by_choice = true;
  c->volumes = 3;
  for (int v = 1; v <= 3; v++)
    for (int i = 0; i < 3; i++) add(c, (5 + variant) * i, v)->plane = v;
}

static void tangled(nasty *c, int variant) {
  c->refusal = "nothing in their headers tells them apart";
  add_stack(c, 0, 3, -1, 1);
  for (int i = 0; i < 5 + variant; i++) add(c, 3 * ((i * 5 + 1) % LAYERS), 2)->instance = 40 - i * i % 7;
}

static const struct {
  const char *what;
  void (*make)(nasty *c, int variant);
  int variants;
} kinds[] = {
    {"regular", regular, 6}, {"a cut file", one_cut, 5},         {"tilt", tilted, 6},   {"varying steps", varying, 5},
    {"a gap", a_gap, 5},     {"two gaps", two_gaps, 5},          {"copies", copied, 2}, {"keys", by_key, 8},
    {"turns", by_turn, 3},   {"offset", offset_acquisitions, 3}, {"pieces", pieces, 5}, {"planes", three_planes, 3},
    {"tangled", tangled, 4}};

/* Each kind in its variants, each in one of four planes. */
TEST(nasty_series) {
  int series = 0;
  for (size_t k = 0; k < G_N_ELEMENTS(kinds); k++)
    for (int variant = 0; variant < kinds[k].variants; variant += STRIDE(2)) {
      nasty c = start(variant + (int)k);
      char what[64];
      snprintf(what, sizeof what, "%s, variant %d", kinds[k].what, variant);
      kinds[k].make(&c, variant);
      check_case(what, &c);
      g_array_free(c.shots, TRUE);
      series++;
    }
  print_message("%d series\n", series);
}

/* Who wants no slice made up gets none. */
TEST(bridging_can_be_refused) {
  tc_import_options strict = with_helper;
  nasty c = start(0);
  GError *error = NULL;
  char *folder = temp_folder();
  strict.bridge_nothing = true;
  a_gap(&c, 1);
  for (guint i = 0; i < c.shots->len; i++) write_shot(folder, &c, &g_array_index(c.shots, shot, i), i);
  assert_null(tc_helper_load(TC_HELPER_DICOM, folder, NULL, &strict, &error));
  assert_string_equal(error->message, "slice 4 of 12 is missing, and none is made up here; send the whole series");
  g_clear_error(&error);
  tc_volume *v = tc_helper_load(TC_HELPER_DICOM, folder, NULL, &with_helper, &error);
  assert_int_equal(tc_volume_provenance(v)->bridged, 4);
  tc_volume_unref(v);
  remove_tree(folder);
  g_free(folder);
  g_array_free(c.shots, TRUE);
}

TEST(a_wrong_choice) {
  nasty c = start(0);
  GError *error = NULL;
  char *folder = temp_folder();
  by_turn(&c, 0);
  for (guint i = 0; i < c.shots->len; i++) write_shot(folder, &c, &g_array_index(c.shots, shot, i), i);
  assert_null(tc_helper_load(TC_HELPER_DICOM, folder, "volume=4", &with_helper, &error));
  assert_int_equal(error->code, TC_ERROR_NOT_FOUND);
  g_clear_error(&error);
  assert_null(tc_helper_load(TC_HELPER_DICOM, folder, "1#volume=x", &with_helper, &error));
  assert_int_equal(error->code, TC_ERROR_INVALID);
  g_clear_error(&error);
  char *path = g_strconcat(folder, "#1#volume=2", NULL);
  tc_volume *v = tc_import(path, &with_helper, &error);
  assert_non_null(v);
  check_voxels("by path", v, 2);
  tc_volume_unref(v);
  tc_series *series;
  size_t count;
  assert_true(tc_helper_list(folder, &with_helper, &series, &count, NULL));
  assert_int_equal(count, 3);
  for (int i = 0; i < 3; i++)
    assert_true(series[i].number == 1 && series[i].volume == i + 1 && series[i].slices == LAYERS);
  g_free(series);
  g_free(path);
  remove_tree(folder);
  g_free(folder);
  g_array_free(c.shots, TRUE);
}

TESTS(NULL, NULL)
