/* Drawing splats into a tile, with the ray caster's vector types: included by tile_*.c after a simd_*.h.
 *
 * A kernel of radius r voxels is a ball in index space. Near its voxel the projection is almost affine: with the 2x3 Jacobian J
 * of pixels by index coordinates, the footprint is the ellipse d' (r^2 J J' + l^2 I)^-1 d <= 1, where l widens the footprint so
 * that it contains a pixel's centre (Zwicker et al., EWA splatting, IEEE TVCG 8(3), 2002).
 *
 * Sums are integers, so that neither the order of splats nor the number of threads changes a bit. */
#pragma GCC diagnostic ignored "-Wunused-function" /* only lighting is used of the ray caster's templates */
#include "renderer/base/vector.h"
#include "renderer/raycast/cpu/packet_tmpl.h"

#include "renderer/raycast/cpu/field_tmpl.h"

#include "renderer/raycast/cpu/cubic_tmpl.h"

#include "renderer/raycast/cpu/filter_tmpl.h"

#include "renderer/raycast/cpu/preintegration_tmpl.h"

#include "renderer/raycast/cpu/shading_tmpl.h"

/* Footprints: q = a dx^2 + 2 b dx dy + c dy^2 <= 1 at dx, dy pixels from their centres. */
typedef struct ellipses {
  float a[V_LANES], b[V_LANES], c[V_LANES];
  float half[2][V_LANES]; /* half width and height of the bounding box */
} ellipses;

/* V_LANES projected splats of an entry, from `first` on. */
typedef struct batch {
  const tc_splat_entry *entry;
  uint32_t first;
  unsigned alive; /* lanes to be drawn; with culling off also those that cannot be seen */
  float x[V_LANES], y[V_LANES], z[V_LANES]; /* centres: pixels of the tile, and depth in mm */
  ellipses kernel;
  float area_ratio2[V_LANES]; /* square of the projected kernel's area over that of the widened ellipse */
  float box[4][V_LANES];      /* x0, y0, x1, y1: pixels whose centres lie in the ellipse's box; bits of integers */
} batch;

static const float lane_numbers[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};

V_INLINE vi nibble(vi word, int from) { return v_andi(v_sra(word, from), v_seti(15)); }

/* Bits of the faces of voxels at d that face the eye. */
V_INLINE vi seen_faces(const tc_splat_entry *e, const vf d[3]) {
  vi seen = v_seti(0);
  for (int k = 0; k < 3; k++) {
    vf to_eye = v_set(e->eye[k]) - d[k], one = v_from_bits(v_seti(1 << 2 * k)), two = v_from_bits(v_seti(2 << 2 * k));
    vf none = v_set(0);
    seen = v_ori(seen, v_bits(v_select(v_lt(to_eye, v_set(-0.5f)), one, none)));
    seen = v_ori(seen, v_bits(v_select(v_lt(v_set(0.5f), to_eye), two, none)));
  }
  return seen;
}

V_INLINE vf along_plane(const double p[4], const vf d[3]) {
  return v_fma(d[2], v_set((float)p[2]), v_fma(d[1], v_set((float)p[1]), d[0] * v_set((float)p[0])));
}

/* Positions on the kept side of plane i have along_plane() + plane_start() >= 0. */
V_INLINE float plane_start(const tc_splat_args *g, const tc_splat_entry *e, int i) {
  const double *p = g->planes[i];
  const int *at = e->brick.at;
  return (float)(p[3] + TC_SPLAT_BRICK * (p[0] * at[0] + p[1] * at[1] + p[2] * at[2]));
}

/* beyond: distance in voxels that a position may lie beyond a plane. */
V_INLINE vm kept_by_planes(const tc_splat_args *g, const tc_splat_entry *e, const vf d[3], vf beyond, vm alive) {
  for (uint32_t left = e->planes; left; left &= left - 1) {
    const int i = __builtin_ctz(left);
    const vf away = along_plane(g->planes[i], d) + v_set(plane_start(g, e, i));
    alive = m_and(alive, v_le(v_set(0) - beyond * v_set((float)length3(g->planes[i])), away));
  }
  return alive;
}

