/* Isosurface extraction (mesh.h) in three parallel passes over rows of voxels:
 *   inside   a bit per voxel; voxels of blocks (skip.h) wholly on one side are not read;
 *   count    vertices (crossed edges) of each row, triangles of each brick of cells; prefix sums give the number of the first ones;
 *   fill     writes vertices and triangles. A vertex's number is its row's first number plus the crossed edges before it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/mesh/bricks.h"
#include "renderer/mesh/cases.h"
#include "renderer/mesh/inside.h"
#include "renderer/mesh/mesh.h"

#define NEAREST (1.0 / 1024) /* least distance of a vertex from the ends of its edge, as a share of the edge */

#define BRICK_LINES 6 /* cache lines of a brick's triangles that are prefetched */
#define AHEAD 2 /* rows whose voxels are prefetched */

typedef tc_side_word word;

/* Row of voxels (y, z): numbers of its first vertices on edges along x, y and z and in the centres of the cells between this
 * row, the next one and the two above. Before the prefix sum: counts. */
enum { CENTRE = 3, VERTEX_KINDS };
typedef struct row {
  uint32_t vertex[VERTEX_KINDS];
} row;

#define BAR_ROWS (8 * TC_BRICK) /* rows along y of a task, which has TC_BRICK planes */

typedef struct extraction {
  const tc_volume *volume;
  const void *voxels;
  tc_voxel_type type;
  int dims[3], words;  /* words of a row */
  float level, turn;   /* inside: turn * voxel >= level */
  tc_inside inside;
  const uint8_t *gaps; /* [z][y][x], tc_volume_gaps; NULL: the volume has none */
  row *rows;           /* [z][y] */
  tc_bricks bricks;
  int bars[2];         /* number of tasks along y, z */
  bool mirrored;       /* left-handed index axes */
  double to_mm[3][3];  /* index displacement -> LPS mm */
  double middle[3];    /* index position of the mesh's origin */
  size_t stride[3];    /* distance of neighbouring voxels along each axis, in voxels */
  float outward[3][3]; /* maps the field's slope along index axes to the outward direction in LPS */
  const tc_cell_cases *cases;
  tc_mesh *mesh;
} extraction;

static size_t row_at(const extraction *e, int y, int z) { return (size_t)z * (size_t)e->dims[1] + (size_t)y; }
static const word *bits_at(const extraction *e, int y, int z) { return e->inside.bits + row_at(e, y, z) * (size_t)e->words; }

/* The callers pass a constant voxel type, so that the compiler makes one version for each type. */
#define FOR_A_TYPE static inline __attribute__((always_inline))

/* turn * voxel[i] - level: at least 0 inside. */
FOR_A_TYPE float voxel_of(const extraction *e, tc_voxel_type type, size_t i) {
  switch (type) {
  case TC_U8: return e->turn * ((const uint8_t *)e->voxels)[i] - e->level;
  case TC_I8: return e->turn * ((const int8_t *)e->voxels)[i] - e->level;
  case TC_U16: return e->turn * ((const uint16_t *)e->voxels)[i] - e->level;
  case TC_I16: return e->turn * ((const int16_t *)e->voxels)[i] - e->level;
  case TC_F32:
  case TC_VOXEL_TYPE_COUNT: break;
  }
  return e->turn * ((const float *)e->voxels)[i] - e->level;
}

static float voxel_at(const extraction *e, int x, int y, int z) {
  return voxel_of(e, e->type, row_at(e, y, z) * (size_t)e->dims[0] + (size_t)x);
}

/* ---- cells ---- */

/* The bits of the voxels one further along x. */
static word next_bits(const extraction *e, const word *bits, int w) {
  word after = w + 1 < e->words ? bits[w + 1] : bits[w] >> 63;
  return bits[w] >> 1 | after << 63;
}

/* Edges along x whose ends are on different sides. */
static word crossed_x(const extraction *e, const word *bits, int w) { return bits[w] ^ next_bits(e, bits, w); }

