/* Size of the resources a renderer keeps between frames. Same thread rule as tc_render(). */
#ifndef TC_RENDERER_CACHE_H
#define TC_RENDERER_CACHE_H

#include "renderer/tomocast.h"

/* Bytes of tables, coefficients and structures held now. */
uint64_t tc_renderer_cached(const tc_renderer *renderer);

/* Evicts least recently used resources until at most most_bytes are held. */
void tc_renderer_trim_cache(tc_renderer *renderer, uint64_t most_bytes);

#endif
