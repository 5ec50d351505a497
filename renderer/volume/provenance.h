/* Provenance of a volume: which volume of its file or series it is, and what was resampled, bridged or left out. */
#ifndef TC_RENDERER_VOLUME_PROVENANCE_H
#define TC_RENDERER_VOLUME_PROVENANCE_H

#include "renderer/volume/volume.h"

typedef struct tc_provenance {
  int volume; /* number, from 1, of desc.frames; 0 means the first */
  int slices_used, slices_found; /* of a series of slices: distinct positions in this volume, and in the series; else 0 */
  int bridged;    /* number, from 1, of the slice interpolated for a missing one; 0: none */
  bool resampled; /* slices at uneven distances were interpolated linearly along the stack */
} tc_provenance;

/* Set by importers before sealing; else all 0. */
void tc_volume_set_provenance(tc_volume *volume, const tc_provenance *provenance);
const tc_provenance *tc_volume_provenance(const tc_volume *volume);

#endif
