/* Composes a compute program from pieces of GLSL, so that a variant contains only what its plan names. */
#ifndef TC_RAYCAST_GL_COMPOSE_H
#define TC_RAYCAST_GL_COMPOSE_H

#include <stdbool.h>

#include "renderer/base/error.h"
#include "renderer/plan/key.h"

/* Everything a program depends on: the plan's key and what only this back end decides. Zeroed before filling,
 * because variants are compared as bytes. Camera, table, background and sizes are run-time numbers, and compile
 * nothing. */
typedef struct tc_gl_variant {
  tc_plan_key plan;
  uint8_t atlas;        /* 0/1: several slices per texture layer */
  uint8_t linear_light; /* 0/1: encode to sRGB */
  uint8_t transparent;  /* 0/1: straight alpha instead of a background */
  uint8_t want_linear;  /* 0/1: writes floats too */
  uint8_t want_depth;   /* 0/1: writes depths of an isosurface too */
  uint8_t label_signed; /* 0/1: the label volume's voxels are signed */
  uint16_t textures;    /* of a driver in software: what its machine code depends on besides (texture_traits() of backend.c) */
  uint8_t within;       /* 0/1: rays begin and end where the job's spans say */
  uint8_t pass;         /* of a mode that is drawn in several (tc_gl_drawer), which; 0: the last, which gives the picture */
} tc_gl_variant;

/* The text of a piece by its file's name; NULL: unknown. */
const char *tc_gl_piece(const char *name);

/* Compiles the variant; needs a current context. 0 with TC_ERROR_UNSUPPORTED for an unknown key, or
 * TC_ERROR_INTERNAL if the driver refuses. */
unsigned tc_gl_compose(const tc_gl_variant *variant, GError **error);

#endif
