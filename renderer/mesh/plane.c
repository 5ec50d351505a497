#include <math.h>

#include "renderer/base/vector.h"
#include "renderer/mesh/clip.h"

/* A square of the plane that is wider than the volume, about where the plane is nearest to its middle. */
static void wide_square(const tc_volume *volume, const double plane[4], tc_clip_corner square[4]) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  double middle[3], lps[3], u[3], v[3], wide = 0;
  for (int k = 0; k < 3; k++) middle[k] = 0.5 * (d->dims[k] - 1), wide += d->dims[k] * d->spacing[k];
  tc_volume_index_to_lps(volume, middle, lps);
  const double apart = dot3(plane, lps) + plane[3];
  const int least = fabs(plane[0]) < fabs(plane[1]) ? (fabs(plane[0]) < fabs(plane[2]) ? 0 : 2) : fabs(plane[1]) < fabs(plane[2]) ? 1 : 2;
  double axis[3] = {0};
  axis[least] = 1;
  cross3(plane, axis, u);
  normalise3(u);
  cross3(plane, u, v);
  for (int i = 0; i < 4; i++) {
    const double along = i == 0 || i == 3 ? -wide : wide, across = i < 2 ? -wide : wide;
    double corner[3];
    for (int k = 0; k < 3; k++) corner[k] = lps[k] - apart * plane[k] + along * u[k] + across * v[k];
    tc_volume_lps_to_index(volume, corner, square[i].at);
  }
}

tc_mesh *tc_mesh_of_plane(const tc_volume *volume, const double plane[4], GError **error) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  tc_clip_corner p[2][TC_CLIP_MOST_CORNERS];
  int n = 4;
  wide_square(volume, plane, p[0]);
  for (int i = 0; i < 6; i++) { /* the faces of the volume, over index coordinates */
    double face[4] = {0};
    face[i / 2] = i % 2 ? -1 : 1, face[3] = i % 2 ? d->dims[i / 2] - 1 : 0;
    n = tc_clip_at(face, p[i % 2], n, p[1 - i % 2]);
  }
  if (n < 3) n = 0;
  tc_mesh *m = tc_mesh_new((size_t)n, n ? (size_t)n - 2 : 0, true, error);
  if (!m) return NULL;
  if (n) tc_volume_index_to_lps(volume, p[0][0].at, m->origin);
  for (uint32_t i = 0; i < (uint32_t)n; i++) {
    double lps[3];
    tc_volume_index_to_lps(volume, p[0][i].at, lps);
    for (int k = 0; k < 3; k++) {
      m->positions[i][k] = (float)(lps[k] - m->origin[k]);
      m->normals[i][k] = (float)plane[k];
    }
    if (i > 1) m->triangles[i - 2][0] = 0, m->triangles[i - 2][1] = i - 1, m->triangles[i - 2][2] = i;
  }
  return m;
}
