/* The run-length voxel model: the filled voxels of a segmented object, as runs along z, with records of attributes
 * (paper 004, section 3). renderer/splat/VMD.md is the same on disk.
 *
 * A column is all voxels of one (x, y). Its bytes are pairs of filled voxels and the free ones before them, each run
 * followed by its voxels' records, by one where all are the same, or by none where that is the one before; the end is a
 * run of none; columns without voxels are not stored. Columns are found through a bit for each and the offsets of those
 * that are there, so that any column is reached in O(1) and any voxel in O(runs of its column). Immutable once made:
 * any thread may read it. */
#ifndef TC_SPLAT_VMD_H
#define TC_SPLAT_VMD_H

#include "renderer/base/pool.h"
#include "renderer/volume/volume.h"

#define TC_VMD_VERSION 2    /* version 1 is read, and written as it was read */
#define TC_VMD_FLAGS_AT 6   /* where a file has its u16 of flags; 0: nothing in it is packed */
#define TC_VMD_ATTRIBUTES 8 /* at most */
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
  char name[16]; /* "value" "label" "normal" "user", or another's own: [a-z0-9_-], no two alike */
  tc_vmd_type type;
  int at; /* bytes before it in a record */
} tc_vmd_attribute;

typedef struct tc_vmd_head {
  tc_volume_desc grid; /* place, and slope and intercept of the attribute "value"; its type says nothing */
  int n_attributes;
  tc_vmd_attribute attributes[TC_VMD_ATTRIBUTES];
  int record_bytes;
  int n_palette;                      /* colours that attribute "label" names; 0: none */
  uint8_t palette[TC_VMD_PALETTE][4]; /* sRGB and opacity */
} tc_vmd_head;

typedef struct tc_vmd {
  tc_vmd_head head;
  int first[2], size[2]; /* the rectangle of columns that holds all of them, x and y */
  int version;           /* of the columns' bytes */
  uint64_t voxels, runs;
  uint64_t *there;   /* [(size x * size y + 63) / 64] a bit for each column of the rectangle, x fastest */
  uint32_t *rank;    /* [the same] columns before the word's */
  uint32_t *offsets; /* into bytes: of every TC_VMD_GROUP-th column, or, without `beyond`, [columns + 1] of each */
  uint16_t *beyond;  /* [columns + 1] of each column, from its group's; NULL where that does not fit */
  uint32_t columns;
  uint8_t *bytes;
  size_t total_bytes; /* of all arrays */
} tc_vmd;

void tc_vmd_free(tc_vmd *vmd); /* NULL is fine */

#define TC_VMD_GROUP 16

/* Where the column's bytes begin, the columns counted in their order; of `columns`: where all end. */
static inline uint32_t tc_vmd_start(const tc_vmd *vmd, uint32_t column) {
  return vmd->beyond ? vmd->offsets[column / TC_VMD_GROUP] + vmd->beyond[column] : vmd->offsets[column];
}

/* A run on its way through a column: { .at = tc_vmd_column() }, then tc_vmd_next() until it is false. Runs may touch.
 */
typedef struct tc_vmd_run {
  const uint8_t *at;
  int z, count;           /* voxels z .. z + count - 1 */
  const uint8_t *records; /* voxel i's at i * step */
  size_t step;            /* bytes of a record; 0: all voxels have the one */
  int stored;             /* records that follow the run: count, 1, or 0 where `records` is the one before the run */
} tc_vmd_run;

/* In the two low bits of a run's count. */
enum { TC_VMD_EACH, TC_VMD_SAME, TC_VMD_AS_BEFORE, TC_VMD_KINDS };

/* NULL: no voxel there (or outside the grid). */
const uint8_t *tc_vmd_column(const tc_vmd *vmd, int x, int y);
bool tc_vmd_next(const tc_vmd *vmd, tc_vmd_run *run);

/* A voxel's record (not NULL, even of no bytes); NULL: the voxel is free. */
const uint8_t *tc_vmd_voxel(const tc_vmd *vmd, int x, int y, int z);
const tc_vmd_attribute *tc_vmd_attribute_named(const tc_vmd_head *head, const char *name); /* NULL: none */
const tc_vmd_attribute *tc_vmd_value_attribute(const tc_vmd_head *head); /* "value", else "label"; NULL: all are 1 */
/* A number of a record as it is stored (of a normal its 16 bits). */
double tc_vmd_number(const tc_vmd_attribute *attribute, const uint8_t *record);
size_t tc_vmd_type_size(tc_vmd_type type);
/* TC_ERROR_LIMIT: too many, or the name is taken or none. */
bool tc_vmd_head_add(tc_vmd_head *head, const char *name, tc_vmd_type type, GError **error);

