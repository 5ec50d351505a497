#include "renderer/mesh/levels.h"

#include <math.h>
#include <meshoptimizer.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "renderer/mesh/deviation.h"

#define GROUP 32      /* clusters of a group: about 3,500 triangles, whose levels take five milliseconds to build */
#define QUARTER 4
#define WORTH 0.7     /* a level with more than this share of the previous level's triangles is dropped */
#define FARTHEST 0.1f /* largest quadric error of the first level, in edge lengths of full detail */
#define FARTHER 5      /* factor on FARTHEST for each further level */

typedef struct corner {
  float at[3];
  uint32_t normal; /* octahedral */
  uint32_t color;  /* 0 without colours */
} corner;

/* A group as one mesh with shared vertices. */
typedef struct patch {
  corner *corners; /* [3 * n] as in the clusters, later [n_vertices] */
  uint32_t *places, *triangles, *level;
  uint32_t *piece;       /* [n_vertices] first vertex of the connected component that the vertex belongs to */
  float (*boxes)[6];     /* [n_vertices] box of each component, at its first vertex: -low, high; -INFINITY if the level still contains it */
  size_t n, n_vertices;
  float (*positions)[3]; /* [n_vertices] */
} patch;

typedef struct making {
  const tc_clusters *of;
  const atomic_bool *stop;
  tc_clusters *out;
  size_t group;
} making;

static bool out_of_memory(GError **error) {
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "levels of detail: out of memory");
  return false;
}

static bool is_stopped(const making *m, GError **error) {
  if (!m->stop || !atomic_load(m->stop)) return false;
  tc_set_error(error, TC_ERROR_CANCELLED, NULL, "levels of detail: cancelled");
  return true;
}

/* ---- a group ---- */

static void gather(const tc_clusters *c, size_t first, size_t end, patch *p) {
  corner *to = p->corners;
  for (const tc_cluster *k = c->clusters + first; k < c->clusters + end; k++) {
    const size_t room = tc_cluster_padded(k->n_vertices), row = tc_cluster_padded(k->n_triangles);
    const float *at = c->positions + 3 * (size_t)k->vertex;
    const uint8_t *triangle = c->triangles + 3 * (size_t)k->triangle;
    for (size_t t = 0; t < k->n_triangles; t++)
      for (size_t i = 0; i < 3; i++, to++) {
        const size_t v = triangle[i * row + t];
        for (size_t d = 0; d < 3; d++) to->at[d] = at[d * room + v];
        to->normal = c->normals ? c->normals[k->vertex + v] : 0;
        to->color = c->parts[k->part].colored ? c->colors[k->vertex + v] : 0;
      }
  }
}

static void free_patch(patch *p) {
  free(p->corners), free(p->places), free(p->triangles), free(p->level), free(p->positions);
  free(p->piece), free(p->boxes);
}

static uint32_t first_of(uint32_t *piece, uint32_t v) {
  while (piece[v] != v) v = piece[v] = piece[piece[v]];
  return v;
}

/* Finds connected components. */
static void find_pieces(patch *p) {
  for (uint32_t v = 0; v < p->n_vertices; v++) p->piece[v] = v;
  for (size_t i = 0; i < 3 * p->n; i++) {
    const uint32_t a = first_of(p->piece, p->triangles[i]), b = first_of(p->piece, p->triangles[i % 3 == 2 ? i - 2 : i + 1]);
    p->piece[a > b ? a : b] = a > b ? b : a;
  }
  for (uint32_t v = 0; v < p->n_vertices; v++) p->piece[v] = first_of(p->piece, v);
}

static bool make_patch(const tc_clusters *c, size_t first, size_t end, patch *p) {
  *p = (patch){0};
  for (size_t i = first; i < end; i++) p->n += c->clusters[i].n_triangles;
  const size_t n = 3 * p->n;
  p->corners = malloc(n * sizeof *p->corners), p->positions = malloc(n * sizeof *p->positions);
  p->places = malloc(n * sizeof *p->places), p->triangles = malloc(n * sizeof *p->triangles);
  p->level = malloc(n * sizeof *p->level), p->piece = malloc(n * sizeof *p->piece);
  p->boxes = malloc(n * sizeof *p->boxes);
  if (!p->corners || !p->positions || !p->places || !p->triangles || !p->level || !p->piece || !p->boxes) return false;
  gather(c, first, end, p);
  p->n_vertices = meshopt_generateVertexRemap(p->places, NULL, n, p->corners, n, sizeof *p->corners);
  meshopt_remapIndexBuffer(p->triangles, NULL, n, p->places);
  meshopt_remapVertexBuffer(p->corners, p->corners, n, sizeof *p->corners, p->places);
  for (size_t i = 0; i < p->n_vertices; i++) memcpy(p->positions[i], p->corners[i].at, sizeof *p->positions);
  memcpy(p->level, p->triangles, n * sizeof *p->level);
  find_pieces(p);
  return true;
}

