/* Chooses the nodes and subtables of a pre-integration table for a transfer function (preintegration.h). */
#include <math.h>
#include <stdlib.h>

#include "renderer/classify/preintegration.h"
#include "renderer/classify/integrals.h"

/* A change between two knots, and the coarsest node distance that resolves it, in voxel values: a quarter of its
 * width, or, for a steep change, a quarter of the way to the next change back of the same channel (the width of a
 * peak). An isolated steep change may be displaced by TC_EDGE_UNITS or TC_EDGE_SHARE. A long rise of extinction counts
 * only with the part at its thin end that turns a voxel from transparent to opaque. */
typedef struct edge {
  double at, node;
} edge;

#define NODES_PER_WIDTH 4
#define LEAST_RISE 16 /* in widths of a steep edge: a shorter rise counts as an edge */
#define OPAQUE_DEPTH 3 /* optical depth of a voxel beyond which a rise is invisible */
#define MOST_MARGIN 24 /* parent nodes that a subtable extends beyond its edges, fewer if there would be too many subtables */
#define LEAST_MARGIN 8
#define LEAST_GAIN 3
#define BLURRED 2 /* parent nodes over which a look-up blurs a segment's end */

typedef struct edges {
  edge *list;
  size_t count;
} edges;

static double channel(const tc_knot *k, int c) { return c < 3 ? k->color[c] : k->amount; }

/* Narrows the node distance of both edges of a peak. other: the last change of this channel in the opposite direction,
 * or NULL. */
static void pair_edges(edge *here, edge *other) {
  double node = other ? (here->at - other->at) / NODES_PER_WIDTH : 0;
  if (!(node > 0)) return; /* up and down at the same value is invisible */
  here->node = fmin(here->node, node);
  other->node = fmin(other->node, node);
}

static double extinction(const tc_transfer_function *tf, double amount) {
  return tf->kind == TC_KNOT_EXTINCTION ? amount : -log1p(-fmin(amount, 1 - 0x1p-24)) / tf->unit_distance_mm;
}

/* The share of the rise from knot `thin` to knot `thick` over which a voxel becomes opaque; at most 1. */
static double seen_share(const tc_transfer_function *tf, const tc_knot *thin, const tc_knot *thick, double voxel_mm) {
  double least = extinction(tf, thin->amount);
  if (least * voxel_mm > OPAQUE_DEPTH) return 1;
  double rise = tf->kind == TC_KNOT_EXTINCTION
                    ? thick->amount - least
                    : (thick->amount - thin->amount) / (1 - thin->amount) / tf->unit_distance_mm;
  return 1 / fmax(1, rise * voxel_mm);
}

/* Ascending in voxel value, whatever the sign of the slope. */
static void find_edges(const tc_transfer_function *tf, const tc_volume_desc *d, double steep, edges *found) {
  edge *last[4][2] = {{NULL}};
  found->list = calloc(tf->count, sizeof *found->list);
  double *width = calloc(tf->count, sizeof *width);
  if (!found->list || !width) {
    free(width);
    free(found->list);
    found->list = NULL;
    return;
  }
  double voxel_mm = fmin(d->spacing[0], fmin(d->spacing[1], d->spacing[2]));
  for (size_t i = 0; i + 1 < tf->count; i++) {
    const tc_knot *a = &tf->points[d->slope > 0 ? i : tf->count - 1 - i], *b = d->slope > 0 ? a + 1 : a - 1;
    edge *e = &found->list[found->count];
    double lo = (a->value - d->intercept) / d->slope, hi = (b->value - d->intercept) / d->slope;
    *e = (edge){.at = 0.5 * (lo + hi), .node = steep};
    bool changes = false;
    for (int c = 0; c < 4; c++) {
      double rise = channel(b, c) - channel(a, c);
      if (rise == 0 || (c < 3 && a->amount <= 0 && b->amount <= 0)) continue; /* the colour of a transparent range */
      pair_edges(e, last[c][rise < 0]);
      last[c][rise > 0] = e;
      changes = true;
    }
    if (!changes) continue;
    width[found->count] = hi - lo;
    double share = a->amount < b->amount ? seen_share(tf, a, b, voxel_mm) : seen_share(tf, b, a, voxel_mm);
    if (share < 1 && hi - lo > steep * LEAST_RISE) {
      *e = (edge){.at = a->amount < b->amount ? lo : hi};
      width[found->count] *= share;
    }
    found->count++;
  }
  for (size_t i = 0; i < found->count; i++) found->list[i].node = fmax(found->list[i].node, width[i] / NODES_PER_WIDTH);
  free(width);
}

typedef struct choice {
  edges edges;
  tc_subtable *subtables;
  int count, margin;
  bool complete;
} choice;

/* The first edge at or above a voxel value. */
static size_t first_edge(const edges *all, double at) {
  size_t lo = 0, hi = all->count;
  while (lo < hi) {
    size_t middle = lo + (hi - lo) / 2;
    if (all->list[middle].at < at)
      lo = middle + 1;
    else
      hi = middle;
  }
  return lo;
}

/* Adds subtables for the edges in [lo, hi] that nodes `node` apart do not resolve; edges within two margins share a
 * subtable. */
