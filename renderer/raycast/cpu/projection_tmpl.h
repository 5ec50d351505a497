/* Maximum, minimum and average intensity projection (MIP, MinIP, average) of a packet.
 *
 * Sample i is at entry + i * step * dir, and the ray's end is sampled too. MIP and MinIP are one kernel, a maximum
 * of the signed voxel (raycast/projection.h). A ray that has passed its end samples the end again, which raises no
 * maximum: no lane needs a mask, and no pixel depends on its neighbours. Samples in a volume's gaps (variant.labels)
 * are ignored. */

#define LEAST_INTERVALS 4  /* shorter rays gain nothing from skipping */
#define MOST_INTERVALS 128 /* intervals ranked together */
#define BAND 16            /* levels that rank alike */
#define LEAST_SAMPLES 4    /* of an interval that one look-up serves for all lanes */
#define LONGEST_WAIT 31    /* packets */

V_INLINE void update_backoff(skip_backoff *backoff, int skipped, int all) {
  bool gained = 4 * skipped > all;
  backoff->last = gained ? 0 : backoff->last < LONGEST_WAIT ? 2 * backoff->last + 1 : LONGEST_WAIT;
  backoff->wait = backoff->last;
}

/* Grey with opacity 1 if the ray met the volume, else transparent. */
V_INLINE vf4 grey_of(const tc_cpu_args *args, vf w, vm met) {
  vf grey = v_min(v_max(v_fma(w, v_set(args->grey.gain), v_set(args->grey.offset)), v_set(0)), v_set(1));
  grey = v_select(met, grey, v_set(0));
  if (args->to_light) {
    vf x = grey * v_set(TC_LIGHT_STEPS), low, high;
    vi i = v_trunc(x);
    fetch_pair(TC_F32, args->to_light, i, &low, &high);
    grey = v_fma(x - v_float(i), high - low, low);
  }
  return (vf4){grey, grey, grey, v_select(met, v_set(1), v_set(0))};
}

/* Levels (skip/bounds.h) of the blocks that cells are in. */
V_INLINE vf levels_of(const tc_cpu_args *args, const vi cell[3]) {
  vi block[3];
  for (int k = 0; k < 3; k++) /* the half keeps rounding away from edges */
    block[k] = v_trunc((v_float(cell[k]) + v_set(0.5f)) * v_set(args->blocks.inverse_width));
  vi off = v_addi(v_muli(block[2], v_seti(args->blocks.slice)), v_muli(block[1], v_seti(args->blocks.row)));
  return v_float(v_bytes(args->blocks.values, v_addi(off, block[0])));
}

/* A ray's greatest sample, and its position in mm; the first of several equal ones. */
typedef struct peak {
  vf best, at;
  vm met; /* rays that took a sample; with gaps only */
} peak;

