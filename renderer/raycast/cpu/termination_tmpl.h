/* Early ray termination (scene.h: sampling.termination): a ray ends where its transparency falls below the threshold. */

V_INLINE vm not_terminated(const tc_cpu_args *args, vf clear) { return v_le(v_set(args->termination), clear); }

/* A terminated ray is scaled to opacity 1, as if the rest of the ray looked like the part before: the background does
 * not show through, and an opaque region keeps its colour exactly. The error is at most the threshold. */
V_INLINE vf4 finish_rays(const tc_cpu_args *args, vf4 sum, vf clear) {
  const vm terminated = v_lt(clear, v_set(args->termination));
  const vf whole = v_select(m_or(terminated, v_lt(v_set(1), sum.a)), sum.a, v_set(1));
  return (vf4){sum.r / whole, sum.g / whole, sum.b / whole, sum.a / whole};
}
