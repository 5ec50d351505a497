/* The rasteriser's phases (raster.h): culling and counting clusters per tile, binning them into the tiles' lists, drawing. */
#include "renderer/mesh/raster.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/mesh/raster_kernels.h"
#include "renderer/mesh/sight.h"

#define CHUNK 1024   /* clusters of a task */
#define AHEAD 4
#define LOOK 8       /* clusters between two checks of the halt */
#define BUCKETS 256  /* buckets of nearness that a tile's clusters are sorted into */
#define MOST_LAYERS (1 << 18) /* most layers sorted at once; a tile with more is drawn a few rows at a time */
#define MOST_ROW (1 << 21)    /* most layers in one row of a tile, 24 bytes each; more are refused */
#define MOST_SEEN (1 << 22)   /* most visible layers emitted for a tile; more are refused */
#define MANY 1024             /* pixels with this many layers check the halt first */
#define SEEN_THROUGH (1.0f / 4096) /* layers behind less than this share of a sample's light are ignored */

typedef struct worker {
  tc_raster_tile tile;
  tc_raster_fragments fragments;
  tc_raster_counts counts;
  float (*linear)[4], *depth; /* [TC_RASTER_PIXELS] */
  uint32_t *order;            /* [longest] */
  void *memory;
  tc_raster_seen *seen;       /* only for a layered job */
  size_t n_seen, seen_room;
  int nth; /* of the pixel seen last, its layers before the last */
  int from, rows;             /* rows of the tile: the first one drawn now, and the end of the finished ones */
  tc_raster_layers layers;    /* first half: in the order found; second half: sorted by pixel */
} worker;

typedef struct drawing {
  const tc_raster_job *job;
  tc_raster_frame frame;
  double slack; /* bound on the rounding of single precision, mm */
  int tiles_x, tiles_y, n_tiles, n_chunks;
  tc_sight *sights;
  uint32_t *places;     /* [chunks][tiles]: number of clusters, then the position of the chunk's first one in the tile's list */
  size_t *first;        /* [tiles + 1] start of each tile's list */
  uint32_t *lists;
  size_t longest;
  struct tile_work {
    size_t clusters;
    int tile;
  } *work; /* [tiles], most clusters first, so that no thread begins a long tile when the others are done */
  worker *workers;
  atomic_int drawn;     /* number of tiles drawn */
  atomic_bool left;     /* some tile is unfinished */
  atomic_bool no_memory;
  bool translucent, textured; /* whether any surface is */
} drawing;

static const tc_raster_surface *surface_of(const drawing *d, size_t cluster) {
  return &d->job->surfaces[d->job->mesh->clusters[cluster].part];
}

/* ---- frame ---- */

static void copy_row(float to[4], const double from[4], double scale) {
  for (int k = 0; k < 4; k++) to[k] = (float)(from[k] * scale);
}

static void set_up_frame(drawing *d) {
  const tc_raster_job *job = d->job;
  const tc_mesh_view *v = job->view;
  tc_raster_frame *f = &d->frame;
  *f = (tc_raster_frame){.mesh = job->mesh, .view = v, .looks = job->looks, .n_looks = job->n_looks, .perspective = v->perspective,
                         .surfaces = job->surfaces, .reference = (float)v->reference,
                         .inverse_scale = (float)(1 / v->scale), .n_samples = job->n_samples};
  f->behind[v->perspective] = (float)(v->perspective ? v->behind / v->reference : v->behind);
  copy_row(f->rows[0], v->right, 1), copy_row(f->rows[1], v->down, 1), copy_row(f->rows[2], v->depth, 1);
  copy_row(f->to_fixed[0], v->right, v->scale * TC_VIEW_SUBPIXEL);
  copy_row(f->to_fixed[1], v->down, v->scale * TC_VIEW_SUBPIXEL);
  for (int k = 0; k < 2; k++) {
    f->centre[k] = (float)v->centre[k], f->centre_fixed[k] = (float)(v->centre[k] * TC_VIEW_SUBPIXEL);
    f->least_offset[k] = TC_VIEW_SUBPIXEL, f->most_offset[k] = 0;
    for (int s = 0; s < job->n_samples; s++) {
      float offset = rintf((float)(job->samples[s][k] + 0.5) * TC_VIEW_SUBPIXEL);
      f->offset[s][k] = fminf(fmaxf(offset, 0), TC_VIEW_SUBPIXEL - 1);
      f->least_offset[k] = fminf(f->least_offset[k], f->offset[s][k]);
      f->most_offset[k] = fmaxf(f->most_offset[k], f->offset[s][k]);
    }
  }
  d->slack = tc_sight_slack(job->mesh);
  f->channels = job->channels;
  for (size_t i = 0; i < job->mesh->n_parts; i++) {
    d->translucent = d->translucent || job->surfaces[i].opacity < 1;
    d->textured = d->textured || job->surfaces[i].textured;
  }
}