/* The four rows of voxels around a row of cells: (y, z), (y + 1, z), (y, z + 1), (y + 1, z + 1). */
typedef struct cell_row {
  int y, z;
  const word *bits[4];
  const row *rows[4];
} cell_row;

static cell_row cells_at(const extraction *e, int y, int z) {
  cell_row c = {y, z, {0}, {0}};
  for (int i = 0; i < 4; i++) {
    c.bits[i] = bits_at(e, y + (i & 1), z + (i >> 1));
    c.rows[i] = e->rows + row_at(e, y + (i & 1), z + (i >> 1));
  }
  return c;
}

/* Cells of word w with a gap among their corners; they have no surface. */
static word blank_cells(const extraction *e, const cell_row *c, int w) {
  word blank = 0;
  for (int x = 64 * w; x < MIN(64 * w + 64, e->dims[0] - 1); x++) {
    bool any = false;
    for (int i = 0; i < 8; i++) {
      const size_t at = row_at(e, c->y + (i >> 1 & 1), c->z + (i >> 2)) * (size_t)e->dims[0] + (size_t)(x + (i & 1));
      any |= e->gaps[at] != 0;
    }
    blank |= (word)any << (x & 63);
  }
  return blank;
}

/* True if no edge from the row of voxels, and no cell from there on, is crossed. */
static bool is_quiet(const extraction *e, int y, int z) {
  const bool more_y = y + 1 < e->dims[1], more_z = z + 1 < e->dims[2];
  const uint8_t *sides = e->inside.sides, side = sides[row_at(e, y, z)];
  return side != TC_SIDE_MIXED && side == sides[row_at(e, y + more_y, z)] && side == sides[row_at(e, y, z + more_z)] &&
         side == sides[row_at(e, y + more_y, z + more_z)];
}

/* The cells of word w that the surface passes through. Bits beyond a row repeat its last voxel, so that the cells
 * there, and the one that begins at the last voxel, may be among them: they are masked. */
static word active_cells(const extraction *e, const cell_row *c, int w) {
  word any = 0, all = ~(word)0;
  for (int i = 0; i < 4; i++) {
    word here = c->bits[i][w], next = next_bits(e, c->bits[i], w);
    any |= here | next;
    all &= here & next;
  }
  int cells = e->dims[0] - 1 - 64 * w;
  if (e->gaps && any & ~all) any &= ~blank_cells(e, c, w);
  return any & ~all & (cells >= 64 ? ~(word)0 : cells > 0 ? ((word)1 << cells) - 1 : 0);
}

static uint8_t pattern_of(const cell_row *c, int x) {
  const int w = x >> 6, b = x & 63;
  unsigned pattern = 0;
  for (int i = 0; i < 4; i++) {
    word both = c->bits[i][w] >> b; /* of the voxels at x and x + 1 */
    if (b == 63) both |= c->bits[i][w + 1] << 1;
    pattern |= (unsigned)(both & 3) << 2 * i;
  }
  return (uint8_t)pattern;
}

/* The asymptotic decider: are the inside corners of an ambiguous face joined? Products of single-precision numbers are
 * exact in double, so that both cells at a face find the same. */
static bool is_joined(const extraction *e, const cell_row *c, int x, int pattern, int face) {
  const uint8_t *corner = tc_cell_face_corners[face];
  double v[4];
  for (int i = 0; i < 4; i++)
    v[i] = voxel_at(e, x + (corner[i] & 1), c->y + (corner[i] >> 1 & 1), c->z + (corner[i] >> 2));
  double even = v[0] * v[2], odd = v[1] * v[3];
  return pattern >> corner[0] & 1 ? even >= odd : odd >= even;
}

static const tc_cell_case *case_at(const extraction *e, const cell_row *c, int x) {
  uint8_t pattern = pattern_of(c, x), ambiguous = e->cases->ambiguous[pattern], joined = 0;
  for (int face = 0; ambiguous >> face; face++)
    if (ambiguous >> face & 1 && is_joined(e, c, x, pattern, face)) joined |= (uint8_t)(1 << face);
  return &e->cases->of[pattern][joined];
}

