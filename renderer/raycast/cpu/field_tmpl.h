/* The field at points of the packet's rays: cells, voxel pairs, trilinear interpolation. */

/* tc_voxel_type by the name that SIMD_VOXELS uses. */
enum { TYPE_u8 = TC_U8, TYPE_i8 = TC_I8, TYPE_u16 = TC_U16, TYPE_i16 = TC_I16, TYPE_f32 = TC_F32 };

/* Of any array: the volume's voxels, labels, table entries. */
V_INLINE void load_pair(int type, const void *voxels, const v_places *at, vf *a, vf *b) {
  switch (type) { /* a constant after inlining, but for labels */
  case TC_U8: v_pair_u8(voxels, at, a, b); return;
  case TC_I8: v_pair_i8(voxels, at, a, b); return;
  case TC_U16: v_pair_u16(voxels, at, a, b); return;
  case TC_I16: v_pair_i16(voxels, at, a, b); return;
  default: v_pair_f32(voxels, at, a, b); return;
  }
}

V_INLINE void fetch_pair(int type, const void *voxels, vi off, vf *a, vf *b) {
  const v_places at = v_place(off);
  load_pair(type, voxels, &at, a, b);
}

#ifndef V_BIAS_U8 /* an instruction set where converting to float is as cheap as adding a bias (simd.h) */
#define v_corner_u8 v_pair_u8
#define v_corner_i8 v_pair_i8
#define v_corner_u16 v_pair_u16
#define v_corner_i16 v_pair_i16
#define V_BIAS_U8 0
#define V_BIAS_I8 0
#define V_BIAS_U16 0
#define V_BIAS_I16 0
#endif

/* The pair with bias_of() the type added to each voxel. */
V_INLINE void load_corner(int type, const void *voxels, const v_places *at, vf *a, vf *b) {
  switch (VOXELS(type)) {
  case TC_U8: v_corner_u8(voxels, at, a, b); return;
  case TC_I8: v_corner_i8(voxels, at, a, b); return;
  case TC_U16: v_corner_u16(voxels, at, a, b); return;
  case TC_I16: v_corner_i16(voxels, at, a, b); return;
  default: v_pair_f32(voxels, at, a, b); return;
  }
}

#ifdef V_GATHERS
V_INLINE void gather_corner(int type, const void *voxels, const v_places *at, vf *a, vf *b) {
  switch (VOXELS(type)) {
  case TC_U8: v_gather_corner_u8(voxels, at, a, b); return;
  case TC_I8: v_gather_corner_i8(voxels, at, a, b); return;
  case TC_U16: v_gather_corner_u16(voxels, at, a, b); return;
  case TC_I16: v_gather_corner_i16(voxels, at, a, b); return;
  default: v_gather_corner_f32(voxels, at, a, b); return;
  }
}
#endif

V_INLINE int voxel_bytes(int type) { return VOXELS(type) == TC_F32 ? 4 : type == TC_U8 || type == TC_I8 ? 1 : 2; }

V_INLINE float bias_of(int type) {
  switch (VOXELS(type)) {
  case TC_U8: return V_BIAS_U8;
  case TC_I8: return V_BIAS_I8;
  case TC_U16: return V_BIAS_U16;
  case TC_I16: return V_BIAS_I16;
  default: return 0;
  }
}

/* The voxel value (not rescaled) at t mm along the rays, with filters nearest and cubic (filter_tmpl.h). */
V_INLINE vf sample_filtered(const tc_cpu_args *args, variant v, const packet *p, vf t);

/* Position of a sample in index coordinates: its cell, and the position within the cell. */
typedef struct spot {
  vi cell[3];
  vf f[3];
} spot;

/* The eight voxels at the cell's corners, pairs along x at (y, z) = (0, 0), (1, 0), (0, 1), (1, 1), with bias_of() the
 * type added to each. */
typedef struct corners { vf a[4], b[4]; } corners;

V_INLINE spot spot_at(const tc_cpu_args *args, const packet *p, vf t) {
  spot s;
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    vf q = v_min(v_max(v_fma(t, p->dir[k], p->entry[k]), v_set(0)), v_set(args->grid.last[k]));
    s.cell[k] = v_mini(v_trunc(q), v_seti(args->grid.cell_last[k]));
    s.f[k] = q - v_float(s.cell[k]);
  }
  return s;
}