V_INLINE vf along(const tc_splat_args *g, int row, const vf d[3], float start) {
  const float *m = g->axis[row];
  return v_fma(d[2], v_set(m[2]), v_fma(d[1], v_set(m[1]), v_fma(d[0], v_set(m[0]), v_set(start))));
}

#include "renderer/splat/shape_tmpl.h"

/* Sets the ellipses of Jacobians with these rows, in pixels a mm. Returns area_ratio2. */
V_INLINE vf set_ellipses(const tc_splat_args *g, const vf jx[3], const vf jy[3], vf pixels, ellipses *to) {
  vf xx = v_set(0), yy = xx, xy = xx, area = xx;
  for (int k = 0; k < 3; k++) {
    xx = v_fma(jx[k], jx[k], xx), yy = v_fma(jy[k], jy[k], yy), xy = v_fma(jx[k], jy[k], xy);
  }
  for (int k = 0; k < 3; k++) { /* det J J' as a sum of squares: no cancellation for long and narrow ellipses */
    const int l = (k + 1) % 3;
    vf across = v_fnma(jx[l], jy[k], jx[k] * jy[l]);
    area = v_fma(across, across, area);
  }
  const vf scale = pixels * pixels * v_set(g->radius2), least = v_set(g->pixel_radius2);
  area = area * scale * scale, xx = xx * scale, yy = yy * scale, xy = xy * scale;
  vf inverse = v_set(1) / v_fma(least, xx + yy + least, area);
  xx = xx + least, yy = yy + least;
  v_store(to->a, yy * inverse), v_store(to->b, v_set(0) - xy * inverse), v_store(to->c, xx * inverse);
  v_store(to->half[0], v_sqrt(xx)), v_store(to->half[1], v_sqrt(yy));
  return area * inverse;
}

/* Sets the first and last pixel whose centres lie within `r` of `at`, as bits of integers. Returns the lanes that have any. */
V_INLINE vm set_reach(vf at, vf r, int size, float lo[V_LANES], float hi[V_LANES]) {
  const vf zero = v_set(0), half = v_set(0.5f);
  const vi from = v_trunc(v_min(v_max(at - r + half, zero), v_set(TC_TILE))); /* + 1 truncated is rounding up */
  const vi end = v_trunc(v_max(v_min(at + r + half, v_set((float)size)), zero));
  const vm any = v_lt(v_float(from), v_float(end));
  v_store(lo, v_select(any, v_from_bits(from), zero));
  v_store(hi, v_select(any, v_from_bits(v_subi(end, v_seti(1))), zero));
  return any;
}

/* Sets the pixels of the tile whose centres lie in the boxes of ellipses `part` times as wide. Returns the lanes that have any. */
V_INLINE vm set_box(const batch *b, const ellipses *of, const tc_splat_tile *t, float part, float box[4][V_LANES]) {
  const vm across = set_reach(v_load(b->x), v_load(of->half[0]) * v_set(part), t->width, box[0], box[2]);
  return m_and(across, set_reach(v_load(b->y), v_load(of->half[1]) * v_set(part), t->height, box[1], box[3]));
}

/* Projection of positions in view space: slopes of their rays, pixels a mm at their depths, pixels of the tile. */
typedef struct projection {
  vf u, v, scale, x, y;
} projection;

V_INLINE projection project_point(const tc_splat_args *g, const tc_splat_tile *t, const vf at[3]) {
  projection s = {v_set(0), v_set(0), v_set(g->scale), at[0], at[1]};
  if (g->perspective) {
    const vf inverse = v_set(1) / v_max(at[2], v_set(1e-20f));
    s.u = at[0] * inverse, s.v = at[1] * inverse, s.scale = s.scale * inverse;
    s.x = s.u * v_set(g->scale), s.y = s.v * v_set(g->scale);
  } else {
    s.x = s.x * s.scale, s.y = s.y * s.scale;
  }
  s.x = s.x + v_set(0.5f * g->width - (float)t->x0), s.y = s.y + v_set(0.5f * g->height - (float)t->y0);
  return s;
}

