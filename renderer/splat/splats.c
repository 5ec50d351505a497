#include "renderer/splat/builder.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/base/vector.h"
#include "renderer/splat/normal.h"

#define REACH 2                           /* voxels beside a brick that its normals depend on */
#define ACROSS (TC_SPLAT_BRICK + 2 * REACH) /* columns of a brick and its surroundings, along x and along y */

/* The columns of the bricks with one x and y, and their surroundings, as bits. */
typedef struct block {
  uint64_t *bits;     /* [y: ACROSS][z: words][x: ACROSS] filled voxels */
  int x0, from, to;   /* x of the first column; all filled voxels have z in from..to - 1 */
} block;

typedef struct building {
  const tc_vmd *model;
  tc_splat_normals normals;
  bool everything;
  tc_splat_curve curve;
  int words;
  block *blocks; /* [threads] */
  tc_splat_builder *builders;   /* [layers] */
  const tc_halt *halt;
  atomic_bool halted;
  atomic_uint sides;
  atomic_uint_fast64_t total; /* splats in all builders */
} building;

/* Voxels by which a run is continued beyond the grid's last voxel, for normals. */
static int beyond_grid(const building *b, int z) { return z == b->model->head.grid.dims[2] ? REACH : 0; }

static void set_bits(uint64_t *column, size_t stride, int z, int count) {
  while (count > 0) {
    const int n = MIN(64 - z % 64, count);
    column[(size_t)(z / 64) * stride] |= (n == 64 ? ~0ull : (1ull << n) - 1) << z % 64;
    z += n, count -= n;
  }
}

/* Reads the columns of a block; only the range of the previous block's filled voxels is cleared. Columns beyond the grid are copies
 * of the nearest ones within. */
static void read_block(const building *b, int bx, int by, block *to) {
  const size_t row = (size_t)b->words * ACROSS, first = (size_t)(to->from / 64) * ACROSS;
  for (int r = 0; r < ACROSS && to->from < to->to; r++)
    memset(to->bits + (size_t)r * row + first, 0, ((size_t)((to->to - 1) / 64 + 1) * ACROSS - first) * sizeof *to->bits);
  const int *dims = b->model->head.grid.dims;
  to->x0 = bx * TC_SPLAT_BRICK - REACH;
  to->from = dims[2], to->to = 0;
  for (int r = 0; r < ACROSS; r++)
    for (int c = 0; c < ACROSS; c++) {
      const int x = MIN(MAX(to->x0 + c, 0), dims[0] - 1), y = MIN(MAX(by * TC_SPLAT_BRICK - REACH + r, 0), dims[1] - 1);
      for (tc_vmd_run run = {.at = tc_vmd_column(b->model, x, y)}; tc_vmd_next(b->model, &run);) {
        const int count = run.count + beyond_grid(b, run.z + run.count);
        to->from = MIN(to->from, run.z), to->to = MAX(to->to, run.z + count);
        set_bits(to->bits + (size_t)r * row + c, ACROSS, run.z, count);
      }
    }
}

/* A row of columns. */
typedef struct window {
  const uint64_t *bits;
  int x0, words; /* x of the first column; words along z */
} window;

/* Bits z .. z + 15 of column x; z is a multiple of 16. */
static uint64_t slice(const window *w, int x, int z) {
  if (z < 0) return slice(w, x, 0) & 1 ? 0xffff : 0;
  if (z >= w->words * 64) return 0;
  return w->bits[(size_t)(z / 64) * ACROSS + (size_t)(x - w->x0)] >> z % 64 & 0xffff;
}

/* Bits z - 2 .. z + 17 of column x. */
static uint32_t wide_slice(const window *w, int x, int z) {
  return (uint32_t)(slice(w, x, z) << 2 | slice(w, x, z - 16) >> 14 | (slice(w, x, z + 16) & 3) << 18);
}

