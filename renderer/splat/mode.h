/* Mode splat of a scene over a volume: drawn by the pool; and what its pixels show. */
#ifndef TC_SPLAT_MODE_H
#define TC_SPLAT_MODE_H

#include "renderer/frame/backend.h"

/* A tc_drawer. */
bool tc_splat_mode_draw(tc_pool *pool, const tc_frame_job *job, GError **error);

#endif
