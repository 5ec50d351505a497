/* A frame's constants for the shaders: the uniform block Job of head.glsl, std140. */
#ifndef TC_RAYCAST_GL_JOB_H
#define TC_RAYCAST_GL_JOB_H

#include <stdint.h>

#include "renderer/frame/backend.h"
#include "renderer/raycast/gl/textures.h"
#include "renderer/raycast/shading.h"

typedef struct tc_gl_job_block {
  tc_rays_single rays;
  tc_shade shade;
  _Alignas(16) tc_grey grey; /* std140: structures, and members that follow them, begin at multiples of 16 bytes */
  _Alignas(16) float level_scale[4];
  int32_t dims[4];
  float texel[4], nodes[4];
  int32_t table[4], blocks[4];
  float background[4];
  float window[4];
  float subtables[TC_MAX_SUBTABLES][4];
  float label_matrix[3][4];
  int32_t label_dims[4], label_numbers[4];
  float label_texel[4];
  float surface[4], surface_color[4];
} tc_gl_job_block;

/* volume, labels: the textures of job->volume and job->label_volume (NULL: not sampled). Pure. */
void tc_gl_job_fill(tc_gl_job_block *block, const tc_frame_job *job, const tc_gl_volume *volume, const tc_gl_volume *labels);

#endif
