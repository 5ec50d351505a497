/* Clipping of kernels per pixel; part of tile_tmpl.h. Kernels of voxels on either side of a plane reach across it. Clipped at the
 * plane, the surface ends in a straight line instead of steps of voxels. */

/* Half planes that clip the splats of a batch: a pixel at dx, dy from the centre of splat i is kept if at + x dx + y dy >= 0 for
 * each of them. */
typedef struct cuts {
  int n, plane[TC_SPLAT_MOST_PLANES]; /* plane[i]: of half plane i; those of the object's surface come after the planes' */
  float at[TC_SPLAT_MOST_PLANES + 2][V_LANES], x[TC_SPLAT_MOST_PLANES + 2][V_LANES], y[TC_SPLAT_MOST_PLANES + 2][V_LANES];
} cuts;

V_INLINE void cross_of(const vf a[3], const vf b[3], vf to[3]) {
  for (int k = 0; k < 3; k++) to[k] = v_fnma(a[(k + 2) % 3], b[(k + 1) % 3], a[(k + 1) % 3] * b[(k + 2) % 3]);
}

V_INLINE void add_cut(vm where, vf at, vf x, vf y, cuts *to) {
  const vf zero = v_set(0);
  v_store(to->at[to->n], v_select(where, at, zero)), v_store(to->x[to->n], v_select(where, x, zero));
  v_store(to->y[to->n++], v_select(where, y, zero));
}

/* Clips kernels of a cut face at the object's surface beside their voxels, and those of a sheet at both of its sides. own: shapes
 * of the face's splats; across_x, across_y: steps on the face for a pixel along x and y; dx, dy: as in find_cuts(). */
V_INLINE void cut_by_rim(const tc_splat_args *g, const tc_splats *of, uint32_t first, const shape *own, const vf across_x[3],
                         const vf across_y[3], vf dx, vf dy, cuts *to) {
  const vi rim = v_bits(v_load((const float *)(const void *)(of->rims + first)));
  const vf inset = v_float(v_andi(rim, v_seti(255))), zero = v_set(0);
  const vm known = v_lt(zero, inset), sheet = m_and(known, is_thin(rim));
  const vf half = v_fma(v_fma(inset, v_set(1 / 63.f), v_set(-1)), v_set(g->shape_blend), v_set(1)) * v_set(g->core_radius);
  const vf out = v_select(sheet, half, (inset - v_set(1)) * v_set(1 / 254.f));
  vf axis[3], x = zero, y = zero, away = zero;
  axis_of(g, rim, axis);
  for (int k = 0; k < 3; k++)
    x = v_fma(axis[k], across_x[k], x), y = v_fma(axis[k], across_y[k], y), away = v_fma(axis[k], own->axis[k], away);
  away = v_fnma(x, dx, v_fnma(y, dy, away * own->surface));
  const vf over = v_set(TC_SPLAT_OVER);
  add_cut(known, out - away + over, zero - x, zero - y, to);
  if (m_any(sheet)) add_cut(sheet, out + away + over, x, y, to);
}

/* A splat of a cut face is not clipped by the plane of that face, which is the plane nearest to it. Lines, single voxels, and
 * voxels that planes clip on opposite sides have no face: every plane clips them. d: positions of the splats on their faces for
 * a shape_blend of 1. */
V_INLINE void spare_faces(const tc_splat_args *g, const tc_splat_entry *e, vi word, const vf d[3], cuts *to) {
  const vf zero = v_set(0);
  const vm round = is_thin(word);
  vf away[TC_SPLAT_MOST_PLANES], least = v_set(1e30f); /* voxels */
  for (int i = 0; i < to->n; i++) {
    const double *p = g->planes[to->plane[i]];
    away[i] = v_abs(along_plane(p, d) + v_set(plane_start(g, e, to->plane[i]))) * v_set((float)(1 / length3(p)));
    least = v_min(least, away[i]);
  }
  for (int i = 0; i < to->n; i++) {
    const vm cuts_it = m_or(round, v_lt(least + v_set(TC_SPLAT_ON_FACE), away[i]));
    v_store(to->at[i], v_select(cuts_it, v_load(to->at[i]), zero));
    v_store(to->x[i], v_select(cuts_it, v_load(to->x[i]), zero)), v_store(to->y[i], v_select(cuts_it, v_load(to->y[i]), zero));
  }
}

/* The splats, at d, that plane i is near enough to clip. Others must not be tested: a tangent plane seen at a flat angle meets
 * planes far away from its splat. */
V_INLINE vm is_near(const tc_splat_args *g, const tc_splat_entry *e, int i, const vf d[3]) {
  const vf away = along_plane(g->planes[i], d) + v_set(plane_start(g, e, i));
  return v_lt(away, v_set(g->clip_reach * (float)length3(g->planes[i])));
}

