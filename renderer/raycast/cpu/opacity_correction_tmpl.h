/* Opacity correction: the colour and opacity of a part of a segment from those of the whole. */

/* The same medium over `share` (0..1) of the segment has transparency t^share, and colour in proportion to its opacity.
 * which: the rays to correct. */
V_INLINE vf4 shorten(vf4 c, vf share, vm which) {
  vf clear = v_max(v_set(1) - c.a, v_set(1e-30f));
  vf alpha = v_set(1) - exp2_approx(share * log2_approx(clear));
  vf scale = v_select(v_lt(c.a, v_set(1e-4f)), share, alpha / v_max(c.a, v_set(1e-30f)));
  scale = v_select(which, scale, v_set(1));
  return (vf4){c.r * scale, c.g * scale, c.b * scale, c.a * scale};
}

/* In stiff scenes the medium is so dense that a segment's opacity rounds to 1 and no longer tells its optical depth. The
 * depth comes from the table's row of depths (classify/preintegration.h). */

/* For a segment of optical depth x and linear colour: the excess weight of the nearer end's colour over 1/2,
 * 1/2 - 1/x + 1/(exp(x) - 1). */
V_INLINE vf front_excess(vf x) {
  vf clear = v_set(1) - opacity_of_depth(x), deep = v_max(x, v_set(0.5f));
  vf thin = x * v_fnma(x * x, v_set(1 / 720.0f), v_set(1 / 12.0f));
  return v_select(v_lt(x, v_set(0.5f)), thin, v_set(0.5f) - v_set(1) / deep + clear / (v_set(1) - clear));
}

/* c: the whole segment. The opacity over `share` of it is exact. Its colour is a mixture of the segment seen from
 * the front and from the back, weighted so that it is exact for linear colour and constant extinction. */
V_ONCE vf4 shorten_stiff(const tc_cpu_args *args, vf front, vf back, vf4 c, vf share, vm which) {
  vf4 reverse = classify_subtables(args, back, front, which);
  vf depth = depth_between(args, front, back, which), tiny = v_set(1e-30f), half = v_set(0.5f);
  vf alpha = v_select(v_lt(v_set(0), c.a), opacity_of_depth(share * depth), v_set(0));
  vf along = half * v_min(front_excess(share * depth) / v_max(front_excess(depth), tiny), v_set(1));
  vf ahead = alpha * (half + along) / v_max(c.a, tiny), behind = alpha * (half - along) / v_max(reverse.a, tiny);
  return (vf4){v_select(which, v_fma(behind, reverse.r, ahead * c.r), c.r),
               v_select(which, v_fma(behind, reverse.g, ahead * c.g), c.g),
               v_select(which, v_fma(behind, reverse.b, ahead * c.b), c.b), v_select(which, alpha, c.a)};
}
