/* A client that leaves while what it sent is still being written: nothing is kept of it. The spool's thread is held, so
 * that this lasts as long as the test wants. */
#include "tests/support/test.h"
#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include "server/cli/daemon.h"
#include "server/http/http.h"
#include "server/loop/worker.h"
#include "server/memory/budget.h"

#define MOST_TURNS 2000

static tcs_daemon *under_test;
static tcs_server *server;

typedef struct holder {
  tcs_task task;
  GMutex held;
  bool over;
} holder;

static void hold(tcs_task *task) {
  g_mutex_lock(&((holder *)task)->held);
  g_mutex_unlock(&((holder *)task)->held);
}

static void let_go(tcs_task *task) { ((holder *)task)->over = true; }

static int open_daemon(void **state) {
  char *arguments[] = {"serve", "--listen", "127.0.0.1:0", "--backend", "cpu", NULL};
  int code = 0;
  under_test = tcs_daemon_open(G_N_ELEMENTS(arguments) - 1, arguments, &code);
  assert_non_null(under_test);
  server = tcs_daemon_server(under_test);
  return 0;
}

static int close_daemon(void **state) {
  tcs_daemon_close(under_test);
  return 0;
}

static int client(const char *request) {
  const struct sockaddr_in address = {.sin_family = AF_INET,
                                      .sin_addr.s_addr = htonl(INADDR_LOOPBACK),
                                      .sin_port =
                                          htons((uint16_t)atoi(strchr(tcs_http_address(server->http), ':') + 1))};
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  assert_int_equal(connect(fd, (const struct sockaddr *)&address, sizeof address), 0);
  assert_int_equal(send(fd, request, strlen(request), MSG_NOSIGNAL), (int)strlen(request));
  return fd;
}

static uint64_t unwritten(void) { return tcs_budget_used(server->budget, TCS_MEMORY_UPLOADS); }

TEST(who_leaves_while_an_upload_is_written_is_forgotten) {
  char request[200];
  holder h = {.task = {.run = hold, .done = let_go}};
  g_mutex_init(&h.held);
  g_mutex_lock(&h.held);
  tcs_worker_submit(server->spool_worker, &h.task);
  snprintf(request, sizeof request, "PUT /v1/volumes/u HTTP/1.1\r\nHost: %s\r\nContent-Length: 4\r\n\r\nNRRD",
           tcs_http_address(server->http));
  const int fd = client(request);
  for (int i = 0; i < MOST_TURNS && unwritten() == 0; i++) tcs_daemon_turn(under_test, 1);
  for (int i = 0; i < 10; i++) tcs_daemon_turn(under_test, 1); /* all of it is read, and waits */
  assert_int_equal(unwritten(), 4);
  assert_int_equal(tcs_http_open_requests(server->http), 1);
  close(fd);
  for (int i = 0; i < MOST_TURNS && tcs_http_open_requests(server->http) > 0; i++) {
    tcs_http_tick(server->http, g_get_monotonic_time());
    tcs_daemon_turn(under_test, 1);
  }
  assert_int_equal(tcs_http_open_requests(server->http), 0);
  g_mutex_unlock(&h.held);
  while (!h.over || unwritten() > 0) tcs_daemon_turn(under_test, 1);
  g_mutex_clear(&h.held);
}

TESTS(open_daemon, close_daemon)
