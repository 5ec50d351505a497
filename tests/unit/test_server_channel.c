/* WebSocket framing over a pipe in memory, and the way of tasks between threads. */
#include "tests/support/test.h"
#include <errno.h>
#include <malloc.h>
#include <stdatomic.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "server/loop/worker.h"
#include "server/ws/channel.h"

typedef struct pipe_end {
  GByteArray *in, *out;
  size_t read, room; /* room: bytes that may still be sent */
  bool closed;
  GString *texts; /* messages, each followed by '|' */
} pipe_end;

static ssize_t on_receive(void *user, uint8_t *bytes, size_t size) {
  pipe_end *end = user;
  const size_t count = MIN(size, end->in->len - end->read);
  if (count == 0 && end->closed) return 0;
  if (count == 0) {
    errno = EAGAIN;
    return -1;
  }
  memcpy(bytes, end->in->data + end->read, count);
  end->read += count;
  return (ssize_t)count;
}

static ssize_t on_send(void *user, const uint8_t *bytes, size_t size, bool more) {
  pipe_end *end = user;
  const size_t count = MIN(size, end->room);
  if (count == 0) {
    errno = EAGAIN;
    return -1;
  }
  g_byte_array_append(end->out, bytes, (guint)count);
  end->room -= count;
  return (ssize_t)count;
}

static void on_text(void *user, const char *bytes, size_t size) {
  pipe_end *end = user;
  g_string_append_len(end->texts, bytes, (gssize)size);
  g_string_append_c(end->texts, '|');
}

static tcs_channel *open_channel(pipe_end *end) {
  static const tcs_channel_callbacks callbacks = {on_receive, on_send, on_text};
  *end = (pipe_end){g_byte_array_new(), g_byte_array_new(), 0, SIZE_MAX, false, g_string_new(NULL)};
  return tcs_channel_new(&callbacks, end);
}

static void close_channel(tcs_channel *channel, pipe_end *end) {
  tcs_channel_free(channel);
  g_byte_array_unref(end->in);
  g_byte_array_unref(end->out);
  g_string_free(end->texts, TRUE);
}

/* A masked frame with the key 0, so that the payload reads as it is. */
static void put(pipe_end *end, uint8_t first, const char *payload) {
  const uint8_t head[6] = {first, (uint8_t)(0x80 | strlen(payload))};
  g_byte_array_append(end->in, head, sizeof head);
  g_byte_array_append(end->in, (const guint8 *)payload, (guint)strlen(payload));
}

TEST(test_messages_arrive_whole) {
  pipe_end end;
  tcs_channel *channel = open_channel(&end);
  put(&end, 0x81, "one");
  put(&end, 0x01, "tw");
  put(&end, 0x89, "ping");
  put(&end, 0x80, "o");
  assert_true(tcs_channel_read(channel));
  assert_string_equal(end.texts->str, "one|two|");
  assert_true(tcs_channel_write(channel));
  assert_int_equal(end.out->len, 6);
  assert_memory_equal(end.out->data, "\x8a\x04ping", 6);
  close_channel(channel, &end);
}

TEST(test_sent_messages_have_two_parts) {
  pipe_end end;
  tcs_channel *channel = open_channel(&end);
  GBytes *body = g_bytes_new_static("body", 4);
  assert_true(tcs_channel_send_shared(channel, true, "head", 4, body));
  g_bytes_unref(body);
  assert_true(tcs_channel_send_text(channel, "t"));
  end.room = 3; /* the pipe fills in the middle */
  assert_true(tcs_channel_write(channel));
  assert_true(tcs_channel_wants_write(channel));
  end.room = SIZE_MAX;
  assert_true(tcs_channel_write(channel));
  assert_false(tcs_channel_wants_write(channel));
  assert_int_equal(end.out->len, 13);
  assert_memory_equal(end.out->data, "\x82\x08headbody\x81\x01t", 13);
  close_channel(channel, &end);
}

