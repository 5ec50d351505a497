/* Picking in mode splat: the voxel that a pixel shows. */
#ifndef TC_SPLAT_PICK_H
#define TC_SPLAT_PICK_H

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

typedef struct tc_splat_hit {
  int voxel[3];
  double position[3]; /* LPS mm of its centre */
  double value;
  double distance_mm; /* from the eye to its drawn position */
} tc_splat_hit;

/* Finds the nearest voxel of the object (the volume within splat.threshold; visible labels if `labels` is not NULL) that is
 * not clipped and whose kernel's core (splatter.h) covers pixel position `at` of the scene's picture. Returns false if there
 * is none. Reads voxels along one ray. */
bool tc_splat_pick(const tc_volume *volume, const tc_volume *labels, const tc_scene *scene, const double at[2],
                   tc_splat_hit *hit);

#endif
