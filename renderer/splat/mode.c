#include "renderer/splat/mode.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/splat/splatter.h"
#include "renderer/classify/transfer.h"
#include "renderer/splat/vmd.h"

#define NODES 4096

/* Labels have their own colours, as has a model's attribute "label"; of other attributes the transfer function gives the
 * colour, by nodes over the volume's range, each value of 8 bits its own. Extinction is the transfer function's at the
 * value. */
struct tc_splat_look {
  const tc_volume *volume;
  const tc_labels *labels;           /* of the volume; NULL: it is not drawn as labels */
  const tc_vmd *model;               /* of a volume without a grid */
  const tc_vmd_attribute *attribute; /* of the model, in the value's place; NULL: the value */
  bool palette;                      /* its numbers are the palette's, which follows the nodes in the table */
  float lo, scale, last;
  int n;
  float (*table)[4]; /* [n]: colour, compositing space; extinction, 1/mm */
};

static uint16_t node_at(const tc_splat_look *m, double number) {
  const float at = ((float)number - m->lo) * m->scale + 0.5f;
  return at > 0 ? (uint16_t)fminf(at, m->last) : 0;
}

void tc_splat_look_at(const tc_splat_look *m, const int at[3], uint16_t of[2]) {
  double voxel = 0;
  tc_volume_voxel(m->volume, at, &voxel);
  if (m->labels) {
    const int i = (int)voxel - m->labels->base;
    of[0] = of[1] = (uint16_t)(i < 0 || i >= m->n ? m->n - 1 : i);
    return;
  }
  of[0] = of[1] = node_at(m, voxel);
  if (!m->attribute) return;
  const double number = tc_vmd_number(m->attribute, tc_vmd_voxel(m->model, at[0], at[1], at[2]));
  of[0] = m->palette ? (uint16_t)(NODES + (unsigned)fmax(number, 0) % TC_VMD_PALETTE) : node_at(m, number);
}

static void matter_of(const void *user, const int at[3], float rgbk[4]) {
  const tc_splat_look *m = user;
  uint16_t of[2];
  tc_splat_look_at(m, at, of);
  memcpy(rgbk, m->table[of[0]], 3 * sizeof *rgbk);
  rgbk[3] = m->table[of[1]][3];
}

static void fetch_ahead(const void *user, const int at[3]) { tc_volume_fetch(((const tc_splat_look *)user)->volume, at); }

/* A label's opacity is that of a millimetre. The last entry is of what has none. */
static void set_labels(tc_splat_look *m) {
  for (int i = 0; i < m->n; i++) {
    const float *entry = m->labels->entries[i < m->n - 1 ? i : m->labels->n];
    for (int c = 0; c < 3; c++)
      m->table[i][c] = entry[3] > 0 ? entry[c] / entry[3] : 0;
    m->table[i][3] = -logf(1 - fminf(entry[3], 0.999f));
  }
}

/* solid: of the isosurface's colour, whatever the values. */
static void set_nodes(tc_splat_look *m, const tc_scene *scene, bool solid) {
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
      m->table[i][c] = (float)(scene->image.linear_light ? tc_srgb_to_linear(color) : color);
    }
    m->table[i][3] = (float)tc_extinction(&scene->transfer_function, value);
  }
}

/* Colours that a model names; else labels' usual ones. */
static void set_palette(tc_splat_look *m, const tc_scene *scene) {
  size_t count;
  const double(*usual)[3] = tc_label_palette(&count);
  for (int i = 0; i < TC_VMD_PALETTE; i++)
    for (int c = 0; c < 3; c++) {
      const double color = i < m->model->head.n_palette ? m->model->head.palette[i][c] / 255.0
                                                        : usual[(size_t)(i + (int)count - 1) % count][c];
      m->table[NODES + i][c] = (float)(scene->image.linear_light ? tc_srgb_to_linear(color) : color);
    }
}

static bool has_one_color(const tc_frame_job *job) {
  const char *name = job->scene->splat.attribute;
  return (!name[0] || strcmp(name, "color") == 0) && !job->have.labels;
}

bool tc_splat_look_make(const tc_frame_job *job, tc_splat_look **made, GError **error) {
  const char *name = job->scene->splat.attribute;
  *made = NULL;
  if (has_one_color(job) && job->scene->splat.opaque) return true;
  tc_splat_look *m = calloc(1, sizeof *m);
  if (m) {
    *m = (tc_splat_look){.volume = job->have.labels ? job->label_volume : job->source,
                         .labels = job->have.labels,
                         .model = tc_volume_model(job->source)};
    if (m->model && strcmp(name, "value") != 0) m->attribute = tc_vmd_attribute_named(&m->model->head, name);
    m->palette = m->attribute && strcmp(name, "label") == 0;
    m->n = m->labels ? MIN(m->labels->n + 1, UINT16_MAX + 1) : NODES + (m->palette ? TC_VMD_PALETTE : 0);
    m->table = calloc((size_t)m->n, sizeof *m->table);
  }
  if (!m || !m->table) {
    tc_splat_look_free(m);
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
    return false;
  }
  if (m->labels)
    set_labels(m);
  else
    set_nodes(m, job->scene, has_one_color(job));
  if (m->palette) set_palette(m, job->scene);
  *made = m;
  return true;
}

void tc_splat_look_free(tc_splat_look *m) {
  if (m) free(m->table);
  free(m);
}

const float (*tc_splat_look_table(const tc_splat_look *m, int *n))[4] {
  *n = m->n;
  return (const float(*)[4])m->table;
}

uint64_t tc_splat_look_of(const tc_splat_look *m) {
  return m->attribute ? 1 + (uint64_t)(m->attribute - m->model->head.attributes) : 0;
}

bool tc_splat_mode_draw(tc_pool *pool, const tc_frame_job *job, GError **error) {
  tc_splat_counts counts = {0};
  tc_splat_job splats = {.volume = job->have.labels ? job->label_volume : job->source,
                         .splats = job->have.splats,
                         .cut = job->have.cut,
                         .scene = job->scene,
                         .pool = pool,
                         .halt = job->halt,
                         .frame = job->frame,
                         .want_linear = job->want_linear,
                         .want_depth = job->plan->depth,
                         .counts = &counts};
  tc_splat_look *look;
  if (!tc_splat_look_make(job, &look, error)) return false;
  if (look) splats.matter = (tc_splat_matter){matter_of, fetch_ahead, look};
  const bool drawn = tc_splat_draw(&splats, error);
  job->frame->stats.samples += counts.depths + counts.drawn;
  tc_splat_look_free(look);
  return drawn;
}
