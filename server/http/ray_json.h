/* The record of one ray, for the HTTP service and the command line. */
#ifndef TCS_HTTP_RAY_JSON_H
#define TCS_HTTP_RAY_JSON_H

#include <stdatomic.h>

#include "protocol/protocol.h"
#include "renderer/volume/volume.h"

/* Integrates the ray through the centre of `pixel` (x, y) with the reference. Returns JSON text (g_malloc'ed):
 * {"color", "opacity", "samples": [{"position", "depth", "length", "value", "color", "extinction", "transparency"}]},
 * front to back. Errors: those of the reference for scenes it does not support; TC_ERROR_CANCELLED once *cancel (or
 * NULL) is true. labels: the scene's label volume, or NULL. Any thread; takes about a millisecond, more with many
 * knots. */
char *tcs_ray_json(tc_volume *volume, tc_volume *labels, const tc_scene *scene, const int pixel[2],
                   const atomic_bool *cancel, GError **error);

#endif
