/* Configuration of `tomocast serve`: command line, configuration file, defaults. Read-only once the daemon runs. */
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
  int64_t image_side, image_area;         /* pixels; at most the limits of a scene (TC_MAX_*) */
  int64_t rays_per_pixel, knots;          /* at most the limits of a scene */
  int64_t body_bytes, upload_bytes;       /* of one request */
  int64_t memory_bytes;                   /* all memory of the daemon; 0, like the next two, until settled */
  int64_t volume_bytes;                   /* of memory_bytes: voxels of all volumes and imports */
  int64_t cache_bytes;                    /* of memory_bytes, at most: what the renderer keeps between frames */
  int64_t loads, loads_per_client;        /* imports waiting or running */
  int64_t import_seconds;                 /* an import that takes longer fails */
  int64_t bridged_slices;                 /* missing slices of a series that may be interpolated: 0 or 1 */
  int64_t patient_tags;                   /* 1: lists of series give the patient's name and the date */
  int64_t failed_entries, failed_seconds; /* failed volumes kept in lists: number, and how long */
  int64_t uploads, uploads_per_client;    /* under way at once */
  int64_t upload_rate;                    /* least bytes a second over each upload_grace_seconds; 0 = no minimum */
  int64_t upload_grace_seconds;
  int64_t spool_bytes;                 /* uploads being received or waiting for import, altogether */
  int64_t sessions, clients;           /* clients: WebSocket and MJPEG viewers */
  int64_t queue;                       /* stateless renders waiting */
  int64_t render_samples, ray_samples; /* estimated for one picture, and for one of its rays */
  int64_t render_seconds;              /* a picture that takes longer fails */
  int64_t window;                      /* unacknowledged frames per viewer */
  int64_t blocked_seconds;             /* a viewer that reads nothing for this long is disconnected */
  int64_t session_idle_seconds;        /* a session without viewers ends after this */
} tcs_limits;

typedef struct tcs_listen {
  char *address; /* the host part; NULL: do not listen */
  int port;      /* 0 = any */
} tcs_listen;

typedef struct tcs_config {
  tcs_listen listen;
  tcs_listen metrics; /* serves /metrics to everybody, and nothing else */
  char *data;         /* canonical folder of --data, or NULL */
  char *log;          /* file of the log, or NULL: stderr */
  char *spool;        /* folder for uploads in progress */
  tc_backend backend;
  int threads;           /* of the renderer; 0 = all cores */
  GPtrArray *volumes;    /* tcs_named_path: --volume */
  GPtrArray *hosts;      /* char *: accepted host names besides the listening address */
  GPtrArray *link_roots; /* char *: folders that links in the data folder may lead to */
  GPtrArray *proxies;    /* char *: addresses of trusted proxies */
  GPtrArray *origins;    /* char *: allowed page origins besides the accepted hosts */
  char *audit_file;      /* or NULL */
  char *token_file;      /* NULL: every caller is an admin */
  bool insecure_no_auth; /* allows a server without tokens on a public address */
  int64_t drain_seconds; /* after SIGTERM: seconds in which requests are still served (readyz: 503) */
  tcs_log_level log_level;
  tcs_limits limits;
} tcs_config;

/* One limit: its name in the file and in /v1/about, its offset and its bounds. */
typedef struct tcs_limit_field {
  const char *name; /* in the configuration file */
  const char *json; /* in /v1/about */
  size_t offset;    /* of an int64_t in tcs_limits */
  int64_t fallback, least, most;
} tcs_limit_field;
const tcs_limit_field *tcs_limit_fields(size_t *count);

void tcs_config_init(tcs_config *config);
void tcs_config_clear(tcs_config *config);
/* Fills in limits that were not given: the memory from the machine and its control groups, its parts from the memory.
 */
void tcs_config_settle(tcs_config *config);
/* Reads `path` (GKeyFile: [server] and [limits]) into *config, overriding its values. Unknown keys are errors. */
bool tcs_config_read(tcs_config *config, const char *path, GError **error);
/* "ADDR:PORT", "[V6]:PORT" or ":PORT". The error names `option`. */
bool tcs_config_listen(tcs_listen *listen, const char *option, const char *text, GError **error);
/* "ID=PATH". */
bool tcs_config_volume(tcs_config *config, const char *text, GError **error);
bool tcs_config_data(tcs_config *config, const char *path, GError **error);
bool tcs_config_backend(tcs_config *config, const char *text, GError **error);

/* Volume ids: 1..64 of letters, digits, '.', '_', '-'; not dots alone, which URL parsers remove from a path. */
bool tcs_id_valid(const char *id);

#endif
