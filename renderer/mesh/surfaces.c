#include "renderer/mesh/surfaces.h"

#include <stdlib.h>
#include <string.h>

#include "renderer/mesh/measure.h"

#define MESH_TIME 0.6 /* typical share of the extraction in a surface's build time; the rest is its clusters */

struct tc_surfaces {
  tc_mesh *mesh; /* extracted mesh whose clusters are built next */
  tc_clusters *clusters;
  tc_label_boxes *boxes; /* NULL: no source is a label, or not computed yet */
  bool listed;           /* the sources are known */
  tc_mesh_source *sources;
  size_t n_sources, next;
  int64_t steps;
};

tc_surfaces *tc_surfaces_begin(void) { return g_new0(tc_surfaces, 1); }
int64_t tc_surfaces_steps(const tc_surfaces *s) { return s->steps; }

size_t tc_surfaces_held(const tc_surfaces *s) {
  return (s->mesh ? s->mesh->bytes : 0) + (s->clusters ? s->clusters->bytes : 0);
}

void tc_surfaces_free(tc_surfaces *s) {
  if (!s) return;
  tc_mesh_free(s->mesh);
  tc_clusters_free(s->clusters);
  g_free(s->boxes);
  g_free(s->sources);
  g_free(s);
}

tc_clusters *tc_surfaces_take(tc_surfaces *s) {
  tc_clusters *clusters = s->clusters;
  s->clusters = NULL;
  tc_surfaces_free(s);
  return clusters;
}

/* ---- list of labels ---- */

uint32_t tc_mesh_label_of(const tc_volume_desc *d, int bits) {
  const double voxel = d->type == TC_I8 ? (int8_t)bits : d->type == TC_I16 ? (int16_t)bits : bits;
  const double label = d->slope * voxel + d->intercept;
  return label >= 1 && label <= UINT32_MAX ? (uint32_t)label : 0;
}

static void list_labels(tc_surfaces *s, const tc_surfaces_wish *wish) {
  const tc_volume_desc *d = tc_volume_describe(wish->labels);
  const uint64_t serial = tc_volume_serial(wish->labels);
  s->sources = g_new0(tc_mesh_source, (gsize)s->boxes->n_values);
  for (int bits = 0; bits < s->boxes->n_values; bits++) {
    const uint32_t label = tc_mesh_label_of(d, bits);
    if (s->boxes->reach[bits][3] && label && wish->shows(wish->user, label))
      s->sources[s->n_sources++] = (tc_mesh_source){.kind = TC_SURFACE_OF_LABEL, .label = label, .serial = serial};
  }
}

static bool wants_labels(const tc_surfaces_wish *wish) {
  bool wants = !wish->sources;
  for (size_t i = 0; i < wish->n_sources && !wants; i++) wants = wish->sources[i].kind == TC_SURFACE_OF_LABEL;
  return wants;
}

static bool list_sources(tc_surfaces *s, const tc_surfaces_wish *wish, GError **error) {
  if (wants_labels(wish) && !(s->boxes = tc_label_boxes_find(wish->labels, wish->pool, error))) return false;
  if (wish->sources) {
    s->n_sources = wish->n_sources;
    s->sources = g_memdup2(wish->sources, wish->n_sources * sizeof *wish->sources);
  } else {
    list_labels(s, wish);
  }
  s->listed = true;
  s->steps++;
  return true;
}

/* ---- surfaces ---- */

static void middle_of(const tc_volume *volume, double lps[3]) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  double middle[3];
  for (int k = 0; k < 3; k++) middle[k] = 0.5 * (d->dims[k] - 1);
  tc_volume_index_to_lps(volume, middle, lps);
}

/* Moves an uploaded mesh's origin to the volume's centre. */
static void move_origin(tc_mesh *mesh, const tc_volume *volume) {
  double origin[3];
  middle_of(volume, origin);
  if (!memcmp(origin, mesh->origin, sizeof origin)) return;
  for (size_t v = 0; v < mesh->n_vertices; v++)
    for (int k = 0; k < 3; k++) mesh->positions[v][k] += (float)(mesh->origin[k] - origin[k]);
  memcpy(mesh->origin, origin, sizeof origin);
}

/* A copy with normals, which all surfaces of one list need; for NULL an empty mesh. max_bytes: TC_ERROR_LIMIT above it; 0 = no
 * limit. */
