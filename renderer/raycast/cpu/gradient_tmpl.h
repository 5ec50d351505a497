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

/* The gradient at a position within its cells f from the lines through the cells' voxels. scale: of the differences below
 * and above the cell along each axis, 1/2, or 1 where one-sided. */
V_INLINE void gradient_of_lines(const lines *l, const vf f[3], const vf scale[3][2], vf gradient[3]) {
#define BETWEEN(k, a, b) between(f[k], a, b)
#define RISE(k, t0, t1, t2, t3) BETWEEN(k, ((t2) - (t0)) * scale[k][0], ((t3) - (t1)) * scale[k][1])
  vf low = BETWEEN(1, l->slope[1][1], l->slope[1][2]), high = BETWEEN(1, l->slope[2][1], l->slope[2][2]);
  gradient[0] = BETWEEN(2, low, high);
  low = RISE(1, l->field[1][0], l->field[1][1], l->field[1][2], l->field[1][3]);
  high = RISE(1, l->field[2][0], l->field[2][1], l->field[2][2], l->field[2][3]);
  gradient[1] = BETWEEN(2, low, high);
  low = RISE(2, l->field[0][1], l->field[1][1], l->field[2][1], l->field[3][1]);
  high = RISE(2, l->field[0][2], l->field[1][2], l->field[2][2], l->field[3][2]);
  gradient[2] = BETWEEN(1, low, high);
#undef BETWEEN
#undef RISE
}

V_INLINE void gather_central(const tc_cpu_args *args, int type, const vf q[3], vf gradient[3]) {
  taps t[3];
  vf f[3], scale[3][2];
  lines l;
  for (int k = 0; k < 3; k++) {
    t[k] = taps_at(args, k, q[k]);
    f[k] = t[k].f;
    scale[k][0] = v_select(t[k].first, v_set(1), v_set(0.5f));
    scale[k][1] = v_select(t[k].last, v_set(1), v_set(0.5f));
  }
  gather_lines(args, type, t, scale, &l);
  gradient_of_lines(&l, f, scale, gradient);
}

#ifdef V_NEAR
V_INLINE v_wide wide_at(const tc_cpu_args *args, int type, ptrdiff_t first) {
  const ptrdiff_t row = args->grid.row, slice = args->grid.slice;
  switch (type) { /* a constant after inlining */
  case TC_U8: return v_wide_load_u8((const uint8_t *)args->grid.voxels + first, row, slice);
  case TC_I8: return v_wide_load_i8((const int8_t *)args->grid.voxels + first, row, slice);
  case TC_U16: return v_wide_load_u16((const uint16_t *)args->grid.voxels + first, row, slice);
  default: return v_wide_load_i16((const int16_t *)args->grid.voxels + first, row, slice);
  }
}

/* Where a packet's cells lie in a neighbourhood of 8x6x6 voxels. */
typedef struct wide_place {
  ptrdiff_t first; /* offset of the neighbourhood's first voxel */
  vi at;           /* element numbers of the lanes' cells */
  vf f[3];         /* positions within the cells */
} wide_place;

/* False: the cells of the lanes in `needs` do not fit in one neighbourhood, or are too close to a face of the volume. */
V_INLINE bool find_wide(const tc_cpu_args *args, int type, const vf q[3], vm needs, wide_place *w) {
  const ptrdiff_t along[3] = {1, args->grid.row, args->grid.slice};
  vi rest[3];
  bool inside = type != TC_F32 && args->near;
  w->first = -1;
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    const vi cell = v_trunc(q[k]);
    int base = (int)v_least(v_select(needs, q[k], v_set(1e9f))), most = args->grid.cell_last[k] - (k ? 3 : 5);
    base = base < most ? base : most;
    inside &= base >= 1;
    w->f[k] = q[k] - v_float(cell);
    rest[k] = v_subi(cell, v_seti(base));
    w->first += base * along[k];
  }
  w->at = v_addi(rest[0], v_addi(v_shl(rest[1], 3), v_shl(rest[2], 5)));
  const vm fits = m_and(v_leu(rest[0], v_seti(4)), v_leu(v_maxu(rest[1], rest[2]), v_seti(2)));
  return inside & !m_any(m_andnot(needs, fits));
}

/* The gradient from one neighbourhood in registers, to the same bits as by gathers. */
V_INLINE void near_central(const tc_cpu_args *args, int type, const wide_place *w, vf gradient[3]) {
  const vf half = v_set(0.5f), bias = v_set(bias_of(type));
  const vf halves[3][2] = {{half, half}, {half, half}, {half, half}}, *f = w->f;
  const v_wide n = wide_at(args, type, w->first);
  lines l;
#pragma GCC unroll 4
  for (int k = 0; k < 4; k++) { /* rows (y, z) of the cell */
    const int y = k & 1, z = k >> 1;
    vf x[4];
    v_wide_pair(&n.slice[1 + z], w->at, 8 * y, &x[0], &x[1]);
    v_wide_pair(&n.slice[1 + z], w->at, 8 * y + 2, &x[2], &x[3]);
    l.slope[1 + z][1 + y] = between(f[0], (x[2] - x[0]) * half, (x[3] - x[1]) * half);
    l.field[1 + z][1 + y] = v_fma(f[0], x[2] - x[1], x[1] - bias);
  }
#pragma GCC unroll 4
  for (int k = 0; k < 4; k++) { /* rows beside the cell: taps 0 and 3 along y and along z */
    const int j = k & 1, upper = k >> 1;
    vf a, b;
    v_wide_pair(upper ? &n.above[j] : &n.below[j], w->at, 8 * upper + 1, &a, &b);
    l.field[1 + j][3 * upper] = v_fma(f[0], b - a, a - bias);
    v_wide_pair(&n.slice[3 * upper], w->at, 8 * j + 1, &a, &b);
    l.field[3 * upper][1 + j] = v_fma(f[0], b - a, a - bias);
  }
  gradient_of_lines(&l, f, halves, gradient);
}
#endif

