/* The variants of the cpu back end's kernels: instruction sets, and within one what its vectors are loaded by. Variants of
 * one instruction set draw the same bits. */
#ifndef TC_CPU_ISA_H
#define TC_CPU_ISA_H

#include "renderer/base/error.h"
#include "renderer/raycast/cpu/kernels.h"

typedef struct tc_cpu_isa {
  const char *name, *instructions; /* "avx512-gather", "avx512" */
  tc_cpu_kernel (*find)(const tc_plan_key *key), (*find_surface)(const tc_plan_key *key);
  bool near;        /* tc_cpu_args.near */
  double sample_ns; /* rough time per sample as tc_estimate_samples() counts them */
} tc_cpu_isa;

/* By its name. NULL: of the best instruction set that this processor has, the variant that a march of a few milliseconds
 * finds faster here: processors differ in what a gather costs by more than ten times. Static. */
const tc_cpu_isa *tc_cpu_isa_choose(const char *wanted, GError **error);

#endif
