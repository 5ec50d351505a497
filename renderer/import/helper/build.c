#include "renderer/import/helper/build.h"

#include <math.h>
#include <string.h>
#include <sys/random.h>

enum { FIRST_ROOM = 1024, MOST_ITEMS = 1 << 27 }; /* largest number of vertices, and of triangles: indices stay below 2^31 */

/* ---- welding ---- */

/* Hashes with a random seed, so that no file can be made whose keys all collide. */
static size_t slot_of(const tc_weld *w, const void *key) {
  uint32_t k[3];
  memcpy(k, key, sizeof k);
  uint64_t h = w->seed;
  for (int i = 0; i < 3; i++) {
    h = (h ^ k[i]) * UINT64_C(0x9e3779b97f4a7c15);
    h ^= h >> 29;
  }
  h *= UINT64_C(0xbf58476d1ce4e5b9);
  return (size_t)(h ^ h >> 32) & (w->n_slots - 1);
}

static bool widen(tc_weld *w, const uint8_t *keys, GError **error) {
  tc_weld wide = {.n_slots = MAX(w->n_slots * 2, FIRST_ROOM), .n = w->n, .seed = w->seed};
  if (!w->seed && getrandom(&wide.seed, sizeof wide.seed, GRND_NONBLOCK) < 0) wide.seed = (uint64_t)(uintptr_t)keys;
  wide.seed |= 1;
  wide.slots = g_try_new0(uint32_t, wide.n_slots);
  if (!wide.slots) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "no memory to weld the mesh's vertices");
    return false;
  }
  for (size_t i = 0; i < w->n_slots; i++) {
    if (!w->slots[i]) continue;
    size_t at = slot_of(&wide, keys + 12 * (size_t)(w->slots[i] - 1));
    while (wide.slots[at]) at = (at + 1) & (wide.n_slots - 1);
    wide.slots[at] = w->slots[i];
  }
  g_free(w->slots);
  *w = wide;
  return true;
}

bool tc_weld_find(tc_weld *w, const void *key, const void *keys, uint32_t next, uint32_t *number, GError **error) {
  if (w->n * 2 >= w->n_slots && !widen(w, keys, error)) return false;
  size_t at = slot_of(w, key);
  for (; w->slots[at]; at = (at + 1) & (w->n_slots - 1)) {
    *number = w->slots[at] - 1;
    if (memcmp((const uint8_t *)keys + 12 * (size_t)*number, key, 12) == 0) return true;
  }
  *number = next;
  w->slots[at] = next + 1;
  w->n++;
  return true;
}

/* ---- vertices and triangles ---- */

void tc_build_init(tc_build *b, const char *format, const tc_order *order) {
  *b = (tc_build){.order = order};
  g_strlcpy(b->format, format, sizeof b->format);
}

void tc_build_clear(tc_build *b) {
  g_free(b->positions);
  g_free(b->normals);
  g_free(b->colors);
  g_free(b->triangles);
  tc_polygon_clear(&b->polygon);
  *b = (tc_build){0};
}

bool tc_build_grow(tc_build *b, void *array, size_t *room, size_t n, size_t item, GError **error) {
  if (n <= *room) return true;
  const uint64_t bytes = (uint64_t)b->n_vertices * 24 + (uint64_t)b->n_colors * 4 + (uint64_t)b->n_triangles * 12, most = b->order->max_voxel_bytes;
  if (n > MOST_ITEMS || (most && bytes > most)) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "the mesh has more than %zu %s, which is over the limit; simplify it first",
                 n - 1, array == (void *)&b->triangles ? "triangles" : "vertices");
    return false;
  }
  const size_t wide = MAX(MAX(*room * 2, n), FIRST_ROOM);
  void *old, *grown;
  memcpy(&old, array, sizeof old);
  grown = g_try_realloc_n(old, wide, item);
  if (!grown) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "no memory for %zu vertices and triangles; simplify the mesh first", wide);
    return false;
  }
  memcpy(array, &grown, sizeof grown);
  *room = wide;
  return true;
}

/* Single precision keeps a thousandth of a mm up to 8192 mm. Beyond, the origin is a multiple of a power of two near
 * the first vertex, so subtracting it from single-precision coordinates is exact. */
static double anchor_near(double at) { return fabs(at) > 8192 ? 1024 * nearbyint(at / 1024) : 0; }

bool tc_build_place(tc_build *b, const double at[3], float place[3], GError **error) {
  double lps[3];
  for (int k = 0; k < 3; k++) {
    lps[k] = b->ras && k < 2 ? -at[k] : at[k];
    if (!(fabs(lps[k]) <= 1e9)) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "vertex %zu has a coordinate that is %s; repair the mesh where it was made",
                   b->n_vertices + 1, isfinite(lps[k]) ? "farther than 1e9 mm" : "no finite number");
      return false;
    }
    if (!b->n_vertices) b->origin[k] = anchor_near(lps[k]);
  }
  for (int k = 0; k < 3; k++) place[k] = (float)(lps[k] - b->origin[k]) + 0.0f; /* turns -0 into 0 */
  return true;
}

