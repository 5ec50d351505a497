/* Projections of a packet: the maximum, or the mean, of the field along each ray. Part of the template.
 *
 * Sample i of a ray is at entry + i*step*dir, and the ray's end is sampled too, so that all of the ray is covered. mip
 * and minip are one kernel (raycast/grey.h turns the voxels). A ray past its end samples its end again, which raises no
 * maximum: no lane needs a mask, and no pixel depends on its neighbours. */

#define WORTH_A_GUESS 4 /* intervals that a ray must be long, at least */
#define LONGEST_REST 31 /* packets */

/* Where little can be left out, looking costs more than it saves: a packet that gained nothing lets the next ones of
 * its tile march straight, more of them each time. No bit of the picture depends on it. */
typedef struct skip_mood {
  int rest;  /* packets that do not look */
  int pause; /* how many they were last time */
} skip_mood;

V_INLINE void learn(skip_mood *mood, int interval, int left_out, int steps) {
  bool gained = (int64_t)left_out * interval > steps / 8 + interval;
  mood->pause = gained ? 0 : mood->pause < LONGEST_REST ? 2 * mood->pause + 1 : LONGEST_REST;
  mood->rest = mood->pause;
}

/* Grey where a ray met the volume, nothing elsewhere. */
V_INLINE vf4 grey_of(const tc_cpu_args *g, vf w, vm met) {
  vf grey = v_min(v_max(v_fma(w, v_set(g->gain), v_set(g->offset)), v_set(0)), v_set(1));
  grey = v_select(met, grey, v_set(0));
  if (g->to_light) {
    vf x = grey * v_set(TC_LIGHT_STEPS), low, high;
    vi i = v_trunc(x);
    v_pair_f32(g->to_light, i, &low, &high);
    grey = v_fma(x - v_float(i), high - low, low);
  }
  return (vf4){grey, grey, grey, v_select(met, v_set(1), v_set(0))};
}

/* The levels of the blocks that the rays are in at mm t (skip/bounds.h). */
V_INLINE vf level_at(const tc_cpu_args *g, const packet *p, vf t) {
  vi block[3];
  for (int k = 0; k < 3; k++) {
    vf q = v_min(v_max(v_fma(t, p->dir[k], p->entry[k]), v_set(0)), v_set(g->last[k]));
    vf cell = v_float(v_mini(v_trunc(q), v_seti(g->cell_last[k])));
    block[k] = v_trunc((cell + v_set(0.5f)) * v_set(g->inverse_block)); /* the half keeps rounding away from edges */
  }
  vi off = v_addi(v_muli(block[2], v_seti(g->block_slice)), v_muli(block[1], v_seti(g->block_row)));
  return v_float(v_bytes(g->levels, v_addi(off, block[0])));
}

/* Mm of the middle of the interval that begins at sample i. */
V_INLINE vf middle_of(const tc_cpu_args *g, int i) {
  return v_set(((float)i + 0.5f * (float)(g->interval - 1)) * g->step_mm);
}

/* A ray's greatest sample, and where that is, mm: the first place of several. */
typedef struct peak { vf best, at; } peak;

/* The greatest value of the field close to the greatest sample (raycast/grey.h). Seldom, hence once for all kernels. */
V_ONCE vf climb(const tc_cpu_args *g, const packet *p, const peak *from) {
  const variant v = {.type = g->key.voxel_type, .filter = g->key.filter};
  vf best = from->best, at = from->at;
  float away = 0.5f * g->step_mm;
  for (int round = 0; round < TC_PEAK_ROUNDS; round++, away *= 0.5f) {
    vf middle = at;
    for (int side = 0; side < 2; side++, away = -away) {
      vf t = v_min(v_max(middle - v_set(away), v_set(0)), p->length);
      vf w = sample_voxel(g, v, p, t) * v_set(g->turn);
      at = v_select(v_lt(best, w), t, at);
      best = v_max(best, w);
    }
  }
  return best;
}

/* A sample of the rays; of those that are finished it changes nothing. Blocks that hold an equal to the greatest sample
 * are never left out (skip/bounds.h), and so the first one is the first with and without. */
V_INLINE void take_sample(const tc_cpu_args *g, variant v, const packet *p, vf t, peak *have) {
  vf w = sample_voxel(g, v, p, t) * v_set(g->turn);
  vm sooner = m_and(v_eq(w, have->best), v_lt(t, have->at));
  have->at = v_select(m_or(v_lt(have->best, w), sooner), t, have->at);
  have->best = v_max(have->best, w);
}

/* A maximum to begin with: every ray is sampled in the interval with the highest level, and nearly all of the others
 * are then below what it has. The samples are some of those that the march takes. */
