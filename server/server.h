/* The daemon's parts, tied together by cli/serve.c. Everything here belongs to the I/O thread; only tasks (worker.h)
 * travel to other threads. */
#ifndef TCS_SERVER_H
#define TCS_SERVER_H

#include "renderer/quality/cost.h"
#include "server/cli/config.h"
#include "server/http/loop.h"
#include "server/observe/metrics.h"
#include "server/schedule/worker.h"

typedef struct tcs_catalogue tcs_catalogue;
typedef struct tcs_scheduler tcs_scheduler;
typedef struct tcs_sessions tcs_sessions;
typedef struct tcs_http tcs_http;
typedef struct tcs_quality tcs_quality;

typedef struct tcs_server {
  const tcs_config *config;
  tcs_loop *loop;
  tcs_completions completions;
  tcs_worker *render_worker; /* one thread: owns the renderer */
  tcs_worker *encode_worker; /* one thread: owns the encoder */
  tcs_worker *load_worker;   /* imports */
  tcs_worker *walk_worker;   /* folder scans, histograms: not behind a long import */
  tcs_worker *meter_worker;  /* one thread, of low priority: the error meter */
  tcs_worker *quality_worker; /* likewise: models for quality control */
  tcs_catalogue *catalogue;
  tcs_scheduler *scheduler;
  tcs_sessions *sessions;
  tcs_quality *quality;
  tc_quality_cost cost; /* of all frames: for single pictures, and where a session begins */
  tcs_http *http;
  tcs_metrics metrics;
  GQueue mjpeg_viewers; /* tcs_mjpeg */
  int ws_clients, mjpeg_clients;
  bool draining;
  bool http_work; /* something was resumed or closed: MHD must run before the loop waits */
} tcs_server;

#endif
