#include "renderer/skip/cover.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#define CHUNK 512             /* boxes that are projected at once */
#define SHARE 256             /* records that a worker takes at once */
#define SMALL_CELL 2          /* shift: cells of 4x4 pixels, as wide as packets */
#define MOST_WORDS (4u << 20) /* 32 MiB of bits; larger pictures take larger cells */
#define MOST_PLANES 16        /* workers that mark bits, each its own: no two meet in a word */
#define JOINED 4096           /* words that a task joins */
#define LEAST_WORDS 4         /* slots are a voxel long, but within these bounds */
#define LONGEST 16
#define NEAR_EYE 0.02f        /* of a box's far side: nearer ones cover all of the picture */

/* From index positions, relative to the anchor of the picture's corner, to (w, x * w, y * w): x, y in pixels and w = 1 on the
 * anchor's plane, 0 at the eye. Orthographic: (1 + depth in mm, x, y). */
typedef struct projection {
  double origin[3]; /* index */
  double flat[3];   /* how far before its voxel an axis of one voxel begins; 0 along others */
  float rows[3][3];
  float extent[3];  /* half extents of a box of one cell in the rows */
  float margin;     /* pixels: above the rounding of single precision */
  double depth_mm;  /* depth = (w - 1) * depth_mm */
  bool perspective;
} projection;

typedef struct cover_job {
  tc_cover *cover;
  const tc_boxes *boxes;
  projection p;
  size_t words; /* of a plane */
  int planes;
  atomic_size_t next; /* record that no worker has taken */
} cover_job;

/* Cells and slots of a chunk's boxes, first and last; not yet clamped. */
typedef struct spans {
  float x[2][CHUNK], y[2][CHUNK], slot[2][CHUNK];
} spans;

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static bool invert(const double m[9], double out[9]) {
  double c[9];
  for (int r = 0; r < 3; r++)
    for (int k = 0; k < 3; k++) {
      int a = (r + 1) % 3, b = (r + 2) % 3, e = (k + 1) % 3, f = (k + 2) % 3;
      c[3 * k + r] = m[3 * a + e] * m[3 * b + f] - m[3 * a + f] * m[3 * b + e];
    }
  double det = m[0] * c[0] + m[1] * c[3] + m[2] * c[6];
  for (int i = 0; i < 9; i++) out[i] = c[i] / det;
  return isfinite(1 / det);
}

/* A position is anchor0 + (w-1) * eye + w * (x * du + y * dv), all in index coordinates, with eye = to_index * view0; orthographic
 * without the w, and with the view's direction for the eye. */
static bool project(projection *p, const tc_rays *r, const int dims[3]) {
  double basis[9], rows[9], most = 0;
  for (int k = 0; k < 3; k++) {
    p->origin[k] = r->anchor0[k];
    p->flat[k] = dims[k] > 1 ? 0 : 0.5;
    basis[3 * k] = dot(r->to_index + 3 * k, r->view0);
    basis[3 * k + 1] = r->anchor_du[k];
    basis[3 * k + 2] = r->anchor_dv[k];
  }
  if (!invert(basis, rows)) return false;
  p->perspective = r->perspective;
  p->depth_mm = 1;
  if (r->perspective) { /* of the anchor's plane: view0 along its normal */
    double n[3], length;
    for (int k = 0; k < 3; k++) {
      int a = (k + 1) % 3, b = (k + 2) % 3;
      n[k] = r->view_du[a] * r->view_dv[b] - r->view_du[b] * r->view_dv[a];
    }
    length = sqrt(dot(n, n));
    if (!(length > 0)) return false;
    p->depth_mm = fabs(dot(r->view0, n)) / length;
  }
  for (int i = 0; i < 3; i++) {
    double size = 0, extent = 0;
    for (int k = 0; k < 3; k++) {
      p->rows[i][k] = (float)rows[3 * i + k];
      size += fabs(rows[3 * i + k]) * (dims[k] + fabs(p->origin[k]));
      extent += 0.5 * fabs(rows[3 * i + k]);
    }
    p->extent[i] = (float)extent;
    if (i > 0) most = fmax(most, size);
  }
  p->margin = (float)(0.01 + 1e-6 * most);
  return true;
}

/* Middles of boxes, relative to the anchor of the picture's corner, and their sizes: index units. */
typedef struct chunk {
  float at[3][CHUNK], size[CHUNK];
  int count;
} chunk;

static void add_box(const float low[3], float x, float y, float z, float size, chunk *c) {
  float half = 0.5f * size;
  int i = c->count++;
  c->at[0][i] = low[0] + x + half;
  c->at[1][i] = low[1] + y + half;
  c->at[2][i] = low[2] + z + half;
  c->size[i] = size;
}

