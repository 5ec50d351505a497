#include "renderer/splat/splats.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/base/vector.h"
#include "renderer/splat/normal.h"

#define REACH 2                           /* voxels beside a brick that normals look at */
#define ACROSS (TC_SPLAT_BRICK + 2 * REACH) /* columns of a brick and beside it, along x and along y */

/* Bricks and words in the making, brick after brick. */
typedef struct pile {
  GArray *bricks, *words, *insets;
} pile;

static pile pile_new(void) {
  return (pile){g_array_new(FALSE, FALSE, sizeof(tc_splat_brick)), g_array_new(FALSE, FALSE, sizeof(uint32_t)),
                g_array_new(FALSE, FALSE, 1)};
}

static void pile_free(pile p) {
  if (p.bricks) g_array_unref(p.bricks);
  if (p.words) g_array_unref(p.words);
  if (p.insets) g_array_unref(p.insets);
}

static void begin_brick(const pile *p, const int at[3]) {
  const tc_splat_brick brick = {.first = p->words->len, .at = {at[0], at[1], at[2]}};
  g_array_append_val(p->bricks, brick);
}

static bool is_thin(unsigned faces) { return (faces & faces >> 1 & 0x15) != 0; }

static uint8_t packed_distance(double voxels) { return (uint8_t)(1 + lround(254 * fmin(fmax(voxels, 0), 1))); }

static void add_word(const pile *p, const int at[3], unsigned faces, const double normal[3], uint8_t inset) {
  int folded[2] = {127, 127};
  if (faces) tc_octahedron_fold(normal, 63, folded);
  const uint32_t word = (uint32_t)(at[0] & 15) | (uint32_t)(at[1] & 15) << 4 | (uint32_t)(at[2] & 15) << 8 | faces << 12 |
                        (uint32_t)folded[0] << 18 | (uint32_t)folded[1] << 25;
  g_array_append_val(p->words, word);
  g_array_append_val(p->insets, inset);
  g_array_index(p->bricks, tc_splat_brick, p->bricks->len - 1).faces |= faces & 63;
}

enum { most_splats = TC_SPLAT_BRICK * TC_SPLAT_BRICK * TC_SPLAT_BRICK };

/* Places of a brick along a curve that fills it: the brick is halved twelve times, always across the longest side. A
 * place's number is the sum of its coordinates' shares. */
typedef struct curve {
  uint16_t share[3][TC_SPLAT_BRICK];
} curve;

static curve curve_of(const tc_volume_desc *grid) {
  curve c = {0};
  int left[3] = {4, 4, 4}; /* bits of a coordinate that no halving has used */
  for (int bit = 11; bit >= 0; bit--) {
    int axis = -1;
    for (int k = 0; k < 3; k++)
      if (left[k] && (axis < 0 || ldexp(grid->spacing[k], left[k]) > ldexp(grid->spacing[axis], left[axis]))) axis = k;
    left[axis]--;
    for (int i = 0; i < TC_SPLAT_BRICK; i++) c.share[axis][i] |= (uint16_t)((i >> left[axis] & 1) << bit);
  }
  return c;
}

/* The last brick's splats by their free faces, and of the same faces along the curve: neighbours in memory look away
 * from the eye, lie in a tile, and are hidden together. */
static void sort_splats(const pile *p, const tc_splat_brick *brick, const curve *c) {
  const uint32_t n = brick->count, first = brick->first;
  uint32_t *words = &g_array_index(p->words, uint32_t, first), from[most_splats], next[65] = {0};
  uint8_t *insets = &g_array_index(p->insets, uint8_t, first), own[most_splats];
  uint16_t at[most_splats]; /* which splat, by its number along the curve */
  uint64_t taken[most_splats / 64] = {0};
  memcpy(from, words, n * sizeof *words), memcpy(own, insets, n);
  for (uint32_t i = 0; i < n; i++) {
    const uint32_t w = from[i], number = c->share[0][w & 15] | c->share[1][w >> 4 & 15] | c->share[2][w >> 8 & 15];
    next[(w >> 12 & 63) + 1]++;
    at[number] = (uint16_t)i, taken[number / 64] |= 1ull << number % 64;
  }
  for (int f = 0; f < 64; f++) next[f + 1] += next[f];
  for (uint32_t t = 0; t < most_splats / 64; t++)
    for (uint64_t left = taken[t]; left; left &= left - 1) {
      const uint32_t i = at[64 * t + (uint32_t)__builtin_ctzll(left)], to = next[from[i] >> 12 & 63]++;
      words[to] = from[i], insets[to] = own[i];
    }
}

