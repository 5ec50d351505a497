#include "server/schedule/scheduler.h"

#include <limits.h>
#include <string.h>

#include "renderer/frame/cache.h"
#include "server/config/config.h"
#include "server/encode/encode.h"
#include "server/memory/budget.h"
#include "server/observe/log.h"
#include "server/observe/metrics.h"
#include "server/schedule/ladder.h"
#include "server/schedule/room.h"

G_STATIC_ASSERT(TCS_METRICS_CLASSES == TCS_CLASS_COUNT);

/* Pictures of a lane in encoding or queued for it: one more than the encoder works on, so that it never waits for the
 * renderer; further ones would only age. */
#define MAX_ENCODING 2
/* Interactive frames pause this often even if nobody waits, so that a badly misjudged frame can restart smaller. */
#define CHECK_US 100000
/* How long after the last contention between interactive clients their frames are kept to one slice. */
#define CONTENDED_US 500000
/* Share of a slice for an interactive frame, so that one that takes a little longer still fits. */
#define SLICE_SHARE 0.75
/* A picture is late above this multiple of its expected time; below, it is within the scatter of measurements. */
#define LATE 1.5
/* Each successive slice without progress doubles the next one, up to 2^this. A preparation ends after this many. */
#define MOST_STALLS 5
/* Unfinished pictures keep their frames; above this total only interactive frames may begin. */
#define MOST_HELD_BYTES ((size_t)256 << 20)
/* First guess for the cpu back end, for volumes of which about half is visible. */
#define THREAD_MS_PER_SAMPLE 2e-6
/* Attempts to free memory for one picture; most know their need at the first one. */
#define MOST_ASKED 4
/* Share of the renderer's cache up to which preparations begin. */
#define PREPARED_SHARE 0.5
#define MOST_SPARE_PIXELS ((size_t)4 << 20)

/* Interactive frames have their own encoder, so that they do not queue behind a large PNG. */
typedef enum lane { LANE_MOVING, LANE_STILL, LANE_COUNT } lane;

struct tcs_scheduler {
  tcs_server *server;
  tc_renderer *renderer; /* render thread only */
  const tc_renderer_info *about;
  tcs_encoder *encoders[LANE_COUNT]; /* each on its lane's thread only */
  int encoding[LANE_COUNT];
  tcs_fair *fair;
  GHashTable *singles, *preparations; /* of each peer: name -> tcs_client */
  int waiting, n_singles; /* queued jobs; single pictures among them */
  size_t held_bytes;      /* frames of unfinished, queued jobs */
  tcs_job *rendering;     /* on the render thread, or NULL */
  bool pumping;
  int64_t contended_us; /* when a client last waited during another client's interactive frame; 0 = never */
  GQueue frames;        /* tc_frame * with buffers to reuse */
  tc_quality_cost cost;
  tcs_ledger caches;    /* of the renderer's tables, coefficients and acceleration structures */
  double ms_per_sample; /* recent average, biased towards slow; 0 = none yet */
};

/* A task the calling thread waits for: at startup and shutdown only, when no loop runs. */
typedef struct owner_task {
  tcs_task task;
  tcs_scheduler *scheduler;
  tc_renderer_options options;
  GError *error;
  bool finished;
} owner_task;

static void mark_finished(tcs_task *task) { ((owner_task *)task)->finished = true; }

static void run_and_wait(owner_task *owner, tcs_worker *worker) {
  owner->task.done = mark_finished;
  GPollFD finished = {.fd = owner->scheduler->server->completions->event_fd, .events = G_IO_IN};
  tcs_worker_submit(worker, &owner->task);
  while (!owner->finished) {
    g_poll(&finished, 1, -1);
    tcs_completions_drain(owner->scheduler->server->completions);
  }
}

static void start_renderer(tcs_task *task) {
  owner_task *owner = (owner_task *)task;
  owner->scheduler->renderer = tc_renderer_new(&owner->options, &owner->error);
}

static void free_client(void *client) { tcs_client_free(client); }

static void stop_renderer(tcs_task *task) { tc_renderer_free(((owner_task *)task)->scheduler->renderer); }

