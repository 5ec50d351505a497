/* What a volume is of its file or series: which one of how many, and what was done or left out to make it. */
#ifndef TC_RENDERER_VOLUME_PROVENANCE_H
#define TC_RENDERER_VOLUME_PROVENANCE_H

#include "renderer/volume/volume.h"

typedef struct tc_provenance {
  int volume; /* number, from 1, of desc.frames; 0 means the first */
  int slices_used, slices_found; /* of a series of pictures: different positions in this volume, and in all; else 0 */
  int bridged;    /* the layer, from 1, that stands for a missing slice; 0 none */
  bool resampled; /* slices lay at varying distances: layers are interpolated linearly along the stack */
} tc_provenance;

/* Set before sealing, by importers; all 0 otherwise. */
void tc_volume_set_provenance(tc_volume *volume, const tc_provenance *provenance);
const tc_provenance *tc_volume_provenance(const tc_volume *volume);

#endif