/* ---- clusters ---- */

static tc_sight look_at(const drawing *d, const tc_cluster *k, tc_raster_counts *counts) {
  bool away;
  if (k->level != (d->job->levels ? d->job->levels[k->group] : 0)) return (tc_sight){.x0 = 0, .x1 = -1};
  const tc_sight s = tc_sight_of(d->job->view, k, d->slack, d->job->surfaces[k->part].one_sided, &away);
  if (s.x1 < s.x0) counts->outside += !away, counts->facing_away += away;
  return s;
}

static void sight_chunk(void *context, int chunk, int worker) {
  drawing *d = context;
  uint32_t *places = d->places + (size_t)chunk * (size_t)d->n_tiles;
  size_t end = ((size_t)chunk + 1) * CHUNK;
  for (size_t i = (size_t)chunk * CHUNK; i < end && i < d->job->mesh->n; i++) {
    const tc_sight s = d->sights[i] = look_at(d, &d->job->mesh->clusters[i], &d->workers[worker].counts);
    if (s.x1 < s.x0) continue;
    for (int y = s.y0 / TC_RASTER_SIDE; y <= s.y1 / TC_RASTER_SIDE; y++)
      for (int x = s.x0 / TC_RASTER_SIDE; x <= s.x1 / TC_RASTER_SIDE; x++) places[y * d->tiles_x + x]++;
  }
}

static void list_chunk(void *context, int chunk, int worker) {
  drawing *d = context;
  uint32_t *places = d->places + (size_t)chunk * (size_t)d->n_tiles;
  size_t end = ((size_t)chunk + 1) * CHUNK;
  for (size_t i = (size_t)chunk * CHUNK; i < end && i < d->job->mesh->n; i++) {
    const tc_sight *s = &d->sights[i];
    if (s->x1 < s->x0) continue;
    for (int y = s->y0 / TC_RASTER_SIDE; y <= s->y1 / TC_RASTER_SIDE; y++)
      for (int x = s->x0 / TC_RASTER_SIDE; x <= s->x1 / TC_RASTER_SIDE; x++) {
        int tile = y * d->tiles_x + x;
        d->lists[d->first[tile] + places[tile]++] = (uint32_t)i;
      }
  }
}

/* Turns counts into positions in the tiles' lists. Returns the total length of all lists. */
static size_t sum_places(drawing *d) {
  size_t all = 0;
  for (int t = 0; t < d->n_tiles; t++) {
    size_t at = 0;
    for (int c = 0; c < d->n_chunks; c++) {
      uint32_t *place = &d->places[(size_t)c * (size_t)d->n_tiles + (size_t)t], n = *place;
      *place = (uint32_t)at;
      at += n;
    }
    d->first[t] = all;
    all += at;
    d->longest = at > d->longest ? at : d->longest;
  }
  d->first[d->n_tiles] = all;
  return all;
}

static int by_clusters(const void *a, const void *b) {
  const struct tile_work *x = a, *y = b;
  if (x->clusters != y->clusters) return x->clusters > y->clusters ? -1 : 1;
  return x->tile - y->tile;
}

static void order_tiles(drawing *d) {
  for (int t = 0; t < d->n_tiles; t++) d->work[t] = (struct tile_work){d->first[t + 1] - d->first[t], t};
  qsort(d->work, (size_t)d->n_tiles, sizeof *d->work, by_clusters);
}

/* ---- tiles ---- */

/* Sorts a tile's clusters nearest first, to the resolution of the buckets. */
static void sort_list(const drawing *d, const uint32_t *list, size_t n, uint32_t *order) {
  float lo = INFINITY, hi = -INFINITY;
  uint32_t at[BUCKETS + 1] = {0};
  for (size_t i = 0; i < n; i++) {
    float near = d->sights[list[i]].nearest;
    lo = near < lo ? near : lo;
    hi = near > hi && near < INFINITY ? near : hi;
  }
  const float scale = hi > lo ? (BUCKETS - 1) / (hi - lo) : 0;
#define BUCKET(cluster) ((size_t)((hi - (d->sights[cluster].nearest < hi ? d->sights[cluster].nearest : hi)) * scale))
  for (size_t i = 0; i < n && hi >= lo; i++) at[BUCKET(list[i]) + 1]++;
  for (int b = 0; b < BUCKETS; b++) at[b + 1] += at[b];
  for (size_t i = 0; i < n; i++) order[hi >= lo ? at[BUCKET(list[i])]++ : i] = list[i];
}

