/* A volume: a regular grid of scalar voxels in their own type, with its position in patient space.
 *
 * tc_volume_new() allocates, an importer fills tc_volume_voxels(), tc_volume_seal() checks the volume and makes it
 * immutable; from then on any thread may read it. Shared by an atomic reference count. */
#ifndef TC_RENDERER_VOLUME_H
#define TC_RENDERER_VOLUME_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/base/error.h"

/* Voxel storage types. Wider file types become one of these by the rule in import/import.h. */
typedef enum tc_voxel_type { TC_U8, TC_I8, TC_U16, TC_I16, TC_F32, TC_VOXEL_TYPE_COUNT } tc_voxel_type;

const char *tc_voxel_type_name(tc_voxel_type type); /* "u8" "i8" "u16" "i16" "f32" */
size_t tc_voxel_size(tc_voxel_type type);           /* bytes: 1 1 2 2 4 */

typedef struct tc_volume_desc {
  int dims[3];           /* voxels along index axes x, y, z (x fastest); each >= 1 */
  tc_voxel_type type;
  double spacing[3];     /* mm between voxel centres along each index axis, > 0 */
  double origin[3];      /* LPS mm of the centre of voxel (0,0,0) */
  double direction[9];   /* 3x3 row by row; column k = unit vector of index axis k in LPS. Columns are
                            independent but need not be orthogonal (a gantry tilt shears them). */
  double slope, intercept; /* value = slope * voxel + intercept; tc_scale_is_usable() */
  int frames;            /* number of volumes in the file or series, normally 1; see provenance.h */
  char modality[16];     /* "CT", "MR", "PT", ... or "" */
  char format[16];       /* "nifti" "nrrd" "metaimage" "dicom" "demo" */
  char unit[16];         /* "HU", "" ... */
  char note[256];        /* conversions by the importer, one sentence, or "" */
  double window_center, window_width; /* the file's own window; width 0 = none */
} tc_volume_desc;

/* With a usable scale, no voxel value overflows or underflows in double precision. */
#define TC_MOST_SCALE 1e100

static inline bool tc_scale_is_usable(double slope, double intercept) {
  return fabs(slope) <= TC_MOST_SCALE && fabs(slope) >= 1 / TC_MOST_SCALE && fabs(intercept) <= TC_MOST_SCALE;
}

/* Computed by tc_volume_seal(). Values are in the volume's unit (slope and intercept applied). */
typedef struct tc_volume_stats {
  double min, max;            /* of the values; min <= max */
  double voxel_min, voxel_max; /* of the stored voxels */
  uint64_t non_finite;        /* NaN and infinities that sealing replaced (see tc_volume_seal) */
} tc_volume_stats;

typedef struct tc_volume tc_volume;

/* Allocates zeroed storage of dims voxels with readable padding behind them (kernels fetch pairs). Checks dims, their
 * product (at most 2^31-1 voxels), spacing, direction (invertible) and slope; TC_ERROR_INVALID, _LIMIT or _MEMORY. */
tc_volume *tc_volume_new(const tc_volume_desc *desc, GError **error);

/* [dims z][dims y][dims x] of desc.type, x fastest, contiguous. Writable before tc_volume_seal() only. NULL for a
 * volume without a grid. */
void *tc_volume_voxels(tc_volume *volume);
const void *tc_volume_data(const tc_volume *volume);

/* Completes the volume: finds the range, and replaces and counts the non-finite voxels of an f32 volume. Infinities
 * become the extremes. NaN is a gap (tc_volume_gaps): tc_volume_value_at() and the histogram exclude it. For
 * interpolation a gap gets the mean of its finite neighbours; without any, 0 in signed maps other than HU, else the
 * smallest value. If no voxel is finite, all become 0. An f32 volume whose largest magnitude is above 1e30 or below
 * 1e-30 is scaled by a power of two, which the slope undoes. */
