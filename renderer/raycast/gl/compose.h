/* From a plan to a compute program: pieces of GLSL put together so that a variant holds what its scene needs, no more.
 */
#ifndef TC_RAYCAST_GL_COMPOSE_H
#define TC_RAYCAST_GL_COMPOSE_H

#include <stdbool.h>

#include "renderer/error.h"
#include "renderer/plan/key.h"

/* Everything a program depends on: the plan's key and what only this back end decides. Zeroed before filling: compared
 * as bytes. What is not here (camera, table, background, sizes) is a run-time number and rebuilds nothing. */
typedef struct tc_gl_variant {
  tc_plan_key plan;
  uint8_t atlas;        /* 0/1: several slices per texture layer */
  uint8_t linear_light; /* 0/1: encode to sRGB */
  uint8_t transparent;  /* 0/1: straight alpha instead of a background */
  uint8_t want_linear;  /* 0/1: floats are written too */
  uint8_t want_depth;   /* 0/1: and depths, of an isosurface */
  uint8_t label_signed; /* 0/1: the label volume's voxels are */
} tc_gl_variant;

/* A piece by its file's name; NULL: not in this build. */
const char *tc_gl_piece(const char *name);

/* Compiles the variant; needs a current context. 0 with TC_ERROR_UNSUPPORTED for a key nothing is built for, or
 * TC_ERROR_INTERNAL where the driver refuses. */
unsigned tc_gl_compose(const tc_gl_variant *variant, GError **error);

#endif