static float farthest_of(const tc_raster_tile *t, int n_samples, int bx, int by) {
  float least[TC_RASTER_BLOCK], all = INFINITY;
  for (int x = 0; x < TC_RASTER_BLOCK; x++) least[x] = INFINITY;
  for (int s = 0; s < n_samples; s++)
    for (int y = by * TC_RASTER_BLOCK; y < (by + 1) * TC_RASTER_BLOCK; y++) {
      const float *row = t->near + ((size_t)s * TC_RASTER_SIDE + (size_t)y) * TC_RASTER_SIDE + bx * TC_RASTER_BLOCK;
      for (int x = 0; x < TC_RASTER_BLOCK; x++) least[x] = row[x] < least[x] ? row[x] : least[x];
    }
  for (int x = 0; x < TC_RASTER_BLOCK; x++) all = least[x] < all ? least[x] : all;
  return all;
}

typedef struct block_range {
  int x0, y0, x1, y1;
} block_range;

static block_range blocks_of(const tc_raster_tile *t, const tc_sight *s) {
  int x0 = s->x0 - t->x0, y0 = s->y0 - t->y0, x1 = s->x1 - t->x0, y1 = s->y1 - t->y0;
  return (block_range){(x0 > 0 ? x0 : 0) / TC_RASTER_BLOCK, (y0 > 0 ? y0 : 0) / TC_RASTER_BLOCK,
                       (x1 < t->width ? x1 : t->width - 1) / TC_RASTER_BLOCK,
                       (y1 < t->height ? y1 : t->height - 1) / TC_RASTER_BLOCK};
}

/* Whether every sample that the cluster may touch already shows something at least as near. */
static bool is_hidden(tc_raster_tile *t, int n_samples, const tc_sight *s, block_range r) {
  for (int y = r.y0; y <= r.y1; y++)
    for (int x = r.x0; x <= r.x1; x++) {
      int b = y * TC_RASTER_BLOCKS + x;
      if (t->stale >> b & 1) t->far[b] = farthest_of(t, n_samples, x, y);
      t->stale &= ~((uint64_t)1 << b);
      if (!(t->far[b] >= s->nearest)) return false;
    }
  return true;
}

static void begin_tile(const drawing *d, tc_raster_tile *t, int tile) {
  const tc_mesh_view *v = d->job->view;
  t->x0 = tile % d->tiles_x * TC_RASTER_SIDE, t->y0 = tile / d->tiles_x * TC_RASTER_SIDE;
  t->width = v->width - t->x0 < TC_RASTER_SIDE ? v->width - t->x0 : TC_RASTER_SIDE;
  t->height = v->height - t->y0 < TC_RASTER_SIDE ? v->height - t->y0 : TC_RASTER_SIDE;
  t->stale = 0;
  for (int b = 0; b < TC_RASTER_BLOCKS * TC_RASTER_BLOCKS; b++) t->far[b] = -INFINITY;
  for (size_t i = 0; i < (size_t)d->job->n_samples * TC_RASTER_PIXELS; i++)
    t->near[i] = (int)(i % TC_RASTER_SIDE) < t->width && (int)(i / TC_RASTER_SIDE % TC_RASTER_SIDE) < t->height ? -INFINITY : INFINITY;
  memset(t->id, 0xff, (size_t)d->job->n_samples * TC_RASTER_PIXELS * sizeof *t->id);
}

static void shade_fragments(drawing *d, worker *w);
static inline void add_opaque(drawing *d, worker *w, int x, int y);

/* Forward shading: shades the samples where the last drawn cluster is visible. */
static void shade_cluster(drawing *d, worker *w, uint32_t cluster, block_range r) {
  const int x1 = MIN((r.x1 + 1) * TC_RASTER_BLOCK, w->tile.width), y1 = MIN((r.y1 + 1) * TC_RASTER_BLOCK, w->tile.height);
  for (int y = r.y0 * TC_RASTER_BLOCK; y < y1; y++)
    for (int x = r.x0 * TC_RASTER_BLOCK; x < x1; x++) {
      const int at = y * TC_RASTER_SIDE + x;
      if (w->tile.id[at] / TC_CLUSTER_TRIANGLES != cluster) continue;
      memset(w->linear[at], 0, sizeof w->linear[at]);
      w->depth[at] = INFINITY;
      add_opaque(d, w, x, y);
    }
  shade_fragments(d, w);
}

