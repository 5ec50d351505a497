/* Surfaces within a volume (mesh.withVolume, modes dvr and mip). The rasteriser (mesh/raster.h) finds the layers of
 * each pixel; rays are then cast in parts, from one layer to the next, and each layer is composited between two parts.
 * An opaque surface thus ends a ray, and a translucent one lies between the volume in front of it and behind it.
 *
 * In mip a part of maximum m adds light m and covers the share m of everything behind it, as far as m exceeds the
 * maximum of earlier parts. Without surfaces the result is the maximum itself; where a ray leaves the volume the
 * picture is black. */
#include <limits.h>
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/frame/backend.h"
#include "renderer/frame/frame.h"
#include "renderer/frame/mesh_job.h"

#define ENOUGH (1.0f / 4096) /* early ray termination: below this transparency nothing is visible */

unsigned tc_mesh_most_layers = 1u << 24;

typedef enum phase { FIND, CAST, COMPOSITE, PUT } phase;

/* State of the frame, kept while it is paused. */
typedef struct within {
  const tc_frame_job *job;
  tc_pool *pool;
  const tc_backend_ops *ops; /* back end that casts rays */
  void *instance;
  size_t pixels;
  phase phase;
  int ray;
  uint8_t *tiles, *rows; /* tiles and rows that this phase has finished */
  pthread_mutex_t lock;  /* guards found */
  tc_raster_seen *found; /* [n_found]: layers of one ray per pixel, contiguous and sorted for each pixel */
  uint32_t n_found, found_room;
  uint32_t *next, *end;  /* [pixels]: index in found of the pixel's next layer, and past its last one */
  float (*span)[2];      /* [pixels]: start and end of the next part, mm from the eye; start beyond end: the ray has ended */
  float (*sum)[4], (*total)[4]; /* [pixels]: colour of the current ray; sum over earlier rays */
  float *clear, *most;   /* [pixels]: transparency so far; greatest grey so far, -1 before the ray meets the volume */
  tc_frame part;         /* picture of the volume's current part */
  int parts; /* composited parts of the current ray */
  atomic_bool more, too_many, no_memory;
} within;

/* ---- layers ---- */

static void begin_pixel(within *w, size_t p) {
  for (int c = 0; c < 4; c++) w->total[p][c] += w->sum[p][c], w->sum[p][c] = 0;
  w->clear[p] = 1, w->most[p] = -1;
  w->next[p] = w->end[p] = 0;
  w->span[p][0] = 0, w->span[p][1] = INFINITY;
}

static bool make_room(within *w, uint32_t n) {
  if (n <= w->found_room) return true;
  const uint64_t doubled = 2 * (uint64_t)w->found_room, most = tc_mesh_most_layers;
  const uint64_t room = n > doubled ? n : doubled < most ? doubled : most;
  const bool fits = tc_ledger_take(w->job->ledger, (room - w->found_room) * sizeof *w->found);
  tc_raster_seen *found = fits ? realloc(w->found, room * sizeof *found) : NULL;
  if (found) w->found = found, w->found_room = (uint32_t)room;
  if (!found) atomic_store(&w->no_memory, true);
  return found != NULL;
}

/* Appends the layers of a tile. False: too many, or out of memory. */
static bool append(within *w, const tc_raster_picture *p, uint32_t *first) {
  pthread_mutex_lock(&w->lock);
  *first = w->n_found;
  const bool few = p->n_seen <= tc_mesh_most_layers && w->n_found <= tc_mesh_most_layers - p->n_seen;
  const bool fits = few && make_room(w, w->n_found + (uint32_t)p->n_seen);
  if (!few) atomic_store(&w->too_many, true);
  if (fits && p->n_seen) memcpy(w->found + w->n_found, p->seen, p->n_seen * sizeof *p->seen), w->n_found += (uint32_t)p->n_seen;
  pthread_mutex_unlock(&w->lock);
  return fits;
}

