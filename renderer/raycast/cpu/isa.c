#include "renderer/raycast/cpu/isa.h"

#include <glib.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/scene/scene.h"

/* In ascending order: the last one that runs has the best instruction set. */
static const tc_cpu_isa isas[] = {
    {"scalar", "scalar", tc_kernel_scalar, tc_surface_kernel_scalar, false, 20},
    {"avx2", "avx2", tc_kernel_avx2, tc_surface_kernel_avx2, false, 5},
    {"avx512-load", "avx512", tc_kernel_avx512, tc_surface_kernel_avx512, false, 3},
    {"avx512", "avx512", tc_kernel_avx512, tc_surface_kernel_avx512, true, 3},
};
enum { N_ISAS = sizeof isas / sizeof *isas };

static bool isa_runs(const tc_cpu_isa *isa) {
  __builtin_cpu_init();
  bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  bool avx512 = avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  return !strcmp(isa->instructions, "scalar") || (!strcmp(isa->instructions, "avx2") ? avx2 : avx512);
}

enum { SIDE = 48, NODES = 16, PIXELS = 16, ROUNDS = 5 };

/* A small dvr frame of 8-bit voxels, seen obliquely and magnified, under an empty table. */
static tc_cpu_args small_frame(const uint8_t *voxels, const float *table) {
  tc_cpu_args a = {.key = {.mode = TC_MODE_DVR, .voxel_type = TC_U8, .termination = 1},
                   .grid = {.voxels = voxels, .row = SIDE, .slice = SIDE * SIDE},
                   .nodes = {0, (NODES - 1) / 255.0f, NODES - 1},
                   .table = table + 4 * NODES * (NODES + 1), /* its row k = 0 */
                   .table_stride = NODES + 1,
                   .rays = {.anchor0 = {10, 8, 8}, .anchor_du = {0.4f, -0.3f, 0}, .anchor_dv = {0.1f, 0.2f, 0.45f},
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

static int64_t time_us(const tc_cpu_isa *isa, tc_cpu_args *a, float *out) {
  tc_cpu_counts counts = {.until_poll = TC_CPU_POLL_STEPS};
  a->near = isa->near;
  int64_t start = g_get_monotonic_time();
  isa->find(&a->key)(a, 0, 0, PIXELS, PIXELS, out, PIXELS, &counts);
  return g_get_monotonic_time() - start;
}

/* The faster of two instruction sets: the one with the smaller minimum of several alternating rounds. Without memory for
 * the trial: the first. */
static const tc_cpu_isa *faster(const tc_cpu_isa *first, const tc_cpu_isa *second) {
  uint8_t *voxels = calloc(1, SIDE * SIDE * SIDE + 64);
  float *table = calloc(4 * (2 * NODES + 3) * (NODES + 1), sizeof *table), *out = calloc(4 * PIXELS * PIXELS, sizeof *out);
  int64_t least[2] = {INT64_MAX, INT64_MAX};
  if (voxels && table && out) {
    tc_cpu_args a = small_frame(voxels, table);
    for (int round = 0; round < 2 * ROUNDS; round++) {
      int64_t us = time_us(round % 2 ? second : first, &a, out);
      if (us < least[round % 2]) least[round % 2] = us;
    }
  }
  free(voxels);
  free(table);
  free(out);
  return least[1] < least[0] ? second : first;
}

const tc_cpu_isa *tc_cpu_isa_choose(const char *wanted, GError **error) {
  for (int i = N_ISAS - 1; i >= 0; i--) {
    if (wanted && strcmp(wanted, isas[i].name)) continue;
    if (!isa_runs(&isas[i])) {
      if (!wanted) continue;
      tc_set_error(error, TC_ERROR_INVALID, NULL, "this processor does not support %s: choose another instruction set, or none", wanted);
      return NULL;
    }
    bool two = !wanted && i > 0 && !strcmp(isas[i].instructions, isas[i - 1].instructions);
    return two ? faster(&isas[i], &isas[i - 1]) : &isas[i];
  }
  tc_set_error(error, TC_ERROR_INVALID, NULL,
               "instruction set \"%s\" is unknown: scalar, avx2, avx512 or avx512-load expected", wanted);
  return NULL;
}
