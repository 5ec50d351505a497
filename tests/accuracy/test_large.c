/* Volumes of more than 2^31 bytes: offsets of voxels and bytes past 32 bits, in every instruction set. Content lies in the
 * far corner alone, so that the volume's other pages take no memory; the same content in a volume of its own, drawn by
 * the same kernel, is the judge. */
#include "tests/support/test.h"

#include "renderer/tomocast.h"
#include "renderer/volume/histogram.h"
#include "tests/support/grid.h"
#include "tests/support/renderers.h"

#define SIDE 48 /* voxels of the corner */
#define PIXELS 40

typedef struct range { double lo, hi; } range;
static const range ranges[TC_VOXEL_TYPE_COUNT] = {{0, 250}, {-120, 120}, {0, 60000}, {-30000, 30000}, {-1, 3}};

static double corner_field(double x, double y, double z, const void *context) {
  const range *r = context;
  double wavelength = 13;
  return r->lo + (r->hi - r->lo) * test_waves(x, y, z, &wavelength);
}

/* The corner as a volume of its own, where it lies in the large one. */
static tc_volume *small_volume(tc_voxel_type type, const int dims[3]) {
  test_grid grid = {.dims = {SIDE, SIDE, SIDE}, .type = type};
  for (int k = 0; k < 3; k++) grid.origin[k] = dims[k] - SIDE;
  return test_volume(&grid, corner_field, &ranges[type]);
}

static tc_volume *large_volume(const tc_volume *corner, const int dims[3]) {
  tc_volume_desc desc = *tc_volume_describe(corner);
  for (int k = 0; k < 3; k++) desc.dims[k] = dims[k], desc.origin[k] = 0;
  tc_volume *v = tc_volume_new(&desc, NULL);
  assert_non_null(v);
  const size_t size = tc_voxel_size(desc.type), row = SIDE * size;
  const char *from = tc_volume_data(corner);
  char *to = tc_volume_voxels(v);
  for (size_t z = 0; z < SIDE; z++)
    for (size_t y = 0; y < SIDE; y++) {
      size_t at = ((z + (size_t)dims[2] - SIDE) * (size_t)dims[1] + y + (size_t)dims[1] - SIDE) * (size_t)dims[0];
      memcpy(to + (at + (size_t)dims[0] - SIDE) * size, from + (z * SIDE + y) * row, row);
    }
  const tc_volume_stats *s = tc_volume_statistics(corner);
  tc_volume_seal_within(v, s->voxel_min, s->voxel_max);
  return v;
}

/* ---- scenes ---- */

typedef struct look {
  const char *name;
  tc_mode mode;
  tc_filter filter;
  tc_classification classification;
  tc_shading_model shading;
  tc_gradient gradient;
  tc_compositing_order order;
  double slab_mm;
  tc_slab_projection projection;
  bool near; /* so that packets fit neighbourhoods in registers; packets of the others do not fit */
} look;

static const look looks[] = {
    {.name = "dvr"},
    {.name = "dvr, central", .shading = TC_SHADING_LAMBERT, .gradient = TC_GRADIENT_CENTRAL},
    {.name = "dvr, near", .near = true},
    {.name = "dvr, central, near", .shading = TC_SHADING_LAMBERT, .gradient = TC_GRADIENT_CENTRAL, .near = true},
    {.name = "dvr, cell", .shading = TC_SHADING_LAMBERT, .gradient = TC_GRADIENT_CELL},
    {.name = "dvr, cubic gradient", .shading = TC_SHADING_LAMBERT, .gradient = TC_GRADIENT_CUBIC},
    {.name = "dvr, nearest", .filter = TC_FILTER_NEAREST},
    {.name = "dvr, cubic", .filter = TC_FILTER_CUBIC},
    {.name = "dvr, second order", .classification = TC_PREINTEGRATED2},
    {.name = "dvr, back to front", .classification = TC_POST, .order = TC_BACK_TO_FRONT},
    {.name = "mip", .mode = TC_MODE_MIP},
    {.name = "mip, near", .mode = TC_MODE_MIP, .near = true},
    {.name = "minip", .mode = TC_MODE_MINIP},
    {.name = "average", .mode = TC_MODE_AVERAGE},
    {.name = "isosurface", .mode = TC_MODE_ISOSURFACE, .shading = TC_SHADING_LAMBERT, .gradient = TC_GRADIENT_CENTRAL},
    {.name = "slice", .mode = TC_MODE_MPR},
    {.name = "slab, mip", .mode = TC_MODE_MPR, .slab_mm = 9, .projection = TC_SLAB_MIP},
    {.name = "slab, average", .mode = TC_MODE_MPR, .slab_mm = 9, .projection = TC_SLAB_AVERAGE},
};
#define N_LOOKS (int)(sizeof looks / sizeof *looks)

/* Looks at the corner. Its three first voxels along each axis are clipped, because gradients and filters reach over the
 * small volume's edge. */
