/* The tricubic B-spline filter. One function per voxel type, called and not inlined, because few pictures use it.
 *
 * Along one axis, with f in 0..1 between taps 1 and 2, the weights of taps 0 to 3 are (1-f)^3/6, 2/3 - f^2 (1 - f/2),
 * 2/3 - (1-f)^2 (1+f)/2 and f^3/6. The sum is computed as two lerps of neighbours and a lerp of the results, which is
 * exact for equal taps and stays within their range. Taps beyond a face repeat the face's voxel. */

/* The four voxels along an axis around a position. */
typedef struct taps {
  vi at[4];       /* their indices, clamped to the volume */
  vm first, last; /* at the first or last face: taps 0 and 1, or 2 and 3, are the same voxel */
  vf f;           /* position between taps 1 and 2 */
} taps;

V_INLINE taps taps_at(const tc_cpu_args *args, int k, vf q) {
  taps t;
  vf cell = v_float(v_mini(v_trunc(q), v_seti(args->grid.cell_last[k]))), end = v_set(args->grid.last[k]);
  t.f = q - cell;
  t.at[0] = v_trunc(v_max(cell - v_set(1), v_set(0)));
  t.at[1] = v_trunc(cell);
  t.at[2] = v_trunc(v_min(cell + v_set(1), end));
  t.at[3] = v_trunc(v_min(cell + v_set(2), end));
  t.first = v_lt(cell, v_set(1));
  t.last = v_lt(end, cell + v_set(2));
  return t;
}

/* The four voxels of the row at `off`. */
V_INLINE void fetch_row(const tc_cpu_args *args, int type, const taps *x, vi off, vf t[4]) {
  fetch_pair(type, args->grid.voxels, v_addi(off, x->at[0]), &t[0], &t[1]);
  fetch_pair(type, args->grid.voxels, v_addi(off, x->at[2]), &t[2], &t[3]);
  t[1] = v_select(x->first, t[0], t[1]);
  t[3] = v_select(x->last, t[2], t[3]);
}

/* Whether no lane has a tap beyond a face: then all taps lie at fixed distances from the lanes' cells. */
V_INLINE bool within_faces(const taps t[3]) {
  vm beyond = m_or(t[0].first, t[0].last);
  for (int k = 1; k < 3; k++) beyond = m_or(beyond, m_or(t[k].first, t[k].last));
  return !m_any(beyond);
}

/* Offsets of taps 1, 1, 1. */
V_INLINE v_places place_cells(const tc_cpu_args *args, const taps t[3]) {
  return v_place(cell_offset(args, (vi[]){t[0].at[1], t[1].at[1], t[2].at[1]}));
}

/* fetch_row() within faces. cells: of place_cells(); further: voxels from there to tap 1 of the row. */
V_INLINE void load_row(const tc_cpu_args *args, int type, const v_places *cells, ptrdiff_t further, vf t[4]) {
  const char *const row = (const char *)args->grid.voxels + (further - 1) * voxel_bytes(type);
#ifdef V_TAPS
  switch (VOXELS(type)) { /* a constant after inlining */
  case TC_U8: v_row_u8(row, cells, t); return;
  case TC_I8: v_row_i8(row, cells, t); return;
  case TC_U16: v_row_u16(row, cells, t); return;
  case TC_I16: v_row_i16(row, cells, t); return;
  default: break;
  }
#endif
  load_pair(type, row, cells, &t[0], &t[1]);
  load_pair(type, row + 2 * voxel_bytes(type), cells, &t[2], &t[3]);
}

typedef struct cubic_weights {
  vf near, far, share; /* lerp weights: tap 0 to 1, tap 2 to 3, and between the two results */
  vf rise[3];          /* weights of the differences of neighbouring taps in the derivative */
} cubic_weights;