static bool keep_seen(void *user, const tc_raster_picture *p) {
  within *w = user;
  const size_t width = (size_t)w->job->frame->width;
  uint32_t first;
  if (!append(w, p, &first)) return false;
  for (int y = p->y0; y < p->y1; y++)
    for (int x = p->x0; x < p->x1; x++) begin_pixel(w, (size_t)y * width + (size_t)x);
  for (size_t i = 0; i < p->n_seen; i++) {
    const int x = p->x0 + p->seen[i].pixel % TC_RASTER_SIDE, y = p->y0 + p->seen[i].pixel / TC_RASTER_SIDE;
    const size_t at = (size_t)y * width + (size_t)x;
    if (!w->end[at]) w->next[at] = first + (uint32_t)i, w->span[at][1] = p->seen[i].depth;
    w->end[at] = first + (uint32_t)i + 1;
  }
  w->tiles[p->tile] = (uint8_t)p->rows;
  return true;
}

static bool find_layers(within *w, const tc_mesh_job *mesh, int ray, GError **error) {
  tc_raster_job raster = mesh->raster;
  raster.kernels = tc_raster_kernels_named(w->job->isa);
  raster.n_samples = 1;
  raster.samples = mesh->raster.samples + ray;
  raster.layered = INT_MAX;
  raster.emit = keep_seen, raster.user = w;
  raster.pool = w->pool;
  raster.finished = w->tiles;
  GError *stopped = NULL;
  tc_raster_counts counts = {0};
  const bool drawn = tc_raster_draw(&raster, &counts, &stopped), no_memory = atomic_load(&w->no_memory);
  w->job->frame->stats.hidden += counts.hidden, w->job->frame->stats.shaded += counts.shaded;
  if (!no_memory && !atomic_load(&w->too_many)) {
    if (stopped) g_propagate_error(error, stopped);
    return drawn;
  }
  g_clear_error(&stopped);
  if (no_memory)
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "layers of surfaces in a volume: out of memory");
  else
    tc_set_error(error, TC_ERROR_LIMIT, "/mesh/surfaces",
                 "surfaces in a volume: more than %u layers in the picture; show fewer surfaces, or a smaller picture",
                 tc_mesh_most_layers);
  return false;
}

/* ---- parts of rays ---- */

static void add_dvr(within *w, size_t p, const float part[4]) {
  for (int c = 0; c < 4; c++) w->sum[p][c] += w->clear[p] * part[c];
  w->clear[p] *= 1 - part[3];
}

static void add_mip(within *w, size_t p, const float part[4]) {
  if (!(part[3] > 0)) return;
  const float rise = w->clear[p] * fmaxf(part[0] - fmaxf(w->most[p], 0), 0);
  for (int c = 0; c < 4; c++) w->sum[p][c] += rise;
  w->most[p] = fmaxf(w->most[p], part[0]);
}

static void add_layer(within *w, size_t p, const tc_raster_seen *layer) {
  const float share = w->clear[p] * (1 - fmaxf(w->most[p], 0)) * layer->opacity;
  for (int c = 0; c < 3; c++) w->sum[p][c] += share * layer->color[c];
  w->sum[p][3] += share;
  w->clear[p] *= 1 - layer->opacity;
}

/* Composites a part of a ray and the layer behind the part; sets the span of the next part. Layers come in the order in which they
 * show, and a layer may be nearer than the one before it (tc_mesh_view.behind, rounding): then the part between them is empty. */
static void go_on(within *w, size_t p, const float part[4], bool mip) {
  float *span = w->span[p];
  (mip ? add_mip : add_dvr)(w, p, part);
  if (w->next[p] == w->end[p]) {
    if (mip && w->most[p] >= 0) w->sum[p][3] = 1;
    span[0] = 1, span[1] = 0;
    return;
  }
  const tc_raster_seen *layer = &w->found[w->next[p]];
  add_layer(w, p, layer);
  span[0] = span[1], span[1] = ++w->next[p] < w->end[p] ? fmaxf(span[0], layer[1].depth) : INFINITY;
  if (w->clear[p] < ENOUGH) span[0] = 1, span[1] = 0;
  if (span[0] <= span[1]) atomic_store_explicit(&w->more, true, memory_order_relaxed);
}