tcs_scheduler *tcs_scheduler_new(tcs_server *server, GError **error) {
  tcs_scheduler *scheduler = g_new0(tcs_scheduler, 1);
  scheduler->server = server;
  tcs_ledger_init(&scheduler->caches, server->budget, TCS_MEMORY_CACHES);
  g_queue_init(&scheduler->frames);
  scheduler->fair = tcs_fair_new();
  scheduler->singles = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, free_client);
  scheduler->preparations = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, free_client);
  owner_task owner = {.task.run = start_renderer,
                      .scheduler = scheduler,
                      .options = {.backend = server->config->backend, .threads = server->config->threads,
                                  .cache_bytes = (uint64_t)server->config->limits.cache_bytes, .ledger = &scheduler->caches.ask,
                                  .levels = true}};
  run_and_wait(&owner, server->render_worker);
  for (int i = 0; i < LANE_COUNT && scheduler->renderer; i++)
    if (!owner.error) scheduler->encoders[i] = tcs_encoder_new(&owner.error);
  if (owner.error) {
    g_propagate_error(error, owner.error);
    tcs_scheduler_free(scheduler);
    return NULL;
  }
  scheduler->about = tc_renderer_about(scheduler->renderer);
  scheduler->cost = tc_quality_cost_of(scheduler->about->backend);
  return scheduler;
}

static void free_frame(void *item) {
  tc_frame_finish(item);
  g_free(item);
}

void tcs_scheduler_free(tcs_scheduler *scheduler) {
  if (!scheduler) return;
  if (scheduler->renderer) {
    owner_task owner = {.task.run = stop_renderer, .scheduler = scheduler};
    run_and_wait(&owner, scheduler->server->render_worker);
  }
  for (int i = 0; i < LANE_COUNT; i++)
    tcs_encoder_free(scheduler->encoders[i]);
  g_hash_table_destroy(scheduler->singles);
  g_hash_table_destroy(scheduler->preparations);
  tcs_fair_free(scheduler->fair);
  g_queue_clear_full(&scheduler->frames, free_frame);
  g_free(scheduler);
}

const tc_renderer_info *tcs_scheduler_about(const tcs_scheduler *scheduler) { return scheduler->about; }
tc_quality_cost *tcs_scheduler_cost(tcs_scheduler *scheduler) { return &scheduler->cost; }

double tcs_scheduler_ms_per_sample(const tcs_scheduler *scheduler) {
  return scheduler->ms_per_sample > 0 ? scheduler->ms_per_sample : THREAD_MS_PER_SAMPLE / scheduler->about->threads;
}

double tcs_scheduler_moving_ms(const tcs_scheduler *scheduler) {
  const bool contended = scheduler->contended_us && g_get_monotonic_time() - scheduler->contended_us < CONTENDED_US;
  return contended ? SLICE_SHARE * TCS_FAIR_MOVING_SLICE_MS : TCS_LADDER_TARGET_MS;
}

/* ---- the end of a job ---- */

static lane lane_of(const tcs_job *job) { return job->class == TCS_CLASS_INTERACTIVE ? LANE_MOVING : LANE_STILL; }

static void finish(tcs_job *job) {
  if (job->error && !job->prepare_only && !g_error_matches(job->error, TC_ERROR, TC_ERROR_CANCELLED)) {
    job->server->metrics->render_failures++;
    tcs_log(TCS_LOG_WARN, "render.failed", "code=%d", job->error->code);
  }
  job->client = NULL;
  job->finished(job);
  tcs_job_free(job);
}

/* Frame buffers circulate: render thread -> encode thread -> here -> render thread. */
static void lend_frame(tcs_scheduler *scheduler, tcs_job *job) {
  tc_frame *spare = g_queue_pop_head(&scheduler->frames);
  if (!spare) return;
  job->frame = *spare;
  job->memory = tc_frame_bytes(spare);
  g_free(spare);
}

