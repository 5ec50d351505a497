/* Cost of a frame before its first ray while the transfer function is edited: tables and empty-space skipping. */
#ifndef TC_SERVER_EDITS_H
#define TC_SERVER_EDITS_H

#include <cjson/cJSON.h>

#include "renderer/tomocast.h"

enum { TCS_EDITS = 3 };

typedef struct tcs_edit {
  const char *name;          /* printed, and in the JSON */
  double tables_ms, skip_ms; /* medians */
} tcs_edit;

/* Renders frames of the scene with a new transfer function each: one knot slides, all knots shift, presets change. */
bool tcs_edits_measure(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, tcs_edit edits[TCS_EDITS],
                       GError **error);
void tcs_edits_print(const tcs_edit edits[TCS_EDITS]);
cJSON *tcs_edits_as_json(const tcs_edit edits[TCS_EDITS]);

#endif