static void corner_scene(tc_scene *s, const look *l, const tc_volume *corner) {
  const tc_volume_desc *d = tc_volume_describe(corner);
  const tc_volume_stats *range_of = tc_volume_statistics(corner);
  const double lo = range_of->min, hi = range_of->max;
  const tc_knot knots[] = {{.value = lo, .color = {0.1, 0.2, 1}}, {.value = hi, .color = {1, 0.6, 0.2}, .amount = 0.2}};
  test_scene(s, PIXELS, PIXELS);
  test_scene_frame(s, corner, TC_PERSPECTIVE, (double[3]){-0.5, -1, 0.7});
  if (l->near) s->camera.fov_y_deg *= 0.3;
  test_scene_knots(s, TC_KNOT_EXTINCTION, knots, 2);
  s->window.center = 0.5 * (lo + hi), s->window.width = hi - lo;
  s->isosurface.value = s->window.center;
  s->clip.has_box = true;
  for (int k = 0; k < 3; k++) {
    s->clip.box[0][k] = d->origin[k] + 3, s->clip.box[1][k] = d->origin[k] + SIDE - 1;
    s->mpr.center[k] = d->origin[k] + 0.5 * SIDE + 0.3;
  }
  s->mpr.has_center = true;
  s->mpr.orientation = TC_CORONAL;
  s->mpr.thickness_mm = l->slab_mm, s->mpr.projection = l->projection;
  s->mode = l->mode, s->filter = l->filter, s->classification = l->classification, s->order = l->order;
  s->shading.model = l->shading, s->shading.gradient = l->gradient;
}

/* Pixels of the large volume's picture that are not those of the small one. Positions have single precision, so a pixel
 * at an edge may be: 1 in 100. Each shows something. */
static void compare(int which, const look *l, tc_volume *large, tc_volume *corner, tc_skipping_mode skipping) {
  g_auto(tc_scene) s;
  static float want[PIXELS * PIXELS * 4];
  corner_scene(&s, l, corner);
  s.skipping.mode = skipping;
  memcpy(want, test_draw(which, corner, &s, NULL, NULL)->linear, sizeof want);
  s.mpr.zoom = (tc_volume_describe(large)->dims[0] - 1) / (SIDE - 1.0); /* pixels of the same size */
  const float *got = test_draw(which, large, &s, NULL, NULL)->linear;
  int off = 0, shown = 0;
  for (int p = 0; p < PIXELS * PIXELS; p++) {
    double most = 0;
    for (int c = 0; c < 4; c++) most = fmax(most, fabs((double)got[4 * p + c] - (double)want[4 * p + c]));
    off += most > 0.01;
    shown += want[4 * p + 3] > 0.05f && want[4 * p] > 0.01f;
  }
  if (off || shown < PIXELS * PIXELS / 4)
    printf("  %s %-6s %-20s %d of %d pixels differ, %d shown\n", tc_voxel_type_name(tc_volume_describe(large)->type),
           test_names[which], l->name, off, PIXELS * PIXELS, shown);
  assert_true(off <= PIXELS * PIXELS / 100);
  assert_true(shown > PIXELS * PIXELS / 4);
}

/* 2^31 - 2^21 voxels: 2 GiB of bytes, 4 GiB of 16 bits. */
static const int most_voxels[3] = {2048, 2048, 511}, floats[3] = {1024, 1024, 640};

TEST(far_corner) {
  for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++) {
    const int *dims = type == TC_F32 ? floats : most_voxels;
    g_autoptr(tc_volume) corner = small_volume((tc_voxel_type)type, dims);
    g_autoptr(tc_volume) large = large_volume(corner, dims);
    printf("%s, %zu MiB\n", tc_voxel_type_name((tc_voxel_type)type), tc_volume_bytes(large) >> 20);
    for (int l = 0; l < N_LOOKS; l++) EACH_CPU(i) compare(i, &looks[l], large, corner, TC_SKIPPING_OFF);
  }
}

/* What is built of all voxels: minima and maxima, levels, distances, the histogram. */
TEST(structures) {
#ifdef __SANITIZE_THREAD__ /* would keep a record of every voxel that is read */
  skip();
#endif
  g_autoptr(tc_volume) corner = small_volume(TC_U16, most_voxels);
  g_autoptr(tc_volume) large = large_volume(corner, most_voxels);
  for (int l = 0; l < N_LOOKS; l++) {
    const tc_mode mode = looks[l].mode;
    bool first_of_mode = l == 0 || looks[l - 1].mode != mode;
    if (SANITIZED && mode != TC_MODE_DVR) continue; /* each mode reads all voxels again */
    if (first_of_mode && (mode == TC_MODE_DVR || mode == TC_MODE_MIP || mode == TC_MODE_ISOSURFACE))
      compare(test_widest(), &looks[l], large, corner, TC_SKIPPING_AUTO);
  }
  enum { BINS = 100 };
  uint64_t counts[BINS], total = 0;
  double edges[BINS + 1], value, wanted;
  tc_volume_histogram(large, BINS, counts, edges);
  for (int i = 0; i < BINS; i++) total += counts[i];
  assert_int_equal(total, tc_volume_bytes(large) / 2);
  const double at[3] = {most_voxels[0] - 7.5, most_voxels[1] - 3, most_voxels[2] - 5};
  const double there[3] = {SIDE - 7.5, SIDE - 3, SIDE - 5};
  assert_true(tc_volume_value_at(large, at, &value) && tc_volume_value_at(corner, there, &wanted));
  printf("value %g, %g expected\n", value, wanted);
  assert_true(value == wanted);
}

TESTS(test_renderers_open, test_renderers_close)
