/* The catalogue: volumes and meshes by id, loaded once and shared by all sessions, within the memory budget and the
 * limits. I/O thread only; imports run on the load worker. */
#ifndef TCS_CATALOGUE_CATALOGUE_H
#define TCS_CATALOGUE_CATALOGUE_H

#include <cjson/cJSON.h>

#include "renderer/import/import.h"
#include "renderer/mesh/measure.h"
#include "renderer/splat/vmd.h"
#include "renderer/tomocast.h"
#include "server/catalogue/spool.h"
#include "server/observe/metrics.h"
#include "server/server.h"

/* Each kind has its own ids and routes: /v1/volumes, /v1/meshes. */
typedef enum tcs_kind { TCS_KIND_VOLUME, TCS_KIND_MESH, TCS_KIND_COUNT } tcs_kind;
extern const char *const tcs_kind_names[TCS_KIND_COUNT],
    *const tcs_kind_paths[TCS_KIND_COUNT]; /* "mesh"; "/v1/meshes" */

typedef enum tcs_volume_state { TCS_LOADING, TCS_RESIDENT, TCS_FAILED, TCS_VOLUME_STATE_COUNT } tcs_volume_state;

typedef struct tcs_load tcs_load;
#define TCS_ID_SIZE 65

/* A file or series with several volumes (times, echoes), shared by the entries loaded from it. A client can load
 * another volume of the series without knowing its path. An upload stays in the spool while any of its volumes is
 * loaded. */
typedef struct tcs_series {
  int references;
  int frames;
  char *path;          /* without "#volume=N" */
  tcs_spooled *upload; /* or NULL */
} tcs_series;

typedef struct tcs_entry {
  tcs_kind kind;
  char id[TCS_ID_SIZE];
  char owner[65];       /* name of the token that loaded it; "": no owner */
  tcs_series *series;   /* series of this volume, or NULL: one reference */
  int part;             /* number of this volume in its series, from 1 */
  char of[TCS_ID_SIZE]; /* id of the first volume loaded from the same series; "": this entry, or no series */
  tcs_volume_state state;
  tc_volume *volume; /* resident volume: one reference */
  tc_volume *body;   /* volume without tables and padding: one reference; NULL: there are none */
  tc_fit fit;        /* resident: value range and windows fitted to the voxels */
  tc_scene defaults; /* resident: default scene for the volume */
  struct tcs_job *preparation; /* resident: builds the resources of the default scene; NULL: none is queued */
  GBytes *thumbnail; /* resident: cached JPEG, counted under encoded pictures; NULL until first requested */
  char *reason;      /* failed: the reason, one line without server-side paths */
  tcs_load *load;    /* loading */
  tc_mesh *mesh;     /* resident mesh, with normals: one reference */
  tc_mesh_file file; /* resident mesh: properties of its file */
  tc_mesh_measures measures;
  void *held, *held_body; /* resident: memory accounting of volume or mesh, and of the body */
  bool operators;         /* loaded from the command line */
  int64_t used_us;        /* resident: time of the last use; failed: time of the failure */
  GList failed_link;      /* in the queue of failed entries, oldest first; not for the operator's */
  tcs_volume_state told;  /* the state last reported to viewers */
  int users;              /* number of sessions that show it */
} tcs_entry;

/* The volume that a scene samples: the body (no tables or padding) if the scene hides the table, except in mode mpr. */
static inline tc_volume *tcs_entry_shown(const tcs_entry *entry, const tc_scene *scene) {
  return scene->hide_table && entry->body && scene->mode != TC_MODE_MPR ? entry->body : entry->volume;
}

/* A file to be imported. */
typedef struct tcs_source_file {
  char *path;         /* what tc_import() opens; owned */
  const char *name;   /* name for messages to clients, instead of the path */
  tcs_series *series; /* set when `part` of an already loaded series is wanted; one reference, owned */
  int part;
  tcs_spooled *upload;          /* set for an upload, removed after the import; owned */
  char client[TCS_CLIENT_SIZE]; /* the requesting client */
  bool operators; /* named by the operator: failures are logged with a reason. A client's file might name a patient */
} tcs_source_file;

