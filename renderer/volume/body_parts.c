#include "renderer/volume/body_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Cells along the median of the volume's three extents. */
#define CELLS 128
/* Smallest share of a removed part's cells that are outside the body. */
#define OUTSIDE 0.6
/* Thickness of a shell in cells, at most. */
#define THIN_CELLS 2.5
/* Largest share of deep cells (is_deep()) of a removed part: an arm has more, a table with rails has fewer. */
#define DEEP 0.1
/* A board: thickness relative to the larger of the body's thickness and the board's width, at most; width relative to
 * the body's, at least. */
#define THIN 0.2
#define WIDE 0.4
/* A removed part that touches the body: smallest share of its cells behind the whole body; smallest width relative to
 * the body's. */
#define BEHIND 0.4
#define LARGE 0.25
/* A certain table: smallest extent relative to the largest, and share of its surface that touches the body; both at
 * most. */
#define FLAT 0.4
#define TOUCHING 0.08
/* A sheet: smallest extent relative to the largest, at most. */
#define SHEET 0.1
/* Width in cells of the body's soft edge. */
#define EDGE_CELLS 2
/* A board, or a thin and wide part, is also removed if at most this share of its surface touches the body: the chest
 * wall is connected all around. */
#define BARELY 0.025

/* Smallest share of the dense cells that the opened body keeps. With less, the object is not solid (a dry skull), and
 * the opening is undone. */
#define SOLID 0.75

/* Further classes of cells, used only while parts are found. */
enum { EDGE = TC_CELL_HIDDEN + 1, CORE, OTHER, REST, LEFT, THICK, PART };

typedef struct span {
  int16_t first, last;
} span;

typedef struct finder {
  tc_body_parts *p;
  size_t count;
  uint8_t *marks, *scratch; /* [count] */
  uint8_t *soft;            /* [count]: soft cells that are not the body's edge */
  uint32_t *queue;          /* [count]: the cells of a part */
  span *rows, *columns;     /* [n2 * n1], [n2 * n0]: the body's extent along x and y */
  span *slices;             /* [n2]: the body's extent along y */
  bool solid;               /* the body is the result of the opening */
  double thickness, width;  /* of the body, mm: thickness_of() and extent_of() */
  bool (*goes_on)(void *user);
  void *user;
} finder;

typedef struct part {
  size_t cells, outside, under, behind, deep;
  int low[3], high[3];
  double surface, contact; /* mm2: whole surface, and the share in contact with kept cells */
} part;

static int by_size(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

static double middle_of(double a, double b, double c) {
  double sorted[3] = {a, b, c};
  qsort(sorted, 3, sizeof *sorted, by_size);
  return sorted[1];
}

static size_t cells_of(const tc_body_parts *p) { return p->stride[2] * (size_t)(p->n[2] + 2); }

/* Direction of the y axis along the patient's anterior-posterior axis, 1 to the back; 0 if it is not along that
 * axis. */
static int back_of(const double direction[9]) { return fabs(direction[4]) < 0.7 ? 0 : direction[4] > 0 ? 1 : -1; }

bool tc_body_parts_init(tc_body_parts *parts, const tc_volume *volume) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const double *mm = d->spacing;
  const double side = middle_of(d->dims[0] * mm[0], d->dims[1] * mm[1], d->dims[2] * mm[2]) / CELLS;
  for (int k = 0; k < 3; k++) {
    const double voxels = fmin(fmax(rint(side / mm[k]), 1), d->dims[k]);
    parts->voxels[k] = (int)voxels;
    parts->side[k] = voxels * mm[k];
    parts->n[k] = (d->dims[k] - 1) / parts->voxels[k] + 1;
    parts->stride[k] = k ? parts->stride[k - 1] * (size_t)(parts->n[k - 1] + 2) : 1;
  }
  parts->back = back_of(d->direction);
  const bool few = parts->n[0] < INT16_MAX && parts->n[1] < INT16_MAX && cells_of(parts) <= UINT32_MAX;
  parts->cells = few ? malloc(cells_of(parts)) : NULL;
  if (!parts->cells) return false;
  memset(parts->cells, EDGE, cells_of(parts));
  for (int z = 0; z < parts->n[2]; z++)
    for (int y = 0; y < parts->n[1]; y++) memset(tc_body_parts_row(parts, y, z), TC_CELL_AIR, (size_t)parts->n[0]);
  return true;
}