#define CUT_AREA 28 /* area in which a plane near the middle cuts a 5x5x5 cube: 25 to 32.5 */

double tc_splats_filled_normal(const tc_volume_desc *grid, const int sum[3], int filled, double normal[3]) {
  tc_splat_to_lps(grid, (double[]){sum[0], sum[1], sum[2]}, normal);
  return (filled - 62.5) / CUT_AREA;
}

/* A voxel and its row of columns; the neighbouring rows lie before and behind it in memory. */
typedef struct place {
  const uint64_t *row;
  int x0; /* x of the row's first column */
  int at[3];
} place;

static window window_of(const building *b, const place *p, int dy) {
  return (window){p->row + (ptrdiff_t)dy * b->words * ACROSS, p->x0, b->words};
}

/* Normal and distance of the surface from the 5x5x5 voxels around a voxel: tc_splats_filled_normal(). */
static double normal_of_filled(const building *b, const place *p, double normal[3]) {
  const int x = p->at[0], z = p->at[2];
  int sum[3] = {0}, filled = 0;
  for (int dy = -2; dy <= 2; dy++) {
    const window w = window_of(b, p, dy);
    for (int dx = -2; dx <= 2; dx++) {
      const unsigned five = wide_slice(&w, x + dx, z & ~15) >> (z & 15) & 31;
      const int count = __builtin_popcount(five);
      sum[0] -= dx * count, sum[1] -= dy * count, filled += count;
      sum[2] -= 2 * (int)(five >> 4 & 1) + (int)(five >> 3 & 1) - (int)(five >> 1 & 1) - 2 * (int)(five & 1);
    }
  }
  return tc_splats_filled_normal(&b->model->head.grid, sum, filled, normal);
}

/* Offsets of the filled ones of a voxel's 26 neighbours; returns their number. */
static int neighbours_of(const building *b, const place *p, double steps[26][3]) {
  const int x = p->at[0], z = p->at[2];
  int n = 0;
  for (int i = 0; i < 9; i++) {
    const int dx = i % 3 - 1, dy = i / 3 - 1;
    const window w = window_of(b, p, dy);
    const unsigned three = wide_slice(&w, x + dx, z & ~15) >> ((z & 15) + 1) & 7;
    for (int dz = -1; dz <= 1; dz++)
      if ((three >> (dz + 1) & 1) && (dx || dy || dz)) steps[n][0] = dx, steps[n][1] = dy, steps[n++][2] = dz;
  }
  return n;
}

/* Main direction of the offsets (power iteration on their second moments); returns its share of the sum of squares. */
static double main_direction(const double steps[26][3], int n, double along[3]) {
  double total = 0, most = 0, share = 0;
  for (int i = 0; i < n; i++) {
    const double square = dot3(steps[i], steps[i]);
    total += square;
    if (square > most) most = square, memcpy(along, steps[i], sizeof steps[i]);
  }
  for (int round = 0; round < 6; round++) {
    double sum[3] = {0};
    normalise3(along);
    share = 0;
    for (int i = 0; i < n; i++) {
      const double reach = dot3(steps[i], along);
      share += reach * reach / total;
      for (int k = 0; k < 3; k++) sum[k] += reach * steps[i][k];
    }
    memcpy(along, sum, sizeof sum);
  }
  normalise3(along);
  return share;
}

/* Inset of a thin voxel (tc_splat_thin); replaces the normal of a line by its direction. distance: of the surface along the normal,
 * on average 1 / 1.4 of a line's radius. */
