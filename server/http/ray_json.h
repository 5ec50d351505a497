/* The verbose ray, as the HTTP service and the command line give it. */
#ifndef TCS_HTTP_RAY_JSON_H
#define TCS_HTTP_RAY_JSON_H

#include <stdatomic.h>

#include "protocol/protocol.h"
#include "renderer/volume/volume.h"

/* What the reference integrator makes of the ray through the centre of `pixel` (x, y), as JSON text (g_malloc'ed):
 * {"color", "opacity", "samples": [{"position", "depth", "length", "value", "color", "extinction", "transparency"}]},
 * front to back. Errors: those of the reference, for what it does not know; TC_ERROR_CANCELLED once *cancel (or NULL)
 * is true. labels: what the scene names, or NULL. Any thread; costs a millisecond or so, many knots more. */
char *tcs_ray_json(tc_volume *volume, tc_volume *labels, const tc_scene *scene, const int pixel[2],
                   const atomic_bool *cancel, GError **error);

#endif
