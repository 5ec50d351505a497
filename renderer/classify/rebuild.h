/* Building a table after an edit of the transfer function. */
#ifndef TC_CLASSIFY_REBUILD_H
#define TC_CLASSIFY_REBUILD_H

#include "renderer/classify/classify.h"

/* As tc_table_build(). Segments over values where nothing changed since `like` (any table, or NULL; of the same nodes,
 * length and bits to be of use) are copied from there: the result is the same to the last bit. */
tc_table *tc_table_rebuild(const tc_table_params *params, const tc_table *like, tc_pool *pool, GError **error);

#endif
