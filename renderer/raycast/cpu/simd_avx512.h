/* The vector vocabulary, 16 lanes of AVX-512 (F, BW, DQ, VL): a packet of 4x4 pixels. */
#ifndef TC_SIMD_AVX512_H
#define TC_SIMD_AVX512_H

#include <immintrin.h>

#include "renderer/raycast/cpu/simd.h"

#define V_LANES 16
#define V_PACKET_X 4
#define V_PACKET_Y 4

typedef __m512 vf;
typedef __m512i vi;
typedef __mmask16 vm;
typedef struct vf4 { vf r, g, b, a; } vf4;
typedef struct v_places { int32_t off[16] __attribute__((aligned(64))); } v_places;

V_INLINE vf v_set(float x) { return _mm512_set1_ps(x); }
V_INLINE vi v_seti(int x) { return _mm512_set1_epi32(x); }
V_INLINE vf v_lane_x(void) { return _mm512_setr_ps(0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3); }
V_INLINE vf v_lane_y(void) { return _mm512_setr_ps(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3); }
V_INLINE vf v_fma(vf a, vf b, vf c) { return _mm512_fmadd_ps(a, b, c); }
V_INLINE vf v_fnma(vf a, vf b, vf c) { return _mm512_fnmadd_ps(a, b, c); }
V_INLINE vf v_min(vf a, vf b) { return _mm512_min_ps(a, b); }
V_INLINE vf v_max(vf a, vf b) { return _mm512_max_ps(a, b); }
V_INLINE vf v_abs(vf a) { return _mm512_abs_ps(a); }
V_INLINE vf v_sqrt(vf a) { return _mm512_sqrt_ps(a); }
V_INLINE vi v_trunc(vf a) { return _mm512_cvttps_epi32(a); }
V_INLINE vf v_float(vi a) { return _mm512_cvtepi32_ps(a); }
V_INLINE vi v_addi(vi a, vi b) { return _mm512_add_epi32(a, b); }
V_INLINE vi v_subi(vi a, vi b) { return _mm512_sub_epi32(a, b); }
V_INLINE vi v_muli(vi a, vi b) { return _mm512_mullo_epi32(a, b); }
V_INLINE vi v_mini(vi a, vi b) { return _mm512_min_epi32(a, b); }
V_INLINE vi v_maxu(vi a, vi b) { return _mm512_max_epu32(a, b); }
V_INLINE vm v_leu(vi a, vi b) { return _mm512_cmple_epu32_mask(a, b); }
V_INLINE vi v_shl(vi a, int n) { return _mm512_slli_epi32(a, (unsigned)n); }
V_INLINE vi v_sra(vi a, int n) { return _mm512_srai_epi32(a, (unsigned)n); }
V_INLINE vi v_shr(vi a, int n) { return _mm512_srli_epi32(a, (unsigned)n); }
V_INLINE vi v_andi(vi a, vi b) { return _mm512_and_si512(a, b); }
V_INLINE vi v_ori(vi a, vi b) { return _mm512_or_si512(a, b); }
V_INLINE vi v_bits(vf a) { return _mm512_castps_si512(a); }
V_INLINE vf v_from_bits(vi a) { return _mm512_castsi512_ps(a); }
V_INLINE vm v_lt(vf a, vf b) { return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ); }
V_INLINE vm v_le(vf a, vf b) { return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ); }
V_INLINE vm v_eq(vf a, vf b) { return _mm512_cmp_ps_mask(a, b, _CMP_EQ_OQ); }
V_INLINE vf v_select(vm m, vf a, vf b) { return _mm512_mask_blend_ps(m, b, a); }
V_INLINE vm m_and(vm a, vm b) { return (vm)(a & b); }
V_INLINE vm m_or(vm a, vm b) { return (vm)(a | b); }
V_INLINE vm m_andnot(vm a, vm b) { return (vm)(a & ~b); }
V_INLINE bool m_any(vm a) { return a != 0; }
V_INLINE int m_count(vm a) { return __builtin_popcount(a); }
V_INLINE void v_store(float *p, vf a) { _mm512_storeu_ps(p, a); }
V_INLINE vf v_load(const float *p) { return _mm512_loadu_ps(p); }
V_INLINE void v_store_pixels(float *p, ptrdiff_t row, vf4 c) {
  vf rg = _mm512_unpacklo_ps(c.r, c.g), ba = _mm512_unpacklo_ps(c.b, c.a);
  vf rg2 = _mm512_unpackhi_ps(c.r, c.g), ba2 = _mm512_unpackhi_ps(c.b, c.a);
  vf x0 = _mm512_shuffle_ps(rg, ba, 0x44), x1 = _mm512_shuffle_ps(rg, ba, 0xee); /* pixels 0, 1 of the four rows */
  vf x2 = _mm512_shuffle_ps(rg2, ba2, 0x44), x3 = _mm512_shuffle_ps(rg2, ba2, 0xee);
  vf low = _mm512_shuffle_f32x4(x0, x1, 0x44), low2 = _mm512_shuffle_f32x4(x2, x3, 0x44);
  vf high = _mm512_shuffle_f32x4(x0, x1, 0xee), high2 = _mm512_shuffle_f32x4(x2, x3, 0xee);
  v_store(p, _mm512_shuffle_f32x4(low, low2, 0x88));
  v_store(p + 4 * row, _mm512_shuffle_f32x4(low, low2, 0xdd));
  v_store(p + 8 * row, _mm512_shuffle_f32x4(high, high2, 0x88));
  v_store(p + 12 * row, _mm512_shuffle_f32x4(high, high2, 0xdd));
}
V_INLINE vi v_load_bytes(const uint8_t *p) { return _mm512_cvtepu8_epi32(_mm_loadu_si128((const __m128i *)(const void *)p)); }
V_INLINE vf v_gather(const float *base, vi off) { return _mm512_i32gather_ps(off, base, 4); }
V_INLINE unsigned m_bits(vm a) { return a; }
V_INLINE vf v_table(const float *table, vi at) {
  vf low = _mm512_permutex2var_ps(v_load(table), at, v_load(table + 16));
  vf middle = _mm512_permutex2var_ps(v_load(table + 32), at, v_load(table + 48));
  vf high = _mm512_permutex2var_ps(v_load(table + 64), at, v_load(table + 80));
  low = _mm512_mask_blend_ps(_mm512_test_epi32_mask(at, v_seti(32)), low, middle);
  return _mm512_mask_blend_ps(_mm512_test_epi32_mask(at, v_seti(64)), low, high);
}
/* Compressed in a register: a compressing store is microcoded on some CPUs. */
V_INLINE void v_compact(void *p, vm m, vf a) { _mm512_storeu_ps(p, _mm512_maskz_compress_ps(m, a)); }
V_INLINE float v_least(vf a) { return _mm512_reduce_min_ps(a); }

