/* Splits a polygon of a mesh file into triangles. */
#ifndef TC_IMPORT_POLYGON_H
#define TC_IMPORT_POLYGON_H

#include <stdbool.h>
#include <stdint.h>

#include "renderer/base/error.h"

/* Working memory, reused from polygon to polygon; start with zeros. */
typedef struct tc_polygon {
  double (*places)[2];          /* of the corners, in the projection plane */
  uint32_t *before, *after;     /* neighbours of the corners that are left */
  uint8_t *reflex;
  uint32_t (*triangles)[3];     /* result: n - 2 triangles of corner numbers, in the polygon's direction */
  size_t room;
  uint64_t tests; /* point-in-triangle tests so far, over all polygons */
} tc_polygon;

/* Splits a polygon of n >= 3 corners, positions[corners[i]], concave ones too. The polygon is projected along the largest
 * component of its normal (M. Newell's sum of cross products). A polygon that is star-shaped from corner 0 becomes a fan;
 * other polygons are split by ear clipping (G. Meisters, "Polygons have ears", 1975). Every corner stays a corner of
 * a triangle. A polygon that crosses itself gets n - 2 triangles of some shape. TC_ERROR_MEMORY; TC_ERROR_LIMIT when the
 * concave polygons of a file take too many tests. */
bool tc_polygon_split(tc_polygon *polygon, const float (*positions)[3], const uint32_t *corners, size_t n, GError **error);
void tc_polygon_clear(tc_polygon *polygon);

#endif
