/* Tiles of packets, and the table of variants: the last piece of a translation unit. It needs cast_rays(), which
 * marches one packet, and the macro ROWS(ROW), which lists the variants. */

/* The mean of all rays of each pixel of a packet; if interrupted between two rays, the sum so far. */
V_INLINE vf4 cast_pixels(const tc_cpu_args *args, variant v, const place *first, skip_backoff *backoff,
                         const float *out, ptrdiff_t stride, tc_cpu_counts *counts) {
  place at = *first;
  vf4 sum = {v_set(0), v_set(0), v_set(0), v_set(0)};
  if (v.several && counts->ray) sum = load_packet(first, out, stride);
  at.ray += counts->ray;
  for (int r = counts->ray; r == 0 || r < args->rays.count; r++, at.ray++) {
    vf4 c = cast_rays(args, v, &at, backoff, counts);
    if (!v.several) return c;
    if (counts->left) {
      counts->ray = r;
      return sum;
    }
    sum = (vf4){sum.r + c.r, sum.g + c.g, sum.b + c.b, sum.a + c.a};
  }
  counts->ray = 0;
  vf n = v_set(
      (float)args->rays.count); /* all four sums are rounded alike: colour stays at most opacity, opacity at most 1 */
  return (vf4){sum.r / n, sum.g / n, sum.b / n, sum.a / n};
}

V_INLINE void cast_tile(const tc_cpu_args *args, variant v, int x0, int y0, int x1, int y1, float *out,
                        ptrdiff_t stride, tc_cpu_counts *counts) {
  skip_backoff backoff = {0};
  int packet = 0;
  for (int y = y0; y < y1; y += V_PACKET_Y)
    for (int x = x0; x < x1; x += V_PACKET_X, packet++) {
      if (packet < counts->packet) continue;
      place at = {x, y, x1, y1, args->rays.of_pixel};
      float *to = out + ((y - y0) * stride + (x - x0)) * 4;
      vf4 c = cast_pixels(args, v, &at, &backoff, to, stride, counts);
      store_packet(c, &at, to, stride);
      counts->packet = packet + !counts->left;
      if (counts->left) return;
    }
}

/* The variant for a plan's key. Shading models differ only in parameters (raycast/shading.h), MIP and MinIP only in a
 * sign (raycast/projection.h). */
V_INLINE variant wanted_variant(const tc_plan_key *key) {
  return (variant){.mode = key->mode == TC_MODE_MINIP ? TC_MODE_MIP : key->mode,
                   .type = key->voxel_type,
                   .filter = key->filter,
                   .slab = key->slab,
                   .classification = key->classification,
                   .back_to_front = key->order == TC_BACK_TO_FRONT,
                   .shaded = key->shading != TC_SHADING_NONE,
                   .gradient = key->gradient,
                   .leap = key->skipping,
                   .labels = key->labels,
                   .several = key->rays,
                   .jitter = key->jitter,
                   .subtables = key->subtables};
}

/* Members of a row that are BY_KEY are read from the key at run time; the others are constants, and code that they
 * exclude is not compiled. */
V_INLINE variant specialise(variant row, const tc_plan_key *key) {
  const variant wanted = wanted_variant(key);
  row.any_type = row.type == BY_KEY;
#define MEMBER(name) if (row.name == BY_KEY) row.name = wanted.name;
  VARIANT_MEMBERS(MEMBER)
#undef MEMBER
  return row;
}

#define KERNEL(name, ...)                                                                                             \
  static void name(const tc_cpu_args *args, int x0, int y0, int x1, int y1, float *out, ptrdiff_t stride,             \
                   tc_cpu_counts *counts) {                                                                           \
    cast_tile(args, specialise((variant){__VA_ARGS__}, &args->key), x0, y0, x1, y1, out, stride, counts);             \
  }
ROWS(KERNEL)

/* The first row that serves the key; NULL: none. */
static tc_cpu_kernel find_kernel(const tc_plan_key *key) {
#define ENTRY(name, ...) {{__VA_ARGS__}, name},
  static const struct { variant is; tc_cpu_kernel kernel; } rows[] = {ROWS(ENTRY)};
  const variant wanted = wanted_variant(key);
  if (key->voxel_type >= TC_VOXEL_TYPE_COUNT || key->slab > TC_SLAB_PROJECTION_COUNT) return NULL;
  for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
    bool serves = true;
#define MEMBER(name) serves &= rows[i].is.name == BY_KEY || rows[i].is.name == wanted.name;
    VARIANT_MEMBERS(MEMBER)
#undef MEMBER
    if (serves) return rows[i].kernel;
  }
  return NULL;
}