/* ---- count ---- */

/* The rows of a task. */
typedef struct bar {
  int y0, y1, z0, z1;
} bar;

static bar bar_at(const extraction *e, int task) {
  const int y = task % e->bars[0] * BAR_ROWS, z = task / e->bars[0] * TC_BRICK;
  return (bar){y, MIN(y + BAR_ROWS, e->dims[1]), z, MIN(z + TC_BRICK, e->dims[2])};
}

static void count_row(extraction *e, int y, int z) {
  row *r = e->rows + row_at(e, y, z);
  const bool has[3] = {true, y + 1 < e->dims[1], z + 1 < e->dims[2]};
  const word *here = bits_at(e, y, z), *side = has[1] ? bits_at(e, y + 1, z) : here,
             *above = has[2] ? bits_at(e, y, z + 1) : here;
  *r = (row){{0}};
  if (is_quiet(e, y, z)) return;
  for (int w = 0; w < e->words; w++) {
    int voxels = e->dims[0] - 64 * w;
    word there = voxels >= 64 ? ~(word)0 : ((word)1 << voxels) - 1;
    r->vertex[0] += (uint32_t)__builtin_popcountll(crossed_x(e, here, w));
    r->vertex[1] += (uint32_t)__builtin_popcountll((here[w] ^ side[w]) & there);
    r->vertex[2] += (uint32_t)__builtin_popcountll((here[w] ^ above[w]) & there);
  }
  if (!has[1] || !has[2]) return;
  const cell_row cells = cells_at(e, y, z);
  uint32_t *bricks = tc_bricks_along(&e->bricks, y, z);
  for (int w = 0; w < e->words; w++)
    for (word left = active_cells(e, &cells, w); left; left &= left - 1) {
      const int x = 64 * w + __builtin_ctzll(left);
      const tc_cell_case *cell = case_at(e, &cells, x);
      bricks[x / TC_BRICK] += cell->n_triangles;
      r->vertex[CENTRE] += cell->centre;
    }
}

static void count_bar(void *context, int task, int worker) {
  extraction *e = context;
  const bar b = bar_at(e, task);
  for (int z = b.z0; z < b.z1; z++)
    for (int y = b.y0; y < b.y1; y++) count_row(e, y, z);
}

/* Prefix sum in the order in which rows are filled: turns counts into first numbers and returns the total. */
static uint64_t sum_rows(extraction *e) {
  uint64_t vertices = 0;
  for (int task = 0; task < e->bars[0] * e->bars[1]; task++) {
    const bar b = bar_at(e, task);
    for (int z = b.z0; z < b.z1; z++)
      for (row *r = e->rows + row_at(e, b.y0, z), *end = e->rows + row_at(e, b.y1, z); r < end; r++)
        for (int k = 0; k < VERTEX_KINDS; k++) {
          const uint32_t count = r->vertex[k];
          r->vertex[k] = (uint32_t)vertices;
          vertices += count;
        }
  }
  return vertices;
}

/* ---- vertices ---- */

/* A vertex under construction: index position, and outward direction in LPS, not normalised. */
typedef struct point {
  double at[3];
  float outward[3];
} point;

/* The field's slope along index axes at a voxel: central differences, one-sided at a face. */
FOR_A_TYPE void slope_at(const extraction *e, tc_voxel_type type, const int at[3], size_t i, float slope[3]) {
  for (int k = 0; k < 3; k++) {
    bool low = at[k] > 0, high = at[k] + 1 < e->dims[k];
    float rise = voxel_of(e, type, high ? i + e->stride[k] : i) - voxel_of(e, type, low ? i - e->stride[k] : i);
    slope[k] = low && high ? 0.5f * rise : rise;
  }
}

