/* Shared by the files that fit a scene to a volume. */
#ifndef TC_FIT_H
#define TC_FIT_H

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

/* NULL: no such name. */
const tc_window_preset *tc_window_preset_named(const char *name);
/* The LPS axis of the first view: 1 (from the front); for a thin stack of axial or sagittal slices the stack's normal,
 * 2 or 0. */
int tc_fit_axis(const tc_volume *volume);

#endif
