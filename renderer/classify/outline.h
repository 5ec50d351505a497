/* A table in two steps: what it is made from, O(n), and its entries, O(n^2). Who makes the entries, the cpu or a GPU, is
 * the back end's choice; both make them from the same pieces of the value axis. */
#ifndef TC_CLASSIFY_OUTLINE_H
#define TC_CLASSIFY_OUTLINE_H

#include "renderer/classify/classify.h"

/* A table without entries; tc_table_free() it. NULL with TC_ERROR_MEMORY, or what the halt (NULL: none) says: no part of
 * it is kept then, since it takes some milliseconds only. */
tc_table *tc_table_outline(const tc_table_params *params, const tc_halt *halt, GError **error);

/* Makes the entries of an outline, on the pool (NULL: on the caller). Segments over values where nothing changed since
 * `like` (any table, or NULL; of the same nodes, length and bits, and with entries, to be of use) are copied from there:
 * the result is the same to the last bit. False with TC_ERROR_MEMORY, or what the pool's halt says: it is an outline
 * still, and another call goes on where this one was. */
bool tc_table_fill(tc_table *table, const tc_table *like, tc_pool *pool, GError **error);

int64_t tc_table_steps(const tc_table *table); /* of making its entries, so far: it grows */

size_t tc_table_held(const tc_table *table); /* bytes of memory it takes here: more once it has entries */

/* The table itself (0) or a zoom (1 ..) as it is made: entry (i, k), k > 0, is the composite of the node intervals
 * i .. i + k - 1, each as a segment of 1 / k of the table's length; no colour of it over its opacity times the peak.
 * Pointers live as long as the table. */
typedef struct tc_table_window {
  int intervals;         /* of nodes */
  int columns;           /* of a row */
  size_t start;          /* entries before the row of k = 0 */
  const float *diagonal; /* that row, [intervals + 1][4] */
  const float *depths;   /* and that of k = intervals + 2 (classify.h), [intervals + 1][4] */
  float peak[3];         /* the brightest of each colour */
  const uint32_t *first; /* [intervals + 1]: pieces first[j] .. first[j + 1] - 1 lie one after another in interval j */
  uint32_t n_pieces;
} tc_table_window;

tc_table_window tc_table_window_of(const tc_table *table, int w);

/* [n_pieces]: both ends of each (tc_segments_ends()), depths for the whole of the table's length. */
void tc_table_window_pieces(const tc_table *table, int w, float (*pieces)[8]);

#endif
