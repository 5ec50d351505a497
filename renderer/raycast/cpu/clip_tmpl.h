/* Clipping of rays to the volume's box and to clip planes (raycast/clip.h). */

/* Narrows [*s0, *s1] to the s for which the ray is inside [lo, hi] along one axis. */
V_INLINE void clip_axis(vf q, vf d, vf inverse, vf lo, vf hi, vf *s0, vf *s1) {
  vm parallel = v_lt(v_abs(d), v_set(1e-12f));
  vm inside = m_and(v_le(lo, q), v_le(q, hi));
  vf big = v_set(1e30f);
  vf a = (lo - q) * inverse, b = (hi - q) * inverse;
  vf near = v_select(parallel, v_select(inside, v_set(0) - big, big), v_min(a, b));
  vf far = v_select(parallel, v_select(inside, big, v_set(0) - big), v_max(a, b));
  *s0 = v_max(*s0, near);
  *s1 = v_min(*s1, far);
}

/* Narrows [*s0, *s1] to the half space of one clip plane. A ray parallel to the plane is entirely inside or outside. */
V_INLINE void clip_plane(const float plane[4], const vf q[3], const vf d[3], vf *s0, vf *s1) {
  vf at = v_set(plane[3]), rate = v_set(0), big = v_set(1e30f);
  for (int k = 0; k < 3; k++) {
    at = v_fma(v_set(plane[k]), q[k], at);
    rate = v_fma(v_set(plane[k]), d[k], rate);
  }
  vm parallel = v_lt(v_abs(rate), v_set(1e-9f)), enters = v_lt(v_set(0), rate);
  vf s = (v_set(0) - at) / v_select(parallel, v_set(1), rate);
  vf outside = v_select(v_lt(at, v_set(0)), big, v_set(0) - big);
  *s0 = v_max(*s0, v_select(parallel, outside, v_select(enters, s, v_set(0) - big)));
  *s1 = v_min(*s1, v_select(m_or(parallel, enters), big, s));
}
