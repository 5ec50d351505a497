/* The vector vocabulary, 8 lanes of AVX2 + FMA: a packet of 4x2 pixels. */
#ifndef TC_SIMD_AVX2_H
#define TC_SIMD_AVX2_H

#include <immintrin.h>
#include <string.h>

#include "renderer/raycast/cpu/simd.h"

#define V_LANES 8
#define V_PACKET_X 4
#define V_PACKET_Y 2

typedef __m256 vf;
typedef __m256i vi;
typedef __m256 vm; /* all bits of a lane set or clear */
typedef struct vf4 { vf r, g, b, a; } vf4;
typedef struct v_places { int32_t off[8] __attribute__((aligned(32))); } v_places;

V_INLINE vf v_set(float x) { return _mm256_set1_ps(x); }
V_INLINE vi v_seti(int x) { return _mm256_set1_epi32(x); }
V_INLINE vf v_lane_x(void) { return _mm256_setr_ps(0, 1, 2, 3, 0, 1, 2, 3); }
V_INLINE vf v_lane_y(void) { return _mm256_setr_ps(0, 0, 0, 0, 1, 1, 1, 1); }
V_INLINE vf v_fma(vf a, vf b, vf c) { return _mm256_fmadd_ps(a, b, c); }
V_INLINE vf v_fnma(vf a, vf b, vf c) { return _mm256_fnmadd_ps(a, b, c); }
V_INLINE vf v_min(vf a, vf b) { return _mm256_min_ps(a, b); }
V_INLINE vf v_max(vf a, vf b) { return _mm256_max_ps(a, b); }
V_INLINE vf v_abs(vf a) { return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), a); }
V_INLINE vf v_sqrt(vf a) { return _mm256_sqrt_ps(a); }
V_INLINE vi v_trunc(vf a) { return _mm256_cvttps_epi32(a); }
V_INLINE vf v_float(vi a) { return _mm256_cvtepi32_ps(a); }
V_INLINE vi v_addi(vi a, vi b) { return _mm256_add_epi32(a, b); }
V_INLINE vi v_subi(vi a, vi b) { return _mm256_sub_epi32(a, b); }
V_INLINE vi v_muli(vi a, vi b) { return _mm256_mullo_epi32(a, b); }
V_INLINE vi v_mini(vi a, vi b) { return _mm256_min_epi32(a, b); }
V_INLINE vi v_maxu(vi a, vi b) { return _mm256_max_epu32(a, b); }
V_INLINE vm v_leu(vi a, vi b) { return _mm256_castsi256_ps(_mm256_cmpeq_epi32(_mm256_min_epu32(a, b), a)); }
V_INLINE vi v_shl(vi a, int n) { return _mm256_slli_epi32(a, n); }
V_INLINE vi v_sra(vi a, int n) { return _mm256_srai_epi32(a, n); }
V_INLINE vi v_shr(vi a, int n) { return _mm256_srli_epi32(a, n); }
V_INLINE vi v_andi(vi a, vi b) { return _mm256_and_si256(a, b); }
V_INLINE vi v_ori(vi a, vi b) { return _mm256_or_si256(a, b); }
V_INLINE vi v_bits(vf a) { return _mm256_castps_si256(a); }
V_INLINE vf v_from_bits(vi a) { return _mm256_castsi256_ps(a); }
V_INLINE vm v_lt(vf a, vf b) { return _mm256_cmp_ps(a, b, _CMP_LT_OQ); }
V_INLINE vm v_le(vf a, vf b) { return _mm256_cmp_ps(a, b, _CMP_LE_OQ); }
V_INLINE vm v_eq(vf a, vf b) { return _mm256_cmp_ps(a, b, _CMP_EQ_OQ); }
V_INLINE vf v_select(vm m, vf a, vf b) { return _mm256_blendv_ps(b, a, m); }
V_INLINE vm m_and(vm a, vm b) { return _mm256_and_ps(a, b); }
V_INLINE vm m_or(vm a, vm b) { return _mm256_or_ps(a, b); }
V_INLINE vm m_andnot(vm a, vm b) { return _mm256_andnot_ps(b, a); }
V_INLINE bool m_any(vm a) { return _mm256_movemask_ps(a) != 0; }
V_INLINE int m_count(vm a) { return __builtin_popcount((unsigned)_mm256_movemask_ps(a)); }
V_INLINE void v_store(float *p, vf a) { _mm256_storeu_ps(p, a); }
V_INLINE vf v_load(const float *p) { return _mm256_loadu_ps(p); }
V_INLINE void v_store_pixels(float *p, ptrdiff_t row, vf4 c) {
  vf rg = _mm256_unpacklo_ps(c.r, c.g), ba = _mm256_unpacklo_ps(c.b, c.a);
  vf rg2 = _mm256_unpackhi_ps(c.r, c.g), ba2 = _mm256_unpackhi_ps(c.b, c.a);
  vf x[4] = {_mm256_shuffle_ps(rg, ba, 0x44), _mm256_shuffle_ps(rg, ba, 0xee), _mm256_shuffle_ps(rg2, ba2, 0x44),
             _mm256_shuffle_ps(rg2, ba2, 0xee)};
  for (int k = 0; k < 4; k++) {
    _mm_storeu_ps(p + 4 * k, _mm256_castps256_ps128(x[k]));
    _mm_storeu_ps(p + 4 * (row + k), _mm256_extractf128_ps(x[k], 1));
  }
}
V_INLINE vi v_load_bytes(const uint8_t *p) { return _mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i *)(const void *)p)); }
V_INLINE vf v_gather(const float *base, vi off) { return _mm256_i32gather_ps(base, off, 4); }
V_INLINE unsigned m_bits(vm a) { return (unsigned)_mm256_movemask_ps(a); }
V_INLINE vf v_table(const float *table, vi at) { return v_gather(table, at); }
/* The set lanes' numbers, a byte each: those of four lanes from a table, then those of the other four. */
V_INLINE void v_compact(void *p, vm m, vf a) {
  static const uint32_t set[16] = {0, 0, 1, 0x100, 2, 0x200, 0x201, 0x20100, 3, 0x300, 0x301, 0x30100, 0x302, 0x30200, 0x30201, 0x3020100};
  const unsigned bits = m_bits(m), low = bits & 15;
  const uint64_t order = set[low] | (uint64_t)(set[bits >> 4] + 0x04040404) << 8 * __builtin_popcount(low);
  _mm256_storeu_ps((float *)p, _mm256_permutevar8x32_ps(a, _mm256_cvtepu8_epi32(_mm_cvtsi64_si128((long long)order))));
}
V_INLINE float v_least(vf a) {
  __m128 m = _mm_min_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps(a, 1));
  m = _mm_min_ps(m, _mm_movehl_ps(m, m));
  return _mm_cvtss_f32(_mm_min_ss(m, _mm_movehdup_ps(m)));
}

