/* Whether a volume looks like labels of another one. Any thread. */
#ifndef TCS_SESSION_LABELS_CHECK_H
#define TCS_SESSION_LABELS_CHECK_H

#include "renderer/tomocast.h"

/* Labels lie on the volume's own grid, on a part of that grid, or on a finer or coarser grid of the same box; they hold
 * few values, or large areas of one value. Else TC_ERROR_CONFLICT, which gives the reason and names scene.labels.force.
 * The renderer's own check (tc_labels_check()) came before. */
bool tcs_labels_check(const tc_volume *volume, const tc_volume *labels, GError **error);

#endif