static void put_frame(GByteArray *out, uint8_t first, const void *bytes, size_t size) {
  const uint8_t small[2] = {first, (uint8_t)size}, mid[4] = {first, 126, (uint8_t)(size >> 8), (uint8_t)size},
                wide[10] = {
                    first,        127, 0, 0, 0, 0, (uint8_t)(size >> 24), (uint8_t)(size >> 16), (uint8_t)(size >> 8),
                    (uint8_t)size};
  g_byte_array_append(out, size < 126 ? small : size < 65536 ? mid : wide, size < 126 ? 2 : size < 65536 ? 4 : 10);
  g_byte_array_append(out, bytes, (guint)size);
}

/* Texts, pings and shared messages of every length class, through a pipe that takes a few bytes at a time: the bytes
 * are those of whole frames one after the other, in the order of queueing, and the body is nobody's copy. */
TEST(test_shared_messages_keep_their_bytes_and_place) {
  static const size_t sizes[] = {0, 1, 117, 118, 125, 126, 127, 4096, 65527, 65528, 65536, 200000};
  GRand *random = g_rand_new_with_seed(7);
  for (size_t i = 0; i < G_N_ELEMENTS(sizes); i++) {
    for (int before = 0; before < 2; before++) {
      pipe_end end;
      tcs_channel *channel = open_channel(&end);
      GByteArray *wanted = g_byte_array_new(), *whole = g_byte_array_new();
      uint8_t *bytes = g_malloc(sizes[i] + 1);
      for (size_t k = 0; k < sizes[i]; k++) bytes[k] = (uint8_t)(k * 7 + i);
      GBytes *body = g_bytes_new(bytes, sizes[i]);
      g_byte_array_append(whole, (const guint8 *)"the head", 8);
      g_byte_array_append(whole, bytes, (guint)sizes[i]);
      if (before) {
        assert_true(tcs_channel_send_text(channel, "first"));
        put_frame(wanted, 0x81, "first", 5);
        end.room = 3; /* half of it goes: the shared message may not come in between */
        assert_true(tcs_channel_write(channel));
      }
      end.room = 0;
      assert_true(tcs_channel_send_shared(channel, true, "the head", 8, body));
      assert_false(tcs_channel_send_shared(channel, true, "the head", 8, body)); /* one at a time */
      assert_int_equal(tcs_channel_queued(channel), before + 1);
      put_frame(wanted, 0x82, whole->data, whole->len);
      for (int turn = 0; tcs_channel_wants_write(channel) || turn < 3; turn++) {
        if (turn == 2 && !before) { /* comes while the other one may be half sent */
          put(&end, 0x89, "p");
          assert_true(tcs_channel_read(channel));
          put_frame(wanted, 0x8a, "p", 1);
        }
        end.room = (size_t)g_rand_int_range(random, 0, sizes[i] > 5000 ? 20000 : 50);
        assert_true(tcs_channel_write(channel));
      }
      assert_int_equal(tcs_channel_queued(channel), 0);
      assert_int_equal(end.out->len, wanted->len);
      assert_memory_equal(end.out->data, wanted->data, wanted->len);
      gsize size;
      g_free(g_bytes_unref_to_data(body, &size)); /* the last reference: the channel holds none any more */
      g_free(bytes);
      g_byte_array_unref(whole);
      g_byte_array_unref(wanted);
      close_channel(channel, &end);
    }
  }
  g_rand_free(random);
}

/* A peer that never reads costs a reference, not a picture; what is queued goes with the channel. */
TEST(test_many_channels_share_one_body) {
  enum { CHANNELS = 60, SIZE = 4 << 20 };
  pipe_end ends[CHANNELS];
  tcs_channel *channels[CHANNELS];
  g_autoptr(GBytes) body = g_bytes_new_take(g_malloc0(SIZE), SIZE);
  const size_t before = mallinfo2().uordblks + mallinfo2().hblkhd;
  for (int i = 0; i < CHANNELS; i++) {
    channels[i] = open_channel(&ends[i]);
    ends[i].room = 100;
    assert_true(tcs_channel_send_shared(channels[i], true, "head", 4, body));
    assert_true(tcs_channel_write(channels[i]));
    assert_true(tcs_channel_wants_write(channels[i]));
  }
  const size_t more = mallinfo2().uordblks + mallinfo2().hblkhd - before;
  print_message("%d channels: %zu bytes beside one body of %d\n", CHANNELS, more, SIZE);
  assert_in_range(more, 0, SIZE);
  for (int i = 0; i < CHANNELS; i++) close_channel(channels[i], &ends[i]);
}

