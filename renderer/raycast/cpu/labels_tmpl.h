/* Labels along the packet's rays (equations: classify/labels.h). */

typedef struct label_mix {
  vf tint[4], visible; /* premultiplied colour and its opacity */
} label_mix;

V_INLINE label_mix mix_labels(label_mix a, label_mix b, vf f) {
  /* exact where a and b are equal */
  for (int c = 0; c < 4; c++) a.tint[c] = v_fma(f, b.tint[c] - a.tint[c], a.tint[c]);
  a.visible = v_fma(f, b.visible - a.visible, a.visible);
  return a;
}

V_INLINE label_mix find_label(const tc_cpu_labels *l, vf voxel) {
  vi off = v_shl(v_trunc(voxel - v_set(l->base)), 3);
  label_mix m;
  vf unused;
  fetch_pair(TC_F32, l->entries, off, &m.tint[0], &m.tint[1]);
  fetch_pair(TC_F32, l->entries, v_addi(off, v_seti(2)), &m.tint[2], &m.tint[3]);
  fetch_pair(TC_F32, l->entries, v_addi(off, v_seti(4)), &m.visible, &unused);
  return m;
}

/* The label cell at t mm along the rays, and the position f within the cell; returns the weight of the grid, which
 * falls to 0 outside. */
V_INLINE vf find_label_cell(const tc_cpu_labels *l, const packet *p, vf t, vi cell[3], vf f[3]) {
  vf q[3], inside = v_set(1);
  for (int k = 0; k < 3; k++) q[k] = v_fma(t, p->dir[k], p->entry[k]);
  for (int k = 0; k < 3; k++) {
    const float *m = l->matrix[k];
    vf at = v_fma(v_set(m[2]), q[2], v_fma(v_set(m[1]), q[1], v_fma(v_set(m[0]), q[0], v_set(m[3]))));
    if (l->nearest) at = at + v_set(NEAREST_UP);
    vf near = v_min(v_max(at, v_set(0)), v_set(l->grid.last[k])), beyond = v_abs(at - near);
    bool hard = l->nearest || l->grid.last[k] < 1;
    if (l->nearest) near = v_float(v_trunc(near + v_set(0.5f)));
    inside =
        inside * (hard ? v_select(v_le(beyond, v_set(0.5f)), v_set(1), v_set(0)) : v_max(v_set(1) - beyond, v_set(0)));
    cell[k] = v_mini(v_trunc(near), v_seti(l->grid.cell_last[k]));
    f[k] = near - v_float(cell[k]);
  }
  return inside;
}

static __attribute__((noinline)) label_mix labels_at(const tc_cpu_args *args, const packet *p, vf t) {
  const tc_cpu_labels *l = &args->labels;
  vi cell[3];
  vf f[3], corner[8], least, most;
  vf inside = find_label_cell(l, p, t, cell, f);
  vi off = v_addi(cell[0], v_addi(v_muli(cell[1], v_seti(l->grid.row)), v_muli(cell[2], v_seti(l->grid.slice))));
  for (int i = 0; i < 4; i++) {
    vi at = i & 1 ? v_addi(off, v_seti(l->grid.stride[1])) : off;
    if (i & 2) at = v_addi(at, v_seti(l->grid.stride[2]));
    fetch_pair(l->type, l->grid.voxels, at, &corner[2 * i], &corner[2 * i + 1]);
    if (!l->grid.stride[0]) corner[2 * i + 1] = corner[2 * i];
  }
  least = most = corner[0];
  for (int i = 1; i < 8; i++) least = v_min(least, corner[i]), most = v_max(most, corner[i]);
  label_mix m = find_label(l, corner[0]);
  if (m_any(v_lt(least, most))) { /* eight equal labels need no interpolation, which would give the same bits */
    label_mix x[4];
    for (int i = 0; i < 4; i++) {
      label_mix first = i ? find_label(l, corner[2 * i]) : m;
      x[i] = mix_labels(first, find_label(l, corner[2 * i + 1]), f[0]);
    }
    m = mix_labels(mix_labels(x[0], x[1], f[1]), mix_labels(x[2], x[3], f[1]), f[2]);
  }
  vm whole = v_le(v_set(1), inside);
  for (int c = 0; c < 4; c++) {
    vf outside = v_set(l->outside[c]);
    m.tint[c] = v_select(whole, m.tint[c], v_fma(inside, m.tint[c] - outside, outside));
  }
  vf outside = v_set(l->outside[4]);
  m.visible = v_select(whole, m.visible, v_fma(inside, m.visible - outside, outside));
  return m;
}

/* The lanes whose position at t mm has a value, outside the volume's gaps. */
V_INLINE vm has_value(const tc_cpu_args *args, const packet *p, vf t) {
  return v_le(v_set(0.5f), labels_at(args, p, t).visible);
}

/* Tints the segment around t mm, and scales its extinction by the visibility there. */
V_INLINE vf4 label_segment(const tc_cpu_args *args, const packet *p, vf t, vf4 c) {
  label_mix m = labels_at(args, p, t);
  vf share = c.a / v_max(m.visible, v_set(1e-6f)),
     keep = v_max(v_set(1) - m.tint[3] / v_max(m.visible, v_set(1e-6f)), v_set(0));
  vf *channels[3] = {&c.r, &c.g, &c.b};
  for (int k = 0; k < 3; k++) *channels[k] = v_min(v_fma(share, m.tint[k], *channels[k] * keep), c.a);
  return shorten(c, m.visible, v_lt(m.visible, v_set(1)));
}

/* The labels' tint over a slice's grey, on the slice plane or at the point of the ray nearest to the plane. */
V_INLINE vf4 label_slice(const tc_cpu_args *args, const packet *p, vf4 c) {
  label_mix m = labels_at(args, p, v_min(v_max(v_set(0) - p->start, v_set(0)), p->length));
  vf *channels[3] = {&c.r, &c.g, &c.b};
  for (int k = 0; k < 3; k++) *channels[k] = v_min(v_fma(c.a, m.tint[k], *channels[k] * (v_set(1) - m.tint[3])), c.a);
  return c;
}
