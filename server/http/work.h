/* Requests that are answered by a worker: reading and printing of long documents, walks over voxels, folders and rays.
 * When the client leaves, work that has not begun is dropped, and running work is cancelled. I/O thread, but for `run`.
 */
#ifndef TCS_HTTP_WORK_H
#define TCS_HTTP_WORK_H

#include <stdatomic.h>

#include "protocol/protocol.h"
#include "server/http/http.h"
#include "server/loop/worker.h"

/* A worker reads and prints longer documents. */
#define TCS_LONG_JSON 65536

/* Embedded as the first member of what a handler needs beside, made by g_new0. */
typedef struct tcs_work tcs_work;
struct tcs_work {
  tcs_task task; /* of the worker */
  tcs_worker *worker;
  tcs_request *request;          /* NULL: the client has gone */
  atomic_bool cancel;            /* likewise, for `run` */
  void (*run)(tcs_work *work);   /* on the worker: sets text or error, or what reply needs */
  void (*reply)(tcs_work *work); /* or NULL: 200 with the text, or the error */
  void (*free)(tcs_work *work);  /* what is embedded beside; NULL: nothing. The work itself is freed after it */
  char *text;                    /* JSON, g_malloc'ed */
  GError *error;
};

/* Defers the request and submits the work, whose run, reply and free are set. most: how many works of this worker may
 * wait; with more the answer is 503 and the work is freed (false). */
bool tcs_work_start(tcs_request *request, tcs_worker *worker, tcs_work *work, int most);
/* Runs short work at once, on this thread. */
void tcs_work_inline(tcs_request *request, tcs_work *work);

/* What to do with a body that was read; lists: of the scene in it, or NULL. May reply or defer. */
typedef void (*tcs_body_use)(tcs_request *request, cJSON *body, const tcp_lists *lists);
/* Reads the request's JSON body, a long one on the text worker, and gives it to `use`; the body is freed afterwards.
 * scene: the member of the body that is a scene; "": the body itself; NULL: none is. What cannot be read is replied. */
void tcs_read_body(tcs_request *request, const char *scene, tcs_body_use use);

/* Replies `status` and the scene as it is, as member "scene" of `around` (taken) or, where that is NULL, by itself. A
 * long one is written by the text worker. location: or NULL. */
void tcs_reply_scene(tcs_request *request, int status, cJSON *around, const tc_scene *scene, const char *etag,
                     const char *location);

/* JSON text of a document, which is freed: any thread. */
char *tcs_json_text(cJSON *json);

#endif
