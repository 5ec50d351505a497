/* The parent's side of DICOM: starts the helper, feeds nothing but an open descriptor, believes nothing it answers, and
 * ends it when it is silent, when the caller cancels, or when it is done.
 *
 * The helper gets the input as descriptor 3 and the pipe as descriptor 4 and no path at all, so no message of its can
 * hold one. Voxels travel over the pipe straight into the volume's storage: the parent's peak is the volume and a
 * buffer. */
#include "renderer/import/dicom.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "renderer/import/dicom_helper.h"
#include "renderer/import/dicom_wire.h"

enum {
  SILENCE_MS = 60000, /* a helper that says nothing this long hangs: it reports after every file and slice */
  POLL_MS = 20,       /* how soon a cancel is seen, and how often the helper's memory is looked at */
  CPU_SECONDS = 1800,
  HIGH_FD = 10, /* descriptors are moved above those the helper expects before it is started */
};

static const char helper_name[] = "tomocast-dicom";

/* Address space of a helper: code and libraries, then a file and its decoded form beside each other. */
static const uint64_t address_base = UINT64_C(2) << 30, address_most = UINT64_C(16) << 30;

typedef struct session {
  pid_t pid;
  int pipe;
  const tc_import_options *options;
  double fraction; /* last told */
  int status;      /* of waitpid, once reaped */
  int64_t weighed_ms;
} session;

static int64_t now_ms(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (int64_t)t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

/* ---- finding and starting the helper ---- */

static char *beside_program(void) {
  char self[PATH_MAX];
  ssize_t n = readlink("/proc/self/exe", self, sizeof self - 1);
  if (n <= 0) return NULL;
  self[n] = 0;
  char *folder = g_path_get_dirname(self), *path = g_build_filename(folder, helper_name, NULL);
  g_free(folder);
  if (access(path, X_OK) == 0) return path;
  g_free(path);
  return NULL;
}

/* The program to start; caller frees. */
static char *find_helper(const tc_import_options *options, GError **error) {
  if (options && options->dicom_helper) {
    if (access(options->dicom_helper, X_OK) == 0) return g_strdup(options->dicom_helper);
    tc_set_error(error, TC_ERROR_IO, NULL, "the DICOM helper given cannot be started: %s", g_strerror(errno));
    return NULL;
  }
  char *path = beside_program();
  if (!path) path = g_find_program_in_path(helper_name);
  if (!path)
    tc_set_error(error, TC_ERROR_IO, NULL, "the program %s was not found beside this one or in PATH; install it there",
                 helper_name);
  return path;
}

/* Opens the input: a folder or a plain file, above the descriptors the helper uses. -1 with an error. */
static int open_input(const char *path, GError **error) {
  struct stat st;
  int fd = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) {
    tc_set_error(error, errno == ENOENT || errno == ENOTDIR ? TC_ERROR_NOT_FOUND : TC_ERROR_IO, NULL, "%s",
                 g_strerror(errno));
    return -1;
  }
  if (fstat(fd, &st) != 0 || !(S_ISREG(st.st_mode) || S_ISDIR(st.st_mode))) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "neither a file nor a folder");
    close(fd);
    return -1;
  }
  int high = fcntl(fd, F_DUPFD_CLOEXEC, HIGH_FD);
  if (high < 0) tc_set_error(error, TC_ERROR_IO, NULL, "no descriptor left: %s", g_strerror(errno));
  close(fd);
  return high;
}

static bool open_pipe(int ends[2], GError **error) {
  int low[2];
  if (pipe2(low, O_CLOEXEC) != 0) {
    tc_set_error(error, TC_ERROR_IO, NULL, "no pipe: %s", g_strerror(errno));
    return false;
  }
  for (int i = 0; i < 2; i++) {
    ends[i] = fcntl(low[i], F_DUPFD_CLOEXEC, HIGH_FD);
    close(low[i]);
  }
  if (ends[0] >= 0 && ends[1] >= 0) {
    fcntl(ends[0], F_SETPIPE_SZ, TC_DICOM_CHUNK_BYTES); /* fewer switches; the default works too */
    return true;
  }
  for (int i = 0; i < 2; i++)
    if (ends[i] >= 0) close(ends[i]);
  tc_set_error(error, TC_ERROR_IO, NULL, "no descriptor left");
  return false;
}

