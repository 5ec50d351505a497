/* The tricubic B-spline of the voxels around a place. Part of the template; one function a voxel type, called, so that the
 * kernels of rare keys stay small.
 *
 * Along one axis, with f the place between taps 1 and 2, taps 0 to 3 weigh (1-f)^3/6, 2/3 - f^2 (1 - f/2), 2/3 - (1-f)^2 (1+f)/2
 * and f^3/6. They are summed as means of two, then of the two means, which is exact where all are equal and stays between the
 * least and the greatest. Taps beyond a face are the face's voxel. */

typedef struct cubic_axis {
  vi tap[4];       /* voxels along the axis */
  vm first, last;  /* taps 0 and 1, or 2 and 3, are the same voxel */
  vf near, far;    /* of taps 0 and 1 the share of 1, of 2 and 3 that of 3 */
  vf share;        /* of taps 2 and 3 */
} cubic_axis;

V_INLINE cubic_axis cubic_weights(const tc_cpu_args *g, int k, vf q) {
  cubic_axis a;
  vf cell = v_float(v_mini(v_trunc(q), v_seti(g->cell_last[k]))), end = v_set(g->last[k]);
  vf f = q - cell, h = v_set(1) - f, third = v_set(2.0f / 3), sixth = v_set(1.0f / 6);
  vf w1 = v_fnma(f * f, v_fnma(v_set(0.5f), f, v_set(1)), third), w3 = f * f * f * sixth;
  a.share = v_fnma(h * h, v_fnma(v_set(0.5f), h, v_set(1)), third) + w3;
  a.near = w1 / (v_set(1) - a.share);
  a.far = w3 / a.share;
  a.tap[0] = v_trunc(v_max(cell - v_set(1), v_set(0)));
  a.tap[1] = v_trunc(cell);
  a.tap[2] = v_trunc(v_min(cell + v_set(1), end));
  a.tap[3] = v_trunc(v_min(cell + v_set(2), end));
  a.first = v_lt(cell, v_set(1));
  a.last = v_lt(end, cell + v_set(2));
  return a;
}

V_INLINE vf cubic_mean(const cubic_axis *a, vf t0, vf t1, vf t2, vf t3) {
  vf low = v_fma(a->near, t1 - t0, t0), high = v_fma(a->far, t3 - t2, t2);
  return v_fma(a->share, high - low, low);
}

V_INLINE vf cubic(const tc_cpu_args *g, int type, vf x, vf y, vf z) {
  cubic_axis ax = cubic_weights(g, 0, x), ay = cubic_weights(g, 1, y), az = cubic_weights(g, 2, z);
  vf slice[4];
  for (int k = 0; k < 4; k++) {
    vf row[4];
    for (int j = 0; j < 4; j++) {
      vi off = v_addi(v_muli(ay.tap[j], v_seti(g->row)), v_muli(az.tap[k], v_seti(g->slice)));
      vf t[4];
      fetch_pair(type, g->voxels, v_addi(off, ax.tap[0]), &t[0], &t[1]);
      fetch_pair(type, g->voxels, v_addi(off, ax.tap[2]), &t[2], &t[3]);
      row[j] = cubic_mean(&ax, t[0], v_select(ax.first, t[0], t[1]), t[2], v_select(ax.last, t[2], t[3]));
    }
    slice[k] = cubic_mean(&ay, row[0], row[1], row[2], row[3]);
  }
  return cubic_mean(&az, slice[0], slice[1], slice[2], slice[3]);
}

#define CUBIC(name, type)                                                                                            \
  static __attribute__((noinline)) vf cubic_##name(const tc_cpu_args *g, vf x, vf y, vf z) {                         \
    return cubic(g, type, x, y, z);                                                                                  \
  }
CUBIC(u8, TC_U8)
CUBIC(i8, TC_I8)
CUBIC(u16, TC_U16)
CUBIC(i16, TC_I16)
CUBIC(f32, TC_F32)

V_INLINE vf sample_cubic(const tc_cpu_args *g, variant v, const packet *p, vf t) {
  vf q[3];
  for (int k = 0; k < 3; k++) q[k] = v_min(v_max(v_fma(t, p->dir[k], p->entry[k]), v_set(0)), v_set(g->last[k]));
  switch (v.type) { /* a constant after inlining */
  case TC_U8: return cubic_u8(g, q[0], q[1], q[2]);
  case TC_I8: return cubic_i8(g, q[0], q[1], q[2]);
  case TC_U16: return cubic_u16(g, q[0], q[1], q[2]);
  case TC_I16: return cubic_i16(g, q[0], q[1], q[2]);
  default: return cubic_f32(g, q[0], q[1], q[2]);
  }
}
