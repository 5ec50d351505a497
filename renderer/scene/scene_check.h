/* What must hold within a scene whatever the volume: asked by the parser of patches and by tc_plan_check(), so that both
 * refuse the same. Pure. */
#ifndef TC_SCENE_CHECK_H
#define TC_SCENE_CHECK_H

#include "renderer/scene/scene.h"

/* Why no rays can be made from a camera, one phrase; NULL: they can. *pointer: the JSON pointer of the member at fault. */
const char *tc_camera_fault(const tc_camera *camera, const char **pointer);

/* Why the slice of mode mpr has no plane, where the scene says it is oblique; likewise. */
const char *tc_slice_fault(const tc_scene *scene, const char **pointer);

/* Whether a picture of so many pixels may be made at all. */
bool tc_image_fits(int width, int height);

#endif
