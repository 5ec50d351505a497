/* Who may ask: hosts, origins. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "server/access/hosts.h"

typedef struct host_case {
  const char *host;
  bool allowed;
} host_case;

static void check_hosts(const tcs_hosts *hosts, const host_case *cases, size_t count) {
  for (size_t i = 0; i < count; i++)
    if (tcs_host_allowed(hosts, cases[i].host) != cases[i].allowed) fail_msg("host \"%s\"", cases[i].host);
}
#define CHECK_HOSTS(hosts, cases) check_hosts(hosts, cases, G_N_ELEMENTS(cases))

static void test_hosts_of_loopback(void **state) {
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

static void test_hosts_on_the_usual_port(void **state) {
  static const host_case cases[] = {
      {"127.0.0.1", true}, {"localhost", true}, {"localhost:80", true}, {"localhost:81", false}};
  tcs_hosts *hosts = tcs_hosts_new();
  tcs_hosts_listen(hosts, "127.0.0.1:80");
  CHECK_HOSTS(hosts, cases);
  tcs_hosts_free(hosts);
}

static void test_hosts_of_a_wider_address(void **state) {
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

static void test_configured_hosts(void **state) {
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

static void test_origins(void **state) {
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

static void test_loopback_addresses(void **state) {
  assert_true(tcs_address_is_loopback("127.0.0.1"));
  assert_true(tcs_address_is_loopback("127.9.9.9"));
  assert_true(tcs_address_is_loopback("::1"));
  assert_false(tcs_address_is_loopback("0.0.0.0"));
  assert_false(tcs_address_is_loopback("::"));
  assert_false(tcs_address_is_loopback("192.0.2.1"));
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_hosts_of_loopback),
      cmocka_unit_test(test_hosts_on_the_usual_port),
      cmocka_unit_test(test_hosts_of_a_wider_address),
      cmocka_unit_test(test_configured_hosts),
      cmocka_unit_test(test_origins),
      cmocka_unit_test(test_loopback_addresses),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
