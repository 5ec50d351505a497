#include "server/schedule/scheduler.h"

#include <stdlib.h>
#include <string.h>

#include "server/config/config.h"
#include "server/encode/encode.h"
#include "server/observe/log.h"
#include "server/observe/metrics.h"

/* Pictures being encoded or waiting for it. One more than the encoder works on, so that it never waits for the
 * renderer; more would only age. */
#define MAX_ENCODING 2

struct tcs_scheduler {
  tcs_server *server;
  tc_renderer *renderer; /* touched by the render thread only */
  const tc_renderer_info *about;
  tcs_encoder *encoder; /* touched by the encode thread only */
  tcs_task_list singles;
  int n_singles;
  tcs_job *rendering;   /* on the render thread, or NULL */
  int64_t rendering_us; /* since when */
  int encoding;
  bool single_turn; /* whose turn it is when both kinds of work wait */
  tcs_job *(*next_stream)(void *user);
  void *stream_user;
  GQueue frames; /* tc_frame * with buffers to use again */
  tc_quality_cost cost;
};

/* A task that the starting thread waits for: only at start and end, when there is no loop yet or any more. */
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
  tcs_worker_submit(worker, &owner->task);
  while (!owner->finished) {
    g_usleep(500);
    tcs_completions_drain(owner->scheduler->server->completions);
  }
}

static void start_renderer(tcs_task *task) {
  owner_task *owner = (owner_task *)task;
  owner->scheduler->renderer = tc_renderer_new(&owner->options, &owner->error);
}

static void stop_renderer(tcs_task *task) { tc_renderer_free(((owner_task *)task)->scheduler->renderer); }

