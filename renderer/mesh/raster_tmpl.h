/* The rasteriser's inner loops over the vector vocabulary, included by raster_*.c after a simd_*.h. raster_kernels.h states
 * their contract. */
#include <math.h>
#include <string.h>

#include "renderer/mesh/raster_kernels.h"

#define ROOM (TC_CLUSTER_VERTICES + TC_CLUSTER_PAD)
#define LIST (TC_CLUSTER_TRIANGLES + TC_CLUSTER_PAD)
#define SIDE TC_RASTER_SIDE
#define PIXEL 256.0f
#define ROUND 12582912.0f /* 1.5 * 2^23: adding and subtracting it rounds numbers below 2^22 to integers */
#define REACH 4194304.0f
#define SMALL 1023.0f     /* largest extent (four pixels) for which edge functions are exact in single precision */

/* Projected vertices of a cluster: fixed-point position from the tile's corner, and nearness. */
typedef struct placed {
  float x[ROOM], y[ROOM], near[ROOM];
} placed;

V_INLINE vf lanes(void) {
  static const float number[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
  return v_load(number);
}

V_INLINE vf row(const float m[4], vf x, vf y, vf z) {
  return (v_set(m[0]) * x + v_set(m[1]) * y) + (v_set(m[2]) * z + v_set(m[3]));
}

/* ---- vertices ---- */

/* Values beyond the guard band and NaN belong to triangles that are clipped; they are never read. */
V_INLINE vf to_fixed(vf along, float middle, int corner) {
  vf held = v_min(v_max(along + v_set(middle), v_set(-REACH)), v_set(REACH));
  return (held + v_set(ROUND)) - v_set(ROUND) - v_set((float)corner * PIXEL);
}

static void place_vertices(const tc_raster_frame *f, const tc_raster_tile *t, const tc_cluster *k, placed *p) {
  const size_t room = tc_cluster_padded(k->n_vertices);
  const float *at = f->mesh->positions + 3 * (size_t)k->vertex;
  for (size_t i = 0; i < room; i += V_LANES) {
    vf x = v_load(at + i), y = v_load(at + room + i), z = v_load(at + 2 * room + i);
    vf right = row(f->to_fixed[0], x, y, z), down = row(f->to_fixed[1], x, y, z);
    vf behind = row(f->rows[2], x, y, z), near = v_set(0) - behind;
    if (f->perspective) {
      vf inverse = v_set(1) / (behind + v_set(f->reference));
      right = right * inverse, down = down * inverse, near = near * inverse;
    }
    v_store(p->x + i, to_fixed(right, f->centre_fixed[0], t->x0));
    v_store(p->y + i, to_fixed(down, f->centre_fixed[1], t->y0));
    v_store(p->near + i, near);
  }
}

/* Of a back face's corner: the nearness of what is view->behind further away. */
V_INLINE vf set_back(const tc_raster_frame *f, vf near) {
  const vf more = v_set(f->behind[1]) * (near + v_set(1));
  return (near - (v_set(f->behind[0]) + more)) / (v_set(1) + more);
}

V_INLINE bool has_behind(const tc_raster_frame *f) { return f->behind[0] > 0 || f->behind[1] > 0; }

/* ---- triangles of any size, one at a time ---- */

typedef struct corner {
  int64_t x, y; /* fixed point */
  float near;
} corner;

static int64_t floor_division(int64_t a, int64_t b) { return a / b - (a % b < 0); } /* b > 0 */

/* Range of pixels in a row whose samples are inside the edge from a to b. y: of the row's samples; x: of the first pixel's
 * sample. The edge function dx (y - ay) - dy (x - ax) is at least 0 inside a top or left edge, and at least 1 inside any
 * other edge. */
static void cut_span(const corner *a, const corner *b, int64_t x, int64_t y, int64_t *first, int64_t *last) {
  const int64_t dx = b->x - a->x, dy = b->y - a->y, own = dy < 0 || (dy == 0 && dx > 0) ? 0 : 1;
  const int64_t value = dx * (y - a->y) - dy * (x - a->x) - own;
  if (dy < 0) { /* grows to the right */
    int64_t from = -floor_division(value, -dy * (int64_t)PIXEL);
    if (from > *first) *first = from;
  } else if (dy > 0) {
    int64_t to = floor_division(value, dy * (int64_t)PIXEL);
    if (to < *last) *last = to;
  } else if (value < 0) {
    *last = -1;
  }
}

V_INLINE void add_layer(tc_raster_layers *to, size_t at, uint32_t id, float near) {
  if (to->n < to->room) to->of[to->n] = (tc_raster_layer){(uint32_t)at, id, near};
  to->n++;
}

static void collect_span(const tc_raster_tile *t, size_t at, int first, int last, float start, float step, float least,
                         float most, uint32_t number) {
  for (int i = first; i <= last; i++) {
    const float along = start + (float)i * step, below = along < least ? least : along, here = below > most ? most : below;
    if (here > t->near[at + (size_t)i]) add_layer(t->layers, at + (size_t)i, number, here);
  }
}

static void fill_span(float *near, uint32_t *id, int first, int last, float start, float step, float least, float most,
                      uint32_t number) {
  const vf mine = v_from_bits(v_seti((int)number)), end = v_set((float)last + 0.5f);
  for (int i = first; i <= last; i += V_LANES) {
    vf x = v_set((float)i) + lanes(), old = v_load(near + i);
    vf here = v_min(v_max(v_set(start) + x * v_set(step), v_set(least)), v_set(most));
    vm wins = m_and(v_lt(old, here), v_lt(x, end));
    v_store(near + i, v_select(wins, here, old));
    vf ids;
    memcpy(&ids, id + i, sizeof ids);
    ids = v_select(wins, mine, ids);
    memcpy(id + i, &ids, sizeof ids);
  }
}

static int64_t least3(int64_t a, int64_t b, int64_t c) { return a < b ? (a < c ? a : c) : b < c ? b : c; }
static int64_t most3(int64_t a, int64_t b, int64_t c) { return a > b ? (a > c ? a : c) : b > c ? b : c; }

static void draw_large(const tc_raster_frame *f, const tc_raster_tile *t, corner c[3], uint32_t number,
                       tc_raster_counts *counts) {
  int64_t area = (c[1].x - c[0].x) * (c[2].y - c[0].y) - (c[1].y - c[0].y) * (c[2].x - c[0].x);
  if (area == 0 || (t->one_sided && area > 0)) return;
  for (int i = 0; i < 3 && area > 0 && has_behind(f); i++) c[i].near = v_least(set_back(f, v_set(c[i].near)));
  if (area < 0) {
    corner other = c[1];
    c[1] = c[2], c[2] = other, area = -area;
  }
  const float least = fminf(fminf(c[0].near, c[1].near), c[2].near), most = fmaxf(fmaxf(c[0].near, c[1].near), c[2].near);
  const double db = (double)c[1].near - c[0].near, dc = (double)c[2].near - c[0].near;
  const double across = (db * (double)(c[2].y - c[0].y) - dc * (double)(c[1].y - c[0].y)) / (double)area;
  const double along = (dc * (double)(c[1].x - c[0].x) - db * (double)(c[2].x - c[0].x)) / (double)area;
  const int64_t top = least3(c[0].y, c[1].y, c[2].y), bottom = most3(c[0].y, c[1].y, c[2].y);
  for (int s = 0; s < f->n_samples; s++) {
    const int64_t x = (int64_t)f->offset[s][0], dy = (int64_t)f->offset[s][1];
    int64_t y0 = -floor_division(dy - top, (int64_t)PIXEL), y1 = floor_division(bottom - dy, (int64_t)PIXEL);
    if (y0 < 0) y0 = 0;
    if (y1 > t->height - 1) y1 = t->height - 1;
    for (int64_t j = y0; j <= y1; j++) {
      int64_t y = j * (int64_t)PIXEL + dy, first = 0, last = t->width - 1;
      for (int e = 0; e < 3; e++) cut_span(&c[e], &c[(e + 1) % 3], x, y, &first, &last);
      if (first > last) continue;
      double start = c[0].near + across * (double)(x - c[0].x) + along * (double)(y - c[0].y);
      size_t at = ((size_t)s * SIDE + (size_t)j) * SIDE;
      if (t->layers)
        collect_span(t, at, (int)first, (int)last, (float)start, (float)(across * PIXEL), least, most, number);
      else
        fill_span(t->near + at, t->id + at, (int)first, (int)last, (float)start, (float)(across * PIXEL), least, most,
                  number);
      counts->covered += (uint64_t)(last - first + 1);
    }
  }
}

static corner placed_corner(const placed *p, int i) { return (corner){(int64_t)p->x[i], (int64_t)p->y[i], p->near[i]}; }

/* ---- small triangles, a lane each ---- */

typedef struct small {
  vf ax, ay, bx, by, cx, cy, na, nb, nc; /* corners: fixed point, and nearness; the area is positive */
  vf inverse_area, least, most;
} small;

/* Edge function from p to q, less 1 for an edge that is neither top nor left. */
typedef struct edge {
  vf px, py, dx, dy, own;
} edge;

V_INLINE edge make_edge(vf px, vf py, vf qx, vf qy) {
  edge e = {px, py, qx - px, qy - py, v_set(0)};
  vm owns = m_or(v_lt(e.dy, v_set(0)), m_and(v_eq(e.dy, v_set(0)), v_lt(v_set(0), e.dx)));
  e.own = v_select(owns, v_set(0), v_set(1));
  return e;
}

V_INLINE vf area_of(vf ax, vf ay, vf bx, vf by, vf cx, vf cy) { return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax); }

