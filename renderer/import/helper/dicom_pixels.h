/* Decoded DICOM samples to voxels of one storage type. Plain C, no DICOM library: bytes in, voxels out. */
#ifndef TC_IMPORT_DICOM_PIXELS_H
#define TC_IMPORT_DICOM_PIXELS_H

#include "renderer/import/helper/overlaps.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum tc_dicom_colour {
  TC_DICOM_GREY,
  TC_DICOM_RGB,  /* becomes Rec. 709 luma, 0..255 */
  TC_DICOM_YBR,  /* Y Cb Cr of full range: the same of the RGB that they stand for */
  TC_DICOM_COLOUR_COUNT
} tc_dicom_colour;

/* How the samples of one frame lie in memory; little-endian. */
typedef struct tc_dicom_samples {
  int rows, columns;
  int allocated;    /* 1, 8, 16, 32 or 64 bits a sample; 1: packed, least significant bit first */
  int stored, high; /* bits in use, and the number of the highest of them; bits above and below are not pixels */
  bool is_signed, is_float;
  int per_pixel; /* 1, 3 or 4 */
  bool planar;   /* all of one colour, then the next */
  bool halved;   /* YBR_FULL_422: Y Y Cb Cr for two pixels; 8 bits and TC_DICOM_YBR only */
  tc_dicom_colour colour;
} tc_dicom_samples;

/* One frame: `size` bytes, which begin at bit first_bit (0 unless allocated is 1). Borrowed. */
typedef struct tc_dicom_frame {
  tc_dicom_samples samples;
  const uint8_t *bytes;
  size_t size;
  unsigned first_bit;
} tc_dicom_frame;

/* What becomes of its samples. */
typedef struct tc_dicom_target {
  tc_voxel_type type;
  bool rescale; /* value = slope * sample + intercept, for TC_F32 only */
  double slope, intercept;
} tc_dicom_target;

/* False for combinations that are not built (packed 12-bit and the like). */
bool tc_dicom_samples_valid(const tc_dicom_samples *samples);

/* Bytes of one frame; a 1-bit frame may start within a byte, this is then the count rounded up. 0 on overflow. */
uint64_t tc_dicom_frame_bytes(const tc_dicom_samples *samples);

/* Run lengths (PS3.5, annex G): whether a frame has as many segments as its samples have bytes, and its samples as they are
 * without packing, pixel by pixel [tc_dicom_frame_bytes()]. False when they are damaged or cut. */
bool tc_dicom_run_lengths_fit(const tc_dicom_samples *samples, const uint8_t *bytes, size_t size);
bool tc_dicom_unpack(const tc_dicom_samples *samples, const uint8_t *bytes, size_t size, uint8_t *out);

/* The storage type that holds every sample as it is; wide integers give TC_F32 (see tc_dicom_range to narrow). */
tc_voxel_type tc_dicom_natural_type(const tc_dicom_samples *samples);

/* Converts one frame to voxels [rows][columns] of target->type. False when the bytes are too few. */
bool tc_dicom_convert(const tc_dicom_frame *frame, const tc_dicom_target *target, void *voxels);

/* What samples stand for: table [count], count >= 1, from sample `first` on; those before and after it have its ends.
 * False for other than grey integers of 8 or 16 bits, or when the bytes are too few. */
bool tc_dicom_look_up(const tc_dicom_frame *frame, const uint16_t *table, size_t count, int32_t first, uint16_t *values);

/* Colours of at most 16 bits a sample as r, g, b [rows][columns][3]; grey ones as grey. False when the bytes are too few. */
bool tc_dicom_colors(const tc_dicom_frame *frame, uint8_t *rgb);

/* The same of a frame of a segment (1..overlaps->last): pixels whose samples are at or above `threshold` join it, others
 * leave the labels [rows][columns] alone. */
bool tc_dicom_stamp(const tc_dicom_frame *frame, double threshold, uint32_t segment, tc_overlaps *overlaps,
                    uint16_t *labels);

/* Widens [*lo, *hi] by the samples of one grey frame. False when the bytes are too few. */
bool tc_dicom_range(const tc_dicom_frame *frame, double *lo, double *hi);

/* out = (1 - part) * below + part * above, voxel by voxel [count]; integers are rounded to the nearest. */
void tc_dicom_mix_layers(tc_voxel_type type, const void *below, const void *above, double part, size_t count, void *out);

#ifdef __cplusplus
}
#endif
#endif