static bool is_too_much(const tc_raster_tile *t) {
  return t->layers && t->layers->n > (t->height > 1 ? MOST_LAYERS : MOST_ROW);
}

/* A tile's clusters lie apart in memory: fetches the record of one to be drawn soon and the data of the next but few. */
static void prefetch(const tc_clusters *mesh, const uint32_t *order, size_t left) {
  if (left > 2 * AHEAD) __builtin_prefetch(&mesh->clusters[order[2 * AHEAD]]);
  if (left <= AHEAD) return;
  const tc_cluster *k = &mesh->clusters[order[AHEAD]];
  const float *at = mesh->positions + 3 * (size_t)k->vertex;
  for (size_t i = 0; i < 3 * (size_t)k->n_vertices; i += 16) __builtin_prefetch(at + i);
  for (size_t i = 0; i < 3 * (size_t)k->n_triangles; i += 64) __builtin_prefetch(mesh->triangles + 3 * (size_t)k->triangle + i);
}

/* Draws a tile's opaque or translucent clusters into the rows of `to`, which is the tile or a part of it. Returns the number
 * of clusters processed; less than n if halted or if there are too many layers. */
static size_t draw_clusters(drawing *d, worker *w, size_t n, tc_raster_tile *to) {
  tc_raster_tile *t = &w->tile;
  for (size_t i = 0; i < n; i++) {
    const tc_sight *s = &d->sights[w->order[i]];
    prefetch(d->job->mesh, w->order + i, n - i);
    const tc_raster_surface *surface = &d->job->surfaces[s->part];
    if (i % LOOK == LOOK - 1 && tc_halt_within(tc_pool_halt(d->job->pool))) return i;
    if ((surface->opacity < 1) != (to->layers != NULL) || s->y1 < to->y0 || s->y0 >= to->y0 + to->height) continue;
    const block_range r = blocks_of(t, s);
    if (!d->job->forward && is_hidden(t, d->job->n_samples, s, r)) {
      w->counts.hidden++;
      continue;
    }
    to->one_sided = surface->one_sided;
    d->job->kernels->draw(&d->frame, to, w->order[i], s->planes, &w->counts);
    for (int y = r.y0; y <= r.y1 && !to->layers; y++)
      t->stale |= (((uint64_t)2 << r.x1) - ((uint64_t)1 << r.x0)) << y * TC_RASTER_BLOCKS;
    if (d->job->forward) shade_cluster(d, w, w->order[i], r);
    if (is_too_much(to)) return i + 1;
  }
  return n;
}

/* ---- translucent layers ---- */

/* Makes room for n layers and a quarter more. */
static bool make_room(drawing *d, tc_raster_layers *layers, size_t n) {
  const size_t room = n + n / 4 < MOST_ROW ? n + n / 4 : MOST_ROW;
  const bool fits = tc_ledger_take(d->job->ledger, 2 * (room - layers->room) * sizeof *layers->of);
  tc_raster_layer *of = fits ? realloc(layers->of, 2 * room * sizeof *of) : NULL;
  if (of) layers->of = of, layers->room = room;
  return of != NULL;
}

/* ---- shading ---- */

/* Point on the ray through a fragment's centre at a given depth. */
static void texture_fragments(const drawing *d, tc_raster_fragments *f) {
  const tc_mesh_view *v = d->job->view;
  for (int i = 0; i < f->n; i++) {
    if (!surface_of(d, f->id[i] / TC_CLUSTER_TRIANGLES)->textured) continue;
    const double right = ((double)f->x[i] - v->centre[0]) / v->scale, down = ((double)f->y[i] - v->centre[1]) / v->scale;
    const double along = v->perspective ? f->depth[i] / sqrt(1 + right * right + down * down) : f->depth[i];
    const double aside = v->perspective ? along : 1;
    double at[3];
    float color[3];
    for (int k = 0; k < 3; k++) at[k] = v->eye[k] + along * v->forward[k] + aside * (right * v->right[k] + down * v->down[k]);
    d->job->texture(d->job->texture_user, at, color);
    for (int c = 0; c < 3; c++) f->color[c][i] = color[c];
  }
}