V_INLINE vf edge_at(const edge *e, vf x, vf y) { return e->dx * (y - e->py) - e->dy * (x - e->px); }

/* First pixel whose sample is at or after v, and last pixel whose sample is at or before it. */
V_INLINE vf first_pixel(vf v, float offset) {
  return v_float(v_trunc((v_max(v - v_set(offset), v_set(0)) + v_set(PIXEL - 1)) * v_set(1 / PIXEL)));
}
V_INLINE vf last_pixel(vf v, float offset, int size) {
  vf whole = v_float(v_trunc((v_max(v - v_set(offset), v_set(-PIXEL)) + v_set(PIXEL)) * v_set(1 / PIXEL)));
  return v_min(whole - v_set(1), v_set((float)(size - 1)));
}

V_INLINE vf min3(vf a, vf b, vf c) { return v_min(v_min(a, b), c); }
V_INLINE vf max3(vf a, vf b, vf c) { return v_max(v_max(a, b), c); }

/* Depth test, one lane after another, since several lanes may hit one pixel. */
V_INLINE uint64_t insert(const tc_raster_tile *t, size_t plane, unsigned bits, const float *pixel, const float *near,
                         const uint32_t *name, uint32_t first_number) {
  uint64_t n = 0;
  for (; bits; bits &= bits - 1, n++) {
    int lane = __builtin_ctz(bits);
    size_t at = plane + (size_t)pixel[lane];
    if (!(near[lane] > t->near[at])) continue;
    t->near[at] = near[lane];
    t->id[at] = first_number + (name[lane] >> 24 & 127);
  }
  return n;
}