static uint8_t thin_inset(const building *b, const place *p, double distance, double normal[3]) {
  double steps[26][3], along[3], back = 0, on = 0;
  const int n = neighbours_of(b, p, steps);
  const double share = n ? main_direction(steps, n, along) : 0, thick = distance < 0 ? 0.5 : distance;
  double on_by = 0.5;
  tc_splat_thin what = n ? TC_SPLAT_SHEET : TC_SPLAT_DOT;
  if (n && (n <= 3 || share > 0.6)) {
    for (int i = 0; i < n; i++) back = fmin(back, dot3(steps[i], along)), on = fmax(on, dot3(steps[i], along));
    what = fmin(-back, on) < 0.4 ? TC_SPLAT_END : TC_SPLAT_LINE;
    for (int k = 0; k < 3 && on > -back; k++) along[k] = -along[k];
    if (what == TC_SPLAT_END && b->normals.end) on_by = b->normals.end(b->normals.user, p->at, along, TC_SPLAT_LONG);
    tc_splat_to_lps(&b->model->head.grid, along, normal);
  }
  const double usual = what == TC_SPLAT_SHEET ? 0.8 : 0.8 / 1.4, across = fmin(fmax(thick / usual, 0.35), 1);
  if (what != TC_SPLAT_END) return (uint8_t)(what << 6 | lround(63 * across));
  return (uint8_t)(what << 6 | lround(10 * across - 3) << 3 | lround(7 / TC_SPLAT_LONG * fmin(on_by, TC_SPLAT_LONG)));
}

/* Sets the normal of a surface voxel. Returns the surface's distance along it; negative: unknown. */
static double find_normal(const building *b, const place *p, unsigned faces, double normal[3]) {
  double inset = -1, rough[3];
  if (b->normals.of) inset = b->normals.of(b->normals.user, p->at[0], p->at[1], p->at[2], normal);
  if (inset < 0) inset = normal_of_filled(b, p, b->normals.of ? rough : normal);
  if (normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2] > 0) return inset;
  const int face = __builtin_ctz(faces); /* symmetrical surroundings: the direction of any free face */
  for (int r = 0; r < 3; r++) normal[r] = (face & 1 ? 1 : -1) * b->model->head.grid.direction[3 * r + face / 2];
  return inset;
}

/* Adds the splats of sixteen voxels of a column, from `first` on. */
static void add_slice(const building *b, const tc_splat_builder *to, const place *first) {
  const int x = first->at[0], z = first->at[2], within = MIN(b->model->head.grid.dims[2] - z, TC_SPLAT_BRICK);
  const window here = window_of(b, first, 0), before = window_of(b, first, -1), behind = window_of(b, first, 1);
  const uint32_t wide = wide_slice(&here, x, z), filled = wide >> 2 & ((1u << within) - 1);
  const uint32_t open[6] = {~(uint32_t)slice(&here, x - 1, z),
                            ~(uint32_t)slice(&here, x + 1, z),
                            ~(uint32_t)slice(&before, x, z),
                            ~(uint32_t)slice(&behind, x, z),
                            ~(wide >> 1),
                            ~(wide >> 3)};
  uint32_t shown = filled & (open[0] | open[1] | open[2] | open[3] | open[4] | open[5]);
  for (uint32_t left = b->everything ? filled : shown; left; left &= left - 1) {
    const int i = __builtin_ctz(left);
    unsigned faces = 0;
    for (int f = 0; f < 6; f++) faces |= (open[f] >> i & 1) << f;
    double normal[3] = {0}, distance = 0;
    place p = *first;
    p.at[2] += i;
    if (faces) distance = find_normal(b, &p, faces, normal);
    const uint8_t inset = !faces ? 0 : tc_splat_is_thin(faces) ? thin_inset(b, &p, distance, normal) : tc_splat_pack_distance(distance);
    tc_splat_add(to, p.at, faces, normal, inset);
  }
}