V_INLINE bool may_cut(const tc_splat_args *g, const tc_splat_entry *e, const vf d[3]) {
  vm any = v_lt(d[0], d[0]);
  for (uint32_t left = e->planes; left; left &= left - 1) any = m_or(any, is_near(g, e, __builtin_ctz(left), d));
  return m_any(any);
}

/* Sets the half planes. A splat on a surface is clipped where its tangent plane meets the clip plane; a splat that is seen edge-on
 * or lies on no surface, where a plane perpendicular to the view does. Projects the splats again, at a cost for splats near a
 * plane only. False: no splat is clipped. */
V_INLINE bool find_cuts(const tc_splat_args *g, const tc_splat_entry *e, const tc_splat_tile *t, uint32_t first, cuts *to) {
  const vi word = v_bits(v_load((const float *)(const void *)(e->of->words + first)));
  const vf zero = v_set(0);
  vf d[3] = {v_float(nibble(word, 0)), v_float(nibble(word, 4)), v_float(nibble(word, 8))};
  if (!e->of->cut && !may_cut(g, e, d)) return false;
  vf shift = zero, face[3] = {d[0], d[1], d[2]};
  const vf voxel[3] = {d[0], d[1], d[2]};
  vf at[3] = {along(g, 0, d, e->at[0]), along(g, 1, d, e->at[1]), along(g, 2, d, e->at[2])};
  vf jx[3], jy[3], normal[3], area[3], across_x[3], across_y[3], facing = zero, square = zero;
  shape own = {.axis = {zero, zero, zero}, .flat = v_lt(zero, zero)};
  if (has_shapes(g)) {
    const vf eye[3] = {v_set(e->eye[0]) - d[0], v_set(e->eye[1]) - d[1], v_set(e->eye[2]) - d[2]};
    own = side_of(g, e->of->insets + first, word, eye);
    set_shape(g, e->of->insets + first, word, eye, at, &own);
    for (int k = 0; k < 3; k++) {
      face[k] = v_fma(own.axis[k], own.surface * v_set(1 / g->shape_blend), d[k]);
      d[k] = v_fma(own.axis[k], own.surface, d[k]);
    }
    shift = own.surface - own.middle;
  }
  const projection s = project_point(g, t, at);
  for (int k = 0; k < 3; k++) { /* pixels by index coordinates */
    jx[k] = v_fnma(s.u, v_set(g->axis[2][k]), v_set(g->axis[0][k])) * s.scale;
    jy[k] = v_fnma(s.v, v_set(g->axis[2][k]), v_set(g->axis[1][k])) * s.scale;
  }
  cross_of(jx, jy, area);
  for (int k = 0; k < 3; k++)
    facing = v_fma(own.axis[k], area[k], facing), square = v_fma(area[k], area[k], square);
  const vm tangent = m_and(own.flat, v_lt(square * v_set(0.01f), facing * facing));
  for (int k = 0; k < 3; k++) normal[k] = v_select(tangent, own.axis[k], v_set(g->axis[2][k]));
  const vf inverse = v_set(1) / v_fma(normal[2], area[2], v_fma(normal[1], area[1], normal[0] * area[0]));
  cross_of(jy, normal, across_x), cross_of(normal, jx, across_y);
  for (int k = 0; k < 3; k++) across_x[k] = across_x[k] * inverse, across_y[k] = across_y[k] * inverse;
  vf dx = zero, dy = zero; /* pixels from the splat's centre to the projection of the surface's point */
  for (int k = 0; k < 3; k++)
    dx = v_fma(jx[k], own.axis[k] * shift, dx), dy = v_fma(jy[k], own.axis[k] * shift, dy);
  to->n = 0;
  for (uint32_t left = e->planes; left; left &= left - 1) {
    const int i = __builtin_ctz(left), n = to->n;
    const vf x = along_plane(g->planes[i], across_x), y = along_plane(g->planes[i], across_y);
    const vf away = along_plane(g->planes[i], d) + v_set(plane_start(g, e, i) + TC_SPLAT_OVER * (float)length3(g->planes[i]));
    const vm near = is_near(g, e, i, voxel);
    add_cut(e->of->cut ? v_le(zero, zero) : near, v_fnma(x, dx, v_fnma(y, dy, away)), x, y, to);
    to->plane[n] = i;
  }
  if (!e->of->cut) return true;
  spare_faces(g, e, word, face, to);
  cut_by_rim(g, e->of, first, &own, across_x, across_y, dx, dy, to);
  return true;
}

/* Pixels of `in` that no half plane clips off splat i. cut: NULL if no plane meets its brick. */
V_INLINE vm not_cut(const cuts *cut, int i, vf dx, vf dy, vm in) {
  if (!cut) return in;
  for (int k = 0; k < cut->n; k++)
    in = m_and(in, v_le(v_set(0), v_fma(dy, v_set(cut->y[k][i]), v_fma(dx, v_set(cut->x[k][i]), v_set(cut->at[k][i])))));
  return in;
}
