#include "renderer/raycast/cpu/within.h"

#include "renderer/raycast/cpu/simd_avx2.h"

#include "renderer/raycast/cpu/within_tmpl.h"

tc_cpu_kernel tc_within_kernel_avx2(const tc_plan_key *key) { return find_kernel(key); }
