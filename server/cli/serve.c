/* tomocast serve: creates the daemon's parts, runs its loop, drains, and frees the parts in reverse order. */
#include <limits.h>
#include <malloc.h>
#include <stdio.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/resource.h>

#include "renderer/import/links.h"
#include "server/access/access.h"
#include "server/catalogue/catalogue.h"
#include "server/catalogue/spool.h"
#include "server/cli/cli.h"
#include "server/cli/daemon.h"
#include "server/cli/signals.h"
#include "server/config/config.h"
#include "server/encode/encode.h"
#include "server/http/http.h"
#include "server/http/mjpeg.h"
#include "server/loop/loop.h"
#include "server/loop/worker.h"
#include "server/memory/budget.h"
#include "server/observe/log.h"
#include "server/observe/metrics.h"
#include "server/session/deliver.h"
#include "server/session/quality_control.h"
#include "server/session/sessions.h"

#define TICK_US 1000000
#define REPORT_US 200000 /* between progress reports of imports */
#define LOG_MOST_MS 500  /* wait at exit for a log that nobody reads */
#define DRAIN_MOST_S 5   /* requests still open this long after the drain began are cut */
#define END_MOST_MS 8000 /* the process ends this long after that, whatever still runs */

struct tcs_daemon {
  tcs_config config;
  tcs_server server;
  tcs_metrics metrics;
  tcs_completions all_completions;
  tcs_signals *heard;
  tcs_source signals, completions;
  int64_t ticked_us, reported_us, drain_us;
  int signal_count;
  bool quiet; /* accepts no new connections */
};

#define OWNER(pointer, member) ((tcs_daemon *)(void *)((char *)(pointer)-offsetof(tcs_daemon, member)))

/* --- the loop -------------------------------------------------------------------------------------- */

/* Rereading the token file, on a worker because the disk may be slow. */
typedef struct reload_task {
  tcs_task task;
  tcs_daemon *d;
  tcs_tokens *tokens;
  GError *error;
} reload_task;

static void run_reload(tcs_task *task) {
  reload_task *reload = (reload_task *)task;
  reload->tokens = tcs_tokens_read(reload->d->config.token_file, &reload->error);
}

static void done_reload(tcs_task *task) {
  reload_task *reload = (reload_task *)task;
  tcs_server *server = &reload->d->server;
  if (reload->tokens) {
    tcs_log(TCS_LOG_INFO, "tokens.renewed", "count=%u", tcs_tokens_count(reload->tokens));
    tcs_access_renew(server->access, reload->tokens);
    if (server->sessions && !server->draining) tcs_sessions_end_orphans(server->sessions);
    reload->d->ticked_us = 0; /* the streams of removed tokens end in this turn */
  } else {
    tcs_log(TCS_LOG_WARN, "tokens.kept", "text=\"the tokens stay as they were\" reason=%s", reload->error->message);
  }
  g_clear_error(&reload->error);
  g_free(reload);
}

static void on_signal(tcs_source *source, uint32_t events) {
  tcs_daemon *d = OWNER(source, signals);
  d->signal_count = tcs_signals_ends(d->heard);
  if (!tcs_signals_hung_up(d->heard) || !d->server.access->tokens) return;
  reload_task *reload = g_new0(reload_task, 1);
  *reload = (reload_task){.task = {.run = run_reload, .done = done_reload}, .d = d};
  tcs_worker_submit(d->server.text_worker, &reload->task);
}

static void on_completion(tcs_source *source, uint32_t events) {
  tcs_completions_drain(OWNER(source, completions)->server.completions);
}

static void tell_streams(void *streams, const char *json) { tcs_streams_tell(streams, json); }

static void report_building(tcs_session *session, void *unused) { tcs_session_report(session); }

static void tick(tcs_daemon *d, int64_t now_us) {
  tcs_server *server = &d->server;
  if (now_us - d->reported_us >= REPORT_US) {
    d->reported_us = now_us;
    tcs_sessions_each(server->sessions, report_building, NULL);
    tcs_catalogue_report(server->catalogue, tell_streams, tcs_http_streams(server->http));
  }
  if (now_us - d->ticked_us < TICK_US) return;
  d->ticked_us = now_us;
  tcs_http_tick(server->http, now_us);
  tcs_streams_tick(tcs_http_streams(server->http), now_us);
  tcs_sessions_expire(server->sessions, now_us);
  tcs_scheduler_tick(server->scheduler, now_us);
  tcs_catalogue_tick(server->catalogue, now_us);
}

