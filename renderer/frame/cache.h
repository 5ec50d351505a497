/* Size and limit of the resources a renderer keeps between frames. Same thread rule as tc_render(). */
#ifndef TC_RENDERER_CACHE_H
#define TC_RENDERER_CACHE_H

#include "renderer/tomocast.h"

/* Bytes of tables, coefficients and structures held now. */
uint64_t tc_renderer_cached(const tc_renderer *renderer);

/* Limits what is kept from now on (never above tc_renderer_options.cache_bytes) and drops least recently used resources over
 * it. The resources of a single frame may exceed cache_bytes, but not this limit: TC_ERROR_MEMORY. */
void tc_renderer_limit_cache(tc_renderer *renderer, uint64_t most_bytes);
/* Bytes of the resource that failed so, reported once; else 0. */
uint64_t tc_renderer_wanted(tc_renderer *renderer);

#endif