tcs_scheduler *tcs_scheduler_new(tcs_server *server, GError **error) {
  tcs_scheduler *scheduler = g_new0(tcs_scheduler, 1);
  scheduler->server = server;
  g_queue_init(&scheduler->frames);
  owner_task owner = {.task.run = start_renderer,
                      .scheduler = scheduler,
                      .options = {.backend = server->config->backend, .threads = server->config->threads}};
  run_and_wait(&owner, server->render_worker);
  if (scheduler->renderer) scheduler->encoder = tcs_encoder_new(&owner.error);
  if (!scheduler->encoder) {
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
  tcs_encoder_free(scheduler->encoder);
  g_queue_clear_full(&scheduler->frames, free_frame);
  g_free(scheduler);
}

const tc_renderer_info *tcs_scheduler_about(const tcs_scheduler *scheduler) { return scheduler->about; }
tc_quality_cost *tcs_scheduler_cost(tcs_scheduler *scheduler) { return &scheduler->cost; }

void tcs_scheduler_set_stream(tcs_scheduler *scheduler, tcs_job *(*next)(void *user), void *user) {
  scheduler->next_stream = next;
  scheduler->stream_user = user;
}

tcs_job *tcs_job_new(tcs_server *server, tc_volume *volume, const tc_scene *scene) {
  tcs_job *job = g_new0(tcs_job, 1);
  job->server = server;
  job->volume = tc_volume_ref(volume);
  tc_scene_copy(&job->scene, scene);
  tc_interrupt_init(&job->interrupt);
  job->queued_us = g_get_monotonic_time();
  return job;
}

void tcs_job_free(tcs_job *job) {
  tc_volume_unref(job->volume);
  tc_volume_unref(job->labels);
  tc_scene_clear(&job->scene);
  tc_frame_finish(&job->frame);
  g_clear_error(&job->error);
  if (job->image) g_bytes_unref(job->image);
  if (job->marks) g_array_unref(job->marks);
  tc_meter_free(job->meter);
  g_free(job);
}

void tcs_job_cancel(tcs_job *job) { atomic_store(&job->interrupt.cancel, true); }

static void finish(tcs_job *job) {
  if (job->error && !g_error_matches(job->error, TC_ERROR, TC_ERROR_CANCELLED)) {
    job->server->metrics->render_failures++;
    tcs_log(TCS_LOG_WARN, "render.failed", "code=%d", job->error->code);
  }
  job->finished(job);
  tcs_job_free(job);
}

/* Frame buffers go round: render thread -> encode thread -> here -> render thread. */
static void lend_frame(tcs_scheduler *scheduler, tcs_job *job) {
  tc_frame *spare = g_queue_pop_head(&scheduler->frames);
  if (!spare) return;
  job->frame = *spare;
  g_free(spare);
}

static void return_frame(tcs_scheduler *scheduler, tcs_job *job) {
  if (job->frame.rgba && g_queue_get_length(&scheduler->frames) < MAX_ENCODING + 1) {
    g_queue_push_head(&scheduler->frames, g_memdup2(&job->frame, sizeof job->frame));
    memset(&job->frame, 0, sizeof job->frame);
  }
}

static void run_encode(tcs_task *task) {
  tcs_job *job = (tcs_job *)task;
  GByteArray *bytes = g_byte_array_new();
  const int64_t began = g_get_monotonic_time();
  if (tcs_encode(job->server->scheduler->encoder, &job->frame, &job->scene, 0, bytes, &job->error))
    job->image = g_byte_array_free_to_bytes(bytes);
  else
    g_byte_array_unref(bytes);
  job->encode_ms = (double)(g_get_monotonic_time() - began) / 1000;
}

static void done_encode(tcs_task *task) {
  tcs_job *job = (tcs_job *)task;
  tcs_scheduler *scheduler = job->server->scheduler;
  scheduler->encoding--;
  return_frame(scheduler, job);
  tcs_histogram_add(&job->server->metrics->encode, job->encode_ms / 1000);
  finish(job);
  tcs_scheduler_pump(scheduler);
}

static void run_render(tcs_task *task) {
  tcs_job *job = (tcs_job *)task;
  tc_renderer *renderer = job->server->scheduler->renderer;
  job->queue_ms = (double)(g_get_monotonic_time() - job->queued_us) / 1000;
  if (atomic_load(&job->interrupt.cancel)) {
    tc_set_error(&job->error, TC_ERROR_CANCELLED, NULL, "cancelled");
    return;
  }
  if (job->plan_only) {
    tc_renderer_plan(renderer, job->volume, job->labels, &job->scene, &job->plan, &job->error);
    return;
  }
  const tc_render_request request = {
      .width = job->width, .height = job->height, .interrupt = &job->interrupt, .labels = job->labels,
      .want_linear = job->meter_pixels > 0, .hurry = job->hurry};
  if (!tc_render(renderer, job->volume, &job->scene, &request, &job->frame, NULL, &job->error)) return;
  job->stats = job->frame.stats;
  job->out_width = job->frame.width;
  job->out_height = job->frame.height;
  if (!job->meter_pixels) return;
  job->meter = tc_meter_new(&job->frame, job->meter_pixels, job->revision);
  /* Four times the picture's bytes: not kept for frames that do not ask. */
  g_clear_pointer(&job->frame.linear, free);
  job->frame.linear_capacity = 0;
}

/* "Cancelled" would be true and no help. */
static void name_deadline(tcs_job *job) {
  g_clear_error(&job->error);
  tc_set_error(&job->error, TC_ERROR_LIMIT, NULL,
               "the picture takes longer than %" PRId64 " seconds; make it smaller or its steps larger",
               job->server->config->limits.render_seconds);
}

static void done_render(tcs_task *task) {
  tcs_job *job = (tcs_job *)task;
  tcs_scheduler *scheduler = job->server->scheduler;
  scheduler->rendering = NULL;
  if (job->error && job->overdue) name_deadline(job);
  if (job->error || job->plan_only) {
    return_frame(scheduler, job);
    finish(job);
  } else {
    tcs_metrics *metrics = job->server->metrics;
    tcs_histogram_add(&metrics->queue, job->queue_ms / 1000);
    tcs_histogram_add(&metrics->tables, job->stats.tables_ms / 1000);
    tcs_histogram_add(&metrics->skip, job->stats.skip_ms / 1000);
    tcs_histogram_add(&metrics->render, job->stats.render_ms / 1000);
    if (!job->stats.stand_in)
      tc_quality_cost_add(&scheduler->cost, &job->scene, (double)job->out_width * job->out_height,
                        job->stats.render_ms);
    if (job->rendered) job->rendered(job);
    job->task.run = run_encode;
    job->task.done = done_encode;
    scheduler->encoding++;
    tcs_worker_submit(job->server->encode_worker, &job->task);
  }
  tcs_scheduler_pump(scheduler);
}

static tcs_job *pick_single(tcs_scheduler *scheduler) {
  tcs_job *job = (tcs_job *)tcs_task_list_pop(&scheduler->singles);
  if (job) scheduler->n_singles--;
  return job;
}

/* The two kinds take turns; the one whose turn it is passes when it has nothing. */
static tcs_job *pick(tcs_scheduler *scheduler) {
  for (int attempt = 0; attempt < 2; attempt++) {
    const bool single = scheduler->single_turn;
    scheduler->single_turn = !single;
    tcs_job *job = single ? pick_single(scheduler) : NULL;
    if (!single && scheduler->next_stream) job = scheduler->next_stream(scheduler->stream_user);
    if (job) return job;
  }
  return NULL;
}

void tcs_scheduler_pump(tcs_scheduler *scheduler) {
  if (scheduler->rendering || scheduler->encoding >= MAX_ENCODING) return;
  tcs_job *job = pick(scheduler);
  if (!job) return;
  scheduler->rendering = job;
  scheduler->rendering_us = g_get_monotonic_time();
  lend_frame(scheduler, job);
  job->task.run = run_render;
  job->task.done = done_render;
  tcs_worker_submit(scheduler->server->render_worker, &job->task);
}

bool tcs_scheduler_submit(tcs_scheduler *scheduler, tcs_job *job, GError **error) {
  if (scheduler->n_singles >= scheduler->server->config->limits.queue) {
    tc_set_error(error, TC_ERROR_BUSY, NULL, "too many pictures are waiting; try again in a moment");
    return false;
  }
  scheduler->n_singles++;
  tcs_task_list_push(&scheduler->singles, &job->task);
  tcs_scheduler_pump(scheduler);
  return true;
}

typedef struct forget_task {
  tcs_task task;
  tcs_scheduler *scheduler;
  tc_volume *volume;
} forget_task;

static void run_forget(tcs_task *task) {
  forget_task *forget = (forget_task *)task;
  tc_renderer_forget(forget->scheduler->renderer, forget->volume);
}

static void done_forget(tcs_task *task) {
  tc_volume_unref(((forget_task *)task)->volume);
  g_free(task);
}

void tcs_scheduler_forget(tcs_scheduler *scheduler, tc_volume *volume) {
  forget_task *forget = g_new0(forget_task, 1);
  *forget = (forget_task){{.run = run_forget, .done = done_forget}, scheduler, tc_volume_ref(volume)};
  tcs_worker_submit(scheduler->server->render_worker, &forget->task);
}

void tcs_scheduler_tick(tcs_scheduler *scheduler, int64_t now_us) {
  tcs_job *job = scheduler->rendering;
  if (!job || now_us - scheduler->rendering_us < scheduler->server->config->limits.render_seconds * 1000000) return;
  job->overdue = true;
  tcs_job_cancel(job);
}

int tcs_scheduler_waiting(const tcs_scheduler *scheduler) { return scheduler->n_singles; }

bool tcs_scheduler_idle(const tcs_scheduler *scheduler) {
  return !scheduler->rendering && scheduler->encoding == 0 && scheduler->n_singles == 0;
}
