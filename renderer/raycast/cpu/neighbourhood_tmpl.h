/* The samples of a march, with prefetching. If a packet's samples lie close together, the corners of all their cells
 * are taken from one neighbourhood of 4x4x4 floats, or 8x4x4 integers, in registers instead of by loads, for instruction
 * sets that have neighbourhoods (V_NEAR, simd.h). Both ways give the same bits.
 *
 * Kernels without neighbourhoods find the cells of the next step before they load this step's voxels. Zen 3 executes out of order
 * within 256 instructions, little more than one step: the chain from position to address would delay every step.
 *
 * The rays of a packet enter a slanted face at different depths, which would spread the samples of one step along the
 * rays. Therefore lanes that enter further from the eye wait whole steps, so that all lanes sample at similar depths;
 * the positions of a ray's samples do not change. */

#define PREFETCH_STEPS 8
#ifdef V_NEAR
#define LOADS_AHEAD false /* few of these kernels' steps load voxels; looking ahead was not measured with AVX-512 */
#else
#define LOADS_AHEAD true
#endif

/* The cells of all lanes at an inner step, as offsets in voxels, and the positions in them. */
typedef struct inner_cells {
  vi off;
  vf f[3];
} inner_cells;

typedef struct march {
  ptrdiff_t ahead; /* offset in voxels to the position of the rays PREFETCH_STEPS later */
  bool near;       /* most steps fit a neighbourhood */
  float lo[3], rise[3], width[3]; /* at step i, the lanes lie from lo + i rise to width beyond, along each axis */
  int inner, n_inner; /* first inner step, and their number: there no position needs clamping to the volume */
  bool fits;          /* at all inner steps, all cells fit a neighbourhood */
  inner_cells next;   /* LOADS_AHEAD: of step next_step, if that is an inner step */
  int next_step;
} march;

V_INLINE float v_most(vf a) { return 0 - v_least(v_set(0) - a); }

/* Sets p->delay: the whole steps that level the lanes, or 0 if that would make the packet's march much longer. */
V_INLINE void level_lanes(const tc_cpu_args *args, packet *p) {
  vf none = v_set(0), inverse = v_set(args->rays.inverse_step), steps = p->length * inverse;
  vf behind = p->start - v_set(v_least(v_select(p->live, p->start, v_set(1e30f))));
  vf delay = v_select(p->live, v_float(v_trunc(v_fma(behind, inverse, v_set(0.5f)))), none);
  if (!(v_most(steps + delay) < 1.25f * v_most(steps) + 4)) return;
  p->delay = delay;
  p->most_delay = v_most(delay);
}

/* Sets m->inner and m->n_inner. At inner steps all rays have begun, none has ended, and the bounds of the lanes lie within the
 * volume; of rays with a phase, which lag by at most one step, at the step before, too. At most 10^6 of them: step numbers stay
 * exact as floats. */
V_INLINE void find_inner(const tc_cpu_args *args, variant v, const packet *p, march *m) {
  const vf ends = v_fma(p->length, v_set(args->rays.inverse_step), p->delay);
  float from = p->most_delay, to = v_least(v_min(v_select(p->live, ends, v_set(1e6f)), v_set(1e6f)));
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    const float rise = m->rise[k], inverse = rise ? 1 / rise : 1e12f; /* across the axis: inside at every step, or at none */
    const float at_lo = (0 - m->lo[k]) * inverse, at_hi = (args->grid.last[k] - m->lo[k] - m->width[k]) * inverse;
    const float enters = rise < 0 ? at_hi : at_lo, leaves = rise < 0 ? at_lo : at_hi;
    from = from < enters ? enters : from;
    to = to < leaves ? to : leaves;
  }
  m->inner = 1 + phased(v) + (int)(from < 1e6f ? from : 1e6f);
  m->n_inner = to < (float)m->inner ? 0 : (int)to - m->inner;
}

/* Whether the cells of all lanes may be loaded without clamping at inner steps: no ray misses the volume, and the positions and
 * their bounds are finite (a NaN would satisfy find_inner()). */
