/* Who may ask: hosts, origins, tokens, tickets, links. */
#include "tests/support/test.h"
#include <sys/stat.h>
#include <unistd.h>

#include <arpa/inet.h>

#include "server/access/access.h"
#include "server/config/config.h"

typedef struct host_case {
  const char *host;
  bool allowed;
} host_case;

static void check_hosts(const tcs_hosts *hosts, const host_case *cases, size_t count) {
  for (size_t i = 0; i < count; i++)
    if (tcs_host_allowed(hosts, cases[i].host) != cases[i].allowed) fail_msg("host \"%s\"", cases[i].host);
}
#define CHECK_HOSTS(hosts, cases) check_hosts(hosts, cases, G_N_ELEMENTS(cases))

TEST(test_hosts_of_loopback) {
  static const host_case cases[] = {
      {"127.0.0.1:8080", true},
      {"localhost:8080", true},
      {"LocalHost:8080", true},
      {"[::1]:8080", true},
      {"127.0.0.1", false},
      {"localhost", false},
      {"127.0.0.1:8081", false},
      {"evil.example", false},
      {"evil.example:8080", false},
      {"127.0.0.1.evil:8080", false},
      {"127.0.0.1:08080", false},
      {"127.0.0.1:8080 ", false},
      {"", false},
      {":8080", false},
      {"127.0.0.1:", false},
      {"u@127.0.0.1:8080", false},
      {"localhost.:8080", false},
      {"127.0.0.2:8080", false},
      {"[::1", false},
      {"[]:8080", false},
      {"localhost:8080,evil", false},
      {"http://localhost:8080", false},
      {"localhost:99999", false},
      {"0.0.0.0:8080", false},
  };
  tcs_hosts *hosts = tcs_hosts_new();
  tcs_hosts_listen(hosts, "127.0.0.1:8080");
  CHECK_HOSTS(hosts, cases);
  assert_false(tcs_host_allowed(hosts, NULL));
  tcs_hosts_free(hosts);
}

TEST(test_hosts_on_the_usual_port) {
  static const host_case cases[] = {
      {"127.0.0.1", true}, {"localhost", true}, {"localhost:80", true}, {"localhost:81", false}};
  tcs_hosts *hosts = tcs_hosts_new();
  tcs_hosts_listen(hosts, "127.0.0.1:80");
  CHECK_HOSTS(hosts, cases);
  tcs_hosts_free(hosts);
}

TEST(test_hosts_of_a_wider_address) {
  static const host_case wide[] = {
      {"0.0.0.0:80", true}, {"127.0.0.1:80", true}, {"localhost:80", true}, {"[::1]:80", true}};
  static const host_case narrow[] = {{"192.0.2.7:90", true}, {"localhost:90", false}, {"127.0.0.1:90", false}};
  tcs_hosts *hosts = tcs_hosts_new();
  tcs_hosts_listen(hosts, "0.0.0.0:80");
  CHECK_HOSTS(hosts, wide);
  tcs_hosts_free(hosts);
  hosts = tcs_hosts_new();
  tcs_hosts_listen(hosts, "192.0.2.7:90");
  CHECK_HOSTS(hosts, narrow);
  tcs_hosts_free(hosts);
}

TEST(test_configured_hosts) {
  static const host_case cases[] = {{"any.example", true},      {"any.example:77", true}, {"ANY.example:77", true},
                                    {"one.example:443", true},  {"one.example", true},    {"one.example:444", false},
                                    {"sub.any.example", false}, {"any.example.", false},  {"[fe80::1]:9", true},
                                    {"odd.example", false}};
  static const char *const wrong[] = {"", "a b", "http://x", "x:", "x:0", "x:70000", "[x]", "x/y", "*"};
  tcs_hosts *hosts = tcs_hosts_new();
  assert_true(tcs_hosts_add(hosts, "any.example", NULL));
  assert_true(tcs_hosts_add(hosts, "One.example:443", NULL));
  assert_true(tcs_hosts_add(hosts, "odd.example:8080", NULL));
  assert_true(tcs_hosts_add(hosts, "[FE80::1]", NULL));
  CHECK_HOSTS(hosts, cases);
  for (size_t i = 0; i < G_N_ELEMENTS(wrong); i++)
    if (tcs_hosts_add(hosts, wrong[i], NULL)) fail_msg("host \"%s\" was taken", wrong[i]);
  tcs_hosts_free(hosts);
}