/* c NULL: splats stay in their order. */
static void end_brick(const pile *p, const curve *c) {
  tc_splat_brick *brick = &g_array_index(p->bricks, tc_splat_brick, p->bricks->len - 1);
  brick->count = p->words->len - brick->first;
  if (!brick->count)
    g_array_set_size(p->bricks, p->bricks->len - 1);
  else if (c)
    sort_splats(p, brick, c);
}

/* Writes a brick and returns how many bytes it takes, 10 at most. */
static size_t pack_brick(const tc_splat_brick *brick, const int before[3], uint8_t *to) {
  const int *at = brick->at, x = at[0] - before[0], z = at[2] - before[2];
  const bool many = brick->count >= 63, aside = at[1] != before[1];
  const tc_splat_way way = !aside && !x && z == 1                                              ? TC_SPLAT_NEXT
                           : !aside && !x && z > 0 && z < 256                                  ? TC_SPLAT_FURTHER
                           : !aside && x >= 0 && x < 256 && z >= INT8_MIN && z <= INT8_MAX ? TC_SPLAT_COLUMN
                                                                                               : TC_SPLAT_ELSEWHERE;
  uint8_t *p = to;
  *p++ = (uint8_t)((many ? 63 : brick->count) | (unsigned)way << 6);
  if (many) *p++ = (uint8_t)brick->count, *p++ = (uint8_t)(brick->count >> 8);
  if (way == TC_SPLAT_COLUMN) *p++ = (uint8_t)x;
  if (way == TC_SPLAT_FURTHER || way == TC_SPLAT_COLUMN) *p++ = (uint8_t)z;
  for (int k = 0; k < 3 && way == TC_SPLAT_ELSEWHERE; k++) *p++ = (uint8_t)at[k], *p++ = (uint8_t)(at[k] >> 8);
  if (brick->count >= 16) *p++ = brick->faces;
  return (size_t)(p - to);
}

/* The bricks of all piles, packed, and how many there are; NULL: no memory. */
static uint8_t *pack_bricks(const pile *piles, int count, uint32_t *n_bricks, size_t *bytes) {
  int before[3] = {0};
  size_t n = 0;
  for (int i = 0; i < count; i++) n += piles[i].bricks->len;
  uint8_t *packed = malloc(10 * n + 1), *to = packed, *small;
  for (int i = 0; i < count && packed; i++)
    for (guint b = 0; b < piles[i].bricks->len; b++) {
      const tc_splat_brick *brick = &g_array_index(piles[i].bricks, tc_splat_brick, b);
      to += pack_brick(brick, before, to);
      memcpy(before, brick->at, sizeof before);
    }
  *n_bricks = (uint32_t)n, *bytes = (size_t)(to - packed);
  return packed && (small = realloc(packed, *bytes + 1)) ? small : packed;
}

void tc_splats_free(tc_splats *splats) {
  if (!splats) return;
  free(splats->bricks);
  free(splats->words);
  free(splats->insets);
  free(splats->rims);
  free(splats);
}

/* The piles one after the other. */
static tc_splats *join(const pile *piles, int count, GError **error) {
  static atomic_uint_fast64_t serials;
  uint64_t words = 0;
  size_t bricks = 0;
  for (int i = 0; i < count; i++) words += piles[i].words->len;
  if (words > TC_SPLAT_MOST) {
    tc_set_error(error, TC_ERROR_LIMIT, "/splat/threshold",
                 "splat/threshold: the object has more than %u surface voxels; choose a narrower range",
                 TC_SPLAT_MOST);
    return NULL;
  }
  tc_splats *s = calloc(1, sizeof *s);
  if (s)
    s->bricks = pack_bricks(piles, count, &s->n_bricks, &bricks),
    s->words = calloc(words + TC_SPLAT_PAD, sizeof *s->words), s->insets = calloc(words + TC_SPLAT_PAD, 1);
  if (!s || !s->bricks || !s->words || !s->insets) {
    tc_splats_free(s);
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
    return NULL;
  }
  for (int i = 0; i < count; i++) {
    if (piles[i].words->len) {
      memcpy(s->words + s->n, piles[i].words->data, piles[i].words->len * sizeof *s->words);
      memcpy(s->insets + s->n, piles[i].insets->data, piles[i].insets->len);
    }
    s->n += piles[i].words->len;
  }
  s->serial = atomic_fetch_add(&serials, 1) + 1;
  s->bytes = sizeof *s + bricks + 1 + (words + TC_SPLAT_PAD) * (sizeof *s->words + 1);
  return s;
}

