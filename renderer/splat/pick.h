/* What a pixel of mode splat shows. */
#ifndef TC_SPLAT_PICK_H
#define TC_SPLAT_PICK_H

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

typedef struct tc_splat_hit {
  int voxel[3];
  double position[3]; /* LPS mm of its centre */
  double value;
  double distance_mm; /* from the eye to where it is drawn */
} tc_splat_hit;

/* The nearest voxel of the object (volume within splat.threshold, or visible labels, where `labels` is not NULL) whose
 * kernel's core (splatter.h) covers pixel position `at` of the scene's picture, and that clipping leaves. False: none.
 * Reads voxels along one ray. */
bool tc_splat_pick(const tc_volume *volume, const tc_volume *labels, const tc_scene *scene, const double at[2],
                   tc_splat_hit *hit);

#endif
