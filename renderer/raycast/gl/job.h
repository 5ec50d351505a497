/* One frame's numbers as the shaders read them: the uniform block Job of head.glsl, std140. */
#ifndef TC_RAYCAST_GL_JOB_H
#define TC_RAYCAST_GL_JOB_H

#include <stdint.h>

#include "renderer/backend.h"
#include "renderer/raycast/gl/textures.h"

typedef struct tc_gl_job_block {
  float anchor0[4], anchor_du[4], anchor_dv[4];
  float view0[4], view_du[4], view_dv[4];
  float to_index[3][4];
  float box_lo[4], box_hi[4];
  int32_t dims[4];
  float texel[4], nodes[4];
  int32_t table[4], blocks[4];
  float background[4], march[4];
  float planes[TC_MAX_CLIP_PLANES][4];
  int32_t clipping[4];
  float grey[4], reach[4];
  float window[4];
  float gradient[3][4], light[4], reflection[4], glow[2][4];
  float zooms[TC_MAX_ZOOMS][4];
  float label_matrix[3][4];
  int32_t label_dims[4], label_numbers[4];
  float label_texel[4];
  float rays[4], of_pixel[TC_MAX_RAYS_PER_PIXEL][4];
  float surface[4], surface_color[4];
} tc_gl_job_block;

/* labels: the copy of job->label_volume, or NULL with it. Pure. */
void tc_gl_job_fill(tc_gl_job_block *block, const tc_job *job, const tc_gl_volume *volume, const tc_gl_volume *labels);

#endif