/* Milliseconds to wait: until MHD, a session's rest, a paused viewer or the next tick needs a turn. */
static int timeout_ms(const tcs_daemon *d, int http_ms, int64_t now_us) {
  tcs_streams *streams = tcs_http_streams(d->server.http);
  const int64_t read_us = tcs_streams_resume(streams, now_us);
  int64_t wait_us = tcs_streams_count(streams) > 0 ? REPORT_US : TICK_US;
  if (read_us >= 0 && read_us < wait_us) wait_us = read_us;
  const int64_t rest_us = tcs_sessions_next_us(d->server.sessions, now_us);
  if (rest_us >= 0 && rest_us < wait_us) wait_us = rest_us;
  const int ms = (int)((wait_us + 999) / 1000);
  return http_ms >= 0 && http_ms < ms ? http_ms : ms;
}

static void begin_drain(tcs_daemon *d, int64_t now_us) {
  tcs_log(TCS_LOG_INFO, "drain.begin", "sessions=%d viewers=%d", tcs_sessions_count(d->server.sessions),
          d->server.ws_clients + d->server.mjpeg_clients);
  d->drain_us = now_us;
  d->server.draining = true;
  tcs_streams_close_all(tcs_http_streams(d->server.http), false);
  tcs_mjpeg_end_all(&d->server);
  tcs_uploads_drain(&d->server);
  tcs_catalogue_cancel_all(d->server.catalogue);
}

/* True when the drain has nothing left to wait for. */
static bool drained(const tcs_daemon *d, int64_t now_us) {
  const int64_t listen_us = d->config.drain_seconds * 1000000, passed_us = now_us - d->drain_us;
  if (d->signal_count > 1 || passed_us > listen_us + DRAIN_MOST_S * INT64_C(1000000)) return true;
  return passed_us >= listen_us && tcs_http_open_requests(d->server.http) == 0 &&
         tcs_scheduler_idle(d->server.scheduler);
}

/* One turn of the drain; false: it is over. */
static bool drain(tcs_daemon *d, int64_t now_us) {
  if (!d->server.draining) begin_drain(d, now_us);
  if (!d->quiet && now_us - d->drain_us >= d->config.drain_seconds * 1000000) {
    d->quiet = true;
    tcs_http_quiesce(d->server.http);
  }
  return !drained(d, now_us);
}

bool tcs_daemon_turn(tcs_daemon *d, int most_ms) {
  tcs_server *server = &d->server;
  const int64_t now_us = g_get_monotonic_time();
  if (d->signal_count && !drain(d, now_us)) return false;
  tick(d, now_us);
  tcs_completions_drain(server->completions); /* in every turn, so that busy sockets cannot starve finished tasks */
  tcs_sessions_wake(server->sessions, now_us);
  const int http_ms = tcs_http_run(server->http);
  const int wait_ms = timeout_ms(d, http_ms, g_get_monotonic_time());
  tcs_loop_wait(server->loop, MIN(wait_ms, server->draining ? 20 : most_ms));
  tcs_sessions_settle(server->sessions);
  return true;
}

tcs_server *tcs_daemon_server(tcs_daemon *d) { return &d->server; }

/* --- up and down ------------------------------------------------------------------------------------ */

static bool watch_signals(tcs_daemon *d, GError **error) {
  d->heard = tcs_signals_new(d->config.drain_seconds * 1000 + END_MOST_MS, error);
  if (!d->heard) return false;
  d->signals = (tcs_source){on_signal, tcs_signals_fd(d->heard)};
  return true;
}

static void raise_descriptor_limit(void) {
  struct rlimit limit;
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  setrlimit(RLIMIT_NOFILE, &limit);
}

/* Returns freed memory to the system: by default each thread may get its own heap, and freed large blocks stay in it.
 */
static void keep_heap_small(void) {
#ifdef M_ARENA_MAX
  mallopt(M_ARENA_MAX, 2);
  mallopt(M_MMAP_THRESHOLD, 4 << 20);
  mallopt(M_TRIM_THRESHOLD, 8 << 20);
#endif
}