static void keep_seen(drawing *d, worker *w) {
  const tc_raster_fragments *f = &w->fragments;
  if (w->n_seen + TC_RASTER_BATCH > w->seen_room) {
    const size_t room = 2 * w->seen_room + TC_RASTER_PIXELS;
    const bool fits = room <= MOST_SEEN && tc_ledger_take(d->job->ledger, (room - w->seen_room) * sizeof *w->seen);
    tc_raster_seen *seen = fits ? realloc(w->seen, room * sizeof *seen) : NULL;
    if (seen)
      w->seen = seen, w->seen_room = room;
    else
      atomic_store(&d->no_memory, true);
  }
  for (int i = 0; i < f->n && w->n_seen < w->seen_room; i++) {
    const int pixel = f->pixel[i] - w->from * TC_RASTER_SIDE;
    w->nth = w->n_seen && w->seen[w->n_seen - 1].pixel == pixel ? w->nth + 1 : 0;
    if (w->nth < d->job->layered)
      w->seen[w->n_seen++] = (tc_raster_seen){pixel, {f->color[0][i], f->color[1][i], f->color[2][i]},
                                              surface_of(d, f->id[i] / TC_CLUSTER_TRIANGLES)->opacity, f->depth[i]};
  }
}

static void shade_fragments(drawing *d, worker *w) {
  tc_raster_fragments *f = &w->fragments;
  if (!f->n) return;
  d->job->kernels->shade(&d->frame, f);
  if (d->textured) texture_fragments(d, f);
  w->counts.shaded += (uint64_t)f->n, w->counts.colored += (uint64_t)f->n_colored;
  for (int i = 0; i < f->n; i++) {
    float *to = w->linear[f->pixel[i]], *depth = &w->depth[f->pixel[i]];
    for (int c = 0; c < 3; c++) to[c] += f->share[i] * f->color[c][i];
    to[3] += f->share[i];
    if (d->job->n_samples == 1) *depth = f->depth[i] < *depth ? f->depth[i] : *depth;
  }
  if (d->job->layered) keep_seen(d, w);
  f->n = 0;
}

/* Adds a fragment: a triangle's share of a pixel (opacity included), at `offset` from the pixel's centre in fixed-point units. */
typedef struct sighting {
  uint32_t id;
  float share, offset[2];
} sighting;

static void add_fragment(drawing *d, worker *w, int x, int y, sighting seen) {
  const float *offset = seen.offset;
  tc_raster_fragments *f = &w->fragments;
  f->id[f->n] = seen.id;
  f->pixel[f->n] = y * TC_RASTER_SIDE + x;
  f->share[f->n] = seen.share;
  f->x[f->n] = (float)(w->tile.x0 + x) + offset[0] * (1.0f / TC_VIEW_SUBPIXEL);
  f->y[f->n] = (float)(w->tile.y0 + y) + offset[1] * (1.0f / TC_VIEW_SUBPIXEL);
  if (++f->n == TC_RASTER_BATCH) shade_fragments(d, w);
}

/* Of several samples the nearest has the pixel's depth, which nearness gives: a fragment's own depth is in the middle of its
 * samples. */
static void add_depth(const drawing *d, worker *w, int x, int y, int sample, float near) {
  const tc_mesh_view *v = d->job->view;
  const float *offset = d->frame.offset[sample];
  const double right = (w->tile.x0 + x + (double)offset[0] / TC_VIEW_SUBPIXEL - v->centre[0]) / v->scale;
  const double down = (w->tile.y0 + y + (double)offset[1] / TC_VIEW_SUBPIXEL - v->centre[1]) / v->scale;
  const double depth = v->perspective ? v->reference / (1 + (double)near) * sqrt(1 + right * right + down * down)
                                      : v->reference - (double)near;
  float *nearest = &w->depth[y * TC_RASTER_SIDE + x];
  *nearest = fminf(*nearest, (float)depth);
}

/* What samples of a pixel see, triangle by triangle. share: in samples, opacity included. */
typedef struct samples_seen {
  int n;
  struct { uint32_t id; float share, n, offset[2]; } of[TC_RASTER_SAMPLES];
} samples_seen;

