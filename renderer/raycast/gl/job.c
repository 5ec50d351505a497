/* From a job to the uniform block. See job.h. */
#include "renderer/raycast/gl/job.h"

#include <float.h>
#include <math.h>
#include <string.h>

static void fill_nodes(tc_gl_job_block *block, int n, double lo, double hi) {
  block->nodes[0] = (float)lo;
  /* Without the limit, a range of denormal width would give infinity, and infinity * 0 is NaN. */
  block->nodes[1] = (float)fmin((n - 1) / (hi - lo), FLT_MAX);
  block->nodes[2] = (float)(n - 1);
}

static void fill_integrals(tc_gl_job_block *block, const tc_integrals *integrals) {
  fill_nodes(block, integrals->n, integrals->lo, integrals->hi);
  block->table[0] = integrals->n + 1;
  block->table[1] = integrals->levels_start;
}

static void fill_table(tc_gl_job_block *block, const tc_table *table) {
  fill_nodes(block, table->n, table->lo, table->hi);
  block->table[0] = table->columns;
  block->table[1] = (int32_t)table->starts[0];
  block->table[2] = table->n_subtables;
  block->table[3] = TC_SUBTABLE_NODES + 2;
  double nodes = (table->n - 1) / (table->hi - table->lo);
  for (int z = 0; z < table->n_subtables; z++) {
    const tc_subtable *subtable = &table->subtables[z];
    block->subtables[z][0] = (float)((subtable->lo - table->lo) * nodes);
    block->subtables[z][1] = (float)((TC_SUBTABLE_NODES - 1) / ((subtable->hi - subtable->lo) * nodes));
    block->subtables[z][2] = (float)table->starts[1 + z];
    block->subtables[z][3] = (float)subtable->rim;
  }
}

static void fill_blocks(tc_gl_job_block *block, int width, const int blocks[3]) {
  block->blocks[0] = width; /* width in voxels, not necessarily a power of two */
  block->blocks[1] = blocks[0];
  block->blocks[2] = blocks[0] * blocks[1];
}

static void fill_projection(tc_gl_job_block *block, const tc_grey *grey, const tc_bounds *bounds, const tc_rays *rays) {
  block->grey = *grey;
  if (!bounds) return;
  block->level_scale[0] = bounds->scale;
  fill_blocks(block, bounds->block, bounds->blocks);
  block->blocks[3] = tc_bounds_interval(bounds, rays) - 1; /* the sample before them counts too (bounds.glsl) */
}

static void fill_window(tc_gl_job_block *block, const tc_frame_job *job) {
  tc_slice_window window;
  tc_slice_window_init(&window, job->volume, job->scene);
  block->nodes[0] = window.lo;
  block->nodes[1] = window.sign;
  block->nodes[2] = window.last;
  block->window[0] = window.center;
  block->window[1] = window.gain;
}

static void fill_labels(tc_gl_job_block *block, const tc_frame_job *job, const tc_gl_volume *labels) {
  double matrix[3][4];
  tc_labels_matrix(job->volume, job->label_volume, matrix);
  for (int r = 0; r < 3; r++)
    for (int k = 0; k < 4; k++)
      block->label_matrix[r][k] = (float)matrix[r][k];
  memcpy(block->label_dims, tc_volume_describe(job->label_volume)->dims, 3 * sizeof *block->label_dims);
  block->label_dims[3] = labels->slices_per_layer;
  block->label_numbers[0] = job->have.labels->base;
  block->label_numbers[1] = job->have.labels->base + job->have.labels->n;
  memcpy(block->label_texel, labels->texel, 2 * sizeof *block->label_texel);
}

void tc_gl_job_fill(tc_gl_job_block *block, const tc_frame_job *job, const tc_gl_volume *volume, const tc_gl_volume *labels) {
  memset(block, 0, sizeof *block);
  tc_rays_round(&block->rays, job->rays);
  memcpy(block->dims, tc_volume_describe(job->volume)->dims, 3 * sizeof *block->dims);
  if (volume) {
    block->dims[3] = volume->slices_per_layer;
    memcpy(block->texel, volume->texel, sizeof volume->texel);
  }
  if (job->have.table) fill_table(block, job->have.table);
  if (job->have.integrals) fill_integrals(block, job->have.integrals);
  if (job->have.distance_map) fill_blocks(block, job->have.distance_map->block, job->have.distance_map->blocks);
  if (tc_is_projection((tc_mode)job->key.mode)) fill_projection(block, &job->plan->grey, job->have.bounds, job->rays);
  if (job->key.mode == TC_MODE_MPR || (job->key.mode == TC_MODE_MESH && volume)) fill_window(block, job);
  if (job->key.mode == TC_MODE_ISOSURFACE) {
    block->surface[0] = job->plan->surface.iso;
    block->surface[1] = job->plan->surface.scale;
    memcpy(block->surface_color, job->plan->surface.color, sizeof job->plan->surface.color);
  }
  tc_resolve resolve;
  tc_resolve_init(&resolve, job->scene);
  memcpy(block->background, resolve.background, sizeof resolve.background);
  block->background[3] = (float)job->scene->sampling.termination;
  if (job->key.shading) tc_shade_set_up(&block->shade, job->source, job->volume, job->scene);
  if (labels) fill_labels(block, job, labels);
}
