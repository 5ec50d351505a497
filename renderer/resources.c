#include "renderer/resources.h"

#include <stdlib.h>
#include <string.h>

#include "renderer/classify/outline.h"
#include "renderer/clock.h"
#include "renderer/volume/coefficients.h"

/* One list holds all kinds, so that one budget and one rule of age serve them. */
typedef enum item_kind {
  ITEM_COEFFICIENTS,
  ITEM_TABLE,
  ITEM_INTEGRALS,
  ITEM_SUPPORT,
  ITEM_MINMAX,
  ITEM_LEAP,
  ITEM_BOXES,
  ITEM_BOUNDS,
  ITEM_LABELS
} item_kind;

typedef struct item {
  item_kind kind;
  /* tc_volume, tc_table, tc_integrals, tc_support, tc_minmax, tc_leap, tc_boxes, tc_bounds or tc_labels; owned */
  void *thing;
  bool unfinished; /* in the making (of coefficients: a tc_coefficients): not to be found */
  size_t bytes;
  uint64_t last_use;
  uint64_t volume; /* serial it belongs to */
  int block, reach;
  tc_table_params params; /* table, integrals, support: .tf points to tf below */
  tc_transfer_function *tf; /* its own copy, at a fixed place */
} item;

struct tc_resources {
  tc_pool *pool;
  uint64_t budget, held, clock;
  item *items;
  int count, capacity;
  int64_t steps; /* tc_resources_steps() */
};

tc_resources *tc_resources_new(tc_pool *pool, uint64_t budget_bytes, GError **error) {
  tc_resources *r = calloc(1, sizeof *r);
  if (!r) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "renderer: out of memory");
    return NULL;
  }
  r->pool = pool;
  r->budget = budget_bytes;
  return r;
}

static void drop(tc_resources *r, int i) {
  item *it = &r->items[i];
  switch (it->kind) {
  case ITEM_COEFFICIENTS:
    if (it->unfinished)
      tc_coefficients_free(it->thing);
    else
      tc_volume_unref(it->thing);
    break;
  case ITEM_TABLE: tc_table_free(it->thing); break;
  case ITEM_INTEGRALS: tc_integrals_free(it->thing); break;
  case ITEM_SUPPORT: tc_support_free(it->thing); break;
  case ITEM_MINMAX: tc_minmax_free(it->thing); break;
  case ITEM_LEAP: tc_leap_free(it->thing); break;
  case ITEM_BOXES: tc_boxes_free(it->thing); break;
  case ITEM_BOUNDS: tc_bounds_free(it->thing); break;
  case ITEM_LABELS: tc_labels_free(it->thing); break;
  }
  if (it->tf) free(it->tf->points);
  free(it->tf);
  r->held -= it->bytes;
  r->items[i] = r->items[--r->count];
}

void tc_resources_free(tc_resources *resources) {
  if (!resources) return;
  while (resources->count) drop(resources, resources->count - 1);
  free(resources->items);
  free(resources);
}

/* Makes the budget hold `bytes` more, by dropping the oldest of the same kind first: what the current frame already
 * asked for is of another kind and stays, as does `keep`. Coefficients are what a frame asks for first, and large: for
 * them anything may go. */
static void drop_oldest(tc_resources *r, item_kind kind, size_t bytes, const void *keep) {
  while (r->held + bytes > r->budget) {
    int oldest = -1;
    for (int i = 0; i < r->count; i++)
      if ((r->items[i].kind == kind || kind == ITEM_COEFFICIENTS) && r->items[i].thing != keep &&
          (oldest < 0 || r->items[i].last_use < r->items[oldest].last_use))
        oldest = i;
    if (oldest < 0) break;
    drop(r, oldest);
  }
}

/* A place for one more of `bytes`; NULL: out of memory. */
static item *make_room(tc_resources *r, item_kind kind, size_t bytes) {
  drop_oldest(r, kind, bytes, NULL);
  if (r->count == r->capacity) {
    int capacity = r->capacity ? 2 * r->capacity : 32;
    item *grown = realloc(r->items, (size_t)capacity * sizeof *grown);
    if (!grown) return NULL;
    r->items = grown;
    r->capacity = capacity;
  }
  r->held += bytes;
  r->steps++;
  item *it = &r->items[r->count++];
  *it = (item){.kind = kind, .bytes = bytes, .last_use = ++r->clock};
  return it;
}

