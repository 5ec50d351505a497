/* What a renderer keeps between frames: how much it is, and making it less. The render thread's, as tc_render(). */
#ifndef TC_RENDERER_CACHE_H
#define TC_RENDERER_CACHE_H

#include "renderer/tomocast.h"

/* Bytes of tables, coefficients and structures held now. */
uint64_t tc_renderer_cached(const tc_renderer *renderer);

/* Keeps at most this much from now on (never more than tc_renderer_options.cache_bytes) and drops what is over it, least
 * recently used first. What a frame needs at once may pass cache_bytes, but not this: TC_ERROR_MEMORY. */
void tc_renderer_limit_cache(tc_renderer *renderer, uint64_t most_bytes);
/* After such a failure, once: how much it was; else 0. */
uint64_t tc_renderer_wanted(tc_renderer *renderer);

#endif