V_INLINE vi cell_offset(const tc_cpu_args *args, const vi cell[3]) {
  return v_addi(cell[0], v_addi(v_muli(cell[1], v_seti(args->grid.row)), v_muli(cell[2], v_seti(args->grid.slice))));
}

/* Pair k of the corners of a cell lies at the cell's offset from here. */
V_INLINE const char *corner_voxels(const tc_cpu_args *args, int type, int k) {
  const ptrdiff_t along_y = args->grid.stride[1], along_z = args->grid.stride[2];
  return (const char *)args->grid.voxels + ((k & 1) * along_y + (k >> 1) * along_z) * voxel_bytes(type);
}

/* at: the lanes' cells. gather: by gathers, for an instruction set that has them (V_GATHERS) */
V_INLINE corners load_corners(const tc_cpu_args *args, int type, const v_places *at, bool gather) {
  corners c;
#ifdef V_GATHERS
  if (gather) {
#pragma GCC unroll 4
    for (int k = 0; k < 4; k++) gather_corner(type, corner_voxels(args, type, k), at, &c.a[k], &c.b[k]);
    return c;
  }
#endif
#pragma GCC unroll 4
  for (int k = 0; k < 4; k++) load_corner(type, corner_voxels(args, type, k), at, &c.a[k], &c.b[k]);
  return c;
}

/* load_corners() as a function per voxel type, called instead of inlined: for kernels of any voxel type, which compile much faster
 * that way, and for the rare lanes that do not fit a neighbourhood. */
#define LOAD_CALLED(name, type)                                                                                       \
  V_ONCE corners load_##name(const tc_cpu_args *args, vi off) {                                                       \
    const v_places at = v_place(off);                                                                                 \
    return load_corners(args, TYPE_##name, &at, args->gather);                                                        \
  }
SIMD_VOXELS(LOAD_CALLED)

V_INLINE corners call_corners(const tc_cpu_args *args, int type, vi off) {
  switch (VOXELS(type)) {
  case TC_U8: return load_u8(args, off);
  case TC_I8: return load_i8(args, off);
  case TC_U16: return load_u16(args, off);
  case TC_I16: return load_i16(args, off);
  default: return load_f32(args, off);
  }
}

#ifndef V_NEAR /* an instruction set without neighbourhoods */
#define V_NEAR_U8 4
#define V_NEAR_I8 4
#define V_NEAR_U16 4
#define V_NEAR_I16 4
#define V_NEAR_F32 4
#endif

/* Voxels along x in a neighbourhood: 4 or 8. */
V_INLINE int near_width(int type) {
  switch (VOXELS(type)) {
  case TC_U8: return V_NEAR_U8;
  case TC_I8: return V_NEAR_I8;
  case TC_U16: return V_NEAR_U16;
  case TC_I16: return V_NEAR_I16;
  default: return V_NEAR_F32;
  }
}

#ifdef V_NEAR
#define NEAR_CORNERS(name, NAME, type)                                                                                \
  V_INLINE corners near_corners_##name(const type *voxels, ptrdiff_t row, ptrdiff_t slice, vi at) {                   \
    const v_near_##name n = v_near_load_##name(voxels, row, slice);                                                   \
    corners c;                                                                                                        \
    _Pragma("GCC unroll 4") for (int k = 0; k < 4; k++)                                                               \
        v_near_pair_##name(&n, at, V_NEAR_##NAME * ((k & 1) + 4 * (k >> 1)), &c.a[k], &c.b[k]);                       \
    return c;                                                                                                         \
  }
NEAR_CORNERS(u8, U8, uint8_t)
NEAR_CORNERS(i8, I8, int8_t)
NEAR_CORNERS(u16, U16, uint16_t)
NEAR_CORNERS(i16, I16, int16_t)
NEAR_CORNERS(f32, F32, float)

/* Element numbers of the lanes' cells in the neighbourhood that begins at cell `least`. Returns the lanes whose cells
 * fit the neighbourhood. */
V_INLINE vm near_places(int type, const int least[3], const vi cell[3], vi *at) {
  const bool wide = near_width(type) == 8;
  vi rest[3];
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) rest[k] = v_subi(cell[k], v_seti(least[k]));
  *at = v_addi(v_addi(rest[0], v_shl(rest[1], wide ? 3 : 2)), v_shl(rest[2], wide ? 5 : 4));
  const vi most = v_maxu(rest[1], rest[2]), two = v_seti(2);
  return wide ? m_and(v_leu(rest[0], v_seti(6)), v_leu(most, two)) : v_leu(v_maxu(rest[0], most), two);
}

