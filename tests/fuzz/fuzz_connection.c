/* A whole HTTP or WebSocket connection against the whole daemon: `tomocast serve` runs in a thread of this process, the
 * input is what a client sends it over loopback, in segments, each after the answer to the one before. Several
 * requests, an upgrade and its frames fit in one input. Sanitizers see the daemon; here it is checked that what comes
 * back is HTTP and that others are still answered. The input is bytes as they are, but
 *   |~|   ends a segment;
 *   @S    is the id of a session that was made for this input and ends with it. */
#include <arpa/inet.h>
#include <glib.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "server/cli/cli.h"

#define SEGMENT "|~|"
#define ID_SIZE 32
#define SETTLED_MS 3 /* no byte for this long: the answer is there, or none comes */
#define PATIENCE_S 4 /* for an answer that must come: an input has 5 s in all */
#define MOST_SEGMENTS 16

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

/* Small limits: inputs are to reach every state, not to take long in one. */
static const char CONFIG[] =
    "[server]\nhosts=127.0.0.1\nlog_level=error\nthreads=1\nbackend=cpu\n"
    "[limits]\nimage_side=64\nimage_area=4096\nrays_per_pixel=2\nknots=64\nupload_bytes=65536\n"
    "volume_bytes=1000000\nsessions=8\nclients=8\nqueue=4\nrender_seconds=1\n";
static const char VOLUME[] = "NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: 4 4 4\n"
                             "space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\nencoding: raw\n\n"
                             "abcdefghijklmnopqrstuvwxyzabcdefghijklmnopqrstuvwxyzabcdefghijkl";

static char folder[] = "/tmp/tomocast-fuzz-XXXXXX", config_path[64], listen_at[32];
static int port;
static pthread_t daemon_thread;

/* --- the daemon -------------------------------------------------------------------------------------- */

static void *run_daemon(void *unused) {
  char *arguments[] = {"serve", "--listen", listen_at, "--config", config_path, "--data", folder, NULL};
  tcs_cli_serve(G_N_ELEMENTS(arguments) - 1, arguments);
  return NULL;
}

static void end_daemon(void) {
  kill(getpid(), SIGTERM);
  pthread_join(daemon_thread, NULL);
  unlink(config_path);
  rmdir(folder);
}

static struct sockaddr_in loopback(int at) {
  return (struct sockaddr_in){
      .sin_family = AF_INET, .sin_port = htons((uint16_t)at), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
}

static int connect_to_daemon(void) {
  const struct sockaddr_in address = loopback(port);
  const struct timeval patience = {.tv_sec = PATIENCE_S};
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), one = 1;
  setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
  setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
  if (connect(fd, (const struct sockaddr *)&address, sizeof address) == 0) return fd;
  close(fd);
  return -1;
}

static int free_port(void) {
  struct sockaddr_in address = loopback(0);
  socklen_t size = sizeof address;
  const int fd = socket(AF_INET, SOCK_STREAM, 0);
  if (bind(fd, (struct sockaddr *)&address, size) != 0 || getsockname(fd, (struct sockaddr *)&address, &size) != 0)
    abort();
  close(fd);
  return ntohs(address.sin_port);
}

static bool start(void) {
  sigset_t ends;
  sigemptyset(&ends);
  sigaddset(&ends, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &ends, NULL); /* the daemon's thread for signals takes it */
  signal(SIGPIPE, SIG_IGN);
  if (!mkdtemp(folder)) abort();
  snprintf(config_path, sizeof config_path, "%s/config", folder);
  if (!g_file_set_contents(config_path, CONFIG, -1, NULL)) abort();
  port = free_port();
  snprintf(listen_at, sizeof listen_at, "127.0.0.1:%d", port);
  if (pthread_create(&daemon_thread, NULL, run_daemon, NULL) != 0) abort();
  atexit(end_daemon);
  int fd = -1;
  for (int i = 0; i < 600 && (fd = connect_to_daemon()) < 0; i++)
    g_usleep(50000);
  if (fd < 0) abort();
  close(fd);
  return true;
}

