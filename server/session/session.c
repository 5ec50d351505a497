#include "server/session/session.h"

#include "server/schedule/job.h"
#include "server/session/session_scene.h"

tc_volume *tcs_session_labels(const tcs_session *session) { return session->labels ? session->labels->volume : NULL; }

static void set_labels(tcs_session *session, tcs_entry *labels) {
  if (session->labels && session->labels != session->entry) session->labels->users--;
  if (labels && labels != session->entry) labels->users++;
  session->labels = labels;
}

static void unpin_mesh(void *entry) { ((tcs_entry *)entry)->users--; }

static void pin_meshes(tcs_session *session) {
  const tc_scene *scene = &session->scene;
  GPtrArray *meshes = g_ptr_array_new_with_free_func(unpin_mesh);
  for (size_t i = 0; i < scene->mesh.n_surfaces; i++) {
    const tc_mesh_surface *s = &scene->mesh.surfaces[i];
    tcs_entry *entry =
        s->source == TC_SURFACE_OF_MESH ? tcs_catalogue_find(session->server->catalogue, TCS_KIND_MESH, s->mesh) : NULL;
    if (!entry || g_ptr_array_find(meshes, entry, NULL)) continue;
    entry->users++;
    g_ptr_array_add(meshes, entry);
  }
  if (session->meshes) g_ptr_array_unref(session->meshes);
  session->meshes = meshes;
}

void tcs_session_pin(tcs_session *session) {
  const char *id = session->scene.labels.volume;
  set_labels(session, *id ? tcs_catalogue_find(session->server->catalogue, TCS_KIND_VOLUME, id) : NULL);
  pin_meshes(session);
}

void tcs_session_unpin(tcs_session *session) {
  set_labels(session, NULL);
  g_clear_pointer(&session->meshes, g_ptr_array_unref);
}

bool tcs_session_shows(const tcs_session *session, const tcs_entry *entry) {
  return session->entry == entry || session->labels == entry || g_ptr_array_find(session->meshes, entry, NULL);
}

double tcs_session_samples(tcs_session *session, tcs_view *view) {
  const tc_scene *scene = &session->scene;
  const int width = view->width ? view->width : scene->image.width;
  const int height = view->width ? view->height : scene->image.height;
  if (view->samples_revision == session->revision) return view->full_samples;
  tc_mesh **meshes = tcs_scene_meshes(session->server, scene);
  view->full_samples = tc_estimate_samples(tcs_entry_shown(session->entry, scene), scene, meshes, width, height, NULL);
  tcs_meshes_free(meshes, scene->mesh.n_surfaces);
  view->samples_revision = session->revision;
  return view->full_samples;
}

static double full_ms(tcs_session *session, tcs_view *view) {
  const double elsewhere = tcs_scheduler_ms_per_sample(session->server->scheduler);
  return tcs_view_ladder(view, session->scene.mode, elsewhere)->ms_per_sample * tcs_session_samples(session, view);
}

static bool has_not_seen(const tcs_session *session, const tcs_watcher *watcher) {
  return watcher->view->begun_revision != session->revision &&
         (watcher->resized || watcher->shown_revision != session->revision);
}

/* A viewer that has not seen the current scene gets a picture soon, even at rest: an interactive frame, if the final
 * picture takes long. */
static bool wants_preview(tcs_session *session, const tcs_watcher *watcher) {
  const double soon_ms =
      watcher->shown_revision ? tcs_scheduler_moving_ms(session->server->scheduler) : TCS_LONG_MS;
  return has_not_seen(session, watcher) && full_ms(session, watcher->view) > soon_ms;
}

/* A viewer's first picture has the priority of a single picture. */
static tcs_class class_of(tcs_session *session, const tcs_watcher *watcher, bool rest) {
  if (!rest || wants_preview(session, watcher)) return TCS_CLASS_INTERACTIVE;
  if (!watcher->shown_revision) return TCS_CLASS_SINGLE;
  return has_not_seen(session, watcher) ? TCS_CLASS_INTERACTIVE : TCS_CLASS_REFINE;
}

bool tcs_session_wants_final(tcs_session *session, tcs_view *view, int64_t now_us) {
  bool final = tcs_session_at_rest(session, now_us);
  for (guint i = 0; final && i < session->watchers->len; i++) {
    const tcs_watcher *watcher = g_ptr_array_index(session->watchers, i);
    final = watcher->view != view || !wants_preview(session, watcher);
  }
  return final;
}

static bool is_begun(const tcs_session *session, const tcs_view *view, bool rest) {
  return view->begun_revision == session->revision && (view->begun_final || !rest);
}

tcs_class tcs_session_wants(tcs_session *session, int64_t now_us, tcs_view **wanted_view) {
  tcs_class wanted = TCS_CLASS_NONE;
  tcs_view *first = NULL;
  if (session->job) return wanted;
  const bool rest = tcs_session_at_rest(session, now_us);
  for (guint i = 0; i < session->watchers->len; i++) {
    const tcs_watcher *watcher = g_ptr_array_index(session->watchers, i);
    if (is_begun(session, watcher->view, rest) || !tcs_watcher_wants(watcher, session->revision, rest) ||
        !tcs_credit_open(&watcher->credit, now_us) || !watcher->ops->ready(watcher))
      continue;
    const tcs_class class = class_of(session, watcher, rest);
    if (class > wanted || (class == wanted && watcher->view->begun_revision >= first->begun_revision)) continue;
    wanted = class;
    first = watcher->view;
  }
  if (wanted_view) *wanted_view = first;
  return wanted;
}

void tcs_session_wake(tcs_session *session) {
  tcs_client_want(session->client, tcs_session_wants(session, g_get_monotonic_time(), NULL));
  tcs_scheduler_pump(session->server->scheduler);
}
