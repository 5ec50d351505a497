/* Ray-isosurface intersection: the first hit of each ray of a packet (raycast/isosurface.h).
 *
 * Each ray traverses its own cells. The ray parameter t alone determines the cell: the ray crosses the cell wall at w
 * at t = (w - entry) / dir, which is computed for each wall and never accumulated. Leaps over empty space also end at
 * the t of a wall. A ray that leaped is therefore in the same cell as a ray that walked, and empty-space skipping
 * changes no bit of the picture. */

#include <math.h>

#define NEVER 1e30f
#define MOST_REFINEMENTS 32 /* a monotone cubic takes four or five Newton steps, more with a flat inflection */

/* Each ray's current cell. */
typedef struct iso_cell {
  vf at[3];       /* index of the cell's first corner; beyond the last cell once the ray has left the volume */
  vf w[8];        /* scaled value less the iso value at the corners: +x bit 0, +y bit 1, +z bit 2 */
  vf from, until; /* mm along the ray: entry and exit */
  vf start[3], delta[3]; /* entry, and exit - entry, within the cell: 0..1 */
} iso_cell;

V_INLINE vm m_pick(vm m, vm a, vm b) { return m_or(m_and(m, a), m_andnot(b, m)); }
V_INLINE vm m_xor(vm a, vm b) { return m_or(m_andnot(a, b), m_andnot(b, a)); }
V_INLINE vm is_inside(vf w) { return v_le(v_set(0), w); }

/* The t at which rays cross the wall at index `wall` of axis k; `never` for rays parallel to the wall. */
V_INLINE vf wall_time(const packet *p, int k, vf wall, float never) {
  vm across = v_le(v_set(1e-12f), v_abs(p->dir[k]));
  return v_select(across, (wall - p->entry[k]) * p->inverse[k], v_set(never));
}

V_INLINE vf goes_up(const packet *p, int k) { return v_select(v_lt(v_set(0), p->dir[k]), v_set(1), v_set(0)); }

/* The cells that the rays are in at t, with all walls up to t crossed. */
V_INLINE void find_cells(const tc_cpu_args *args, const packet *p, vf t, vf at[3]) {
  for (int k = 0; k < 3; k++) {
    vf q = v_min(v_max(v_fma(t, p->dir[k], p->entry[k]), v_set(0)), v_set(args->grid.last[k]));
    vf c = v_float(v_trunc(q)), front = goes_up(p, k), step = front + front - v_set(1);
    /* rounding may place the position on the wrong side of a wall: the t of the wall decides */
    vm early = v_lt(t, wall_time(p, k, c + v_set(1) - front, -NEVER));
    c = v_select(early, c - step, c);
    vm late = m_andnot(v_le(wall_time(p, k, c + front, NEVER), t), early);
    at[k] = v_select(late, c + step, c);
  }
}

V_INLINE vm within(const tc_cpu_args *args, const vf at[3]) {
  vm in = v_le(v_set(0), at[0]);
  for (int k = 0; k < 3; k++)
    in = m_and(in, m_and(v_le(v_set(0), at[k]), v_le(at[k], v_set((float)args->grid.cell_last[k]))));
  return in;
}

V_INLINE void fetch_corners(const tc_cpu_args *args, variant v, iso_cell *c) {
  vi at[3];
  for (int k = 0; k < 3; k++)
    at[k] = v_trunc(v_min(v_max(c->at[k], v_set(0)), v_set((float)args->grid.cell_last[k])));
  vi off = v_addi(at[0], v_addi(v_muli(at[1], v_seti(args->grid.row)), v_muli(at[2], v_seti(args->grid.slice))));
  const v_places place = v_place(off);
  for (int zy = 0; zy < 4; zy++) {
    vf a, b;
    const ptrdiff_t further = (zy & 1) * args->grid.stride[1] + (zy >> 1) * args->grid.stride[2];
    load_pair(v.type, (const char *)args->grid.voxels + further * voxel_bytes(v.type), &place, &a, &b);
    if (!args->grid.stride[0]) b = a;
    c->w[2 * zy] = (a - v_set(args->surface.iso)) * v_set(args->surface.scale);
    c->w[2 * zy + 1] = (b - v_set(args->surface.iso)) * v_set(args->surface.scale);
  }
}