/* ---- surfaces ---- */

/* The columns of the bricks of one x and y, and beside them. */
typedef struct block {
  uint64_t *bits;     /* [ACROSS][words][ACROSS]: what is filled, rows of y and z of x */
  int x0, from, to;   /* its first column; voxels from..to - 1 along z hold all that is filled */
} block;

typedef struct building {
  const tc_vmd *model;
  tc_splat_normals normals;
  bool everything;
  curve curve;
  int words;
  block *blocks; /* [threads] */
  pile *piles;   /* [layers] */
  const tc_halt *halt;
  atomic_bool left;
  atomic_uint_fast64_t total; /* words of all piles */
} building;

static void set_bits(uint64_t *column, size_t stride, int z, int count) {
  while (count > 0) {
    const int n = MIN(64 - z % 64, count);
    column[(size_t)(z / 64) * stride] |= (n == 64 ? ~0ull : (1ull << n) - 1) << z % 64;
    z += n, count -= n;
  }
}

/* Where along z columns of a model from `at` on are filled; false: nowhere. bits: as a block's, or NULL. */
static bool read_columns(const tc_vmd *model, const int at[2], int across, uint64_t *bits, int words, int range[2]) {
  range[0] = model->head.grid.dims[2], range[1] = 0;
  for (int r = 0; r < across; r++)
    for (int c = 0; c < across; c++)
      for (tc_vmd_run run = {.at = tc_vmd_column(model, at[0] + c, at[1] + r)}; tc_vmd_next(model, &run);) {
        range[0] = MIN(range[0], run.z), range[1] = MAX(range[1], run.z + run.count);
        if (bits) set_bits(bits + (size_t)r * (size_t)words * (size_t)across + c, (size_t)across, run.z, run.count);
      }
  return range[0] < range[1];
}

/* What the block held is cleared first: it costs what is filled, not the grid. */
static void read_block(const building *b, int bx, int by, block *to) {
  const size_t row = (size_t)b->words * ACROSS, first = (size_t)(to->from / 64) * ACROSS;
  int range[2];
  for (int r = 0; r < ACROSS && to->from < to->to; r++)
    memset(to->bits + (size_t)r * row + first, 0, ((size_t)((to->to - 1) / 64 + 1) * ACROSS - first) * sizeof *to->bits);
  to->x0 = bx * TC_SPLAT_BRICK - REACH;
  const int at[2] = {to->x0, by * TC_SPLAT_BRICK - REACH};
  read_columns(b->model, at, ACROSS, to->bits, b->words, range);
  to->from = range[0], to->to = range[1];
}

/* Of a row, bits z .. z + 15 of column x (z a multiple of 16) from bit 0, the neighbours' on either side of them. */
typedef struct window {
  const uint64_t *bits;
  int x0, words; /* its first column */
} window;

static uint64_t slice(const window *w, int x, int z) {
  if (z < 0 || z >= w->words * 64) return 0;
  return w->bits[(size_t)(z / 64) * ACROSS + (size_t)(x - w->x0)] >> z % 64 & 0xffff;
}

/* 20 bits: z - 2 .. z + 17. */
static uint32_t wide_slice(const window *w, int x, int z) {
  return (uint32_t)(slice(w, x, z) << 2 | slice(w, x, z - 16) >> 14 | (slice(w, x, z + 16) & 3) << 18);
}

/* A covector of index coordinates in LPS, of nearly orthogonal axes: lengths count inversely. */
static void to_lps(const tc_volume_desc *d, const double index[3], double lps[3]) {
  for (int r = 0; r < 3; r++) {
    lps[r] = 0;
    for (int k = 0; k < 3; k++) lps[r] += d->direction[3 * r + k] * index[k] / d->spacing[k];
  }
}

#define CUT_AREA 28 /* of a 5x5x5 cube by a plane near its middle: 25 to 32.5 */

double tc_splats_filled_normal(const tc_volume_desc *grid, const int sum[3], int filled, double normal[3]) {
  to_lps(grid, (double[]){sum[0], sum[1], sum[2]}, normal);
  return (filled - 62.5) / CUT_AREA;
}

/* A voxel, and the bits of its row of columns; those of the rows beside it are before and behind. */
typedef struct place {
  const uint64_t *row;
  int x0; /* the row's first column */
  int at[3];
} place;