bool tc_build_vertex(tc_build *b, const double at[3], GError **error) {
  if (!tc_build_grow(b, &b->positions, &b->vertex_room, b->n_vertices + 1, sizeof *b->positions, error) ||
      !tc_build_place(b, at, b->positions[b->n_vertices], error))
    return false;
  b->n_vertices++;
  return true;
}

/* A vector that already is a unit vector keeps every bit. */
void tc_build_direction(const tc_build *b, const double along[3], float normal[3]) {
  double length = 0;
  for (int k = 0; k < 3; k++) length += along[k] * along[k];
  length = sqrt(length);
  const bool sound = isfinite(length) && length > 1e-30;
  const double scale = !sound ? 0 : fabs(length - 1) < 1e-5 ? 1 : 1 / length;
  for (int k = 0; k < 3; k++) normal[k] = sound ? (float)((b->ras && k < 2 ? -scale : scale) * along[k]) : k == 2;
}

bool tc_build_normal(tc_build *b, const double along[3], GError **error) {
  if (!tc_build_grow(b, &b->normals, &b->normal_room, b->n_normals + 1, sizeof *b->normals, error)) return false;
  tc_build_direction(b, along, b->normals[b->n_normals++]);
  return true;
}

bool tc_build_color(tc_build *b, const double rgb[3], GError **error) {
  if (!tc_build_grow(b, &b->colors, &b->color_room, b->n_colors + 1, sizeof *b->colors, error)) return false;
  uint32_t color = 0;
  for (int c = 0; c < 3; c++) color |= (uint32_t)lrint(255 * (rgb[c] > 0 ? fmin(rgb[c], 1) : 0)) << 8 * c;
  b->colors[b->n_colors++] = color;
  return true;
}

static bool same_place(const tc_build *b, uint32_t p, uint32_t q) {
  return p == q || memcmp(b->positions[p], b->positions[q], sizeof *b->positions) == 0;
}

bool tc_build_polygon(tc_build *b, const uint32_t *places, const uint32_t *corners, size_t n, GError **error) {
  if (n < 3) {
    b->degenerate++;
    return true;
  }
  if (!tc_polygon_split(&b->polygon, (const float(*)[3])b->positions, places, n, error)) return false;
  for (size_t i = 0; i < n - 2; i++) {
    const uint32_t *t = b->polygon.triangles[i], p = places[t[0]], q = places[t[1]], r = places[t[2]];
    if (same_place(b, p, q) || same_place(b, q, r) || same_place(b, r, p)) {
      b->degenerate++;
      continue;
    }
    if (!tc_build_grow(b, &b->triangles, &b->triangle_room, b->n_triangles + 1, sizeof *b->triangles, error)) return false;
    memcpy(b->triangles[b->n_triangles++], (const uint32_t[3]){corners[t[0]], corners[t[1]], corners[t[2]]}, sizeof *b->triangles);
  }
  return true;
}

/* ---- out ---- */

/* Sends data in portions, so that the daemon can cancel in between. */
static bool put(const tc_build *b, const void *items, size_t bytes, GError **error) {
  enum { PORTION = 16 << 20 };
  for (const char *at = items; bytes > 0;) {
    const size_t n = MIN(bytes, (size_t)PORTION);
    if (!b->order->goes_on(b->order->user, 1, error) || !tc_order_put(b->order, at, n, error)) return false;
    at += n;
    bytes -= n;
  }
  return true;
}

bool tc_build_send(tc_build *b, GError **error) {
  tc_mesh_head head = {.n_vertices = b->n_vertices,
                       .n_triangles = b->n_triangles,
                       .degenerate = b->degenerate,
                       .normals = b->n_vertices > 0 && b->n_normals == b->n_vertices,
                       .colors = b->n_vertices > 0 && b->n_colors == b->n_vertices};
  if (!b->n_triangles) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "the file holds no triangle%s",
                 b->degenerate ? " but degenerate ones" : "; save a surface, not points or lines");
    return false;
  }
  memcpy(head.origin, b->origin, sizeof head.origin);
  memcpy(head.format, b->format, sizeof head.format);
  return b->order->begin_mesh(b->order->user, &head, error) &&
         put(b, b->positions, b->n_vertices * sizeof *b->positions, error) &&
         (!head.normals || put(b, b->normals, b->n_vertices * sizeof *b->normals, error)) &&
         (!head.colors || put(b, b->colors, b->n_vertices * sizeof *b->colors, error)) &&
         put(b, b->triangles, b->n_triangles * sizeof *b->triangles, error);
}

bool tc_build_says_ras(const void *text, size_t size) { return memmem(text, size, "SPACE=RAS", 9) != NULL; }