/* Pairs plus a bias: an integer put into the mantissa of 2^23 becomes a float in one instruction, and the bias
 * cancels exactly in differences. */
V_INLINE vf v_biased(vi bits, __mmask64 bytes, vi order) {
  return v_from_bits(_mm512_mask_shuffle_epi8(v_seti(0x4b000000), bytes, bits, order));
}
V_INLINE void v_biased_bytes(vi p, vf *a, vf *b) {
  const __mmask64 low = 0x1111111111111111;
  *a = v_from_bits(_mm512_mask_blend_epi8(low, v_seti(0x4b000000), p));
  *b = v_biased(p, low, _mm512_set4_epi32(13, 9, 5, 1));
}
V_INLINE void v_biased_words(vi p, vf *a, vf *b) {
  *a = v_from_bits(_mm512_mask_blend_epi16(0x55555555, v_seti(0x4b000000), p));
  *b = v_biased(p, 0x3333333333333333, _mm512_set4_epi32(0x0f0e, 0x0b0a, 0x0706, 0x0302));
}
V_INLINE vi v_flip(vi a, uint32_t bits) { return _mm512_xor_si512(a, v_seti((int)bits)); }

V_INLINE v_places v_place(vi off) {
  v_places at;
  _mm512_store_si512(at.off, off);
  /* Through memory on purpose: extracting lanes from registers would occupy the ports that the arithmetic needs. */
  __asm__("" : "+m"(at.off));
  return at;
}
#define V_LANE(l) _mm_loadu_si32(p + (ptrdiff_t)off[l] * size)
V_INLINE __m128i v_load_four(const char *p, const int32_t *off, int size) {
  return _mm_unpacklo_epi64(_mm_unpacklo_epi32(V_LANE(0), V_LANE(1)), _mm_unpacklo_epi32(V_LANE(2), V_LANE(3)));
}
V_INLINE vi v_load_lanes(const char *p, const v_places *at, int size) {
  __m256i low = _mm256_inserti128_si256(_mm256_castsi128_si256(v_load_four(p, at->off, size)), v_load_four(p, at->off + 4, size), 1);
  __m256i high = _mm256_inserti128_si256(_mm256_castsi128_si256(v_load_four(p, at->off + 8, size)), v_load_four(p, at->off + 12, size), 1);
  return _mm512_inserti64x4(_mm512_castsi256_si512(low), high, 1);
}
#include "renderer/raycast/cpu/simd_pairs.h"
V_INLINE __m512 v_eight_pairs(const char *p, const int32_t *off, int size) { /* and of 8, 9 and 12, 13 */
  const __m256d low = _mm256_castps_pd(v_four_pairs(p, off, size));
  const __m256d high = _mm256_castps_pd(v_four_pairs(p, off + 8, size));
  return _mm512_castpd_ps(_mm512_insertf64x4(_mm512_castpd256_pd512(low), high, 1));
}
V_INLINE void v_load_pairs(const char *p, const v_places *at, int size, vf *a, vf *b) {
  const __m512 first = v_eight_pairs(p, at->off, size), next = v_eight_pairs(p, at->off + 2, size);
  *a = _mm512_shuffle_ps(first, next, 0x88);
  *b = _mm512_shuffle_ps(first, next, 0xdd);
}
V_INLINE vi v_byte_words(vi p, int first) {
  const int order = (int)0x80018000 + first * 0x10001;
  return _mm512_shuffle_epi8(p, _mm512_set4_epi32(order + 0xc000c, order + 0x80008, order + 0x40004, order));
}
V_INLINE vi v_weigh(vi words, vi weights) { return _mm512_madd_epi16(words, weights); }
V_INLINE void v_pair_f32(const void *base, const v_places *at, vf *a, vf *b) { v_load_pairs(base, at, 4, a, b); }
#include "renderer/raycast/cpu/simd_voxels.h"