V_INLINE uint64_t collect(const tc_raster_tile *t, size_t plane, unsigned bits, const float *pixel, const float *near,
                          const uint32_t *name, uint32_t first_number) {
  uint64_t n = 0;
  for (; bits; bits &= bits - 1, n++) {
    const int lane = __builtin_ctz(bits);
    const size_t at = plane + (size_t)pixel[lane];
    if (near[lane] > t->near[at]) add_layer(t->layers, at, first_number + (name[lane] >> 24 & 127), near[lane]);
  }
  return n;
}

V_INLINE uint64_t draw_sample(const tc_raster_tile *t, const small *s, const edge e[3], vm alive, const float offset[2],
                              size_t plane, const uint32_t *name, uint32_t first_number) {
  vf x0 = first_pixel(min3(s->ax, s->bx, s->cx), offset[0]), y = first_pixel(min3(s->ay, s->by, s->cy), offset[1]);
  vf x1 = last_pixel(max3(s->ax, s->bx, s->cx), offset[0], t->width);
  vf y1 = last_pixel(max3(s->ay, s->by, s->cy), offset[1], t->height);
  float pixels[V_LANES], nears[V_LANES];
  uint64_t covered = 0;
  for (vm rows = m_and(alive, v_le(y, y1)); m_any(rows); y = y + v_set(1), rows = m_and(rows, v_le(y, y1))) {
    vf x = x0, sy = y * v_set(PIXEL) + v_set(offset[1]);
    for (vm here = m_and(rows, v_le(x, x1)); m_any(here); x = x + v_set(1), here = m_and(here, v_le(x, x1))) {
      vf sx = x * v_set(PIXEL) + v_set(offset[0]);
      vf a = edge_at(&e[0], sx, sy), b = edge_at(&e[1], sx, sy), c = edge_at(&e[2], sx, sy);
      vm in = m_and(here, v_le(v_set(0), min3(a - e[0].own, b - e[1].own, c - e[2].own)));
      if (!m_any(in)) continue;
      vf near = s->na + (b * (s->nb - s->na) + c * (s->nc - s->na)) * s->inverse_area;
      v_store(nears, v_min(v_max(near, s->least), s->most));
      v_store(pixels, y * v_set(SIDE) + x);
      covered += t->layers ? collect(t, plane, m_bits(in), pixels, nears, name, first_number)
                           : insert(t, plane, m_bits(in), pixels, nears, name, first_number);
    }
  }
  return covered;
}

