/* Planar reformats (MPR) of a packet: one sample per pixel, or a slab's maximum, minimum or mean, through the window
 * to grey (raycast/slice.h). Nodes are tc_slice_window's (backend.h). */

/* The slab's value; front: the value at the rays' entries. Samples lie at whole steps from the plane, on the plane
 * itself, so that a slab around a voxel never misses its peak, and at both ends. A ray at its end samples it again,
 * which changes nothing and needs no mask. */
V_INLINE vf cast_slab(const tc_cpu_args *args, variant v, int slab, const packet *p, vf front,
                      tc_cpu_counts *counts) {
  vf steps = p->start * v_set(args->rays.inverse_step),
     first = v_float(v_trunc(steps)); /* the first whole step behind the entry */
  first = v_select(v_le(first, steps), first + v_set(1), first);
  vf value = front, sum = v_set(0), before = v_set(0);
  vm live = p->live;
  for (int i = 0; keep_marching(args, live, counts, i); i++) {
    vf at = (first + v_set((float)i)) * v_set(args->rays.step_mm) - p->start;
    vf t = v_min(v_max(at, v_set(0)), p->length);
    vf back = sample_node(args, v, p, t, NULL);
    counts->samples += (uint64_t)m_count(live);
    if (slab == TC_SLAB_MIP) value = v_max(value, back);
    if (slab == TC_SLAB_MINIP) value = v_min(value, back);
    if (slab == TC_SLAB_AVERAGE) sum = v_fma((t - before) * v_set(0.5f), front + back, sum);
    front = back, before = t;
    live = m_and(live, v_lt(t, p->length));
  }
  if (slab != TC_SLAB_AVERAGE) return value;
  vm some = v_lt(v_set(1e-30f), p->length);
  return v_select(some, sum / v_select(some, p->length, v_set(1)), value);
}

V_INLINE void cast_slice(const tc_cpu_args *args, variant v, const place *at_pixels, vf4 *out, tc_cpu_counts *counts) {
  packet p = start_packet(args, v, at_pixels);
  *out = (vf4){v_set(0), v_set(0), v_set(0), v_set(0)};
  if (!m_any(p.live)) return;
  vf value = sample_node(args, v, &p, v_set(0), NULL);
  counts->rays += (uint64_t)m_count(p.live);
  counts->samples += (uint64_t)m_count(p.live);
  if (v.slab) value = cast_slab(args, v, v.slab - 1, &p, value, counts);
  vf grey = v_fma(value - v_set(args->window.center), v_set(args->window.gain), v_set(0.5f));
  grey = v_select(p.live, v_min(v_max(grey, v_set(0)), v_set(1)), v_set(0));
  *out = (vf4){grey, grey, grey, v_select(p.live, v_set(1), v_set(0))};
  if (v.labels) *out = label_slice(args, &p, *out);
}
