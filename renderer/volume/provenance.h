/* What is known of a volume beside its voxels: where it comes from, and what its labels are. */
#ifndef TC_RENDERER_VOLUME_PROVENANCE_H
#define TC_RENDERER_VOLUME_PROVENANCE_H

#include "renderer/volume/volume.h"

typedef struct tc_provenance {
  int volume; /* number, from 1, of desc.frames; 0 means the first */
  int slices_used, slices_found; /* of a series of slices: distinct positions in this volume, and in the series; else 0 */
  int bridged;    /* number, from 1, of the slice interpolated for a missing one; 0: none */
  bool resampled; /* slices at uneven distances were interpolated linearly along the stack */
  bool colors; /* voxels are the luma of RGB, which slices show (tc_volume_colors) */
  char description[64]; /* of the series, as its makers wrote it: UTF-8, or "" */
  char time[16];        /* of day when the series began, "14:03:22", or "" */
} tc_provenance;

/* Set by importers before sealing; else all 0. */
void tc_volume_set_provenance(tc_volume *volume, const tc_provenance *provenance);
const tc_provenance *tc_volume_provenance(const tc_volume *volume);

/* What a label of a segmentation is. A combination stands where two overlap: it is of both, each of which has a smaller
 * number and may be a combination itself. */
typedef struct tc_segment {
  uint32_t label;
  uint32_t of[2];  /* of a combination; else 0 */
  bool has_color;
  float color[3];  /* sRGB 0..1 */
  char name[64];   /* UTF-8, or "" */
} tc_segment;

enum { TC_SEGMENTS_MAX = 65535 };

/* Set by importers before sealing; copied, and sorted by label. */
void tc_volume_set_segments(tc_volume *volume, const tc_segment *segments, size_t count);
const tc_segment *tc_volume_segments(const tc_volume *volume, size_t *count); /* [*count], ascending */
const tc_segment *tc_volume_segment(const tc_volume *volume, uint32_t label);  /* NULL: nothing is known of it */

/* The colours of a volume of RGB: labels on the same grid, whose segments have them. NULL: it is grey. They live as long as
 * the volume, which takes them over. */
void tc_volume_set_colors(tc_volume *volume, tc_volume *colors);
tc_volume *tc_volume_colors(const tc_volume *volume);

#endif