/* Rays whose cell has a corner without a value (tc_volume_gaps): such a cell has no surface. */
V_INLINE vm is_blank(const tc_cpu_args *args, const iso_cell *c) {
  vi off = v_seti(0), none = v_seti(0);
  const int step[3] = {1, args->grid.row, args->grid.slice};
  for (int k = 0; k < 3; k++)
    off = v_addi(off, v_muli(v_trunc(v_min(v_max(c->at[k], v_set(0)), v_set((float)args->grid.cell_last[k]))), v_seti(step[k])));
  vi any = none;
  for (int i = 0; i < 8; i++) {
    const int to = (i & 1) * args->grid.stride[0] + (i >> 1 & 1) * args->grid.stride[1] + (i >> 2) * args->grid.stride[2];
    any = v_addi(any, v_bytes(args->labels.grid.voxels, v_addi(off, v_seti(to))));
  }
  return v_lt(v_set(0), v_float(any));
}

/* The field at u in 0..1 between entry and exit. Eight equal corners give their value exactly. */
V_INLINE vf field_in(const iso_cell *c, vf u) {
  vf f[3], x[4], y[2];
  for (int k = 0; k < 3; k++) f[k] = v_fma(u, c->delta[k], c->start[k]);
  for (int i = 0; i < 4; i++) x[i] = v_fma(f[0], c->w[2 * i + 1] - c->w[2 * i], c->w[2 * i]);
  for (int i = 0; i < 2; i++) y[i] = v_fma(f[1], x[2 * i + 1] - x[2 * i], x[2 * i]);
  return v_fma(f[2], y[1] - y[0], y[0]);
}

/* Entry and exit in the cell's coordinates, exactly 0 or 1 on the faces that the ray crosses, so that neighbouring cells
 * agree on their common point. */
V_INLINE void place_in_cell(const tc_cpu_args *args, const packet *p, iso_cell *c) {
  for (int k = 0; k < 3; k++) {
    vf front = goes_up(p, k), back = v_set(1) - front, ends[2] = {c->from, c->until}, f[2];
    for (int i = 0; i < 2; i++) {
      vf q = v_min(v_max(v_fma(ends[i], p->dir[k], p->entry[k]), v_set(0)), v_set(args->grid.last[k]));
      f[i] = v_min(v_max(q - c->at[k], v_set(0)), v_set(1));
    }
    f[0] = v_select(v_le(c->from, wall_time(p, k, c->at[k] + back, -NEVER)), back, f[0]);
    f[1] = v_select(v_le(wall_time(p, k, c->at[k] + front, NEVER), c->until), front, f[1]);
    if (args->grid.last[k] == 0) f[0] = f[1] = v_set(0);
    c->start[k] = f[0];
    c->delta[k] = f[1] - f[0];
  }
}

/* Along the ray the field is a cubic in u; d[0] + d[1] u + d[2] u^2 is its derivative. */
V_INLINE void derive(const iso_cell *c, vf d[3]) {
  vf a[4], b[4], e[2], h[2], i[2]; /* a + b u along x; e + h u + i u^2 along y as well */
  for (int k = 0; k < 4; k++) {
    vf rise = c->w[2 * k + 1] - c->w[2 * k];
    a[k] = v_fma(rise, c->start[0], c->w[2 * k]);
    b[k] = rise * c->delta[0];
  }
  for (int k = 0; k < 2; k++) {
    vf da = a[2 * k + 1] - a[2 * k], db = b[2 * k + 1] - b[2 * k];
    e[k] = v_fma(da, c->start[1], a[2 * k]);
    h[k] = v_fma(db, c->start[1], v_fma(da, c->delta[1], b[2 * k]));
    i[k] = db * c->delta[1];
  }
  vf de = e[1] - e[0], dh = h[1] - h[0], di = i[1] - i[0];
  d[0] = v_fma(dh, c->start[2], v_fma(de, c->delta[2], h[0]));
  d[1] = v_set(2) * v_fma(di, c->start[2], v_fma(dh, c->delta[2], i[0]));
  d[2] = v_set(3) * di * c->delta[2];
}