static void return_frame(tcs_scheduler *scheduler, tcs_job *job) {
  const uint64_t kept = tc_frame_bytes(&job->frame);
  tc_frame_give_up(&job->frame);
  if (tc_frame_bytes(&job->frame) < kept) tcs_job_count_memory(job, tc_frame_bytes(&job->frame));
  const bool fits = job->frame.rgba && job->frame.capacity <= MOST_SPARE_PIXELS && !job->frame.linear;
  if (!fits || g_queue_get_length(&scheduler->frames) > MAX_ENCODING) return;
  g_queue_push_head(&scheduler->frames, g_memdup2(&job->frame, sizeof job->frame));
  job->memory -= MIN(job->memory, tc_frame_bytes(&job->frame)); /* moves with the frame */
  memset(&job->frame, 0, sizeof job->frame);
}

static void drop_spare_frames(tcs_scheduler *scheduler) {
  for (tc_frame *spare; (spare = g_queue_pop_head(&scheduler->frames)); free_frame(spare))
    tcs_budget_give(scheduler->server->budget, TCS_MEMORY_FRAMES, tc_frame_bytes(spare));
}

static void set_cancelled(tcs_job *job) {
  g_clear_error(&job->error);
  tc_set_error(&job->error, TC_ERROR_CANCELLED, NULL, "cancelled");
}

/* Shrinks the array, whose capacity is a power of two, to the size of the picture. */
static GBytes *take_picture(tcs_budget *budget, GByteArray *array) {
  const size_t size = array->len;
  return tcs_budget_bytes(budget, TCS_MEMORY_PICTURES, g_realloc(g_byte_array_free(array, FALSE), size), size);
}

static void run_encode(tcs_task *task) {
  tcs_job *job = (tcs_job *)task;
  if (atomic_load(&job->interrupt.cancel)) {
    set_cancelled(job);
    return;
  }
  GByteArray *bytes = g_byte_array_new();
  const int64_t began = g_get_monotonic_time();
  if (tcs_encode(job->server->scheduler->encoders[lane_of(job)], &job->frame, &job->scene, 0, bytes, &job->error))
    job->image = take_picture(job->server->budget, bytes);
  else
    g_byte_array_unref(bytes);
  tcs_job_count_memory(job, tc_frame_bytes(&job->frame));
  job->encode_ms = (double)(g_get_monotonic_time() - began) / 1000;
}

static void done_encode(tcs_task *task) {
  tcs_job *job = (tcs_job *)task;
  tcs_scheduler *scheduler = job->server->scheduler;
  scheduler->encoding[lane_of(job)]--;
  return_frame(scheduler, job);
  tcs_histogram_add(&job->server->metrics->encode, job->encode_ms / 1000);
  finish(job);
  tcs_scheduler_pump(scheduler);
}

/* Replaces "cancelled" by the reason. */
static void name_deadline(tcs_job *job) {
  g_clear_error(&job->error);
  tc_set_error(&job->error, TC_ERROR_LIMIT, NULL,
               "the picture takes longer than %" PRId64 " seconds; make it smaller or its steps larger",
               job->server->config->limits.render_seconds);
}

static void end_unfinished(tcs_scheduler *scheduler, tcs_job *job) {
  if (job->error && job->overdue) name_deadline(job);
  return_frame(scheduler, job);
  finish(job);
}

/* Running average: slower pictures count with weight 0.5, faster ones with 0.1, since a picture started too large is
 * late, but one started small grows later. */
static void learn_speed(tcs_scheduler *scheduler, const tcs_job *job) {
  if (!(job->samples > 0) || job->stats.stand_in) return;
  const double now = job->stats.render_ms / job->samples, old = scheduler->ms_per_sample;
  scheduler->ms_per_sample = old > 0 ? old + (now > old ? 0.5 : 0.1) * (now - old) : now;
}