static void add_subtables(choice *z, double lo, double hi, double node) {
  const edge *e = z->edges.list;
  for (size_t i = first_edge(&z->edges, lo); i < z->edges.count && e[i].at <= hi;) {
    if (!(e[i].node < node)) {
      i++;
      continue;
    }
    size_t end = i;
    double first = e[i].at, last = first;
    for (; end < z->edges.count && e[end].at <= hi && e[end].at - last <= 2 * z->margin * node; end++)
      if (e[end].node < node) last = e[end].at;
    i = end;
    tc_subtable window = {.lo = first - z->margin * node, .hi = last + z->margin * node};
    double finer = (window.hi - window.lo) / (TC_SUBTABLE_NODES - 1);
    window.rim = (z->margin - BLURRED) * node / finer;
    /* Nodes closer than this are below the resolution of a voxel value in single precision. */
    bool sharp = finer > 4e-7 * fmax(fabs(window.lo), fabs(window.hi));
    if (finer * LEAST_GAIN > node || !sharp || z->count == TC_MAX_SUBTABLES) {
      z->complete = false;
      continue;
    }
    z->subtables[z->count++] = window;
    add_subtables(z, window.lo, window.hi, finer);
  }
}

/* All subtables of n nodes over [lo, hi], after find_edges(). */
static void add_all_subtables(choice *z, int n, double lo, double hi) {
  z->count = 0;
  z->complete = true;
  if (!z->edges.list) return;
  for (z->margin = MOST_MARGIN; z->margin >= LEAST_MARGIN; z->margin -= LEAST_MARGIN) {
    z->count = 0;
    z->complete = true;
    add_subtables(z, lo, hi, (hi - lo) / (n - 1));
    if (z->complete) break;
  }
}

/* The result has no edges if no subtable is wanted, or out of memory. */
static choice begin_subtables(const tc_volume *volume, tc_table_params *p) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *s = tc_volume_statistics(volume);
  const double lo = p->voxel_lo, hi = p->voxel_hi, range = hi - lo;
  choice z = {.subtables = p->subtables};
  /* No subtable is wanted if all voxels are equal, or the range is near the resolution of single precision. */
  bool wide = s->voxel_max > s->voxel_min && range > 1e-4 * fmax(fabs(lo), fabs(hi));
  if (wide && range < 1e30 && range > 1e-30)
    find_edges(p->tf, d, d->type == TC_F32 ? TC_EDGE_SHARE * range : TC_EDGE_UNITS, &z.edges);
  return z;
}

void tc_table_subtables(const tc_volume *volume, tc_table_params *p, bool *complete) {
  choice z = begin_subtables(volume, p);
  add_all_subtables(&z, p->n, p->voxel_lo, p->voxel_hi);
  free(z.edges.list);
  p->n_subtables = z.count;
  *complete = z.complete;
}

/* The smallest distance of two different knots, in the volume's unit. */
static double knot_distance(const tc_transfer_function *tf) {
  double least = INFINITY;
  for (size_t i = 1; i < tf->count; i++) {
    double d = tf->points[i].value - tf->points[i - 1].value;
    if (d > 0) least = fmin(least, d);
    else return 0; /* a jump */
  }
  return least;
}

/* The number of nodes, before subtables are considered. */
static int nodes_for(const tc_volume *volume, tc_table_params *p) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *s = tc_volume_statistics(volume);
  if (d->type == TC_U8 || d->type == TC_I8) { /* one node per value */
    p->voxel_lo = d->type == TC_U8 ? 0 : -128;
    p->voxel_hi = p->voxel_lo + 255;
    return 256;
  }
  p->voxel_lo = s->voxel_min;
  p->voxel_hi = s->voxel_max > s->voxel_min ? s->voxel_max : s->voxel_min + fmax(1, fabs(s->voxel_min) * 1e-6);
  /* Four nodes between the nearest knots, so that interpolation hardly rounds the corners at knots. */
  double wanted = 4 * fabs(d->slope) * (p->voxel_hi - p->voxel_lo) / knot_distance(p->tf);
  int n = 256;
  while (n < 1024 && n < wanted) n *= 2;
  return n;
}

void tc_table_choose(const tc_volume *volume, tc_table_params *p, bool *complete) {
  const int n = nodes_for(volume, p);
  choice z = begin_subtables(volume, p);
  p->n = n;
  add_all_subtables(&z, n, p->voxel_lo, p->voxel_hi);
  /* If subtables are needed anyway, a smaller table may do as well; if more would be needed than allowed, take a larger
   * table: 134 MB, and some 50 ms to build. */
  if (n > 256 && (z.count || !z.complete)) {
    p->n = 128;
    do add_all_subtables(&z, p->n *= 2, p->voxel_lo, p->voxel_hi);
    while (!z.complete && p->n < 2048);
    if (!z.complete) add_all_subtables(&z, p->n = n, p->voxel_lo, p->voxel_hi);
  }
  free(z.edges.list);
  p->n_subtables = z.count;
  if (complete) *complete = z.complete;
}

void tc_integrals_choose(const tc_volume *volume, tc_table_params *p) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  p->n = nodes_for(volume, p);
  p->n_subtables = 0;
  if (d->type == TC_U8 || d->type == TC_I8) return;
  double range = fabs(d->slope) * (p->voxel_hi - p->voxel_lo);
  /* Sixteen nodes between the nearest knots, if possible. */
  p->n = 1024 * knot_distance(p->tf) > 16 * range ? 1024 : 4096;
}
