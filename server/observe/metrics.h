/* Counters and histograms, written as Prometheus text. All of it belongs to the I/O thread. */
#ifndef TCS_OBSERVE_METRICS_H
#define TCS_OBSERVE_METRICS_H

#include <glib.h>
#include <stdint.h>

#define TCS_HISTOGRAM_BUCKETS 12

/* Seconds, in buckets from 0.5 ms to 2.5 s; of `error`: differences of colour 0..1, from 1e-6 to 0.25; of `lag`:
 * seconds from 0.1 ms to 0.1 s. */
typedef struct tcs_histogram {
  uint64_t counts[TCS_HISTOGRAM_BUCKETS + 1]; /* per bucket, the last one is +Inf; not cumulative */
  double sum;
} tcs_histogram;

/* Of what the renderer does: interactive frames, single pictures, refinements. */
#define TCS_METRICS_CLASSES 3
typedef struct tcs_class_metrics {
  tcs_histogram queue;                /* until a picture was begun */
  double seconds;                     /* of the renderer */
  uint64_t slices, pauses, preempted; /* preempted: paused for a class before it */
} tcs_class_metrics;

typedef struct tcs_metrics {
  GHashTable *requests; /* route and code -> count */
  tcs_histogram request, render, tables, skip, encode, queue;
  tcs_class_metrics classes[TCS_METRICS_CLASSES]; /* in the order of schedule/fair.h */
  uint64_t frames_sent, frames_superseded, frames_cancelled, render_failures;
  uint64_t ws_sent_bytes, ws_messages, ws_errors, ws_connections;
  tcs_histogram error; /* rms of frames, as the error meter found it */
  double meter_seconds;
  uint64_t meter_pixels, meter_cancelled, quality_measurements;
  tcs_histogram lag;               /* turns of the loop: from its wake-up to its return to waiting */
  tcs_histogram turn_cpu;          /* of them: when it had a processor */
  double lag_max, turn_cpu_max;    /* since the last scrape: the longest turn, and the most processor time in one */
  uint64_t patches, scene_changes; /* patches laid on scenes; changes that came of them: one for all of a turn */
  uint64_t works_dropped;          /* left by their clients before they began */
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
  } memory[TCS_METRICS_MEMORY]; /* what is used of it, by whom; NULL ends it early */
} tcs_gauges;

void tcs_metrics_init(tcs_metrics *metrics);
void tcs_metrics_clear(tcs_metrics *metrics);
/* `route` is a pattern of the route table, never a path. Static string. */
void tcs_metrics_request(tcs_metrics *metrics, const char *method, const char *route, int status, double seconds);
void tcs_histogram_add(tcs_histogram *histogram, double seconds);
void tcs_histogram_add_error(tcs_histogram *histogram, double rms);
/* One turn of the loop: how long it took, and how much of that it had a processor. */
void tcs_metrics_turn(tcs_metrics *metrics, double seconds, double cpu_seconds);
/* Resident set size of the process, now. */
uint64_t tcs_metrics_resident_bytes(void);
/* g_malloc'ed text, format version 0.0.4. What counts since the last scrape begins anew. */
char *tcs_metrics_write(tcs_metrics *metrics, const tcs_gauges *gauges, const char *backend);

#endif
