/* The contract of the vector vocabulary, the operations that a simd_*.h provides to the kernel templates. To add an
 * instruction set, write such a header, ending with SIMD_PROVIDED, and a kernels_*.c, an isosurface_*.c and a
 * within_*.c that include it.
 *
 * Constants: V_LANES; V_PACKET_X * V_PACKET_Y = V_LANES; lane l is pixel (l % V_PACKET_X, l / V_PACKET_X) of a packet.
 *
 * Types: vf (V_LANES floats), vi (V_LANES int32_t), vm (V_LANES booleans), vf4 {vf r, g, b, a}. vf supports + - * / of
 * C, each rounded once to nearest; not the unary minus (write v_set(0) - a). Denormals are kept.
 *
 * The rows below are the lane-wise operations, OP(name, definition in one lane). simd_scalar.h is generated from them,
 * SIMD_PROVIDED checks that another header has all of them with the same types, and tests/unit/simd.c checks every lane
 * against the definition, for random and special values.
 * - Rounding: to nearest even. Only v_fma and v_fnma differ between instruction sets: they round once (fused) or twice.
 *   Hence kernels are bit-identical within an instruction set, and equal to the scalar one within a tolerance.
 * - NaN: comparisons with NaN are false. v_min and v_max return b if either is NaN or both are zeros. Kernels rely on
 *   this to clamp: v_max(NaN, v_set(0)) is 0.
 * - Integers wrap round. Shift counts are constants within 0..31.
 *
 * Not lane-wise, or with memory access (simd_scalar.h defines them in plain C):
 * - v_set, v_seti: the same in all lanes. v_lane_x, v_lane_y: the lane's pixel in the packet.
 * - v_trunc rounds towards zero; unspecified for NaN and outside int32_t. v_float rounds to nearest. v_bits and
 *   v_from_bits copy bits.
 * - m_any: true if any lane is set; m_count: number of set lanes; m_bits: lane l as bit l. v_least: the smallest lane;
 *   unspecified if one is NaN.
 * - v_store_pixels: a packet's pixels (r, g, b, a), rows of the packet `row` pixels apart.
 * - v_load, v_store: V_LANES floats, unaligned; v_load_bytes: V_LANES bytes, unsigned. v_gather: the float at offset
 *   off.
 * - v_table: entry at (0 to 95) of a table of 96 floats. v_compact: stores the set lanes one after another, 4 bytes each;
 *   may write V_LANES of them, the others unspecified.
 * - v_places: the lanes' offsets, where a load finds them fast. v_place: those of off.
 * - v_bytes: the byte at offset off. v_pair_T: elements at->off and at->off + 1, exactly; offsets count elements. Both may
 *   read, but not use, 3 bytes beyond: volumes and maps are padded.
 * - v_corner_T: the pair with V_BIAS_T added to each, exactly, for an instruction set where that is cheaper;
 *   field_tmpl.h has the default.
 * - Only if V_GATHERS is defined, for an instruction set whose gathers are faster than loads on some processors:
 *   v_gather_corner_T, v_corner_T by gathers.
 * - Only if V_TAPS is defined, for an instruction set that multiplies words. Of integers, from at->off on: v_row_T, four elements
 *   in a row, exactly; v_taps_T, their pairs of words (0, 1), (1, 2) and (2, 3), and v_tap_pair_T, the first of these pairs,
 *   which may read, but not use, 2 bytes beyond; both add a constant of the type T. v_weigh: the first word of each pair times
 *   the first weight plus the second times the second. Differences of weighed pairs are exact if both weights add up to
 *   V_SLOPE_SHARES.
 * - v_prefetch: prefetches the cache lines of some lanes' elements, of `size` bytes each; the addresses may be invalid.
 * - Only if V_NEAR is defined, for an instruction set whose permutations are cheaper than loads: v_near_T, a
 *   neighbourhood of V_NEAR_T (4 or 8) x 4 x 4 voxels; v_near_load_T: loads the neighbourhood whose lowest voxel is at
 *   p, with strides `row` and `slice` in voxels along y and z, reading these voxels alone; v_near_pair_T: elements at +
 *   more and at + more + 1, with V_BIAS_T added to each. Element x + V_NEAR_T (y + 4 z) is voxel (x, y, z); `at` is a cell's
 *   lowest corner, `more` 0, V_NEAR_T, 4 V_NEAR_T or 5 V_NEAR_T; unspecified in a lane whose cell lies outside. v_whole:
 *   rounded towards zero, as a float. v_slopes_T: the central differences (the next voxel less the one before) along each
 *   axis of 6 x `rows` x `slices` voxels, with rows and slices 4 and 4, 4 and 5, or 5 and 5 (f32: 4x4x4 voxels); those of
 *   integers must fit 16 bits. v_slopes_load_T: the same whose lowest voxel is at p, reading from p - slice - 1 on.
 *   v_slope_T: along axis k, between that of the voxel (0, y, z) beyond element `at` and that of its neighbour along x,
 *   0 <= f < 1 of the way from the first (element x + 8 y + 32 z, x <= 4; f32: x + 4 y + 16 z, x <= 2; y <= rows - 2,
 *   z <= slices - 2), rounded once. Of integers, f is cut to multiples of 1 / V_SLOPE_SHARES, and the result is
 *   V_SLOPE_SHARES times the slope: weights of 16 bits.
 * - v_bilinear: reads entries row0, row0 + 1, row1, row1 + 1 (4 floats each) of base, interpolates by fy between rows,
 *   then by fx, each as a + f (b - a) with v_fma: four equal entries give that entry, and fx = fy = 0 gives row0's.
 *
 * Order of a kernel's translation unit: kernels.h, then a simd_*.h, then kernels_tmpl.h or isosurface_kernels_tmpl.h, which
 * include the pieces (*_tmpl.h) bottom-up: clip, packet (rays), field, cubic, filter (samples), preintegration,
 * integrals, subtable, opacity_correction (colour and opacity), jitter, subpixel, segment, shading, gradient, labels, cover
 * (empty-space skipping), neighbourhood (samples of a march), lit (segments that wait for shading), termination, the
 * marches (dvr, back, projection, mpr or isosurface), and last tile (pixels, rows of variants). A piece uses only what
 * precedes it. */
