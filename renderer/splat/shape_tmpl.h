/* Shapes of kernels where voxels are larger than pixels; part of tile_tmpl.h. With balls alone outlines lie up to a voxel beyond
 * the surface, and thin structures look like rows of beads. */

V_INLINE vm is_thin(vi word) {
  const vi faces = v_sra(word, 12);
  return v_lt(v_set(0), v_float(v_andi(v_andi(faces, v_sra(faces, 1)), v_seti(0x15))));
}

/* Normals of packed splats: tc_octahedron_unfold(), not yet of unit length. */
V_INLINE void unfold(vi word, vf n[3]) {
  const vf zero = v_set(0), one = v_set(1);
  vf x = (v_float(v_andi(v_sra(word, 18), v_seti(127))) - v_set(63)) * v_set(1 / 63.f);
  vf y = (v_float(v_andi(v_sra(word, 25), v_seti(127))) - v_set(63)) * v_set(1 / 63.f), z = one - v_abs(x) - v_abs(y);
  vf a = one - v_abs(y), b = one - v_abs(x);
  vm under = v_lt(z, zero);
  n[0] = v_select(under, v_select(v_lt(x, zero), zero - a, a), x);
  n[1] = v_select(under, v_select(v_lt(y, zero), zero - b, b), y);
  n[2] = z;
}

V_INLINE void to_unit(vf n[3]) {
  const vf scale = v_set(1) / v_sqrt(v_fma(n[0], n[0], v_fma(n[1], n[1], n[2] * n[2])));
  for (int k = 0; k < 3; k++) n[k] = n[k] * scale;
}

/* Shape of a kernel, relative to a ball: `along` times as long along `axis` (a unit vector of index coordinates), `across` times
 * as long across it. Its core is `core` times as long along the axis. */
typedef struct shape {
  vf axis[3], along, across, core;
  vf middle, surface; /* offsets along the axis from the voxel to the kernel's centre and to the surface, voxels */
  vm flat;            /* the kernel lies on a surface perpendicular to the axis */
  vm front;           /* and that surface faces the eye */
} shape;

V_INLINE bool has_shapes(const tc_splat_args *g) { return g->opaque && g->shape_blend > 0; }
/* True if cores differ from their kernels in shape, because the kernel's radius has grown. */
V_INLINE bool has_cores(const tc_splat_args *g) { return has_shapes(g) && g->coreless_scale > 1; }

/* Flat cores would leave gaps where a surface bends within a voxel. Cores that face the eye are therefore thick, and so are their
 * kernels; cores seen edge-on stay flat, so that outlines end where the surface does. */
V_INLINE vf core_of(const vf eye[3], const shape *s, vm flat) {
  const vf zero = v_set(0), one = v_set(1);
  vf facing = zero, square = zero;
  for (int k = 0; k < 3; k++) facing = v_fma(eye[k], s->axis[k], facing), square = v_fma(eye[k], eye[k], square);
  const vf cosine = v_abs(facing) / v_sqrt(square);
  const vf thick = v_min(v_max((cosine - v_set(TC_SPLAT_ASLANT)) * v_set(1 / TC_SPLAT_ASLANT), zero), one);
  const vf most = v_max(v_min(s->along * v_set(1 / TC_SPLAT_FLAT), one), s->along);
  return v_select(flat, v_fma(most - s->along, thick, s->along), s->along);
}

/* Unit normals of packed splats in index coordinates. */
V_INLINE void axis_of(const tc_splat_args *g, vi word, vf axis[3]) {
  vf n[3];
  unfold(word, n);
  for (int k = 0; k < 3; k++)
    axis[k] = v_fma(n[2], v_set(g->covariant[k][2]), v_fma(n[1], v_set(g->covariant[k][1]), n[0] * v_set(g->covariant[k][0])));
  to_unit(axis);
}