static void begin_encoding(tcs_scheduler *scheduler, tcs_job *job) {
  tcs_metrics *metrics = job->server->metrics;
  job->client = NULL;
  tcs_histogram_add(&metrics->tables, job->stats.tables_ms / 1000);
  tcs_histogram_add(&metrics->skip, job->stats.skip_ms / 1000);
  tcs_histogram_add(&metrics->render, job->stats.render_ms / 1000);
  if (!job->stats.stand_in)
    tc_quality_cost_add(&scheduler->cost, &job->scene,
                        tc_estimate_pixels(job->volume, &job->scene, job->out_width, job->out_height),
                        job->stats.render_ms);
  learn_speed(scheduler, job);
  if (job->rendered) job->rendered(job);
  job->task.run = run_encode;
  job->task.done = done_encode;
  scheduler->encoding[lane_of(job)]++;
  tcs_worker_submit(lane_of(job) == LANE_MOVING ? job->server->encode_worker : job->server->still_worker, &job->task);
}

/* ---- the queue ---- */

static size_t held(const tcs_job *job) {
  return job->frame.capacity * 4 + job->frame.linear_capacity * sizeof(float) * 4;
}

static void count_in_line(tcs_scheduler *scheduler, const tcs_job *job, int change) {
  scheduler->waiting += change;
  if (job->class == TCS_CLASS_SINGLE) scheduler->n_singles += change;
  if (change > 0)
    scheduler->held_bytes += held(job);
  else
    scheduler->held_bytes -= held(job);
}

/* Cancels a queued job immediately. */
static void drop(tcs_scheduler *scheduler, tcs_job *job) {
  count_in_line(scheduler, job, -1);
  tcs_client_remove(job->client, job);
  set_cancelled(job);
  end_unfinished(scheduler, job);
}

void tcs_job_cancel(tcs_job *job) {
  atomic_store(&job->interrupt.cancel, true);
  if (job->waiting) drop(job->server->scheduler, job);
}

tcs_client *tcs_scheduler_join(tcs_scheduler *scheduler, const char *peer, tcs_client_next *next, void *user) {
  return tcs_client_new(scheduler->fair, peer, next, user);
}

void tcs_scheduler_leave(tcs_scheduler *scheduler, tcs_client *client) {
  if (scheduler->rendering && scheduler->rendering->client == client) scheduler->rendering->client = NULL;
  tcs_client_free(client);
}

/* The client of the job's peer in this table. */
static tcs_client *client_of(tcs_scheduler *scheduler, GHashTable *clients, const tcs_job *job) {
  const char *peer = job->peer ? job->peer : "";
  tcs_client *client = g_hash_table_lookup(clients, peer);
  if (client) return client;
  client = tcs_client_new(scheduler->fair, peer, NULL, NULL);
  g_hash_table_insert(clients, g_strdup(peer), client);
  return client;
}

static void push(tcs_scheduler *scheduler, tcs_client *client, tcs_job *job, tcs_class class) {
  job->class = class;
  tcs_client_push(client, job);
  count_in_line(scheduler, job, 1);
  tcs_scheduler_pump(scheduler);
}

bool tcs_scheduler_submit(tcs_scheduler *scheduler, tcs_job *job, GError **error) {
  const int64_t most = scheduler->server->config->limits.queue;
  tcs_client *client = client_of(scheduler, scheduler->singles, job);
  /* If other peers fill the queue, a peer's first picture is still accepted, up to twice the limit. */
  if (scheduler->n_singles >= (tcs_client_length(client) ? most : 2 * most)) {
    tc_set_error(error, TC_ERROR_BUSY, NULL, "too many pictures are waiting; try again in a moment");
    return false;
  }
  push(scheduler, client, job, TCS_CLASS_SINGLE);
  return true;
}

void tcs_scheduler_prepare(tcs_scheduler *scheduler, tcs_job *job) {
  job->prepare_only = true;
  push(scheduler, client_of(scheduler, scheduler->preparations, job), job, TCS_CLASS_REFINE);
}

/* ---- slices ---- */

/* Whether a preparation that has not begun finds much of the cache in use. */
static bool is_superfluous(const tcs_job *job) {
  const double most = PREPARED_SHARE * (double)job->server->config->limits.cache_bytes;
  return job->prepare_only && job->slices == 1 && (double)tc_renderer_cached(job->server->scheduler->renderer) > most;
}

