/* The rasteriser's phases (raster.h): clusters are left out or counted by tile, put into their tiles' lists, drawn. */
#include "renderer/mesh/raster.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/mesh/raster_kernels.h"
#include "renderer/mesh/sight.h"

#define CHUNK 1024   /* clusters of a task */
#define LOOK 8       /* clusters between two looks at the halt */
#define BUCKETS 256  /* of nearness, a tile's clusters are sorted into */

typedef struct worker {
  tc_raster_tile tile;
  tc_raster_fragments fragments;
  tc_raster_counts counts;
  float (*linear)[4], *depth; /* [TC_RASTER_PIXELS] */
  uint32_t *order;            /* [longest] */
  void *memory;
} worker;

typedef struct drawing {
  const tc_raster_job *job;
  tc_raster_frame frame;
  double slack; /* mm that single precision may be off by */
  int tiles_x, tiles_y, n_tiles, n_chunks;
  tc_sight *sights;
  uint32_t *places;     /* [chunks][tiles]: how many, then where the chunk's first one goes in the tile's list */
  size_t *first;        /* [tiles + 1]: of a tile's list */
  uint32_t *lists;
  size_t longest;
  worker *workers;
  atomic_int drawn;     /* tiles */
  atomic_bool left;     /* some tile was not drawn to the end */
} drawing;

/* ---- frame ---- */

static void copy_row(float to[4], const double from[4], double scale) {
  for (int k = 0; k < 4; k++) to[k] = (float)(from[k] * scale);
}

static void set_up_frame(drawing *d) {
  const tc_raster_job *job = d->job;
  const tc_view *v = job->view;
  tc_raster_frame *f = &d->frame;
  *f = (tc_raster_frame){.mesh = job->mesh, .view = v, .look = job->look, .perspective = v->perspective,
                         .one_sided = job->one_sided, .reference = (float)v->reference,
                         .inverse_scale = (float)(1 / v->scale), .n_samples = job->n_samples};
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
  const double *rows[3] = {v->right, v->down, v->depth};
  for (int r = 0; r < 3; r++) {
    double sum = 0;
    for (int k = 0; k < 3; k++) sum += rows[r][k] * (double)job->look.light[k];
    f->light[r] = (float)sum;
  }
  d->slack = tc_sight_slack(job->mesh);
}

/* ---- clusters ---- */

static tc_sight look_at(const drawing *d, const tc_cluster *k, tc_raster_counts *counts) {
  bool away;
  const tc_sight s = tc_sight_of(d->job->view, k, d->slack, d->job->one_sided, &away);
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

/* Counts become places in the tiles' lists; gives back how long all lists are. */
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

/* ---- tiles ---- */

/* A tile's clusters, nearest first, as well as buckets tell. */
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
  float least = INFINITY;
  int x1 = (bx + 1) * TC_RASTER_BLOCK, y1 = (by + 1) * TC_RASTER_BLOCK;
  x1 = x1 < t->width ? x1 : t->width, y1 = y1 < t->height ? y1 : t->height;
  for (int s = 0; s < n_samples; s++)
    for (int y = by * TC_RASTER_BLOCK; y < y1; y++) {
      const float *row = t->near + ((size_t)s * TC_RASTER_SIDE + (size_t)y) * TC_RASTER_SIDE;
      for (int x = bx * TC_RASTER_BLOCK; x < x1; x++) least = row[x] < least ? row[x] : least;
    }
  return least;
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

/* Every sample it may touch has something that is at least as near. */
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
  const tc_view *v = d->job->view;
  t->x0 = tile % d->tiles_x * TC_RASTER_SIDE, t->y0 = tile / d->tiles_x * TC_RASTER_SIDE;
  t->width = v->width - t->x0 < TC_RASTER_SIDE ? v->width - t->x0 : TC_RASTER_SIDE;
  t->height = v->height - t->y0 < TC_RASTER_SIDE ? v->height - t->y0 : TC_RASTER_SIDE;
  t->stale = 0;
  for (int b = 0; b < TC_RASTER_BLOCKS * TC_RASTER_BLOCKS; b++) t->far[b] = -INFINITY;
  for (size_t i = 0; i < (size_t)d->job->n_samples * TC_RASTER_PIXELS; i++) t->near[i] = -INFINITY;
  memset(t->id, 0xff, (size_t)d->job->n_samples * TC_RASTER_PIXELS * sizeof *t->id);
}

/* False: left. */
static bool draw_clusters(const drawing *d, worker *w, int tile) {
  const size_t n = d->first[tile + 1] - d->first[tile];
  tc_raster_tile *t = &w->tile;
  sort_list(d, d->lists + d->first[tile], n, w->order);
  for (size_t i = 0; i < n; i++) {
    const tc_sight *s = &d->sights[w->order[i]];
    if (i % LOOK == LOOK - 1 && tc_halt_within(tc_pool_halt(d->job->pool))) return false;
    block_range r = blocks_of(t, s);
    if (is_hidden(t, d->job->n_samples, s, r)) {
      w->counts.hidden++;
      continue;
    }
    d->job->kernels->draw(&d->frame, t, w->order[i], s->planes, &w->counts);
    for (int y = r.y0; y <= r.y1; y++)
      t->stale |= (((uint64_t)2 << r.x1) - ((uint64_t)1 << r.x0)) << y * TC_RASTER_BLOCKS;
  }
  return true;
}

/* ---- shading ---- */

