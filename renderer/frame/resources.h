/* The resources that frames read in addition to the volume (tc_resource in plan.h): built on demand, shared by all
 * scenes with equal keys, and evicted least recently used first when they exceed the budget. Render thread only. A
 * returned resource lives until the next call that builds one of the same kind; a frame requests each of its resources
 * once.
 *
 * The pool's halt stops a build, with the halt's error. Long builds (coefficients, min-max blocks, boxes, tables,
 * meshes) are kept unfinished, and the next call for the same resource continues them.
 *
 * resource_kinds.h defines how each kind is built. */
#ifndef TC_RENDERER_RESOURCES_H
#define TC_RENDERER_RESOURCES_H

#include "renderer/frame/backend.h"

typedef struct tc_resources tc_resources;

tc_resources *tc_resources_new(tc_pool *pool, uint64_t budget_bytes, const tc_ledger *ledger, GError **error);
void tc_resources_free(tc_resources *resources); /* NULL is fine */

/* Finds the job's resource of this kind, or builds it from job->have and adds the milliseconds to *ms. ms NULL: finds only;
 * a missing resource is NULL without an error. */
const void *tc_resources_get(tc_resources *r, tc_resource which, const tc_frame_job *job, double *ms, GError **error);

/* Adds time that a back end spent on a resource of r. */
void tc_resources_took(tc_resources *r, tc_resource which, const void *thing, double ms);
/* Milliseconds that building a resource of r has taken so far. */
double tc_resources_ms(const tc_resources *r, tc_resource which, const void *thing);

/* Between frames: takes over a finished refinement of a resource of r; with `begin`, starts one where none was started and
 * memory allows. A refined resource gives the same picture faster. */
void tc_resources_refine(tc_resources *r, tc_resource which, const void *thing, bool begin);

/* A counter that increases with every resource built and with every part of a long build. */
int64_t tc_resources_steps(const tc_resources *resources);

uint64_t tc_resources_held(const tc_resources *r);
/* Evicts the least recently used until at most most_bytes are held. */
void tc_resources_trim(tc_resources *r, uint64_t most_bytes);

/* Drops the resources of a volume and of its coefficients; returns the serial of the coefficients (0: there were none). */
uint64_t tc_resources_forget(tc_resources *r, uint64_t volume_serial);
/* Drops clusters that contain this mesh. */
void tc_resources_forget_mesh(tc_resources *r, uint64_t mesh_serial);

#endif
