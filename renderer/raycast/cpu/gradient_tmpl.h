/* Gradients in index coordinates for shading: central differences, and the derivative of the cubic B-spline. The gradient
 * of the trilinear cell comes with the sample (field_tmpl.h). One function per voxel type, called and not inlined. */

/* The 4x4 grid lines along x around a sample, [z][y]: the field interpolated along each line, and the central difference
 * along x on the four lines of the sample's cell. The corners of the 4x4 are not used. */
typedef struct lines {
  vf field[4][4], slope[3][3];
} lines;

V_INLINE vf between(vf f, vf a, vf b) { return v_fma(f, b - a, a); }

V_INLINE void gather_lines(const tc_cpu_args *args, int type, const taps t[3], const vf scale[3][2], lines *l) {
  for (int z = 0; z < 4; z++)
    for (int y = 0; y < 4; y++) {
      bool near_y = y == 1 || y == 2, near_z = z == 1 || z == 2;
      vi off = v_addi(v_muli(t[1].at[y], v_seti(args->grid.row)), v_muli(t[2].at[z], v_seti(args->grid.slice)));
      vf x[4];
      if (near_y && near_z) {
        fetch_row(args, type, &t[0], off, x);
        l->slope[z][y] = between(t[0].f, (x[2] - x[0]) * scale[0][0], (x[3] - x[1]) * scale[0][1]);
      } else if (near_y || near_z) {
        fetch_pair(type, args->grid.voxels, v_addi(off, t[0].at[1]), &x[1], &x[2]);
      } else {
        continue;
      }
      l->field[z][y] = between(t[0].f, x[1], x[2]);
    }
}

#ifdef V_NEAR
/* Finds the lines from register neighbourhoods (neighbourhood_tmpl.h) instead of gathers: six of them, shifted by one
 * voxel to either side along each axis. False: the cells of the lanes that need a gradient do not fit in one
 * neighbourhood, or are too close to a face of the volume. */
V_INLINE bool near_lines(const tc_cpu_args *args, int type, const taps t[3], vm needs, lines *l) {
  const ptrdiff_t along[3] = {1, args->grid.row, args->grid.slice};
  const vf half = v_set(0.5f), bias = v_set(bias_of(type)), f = t[0].f;
  ptrdiff_t first = 0;
  int least[3];
  vi cell[3] = {t[0].at[1], t[1].at[1], t[2].at[1]}, at;
  if (!args->near) return false;
  for (int k = 0; k < 3; k++) {
    int base = (int)v_least(v_select(needs, v_float(cell[k]), v_set(1e9f)));
    int most = args->grid.cell_last[k] + 1 - (k ? 4 : near_width(type));
    base = base < most ? base : most;
    if (base < 1) return false;
    least[k] = base;
    first += base * along[k];
  }
  if (m_any(m_andnot(needs, near_places(type, least, cell, &at)))) return false;
  const corners below = near_corners(args, type, first - 1, at), above = near_corners(args, type, first + 1, at);
#pragma GCC unroll 4
  for (int k = 0; k < 4; k++) {
    vf *slope = &l->slope[1 + (k >> 1)][1 + (k & 1)];
    *slope = between(f, (above.a[k] - below.a[k]) * half, (above.b[k] - below.b[k]) * half);
    l->field[1 + (k >> 1)][1 + (k & 1)] = v_fma(f, above.a[k] - below.b[k], below.b[k] - bias);
  }
#pragma GCC unroll 4
  for (int side = 0; side < 4; side++) { /* taps 0 and 3 along y and along z */
    const bool upper = side & 1, over_z = side & 2;
    const ptrdiff_t shift = along[over_z ? 2 : 1];
    const corners c = near_corners(args, type, upper ? first + shift : first - shift, at);
#pragma GCC unroll 2
    for (int j = 0; j < 2; j++) {
      int k = over_z ? j + 2 * upper : 2 * j + upper, tap = 3 * upper;
      *(over_z ? &l->field[tap][1 + j] : &l->field[1 + j][tap]) = v_fma(f, c.b[k] - c.a[k], c.a[k] - bias);
    }
  }
  return true;
}
#endif

/* Central differences at the eight voxels around q (one-sided on the volume's faces), interpolated trilinearly:
 * continuous across cells. needs: the lanes whose gradient will be used. */
V_INLINE void central(const tc_cpu_args *args, int type, const vf q[3], vm needs, vf gradient[3]) {
  taps t[3];
  vf scale[3][2];
  lines l;
  for (int k = 0; k < 3; k++) {
    t[k] = taps_at(args, k, q[k]);
    scale[k][0] = v_select(t[k].first, v_set(1), v_set(0.5f));
    scale[k][1] = v_select(t[k].last, v_set(1), v_set(0.5f));
  }
#ifdef V_NEAR
  if (!near_lines(args, type, t, needs, &l))
#endif
    gather_lines(args, type, t, scale, &l);
#define BETWEEN(k, a, b) between(t[k].f, a, b)
#define RISE(k, t0, t1, t2, t3) BETWEEN(k, ((t2) - (t0)) * scale[k][0], ((t3) - (t1)) * scale[k][1])
  vf low = BETWEEN(1, l.slope[1][1], l.slope[1][2]), high = BETWEEN(1, l.slope[2][1], l.slope[2][2]);
  gradient[0] = BETWEEN(2, low, high);
  low = RISE(1, l.field[1][0], l.field[1][1], l.field[1][2], l.field[1][3]);
  high = RISE(1, l.field[2][0], l.field[2][1], l.field[2][2], l.field[2][3]);
  gradient[1] = BETWEEN(2, low, high);
  low = RISE(2, l.field[0][1], l.field[1][1], l.field[2][1], l.field[3][1]);
  high = RISE(2, l.field[0][2], l.field[1][2], l.field[2][2], l.field[3][2]);
  gradient[2] = BETWEEN(1, low, high);
#undef BETWEEN
#undef RISE
}

#define CENTRAL(name, type)                                                                                            \
  V_ONCE void central_##name(const tc_cpu_args *args, const vf q[3], vm needs, vf gradient[3]) {                       \
    central(args, type, q, needs, gradient);                                                                           \
  }

CENTRAL(u8, TC_U8)
CENTRAL(i8, TC_I8)
CENTRAL(u16, TC_U16)
CENTRAL(i16, TC_I16)
CENTRAL(f32, TC_F32)

/* The gradient at t mm along the rays: central differences or the cubic's derivative. */
V_INLINE void gradient_at(const tc_cpu_args *args, variant v, const packet *p, vf t, vm needs, vf gradient[3]) {
  vf q[3];
  if (v.gradient == TC_GRADIENT_CUBIC) {
    sample_cubic(args, v, p, t, gradient);
    return;
  }
  place_at(args, p, t, q);
  switch (v.type) { /* a constant after inlining */
  case TC_U8: central_u8(args, q, needs, gradient); return;
  case TC_I8: central_i8(args, q, needs, gradient); return;
  case TC_U16: central_u16(args, q, needs, gradient); return;
  case TC_I16: central_i16(args, q, needs, gradient); return;
  default: central_f32(args, q, needs, gradient); return;
  }
}
