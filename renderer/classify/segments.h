/* Elementary segments: colour and opacity over one node interval of the value axis. Private to classify/.
 *
 * The axis is cut into pieces with linear colour and (nearly) linear extinction: at the knots, and finer where
 * opacity knots make extinction curved. Colour and opacity of a segment between neighbouring nodes then have a
 * closed form, or a series if the segment is thin. */
#ifndef TC_CLASSIFY_SEGMENTS_H
#define TC_CLASSIFY_SEGMENTS_H

#include <xmmintrin.h>

#include "renderer/classify/preintegration.h"
#include "renderer/base/halt.h"

typedef float tc_v4 __attribute__((vector_size(16)));
typedef int32_t tc_i4 __attribute__((vector_size(16)));

typedef struct tc_piece tc_piece;
typedef struct tc_quad tc_quad;

/* The value axis [lo, hi] in voxel values over nodes 0 .. count - 1, and one additional interval. Zeroed: empty. */
typedef struct tc_segments {
  const tc_table_params *params; /* read by tc_segments_make() only */
  double lo, hi;
  int count; /* node intervals */
  tc_piece *pieces;
  uint32_t *first; /* [count + 1] into pieces */
  uint32_t n_pieces, capacity;
  tc_quad *quads; /* [count / 4] */
  int most_parts; /* largest number of pieces between two knots */
  const tc_halt *halt; /* during tc_segments_make() */
  bool left;           /* interrupted by the halt */
} tc_segments;

/* Cuts the axis, range = {lo, hi}, into pieces. False with TC_ERROR_MEMORY or the error of the halt (NULL: none); call
 * tc_segments_finish() also then. */
bool tc_segments_make(tc_segments *s, const tc_table_params *params, const double range[2], int count,
                      const tc_halt *halt, GError **error);
void tc_segments_finish(tc_segments *s);
size_t tc_segments_bytes(const tc_segments *s); /* memory held */

/* The first and last interval in which two axes with the same nodes differ, rounded to whole quads. False: equal. */
bool tc_segments_compare(const tc_segments *a, const tc_segments *b, int *first, int *last);

/* Premultiplied colour and opacity of intervals from <= j < to as segments of length_mm: forward[j] towards higher
 * nodes, backward[j] towards lower ones. Whole quads are written, hence also neighbours of the range. */
void tc_segments_integrate(const tc_segments *s, double length_mm, int from, int to, tc_v4 *forward, tc_v4 *backward);

/* Fills depths[count + 1], the row of depths (preintegration.h). Entry j: the optical depth of a segment of length_mm,
 * summed over the node intervals before j (in a high and a low part, so that differences are exact), and the depth at
 * both ends of interval j, as a line with the interval's exact mean. */
void tc_segments_depths(const tc_segments *s, double length_mm, tc_v4 *depths);

/* The two ends of each piece, for the builder on a GPU: colour, and the optical depth of length_mm at the extinction of
 * that end times the piece's share of its node interval, so that depth is linear between the ends. Single precision. */
void tc_segments_ends(const tc_segments *s, double length_mm, float (*ends)[8]);

/* The value (rescaled) at a node, and colour in the compositing space at a value. */
double tc_segments_value(const tc_segments *s, int node);
void tc_segments_color(const tc_table_params *params, double value, double rgb[3]);

/* The knots that determine tf between two values, borrowed: equivalent there to the whole list, and faster to
 * search. */
tc_transfer_function tc_knots_between(const tc_transfer_function *tf, double a, double b);

/* The next knot between from and to, in that direction, or `to`. *at: 0 to begin with. */
double tc_next_knot(const tc_transfer_function *tf, double from, double to, size_t *at);

/* The over operator, without computing 1 - opacity: for a small opacity that rounds in the same direction for thousands
 * of similar segments. */
static inline tc_v4 tc_v4_over(tc_v4 front, tc_v4 back) { return (front - front[3] * back) + back; }

/* A running composite with Kahan summation. Without compensation, thousands of similar segments round in the same
 * direction: an error of 2e-5 after 2048 segments, instead of below 4e-7 for any number. */
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

/* Minimum and maximum, one instruction each. If either operand is NaN, the result is the second one. */
static inline tc_v4 tc_v4_lesser(tc_v4 a, tc_v4 b) { return (tc_v4)_mm_min_ps((__m128)a, (__m128)b); }
static inline tc_v4 tc_v4_greater(tc_v4 a, tc_v4 b) { return (tc_v4)_mm_max_ps((__m128)a, (__m128)b); }

#endif