static void see(const drawing *d, samples_seen *seen, uint32_t id, int sample, float share) {
  const float *offset = d->frame.offset[sample];
  int i = 0;
  while (i < seen->n && seen->of[i].id != id) i++;
  if (i == seen->n) memset(&seen->of[i], 0, sizeof seen->of[i]), seen->of[i].id = id, seen->n++;
  seen->of[i].share += share, seen->of[i].n++;
  for (int k = 0; k < 2; k++) seen->of[i].offset[k] += offset[k];
}

/* Adds each triangle once, at the mean of its samples, which lies inside the triangle. */
static void add_seen(drawing *d, worker *w, int x, int y, const samples_seen *seen) {
  for (int i = 0; i < seen->n; i++) {
    const float n = seen->of[i].n, *offset = seen->of[i].offset;
    add_fragment(d, w, x, y, (sighting){seen->of[i].id, seen->of[i].share / (float)d->job->n_samples, {offset[0] / n, offset[1] / n}});
  }
}

/* clear: transparency of what each sample sees before; NULL: 1. */
static void add_opaque_samples(drawing *d, worker *w, int x, int y, const float *clear) {
  samples_seen seen = {.n = 0};
  for (int s = 0; s < d->job->n_samples; s++) {
    const size_t at = ((size_t)s * TC_RASTER_SIDE + (size_t)y) * TC_RASTER_SIDE + (size_t)x;
    const uint32_t id = w->tile.id[at];
    if (id == TC_RASTER_NOTHING) continue;
    if (d->job->want_depth && d->job->n_samples > 1) add_depth(d, w, x, y, s, w->tile.near[at]);
    if (!clear || clear[s] >= SEEN_THROUGH) see(d, &seen, id, s, clear ? clear[s] : 1);
  }
  add_seen(d, w, x, y, &seen);
}

static inline void add_opaque(drawing *d, worker *w, int x, int y) {
  const uint32_t id = w->tile.id[y * TC_RASTER_SIDE + x];
  if (d->job->n_samples > 1)
    add_opaque_samples(d, w, x, y, NULL);
  else if (id != TC_RASTER_NOTHING)
    add_fragment(d, w, x, y, (sighting){id, 1, {d->frame.offset[0][0], d->frame.offset[0][1]}});
}

/* Shades a pixel with translucent layers. Samples that see the same triangle as their first layer share its colour, then those
 * that see it as their second, and so on: as layers drawn one after another can, so that gl gives the same picture. */
static void add_layers(drawing *d, worker *w, int x, int y, tc_raster_layer *of, size_t n) {
  const int n_samples = d->job->n_samples;
  float clear[TC_RASTER_SAMPLES];
  size_t next[TC_RASTER_SAMPLES], end[TC_RASTER_SAMPLES], left = n;
  samples_seen seen;
  tc_raster_layers_by_depth(of, n);
  for (size_t s = 0, at = 0; s < (size_t)n_samples; s++) {
    clear[s] = 1, next[s] = at;
    while (at < n && of[at].at / TC_RASTER_PIXELS == s) at++;
    end[s] = at;
    if (n_samples > 1 && d->job->want_depth && next[s] < at) add_depth(d, w, x, y, (int)s, of[next[s]].near);
  }
  for (; left; add_seen(d, w, x, y, &seen)) {
    seen.n = 0;
    for (int s = 0; s < n_samples; s++) {
      if (next[s] == end[s]) continue;
      const uint32_t id = of[next[s]++].id;
      const float opacity = surface_of(d, id / TC_CLUSTER_TRIANGLES)->opacity;
      if (clear[s] >= SEEN_THROUGH) see(d, &seen, id, s, clear[s] * opacity);
      clear[s] *= 1 - opacity, left--;
    }
  }
  add_opaque_samples(d, w, x, y, clear);
}

/* Draws rows [y0, y1) of the tile with their layers. Returns false if halted before row w->rows. */
static bool shade_rows(drawing *d, worker *w, int y0, int y1) {
  uint32_t first[TC_RASTER_PIXELS + 1];
  tc_raster_layer *of = w->layers.n ? tc_raster_layers_by_pixel(&w->layers, first) : NULL;
  for (int y = y0; y < y1; w->rows = ++y) {
    if (tc_halt_within(tc_pool_halt(d->job->pool))) return false;
    for (int x = 0; x < w->tile.width; x++) {
      const uint32_t *at = first + (y - y0) * TC_RASTER_SIDE + x;
      if (of && at[1] - at[0] > MANY && tc_halt_within(tc_pool_halt(d->job->pool))) return false;
      if (of && at[1] > at[0])
        add_layers(d, w, x, y, of + at[0], at[1] - at[0]);
      else
        add_opaque(d, w, x, y);
    }
  }
  return true;
}

