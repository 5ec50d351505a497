/* Draws frames of mode mesh: the rasteriser's tiles (mesh/raster.h) into the frame. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/frame/backend.h"
#include "renderer/frame/frame.h"
#include "renderer/frame/mesh_job.h"

typedef struct mesh_frame {
  const tc_frame_job *job;
  tc_resolve resolve;
  tc_progress *progress;
} mesh_frame;

static void put_layers(tc_frame *frame, const tc_raster_picture *p) {
  const size_t width = (size_t)frame->width;
  for (int y = p->y0; y < p->y1; y++)
    for (int x = p->x0; x < p->x1; x++)
      for (int i = 0; i < TC_FRAME_LAYERS; i++) frame->layers[(size_t)y * width + (size_t)x][i] = INFINITY;
  for (size_t i = 0, nth = 0; i < p->n_seen; i++) {
    const int pixel = p->seen[i].pixel;
    nth = i && pixel == p->seen[i - 1].pixel ? nth + 1 : 0;
    frame->layers[(size_t)(p->y0 + pixel / TC_RASTER_SIDE) * width + (size_t)(p->x0 + pixel % TC_RASTER_SIDE)][nth] = p->seen[i].depth;
  }
}

static bool emit(void *user, const tc_raster_picture *p) {
  mesh_frame *f = user;
  tc_frame *frame = f->job->frame;
  const size_t n = (size_t)(p->x1 - p->x0);
  for (int y = p->y0; y < p->y1; y++) {
    const size_t from = (size_t)(y - p->y0) * TC_RASTER_SIDE, at = (size_t)y * (size_t)frame->width + (size_t)p->x0;
    tc_resolve_row(&f->resolve, p->linear[from], frame->rgba + 4 * at, (int)n);
    if (f->job->want_linear) memcpy(frame->linear + 4 * at, p->linear[from], n * sizeof *p->linear);
    if (f->job->plan->depth) memcpy(frame->depth + at, p->depth + from, n * sizeof *p->depth);
  }
  if (frame->layers) put_layers(frame, p);
  f->progress->finished[p->tile] = (uint8_t)p->rows;
  return true;
}

/* A paused frame has its layers. False: out of memory. */
static bool make_layers(const tc_frame_job *job, GError **error) {
  tc_frame *frame = job->frame;
  if (!job->plan->depth || !tc_frame_has_layers(job->scene) || frame->layers) return true;
  frame->layers = malloc((size_t)frame->width * (size_t)frame->height * sizeof *frame->layers);
  if (!frame->layers) tc_set_error(error, TC_ERROR_MEMORY, NULL, "layers of %dx%d pixels: out of memory", frame->width, frame->height);
  return frame->layers != NULL;
}

bool tc_mesh_frame_draw(tc_pool *pool, const tc_frame_job *job, GError **error) {
  mesh_frame f = {.job = job, .progress = tc_frame_cut(job->frame, TC_RASTER_SIDE, error)};
  tc_raster_counts counts = {0};
  tc_mesh_job drawn;
  if (!f.progress || !make_layers(job, error) || !tc_mesh_job_begin(&drawn, job, error)) return false;
  tc_resolve_init(&f.resolve, job->scene);
  tc_raster_job raster = drawn.raster;
  raster.kernels = tc_raster_kernels_named(job->isa);
  raster.finished = f.progress->finished;
  raster.emit = emit, raster.user = &f;
  raster.pool = pool;
  raster.layered = job->frame->layers ? TC_FRAME_LAYERS : 0;
  raster.forward = job->forward && raster.n_samples == 1 && !job->scene->mesh.n_surfaces; /* one opaque surface */
  const bool whole = tc_raster_draw(&raster, &counts, error);
  tc_mesh_job_end(&drawn);
  job->frame->stats.samples += counts.covered;
  if (job->key.shading) job->frame->stats.gradients += counts.shaded;
  job->frame->stats.hidden += counts.hidden, job->frame->stats.shaded += counts.shaded;
  job->frame->stats.leaps += counts.outside + counts.facing_away + counts.hidden;
  int64_t rows = 0;
  f.progress->done = 0;
  for (int i = 0; i < f.progress->units; i++) {
    f.progress->done += f.progress->finished[i] == TC_RASTER_SIDE;
    rows += f.progress->finished[i] % TC_RASTER_SIDE;
  }
  f.progress->rays_ahead = rows;
  f.progress->ahead = (double)rows / TC_RASTER_SIDE;
  return whole;
}