static tc_mesh *copy_with_normals(const tc_mesh *mesh, uint64_t max_bytes, GError **error) {
  if (!mesh) return tc_mesh_new(0, 0, true, error);
  const uint64_t colors = mesh->colors ? mesh->n_vertices * TC_MESH_COLOR_BYTES : 0;
  if (max_bytes && tc_mesh_bytes(mesh->n_vertices, mesh->n_triangles, true) + colors > max_bytes) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "mesh of %zu triangles: there is no memory to show it; simplify it first",
                 mesh->n_triangles);
    return NULL;
  }
  tc_mesh *copy = tc_mesh_new(mesh->n_vertices, mesh->n_triangles, mesh->normals != NULL, error);
  if (copy && colors && !tc_mesh_add_colors(copy, error)) g_clear_pointer(&copy, tc_mesh_free);
  if (!copy) return NULL;
  memcpy(copy->origin, mesh->origin, sizeof copy->origin);
  memcpy(copy->positions, mesh->positions, mesh->n_vertices * sizeof *copy->positions);
  memcpy(copy->triangles, mesh->triangles, mesh->n_triangles * sizeof *copy->triangles);
  if (colors) memcpy(copy->colors, mesh->colors, colors);
  if (mesh->normals) memcpy(copy->normals, mesh->normals, mesh->n_vertices * sizeof *copy->normals);
  if (mesh->normals || tc_mesh_add_normals(copy, NULL, NULL, error)) return copy;
  tc_mesh_free(copy);
  return NULL;
}

static tc_mesh *make_mesh(const tc_surfaces_wish *wish, const tc_mesh_source *of, const tc_label_boxes *boxes,
                          const tc_mesh_options *options, GError **error) {
  tc_mesh_options of_value = *options;
  of_value.blocks = wish->blocks;
  switch (of->kind) {
  case TC_SURFACE_OF_VALUE: return tc_mesh_extract(wish->volume, of->iso, &of_value, error);
  case TC_SURFACE_OF_PLANE: return tc_mesh_of_plane(wish->volume, of->plane, error);
  case TC_SURFACE_OF_LABEL: return tc_mesh_extract_label(wish->labels, of->label, boxes, options, error);
  case TC_SURFACE_OF_MESH: return copy_with_normals(of->mesh, options->max_bytes, error);
  case TC_SURFACE_SOURCE_COUNT: break;
  }
  return tc_mesh_new(0, 0, true, error);
}

bool tc_mesh_source_equal(const tc_mesh_source *a, const tc_mesh_source *b) {
  return a->kind == b->kind && a->label == b->label && a->iso == b->iso && a->serial == b->serial &&
         !memcmp(a->plane, b->plane, sizeof a->plane);
}

/* Copy of an equal surface of the earlier result; NULL if there is none or no memory for a copy. */
static tc_clusters *copy_one(const tc_surfaces_wish *wish, const tc_mesh_source *of) {
  const tc_clusters *like = wish->like;
  double origin[3];
  middle_of(wish->volume, origin);
  if (!like || memcmp(origin, like->origin, sizeof origin)) return NULL;
  for (size_t i = 0; i < like->n_parts; i++)
    if (tc_mesh_source_equal(&like->parts[i].of, of)) return tc_clusters_copy_part(like, i, NULL);
  return NULL;
}

/* Builds the next surface: a copy, or extraction and clusters as two steps. */
static bool make_one(tc_surfaces *s, const tc_surfaces_wish *wish, GError **error) {
  const tc_mesh_source *of = &s->sources[s->next];
  const uint64_t held = s->clusters ? s->clusters->bytes : 0;
  const double n = (double)s->n_sources, next = (double)s->next;
  const tc_share all = {wish->permille, next / n, (next + 1) / n}, clusters = tc_share_part(&all, MESH_TIME, 1);
  const tc_mesh_options options = {.normals = true, .pool = wish->pool, .share = tc_share_part(&all, 0, MESH_TIME),
                                   .max_bytes = wish->max_bytes > held ? wish->max_bytes - held : 1};
  tc_clusters *made = s->mesh ? NULL : copy_one(wish, of);
  if (!s->mesh && !made) {
    s->mesh = make_mesh(wish, of, s->boxes, &options, error);
    if (s->mesh) move_origin(s->mesh, wish->volume);
    s->steps += s->mesh != NULL;
  }
  if (s->mesh) made = tc_clusters_make(s->mesh, wish->pool, &clusters, error);
  if (!made || !tc_clusters_add(&s->clusters, made, of, error)) return false;
  g_clear_pointer(&s->mesh, tc_mesh_free);
  s->next++, s->steps++;
  return true;
}

bool tc_surfaces_go_on(tc_surfaces *s, const tc_surfaces_wish *wish, GError **error) {
  if (!s->listed && !list_sources(s, wish, error)) return false;
  while (s->next < s->n_sources)
    if (!make_one(s, wish, error)) return false;
  if (s->clusters) return true;
  tc_mesh *nothing = tc_mesh_new(0, 0, true, error);
  s->clusters = nothing ? tc_clusters_make(nothing, NULL, NULL, error) : NULL;
  tc_mesh_free(nothing);
  return s->clusters != NULL;
}
