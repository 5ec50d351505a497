/* Pairs of neighbouring floats in halves of registers, for AVX2 and AVX-512. Included by a simd_*.h. */

/* The pairs of floats at off[0] and off[1]. */
V_INLINE __m128 v_two_pairs(const float *p, const int32_t *off) {
  __m128i first = _mm_loadl_epi64((const __m128i *)(const void *)(p + off[0]));
  return _mm_loadh_pi(_mm_castsi128_ps(first), (const __m64 *)(const void *)(p + off[1]));
}
V_INLINE __m256 v_four_pairs(const float *p, const int32_t *off) { /* of lanes 0, 1 and 4, 5 */
  return _mm256_insertf128_ps(_mm256_castps128_ps256(v_two_pairs(p, off)), v_two_pairs(p, off + 4), 1);
}
