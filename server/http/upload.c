/* Uploads: the body is written to a file in the spool as it arrives, never held in memory as a whole and never written
 * on the I/O thread.
 *
 * Double buffering: one buffer is filled from the connection while the other is written. Backpressure: the connection
 * is suspended while both are full. */
#include <errno.h>
#include <string.h>
#include <unistd.h>

#include "server/catalogue/catalogue.h"
#include "server/http/http.h"
#include "server/loop/worker.h"
#include "server/memory/budget.h"

#define BUFFER (256 << 10) /* soft limit: the connection may deliver one more read */

struct tcs_upload {
  tcs_task task; /* runs on the spool's thread; `writing` belongs to it while `busy` */
  tcs_server *server;
  tcs_request *request; /* NULL: the client left */
  tcs_spooled *file;
  GByteArray *filling, *writing;
  bool busy, ended;
  int failed;                      /* errno of a write */
  int64_t bytes;                   /* received so far */
  int64_t window_us, window_bytes; /* start of the rate window; `bytes` then */
  GList link;                      /* in `uploads` */
};

/* All uploads. I/O thread. */
static GQueue uploads = G_QUEUE_INIT;

tcs_upload *tcs_upload_begin(tcs_request *request) {
  tcs_server *server = request->server;
  GError *error = NULL;
  char *client = tcs_peer_name(request);
  tcs_spooled *file = NULL;
  if (tcs_put_allowed(request, client, &error)) file = tcs_spool_open(server->spool, client, &error);
  g_free(client);
  if (!file) {
    tcs_reply_error(request, error);
    g_clear_error(&error);
    return NULL;
  }
  tcs_upload *upload = g_new0(tcs_upload, 1);
  *upload = (tcs_upload){.server = server,
                         .request = request,
                         .file = file,
                         .filling = g_byte_array_new(),
                         .writing = g_byte_array_new(),
                         .window_us = g_get_monotonic_time()};
  upload->link.data = upload;
  g_queue_push_tail_link(&uploads, &upload->link);
  return upload;
}

static void free_upload(tcs_upload *upload) {
  tcs_budget_give(upload->server->budget, TCS_MEMORY_UPLOADS, upload->filling->len);
  g_queue_unlink(&uploads, &upload->link);
  g_byte_array_unref(upload->filling);
  g_byte_array_unref(upload->writing);
  tcs_spooled_free(upload->file);
  g_free(upload);
}

static void resume(tcs_upload *upload) {
  if (!upload->request || upload->ended || !upload->request->suspended) return; /* others suspend later */
  upload->request->suspended = false;
  upload->server->http_work = true;
  upload->window_us = g_get_monotonic_time(); /* a suspended client could not send */
  upload->window_bytes = upload->bytes;
  MHD_resume_connection(upload->request->connection);
}

/* Detaches and discards the upload: the request has its reply, or ends. */
static void drop(tcs_upload *upload) {
  resume(upload);
  upload->request->upload = NULL;
  upload->request = NULL;
  if (!upload->busy) free_upload(upload);
}

void tcs_upload_leave(tcs_request *request) {
  if (!request->upload) return;
  request->suspended = false; /* the connection is closing */
  drop(request->upload);
}

/* --- writing --------------------------------------------------------------------------------------- */

static void run_write(tcs_task *task) {
  tcs_upload *upload = (tcs_upload *)task;
  const uint8_t *at = upload->writing->data;
  for (size_t left = upload->writing->len; left > 0 && !upload->failed;) {
    const ssize_t wrote = write(upload->file->fd, at, left);
    if (wrote < 0 && errno != EINTR) upload->failed = errno;
    if (wrote <= 0) continue;
    at += wrote;
    left -= (size_t)wrote;
  }
}

static void say_failed(tcs_upload *upload) {
  GError *error = NULL;
  if (upload->failed == ENOSPC || upload->failed == EDQUOT)
    tc_set_error(&error, TC_ERROR_BUSY, NULL, "the disk of the server's spool folder is full; try again later, or ask "
                                              "the operator to free space there");
  else
    tc_set_error(&error, TC_ERROR_IO, NULL, "writing the upload: %s", g_strerror(upload->failed));
  tcs_request *request = upload->request;
  const bool in_body = !upload->ended;
  drop(upload);
  tcs_reply_error(request, error);
  if (in_body) tcs_http_cut(request);
  g_clear_error(&error);
}