void tc_body_parts_finish(tc_body_parts *parts) {
  free(parts->cells);
  parts->cells = NULL;
}

/* ---- neighbours ---- */

/* Marks the cells of a class and their 26 neighbours (a dilation). */
static void mark_around(finder *f, uint8_t place) {
  for (size_t i = 0; i < f->count; i++) f->marks[i] = f->p->cells[i] == place;
  for (int k = 0; k < 3; k++) {
    const size_t stride = f->p->stride[k];
    const uint8_t *from = f->marks;
    uint8_t *to = f->scratch;
    memcpy(to, from, f->count);
    for (size_t i = stride; i + stride < f->count; i++) to[i] = from[i] | from[i - stride] | from[i + stride];
    f->scratch = f->marks;
    f->marks = to;
  }
}

static void place_of(const finder *f, size_t i, int at[3]) {
  for (int k = 2; k >= 0; i %= f->p->stride[k--]) at[k] = (int)(i / f->p->stride[k]) - 1;
}

/* Flood fill: moves the connected cells of one class to another and lists them in the queue. Returns their number. */
static size_t flood(finder *f, size_t seed, uint8_t from, uint8_t to) {
  uint8_t *cells = f->p->cells;
  const size_t *stride = f->p->stride;
  size_t count = 0;
  cells[seed] = to;
  f->queue[count++] = (uint32_t)seed;
  for (size_t done = 0; done < count; done++) {
    const size_t i = f->queue[done];
    const size_t next[6] = {i - 1, i + 1, i - stride[1], i + stride[1], i - stride[2], i + stride[2]};
    for (int k = 0; k < 6; k++) {
      if (cells[next[k]] != from) continue;
      cells[next[k]] = to;
      f->queue[count++] = (uint32_t)next[k];
    }
  }
  return count;
}

/* ---- the body ---- */

static void find_cores(finder *f, uint8_t place) {
  mark_around(f, TC_CELL_AIR);
  for (size_t i = 0; i < f->count; i++)
    if (f->p->cells[i] == place && !f->marks[i]) f->p->cells[i] = CORE;
}

/* Dilates the cores within the cells of a class, and moves cores and added cells to class `grown`. */
static void grow_cores(finder *f, uint8_t place, uint8_t grown) {
  uint8_t *cells = f->p->cells;
  mark_around(f, CORE);
  for (size_t i = 0; i < f->count; i++)
    if (cells[i] == CORE || (f->marks[i] && cells[i] == place)) cells[i] = grown;
}

/* Moves all cells of one class to another. Returns their number. */
static size_t move_all(finder *f, uint8_t from, uint8_t to) {
  size_t moved = 0;
  for (size_t i = 0; i < f->count; i++) {
    if (f->p->cells[i] != from) continue;
    f->p->cells[i] = to;
    moved++;
  }
  return moved;
}

/* Soft cells next to the body are its edge; the other soft cells may belong to a table. */
static void take_edge(finder *f) {
  for (int i = 0; i < EDGE_CELLS; i++) {
    mark_around(f, TC_CELL_KEPT);
    for (size_t j = 0; j < f->count; j++)
      if (f->marks[j] && f->p->cells[j] == TC_CELL_SOFT) f->p->cells[j] = TC_CELL_KEPT;
  }
  for (size_t j = 0; j < f->count; j++) f->soft[j] = f->p->cells[j] == TC_CELL_SOFT;
  move_all(f, TC_CELL_SOFT, REST);
}

/* The body: the largest core, dilated, or if that is not solid the whole connected component. Other dense cells become
 * REST. False: there is no core. */
