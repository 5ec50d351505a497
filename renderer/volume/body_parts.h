/* Segments the body on a coarse grid by morphology. Tables and containers touch the patient, so thin connections are
 * cut by an opening before connected components are found.
 *
 * A cell is dense if one of its voxels is. An erosion keeps the dense cells whose 26 neighbours are dense too; they
 * form connected cores. The largest core, dilated by one cell (an opening), is the body. A connected component of the
 * rest is removed if it is mostly outside the body and thin like a shell, or flat and wide like a board; arms are
 * neither. What remains of the rest is opened again into cores and shells, so that an arm on a table is kept without
 * the table. A component that touches the body is removed only if it is a board with little contact, a flat sheet
 * behind the body, or large and mostly behind the whole body: noses, ears and chest walls are kept. If the opening
 * would remove much of the dense cells, as in a dry skull, the whole connected component of the largest core is the
 * body instead.
 *
 * If values have no unit (strict), the threshold of dense cells is uncertain. Soft cells next to the body are then its
 * edge, and the remaining soft cells are classified with the rest. Parts are removed only if one of them is certainly a
 * table: wide, flat, behind the body and hardly in contact with it. Soft cells outside the body are then removed
 * too. */
#ifndef TC_BODY_PARTS_H
#define TC_BODY_PARTS_H

#include "renderer/volume/volume.h"

/* Class of a cell, in its lower 7 bits; TC_CELL_NEAR is a flag. */
enum { TC_CELL_AIR, TC_CELL_SOFT, TC_CELL_DENSE, TC_CELL_KEPT, TC_CELL_HIDDEN };
#define TC_CELL_NEAR 0x80 /* the cell or one of its 26 neighbours is hidden, or the cell is air outside the body and not
                             adjacent to it */
#define TC_CELL_PLACE 0x7f

typedef struct tc_body_parts {
  int n[3];         /* cells along each axis */
  int voxels[3];    /* voxels of a cell along each axis */
  double side[3];   /* size of a cell along each axis, mm */
  bool strict;      /* values have no unit */
  int back;         /* the patient's back is at the end of the y axis (1), at its start (-1), or elsewhere (0) */
  size_t stride[3]; /* distance of neighbouring cells in `cells` */
  uint8_t *cells;   /* [n[2] + 2][n[1] + 2][n[0] + 2], with a border; the caller marks dense and soft cells before
                       _find() */
} tc_body_parts;

/* Allocates the cells, all air. False: out of memory. */
bool tc_body_parts_init(tc_body_parts *parts, const tc_volume *volume);
void tc_body_parts_finish(tc_body_parts *parts);

static inline uint8_t *tc_body_parts_row(const tc_body_parts *parts, int y, int z) {
  return parts->cells + (size_t)(z + 1) * parts->stride[2] + (size_t)(y + 1) * parts->stride[1] + 1;
}

/* Classifies every dense and soft cell as kept or hidden, and marks cells near. Calls goes_on (NULL: never stops)
 * between its steps. Needs 7 bytes per cell temporarily. False: nothing to hide, stopped, or out of memory. */
bool tc_body_parts_find(tc_body_parts *parts, bool (*goes_on)(void *user), void *user);

#endif