static int spawn_with(pid_t *pid, const char *program, char *const argv[], int input, int output) {
  posix_spawn_file_actions_t files;
  posix_spawnattr_t attributes;
  sigset_t none, all;
  const char *libraries = getenv("LD_LIBRARY_PATH");
  char *library_line = libraries ? g_strconcat("LD_LIBRARY_PATH=", libraries, NULL) : NULL;
  char *environment[] = {(char[]){"LC_ALL=C"}, library_line, NULL};
  posix_spawn_file_actions_init(&files);
  posix_spawnattr_init(&attributes);
  posix_spawn_file_actions_addopen(&files, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&files, 1, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addopen(&files, 2, "/dev/null", O_WRONLY, 0); /* a decoder's complaints quote the file */
  posix_spawn_file_actions_adddup2(&files, input, TC_DICOM_INPUT_FD);
  posix_spawn_file_actions_adddup2(&files, output, TC_DICOM_OUTPUT_FD);
  posix_spawn_file_actions_addclosefrom_np(&files, TC_DICOM_OUTPUT_FD + 1);
  sigemptyset(&none);
  sigfillset(&all);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  int failed = posix_spawn(pid, program, &files, &attributes, argv, environment);
  posix_spawn_file_actions_destroy(&files);
  posix_spawnattr_destroy(&attributes);
  g_free(library_line);
  return failed;
}

static bool start(session *s, const char *path, const char *mode, const char *series, GError **error) {
  int ends[2] = {-1, -1}, input = -1, failed = -1;
  uint64_t most = s->options ? s->options->max_voxel_bytes : 0;
  uint64_t address = most && most < (address_most - address_base) / 4 ? address_base + 4 * most : address_most;
  char numbers[3][24];
  snprintf(numbers[0], sizeof numbers[0], "%" G_GUINT64_FORMAT, most);
  snprintf(numbers[1], sizeof numbers[1], "%" G_GUINT64_FORMAT, address);
  snprintf(numbers[2], sizeof numbers[2], "%d", CPU_SECONDS);
  char *program = find_helper(s->options, error), *mode_copy = g_strdup(mode),
       *series_copy = g_strdup(series ? series : "");
  if (program && (input = open_input(path, error)) >= 0 && open_pipe(ends, error)) {
    char landlock[] = "yes";
    if (g_strcmp0(g_getenv("TOMOCAST_WITHOUT_LANDLOCK"), "1") == 0) strcpy(landlock, "no");
    char *argv[] = {program, mode_copy, series_copy, numbers[0], numbers[1], numbers[2], landlock, NULL};
    failed = spawn_with(&s->pid, program, argv, input, ends[1]);
    if (failed) tc_set_error(error, TC_ERROR_IO, NULL, "the DICOM helper did not start: %s", g_strerror(failed));
  }
  if (input >= 0) close(input);
  if (ends[1] >= 0) close(ends[1]);
  if (failed && ends[0] >= 0) close(ends[0]);
  s->pipe = failed ? -1 : ends[0];
  g_free(program);
  g_free(mode_copy);
  g_free(series_copy);
  return failed == 0;
}

/* ---- listening ---- */

static bool tell(void *user, double fraction) {
  session *s = user;
  s->fraction = fraction;
  return !s->options || !s->options->progress || s->options->progress(s->options->user, fraction);
}

static bool reserve(void *user, uint64_t bytes, GError **error) {
  const session *s = user;
  return !s->options || !s->options->reserve || s->options->reserve(s->options->user, bytes, error);
}

/* Whether sealing may go on. */
static bool keeps_on(void *user) { return tell(user, 1); }

/* The pipe ended too early: says how the helper died, without a word of what it read. */
static bool died(session *s, GError **error) {
  const char *how = "the DICOM decoder broke off; the file is probably damaged";
  if (s->pid > 0 && waitpid(s->pid, &s->status, 0) == s->pid) {
    s->pid = 0;
    if (WIFSIGNALED(s->status))
      how = WTERMSIG(s->status) == SIGXCPU || WTERMSIG(s->status) == SIGKILL
                ? "the DICOM decoder was stopped: it needed more than it is allowed"
                : "the DICOM decoder crashed on this input, which is probably damaged";
    else if (WIFEXITED(s->status) && WEXITSTATUS(s->status) == 127)
      how = "the DICOM helper did not start";
  }
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "%s", how);
  return false;
}

