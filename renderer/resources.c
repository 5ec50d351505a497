#include "renderer/resources.h"

#include <stdlib.h>
#include <string.h>

#include "renderer/classify/outline.h"
#include "renderer/clock.h"
#include "renderer/store.h"
#include "renderer/volume/coefficients.h"

struct tc_resources {
  tc_pool *pool;
  tc_store *store;
  int64_t steps; /* tc_resources_steps() */
};

#define FREES(name, type)                                                                                              \
  static void free_##name(void *thing) { tc_##type(thing); }
FREES(volume, volume_unref)
FREES(coefficients, coefficients_free)
FREES(table, table_free)
FREES(integrals, integrals_free)
FREES(support, support_free)
FREES(minmax, minmax_free)
FREES(leap, leap_free)
FREES(boxes, boxes_free)
FREES(bounds, bounds_free)
FREES(labels, labels_free)

/* Coefficients are what a frame asks for first, and large: for them anything may go. */
static const tc_store_kind coefficients_kind = {"coefficients", free_volume, free_coefficients, true},
                           table_kind = {"transfer function", free_table, NULL, false},
                           integrals_kind = {"transfer function", free_integrals, NULL, false},
                           support_kind = {"transfer function", free_support, NULL, false},
                           surface_kind = {"isosurface", free_support, NULL, false},
                           minmax_kind = {"min-max blocks", free_minmax, NULL, false},
                           leap_kind = {"distance map", free_leap, NULL, false},
                           boxes_kind = {"occupied boxes", free_boxes, NULL, false},
                           bounds_kind = {"bounds of the blocks", free_bounds, NULL, false},
                           labels_kind = {"labels", free_labels, NULL, false};

tc_resources *tc_resources_new(tc_pool *pool, uint64_t budget_bytes, GError **error) {
  tc_resources *r = calloc(1, sizeof *r);
  if (!r) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "renderer: out of memory");
    return NULL;
  }
  r->pool = pool;
  r->store = tc_store_new(budget_bytes, error);
  if (r->store) return r;
  free(r);
  return NULL;
}

void tc_resources_free(tc_resources *resources) {
  if (!resources) return;
  tc_store_free(resources->store);
  free(resources);
}

int64_t tc_resources_steps(const tc_resources *resources) { return resources->steps; }

/* Into the store, which takes the thing; NULL for one that could not be made. */
static tc_stored *put(tc_resources *r, const tc_store_kind *kind, const void *key, size_t key_size, uint64_t volume,
                      void *thing, size_t bytes, bool unfinished, GError **error) {
  if (!thing) return NULL;
  tc_stored *it = tc_store_add(r->store, kind, key, key_size, volume, thing, bytes, error);
  if (it) it->unfinished = unfinished;
  r->steps += it != NULL;
  return it;
}

/* ---- coefficients ---- */

const tc_volume *tc_resources_coefficients(tc_resources *r, const tc_volume *volume, double *ms, GError **error) {
  const uint64_t serial = tc_volume_serial(volume), bytes = tc_coefficients_bytes(volume);
  tc_stored *it = tc_store_find(r->store, &coefficients_kind, &serial, sizeof serial);
  if ((it && !it->unfinished) || !ms) return tc_store_use(r->store, it);
  if (bytes > tc_store_budget(r->store)) {
    tc_set_error(error, TC_ERROR_LIMIT, "/sampling/prefilter",
                 "sampling/prefilter: the coefficients take %.0f MiB, the renderer's cache holds %.0f: turn it off or "
                 "raise the cache",
                 (double)bytes / 0x1p20, (double)tc_store_budget(r->store) / 0x1p20);
    return NULL;
  }
  double start = tc_now_ms();
  if (!it)
    it = put(r, &coefficients_kind, &serial, sizeof serial, serial, tc_coefficients_begin(volume, error), (size_t)bytes, true,
             error);
  if (!it) return NULL;
  int64_t before = tc_coefficients_steps(it->thing);
  bool made = tc_coefficients_go_on(it->thing, volume, r->pool);
  r->steps += tc_coefficients_steps(it->thing) != before;
  *ms += tc_now_ms() - start;
  if (made) {
    it->thing = tc_coefficients_take(it->thing);
    it->unfinished = false;
  } else {
    tc_halt_say(tc_pool_halt(r->pool), error);
  }
  return tc_store_use(r->store, it);
}