void tc_volume_seal(tc_volume *volume);
/* tc_volume_seal(), interruptible: returns false, and leaves the volume unsealed, when goes_on() returns false. */
bool tc_volume_seal_while(tc_volume *volume, bool (*goes_on)(void *user), void *user);

/* Registers a callback for the end of the volume: called after its memory is freed, on the thread that dropped the last
 * reference. At most one per volume. */
void tc_volume_when_freed(tc_volume *volume, void (*freed)(void *user), void *user);

/* tc_volume_seal() for voxels that are all finite and whose range is known. */
void tc_volume_seal_within(tc_volume *volume, double voxel_min, double voxel_max);

/* The gaps of an f32 volume (voxels that were NaN): u8 on the same grid, 1 in a gap, else 0. NULL: no gaps. Lives as
 * long as the volume; the caller may take a reference. */
tc_volume *tc_volume_gaps(const tc_volume *volume);

tc_volume *tc_volume_ref(tc_volume *volume);
void tc_volume_unref(tc_volume *volume); /* NULL is fine */

const tc_volume_desc *tc_volume_describe(const tc_volume *volume);
const tc_volume_stats *tc_volume_statistics(const tc_volume *volume);
size_t tc_volume_bytes(const tc_volume *volume); /* memory of the voxels */
uint64_t tc_volume_serial(const tc_volume *volume); /* unique in the process; keys caches */

/* A volume without a grid: a segmented object of which only the occupied voxels are stored, in a representation behind
 * these functions (splat/vmd.h). All other voxels are free and have no value. */
typedef struct tc_sparse {
  void *model;
  size_t bytes;                /* memory of the model */
  double voxel_min, voxel_max; /* of the stored voxels */
  bool (*voxel)(const void *model, const int at[3], double *voxel); /* false: free, or outside the grid */
  void (*each)(const void *model, void (*seen)(void *user, double voxel), void *user);
  void (*free)(void *model);
} tc_sparse;

/* A sealed volume without a grid; owns the model on success. Its tc_volume_data() is NULL. */
tc_volume *tc_volume_of_sparse(const tc_volume_desc *desc, const tc_sparse *sparse, GError **error);
const tc_sparse *tc_volume_sparse(const tc_volume *volume); /* NULL: the volume has a grid */
static inline const void *tc_volume_model(const tc_volume *volume) {
  const tc_sparse *sparse = tc_volume_sparse(volume);
  return sparse ? sparse->model : NULL;
}

/* The stored voxel; false: outside the grid, NaN, or free. */
bool tc_volume_voxel(const tc_volume *volume, const int at[3], double *voxel);
/* Has the memory of a voxel that will soon be asked for read into the cache; within the grid. */
void tc_volume_fetch(const tc_volume *volume, const int at[3]);

/* Index (voxel) coordinates <-> LPS mm. */
void tc_volume_index_to_lps(const tc_volume *volume, const double index[3], double lps[3]);
void tc_volume_lps_to_index(const tc_volume *volume, const double lps[3], double index[3]);
/* From LPS displacements to index displacements (no origin): [3][3] row by row. */
void tc_volume_lps_to_index_matrix(const tc_volume *volume, double matrix[9]);

/* The field's box in index space (NUMERICS section 0): [0, n-1], or [-0.5, 0.5] where n = 1. */
void tc_volume_index_box(const tc_volume *volume, double lo[3], double hi[3]);

/* Trilinear value (in the volume's unit, double precision) at an index position. False if the position is more than
 * 0.001 outside the box, or a voxel around it is NaN. Without a grid: the nearest voxel's value, false if that voxel is
 * free. */
bool tc_volume_value_at(const tc_volume *volume, const double index[3], double *value);

/* A generated demo: "head" "head-labels" (its segmentation) "vessels" "marschner-lobb" "bucky" (without "demo:").
 * TC_ERROR_NOT_FOUND names the known ones. */
tc_volume *tc_volume_demo(const char *name, GError **error);
uint64_t tc_volume_demo_bytes(const char *name); /* voxel bytes; 0: no such demo */

#endif
