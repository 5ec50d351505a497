#include "renderer/frame/resources.h"

#include <stdlib.h>

#include "renderer/base/building.h"
#include "renderer/base/clock.h"
#include "renderer/frame/resource_kinds.h"

struct tc_resources {
  tc_pool *pool;
  tc_store *store;
  int64_t steps; /* tc_resources_steps() */
};

tc_resources *tc_resources_new(tc_pool *pool, uint64_t budget_bytes, const tc_ledger *ledger, GError **error) {
  tc_resources *r = calloc(1, sizeof *r);
  if (!r) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "renderer: out of memory");
    return NULL;
  }
  r->pool = pool;
  r->store = tc_store_new(budget_bytes, ledger, error);
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

static size_t held(const tc_resource_kind *kind, const void *thing, bool unfinished) {
  if (unfinished && kind->unfinished_held) return kind->unfinished_held(thing);
  return kind->held ? kind->held(thing) : kind->bytes(thing);
}

static tc_making making(const tc_resources *r, const tc_resource_kind *kind, const tc_frame_job *job) {
  const tc_stored *like = kind->is_like ? tc_store_latest(r->store, &kind->store, kind->is_like, job) : NULL;
  return (tc_making){job, like ? like->thing : NULL, r->pool, tc_store_budget(r->store)};
}

/* Reports the resource under construction; a paused build stays reported. */
static void tell(const tc_frame_job *job, int resource) {
  if (!job->building) return;
  if (atomic_load(&job->building->resource) != resource) atomic_store(&job->building->permille, 0);
  atomic_store(&job->building->resource, resource);
}

/* Starts a build and adds it to the store. */
static tc_stored *begin(tc_resources *r, const tc_resource_kind *kind, const tc_frame_job *job, const GByteArray *key,
                        GError **error) {
  const tc_making m = making(r, kind, job);
  const tc_volume *tied = kind->tied ? kind->tied(job) : NULL;
  void *thing = kind->begin(&m, error);
  if (!thing) return NULL;
  const bool unfinished = kind->go_on != NULL;
  const tc_stored wanted = {.kind = &kind->store, .key = key->data, .key_size = key->len, .thing = thing,
                            .bytes = held(kind, thing, unfinished), .unfinished = unfinished, .volume = tied ? tc_volume_serial(tied) : 0};
  tc_stored *it = tc_store_add(r->store, &wanted, error);
  r->steps += it != NULL;
  return it;
}

static bool go_on(tc_resources *r, const tc_resource_kind *kind, const tc_frame_job *job, tc_stored *it, GError **error) {
  if (kind->grows && !tc_store_grow(r->store, it, kind->grows(it->thing), error)) return false;
  const tc_making m = making(r, kind, job);
  const int64_t steps = kind->steps(it->thing);
  it->unfinished = !kind->go_on(it->thing, &m, error);
  r->steps += kind->steps(it->thing) != steps;
  if (!it->unfinished && kind->finish) it->thing = kind->finish(it->thing);
  tc_store_resize(r->store, it, held(kind, it->thing, it->unfinished));
  return !it->unfinished;
}

static bool is_whole(const tc_resource_kind *kind, const tc_stored *it, const tc_frame_job *job) {
  return kind->is_whole ? kind->is_whole(it->thing, job) : !it->unfinished;
}

/* True if a resource that this kind depends on is missing. */
static bool lacks(const tc_resource_kind *kind, const tc_frame_job *job) {
  for (int i = 0; i < TC_RESOURCE_COUNT; i++)
    if (kind->needs >> i & 1 && tc_plan_has(job->plan, (tc_resource)i) && !job->have.of[i]) return true;
  return false;
}

const void *tc_resources_get(tc_resources *r, tc_resource which, const tc_frame_job *job, double *ms, GError **error) {
  const tc_resource_kind *kind = &tc_resource_kinds[which];
  if (lacks(kind, job)) return NULL;
  GByteArray *key = g_byte_array_new();
  kind->key(job, key);
  tc_stored *it = tc_store_find(r->store, &kind->store, key->data, key->len);
  if (ms && (!it || !is_whole(kind, it, job))) {
    const double start = tc_now_ms();
    tell(job, (int)which + 1);
    if (!it) it = begin(r, kind, job, key, error);
    if (it && !is_whole(kind, it, job)) go_on(r, kind, job, it, error);
    const double took = tc_now_ms() - start;
    if (it && is_whole(kind, it, job)) tell(job, 0);
    if (it) it->ms += took;
    *ms += took;
  }
  if (it && kind->is_whole) it->unfinished = !is_whole(kind, it, job);
  g_byte_array_unref(key);
  return tc_store_use(r->store, it);
}

static bool is_it(const void *thing, const void *user) { return thing == user; }

static tc_stored *stored(const tc_resources *r, tc_resource which, const void *thing) {
  return tc_store_latest(r->store, &tc_resource_kinds[which].store, is_it, thing);
}

void tc_resources_took(tc_resources *r, tc_resource which, const void *thing, double ms) {
  stored(r, which, thing)->ms += ms;
}

double tc_resources_ms(const tc_resources *r, tc_resource which, const void *thing) {
  const tc_stored *it = stored(r, which, thing);
  return it ? it->ms : 0;
}

void tc_resources_refine(tc_resources *r, tc_resource which, const void *thing, bool begin) {
  const tc_resource_kind *kind = &tc_resource_kinds[which];
  tc_stored *it = stored(r, which, thing);
  const size_t bytes = kind->refines(thing);
  if (bytes && !begin) return;
  if (bytes && !tc_store_grow(r->store, it, bytes, NULL)) return; /* no memory: not refined */
  if (!kind->refine(it->thing) && !kind->refines(thing)) return; /* still running */
  tc_store_resize(r->store, it, held(kind, it->thing, false));
}

uint64_t tc_resources_forget(tc_resources *r, uint64_t volume_serial) {
  const tc_store_kind *kind = &tc_resource_kinds[TC_RESOURCE_COEFFICIENTS].store;
  const tc_stored *it = tc_store_find(r->store, kind, &volume_serial, sizeof volume_serial);
  const uint64_t coefficients = it && !it->unfinished ? tc_volume_serial(it->thing) : 0;
  if (coefficients) tc_store_forget(r->store, coefficients);
  tc_store_forget(r->store, volume_serial);
  return coefficients;
}

static bool has_mesh(const void *thing, const void *serial) {
  const tc_clusters *c = thing;
  for (size_t i = 0; i < c->n_parts; i++)
    if (c->parts[i].of.kind == TC_SURFACE_OF_MESH && c->parts[i].of.serial == *(const uint64_t *)serial) return true;
  return false;
}

void tc_resources_forget_mesh(tc_resources *r, uint64_t mesh_serial) {
  tc_store_drop(r->store, &tc_resource_kinds[TC_RESOURCE_MESH].store, has_mesh, &mesh_serial);
}

uint64_t tc_resources_held(const tc_resources *r) { return tc_store_held(r->store); }
void tc_resources_trim(tc_resources *r, uint64_t most_bytes) { tc_store_trim(r->store, most_bytes); }