static void bound_patch(const patch *p, tc_group *g) {
  float lo[3] = {INFINITY, INFINITY, INFINITY}, hi[3] = {-INFINITY, -INFINITY, -INFINITY}, most = 0;
  for (size_t i = 0; i < p->n_vertices; i++)
    for (int k = 0; k < 3; k++) lo[k] = fminf(lo[k], p->positions[i][k]), hi[k] = fmaxf(hi[k], p->positions[i][k]);
  for (int k = 0; k < 3; k++) g->centre[k] = 0.5f * (lo[k] + hi[k]);
  for (size_t i = 0; i < p->n_vertices; i++) {
    float square = 0;
    for (int k = 0; k < 3; k++) square += (p->positions[i][k] - g->centre[k]) * (p->positions[i][k] - g->centre[k]);
    most = fmaxf(most, square);
  }
  g->radius = sqrtf(most) * (1 + 1e-5f);
}

/* ---- errors ---- */

/* Size of the largest component that the level lost; marks the others. */
static float lost_of(patch *p, size_t n) {
  float most = 0;
  for (size_t v = 0; v < p->n_vertices; v++)
    for (int k = 0; k < 6; k++) p->boxes[v][k] = -INFINITY;
  for (size_t v = 0; v < p->n_vertices; v++)
    for (int k = 0; k < 6; k++) {
      float *box = p->boxes[p->piece[v]], at = k < 3 ? -p->positions[v][k] : p->positions[v][k - 3];
      box[k] = at > box[k] ? at : box[k];
    }
  for (size_t i = 0; i < 3 * n; i++) p->boxes[p->piece[p->level[i]]][0] = -INFINITY;
  for (size_t v = 0; v < p->n_vertices; v++) {
    const float *box = p->boxes[v];
    float square = 0;
    for (int k = 0; k < 3; k++) square += (box[k] + box[3 + k]) * (box[k] + box[3 + k]);
    if (p->piece[v] == v && box[0] > -INFINITY && square > most) most = square;
  }
  return sqrtf(most);
}

/* Error of a level: the largest distance from a vertex of full detail to the level, or from a triangle's or edge's middle of
 * the level to full detail; a lost component counts with its size. INFINITY if there is no memory. */
static float deviation_of(patch *p, const tc_deviation *full, size_t n) {
  const float(*at)[3] = (const float(*)[3])p->positions;
  tc_deviation *level = tc_deviation_begin(at, p->level, n);
  float most = level ? lost_of(p, n) : INFINITY;
  for (size_t i = 0; level && i < p->n_vertices; i++)
    if (!(p->boxes[p->piece[i]][0] > -INFINITY)) most = fmaxf(most, tc_deviation_at(level, at[i], most));
  for (size_t t = 0; level && t < n; t++) {
    const float *a = at[p->level[3 * t]], *b = at[p->level[3 * t + 1]], *c = at[p->level[3 * t + 2]];
    float middles[4][3];
    for (int k = 0; k < 3; k++) {
      middles[0][k] = (a[k] + b[k] + c[k]) / 3, middles[1][k] = 0.5f * (a[k] + b[k]);
      middles[2][k] = 0.5f * (b[k] + c[k]), middles[3][k] = 0.5f * (c[k] + a[k]);
    }
    for (int i = 0; i < 4; i++) most = fmaxf(most, tc_deviation_at(full, middles[i], most));
  }
  tc_deviation_end(level);
  return most;
}

/* ---- levels ---- */

static void unpack(uint32_t packed, float n[3]) {
  const float x = (float)(int16_t)(uint16_t)packed / 32767, y = (float)(int16_t)(uint16_t)(packed >> 16) / 32767;
  n[2] = 1 - fabsf(x) - fabsf(y);
  n[0] = n[2] < 0 ? copysignf(1 - fabsf(y), x) : x;
  n[1] = n[2] < 0 ? copysignf(1 - fabsf(x), y) : y;
}