/* The lanes whose footprints can meet the tile. */
V_INLINE vm near_tile(const tc_splat_entry *e, const tc_splat_tile *t, const projection *s) {
  const vf reach = v_set(e->reach), before = v_set(0) - reach;
  const vm right = m_and(v_le(before, s->x), v_le(s->x, v_set((float)t->width) + reach));
  return m_and(right, m_and(v_le(before, s->y), v_le(s->y, v_set((float)t->height) + reach)));
}

/* False: none of the splats meets the tile. cores: set if has_cores(); may be NULL. */
V_INLINE bool project(const tc_splat_args *g, const tc_splat_entry *e, const tc_splat_tile *t, uint32_t first,
                      batch *out, ellipses *cores) {
  const uint32_t count = e->brick.first + e->brick.count - first;
  vi word = v_bits(v_load((const float *)(const void *)(e->of->words + first)));
  vf d[3] = {v_float(nibble(word, 0)), v_float(nibble(word, 4)), v_float(nibble(word, 8))};
  const vi faces = v_andi(v_sra(word, 12), v_seti(63)), seen = v_andi(faces, e->mixed ? seen_faces(e, d) : v_seti(e->seen));
  const vm lanes = v_lt(v_load(lane_numbers), v_set((float)count));
  vm facing = g->opaque ? v_lt(v_set(0), v_float(seen)) : lanes;
  const vm aslant = v_lt(v_set(0), v_float(v_andi(faces, v_seti(e->aslant))));
  const vm wanted = g->culling ? m_and(lanes, m_or(facing, aslant)) : lanes;
  if (!m_any(wanted)) return false;
  vf at[3] = {along(g, 0, d, e->at[0]), along(g, 1, d, e->at[1]), along(g, 2, d, e->at[2])};
  projection from = project_point(g, t, at);
  if (!m_any(m_and(wanted, near_tile(e, t, &from)))) return false;
  const bool shaped = has_shapes(g);
  shape own;
  if (shaped) {
    const vf eye[3] = {v_set(e->eye[0]) - d[0], v_set(e->eye[1]) - d[1], v_set(e->eye[2]) - d[2]};
    own = side_of(g, e->of->insets + first, word, eye);
    facing = m_or(facing, m_and(aslant, m_or(own.front, is_thin(word))));
    if (g->culling && !m_any(m_and(lanes, facing))) return false;
    set_shape(g, e->of->insets + first, word, eye, at, &own), from = project_point(g, t, at);
  }
  const vm inside = m_and(lanes, v_lt(v_set(g->near_mm), at[2]));
  vm alive = m_and(inside, facing);
  if (e->clipped && !e->of->cut) { /* surfaces that face away are not drawn beyond the planes: they would occlude cut faces */
    const vf none = v_set(0);
    alive = kept_by_planes(g, e, d, shaped ? v_select(own.front, v_set(g->clip_reach), none) : none, alive);
  }
  if (g->culling && !m_any(alive)) return false;
  vf jx[3], jy[3];
  for (int k = 0; k < 3; k++) {
    jx[k] = v_fnma(from.u, v_set(g->axis[2][k]), v_set(g->axis[0][k]));
    jy[k] = v_fnma(from.v, v_set(g->axis[2][k]), v_set(g->axis[1][k]));
  }
  if (shaped) {
    vf kx[3], ky[3];
    if (cores && has_cores(g)) {
      stretch(&own, own.core, jx, kx), stretch(&own, own.core, jy, ky);
      set_ellipses(g, kx, ky, from.scale, cores);
    }
    stretch(&own, own.along, jx, kx), stretch(&own, own.along, jy, ky);
    memcpy(jx, kx, sizeof jx), memcpy(jy, ky, sizeof jy);
  }
  v_store(out->area_ratio2, set_ellipses(g, jx, jy, from.scale, &out->kernel));
  v_store(out->x, from.x), v_store(out->y, from.y), v_store(out->z, v_select(alive, at[2], v_set(INFINITY)));
  const vm meets = set_box(out, &out->kernel, t, 1, out->box);
  out->entry = e, out->first = first, out->alive = m_bits(m_and(meets, g->culling ? alive : inside));
  return out->alive != 0;
}

