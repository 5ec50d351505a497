/* The daemon's side of decoding: starts a helper process, passes it an open descriptor and no path, validates every
 * answer, and kills it when it is silent, cancelled or done. The daemon opens the data files that a header names,
 * only in the input's folder and only if the options allow it. */
#include "renderer/import/helper.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "renderer/import/beside.h"
#include "renderer/import/links.h"
#include "renderer/import/wire.h"

enum {
  SILENCE_MS = 60000, /* a helper reports after every file and slice; one silent for this long hangs */
  WALL_MS = 3600000,
  POLL_MS = 20, /* interval of checks for a cancel and for the helper's memory */
  CPU_SECONDS = 1800,
  HIGH_FD = TC_HELPER_LINKS_FD +
            TC_LINK_ROOTS, /* descriptors are moved above the numbers that the helper expects */
};

static const char *const program_names[TC_HELPER_COUNT] = {"tomocast-import", "tomocast-dicom", "tomocast-minc"};

/* Address space limit of a helper: code and libraries, plus the file and its decoded form at the same time. */
static const uint64_t address_base = UINT64_C(2) << 30, address_most = UINT64_C(16) << 30;

typedef struct session {
  const char *path;
  const tc_import_options *options; /* NULL: none */
  pid_t pid;
  int input, socket, ring_fd; /* -1: not open */
  int links[TC_LINK_ROOTS];
  uint32_t n_links;
  uint8_t *ring;
  double fraction; /* last reported */
  int status;      /* from waitpid(), once reaped */
  int64_t began_ms, looked_ms;
} session;

static int64_t now_ms(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (int64_t)t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

/* ---- finding and starting the helper ---- */

static char *program_folder(void) {
  char self[PATH_MAX];
  ssize_t n = readlink("/proc/self/exe", self, sizeof self - 1);
  if (n <= 0) return NULL;
  self[n] = 0;
  return g_path_get_dirname(self);
}

/* Path of the helper program; the caller frees it. */
static char *find_program(const tc_import_options *options, const char *name, GError **error) {
  const char *given = options ? options->helpers : NULL;
  char *folder = given ? g_strdup(given) : program_folder(),
       *path = g_build_filename(folder ? folder : ".", name, NULL);
  g_free(folder);
  if (access(path, X_OK) == 0) return path;
  g_free(path);
  path = given ? NULL : g_find_program_in_path(name);
  if (!path)
    tc_set_error(error, TC_ERROR_IO, NULL, "the program %s was not found %s; install it there", name,
                 given ? "where it is said to be" : "beside this one or in PATH");
  return path;
}

/* Moves a descriptor above those that the helper uses. Takes ownership of fd. */
static int move_high(int fd, GError **error) {
  const int high = fcntl(fd, F_DUPFD_CLOEXEC, HIGH_FD);
  close(fd);
  if (high < 0) tc_set_error(error, TC_ERROR_IO, NULL, "no descriptor left: %s", g_strerror(errno));
  return high;
}

/* The input: a folder or a plain file. */
static bool open_input(session *s, GError **error) {
  struct stat st;
  int fd = open(s->path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) {
    tc_set_error(error, errno == ENOENT || errno == ENOTDIR ? TC_ERROR_NOT_FOUND : TC_ERROR_IO, NULL, "%s",
                 g_strerror(errno));
    return false;
  }
  if (fstat(fd, &st) != 0 || !(S_ISREG(st.st_mode) || S_ISDIR(st.st_mode))) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "not a regular file or folder");
    close(fd);
    return false;
  }
  return (s->input = move_high(fd, error)) >= 0;
}

/* Opens the link roots: the helper may follow links into these folders. */
static bool open_links(session *s, GError **error) {
  struct stat st;
  if ((s->options && s->options->self_contained) || fstat(s->input, &st) != 0 || !S_ISDIR(st.st_mode)) return true;
  for (; s->n_links < tc_links_count(); s->n_links++) {
    const int fd = open(tc_links_root(s->n_links), O_PATH | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) {
      tc_set_error(error, TC_ERROR_IO, NULL, "a link root cannot be opened: %s", g_strerror(errno));
      return false;
    }
    if ((s->links[s->n_links] = move_high(fd, error)) < 0) return false;
  }
  return true;
}

