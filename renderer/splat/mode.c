#include "renderer/splat/mode.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/splat/splatter.h"
#include "renderer/classify/transfer.h"
#include "renderer/splat/vmd.h"

#define NODES 4096

/* What voxels look like: labels have their own colours, as has a model's attribute "label"; of other attributes the
 * transfer function gives the colour, by nodes over the volume's range, each value of 8 bits its own. Extinction is the
 * transfer function's at the value. */
typedef struct matter {
  const tc_volume *volume;
  const tc_labels *labels;           /* of the volume; NULL: it is not drawn as labels */
  const tc_vmd *model;               /* of a volume without a grid */
  const tc_vmd_attribute *attribute; /* of the model, in the value's place; NULL: the value */
  bool palette;                      /* its numbers are the palette's */
  float lo, scale, last, nodes[NODES][4], colors[TC_VMD_PALETTE][3];
} matter;

/* A label's opacity is that of a millimetre. */
static void look_of_label(const matter *m, double voxel, float rgbk[4]) {
  const int i = (int)voxel - m->labels->base;
  const float *entry = m->labels->entries[i < 0 || i > m->labels->n ? m->labels->n : i];
  for (int c = 0; c < 3; c++)
    rgbk[c] = entry[3] > 0 ? entry[c] / entry[3] : 0;
  rgbk[3] = -logf(1 - fminf(entry[3], 0.999f));
}

static const float *node_at(const matter *m, double number) {
  const float at = ((float)number - m->lo) * m->scale + 0.5f;
  return m->nodes[at > 0 ? (int)fminf(at, m->last) : 0];
}

static void matter_of(const void *user, const int at[3], float rgbk[4]) {
  const matter *m = user;
  double voxel = 0;
  tc_volume_voxel(m->volume, at, &voxel);
  if (m->labels) {
    look_of_label(m, voxel, rgbk);
    return;
  }
  memcpy(rgbk, node_at(m, voxel), 4 * sizeof *rgbk);
  if (!m->attribute) return;
  const double number = tc_vmd_number(m->attribute, tc_vmd_voxel(m->model, at[0], at[1], at[2]));
  memcpy(rgbk, m->palette ? m->colors[(unsigned)fmax(number, 0) % TC_VMD_PALETTE] : node_at(m, number),
         3 * sizeof *rgbk);
}

/* solid: of the isosurface's colour, whatever the values. */
static void set_nodes(matter *m, const tc_scene *scene, bool solid) {
  const tc_volume_desc *d = tc_volume_describe(m->volume);
  const tc_volume_stats *range = tc_volume_statistics(m->volume);
  const double span = range->voxel_max - range->voxel_min;
  const int last = tc_voxel_size(d->type) == 1 ? (int)span : NODES - 1;
  m->lo = (float)range->voxel_min, m->last = (float)last;
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

/* Colours that a model names; else labels' usual ones. */
static void set_palette(matter *m, const tc_scene *scene) {
  size_t count;
  const double(*usual)[3] = tc_label_palette(&count);
  for (int i = 0; i < TC_VMD_PALETTE; i++)
    for (int c = 0; c < 3; c++) {
      const double color = i < m->model->head.n_palette ? m->model->head.palette[i][c] / 255.0
                                                        : usual[(size_t)(i + (int)count - 1) % count][c];
      m->colors[i][c] = (float)(scene->image.linear_light ? tc_srgb_to_linear(color) : color);
    }
}

static void set_matter(matter *m, const tc_frame_job *job, bool solid) {
  const char *name = job->scene->splat.attribute;
  *m = (matter){.volume = job->have.labels ? job->label_volume : job->source,
                .labels = job->have.labels,
                .model = tc_volume_model(job->source)};
  if (m->model && strcmp(name, "value") != 0) m->attribute = tc_vmd_attribute_named(&m->model->head, name);
  m->palette = m->attribute && strcmp(name, "label") == 0;
  set_nodes(m, job->scene, solid);
  if (m->palette) set_palette(m, job->scene);
}

bool tc_splat_mode_draw(tc_pool *pool, const tc_frame_job *job, GError **error) {
  const tc_scene *scene = job->scene;
  const bool one_color = !scene->splat.attribute[0] || strcmp(scene->splat.attribute, "color") == 0;
  const bool solid = one_color && !job->have.labels;
  tc_splat_counts counts = {0};
  tc_splat_job splats = {.volume = job->have.labels ? job->label_volume : job->source,
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
    set_matter(m, job, solid);
    splats.matter = (tc_splat_matter){matter_of, m};
  }
  const bool drawn = tc_splat_draw(&splats, error);
  job->frame->stats.samples += counts.depths + counts.drawn;
  free(m);
  return drawn;
}
