#include "renderer/raycast/cpu/within.h"

#include <string.h>

tc_cpu_kernel tc_within_kernel(const char *isa, const tc_plan_key *key) {
  if (strcmp(isa, "scalar") == 0) return tc_within_kernel_scalar(key);
  return strcmp(isa, "avx2") == 0 ? tc_within_kernel_avx2(key) : tc_within_kernel_avx512(key);
}
