/* Internals of the catalogue, for its own files only. I/O thread, except for the import on its worker. */
#ifndef TCS_CATALOGUE_OWN_H
#define TCS_CATALOGUE_OWN_H

#include <stdatomic.h>

#include "server/catalogue/catalogue.h"
#include "server/loop/worker.h"
#include "server/memory/budget.h"

struct tcs_catalogue {
  tcs_server *server;
  GHashTable *entries; /* set of tcs_entry, hashed by kind and id */
  GQueue loads;        /* tcs_load *, oldest first: waiting and running */
  GQueue failed;       /* tcs_entry *, by failed_link, oldest first; not the operator's */
  int running;
  bool ended; /* shutdown: no import starts */
};

struct tcs_load {
  tcs_task task;
  GList link;
  tcs_catalogue *catalogue;
  tcs_entry *entry; /* NULL: the entry was removed */
  tcs_kind kind;
  tcs_source_file source;
  char *name;
  bool running;
  int64_t asked_us;              /* when the import first had to wait for memory; 0 = never */
  int64_t began_us, deadline_us; /* of the current run */
  atomic_bool cancel;
  atomic_int permille;
  int told; /* permille in the last report */

  /* owned by the worker while it runs */
  uint64_t wanted, reserved; /* bytes needed, from the file's header; bytes reserved in the budget */
  uint64_t decoder;          /* bytes counted for the decoder process */
  uint64_t decoder_wanted;   /* the decoder's largest request, over all runs */
  bool refused;              /* the budget refused `wanted` or `decoder_wanted` */
  bool late;                 /* exceeded its time limit */
  bool good;                 /* the import succeeded */
  tc_volume *volume, *body;
  tc_fit fit;
  tc_scene defaults; /* default scene; zeros for a mesh */
  tc_mesh *mesh;
  tc_mesh_file file;
  tc_mesh_measures measures;
  GError *error;
};

/* The functions that differ between volumes (volumes.c) and meshes (meshes.c). */
typedef struct tcs_kind_row {
  tcs_memory_kind memory;
  /* On the worker: reads the file into the load; false with load->error. */
  bool (*import)(tcs_load *load, const tc_import_options *options);
  /* On the worker, after the import: passes over all voxels or triangles. False with load->error; the imported data is
   * freed. */
  bool (*dress)(tcs_load *load);
  void (*keep)(tcs_load *load, tcs_entry *entry); /* moves the import into the entry */
} tcs_kind_row;
extern const tcs_kind_row tcs_kind_volume, tcs_kind_mesh;

void tcs_series_unref(tcs_series *series); /* NULL is fine */
/* Whether the imported volume is one of several in its file, so that the file may be needed again. Worker or I/O
 * thread. */
bool tcs_load_is_of_series(const tcs_load *load);

/* Counts the memory of a volume or mesh until its last user is gone; then tcs_hold_freed() must be called with the
 * result. */
void *tcs_hold(tcs_load *load, uint64_t bytes);
void tcs_hold_freed(void *held);
/* Whether the import should continue (not cancelled, not late); bool (*)(void *). */
bool tcs_load_goes_on(void *load);

/* Adds the properties of a volume or a mesh. */
void tcs_volume_describe(cJSON *json, const tc_volume *volume, const tc_fit *fit, bool has_body);
void tcs_mesh_describe(cJSON *json, const tc_mesh *mesh, const tc_mesh_file *file, const tc_mesh_measures *measures);

/* Starts the imports that may start and fails those that cannot. Called after every change and a few times a second. */
void tcs_loads_pump(tcs_catalogue *catalogue);
/* Whether the client may load another one now; else TC_ERROR_BUSY. client NULL (the operator): always. */
bool tcs_loads_allow(const tcs_catalogue *catalogue, const char *client, GError **error);
void tcs_load_begin(tcs_catalogue *catalogue, tcs_entry *entry, const tcs_source_file *source);
/* The entry of the load was removed: drops a waiting load, cancels a running one. */
void tcs_load_leave(tcs_load *load);

/* Drops derived data, then volumes and meshes that no session shows, least recently used first and the operator's last,
 * until these bytes fit, or will fit once the last references to the dropped data are gone. False: dropping everything
 * would not suffice; nothing was dropped. */
bool tcs_room_make(tcs_catalogue *catalogue, uint64_t voxel_bytes, uint64_t more_bytes);
bool tcs_room_give(void *catalogue, uint64_t bytes, const void *spare); /* tcs_give_fn: memory other than voxels */
bool tcs_room_possible(tcs_catalogue *catalogue, uint64_t bytes);
/* Bytes the budget counts for a volume of this many voxel bytes. */
uint64_t tcs_room_of(uint64_t voxel_bytes);

uint64_t tcs_volume_bytes(const tc_volume *volume); /* with its mask of missing values and its colours */

/* Queues a job that builds the table and the acceleration structures of the resident volume's default scene while nothing
 * is drawn, so that the first picture does not wait for them. The time is charged to the client that loaded the volume. */
void tcs_preparation_begin(tcs_catalogue *catalogue, tcs_entry *entry, const char *client);
void tcs_preparation_end(tcs_entry *entry); /* cancels it; none queued is fine */

/* Bytes of a resident volume and its body, or of a mesh. */
uint64_t tcs_entry_bytes(const tcs_entry *entry);
/* Drops the entry's volume or mesh; the memory is released with the last user's reference. */
void tcs_entry_release(tcs_catalogue *catalogue, tcs_entry *entry);
void tcs_entry_fail(tcs_catalogue *catalogue, tcs_entry *entry, char *reason);

#endif
