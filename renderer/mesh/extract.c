/* Isosurface extraction (mesh.h) in three passes over rows of voxels, each of which any thread may do:
 *   inside   a bit per voxel;
 *   count    crossed edges, which are vertices, and triangles, per row: their sums are the numbers of the first ones;
 *   fill     vertices and triangles in their places. A vertex's number is its row's first and the bits before it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/mesh/cases.h"
#include "renderer/mesh/mesh.h"

#define NEAREST (1.0 / 1024) /* share of an edge that a vertex stays away from its ends */

typedef uint64_t word; /* 64 voxels of a row */

/* Of the row of voxels (y, z): numbers of its first vertices on edges along x, y and z and in the middle of cells, and
 * of the first triangle of the cells between this row, the next one and those above. Counts before they are summed up.
 */
enum { CENTRE = 3, VERTEX_KINDS };
typedef struct row {
  uint32_t vertex[VERTEX_KINDS];
  uint32_t triangle;
} row;

typedef struct extraction {
  const tc_volume *volume;
  const void *voxels;
  tc_voxel_type type;
  int dims[3], words; /* words of a row */
  float level, turn;  /* inside: turn * voxel >= level */
  word *inside;       /* [z][y][words]; bits beyond the row are those of its last voxel */
  row *rows;          /* [z][y] */
  double to_mm[3][3]; /* index displacement -> LPS mm */
  double middle[3];   /* index position of the mesh's origin */
  double to_index[9];
  tc_mesh *mesh;
} extraction;

static size_t row_at(const extraction *e, int y, int z) { return (size_t)z * (size_t)e->dims[1] + (size_t)y; }
static const word *bits_at(const extraction *e, int y, int z) { return e->inside + row_at(e, y, z) * (size_t)e->words; }

/* turn * voxel - level: at least 0 inside. */
static float voxel_at(const extraction *e, int x, int y, int z) {
  size_t i = row_at(e, y, z) * (size_t)e->dims[0] + (size_t)x;
  switch (e->type) {
  case TC_U8:
    return e->turn * ((const uint8_t *)e->voxels)[i] - e->level;
  case TC_I8:
    return e->turn * ((const int8_t *)e->voxels)[i] - e->level;
  case TC_U16:
    return e->turn * ((const uint16_t *)e->voxels)[i] - e->level;
  case TC_I16:
    return e->turn * ((const int16_t *)e->voxels)[i] - e->level;
  case TC_F32:
  case TC_VOXEL_TYPE_COUNT:
    break;
  }
  return e->turn * ((const float *)e->voxels)[i] - e->level;
}

/* ---- inside ---- */

/* Eight bytes of 0 or 1 to eight bits, the first the lowest. */
static word gather_bits(const uint8_t bytes[8]) {
  word all;
  memcpy(&all, bytes, sizeof all);
  return all * 0x0102040810204080u >> 56;
}

#define ROW_OF_BITS(name, type)                                                                                        \
  static void bits_##name(const extraction *e, const type *voxels, word *out) {                                        \
    for (int first = 0; first < e->dims[0]; first += 64, out++) {                                                      \
      uint8_t flags[64];                                                                                               \
      int n = MIN(64, e->dims[0] - first);                                                                             \
      for (int i = 0; i < n; i++)                                                                                      \
        flags[i] = e->turn * (float)voxels[first + i] >= e->level;                                                     \
      memset(flags + n, flags[n - 1], (size_t)(64 - n));                                                               \
      *out = 0;                                                                                                        \
      for (int i = 0; i < 8; i++)                                                                                      \
        *out |= gather_bits(flags + 8 * i) << 8 * i;                                                                   \
    }                                                                                                                  \
  }
ROW_OF_BITS(u8, uint8_t)
ROW_OF_BITS(i8, int8_t)
ROW_OF_BITS(u16, uint16_t)
ROW_OF_BITS(i16, int16_t)
ROW_OF_BITS(f32, float)

