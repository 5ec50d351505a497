/* The field at a point of the packet's rays: cells, voxel pairs, trilinear interpolation. Part of the template. */

V_INLINE void fetch_pair(int type, const void *voxels, vi off, vf *a, vf *b) {
  switch (type) { /* a constant after inlining */
  case TC_U8: v_pair_u8(voxels, off, a, b); return;
  case TC_I8: v_pair_i8(voxels, off, a, b); return;
  case TC_U16: v_pair_u16(voxels, off, a, b); return;
  case TC_I16: v_pair_i16(voxels, off, a, b); return;
  default: v_pair_f32(voxels, off, a, b); return;
  }
}

/* Voxel value (not rescaled) at mm t along the rays by a filter other than linear: filter_tmpl.h. */
V_INLINE vf sample_filtered(const tc_cpu_args *g, variant v, const packet *p, vf t);

/* The same by any filter. gradient, unless NULL: the exact derivative of the trilinear field over index coordinates, from
 * its eight corners; meaningless along an axis of one voxel. */
V_INLINE vf sample_field(const tc_cpu_args *g, variant v, const packet *p, vf t, vf *gradient) {
  if (v.filter != TC_FILTER_LINEAR && !gradient) return sample_filtered(g, v, p, t);
  vf f[3];
  vi cell[3];
  for (int k = 0; k < 3; k++) {
    vf q = v_min(v_max(v_fma(t, p->dir[k], p->entry[k]), v_set(0)), v_set(g->last[k]));
    cell[k] = v_mini(v_trunc(q), v_seti(g->cell_last[k]));
    f[k] = q - v_float(cell[k]);
  }
  vi off = v_addi(cell[0], v_addi(v_muli(cell[1], v_seti(g->row)), v_muli(cell[2], v_seti(g->slice))));
  vi off_y = v_addi(off, v_seti(g->stride[1])), off_z = v_addi(off, v_seti(g->stride[2]));
  vi off_yz = v_addi(off_y, v_seti(g->stride[2]));
  vf a, b, c00, c10, c01, c11, d00, d10, d01, d11;
  fetch_pair(v.type, g->voxels, off, &a, &b);
  d00 = b - a;
  c00 = v_fma(f[0], d00, a);
  fetch_pair(v.type, g->voxels, off_y, &a, &b);
  d10 = b - a;
  c10 = v_fma(f[0], d10, a);
  fetch_pair(v.type, g->voxels, off_z, &a, &b);
  d01 = b - a;
  c01 = v_fma(f[0], d01, a);
  fetch_pair(v.type, g->voxels, off_yz, &a, &b);
  d11 = b - a;
  c11 = v_fma(f[0], d11, a);
  vf c0 = v_fma(f[1], c10 - c00, c00), c1 = v_fma(f[1], c11 - c01, c01);
  if (gradient) {
    vf x0 = v_fma(f[1], d10 - d00, d00), x1 = v_fma(f[1], d11 - d01, d01);
    gradient[0] = v_fma(f[2], x1 - x0, x0);
    gradient[1] = v_fma(f[2], (c11 - c01) - (c10 - c00), c10 - c00);
    gradient[2] = c1 - c0;
  }
  if (v.filter != TC_FILTER_LINEAR) return sample_filtered(g, v, p, t);
  return v_fma(f[2], c1 - c0, c0);
}

V_INLINE vf sample_voxel(const tc_cpu_args *g, variant v, const packet *p, vf t) { return sample_field(g, v, p, t, NULL); }

/* The same as a table node, and the gradient where it is wanted. */
V_INLINE vf sample_node(const tc_cpu_args *g, variant v, const packet *p, vf t, vf *gradient) {
  vf node = (sample_field(g, v, p, t, gradient) - v_set(g->value_lo)) * v_set(g->value_scale);
  return v_min(v_max(node, v_set(0)), v_set(g->node_last));
}
