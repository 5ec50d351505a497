#include "renderer/base/vector.h"
#include "renderer/skip/boxes.h"
#include "renderer/skip/cover.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#define CHUNK 512             /* boxes projected together */
#define SHARE 256             /* records that a worker takes at once */
#define SMALL_CELL 2          /* shift: cells of 4x4 pixels, as wide as packets */
#define MOST_WORDS (4u << 20) /* 32 MiB of bits; larger pictures use larger cells */
#define MOST_PLANES 16        /* workers that mark bits, each in a separate plane, so that no two write the same word */
#define JOINED 4096           /* words merged per task */
#define LEAST_WORDS 4         /* slots are about a voxel long, within these limits on the number of words */
#define LONGEST 16
#define NEAR_EYE 0.02f        /* boxes closer to the eye, by w of the far side, count as covering the whole picture */

/* Projection of index positions, relative to the anchor of the picture's corner, to homogeneous (w, x * w, y * w):
 * x, y in pixels, w = 1 on the anchor plane and 0 at the eye. Orthographic: (1 + depth in mm, x, y). */
typedef struct projection {
  double origin[3]; /* index position */
  double flat[3];   /* offset of the box's start along an axis of one voxel: 0.5; else 0 */
  float rows[3][3];
  float extent[3];  /* half extents, after projection, of a box of one cell */
  float longer[3];  /* increment of the extents for one more cell along x */
  float margin;     /* pixels: above single-precision rounding */
  double depth_mm;  /* depth = (w - 1) * depth_mm */
  bool perspective;
} projection;

typedef struct cover_job {
  tc_cover *cover;
  const tc_boxes *boxes;
  projection p;
  size_t words; /* per plane */
  int planes;
  atomic_size_t next; /* the first record that no worker has taken */
  const tc_halt *halt;
  atomic_bool left;   /* interrupted by the halt */
} cover_job;

/* First and last cell and slot of each box of a chunk; empty where last < first. */
typedef struct spans {
  int lo[3][CHUNK], hi[3][CHUNK]; /* x, y, slot */
} spans;

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

/* Perspective: position = anchor0 + (w - 1) * eye + w * (x * du + y * dv) in index coordinates, with eye = to_index
 * * view0. Orthographic: the same without the factor w, and with the view direction for eye. */
