/* RGB on its way into a volume: voxels become their luma, and the colours stay beside them (tc_volume_colors). */
#ifndef TC_IMPORT_COLORS_H
#define TC_IMPORT_COLORS_H

#include "renderer/volume/provenance.h"

typedef struct tc_colors tc_colors;

/* Of a u8 volume that is not sealed and outlives this. TC_ERROR_MEMORY. */
tc_colors *tc_colors_new(tc_volume *volume, GError **error);
void tc_colors_free(tc_colors *colors); /* NULL is fine */

/* The next bytes, r, g, b of a voxel each. False: more than the volume has. */
bool tc_colors_put(tc_colors *colors, const uint8_t *bytes, size_t size);

/* Gives the colours to the volume; false: bytes are missing. */
bool tc_colors_end(tc_colors *colors);

#endif
