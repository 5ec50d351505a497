/* Look-up in a pre-integration table with subtables, and in its rows of depths (classify/preintegration.h).
 *
 * A segment is looked up in the finest window that contains both of its ends. If only one end lies in a finer
 * window, near that window's knots, the segment is cut at the window's edge, and the optical depths of the parts
 * give its opacity. The coarser window resolves that end only to a node, so it could not tell whether a peak lies
 * before or behind the end. */

/* A segment's ends in nodes of a window; the window's entries per row, and the entries before its row k = 0 (0: the
 * table itself). */
typedef struct window { vf front, back, stride, start; } window;

V_INLINE window in_subtable(const tc_cpu_subtable *subtable, vf front, vf back) {
  vf lo = v_set(subtable->lo), scale = v_set(subtable->scale);
  return (window){(front - lo) * scale, (back - lo) * scale, v_set(TC_SUBTABLE_NODES + 2), v_set(subtable->start)};
}
V_INLINE vm contains(vf at, float rim) {
  return m_and(v_le(v_set(rim), at), v_le(at, v_set(TC_SUBTABLE_NODES - 1 - rim)));
}

/* The finest window that contains both ends. *cut: a finer one has just one of them, near its knots. */
V_INLINE window enter_window(const tc_cpu_args *args, vf front, vf back, vm *cut) {
  window w = {front, back, v_set(args->table_stride), v_set(0)};
  *cut = v_lt(v_set(1), v_set(0));
  for (int z = 0; z < args->n_subtables; z++) {
    window fine = in_subtable(&args->subtables[z], front, back);
    vm begins = contains(fine.front, 0), ends = contains(fine.back, 0), inside = m_and(begins, ends);
    float rim = args->subtables[z].rim;
    *cut = m_or(*cut, m_andnot(m_or(contains(fine.front, rim), contains(fine.back, rim)), inside));
    w.front = v_select(inside, fine.front, w.front);
    w.back = v_select(inside, fine.back, w.back);
    w.stride = v_select(inside, fine.stride, w.stride);
    w.start = v_select(inside, fine.start, w.start);
  }
  return w;
}

V_INLINE vf4 look_up(const tc_cpu_args *args, window w) {
  vf low = v_min(w.front, w.back), diff = w.back - w.front, k = v_abs(diff);
  vf i = v_float(v_trunc(low)), kk = v_float(v_trunc(k));
  vf stride = v_select(v_lt(diff, v_set(0)), v_set(0) - w.stride, w.stride);
  vf row0 = v_fma(kk, stride, i) + w.start;
  return v_bilinear(args->table, v_trunc(row0), v_trunc(row0 + stride), low - i, k - kk);
}

V_INLINE vf4 entry_at(const tc_cpu_args *args, vi at) { return v_bilinear(args->table, at, at, v_set(0), v_set(0)); }

/* Optical depth of a full segment from the row of depths, without cancellation. */
V_INLINE vf depth_in(const tc_cpu_args *args, window w) {
  vf half = v_set(0.5f), one = v_set(1), low = v_min(w.front, w.back), high = v_max(w.front, w.back);
  /* row n + 2, of n + 1 entries in the table and of n + 2 in a subtable; (n + 1) (n + 2) is even: exact up to 2^25 */
  vf row = v_fma(v_select(v_lt(v_set(0), w.start), w.stride, w.stride + one), w.stride, w.start);
  vi i = v_trunc(low), j = v_trunc(high), start = v_trunc(row);
  vf x = low - v_float(i), y = high - v_float(j);
  vf4 first = entry_at(args, v_addi(start, i)), last = entry_at(args, v_addi(start, j));
  vf4 next = entry_at(args, v_addi(v_addi(start, i), v_seti(1)));
  vf within = v_fma(half * (x + y), first.a - first.b, first.b);
  vf rest = half * (one - x) * (v_fma(x, first.a - first.b, first.b) + first.a);
  vf part = half * y * (v_fma(y, last.a - last.b, last.b) + last.b);
  vf whole = (rest + part + ((last.r - next.r) + (last.g - next.g))) / v_max(high - low, v_set(1e-30f));
  return v_select(v_lt(v_float(j) - v_float(i), half), within, whole);
}

/* Cuts off the part inside a subtable from segments with one end there. Returns the optical depth of that part,
 * weighted by its share of `span` nodes; 0 for other segments, which stay whole. */
V_INLINE vf cut_off(const tc_cpu_args *args, const tc_cpu_subtable *subtable, vf span, vf *front, vf *back, vm cut) {
  window w = in_subtable(subtable, *front, *back);
  vm begins = m_and(contains(w.front, 0), cut), ends = m_and(contains(w.back, 0), cut);
  vm nearer = m_andnot(begins, ends), farther = m_andnot(ends, begins);
  if (!m_any(m_or(nearer, farther))) return v_set(0);
  vf top = v_set(TC_SUBTABLE_NODES - 1), inverse = v_set(1 / subtable->scale), lo = v_set(subtable->lo);
  w.front = v_min(v_max(w.front, v_set(0)), top);
  w.back = v_min(v_max(w.back, v_set(0)), top);
  vf exit = v_fma(w.back, inverse, lo), entry = v_fma(w.front, inverse, lo);
  vf length = v_abs(v_select(nearer, exit - *front, *back - entry));
  *front = v_select(nearer, exit, *front);
  *back = v_select(farther, entry, *back);
  return v_select(m_or(nearer, farther), v_min(length / span, v_set(1)) * depth_in(args, w), v_set(0));
}

V_ONCE vf depth_between(const tc_cpu_args *args, vf front, vf back, vm cut) {
  vf span = v_max(v_abs(back - front), v_set(1e-30f)), parts = v_set(0);
  for (int z = args->n_subtables - 1; z >= 0; z--) parts = parts + cut_off(args, &args->subtables[z], span, &front, &back, cut);
  vm again;
  vf depth = depth_in(args, enter_window(args, front, back, &again)), rest = v_abs(back - front) / span;
  return v_select(v_lt(v_set(0), parts), v_fma(rest, depth, parts), depth);
}

/* A cut segment has the opacity of its parts. Its colour is the whole segment's, scaled: between nodes on either side
 * of a peak, the table interpolates between entries with and without the peak, which gives mostly the peak's colour. */
V_INLINE vf4 classify_subtables(const tc_cpu_args *args, vf front, vf back, vm live) {
  vm cut;
  vf4 c = look_up(args, enter_window(args, front, back, &cut));
  cut = m_and(m_and(cut, live), v_lt(v_set(0), c.a));
  if (!m_any(cut)) return c;
  vf alpha = v_select(cut, opacity_of_depth(depth_between(args, front, back, cut)), c.a);
  vf scale = v_select(cut, alpha / v_max(c.a, v_set(1e-30f)), v_set(1));
  return (vf4){c.r * scale, c.g * scale, c.b * scale, alpha};
}