static void find_inside(void *context, int z, int worker) {
  extraction *e = context;
  for (int y = 0; y < e->dims[1]; y++) {
    const size_t at = row_at(e, y, z) * (size_t)e->dims[0];
    word *out = e->inside + row_at(e, y, z) * (size_t)e->words;
    switch (e->type) {
    case TC_U8:
      bits_u8(e, (const uint8_t *)e->voxels + at, out);
      break;
    case TC_I8:
      bits_i8(e, (const int8_t *)e->voxels + at, out);
      break;
    case TC_U16:
      bits_u16(e, (const uint16_t *)e->voxels + at, out);
      break;
    case TC_I16:
      bits_i16(e, (const int16_t *)e->voxels + at, out);
      break;
    case TC_F32:
    case TC_VOXEL_TYPE_COUNT:
      bits_f32(e, (const float *)e->voxels + at, out);
      break;
    }
  }
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
  return any & ~all & (cells >= 64 ? ~(word)0 : cells > 0 ? ((word)1 << cells) - 1 : 0);
}

static int bit_at(const word *bits, int x) { return (int)(bits[x >> 6] >> (x & 63) & 1); }

static uint8_t pattern_of(const cell_row *c, int x) {
  int pattern = 0;
  for (int i = 0; i < 4; i++)
    pattern |= bit_at(c->bits[i], x) << 2 * i | bit_at(c->bits[i], x + 1) << (2 * i + 1);
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
  uint8_t pattern = pattern_of(c, x), ambiguous = tc_cell_ambiguous(pattern), joined = 0;
  for (int face = 0; ambiguous >> face; face++)
    if (ambiguous >> face & 1 && is_joined(e, c, x, pattern, face)) joined |= (uint8_t)(1 << face);
  return tc_cell_case_of(pattern, joined);
}

/* ---- count ---- */

static void count_row(extraction *e, int y, int z) {
  row *r = e->rows + row_at(e, y, z);
  const bool has[3] = {true, y + 1 < e->dims[1], z + 1 < e->dims[2]};
  const word *here = bits_at(e, y, z), *side = has[1] ? bits_at(e, y + 1, z) : here,
             *above = has[2] ? bits_at(e, y, z + 1) : here;
  *r = (row){{0}, 0};
  for (int w = 0; w < e->words; w++) {
    int voxels = e->dims[0] - 64 * w;
    word there = voxels >= 64 ? ~(word)0 : ((word)1 << voxels) - 1;
    r->vertex[0] += (uint32_t)__builtin_popcountll(crossed_x(e, here, w));
    r->vertex[1] += (uint32_t)__builtin_popcountll((here[w] ^ side[w]) & there);
    r->vertex[2] += (uint32_t)__builtin_popcountll((here[w] ^ above[w]) & there);
  }
  if (!has[1] || !has[2]) return;
  const cell_row cells = cells_at(e, y, z);
  for (int w = 0; w < e->words; w++)
    for (word left = active_cells(e, &cells, w); left; left &= left - 1) {
      const tc_cell_case *cell = case_at(e, &cells, 64 * w + __builtin_ctzll(left));
      r->triangle += cell->n_triangles;
      r->vertex[CENTRE] += cell->centre;
    }
}

static void count_plane(void *context, int z, int worker) {
  extraction *e = context;
  for (int y = 0; y < e->dims[1]; y++)
    count_row(e, y, z);
}

/* Counts become the numbers of the first ones; how many there are in all. */
static void sum_rows(extraction *e, uint64_t *vertices, uint64_t *triangles) {
  size_t n = (size_t)e->dims[1] * (size_t)e->dims[2];
  *vertices = *triangles = 0;
  for (size_t i = 0; i < n; i++) {
    const row counts = e->rows[i];
    for (int k = 0; k < VERTEX_KINDS; k++) {
      e->rows[i].vertex[k] = (uint32_t)*vertices;
      *vertices += counts.vertex[k];
    }
    e->rows[i].triangle = (uint32_t)*triangles;
    *triangles += counts.triangle;
  }
}