/* --- a well-behaved client beside it, for the state --------------------------------------------------- */

/* The whole reply to one request on a connection of its own; a daemon that does not answer is a finding. */
static GString *ask(const char *method, const char *path, const char *type, const char *body) {
  const int fd = connect_to_daemon();
  if (fd < 0) __builtin_trap();
  GString *text = g_string_new(NULL);
  g_string_printf(
      text, "%s %s HTTP/1.1\r\nHost: %s\r\nConnection: close\r\nContent-Type: %s\r\nContent-Length: %zu\r\n\r\n%s",
      method, path, listen_at, type, strlen(body), body);
  /* libFuzzer's alarm interrupts calls that have a time limit. */
  if (TEMP_FAILURE_RETRY(write(fd, text->str, text->len)) != (ssize_t)text->len) __builtin_trap();
  g_string_truncate(text, 0);
  char piece[4096];
  for (ssize_t got; (got = TEMP_FAILURE_RETRY(read(fd, piece, sizeof piece))) > 0;)
    g_string_append_len(text, piece, got);
  close(fd);
  if (!g_str_has_prefix(text->str, "HTTP/1.1 ")) __builtin_trap();
  return text;
}

static void drop(GString *text) { g_string_free(text, TRUE); }

/* A session, on a volume that is made again where an input has removed it or used up the room. */
static void make_session(char id[ID_SIZE + 1]) {
  for (int i = 0; i < 300; i++) {
    GString *reply = ask("POST", "/v1/sessions", "application/json",
                         "{\"volume\":\"v\",\"scene\":{\"image\":{\"width\":16,\"height\":16}}}");
    const char *found = strstr(reply->str, "\"id\":\"");
    const bool made = g_str_has_prefix(reply->str, "HTTP/1.1 201") && found;
    const bool loading = strstr(reply->str, "loading") != NULL;
    if (made) memcpy(id, found + 6, ID_SIZE);
    drop(reply);
    if (made) return;
    if (!loading) drop(ask("PUT", "/v1/volumes/v", "application/octet-stream", VOLUME));
    g_usleep(5000);
  }
  __builtin_trap();
}

/* Ends everything in a list of GET `path`: objects with an "id". */
static void end_all(const char *path) {
  GString *reply = ask("GET", path, "text/plain", "");
  for (const char *at = reply->str; (at = strstr(at, "\"id\":\""));) {
    at += 6;
    char *target = g_strdup_printf("%s/%.*s?force=true", path, (int)strcspn(at, "\""), at);
    if (strncmp(at, "v\"", 2) != 0 && strncmp(at, "demo:", 5) != 0) drop(ask("DELETE", target, "text/plain", ""));
    g_free(target);
  }
  drop(reply);
}

/* --- the input ---------------------------------------------------------------------------------------- */

/* Reads until nothing has come for a while. False: the connection has ended. */
static bool settle(int fd, GByteArray *heard) {
  struct pollfd ready = {.fd = fd, .events = POLLIN};
  uint8_t piece[16384];
  for (int i = 0; i < 50 && poll(&ready, 1, SETTLED_MS) > 0; i++) {
    const ssize_t got = read(fd, piece, sizeof piece);
    if (got <= 0) return false;
    if (heard->len < 16) g_byte_array_append(heard, piece, (guint)got);
  }
  return true;
}

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
  if (fd < 0) __builtin_trap();
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
  if (heard->len >= 9 && memcmp(heard->data, "HTTP/1.1 ", 9) != 0) __builtin_trap();
  close(fd);
  g_byte_array_unref(heard);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  static bool started;
  char id[ID_SIZE + 1] = "";
  if (!started) started = start();
  make_session(id);
  GByteArray *text = with_session(bytes, size, id);
  converse(text);
  g_byte_array_unref(text);
  drop(ask("GET", "/healthz", "text/plain", ""));
  end_all("/v1/sessions");
  end_all("/v1/volumes");
  return 0;
}
