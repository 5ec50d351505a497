/* Projects a mesh to pixels, with the camera conventions of the ray caster (raycast/rays.h).
 *
 * A point p (mm, relative to the mesh's origin) has the view coordinates
 *   right, down   (mm from the axis of the view)       row . (p, 1)
 *   depth         (mm before the eye, along the view)  reference + row . (p, 1)
 * and is drawn at centre + scale * (right, down) / depth (perspective) or centre + scale * (right, down) (orthographic), in
 * pixels with (0, 0) at the top left corner. Depths are relative to a reference near the mesh, so that single precision
 * suffices for a camera far away. Nearness, -(depth - reference) / depth (perspective) or -(depth - reference), grows towards
 * the eye and, unlike depth, is linear in the picture. */
#ifndef TC_MESH_VIEW_H
#define TC_MESH_VIEW_H

#include "renderer/mesh/clusters.h"
#include "renderer/scene/scene.h"

enum {
  TC_VIEW_NEAR,  /* near plane */
  TC_VIEW_GUARD, /* four guard-band planes far outside the picture; inside them fixed-point coordinates do not overflow */
  TC_VIEW_CLIP = TC_VIEW_GUARD + 4,
  TC_VIEW_MOST_CLIP = 12,
  TC_VIEW_PLANES = TC_VIEW_CLIP + TC_VIEW_MOST_CLIP
};

#define TC_VIEW_SUBPIXEL 256 /* fixed-point units of a pixel */
#define TC_VIEW_REACH 16000  /* pixels: distance of the guard planes; below 2^22 units, so that a float holds the coordinate */

typedef struct tc_mesh_view {
  int width, height;
  bool perspective;
  double right[4], down[4], depth[4]; /* rows */
  double reference, scale, centre[2];
  double sides[4][4];              /* planes through the picture's edges, moved out by a pixel; mm, positive inside */
  double planes[TC_VIEW_PLANES][4]; /* clip planes, negative where clipped; mm (guard planes: unscaled) */
  int n_planes;
  double eye[3], forward[3];       /* relative to the mesh's origin; unit */
  double behind;                   /* mm by which back faces count as further away: of two surfaces that coincide, as those of
                                      neighbouring labels do, the one that faces the eye shows */
} tc_mesh_view;

/* The camera was validated (tc_plan_check). Pure. */
void tc_mesh_view_set_up(tc_mesh_view *view, const tc_clusters *mesh, const tc_camera *camera, int width, int height);
/* Adds clip planes in LPS; points with n . p + d >= 0 are kept. At most TC_VIEW_MOST_CLIP in all. */
void tc_mesh_view_clip(tc_mesh_view *view, const tc_clusters *mesh, const double (*clip)[4], int n_clip);

/* Whether the eye is outside the mesh's bounding sphere; a closed, unclipped mesh then shows no back faces. */
bool tc_mesh_view_is_outside(const tc_mesh_view *view, const tc_clusters *mesh);

static inline double tc_mesh_view_row(const double row[4], const double p[3]) {
  return row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3];
}

#endif