/* Extrema of the cubic inside 0..1, ascending; 1 in place of missing ones. */
V_INLINE void find_extrema(const vf d[3], vf *first, vf *second) {
  vf half = v_set(0.5f) * d[1], disc = v_fma(half, half, v_set(0) - d[0] * d[2]);
  vf root = v_sqrt(v_max(disc, v_set(0)));
  vf q = v_set(0) - (half + v_select(v_lt(half, v_set(0)), v_set(0) - root, root));
  vf r[2] = {q / d[2], d[0] / q}; /* NaN after a division by 0 fails the comparisons below */
  for (int i = 0; i < 2; i++) {
    vm met = m_and(v_le(v_set(0), disc), m_and(v_lt(v_set(0), r[i]), v_lt(r[i], v_set(1))));
    r[i] = v_select(met, r[i], v_set(1));
  }
  *first = v_min(r[0], r[1]);
  *second = v_max(r[0], r[1]);
}

/* The first u at which the field crosses the iso value. side: rays that are inside so far; *hit: the rays of `live`
 * that have such a crossing. */
V_INLINE vf first_change(const iso_cell *c, vm side, vm live, vm *hit) {
  vf d[3], end[4] = {v_set(0), v_set(1), v_set(1), v_set(1)}, a = v_set(0), b = v_set(0), fa = v_set(0), fb = v_set(0);
  derive(c, d);
  find_extrema(d, &end[1], &end[2]);
  vm open = live; /* rays without a crossing so far */
  for (int i = 0; i < 4; i++) {
    vf f = field_in(c, end[i]);
    vm changes = m_and(open, m_xor(is_inside(f), side));
    b = v_select(changes, end[i], b);
    fb = v_select(changes, f, fb);
    open = m_andnot(open, changes);
    a = v_select(open, end[i], a);
    fa = v_select(open, f, fa);
  }
  *hit = m_andnot(live, open);
  /* Newton's method, started at the root of the chord; bisection replaces a step that leaves the bracket [a, b]. Where
   * a = b = 0 the root is the entry. */
  vm busy = m_and(*hit, v_lt(a, b));
  vf x = v_select(busy, v_fma(b - a, fa / (fa - fb), a), b);
  for (int n = 0; n < MOST_REFINEMENTS && m_any(busy); n++) {
    vf f = field_in(c, x);
    vm beyond = m_xor(is_inside(f), side);
    b = v_select(m_and(busy, beyond), x, b);
    a = v_select(m_andnot(busy, beyond), x, a);
    vf next = x - f / v_fma(x, v_fma(x, d[2], d[1]), d[0]);
    next = v_select(m_and(v_lt(a, next), v_lt(next, b)), next, v_set(0.5f) * (a + b));
    vm moves = v_lt(v_set(2e-7f), v_abs(next - x));
    x = v_select(busy, next, x);
    busy = m_and(busy, moves);
  }
  return x;
}

/* Empty-space leaping: rays in an empty block leap to the end of the empty cube around the block, whose size is the
 * distance map's entry. Returns the rays that leaped. */
V_INLINE vm leap_ahead(const tc_cpu_args *args, const packet *p, vf at[3], vf *t, vm live) {
  vf block[3], far = v_set(NEVER);
  for (int k = 0; k < 3; k++) {
    vf held = v_min(v_max(at[k], v_set(0)), v_set((float)args->grid.cell_last[k]));
    block[k] = v_float(v_trunc((held + v_set(0.5f)) * v_set(args->blocks.inverse_width))); /* as in distance_map.glsl */
  }
  vi off = v_addi(v_muli(v_trunc(block[2]), v_seti(args->blocks.slice)),
                  v_muli(v_trunc(block[1]), v_seti(args->blocks.row)));
  vf distance = v_float(v_bytes(args->blocks.values, v_addi(off, v_trunc(block[0]))));
  vm empty = m_and(live, v_lt(v_set(0), distance));
  if (!m_any(empty)) return empty;
  for (int k = 0; k < 3; k++) {
    vf front = goes_up(p, k);
    vf reach = v_select(v_lt(v_set(0), front), distance, v_set(1) - distance) * v_set(args->blocks.width);
    far = v_min(far, wall_time(p, k, v_fma(block[k], v_set(args->blocks.width), reach), NEVER));
  }
  *t = v_select(empty, v_max(*t, far), *t);
  vf there[3];
  find_cells(args, p, *t, there);
  for (int k = 0; k < 3; k++) at[k] = v_select(empty, there[k], at[k]);
  return empty;
}