#include "renderer/splat/cut_tmpl.h"

typedef struct reach {
  int x0, y0, x1, y1;
} reach;

V_INLINE reach reach_of(const float box[4][V_LANES], int i) {
  int at[4];
  for (int k = 0; k < 4; k++) memcpy(&at[k], &box[k][i], sizeof at[k]);
  return (reach){at[0], at[1], at[2], at[3]};
}

/* The lanes that no depth occludes by more than window_mm; in *front those of them whose cores may change a depth. */
V_INLINE unsigned not_occluded(const tc_splat_args *g, const batch *b, const tc_splat_tile *t, unsigned *front) {
  *front = b->alive;
  if (!g->culling) return b->alive;
  vi at[4], across = v_seti(TC_TILE_BLOCKS);
  vf more[2];
  for (int k = 0; k < 4; k++) at[k] = v_sra(v_bits(v_load(b->box[k])), TC_TILE_SHIFT);
  for (int k = 0; k < 2; k++) more[k] = v_float(v_subi(at[2 + k], at[k]));
  const vf z = v_load(b->z), before = z - v_set(g->window_mm), most = v_max(more[0], more[1]);
  vf far = v_gather(t->farthest_of_four, v_addi(at[0], v_muli(at[1], across)));
  const vm wide = v_lt(v_set(1), most); /* wider than two blocks: four look-ups of 2x2 blocks */
  if (b->alive & m_bits(wide)) {
    const vm one[2] = {v_lt(more[0], v_set(1)), v_lt(more[1], v_set(1))};
    for (int k = 0; k < 2; k++) /* the last two, or the only one */
      at[2 + k] = v_bits(v_select(one[k], v_from_bits(at[k]), v_from_bits(v_subi(at[2 + k], v_seti(1)))));
    for (int k = 1; k < 4; k++)
      far = v_max(far, v_gather(t->farthest_of_four, v_addi(at[k & 1 ? 2 : 0], v_muli(at[k & 2 ? 3 : 1], across))));
  }
  const vm wider = v_lt(v_set(3), most);
  unsigned left = b->alive & m_bits(v_le(before, far));
  for (unsigned rest = b->alive & ~left & m_bits(wider); rest; rest &= rest - 1) {
    const int i = __builtin_ctz(rest);
    const reach r = reach_of(b->box, i);
    if (!tc_tile_hides(t, r.x0, r.y0, r.x1, r.y1, b->z[i] - g->window_mm)) left |= 1u << i;
  }
  *front = left & m_bits(m_or(wider, v_le(z, far)));
  return left;
}

/* V_LANES columns of a footprint's pixels from x on: q is a polynomial of dy. */
typedef struct columns {
  vf dx, constant, linear, square;
} columns;

V_INLINE columns columns_of(const batch *b, const ellipses *of, int i, int x) {
  const vf dx = v_load(lane_numbers) + v_set((float)x + 0.5f - b->x[i]);
  return (columns){dx, dx * dx * v_set(of->a[i]), dx * v_set(2 * of->b[i]), v_set(of->c[i])};
}

V_INLINE vf distances(const columns *c, vf dy) { return v_fma(dy, v_fma(dy, c->square, c->linear), c->constant); }

/* dy of the centres of row y's pixels. */
V_INLINE vf first_dy(const batch *b, int i, int y) { return v_set((float)y + 0.5f - b->y[i]); }

