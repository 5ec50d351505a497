/* Gradients in index coordinates for shading: central differences, and the derivative of the cubic B-spline. The gradient
 * of the trilinear cell comes with the sample (field_tmpl.h). One function per voxel type, called and not inlined. */

/* Central differences between the voxels on either side, twice the derivative, interpolated along the edges of a cell that are
 * parallel to x: [y, z] as in corners. */
typedef struct slopes {
  vf along[3][4];
} slopes;

V_INLINE void interpolate_slopes(const slopes *s, const vf f[3], vf gradient[3]) {
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    const vf *x = s->along[k];
    vf low = v_fma(f[1], x[1] - x[0], x[0]), high = v_fma(f[1], x[3] - x[2], x[2]);
    gradient[k] = v_fma(f[2], high - low, low);
  }
}

/* The position along x for interpolating slopes. Those of integers use multiples of 1 / V_SLOPE_SHARES, so that
 * neighbourhoods can interpolate in integers to the same bits. */
V_INLINE vf slope_position(int type, vf f) {
  if (VOXELS(type) == TC_F32) return f;
  return v_float(v_trunc(f * v_set(V_SLOPE_SHARES))) * v_set(1.0f / V_SLOPE_SHARES);
}

#ifdef V_TAPS
V_INLINE vi load_tap_pair(int type, const char *voxels, const v_places *at) {
  switch (VOXELS(type)) { /* a constant after inlining */
  case TC_U8: return v_tap_pair_u8(voxels, at);
  case TC_I8: return v_tap_pair_i8(voxels, at);
  case TC_U16: return v_tap_pair_u16(voxels, at);
  default: return v_tap_pair_i16(voxels, at);
  }
}

V_INLINE v_taps load_taps(int type, const char *voxels, const v_places *at) {
  switch (VOXELS(type)) {
  case TC_U8: return v_taps_u8(voxels, at);
  case TC_I8: return v_taps_i8(voxels, at);
  case TC_U16: return v_taps_u16(voxels, at);
  default: return v_taps_i16(voxels, at);
  }
}

/* Whether the rows of four voxels around the lanes in `needs` lie within the volume. */
V_INLINE bool within_rows(const tc_cpu_args *args, int type, const vf q[3], vm needs) {
  if (VOXELS(type) == TC_F32) return false;
  const vm beyond = m_or(v_lt(q[0], v_set(1)), v_le(v_set(args->grid.last[0] - 1), q[0]));
  return args->grid.cell_last[0] > 1 && !m_any(m_and(needs, beyond));
}

/* First voxels of the lanes' pairs along x: lanes that are not needed may be at a face, but their rows must lie in memory. */
V_INLINE vi first_in_rows(const tc_cpu_args *args, vf cell) {
  return v_trunc(v_min(v_max(cell, v_set(1)), v_set((float)(args->grid.cell_last[0] - 1))));
}

/* The lanes' cells, and the positions in them, where no lane is at a face along y or z. */
typedef struct inner_rows {
  v_places cells;
  vf f[3];
} inner_rows;

/* False: a lane is at a face along y or z, or its position is not a number; or within_rows() is false. */
V_INLINE bool find_inner_rows(const tc_cpu_args *args, int type, const vf q[3], vm needs, inner_rows *to) {
  if (!within_rows(args, type, q, needs)) return false;
  const vf least = v_min(q[1], q[2]), room = v_min(v_set(args->grid.last[1]) - q[1], v_set(args->grid.last[2]) - q[2]);
  if (m_count(v_lt(v_set(1), v_min(least, room))) != V_LANES) return false;
  vi cell[3];
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    cell[k] = v_trunc(q[k]);
    const vf whole = v_float(cell[k]);
    to->f[k] = q[k] - whole;
    if (k == 0) cell[0] = first_in_rows(args, whole);
  }
  to->cells = v_place(cell_offset(args, cell));
  return true;
}

/* Twice the gradients of integers, in integers, to the same bits as load_central(). t: the taps, if a lane is at a face along y or z,
 * and then rows->cells is not read; else NULL. */