static void run_slice(tcs_task *task) {
  tcs_job *job = (tcs_job *)task;
  tc_renderer *renderer = job->server->scheduler->renderer;
  if (atomic_load(&job->interrupt.cancel) || is_superfluous(job)) {
    set_cancelled(job);
    return;
  }
  const bool metered = job->meter_pixels > 0;
  const tc_render_request request = {
      .width = job->width, .height = job->height, .interrupt = &job->interrupt, .building = &job->building, .resume = job->slices > 1, .prepare = job->prepare_only,
      .ledger = &job->drawing.ask, .labels = job->labels, .meshes = job->meshes, .want_linear = metered, .want_depth = metered && tc_meter_wants_depth(&job->scene), .hurry = job->hurry, .moving = job->moving, .coarser_levels = job->coarser_levels};
  if (job->plan_only) {
    tc_renderer_explain(renderer, job->volume, &job->scene, &request, &job->plan, &job->error);
    return;
  }
  if (job->pick_only) {
    tc_renderer_pick(renderer, job->volume, &job->scene, &request, &job->pick, &job->error);
    return;
  }
  const bool made = tc_render(renderer, job->volume, &job->scene, &request, &job->frame, &job->error);
  job->stats = job->frame.stats;
  if (!made || job->prepare_only) return;
  job->out_width = job->frame.width;
  job->out_height = job->frame.height;
  if (!job->meter_pixels) return;
  job->meter = tc_meter_new(&job->frame, job->meter_pixels, job->revision);
  /* Five times the bytes of the picture, so only metered frames keep them. */
  g_clear_pointer(&job->frame.linear, free);
  g_clear_pointer(&job->frame.depth, free);
  job->frame.linear_capacity = job->frame.depth_capacity = 0;
}

static void counted_slice(tcs_job *job) {
  tcs_ledger *caches = &job->server->scheduler->caches;
  if (!tcs_job_take_memory(job)) return;
  tcs_ledger_init(&job->drawing, job->server->budget, TCS_MEMORY_FRAMES);
  tcs_ledger_begin(caches);
  run_slice(&job->task);
  tcs_ledger_end(&job->drawing); /* the part that the frame keeps is counted with the frame */
  const int64_t layers = atomic_load(&job->drawing.refused);
  tcs_job_refused(job, caches, atomic_load(&caches->refused));
  tcs_job_refused(job, &job->drawing, layers ? layers + atomic_load(&job->drawing.held_then) : 0);
  tcs_job_recount_memory(job);
}

static void timed_slice(tcs_task *task) {
  tcs_job *job = (tcs_job *)task;
  const int64_t began = g_get_monotonic_time();
  counted_slice(job);
  job->slice_ms = (double)(g_get_monotonic_time() - began) / 1000;
}

/* Sets the time at which the running slice pauses, from the jobs waiting. The renderer polls this time. */
static void set_pause(tcs_scheduler *scheduler, tcs_job *job) {
  const int doublings = job->prepare_only ? 0 : MIN(job->stalls, MOST_STALLS);
  const int64_t slice_us = (int64_t)(1000 * tcs_class_slice_ms(job->class)) << doublings;
  const tcs_pressure pressure = job->client ? tcs_client_pressure(job->client, job->class) : TCS_PRESSURE_SLICE;
  const bool moving = job->class == TCS_CLASS_INTERACTIVE;
  if (moving && tcs_fair_waiting(scheduler->fair, TCS_CLASS_INTERACTIVE))
    scheduler->contended_us = g_get_monotonic_time();
  int64_t until = moving ? job->slice_us + CHECK_US : LLONG_MAX;
  if (pressure == TCS_PRESSURE_NOW && !job->share && !job->stalls)
    until = MIN(atomic_load(&job->interrupt.pause_us), g_get_monotonic_time());
  else if (pressure != TCS_PRESSURE_NONE)
    until = job->slice_us + slice_us;
  atomic_store(&job->interrupt.pause_us, until);
}

static void put_back(tcs_scheduler *scheduler, tcs_job *job) {
  job->stalls = tc_frame_fruitless(&job->frame);
  tcs_client_put_back(job->client, job);
  count_in_line(scheduler, job, 1);
}