TEST(test_origins) {
  static const struct {
    const char *origin, *host;
    bool allowed;
  } cases[] = {
      {"http://127.0.0.1:8080", "127.0.0.1:8080", true},
      {"HTTP://LOCALHOST:8080", "localhost:8080", true},
      {"https://localhost:8080", "localhost:8080", true},
      {"http://localhost:8080", "127.0.0.1:8080", true}, /* another of its names */
      {"http://localhost:3000", "localhost:8080", false},
      {"http://localhost", "localhost:8080", false},
      {"http://evil.example", "127.0.0.1:8080", false},
      {"http://evil.example:8080", "127.0.0.1:8080", false},
      {"http://127.0.0.1:8080.evil.example", "127.0.0.1:8080", false},
      {"null", "127.0.0.1:8080", false},
      {"", "127.0.0.1:8080", false},
      {"http://127.0.0.1:8080/", "127.0.0.1:8080", false},
      {"ftp://127.0.0.1:8080", "127.0.0.1:8080", false},
      {"127.0.0.1:8080", "127.0.0.1:8080", false},
      {"http://x@127.0.0.1:8080", "127.0.0.1:8080", false},
      {"http://127.0.0.1:8080 http://evil.example", "127.0.0.1:8080", false},
      {"https://any.example", "any.example", true},
      {"https://any.example", "any.example:443", true},
      {"https://any.example:443", "any.example", true},
      {"http://any.example:443", "any.example", false},
      {"http://any.example:3000", "any.example", false}, /* a name for every port is not every page on it */
      {"https://any.example", "127.0.0.1:8080", false},
      {"https://front.example", "127.0.0.1:8080", true}, /* configured */
      {"http://front.example", "127.0.0.1:8080", false},
      {"https://front.example:444", "127.0.0.1:8080", false},
  };
  static const char *const wrong[] = {"", "front.example", "https://", "https://x/", "https://x/y", "null", "*"};
  tcs_hosts *hosts = tcs_hosts_new();
  tcs_hosts_listen(hosts, "127.0.0.1:8080");
  assert_true(tcs_hosts_add(hosts, "any.example", NULL));
  assert_true(tcs_hosts_add_origin(hosts, "https://Front.example", NULL));
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++)
    if (tcs_origin_allowed(hosts, cases[i].origin, cases[i].host) != cases[i].allowed)
      fail_msg("origin \"%s\" at host \"%s\"", cases[i].origin, cases[i].host);
  for (size_t i = 0; i < G_N_ELEMENTS(wrong); i++)
    if (tcs_hosts_add_origin(hosts, wrong[i], NULL)) fail_msg("origin \"%s\" was taken", wrong[i]);
  tcs_hosts_free(hosts);
}

TEST(test_loopback_addresses) {
  assert_true(tcs_address_is_loopback("127.0.0.1"));
  assert_true(tcs_address_is_loopback("127.9.9.9"));
  assert_true(tcs_address_is_loopback("::1"));
  assert_false(tcs_address_is_loopback("0.0.0.0"));
  assert_false(tcs_address_is_loopback("::"));
  assert_false(tcs_address_is_loopback("192.0.2.1"));
}

#define FIRST "0123456789abcdef"
#define OTHER "fedcba9876543210-._~+/="

TEST(test_token_files) {
  bool clear;
  tcs_tokens *tokens =
      tcs_tokens_parse("# who\n\n anna\tview " FIRST "\r\nbert edit   " OTHER "\nbert admin " FIRST "x", &clear, NULL);
  assert_non_null(tokens);
  assert_true(clear);
  assert_string_equal(tcs_tokens_find(tokens, FIRST, NULL)->name, "anna");
  assert_int_equal(tcs_tokens_find(tokens, FIRST, NULL)->role, TCS_ROLE_VIEW);
  assert_int_equal(tcs_tokens_find(tokens, OTHER, NULL)->role, TCS_ROLE_EDIT);
  assert_int_equal(tcs_tokens_find(tokens, FIRST "x", NULL)->role, TCS_ROLE_ADMIN);
  const char *const unknown[] = {"", FIRST "y", "0123456789abcde", "anna", "sha256:"};
  for (size_t i = 0; i < G_N_ELEMENTS(unknown); i++)
    assert_null(tcs_tokens_find(tokens, unknown[i], NULL));
  tcs_tokens_free(tokens);
}