V_INLINE void difference_rows(const tc_cpu_args *args, int type, const inner_rows *rows, const taps *t, vf gradient[3]) {
  const ptrdiff_t bytes = voxel_bytes(type);
  const char *const voxels = args->grid.voxels;
  vi across[4][4]; /* [z][y]: interpolated along x */
  slopes s;
  const vi upper = v_trunc(rows->f[0] * v_set(V_SLOPE_SHARES));
  const vi weights = v_ori(v_subi(v_seti(V_SLOPE_SHARES), upper), v_shl(upper, 16));
#pragma GCC unroll 4
  for (int z = 0; z < 4; z++)
#pragma GCC unroll 4
    for (int y = 0; y < 4; y++) {
      const bool near_y = y == 1 || y == 2, near_z = z == 1 || z == 2;
      if (!near_y && !near_z) continue;
      const ptrdiff_t further = (y - 1) * (ptrdiff_t)args->grid.row + (z - 1) * (ptrdiff_t)args->grid.slice;
      const v_places at = t ? v_place(cell_offset(args, (vi[]){t[0].at[1], t[1].at[y], t[2].at[z]})) : rows->cells;
      const char *const row = voxels + (t ? 0 : further * bytes);
      if (near_y && near_z) {
        const v_taps four = load_taps(type, row - bytes, &at);
        across[z][y] = v_weigh(four.pair[1], weights);
        s.along[0][y - 1 + 2 * (z - 1)] = v_float(v_subi(v_weigh(four.pair[2], weights), v_weigh(four.pair[0], weights)));
      } else {
        across[z][y] = v_weigh(load_tap_pair(type, row, &at), weights);
      }
    }
#pragma GCC unroll 4
  for (int i = 0; i < 4; i++) {
    const int y = 1 + (i & 1), z = 1 + (i >> 1);
    s.along[1][i] = v_float(v_subi(across[z][y + 1], across[z][y - 1]));
    s.along[2][i] = v_float(v_subi(across[z + 1][y], across[z - 1][y]));
    if (t) { /* one-sided differences count twice */
      s.along[1][i] = s.along[1][i] * v_select(y == 1 ? t[1].first : t[1].last, v_set(2), v_set(1));
      s.along[2][i] = s.along[2][i] * v_select(z == 1 ? t[2].first : t[2].last, v_set(2), v_set(1));
    }
  }
  interpolate_slopes(&s, rows->f, gradient);
  for (int k = 0; k < 3; k++) gradient[k] = gradient[k] * v_set(1.0f / V_SLOPE_SHARES);
}

/* difference_rows() if a lane is at a face along y or z, and within_rows() is true. */
V_INLINE void load_central_integers(const tc_cpu_args *args, int type, const vf q[3], vf gradient[3]) {
  inner_rows rows;
  taps t[3];
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) t[k] = taps_at(args, k, q[k]), rows.f[k] = t[k].f;
  t[0].at[1] = first_in_rows(args, v_float(t[0].at[1]));
  difference_rows(args, type, &rows, t, gradient);
}
#endif

V_INLINE void load_central(const tc_cpu_args *args, int type, const vf q[3], vf gradient[3]) {
  taps t[3];
  vf f[3], twice[3][2], v[4][4][4]; /* [z][y][x]; one-sided differences on the volume's faces count twice */
  slopes s;
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    t[k] = taps_at(args, k, q[k]);
    f[k] = t[k].f;
    twice[k][0] = v_select(t[k].first, v_set(2), v_set(1));
    twice[k][1] = v_select(t[k].last, v_set(2), v_set(1));
  }
  const bool within = within_faces(t);
  const v_places cells = place_cells(args, t);
#pragma GCC unroll 4
  for (int z = 0; z < 4; z++)
#pragma GCC unroll 4
    for (int y = 0; y < 4; y++) {
      const bool near_y = y == 1 || y == 2, near_z = z == 1 || z == 2;
      if (!near_y && !near_z) continue;
      const ptrdiff_t further = (y - 1) * (ptrdiff_t)args->grid.row + (z - 1) * (ptrdiff_t)args->grid.slice;
      const vi off = v_addi(v_muli(t[1].at[y], v_seti(args->grid.row)), v_muli(t[2].at[z], v_seti(args->grid.slice)));
      if (near_y && near_z) {
        if (within) load_row(args, type, &cells, further, v[z][y]);
        else fetch_row(args, type, &t[0], off, v[z][y]);
      } else if (within) {
        load_pair(type, (const char *)args->grid.voxels + further * voxel_bytes(type), &cells, &v[z][y][1], &v[z][y][2]);
      } else {
        fetch_pair(type, args->grid.voxels, v_addi(off, t[0].at[1]), &v[z][y][1], &v[z][y][2]);
      }
    }
  const vf x = slope_position(type, f[0]);
