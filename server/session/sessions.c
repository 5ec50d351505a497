#include "server/session/sessions.h"

#include <inttypes.h>
#include <string.h>
#include <sys/random.h>

#include "server/access/access.h"
#include "server/config/config.h"
#include "server/observe/log.h"
#include "server/session/change.h"
#include "server/session/jobs.h"
#include "server/session/measure.h"
#include "server/session/session_scene.h"
#include "server/session/viewers.h"

struct tcs_sessions {
  tcs_server *server;
  GHashTable *by_id;
  GPtrArray *order; /* oldest first */
};

tcs_sessions *tcs_sessions_new(tcs_server *server) {
  tcs_sessions *sessions = g_new0(tcs_sessions, 1);
  sessions->server = server;
  sessions->by_id = g_hash_table_new(g_str_hash, g_str_equal);
  sessions->order = g_ptr_array_new();
  return sessions;
}

void tcs_sessions_free(tcs_sessions *sessions) {
  if (!sessions) return;
  while (sessions->order->len) tcs_session_end(g_ptr_array_index(sessions->order, 0));
  g_ptr_array_unref(sessions->order);
  g_hash_table_destroy(sessions->by_id);
  g_free(sessions);
}

tcs_session *tcs_sessions_find(tcs_sessions *sessions, const char *id) {
  return g_hash_table_lookup(sessions->by_id, id);
}

int tcs_sessions_count(const tcs_sessions *sessions) { return (int)sessions->order->len; }

void tcs_sessions_each(tcs_sessions *sessions, void (*each)(tcs_session *session, void *user), void *user) {
  for (guint i = 0; i < sessions->order->len; i++) each(g_ptr_array_index(sessions->order, i), user);
}

static bool random_id(char id[33], GError **error) {
  uint8_t bytes[16];
  if (getrandom(bytes, sizeof bytes, 0) != sizeof bytes) {
    tc_set_error(error, TC_ERROR_IO, NULL, "the system provides no random numbers");
    return false;
  }
  for (int i = 0; i < 16; i++) g_snprintf(id + 2 * i, 3, "%02x", bytes[i]);
  return true;
}

/* At the limit a peer without a session may still create one, up to twice the limit. */
static bool has_room(const tcs_sessions *sessions, const char *peer) {
  const int64_t most = sessions->server->config->limits.sessions;
  for (guint i = 0; i < sessions->order->len; i++)
    if (strcmp(((const tcs_session *)g_ptr_array_index(sessions->order, i))->peer, peer) == 0)
      return sessions->order->len < most;
  return sessions->order->len < 2 * most;
}

tcs_session *tcs_sessions_create(tcs_sessions *sessions, tcs_entry *entry, const cJSON *patch, const tcp_lists *lists,
                                 const char *peer, GError **error) {
  tcs_server *server = sessions->server;
  tc_scene scene;
  char id[33];
  if (!has_room(sessions, peer)) {
    tc_set_error(error, TC_ERROR_BUSY, NULL, "%" PRId64 " sessions are open, which is the limit; end one and try again",
                 server->config->limits.sessions);
    return NULL;
  }
  if (!random_id(id, error) || !tcs_scene_make(server, entry, patch, lists, &scene, error)) return NULL;
  tcs_session *session = g_new0(tcs_session, 1);
  session->server = server;
  memcpy(session->id, id, sizeof id);
  session->peer = g_strdup(peer);
  session->entry = entry;
  entry->users++;
  session->scene = scene;
  tcs_session_pin(session);
  tc_scene_copy(&session->defaults, &entry->defaults);
  session->revision = 1;
  session->watchers = g_ptr_array_new();
  session->views = g_ptr_array_new();
  tcs_view_new(session, 0, 0);
  session->jobs = g_ptr_array_new();
  session->cost[0] = session->cost[1] = tc_quality_cost_of(tcs_scheduler_about(server->scheduler)->backend);
  session->client = tcs_scheduler_join(server->scheduler, peer, tcs_session_next_job, session);
  session->created_us = session->used_us = g_get_monotonic_time();
  g_hash_table_insert(sessions->by_id, session->id, session);
  g_ptr_array_add(sessions->order, session);
  return session;
}

void tcs_session_end(tcs_session *session) {
  tcs_sessions *sessions = session->server->sessions;
  tcs_log(TCS_LOG_INFO, "audit.session.end", "session=%.8s", session->id);
  g_hash_table_remove(sessions->by_id, session->id);
  g_ptr_array_remove(sessions->order, session);
  while (session->watchers->len) {
    tcs_watcher *watcher = g_ptr_array_index(session->watchers, session->watchers->len - 1);
    tcs_session_leave(watcher);
    watcher->ops->end(watcher);
  }
  tcs_session_free_views(session);
  for (guint i = 0; i < session->jobs->len; i++) {
    tcs_job *job = g_ptr_array_index(session->jobs, i);
    job->user = NULL;
    tcs_job_cancel(job);
  }
  tcs_scheduler_leave(session->server->scheduler, session->client);
  tcs_session_unpin(session);
  session->entry->users--;
  tcs_picture_unref(session->still);
  g_ptr_array_unref(session->watchers);
  g_ptr_array_unref(session->jobs);
  tc_scene_clear(&session->draft);
  tc_scene_clear(&session->scene);
  tc_scene_clear(&session->defaults);
  g_free(session->peer);
  g_free(session);
}

void tcs_sessions_end_of(tcs_sessions *sessions, const tcs_entry *entry) {
  for (guint i = sessions->order->len; i-- > 0;) {
    tcs_session *session = g_ptr_array_index(sessions->order, i);
    if (tcs_session_shows(session, entry)) tcs_session_end(session);
  }
}

void tcs_sessions_end_orphans(tcs_sessions *sessions) {
  for (guint i = sessions->order->len; i-- > 0;) {
    tcs_session *session = g_ptr_array_index(sessions->order, i);
    if (!tcs_tokens_name(sessions->server->access->tokens, session->owner, TCS_ROLE_EDIT)) tcs_session_end(session);
  }
}

int64_t tcs_sessions_next_us(const tcs_sessions *sessions, int64_t now_us) {
  int64_t next = -1;
  for (guint i = 0; i < sessions->order->len; i++) {
    const tcs_session *session = g_ptr_array_index(sessions->order, i);
    if (session->watchers->len == 0 || tcs_session_at_rest(session, now_us)) continue;
    const int64_t left = session->active_until_us - now_us;
    if (next < 0 || left < next) next = left;
  }
  return next;
}

static void wake(tcs_session *session, int64_t now_us) {
  if (session->watchers->len && !session->job)
    tcs_client_want(session->client, tcs_session_wants(session, now_us, NULL));
}

void tcs_sessions_wake(tcs_sessions *sessions, int64_t now_us) {
  for (guint i = 0; i < sessions->order->len; i++) wake(g_ptr_array_index(sessions->order, i), now_us);
  tcs_scheduler_pump(sessions->server->scheduler);
}

void tcs_sessions_settle(tcs_sessions *sessions) {
  for (guint i = 0; i < sessions->order->len; i++) tcs_session_settle(g_ptr_array_index(sessions->order, i));
}

void tcs_sessions_expire(tcs_sessions *sessions, int64_t now_us) {
  const int64_t idle_us = sessions->server->config->limits.session_idle_seconds * 1000000;
  for (guint i = sessions->order->len; i-- > 0;) {
    tcs_session *session = g_ptr_array_index(sessions->order, i);
    if (session->watchers->len == 0 && now_us - session->used_us >= idle_us) tcs_session_end(session);
  }
}
