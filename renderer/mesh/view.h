/* From a camera to the pixels of a mesh: the conventions of the ray caster (raycast/rays.h), the other way round.
 *
 * A point p (mm, relative to the mesh's origin) is at
 *   right, down   (mm from the axis of the view)       row . (p, 1)
 *   depth         (mm before the eye, along the view)  reference + row . (p, 1)
 * and on the picture at centre + scale * (right, down) / depth (perspective) or centre + scale * (right, down), in
 * pixels with (0, 0) at the top left corner. Depths are kept relative to a reference near the mesh, so that single
 * precision holds for a camera far away. What is nearer has the larger nearness, -(depth - reference) / depth or
 * -(depth - reference), which is linear over the picture as depth itself is not. */
#ifndef TC_MESH_VIEW_H
#define TC_MESH_VIEW_H

#include "renderer/mesh/clusters.h"
#include "renderer/scene/scene.h"

enum {
  TC_VIEW_NEAR,  /* plane before the eye */
  TC_VIEW_GUARD, /* four planes far outside the picture: within them pixels have their fixed point */
  TC_VIEW_CLIP = TC_VIEW_GUARD + 4,
  TC_VIEW_MOST_CLIP = 12,
  TC_VIEW_PLANES = TC_VIEW_CLIP + TC_VIEW_MOST_CLIP
};

#define TC_VIEW_SUBPIXEL 256 /* of the fixed point */
#define TC_VIEW_REACH 16000  /* pixels: the guard planes' distance; 2^22 parts, which a float and a magic number hold */

typedef struct tc_mesh_view {
  int width, height;
  bool perspective;
  double right[4], down[4], depth[4]; /* rows */
  double reference, scale, centre[2];
  double sides[4][4];              /* planes through the picture's edges, a pixel further out; mm, inside is above 0 */
  double planes[TC_VIEW_PLANES][4]; /* what is cut off is below 0; mm (the guard's: in any unit) */
  int n_planes;
  double eye[3], forward[3];       /* relative to the mesh's origin; unit */
} tc_mesh_view;

/* The camera was validated (tc_plan_check). Pure. */
void tc_mesh_view_set_up(tc_mesh_view *view, const tc_clusters *mesh, const tc_camera *camera, int width, int height);
/* Adds LPS planes n . p + d >= 0 of what is kept, at most TC_VIEW_MOST_CLIP in all. */
void tc_mesh_view_clip(tc_mesh_view *view, const tc_clusters *mesh, const double (*clip)[4], int n_clip);

/* Whether the eye is outside the sphere around all of the mesh, so that a closed mesh that no plane cuts shows no back. */
bool tc_mesh_view_is_outside(const tc_mesh_view *view, const tc_clusters *mesh);

static inline double tc_mesh_view_row(const double row[4], const double p[3]) {
  return row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3];
}

#endif
