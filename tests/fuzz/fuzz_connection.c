/* A whole HTTP or WebSocket connection against the whole daemon, which this thread runs turn by turn: the input is what a
 * client sends it over loopback, in segments, each after the answer to the one before, which is there when the daemon
 * has nothing left to do. Several requests, an upgrade and its frames fit in one input. Sanitizers see the daemon; here
 * it is checked that what comes back is HTTP, that others are still answered, and that nothing is left of a client that
 * has gone. The input is bytes as they are, but
 *   |~|   ends a segment;
 *   @S    is the id of a session that was made for this input and ends with it. */
#include <arpa/inet.h>
#include <errno.h>
#include <glib.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "server/catalogue/catalogue.h"
#include "server/cli/daemon.h"
#include "server/http/http.h"
#include "server/loop/worker.h"
#include "server/memory/budget.h"
#include "server/session/sessions.h"

#define SEGMENT "|~|"
#define ID_SIZE 32
#define MOST_SEGMENTS 16
#define WORK_US 100000    /* for what workers do for one segment */
#define PATIENCE_US 4000000 /* for what must come: an input has 5 s in all */

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

/* Small limits: inputs are to reach every state, not to take long in one. */
static const char CONFIG[] =
    "[server]\nhosts=127.0.0.1\nlog_level=error\nthreads=1\nbackend=cpu\n"
    "[limits]\nimage_side=64\nimage_area=4096\nrays_per_pixel=2\nknots=64\nupload_bytes=65536\n"
    "volume_bytes=1000000\nsessions=8\nclients=8\nqueue=4\nrender_seconds=1\nimport_seconds=1\n";
static const char VOLUME[] = "NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: 4 4 4\n"
                             "space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\nencoding: raw\n\n"
                             "abcdefghijklmnopqrstuvwxyzabcdefghijklmnopqrstuvwxyzabcdefghijkl";

static char folder[] = "/tmp/tomocast-fuzz-XXXXXX", config_path[64], volume_path[64], spool[64];
static tcs_daemon *under_test;
static tcs_server *server;
static struct sockaddr_in address;

/* --- the daemon -------------------------------------------------------------------------------------- */

static void end_daemon(void) {
  tcs_daemon_close(under_test);
  unlink(config_path);
  unlink(volume_path);
  rmdir(spool);
  rmdir(folder);
}

static void begin(void) {
  char volume[80], *arguments[] = {"serve", "--listen", "127.0.0.1:0", "--config", config_path, "--data", folder,
                                   "--volume", volume, NULL};
  int code;
  if (under_test) return;
  if (!mkdtemp(folder)) abort();
  snprintf(config_path, sizeof config_path, "%s/config", folder);
  snprintf(volume_path, sizeof volume_path, "%s/v.nrrd", folder);
  snprintf(spool, sizeof spool, "%s/spool", folder);
  snprintf(volume, sizeof volume, "v=%s", volume_path);
  char *config = g_strdup_printf("%s[server]\nspool=%s\n", CONFIG, spool);
  if (mkdir(spool, 0700) != 0 || !g_file_set_contents(config_path, config, -1, NULL) ||
      !g_file_set_contents(volume_path, VOLUME, -1, NULL))
    abort();
  g_free(config);
  under_test = tcs_daemon_open(G_N_ELEMENTS(arguments) - 1, arguments, &code);
  if (!under_test) abort();
  server = tcs_daemon_server(under_test);
  address = (struct sockaddr_in){.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK),
                                 .sin_port = htons((uint16_t)atoi(strchr(tcs_http_address(server->http), ':') + 1))};
  atexit(end_daemon);
}

#define insist(holds)                                                    \
  do {                                                                   \
    if (holds) break;                                                    \
    fprintf(stderr, "%s:%d: not so: %s\n", __FILE__, __LINE__, #holds);  \
    __builtin_trap();                                                    \
  } while (0)

static int tasks_due(void) { return atomic_load(&server->completions->due); }

/* Of this thread's own time, which passes only while it has a processor. */
static int64_t spent_us(void) {
  struct timespec spent;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &spent);
  return spent.tv_sec * INT64_C(1000000) + spent.tv_nsec / 1000;
}

/* Turns until `over`, which must come. What workers still do is not counted: they may be short of processors. */
static void turn_until(bool (*over)(void)) {
  for (int64_t since = spent_us(); !over();) {
    if (tasks_due() > 0) since = spent_us();
    insist(spent_us() - since < PATIENCE_US);
    tcs_daemon_turn(under_test, tasks_due() > 0);
  }
}

/* What a client has heard; -1: its connection has ended. */
static ssize_t listen_to(int fd, GByteArray *heard) {
  uint8_t piece[16384];
  const ssize_t got = recv(fd, piece, sizeof piece, MSG_DONTWAIT);
  if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR)) return -1;
  if (got > 0 && heard->len < 16) g_byte_array_append(heard, piece, (guint)got);
  return MAX(got, 0);
}

/* Turns until the daemon has nothing left to do. False: the connection has ended. */
static bool settle(int fd, GByteArray *heard) {
  const int64_t until = g_get_monotonic_time() + WORK_US;
  for (int idle = 0; idle < 2 && g_get_monotonic_time() < until;) {
    tcs_daemon_turn(under_test, tasks_due() > 0);
    const ssize_t got = listen_to(fd, heard);
    if (got < 0) return false;
    idle = got > 0 || tasks_due() > 0 ? 0 : idle + 1;
  }
  return true;
}

