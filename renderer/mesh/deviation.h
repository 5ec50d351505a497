/* How far points are from a set of triangles, by a grid of cells that list the triangles in them. */
#ifndef TC_MESH_DEVIATION_H
#define TC_MESH_DEVIATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct tc_deviation tc_deviation;

/* positions: finite; both are borrowed until the end. NULL: no memory, or no triangle. */
tc_deviation *tc_deviation_begin(const float (*positions)[3], const uint32_t *triangles, size_t n_triangles);
/* From the nearest of the triangles, in the positions' unit; where it is at most `enough`, that or less. */
float tc_deviation_at(const tc_deviation *d, const float point[3], float enough);
void tc_deviation_end(tc_deviation *d); /* NULL is fine */

#endif
