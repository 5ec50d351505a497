#include "renderer/frame/frame.h"

#include <stdlib.h>
#include <string.h>

#include "renderer/mesh/surfaces.h"

static void drop_partials(tc_progress *p) {
  while (p->partials) {
    tc_partial *next = p->partials->next;
    free(p->partials);
    p->partials = next;
  }
}

void tc_progress_drop(tc_progress *p) {
  drop_partials(p);
  if (p->kept) p->drop(p->kept);
  p->kept = NULL, p->kept_bytes = 0;
}

void tc_frame_give_up(tc_frame *frame) {
  if (!frame->progress) return;
  tc_progress_drop(frame->progress);
  frame->progress->paused = false;
}

void tc_frame_finish(tc_frame *frame) {
  free(frame->rgba);
  free(frame->linear);
  free(frame->depth);
  free(frame->layers);
  if (frame->progress) tc_progress_drop(frame->progress);
  if (frame->progress) free(frame->progress->finished);
  free(frame->progress);
  *frame = (tc_frame){0};
}

double tc_frame_done(const tc_frame *frame) {
  const tc_progress *p = frame->progress;
  if (!p || !p->paused) return 0;
  if (p->units) return (p->done + p->ahead) / p->units;
  if (p->kept) return p->ahead;
  double rows = p->tile[1] + p->tile[3] * ((double)p->tile[0] / frame->width);
  return rows < frame->height ? rows / frame->height : 1;
}

int tc_frame_fruitless(const tc_frame *frame) { return frame->progress ? frame->progress->fruitless : 0; }

bool tc_frame_has_layers(const tc_scene *scene) {
  bool translucent = false;
  for (size_t i = 0; i < scene->mesh.n_surfaces; i++)
    translucent |= tc_mesh_surface_shows(&scene->mesh.surfaces[i]) && scene->mesh.surfaces[i].opacity < 1;
  return translucent && scene->mode == TC_MODE_MESH && scene->sampling.rays_per_pixel == 1;
}

uint64_t tc_frame_need(const tc_scene *scene, int width, int height, bool measured) {
  const uint64_t within = tc_mesh_is_within(scene) ? TC_WITHIN_BYTES : 0, layers = tc_frame_has_layers(scene) ? 4 * TC_FRAME_LAYERS : 0;
  return (uint64_t)width * (uint64_t)height * (4 + (measured ? 20 + layers : 0) + within);
}

uint64_t tc_frame_bytes(const tc_frame *f) {
  const uint64_t layers = f->layers ? (uint64_t)f->width * (uint64_t)f->height * sizeof *f->layers : 0;
  return 4 * f->capacity + 16 * f->linear_capacity + 4 * f->depth_capacity + layers + (f->progress ? f->progress->kept_bytes : 0);
}

int64_t tc_frame_position(const tc_frame *frame) {
  const tc_progress *p = frame->progress;
  return ((int64_t)p->done << 32) + p->rays_ahead + (int64_t)p->tile[1] * frame->width + p->tile[0];
}

static bool reserve(tc_frame *f, size_t pixels, bool want_linear, bool want_depth) {
  if (f->capacity < pixels) {
    free(f->rgba);
    f->rgba = malloc(pixels * 4);
    f->capacity = f->rgba ? pixels : 0;
  }
  if (want_linear && f->linear_capacity < pixels) {
    free(f->linear);
    f->linear = malloc(pixels * 4 * sizeof(float));
    f->linear_capacity = f->linear ? pixels : 0;
  }
  if (want_depth && f->depth_capacity < pixels) {
    free(f->depth);
    f->depth = malloc(pixels * sizeof(float));
    f->depth_capacity = f->depth ? pixels : 0;
  }
  if (!f->progress) f->progress = calloc(1, sizeof *f->progress);
  return f->progress && f->rgba && (!want_linear || f->linear) && (!want_depth || f->depth);
}

static bool is_resumable(const tc_frame *f, int width, int height, const tc_render_request *q) {
  const tc_progress *p = f->progress;
  return q->resume && p && p->paused && f->width == width && f->height == height && p->linear == q->want_linear &&
         p->depth == q->want_depth;
}

/* Resets the progress for a new frame, keeping its memory. */
static void start_over(tc_progress *p, const tc_render_request *q) {
  tc_progress_drop(p);
  *p = (tc_progress){.finished = p->finished, .capacity = p->capacity, .linear = q->want_linear, .depth = q->want_depth};
}

bool tc_frame_begin(tc_frame *f, int width, int height, const tc_render_request *request, GError **error) {
  if (is_resumable(f, width, height, request)) return true;
  if (!reserve(f, (size_t)width * (size_t)height, request->want_linear, request->want_depth)) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "frame of %dx%d pixels: out of memory", width, height);
    return false;
  }
  start_over(f->progress, request);
  g_clear_pointer(&f->layers, free);
  f->width = width;
  f->height = height;
  f->stats = (tc_frame_stats){0};
  return true;
}

void tc_frame_of_mesh(tc_frame *f, int refined) {
  tc_progress *p = f->progress;
  if (p->refined == refined) return;
  tc_progress_drop(p);
  *p = (tc_progress){.finished = p->finished, .capacity = p->capacity, .linear = p->linear, .depth = p->depth,
                     .fruitless = p->fruitless, .refined = refined};
}

tc_progress *tc_frame_cut(tc_frame *f, int side, GError **error) {
  tc_progress *p = f->progress;
  if (p && p->units) return p;
  if (!p) p = f->progress = calloc(1, sizeof *p);
  size_t units = (size_t)((f->width + side - 1) / side) * (size_t)((f->height + side - 1) / side);
  if (p && p->capacity < units) {
    free(p->finished);
    p->finished = malloc(units);
    p->capacity = p->finished ? units : 0;
  }
  if (!p || !p->finished) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "frame of %dx%d pixels: out of memory", f->width, f->height);
    return NULL;
  }
  memset(p->finished, 0, units);
  p->side = side;
  p->units = (int)units;
  p->done = 0;
  return p;
}
