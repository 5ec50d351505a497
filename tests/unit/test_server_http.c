/* Routes, the WebSocket handshake, metrics, configuration, paths: what of the HTTP side needs no socket. */
#include "tests/support/test.h"
#include <sys/stat.h>
#include <unistd.h>

#include "renderer/import/links.h"
#include "server/catalogue/beneath.h"
#include "server/config/config.h"
#include "server/http/http.h"
#include "server/observe/metrics.h"
#include "server/ws/handshake.h"

static void handler(tcs_request *request) {}

static const tcs_route table[] = {
    {"GET", "/", handler, TCS_COST_LOOKUP, TCS_BODY_NONE},
    {"GET", "/a/{id}", handler, TCS_COST_LOOKUP, TCS_BODY_NONE},
    {"DELETE", "/a/{id}", handler, TCS_COST_LOOKUP, TCS_BODY_NONE},
    {"PUT", "/a/{id}/b/{other}", handler, TCS_COST_LOOKUP, TCS_BODY_NONE},
    {"GET", "/{file}", handler, TCS_COST_LOOKUP, TCS_BODY_NONE},
    {0},
};

TEST(test_route_finds_and_extracts) {
  tcs_match match;
  tcs_route_match(table, "GET", "/a/x.y-z", &match);
  assert_ptr_equal(match.route, &table[1]);
  assert_string_equal(match.params[0], "x.y-z");
  tcs_route_match(table, "HEAD", "/", &match);
  assert_ptr_equal(match.route, &table[0]);
  tcs_route_match(table, "PUT", "/a/1/b/2", &match);
  assert_ptr_equal(match.route, &table[3]);
  assert_string_equal(match.params[0], "1");
  assert_string_equal(match.params[1], "2");
}

TEST(test_route_tells_404_from_405) {
  tcs_match match;
  tcs_route_match(table, "POST", "/a/x", &match);
  assert_null(match.route);
  assert_true(match.path_known);
  assert_string_equal(match.allow, "GET, HEAD, DELETE");
  const char *const unknown[] = {"", "a", "/a/", "/a/x/", "/a//b", "/a/x/b", "/a/1/b/2/", "//", "/a/x/c/y"};
  for (size_t i = 0; i < G_N_ELEMENTS(unknown); i++) {
    tcs_route_match(table, "GET", unknown[i], &match);
    assert_null(match.route);
    assert_false(match.path_known);
  }
}

TEST(test_route_refuses_overlong_params) {
  tcs_match match;
  char path[400] = "/a/";
  memset(path + 3, 'x', TCS_PARAM_SIZE - 1);
  tcs_route_match(table, "GET", path, &match);
  assert_non_null(match.route);
  path[3 + TCS_PARAM_SIZE - 1] = 'x';
  tcs_route_match(table, "GET", path, &match);
  assert_null(match.route);
}

TEST(test_every_route_of_the_daemon_is_reachable) {
  for (const tcs_route *route = tcs_routes; route->method; route++) {
    tcs_match match;
    tcs_route_match(tcs_routes, route->method, route->pattern, &match); /* "{id}" is a segment as good as any */
    assert_ptr_equal(match.route, route);
  }
}

TEST(test_token_lists) {
  assert_true(tcs_token_in("keep-alive, Upgrade", "upgrade", true));
  assert_true(tcs_token_in("a ,\tb,c", "b", false));
  assert_false(tcs_token_in("a, bc", "b", false));
  assert_false(tcs_token_in("B", "b", false));
  assert_false(tcs_token_in("", "b", false));
  assert_false(tcs_token_in(NULL, "b", false));
  assert_false(tcs_token_in(",,, ,", "b", false));
  assert_true(tcs_etag_listed("\"1\", \"2\"", "\"2\""));
  assert_true(tcs_etag_listed("*", "\"2\""));
  assert_false(tcs_etag_listed("W/\"2\"", "\"2\"")); /* weak tags never match strongly */
  assert_false(tcs_etag_listed(NULL, "\"2\""));
}

TEST(test_websocket_handshake) {
  char *accept = tcs_websocket_accept("dGhlIHNhbXBsZSBub25jZQ=="); /* RFC 6455, section 1.3 */
  assert_string_equal(accept, "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=");
  g_free(accept);
  assert_true(tcs_websocket_key_valid("dGhlIHNhbXBsZSBub25jZQ=="));
  assert_false(tcs_websocket_key_valid(""));
  assert_false(tcs_websocket_key_valid("dGhlIHNhbXBsZSBub25jZQ="));
  assert_false(tcs_websocket_key_valid("dGhlIHNhbXBsZSBub25jZQ=a"));
  assert_false(tcs_websocket_key_valid("dGhl HNhbXBsZSBub25jZQ=="));
}

