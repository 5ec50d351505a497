/* Clipping: the scene's clip box and clip planes, as planes in index coordinates that shorten rays (tc_rays.planes). */
#ifndef TC_RAYCAST_CLIP_H
#define TC_RAYCAST_CLIP_H

#include "renderer/raycast/rays.h"

/* Adds the clip box and planes to rays; called by tc_rays_set_up() and tc_slice_rays(). */
void tc_rays_add_clipping(tc_rays *rays, const tc_volume *volume, const tc_scene *scene);

#endif
