/* Rays cast in parts, between the surfaces in a volume (frame/mesh_within.c). Separate kernels, not specialised but
 * controlled by the plan's key at run time, so that whole rays pay nothing for them. Private to raycast/cpu. */
#ifndef TC_RAYCAST_CPU_WITHIN_H
#define TC_RAYCAST_CPU_WITHIN_H

#include "renderer/raycast/cpu/kernels.h"

/* Arguments of such a kernel, which is called with a pointer to the first member. */
typedef struct tc_cpu_within {
  tc_cpu_args args;
  const float (*spans)[2]; /* [height][width]: start and end of each ray, mm from the eye */
  int width, height;
} tc_cpu_within;

/* The kernel for an instruction set by name, in modes dvr and mip; NULL: no such kernel. */
tc_cpu_kernel tc_within_kernel(const char *isa, const tc_plan_key *key);
tc_cpu_kernel tc_within_kernel_scalar(const tc_plan_key *key);
tc_cpu_kernel tc_within_kernel_avx2(const tc_plan_key *key);
tc_cpu_kernel tc_within_kernel_avx512(const tc_plan_key *key);

#endif
