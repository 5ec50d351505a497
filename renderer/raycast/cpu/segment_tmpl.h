/* From two samples to the colour and opacity of the segment between them, in every classification. Part of the
 * template. */

/* Second order (El Hajjar, Marchesin, Dischler and Mongenet, 2008, take the field as quadratic along a segment): of the
 * quadratic through front, middle and back the linear field with the same mean, and its slope as far as that leaves
 * both ends among the three samples. What follows is then an entry of the same table: opacity and energy stay in
 * bounds, and where the samples show nothing neither does the segment. A mean that is right leaves an error of the
 * fourth order in a segment and of the third along a ray, against a linear field's second. */
V_INLINE void straighten(vf *front, vf middle, vf *back) {
  /* Simpson; exact where all are equal */
  vf mean = v_fma((*front - middle) + (*back - middle), v_set(1 / 6.0f), middle);
  vf least = v_min(middle, v_min(*front, *back)), most = v_max(middle, v_max(*front, *back));
  vf room = v_max(v_min(mean - least, most - mean), v_set(0)), half = v_set(0.5f) * (*back - *front);
  half = v_min(v_max(half, v_set(0) - room), room);
  *front = mean - half;
  *back = mean + half;
}

/* Segments that are straightened need not meet: where that would jump over more than what a zoom is for, a peak could
 * be missed, and plain ends stay. */
V_INLINE void straighten_zoomed(const tc_cpu_args *args, vf *front, vf middle, vf *back) {
  vf near = *front, far = *back;
  straighten(&near, middle, &far);
  vm jumps = v_lt(v_set(1), v_set(0));
  for (int z = 0; z < args->n_zooms; z++) {
    vf lo = v_set(args->zooms[z].inner[0]), hi = v_set(args->zooms[z].inner[1]), most = hi - lo;
    vm skips = m_and(v_lt(most, v_abs(near - *front)),
                     m_and(v_lt(v_min(near, *front), hi), v_lt(lo, v_max(near, *front))));
    vm leaves = m_and(v_lt(most, v_abs(far - *back)), m_and(v_lt(v_min(far, *back), hi), v_lt(lo, v_max(far, *back))));
    jumps = m_or(jumps, m_or(skips, leaves));
  }
  *front = v_select(jumps, *front, near);
  *back = v_select(jumps, *back, far);
}

/* Segment i: of full length or, where the ray ends or begins with a phase, shorter. */
V_INLINE vf4 classify_part(const tc_cpu_args *args, variant v, const packet *p, vf front, vf back, int i, vf t0, vf t1,
                           vm live) {
  vm ends = v_lt(p->length, t1);
  vf4 c = v.zoomed ? classify_zoomed(args, front, back, live) : classify(args, front, back);
  bool starts = phased(v) && i == 0;
  if (!starts && !m_any(ends)) return c;
  vf share = (starts ? v_min(t1, p->length) : v_max(p->length - t0, v_set(0))) / v_set(args->rays.step_mm);
  vm which = starts ? p->live : ends;
  return args->key.stiff ? shorten_stiff(args, front, back, c, share, which) : shorten(c, share, which);
}

/* By 1-D integrals. Once an instruction set, for all voxel types: kernels are large enough. */
V_ONCE vf4 classify_otherwise(const tc_cpu_args *args, variant v, const packet *p, vf front, vf back, int i, vf t0,
                              vf t1) {
  vf rest = v_max(v_min(t1, p->length) - t0, v_set(0));
  vf length_mm = v_select(v_lt(p->length, t1), rest, v_set(args->rays.step_mm));
  if (phased(v) && i == 0) length_mm = rest;
  return classify_by_integrals(args, v, front, back, length_mm);
}

/* front, back: nodes at t0 and t1 mm, or at the ray's end where that comes before t1. */
V_INLINE vf4 segment(const tc_cpu_args *args, variant v, const packet *p, vf front, vf back, int i, vf t0, vf t1, vm live,
                     tc_cpu_counts *counts) {
  if (v.classification == TC_PREINTEGRATED) return classify_part(args, v, p, front, back, i, t0, t1, live);
  if (v.classification == TC_PREINTEGRATED2) {
    vf middle = sample_node(args, v, p, v_set(0.5f) * (t0 + v_min(t1, p->length)), NULL);
    if (v.zoomed) straighten_zoomed(args, &front, middle, &back);
    else straighten(&front, middle, &back);
    counts->samples += (uint64_t)m_count(live); /* the middle */
    return classify_part(args, v, p, front, back, i, t0, t1, live);
  }
  return classify_otherwise(args, v, p, front, back, i, t0, t1);
}