static void composite_row(within *w, int y) {
  const bool mip = w->job->key.mode == TC_MODE_MIP;
  const size_t width = (size_t)w->job->frame->width;
  for (size_t p = (size_t)y * width; p < ((size_t)y + 1) * width; p++)
    if (w->span[p][0] <= w->span[p][1]) go_on(w, p, w->part.linear + 4 * p, mip);
}

/* Writes the mean of all rays into the frame. */
static void put_row(within *w, int y) {
  const tc_frame *frame = w->job->frame;
  const size_t width = (size_t)frame->width, at = (size_t)y * width;
  const float each = 1 / (float)w->job->rays->count;
  float(*mean)[4] = (float(*)[4])(void *)(w->part.linear + 4 * at); /* all parts are composited: the buffer is free */
  tc_resolve resolve;
  tc_resolve_init(&resolve, w->job->scene);
  for (size_t x = 0; x < width; x++)
    for (int c = 0; c < 4; c++) mean[x][c] = (w->total[at + x][c] + w->sum[at + x][c]) * each;
  tc_resolve_row(&resolve, mean[0], frame->rgba + 4 * at, (int)width);
  if (w->job->want_linear) memcpy(frame->linear + 4 * at, mean, width * sizeof *mean);
}

static void finish_row(void *context, int y, int worker) {
  within *w = context;
  if (!w->rows[y]) (w->phase == PUT ? put_row : composite_row)(w, y);
  w->rows[y] = 1;
}

static bool finish_rows(within *w, GError **error) {
  const size_t height = (size_t)w->job->frame->height;
  if (!tc_pool_run(w->pool, (int)height, finish_row, w)) return tc_halt_say(w->job->halt, error);
  memset(w->rows, 0, height);
  return true;
}

static bool cast_part(within *w, GError **error) {
  const tc_render_request request = {.want_linear = true, .resume = true};
  tc_frame_stats *stats = &w->job->frame->stats;
  tc_rays one = *w->job->rays;
  tc_frame_job job = *w->job;
  GError *failure = NULL;
  one.count = 1, one.of_pixel[0] = w->job->rays->of_pixel[w->ray];
  job.rays = &one, job.frame = &w->part, job.want_linear = true;
  job.spans = (const float(*)[2])w->span;
  job.key.coherence = 0;
  if (!tc_frame_begin(&w->part, job.plan->width, job.plan->height, &request, error)) return false;
  const bool drawn = w->ops->render(w->instance, &job, &failure);
  w->part.progress->paused = g_error_matches(failure, TC_ERROR, TC_ERROR_PAUSED);
  if (failure) g_propagate_error(error, failure);
  if (!drawn) return false;
  stats->samples += w->part.stats.samples, stats->rays += w->part.stats.rays;
  stats->gradients += w->part.stats.gradients, stats->leaps += w->part.stats.leaps;
  return true;
}

/* ---- the frame ---- */

static void drop(void *kept) {
  within *w = kept;
  free(w->next), free(w->span), free(w->sum), free(w->total), free(w->clear), free(w->tiles), free(w->found);
  tc_frame_finish(&w->part);
  pthread_mutex_destroy(&w->lock);
  free(w);
}

static size_t tiles_of(const tc_frame *f) {
  const size_t side = TC_RASTER_SIDE;
  return ((size_t)f->width + side - 1) / side * (((size_t)f->height + side - 1) / side);
}

