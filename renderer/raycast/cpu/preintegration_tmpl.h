/* Look-up in the pre-integration table (classify/preintegration.h). */

/* Colour and opacity of a segment of full length from node front to node back. */
V_INLINE vf4 classify(const tc_cpu_args *args, vf front, vf back) {
  vf low = v_min(front, back), diff = back - front, k = v_abs(diff);
  vf i = v_float(v_trunc(low)), kk = v_float(v_trunc(k));
  vf stride = v_select(v_lt(diff, v_set(0)), v_set(-args->table_stride), v_set(args->table_stride));
  vf row0 = v_fma(kk, stride, i);
  return v_bilinear(args->table, v_trunc(row0), v_trunc(row0 + stride), low - i, k - kk);
}

/* log2 and exp2 with a relative error of about 1e-6. */
V_INLINE vf log2_approx(vf x) {
  vi bits = v_bits(x), e = v_subi(v_sra(bits, 23), v_seti(127));
  vf m = v_from_bits(v_ori(v_andi(bits, v_seti(0x007fffff)), v_seti(0x3f800000)));
  vm high = v_lt(v_set(1.41421356f), m);
  m = v_select(high, m * v_set(0.5f), m);
  vf ef = v_float(e) + v_select(high, v_set(1), v_set(0));
  vf s = (m - v_set(1)) / (m + v_set(1)), s2 = s * s; /* ln m = 2 atanh(s) */
  vf series =
      v_fma(s2, v_fma(s2, v_fma(s2, v_set(0.41219858f), v_set(0.57707802f)), v_set(0.96179669f)), v_set(2.88539008f));
  return v_fma(s, series, ef);
}

V_INLINE vf exp2_approx(vf x) { /* x <= 0 */
  x = v_max(x, v_set(-126));
  vi n = v_trunc(x - v_set(0.5f));
  vf f = x - v_float(n);
  vf p = v_fma(f,
               v_fma(f,
                     v_fma(f, v_fma(f, v_fma(f, v_set(0.00133335581f), v_set(0.00961812911f)), v_set(0.0555041087f)),
                           v_set(0.240226507f)),
                     v_set(0.693147181f)),
               v_set(1));
  return v_from_bits(v_addi(v_bits(p), v_shl(n, 23)));
}