static void add_record(const projection *p, const tc_box *b, chunk *c) {
  float low[3];
  for (int k = 0; k < 3; k++) low[k] = (float)(b->at[k] - p->flat[k] - p->origin[k]);
  if (!b->fine) add_box(low, 0, 0, 0, b->size, c);
  for (int z = 0; z < TC_BOX_FINES; z++)
    for (int y = 0; y < TC_BOX_FINES; y++)
      for (uint32_t row = b->fine >> (TC_BOX_FINES * (TC_BOX_FINES * z + y)) & 7; row; row &= row - 1)
        add_box(low, (float)(TC_BOX_FINE * __builtin_ctz(row)), (float)(TC_BOX_FINE * y), (float)(TC_BOX_FINE * z), TC_BOX_FINE, c);
}

/* Plain loops over arrays, for the compiler to make vectors of. */
static void project_chunk(const cover_job *job, const chunk *boxes, spans *s) {
  const projection *p = &job->p;
  const tc_cover *c = job->cover;
  const float(*at)[CHUNK] = boxes->at, *size = boxes->size;
  int count = boxes->count;
  float per_cell = 1 / (float)(1 << c->shift);
  float per_slot = (float)(p->depth_mm / c->slot_mm), near = (float)((p->depth_mm + c->near_mm) / c->slot_mm);
  for (int i = 0; i < count; i++) {
    float w = 1 + p->rows[0][0] * at[0][i] + p->rows[0][1] * at[1][i] + p->rows[0][2] * at[2][i];
    float x = p->rows[1][0] * at[0][i] + p->rows[1][1] * at[1][i] + p->rows[1][2] * at[2][i];
    float y = p->rows[2][0] * at[0][i] + p->rows[2][1] * at[1][i] + p->rows[2][2] * at[2][i];
    float dw = p->extent[0] * size[i], dx = p->extent[1] * size[i], dy = p->extent[2] * size[i];
    s->slot[0][i] = (w - dw) * per_slot - near - 0.01f;
    s->slot[1][i] = (w + dw) * per_slot - near + 0.01f;
    if (p->perspective) {
      float inverse = 1 / w, least = 1 / (w - dw);
      x *= inverse, y *= inverse;
      dx = (dx + fabsf(x) * dw) * least;
      dy = (dy + fabsf(y) * dw) * least;
    }
    s->x[0][i] = (x - dx - p->margin) * per_cell, s->x[1][i] = (x + dx + p->margin) * per_cell;
    s->y[0][i] = (y - dy - p->margin) * per_cell, s->y[1][i] = (y + dy + p->margin) * per_cell;
  }
  if (!p->perspective) return;
  for (int i = 0; i < count; i++) {
    float near_w = (s->slot[0][i] + near) / per_slot, far_w = (s->slot[1][i] + near) / per_slot;
    if (near_w > NEAR_EYE * fabsf(far_w)) continue;
    bool behind = far_w < 0;
    s->x[0][i] = s->y[0][i] = behind ? 1e9f : 0;
    s->x[1][i] = s->y[1][i] = 1e9f;
  }
}

/* Slots first to last of the cells of a rectangle. */
static void mark(const tc_cover *c, uint64_t *plane, const int lo[2], const int hi[2], int first, int last) {
  ptrdiff_t words = c->words, row = words * c->cells[0];
  uint64_t *corner = plane + lo[1] * row + lo[0] * words;
  int wide = hi[0] - lo[0] + 1, high = hi[1] - lo[1] + 1, end = last >> 6;
  for (int w = first >> 6; w <= end; w++) {
    uint64_t bits = ~(uint64_t)0;
    if (w == first >> 6) bits &= ~(uint64_t)0 << (first & 63);
    if (w == end) bits &= ~(uint64_t)0 >> (63 - (last & 63));
    for (int y = 0; y < high; y++) {
      uint64_t *word = corner + y * row + w;
      for (int x = 0; x < wide; x++) word[x * words] |= bits;
    }
  }
}

static int clamp_to(float x, int last) { return x > 0 ? x < (float)last ? (int)x : last : 0; }

static void mark_chunk(const cover_job *job, uint64_t *plane, chunk *boxes) {
  const tc_cover *c = job->cover;
  int last = c->words * 64 - 1;
  spans s;
  project_chunk(job, boxes, &s);
  for (int i = 0; i < boxes->count; i++) {
    if (s.x[1][i] < 0 || s.y[1][i] < 0 || s.x[0][i] >= (float)c->cells[0] || s.y[0][i] >= (float)c->cells[1]) continue;
    const int lo[2] = {clamp_to(s.x[0][i], c->cells[0] - 1), clamp_to(s.y[0][i], c->cells[1] - 1)};
    const int hi[2] = {clamp_to(s.x[1][i], c->cells[0] - 1), clamp_to(s.y[1][i], c->cells[1] - 1)};
    mark(c, plane, lo, hi, clamp_to(s.slot[0][i], last), clamp_to(s.slot[1][i], last));
  }
  boxes->count = 0;
}

