/* Elementary segments: one node interval of the value axis each, as colour and opacity. Inside classify/ only.
 *
 * An axis is cut into pieces with linear colour and (nearly) linear extinction, at the knots and finer where opacity
 * bends it. What a segment between two neighbouring nodes shows then has a closed form, or a series where it is
 * thin. */
#ifndef TC_CLASSIFY_SEGMENTS_H
#define TC_CLASSIFY_SEGMENTS_H

#include <xmmintrin.h>

#include "renderer/classify/classify.h"
#include "renderer/halt.h"

typedef float tc_v4 __attribute__((vector_size(16)));
typedef int32_t tc_i4 __attribute__((vector_size(16)));

typedef struct tc_piece tc_piece;
typedef struct tc_quad tc_quad;

/* The axis [lo, hi] in voxel values over nodes 0 .. count - 1, and one interval more. A zeroed one is empty. */
typedef struct tc_segments {
  const tc_table_params *params; /* read by tc_segments_make() alone */
  double lo, hi;
  int count; /* node intervals */
  tc_piece *pieces;
  uint32_t *first; /* [count + 1] into pieces */
  uint32_t n_pieces, capacity;
  tc_quad *quads; /* [count / 4] */
  int most_parts; /* of a stretch between two knots */
  const tc_halt *halt; /* while it is cut */
  bool left;           /* ... which that ended */
} tc_segments;

/* Cuts the axis; false: TC_ERROR_MEMORY, or what the halt (NULL: none) says, and what is there is still to be
 * finished. */
bool tc_segments_make(tc_segments *s, const tc_table_params *params, double lo, double hi, int count,
                      const tc_halt *halt, GError **error);
void tc_segments_finish(tc_segments *s);
size_t tc_segments_bytes(const tc_segments *s); /* memory held */

/* The first and last interval over which two axes of the same nodes differ, in whole quads; false: none does. */
bool tc_segments_compare(const tc_segments *a, const tc_segments *b, int *first, int *last);

/* Intervals from <= j < to as segments of length_mm, towards higher nodes and towards lower ones: premultiplied colour
 * and opacity at forward[j] and backward[j], and at their quads' other members. */
void tc_segments_integrate(const tc_segments *s, double length_mm, int from, int to, tc_v4 *forward, tc_v4 *backward);

/* [count + 1]: at a node the depth of a segment of length_mm per node it spans, summed up to that node (in two parts,
 * high and low, so that differences are exact), and at both ends of the interval that begins there, as far as a line
 * can have its exact mean. */
void tc_segments_depths(const tc_segments *s, double length_mm, tc_v4 *depths);

/* Each piece as its two ends, for other builders: colour and optical depth of length_mm at that end's extinction, in
 * shares of the node interval that the piece takes, so that depth is linear in between; in single precision. */
void tc_segments_ends(const tc_segments *s, double length_mm, float (*ends)[8]);

/* The value (rescaled) at a node, and colour in the compositing space at a value. */
double tc_segments_value(const tc_segments *s, int node);
void tc_segments_color(const tc_table_params *params, double value, double rgb[3]);

/* The knots that decide what is seen between two values, borrowed: there the same as the whole list, and found sooner. */
tc_transfer_function tc_knots_between(const tc_transfer_function *tf, double a, double b);

/* The next knot on the way from one value to another, or `to`. *at: 0 at the start of a way. */
double tc_next_knot(const tc_transfer_function *tf, double from, double to, size_t *at);

/* Not front + (1 - opacity) back: one less a small opacity rounds, and the same way in thousands of like segments. */
static inline tc_v4 tc_v4_over(tc_v4 front, tc_v4 back) { return (front - front[3] * back) + back; }

/* A product that grows: a composite and what its roundings lost (Kahan). Without that thousands of like segments would
 * round the same way: 2e-5 off at 2048 of them, which this keeps under 4e-7 at any number. */
typedef struct tc_product {
  tc_v4 sum, lost;
} tc_product;

static inline void tc_product_grow(tc_product *p, tc_v4 by) {
  by += p->lost;
  tc_v4 sum = p->sum + by;
  p->lost = by - (sum - p->sum);
  p->sum = sum;
}
static inline void tc_put_before(tc_product *p, tc_v4 front) { tc_product_grow(p, front - front[3] * p->sum); }
static inline void tc_put_behind(tc_product *p, tc_v4 back) { tc_product_grow(p, back - p->sum[3] * back); }

/* One instruction each, which the comparison written out does not become. The second one where either is no number. */
static inline tc_v4 tc_v4_lesser(tc_v4 a, tc_v4 b) { return (tc_v4)_mm_min_ps((__m128)a, (__m128)b); }
static inline tc_v4 tc_v4_greater(tc_v4 a, tc_v4 b) { return (tc_v4)_mm_max_ps((__m128)a, (__m128)b); }

#endif
