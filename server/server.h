/* The parts of the daemon, connected by cli/serve.c. Pointers only, so that a part sees the internals of another only
 * by including its header. Dependencies go one way (tests/layers): observe, memory, config, loop, encode, schedule,
 * catalogue, access, session, ws, http, cli; each may include those before it. Everything here belongs to the I/O
 * thread; only tasks (loop/worker.h) cross to other threads. */
#ifndef TCS_SERVER_H
#define TCS_SERVER_H

#include <stdbool.h>

typedef struct tcs_config tcs_config;
typedef struct tcs_metrics tcs_metrics;
typedef struct tcs_budget tcs_budget;
typedef struct tcs_loop tcs_loop;
typedef struct tcs_completions tcs_completions;
typedef struct tcs_worker tcs_worker;
typedef struct tcs_scheduler tcs_scheduler;
typedef struct tcs_spool tcs_spool;
typedef struct tcs_catalogue tcs_catalogue;
typedef struct tcs_access tcs_access;
typedef struct tcs_sessions tcs_sessions;
typedef struct tcs_quality tcs_quality;
typedef struct tcs_http tcs_http;

typedef struct tcs_server {
  const tcs_config *config;
  tcs_metrics *metrics;
  tcs_budget *budget; /* all memory of the daemon */
  tcs_loop *loop;
  tcs_completions *completions;
  tcs_worker *render_worker;  /* one thread: owns the renderer */
  tcs_worker *encode_worker;  /* one thread: encodes interactive frames */
  tcs_worker *still_worker;   /* one thread: encodes other pictures */
  tcs_worker *load_worker;    /* imports */
  tcs_worker *spool_worker;   /* one thread: writes uploads */
  tcs_worker *walk_worker;    /* folder scans, histograms: separate, not to wait for long imports */
  tcs_worker *text_worker;    /* parses and prints long documents */
  tcs_worker *probe_worker;   /* one thread: rays and picks, by the reference integrator */
  tcs_worker *meter_worker;   /* one thread, low priority: the error meter */
  tcs_worker *quality_worker; /* one thread, low priority: models of quality control */
  tcs_spool *spool;
  tcs_catalogue *catalogue;
  tcs_scheduler *scheduler;
  tcs_access *access;
  tcs_sessions *sessions;
  tcs_quality *quality;
  tcs_http *http;
  int ws_clients, mjpeg_clients;
  bool draining;
  bool http_work; /* a connection was resumed or closed: MHD must run before the loop waits */
} tcs_server;

#endif
