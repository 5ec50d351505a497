/* Copies of volumes, pre-integration tables and distance maps on the GPU, least recently used out first. Needs a
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
  uint64_t key[5]; /* serials of table or support, and of the volume (0 for a table: it serves any); block width; serial of
                      bounds, or a distance map's reach; serial of labels, or of integrals, which serve any volume */
  unsigned buffer, texture;
  void *memory; /* mapped, of `bytes`, that the buffer is in; NULL: it is in the driver's */
  size_t bytes;
  uint64_t used;
} tc_gl_lookup;

#define TC_GL_VOLUMES 8
#define TC_GL_LOOKUPS 16

typedef struct tc_gl_textures {
  tc_gl_volume volumes[TC_GL_VOLUMES];
  tc_gl_lookup lookups[TC_GL_LOOKUPS];
  size_t volume_budget, lookup_budget; /* bytes; copies used by the current frame may exceed them */
  uint64_t frame;                      /* number of the current frame, whose copies stay */
  bool pins;                           /* the driver takes memory of ours for a large lookup's buffer */
} tc_gl_textures;

/* A frame begins, asks for its volume and label volume, then for its lookups; all live until the next frame begins,
 * owned by *textures. Missing ones are uploaded; if the halt (NULL: none) interrupts a lookup's upload, nothing of
 * it is kept. TC_ERROR_LIMIT: no texture of this device is large enough; the message says how to mend it. */
void tc_gl_textures_begin(tc_gl_textures *textures);
/* True if the volume is not resident and fits a texture of this device. */
bool tc_gl_textures_want(const tc_gl_textures *textures, const tc_volume *volume);
const tc_gl_volume *tc_gl_textures_volume(tc_gl_textures *textures, const tc_volume *volume, GError **error);
/* Built by the builder if it serves, adding the time to *ms; else the table has entries, which are uploaded. */
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

/* What is kept as bytes of a layout of its own, for shaders that read its buffer. */
typedef struct tc_gl_packing {
  const char *what;
  size_t (*bytes)(const void *thing); /* a multiple of 16 */
  bool (*pack)(const void *thing, void *bytes, const tc_halt *halt); /* false: halted */
  const void *thing;
} tc_gl_packing;
const tc_gl_lookup *tc_gl_textures_packed(tc_gl_textures *textures, const tc_gl_packing *packing, uint64_t serial,
                                          uint64_t volume_serial, const tc_halt *halt, GError **error);

void tc_gl_textures_forget(tc_gl_textures *textures, uint64_t volume_serial);
void tc_gl_textures_clear(tc_gl_textures *textures);

#endif