V_INLINE bool may_load_unclamped(const packet *p, const march *m) {
  const vf sum = (p->entry[0] + p->dir[0]) + (p->entry[1] + p->dir[1]) + (p->entry[2] + p->dir[2]);
  float bounds = 0;
  for (int k = 0; k < 3; k++) bounds += m->lo[k] + m->rise[k] + m->width[k];
  return fabsf(bounds) < 1e30f && m_count(m_and(p->live, v_lt(v_abs(sum), v_set(1e30f)))) == V_LANES;
}

/* Bounds the lanes' positions (m->lo, m->rise, m->width). Each lane's position is linear in the step, so the minimum
 * over the lanes is concave and lies above the chord from the packet's first step to its last; the maximum lies below
 * its chord. Neighbourhoods serve the march (m->near) if few of its steps are expected not to fit one. */
V_INLINE void bound_lanes(const tc_cpu_args *args, variant v, const packet *p, march *m) {
  vf far = v_set(1e9f);
  float steps = 1 + v_most(v_fma(p->length, v_set(args->rays.inverse_step), p->delay)), parts = 1;
  m->fits = true;
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    vf rise = p->dir[k] * v_set(args->rays.step_mm);
    vf begin = p->entry[k] - p->delay * rise, end = v_fma(rise, v_set(steps), begin);
    float lo = v_least(v_select(p->live, begin, far)), lo_end = v_least(v_select(p->live, end, far));
    float width = v_most(v_select(p->live, begin, v_set(0) - far)) - lo;
    float width_end = v_most(v_select(p->live, end, v_set(0) - far)) - lo_end;
    if (width < width_end) width = width_end;
    const float cells = (float)(k ? 4 : near_width(v.type)) - 1, slack = 0.002f + 4e-6f * args->grid.last[k]; /* rounding */
    if (width > cells - 1) parts *= (width + 1) / cells;
    m->fits = m->fits && width + 2 * slack < cells - 1;
    if (args->grid.last[k] < cells) parts = 1e9f;
    m->lo[k] = lo - slack;
    m->rise[k] = (lo_end - lo) / steps;
    m->width[k] = width + 2 * slack;
  }
  m->near = args->near && v.filter == TC_FILTER_LINEAR && parts <= TC_MOST_NEIGHBOURHOODS;
  m->n_inner = 0, m->next_step = -1;
  const bool by_loads = LOADS_AHEAD && v.filter == TC_FILTER_LINEAR && !v.any_type && may_load_unclamped(p, m);
  if ((m->near && !phased(v)) || by_loads) find_inner(args, v, p, m);
}

/* Offset in voxels between a ray's position and its position `steps` later. */
V_INLINE ptrdiff_t steps_ahead(const tc_cpu_args *args, const packet *p, int steps) {
  float step[3], first[V_LANES];
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    v_store(first, p->dir[k]);
    step[k] = first[V_LANES / 2] * args->rays.step_mm * (float)steps;
  }
  return (ptrdiff_t)(int)step[0] + (ptrdiff_t)(int)step[1] * args->grid.row + (ptrdiff_t)(int)step[2] * args->grid.slice;
}

/* Prepares a march. may_level: lanes may wait, so that step i of the packet is not sample i of every ray. */
V_INLINE march start_march(const tc_cpu_args *args, variant v, packet *p, bool may_level) {
  march m = {.near = false};
  if (v.filter != TC_FILTER_LINEAR || !m_any(p->live)) return m;
  m.ahead = steps_ahead(args, p, PREFETCH_STEPS);
  if (!LOADS_AHEAD && !args->near) return m;
  if (!LOADS_AHEAD && may_level) level_lanes(args, p); /* only neighbourhoods need it */
  bound_lanes(args, v, p, &m);
  if (!LOADS_AHEAD && !m.near) p->delay = v_set(0), p->most_delay = 0;
  return m;
}

/* Number of inner steps from step i on, before `end`; 0 or less if step i is not one. */
V_INLINE int inner_steps(const march *m, int i, int end) {
  const int last = m->inner + m->n_inner;
  return i < m->inner ? 0 : (last < end ? last : end) - i;
}

