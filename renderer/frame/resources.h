/* What frames read beside the volume (plan.h lists it): built on first need, shared by every scene that needs the same,
 * dropped least recently used first when it outgrows the budget. One thread at a time (the render thread). What a call
 * returns lives until the next call that builds something of the same kind; a frame asks for all it needs once.
 *
 * Building stops at the halt of the pool, which the error then says. What takes long (coefficients, min-max blocks, boxes,
 * the entries of tables) is kept as far as it is, and the next call that asks for the same goes on with it.
 *
 * resource_kinds.h says for each kind what it is made from, and how. */
#ifndef TC_RENDERER_RESOURCES_H
#define TC_RENDERER_RESOURCES_H

#include "renderer/frame/backend.h"

typedef struct tc_resources tc_resources;

tc_resources *tc_resources_new(tc_pool *pool, uint64_t budget_bytes, GError **error);
void tc_resources_free(tc_resources *resources); /* NULL is fine */

/* Finds what the job reads of this kind, or builds it from what the job has so far, and adds to *ms what that took.
 * ms NULL: builds nothing, and what is not there now is NULL without an error. */
const void *tc_resources_get(tc_resources *r, tc_resource which, const tc_frame_job *job, double *ms, GError **error);

/* A back end took this long over something of r. */
void tc_resources_took(tc_resources *r, tc_resource which, const void *thing, double ms);
/* What building something of r took so far. */
double tc_resources_ms(const tc_resources *r, tc_resource which, const void *thing);

/* Between frames: takes over what was made beside of something of r; with `begin`, begins it where it was not and there is
 * memory for it. Refined things are as good and quicker to draw. */
void tc_resources_refine(tc_resources *r, tc_resource which, const void *thing, bool begin);

/* Grows with everything that is built, and with every part of it. */
int64_t tc_resources_steps(const tc_resources *resources);

uint64_t tc_resources_held(const tc_resources *r);
uint64_t tc_resources_spare(const tc_resources *r); /* of what there is at all */
/* What there is at all from now on; the budget is as it was, or this where it is less. Drops what is over it, least
 * recently used first. */
void tc_resources_limit(tc_resources *r, uint64_t most_bytes);
/* Bytes of what did not fit under it, where that was what failed last; 0 then until the next failure. */
uint64_t tc_resources_wanted(tc_resources *r);

/* Drops what belongs to a volume, and to its coefficients, whose serial it gives back (0: there were none). */
uint64_t tc_resources_forget(tc_resources *r, uint64_t volume_serial);
/* Drops surfaces with one of this mesh among them. */
void tc_resources_forget_mesh(tc_resources *r, uint64_t mesh_serial);

#endif
