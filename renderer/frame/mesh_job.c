#include "renderer/frame/mesh_job.h"

#include <stdlib.h>
#include <string.h>

#include "renderer/raycast/shade.h"

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

bool tc_mesh_job_begin(tc_mesh_job *m, const tc_job *job, GError **error) {
  const tc_clusters *mesh = job->have.mesh;
  double planes[TC_VIEW_MOST_CLIP][4];
  const int n_planes = planes_of(job->scene, planes);
  m->colors = job->have.labels ? colors_of(job) : NULL;
  if (job->have.labels && !m->colors) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "colours of labels: out of memory");
    return false;
  }
  tc_view_set_up(&m->view, mesh, &job->scene->camera, job->frame->width, job->frame->height,
                 (const double(*)[4])planes, n_planes);
  for (int i = 0; i < job->rays->count; i++)
    m->samples[i][0] = job->rays->of_pixel[i].x, m->samples[i][1] = job->rays->of_pixel[i].y;
  m->raster = (tc_raster_job){.mesh = mesh,
                              .view = &m->view,
                              .look = look_of(job),
                              .n_samples = job->rays->count,
                              .samples = (const double(*)[2])m->samples,
                              .one_sided = mesh->closed && n_planes == 0 && tc_view_is_outside(&m->view, mesh)};
  m->raster.look.colors = (const float(*)[3])m->colors;
  return true;
}

void tc_mesh_job_end(tc_mesh_job *m) { free(m->colors); }
