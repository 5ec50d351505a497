/* The OpenAPI document and the daemon's route table name the same calls. */
#include "tests/support/test.h"

#include "protocol/protocol.h"
#include "server/http/http.h"

/* Files of the browser client hang under "/" and are no call of their own. */
static bool is_call(const tcs_route *route) { return strcmp(route->pattern, "/{file}") != 0; }

TEST(every_route_is_documented) {
  cJSON *document = tcp_openapi("0"), *paths = cJSON_GetObjectItemCaseSensitive(document, "paths");
  int routes = 0;
  for (const tcs_route *route = tcs_routes; route->method; route++) {
    g_autofree char *method = g_ascii_strdown(route->method, -1);
    if (is_call(route)) {
      cJSON *path = cJSON_GetObjectItemCaseSensitive(paths, route->pattern);
      if (!cJSON_GetObjectItemCaseSensitive(path, method))
        fail_msg("%s %s is not documented", route->method, route->pattern);
      routes++;
    }
  }
  assert_true(routes > 20);
  cJSON_Delete(document);
}

static bool has_route(const char *method, const char *path) {
  for (const tcs_route *route = tcs_routes; route->method; route++)
    if (g_ascii_strcasecmp(route->method, method) == 0 && strcmp(route->pattern, path) == 0) return true;
  return false;
}

TEST(every_documented_call_has_a_route) {
  cJSON *document = tcp_openapi("0"), *path, *call;
  cJSON_ArrayForEach(path, cJSON_GetObjectItemCaseSensitive(document, "paths")) {
    cJSON_ArrayForEach(call, path) {
      if (strcmp(call->string, "parameters") == 0) continue;
      if (!has_route(call->string, path->string)) fail_msg("%s %s has no route", call->string, path->string);
    }
  }
  cJSON_Delete(document);
}

TESTS(NULL, NULL)