/* Draws a tile that translucent surfaces may touch, a few rows at a time. Returns false if halted or out of memory. */
static bool draw_layers(drawing *d, worker *w, size_t n) {
  const int height = w->tile.height;
  for (int rows = w->from ? 1 : height, y = w->from, end; y < height; y = end) {
    tc_raster_tile part = w->tile;
    const tc_raster_counts before = w->counts;
    end = y + rows < height ? y + rows : height;
    part.y0 += y, part.height = end - y, part.layers = &w->layers;
    part.near += y * TC_RASTER_SIDE, part.id += y * TC_RASTER_SIDE;
    w->layers.n = 0;
    const size_t looked = draw_clusters(d, w, n, &part);
    if (part.height > 1 && is_too_much(&part)) { /* retry with fewer rows, estimated from the count so far */
      rows = (int)((size_t)part.height * looked / (2 * n));
      rows = rows > 1 ? rows : 1, end = y, w->counts = before;
    } else if (looked < n && !is_too_much(&part)) {
      return false;
    } else if (w->layers.n > w->layers.room) { /* retry with enough room */
      end = y, w->counts = before;
      if (w->layers.n <= MOST_ROW && make_room(d, &w->layers, w->layers.n)) continue;
      atomic_store(&d->no_memory, true);
      return false;
    } else {
      w->counts.layers += w->layers.n;
      if (w->layers.n < MOST_LAYERS / 4) rows *= 2;
      if (!shade_rows(d, w, y, end)) return false;
    }
  }
  return true;
}

static void begin_shading(worker *w) {
  memset(w->linear, 0, TC_RASTER_PIXELS * sizeof *w->linear);
  for (int i = 0; i < TC_RASTER_PIXELS; i++) w->depth[i] = INFINITY;
  w->n_seen = 0;
}

static bool shade_tile(drawing *d, worker *w) {
  for (; w->rows < w->tile.height; w->rows++)
    for (int x = 0; x < w->tile.width && !d->job->forward; x++) add_opaque(d, w, x, w->rows);
  return true;
}

static void emit_rows(drawing *d, worker *w, int tile) {
  shade_fragments(d, w);
  const tc_raster_tile *t = &w->tile;
  const size_t above = (size_t)w->from * TC_RASTER_SIDE;
  const tc_raster_picture picture = {tile, t->x0, t->y0 + w->from, t->x0 + t->width, t->y0 + w->rows,
                                     w->rows == t->height ? TC_RASTER_SIDE : w->rows,
                                     (const float(*)[4])w->linear + above, w->depth + above, w->seen, w->n_seen};
  if (!d->job->emit(d->job->user, &picture)) atomic_store_explicit(&d->left, true, memory_order_relaxed);
}

/* Even after the pause time, a call draws at least one tile or some rows of one, so that resumed frames progress. */
static void draw_tile(void *context, int turn, int number) {
  drawing *d = context;
  const int tile = d->work[turn].tile;
  worker *w = &d->workers[number];
  const int from = d->job->finished ? d->job->finished[tile] : 0;
  if (from == TC_RASTER_SIDE) return;
  if ((atomic_load_explicit(&d->drawn, memory_order_relaxed) && tc_halt_between(tc_pool_halt(d->job->pool))) ||
      atomic_load_explicit(&d->left, memory_order_relaxed)) {
    atomic_store_explicit(&d->left, true, memory_order_relaxed);
    return;
  }
  atomic_fetch_add_explicit(&d->drawn, 1, memory_order_relaxed);
  const size_t n = d->first[tile + 1] - d->first[tile];
  begin_tile(d, &w->tile, tile);
  begin_shading(w);
  w->from = w->rows = from;
  if (d->job->forward)
    memcpy(w->order, d->lists + d->first[tile], n * sizeof *w->order);
  else
    sort_list(d, d->lists + d->first[tile], n, w->order);
  if (draw_clusters(d, w, n, &w->tile) < n || !(d->translucent ? draw_layers(d, w, n) : shade_tile(d, w)))
    atomic_store_explicit(&d->left, true, memory_order_relaxed);
  if (w->rows > from) emit_rows(d, w, tile);
}

/* ---- all ---- */