/* Creates the shared memory. Its size is sealed, so the helper cannot change it. */
static bool open_ring(session *s, GError **error) {
  const int fd = memfd_create("voxels", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (fd >= 0 && ftruncate(fd, TC_WIRE_RING_BYTES) == 0 &&
      fcntl(fd, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL) == 0) {
    void *ring = mmap(NULL, TC_WIRE_RING_BYTES, PROT_READ, MAP_SHARED, fd, 0);
    s->ring = ring == MAP_FAILED ? NULL : ring;
  }
  if (s->ring) return (s->ring_fd = move_high(fd, error)) >= 0;
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "no memory to share with the decoder: %s", g_strerror(errno));
  if (fd >= 0) close(fd);
  return false;
}

static bool open_socket(session *s, int *other, GError **error) {
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) {
    tc_set_error(error, TC_ERROR_IO, NULL, "no socket: %s", g_strerror(errno));
    return false;
  }
  s->socket = ends[0];
  return (*other = move_high(ends[1], error)) >= 0;
}

static int spawn_with(session *s, char *program, int socket) {
  posix_spawn_file_actions_t files;
  posix_spawnattr_t attributes;
  sigset_t none, all;
  const char *libraries = getenv("LD_LIBRARY_PATH");
  char *library_line = libraries ? g_strconcat("LD_LIBRARY_PATH=", libraries, NULL) : NULL;
  char *environment[] = {(char[]){"LC_ALL=C"}, library_line, NULL}, *argv[] = {program, NULL};
  posix_spawn_file_actions_init(&files);
  posix_spawnattr_init(&attributes);
  posix_spawn_file_actions_addopen(&files, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&files, 1, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addopen(&files, 2, "/dev/null", O_WRONLY, 0); /* decoders quote the file in their messages */
  posix_spawn_file_actions_adddup2(&files, s->input, TC_HELPER_INPUT_FD);
  posix_spawn_file_actions_adddup2(&files, socket, TC_HELPER_SOCKET_FD);
  posix_spawn_file_actions_adddup2(&files, s->ring_fd, TC_HELPER_RING_FD);
  for (uint32_t i = 0; i < s->n_links; i++)
    posix_spawn_file_actions_adddup2(&files, s->links[i], TC_HELPER_LINKS_FD + (int)i);
  posix_spawn_file_actions_addclosefrom_np(&files, TC_HELPER_LINKS_FD + (int)s->n_links);
  sigemptyset(&none);
  sigfillset(&all);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  int failed = posix_spawn(&s->pid, program, &files, &attributes, argv, environment);
  posix_spawn_file_actions_destroy(&files);
  posix_spawnattr_destroy(&attributes);
  g_free(library_line);
  return failed;
}

static bool send_request(const session *s, tc_helper_request *request, const char *choice, GError **error) {
  const uint64_t most = s->options ? s->options->max_voxel_bytes : 0;
  char *name = g_path_get_basename(s->path);
  request->max_voxel_bytes = most;
  request->address_bytes = most && most < (address_most - address_base) / 4 ? address_base + 4 * most : address_most;
  request->cpu_seconds = CPU_SECONDS;
  request->volume = s->options ? s->options->volume : 0;
  request->self_contained = s->options && s->options->self_contained;
  request->link_roots = s->n_links;
  request->bridge_nothing = s->options && s->options->bridge_nothing;
  request->patient = s->options && s->options->patient;
  request->without_landlock = g_strcmp0(g_getenv("TOMOCAST_WITHOUT_LANDLOCK"), "1") == 0;
  g_strlcpy(request->name, name, sizeof request->name);
  g_free(name);
  if (g_strlcpy(request->choice, choice ? choice : "", sizeof request->choice) >= sizeof request->choice) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "what follows the '#' is too long");
    return false;
  }
  send(s->socket, request, sizeof *request, MSG_NOSIGNAL); /* a helper that has died shows at the next read */
  return true;
}

typedef enum task { LOAD_VOLUME, LOAD_MESH, LIST_SERIES } task;