/* Whether to retry a job that was refused memory, after others free some (on the render thread, before the retry). Asks
 * for twice as much each time, since an evicted resource may be one that this picture needs. */
static bool try_again(tcs_scheduler *scheduler, tcs_job *job) {
  const uint64_t wanted = job->memory_wanted;
  job->memory_wanted = 0;
  if (!wanted || job->prepare_only || job->asked == MOST_ASKED || !job->client) return false;
  drop_spare_frames(scheduler);
  return tcs_budget_ask(scheduler->server->budget, wanted << job->asked++, job->volume);
}

/* Milliseconds of the last slice beyond the expected time. */
static double late_ms(const tcs_job *job) {
  return job->thought_ms > 0 ? CLAMP(job->used_ms - LATE * job->thought_ms, 0, job->slice_ms) : 0;
}

static void count_slice(tcs_scheduler *scheduler, const tcs_job *job, bool paused) {
  tcs_class_metrics *metrics = &scheduler->server->metrics->classes[job->class];
  metrics->seconds += job->slice_ms / 1000;
  metrics->slices++;
  if (!paused) return;
  metrics->pauses++;
  if (job->client && tcs_client_pressure(job->client, job->class) == TCS_PRESSURE_NOW) metrics->preempted++;
}

/* A preparation is worth no long slice: one that makes no progress in several usual ones is given up. */
static bool is_stuck(const tcs_job *job) {
  return job->prepare_only && tc_frame_fruitless(&job->frame) >= MOST_STALLS;
}

static void done_slice(tcs_task *task) {
  tcs_job *job = (tcs_job *)task;
  tcs_scheduler *scheduler = job->server->scheduler;
  bool paused = g_error_matches(job->error, TC_ERROR, TC_ERROR_PAUSED);
  scheduler->rendering = NULL;
  job->used_ms += job->slice_ms;
  if (job->client) tcs_client_charge(job->client, job->class, job->slice_ms, late_ms(job));
  count_slice(scheduler, job, paused);
  if (paused && job->used_ms >= (double)scheduler->server->config->limits.render_seconds * 1000) job->overdue = true;
  if (paused && (!job->client || job->overdue || atomic_load(&job->interrupt.cancel) || is_stuck(job) ||
                 (job->paused && !job->paused(job)))) {
    set_cancelled(job);
    paused = false;
  }
  if (paused || try_again(scheduler, job)) {
    g_clear_error(&job->error);
    put_back(scheduler, job);
  } else if (job->error || tcs_job_draws_nothing(job)) {
    end_unfinished(scheduler, job);
  } else {
    begin_encoding(scheduler, job);
  }
  tcs_scheduler_pump(scheduler);
}

/* Begun jobs always continue; new ones wait while the encoder is behind or unfinished frames hold too much memory. */
static bool may_begin(void *client, tcs_class class, void *user) {
  const tcs_scheduler *scheduler = user;
  const tcs_job *first = tcs_client_first(client, class);
  if (first && tcs_job_begun(first)) return true;
  if (class == TCS_CLASS_INTERACTIVE) return scheduler->encoding[LANE_MOVING] < MAX_ENCODING;
  return scheduler->encoding[LANE_STILL] < MAX_ENCODING && scheduler->held_bytes < MOST_HELD_BYTES;
}

static tcs_job *take_next(tcs_scheduler *scheduler) {
  tcs_fair_client *account;
  tcs_class class;
  while ((account = tcs_fair_pick(scheduler->fair, may_begin, scheduler, &class))) {
    tcs_client *client = tcs_fair_user(account);
    const bool in_line = tcs_client_first(client, class) != NULL;
    tcs_job *job = tcs_client_take(client, class);
    if (job && in_line) count_in_line(scheduler, job, -1);
    if (job) return job;
  }
  return NULL;
}

static void count_wait(tcs_metrics *metrics, const tcs_job *job) {
  tcs_histogram_add(&metrics->queue, job->queue_ms / 1000);
  tcs_histogram_add(&metrics->classes[job->class].queue, job->queue_ms / 1000);
}

