/* Building a pre-integration table in two steps: the outline, O(n), and the entries, O(n^2). The back end decides
 * whether the CPU or a GPU makes the entries; both make them from the same pieces of the value axis. */
#ifndef TC_CLASSIFY_OUTLINE_H
#define TC_CLASSIFY_OUTLINE_H

#include "renderer/classify/preintegration.h"

/* A table without entries; free it with tc_table_free(). NULL with TC_ERROR_MEMORY or the error of the halt (NULL:
 * none): an outline takes only some milliseconds, so a halted one starts anew. */
tc_table *tc_table_outline(const tc_table_params *params, const tc_halt *halt, GError **error);

/* Computes the entries of an outline, on the pool (NULL: on the calling thread). like: NULL, or any table; if it has
 * the same nodes, length and bits, entries over unchanged values are copied from it, and the result is the same to the
 * last bit. False with TC_ERROR_MEMORY or the halt's error: the table is still an outline, and another call
 * continues. */
bool tc_table_fill(tc_table *table, const tc_table *like, tc_pool *pool, GError **error);

int64_t tc_table_steps(const tc_table *table); /* progress of the entries, never decreasing */

size_t tc_table_held(const tc_table *table); /* bytes of memory held, including unfinished entries */

/* Inputs of the entries of the table itself (window 0) or of a subtable (1 ..): entry (i, k), k > 0, is the composite
 * of the node intervals i .. i + k - 1, each a segment of 1 / k of the table's length, with colour clamped to opacity
 * times peak. Pointers live as long as the table. */
typedef struct tc_table_window {
  int intervals;         /* node intervals */
  int columns;           /* entries per row */
  size_t start;          /* entries before the row k = 0 */
  const float *diagonal; /* row k = 0, [intervals + 1][4] */
  const float *depths;   /* row of depths (preintegration.h), [intervals + 1][4] */
  float peak[3];         /* the largest value of each channel */
  const uint32_t *first; /* [intervals + 1]: interval j consists of pieces first[j] .. first[j + 1] - 1, in order */
  uint32_t n_pieces;
} tc_table_window;

tc_table_window tc_table_window_of(const tc_table *table, int w);

/* pieces[n_pieces]: both ends of each piece (tc_segments_ends()), with depths for the table's full length. */
void tc_table_window_pieces(const tc_table *table, int w, float (*pieces)[8]);

#endif
