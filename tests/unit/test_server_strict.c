/* What stands between the socket and the HTTP library: heads in one plain form, chunks, refusals. No socket. */
#include "tests/support/test.h"

#include "server/http/strict.h"

#define HOST "Host: a\r\n"
#define LAST_WORD "GET /refused HTTP/1.1\r\nHost: refused\r\nConnection: close\r\n\r\n"

/* All that comes out when `size` bytes go in, `piece` at a time. */
static char *run(tcs_strict *strict, const char *bytes, size_t size, size_t piece) {
  GString *out = g_string_new(NULL);
  uint8_t room[7]; /* small and odd, so that every text is cut somewhere */
  for (size_t at = 0; at < size && tcs_strict_hungry(strict); at += piece) {
    tcs_strict_give(strict, (const uint8_t *)bytes + at, MIN(piece, size - at));
    for (size_t got; (got = tcs_strict_take(strict, room, sizeof room)) > 0;)
      g_string_append_len(out, (const char *)room, (gssize)got);
  }
  return g_string_free(out, FALSE);
}

static void check(const char *in, const char *wanted, int status) {
  const size_t pieces[] = {1, 2, 3, 50, 100000};
  for (size_t i = 0; i < G_N_ELEMENTS(pieces); i++) {
    tcs_strict *strict = tcs_strict_new();
    char *out = run(strict, in, strlen(in), pieces[i]);
    assert_string_equal(out, wanted);
    const tcs_refusal *refusal = tcs_strict_refusal(strict);
    assert_int_equal(refusal ? refusal->status : 0, status);
    g_free(out);
    tcs_strict_free(strict);
  }
}

TEST(test_heads_come_out_plain) {
  check("\r\nGET /x?y HTTP/1.7\r\nHOST:a\r\nX-y:  z \t\r\nExpect: 100-Continue\r\n\r\n",
        "GET /x?y HTTP/1.1\r\nHost: a\r\nX-y: z\r\n\r\n", 0);
  check("PUT / HTTP/1.1\r\nExpect: 100-Continue\r\nContent-Length: 1\r\n" HOST "\r\n",
        "PUT / HTTP/1.1\r\n" HOST "Content-Length: 1\r\nExpect: 100-continue\r\n\r\n", 0);
  check("GET HTTP://b:1?q HTTP/1.1\r\nX: 1\r\n" HOST "\r\n", "GET /?q HTTP/1.1\r\nHost: b:1\r\nX: 1\r\n\r\n", 0);
  check("POST / HTTP/1.1\r\nContent-Length: 0003\r\n" HOST "\r\nabcGET / HTTP/1.0\r\nUpgrade: websocket\r\n"
        "Expect: x\r\n\r\n",
        "POST / HTTP/1.1\r\n" HOST "Content-Length: 3\r\n\r\nabcGET / HTTP/1.0\r\n\r\n", 0);
}

TEST(test_chunks_come_out_plain) {
  const char head[] = "PUT / HTTP/1.1\r\n" HOST "Transfer-Encoding: chunked\r\n\r\n";
  char in[400], wanted[400];
  snprintf(in, sizeof in, "%s%s", head, "003;x=y\r\nabc\r\nA\r\n0123456789\r\n00\r\nX: y\r\n\r\n");
  snprintf(wanted, sizeof wanted, "%s%s", head, "3\r\nabc\r\na\r\n0123456789\r\n0\r\n\r\n");
  check(in, wanted, 0);
  /* What is not well formed ends the body, and says so. */
  const char *const bad[][2] = {{"3\r\nabc\n", "3\r\nabc\r\n0\r\n\r\n"},
                                {"z\r\n", "0\r\n\r\n"},
                                {"ffffffffffffffff0\r\n", "0\r\n\r\n"},
                                {"1\r\na\r\n0\r\nX\r\n\r\n", "1\r\na\r\n0\r\n\r\n"}};
  for (size_t i = 0; i < G_N_ELEMENTS(bad); i++) {
    snprintf(in, sizeof in, "%s%s", head, bad[i][0]);
    snprintf(wanted, sizeof wanted, "%s%s", head, bad[i][1]);
    check(in, wanted, 400);
  }
}

TEST(test_a_refused_head_is_the_last) {
  check("GET / HTTP/1.1\r\n\r\nGET / HTTP/1.1\r\n" HOST "\r\n", LAST_WORD, 400);
  check("GET / HTTP/1.1\r\n" HOST "\r\nGET / HTTP/2.0\r\n" HOST "\r\n", "GET / HTTP/1.1\r\n" HOST "\r\n" LAST_WORD,
        505);
  check("GET / HTTP/1.1\n", LAST_WORD, 400);
  check("\x16\x03\x01", LAST_WORD, 400);
}

TEST(test_after_an_upgrade_bytes_wait) {
  const char in[] = "GET / HTTP/1.1\r\n" HOST "Upgrade: websocket\r\n\r\n\x81\x80zzzz";
  tcs_strict *strict = tcs_strict_new();
  char *out = run(strict, in, strlen(in), 1000);
  assert_string_equal(out, "GET / HTTP/1.1\r\n" HOST "Upgrade: websocket\r\n\r\n");
  assert_false(tcs_strict_hungry(strict));
  assert_int_equal(tcs_strict_held(strict)->len, 6);
  assert_memory_equal(tcs_strict_held(strict)->data, "\x81\x80zzzz", 6);
  g_free(out);
  tcs_strict_free(strict);
}

TEST(test_bodies_may_go_past) {
  tcs_strict *strict = tcs_strict_new();
  const char in[] = "PUT / HTTP/1.1\r\n" HOST "Content-Length: 10\r\n\r\nabc";
  char *out = run(strict, in, strlen(in), 1000);
  assert_int_equal(tcs_strict_direct(strict, 100), 7);
  assert_int_equal(tcs_strict_direct(strict, 5), 5);
  tcs_strict_passed(strict, 5);
  tcs_strict_passed(strict, 2);
  assert_int_equal(tcs_strict_direct(strict, 100), 0);
  g_free(out);
  out = run(strict, "GET / HTTP/1.0\r\n\r\n", 18, 18);
  assert_string_equal(out, "GET / HTTP/1.0\r\n\r\n");
  assert_int_equal(tcs_strict_heads(strict), 2);
  g_free(out);
  tcs_strict_free(strict);
}

TESTS(NULL, NULL)
