/* From two samples to the colour and opacity of the segment between them, in every classification. */

/* Second-order pre-integration. The field is approximated by the quadratic through front, middle and back (El Hajjar,
 * Marchesin, Dischler and Mongenet, 2008), and replaced by the linear field of the same mean whose ends stay within the
 * range of the three samples. The segment is then an entry of the same pre-integration table, so its opacity and colour
 * keep their bounds, and invisible samples give an invisible segment. With the correct mean the error is of fourth
 * order per segment and of third order along a ray; linear pre-integration is of second order along a ray. */
V_INLINE void linearise(vf *front, vf middle, vf *back) {
  /* Simpson's rule; exact for three equal samples */
  vf mean = v_fma((*front - middle) + (*back - middle), v_set(1 / 6.0f), middle);
  vf least = v_min(middle, v_min(*front, *back)), most = v_max(middle, v_max(*front, *back));
  vf room = v_max(v_min(mean - least, most - mean), v_set(0)), half = v_set(0.5f) * (*back - *front);
  half = v_min(v_max(half, v_set(0) - room), room);
  *front = mean - half;
  *back = mean + half;
}

/* Linearised segments need not join. If the gap between two would skip the inner range of a subtable, a peak could be
 * missed: such segments keep their sampled ends. */
V_INLINE void linearise_subtables(const tc_cpu_args *args, vf *front, vf middle, vf *back) {
  vf near = *front, far = *back;
  linearise(&near, middle, &far);
  vm jumps = v_lt(v_set(1), v_set(0));
  for (int z = 0; z < args->n_subtables; z++) {
    vf lo = v_set(args->subtables[z].inner[0]), hi = v_set(args->subtables[z].inner[1]), most = hi - lo;
    vm skips = m_and(v_lt(most, v_abs(near - *front)),
                     m_and(v_lt(v_min(near, *front), hi), v_lt(lo, v_max(near, *front))));
    vm leaves = m_and(v_lt(most, v_abs(far - *back)), m_and(v_lt(v_min(far, *back), hi), v_lt(lo, v_max(far, *back))));
    jumps = m_or(jumps, m_or(skips, leaves));
  }
  *front = v_select(jumps, *front, near);
  *back = v_select(jumps, *back, far);
}

/* Segment i of a packet's rays: from sample front at t0 mm to back at t1 mm or the ray's end, whichever comes first.
 * Samples are nodes. middle: the sample halfway, for classification preintegrated2 only. front_gradient, back_gradient: the samples'
 * gradients over index coordinates if the shading uses cell gradients, else NULL. */
typedef struct ray_segment {
  int i;
  vf t0, t1, front, middle, back;
  vm live;
  const vf *front_gradient, *back_gradient;
} ray_segment;

/* Classifies a segment, with opacity correction for shorter ones: the last of a ray, and the first of a ray with a
 * phase. */
V_INLINE vf4 classify_part(const tc_cpu_args *args, variant v, const packet *p, const ray_segment *s, vf front,
                           vf back) {
  vm ends = m_and(s->live, v_lt(p->length, s->t1));
  vf4 c = v.subtables ? classify_subtables(args, front, back, s->live) : classify(args, front, back);
  bool starts = phased(v) && s->i == 0;
  if (!starts && !m_any(ends)) return c;
  vf share = (starts ? v_min(s->t1, p->length) : v_max(p->length - s->t0, v_set(0))) / v_set(args->rays.step_mm);
  vm which = starts ? p->live : ends;
  return args->key.stiff ? shorten_stiff(args, front, back, c, share, which) : shorten(c, share, which);
}

V_ONCE vf4 classify_1d(const tc_cpu_args *args, variant v, const packet *p, const ray_segment *s) {
  vf rest = v_max(v_min(s->t1, p->length) - s->t0, v_set(0));
  vf length_mm = v_select(v_lt(p->length, s->t1), rest, v_set(args->rays.step_mm));
  if (phased(v) && s->i == 0) length_mm = rest;
  return classify_by_integrals(args, v, s->front, s->back, length_mm);
}

V_INLINE vf middle_mm(const packet *p, vf t0, vf t1) { return v_set(0.5f) * (t0 + v_min(t1, p->length)); }

V_INLINE vf segment_middle_mm(const packet *p, const ray_segment *s) { return middle_mm(p, s->t0, s->t1); }

V_INLINE vf4 segment(const tc_cpu_args *args, variant v, const packet *p, const ray_segment *s) {
  vf front = s->front, back = s->back;
  if (v.classification == TC_PREINTEGRATED) return classify_part(args, v, p, s, front, back);
  if (v.classification == TC_PREINTEGRATED2) {
    if (v.subtables) linearise_subtables(args, &front, s->middle, &back);
    else linearise(&front, s->middle, &back);
    return classify_part(args, v, p, s, front, back);
  }
  const ray_segment copy = *s; /* the callee takes an address: that of *s would force the whole march into memory */
  return classify_1d(args, v, p, &copy);
}
