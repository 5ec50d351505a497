/* A render job: one picture (or plan, or pick). Plain data filled by its owner; the scheduler runs it and frees it. I/O
 * thread only unless stated otherwise. */
#ifndef TCS_SCHEDULE_JOB_H
#define TCS_SCHEDULE_JOB_H

#include "renderer/quality/meter.h"
#include "renderer/quality/quality.h"
#include "server/loop/worker.h"
#include "server/memory/ledger.h"
#include "server/schedule/fair.h"
#include "server/server.h"

/* The choice of quality control for a scene's bound; all 0 if the scene sets none. */
typedef struct tcs_quality_used {
  bool for_time;   /* the bound is in milliseconds, else an error */
  double asked;    /* the bound */
  double expected; /* error or ms, like the bound; 0 before any measurement */
  double step;     /* the chosen step */
  bool holds;      /* the bound is expected to hold */
  int views;       /* measured views in the model of the error; -1: the choice needs none */
  char reason[TC_QUALITY_REASON];
} tcs_quality_used;

/* Made by tcs_job_new(), filled by its owner, freed by the scheduler after `finished`. */
typedef struct tcs_job tcs_job;
struct tcs_job {
  tcs_task task;
  tcs_server *server;
  bool plan_only;                 /* explain the plan, draw nothing */
  bool pick_only;                 /* pick at pixel pick.at (mode mesh), draw nothing */
  bool prepare_only;              /* build what the picture reads, draw nothing; a failure is not reported */
  tc_volume *volume;              /* owned reference */
  tc_volume *labels;              /* owned reference, or NULL */
  struct tc_mesh **meshes;        /* [scene.mesh.n_surfaces] owned references or NULLs; NULL: no meshes */
  tc_scene scene;                 /* owned copy */
  int width, height;              /* 0 = the scene's */
  tcs_class class;
  tc_interrupt interrupt;         /* any thread */
  tc_building building;           /* progress of the resource being built; readable from any thread */
  bool (*paused)(tcs_job *job);   /* after a slice: whether to continue; NULL: always */
  void (*rendered)(tcs_job *job); /* drawn, about to be encoded; may be NULL */
  void (*finished)(tcs_job *job); /* called once, with the results below set */
  void *user;                     /* the owner's; NULL after the owner has left */
  void *part;                     /* the owner's: the view of the picture */
  char *peer;                     /* peer of a single picture or a preparation; g_malloc'ed, freed with the job */
  uint64_t revision;              /* the owner's */
  double samples;                 /* the owner's: tc_estimate_samples() of the picture; 0 = unknown */
  double thought_ms;              /* the owner's: expected render time; 0 = unknown */
  bool final;                     /* the owner's */
  bool hurry;                     /* the owner's: as in tc_render_request */
  bool moving;                    /* the owner's: as in tc_render_request, as is what follows */
  int coarser_levels;
  GArray *marks;                  /* the owner's; freed with the job; may be NULL */
  tcs_quality_used quality;       /* the owner's: the choice that is already in the scene */
  int meter_pixels;               /* pixels to keep for the error meter; 0 = none */

  /* results */
  GError *error;
  GBytes *image;
  tc_explanation plan;
  tc_pick pick;
  tc_frame_stats stats;
  tc_meter *meter; /* of meter_pixels pixels of the frame; NULL: none */
  int out_width, out_height;
  char shown[65];             /* id of the volume; "": not needed */
  int bridged;                /* layer of the volume interpolated for a missing slice, from 1; 0: none */
  double queue_ms, encode_ms; /* queue_ms: until its first slice */

  /* owned by the scheduler: */
  struct tcs_client *client;   /* until the job is rendered; NULL: the client has left */
  int64_t queued_us, slice_us; /* submitted; begin of the current slice */
  double slice_ms, used_ms;    /* render time: of the last slice, of all slices */
  int slices, stalls;          /* stalls: successive slices without progress */
  bool waiting;                /* in its client's queue */
  bool share;                  /* the slice was earned by its class: higher classes do not preempt it */
  bool overdue;                /* cancelled for exceeding the time limit */
  tc_frame frame;
  uint64_t memory;        /* bytes reserved for its frame */
  uint64_t memory_wanted; /* bytes refused; 0: none */
  tcs_ledger drawing;     /* memory taken while drawing, besides the frame */
  int asked;              /* how often others were asked to free memory for it */
};

/* Takes a reference to `volume` and a copy of `scene`. */
tcs_job *tcs_job_new(tcs_server *server, tc_volume *volume, const tc_scene *scene);
void tcs_job_free(tcs_job *job);                         /* a job that was not submitted */
void tcs_meshes_free(struct tc_mesh **meshes, size_t n); /* an array like tcs_job.meshes; NULL is fine */
/* Whether a slice has run, so that the job holds a frame. */
bool tcs_job_begun(const tcs_job *job);

/* Whether the result is no picture. */
static inline bool tcs_job_draws_nothing(const tcs_job *job) {
  return job->plan_only || job->pick_only || job->prepare_only;
}

#endif
