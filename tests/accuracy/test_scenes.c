/* Random scenes of every mode: the gl back end draws them as the cpu does, and what skipping and culling leave out changes no bit.
 * Other tests draw what they are about; these scenes combine it (planes with thin voxels, labels with slabs, a filter with a
 * gradient). TC_LONG=1 draws 2,000 instead of 120; TC_SEEDS=200-400 those of these numbers. */
#include "tests/support/splats.h"

#include "renderer/base/vector.h"
#include "renderer/mesh/gl/mesh.h"
#include "renderer/plan/plan.h"
#include "tests/support/renderers.h"

enum { W = 150, H = 120 };

typedef struct dice {
  uint64_t state;
} dice;

static double within(dice *d, double low, double high) { return low + (high - low) * test_random(&d->state); }
static int one_of(dice *d, int count) { return (int)(count * test_random(&d->state)); }
static bool happens(dice *d, double share) { return test_random(&d->state) < share; }
static void some_way(dice *d, double way[3]) {
  for (int k = 0; k < 3; k++) way[k] = within(d, -1, 1);
  if (!(length3(way) > 0.1)) way[0] = 1;
}

/* Tubes over waves over noise, within about 0..1. */
static double mixture(double x, double y, double z, const void *context) {
  const unsigned *seed = context;
  const double wavelength = 8 + *seed % 20, radius = 0.5 + *seed % 3;
  const double wave = 0.6 * test_waves(x, y, z, &wavelength) + 0.1 * test_noise(x, y, z, seed);
  return fmin(fmax(wave, 0.4 + 0.3 * tubes(x, y, z, &radius)), 1);
}

static double regions(double x, double y, double z, const void *context) { return floor(6 * mixture(x, y, z, context)); }

typedef struct subject {
  tc_volume *volume, *labels;
} subject;

static void subject_free(subject *s) {
  tc_volume_unref(s->volume);
  tc_volume_unref(s->labels);
}
G_DEFINE_AUTO_CLEANUP_CLEAR_FUNC(subject, subject_free)

static subject some_subject(dice *d) {
  const unsigned seed = (unsigned)one_of(d, 1 << 20);
  test_grid g = {.type = (tc_voxel_type)one_of(d, TC_VOXEL_TYPE_COUNT), .slope = 1};
  for (int k = 0; k < 3; k++) {
    g.dims[k] = 20 + one_of(d, 24);
    g.spacing[k] = happens(d, 0.5) ? 1 : within(d, 0.5, 2.5);
    g.origin[k] = happens(d, 0.5) ? 0 : within(d, -500, 500);
  }
  if (happens(d, 0.3)) memcpy(g.direction, flat_grid.direction, sizeof g.direction);
  test_grid labels = g;
  labels.type = TC_U8;
  if (g.type != TC_F32) g.slope = 1 / 120.0;
  return (subject){test_volume(&g, mixture, &seed), happens(d, 0.2) ? test_volume(&labels, regions, &seed) : NULL};
}

static void some_knots(dice *d, tc_scene *s) {
  tc_knot knots[6];
  const int n = 2 + one_of(d, 5);
  for (int i = 0; i < n; i++) {
    knots[i] = (tc_knot){i ? knots[i - 1].value + within(d, 0, 0.3) : within(d, 0, 0.3), {0}, happens(d, 0.3) ? 0 : pow(within(d, 0, 1), 3)};
    for (int k = 0; k < 3; k++) knots[i].color[k] = within(d, 0, 1);
  }
  test_scene_knots(s, TC_KNOT_OPACITY, knots, (size_t)n);
}

static void some_clip(dice *d, tc_scene *s) {
  s->clip.n_planes = happens(d, 0.4) ? 1 + one_of(d, 3) : 0;
  for (int i = 0; i < s->clip.n_planes; i++) {
    double *plane = s->clip.planes[i];
    some_way(d, plane);
    normalise3(plane);
    plane[3] = within(d, 0, 8) - dot3(plane, s->camera.target);
  }
  s->clip.has_box = happens(d, 0.15);
  for (int k = 0; k < 3; k++)
    for (int side = 0; side < 2; side++) s->clip.box[side][k] = s->camera.target[k] + (side ? 1 : -1) * within(d, 4, 20);
}

