/* Multi-planar reformats (MPR) of a packet (raycast/mpr.h): one sample per pixel, or the maximum, minimum or mean of a slab,
 * mapped to grey by the window. Values are table nodes of tc_slice_window (backend.h). */

/* The slab's value; front: the sample at the rays' entries. Samples lie on the plane, at whole steps from the plane and at
 * both ends of the slab, so that a slab around a voxel includes the voxel's peak. A ray that has reached its end samples the
 * end again, which changes nothing and saves a mask. Maximum and minimum ignore samples in gaps, the mean ignores
 * intervals whose middle is in a gap; *met: rays with at least one sample or interval. */
V_INLINE vf cast_slab(const tc_cpu_args *args, variant v, int slab, const packet *p, vf front, vm *met,
                      tc_cpu_counts *counts) {
  const bool gaps = v.labels == TC_PLAN_GAPS;
  vf steps = p->start * v_set(args->rays.inverse_step),
     first = v_float(v_trunc(steps)); /* the first whole step after the entry */
  first = v_select(v_le(first, steps), first + v_set(1), first);
  vf none = v_set(slab == TC_SLAB_MINIP ? args->nodes.last : 0);
  vf value = gaps ? v_select(*met, front, none) : front, sum = v_set(0), before = v_set(0), total = v_set(0);
  vm live = p->live;
  for (int i = 0; keep_marching(args, live, counts, i); i++) {
    vf at = (first + v_set((float)i)) * v_set(args->rays.step_mm) - p->start;
    vf t = v_min(v_max(at, v_set(0)), p->length);
    vf back = sample_node(args, v, p, t, NULL);
    counts->samples += (uint64_t)m_count(live);
    vf counted = back, width = t - before;
    if (gaps) {
      vf middle = before + (t - before) * v_set(0.5f);
      vm has = has_value(args, p, slab == TC_SLAB_AVERAGE ? middle : t);
      counted = v_select(has, back, none);
      width = v_select(has, width, v_set(0));
      *met = m_or(*met, has);
      total = total + width;
    }
    if (slab == TC_SLAB_MIP) value = v_max(value, counted);
    if (slab == TC_SLAB_MINIP) value = v_min(value, counted);
    if (slab == TC_SLAB_AVERAGE) sum = v_fma(width * v_set(0.5f), front + back, sum);
    front = back, before = t;
    live = m_and(live, v_lt(t, p->length));
  }
  if (slab != TC_SLAB_AVERAGE) return value;
  if (!gaps) total = p->length;
  vm some = v_lt(v_set(1e-30f), total);
  return v_select(some, sum / v_select(some, total, v_set(1)), value);
}

V_INLINE void cast_slice(const tc_cpu_args *args, variant v, const place *at_pixels, vf4 *out, tc_cpu_counts *counts) {
  packet p = start_packet(args, v, at_pixels);
  *out = (vf4){v_set(0), v_set(0), v_set(0), v_set(0)};
  if (!m_any(p.live)) return;
  vf value = sample_node(args, v, &p, v_set(0), NULL);
  counts->rays += (uint64_t)m_count(p.live);
  counts->samples += (uint64_t)m_count(p.live);
  const bool gaps = v.labels == TC_PLAN_GAPS;
  vm met = gaps ? m_and(p.live, has_value(args, &p, v_set(0))) : p.live;
  if (v.slab) value = cast_slab(args, v, v.slab - 1, &p, value, &met, counts);
  vf grey = v_fma(value - v_set(args->window.center), v_set(args->window.gain), v_set(0.5f));
  met = m_and(met, p.live);
  grey = v_select(met, v_min(v_max(grey, v_set(0)), v_set(1)), v_set(0));
  *out = (vf4){grey, grey, grey, v_select(met, v_set(1), v_set(0))};
  if (v.labels && !gaps) *out = label_slice(args, &p, *out);
}
