/* Any bytes as an uploaded file, through the spool and the catalogue's queue with a small budget: it becomes a resident
 * volume or a failed one with one line of reason, and afterwards nothing is left, in the ledger or in the spool. What
 * looks like DICOM is left out: it is read by a program of its own (fuzz_dicom.c). */
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "renderer/import/helper.h"
#include "server/catalogue/catalogue.h"
#include "server/catalogue/spool.h"
#include "server/config/config.h"
#include "server/loop/worker.h"
#include "server/memory/budget.h"
#include "server/schedule/scheduler.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

/* An import that takes longer than a second is given up, and so is no input longer than five. */
enum { budget_bytes = 4 << 20, voxel_budget = 2 << 20, seconds = 1 };

static tcs_config config;
static tcs_metrics metrics;
static tcs_completions completions;
static tcs_server server;
static char spool[] = "/tmp/tc-fuzz-spool-XXXXXX";

static void end(void) {
  tcs_catalogue_cancel_all(server.catalogue);
  tcs_worker_free(server.load_worker);
  tcs_worker_free(g_steal_pointer(&server.spool_worker));
  tcs_completions_drain(&completions);
  tcs_scheduler_free(server.scheduler);
  tcs_worker_free(server.render_worker);
  tcs_completions_drain(&completions);
  tcs_catalogue_free(server.catalogue);
  tcs_spool_free(server.spool);
  tcs_budget_free(server.budget);
  tcs_completions_finish(&completions);
  tcs_metrics_clear(&metrics);
  tcs_config_clear(&config);
  rmdir(spool);
}

static void begin(void) {
  if (server.catalogue) return;
  GError *error = NULL;
  if (!mkdtemp(spool)) abort();
  tcs_config_init(&config);
  tcs_log_set_level(TCS_LOG_ERROR);
  g_free(config.spool);
  config.spool = g_strdup(spool);
  config.backend = TC_BACKEND_CPU;
  config.threads = 1;
  config.limits.memory_bytes = budget_bytes;
  config.limits.volume_bytes = voxel_budget;
  config.limits.import_seconds = seconds;
  tcs_config_settle(&config);
  tcs_metrics_init(&metrics);
  if (!tcs_completions_init(&completions, &error)) abort();
  server = (tcs_server){.config = &config, .metrics = &metrics, .completions = &completions};
  server.budget = tcs_budget_new(budget_bytes, voxel_budget);
  server.render_worker = tcs_worker_new("render", 1, TCS_PRIORITY_PICTURE, &completions, &error);
  server.load_worker = tcs_worker_new("load", 1, TCS_PRIORITY_PICTURE, &completions, &error);
  server.spool_worker = tcs_worker_new("spool", 1, TCS_PRIORITY_PICTURE, &completions, &error);
  server.spool = tcs_spool_new(&server);
  server.scheduler = tcs_scheduler_new(&server, &error);
  server.catalogue = tcs_catalogue_new(&server);
  if (error || !server.scheduler) abort();
  atexit(end);
}

static void drain_until(bool (*over)(void)) {
  for (int64_t until = g_get_monotonic_time() + (seconds + 60) * 1000000; !over();) {
    if (g_get_monotonic_time() > until) abort();
    tcs_completions_drain(&completions);
    tcs_catalogue_tick(server.catalogue, g_get_monotonic_time());
    sched_yield();
  }
}

static bool has_settled(void) { return tcs_catalogue_find(server.catalogue, TCS_KIND_VOLUME, "v")->state != TCS_LOADING; }

static bool is_empty(void) {
  for (int kind = TCS_MEMORY_VOLUMES; kind <= TCS_MEMORY_PINNED; kind++)
    if (tcs_budget_used(server.budget, (tcs_memory_kind)kind)) return false;
  return true;
}

/* `told`: the file itself has the spool's name, and its words may be quoted. */
static void check(const tcs_entry *entry, bool told) {
  if (entry->state == TCS_FAILED) {
    if (!entry->reason || !*entry->reason || strpbrk(entry->reason, "\r\n")) abort();
    if (!told && strstr(entry->reason, spool)) abort();
    return;
  }
  const tc_volume_stats *stats = tc_volume_statistics(entry->volume);
  if (!(stats->min <= stats->max) || tc_volume_bytes(entry->volume) > voxel_budget) abort();
  if (tcs_budget_used(server.budget, TCS_MEMORY_VOLUMES) < tc_volume_bytes(entry->volume)) abort();
  if (tcs_budget_used(server.budget, TCS_MEMORY_VOLUMES) > voxel_budget) abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  GError *error = NULL;
  begin();
  tcs_spooled *file = tcs_spool_open(server.spool, "fuzz", &error);
  if (!file || !tcs_spooled_grow(file, (int64_t)size, &error)) abort();
  if (size && write(file->fd, bytes, size) != (ssize_t)size) abort();
  tcs_spooled_complete(file);
  if (tc_helper_for(file->path) == TC_HELPER_DICOM) {
    tcs_spooled_free(file);
  } else {
    tcs_source_file source = {.path = g_strdup(file->path), .name = "the upload", .upload = file, .client = "fuzz"};
    tcs_entry *entry = tcs_catalogue_load(server.catalogue, TCS_KIND_VOLUME, "v", &source, &error);
    if (!entry) abort();
    drain_until(has_settled);
    check(entry, size && memmem(bytes, size, "tc-fuzz", 7));
    tcs_catalogue_remove(server.catalogue, entry);
  }
  drain_until(is_empty);
  return 0;
}
