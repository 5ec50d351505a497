/* Composes a program from pieces of GLSL, so that a variant contains only the stages of its plan. */
#ifndef TC_RAYCAST_GL_COMPOSE_H
#define TC_RAYCAST_GL_COMPOSE_H

#include <stdbool.h>

#include "renderer/base/error.h"
#include "renderer/plan/key.h"

/* Everything a program depends on: the plan's key and choices of this back end. Zeroed before filling, because variants
 * are compared as bytes. Camera, table, background and sizes are run-time parameters, whose change compiles nothing. */
typedef struct tc_gl_variant {
  tc_plan_key plan;
  uint8_t atlas;        /* 0/1: several slices per texture layer */
  uint8_t linear_light; /* 0/1: encode to sRGB */
  uint8_t transparent;  /* 0/1: straight alpha instead of a background */
  uint8_t want_linear;  /* 0/1: writes floats too */
  uint8_t want_depth;   /* 0/1: writes depths of an isosurface too */
  uint8_t label_signed; /* 0/1: the label volume's voxels are signed */
  uint16_t textures;    /* software drivers: properties of textures for which they recompile (texture_traits() of
                           backend.c) */
  uint8_t sampled;      /* modes of several passes: 1: the last pass reads the volume; 2: and its gaps */
  uint8_t within;       /* 0/1: rays begin and end at the job's spans */
  uint8_t pass;         /* number of the pass in modes with several (tc_gl_drawer); 0: the last, which writes the
                           picture */
} tc_gl_variant;

/* The text of a piece by its file name; NULL: unknown. */
const char *tc_gl_piece(const char *name);

/* Compiles the variant; needs a current context. The caller deletes the program. 0 with TC_ERROR_UNSUPPORTED for an
 * unknown key, or TC_ERROR_INTERNAL if the driver refuses. */
unsigned tc_gl_compose(const tc_gl_variant *variant, GError **error);

#endif
