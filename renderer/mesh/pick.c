#include "renderer/mesh/pick.h"

#include <math.h>

#include "renderer/base/vector.h"

typedef struct ray {
  double from[3], along[3]; /* unit */
} ray;

static ray ray_of(const tc_mesh_view *v, double x, double y) {
  const double right = (x - v->centre[0]) / v->scale, down = (y - v->centre[1]) / v->scale;
  ray r;
  for (int k = 0; k < 3; k++) {
    const double aside = right * v->right[k] + down * v->down[k];
    r.from[k] = v->eye[k] + (v->perspective ? 0 : aside);
    r.along[k] = v->forward[k] + (v->perspective ? aside : 0);
  }
  normalise3(r.along);
  return r;
}

static bool passes(const ray *r, const tc_cluster *c) {
  double to[3], square = 0;
  for (int k = 0; k < 3; k++) to[k] = c->centre[k] - r->from[k];
  const double t = dot3(to, r->along);
  for (int k = 0; k < 3; k++) square += (to[k] - t * r->along[k]) * (to[k] - t * r->along[k]);
  return square <= 1.001 * (double)c->radius * (double)c->radius;
}

/* Moller and Trumbore, Fast, minimum storage ray/triangle intersection, 1997. */
static bool meets(const ray *r, double corner[3][3], bool one_sided, double *t, bool *back) {
  double u[3], v[3], p[3], q[3], s[3];
  for (int k = 0; k < 3; k++)
    u[k] = corner[1][k] - corner[0][k], v[k] = corner[2][k] - corner[0][k], s[k] = r->from[k] - corner[0][k];
  cross3(r->along, v, p);
  cross3(s, u, q);
  const double det = dot3(u, p), a = dot3(s, p) / det, b = dot3(r->along, q) / det;
  if (det == 0 || (one_sided && det < 0) || !(a >= 0 && b >= 0 && a + b <= 1)) return false;
  *t = dot3(v, q) / det, *back = det < 0;
  return true;
}

/* Before the near plane or beyond a clip plane nothing is drawn. */
static bool is_kept(const tc_mesh_view *v, const double p[3]) {
  for (int i = 0; i < v->n_planes; i++)
    if ((i < TC_VIEW_GUARD || i >= TC_VIEW_CLIP) && tc_mesh_view_row(v->planes[i], p) < 0) return false;
  return true;
}

/* The nearest triangle so far: its distance, and what that counts as (view->behind). */
typedef struct found {
  double t, counts;
  size_t part;
} found;

static void look_in(const tc_clusters *m, const tc_cluster *c, const tc_mesh_view *view, const ray *r, bool one_sided, found *nearest) {
  const size_t room = tc_cluster_padded(c->n_vertices), row = tc_cluster_padded(c->n_triangles);
  const float *at = m->positions + 3 * (size_t)c->vertex;
  const uint8_t *corners = m->triangles + 3 * (size_t)c->triangle;
  for (size_t i = 0; i < c->n_triangles; i++) {
    double corner[3][3], p[3], t;
    bool back;
    for (size_t v = 0; v < 3; v++)
      for (size_t k = 0; k < 3; k++) corner[v][k] = at[k * room + corners[v * row + i]];
    if (!meets(r, corner, one_sided, &t, &back)) continue;
    const double counts = t + (back ? view->behind / dot3(r->along, view->forward) : 0);
    if (counts >= nearest->counts) continue;
    for (int k = 0; k < 3; k++) p[k] = r->from[k] + t * r->along[k];
    if (is_kept(view, p)) *nearest = (found){t, counts, c->part};
  }
}

bool tc_mesh_pick(const tc_clusters *mesh, const tc_mesh_view *view, const tc_raster_surface *surfaces, double least,
                  const double at[2], tc_mesh_hit *hit) {
  const ray r = ray_of(view, at[0], at[1]);
  found nearest[2] = {{.counts = INFINITY}, {.counts = INFINITY}}; /* of what is looked through, and of the rest */
  for (size_t i = 0; i < mesh->n; i++) {
    const tc_cluster *c = &mesh->clusters[i];
    const tc_raster_surface *s = &surfaces[c->part];
    const bool seen = (double)s->opacity >= least;
    if (c->level == 0 && passes(&r, c)) look_in(mesh, c, view, &r, s->one_sided, &nearest[seen]);
  }
  const found *first = &nearest[nearest[1].counts < INFINITY];
  if (!(first->counts < INFINITY)) return false;
  for (int k = 0; k < 3; k++) hit->position[k] = mesh->origin[k] + r.from[k] + first->t * r.along[k];
  hit->distance_mm = first->t;
  hit->part = first->part;
  return true;
}
