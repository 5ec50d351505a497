/* Metadata of a volume: its origin, the segments of a segmentation, and colours. */
#ifndef TC_RENDERER_VOLUME_PROVENANCE_H
#define TC_RENDERER_VOLUME_PROVENANCE_H

#include "renderer/volume/volume.h"

typedef struct tc_provenance {
  int volume; /* which of desc.frames volumes this is, from 1; 0 means the first */
  int slices_used, slices_found; /* of a series of slices: distinct positions in this volume, and in the series; else 0 */
  int bridged;    /* number, from 1, of the slice that was missing and was interpolated; 0: none */
  bool resampled; /* slices at uneven distances were interpolated linearly along the stack */
  bool colors; /* voxels are the luma of RGB, which slices show (tc_volume_colors) */
  char description[64]; /* series description as the file has it: UTF-8, or "" */
  char time[16];        /* time of day when the series began, "14:03:22", or "" */
} tc_provenance;

/* Set by importers before sealing; else all 0. */
void tc_volume_set_provenance(tc_volume *volume, const tc_provenance *provenance);
const tc_provenance *tc_volume_provenance(const tc_volume *volume);

/* A label of a segmentation. Where two segments overlap, voxels have a combined label: it stands for two labels with
 * smaller numbers, each of which may itself be combined. */
typedef struct tc_segment {
  uint32_t label;
  uint32_t of[2];  /* the two labels of a combined label; else 0 */
  bool has_color;
  float color[3];  /* sRGB 0..1 */
  char name[64];   /* UTF-8, or "" */
} tc_segment;

enum { TC_SEGMENTS_MAX = 65535 };

/* Set by importers before sealing; copied, and sorted by label. */
void tc_volume_set_segments(tc_volume *volume, const tc_segment *segments, size_t count);
const tc_segment *tc_volume_segments(const tc_volume *volume, size_t *count); /* [*count], ascending */
const tc_segment *tc_volume_segment(const tc_volume *volume, uint32_t label);  /* NULL: no such segment */

/* The colours of an RGB volume: a label volume on the same grid, whose segments hold the colours. NULL: a grey volume.
 * The setter takes ownership; the result lives as long as the volume. */
void tc_volume_set_colors(tc_volume *volume, tc_volume *colors);
tc_volume *tc_volume_colors(const tc_volume *volume);

#endif
