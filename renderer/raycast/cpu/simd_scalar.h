/* The vector vocabulary with one lane: the meaning of every operation (simd.h), which the other instruction sets are
 * tested against. */
#ifndef TC_SIMD_SCALAR_H
#define TC_SIMD_SCALAR_H

#include <string.h>

#include "renderer/raycast/cpu/simd.h"

#define V_LANES 1
#define V_PACKET_X 1
#define V_PACKET_Y 1

typedef float vf;
typedef int32_t vi;
typedef bool vm;
typedef struct vf4 { vf r, g, b, a; } vf4;
typedef struct v_places { vi off; } v_places;

#define UNARY(name, meaning) V_INLINE vf name(vf a) { return meaning; }
#define BINARY(name, meaning) V_INLINE vf name(vf a, vf b) { return meaning; }
#define FUSED(name, meaning) V_INLINE vf name(vf a, vf b, vf c) { return meaning; }
#define COMPARE(name, meaning) V_INLINE vm name(vf a, vf b) { return meaning; }
#define MASK(name, meaning) V_INLINE vm name(vm a, vm b) { return meaning; }
#define INTEGER(name, meaning) V_INLINE vi name(vi a, vi b) { return meaning; }
#define ORDER(name, meaning) V_INLINE vm name(vi a, vi b) { return meaning; }
#define SHIFT(name, meaning) V_INLINE vi name(vi a, int n) { return meaning; }
#define PAIR(name, type)                                                                                              \
  V_INLINE void v_pair_##name(const void *base, const v_places *at, vf *a, vf *b) {                                   \
    const type *p = (const type *)base + at->off;                                                                     \
    *a = p[0], *b = p[1];                                                                                             \
  }
SIMD_UNARY(UNARY)
SIMD_BINARY(BINARY)
SIMD_FUSED(FUSED)
SIMD_COMPARE(COMPARE)
SIMD_MASK(MASK)
SIMD_INTEGER(INTEGER)
SIMD_SHIFT(SHIFT)
SIMD_ORDER(ORDER)
SIMD_VOXELS(PAIR)
#undef UNARY
#undef BINARY
#undef FUSED
#undef COMPARE
#undef MASK
#undef INTEGER
#undef SHIFT
#undef ORDER
#undef PAIR

V_INLINE vf v_set(float x) { return x; }
V_INLINE vi v_seti(int x) { return x; }
V_INLINE vf v_lane_x(void) { return 0; }
V_INLINE vf v_lane_y(void) { return 0; }
V_INLINE vi v_trunc(vf a) { return (vi)a; }
V_INLINE vf v_float(vi a) { return (vf)a; }
V_INLINE vi v_bits(vf a) { vi i; memcpy(&i, &a, 4); return i; }
V_INLINE vf v_from_bits(vi a) { vf f; memcpy(&f, &a, 4); return f; }
V_INLINE vf v_select(vm m, vf a, vf b) { return m ? a : b; }
V_INLINE bool m_any(vm a) { return a; }
V_INLINE int m_count(vm a) { return a; }
V_INLINE unsigned m_bits(vm a) { return a; }
V_INLINE float v_least(vf a) { return a; }
V_INLINE vf v_load(const float *p) { return *p; }
V_INLINE void v_store(float *p, vf a) { *p = a; }
V_INLINE void v_store_pixels(float *p, ptrdiff_t row, vf4 c) { p[0] = c.r, p[1] = c.g, p[2] = c.b, p[3] = c.a; }
V_INLINE vi v_load_bytes(const uint8_t *p) { return *p; }
V_INLINE vf v_gather(const float *base, vi off) { return base[off]; }
V_INLINE vi v_bytes(const uint8_t *base, vi off) { return base[off]; }
V_INLINE vf v_table(const float *table, vi at) { return table[at]; }
V_INLINE void v_compact(void *p, vm m, vf a) {
  if (m) memcpy(p, &a, sizeof a);
}

V_INLINE v_places v_place(vi off) { return (v_places){off}; }
V_INLINE void v_prefetch(const void *base, const v_places *at, int size) {
  __builtin_prefetch((const void *)((uintptr_t)base + (uintptr_t)((ptrdiff_t)at->off * size)));
}

V_INLINE vf4 v_bilinear(const float *base, vi row0, vi row1, vf fx, vf fy) {
  const float *p = base + (ptrdiff_t)row0 * 4, *q = base + (ptrdiff_t)row1 * 4;
  float out[4];
  for (int c = 0; c < 4; c++) {
    float a = p[c] + fy * (q[c] - p[c]), b = p[4 + c] + fy * (q[4 + c] - p[4 + c]);
    out[c] = a + fx * (b - a);
  }
  return (vf4){out[0], out[1], out[2], out[3]};
}

SIMD_PROVIDED;

#endif