static window window_of(const building *b, const place *p, int dy) {
  return (window){p->row + (ptrdiff_t)dy * b->words * ACROSS, p->x0, b->words};
}

/* The free side of the 5x5x5 voxels around one: minus the sum of places that are filled; and how far away the surface
 * is, were it a plane, by how many are. */
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

/* Filled ones of a voxel's 26 neighbours, as steps from it. */
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

/* The direction in which steps go furthest (power iteration on the sum of their squares); returns its share. */
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

/* What a thin voxel is part of, and the direction of a line in the normal's place. Distances along any normal are 1
 * / 1.4 of a line's radius in the mean. */
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
    to_lps(&b->model->head.grid, along, normal);
  }
  const double usual = what == TC_SPLAT_SHEET ? 0.8 : 0.8 / 1.4, across = fmin(fmax(thick / usual, 0.35), 1);
  if (what != TC_SPLAT_END) return (uint8_t)(what << 6 | lround(63 * across));
  return (uint8_t)(what << 6 | lround(10 * across - 3) << 3 | lround(7 / TC_SPLAT_LONG * fmin(on_by, TC_SPLAT_LONG)));
}

/* Returns the surface's distance along it; below 0: unknown. */
static double find_normal(const building *b, const place *p, unsigned faces, double normal[3]) {
  double inset = -1, rough[3];
  if (b->normals.of) inset = b->normals.of(b->normals.user, p->at[0], p->at[1], p->at[2], normal);
  if (inset < 0) inset = normal_of_filled(b, p, b->normals.of ? rough : normal);
  if (normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2] > 0) return inset;
  const int face = __builtin_ctz(faces); /* no side has less than another: that of any free face */
  for (int r = 0; r < 3; r++) normal[r] = (face & 1 ? 1 : -1) * b->model->head.grid.direction[3 * r + face / 2];
  return inset;
}

/* Sixteen voxels of a column, from `first` on. */
static void add_slice(const building *b, const pile *to, const place *first) {
  const int x = first->at[0], z = first->at[2];
  const window here = window_of(b, first, 0), before = window_of(b, first, -1), behind = window_of(b, first, 1);
  const uint32_t wide = wide_slice(&here, x, z), filled = wide >> 2 & 0xffff;
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
    const uint8_t inset = !faces ? 0 : is_thin(faces) ? thin_inset(b, &p, distance, normal) : packed_distance(distance);
    add_word(to, p.at, faces, normal, inset);
  }
}

static void build_brick(const building *b, const block *from, const int brick[3], const pile *to) {
  const int *dims = b->model->head.grid.dims, x0 = brick[0] * TC_SPLAT_BRICK, y0 = brick[1] * TC_SPLAT_BRICK;
  begin_brick(to, brick);
  for (int y = y0; y < MIN(y0 + TC_SPLAT_BRICK, dims[1]); y++) {
    place at = {from->bits + (size_t)(y - y0 + REACH) * (size_t)b->words * ACROSS, from->x0,
                {0, y, brick[2] * TC_SPLAT_BRICK}};
    const window row = window_of(b, &at, 0);
    for (at.at[0] = x0; at.at[0] < MIN(x0 + TC_SPLAT_BRICK, dims[0]); at.at[0]++)
      if (slice(&row, at.at[0], at.at[2])) add_slice(b, to, &at);
  }
  end_brick(to, b->everything ? NULL : &b->curve);
}

