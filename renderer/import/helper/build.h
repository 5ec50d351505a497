/* A mesh under construction: the readers of OBJ, PLY and STL fill it and send it to the daemon. */
#ifndef TC_IMPORT_BUILD_H
#define TC_IMPORT_BUILD_H

#include "renderer/import/helper/order.h"
#include "renderer/import/helper/polygon.h"

/* Numbers 12-byte keys: equal keys get equal numbers. */
typedef struct tc_weld {
  uint32_t *slots; /* [n_slots] number + 1, or 0 */
  size_t n_slots, n;
  uint64_t seed;
} tc_weld;

/* The number of `key` among `keys` ([n] of 12 bytes, in order of their numbers). A new key gets the number `next`,
 * and the caller appends it. TC_ERROR_MEMORY. */
bool tc_weld_find(tc_weld *weld, const void *key, const void *keys, uint32_t next, uint32_t *number, GError **error);

typedef struct tc_build {
  const tc_order *order;
  char format[16];
  bool ras;         /* the file's axes are right, anterior, superior: positions and normals are converted to LPS */
  double origin[3]; /* positions are relative to this point */
  float (*positions)[3], (*normals)[3]; /* normals: of the first n_normals vertices */
  uint32_t *colors;                     /* of the first n_colors vertices, in tc_mesh's format */
  uint32_t (*triangles)[3];
  size_t n_vertices, vertex_room, n_normals, normal_room, n_colors, color_room, n_triangles, triangle_room;
  uint64_t degenerate; /* triangles left out because two corners coincide */
  tc_polygon polygon;
} tc_build;

void tc_build_init(tc_build *build, const char *format, const tc_order *order);
void tc_build_clear(tc_build *build);

/* Grows an array to hold n items. Refuses more than the order's limit (TC_ERROR_LIMIT) or than memory. */
bool tc_build_grow(tc_build *build, void *array, size_t *room, size_t n, size_t item, GError **error);

/* Converts a position in mm to single precision relative to the origin, which is set by the first position. Refuses
 * numbers that are not finite and positions farther than 1e9 mm. */
bool tc_build_place(tc_build *build, const double at[3], float place[3], GError **error);
bool tc_build_vertex(tc_build *build, const double at[3], GError **error);
/* Converts a vector of any length to a unit normal; a vector of zero or infinite length becomes +z. */
void tc_build_direction(const tc_build *build, const double along[3], float normal[3]);
bool tc_build_normal(tc_build *build, const double along[3], GError **error);
/* Adds an sRGB colour; components are clamped to 0..1, NaN becomes 0. */
bool tc_build_color(tc_build *build, const double rgb[3], GError **error);
/* Adds the triangles of a polygon of n corners (polygon.h). `places` are indices of existing vertices; the triangles get
 * the numbers in `corners`, which may be the same array. Fewer than three corners count as degenerate. */
bool tc_build_polygon(tc_build *build, const uint32_t *places, const uint32_t *corners, size_t n, GError **error);

/* Sends the mesh to the daemon; normals and colours only if every vertex has them. TC_ERROR_FORMAT if there is no
 * triangle. */
bool tc_build_send(tc_build *build, GError **error);

/* Whether a header contains "SPACE=RAS", which some programs write. */
bool tc_build_says_ras(const void *text, size_t size);

#endif
