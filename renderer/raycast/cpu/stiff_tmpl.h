/* Part of a segment of a medium so dense that the opacity of the whole no longer tells its depth: a ray's last segment,
 * or one begun with a phase. Part of the template, once an instruction set: no other scene comes here. */

/* How much more of a segment's light comes from its nearer half, in a medium of this depth whose colour changes evenly:
 * 1/2 - 1/x + 1/(exp(x) - 1). */
V_INLINE vf nearer(vf x) {
  vf clear = v_set(1) - opacity_of_depth(x), deep = v_max(x, v_set(0.5f));
  vf thin = x * v_fnma(x * x, v_set(1 / 720.0f), v_set(1 / 12.0f));
  return v_select(v_lt(x, v_set(0.5f)), thin, v_set(0.5f) - v_set(1) / deep + clear / (v_set(1) - clear));
}

/* c: the whole segment. Its opacity over the share is exact. Its colour passes from what a thin segment shows, which
 * has as much of its ends seen from both sides, to the whole one's: exact where colour is linear and extinction
 * constant. */
V_ONCE vf4 shorten_stiff(const tc_cpu_args *args, vf front, vf back, vf4 c, vf share, vm which) {
  vf4 reverse = classify_zoomed(args, back, front, which);
  vf depth = depth_between(args, front, back, which), tiny = v_set(1e-30f), half = v_set(0.5f);
  vf alpha = v_select(v_lt(v_set(0), c.a), opacity_of_depth(share * depth), v_set(0));
  vf along = half * v_min(nearer(share * depth) / v_max(nearer(depth), tiny), v_set(1));
  vf ahead = alpha * (half + along) / v_max(c.a, tiny), behind = alpha * (half - along) / v_max(reverse.a, tiny);
  return (vf4){v_select(which, v_fma(behind, reverse.r, ahead * c.r), c.r),
               v_select(which, v_fma(behind, reverse.g, ahead * c.g), c.g),
               v_select(which, v_fma(behind, reverse.b, ahead * c.b), c.b), v_select(which, alpha, c.a)};
}