TEST(test_histogram_buckets) {
  tcs_metrics metrics;
  tcs_gauges gauges = {.sessions = 3};
  tcs_metrics_init(&metrics);
  tcs_histogram_add(&metrics.render, 0.0005); /* a bound belongs to its bucket */
  tcs_histogram_add(&metrics.render, 0.004);
  tcs_histogram_add(&metrics.render, 99);
  tcs_metrics_request(&metrics, "GET", "/x/{id}", 200, 0.1);
  tcs_metrics_request(&metrics, "GET", "/x/{id}", 200, 0.1);
  char *text = tcs_metrics_write(&metrics, &gauges, "cpu");
  assert_non_null(strstr(text, "tomocast_render_seconds_bucket{le=\"0.0005\"} 1\n"));
  assert_non_null(strstr(text, "tomocast_render_seconds_bucket{le=\"0.005\"} 2\n"));
  assert_non_null(strstr(text, "tomocast_render_seconds_bucket{le=\"2.5\"} 2\n"));
  assert_non_null(strstr(text, "tomocast_render_seconds_bucket{le=\"+Inf\"} 3\n"));
  assert_non_null(strstr(text, "tomocast_render_seconds_count 3\n"));
  assert_non_null(strstr(text, "{method=\"GET\",route=\"/x/{id}\",code=\"200\"} 2\n"));
  assert_non_null(strstr(text, "tomocast_sessions 3\n"));
  g_free(text);
  tcs_metrics_clear(&metrics);
}

TEST(test_listen_addresses) {
  tcs_config config;
  tcs_config_init(&config);
  assert_true(tcs_config_listen(&config.listen, "--listen", "10.0.0.1:99", NULL));
  assert_string_equal(config.listen.address, "10.0.0.1");
  assert_int_equal(config.listen.port, 99);
  assert_true(tcs_config_listen(&config.listen, "--listen", "[::1]:0", NULL));
  assert_string_equal(config.listen.address, "::1");
  assert_true(tcs_config_listen(&config.listen, "--listen", ":80", NULL));
  assert_string_equal(config.listen.address, "0.0.0.0");
  const char *const wrong[] = {"", ":", "x", "x:", "x:y", "x:70000", "x:-1", "x:8o"};
  for (size_t i = 0; i < G_N_ELEMENTS(wrong); i++)
    assert_false(tcs_config_listen(&config.listen, "--listen", wrong[i], NULL));
  tcs_config_clear(&config);
}

TEST(test_ids) {
  assert_true(tcs_id_valid("a"));
  assert_true(tcs_id_valid("A.b_c-9"));
  assert_true(tcs_id_valid("1234567890123456789012345678901234567890123456789012345678901234"));
  assert_false(tcs_id_valid("12345678901234567890123456789012345678901234567890123456789012345"));
  assert_false(tcs_id_valid(""));
  assert_false(tcs_id_valid("a b"));
  assert_false(tcs_id_valid("a/b"));
  assert_false(tcs_id_valid("\xc3\xa9"));
}

static void write_file(const char *folder, const char *name, const char *text) {
  g_autofree char *path = g_build_filename(folder, name, NULL);
  assert_true(g_file_set_contents(path, text, -1, NULL));
}

TEST(test_paths_stay_beneath) {
  char folder[] = "/tmp/tomocast-unit-XXXXXX";
  assert_non_null(mkdtemp(folder));
  char *inside = g_build_filename(folder, "in", NULL), *file = g_build_filename(folder, "in/f", NULL),
       *out = g_build_filename(folder, "in/out", NULL), *up = g_build_filename(folder, "in/up", NULL);
  mkdir(inside, 0700);
  write_file(folder, "in/f", "x");
  write_file(folder, "secret", "x");
  assert_int_equal(symlink("/etc/passwd", out), 0);
  assert_int_equal(symlink("../secret", up), 0);
  char *found = tcs_beneath(inside, "f", NULL);
  assert_string_equal(found, file);
  g_free(found);
  found = tcs_beneath(inside, "f#2", NULL);
  assert_true(g_str_has_suffix(found, "in/f#2"));
  g_free(found);
  const char *const wrong[] = {"",   "..",      "../secret", "/etc/passwd", "out",
                               "up", "nothing", "f/..",      "./../secret", "up#1"};
  for (size_t i = 0; i < G_N_ELEMENTS(wrong); i++) {
    g_autoptr(GError) error = NULL;
    found = tcs_beneath(inside, wrong[i], &error);
    if (found) fail_msg("%s gave %s", wrong[i], found);
    assert_string_equal(tc_error_pointer(error), "/path");
  }
  const char *roots[] = {folder};
  assert_true(tc_links_set(roots, 1, NULL)); /* what is in it may be linked to, and nothing else */
  found = tcs_beneath(inside, "up", NULL);
  assert_true(g_str_has_suffix(found, "/secret"));
  g_free(found);
  for (const char *const *path = (const char *const[]){"out", "../secret", "up/..", "in/../../secret", NULL}; *path; path++)
    assert_null(tcs_beneath(inside, *path, NULL));
  assert_true(tc_links_set(NULL, 0, NULL));
  char *command[] = {"rm", "-r", folder, NULL};
  g_spawn_sync(NULL, command, NULL, G_SPAWN_SEARCH_PATH, NULL, NULL, NULL, NULL, NULL, NULL);
  g_free(inside);
  g_free(file);
  g_free(out);
  g_free(up);
}

TESTS(NULL, NULL)