/* The helper's memory but for what it maps of files, which the system may take back. */
static uint64_t helper_bytes(const session *s) {
  char path[40], text[100] = "";
  unsigned long long size, resident = 0, shared = 0;
  snprintf(path, sizeof path, "/proc/%d/statm", (int)s->pid);
  FILE *file = fopen(path, "re");
  if (file && fgets(text, sizeof text, file) && sscanf(text, "%llu %llu %llu", &size, &resident, &shared) != 3) resident = 0;
  if (file) fclose(file);
  return resident > shared ? (resident - shared) * (uint64_t)sysconf(_SC_PAGESIZE) : 0;
}

/* False: it has more than there is. */
static bool weigh(session *s, GError **error) {
  const tc_import_options *o = s->options;
  if (!o || !o->decoder || now_ms() - s->weighed_ms < POLL_MS) return true;
  s->weighed_ms = now_ms();
  return o->decoder(o->user, helper_bytes(s), error);
}

/* tc_dicom_read_fn: exactly `size` bytes from the pipe, watching for silence and for a cancel. */
static bool read_pipe(void *user, void *bytes, size_t size, GError **error) {
  session *s = user;
  char *at = bytes;
  int64_t deadline = now_ms() + SILENCE_MS;
  while (size > 0) {
    struct pollfd p = {.fd = s->pipe, .events = POLLIN};
    int ready = poll(&p, 1, POLL_MS);
    if (!weigh(s, error)) return false;
    if (ready == 0) {
      if (!tell(s, s->fraction)) {
        tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled while reading DICOM");
        return false;
      }
      if (now_ms() < deadline) continue;
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "the DICOM decoder hung for %d s and was stopped", SILENCE_MS / 1000);
      return false;
    }
    if (ready < 0 && errno == EINTR) continue;
    ssize_t n = read(s->pipe, at, size);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return died(s, error);
    at += n;
    size -= (size_t)n;
    deadline = now_ms() + SILENCE_MS;
  }
  return true;
}

/* Always kills: a helper that has said END has nothing left to do, any other deserves it. */
static void stop(session *s) {
  if (s->pipe >= 0) close(s->pipe);
  if (s->pid <= 0) return;
  kill(s->pid, SIGKILL);
  while (waitpid(s->pid, &s->status, 0) < 0 && errno == EINTR)
    continue;
}

static tc_dicom_wire_reader reader_for(session *s) {
  return (tc_dicom_wire_reader){.read = read_pipe,
                                .user = s,
                                .tick = tell,
                                .reserve = reserve,
                                .tick_user = s,
                                .max_voxel_bytes = s->options ? s->options->max_voxel_bytes : 0};
}

tc_volume *tc_import_dicom(const char *path, const char *series, const tc_import_options *options, GError **error) {
  session s = {.pipe = -1, .options = options};
  tc_volume *volume = NULL;
  if (start(&s, path, "load", series, error)) {
    tc_dicom_wire_reader reader = reader_for(&s);
    volume = tc_dicom_wire_load(&reader, error);
  }
  stop(&s);
  if (volume && !tc_volume_seal_while(volume, keeps_on, &s)) {
    tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled while reading DICOM");
    tc_volume_unref(g_steal_pointer(&volume));
  }
  return volume;
}

bool tc_import_dicom_list(const char *path, const tc_import_options *options, tc_series **series, size_t *count,
                          GError **error) {
  session s = {.pipe = -1, .options = options};
  bool ok = false;
  *series = NULL;
  *count = 0;
  if (start(&s, path, "list", NULL, error)) {
    tc_dicom_wire_reader reader = reader_for(&s);
    ok = tc_dicom_wire_list(&reader, series, count, error);
  }
  stop(&s);
  return ok;
}