TEST(test_hashed_tokens) {
  bool clear;
  uint8_t hash[TCS_HASH_SIZE];
  char hex[2 * TCS_HASH_SIZE + 1];
  tcs_hash(FIRST, hash);
  tcs_hex(hash, sizeof hash, hex);
  g_autofree char *text = g_strdup_printf("anna admin sha256:%s\n", hex);
  tcs_tokens *tokens = tcs_tokens_parse(text, &clear, NULL);
  assert_non_null(tokens);
  assert_false(clear);
  assert_non_null(tcs_tokens_find(tokens, FIRST, NULL));
  assert_null(tcs_tokens_find(tokens, hex, NULL)); /* the hash opens nothing */
  tcs_tokens_free(tokens);
}

TEST(test_token_files_that_are_wrong) {
  static const struct {
    const char *text, *message;
  } cases[] = {
      {"", "no token"},
      {"# only\n", "no token"},
      {"anna view\n", "line 1: give NAME ROLE TOKEN"},
      {"\n\nanna view " FIRST " more\n", "line 3: give NAME ROLE TOKEN"},
      {"an/na view " FIRST, "line 1: a name"},
      {"anna root " FIRST, "line 1: a role"},
      {"anna none " FIRST, "line 1: a role"},
      {"anna view short", "line 1: a token is 16"},
      {"anna view 0123456789abcde!", "line 1: a token is 16"},
      {"anna view sha256:12", "line 1: after sha256:"},
      {"anna view " FIRST "\nbert edit " FIRST, "line 2: this token stands"},
  };
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    bool clear;
    g_autoptr(GError) error = NULL;
    assert_null(tcs_tokens_parse(cases[i].text, &clear, &error));
    if (!strstr(error->message, cases[i].message)) fail_msg("case %zu: %s", i, error->message);
    assert_null(strstr(error->message, "short"));
    assert_null(strstr(error->message, "0123456789abcde")); /* never the token itself */
  }
}

/* What a file with this text and mode is refused for; "" = it is taken. */
static void check_file(const char *text, mode_t mode, const char *message) {
  char path[] = "/tmp/tomocast-unit-XXXXXX";
  const int fd = mkstemp(path);
  assert_int_equal(write(fd, text, strlen(text)), (ssize_t)strlen(text));
  fchmod(fd, mode);
  close(fd);
  GError *error = NULL;
  tcs_tokens *tokens = tcs_tokens_read(path, &error);
  if (*message ? !error || !strstr(error->message, message) : !tokens)
    fail_msg("mode %o: %s", (unsigned)mode, error ? error->message : "taken");
  g_clear_error(&error);
  tcs_tokens_free(tokens);
  unlink(path);
}

TEST(test_modes_of_token_files) {
  static const char hashed[] = "a view sha256:0123456789012345678901234567890123456789012345678901234567890123\n";
  check_file("a view " FIRST "\n", 0600, "");
  check_file("a view " FIRST "\n", 0640, "others may read it; chmod 600");
  check_file("a view " FIRST "\n", 0604, "others may read it");
  check_file(hashed, 0644, "");
  check_file(hashed, 0666, "others may write it");
  g_autoptr(GError) error = NULL;
  assert_null(tcs_tokens_read("/nothing/here", &error));
  assert_non_null(strstr(error->message, "--token-file /nothing/here: "));
}

