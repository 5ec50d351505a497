/* Presets by name, for who fits them to a volume; the lists are in scene.h. */
#ifndef TC_PRESETS_H
#define TC_PRESETS_H

#include "renderer/scene.h"

/* NULL: no such name. */
const tc_window_preset *tc_window_preset_named(const char *name);

#endif
