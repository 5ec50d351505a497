/* The ray caster, once, over the vector vocabulary (simd_*.h). Included by kernels_*.c after it.
 *
 * A packet of V_LANES neighbouring pixels walks its rays in lockstep: sample i of every ray is at
 * entry + i*step*dir, computed and not accumulated, so that no ray depends on what its neighbours do.
 * Segment i spans samples i-1 and i and is looked up in the pre-integration table by the field at its two ends
 * (paper 000, eq. 7 and 8); the last segment of a ray is shorter and scaled to its length. */

typedef struct packet {
  vf entry[3], dir[3]; /* index coordinates; voxels per mm */
  vf inverse[3];       /* 1 / dir */
  vf length;           /* mm inside the volume; 0 for a ray that misses */
  vm live;
} packet;

/* Along one axis the ray is inside [lo, hi] for s in [*s0, *s1] (intersected with what is there). */
V_INLINE void clip_axis(vf q, vf d, vf inverse, vf lo, vf hi, vf *s0, vf *s1) {
  vm parallel = v_lt(v_abs(d), v_set(1e-12f));
  vm inside = m_and(v_le(lo, q), v_le(q, hi));
  vf big = v_set(1e30f);
  vf a = (lo - q) * inverse, b = (hi - q) * inverse;
  vf near = v_select(parallel, v_select(inside, v_set(0) - big, big), v_min(a, b));
  vf far = v_select(parallel, v_select(inside, big, v_set(0) - big), v_max(a, b));
  *s0 = v_max(*s0, near);
  *s1 = v_min(*s1, far);
}

V_INLINE packet start_packet(const tc_cpu_args *g, int x, int y, int x1, int y1) {
  packet p;
  vf i = v_set((float)x + 0.5f) + v_lane_x(), j = v_set((float)y + 0.5f) + v_lane_y();
  vf anchor[3], view[3], norm = v_set(0);
  for (int k = 0; k < 3; k++) {
    anchor[k] = v_fma(j, v_set(g->anchor_dv[k]), v_fma(i, v_set(g->anchor_du[k]), v_set(g->anchor0[k])));
    view[k] = v_fma(j, v_set(g->view_dv[k]), v_fma(i, v_set(g->view_du[k]), v_set(g->view0[k])));
    norm = v_fma(view[k], view[k], norm);
  }
  norm = v_sqrt(norm);
  vf s0 = v_set(0) - (g->perspective ? norm : v_set(g->eye_mm)), s1 = v_set(1e30f);
  for (int k = 0; k < 3; k++) {
    vf d = view[0] * v_set(g->to_index[3 * k]);
    d = v_fma(view[1], v_set(g->to_index[3 * k + 1]), d);
    p.dir[k] = v_fma(view[2], v_set(g->to_index[3 * k + 2]), d) / norm;
    p.inverse[k] = v_set(1) / v_select(v_lt(v_abs(p.dir[k]), v_set(1e-12f)), v_set(1), p.dir[k]);
    clip_axis(anchor[k], p.dir[k], p.inverse[k], v_set(g->lo[k]), v_set(g->hi[k]), &s0, &s1);
  }
  vm inside = m_and(v_lt(i, v_set((float)x1)), v_lt(j, v_set((float)y1)));
  p.live = m_and(inside, v_lt(s0, s1));
  s0 = v_select(p.live, s0, v_set(0));
  p.length = v_select(p.live, s1 - s0, v_set(0));
  for (int k = 0; k < 3; k++) p.entry[k] = v_fma(s0, p.dir[k], anchor[k]);
  return p;
}

V_INLINE void fetch_pair(int type, const void *voxels, vi off, vf *a, vf *b) {
  switch (type) { /* a constant after inlining */
  case TC_U8: v_pair_u8(voxels, off, a, b); return;
  case TC_I8: v_pair_i8(voxels, off, a, b); return;
  case TC_U16: v_pair_u16(voxels, off, a, b); return;
  case TC_I16: v_pair_i16(voxels, off, a, b); return;
  default: v_pair_f32(voxels, off, a, b); return;
  }
}

