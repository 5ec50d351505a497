/* Pre-integration: the table that gives colour and opacity of ray segments under a transfer function.
 *
 * The full pre-integration table (NUMERICS sections 2 and 3) for one segment length d. Node j of the value axis is the
 * voxel value lo + j * (hi - lo) / (n - 1), so data span nodes 0 .. n-1; one additional node lets a bilinear look-up at
 * the end read without a test. The table is stored by diagonals, because a diagonal is built at once, and look-ups stay
 * within a few adjacent rows, since neighbouring samples differ little:
 *   row(k), k = node(sb) - node(sf) signed, holds at column i = min(node(sf), node(sb))
 *   (R, G, B, alpha): colour with self-attenuation (premultiplied) and opacity of the segment.
 * A lookup at real (ef, eb) = (node(sf), node(sb)): i = min(ef, eb), k = |eb - ef|, bilinear over (k, i) within the
 * half table of eb - ef's sign. Colours are in the compositing space (display sRGB, or linear light).
 *
 * Row k = n + 2, the row of depths, holds optical depths for stiff segments, whose opacity rounds to 1 in single
 * precision. The depth of a segment of length d from ef to eb is the mean over [ef, eb] of a function that is linear in
 * each node interval. Entry j is (H, L, a, b): a and b are that function at both ends of interval j, H + L (high and
 * low part) its integral from node 0 to j.
 *
 * Subtables are further tables of the same kind on ever narrower windows of the value axis (each at most 16 times
 * narrower), for knots that are closer than nodes can resolve. A segment is looked up in the last subtable that contains
 * both of its ends, else in the table itself. If a finer subtable contains just one end, inside its rims, the opacity is
 * composed from the depths of the parts inside and outside. A window extends 24 of its parent's nodes beyond its
 * knots, or 16 or 8 if it would otherwise take more subtables than allowed. */
#ifndef TC_CLASSIFY_PREINTEGRATION_H
#define TC_CLASSIFY_PREINTEGRATION_H

#include "renderer/base/pool.h"
#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

#define TC_MAX_SUBTABLES 7
/* How far a steep change may be displaced: voxel values, or a share of the range of floats. */
#define TC_EDGE_UNITS 8
#define TC_EDGE_SHARE 1e-4
#define TC_SUBTABLE_NODES 256
/* Optical depth of a full segment from which on opacity correction uses the row of depths. Below it, the opacity in
 * single precision gives the transparency of any share of the segment to 1.3e-4. */
#define TC_STIFF_DEPTH 11.0

/* A window of the value axis: voxel values (not rescaled) of its nodes 0 and TC_SUBTABLE_NODES - 1. */
typedef struct tc_subtable {
  double lo, hi;
  double rim; /* margin at either end, in nodes of the subtable; it stays more than two nodes of the parent away from
                 the subtable's knots */
} tc_subtable;

typedef struct tc_table {
  int n;             /* nodes within the range of the data */
  int columns;       /* n + 1: entries per row */
  double lo, hi;     /* voxel values (not rescaled) of nodes 0 and n-1; lo < hi */
  double step_mm;    /* segment length */
  int bits;          /* bits that entries are rounded to; 0: not rounded */
  int n_subtables;       /* coarse ones before finer ones */
  tc_subtable subtables[TC_MAX_SUBTABLES];
  /* entries before the row k = 0 of the table, and of each subtable; subtables follow the table, in rows of TC_SUBTABLE_NODES +
   * 2 columns */
  size_t starts[1 + TC_MAX_SUBTABLES];
  size_t bytes;      /* of all entries */
  float *entries;    /* [2*(n+1)+2][columns][4], then the subtables; zero outside i + |k| <= n, except in the row of depths. NULL in an
                        outline */
  float *zero_row;   /* row k = 0 of the table and of each subtable; NULL in an outline */
  float *subtable_rows[TC_MAX_SUBTABLES];
  uint64_t serial;   /* unique in the process; keys copies on a GPU */
  double build_ms;   /* build time so far */
} tc_table;

typedef struct tc_table_params {
  const tc_transfer_function *tf;
  double slope, intercept;      /* voxel -> value */
  double voxel_lo, voxel_hi;    /* range of the nodes */
  int n;
  double step_mm;
  bool linear_light;
  /* for measurements, entries are rounded to 8 (fixed point) or 16 (half float) bits; 0 = single precision */
  int bits;
  int n_subtables;
  tc_subtable subtables[TC_MAX_SUBTABLES];
} tc_table_params;

/* Chooses the nodes for p->tf over a volume, the voxel range they span, and the subtables: 256 nodes over the whole type
 * for 8-bit data; else 256 to 2048 over the data's range, depending on the distance of the knots, fewer if subtables
 * suffice. *complete, unless NULL: true if nodes and subtables resolve every knot.
 *
 * Accuracy of a complete choice, for voxels of more than 8 bits: the distance of nodes is at most a quarter of the
 * width of a change between two knots, of the distance to the next change back, or of the part of a rise of extinction
 * that turns a voxel from transparent to opaque. A steeper isolated change may be displaced by TC_EDGE_UNITS or
 * TC_EDGE_SHARE, and colours inside it are widened by as much. Apart from that, rays of up to seven segments of half a
 * voxel, through a field that is linear along the ray, near any knot and at any rate of change, have an error in
 * opacity and colour of at most 1/15; averaged over the sample positions at most 1/30, in 19 of 20 transfer functions
 * 1/100, in half of them 1/2500 (measured: tests/unit/test_preintegration_choice.c; the worst rays linger in the bend
 * at the foot of a dense rise, or end inside a peak of several colours). */
void tc_table_choose(const tc_volume *volume, tc_table_params *p, bool *complete);

/* Sets only the subtables, for a given p->n and range of nodes. */
void tc_table_subtables(const tc_volume *volume, tc_table_params *p, bool *complete);

/* Builds the table on the pool (NULL: on the calling thread); the caller frees. NULL with TC_ERROR_MEMORY. */
tc_table *tc_table_build(const tc_table_params *params, tc_pool *pool, GError **error);
void tc_table_free(tc_table *table); /* NULL is fine */

/* A table entry (0..1) after storage in 8-bit fixed point (bits 8) or half float (16). */
float tc_table_round(float entry, int bits);

#endif
