#include "server/http/admission.h"

#include <string.h>

#include "server/access/access.h"

typedef struct tally {
  const char *name;
  int count;
} tally;

static enum MHD_Result count_one(void *user, enum MHD_ValueKind kind, const char *name, const char *value) {
  tally *wanted = user;
  wanted->count += g_ascii_strcasecmp(name, wanted->name) == 0;
  return MHD_YES;
}

/* How often a header is given. */
static int header_count(const tcs_request *request, const char *name) {
  tally wanted = {name, 0};
  MHD_get_connection_values(request->connection, MHD_HEADER_KIND, count_one, &wanted);
  return wanted.count;
}

bool tcs_admit_host(tcs_request *request) {
  const int count = header_count(request, "Host");
  if (count != 1) {
    tcs_reply_problem(request, 400, "host", "Bad request", count ? "give one Host header" : "give a Host header");
    return false;
  }
  if (tcs_host_allowed(request->server->access->hosts, tcs_header(request, "Host"))) return true;
  tcs_reply_problem(request, 421, "host", "Misdirected request",
                    "this server does not answer for that host; its operator can name it with --host");
  return false;
}

/* What a browser says of a request without an Origin (pictures, scripts, links): a page of this origin made it, or the
 * user typed the address. Others than browsers do not say. */
static bool fetched_from_here(const tcs_request *request) {
  const char *site = tcs_header(request, "Sec-Fetch-Site");
  return !site || strcmp(site, "same-origin") == 0 || strcmp(site, "none") == 0;
}

bool tcs_admit_origin(tcs_request *request) {
  if (request->route->role == TCS_ROLE_NONE) return true;
  const int count = header_count(request, "Origin");
  const char *origin = tcs_header(request, "Origin");
  if (count == 0
          ? fetched_from_here(request)
          : count == 1 && tcs_origin_allowed(request->server->access->hosts, origin, tcs_header(request, "Host")))
    return true;
  tcs_reply_problem(request, 403, "origin", "Forbidden",
                    "pages of other origins may not ask; behind a proxy name its origin in [server] origins");
  return false;
}

void tcs_shield(tcs_request *request) {
  static const char *const headers[][2] = {
      {"Content-Security-Policy",
       "default-src 'self'; img-src 'self' blob: data:; object-src 'none'; base-uri 'none'; form-action 'none'; "
       "frame-ancestors 'none'"},
      {"Cross-Origin-Opener-Policy", "same-origin"},
      {"Cross-Origin-Resource-Policy", "same-origin"},
      {"Referrer-Policy", "no-referrer"},
      {"X-Content-Type-Options", "nosniff"},
  };
  for (size_t i = 0; i < G_N_ELEMENTS(headers); i++)
    tcs_reply_header(request, headers[i][0], headers[i][1]);
  if (request->reply && !MHD_get_response_header(request->reply, "Cache-Control"))
    tcs_reply_header(request, "Cache-Control", "no-store");
}
