/* Shading at a point of the exact field: the model of raycast/shading.h, written independently from the textbook
 * forms. */
#include <math.h>

#include "renderer/reference/internal.h"

#define FLAT 0.005 /* gradient, as a share of the value range per least spacing: no shading below */
#define STEEP 0.02 /* full shading above */

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const double a[3], const double b[3], double c[3]) {
  for (int k = 0; k < 3; k++) c[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

void tc_ref_shading_set_up(tc_ref_shading *shading, const tc_volume *volume, const tc_scene *scene) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *stats = tc_volume_statistics(volume);
  double axis[3][3], least = fmin(d->spacing[0], fmin(d->spacing[1], d->spacing[2]));
  for (int k = 0; k < 3; k++)
    for (int r = 0; r < 3; r++) axis[k][r] = d->direction[3 * r + k] * d->spacing[k];
  for (int k = 0; k < 3; k++) {
    cross(axis[(k + 1) % 3], axis[(k + 2) % 3], shading->dual[k]);
    double volume_mm3 = dot(shading->dual[k], axis[k]);
    for (int r = 0; r < 3; r++) shading->dual[k][r] /= volume_mm3;
  }
  shading->model = scene->shading.model;
  /* the derivative of the field that is integrated */
  shading->gradient = scene->filter == TC_FILTER_CUBIC ? TC_GRADIENT_CUBIC : scene->shading.gradient;
  shading->per_range = stats->max > stats->min ? least / (stats->max - stats->min) : 0;
  shading->ambient = scene->shading.ambient;
  shading->diffuse = scene->shading.diffuse;
  shading->specular = shading->model == TC_SHADING_LAMBERT ? 0 : scene->shading.specular;
  shading->shininess = scene->shading.shininess;
  shading->n_lights = 1;
  shading->lights[0].at_camera = scene->shading.light_at_camera;
  double length = sqrt(dot(scene->shading.light, scene->shading.light));
  for (int k = 0; k < 3; k++) shading->lights[0].to[k] = scene->shading.light[k] / length, shading->lights[0].color[k] = 1;
}

void tc_ref_shading_light(tc_ref_shading *shading, const tc_scene *scene) {
  if (!scene->mesh.n_lights) return;
  shading->n_lights = scene->mesh.n_lights;
  for (int i = 0; i < shading->n_lights; i++) {
    const tc_mesh_light *from = &scene->mesh.lights[i];
    const double length = sqrt(dot(from->direction, from->direction));
    shading->lights[i].at_camera = from->at_camera;
    for (int k = 0; k < 3; k++) {
      const double c = scene->image.linear_light ? tc_ref_to_linear(from->color[k]) : from->color[k];
      shading->lights[i].to[k] = from->at_camera ? 0 : from->direction[k] / length;
      shading->lights[i].color[k] = c * from->intensity;
    }
  }
}

/* A gradient from index coordinates to LPS; it is covariant. */
static void to_lps(const tc_ref_shading *s, const double g[3], double gradient[3]) {
  for (int r = 0; r < 3; r++) gradient[r] = g[0] * s->dual[0][r] + g[1] * s->dual[1][r] + g[2] * s->dual[2][r];
}

/* d value / d LPS at u of the cell. */
static void gradient_at(const tc_ref_shading *s, const tc_ref_cell *cell, double u, double gradient[3]) {
  double x[3], g[3];
  for (int k = 0; k < 3; k++) x[k] = fmin(fmax(cell->start[k] + u * cell->delta[k], 0), 1);
  tc_ref_gradient(cell->field, s->gradient, cell->low, cell->around, x, g);
  to_lps(s, g, gradient);
}

static double smooth_step(double from, double to, double x) {
  double f = fmin(fmax((x - from) / (to - from), 0), 1);
  return f * f * (3 - 2 * f);
}

/* Highlight of one light. */
static double glint_of(const tc_ref_shading *s, const double n[3], const double eye[3], const double light[3]) {
  double half[3];
  for (int k = 0; k < 3; k++) half[k] = eye[k] + light[k];
  double length = sqrt(dot(half, half));
  return s->specular > 0 && length > 0 ? s->specular * pow(fmax(dot(n, half) / length, 0), s->shininess) : 0;
}

/* The colour of a fully shaded surface with unit normal n. Gooch's tones follow the sum of the lights' cosines. */
static void reflect(const tc_ref_shading *s, const double n[3], const double eye[3], const double color[3], double out[3]) {
  double sum[3] = {0, 0, 0}, glint[3] = {0, 0, 0};
  for (int i = 0; i < s->n_lights; i++) {
    const double *light = s->lights[i].at_camera ? eye : s->lights[i].to, nl = dot(n, light);
    const double shine = nl > 0 ? glint_of(s, n, eye, light) : 0;
    for (int c = 0; c < 3; c++) {
      sum[c] += s->lights[i].color[c] * (s->model == TC_SHADING_GOOCH ? nl : fmax(nl, 0));
      glint[c] += s->lights[i].color[c] * shine;
    }
  }
  for (int c = 0; c < 3; c++) {
    double cool = (c == 2 ? 0.4 : 0) + s->ambient * color[c], warm = (c < 2 ? 0.4 : 0) + s->diffuse * color[c];
    double lit = s->model == TC_SHADING_GOOCH ? cool + (warm - cool) * (1 + sum[c]) / 2
                                              : (s->ambient + s->diffuse * sum[c]) * color[c];
    out[c] = lit + glint[c];
  }
}

/* n: a gradient other than 0; becomes the unit normal on the eye's side. */
static void shade(const tc_ref_shading *s, double n[3], double weight, double rgb[3]) {
  double eye[3], lit[3], size = sqrt(dot(n, n));
  for (int k = 0; k < 3; k++) eye[k] = -s->view[k];
  double side = dot(n, eye) < 0 ? -size : size;
  for (int k = 0; k < 3; k++) n[k] /= side;
  if (s->model == TC_SHADING_NONE) return;
  reflect(s, n, eye, rgb, lit);
  for (int c = 0; c < 3; c++) rgb[c] = fmin(fmax((1 - weight) * rgb[c] + weight * lit[c], 0), 1);
}

void tc_ref_shade(const tc_ref_shading *s, const tc_ref_cell *cell, double u, double rgb[3]) {
  double n[3];
  gradient_at(s, cell, u, n);
  double weight = smooth_step(FLAT, STEEP, sqrt(dot(n, n)) * s->per_range);
  if (weight > 0) shade(s, n, weight, rgb);
}

void tc_ref_shade_surface(const tc_ref_shading *s, const double gradient[3], double normal[3], double rgb[3]) {
  to_lps(s, gradient, normal);
  tc_ref_shade_normal(s, normal, rgb);
}

void tc_ref_shade_normal(const tc_ref_shading *s, double normal[3], double rgb[3]) {
  if (dot(normal, normal) > 0) shade(s, normal, 1, rgb);
}