/* Trilinear voxel value at mm t along the rays, as a table node. */
V_INLINE vf sample_node(const tc_cpu_args *g, int type, const packet *p, vf t) {
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
  vf a, b, c00, c10, c01, c11;
  fetch_pair(type, g->voxels, off, &a, &b);
  c00 = v_fma(f[0], b - a, a);
  fetch_pair(type, g->voxels, off_y, &a, &b);
  c10 = v_fma(f[0], b - a, a);
  fetch_pair(type, g->voxels, off_z, &a, &b);
  c01 = v_fma(f[0], b - a, a);
  fetch_pair(type, g->voxels, off_yz, &a, &b);
  c11 = v_fma(f[0], b - a, a);
  vf c0 = v_fma(f[1], c10 - c00, c00), c1 = v_fma(f[1], c11 - c01, c01);
  vf node = (v_fma(f[2], c1 - c0, c0) - v_set(g->value_lo)) * v_set(g->value_scale);
  return v_min(v_max(node, v_set(0)), v_set(g->node_last));
}

/* Colour and opacity of a full segment from node front to node back. */
V_INLINE vf4 classify(const tc_cpu_args *g, vf front, vf back) {
  vf low = v_min(front, back), diff = back - front, k = v_abs(diff);
  vf i = v_float(v_trunc(low)), kk = v_float(v_trunc(k));
  vf stride = v_select(v_lt(diff, v_set(0)), v_set(-g->table_stride), v_set(g->table_stride));
  vf row0 = v_fma(kk, stride, i);
  return v_bilinear(g->table, v_trunc(row0), v_trunc(row0 + stride), low - i, k - kk);
}

/* log2 and exp2 for the last segments only; relative error about 1e-6. */
V_INLINE vf log2_approx(vf x) {
  vi bits = v_bits(x), e = v_subi(v_sra(bits, 23), v_seti(127));
  vf m = v_from_bits(v_ori(v_andi(bits, v_seti(0x007fffff)), v_seti(0x3f800000)));
  vm high = v_lt(v_set(1.41421356f), m);
  m = v_select(high, m * v_set(0.5f), m);
  vf ef = v_float(e) + v_select(high, v_set(1), v_set(0));
  vf s = (m - v_set(1)) / (m + v_set(1)), s2 = s * s; /* ln m = 2 atanh(s) */
  vf series = v_fma(s2, v_fma(s2, v_fma(s2, v_set(0.41219858f), v_set(0.57707802f)), v_set(0.96179669f)), v_set(2.88539008f));
  return v_fma(s, series, ef);
}

V_INLINE vf exp2_approx(vf x) { /* x <= 0 */
  x = v_max(x, v_set(-126));
  vi n = v_trunc(x - v_set(0.5f));
  vf f = x - v_float(n);
  vf p = v_fma(f, v_fma(f, v_fma(f, v_fma(f, v_fma(f, v_set(0.00133335581f), v_set(0.00961812911f)), v_set(0.0555041087f)),
                                 v_set(0.240226507f)), v_set(0.693147181f)), v_set(1));
  return v_from_bits(v_addi(v_bits(p), v_shl(n, 23)));
}

/* The same medium over `share` (0..1) of a segment: transparency t^share, colour in proportion to the opacity. */
V_INLINE vf4 shorten(vf4 c, vf share, vm which) {
  vf clear = v_max(v_set(1) - c.a, v_set(1e-30f));
  vf alpha = v_set(1) - exp2_approx(share * log2_approx(clear));
  vf scale = v_select(v_lt(c.a, v_set(1e-4f)), share, alpha / v_max(c.a, v_set(1e-30f)));
  scale = v_select(which, scale, v_set(1));
  return (vf4){c.r * scale, c.g * scale, c.b * scale, c.a * scale};
}

/* Looks around the packet at mm t. *steps: how many whole steps every live ray may go on and stay in the cube of blocks that is
 * known of it. True when all those cubes are empty, so that the steps may be leapt; false when a ray is in a block with
 * something in it, and looking again makes no sense for that many steps. The margin of a hundredth of a voxel is far above the
 * rounding of positions (skip/skip.h). */
