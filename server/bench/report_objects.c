/* Objects above a threshold: the share of the grid that an object fills decides whether splats, rays or triangles are
 * fastest. */
#include <math.h>
#include <string.h>

#include "server/bench/objects.h"
#include "server/bench/report.h"
#include "server/bench/surfaces.h"

/* Balls of one size at random places, from a few to so many that they form a sponge. */
enum { SIDE = 128, REACH = 5 };
static const int balls[] = {4, 32, 128, 512, 1500, 4000, 12000};
static const int grids[] = {64, 128, 256};           /* around the balls of a grid of 64 */
static const int sides[] = {64, 128, 320};           /* of the smaller pictures */
static const double shares[] = {0, 0.15, 0.3, 0.45}; /* thresholds for a user's volume */

int tcs_report_object_count(bool own) { return own ? G_N_ELEMENTS(shares) : G_N_ELEMENTS(balls); }

/* Values fall linearly with the distance, by 100 per voxel, to 0 at REACH. */
static void add_ball(int16_t *voxels, int side, const double at[3]) {
  for (int z = (int)fmax(at[2] - REACH, 0); z <= fmin(at[2] + REACH, side - 1); z++)
    for (int y = (int)fmax(at[1] - REACH, 0); y <= fmin(at[1] + REACH, side - 1); y++)
      for (int x = (int)fmax(at[0] - REACH, 0); x <= fmin(at[0] + REACH, side - 1); x++) {
        const double distance = sqrt((x - at[0]) * (x - at[0]) + (y - at[1]) * (y - at[1]) + (z - at[2]) * (z - at[2]));
        int16_t *voxel = voxels + ((size_t)z * (size_t)side + (size_t)y) * (size_t)side + (size_t)x;
        const int16_t value = (int16_t)lrint(fmax(0, 100 * (REACH - distance)));
        if (value > *voxel) *voxel = value;
      }
}

/* Their centres lie in the middle `within` voxels of each axis, whose middle is where it is in any grid. */
static tc_volume *volume_of_balls(int n, int side, int within, GError **error) {
  const double first = (side - within) / 2.0;
  tc_volume_desc d = {.dims = {side, side, side},
                      .type = TC_I16,
                      .origin = {-first, -first, -first},
                      .spacing = {1, 1, 1},
                      .slope = 1,
                      .frames = 1,
                      .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                      .format = "demo"};
  tc_volume *volume = tc_volume_new(&d, error);
  if (!volume) return NULL;
  GRand *random = g_rand_new_with_seed(15);
  memset(tc_volume_voxels(volume), 0, tc_volume_bytes(volume));
  for (int i = 0; i < n; i++) {
    double at[3];
    for (int k = 0; k < 3; k++) at[k] = first + g_rand_double_range(random, 0, within - 1);
    add_ball(tc_volume_voxels(volume), side, at);
  }
  g_rand_free(random);
  tc_volume_seal(volume);
  return volume;
}

bool tcs_report_object_make(int index, tc_volume *own, int size, tcs_report_scene *made, GError **error) {
  *made = (tcs_report_scene){.volume = own ? tc_volume_ref(own) : volume_of_balls(balls[index], SIDE, SIDE, error)};
  if (!made->volume) return false;
  made->grids = index == 0;
  tcs_object_scene(made->volume, own ? shares[index] : 0, size, &made->scene);
  tc_scene *s = &made->scene;
  tcs_cli_place_camera(made->volume, 30, 20, 1.3, &s->camera);
  if (!own) s->isosurface.value = s->splat.threshold[0] = 100 * (REACH - 4);
  if (own)
    g_snprintf(made->title, sizeof made->title, "from %.4g on", s->isosurface.value);
  else
    g_snprintf(made->title, sizeof made->title, "%d balls", balls[index]);
  return true;
}

/* Share of the grid's voxels that the object fills. */
static double filled(const tc_volume *volume, double from) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const double least = (from - d->intercept) / d->slope;
  double inside = 0, voxel;
  for (int z = 0; z < d->dims[2]; z++)
    for (int y = 0; y < d->dims[1]; y++)
      for (int x = 0; x < d->dims[0]; x++)
        if (tc_volume_voxel(volume, (int[]){x, y, z}, &voxel)) inside += d->slope < 0 ? voxel <= least : voxel >= least;
  return inside / ((double)d->dims[0] * d->dims[1] * d->dims[2]);
}

/* The same in smaller pictures, which have fewer rays but as many splats. */
static bool measure_sizes(tc_renderer *renderer, const tcs_report_scene *scene, int runs, cJSON *json, GError **error) {
  cJSON *sizes = cJSON_AddArrayToObject(json, "sizes");
  bool good = true;
  for (size_t i = 0; i < G_N_ELEMENTS(sides) && good; i++) {
    tc_scene smaller;
    tcs_object o;
    tc_scene_copy(&smaller, &scene->scene);
    smaller.image.width = smaller.image.height = sides[i];
    good = tcs_object_measure(renderer, scene->volume, &smaller, runs, &o, error);
    if (good) cJSON_AddItemToArray(sizes, tcs_object_json(&o, &smaller));
    tc_scene_clear(&smaller);
  }
  return good;
}

/* Balls in ever larger grids, in the same view. */
static bool measure_grids(tc_renderer *renderer, int size, int runs, cJSON *json, GError **error) {
  enum { WITHIN = 48, N = 40 };
  cJSON *list = cJSON_AddArrayToObject(json, "grids");
  bool good = true;
  tc_camera camera;
  for (size_t i = 0; i < G_N_ELEMENTS(grids) && good; i++) {
    tc_scene scene;
    tcs_object o;
    tc_volume *volume = volume_of_balls(N, grids[i], WITHIN, error);
    if (!volume) return false;
    tcs_object_scene(volume, 0, size, &scene);
    if (!i) tcs_cli_place_camera(volume, 30, 20, 1.3, &scene.camera);
    scene.camera = camera = i ? camera : scene.camera;
    scene.isosurface.value = scene.splat.threshold[0] = 100 * (REACH - 4);
    good = tcs_object_measure(renderer, volume, &scene, runs, &o, error);
    if (good) {
      cJSON *one = tcs_object_json(&o, &scene);
      cJSON_AddNumberToObject(one, "grid", grids[i]);
      cJSON_AddItemToArray(list, one);
    }
    tc_renderer_forget(renderer, volume);
    tc_scene_clear(&scene);
    tc_volume_unref(volume);
  }
  return good;
}

cJSON *tcs_report_object_measure(tc_renderer *renderer, const tcs_report_scene *scene, int runs, int side,
                                 GError **error) {
  tcs_object o;
  if (!tcs_object_measure(renderer, scene->volume, &scene->scene, runs, &o, error) ||
      !tcs_object_judge(renderer, scene->volume, &scene->scene, side, &o, error))
    return NULL;
  cJSON *surface = tcs_surface_levels(renderer, scene->volume, &scene->scene, runs, side, error);
  if (!surface) return NULL;
  cJSON *json = tcs_object_json(&o, &scene->scene);
  cJSON_AddStringToObject(json, "title", scene->title);
  cJSON_AddNumberToObject(json, "side", side);
  cJSON_AddItemToObject(json, "surface", surface);
  cJSON_AddNumberToObject(json, "filled", filled(scene->volume, scene->scene.isosurface.value));
  if (!measure_sizes(renderer, scene, runs, json, error) ||
      (scene->grids && !measure_grids(renderer, scene->scene.image.width, runs, json, error)))
    g_clear_pointer(&json, cJSON_Delete);
  tc_renderer_forget(renderer, scene->volume);
  return json;
}
