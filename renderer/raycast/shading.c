#include "renderer/raycast/shading.h"

#include <math.h>
#include <string.h>

static const double cool[3] = {0, 0, 0.4}, warm[3] = {0.4, 0.4, 0};

static void set_gradient(tc_shade *shade, const tc_volume *volume, const tc_volume *field, tc_mode mode) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *s = tc_volume_statistics(volume);
  double slope = tc_volume_describe(field)->slope; /* may be the volume's slope times a power of two */
  double to_index[9], range = (s->voxel_max - s->voxel_min) * fabs(d->slope / slope);
  double least = fmin(d->spacing[0], fmin(d->spacing[1], d->spacing[2]));
  /* The value range is |slope| times the voxel range, so only the sign of the slope remains. */
  double scale = range > 0 ? copysign(0.5 * least / (range * TC_SHADE_STEEP), slope) : 0;
  if (mode == TC_MODE_ISOSURFACE) scale *= TC_SHADE_FAINT;
  tc_volume_lps_to_index_matrix(volume, to_index);
  for (int r = 0; r < 3; r++)
    for (int k = 0; k < 3; k++) shade->gradient[r][k] = d->dims[k] > 1 ? (float)(scale * to_index[3 * k + r]) : 0;
  double flat = mode == TC_MODE_ISOSURFACE ? 0 : TC_SHADE_FLAT / TC_SHADE_STEEP;
  shade->flat = (float)flat;
  shade->inverse_steep = (float)(1 / (1 - flat));
}

void tc_shade_set_up(tc_shade *shade, const tc_volume *volume, const tc_volume *field, const tc_scene *scene) {
  memset(shade, 0, sizeof *shade);
  set_gradient(shade, volume, field, scene->mode);
  double ambient = scene->shading.ambient, diffuse = scene->shading.diffuse;
  shade->shininess = (float)scene->shading.shininess;
  shade->least_mirror = (float)fmax(1e-30, pow(1e-30, 1 / scene->shading.shininess));
  shade->specular = scene->shading.model == TC_SHADING_LAMBERT ? 0 : (float)scene->shading.specular;
  shade->factor[0] = (float)ambient;
  shade->factor[1] = (float)diffuse;
  if (scene->shading.model == TC_SHADING_GOOCH) {
    shade->least = -1;
    shade->factor[0] = (float)(0.5 * (diffuse + ambient));
    shade->factor[1] = (float)(0.5 * (diffuse - ambient));
    for (int c = 0; c < 3; c++) {
      shade->glow[0][c] = (float)(0.5 * (warm[c] + cool[c]));
      shade->glow[1][c] = (float)(0.5 * (warm[c] - cool[c]));
    }
  }
  shade->head_light = scene->shading.light_at_camera;
  const double *light = scene->shading.light;
  double largest = fmax(fabs(light[0]), fmax(fabs(light[1]), fabs(light[2]))), v[3], length = 0;
  for (int k = 0; k < 3 && !shade->head_light; k++) {
    v[k] = light[k] / largest;
    length += v[k] * v[k];
  }
  for (int k = 0; k < 3 && !shade->head_light; k++) shade->light[k] = (float)(v[k] / sqrt(length));
}
