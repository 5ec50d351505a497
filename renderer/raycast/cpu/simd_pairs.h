/* Pairs of neighbouring elements in halves of registers, for AVX2 and AVX-512. Included by a simd_*.h. */

/* The 64 bits from p + size off[0] and from p + size off[1] on. */
V_INLINE __m128 v_two_pairs(const char *p, const int32_t *off, int size) {
  __m128i first = _mm_loadl_epi64((const __m128i *)(const void *)(p + (ptrdiff_t)off[0] * size));
  return _mm_loadh_pi(_mm_castsi128_ps(first), (const __m64 *)(const void *)(p + (ptrdiff_t)off[1] * size));
}
V_INLINE __m256 v_four_pairs(const char *p, const int32_t *off, int size) { /* of lanes 0, 1 and 4, 5 */
  return _mm256_insertf128_ps(_mm256_castps128_ps256(v_two_pairs(p, off, size)), v_two_pairs(p, off + 4, size), 1);
}