#define POLL_SPLATS 64 /* least number of splats between polls of the halt: some ms for the widest */

V_INLINE bool halted(const tc_splat_args *g, uint32_t batches, tc_splat_tile *t) {
  if (batches * V_LANES % POLL_SPLATS == 0 && tc_halt_within(g->halt)) t->halted = true;
  return t->halted;
}

V_INLINE uint32_t batches_of(const tc_splat_entry *e) { return (e->brick.count + V_LANES - 1) / V_LANES; }

/* Draws the cores of lanes `front` into the depths. */
V_INLINE void draw_cores(const tc_splat_args *g, const batch *b, const ellipses *cores, const cuts *cut, unsigned front,
                         tc_splat_tile *t) {
  float box[4][V_LANES];
  for (unsigned left = front & m_bits(set_box(b, cores, t, g->core_share, box)); left; left &= left - 1) {
    const int i = __builtin_ctz(left);
    const reach r = reach_of(box, i);
    const vf z = v_set(b->z[i]);
    vm changed = v_lt(z, z);
    t->depths++;
    for (int x = r.x0; x <= r.x1; x += V_LANES) {
      const columns c = columns_of(b, cores, i, x);
      float *p = t->depth + r.y0 * TC_TILE_STRIDE + x;
      vf dy = first_dy(b, i, r.y0);
      for (int y = r.y0; y <= r.y1; y++, p += TC_TILE_STRIDE, dy = dy + v_set(1)) {
        const vf before = v_load(p);
        const vm nearer = not_cut(cut, i, c.dx, dy, m_and(v_lt(distances(&c, dy), v_set(g->core2)), v_lt(z, before)));
        v_store(p, v_select(nearer, z, before));
        changed = m_or(changed, nearer);
      }
    }
    if (g->culling && m_any(changed)) tc_tile_touch(t, r.x0, r.y0, r.x1, r.y1);
  }
}

/* A function of its own, so that the code for bricks without clipping stays small. */
V_ONCE void draw_clipped_cores(const tc_splat_args *g, const batch *b, const ellipses *cores, unsigned front, tc_splat_tile *t) {
  cuts cut;
  const bool any = find_cuts(g, b->entry, t, b->first, &cut);
  draw_cores(g, b, cores, any ? &cut : NULL, front, t);
}

static void draw_depths(const tc_splat_args *g, const tc_splat_entry *e, tc_splat_tile *t) {
  const uint32_t n = batches_of(e);
  t->visited += e->brick.count;
  batch own;
  ellipses cores;
  for (uint32_t i = 0; i < n; i++) {
    batch *b = t->keeps ? (batch *)(void *)t->kept + t->n_kept : &own;
    unsigned front;
    if (halted(g, i, t)) return;
    if (!project(g, e, t, e->brick.first + V_LANES * i, b, &cores)) continue;
    b->alive = not_occluded(g, b, t, &front);
    t->n_kept += t->keeps && b->alive;
    const ellipses *const of = has_cores(g) ? &cores : &b->kernel;
    if (e->clipped) draw_clipped_cores(g, b, of, front, t);
    else draw_cores(g, b, of, NULL, front, t);
  }
}

V_INLINE void add_to(float *p, vi amount) { v_store(p, v_from_bits(v_addi(v_bits(v_load(p)), amount))); }

V_INLINE void voxel_of(const tc_splat_entry *e, uint32_t splat, int at[3]) {
  const uint32_t word = e->of->words[splat];
  for (int k = 0; k < 3; k++) at[k] = e->brick.at[k] * TC_SPLAT_BRICK + (int)(word >> 4 * k & 15);
}

V_INLINE void voxel_material(const tc_splat_args *g, const tc_splat_entry *e, uint32_t splat, float rgbk[4]) {
  int at[3];
  voxel_of(e, splat, at);
  g->material.color(g->material.user, at, rgbk);
}

