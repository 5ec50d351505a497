/* The log's ring and its thread: whole lines, in order, never waiting; what is lost is counted and told. */
#include "tests/support/test.h"
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include "server/observe/log.h"

#define PATIENCE_MS 20000

typedef struct place {
  char *folder, *file, *moved, *fifo;
} place;

static int set_up(void **state) {
  place *p = g_new0(place, 1);
  p->folder = g_dir_make_tmp("tomocast-log-XXXXXX", NULL);
  p->file = g_build_filename(p->folder, "log", NULL);
  p->moved = g_build_filename(p->folder, "log.1", NULL);
  p->fifo = g_build_filename(p->folder, "fifo", NULL);
  *state = p;
  return 0;
}

static int remove_place(void **state) {
  place *p = *state;
  unlink(p->file);
  unlink(p->moved);
  unlink(p->fifo);
  rmdir(p->folder);
  g_free(p->folder);
  g_free(p->file);
  g_free(p->moved);
  g_free(p->fifo);
  g_free(p);
  return 0;
}

static int tear_down(void **state) {
  tcs_log_stop(PATIENCE_MS);
  assert_true(tcs_log_open(NULL, NULL));
  return remove_place(state);
}

static char **lines_of(char *text) {
  char **lines = g_strsplit(text, "\n", -1);
  const guint count = g_strv_length(lines);
  assert_true(count > 0);
  assert_string_equal(lines[count - 1], ""); /* the last line ends */
  g_free(lines[count - 1]);
  lines[count - 1] = NULL;
  g_free(text);
  return lines;
}

static char **read_lines(const char *path) {
  char *text = NULL;
  assert_true(g_file_get_contents(path, &text, NULL, NULL));
  return lines_of(text);
}

TEST_WITH(test_lines_come_whole_and_in_order, set_up, tear_down) {
  place *p = *state;
  assert_true(tcs_log_open(p->file, NULL));
  tcs_log(TCS_LOG_INFO, "before", "n=%d", 0); /* no thread yet: written at once */
  tcs_log_start();
  for (int i = 1; i < 3000; i++) {
    tcs_log(TCS_LOG_INFO, "line", "n=%d text=%s", i, "a\nb");
    if (i % 500 == 0) assert_true(tcs_log_flush(PATIENCE_MS)); /* fewer bytes than the ring holds */
  }
  assert_true(tcs_log_flush(PATIENCE_MS));
  g_auto(GStrv) lines = read_lines(p->file);
  assert_int_equal(g_strv_length(lines), 3000);
  for (int i = 1; i < 3000; i++) {
    char wanted[40];
    snprintf(wanted, sizeof wanted, " info line n=%d text=a b", i);
    assert_true(g_str_has_suffix(lines[i], wanted));
  }
}

TEST_WITH(test_a_moved_file_is_opened_anew, set_up, tear_down) {
  place *p = *state;
  assert_true(tcs_log_open(p->file, NULL));
  tcs_log_start();
  tcs_log(TCS_LOG_INFO, "one", NULL);
  assert_true(tcs_log_flush(PATIENCE_MS));
  assert_int_equal(rename(p->file, p->moved), 0);
  tcs_log_reopen();
  for (int i = 0; i < 2000 && access(p->file, F_OK) != 0; i++) g_usleep(10000);
  tcs_log(TCS_LOG_INFO, "two", NULL);
  tcs_log_stop(PATIENCE_MS);
  char **old = read_lines(p->moved), **new = read_lines(p->file);
  assert_int_equal(g_strv_length(old), 1);
  assert_int_equal(g_strv_length(new), 1);
  assert_true(g_str_has_suffix(old[0], " info one") && g_str_has_suffix(new[0], " info two"));
  g_strfreev(old);
  g_strfreev(new);
}

TEST_WITH(test_a_path_that_cannot_be_is_refused, set_up, tear_down) {
  g_autoptr(GError) error = NULL;
  assert_false(tcs_log_open("/does/not/exist/log", &error));
  assert_non_null(strstr(error->message, "--log"));
}

/* Nobody reads: logging goes on, and what found no room is told of when somebody does. */
TEST_WITH(test_a_full_pipe_loses_lines_and_says_so, set_up, tear_down) {
  place *p = *state;
  const uint64_t before = tcs_log_dropped();
  enum { LINES = 10000 };
  assert_int_equal(mkfifo(p->fifo, 0600), 0);
  const int reader = open(p->fifo, O_RDONLY | O_NONBLOCK);
  assert_true(reader >= 0);
  assert_true(tcs_log_open(p->fifo, NULL));
  tcs_log_start();
  for (int i = 0; i < LINES; i++)
    tcs_log(TCS_LOG_INFO, "line", "n=%d %s", i, "some fifty characters that make the ring overflow");
  assert_false(tcs_log_flush(10));
  const uint64_t dropped = tcs_log_dropped() - before;
  print_message("%d lines, %d of them dropped\n", LINES, (int)dropped);
  assert_in_range(dropped, 1000, LINES - 1000);
  GString *text = g_string_new(NULL);
  char piece[4096];
  for (int quiet = 0; quiet < 200;) {
    const ssize_t got = read(reader, piece, sizeof piece);
    if (got > 0)
      g_string_append_len(text, piece, got), quiet = 0;
    else
      g_usleep(1000), quiet++;
  }
  assert_true(tcs_log_flush(PATIENCE_MS));
  char **lines = lines_of(g_string_free(text, FALSE));
  uint64_t kept = 0, told = 0;
  for (char **line = lines; *line; line++) {
    const char *lost = strstr(*line, " warn log.lost text=\"");
    if (lost)
      told += g_ascii_strtoull(lost + strlen(" warn log.lost text=\""), NULL, 10);
    else
      assert_non_null(strstr(*line, " info line n=")), kept++;
  }
  assert_int_equal(kept, LINES - dropped);
  assert_int_equal(told, dropped);
  g_strfreev(lines);
  tcs_log_stop(PATIENCE_MS);
  close(reader);
}

/* The end does not wait for a reader that never comes. Last: its thread is left behind. */
TEST_WITH(test_the_end_waits_only_so_long, set_up, remove_place) {
  place *p = *state;
  assert_int_equal(mkfifo(p->fifo, 0600), 0);
  const int reader = open(p->fifo, O_RDONLY | O_NONBLOCK);
  assert_true(tcs_log_open(p->fifo, NULL));
  tcs_log_start();
  for (int i = 0; i < 10000; i++) tcs_log(TCS_LOG_INFO, "line", "n=%d", i);
  const gint64 began = g_get_monotonic_time();
  tcs_log_stop(50);
  assert_true(g_get_monotonic_time() - began < 10000000);
  close(reader); /* the write ends with EPIPE */
}

int main(void) {
  signal(SIGPIPE, SIG_IGN);
  return run_all_tests(NULL, NULL);
}