static bool start_workers(tcs_server *server, GError **error) {
  const struct {
    tcs_worker **worker;
    const char *name;
    int threads;
    tcs_priority priority;
  } rows[] = {
      {&server->spool_worker, "tc-spool", 1, TCS_PRIORITY_PICTURE},
      {&server->render_worker, "tc-render", 1, TCS_PRIORITY_PICTURE},
      {&server->encode_worker, "tc-encode", 1, TCS_PRIORITY_PICTURE},
      {&server->still_worker, "tc-still", 1, TCS_PRIORITY_PICTURE},
      {&server->load_worker, "tc-load", TCS_LOAD_THREADS, TCS_PRIORITY_BEHIND},
      {&server->walk_worker, "tc-walk", 2, TCS_PRIORITY_BEHIND},
      {&server->text_worker, "tc-text", 1, TCS_PRIORITY_BEHIND},
      {&server->probe_worker, "tc-probe", 1, TCS_PRIORITY_BEHIND},
      {&server->meter_worker, "tc-meter", 1, TCS_PRIORITY_LOW},
      {&server->quality_worker, "tc-quality", 1, TCS_PRIORITY_LOW},
  };
  for (size_t i = 0; i < G_N_ELEMENTS(rows); i++) {
    *rows[i].worker = tcs_worker_new(rows[i].name, rows[i].threads, rows[i].priority, server->completions, error);
    if (!*rows[i].worker) return false;
  }
  return true;
}

static bool load_volumes(tcs_daemon *d, GError **error) {
  for (guint i = 0; i < d->config.volumes->len; i++) {
    const tcs_named_path *named = g_ptr_array_index(d->config.volumes, i);
    tcs_source_file source = {.path = g_strdup(named->path), .name = named->id, .operators = true};
    if (!tcs_catalogue_load(d->server.catalogue, TCS_KIND_VOLUME, named->id, &source, error)) return false;
  }
  return true;
}

static bool start(tcs_daemon *d, GError **error) {
  tcs_server *server = &d->server;
  server->config = &d->config;
  server->metrics = &d->metrics;
  server->completions = &d->all_completions;
  tcs_metrics_init(server->metrics);
  if (!watch_signals(d, error)) return false;
  tcs_log_start();
  if (!tcs_completions_init(server->completions, error)) return false;
  d->completions = (tcs_source){on_completion, server->completions->event_fd};
  if (!(server->loop = tcs_loop_new(error)) || !tcs_loop_add(server->loop, &d->signals, EPOLLIN, error) ||
      !tcs_loop_add(server->loop, &d->completions, EPOLLIN, error) || !start_workers(server, error))
    return false;
  tcs_loop_set_metrics(server->loop, server->metrics);
  server->budget = tcs_budget_new((uint64_t)d->config.limits.memory_bytes, (uint64_t)d->config.limits.volume_bytes);
  server->spool = tcs_spool_new(server);
  server->catalogue = tcs_catalogue_new(server);
  if (!(server->scheduler = tcs_scheduler_new(server, error))) return false;
  tcs_budget_set(server->budget, TCS_MEMORY_PROGRAM, tcs_metrics_resident_bytes());
  server->quality = tcs_quality_new(server);
  server->sessions = tcs_sessions_new(server);
  if (!(server->http = tcs_http_new(server, error))) return false;
  return load_volumes(d, error);
}

/* Ends running uploads: resumes their suspended connections and removes their files. */
static void end_uploads(tcs_server *server) {
  tcs_uploads_abandon(server);
  for (int i = 0; i < 4; i++) {
    tcs_completions_drain(server->completions);
    tcs_http_run(server->http);
  }
}

/* Stops everything that can still call back before it frees what the callbacks use. */
static void stop(tcs_daemon *d) {
  tcs_server *server = &d->server;
  if (server->http) {
    tcs_streams_close_all(tcs_http_streams(server->http), true);
    tcs_mjpeg_end_all(server);
    tcs_http_abandon_all(server->http);
    for (int i = 0; i < 4; i++) tcs_http_run(server->http);
  }
  if (server->catalogue) tcs_catalogue_cancel_all(server->catalogue);
  tcs_worker_free(server->load_worker);
  if (server->http) end_uploads(server);
  tcs_worker_free(g_steal_pointer(&server->spool_worker));
  tcs_worker_free(server->walk_worker);
  tcs_worker_free(server->text_worker);
  tcs_worker_free(server->probe_worker);
  server->draining = true;
  tcs_quality_cancel_all(server->quality);
  tcs_worker_free(server->quality_worker);
  tcs_completions_drain(server->completions);
  tcs_quality_free(g_steal_pointer(&server->quality));
  tcs_sessions_free(server->sessions);
  while (server->scheduler && !tcs_scheduler_idle(server->scheduler)) {
    tcs_completions_drain(server->completions);
    g_usleep(1000);
  }
  tcs_completions_drain(server->completions);
  tcs_http_free(server->http);
  tcs_scheduler_free(server->scheduler);
  tcs_worker_free(server->render_worker);
  tcs_worker_free(server->encode_worker);
  tcs_worker_free(server->still_worker);
  tcs_worker_free(server->meter_worker);
  if (server->completions->event_fd > 0) {
    tcs_completions_drain(server->completions);
    tcs_completions_finish(server->completions);
  }
  tcs_catalogue_free(server->catalogue);
  tcs_spool_free(server->spool);
  tcs_budget_free(server->budget);
  tcs_loop_free(server->loop);
  tcs_metrics_clear(server->metrics);
  tcs_log_stop(LOG_MOST_MS);
  tcs_signals_free(d->heard);
}