/* Where the surface crosses the edge from a voxel along an axis. Normals are against the field's gradient in mm, which
 * is covariant; along the edge where there is none. */
FOR_A_TYPE point cross_typed(const extraction *e, tc_voxel_type type, const int from[3], int axis) {
  point p = {{from[0], from[1], from[2]}, {0}};
  size_t i = row_at(e, from[1], from[2]) * (size_t)e->dims[0] + (size_t)from[0];
  float a = voxel_of(e, type, i), b = voxel_of(e, type, i + e->stride[axis]), slopes[2][3], length = 0;
  double share = (double)a / ((double)a - b);
  share =
      share >= NEAREST ? fmin(share, 1 - NEAREST) : NEAREST; /* also for NaN: nearest to the first voxel */
  p.at[axis] += share;
  if (!e->mesh->normals) return p;
  int to[3] = {from[0], from[1], from[2]};
  to[axis]++;
  slope_at(e, type, from, i, slopes[0]);
  slope_at(e, type, to, i + e->stride[axis], slopes[1]);
  for (int k = 0; k < 3; k++) slopes[0][k] += (float)share * (slopes[1][k] - slopes[0][k]);
  for (int j = 0; j < 3; j++) {
    p.outward[j] = e->outward[j][0] * slopes[0][0] + e->outward[j][1] * slopes[0][1] + e->outward[j][2] * slopes[0][2];
    length += p.outward[j] * p.outward[j];
  }
  if (length > 0 && length < INFINITY) return p;
  for (int j = 0; j < 3; j++) p.outward[j] = (float)(a > b ? e->to_mm[j][axis] : -e->to_mm[j][axis]);
  return p;
}

static point cross_edge(const extraction *e, const int from[3], int axis) {
  return cross_typed(e, e->type, from, axis);
}

FOR_A_TYPE void put_vertex(const extraction *e, uint32_t number, const point *p) {
  const float *n = p->outward;
  double at[3];
  for (int k = 0; k < 3; k++) at[k] = p->at[k] - e->middle[k];
  for (int i = 0; i < 3; i++)
    e->mesh->positions[number][i] = (float)(e->to_mm[i][0] * at[0] + e->to_mm[i][1] * at[1] + e->to_mm[i][2] * at[2]);
  if (!e->mesh->normals) return;
  float scale = 1 / sqrtf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
  for (int i = 0; i < 3; i++) e->mesh->normals[number][i] = n[i] * scale;
}

/* Mean of a polygon's vertices; the polygon becomes a fan of triangles around it. */
static void put_centre(const extraction *e, uint32_t number, const tc_cell_case *cell, int x, int y, int z) {
  point mean = {{0}, {0}};
  int n = 0;
  for (int t = 0; t < cell->n_triangles; t++) {
    if (cell->edges[t][2] != TC_CELL_CENTRE) continue;
    int edge = cell->edges[t][0], axis = edge / 4, first = edge & 1, second = edge >> 1 & 1;
    const int from[3] = {x + (axis > 0 && first), y + (axis == 0 ? first : axis == 2 && second),
                         z + (axis < 2 && second)};
    point p = cross_edge(e, from, axis);
    float length = sqrtf(p.outward[0] * p.outward[0] + p.outward[1] * p.outward[1] + p.outward[2] * p.outward[2]);
    for (int k = 0; k < 3; k++) {
      mean.at[k] += p.at[k];
      mean.outward[k] += length > 0 ? p.outward[k] / length : 0;
    }
    n++;
  }
  for (int k = 0; k < 3; k++) mean.at[k] /= n;
  if (!(fabs(mean.outward[0]) + fabs(mean.outward[1]) + fabs(mean.outward[2]) > 1e-6)) mean.outward[0] = 1;
  put_vertex(e, number, &mean);
}