V_INLINE inner_cells inner_cells_at(const tc_cpu_args *args, const packet *p, vf t) {
  inner_cells c;
  vi cell[3];
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    const vf q = v_fma(t, p->dir[k], p->entry[k]);
    cell[k] = v_trunc(q);
    c.f[k] = q - v_float(cell[k]);
  }
  c.off = cell_offset(args, cell);
  return c;
}

/* The voxel value at positions f in the lanes' cells. Prefetches what the rays load PREFETCH_STEPS later. */
V_INLINE vf load_cells(const tc_cpu_args *args, variant v, const march *m, const v_places *at, const vf f[3], vf *gradient) {
  v_prefetch((const void *)((uintptr_t)args->grid.voxels + (uintptr_t)(m->ahead * voxel_bytes(v.type))), at, voxel_bytes(v.type));
  return sample_cells(args, v.type, at, f, gradient);
}

/* The voxel value at inner step i, at t mm, by loads. Finds the cells of step i + 1, too; the caller loads them only if step i + 1
 * is an inner step. */
V_INLINE vf load_inner(const tc_cpu_args *args, variant v, const packet *p, march *m, int i, vf t, vf *gradient) {
  const inner_cells c = m->next_step == i ? m->next : inner_cells_at(args, p, t);
  const v_places at = v_place(c.off);
  m->next = inner_cells_at(args, p, sample_mm(args, v, p, i + 1)), m->next_step = i + 1;
  return load_cells(args, v, m, &at, c.f, gradient);
}

#ifdef V_NEAR
V_INLINE void prefetch_rows(const tc_cpu_args *args, int type, ptrdiff_t first) {
  const ptrdiff_t row = args->grid.row, slice = args->grid.slice;
  const char *p = (const char *)args->grid.voxels + first * voxel_bytes(type);
#pragma GCC unroll 16
  for (int k = 0; k < 16; k++) __builtin_prefetch(p + ((k >> 2) * slice + (k & 3) * row) * voxel_bytes(type));
}

/* The lowest cell of the neighbourhood at step i, which may lie between two steps. Returns its offset in voxels. */
V_INLINE ptrdiff_t near_first(const tc_cpu_args *args, int type, const march *m, float i, int least[3]) {
  const ptrdiff_t along[3] = {1, args->grid.row, args->grid.slice};
  ptrdiff_t first = 0;
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    int base = (int)(m->lo[k] + i * m->rise[k]), most = args->grid.cell_last[k] + 2 - (k ? 4 : near_width(type));
    base = base < most ? base : most;
    least[k] = base > 0 ? base : 0;
    first += least[k] * along[k];
  }
  return first;
}

/* The lanes' cells in the neighbourhood that begins at cell `least`, at an inner step, and the positions in them. Returns
 * whether the cells of all lanes in `needs` fit. */
V_INLINE bool inner_places(const tc_cpu_args *args, int type, const packet *p, const march *m, vf t, vm needs,
                           const int least[3], vi *at, vf f[3]) {
  const float row = (float)near_width(type), slice = 4 * row;
  vf whole[3];
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    const vf q = v_fma(t, p->dir[k], p->entry[k]);
    whole[k] = v_whole(q);
    f[k] = q - whole[k];
  }
  const vf origin = v_set((float)least[0] + row * (float)least[1] + slice * (float)least[2]);
  *at = v_trunc(v_fma(whole[2], v_set(slice), v_fma(whole[1], v_set(row), whole[0] - origin)));
  if (m->fits) return true;
  const vf y = whole[1] - v_set((float)least[1]), z = whole[2] - v_set((float)least[2]);
  const vm fit = m_and(v_le(v_max(y, z), v_set(2)), v_le(whole[0], v_set((float)least[0] + row - 2)));
  return !m_any(m_andnot(needs, fit));
}

/* The corners of the lanes' cells at step i, and the positions in them. needs: lanes whose sample will be used; the others
 * need not fit. inner: step i is known to be an inner step. middle: t is half a step further. */