static int connect_to_daemon(void) {
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int rc = TEMP_FAILURE_RETRY(connect(fd, (const struct sockaddr *)&address, sizeof address));
  insist(rc == 0 || errno == EISCONN); /* libFuzzer's alarm interrupts it */
  return fd;
}

/* --- before and after an input ------------------------------------------------------------------------- */

static tcs_entry *volume(void) { return tcs_catalogue_find(server->catalogue, TCS_KIND_VOLUME, "v"); }
static bool volume_loaded(void) { return volume()->state != TCS_LOADING; }

static tcs_session *session; /* of the input, and of the next one where nothing became of it */

static void load_volume(void) {
  GError *error = NULL;
  tcs_source_file source = {.path = g_strdup(volume_path), .name = "v", .operators = true};
  insist(tcs_catalogue_load(server->catalogue, TCS_KIND_VOLUME, "v", &source, &error));
}

/* A session, on a volume that is loaded again where an input has removed it, or a decoder got no processor within its
 * second. */
static void make_session(void) {
  GError *error = NULL;
  if (!volume()) load_volume();
  for (turn_until(volume_loaded); volume()->state == TCS_FAILED; turn_until(volume_loaded)) load_volume();
  if (session) return;
  cJSON *patch = cJSON_Parse("{\"image\":{\"width\":16,\"height\":16}}");
  session = tcs_sessions_create(server->sessions, volume(), patch, NULL, "fuzz", &error);
  insist(session != NULL);
  cJSON_Delete(patch);
}

/* A client that was there all the time is answered. */
static void ask_beside(void) {
  static const char request[] = "GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n";
  static int fd = -1;
  if (fd < 0) fd = connect_to_daemon();
  insist(send(fd, request, sizeof request - 1, MSG_NOSIGNAL) == sizeof request - 1);
  GByteArray *heard = g_byte_array_new();
  for (const int64_t until = spent_us() + PATIENCE_US; heard->len == 0;) {
    insist(spent_us() < until);
    tcs_daemon_turn(under_test, 0);
    insist(listen_to(fd, heard) >= 0);
  }
  insist(memcmp(heard->data, "HTTP/1.1 200", 12) == 0);
  g_byte_array_unref(heard);
}

static bool untouched(const tcs_session *s) {
  return s->revision == 1 && tcs_session_own_view(s)->begun_revision == 0 && !tcs_session_latest(s) && !s->still &&
         s->jobs->len == 0;
}

static void list_session(tcs_session *s, void *list) { g_ptr_array_add(list, s); }

static void end_sessions(void) {
  GPtrArray *all = g_ptr_array_new();
  bool kept = false;
  tcs_sessions_each(server->sessions, list_session, all);
  for (guint i = 0; i < all->len; i++) {
    tcs_session *s = all->pdata[i];
    if (s == session && untouched(s))
      kept = true;
    else
      tcs_session_end(s);
  }
  if (!kept) session = NULL;
  g_ptr_array_unref(all);
}

static void remove_volumes(void) {
  GArray *rows = tcs_catalogue_rows(server->catalogue, TCS_KIND_VOLUME, NULL, NULL);
  cJSON *list = tcs_rows_describe(rows);
  const cJSON *item;
  cJSON_ArrayForEach(item, list) {
    const char *id = cJSON_GetStringValue(cJSON_GetObjectItem(item, "id"));
    tcs_entry *entry = tcs_catalogue_find(server->catalogue, TCS_KIND_VOLUME, id);
    if (!entry->operators || entry->state == TCS_FAILED) tcs_catalogue_remove(server->catalogue, entry);
  }
  cJSON_Delete(list);
  tcs_rows_free(rows);
}

static bool nothing_left(void) {
  tcs_http_tick(server->http, g_get_monotonic_time()); /* sees who has gone while it waited */
  return server->ws_clients == 0 && server->mjpeg_clients == 0 && tcs_http_open_requests(server->http) == 0 &&
         tasks_due() == 0 && tcs_budget_used(server->budget, TCS_MEMORY_UPLOADS) == 0 &&
         tcs_budget_used(server->budget, TCS_MEMORY_LOADS) == 0;
}

/* --- the input ---------------------------------------------------------------------------------------- */

static GByteArray *with_session(const uint8_t *bytes, size_t size, const char *id) {
  GByteArray *text = g_byte_array_new();
  for (size_t i = 0; i < size; i++) {
    if (bytes[i] == '@' && i + 1 < size && bytes[i + 1] == 'S')
      g_byte_array_append(text, (const guint8 *)id, ID_SIZE), i++;
    else
      g_byte_array_append(text, &bytes[i], 1);
  }
  return text;
}

static void converse(const GByteArray *text) {
  const int fd = connect_to_daemon();
  GByteArray *heard = g_byte_array_new();
  guint at = 0;
  bool open = true;
  for (int i = 0; i < MOST_SEGMENTS && open && at < text->len; i++) {
    const guint8 *from = text->data + at, *end = memmem(from, text->len - at, SEGMENT, strlen(SEGMENT));
    const size_t size = end ? (size_t)(end - from) : text->len - at;
    if (size && send(fd, from, size, MSG_NOSIGNAL | MSG_DONTWAIT) < 0) break;
    at += (guint)(size + (end ? strlen(SEGMENT) : 0));
    open = settle(fd, heard);
  }
  insist(heard->len < 9 || memcmp(heard->data, "HTTP/1.1 ", 9) == 0);
  close(fd);
  g_byte_array_unref(heard);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  begin();
  make_session();
  GByteArray *text = with_session(bytes, size, session->id);
  converse(text);
  g_byte_array_unref(text);
  ask_beside();
  end_sessions();
  remove_volumes();
  turn_until(nothing_left);
  return 0;
}
