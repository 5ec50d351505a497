/* Who renders next. One picture renders while another is encoded; the two kinds of work, viewers of sessions and
 * single requests, take turns, and each kind is served round-robin. I/O thread only. */
#ifndef TCS_SCHEDULE_SCHEDULER_H
#define TCS_SCHEDULE_SCHEDULER_H

#include "renderer/quality/cost.h"
#include "renderer/quality/meter.h"
#include "renderer/quality/quality.h"
#include "server/loop/worker.h"
#include "server/server.h"

/* What quality control made of a scene's bound; all 0 where none was asked. */
typedef struct tcs_quality_used {
  bool for_time;   /* the bound is milliseconds, else an error */
  double asked;    /* the bound */
  double expected; /* error or ms, as the bound; 0 before anything was measured */
  double step;     /* chosen */
  bool holds;      /* the bound is expected to hold */
  int views;       /* measured for the model of the error; -1: the choice needs none */
  char reason[TC_QUALITY_REASON];
} tcs_quality_used;

/* One picture (or plan) to make. Made by tcs_job_new(), filled by its owner, freed by the scheduler after `finished`.
 */
typedef struct tcs_job tcs_job;
struct tcs_job {
  tcs_task task;
  tcs_server *server;
  bool plan_only;                 /* a plan instead of a picture */
  tc_volume *volume;              /* owned reference */
  tc_volume *labels;              /* owned reference, or NULL */
  tc_scene scene;                 /* owned copy */
  int width, height;              /* 0 = the scene's */
  tc_interrupt interrupt;         /* any thread */
  void (*rendered)(tcs_job *job); /* I/O thread: its encoding begins; may be NULL */
  void (*finished)(tcs_job *job); /* I/O thread, once: the results below are set */
  void *user;                     /* the owner's; NULL when the owner has left */
  uint64_t revision;              /* the owner's */
  bool final;                     /* the owner's */
  bool hurry;                     /* the owner's: as in tc_render_request */
  GArray *marks;                  /* the owner's; freed with the job; may be NULL */
  tcs_quality_used quality;       /* the owner's: the scene asks no more */
  int meter_pixels;               /* to be kept for the error meter; 0 = none */

  /* results */
  GError *error;
  GBytes *image;
  tc_plan plan;
  tc_frame_stats stats;
  tc_meter *meter; /* the meter_pixels of the frame; NULL for none */
  int out_width, out_height;
  double queue_ms, encode_ms;

  /* the scheduler's */
  int64_t queued_us;
  bool overdue; /* cancelled because it took too long */
  tc_frame frame;
};

/* Takes a reference to `volume` and a copy of `scene`. */
tcs_job *tcs_job_new(tcs_server *server, tc_volume *volume, const tc_scene *scene);

/* Starts the renderer on its thread and waits for it. */
tcs_scheduler *tcs_scheduler_new(tcs_server *server, GError **error);
/* Frees the renderer on its thread. Nothing may be queued or under way any more. */
void tcs_scheduler_free(tcs_scheduler *scheduler);
const tc_renderer_info *tcs_scheduler_about(const tcs_scheduler *scheduler);
/* Of all frames so far: for single pictures, and where a session begins. The scheduler's. */
tc_quality_cost *tcs_scheduler_cost(tcs_scheduler *scheduler);

/* Queues a single request. TC_ERROR_BUSY when too many wait: the job stays the caller's. */
bool tcs_scheduler_submit(tcs_scheduler *scheduler, tcs_job *job, GError **error);
/* Where viewers' work comes from: gives the next job of theirs, or NULL. */
void tcs_scheduler_set_stream(tcs_scheduler *scheduler, tcs_job *(*next)(void *user), void *user);
/* Starts what can start. Call after anything changed. */
void tcs_scheduler_pump(tcs_scheduler *scheduler);
/* Tells the job to stop soon; `finished` comes as ever. */
void tcs_job_cancel(tcs_job *job);
/* Drops the renderer's resources of a volume that goes away. */
void tcs_scheduler_forget(tcs_scheduler *scheduler, tc_volume *volume);
/* Gives up a picture that takes longer than the configured time: others wait for the renderer. About once a second. */
void tcs_scheduler_tick(tcs_scheduler *scheduler, int64_t now_us);
int tcs_scheduler_waiting(const tcs_scheduler *scheduler);
/* Nothing is queued, rendering or being encoded. */
bool tcs_scheduler_idle(const tcs_scheduler *scheduler);

void tcs_job_free(tcs_job *job); /* a job that was not submitted */

#endif
