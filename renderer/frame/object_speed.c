#include "renderer/frame/object_speed.h"

#include <math.h>
#include <string.h>

enum { SIDE = 96, PIXELS = 384, ROUNDS = 6 };

/* What the rates' own machine takes, over what they expect: so small an object lies in the cache. */
static const double usual[TC_OBJECT_MODES] = {
    [TC_OBJECT_SPLAT] = 0.68, [TC_OBJECT_ISOSURFACE] = 1.07, [TC_OBJECT_MESH] = 0.8};

/* Of a mode's factor beside the modes' mean, the root: in the cache instructions are all that counts, of larger objects
 * memory has its part. (With scalar rays the factor is 5 here and 2 to 3 over scenes of seven volumes.) */
static void temper(double speed[TC_OBJECT_MODES]) {
  double mean = 1;
  for (int m = 0; m < TC_OBJECT_MODES; m++) mean *= pow(speed[m], 1.0 / TC_OBJECT_MODES);
  for (int m = 0; m < TC_OBJECT_MODES; m++) speed[m] = sqrt(speed[m] * mean);
}

/* A ball of 32 voxels' radius, value 100, in a haze that falls off by 3 a voxel. */
static tc_volume *volume_of_a_ball(void) {
  const tc_volume_desc d = {.dims = {SIDE, SIDE, SIDE},
                            .type = TC_U8,
                            .spacing = {1, 1, 1},
                            .slope = 1,
                            .frames = 1,
                            .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
  tc_volume *volume = tc_volume_new(&d, NULL);
  if (!volume) return NULL;
  uint8_t *voxel = tc_volume_voxels(volume);
  const double middle = (SIDE - 1) / 2.0;
  for (int z = 0; z < SIDE; z++)
    for (int y = 0; y < SIDE; y++)
      for (int x = 0; x < SIDE; x++)
        *voxel++ = (uint8_t)fmax(0, 196 - 3 * sqrt(pow(x - middle, 2) + pow(y - middle, 2) + pow(z - middle, 2)));
  tc_volume_seal(volume);
  return volume;
}

static void set_scene(const tc_volume *volume, tc_scene *scene) {
  tc_scene_init(scene);
  tc_scene_fit(scene, volume);
  tc_scene_light(scene, true);
  scene->mode = TC_MODE_SPLAT;
  scene->image.width = scene->image.height = PIXELS;
  scene->isosurface.value = scene->splat.threshold[0] = 100;
  scene->splat.threshold[1] = 255;
}

void tc_object_speed_measure(tc_renderer *renderer, double speed[TC_OBJECT_MODES]) {
  tc_volume *volume = volume_of_a_ball();
  tc_frame frame = {0};
  tc_object_cost cost;
  tc_scene scene;
  bool good = volume != NULL;
  if (volume) set_scene(volume, &scene);
  good = good && tc_object_cost_of(volume, &scene, PIXELS, PIXELS, NULL, &cost);
  for (int m = 0; m < TC_OBJECT_MODES; m++) speed[m] = INFINITY;
  for (int i = 0; i <= ROUNDS && good; i++) /* the first builds */
    for (int m = 0; m < TC_OBJECT_MODES && good; m++) {
      scene.mode = tc_object_mode_of((tc_object_mode)m);
      good = tc_render(renderer, volume, &scene, NULL, &frame, NULL, NULL);
      if (i) speed[m] = fmin(speed[m], frame.stats.render_ms / (cost.ms[m] * usual[m]));
    }
  for (int m = 0; m < TC_OBJECT_MODES; m++)
    if (!good || !(speed[m] > 0)) speed[m] = 1;
  temper(speed);
  tc_frame_finish(&frame);
  if (!volume) return;
  tc_scene_clear(&scene);
  tc_renderer_forget(renderer, volume);
  tc_volume_unref(volume);
}
