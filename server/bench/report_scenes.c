/* The built-in scenes: demo volumes as users see them, and synthetic fields that are smooth, stiff or rough on purpose.
 */
#include <math.h>
#include <string.h>

#include "server/bench/report.h"

/* A field over [-1, 1]^3 with values 0..1. */
typedef double (*field_fn)(double x, double y, double z);

static double polynomial(double x, double y, double z) {
  return 0.5 + 0.2 * x + 0.1 * y * z - 0.12 * x * y * z + 0.08 * z;
}
static double blob(double x, double y, double z) { return exp(-2.5 * (x * x + 1.3 * y * y + 0.8 * z * z)); }
static double slope(double x, double y, double z) { return 0.5 + 0.3 * y + 0.1 * x + 0.1 * z * x; }

static double noise(double x, double y, double z) {
  uint32_t h = (uint32_t)((x + 1) * 4096) * 0x9E3779B1u ^ (uint32_t)((y + 1) * 4096) * 0x85EBCA77u ^
               (uint32_t)((z + 1) * 4096) * 0xC2B2AE3Du;
  h ^= h >> 15, h *= 0x2C1B3C6Du, h ^= h >> 12, h *= 0x297A2D39u, h ^= h >> 15;
  return h / 4294967295.0;
}

static tc_volume *synthesise(field_fn f, int n, tc_voxel_type type, GError **error) {
  tc_volume_desc d = {.dims = {n, n, n},
                      .type = type,
                      .spacing = {1, 1, 1},
                      .slope = 1,
                      .frames = 1,
                      .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                      .format = "demo"};
  for (int k = 0; k < 3; k++) d.origin[k] = -0.5 * (n - 1);
  tc_volume *v = tc_volume_new(&d, error);
  if (!v) return NULL;
  size_t i = 0;
  for (int z = 0; z < n; z++)
    for (int y = 0; y < n; y++)
      for (int x = 0; x < n; x++, i++) {
        double value = f(2.0 * x / (n - 1) - 1, 2.0 * y / (n - 1) - 1, 2.0 * z / (n - 1) - 1);
        if (type == TC_F32)
          ((float *)tc_volume_voxels(v))[i] = (float)value;
        else if (type == TC_U16)
          ((uint16_t *)tc_volume_voxels(v))[i] = (uint16_t)lrint(65535 * value);
        else
          ((uint8_t *)tc_volume_voxels(v))[i] = (uint8_t)lrint(255 * value);
      }
  tc_volume_seal(v);
  return v;
}

/* ---- transfer functions of the synthetic fields; values 0..1 of the field's own range ---- */

#define WARM                                                                                                           \
  { 0.95, 0.6, 0.3 }
#define COOL                                                                                                           \
  { 0.2, 0.45, 0.9 }
static const tc_knot gentle[] = {{0, COOL, 0}, {1, WARM, 0.06}};
static const tc_knot dense[] = {{-0.2, COOL, 0.02}, {1.2, WARM, 0.7}}; /* no knot within the field's range */
static const tc_knot wall[] = {{0, COOL, 0}, {0.5, COOL, 0}, {0.5, WARM, 1e4}, {1, {1, 1, 0.9}, 1e4}};
static const tc_knot steep[] = {{0, COOL, 0}, {0.15, COOL, 0}, {1, WARM, 1e5}};
static const tc_knot speckle[] = {{0, COOL, 0}, {0.4, COOL, 0.02}, {1, WARM, 2}};
static const tc_knot peak[] = {{0, COOL, 0.002},
                               {29999.0 / 65535, COOL, 0.002},
                               {30000.0 / 65535, WARM, 2000},
                               {30001.0 / 65535, COOL, 0.002},
                               {1, COOL, 0.002}};

static void set_knots(tc_transfer_function *tf, const tc_knot *knots, size_t count, double top) {
  g_free(tf->points);
  *tf = (tc_transfer_function){.points = g_memdup2(knots, count * sizeof *knots),
                               .count = count,
                               .kind = TC_KNOT_EXTINCTION,
                               .unit_distance_mm = 1};
  for (size_t i = 0; i < count; i++) tf->points[i].value *= top;
}

/* Twenty thin shells of changing colour. */
static void set_shells(tc_transfer_function *tf, double top) {
  enum { SHELLS = 20 };
  tc_knot knots[3 * SHELLS];
  for (int i = 0; i < SHELLS; i++) {
    double v = 0.08 + 0.9 * i / SHELLS;
    for (int k = 0; k < 3; k++) {
      knots[3 * i + k] = (tc_knot){v + 0.004 * (k - 1), WARM, k == 1 ? 3 : 0};
      if (i % 2) memcpy(knots[3 * i + k].color, (const double[3])COOL, sizeof knots->color);
    }
  }
  set_knots(tf, knots, 3 * SHELLS, top);
}

typedef struct recipe {
  const char *name, *title, *why;
  const char *demo, *preset; /* a demo volume with a named transfer function, or */
  field_fn field;            /* a synthetic field */
  const tc_knot *knots;      /* NULL: shells */
  int count, side;
  tc_voxel_type type;
  bool smooth;
} recipe;

