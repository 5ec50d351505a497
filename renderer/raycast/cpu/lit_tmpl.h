/* Segments that wait to be shaded by central gradients. A march only notes them, and all of a packet's are shaded together
 * whenever MOST_WAITING have gathered: the march keeps its registers, and the processor works at several segments at once. One
 * function per voxel type, called and not inlined. */

#define MOST_WAITING 16

/* A classified segment of a packet. */
typedef struct unlit {
  vf t;       /* its middle, mm along the rays */
  vf4 c;      /* colour and opacity */
  vf weight;  /* of the colour in the rays' sums */
  vm visible; /* the lanes that need a gradient */
#ifdef V_NEAR
  int base[3];     /* the lowest cell of the neighbourhood that probably holds the lanes' slopes */
  ptrdiff_t first; /* its offset; negative: there is none */
#endif
} unlit;

/* With copies of what the march has: the address of the march's own would force its variables into memory. */
typedef struct waiting {
  vf entry[3], dir[3]; /* as in packet */
  lighting light;
  vf sum[3]; /* of the shaded segments' colours */
  int n;
  unlit segments[MOST_WAITING];
} waiting;

V_INLINE void start_waiting(waiting *w, const packet *p, const lighting *l) {
  for (int k = 0; k < 3; k++) w->entry[k] = p->entry[k], w->dir[k] = p->dir[k], w->sum[k] = v_set(0);
  w->light = *l, w->n = 0;
}

#ifdef V_NEAR
/* Chooses the neighbourhood of a segment at step i, and prefetches the rows around those that the march loads. */
V_INLINE void choose_slopes(const tc_cpu_args *args, int type, const packet *p, const march *m, int i, unlit *s) {
  const ptrdiff_t bytes = voxel_bytes(type), row = bytes * args->grid.row, slice = bytes * args->grid.slice;
  float least[3];
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) least[k] = m->lo[k] + ((float)i + 0.5f) * m->rise[k];
  if (!m->near) {
    vf q[3];
    for (int k = 0; k < 3; k++) q[k] = v_fma(s->t, p->dir[k], p->entry[k]);
    least_of(q, s->visible, least);
  }
  s->first = first_slopes(args, type, least, s->base);
  if (s->first < 0) return;
  const char *const at = (const char *)args->grid.voxels + s->first * bytes;
#pragma GCC unroll 4
  for (int n = 0; n < 4; n++) {
    __builtin_prefetch(at + n * row - slice);
    __builtin_prefetch(at + n * row + 4 * slice);
    __builtin_prefetch(at + n * slice - row);
    __builtin_prefetch(at + n * slice + 4 * row);
  }
}
#endif

/* Twice the gradients of the waiting segments. By loads, the cells of all segments are found first, so that the loads of each
 * start without waiting for their addresses. */
V_INLINE void find_gradients(const tc_cpu_args *args, int type, const waiting *w, vf gradients[][3]) {
  vf q[3];
#if defined V_TAPS && !defined V_NEAR
  inner_rows rows[MOST_WAITING];
  bool inner[MOST_WAITING];
  for (int n = 0; n < w->n; n++) {
    place_at(args, w->entry, w->dir, w->segments[n].t, q);
    inner[n] = find_inner_rows(args, type, q, w->segments[n].visible, &rows[n]);
  }
#endif
  for (int n = 0; n < w->n; n++) {
    const unlit *const s = &w->segments[n];
#ifdef V_NEAR
    for (int k = 0; k < 3; k++) q[k] = v_fma(s->t, w->dir[k], w->entry[k]);
    if (__builtin_expect(s->first >= 0, 1) && near_central(args, type, s->base, s->first, q, s->visible, gradients[n])) continue;
#elif defined V_TAPS
    if (__builtin_expect(inner[n], 1)) {
      difference_rows(args, type, &rows[n], NULL, gradients[n]);
      continue;
    }
#endif
    place_at(args, w->entry, w->dir, s->t, q);
    central_of(args, type, q, s->visible, gradients[n]);
  }
}

/* Shades the waiting segments and adds their colours to the sums, in order. In rounds of few operations, because a segment's are
 * a chain: the processor then works at several segments at once. */
V_INLINE void shade_segments(const tc_cpu_args *args, int type, waiting *w) {
  facet facets[MOST_WAITING];
  vf gradients[MOST_WAITING][3];
  find_gradients(args, type, w, gradients);
  for (int k = 0; k < w->n; k++) facets[k] = facet_of(&args->shade, &w->light, gradients[k]);
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
  switch (VOXELS(type)) { /* a constant after inlining */
  case TC_U8: shade_waiting_u8(args, w); return;
  case TC_I8: shade_waiting_i8(args, w); return;
  case TC_U16: shade_waiting_u16(args, w); return;
  case TC_I16: shade_waiting_i16(args, w); return;
  default: shade_waiting_f32(args, w); return;
  }
}