static const void *used(tc_resources *r, item *it) {
  it->last_use = ++r->clock;
  return it->thing;
}

static const void *used_if_made(tc_resources *r, item *it) {
  return it && !it->unfinished ? used(r, it) : NULL;
}

/* A place for what is going to be built, in parts; NULL: out of memory, which it says. */
static item *begin_item(tc_resources *r, item_kind kind, size_t bytes, uint64_t volume, const char *what,
                        GError **error) {
  item *it = make_room(r, kind, bytes);
  if (it) {
    it->unfinished = true;
    it->volume = volume;
  } else {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "%s: out of memory", what);
  }
  return it;
}

int64_t tc_resources_steps(const tc_resources *resources) { return resources->steps; }

/* ---- coefficients ---- */

static item *coefficients_item(tc_resources *r, uint64_t volume_serial) {
  for (int i = 0; i < r->count; i++)
    if (r->items[i].kind == ITEM_COEFFICIENTS && r->items[i].volume == volume_serial) return &r->items[i];
  return NULL;
}

const tc_volume *tc_resources_find_coefficients(tc_resources *r, uint64_t volume_serial) {
  return used_if_made(r, coefficients_item(r, volume_serial));
}

static bool begin_coefficients(tc_resources *r, const tc_volume *volume, uint64_t bytes, GError **error) {
  tc_coefficients *begun = tc_coefficients_begin(volume, error);
  item *it = NULL;
  if (begun) it = begin_item(r, ITEM_COEFFICIENTS, (size_t)bytes, tc_volume_serial(volume), "coefficients", error);
  if (it)
    it->thing = begun;
  else
    tc_coefficients_free(begun);
  return it != NULL;
}

const tc_volume *tc_resources_coefficients(tc_resources *r, const tc_volume *volume, double *ms, GError **error) {
  const tc_volume *found = tc_resources_find_coefficients(r, tc_volume_serial(volume));
  if (found) return found;
  uint64_t bytes = tc_coefficients_bytes(volume);
  if (bytes > r->budget) {
    tc_set_error(error, TC_ERROR_LIMIT, "/sampling/prefilter",
                 "sampling/prefilter: the coefficients take %.0f MiB, the renderer's cache holds %.0f: turn it off or "
                 "raise the cache",
                 (double)bytes / 0x1p20, (double)r->budget / 0x1p20);
    return NULL;
  }
  double start = tc_now_ms();
  if (!coefficients_item(r, tc_volume_serial(volume)) && !begin_coefficients(r, volume, bytes, error)) return NULL;
  item *it = coefficients_item(r, tc_volume_serial(volume));
  tc_coefficients *begun = it->thing;
  int64_t before = tc_coefficients_steps(begun);
  it->last_use = ++r->clock;
  bool made = tc_coefficients_go_on(begun, volume, r->pool);
  r->steps += tc_coefficients_steps(begun) != before;
  *ms += tc_now_ms() - start;
  if (!made) {
    tc_halt_say(tc_pool_halt(r->pool), error);
    return NULL;
  }
  it->thing = tc_coefficients_take(begun);
  it->unfinished = false;
  return it->thing;
}

/* ---- tables ---- */

static bool same_transfer_function(const tc_transfer_function *a, const tc_transfer_function *b) {
  return a->count == b->count && a->kind == b->kind &&
         (a->kind == TC_KNOT_EXTINCTION || a->unit_distance_mm == b->unit_distance_mm) &&
         !memcmp(a->points, b->points, a->count * sizeof *a->points);
}

