/* Projections of a packet: the maximum, or the mean, of the field along each ray. Part of the template.
 *
 * Sample i of a ray is at entry + i*step*dir, and the ray's end is sampled too, so that all of the ray is covered. mip
 * and minip are one kernel (raycast/grey.h turns the voxels). A ray past its end samples its end again, which raises no
 * maximum: no lane needs a mask, and no pixel depends on its neighbours. */

#define WORTH_A_GUESS 4 /* intervals that a ray must be long, at least */
#define LONGEST_WAIT 31 /* packets */

V_INLINE void update_backoff(skip_backoff *backoff, int interval, int skipped, int steps) {
  bool gained = (int64_t)skipped * interval > steps / 8 + interval;
  backoff->last = gained ? 0 : backoff->last < LONGEST_WAIT ? 2 * backoff->last + 1 : LONGEST_WAIT;
  backoff->wait = backoff->last;
}

/* Grey where a ray met the volume, nothing elsewhere. */
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

/* The levels of the blocks that the rays are in at mm t (skip/bounds.h). */
V_INLINE vf level_at(const tc_cpu_args *args, const packet *p, vf t) {
  vi block[3];
  for (int k = 0; k < 3; k++) {
    vf q = v_min(v_max(v_fma(t, p->dir[k], p->entry[k]), v_set(0)), v_set(args->grid.last[k]));
    vf cell = v_float(v_mini(v_trunc(q), v_seti(args->grid.cell_last[k])));
    block[k] = v_trunc((cell + v_set(0.5f)) * v_set(args->blocks.inverse_width)); /* the half keeps rounding away from edges */
  }
  vi off = v_addi(v_muli(block[2], v_seti(args->blocks.slice)), v_muli(block[1], v_seti(args->blocks.row)));
  return v_float(v_bytes(args->blocks.values, v_addi(off, block[0])));
}

/* Mm of the middle of the interval that begins at sample i. */
V_INLINE vf middle_of(const tc_cpu_args *args, int i) {
  return v_set(((float)i + 0.5f * (float)(args->interval - 1)) * args->rays.step_mm);
}

/* A ray's greatest sample, and where that is, mm: the first place of several. */
typedef struct peak { vf best, at; } peak;

/* The greatest value of the field close to the greatest sample (raycast/grey.h). Seldom, hence once for all kernels. */
V_ONCE vf climb(const tc_cpu_args *args, const packet *p, const peak *from) {
  const variant v = {.type = args->key.voxel_type, .filter = args->key.filter};
  vf best = from->best, at = from->at;
  float away = 0.5f * args->rays.step_mm;
  for (int round = 0; round < TC_PEAK_ROUNDS; round++, away *= 0.5f) {
    vf middle = at;
    for (int side = 0; side < 2; side++, away = -away) {
      vf t = v_min(v_max(middle - v_set(away), v_set(0)), p->length);
      vf w = sample_voxel(args, v, p, t) * v_set(args->grey.sign);
      at = v_select(v_lt(best, w), t, at);
      best = v_max(best, w);
    }
  }
  return best;
}

/* A sample of the rays; of those that are finished it changes nothing. Blocks that hold an equal to the greatest sample
 * are never left out (skip/bounds.h), and so the first one is the first with and without. */
V_INLINE void take_sample(const tc_cpu_args *args, variant v, const packet *p, vf t, peak *have) {
  vf w = sample_voxel(args, v, p, t) * v_set(args->grey.sign);
  vm sooner = m_and(v_eq(w, have->best), v_lt(t, have->at));
  have->at = v_select(m_or(v_lt(have->best, w), sooner), t, have->at);
  have->best = v_max(have->best, w);
}

/* A maximum to begin with: every ray is sampled in the interval with the highest level, and nearly all of the others
 * are then below what it has. The samples are some of those that the march takes. */
V_INLINE void guess_peak(const tc_cpu_args *args, variant v, const packet *p, vm live, peak *have, tc_cpu_counts *counts) {
  vf highest = v_set(-1), at = v_set(0);
  for (int i = 0;; i += args->interval) {
    vm inside = m_and(live, v_lt(v_set((float)i * args->rays.step_mm), p->length));
    if (!marches(args, inside, counts, i)) break;
    vf level = level_at(args, p, middle_of(args, i));
    vm higher = m_and(inside, v_lt(highest, level));
    highest = v_select(higher, level, highest);
    at = v_select(higher, v_set((float)i), at);
  }
  for (int j = 0; j < args->interval && marches(args, live, counts, j); j++) {
    vf t = v_min((at + v_set((float)j)) * v_set(args->rays.step_mm), p->length);
    take_sample(args, v, p, t, have);
  }
  counts->samples += (uint64_t)m_count(live) * (uint64_t)args->interval;
}