static void build_layer(void *context, int layer, int worker) {
  building *b = context;
  const int *first = b->model->first, *size = b->model->size; /* where columns are */
  const pile p = b->piles[layer] = pile_new();
  if (layer * TC_SPLAT_BRICK >= first[1] + size[1] || (layer + 1) * TC_SPLAT_BRICK <= first[1]) return;
  block *from = &b->blocks[worker];
  for (int bx = first[0] / TC_SPLAT_BRICK; bx * TC_SPLAT_BRICK < first[0] + size[0]; bx++) {
    read_block(b, bx, layer, from);
    for (int bz = from->from / TC_SPLAT_BRICK; bz * TC_SPLAT_BRICK < from->to; bz++) {
      if (tc_halt_within(b->halt)) {
        atomic_store(&b->left, true);
        return;
      }
      const guint before = p.words->len;
      build_brick(b, from, (int[]){bx, layer, bz}, &p);
      if (atomic_fetch_add(&b->total, p.words->len - before) > TC_SPLAT_MOST) return; /* refused by join() */
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
                .curve = curve_of(&model->head.grid),
                .words = (dims[2] + 63) / 64,
                .halt = tc_pool_halt(pool)};
  const tc_vmd_attribute *own = tc_vmd_attribute_named(&model->head, "normal");
  if (!normals.of && own && own->type == TC_VMD_NORMAL) b.normals = (tc_splat_normals){tc_vmd_own_normal, model};
  bool good = (b.piles = calloc((size_t)layers, sizeof *b.piles)) && (b.blocks = calloc((size_t)threads, sizeof *b.blocks));
  for (int i = 0; i < threads && good; i++)
    good = (b.blocks[i].bits = calloc((size_t)b.words * ACROSS * ACROSS, sizeof *b.blocks->bits)) != NULL;
  tc_splats *s = NULL;
  if (!good)
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
  else if (!tc_pool_run(pool, layers, build_layer, &b) || atomic_load(&b.left))
    tc_halt_say(tc_pool_halt(pool), error);
  else
    s = join(b.piles, layers, error);
  for (int i = 0; b.piles && i < layers; i++) pile_free(b.piles[i]);
  for (int i = 0; b.blocks && i < threads; i++) free(b.blocks[i].bits);
  free(b.piles);
  free(b.blocks);
  return s;
}

/* ---- cuts ---- */

typedef struct cutting {
  const tc_vmd *model;
  const double (*planes)[4];
  int n_planes;
  double reach[6 * 2]; /* of each plane: how far from it a kept voxel with a cut neighbour can be */
  pile out;
  curve curve;
} cutting;

static double distance(const double plane[4], int x, int y, int z) {
  return plane[0] * x + plane[1] * y + plane[2] * z + plane[3];
}

/* The faces whose neighbours are cut off, and the plane that is nearest; none where the voxel itself is. */
static unsigned cut_faces(const cutting *c, int x, int y, int z, const double **nearest) {
  unsigned faces = 0;
  double least = INFINITY;
  for (int i = 0; i < c->n_planes; i++) {
    const double d = distance(c->planes[i], x, y, z);
    if (d < 0) return 0;
    unsigned own = 0;
    for (int f = 0; f < 6; f++) own |= (unsigned)(d + (f & 1 ? 1 : -1) * c->planes[i][f / 2] < 0) << f;
    if (own && d < least) least = d, *nearest = c->planes[i];
    faces |= own;
  }
  return faces;
}

/* Voxels z0 .. z1 - 1 of a column are looked at where some plane is near. */
static void cut_run(const cutting *c, int x, int y, int z0, int z1) {
  for (int z = z0; z < z1; z++) {
    const double *plane = NULL;
    const unsigned faces = cut_faces(c, x, y, z, &plane);
    if (!faces) continue;
    double normal[3];
    to_lps(&c->model->head.grid, (double[]){-plane[0], -plane[1], -plane[2]}, normal);
    add_word(&c->out, (int[]){x, y, z}, faces, normal,
             is_thin(faces) ? 0 : packed_distance(distance(plane, x, y, z) / length3(plane)));
  }
}

/* Where along z from lo to hi plane i is within its reach; false: nowhere. */
static bool near_plane(const cutting *c, int i, int x, int y, int *lo, int *hi) {
  const double *p = c->planes[i], at = distance(p, x, y, 0);
  double from = *lo, to = *hi;
  if (p[2] == 0) return at >= 0 && at <= c->reach[i];
  double a = -at / p[2], b = (c->reach[i] - at) / p[2];
  from = fmax(from, floor(fmin(a, b))), to = fmin(to, ceil(fmax(a, b)) + 1);
  *lo = (int)from, *hi = (int)fmax(to, from);
  return from < to;
}

static void cut_column(const cutting *c, int x, int y, int bz) {
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

/* Whether any plane passes through the brick: all others are left alone. */
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

/* The bricks of one x and y, from the first voxel along z to the last. */
static void cut_bricks(const cutting *c, int bx, int by) {
  const int *dims = c->model->head.grid.dims, x0 = bx * TC_SPLAT_BRICK, y0 = by * TC_SPLAT_BRICK;
  int range[2];
  if (!read_columns(c->model, (int[]){x0, y0}, TC_SPLAT_BRICK, NULL, 0, range)) return;
  for (int bz = range[0] / TC_SPLAT_BRICK; bz * TC_SPLAT_BRICK < range[1]; bz++) {
    const int at[3] = {bx, by, bz};
    if (!meets_brick(c, at)) continue;
    begin_brick(&c->out, at);
    for (int y = y0; y < MIN(y0 + TC_SPLAT_BRICK, dims[1]); y++)
      for (int x = x0; x < MIN(x0 + TC_SPLAT_BRICK, dims[0]); x++) cut_column(c, x, y, bz);
    end_brick(&c->out, &c->curve);
  }
}

/* Whether any plane passes through any brick of one x and y. */
static bool meets_bricks(const cutting *c, int bx, int by) {
  for (int i = 0; i < c->n_planes; i++) {
    const double *p = c->planes[i], depth = 0.5 * (c->model->head.grid.dims[2] - 1);
    const double middle = distance(p, bx * TC_SPLAT_BRICK, by * TC_SPLAT_BRICK, 0) + 7.5 * (p[0] + p[1]) + depth * p[2];
    const double half = 7.5 * (fabs(p[0]) + fabs(p[1])) + depth * fabs(p[2]);
    if (middle + half >= 0 && middle - half <= c->reach[i]) return true;
  }
  return false;
}

static bool comes_before(const int a[3], const int b[3]) {
  return a[1] != b[1] ? a[1] < b[1] : a[0] != b[0] ? a[0] < b[0] : a[2] < b[2];
}

/* Sets rims[word's place in the brick] of the surface's splats in a brick. */
static void note_rims(const tc_splats *of, const tc_splat_brick *brick, uint32_t *rims) {
  for (uint32_t i = brick->first; i < brick->first + brick->count; i++) {
    const uint32_t word = of->words[i];
    if (word >> 12 & 63 && !is_thin(word >> 12 & 63) && of->insets[i]) rims[word & 0xfff] = (word & ~0x3ffffu) | of->insets[i];
  }
}

/* The rims of a cut, from the splats of the whole model; both list their bricks in the same order. False: out of memory. */
static bool find_rims(tc_splats *cut, const tc_splats *of) {
  enum { VOXELS = TC_SPLAT_BRICK * TC_SPLAT_BRICK * TC_SPLAT_BRICK };
  uint32_t *rims = malloc(VOXELS * sizeof *rims), read = 0;
  tc_splat_brick brick = {0}, other = {0};
  size_t from = 0, other_from = 0;
  cut->rims = calloc(cut->n + TC_SPLAT_PAD, sizeof *cut->rims);
  for (uint32_t b = 0; rims && cut->rims && b < cut->n_bricks; b++) {
    tc_splats_next(cut, &from, &brick);
    while (read < of->n_bricks && (!read || comes_before(other.at, brick.at))) tc_splats_next(of, &other_from, &other), read++;
    if (!read || memcmp(other.at, brick.at, sizeof brick.at) != 0) continue;
    memset(rims, 0, VOXELS * sizeof *rims);
    note_rims(of, &other, rims);
    for (uint32_t i = brick.first; i < brick.first + brick.count; i++) cut->rims[i] = rims[cut->words[i] & 0xfff];
  }
  const bool good = rims && cut->rims;
  free(rims);
  cut->bytes += (cut->n + TC_SPLAT_PAD) * sizeof *cut->rims;
  return good;
}

tc_splats *tc_splats_cut(const tc_vmd *model, const tc_splats *of, const double planes[][4], int n_planes, const tc_halt *halt,
                         GError **error) {
  const int *first = model->first, *size = model->size;
  bool left = false;
  cutting c = {.model = model, .planes = planes, .n_planes = n_planes, .out = pile_new(), .curve = curve_of(&model->head.grid)};
  for (int i = 0; i < n_planes; i++)
    c.reach[i] = fmax(fabs(planes[i][0]), fmax(fabs(planes[i][1]), fabs(planes[i][2])));
  for (int by = first[1] / TC_SPLAT_BRICK; by * TC_SPLAT_BRICK < first[1] + size[1] && !left; by++)
    for (int bx = first[0] / TC_SPLAT_BRICK; bx * TC_SPLAT_BRICK < first[0] + size[0] && !left; bx++) {
      left = tc_halt_within(halt);
      if (meets_bricks(&c, bx, by)) cut_bricks(&c, bx, by);
    }
  tc_splats *s = left ? NULL : join(&c.out, 1, error);
  if (s) s->cut = true;
  if (s && !find_rims(s, of)) {
    tc_splats_free(s);
    s = NULL;
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
  }
  if (left) tc_halt_say(halt, error);
  pile_free(c.out);
  return s;
}
