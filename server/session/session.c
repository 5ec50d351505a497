#include "server/session/session.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>
#include <sys/random.h>

#include "server/config/config.h"
#include "server/observe/metrics.h"
#include "server/session/measure.h"
#include "server/session/quality.h"

struct tcs_sessions {
  tcs_server *server;
  GHashTable *by_id;
  GPtrArray *order; /* oldest first */
  guint turn;       /* index in `order` of the session that is served next */
  uint64_t last_watcher;
};

static tcs_job *next_job(void *user);

tcs_sessions *tcs_sessions_new(tcs_server *server) {
  tcs_sessions *sessions = g_new0(tcs_sessions, 1);
  sessions->server = server;
  sessions->by_id = g_hash_table_new(g_str_hash, g_str_equal);
  sessions->order = g_ptr_array_new();
  tcs_scheduler_set_stream(server->scheduler, next_job, sessions);
  return sessions;
}

void tcs_sessions_free(tcs_sessions *sessions) {
  if (!sessions) return;
  tcs_scheduler_set_stream(sessions->server->scheduler, NULL, NULL);
  while (sessions->order->len)
    tcs_session_end(g_ptr_array_index(sessions->order, 0));
  g_ptr_array_unref(sessions->order);
  g_hash_table_destroy(sessions->by_id);
  g_free(sessions);
}

tcs_session *tcs_sessions_find(tcs_sessions *sessions, const char *id) {
  return g_hash_table_lookup(sessions->by_id, id);
}

int tcs_sessions_count(const tcs_sessions *sessions) { return (int)sessions->order->len; }

void tcs_sessions_each(tcs_sessions *sessions, void (*each)(tcs_session *session, void *user), void *user) {
  for (guint i = 0; i < sessions->order->len; i++)
    each(g_ptr_array_index(sessions->order, i), user);
}

static bool random_id(char id[33], GError **error) {
  uint8_t bytes[16];
  if (getrandom(bytes, sizeof bytes, 0) != sizeof bytes) {
    tc_set_error(error, TC_ERROR_IO, NULL, "no random numbers to be had");
    return false;
  }
  for (int i = 0; i < 16; i++)
    g_snprintf(id + 2 * i, 3, "%02x", bytes[i]);
  return true;
}

tcs_session *tcs_sessions_create(tcs_sessions *sessions, tcs_entry *entry, const cJSON *patch, GError **error) {
  tcs_server *server = sessions->server;
  tc_scene scene;
  char id[33];
  if (sessions->order->len >= server->config->limits.sessions) {
    tc_set_error(error, TC_ERROR_BUSY, NULL, "%" PRId64 " sessions are open, which is the limit; end one and try again",
                 server->config->limits.sessions);
    return NULL;
  }
  if (!random_id(id, error) || !tcs_scene_make(server, entry->volume, patch, &scene, error)) return NULL;
  tcs_session *session = g_new0(tcs_session, 1);
  session->server = server;
  memcpy(session->id, id, sizeof id);
  session->entry = entry;
  entry->users++;
  session->scene = scene;
  tcs_session_pin(session);
  tc_scene_init(&session->defaults);
  tc_scene_fit(&session->defaults, entry->volume);
  session->revision = 1;
  session->watchers = g_ptr_array_new();
  session->jobs = g_ptr_array_new();
  session->cost = tc_quality_cost_of(tcs_scheduler_about(server->scheduler)->backend);
  session->created_us = session->used_us = g_get_monotonic_time();
  g_hash_table_insert(sessions->by_id, session->id, session);
  g_ptr_array_add(sessions->order, session);
  return session;
}

tc_volume *tcs_session_labels(const tcs_session *session) { return session->labels ? session->labels->volume : NULL; }

static void set_labels(tcs_session *session, tcs_entry *labels) {
  if (session->labels && session->labels != session->entry) session->labels->users--;
  if (labels && labels != session->entry) labels->users++;
  session->labels = labels;
}