/* Appends the level's n triangles as clusters. */
static bool add_level(making *m, const patch *p, size_t n, int level, uint16_t part, GError **error) {
  const bool normals = m->of->normals != NULL, colored = m->of->parts[part].colored;
  tc_mesh *mesh = tc_mesh_new(p->n_vertices, n, normals, error);
  if (mesh && colored && !tc_mesh_add_colors(mesh, error)) g_clear_pointer(&mesh, tc_mesh_free);
  if (!mesh) return false;
  memcpy(mesh->origin, m->of->origin, sizeof mesh->origin);
  memcpy(mesh->positions, p->positions, p->n_vertices * sizeof *p->positions);
  for (size_t i = 0; normals && i < p->n_vertices; i++) unpack(p->corners[i].normal, mesh->normals[i]);
  for (size_t i = 0; colored && i < p->n_vertices; i++) mesh->colors[i] = p->corners[i].color;
  memcpy(mesh->triangles, p->level, n * sizeof *mesh->triangles);
  tc_clusters *made = tc_clusters_make(mesh, NULL, NULL, error);
  tc_mesh_free(mesh);
  if (!made) return false;
  for (size_t i = 0; i < made->n; i++)
    made->clusters[i].part = part, made->clusters[i].group = (uint32_t)m->group & 0x3fffffff, made->clusters[i].level = level & 3;
  const bool added = tc_clusters_append(m->out, made, error);
  tc_clusters_free(made);
  return added;
}

/* Mean edge length. */
static float edge_of(const patch *p) {
  double sum = 0;
  for (size_t t = 0; t < p->n; t++) {
    const float *a = p->positions[p->triangles[3 * t]], *b = p->positions[p->triangles[3 * t + 1]];
    float square = 0;
    for (int k = 0; k < 3; k++) square += (b[k] - a[k]) * (b[k] - a[k]);
    sum += (double)sqrtf(square);
  }
  return (float)(sum / (double)p->n);
}

/* Groups with several vertex colours get no levels: the error measures distance only, and a level would shift colours. */
static bool has_one_color(const patch *p) {
  for (size_t i = 1; i < p->n_vertices; i++)
    if (p->corners[i].color != p->corners[0].color) return false;
  return true;
}

static bool add_levels(making *m, patch *p, uint16_t part, GError **error) {
  tc_group *g = &m->out->groups[m->group];
  const float *at = &p->positions[0][0];
  float farthest = FARTHEST;
  bool good = true;
  size_t n = p->n;
  const float edge = edge_of(p), extent = meshopt_simplifyScale(at, p->n_vertices, sizeof *p->positions);
  g->triangles[0] = (uint32_t)n;
  if (!has_one_color(p)) return true;
  tc_deviation *full = tc_deviation_begin((const float(*)[3])p->positions, p->triangles, n);
  if (!full) return out_of_memory(error);
  for (int level = 1; level < TC_LEVELS && good; level++, farthest *= FARTHER) {
    const size_t left = meshopt_simplify(p->level, p->level, 3 * n, at, p->n_vertices, sizeof *p->positions,
                                         3 * (n / QUARTER), farthest * edge / fmaxf(extent, 1e-30f), meshopt_SimplifyLockBorder, NULL) / 3;
    if (is_stopped(m, error)) good = false;
    if (!good || left == 0 || (double)left > WORTH * (double)n) break;
    n = left;
    g->triangles[level] = (uint32_t)n;
    g->error[level] = fmaxf(g->error[level - 1], deviation_of(p, full, n));
    good = !is_stopped(m, error) && add_level(m, p, n, level, part, error);
  }
  tc_deviation_end(full);
  return good;
}

static bool add_group(making *m, size_t first, size_t end, GError **error) {
  tc_group *g = &m->out->groups[m->group];
  patch p;
  *g = (tc_group){.first = (uint32_t)first, .n = (uint32_t)(end - first)};
  for (int i = 1; i < TC_LEVELS; i++) g->error[i] = INFINITY;
  bool good = make_patch(m->of, first, end, &p) || out_of_memory(error);
  if (good) bound_patch(&p, g);
  good = good && !is_stopped(m, error) && add_levels(m, &p, m->of->clusters[first].part, error);
  free_patch(&p);
  m->group++;
  return good;
}

