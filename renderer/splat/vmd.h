/* The run-length voxel model: the filled voxels of a segmented object, as runs along z, with records of attributes
 * (paper 004, section 3). renderer/splat/VMD.md describes the file format.
 *
 * A column is all voxels of one (x, y). Its bytes are runs: the count of filled voxels, the count of free voxels before
 * them, and the records, which are one for each voxel, a single one if all are equal, or none if all equal the record
 * before the run. An empty run ends the column; empty columns are not stored. A bit for each column and the offsets of the
 * stored ones give access to any column in O(1) and to any voxel in O(runs of its column). Immutable once made: any thread
 * may read it. */
#ifndef TC_SPLAT_VMD_H
#define TC_SPLAT_VMD_H

#include "renderer/base/pool.h"
#include "renderer/volume/volume.h"

#define TC_VMD_VERSION 2    /* version 1 is read too; a model keeps the version that it was read with */
#define TC_VMD_FLAGS_AT 6   /* offset of the u16 flags in a file; 0 means not compressed */
#define TC_VMD_ATTRIBUTES 8 /* most attributes of a model */
#define TC_VMD_SIDE 32768   /* most voxels of a grid along an axis; the grid itself may be larger than any memory */
#define TC_VMD_PALETTE 256

/* How an attribute is stored: the volume's voxel types, and a unit vector in LPS in two bytes (splat/normal.h). */
typedef enum tc_vmd_type {
  TC_VMD_U8 = TC_U8,
  TC_VMD_I8 = TC_I8,
  TC_VMD_U16 = TC_U16,
  TC_VMD_I16 = TC_I16,
  TC_VMD_F32 = TC_F32,
  TC_VMD_NORMAL,
  TC_VMD_TYPE_COUNT
} tc_vmd_type;

typedef struct tc_vmd_attribute {
  char name[16]; /* "value", "label", "normal", "user" or any other; [a-z0-9_-], unique in the model */
  tc_vmd_type type;
  int at; /* byte offset in a record */
} tc_vmd_attribute;

typedef struct tc_vmd_head {
  tc_volume_desc grid; /* geometry, and slope and intercept of the attribute "value"; the voxel type is unused */
  int n_attributes;
  tc_vmd_attribute attributes[TC_VMD_ATTRIBUTES];
  int record_bytes;
  int n_palette;                      /* colours indexed by attribute "label"; 0: none */
  uint8_t palette[TC_VMD_PALETTE][4]; /* sRGB and opacity */
} tc_vmd_head;

typedef struct tc_vmd {
  tc_vmd_head head;
  int first[2], size[2]; /* bounding rectangle of the stored columns, x and y */
  int version;           /* encoding of the columns' bytes */
  uint64_t voxels, runs;
  uint64_t *there;   /* [(size x * size y + 63) / 64] a bit for each column of the rectangle, x fastest */
  uint32_t *rank;    /* [as there] number of stored columns before each word */
  uint32_t *offsets; /* offset into bytes of every TC_VMD_GROUP-th column; if `beyond` is NULL, [columns + 1] of every column */
  uint16_t *beyond;  /* [columns + 1] each column's offset from its group's; NULL if 16 bits do not suffice */
  uint32_t columns;
  uint8_t *bytes;
  size_t total_bytes; /* of all arrays */
  double range[TC_VMD_ATTRIBUTES][2]; /* least and greatest finite number of each attribute; set by tc_vmd_volume() */
} tc_vmd;

void tc_vmd_free(tc_vmd *vmd); /* NULL is fine */

#define TC_VMD_GROUP 16

/* Offset of a stored column's bytes, by the column's rank; for rank `columns` the end of all bytes. */
static inline uint32_t tc_vmd_start(const tc_vmd *vmd, uint32_t column) {
  return vmd->beyond ? vmd->offsets[column / TC_VMD_GROUP] + vmd->beyond[column] : vmd->offsets[column];
}

