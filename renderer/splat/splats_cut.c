/* Cut faces: splats of the voxels that clip planes expose, and the object's surfaces at which the faces end. */
#include "renderer/splat/builder.h"

#include <stdlib.h>
#include <string.h>

#include "renderer/base/vector.h"

#define MOST_FACES 4 /* cut faces of a voxel; where more planes meet, each face is small */

typedef struct cutting {
  const tc_vmd *model;
  const double (*planes)[4];
  int n_planes;
  double reach[TC_SPLAT_MOST_PLANES]; /* largest distance from each plane of a kept voxel with a clipped neighbour */
  tc_splat_builder out;
  GArray *rims; /* of the splats in `out` */
  const tc_splats *of; /* the whole model's; the last brick read, its end in the packed bricks, and the number of bricks read: */
  tc_splat_brick read;
  size_t next;
  uint32_t n_read;
  uint32_t surface[TC_SPLAT_BRICK * TC_SPLAT_BRICK * TC_SPLAT_BRICK]; /* words of a brick's voxels, with insets in place of positions */
} cutting;

/* Lines and single voxels are drawn as cylinders and balls and get no cut faces, which would be wider than they are. */
static bool is_round(uint32_t surface) { return tc_splat_is_thin(surface >> 12 & 63) && (surface >> 6 & 3) != TC_SPLAT_SHEET; }

static double distance(const double plane[4], int x, int y, int z) {
  return plane[0] * x + plane[1] * y + plane[2] * z + plane[3];
}

/* A plane that exposes a voxel. */
typedef struct opening {
  const double *plane;
  double at;      /* mm from the plane to the voxel */
  unsigned faces; /* faces whose neighbours the plane clips */
} opening;

/* Finds the nearest planes that expose a voxel, at most MOST_FACES, and the faces of all such planes. Returns the number of planes; 0
 * if the voxel itself is clipped. */
static int find_openings(const cutting *c, int x, int y, int z, opening found[MOST_FACES], unsigned *faces) {
  int n = 0;
  *faces = 0;
  for (int i = 0; i < c->n_planes; i++) {
    const double *plane = c->planes[i];
    opening o = {plane, distance(plane, x, y, z), 0};
    if (o.at < 0) return 0;
    for (int f = 0; f < 6; f++) o.faces |= (unsigned)(o.at + (f & 1 ? 1 : -1) * plane[f / 2] < 0) << f;
    if (!o.faces) continue;
    *faces |= o.faces;
    if (n == MOST_FACES && o.at >= found[n - 1].at) continue;
    int k = n < MOST_FACES ? n++ : n - 1;
    for (; k > 0 && o.at < found[k - 1].at; k--) found[k] = found[k - 1];
    found[k] = o;
  }
  return n;
}

/* Adds a cut face on a plane; of a voxel exposed on opposite sides, a single one at the voxel's centre. */
static void add_face(const cutting *c, const int at[3], const opening *o, unsigned faces) {
  const double *plane = o->plane;
  double normal[3];
  tc_splat_to_lps(&c->model->head.grid, (double[]){-plane[0], -plane[1], -plane[2]}, normal);
  tc_splat_add(&c->out, at, faces, normal, tc_splat_is_thin(faces) ? 0 : tc_splat_pack_distance(o->at / length3(plane)));
}

/* Adds the cut faces of voxels z0 .. z1 - 1 of a column. */
static void cut_run(cutting *c, int x, int y, int z0, int z1) {
  for (int z = z0; z < z1; z++) {
    opening found[MOST_FACES];
    unsigned faces;
    const int n = find_openings(c, x, y, z, found, &faces);
    if (!n) continue;
    const uint32_t place = (uint32_t)((x & 15) | (y & 15) << 4 | (z & 15) << 8), surface = c->surface[place];
    if (is_round(surface)) { /* visible from the side of the cut, too */
      tc_splat_add_word(&c->out, (surface & ~0xfffu) | faces << 12 | place, (uint8_t)surface);
      continue;
    }
    const bool thin = tc_splat_is_thin(faces);
    for (int i = 0; i < (thin ? 1 : n); i++) add_face(c, (int[]){x, y, z}, &found[i], thin ? faces : found[i].faces);
  }
}

/* Narrows lo .. hi along z to the part within reach of plane i; false: empty. */
static bool near_plane(const cutting *c, int i, int x, int y, int *lo, int *hi) {
  const double *p = c->planes[i], at = distance(p, x, y, 0);
  double from = *lo, to = *hi;
  if (p[2] == 0) return at >= 0 && at <= c->reach[i];
  double a = -at / p[2], b = (c->reach[i] - at) / p[2];
  from = fmax(from, floor(fmin(a, b))), to = fmin(to, ceil(fmax(a, b)) + 1);
  *lo = (int)from, *hi = (int)fmax(to, from);
  return from < to;
}

static void cut_column(cutting *c, int x, int y, int bz) {
  const int z0 = bz * TC_SPLAT_BRICK, z1 = z0 + TC_SPLAT_BRICK;
  bool any = false;
  int from = z1, to = z0;
  for (int i = 0; i < c->n_planes; i++) {
    int lo = z0, hi = z1;
    if (near_plane(c, i, x, y, &lo, &hi)) any = true, from = MIN(from, lo), to = MAX(to, hi);
  }
  if (!any) return;
  for (tc_vmd_run run = {.at = tc_vmd_column(c->model, x, y)}; tc_vmd_next(c->model, &run) && run.z < to;)
    cut_run(c, x, y, MAX(run.z, from), MIN(run.z + run.count, to));
}

