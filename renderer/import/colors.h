/* Import of RGB volumes: voxels become their luma, and a palette volume keeps the colours (tc_volume_colors). */
#ifndef TC_IMPORT_COLORS_H
#define TC_IMPORT_COLORS_H

#include "renderer/volume/provenance.h"

typedef struct tc_colors tc_colors;

/* volume: u8, not sealed, outlives the result. TC_ERROR_MEMORY. */
tc_colors *tc_colors_new(tc_volume *volume, GError **error);
void tc_colors_free(tc_colors *colors); /* NULL is fine */

/* Adds the next bytes, r, g, b of each voxel. Returns false if there are more bytes than voxels. */
bool tc_colors_put(tc_colors *colors, const uint8_t *bytes, size_t size);

/* Attaches the colours to the volume. Returns false if bytes are missing. */
bool tc_colors_end(tc_colors *colors);

#endif