/* Vectors of length 0 stay 0. */
V_INLINE void normalise(vf n[3]) {
  const vf square = v_fma(n[2], n[2], v_fma(n[1], n[1], n[0] * n[0]));
  const vf scale = v_select(v_lt(v_set(0), square), v_set(1) / v_sqrt(v_max(square, v_set(1e-30f))), v_set(0));
  for (int k = 0; k < 3; k++) n[k] = n[k] * scale;
}

/* Direction of a line in LPS from the covector that lines store in place of a normal. */
V_INLINE void line_direction(const tc_splat_args *g, const vf n[3], vf way[3]) {
  const vf zero = v_set(0);
  way[0] = way[1] = way[2] = zero;
  for (int k = 0; k < 3; k++) {
    const float *m = g->covariant[k];
    const vf index = v_fma(n[2], v_set(m[2]), v_fma(n[1], v_set(m[1]), n[0] * v_set(m[0])));
    for (int r = 0; r < 3; r++) way[r] = v_fma(index, v_set(m[r]), way[r]);
  }
  normalise(way);
}

/* Normals of a batch, turned towards the eye, and the directions of its lines. */
typedef struct orientation {
  float normal[3][V_LANES], line[3][V_LANES];
} orientation;

/* Turns the normals of thin splats to the eye: a sheet's to the visible side, a line's across the line. */
V_INLINE void turn_to_eye(const tc_splat_args *g, const batch *b, const tc_splat_tile *t, vm thin, vf n[3], orientation *f) {
  const vf zero = v_set(0), one = v_set(1), what = v_float(v_sra(v_load_bytes(b->entry->of->insets + b->first), 6));
  const vf x = v_load(b->x) + v_set((float)t->x0), y = v_load(b->y) + v_set((float)t->y0);
  const vm sheet = v_lt(what, one), dot = v_lt(v_set(2), what);
  vf way[3], eye[3], away = zero, turned[3];
  line_direction(g, n, way);
  for (int k = 0; k < 3; k++) {
    eye[k] = zero - v_fma(y, v_set(g->direction_dv[k]), v_fma(x, v_set(g->direction_du[k]), v_set(g->direction0[k])));
    v_store(f->line[k], way[k]);
    way[k] = v_select(sheet, n[k], v_select(dot, zero, way[k]));
    away = v_fnma(way[k], eye[k], away);
  }
  const vf side = v_select(v_lt(zero, away), zero - one, one);
  for (int k = 0; k < 3; k++) turned[k] = v_select(sheet, n[k] * side, v_fma(away, way[k], eye[k]));
  normalise(turned);
  for (int k = 0; k < 3; k++) n[k] = v_select(thin, turned[k], n[k]);
}

/* Sets the normals and line directions of a batch; 0 for splats without a normal. */
V_INLINE void find_orientation(const tc_splat_args *g, const batch *b, const tc_splat_tile *t, orientation *f) {
  vf n[3];
  const vi word = v_bits(v_load((const float *)(const void *)(b->entry->of->words + b->first)));
  const vm thin = is_thin(word), none = v_eq(v_float(v_andi(v_sra(word, 25), v_seti(127))), v_set(127));
  unfold(word, n), to_unit(n);
  if (m_any(thin)) turn_to_eye(g, b, t, thin, n, f);
  for (int k = 0; k < 3; k++) v_store(f->normal[k], v_select(none, v_set(0), n[k]));
}

#include "renderer/splat/round_tmpl.h"

/* A splat's normal in 127ths and colour in 255ths. */
typedef struct material {
  bool round;
  rounding rounding;
  int of[6];
} material;

V_INLINE void fetch_material(const tc_splat_args *g, const batch *b, int i, const orientation *f, material *to) {
  const uint32_t splat = b->first + (uint32_t)i;
  float rgbk[4];
  for (int k = 0; k < 3; k++) to->of[k] = (int)lrintf(f->normal[k][i] * 127.f);
  to->round = g->shape_blend > 0 && is_round(g, b, i, f, &to->rounding);
  if (!g->material.color) return;
  voxel_material(g, b->entry, splat, rgbk);
  for (int k = 0; k < 3; k++) to->of[3 + k] = (int)lrintf(rgbk[k] * 255);
}

