/* The vector vocabulary with one lane: the form every other instruction set is checked against. */
#ifndef TC_SIMD_SCALAR_H
#define TC_SIMD_SCALAR_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define V_LANES 1
#define V_PACKET_X 1
#define V_PACKET_Y 1
#define V_INLINE static inline __attribute__((always_inline))

typedef float vf;
typedef int32_t vi;
typedef bool vm;
typedef struct vf4 { vf r, g, b, a; } vf4;

V_INLINE vf v_set(float x) { return x; }
V_INLINE vi v_seti(int x) { return x; }
V_INLINE vf v_lane_x(void) { return 0; }
V_INLINE vf v_lane_y(void) { return 0; }
V_INLINE vf v_fma(vf a, vf b, vf c) { return a * b + c; }
V_INLINE vf v_fnma(vf a, vf b, vf c) { return c - a * b; }
V_INLINE vf v_min(vf a, vf b) { return a < b ? a : b; }
V_INLINE vf v_max(vf a, vf b) { return a > b ? a : b; }
V_INLINE vf v_abs(vf a) { return fabsf(a); }
V_INLINE vf v_sqrt(vf a) { return sqrtf(a); }
V_INLINE vi v_trunc(vf a) { return (vi)a; }
V_INLINE vf v_float(vi a) { return (vf)a; }
V_INLINE vi v_addi(vi a, vi b) { return (vi)((uint32_t)a + (uint32_t)b); } /* whole numbers wrap round */
V_INLINE vi v_subi(vi a, vi b) { return (vi)((uint32_t)a - (uint32_t)b); }
V_INLINE vi v_muli(vi a, vi b) { return (vi)((uint32_t)a * (uint32_t)b); }
V_INLINE vi v_mini(vi a, vi b) { return a < b ? a : b; }
V_INLINE vi v_shl(vi a, int n) { return (vi)((uint32_t)a << n); }
V_INLINE vi v_sra(vi a, int n) { return a >> n; }
V_INLINE vi v_andi(vi a, vi b) { return a & b; }
V_INLINE vi v_ori(vi a, vi b) { return a | b; }
V_INLINE vi v_bits(vf a) { vi i; memcpy(&i, &a, 4); return i; }
V_INLINE vf v_from_bits(vi a) { vf f; memcpy(&f, &a, 4); return f; }
V_INLINE vm v_lt(vf a, vf b) { return a < b; }
V_INLINE vm v_le(vf a, vf b) { return a <= b; }
V_INLINE vm v_eq(vf a, vf b) { return a == b; }
V_INLINE vf v_select(vm m, vf a, vf b) { return m ? a : b; }
V_INLINE vm m_and(vm a, vm b) { return a && b; }
V_INLINE vm m_or(vm a, vm b) { return a || b; }
V_INLINE vm m_andnot(vm a, vm b) { return a && !b; } /* a and not b */
V_INLINE bool m_any(vm a) { return a; }
V_INLINE int m_count(vm a) { return a; }
V_INLINE void v_store(float *p, vf a) { *p = a; }
V_INLINE vf v_load(const float *p) { return *p; }
V_INLINE vi v_load_bytes(const uint8_t *p) { return *p; }
V_INLINE vf v_gather(const float *base, vi off) { return base[off]; }
V_INLINE unsigned m_bits(vm a) { return a; }
V_INLINE float v_least(vf a) { return a; }
V_INLINE vi v_bytes(const uint8_t *base, vi off) { return base[off]; }

/* Voxels at off and off + 1 (in voxels from base). */
V_INLINE void v_pair_u8(const void *base, vi off, vf *a, vf *b) {
  const uint8_t *p = (const uint8_t *)base + off;
  *a = p[0], *b = p[1];
}
V_INLINE void v_pair_i8(const void *base, vi off, vf *a, vf *b) {
  const int8_t *p = (const int8_t *)base + off;
  *a = p[0], *b = p[1];
}
V_INLINE void v_pair_u16(const void *base, vi off, vf *a, vf *b) {
  const uint16_t *p = (const uint16_t *)base + off;
  *a = p[0], *b = p[1];
}
V_INLINE void v_pair_i16(const void *base, vi off, vf *a, vf *b) {
  const int16_t *p = (const int16_t *)base + off;
  *a = p[0], *b = p[1];
}
V_INLINE void v_pair_f32(const void *base, vi off, vf *a, vf *b) {
  const float *p = (const float *)base + off;
  *a = p[0], *b = p[1];
}

/* Bilinear lookup of 4-float entries: row0, row1 are entry offsets of two rows, entries off and off + 1 are read in
 * each. */
V_INLINE vf4 v_bilinear(const float *base, vi row0, vi row1, vf fx, vf fy) {
  const float *p = base + (ptrdiff_t)row0 * 4, *q = base + (ptrdiff_t)row1 * 4;
  float out[4];
  for (int c = 0; c < 4; c++) {
    float a = p[c] + fy * (q[c] - p[c]), b = p[4 + c] + fy * (q[4 + c] - p[4 + c]);
    out[c] = a + fx * (b - a);
  }
  return (vf4){out[0], out[1], out[2], out[3]};
}

#endif
