#include "renderer/mesh/sight.h"

#include <math.h>

/* Whether all of a cluster's normals face away from the eye, for any position in its sphere. */
static bool faces_away(const tc_mesh_view *v, const tc_cluster *k) {
  double along = 0, apart = 0;
  if (k->spread > 1) return false;
  for (int i = 0; i < 3; i++) {
    double to = v->perspective ? k->centre[i] - v->eye[i] : v->forward[i];
    along += to * k->axis[i], apart += to * to;
  }
  /* The cone's angle plus the spread of the view direction over the sphere stay within a right angle. */
  return along > (k->spread * sqrt(apart) + (v->perspective ? k->radius * 1.001 : 0)) * 1.00001;
}

/* Pixels from `lo` to `hi` along an axis, clamped to the picture. */
static bool pixel_range(double lo, double hi, int size, int16_t *first, int16_t *last) {
  lo -= 0.02, hi += 0.02;
  if (!(hi >= 0 && lo < size)) return false;
  *first = (int16_t)(lo > 0 ? lo : 0); /* not negative, so that the conversion rounds down */
  *last = (int16_t)(hi < size - 1 ? hi : size - 1);
  return true;
}

/* Pixels that a sphere may touch. Returns false if there are none. */
static bool bound_sphere(const tc_mesh_view *v, const double centre[3], double r, tc_sight *s) {
  const double depth = tc_mesh_view_row(v->depth, centre) + v->reference, nearest = depth - r;
  const double at[2] = {tc_mesh_view_row(v->right, centre), tc_mesh_view_row(v->down, centre)};
  const int size[2] = {v->width, v->height};
  int16_t first[2], last[2];
  for (int k = 0; k < 2; k++) {
    double lo = at[k] - r, hi = at[k] + r;
    if (v->perspective && nearest <= 0) {
      lo = -INFINITY, hi = INFINITY;
    } else if (v->perspective) {
      lo /= lo < 0 ? nearest : depth + r;
      hi /= hi > 0 ? nearest : depth + r;
    }
    if (!pixel_range(v->centre[k] + v->scale * lo, v->centre[k] + v->scale * hi, size[k], &first[k], &last[k])) return false;
  }
  s->x0 = first[0], s->y0 = first[1], s->x1 = last[0], s->y1 = last[1];
  double behind = depth - v->reference - r;
  s->nearest = (float)(!v->perspective ? -behind : nearest > 0 ? -behind / nearest : INFINITY);
  return true;
}

double tc_sight_slack(const tc_clusters *mesh) {
  double far = 0;
  for (int k = 0; k < 3; k++) far = fmax(far, fabs((double)mesh->centre[k]));
  return 1e-5 * ((double)mesh->radius + far);
}

tc_sight tc_sight_of(const tc_mesh_view *v, const tc_cluster *k, double slack, bool one_sided, bool *away) {
  const double centre[3] = {k->centre[0], k->centre[1], k->centre[2]}, r = k->radius * 1.0001 + slack;
  const tc_sight none = {.x0 = 0, .x1 = -1};
  tc_sight s = {.part = k->part};
  bool outside = false;
  for (int i = 0; i < 4 && !outside; i++) outside = tc_mesh_view_row(v->sides[i], centre) < -r;
  for (int i = 0; i < v->n_planes && !outside; i++) {
    double apart = tc_mesh_view_row(v->planes[i], centre);
    outside = apart < -r;
    if (apart <= r) s.planes |= 1u << i;
  }
  outside = outside || !bound_sphere(v, centre, r, &s);
  *away = !outside && one_sided && faces_away(v, k);
  return outside || *away ? none : s;
}
