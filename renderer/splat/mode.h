/* Mode splat: draws a scene over a volume with the CPU splatter, and gives voxels their colours. */
#ifndef TC_SPLAT_MODE_H
#define TC_SPLAT_MODE_H

#include "renderer/frame/backend.h"

/* A tc_drawer (frame/backend.h). */
bool tc_splat_mode_draw(tc_pool *pool, const tc_frame_job *job, GError **error);

/* Appearance of voxels: each voxel has indices into a table of colours. The indices stay valid while the transfer function or
 * label colours change. */
typedef struct tc_splat_appearance tc_splat_appearance;

/* Sets *appearance to NULL if the object is opaque and has one colour. Borrows the job's volume, labels and model.
 * False with TC_ERROR_MEMORY. */
bool tc_splat_appearance_make(const tc_frame_job *job, tc_splat_appearance **appearance, GError **error);
void tc_splat_appearance_free(tc_splat_appearance *appearance); /* NULL is fine */
/* [n]: colour (0..1 a channel, compositing space) and extinction (1/mm). */
const float (*tc_splat_appearance_table(const tc_splat_appearance *appearance, int *n))[4];
/* Table indices of a voxel's colour and of its extinction. */
void tc_splat_appearance_at(const tc_splat_appearance *appearance, const int at[3], uint16_t entries[2]);
/* Key of the attribute that the indices come from: two appearances with equal keys have equal indices for the same splats. */
uint64_t tc_splat_appearance_key(const tc_splat_appearance *appearance);

#endif
