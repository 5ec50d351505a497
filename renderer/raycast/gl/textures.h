/* Copies of volumes, pre-integration tables, distance maps and other lookups on the GPU, with LRU eviction. Needs a
 * current context. */
#ifndef TC_RAYCAST_GL_TEXTURES_H
#define TC_RAYCAST_GL_TEXTURES_H

#include "renderer/classify/preintegration.h"
#include "renderer/classify/integrals.h"
#include "renderer/classify/labels.h"
#include "renderer/gl/device.h"
#include "renderer/raycast/gl/builder.h"
#include "renderer/raycast/gl/compose.h"
#include "renderer/skip/bounds.h"
#include "renderer/skip/distance_map.h"

typedef struct tc_gl_volume {
  uint64_t serial; /* of the volume */
  unsigned texture;
  int slices_per_layer; /* 1 unless the volume has more slices than a texture has layers */
  float texel[3];       /* 1 / texture size */
  size_t bytes;
  uint64_t used;
} tc_gl_volume;

/* A buffer texture: a table or integrals (RGBA32F), a distance map or bounds (R8UI). */
typedef struct tc_gl_lookup {
  uint64_t key[5]; /* serials of table or support, and of the volume (0 for a table, which serves any volume); block
                      width; serial of bounds, or a distance map's reach; serial of labels, or of integrals (for any
                      volume) */
  unsigned buffer, texture;
  void *memory; /* our mapping that backs the buffer, of `bytes`; NULL: memory of the driver */
  size_t bytes;
  uint64_t used;
} tc_gl_lookup;

#define TC_GL_VOLUMES 8
#define TC_GL_LOOKUPS 16

typedef struct tc_gl_textures {
  tc_gl_volume volumes[TC_GL_VOLUMES];
  tc_gl_lookup lookups[TC_GL_LOOKUPS];
  size_t volume_budget, lookup_budget; /* bytes; the copies that the current frame uses may exceed them */
  uint64_t frame;                      /* number of the current frame, whose copies are not evicted */
  bool pins;                           /* the buffer of a large lookup can be backed by our memory */
} tc_gl_textures;

/* For each frame call tc_gl_textures_begin(), then request volume and label volume, then the lookups. All are owned by
 * *textures and live until the next frame begins. Missing ones are uploaded; if the halt (NULL: none) interrupts the
 * upload of a lookup, the upload starts anew next time. TC_ERROR_LIMIT: no texture of this device is large enough; the
 * message says how to fix it. */
void tc_gl_textures_begin(tc_gl_textures *textures);
/* True if the volume is not resident and fits a texture of this device. */
bool tc_gl_textures_want(const tc_gl_textures *textures, const tc_volume *volume);
const tc_gl_volume *tc_gl_textures_volume(tc_gl_textures *textures, const tc_volume *volume, GError **error);
/* The builder fills the table if tc_gl_builder_serves() it, and its time is added to *ms; else the table's entries are
 * uploaded. */
const tc_gl_lookup *tc_gl_textures_table(tc_gl_textures *textures, const tc_gl_builder *builder, const tc_table *table,
                                         double *ms, const tc_halt *halt, GError **error);
const tc_gl_lookup *tc_gl_textures_integrals(tc_gl_textures *textures, const tc_integrals *integrals,
                                             const tc_halt *halt, GError **error);
const tc_gl_lookup *tc_gl_textures_distance_map(tc_gl_textures *textures, const tc_volume *volume, const tc_distance_map *map,
                                        const tc_halt *halt, GError **error);
const tc_gl_lookup *tc_gl_textures_bounds(tc_gl_textures *textures, const tc_volume *volume, const tc_bounds *bounds,
                                          const tc_halt *halt, GError **error);

const tc_gl_lookup *tc_gl_textures_labels(tc_gl_textures *textures, const tc_volume *label_volume,
                                          const tc_labels *labels, const tc_halt *halt, GError **error);

/* A lookup in another layout, for shaders that read its buffer. */
typedef struct tc_gl_packing {
  const char *what; /* name, for errors */
  size_t (*bytes)(const void *thing); /* a multiple of 16 */
  bool (*pack)(const void *thing, void *bytes, const tc_halt *halt); /* false: halted */
  const void *thing;
} tc_gl_packing;
const tc_gl_lookup *tc_gl_textures_packed(tc_gl_textures *textures, const tc_gl_packing *packing, uint64_t serial,
                                          uint64_t volume_serial, const tc_halt *halt, GError **error);

void tc_gl_textures_forget(tc_gl_textures *textures, uint64_t volume_serial);
void tc_gl_textures_clear(tc_gl_textures *textures);

#endif