tcs_catalogue *tcs_catalogue_new(tcs_server *server);
void tcs_catalogue_free(tcs_catalogue *catalogue); /* after the load worker has ended and completions were drained */

tcs_entry *tcs_catalogue_find(tcs_catalogue *catalogue, tcs_kind kind, const char *id);
/* The resident entry `id`. TC_ERROR_NOT_FOUND or _CONFLICT (loading or failed) with `member` as the JSON pointer to the
 * id in the request; member NULL: no pointer. */
tcs_entry *tcs_catalogue_resident(tcs_catalogue *catalogue, tcs_kind kind, const char *id, const char *member,
                                  GError **error);

/* Number of concurrent imports; one client may have at most one fewer. */
#define TCS_LOAD_THREADS 4

/* Starts or queues an import. TC_ERROR_INVALID (id), _CONFLICT (id in use) or _BUSY (too many imports waiting, or
 * memory used up and nothing may be dropped). Takes source->path, source->series and source->upload, also on failure.
 * The id of a failed entry may be used again. */
tcs_entry *tcs_catalogue_load(tcs_catalogue *catalogue, tcs_kind kind, const char *id, tcs_source_file *source,
                              GError **error);
/* The error that tcs_catalogue_load() would return, without starting a load. */
bool tcs_catalogue_may_load(tcs_catalogue *catalogue, tcs_kind kind, const char *id, const char *client,
                            GError **error);

/* Removes the entry. Its memory is released with the last user's reference. Cancels an import under way. */
void tcs_catalogue_remove(tcs_catalogue *catalogue, tcs_entry *entry);

/* Describes volume `part` of a resident entry's series in *source. TC_ERROR_INVALID: the entry has no series, or the
 * series no such volume. */
bool tcs_catalogue_another(const tcs_entry *entry, int part, tcs_source_file *source, GError **error);

static inline tcs_series *tcs_series_ref(tcs_series *series) {
  series->references++;
  return series;
}

/* Resolves a client's path in *source: a path beneath the data folder ("#N" selects a DICOM series), or "demo:NAME". */
bool tcs_catalogue_resolve(tcs_catalogue *catalogue, tcs_kind kind, const char *path, tcs_source_file *source,
                           GError **error);

/* A snapshot of the entries of a kind that `wanted` accepts (NULL: all), so that another thread can write the list.
 * Freed with tcs_rows_free(). */
typedef bool tcs_entry_wanted(const void *user, tcs_kind kind, const char *id);
/* Describes one entry, with those loaded volumes of its series that `wanted` accepts. */
cJSON *tcs_catalogue_describe(tcs_catalogue *catalogue, const tcs_entry *entry, tcs_entry_wanted *wanted,
                              const void *user);
GArray *tcs_catalogue_rows(tcs_catalogue *catalogue, tcs_kind kind, tcs_entry_wanted *wanted, const void *user);
cJSON *tcs_rows_describe(GArray *rows); /* sorted by id; any thread */
void tcs_rows_free(GArray *rows);
/* Adds the volume's number in its series and what was read of the series. */
void tcs_describe_provenance(cJSON *json, const tc_volume *volume);
/* Adds the meaning of the label values, if known. */
void tcs_describe_labels(cJSON *json, const tc_volume *volume);
/* A list of series, each with its volumes. */
cJSON *tcs_describe_series(const tc_series *series, size_t count);
void tcs_describe_model(cJSON *json, const tc_vmd *model);
void tcs_catalogue_gauges(tcs_catalogue *catalogue, tcs_gauges *gauges);
/* True while a volume of the command line is still loading. */
bool tcs_catalogue_starting(tcs_catalogue *catalogue);
/* At shutdown: cancels all imports and starts no further ones. */
void tcs_catalogue_cancel_all(tcs_catalogue *catalogue);

/* About once a second: forgets old failures, starts imports that waited for memory. */
void tcs_catalogue_tick(tcs_catalogue *catalogue, int64_t now_us);

/* Reports progress and ends of imports to viewers: passes {"type":"volume" or "mesh",...} to `tell`. Called a few times
 * a second. */
void tcs_catalogue_report(tcs_catalogue *catalogue, void (*tell)(void *user, const char *json), void *user);

#endif
