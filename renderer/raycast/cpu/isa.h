/* The variants of the cpu back end's kernels: an instruction set, and how voxels are loaded (as neighbourhoods in registers or
 * pair by pair; pairs by one load each or by gathers). Variants of one instruction set draw the same bits. */
#ifndef TC_CPU_ISA_H
#define TC_CPU_ISA_H

#include "renderer/base/error.h"
#include "renderer/raycast/cpu/kernels.h"
#include "renderer/raycast/rays.h"

typedef struct tc_cpu_isa {
  const char *name, *instructions; /* "avx512-gather", "avx512" */
  tc_cpu_kernel (*find)(const tc_plan_key *key), (*find_surface)(const tc_plan_key *key);
  bool near, gather; /* tc_cpu_args */
  double sample_ns; /* rough time per sample of tc_estimate_samples() */
} tc_cpu_isa;

/* The variants a back end draws with. Frames of dvr and of projections, by linear interpolation, whose rays lie too far apart for
 * neighbourhoods are drawn by `distant`, all others by `close`. */
typedef struct tc_cpu_isas {
  const tc_cpu_isa *close, *distant; /* static */
} tc_cpu_isas;

/* Finds a variant by name; TC_ERROR_INVALID for an unknown name, or an instruction set that this processor or this build lacks. wanted
 * NULL: the fastest for each kind of frame in a trial of a few milliseconds, because the costs of loads, gathers and
 * permutations differ between processors: of the best instruction set of this processor, or, for distant rays, AVX2. */
bool tc_cpu_isa_choose(const char *wanted, tc_cpu_isas *chosen, GError **error);

/* The variant for a frame. */
const tc_cpu_isa *tc_cpu_isa_for(const tc_cpu_isas *isas, const tc_plan_key *key, const tc_rays *rays);

/* Whether the rays of most packets fit a neighbourhood, judged by packets of 4 x 4 pixels where rays pass their anchors, at the
 * depth of the volume's centre. */
bool tc_cpu_rays_are_close(const tc_rays *rays, tc_voxel_type type);

#endif