static void announce(const tcs_daemon *d) {
  const tc_renderer_info *info = tcs_scheduler_about(d->server.scheduler);
  const char *address = tcs_http_address(d->server.http);
  tcs_log(TCS_LOG_INFO, "serve.start", "version=%s backend=%s simd=%s threads=%d address=%s", TC_VERSION, info->backend,
          info->isa ? info->isa : "none", info->threads, address);
  if (d->config.insecure_no_auth) tcs_log(TCS_LOG_WARN, "serve.open", "text=\"this server asks for no token\"");
  if (d->config.metrics.address)
    tcs_log(TCS_LOG_INFO, "serve.metrics", "address=%s", tcs_http_metrics_address(d->server.http));
  printf("listening on http://%s\n", address);
  fflush(stdout);
}

/* --- the command line ------------------------------------------------------------------------------- */

typedef struct serve_options {
  char *listen, *metrics, *data, *backend, *config, *log, *tokens, *audit, **volumes, **hosts, **proxies, **links;
  gboolean insecure_no_auth;
} serve_options;

/* Adds a volume given by its path alone. Its ID does not come from the file's name: IDs are public, and a file's name may
 * hold a patient's. */
static bool add_volume(tcs_config *config, const char *path, int number, GError **error) {
  const char *demo = g_str_has_prefix(path, "demo:") ? path + strlen("demo:") : NULL;
  if (!demo && !g_file_test(path, G_FILE_TEST_EXISTS)) {
    tc_set_error(error, TC_ERROR_IO, NULL, "%s: no such file or folder; see tomocast serve --help", path);
    return false;
  }
  char *text = demo ? g_strdup_printf("%s=%s", demo, path) : g_strdup_printf("volume-%d=%s", number, path);
  const bool added = tcs_config_volume(config, text, error);
  g_free(text);
  return added;
}

static bool configure(tcs_daemon *d, const serve_options *options, char *const *paths, GError **error) {
  tcs_config *config = &d->config;
  if (options->config && !tcs_config_read(config, options->config, error)) return false;
  if (options->listen && !tcs_config_listen(&config->listen, "--listen", options->listen, error)) return false;
  if (options->metrics && !tcs_config_listen(&config->metrics, "--metrics-listen", options->metrics, error))
    return false;
  if (options->data && !tcs_config_data(config, options->data, error)) return false;
  if (options->backend && !tcs_config_backend(config, options->backend, error)) return false;
  for (char **volume = options->volumes; volume && *volume; volume++)
    if (!tcs_config_volume(config, *volume, error)) return false;
  for (int i = 0; paths && paths[i]; i++)
    if (!add_volume(config, paths[i], i + 1, error)) return false;
  for (char **host = options->hosts; host && *host; host++) g_ptr_array_add(config->hosts, g_strdup(*host));
  for (char **link = options->links; link && *link; link++) g_ptr_array_add(config->link_roots, g_strdup(*link));
  if (!tc_links_set((const char *const *)config->link_roots->pdata, config->link_roots->len, error)) return false;
  for (char **proxy = options->proxies; proxy && *proxy; proxy++) g_ptr_array_add(config->proxies, g_strdup(*proxy));
  tcs_config_settle(config);
  tcs_log_set_level(config->log_level);
  if (options->tokens) {
    g_free(config->token_file);
    config->token_file = g_strdup(options->tokens);
  }
  config->insecure_no_auth = options->insecure_no_auth;
  d->server.access = tcs_access_new(config, error);
  return d->server.access && tcs_log_open(options->log ? options->log : config->log, error) &&
         tcs_log_open_audit(options->audit ? options->audit : config->audit_file, error);
}

/* Frees the configuration and access control, all that exists before the daemon starts. */
static void clear(tcs_daemon *d) {
  tcs_access_free(d->server.access);
  tcs_config_clear(&d->config);
  g_free(d);
}

