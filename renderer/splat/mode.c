#include "renderer/splat/mode.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/splat/splatter.h"

#define NODES 4096

/* What the transfer function makes of a volume's voxels: nodes over its range, each value of 8 bits its own. */
typedef struct matter {
  const void *voxels;
  tc_voxel_type type;
  size_t row, slice;
  float lo, scale, nodes[NODES][4];
} matter;

static float voxel_at(const matter *m, size_t i) {
  switch (m->type) {
  case TC_U8:
    return ((const uint8_t *)m->voxels)[i];
  case TC_I8:
    return ((const int8_t *)m->voxels)[i];
  case TC_U16:
    return ((const uint16_t *)m->voxels)[i];
  case TC_I16:
    return ((const int16_t *)m->voxels)[i];
  case TC_F32:
    return ((const float *)m->voxels)[i];
  case TC_VOXEL_TYPE_COUNT:
    break;
  }
  return 0;
}

static void matter_of(const void *user, const int at[3], float rgbk[4]) {
  const matter *m = user;
  const float voxel = voxel_at(m, (size_t)at[2] * m->slice + (size_t)at[1] * m->row + (size_t)at[0]);
  memcpy(rgbk, m->nodes[(int)((voxel - m->lo) * m->scale + 0.5f)], 4 * sizeof *rgbk);
}

/* solid: of the isosurface's colour, whatever the values; extinction is the transfer function's. */
static void set_matter(matter *m, const tc_volume *volume, const tc_scene *scene, bool solid) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *range = tc_volume_statistics(volume);
  const double span = range->voxel_max - range->voxel_min;
  *m = (matter){.voxels = tc_volume_data(volume),
                .type = d->type,
                .row = (size_t)d->dims[0],
                .slice = (size_t)d->dims[0] * (size_t)d->dims[1],
                .lo = (float)range->voxel_min};
  const int last = tc_voxel_size(d->type) == 1 ? (int)span : NODES - 1;
  m->scale = span > 0 ? (float)(last / span) : 0;
  for (int i = 0; i <= last; i++) {
    const double value = d->slope * (range->voxel_min + (last ? span * i / last : 0)) + d->intercept;
    double rgb[3];
    tc_color(&scene->transfer_function, value, rgb);
    for (int c = 0; c < 3; c++) {
      const double color = solid ? scene->isosurface.color[c] : rgb[c];
      m->nodes[i][c] = (float)(scene->image.linear_light ? tc_srgb_to_linear(color) : color);
    }
    m->nodes[i][3] = (float)tc_extinction(&scene->transfer_function, value);
  }
}

bool tc_splat_mode_draw(tc_pool *pool, const tc_job *job, GError **error) {
  const tc_scene *scene = job->scene;
  const bool solid = strcmp(scene->splat.attribute, "value") != 0;
  tc_splat_counts counts = {0};
  tc_splat_job splats = {.volume = job->source,
                         .splats = job->have.splats,
                         .cut = job->have.cut,
                         .scene = scene,
                         .pool = pool,
                         .halt = job->halt,
                         .frame = job->frame,
                         .want_linear = job->want_linear,
                         .want_depth = job->plan->depth,
                         .counts = &counts};
  matter *m = NULL;
  if (!solid || !scene->splat.opaque) {
    m = malloc(sizeof *m);
    if (!m) {
      tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
      return false;
    }
    set_matter(m, job->source, scene, solid);
    splats.matter = (tc_splat_matter){matter_of, m};
  }
  const bool drawn = tc_splat_draw(&splats, error);
  job->frame->stats.samples += counts.depths + counts.drawn;
  free(m);
  return drawn;
}