static bool start(session *s, tc_helper helper, const char *choice, task what, GError **error) {
  tc_helper_request request = {.list = what == LIST_SERIES, .mesh = what == LOAD_MESH};
  int other = -1, failed = -1;
  char *program = find_program(s->options, program_names[helper], error);
  s->began_ms = now_ms();
  if (program && open_input(s, error) && open_links(s, error) && open_ring(s, error) && open_socket(s, &other, error)) {
    failed = spawn_with(s, program, other);
    if (failed) tc_set_error(error, TC_ERROR_IO, NULL, "the decoder did not start: %s", g_strerror(failed));
  }
  if (other >= 0) close(other);
  g_free(program);
  return failed == 0 && send_request(s, &request, choice, error);
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

/* Reports progress while a volume is sealed; false: cancelled. */
static bool keeps_on(void *user) { return tell(user, 1); }

/* Error for a stream that ended early: says how the helper died and quotes nothing of the input. */
static bool died(session *s, GError **error) {
  const char *how = "the decoder broke off; the file is probably damaged";
  if (s->pid > 0 && waitpid(s->pid, &s->status, 0) == s->pid) {
    s->pid = 0;
    if (WIFSIGNALED(s->status))
      how = WTERMSIG(s->status) == SIGXCPU || WTERMSIG(s->status) == SIGKILL
                ? "the decoder was stopped: it needed more than it is allowed"
                : "the decoder crashed on this input, which is probably damaged";
    else if (WIFEXITED(s->status) && WEXITSTATUS(s->status) == 127)
      how = "the decoder did not start: one of its libraries is missing (ldd tomocast-import, -dicom or -minc names it)";
  }
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "%s", how);
  return false;
}

/* The helper's own memory, without the pages of mapped files, which the system can reclaim. */
static uint64_t helper_bytes(const session *s) {
  char path[40], text[100] = "";
  unsigned long long size, resident = 0, shared = 0;
  snprintf(path, sizeof path, "/proc/%d/statm", (int)s->pid);
  FILE *file = fopen(path, "re");
  if (file && fgets(text, sizeof text, file) && sscanf(text, "%llu %llu %llu", &size, &resident, &shared) != 3)
    resident = 0;
  if (file) fclose(file);
  return resident > shared ? (resident - shared) * (uint64_t)sysconf(_SC_PAGESIZE) : 0;
}

/* At intervals, even while messages keep coming: checks for a cancel and for the helper's memory against the budget. */
static bool may_go_on(session *s, GError **error) {
  const tc_import_options *o = s->options;
  if (now_ms() - s->looked_ms < POLL_MS) return true;
  s->looked_ms = now_ms();
  if (!tell(s, s->fraction)) {
    tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
    return false;
  }
  return !o || !o->decoder || o->decoder(o->user, helper_bytes(s), error);
}

/* Waits a moment for input; false if the helper has been silent for too long. */
static bool may_wait(session *s, int64_t since_ms, GError **error) {
  struct pollfd p = {.fd = s->socket, .events = POLLIN};
  if (poll(&p, 1, POLL_MS) != 0) return true;
  if (now_ms() - since_ms < SILENCE_MS) return true;
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "the decoder hung for %d s and was stopped", SILENCE_MS / 1000);
  return false;
}

/* A tc_wire_read_fn: reads exactly `size` bytes. */
static bool read_socket(void *user, void *bytes, size_t size, GError **error) {
  session *s = user;
  char *at = bytes;
  for (int64_t since_ms = now_ms(); size > 0;) {
    if (!may_go_on(s, error)) return false;
    const ssize_t n = recv(s->socket, at, size, MSG_DONTWAIT);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno == EAGAIN) {
      if (!may_wait(s, since_ms, error)) return false;
      continue;
    }
    if (n <= 0) return died(s, error);
    at += n;
    size -= (size_t)n;
    since_ms = now_ms();
  }
  if (now_ms() - s->began_ms < WALL_MS) return true;
  tc_set_error(error, TC_ERROR_LIMIT, NULL, "the decoder was stopped: it took longer than an hour");
  return false;
}

static void reply(void *user, char what, int fd) {
  const session *s = user;
  union {
    struct cmsghdr align;
    char bytes[CMSG_SPACE(sizeof fd)];
  } control = {0};
  struct iovec part = {&what, 1};
  struct msghdr message = {.msg_iov = &part, .msg_iovlen = 1};
  if (fd >= 0) {
    message.msg_control = &control;
    message.msg_controllen = sizeof control;
    struct cmsghdr *header = CMSG_FIRSTHDR(&message);
    *header = (struct cmsghdr){.cmsg_level = SOL_SOCKET, .cmsg_type = SCM_RIGHTS, .cmsg_len = CMSG_LEN(sizeof fd)};
    memcpy(CMSG_DATA(header), &fd, sizeof fd);
  }
  /* never blocks: a helper that does not read its replies would hold this thread past every limit */
  while (sendmsg(s->socket, &message, MSG_NOSIGNAL | MSG_DONTWAIT) < 0 && errno == EINTR) continue;
}