/* Central differences at the eight voxels around q (one-sided on the volume's faces), interpolated trilinearly:
 * continuous across cells. needs: the lanes whose gradient will be used. */
#ifdef V_NEAR
#define CENTRAL(name, type)                                                                                            \
  V_ONCE void gather_central_##name(const tc_cpu_args *args, const vf q[3], vf gradient[3]) {                          \
    gather_central(args, TYPE_##name, q, gradient);                                                                    \
  }                                                                                                                    \
  V_ONCE void central_##name(const tc_cpu_args *args, const vf q[3], vm needs, vf gradient[3]) {                       \
    wide_place w;                                                                                                      \
    if (find_wide(args, TYPE_##name, q, needs, &w)) near_central(args, TYPE_##name, &w, gradient);                     \
    else gather_central_##name(args, q, gradient);                                                                     \
  }
#else
#define CENTRAL(name, type)                                                                                            \
  V_ONCE void central_##name(const tc_cpu_args *args, const vf q[3], vm needs, vf gradient[3]) {                       \
    (void)needs;                                                                                                       \
    gather_central(args, TYPE_##name, q, gradient);                                                                    \
  }
#endif
SIMD_VOXELS(CENTRAL)

V_INLINE void central_of(const tc_cpu_args *args, int type, const vf q[3], vm needs, vf gradient[3]) {
  switch (type) { /* a constant after inlining */
  case TC_U8: central_u8(args, q, needs, gradient); return;
  case TC_I8: central_i8(args, q, needs, gradient); return;
  case TC_U16: central_u16(args, q, needs, gradient); return;
  case TC_I16: central_i16(args, q, needs, gradient); return;
  default: central_f32(args, q, needs, gradient); return;
  }
}

/* The gradient at t mm along the rays: central differences or the cubic's derivative. */
V_INLINE void gradient_at(const tc_cpu_args *args, variant v, const packet *p, vf t, vm needs, vf gradient[3]) {
  vf q[3];
  if (v.gradient == TC_GRADIENT_CUBIC) {
    sample_cubic(args, v, p, t, gradient);
    return;
  }
  place_at(args, p, t, q);
  central_of(args, v.type, q, needs, gradient);
}

/* A classified segment that waits to be shaded by the central gradient at its middle. */
typedef struct unlit {
  vf t;       /* its middle, mm along the rays */
  vm visible; /* the lanes that need a gradient */
  vf4 c;      /* colour and opacity; shade_two() replaces the colour */
  vf weight;  /* of the colour in the rays' sums */
} unlit;

V_INLINE void shade_two(const tc_cpu_args *args, int type, const packet *p, const lighting *l, unlit s[2]) {
  vf q[2][3], gradient[2][3];
  bool near = false;
  for (int k = 0; k < 2; k++) place_at(args, p, s[k].t, q[k]);
#ifdef V_NEAR
  wide_place w[2];
  near = find_wide(args, type, q[0], s[0].visible, &w[0]) & find_wide(args, type, q[1], s[1].visible, &w[1]);
  if (near) {
    near_central(args, type, &w[0], gradient[0]);
    near_central(args, type, &w[1], gradient[1]);
  }
#endif
  for (int k = 0; k < 2 && !near; k++) central_of(args, type, q[k], s[k].visible, gradient[k]);
  vf4 first = shade(&args->shade, l, gradient[0], gradient[0], s[0].c);
  vf4 second = shade(&args->shade, l, gradient[1], gradient[1], s[1].c);
  s[0].c = first, s[1].c = second;
}

#define SHADE_TWO(name, type)                                                                                          \
  V_ONCE void shade_two_##name(const tc_cpu_args *args, const packet *p, const lighting *l, unlit s[2]) {              \
    shade_two(args, TYPE_##name, p, l, s);                                                                             \
  }
SIMD_VOXELS(SHADE_TWO)

/* Shades the n > 0 waiting segments and adds their colours to sum, in order. Segments are shaded in pairs, because one is
 * a chain of dependent operations that leaves the processor idle. */
V_INLINE void shade_waiting(const tc_cpu_args *args, int type, const packet *p, const lighting *l, unlit s[2], int n,
                            vf4 *sum) {
  if (n == 1) s[1] = s[0];
  switch (type) { /* a constant after inlining */
  case TC_U8: shade_two_u8(args, p, l, s); break;
  case TC_I8: shade_two_i8(args, p, l, s); break;
  case TC_U16: shade_two_u16(args, p, l, s); break;
  case TC_I16: shade_two_i16(args, p, l, s); break;
  default: shade_two_f32(args, p, l, s); break;
  }
  for (int k = 0; k < n; k++) {
    sum->r = v_fma(s[k].weight, s[k].c.r, sum->r);
    sum->g = v_fma(s[k].weight, s[k].c.g, sum->g);
    sum->b = v_fma(s[k].weight, s[k].c.b, sum->b);
  }
}