/* Distances of the hits from the rays' entries in mm; *hit: rays that hit the surface. */
V_INLINE vf find_hits(const tc_cpu_args *args, variant v, const packet *p, vm *hit, tc_cpu_counts *counts) {
  iso_cell c;
  vf t = v_set(0), at_hit = v_set(0);
  vm live = p->live, side = v_lt(v_set(1), v_set(0)), fresh = live; /* side: inside; fresh: side not known yet */
  *hit = side;
  find_cells(args, p, t, c.at);
  for (int k = 0; k < 3; k++) /* rounding may put the entry outside the volume */
    c.at[k] = v_min(v_max(c.at[k], v_set(0)), v_set((float)args->grid.cell_last[k]));
  for (int step = 0; keep_marching(args, live, counts, step); step++) {
    vm look = live;
    if (v.leap) {
      vm leapt = leap_ahead(args, p, c.at, &t, m_andnot(live, fresh));
      counts->leaps += m_any(leapt);
      live = m_and(live, m_and(within(args, c.at), v_lt(t, p->length)));
      look = m_andnot(live, leapt); /* the block at the end of a leap may be empty, too */
      if (!m_any(look)) continue;
    }
    vf passed[3], until = v_set(NEVER);
    for (int k = 0; k < 3; k++) {
      passed[k] = wall_time(p, k, c.at[k] + goes_up(p, k), NEVER);
      until = v_min(until, passed[k]);
    }
    c.from = t;
    c.until = v_min(v_max(until, t), p->length);
    fetch_corners(args, v, &c);
    counts->samples += (uint64_t)m_count(look);
    vm any = is_inside(c.w[0]), all = any;
    for (int i = 1; i < 8; i++) any = m_or(any, is_inside(c.w[i])), all = m_and(all, is_inside(c.w[i]));
    vm mixed = m_andnot(any, all);
    vm blank = v.labels == TC_PLAN_GAPS ? m_and(look, is_blank(args, &c)) : m_andnot(look, look);
    vm may = m_and(look, m_or(m_or(mixed, fresh), m_xor(all, side)));
    if (m_any(may)) {
      place_in_cell(args, p, &c);
      vm begins = m_pick(mixed, is_inside(field_in(&c, v_set(0))), all);
      side = m_pick(m_and(fresh, look), begins, side);
      fresh = m_andnot(fresh, look);
      if (v.labels == TC_PLAN_GAPS) { /* behind a gap the ray's side is that at the gap's end: no surface in the gap */
        side = m_pick(blank, m_pick(mixed, is_inside(field_in(&c, v_set(1))), all), side);
        may = m_andnot(may, blank);
      }
      may = m_and(may, m_or(mixed, m_xor(all, side)));
    }
    if (m_any(may)) {
      vm changed;
      vf u = first_change(&c, side, may, &changed);
      at_hit = v_select(changed, v_fma(u, c.until - c.from, c.from), at_hit);
      *hit = m_or(*hit, changed);
      live = m_andnot(live, changed);
    }
    for (int k = 0; k < 3; k++) {
      vf front = goes_up(p, k), step = front + front - v_set(1);
      vm goes = m_and(look, v_le(passed[k], v_max(until, t)));
      c.at[k] = v_select(goes, c.at[k] + step, c.at[k]);
    }
    t = v_select(look, v_max(until, t), t);
    live = m_and(live, m_or(m_andnot(live, look), m_and(within(args, c.at), v_lt(t, p->length))));
  }
  return at_hit;
}