/* ---- making one ---- */

/* Where a model comes from: which voxels are filled, row by row, and what their records say. Both are called from any
 * thread of the pool. */
typedef struct tc_vmd_source {
  tc_vmd_head head;
  bool shell; /* without voxels that have six filled neighbours */
  void *user;
  /* Sets the bits of row y: bit z % 64 of bits[z / 64][x], which are 0 before; [(nz + 63) / 64][nx]. */
  void (*fill)(void *user, int y, uint64_t *bits);
  void (*record)(void *user, int x, int y, int z, uint8_t *record); /* not called for records of no bytes */
} tc_vmd_source;

/* The same model from any number of threads; a model may have no voxel. TC_ERROR_LIMIT over 4 GiB, TC_ERROR_MEMORY, or
 * what the pool's halt says. pool may be NULL. */
tc_vmd *tc_vmd_make(const tc_vmd_source *source, tc_pool *pool, GError **error);

typedef struct tc_vmd_wish {
  double low, high; /* filled voxels: with values in this range, both included; may be infinite */
  bool labels;      /* the volume is a label map: attribute "label" instead of "value", and a palette */
  bool shell;
  const char *attributes;                        /* "value,label,normal,user" or some of it; NULL or "": none */
  bool (*shows)(const void *user, double voxel); /* instead of the range: whether stored voxels are filled; NULL */
  const void *user;
} tc_vmd_wish;

/* Of a volume. TC_ERROR_INVALID for attributes that are unknown or not there, and for any of a volume without a grid.
 */
tc_vmd *tc_vmd_of_volume(const tc_volume *volume, const tc_vmd_wish *wish, tc_pool *pool, GError **error);

/* Outward normals of a volume's object of these values, from how far inside its range voxels are: the mean slope where
 * the voxel's free faces are; and the surface's distance (a tc_splat_normals.of). */
typedef struct tc_vmd_subject tc_vmd_subject;
tc_vmd_subject *tc_vmd_subject_new(const tc_volume *volume, double low, double high); /* NULL: no memory */
void tc_vmd_subject_free(tc_vmd_subject *subject);
double tc_vmd_normal_at(const void *subject, int x, int y, int z, double normal[3]);

/* ---- files ---- */

bool tc_vmd_write(const tc_vmd *vmd, const char *path, bool compressed, GError **error);
GByteArray *tc_vmd_encode(const tc_vmd *vmd, bool compressed, GError **error);
/* TC_ERROR_FORMAT says what is wrong where; whatever the bytes are, memory stays within a few times theirs (raw) or
 * what they inflate to. */
tc_vmd *tc_vmd_decode(const uint8_t *bytes, size_t size, GError **error);

/* The model as a volume without a grid, of the attribute "value", or "label", or of one value, 1. Takes the model on
 * success. TC_ERROR_FORMAT for values that are not finite. tc_volume_model() of such a volume is the tc_vmd. */
tc_volume *tc_vmd_volume(tc_vmd *vmd, GError **error);
void tc_vmd_normal(const tc_vmd_attribute *attribute, const uint8_t *record, double normal[3]);
/* A tc_splat_normals.of: the model's own attribute "normal"; zero where there is none. The distance is unknown. */
double tc_vmd_own_normal(const void *vmd, int x, int y, int z, double normal[3]);

/* The columns of a model in the making: of a rectangle of the grid, from first on. */
typedef struct tc_vmd_columns {
  int first[2], size[2];
  uint32_t *lengths; /* [size y][size x] bytes; 0: no column */
  uint8_t *bytes;    /* of all columns, in order; g_malloc */
} tc_vmd_columns;

/* For decoding and making: copies the lengths, takes the bytes on success. */
tc_vmd *tc_vmd_new(int version, const tc_vmd_head *head, const tc_vmd_columns *columns, GError **error);

/* A number of up to five bytes, seven bits in each, least first, the eighth set in all but the last. */
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