/* Refines the peak between samples: the greatest value of the field near the greatest sample (raycast/projection.h). */
V_ONCE vf refine_peak(const tc_cpu_args *args, const packet *p, vf best, vf at) {
  const variant v = {.type = args->key.voxel_type, .filter = args->key.filter, .labels = args->key.labels};
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

/* Updates the maxima with the samples w; finished rays do not change. The first of equal maxima counts, with and
 * without skipping, because blocks that contain a sample equal to the maximum are never skipped (skip/bounds.h). */
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

/* Samples the inner steps from `first` to before `end`. Every ray of the packet has a sample there, so that no lane needs a mask.
 * Ends early if all chosen lanes have reached grey.stop. Returns the first step not sampled. */
V_INLINE int sample_inner(const tc_cpu_args *args, variant v, const packet *p, march *m, int first, int end,
                          vm *chosen, peak *have, tc_cpu_counts *counts) {
  const vf step = v_set(args->rays.step_mm), stop = v_set(args->grey.stop), sign = v_set(args->grey.sign);
  vf number = v_set((float)first) - p->delay, best = v_set(-FLT_MAX), at = v_set(0);
  vm left = *chosen;
  int i = first;
  for (; i < end && m_any(left); i++) {
    const vf t = number * step, w = inner_voxel(args, v, p, m, i, t, left) * sign;
    counts->samples += (uint64_t)m_count(left);
    at = v_select(v_lt(best, w), t, at);
    best = v_max(best, w);
    left = m_and(left, v_lt(best, stop));
    number = number + v_set(1);
  }
  raise_peak(args, v, p, best, at, *chosen, have);
  *chosen = left;
  return i;
}

/* The present maxima, in levels. */
V_INLINE vf risen(const tc_cpu_args *args, const peak *have) {
  return (have->best - v_set(args->grey.floor)) * v_set(args->level_scale);
}

/* How many consecutive samples of all lanes lie within a block's width of one point. The sample before them counts too,
 * because a ray's end lies between two steps. */
V_INLINE int packet_interval(const tc_cpu_args *args, const march *m) {
  float most = 1e6f;
  for (int k = 0; k < 3; k++) {
    const float room = 2 * (args->blocks.width - 0.02f) - m->width[k], rise = fabsf(m->rise[k]);
    if (room < most * rise) most = room / rise;
  }
  return most < 0 ? 0 : (int)most;
}

/* Levels of V_LANES intervals of a packet, from sample `first` on: those around the middles of what they cover. */
V_INLINE vf levels_of_packet(const tc_cpu_args *args, const march *m, int first, int interval) {
  vf number = v_fma(v_lane_y(), v_set(V_PACKET_X), v_lane_x());
  vf middle = v_fma(number, v_set((float)interval), v_set((float)first - 1 + 0.5f * (float)interval));
  vi cell[3];
  for (int k = 0; k < 3; k++) {
    vf q = v_fma(middle, v_set(m->rise[k]), v_set(m->lo[k] + 0.5f * m->width[k]));
    cell[k] = v_mini(v_trunc(v_max(v_min(q, v_set(args->grid.last[k])), v_set(0))), v_seti(args->grid.cell_last[k]));
  }
  return levels_of(args, cell);
}

/* The same of one interval of a wide packet: the highest level of its lanes. */
V_INLINE float level_of_lanes(const tc_cpu_args *args, const packet *p, vm live, int first,
                              int interval) {
  vf middle = v_set((float)first - 1 + 0.5f * (float)interval) - p->delay;
  const spot s = spot_at(args, p, middle * v_set(args->rays.step_mm));
  return v_most(v_select(live, levels_of(args, s.cell), v_set(0)));
}

/* The chosen lanes' samples from number `first` on: those that a march would take. */
V_INLINE void sample_interval(const tc_cpu_args *args, variant v, const packet *p, march *m, int first,
                              int interval, vm chosen, peak *have, tc_cpu_counts *counts) {
  const vf step = v_set(args->rays.step_mm), stop = v_set(args->grey.stop);
  for (int i = first; i < first + interval; i++) {
    const int run = v.labels ? 0 : inner_steps(m, i, first + interval);
    if (__builtin_expect(run > 0, 1)) {
      if (!m_any(chosen) || !keep_polling(args, run, counts)) break;
      i = sample_inner(args, v, p, m, i, i + run, &chosen, have, counts) - 1;
      continue;
    }
    vf t = (v_set((float)i) - p->delay) * step, before = (v_set((float)(i - 1)) - p->delay) * step;
    chosen = m_and(chosen, m_and(v_lt(before, p->length), v_lt(have->best, stop)));
    if (!keep_marching(args, chosen, counts, i - first)) break;
    const vm active = m_and(chosen, v_le(v_set(0), t));
    if (!m_any(active)) continue;
    t = v_min(t, p->length);
    raise_peak(args, v, p, march_voxel(args, v, p, m, i, t, active, NULL) * v_set(args->grey.sign), t, active, have);
    counts->samples += (uint64_t)m_count(active);
  }
}

/* The lowest present maximum of the live rays, in levels: no interval of that level or below raises one. */
V_INLINE float least_risen(const tc_cpu_args *args, const peak *have, vm live) {
  return v_least(v_select(live, risen(args, have), v_set(1e9f)));
}

/* The packet samples its intervals of the highest band of levels first, then those of the next, until none is above any
 * lane's maximum. Within a band, neighbouring intervals are one march: a march per interval, in the order of single levels,
 * leaves out hardly more samples, but each of its starts waits for memory.
 * levels: of n intervals from sample `first` on. Returns how many were sampled. */
V_INLINE int climb(const tc_cpu_args *args, variant v, const packet *p, march *m, int first, int interval,
                   const float *levels, int n, vm live, peak *have, tc_cpu_counts *counts) {
  uint8_t head[256 / BAND] = {0}, next[MOST_INTERVALS]; /* intervals of each band, numbered from 1, as lists that end in 0 */
  int visits = 0, highest = 0;
  for (int k = n; k-- > 0;) {
    if (levels[k] == 0) continue;
    const int band = (int)levels[k] / BAND;
    next[k] = head[band];
    head[band] = (uint8_t)(k + 1);
    highest = band > highest ? band : highest;
  }
  const int merged = 1 + TC_CPU_POLL_STEPS / interval; /* at most: the halt is polled between marches */
  for (int band = highest; band >= 0; band--) {
    float least = least_risen(args, have, live);
    if (least >= (float)((band + 1) * BAND)) return visits;
    for (int k = head[band]; k;) {
      const int from = k - 1;
      float most = levels[from];
      k = next[from];
      if (most <= least) continue;
      int end = from + 1;
      for (; k == end + 1 && levels[end] > least && end - from < merged; k = next[end++])
        most = levels[end] > most ? levels[end] : most;
      const vm chosen = m_and(live, v_lt(risen(args, have), v_set(most)));
      if (!m_any(chosen)) continue; /* never; with the test, GCC 12 compiles a march that is up to 7 % faster on Zen 3 */
      sample_interval(args, v, p, m, first + from * interval, (end - from) * interval, chosen, have, counts);
      visits += end - from;
      if (counts->left) return visits;
      least = least_risen(args, have, live);
    }
  }
  return visits;
}

/* Empty-space skipping: intervals of samples that cannot raise a ray's maximum are left out, and the others are taken
 * best first, because a high maximum leaves out most of the rest. */
V_INLINE void climb_all(const tc_cpu_args *args, variant v, packet *p, vm live, peak *have, skip_backoff *backoff,
                        tc_cpu_counts *counts) {
  float levels[MOST_INTERVALS];
  march m = {.ahead = steps_ahead(args, p, PREFETCH_STEPS / 2)};
  level_lanes(args, p);
  bound_lanes(args, v, p, &m);
  const int of_packet = packet_interval(args, &m);
  const bool narrow = of_packet >= LEAST_SAMPLES;
  const int interval = narrow ? of_packet : args->interval - 1;
  const int samples = 2 + (int)v_most(v_fma(p->length, v_set(args->rays.inverse_step), p->delay));
  int all = 0, visits = 0;
  for (int first = 0, n; first < samples && !counts->left; first += n * interval, all += n) {
    n = (samples - first + interval - 1) / interval;
    if (n > MOST_INTERVALS) n = MOST_INTERVALS;
    for (int k = 0; k < n; k += narrow ? V_LANES : 1) {
      const int from = first + k * interval;
      if (narrow) v_store(&levels[k], levels_of_packet(args, &m, from, interval));
      else levels[k] = level_of_lanes(args, p, live, from, interval);
    }
    visits += climb(args, v, p, &m, first, interval, levels, n, live, have, counts);
  }
  counts->leaps += (uint64_t)(all > visits ? all - visits : 0);
  update_backoff(backoff, all - visits, all);
}

V_INLINE void cast_extreme(const tc_cpu_args *args, variant v, const place *at_pixels, skip_backoff *backoff, vf4 *out,
                           tc_cpu_counts *counts) {
  packet p = start_packet(args, v, at_pixels);
  vf stop = v_set(args->grey.stop), floor = v_set(args->grey.floor);
  peak have = {floor, v_set(-1), v_lt(floor, floor)};
  vm live = p.live;
  counts->rays += (uint64_t)m_count(live);
  bool look = v.leap && args->interval > 1 && backoff->wait == 0;
  if (v.leap && backoff->wait) backoff->wait--;
  if (look && args->grey.sign < 0 && m_any(live)) { /* MinIP through air is finished by its first sample */
    raise_peak(args, v, &p, sample_voxel(args, v, &p, v_set(0)) * v_set(args->grey.sign), v_set(0), live, &have);
    counts->samples += (uint64_t)m_count(live);
    live = m_and(live, v_lt(have.best, stop));
  }
  float worth_mm = (float)(LEAST_INTERVALS * args->interval) * args->rays.step_mm;
  look = look && m_any(m_and(live, v_lt(v_set(worth_mm), p.length)));
  if (look) climb_all(args, v, &p, live, &have, backoff, counts);
  if (v.labels && m_any(m_andnot(live, have.met))) look = false; /* a skipped interval may hold the ray's only value
                                                                    outside gaps */
  if (!look && m_any(live)) {
    march m = start_march(args, v, &p, true);
    for (int i = 0; keep_marching(args, live, counts, i); i++) {
      const int run = v.labels ? 0 : inner_steps(&m, i, i + TC_CPU_POLL_STEPS);
      if (__builtin_expect(run > 0, 1)) {
        if (!keep_polling(args, run, counts)) break;
        i = sample_inner(args, v, &p, &m, i, i + run, &live, &have, counts) - 1;
        continue;
      }
      vf t = (v_set((float)i) - p.delay) * v_set(args->rays.step_mm), at = v_min(t, p.length);
      const vm active = m_and(live, v_le(v_set(0), t));
      vf w = march_voxel(args, v, &p, &m, i, at, active, NULL) * v_set(args->grey.sign);
      raise_peak(args, v, &p, w, at, active, &have);
      counts->samples += (uint64_t)m_count(active);
      live = m_and(live, m_and(v_lt(t, p.length), v_lt(have.best, stop)));
    }
  }
  vm between = m_and(p.live, m_and(v_lt(floor, have.best), v_lt(have.best, stop)));
  if (m_any(between)) {
    have.best = v_select(between, refine_peak(args, &p, have.best, have.at), have.best);
    counts->samples += (uint64_t)m_count(between) * 2 * TC_PEAK_ROUNDS;
  }
  /* A finished ray may have exceeded stop while other lanes marched: clamped, so that its grey does not depend on
   * them. */
  *out = grey_of(args, v_min(have.best, stop), v.labels ? m_and(p.live, have.met) : p.live);
}

/* The sum of a ray's intervals, with Kahan's compensation. */
typedef struct kahan {
  vf sum, lost;
} kahan;

V_INLINE void add_interval(kahan *of, vf mean, vf share) {
  const vf add = v_fnma(v_set(1), of->lost, share * mean), next = of->sum + add;
  of->lost = (next - of->sum) - add;
  of->sum = next;
}

/* The mean by the trapezoidal rule with a shorter last interval. Differences to the first sample are summed with
 * Kahan's compensation: a constant field is exact, and a million samples lose no more precision than ten. Intervals
 * whose middle is in a gap are ignored. */
V_INLINE void cast_average(const tc_cpu_args *args, variant v, const place *at_pixels, vf4 *out,
                           tc_cpu_counts *counts) {
  packet p = start_packet(args, v, at_pixels);
  vm live = p.live;
  const vf step = v_set(args->rays.step_mm), half = v_set(0.5f);
  vf steps = p.length * v_set(args->rays.inverse_step), base = v_set(0), front = v_set(0), total = v_set(0);
  kahan mean = {v_set(0), v_set(0)};
  if (m_any(live)) base = sample_voxel(args, v, &p, v_set(0));
  counts->rays += (uint64_t)m_count(live);
  counts->samples += (uint64_t)m_count(live);
  march m = start_march(args, v, &p, false);
  for (int i = 0; keep_marching(args, live, counts, i); i++) {
    const int run = v.labels ? 0 : inner_steps(&m, i + 1, i + 1 + TC_CPU_POLL_STEPS);
    if (run > 0) { /* whole intervals of all lanes */
      if (!keep_polling(args, run, counts)) break;
      for (const int end = i + run; i < end; i++) {
        const vf back = inner_voxel(args, v, &p, &m, i + 1, v_set((float)(i + 1)) * step, live) - base;
        add_interval(&mean, half * front + half * back, v_set(1));
        front = back;
      }
      counts->samples += (uint64_t)run * (uint64_t)m_count(live);
      i--;
      continue;
    }
    const vf t = v_min(v_set((float)(i + 1)) * step, p.length);
    const vf back = march_voxel(args, v, &p, &m, i + 1, t, live, NULL) - base;
    counts->samples += (uint64_t)m_count(live);
    vf share = v_min(v_max(steps - v_set((float)i), v_set(0)), v_set(1));
    if (v.labels) {
      const vf middle = (v_set((float)i) + half * share) * step;
      share = v_select(has_value(args, &p, middle), share, v_set(0));
      total = total + share;
    }
    add_interval(&mean, half * front + half * back, share);
    front = back;
    live = m_and(live, v_lt(v_set((float)(i + 1)) * step, p.length));
  }
  if (!v.labels) total = steps;
  vm met = v.labels ? m_and(p.live, v_lt(v_set(0), total)) : p.live;
  *out = grey_of(args, base + mean.sum / v_max(total, v_set(1e-30f)), met);
}
