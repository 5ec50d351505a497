/* Which surface a pixel of mode mesh shows. */
#ifndef TC_MESH_PICK_H
#define TC_MESH_PICK_H

#include "renderer/mesh/raster.h"

typedef struct tc_mesh_hit {
  double position[3]; /* LPS mm */
  double distance_mm; /* from the eye */
  size_t part;        /* of the mesh */
} tc_mesh_hit;

/* The nearest drawn triangle (not clipped, not the back of a one-sided surface) on the ray through pixel position `at` of the view's
 * picture. Surfaces of less than `least` opacity are picked only where the ray meets no other. surfaces: [mesh->n_parts].
 * False: none. Tests the clusters' spheres first. Pure. */
bool tc_mesh_pick(const tc_clusters *mesh, const tc_mesh_view *view, const tc_raster_surface *surfaces, double least,
                  const double at[2], tc_mesh_hit *hit);

#endif