/* A cluster's triangles that may cover a sample of the tile, by the way they are drawn. Small ones: the corners in fixed
 * point, turned so that the area is positive, and a name: the vertices in bytes 0 to 2, the triangle in bits 24 to 30, and bit 31 for
 * a back face. */
typedef struct worklist {
  float ax[LIST], ay[LIST], bx[LIST], by[LIST], cx[LIST], cy[LIST];
  uint32_t name[LIST];
  int large[TC_CLUSTER_TRIANGLES], n_small, n_large;
} worklist;

static void draw_small(const tc_raster_frame *f, const tc_raster_tile *t, const placed *p, const worklist *w,
                       uint32_t first_number, tc_raster_counts *counts) {
  for (int i = 0; i < w->n_small; i += V_LANES) {
    vi name, byte = v_seti(255);
    memcpy(&name, w->name + i, sizeof name);
    small s = {v_load(w->ax + i), v_load(w->ay + i), v_load(w->bx + i), v_load(w->by + i), v_load(w->cx + i), v_load(w->cy + i)};
    s.na = v_table(p->near, v_andi(name, byte)), s.nb = v_table(p->near, v_andi(v_shr(name, 8), byte));
    s.nc = v_table(p->near, v_andi(v_shr(name, 16), byte));
    if (has_behind(f)) {
      const vm back = v_lt(v_float(name), v_set(0));
      s.na = v_select(back, set_back(f, s.na), s.na), s.nb = v_select(back, set_back(f, s.nb), s.nb);
      s.nc = v_select(back, set_back(f, s.nc), s.nc);
    }
    s.inverse_area = v_set(1) / v_max(area_of(s.ax, s.ay, s.bx, s.by, s.cx, s.cy), v_set(1));
    s.least = min3(s.na, s.nb, s.nc), s.most = max3(s.na, s.nb, s.nc);
    const vm alive = v_lt(lanes(), v_set((float)(w->n_small - i)));
    const edge e[3] = {make_edge(s.bx, s.by, s.cx, s.cy), make_edge(s.cx, s.cy, s.ax, s.ay),
                       make_edge(s.ax, s.ay, s.bx, s.by)}; /* opposite of a, b, c */
    for (int k = 0; k < f->n_samples; k++)
      counts->covered += draw_sample(t, &s, e, alive, f->offset[k], (size_t)k * TC_RASTER_PIXELS, w->name + i, first_number);
  }
}