/* Iterates over the runs of a column: start with { .at = tc_vmd_column() }, call tc_vmd_next() until it returns false. Runs
 * may be adjacent. */
typedef struct tc_vmd_run {
  const uint8_t *at;
  int z, count;           /* voxels z .. z + count - 1 */
  const uint8_t *records; /* record of voxel i at i * step */
  size_t step;            /* bytes of a record; 0: all voxels share one record */
  int stored;             /* records stored with the run: count, 1, or 0 if `records` is the record before the run */
} tc_vmd_run;

/* Kind of a run, in the two low bits of its count. */
enum { TC_VMD_EACH, TC_VMD_SAME, TC_VMD_AS_BEFORE, TC_VMD_KINDS };

/* NULL: the column is empty or outside the grid. */
const uint8_t *tc_vmd_column(const tc_vmd *vmd, int x, int y);
bool tc_vmd_next(const tc_vmd *vmd, tc_vmd_run *run);

/* Record of a voxel (not NULL even if records have no bytes); NULL: the voxel is free. */
const uint8_t *tc_vmd_voxel(const tc_vmd *vmd, int x, int y, int z);
const tc_vmd_attribute *tc_vmd_attribute_named(const tc_vmd_head *head, const char *name); /* NULL: none */
const tc_vmd_attribute *tc_vmd_value_attribute(const tc_vmd_head *head); /* "value", else "label"; NULL: all are 1 */
/* An attribute's stored number in a record (for a normal its 16 bits). */
double tc_vmd_number(const tc_vmd_attribute *attribute, const uint8_t *record);
/* Stores a number that the type can hold, as one of its voxels. */
void tc_vmd_store(tc_voxel_type type, double number, uint8_t *to);
size_t tc_vmd_type_size(tc_vmd_type type);
/* Appends an attribute. TC_ERROR_LIMIT: too many attributes, or the name is invalid or already used. */
bool tc_vmd_head_add(tc_vmd_head *head, const char *name, tc_vmd_type type, GError **error);

/* ---- making one ---- */

/* Source of a model: callbacks for the filled voxels of a row and for the record of a voxel. Called from any thread of the
 * pool. */
typedef struct tc_vmd_source {
  tc_vmd_head head;
  bool shell; /* drops voxels with six filled neighbours */
  void *user;
  /* Sets the bits of row y: bit z % 64 of bits[z / 64][x], which are 0 before; [(nz + 63) / 64][nx]. */
  void (*fill)(void *user, int y, uint64_t *bits);
  void (*record)(void *user, int x, int y, int z, uint8_t *record); /* not called for records of no bytes */
} tc_vmd_source;

/* Builds a model, which does not depend on the number of threads and may be empty. TC_ERROR_LIMIT above 4 GiB or
 * TC_VMD_SIDE, TC_ERROR_MEMORY, TC_ERROR_CANCELLED or _PAUSED by the pool's halt. pool may be NULL. */
tc_vmd *tc_vmd_make(const tc_vmd_source *source, tc_pool *pool, GError **error);

/* The voxels of a model whose records are kept (called from any thread); without attributes. */
typedef struct tc_vmd_part {
  const tc_vmd *of;
  bool (*keeps)(const void *user, const uint8_t *record);
  const void *user;
} tc_vmd_part;
tc_vmd *tc_vmd_make_part(const tc_vmd_part *part, tc_pool *pool, GError **error); /* fails as tc_vmd_make() */

typedef struct tc_vmd_options {
  double low, high; /* voxels with values from low to high, both included, are filled; may be infinite */
  bool labels;      /* the volume is a label map: its voxels are attribute "label", not "value" */
  bool shell;
  const char *attributes;                        /* comma-separated subset of value,label,normal,user; NULL or "": none */
  /* Volumes of the attributes that the volume itself does not give, on any grids that overlap it: a voxel has the number
   * of the nearest voxel there. Outside of them: the least value; label and user 0. Borrowed. */
  const tc_volume *value_of; /* NULL: a label map has no attribute "value" */
  const tc_volume *label_of; /* label map; NULL: a volume of values has no attribute "label" */
  const tc_volume *user_of;  /* whole numbers from 0 to 255; NULL: attribute "user" is 0 */
  bool (*shows)(const void *user, double voxel); /* replaces the range: whether a stored voxel is filled; or NULL */
  const void *user;
} tc_vmd_options;