/* With v.leap whole intervals are left out in which no live ray's maximum may rise. Short rays have
 * nothing to gain and do not look. */
V_INLINE void cast_extreme(const tc_cpu_args *args, variant v, const place *at_pixels, skip_backoff *backoff, vf4 *out,
                           tc_cpu_counts *counts) {
  packet p = start_packet(args, v, at_pixels);
  vf stop = v_set(args->grey.stop), floor = v_set(args->grey.floor);
  peak have = {floor, v_set(-1)};
  vm live = p.live;
  counts->rays += (uint64_t)m_count(live);
  bool look = v.leap && backoff->wait == 0;
  if (v.leap && backoff->wait) backoff->wait--;
  if (look && m_any(live)) { /* minip through air is finished by the first sample: no guess is worth its price there */
    take_sample(args, v, &p, v_set(0), &have);
    counts->samples += (uint64_t)m_count(live);
    live = m_and(live, v_lt(have.best, stop));
  }
  float worth_mm = (float)(WORTH_A_GUESS * args->interval) * args->rays.step_mm;
  look = look && m_any(m_and(live, v_lt(v_set(worth_mm), p.length)));
  if (look) {
    guess_peak(args, v, &p, live, &have, counts);
    live = m_and(live, v_lt(have.best, stop));
  }
  int i = 0, end = 0, skipped = 0;
  for (; marches(args, live, counts, i); i++) {
    if (look && i == end) {
      end = i + args->interval;
      vf most = (have.best - floor) * v_set(args->level_scale);
      if (!m_any(m_and(live, v_lt(most, level_at(args, &p, middle_of(args, i)))))) {
        skipped++;
        i = end - 1;
        live = m_and(live, v_lt(v_set((float)i * args->rays.step_mm), p.length));
        continue;
      }
    }
    take_sample(args, v, &p, v_min(v_set((float)i * args->rays.step_mm), p.length), &have);
    counts->samples += (uint64_t)m_count(live);
    live = m_and(live, m_and(v_lt(v_set((float)i * args->rays.step_mm), p.length), v_lt(have.best, stop)));
  }
  if (look) update_backoff(backoff, args->interval, skipped, i);
  counts->leaps += (uint64_t)skipped;
  vm between = m_and(p.live, m_and(v_lt(floor, have.best), v_lt(have.best, stop)));
  if (m_any(between)) {
    have.best = v_select(between, climb(args, &p, &have), have.best);
    counts->samples += (uint64_t)m_count(between) * 2 * TC_PEAK_ROUNDS;
  }
  /* What was sampled beyond stop, for the sake of other lanes or by rounding, is not told from stop. */
  *out = grey_of(args, v_min(have.best, stop), p.live);
}

/* Trapezoids between samples, the last one shorter, over the ray's length in steps. Summed as differences to the first
 * sample, with what rounding takes off put back: a constant field is exact, and a million samples are as good as
 * ten. */
V_INLINE void cast_average(const tc_cpu_args *args, variant v, const place *at_pixels, vf4 *out, tc_cpu_counts *counts) {
  packet p = start_packet(args, v, at_pixels);
  vm live = p.live;
  vf steps = p.length * v_set(args->rays.inverse_step), base = v_set(0), front = v_set(0), sum = v_set(0), lost = v_set(0);
  if (m_any(live)) base = front = sample_voxel(args, v, &p, v_set(0));
  counts->rays += (uint64_t)m_count(live);
  counts->samples += (uint64_t)m_count(live);
  for (int i = 0; marches(args, live, counts, i); i++) {
    vf back = sample_voxel(args, v, &p, v_min(v_set((float)(i + 1) * args->rays.step_mm), p.length));
    counts->samples += (uint64_t)m_count(live);
    vf share = v_min(v_max(steps - v_set((float)i), v_set(0)), v_set(1));
    vf add = v_fnma(v_set(1), lost, share * (v_set(0.5f) * (front - base) + v_set(0.5f) * (back - base)));
    vf next = sum + add;
    lost = (next - sum) - add;
    sum = next;
    front = back;
    live = m_and(live, v_lt(v_set((float)(i + 1) * args->rays.step_mm), p.length));
  }
  *out = grey_of(args, base + sum / v_max(steps, v_set(1e-30f)), p.live);
}