/* An integer put into the mantissa of 2^23 is a float at once. */
V_INLINE vf v_biased(vi bits) { return v_from_bits(v_ori(bits, v_seti(0x4b000000))); }
V_INLINE void v_biased_bytes(vi p, vf *a, vf *b) {
  *a = v_biased(v_andi(p, v_seti(255)));
  *b = v_biased(v_andi(v_shr(p, 8), v_seti(255)));
}
V_INLINE void v_biased_words(vi p, vf *a, vf *b) {
  *a = v_from_bits(_mm256_blend_epi16(p, v_seti(0x4b000000), 0xaa));
  *b = v_biased(v_shr(p, 16));
}
V_INLINE vi v_flip(vi a, uint32_t bits) { return _mm256_xor_si256(a, v_seti((int)bits)); }

V_INLINE v_places v_place(vi off) {
  v_places at;
  _mm256_store_si256((__m256i *)at.off, off);
  /* Through memory on purpose: extracting lanes from registers would occupy the ports that the arithmetic needs. */
  __asm__("" : "+m"(at.off));
  return at;
}
V_INLINE int v_lane(const char *p, const v_places *at, int lane, int size) {
  int x;
  memcpy(&x, p + (ptrdiff_t)at->off[lane] * size, sizeof x);
  return x;
}
/* Every load inserts its lane: fewer instructions than unpacking four loaded ones. */
V_INLINE __m128i v_four_lanes(const char *p, const v_places *at, int first, int size) {
  __m128i four = _mm_cvtsi32_si128(v_lane(p, at, first, size));
  four = _mm_insert_epi32(four, v_lane(p, at, first + 1, size), 1);
  four = _mm_insert_epi32(four, v_lane(p, at, first + 2, size), 2);
  return _mm_insert_epi32(four, v_lane(p, at, first + 3, size), 3);
}
V_INLINE vi v_load_lanes(const char *p, const v_places *at, int size) {
  return _mm256_inserti128_si256(_mm256_castsi128_si256(v_four_lanes(p, at, 0, size)), v_four_lanes(p, at, 4, size), 1);
}
#include "renderer/raycast/cpu/simd_pairs.h"
V_INLINE void v_load_pairs(const char *p, const v_places *at, int size, vf *a, vf *b) {
  const __m256 first = v_four_pairs(p, at->off, size), next = v_four_pairs(p, at->off + 2, size);
  *a = _mm256_shuffle_ps(first, next, 0x88);
  *b = _mm256_shuffle_ps(first, next, 0xdd);
}
V_INLINE vi v_byte_words(vi p, int first) {
  const int order = (int)0x80018000 + first * 0x10001;
  const __m128i all = _mm_setr_epi32(order, order + 0x40004, order + 0x80008, order + 0xc000c);
  return _mm256_shuffle_epi8(p, _mm256_broadcastsi128_si256(all));
}
V_INLINE vi v_weigh(vi words, vi weights) { return _mm256_madd_epi16(words, weights); }
V_INLINE void v_pair_f32(const void *base, const v_places *at, vf *a, vf *b) { v_load_pairs(base, at, 4, a, b); }
#include "renderer/raycast/cpu/simd_voxels.h"

