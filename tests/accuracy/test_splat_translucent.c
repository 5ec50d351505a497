/* Translucent splats against the blurred field they stand for, marched in double precision. */
#include "tests/support/splats.h"

/* What a voxel is made of: two colours, side by side, and two extinctions, one above the other. */
static void material_of(const void *user, const int at[3], float rgbk[4]) {
  const bool left = at[0] < 20, low = at[2] < 18;
  const float material[4] = {left ? 0.9f : 0.2f, 0.5f, left ? 0.1f : 0.8f, *(const float *)user * (low ? 1 : 0.3f)};
  memcpy(rgbk, material, sizeof material);
}

/* What a head light (Lambert) makes of a voxel of the ball, by the radius; inside nothing. */
static double light_of(const object *o, const tc_scene *scene, const int at[3]) {
  static const int beside[6][3] = {{-1}, {1}, {0, -1}, {0, 1}, {0, 0, -1}, {0, 0, 1}};
  double n[3], place[3], to_eye[3], out = 0, length = 0, eye = 0;
  bool inside = true;
  for (int f = 0; f < 6; f++)
    inside &= tc_vmd_voxel(o->model, at[0] + beside[f][0], at[1] + beside[f][1], at[2] + beside[f][2]) != NULL;
  if (scene->shading.model == TC_SHADING_NONE || inside) return 1;
  tc_volume_index_to_lps(o->volume, (double[]){at[0], at[1], at[2]}, place);
  for (int k = 0; k < 3; k++) { /* axes are a voxel of 1 mm: LPS is the index but for the origin */
    n[k] = at[k] - 19.5;
    to_eye[k] =
        scene->camera.position[k] - (scene->camera.projection == TC_PERSPECTIVE ? place[k] : scene->camera.target[k]);
    out += n[k] * to_eye[k], length += n[k] * n[k], eye += to_eye[k] * to_eye[k];
  }
  return scene->shading.ambient + scene->shading.diffuse * fabs(out) / sqrt(length * eye);
}

/* The blurred field at an index position: depth a mm and its colours. */
static void blurred(const object *o, const tc_scene *scene, double deviation, const float *extinction,
                    const double p[3], double sum[4]) {
  const int reach = (int)ceil(3 * deviation);
  for (int k = 0; k < 4; k++) sum[k] = 0;
  for (int z = (int)floor(p[2]) - reach + 1; z <= (int)floor(p[2]) + reach; z++)
    for (int y = (int)floor(p[1]) - reach + 1; y <= (int)floor(p[1]) + reach; y++)
      for (int x = (int)floor(p[0]) - reach + 1; x <= (int)floor(p[0]) + reach; x++) {
        const double r2 = (x - p[0]) * (x - p[0]) + (y - p[1]) * (y - p[1]) + (z - p[2]) * (z - p[2]);
        if (r2 > 9 * deviation * deviation || !tc_vmd_voxel(o->model, x, y, z)) continue;
        float rgbk[4];
        material_of(extinction, (int[]){x, y, z}, rgbk);
        const double k =
            (double)rgbk[3] * exp(-0.5 * r2 / (deviation * deviation)) / pow(2 * M_PI * deviation * deviation, 1.5);
        const double light = light_of(o, scene, (int[]){x, y, z});
        for (int c = 0; c < 3; c++) sum[c] += k * fmin(light * (double)rgbk[c], 1);
        sum[3] += k;
      }
}

/* One pixel of the blurred field, in small steps along its ray. */
static void march(const object *o, const tc_scene *scene, double deviation, const float *extinction, int x, int y,
                  double rgba[4]) {
  tc_rays rays;
  double entry[3], dir[3] = {0}, view[3], length = 0, clear = 1;
  tc_rays_set_up(&rays, o->volume, scene, SIDE, SIDE);
  for (int k = 0; k < 3; k++) {
    entry[k] = rays.anchor0[k] + (x + 0.5) * rays.anchor_du[k] + (y + 0.5) * rays.anchor_dv[k];
    view[k] = rays.view0[k] + (x + 0.5) * rays.view_du[k] + (y + 0.5) * rays.view_dv[k];
    length += view[k] * view[k];
  }
  for (int r = 0; r < 3; r++)
    for (int k = 0; k < 3; k++) dir[r] += rays.to_index[3 * r + k] * view[k] / sqrt(length);
  for (int k = 0; k < 4; k++) rgba[k] = 0;
  const double step = 0.25;
  for (double s = -50; s < 50; s += step) {
    const double p[3] = {entry[0] + s * dir[0], entry[1] + s * dir[1], entry[2] + s * dir[2]};
    double here[4];
    if (p[0] < 0 || p[1] < 0 || p[2] < 0 || p[0] > 40 || p[1] > 40 || p[2] > 40) continue;
    blurred(o, scene, deviation, extinction, p, here);
    if (here[3] <= 0) continue;
    const double alpha = 1 - exp(-here[3] * step);
    for (int c = 0; c < 3; c++) rgba[c] += clear * alpha * here[c] / here[3];
    clear *= 1 - alpha;
  }
  rgba[3] = 1 - clear;
}

