/* The variants of the cpu back end's kernels: an instruction set, and how voxels are loaded (as neighbourhoods in registers or
 * pair by pair; pairs by one load each or by gathers). Variants of one instruction set draw the same bits. */
#ifndef TC_CPU_ISA_H
#define TC_CPU_ISA_H

#include "renderer/base/error.h"
#include "renderer/raycast/cpu/kernels.h"

typedef struct tc_cpu_isa {
  const char *name, *instructions; /* "avx512-gather", "avx512" */
  tc_cpu_kernel (*find)(const tc_plan_key *key), (*find_surface)(const tc_plan_key *key);
  bool near, gather; /* tc_cpu_args */
  double sample_ns; /* rough time per sample of tc_estimate_samples() */
} tc_cpu_isa;

/* Finds a variant by name; TC_ERROR_INVALID for an unknown name, or an instruction set that this processor or this build lacks. wanted
 * NULL: the best instruction set of this processor, in the variant that is fastest in a trial of a few milliseconds,
 * because the costs of loads, gathers and permutations differ between processors. Static. */
const tc_cpu_isa *tc_cpu_isa_choose(const char *wanted, GError **error);

#endif
