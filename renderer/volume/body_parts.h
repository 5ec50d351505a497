/* Which parts of what is dense are the body, on a coarse grid: tables and containers touch who lies on them, so thin
 * necks are cut before parts are told apart.
 *
 * A cell is dense where a voxel of it is. Cells whose 26 neighbours are dense as well (an erosion) fall into connected
 * cores. The largest, grown back by the cell that was lost (an opening), is the body. Of the rest a connected part goes
 * if it is mostly outside of the body and thin as a shell is, or flat and wide as a board; arms are neither. What is
 * left of it then is parted into cores and shells, so that an arm on a table stays without it. A part that touches the
 * body goes only if it is a board that does so barely, a flat sheet behind it, or large and mostly behind all of the
 * body: noses, ears and chest walls stay. Where the opening takes much of what is dense, as of a dry skull, it is not
 * done.
 *
 * Where values have no unit, nothing says what is dense. The body is of dense cells then, soft ones around it are its
 * edge, and all else is told apart as above. Something goes only if one part of it is a table for sure: wide, flat,
 * behind the body and hardly in contact with it. Then soft cells beside the body go too. */
#ifndef TC_BODY_PARTS_H
#define TC_BODY_PARTS_H

#include "renderer/volume/volume.h"

/* A cell's place; beside it there may be TC_CELL_NEAR. */
enum { TC_CELL_AIR, TC_CELL_SOFT, TC_CELL_DENSE, TC_CELL_KEPT, TC_CELL_HIDDEN };
#define TC_CELL_NEAR 0x80 /* hidden, or one of its 26 neighbours is; or air outside of the body and not beside it */
#define TC_CELL_PLACE 0x7f

typedef struct tc_body_parts {
  int n[3];         /* cells along each axis */
  int voxels[3];    /* of a cell, along each axis */
  double side[3];   /* of a cell, mm */
  bool strict;      /* values have no unit */
  int back;         /* where the patient's back is: 1 at the end of the y axis, -1 at its start, 0 elsewhere */
  size_t stride[3]; /* between neighbours */
  uint8_t *cells;   /* [n[2] + 2][n[1] + 2][n[0] + 2], an edge around; dense, soft ones marked by who calls _find() */
} tc_body_parts;

/* False: no memory. */
bool tc_body_parts_init(tc_body_parts *parts, const tc_volume *volume);
void tc_body_parts_finish(tc_body_parts *parts);

static inline uint8_t *tc_body_parts_row(const tc_body_parts *parts, int y, int z) {
  return parts->cells + (size_t)(z + 1) * parts->stride[2] + (size_t)(y + 1) * parts->stride[1] + 1;
}

/* Makes of TC_CELL_DENSE and _SOFT one of the other places. Asks goes_on (NULL: goes on) now and then. Takes 7 bytes a
 * cell for a while. False: nothing is hidden, or it was stopped, or there is no memory. */
bool tc_body_parts_find(tc_body_parts *parts, bool (*goes_on)(void *user), void *user);

#endif
