/* Segments that wait to be shaded by central gradients. A march only notes them, and all of a packet's are shaded together
 * whenever MOST_WAITING have gathered: the march keeps its registers, and the processor works at several segments at once. One
 * function per voxel type, called and not inlined. */

#define MOST_WAITING 16

/* Where a segment's cells lie in a neighbourhood. */
typedef struct placed {
  ptrdiff_t first; /* offset of the neighbourhood's lowest cell; negative: they do not fit one */
  vi at;           /* element numbers of the lanes' cells */
  vf f[3];         /* positions within the cells; later twice the gradient */
} placed;

/* A classified segment of a packet. */
typedef struct unlit {
  vf t;       /* its middle, mm along the rays */
  vf4 c;      /* colour and opacity */
  vf weight;  /* of the colour in the rays' sums */
  vm visible; /* the lanes that need a gradient */
  int i;      /* its step */
  placed to;
} unlit;

/* With copies of what the march has: the address of the march's own would force its variables into memory. */
typedef struct waiting {
  vf entry[3], dir[3]; /* as in packet */
  march m;
  lighting light;
  vf sum[3]; /* of the shaded segments' colours */
  int n;
  unlit segments[MOST_WAITING];
} waiting;

V_INLINE void start_waiting(waiting *w, const packet *p, const march *m, const lighting *l) {
  for (int k = 0; k < 3; k++) w->entry[k] = p->entry[k], w->dir[k] = p->dir[k], w->sum[k] = v_set(0);
  w->m = *m, w->light = *l, w->n = 0;
}

#ifdef V_NEAR
V_INLINE void place_segment(const tc_cpu_args *args, int type, const packet *w, const march *m, const unlit *s, placed *to) {
  vf q[3];
  vi cell[3];
  float least[3];
  int base[3];
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) { /* not clamped: positions beyond the volume do not fit */
    q[k] = v_fma(s->t, w->dir[k], w->entry[k]);
    cell[k] = v_trunc(q[k]);
    to->f[k] = q[k] - v_float(cell[k]);
    least[k] = m->lo[k] + ((float)s->i + 0.5f) * m->rise[k];
  }
  if (!m->near) least_of(q, s->visible, least);
  to->first = first_slopes(args, type, least, base);
  if (m_any(m_andnot(s->visible, slope_places(type, base, cell, &to->at)))) to->first = -1;
}
#endif

/* Twice the gradients of the waiting segments, in to[].f. In two rounds, so that the loads of one segment do not wait for
 * the addresses of the next. */
V_INLINE void find_gradients(const tc_cpu_args *args, int type, waiting *w) {
#ifdef V_NEAR
  const bool near = has_slopes(args, type);
#endif
  for (int k = 0; k < w->n; k++) {
    vf q[3];
#ifdef V_NEAR
    if (__builtin_expect(near && w->segments[k].to.first >= 0, 1)) {
      for (int e = 0; e < 3; e++) q[e] = w->segments[k].to.f[e];
      near_central(args, type, w->segments[k].to.first, w->segments[k].to.at, q, w->segments[k].to.f);
      continue;
    }
#endif
    for (int e = 0; e < 3; e++)
      q[e] = v_min(v_max(v_fma(w->segments[k].t, w->dir[e], w->entry[e]), v_set(0)), v_set(args->grid.last[e]));
    central_of(args, type, q, w->segments[k].visible, w->segments[k].to.f);
  }
}

/* Shades the waiting segments and adds their colours to the sums, in order. In rounds of few operations, because a segment's are
 * a chain: the processor then works at several segments at once. */
V_INLINE void shade_segments(const tc_cpu_args *args, int type, waiting *w) {
  facet facets[MOST_WAITING];
  find_gradients(args, type, w);
  for (int k = 0; k < w->n; k++) facets[k] = facet_of(&args->shade, &w->light, w->segments[k].to.f);
  vf sum[3] = {w->sum[0], w->sum[1], w->sum[2]};
  for (int k = 0; k < w->n; k++) {
    const unlit *const s = &w->segments[k];
    const vf4 c = shade_facet(&args->shade, &facets[k], s->c);
    sum[0] = v_fma(s->weight, c.r, sum[0]);
    sum[1] = v_fma(s->weight, c.g, sum[1]);
    sum[2] = v_fma(s->weight, c.b, sum[2]);
  }
  for (int k = 0; k < 3; k++) w->sum[k] = sum[k];
  w->n = 0;
}

#define SHADE_WAITING(name, type)                                                                                      \
  V_ONCE void shade_waiting_##name(const tc_cpu_args *args, waiting *w) { shade_segments(args, TYPE_##name, w); }
SIMD_VOXELS(SHADE_WAITING)

V_INLINE void shade_waiting(const tc_cpu_args *args, int type, waiting *w) {
  switch (type) { /* a constant after inlining */
  case TC_U8: shade_waiting_u8(args, w); return;
  case TC_I8: shade_waiting_i8(args, w); return;
  case TC_U16: shade_waiting_u16(args, w); return;
  case TC_I16: shade_waiting_i16(args, w); return;
  default: shade_waiting_f32(args, w); return;
  }
}