/* Gradient in index coordinates at t: differences between opposite faces of a cube two voxels wide around the hit. The
 * value of a face is the mean of its four corners. */
V_INLINE void surface_gradient(const tc_cpu_args *args, variant v, const packet *p, vf t, vf gradient[3]) {
  packet probe = *p; /* rays of length 0 that start at the corners */
  vf side[3][2];
  for (int k = 0; k < 3; k++) {
    vf q = v_fma(t, p->dir[k], p->entry[k]);
    for (int i = 0; i < 2; i++)
      side[k][i] = v_min(v_max(q + v_set(i ? 1.f : -1.f), v_set(0)), v_set(args->grid.last[k]));
    probe.dir[k] = gradient[k] = v_set(0);
  }
  for (int corner = 0; corner < 8; corner++) {
    for (int k = 0; k < 3; k++) probe.entry[k] = side[k][corner >> k & 1];
    vf value = sample_voxel(args, v, &probe, v_set(0));
    for (int k = 0; k < 3; k++)
      gradient[k] = corner >> k & 1 ? gradient[k] + value : gradient[k] - value;
  }
  for (int k = 0; k < 3; k++)
    gradient[k] = v_set(0.25f) * gradient[k] / v_max(side[k][1] - side[k][0], v_set(1e-20f));
}

/* Depth output: mm from the eye to the hit, infinite without a hit; the smallest of a pixel's rays. */
V_INLINE void store_depths(const tc_cpu_args *args, const packet *p, variant v, const place *at, vf t, vm hit) {
  vf i, j, view[3];
  ray_places(v, at, &i, &j);
  for (int k = 0; k < 3; k++)
    view[k] =
        v_fma(j, v_set(args->rays.view_dv[k]), v_fma(i, v_set(args->rays.view_du[k]), v_set(args->rays.view0[k])));
  vf eye = args->rays.perspective ? v_sqrt(dot(view, view)) : v_set(args->rays.eye_mm);
  float lanes[V_LANES];
  v_store(lanes, v_select(hit, p->start + t + eye, v_set(INFINITY)));
  for (int l = 0; l < V_LANES; l++) {
    int px = at->x + l % V_PACKET_X, py = at->y + l / V_PACKET_X;
    if (px >= at->x1 || py >= at->y1) continue;
    float *pixel = &args->depth[(size_t)py * (size_t)args->width + (size_t)px];
    *pixel = at->ray == args->rays.of_pixel ? lanes[l] : fminf(*pixel, lanes[l]);
  }
}

V_INLINE vf4 cast_rays(const tc_cpu_args *args, variant v, const place *at, skip_backoff *unused,
                       tc_cpu_counts *counts) {
  packet p = start_packet(args, v, at);
  vm hit;
  for (int k = 0; k < 3; k++) /* an axis of one voxel has no walls */
    if (args->grid.last[k] == 0) p.entry[k] = p.dir[k] = v_set(0);
  counts->rays += (uint64_t)m_count(p.live);
  vf t = find_hits(args, v, &p, &hit, counts), zero = v_set(0);
  if (counts->left) return (vf4){zero, zero, zero, zero};
  if (args->depth) store_depths(args, &p, v, at, t, hit);
  vf4 c = {v_set(args->surface.color[0]), v_set(args->surface.color[1]), v_set(args->surface.color[2]), v_set(1)};
  if (v.shaded && m_any(hit)) {
    vf gradient[3];
    lighting light = start_lighting(args, v, at);
    if (v.gradient == TC_GRADIENT_CELL)
      surface_gradient(args, v, &p, t, gradient);
    else
      gradient_at(args, v, &p, t, hit, gradient);
    counts->gradients += (uint64_t)m_count(hit);
    c = shade(&args->shade, &light, gradient, gradient, c);
  }
  return (vf4){v_select(hit, c.r, zero), v_select(hit, c.g, zero), v_select(hit, c.b, zero), v_select(hit, c.a, zero)};
}