static void pump(tcs_upload *upload);

static void done_write(tcs_task *task) {
  tcs_upload *upload = (tcs_upload *)task;
  upload->busy = false;
  tcs_budget_give(upload->server->budget, TCS_MEMORY_UPLOADS, upload->writing->len);
  g_byte_array_set_size(upload->writing, 0);
  if (!upload->request)
    free_upload(upload);
  else if (upload->failed)
    say_failed(upload);
  else
    pump(upload);
}

/* Everything is written: starts the import of the file. */
static void complete(tcs_upload *upload) {
  tcs_request *request = upload->request;
  tcs_spooled *file = g_steal_pointer(&upload->file);
  upload->server->metrics->uploads++;
  drop(upload);
  tcs_put_entry_done(request, file);
}

static void pump(tcs_upload *upload) {
  if (upload->busy) return;
  if (upload->filling->len > 0) {
    GByteArray *full = upload->filling;
    upload->filling = upload->writing;
    upload->writing = full;
    upload->busy = true;
    upload->task = (tcs_task){.run = run_write, .done = done_write};
    tcs_worker_submit(upload->server->spool_worker, &upload->task);
    resume(upload);
  } else if (upload->ended) {
    complete(upload);
  }
}

void tcs_upload_write(tcs_request *request, const void *bytes, size_t size) {
  tcs_upload *upload = request->upload;
  GError *error = NULL;
  if (upload->bytes + (int64_t)size > upload->server->config->limits.upload_bytes) {
    drop(upload);
    tcs_reply_problem(request, 413, "limit", "Too large", "the upload is over the limit, which /v1/about shows");
    return;
  }
  if (!tcs_spooled_grow(upload->file, (int64_t)size, &error)) {
    drop(upload);
    tcs_reply_error(request, error);
    g_clear_error(&error);
    return;
  }
  g_byte_array_append(upload->filling, bytes, (guint)size);
  tcs_budget_count(upload->server->budget, TCS_MEMORY_UPLOADS, size);
  upload->bytes += (int64_t)size;
  upload->server->metrics->upload_bytes += size;
  pump(upload);
  if (upload->filling->len < BUFFER) return;
  request->suspended = true;
  MHD_suspend_connection(request->connection);
}

/* Does not clear `suspended`: the connection is closed by the code that wakes it, which needs the flag. */
static void leave_ended(tcs_request *request) { drop(request->upload); }

void tcs_upload_end(tcs_request *request) {
  tcs_upload *upload = request->upload;
  upload->ended = true;
  if (upload->busy || upload->filling->len > 0) tcs_defer(request, leave_ended, upload);
  pump(upload);
}

/* --- slow uploads ---------------------------------------------------------------------------------- */

void tcs_uploads_tick(tcs_server *server, int64_t now_us) {
  const tcs_limits *limits = &server->config->limits;
  for (GList *item = uploads.head, *next; item; item = next) {
    tcs_upload *upload = item->data;
    next = item->next;
    const int64_t passed_us = now_us - upload->window_us;
    if (!upload->request || upload->ended || upload->request->suspended ||
        passed_us < limits->upload_grace_seconds * 1000000)
      continue;
    const double rate = (double)(upload->bytes - upload->window_bytes) / ((double)passed_us / 1e6);
    upload->window_us = now_us;
    upload->window_bytes = upload->bytes;
    if (rate < (double)limits->upload_rate) {
      tcs_request *request = upload->request;
      drop(upload);
      tcs_reply_problem(request, 408, "slow", "Too slow", "the upload is slower than the minimum rate, which /v1/about shows");
      tcs_http_cut(request);
    }
  }
}

void tcs_uploads_drain(tcs_server *server) {
  for (GList *item = uploads.head, *next; item; item = next) {
    tcs_upload *upload = item->data;
    tcs_request *request = upload->request;
    next = item->next;
    if (!request || upload->ended) continue;
    drop(upload);
    tcs_reply_draining(request);
    tcs_http_cut(request);
  }
}

void tcs_uploads_abandon(tcs_server *server) {
  for (GList *item = uploads.head, *next; item; item = next) {
    tcs_upload *upload = item->data;
    next = item->next;
    if (!upload->request) continue;
    upload->request->cut = true;
    drop(upload);
  }
}