TEST(test_a_flood_of_pings_makes_no_queue) {
  pipe_end end;
  tcs_channel *channel = open_channel(&end);
  end.room = 0;
  for (int i = 0; i < 100000; i++) put(&end, 0x89, "");
  for (int i = 0; i < 100; i++) assert_true(tcs_channel_read(channel));
  /* What was in one read of the framing may all be answered, and no more. */
  assert_true(tcs_channel_queued(channel) < 1000);
  assert_true(end.read <= 8192);
  assert_false(tcs_channel_wants_read(channel));
  end.room = SIZE_MAX;
  assert_true(tcs_channel_write(channel));
  assert_true(tcs_channel_wants_read(channel));
  close_channel(channel, &end);
}

TEST(test_one_turn_reads_a_bounded_amount) {
  pipe_end end;
  tcs_channel *channel = open_channel(&end);
  for (int i = 0; i < 20000; i++) put(&end, 0x81, "12345678");
  assert_true(tcs_channel_read(channel));
  assert_true(end.read <= 65536);
  assert_true(end.texts->len > 0);
  close_channel(channel, &end);
}

static void expect_close(const uint8_t *bytes, size_t size, uint16_t code) {
  pipe_end end;
  tcs_channel *channel = open_channel(&end);
  g_byte_array_append(end.in, bytes, (guint)size);
  if (tcs_channel_read(channel)) tcs_channel_write(channel);
  if (end.out->len < 4) fail_msg("no close frame with a reason after %02x %02x", bytes[0], bytes[1]);
  assert_int_equal(end.out->data[0], 0x88);
  assert_int_equal(end.out->data[2] << 8 | end.out->data[3], code);
  assert_int_equal(end.texts->len, 0);
  close_channel(channel, &end);
}

TEST(test_broken_frames_are_told_why) {
  expect_close((const uint8_t *)"\x81\x01x", 3, 1002);                          /* not masked */
  expect_close((const uint8_t *)"\xc1\x81\0\0\0\0x", 7, 1002);                  /* a reserved bit */
  expect_close((const uint8_t *)"\x09\x80\0\0\0\0", 6, 1002);                   /* a fragmented ping */
  expect_close((const uint8_t *)"\x82\x81\0\0\0\0x", 7, 1003);                  /* binary */
  expect_close((const uint8_t *)"\x81\x81\0\0\0\0\xff", 7, 1007);               /* not UTF-8 */
  expect_close((const uint8_t *)"\x81\xff\0\0\0\0\0\1\0\1\0\0\0\0x", 15, 1009); /* 65537 bytes */
  expect_close((const uint8_t *)"\x81\xff\x7f\xff\xff\xff\xff\xff\xff\xff\0\0\0\0x", 15, 1009);
}

TEST(test_closing_shakes_hands) {
  pipe_end end;
  tcs_channel *channel = open_channel(&end);
  tcs_channel_close(channel, 1001, "bye");
  assert_true(tcs_channel_closing(channel));
  assert_false(tcs_channel_send_text(channel, "late"));
  assert_true(tcs_channel_write(channel));
  assert_memory_equal(end.out->data,
                      "\x88\x05\x03\xe9"
                      "bye",
                      7);
  assert_false(tcs_channel_done(channel));
  put(&end, 0x88, "\x03\xe9");
  assert_true(tcs_channel_read(channel));
  assert_true(tcs_channel_done(channel));
  close_channel(channel, &end);
}

TEST(test_the_end_of_the_pipe_is_noticed) {
  pipe_end end;
  tcs_channel *channel = open_channel(&end);
  end.closed = true;
  assert_false(tcs_channel_read(channel));
  assert_int_equal(end.out->len, 0);
  close_channel(channel, &end);
}

/* --- tasks ------------------------------------------------------------------------------------------ */