/* Prefetches the voxels above a row that will soon be processed, if the row has vertices. */
static void fetch_ahead(const extraction *e, int y, int z) {
  const size_t size = tc_voxel_size(e->type);
  const word *here = bits_at(e, y, z), *above = bits_at(e, y, z + 1);
  const char *voxels = (const char *)e->voxels + row_at(e, y, MIN(z + 2, e->dims[2] - 1)) * (size_t)e->dims[0] * size;
  for (int w = 0; w < e->words; w++) {
    if (!(crossed_x(e, here, w) | (here[w] ^ above[w]))) continue;
    for (size_t at = 0; at < 64 * size; at += 64) __builtin_prefetch(voxels + 64 * (size_t)w * size + at);
  }
}

FOR_A_TYPE void make_vertices(const extraction *e, tc_voxel_type type, int y, int z) {
  const word *here = bits_at(e, y, z), *other[3] = {here, here, here};
  if (y + 1 < e->dims[1]) other[1] = bits_at(e, y + 1, z);
  if (z + 1 < e->dims[2]) other[2] = bits_at(e, y, z + 1);
  if (z + 1 < e->dims[2] && y + AHEAD < e->dims[1]) fetch_ahead(e, y + AHEAD, z);
  for (int axis = 0; axis < 3; axis++) {
    uint32_t number = e->rows[row_at(e, y, z)].vertex[axis];
    for (int w = 0; w < e->words; w++) {
      word left = axis ? here[w] ^ other[axis][w] : crossed_x(e, here, w);
      for (; left; left &= left - 1) {
        int x = 64 * w + __builtin_ctzll(left);
        if (x >= e->dims[0]) break; /* beyond the row its last voxel is repeated */
        const point p = cross_typed(e, type, (const int[3]){x, y, z}, axis);
        put_vertex(e, number++, &p);
      }
    }
  }
}

/* ---- triangles ---- */

/* The vertices of a row of cells, a word of cells at a time. On the edges along x of the four rows of voxels, along y
 * of the two planes, and along z of the two sides: which edges are crossed, and the number of the word's first vertex.
 */
enum { ALONG_X = 0, ALONG_Y = 4, ALONG_Z = 6, EDGE_ROWS = 8 };
typedef struct edge_rows {
  word crossed[EDGE_ROWS];
  uint32_t first[EDGE_ROWS];
} edge_rows;

static void begin_edges(edge_rows *r, const cell_row *c) {
  for (int i = 0; i < 4; i++) r->first[ALONG_X + i] = c->rows[i]->vertex[0];
  for (int i = 0; i < 2; i++) {
    r->first[ALONG_Y + i] = c->rows[2 * i]->vertex[1];
    r->first[ALONG_Z + i] = c->rows[i]->vertex[2];
  }
}

static void enter_word(const extraction *e, edge_rows *r, const cell_row *c, int w) {
  for (int i = 0; i < 4; i++) r->crossed[ALONG_X + i] = crossed_x(e, c->bits[i], w);
  for (int i = 0; i < 2; i++) {
    r->crossed[ALONG_Y + i] = c->bits[2 * i][w] ^ c->bits[2 * i + 1][w];
    r->crossed[ALONG_Z + i] = c->bits[i][w] ^ c->bits[i + 2][w];
  }
}

static void leave_word(edge_rows *r) {
  for (int i = 0; i < EDGE_ROWS; i++) r->first[i] += (uint32_t)__builtin_popcountll(r->crossed[i]);
}

/* Numbers of the vertices on a cell's twelve edges, whether or not they are crossed; b: the cell's bit. */
static void number_edges(const edge_rows *r, int b, uint32_t number[TC_CELL_EDGES]) {
  const word before = ((word)1 << b) - 1;
  for (int i = 0; i < 4; i++)
    number[i] = r->first[ALONG_X + i] + (uint32_t)__builtin_popcountll(r->crossed[ALONG_X + i] & before);
  for (int i = 0; i < 4; i++) { /* along y, then z: at the cell's near side along x, and after that the far one */
    word crossed = r->crossed[ALONG_Y + i];
    uint32_t near = r->first[ALONG_Y + i] + (uint32_t)__builtin_popcountll(crossed & before);
    number[4 + 2 * i] = near;
    number[5 + 2 * i] = near + (uint32_t)(crossed >> b & 1);
  }
}