static bool same_table(const tc_table_params *a, const tc_table_params *b) {
  return a->n == b->n && a->voxel_lo == b->voxel_lo && a->voxel_hi == b->voxel_hi && a->slope == b->slope &&
         a->intercept == b->intercept && a->step_mm == b->step_mm && a->linear_light == b->linear_light &&
         a->bits == b->bits && a->n_zooms == b->n_zooms &&
         !memcmp(a->zooms, b->zooms, (size_t)a->n_zooms * sizeof *a->zooms) && same_transfer_function(a->tf, b->tf);
}

static const void *find_made(tc_resources *r, item_kind kind, const tc_table_params *params) {
  for (int i = 0; i < r->count; i++)
    if (r->items[i].kind == kind && same_table(&r->items[i].params, params)) return used(r, &r->items[i]);
  return NULL;
}

const tc_table *tc_resources_find_table(tc_resources *r, const tc_table_params *params) {
  return find_made(r, ITEM_TABLE, params);
}

const tc_integrals *tc_resources_find_integrals(tc_resources *r, const tc_table_params *params) {
  return find_made(r, ITEM_INTEGRALS, params);
}

static tc_transfer_function *copy_transfer_function(const tc_transfer_function *from) {
  tc_transfer_function *tf = malloc(sizeof *tf);
  tc_knot *points = malloc(from->count * sizeof *points);
  if (!tf || !points) {
    free(tf);
    free(points);
    return NULL;
  }
  *tf = *from;
  tf->points = memcpy(points, from->points, from->count * sizeof *points);
  return tf;
}

/* Keeps what was built with these parameters; false: out of memory, and it is still the caller's. */
static bool keep(tc_resources *r, item_kind kind, void *thing, size_t bytes, const tc_table_params *params,
                 GError **error) {
  tc_transfer_function *tf = copy_transfer_function(params->tf);
  item *it = tf ? make_room(r, kind, bytes) : NULL;
  if (!it) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "transfer function: out of memory");
    if (tf) free(tf->points);
    free(tf);
    return false;
  }
  it->thing = thing;
  it->params = *params;
  it->params.tf = it->tf = tf;
  return true;
}

/* The last used table over the same nodes as `table`, with entries, or NULL. */
static const tc_table *like_table(const tc_resources *r, const tc_table *table) {
  const item *last = NULL;
  for (int i = 0; i < r->count; i++) {
    if (r->items[i].kind != ITEM_TABLE) continue;
    const tc_table *t = r->items[i].thing;
    if (t->entries && t->n == table->n && t->step_mm == table->step_mm && t->lo == table->lo && t->hi == table->hi &&
        (!last || r->items[i].last_use > last->last_use))
      last = &r->items[i];
  }
  return last ? last->thing : NULL;
}

const tc_table *tc_resources_table(tc_resources *r, const tc_table_params *params, double *ms, GError **error) {
  const tc_table *found = tc_resources_find_table(r, params);
  if (found) return found;
  tc_table *table = tc_table_outline(params, tc_pool_halt(r->pool), error);
  if (!table || !keep(r, ITEM_TABLE, table, tc_table_held(table), params, error)) {
    tc_table_free(table);
    return NULL;
  }
  *ms += table->build_ms;
  return table;
}

static item *item_of(tc_resources *r, const tc_table *table) {
  int i = 0;
  while (r->items[i].thing != table) i++;
  return &r->items[i];
}

bool tc_resources_fill(tc_resources *r, const tc_table *table, double *ms, GError **error) {
  if (table->entries) return true;
  tc_table *own = item_of(r, table)->thing;
  double before = own->build_ms;
  int64_t steps = tc_table_steps(own);
  bool filled = tc_table_fill(own, like_table(r, own), r->pool, error);
  r->steps += tc_table_steps(own) != steps;
  *ms += own->build_ms - before;
  if (!filled) return false;
  drop_oldest(r, ITEM_TABLE, own->bytes, own);
  r->held += own->bytes;
  item_of(r, own)->bytes += own->bytes;
  return true;
}

void tc_resources_table_took(tc_resources *r, const tc_table *table, double ms) {
  ((tc_table *)item_of(r, table)->thing)->build_ms += ms;
}