static bool begin_workers(drawing *d) {
  const size_t samples = (size_t)d->job->n_samples * TC_RASTER_PIXELS, over = TC_CLUSTER_PAD;
  const size_t blocks = TC_RASTER_BLOCKS * TC_RASTER_BLOCKS;
  for (int i = 0; i < tc_pool_threads(d->job->pool); i++) {
    worker *w = &d->workers[i];
    float *at = malloc((2 * (samples + over) + 5 * TC_RASTER_PIXELS + blocks) * sizeof *at + d->longest * sizeof *w->order);
    if (!at) return false;
    w->memory = at;
    w->linear = (float(*)[4])at, at += 4 * TC_RASTER_PIXELS;
    w->depth = at, at += TC_RASTER_PIXELS;
    w->tile.near = at, at += samples + over;
    w->tile.id = (uint32_t *)at, at += samples + over;
    w->tile.far = at, at += blocks;
    w->order = (uint32_t *)at;
    for (size_t k = 0; k < over; k++) w->tile.near[samples + k] = 0, w->tile.id[samples + k] = 0;
  }
  return true;
}

static bool draw_all(drawing *d, GError **error) {
  const tc_halt *halt = tc_pool_halt(d->job->pool);
  const size_t n = d->job->mesh->n;
  d->workers = calloc((size_t)tc_pool_threads(d->job->pool), sizeof *d->workers);
  d->sights = malloc((n + 1) * sizeof *d->sights);
  d->places = calloc((size_t)d->n_chunks * (size_t)d->n_tiles + 1, sizeof *d->places);
  d->first = malloc(((size_t)d->n_tiles + 1) * sizeof *d->first);
  d->work = malloc(((size_t)d->n_tiles + 1) * sizeof *d->work);
  if (!d->workers || !d->sights || !d->places || !d->first || !d->work) goto no_memory;
  if (!tc_pool_run(d->job->pool, d->n_chunks, sight_chunk, d)) return tc_halt_say(halt, error);
  d->lists = malloc((sum_places(d) + 1) * sizeof *d->lists);
  if (!d->lists || !begin_workers(d)) goto no_memory;
  if (!tc_pool_run(d->job->pool, d->n_chunks, list_chunk, d)) return tc_halt_say(halt, error);
  order_tiles(d);
  const bool all = tc_pool_run(d->job->pool, d->n_tiles, draw_tile, d);
  if (atomic_load(&d->no_memory)) goto no_memory;
  return (all && !atomic_load(&d->left)) || tc_halt_say(halt, error);
no_memory:
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "mesh of %zu triangles: out of memory to draw it, or too many translucent layers; show fewer", d->job->mesh->n_triangles);
  return false;
}

static void add_counts(tc_raster_counts *to, const tc_raster_counts *from) {
  to->outside += from->outside, to->facing_away += from->facing_away;
  to->hidden += from->hidden, to->drawn += from->drawn;
  to->triangles += from->triangles, to->covered += from->covered, to->layers += from->layers, to->shaded += from->shaded;
  to->colored += from->colored;
}

bool tc_raster_draw(const tc_raster_job *job, tc_raster_counts *counts, GError **error) {
  drawing d = {.job = job};
  set_up_frame(&d);
  d.tiles_x = (job->view->width + TC_RASTER_SIDE - 1) / TC_RASTER_SIDE;
  d.tiles_y = (job->view->height + TC_RASTER_SIDE - 1) / TC_RASTER_SIDE;
  d.n_tiles = d.tiles_x * d.tiles_y;
  d.n_chunks = (int)((job->mesh->n + CHUNK - 1) / CHUNK);
  bool drawn = draw_all(&d, error);
  for (int i = 0; d.workers && i < tc_pool_threads(job->pool); i++) {
    add_counts(counts, &d.workers[i].counts);
    free(d.workers[i].memory);
    const worker *w = &d.workers[i];
    tc_ledger_count(job->ledger, -(int64_t)(2 * w->layers.room * sizeof *w->layers.of + w->seen_room * sizeof *w->seen));
    free(d.workers[i].layers.of);
    free(d.workers[i].seen);
  }
  free(d.workers);
  free(d.sights);
  free(d.places);
  free(d.first);
  free(d.work);
  free(d.lists);
  return drawn;
}

const tc_raster_kernels *tc_raster_kernels_named(const char *isa) {
  if (!strcmp(isa, "scalar")) return &tc_raster_scalar;
  if (!strcmp(isa, "avx2")) return &tc_raster_avx2;
  return strcmp(isa, "avx512") ? NULL : &tc_raster_avx512;
}