TEST(translucent_splats_show_the_blurred_field) {
  object objects[3] = {object_of(&cube, blob, rough), object_of(&flat_grid, blob, ball), object_of(&cube, blob, ball)};
  drawing d = {0};
  for (int i = 0; i < 12; i++) {
    const object *o = &objects[i < 10 ? i / 2 % 2 : 2]; /* the last two lit */
    const float extinction = i % 3 == 2 ? 0.5f : 0.06f;
    g_auto(tc_scene) scene;
    look(&scene, o, i + 4, 1);
    scene.splat.opaque = false;
    scene.splat.kernel_radius = i % 2 ? 1 : 1.5;
    scene.shading.model = i < 10 ? TC_SHADING_NONE : TC_SHADING_LAMBERT;
    draw_now(o, &scene, (wish){.material = {.color = material_of, .user = &extinction}}, &d);
    double sum = 0, worst = 0, truth[4];
    int n = 0;
    for (int p = 17; p < SIDE * SIDE; p += 41) {
      march(o, &scene, 0.6 * scene.splat.kernel_radius, &extinction, p % SIDE, p / SIDE, truth);
      for (int c = 0; c < 4; c++, n++) {
        const double apart = fabs((double)d.frame.linear[4 * p + c] - truth[c]);
        sum += apart * apart, worst = fmax(worst, apart);
      }
    }
    print_message("view %d: rms %.4f, at most %.4f\n", i, sqrt(sum / n), worst);
    /* Sheets overlap in depth by the kernel's width, which counts where most is hidden within it. */
    assert_true(sqrt(sum / n) < 0.01 && worst < (extinction > 0.1f ? 0.15 : 0.04));
  }
  drawing_finish(&d);
  for (int i = 0; i < 3; i++) object_free(&objects[i]);
}

static void constant_material(const void *user, const int at[3], float rgbk[4]) {
  for (int k = 0; k < 4; k++) rgbk[k] = k < 3 ? 0.5f : *(const float *)user;
}

static double everywhere(double x, double y, double z, const void *context) { return 1; }

/* Mm of a pixel's ray within a grid of 40 voxels a side; 0 where it passes within four voxels of an edge. */
static double way_through(const object *o, const tc_scene *scene, int x, int y) {
  tc_rays rays;
  double at[3], dir[3] = {0}, view[3], square = 0, from = -INFINITY, to = INFINITY;
  tc_rays_set_up(&rays, o->volume, scene, SIDE, SIDE);
  for (int k = 0; k < 3; k++) {
    at[k] = rays.anchor0[k] + (x + 0.5) * rays.anchor_du[k] + (y + 0.5) * rays.anchor_dv[k];
    view[k] = rays.view0[k] + (x + 0.5) * rays.view_du[k] + (y + 0.5) * rays.view_dv[k];
    square += view[k] * view[k];
  }
  for (int r = 0; r < 3; r++)
    for (int k = 0; k < 3; k++) dir[r] += rays.to_index[3 * r + k] * view[k] / sqrt(square);
  for (int k = 0; k < 3; k++) {
    if (fabs(dir[k]) < 1e-12) continue;
    const double a = (-0.5 - at[k]) / dir[k], b = (39.5 - at[k]) / dir[k];
    from = fmax(from, fmin(a, b)), to = fmin(to, fmax(a, b));
  }
  for (int end = 0; end < 2; end++) {
    int near = 0;
    for (int k = 0; k < 3; k++) near += fabs(at[k] + (end ? to : from) * dir[k] - 19.5) > 16;
    if (near != 1) return 0;
  }
  return to - from;
}

/* A cloud of one extinction is as opaque as the way through it says, from every side and in voxels of any size. */
TEST(constant_clouds_are_constant) {
  object objects[2] = {object_of(&cube, everywhere, NULL), object_of(&flat_grid, everywhere, NULL)};
  static const double zooms[] = {0.5, 1, 2, 5};
  const float extinction = 0.03f;
  drawing d = {0};
  double worst = 0;
  int seen = 0;
  for (int i = 0; i < 24; i++) {
    const object *o = &objects[i / 2 % 2];
    g_auto(tc_scene) scene;
    look(&scene, o, i, zooms[i % 4]);
    scene.splat.opaque = false;
    scene.splat.kernel_radius = i % 3 ? 1 : 1.5;
    scene.shading.model = TC_SHADING_NONE;
    draw_now(o, &scene, (wish){.material = {.color = constant_material, .user = &extinction}}, &d);
    for (int p = 5; p < SIDE * SIDE; p += 7) {
      const double way = way_through(o, &scene, p % SIDE, p / SIDE);
      if (way <= 0) continue;
      seen++;
      worst = fmax(worst, fabs((double)d.frame.linear[4 * p + 3] - (1 - exp(-(double)extinction * way))));
    }
  }
  print_message("clouds: at most %.4f from constant in %d pixels\n", worst, seen);
  assert_true(worst < 0.01 && seen > 2000);
  drawing_finish(&d);
  for (int i = 0; i < 2; i++) object_free(&objects[i]);
}

TESTS(NULL, NULL)