#define V_GATHERS
#define V_GATHER_CORNER(name, size, flips, biased)                                                                    \
  V_INLINE void v_gather_corner_##name(const void *base, const v_places *at, vf *a, vf *b) {                          \
    biased(v_flip(_mm512_i32gather_epi32(_mm512_load_si512(at->off), base, size), flips), a, b);                      \
  }
V_GATHER_CORNER(u8, 1, 0, v_biased_bytes)
V_GATHER_CORNER(i8, 1, 0x80808080, v_biased_bytes)
V_GATHER_CORNER(u16, 2, 0, v_biased_words)
V_GATHER_CORNER(i16, 2, 0x80008000, v_biased_words)
V_INLINE void v_gather_corner_f32(const void *base, const v_places *at, vf *a, vf *b) {
  const vi off = _mm512_load_si512(at->off);
  *a = v_gather(base, off), *b = v_gather((const float *)base + 1, off);
}

V_INLINE void v_prefetch(const void *base, const v_places *at, int size) {
#pragma GCC unroll 8
  for (int l = 0; l < 16; l += 2)
    __builtin_prefetch((const void *)((uintptr_t)base + (uintptr_t)((ptrdiff_t)at->off[l] * size)));
}

/* Neighbourhoods: rows of 8 bytes in two registers, rows of 8 words or of 4 floats in four, one per slice. One permutation, or
 * two, per corner finds the pairs of all lanes. */
