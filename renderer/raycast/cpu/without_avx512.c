/* In place of the AVX-512 kernels in a build that leaves them out (TC_AVX512 in CMakeLists.txt). */
#include "renderer/raycast/cpu/kernels.h"
#include "renderer/raycast/cpu/within.h"

#define NO_KERNEL(isa, voxels)                                                                                        \
  tc_cpu_kernel tc_kernel_##isa##_##voxels(const tc_plan_key *key) { return NULL; }
TC_KERNEL_FINDERS(NO_KERNEL, avx512)

tc_cpu_kernel tc_surface_kernel_avx512(const tc_plan_key *key) { return NULL; }
tc_cpu_kernel tc_within_kernel_avx512(const tc_plan_key *key) { return NULL; }
