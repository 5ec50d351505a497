#include "renderer/mesh/surfaces.h"

#include <stdlib.h>
#include <string.h>

#define VALUES 65536 /* of a voxel of whole numbers */

struct tc_surfaces {
  tc_mesh *mesh; /* whose clusters are next */
  tc_clusters *clusters;
  uint32_t *labels; /* NULL: not looked for yet */
  int n_labels, next;
  int64_t steps;
};

tc_surfaces *tc_surfaces_begin(void) { return g_new0(tc_surfaces, 1); }
int64_t tc_surfaces_steps(const tc_surfaces *s) { return s->steps; }

void tc_surfaces_free(tc_surfaces *s) {
  if (!s) return;
  tc_mesh_free(s->mesh);
  tc_clusters_free(s->clusters);
  g_free(s->labels);
  g_free(s);
}

tc_clusters *tc_surfaces_take(tc_surfaces *s) {
  tc_clusters *clusters = s->clusters;
  s->clusters = NULL;
  tc_surfaces_free(s);
  return clusters;
}

/* ---- which labels there are ---- */

typedef struct search {
  const tc_volume *labels;
  uint8_t (*seen)[VALUES]; /* [workers], by the voxel's bits */
} search;

static void look_at_plane(void *context, int z, int worker) {
  const search *s = context;
  const tc_volume_desc *d = tc_volume_describe(s->labels);
  const size_t plane = (size_t)d->dims[0] * (size_t)d->dims[1];
  const void *data = tc_volume_data(s->labels);
  uint8_t *seen = s->seen[worker];
  const bool bytes = d->type == TC_U8 || d->type == TC_I8;
  for (size_t i = (size_t)z * plane, end = i + plane; i < end; i++)
    seen[bytes ? ((const uint8_t *)data)[i] : ((const uint16_t *)data)[i]] = 1;
}

/* A label from a voxel's bits; 0: none. */
static uint32_t label_of(const tc_volume_desc *d, int bits) {
  const double voxel = d->type == TC_I8 ? (int8_t)bits : d->type == TC_I16 ? (int16_t)bits : bits;
  const double label = d->slope * voxel + d->intercept;
  return label >= 1 && label <= UINT32_MAX ? (uint32_t)label : 0;
}

static bool find_labels(tc_surfaces *s, const tc_surfaces_wish *wish, GError **error) {
  const tc_volume_desc *d = tc_volume_describe(wish->labels);
  const int workers = tc_pool_threads(wish->pool);
  search find = {.labels = wish->labels, .seen = g_malloc0((size_t)workers * VALUES)};
  if (!tc_pool_run(wish->pool, d->dims[2], look_at_plane, &find)) {
    g_free(find.seen);
    return tc_halt_say(tc_pool_halt(wish->pool), error);
  }
  s->labels = g_new(uint32_t, VALUES);
  for (int bits = 0; bits < VALUES; bits++) {
    uint32_t label = label_of(d, bits);
    bool there = false;
    for (int w = 0; w < workers; w++) there |= find.seen[w][bits];
    if (there && label && wish->shows(wish->user, label)) s->labels[s->n_labels++] = label;
  }
  g_free(find.seen);
  s->steps++;
  return true;
}

/* ---- surfaces ---- */

/* Meshes have origins of their own: theirs becomes the first one's. */
static void move_origin(tc_mesh *mesh, const double origin[3]) {
  for (size_t v = 0; v < mesh->n_vertices; v++)
    for (int k = 0; k < 3; k++) mesh->positions[v][k] += (float)(mesh->origin[k] - origin[k]);
  memcpy(mesh->origin, origin, sizeof mesh->origin);
}

/* The next surface, in two steps. */
static bool make_one(tc_surfaces *s, const tc_surfaces_wish *wish, GError **error) {
  const uint64_t held = s->clusters ? s->clusters->bytes : 0;
  const tc_mesh_options options = {.normals = true, .pool = wish->pool,
                                   .max_bytes = wish->max_bytes > held ? wish->max_bytes - held : 1};
  if (!s->mesh) {
    s->mesh = wish->labels ? tc_mesh_extract_label(wish->labels, s->labels[s->next], &options, error)
                           : tc_mesh_extract(wish->volume, wish->iso, &options, error);
    if (s->mesh && s->clusters) move_origin(s->mesh, s->clusters->origin);
    s->steps += s->mesh != NULL;
  }
  tc_clusters *made = s->mesh ? tc_clusters_make(s->mesh, wish->pool, error) : NULL;
  if (!made || !tc_clusters_add(&s->clusters, made, wish->labels ? s->labels[s->next] : 0, error)) return false;
  tc_mesh_free(s->mesh);
  s->mesh = NULL;
  s->next++, s->steps++;
  return true;
}

bool tc_surfaces_go_on(tc_surfaces *s, const tc_surfaces_wish *wish, GError **error) {
  if (wish->labels && !s->labels && !find_labels(s, wish, error)) return false;
  const int n = wish->labels ? s->n_labels : 1;
  while (s->next < n)
    if (!make_one(s, wish, error)) return false;
  if (s->clusters) return true;
  tc_mesh *nothing = tc_mesh_new(0, 0, true, error);
  s->clusters = nothing ? tc_clusters_make(nothing, NULL, error) : NULL;
  tc_mesh_free(nothing);
  return s->clusters != NULL;
}