TEST(test_every_token_is_compared) {
  GString *text = g_string_new(NULL);
  for (int i = 0; i < 100; i++)
    g_string_append_printf(text, "n%d view token-number-%06d\n", i, i);
  bool clear;
  tcs_tokens *tokens = tcs_tokens_parse(text->str, &clear, NULL);
  const char *const presented[] = {"token-number-000000", "token-number-000050", "token-number-000099", "none", ""};
  for (size_t i = 0; i < G_N_ELEMENTS(presented); i++) {
    size_t compared = 0;
    const tcs_token *token = tcs_tokens_find(tokens, presented[i], &compared);
    assert_int_equal(token != NULL, i < 3);
    assert_int_equal(compared, 100); /* found first, last or not at all */
  }
  assert_string_equal(tcs_tokens_find(tokens, presented[1], NULL)->name, "n50");
  tcs_tokens_free(tokens);
  g_string_free(text, TRUE);
}

TEST(test_hashes_differ_in_any_byte) {
  uint8_t a[TCS_HASH_SIZE] = {0}, b[TCS_HASH_SIZE] = {0};
  assert_true(tcs_hash_equal(a, b));
  for (int i = 0; i < TCS_HASH_SIZE * 8; i++) {
    b[i / 8] ^= (uint8_t)(1 << i % 8);
    assert_false(tcs_hash_equal(a, b));
    b[i / 8] = 0;
  }
}