#ifndef TC_SIMD_H
#define TC_SIMD_H

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Every operation is inlined, so that constant arguments stay constant. */
#define V_INLINE static inline __attribute__((always_inline))

/* vf (vf a) */
#define SIMD_UNARY(OP)                                                                                                \
  OP(v_abs, fabsf(a))                                                                                                 \
  OP(v_sqrt, sqrtf(a))

/* vf (vf a, vf b) */
#define SIMD_BINARY(OP)                                                                                               \
  OP(v_min, a < b ? a : b)                                                                                            \
  OP(v_max, a > b ? a : b)

/* vf (vf a, vf b, vf c): rounded once or twice */
#define SIMD_FUSED(OP)                                                                                                \
  OP(v_fma, a * b + c)                                                                                                \
  OP(v_fnma, c - a * b)

/* vm (vf a, vf b) */
#define SIMD_COMPARE(OP)                                                                                              \
  OP(v_lt, a < b)                                                                                                     \
  OP(v_le, a <= b)                                                                                                    \
  OP(v_eq, a == b)

/* vm (vm a, vm b) */
#define SIMD_MASK(OP)                                                                                                 \
  OP(m_and, a && b)                                                                                                   \
  OP(m_or, a || b)                                                                                                    \
  OP(m_andnot, a && !b)

/* vi (vi a, vi b) */
#define SIMD_INTEGER(OP)                                                                                              \
  OP(v_addi, (int32_t)((uint32_t)a + (uint32_t)b))                                                                    \
  OP(v_subi, (int32_t)((uint32_t)a - (uint32_t)b))                                                                    \
  OP(v_muli, (int32_t)((uint32_t)a * (uint32_t)b))                                                                    \
  OP(v_mini, a < b ? a : b)                                                                                           \
  OP(v_maxu, (uint32_t)a > (uint32_t)b ? a : b)                                                                       \
  OP(v_andi, a & b)                                                                                                   \
  OP(v_ori, a | b)

/* vi (vi a, int n) */
#define SIMD_SHIFT(OP)                                                                                                \
  OP(v_shl, (int32_t)((uint32_t)a << n))                                                                              \
  OP(v_sra, a >> n)                                                                                                   \
  OP(v_shr, (int32_t)((uint32_t)a >> n))

/* Voxel types: v_pair_T reads elements of this C type. */
#define SIMD_VOXELS(OP)                                                                                               \
  OP(u8, uint8_t)                                                                                                     \
  OP(i8, int8_t)                                                                                                      \
  OP(u16, uint16_t)                                                                                                   \
  OP(i16, int16_t)                                                                                                    \
  OP(f32, float)

/* vm (vi a, vi b) */
#define SIMD_ORDER(OP) OP(v_leu, (uint32_t)a <= (uint32_t)b)