/* Opens a file that the header names or that belongs to the input. */
static int open_beside(void *user, const char *name, bool optional, GError **error) {
  const session *s = user;
  if (s->options && s->options->self_contained) {
    if (!optional)
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "the header names another file; upload header and voxels as one");
    return -1;
  }
  char *path = g_path_get_dirname(s->path);
  const int folder = open(path, O_RDONLY | O_CLOEXEC | O_DIRECTORY);
  const int fd = tc_beside_open(folder, name, optional ? NULL : error);
  if (folder >= 0) close(folder);
  g_free(path);
  return fd;
}

/* Always kills the helper: after END it has nothing left to do, and otherwise it has failed. */
static void stop(session *s) {
  if (s->pid > 0) kill(s->pid, SIGKILL);
  while (s->pid > 0 && waitpid(s->pid, &s->status, 0) < 0 && errno == EINTR) continue;
  for (int *fd = (int[]){s->input, s->socket, s->ring_fd, -2}; *fd != -2; fd++)
    if (*fd >= 0) close(*fd);
  for (uint32_t i = 0; i < s->n_links; i++) close(s->links[i]);
  if (s->ring) munmap(s->ring, TC_WIRE_RING_BYTES);
}

static session session_for(const char *path, const tc_import_options *options) {
  return (session){.path = path, .options = options, .input = -1, .socket = -1, .ring_fd = -1};
}

static tc_wire_reader reader_for(session *s) {
  return (tc_wire_reader){.read = read_socket,
                          .user = s,
                          .reply = reply,
                          .open = open_beside,
                          .tick = tell,
                          .reserve = reserve,
                          .ring = s->ring,
                          .max_voxel_bytes = s->options ? s->options->max_voxel_bytes : 0};
}

/* True once if the helper named another helper: the format of a packed file is known only after unpacking. */
static bool is_elsewhere(tc_helper *helper, bool *asked, GError **error) {
  if (!*error || (*error)->code < TC_WIRE_ELSEWHERE) return false;
  const bool first = !*asked;
  *asked = true;
  *helper = (tc_helper)((*error)->code - TC_WIRE_ELSEWHERE);
  g_clear_error(error);
  if (!first) tc_set_error(error, TC_ERROR_FORMAT, NULL, "the file is packed more than once: unpack it first");
  return first;
}

tc_volume *tc_helper_load(tc_helper helper, const char *path, const char *choice, const tc_import_options *options,
                          GError **error) {
  session s;
  tc_volume *volume = NULL;
  GError *trouble = NULL;
  bool asked = false;
  do {
    s = session_for(path, options);
    if (start(&s, helper, choice, LOAD_VOLUME, &trouble)) {
      tc_wire_reader reader = reader_for(&s);
      volume = tc_wire_load(&reader, &trouble);
    }
    stop(&s);
  } while (is_elsewhere(&helper, &asked, &trouble));
  if (trouble) g_propagate_error(error, trouble);
  if (volume && !tc_volume_seal_while(volume, keeps_on, &s)) {
    tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
    tc_volume_unref(g_steal_pointer(&volume));
  }
  return volume;
}

tc_mesh *tc_helper_load_mesh(const char *path, const char *choice, const tc_import_options *options,
                             tc_mesh_file *source, GError **error) {
  session s = session_for(path, options);
  tc_mesh *mesh = NULL;
  if (start(&s, TC_HELPER_FORMATS, choice, LOAD_MESH, error)) {
    tc_wire_reader reader = reader_for(&s);
    mesh = tc_wire_load_mesh(&reader, source, error);
  }
  stop(&s);
  return mesh;
}

bool tc_helper_list(const char *path, const tc_import_options *options, tc_series **series, size_t *count,
                    GError **error) {
  session s = session_for(path, options);
  bool ok = false;
  *series = NULL;
  *count = 0;
  if (start(&s, TC_HELPER_DICOM, NULL, LIST_SERIES, error)) {
    tc_wire_reader reader = reader_for(&s);
    ok = tc_wire_list(&reader, series, count, error);
  }
  stop(&s);
  return ok;
}