/* Adds the material times weight to the sums of the pixels from p on; dx, dy: pixels from the splat's centre. */
V_INLINE void add_weighted(const tc_splat_args *g, const material *m, vi weight, vf dx, vf dy, float *p) {
  vi n[3];
  add_to(p, weight);
  if (m->round)
    round_normal(&m->rounding, dx, dy, n);
  else
    for (int k = 0; k < 3; k++) n[k] = v_seti(m->of[k]);
  for (int k = 0; k < 3; k++) add_to(p + (TC_SUM_NORMAL + k) * TC_TILE_PLANE, v_muli(weight, n[k]));
  for (int k = 0; k < 3 && g->material.color; k++) add_to(p + (TC_SUM_COLOR + k) * TC_TILE_PLANE, v_muli(weight, v_seti(m->of[3 + k])));
}

/* With culling, attributes are fetched only if a pixel shows the splat. */
V_INLINE void add_footprint(const tc_splat_args *g, const batch *b, int i, const orientation *f, const cuts *cut, tc_splat_tile *t) {
  const reach r = reach_of(b->box, i);
  const vf z = v_set(b->z[i] - g->window_mm), inverse = v_set(1 / g->window_mm), middle = v_set(b->z[i]) * inverse,
           coreless = v_set(g->coreless_scale);
  material m;
  bool looked = false;
  for (int x = r.x0; x <= r.x1; x += V_LANES) {
    const columns c = columns_of(b, &b->kernel, i, x);
    int p = r.y0 * TC_TILE_STRIDE + x;
    vf dy = first_dy(b, i, r.y0);
    for (int y = r.y0; y <= r.y1; y++, p += TC_TILE_STRIDE, dy = dy + v_set(1)) {
      const vf before = v_load(t->depth + p), apart = v_fnma(before, inverse, middle), square = apart * apart;
      vf q = distances(&c, dy);
      q = v_select(v_le(v_set(INFINITY), before), q * coreless, v_fma(square, square, q));
      const vm seen = not_cut(cut, i, c.dx, dy, m_and(v_lt(q, v_set(1)), v_lt(z, before)));
      if (g->culling && !m_any(seen)) continue;
      if (!looked) fetch_material(g, b, i, f, &m), looked = true, t->drawn++;
      q = v_select(seen, v_max(q, v_set(0)), v_set(1));
      add_weighted(g, &m, v_bytes(g->weights, v_trunc(q * v_set(TC_WEIGHT_STEPS))), c.dx, dy, t->sums[0] + p);
    }
  }
}

V_ONCE void draw_clipped_batch(const tc_splat_args *g, const batch *b, unsigned left, const orientation *f, tc_splat_tile *t) {
  cuts cut;
  const bool any = find_cuts(g, b->entry, t, b->first, &cut);
  for (; left; left &= left - 1) add_footprint(g, b, __builtin_ctz(left), f, any ? &cut : NULL, t);
}

/* Draws lanes `left` into the sums. */
static void draw_batch(const tc_splat_args *g, const batch *b, unsigned left, tc_splat_tile *t) {
  orientation f;
  if (!left) return;
  find_orientation(g, b, t, &f);
  if (b->entry->clipped) draw_clipped_batch(g, b, left, &f, t);
  else for (; left; left &= left - 1) add_footprint(g, b, __builtin_ctz(left), &f, NULL, t);
}

#define BATCHES_AHEAD 4 /* batches between the prefetch of voxels and their use; a power of two */

V_INLINE unsigned prefetch_materials(const tc_splat_args *g, const batch *b, const tc_splat_tile *t) {
  unsigned front;
  const unsigned left = not_occluded(g, b, t, &front);
  for (unsigned more = g->material.prefetch ? left : 0; more; more &= more - 1) {
    int at[3];
    voxel_of(b->entry, b->first + (uint32_t)__builtin_ctz(more), at);
    g->material.prefetch(g->material.user, at);
  }
  return left;
}