static bool find_body(finder *f) {
  size_t most = 0, seed = 0;
  find_cores(f, TC_CELL_DENSE);
  for (size_t i = 0; i < f->count; i++) {
    if (f->p->cells[i] != CORE) continue;
    const size_t size = flood(f, i, CORE, OTHER);
    if (size > most) most = size, seed = i;
  }
  if (!most) return false;
  flood(f, seed, OTHER, CORE);
  move_all(f, OTHER, TC_CELL_DENSE);
  grow_cores(f, TC_CELL_DENSE, THICK);
  const double body = (double)move_all(f, THICK, TC_CELL_KEPT), rest = (double)move_all(f, TC_CELL_DENSE, REST);
  f->solid = body >= SOLID * (body + rest);
  if (!f->solid) {
    move_all(f, TC_CELL_KEPT, REST);
    flood(f, seed, REST, TC_CELL_KEPT);
  }
  take_edge(f);
  return true;
}

/* ---- parts ---- */

static void widen_span(span *s, int at) {
  if (at < s->first) s->first = (int16_t)at;
  if (at > s->last) s->last = (int16_t)at;
}

/* Extent of a part along axis k, mm. */
static double extent_along(const finder *f, const part *a, int k) {
  return (a->high[k] - a->low[k] + 1) * f->p->side[k];
}

static double extent_of(const finder *f, const part *a) {
  return middle_of(extent_along(f, a, 0), extent_along(f, a, 1), extent_along(f, a, 2));
}

/* Twice the volume over the surface, mm: the thickness of a sheet. */
static double thickness_of(const finder *f, const part *a) {
  const double *side = f->p->side;
  return 2 * (double)a->cells * side[0] * side[1] * side[2] / a->surface;
}

/* Adds a cell of a part whose cells are of `place`. */
static void add_cell(const finder *f, size_t i, const int at[3], uint8_t place, part *a) {
  const double *side = f->p->side, face[3] = {side[1] * side[2], side[0] * side[2], side[0] * side[1]};
  a->cells++;
  for (int k = 0; k < 3; k++) {
    const uint8_t before = f->p->cells[i - f->p->stride[k]], after = f->p->cells[i + f->p->stride[k]];
    a->surface += face[k] * ((before != place) + (after != place));
    a->contact += face[k] * ((before == TC_CELL_KEPT) + (after == TC_CELL_KEPT));
    if (at[k] < a->low[k]) a->low[k] = at[k];
    if (at[k] > a->high[k]) a->high[k] = at[k];
  }
}

/* True if along each axis, in both directions, the next two cells belong to the part or lie outside the volume. */
static bool is_deep(const finder *f, size_t i, uint8_t place) {
  for (int k = 0; k < 6; k++) {
    const size_t stride = f->p->stride[k / 2], next = k % 2 ? i + stride : i - stride;
    if (f->p->cells[next] == EDGE) continue;
    const uint8_t after = f->p->cells[k % 2 ? next + stride : next - stride];
    if (f->p->cells[next] != place || (after != place && after != EDGE)) return false;
  }
  return true;
}

static part no_part(void) { return (part){.low = {INT32_MAX, INT32_MAX, INT32_MAX}, .high = {-1, -1, -1}}; }

/* Repeats the extents of the body's first and last slice beyond them, so that a table that continues there is not
 * counted as outside merely for lack of a body. */
static void extend_body(finder *f, int low, int high) {
  const size_t rows = (size_t)f->p->n[1], columns = (size_t)f->p->n[0];
  for (int z = 0; z < f->p->n[2]; z++) {
    const int from = z < low ? low : z > high ? high : z;
    if (from == z) continue;
    memcpy(f->rows + (size_t)z * rows, f->rows + (size_t)from * rows, rows * sizeof(span));
    memcpy(f->columns + (size_t)z * columns, f->columns + (size_t)from * columns, columns * sizeof(span));
    f->slices[z] = f->slices[from];
  }
}