static void make_triangles(const extraction *e, int y, int z) {
  const cell_row c = cells_at(e, y, z);
  uint32_t *next = tc_bricks_along(&e->bricks, y, z), number[TC_CELL_EDGES + 1];
  uint32_t(*const triangles)[3] = e->mesh->triangles;
  const int second = e->mirrored ? 2 : 1, third = 3 - second; /* left-handed index axes mirror a triangle's orientation */
  edge_rows r;
  number[TC_CELL_CENTRE] = c.rows[0]->vertex[CENTRE];
  begin_edges(&r, &c);
  for (int w = 0; w < e->words; w++) {
    enter_word(e, &r, &c, w);
    for (word left = active_cells(e, &c, w); left; left &= left - 1) {
      int b = __builtin_ctzll(left), x = 64 * w + b;
      const tc_cell_case *cell = case_at(e, &c, x);
      uint32_t(*out)[3] = triangles + next[x / TC_BRICK];
      next[x / TC_BRICK] += cell->n_triangles;
      number_edges(&r, b, number);
      for (int t = 0; t < cell->n_triangles; t++, out++)
        (*out)[0] = number[cell->edges[t][0]], (*out)[1] = number[cell->edges[t][second]], (*out)[2] = number[cell->edges[t][third]];
      if (cell->centre) put_centre(e, number[TC_CELL_CENTRE]++, cell, x, y, z);
    }
    leave_word(&r);
  }
}

static void fill_row(const extraction *e, int y, int z) {
  if (is_quiet(e, y, z)) return;
  switch (e->type) {
  case TC_U8: make_vertices(e, TC_U8, y, z); break;
  case TC_I8: make_vertices(e, TC_I8, y, z); break;
  case TC_U16: make_vertices(e, TC_U16, y, z); break;
  case TC_I16: make_vertices(e, TC_I16, y, z); break;
  case TC_F32:
  case TC_VOXEL_TYPE_COUNT: make_vertices(e, TC_F32, y, z); break;
  }
  if (y + 1 < e->dims[1] && z + 1 < e->dims[2]) make_triangles(e, y, z);
}

/* Numbers the first triangles of a row of bricks in the whole mesh, and has their places brought near: they are in no order that
 * the processor foresees. */
static void enter_bricks(const extraction *e, int y, int z) {
  const uint64_t *blocks = tc_bricks_blocks(&e->bricks, y, z);
  uint32_t *next = tc_bricks_along(&e->bricks, y, z);
  for (int x = 0; x < e->bricks.n[0]; x++) {
    next[x] += (uint32_t)blocks[x / TC_BLOCK];
    const char *at = (const char *)(e->mesh->triangles + next[x]);
    for (int line = 0; line < BRICK_LINES; line++) __builtin_prefetch(at + 64 * line, 1);
  }
}

static void fill_bar(void *context, int task, int worker) {
  const extraction *e = context;
  const bar b = bar_at(e, task);
  for (int z = b.z0; z < b.z1; z++)
    for (int y = b.y0; y < b.y1; y++) {
      if (z == b.z0 && y % TC_BRICK == 0 && y + 1 < e->dims[1] && z + 1 < e->dims[2]) enter_bricks(e, y, z);
      fill_row(e, y, z);
    }
}

/* ---- all ---- */

static bool left_handed(const extraction *e) {
  const double(*m)[3] = e->to_mm;
  return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
             m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]) <
         0;
}

