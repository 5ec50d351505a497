/* The triangles of an isosurface in one cell, for every pattern of corners inside. Private to mesh/.
 *
 * Corner x + 2 y + 4 z of a cell is bit of that number in the pattern. Edges: 0-3 along x, from corner (0, y, z),
 * numbered y + 2 z; 4-7 along y, numbered 4 + x + 2 z; 8-11 along z, numbered 8 + x + 2 y. Face 2 a + s is the one at
 * side s of axis a. */
#ifndef TC_MESH_CASES_H
#define TC_MESH_CASES_H

#include <stdbool.h>
#include <stdint.h>

enum { TC_CELL_EDGES = 12, TC_CELL_FACES = 6, TC_CELL_MOST_TRIANGLES = 12, TC_CELL_CENTRE = TC_CELL_EDGES };

typedef struct tc_cell_case {
  uint8_t n_triangles;
  bool centre; /* a polygon has a vertex in its middle as well: edge number TC_CELL_CENTRE, the third corner of its triangles */
  uint8_t edges[TC_CELL_MOST_TRIANGLES][3]; /* edges whose vertices are the corners, counter-clockwise from outside */
} tc_cell_case;

typedef struct tc_cell_cases {
  uint8_t ambiguous[256]; /* a bit for each ambiguous face of the pattern */
  /* By pattern, and a bit for each ambiguous face whose two inside corners are joined across the face. */
  tc_cell_case of[256][1 << TC_CELL_FACES];
} tc_cell_cases;

/* Made on the first call; any thread. Static. */
const tc_cell_cases *tc_cell_cases_all(void);

/* The corners of a face in order around it, counter-clockwise seen from outside the cell. */
extern const uint8_t tc_cell_face_corners[TC_CELL_FACES][4];

#endif