static size_t groups_of(const tc_clusters *c) {
  size_t n = 0;
  for (size_t i = 0; i < c->n_parts; i++) n += (c->parts[i].n + GROUP - 1) / GROUP;
  return n;
}

tc_clusters *tc_levels_make(const tc_clusters *of, const atomic_bool *stop, GError **error) {
  making m = {.of = of, .stop = stop, .out = tc_clusters_none(of, error)};
  bool good = m.out != NULL;
  if (good) {
    m.out->n_groups = groups_of(of);
    m.out->groups = calloc(m.out->n_groups + 1, sizeof *m.out->groups);
    good = m.out->groups || out_of_memory(error);
  }
  for (size_t i = 0; i < of->n_parts && good; i++)
    for (size_t at = 0; at < of->parts[i].n && good; at += GROUP)
      good = add_group(&m, of->parts[i].first + at, of->parts[i].first + MIN(at + GROUP, of->parts[i].n), error);
  if (good) return m.out;
  tc_clusters_free(m.out);
  return NULL;
}

size_t tc_levels_bytes(const tc_clusters *of) { return of->bytes / 4 * 3 + groups_of(of) * sizeof *of->groups; }

bool tc_levels_add(tc_clusters *to, tc_clusters *levels, GError **error) {
  const bool added = tc_clusters_append(to, levels, error);
  if (added) {
    to->refined++;
    to->groups = levels->groups, to->n_groups = levels->n_groups;
    to->bytes += to->n_groups * sizeof *to->groups;
    levels->groups = NULL;
    for (size_t g = 0; g < to->n_groups; g++)
      for (size_t i = to->groups[g].first; i < to->groups[g].first + to->groups[g].n; i++)
        to->clusters[i].group = (uint32_t)g & 0x3fffffff;
  }
  tc_clusters_free(levels);
  return added;
}

/* ---- the choice ---- */

/* Upper bound of a millimetre's size in pixels within the group's sphere. */
static double pixels_of_mm(const tc_mesh_view *v, const tc_group *g, double slope) {
  const double centre[3] = {g->centre[0], g->centre[1], g->centre[2]};
  if (!v->perspective) return v->scale;
  const double nearest = tc_mesh_view_row(v->depth, centre) + v->reference - (double)g->radius;
  return nearest > 0 ? v->scale * slope / nearest : INFINITY;
}

size_t tc_levels_choose(const tc_clusters *mesh, const tc_mesh_view *v, double pixels, uint8_t *level) {
  /* Motion along the view direction shifts a point in the picture in proportion to its distance from the centre; most in a corner. */
  const double slope = sqrt(1 + (v->centre[0] * v->centre[0] + v->centre[1] * v->centre[1]) / (v->scale * v->scale));
  size_t n = 0;
  for (size_t i = 0; i < mesh->n_groups; i++) {
    const tc_group *g = &mesh->groups[i];
    const double of_mm = pixels_of_mm(v, g, slope);
    level[i] = 0;
    for (uint8_t l = 1; l < TC_LEVELS; l++)
      if ((double)g->error[l] * of_mm <= pixels) level[i] = l;
    n += g->triangles[level[i]];
  }
  return n;
}

/* ---- building in the background ---- */

struct tc_refining {
  const tc_clusters *of;
  tc_clusters *made;
  pthread_t thread;
  atomic_bool stop, over;
};

static atomic_bool at_work; /* one thread for the process, for any number of meshes */

static void *refine(void *context) {
  tc_refining *r = context;
  setpriority(PRIO_PROCESS, 0, 19); /* affects this thread only */
  r->made = tc_levels_make(r->of, &r->stop, NULL);
  atomic_store(&r->over, true);
  atomic_store(&at_work, false);
  return NULL;
}

tc_refining *tc_refining_begin(const tc_clusters *of) {
  if (atomic_exchange(&at_work, true)) return NULL;
  tc_refining *r = calloc(1, sizeof *r);
  if (r) r->of = of;
  if (r && !pthread_create(&r->thread, NULL, refine, r)) return r;
  atomic_store(&at_work, false);
  free(r);
  return NULL;
}

bool tc_refining_is_over(const tc_refining *r) { return atomic_load(&r->over); }

tc_clusters *tc_refining_end(tc_refining *r) {
  if (!r) return NULL;
  atomic_store(&r->stop, true);
  pthread_join(r->thread, NULL);
  tc_clusters *made = r->made;
  free(r);
  return made;
}
