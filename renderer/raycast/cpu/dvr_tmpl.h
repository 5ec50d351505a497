/* Direct volume rendering of a packet, front to back, with early ray termination and empty-space skipping.
 *
 * The rays march in lockstep: sample i of every ray is at entry + i * step * dir, computed and not accumulated, so
 * that no ray depends on its neighbours. Segment i lies between samples i and i + 1 and is classified by the field
 * at both (NUMERICS section 3). The last segment of a ray, and the first segment of a ray with a phase
 * (subpixel_tmpl.h), are shorter: opacity correction scales them. */

/* Shades a segment of colour c, by the cell gradients at its ends or by the gradient at its middle. */
V_INLINE vf4 shade_segment(const tc_cpu_args *args, variant v, const packet *p, const lighting *l, const ray_segment *s,
                           vm visible, vf4 c) {
  vf middle[3];
  if (v.gradient == TC_GRADIENT_CELL) return shade(&args->shade, l, s->front_gradient, s->back_gradient, c);
  gradient_at(args, v, p, segment_middle_mm(p, s), visible, middle);
  return shade(&args->shade, l, middle, middle, c);
}

/* Colour and opacity of a segment: classified and tinted by labels. */
V_INLINE vf4 colour_segment(const tc_cpu_args *args, variant v, const packet *p, const ray_segment *s) {
  vf4 c = segment(args, v, p, s);
  if (v.labels && m_any(v_lt(v_set(0), c.a))) c = label_segment(args, p, segment_middle_mm(p, s), c);
  return c;
}

/* The same, shaded. */
V_INLINE vf4 draw_segment(const tc_cpu_args *args, variant v, const packet *p, const lighting *light,
                          const ray_segment *s, tc_cpu_counts *counts) {
  vf4 c = colour_segment(args, v, p, s);
  const vm visible = m_and(s->live, v_lt(v_set(0), c.a));
  if (v.shaded && m_any(visible)) {
    counts->gradients += (uint64_t)m_count(visible);
    c = shade_segment(args, v, p, light, s, visible, c);
  }
  return c;
}

V_INLINE void shift_slopes(vf slopes[3][3]) {
  for (int k = 0; k < 3; k++) slopes[0][k] = slopes[1][k], slopes[1][k] = slopes[2][k];
}

