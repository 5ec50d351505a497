/* Empty-space skipping in dvr: the occupied stretches of a packet's rays (skip/cover.h) as runs of whole steps. */

typedef struct runs {
  const uint64_t *bits; /* bits of the packet's cell of pixels, one per slot of depth: set if occupied */
  ptrdiff_t next_word;
  int words, slot;      /* slot: the next slot to read */
  vf start, steps;      /* steps from a ray's first sample to slot 0; steps per slot */
} runs;

/* The bits of the packet's cell of pixels. */
V_INLINE const uint64_t *cover_bits(const tc_cpu_args *args, const place *at) {
  const ptrdiff_t row = (ptrdiff_t)(at->y >> args->cover.shift) * args->cover.words * args->cover.cells[0];
  return args->cover.bits + row + (at->x >> args->cover.shift);
}

/* True if nothing is occupied along any ray of the packet. */
V_INLINE bool all_empty(const tc_cpu_args *args, const place *at) {
  const uint64_t *bits = cover_bits(args, at);
  uint64_t any = 0;
  for (int w = 0; w < args->cover.words; w++) any |= bits[(ptrdiff_t)w * args->cover.cells[0]];
  return !any;
}

V_INLINE runs start_runs(const tc_cpu_args *args, variant v, const packet *p, const place *at) {
  vf steps_per_mm = v_set(args->rays.inverse_step) / p->forward; /* steps per mm of depth */
  vf begin = p->start;
  if (phased(v)) begin = begin - p->lag;
  return (runs){.bits = cover_bits(args, at),
                .next_word = args->cover.cells[0],
                .words = args->cover.words,
                .start = v_fma(v_set((float)args->cover.near_mm), steps_per_mm,
                               p->delay - begin * v_set(args->rays.inverse_step)),
                .steps = v_set((float)args->cover.slot_mm) * steps_per_mm};
}

/* The first slot at or after `slot` whose bit equals `set`; words * 64 if there is none. */
static inline int find_slot(const runs *r, int slot, bool set) {
  uint64_t seen = ~(uint64_t)0 << (slot & 63);
  for (int w = slot >> 6; w < r->words; w++, seen = ~(uint64_t)0) {
    uint64_t bits = r->bits[w * r->next_word], word = (set ? bits : ~bits) & seen;
    if (word) return w * 64 + __builtin_ctzll(word);
  }
  return r->words * 64;
}

/* The next run of segments [*from, *to), at or after `least`, that is occupied for any live ray; false: none is left.
 * The margin of a hundredth of a step is far above single-precision rounding. */
V_INLINE bool next_run(runs *r, vm live, int least, int *from, int *to) {
  vf far = v_set(1e9f);
  do {
    int a = find_slot(r, r->slot, true);
    if (a >= r->words * 64) return false;
    r->slot = find_slot(r, a, false);
    vf first = v_fma(v_set((float)a), r->steps, r->start), last = v_fma(v_set((float)r->slot), r->steps, r->start);
    float begin = v_least(v_select(live, first, far)) - 0.01f,
          end = 1.01f - v_least(v_select(live, v_set(0) - last, far));
    *from = begin > (float)least ? begin < 1e9f ? (int)begin : 1000000000 : least;
    *to = end < 1e9f ? (int)end : 1000000000;
  } while (*to <= least);
  return true;
}

/* True if the segments of all live rays, whose samples lie between least and most, lie in the empty range of values at either end
 * of the transfer function. */
V_INLINE bool all_zero(const tc_cpu_args *args, vf least, vf most, vm live) {
  const vm zero = m_or(v_lt(most, v_set(args->zero_below)), v_lt(v_set(args->zero_above), least));
  return !m_any(m_andnot(live, zero));
}
