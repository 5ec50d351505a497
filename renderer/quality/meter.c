#include "renderer/quality/meter.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/base/clock.h"
#include "renderer/classify/labels.h"
#include "renderer/classify/preintegration.h"
#include "renderer/classify/transfer.h"
#include "renderer/mesh/measure.h"
#include "renderer/raycast/subpixel.h"
#include "renderer/reference/reference.h"

/* Tolerance of the reference: far below any bound on a frame's error, and fast. */
#define TOLERANCE 1e-7
#define MOST_BYTES (UINT64_C(256) << 20) /* limit on the meshes of one reference, which no ledger accounts for */
#define Z95 1.959964

typedef struct meter_pixel {
  int x, y;
  float rgba[4], depth; /* depth: NaN where the frame has none */
  float layers[TC_FRAME_LAYERS];
} meter_pixel;

struct tc_meter {
  int width, height, count;
  bool layered; /* the frame has layers */
  meter_pixel pixels[];
};

/* ---- choosing pixels ---- */

/* splitmix64 (Steele, Lea, Flood 2014). */
static double uniform(uint64_t *state) {
  uint64_t z = *state += 0x9e3779b97f4a7c15u;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return (double)((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

static int within(double x, int n) {
  int i = (int)(x * n);
  return i < n ? i : n - 1;
}

static void pick_all(tc_meter *m) {
  for (int i = 0; i < m->count; i++) m->pixels[i] = (meter_pixel){.x = i % m->width, .y = i / m->width};
}

/* Divides the picture into bands, and each band into cells, so that all cells have the same area. */
static void pick_cells(tc_meter *m, uint64_t *state) {
  int bands = (int)lround(sqrt((double)m->count * m->height / m->width));
  bands = bands < 1 ? 1 : bands > m->count ? m->count : bands;
  for (int b = 0, done = 0; b < bands; b++) {
    int cells = (int)((int64_t)m->count * (b + 1) / bands) - done;
    for (int c = 0; c < cells; c++) {
      double y = (done + cells * uniform(state)) / m->count, x = (c + uniform(state)) / cells;
      m->pixels[done + c] = (meter_pixel){.x = within(x, m->width), .y = within(y, m->height)};
    }
    done += cells;
  }
}

/* Fisher-Yates: the pixels measured before an early end are an unbiased sample. */
static void shuffle(tc_meter *m, uint64_t *state) {
  for (int i = m->count - 1; i > 0; i--) {
    int j = within(uniform(state), i + 1);
    meter_pixel p = m->pixels[i];
    m->pixels[i] = m->pixels[j];
    m->pixels[j] = p;
  }
}

tc_meter *tc_meter_new(const tc_frame *frame, int count, uint64_t seed) {
  int64_t all = (int64_t)frame->width * frame->height;
  bool whole = count >= all;
  if (whole) count = (int)all;
  tc_meter *m = malloc(sizeof *m + (size_t)count * sizeof *m->pixels);
  if (!m) return NULL;
  m->width = frame->width, m->height = frame->height, m->count = count;
  m->layered = frame->depth && frame->layers;
  if (whole)
    pick_all(m);
  else
    pick_cells(m, &seed);
  shuffle(m, &seed);
  for (int i = 0; i < count; i++) {
    meter_pixel *p = &m->pixels[i];
    const size_t at = (size_t)p->y * (size_t)frame->width + (size_t)p->x;
    memcpy(p->rgba, frame->linear + 4 * at, sizeof p->rgba);
    p->depth = frame->depth ? frame->depth[at] : NAN;
    if (m->layered) memcpy(p->layers, frame->layers[at], sizeof p->layers);
  }
  return m;
}

void tc_meter_free(tc_meter *meter) { free(meter); }

/* ---- the error ---- */

static double shown(const tc_scene *s, const double rgba[4], int c) {
  double v = rgba[c];
  if (s->image.transparent) return fmin(fmax(v, 0), 1);
  double behind = s->image.background[c];
  v += (1 - rgba[3]) * (s->image.linear_light ? tc_srgb_to_linear(behind) : behind);
  v = fmin(fmax(v, 0), 1);
  return s->image.linear_light ? tc_linear_to_srgb(v) : v;
}

double tc_meter_square(const tc_scene *scene, const double a[4], const double b[4], double *max) {
  int channels = scene->image.transparent ? 4 : 3;
  double sum = 0;
  for (int c = 0; c < channels; c++) {
    double d = shown(scene, a, c) - shown(scene, b, c);
    sum += d * d;
    *max = fmax(*max, fabs(d));
  }
  return sum / channels;
}

void tc_meter_estimate(const double *squares, int n, tc_meter_result *result) {
  double sum = 0, spread = 0;
  for (int i = 0; i < n; i++) sum += squares[i];
  double mean = n ? sum / n : 0;
  for (int i = 0; i < n; i++) spread += (squares[i] - mean) * (squares[i] - mean);
  result->pixels = n;
  result->rms = result->low = result->high = sqrt(mean);
  if (!(mean > 0)) return;
  if (n < 2) { /* one pixel has no variance */
    result->low = 0;
    result->high = 1;
    return;
  }
  /* Student's quantile to first order in 1 / (n - 1). The logarithm's deviation is halved, because rms is the root. */
  double t = Z95 + (Z95 * Z95 * Z95 + Z95) / (4.0 * (n - 1));
  double factor = exp(0.5 * t * sqrt(spread / (n - 1) / n) / mean);
  result->low /= factor;
  result->high = fmin(result->high * factor, 1);
}

void tc_meter_truth(const tc_reference *reference, const tc_scene *scene, int x, int y, double share, double rgba[4]) {
  tc_subpixel rays[TC_MAX_RAYS_PER_PIXEL];
  int count = scene->sampling.rays_per_pixel;
  tc_subpixel_rays(count, rays);
  for (int c = 0; c < 4; c++) rgba[c] = 0;
  for (int r = 0; r < count; r++) {
    double one[4];
    tc_reference_pixel(reference, x + 0.5 + share * rays[r].x, y + 0.5 + share * rays[r].y, one);
    for (int c = 0; c < 4; c++) rgba[c] += one[c] / count;
  }
}

/* ---- the reference ---- */

static bool goes_on(void *cancel) { return !cancel || !atomic_load((const atomic_bool *)cancel); }

/* Fills the views of the surfaces' meshes that the reference reads, and normals of those that have none; both
 * [n_surfaces]. */
static bool view_meshes(const tc_meter_subject *of, float (**normals)[3], tc_reference_mesh *views, GError **error) {
  uint64_t left = MOST_BYTES;
  for (size_t i = 0; i < of->scene->mesh.n_surfaces; i++) {
    const tc_mesh_surface *s = &of->scene->mesh.surfaces[i];
    const tc_mesh *m = of->meshes && s->source == TC_SURFACE_OF_MESH && s->visible ? of->meshes[i] : NULL;
    if (!m) continue;
    const uint64_t bytes = tc_mesh_bytes(m->n_vertices, m->n_triangles, true) + (m->colors ? m->n_vertices * TC_MESH_COLOR_BYTES : 0);
    if (bytes >= left) {
      tc_set_error(error, TC_ERROR_LIMIT, "/mesh/surfaces",
                   "the error meter takes meshes of less than 256 MiB together; show fewer or simplified ones");
      return false;
    }
    left -= bytes;
    if (!m->normals && !(normals[i] = tc_mesh_normals_of(m, goes_on, (void *)(uintptr_t)of->cancel, error))) return false;
    views[i] = (tc_reference_mesh){{m->origin[0], m->origin[1], m->origin[2]},
                                   m->n_vertices,
                                   m->n_triangles,
                                   (const float(*)[3])m->positions,
                                   (const float(*)[3])(m->normals ? m->normals : normals[i]),
                                   (const uint32_t(*)[3])m->triangles,
                                   m->colors};
  }
  return true;
}

tc_reference *tc_meter_reference(const tc_meter_subject *of, int width, int height, GError **error) {
  const size_t n = of->scene->mesh.n_surfaces;
  g_autofree float(**normals)[3] = g_malloc0_n(n + 1, sizeof *normals);
  g_autofree tc_reference_mesh *views = g_new0(tc_reference_mesh, n + 1);
  const tc_reference_request request = {.volume = of->volume,
                                        .labels = of->labels,
                                        .meshes = views,
                                        .scene = of->scene,
                                        .width = width,
                                        .height = height,
                                        .tolerance = TOLERANCE,
                                        .cancel = of->cancel};
  const bool good = !tc_reference_missing(of->scene) || view_meshes(of, normals, views, error);
  tc_reference *r = good ? tc_reference_make(&request, error) : NULL;
  for (size_t i = 0; i < n; i++) free(normals[i]);
  return r;
}

/* Depths of the pixels measured. */
typedef struct found {
  int n;
  tc_depths *first; /* [n] of the first surface */
  tc_depths *layers; /* [n][TC_FRAME_LAYERS] */
} found;

static void add_depths(found *f, const tc_meter *m, const meter_pixel *p, const tc_reference *reference, const tc_scene *scene) {
  tc_depths *layers = f->layers + f->n * TC_FRAME_LAYERS;
  f->first[f->n].drawn = (double)p->depth;
  tc_depths_exact(reference, scene, p->x, p->y, &f->first[f->n++]);
  if (!m->layered) return;
  for (int i = 0; i < TC_FRAME_LAYERS; i++) layers[i].drawn = (double)p->layers[i];
  tc_depths_exact_layers(reference, p->x, p->y, layers);
}

/* Sorts the depths of the first surface, whose memory then serves each layer. */
static void compare_depths(const found *f, const tc_meter *m, tc_meter_result *result) {
  result->n_surfaces = tc_depths_compare(f->first, f->n, &result->depth, result->surfaces, TC_METER_SURFACES);
  for (int i = 0; i < TC_FRAME_LAYERS && m->layered; i++) {
    tc_depth_error *layer = &result->layers[i];
    for (int p = 0; p < f->n; p++) f->first[p] = f->layers[p * TC_FRAME_LAYERS + i];
    tc_depths_compare(f->first, f->n, layer, NULL, 0);
    if (layer->both || layer->one) result->n_layers = i + 1;
  }
}

bool tc_meter_measure(const tc_meter *meter, const tc_meter_subject *of, double most_ms, tc_meter_result *result,
                      GError **error) {
  double start = tc_now_ms();
  const size_t count = (size_t)meter->count;
  *result = (tc_meter_result){0};
  tc_reference *reference = tc_meter_reference(of, meter->width, meter->height, error);
  double *squares = reference ? malloc(count * sizeof *squares) : NULL;
  found depths = {.first = squares ? malloc(count * (1 + TC_FRAME_LAYERS) * sizeof *depths.first) : NULL};
  if (reference && !depths.first) tc_set_error(error, TC_ERROR_MEMORY, NULL, "error meter: out of memory");
  depths.layers = depths.first ? depths.first + count : NULL;
  bool stopped = false;
  int n = 0;
  while (depths.first && n < meter->count) {
    const meter_pixel *p = &meter->pixels[n];
    double wanted[4], got[4];
    tc_meter_truth(reference, of->scene, p->x, p->y, 1, wanted);
    for (int c = 0; c < 4; c++) got[c] = (double)p->rgba[c];
    squares[n++] = tc_meter_square(of->scene, got, wanted, &result->max);
    if (tc_meter_wants_depth(of->scene) && !isnan(p->depth)) add_depths(&depths, meter, p, reference, of->scene);
    stopped = of->cancel && atomic_load_explicit(of->cancel, memory_order_relaxed);
    if (stopped || (most_ms > 0 && tc_now_ms() - start > most_ms)) break;
  }
  if (depths.first) tc_meter_estimate(squares, n, result);
  if (depths.n) compare_depths(&depths, meter, result);
  if (stopped) tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
  result->ms = tc_now_ms() - start;
  bool good = depths.first && !stopped;
  free(depths.first);
  free(squares);
  tc_reference_free(reference);
  return good;
}
