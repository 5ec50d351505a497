/* Tables and leaping structures: built on first need, shared by every scene that needs the same, dropped least recently
 * used first when they outgrow the budget. One thread at a time (the render thread). What a call returns lives until
 * the next call that builds something of the same kind; a frame asks for all it needs once.
 *
 * Building stops at the halt of the pool, which the error then says. What takes long (coefficients, min-max blocks, boxes,
 * the entries of tables) is kept as far as it is, and the next call that asks for the same goes on with it. */
#ifndef TC_RENDERER_RESOURCES_H
#define TC_RENDERER_RESOURCES_H

#include "renderer/classify/integrals.h"
#include "renderer/classify/labels.h"
#include "renderer/skip/bounds.h"
#include "renderer/skip/boxes.h"
#include "renderer/skip/skip.h"
#include "renderer/tomocast.h"

typedef struct tc_resources tc_resources;

tc_resources *tc_resources_new(tc_pool *pool, uint64_t budget_bytes, GError **error);
void tc_resources_free(tc_resources *resources); /* NULL is fine */

/* Each finds what it names, or builds it and adds to *ms what that took. ms NULL: builds nothing, and what is not there now
 * is NULL without an error. */

/* The volume's B-spline coefficients (volume/coefficients.h): a volume in its place, asked for before anything else of
 * a frame. TC_ERROR_LIMIT when they alone are over the budget. */
const tc_volume *tc_resources_coefficients(tc_resources *r, const tc_volume *volume, double *ms, GError **error);

/* May be an outline still (classify/outline.h), for a back end that makes the entries itself; the other call makes them
 * here, unless they are there. */
const tc_table *tc_resources_table(tc_resources *r, const tc_table_params *params, double *ms, GError **error);
bool tc_resources_fill(tc_resources *r, const tc_table *table, double *ms, GError **error);
/* A back end took this long over a table of r. */
void tc_resources_table_took(tc_resources *r, const tc_table *table, double ms);
const tc_integrals *tc_resources_integrals(tc_resources *r, const tc_table_params *params, double *ms, GError **error);

/* Where a transfer function, or a surface between two values (tc_support_surface()), shows something. */
const tc_support *tc_resources_support(tc_resources *r, const tc_table_params *params, double *ms, GError **error);
const tc_support *tc_resources_surface(tc_resources *r, double lo, double hi, double *ms, GError **error);

/* Over blocks of a volume. minmax: of the same blocks; not read where nothing is built. */
const tc_minmax *tc_resources_minmax(tc_resources *r, const tc_volume *volume, int block, int reach, double *ms,
                                     GError **error);
const tc_leap *tc_resources_leap(tc_resources *r, const tc_volume *volume, int block, int reach, const tc_minmax *minmax,
                                 const tc_support *support, double *ms, GError **error);
const tc_boxes *tc_resources_boxes(tc_resources *r, const tc_volume *volume, int block, int reach, const tc_minmax *minmax,
                                   const tc_support *support, double *ms, GError **error);
const tc_bounds *tc_resources_bounds(tc_resources *r, const tc_volume *volume, int block, int reach, const tc_minmax *minmax,
                                     const tc_grey *grey, double *ms, GError **error);

const tc_labels *tc_resources_labels(tc_resources *r, const tc_volume *labels, const tc_scene *scene, double *ms,
                                     GError **error);

/* Grows with everything that is built, and with every part of it. */
int64_t tc_resources_steps(const tc_resources *resources);

uint64_t tc_resources_held(const tc_resources *r);
/* What there is at all from now on; the budget is as it was, or this where it is less. Drops what is over it, least
 * recently used first. */
void tc_resources_limit(tc_resources *r, uint64_t most_bytes);
/* Bytes of what did not fit under it, where that was what failed last; 0 then until the next failure. */
uint64_t tc_resources_wanted(tc_resources *r);

/* Drops what belongs to a volume, and to its coefficients, whose serial it gives back (0: there were none). */
uint64_t tc_resources_forget(tc_resources *r, uint64_t volume_serial);

#endif