void tcs_session_pin(tcs_session *session) {
  const char *id = session->scene.labels.volume;
  set_labels(session, *id ? tcs_catalogue_find(session->server->catalogue, id) : NULL);
}

void tcs_session_end(tcs_session *session) {
  tcs_sessions *sessions = session->server->sessions;
  g_hash_table_remove(sessions->by_id, session->id);
  g_ptr_array_remove(sessions->order, session);
  while (session->watchers->len) {
    tcs_watcher *watcher = g_ptr_array_index(session->watchers, session->watchers->len - 1);
    tcs_session_leave(watcher);
    watcher->ops->end(watcher);
  }
  for (guint i = 0; i < session->jobs->len; i++) {
    tcs_job *job = g_ptr_array_index(session->jobs, i);
    job->user = NULL;
    tcs_job_cancel(job);
  }
  tcs_measure_cancel(session);
  set_labels(session, NULL);
  session->entry->users--;
  tcs_picture_unref(session->latest);
  tcs_picture_unref(session->still);
  g_ptr_array_unref(session->watchers);
  g_ptr_array_unref(session->jobs);
  tc_scene_clear(&session->scene);
  tc_scene_clear(&session->defaults);
  g_free(session);
}

void tcs_sessions_end_of(tcs_sessions *sessions, const tcs_entry *entry) {
  for (guint i = sessions->order->len; i-- > 0;) {
    tcs_session *session = g_ptr_array_index(sessions->order, i);
    if (session->entry == entry || session->labels == entry) tcs_session_end(session);
  }
}

static bool at_rest(const tcs_session *session, int64_t now_us) { return now_us >= session->active_until_us; }

/* --- what to render ------------------------------------------------------------------------------ */

/* Sends the newest picture to a viewer that can take it and has not seen it. A picture of an older scene is sent too:
 * while input flows every picture is one behind, and each is newer than the last. */
static void deliver(tcs_session *session, tcs_watcher *watcher, int64_t now_us) {
  const tcs_picture *picture = session->latest;
  if (!picture ||
      (!tcs_watcher_wants(watcher, picture->revision, picture->final) && !tcs_watcher_wants_error(watcher, picture)))
    return;
  if (!tcs_window_open(&watcher->window, now_us) || !watcher->ops->ready(watcher)) return;
  tcp_frame_header header = picture->header;
  header.frame = tcs_window_send(&watcher->window, now_us);
  header.seq = tcs_watcher_seq_in(watcher, picture, session->revision);
  watcher->shown_revision = picture->revision;
  watcher->shown_final = picture->final;
  watcher->shown_error = tcs_picture_is_judged(picture);
  session->server->metrics->frames_sent++;
  watcher->ops->frame(watcher, picture, &header);
}

void tcs_session_deliver(tcs_session *session) {
  const int64_t now_us = g_get_monotonic_time();
  /* Downwards: a viewer whose socket breaks here leaves the list. */
  for (guint i = session->watchers->len; i-- > 0;)
    deliver(session, g_ptr_array_index(session->watchers, i), now_us);
}

/* Whether some viewer waits for a picture that is not under way; `final` tells which kind. */
static bool has_work(const tcs_session *session, int64_t now_us, bool *final) {
  if (session->job || session->watchers->len == 0) return false;
  *final = at_rest(session, now_us);
  const bool begun = session->begun_revision == session->revision && (session->begun_final || !*final);
  if (begun) return false;
  for (guint i = 0; i < session->watchers->len; i++) {
    const tcs_watcher *watcher = g_ptr_array_index(session->watchers, i);
    if (tcs_watcher_wants(watcher, session->revision, *final) && tcs_window_open(&watcher->window, now_us) &&
        watcher->ops->ready(watcher))
      return true;
  }
  return false;
}