const tc_integrals *tc_resources_integrals(tc_resources *r, const tc_table_params *params, double *ms, GError **error) {
  const tc_integrals *found = tc_resources_find_integrals(r, params);
  if (found) return found;
  tc_integrals *integrals = tc_integrals_build(params, tc_pool_halt(r->pool), error);
  if (!integrals) return NULL;
  if (!keep(r, ITEM_INTEGRALS, integrals, integrals->bytes, params, error)) {
    tc_integrals_free(integrals);
    return NULL;
  }
  *ms += integrals->build_ms;
  return integrals;
}

/* ---- leaping ---- */

/* Colours, the step and the compositing space change nothing about where something is seen. */
static bool same_support(const tc_table_params *a, const tc_table_params *b) {
  const tc_transfer_function *p = a->tf, *q = b->tf;
  if (a->n != b->n || a->voxel_lo != b->voxel_lo || a->voxel_hi != b->voxel_hi || a->slope != b->slope ||
      a->intercept != b->intercept || p->count != q->count)
    return false;
  for (size_t i = 0; i < p->count; i++)
    if (p->points[i].value != q->points[i].value || (p->points[i].amount > 0) != (q->points[i].amount > 0))
      return false;
  return true;
}

const tc_support *tc_resources_find_support(tc_resources *r, const tc_table_params *params) {
  for (int i = 0; i < r->count; i++)
    if (r->items[i].kind == ITEM_SUPPORT && r->items[i].tf && same_support(&r->items[i].params, params))
      return used(r, &r->items[i]);
  return NULL;
}

const tc_support *tc_resources_find_surface(tc_resources *r, double lo, double hi) {
  for (int i = 0; i < r->count; i++) {
    const tc_support *have = r->items[i].thing;
    if (r->items[i].kind == ITEM_SUPPORT && !r->items[i].tf && have->lo == lo && have->hi == hi)
      return used(r, &r->items[i]);
  }
  return NULL;
}

const tc_support *tc_resources_surface(tc_resources *r, double lo, double hi, GError **error) {
  const tc_support *found = tc_resources_find_surface(r, lo, hi);
  if (found) return found;
  tc_support *support = tc_support_surface(lo, hi, error);
  item *it = support ? make_room(r, ITEM_SUPPORT, support->bytes) : NULL;
  if (it) {
    it->thing = support;
    return support;
  }
  if (support) tc_set_error(error, TC_ERROR_MEMORY, NULL, "isosurface: out of memory");
  tc_support_free(support);
  return NULL;
}

const tc_support *tc_resources_support(tc_resources *r, const tc_table_params *params, double *ms, GError **error) {
  const tc_support *found = tc_resources_find_support(r, params);
  if (found) return found;
  tc_support *support = tc_support_build(params, error);
  if (!support) return NULL;
  if (!keep(r, ITEM_SUPPORT, support, support->bytes, params, error)) {
    tc_support_free(support);
    return NULL;
  }
  *ms += support->build_ms;
  return support;
}

static bool in_blocks(const item *it, const tc_volume *volume, int block, int reach) {
  return it->volume == tc_volume_serial(volume) && it->block == block && it->reach == reach;
}

static item *minmax_item(tc_resources *r, const tc_volume *volume, int block, int reach) {
  for (int i = 0; i < r->count; i++)
    if (r->items[i].kind == ITEM_MINMAX && in_blocks(&r->items[i], volume, block, reach)) return &r->items[i];
  return NULL;
}

const tc_minmax *tc_resources_find_minmax(tc_resources *r, const tc_volume *volume, int block, int reach) {
  return used_if_made(r, minmax_item(r, volume, block, reach));
}

static bool begin_minmax(tc_resources *r, const tc_volume *volume, int block, int reach, GError **error) {
  tc_minmax *m = tc_minmax_begin(volume, block, reach, error);
  item *it = m ? begin_item(r, ITEM_MINMAX, m->bytes, tc_volume_serial(volume), "min-max blocks", error) : NULL;
  if (!it) {
    tc_minmax_free(m);
    return false;
  }
  it->thing = m;
  it->block = block;
  it->reach = reach;
  return true;
}

