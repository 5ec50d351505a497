#include "server/catalogue/spool.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "server/config/config.h"
#include "server/loop/worker.h"
#include "server/observe/log.h"

#define PREFIX "tomocast-upload-"
#define FILE_NAME "upload"

struct tcs_spool {
  tcs_server *server;
  GQueue files;
  int64_t bytes;
};

/* --- sweeping -------------------------------------------------------------------------------------- */

static bool is_ours(int folder_fd, const char *name, struct stat *status) {
  return g_str_has_prefix(name, PREFIX) && fstatat(folder_fd, name, status, AT_SYMLINK_NOFOLLOW) == 0 &&
         status->st_uid == geteuid();
}

/* Removes an upload's folder if its lock is free. */
static bool sweep_folder(int spool_fd, const char *name) {
  const int fd = openat(spool_fd, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
  if (fd < 0) return false;
  const bool abandoned = flock(fd, LOCK_EX | LOCK_NB) == 0;
  if (abandoned) unlinkat(fd, FILE_NAME, 0);
  close(fd);
  return abandoned && unlinkat(spool_fd, name, AT_REMOVEDIR) == 0;
}

/* Earlier versions wrote files without a folder. A lease is granted only on a file that nobody has open. */
static bool sweep_file(int spool_fd, const char *name) {
  const int fd = openat(spool_fd, name, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  if (fd < 0) return false;
  const bool abandoned = fcntl(fd, F_SETLEASE, F_WRLCK) == 0;
  close(fd);
  return abandoned && unlinkat(spool_fd, name, 0) == 0;
}

static void sweep(const char *path) {
  DIR *folder = opendir(path);
  int swept = 0;
  struct stat status;
  if (!folder) return;
  const int fd = dirfd(folder);
  for (struct dirent *item; (item = readdir(folder));) {
    if (!is_ours(fd, item->d_name, &status)) continue;
    if (S_ISDIR(status.st_mode)) swept += sweep_folder(fd, item->d_name);
    if (S_ISREG(status.st_mode)) swept += sweep_file(fd, item->d_name);
  }
  closedir(folder);
  if (swept) tcs_log(TCS_LOG_DEBUG, "spool.swept", "uploads=%d", swept);
}

/* A daemon without uploads needs no spool, so that an unusable folder is a warning. */
static void warn_unless_usable(const char *path) {
  if (access(path, R_OK | W_OK | X_OK) != 0)
    tcs_log(TCS_LOG_WARN, "spool.unusable",
            "text=\"uploads fail until the spool folder can be written\" folder=%s reason=\"%s\"", path,
            g_strerror(errno));
}

tcs_spool *tcs_spool_new(tcs_server *server) {
  tcs_spool *spool = g_new0(tcs_spool, 1);
  spool->server = server;
  g_queue_init(&spool->files);
  warn_unless_usable(server->config->spool);
  sweep(server->config->spool);
  return spool;
}

void tcs_spool_free(tcs_spool *spool) { g_free(spool); }

/* --- one upload ------------------------------------------------------------------------------------ */

static bool may_open(const tcs_spool *spool, const char *client, GError **error) {
  const tcs_limits *limits = &spool->server->config->limits;
  int64_t uploads = 0, own = 0;
  for (const GList *item = spool->files.head; item; item = item->next) {
    const tcs_spooled *file = item->data;
    uploads += file->uploading;
    own += file->uploading && strcmp(file->client, client) == 0;
  }
  if (own >= limits->uploads_per_client)
    tc_set_error(error, TC_ERROR_BUSY, NULL,
                 "%" PRId64 " uploads of this client are under way, which is the limit; end one first", own);
  else if (uploads >= limits->uploads)
    tc_set_error(error, TC_ERROR_BUSY, NULL, "%" PRId64 " uploads are under way, which is the limit; try again later",
                 uploads);
  else if (spool->bytes >= limits->spool_bytes)
    tc_set_error(error, TC_ERROR_BUSY, NULL, "the spool for uploads is full; try again later");
  else
    return true;
  return false;
}

/* Creates and locks a folder. Another daemon that starts may sweep it between creation and lock; then it retries. */
static bool make_folder(tcs_spooled *file, const char *spool) {
  for (int attempt = 0; attempt < 4; attempt++) {
    g_free(file->folder);
    file->folder = g_build_filename(spool, PREFIX "XXXXXX", NULL);
    if (!g_mkdtemp_full(file->folder, 0700)) break;
    file->lock_fd = open(file->folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
    if (file->lock_fd >= 0) {
      (void)flock(file->lock_fd, LOCK_EX | LOCK_NB); /* without file locks other daemons sweep nothing either */
      file->fd = openat(file->lock_fd, FILE_NAME, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);
      if (file->fd >= 0) return true;
      close(file->lock_fd);
      file->lock_fd = -1;
    }
    if (errno != ENOENT) {
      rmdir(file->folder);
      break;
    }
  }
  g_clear_pointer(&file->folder, g_free);
  return false;
}

tcs_spooled *tcs_spool_open(tcs_spool *spool, const char *client, GError **error) {
  if (!may_open(spool, client, error)) return NULL;
  tcs_spooled *file = g_new0(tcs_spooled, 1);
  file->lock_fd = file->fd = -1;
  if (!make_folder(file, spool->server->config->spool)) {
    tc_set_error(error, TC_ERROR_IO, NULL, "the spool folder takes no file: %s", g_strerror(errno));
    g_free(file);
    return NULL;
  }
  file->spool = spool;
  file->uploading = true;
  file->path = g_build_filename(file->folder, FILE_NAME, NULL);
  g_strlcpy(file->client, client, sizeof file->client);
  file->link.data = file;
  g_queue_push_tail_link(&spool->files, &file->link);
  return file;
}

bool tcs_spooled_grow(tcs_spooled *file, int64_t bytes, GError **error) {
  tcs_spool *spool = file->spool;
  if (bytes > spool->server->config->limits.spool_bytes - spool->bytes) {
    tc_set_error(error, TC_ERROR_BUSY, NULL, "the spool for uploads is full; try again later");
    return false;
  }
  spool->bytes += bytes;
  file->bytes += bytes;
  return true;
}

void tcs_spooled_complete(tcs_spooled *file) { file->uploading = false; }

bool tcs_spooled_keep(tcs_spooled *file) {
  const int64_t most = file->spool->server->config->limits.spool_bytes;
  int64_t all = file->bytes, own = file->bytes;
  for (const GList *item = file->spool->files.head; item; item = item->next) {
    const tcs_spooled *other = item->data;
    all += other->kept ? other->bytes : 0;
    own += other->kept && strcmp(other->client, file->client) == 0 ? other->bytes : 0;
  }
  return file->kept = all <= most / 2 && own <= most / 4;
}

void tcs_spooled_remove(tcs_spooled *file) {
  if (file->fd >= 0) close(file->fd);
  if (file->lock_fd >= 0) {
    unlinkat(file->lock_fd, FILE_NAME, 0);
    rmdir(file->folder);
    close(file->lock_fd);
  }
  file->fd = file->lock_fd = -1;
}

typedef struct removal {
  tcs_task task;
  tcs_spooled *file;
} removal;

static void run_removal(tcs_task *task) { tcs_spooled_remove(((removal *)task)->file); }

static void done_removal(tcs_task *task) {
  tcs_spooled *file = ((removal *)task)->file;
  file->spool->bytes -= file->bytes;
  g_queue_unlink(&file->spool->files, &file->link);
  g_free(file->folder);
  g_free(file->path);
  g_free(file);
  g_free(task);
}

void tcs_spooled_free(tcs_spooled *file) {
  if (!file) return;
  removal *work = g_new0(removal, 1);
  work->task = (tcs_task){.run = run_removal, .done = done_removal};
  work->file = file;
  file->uploading = false;
  if (file->lock_fd >= 0 && file->spool->server->spool_worker) {
    tcs_worker_submit(file->spool->server->spool_worker, &work->task);
  } else {
    run_removal(&work->task);
    done_removal(&work->task);
  }
}