#define KNOTS(k) .knots = k, .count = G_N_ELEMENTS(k)
static const recipe recipes[] = {
    {"smooth", "Smooth polynomial",
     "One trilinear polynomial over the whole volume under a linear ramp: smooth along every ray, so each "
     "classification "
     "must show its own order.",
     .field = polynomial, KNOTS(dense), .side = 9, .type = TC_F32, .smooth = true},
    {"blob", "Gaussian blob",
     "A smooth field, but the trilinear interpolation of its voxels bends at every cell face: errors of single "
     "segments there "
     "are of second order, whatever the method.",
     .field = blob, KNOTS(gentle), .side = 64, .type = TC_F32},
    {"head", "Head phantom, skin and skull",
     "The demo as people see it. Noise and the preset's bends leave little that is smooth: orders fall towards 1.",
     .demo = "demo:head", .preset = "ct-head"},
    {"head-translucent", "Head phantom, translucent",
     "The same head as a radiograph-like haze: every sample of a ray counts, nothing hides an error.",
     .demo = "demo:head", .preset = "ct-mip"},
    {"vessels", "Vessel tree",
     "Thin bright tubes in much empty space: edges at the size of a voxel, and leaping at its best.",
     .demo = "demo:vessels", .preset = "vessels"},
    {"bucky", "Bucky ball",
     "Smooth clouds under seven colours: interpolation bends at cell faces, the transfer function at knots.",
     .demo = "demo:bucky", .preset = "spectrum"},
    {"marschner-lobb", "Marschner-Lobb signal",
     "The classic of reconstruction: ripples near the sampling limit under a surface-like ramp.",
     .demo = "demo:marschner-lobb", .preset = "surface"},
    {"wall", "Stiff: a wall",
     "Extinction jumps from 0 to 10 000/mm at one value. Pre-integration places the wall inside a segment; whatever "
     "classifies "
     "samples misses it by up to a step, which is first order in position and of order 0 where a ray grazes.",
     .field = blob, KNOTS(wall), .side = 48, .type = TC_F32},
    {"steep", "Stiff: a steep ramp",
     "Extinction rises to 100 000/mm: the picture is made within microns of the surface, a thousandth of a step. "
     "Linear "
     "segment opacities overshoot by many orders of magnitude here.",
     .field = blob, KNOTS(steep), .side = 48, .type = TC_F32},
    {"peak", "Stiff: a peak one value wide",
     "16-bit voxels and a shell one of 65 536 values wide: no step finds it by sampling, a table must hold it between "
     "two entries.",
     .field = slope, KNOTS(peak), .side = 64, .type = TC_U16},
    {"shells", "Stiff: twenty thin shells",
     "Narrow peaks of two colours: several fall into one segment, so that the order of colours within it counts.",
     .field = blob, .knots = NULL, .side = 64, .type = TC_U16},
    {"noise", "Rough: white noise",
     "Each voxel independent: the field turns within every cell, which no line between two samples follows.",
     .field = noise, KNOTS(speckle), .side = 48, .type = TC_U8}};

int tcs_report_scene_count(void) { return G_N_ELEMENTS(recipes); }

static void usual(tc_scene *s) {
  s->classification = TC_PREINTEGRATED;
  s->order = TC_FRONT_TO_BACK;
  s->filter = TC_FILTER_LINEAR;
  s->sampling.rays_per_pixel = 1;
  s->sampling.coherence = s->sampling.jitter = false;
  s->sampling.termination = 0;
}

static bool fit(tcs_report_scene *made) {
  if (!made->volume) return false;
  tc_scene_init(&made->scene);
  tc_scene_fit(&made->scene, made->volume);
  tcs_cli_place_camera(made->volume, 30, 20, 1.3, &made->scene.camera);
  usual(&made->scene);
  return true;
}

bool tcs_report_scene_make(int index, tcs_report_scene *made, GError **error) {
  const recipe *r = &recipes[index];
  *made = (tcs_report_scene){.smooth = r->smooth};
  g_strlcpy(made->name, r->name, sizeof made->name);
  g_strlcpy(made->title, r->title, sizeof made->title);
  g_strlcpy(made->why, r->why, sizeof made->why);
  made->volume = r->demo ? tc_import(r->demo, NULL, error) : synthesise(r->field, r->side, r->type, error);
  if (!fit(made)) return false;
  tc_transfer_function *tf = &made->scene.transfer_function;
  const tc_volume_stats *range = tc_volume_statistics(made->volume);
  double top = r->type == TC_U16 ? 65535 : r->type == TC_U8 ? 255 : 1;
  if (r->preset)
    tc_transfer_function_set_preset(tf, r->preset, range->min, range->max);
  else if (r->knots)
    set_knots(tf, r->knots, (size_t)r->count, top);
  else
    set_shells(tf, top);
  return true;
}

bool tcs_report_scene_load(const char *volume, const char *document, tcs_report_scene *made, GError **error) {
  *made = (tcs_report_scene){.title = "", .why = "Given on the command line."};
  const char *slash = strrchr(volume, '/');
  g_strlcpy(made->name, slash && slash[1] ? slash + 1 : volume, sizeof made->name);
  g_strlcpy(made->title, made->name, sizeof made->title);
  made->volume = tc_import(volume, NULL, error);
  if (!fit(made)) return false;
  const tcs_cli_scene from = {.file = document};
  int exit_code;
  tc_fit fitted;
  tc_fit_find(&fitted, made->volume);
  if (!tcs_cli_lay_scene(&from, &fitted, &made->scene, &exit_code, error)) return false;
  if (made->scene.mode != TC_MODE_DVR) {
    tc_set_error(error, TC_ERROR_INVALID, "/mode", "%s: mode dvr expected: other modes have no sweep", document);
    return false;
  }
  usual(&made->scene);
  return true;
}

void tcs_report_scene_clear(tcs_report_scene *scene) {
  tc_scene_clear(&scene->scene);
  tc_volume_unref(scene->volume);
  *scene = (tcs_report_scene){0};
}