V_INLINE corners march_near(const tc_cpu_args *args, int type, const packet *p, const march *m, int i, bool middle, vf t,
                            vm needs, bool inner, vf f[3]) {
  int least[3];
  vi at;
  bool fit;
  const ptrdiff_t first = near_first(args, type, m, (float)i + (middle ? 0.5f : 0), least);
  if (!middle) prefetch_rows(args, type, first + m->ahead);
  if (inner || __builtin_expect(inner_steps(m, i, i + 1 + middle) > middle, 1)) {
    fit = inner_places(args, type, p, m, t, needs, least, &at, f);
  } else {
    const spot s = spot_at(args, p, t);
    for (int k = 0; k < 3; k++) f[k] = s.f[k];
    fit = !m_any(m_andnot(needs, near_places(type, least, s.cell, &at)));
  }
  if (__builtin_expect(!fit, 0)) return call_corners(args, type, cell_offset(args, spot_at(args, p, t).cell));
  return near_corners(args, type, first, at);
}

#endif

/* march_voxel() at an inner step, without a test of that. */
V_INLINE vf inner_voxel(const tc_cpu_args *args, variant v, const packet *p, march *m, int i, vf t, vm needs) {
#ifdef V_NEAR
  vf f[3];
  const corners c = march_near(args, v.type, p, m, i, false, t, needs, true, f);
  return interpolate(v.type, &c, f, NULL);
#else
  (void)needs;
  return load_inner(args, v, p, m, i, t, NULL);
#endif
}

/* The voxel value at t mm along the rays, at step i of the march. needs: the lanes whose sample will be used. */
V_INLINE vf march_voxel(const tc_cpu_args *args, variant v, const packet *p, march *m, int i, vf t, vm needs,
                        vf *gradient) {
  if (v.filter != TC_FILTER_LINEAR) return sample_field(args, v, p, t, gradient);
#ifdef V_NEAR
  if (m->near) {
    vf f[3];
    const corners c = march_near(args, v.type, p, m, i, false, t, needs, false, f);
    return interpolate(v.type, &c, f, gradient);
  }
#endif
  if (v.any_type) return sample_field(args, v, p, t, gradient);
  if (LOADS_AHEAD && inner_steps(m, i, i + 1) > 0) return load_inner(args, v, p, m, i, t, gradient);
  const spot s = spot_at(args, p, t);
  const v_places at = v_place(cell_offset(args, s.cell));
  return load_cells(args, v, m, &at, s.f, gradient);
}

/* march_voxel() converted to a node of the table. */
V_INLINE vf march_node(const tc_cpu_args *args, variant v, const packet *p, march *m, int i, vf t, vm needs,
                       vf *gradient) {
  return node_of(args, march_voxel(args, v, p, m, i, t, needs, gradient));
}

/* The node at t mm along the rays, in the middle between steps i and i + 1. */
V_INLINE vf march_middle(const tc_cpu_args *args, variant v, const packet *p, const march *m, int i, vf t, vm needs) {
#ifdef V_NEAR
  if (m->near && v.filter == TC_FILTER_LINEAR) {
    vf f[3];
    const corners c = march_near(args, v.type, p, m, i, true, t, needs, false, f);
    return node_of(args, interpolate(v.type, &c, f, NULL));
  }
#endif
  if (LOADS_AHEAD && inner_steps(m, i, i + 2) > 1) {
    const inner_cells c = inner_cells_at(args, p, t);
    const v_places at = v_place(c.off);
    return node_of(args, sample_cells(args, v.type, &at, c.f, NULL));
  }
  return sample_node(args, v, p, t, NULL);
}

/* Prefetches what the first steps of a run read, from step `first` on: march_voxel() prefetches PREFETCH_STEPS ahead. */
V_INLINE void prefetch_run(const tc_cpu_args *args, variant v, const march *m, int first, int end) {
#ifdef V_NEAR
  int least[3];
  if (!m->near) return;
  if (end > first + PREFETCH_STEPS) end = first + PREFETCH_STEPS;
  for (int i = first; i <= end; i += 3) prefetch_rows(args, v.type, near_first(args, v.type, m, (float)i, least));
#endif
}