/* ---- tables ---- */

/* Everything that a table or integrals are made from. */
static GByteArray *table_key(const tc_table_params *p) {
  const tc_transfer_function *tf = p->tf;
  const double numbers[] = {p->voxel_lo, p->voxel_hi, p->slope, p->intercept, p->step_mm,
                            tf->kind == TC_KNOT_EXTINCTION ? 0 : tf->unit_distance_mm};
  const int32_t choices[] = {p->n, p->linear_light, p->bits, p->n_zooms, tf->kind};
  GByteArray *key = g_byte_array_sized_new((guint)(sizeof numbers + sizeof choices + tf->count * sizeof *tf->points));
  g_byte_array_append(key, (const guint8 *)numbers, sizeof numbers);
  g_byte_array_append(key, (const guint8 *)choices, sizeof choices);
  g_byte_array_append(key, (const guint8 *)p->zooms, (guint)((size_t)p->n_zooms * sizeof *p->zooms));
  g_byte_array_append(key, (const guint8 *)tf->points, (guint)(tf->count * sizeof *tf->points));
  return key;
}

typedef struct nodes {
  int n;
  double lo, hi, step_mm;
} nodes;

static bool has_entries_over(const void *thing, const void *user) {
  const tc_table *t = thing;
  const nodes *like = user;
  return t->entries && t->n == like->n && t->step_mm == like->step_mm && t->lo == like->lo && t->hi == like->hi;
}

const tc_table *tc_resources_table(tc_resources *r, const tc_table_params *params, double *ms, GError **error) {
  GByteArray *key = table_key(params);
  tc_stored *it = tc_store_find(r->store, &table_kind, key->data, key->len);
  if (!it && ms) {
    tc_table *table = tc_table_outline(params, tc_pool_halt(r->pool), error);
    it = put(r, &table_kind, key->data, key->len, 0, table, table ? tc_table_held(table) : 0, false, error);
    if (it) *ms += table->build_ms;
  }
  g_byte_array_unref(key);
  return tc_store_use(r->store, it);
}

static bool is_it(const void *thing, const void *user) { return thing == user; }

static tc_stored *stored_table(const tc_resources *r, const tc_table *table) {
  return tc_store_latest(r->store, &table_kind, is_it, table);
}

bool tc_resources_fill(tc_resources *r, const tc_table *table, double *ms, GError **error) {
  if (table->entries) return true;
  tc_table *own = stored_table(r, table)->thing;
  if (!tc_store_may_grow(r->store, stored_table(r, table), own->bytes, error)) return false;
  const nodes same = {table->n, table->lo, table->hi, table->step_mm};
  const tc_stored *like = tc_store_latest(r->store, &table_kind, has_entries_over, &same);
  double before = own->build_ms;
  int64_t steps = tc_table_steps(own);
  bool filled = tc_table_fill(own, like ? like->thing : NULL, r->pool, error);
  r->steps += tc_table_steps(own) != steps;
  *ms += own->build_ms - before;
  if (filled) tc_store_grow(r->store, stored_table(r, table), own->bytes);
  return filled;
}

void tc_resources_table_took(tc_resources *r, const tc_table *table, double ms) {
  ((tc_table *)stored_table(r, table)->thing)->build_ms += ms;
}

const tc_integrals *tc_resources_integrals(tc_resources *r, const tc_table_params *params, double *ms, GError **error) {
  GByteArray *key = table_key(params);
  tc_stored *it = tc_store_find(r->store, &integrals_kind, key->data, key->len);
  if (!it && ms) {
    tc_integrals *made = tc_integrals_build(params, tc_pool_halt(r->pool), error);
    it = put(r, &integrals_kind, key->data, key->len, 0, made, made ? made->bytes : 0, false, error);
    if (it) *ms += made->build_ms;
  }
  g_byte_array_unref(key);
  return tc_store_use(r->store, it);
}