/* ---- vertices ---- */

/* The field's slope along index axes at a voxel: central differences, one-sided at a face. */
static void slope_at(const extraction *e, const int at[3], double slope[3]) {
  for (int k = 0; k < 3; k++) {
    int low[3] = {at[0], at[1], at[2]}, high[3] = {at[0], at[1], at[2]};
    if (at[k] > 0) low[k]--;
    if (at[k] + 1 < e->dims[k]) high[k]++;
    double rise = voxel_at(e, high[0], high[1], high[2]) - voxel_at(e, low[0], low[1], low[2]);
    slope[k] = high[k] > low[k] ? rise / (high[k] - low[k]) : 0;
  }
}

/* A vertex on its way: index position, and the direction out of the surface in LPS, of any length. */
typedef struct point {
  double at[3], outward[3];
} point;

/* Against the field's gradient in mm, which is covariant; along the edge where there is none. */
static void find_outward(const extraction *e, const int from[3], int axis, double share, bool falls,
                         double outward[3]) {
  int to[3] = {from[0], from[1], from[2]};
  double a[3], b[3], length = 0;
  to[axis]++;
  slope_at(e, from, a);
  slope_at(e, to, b);
  for (int i = 0; i < 3; i++) {
    outward[i] = 0;
    for (int k = 0; k < 3; k++)
      outward[i] -= e->to_index[3 * k + i] * (a[k] + share * (b[k] - a[k]));
    length += fabs(outward[i]);
  }
  if (length > 0 && isfinite(length)) return;
  for (int i = 0; i < 3; i++)
    outward[i] = falls ? e->to_mm[i][axis] : -e->to_mm[i][axis];
}

/* Where the surface crosses the edge from a voxel along an axis. */
static point cross_edge(const extraction *e, int x, int y, int z, int axis) {
  point p = {{x, y, z}, {0}};
  const int from[3] = {x, y, z};
  double a = voxel_at(e, x, y, z), b = voxel_at(e, x + (axis == 0), y + (axis == 1), z + (axis == 2)),
         share = a / (a - b);
  share =
      share >= NEAREST ? fmin(share, 1 - NEAREST) : NEAREST; /* what is no number, too: nearest to the first voxel */
  if (e->mesh->normals) find_outward(e, from, axis, share, a > b, p.outward);
  p.at[axis] += share;
  return p;
}

static void put_vertex(const extraction *e, uint32_t number, const point *p) {
  double length = 0, at[3];
  for (int k = 0; k < 3; k++)
    at[k] = p->at[k] - e->middle[k];
  for (int i = 0; i < 3; i++)
    e->mesh->positions[number][i] = (float)(e->to_mm[i][0] * at[0] + e->to_mm[i][1] * at[1] + e->to_mm[i][2] * at[2]);
  if (!e->mesh->normals) return;
  for (int i = 0; i < 3; i++)
    length = hypot(length, p->outward[i]);
  for (int i = 0; i < 3; i++)
    e->mesh->normals[number][i] = (float)(p->outward[i] / length);
}

/* The mean of a polygon's vertices, each of which begins one triangle of its fan. */
static void put_centre(const extraction *e, uint32_t number, const tc_cell_case *cell, int x, int y, int z) {
  point mean = {{0}, {0}};
  int n = 0;
  for (int t = 0; t < cell->n_triangles; t++) {
    if (cell->edges[t][2] != TC_CELL_CENTRE) continue;
    int edge = cell->edges[t][0], axis = edge / 4, first = edge & 1, second = edge >> 1 & 1;
    point p = cross_edge(e, x + (axis > 0 && first), y + (axis == 0 ? first : axis == 2 && second),
                         z + (axis < 2 && second), axis);
    double length = hypot(hypot(p.outward[0], p.outward[1]), p.outward[2]);
    for (int k = 0; k < 3; k++) {
      mean.at[k] += p.at[k];
      mean.outward[k] += length > 0 ? p.outward[k] / length : 0;
    }
    n++;
  }
  for (int k = 0; k < 3; k++)
    mean.at[k] /= n;
  if (!(fabs(mean.outward[0]) + fabs(mean.outward[1]) + fabs(mean.outward[2]) > 1e-6)) mean.outward[0] = 1;
  put_vertex(e, number, &mean);
}

