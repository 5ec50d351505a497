/* Whether a volume looks like labels of another one. Any thread. */
#ifndef TCS_SESSION_LABELS_H
#define TCS_SESSION_LABELS_H

#include "renderer/tomocast.h"

/* TC_ERROR_CONFLICT that says what speaks against it, and that scene.labels.force insists: labels lie on the volume's
 * own grid, on a part of it, or fill the same box by a finer or coarser one; and hold few values, or wide areas of one.
 * The renderer's own check (tc_labels_check()) came before. */
bool tcs_labels_check(const tc_volume *volume, const tc_volume *labels, GError **error);

#endif