static void shade_fragments(const drawing *d, worker *w) {
  tc_raster_fragments *f = &w->fragments;
  if (!f->n) return;
  d->job->kernels->shade(&d->frame, f);
  w->counts.shaded += (uint64_t)f->n;
  for (int i = 0; i < f->n; i++) {
    float *to = w->linear[f->pixel[i]], *depth = &w->depth[f->pixel[i]];
    for (int c = 0; c < 3; c++) to[c] += f->share[i] * f->color[c][i];
    to[3] += f->share[i];
    *depth = f->depth[i] < *depth ? f->depth[i] : *depth;
  }
  f->n = 0;
}

static void add_fragment(const drawing *d, worker *w, int x, int y, uint32_t id, float share, const float offset[2]) {
  tc_raster_fragments *f = &w->fragments;
  f->id[f->n] = id;
  f->pixel[f->n] = y * TC_RASTER_SIDE + x;
  f->share[f->n] = share;
  f->x[f->n] = (float)(w->tile.x0 + x) + offset[0] * (1.0f / TC_VIEW_SUBPIXEL);
  f->y[f->n] = (float)(w->tile.y0 + y) + offset[1] * (1.0f / TC_VIEW_SUBPIXEL);
  if (++f->n == TC_RASTER_BATCH) shade_fragments(d, w);
}

/* The triangles that a pixel's samples see, each once, in the middle of its samples there: which is within it. */
static void add_pixel(const drawing *d, worker *w, int x, int y) {
  struct { uint32_t id; float n, offset[2]; } of[TC_RASTER_SAMPLES];
  const int n_samples = d->job->n_samples;
  int n = 0;
  for (int s = 0; s < n_samples; s++) {
    uint32_t id = w->tile.id[((size_t)s * TC_RASTER_SIDE + (size_t)y) * TC_RASTER_SIDE + (size_t)x];
    const float *offset = d->frame.offset[s];
    int i = 0;
    if (id == TC_RASTER_NOTHING) continue;
    while (i < n && of[i].id != id) i++;
    if (i == n) of[n].id = id, of[n].n = of[n].offset[0] = of[n].offset[1] = 0, n++;
    of[i].n++, of[i].offset[0] += offset[0], of[i].offset[1] += offset[1];
  }
  for (int i = 0; i < n; i++) {
    const float middle[2] = {of[i].offset[0] / of[i].n, of[i].offset[1] / of[i].n};
    add_fragment(d, w, x, y, of[i].id, of[i].n / (float)n_samples, middle);
  }
}

static void shade_tile(const drawing *d, worker *w) {
  memset(w->linear, 0, TC_RASTER_PIXELS * sizeof *w->linear);
  for (int i = 0; i < TC_RASTER_PIXELS; i++) w->depth[i] = INFINITY;
  for (int y = 0; y < w->tile.height; y++)
    for (int x = 0; x < w->tile.width; x++) {
      uint32_t id = w->tile.id[y * TC_RASTER_SIDE + x];
      if (d->job->n_samples > 1)
        add_pixel(d, w, x, y);
      else if (id != TC_RASTER_NOTHING)
        add_fragment(d, w, x, y, id, 1, d->frame.offset[0]);
    }
  shade_fragments(d, w);
}

/* However late it is, a call draws a tile. */
static void draw_tile(void *context, int tile, int number) {
  drawing *d = context;
  worker *w = &d->workers[number];
  if (d->job->finished && d->job->finished[tile]) return;
  if ((atomic_load_explicit(&d->drawn, memory_order_relaxed) && tc_halt_between(tc_pool_halt(d->job->pool))) ||
      atomic_load_explicit(&d->left, memory_order_relaxed)) {
    atomic_store_explicit(&d->left, true, memory_order_relaxed);
    return;
  }
  atomic_fetch_add_explicit(&d->drawn, 1, memory_order_relaxed);
  begin_tile(d, &w->tile, tile);
  if (!draw_clusters(d, w, tile)) {
    atomic_store_explicit(&d->left, true, memory_order_relaxed);
    return;
  }
  shade_tile(d, w);
  const tc_raster_tile *t = &w->tile;
  const tc_raster_picture picture = {tile, t->x0, t->y0, t->x0 + t->width, t->y0 + t->height,
                                     (const float(*)[4])w->linear, w->depth};
  d->job->emit(d->job->user, &picture);
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
  if (!d->workers || !d->sights || !d->places || !d->first) goto no_memory;
  if (!tc_pool_run(d->job->pool, d->n_chunks, sight_chunk, d)) return tc_halt_say(halt, error);
  d->lists = malloc((sum_places(d) + 1) * sizeof *d->lists);
  if (!d->lists || !begin_workers(d)) goto no_memory;
  if (!tc_pool_run(d->job->pool, d->n_chunks, list_chunk, d)) return tc_halt_say(halt, error);
  bool all = tc_pool_run(d->job->pool, d->n_tiles, draw_tile, d);
  return (all && !atomic_load(&d->left)) || tc_halt_say(halt, error);
no_memory:
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "mesh of %zu triangles: out of memory to draw it", d->job->mesh->n_triangles);
  return false;
}

static void add_counts(tc_raster_counts *to, const tc_raster_counts *from) {
  to->outside += from->outside, to->facing_away += from->facing_away;
  to->hidden += from->hidden, to->drawn += from->drawn;
  to->triangles += from->triangles, to->covered += from->covered, to->shaded += from->shaded;
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
  }
  free(d.workers);
  free(d.sights);
  free(d.places);
  free(d.first);
  free(d.lists);
  return drawn;
}

const tc_raster_kernels *tc_raster_kernels_named(const char *isa) {
  if (!strcmp(isa, "scalar")) return &tc_raster_scalar;
  if (!strcmp(isa, "avx2")) return &tc_raster_avx2;
  return strcmp(isa, "avx512") ? NULL : &tc_raster_avx512;
}