V_INLINE cubic_weights weigh(vf f) {
  cubic_weights w;
  vf h = v_set(1) - f, third = v_set(2.0f / 3);
  vf w1 = v_fnma(f * f, v_fnma(v_set(0.5f), f, v_set(1)), third), w3 = f * f * f * v_set(1.0f / 6);
  w.share = v_fnma(h * h, v_fnma(v_set(0.5f), h, v_set(1)), third) + w3;
  w.near = w1 / (v_set(1) - w.share);
  w.far = w3 / w.share;
  w.rise[0] = v_set(0.5f) * h * h;
  w.rise[2] = v_set(0.5f) * f * f;
  w.rise[1] = v_set(1) - w.rise[0] - w.rise[2];
  return w;
}

V_INLINE vf mean4(const cubic_weights *w, const vf t[4]) {
  vf low = v_fma(w->near, t[1] - t[0], t[0]), high = v_fma(w->far, t[3] - t[2], t[2]);
  return v_fma(w->share, high - low, low);
}

V_INLINE vf rise4(const cubic_weights *w, const vf t[4]) {
  return v_fma(w->rise[2], t[3] - t[2], v_fma(w->rise[1], t[2] - t[1], w->rise[0] * (t[1] - t[0])));
}

/* gradient, unless NULL: the derivative over index coordinates. */
V_INLINE vf cubic(const tc_cpu_args *args, int type, const vf q[3], vf *gradient) {
  taps t[3];
  cubic_weights w[3];
  vf value[4], along_x[4], along_y[4];
  for (int k = 0; k < 3; k++) {
    t[k] = taps_at(args, k, q[k]);
    w[k] = weigh(t[k].f);
  }
  const bool within = within_faces(t);
  const v_places cells = place_cells(args, t);
  for (int k = 0; k < 4; k++) {
    vf row[4], slope[4];
    for (int j = 0; j < 4; j++) {
      vf voxels[4];
      if (within)
        load_row(args, type, &cells, (j - 1) * (ptrdiff_t)args->grid.row + (k - 1) * (ptrdiff_t)args->grid.slice, voxels);
      else
        fetch_row(args, type, &t[0],
                  v_addi(v_muli(t[1].at[j], v_seti(args->grid.row)), v_muli(t[2].at[k], v_seti(args->grid.slice))),
                  voxels);
      row[j] = mean4(&w[0], voxels);
      if (gradient) slope[j] = rise4(&w[0], voxels);
    }
    value[k] = mean4(&w[1], row);
    if (gradient) along_x[k] = mean4(&w[1], slope), along_y[k] = rise4(&w[1], row);
  }
  if (gradient) {
    gradient[0] = mean4(&w[2], along_x);
    gradient[1] = mean4(&w[2], along_y);
    gradient[2] = rise4(&w[2], value);
  }
  return mean4(&w[2], value);
}

#define CUBIC(name, type)                                                                                            \
  static __attribute__((noinline)) vf cubic_##name(const tc_cpu_args *args, const vf q[3], vf *gradient) {              \
    return cubic(args, type, q, gradient);                                                                              \
  }
CUBIC(u8, TC_U8)
CUBIC(i8, TC_I8)
CUBIC(u16, TC_U16)
CUBIC(i16, TC_I16)
CUBIC(f32, TC_F32)

/* Positions at t mm along rays, clamped to the volume. entry, dir: as in packet. */
V_INLINE void place_at(const tc_cpu_args *args, const vf entry[3], const vf dir[3], vf t, vf q[3]) {
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) q[k] = v_min(v_max(v_fma(t, dir[k], entry[k]), v_set(0)), v_set(args->grid.last[k]));
}

V_INLINE vf sample_cubic(const tc_cpu_args *args, variant v, const packet *p, vf t, vf *gradient) {
  vf q[3];
  place_at(args, p->entry, p->dir, t, q);
  switch (VOXELS(v.type)) { /* a constant after inlining */
  case TC_U8: return cubic_u8(args, q, gradient);
  case TC_I8: return cubic_i8(args, q, gradient);
  case TC_U16: return cubic_u16(args, q, gradient);
  case TC_I16: return cubic_i16(args, q, gradient);
  default: return cubic_f32(args, q, gradient);
  }
}