/* One worker's plane: of the records that it can get. */
static void cover_task(void *context, int index, int worker) {
  cover_job *job = context;
  uint64_t *plane = job->cover->bits + (size_t)index * job->words;
  chunk boxes;
  boxes.count = 0;
  memset(plane, 0, job->words * sizeof *plane);
  for (;;) {
    size_t begin = atomic_fetch_add_explicit(&job->next, SHARE, memory_order_relaxed);
    size_t end = begin + SHARE < job->boxes->count ? begin + SHARE : job->boxes->count;
    for (size_t i = begin; i < end; i++) {
      if (boxes.count + 27 > CHUNK) mark_chunk(job, plane, &boxes);
      add_record(&job->p, &job->boxes->items[i], &boxes);
    }
    if (begin >= end) break;
  }
  mark_chunk(job, plane, &boxes);
}

static void join_task(void *context, int index, int worker) {
  const cover_job *job = context;
  size_t begin = (size_t)index * JOINED, end = begin + JOINED < job->words ? begin + JOINED : job->words;
  uint64_t *to = job->cover->bits;
  for (int p = 1; p < job->planes; p++) {
    const uint64_t *from = to + (size_t)p * job->words;
    for (size_t i = begin; i < end; i++) to[i] |= from[i];
  }
}

/* Slots over the depth of the volume's index box. */
static void choose_slots(tc_cover *c, const projection *p, const tc_rays *r, const tc_volume *volume) {
  const double *spacing = tc_volume_describe(volume)->spacing;
  double middle = 0, half = 0;
  for (int k = 0; k < 3; k++) {
    middle += p->rows[0][k] * (0.5 * (r->lo[k] + r->hi[k]) - p->origin[k]) * p->depth_mm;
    half += fabs(p->rows[0][k]) * 0.5 * (r->hi[k] - r->lo[k]) * p->depth_mm;
  }
  half *= 1.0001;
  double wanted = 2 * half / fmin(spacing[0], fmin(spacing[1], spacing[2])) / 64 + 1;
  c->words = wanted < LEAST_WORDS ? LEAST_WORDS : wanted > LONGEST ? LONGEST : (int)wanted;
  c->near_mm = middle - half;
  c->slot_mm = 2 * half / (64 * c->words - 1);
  c->view_depth = p->depth_mm;
}

bool tc_cover_fill(tc_cover *c, const tc_boxes *boxes, const tc_volume *volume, const tc_rays *rays, int width, int height,
                   tc_pool *pool, GError **error) {
  cover_job job = {.cover = c, .boxes = boxes};
  if (!project(&job.p, rays, tc_volume_describe(volume)->dims)) {
    tc_set_error(error, TC_ERROR_INVALID, "/camera", "camera: its rays cannot be told apart; move it nearer or widen its view");
    return false;
  }
  choose_slots(c, &job.p, rays, volume);
  size_t words = 0;
  for (c->shift = SMALL_CELL;; c->shift++) {
    c->cells[0] = ((width - 1) >> c->shift) + 1;
    c->cells[1] = ((height - 1) >> c->shift) + 1;
    words = (size_t)c->cells[0] * (size_t)c->cells[1] * (size_t)c->words;
    if (words <= MOST_WORDS) break;
  }
  job.words = words;
  job.planes = pool ? tc_pool_threads(pool) : 1;
  if (job.planes > MOST_PLANES) job.planes = MOST_PLANES;
  while (job.planes > 1 && words * (size_t)job.planes > 2 * MOST_WORDS) job.planes--;
  if (words * (size_t)job.planes > c->capacity) {
    free(c->bits);
    c->capacity = words * (size_t)job.planes;
    c->bits = malloc(c->capacity * sizeof *c->bits);
    if (!c->bits) {
      c->capacity = 0;
      tc_set_error(error, TC_ERROR_MEMORY, NULL, "cover of %dx%d pixels: out of memory", width, height);
      return false;
    }
  }
  tc_pool_run(pool, job.planes, cover_task, &job);
  if (job.planes > 1) tc_pool_run(pool, (int)((words + JOINED - 1) / JOINED), join_task, &job);
  return true;
}

void tc_cover_finish(tc_cover *cover) {
  free(cover->bits);
  *cover = (tc_cover){0};
}