static void fail_revision(tcs_session *session, const tcs_job *job) {
  cJSON *problem = tcp_problem(job->error);
  /* Downwards: a viewer whose socket breaks here leaves the list. */
  for (guint i = session->watchers->len; i-- > 0;) {
    tcs_watcher *watcher = g_ptr_array_index(session->watchers, i);
    cJSON *message = cJSON_CreateObject();
    cJSON_AddStringToObject(message, "type", "error");
    cJSON_AddNumberToObject(message, "seq", (double)watcher->seq);
    cJSON_AddItemReferenceToObject(message, "problem", problem);
    char *text = cJSON_PrintUnformatted(message);
    watcher->ops->text(watcher, text);
    cJSON_free(text);
    cJSON_Delete(message);
    if (watcher->shown_revision <= job->revision) { /* trying again would fail again */
      watcher->shown_revision = job->revision;
      watcher->shown_final = true;
    }
  }
  cJSON_Delete(problem);
}

static tcs_picture *make_picture(tcs_job *job) {
  tcs_picture *picture = g_new0(tcs_picture, 1);
  picture->references = 1;
  picture->revision = job->revision;
  picture->final = job->final;
  picture->classification = job->scene.classification;
  picture->step = job->scene.sampling.step;
  picture->image = g_bytes_ref(job->image);
  picture->marks = job->marks;
  job->marks = NULL;
  picture->header = (tcp_frame_header){
      .width = job->out_width,
      .height = job->out_height,
      .format = job->scene.image.format == TC_FORMAT_PNG ? "png" : "jpeg",
      .quality = job->scene.image.format == TC_FORMAT_PNG ? 100 : job->scene.image.quality,
      .final = job->final,
      .queue_ms = job->queue_ms,
      .tables_ms = job->stats.tables_ms + job->stats.skip_ms,
      .render_ms = job->stats.render_ms,
      .encode_ms = job->encode_ms,
  };
  if (job->scene.error_meter.pixels && tc_meter_refuses(&job->scene, picture->unmeasured, sizeof picture->unmeasured))
    picture->header.unmeasured = picture->unmeasured;
  return picture;
}

int tcs_meter_pixels(const tcs_job *job) {
  char reason[96];
  return tc_meter_refuses(&job->scene, reason, sizeof reason) ? 0 : job->scene.error_meter.pixels;
}

void tcs_session_still(tcs_session *session, tcs_job *job) {
  if (job->revision != session->revision || session->watchers->len || !job->scene.error_meter.pixels) return;
  const tcs_picture *last = session->still;
  if (last && last->revision == job->revision && last->header.width == job->out_width &&
      last->header.height == job->out_height && (session->measure || tcs_picture_is_judged(last)))
    return;                    /* asked for again and again, it would never be done */
  tcs_measure_cancel(session); /* of another picture */
  tcs_picture_unref(session->still);
  session->still = make_picture(job);
  g_clear_pointer(&session->still->image, g_bytes_unref);
  if (job->meter) tcs_measure_begin(session, job, session->still);
}

const tcs_picture *tcs_session_judged(const tcs_session *session) {
  const tcs_picture *pictures[] = {session->still, session->latest};
  for (int i = 0; i < 2; i++)
    if (pictures[i] && pictures[i]->revision == session->revision && tcs_picture_is_judged(pictures[i]))
      return pictures[i];
  return NULL;
}

