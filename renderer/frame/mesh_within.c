/* Surfaces within a volume (mesh.withVolume, modes dvr and mip): rays are cast in parts, from one surface to the next, and
 * what the rasteriser (mesh/raster.h) found between two parts is composited there. So an opaque surface ends a ray, and a
 * translucent one has the volume before it and the volume behind it.
 *
 * In mip a part of brightness m is light that covers m of what is behind it, as far as it is brighter than the parts before:
 * without surfaces that is the maximum itself, and where a ray leaves the volume there is black. */
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/frame/backend.h"
#include "renderer/frame/frame.h"
#include "renderer/frame/mesh_job.h"

#define ENOUGH (1.0f / 4096) /* of the light that comes through: below nothing is seen */

#define MOST_FOUND (1u << 24) /* layers of all pixels: what a file may make of a picture is bounded by memory */

typedef struct within {
  const tc_job *job;
  tc_pool *pool;
  size_t pixels;
  pthread_mutex_t lock; /* guards found */
  GArray *found;        /* tc_raster_seen of one ray of all pixels; a tile's are together and in order */
  tc_raster_seen *layers;
  uint32_t *next, *end; /* [pixels]: numbers of the pixel's next layer, and behind its last */
  float (*span)[2];     /* [pixels]: mm from the eye, of the next part; empty: the ray has ended */
  float (*sum)[4], (*total)[4]; /* [pixels]: of the ray; of all rays */
  float *clear, *most;  /* [pixels]: light that surfaces let through; greatest grey, -1 before the ray meets the volume */
  tc_frame part;        /* of the volume */
  tc_raster_counts counts;
  atomic_bool more, too_many;
} within;

/* ---- layers ---- */

static void keep_seen(void *user, const tc_raster_picture *p) {
  within *w = user;
  const int width = w->job->frame->width;
  pthread_mutex_lock(&w->lock);
  if (p->n_seen > MOST_FOUND - w->found->len) atomic_store(&w->too_many, true);
  for (size_t i = 0; i < p->n_seen && !atomic_load(&w->too_many); i++) {
    tc_raster_seen seen = p->seen[i];
    seen.pixel = (p->y0 + seen.pixel / TC_RASTER_SIDE) * width + p->x0 + seen.pixel % TC_RASTER_SIDE;
    g_array_append_val(w->found, seen);
  }
  pthread_mutex_unlock(&w->lock);
}

/* Every pixel's layers, in order: `found` by pixel. */
static bool sort_layers(within *w, GError **error) {
  const tc_raster_seen *found = (const tc_raster_seen *)(const void *)w->found->data;
  free(w->layers);
  w->layers = malloc((w->found->len + 1) * sizeof *w->layers);
  if (!w->layers) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "surfaces in a volume: out of memory");
    return false;
  }
  memset(w->end, 0, w->pixels * sizeof *w->end);
  for (guint i = 0; i < w->found->len; i++) w->end[found[i].pixel]++;
  uint32_t at = 0;
  for (size_t p = 0; p < w->pixels; p++) {
    const uint32_t n = w->end[p];
    w->next[p] = w->end[p] = at;
    at += n;
  }
  for (guint i = 0; i < w->found->len; i++) w->layers[w->end[found[i].pixel]++] = found[i];
  return true;
}

static bool find_layers(within *w, const tc_mesh_job *mesh, int ray, GError **error) {
  tc_raster_job raster = mesh->raster;
  raster.kernels = tc_raster_kernels_named(w->job->isa);
  raster.n_samples = 1;
  raster.samples = mesh->raster.samples + ray;
  raster.layered = true;
  raster.emit = keep_seen, raster.user = w;
  raster.pool = w->pool;
  g_array_set_size(w->found, 0);
  if (!tc_raster_draw(&raster, &w->counts, error)) return false;
  if (!atomic_load(&w->too_many)) return sort_layers(w, error);
  tc_set_error(error, TC_ERROR_LIMIT, "/mesh/surfaces",
               "surfaces in a volume: more than %u layers in the picture; show fewer surfaces, or a smaller picture", MOST_FOUND);
  return false;
}

/* ---- parts of rays ---- */

static void begin_ray(within *w) {
  for (size_t p = 0; p < w->pixels; p++) {
    w->clear[p] = 1, w->most[p] = -1;
    memset(w->sum[p], 0, sizeof w->sum[p]);
    w->span[p][0] = 0, w->span[p][1] = w->next[p] < w->end[p] ? w->layers[w->next[p]].depth : INFINITY;
  }
}

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