#pragma GCC unroll 4
  for (int i = 0; i < 4; i++) {
    const int y = 1 + (i & 1), z = 1 + (i >> 1);
    const vf slope[3][2] = {
        {(v[z][y][2] - v[z][y][0]) * twice[0][0], (v[z][y][3] - v[z][y][1]) * twice[0][1]},
        {(v[z][y + 1][1] - v[z][y - 1][1]) * twice[1][y - 1], (v[z][y + 1][2] - v[z][y - 1][2]) * twice[1][y - 1]},
        {(v[z + 1][y][1] - v[z - 1][y][1]) * twice[2][z - 1], (v[z + 1][y][2] - v[z - 1][y][2]) * twice[2][z - 1]},
    };
#pragma GCC unroll 3
    for (int k = 0; k < 3; k++) s.along[k][i] = v_fma(x, slope[k][1] - slope[k][0], slope[k][0]);
  }
  interpolate_slopes(&s, f, gradient);
}

#ifdef V_NEAR
/* Whether neighbourhoods hold the slopes of the volume's voxels. */
V_INLINE bool has_slopes(const tc_cpu_args *args, int type) { return VOXELS(type) == TC_F32 ? args->near : args->near_slopes; }

V_INLINE int slope_cells(int type, int k) { return k || type == TC_F32 ? 3 : 5; }

/* The lowest cell of the smallest neighbourhood for lanes from about `least` on. Returns its offset in voxels; negative: the
 * volume is too small. */
V_INLINE ptrdiff_t first_slopes(const tc_cpu_args *args, int type, const float least[3], int base[3]) {
  const ptrdiff_t along[3] = {1, args->grid.row, args->grid.slice};
  ptrdiff_t first = 0;
  bool inside = true;
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    const int most = args->grid.cell_last[k] - slope_cells(type, k);
    base[k] = (int)least[k];
    base[k] = base[k] < 1 ? 1 : base[k];
    base[k] = base[k] < most ? base[k] : most;
    inside &= base[k] >= 1;
    first += base[k] * along[k];
  }
  return inside ? first : -1;
}

#define NEAR_SLOPES(name, voxel)                                                                                      \
  V_INLINE void near_slopes_##name(const tc_cpu_args *args, ptrdiff_t first, vi at, vf f, int rows, int slices,       \
                                   slopes *s) {                                                                       \
    const v_slopes_##name n = v_slopes_load_##name((const voxel *)args->grid.voxels + first, args->grid.row,          \
                                                   args->grid.slice, rows, slices);                                   \
    _Pragma("GCC unroll 4") for (int i = 0; i < 4; i++)                                                               \
      _Pragma("GCC unroll 3") for (int k = 0; k < 3; k++)                                                             \
        s->along[k][i] = v_slope_##name(&n, k, at, i & 1, i >> 1, f);                                                 \
  }
SIMD_VOXELS(NEAR_SLOPES)

/* Twice the gradient, at f within the cells at elements `at` of the neighbourhood whose lowest cell is `first`; to the same
 * bits as by loads. */
V_INLINE void interpolate_near(const tc_cpu_args *args, int type, ptrdiff_t first, vi at, const vf f[3], int rows,
                               int slices, vf gradient[3]) {
  slopes s;
  switch (VOXELS(type)) { /* a constant after inlining */
  case TC_U8: near_slopes_u8(args, first, at, f[0], rows, slices, &s); break;
  case TC_I8: near_slopes_i8(args, first, at, f[0], rows, slices, &s); break;
  case TC_U16: near_slopes_u16(args, first, at, f[0], rows, slices, &s); break;
  case TC_I16: near_slopes_i16(args, first, at, f[0], rows, slices, &s); break;
  default: near_slopes_f32(args, first, at, f[0], rows, slices, &s); break;
  }
  interpolate_slopes(&s, f, gradient);
  if (VOXELS(type) != TC_F32)
    for (int k = 0; k < 3; k++) gradient[k] = gradient[k] * v_set(1.0f / V_SLOPE_SHARES);
}

