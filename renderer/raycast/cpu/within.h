/* Rays that are cast in parts, for what else is in the volume (mode mesh's surfaces): kernels of their own, which ask the
 * plan's key what to do, so that whole rays pay nothing for them. Private to raycast/cpu. */
#ifndef TC_RAYCAST_CPU_WITHIN_H
#define TC_RAYCAST_CPU_WITHIN_H

#include "renderer/raycast/cpu/kernels.h"

/* What such a kernel is called with, by its first member. */
typedef struct tc_cpu_within {
  tc_cpu_args args;
  const float (*spans)[2]; /* [height][width]: mm from the eye, where each ray begins and ends */
  int width, height;
} tc_cpu_within;

/* For an instruction set that is named and modes dvr and mip; NULL: there is none. */
tc_cpu_kernel tc_within_kernel(const char *isa, const tc_plan_key *key);
tc_cpu_kernel tc_within_kernel_scalar(const tc_plan_key *key);
tc_cpu_kernel tc_within_kernel_avx2(const tc_plan_key *key);
tc_cpu_kernel tc_within_kernel_avx512(const tc_plan_key *key);

#endif
