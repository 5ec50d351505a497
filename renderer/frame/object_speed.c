#include "renderer/frame/object_speed.h"

#include <math.h>

#include "renderer/base/clock.h"

enum { SIDE = 96, PIXELS = 384, ROUNDS = 6, SLICE_MS = 5 };

struct tc_object_speed {
  tc_volume *volume; /* NULL before and after the measurement */
  tc_scene scene;
  tc_frame frame;
  tc_object_cost cost;
  int drawn; /* pictures */
  bool done;
  double factor[TC_OBJECT_MODES];
};

/* Measured over expected time on the machine where the rates were fitted: below 1, because this small object fits the
 * CPU cache. */
static const double usual[TC_OBJECT_MODES] = {
    [TC_OBJECT_SPLAT] = 0.69, [TC_OBJECT_ISOSURFACE] = 0.76, [TC_OBJECT_MESH] = 0.88};

/* Moves each factor to its geometric mean with the mean of all modes. The small object measures instructions alone;
 * with larger objects memory matters too, which modes share. (With scalar rays the factor is 5 here, and 2 to 3 over
 * scenes of seven volumes.) */
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

tc_object_speed *tc_object_speed_new(void) {
  tc_object_speed *s = g_new0(tc_object_speed, 1);
  for (int m = 0; m < TC_OBJECT_MODES; m++) s->factor[m] = INFINITY;
  return s;
}

static void end(tc_object_speed *s) {
  tc_frame_finish(&s->frame);
  if (!s->volume) return;
  tc_scene_clear(&s->scene);
  g_clear_pointer(&s->volume, tc_volume_unref);
}

void tc_object_speed_free(tc_object_speed *speed) {
  if (!speed) return;
  end(speed);
  g_free(speed);
}

static bool begin(tc_object_speed *s) {
  s->volume = volume_of_a_ball();
  if (!s->volume) return false;
  set_scene(s->volume, &s->scene);
  return tc_object_cost_of(s->volume, &s->scene, PIXELS, PIXELS, NULL, &s->cost);
}

/* Draws the modes in turn; the first round builds resources and is not timed. */
static bool draw_next(tc_object_speed *s, tc_renderer *renderer) {
  const int mode = s->drawn % TC_OBJECT_MODES;
  if (!s->volume && !begin(s)) return false;
  s->scene.mode = tc_object_mode_of((tc_object_mode)mode);
  if (!tc_render(renderer, s->volume, &s->scene, NULL, &s->frame, NULL)) return false;
  if (s->drawn++ >= TC_OBJECT_MODES)
    s->factor[mode] = fmin(s->factor[mode], s->frame.stats.render_ms / (s->cost.ms[mode] * usual[mode]));
  return true;
}

const double *tc_object_speed_go_on(tc_object_speed *s, tc_renderer *renderer) {
  const double until = tc_now_ms() + SLICE_MS;
  while (!s->done) {
    const bool good = draw_next(s, renderer);
    s->done = !good || s->drawn == (ROUNDS + 1) * TC_OBJECT_MODES;
    if (!s->done && tc_now_ms() < until) continue;
    if (!s->done) return NULL;
    for (int m = 0; m < TC_OBJECT_MODES; m++)
      if (!good || !(s->factor[m] > 0)) s->factor[m] = 1;
    temper(s->factor);
    if (s->volume) tc_renderer_forget(renderer, s->volume);
    end(s);
  }
  return s->factor;
}