typedef struct counted {
  tcs_task task;
  int number;
  GArray *order;
} counted;

static void run_counted(tcs_task *task) { ((counted *)task)->number *= 2; }

static void done_counted(tcs_task *task) {
  counted *c = (counted *)task;
  g_array_append_val(c->order, c->number);
}

TEST(test_tasks_come_back_in_order) {
  enum { N = 500 };
  tcs_completions completions;
  assert_true(tcs_completions_init(&completions, NULL));
  tcs_worker *worker = tcs_worker_new("unit", 1, TCS_PRIORITY_PICTURE, &completions, NULL);
  GArray *order = g_array_new(FALSE, FALSE, sizeof(int));
  counted tasks[N];
  for (int i = 0; i < N; i++) {
    tasks[i] = (counted){{.run = run_counted, .done = done_counted}, i, order};
    tcs_worker_submit(worker, &tasks[i].task);
  }
  tcs_worker_free(worker); /* finishes what is queued */
  tcs_completions_drain(&completions);
  assert_int_equal(order->len, N);
  for (int i = 0; i < N; i++) assert_int_equal(g_array_index(order, int, i), 2 * i);
  g_array_unref(order);
  tcs_completions_finish(&completions);
}

TEST(test_several_threads_share_a_queue) {
  enum { N = 500 };
  tcs_completions completions;
  assert_true(tcs_completions_init(&completions, NULL));
  tcs_worker *worker = tcs_worker_new("unit", 4, TCS_PRIORITY_PICTURE, &completions, NULL);
  GArray *order = g_array_new(FALSE, FALSE, sizeof(int));
  counted tasks[N];
  for (int i = 0; i < N; i++) {
    tasks[i] = (counted){{.run = run_counted, .done = done_counted}, 1, order};
    tcs_worker_submit(worker, &tasks[i].task);
  }
  while (order->len < N) tcs_completions_drain(&completions);
  for (int i = 0; i < N; i++) assert_int_equal(g_array_index(order, int, i), 2); /* each ran once */
  tcs_worker_free(worker);
  g_array_unref(order);
  tcs_completions_finish(&completions);
}

typedef struct gate {
  tcs_task task;
  atomic_bool open, entered;
} gate;

static void run_gate(tcs_task *task) {
  gate *g = (gate *)task;
  atomic_store(&g->entered, true);
  while (!atomic_load(&g->open)) g_usleep(100);
}

static void done_gate(tcs_task *task) {}

typedef struct asker {
  tcs_worker *worker;
  atomic_bool answered;
} asker;

/* Asks until the worker stands at its full descriptor for certain, and again after that. */
static void *ask(void *user) {
  asker *a = user;
  for (int i = 0; i < 100; i++, g_usleep(1000)) tcs_worker_waiting(a->worker);
  atomic_store(&a->answered, true);
  return NULL;
}

/* A thread that says that its task is over may be stopped there for long: it keeps nobody from the queue. */
TEST(test_a_worker_holds_no_lock_while_it_tells) {
  tcs_completions completions;
  const uint64_t full = UINT64_MAX - 1;
  uint64_t count;
  pthread_t thread;
  assert_true(tcs_completions_init(&completions, NULL));
  close(completions.event_fd);
  completions.event_fd = eventfd(0, EFD_CLOEXEC); /* whose writer waits */
  assert_int_equal(write(completions.event_fd, &full, sizeof full), sizeof full);
  tcs_worker *worker = tcs_worker_new("unit", 1, TCS_PRIORITY_PICTURE, &completions, NULL);
  gate g = {.task = {.run = run_gate, .done = done_gate}, .open = true};
  tcs_worker_submit(worker, &g.task);
  while (!atomic_load(&g.entered)) g_usleep(100);
  asker a = {.worker = worker};
  pthread_create(&thread, NULL, ask, &a);
  for (int i = 0; i < 10000 && !atomic_load(&a.answered); i++) g_usleep(1000);
  const bool answered = atomic_load(&a.answered);
  assert_int_equal(read(completions.event_fd, &count, sizeof count), sizeof count);
  pthread_join(thread, NULL);
  assert_true(answered);
  tcs_worker_free(worker);
  tcs_completions_drain(&completions);
  tcs_completions_finish(&completions);
}