TEST(test_known_hashes) {
  uint8_t out[TCS_HASH_SIZE];
  char hex[2 * TCS_HASH_SIZE + 1];
  tcs_hash("abc", out); /* FIPS 180-4 */
  tcs_hex(out, sizeof out, hex);
  assert_string_equal(hex, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  tcs_sign("Jefe", 4, "what do ya want for nothing?", out); /* RFC 4231, test case 2 */
  tcs_hex(out, sizeof out, hex);
  assert_string_equal(hex, "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843");
  uint8_t back[TCS_HASH_SIZE];
  assert_true(tcs_unhex(hex, back, sizeof back));
  assert_memory_equal(back, out, sizeof out);
  assert_false(tcs_unhex("0", back, 1));
  assert_false(tcs_unhex("0g", back, 1));
  assert_false(tcs_unhex("000", back, 1));
}

TEST(test_tickets) {
  const int64_t second = 1000000, start = 5 * second;
  tcs_tickets *tickets = tcs_tickets_new();
  const tcs_caller anna = {.name = "anna", .role = TCS_ROLE_EDIT, .session = "s1"};
  tcs_caller caller = {0};
  char first[TCS_TICKET_SIZE], second_ticket[TCS_TICKET_SIZE];
  assert_true(tcs_tickets_issue(tickets, &anna, start, first));
  assert_int_equal(strlen(first), 32);
  assert_false(tcs_tickets_take(tickets, "", start, &caller));
  assert_false(tcs_tickets_take(tickets, "00000000000000000000000000000000", start, &caller));
  assert_true(tcs_tickets_take(tickets, first, start + second, &caller));
  assert_memory_equal(&caller, &anna, sizeof anna);
  assert_false(tcs_tickets_take(tickets, first, start + second, &caller)); /* once */
  assert_true(tcs_tickets_issue(tickets, &anna, start, first));
  assert_true(tcs_tickets_issue(tickets, &anna, start + second, second_ticket));
  assert_false(tcs_tickets_take(tickets, first, start + TCS_TICKET_S * second, &caller)); /* too late */
  assert_true(tcs_tickets_take(tickets, second_ticket, start + TCS_TICKET_S * second, &caller));
  assert_int_equal(tcs_tickets_count(tickets, start + TCS_TICKET_S * second), 0);
  tcs_tickets_free(tickets);
}

TEST(test_tickets_are_few) {
  tcs_tickets *tickets = tcs_tickets_new();
  tcs_caller caller = {.name = "anna", .role = TCS_ROLE_VIEW};
  char ticket[TCS_TICKET_SIZE];
  for (int i = 0; i < TCS_TICKETS_EACH; i++)
    assert_true(tcs_tickets_issue(tickets, &caller, 0, ticket));
  assert_false(tcs_tickets_issue(tickets, &caller, 0, ticket));
  for (int i = TCS_TICKETS_EACH; i < TCS_TICKETS_ALL; i++) {
    g_snprintf(caller.name, sizeof caller.name, "b%d", i / TCS_TICKETS_EACH);
    assert_true(tcs_tickets_issue(tickets, &caller, 0, ticket));
  }
  g_strlcpy(caller.name, "carl", sizeof caller.name);
  assert_false(tcs_tickets_issue(tickets, &caller, 0, ticket));
  assert_int_equal(tcs_tickets_count(tickets, 0), TCS_TICKETS_ALL);
  assert_true(tcs_tickets_issue(tickets, &caller, TCS_TICKET_S * INT64_C(1000000), ticket)); /* the old ones are gone */
  assert_int_equal(tcs_tickets_count(tickets, TCS_TICKET_S * INT64_C(1000000)), 1);
  tcs_tickets_free(tickets);
}

TEST(test_links) {
  const uint8_t key[TCS_SHARE_KEY_SIZE] = {1, 2, 3}, other[TCS_SHARE_KEY_SIZE] = {1, 2, 4};
  const char session[] = "00112233445566778899aabbccddeeff";
  char token[TCS_SHARE_SIZE];
  tcs_caller caller = {0};
  tcs_share_sign(key, session, TCS_ROLE_VIEW, 1000, token);
  assert_true(g_str_has_prefix(token, "00112233445566778899aabbccddeeff.view.1000."));
  assert_true(tcs_share_check(key, token, 999, &caller));
  assert_string_equal(caller.session, session);
  assert_int_equal(caller.role, TCS_ROLE_VIEW);
  assert_int_equal(caller.until_s, 1000);
  assert_false(tcs_share_check(key, token, 1000, &caller));
  assert_false(tcs_share_check(other, token, 0, &caller));
  for (size_t i = 0; token[i]; i++) { /* any character changed, and any piece cut */
    char forged[TCS_SHARE_SIZE];
    memcpy(forged, token, sizeof forged);
    forged[i] = forged[i] == '1' ? '2' : '1';
    if (tcs_share_check(key, forged, 0, &caller)) fail_msg("taken: %s", forged);
    memcpy(forged, token, sizeof forged);
    forged[i] = 0;
    assert_false(tcs_share_check(key, forged, 0, &caller));
  }
}

#define SECOND INT64_C(1000000)

TEST(test_guessing_takes_longer_and_longer) {
  tcs_lockout *lockout = tcs_lockout_new();
  int64_t now = 1000 * SECOND;
  uint64_t token = 1;
  for (; token <= TCS_LOCKOUT_FREE; token++)
    tcs_lockout_fail(lockout, 7, token, now);
  assert_int_equal(tcs_lockout_wait(lockout, 7, 999, now), 0);
  for (int i = 0; i < 5; i++)
    tcs_lockout_fail(lockout, 7, token - 1, now); /* no other one */
  assert_int_equal(tcs_lockout_wait(lockout, 7, 999, now), 0);
  tcs_lockout_pass(lockout, 555);
  for (int expected = 1; expected < 2000; expected *= 2) {
    const int wait = MIN(expected, TCS_LOCKOUT_MOST_S);
    tcs_lockout_fail(lockout, 7, token++, now);
    assert_int_equal(tcs_lockout_wait(lockout, 7, 999, now), wait);
    assert_int_equal(tcs_lockout_wait(lockout, 7, 555, now), 0);
    assert_int_equal(tcs_lockout_wait(lockout, 8, 999, now), 0);
    tcs_lockout_fail(lockout, 7, token++, now); /* while it waits: does not count */
    assert_int_equal(tcs_lockout_wait(lockout, 7, 999, now + 1), wait);
    now += wait * SECOND;
    assert_int_equal(tcs_lockout_wait(lockout, 7, 999, now), 0);
  }
  tcs_lockout_fail(lockout, 7, token, now + (TCS_LOCKOUT_FORGET_S + 1) * SECOND);
  assert_int_equal(tcs_lockout_wait(lockout, 7, 999, now + (TCS_LOCKOUT_FORGET_S + 1) * SECOND), 0);
  tcs_lockout_free(lockout);
}

/* A crowd of them makes the table forget those that were quiet the longest. */
TEST(test_peers_that_guess_are_bounded) {
  tcs_lockout *lockout = tcs_lockout_new();
  for (uint64_t token = 0; token <= TCS_LOCKOUT_FREE; token++)
    tcs_lockout_fail(lockout, 1, token, SECOND);
  assert_int_equal(tcs_lockout_wait(lockout, 1, 999, SECOND), 1);
  for (uint64_t peer = 2; peer < 2 + TCS_LOCKOUT_PEERS; peer++)
    tcs_lockout_fail(lockout, peer, 5, SECOND + (int64_t)peer);
  assert_int_equal(tcs_lockout_wait(lockout, 1, 999, SECOND), 0);
  tcs_lockout_free(lockout);
}

TEST(test_callers_last_as_long_as_their_tokens) {
  bool clear;
  tcs_access access = {.tokens = tcs_tokens_parse("anna edit " FIRST "\n", &clear, NULL), .generation = 1};
  tcs_caller anna = {.name = "anna", .role = TCS_ROLE_EDIT, .generation = 1}, link = {.until_s = INT64_MAX}, late = {.until_s = 1};
  tcs_hash(FIRST, anna.token);
  assert_true(tcs_access_lasts(&access, &anna));
  assert_true(tcs_access_lasts(&access, &link));
  assert_false(tcs_access_lasts(&access, &late));
  tcs_access_renew(&access, tcs_tokens_parse("bert view " OTHER "\nanna edit " FIRST "\n", &clear, NULL));
  assert_true(tcs_access_lasts(&access, &anna));
  tcs_access_renew(&access, tcs_tokens_parse("anna view " FIRST "\n", &clear, NULL)); /* another role */
  assert_false(tcs_access_lasts(&access, &anna));
  assert_false(tcs_access_lasts(&access, &anna));
  tcs_access_renew(&access, tcs_tokens_parse("anna edit " OTHER "\n", &clear, NULL)); /* another token */
  assert_false(tcs_access_lasts(&access, &anna));
  assert_true(tcs_access_lasts(&access, &link));
  tcs_tokens_free(access.tokens);
}

TEST(test_who_sees_what) {
  const tcs_caller stranger = {0}, anna = {.name = "anna", .role = TCS_ROLE_EDIT},
                   root = {.name = "root", .role = TCS_ROLE_ADMIN},
                   guest = {.name = "share-s1", .role = TCS_ROLE_EDIT, .session = "s1"},
                   bounded = {.name = "root", .role = TCS_ROLE_ADMIN, .session = "s1"};
  assert_false(tcs_caller_sees(&stranger, "s1", ""));
  assert_true(tcs_caller_sees(&anna, "s1", "anna"));
  assert_false(tcs_caller_sees(&anna, "s1", "bert"));
  assert_false(tcs_caller_sees(&anna, "s1", NULL));
  assert_false(tcs_caller_sees(&anna, "s1", ""));
  assert_true(tcs_caller_sees(&root, "s1", "bert"));
  assert_true(tcs_caller_sees(&guest, "s1", "bert"));
  assert_false(tcs_caller_sees(&guest, "s2", "share-s1"));
  assert_false(tcs_caller_owns(&guest, "share-s1"));
  assert_false(tcs_caller_sees(&bounded, "s2", "root"));
}

TEST(test_nobody_is_let_in_by_oversight) {
  static const struct {
    const char *address;
    bool insecure, good;
  } cases[] = {{"127.0.0.1", false, true}, {"::1", false, true},        {"0.0.0.0", false, false},
               {"::", false, false},       {"192.0.2.1", false, false}, {"0.0.0.0", true, true}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    GError *error = NULL;
    tcs_config config;
    tcs_config_init(&config);
    g_free(config.listen.address);
    config.listen.address = g_strdup(cases[i].address);
    config.insecure_no_auth = cases[i].insecure;
    tcs_access *access = tcs_access_new(&config, &error);
    assert_int_equal(access != NULL, cases[i].good);
    if (error) assert_non_null(strstr(error->message, "--token-file FILE"));
    g_clear_error(&error);
    tcs_access_free(access);
    tcs_config_clear(&config);
  }
}

static void peer_of(tcs_proxies *proxies, const char *from, const char *forwarded, const char *x, const char *wanted) {
  struct sockaddr_in v4 = {.sin_family = AF_INET};
  struct sockaddr_in6 v6 = {.sin6_family = AF_INET6};
  char peer[INET6_ADDRSTRLEN];
  const bool is_v4 = inet_pton(AF_INET, from, &v4.sin_addr) == 1;
  if (!is_v4) assert_int_equal(inet_pton(AF_INET6, from, &v6.sin6_addr), 1);
  tcs_proxies_peer(proxies, is_v4 ? (const struct sockaddr *)&v4 : (const struct sockaddr *)&v6, forwarded, x, peer);
  if (strcmp(peer, wanted) != 0) fail_msg("from %s, %s, %s: %s, not %s", from, forwarded, x, peer, wanted);
}

TEST(test_peers_behind_proxies) {
  static const char *const wrong[] = {"", "10.0.0.0/33", "::/129", "10.0.0.0/", "10.0.0.0/-1", "proxy", "10.0.0.1:80", "1.2.3.4/8/8"};
  tcs_proxies *proxies = tcs_proxies_new();
  peer_of(proxies, "10.1.2.3", "for=9.9.9.9", "9.9.9.9", "10.1.2.3"); /* nobody is trusted */
  assert_true(tcs_proxies_add(proxies, "10.0.0.0/9", NULL));
  assert_true(tcs_proxies_add(proxies, "fd00::/8", NULL));
  assert_true(tcs_proxies_add(proxies, "192.0.2.1", NULL));
  for (size_t i = 0; i < G_N_ELEMENTS(wrong); i++) {
    g_autoptr(GError) error = NULL;
    if (tcs_proxies_add(proxies, wrong[i], &error)) fail_msg("taken: %s", wrong[i]);
  }
  peer_of(proxies, "10.127.2.3", NULL, "9.9.9.9", "9.9.9.9");
  peer_of(proxies, "::ffff:10.0.0.1", NULL, "9.9.9.9", "9.9.9.9"); /* a socket of both families */
  peer_of(proxies, "::ffff:8.0.0.1", NULL, "9.9.9.9", "8.0.0.1");
  peer_of(proxies, "10.128.0.1", NULL, "9.9.9.9", "10.128.0.1");
  peer_of(proxies, "fdff::1", NULL, "2001:db8:1:2:3::4", "2001:db8:1:2::");
  peer_of(proxies, "fe00::1", NULL, "9.9.9.9", "fe00::");
  peer_of(proxies, "10.0.0.1", NULL, "1.1.1.1, 9.9.9.9 ,192.0.2.1,\tfd00::5", "9.9.9.9");
  peer_of(proxies, "10.0.0.1", NULL, "192.0.2.1", "192.0.2.1"); /* proxies alone */
  peer_of(proxies, "10.0.0.1", NULL, "9.9.9.9, nonsense, 192.0.2.1", "192.0.2.1");
  peer_of(proxies, "10.0.0.1", NULL, "9.9.9.9:443", "9.9.9.9");
  peer_of(proxies, "10.0.0.1", NULL, "[2001:db8::9]:443", "2001:db8::");
  for (const char *const *bad = (const char *const[]){"", ",", "[", "[]", "[9.9.9.9]", "9.9.9.9:x", "[2001:db8::9", "[2001:db8::9]x", "a,9.9.9.999", NULL}; *bad; bad++)
    peer_of(proxies, "10.0.0.1", NULL, *bad, "10.0.0.1");
  peer_of(proxies, "10.0.0.1", "for=1.1.1.1, by=10.0.0.1; For=\"9.9.9.9:80\" ;proto=http", NULL, "9.9.9.9");
  peer_of(proxies, "10.0.0.1", "for=\"[2001:db8:0:1::5]:1\"", NULL, "2001:db8:0:1::");
  for (const char *const *bad = (const char *const[]){"for=", "for=unknown", "for=_hidden", "by=9.9.9.9", "for=\"", "9.9.9.9", ";", NULL}; *bad; bad++)
    peer_of(proxies, "10.0.0.1", *bad, NULL, "10.0.0.1");
  peer_of(proxies, "10.0.0.1", "for=9.9.9.9", "9.9.9.9", "9.9.9.9");
  peer_of(proxies, "10.0.0.1", "for=8.8.8.8", "9.9.9.9", "10.0.0.1"); /* one of them is somebody's invention */
  tcs_proxies_free(proxies);
}

TESTS(NULL, NULL)
