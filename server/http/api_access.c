/* Tickets for clients that cannot send a token, and share links to one session. */
#include <stdio.h>

#include "server/access/access.h"
#include "server/access/audit.h"
#include "server/http/work.h"
#include "server/session/sessions.h"

#define SHARE_S 86400        /* default lifetime of a link */
#define SHARE_MOST_S 2592000 /* longest lifetime */

static void no_session(tcs_request *request) {
  tcs_reply_problem(request, 404, "not-found", "Not found", "there is no such session; it may have ended");
}

static void post_ticket(tcs_request *request, cJSON *body, const tcp_lists *lists) {
  static const char *const names[] = {"session", NULL};
  const char *id;
  char ticket[TCS_TICKET_SIZE];
  tcs_caller bearer = request->caller;
  if (!tcs_members_known(request, body, names) || !tcs_member_string(request, body, "session", false, &id)) return;
  if (id && !tcs_session_visible(request, id)) {
    no_session(request);
    return;
  }
  if (id) g_strlcpy(bearer.session, id, sizeof bearer.session);
  if (!tcs_tickets_issue(request->server->access->tickets, &bearer, g_get_monotonic_time(), ticket)) {
    tcs_reply_problem(request, 503, "busy", "Busy", "too many tickets are unused; use them or wait until they expire");
    tcs_reply_header(request, "Retry-After", "5");
    return;
  }
  cJSON *json = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "ticket", ticket);
  cJSON_AddNumberToObject(json, "expiresIn", TCS_TICKET_S);
  tcs_reply_json(request, 200, json);
}

void tcs_post_tickets(tcs_request *request) { tcs_read_body(request, NULL, post_ticket); }

/* Parses the lifetime and role of a link. False: replied. */
static bool read_share(tcs_request *request, const cJSON *body, tcs_role *role, int64_t *seconds) {
  static const char *const names[] = {"role", "seconds", NULL};
  const char *name;
  if (!tcs_members_known(request, body, names) || !tcs_member_string(request, body, "role", true, &name)) return false;
  const cJSON *item = cJSON_GetObjectItemCaseSensitive(body, "seconds");
  const double number = cJSON_IsNumber(item) ? item->valuedouble : 0;
  *seconds = SHARE_S;
  if (!tcs_role_parse(name, role) || *role > TCS_ROLE_EDIT) {
    tcs_reply_problem(request, 422, "invalid", "Invalid value", "role: give \"view\" or \"edit\"");
    return false;
  }
  if (item && !(number >= 1 && number <= SHARE_MOST_S && number == (double)(int64_t)number)) {
    tcs_reply_problem(request, 422, "invalid", "Invalid value", "seconds: give a whole number from 1 to 2592000");
    return false;
  }
  if (item) *seconds = (int64_t)number;
  return true;
}

static void post_share(tcs_request *request, cJSON *body, const tcp_lists *lists) {
  tcs_access *access = request->server->access;
  const tcs_session *session = tcs_own_session(request);
  tcs_role role;
  int64_t seconds;
  if (!session || !read_share(request, body, &role, &seconds)) return;
  const int64_t until_s = g_get_real_time() / 1000000 + seconds;
  char token[TCS_SHARE_SIZE], *link;
  tcs_share_sign(access->share_key, session->id, role, until_s, token);
  GDateTime *time = g_date_time_new_from_unix_utc(until_s);
  char *expires = g_date_time_format(time, "%Y-%m-%dT%H:%M:%SZ");
  link = g_strconcat("/#share=", token, NULL);
  cJSON *json = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "link", link);
  cJSON_AddStringToObject(json, "token", token);
  cJSON_AddStringToObject(json, "expires", expires);
  tcs_reply_json(request, 200, json);
  tcs_audit(access, &request->caller, role == TCS_ROLE_EDIT ? "share.edit" : "share.view", session->id, NULL);
  g_date_time_unref(time);
  g_free(expires);
  g_free(link);
}

void tcs_post_share(tcs_request *request) { tcs_read_body(request, NULL, post_share); }