static void make_vertices(const extraction *e, int y, int z) {
  const word *here = bits_at(e, y, z), *other[3] = {here, here, here};
  if (y + 1 < e->dims[1]) other[1] = bits_at(e, y + 1, z);
  if (z + 1 < e->dims[2]) other[2] = bits_at(e, y, z + 1);
  for (int axis = 0; axis < 3; axis++) {
    uint32_t number = e->rows[row_at(e, y, z)].vertex[axis];
    for (int w = 0; w < e->words; w++) {
      word left = axis ? here[w] ^ other[axis][w] : crossed_x(e, here, w);
      for (; left; left &= left - 1) {
        int x = 64 * w + __builtin_ctzll(left);
        if (x >= e->dims[0]) break; /* beyond the row its last voxel is repeated */
        const point p = cross_edge(e, x, y, z, axis);
        put_vertex(e, number++, &p);
      }
    }
  }
}

/* ---- triangles ---- */

/* How many edges before word w of each kind and row around a row of cells are crossed: along x in four rows, along y in
 * the two planes, along z in the two rows. */
typedef struct ranks {
  uint32_t x[4], y[2], z[2];
} ranks;

static word before(int x) { return ((word)1 << (x & 63)) - 1; }

/* Number of the vertex on an edge of cell x. */
static uint32_t vertex_of(const extraction *e, const cell_row *c, const ranks *r, int w, int x, int edge) {
  int kind = edge / 4, first = edge & 1, second = edge >> 1 & 1, i = kind == 0 ? first + 2 * second : second;
  word crossed;
  uint32_t number;
  switch (kind) {
  case 0:
    crossed = crossed_x(e, c->bits[i], w);
    number = c->rows[i]->vertex[0] + r->x[i];
    break;
  case 1:
    crossed = c->bits[2 * i][w] ^ c->bits[2 * i + 1][w];
    number = c->rows[2 * i]->vertex[1] + r->y[i];
    break;
  default:
    crossed = c->bits[i][w] ^ c->bits[i + 2][w];
    number = c->rows[i]->vertex[2] + r->z[i];
    break;
  }
  number += (uint32_t)__builtin_popcountll(crossed & before(x));
  return kind > 0 && first ? number + (uint32_t)(crossed >> (x & 63) & 1) : number; /* at the cell's far side */
}

static void pass_word(const extraction *e, const cell_row *c, ranks *r, int w) {
  for (int i = 0; i < 4; i++)
    r->x[i] += (uint32_t)__builtin_popcountll(crossed_x(e, c->bits[i], w));
  for (int i = 0; i < 2; i++) {
    r->y[i] += (uint32_t)__builtin_popcountll(c->bits[2 * i][w] ^ c->bits[2 * i + 1][w]);
    r->z[i] += (uint32_t)__builtin_popcountll(c->bits[i][w] ^ c->bits[i + 2][w]);
  }
}

static void make_triangles(const extraction *e, int y, int z) {
  const cell_row c = cells_at(e, y, z);
  uint32_t(*out)[3] = e->mesh->triangles + c.rows[0]->triangle, centre = c.rows[0]->vertex[CENTRE];
  ranks r = {0};
  for (int w = 0; w < e->words; w++) {
    for (word left = active_cells(e, &c, w); left; left &= left - 1) {
      int x = 64 * w + __builtin_ctzll(left);
      const tc_cell_case *cell = case_at(e, &c, x);
      for (int t = 0; t < cell->n_triangles; t++, out++)
        for (int k = 0; k < 3; k++)
          (*out)[k] = cell->edges[t][k] == TC_CELL_CENTRE ? centre : vertex_of(e, &c, &r, w, x, cell->edges[t][k]);
      if (cell->centre) put_centre(e, centre++, cell, x, y, z);
    }
    pass_word(e, &c, &r, w);
  }
}

