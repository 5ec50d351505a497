/* Gradients over index coordinates, for shading: central differences and the cubic B-spline's derivative; the
 * trilinear cell's own gradient comes with its samples (field_tmpl.h). One function per voxel type, called and not
 * inlined. */

/* Central differences at the voxels around q, one-sided in a face, trilinearly interpolated: continuous across
 * cells. */
V_INLINE void central(const tc_cpu_args *args, int type, const vf q[3], vf gradient[3]) {
  taps t[3];
  vf scale[3][2], row[4][4], along_x[4][4];
  for (int k = 0; k < 3; k++) {
    t[k] = taps_at(args, k, q[k]);
    scale[k][0] = v_select(t[k].first, v_set(1), v_set(0.5f));
    scale[k][1] = v_select(t[k].last, v_set(1), v_set(0.5f));
  }
#define BETWEEN(k, a, b) v_fma(t[k].f, (b) - (a), a)
#define RISE(k, t0, t1, t2, t3) BETWEEN(k, ((t2) - (t0)) * scale[k][0], ((t3) - (t1)) * scale[k][1])
  for (int z = 0; z < 4; z++)
    for (int y = 0; y < 4; y++) {
      bool near_y = y == 1 || y == 2, near_z = z == 1 || z == 2;
      vi off = v_addi(v_muli(t[1].at[y], v_seti(args->grid.row)), v_muli(t[2].at[z], v_seti(args->grid.slice)));
      vf x[4];
      if (near_y && near_z) {
        fetch_row(args, type, &t[0], off, x);
        along_x[z][y] = RISE(0, x[0], x[1], x[2], x[3]);
        row[z][y] = BETWEEN(0, x[1], x[2]);
      } else if (near_y || near_z) {
        fetch_pair(type, args->grid.voxels, v_addi(off, t[0].at[1]), &x[1], &x[2]);
        row[z][y] = BETWEEN(0, x[1], x[2]);
      }
    }
  vf low = BETWEEN(1, along_x[1][1], along_x[1][2]), high = BETWEEN(1, along_x[2][1], along_x[2][2]);
  gradient[0] = BETWEEN(2, low, high);
  low = RISE(1, row[1][0], row[1][1], row[1][2], row[1][3]);
  high = RISE(1, row[2][0], row[2][1], row[2][2], row[2][3]);
  gradient[1] = BETWEEN(2, low, high);
  low = RISE(2, row[0][1], row[1][1], row[2][1], row[3][1]);
  high = RISE(2, row[0][2], row[1][2], row[2][2], row[3][2]);
  gradient[2] = BETWEEN(1, low, high);
#undef BETWEEN
#undef RISE
}

#define CENTRAL(name, type)                                                                                            \
  V_ONCE void central_##name(const tc_cpu_args *args, const vf q[3], vf gradient[3]) {                                 \
    central(args, type, q, gradient);                                                                                  \
  }

CENTRAL(u8, TC_U8)
CENTRAL(i8, TC_I8)
CENTRAL(u16, TC_U16)
CENTRAL(i16, TC_I16)
CENTRAL(f32, TC_F32)

/* The gradient at mm t along the rays, by central differences or the cubic derivative. */
V_INLINE void gradient_at(const tc_cpu_args *args, variant v, const packet *p, vf t, vf gradient[3]) {
  vf q[3];
  if (v.gradient == TC_GRADIENT_CUBIC) {
    sample_cubic(args, v, p, t, gradient);
    return;
  }
  place_at(args, p, t, q);
  switch (v.type) { /* a constant after inlining */
  case TC_U8: central_u8(args, q, gradient); return;
  case TC_I8: central_i8(args, q, gradient); return;
  case TC_U16: central_u16(args, q, gradient); return;
  case TC_I16: central_i16(args, q, gradient); return;
  default: central_f32(args, q, gradient); return;
  }
}