/* The state of a paused frame, or a new one; NULL with *error set. */
static within *resume(const tc_frame_job *job, GError **error) {
  tc_progress *progress = job->frame->progress;
  within *w = progress->kept ? progress->kept : calloc(1, sizeof *w);
  if (w && !progress->kept) {
    const size_t n = w->pixels = (size_t)job->frame->width * (size_t)job->frame->height, tiles = tiles_of(job->frame);
    progress->kept = w, progress->drop = drop;
    pthread_mutex_init(&w->lock, NULL);
    w->next = malloc(2 * n * sizeof *w->next), w->clear = malloc(2 * n * sizeof *w->clear);
    w->span = malloc(n * sizeof *w->span);
    w->sum = calloc(n, sizeof *w->sum), w->total = calloc(n, sizeof *w->total);
    w->tiles = calloc(tiles + (size_t)job->frame->height, 1);
    if (w->next && w->clear && w->tiles) w->end = w->next + n, w->most = w->clear + n, w->rows = w->tiles + tiles;
  }
  if (w && w->next && w->clear && w->span && w->sum && w->total && w->tiles) return w;
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "surfaces in a volume: out of memory");
  return NULL;
}

/* Continues the current phase to its end and sets *next to the phase that follows. */
static bool run_phase(within *w, const tc_mesh_job *mesh, phase *next, GError **error) {
  switch (w->phase) {
  case FIND:
    *next = CAST;
    return find_layers(w, mesh, w->ray, error);
  case CAST:
    *next = COMPOSITE;
    atomic_store(&w->more, false);
    return cast_part(w, error);
  case COMPOSITE:
    if (!finish_rows(w, error)) return false;
    w->parts++;
    *next = atomic_load(&w->more) ? CAST : w->ray + 1 < w->job->rays->count ? FIND : PUT;
    if (*next != FIND) return true;
    w->ray++;
    memset(w->tiles, 0, tiles_of(w->job->frame));
    w->n_found = 0, w->parts = 0;
    return true;
  case PUT: break;
  }
  *next = PUT;
  return finish_rows(w, error);
}

static int64_t position(const within *w) {
  int64_t n = w->part.progress ? tc_frame_position(&w->part) : 0;
  for (size_t i = 0; i < tiles_of(w->job->frame) + (size_t)w->job->frame->height; i++) n += w->tiles[i];
  return n;
}

/* Finished share of the current ray. An estimate: the number of parts is known only at the end. */
static double share_of_ray(const within *w) {
  int64_t rows = 0;
  if (w->phase == PUT) return 1;
  for (size_t i = 0; i < tiles_of(w->job->frame); i++) rows += w->tiles[i];
  return 0.2 * (double)rows / (double)(tiles_of(w->job->frame) * TC_RASTER_SIDE) + 0.8 * w->parts / (w->parts + 2.0);
}

/* Reports the kept bytes and the progress of the frame. */
static void account(const within *w, tc_progress *progress) {
  progress->kept_bytes = TC_WITHIN_BYTES * w->pixels + w->found_room * sizeof *w->found;
  progress->ahead = (w->ray + share_of_ray(w)) / w->job->rays->count;
}

bool tc_mesh_within_draw(tc_pool *pool, const tc_backend_ops *ops, void *instance, const tc_frame_job *job, GError **error) {
  within *w = resume(job, error);
  tc_mesh_job mesh;
  if (!w || !tc_mesh_job_begin(&mesh, job, error)) return false;
  tc_progress *progress = job->frame->progress;
  w->job = job, w->pool = pool, w->ops = ops, w->instance = instance;
  const int64_t before = position(w);
  bool drawn = true, done = false;
  while (drawn && !done) {
    phase next = PUT;
    done = w->phase == PUT;
    drawn = run_phase(w, &mesh, &next, error);
    progress->rays_ahead += drawn;
    if (drawn) w->phase = next;
  }
  progress->rays_ahead += position(w) != before;
  tc_mesh_job_end(&mesh);
  account(w, progress);
  if (drawn) tc_progress_drop(progress);
  return drawn;
}