/* ---- empty-space skipping ---- */

/* Colours, the step and the compositing space change nothing about where something is seen. */
static GByteArray *support_key(const tc_table_params *p) {
  const tc_transfer_function *tf = p->tf;
  const double numbers[] = {p->n, p->voxel_lo, p->voxel_hi, p->slope, p->intercept};
  GByteArray *key = g_byte_array_sized_new((guint)(sizeof numbers + tf->count * (sizeof(double) + 1)));
  g_byte_array_append(key, (const guint8 *)numbers, sizeof numbers);
  for (size_t i = 0; i < tf->count; i++) {
    const guint8 shows = tf->points[i].amount > 0;
    g_byte_array_append(key, (const guint8 *)&tf->points[i].value, sizeof tf->points[i].value);
    g_byte_array_append(key, &shows, 1);
  }
  return key;
}

const tc_support *tc_resources_support(tc_resources *r, const tc_table_params *params, double *ms, GError **error) {
  GByteArray *key = support_key(params);
  tc_stored *it = tc_store_find(r->store, &support_kind, key->data, key->len);
  if (!it && ms) {
    tc_support *made = tc_support_build(params, error);
    it = put(r, &support_kind, key->data, key->len, 0, made, made ? made->bytes : 0, false, error);
    if (it) *ms += made->build_ms;
  }
  g_byte_array_unref(key);
  return tc_store_use(r->store, it);
}

const tc_support *tc_resources_surface(tc_resources *r, double lo, double hi, double *ms, GError **error) {
  const double key[] = {lo, hi};
  tc_stored *it = tc_store_find(r->store, &surface_kind, key, sizeof key);
  if (!it && ms) {
    tc_support *made = tc_support_surface(lo, hi, error);
    it = put(r, &surface_kind, key, sizeof key, 0, made, made ? made->bytes : 0, false, error);
  }
  return tc_store_use(r->store, it);
}

/* Blocks of a volume, and what else a structure over them is made from. No padding: keys are compared as bytes. */
typedef struct blocks_key {
  uint64_t volume, support;
  int32_t block, reach;
  float grey[4];
} blocks_key;

static blocks_key key_of(const tc_volume *volume, int block, int reach) {
  return (blocks_key){.volume = tc_volume_serial(volume), .block = block, .reach = reach};
}

const tc_minmax *tc_resources_minmax(tc_resources *r, const tc_volume *volume, int block, int reach, double *ms,
                                     GError **error) {
  const blocks_key key = key_of(volume, block, reach);
  tc_stored *it = tc_store_find(r->store, &minmax_kind, &key, sizeof key);
  if (!ms) return tc_store_use(r->store, it);
  if (!it) {
    tc_minmax *begun = tc_minmax_begin(volume, block, reach, error);
    it = put(r, &minmax_kind, &key, sizeof key, key.volume, begun, begun ? begun->bytes : 0, true, error);
    if (!it) return NULL;
  }
  tc_minmax *m = it->thing;
  int done = m->done;
  double before = m->build_ms;
  it->unfinished = !tc_minmax_go_on(m, volume, r->pool, error);
  r->steps += m->done != done;
  *ms += m->build_ms - before;
  return tc_store_use(r->store, it);
}

static bool same_blocks(const void *thing, const void *user) {
  const tc_leap *leap = thing;
  const tc_leap *like = user;
  return leap->block == like->block && leap->reach == like->reach && leap->volume == like->volume;
}

const tc_leap *tc_resources_leap(tc_resources *r, const tc_volume *volume, int block, int reach, const tc_minmax *minmax,
                                 const tc_support *support, double *ms, GError **error) {
  blocks_key key = key_of(volume, block, reach);
  key.support = support->serial;
  tc_stored *it = tc_store_find(r->store, &leap_kind, &key, sizeof key);
  if (!it && ms) {
    /* Most transfer functions are an earlier one, changed a little: the map in use last is where it begins. */
    const tc_leap like = {.block = block, .reach = reach, .volume = key.volume};
    const tc_stored *before = tc_store_latest(r->store, &leap_kind, same_blocks, &like);
    tc_leap *made = tc_leap_build(minmax, support, before ? before->thing : NULL, r->pool, error);
    if (made) made->volume = key.volume;
    it = put(r, &leap_kind, &key, sizeof key, key.volume, made, made ? made->bytes : 0, false, error);
    if (it) *ms += made->build_ms;
  }
  return tc_store_use(r->store, it);
}

