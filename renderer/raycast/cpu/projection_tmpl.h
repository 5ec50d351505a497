/* Maximum, minimum and average intensity projection (MIP, MinIP, average) of a packet.
 *
 * Sample i is at entry + i * step * dir, and the ray's end is sampled too. MIP and MinIP are one kernel, a maximum
 * of the signed voxel (raycast/projection.h). A ray that has passed its end samples its end again, which raises no
 * maximum: no lane needs a mask, and no pixel depends on its neighbours. In a volume's gaps (variant.labels) samples do
 * not count. */

#define LEAST_INTERVALS 4 /* a shorter ray has nothing to gain from skipping */
#define LONGEST_WAIT 31 /* packets */

V_INLINE void update_backoff(skip_backoff *backoff, int interval, int skipped, int steps) {
  bool gained = (int64_t)skipped * interval > steps / 8 + interval;
  backoff->last = gained ? 0 : backoff->last < LONGEST_WAIT ? 2 * backoff->last + 1 : LONGEST_WAIT;
  backoff->wait = backoff->last;
}

/* Grey and opacity 1 where the ray met the volume, transparent elsewhere. */
V_INLINE vf4 grey_of(const tc_cpu_args *args, vf w, vm met) {
  vf grey = v_min(v_max(v_fma(w, v_set(args->grey.gain), v_set(args->grey.offset)), v_set(0)), v_set(1));
  grey = v_select(met, grey, v_set(0));
  if (args->to_light) {
    vf x = grey * v_set(TC_LIGHT_STEPS), low, high;
    vi i = v_trunc(x);
    v_pair_f32(args->to_light, i, &low, &high);
    grey = v_fma(x - v_float(i), high - low, low);
  }
  return (vf4){grey, grey, grey, v_select(met, v_set(1), v_set(0))};
}

/* Levels (skip/bounds.h) of the blocks that the rays are in at mm t. */
V_INLINE vf level_at(const tc_cpu_args *args, const packet *p, vf t) {
  vi block[3];
  for (int k = 0; k < 3; k++) {
    vf q = v_min(v_max(v_fma(t, p->dir[k], p->entry[k]), v_set(0)), v_set(args->grid.last[k]));
    vf cell = v_float(v_mini(v_trunc(q), v_seti(args->grid.cell_last[k])));
    block[k] =
        v_trunc((cell + v_set(0.5f)) * v_set(args->blocks.inverse_width)); /* the half keeps rounding away from edges */
  }
  vi off = v_addi(v_muli(block[2], v_seti(args->blocks.slice)), v_muli(block[1], v_seti(args->blocks.row)));
  return v_float(v_bytes(args->blocks.values, v_addi(off, block[0])));
}

/* The middle of the interval that begins at sample i, in mm. */
V_INLINE vf interval_middle(const tc_cpu_args *args, int i) {
  return v_set(((float)i + 0.5f * (float)(args->interval - 1)) * args->rays.step_mm);
}

/* A ray's greatest sample, and where it is in mm; of several equal ones the first. */
typedef struct peak {
  vf best, at;
  vm met; /* rays that took a sample; with gaps only */
} peak;

/* Refines the peak between samples: the greatest value of the field near the greatest sample (raycast/projection.h). */
V_ONCE vf refine_peak(const tc_cpu_args *args, const packet *p, const peak *from) {
  const variant v = {.type = args->key.voxel_type, .filter = args->key.filter, .labels = args->key.labels};
  vf best = from->best, at = from->at;
  float offset = 0.5f * args->rays.step_mm;
  for (int round = 0; round < TC_PEAK_ROUNDS; round++, offset *= 0.5f) {
    vf middle = at;
    for (int side = 0; side < 2; side++, offset = -offset) {
      vf t = v_min(v_max(middle - v_set(offset), v_set(0)), p->length);
      vf w = sample_voxel(args, v, p, t) * v_set(args->grey.sign);
      if (v.labels) w = v_select(has_value(args, p, t), w, best);
      at = v_select(v_lt(best, w), t, at);
      best = v_max(best, w);
    }
  }
  return best;
}

/* Samples the rays; finished rays do not change. Of equal maxima the first counts, with and without skipping: blocks
 * that hold an equal of the greatest sample are never skipped (skip/bounds.h). */
V_INLINE void raise_peak(const tc_cpu_args *args, variant v, const packet *p, vf w, vf t, vm which, peak *have) {
  if (v.labels) {
    vm value = m_and(which, has_value(args, p, t));
    have->met = m_or(have->met, value);
    w = v_select(value, w, v_set(args->grey.floor));
  }
  w = v_select(which, w, v_set(-FLT_MAX));
  vm sooner = m_and(v_eq(w, have->best), v_lt(t, have->at));
  have->at = v_select(m_or(v_lt(have->best, w), sooner), t, have->at);
  have->best = v_max(have->best, w);
}

V_INLINE void take_sample(const tc_cpu_args *args, variant v, const packet *p, vf t, peak *have) {
  raise_peak(args, v, p, sample_voxel(args, v, p, t) * v_set(args->grey.sign), t, v_le(v_set(0), v_set(0)), have);
}

/* A maximum to begin with, from the interval with the highest level: nearly all other intervals are then below it
 * and can be skipped. Its samples are among those that the march would take. */
