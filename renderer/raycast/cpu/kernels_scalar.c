#include "renderer/raycast/cpu/kernels.h"
#include "renderer/raycast/cpu/simd_scalar.h"

#include "renderer/raycast/cpu/kernels_tmpl.h"

tc_cpu_kernel FINDER(tc_kernel_scalar)(const tc_plan_key *key) { return find_kernel(key); }