/* A ray's part is there: it, and the surface behind it. */
static void go_on(within *w, size_t p, const float part[4], bool mip) {
  float *span = w->span[p];
  (mip ? add_mip : add_dvr)(w, p, part);
  if (w->next[p] == w->end[p]) {
    if (mip && w->most[p] >= 0) w->sum[p][3] = 1;
    span[0] = 1, span[1] = 0;
    return;
  }
  const tc_raster_seen *layer = &w->layers[w->next[p]++];
  add_layer(w, p, layer);
  span[0] = layer->depth, span[1] = w->next[p] < w->end[p] ? w->layers[w->next[p]].depth : INFINITY;
  if (w->clear[p] < ENOUGH) span[0] = 1, span[1] = 0;
  if (span[0] < span[1]) atomic_store_explicit(&w->more, true, memory_order_relaxed);
}

static void composite_row(void *context, int y, int worker) {
  within *w = context;
  const bool mip = w->job->key.mode == TC_MODE_MIP;
  const size_t width = (size_t)w->job->frame->width;
  for (size_t p = (size_t)y * width; p < ((size_t)y + 1) * width; p++)
    if (w->span[p][0] <= w->span[p][1]) go_on(w, p, w->part.linear + 4 * p, mip);
}

static bool cast_parts(within *w, void *instance, const tc_rays *rays, GError **error) {
  const tc_render_request request = {.want_linear = true};
  tc_frame_stats *stats = &w->job->frame->stats;
  tc_job job = *w->job;
  job.rays = rays, job.frame = &w->part, job.want_linear = true;
  job.spans = (const float(*)[2])w->span;
  job.key.coherence = 0;
  do {
    atomic_store(&w->more, false);
    if (!tc_frame_begin(&w->part, job.plan->width, job.plan->height, &request, error) ||
        !tc_cpu_backend.render(instance, &job, error))
      return false;
    stats->samples += w->part.stats.samples, stats->rays += w->part.stats.rays;
    stats->gradients += w->part.stats.gradients, stats->leaps += w->part.stats.leaps;
    if (!tc_pool_run(w->pool, job.plan->height, composite_row, w)) return tc_halt_say(job.halt, error);
  } while (atomic_load(&w->more));
  return true;
}

/* ---- all ---- */

static bool begin(within *w, GError **error) {
  const size_t n = w->pixels;
  w->next = malloc(2 * n * sizeof *w->next);
  w->span = malloc(n * sizeof *w->span);
  w->sum = malloc(n * sizeof *w->sum);
  w->total = calloc(n, sizeof *w->total);
  w->clear = malloc(2 * n * sizeof *w->clear);
  if (w->next && w->span && w->sum && w->total && w->clear) {
    w->end = w->next + n, w->most = w->clear + n;
    return true;
  }
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "surfaces in a volume: out of memory");
  return false;
}

static void finish(within *w) {
  free(w->layers), free(w->next), free(w->span), free(w->sum), free(w->total), free(w->clear);
  g_array_unref(w->found);
  tc_frame_finish(&w->part);
  pthread_mutex_destroy(&w->lock);
}

/* The mean of all rays, into the frame. */
static void put_picture(within *w) {
  const tc_frame *frame = w->job->frame;
  const float each = 1 / (float)w->job->rays->count;
  tc_resolve resolve;
  tc_resolve_init(&resolve, w->job->scene);
  for (size_t p = 0; p < w->pixels; p++)
    for (int c = 0; c < 4; c++) w->total[p][c] *= each;
  for (int y = 0; y < frame->height; y++) {
    const size_t at = (size_t)y * (size_t)frame->width;
    tc_resolve_row(&resolve, w->total[at], frame->rgba + 4 * at, frame->width);
  }
  if (w->job->want_linear) memcpy(frame->linear, w->total, w->pixels * sizeof *w->total);
}

bool tc_mesh_within_draw(tc_pool *pool, void *cpu, const tc_job *job, GError **error) {
  within w = {.job = job, .pool = pool, .pixels = (size_t)job->frame->width * (size_t)job->frame->height,
              .found = g_array_new(FALSE, FALSE, sizeof(tc_raster_seen))};
  tc_mesh_job mesh;
  tc_rays one = *job->rays;
  pthread_mutex_init(&w.lock, NULL);
  bool drawn = begin(&w, error) && tc_mesh_job_begin(&mesh, job, error);
  const bool begun = drawn;
  one.count = 1;
  for (int ray = 0; drawn && ray < job->rays->count; ray++) {
    one.of_pixel[0] = job->rays->of_pixel[ray];
    drawn = find_layers(&w, &mesh, ray, error);
    if (!drawn) break;
    begin_ray(&w);
    drawn = cast_parts(&w, cpu, &one, error);
    for (size_t p = 0; drawn && p < w.pixels; p++)
      for (int c = 0; c < 4; c++) w.total[p][c] += w.sum[p][c];
  }
  if (begun) tc_mesh_job_end(&mesh);
  if (drawn) put_picture(&w);
  finish(&w);
  return drawn;
}