#define SIMD_HAS(result, name, ...)                                                                                   \
  _Static_assert(__builtin_types_compatible_p(__typeof__(name), result(__VA_ARGS__)), #name " differs from simd.h")
#define SIMD_HAS_UNARY(name, meaning) SIMD_HAS(vf, name, vf);
#define SIMD_HAS_BINARY(name, meaning) SIMD_HAS(vf, name, vf, vf);
#define SIMD_HAS_FUSED(name, meaning) SIMD_HAS(vf, name, vf, vf, vf);
#define SIMD_HAS_COMPARE(name, meaning) SIMD_HAS(vm, name, vf, vf);
#define SIMD_HAS_MASK(name, meaning) SIMD_HAS(vm, name, vm, vm);
#define SIMD_HAS_INTEGER(name, meaning) SIMD_HAS(vi, name, vi, vi);
#define SIMD_HAS_ORDER(name, meaning) SIMD_HAS(vm, name, vi, vi);
#define SIMD_HAS_SHIFT(name, meaning) SIMD_HAS(vi, name, vi, int);
#define SIMD_HAS_PAIR(name, type) SIMD_HAS(void, v_pair_##name, const void *, const v_places *, vf *, vf *);

#define V_SLOPE_SHARES 16384
#define SIMD_HAS_NEAR(name, type)                                                                                     \
  SIMD_HAS(v_near_##name, v_near_load_##name, const void *, ptrdiff_t, ptrdiff_t);                                    \
  SIMD_HAS(void, v_near_pair_##name, const v_near_##name *, vi, int, vf *, vf *);                                    \
  SIMD_HAS(v_slopes_##name, v_slopes_load_##name, const void *, ptrdiff_t, ptrdiff_t, int, int);                      \
  SIMD_HAS(vf, v_slope_##name, const v_slopes_##name *, int, vi, int, int, vf);
#define SIMD_NEAR /* SIMD_VOXELS(SIMD_HAS_NEAR) SIMD_HAS(vf, v_whole, vf); where V_NEAR is */
#define SIMD_HAS_TAPS(name)                                                                                           \
  SIMD_HAS(void, v_row_##name, const void *, const v_places *, vf *);                                                 \
  SIMD_HAS(v_taps, v_taps_##name, const void *, const v_places *);                                                    \
  SIMD_HAS(vi, v_tap_pair_##name, const void *, const v_places *);
#define SIMD_TAPS /* as simd_voxels.h defines it, where V_TAPS is */

#define SIMD_PROVIDED                                                                                                 \
  SIMD_UNARY(SIMD_HAS_UNARY)                                                                                          \
  SIMD_BINARY(SIMD_HAS_BINARY)                                                                                        \
  SIMD_FUSED(SIMD_HAS_FUSED)                                                                                          \
  SIMD_COMPARE(SIMD_HAS_COMPARE)                                                                                      \
  SIMD_MASK(SIMD_HAS_MASK)                                                                                            \
  SIMD_INTEGER(SIMD_HAS_INTEGER)                                                                                      \
  SIMD_SHIFT(SIMD_HAS_SHIFT)                                                                                          \
  SIMD_ORDER(SIMD_HAS_ORDER)                                                                                          \
  SIMD_VOXELS(SIMD_HAS_PAIR)                                                                                          \
  SIMD_NEAR                                                                                                           \
  SIMD_TAPS                                                                                                           \
  SIMD_HAS(vf, v_set, float);                                                                                         \
  SIMD_HAS(vi, v_seti, int);                                                                                          \
  SIMD_HAS(vf, v_lane_x, void);                                                                                       \
  SIMD_HAS(vf, v_lane_y, void);                                                                                       \
  SIMD_HAS(vi, v_trunc, vf);                                                                                          \
  SIMD_HAS(vf, v_float, vi);                                                                                          \
  SIMD_HAS(vi, v_bits, vf);                                                                                           \
  SIMD_HAS(vf, v_from_bits, vi);                                                                                      \
  SIMD_HAS(vf, v_select, vm, vf, vf);                                                                                 \
  SIMD_HAS(bool, m_any, vm);                                                                                          \
  SIMD_HAS(int, m_count, vm);                                                                                         \
  SIMD_HAS(unsigned, m_bits, vm);                                                                                     \
  SIMD_HAS(float, v_least, vf);                                                                                       \
  SIMD_HAS(vf, v_load, const float *);                                                                                \
  SIMD_HAS(void, v_store, float *, vf);                                                                               \
  SIMD_HAS(void, v_store_pixels, float *, ptrdiff_t, vf4);                                                            \
  SIMD_HAS(vi, v_load_bytes, const uint8_t *);                                                                        \
  SIMD_HAS(vf, v_gather, const float *, vi);                                                                          \
  SIMD_HAS(vi, v_bytes, const uint8_t *, vi);                                                                         \
  SIMD_HAS(vf, v_table, const float *, vi);                                                                           \
  SIMD_HAS(void, v_compact, void *, vm, vf);                                                                          \
  SIMD_HAS(v_places, v_place, vi);                                                                                    \
  SIMD_HAS(void, v_prefetch, const void *, const v_places *, int);                                                    \
  SIMD_HAS(vf4, v_bilinear, const float *, vi, vi, vf, vf);                                                           \
  _Static_assert(V_PACKET_X * V_PACKET_Y == V_LANES, "a packet's pixels are its lanes")

#endif
