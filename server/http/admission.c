#include "server/http/admission.h"

#include <string.h>

#include "server/access/audit.h"

static void refused(const tcs_request *request, const char *why) {
  tcs_audit_refused(request->server->access, &request->caller, why);
}

bool tcs_admit_host(tcs_request *request) {
  const char *host = tcs_header(request, "Host");
  if (!host || tcs_host_allowed(request->server->access->hosts, host)) return true;
  refused(request, "host");
  tcs_reply_problem(request, 421, "host", "Misdirected request",
                    "this server does not answer for that host; its operator can add the name with --host");
  return false;
}

/* Requests without an Origin (images, scripts, links): Sec-Fetch-Site tells whether a page of this origin made them, or
 * the user typed the address. Clients other than browsers do not send it. */
static bool fetched_from_here(const tcs_request *request) {
  const char *site = tcs_header(request, "Sec-Fetch-Site");
  return !site || strcmp(site, "same-origin") == 0 || strcmp(site, "none") == 0;
}

bool tcs_admit_origin(tcs_request *request) {
  if (request->route->role == TCS_ROLE_NONE) return true;
  const char *origin = tcs_header(request, "Origin");
  if (origin ? tcs_origin_allowed(request->server->access->hosts, origin, tcs_header(request, "Host"))
             : fetched_from_here(request))
    return true;
  refused(request, "origin");
  tcs_reply_problem(request, 403, "origin", "Forbidden",
                    "pages of other origins may not call this server; behind a proxy list the page's origin in [server] origins");
  return false;
}

/* Routes of one session: the only ones open to a share link, and the only ones that accept a ticket. */
static bool is_of_session(const tcs_route *route) { return g_str_has_prefix(route->pattern, "/v1/sessions/{id}"); }

static bool refuse_stranger(tcs_request *request, bool presented) {
  refused(request, "token");
  tcs_reply_problem(request, 401, "token", "Unauthorized",
                    presented ? "the token, ticket or link is unknown or has expired"
                              : "send a token: Authorization: Bearer TOKEN");
  tcs_reply_header(request, "WWW-Authenticate",
                   presented ? "Bearer realm=\"tomocast\", error=\"invalid_token\"" : "Bearer realm=\"tomocast\"");
  return false;
}

static bool refuse_many(tcs_request *request, int wait_s) {
  char seconds[12];
  g_snprintf(seconds, sizeof seconds, "%d", wait_s);
  refused(request, "tries");
  tcs_reply_problem(request, 429, "tries", "Too many requests",
                    "too many wrong tokens came from this address; wait before the next");
  tcs_reply_header(request, "Retry-After", seconds);
  return false;
}

static bool refuse_role(tcs_request *request, const char *detail) {
  refused(request, "role");
  tcs_reply_problem(request, 403, "role", "Not allowed", detail);
  return false;
}

bool tcs_admit_caller(tcs_request *request) {
  const tcs_route *route = request->route;
  tcs_caller *caller = &request->caller;
  if (route->role == TCS_ROLE_NONE || request->for_metrics) return true;
  const bool by_ticket = is_of_session(route) && strcmp(route->method, "GET") == 0;
  char detail[80], *peer = tcs_peer_name(request);
  const tcs_shown shown = {peer, tcs_header(request, "Authorization"), by_ticket ? tcs_query(request, "ticket") : NULL};
  int wait_s;
  const bool known = tcs_access_identify(request->server->access, &shown, caller, &wait_s);
  g_free(peer);
  if (wait_s) return refuse_many(request, wait_s);
  if (!known || caller->role == TCS_ROLE_NONE) return refuse_stranger(request, !known);
  if (caller->role < route->role) {
    g_snprintf(detail, sizeof detail, "this needs the role %s; yours is %s", tcs_role_name(route->role),
               tcs_role_name(caller->role));
    return refuse_role(request, detail);
  }
  if (caller->session[0] && route->role > TCS_ROLE_VIEW && !is_of_session(route))
    return refuse_role(request, "this link opens one session only");
  return true;
}

static const char *const shield[][2] = {
    {"Content-Security-Policy",
     "default-src 'self'; img-src 'self' blob: data:; object-src 'none'; base-uri 'none'; form-action 'none'; "
     "frame-ancestors 'none'"},
    {"Cross-Origin-Opener-Policy", "same-origin"},
    {"Cross-Origin-Resource-Policy", "same-origin"},
    {"Referrer-Policy", "no-referrer"},
    {"X-Content-Type-Options", "nosniff"},
};

void tcs_shield(tcs_request *request) {
  for (size_t i = 0; i < G_N_ELEMENTS(shield); i++) tcs_reply_header(request, shield[i][0], shield[i][1]);
  if (request->reply && !MHD_get_response_header(request->reply, "Cache-Control"))
    tcs_reply_header(request, "Cache-Control", "no-store");
}