const tc_minmax *tc_resources_minmax(tc_resources *r, const tc_volume *volume, int block, int reach, double *ms,
                                     GError **error) {
  if (!minmax_item(r, volume, block, reach) && !begin_minmax(r, volume, block, reach, error)) return NULL;
  item *it = minmax_item(r, volume, block, reach);
  tc_minmax *m = it->thing;
  int done = m->done;
  double before = m->build_ms;
  it->unfinished = !tc_minmax_go_on(m, volume, r->pool, error);
  r->steps += m->done != done;
  *ms += m->build_ms - before;
  return used_if_made(r, it);
}

const tc_leap *tc_resources_find_leap(tc_resources *r, const tc_volume *volume, int block, int reach,
                                      const tc_support *support) {
  for (int i = 0; i < r->count; i++) {
    item *it = &r->items[i];
    if (it->kind == ITEM_LEAP && in_blocks(it, volume, block, reach) &&
        ((const tc_leap *)it->thing)->support == support->serial)
      return used(r, it);
  }
  return NULL;
}

/* The map of these blocks that was in use last: most transfer functions are an earlier one, changed a little. */
static const tc_leap *latest_leap(const tc_resources *r, const tc_volume *volume, const tc_minmax *m) {
  const item *latest = NULL;
  for (int i = 0; i < r->count; i++) {
    const item *it = &r->items[i];
    if (it->kind == ITEM_LEAP && in_blocks(it, volume, m->block, m->reach) &&
        (!latest || it->last_use > latest->last_use))
      latest = it;
  }
  return latest ? latest->thing : NULL;
}

const tc_leap *tc_resources_leap(tc_resources *r, const tc_volume *volume, const tc_minmax *minmax,
                                 const tc_support *support, double *ms, GError **error) {
  const tc_leap *found = tc_resources_find_leap(r, volume, minmax->block, minmax->reach, support);
  if (found) return found;
  tc_leap *leap = tc_leap_build(minmax, support, latest_leap(r, volume, minmax), r->pool, error);
  if (!leap) return NULL;
  item *it = make_room(r, ITEM_LEAP, leap->bytes);
  if (!it) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "distance map: out of memory");
    tc_leap_free(leap);
    return NULL;
  }
  it->thing = leap;
  it->volume = tc_volume_serial(volume);
  it->block = minmax->block;
  it->reach = minmax->reach;
  *ms += leap->build_ms;
  return leap;
}

static item *boxes_item(tc_resources *r, const tc_volume *volume, int block, int reach, const tc_support *support) {
  for (int i = 0; i < r->count; i++) {
    item *it = &r->items[i];
    if (it->kind == ITEM_BOXES && in_blocks(it, volume, block, reach) &&
        ((const tc_boxes *)it->thing)->support == support->serial)
      return it;
  }
  return NULL;
}

const tc_boxes *tc_resources_find_boxes(tc_resources *r, const tc_volume *volume, int block, int reach,
                                        const tc_support *support) {
  return used_if_made(r, boxes_item(r, volume, block, reach, support));
}

static bool begin_boxes(tc_resources *r, const tc_volume *volume, const tc_minmax *minmax, const tc_support *support,
                        GError **error) {
  tc_boxes *boxes = tc_boxes_begin(volume, minmax, support, r->pool, error);
  item *it = boxes ? begin_item(r, ITEM_BOXES, 0, tc_volume_serial(volume), "boxes of what shows", error) : NULL;
  if (!it) {
    tc_boxes_free(boxes);
    return false;
  }
  it->thing = boxes;
  it->block = minmax->block;
  it->reach = minmax->reach;
  return true;
}

