/* The spool: uploads as files, each in a folder of its own with nothing beside it, counted and bounded. The I/O
 * thread's, but for what says otherwise.
 *
 * A folder is locked (flock) for as long as its upload lives. Folders without a lock were left by a crash and are
 * removed at start; a locked one belongs to another daemon. */
#ifndef TCS_CATALOGUE_SPOOL_H
#define TCS_CATALOGUE_SPOOL_H

#include "renderer/base/error.h"
#include "server/server.h"

#define TCS_CLIENT_SIZE 48 /* a peer's address as text */

typedef struct tcs_spooled {
  tcs_spool *spool;
  char client[TCS_CLIENT_SIZE];
  char *folder, *path;
  int lock_fd, fd; /* of the folder; of the file, open for writing until tcs_spooled_complete() */
  int64_t bytes;   /* counted in the spool */
  bool uploading;  /* counted in the limits of uploads */
  bool kept;       /* after it was loaded, for other volumes of it */
  GList link;
} tcs_spooled;

/* Removes what earlier daemons of this user left behind. */
tcs_spool *tcs_spool_new(tcs_server *server);
void tcs_spool_free(tcs_spool *spool); /* no file is left; NULL is fine */

/* An empty file for a client's upload. TC_ERROR_BUSY (too many) or TC_ERROR_IO. */
tcs_spooled *tcs_spool_open(tcs_spool *spool, const char *client, GError **error);
/* Counts bytes that are about to be written. TC_ERROR_BUSY: the spool is full; nothing was counted. */
bool tcs_spooled_grow(tcs_spooled *file, int64_t bytes, GError **error);
/* The upload is complete: it counts as one no more. */
void tcs_spooled_complete(tcs_spooled *file);
/* It is to stay after it was loaded. False: kept files have half of the spool already, or the client's a quarter. */
bool tcs_spooled_keep(tcs_spooled *file);
/* Closes and removes file and folder; a second call does nothing. Any thread, one at a time. */
void tcs_spooled_remove(tcs_spooled *file);
/* Removes what is there, on the spool's thread, and forgets it. NULL is fine. */
void tcs_spooled_free(tcs_spooled *file);

#endif
