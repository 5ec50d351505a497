/* Distance of points from a set of triangles, by a grid whose cells list their triangles. */
#ifndef TC_MESH_DEVIATION_H
#define TC_MESH_DEVIATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct tc_deviation tc_deviation;

/* positions: finite; positions and triangles are borrowed until tc_deviation_end(). NULL: no memory, or no triangle. */
tc_deviation *tc_deviation_begin(const float (*positions)[3], const uint32_t *triangles, size_t n_triangles);
/* Distance from the nearest triangle, in the unit of the positions. A distance of at most `enough` need not be exact: the
 * search ends with the first triangle that near. */
float tc_deviation_at(const tc_deviation *d, const float point[3], float enough);
void tc_deviation_end(tc_deviation *d); /* NULL is fine */

#endif