V_INLINE bool look_around(const tc_cpu_args *g, const packet *p, vf t, vm live, int *steps) {
  vf q[3], block[3];
  for (int k = 0; k < 3; k++) {
    q[k] = v_min(v_max(v_fma(t, p->dir[k], p->entry[k]), v_set(0)), v_set(g->last[k]));
    vf cell = v_float(v_mini(v_trunc(q[k]), v_seti(g->cell_last[k])));
    block[k] = v_float(v_trunc((cell + v_set(0.5f)) * v_set(g->inverse_block))); /* the half keeps rounding away from edges */
  }
  vi off = v_addi(v_muli(v_trunc(block[2]), v_seti(g->block_slice)), v_muli(v_trunc(block[1]), v_seti(g->block_row)));
  off = v_addi(off, v_trunc(block[0]));
  vf distance = v_float(v_bytes(g->distance, off));
  vm full = m_and(live, v_lt(distance, v_set(1)));
  vf reach = (v_max(distance, v_set(1)) - v_set(1)) * v_set(g->block), far = v_set(1e9f);
  for (int k = 0; k < 3; k++) {
    vf corner = block[k] * v_set(g->block);
    vm ahead = v_lt(v_set(0), p->dir[k]);
    vf wall = v_select(ahead, corner + reach + v_set(g->block - 0.01f), corner - reach + v_set(0.01f));
    vf mm = (wall - q[k]) * p->inverse[k];
    far = v_min(far, v_select(v_lt(v_abs(p->dir[k]), v_set(1e-12f)), v_set(1e9f), mm));
  }
  float least = v_least(v_select(live, far, v_set(1e9f))) * g->inverse_step;
  *steps = least < 1 ? 0 : least < 1e6f ? (int)least : 1000000;
  return !m_any(full);
}

/* All live rays' segments lie in a stretch of values at either end of the axis that shows nothing. */
V_INLINE bool all_zero(const tc_cpu_args *g, vf front, vf back, vm live) {
  vm below = m_and(v_lt(front, v_set(g->zero_below)), v_lt(back, v_set(g->zero_below)));
  vm above = m_and(v_lt(v_set(g->zero_above), front), v_lt(v_set(g->zero_above), back));
  return !m_any(m_andnot(live, m_or(below, above)));
}

/* One packet from its rays' entries to their ends. `leap` and `terminate` are constants of the variant. */
V_INLINE void cast_packet(const tc_cpu_args *g, int type, bool terminate, bool leap, int x, int y, int x1, int y1, vf4 *out,
                          tc_cpu_counts *counts) {
  packet p = start_packet(g, x, y, x1, y1);
  vf clear = v_set(1), front = v_set(0), back = v_set(0);
  vf4 sum = {v_set(0), v_set(0), v_set(0), v_set(0)};
  vm live = p.live;
  bool fresh = true, ahead = false; /* no front sample yet; back was sampled an iteration ahead */
  bool empty = leap;                /* nothing seen in the last segment */
  int look_at = 0;                 /* first step at which looking around may pay */
  counts->rays += (uint64_t)m_count(live);
  for (int i = 0; m_any(live); i++) {
    float t0 = (float)i * g->step_mm, t1 = (float)(i + 1) * g->step_mm;
    if (leap && empty && i >= look_at) {
      int n;
      if (!look_around(g, &p, v_set(t0), live, &n)) {
        look_at = i + n + 1;
      } else if (n) {
        i += n;
        t0 = (float)i * g->step_mm, t1 = (float)(i + 1) * g->step_mm;
        live = m_and(live, v_lt(v_set(t0), p.length));
        counts->leaps++;
        fresh = true;
        if (!m_any(live)) break;
      }
    }
    if (fresh) {
      front = sample_node(g, type, &p, v_set(t0));
      counts->samples += (uint64_t)m_count(live);
      fresh = ahead = false;
    }
    if (!ahead) back = sample_node(g, type, &p, v_min(v_set(t1), p.length));
    counts->samples += (uint64_t)m_count(live);
    /* The next sample does not wait for this segment's look-up: begun now, the two chains of loads overlap. A third less
     * time a sample; in empty stretches, where the sample would often be thrown away, it does not pay. */
    vf next = front;
    ahead = !leap || !empty;
    if (ahead) next = sample_node(g, type, &p, v_min(v_set((float)(i + 2) * g->step_mm), p.length));
    if (leap && all_zero(g, front, back, live)) {
      empty = true;
      live = m_and(live, v_lt(v_set(t1), p.length));
      front = back, back = next;
      continue;
    }
    vf4 c = classify(g, front, back);
    vm ends = v_lt(p.length, v_set(t1));
    if (m_any(ends)) c = shorten(c, v_max(p.length - v_set(t0), v_set(0)) / v_set(g->step_mm), ends);
    vf weight = v_select(live, clear, v_set(0));
    sum.r = v_fma(weight, c.r, sum.r);
    sum.g = v_fma(weight, c.g, sum.g);
    sum.b = v_fma(weight, c.b, sum.b);
    sum.a = v_fma(weight, c.a, sum.a); /* not 1 - clear: thin segments take nothing from a clear of 1 in single precision */
    clear = v_fnma(weight, c.a, clear);
    if (leap) empty = !m_any(m_and(live, v_lt(v_set(0), c.a)));
    live = m_and(live, v_lt(v_set(t1), p.length));
    if (terminate) live = m_and(live, v_le(v_set(g->termination), clear));
    front = back, back = next;
  }
  /* What lies behind a terminated ray is taken to look like what lies before: the background shows through neither, and an
   * opaque region keeps its colour exactly. Off by at most the threshold, like leaving it out. */
  vm full = v_lt(v_set(1), sum.a);
  if (terminate) full = m_or(full, v_lt(clear, v_set(g->termination)));
  vf whole = v_select(full, sum.a, v_set(1));
  *out = (vf4){sum.r / whole, sum.g / whole, sum.b / whole, sum.a / whole};
}