/* Extents of the body: of each row along x, of each column and each slice along y. */
static void measure_body(finder *f) {
  const int *n = f->p->n;
  const span none = {INT16_MAX, INT16_MIN};
  part a = no_part();
  for (int i = 0; i < n[1] * n[2]; i++) f->rows[i] = none;
  for (int i = 0; i < n[0] * n[2]; i++) f->columns[i] = none;
  for (int z = 0; z < n[2]; z++) {
    f->slices[z] = none;
    for (int y = 0; y < n[1]; y++) {
      const uint8_t *cells = tc_body_parts_row(f->p, y, z);
      for (int x = 0; x < n[0]; x++) {
        if (cells[x] != TC_CELL_KEPT) continue;
        widen_span(&f->rows[z * n[1] + y], x);
        widen_span(&f->columns[z * n[0] + x], y);
        widen_span(&f->slices[z], y);
        add_cell(f, (size_t)(cells + x - f->p->cells), (const int[]){x, y, z}, TC_CELL_KEPT, &a);
      }
    }
  }
  extend_body(f, a.low[2], a.high[2]);
  f->thickness = thickness_of(f, &a);
  f->width = extent_of(f, &a);
}

static bool is_beyond(span s, int at) { return at < s.first || at > s.last; }

static bool is_outside(const finder *f, const int at[3]) {
  const int *n = f->p->n;
  return is_beyond(f->rows[at[2] * n[1] + at[1]], at[0]) || is_beyond(f->columns[at[2] * n[0] + at[0]], at[1]);
}

static bool is_behind(const finder *f, span s, int at) {
  return f->p->back > 0 ? at > s.last : f->p->back < 0 && at < s.first;
}

/* Measures the part whose cells are in the queue. */
static part measure(const finder *f, size_t cells) {
  part a = no_part();
  for (size_t j = 0; j < cells; j++) {
    int at[3];
    place_of(f, f->queue[j], at);
    add_cell(f, f->queue[j], at, PART, &a);
    a.deep += is_deep(f, f->queue[j], PART);
    a.outside += is_outside(f, at);
    a.under += is_behind(f, f->columns[at[2] * f->p->n[0] + at[0]], at[1]);
    a.behind += is_behind(f, f->slices[at[2]], at[1]);
  }
  return a;
}

static bool is_board(const finder *f, const part *a) {
  const double width = extent_of(f, a);
  return thickness_of(f, a) < THIN * fmax(f->thickness, width) && width >= WIDE * f->width;
}

/* Smallest extent relative to the largest. */
static double flatness_of(const finder *f, const part *a) {
  const double x = extent_along(f, a, 0), y = extent_along(f, a, 1), z = extent_along(f, a, 2);
  return fmin(fmin(x, y), z) / fmax(fmax(x, y), z);
}

/* A flat sheet behind the body: a table top, however much of the body lies on it. */
static bool is_sheet(const finder *f, const part *a) {
  const double width = extent_of(f, a);
  return flatness_of(f, a) < SHEET && width >= LARGE * f->width && thickness_of(f, a) < THIN * width &&
         (double)a->under >= OUTSIDE * (double)a->cells;
}

/* Criteria that no branch, bone or vessel meets: wide and flat, behind the body and hardly in contact with it; if the
 * body is not solid, completely behind and not in contact. */
static bool is_table(const finder *f, const part *a) {
  const double behind = f->solid ? 0.5 : 1, touching = f->solid ? TOUCHING : 0, wide = f->solid ? LARGE : WIDE;
  return extent_of(f, a) >= wide * f->width && flatness_of(f, a) < FLAT &&
         (double)a->behind >= behind * (double)a->cells && a->contact <= touching * a->surface;
}

static bool goes(const finder *f, const part *a, uint8_t place) {
  const double cells = (double)a->cells, *side = f->p->side;
  const bool board = is_board(f, a), thin = thickness_of(f, a) < THIN_CELLS * middle_of(side[0], side[1], side[2]);
  if ((double)a->outside < OUTSIDE * cells || (double)a->deep > DEEP * cells) return false;
  if (f->p->strict && !is_table(f, a)) return false;
  if (place == THICK) return board;
  const bool wide = fmax(extent_along(f, a, 0), extent_along(f, a, 1)) >= WIDE * f->width;
  if (is_sheet(f, a) || (a->contact <= BARELY * a->surface && (board || (thin && wide)))) return true;
  if (a->contact > 0) return (double)a->behind >= BEHIND * cells && extent_of(f, a) >= LARGE * f->width;
  return thin;
}

