/* Several rays a pixel, and rays whose first segment is shorter (raycast/subpixel.h). Part of the template. */

V_INLINE bool phased(variant v) { return v.jitter || v.several; }

/* How much before whole steps the rays' samples lie, mm: (1 - phase) of a step. */
V_INLINE vf lag_of(const tc_cpu_args *g, variant v, const place *at) {
  vf phase = v_set(at->ray->phase);
  if (v.jitter) { /* as tc_jitter_phase() */
    vi x = v_addi(v_seti(at->x), v_trunc(v_lane_x())), y = v_addi(v_seti(at->y), v_trunc(v_lane_y()));
    vi inner = v_addi(v_muli(x, v_seti((int)TC_JITTER_X)), v_muli(y, v_seti((int)TC_JITTER_Y)));
    vi high = v_andi(v_sra(inner, 16), v_seti(0xffff));
    vi noise = v_subi(v_muli(inner, v_seti((int)TC_JITTER_TIMES)), v_muli(high, v_seti((int)TC_JITTER_LESS)));
    noise = v_addi(v_andi(v_sra(noise, 8), v_seti(0xffffff)), v_seti(1));
    phase = phase + v_float(noise) * v_set(0x1p-24f);
    phase = v_select(v_lt(v_set(1), phase), phase - v_set(1), phase);
  }
  return (v_set(1) - phase) * v_set(g->step_mm);
}

/* Mm from the rays' entries to their samples i. */
V_INLINE vf sample_mm(const tc_cpu_args *g, variant v, const packet *p, int i) {
  vf t = v_set((float)i * g->step_mm);
  return phased(v) ? v_max(t - p->lag, v_set(0)) : t;
}

/* How far the way is clear along the rays through the pixels' middles, and everything within the footprint of them with it: no ray
 * of a pixel sees anything there. */
typedef struct lead {
  vf start, clear; /* mm from the anchor; clear before start where nothing is known */
  vf room;         /* voxels by which the cube known to be empty around the start exceeds the footprint on all sides */
} lead;

/* Walks along the middles through the cubes of blocks that the distance map knows to be empty (leap_tmpl.h), each less the footprint;
 * takes no sample of the field. A step that gains less than a segment is the last. */
V_INLINE lead look_ahead(const tc_cpu_args *g, variant v, const place *at) {
  static const sub_ray middle = {0, 0, 1};
  packet p = start_packet(g, v, &(place){at->x, at->y, at->x1, at->y1, &middle});
  lead l = {.start = p.start, .clear = p.start - v_set(1), .room = v_set(-1)};
  vf t = v_set(0), margin = v_set(g->footprint + 0.01f); /* far above the rounding of positions */
  vm going = p.live;
  for (bool first = true; m_any(going); first = false) {
    vi block[3];
    vf q[3], room = v_set(1e9f), far = v_set(1e9f);
    for (int k = 0; k < 3; k++) {
      q[k] = v_min(v_max(v_fma(t, p.dir[k], p.entry[k]), v_set(0)), v_set(g->last[k]));
      vf cell = v_float(v_mini(v_trunc(q[k]), v_seti(g->cell_last[k])));
      block[k] = v_trunc((cell + v_set(0.5f)) * v_set(g->inverse_block));
    }
    vi off = v_addi(v_muli(block[2], v_seti(g->block_slice)), v_muli(block[1], v_seti(g->block_row)));
    vf reach = (v_float(v_bytes(g->distance, v_addi(off, block[0]))) - v_set(1)) * v_set(g->block);
    for (int k = 0; k < 3; k++) {
      vf corner = v_float(block[k]) * v_set(g->block), low = corner - reach, high = corner + reach + v_set(g->block);
      room = v_min(room, v_min(q[k] - low, high - q[k]) - margin);
      vf wall = v_select(v_lt(v_set(0), p.dir[k]), high - margin, low + margin);
      vm still = v_lt(v_abs(p.dir[k]), v_set(1e-12f));
      far = v_min(far, v_select(still, v_set(1e9f), (wall - q[k]) * p.inverse[k]));
    }
    going = m_and(going, m_and(v_le(v_set(0), reach), v_le(v_set(0), room)));
    if (first) l.room = v_select(going, room, l.room);
    t = v_select(going, t + far, t);
    l.clear = v_select(going, p.start + t, l.clear);
    going = m_and(going, m_and(v_lt(v_set(g->step_mm), far), v_lt(t, p.length)));
  }
  return l;
}

/* The first step that a ray of the packet may see anything in; takes rays out of *live that see nothing at all. A ray that enters
 * before its pixel's middle does needs the cube around that place to hold this stretch as well. */
V_INLINE int start_at(const tc_cpu_args *g, const lead *l, const packet *p, vm *live) {
  vf speed = v_max(v_abs(p->dir[0]), v_max(v_abs(p->dir[1]), v_abs(p->dir[2])));
  vm known = m_and(v_le((l->start - p->start) * speed, l->room), v_le(l->start, l->clear));
  vf clear = v_select(known, l->clear - p->start, v_set(0));
  *live = m_andnot(*live, m_and(known, v_le(p->length, clear)));
  float steps = v_least(v_select(*live, clear, v_set(1e9f))) * g->inverse_step;
  return steps < 1 ? 0 : steps < 1e6f ? (int)steps : 1000000;
}
