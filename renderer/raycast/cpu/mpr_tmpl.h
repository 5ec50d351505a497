/* Planar reformats of a packet: one sample a pixel, or a slab's greatest, least or mean value, through the window to
 * grey (raycast/slice.h; tc_slice_window in backend.h says what a node is here). Part of the template. */

/* The voxel nearest to mm t along the rays, as a node. */
V_INLINE vf sample_nearest(const tc_cpu_args *g, int type, const packet *p, vf t) {
  vi cell[3];
  for (int k = 0; k < 3; k++) {
    vf q = v_min(v_max(v_fma(t, p->dir[k], p->entry[k]), v_set(0)), v_set(g->last[k]));
    cell[k] = v_trunc(q + v_set(0.5f));
  }
  vf voxel, neighbour;
  vi off = v_addi(cell[0], v_addi(v_muli(cell[1], v_seti(g->row)), v_muli(cell[2], v_seti(g->slice))));
  fetch_pair(type, g->voxels, off, &voxel, &neighbour);
  vf node = (voxel - v_set(g->value_lo)) * v_set(g->value_scale);
  return v_min(v_max(node, v_set(0)), v_set(g->node_last));
}

V_INLINE vf sample_slice(const tc_cpu_args *g, int type, bool nearest, const packet *p, vf t) {
  return nearest ? sample_nearest(g, type, p, t) : sample_node(g, type, p, t, NULL);
}

/* From the value at the rays' entries to that of the slab. Samples lie on the plane, in whole steps from it, and at both
 * ends: a ray that has arrived there samples its end again, which changes nothing and needs no mask. The plane is always
 * among them, so that a slab around a voxel never misses its peak. */
V_INLINE vf cast_slab(const tc_cpu_args *g, int type, bool nearest, int slab, const packet *p, vf front,
                      tc_cpu_counts *counts) {
  vf steps = p->start * v_set(g->inverse_step), first = v_float(v_trunc(steps)); /* before the plane that is the next */
  first = v_select(v_le(first, steps), first + v_set(1), first);
  vf value = front, sum = v_set(0), before = v_set(0);
  vm live = p->live;
  for (int i = 0; m_any(live); i++) {
    vf at = (first + v_set((float)i)) * v_set(g->step_mm) - p->start;
    vf t = v_min(v_max(at, v_set(0)), p->length);
    vf back = sample_slice(g, type, nearest, p, t);
    counts->samples += (uint64_t)m_count(live);
    if (slab == TC_SLAB_MIP) value = v_max(value, back);
    if (slab == TC_SLAB_MINIP) value = v_min(value, back);
    if (slab == TC_SLAB_AVERAGE) sum = v_fma((t - before) * v_set(0.5f), front + back, sum);
    front = back, before = t;
    live = m_and(live, v_lt(t, p->length));
  }
  if (slab != TC_SLAB_AVERAGE) return value;
  vm some = v_lt(v_set(1e-30f), p->length);
  return v_select(some, sum / v_select(some, p->length, v_set(1)), value);
}

/* One packet. `nearest` and `slab` (0: one slice, else 1 + tc_slab_projection) are constants of the variant. */
V_INLINE void cast_slice(const tc_cpu_args *g, int type, bool nearest, int slab, int x, int y, int x1, int y1, vf4 *out,
                         tc_cpu_counts *counts) {
  packet p = start_packet(g, x, y, x1, y1);
  *out = (vf4){v_set(0), v_set(0), v_set(0), v_set(0)};
  if (!m_any(p.live)) return;
  vf value = sample_slice(g, type, nearest, &p, v_set(0));
  counts->rays += (uint64_t)m_count(p.live);
  counts->samples += (uint64_t)m_count(p.live);
  if (slab) value = cast_slab(g, type, nearest, slab - 1, &p, value, counts);
  vf grey = v_fma(value - v_set(g->window_center), v_set(g->window_gain), v_set(0.5f));
  grey = v_select(p.live, v_min(v_max(grey, v_set(0)), v_set(1)), v_set(0));
  *out = (vf4){grey, grey, grey, v_select(p.live, v_set(1), v_set(0))};
}

V_INLINE void slice_tile(const tc_cpu_args *g, int type, bool nearest, int slab, int x0, int y0, int x1, int y1,
                         float *out, ptrdiff_t stride, tc_cpu_counts *counts) {
  for (int y = y0; y < y1; y += V_PACKET_Y)
    for (int x = x0; x < x1; x += V_PACKET_X) {
      vf4 c;
      cast_slice(g, type, nearest, slab, x, y, x1, y1, &c, counts);
      store_packet(c, x, y, x1, y1, out + ((y - y0) * stride + (x - x0)) * 4, stride);
    }
}

#define SLICE_KERNEL(type, nearest, slab, name)                                                                      \
  static void name(const tc_cpu_args *g, int x0, int y0, int x1, int y1, float *out, ptrdiff_t stride,               \
                   tc_cpu_counts *counts) {                                                                          \
    slice_tile(g, type, nearest, slab, x0, y0, x1, y1, out, stride, counts);                                         \
  }
#define SLICE_KERNELS(type, nearest, name)                                                                           \
  SLICE_KERNEL(type, nearest, 0, name##_one)                                                                         \
  SLICE_KERNEL(type, nearest, 1 + TC_SLAB_MIP, name##_mip)                                                           \
  SLICE_KERNEL(type, nearest, 1 + TC_SLAB_MINIP, name##_minip)                                                       \
  SLICE_KERNEL(type, nearest, 1 + TC_SLAB_AVERAGE, name##_average)
#define SLICE_TYPE(type, name)                                                                                       \
  SLICE_KERNELS(type, false, name##_linear)                                                                          \
  SLICE_KERNELS(type, true, name##_nearest)
SLICE_TYPE(TC_U8, mpr_u8)
SLICE_TYPE(TC_I8, mpr_i8)
SLICE_TYPE(TC_U16, mpr_u16)
SLICE_TYPE(TC_I16, mpr_i16)
SLICE_TYPE(TC_F32, mpr_f32)

static tc_cpu_kernel find_slice_kernel(const tc_plan_key *key) {
#define SLICE_SLABS(name)                                                                                            \
  {                                                                                                                  \
    name##_one, [1 + TC_SLAB_MIP] = name##_mip, [1 + TC_SLAB_MINIP] = name##_minip,                                  \
                [1 + TC_SLAB_AVERAGE] = name##_average                                                               \
  }
#define SLICE_ROW(name) {SLICE_SLABS(name##_linear), SLICE_SLABS(name##_nearest)}
  static const tc_cpu_kernel mpr[TC_VOXEL_TYPE_COUNT][2][1 + TC_SLAB_PROJECTION_COUNT] = {
      SLICE_ROW(mpr_u8), SLICE_ROW(mpr_i8), SLICE_ROW(mpr_u16), SLICE_ROW(mpr_i16), SLICE_ROW(mpr_f32)};
  bool built = key->voxel_type < TC_VOXEL_TYPE_COUNT && key->slab <= TC_SLAB_PROJECTION_COUNT &&
               (key->filter == TC_FILTER_LINEAR || key->filter == TC_FILTER_NEAREST);
  return built ? mpr[key->voxel_type][key->filter == TC_FILTER_NEAREST][key->slab] : NULL;
}