#define V_NEAR
#define V_NEAR_U8 8
#define V_NEAR_I8 8
#define V_NEAR_U16 8
#define V_NEAR_I16 8
#define V_NEAR_F32 4
#undef SIMD_NEAR
#define SIMD_NEAR SIMD_VOXELS(SIMD_HAS_NEAR) SIMD_HAS(vf, v_whole, vf);
typedef struct v_near_words { vi low, high; } v_near_words; /* slices 0 and 1, 2 and 3 */
typedef struct v_near_floats { vf z[4]; } v_near_floats;
typedef struct v_near_slices { vi z[4]; } v_near_slices;
typedef v_near_words v_near_u8, v_near_i8;
typedef v_near_slices v_near_u16, v_near_i16;
typedef v_near_floats v_near_f32;

V_INLINE __m128i v_two_rows(const char *p, ptrdiff_t row) {
  __m128i first = _mm_loadl_epi64((const __m128i *)(const void *)p);
  return _mm_castps_si128(_mm_loadh_pi(_mm_castsi128_ps(first), (const __m64 *)(const void *)(p + row)));
}
V_INLINE __m256i v_four_rows(const char *p, ptrdiff_t row) {
  return _mm256_inserti128_si256(_mm256_castsi128_si256(v_two_rows(p, row)), v_two_rows(p + 2 * row, row), 1);
}
V_INLINE vi v_two_slices(const char *p, ptrdiff_t row, ptrdiff_t slice) {
  return _mm512_inserti64x4(_mm512_castsi256_si512(v_four_rows(p, row)), v_four_rows(p + slice, row), 1);
}
/* row, slice: bytes */
V_INLINE v_near_words v_near_of(const char *p, ptrdiff_t row, ptrdiff_t slice, vi flips) {
  return (v_near_words){_mm512_xor_si512(v_two_slices(p, row, slice), flips),
                        _mm512_xor_si512(v_two_slices(p + 2 * slice, row, slice), flips)};
}
V_INLINE vf v_float_slice(const float *p, ptrdiff_t row) {
  __m256 low = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(p)), _mm_loadu_ps(p + row), 1);
  p += 2 * row;
  __m256 high = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(p)), _mm_loadu_ps(p + row), 1);
  return _mm512_castpd_ps(
      _mm512_insertf64x4(_mm512_castps_pd(_mm512_castps256_ps512(low)), _mm256_castps_pd(high), 1));
}
V_INLINE v_near_u8 v_near_load_u8(const void *p, ptrdiff_t row, ptrdiff_t slice) {
  return v_near_of((const char *)p, row, slice, v_seti(0));
}
V_INLINE v_near_i8 v_near_load_i8(const void *p, ptrdiff_t row, ptrdiff_t slice) {
  return v_near_of((const char *)p, row, slice, v_seti((int)0x80808080));
}
V_INLINE __m256i v_two_eights(const char *p, ptrdiff_t row) {
  const __m128i *at = (const __m128i *)(const void *)p, *next = (const __m128i *)(const void *)(p + row);
  return _mm256_inserti128_si256(_mm256_castsi128_si256(_mm_loadu_si128(at)), _mm_loadu_si128(next), 1);
}
/* Four rows of eight words; row: bytes. */
V_INLINE vi v_words_slice(const char *p, ptrdiff_t row) {
  return _mm512_inserti64x4(_mm512_castsi256_si512(v_two_eights(p, row)), v_two_eights(p + 2 * row, row), 1);
}
V_INLINE v_near_u16 v_near_load_u16(const void *p, ptrdiff_t row, ptrdiff_t slice) {
  v_near_u16 n;
#pragma GCC unroll 4
  for (int z = 0; z < 4; z++) n.z[z] = v_words_slice((const char *)p + 2 * z * slice, 2 * row);
  return n;
}
V_INLINE v_near_i16 v_near_load_i16(const void *p, ptrdiff_t row, ptrdiff_t slice) {
  v_near_i16 n = v_near_load_u16(p, row, slice);
#pragma GCC unroll 4
  for (int z = 0; z < 4; z++) n.z[z] = _mm512_xor_si512(n.z[z], v_seti((int)0x80008000));
  return n;
}
V_INLINE v_near_f32 v_near_load_f32(const void *p, ptrdiff_t row, ptrdiff_t slice) {
  v_near_f32 n;
#pragma GCC unroll 4
  for (int z = 0; z < 4; z++) n.z[z] = v_float_slice((const float *)p + z * slice, row);
  return n;
}