static void finished(tcs_job *job) {
  tcs_session *session = job->user;
  if (!session) return;
  g_ptr_array_remove(session->jobs, job);
  if (session->job == job) session->job = NULL;
  if (job->error) {
    const bool cancelled = g_error_matches(job->error, TC_ERROR, TC_ERROR_CANCELLED);
    if (cancelled) session->server->metrics->frames_cancelled++;
    /* What was begun did not come: the newest picture that did is the last one begun. */
    session->begun_revision = session->latest ? session->latest->revision : 0;
    session->begun_final = session->latest && session->latest->final;
    if (!cancelled) fail_revision(session, job);
    return;
  }
  const double pixels = (double)job->out_width * job->out_height;
  if (!job->stats.stand_in) {
    tcs_ladder_measure(&session->ladder, pixels, job->stats.render_ms);
    tc_quality_cost_add(&session->cost, &job->scene, pixels, job->stats.render_ms);
  }
  tcs_picture_unref(session->latest);
  session->latest = make_picture(job);
  g_clear_pointer(&session->still, tcs_picture_unref);
  tcs_measure_cancel(session); /* of another picture */
  if (job->meter && job->revision == session->revision) tcs_measure_begin(session, job, session->latest);
  tcs_session_deliver(session);
  if (job->final) tcs_quality_pump(session->server->quality);
}

void tcs_session_refine(tcs_session *session) {
  session->begun_final = false;
  if (session->latest) session->latest->final = false; /* its header said so; it is not sent again */
  for (guint i = 0; i < session->watchers->len; i++)
    ((tcs_watcher *)g_ptr_array_index(session->watchers, i))->shown_final = false;
  tcs_scheduler_pump(session->server->scheduler);
}

/* An interactive frame is smaller and coarser in its JPEG; the view is the same. */
static void make_interactive(tcs_session *session, tcs_job *job) {
  const int width = job->scene.image.width, height = job->scene.image.height;
  const tcs_quality_used *quality = &job->quality;
  const double budget = quality->for_time ? MIN(quality->asked, TCS_LADDER_TARGET_MS) : TCS_LADDER_TARGET_MS;
  const double scale = tcs_ladder_scale(&session->ladder, (double)width * height, budget);
  job->width = MAX(1, (int)lround(width * scale));
  job->height = MAX(1, (int)lround(height * scale));
  if (!job->scene.image.transparent) job->scene.image.format = TC_FORMAT_JPEG;
  job->scene.image.quality = MIN(job->scene.image.quality, TCS_INTERACTIVE_QUALITY);
  job->scene.image.subsampling = TC_SUBSAMPLING_420;
}

/* The job leaves session->job when its rendering is over: the next one may render while this one is encoded. */
static void rendered(tcs_job *job) {
  tcs_session *session = job->user;
  if (session && session->job == job) session->job = NULL;
}

static tcs_job *begin_job(tcs_session *session, bool final) {
  tcs_job *job = tcs_job_new(session->server, session->entry->volume, &session->scene);
  if (session->labels) job->labels = tc_volume_ref(tcs_session_labels(session));
  job->rendered = rendered;
  job->finished = finished;
  job->user = session;
  job->revision = session->revision;
  job->final = final;
  job->hurry = true;
  tcs_quality_resolve(session->server->quality, job, session, !final);
  if (!final) make_interactive(session, job);
  if (final) job->meter_pixels = tcs_meter_pixels(job);
  job->marks = g_array_sized_new(FALSE, FALSE, sizeof(tcs_mark), session->watchers->len);
  for (guint i = 0; i < session->watchers->len; i++) {
    const tcs_watcher *watcher = g_ptr_array_index(session->watchers, i);
    const tcs_mark mark = {watcher->id, watcher->seq};
    g_array_append_val(job->marks, mark);
  }
  session->job = job;
  session->begun_revision = job->revision;
  session->begun_final = final;
  g_ptr_array_add(session->jobs, job);
  return job;
}

static tcs_job *next_job(void *user) {
  tcs_sessions *sessions = user;
  const int64_t now_us = g_get_monotonic_time();
  for (guint i = 0; i < sessions->order->len; i++) {
    const guint index = (sessions->turn + i) % sessions->order->len;
    tcs_session *session = g_ptr_array_index(sessions->order, index);
    bool final;
    if (!has_work(session, now_us, &final)) continue;
    sessions->turn = index + 1;
    return begin_job(session, final);
  }
  return NULL;
}

/* --- changes and viewers ------------------------------------------------------------------------- */

