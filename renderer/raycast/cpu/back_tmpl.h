/* Direct volume rendering of a packet, back to front: the samples and segments of dvr_tmpl.h in reverse. There is no
 * early ray termination, because the nearest segment comes last. A ray joins the march at its last segment. */

/* The over operator, segment in front of sum, as sum + (segment - opacity * sum): thin segments of a long ray then lose
 * no more to rounding than in front-to-back order. */
V_INLINE void composite_over(vf4 c, vm live, vf4 *sum) {
  vf none = v_set(0), a = v_select(live, c.a, none);
  sum->r = sum->r + v_fnma(a, sum->r, v_select(live, c.r, none));
  sum->g = sum->g + v_fnma(a, sum->g, v_select(live, c.g, none));
  sum->b = sum->b + v_fnma(a, sum->b, v_select(live, c.b, none));
  sum->a = sum->a + v_fnma(a, sum->a, a);
}

#define MOST_RUNS 32 /* per packet; the last one extends to the end of the rays */

/* Finds the occupied runs of segments, first to last; returns their number. */
V_INLINE int find_runs(const tc_cpu_args *args, variant v, const packet *p, const place *at, int steps,
                       int from[MOST_RUNS], int to[MOST_RUNS]) {
  int n = 0;
  from[0] = 0, to[0] = steps;
  if (!v.leap) return 1;
  runs r = start_runs(args, v, p, at);
  for (int least = 0; next_run(&r, p->live, least, &from[n], &to[n]); least = to[n++]) {
    if (to[n] > steps) to[n] = steps;
    if (n == MOST_RUNS - 1) {
      to[n++] = steps;
      break;
    }
  }
  return n;
}

V_ONCE void cast_back_to_front(const tc_cpu_args *args, variant v, const place *at, vf4 *out, tc_cpu_counts *counts) {
  packet p = start_packet(args, v, at);
  vf front = v_set(0), back = v_set(0);
  vf4 sum = {v_set(0), v_set(0), v_set(0), v_set(0)};
  vf slopes[3][3];
  const bool cell = v.shaded && v.gradient == TC_GRADIENT_CELL;
  vf *const at_front = cell ? slopes[0] : NULL, *const at_back = cell ? slopes[1] : NULL;
  int from[MOST_RUNS], to[MOST_RUNS], before = -1;
  lighting light;
  if (v.shaded) light = start_lighting(args, v, at);
  if (phased(v)) p.lag = lag_of(args, v, at);
  counts->rays += (uint64_t)m_count(p.live);
  float longest = 0 - v_least(v_select(p.live, v_set(0) - p.length, v_set(0)));
  for (int n = find_runs(args, v, &p, at, (int)(longest * args->rays.inverse_step) + 2, from, to); n-- > 0;) {
    counts->leaps += v.leap;
    counts->until_poll -= POLL_STRIDE; /* a run may have no step that is a multiple of POLL_STRIDE */
    for (int i = to[n] - 1; i >= from[n] && keep_marching(args, p.live, counts, i); i--) {
      vf t0 = sample_mm(args, v, &p, i), t1 = sample_mm(args, v, &p, i + 1);
      vm live = m_and(p.live, v_lt(t0, p.length));
      if (!m_any(live)) continue;
      if (before != i + 1) {
        back = sample_node(args, v, &p, v_min(t1, p.length), at_back);
        counts->samples += (uint64_t)m_count(live);
      }
      before = i;
      /* For a ray that joins at the next step, this is the sample at its end: the back of its last segment. */
      front = sample_node(args, v, &p, v_min(t0, p.length), at_front);
      counts->samples += (uint64_t)m_count(live);
      const bool second_order = v.classification == TC_PREINTEGRATED2;
      const vf middle = second_order ? sample_node(args, v, &p, middle_mm(&p, t0, t1), NULL) : front;
      if (second_order) counts->samples += (uint64_t)m_count(live);
      if (!all_zero(args, v_min(middle, v_min(front, back)), v_max(middle, v_max(front, back)), live)) {
        const ray_segment s = {i, t0, t1, front, middle, back, live, at_front, at_back};
        composite_over(draw_segment(args, v, &p, &light, &s, counts), live, &sum);
      }
      back = front;
      for (int k = 0; cell && k < 3; k++) slopes[1][k] = slopes[0][k];
    }
  }
  vf whole = v_max(sum.a, v_set(1));
  *out = (vf4){sum.r / whole, sum.g / whole, sum.b / whole, sum.a / whole};
}
