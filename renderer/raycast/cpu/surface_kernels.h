/* The kernels of isosurfaces (isosurface_tmpl.h), one per voxel type and instruction set, apart from the ray caster's
 * others: they share its rays, its field and its light, and no loop. */
#ifndef TC_CPU_SURFACE_KERNELS_H
#define TC_CPU_SURFACE_KERNELS_H

#include "renderer/raycast/cpu/kernels.h"

/* What these kernels take where tc_cpu_kernel says tc_cpu_args. */
typedef struct tc_cpu_surface {
  tc_cpu_args common;
  float iso, scale, color[3]; /* raycast/surface.h */
  float *depth;               /* [picture's height][width], mm from the eye; NULL unless the frame wants it */
  int width;
} tc_cpu_surface;

/* NULL for a type that there is not. */
tc_cpu_kernel tc_surface_kernel_scalar(const tc_plan_key *key);
tc_cpu_kernel tc_surface_kernel_avx2(const tc_plan_key *key);
tc_cpu_kernel tc_surface_kernel_avx512(const tc_plan_key *key);

#endif
