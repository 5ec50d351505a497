/* Mode splat of a scene over a volume: drawn by the pool; and what its pixels show. */
#ifndef TC_SPLAT_MODE_H
#define TC_SPLAT_MODE_H

#include "renderer/frame/backend.h"

/* A tc_drawer. */
bool tc_splat_mode_draw(tc_pool *pool, const tc_frame_job *job, GError **error);

/* What voxels look like: numbers of a voxel, and what a table says of them. The numbers stay while a transfer function
 * or colours change. */
typedef struct tc_splat_look tc_splat_look;

/* *look NULL: opaque, and of one colour. Borrows the job's volume, labels and model. False with TC_ERROR_MEMORY. */
bool tc_splat_look_make(const tc_frame_job *job, tc_splat_look **look, GError **error);
void tc_splat_look_free(tc_splat_look *look); /* NULL is fine */
/* [n]: colour (0..1 a channel, compositing space) and extinction (1/mm). */
const float (*tc_splat_look_table(const tc_splat_look *look, int *n))[4];
/* The entries of a voxel's colour and of its extinction. */
void tc_splat_look_at(const tc_splat_look *look, const int at[3], uint16_t entries[2]);
/* Which attribute of the model its entries are of: looks at the same splats with equal ones have the same entries. */
uint64_t tc_splat_look_of(const tc_splat_look *look);

#endif