V_INLINE void v_prefetch(const void *base, const v_places *at, int size) {
#pragma GCC unroll 4
  for (int l = 0; l < 8; l += 2)
    __builtin_prefetch((const void *)((uintptr_t)base + (uintptr_t)((ptrdiff_t)at->off[l] * size)));
}

/* Each lane loads whole entries of 16 bytes, lane 4s+g into the 128-bit slot s of group g. A 4x4 transpose within
 * the slots then ends in lane order: far fewer loads than sixteen gathers. */
V_INLINE vf v_slot_pair(const double *base, const int32_t *off, int g) {
  return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_castpd_ps(_mm_loadu_pd(base + off[g]))),
                              _mm_castpd_ps(_mm_loadu_pd(base + off[4 + g])), 1);
}
#define V_BILINEAR_GROUP(g)                                                                                          \
  ({                                                                                                                 \
    vf y_ = _mm256_permute_ps(fy, (g) * 0x55), x_ = _mm256_permute_ps(fx, (g) * 0x55);                               \
    vf a_ = v_slot_pair(halves, p.off, g), b_ = v_slot_pair(halves + 2, p.off, g);                                               \
    a_ = v_fma(y_, v_slot_pair(halves, q.off, g) - a_, a_);                                                                \
    b_ = v_fma(y_, v_slot_pair(halves + 2, q.off, g) - b_, b_);                                                            \
    v_fma(x_, b_ - a_, a_);                                                                                          \
  })
V_INLINE vf4 v_bilinear(const float *base, vi row0, vi row1, vf fx, vf fy) {
  const v_places p = v_place(v_shl(row0, 1)), q = v_place(v_shl(row1, 1));
  const double *halves = (const double *)(const void *)base; /* half entries: an address mode scales by 8, not by 16 */
  vf e0 = V_BILINEAR_GROUP(0), e1 = V_BILINEAR_GROUP(1), e2 = V_BILINEAR_GROUP(2), e3 = V_BILINEAR_GROUP(3);
  vf t0 = _mm256_unpacklo_ps(e0, e1), t1 = _mm256_unpackhi_ps(e0, e1);
  vf t2 = _mm256_unpacklo_ps(e2, e3), t3 = _mm256_unpackhi_ps(e2, e3);
  return (vf4){_mm256_shuffle_ps(t0, t2, 0x44), _mm256_shuffle_ps(t0, t2, 0xee), _mm256_shuffle_ps(t1, t3, 0x44),
               _mm256_shuffle_ps(t1, t3, 0xee)};
}

SIMD_PROVIDED;

#endif