V_INLINE void guess_peak(const tc_cpu_args *g, variant v, const packet *p, vm live, peak *have, tc_cpu_counts *counts) {
  vf highest = v_set(-1), at = v_set(0);
  for (int i = 0;; i += g->interval) {
    vm inside = m_and(live, v_lt(v_set((float)i * g->step_mm), p->length));
    if (!marches(g, inside, counts, i)) break;
    vf level = level_at(g, p, middle_of(g, i));
    vm higher = m_and(inside, v_lt(highest, level));
    highest = v_select(higher, level, highest);
    at = v_select(higher, v_set((float)i), at);
  }
  for (int j = 0; j < g->interval && marches(g, live, counts, j); j++) {
    vf t = v_min((at + v_set((float)j)) * v_set(g->step_mm), p->length);
    take_sample(g, v, p, t, have);
  }
  counts->samples += (uint64_t)m_count(live) * (uint64_t)g->interval;
}

/* With v.leap whole intervals are left out in which no live ray's maximum may rise. Short rays have
 * nothing to gain and do not look. */
V_INLINE void cast_extreme(const tc_cpu_args *g, variant v, const place *at_pixels, skip_mood *mood, vf4 *out,
                           tc_cpu_counts *counts) {
  packet p = start_packet(g, v, at_pixels);
  vf stop = v_set(g->stop), floor = v_set(g->floor);
  peak have = {floor, v_set(-1)};
  vm live = p.live;
  counts->rays += (uint64_t)m_count(live);
  bool look = v.leap && mood->rest == 0;
  if (v.leap && mood->rest) mood->rest--;
  if (look && m_any(live)) { /* minip through air is finished by the first sample: no guess is worth its price there */
    take_sample(g, v, &p, v_set(0), &have);
    counts->samples += (uint64_t)m_count(live);
    live = m_and(live, v_lt(have.best, stop));
  }
  float worth_mm = (float)(WORTH_A_GUESS * g->interval) * g->step_mm;
  look = look && m_any(m_and(live, v_lt(v_set(worth_mm), p.length)));
  if (look) {
    guess_peak(g, v, &p, live, &have, counts);
    live = m_and(live, v_lt(have.best, stop));
  }
  int i = 0, end = 0, left_out = 0;
  for (; marches(g, live, counts, i); i++) {
    if (look && i == end) {
      end = i + g->interval;
      vf most = (have.best - floor) * v_set(g->level_scale);
      if (!m_any(m_and(live, v_lt(most, level_at(g, &p, middle_of(g, i)))))) {
        left_out++;
        i = end - 1;
        live = m_and(live, v_lt(v_set((float)i * g->step_mm), p.length));
        continue;
      }
    }
    take_sample(g, v, &p, v_min(v_set((float)i * g->step_mm), p.length), &have);
    counts->samples += (uint64_t)m_count(live);
    live = m_and(live, m_and(v_lt(v_set((float)i * g->step_mm), p.length), v_lt(have.best, stop)));
  }
  if (look) learn(mood, g->interval, left_out, i);
  counts->leaps += (uint64_t)left_out;
  vm between = m_and(p.live, m_and(v_lt(floor, have.best), v_lt(have.best, stop)));
  if (m_any(between)) {
    have.best = v_select(between, climb(g, &p, &have), have.best);
    counts->samples += (uint64_t)m_count(between) * 2 * TC_PEAK_ROUNDS;
  }
  /* What was sampled beyond stop, for the sake of other lanes or by rounding, is not told from stop. */
  *out = grey_of(g, v_min(have.best, stop), p.live);
}

/* Trapezoids between samples, the last one shorter, over the ray's length in steps. Summed as differences to the first
 * sample, with what rounding takes off put back: a constant field is exact, and a million samples are as good as
 * ten. */
V_INLINE void cast_average(const tc_cpu_args *g, variant v, const place *at_pixels, vf4 *out, tc_cpu_counts *counts) {
  packet p = start_packet(g, v, at_pixels);
  vm live = p.live;
  vf steps = p.length * v_set(g->inverse_step), base = v_set(0), front = v_set(0), sum = v_set(0), lost = v_set(0);
  if (m_any(live)) base = front = sample_voxel(g, v, &p, v_set(0));
  counts->rays += (uint64_t)m_count(live);
  counts->samples += (uint64_t)m_count(live);
  for (int i = 0; marches(g, live, counts, i); i++) {
    vf back = sample_voxel(g, v, &p, v_min(v_set((float)(i + 1) * g->step_mm), p.length));
    counts->samples += (uint64_t)m_count(live);
    vf share = v_min(v_max(steps - v_set((float)i), v_set(0)), v_set(1));
    vf add = v_fnma(v_set(1), lost, share * (v_set(0.5f) * (front - base) + v_set(0.5f) * (back - base)));
    vf next = sum + add;
    lost = (next - sum) - add;
    sum = next;
    front = back;
    live = m_and(live, v_lt(v_set((float)(i + 1) * g->step_mm), p.length));
  }
  *out = grey_of(g, base + sum / v_max(steps, v_set(1e-30f)), p.live);
}
