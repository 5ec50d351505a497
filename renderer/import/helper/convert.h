/* Converts a file's voxels to a volume: the storage rule of import.h, in one place for every format. A parser
 * describes the file's voxels as a tc_raster; tc_raster_load() checks that the file can hold them, chooses the
 * storage type and converts in chunks, so memory does not grow with the volume. */
#ifndef TC_IMPORT_CONVERT_H
#define TC_IMPORT_CONVERT_H

#include "renderer/import/helper/overlaps.h"
#include "renderer/import/helper/source.h"

/* How the components of a voxel become one value. */
typedef enum tc_combine {
  TC_COMBINE_FIRST,     /* the first component (the first frame where frames vary fastest) */
  TC_COMBINE_LUMA,      /* Rec. 709 luma of the first three: u8 from u8 and u16, else f32 */
  TC_COMBINE_MAGNITUDE, /* root of the sum of squares, f32 */
  TC_COMBINE_LAYERS,    /* each component is a layer of segments (tc_layered); combinations of segments are kept exactly */
  TC_COMBINE_COUNT
} tc_combine;

/* A segment of a raster of labels. In a file of several layers, the number counts within the segment's layer. */
typedef struct tc_layered {
  tc_segment segment; /* loading sets its label */
  int64_t number;     /* value in the file */
  uint32_t layer, value;
} tc_layered;

typedef struct tc_raster {
  tc_volume_desc desc; /* all members but type, which loading chooses; loading may append to the note */
  tc_data data;        /* part_bytes and element are set by tc_raster_load() */
  tc_element element;
  bool big_endian;     /* the file's byte order; ignored for text */
  tc_combine combine;
  uint32_t components; /* per voxel, >= 1 */
  uint64_t inner;      /* voxels before the component changes: 1 = interleaved, all voxels of a frame = planar; a divisor of
                          the voxels of a frame */
  GArray *segments;    /* tc_layered, or NULL; not owned */
  uint64_t frames;     /* whole frames one after another in the data, >= 1; order->volume chooses one */
} tc_raster;

/* A raster of one frame and component, spacing 1, identity orientation, slope 1. */
void tc_raster_init(tc_raster *raster, const char *format, const tc_input *input);
void tc_raster_clear(tc_raster *raster);

/* Adds a clause to desc.note, with "; " between clauses; cut at the note's end. */
void tc_raster_note(tc_raster *raster, const char *format, ...) G_GNUC_PRINTF(2, 3);

/* Reads the voxels and sends them as the order asks. */
bool tc_raster_load(tc_raster *raster, const tc_order *order, GError **error);

/* For readers that decode their own voxels: begins the order with desc as it is. Fails if the volume exceeds the
 * order's limit or `most`, the number of voxels that the file can hold. */
bool tc_raster_begin(tc_raster *raster, uint64_t most, const tc_provenance *from, const tc_order *order, GError **error);

/* Sets spacing and direction from three column vectors in LPS mm (column k = one step along index axis k). A column
 * of zero length on an axis with one voxel is replaced by one orthogonal to the others. False if the columns are
 * linearly dependent. */
bool tc_raster_set_axes(tc_raster *raster, const double columns[3][3]);

#endif