/* While one task runs: what waits can be taken back from anywhere in the queue, what runs cannot, and a full queue
 * takes no more. */
TEST(test_waiting_tasks_can_be_taken_back) {
  tcs_completions completions;
  assert_true(tcs_completions_init(&completions, NULL));
  tcs_worker *worker = tcs_worker_new("unit", 1, TCS_PRIORITY_PICTURE, &completions, NULL);
  GArray *order = g_array_new(FALSE, FALSE, sizeof(int));
  gate g = {.task = {.run = run_gate, .done = done_gate}};
  counted tasks[5];
  tcs_worker_submit(worker, &g.task);
  while (!atomic_load(&g.entered)) g_usleep(100);
  for (int i = 0; i < 5; i++) tasks[i] = (counted){{.run = run_counted, .done = done_counted}, i, order};
  for (int i = 0; i < 4; i++) assert_true(tcs_worker_offer(worker, &tasks[i].task, 4));
  assert_false(tcs_worker_offer(worker, &tasks[4].task, 4));
  assert_false(tcs_worker_drop(worker, &g.task));
  assert_true(tcs_worker_drop(worker, &tasks[3].task)); /* the last, the middle, the first */
  assert_true(tcs_worker_drop(worker, &tasks[1].task));
  assert_true(tcs_worker_drop(worker, &tasks[0].task));
  assert_false(tcs_worker_drop(worker, &tasks[0].task));
  assert_int_equal(tcs_worker_waiting(worker), 1);
  assert_true(tcs_worker_offer(worker, &tasks[4].task, 4));
  atomic_store(&g.open, true);
  while (order->len < 2) tcs_completions_drain(&completions);
  assert_int_equal(g_array_index(order, int, 0), 2 * 2);
  assert_int_equal(g_array_index(order, int, 1), 2 * 4);
  tcs_worker_free(worker);
  g_array_unref(order);
  tcs_completions_finish(&completions);
}

static void wait_for(GArray *order, guint n, tcs_completions *completions) {
  while (order->len < n) tcs_completions_drain(completions);
}

/* One client has filled the line: another one's first task has a place in it, and the next turn; and of two threads one. */
TEST(test_clients_take_turns) {
  for (int threads = 1; threads <= 2; threads++) {
    tcs_completions completions;
    assert_true(tcs_completions_init(&completions, NULL));
    tcs_worker *worker = tcs_worker_new("unit", threads, TCS_PRIORITY_PICTURE, &completions, NULL);
    GArray *order = g_array_new(FALSE, FALSE, sizeof(int));
    gate g = {.task = {run_gate, done_gate, .client = 7}};
    counted tasks[7];
    tcs_worker_submit(worker, &g.task);
    while (!atomic_load(&g.entered)) g_usleep(100);
    for (int i = 0; i < 7; i++) tasks[i] = (counted){{run_counted, done_counted, .client = i < 5 ? 7 : 9}, i, order};
    for (int i = 0; i < 4; i++) assert_true(tcs_worker_offer(worker, &tasks[i].task, 4));
    assert_false(tcs_worker_offer(worker, &tasks[4].task, 4));
    assert_true(tcs_worker_offer(worker, &tasks[5].task, 4));
    if (threads == 1) assert_false(tcs_worker_offer(worker, &tasks[6].task, 4));
    if (threads == 2) wait_for(order, 1, &completions);
    assert_int_equal(order->len, threads - 1); /* of one client alone, whose others wait for the gate */
    atomic_store(&g.open, true);
    wait_for(order, 5, &completions);
    static const int turns[2][5] = {{0, 10, 2, 4, 6}, {10, 0, 2, 4, 6}};
    for (int i = 0; i < 5; i++) assert_int_equal(g_array_index(order, int, i), turns[threads - 1][i]);
    tcs_worker_free(worker);
    g_array_unref(order);
    tcs_completions_finish(&completions);
  }
}

TESTS(NULL, NULL)