static void build_brick(const building *b, const block *from, const int brick[3], const tc_splat_builder *to) {
  const int *dims = b->model->head.grid.dims, x0 = brick[0] * TC_SPLAT_BRICK, y0 = brick[1] * TC_SPLAT_BRICK;
  tc_splat_begin_brick(to, brick);
  for (int y = y0; y < MIN(y0 + TC_SPLAT_BRICK, dims[1]); y++) {
    place at = {from->bits + (size_t)(y - y0 + REACH) * (size_t)b->words * ACROSS, from->x0,
                {0, y, brick[2] * TC_SPLAT_BRICK}};
    const window row = window_of(b, &at, 0);
    for (at.at[0] = x0; at.at[0] < MIN(x0 + TC_SPLAT_BRICK, dims[0]); at.at[0]++)
      if (slice(&row, at.at[0], at.at[2])) add_slice(b, to, &at);
  }
  tc_splat_end_brick(to, b->everything ? NULL : &b->curve);
}

static void build_layer(void *context, int layer, int worker) {
  building *b = context;
  const int *first = b->model->first, *size = b->model->size; /* rectangle of the stored columns */
  const tc_splat_builder p = b->builders[layer] = tc_splat_builder_new();
  if (layer * TC_SPLAT_BRICK >= first[1] + size[1] || (layer + 1) * TC_SPLAT_BRICK <= first[1]) return;
  block *from = &b->blocks[worker];
  for (int bx = first[0] / TC_SPLAT_BRICK; bx * TC_SPLAT_BRICK < first[0] + size[0]; bx++) {
    read_block(b, bx, layer, from);
    atomic_fetch_or(&b->sides, (from->from == 0) << 4 | (from->to > b->model->head.grid.dims[2]) << 5);
    for (int bz = from->from / TC_SPLAT_BRICK; bz * TC_SPLAT_BRICK < MIN(from->to, b->model->head.grid.dims[2]); bz++) {
      if (tc_halt_within(b->halt)) {
        atomic_store(&b->halted, true);
        return;
      }
      const guint before = p.words->len;
      build_brick(b, from, (int[]){bx, layer, bz}, &p);
      if (atomic_fetch_add(&b->total, p.words->len - before) > TC_SPLAT_MOST) return; /* tc_splat_join() refuses them */
    }
  }
}

tc_splats *tc_splats_build(const tc_vmd *model, tc_splat_normals normals, bool everything, tc_pool *pool,
                           GError **error) {
  const int *dims = model->head.grid.dims, threads = tc_pool_threads(pool);
  const int layers = (dims[1] + TC_SPLAT_BRICK - 1) / TC_SPLAT_BRICK;
  building b = {.model = model,
                .normals = normals,
                .everything = everything,
                .curve = tc_splat_curve_of(&model->head.grid),
                .words = (dims[2] + REACH + 63) / 64,
                .halt = tc_pool_halt(pool)};
  const tc_vmd_attribute *own = tc_vmd_attribute_named(&model->head, "normal");
  if (!normals.of && own && own->type == TC_VMD_NORMAL) b.normals = (tc_splat_normals){tc_vmd_own_normal, model};
  bool good = (b.builders = calloc((size_t)layers, sizeof *b.builders)) && (b.blocks = calloc((size_t)threads, sizeof *b.blocks));
  for (int i = 0; i < threads && good; i++)
    good = (b.blocks[i].bits = calloc((size_t)b.words * ACROSS * ACROSS, sizeof *b.blocks->bits)) != NULL;
  tc_splats *s = NULL;
  if (!good)
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
  else if (!tc_pool_run(pool, layers, build_layer, &b) || atomic_load(&b.halted))
    tc_halt_say(tc_pool_halt(pool), error);
  else
    s = tc_splat_join(b.builders, layers, error);
  for (int k = 0; k < 2 && s; k++)
    s->sides |= (uint8_t)((model->first[k] == 0) << 2 * k | (model->first[k] + model->size[k] == dims[k]) << (2 * k + 1));
  if (s) s->sides |= (uint8_t)atomic_load(&b.sides);
  for (int i = 0; b.builders && i < layers; i++) tc_splat_builder_free(b.builders[i]);
  for (int i = 0; b.blocks && i < threads; i++) free(b.blocks[i].bits);
  free(b.builders);
  free(b.blocks);
  return s;
}