static bool project(projection *p, const tc_rays *r, const int dims[3]) {
  double basis[9], rows[9], most = 0;
  for (int k = 0; k < 3; k++) {
    p->origin[k] = r->anchor0[k];
    p->flat[k] = dims[k] > 1 ? 0 : 0.5;
    basis[3 * k] = dot3(r->to_index + 3 * k, r->view0);
    basis[3 * k + 1] = r->anchor_du[k];
    basis[3 * k + 2] = r->anchor_dv[k];
  }
  if (!invert(basis, rows)) return false;
  p->perspective = r->perspective;
  p->depth_mm = 1;
  if (r->perspective) { /* depth of the anchor plane: view0 along its normal */
    double n[3], length;
    for (int k = 0; k < 3; k++) {
      int a = (k + 1) % 3, b = (k + 2) % 3;
      n[k] = r->view_du[a] * r->view_dv[b] - r->view_du[b] * r->view_dv[a];
    }
    length = sqrt(dot3(n, n));
    if (!(length > 0)) return false;
    p->depth_mm = fabs(dot3(r->view0, n)) / length;
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
  for (int i = 0; i < 3; i++) p->longer[i] = (float)(0.5 * fabs(rows[3 * i]));
  return true;
}

/* Centres of boxes relative to the anchor of the picture's corner, their widths, and their extra length along x, in
 * index units. */
typedef struct chunk {
  float at[3][CHUNK], size[CHUNK], more[CHUNK];
  int count;
} chunk;

/* A box at `offset` from a record's low corner. */
static void add_box(const float low[3], const float offset[3], float size, float more, chunk *c) {
  float half = 0.5f * size;
  int i = c->count++;
  c->at[0][i] = low[0] + offset[0] + half + 0.5f * more;
  c->at[1][i] = low[1] + offset[1] + half;
  c->at[2][i] = low[2] + offset[2] + half;
  c->size[i] = size;
  c->more[i] = more;
}

/* Adds the boxes of a record. Adjacent fine boxes in a row are projected as one box: far fewer projections, hardly more
 * coverage. */
static void add_record(const projection *p, const tc_box *b, float fine, chunk *c) {
  static const struct {
    uint8_t first, more;
  } runs[8] = {[2] = {1, 0}, [3] = {0, 1}, [4] = {2, 0}, [6] = {1, 1}, [7] = {0, 2}};
  float low[3];
  for (int k = 0; k < 3; k++) low[k] = (float)(b->at[k] - p->flat[k] - p->origin[k]);
  if (!b->fine) add_box(low, (float[]){0, 0, 0}, b->size, 0, c);
  for (int j = 0; j < TC_BOX_FINES * TC_BOX_FINES; j++) {
    uint32_t row = b->fine >> (TC_BOX_FINES * j) & 7;
    if (!row) continue;
    float y = fine * (float)(j % TC_BOX_FINES), z = fine * (float)(j / TC_BOX_FINES);
    add_box(low, (float[]){fine * runs[row].first, y, z}, fine, fine * runs[row].more, c);
    if (row == 5) add_box(low, (float[]){2 * fine, y, z}, fine, 0, c); /* both ends, without the middle */
  }
}

static inline float least_of(float a, float b) { return a < b ? a : b; }
static inline float most_of(float a, float b) { return a > b ? a : b; }

/* A plain loop over arrays, which the compiler vectorises. */
static void project_boxes(const projection p, const tc_cover *c, bool perspective, const chunk *restrict boxes,
                          spans *restrict s) {
  const float per_cell = 1 / (float)(1 << c->shift), per_slot = (float)(p.depth_mm / c->slot_mm);
  const float near = (float)((p.depth_mm + c->near_mm) / c->slot_mm), last_slot = (float)(c->words * 64 - 1);
  const float last_x = (float)(c->cells[0] - 1), last_y = (float)(c->cells[1] - 1);
  const int count = boxes->count;
  for (int i = 0; i < count; i++) {
    const float ax = boxes->at[0][i], ay = boxes->at[1][i], az = boxes->at[2][i];
    const float size = boxes->size[i], more = boxes->more[i];
    float w = 1 + p.rows[0][0] * ax + p.rows[0][1] * ay + p.rows[0][2] * az;
    float x = p.rows[1][0] * ax + p.rows[1][1] * ay + p.rows[1][2] * az;
    float y = p.rows[2][0] * ax + p.rows[2][1] * ay + p.rows[2][2] * az;
    float dw = p.extent[0] * size + p.longer[0] * more, dx = p.extent[1] * size + p.longer[1] * more;
    float dy = p.extent[2] * size + p.longer[2] * more;
    float near_w = w - dw, far_w = w + dw;
    if (perspective) {
      float inverse = 1 / w, least = 1 / near_w;
      x *= inverse, y *= inverse;
      dx = (dx + fabsf(x) * dw) * least;
      dy = (dy + fabsf(y) * dw) * least;
    }
    float x0 = (x - dx - p.margin) * per_cell, x1 = (x + dx + p.margin) * per_cell;
    float y0 = (y - dy - p.margin) * per_cell, y1 = (y + dy + p.margin) * per_cell;
    if (perspective) {
      bool close = near_w <= NEAR_EYE * fabsf(far_w);
      float from = far_w < 0 ? 1e9f : 0;
      x0 = close ? from : x0, y0 = close ? from : y0;
      x1 = close ? 1e9f : x1, y1 = close ? 1e9f : y1;
    }
    s->lo[0][i] = (int)least_of(most_of(x0, 0), 1e9f), s->hi[0][i] = (int)least_of(most_of(x1, -1), last_x);
    s->lo[1][i] = (int)least_of(most_of(y0, 0), 1e9f), s->hi[1][i] = (int)least_of(most_of(y1, -1), last_y);
    s->lo[2][i] = (int)least_of(most_of(near_w * per_slot - near - 0.01f, 0), last_slot);
    s->hi[2][i] = (int)least_of(most_of(far_w * per_slot - near + 0.01f, 0), last_slot);
  }
}

/* Sets the bits of one word in all cells of a rectangle. */
static inline void mark(uint64_t *corner, ptrdiff_t row, int wide, int high, uint64_t bits) {
  for (int y = 0; y < high; y++, corner += row)
    for (int x = 0; x < wide; x++) corner[x] |= bits;
}

static void mark_chunk(const cover_job *job, uint64_t *plane, chunk *boxes) {
  const tc_cover *c = job->cover;
  ptrdiff_t words = c->cells[0], row = words * c->words; /* strides: to a cell's next word, and to the next row of cells */
  spans s;
  if (job->p.perspective)
    project_boxes(job->p, c, true, boxes, &s);
  else
    project_boxes(job->p, c, false, boxes, &s);
  for (int i = 0; i < boxes->count; i++) {
    int wide = s.hi[0][i] - s.lo[0][i] + 1, high = s.hi[1][i] - s.lo[1][i] + 1;
    if (wide <= 0 || high <= 0) continue;
    int first = s.lo[2][i], last = s.hi[2][i], w = first >> 6, end = last >> 6;
    uint64_t *corner = plane + s.lo[1][i] * row + w * words + s.lo[0][i], from = ~(uint64_t)0 << (first & 63);
    for (; w < end; w++, corner += words, from = ~(uint64_t)0) mark(corner, row, wide, high, from);
    mark(corner, row, wide, high, from & ~(uint64_t)0 >> (63 - (last & 63)));
  }
  boxes->count = 0;
}

/* Marks the records that the worker takes in the worker's plane. */
static void cover_task(void *context, int index, int worker) {
  cover_job *job = context;
  uint64_t *plane = job->cover->bits + (size_t)index * job->words;
  chunk boxes;
  boxes.count = 0;
  memset(plane, 0, job->words * sizeof *plane);
  for (;;) {
    if (tc_halt_within(job->halt)) {
      atomic_store_explicit(&job->left, true, memory_order_relaxed);
      return;
    }
    size_t begin = atomic_fetch_add_explicit(&job->next, SHARE, memory_order_relaxed);
    size_t end = begin + SHARE < job->boxes->count ? begin + SHARE : job->boxes->count;
    for (size_t i = begin; i < end; i++) {
      if (boxes.count + 27 > CHUNK) mark_chunk(job, plane, &boxes);
      add_record(&job->p, &job->boxes->items[i], (float)job->boxes->block, &boxes);
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

/* Divides the depth of the volume's index box into slots. */
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

bool tc_cover_fill(tc_cover *c, const tc_boxes *boxes, const tc_volume *volume, const tc_rays *rays,
                   tc_pool *pool, GError **error) {
  cover_job job = {.cover = c, .boxes = boxes};
  if (!project(&job.p, rays, tc_volume_describe(volume)->dims)) {
    tc_set_error(error, TC_ERROR_INVALID, "/camera",
                 "camera: its rays coincide in double precision; move the camera closer or widen the field of view");
    return false;
  }
  choose_slots(c, &job.p, rays, volume);
  size_t words = 0;
  for (c->shift = SMALL_CELL;; c->shift++) {
    c->cells[0] = ((rays->width - 1) >> c->shift) + 1;
    c->cells[1] = ((rays->height - 1) >> c->shift) + 1;
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
      tc_set_error(error, TC_ERROR_MEMORY, NULL, "cover of %dx%d pixels: out of memory", rays->width, rays->height);
      return false;
    }
  }
  job.halt = tc_pool_halt(pool);
  bool filled = tc_pool_run(pool, job.planes, cover_task, &job) && !atomic_load(&job.left);
  if (filled && job.planes > 1) filled = tc_pool_run(pool, (int)((words + JOINED - 1) / JOINED), join_task, &job);
  return filled || tc_halt_say(job.halt, error);
}

void tc_cover_finish(tc_cover *cover) {
  free(cover->bits);
  *cover = (tc_cover){0};
}