V_INLINE vf v_whole(vf a) { return _mm512_roundscale_ps(a, _MM_FROUND_TO_ZERO | _MM_FROUND_NO_EXC); }

/* A constant from memory. GCC 12 broadcasts constants from general registers instead, on the ports that permutations need. */
V_INLINE vi v_loaded(const int32_t *constant) {
  vi all;
  __asm__("vpbroadcastd %1, %0" : "=v"(all) : "m"(*constant));
  return all;
}
/* `words` in both halves, for the rows and slices of a cell: 4, 8, 16 or 20. */
V_INLINE vi v_near_more(int words) {
  static const int32_t more[] = {0, 4 * 0x10001, 8 * 0x10001, 0, 16 * 0x10001, 20 * 0x10001};
  return v_loaded(&more[words / 4]);
}
V_INLINE vi v_near_both(vi at) {
  static const int32_t next = 0x10000;
  return v_addi(_mm512_or_si512(at, v_shl(at, 16)), v_loaded(&next));
}
/* One permutation finds the voxels of cells in slices 0 and 1, one more those of cells in slice 2, or in slices 2 and 3. */
V_INLINE __mmask32 v_from_third(vi at) { return _mm512_test_epi16_mask(v_near_both(at), v_seti(0x00400040)); }
V_INLINE vi v_near_words_at(const vi *z, vi at, vi both, int slices) {
  const vi words = _mm512_permutex2var_epi16(z[0], both, z[1]);
  if (slices == 3) return _mm512_mask_permutexvar_epi16(words, v_from_third(at), both, z[2]);
  return _mm512_mask_blend_epi16(v_from_third(at), words, _mm512_permutex2var_epi16(z[2], both, z[3]));
}
V_INLINE void v_near_pair_u16(const v_near_slices *n, vi at, int more, vf *a, vf *b) {
  vi both = more % 32 ? v_addi(v_near_both(at), v_near_more(more % 32)) : v_near_both(at);
  v_biased_words(v_near_words_at(n->z + more / 32, at, both, 3), a, b);
}
#define v_near_pair_i16 v_near_pair_u16
/* The permutation fetches the two words that hold the bytes, which are one word where `at` is even. */
V_INLINE void v_near_pair_u8(const v_near_words *n, vi at, int more, vf *a, vf *b) {
  static const int32_t one = 1;
  vi both = _mm512_srli_epi16(v_near_both(at), 1), odd = v_andi(at, v_loaded(&one));
  if (more) both = v_addi(both, v_near_more(more / 2));
  vi words = _mm512_permutex2var_epi16(n->low, both, n->high);
  *a = v_biased(words, 0x1111111111111111, v_addi(_mm512_set4_epi32(12, 8, 4, 0), odd));
  *b = v_biased(words, 0x1111111111111111, v_subi(_mm512_set4_epi32(15, 11, 7, 3), odd));
}
#define v_near_pair_i8 v_near_pair_u8
V_INLINE vf v_near_float(const v_near_floats *n, vi at, __mmask16 high) {
  vf in_low = _mm512_permutex2var_ps(n->z[0], at, n->z[1]);
  vf in_high = _mm512_permutex2var_ps(n->z[2], at, n->z[3]);
  return _mm512_mask_blend_ps(high, in_low, in_high);
}
V_INLINE void v_near_pair_f32(const v_near_floats *n, vi at, int more, vf *a, vf *b) {
  const __mmask16 high = _mm512_test_epi32_mask(v_addi(at, v_seti(more & ~15)), v_seti(32));
  *a = v_near_float(n, v_addi(at, v_seti(more)), high);
  *b = v_near_float(n, v_addi(at, v_seti(more + 1)), high);
}

/* Slopes of integers are words. A register holds four rows of 8 of a slice, whose first six are the slopes along x and whose
 * second to seventh are those along y and z. Of five rows, the last four are in registers of their own. */
typedef struct v_slope_words {
  vi along[3][5], next_row[3][5];
  int rows, slices; /* constants after inlining */
} v_slope_words;
typedef v_slope_words v_slopes_u8, v_slopes_i8, v_slopes_u16, v_slopes_i16;
typedef struct v_slopes_f32 { v_near_floats along[3]; } v_slopes_f32;

