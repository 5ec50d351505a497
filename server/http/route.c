#include "server/http/route.h"

#include <glib.h>
#include <string.h>

static bool fits(const char *pattern, const char *path, char params[TCS_MAX_PARAMS][TCS_PARAM_SIZE]) {
  int count = 0;
  while (*pattern) {
    if (*pattern != '{') {
      if (*pattern++ != *path++) return false;
      continue;
    }
    const size_t length = strcspn(path, "/");
    if (length == 0 || length >= TCS_PARAM_SIZE || count >= TCS_MAX_PARAMS) return false;
    memcpy(params[count], path, length);
    params[count++][length] = 0;
    path += length;
    pattern += strcspn(pattern, "}") + 1;
  }
  return *path == 0;
}

static void allow(tcs_match *match, const char *method) {
  /* Two patterns may match one path. No method's name contains another's. */
  if (strstr(match->allow, method)) return;
  if (match->allow[0]) g_strlcat(match->allow, ", ", sizeof match->allow);
  g_strlcat(match->allow, method, sizeof match->allow);
}

void tcs_route_match(const tcs_route *routes, const char *method, const char *path, tcs_match *match) {
  memset(match, 0, sizeof *match);
  const char *wanted = strcmp(method, "HEAD") == 0 ? "GET" : method;
  char params[TCS_MAX_PARAMS][TCS_PARAM_SIZE] = {{0}};
  for (const tcs_route *route = routes; route->method; route++) {
    if (!fits(route->pattern, path, params)) continue;
    if (strcmp(route->method, wanted) == 0) {
      match->route = route;
      memcpy(match->params, params, sizeof params);
      return;
    }
    match->path_known = true;
    allow(match, route->method);
    if (strcmp(route->method, "GET") == 0) allow(match, "HEAD");
  }
}