static void fill_plane(void *context, int z, int worker) {
  const extraction *e = context;
  for (int y = 0; y < e->dims[1]; y++) {
    make_vertices(e, y, z);
    if (y + 1 < e->dims[1] && z + 1 < e->dims[2]) make_triangles(e, y, z);
  }
}

/* A volume whose index axes are a left-handed system in patient space mirrors its triangles. */
static void turn_over(tc_mesh *mesh) {
  for (size_t i = 0; i < mesh->n_triangles; i++) {
    uint32_t last = mesh->triangles[i][2];
    mesh->triangles[i][2] = mesh->triangles[i][1];
    mesh->triangles[i][1] = last;
  }
}

/* ---- all ---- */

static void set_up(extraction *e, const tc_volume *volume, double iso) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  *e = (extraction){.volume = volume, .voxels = tc_volume_data(volume), .type = d->type};
  e->turn = d->slope > 0 ? 1 : -1;
  e->level = (float)((iso - d->intercept) / d->slope) * e->turn;
  for (int k = 0; k < 3; k++) {
    e->dims[k] = d->dims[k];
    e->middle[k] = 0.5 * (d->dims[k] - 1);
  }
  e->words = (d->dims[0] + 63) / 64;
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++)
      e->to_mm[i][k] = d->spacing[k] * d->direction[3 * i + k];
  tc_volume_lps_to_index_matrix(volume, e->to_index);
}

static bool left_handed(const extraction *e) {
  const double(*m)[3] = e->to_mm;
  return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
             m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]) <
         0;
}

static bool make_mesh(extraction *e, const tc_mesh_options *options, GError **error) {
  uint64_t vertices, triangles;
  sum_rows(e, &vertices, &triangles);
  uint64_t bytes = tc_mesh_bytes(vertices, triangles, options->normals);
  if (options->max_bytes && bytes > options->max_bytes) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "isosurface: %.1f million triangles take %.0f MiB, %.0f MiB are allowed",
                 (double)triangles * 1e-6, (double)bytes / 0x1p20, (double)options->max_bytes / 0x1p20);
    return false;
  }
  e->mesh = tc_mesh_new(vertices, triangles, options->normals, error);
  if (!e->mesh) return false;
  tc_volume_index_to_lps(e->volume, e->middle, e->mesh->origin);
  return tc_pool_run(options->pool, e->dims[2], fill_plane, e) || tc_halt_say(tc_pool_halt(options->pool), error);
}

static bool extract(extraction *e, const tc_mesh_options *options, GError **error) {
  size_t rows = (size_t)e->dims[1] * (size_t)e->dims[2];
  e->rows = malloc(rows * sizeof *e->rows);
  e->inside = malloc(rows * (size_t)e->words * sizeof *e->inside);
  if (!e->rows || !e->inside) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "isosurface: out of memory");
    return false;
  }
  if (!tc_pool_run(options->pool, e->dims[2], find_inside, e) ||
      !tc_pool_run(options->pool, e->dims[2], count_plane, e))
    return tc_halt_say(tc_pool_halt(options->pool), error);
  return make_mesh(e, options, error);
}

tc_mesh *tc_mesh_extract(const tc_volume *volume, double iso, const tc_mesh_options *options, GError **error) {
  extraction e;
  if (!isfinite(iso)) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "isosurface: a finite value is wanted");
    return NULL;
  }
  set_up(&e, volume, iso);
  if (e.dims[0] < 2 || e.dims[1] < 2 || e.dims[2] < 2) return tc_mesh_new(0, 0, options->normals, error); /* no cells */
  bool made = extract(&e, options, error);
  free(e.rows);
  free(e.inside);
  if (!made) {
    tc_mesh_free(e.mesh);
    return NULL;
  }
  if (left_handed(&e)) turn_over(e.mesh);
  return e.mesh;
}
