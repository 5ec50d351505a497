/* What `tomocast serve` was told: command line, configuration file, defaults. Read-only once the daemon runs. */
#ifndef TCS_CONFIG_CONFIG_H
#define TCS_CONFIG_CONFIG_H

#include <inttypes.h>
#include <stdbool.h>
#include <stdint.h>

#include "renderer/tomocast.h"
#include "server/observe/log.h"

typedef struct tcs_named_path {
  char *id, *path;
} tcs_named_path;

/* Limits, all from the group [limits] of the file; the key is the member's name. */
typedef struct tcs_limits {
  int64_t image_side, image_area;         /* pixels; at most what a scene may hold at all */
  int64_t rays_per_pixel, knots;          /* likewise */
  int64_t body_bytes, upload_bytes;       /* of one request */
  int64_t memory_bytes;                   /* all of the daemon; 0 until settled, as the next two */
  int64_t volume_bytes;                   /* of these: voxels, all volumes and loads together */
  int64_t cache_bytes;                    /* of these, at most: what the renderer keeps between frames */
  int64_t loads, loads_per_client;        /* imports waiting or under way */
  int64_t import_seconds;                 /* one that takes longer is given up */
  int64_t bridged_slices;                 /* of a series, how many missing slices are interpolated: 0 or 1 */
  int64_t patient_tags;                   /* 1: lists of series say whose they are and on which day */
  int64_t failed_entries, failed_seconds; /* how many failed volumes are remembered, and for how long */
  int64_t uploads, uploads_per_client;    /* under way at once */
  int64_t upload_rate; /* bytes a second, after upload_grace_seconds and in every such time; 0 = any */
  int64_t upload_grace_seconds;
  int64_t spool_bytes;                 /* uploads under way or waiting to be loaded, all together */
  int64_t sessions, clients;           /* clients: WebSocket and MJPEG viewers */
  int64_t queue;                       /* stateless renders that may wait */
  int64_t render_samples, ray_samples; /* estimated of one picture, and of one of its rays */
  int64_t render_seconds;              /* a picture that takes longer is given up */
  int64_t window;                      /* unacknowledged frames per viewer */
  int64_t blocked_seconds;             /* a viewer that takes no bytes for this long is gone */
  int64_t session_idle_seconds;        /* a session nobody watches ends after this */
} tcs_limits;

typedef struct tcs_listen {
  char *address; /* the host part; NULL: nowhere */
  int port;      /* 0 = any */
} tcs_listen;

typedef struct tcs_config {
  tcs_listen listen;
  tcs_listen metrics; /* where anybody gets /metrics, and nothing else */
  char *data;         /* canonical folder of --data, or NULL */
  char *log;          /* file of the log, or NULL: stderr */
  char *spool;        /* folder for uploads under way */
  tc_backend backend;
  int threads;           /* of the renderer; 0 = all cores */
  GPtrArray *volumes;    /* tcs_named_path: --volume */
  GPtrArray *hosts;      /* char *: names it answers to beside the address it listens on */
  GPtrArray *link_roots; /* char *: folders that links of the data folder may lead to */
  GPtrArray *proxies;    /* char *: addresses of proxies in front that say who asks */
  GPtrArray *origins;    /* char *: of pages behind a proxy that sends on another Host */
  char *audit_file;      /* or NULL */
  char *token_file;      /* who may do what; NULL: everybody everything */
  bool insecure_no_auth; /* everybody, from everywhere: said aloud */
  int64_t drain_seconds; /* how long to go on answering (with readyz 503) after SIGTERM */
  tcs_log_level log_level;
  tcs_limits limits;
} tcs_config;

/* One limit: its name in the file and in /v1/about, where it lives, and its bounds. */
typedef struct tcs_limit_field {
  const char *name; /* in the configuration file */
  const char *json; /* in /v1/about */
  size_t offset;    /* of an int64_t in tcs_limits */
  int64_t fallback, least, most;
} tcs_limit_field;
const tcs_limit_field *tcs_limit_fields(size_t *count);

void tcs_config_init(tcs_config *config);
void tcs_config_clear(tcs_config *config);
/* Derives what was not given: the whole budget from the machine and its control groups, its parts from the whole. */
void tcs_config_settle(tcs_config *config);
/* Reads `path` (GKeyFile: [server] and [limits]) over what *config holds. Unknown keys are errors. */
bool tcs_config_read(tcs_config *config, const char *path, GError **error);
/* "ADDR:PORT", "[V6]:PORT" or ":PORT". `option` names it in the error. */
bool tcs_config_listen(tcs_listen *listen, const char *option, const char *text, GError **error);
/* "ID=PATH". */
bool tcs_config_volume(tcs_config *config, const char *text, GError **error);
bool tcs_config_data(tcs_config *config, const char *path, GError **error);
bool tcs_config_backend(tcs_config *config, const char *text, GError **error);

/* Volume ids: 1..64 of letters, digits, '.', '_', '-'; not dots alone, which URL parsers take out of a path. */
bool tcs_id_valid(const char *id);

#endif