/* Casts one packet from the rays' entries to their ends. Long, because all variables are the state of one loop. */
V_INLINE void cast_packet(const tc_cpu_args *args, variant v, const place *at, vf4 *out, tc_cpu_counts *counts) {
  packet p = start_packet(args, v, at);
  counts->rays += (uint64_t)m_count(p.live);
  if (v.leap && all_empty(args, at)) {
    counts->leaps++;
    *out = (vf4){v_set(0), v_set(0), v_set(0), v_set(0)};
    return;
  }
  const bool second_order = v.classification == TC_PREINTEGRATED2;
  vf clear = v_set(1), front = v_set(0), back = v_set(0), middle = v_set(0);
  vf4 sum = {v_set(0), v_set(0), v_set(0), v_set(0)};
  vm live = p.live;
  int missing = 2; /* samples to fetch before the segment has both of its ends */
  runs r;
  int run_end = 0; /* first step behind the occupied run */
  lighting light;
  const bool cell = v.shaded && v.gradient == TC_GRADIENT_CELL;
  const bool later = v.shaded && v.gradient == TC_GRADIENT_CENTRAL;
  waiting w;
  vf slopes[3][3]; /* index gradients at front, back, next */
  vf *const at_front = cell ? slopes[0] : NULL, *const at_back = cell ? slopes[1] : NULL;
  vf *const at_next = cell ? slopes[2] : NULL;
  if (v.shaded) light = start_lighting(args, v, at);
  if (phased(v)) p.lag = lag_of(args, v, at);
  march m = start_march(args, v, &p, !phased(v)); /* a ray's phase shortens the packet's first segment */
  if (later) start_waiting(&w, &p, &light);
  if (v.leap) r = start_runs(args, v, &p, at);
  /* A run, too, begins with two rounds that only fetch: they use the neighbourhoods and prefetches of all others. */
  for (int i = v.leap ? 0 : -missing; keep_marching(args, live, counts, i); i++) {
    if (v.leap && i >= run_end) {
      int from;
      if (!next_run(&r, live, i, &from, &run_end)) {
        counts->leaps++;
        break;
      }
      missing = 2;
      if (from > i) {
        live = m_and(live, v_lt(sample_mm(args, v, &p, from), p.length));
        counts->leaps++;
        counts->until_poll -= POLL_STRIDE; /* leaps may miss every multiple of POLL_STRIDE */
        if (!m_any(live)) break;
      }
      prefetch_run(args, v, &m, from, run_end);
      i = from - missing;
    }
    const vf t0 = sample_mm(args, v, &p, i), t1 = sample_mm(args, v, &p, i + 1);
    /* The next sample, and the middle of the next segment, are fetched before this segment's look-up, so that the chains of
     * loads overlap. */
    vf next = front, next_middle = front;
    if (!v.leap || i + 1 < run_end) {
      vf t2 = sample_mm(args, v, &p, i + 2);
      const vm rest = m_and(live, v_lt(t1, p.length)), needs = m_and(rest, v_le(v_set(0), t2));
      next = march_node(args, v, &p, &m, i + 2, v_min(t2, p.length), needs, at_next);
      if (second_order && missing < 2)
        next_middle = march_middle(args, v, &p, &m, i + 1, middle_mm(&p, t1, t2), m_and(rest, v_le(v_set(0), t1)));
    }
    if (missing > 0) {
      if (!--missing) counts->samples += (uint64_t)m_count(live);
      front = back, back = next, middle = next_middle;
      if (cell) shift_slopes(slopes);
      continue;
    }
    const vm active = (float)i < p.most_delay ? m_and(live, v_le(v_set(0), t0)) : live;
    counts->samples += (uint64_t)m_count(active);
    if (second_order) counts->samples += (uint64_t)m_count(active);
    vf least = v_min(front, back), most = v_max(front, back);
    if (second_order) least = v_min(least, middle), most = v_max(most, middle);
    if (all_zero(args, least, most, active)) {
      live = m_and(live, v_lt(t1, p.length));
      front = back, back = next, middle = next_middle;
      if (cell) shift_slopes(slopes);
      continue;
    }
    const ray_segment s = {i, t0, t1, front, middle, back, active, at_front, at_back};
    vf4 c = later ? colour_segment(args, v, &p, &s) : draw_segment(args, v, &p, &light, &s, counts);
    vf weight = v_select(active, clear, v_set(0));
    if (later) {
      const vm visible = m_and(active, v_lt(v_set(0), c.a));
      if (m_any(visible)) {
        counts->gradients += (uint64_t)m_count(visible);
        unlit *const u = &w.segments[w.n++];
        u->t = segment_middle_mm(&p, &s), u->c = c, u->weight = weight, u->visible = visible;
#ifdef V_NEAR
        if (has_slopes(args, v.type)) choose_slopes(args, v.type, &p, &m, i, u);
        else u->first = -1;
#endif
        if (w.n == MOST_WAITING) shade_waiting(args, v.type, &w);
      }
    } else {
      sum.r = v_fma(weight, c.r, sum.r);
      sum.g = v_fma(weight, c.g, sum.g);
      sum.b = v_fma(weight, c.b, sum.b);
    }
    /* Opacity is summed separately from transparency: in single precision, thin segments do not change a transparency
     * of 1. */
    sum.a = v_fma(weight, c.a, sum.a);
    clear = v_fnma(weight, c.a, clear);
    live = m_and(live, v_lt(t1, p.length));
    live = m_and(live, not_terminated(args, clear));
    front = back, back = next, middle = next_middle;
    if (cell) shift_slopes(slopes);
  }
  if (later) {
    if (w.n) shade_waiting(args, v.type, &w);
    sum.r = w.sum[0], sum.g = w.sum[1], sum.b = w.sum[2];
  }
  *out = finish_rays(args, sum, clear);
}
