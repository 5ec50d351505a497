/* Requests answered by a worker: parsing and printing of long documents, walks over voxels and folders, rays. When the
 * client leaves, waiting work is dropped and running work is cancelled. I/O thread, except for `run`. */
#ifndef TCS_HTTP_WORK_H
#define TCS_HTTP_WORK_H

#include <stdatomic.h>

#include "protocol/protocol.h"
#include "server/http/http.h"
#include "server/loop/worker.h"

/* Longer documents are parsed and printed by a worker. */
#define TCS_LONG_JSON 65536

/* Embed as the first member of the handler's struct, allocated by g_new0. */
typedef struct tcs_work tcs_work;
struct tcs_work {
  tcs_task task; /* the worker's */
  tcs_worker *worker;
  tcs_request *request;          /* NULL: the client left */
  atomic_bool cancel;            /* true when the client left; for `run` */
  void (*run)(tcs_work *work);   /* on the worker: sets text or error, or whatever `reply` uses */
  void (*reply)(tcs_work *work); /* or NULL: 200 with the text, or the error */
  void (*free)(tcs_work *work);  /* frees the members after `work`, but not the struct; may be NULL */
  char *text;                    /* JSON, g_malloc'ed */
  GError *error;
};

/* Defers the request and submits the work, with run, reply and free set. most: limit on waiting works of this worker;
 * beyond it replies 503 and frees the work (false). */
bool tcs_work_start(tcs_request *request, tcs_worker *worker, tcs_work *work, int most);
/* Runs short work immediately, on this thread. */
void tcs_work_inline(tcs_request *request, tcs_work *work);

/* Handles a parsed body. lists: of the scene in the body, or NULL. May reply or defer. */
typedef void (*tcs_body_use)(tcs_request *request, cJSON *body, const tcp_lists *lists);
/* Parses the request's JSON body, a long one on the text worker, passes it to `use` and frees it. scene: name of the
 * member that is a scene; "": the body itself is one; NULL: none. Replies if the body is invalid. */
void tcs_read_body(tcs_request *request, const char *scene, tcs_body_use use);

/* Replies with `status` and the current scene, as member "scene" of `around` (taken) or alone (NULL). A long scene is
 * printed by the text worker. location: may be NULL. */
void tcs_reply_scene(tcs_request *request, int status, cJSON *around, const tc_scene *scene, const char *etag,
                     const char *location);

/* JSON text of a document; frees the document. Any thread. */
char *tcs_json_text(cJSON *json);

#endif