static void some_surfaces(dice *d, const subject *on, tc_scene *s) {
  const int n = 1 + one_of(d, 4);
  tc_mesh_surface *of = g_new0(tc_mesh_surface, n);
  for (int i = 0; i < n; i++) {
    of[i] = (tc_mesh_surface){.source = TC_SURFACE_OF_VALUE, .value = within(d, 0.3, 0.7), .opacity = happens(d, 0.7) ? 1 : within(d, 0.1, 0.9),
                              .visible = !happens(d, 0.1), .two_sided = !happens(d, 0.2), .has_color = !happens(d, 0.2)};
    for (int k = 0; k < 3; k++) of[i].color[k] = within(d, 0, 1);
    if (happens(d, 0.2)) of[i].source = TC_SURFACE_OF_PLANE, of[i].plane = (tc_mpr_orientation)one_of(d, 3), of[i].two_sided = true;
    if (on->labels && happens(d, 0.5)) of[i].source = TC_SURFACE_OF_LABEL, of[i].label = 1 + one_of(d, 4);
    if (happens(d, 0.3)) of[i].own_shading = 1, of[i].model = (tc_shading_model)one_of(d, TC_SHADING_COUNT);
    if (i % 2 && of[i].opacity < 1) of[i].value = of[i - 1].value; /* as deep as the one before */
  }
  tc_scene_set_surfaces(s, of, (size_t)n);
  s->mesh.with_volume = happens(d, 0.5);
  s->mesh.n_lights = one_of(d, 3);
  for (int i = 0; i < s->mesh.n_lights; i++) {
    s->mesh.lights[i] = (tc_mesh_light){.at_camera = happens(d, 0.3), .color = {1, within(d, 0, 1), 0.5}, .intensity = within(d, 0.2, 1)};
    some_way(d, s->mesh.lights[i].direction);
  }
}

static void some_scene(dice *d, const subject *on, tc_scene *s) {
  double side[3];
  test_scene(s, W, H);
  s->mode = (tc_mode)one_of(d, TC_MODE_COUNT);
  if (happens(d, 0.2)) s->mode = TC_MODE_SPLAT;
  some_way(d, side);
  test_scene_frame(s, on->volume, happens(d, 0.5) ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, side);
  const double zoom = happens(d, 0.5) ? 1 : within(d, 0.1, 1);
  s->camera.height_mm *= zoom, s->camera.fov_y_deg *= zoom;
  some_clip(d, s);
  some_knots(d, s);
  s->window.center = within(d, 0.3, 0.7), s->window.width = within(d, 0.1, 1);
  s->classification = (tc_classification)one_of(d, TC_CLASSIFICATION_COUNT);
  s->order = happens(d, 0.2) ? TC_BACK_TO_FRONT : TC_FRONT_TO_BACK;
  s->filter = happens(d, 0.8) ? TC_FILTER_LINEAR : (tc_filter)one_of(d, TC_FILTER_COUNT);
  s->sampling.step = within(d, 0.3, 2.5);
  s->sampling.rays_per_pixel = happens(d, 0.8) ? 1 : 2 + one_of(d, 3);
  s->sampling.jitter = happens(d, 0.1);
  s->sampling.termination = happens(d, 0.5) ? 0 : 0.01;
  s->skipping.mode = happens(d, 0.5) ? TC_SKIPPING_AUTO : TC_SKIPPING_OFF;
  s->shading.model = (tc_shading_model)one_of(d, TC_SHADING_COUNT);
  s->shading.gradient = (tc_gradient)one_of(d, TC_GRADIENT_COUNT);
  s->isosurface.value = within(d, 0.3, 0.7);
  s->splat.threshold[0] = within(d, 0.3, 0.7), s->splat.threshold[1] = 2;
  s->splat.opaque = happens(d, 0.75);
  if (happens(d, 0.3)) s->splat.kernel_radius = within(d, 1, 2.5);
  if (happens(d, 0.3)) strcpy(s->splat.attribute, "value");
  s->mpr.orientation = (tc_mpr_orientation)one_of(d, TC_MPR_ORIENTATION_COUNT);
  some_way(d, s->mpr.normal);
  s->mpr.thickness_mm = happens(d, 0.5) ? 0 : within(d, 0, 15);
  s->mpr.projection = (tc_slab_projection)one_of(d, TC_SLAB_PROJECTION_COUNT);
  s->image.linear_light = happens(d, 0.2);
  s->image.transparent = happens(d, 0.2);
  if (on->labels) strcpy(s->labels.volume, "labels");
  if (happens(d, s->mode == TC_MODE_MESH ? 0.5 : 0.2)) some_surfaces(d, on, s);
}

