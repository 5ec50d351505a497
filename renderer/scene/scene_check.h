/* Checks of a scene that need no volume, shared by the parser of patches and by tc_plan_check(), so that both refuse
 * the same scenes. Pure. */
#ifndef TC_SCENE_CHECK_H
#define TC_SCENE_CHECK_H

#include "renderer/scene/scene.h"

/* Returns one phrase that says why the camera is invalid, and sets *pointer to the JSON pointer of the member at fault;
 * NULL: the camera is valid. Both strings are static. */
const char *tc_camera_fault(const tc_camera *camera, const char **pointer);

/* The same check for the plane of an oblique slice (mode mpr). */
const char *tc_slice_fault(const tc_scene *scene, const char **pointer);

/* True if the picture is within TC_MAX_IMAGE_SIDE and TC_MAX_IMAGE_AREA. */
bool tc_image_fits(int width, int height);

#endif