void tcs_session_changed(tcs_session *session) {
  const int64_t now_us = g_get_monotonic_time();
  if (session->watchers->len && session->begun_revision < session->revision)
    session->server->metrics->frames_superseded++;
  session->revision++;
  tcs_measure_cancel(session);
  tcs_quality_changed(session->server->quality, session);
  session->used_us = now_us;
  session->active_until_us = now_us + TCS_REST_US;
  /* A refinement of the old scene would hold up the first frame of the new one. */
  if (session->job && session->job->final) tcs_job_cancel(session->job);
  tcs_scheduler_pump(session->server->scheduler);
}

void tcs_session_join(tcs_session *session, tcs_watcher *watcher, unsigned window) {
  watcher->session = session;
  watcher->id = ++session->server->sessions->last_watcher;
  watcher->seq = watcher->shown_revision = 0;
  watcher->shown_final = false;
  tcs_window_init(&watcher->window, window);
  session->used_us = g_get_monotonic_time();
  g_ptr_array_add(session->watchers, watcher);
  tcs_watcher_pump(watcher);
}

void tcs_session_leave(tcs_watcher *watcher) {
  tcs_session *session = watcher->session;
  if (!session) return;
  watcher->session = NULL;
  g_ptr_array_remove(session->watchers, watcher);
  session->used_us = g_get_monotonic_time();
  if (session->watchers->len > 0) return;
  if (session->job) tcs_job_cancel(session->job);
  if (session->server->quality) tcs_quality_changed(session->server->quality, session);
}

void tcs_watcher_pump(tcs_watcher *watcher) {
  tcs_session *session = watcher->session;
  if (!session) return;
  /* A picture that is out of date only goes out as it is finished; here a newer one is on its way. */
  if (session->latest && session->latest->revision == session->revision)
    deliver(session, watcher, g_get_monotonic_time());
  tcs_scheduler_pump(session->server->scheduler);
}

bool tcs_watcher_patch(tcs_watcher *watcher, uint64_t seq, const cJSON *patch, GError **error) {
  const uint64_t before = watcher->seq;
  watcher->seq = MAX(before, seq); /* the change may begin a render at once, and that shows this patch */
  if (tcs_session_patch(watcher->session, patch, false, error)) return true;
  watcher->seq = before;
  return false;
}

bool tcs_watcher_ack(tcs_watcher *watcher, uint64_t frame, GError **error) {
  if (!tcs_window_ack(&watcher->window, frame, g_get_monotonic_time())) {
    tc_set_error(error, TC_ERROR_INVALID, "/frame", "frame %" PRIu64 " was not sent; the last one was %" PRIu64, frame,
                 watcher->window.sent);
    return false;
  }
  tcs_watcher_pump(watcher);
  return true;
}

void tcs_watcher_pointer(tcs_watcher *watcher, bool down) {
  tcs_session *session = watcher->session;
  session->used_us = g_get_monotonic_time();
  session->active_until_us = down ? session->used_us + TCS_REST_US : 0;
  tcs_scheduler_pump(session->server->scheduler);
}

int64_t tcs_sessions_next_us(const tcs_sessions *sessions, int64_t now_us) {
  int64_t next = -1;
  for (guint i = 0; i < sessions->order->len; i++) {
    const tcs_session *session = g_ptr_array_index(sessions->order, i);
    if (session->watchers->len == 0 || at_rest(session, now_us)) continue;
    const int64_t left = session->active_until_us - now_us;
    if (next < 0 || left < next) next = left;
  }
  return next;
}

void tcs_sessions_expire(tcs_sessions *sessions, int64_t now_us) {
  const int64_t idle_us = sessions->server->config->limits.session_idle_seconds * 1000000;
  for (guint i = sessions->order->len; i-- > 0;) {
    tcs_session *session = g_ptr_array_index(sessions->order, i);
    if (session->watchers->len == 0 && now_us - session->used_us >= idle_us) tcs_session_end(session);
  }
}
