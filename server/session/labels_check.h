/* Plausibility check: whether a volume looks like a label volume of another one. Any thread. */
#ifndef TCS_SESSION_LABELS_CHECK_H
#define TCS_SESSION_LABELS_CHECK_H

#include "renderer/tomocast.h"

/* A label volume lies on the volume's grid, on a part of that grid, or on a finer or coarser grid of the same box, and
 * has few values or large areas of one value. Else TC_ERROR_CONFLICT, which gives the reason and names
 * scene.labels.force. Call after the renderer's own check (tc_labels_check()). */
bool tcs_labels_check(const tc_volume *volume, const tc_volume *labels, GError **error);

#endif