static void draw_kept(const tc_splat_args *g, tc_splat_tile *t) {
  const batch *kept = (const batch *)(const void *)t->kept;
  unsigned left[BATCHES_AHEAD];
  const uint32_t n = (uint32_t)t->n_kept;
  for (uint32_t i = 0; i < n + BATCHES_AHEAD && !halted(g, i, t); i++) {
    if (i >= BATCHES_AHEAD) draw_batch(g, kept + (i - BATCHES_AHEAD), left[i % BATCHES_AHEAD], t);
    if (i < n) left[i % BATCHES_AHEAD] = prefetch_materials(g, kept + i, t);
  }
}

static void draw_colors(const tc_splat_args *g, const tc_splat_entry *e, tc_splat_tile *t) {
  batch b;
  unsigned front;
  for (uint32_t i = 0; i < batches_of(e) && !halted(g, i, t); i++)
    if (project(g, e, t, e->brick.first + V_LANES * i, &b, NULL)) draw_batch(g, &b, not_occluded(g, &b, t, &front), t);
}

/* ---- light ---- */

V_INLINE vf sum_at(const tc_splat_tile *t, int which, int p) { return v_float(v_bits(v_load(t->sums[which] + p))); }

static void shade_tile(const tc_splat_args *g, const tc_splat_tile *t, float *out) {
  for (int y = 0; y < t->height; y++)
    for (int x = 0; x < t->width; x += V_LANES) {
      const int p = y * TC_TILE_STRIDE + x;
      vf weight = sum_at(t, TC_SUM_WEIGHT, p), share = v_set(1) / v_max(weight, v_set(1));
      vf alpha = v_min(weight * v_set(1 / g->full_weight), v_set(1));
      alpha = v_select(v_lt(v_load(t->depth + p), v_set(INFINITY)), v_set(1), alpha); /* a core covers its pixel */
      float *to = out + (y * t->width + x) * 4;
      if (!m_any(v_lt(v_set(0), alpha))) {
        memset(to, 0, 4 * sizeof *to * (size_t)MIN(V_LANES, t->width - x));
        continue;
      }
      vf4 c = {v_set(g->color[0]), v_set(g->color[1]), v_set(g->color[2]), v_set(1)};
      if (g->material.color) {
        vf each = share * v_set(1 / 255.f);
        c.r = sum_at(t, TC_SUM_COLOR, p) * each, c.g = sum_at(t, TC_SUM_COLOR + 1, p) * each;
        c.b = sum_at(t, TC_SUM_COLOR + 2, p) * each;
      }
      if (g->shaded && m_any(v_lt(v_set(0), weight))) {
        vf n[3] = {sum_at(t, TC_SUM_NORMAL, p) * share, sum_at(t, TC_SUM_NORMAL + 1, p) * share,
                   sum_at(t, TC_SUM_NORMAL + 2, p) * share};
        vf i = v_load(lane_numbers) + v_set((float)(t->x0 + x) + 0.5f), j = v_set((float)(t->y0 + y) + 0.5f);
        lighting l = lighting_at(i, j, g->direction0, g->direction_du, g->direction_dv, g->shade.light);
        /* Normals that face away, at outlines, are turned until they are perpendicular to the view. */
        vf behind = v_min(dot(n, l.eye), v_set(0));
        for (int k = 0; k < 3; k++) n[k] = v_fnma(behind, l.eye[k], n[k]);
        c = shade(&g->shade, &l, n, n, c);
      }
      float lanes[4 * V_LANES];
      v_store_pixels(lanes, 4, (vf4){c.r * alpha, c.g * alpha, c.b * alpha, alpha});
      memcpy(to, lanes, 4 * sizeof *to * (size_t)MIN(V_LANES, t->width - x));
    }
}

#include "renderer/splat/translucent_tmpl.h"