/* Sets axis, flat and front. */
V_INLINE shape side_of(const tc_splat_args *g, const uint8_t *insets, vi word, const vf eye[3]) {
  const vf zero = v_set(0), inset = v_float(v_load_bytes(insets));
  const vm thin = is_thin(word);
  shape s;
  axis_of(g, word, s.axis);
  s.flat = m_or(m_andnot(v_lt(zero, inset), thin), m_and(thin, v_lt(inset, v_set(64))));
  s.front = m_and(s.flat, v_lt(zero, v_fma(eye[2], s.axis[2], v_fma(eye[1], s.axis[1], eye[0] * s.axis[0]))));
  return s;
}

/* Sets the lengths and offsets of thin splats (tc_splat_thin). */
V_INLINE void thin_shape(const tc_splat_args *g, vi stored, vm thin, shape *s) {
  const vf zero = v_set(0), one = v_set(1), core = v_set(g->core_radius);
  const vf what = v_float(v_sra(stored, 6)), thick = v_float(v_andi(stored, v_seti(63))) * v_set(1 / 63.f);
  const vm sheet = v_lt(what, one), dot = v_lt(v_set(2), what), end = m_and(thin, m_andnot(v_lt(one, what), dot));
  /* An end's kernel reaches from a core's radius behind its voxel to the end of the line. */
  const vf on = v_float(v_andi(stored, v_seti(7))) * v_set((float)TC_SPLAT_LONG / 7);
  const vf tenths = v_float(v_andi(v_sra(stored, 3), v_seti(7))) * v_set(0.1f) + v_set(0.3f);
  const vf line = v_select(end, (on + core) * v_set(0.5f / g->core_radius), v_set((float)TC_SPLAT_LONG));
  s->along = v_select(thin, v_select(m_or(sheet, dot), thick, line), s->along);
  s->across = v_select(m_andnot(thin, sheet), v_select(end, tenths, thick), s->across);
  s->middle = v_select(end, (on - core) * v_set(0.5f), zero);
}

/* Sets the rest of a shape after side_of(). Beside a surface a kernel is flat and touches the surface from within, so that
 * outlines end there, and has the surface's depth. Kernels of thin voxels stay at their voxels: a sheet's is as thick as the
 * sheet; a line's is long, so that voxels that touch by a corner are connected. at: positions of the splats in view space,
 * changed to those of the kernels. */
V_INLINE void set_shape(const tc_splat_args *g, const uint8_t *insets, vi word, const vf eye[3], vf at[3], shape *s) {
  const vf zero = v_set(0), one = v_set(1), inset = v_float(v_load_bytes(insets));
  const vm known = v_lt(zero, inset), thin = is_thin(word), moved = m_andnot(known, thin);
  s->along = v_set(TC_SPLAT_FLAT), s->across = one, s->middle = zero;
  if (m_any(thin)) thin_shape(g, v_trunc(inset), thin, s);
  const vf move = v_select(known, v_set(g->shape_blend), zero);
  s->along = v_fma(s->along - one, move, one), s->across = v_fma(s->across - one, move, one);
  const vf surface = v_select(moved, (inset - one) * v_set(g->shape_blend / 254), zero);
  const vf middle = v_select(moved, v_fnma(v_set(TC_SPLAT_FLAT * g->core_radius), move, surface), s->middle * move);
  for (int r = 0; r < 3; r++) {
    const float *m = g->axis[r];
    const vf way = v_fma(s->axis[2], v_set(m[2]), v_fma(s->axis[1], v_set(m[1]), s->axis[0] * v_set(m[0])));
    at[r] = v_fma(way, r < 2 ? middle : surface, at[r]);
  }
  s->middle = middle, s->surface = surface;
  s->core = core_of(eye, s, s->flat);
  s->along = has_cores(g) ? v_max(s->along, s->core * v_set(g->core_share)) : s->core;
}

/* Row of the Jacobian for a kernel that is `along` times as long along its axis. */
V_INLINE void stretch(const shape *s, vf along, const vf row[3], vf to[3]) {
  const vf more = (along - s->across) * v_fma(row[2], s->axis[2], v_fma(row[1], s->axis[1], row[0] * s->axis[0]));
  for (int k = 0; k < 3; k++) to[k] = v_fma(more, s->axis[k], row[k] * s->across);
}
