/* Converts decoded DICOM samples to voxels of one storage type. Plain C without a DICOM library. */
#ifndef TC_IMPORT_DICOM_PIXELS_H
#define TC_IMPORT_DICOM_PIXELS_H

#include "renderer/import/helper/overlaps.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum tc_dicom_colour {
  TC_DICOM_GREY,
  TC_DICOM_RGB,  /* becomes Rec. 709 luma, 0..255 */
  TC_DICOM_YBR,  /* full-range Y Cb Cr: converted to RGB, then to luma */
  TC_DICOM_COLOUR_COUNT
} tc_dicom_colour;

/* Memory layout of the samples of one frame; little-endian. */
typedef struct tc_dicom_samples {
  int rows, columns;
  int allocated;    /* 1, 8, 16, 32 or 64 bits a sample; 1: packed, least significant bit first */
  int stored, high; /* number of used bits, and the highest used bit; other bits are not pixel data */
  bool is_signed, is_float;
  int per_pixel; /* 1, 3 or 4 */
  bool planar;   /* all samples of one colour, then the next */
  bool halved;   /* YBR_FULL_422: Y Y Cb Cr for two pixels; 8 bits and TC_DICOM_YBR only */
  tc_dicom_colour colour;
} tc_dicom_samples;

/* One frame: `size` bytes; the frame starts at bit first_bit (0 unless allocated is 1). Borrowed. */
typedef struct tc_dicom_frame {
  tc_dicom_samples samples;
  const uint8_t *bytes;
  size_t size;
  unsigned first_bit;
} tc_dicom_frame;

/* The voxels that samples are converted to. */
typedef struct tc_dicom_target {
  tc_voxel_type type;
  bool rescale; /* value = slope * sample + intercept, for TC_F32 only */
  double slope, intercept;
} tc_dicom_target;

/* False for unsupported combinations (packed 12-bit and the like). */
bool tc_dicom_samples_valid(const tc_dicom_samples *samples);

/* Bytes of one frame; a 1-bit frame may start within a byte, the count is then rounded up. 0 on overflow. */
uint64_t tc_dicom_frame_bytes(const tc_dicom_samples *samples);

/* Run-length encoding (PS3.5, annex G): whether a frame has as many segments as its samples have bytes. */
bool tc_dicom_run_lengths_fit(const tc_dicom_samples *samples, const uint8_t *bytes, size_t size);
/* Decodes run lengths to samples, pixel by pixel, out [tc_dicom_frame_bytes()]. False if the data is damaged or cut. */
bool tc_dicom_unpack(const tc_dicom_samples *samples, const uint8_t *bytes, size_t size, uint8_t *out);

/* The storage type that holds every sample exactly; wide integers give TC_F32 (see tc_dicom_range to narrow). */
tc_voxel_type tc_dicom_natural_type(const tc_dicom_samples *samples);

/* Converts one frame to voxels [rows][columns] of target->type. False if there are too few bytes. */
bool tc_dicom_convert(const tc_dicom_frame *frame, const tc_dicom_target *target, void *voxels);

/* Applies a look-up table [count], count >= 1, whose first entry is for sample `first`; samples outside get the
 * table's ends. False unless the samples are grey integers of 8 or 16 bits, or if there are too few bytes. */
bool tc_dicom_look_up(const tc_dicom_frame *frame, const uint16_t *table, size_t count, int32_t first, uint16_t *values);

/* Converts samples of at most 16 bits to r, g, b [rows][columns][3]; grey samples to grey. False if there are too few
 * bytes. */
bool tc_dicom_colors(const tc_dicom_frame *frame, uint8_t *rgb);

/* Adds a frame of a segment (1..overlaps->last) to the labels [rows][columns]: pixels with samples at or above
 * `threshold` join the segment, the others stay. False if there are too few bytes. */
bool tc_dicom_stamp(const tc_dicom_frame *frame, double threshold, uint32_t segment, tc_overlaps *overlaps,
                    uint16_t *labels);

/* Widens [*lo, *hi] by the samples of one grey frame. False if there are too few bytes. */
bool tc_dicom_range(const tc_dicom_frame *frame, double *lo, double *hi);

/* out = (1 - part) * below + part * above for each of [count] voxels; integers are rounded to nearest. */
void tc_dicom_mix_layers(tc_voxel_type type, const void *below, const void *above, double part, size_t count, void *out);

#ifdef __cplusplus
}
#endif
#endif
