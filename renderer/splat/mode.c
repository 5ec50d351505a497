#include "renderer/splat/mode.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/splat/splatter.h"
#include "renderer/classify/transfer.h"
#include "renderer/splat/normal.h"
#include "renderer/splat/vmd.h"

#define NODES 4096
#define NORMAL_HALF 31 /* of the octahedral map of normals' colours */
#define NORMAL_SIDE (2 * NORMAL_HALF + 1)

/* Entries that an attribute adds to the table behind the nodes. */
typedef enum added { ADDS_NONE, ADDS_PALETTE, ADDS_NORMALS } added;

/* Labels, and a model's attribute "label", have their palette's colours; a normal's components (LPS, -1 to 1) become red, green and
 * blue. All other attributes are coloured by the transfer function, at nodes over the volume's range (one for each value of 8
 * bits), to which an attribute's range is scaled. Extinction is that of the transfer function at the voxel's value. */
struct tc_splat_appearance {
  const tc_volume *volume;
  const tc_labels *labels;           /* NULL: the volume is not drawn as labels */
  const tc_vmd *model;               /* of a volume without a grid */
  const tc_vmd_attribute *attribute; /* attribute that is coloured; NULL: the value */
  added added;
  float lo, scale, last;  /* node of a stored voxel: (voxel - lo) * scale, at most last */
  float own_lo, own_scale; /* the same for an attribute's number */
  int n;
  float (*table)[4]; /* [n]: colour, compositing space; extinction, 1/mm */
};

static uint16_t node_at(const tc_splat_appearance *m, double number, float lo, float scale) {
  const float at = ((float)number - lo) * scale + 0.5f;
  return at > 0 ? (uint16_t)fminf(at, m->last) : 0;
}

static uint16_t color_of(const tc_splat_appearance *m, const uint8_t *record) {
  const tc_vmd_attribute *a = m->attribute;
  const uint8_t *two = record + a->at;
  if (m->added == ADDS_NORMALS)
    return (uint16_t)(NODES + (two[0] * NORMAL_HALF + 63) / 127 + NORMAL_SIDE * ((two[1] * NORMAL_HALF + 63) / 127));
  const double number = tc_vmd_number(a, record);
  if (m->added == ADDS_PALETTE) return (uint16_t)(NODES + (unsigned)fmin(fmax(number, 0), 65535) % TC_VMD_PALETTE);
  return node_at(m, number, m->own_lo, m->own_scale);
}

void tc_splat_appearance_at(const tc_splat_appearance *m, const int at[3], uint16_t of[2]) {
  double voxel = 0;
  tc_volume_voxel(m->volume, at, &voxel);
  if (m->labels) {
    const int i = (int)voxel - m->labels->base;
    of[0] = of[1] = (uint16_t)(i < 0 || i >= m->n ? m->n - 1 : i);
    return;
  }
  of[0] = of[1] = node_at(m, voxel, m->lo, m->scale);
  if (m->attribute) of[0] = color_of(m, tc_vmd_voxel(m->model, at[0], at[1], at[2]));
}

static void color_and_extinction(const void *user, const int at[3], float rgbk[4]) {
  const tc_splat_appearance *m = user;
  uint16_t of[2];
  tc_splat_appearance_at(m, at, of);
  memcpy(rgbk, m->table[of[0]], 3 * sizeof *rgbk);
  rgbk[3] = m->table[of[1]][3];
}

static void prefetch_voxel(const void *user, const int at[3]) { tc_volume_fetch(((const tc_splat_appearance *)user)->volume, at); }

/* A label's opacity is that of a millimetre. The last entry is for voxels without a label. */
static void set_labels(tc_splat_appearance *m) {
  for (int i = 0; i < m->n; i++) {
    const float *entry = m->labels->entries[i < m->n - 1 ? i : m->labels->n];
    memcpy(m->table[i], entry + 5, 3 * sizeof **m->table);
    m->table[i][3] = -logf(1 - fminf(entry[3], 0.999f));
  }
}

