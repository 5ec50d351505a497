/* Draws frames of mode mesh: the scene's camera, light, colour and clipping for the rasteriser (mesh/raster.h), and its
 * tiles into the frame. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/frame/backend.h"
#include "renderer/frame/frame.h"
#include "renderer/mesh/raster.h"
#include "renderer/raycast/shade.h"

typedef struct mesh_frame {
  const tc_job *job;
  tc_resolve resolve;
  tc_progress *progress;
} mesh_frame;

static void emit(void *user, const tc_raster_picture *p) {
  mesh_frame *f = user;
  tc_frame *frame = f->job->frame;
  const size_t n = (size_t)(p->x1 - p->x0);
  for (int y = p->y0; y < p->y1; y++) {
    const size_t from = (size_t)(y - p->y0) * TC_RASTER_SIDE, at = (size_t)y * (size_t)frame->width + (size_t)p->x0;
    tc_resolve_row(&f->resolve, p->linear[from], frame->rgba + 4 * at, (int)n);
    if (f->job->want_linear) memcpy(frame->linear + 4 * at, p->linear[from], n * sizeof *p->linear);
    if (f->job->plan->depth) memcpy(frame->depth + at, p->depth + from, n * sizeof *p->depth);
  }
  f->progress->finished[p->tile] = true;
}

static tc_raster_look look_of(const tc_job *job) {
  tc_raster_look look = {.shaded = job->key.shading != TC_SHADING_NONE};
  memcpy(look.color, job->plan->surface.color, sizeof look.color);
  if (!look.shaded) return look;
  tc_shade s;
  tc_shade_set_up(&s, job->source, job->source, job->scene);
  for (int i = 0; i < 2; i++) {
    look.factor[i] = (float)s.factor[i];
    for (int c = 0; c < 3; c++) look.glow[i][c] = (float)s.glow[i][c];
  }
  look.least = (float)s.least, look.specular = (float)s.specular, look.shininess = (float)s.shininess;
  look.head_light = s.head_light;
  for (int k = 0; k < 3; k++) look.light[k] = (float)s.light[k];
  return look;
}

/* Surfaces of labels have the colours of their tints, however faint; without any, the isosurface's. NULL: no memory. */
static float (*colors_of(const tc_job *job))[3] {
  const tc_clusters *mesh = job->have.mesh;
  const tc_volume_desc *d = tc_volume_describe(job->label_volume);
  float(*colors)[3] = malloc((mesh->n_surfaces + 1) * sizeof *colors);
  for (size_t i = 0; colors && i < mesh->n_surfaces; i++) {
    const double entry = (mesh->labels[i] - d->intercept) / d->slope - job->have.labels->base;
    const float *e = job->have.labels->entries[entry >= 0 && entry < job->have.labels->n ? (int)entry : job->have.labels->n];
    for (int c = 0; c < 3; c++) colors[i][c] = e[3] > 0 ? e[c] / e[3] : job->plan->surface.color[c];
  }
  return colors;
}

/* The scene's clip box and planes, in LPS. */
static int planes_of(const tc_scene *scene, double planes[TC_VIEW_MOST_CLIP][4]) {
  int n = 0;
  memset(planes, 0, TC_VIEW_MOST_CLIP * sizeof *planes);
  for (int k = 0; k < 3 && scene->clip.has_box; k++) {
    planes[n][k] = 1, planes[n++][3] = -scene->clip.box[0][k];
    planes[n][k] = -1, planes[n++][3] = scene->clip.box[1][k];
  }
  for (int i = 0; i < scene->clip.n_planes; i++) memcpy(planes[n++], scene->clip.planes[i], sizeof *planes);
  return n;
}

bool tc_mesh_frame_draw(tc_pool *pool, const tc_job *job, GError **error) {
  const tc_clusters *mesh = job->have.mesh;
  const int width = job->frame->width, height = job->frame->height;
  mesh_frame f = {.job = job, .progress = tc_frame_cut(job->frame, TC_RASTER_SIDE, error)};
  double planes[TC_VIEW_MOST_CLIP][4], samples[TC_RASTER_SAMPLES][2];
  tc_view view;
  tc_raster_counts counts = {0};
  float(*colors)[3] = job->have.labels ? colors_of(job) : NULL;
  if (job->have.labels && !colors) tc_set_error(error, TC_ERROR_MEMORY, NULL, "colours of labels: out of memory");
  if (!f.progress || (job->have.labels && !colors)) {
    free(colors);
    return false;
  }
  tc_resolve_init(&f.resolve, job->scene);
  const int n_planes = planes_of(job->scene, planes), n_samples = job->rays->count;
  tc_view_set_up(&view, mesh, &job->scene->camera, width, height, (const double(*)[4])planes, n_planes);
  for (int i = 0; i < n_samples; i++) samples[i][0] = job->rays->of_pixel[i].x, samples[i][1] = job->rays->of_pixel[i].y;
  tc_raster_look look = look_of(job);
  look.colors = (const float(*)[3])colors;
  const tc_raster_job raster = {.mesh = mesh,
                                .view = &view,
                                .kernels = tc_raster_kernels_named(job->isa),
                                .look = look,
                                .n_samples = n_samples,
                                .samples = (const double(*)[2])samples,
                                .one_sided = mesh->closed && n_planes == 0 && tc_view_is_outside(&view, mesh),
                                .finished = f.progress->finished,
                                .emit = emit,
                                .user = &f,
                                .pool = pool};
  const bool drawn = tc_raster_draw(&raster, &counts, error);
  free(colors);
  job->frame->stats.samples += counts.covered;
  if (job->key.shading) job->frame->stats.gradients += counts.shaded;
  job->frame->stats.leaps += counts.outside + counts.facing_away + counts.hidden;
  f.progress->done = 0;
  for (int i = 0; i < f.progress->units; i++) f.progress->done += f.progress->finished[i];
  return drawn;
}