/* The corners at elements `at` of the neighbourhood whose lowest voxel is `first`. */
V_INLINE corners near_corners(const tc_cpu_args *args, int type, ptrdiff_t first, vi at) {
  const ptrdiff_t row = args->grid.row, slice = args->grid.slice;
  switch (VOXELS(type)) {
  case TC_U8: return near_corners_u8((const uint8_t *)args->grid.voxels + first, row, slice, at);
  case TC_I8: return near_corners_i8((const int8_t *)args->grid.voxels + first, row, slice, at);
  case TC_U16: return near_corners_u16((const uint16_t *)args->grid.voxels + first, row, slice, at);
  case TC_I16: return near_corners_i16((const int16_t *)args->grid.voxels + first, row, slice, at);
  default: return near_corners_f32((const float *)args->grid.voxels + first, row, slice, at);
  }
}
#endif

/* Trilinear interpolation. gradient, unless NULL: the exact derivative over index coordinates, from the cell's eight
 * corners; meaningless along an axis of one voxel. */
V_INLINE vf interpolate(int type, const corners *c, const vf f[3], vf *gradient) {
  /* Differences to the first corner: a constant field is exact, and the bias of the corners cancels. */
  vf a00 = c->a[0], d00 = c->b[0] - a00, d10 = c->b[1] - c->a[1], d01 = c->b[2] - c->a[2], d11 = c->b[3] - c->a[3];
  vf s00 = f[0] * d00, s10 = v_fma(f[0], d10, c->a[1] - a00);
  vf s01 = v_fma(f[0], d01, c->a[2] - a00), s11 = v_fma(f[0], d11, c->a[3] - a00);
  vf s0 = v_fma(f[1], s10 - s00, s00), s1 = v_fma(f[1], s11 - s01, s01);
  if (gradient) {
    vf x0 = v_fma(f[1], d10 - d00, d00), x1 = v_fma(f[1], d11 - d01, d01);
    gradient[0] = v_fma(f[2], x1 - x0, x0);
    gradient[1] = v_fma(f[2], (s11 - s01) - (s10 - s00), s10 - s00);
    gradient[2] = s1 - s0;
  }
  return (a00 - v_set(bias_of(type))) + v_fma(f[2], s1 - s0, s0);
}

/* The field in the lanes' cells, at positions f in them. Both branches interpolate: if they met before, all eight corners
 * would have to be complete there, and the compiler could not interleave loads with arithmetic. */
V_INLINE vf sample_cells(const tc_cpu_args *args, int type, const v_places *at, const vf f[3], vf *gradient) {
#ifdef V_GATHERS
  if (__builtin_expect(args->gather, 0)) {
    const corners c = load_corners(args, type, at, true);
    return interpolate(type, &c, f, gradient);
  }
#endif
  const corners c = load_corners(args, type, at, false);
  return interpolate(type, &c, f, gradient);
}

/* The voxel value (not rescaled) at t mm along the rays, with any filter. */
V_INLINE vf sample_field(const tc_cpu_args *args, variant v, const packet *p, vf t, vf *gradient) {
  if (v.filter != TC_FILTER_LINEAR && !gradient) return sample_filtered(args, v, p, t);
  const spot s = spot_at(args, p, t);
  vf linear;
  if (v.any_type) {
    const corners c = call_corners(args, v.type, cell_offset(args, s.cell));
    linear = interpolate(v.type, &c, s.f, gradient);
  } else {
    const v_places at = v_place(cell_offset(args, s.cell));
    linear = sample_cells(args, v.type, &at, s.f, gradient);
  }
  return v.filter == TC_FILTER_LINEAR ? linear : sample_filtered(args, v, p, t);
}

V_INLINE vf sample_voxel(const tc_cpu_args *args, variant v, const packet *p, vf t) {
  return sample_field(args, v, p, t, NULL);
}

V_INLINE vf node_of(const tc_cpu_args *args, vf voxel) {
  vf node = (voxel - v_set(args->nodes.lo)) * v_set(args->nodes.scale);
  return v_min(v_max(node, v_set(0)), v_set(args->nodes.last));
}

/* sample_field() converted to a node of the table. */
V_INLINE vf sample_node(const tc_cpu_args *args, variant v, const packet *p, vf t, vf *gradient) {
  return node_of(args, sample_field(args, v, p, t, gradient));
}