/* ---- clusters ---- */

static void sort_out(const tc_raster_frame *f, const tc_raster_tile *t, const placed *p, const uint8_t *triangles,
                     size_t room, int n, worklist *w) {
  w->n_small = w->n_large = 0;
  for (int i = 0; i < n; i += V_LANES) {
    vi a = v_load_bytes(triangles + i), b = v_load_bytes(triangles + room + i), c = v_load_bytes(triangles + 2 * room + i);
    vf ax = v_table(p->x, a), bx = v_table(p->x, b), cx = v_table(p->x, c);
    vf ay = v_table(p->y, a), by = v_table(p->y, b), cy = v_table(p->y, c);
    vf left = min3(ax, bx, cx), right = max3(ax, bx, cx), top = min3(ay, by, cy), bottom = max3(ay, by, cy);
    vm some = m_and(v_le(first_pixel(left, f->most_offset[0]), last_pixel(right, f->least_offset[0], t->width)),
                    v_le(first_pixel(top, f->most_offset[1]), last_pixel(bottom, f->least_offset[1], t->height)));
    vm small = v_le(v_max(right - left, bottom - top), v_set(SMALL));
    unsigned large = m_bits(m_andnot(some, small));
    for (; large; large &= large - 1) w->large[w->n_large++] = i + __builtin_ctz(large);
    vf area = area_of(ax, ay, bx, by, cx, cy); /* exact where small */
    vm turned = v_lt(area, v_set(0)), shown = t->one_sided ? turned : m_or(turned, v_lt(v_set(0), area));
    shown = m_and(shown, m_and(some, small));
    vi number = v_addi(v_seti(i), v_trunc(lanes()));
    vi same = v_ori(v_ori(v_shl(b, 8), v_shl(c, 16)), v_seti(INT32_MIN)), swapped = v_ori(v_shl(c, 8), v_shl(b, 16));
    vi corners = v_ori(v_ori(a, v_shl(number, 24)), v_bits(v_select(turned, v_from_bits(swapped), v_from_bits(same))));
    const int to = w->n_small;
    v_compact(w->ax + to, shown, ax), v_compact(w->ay + to, shown, ay);
    v_compact(w->bx + to, shown, v_select(turned, cx, bx)), v_compact(w->by + to, shown, v_select(turned, cy, by));
    v_compact(w->cx + to, shown, v_select(turned, bx, cx)), v_compact(w->cy + to, shown, v_select(turned, by, cy));
    v_compact(w->name + to, shown, v_from_bits(corners));
    w->n_small += m_count(shown);
  }
  for (int i = 0; i < V_LANES; i++) w->name[w->n_small + i] = 0;
}

static corner project(const tc_raster_frame *f, const tc_raster_tile *t, const double at[3]) {
  const tc_mesh_view *v = f->view;
  double behind = tc_mesh_view_row(v->depth, at), scale = v->scale, near = -behind;
  if (v->perspective) scale /= behind + v->reference, near /= behind + v->reference;
  double x = v->centre[0] + scale * tc_mesh_view_row(v->right, at), y = v->centre[1] + scale * tc_mesh_view_row(v->down, at);
  return (corner){llrint(x * PIXEL) - (int64_t)t->x0 * (int64_t)PIXEL, llrint(y * PIXEL) - (int64_t)t->y0 * (int64_t)PIXEL,
                  (float)near};
}

