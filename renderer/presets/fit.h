/* What the files that fit a scene to a volume share. */
#ifndef TC_FIT_H
#define TC_FIT_H

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

/* NULL: no such name. */
const tc_window_preset *tc_window_preset_named(const char *name);
/* The patient's axis (LPS) along which a volume is looked at first: 1 from the front; along their normal where it is a few
 * axial (2) or sagittal (0) slices. */
int tc_fit_axis(const tc_volume *volume);

#endif
