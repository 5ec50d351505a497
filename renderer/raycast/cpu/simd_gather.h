/* Integer voxels of the vector vocabulary, for instruction sets that gather 32 bits: one gather fetches a voxel and
 * its right neighbour, and reads up to 3 bytes beyond them. Included by a simd_*.h after v_gather_bytes and
 * v_gather_words, which gather at off bytes and off 16-bit words. */
V_INLINE vi v_bytes(const uint8_t *base, vi off) { return v_andi(v_gather_bytes(base, off), v_seti(255)); }
V_INLINE void v_pair_u8(const void *base, vi off, vf *a, vf *b) {
  vi p = v_gather_bytes(base, off), mask = v_seti(255);
  *a = v_float(v_andi(p, mask));
  *b = v_float(v_andi(v_shr(p, 8), mask));
}
V_INLINE void v_pair_i8(const void *base, vi off, vf *a, vf *b) {
  vi p = v_gather_bytes(base, off);
  *a = v_float(v_sra(v_shl(p, 24), 24));
  *b = v_float(v_sra(v_shl(p, 16), 24));
}
V_INLINE void v_pair_u16(const void *base, vi off, vf *a, vf *b) {
  vi p = v_gather_words(base, off);
  *a = v_float(v_andi(p, v_seti(0xffff)));
  *b = v_float(v_shr(p, 16));
}
V_INLINE void v_pair_i16(const void *base, vi off, vf *a, vf *b) {
  vi p = v_gather_words(base, off);
  *a = v_float(v_sra(v_shl(p, 16), 16));
  *b = v_float(v_sra(p, 16));
}