V_INLINE __m128i v_eight(const char *p, int bytes, bool negative) {
  const __m128i *at = (const __m128i *)(const void *)p;
  if (bytes == 2) return _mm_loadu_si128(at);
  return negative ? _mm_cvtepi8_epi16(_mm_loadl_epi64(at)) : _mm_cvtepu8_epi16(_mm_loadl_epi64(at));
}
V_INLINE vi v_four_eights(const char *p, int bytes, bool negative, ptrdiff_t row) {
  if (bytes == 1)
    return negative ? _mm512_cvtepi8_epi16(v_four_rows(p, row)) : _mm512_cvtepu8_epi16(v_four_rows(p, row));
  return v_words_slice(p, row);
}
V_INLINE vi v_eight_four_times(const char *p, int bytes, bool negative) {
  return _mm512_broadcast_i64x2(v_eight(p, bytes, negative));
}
/* row, slice: bytes */
V_INLINE v_slope_words v_slope_words_load(const char *p, int bytes, bool negative, ptrdiff_t row, ptrdiff_t slice,
                                          int rows, int slices) {
  const bool more = rows > 4;
  vi at[7], next_row[7]; /* rows 0 to 3 and 1 to 4 of the slices from the one before on */
  v_slope_words n = {.rows = rows, .slices = slices};
  p -= bytes;
#pragma GCC unroll 7
  for (int k = 0; k < slices + 2; k++) {
    const char *const from = p + (k - 1) * slice;
    at[k] = v_four_eights(from, bytes, negative, row);
    if (more || (k > 0 && k <= slices))
      next_row[k] = _mm512_alignr_epi64(v_eight_four_times(from + 4 * row, bytes, negative), at[k], 2);
  }
#pragma GCC unroll 5
  for (int k = 0; k < slices; k++) {
    const vi before = _mm512_alignr_epi64(at[1 + k], v_eight_four_times(p + k * slice - row, bytes, negative), 6);
    n.along[0][k] = _mm512_sub_epi16(_mm512_bsrli_epi128(at[1 + k], 4), at[1 + k]);
    n.along[1][k] = _mm512_sub_epi16(next_row[1 + k], before);
    n.along[2][k] = _mm512_sub_epi16(at[2 + k], at[k]);
    if (!more) continue;
    const vi last = v_eight_four_times(p + k * slice + 5 * row, bytes, negative);
    n.next_row[0][k] = _mm512_sub_epi16(_mm512_bsrli_epi128(next_row[1 + k], 4), next_row[1 + k]);
    n.next_row[1][k] = _mm512_sub_epi16(_mm512_alignr_epi64(last, next_row[1 + k], 2), at[1 + k]);
    n.next_row[2][k] = _mm512_sub_epi16(next_row[2 + k], next_row[k]);
  }
  return n;
}
V_INLINE v_slopes_f32 v_slopes_load_f32(const void *voxels, ptrdiff_t row, ptrdiff_t slice, int rows, int slices) {
  (void)rows, (void)slices;
  const float *p = voxels;
  v_slopes_f32 n;
#pragma GCC unroll 4
  for (int k = 0; k < 4; k++, p += slice) {
    n.along[0].z[k] = v_float_slice(p + 1, row) - v_float_slice(p - 1, row);
    n.along[1].z[k] = v_float_slice(p + row, row) - v_float_slice(p - row, row);
    n.along[2].z[k] = v_float_slice(p + slice, row) - v_float_slice(p - slice, row);
  }
  return n;
}

V_INLINE vf v_slope_words_at(const v_slope_words *n, int k, vi at, int y, int z, vf f) {
  const vi upper = v_trunc(f * v_set(V_SLOPE_SHARES)), lower = v_subi(v_seti(V_SLOPE_SHARES), upper);
  const bool further = y && n->rows > 4;
  vi both = v_addi(v_near_both(at), v_seti(((further ? 0 : 8 * y) + (k > 0)) * 0x10001));
  vi words = v_near_words_at((further ? n->next_row : n->along)[k] + z, at, both, n->slices - 1);
  return v_float(_mm512_madd_epi16(words, v_ori(lower, v_shl(upper, 16))));
}
#define V_SLOPES(name, type)                                                                                          \
  V_INLINE v_slopes_##name v_slopes_load_##name(const void *p, ptrdiff_t row, ptrdiff_t slice, int rows, int slices) { \
    const ptrdiff_t bytes = sizeof(type);                                                                             \
    return v_slope_words_load((const char *)p, (int)bytes, (type)-1 < 0, bytes * row, bytes * slice, rows, slices);   \
  }                                                                                                                   \
  V_INLINE vf v_slope_##name(const v_slopes_##name *n, int k, vi at, int y, int z, vf f) {                            \
    return v_slope_words_at(n, k, at, y, z, f);                                                                       \
  }
