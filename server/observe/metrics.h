/* Counters and histograms, written as Prometheus text. I/O thread only. */
#ifndef TCS_OBSERVE_METRICS_H
#define TCS_OBSERVE_METRICS_H

#include <glib.h>
#include <stdint.h>

#define TCS_HISTOGRAM_BUCKETS 12

/* Buckets from 0.5 ms to 2.5 s. In `error`: colour differences (0..1) from 1e-6 to 0.25; in `lag` and `turn_cpu`: from
 * 0.1 ms to 0.1 s. */
typedef struct tcs_histogram {
  uint64_t counts[TCS_HISTOGRAM_BUCKETS + 1]; /* per bucket, the last one is +Inf; not cumulative */
  double sum;
} tcs_histogram;

/* Per class of render jobs: interactive frames, single pictures, refinements. */
#define TCS_METRICS_CLASSES 3
typedef struct tcs_class_metrics {
  tcs_histogram queue;                /* wait before the first slice */
  double seconds;                     /* of render time */
  uint64_t slices, pauses, preempted; /* preempted: paused for a higher class */
} tcs_class_metrics;

typedef struct tcs_metrics {
  GHashTable *requests; /* route and code -> count */
  tcs_histogram request, render, tables, skip, encode, queue;
  tcs_class_metrics classes[TCS_METRICS_CLASSES]; /* in the order of schedule/fair.h */
  uint64_t frames_sent, frames_superseded, frames_cancelled, render_failures;
  uint64_t ws_sent_bytes, ws_messages, ws_errors, ws_connections;
  tcs_histogram error; /* rms error of frames, by the error meter */
  double meter_seconds;
  uint64_t meter_pixels, meter_cancelled, quality_measurements;
  tcs_histogram lag;               /* turns of the loop: from the return of epoll_wait() to the next call */
  tcs_histogram turn_cpu;          /* processor time of the turns */
  double lag_max, turn_cpu_max;    /* maxima over the turns since the last scrape */
  uint64_t patches, scene_changes; /* patches applied; changes of scenes (one for all patches of a turn) */
  uint64_t works_dropped;          /* cancelled by their clients before they began */
  uint64_t uploads, upload_bytes, volume_loads, volume_failures, volume_drops;
} tcs_metrics;

#define TCS_METRICS_MEMORY 12

/* Gauges, filled at a scrape. */
typedef struct tcs_gauges {
  int ws_clients, mjpeg_clients, sessions, volumes_resident, volumes_loading, meshes_resident, queued, probes, walks,
      texts;
  uint64_t volume_bytes;
  uint64_t memory_total; /* the budget */
  struct {
    const char *kind;
    uint64_t bytes;
  } memory[TCS_METRICS_MEMORY]; /* used bytes by kind; a NULL kind ends the list */
} tcs_gauges;

void tcs_metrics_init(tcs_metrics *metrics);
void tcs_metrics_clear(tcs_metrics *metrics);
/* `route` is the pattern from the route table, never a path. Static string. */
void tcs_metrics_request(tcs_metrics *metrics, const char *method, const char *route, int status, double seconds);
void tcs_histogram_add(tcs_histogram *histogram, double seconds);
void tcs_histogram_add_error(tcs_histogram *histogram, double rms);
/* One turn of the loop: its duration and its processor time. */
void tcs_metrics_turn(tcs_metrics *metrics, double seconds, double cpu_seconds);
/* Resident set size of the process, now. */
uint64_t tcs_metrics_resident_bytes(void);
/* g_malloc'ed text, format version 0.0.4. Resets the values that count since the last scrape. */
char *tcs_metrics_write(tcs_metrics *metrics, const tcs_gauges *gauges, const char *backend);

#endif