const tc_boxes *tc_resources_boxes(tc_resources *r, const tc_volume *volume, int block, int reach, const tc_minmax *minmax,
                                   const tc_support *support, double *ms, GError **error) {
  blocks_key key = key_of(volume, block, reach);
  key.support = support->serial;
  tc_stored *it = tc_store_find(r->store, &boxes_kind, &key, sizeof key);
  if ((it && !it->unfinished) || !ms) return tc_store_use(r->store, it);
  if (!it)
    it = put(r, &boxes_kind, &key, sizeof key, key.volume, tc_boxes_begin(volume, minmax, support, r->pool, error), 0, true,
             error);
  if (!it) return NULL;
  tc_boxes *boxes = it->thing;
  int steps = tc_boxes_steps(boxes);
  double before = boxes->build_ms;
  it->unfinished = !tc_boxes_go_on(boxes, volume, minmax, r->pool, error);
  r->steps += tc_boxes_steps(boxes) != steps;
  *ms += boxes->build_ms - (steps ? before : 0);
  if (!it->unfinished) tc_store_grow(r->store, it, boxes->bytes);
  return tc_store_use(r->store, it);
}

const tc_bounds *tc_resources_bounds(tc_resources *r, const tc_volume *volume, int block, int reach, const tc_minmax *minmax,
                                     const tc_grey *grey, double *ms, GError **error) {
  blocks_key key = key_of(volume, block, reach);
  key.grey[0] = grey->turn, key.grey[1] = grey->floor, key.grey[2] = grey->stop;
  tc_stored *it = tc_store_find(r->store, &bounds_kind, &key, sizeof key);
  if (!it && ms) {
    tc_bounds *made = tc_bounds_build(minmax, grey, r->pool, error);
    it = put(r, &bounds_kind, &key, sizeof key, key.volume, made, made ? made->bytes : 0, false, error);
    if (it) *ms += made->build_ms;
  }
  return tc_store_use(r->store, it);
}

/* ---- labels ---- */

const tc_labels *tc_resources_labels(tc_resources *r, const tc_volume *labels, const tc_scene *scene, double *ms,
                                     GError **error) {
  GBytes *key = tc_labels_key(labels, scene);
  gsize size;
  const void *bytes = g_bytes_get_data(key, &size);
  tc_stored *it = tc_store_find(r->store, &labels_kind, bytes, size);
  if (!it && ms) {
    tc_labels *made = tc_labels_build(labels, scene, g_bytes_ref(key), tc_pool_halt(r->pool), error);
    it = put(r, &labels_kind, bytes, size, tc_volume_serial(labels), made, made ? made->bytes : 0, false, error);
    if (it) *ms += made->build_ms;
  }
  g_bytes_unref(key);
  return tc_store_use(r->store, it);
}

/* ---- all ---- */

uint64_t tc_resources_forget(tc_resources *r, uint64_t volume_serial) {
  tc_stored *it = tc_store_find(r->store, &coefficients_kind, &volume_serial, sizeof volume_serial);
  const uint64_t coefficients = it && !it->unfinished ? tc_volume_serial(it->thing) : 0;
  if (coefficients) tc_store_forget(r->store, coefficients);
  tc_store_forget(r->store, volume_serial);
  return coefficients;
}

uint64_t tc_resources_held(const tc_resources *r) { return tc_store_held(r->store); }

uint64_t tc_resources_wanted(tc_resources *r) { return tc_store_wanted(r->store); }
void tc_resources_limit(tc_resources *r, uint64_t most_bytes) { tc_store_limit(r->store, most_bytes); }