/* Twice the gradient at q of the lanes in `needs`, from the smallest neighbourhood that holds their cells and begins at cell
 * `base`, at offset `first`. Returns false if no neighbourhood holds them. */
V_INLINE bool near_central(const tc_cpu_args *args, int type, const int base[3], ptrdiff_t first, const vf q[3], vm needs,
                           vf gradient[3]) {
  vi rest[3];
  vf f[3];
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) { /* not clamped: positions beyond the volume do not fit */
    const vi cell = v_trunc(q[k]);
    f[k] = q[k] - v_float(cell);
    rest[k] = v_subi(cell, v_seti(base[k]));
  }
  const vi at = v_addi(rest[0], v_addi(v_shl(rest[1], type == TC_F32 ? 2 : 3), v_shl(rest[2], type == TC_F32 ? 4 : 5)));
  const vm fits_x = v_leu(rest[0], v_seti(slope_cells(type, 0) - 1));
  const vi further = v_maxu(rest[1], rest[2]);
  if (__builtin_expect(!m_any(m_andnot(needs, m_and(fits_x, v_leu(further, v_seti(2))))), 1)) {
    interpolate_near(args, type, first, at, f, 4, 4, gradient);
    return true;
  }
  if (type == TC_F32 || m_any(m_andnot(needs, m_and(fits_x, v_leu(further, v_seti(3)))))) return false;
  if (base[2] + 4 > args->grid.cell_last[2]) return false;
  if (!m_any(m_andnot(needs, v_leu(rest[1], v_seti(2))))) interpolate_near(args, type, first, at, f, 4, 5, gradient);
  else if (base[1] + 4 > args->grid.cell_last[1]) return false;
  else interpolate_near(args, type, first, at, f, 5, 5, gradient);
  return true;
}

/* The least position along each axis of the lanes in `needs`. */
V_INLINE void least_of(const vf q[3], vm needs, float least[3]) {
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) least[k] = v_least(v_select(needs, q[k], v_set(1e9f)));
}
#endif

/* Twice the gradient at q: central differences at the eight voxels around (one-sided on the volume's faces), interpolated
 * trilinearly: continuous across cells. needs: the lanes whose gradient will be used. */
#ifdef V_TAPS
#define CENTRAL(name, type)                                                                                           \
  V_ONCE void load_general_##name(const tc_cpu_args *args, const vf q[3], vf gradient[3]) {                           \
    load_central(args, TYPE_##name, q, gradient);                                                                     \
  }                                                                                                                   \
  V_ONCE void load_at_faces_##name(const tc_cpu_args *args, const vf q[3], vf gradient[3]) {                          \
    load_central_integers(args, TYPE_##name, q, gradient);                                                            \
  }                                                                                                                   \
  V_ONCE void central_##name(const tc_cpu_args *args, const vf q[3], vm needs, vf gradient[3]) {                      \
    inner_rows rows;                                                                                                  \
    if (find_inner_rows(args, TYPE_##name, q, needs, &rows)) difference_rows(args, TYPE_##name, &rows, NULL, gradient); \
    else if (within_rows(args, TYPE_##name, q, needs)) load_at_faces_##name(args, q, gradient);                       \
    else load_general_##name(args, q, gradient);                                                                      \
  }
#else
#define CENTRAL(name, type)                                                                                           \
  V_ONCE void central_##name(const tc_cpu_args *args, const vf q[3], vm needs, vf gradient[3]) {                      \
    (void)needs;                                                                                                      \
    load_central(args, TYPE_##name, q, gradient);                                                                     \
  }
#endif
SIMD_VOXELS(CENTRAL)

V_INLINE void central_of(const tc_cpu_args *args, int type, const vf q[3], vm needs, vf gradient[3]) {
  switch (VOXELS(type)) { /* a constant after inlining */
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
  place_at(args, p->entry, p->dir, t, q);
  central_of(args, v.type, q, needs, gradient);
  for (int k = 0; k < 3; k++) gradient[k] = gradient[k] * v_set(0.5f);
}
