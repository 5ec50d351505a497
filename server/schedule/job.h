/* One picture (or plan) to make. Plain data that its owner fills; the scheduler takes it to its end. I/O thread only,
 * but for what says otherwise. */
#ifndef TCS_SCHEDULE_JOB_H
#define TCS_SCHEDULE_JOB_H

#include "renderer/quality/meter.h"
#include "renderer/quality/quality.h"
#include "server/loop/worker.h"
#include "server/memory/ledger.h"
#include "server/schedule/fair.h"
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

/* Made by tcs_job_new(), filled by its owner, freed by the scheduler after `finished`. */
typedef struct tcs_job tcs_job;
struct tcs_job {
  tcs_task task;
  tcs_server *server;
  bool plan_only;                 /* a plan instead of a picture */
  bool pick_only;                 /* what pixel pick.at shows instead of a picture (mode mesh) */
  tc_volume *volume;              /* owned reference */
  tc_volume *labels;              /* owned reference, or NULL */
  struct tc_mesh **meshes;        /* [scene.mesh.n_surfaces] owned references, or NULLs; NULL: none */
  tc_scene scene;                 /* owned copy */
  int width, height;              /* 0 = the scene's */
  tcs_class class;
  tc_interrupt interrupt;         /* any thread */
  tc_building building;           /* any thread: what its picture waits for */
  bool (*paused)(tcs_job *job);   /* a slice is over: shall it go on? May be NULL: yes */
  void (*rendered)(tcs_job *job); /* its encoding begins; may be NULL */
  void (*finished)(tcs_job *job); /* once: the results below are set */
  void *user;                     /* the owner's; NULL when the owner has left */
  void *part;                     /* the owner's: which of its pictures */
  char *peer;                     /* g_malloc'ed: who asks, of a single picture; freed with the job */
  uint64_t revision;              /* the owner's */
  double samples;                 /* the owner's: tc_estimate_samples() of it; 0 = not known */
  double thought_ms;              /* the owner's: what it is thought to take; 0 = not known */
  bool final;                     /* the owner's */
  bool hurry;                     /* the owner's: as in tc_render_request */
  bool moving;                    /* likewise */
  GArray *marks;                  /* the owner's; freed with the job; may be NULL */
  tcs_quality_used quality;       /* the owner's: the scene asks no more */
  int meter_pixels;               /* to be kept for the error meter; 0 = none */

  /* results */
  GError *error;
  GBytes *image;
  tc_explanation plan;
  tc_pick pick;
  tc_frame_stats stats;
  tc_meter *meter; /* the meter_pixels of the frame; NULL for none */
  int out_width, out_height;
  char shown[65]; /* id of the volume; "": nobody asks */
  int bridged; /* the layer of the volume that stands for a missing slice, from 1; 0: none */
  double queue_ms, encode_ms; /* queue_ms: until its first slice */

  /* the scheduler's */
  struct tcs_client *client; /* whose it is until it is rendered; NULL: gone */
  int64_t queued_us, slice_us; /* when it came; when its slice began */
  double slice_ms, used_ms;    /* of the renderer: the last slice, and all of them */
  int slices, stalls;          /* stalls: slices in a row that brought nothing */
  bool waiting; /* in its client's line */
  bool share;   /* its slice is what its class earned: a class before it does not cut it */
  bool overdue; /* cancelled because it took too long */
  tc_frame frame;
  uint64_t memory;        /* what the ledger has for its frame */
  uint64_t memory_wanted; /* what it did not have; 0: it had */
  tcs_ledger drawing;     /* of what drawing takes beside its frame */
  int asked;              /* how often others were asked to give memory back for it */
};

/* Takes a reference to `volume` and a copy of `scene`. */
tcs_job *tcs_job_new(tcs_server *server, tc_volume *volume, const tc_scene *scene);
void tcs_job_free(tcs_job *job); /* one that the scheduler does not have */
void tcs_meshes_free(struct tc_mesh **meshes, size_t n); /* an array as a job's; NULL is fine */
/* Some of its picture is drawn: it holds a frame's memory. */
bool tcs_job_begun(const tcs_job *job);

/* It is asked for words. */
static inline bool tcs_job_draws_nothing(const tcs_job *job) { return job->plan_only || job->pick_only; }

#endif