/* The pixels that differ by more than 1/255; of transparent pictures, whose colours are divided by their opacity, before that. */
static int count_apart(const tc_scene *scene, const tc_frame *cpu, const tc_frame *gl, int *seen) {
  int apart = 0;
  *seen = 0;
  for (int i = 0; i < W * H; i++) {
    int level = 0;
    for (int c = 4 * i; c < 4 * i + 4; c++) level = MAX(level, abs(gl->rgba[c] - cpu->rgba[c]));
    *seen += cpu->linear[4 * i + 3] > 0;
    apart += scene->image.transparent ? test_pixel_off(gl->linear, cpu->linear, (size_t)i) > 1.0 / 255 : level > 1;
  }
  return apart;
}

typedef struct range {
  int from, to;
} range;

static range seeds(void) {
  range r = {0, getenv("TC_LONG") ? 2000 : 120};
  if (getenv("TC_SEEDS")) sscanf(getenv("TC_SEEDS"), "%d-%d", &r.from, &r.to);
  return r;
}

/* False: no scene that is offered. */
static bool begin(int seed, subject *on, tc_scene *scene) {
  dice d = {(uint64_t)seed * 7919 + 1};
  g_autoptr(GError) error = NULL;
  *on = some_subject(&d);
  some_scene(&d, on, scene);
  if (tc_plan_check(on->volume, scene, W, H, NULL, &error)) return true;
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_UNSUPPORTED));
  return false;
}

TEST(random_scenes_are_the_cpus) {
  needs(test_renderers[GL]);
  const range r = seeds();
  int refused = 0, drawn[TC_MODE_COUNT] = {0}, shown = 0;
  tc_gl_mesh_peels_in_software = true;
  for (int seed = r.from; seed < r.to; seed++) {
    g_auto(tc_scene) scene;
    g_auto(subject) on = {0};
    if (!begin(seed, &on, &scene)) {
      refused++;
      continue;
    }
    const tc_render_request request = {.want_linear = true, .labels = on.labels};
    int seen;
    const tc_frame *cpu = test_draw(test_widest(), on.volume, &scene, &request, NULL);
    const tc_frame *gl = test_draw(GL, on.volume, &scene, &request, NULL);
    const int apart = count_apart(&scene, cpu, gl, &seen);
    assert_false(gl->stats.stand_in);
    drawn[scene.mode]++, shown += seen;
    if (apart) printf("  scene %d, %s: %d of %d pixels are off by more than 1/255\n", seed, tc_mode_names[scene.mode], apart, seen);
    assert_true(apart <= 3 + seen / 500);
  }
  tc_gl_mesh_peels_in_software = false;
  for (int m = 0; m < TC_MODE_COUNT && r.to - r.from >= 120; m++) assert_true(drawn[m] >= (r.to - r.from) / 40);
  printf("  %d scenes, %d of them not offered, %d pixels shown\n", r.to - r.from, refused, shown);
  assert_true(shown > (r.to - r.from) * 1000);
}

TEST(what_is_left_out_changes_no_bit) {
  const range r = seeds();
  const int which = test_widest();
  int compared = 0;
  for (int seed = r.from; seed < r.to; seed++) {
    g_auto(tc_scene) scene;
    g_auto(subject) on = {0};
    if (!begin(seed, &on, &scene)) continue;
    const tc_render_request request = {.want_linear = true, .labels = on.labels};
    g_autofree float *with = g_memdup2(test_draw(which, on.volume, &scene, &request, NULL)->linear, 16 * W * H);
    scene.skipping.mode = scene.skipping.mode == TC_SKIPPING_OFF ? TC_SKIPPING_AUTO : TC_SKIPPING_OFF;
    scene.splat.culling = !scene.splat.culling;
    const tc_frame *without = test_draw(which, on.volume, &scene, &request, NULL);
    if (memcmp(without->linear, with, 16 * W * H)) fail_msg("scene %d, %s: other bits", seed, tc_mode_names[scene.mode]);
    compared++;
  }
  printf("  %d scenes compared\n", compared);
  assert_true(compared > (r.to - r.from) / 2);
}

TESTS(test_renderers_open, test_renderers_close)