static int serve(tcs_daemon *d, GError **error) {
  /* The error domain registers itself on first use; before the first thread starts this needs no lock. */
  (void)tc_error_quark();
  raise_descriptor_limit();
  tcs_encode_prepare_process();
  keep_heap_small();
  if (start(d, error)) {
    announce(d);
    return TCS_EXIT_DONE;
  }
  stop(d);
  return TCS_EXIT_FAILED;
}

tcs_daemon *tcs_daemon_open(int argc, char **argv, int *code) {
  serve_options options = {0};
  const GOptionEntry entries[] = {
      {"listen", 0, 0, G_OPTION_ARG_STRING, &options.listen, "where to listen; port 0 takes any", "ADDR:PORT"},
      {"metrics-listen", 0, 0, G_OPTION_ARG_STRING, &options.metrics,
       "address that serves GET /metrics without a token; elsewhere it needs the role admin", "ADDR:PORT"},
      {"data", 0, 0, G_OPTION_ARG_FILENAME, &options.data, "folder whose volumes clients may load", "DIR"},
      {"backend", 0, 0, G_OPTION_ARG_STRING, &options.backend, "auto, cpu or gl", "NAME"},
      {"volume", 0, 0, G_OPTION_ARG_FILENAME_ARRAY, &options.volumes,
       "a volume to load at once, under an ID for the page and the API; may be repeated", "ID=PATH"},
      {"log", 0, 0, G_OPTION_ARG_FILENAME, &options.log, "file that the log is appended to; stderr without it", "FILE"},
      {"link-root", 0, 0, G_OPTION_ARG_FILENAME_ARRAY, &options.links,
       "folder that symbolic links of the data folder may point into (DataLad, git-annex); may be repeated", "DIR"},
      {"trusted-proxy", 0, 0, G_OPTION_ARG_STRING_ARRAY, &options.proxies,
       "a proxy whose X-Forwarded-For or Forwarded header names the client; may be repeated", "ADDR[/BITS]"},
      {"host", 0, 0, G_OPTION_ARG_STRING_ARRAY, &options.hosts,
       "a host name that clients use, in addition to the listening address; may be repeated", "NAME[:PORT]"},
      {"audit-file", 0, 0, G_OPTION_ARG_FILENAME, &options.audit,
       "audit file: lines about who opened what are appended to it, in addition to the log", "FILE"},
      {"token-file", 0, 0, G_OPTION_ARG_FILENAME, &options.tokens,
       "access tokens: lines of NAME ROLE TOKEN (view, edit, admin); SIGHUP rereads the file", "FILE"},
      {"insecure-no-auth", 0, 0, G_OPTION_ARG_NONE, &options.insecure_no_auth,
       "let everybody in who can reach the address", NULL},
      {"config", 0, 0, G_OPTION_ARG_FILENAME, &options.config, "settings and limits; command-line options override it",
       "FILE"},
      {0}};
  const tcs_cli_usage usage = {"serve", "[VOLUME...]", "Serves volumes as pictures over HTTP and WebSocket.", entries};
  tcs_daemon *d = g_new0(tcs_daemon, 1);
  char **rest = NULL;
  GError *error = NULL;
  d->signals.fd = -1;
  tcs_config_init(&d->config);
  const bool good = tcs_cli_parse(&usage, argc, argv, &rest, &error) && configure(d, &options, rest, &error);
  *code = good ? serve(d, &error) : TCS_EXIT_USAGE;
  g_free(options.listen);
  g_free(options.metrics);
  g_free(options.data);
  g_free(options.backend);
  g_free(options.config);
  g_free(options.log);
  g_free(options.tokens);
  g_free(options.audit);
  g_strfreev(options.volumes);
  g_strfreev(options.hosts);
  g_strfreev(options.proxies);
  g_strfreev(options.links);
  g_strfreev(rest);
  if (*code == TCS_EXIT_DONE) return d;
  tcs_cli_fail("serve", *code, error);
  clear(d);
  return NULL;
}

void tcs_daemon_close(tcs_daemon *d) {
  tcs_log(TCS_LOG_INFO, "serve.stop", NULL);
  stop(d);
  clear(d);
}

int tcs_cli_serve(int argc, char **argv) {
  int code;
  tcs_daemon *d = tcs_daemon_open(argc, argv, &code);
  if (!d) return code;
  while (tcs_daemon_turn(d, INT_MAX)) {
  }
  tcs_daemon_close(d);
  return code;
}
