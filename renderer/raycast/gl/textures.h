/* Copies of volumes and pre-integration tables on the GPU, kept while they are of use. Needs a current context. */
#ifndef TC_RAYCAST_GL_TEXTURES_H
#define TC_RAYCAST_GL_TEXTURES_H

#include "renderer/classify/classify.h"
#include "renderer/gl/device.h"
#include "renderer/raycast/gl/compose.h"

typedef struct tc_gl_volume {
  uint64_t serial; /* of the volume */
  unsigned texture;
  tc_gl_field field;
  int slices_per_layer; /* 1 unless the volume has more slices than a texture has layers */
  float texel[3];       /* 1 / texture size */
  float unpack[2];      /* voxel = texel value * [0] + [1] */
  size_t bytes;
  uint64_t used;
} tc_gl_volume;

typedef struct tc_gl_table {
  uint64_t serial; /* of the table */
  unsigned buffer, texture;
  size_t bytes;
  uint64_t used;
} tc_gl_table;

#define TC_GL_VOLUMES 8
#define TC_GL_TABLES 8

typedef struct tc_gl_textures {
  tc_gl_volume volumes[TC_GL_VOLUMES];
  tc_gl_table tables[TC_GL_TABLES];
  size_t volume_budget, table_budget; /* bytes of all copies; the one in use may exceed it alone */
  uint64_t clock;
} tc_gl_textures;

/* How this device should read voxels of a type: filtered where its texture unit is as good as our own arithmetic. */
tc_gl_field tc_gl_choose_field(const tc_gl_report *device, tc_voxel_type type);

/* The copy of a volume, uploaded if it is not there. Owned by *textures, valid until the next call. TC_ERROR_LIMIT: the
 * device has no texture that large; the message names the mend. */
const tc_gl_volume *tc_gl_textures_volume(tc_gl_textures *textures, const tc_volume *volume, tc_gl_field field,
                                          GError **error);
const tc_gl_table *tc_gl_textures_table(tc_gl_textures *textures, const tc_table *table, GError **error);

void tc_gl_textures_forget(tc_gl_textures *textures, uint64_t volume_serial);
void tc_gl_textures_clear(tc_gl_textures *textures);

#endif