V_INLINE void cast_tile(const tc_cpu_args *g, int type, bool terminate, bool leap, int x0, int y0, int x1, int y1, float *out,
                        ptrdiff_t stride, tc_cpu_counts *counts) {
  for (int y = y0; y < y1; y += V_PACKET_Y)
    for (int x = x0; x < x1; x += V_PACKET_X) {
      vf4 c;
      cast_packet(g, type, terminate, leap, x, y, x1, y1, &c, counts);
      float lanes[4][V_LANES];
      v_store(lanes[0], c.r);
      v_store(lanes[1], c.g);
      v_store(lanes[2], c.b);
      v_store(lanes[3], c.a);
      for (int l = 0; l < V_LANES; l++) {
        int px = x + l % V_PACKET_X, py = y + l / V_PACKET_X;
        if (px >= x1 || py >= y1) continue;
        float *pixel = out + ((py - y0) * stride + (px - x0)) * 4;
        for (int k = 0; k < 4; k++) pixel[k] = lanes[k][l];
      }
    }
}

#define KERNEL(type, terminate, leap, name)                                                                          \
  static void name(const tc_cpu_args *g, int x0, int y0, int x1, int y1, float *out, ptrdiff_t stride,               \
                   tc_cpu_counts *counts) {                                                                          \
    cast_tile(g, type, terminate, leap, x0, y0, x1, y1, out, stride, counts);                                        \
  }
#define KERNELS(type, name)                                                                                          \
  KERNEL(type, false, false, name##_whole)                                                                           \
  KERNEL(type, true, false, name##_early)                                                                            \
  KERNEL(type, false, true, name##_whole_leap)                                                                       \
  KERNEL(type, true, true, name##_early_leap)
KERNELS(TC_U8, dvr_u8)
KERNELS(TC_I8, dvr_i8)
KERNELS(TC_U16, dvr_u16)
KERNELS(TC_I16, dvr_i16)
KERNELS(TC_F32, dvr_f32)

static tc_cpu_kernel find_kernel(const tc_plan_key *key) {
#define ROW(name) {{name##_whole, name##_whole_leap}, {name##_early, name##_early_leap}}
  static const tc_cpu_kernel dvr[TC_VOXEL_TYPE_COUNT][2][2] = {ROW(dvr_u8), ROW(dvr_i8), ROW(dvr_u16), ROW(dvr_i16),
                                                               ROW(dvr_f32)};
  if (key->mode != TC_MODE_DVR || key->voxel_type >= TC_VOXEL_TYPE_COUNT) return NULL;
  return dvr[key->voxel_type][key->termination != 0][key->skipping != 0];
}