static void draw_cut(const tc_raster_frame *f, const tc_raster_tile *t, const tc_cluster *k, const placed *p,
                     const int vertices[3], uint32_t planes, uint32_t number, tc_raster_counts *counts) {
  const size_t room = tc_cluster_padded(k->n_vertices);
  const float *at = f->mesh->positions + 3 * (size_t)k->vertex;
  tc_clip_corner corners[TC_CLIP_MOST_CORNERS];
  corner c[TC_CLIP_MOST_CORNERS];
  for (int i = 0; i < 3; i++)
    corners[i] = (tc_clip_corner){{at[vertices[i]], at[room + (size_t)vertices[i]], at[2 * room + (size_t)vertices[i]]},
                                  vertices[i]};
  int n = tc_clip(f->view, planes, corners);
  for (int i = 0; i < n; i++)
    c[i] = corners[i].original >= 0 ? placed_corner(p, corners[i].original) : project(f, t, corners[i].at);
  for (int i = 2; i < n; i++) draw_large(f, t, (corner[]){c[0], c[i - 1], c[i]}, number, counts);
}

/* For a cluster that planes may clip: draws the clipped triangles and returns the others. */
static void draw_all_cut(const tc_raster_frame *f, const tc_raster_tile *t, const tc_cluster *k, const placed *p,
                         uint32_t planes, uint32_t first_number, uint8_t *triangles, tc_raster_counts *counts) {
  const size_t room = tc_cluster_padded(k->n_vertices), triangle_room = tc_cluster_padded(k->n_triangles);
  const float *at = f->mesh->positions + 3 * (size_t)k->vertex;
  uint32_t outside[ROOM];
  for (size_t i = 0; i < k->n_vertices; i++) {
    const double point[3] = {at[i], at[room + i], at[2 * room + i]};
    outside[i] = 0;
    for (int s = 0; s < f->view->n_planes; s++)
      if (planes >> s & 1 && !(tc_mesh_view_row(f->view->planes[s], point) >= 0)) outside[i] |= 1u << s;
  }
  memcpy(triangles, f->mesh->triangles + 3 * (size_t)k->triangle, 3 * triangle_room);
  for (size_t i = 0; i < k->n_triangles; i++) {
    const int v[3] = {triangles[i], triangles[triangle_room + i], triangles[2 * triangle_room + i]};
    uint32_t any = outside[v[0]] | outside[v[1]] | outside[v[2]], all = outside[v[0]] & outside[v[1]] & outside[v[2]];
    if (any && !all) draw_cut(f, t, k, p, v, any, first_number + (uint32_t)i, counts);
    if (any) triangles[i] = triangles[triangle_room + i] = triangles[2 * triangle_room + i] = 0; /* of no area */
  }
}

static void draw(const tc_raster_frame *f, tc_raster_tile *t, uint32_t cluster, uint32_t planes,
                 tc_raster_counts *counts) {
  const tc_cluster *k = &f->mesh->clusters[cluster];
  const size_t room = tc_cluster_padded(k->n_triangles);
  const uint8_t *triangles = f->mesh->triangles + 3 * (size_t)k->triangle;
  const uint32_t first_number = cluster * TC_CLUSTER_TRIANGLES;
  uint8_t uncut[3 * TC_CLUSTER_TRIANGLES + 16];
  placed p;
  worklist w;
  counts->drawn++;
  counts->triangles += k->n_triangles;
  place_vertices(f, t, k, &p);
  if (planes) {
    draw_all_cut(f, t, k, &p, planes, first_number, uncut, counts);
    triangles = uncut;
  }
  sort_out(f, t, &p, triangles, room, k->n_triangles, &w);
  draw_small(f, t, &p, &w, first_number, counts);
  for (int i = 0; i < w.n_large; i++) {
    const uint8_t *v = triangles + w.large[i];
    corner c[3] = {placed_corner(&p, v[0]), placed_corner(&p, v[room]), placed_corner(&p, v[2 * room])};
    draw_large(f, t, c, first_number + (uint32_t)w.large[i], counts);
  }
}
