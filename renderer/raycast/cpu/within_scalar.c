#include "renderer/raycast/cpu/within.h"

#include "renderer/raycast/cpu/simd_scalar.h"

#include "renderer/raycast/cpu/within_tmpl.h"

tc_cpu_kernel tc_within_kernel_scalar(const tc_plan_key *key) { return find_kernel(key); }
