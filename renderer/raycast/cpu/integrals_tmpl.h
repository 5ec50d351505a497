/* Classifications by 1-D tables: approximate, post, linearized (equations: classify/integrals.h). */

/* A node interval interpolated between its two entries at x in [0, 1]. */
V_INLINE vf4 interval_at(const tc_cpu_args *args, vi interval, vf x) {
  vi at = v_addi(interval, interval);
  return v_bilinear(args->integrals, at, at, x, v_set(0));
}

/* Means of (L tau, tau) over the values between two nodes: exact sums over whole node intervals, plus the two ends. */
V_INLINE vf4 mean_between(const tc_cpu_args *args, vf front, vf back) {
  vf low = v_min(front, back), high = v_max(front, back);
  vi i = v_trunc(low), j = v_trunc(high), p = v_mini(v_addi(i, v_seti(1)), j);
  vf f = low - v_float(i), e = high - v_float(j);
  vm within = v_lt(v_float(v_subi(j, i)), v_set(0.5f));
  vf4 a = interval_at(args, i, v_select(within, v_set(0.5f) * (f + e), v_set(0.5f) * (v_set(1) + f)));
  vf4 b = interval_at(args, j, v_set(0.5f) * e);
  /* Level 1 + msb(p xor j), 0 where p = j: the exponent of 2 (p xor j) + 1, which a float holds exactly. */
  vi differing = v_subi(v_ori(p, j), v_andi(p, j));
  vi level = v_subi(v_sra(v_bits(v_float(v_addi(v_addi(differing, differing), v_seti(1)))), 23), v_seti(127));
  vi row = v_addi(v_seti(args->levels_start), v_muli(level, v_seti(args->level_row)));
  vf4 s = v_bilinear(args->integrals, v_addi(row, p), v_addi(row, j), v_set(0), v_set(0.5f));
  vf wa = v_select(within, v_set(1), v_set(1) - f), wb = v_select(within, v_set(0), e), two = v_set(2);
  vf inverse = v_set(1) / (wa + wb + v_select(within, v_set(0), v_float(v_subi(j, p))));
  return (vf4){v_fma(wa, a.r, v_fma(wb, b.r, two * s.r)) * inverse, v_fma(wa, a.g, v_fma(wb, b.g, two * s.g)) * inverse,
               v_fma(wa, a.b, v_fma(wb, b.b, two * s.b)) * inverse,
               v_fma(wa, a.a, v_fma(wb, b.a, two * s.a)) * inverse};
}

/* Opacity 1 - exp(-x) of optical depth x >= 0, with a relative error of about 1e-6 also for tiny x. */
V_INLINE vf opacity_of_depth(vf x) {
  static const float over[] = {1 / 7.0f, 1 / 6.0f, 1 / 5.0f, 1 / 4.0f, 1 / 3.0f, 1 / 2.0f};
  vf thin = v_set(1), least = v_min(x, v_set(0.5f));
  for (int k = 0; k < 6; k++) thin = v_fnma(least * v_set(over[k]), thin, v_set(1)); /* (1 - exp(-x)) / x */
  return v_select(v_lt(x, v_set(0.35f)), x * thin, v_set(1) - exp2_approx(x * v_set(-1.44269504f)));
}

/* Colour and opacity of a segment of length_mm. */
V_INLINE vf4 classify_by_integrals(const tc_cpu_args *args, variant v, vf front, vf back, vf length_mm) {
  vf4 m;
  if (v.classification == TC_POST) {
    vi i = v_trunc(front);
    m = interval_at(args, i, front - v_float(i));
  } else {
    m = mean_between(args, front, back);
  }
  vf depth = m.a * length_mm, scale = v_min(depth, v_set(1));
  if (v.classification != TC_LINEARIZED) scale = opacity_of_depth(depth);
  vf each = scale / v_max(m.a, v_set(1e-37f));
  return (vf4){m.r * each, m.g * each, m.b * each, scale};
}