V_INLINE void start_peak(const tc_cpu_args *args, variant v, const packet *p, vm live, peak *have,
                         tc_cpu_counts *counts) {
  vf highest = v_set(-1), at = v_set(0);
  for (int i = 0;; i += args->interval) {
    vm inside = m_and(live, v_lt(v_set((float)i * args->rays.step_mm), p->length));
    if (!keep_marching(args, inside, counts, i)) break;
    vf level = level_at(args, p, interval_middle(args, i));
    vm higher = m_and(inside, v_lt(highest, level));
    highest = v_select(higher, level, highest);
    at = v_select(higher, v_set((float)i), at);
  }
  for (int j = 0; j < args->interval && keep_marching(args, live, counts, j); j++) {
    vf t = v_min((at + v_set((float)j)) * v_set(args->rays.step_mm), p->length);
    take_sample(args, v, p, t, have);
  }
  counts->samples += (uint64_t)m_count(live) * (uint64_t)args->interval;
}

/* Empty-space skipping: intervals of samples whose level proves that no live ray's maximum can rise are skipped. */
V_INLINE void cast_extreme(const tc_cpu_args *args, variant v, const place *at_pixels, skip_backoff *backoff, vf4 *out,
                           tc_cpu_counts *counts) {
  packet p = start_packet(args, v, at_pixels);
  vf stop = v_set(args->grey.stop), floor = v_set(args->grey.floor);
  peak have = {floor, v_set(-1), v_lt(floor, floor)};
  vm live = p.live;
  counts->rays += (uint64_t)m_count(live);
  bool look = v.leap && backoff->wait == 0;
  if (v.leap && backoff->wait) backoff->wait--;
  if (look && m_any(live)) { /* MinIP through air is finished by its first sample */
    take_sample(args, v, &p, v_set(0), &have);
    counts->samples += (uint64_t)m_count(live);
    live = m_and(live, v_lt(have.best, stop));
  }
  float worth_mm = (float)(LEAST_INTERVALS * args->interval) * args->rays.step_mm;
  look = look && m_any(m_and(live, v_lt(v_set(worth_mm), p.length)));
  if (look) {
    start_peak(args, v, &p, live, &have, counts);
    live = m_and(live, v_lt(have.best, stop));
  }
  const march m = start_march(args, v, &p, !look);
  int i = 0, end = 0, skipped = 0;
  for (; keep_marching(args, live, counts, i); i++) {
    if (look && i == end) {
      end = i + args->interval;
      vf most = (have.best - floor) * v_set(args->level_scale);
      if (!m_any(m_and(live, v_lt(most, level_at(args, &p, interval_middle(args, i)))))) {
        skipped++;
        i = end - 1;
        live = m_and(live, v_lt(v_set((float)i * args->rays.step_mm), p.length));
        continue;
      }
    }
    vf t = (v_set((float)i) - p.delay) * v_set(args->rays.step_mm), at = v_min(t, p.length);
    const vm active = m_and(live, v_le(v_set(0), t));
    vf w = march_voxel(args, v, &p, &m, i, at, active, NULL) * v_set(args->grey.sign);
    raise_peak(args, v, &p, w, at, active, &have);
    counts->samples += (uint64_t)m_count(active);
    live = m_and(live, m_and(v_lt(t, p.length), v_lt(have.best, stop)));
  }
  if (look) update_backoff(backoff, args->interval, skipped, i);
  counts->leaps += (uint64_t)skipped;
  vm between = m_and(p.live, m_and(v_lt(floor, have.best), v_lt(have.best, stop)));
  if (m_any(between)) {
    have.best = v_select(between, refine_peak(args, &p, &have), have.best);
    counts->samples += (uint64_t)m_count(between) * 2 * TC_PEAK_ROUNDS;
  }
  /* A finished ray may have gone beyond stop while other lanes marched: its grey must not depend on them. */
  *out = grey_of(args, v_min(have.best, stop), v.labels ? m_and(p.live, have.met) : p.live);
}

/* The mean by the trapezoidal rule, whose last interval is shorter. Differences to the first sample are summed, with
 * Kahan's compensation: a constant field is exact, and a million samples lose no more than ten. An interval whose middle
 * is in a gap is left out. */
V_INLINE void cast_average(const tc_cpu_args *args, variant v, const place *at_pixels, vf4 *out,
                           tc_cpu_counts *counts) {
  packet p = start_packet(args, v, at_pixels);
  vm live = p.live;
  vf steps = p.length * v_set(args->rays.inverse_step), base = v_set(0), front = v_set(0), sum = v_set(0),
     lost = v_set(0), total = v_set(0);
  if (m_any(live)) base = front = sample_voxel(args, v, &p, v_set(0));
  counts->rays += (uint64_t)m_count(live);
  counts->samples += (uint64_t)m_count(live);
  for (int i = 0; keep_marching(args, live, counts, i); i++) {
    vf back = sample_voxel(args, v, &p, v_min(v_set((float)(i + 1) * args->rays.step_mm), p.length));
    counts->samples += (uint64_t)m_count(live);
    vf share = v_min(v_max(steps - v_set((float)i), v_set(0)), v_set(1));
    if (v.labels) {
      vf middle = v_set((float)i * args->rays.step_mm) + share * v_set(0.5f * args->rays.step_mm);
      share = v_select(has_value(args, &p, middle), share, v_set(0));
      total = total + share;
    }
    vf add = v_fnma(v_set(1), lost, share * (v_set(0.5f) * (front - base) + v_set(0.5f) * (back - base)));
    vf next = sum + add;
    lost = (next - sum) - add;
    sum = next;
    front = back;
    live = m_and(live, v_lt(v_set((float)(i + 1) * args->rays.step_mm), p.length));
  }
  if (!v.labels) total = steps;
  vm met = v.labels ? m_and(p.live, v_lt(v_set(0), total)) : p.live;
  *out = grey_of(args, base + sum / v_max(total, v_set(1e-30f)), met);
}