/* True if a plane passes through the brick. */
static bool meets_brick(const cutting *c, const int at[3]) {
  for (int i = 0; i < c->n_planes; i++) {
    double middle = c->planes[i][3], half = 0;
    for (int k = 0; k < 3; k++) {
      middle += c->planes[i][k] * (at[k] * TC_SPLAT_BRICK + 7.5);
      half += fabs(c->planes[i][k]) * 7.5;
    }
    if (middle + half >= 0 && middle - half <= c->reach[i]) return true;
  }
  return false;
}

static bool comes_before(const int a[3], const int b[3]) {
  return a[1] != b[1] ? a[1] < b[1] : a[0] != b[0] ? a[0] < b[0] : a[2] < b[2];
}

/* Sets c->surface for a brick. Must be called for bricks in the order of the whole model's splats. */
static void find_surface(cutting *c, const int at[3]) {
  const tc_splats *of = c->of;
  memset(c->surface, 0, sizeof c->surface);
  while (c->n_read < of->n_bricks && (!c->n_read || comes_before(c->read.at, at))) tc_splats_next(of, &c->next, &c->read), c->n_read++;
  if (!c->n_read || memcmp(c->read.at, at, sizeof c->read.at) != 0) return;
  for (uint32_t i = c->read.first; i < c->read.first + c->read.count; i++) {
    const uint32_t word = of->words[i];
    if (word >> 12 & 63 && of->insets[i]) c->surface[word & 0xfff] = (word & ~0xfffu) | of->insets[i];
  }
}

/* Adds the cut faces in all bricks with one x and y. */
static void cut_bricks(cutting *c, int bx, int by) {
  const int *dims = c->model->head.grid.dims, x0 = bx * TC_SPLAT_BRICK, y0 = by * TC_SPLAT_BRICK;
  int range[2] = {dims[2], 0}; /* z of the filled voxels */
  for (int r = 0; r < TC_SPLAT_BRICK * TC_SPLAT_BRICK; r++)
    for (tc_vmd_run run = {.at = tc_vmd_column(c->model, x0 + r % TC_SPLAT_BRICK, y0 + r / TC_SPLAT_BRICK)}; tc_vmd_next(c->model, &run);)
      range[0] = MIN(range[0], run.z), range[1] = MAX(range[1], run.z + run.count);
  for (int bz = range[0] / TC_SPLAT_BRICK; bz * TC_SPLAT_BRICK < range[1]; bz++) {
    const int at[3] = {bx, by, bz};
    if (!meets_brick(c, at)) continue;
    find_surface(c, at);
    tc_splat_begin_brick(&c->out, at);
    for (int y = y0; y < MIN(y0 + TC_SPLAT_BRICK, dims[1]); y++)
      for (int x = x0; x < MIN(x0 + TC_SPLAT_BRICK, dims[0]); x++) cut_column(c, x, y, bz);
    tc_splat_end_brick(&c->out, NULL);
    for (guint i = c->rims->len; i < c->out.words->len; i++) {
      const uint32_t surface = c->surface[g_array_index(c->out.words, uint32_t, i) & 0xfff];
      const uint32_t rim = is_round(surface) ? surface & ~0xfffu : surface;
      g_array_append_val(c->rims, rim);
    }
  }
}

/* True if a plane passes through any brick with this x and y. */
static bool meets_bricks(const cutting *c, int bx, int by) {
  for (int i = 0; i < c->n_planes; i++) {
    const double *p = c->planes[i], depth = 0.5 * (c->model->head.grid.dims[2] - 1);
    const double middle = distance(p, bx * TC_SPLAT_BRICK, by * TC_SPLAT_BRICK, 0) + 7.5 * (p[0] + p[1]) + depth * p[2];
    const double half = 7.5 * (fabs(p[0]) + fabs(p[1])) + depth * fabs(p[2]);
    if (middle + half >= 0 && middle - half <= c->reach[i]) return true;
  }
  return false;
}

/* False: out of memory. */
static bool add_rims(tc_splats *cut, const GArray *rims) {
  cut->cut = true;
  cut->rims = calloc(cut->n + TC_SPLAT_PAD, sizeof *cut->rims);
  if (!cut->rims) return false;
  if (cut->n) memcpy(cut->rims, rims->data, cut->n * sizeof *cut->rims);
  cut->bytes += (cut->n + TC_SPLAT_PAD) * sizeof *cut->rims;
  return true;
}

tc_splats *tc_splats_cut(const tc_vmd *model, const tc_splats *of, const double planes[][4], int n_planes, const tc_halt *halt,
                         GError **error) {
  const int *first = model->first, *size = model->size;
  bool halted = false;
  cutting c = {.model = model, .of = of, .planes = planes, .n_planes = n_planes, .out = tc_splat_builder_new()};
  c.rims = g_array_new(FALSE, FALSE, sizeof(uint32_t));
  for (int i = 0; i < n_planes; i++)
    c.reach[i] = fmax(fabs(planes[i][0]), fmax(fabs(planes[i][1]), fabs(planes[i][2])));
  for (int by = first[1] / TC_SPLAT_BRICK; by * TC_SPLAT_BRICK < first[1] + size[1] && !halted; by++)
    for (int bx = first[0] / TC_SPLAT_BRICK; bx * TC_SPLAT_BRICK < first[0] + size[0] && !halted; bx++) {
      halted = tc_halt_within(halt);
      if (meets_bricks(&c, bx, by)) cut_bricks(&c, bx, by);
    }
  tc_splats *s = halted ? NULL : tc_splat_join(&c.out, 1, error);
  if (s && !add_rims(s, c.rims)) {
    tc_splats_free(s);
    s = NULL;
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
  }
  if (halted) tc_halt_say(halt, error);
  tc_splat_builder_free(c.out);
  g_array_unref(c.rims);
  return s;
}