const tc_boxes *tc_resources_boxes(tc_resources *r, const tc_volume *volume, const tc_minmax *minmax,
                                   const tc_support *support, double *ms, GError **error) {
  const int block = minmax->block, reach = minmax->reach;
  const tc_boxes *found = tc_resources_find_boxes(r, volume, block, reach, support);
  if (found) return found;
  if (!boxes_item(r, volume, block, reach, support) && !begin_boxes(r, volume, minmax, support, error)) return NULL;
  tc_boxes *boxes = boxes_item(r, volume, block, reach, support)->thing;
  int steps = tc_boxes_steps(boxes);
  double before = boxes->build_ms;
  bool made = tc_boxes_go_on(boxes, volume, minmax, r->pool, error);
  r->steps += tc_boxes_steps(boxes) != steps;
  *ms += boxes->build_ms - (steps ? before : 0);
  if (!made) return NULL;
  drop_oldest(r, ITEM_BOXES, boxes->bytes, boxes);
  item *it = boxes_item(r, volume, block, reach, support); /* it may have moved */
  r->held += it->bytes = boxes->bytes;
  it->unfinished = false;
  return used(r, it);
}

const tc_bounds *tc_resources_find_bounds(tc_resources *r, const tc_volume *volume, int block, int reach,
                                          const tc_grey *grey) {
  for (int i = 0; i < r->count; i++) {
    item *it = &r->items[i];
    if (it->kind != ITEM_BOUNDS || !in_blocks(it, volume, block, reach)) continue;
    const tc_grey *have = &((const tc_bounds *)it->thing)->grey;
    if (have->turn == grey->turn && have->floor == grey->floor && have->stop == grey->stop) return used(r, it);
  }
  return NULL;
}

const tc_bounds *tc_resources_bounds(tc_resources *r, const tc_volume *volume, const tc_minmax *minmax,
                                     const tc_grey *grey, double *ms, GError **error) {
  const tc_bounds *found = tc_resources_find_bounds(r, volume, minmax->block, minmax->reach, grey);
  if (found) return found;
  tc_bounds *bounds = tc_bounds_build(minmax, grey, r->pool, error);
  if (!bounds) return NULL;
  item *it = make_room(r, ITEM_BOUNDS, bounds->bytes);
  if (!it) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "bounds of the blocks: out of memory");
    tc_bounds_free(bounds);
    return NULL;
  }
  it->thing = bounds;
  it->volume = tc_volume_serial(volume);
  it->block = minmax->block;
  it->reach = minmax->reach;
  *ms += bounds->build_ms;
  return bounds;
}

/* ---- labels ---- */

static const tc_labels *find_labels(tc_resources *r, const GBytes *key) {
  for (int i = 0; i < r->count; i++) {
    item *it = &r->items[i];
    if (it->kind == ITEM_LABELS && g_bytes_equal(((const tc_labels *)it->thing)->key, key)) return used(r, it);
  }
  return NULL;
}

const tc_labels *tc_resources_find_labels(tc_resources *r, const tc_volume *labels, const tc_scene *scene) {
  GBytes *key = tc_labels_key(labels, scene);
  const tc_labels *found = find_labels(r, key);
  g_bytes_unref(key);
  return found;
}

const tc_labels *tc_resources_labels(tc_resources *r, const tc_volume *labels, const tc_scene *scene, double *ms,
                                     GError **error) {
  GBytes *key = tc_labels_key(labels, scene);
  const tc_labels *found = find_labels(r, key);
  if (found) {
    g_bytes_unref(key);
    return found;
  }
  tc_labels *l = tc_labels_build(labels, scene, key, tc_pool_halt(r->pool), error);
  if (!l) return NULL;
  item *it = make_room(r, ITEM_LABELS, l->bytes);
  if (!it) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "labels: out of memory");
    tc_labels_free(l);
    return NULL;
  }
  it->thing = l;
  it->volume = tc_volume_serial(labels);
  *ms += l->build_ms;
  return l;
}

void tc_resources_forget(tc_resources *r, uint64_t volume_serial) {
  const tc_volume *coefficients = tc_resources_find_coefficients(r, volume_serial);
  if (coefficients) tc_resources_forget(r, tc_volume_serial(coefficients));
  for (int i = r->count - 1; i >= 0; i--)
    if (r->items[i].volume == volume_serial) drop(r, i);
}

uint64_t tc_resources_held(const tc_resources *r) { return r->held; }

void tc_resources_limit(tc_resources *r, uint64_t budget_bytes) {
  r->budget = budget_bytes;
  drop_oldest(r, ITEM_COEFFICIENTS, 0, NULL); /* for them anything may go */
}
