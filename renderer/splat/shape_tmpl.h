/* The shapes that kernels take where voxels are larger than pixels: a part of tile_tmpl.h. Without them outlines end up to a voxel
 * beyond the surface, and what is thin is a row of beads. */

V_INLINE vm is_thin(vi word) {
  const vi faces = v_sra(word, 12);
  return v_lt(v_set(0), v_float(v_andi(v_andi(faces, v_sra(faces, 1)), v_seti(0x15))));
}

/* Normals of words on the octahedron: tc_octahedron_unfold(). */
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

/* A kernel's own shape: `axis` (index coordinates) is where it is `along` times as long as a ball, and across it
 * `across` times; its core is `core` times as long there as the ball's. */
typedef struct shape {
  vf axis[3], along, across, core;
  vf middle, surface; /* where the kernel is along the axis, from its voxel; and the surface that it touches */
  vm flat;            /* it lies on a surface, across the axis; */
  vm front;           /* and that surface's outside is seen */
} shape;

V_INLINE bool has_shapes(const tc_splat_args *g) { return g->opaque && g->move > 0; }
/* Whether cores differ from their kernels in shape: where these are wider than the scene says. */
V_INLINE bool has_cores(const tc_splat_args *g) { return has_shapes(g) && g->open > 1; }

/* Flat cores leave gaps between them where a surface bends within a voxel. A core that faces the eye is therefore thick, and
 * its kernel holds it; a core seen edge-on stays flat, so that outlines end where the surface does. */
V_INLINE vf core_of(const vf eye[3], const shape *s, vm flat) {
  const vf zero = v_set(0), one = v_set(1);
  vf facing = zero, square = zero;
  for (int k = 0; k < 3; k++) facing = v_fma(eye[k], s->axis[k], facing), square = v_fma(eye[k], eye[k], square);
  const vf cosine = v_abs(facing) / v_sqrt(square);
  const vf thick = v_min(v_max((cosine - v_set(TC_SPLAT_ASLANT)) * v_set(1 / TC_SPLAT_ASLANT), zero), one);
  const vf most = v_max(v_min(s->along * v_set(1 / TC_SPLAT_FLAT), one), s->along);
  return v_select(flat, v_fma(most - s->along, thick, s->along), s->along);
}

/* The normals of words in index coordinates, unit length. */
V_INLINE void axis_of(const tc_splat_args *g, vi word, vf axis[3]) {
  vf n[3];
  unfold(word, n);
  for (int k = 0; k < 3; k++)
    axis[k] = v_fma(n[2], v_set(g->covariant[k][2]), v_fma(n[1], v_set(g->covariant[k][1]), n[0] * v_set(g->covariant[k][0])));
  to_unit(axis);
}

/* Which way splats look: sets axis, flat and front. */
V_INLINE shape side_of(const tc_splat_args *g, const uint8_t *insets, vi word, const vf eye[3]) {
  const vf zero = v_set(0), inset = v_float(v_load_bytes(insets));
  const vm thin = is_thin(word);
  shape s;
  axis_of(g, word, s.axis);
  s.flat = m_or(m_andnot(v_lt(zero, inset), thin), m_and(thin, v_lt(inset, v_set(64))));
  s.front = m_and(s.flat, v_lt(zero, v_fma(eye[2], s.axis[2], v_fma(eye[1], s.axis[1], eye[0] * s.axis[0]))));
  return s;
}

/* Of thin voxels: how long kernels are along their axes and across, and how far along them from their voxels. */
V_INLINE void thin_shape(const tc_splat_args *g, vi stored, vm thin, shape *s) {
  const vf zero = v_set(0), one = v_set(1), touch = v_set(g->touch);
  const vf what = v_float(v_sra(stored, 6)), thick = v_float(v_andi(stored, v_seti(63))) * v_set(1 / 63.f);
  const vm sheet = v_lt(what, one), dot = v_lt(v_set(2), what), end = m_and(thin, m_andnot(v_lt(one, what), dot));
  /* From a core's radius behind an end's voxel to where it ends. */
  const vf on = v_float(v_andi(stored, v_seti(7))) * v_set((float)TC_SPLAT_LONG / 7);
  const vf tenths = v_float(v_andi(v_sra(stored, 3), v_seti(7))) * v_set(0.1f) + v_set(0.3f);
  const vf line = v_select(end, (on + touch) * v_set(0.5f / g->touch), v_set((float)TC_SPLAT_LONG));
  s->along = v_select(thin, v_select(m_or(sheet, dot), thick, line), s->along);
  s->across = v_select(m_andnot(thin, sheet), v_select(end, tenths, thick), s->across);
  s->middle = v_select(end, (on - touch) * v_set(0.5f), zero);
}

/* A kernel beside a surface is flat and touches the surface from within: outlines end there, and its depth is the
 * surface's. One of a thin voxel stays: a sheet's is as thick as the sheet, a line's follows the line, so that voxels
 * that touch by a corner are drawn as one. s: as side_of() set it; at: the splats' places, which become the kernels'. */
V_INLINE void set_shape(const tc_splat_args *g, const uint8_t *insets, vi word, const vf eye[3], vf at[3], shape *s) {
  const vf zero = v_set(0), one = v_set(1), inset = v_float(v_load_bytes(insets));
  const vm known = v_lt(zero, inset), thin = is_thin(word), moved = m_andnot(known, thin);
  s->along = v_set(TC_SPLAT_FLAT), s->across = one, s->middle = zero;
  if (m_any(thin)) thin_shape(g, v_trunc(inset), thin, s);
  const vf move = v_select(known, v_set(g->move), zero);
  s->along = v_fma(s->along - one, move, one), s->across = v_fma(s->across - one, move, one);
  const vf surface = v_select(moved, (inset - one) * v_set(g->move / 254), zero);
  const vf middle = v_select(moved, v_fnma(v_set(TC_SPLAT_FLAT * g->touch), move, surface), s->middle * move);
  for (int r = 0; r < 3; r++) {
    const float *m = g->axis[r];
    const vf way = v_fma(s->axis[2], v_set(m[2]), v_fma(s->axis[1], v_set(m[1]), s->axis[0] * v_set(m[0])));
    at[r] = v_fma(way, r < 2 ? middle : surface, at[r]);
  }
  s->middle = middle, s->surface = surface;
  s->core = core_of(eye, s, s->flat);
  s->along = has_cores(g) ? v_max(s->along, s->core * v_set(g->core_root)) : s->core;
}

/* A row of the Jacobian, of the ball that the kernel is made of; the axis is `along` times as long. */
V_INLINE void stretch(const shape *s, vf along, const vf row[3], vf to[3]) {
  const vf more = (along - s->across) * v_fma(row[2], s->axis[2], v_fma(row[1], s->axis[1], row[0] * s->axis[0]));
  for (int k = 0; k < 3; k++) to[k] = v_fma(more, s->axis[k], row[k] * s->across);
}
