#include "renderer/mesh/cases.h"

#include <glib.h>
#include <string.h>

const uint8_t tc_cell_face_corners[TC_CELL_FACES][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                                        {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};

static tc_cell_cases all;

/* The edge between two neighbouring corners. */
static int edge_between(int a, int b) {
  int low = a < b ? a : b, x = low & 1, y = low >> 1 & 1, z = low >> 2;
  switch (a ^ b) {
  case 1: return y + 2 * z;
  case 2: return 4 + x + 2 * z;
  default: return 8 + x + 2 * y;
  }
}

/* Both faces that an edge is part of, as bits. */
static int faces_of(int edge) {
  int first = edge & 1, second = edge >> 1 & 1;
  switch (edge / 4) {
  case 0: return 1 << (2 + first) | 1 << (4 + second);
  case 1: return 1 << first | 1 << (4 + second);
  default: return 1 << first | 1 << (2 + second);
  }
}

/* Walks around a face counter-clockwise. Where the walk goes in at one edge and out at another, the surface leads from
 * the edge it goes out at to the one it goes in at: next[out] = in. Which belong together on an ambiguous face is
 * `joined`'s. */
static void trace_face(int pattern, int face, bool joined, int8_t next[TC_CELL_EDGES]) {
  const uint8_t *corner = tc_cell_face_corners[face];
  for (int i = 0; i < 4; i++) {
    bool here = pattern >> corner[i] & 1, after = pattern >> corner[(i + 1) % 4] & 1;
    if (!here || after) continue; /* no way out here */
    int out = edge_between(corner[i], corner[(i + 1) % 4]), in = i;
    if (joined) /* around the outside corner: the next way in */
      for (in = (i + 1) % 4; pattern >> corner[in] & 1 || !(pattern >> corner[(in + 1) % 4] & 1);) in = (in + 1) % 4;
    else /* around the inside corner: the last way in */
      for (in = (i + 3) % 4; pattern >> corner[in] & 1;) in = (in + 3) % 4;
    next[out] = (int8_t)edge_between(corner[in], corner[(in + 1) % 4]);
  }
}

/* The triangles of loop[i .. j] on its chord, so that as few as can be have an edge within a face of the cell: cost and
 * the third corner. An edge within a face would be one of the neighbouring cell's too. */
typedef struct chord {
  int cost, third;
} chord;

static int in_face(const uint8_t *loop, int n, int i, int j) {
  bool side = j - i == 1 || (i == 0 && j == n - 1);
  return !side && (faces_of(loop[i]) & faces_of(loop[j])) != 0;
}

static void add_triangles(const uint8_t *loop, chord table[TC_CELL_EDGES][TC_CELL_EDGES], int i, int j,
                          tc_cell_case *c) {
  if (j - i < 2) return;
  int k = table[i][j].third;
  add_triangles(loop, table, i, k, c);
  uint8_t *t = c->edges[c->n_triangles++];
  t[0] = loop[i], t[1] = loop[j], t[2] = loop[k];
  add_triangles(loop, table, k, j, c);
}

/* Triangles from the middle of the loop to its sides: for the long loops that have no other way. */
static void add_fan(const uint8_t *loop, int n, tc_cell_case *c) {
  for (int i = 0; i < n; i++) {
    uint8_t *t = c->edges[c->n_triangles++];
    t[0] = loop[(i + 1) % n], t[1] = loop[i], t[2] = TC_CELL_CENTRE;
  }
  c->centre = true;
}

/* The best triangulation, by way of those of all shorter stretches of the loop. */
static void triangulate(const uint8_t *loop, int n, tc_cell_case *c) {
  chord table[TC_CELL_EDGES][TC_CELL_EDGES] = {0};
  for (int span = 2; span < n; span++)
    for (int i = 0, j = span; j < n; i++, j++) {
      table[i][j].cost = G_MAXINT;
      for (int k = i + 1; k < j; k++) {
        int cost = table[i][k].cost + table[k][j].cost + in_face(loop, n, i, j);
        if (cost < table[i][j].cost) table[i][j] = (chord){cost, k};
      }
    }
  if (table[0][n - 1].cost == 0)
    add_triangles(loop, table, 0, n - 1, c);
  else
    add_fan(loop, n, c);
}

static void make_case(int pattern, int joined, tc_cell_case *c) {
  int8_t next[TC_CELL_EDGES];
  memset(next, -1, sizeof next);
  for (int face = 0; face < TC_CELL_FACES; face++) trace_face(pattern, face, joined >> face & 1, next);
  for (int first = 0; first < TC_CELL_EDGES; first++) {
    uint8_t loop[TC_CELL_EDGES];
    int n = 0, edge = first;
    while (next[edge] >= 0) {
      loop[n++] = (uint8_t)edge;
      int after = next[edge];
      next[edge] = -1;
      edge = after;
    }
    if (n > 0) triangulate(loop, n, c);
  }
}

static uint8_t find_ambiguous(int pattern) {
  int bits = 0;
  for (int face = 0; face < TC_CELL_FACES; face++) {
    const uint8_t *c = tc_cell_face_corners[face];
    bool a = pattern >> c[0] & 1, b = pattern >> c[1] & 1;
    if (a != b && a == (pattern >> c[2] & 1) && b == (pattern >> c[3] & 1)) bits |= 1 << face;
  }
  return (uint8_t)bits;
}

const tc_cell_cases *tc_cell_cases_all(void) {
  static gsize made;
  if (!g_once_init_enter(&made)) return &all;
  for (int pattern = 0; pattern < 256; pattern++) {
    all.ambiguous[pattern] = find_ambiguous(pattern);
    for (int joined = 0; joined < 1 << TC_CELL_FACES; joined++)
      if ((joined & ~all.ambiguous[pattern]) == 0) make_case(pattern, joined, &all.of[pattern][joined]);
  }
  g_once_init_leave(&made, 1);
  return &all;
}
