/* The spool: uploads as files, each alone in its own folder, counted and bounded. I/O thread unless stated otherwise.
 *
 * A folder is locked (flock) while its upload lives. Folders without a lock were left by a crash and are removed at
 * start; a locked folder belongs to another daemon. */
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
  int64_t bytes;   /* counted against the spool's size */
  bool uploading;  /* counted against the limits on uploads */
  bool kept;       /* kept after the import, for other volumes of the series */
  GList link;
} tcs_spooled;

/* Removes what earlier daemons of this user left behind. */
tcs_spool *tcs_spool_new(tcs_server *server);
void tcs_spool_free(tcs_spool *spool); /* after the last file was freed; NULL is fine */

/* Opens an empty file for a client's upload. TC_ERROR_BUSY (too many uploads, or the spool is full) or TC_ERROR_IO. */
tcs_spooled *tcs_spool_open(tcs_spool *spool, const char *client, GError **error);
/* Reserves bytes that are about to be written. TC_ERROR_BUSY: the spool is full; nothing was reserved. */
bool tcs_spooled_grow(tcs_spooled *file, int64_t bytes, GError **error);
/* The upload is complete and no longer counts against the limits on uploads. */
void tcs_spooled_complete(tcs_spooled *file);
/* Keeps the file after its import. False: kept files would exceed half of the spool, or a quarter for this client. */
bool tcs_spooled_keep(tcs_spooled *file);
/* Closes and removes file and folder; a second call does nothing. Any thread, one at a time. */
void tcs_spooled_remove(tcs_spooled *file);
/* Removes the files on the spool's thread, then frees `file`. NULL is fine. */
void tcs_spooled_free(tcs_spooled *file);

#endif