V_SLOPES(u8, uint8_t)
V_SLOPES(i8, int8_t)
V_SLOPES(u16, uint16_t)
V_SLOPES(i16, int16_t)
V_INLINE vf v_slope_f32(const v_slopes_f32 *n, int k, vi at, int y, int z, vf f) {
  vf slope, next;
  v_near_pair_f32(&n->along[k], at, 4 * y + 16 * z, &slope, &next);
  return v_fma(f, next - slope, slope);
}

/* One load fetches two neighbouring entries (32 bytes). Group g holds lanes g, 4+g, 8+g and 12+g, one entry per
 * 128-bit slot. A 4x4 transpose within the slots then ends in lane order: far fewer loads than sixteen gathers. */
V_INLINE vf v_entry_pairs(const double *base, const int32_t *off, int a, int b) {
  vf v = _mm512_castps256_ps512(_mm256_castpd_ps(_mm256_loadu_pd(base + off[a])));
  return _mm512_castpd_ps(_mm512_insertf64x4(_mm512_castps_pd(v), _mm256_loadu_pd(base + off[b]), 1));
}
V_INLINE vf v_pair_weights(vf f, int a, int b) {
  return _mm512_permutexvar_ps(_mm512_setr_epi32(a, a, a, a, a, a, a, a, b, b, b, b, b, b, b, b), f);
}
#define V_BILINEAR_GROUP(g)                                                                                          \
  ({                                                                                                                 \
    vf x_ = _mm512_permute_ps(fx, (g) * 0x55);                                                                       \
    vf a_ = v_entry_pairs(halves, p.off, g, 4 + (g)), b_ = v_entry_pairs(halves, p.off, 8 + (g), 12 + (g));                  \
    a_ = v_fma(v_pair_weights(fy, g, 4 + (g)), v_entry_pairs(halves, q.off, g, 4 + (g)) - a_, a_);                   \
    b_ = v_fma(v_pair_weights(fy, 8 + (g), 12 + (g)), v_entry_pairs(halves, q.off, 8 + (g), 12 + (g)) - b_, b_);            \
    vf low_ = _mm512_shuffle_f32x4(a_, b_, 0x88);                                                                    \
    v_fma(x_, _mm512_shuffle_f32x4(a_, b_, 0xdd) - low_, low_);                                                      \
  })
V_INLINE vf4 v_bilinear(const float *base, vi row0, vi row1, vf fx, vf fy) {
  v_places p, q;
  _mm512_store_si512(p.off, v_shl(row0, 1));
  _mm512_store_si512(q.off, v_shl(row1, 1));
  __asm__("" : "+m"(p.off), "+m"(q.off)); /* as in v_place() */
  const double *halves = (const double *)(const void *)base; /* half entries: an address mode scales by 8, not by 16 */
  vf e0 = V_BILINEAR_GROUP(0), e1 = V_BILINEAR_GROUP(1), e2 = V_BILINEAR_GROUP(2), e3 = V_BILINEAR_GROUP(3);
  vf t0 = _mm512_unpacklo_ps(e0, e1), t1 = _mm512_unpackhi_ps(e0, e1);
  vf t2 = _mm512_unpacklo_ps(e2, e3), t3 = _mm512_unpackhi_ps(e2, e3);
  return (vf4){_mm512_shuffle_ps(t0, t2, 0x44), _mm512_shuffle_ps(t0, t2, 0xee), _mm512_shuffle_ps(t1, t3, 0x44),
               _mm512_shuffle_ps(t1, t3, 0xee)};
}

SIMD_PROVIDED;

#endif