/* Builds the model of a volume. TC_ERROR_INVALID for attributes that are unknown or that no volume gives, for volumes of
 * attributes that do not overlap the volume or hold numbers that the attribute cannot, and for volumes without a grid. */
tc_vmd *tc_vmd_of_volume(const tc_volume *volume, const tc_vmd_options *options, tc_pool *pool, GError **error);

/* The object that a range of values makes of a volume. tc_vmd_normal_at() is a tc_splat_normals.of: the mean slope of the values at
 * the voxel's free faces, and the surface's distance. */
typedef struct tc_vmd_object tc_vmd_object;
tc_vmd_object *tc_vmd_object_new(const tc_volume *volume, double low, double high); /* NULL: no memory */
void tc_vmd_object_free(tc_vmd_object *object);
double tc_vmd_normal_at(const void *object, int x, int y, int z, double normal[3]);
/* A tc_splat_normals.end. */
double tc_vmd_end_at(const void *object, const int at[3], const double direction[3], double most);

/* ---- files ---- */

/* Contents of a .vmd file; the caller owns them. TC_ERROR_LIMIT for more than 2 GiB, TC_ERROR_MEMORY. */
GByteArray *tc_vmd_encode(const tc_vmd *vmd, bool compressed, GError **error);
/* TC_ERROR_FORMAT names the fault and its place. For any input, memory stays within a few times its size (or its inflated
 * size). */
tc_vmd *tc_vmd_decode(const uint8_t *bytes, size_t size, GError **error);

/* Wraps the model as a volume without a grid, whose values are the attribute "value", else "label", else 1. Takes ownership
 * of the model on success. TC_ERROR_FORMAT for values that are not finite. tc_volume_model() returns the tc_vmd. */
tc_volume *tc_vmd_volume(tc_vmd *vmd, GError **error);
/* The reverse: a volume with a grid and the model's values. Free voxels are 0 or, if 0 is not below all values, 1 less than the least,
 * if the voxel type can hold that. TC_ERROR_LIMIT, TC_ERROR_MEMORY. */
tc_volume *tc_vmd_grid(const tc_volume *volume, GError **error);
void tc_vmd_normal(const tc_vmd_attribute *attribute, const uint8_t *record, double normal[3]);
/* A tc_splat_normals.of: the model's own attribute "normal"; zero where there is none. The distance is unknown. */
double tc_vmd_own_normal(const void *vmd, int x, int y, int z, double normal[3]);

/* Columns of a model under construction, over a rectangle of the grid. */
typedef struct tc_vmd_columns {
  int first[2], size[2];
  uint32_t *lengths; /* [size y][size x] bytes; 0: no column */
  uint8_t *bytes;    /* of all columns, in order; g_malloc */
} tc_vmd_columns;

/* Used by decoding and building: copies the lengths, takes ownership of the bytes on success. */
tc_vmd *tc_vmd_new(int version, const tc_vmd_head *head, const tc_vmd_columns *columns, GError **error);

/* Reads a varint: up to five bytes of seven bits, least significant first; the eighth bit is set in all but the last. */
static inline uint32_t tc_vmd_varint(const uint8_t **at) {
  uint32_t value = *(*at)++;
  if (value < 128) return value;
  value &= 127;
  for (int shift = 7;; shift += 7) {
    uint32_t byte = *(*at)++;
    value |= (byte & 127) << shift;
    if (byte < 128) return value;
  }
}
void tc_vmd_put_varint(GByteArray *to, uint32_t value);

#endif
