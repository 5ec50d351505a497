#include "renderer/raycast/cpu/isa.h"

#include <float.h>
#include <glib.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/scene/scene.h"

/* In ascending order: the last one that runs has the best instruction set. Without neighbourhoods, the head phantom took 33 ms
 * by loads and 24 by gathers on an Intel Xeon of 2023, and 21 and 25 on an AMD EPYC (Zen 4). The AVX2 kernels do not gather:
 * gathers were slower on both processors. */
static const tc_cpu_isa isas[] = {
    {"scalar", "scalar", tc_kernel_scalar, tc_surface_kernel_scalar, false, false, 20},
    {"avx2", "avx2", tc_kernel_avx2, tc_surface_kernel_avx2, false, false, 5},
    {"avx512-load", "avx512", tc_kernel_avx512, tc_surface_kernel_avx512, false, false, 3},
    {"avx512-gather", "avx512", tc_kernel_avx512, tc_surface_kernel_avx512, true, true, 3},
    {"avx512", "avx512", tc_kernel_avx512, tc_surface_kernel_avx512, true, false, 3},
};
enum { N_ISAS = sizeof isas / sizeof *isas };

static bool isa_runs(const tc_cpu_isa *isa) {
  __builtin_cpu_init();
  bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  bool avx512 = avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  const bool runs = !strcmp(isa->instructions, "scalar") || (!strcmp(isa->instructions, "avx2") ? avx2 : avx512);
  return runs && isa->find(&(tc_plan_key){.mode = TC_MODE_DVR}); /* else the build leaves it out */
}

enum { SIDE = 48, NODES = 16, PIXELS = 16, ROUNDS = 5 };
#define CLOSE 1.0f   /* spacing of the rays in the trials */
#define DISTANT 3.0f
#define LEAD 1.05 /* how many times faster than the table's last variant another must be: trials vary */

/* A small dvr frame of 8-bit voxels, seen obliquely, under an empty table. spacing: of the rays, about half a voxel at 1. */
static tc_cpu_args small_frame(const uint8_t *voxels, const float *table, float spacing) {
  tc_cpu_args a = {.key = {.mode = TC_MODE_DVR, .voxel_type = TC_U8},
                   .grid = {.voxels = voxels, .row = SIDE, .slice = SIDE * SIDE},
                   .nodes = {0, (NODES - 1) / 255.0f, NODES - 1},
                   .table = table + 4 * NODES * (NODES + 1), /* its row k = 0 */
                   .table_stride = NODES + 1,
                   .rays = {.anchor0 = {10, 8, 8}, .anchor_du = {0.4f * spacing, -0.3f * spacing, 0},
                            .anchor_dv = {0.1f * spacing, 0.2f * spacing, 0.45f * spacing},
                            .view0 = {0.48f, 0.64f, 0.6f}, .step_mm = 1, .inverse_step = 1, .eye_mm = 1000, .far_mm = 1e30f,
                            .count = 1}};
  const int strides[3] = {1, SIDE, SIDE * SIDE};
  for (int k = 0; k < 3; k++) {
    a.rays.to_index[k][k] = 1;
    a.rays.hi[k] = a.grid.last[k] = SIDE - 1;
    a.grid.cell_last[k] = SIDE - 2;
    a.grid.stride[k] = strides[k];
  }
  return a;
}

static double time_us(const tc_cpu_isa *isa, tc_cpu_args *a, float *out) {
  tc_cpu_counts counts = {.until_poll = TC_CPU_POLL_STEPS};
  a->near = isa->near, a->gather = isa->gather;
  int64_t start = g_get_monotonic_time();
  isa->find(&a->key)(a, 0, 0, PIXELS, PIXELS, out, PIXELS, &counts);
  return (double)(g_get_monotonic_time() - start);
}

/* The fastest of n variants that follow each other in the table, by the minimum of several alternating rounds: the last, unless
 * another leads by LEAD. Without memory for the trial: the last. */
static const tc_cpu_isa *fastest(const tc_cpu_isa *variants, int n, float spacing) {
  uint8_t *voxels = calloc(1, SIDE * SIDE * SIDE + 64);
  float *table = calloc(4 * (2 * NODES + 3) * (NODES + 1), sizeof *table), *out = calloc(4 * PIXELS * PIXELS, sizeof *out);
  tc_cpu_args a = small_frame(voxels, table, spacing);
  double least[N_ISAS];
  int best = n - 1;
  for (int i = 0; i < n; i++) least[i] = DBL_MAX;
  for (int round = 0; voxels && table && out && round < n * ROUNDS; round++) {
    const int i = round % n;
    least[i] = fmin(least[i], time_us(&variants[i], &a, out) * (i < n - 1 ? LEAD : 1));
  }
  for (int i = 0; i < n; i++)
    if (least[i] < least[best]) best = i;
  free(voxels);
  free(table);
  free(out);
  return &variants[best];
}

static void set_unknown(const char *wanted, GError **error) {
  GString *names = g_string_new(NULL);
  for (int i = 0; i < N_ISAS; i++) g_string_append_printf(names, i ? ", %s" : "%s", isas[i].name);
  tc_set_error(error, TC_ERROR_INVALID, NULL, "instruction set \"%s\" is unknown: one of %s expected", wanted, names->str);
  g_string_free(names, TRUE);
}

bool tc_cpu_isa_choose(const char *wanted, tc_cpu_isas *chosen, GError **error) {
  for (int i = N_ISAS - 1; i >= 0; i--) {
    if (wanted && strcmp(wanted, isas[i].name)) continue;
    if (!isa_runs(&isas[i])) {
      if (!wanted) continue;
      tc_set_error(error, TC_ERROR_INVALID, NULL, "this processor does not support %s, or this build leaves it out: choose another instruction set, or none", wanted);
      return false;
    }
    int first = i;
    while (!wanted && first > 0 && !strcmp(isas[first - 1].instructions, isas[i].instructions)) first--;
    *chosen = (tc_cpu_isas){&isas[i], &isas[i]};
    if (first == i) return true;
    chosen->close = fastest(&isas[first], i - first + 1, CLOSE);
    chosen->distant = fastest(&isas[first - 1], i - first + 2, DISTANT); /* AVX2 stands before AVX-512 */
    return true;
  }
  set_unknown(wanted, error);
  return false;
}

bool tc_cpu_rays_are_close(const tc_rays *rays, tc_voxel_type type) {
  double parts = 1;
  for (int k = 0; k < 3; k++) {
    const double width = 3 * (fabs(rays->anchor_du[k]) + fabs(rays->anchor_dv[k])), cells = (k || type == TC_F32 ? 4 : 8) - 1;
    if (width > cells - 1) parts *= (width + 1) / cells; /* as bound_lanes() in neighbourhood_tmpl.h judges each packet */
  }
  return parts <= TC_MOST_NEIGHBOURHOODS;
}

const tc_cpu_isa *tc_cpu_isa_for(const tc_cpu_isas *isas, const tc_plan_key *key, const tc_rays *rays) {
  const tc_mode mode = (tc_mode)key->mode;
  const bool chooses = mode == TC_MODE_DVR || mode == TC_MODE_MIP || mode == TC_MODE_MINIP || mode == TC_MODE_AVERAGE;
  if (!chooses || key->filter != TC_FILTER_LINEAR || tc_cpu_rays_are_close(rays, (tc_voxel_type)key->voxel_type)) return isas->close;
  return isas->distant;
}
