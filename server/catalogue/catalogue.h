/* The volumes and the meshes the daemon knows by id: loaded once, shared, counted, within one memory budget and one set
 * of limits. I/O thread only; loading itself runs on the load worker. */
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

/* Each has ids of its own, and paths: /v1/volumes, /v1/meshes. */
typedef enum tcs_kind { TCS_KIND_VOLUME, TCS_KIND_MESH, TCS_KIND_COUNT } tcs_kind;
extern const char *const tcs_kind_names[TCS_KIND_COUNT],
    *const tcs_kind_paths[TCS_KIND_COUNT]; /* "mesh"; "/v1/meshes" */

typedef enum tcs_volume_state { TCS_LOADING, TCS_RESIDENT, TCS_FAILED, TCS_VOLUME_STATE_COUNT } tcs_volume_state;

typedef struct tcs_load tcs_load;
#define TCS_ID_SIZE 65

/* A file or series of several volumes (times, echoes), shared by the entries that are volumes of it: a client may load
 * others of it without knowing its path, and an upload stays in the spool for as long as one of them is there. */
typedef struct tcs_series {
  int references;
  int frames;
  char *path;          /* without "#volume=N" */
  tcs_spooled *upload; /* or NULL */
} tcs_series;

typedef struct tcs_entry {
  tcs_kind kind;
  char id[TCS_ID_SIZE];
  char owner[65];       /* name of the token that brought it; "": nobody's */
  tcs_series *series;   /* that it is a volume of, or NULL: one reference */
  int part;             /* which one, from 1 */
  char of[TCS_ID_SIZE]; /* the first of it that was loaded; "": itself, or none */
  tcs_volume_state state;
  tc_volume *volume; /* resident volume: one reference */
  tc_volume *body;   /* the same without tables and padding: one reference; NULL: there are none */
  tc_fit fit;        /* resident: what its voxels say */
  tc_scene defaults; /* resident: the scene that fits the volume */
  GBytes *thumbnail; /* resident: a JPEG, once somebody asked for it, counted as all encoded pictures are; NULL */
  char *reason;      /* failed: why, one line without server-side paths */
  tcs_load *load;    /* loading */
  tc_mesh *mesh;     /* resident mesh, with normals: one reference */
  tc_mesh_file file; /* likewise: what it came from */
  tc_mesh_measures measures;
  void *held, *held_body; /* resident: the ledger's notes of them; the latter of a body */
  bool operators;         /* of the command line */
  int64_t used_us;        /* resident: last asked for; failed: since when */
  GList failed_link;      /* failed, and not the operator's: by age */
  tcs_volume_state told;  /* the state viewers were last told of */
  int users;              /* sessions that show it */
} tcs_entry;

/* The volume whose voxels a scene shows: with or without tables and padding. */
static inline tc_volume *tcs_entry_shown(const tcs_entry *entry, const tc_scene *scene) {
  return scene->hide_table && entry->body && scene->mode != TC_MODE_MPR ? entry->body : entry->volume;
}

/* A file on its way in. */
typedef struct tcs_source_file {
  char *path;         /* what tc_import() opens; owned */
  const char *name;   /* what a client may see in its place in messages */
  tcs_series *series; /* another volume of it is loaded: `part`; one reference, owned */
  int part;
  tcs_spooled *upload;          /* it was uploaded and goes once it is loaded or has failed; owned. NULL: it was not */
  char client[TCS_CLIENT_SIZE]; /* who asked */
  bool operators; /* the operator named it: the log says why it failed. A client's file might name a patient */
} tcs_source_file;

tcs_catalogue *tcs_catalogue_new(tcs_server *server);
void tcs_catalogue_free(tcs_catalogue *catalogue); /* after the load worker has ended and completions were drained */

tcs_entry *tcs_catalogue_find(tcs_catalogue *catalogue, tcs_kind kind, const char *id);
/* A resident entry; else TC_ERROR_NOT_FOUND or _CONFLICT (loading or failed), which points at `member`, the JSON
 * pointer to what named it; NULL: none did. */
tcs_entry *tcs_catalogue_resident(tcs_catalogue *catalogue, tcs_kind kind, const char *id, const char *member,
                                  GError **error);

/* How many imports run at once; no client has more than all but one of them. */
#define TCS_LOAD_THREADS 4

/* Starts to load, or queues it; TC_ERROR_INVALID (id), _CONFLICT (id in use) or _BUSY (too many are waiting, or the
 * memory is used up and nothing may be dropped). Takes source->path and source->upload. A failed entry's id may be
 * used again. */
tcs_entry *tcs_catalogue_load(tcs_catalogue *catalogue, tcs_kind kind, const char *id, tcs_source_file *source,
                              GError **error);
/* The error that tcs_catalogue_load() would return, without starting a load. */
bool tcs_catalogue_may_load(tcs_catalogue *catalogue, tcs_kind kind, const char *id, const char *client,
                            GError **error);

/* Forgets the id; what it is goes when its last user does. An import under way is told to stop. */
void tcs_catalogue_remove(tcs_catalogue *catalogue, tcs_entry *entry);

/* Volume `part` of the series that a resident entry is of. TC_ERROR_INVALID where it is of none, or that has no such.
 */
bool tcs_catalogue_another(const tcs_entry *entry, int part, tcs_source_file *source, GError **error);

static inline tcs_series *tcs_series_ref(tcs_series *series) {
  series->references++;
  return series;
}

/* Finds a file of the data folder for a client: a path beneath it ("#N" chooses a DICOM series), or "demo:NAME". */
bool tcs_catalogue_resolve(tcs_catalogue *catalogue, tcs_kind kind, const char *path, tcs_source_file *source,
                           GError **error);

/* Those of a kind as they are, for a list that another thread writes: those that `wanted` has, all where it is NULL.
 * Freed with tcs_rows_free(). */
typedef bool tcs_entry_wanted(const void *user, tcs_kind kind, const char *id);
/* One, with the volumes of its series that there are and that `wanted` has. */
cJSON *tcs_catalogue_describe(tcs_catalogue *catalogue, const tcs_entry *entry, tcs_entry_wanted *wanted,
                              const void *user);
GArray *tcs_catalogue_rows(tcs_catalogue *catalogue, tcs_kind kind, tcs_entry_wanted *wanted, const void *user);
cJSON *tcs_rows_describe(GArray *rows); /* by id; any thread */
void tcs_rows_free(GArray *rows);
/* Which volume of how many, and what of a series is in it. */
void tcs_describe_provenance(cJSON *json, const tc_volume *volume);
/* What its labels are, where that is known. */
void tcs_describe_labels(cJSON *json, const tc_volume *volume);
/* Series of a list, each with its volumes. */
cJSON *tcs_describe_series(const tc_series *series, size_t count);
void tcs_describe_model(cJSON *json, const tc_vmd *model);
void tcs_catalogue_gauges(tcs_catalogue *catalogue, tcs_gauges *gauges);
/* True while a volume of the command line has not been loaded, well or badly. */
bool tcs_catalogue_starting(tcs_catalogue *catalogue);
/* At shutdown: cancels every import under way and begins no other. */
void tcs_catalogue_cancel_all(tcs_catalogue *catalogue);

/* About once a second: forgets old failures, starts what waited for memory. */
void tcs_catalogue_tick(tcs_catalogue *catalogue, int64_t now_us);

/* Tells viewers about loads that moved or ended: {"type":"volume" or "mesh",...} to `tell`. Called a few times a
 * second. */
void tcs_catalogue_report(tcs_catalogue *catalogue, void (*tell)(void *user, const char *json), void *user);

#endif