/* solid: the isosurface's colour for all values. */
static void set_nodes(tc_splat_appearance *m, const tc_scene *scene, bool solid) {
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

static void set_added(tc_splat_appearance *m, const tc_scene *scene, int i, int channel, double color) {
  m->table[NODES + i][channel] = (float)(scene->image.linear_light ? tc_srgb_to_linear(color) : color);
}

/* The model's palette, and default label colours for the rest. */
static void set_palette(tc_splat_appearance *m, const tc_scene *scene) {
  size_t count;
  const double(*usual)[3] = tc_label_palette(&count);
  for (int i = 0; i < TC_VMD_PALETTE; i++)
    for (int c = 0; c < 3; c++)
      set_added(m, scene, i, c,
                i < m->model->head.n_palette ? m->model->head.palette[i][c] / 255.0
                                             : usual[(size_t)(i + (int)count - 1) % count][c]);
}

static void set_normals(tc_splat_appearance *m, const tc_scene *scene) {
  for (int i = 0; i < NORMAL_SIDE * NORMAL_SIDE; i++) {
    float n[3];
    tc_octahedron_unfold(i % NORMAL_SIDE, i / NORMAL_SIDE, NORMAL_HALF, n);
    for (int c = 0; c < 3; c++) set_added(m, scene, i, c, 0.5 + 0.5 * (double)n[c]);
  }
}

static void set_attribute(tc_splat_appearance *m, const tc_scene *scene) {
  const char *name = scene->splat.attribute;
  if (!m->model || strcmp(name, "value") == 0) return;
  m->attribute = tc_vmd_attribute_named(&m->model->head, name);
  if (!m->attribute) return;
  m->added = m->attribute->type == TC_VMD_NORMAL ? ADDS_NORMALS : strcmp(name, "label") == 0 ? ADDS_PALETTE : ADDS_NONE;
}

static void set_table(tc_splat_appearance *m, const tc_scene *scene, bool solid) {
  set_nodes(m, scene, solid);
  if (m->added == ADDS_PALETTE) set_palette(m, scene);
  if (m->added == ADDS_NORMALS) set_normals(m, scene);
  if (!m->attribute) return;
  const double *range = m->model->range[m->attribute - m->model->head.attributes];
  m->own_lo = (float)range[0];
  m->own_scale = range[1] > range[0] ? (float)((double)m->last / (range[1] - range[0])) : 0;
}

static bool has_one_color(const tc_frame_job *job) {
  const char *name = job->scene->splat.attribute;
  return (!name[0] || strcmp(name, "color") == 0) && !job->have.labels;
}

bool tc_splat_appearance_make(const tc_frame_job *job, tc_splat_appearance **made, GError **error) {
  static const int more[] = {[ADDS_PALETTE] = TC_VMD_PALETTE, [ADDS_NORMALS] = NORMAL_SIDE * NORMAL_SIDE};
  *made = NULL;
  if (has_one_color(job) && job->scene->splat.opaque) return true;
  tc_splat_appearance *m = calloc(1, sizeof *m);
  if (m) {
    *m = (tc_splat_appearance){.volume = job->have.labels ? job->label_volume : job->source,
                               .labels = job->have.labels,
                               .model = tc_volume_model(job->source)};
    set_attribute(m, job->scene);
    m->n = m->labels ? MIN(m->labels->n + 1, UINT16_MAX + 1) : NODES + more[m->added];
    m->table = calloc((size_t)m->n, sizeof *m->table);
  }
  if (!m || !m->table) {
    tc_splat_appearance_free(m);
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
    return false;
  }
  if (m->labels)
    set_labels(m);
  else
    set_table(m, job->scene, has_one_color(job));
  *made = m;
  return true;
}

void tc_splat_appearance_free(tc_splat_appearance *m) {
  if (m) free(m->table);
  free(m);
}

const float (*tc_splat_appearance_table(const tc_splat_appearance *m, int *n))[4] {
  *n = m->n;
  return (const float(*)[4])m->table;
}

uint64_t tc_splat_appearance_key(const tc_splat_appearance *m) {
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
  tc_splat_appearance *appearance;
  if (!tc_splat_appearance_make(job, &appearance, error)) return false;
  if (appearance) splats.material = (tc_splat_material){color_and_extinction, prefetch_voxel, appearance};
  const bool drawn = tc_splat_draw(&splats, error);
  job->frame->stats.samples += counts.depths + counts.drawn;
  tc_splat_appearance_free(appearance);
  return drawn;
}
