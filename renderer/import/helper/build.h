/* A mesh in the making: what the readers of OBJ, PLY and STL put together and the order takes. */
#ifndef TC_IMPORT_BUILD_H
#define TC_IMPORT_BUILD_H

#include "renderer/import/helper/order.h"

/* Numbers for keys of 12 bytes: the same key, the same number. */
typedef struct tc_weld {
  uint32_t *slots; /* [n_slots] number + 1, or 0 */
  size_t n_slots, n;
  uint64_t seed;
} tc_weld;

/* The number of `key` among `keys` ([n][12 bytes], by their numbers); a new one gets `next`, and the caller appends it.
 * TC_ERROR_MEMORY. */
bool tc_weld_find(tc_weld *weld, const void *key, const void *keys, uint32_t next, uint32_t *number, GError **error);

typedef struct tc_build {
  const tc_order *order;
  char format[16];
  bool ras;         /* the file's axes are right, anterior, superior: they are turned to LPS */
  double origin[3]; /* positions are relative to it */
  float (*positions)[3], (*normals)[3]; /* normals: of the first n_normals vertices */
  uint32_t *colors;                     /* likewise, as tc_mesh has them */
  uint32_t (*triangles)[3];
  size_t n_vertices, vertex_room, n_normals, normal_room, n_colors, color_room, n_triangles, triangle_room;
  uint64_t degenerate; /* triangles left out: two corners in one place */
} tc_build;

void tc_build_init(tc_build *build, const char *format, const tc_order *order);
void tc_build_clear(tc_build *build);

/* Room for n items of an array that grows; refuses what passes the order's limit (TC_ERROR_LIMIT) or memory. */
bool tc_build_grow(tc_build *build, void *array, size_t *room, size_t n, size_t item, GError **error);

/* A position in mm, as single precision relative to the origin, which the first one sets. Refused: no finite number, or
 * farther than 1e9 mm. */
bool tc_build_place(tc_build *build, const double at[3], float place[3], GError **error);
bool tc_build_vertex(tc_build *build, const double at[3], GError **error);
/* Any length but none or endless: becomes a unit vector; what has no length points up. */
void tc_build_direction(const tc_build *build, const double along[3], float normal[3]);
bool tc_build_normal(tc_build *build, const double along[3], GError **error);
/* sRGB, 0 to 1; what is outside, or no number, is held there. */
bool tc_build_color(tc_build *build, const double rgb[3], GError **error);
/* A polygon of n corners as a fan; one of fewer than 3 is counted as degenerate. Corners are of the vertices there are. */
bool tc_build_polygon(tc_build *build, const uint32_t *corners, size_t n, GError **error);

/* Gives all to the order; normals and colours only where each vertex has them. TC_ERROR_FORMAT without a triangle. */
bool tc_build_send(tc_build *build, GError **error);

/* "SPACE=RAS" in what a header says, as some programs note. */
bool tc_build_says_ras(const void *text, size_t size);

#endif
