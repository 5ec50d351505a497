/* Uploads: the body goes to a file in the spool folder as it comes, never into memory as a whole. */
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "server/catalogue/catalogue.h"
#include "server/http/http.h"

struct tcs_upload {
  char *path;
  int fd;
  int64_t size;
};

static void refuse(tcs_request *request, tc_error_code code, const char *doing) {
  GError *error = NULL;
  tc_set_error(&error, code, NULL, "%s: %s", doing, g_strerror(errno));
  tcs_reply_error(request, error);
  g_clear_error(&error);
}

tcs_upload *tcs_upload_begin(tcs_request *request) {
  GError *error = NULL;
  if (!tcs_catalogue_may_load(request->server->catalogue, request->params[0], &error)) {
    tcs_reply_error(request, error);
    g_clear_error(&error);
    return NULL;
  }
  tcs_upload *upload = g_new0(tcs_upload, 1);
  upload->path = g_build_filename(request->server->config->spool, "tomocast-upload-XXXXXX", NULL);
  upload->fd = g_mkstemp_full(upload->path, O_RDWR | O_CLOEXEC, 0600);
  if (upload->fd >= 0) return upload;
  refuse(request, TC_ERROR_IO, "the spool folder takes no file");
  g_free(upload->path);
  g_free(upload);
  return NULL;
}

void tcs_upload_free(tcs_upload *upload) {
  if (!upload) return;
  if (upload->fd >= 0) close(upload->fd);
  if (upload->path) unlink(upload->path);
  g_free(upload->path);
  g_free(upload);
}

static void drop(tcs_request *request) {
  tcs_upload_free(request->upload);
  request->upload = NULL;
}

bool tcs_upload_write(tcs_request *request, const void *bytes, size_t size) {
  tcs_upload *upload = request->upload;
  if (upload->size + (int64_t)size > request->server->config->limits.upload_bytes) {
    tcs_reply_problem(request, 413, "limit", "Too large", "the upload is over the limit; /v1/about tells it");
    drop(request);
    return false;
  }
  for (const char *at = bytes; size > 0;) {
    const ssize_t wrote = write(upload->fd, at, size);
    if (wrote < 0 && errno == EINTR) continue;
    if (wrote < 0) {
      refuse(request, errno == ENOSPC ? TC_ERROR_MEMORY : TC_ERROR_IO, "writing the upload");
      drop(request);
      return false;
    }
    at += wrote;
    size -= (size_t)wrote;
    upload->size += wrote;
    request->server->metrics->upload_bytes += (uint64_t)wrote;
  }
  return true;
}

char *tcs_upload_finish(tcs_request *request) {
  tcs_upload *upload = request->upload;
  const bool closed = close(upload->fd) == 0;
  upload->fd = -1;
  if (!closed) {
    refuse(request, TC_ERROR_IO, "writing the upload");
    drop(request);
    return NULL;
  }
  char *path = g_steal_pointer(&upload->path);
  drop(request);
  request->server->metrics->uploads++;
  return path;
}
