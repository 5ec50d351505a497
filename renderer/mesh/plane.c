#include <math.h>
#include <string.h>

#include "renderer/mesh/mesh.h"

enum { MOST_CORNERS = 4 + 6 }; /* each face of the box takes one away and adds two */

typedef struct polygon {
  int n;
  double at[MOST_CORNERS][3]; /* index coordinates */
} polygon;

/* Keeps what is on the inner side of a face of the box: sign * (at[axis] - limit) <= 0 (Sutherland and Hodgman, 1974). */
static void cut(polygon *p, int axis, double sign, double limit) {
  polygon out = {0};
  for (int i = 0; i < p->n; i++) {
    const double *a = p->at[i], *b = p->at[(i + 1) % p->n];
    const double from = sign * (a[axis] - limit), to = sign * (b[axis] - limit);
    if (from <= 0) memcpy(out.at[out.n++], a, sizeof *out.at);
    if ((from <= 0) == (to <= 0)) continue;
    for (int k = 0; k < 3; k++) out.at[out.n][k] = a[k] + (b[k] - a[k]) * from / (from - to);
    out.at[out.n++][axis] = limit;
  }
  *p = out;
}

/* A square of the plane that is wider than the volume, about where the plane is nearest to its middle. */
static polygon wide_square(const tc_volume *volume, const double plane[4]) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  double middle[3], lps[3], u[3], v[3], wide = 0, apart = plane[3];
  polygon p = {.n = 4};
  for (int k = 0; k < 3; k++) middle[k] = 0.5 * (d->dims[k] - 1), wide += d->dims[k] * d->spacing[k];
  tc_volume_index_to_lps(volume, middle, lps);
  for (int k = 0; k < 3; k++) apart += plane[k] * lps[k];
  const int least = fabs(plane[0]) < fabs(plane[1]) ? (fabs(plane[0]) < fabs(plane[2]) ? 0 : 2) : fabs(plane[1]) < fabs(plane[2]) ? 1 : 2;
  double axis[3] = {0}, length = 0;
  axis[least] = 1;
  for (int k = 0; k < 3; k++) u[k] = plane[(k + 1) % 3] * axis[(k + 2) % 3] - plane[(k + 2) % 3] * axis[(k + 1) % 3];
  for (int k = 0; k < 3; k++) length += u[k] * u[k];
  for (int k = 0; k < 3; k++) u[k] /= sqrt(length);
  for (int k = 0; k < 3; k++) v[k] = plane[(k + 1) % 3] * u[(k + 2) % 3] - plane[(k + 2) % 3] * u[(k + 1) % 3];
  for (int i = 0; i < 4; i++) {
    const double along = i == 0 || i == 3 ? -wide : wide, across = i < 2 ? -wide : wide;
    double corner[3];
    for (int k = 0; k < 3; k++) corner[k] = lps[k] - apart * plane[k] + along * u[k] + across * v[k];
    tc_volume_lps_to_index(volume, corner, p.at[i]);
  }
  return p;
}

tc_mesh *tc_mesh_of_plane(const tc_volume *volume, const double plane[4], GError **error) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  polygon p = wide_square(volume, plane);
  for (int axis = 0; axis < 3; axis++) cut(&p, axis, 1, d->dims[axis] - 1), cut(&p, axis, -1, 0);
  if (p.n < 3) p.n = 0;
  tc_mesh *m = tc_mesh_new((size_t)p.n, p.n ? (size_t)p.n - 2 : 0, true, error);
  if (!m) return NULL;
  if (p.n) tc_volume_index_to_lps(volume, p.at[0], m->origin);
  for (uint32_t i = 0; i < (uint32_t)p.n; i++) {
    double lps[3];
    tc_volume_index_to_lps(volume, p.at[i], lps);
    for (int k = 0; k < 3; k++) {
      m->positions[i][k] = (float)(lps[k] - m->origin[k]);
      m->normals[i][k] = (float)plane[k];
    }
    if (i > 1) m->triangles[i - 2][0] = 0, m->triangles[i - 2][1] = i - 1, m->triangles[i - 2][2] = i;
  }
  return m;
}