static void begin_slice(tcs_scheduler *scheduler, tcs_job *job) {
  const int64_t now = g_get_monotonic_time();
  scheduler->rendering = job;
  if (!tcs_job_begun(job)) {
    lend_frame(scheduler, job);
    job->queue_ms = (double)(now - job->queued_us) / 1000;
    if (!job->prepare_only) count_wait(scheduler->server->metrics, job);
  }
  job->slices++;
  job->slice_us = now;
  job->share = tcs_client_pressure(job->client, job->class) == TCS_PRESSURE_NOW;
  atomic_store(&job->interrupt.pause_us, LLONG_MAX);
  set_pause(scheduler, job);
  job->task.run = timed_slice;
  job->task.done = done_slice;
  tcs_worker_submit(scheduler->server->render_worker, &job->task);
}

void tcs_scheduler_pump(tcs_scheduler *scheduler) {
  if (scheduler->pumping) return; /* re-entered from tcs_client_next */
  if (scheduler->rendering) {
    set_pause(scheduler, scheduler->rendering);
    return;
  }
  scheduler->pumping = true;
  tcs_job *job = take_next(scheduler);
  if (job) begin_slice(scheduler, job);
  scheduler->pumping = false;
}

/* Reduces the renderer's resources: those of a removed volume or mesh, or the least recently used. */
typedef struct trim {
  tcs_task task;
  tcs_scheduler *scheduler;
  tc_volume *volume;    /* or NULL */
  uint64_t mesh_serial; /* or 0 */
  uint64_t most_bytes;
} trim;

static void run_trim(tcs_task *task) {
  const trim *t = (trim *)task;
  tc_renderer *renderer = t->scheduler->renderer;
  if (t->volume)
    tc_renderer_forget(renderer, t->volume);
  else if (t->mesh_serial)
    tc_renderer_forget_mesh(renderer, t->mesh_serial);
  else
    tc_renderer_trim_cache(renderer, t->most_bytes);
  tc_volume_unref(t->volume); /* on this thread: the next picture may need the memory */
}

static void done_trim(tcs_task *task) { g_free(task); }

static void submit_trim(tcs_scheduler *scheduler, tc_volume *volume, uint64_t mesh_serial, uint64_t most_bytes) {
  trim *t = g_new0(trim, 1);
  *t = (trim){{.run = run_trim, .done = done_trim}, scheduler, volume, mesh_serial, most_bytes};
  tcs_worker_submit(scheduler->server->render_worker, &t->task);
}

void tcs_scheduler_forget(tcs_scheduler *scheduler, tc_volume *volume) {
  submit_trim(scheduler, tc_volume_ref(volume), 0, 0);
}

void tcs_scheduler_forget_mesh(tcs_scheduler *scheduler, uint64_t serial) { submit_trim(scheduler, NULL, serial, 0); }

void tcs_scheduler_trim_cache(tcs_scheduler *scheduler, uint64_t most_bytes) {
  submit_trim(scheduler, NULL, 0, most_bytes);
}

static gboolean is_forgotten(void *name, void *client, void *busy) {
  return client != busy && tcs_client_is_even(client);
}

void tcs_scheduler_tick(tcs_scheduler *scheduler, int64_t now_us) {
  tcs_job *job = scheduler->rendering;
  g_hash_table_foreach_remove(scheduler->singles, is_forgotten, job ? job->client : NULL);
  g_hash_table_foreach_remove(scheduler->preparations, is_forgotten, job ? job->client : NULL);
  if (!job) return;
  const double slice_ms = (double)(now_us - job->slice_us) / 1000;
  if (job->used_ms + slice_ms < (double)scheduler->server->config->limits.render_seconds * 1000) return;
  job->overdue = true;
  tcs_job_cancel(job);
}

int tcs_scheduler_waiting(const tcs_scheduler *scheduler) { return scheduler->n_singles; }

bool tcs_scheduler_idle(const tcs_scheduler *scheduler) {
  return !scheduler->rendering && !scheduler->encoding[LANE_MOVING] && !scheduler->encoding[LANE_STILL] &&
         scheduler->waiting == 0;
}
