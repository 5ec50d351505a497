/* What the catalogue's files share; nobody else includes it. I/O thread, but for what a load does on its worker. */
#ifndef TCS_CATALOGUE_OWN_H
#define TCS_CATALOGUE_OWN_H

#include <stdatomic.h>

#include "server/catalogue/catalogue.h"
#include "server/loop/worker.h"
#include "server/memory/budget.h"

struct tcs_catalogue {
  tcs_server *server;
  GHashTable *entries; /* tcs_entry by kind and id: a set */
  GQueue loads;        /* tcs_load *, oldest first: waiting and running */
  GQueue failed;       /* tcs_entry *, by failed_link, oldest first; none of the operator's */
  int running;
  bool ended; /* nothing is started any more */
};

struct tcs_load {
  tcs_task task;
  GList link;
  tcs_catalogue *catalogue;
  tcs_entry *entry; /* NULL: nobody wants it any more */
  tcs_kind kind;
  tcs_source_file source;
  char *name;
  bool running;
  int64_t asked_us;              /* when it first had to wait for memory; 0 = it never had to */
  int64_t began_us, deadline_us; /* of the run */
  atomic_bool cancel;
  atomic_int permille;
  int told; /* permille in the last report */

  /* the worker's while it runs */
  uint64_t wanted, reserved; /* bytes in all, as the header has it; taken of the budget */
  uint64_t decoder;          /* counted of the decoder's memory */
  uint64_t decoder_wanted;   /* the most it had, of all runs */
  bool refused;              /* the budget did not have `wanted`, or that */
  bool late;                 /* took longer than it may */
  bool good;                 /* all is there */
  tc_volume *volume, *body;
  tc_fit fit;
  tc_scene defaults; /* that fit it; zeros without */
  tc_mesh *mesh;
  tc_mesh_file file;
  tc_mesh_measures measures;
  GError *error;
};

/* What tells the kinds apart (volumes.c, meshes.c); all else is the same for both. */
typedef struct tcs_kind_row {
  tcs_memory_kind memory;
  /* On the worker: reads the file into the load; false with load->error. */
  bool (*import)(tcs_load *load, const tc_import_options *options);
  /* On the worker, after that: what walks all of it. False with load->error: what was imported is gone. */
  bool (*dress)(tcs_load *load);
  void (*keep)(tcs_load *load, tcs_entry *entry); /* hands over what was loaded */
} tcs_kind_row;
extern const tcs_kind_row tcs_kind_volume, tcs_kind_mesh;

void tcs_series_unref(tcs_series *series); /* NULL is fine */
/* Whether what was loaded is one of several: its file may be wanted again. Worker or I/O thread. */
bool tcs_load_is_of_series(const tcs_load *load);

/* What is counted for a volume or a mesh until the last of its users is gone: tcs_hold_freed() is to be called with it
 * then. */
void *tcs_hold(tcs_load *load, uint64_t bytes);
void tcs_hold_freed(void *held);
/* Whether a load's worker should go on; bool (*)(void *). */
bool tcs_load_goes_on(void *load);

/* Adds what there is to tell of either. */
void tcs_volume_describe(cJSON *json, const tc_volume *volume, const tc_fit *fit, bool has_body);
void tcs_mesh_describe(cJSON *json, const tc_mesh *mesh, const tc_mesh_file *file, const tc_mesh_measures *measures);

/* Starts loads that may start and gives up loads that cannot. Called after every change and a few times a second. */
void tcs_loads_pump(tcs_catalogue *catalogue);
/* Why a client may not load another one now; TC_ERROR_BUSY. Operators (NULL) always may. */
bool tcs_loads_allow(const tcs_catalogue *catalogue, const char *client, GError **error);
void tcs_load_begin(tcs_catalogue *catalogue, tcs_entry *entry, const tcs_source_file *source);
/* The load is not wanted any more: a waiting one is dropped, a running one cancelled. */
void tcs_load_leave(tcs_load *load);

/* Drops derived data, then volumes and meshes that no session shows, least recently used first and the operator's last,
 * until these bytes fit, or will fit once the dropped data have no user any more. False: dropping all would not
 * suffice; nothing was dropped. */
bool tcs_room_make(tcs_catalogue *catalogue, uint64_t voxel_bytes, uint64_t more_bytes);
bool tcs_room_give(void *catalogue, uint64_t bytes, const void *spare); /* tcs_give_fn: for what is no voxels */
bool tcs_room_possible(tcs_catalogue *catalogue, uint64_t bytes);
/* What the ledger has for a volume of this many voxel bytes. */
uint64_t tcs_room_of(uint64_t voxel_bytes);

uint64_t tcs_volume_bytes(const tc_volume *volume); /* with its mask of voxels without a value and its colours */
/* Bytes of a resident volume and its body, or of a mesh. */
uint64_t tcs_entry_bytes(const tcs_entry *entry);
/* Takes what it holds away from an entry; that goes when its last user does. */
void tcs_entry_release(tcs_catalogue *catalogue, tcs_entry *entry);
void tcs_entry_fail(tcs_catalogue *catalogue, tcs_entry *entry, char *reason);

#endif
