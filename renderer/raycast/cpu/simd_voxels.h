/* Integer voxels of the vector vocabulary, for instruction sets of several lanes: one load fetches a voxel and its right
 * neighbour, and reads up to 3 bytes beyond them. Loads instead of gathers, whose cost differs more than tenfold between
 * processors and their microcodes. Included by a simd_*.h after v_place; v_load_lanes, 32 bits from p + size times each
 * lane's offset on; v_load_pairs, 64 bits; v_byte_words, the bytes `first` and first + 1 of each lane as words; v_weigh; and
 * v_biased_bytes and v_biased_words, which put the two lowest elements of each lane, unsigned, into the mantissa of 2^23. */
V_INLINE vi v_bytes(const uint8_t *base, vi off) {
  const v_places at = v_place(off);
  return v_andi(v_load_lanes((const char *)base, &at, 1), v_seti(255));
}

/* first, second: the two lowest elements of the 32 bits p */
#define V_VOXELS(name, size, flips, biased, first, second)                                                            \
  V_INLINE void v_split_##name(vi p, vf *a, vf *b) { *a = v_float(first), *b = v_float(second); }                     \
  V_INLINE void v_pair_##name(const void *base, const v_places *at, vf *a, vf *b) {                                   \
    v_split_##name(v_load_lanes((const char *)base, at, size), a, b);                                                 \
  }                                                                                                                   \
  V_INLINE void v_corner_##name(const void *base, const v_places *at, vf *a, vf *b) {                                 \
    biased(v_flip(v_load_lanes((const char *)base, at, size), flips), a, b);                                          \
  }
V_VOXELS(u8, 1, 0, v_biased_bytes, v_andi(p, v_seti(255)), v_andi(v_shr(p, 8), v_seti(255)))
V_VOXELS(i8, 1, 0x80808080, v_biased_bytes, v_sra(v_shl(p, 24), 24), v_sra(v_shl(p, 16), 24))
V_VOXELS(u16, 2, 0, v_biased_words, v_andi(p, v_seti(0xffff)), v_shr(p, 16))
V_VOXELS(i16, 2, 0x80008000, v_biased_words, v_sra(v_shl(p, 16), 16), v_sra(p, 16))
/* The bias cancels exactly in differences. */
#define V_BIAS_U8 0x1p23f
#define V_BIAS_I8 (0x1p23f + 128)
#define V_BIAS_U16 0x1p23f
#define V_BIAS_I16 (0x1p23f + 32768)

/* Rows of four voxels: one load of 32 or 64 bits a lane. */
#define V_TAPS
#undef SIMD_TAPS
#define SIMD_TAPS                                                                                                     \
  SIMD_HAS_TAPS(u8) SIMD_HAS_TAPS(i8) SIMD_HAS_TAPS(u16) SIMD_HAS_TAPS(i16) SIMD_HAS(vi, v_weigh, vi, vi);
#define V_BYTE_ROW(name)                                                                                              \
  V_INLINE void v_row_##name(const void *base, const v_places *at, vf t[4]) {                                         \
    const vi p = v_load_lanes((const char *)base, at, 1);                                                             \
    v_split_##name(p, &t[0], &t[1]), v_split_##name(v_shr(p, 16), &t[2], &t[3]);                                      \
  }
#define V_WORD_ROW(name)                                                                                              \
  V_INLINE void v_row_##name(const void *base, const v_places *at, vf t[4]) {                                         \
    vf a, b;                                                                                                          \
    v_load_pairs((const char *)base, at, 2, &a, &b);                                                                  \
    v_split_##name(v_bits(a), &t[0], &t[1]), v_split_##name(v_bits(b), &t[2], &t[3]);                                 \
  }
V_BYTE_ROW(u8)
V_BYTE_ROW(i8)
V_WORD_ROW(u16)
V_WORD_ROW(i16)
typedef struct v_taps { vi pair[3]; } v_taps;
#define V_BYTE_TAPS(name, flips)                                                                                      \
  V_INLINE vi v_tap_pair_##name(const void *base, const v_places *at) {                                               \
    return v_byte_words(v_flip(v_load_lanes((const char *)base, at, 1), flips), 0);                                   \
  }                                                                                                                   \
  V_INLINE v_taps v_taps_##name(const void *base, const v_places *at) {                                               \
    const vi p = v_flip(v_load_lanes((const char *)base, at, 1), flips);                                              \
    return (v_taps){{v_byte_words(p, 0), v_byte_words(p, 1), v_byte_words(p, 2)}};                                    \
  }
#define V_WORD_TAPS(name, flips)                                                                                      \
  V_INLINE vi v_tap_pair_##name(const void *base, const v_places *at) {                                               \
    return v_flip(v_load_lanes((const char *)base, at, 2), flips);                                                    \
  }                                                                                                                   \
  V_INLINE v_taps v_taps_##name(const void *base, const v_places *at) {                                               \
    vf a, b;                                                                                                          \
    v_load_pairs((const char *)base, at, 2, &a, &b);                                                                  \
    const vi low = v_flip(v_bits(a), flips), high = v_flip(v_bits(b), flips);                                         \
    return (v_taps){{low, v_ori(v_shr(low, 16), v_shl(high, 16)), high}};                                             \
  }
V_BYTE_TAPS(u8, 0)
V_BYTE_TAPS(i8, 0x80808080)
V_WORD_TAPS(u16, 0x80008000)
V_WORD_TAPS(i16, 0)