/* Moves each connected part of a class to TC_CELL_HIDDEN or to `otherwise`. Returns whether any is hidden. */
static bool choose(finder *f, uint8_t place, uint8_t otherwise) {
  bool hidden = false;
  for (size_t i = 0; i < f->count; i++) {
    if (f->p->cells[i] != place) continue;
    const size_t cells = flood(f, i, place, PART);
    const part a = measure(f, cells);
    const bool hides = goes(f, &a, place);
    for (size_t j = 0; j < cells; j++) f->p->cells[f->queue[j]] = hides ? TC_CELL_HIDDEN : otherwise;
    hidden |= hides;
  }
  return hidden;
}

/* Marks the surroundings of hidden cells, and air outside the body. Foam inside a table and cloth next to the table lie
 * there: they are not dense, but would show in projections. */
static void mark_near(finder *f) {
  mark_around(f, TC_CELL_HIDDEN);
  for (size_t i = 0; i < f->count; i++)
    if (f->marks[i]) f->p->cells[i] |= TC_CELL_NEAR;
  mark_around(f, TC_CELL_KEPT);
  for (size_t i = 0; i < f->count; i++) {
    int at[3];
    if (f->p->cells[i] != TC_CELL_AIR || f->marks[i]) continue;
    place_of(f, i, at);
    if (is_outside(f, at)) f->p->cells[i] |= TC_CELL_NEAR;
  }
}

static bool goes_on(const finder *f) { return !f->goes_on || f->goes_on(f->user); }

/* In a scan with a table, soft parts outside the body are foam and cloth. */
static void hide_soft(finder *f) {
  for (size_t i = 0; i < f->count; i++) {
    int at[3];
    if (f->p->cells[i] != OTHER || !f->soft[i]) continue;
    place_of(f, i, at);
    if (is_outside(f, at)) f->p->cells[i] = TC_CELL_HIDDEN;
  }
}

/* Decides on the connected parts of the rest, first whole and then opened into cores and shells; parts that are not
 * hidden become `stays`. */
static bool choose_all(finder *f, uint8_t stays) {
  bool hidden = choose(f, REST, LEFT);
  find_cores(f, LEFT);
  grow_cores(f, LEFT, THICK);
  hidden |= choose(f, THICK, stays);
  hidden |= choose(f, LEFT, stays);
  return hidden;
}

static bool find(finder *f) {
  if (!goes_on(f) || !find_body(f) || !goes_on(f)) return false;
  measure_body(f);
  bool hidden = !f->p->strict && choose_all(f, TC_CELL_KEPT);
  if (f->p->strict && choose_all(f, OTHER)) {
    hidden = true;
    if (f->solid) hide_soft(f), move_all(f, OTHER, REST);
    f->p->strict = false; /* a table was found: its other parts need not be certain */
    choose_all(f, TC_CELL_KEPT);
    move_all(f, OTHER, TC_CELL_KEPT);
  }
  if (hidden) mark_near(f);
  return hidden && goes_on(f);
}

bool tc_body_parts_find(tc_body_parts *parts, bool (*goes_on)(void *user), void *user) {
  const size_t count = cells_of(parts), slices = (size_t)parts->n[2];
  finder f = {.p = parts,
              .count = count,
              .marks = malloc(count),
              .scratch = malloc(count),
              .soft = malloc(count),
              .queue = malloc(count * sizeof *f.queue),
              .rows = malloc(slices * (size_t)parts->n[1] * sizeof(span)),
              .columns = malloc(slices * (size_t)parts->n[0] * sizeof(span)),
              .slices = malloc(slices * sizeof(span)),
              .goes_on = goes_on,
              .user = user};
  const bool found = f.marks && f.scratch && f.soft && f.queue && f.rows && f.columns && f.slices && find(&f);
  free(f.marks);
  free(f.scratch);
  free(f.soft);
  free(f.queue);
  free(f.rows);
  free(f.columns);
  free(f.slices);
  return found;
}
