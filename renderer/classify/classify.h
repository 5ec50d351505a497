/* Classification: from a transfer function to what kernels look up.
 *
 * The full pre-integration table (paper 000, eq. 7 and 8; NUMERICS sections 2 and 3) for one segment length d. Node j
 * of the value axis is the voxel value lo + j * (hi - lo) / (n - 1), so data span nodes 0 .. n-1; one more node beyond
 * lets a bilinear lookup at the end read without a test. The table is stored along its diagonals, because a diagonal is
 * what is built at once and because the differences that occur in data are small, so the rows in use are few and near
 * each other:
 *   row(k), k = node(sb) - node(sf) signed, holds at column i = min(node(sf), node(sb))
 *   (R, G, B, alpha): colour with self-attenuation (premultiplied) and opacity of the segment.
 * A lookup at real (ef, eb) = (node(sf), node(sb)): i = min(ef, eb), k = |eb - ef|, bilinear over (k, i) within the
 * half table of eb - ef's sign. Colours are in the compositing space (display sRGB, or linear light).
 *
 * Row k = n + 2 holds depths, for what opacity in single precision does not tell of a stiff segment: of a segment of
 * length d from ef to eb the optical depth is the mean over that span of a function that is linear in each node
 * interval. Entry j: (H, L, a, b) with a and b its ends in the interval j, H + L its integral from node 0 to j.
 *
 * Zooms: where knots stand closer than nodes can tell apart, further tables of the same kind stand on ever narrower
 * windows of the value axis (at most 16 times each). A segment is looked up in the last zoom that holds both of its
 * ends, else in the table itself; where a finer one holds but one of them, inside its rims, the opacity is that of the
 * parts inside and outside of it, by their depths. A window reaches 24 of its parent's nodes beyond the knots it is
 * for, or 16 or 8 where that would take more zooms than there may be. */
#ifndef TC_CLASSIFY_H
#define TC_CLASSIFY_H

#include "renderer/pool.h"
#include "renderer/scene.h"
#include "renderer/volume/volume.h"

#define TC_MAX_ZOOMS 7
#define TC_EDGE_UNITS 8     /* voxel values, or */
#define TC_EDGE_SHARE 1e-4 /* of the range of floats: how far off a steep change is still where it should be */
#define TC_ZOOM_NODES 256
/* Depth of a full segment from which on part of it is cut by the row of depths: below, an opacity in single precision
 * gives the transparency of any share of the segment to 1.3e-4. */
#define TC_STIFF_DEPTH 11.0

/* A window of the value axis: voxel values (not rescaled) of its nodes 0 and TC_ZOOM_NODES - 1. */
typedef struct tc_zoom {
  double lo, hi;
  double rim; /* of its nodes, at either end: these are more than two of its parent's away from the knots it is for */
} tc_zoom;

typedef struct tc_table {
  int n;             /* nodes that data reach */
  int columns;       /* n + 1: floats per row / 4 */
  double lo, hi;     /* voxel values (not rescaled) of nodes 0 and n-1; lo < hi */
  double step_mm;    /* segment length */
  int bits;          /* entries are rounded to this; 0: not at all */
  int n_zooms;       /* coarse before fine */
  tc_zoom zooms[TC_MAX_ZOOMS];
  /* how many entries lie before the row of k = 0: the table's own, and its zooms', which lie behind the table, in rows
   * of TC_ZOOM_NODES + 2 columns */
  size_t starts[1 + TC_MAX_ZOOMS];
  size_t bytes;      /* of all entries, wherever they are */
  float *entries;    /* [2*(n+1)+2][columns][4], then the zooms; outside i + |k| <= n zero, but for
                        the row of depths. NULL in an outline */
  float *zero_row;   /* row of k = 0, and the zooms': NULL likewise */
  float *zoom_rows[TC_MAX_ZOOMS];
  uint64_t serial;   /* unique in the process; keys copies on a GPU */
  double build_ms;   /* what it took so far */
} tc_table;

typedef struct tc_table_params {
  const tc_transfer_function *tf;
  double slope, intercept;      /* voxel -> value */
  double voxel_lo, voxel_hi;    /* range the nodes span */
  int n;
  double step_mm;
  bool linear_light;
  /* entries rounded to this: 8 (of 1), 16 (half floats); 0 = single precision as they are. For measurements */
  int bits;
  int n_zooms;
  tc_zoom zooms[TC_MAX_ZOOMS];
} tc_table_params;

/* Fills in how many nodes p->tf wants over a volume, the voxel range they span, and the zooms: 256 nodes over the whole
 * type for 8-bit data; else 256 to 2048 over the data's range by the distance of the knots, less where zooms serve.
 * *complete, unless NULL: whether nodes and zooms resolve every knot.
 *
 * What the choice and its zooms promise, where they are complete and voxels have more than 8 bits. A change between
 * two knots is told from none at a quarter of its own width, of the way to the next change back, or of the part of a
 * rise of extinction that turns a voxel from clear to opaque. One that is steeper than that, with nothing near, is
 * seen up to TC_EDGE_UNITS or TC_EDGE_SHARE from its place, and colours inside it as wide. But for that, rays of up to
 * seven segments of half a voxel through a field that is linear along them, about any knot and at any rate of change,
 * are off in opacity and colours by at most 1/15, as a mean over where samples fall by at most 1/30, in 19 of 20
 * transfer functions by 1/100, in half of them by 1/2500 (measured, tests/unit/test_table_choice.c; the worst dwell in
 * the bend at the foot of a dense rise, or end inside a peak of several colours). */
void tc_table_choose(const tc_volume *volume, tc_table_params *p, bool *complete);

/* The zooms of a table of n nodes; returns how many. */
int tc_table_zooms(const tc_volume *volume, const tc_transfer_function *tf, int n, double voxel_lo, double voxel_hi,
                   tc_zoom zooms[TC_MAX_ZOOMS], bool *complete);

/* Builds the table on the pool (NULL: on the caller). Out of memory gives NULL with TC_ERROR_MEMORY. */
tc_table *tc_table_build(const tc_table_params *params, tc_pool *pool, GError **error);
void tc_table_free(tc_table *table); /* NULL is fine */

/* What storing a table entry (0..1) in 8-bit fixed point or in half floats would leave of it. */
float tc_table_round(float entry, int bits);

/* Extinction (1/mm) at a value, and its mean over [a, b] (exact per knot interval; a == b gives tau(a)). */
double tc_extinction(const tc_transfer_function *tf, double value);
double tc_extinction_mean(const tc_transfer_function *tf, double a, double b);
double tc_extinction_most(const tc_transfer_function *tf);
/* Colour at a value, sRGB 0..1. */
void tc_color(const tc_transfer_function *tf, double value, double rgb[3]);

#define TC_LIGHT_STEPS 4096 /* of tables of these */
double tc_srgb_to_linear(double c);
double tc_linear_to_srgb(double c);

#endif