static void set_up(extraction *e, const tc_volume *volume, double iso) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  double to_index[9], scale = 0;
  *e = (extraction){.cases = tc_cell_cases_all(), .volume = volume, .voxels = tc_volume_data(volume), .type = d->type};
  if (tc_volume_gaps(volume)) e->gaps = tc_volume_data(tc_volume_gaps(volume));
  e->turn = d->slope > 0 ? 1 : -1;
  e->level = (float)((iso - d->intercept) / d->slope) * e->turn;
  for (int k = 0; k < 3; k++) {
    e->dims[k] = d->dims[k];
    e->middle[k] = 0.5 * (d->dims[k] - 1);
  }
  e->words = (d->dims[0] + 63) / 64;
  e->stride[0] = 1, e->stride[1] = (size_t)d->dims[0], e->stride[2] = (size_t)d->dims[0] * (size_t)d->dims[1];
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++) e->to_mm[i][k] = d->spacing[k] * d->direction[3 * i + k];
  tc_volume_lps_to_index_matrix(volume, to_index);
  for (int k = 0; k < 9; k++)
    scale = fmax(scale, fabs(to_index[k])); /* only the direction matters; scaled so that squares do not overflow single precision */
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++) e->outward[i][k] = (float)(-to_index[3 * k + i] / scale);
  e->mirrored = left_handed(e);
  e->bars[0] = (e->dims[1] + BAR_ROWS - 1) / BAR_ROWS, e->bars[1] = (e->dims[2] + TC_BRICK - 1) / TC_BRICK;
}

static bool make_mesh(extraction *e, const tc_mesh_options *options, GError **error) {
  const uint64_t vertices = sum_rows(e);
  uint64_t triangles;
  if (!tc_bricks_sum(&e->bricks, options->pool, &triangles)) return tc_halt_say(tc_pool_halt(options->pool), error);
  const uint64_t bytes = tc_mesh_bytes(vertices, triangles, options->normals);
  if (options->max_bytes && bytes > options->max_bytes) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "isosurface: %.1f million triangles take %.0f MiB, %.0f MiB are allowed",
                 (double)triangles * 1e-6, (double)bytes / 0x1p20, (double)options->max_bytes / 0x1p20);
    return false;
  }
  e->mesh = tc_mesh_new(vertices, triangles, options->normals, error);
  if (!e->mesh) return false;
  tc_volume_index_to_lps(e->volume, e->middle, e->mesh->origin);
  e->mesh->ordered = true;
  if (!tc_pool_run(options->pool, e->bars[0] * e->bars[1], fill_bar, e)) return tc_halt_say(tc_pool_halt(options->pool), error);
  return !e->gaps || tc_mesh_drop_unused(e->mesh, error); /* of cells with gaps */
}

static bool extract(extraction *e, const tc_mesh_options *options, GError **error) {
  size_t rows = (size_t)e->dims[1] * (size_t)e->dims[2];
  e->rows = malloc(rows * sizeof *e->rows);
  const bool begun = tc_bricks_begin(&e->bricks, (const int[3]){e->dims[0] - 1, e->dims[1] - 1, e->dims[2] - 1});
  if (!e->rows || !begun) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "isosurface: out of memory");
    return false;
  }
  if (!tc_inside_find(&e->inside, e->volume, e->turn, e->level, options->blocks, options->pool, error)) return false;
  tc_share_done(&options->share, 0.2);
  if (!tc_pool_run(options->pool, e->bars[0] * e->bars[1], count_bar, e)) return tc_halt_say(tc_pool_halt(options->pool), error);
  tc_share_done(&options->share, 0.5);
  return make_mesh(e, options, error);
}

tc_mesh *tc_mesh_extract(const tc_volume *volume, double iso, const tc_mesh_options *options, GError **error) {
  extraction e;
  if (!isfinite(iso)) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "isosurface: a finite value expected");
    return NULL;
  }
  set_up(&e, volume, iso);
  if (e.dims[0] < 2 || e.dims[1] < 2 || e.dims[2] < 2) return tc_mesh_new(0, 0, options->normals, error); /* no cells */
  bool made = extract(&e, options, error);
  free(e.rows);
  tc_inside_end(&e.inside);
  tc_bricks_end(&e.bricks);
  if (made) return e.mesh;
  tc_mesh_free(e.mesh);
  return NULL;
}
